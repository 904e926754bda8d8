"""Sinusoids: Westergaard's line, and the two asymptotes of the product of two waves."""

from __future__ import annotations

import math

import numpy as np

from epcontact.reference import sinusoid
from epcontact.reference.form import ClosedForm, areas, elastic_half_space, refuse_unless
from epcontact.results import FloatArray, PressureDistribution
from epcontact.scene import Scene

_TABULATED = 4097


def _wave(scene: Scene) -> tuple[float, float, float, FloatArray]:
    """s = p0/p*, amplitude (m), p* (Pa), and x/lambda from a crest, of a single wave along x."""
    E = elastic_half_space(scene, "westergaard")
    heights = scene.surface.heights
    profile = heights if heights.ndim == 1 else heights[:, 0]
    modes = np.fft.rfft(profile) * 2 / profile.size
    k = int(np.argmax(np.abs(modes[1:]))) + 1
    amplitude, phase = abs(modes[k]), np.angle(modes[k])
    x = np.arange(profile.size) / profile.size * k + phase / (2 * np.pi)
    wave = profile.mean() + amplitude * np.cos(2 * np.pi * x)
    same = np.abs((heights.T - wave).T).max() < 1e-9 * amplitude
    refuse_unless(bool(same), "westergaard", "one sinusoid along x")
    complete = sinusoid.line_complete_pressure(amplitude, scene.surface.periods[0] / k, E)
    return scene.load.final / complete, amplitude, complete, x


def _partial(scene: Scene) -> tuple[float, float, float, FloatArray]:
    found = _wave(scene)
    refuse_unless(found[0] < 1, "westergaard", "partial contact")
    return found


def _wave_fraction(scene: Scene) -> float:
    return sinusoid.line_contact_fraction(min(1.0, _wave(scene)[0]))


def _wave_gap(scene: Scene) -> float:
    load, amplitude, _, _ = _wave(scene)
    return amplitude * sinusoid.line_mean_gap(load) if load < 1 else 0.0


def _wave_energy(scene: Scene) -> float:
    load, amplitude, complete, _ = _partial(scene)
    return amplitude * complete * sinusoid.line_energy(load)


def _wave_peak(scene: Scene) -> float:
    load, _, complete, _ = _partial(scene)
    return 2 * complete * math.sqrt(load)


def _wave_pressure(scene: Scene) -> FloatArray:
    load, _, complete, x = _partial(scene)
    heights = scene.surface.heights
    pressure = complete * sinusoid.line_pressure(x, load)
    return np.broadcast_to(pressure[:, None], heights.shape) if heights.ndim == 2 else pressure


def _wave_gap_field(scene: Scene) -> FloatArray:
    load, amplitude, _, x = _partial(scene)
    heights = scene.surface.heights
    gap = amplitude * sinusoid.line_gap(x, load)
    return np.broadcast_to(gap[:, None], heights.shape) if heights.ndim == 2 else gap


def _wave_distribution(scene: Scene) -> PressureDistribution:
    """p falls from crest to rim: F(sigma) is what lies between sigma's place and the rim.

    (p/p*)^2 = 4 (1 - y)(s - y), y = sin^2 psi, is solved for y without cancellation at p -> 0.
    """
    load, _, complete, _ = _partial(scene)
    sigma = np.linspace(0, 2 * math.sqrt(load), _TABULATED)
    root = np.sqrt((1 - load) ** 2 + sigma**2)
    y = (load - sigma**2 / 4) * 2 / (1 + load + root)
    y[-1] = 0.0  # the crest; rounding would leave a root of it
    rim = math.asin(math.sqrt(load))
    cumulative = 2 / np.pi * (rim - np.arcsin(np.sqrt(np.clip(y, 0, load))))
    return PressureDistribution(complete * sigma, cumulative)


def _product(scene: Scene, name: str) -> float:
    """s = p0/p* of h (1 + cos cos) on a square period."""
    E = elastic_half_space(scene, name)
    surface = scene.surface
    square = surface.heights.ndim == 2 and len(set(surface.periods)) == 1
    refuse_unless(square, name, "the product of two waves on a square period")
    modes = np.abs(np.fft.rfft2(surface.heights)) / surface.heights.size
    k = np.unravel_index(int(np.argmax(modes)), modes.shape)
    amplitude = 4 * float(modes[k])
    # The four modes (+-k, +-k) hold all of the variance.
    alone = abs(float(np.var(surface.heights)) - amplitude**2 / 4) < 1e-9 * amplitude**2
    along = min(int(k[0]), modes.shape[0] - int(k[0]))  # the mode or its mirror image
    refuse_unless(alone and along == k[1], name, "the product of two waves on a square period")
    wavelength = surface.periods[0] / along
    return scene.load.final / sinusoid.surface_complete_pressure(amplitude, wavelength, E)


def _light(scene: Scene) -> float:
    load = _product(scene, "waviness_light")
    refuse_unless(load <= 1e-2, "waviness_light", "a load of at most p*/100")
    return sinusoid.surface_contact_fraction_light(load)


def _heavy(scene: Scene) -> float:
    load = _product(scene, "waviness_heavy")
    refuse_unless(0.9 <= load < 1, "waviness_heavy", "a load between 0.9 p* and p*")
    return sinusoid.surface_contact_fraction_heavy(load)


_JGH = "Johnson, Greenwood and Higginson, Int. J. Mech. Sci. 27 (1985) 383"

FORMS = (
    ClosedForm(
        "westergaard",
        "Westergaard 1939; Johnson, Int. J. Solids Struct. 32 (1995) 423",
        areas(_wave_fraction)
        | {
            "quantity.mean_gap": _wave_gap,
            "quantity.elastic_energy": _wave_energy,
            "quantity.largest_pressure": _wave_peak,
        },
        {"pressure": _wave_pressure, "gap": _wave_gap_field},
        _wave_distribution,
    ),
    ClosedForm("waviness_light", f"{_JGH}: Hertz on every crest, s -> 0", areas(_light)),
    ClosedForm("waviness_heavy", f"{_JGH}: penny-shaped gaps, s -> 1", areas(_heavy)),
)
