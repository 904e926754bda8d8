"""Solve a scene with finite elements.

`solve` returns a result, `solve_path` the finite-element states of the load path.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from epcontact.errors import InvalidScene, NotConverged
from epcontact.files import write_collection
from epcontact.machine import Stopwatch, available_cores, forget_peak
from epcontact.notebook import OnProgress, notebook_bar
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Scene, integer, require_kind
from fem_check import plain, plasticity
from fem_check.certificate import certify
from fem_check.linear_solver import factorise
from fem_check.mesh import block_for, flat_elements, moved_elements, require_memory
from fem_check.options import FemOptions
from fem_check.path import PathPoint, SolvedPath, path_targets, solve_points
from fem_check.plain_result import solve_plain
from fem_check.problem import Problem
from fem_check.result import contact_result
from fem_check.vtu import SUFFIXES, mesh_of, write_step
from fem_check.workers import Workers

__all__ = [
    "FemOptions",
    "mesh_of",
    "solve",
    "solve_path",
    "solve_plain",
    "surface_compliance",
]


def solve(
    scene: Scene,
    options: FemOptions | None = None,
    *,
    progress: OnProgress | None = None,
    output: Path | str | None = None,
    threads: int | None = None,
    **changes: Any,
) -> ContactResult:
    """Solve the contact of a scene along its load path with finite elements.

    Args:
        scene: the surface, the material, the body and the mean pressures.
        options: of the solve; None: the defaults of `FemOptions`.
        progress: called after each point of the path with the fraction of the points
            that are solved and a sentence.  Without it a notebook shows a bar.
        output: folder for the files of the body and its surface (.vtu) at each point of
            the path, and a .pvd over them; None: no files.
        threads: number of threads; the result has the same bits with any number.  None:
            as many as there are cores.
        changes: single options by name, as in `solve(scene, law="elastic",
            depth=1e-3)`.

    Returns:
        The result with one step for each point of the path and the fields of the last
        point.

    Raises:
        InvalidScene: the options contradict each other or the scene.
        NotConverged: an increment failed; the error holds the residuals of its
            iterations.
        NotEnoughMemory: the block does not fit into the free memory.
        OutputError: a file could not be written.

    Example:
        >>> from epcontact.scene import Load, Material, Scene, Surface
        >>> heights = 0.01 * np.cos(2 * np.pi * np.arange(16) / 16)
        >>> scene = Scene(Surface(heights, (1.0,)), Material(1.0, 0.3), Load(0.01))
        >>> solve(scene, law="elastic").final.areas["raw"].total
        0.4375
    """
    path = solve_path(
        scene, options, progress=progress, output=output, threads=threads, **changes
    )
    return contact_result(path)


def solve_path(
    scene: Scene,
    options: FemOptions | None = None,
    *,
    progress: OnProgress | None = None,
    output: Path | str | None = None,
    threads: int | None = None,
    **changes: Any,
) -> SolvedPath:
    """Solve the contact of a scene and return the finite-element state at every point.

    Args:
        scene: the surface, the material, the body and the mean pressures.
        options: of the solve; None: the defaults of `FemOptions`.
        progress: called after each point of the path with the fraction of the points
            that are solved and a sentence.
        output: folder for .vtu and .pvd files of the points; None: no files.
        threads: number of threads; None: as many as there are cores.
        changes: single options by name, as in `solve_path(scene, law="elastic")`.

    Returns:
        The problem, one state for each mean pressure (or each approach of the options),
        and the history of the elements at the end.

    Raises:
        InvalidScene: the options contradict each other or the scene.
        NotConverged: an increment failed, or scikit-fem does not confirm the last
            state.
        NotEnoughMemory: the block does not fit into the free memory.
        OutputError: a file could not be written.

    Example:
        >>> from epcontact.scene import Load, Material, Scene, Surface
        >>> surface = Surface(0.01 * np.cos(np.pi * np.arange(16) / 8), (1.0,))
        >>> scene = Scene(surface, Material(1.0, 0.3), Load((0.01, 0.02)))
        >>> path = solve_path(scene, law="elastic", layers=8)
        >>> [point.state.displacement.shape for point in path.points]
        [(9, 16, 1, 3), (9, 16, 1, 3)]
    """
    require_kind("scene", scene, Scene)
    options = replace(options or FemOptions(), **changes)
    begin = time.perf_counter()
    checking = Stopwatch()
    forget_peak()
    problem = problem_of(scene, options, threads)
    targets = path_targets(scene, problem, options)
    # Below the largest load the last increment may be elastic, and shows no flow.
    certified = {targets.index(max(targets)), len(targets) - 1}
    law = plain.law_of(scene.material, flows=problem.plastic)
    points: list[PathPoint] = []
    certificate: dict[str, float] = {}
    with notebook_bar(progress) as report:
        for point, before, history in solve_points(problem, targets, options):
            if output is not None:
                folder = Path(output)
                write_step(folder, len(points), scene, options, problem, point, history)
            if options.certified and len(points) in certified:
                with checking:
                    residuals = certify(
                        problem, law, point.state, before, history, point.peak
                    )
                _require_certificate(residuals, options.tolerance)
                for name, residual in residuals.items():
                    certificate[name] = max(residual, certificate.get(name, 0.0))
            points.append(point)
            if report is not None:
                fraction = len(points) / len(targets)
                report(fraction, f"fem: mean pressure {point.mean_pressure:.3g} Pa")
    if output is not None:
        pressures = [point.mean_pressure for point in points]
        write_collection(Path(output) / "path.pvd", pressures, SUFFIXES)
    seconds = time.perf_counter() - begin - checking.seconds
    return SolvedPath(
        scene, options, problem, history, tuple(points), seconds, certificate
    )


def _require_certificate(certificate: dict[str, float], tolerance: float) -> None:
    """Raise NotConverged if plain finite elements do not confirm a converged state.

    Args:
        certificate: residuals from `certify`; the balance and the flow are checked
            against ten times the tolerance, and at least 1e-12.
        tolerance: of the solve, dimensionless.
    """
    # The certificate adds up forces in another order, and may be ten times as large.
    largest = max(10 * tolerance, 1e-12)
    meanings = {
        "certified_balance": "the internal force differs from the contact forces",
        "certified_flow": "the plastic strains of the last increment differ",
    }
    for name, meaning in meanings.items():
        if not certificate.get(name, 0.0) <= largest:  # also if it is NaN
            raise NotConverged(
                f"plain scikit-fem does not confirm the converged state: {meaning} by "
                f"the fraction {certificate[name]:.1e}",
                residuals=certificate,
            )


def surface_compliance(scene: Scene, **block: Any) -> FloatArray:
    """Return the elastic compliance of the finite-element block's surface.

    With these values, other methods can solve exactly the same elastic body.

    Args:
        scene: the surface's grid, the material and the body.
        block: its depth, layers and first_layer, as in `FemOptions`.

    Returns:
        Downward displacement per pressure in m/Pa, one value for each mode of
        numpy.fft.rfft2 (nx, ny // 2 + 1) of the scene's grid, or of rfft for a line.
        The mode q = 0 of a bonded layer is its depth over the oedometric modulus.

    Raises:
        InvalidScene: a length is not positive, or the depth is not that of the scene's
            layer.
        NotEnoughMemory: the block does not fit into the free memory.

    Example:
        >>> from epcontact.scene import Body, Load, Material, Scene, Surface
        >>> surface = Surface(np.zeros(8), (1.0,))
        >>> layer = Body("bonded_layer", 0.5)
        >>> scene = Scene(surface, Material(1.0, 0.0), Load(0.01), layer)
        >>> float(surface_compliance(scene)[0].round(12))
        0.5
    """
    problem = problem_of(scene, FemOptions(law="elastic", certified=False, **block))
    nx, ny = problem.block.shape
    half = problem.factor.surface * problem.block.node_area
    if scene.surface.heights.ndim == 1:
        return half[:, 0].copy()
    # The factor has half of the modes along x, numpy half of those along y.
    mirrored = np.minimum(np.arange(nx), nx - np.arange(nx))
    return half[mirrored][:, : ny // 2 + 1].copy()


def problem_of(scene: Scene, options: FemOptions, threads: int | None = 1) -> Problem:
    """Return the finite-element problem of a scene, with the factorised stiffness.

    Args:
        scene: the surface, the material, the body and the mean pressures.
        options: of the solve.
        threads: number of threads of all later solves; None: as many as there are
            cores.

    Raises:
        InvalidScene: the options contradict the scene, the moved top is too rough for
            the layers, or `threads` is not a positive integer.
        NotEnoughMemory: the block does not fit into the free memory.
    """
    options.require_strengths(scene)
    material = scene.material
    block = block_for(scene, options)
    require_memory(scene, options, block)
    law = plasticity.law_of(material, flows=options.law == "j2")
    flat = flat_elements(block)
    if threads is None:
        threads = available_cores()
    workers = Workers(integer("threads", threads, 1))
    bricks = flat
    heights = scene.surface.heights.reshape(block.shape)
    tilt = None
    if options.geometry == "moved":
        bricks = moved_elements(block)
        heights = heights - heights.mean()
    elif options.geometry == "punch":
        if block.sliding:
            raise InvalidScene(
                "geometry is 'punch', under which a sliding layer would slide away; "
                "take geometry='gap' or a bonded layer"
            )
        tilt = slopes(heights, block.spacing)
    cap = math.inf
    if options.law == "capped":
        cap = material.hardness * block.node_area
    return Problem(
        block=block,
        bricks=bricks,
        factor=factorise(block, flat, law, workers),
        law=law,
        heights=heights,
        cap=cap,
        flat=options.geometry == "gap",
        tilt=tilt,
        workers=workers,
    )


def slopes(heights: FloatArray, spacing: tuple[float, float]) -> FloatArray:
    """Return the slopes of periodic heights, by differences of fourth order.

    Args:
        heights: (nx, ny) in m.
        spacing: (hx, hy) in m.

    Returns:
        (nx, ny, 2) slopes along x and y at the nodes.
    """

    def difference(nodes: int, axis: int) -> FloatArray:
        """Return (nx, ny) heights `nodes` ahead less those `nodes` behind, in m.

        The nodes are counted along `axis`, 0 for x or 1 for y.
        """
        ahead = np.roll(heights, -nodes, axis)
        return np.asarray(ahead - np.roll(heights, nodes, axis))

    along = [
        (8 * difference(1, axis) - difference(2, axis)) / (12 * spacing[axis])
        for axis in (0, 1)
    ]
    return np.stack(along, axis=-1)
