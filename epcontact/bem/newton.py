"""Semi-smooth Newton method on the sets apart, elastic and plastic.

Every iterate is feasible: it keeps its bounds and its mean.  One outer step, from a
pressure p:

1. Solve (S p)_F + z = h_F with the mean of p kept.  The elastic set F holds the points
   between their bounds, and those on a bound where the gap has the wrong sign.
   Conjugate gradients in the space of zero mean, preconditioned cell by cell, solve
   this problem, and no more accurately than the present sets deserve.
2. Move the result into the bounds, restore the force of each cell and the mean, and
   find the displacement of all points.

So a step costs one pair of transforms, and a cheap pair for each inner iteration.  The
full step is taken if it lowers the energy 1/2 <p, S p> - <p, h>; otherwise it is cut at
the minimum of the energy along it, and projected gradient steps follow.  The energy of
the iterates never rises.  This rules out the cycles of the plain method with a capped
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
    measure_iterate,
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
# The areas do not count as settled before the residual has fallen to this fraction of
# the first one: 24 of 81 scenes of 8 to 64 points a wavelength would stop with areas up
# to 3 % off.
_CALM = 0.2
# They do not count as settled either unless the tolerance is worth at least one point
# of the smallest area, or the residual is below this value, at which no point changes
# sets any more (largest error of 312 scenes: 4e-6).
_UNSEEN = 1e-5
# Differences of the energy below this fraction of (points x mean pressure x gap scale)
# are rounding.  Without this limit full steps near the end were cut, and 53 scenes took
# 17 % more pairs.
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
_REDUCTION = 0.1
_LAST_REDUCTION = 1e-3
# The inner iterations stop where no residual is above this fraction of the tolerance.
_FLOOR = 0.3


@dataclass(frozen=True)
class _Sets:
    """Numbers of points by set, and how far the conditions on the gap are violated.

    Attributes:
        changed: points whose set has changed.
        elastic, plastic: points of these sets.
        entering: points that come into contact.
        unloading: points that cease to be plastic.
        worst: largest violation of the conditions on the gap, in m.
        elastic_by_block: points of the elastic set in each block of rows.
    """

    changed: int
    elastic: int
    plastic: int
    entering: int
    unloading: int
    worst: float
    elastic_by_block: list[int]

    def areas_settled(self, tolerance: float, history: list[float]) -> bool:
        """Return True if the areas have settled to a relative change of `tolerance`.

        It is called after a full step.  history: largest dimensionless residual after
        each step, the last one included.

        The sets do not count while the residual is near the first one: with many points
        a wavelength, fronts move by less than a point while forces are out of balance.
        """
        residual = history[-1]
        contact = self.elastic + self.plastic
        few_changes = self.changed <= _CHANGES_PER_ERROR * tolerance * max(contact, 1)
        smallest = min(self.elastic or contact, self.plastic or contact)
        resolved = tolerance * smallest >= 1 or residual <= _UNSEEN
        calm = residual <= _CALM * history[0]
        changes = (
            self.entering / max(contact, 1),
            self.unloading / max(self.plastic, 1),
            (self.entering + self.unloading) / max(self.elastic, 1),
        )
        return few_changes and resolved and calm and max(changes) <= tolerance


@dataclass(frozen=True, eq=False)
class _Step:
    """A Newton step that was taken.

    Attributes:
        points: the elastic points, which the step changed.
        pressure: (points,) their pressures before the step.
        gap: (points,) their gaps before the step, in m.
        energy: that before the step.
    """

    points: Points
    pressure: FloatArray
    gap: FloatArray
    energy: float


def solve_level(level: Level, p: FloatArray, options: Options) -> Iterate:
    """Solve on one grid by the Newton method of this module.

    The iterate that is returned has met its goal if its `settled` is True; otherwise
    the steps allowed were not enough.

    level: the grid; p: (nx, ny) pressures to start from, in units of the mean pressure,
    from 0 to the cap and of mean 1, overwritten; options: tolerance, largest number of
    steps and the function that reports progress.
    """
    iterate = first_iterate(level, p)
    inner = InnerOperators(level.convolution)
    state = states(p, level.cap)
    cuts = 0  # steps cut of late: each cut adds one, each full step takes one away
    step: _Step | None = None
    while True:
        iterate.z, force, energy = measure_iterate(level, iterate.p, iterate.u)
        fraction = 1.0
        if step is not None:
            fraction = _best_fraction(level, iterate, step, energy)
        full = fraction >= _FULL_STEP
        if step is not None and not full:
            iterate.cut += 1
            cuts += 1
            _cut_step(level, iterate, step, fraction)
            gradient_steps = min(4 ** (cuts - 2), _GRADIENT_STEPS) if cuts > 1 else 0
        else:
            cuts = max(0, cuts - 1)
            gradient_steps = int(cuts == 0 and _is_slow(iterate.history))
        length = level.step
        for _ in range(gradient_steps):
            length = gradient_step(level, iterate, length)
        if gradient_steps or not full:
            iterate.z, force, energy = measure_iterate(level, iterate.p, iterate.u)
        sets = _update_sets(level, iterate, state)
        iterate.history.append(max(sets.worst / level.gap_scale, abs(force - 1)))
        iterate.settled = iterate.history[-1] <= options.tolerance
        if options.area_tolerance and full and step is not None:
            iterate.settled |= sets.areas_settled(
                options.area_tolerance, iterate.history
            )
        if iterate.settled or iterate.newton >= (options.max_steps or _MAX_STEPS):
            iterate.pairs = level.convolution.pairs + inner.pairs
            return iterate
        iterate.newton += 1
        if options.progress is not None:
            options.progress(level.heights.shape, iterate.history[-1])
        step = None  # frees its memory before the arrays of the next step are made
        step = _newton_step(
            level, inner, iterate, state, sets, energy, options.tolerance
        )


def _is_slow(history: list[float]) -> bool:
    """Return True if the residual has not halved within the last _SLOW steps.

    history: largest residual after each step.
    """
    return len(history) > _SLOW and history[-1] > 0.5 * history[-1 - _SLOW]


def _best_fraction(level: Level, iterate: Iterate, step: _Step, energy: float) -> float:
    """Return the fraction of the step, from 0 to 1, at which the energy is least.

    Along the step the energy is a parabola through its values before and after it, and
    its slope at the start is the sum of gap times change of pressure.  If rounding
    hides both, the fraction is 1.

    Args:
        level: the grid on which the problem is solved.
        iterate: the pressures after the full step.
        step: what was before it.
        energy: the energy after it, in units of `step.energy`.
    """
    moved = iterate.p.reshape(-1)[step.points.index] - step.pressure
    slope = float(np.sum(np.multiply(moved, step.gap, out=moved)))
    curvature = 2 * (energy - step.energy - slope)
    noise = _ENERGY_NOISE * level.heights.size * level.gap_scale
    if abs(slope) <= noise and abs(energy - step.energy) <= noise:
        return 1.0
    if curvature > 0:
        return min(1.0, max(0.0, -slope / curvature))
    return float(slope < 0)


def _cut_step(level: Level, iterate: Iterate, step: _Step, fraction: float) -> None:
    """Cut a step: go back to a fraction of it, from 0 to 1.

    level: the grid; iterate: the state after the complete step, whose pressure and
    displacement are changed in place; step: the pressures before it.
    """
    p = iterate.p.reshape(-1)
    index = step.points.index
    p[index] = step.pressure + fraction * (p[index] - step.pressure)
    level.convolution.apply(iterate.p, iterate.u)


def _update_sets(level: Level, iterate: Iterate, state: StateArray) -> _Sets:
    """Overwrite `state` with the sets for the next step; count the points in each.

    A set holds the points that are apart (0), elastic (1) or plastic (2).  Points on a
    bound where the gap has the wrong sign become elastic.

    level: the grid; iterate: pressures, displacements and offset of the flat; state:
    (nx, ny) the sets of the last step.
    """
    fields = level.split(iterate.p, iterate.u, level.heights, state)
    parts = level.workers.each(update_states, *fields, iterate.z, level.cap)
    changed, elastic, plastic, entering, unloading, worst = zip(*parts, strict=True)
    return _Sets(
        sum(changed),
        sum(elastic),
        sum(plastic),
        sum(entering),
        sum(unloading),
        max(worst),
        list(elastic),
    )


def _newton_step(
    level: Level,
    inner: InnerOperators,
    iterate: Iterate,
    state: StateArray,
    sets: _Sets,
    energy: float,
    tolerance: float,
) -> _Step | None:
    """Take one Newton step, and return what was before it.

    If only one point is elastic, a projected gradient step is taken instead, and None
    is returned.

    level: the grid; inner: operators of the linear problem; iterate: changed in place;
    state: (nx, ny) set of each point; sets: numbers of points in the sets; energy: that
    before the step, see `measure_iterate`; tolerance: of the residual, dimensionless.
    """
    ends = np.cumsum([0, *sets.elastic_by_block]).tolist()
    parts = [slice(*pair) for pair in itertools.pairwise(ends)]
    integers = np.int32 if level.heights.size < 2**31 else np.int64
    points = Points(np.empty(ends[-1], dtype=integers), parts)
    pressure = np.empty(ends[-1])
    r = np.empty(ends[-1])  # the residual h - u - z
    lists = points.split(points.index, pressure, r)
    fields = level.split(iterate.p, iterate.u, level.heights, state)
    first = [part.start for part in level.parts]
    level.workers.each(collect, *fields, first, iterate.z, *lists)
    if r.size < 2:
        # A single point carries the rest of the load: only a gradient step can change
        # the sets.
        gradient_step(level, iterate, level.step)
        return None
    step = _Step(points, pressure, -r, energy)
    r -= r.mean()
    x = np.zeros(r.size)
    # The displacement is not needed until the step has been found, but its memory is.
    masked = MaskedGrid(points, iterate.u, level.workers)
    operator = inner.choose(sets.changed, masked, iterate.history[-1])
    exact = operator is level.convolution
    reduction = _LAST_REDUCTION if exact and not sets.changed else _REDUCTION
    floor = _FLOOR * tolerance * level.gap_scale
    cells = Cells(level.convolution, points)
    precondition = inner.preconditioner(cells, masked)
    iterate.cg += conjugate_gradients(
        operator, precondition, points, r, x, reduction, floor
    )
    put(level, iterate.p, points, cells, pressure, x)
    level.convolution.apply(iterate.p, iterate.u)
    return step


@compiled
def update_states(
    p: Any, u: Any, h: Any, state: Any, z: float, cap: float
) -> tuple[int, int, int, int, int, float]:
    """Overwrite `state` with the sets on which the next step solves.

    The elastic set (1) holds the points between their bounds, and those on a bound
    where the gap g = u + z - h has the wrong sign; the others are apart (0) or plastic
    (2).

    p: (points,) pressures in units of the mean pressure; u: (points,) displacements in
    m; h: (points,) heights in m; state: (points,); z: height of the flat in m; cap:
    hardness in units of the mean pressure.

    Returns the numbers of points whose set has changed, of elastic points, of plastic
    points, of points that come into contact, and of points that cease to be plastic,
    and the largest violation of the conditions on the gap in m.
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
    """Write index, pressure and residual h - u - z of the elastic points of a block.

    p: (n,) pressures of the block; u: (n,) displacements in m; h: (n,) heights in m;
    state: (n,), 1 at the elastic points; first: flat index of the block's first point;
    z: height of the flat in m; index, pressure, residual: (elastic points,) arrays that
    are overwritten.
    """
    k = 0
    for i in range(p.size):
        if state[i] == 1:
            index[k] = first + i
            pressure[k] = p[i]
            residual[k] = h[i] - u[i] - z
            k += 1
