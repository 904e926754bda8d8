"""The increments of a load path, which a body that flows needs as it remembers its
strains.

Radial return takes an increment's strain for straight, an error of first order in the
increment: too few of them let the contact spread too far.  The state forgets the errors
of early increments as the contact grows, so that the last ones should be the shortest:
the loads on the way to P are

    P sqrt(k/n),  k = 1 ... n

and those that are above the largest load so far.  Below that one a single increment
suffices. tests/test_fem_solve.py measures both.  Increments that do not converge are
halved.
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


@dataclass(frozen=True)
class Rule:
    """How a path is followed, with options of `FemOptions`.

    highest: the height in m from which targets are approaches in m; None: they are
        forces in N.
    """

    highest: float | None
    steps: int
    tolerance: float


@dataclass(frozen=True)
class Along:
    """A place on the path.

    at: the force in N, or the approach in m.  farthest: the largest of these so far.  states: the
    last two.  solved: the last increment.  counts: iterations since the last point.  peak: the
    largest force so far, in N.
    """

    history: History
    at: float = 0.0
    farthest: float = 0.0
    states: tuple[State, ...] = ()
    solved: SolvedIncrement | None = None
    counts: Counts = field(default_factory=Counts)
    peak: float = 0.0


def advance(problem: Problem, along: Along, target: float, rule: Rule) -> Along:
    """Advance to the `target`, for which the counts are.  Raises NotConverged after
    halvings.
    """
    along = replace(along, counts=Counts())
    for end in _ends(target, along.farthest, rule.steps if problem.plastic else 1):
        step = end
        while along.at != end:
            try:
                solved = _solved(problem, along, step, rule)
                along, step = _kept(problem, along, solved, step), end
            except NotConverged as failure:
                along, step = _once_more_halved(along, failure), (along.at + step) / 2
    return along


def _ends(target: float, farthest: float, count: int) -> list[float]:
    """Where the increments to a target end, the last one at the target itself."""
    ends = [target * math.sqrt(k / count) for k in range(1, count)]
    return [end for end in ends if end > farthest] + [target]


def _once_more_halved(along: Along, failure: NotConverged) -> Along:
    """The place with one more halving in its counts; raises the failure if there were
    too many.
    """
    counts = along.counts + Counts(halvings=1)
    if counts.halvings > MOST_HALVINGS:
        raise failure
    return replace(along, counts=counts)


def _kept(problem: Problem, along: Along, solved: SolvedIncrement, at: float) -> Along:
    """The place after a solved increment, which is committed to the history."""
    history = along.history
    if problem.plastic:
        u = problem.turned(solved.state.displacement).reshape(-1, 3)
        history = plasticity.commit(
            u, problem.bricks, problem.law, history, solved.flowing
        )
    return replace(
        along,
        history=history,
        at=at,
        farthest=max(along.farthest, at),
        states=(*along.states[-1:], solved.state),
        solved=solved,
        counts=along.counts + solved.counts,
        peak=max(along.peak, float(solved.state.forces.sum())),
    )


def _solved(problem: Problem, along: Along, end: float, rule: Rule) -> SolvedIncrement:
    """Solve the increment to `end` from a guess."""
    if rule.highest is not None:
        control = Control(approach=end - rule.highest, scale=along.peak)
    elif end == 0:
        return _touching(problem, along, rule.tolerance)
    else:
        control = Control(load=end, scale=max(end, along.peak))
    # No name is given to the guess, so that it does not stay in memory.
    return solve_increment(
        problem,
        _guess(problem, along.states, control),
        along.history,
        control,
        rule.tolerance,
    )


def _touching(problem: Problem, along: Along, tolerance: float) -> SolvedIncrement:
    """The body without a load, whose highest point just touches the flat."""
    last = along.states[-1]
    reach = float(np.ptp(problem.heights)) + 4 * float(
        np.abs(last.displacement[0]).max()
    )
    away = Control(approach=last.approach - 2 * reach, scale=along.peak)
    apart = np.full_like(last.states, APART)
    start = State(last.displacement, away.approach, apart, 0 * last.forces)
    solved = solve_increment(problem, start, along.history, away, tolerance)
    free = float(problem.gap(solved.state.displacement, 0.0).min())
    return replace(solved, state=replace(solved.state, approach=free))


def _elastic_state(problem: Problem, control: Control) -> State:
    """The contact of the flat elastic block."""
    factor, heights = problem.factor, problem.heights
    solved = rigid_contact(
        factor.surface, heights, control.load, control.approach, problem.cap
    )
    spectrum = eliminate(factor, np.zeros(problem.block.field_shape))
    u = substitute(factor, spectrum, solved.forces)
    return State(u, solved.approach, solved.states, solved.forces)


def _guess(problem: Problem, states: tuple[State, ...], control: Control) -> State:
    """The first guess of a state: that of the flat elastic block at the path's begin
    and, as they have no memory, under capped forces; else on the secant through the
    last two states or, as in unloading and after an increment much longer than the
    last, the last one.
    """
    if not states or problem.capped:
        return _elastic_state(problem, control)
    state, load = states[-1], control.load
    if load is None:
        return state
    forces = float(state.forces.sum())
    # Before the first state there is no force and no contact.
    none = replace(
        state, states=np.full_like(state.states, APART), forces=0 * state.forces
    )
    earlier = states[-2] if len(states) > 1 else none
    grown = forces - float(earlier.forces.sum())
    ratio = (load - forces) / grown if grown > 0 else 0.0
    if 0 < ratio <= 2.01:
        return _on_secant(problem, state, earlier, -ratio)
    if forces > 0:
        return state
    # The unloaded body is loaded from a quarter of its nodes in contact.
    apart, wanted = (
        np.zeros(state.states.shape, dtype=bool),
        max(1, state.states.size // 4),
    )
    seeded = _nearest(problem, state.displacement, state.approach, apart, wanted)
    return replace(state, states=seeded)


def _on_secant(problem: Problem, state: State, other: State, share: float) -> State:
    """The state at a `share` of the way from one state to another, or beyond; the
    contact area is interpolated, too, and filled with the nodes nearest to the flat.
    """
    u = state.displacement + share * (other.displacement - state.displacement)
    d = state.approach + share * (other.approach - state.approach)
    contact = state.states == ELASTIC
    count, other_count = int(contact.sum()), int((other.states == ELASTIC).sum())
    contact &= state.forces + share * (other.forces - state.forces) > 0
    wanted = max(round(count + share * (other_count - count)), int(contact.sum()))
    return State(u, d, _nearest(problem, u, d, contact, wanted), state.forces)


def _nearest(
    problem: Problem,
    u: FloatArray,
    approach: float,
    contact: NDArray[np.bool_],
    wanted: int,
) -> States:
    """The `contact` and the nodes nearest to the flat, so many as are `wanted` in
    all.
    """
    order = np.where(contact, -np.inf, problem.gap(u, approach))
    touching = np.full(contact.shape, APART, dtype=np.int8)
    touching.ravel()[np.argsort(order, axis=None, kind="stable")[:wanted]] = ELASTIC
    return touching
