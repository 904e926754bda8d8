"""Along the load path: increments, halved where they do not converge, history committed where
they do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from epcontact.errors import InvalidScene, NotConverged
from epcontact.results import APART, ELASTIC, PLASTIC
from epcontact.scene import Scene
from fem_check import plasticity
from fem_check.contact import States, rigid_contact
from fem_check.linear_solver import eliminate, substitute
from fem_check.newton import Options, solve_step
from fem_check.plasticity import History
from fem_check.problem import Control, Counts, Problem, State
from fem_check.report import yielded_surface


@dataclass(frozen=True)
class Reached:
    """A converged point of the path.  The whole displacement is kept of the last point alone.

    surface_states: (nx, ny) APART, ELASTIC or PLASTIC in the sense of `report`.
    measures: of the plastic zone, by name.
    """

    mean_pressure: float
    state: State
    counts: Counts
    residuals: dict[str, float]
    surface_states: States
    measures: dict[str, float]


def point_of_path(
    problem: Problem,
    pressure: float,
    state: State,
    history: History,
    counts: Counts,
    found: dict[str, float],
) -> Reached:
    """What is kept of a converged state: surface states and the measures of the plastic zone."""
    states, measures = state.states, {}
    if problem.plastic:
        surface = yielded_surface(problem, history.accumulated)
        states = np.where((states != APART) & surface, PLASTIC, states).astype(np.int8)
        accumulated = history.accumulated.reshape(len(problem.block.layers), -1)
        flowed = accumulated.max(axis=1) > 0
        last = int(np.flatnonzero(flowed).max(initial=-1))
        measures = {
            "largest_plastic_strain": float(accumulated.max()),
            "plastic_volume": _plastic_volume(problem, history),
            "plastic_depth": -float(problem.block.levels[last + 1]),
        }
    return Reached(pressure, state, counts, found, states, measures)


def _plastic_volume(problem: Problem, history: History) -> float:
    """The share of the body that has flowed."""
    weights = problem.bricks.weights[problem.bricks.shape_of]
    return float(weights[history.accumulated > 0].sum() / weights.sum())


def targets_of(
    scene: Scene, problem: Problem, approach: float | Sequence[float] | None
) -> tuple[float, ...]:
    """The path: total forces in N, or approaches from the reference level in m."""
    if approach is None:
        area = problem.block.node_area * problem.heights.size
        return tuple(p * area for p in scene.load.path)
    given = (approach,) if isinstance(approach, int | float) else tuple(approach)
    if not given or not all(math.isfinite(a) and a > 0 for a in given):
        raise InvalidScene(f"approach is {approach!r}, but must be positive lengths in m")
    return given


def increments_of(targets: tuple[float, ...], steps: int | None) -> list[tuple[list[float], float]]:
    """For each point of the path the values on the way to it, the point last."""
    largest, before, out = max(targets), 0.0, []
    for target in targets:
        count = 1
        if steps is not None:
            count = max(1, math.ceil(abs(target - before) / largest * steps - 1e-9))
        way = [before + (target - before) * (i + 1) / count for i in range(count)]
        out.append((way, target))
        before = target
    return out


def _control(problem: Problem, target: float, by_approach: bool) -> Control:
    if by_approach:
        return Control(approach=target - float(problem.heights.max()))
    return Control(load=target, scale=target)


def _predicted(problem: Problem, states: tuple[State, ...], load: float) -> State:
    """Where the step to `load` starts: on the secant through the last two states.

    The contact area grows about in proportion to the load, so it is extrapolated, too, and filled
    by the nodes nearest to the flat.  Unloading, a step much longer than the last, and capped
    forces do not follow the secant: such steps start from the last state.
    """
    state = states[-1]
    forces, count = float(state.forces.sum()), int((state.states == ELASTIC).sum())
    # Before the first state: no force on no area.
    earlier = states[-2] if len(states) > 1 else None
    grown = forces - (0.0 if earlier is None else float(earlier.forces.sum()))
    ratio = (load - forces) / grown if grown > 0 else 0.0
    if not 0 < ratio <= 1.5 or np.isfinite(problem.cap):
        return state
    u, d, contact = state.displacement, state.approach, state.states == ELASTIC
    if earlier is not None:
        u = u + ratio * (u - earlier.displacement)
        d += ratio * (d - earlier.approach)
        contact &= state.forces + ratio * (state.forces - earlier.forces) > 0
        count_before = int((earlier.states == ELASTIC).sum())
    else:
        count_before = 0
    wanted = max(round(count + ratio * (count - count_before)), int(contact.sum()))
    order = np.where(contact, -np.inf, -u[0, ..., 2] - problem.heights - d)
    touching = np.full(contact.shape, APART, dtype=np.int8)
    touching.ravel()[np.argsort(order, axis=None, kind="stable")[:wanted]] = ELASTIC
    return State(u, d, touching, state.forces)


def march(
    problem: Problem,
    states: tuple[State, ...],
    history: History,
    target: float,
    by_approach: bool,
    tolerance: float,
) -> tuple[tuple[State, ...], Counts, dict[str, float], int]:
    """Goes on from the last of `states` to `target` in one increment, or in halves where that
    does not converge; commits the history after each that does.  Returns the last two states,
    the counts, the residuals, and how often the increment was halved."""
    state = states[-1] if states else None
    before, goal, halvings, total = _position(problem, state, by_approach), target, 0, Counts()
    while True:
        control = _control(problem, goal, by_approach)
        try:
            if state is None:
                begun = _elastic_state(problem, control)
            else:
                begun = state if by_approach else _predicted(problem, states, goal)
            state_, counts, found = solve_step(problem, begun, history, control, Options(tolerance))
        except NotConverged:
            halvings += 1
            if halvings > 6:
                raise
            goal = (before + goal) / 2
            continue
        state, total = state_, added(total, counts)
        states = (*states[-1:], state)
        if problem.plastic:
            plasticity.commit(
                state.displacement.reshape(-1, 3), problem.bricks, problem.law, history
            )
        if goal == target:
            return states, total, found, halvings
        before, goal = goal, target


def _position(problem: Problem, state: State | None, by_approach: bool) -> float:
    """Where the path stands: the total force, or the approach after the first touch."""
    if state is None:
        return 0.0
    if by_approach:
        return state.approach + float(problem.heights.max())
    return float(state.forces.sum())


def added(first: Counts, second: Counts) -> Counts:
    """The counts of two stretches of a path, the second after the first."""
    return Counts(
        newton=first.newton + second.newton,
        cg=first.cg + second.cg,
        sweeps=first.sweeps + second.sweeps,
        cuts=first.cuts + second.cuts,
        largest_cg=max(first.largest_cg, second.largest_cg),
        largest_newton=max(first.largest_newton, second.newton),
        increments=first.increments + second.increments,
        history=second.history,
    )


def _elastic_state(problem: Problem, control: Control) -> State:
    """The flat elastic block's own contact: where every path starts."""
    solved = rigid_contact(
        problem.factor.surface,
        problem.heights,
        load=control.load,
        approach=control.approach,
        cap=problem.cap,
    )
    spectrum = eliminate(problem.factor, np.zeros(problem.block.field_shape))
    u = substitute(problem.factor, spectrum, solved.forces)
    return State(u, solved.approach, solved.states, solved.forces)
