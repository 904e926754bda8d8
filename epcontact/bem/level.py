"""One grid of the cascade: its sets, its offset and its optimality conditions.

Inside the solver a pressure is in units of the mean pressure, a height or gap in
metres.  With the gap g = u + z - h (u the displacement, z the offset of the flat) the
Karush-Kuhn-Tucker conditions are g >= 0 where p = 0, g = 0 where 0 < p < cap, and g <=
0 where p = cap.  z is the multiplier of the prescribed mean; it makes g vanish on
average over the points between their bounds.
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
    """A grid problem with the data of its iterations.

    Attributes:
        heights: (nx, ny) in m, read-only.
        cap: hardness in units of the mean pressure.
        gap_scale: length in m by which gap residuals are divided, that of the finest
            grid.
        workers: threads of the solve.
        convolution: applies the compliance; m of displacement by mean pressure.
        step: first length c of a gradient step p - c g, in mean pressures per m.
        parts: flat ranges of the blocks of rows.
    """

    def __init__(
        self, problem: GridProblem, gap_scale: float, workers: Workers
    ) -> None:
        """Prepare a grid problem for iterations.

        problem: heights, compliance and load; gap_scale: length in m by which gap
        residuals are divided; workers: threads of the solve.
        """
        # Read-only as the heights of a scene are, so that kernels are compiled for one
        # kind of array.
        self.heights = problem.heights.view()
        self.heights.flags.writeable = False
        self.cap = problem.cap
        self.gap_scale = gap_scale
        self.workers = workers
        self.convolution = Convolution(problem.symbol, problem.mean_pressure, workers)
        self.step = GRADIENT_STEP / (problem.mean_pressure * problem.symbol.shortest())
        ny = problem.symbol.shape[1]
        self.parts = [slice(a.start * ny, a.stop * ny) for a in self.convolution.rows]

    def split(self, *fields: NDArray[Any]) -> list[list[NDArray[Any]]]:
        """Return, for each field (nx, ny), a list of flat views, one for each block.

        A block is a range of rows that one thread works on.
        """
        return [split(field.reshape(-1), self.parts) for field in fields]


@dataclass
class Iterate:
    """The current state of the iteration on a grid, and its cost so far.

    Attributes:
        p: (nx, ny) feasible pressure, in units of the mean pressure.
        u: (nx, ny) its displacement, in m.
        z: offset of the flat, in m.
        settled: whether the goal of the solve is met.
        history: largest residual after each step.
        newton, cg, gradient: numbers of steps.
        cut: Newton steps that were cut short.
        pairs: cost of all transforms, in pairs of transforms of this grid.
    """

    p: FloatArray
    u: FloatArray
    z: float = 0.0
    settled: bool = False
    history: list[float] = field(default_factory=list)
    newton: int = 0
    cg: int = 0
    gradient: int = 0
    cut: int = 0
    pairs: float = 0.0


def first_iterate(level: Level, p: FloatArray) -> Iterate:
    """Return the iterate of a pressure, with its displacement and no steps taken.

    level: the grid; p: (nx, ny) pressures in units of the mean pressure, from 0 to the
    cap and of mean 1.  The iterate holds p itself, and its steps overwrite p.
    """
    iterate = Iterate(p, np.empty_like(p))
    level.convolution.apply(p, iterate.u)
    return iterate


def measure_iterate(
    level: Level, p: FloatArray, u: FloatArray
) -> tuple[float, float, float]:
    """Return (offset z of the flat in m, mean of p, energy) of a pressure.

    The offset is the mean of h - u over the elastic points, so that the mean gap there
    is 0.  If no point is elastic, the offset is the middle of the range in which no
    point without pressure penetrates and no plastic point separates.  The energy, the
    sum of p (u/2 - h), is in mean pressures times m.

    level: the grid; p: (nx, ny) pressures in units of the mean pressure; u: (nx, ny)
    their displacements in m.
    """
    sums = level.workers.total(
        sum_iterate, *level.split(p, u, level.heights), level.cap
    )
    total, number, force, energy = sums
    mean_pressure = force / p.size
    if number:
        return total / number, mean_pressure, energy
    offsets = level.heights - u
    bounds = np.array(
        [
            offsets[p <= 0].max(initial=-np.inf),
            offsets[p > 0].min(initial=np.inf),
        ]
    )
    middle = float(bounds[np.isfinite(bounds)].mean())
    return middle, mean_pressure, energy


def states(p: FloatArray, cap: float) -> StateArray:
    """Return the contact state of each point, an array of the shape of p.

    It is 0 (apart) where p = 0, 1 (elastic) where 0 < p < cap, and 2 (plastic) where
    p = cap.

    p: pressures of any shape; cap: their upper bound, in the same unit.
    """
    return (p > 0).astype(np.uint8) + (p >= cap)


def kkt_residuals(level: Level, iterate: Iterate) -> dict[str, float]:
    """Return the largest violation of each optimality condition by name, dimensionless.

    level: the grid; iterate: its pressures p, displacements and offset of the flat.

    gap_elastic is |g| where 0 < p < cap, and gap_sign is the wrong sign of g at a
    bound; both are divided by the level's gap scale.  bounds is the pressure beyond its
    bounds, and force is the error of the mean pressure, both by the mean pressure.
    """
    parts = level.workers.each(
        violations,
        *level.split(iterate.p, iterate.u, level.heights),
        iterate.z,
        level.cap,
    )
    elastic, sign, bounds, force = zip(*parts, strict=True)
    return {
        "gap_elastic": max(elastic) / level.gap_scale,
        "gap_sign": max(sign) / level.gap_scale,
        "bounds": max(bounds),
        "force": abs(sum(force) / iterate.p.size - 1),
    }


def put_on_bounds(level: Level, p: FloatArray) -> bool:
    """Move pressures within rounding of a bound onto it; return True if any was moved.

    The bounds are 0 and the cap of the level.  p: (nx, ny) pressures in units of the
    mean pressure, changed in place.

    If points on the bounds carry all of the load, the pressures of the others are only
    the rounding of a sum.
    """
    rounding = 8 * p.size * np.finfo(np.float64).eps
    (moved,) = level.workers.total(move_to_bounds, *level.split(p), level.cap, rounding)
    return bool(moved)


@compiled
def move_to_bounds(p: Any, cap: float, rounding: float) -> tuple[int]:
    """Move pressures within `rounding` of 0 or the cap onto it, in place.

    Returns (the number of pressures moved,).  p: (points,), in the unit of cap and
    rounding.
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
    """Return the largest violations of three conditions, and the sum of p.

    With the gap g = u + z - h, the violations are |g| where 0 < p < cap (m), the
    penetration -g where p = 0 and the gap g where p = cap (m), and the distance of p
    from the range 0 to cap.

    p: (points,) pressures in units of the mean pressure; u: (points,) displacements in
    m; h: (points,) heights in m; z: height of the rigid flat in m; cap: hardness in
    units of the mean pressure.
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
def sum_iterate(p: Any, u: Any, h: Any, cap: float) -> tuple[float, int, float, float]:
    """Return four sums over points: of h - u, of points, of p and of p (u/2 - h).

    The first two sums are over the elastic points, where 0 < p < cap.

    p: (points,) pressures; u: (points,) their displacements in m; h: (points,) heights
    in m; cap: hardness, in the unit of p.
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
