"""The load path: its points, and what the body remembers between them.

J2 flow keeps a history of strains.  A capped body keeps the plastic displacement w = -g
of the capped nodes: below the largest load so far it meets the flat with the heights h
- w, on which the same forces at that load leave no gap.  No force falls while the load
grows, so w is that of the largest load alone, and from there on the path goes as if it
had never turned back.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from epcontact.results import APART, ELASTIC, PLASTIC, FloatArray
from epcontact.scene import Scene
from fem_check import plasticity
from fem_check.contact import States
from fem_check.increments import Along, Rule, advance
from fem_check.options import FemOptions
from fem_check.plasticity import History
from fem_check.problem import Counts, Problem, State
from fem_check.workers import dot


@dataclass(frozen=True)
class PathPoint:
    """A converged point of the path.

    counts: iterations since the point before.  residuals: of the state, by name.  history: the
    largest residual after each Newton iteration of the last increment.  surface_states: (nx, ny)
    APART, ELASTIC or PLASTIC in the sense of `result`.  gap: (nx, ny) from the surface before any
    flow to the flat, in m.  plastic_displacement: (nx, ny) of capped nodes, now or earlier, in m.
    flow: measures of plastic flow, by name.  peak: the largest force so far, in N.
    """

    mean_pressure: float
    state: State
    counts: Counts
    residuals: dict[str, float]
    history: tuple[float, ...]
    surface_states: States
    gap: FloatArray
    plastic_displacement: FloatArray
    flow: dict[str, float]
    peak: float


@dataclass(frozen=True)
class SolvedPath:
    """A solved load path: what `solve_path` returns.

    Attributes:
        scene, options, problem: the question, and the finite-element problem made from
        it. history: of the material at the end of the path. points: one for each mean
        pressure, or each approach. seconds: wall time. certificate: residuals of
        scikit-fem's own assembly at the last point, if certified.
    """

    scene: Scene
    options: FemOptions
    problem: Problem
    history: History
    points: tuple[PathPoint, ...]
    seconds: float
    certificate: dict[str, float]


def path_targets(
    scene: Scene, problem: Problem, options: FemOptions
) -> tuple[float, ...]:
    """Total forces in N or, if they are prescribed, approaches in m since the first
    touch.
    """
    if options.approach is not None:
        return cast("tuple[float, ...]", options.approach)
    area = problem.block.node_area * problem.heights.size
    return tuple(p * area for p in scene.load.path)


def follow_path(
    problem: Problem, targets: Sequence[float], options: FemOptions
) -> Iterator[tuple[PathPoint, History]]:
    """Solve point by point, and yield each with the material's history.  Raises
    NotConverged.
    """
    highest = None if options.approach is None else float(problem.heights.max())
    rule = Rule(highest, options.steps, options.tolerance)
    area = problem.block.node_area * problem.heights.size
    history = plasticity.initial_history(
        problem.bricks.number if problem.plastic else 0
    )
    along = top = Along(history)  # top: where a capped body was pressed most
    lowered = np.zeros_like(problem.heights)
    for target in targets:
        body = problem
        if problem.capped and target < top.at:
            body, along = (
                replace(problem, heights=problem.heights - lowered),
                _elastic(along),
            )
        elif problem.capped:
            along = top
        along = advance(body, along, target, rule)
        state = along.states[-1]
        if problem.capped and body is problem:
            top, lowered = along, _sunk(problem, state)
        pressure = (target if highest is None else state.forces.sum()) / area
        yield _path_point(problem, float(pressure), along, lowered), along.history


def _elastic(along: Along) -> Along:
    """The place with elastic contact alone, as on the surface that flow has lowered."""

    eased = (np.where(s.states == PLASTIC, ELASTIC, s.states) for s in along.states)
    pairs = zip(along.states, eased, strict=True)
    return replace(along, states=tuple(replace(s, states=each) for s, each in pairs))


def _sunk(problem: Problem, state: State) -> FloatArray:
    """(nx, ny) the depth in m to which the capped nodes have sunk."""
    between = problem.gap(state.displacement, state.approach)
    return np.where(state.states == PLASTIC, np.maximum(-between, 0.0), 0.0)


def _path_point(
    problem: Problem, pressure: float, along: Along, lowered: FloatArray
) -> PathPoint:
    assert along.solved is not None
    state, history = along.solved.state, along.history
    states, flow = state.states, {}
    if problem.plastic:
        yielded = _yielded_surface(problem, history)
        states = np.where((states != APART) & yielded, PLASTIC, states).astype(np.int8)
        flow = _plastic_flow(problem, state, history)
    if problem.capped:
        mean = float(lowered.mean())
        work = problem.cap / problem.block.node_area * mean
        flow = {"mean_plastic_displacement": mean, "plastic_work": work}
    between = problem.gap(state.displacement, state.approach)
    return PathPoint(
        mean_pressure=pressure,
        state=state,
        counts=along.counts,
        residuals=along.solved.residuals,
        history=along.solved.history,
        surface_states=states,
        gap=np.where(states == APART, between, 0.0 - lowered),
        plastic_displacement=lowered,
        flow=flow,
        peak=along.peak,
    )


def _yielded_surface(problem: Problem, history: History) -> NDArray[np.bool_]:
    """(nx, ny) top nodes that touch an element of the top layer which has flowed."""
    return nodes_of(
        history.rows[: problem.heights.size].reshape(problem.block.shape) > 0
    )


def nodes_of(some: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(nx, ny) top nodes that touch one of some elements (nx, ny) of the top layer."""
    around = some | np.roll(some, 1, 0)
    return np.asarray(around | np.roll(around, 1, 1))


def _plastic_flow(problem: Problem, state: State, history: History) -> dict[str, float]:
    """Largest strain, share of the volume and depth (m) of the plastic zone; energies
    in J/m^2: stored in the block, a half-space's compression included, and spent,
    sigma_Y a + H a^2/2 with the accumulated plastic strain a, which is exact for linear
    hardening.
    """
    block, bricks, law = problem.block, problem.bricks, problem.law
    flowed = np.flatnonzero(history.rows)
    a, weights = (
        history.accumulated[history.rows[flowed]],
        bricks.weights[bricks.shape_of[flowed]],
    )
    last = int(flowed.max(initial=-1)) // problem.heights.size  # the layer; -1: none
    volume = float(np.bincount(bricks.shape_of) @ bricks.weights.sum(axis=1))
    stored = 0.0
    for layer in range(len(block.layers)):
        stress, some = problem.layer_stresses(state, history, layer)
        stored += plasticity.stored_energy(stress, some, law)
    area = block.node_area * problem.heights.size
    return {
        "largest_plastic_strain": float(a.max(initial=0.0)),
        "plastic_volume": float(weights[a > 0].sum()) / volume,
        "plastic_depth": -float(block.levels[last + 1]),
        "stored_energy": stored / area,
        "plastic_work": dot(weights, law.yield_stress * a + law.hardening * a**2 / 2)
        / area,
    }
