"""The increments of a load path: equal ones, or as long as an estimate of their error allows.

Radial return takes an increment's strain for straight, an error of first order in the increment:
too few of them let the contact spread too far.  `advance` measures it by pairs of increments,

    whole           one increment over the pair's length, which is not kept
    half, second    two increments of half the length
    error           sum over the nodes of |force after second - force after whole|, over the
                    path's largest force

and keeps the pair if its error is within the step tolerance; otherwise it keeps the first half, and
goes on with pairs of half the length.  The whole increment costs little, because the second one
starts from its solution.  The errors are not added up: the state forgets them as the contact grows
(tests/test_fem_solve.py).  Increments that do not converge are halved, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import NotConverged
from epcontact.results import APART, ELASTIC, FloatArray
from fem_check import plasticity
from fem_check.contact import States, rigid_contact
from fem_check.linear_solver import eliminate, substitute
from fem_check.newton import SolvedIncrement, solve_increment
from fem_check.plasticity import History
from fem_check.problem import Control, Counts, Problem, State

#: An increment that does not converge is halved at most this often.
MOST_HALVINGS = 6
#: The shortest pair of increments over the largest load; it is kept whatever its error is.
SHORTEST = 1 / 256
#: Tolerance of the increments over whole pairs: they only tell errors of a per cent.
ROUGH = 1e-4


@dataclass(frozen=True)
class Rule:
    """The rule for a path to targets of at most `largest`, with options of `FemOptions`.

    highest: the height in m from which targets are approaches in m; None: they are forces in N.
    """

    largest: float
    highest: float | None
    steps: int | None
    step_tolerance: float
    tolerance: float


@dataclass(frozen=True)
class Along:
    """A place on the path.

    at: the force in N, or the approach in m.  states: the last two.  solved: the last increment.
    counts: iterations since the last point.  peak: the largest force so far, in N.  step_error: the
    largest error of a pair of increments so far.  pair: the length of the next one, in N or m.
    """

    history: History
    at: float = 0.0
    states: tuple[State, ...] = ()
    solved: SolvedIncrement | None = None
    counts: Counts = field(default_factory=Counts)
    peak: float = 0.0
    step_error: float = 0.0
    pair: float = np.inf


def advance(problem: Problem, along: Along, target: float, rule: Rule) -> Along:
    """Advance to the `target`, for which the counts are.  Raises NotConverged after halvings."""
    along = replace(along, counts=Counts())
    if problem.plastic and rule.steps is None:
        along, whole = replace(along, pair=min(along.pair, rule.largest / 2)), None
        while along.at != target:
            along, whole = _pair(problem, along, target, rule, whole)
        return along
    begin, count = along.at, 1
    if rule.steps is not None:
        count = max(1, math.ceil(abs(target - begin) / rule.largest * rule.steps - 1e-9))
    for i in range(count):
        end = target if i == count - 1 else begin + (target - begin) * (i + 1) / count
        step = end
        while along.at != end:
            try:
                solved = _solved(problem, along, step, rule)
                along, step = _kept(problem, along, solved, step), end
            except NotConverged as failure:
                along, step = _once_more_halved(along, failure), (along.at + step) / 2
    return along


def _pair(
    problem: Problem, along: Along, target: float, rule: Rule, whole: SolvedIncrement | None
) -> tuple[Along, SolvedIncrement | None]:
    """The place after as much of a pair of increments towards the target as is good enough, and
    the next `whole`, the increment over a pair, where it is known."""
    left = target - along.at
    length = left if abs(left) <= 1.001 * along.pair else math.copysign(along.pair, left)
    end, middle = target if length == left else along.at + length, along.at + length / 2
    shorter, before = abs(length) / 2, along
    try:
        if whole is None:
            rough = replace(rule, tolerance=max(rule.tolerance, ROUGH))
            whole = _solved(problem, along, end, rough)
            along = before = replace(along, counts=along.counts + whole.counts)
        known = along.states and middle != 0
        between = _on_secant(problem, along.states[-1], whole.state, 0.5) if known else None
        half = _solved(problem, along, middle, rule, between)
        along = _kept(problem, along, half, middle)
        second = _solved(problem, along, end, rule, whole.state)
    except NotConverged as failure:
        return replace(_once_more_halved(along, failure), pair=shorter), None
    peak = max(along.peak, float(second.state.forces.sum()))
    moved = float(np.abs(second.state.forces - whole.state.forces).sum())
    error = moved / peak if peak else 0.0
    if error > rule.step_tolerance and abs(length) > SHORTEST * rule.largest:
        # The error of an increment falls with the square of its length: that of the first half is a
        # quarter of the pair's.
        along = replace(along, counts=along.counts + second.counts, pair=shorter)
        if error > 4 * rule.step_tolerance and not before.states:
            # Nothing precedes the path's first pair, so that it can be taken back.
            return replace(before, counts=along.counts, pair=shorter), half
        return replace(along, step_error=max(along.step_error, error / 4)), second
    along = _kept(problem, along, second, end)
    pair = 2 * along.pair if error < rule.step_tolerance / 4 else along.pair
    return replace(along, pair=pair, step_error=max(along.step_error, error)), None


def _once_more_halved(along: Along, failure: NotConverged) -> Along:
    """The place with one more halving in its counts; raises the failure if there were too many."""
    counts = along.counts + Counts(halvings=1)
    if counts.halvings > MOST_HALVINGS:
        raise failure
    return replace(along, counts=counts)


def _kept(problem: Problem, along: Along, solved: SolvedIncrement, at: float) -> Along:
    """The place after a solved increment, which is committed to the history."""
    history = along.history
    if problem.plastic:
        u = problem.turned(solved.state.displacement).reshape(-1, 3)
        history = plasticity.commit(u, problem.bricks, problem.law, history, solved.flowing)
    return replace(
        along,
        history=history,
        at=at,
        states=(*along.states[-1:], solved.state),
        solved=solved,
        counts=along.counts + solved.counts,
        peak=max(along.peak, float(solved.state.forces.sum())),
    )


def _solved(
    problem: Problem, along: Along, end: float, rule: Rule, guess: State | None = None
) -> SolvedIncrement:
    """Solve the increment to `end` from a guess, by default by extrapolation."""
    if rule.highest is not None:
        control = Control(approach=end - rule.highest, scale=along.peak)
    elif end == 0:
        return _touching(problem, along, rule.tolerance)
    else:
        control = Control(load=end, scale=max(end, along.peak))
    # No name is given to the guess, so that it does not stay in memory.
    return solve_increment(
        problem,
        guess or _guess(problem, along.states, control),
        along.history,
        control,
        rule.tolerance,
    )


def _touching(problem: Problem, along: Along, tolerance: float) -> SolvedIncrement:
    """The body without a load, whose highest point just touches the flat."""
    last = along.states[-1]
    reach = float(np.ptp(problem.heights)) + 4 * float(np.abs(last.displacement[0]).max())
    away = Control(approach=last.approach - 2 * reach, scale=along.peak)
    apart = np.full_like(last.states, APART)
    start = State(last.displacement, away.approach, apart, 0 * last.forces)
    solved = solve_increment(problem, start, along.history, away, tolerance)
    free = float(problem.gap(solved.state.displacement, 0.0).min())
    return replace(solved, state=replace(solved.state, approach=free))


def _elastic_state(problem: Problem, control: Control) -> State:
    """The contact of the flat elastic block."""
    factor, heights = problem.factor, problem.heights
    solved = rigid_contact(factor.surface, heights, control.load, control.approach, problem.cap)
    spectrum = eliminate(factor, np.zeros(problem.block.field_shape))
    u = substitute(factor, spectrum, solved.forces)
    return State(u, solved.approach, solved.states, solved.forces)


def _guess(problem: Problem, states: tuple[State, ...], control: Control) -> State:
    """The first guess of a state: that of the flat elastic block at the path's begin and, as they
    have no memory, under capped forces; else on the secant through the last two states or, as in
    unloading and after an increment much longer than the last, the last one."""
    if not states or problem.capped:
        return _elastic_state(problem, control)
    state, load = states[-1], control.load
    if load is None:
        return state
    forces = float(state.forces.sum())
    # Before the first state there is no force and no contact.
    none = replace(state, states=np.full_like(state.states, APART), forces=0 * state.forces)
    earlier = states[-2] if len(states) > 1 else none
    grown = forces - float(earlier.forces.sum())
    ratio = (load - forces) / grown if grown > 0 else 0.0
    if 0 < ratio <= 2.01:
        return _on_secant(problem, state, earlier, -ratio)
    if forces > 0:
        return state
    # The unloaded body is loaded from a quarter of its nodes in contact.
    apart, wanted = np.zeros(state.states.shape, dtype=bool), max(1, state.states.size // 4)
    seeded = _nearest(problem, state.displacement, state.approach, apart, wanted)
    return replace(state, states=seeded)


def _on_secant(problem: Problem, state: State, other: State, share: float) -> State:
    """The state at a `share` of the way from one state to another, or beyond; the contact area is
    interpolated, too, and filled with the nodes nearest to the flat."""
    u = state.displacement + share * (other.displacement - state.displacement)
    d = state.approach + share * (other.approach - state.approach)
    contact = state.states == ELASTIC
    count, other_count = int(contact.sum()), int((other.states == ELASTIC).sum())
    contact &= state.forces + share * (other.forces - state.forces) > 0
    wanted = max(round(count + share * (other_count - count)), int(contact.sum()))
    return State(u, d, _nearest(problem, u, d, contact, wanted), state.forces)


def _nearest(
    problem: Problem, u: FloatArray, approach: float, contact: NDArray[np.bool_], wanted: int
) -> States:
    """The `contact` and the nodes nearest to the flat, so many as are `wanted` in all."""
    order = np.where(contact, -np.inf, problem.gap(u, approach))
    touching = np.full(contact.shape, APART, dtype=np.int8)
    touching.ravel()[np.argsort(order, axis=None, kind="stable")[:wanted]] = ELASTIC
    return touching
