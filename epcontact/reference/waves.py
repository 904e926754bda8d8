"""Sinusoidal waviness against a rigid flat: formulas, and the closed forms that gates
use.

One wave along x, h(x) = h (1 + cos(2 pi x/lambda)) up to a constant: Westergaard
(1939), in the form of Johnson, International Journal of Solids and Structures 32 (1995)
423.  Exact. The product of two waves, h (1 + cos cos): the asymptotes of Johnson,
Greenwood and Higginson, International Journal of Mechanical Sciences 27 (1985) 383;
between them no closed form is known.

Symbols: h = amplitude (m; half the distance from valley to crest of the line), lambda =
wavelength (m), E* = effective_modulus (Pa), p* = pressure of complete contact (Pa), s =
mean pressure / p*, psi = pi x/lambda with x measured from a crest, a = half-width of a
contact.  The formulas hold for 0 <= s <= 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from epcontact.reference.form import ClosedForm
from epcontact.results import FloatArray, PressureDistribution
from epcontact.scene import Scene

# --- formulas of one wave
# -------------------------------------------------------------------------


def line_complete_pressure(
    amplitude: float, wavelength: float, effective_modulus: float
) -> float:
    """p* = pi E* h / lambda in Pa: the mean pressure at which no gap is left."""
    return math.pi * effective_modulus * amplitude / wavelength


def line_contact_fraction(load: float) -> float:
    """2 a/lambda = (2/pi) arcsin(sqrt(s)), with load s = mean pressure / p*."""
    return 2 / math.pi * math.asin(math.sqrt(load))


def line_pressure(position: FloatArray, load: float) -> FloatArray:
    """p/p* = 2 cos(psi) sqrt(s - sin^2 psi) in contact, 0 elsewhere."""
    angle = np.pi * (np.asarray(position) - np.rint(position))
    depth = np.maximum(load - np.sin(angle) ** 2, 0)
    return np.asarray(2 * np.cos(angle) * np.sqrt(depth))


def line_gap(position: FloatArray, load: float) -> FloatArray:
    """g/h = 2 [S sqrt(S^2 - s) - s arccosh(S/sqrt(s))], S = |sin psi|, at x/lambda; 0
    in contact. Its slope continues the pressure analytically.
    """
    sine = np.abs(np.sin(np.pi * (np.asarray(position) - np.rint(position))))
    if load == 0:
        return np.asarray(2 * sine**2)
    ratio = np.maximum(sine / math.sqrt(load), 1)
    return np.asarray(2 * load * (ratio * np.sqrt(ratio**2 - 1) - np.arccosh(ratio)))


def line_mean_gap(load: float) -> float:
    """Mean gap / h = 1 - s + s ln s."""
    return 1 - load + load * _log(load)


def line_energy(load: float) -> float:
    """Elastic energy per nominal area / (h p*) = s^2 (1/4 - ln(s)/2), the work of the
    load.
    """
    return load**2 / 4 - load**2 * _log(load) / 2


def _log(load: float) -> float:
    """ln s, or 0 at s = 0, where every product with a power of s vanishes."""
    return math.log(load) if load else 0.0


# --- formulas of the product of two waves
# ---------------------------------------------------------


def surface_complete_pressure(
    amplitude: float, wavelength: float, effective_modulus: float
) -> float:
    """p* = sqrt(2) pi E* h / lambda in Pa, for h (1 + cos(2 pi x/lambda) cos(2 pi
    y/lambda)).
    """
    return math.sqrt(2) * math.pi * effective_modulus * amplitude / wavelength


def surface_contact_fraction_light(load: float) -> float:
    """Contact fraction pi (3 s/(8 pi))^(2/3), in the limit s -> 0: Hertz on two crests
    a period.
    """
    return math.pi * float((3 * load / (8 * math.pi)) ** (2 / 3))


def surface_contact_fraction_heavy(load: float) -> float:
    """Contact fraction 1 - (3/(2 pi)) (1 - s), in the limit s -> 1.  The two gaps a
    period are penny-shaped cracks without stress intensity, of b^2 = 3 (1 - s)
    lambda^2/(4 pi^2).
    """
    return 1 - 3 / (2 * math.pi) * (1 - load)


# --- the closed forms
# -----------------------------------------------------------------------------

_JGH = "Johnson, Greenwood and Higginson, Int. J. Mech. Sci. 27 (1985) 383"
WESTERGAARD = ClosedForm(
    "westergaard", "Westergaard 1939; Johnson, Int. J. Solids Struct. 32 (1995) 423"
)
WAVINESS_LIGHT = ClosedForm("waviness_light", f"{_JGH}: Hertz on every crest, s -> 0")
WAVINESS_HEAVY = ClosedForm("waviness_heavy", f"{_JGH}: penny-shaped gaps, s -> 1")
#: Pressures at which Westergaard's distribution is tabulated.
_TABULATED = 4097


@dataclass(frozen=True)
class _Wave:
    """One wave along x, as measured on the heights of a scene."""

    load: float  # s
    amplitude: float
    complete: float  # p* in Pa
    position: FloatArray  # x/lambda from a crest, one for each row

    @classmethod
    def of(cls, scene: Scene) -> _Wave:
        E = WESTERGAARD.elastic_half_space(scene)
        heights = scene.surface.heights
        profile = heights if heights.ndim == 1 else heights[:, 0]
        modes = np.fft.rfft(profile) * 2 / profile.size
        k = int(np.argmax(np.abs(modes[1:]))) + 1
        amplitude, phase = abs(modes[k]), np.angle(modes[k])
        x = np.arange(profile.size) / profile.size * k + phase / (2 * np.pi)
        wave = profile.mean() + amplitude * np.cos(2 * np.pi * x)
        same = np.abs((heights.T - wave).T).max() < 1e-9 * amplitude
        WESTERGAARD.needs(bool(same), "one sinusoid along x")
        complete = line_complete_pressure(amplitude, scene.surface.periods[0] / k, E)
        return cls(scene.load.final / complete, amplitude, complete, x)

    @classmethod
    def in_partial_contact(cls, scene: Scene) -> _Wave:
        wave = cls.of(scene)
        WESTERGAARD.needs(wave.load < 1, "partial contact")
        return wave


WESTERGAARD.gives("area.total")(
    lambda scene: line_contact_fraction(min(1.0, _Wave.of(scene).load))
)


@WESTERGAARD.gives("quantity.mean_gap")
def _wave_mean_gap(scene: Scene) -> float:
    wave = _Wave.of(scene)
    return wave.amplitude * line_mean_gap(wave.load) if wave.load < 1 else 0.0


@WESTERGAARD.gives("quantity.elastic_energy")
def _wave_energy(scene: Scene) -> float:
    wave = _Wave.in_partial_contact(scene)
    return wave.amplitude * wave.complete * line_energy(wave.load)


@WESTERGAARD.gives("quantity.largest_pressure")
def _wave_peak(scene: Scene) -> float:
    wave = _Wave.in_partial_contact(scene)
    return 2 * wave.complete * math.sqrt(wave.load)


@WESTERGAARD.gives("field.pressure")
def _wave_pressure(scene: Scene) -> FloatArray:
    wave = _Wave.in_partial_contact(scene)
    profile = wave.complete * line_pressure(wave.position, wave.load)
    return np.broadcast_to(profile, scene.surface.shape[::-1]).T


@WESTERGAARD.gives("field.gap")
def _wave_gap(scene: Scene) -> FloatArray:
    wave = _Wave.in_partial_contact(scene)
    profile = wave.amplitude * line_gap(wave.position, wave.load)
    return np.broadcast_to(profile, scene.surface.shape[::-1]).T


@WESTERGAARD.gives("distribution")
def _wave_distribution(scene: Scene) -> PressureDistribution:
    """p falls from crest to rim, so the share below sigma is that from its place to the
    rim: (p/p*)^2 = 4 (1 - y)(s - y), y = sin^2 psi, is solved for y without
    cancellation.
    """
    wave = _Wave.in_partial_contact(scene)
    load = wave.load
    sigma = np.linspace(0, 2 * math.sqrt(load), _TABULATED)
    root = np.sqrt((1 - load) ** 2 + sigma**2)
    y = (load - sigma**2 / 4) * 2 / (1 + load + root)
    y[-1] = 0.0  # exactly 0 at the crest: the square root below would magnify rounding
    rim = math.asin(math.sqrt(load))
    cumulative = 2 / np.pi * (rim - np.arcsin(np.sqrt(np.clip(y, 0, load))))
    return PressureDistribution(wave.complete * sigma, cumulative)


def _product_load(scene: Scene, form: ClosedForm) -> float:
    """s of h (1 + cos cos) on a square period, as measured on the heights."""
    E = form.elastic_half_space(scene)
    surface, words = scene.surface, "the product of two waves on a square period"
    form.needs(surface.heights.ndim == 2 and len(set(surface.periods)) == 1, words)
    modes = np.abs(np.fft.rfft2(surface.heights)) / surface.heights.size
    k = np.unravel_index(int(np.argmax(modes)), modes.shape)
    amplitude = 4 * float(modes[k])
    # The four modes (+-k, +-k) hold all of the variance.
    alone = abs(float(np.var(surface.heights)) - amplitude**2 / 4) < 1e-9 * amplitude**2
    along = min(int(k[0]), modes.shape[0] - int(k[0]))  # the mode or its mirror image
    form.needs(alone and along == k[1], words)
    wavelength = surface.periods[0] / along
    return scene.load.final / surface_complete_pressure(amplitude, wavelength, E)


@WAVINESS_LIGHT.gives("area.total")
def _light_fraction(scene: Scene) -> float:
    load = _product_load(scene, WAVINESS_LIGHT)
    WAVINESS_LIGHT.needs(load <= 1e-2, "a load of at most p*/100")
    return surface_contact_fraction_light(load)


@WAVINESS_HEAVY.gives("area.total")
def _heavy_fraction(scene: Scene) -> float:
    load = _product_load(scene, WAVINESS_HEAVY)
    WAVINESS_HEAVY.needs(0.9 <= load < 1, "a load between 0.9 p* and p*")
    return surface_contact_fraction_heavy(load)
