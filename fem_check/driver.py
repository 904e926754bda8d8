"""Solve a scene with finite elements: `solve`, and `solve_path` for its finite-element states.

Laws.  "elastic" is linear elasticity.  "capped" is an elastic body whose nodal pressures do not
exceed the hardness (the problem of the boundary elements, discretised in another way); capped nodes
keep what they have sunk when the load falls (`path`).  "j2" is
small-strain plasticity of the solid itself, without any cap on the pressure.

Geometries.  With "gap" the roughness is the initial gap over a flat block, as small slopes allow.
With "moved" the top nodes are moved to the real heights.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from epcontact.errors import InvalidScene, NotConverged
from epcontact.results import ContactResult, FloatArray, package_versions
from epcontact.scene import Scene, number, require_kind, share, whole
from fem_check import plasticity
from fem_check.certify import certify
from fem_check.increments import Rule
from fem_check.linear_solver import factorise
from fem_check.memory import flowing_shares, peak_memory, require_memory
from fem_check.mesh import block_for, flat_elements, moved_elements
from fem_check.path import PathPoint, SolvedPath, follow_path, path_targets
from fem_check.plasticity import History
from fem_check.problem import Problem
from fem_check.result import contact_result
from fem_check.vtu import write_collection, write_step
from fem_check.workers import Workers, available_cores

LawName = Literal["elastic", "capped", "j2"]
Geometry = Literal["gap", "moved"]
Progress = Callable[[float, str], None]

#: Of a pair of increments of a J2 path (`increments`).  With it, areas are within 1 % of those of
#: 40 equal increments at E* xi/sigma_Y of 5 and of 50.
STEP_TOLERANCE = 0.03


def solve(  # noqa: PLR0913 - every option of the method, by keyword
    scene: Scene,
    *,
    law: LawName = "j2",
    geometry: Geometry = "gap",
    depth: float | None = None,
    layers: int | None = None,
    first_layer: float | None = None,
    steps: int | None = None,
    step_tolerance: float = STEP_TOLERANCE,
    tolerance: float = 1e-8,
    approach: float | Sequence[float] | None = None,
    hardening: float = 0.0,
    certified: bool = True,
    progress: Progress | None = None,
    output: Path | str | None = None,
    threads: int | None = None,
) -> ContactResult:
    """Solve the contact of a scene along its load path with finite elements.

    Args:
        scene: the surface, the material, the body and the mean pressures.
        law: "elastic", "capped" or "j2"; see the module's docstring.
        geometry: "gap" or "moved"; see the module's docstring.
        depth: of the block under a half-space's surface, in m; chosen from the scene by default.
        layers: number of layers of elements; chosen from the scene by default.
        first_layer: thickness of the top layer, in m; the grid spacing by default.
        steps: equal load increments from zero to the largest pressure; by default they are chosen
            by `step_tolerance` for j2, else there is one for each mean pressure.
        step_tolerance: of the increments of a J2 path: the share of the force that shorter
            increments may put on other nodes (`increments`).
        tolerance: on every residual: forces over the total force, lengths over the rms height.
        approach: of the flat since it touched the highest point, in m; one value or a path of
            them, used instead of the mean pressures.
        hardening: H of linear isotropic hardening, in Pa.
        certified: whether scikit-fem's own assembly must confirm the last state (`certify`).
        progress: called with the share of the path that is done and a sentence.
        output: folder for the files of the body and its surface (.vtu) at each point of the path,
            and a .pvd over them.
        threads: that share the work, which gives the same bits on any number; None: all cores.

    Returns:
        The result with one step for each point of the path and the fields of the last one.

    Raises:
        InvalidScene: the options contradict each other or the scene.
        NotConverged: an increment failed; the error holds the residuals of its iterations.
        NotEnoughMemory: the block would not fit.
        OutputError: a file could not be written.

    Example:
        >>> from epcontact.scene import Load, Material, Scene, Surface
        >>> heights = 0.01 * np.cos(2 * np.pi * np.arange(16) / 16)
        >>> scene = Scene(Surface(heights, (1.0,)), Material(1.0, 0.3), Load(0.01))
        >>> solve(scene, law="elastic").final.areas["raw"].total
        0.4375
    """
    path = solve_path(
        scene,
        law=law,
        geometry=geometry,
        depth=depth,
        layers=layers,
        first_layer=first_layer,
        steps=steps,
        step_tolerance=step_tolerance,
        tolerance=tolerance,
        approach=approach,
        hardening=hardening,
        certified=certified,
        progress=progress,
        output=output,
        threads=threads,
    )
    return contact_result(path, peak_memory())


def solve_path(  # noqa: PLR0913 - the options of `solve`
    scene: Scene,
    *,
    law: LawName = "j2",
    geometry: Geometry = "gap",
    depth: float | None = None,
    layers: int | None = None,
    first_layer: float | None = None,
    steps: int | None = None,
    step_tolerance: float = STEP_TOLERANCE,
    tolerance: float = 1e-8,
    approach: float | Sequence[float] | None = None,
    hardening: float = 0.0,
    certified: bool = True,
    progress: Progress | None = None,
    output: Path | str | None = None,
    threads: int | None = None,
) -> SolvedPath:
    """Solve as `solve` does, but return the finite-element state of every point of the path.

    Arguments and errors are those of `solve`.

    Example:
        >>> from epcontact.scene import Load, Material, Scene, Surface
        >>> heights = 0.01 * np.cos(2 * np.pi * np.arange(16) / 16)
        >>> scene = Scene(Surface(heights, (1.0,)), Material(1.0, 0.3), Load((0.01, 0.02)))
        >>> path = solve_path(scene, law="elastic", layers=8)
        >>> [point.state.displacement.shape for point in path.points]
        [(9, 16, 1, 3), (9, 16, 1, 3)]
    """
    require_kind("scene", scene, Scene)
    _check_names(scene, law, geometry)
    tolerance = share("tolerance", tolerance)
    step_tolerance = share("step_tolerance", step_tolerance)
    steps = None if steps is None else whole("steps", steps, 1)
    hardening = number("hardening", hardening, "0 or positive, in Pa", lambda v: 0 <= v < math.inf)
    begin = time.perf_counter()
    problem = problem_of(
        scene,
        law=law,
        geometry=geometry,
        depth=depth,
        layers=layers,
        first_layer=first_layer,
        hardening=hardening,
        certified=certified,
        threads=threads,
    )
    targets = path_targets(scene, problem, approach)
    highest = None if approach is None else float(problem.heights.max())
    rule = Rule(max(targets), steps, step_tolerance, highest, tolerance)
    followed = follow_path(problem, targets, rule)
    points: list[PathPoint] = []
    for point, history in followed:
        if output is not None:
            about = _about(scene, problem, law, geometry)
            write_step(Path(output), len(points), problem, point, history, about)
        points.append(point)
        if progress is not None:
            sentence = f"fem: mean pressure {point.mean_pressure:.3g} Pa"
            progress(len(points) / len(targets), sentence)
    if output is not None:
        write_collection(Path(output), [p.mean_pressure for p in points])
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
        "step_tolerance": step_tolerance,
    }
    certificate = _certificate(problem, points[-1], history, tolerance) if certified else {}
    return SolvedPath(scene, problem, history, tuple(points), seconds, options, certificate)


def _about(scene: Scene, problem: Problem, law: str, geometry: str) -> dict[str, str | float]:
    """The origin of a file: method, scene, material, body, versions."""
    material, versions = scene.material, package_versions()
    return {
        "method": "fem",
        "law": law,
        "geometry": geometry,
        "scene": scene.digest,
        "young_modulus": material.young_modulus,
        "poisson_ratio": material.poisson_ratio,
        "yield_stress": material.yield_stress,
        "hardness": material.hardness,
        "body": scene.body.kind,
        "depth": problem.block.depth,
        "notes": "; ".join(scene.surface.notes),
        **{f"version.{name}": number for name, number in versions.items()},
    }


def surface_compliance(
    scene: Scene,
    *,
    depth: float | None = None,
    layers: int | None = None,
    first_layer: float | None = None,
) -> FloatArray:
    """The compliance of the flat block's surface: its displacement under a wave of pressure.

    With it the boundary elements can solve exactly the same body.

    Args:
        scene: the surface's grid, the material and the body.
        depth, layers, first_layer: of the block, as in `solve`.

    Returns:
        m/Pa, one value for each mode of numpy.fft.rfft2 (rfft for a line) of the scene's grid.
        The mode q = 0 of a bonded layer is its depth over the oedometric modulus.

    Example:
        >>> from epcontact.scene import Body, Load, Material, Scene, Surface
        >>> layer = Body("bonded_layer", 0.5)
        >>> scene = Scene(Surface(np.zeros(8), (1.0,)), Material(1.0, 0.0), Load(0.01), layer)
        >>> float(surface_compliance(scene)[0].round(12))
        0.5
    """
    problem = problem_of(scene, depth=depth, layers=layers, first_layer=first_layer)
    nx, ny = problem.block.shape
    half = problem.factor.surface * problem.block.node_area
    if scene.surface.heights.ndim == 1:
        return half[:, 0].copy()
    mirrored = np.minimum(np.arange(nx), nx - np.arange(nx))
    return half[mirrored][:, : ny // 2 + 1].copy()


def problem_of(  # noqa: PLR0913 - the options of `solve` that make the problem
    scene: Scene,
    *,
    law: LawName = "elastic",
    geometry: Geometry = "gap",
    depth: float | None = None,
    layers: int | None = None,
    first_layer: float | None = None,
    hardening: float = 0.0,
    certified: bool = False,
    threads: int | None = 1,
) -> Problem:
    """The finite-element problem of a scene; arguments and errors as in `solve`."""
    material = scene.material
    block = block_for(
        scene, depth=depth, layers=layers, first_layer=first_layer, moved=geometry == "moved"
    )
    plastic = law == "j2"
    flow = None
    if plastic:
        limit = material.yield_stress
        stiff = material.young_modulus / (1 - material.poisson_ratio**2)
        severity = stiff * scene.surface.rms_slope / limit
        flow = flowing_shares(block, max(scene.load.path), limit, severity)
    require_memory(block, flow=flow, certified=certified)
    material_law = plasticity.law(
        material.young_modulus,
        material.poisson_ratio,
        material.yield_stress if plastic else math.inf,
        hardening,
    )
    flat = flat_elements(block)
    workers = Workers(available_cores() if threads is None else whole("threads", threads, 1))
    heights = scene.surface.heights.reshape(block.shape)
    return Problem(
        block,
        flat if geometry == "gap" else moved_elements(block),
        factorise(block, flat, material_law, workers),
        material_law,
        heights - heights.mean() if geometry == "moved" else heights,
        material.hardness * block.node_area if law == "capped" else math.inf,
        geometry == "gap",
        workers,
    )


def _check_names(scene: Scene, law: str, geometry: str) -> None:
    material = scene.material
    if law not in ("elastic", "capped", "j2"):
        raise InvalidScene(f"law is {law!r}, but must be elastic, capped or j2")
    if geometry not in ("gap", "moved"):
        raise InvalidScene(f"geometry is {geometry!r}, but must be gap or moved")
    if law == "j2" and not math.isfinite(material.yield_stress):
        raise InvalidScene("law j2 needs a finite yield_stress; give one or take law='elastic'")
    if law == "capped" and not math.isfinite(material.hardness):
        raise InvalidScene("law capped needs a finite hardness; give one or take law='elastic'")


def _certificate(
    problem: Problem, last: PathPoint, history: History, tolerance: float
) -> dict[str, float]:
    certificate = certify(problem, last.state, history, last.peak)
    # Ten times the tolerance: the certificate adds up forces in another order.
    if certificate["certified_balance"] > max(10 * tolerance, 1e-12):
        raise NotConverged(
            "scikit-fem's assembly does not confirm the converged state: its internal force "
            f"misses the contact forces by {certificate['certified_balance']:.1e}",
            residuals=certificate,
        )
    return certificate
