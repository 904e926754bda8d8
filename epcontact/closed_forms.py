"""Closed forms that gates can name, read off a scene's own heights, material and load.

Each form refuses a scene it does not describe; what it needs of the geometry (an amplitude, a
radius) it measures on the heights, so that it shares nothing with the recipe that made them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidCase
from epcontact.moduli import effective_modulus
from epcontact.reference import hertz, sinusoid
from epcontact.scene import Scene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ClosedForm:
    """Scalars and fields of an exact solution, by the names that gates use."""

    name: str
    source: str
    scalars: Mapping[str, Callable[[Scene], float]] = field(default_factory=dict)
    fields: Mapping[str, Callable[[Scene], FloatArray]] = field(default_factory=dict)

    def scalar(self, quantity: str, scene: Scene) -> float:
        """The value of a quantity.  Raises InvalidCase if the form does not know it."""
        return float(self._find(self.scalars, quantity)(scene))

    def field(self, name: str, scene: Scene) -> FloatArray:
        """A field on the scene's grid.  Raises InvalidCase if the form does not know it."""
        return np.asarray(self._find(self.fields, name)(scene))

    def _find(self, known: Mapping[str, Any], name: str) -> Any:
        if name not in known:
            raise InvalidCase(
                f"the closed form {self.name} has no {name!r}; it has {', '.join(known) or 'none'}"
            )
        return known[name]


def _areas(total: Callable[[Scene], float]) -> dict[str, Callable[[Scene], float]]:
    """The exact area, to hold either of a method's two estimates against."""
    return {"area.total.raw": total, "area.total.corrected": total}


def _refuse_unless(condition: bool, name: str, needs: str) -> None:
    if not condition:
        raise InvalidCase(f"the closed form {name} describes {needs}, which this scene is not")


def _elastic_half_space(scene: Scene, name: str) -> float:
    """E*, where the scene is an elastic half-space."""
    elastic = scene.material.hardness == math.inf and scene.body.kind == "half_space"
    _refuse_unless(elastic, name, "an elastic half-space")
    return effective_modulus(scene.material)


# --- one sinusoid: Westergaard 1939 --------------------------------------------------------------


def _wave(scene: Scene) -> tuple[float, float, float, FloatArray]:
    """s = p0/p*, amplitude (m), p* (Pa), and x/lambda from a crest, of a single wave along x."""
    E = _elastic_half_space(scene, "westergaard")
    heights = scene.surface.heights
    profile = heights if heights.ndim == 1 else heights[:, 0]
    modes = np.fft.rfft(profile) * 2 / profile.size
    k = int(np.argmax(np.abs(modes[1:]))) + 1
    amplitude, phase = abs(modes[k]), np.angle(modes[k])
    x = np.arange(profile.size) / profile.size * k + phase / (2 * np.pi)
    wave = profile.mean() + amplitude * np.cos(2 * np.pi * x)
    same = np.abs((heights.T - wave).T).max() < 1e-9 * amplitude
    _refuse_unless(bool(same), "westergaard", "one sinusoid along x")
    complete = sinusoid.line_complete_pressure(amplitude, scene.surface.periods[0] / k, E)
    return scene.load.final / complete, amplitude, complete, x


def _wave_fraction(scene: Scene) -> float:
    load = _wave(scene)[0]
    return sinusoid.line_contact_fraction(load) if load < 1 else 1.0


def _wave_gap(scene: Scene) -> float:
    load, amplitude, _, _ = _wave(scene)
    return amplitude * sinusoid.line_mean_gap(load) if load < 1 else 0.0


def _wave_pressure(scene: Scene) -> FloatArray:
    load, _, complete, x = _wave(scene)
    _refuse_unless(load < 1, "westergaard", "partial contact")
    heights = scene.surface.heights
    pressure = complete * sinusoid.line_pressure(x, load)
    return np.broadcast_to(pressure[:, None], heights.shape) if heights.ndim == 2 else pressure


# --- one bump: Hertz with its periodic images ----------------------------------------------------


def _bump_fraction(scene: Scene) -> float:
    E = _elastic_half_space(scene, "hertz")
    surface = scene.surface
    heights, spacing = surface.heights, surface.spacing
    summit = np.unravel_index(int(np.argmax(heights)), heights.shape)
    curvatures = []
    for axis, (i, d) in enumerate(zip(summit, spacing, strict=True)):
        along = np.moveaxis(heights, axis, -1)
        line = along[tuple(j for a, j in enumerate(summit) if a != axis)]
        second = line[(i + 1) % line.size] - 2 * line[i] + line[i - 1]
        curvatures.append(-second / d**2)
    radius = 1 / curvatures[0]
    round_bump = np.allclose(curvatures, curvatures[0], rtol=1e-9) and radius > 0
    square = len(set(surface.periods)) == 1
    _refuse_unless(bool(round_bump) and square, "hertz", "one round bump in a square period")
    period = surface.periods[0]
    force = scene.load.final * math.prod(surface.periods)
    if heights.ndim == 1:
        half_width = hertz.cylinder_half_width_periodic(force, radius, E, period)
        return 2 * half_width / period
    a = hertz.sphere_contact_radius_periodic(force, radius, E, period)
    return math.pi * a**2 / period**2


# --- linear problems -----------------------------------------------------------------------------


def _full_pressure(scene: Scene) -> FloatArray:
    """p_q = E* q h_q / 2 about the mean pressure."""
    _refuse_unless(scene.body.kind == "half_space", "full_contact", "a half-space")
    surface = scene.surface
    q = np.zeros(())
    for axis, (n, d) in enumerate(zip(surface.shape, surface.spacing, strict=True)):
        along = 2 * np.pi * np.fft.fftfreq(n, d)
        q = q + (along**2).reshape([-1 if a == axis else 1 for a in range(surface.heights.ndim)])
    modes = effective_modulus(scene.material) / 2 * np.sqrt(q) * np.fft.fftn(surface.heights)
    pressure = scene.load.final + np.fft.ifftn(modes).real
    fits = pressure.min() >= 0 and pressure.max() <= scene.material.hardness
    _refuse_unless(bool(fits), "full_contact", "a load that closes every gap without yielding")
    return np.asarray(pressure)


def _full_area(scene: Scene) -> float:
    _full_pressure(scene)
    return 1.0


def _bearing_fraction(scene: Scene) -> float:
    """A = p0/sigma_P: the limit in which elasticity carries nothing."""
    _refuse_unless(math.isfinite(scene.material.hardness), "bearing_area", "a finite hardness")
    return scene.load.final / scene.material.hardness


CLOSED_FORMS: dict[str, ClosedForm] = {
    form.name: form
    for form in (
        ClosedForm(
            "westergaard",
            "Westergaard 1939; Johnson, Int. J. Solids Struct. 32 (1995) 423",
            _areas(_wave_fraction) | {"quantity.mean_gap": _wave_gap},
            {"pressure": _wave_pressure},
        ),
        ClosedForm(
            "hertz",
            "Johnson, Contact Mechanics (1985), with the curvature of the periodic images",
            _areas(_bump_fraction),
        ),
        ClosedForm(
            "full_contact",
            "Johnson, Contact Mechanics (1985), section 13.2: p_q = E* q h_q / 2",
            _areas(_full_area),
            {"pressure": _full_pressure},
        ),
        ClosedForm(
            "bearing_area",
            "the highest p0/sigma_P of the surface, flattened without springing back",
            _areas(_bearing_fraction)
            | {
                "area.plastic.raw": _bearing_fraction,
                "area.plastic.corrected": _bearing_fraction,
            },
        ),
    )
}
