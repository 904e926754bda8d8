"""Quantities that the harness measures itself, with plain numpy: no solver vouches for itself.

They are taken from the pressure field, the heights of the scene and the compliance of
`reference.layers`, in the process that solved the scene: fields do not leave it.  The registry
in `quantities` says what each of them means.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from epcontact.errors import InvalidCase
from epcontact.harness.distances import carried_pressure
from epcontact.reference.layers import compliance
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Scene

if TYPE_CHECKING:
    from epcontact.harness.model_difference import ModelDifference

# A pressure this close to the hardness counts as at it: scaling by p0 and back rounds.
_AT_THE_CAP = 1e-12


@dataclass(frozen=True)
class Answered:
    """A scene with the result of a method, fields included, from which quantities are measured."""

    scene: Scene
    result: ContactResult

    @cached_property
    def pressure(self) -> FloatArray:
        """The pressure field in Pa.  Raises InvalidCase if there is none on the scene's grid."""
        return self.field("pressure")

    def field(self, name: str) -> FloatArray:
        """A field on the grid of the scene.  Raises InvalidCase if the result has none."""
        values, shape = self.result.fields.get(name), self.scene.surface.shape
        if values is None:
            raise InvalidCase(f"{self.result.method} gives no field {name!r} for a gate")
        if np.shape(values) != shape:
            raise InvalidCase(
                f"{self.result.method} gives a {name} of shape {np.shape(values)} on a grid of "
                f"{shape}"
            )
        return np.asarray(values, dtype=np.float64)

    @cached_property
    def model(self) -> ModelDifference:
        """The comparison with a capped body, whose solves several quantities share."""
        # Imported late: it loads both solvers.
        from epcontact.harness.model_difference import ModelDifference

        return ModelDifference(self.scene, self.result)


def at_the_cap(a: Answered) -> Any:
    """The grid points at which the body flows."""
    return a.pressure >= a.scene.material.hardness * (1 - _AT_THE_CAP)


def force(a: Answered) -> float:
    """mean(p)/p0 - 1."""
    return float(a.pressure.mean()) / a.scene.load.final - 1


def bounds(a: Answered) -> float:
    """How far p leaves [0, hardness], divided by p0."""
    p = a.pressure
    beyond = max(-float(p.min()), float(p.max()) - a.scene.material.hardness, 0.0)
    return beyond / a.scene.load.final


def gap(a: Answered) -> float:
    """The largest violation of the contact conditions on the gap, divided by the rms height.

    It is |g| where 0 < p < hardness, -g where p = 0 and g where p = hardness
    (Karush-Kuhn-Tucker).
    """
    p, heights = a.pressure, a.scene.surface.heights
    C = compliance(a.scene)
    C.flat[0] = 0.0
    gap = np.fft.ifftn(C * np.fft.fftn(p)).real - heights
    apart, flowing = p <= 0, at_the_cap(a)
    between = ~apart & ~flowing
    if between.any():
        gap -= gap[between].mean()
    elif flowing.any():
        gap -= gap[flowing].max()
    wrong = np.where(apart, -gap, np.where(flowing, gap, np.abs(gap)))
    return float(wrong.max()) / float(heights.std())


def raw_total(a: Answered) -> float:
    """Share of grid points with p > 0, less the raw area that the result claims."""
    return float((a.pressure > 0).mean()) - a.result.final.areas["raw"].total


def raw_plastic(a: Answered) -> float:
    """Share of grid points at the hardness, less the raw plastic area that is claimed."""
    return float(at_the_cap(a).mean()) - a.result.final.areas["raw"].plastic


def carried(a: Answered) -> float:
    """(int sigma dF + hardness A_pl)/p0 - 1 of the distribution that the result claims."""
    found, hardness = a.result.distribution, a.scene.material.hardness
    if found is None:
        raise InvalidCase(f"{a.result.method} gives no pressure distribution for a gate")
    carried = carried_pressure(found)
    if math.isfinite(hardness):
        carried += hardness * found.plastic
    return carried / a.scene.load.final - 1


def smallest_contact_pressure(a: Answered) -> float:
    """The smallest pressure where there is contact, in Pa."""
    p = a.pressure
    return float(p[p > 0].min()) if (p > 0).any() else 0.0


def summit_curvature(a: Answered) -> float:
    """Curvature at the highest point in 1/m, by differences, mean over the axes."""
    surface, curvatures = a.scene.surface, []
    summit = np.unravel_index(int(np.argmax(surface.heights)), surface.heights.shape)
    for axis, d in enumerate(surface.spacing):
        beside = [np.roll(surface.heights, shift, axis)[summit] for shift in (1, -1)]
        curvatures.append((2 * surface.heights[summit] - sum(beside)) / d**2)
    return float(np.mean(curvatures))
