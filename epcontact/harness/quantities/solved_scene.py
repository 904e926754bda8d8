"""A scene and its result, on which quantities are measured."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from epcontact.bem.workers import ranges
from epcontact.errors import InvalidCase
from epcontact.materials.moduli import effective_modulus
from epcontact.reference.layers import compliance
from epcontact.results import ContactResult, FloatArray, PressureDistribution
from epcontact.scene import Scene

# A pressure this close to the hardness counts as equal: scaling by p0 and back rounds.
_AT_THE_CAP = 1e-12

#: Points of a block of rows: half a megabyte of float64 numbers.
_BLOCK_POINTS = 1 << 16

Value = TypeVar("Value")


def row_blocks(field: FloatArray) -> list[slice]:
    """Return slices of the first index of a field, (nx, ny) or (nx,), block by block.

    What is computed from a block stays in the cache of the processor.  New memory for
    the complete field would take several times as long as the computation.
    """
    rows = max(1, _BLOCK_POINTS * len(field) // field.size)
    return ranges(len(field), rows)


@dataclass(frozen=True)
class SolvedScene:
    """A scene and the result of a method with its fields, to measure quantities on.

    Attributes:
        scene: the scene, whose load path ends at the load of the fields.
        result: the result of a method for this scene.
        threads: the number of threads that a measurement may use; no value depends on
            it.
    """

    scene: Scene
    result: ContactResult
    threads: int = 1

    @cached_property
    def _computed(self) -> dict[Any, Any]:
        """The results of `once`, by the function that computed them; empty at first."""
        return {}

    def once(self, compute: Callable[[SolvedScene], Value]) -> Value:
        """Return compute(self), which is called once for all quantities that need
        it.
        """
        if compute not in self._computed:
            self._computed[compute] = compute(self)
        value: Value = self._computed[compute]
        return value

    def field(self, name: str) -> FloatArray:
        """Return a field of the result, an array on the grid of the scene.

        `name` is that in `ContactResult.fields`, such as "pressure" in Pa, "gap" in m
        or "state" (APART, ELASTIC or PLASTIC).

        Raises InvalidCase if the result has no such field, or one on another grid.
        """
        values = self.result.fields.get(name)
        shape = self.scene.surface.shape
        if values is None:
            raise InvalidCase(
                f"{self.result.method} gives no field {name!r} for a gate"
            )
        if np.shape(values) != shape:
            raise InvalidCase(
                f"{self.result.method} gives a {name} of shape {np.shape(values)} on a "
                f"grid of {shape}"
            )
        if name == "state":
            return np.asarray(values)
        return np.asarray(values, dtype=np.float64)

    @cached_property
    def pressure(self) -> FloatArray:
        """The pressure of the result at each grid point, in Pa.

        Raises InvalidCase if the result has no pressure.
        """
        return self.field("pressure")

    @property
    def distribution(self) -> PressureDistribution:
        """The distribution of the pressures.  Raises InvalidCase if the result has
        none.
        """
        if self.result.distribution is None:
            raise InvalidCase(
                f"{self.result.method} gives no pressure distribution for a gate"
            )
        return self.result.distribution

    @property
    def height_scale(self) -> float:
        """A length in m by which errors of heights and gaps are divided.

        It is the rms height of the surface.  For a flat surface, it is the depth by
        which the mean pressure p0 indents a cell of the grid: p0 times the spacing over
        E*.
        """
        surface = self.scene.surface
        if surface.rms_height:
            return surface.rms_height
        modulus = effective_modulus(self.scene.material)
        return self.load_scale * max(surface.spacing) / modulus

    @property
    def load_scale(self) -> float:
        """A pressure in Pa by which errors of pressures are divided.

        It is the last mean pressure p0 of the path, or the largest one if the path ends
        at zero load.
        """
        return self.scene.load.final or max(self.scene.load.path)

    @property
    def flows(self) -> bool:
        """True if the body flows by J2, so that no cap bounds its pressures."""
        return bool(self.result.provenance.options.get("law") == "j2")

    @property
    def unloads(self) -> bool:
        """True if the path unloads a capped body, which keeps its plastic
        displacement.
        """
        capped = math.isfinite(self.scene.material.hardness)
        return capped and not self.flows and not self.scene.load.non_decreasing

    @cached_property
    def at_the_cap(self) -> Any:
        """The mask of the grid points whose pressure is the hardness, a boolean array.

        The comparison allows for rounding of 1e-12 of the hardness.
        """
        return self.pressure >= self.scene.material.hardness * (1 - _AT_THE_CAP)

    @cached_property
    def displacement(self) -> FloatArray:
        """The elastic displacement that the pressures cause at each grid point, in m.

        On a half-space its mean is zero.
        """
        p = self.pressure
        modes = np.fft.rfft(p)
        if p.ndim == 2:
            # In place: another array of modes would take longer than its transform.
            np.fft.fft(modes, axis=0, out=modes)
        modes *= compliance(self.scene)
        if p.ndim == 2:
            np.fft.ifft(modes, axis=0, out=modes)
        return np.asarray(np.fft.irfft(modes, n=p.shape[-1]))

    @cached_property
    def open_gap(self) -> tuple[FloatArray, Any]:
        """The gap that follows from the pressures, and the mask where it must be zero.

        The gap is an array in m on the grid.  The mask is a boolean array, true in
        elastic contact.  The mean gap over these points is set to zero.  Without
        elastic contact, the highest gap of the points at the hardness is set to zero;
        without any contact, the lowest gap.  After a path that unloads, the surface is
        the one that the reported plastic displacement has lowered, and all contact is
        elastic.
        """
        heights = self.scene.surface.heights
        flowing = self.at_the_cap
        touching = self.pressure > 0
        if self.unloads:
            heights = heights - self.field("plastic_displacement")
        else:
            touching &= ~flowing
        gap = self.displacement - heights
        if touching.any():
            gap -= gap[touching].mean()
        elif flowing.any():
            gap -= gap[flowing].max()
        else:
            gap -= gap.min()
        return gap, touching
