"""The load path: increments, halved where they do not converge, and the history between them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidScene, NotConverged
from epcontact.results import APART, ELASTIC, PLASTIC, FloatArray
from epcontact.scene import Scene
from fem_check import plasticity
from fem_check.contact import States, rigid_contact
from fem_check.linear_solver import eliminate, substitute
from fem_check.newton import NewtonOptions, SolvedIncrement, solve_increment
from fem_check.plasticity import History
from fem_check.problem import Control, Counts, Problem, State

#: An increment that does not converge is halved at most this often.
MOST_HALVINGS = 6


@dataclass(frozen=True)
class PathPoint:
    """A converged point of the path.

    mean_pressure: in Pa.
    state: the finite-element state.
    counts: iterations since the point before.
    residuals: of the state, by name.
    history: the largest residual after each Newton iteration of the last increment.
    surface_states: (nx, ny) APART, ELASTIC or PLASTIC in the sense of `result`.
    plastic_zone: measures of the plastic zone, by name; empty for an elastic material.
    """

    mean_pressure: float
    state: State
    counts: Counts
    residuals: dict[str, float]
    history: tuple[float, ...]
    surface_states: States
    plastic_zone: dict[str, float]


@dataclass(frozen=True)
class SolvedPath:
    """A solved load path: what `solve_path` returns.

    scene, problem: the scene, and the finite-element problem made from it.
    history: of the material at the end of the path.
    points: one for each mean pressure, or each approach.
    seconds: wall time.
    options: the keywords of `solve`, with the chosen dimensions of the block.
    certificate: residuals of scikit-fem's own assembly at the last point; empty if not certified.
    """

    scene: Scene
    problem: Problem
    history: History
    points: tuple[PathPoint, ...]
    seconds: float
    options: dict[str, Any]
    certificate: dict[str, float]


def path_targets(
    scene: Scene, problem: Problem, approach: float | Sequence[float] | None
) -> tuple[float, ...]:
    """Total forces in N or, if `approach` is given, approaches in m since the first touch."""
    if approach is None:
        area = problem.block.node_area * problem.heights.size
        return tuple(p * area for p in scene.load.path)
    given = (approach,) if isinstance(approach, int | float) else tuple(approach)
    if not given or not all(math.isfinite(a) and a > 0 for a in given):
        raise InvalidScene(f"approach is {approach!r}, but must be positive lengths in m")
    return given


def increments(targets: Sequence[float], steps: int | None) -> list[list[float]]:
    """List for each target the end values of the increments that lead to it.

    steps: number of increments from zero to the largest target; None: one for each target.
    """
    largest, before, out = max(targets), 0.0, []
    for target in targets:
        count = 1
        if steps is not None:
            count = max(1, math.ceil(abs(target - before) / largest * steps - 1e-9))
        out.append([before + (target - before) * (i + 1) / count for i in range(count)])
        before = target
    return out


def follow_path(
    problem: Problem,
    targets: Sequence[float],
    *,
    steps: int | None,
    by_approach: bool,
    tolerance: float,
) -> Iterator[tuple[PathPoint, History]]:
    """Solve the path point by point, and yield each point with the material's history there.

    The history changes in place along the path: read it before you ask for the next point.

    Args:
        problem: the finite-element problem.
        targets: from `path_targets`.
        steps: number of increments from zero to the largest target; None: one for each target.
        by_approach: whether the targets are approaches.
        tolerance: on every residual.

    Raises:
        NotConverged: an increment failed even after it was halved `MOST_HALVINGS` times.
    """
    area = problem.block.node_area * problem.heights.size
    history = plasticity.initial_history(problem.bricks.number if problem.plastic else 0)
    states: tuple[State, ...] = ()
    for target, ends in zip(targets, increments(targets, steps), strict=True):
        counts = Counts()
        for end in ends:
            states, solved, spent = _advance(problem, states, history, end, by_approach, tolerance)
            counts += spent
        pressure = (float(states[-1].forces.sum()) if by_approach else target) / area
        yield _path_point(problem, pressure, solved, counts, history), history


def _advance(
    problem: Problem,
    states: tuple[State, ...],
    history: History,
    target: float,
    by_approach: bool,
    tolerance: float,
) -> tuple[tuple[State, ...], SolvedIncrement, Counts]:
    """Advance from the last of `states` to `target`, and halve increments that do not converge.

    Commits the history after each converged increment, and returns the last two states, the last
    increment and the counts.
    """
    begin = _position(problem, states, by_approach)
    end, counts = target, Counts()
    while True:
        control = _control(problem, end, by_approach)
        try:
            if not states:
                start = _elastic_state(problem, control)
            else:
                start = states[-1] if by_approach else _extrapolated(problem, states, end)
            solved = solve_increment(problem, start, history, control, NewtonOptions(tolerance))
        except NotConverged:
            counts += Counts(halvings=1)
            if counts.halvings > MOST_HALVINGS:
                raise
            end = (begin + end) / 2
            continue
        states, counts = (*states[-1:], solved.state), counts + solved.counts
        if problem.plastic:
            u = solved.state.displacement.reshape(-1, 3)
            plasticity.commit(u, problem.bricks, problem.law, history)
        if end == target:
            return states, solved, counts
        begin, end = end, target


def _control(problem: Problem, target: float, by_approach: bool) -> Control:
    if by_approach:
        return Control(approach=target - float(problem.heights.max()))
    return Control(load=target, scale=target)


def _position(problem: Problem, states: tuple[State, ...], by_approach: bool) -> float:
    """The total force, or the approach since the first touch, of the last state."""
    if not states:
        return 0.0
    if by_approach:
        return states[-1].approach + float(problem.heights.max())
    return float(states[-1].forces.sum())


def _elastic_state(problem: Problem, control: Control) -> State:
    """The contact of the flat elastic block, from which every path starts."""
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


def _extrapolated(problem: Problem, states: tuple[State, ...], load: float) -> State:
    """The first guess of the state at `load`: on the secant through the last two states.

    The contact area grows about in proportion to the load, so it is extrapolated, too, and filled
    with the nodes nearest to the flat.  Unloading, an increment much longer than the last, and
    capped forces do not follow the secant: their guess is the last state.
    """
    state = states[-1]
    forces, count = float(state.forces.sum()), int((state.states == ELASTIC).sum())
    # Before the first state there is no force and no contact.
    earlier = states[-2] if len(states) > 1 else None
    grown = forces - (0.0 if earlier is None else float(earlier.forces.sum()))
    ratio = (load - forces) / grown if grown > 0 else 0.0
    if not 0 < ratio <= 1.5 or problem.capped:
        return state
    u, d, contact, count_before = state.displacement, state.approach, state.states == ELASTIC, 0
    if earlier is not None:
        u = u + ratio * (u - earlier.displacement)
        d += ratio * (d - earlier.approach)
        contact &= state.forces + ratio * (state.forces - earlier.forces) > 0
        count_before = int((earlier.states == ELASTIC).sum())
    wanted = max(round(count + ratio * (count - count_before)), int(contact.sum()))
    order = np.where(contact, -np.inf, -u[0, ..., 2] - problem.heights - d)
    touching = np.full(contact.shape, APART, dtype=np.int8)
    touching.ravel()[np.argsort(order, axis=None, kind="stable")[:wanted]] = ELASTIC
    return State(u, d, touching, state.forces)


def _path_point(
    problem: Problem, pressure: float, solved: SolvedIncrement, counts: Counts, history: History
) -> PathPoint:
    states, zone = solved.state.states, {}
    if problem.plastic:
        yielded = _yielded_surface(problem, history.accumulated)
        states = np.where((states != APART) & yielded, PLASTIC, states).astype(np.int8)
        zone = _plastic_zone(problem, history.accumulated)
    return PathPoint(pressure, solved.state, counts, solved.residuals, solved.history, states, zone)


def _yielded_surface(problem: Problem, accumulated: FloatArray) -> NDArray[np.bool_]:
    """(nx, ny) top nodes that touch an element of the top layer which has flowed."""
    nx, ny = problem.block.shape
    flowed = (accumulated[: nx * ny] > 0).any(axis=1).reshape(nx, ny)
    around = flowed | np.roll(flowed, 1, 0)
    return np.asarray(around | np.roll(around, 1, 1))


def _plastic_zone(problem: Problem, accumulated: FloatArray) -> dict[str, float]:
    """Largest strain, share of the body's volume, and depth in m, of the plastic zone."""
    weights = problem.bricks.weights[problem.bricks.shape_of]
    flowed = (accumulated > 0).reshape(len(problem.block.layers), -1).any(axis=1)
    last = int(np.flatnonzero(flowed).max(initial=-1))
    return {
        "largest_plastic_strain": float(accumulated.max()),
        "plastic_volume": float(weights[accumulated > 0].sum() / weights.sum()),
        "plastic_depth": -float(problem.block.levels[last + 1]),
    }
