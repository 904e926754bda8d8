"""One grid of the cascade: its sets, its offset and the residuals of its optimality
conditions.

Inside the solver a pressure is in units of the mean pressure, a height or gap in metres.  With
g = u + z - h (u the displacement, z the offset of the flat) the Karush-Kuhn-Tucker conditions
are g >= 0 where p = 0, g = 0 where 0 < p < cap, g <= 0 where p = cap.  z is the multiplier of the
prescribed mean; it makes g vanish on average over the points between their bounds.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.problem import GridProblem
from epcontact.bem.transforms import Convolution
from epcontact.bem.workers import Workers, compiled, split
from epcontact.results import FloatArray

StateArray = NDArray[np.uint8]

#: First length of a projected gradient step, and the factor c of the pressures p - c g
#: that start a finer grid or the next load, in units of the stiffness of the shortest
#: wave along an axis.
GRADIENT_STEP = 0.3


class Level:
    """A grid problem with the data of its iterations.  Gap residuals are divided by
    gap_scale (m), that of the finest grid; `step` is the first length c of a gradient
    step p - c g, in mean pressures per m; `parts` are the blocks' flat ranges.
    """

    def __init__(
        self, problem: GridProblem, gap_scale: float, workers: Workers
    ) -> None:
        self.heights = problem.heights.view()
        # As those of a scene, so that kernels are compiled for one kind of array.
        self.heights.flags.writeable = False
        self.cap, self.gap_scale, self.workers = problem.cap, gap_scale, workers
        self.convolution = Convolution(problem.symbol, problem.mean_pressure, workers)
        self.step = GRADIENT_STEP / (problem.mean_pressure * problem.symbol.shortest())
        ny = problem.symbol.shape[1]
        self.parts = [slice(a.start * ny, a.stop * ny) for a in self.convolution.rows]

    def split(self, *fields: NDArray[Any]) -> list[list[NDArray[Any]]]:
        """Return the flat views of each field's blocks."""
        return [split(field.reshape(-1), self.parts) for field in fields]


@dataclass
class Iterate:
    """The current state of the iteration on a grid, and its cost so far."""

    p: FloatArray  # feasible, in units of the mean pressure
    u: FloatArray  # its displacement, in m
    z: float = 0.0  # the offset, in m
    settled: bool = False  # whether the goal is met
    history: list[float] = field(
        default_factory=list
    )  # the largest residual after each step
    newton: int = 0  # numbers of steps
    cg: int = 0
    gradient: int = 0
    cut: int = 0  # Newton steps that were cut short
    pairs: float = 0.0  # cost of all transforms, in pairs of transforms of this grid


def first_iterate(level: Level, p: FloatArray) -> Iterate:
    """The iterate of a feasible pressure p (nx, ny), which later steps overwrite."""
    it = Iterate(p, np.empty_like(p))
    level.convolution.apply(p, it.u)
    return it


def measured(level: Level, p: FloatArray, u: FloatArray) -> tuple[float, float, float]:
    """(offset z in m, mean of p, energy) of a pressure and its displacement.  The
    energy is in mean pressures times m, summed over the points.  If no point is between
    its bounds, the offset is the middle of the range that the other two sets allow.
    """
    sums = level.workers.total(measure, *level.split(p, u, level.heights), level.cap)
    needed, number, force, energy = sums
    if number:
        return needed / number, force / p.size, energy
    offsets = level.heights - u
    ends = offsets[p <= 0].max(initial=-np.inf), offsets[p > 0].min(initial=np.inf)
    return (
        float(np.mean([end for end in ends if np.isfinite(end)])),
        force / p.size,
        energy,
    )


def states(p: FloatArray, cap: float) -> StateArray:
    """APART (0) where p = 0, PLASTIC (2) where p = cap, ELASTIC (1) between."""
    return (p > 0).astype(np.uint8) + (p >= cap)


def kkt_residuals(level: Level, it: Iterate) -> dict[str, float]:
    """The largest violation of each optimality condition, dimensionless.

    gap_elastic: |g| where 0 < p < cap; gap_sign: wrong sign of g at a bound (both
    divided by the level's gap scale); bounds: pressure beyond its bounds, by the mean
    pressure; force: mean(p).
    """
    parts = level.workers.each(
        violations, *level.split(it.p, it.u, level.heights), it.z, level.cap
    )
    elastic, sign, bounds, force = zip(*parts, strict=True)
    return {
        "gap_elastic": max(elastic) / level.gap_scale,
        "gap_sign": max(sign) / level.gap_scale,
        "bounds": max(bounds),
        "force": abs(sum(force) / it.p.size - 1),
    }


def put_on_bounds(level: Level, p: FloatArray) -> bool:
    """Move pressures that are within rounding of a bound onto it; return True if there
    were any. If points on the bounds carry all of the load, those of the others are
    rounding of a sum only.
    """
    rounding = 8 * p.size * np.finfo(np.float64).eps
    (moved,) = level.workers.total(move_to_bounds, *level.split(p), level.cap, rounding)
    return bool(moved)


@compiled
def move_to_bounds(p: Any, cap: float, rounding: float) -> tuple[int]:
    """Move pressures within `rounding` of a bound onto it, in place; return their
    number.
    """
    moved = 0
    for i in range(p.size):
        if 0.0 < p[i] < rounding:
            p[i] = 0.0
            moved += 1
        elif cap - rounding < p[i] < cap:
            p[i] = cap
            moved += 1
    return (moved,)


@compiled
def violations(
    p: Any, u: Any, h: Any, z: float, cap: float
) -> tuple[float, float, float, float]:
    """The largest |g| where 0 < p < cap, g of the wrong sign elsewhere and p beyond its
    bounds, and the sum of p.
    """
    elastic = sign = bounds = force = 0.0
    for i in range(p.size):
        g = u[i] + (z - h[i])
        if p[i] <= 0.0:
            sign = max(sign, -g)
        elif p[i] >= cap:
            sign = max(sign, g)
        else:
            elastic = max(elastic, abs(g))
        bounds = max(bounds, -p[i], p[i] - cap)
        force += p[i]
    return elastic, sign, bounds, force


@compiled
def measure(p: Any, u: Any, h: Any, cap: float) -> tuple[float, int, float, float]:
    """The sum of h - u over the points with 0 < p < cap and their number, and the sums
    of p and of p (u/2 - h) over all points.
    """
    total = force = energy = 0.0
    number = 0
    for i in range(p.size):
        force += p[i]
        energy += p[i] * (0.5 * u[i] - h[i])
        if p[i] > 0.0 and p[i] < cap:
            total += h[i] - u[i]
            number += 1
    return total, number, force, energy
