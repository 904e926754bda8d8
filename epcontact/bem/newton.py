"""Semi-smooth Newton method on the sets apart, elastic, plastic, with feasible
iterates.

One outer step, from a pressure p that keeps its bounds and its mean:

1. solve (S p)_F + z = h_F with the mean of p kept, where the elastic set F holds the
   points between their bounds and those on a bound where the gap has the wrong sign;
   this is done by conjugate gradients in the space of zero mean, preconditioned cell by
   cell, and no more accurately than the present sets deserve;
2. move the result into the bounds, restore the force of each cell and the mean, and
   find the displacement of all points.

So a step costs one pair of transforms, and a cheap one for each inner iteration.  The
full step is taken if it lowers the energy 1/2 <p, S p> - <p, h>; otherwise it is cut at
the minimum of the energy along it, and projected gradient steps follow.  The energy of
the iterates never rises, which rules out the cycles of the plain method with a capped
pressure.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from epcontact.bem.bounds import gradient_step, put
from epcontact.bem.inner.cells import Cells
from epcontact.bem.inner.cg import InnerOperators, conjugate_gradients
from epcontact.bem.inner.split import MaskedGrid
from epcontact.bem.level import (
    Iterate,
    Level,
    StateArray,
    first_iterate,
    measured,
    states,
)
from epcontact.bem.problem import Options
from epcontact.bem.transforms import Points
from epcontact.bem.workers import compiled
from epcontact.results import FloatArray

_MAX_STEPS = 500  # default limit on the Newton steps
# Most gradient steps after a Newton step that was cut: none after the first cut, one
# after the second, then four.  With one at most, one of 561 hard scenes did not
# converge.
_GRADIENT_STEPS = 4
# The areas count as settled only if fewer points changed sets in the last step than
# this times `area_tolerance` times the contact.  A step leaves at most a fifth of the
# changes of the one before, so the changes still to come are then within the tolerance.
_CHANGES_PER_ERROR = 5
# Nor before the residual has fallen to this share of the first one: 24 of 81 scenes of
# 8 to 64 points a wavelength would stop with areas up to 3 % off.
_CALM = 0.2
# Nor unless the tolerance is worth at least one point of the smallest area, or the
# residual is below this value, at which no point changes sets any more (largest error
# of 312 scenes: 4e-6).
_UNSEEN = 1e-5
# Differences of the energy below this share of (points x mean pressure x gap scale) are
# rounding. Without this limit full steps near the end were cut, and 53 scenes took 17 %
# more pairs.
_ENERGY_NOISE = 1e-12
# Along a step the energy is a parabola: the full step lowers it if the minimum is
# beyond a half.
_FULL_STEP = 0.5
# A gradient step is added where the residual has not halved within this number of
# steps, as on nearly rigid bodies, whose points are almost all on a bound: Newton steps
# exchange them by way of a few elastic points, a gradient step all at once.
_SLOW = 4
# The inner iterations reduce the 2-norm of the residual by the first factor, and, with
# the exact operator once no point changes sets, by the second one.
_REDUCTION, _LAST_REDUCTION = 0.1, 1e-3


@dataclass(frozen=True)
class _Sets:
    """Numbers of points by set, and the worst violation of the conditions on the gap in
    m.
    """

    changed: int
    elastic: int
    plastic: int
    entering: int  # that come into contact
    unloading: int  # that cease to be plastic
    worst: float
    elastic_by_block: list[int]

    def settled(self, aim: float, history: list[float]) -> bool:
        """True if the areas change by no more than `aim` after a full step.  They do
        not count while the residual is near the first one: with many points a
        wavelength, fronts move by less than a point while forces are out of balance.
        """
        contact = self.elastic + self.plastic
        least = min((n for n in (self.elastic, self.plastic) if n), default=0)
        changes = (
            self.entering / max(contact, 1),
            self.unloading / max(self.plastic, 1),
            (self.entering + self.unloading) / max(self.elastic, 1),
        )
        few_changes = self.changed <= _CHANGES_PER_ERROR * aim * max(contact, 1)
        seen, calm = (
            aim * least >= 1 or history[-1] <= _UNSEEN,
            history[-1] <= _CALM * history[0],
        )
        return few_changes and seen and calm and max(changes) <= aim


@dataclass(frozen=True, eq=False)
class _Step:
    """A Newton step that was taken."""

    points: Points  # that the step changed
    before: FloatArray  # their pressures and gaps before the step
    gap: FloatArray
    energy: float  # before the step


def solve_level(level: Level, p: FloatArray, options: Options) -> Iterate:
    """Solve on one grid from a feasible start p (nx, ny), which is overwritten."""
    it, inner = first_iterate(level, p), InnerOperators(level.convolution)
    state, trouble = states(p, level.cap), 0
    step: _Step | None = None
    while True:
        it.z, force, energy = measured(level, it.p, it.u)
        share = 1.0 if step is None else _best_share(level, it, step, energy)
        full = share >= _FULL_STEP
        if step is not None and not full:
            it.cut, trouble = it.cut + 1, trouble + 1
            p, index = it.p.reshape(-1), step.points.index
            p[index] = step.before + share * (p[index] - step.before)
            level.convolution.apply(it.p, it.u)
            gradient = min(4 ** (trouble - 2), _GRADIENT_STEPS) if trouble > 1 else 0
        else:
            trouble = max(0, trouble - 1)
            slow = (
                len(it.history) > _SLOW
                and it.history[-1] > 0.5 * it.history[-1 - _SLOW]
            )
            gradient = int(slow and not trouble)
        length = level.step
        for _ in range(gradient):
            length = gradient_step(level, it, length)
        if gradient or not full:
            it.z, force, energy = measured(level, it.p, it.u)
        sets = _update_sets(level, it, state)
        it.history.append(max(sets.worst / level.gap_scale, abs(force - 1)))
        it.settled = it.history[-1] <= options.tolerance
        if options.area_tolerance and full and step is not None:
            it.settled |= sets.settled(options.area_tolerance, it.history)
        if it.settled or it.newton >= (options.max_steps or _MAX_STEPS):
            it.pairs = level.convolution.pairs + inner.pairs
            return it
        it.newton += 1
        if options.progress is not None:
            options.progress(level.heights.shape, it.history[-1])
        step = None  # before the arrays of the next one are made
        step = _newton_step(level, inner, it, state, sets, energy, options.tolerance)


def _best_share(level: Level, it: Iterate, step: _Step, energy: float) -> float:
    """The share of the step at which the energy (after it) is least; 1 if rounding
    hides it.
    """
    moved = it.p.reshape(-1)[step.points.index] - step.before
    slope = float(np.sum(np.multiply(moved, step.gap, out=moved)))
    curvature = 2 * (energy - step.energy - slope)
    noise = _ENERGY_NOISE * level.heights.size * level.gap_scale
    if abs(slope) <= noise and abs(energy - step.energy) <= noise:
        return 1.0
    return min(1.0, max(0.0, -slope / curvature)) if curvature > 0 else float(slope < 0)


def _update_sets(level: Level, it: Iterate, state: StateArray) -> _Sets:
    """Overwrite `state` with the sets that the iterate calls for, and count them."""
    fields = level.split(it.p, it.u, level.heights, state)
    parts = level.workers.each(update_states, *fields, it.z, level.cap)
    changed, elastic, plastic, entering, unloading, worst = zip(*parts, strict=True)
    numbers = sum(changed), sum(elastic), sum(plastic), sum(entering), sum(unloading)
    return _Sets(*numbers, max(worst), list(elastic))


def _newton_step(
    level: Level,
    inner: InnerOperators,
    it: Iterate,
    state: StateArray,
    sets: _Sets,
    energy: float,
    tolerance: float,
) -> _Step | None:
    """Take one outer step; None if there is nothing to solve for."""
    ends = np.cumsum([0, *sets.elastic_by_block]).tolist()
    parts = [slice(*pair) for pair in itertools.pairwise(ends)]
    integers = np.int32 if level.heights.size < 2**31 else np.int64
    points = Points(np.empty(ends[-1], dtype=integers), parts)
    pressure, r = np.empty(ends[-1]), np.empty(ends[-1])  # and residual h - u - z
    lists = points.split(points.index, pressure, r)
    fields, first = (
        level.split(it.p, it.u, level.heights, state),
        [a.start for a in level.parts],
    )
    level.workers.each(collect, *fields, first, it.z, *lists)
    if r.size < 2:
        # A single point carries the rest of the load: only a gradient step can change
        # the sets.
        gradient_step(level, it, level.step)
        return None
    step = _Step(points, pressure, -r, energy)
    r -= r.mean()
    x = np.zeros(r.size)
    # The displacement is not needed until the step has been found, so its memory is.
    masked = MaskedGrid(points, it.u, level.workers)
    operator = inner.choose(sets.changed, masked, it.history[-1])
    exact = operator is level.convolution
    reduction = _LAST_REDUCTION if exact and not sets.changed else _REDUCTION
    floor = 0.3 * tolerance * level.gap_scale
    cells = Cells(level.convolution, points)
    precondition = inner.preconditioner(cells, masked)
    it.cg += conjugate_gradients(operator, precondition, points, r, x, reduction, floor)
    put(level, it.p, points, cells, pressure, x)
    level.convolution.apply(it.p, it.u)
    return step


@compiled
def update_states(
    p: Any, u: Any, h: Any, state: Any, z: float, cap: float
) -> tuple[int, int, int, int, int, float]:
    """Overwrite `state` with the sets to solve on, given the offset z; see `_Sets`.
    The elastic set holds the points between their bounds, and those on a bound where
    the gap g = u + z - h has the wrong sign.
    """
    changed = elastic = plastic = entering = unloading = 0
    worst = 0.0
    for i in range(p.size):
        g = u[i] + z - h[i]
        if p[i] <= 0.0:
            new = 1 if g < 0.0 else 0
            entering += new
            violation = -g
        elif p[i] >= cap:
            new = 1 if g > 0.0 else 2
            unloading += g > 0.0
            violation = g
        else:
            new = 1
            violation = abs(g)
        worst = max(worst, violation)
        elastic += new == 1
        plastic += new == 2
        if new != state[i]:
            state[i] = new
            changed += 1
    return changed, elastic, plastic, entering, unloading, worst


@compiled
def collect(  # noqa: PLR0913, PLR0917 - a compiled pass takes its arrays one by one
    p: Any,
    u: Any,
    h: Any,
    state: Any,
    first: int,
    z: float,
    index: Any,
    pressure: Any,
    residual: Any,
) -> None:
    """List index, pressure and h - u - z of the elastic points in a block from `first`
    on.
    """
    k = 0
    for i in range(p.size):
        if state[i] == 1:
            index[k] = first + i
            pressure[k] = p[i]
            residual[k] = h[i] - u[i] - z
            k += 1
