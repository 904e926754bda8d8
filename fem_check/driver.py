"""Solve a scene with finite elements: `solve`, and `solve_path` for its finite-element
states.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from skfem import Basis, ElementHex1, LinearForm, MeshHex

from epcontact.errors import InvalidScene, NotConverged
from epcontact.files import write_collection
from epcontact.machine import available_cores, forget_peak
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Scene, integer, require_kind
from fem_check import plasticity
from fem_check.element import CORNERS
from fem_check.linear_solver import factorise
from fem_check.mesh import (
    PeriodicBlock,
    block_for,
    flat_elements,
    moved_elements,
    require_memory,
)
from fem_check.options import FemOptions
from fem_check.path import PathPoint, SolvedPath, follow_path, path_targets
from fem_check.plasticity import History
from fem_check.problem import Problem, State
from fem_check.result import contact_result
from fem_check.vtu import ENDS, mesh_of, write_step
from fem_check.workers import Workers

__all__ = ["FemOptions", "mesh_of", "solve", "solve_path", "surface_compliance"]

Progress = Callable[[float, str], None]


def solve(
    scene: Scene,
    options: FemOptions | None = None,
    *,
    progress: Progress | None = None,
    output: Path | str | None = None,
    threads: int | None = None,
    **changes: Any,
) -> ContactResult:
    """Solve the contact of a scene along its load path with finite elements.

    Args:
        scene: the surface, the material, the body and the mean pressures.
        options: how to solve it; the defaults of `FemOptions` if not given.
        progress: called with the share of the path that is done and a sentence.
        output: folder for the files of the body and its surface (.vtu) at each point of
            the path, and a .pvd over them.
        threads: that share the work, which gives the same bits on any number; None: all
            cores.
        changes: single options by name, as in `solve(scene, law="elastic",
            depth=1e-3)`.

    Returns:
        The result with one step for each point of the path and the fields of the last
        one.

    Raises:
        InvalidScene: the options contradict each other or the scene.
        NotConverged: an increment failed; the error holds the residuals of its
            iterations.
        NotEnoughMemory: the block would not fit.
        OutputError: a file could not be written.

    Example:
        >>> from epcontact.scene import Load, Material, Scene, Surface
        >>> heights = 0.01 * np.cos(2 * np.pi * np.arange(16) / 16)
        >>> scene = Scene(Surface(heights, (1.0,)), Material(1.0, 0.3), Load(0.01))
        >>> solve(scene, law="elastic").final.areas["raw"].total
        0.4375
    """
    return contact_result(
        solve_path(
            scene, options, progress=progress, output=output, threads=threads, **changes
        )
    )


def solve_path(
    scene: Scene,
    options: FemOptions | None = None,
    *,
    progress: Progress | None = None,
    output: Path | str | None = None,
    threads: int | None = None,
    **changes: Any,
) -> SolvedPath:
    """Solve as `solve` does, but return the finite-element state of every point of the
    path.

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
    options = replace(options or FemOptions(), **changes)
    begin = time.perf_counter()
    forget_peak()
    problem = problem_of(scene, options, threads)
    targets = path_targets(scene, problem, options)
    points: list[PathPoint] = []
    history = plasticity.initial_history(0)
    for point, history in follow_path(problem, targets, options):
        if output is not None:
            write_step(
                Path(output), len(points), scene, options, problem, point, history
            )
        points.append(point)
        if progress is not None:
            done = len(points) / len(targets)
            progress(done, f"fem: mean pressure {point.mean_pressure:.3g} Pa")
    if output is not None:
        pressures = [point.mean_pressure for point in points]
        write_collection(Path(output) / "path.pvd", pressures, ENDS)
    seconds = time.perf_counter() - begin
    last, certificate = points[-1], dict[str, float]()
    if options.certified:
        certificate = certify(problem, last.state, history, last.peak)
        # Ten times the tolerance: the certificate adds up forces in another order.
        if certificate["certified_balance"] > max(10 * options.tolerance, 1e-12):
            raise NotConverged(
                "scikit-fem's assembly does not confirm the converged state: its internal force "
                f"misses the contact forces by {certificate['certified_balance']:.1e}",
                residuals=certificate,
            )
    return SolvedPath(
        scene, options, problem, history, tuple(points), seconds, certificate
    )


def surface_compliance(scene: Scene, **block: Any) -> FloatArray:
    """The compliance of the block's surface, with which other methods can solve the
    same body.

    Args:
        scene: the surface's grid, the material and the body.
        block: its depth, layers and first_layer, as in `FemOptions`.

    Returns:
        m/Pa, one value for each mode of numpy.fft.rfft2 (rfft for a line) of the
        scene's grid. The mode q = 0 of a bonded layer is its depth over the oedometric
        modulus.

    Raises:
        InvalidScene: a length is not positive, or the depth is not that of the scene's
            layer.

    Example:
        >>> from epcontact.scene import Body, Load, Material, Scene, Surface
        >>> layer = Body("bonded_layer", 0.5)
        >>> scene = Scene(Surface(np.zeros(8), (1.0,)), Material(1.0, 0.0), Load(0.01), layer)
        >>> float(surface_compliance(scene)[0].round(12))
        0.5
    """
    problem = problem_of(scene, FemOptions(law="elastic", certified=False, **block))
    nx, ny = problem.block.shape
    half = problem.factor.surface * problem.block.node_area
    if scene.surface.heights.ndim == 1:
        return half[:, 0].copy()
    mirrored = np.minimum(np.arange(nx), nx - np.arange(nx))
    return half[mirrored][:, : ny // 2 + 1].copy()


def problem_of(scene: Scene, options: FemOptions, threads: int | None = 1) -> Problem:
    """The finite-element problem of a scene."""
    options.require_strengths(scene)
    material, moved = scene.material, options.geometry == "moved"
    block = block_for(scene, options)
    require_memory(scene, options, block)
    yield_stress = material.yield_stress if options.law == "j2" else math.inf
    law = plasticity.law(
        material.young_modulus, material.poisson_ratio, yield_stress, options.hardening
    )
    flat = flat_elements(block)
    workers = Workers(
        available_cores() if threads is None else integer("threads", threads, 1)
    )
    heights, tilt = scene.surface.heights.reshape(block.shape), None
    if options.geometry == "punch":
        if block.sliding:
            raise InvalidScene(
                "geometry is 'punch', which holds no sliding layer in its place"
            )
        tilt = slopes(heights, block.spacing)
    return Problem(
        block,
        moved_elements(block) if moved else flat,
        factorise(block, flat, law, workers),
        law,
        heights - heights.mean() if moved else heights,
        material.hardness * block.node_area if options.law == "capped" else math.inf,
        options.geometry == "gap",
        tilt,
        workers,
    )


def slopes(heights: FloatArray, spacing: tuple[float, float]) -> FloatArray:
    """(nx, ny, 2) slopes of periodic heights at the nodes, by differences of fourth
    order.
    """

    def apart(steps: int, axis: int) -> FloatArray:
        return np.asarray(
            np.roll(heights, -steps, axis) - np.roll(heights, steps, axis)
        )

    return np.stack(
        [(8 * apart(1, k) - apart(2, k)) / (12 * spacing[k]) for k in (0, 1)], axis=-1
    )


# --- an independent check of a converged state by scikit-fem
# -------------------------------------

#: Rows of the stress tensor as indices into xx, yy, zz, xy, yz, zx.
_ROWS = ((0, 3, 5), (3, 1, 4), (5, 4, 2))


def certify(
    problem: Problem, state: State, history: History, largest: float
) -> dict[str, float]:
    """Residuals, over the path's `largest` force, of the force that scikit-fem assembles.  Only the
    stresses come from the solver's own loops.  Their mean part is constant in an element, so that
    the standard form  int sigma : grad(v) dV  is the internal force of the B-bar element.
    """
    force, positions = np.zeros(problem.block.field_shape), problem.block.positions()
    for k in range(len(problem.block.layers)):
        stress, _ = problem.layer_stresses(state, history, k)
        force[k : k + 2] += _layer_force(problem.block, positions[k : k + 2], stress)
    reaction, pressed = float(force[-1, ..., 2].sum()), float(state.forces.sum())
    problem.turned_back(force)
    force[0, ..., 2] += state.forces
    total = largest or 1.0  # without any force on the path, all are zero
    return {
        "certified_balance": float(np.linalg.norm(problem.without_base(force))) / total,
        "certified_load": abs(reaction - pressed) / total,
    }


def _layer_force(
    block: PeriodicBlock, positions: FloatArray, stress: FloatArray
) -> FloatArray:
    """The internal force of one layer, as a mesh of scikit-fem with (nx + 1)(ny + 1)
    columns.
    """
    nx, ny = block.shape
    level, i, j = np.indices((2, nx + 1, ny + 1)).reshape(3, -1)
    at = level, i % nx, j % ny
    points = positions[at].T.copy()
    points[0] += (i == nx) * nx * block.spacing[0]
    points[1] += (j == ny) * ny * block.spacing[1]
    number = np.arange(level.size).reshape(2, nx + 1, ny + 1)
    cells = np.stack(
        [number[1 - z, x : nx + x, y : ny + y].ravel() for x, y, z in CORNERS]
    )
    mesh = MeshHex(points, cells, validate=False, sort_t=False)
    basis = Basis(mesh, ElementHex1(), intorder=2)
    form = LinearForm(
        lambda v, w: w["x_"] * v.grad[0] + w["y_"] * v.grad[1] + w["z_"] * v.grad[2]
    )
    out = np.zeros((2, nx, ny, 3))
    for component in range(3):
        x, y, z = stress[:, _ROWS[component]].swapaxes(0, 1)
        nodal = form.assemble(basis, x_=x, y_=y, z_=z)
        # Degree of freedom n of scikit-fem's scalar basis is not node n in general.
        np.add.at(out[..., component], at, nodal[basis.nodal_dofs[0]])
    return out
