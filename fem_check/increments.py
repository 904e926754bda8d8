"""The increments of a load path.

A body that flows remembers its strains, and radial return assumes that the strain grows
straight during an increment.  This error is of first order in the increment: with too
few increments the contact spreads too far.  As the contact grows the state forgets the
errors of early increments, so that the last increments should be the shortest.  The
loads on the way to P are

    P sqrt(k/n),  k = 1 ... n,

those of them that exceed the largest load so far.  Below that load one increment
suffices.  tests/test_fem_solve.py measures both.  Increments that do not converge are
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
from fem_check.free_flow import require_equilibrium
from fem_check.linear_solver import eliminate, substitute
from fem_check.newton import SolvedIncrement, solve_increment
from fem_check.plasticity import History
from fem_check.problem import Control, Counts, Problem, State

#: Times that an increment is halved at most.
MAX_HALVINGS = 6
#: Longest step of the secant predictor, relative to the last increment.
MAX_SECANT = 2.01


@dataclass(frozen=True)
class Stepping:
    """How a load path is divided into increments.

    Attributes:
        first_touch: largest height in m, from which targets are approaches in m; None:
            targets are forces in N.
        steps: number of increments n to a target beyond all earlier ones.
        tolerance: on the residuals of an increment.
    """

    first_touch: float | None
    steps: int
    tolerance: float


@dataclass(frozen=True)
class PathProgress:
    """The position on a load path, and what the solver knows there.

    Attributes:
        history: of the elements.
        before: history before the last increment, from which it is checked.
        position: force in N, or approach in m.
        farthest: largest position so far.
        states: the last one or two converged states.
        solved: the last increment; None: at the begin of the path.
        counts: iterations since the last target.
        peak: largest force so far, in N.
    """

    history: History
    before: History
    position: float = 0.0
    farthest: float = 0.0
    states: tuple[State, ...] = ()
    solved: SolvedIncrement | None = None
    counts: Counts = field(default_factory=Counts)
    peak: float = 0.0


def advance(
    problem: Problem, progress: PathProgress, target: float, stepping: Stepping
) -> PathProgress:
    """Solve the increments from the present position on the load path to a target.

    An increment that does not converge is halved.

    Args:
        problem: the finite-element problem.
        progress: present position on the path.
        target: total force in N, or approach in m.
        stepping: number of increments, kind of target, and tolerance.

    Returns:
        The position at the target, with the iterations that were needed.

    Raises:
        FlowsFreely: the body has no equilibrium at the end of an increment.
        NotConverged: the increments to the target were halved more than `MAX_HALVINGS`
            (6) times.
    """
    progress = replace(progress, counts=Counts())
    steps = 1
    if problem.plastic:
        steps = stepping.steps
    for end in _increment_ends(target, progress.farthest, steps):
        trial_end = end
        # A body that saturates may have no equilibrium under a larger load.
        grows = stepping.first_touch is None and end > progress.position
        may_flow = grows and problem.may_flow_freely
        while progress.position != end:
            try:
                solved = _solve_to(
                    problem, progress, trial_end, stepping, patient=not may_flow
                )
                progress = _commit(problem, progress, solved, trial_end)
                trial_end = end
            except NotConverged:
                if may_flow:
                    _require_equilibrium(problem, progress, end)
                    may_flow = False
                    continue  # solve the same increment again, with patience
                counts = progress.counts + Counts(halvings=1)
                if counts.halvings > MAX_HALVINGS:
                    raise
                progress = replace(progress, counts=counts)
                trial_end = (progress.position + trial_end) / 2
    return progress


def _increment_ends(target: float, farthest: float, count: int) -> list[float]:
    """Return the ends of the increments to a target, the last one at the target.

    They are target sqrt(k/count) for k = 1 ... count, without those that do not exceed
    `farthest`.

    Args:
        target: total force in N, or approach in m.
        farthest: largest position so far, in the same unit.
        count: number of increments n; 1 gives the target alone.
    """
    ends = [target * math.sqrt(k / count) for k in range(1, count)]
    return [end for end in ends if end > farthest] + [target]


def _commit(
    problem: Problem, progress: PathProgress, solved: SolvedIncrement, position: float
) -> PathProgress:
    """Return the load path's progress after a solved increment.

    The plastic strains of the increment are added to the elements' history.

    Args:
        problem: the finite-element problem.
        progress: position on the path before the increment; it is not changed.
        solved: the converged increment.
        position: end of the increment, a force in N or an approach in m.
    """
    history = progress.history
    if problem.plastic:
        u = problem.physical_displacement(solved.state.displacement).reshape(-1, 3)
        history = plasticity.commit(
            u, problem.bricks, problem.law, history, solved.flowing
        )
    return replace(
        progress,
        history=history,
        before=progress.history,
        position=position,
        farthest=max(progress.farthest, position),
        states=(*progress.states[-1:], solved.state),
        solved=solved,
        counts=progress.counts + solved.counts,
        peak=max(progress.peak, float(solved.state.forces.sum())),
    )


def _require_equilibrium(problem: Problem, progress: PathProgress, load: float) -> None:
    """Raise FlowsFreely if a J2 body flows freely below a load.

    Args:
        problem: the finite-element problem.
        progress: position on the path, at a smaller load.  Without a state there, the
            flat is pressed on from the elastic contact whose mean pressure is the
            yield stress.
        load: total force, in N.
    """
    if progress.states:
        state = progress.states[-1]
    else:
        contact = _elastic_state(problem, Control(load=load)).states != APART
        contact_area = int(contact.sum()) * problem.block.node_area
        yielding = min(load, problem.law.yield_stress * contact_area)
        state = _elastic_state(problem, Control(load=yielding))
    require_equilibrium(problem, state, progress.history, load)


def _solve_to(
    problem: Problem,
    progress: PathProgress,
    end: float,
    stepping: Stepping,
    patient: bool,
) -> SolvedIncrement:
    """Solve one increment of the load path from a first guess.

    Args:
        problem: the finite-element problem.
        progress: position on the path before the increment.
        end: force in N, or approach in m since the first touch if the stepping has one;
            the force 0 removes the load.
        stepping: kind of target, and tolerance on the residuals.
        patient: whether Newton's method goes on if the residual stagnates.

    Raises:
        NotConverged: Newton's method did not reach the tolerance.
    """
    if stepping.first_touch is not None:
        control = Control(approach=end - stepping.first_touch, scale=progress.peak)
    elif end == 0:
        return _unload_fully(problem, progress, stepping.tolerance)
    else:
        control = Control(load=end, scale=max(end, progress.peak))
    # The guess has no name, so that it does not stay in memory.
    return solve_increment(
        problem,
        _first_guess(problem, progress.states, control),
        progress.history,
        control,
        stepping.tolerance,
        patient,
    )


def _unload_fully(
    problem: Problem, progress: PathProgress, tolerance: float
) -> SolvedIncrement:
    """Solve for the body without a load, whose highest point just touches the flat.

    The flat is first moved so far away that no node touches it.

    Args:
        problem: the finite-element problem.
        progress: position on the path before the increment, with at least one state.
        tolerance: on the dimensionless residuals.

    Raises:
        NotConverged: Newton's method did not reach the tolerance.
    """
    last = progress.states[-1]
    motion = float(np.abs(last.displacement[0]).max())
    reach = float(np.ptp(problem.heights)) + 4 * motion
    control = Control(approach=last.approach - 2 * reach, scale=progress.peak)
    apart = np.full_like(last.states, APART)
    start = State(last.displacement, control.approach, apart, 0 * last.forces)
    solved = solve_increment(problem, start, progress.history, control, tolerance)
    touch = float(problem.gap(solved.state.displacement, 0.0).min())
    return replace(solved, state=replace(solved.state, approach=touch))


def _elastic_state(problem: Problem, control: Control) -> State:
    """Return the state of the flat elastic block in contact, without plastic flow.

    Args:
        problem: the finite-element problem, with the roughness as gap and with its cap.
        control: prescribed load in N or approach in m.

    Raises:
        NotConverged: the contact sets do not stop changing.
    """
    factor = problem.factor
    solved = rigid_contact(
        factor.surface, problem.heights, control.load, control.approach, problem.cap
    )
    spectrum = eliminate(factor, np.zeros(problem.block.field_shape))
    u = substitute(factor, spectrum, solved.forces)
    return State(u, solved.approach, solved.states, solved.forces)


def _first_guess(
    problem: Problem, states: tuple[State, ...], control: Control
) -> State:
    """Return the first guess of an increment from the last converged states.

    It is the contact of the flat elastic block at the begin of the path, and under
    capped forces, which have no memory.  Otherwise it is on the secant through the last
    two states.  In unloading, in approach control, and for an increment much longer
    than the last one, it is the last state.

    Args:
        problem: the finite-element problem.
        states: the last one or two converged states; empty at the begin of the path.
        control: load in N or approach in m that the increment prescribes.
    """
    if not states or problem.capped:
        return _elastic_state(problem, control)
    last = states[-1]
    if control.load is None:
        return last
    if len(states) > 1:
        earlier = states[-2]
    else:
        # Before the first state there was no force and no contact.
        apart = np.full_like(last.states, APART)
        earlier = replace(last, states=apart, forces=0 * last.forces)
    force = float(last.forces.sum())
    growth = force - float(earlier.forces.sum())
    ratio = 0.0
    if growth > 0:
        ratio = (control.load - force) / growth
    if 0 < ratio <= MAX_SECANT:
        return _interpolate(problem, last, earlier, -ratio)
    if force > 0:
        return last
    # The unloaded body is loaded from a quarter of its nodes in contact.
    contact = np.zeros(last.states.shape, dtype=bool)
    count = max(1, last.states.size // 4)
    return replace(
        last,
        states=_nearest_in_contact(
            problem, last.displacement, last.approach, contact, count
        ),
    )


def _interpolate(
    problem: Problem, state: State, other: State, fraction: float
) -> State:
    """Return a state on the line through two states.

    Displacement, approach and number of contact nodes are interpolated.  The nodes
    nearest to the flat are added to those that stay in contact.  The forces are those
    of `state`.

    Args:
        problem: the finite-element problem.
        state: the state at the fraction 0.
        other: the state at the fraction 1.
        fraction: position on the line; a negative fraction extrapolates beyond `state`.
    """
    u = state.displacement + fraction * (other.displacement - state.displacement)
    approach = state.approach + fraction * (other.approach - state.approach)
    forces = state.forces + fraction * (other.forces - state.forces)
    contact = state.states == ELASTIC
    size = int(contact.sum())
    other_size = int((other.states == ELASTIC).sum())
    contact &= forces > 0
    count = max(round(size + fraction * (other_size - size)), int(contact.sum()))
    states = _nearest_in_contact(problem, u, approach, contact, count)
    return State(u, approach, states, state.forces)


def _nearest_in_contact(
    problem: Problem,
    u: FloatArray,
    approach: float,
    contact: NDArray[np.bool_],
    count: int,
) -> States:
    """Return contact states in which the nodes nearest to the flat are in contact.

    Args:
        problem: the finite-element problem.
        u: (levels, nx, ny, 3) displacements, in m.
        approach: d of the flat, in m.
        contact: (nx, ny) True for nodes that count as the nearest of all.
        count: number of nodes in contact.

    Returns:
        (nx, ny) states: ELASTIC for `count` nodes, APART elsewhere.
    """
    distance = np.where(contact, -np.inf, problem.gap(u, approach))
    nearest = np.argsort(distance, axis=None, kind="stable")[:count]
    states = np.full(contact.shape, APART, dtype=np.int8)
    states.ravel()[nearest] = ELASTIC
    return states
