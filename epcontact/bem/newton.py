"""Semi-smooth Newton method on the sets apart, elastic, plastic, with feasible iterates.

One outer step, from a pressure p that keeps its bounds and its mean:

1. solve on the elastic set F all points between their bounds, and those on a bound where the gap
   has the wrong sign: (S p)_F + z = h_F, the mean of p kept, by conjugate gradients in the space
   of zero mean, preconditioned cell by cell; only as far as the sets are worth;
2. move the outcome into the bounds, restore the force of each neighbourhood and the mean, and
   find the displacement of all points.

So a step costs one pair of transforms and a cheap one for each inner iteration, and the
Karush-Kuhn-Tucker residuals of every iterate are known.  So is its energy 1/2 <p, S p> - <p, h>,
which decides (`descent`): the full step is taken if it lowers the energy; else the step is cut at
the minimum of the energy along it, and projected gradient steps follow.  The energy of the
iterates never rises, which rules out the cycles that the plain method falls into once the pressure
is capped.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from epcontact.bem import passes
from epcontact.bem.constraints import Level, measured, project, states
from epcontact.bem.descent import Iterate, Step, best_share, cut_back, gradient_steps
from epcontact.bem.inner.cells import Cells
from epcontact.bem.inner.cg import Inner, conjugate_gradients
from epcontact.bem.transforms import Points
from epcontact.results import FloatArray

StateArray = NDArray[np.uint8]

# Most gradient steps after a step that was cut: none at first, one the second time, and four
# times as many each time that it happens again.
_GRADIENT_STEPS = 16
# Points that change sets in a step, by the error of the areas after it, below which what is about
# to come into contact tells that error: each step leaves a fifth of the changes or less.
_CHANGES_PER_ERROR = 5
# And the share of the first residual.
_CALM = 0.2
# The residual below which no point changes any more, where less than one would be too many.
_UNSEEN = 1e-5
# A full step is taken if the least energy along it lies beyond this share; beyond 1/2 it lowers
# the energy.
_FULL_STEP = 0.5
# Steps within which the residual is to halve; it falls that much in one as a rule.
_SLOW = 4
# The largest share of the distance to its bounds that a point is moved by to restore the force.
_MOST = 0.9
# The 2-norm of the residual falls by this in a step; by the second once the sets have settled.
_REDUCTION = 0.1
_LAST_REDUCTION = 1e-3


@dataclass
class Counts:
    """What a level has cost."""

    newton: int = 0
    cg: int = 0
    gradient: int = 0
    cut: int = 0
    pairs: float = 0.0
    history: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class Goal:
    """When to stop: residual <= tolerance, or sets settled to the share `area_tolerance`."""

    tolerance: float
    area_tolerance: float = 0.0
    max_steps: int = 500
    progress: Callable[[str], None] | None = None


@dataclass(frozen=True)
class _Sets:
    """What the sets to solve on look like: numbers of points, elastic ones by block."""

    changed: int
    plastic: int
    entering: int
    unloading: int
    worst: float
    per_block: list[int]

    @property
    def elastic(self) -> int:
        """Elastic points."""
        return sum(self.per_block)

    @property
    def contact(self) -> int:
        """Points in contact."""
        return self.elastic + self.plastic

    def least(self) -> int:
        """The points of the smallest area that has any."""
        return min((n for n in (self.elastic, self.plastic) if n), default=0)

    def unsettled(self) -> float:
        """How far the areas are from those of the sets: what comes into contact and what ceases
        to be plastic, as a share of the smallest area that it changes."""
        shares = (
            (self.entering, self.contact),
            (self.unloading, self.plastic),
            (self.entering + self.unloading, self.elastic),
        )
        return max(number / max(area, 1) for number, area in shares)


def solve_level(level: Level, p: FloatArray, goal: Goal) -> tuple[Iterate, Counts]:
    """Solve on one grid from a feasible start p (nx, ny), which is overwritten.

    Returns the last iterate, whether or not it meets the goal (`settled`), and the counts.
    """
    counts = Counts()
    inner = Inner(level)
    it = Iterate(p, np.empty_like(p))
    level.convolution.apply(p, it.u)
    state = states(p, level.cap)
    step: Step | None = None
    trouble = 0
    while True:
        now = measured(level, it.p, it.u)
        share = 1.0 if step is None else best_share(level, it, step, now.energy)
        full = share >= _FULL_STEP
        if step is not None and not full:
            counts.cut += 1
            trouble += 1
            cut_back(level, it, step, share)
            if trouble > 1:
                number = min(4 ** (trouble - 2), _GRADIENT_STEPS)
                counts.gradient += gradient_steps(level, it, number)
            now = measured(level, it.p, it.u)
        else:
            trouble = max(0, trouble - 1)
            if not trouble and _slow(counts.history):
                counts.gradient += gradient_steps(level, it, 1)
                now = measured(level, it.p, it.u)
        it.z = now.offset
        sets = _classify(level, it, state)
        it.residual = max(sets.worst / level.gap_scale, abs(now.force - 1))
        counts.history.append(it.residual)
        it.settled = _settled(it, sets, goal, counts.history[0], full and step is not None)
        if it.settled or counts.newton >= goal.max_steps:
            counts.pairs = level.convolution.pairs + inner.pairs
            return it, counts
        counts.newton += 1
        if goal.progress is not None:
            goal.progress(f"grid {level.heights.shape}: residual {it.residual:.1e}")
        step = _newton_step(level, inner, it, state, sets, now.energy, counts, goal)


def _slow(history: list[float]) -> bool:
    """Whether steps lower the energy, but hardly bring the end nearer.

    Where elastic displacements are small beside the heights, almost all points lie on a bound and
    trade places by way of a few elastic ones; a gradient step trades all of them at once.
    """
    return len(history) > _SLOW and history[-1] > 0.5 * history[-1 - _SLOW]


def _settled(it: Iterate, sets: _Sets, goal: Goal, first: float, full_step: bool) -> bool:
    """By the residual, or by the sets.

    After a step that was cut, while many points still change, or as long as the residual is near
    the first one, sets at rest mean nothing: with many points a wavelength fronts move less than
    a point while forces are still out of balance.
    """
    if it.residual <= goal.tolerance:
        return True
    aim = goal.area_tolerance
    calm = full_step and sets.changed <= _CHANGES_PER_ERROR * aim * max(sets.contact, 1)
    seen = aim * sets.least() >= 1 or it.residual <= _UNSEEN
    return aim > 0 and calm and seen and it.residual <= _CALM * first and sets.unsettled() <= aim


def _classify(level: Level, it: Iterate, state: StateArray) -> _Sets:
    p, u, h, s = (a.reshape(-1) for a in (it.p, it.u, level.heights, state))

    def block(start: int) -> tuple[int, int, int, int, int, float]:
        k = level.part(start)
        out: tuple[int, int, int, int, int, float] = passes.classify(
            p[k], u[k], h[k], s[k], it.z, level.cap
        )
        return out

    parts = level.workers.run(block, level.convolution.blocks)
    return _Sets(
        changed=sum(x[0] for x in parts),
        plastic=sum(x[2] for x in parts),
        entering=sum(x[3] for x in parts),
        unloading=sum(x[4] for x in parts),
        worst=max(x[5] for x in parts),
        per_block=[x[1] for x in parts],
    )


def _newton_step(  # noqa: PLR0913, PLR0917 - one step needs them all
    level: Level,
    inner: Inner,
    it: Iterate,
    state: StateArray,
    sets: _Sets,
    energy: float,
    counts: Counts,
    goal: Goal,
) -> Step | None:
    """One outer step, in place; None if there is nothing to solve for."""
    points, pressure, r = _collect(level, it, state, sets)
    if r.size < 2:
        # One point carries what the others leave: only a gradient step can change the sets.
        counts.gradient += gradient_steps(level, it, 1)
        return None
    step = Step(points, pressure, -r, energy)
    r -= r.mean()
    x = np.zeros(r.size)
    operator = inner.choose(sets.changed, r.size, it.residual)
    exact = operator is level.convolution
    reduction = _LAST_REDUCTION if exact and not sets.changed else _REDUCTION
    floor = 0.3 * goal.tolerance * level.gap_scale
    cells = Cells(level.convolution, points)
    precondition = inner.preconditioner(cells)
    counts.cg += conjugate_gradients(operator, precondition, points, r, x, reduction, floor)
    _put(level, it, points, cells, pressure, x)
    level.convolution.apply(it.p, it.u)
    return step


def _collect(
    level: Level, it: Iterate, state: StateArray, sets: _Sets
) -> tuple[Points, FloatArray, FloatArray]:
    """The elastic points, their pressure and residual h - u - z."""
    begins, n = {}, 0
    for start, number in zip(level.convolution.blocks, sets.per_block, strict=True):
        begins[start] = slice(n, n + number)
        n += number
    points = Points(np.empty(n, dtype=np.int32), begins)
    pressure, r = np.empty(n), np.empty(n)
    p, u, h, s = (a.reshape(-1) for a in (it.p, it.u, level.heights, state))

    def block(start: int) -> None:
        k, j = level.part(start), points.part(start)
        passes.collect(p[k], u[k], h[k], s[k], k.start, it.z, points.index[j], pressure[j], r[j])

    level.workers.run(block, level.convolution.blocks)
    return points, pressure, r


def _put(
    level: Level, it: Iterate, points: Points, cells: Cells, pressure: FloatArray, x: FloatArray
) -> None:
    """Write pressure + x, moved into the bounds, and restore the force: of each cell where its
    points can carry it, then the mean.

    What the bounds cut off differs from place to place.  Made good by all points alike, it would
    leave a long-wave imbalance of forces, whose displacement is large, and steps would overshoot.
    """
    p, cap, target = it.p.reshape(-1), level.cap, float(pressure.sum())

    def put(start: int, sums: FloatArray) -> None:
        j = points.part(start)
        cell, first = cells.part(start)
        passes.put_clipped(p, points.index[j], pressure[j], x[j], cap, cell, first, sums)

    def spread(start: int) -> tuple[float, float]:
        cell, _ = cells.part(start)
        sums: tuple[float, float] = passes.spread(
            p, points.index[points.part(start)], cell, factor, cap
        )
        return sums

    missing, weight = cells.sums(put, 2)
    able = np.abs(missing) < _MOST * weight
    factor = np.where(able, missing / np.where(able, weight, 1.0), np.copysign(_MOST, missing))
    parts = level.workers.run(spread, level.convolution.blocks)
    left, left_weight = target - sum(s[0] for s in parts), sum(s[1] for s in parts)
    if abs(left) < _MOST * left_weight:
        factor = np.full(factor.shape, left / left_weight)
        level.workers.run(spread, level.convolution.blocks)
    else:
        p[points.index] = project(pressure + x, cap, target)
