"""An answered scene, of which quantities are measured."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from epcontact.errors import InvalidCase
from epcontact.reference.layers import compliance
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Scene

# A pressure this close to the hardness counts as equal: scaling by p0 and back rounds.
_AT_THE_CAP = 1e-12
_BLOCK = 1 << 15  # points of which a few fields stay in cache

Made = TypeVar("Made")


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

    @property
    def load_scale(self) -> float:
        """The last mean pressure p0 in Pa, or the largest of the path if it ends without load."""
        return self.scene.load.final or max(self.scene.load.path)

    @cached_property
    def _made(self) -> dict[Any, Any]:
        return {}

    def once(self, make: Callable[[Answered], Made]) -> Made:
        """Return make(self), which is called once for all quantities that ask for it."""
        if make not in self._made:
            self._made[make] = make(self)
        made: Made = self._made[make]
        return made


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
