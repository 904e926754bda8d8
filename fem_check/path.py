"""The load path: its points, and what the body remembers between them.

J2 flow leaves a history of strains.  A capped body remembers the plastic displacement
w = -g of the capped nodes.  Below the largest load so far it meets the flat with the
heights h - w, on which the same forces at the largest load leave no gap.  No force
falls while the load grows, so that w is that of the largest load alone; beyond this
load the path continues as if it had never turned back.
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
from fem_check.increments import PathProgress, Stepping, advance
from fem_check.options import FemOptions
from fem_check.plasticity import History
from fem_check.problem import Counts, Problem, State
from fem_check.workers import dot


@dataclass(frozen=True)
class PathPoint:
    """A converged point of the load path.

    Attributes:
        mean_pressure: in Pa.
        state: the converged state.
        counts: iterations since the point before.
        residuals: of the state, by the names of `Problem.residuals`.
        history: largest residual after each Newton iteration of the last increment.
        surface_states: (nx, ny) APART, ELASTIC or PLASTIC, as in a result's fields.
        gap: (nx, ny) from the surface before any flow to the flat, in m.
        plastic_displacement: (nx, ny) depth of nodes that are or were capped, in m.
        flow: measures of plastic flow, by name, in SI units.
        peak: largest force so far, in N.
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
        scene: the scene.
        options: of the solve.
        problem: the finite-element problem of the scene.
        history: of the elements at the end of the path.
        points: one for each mean pressure or each approach.
        seconds: wall time.
        certificate: dimensionless residuals by plain scikit-fem, the larger ones of the
            points with the largest load and with the last one; empty without the option
            `certified`.
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
    """Return the targets of the load path, one for each of its points.

    They are total forces in N, or approaches in m since the first touch if the options
    prescribe approaches.

    Args:
        scene: with the mean pressures of its load path, in Pa.
        problem: the finite-element problem, with the nominal area.
        options: of the solve.
    """
    if options.approach is not None:
        return cast("tuple[float, ...]", options.approach)
    return tuple(pressure * problem.area for pressure in scene.load.path)


def solve_points(
    problem: Problem, targets: Sequence[float], options: FemOptions
) -> Iterator[tuple[PathPoint, History, History]]:
    """Solve the load path, and yield each point with the history of the elements.

    Args:
        problem: the finite-element problem.
        targets: from `path_targets`: forces in N, or approaches in m.
        options: of the solve.

    Yields:
        The converged point of each target, and the plastic strains of the elements
        before its last increment and at the point.

    Raises:
        NotConverged: an increment failed, even after it was halved several times.
    """
    first_touch = None
    if options.approach is not None:
        first_touch = float(problem.heights.max())
    stepping = Stepping(first_touch, options.steps, options.tolerance)
    elements = 0
    if problem.plastic:
        elements = problem.bricks.number
    nothing_flowed = plasticity.initial_history(elements)
    progress = PathProgress(nothing_flowed, nothing_flowed)
    # Of a capped body: the progress and plastic displacement at its largest load.
    loaded = progress
    lowered = np.zeros_like(problem.heights)
    for target in targets:
        if problem.capped and target < loaded.position:
            body = replace(problem, heights=problem.heights - lowered)
            start = _without_plastic_nodes(progress)
            progress = advance(body, start, target, stepping)
        elif problem.capped:
            progress = advance(problem, loaded, target, stepping)
            loaded = progress
            lowered = _plastic_displacement(problem, progress.states[-1])
        else:
            progress = advance(problem, progress, target, stepping)
        pressure = target / problem.area
        if first_touch is not None:
            pressure = float(progress.states[-1].forces.sum()) / problem.area
        point = _path_point(problem, pressure, progress, lowered)
        yield point, progress.before, progress.history


def _without_plastic_nodes(progress: PathProgress) -> PathProgress:
    """Return the path's progress with elastic contact in place of plastic contact.

    A capped body is unloaded on the surface that its plastic nodes have lowered, on
    which all contact is elastic again.
    """
    states = []
    for state in progress.states:
        elastic = np.where(state.states == PLASTIC, ELASTIC, state.states)
        states.append(replace(state, states=elastic))
    return replace(progress, states=tuple(states))


def _plastic_displacement(problem: Problem, state: State) -> FloatArray:
    """Return the (nx, ny) depth to which the capped nodes have sunk, in m.

    It is minus the gap at PLASTIC nodes and 0 elsewhere.

    Args:
        problem: of a capped body.
        state: the converged state.
    """
    gap = problem.gap(state.displacement, state.approach)
    return np.where(state.states == PLASTIC, np.maximum(-gap, 0.0), 0.0)


def _path_point(
    problem: Problem, pressure: float, progress: PathProgress, lowered: FloatArray
) -> PathPoint:
    """Return the point of the load path at the present progress.

    Args:
        problem: the finite-element problem.
        pressure: mean pressure of the point, in Pa.
        progress: after at least one increment.
        lowered: (nx, ny) plastic displacement of a capped body's nodes in m; zeros
            otherwise.
    """
    assert progress.solved is not None
    state = progress.solved.state
    states = state.states
    flow: dict[str, float] = {}
    if problem.plastic:
        yielded = _yielded_surface(problem, progress.history)
        states = np.where((states != APART) & yielded, PLASTIC, states).astype(np.int8)
        flow = _plastic_flow(problem, state, progress.history)
    if problem.capped:
        mean = float(lowered.mean())
        hardness = problem.cap / problem.block.node_area
        flow = {
            "mean_plastic_displacement": mean,
            "flowed_share": np.count_nonzero(lowered) / lowered.size,
            "plastic_work": hardness * mean,
        }
    gap = problem.gap(state.displacement, state.approach)
    return PathPoint(
        mean_pressure=pressure,
        state=state,
        counts=progress.counts,
        residuals=progress.solved.residuals,
        history=progress.solved.history,
        surface_states=states,
        gap=np.where(states == APART, gap, 0.0 - lowered),
        plastic_displacement=lowered,
        flow=flow,
        peak=progress.peak,
    )


def _yielded_surface(problem: Problem, history: History) -> NDArray[np.bool_]:
    """Return (nx, ny) True for the top nodes of an element that has ever flowed.

    Args:
        problem: the finite-element problem, with nx times ny top nodes.
        history: of the elements, whose first nx ny are those of the top layer.
    """
    top_layer = history.rows[: problem.heights.size].reshape(problem.block.shape)
    return nodes_of(top_layer > 0)


def nodes_of(elements: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return (nx, ny) True for the top nodes of some elements of the top layer.

    Args:
        elements: (nx, ny) True for these elements; element [i, j] has the nodes i and i
            + 1, j and j + 1, periodically.
    """
    nodes = elements | np.roll(elements, 1, 0)
    return np.asarray(nodes | np.roll(nodes, 1, 1))


def _plastic_flow(problem: Problem, state: State, history: History) -> dict[str, float]:
    """Return measures of the plastic flow of a J2 body, by name.

    Args:
        problem: the finite-element problem.
        state: the converged state.
        history: plastic strains of the elements at this state.

    Returns:
        `largest_plastic_strain`, the largest accumulated plastic strain;
        `plastic_volume`, the fraction of the volume that has flowed; `plastic_depth` of
        the plastic zone in m; `stored_energy`, the elastic energy stored in the block
        in J/m^2 (with the uniform compression of a half-space's block); and
        `plastic_work` in J/m^2.
    """
    block = problem.block
    bricks = problem.bricks
    flowed = np.flatnonzero(history.rows)
    strain = history.accumulated[history.rows[flowed]]
    weights = bricks.weights[bricks.shape_of[flowed]]
    deepest_layer = int(flowed.max(initial=-1)) // problem.heights.size  # -1: no flow
    volumes = bricks.weights.sum(axis=1)
    total_volume = float(np.bincount(bricks.shape_of) @ volumes)
    stored = 0.0
    for layer in range(len(block.layers)):
        stress, layer_bricks = problem.layer_stresses(state, history, layer)
        stored += plasticity.stored_energy(stress, layer_bricks, problem.law)
    work = plasticity.plastic_work_density(strain, problem.law)
    return {
        "largest_plastic_strain": float(strain.max(initial=0.0)),
        "plastic_volume": float(weights[strain > 0].sum()) / total_volume,
        "plastic_depth": -float(block.levels[deepest_layer + 1]),
        "stored_energy": stored / problem.area,
        "plastic_work": dot(weights, work) / problem.area,
    }
