"""Answers a scene with finite elements: `solve`, and `solve_path` for those who want the state.

Laws:  elastic;  capped, the elastic body whose nodal pressures stay below the hardness (the
boundary elements' problem by other means);  j2, small-strain plasticity of the solid itself,
which knows no cap.  Geometries:  gap, the roughness as the gap over a flat block, as small
slopes allow;  moved, the top nodes at the real heights.
"""

from __future__ import annotations

import functools
import inspect
import math
import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, ParamSpec

import numpy as np

from epcontact.errors import InvalidScene, NotConverged, NotEnoughMemory
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Scene
from fem_check import plasticity
from fem_check.certify import certify
from fem_check.linear_solver import factorise
from fem_check.mesh import Block, block_for, flat_elements, moved_elements
from fem_check.path import Reached, added, increments_of, march, point_of_path, targets_of
from fem_check.plasticity import History
from fem_check.problem import Counts, Problem, State
from fem_check.report import contact_result

LawName = Literal["elastic", "capped", "j2"]
Geometry = Literal["gap", "moved"]
Progress = Callable[[float, str], None]
P = ParamSpec("P")

#: Load increments from zero to the largest pressure. On a rough scene with
#: yield_stress = 0.2 E* xi, going from 4 to 16 of them changed the area by 0.1 %.
J2_INCREMENTS = 4


@dataclass(frozen=True)
class SolvedPath:
    """A solved path with what made it: the last state's history is `history`.

    certificate: what scikit-fem's own assembly says of the last state, where it was asked.
    """

    scene: Scene
    problem: Problem
    history: History
    reached: tuple[Reached, ...]
    seconds: float
    notes: tuple[str, ...]
    options: dict[str, Any]
    certificate: dict[str, float]


def solve_path(  # noqa: PLR0913 - the scene's many questions, by keyword
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
    targets = targets_of(scene, problem, approach)
    increments = increments_of(targets, steps or (J2_INCREMENTS if law == "j2" else None))
    history = plasticity.virgin(problem.bricks.number if law == "j2" else 0)
    states: tuple[State, ...] = ()
    reached, notes = [], []
    area = problem.block.node_area * problem.heights.size
    for number, (point, ends) in enumerate(increments):
        total = Counts()
        found: dict[str, float] = {}
        for target in point:
            states, counts, found, halvings = march(
                problem, states, history, target, approach is not None, tolerance
            )
            total = added(total, counts)
            if halvings:
                notes.append(f"an increment towards point {number} was halved {halvings} times")
        state = states[-1]
        pressure = float(state.forces.sum()) / area if approach is not None else ends / area
        reached.append(point_of_path(problem, pressure, state, history, total, found))
        if output is not None:
            from fem_check.output import write_step

            surface = reached[-1].surface_states
            write_step(Path(output), number, problem, state, history, surface)
        if progress is not None:
            progress((number + 1) / len(increments), f"fem: mean pressure {pressure:.3g} Pa")
    if output is not None:
        from fem_check.output import write_collection

        write_collection(Path(output), [r.mean_pressure for r in reached])
    seconds = time.perf_counter() - begin
    options = {
        "law": law,
        "geometry": geometry,
        "depth": problem.block.depth,
        "layers": len(problem.block.layers),
        "first_layer": float(problem.block.layers[0]),
        "tolerance": tolerance,
        "hardening": hardening,
        "steps": steps,
    }
    certificate = _certificate(problem, states[-1], history, tolerance) if certified else {}
    return SolvedPath(
        scene, problem, history, tuple(reached), seconds, tuple(notes), options, certificate
    )


def _certificate(
    problem: Problem, state: State, history: History, tolerance: float
) -> dict[str, float]:
    """What `certify` finds.  Raises NotConverged where it does not confirm the state."""
    certificate = certify(problem, state, history)
    # Ten times the tolerance: the certificate adds up forces in another order.
    if certificate["certified_balance"] > max(10 * tolerance, 1e-12):
        raise NotConverged(
            "scikit-fem's assembly does not confirm the converged state: its internal force "
            f"misses the contact forces by {certificate['certified_balance']:.1e}",
            residuals=certificate,
        )
    return certificate


def _answered(path: Callable[P, SolvedPath]) -> Callable[P, ContactResult]:
    """The function of the same arguments that returns the path's result."""

    @functools.wraps(path, assigned=("__module__",))
    def solve(*args: P.args, **options: P.kwargs) -> ContactResult:
        """The contact of `scene` along its load path.

        law, geometry: see the module.  depth, first_layer (m), layers (their number): of the
            block, chosen from the scene where not given (`mesh`).
        steps: load increments from zero to the largest pressure; 4 for j2, else one a mean
            pressure.
        tolerance: on every residual: forces by the total force, lengths by the rms height.
        approach: of the flat after it touched the highest point, m; prescribes the path in place
            of the mean pressures.
        hardening: H of linear isotropic hardening, Pa.
        certified: whether scikit-fem's own assembly must confirm the last state (`certify`).
        progress: called with the share of the path that is done and a sentence.
        output: folder for one .vtu a point of the path and a .pvd.

        Raises InvalidScene, NotConverged (with the residual history), OutputError.
        """
        return contact_result(path(*args, **options), _peak_memory())

    signature = inspect.signature(path).replace(return_annotation="ContactResult")
    solve.__signature__ = signature  # type: ignore[attr-defined]
    return solve


solve = _answered(solve_path)


def _peak_memory() -> float:
    """Of the process so far, in bytes."""
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * 1024


def _checked(
    scene: Scene, law: str, geometry: str, hardening: float, tolerance: float, steps: int | None
) -> None:
    """Refuses a question that makes no sense.  Raises InvalidScene."""
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
    require_memory(block, plastic=law == "j2")
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


def bytes_needed(block: Block, *, plastic: bool) -> float:
    """Estimate of a solve's memory, from what is kept an element and a wave.

    An element: connectivity and shape (36), the history (448), where it flows, taken to be one
    in ten, its softening and its rows (2700), and moved its own gradients (1800 and as much again
    while scikit-fem makes them); a node: some sixteen displacement fields (24 each); half a wave a
    node: the factor's 15 numbers.
    """
    nodes = float(np.prod(block.field_shape[:3]))
    element = 36 + (448 + 270 if plastic else 0) + (3600 if block.moved is not None else 0)
    return nodes * (element + 16 * 24 + 15 * 8 / 2)


def _free_memory() -> float:
    """Bytes that can be had without swapping; infinite where the system does not tell."""
    try:
        with open("/proc/meminfo", encoding="ascii") as lines:
            fields = dict(line.split(":", 1) for line in lines)
        return float(fields["MemAvailable"].split()[0]) * 1024
    except (OSError, KeyError, ValueError, IndexError):
        return math.inf


def require_memory(block: Block, *, plastic: bool) -> None:
    """Refuses a block that will not fit.  Raises NotEnoughMemory before anything is made."""
    needed, free = bytes_needed(block, plastic=plastic), _free_memory()
    if needed > free:
        nx, ny = block.shape
        raise NotEnoughMemory(
            f"the block of {nx} x {ny} x {len(block.layers)} elements needs about "
            f"{needed / 2**30:.1f} GiB, but {free / 2**30:.1f} GiB are free; give fewer grid "
            "points or layers"
        )
