"""Answers a scene with finite elements: `solve`, and `solve_path` for those who want the state.

Laws:  elastic;  capped, the elastic body whose nodal pressures stay below the hardness (the
boundary elements' problem by other means);  j2, small-strain plasticity of the solid itself,
which knows no cap.  Geometries:  gap, the roughness as the gap over a flat block, as small
slopes allow;  moved, the top nodes at the real heights.
"""

from __future__ import annotations

import math
import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from epcontact.errors import InvalidScene, NotConverged
from epcontact.results import APART, PLASTIC, ContactResult
from epcontact.scene import Scene
from fem_check import plasticity
from fem_check.certify import certify
from fem_check.contact import States, rigid_contact
from fem_check.element import FloatArray
from fem_check.linear_solver import eliminate, factorise, substitute
from fem_check.mesh import block_for, flat_elements, moved_elements
from fem_check.newton import Control, Counts, Options, Problem, State, solve_step
from fem_check.plasticity import History
from fem_check.report import contact_result, yielded_surface

LawName = Literal["elastic", "capped", "j2"]
Geometry = Literal["gap", "moved"]
Progress = Callable[[float, str], None]

#: Load increments from zero to the largest pressure. On a rough scene with
#: yield_stress = 0.2 E* xi, going from 4 to 16 of them changed the area by 0.1 %.
J2_INCREMENTS = 4


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


@dataclass(frozen=True)
class SolvedPath:
    """A solved path with what made it: the last state's history is `history`."""

    scene: Scene
    problem: Problem
    history: History
    reached: tuple[Reached, ...]
    seconds: float
    notes: tuple[str, ...]


def solve(  # noqa: PLR0913 - the scene's many questions, by keyword
    scene: Scene,
    *,
    law: LawName = "j2",
    geometry: Geometry = "gap",
    depth: float | None = None,
    layers: int | None = None,
    first_layer: float | None = None,
    steps: int | None = None,
    tolerance: float = 1e-8,
    approach: float | Sequence[float] | None = None,
    hardening: float = 0.0,
    certified: bool = True,
    progress: Progress | None = None,
    output: Path | str | None = None,
) -> ContactResult:
    """The contact of `scene` along its load path.

    law, geometry: see the module.  depth, first_layer (m), layers (their number): of the block,
        chosen from the scene where not given (`mesh`).
    steps: load increments from zero to the largest pressure; 4 for j2, else one a mean pressure.
    tolerance: on every residual: forces by the total force, lengths by the rms height.
    approach: of the flat after it touched the highest point, m; prescribes the path in place of
        the mean pressures.
    hardening: H of linear isotropic hardening, Pa.
    certified: whether scikit-fem's own assembly must confirm the last state (`certify`).
    progress: called with the share of the path that is done and a sentence.
    output: folder for one .vtu a point of the path and a .pvd.

    Raises InvalidScene, NotConverged (with the residual history), OutputError.
    """
    path = solve_path(
        scene,
        law=law,
        geometry=geometry,
        depth=depth,
        layers=layers,
        first_layer=first_layer,
        steps=steps,
        tolerance=tolerance,
        approach=approach,
        hardening=hardening,
        progress=progress,
        output=output,
    )
    certificate = {}
    if certified:
        certificate = certify(path.problem, path.reached[-1].state, path.history)
        # Ten times the tolerance: the certificate adds up forces in another order.
        if certificate["certified_balance"] > max(10 * tolerance, 1e-12):
            raise NotConverged(
                "scikit-fem's assembly does not confirm the converged state: its internal force "
                f"misses the contact forces by {certificate['certified_balance']:.1e}",
                residuals=certificate,
            )
    options = {
        "law": law,
        "geometry": geometry,
        "depth": path.problem.block.depth,
        "layers": len(path.problem.block.layers),
        "first_layer": float(path.problem.block.layers[0]),
        "tolerance": tolerance,
        "hardening": hardening,
        "steps": steps,
    }
    return contact_result(path, options, certificate, _peak_memory())


def _peak_memory() -> float:
    """Of the process so far, in bytes."""
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * 1024


def _checked(
    scene: Scene, law: str, geometry: str, hardening: float, tolerance: float, steps: int | None
) -> None:
    material = scene.material
    if law not in ("elastic", "capped", "j2"):
        raise InvalidScene(f"law is {law!r}, but must be elastic, capped or j2")
    if geometry not in ("gap", "moved"):
        raise InvalidScene(f"geometry is {geometry!r}, but must be gap or moved")
    if law == "j2" and not math.isfinite(material.yield_stress):
        raise InvalidScene("law j2 needs a finite yield_stress; give one or take law='elastic'")
    if law == "capped":
        if not math.isfinite(material.hardness):
            raise InvalidScene("law capped needs a finite hardness; give one or take law='elastic'")
        scene.require_loading()
    if not (math.isfinite(hardening) and hardening >= 0):
        raise InvalidScene(f"hardening is {hardening!r}, but must be zero or positive, in Pa")
    if steps is not None and steps < 1:
        raise InvalidScene(f"steps is {steps!r}, but must be a positive number of increments")
    if not 0 < tolerance < 1:
        raise InvalidScene(f"tolerance is {tolerance!r}, but must lie between 0 and 1")


def problem_of(
    scene: Scene,
    *,
    law: LawName = "elastic",
    geometry: Geometry = "gap",
    depth: float | None = None,
    layers: int | None = None,
    first_layer: float | None = None,
    hardening: float = 0.0,
) -> Problem:
    """The finite-element problem of a scene; arguments as in `solve`."""
    material = scene.material
    block = block_for(
        scene, depth=depth, layers=layers, first_layer=first_layer, moved=geometry == "moved"
    )
    rule = plasticity.law(
        material.young_modulus,
        material.poisson_ratio,
        material.yield_stress if law == "j2" else math.inf,
        hardening,
    )
    flat = flat_elements(block)
    heights = scene.surface.heights.reshape(block.shape)
    return Problem(
        block,
        flat if geometry == "gap" else moved_elements(block),
        factorise(block, flat, rule),
        rule,
        heights - heights.mean() if geometry == "moved" else heights,
        material.hardness * block.node_area if law == "capped" else math.inf,
        geometry == "gap",
    )


def surface_compliance(scene: Scene, **block: float | int | None) -> FloatArray:
    """The flat block's own surface compliance, m/Pa: what it answers to a pressure wave.

    One value a mode of numpy.fft.rfft2 (or rfft for a line) of the scene's grid, the mode q = 0
    included, where a bonded layer gives depth over oedometric modulus.  For a comparison that
    hands this very body to the boundary elements.  `block`: depth, layers, first_layer of
    `solve`.
    """
    problem = problem_of(scene, **block)  # type: ignore[arg-type]
    nx, ny = problem.block.shape
    half = problem.factor.surface * problem.block.node_area
    if scene.surface.heights.ndim == 1:
        return half[:, 0].copy()
    mirrored = np.minimum(np.arange(nx), nx - np.arange(nx))
    return half[mirrored][:, : ny // 2 + 1].copy()


def solve_path(  # noqa: PLR0913
    scene: Scene,
    *,
    law: LawName = "j2",
    geometry: Geometry = "gap",
    depth: float | None = None,
    layers: int | None = None,
    first_layer: float | None = None,
    steps: int | None = None,
    tolerance: float = 1e-8,
    approach: float | Sequence[float] | None = None,
    hardening: float = 0.0,
    progress: Progress | None = None,
    output: Path | str | None = None,
) -> SolvedPath:
    """`solve`, but returning the finite-element states; arguments and errors are the same."""
    _checked(scene, law, geometry, hardening, tolerance, steps)
    begin = time.perf_counter()
    problem = problem_of(
        scene,
        law=law,
        geometry=geometry,
        depth=depth,
        layers=layers,
        first_layer=first_layer,
        hardening=hardening,
    )
    targets = _targets(scene, problem, approach)
    increments = _increments(targets, steps or (J2_INCREMENTS if law == "j2" else None))
    history = plasticity.virgin(problem.bricks.number if law == "j2" else 0)
    state, reached, notes = None, [], []
    area = problem.block.node_area * problem.heights.size
    for number, (point, ends) in enumerate(increments):
        total = Counts()
        found: dict[str, float] = {}
        for target in point:
            state, counts, found, halvings = _march(
                problem, state, history, target, approach is not None, tolerance
            )
            total = _added(total, counts)
            if halvings:
                notes.append(f"an increment towards point {number} was halved {halvings} times")
        assert state is not None
        pressure = float(state.forces.sum()) / area if approach is not None else ends / area
        reached.append(_reached(problem, pressure, state, history, total, found))
        if output is not None:
            from fem_check.output import write_step

            states = reached[-1].surface_states
            write_step(Path(output), number, problem, state, history, states)
        if progress is not None:
            progress((number + 1) / len(increments), f"fem: mean pressure {pressure:.3g} Pa")
    if output is not None:
        from fem_check.output import write_collection

        write_collection(Path(output), [r.mean_pressure for r in reached])
    return SolvedPath(
        scene, problem, history, tuple(reached), time.perf_counter() - begin, tuple(notes)
    )


def _reached(
    problem: Problem,
    pressure: float,
    state: State,
    history: History,
    counts: Counts,
    found: dict[str, float],
) -> Reached:
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


def _targets(
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


def _increments(targets: tuple[float, ...], steps: int | None) -> list[tuple[list[float], float]]:
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


def _march(
    problem: Problem,
    state: State | None,
    history: History,
    target: float,
    by_approach: bool,
    tolerance: float,
) -> tuple[State, Counts, dict[str, float], int]:
    """Goes to `target` in one increment, or in halves where that does not converge; commits the
    history after each that does."""
    before, goal, halvings, total = _position(problem, state, by_approach), target, 0, Counts()
    while True:
        control = _control(problem, goal, by_approach)
        try:
            begun = _elastic_state(problem, control) if state is None else state
            state_, counts, found = solve_step(problem, begun, history, control, Options(tolerance))
        except NotConverged:
            halvings += 1
            if halvings > 6:
                raise
            goal = (before + goal) / 2
            continue
        state, total = state_, _added(total, counts)
        if problem.plastic:
            plasticity.commit(
                state.displacement.reshape(-1, 3), problem.bricks, problem.law, history
            )
        if goal == target:
            return state, total, found, halvings
        before, goal = goal, target


def _position(problem: Problem, state: State | None, by_approach: bool) -> float:
    """Where the path stands: the total force, or the approach after the first touch."""
    if state is None:
        return 0.0
    if by_approach:
        return state.approach + float(problem.heights.max())
    return float(state.forces.sum())


def _added(first: Counts, second: Counts) -> Counts:
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
