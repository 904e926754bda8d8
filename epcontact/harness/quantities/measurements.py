"""Quantities that the harness computes itself with numpy, so that no solver checks itself.

They are computed from the pressure field, the heights of the scene and the compliance of
`reference.layers`, in the process that solved the scene, because fields do not leave it.  The
registry in `quantities` gives the meaning of each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from epcontact.errors import InvalidCase
from epcontact.harness import interface
from epcontact.harness.gates.distances import carried_pressure
from epcontact.reference.layers import compliance
from epcontact.results import APART, ELASTIC, PLASTIC, ContactResult, FloatArray
from epcontact.scene import Scene

if TYPE_CHECKING:
    from epcontact.harness.quantities.model_difference import ModelDifference

# A pressure this close to the hardness counts as equal: scaling by p0 and back rounds.
_AT_THE_CAP = 1e-12
_BLOCK = 1 << 15  # points of which a few fields stay in cache


def largest(function: Callable[..., Any], *fields: Any) -> float:
    """Return the largest value of a function of fields of one shape; nan if there is a nan.

    The function is called with blocks of rows, so that what it makes stays in cache.
    """
    return float(np.max([np.max(function(*block)) for block in _blocks(*fields)]))


def mean(function: Callable[..., Any], *fields: Any) -> float:
    """Return the mean of a function of fields of one shape, as `largest` does."""
    total = np.sum([np.sum(function(*block)) for block in _blocks(*fields)])
    return float(total / fields[0].size)


def _blocks(*fields: Any) -> Iterator[tuple[Any, ...]]:
    step = max(1, _BLOCK // fields[0][0].size)
    for start in range(0, len(fields[0]), step):
        yield tuple(field[start : start + step] for field in fields)


@dataclass(frozen=True)
class Answered:
    """A scene and the result of a method with its fields, to measure quantities of."""

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
        return np.asarray(values, dtype=None if name == "state" else np.float64)

    @property
    def flows(self) -> bool:
        """True if the body flows by J2, so that no cap bounds its pressures."""
        return bool(self.result.provenance.options.get("law") == "j2")

    @property
    def unloads(self) -> bool:
        """True if the path unloads a capped body, which keeps its plastic displacement."""
        capped = math.isfinite(self.scene.material.hardness)
        return capped and not self.flows and not self.scene.load.non_decreasing

    @cached_property
    def displacement(self) -> FloatArray:
        """The elastic displacement that the pressures cause, in m; half-space: of zero mean."""
        p = self.pressure
        modes = np.fft.rfft(p)
        if p.ndim == 2:  # in place: another array of modes would take longer than its transform
            np.fft.fft(modes, axis=0, out=modes)
        modes *= compliance(self.scene)
        if p.ndim == 2:
            np.fft.ifft(modes, axis=0, out=modes)
        return np.asarray(np.fft.irfft(modes, n=p.shape[-1]))

    @cached_property
    def between(self) -> Any:
        """The mask of the points with 0 < p < hardness."""
        return (self.pressure > 0) & ~self.at_the_cap

    @cached_property
    def at_the_cap(self) -> Any:
        """The mask of the points at which the body flows."""
        return self.pressure >= self.scene.material.hardness * (1 - _AT_THE_CAP)

    @cached_property
    def open_gap(self) -> tuple[FloatArray, Any]:
        """The gap in m over the surface that the load meets, and the mask where it must be zero.

        The points where it must be zero are those of elastic contact; the gap's mean over them is
        zero.  If there is none, the highest gap of the flowing points is zero, or the lowest of all
        where nothing touches.  After a path that unloads the surface is the one that the reported
        plastic displacement has left, and all contact is elastic.
        """
        heights, touching = self.scene.surface.heights, self.between
        if self.unloads:
            heights, touching = heights - self.field("plastic_displacement"), self.pressure > 0
        gap, flowing = self.displacement - heights, self.at_the_cap
        if touching.any():
            gap -= gap[touching].mean()
        else:
            gap -= gap[flowing].max() if flowing.any() else gap.min()
        return gap, touching

    @cached_property
    def model(self) -> ModelDifference:
        """The comparison with a capped body; several quantities share its solves."""
        # Imported here because it loads both solvers.
        from epcontact.harness.quantities.model_difference import ModelDifference

        return ModelDifference(self.scene, self.result)


def load_scale(a: Answered) -> float:
    """The last mean pressure p0 in Pa, or the largest of the path if it ends without load."""
    return a.scene.load.final or max(a.scene.load.path)


def force(a: Answered) -> float:
    """Return mean(p)/p0 - 1; after a path to zero, mean(p) over the largest mean pressure."""
    return (float(a.pressure.mean()) - a.scene.load.final) / load_scale(a)


def bounds(a: Answered) -> float:
    """Return the largest distance of p from [0, hardness], divided by p0."""
    p = a.pressure
    beyond = max(-float(p.min()), float(p.max()) - a.scene.material.hardness, 0.0)
    return beyond / load_scale(a)


def gap(a: Answered) -> float:
    """Return the largest violation of the contact conditions on the gap over the rms height.

    It is |g| where 0 < p < hardness, -g where p = 0 and g where p = hardness
    (Karush-Kuhn-Tucker).  After a path that unloads, the surface is the one that the reported
    plastic displacement has left, on which every contact is elastic.
    """
    gap, touching = a.open_gap

    def wrong(p: Any, g: Any, flowing: Any, touching: Any) -> Any:
        return np.where(p <= 0, -g, np.where(flowing & ~touching, g, np.abs(g)))

    return largest(wrong, a.pressure, gap, a.at_the_cap, touching) / a.scene.surface.rms_height


def compression(scene: Scene) -> float:
    """Return the compliance in m/Pa of the mean pressure: d/M of a layer, 0 of a half-space."""
    return float(compliance(scene).flat[0])


def raw_total(a: Answered) -> float:
    """Return the share of grid points with p > 0, minus the reported raw area."""
    return float((a.pressure > 0).mean()) - a.result.final.areas["raw"].total


def raw_plastic(a: Answered) -> float:
    """Return the share of grid points at the hardness, minus the reported raw plastic area."""
    return float(a.at_the_cap.mean()) - a.result.final.areas["raw"].plastic


def carried(a: Answered) -> float:
    """Return (int sigma dF + hardness A_pl)/p0 - 1 of the reported distribution."""
    found, hardness = a.result.distribution, a.scene.material.hardness
    if found is None:
        raise InvalidCase(f"{a.result.method} gives no pressure distribution for a gate")
    carried = carried_pressure(found)
    if math.isfinite(hardness):
        carried += hardness * found.plastic
    return (carried - a.scene.load.final) / load_scale(a)


def smallest_contact_pressure(a: Answered) -> float:
    """Return the smallest pressure in contact, in Pa."""
    p = a.pressure
    return float(p[p > 0].min()) if (p > 0).any() else 0.0


def stiffness(a: Answered, branch: interface.Branch) -> float:
    """Return the stiffness of the interface on a branch of the load, in Pa/m."""
    return interface.interface_stiffness(a.scene, a.result, branch)


def conductance(a: Answered, branch: interface.Branch) -> float:
    """Return the contact conductance per area times the sum of the resistivities, in 1/m."""
    return interface.contact_conductance(a.scene, stiffness(a, branch), resistivity=1.0)


def patches_of(a: Answered, part: str, what: str) -> float:
    """Return the number of the patches of a part of the contact, or the area of the largest."""
    state = a.field("state")
    mask = state != APART if part == "total" else state == {"elastic": ELASTIC}.get(part, PLASTIC)
    areas = interface.patches(mask).areas
    return float(areas.size) if what == "number" else float(areas.max(initial=0.0))


def percolation(a: Answered, sign: float) -> float:
    """Return the share of the area, by closeness times `sign`, that first percolates."""
    p, gap, height = a.pressure, a.field("gap"), np.ptp(a.scene.surface.heights)
    if "plastic_displacement" in a.result.fields and not a.flows:
        gap = gap + np.where(a.at_the_cap, 0.0, a.field("plastic_displacement"))
    # At the hardness all pressures are equal, and the points that have flowed furthest are closest.
    loose = (p <= 0) | (a.at_the_cap & (not a.flows))
    closeness = p / (p.max() or 1.0) - np.where(loose, gap / height, 0.0)
    return interface.percolation_share(sign * closeness)


def surface_mark(a: Answered, name: str) -> float:
    """Return a figure of the heights that another seed, or the surface turned round, would change.

    name: "highest" (m), "skewness", "summit_x" or "summit_y" (shares of the period).
    """
    heights = a.scene.surface.heights
    above = heights - heights.mean()
    if name == "highest":
        return float(above.max())
    if name == "skewness":
        return float((above**3).mean() / (above**2).mean() ** 1.5)
    place = np.unravel_index(int(np.argmax(heights)), heights.shape)
    axis = {"summit_x": 0, "summit_y": 1}[name]
    return float(place[axis] / heights.shape[axis])


def summit_curvature(a: Answered) -> float:
    """Return the curvature at the highest point in 1/m, by differences, averaged over the axes."""
    surface, curvatures = a.scene.surface, []
    summit = np.unravel_index(int(np.argmax(surface.heights)), surface.heights.shape)
    for axis, d in enumerate(surface.spacing):
        beside = [np.roll(surface.heights, shift, axis)[summit] for shift in (1, -1)]
        curvatures.append((2 * surface.heights[summit] - sum(beside)) / d**2)
    return float(np.mean(curvatures))
