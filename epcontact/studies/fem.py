"""What the finite elements need: elements, meshes, depth, load steps and linear solvers.

elements        a smooth strip punch in plane strain on bricks with and without mean dilatation,
                against Prandtl's limit (2 + pi) k: elements that lock do not find it
meshes          contact area of a J2 body against nodes per shortest wavelength
depth           the block's surface compliance of its longest waves against the half-space's
load steps      contact area of a J2 body against the number of increments
linear solvers  one elastic block, one force: time in products with its assembled matrix
load paths      iterations and time of a J2 load path against the nodes of the mesh
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from epcontact.errors import NotConverged
from epcontact.results import Areas, FloatArray
from epcontact.scene import Material, Scene, Surface
from epcontact.studies import Progress, Size
from epcontact.studies import paper_scene as scenes

if TYPE_CHECKING:
    from epcontact.output.charts.figures import Chart

YIELD_STRESS = scenes.HARDNESS / 3  # Tabor's ratio, as the paper takes it


def plastic_scene(points_per_wavelength: int, seed: int, bandwidth: int) -> Scene:
    """The paper's scene as a J2 body with Poisson's ratio 0.3 of the same E*."""
    scene = scenes.rough_scene(points_per_wavelength, seed, bandwidth)
    nu = 0.3
    return replace(
        scene, material=Material(scenes.MODULUS * (1 - nu**2), nu, math.inf, YIELD_STRESS)
    )


def flat_scene(points: int) -> Scene:
    """That body without roughness, on points x points nodes."""
    scene = plastic_scene(4, 7, 4)
    return scenes.on_surface(scene, Surface(np.zeros((points, points)), scene.surface.periods))


def punch_errors(counts: Sequence[int], mean_dilatation: bool) -> FloatArray:
    """(n,): error of the limit load by elements to the punch's half-width, relative; NaN where
    the solver does not converge, as on elements that lock."""
    from fem_check.benchmarks.limit_loads import strip_punch

    errors = []
    for count in counts:
        try:
            curve = strip_punch(count, mean_dilatation=mean_dilatation)
        except NotConverged:
            errors.append(math.nan)
        else:
            errors.append(abs(curve.computed[-1] / curve.exact[-1] - 1))
    return np.array(errors)


def mesh_errors(
    points: Sequence[int], finest: int, bandwidth: int, seeds: Sequence[int], progress: Progress
) -> tuple[dict[str, FloatArray], float]:
    """Errors (n,) of raw and corrected J2 contact area, root mean square over the surfaces, and
    the relative error that the reference, the corrected area on the finest mesh, claims."""
    tables = []
    for seed in seeds:
        progress(f"fem: meshes, seed {seed}")
        tables.append([_areas(plastic_scene(p, seed, bandwidth)) for p in (*points, finest)])
    exact = np.array([row[-1]["corrected"].total for row in tables])
    claimed = np.array([row[-1]["error"].total for row in tables])
    errors = {}
    for kind in ("raw", "corrected"):
        values = np.array([[one[kind].total for one in row[:-1]] for row in tables])
        errors[kind] = np.sqrt(np.mean((values / exact[:, None] - 1) ** 2, axis=0))
    return errors, float((claimed / exact).mean())


def step_errors(
    steps: Sequence[int], reference: int, bandwidth: int, seeds: Sequence[int], progress: Progress
) -> tuple[dict[str, FloatArray], FloatArray]:
    """(n,): errors of the J2 body's raw contact area and mean gap by its load increments, against
    `reference` of them, root mean square over the surfaces, and CG iterations, their mean."""
    errors: dict[str, list[list[float]]] = {"contact area": [], "mean gap": []}
    iterations = []
    for seed in seeds:
        progress(f"fem: load steps, seed {seed}")
        scene = plastic_scene(6, seed, bandwidth)
        found = [_solve(scene, steps=count) for count in (*steps, reference)]
        areas = [r.final.areas["raw"].total for r in found]
        gaps = [r.final.quantities["mean_gap"] for r in found]
        for name, values in (("contact area", areas), ("mean gap", gaps)):
            errors[name].append([value / values[-1] - 1 for value in values[:-1]])
        iterations.append([r.cost["cg_iterations"] for r in found[:-1]])
    squares = {name: np.mean(np.square(e), axis=0) for name, e in errors.items()}
    return {name: np.sqrt(square) for name, square in squares.items()}, np.mean(iterations, axis=0)


def _solve(scene: Scene, **options: Any) -> Any:
    import fem_check

    return fem_check.solve(scene, law="j2", certified=False, **options)


def _areas(scene: Scene, **options: Any) -> dict[str, Areas]:
    return dict(_solve(scene, **options).final.areas)


def depth_errors(depths: Sequence[float], waves: Sequence[int], points: int) -> FloatArray:
    """(waves, depths): the block's compliance of a wave over the half-space's 2/(E* q), less 1.

    depths: over the period; waves: in a period of `points` nodes.
    """
    import fem_check
    from epcontact.moduli import effective_modulus

    scene = flat_scene(points)
    period = scene.surface.periods[0]
    found = []
    for depth in depths:
        compliance = fem_check.surface_compliance(scene, depth=depth * period)
        q = 2 * math.pi / period * np.asarray(waves)
        exact = 2 / (effective_modulus(scene.material) * q)
        found.append(np.abs(compliance[0, list(waves)] / exact - 1))
    return np.array(found).T


@dataclass(frozen=True)
class LinearSolve:
    """One linear system: unknowns, seconds and relative residual by solver, and the seconds of
    one product with the assembled matrix."""

    unknowns: int
    seconds: dict[str, float]
    residuals: dict[str, float]
    product: float


def linear_solve(points: int) -> LinearSolve:
    """Solve an elastic block of points x points nodes a level under random forces.

    By the Fourier elimination of `fem_check`, by a sparse factorisation (SuperLU) and by
    conjugate gradients with the diagonal (to 1e-8).
    """
    import scipy.sparse.linalg as sla

    from fem_check.driver import problem_of
    from fem_check.linear_solver import eliminate, substitute

    problem = problem_of(flat_scene(points), law="elastic")
    shape = problem.block.field_shape
    free = 3 * math.prod(shape[:3]) - 3 * math.prod(shape[1:3])  # the base is held
    matrix = _assembled(problem)[:free, :free]
    force = np.zeros(shape)
    force.reshape(-1)[:free] = np.random.default_rng(1).standard_normal(free)
    right = force.reshape(-1)[:free]
    diagonal = sla.LinearOperator(matrix.shape, lambda v: v / matrix.diagonal())

    def fourier() -> FloatArray:
        spectrum = eliminate(problem.factor, force)
        solved = substitute(problem.factor, spectrum, np.zeros(shape[1:3]))
        return np.asarray(solved.reshape(-1)[:free])

    solvers: dict[str, Callable[[], FloatArray]] = {
        "Fourier elimination": fourier,
        "sparse factorisation": lambda: np.asarray(sla.splu(matrix.tocsc()).solve(right)),
        "conjugate gradients": lambda: np.asarray(sla.cg(matrix, right, rtol=1e-8, M=diagonal)[0]),
    }
    fourier()  # compiled before it is timed
    seconds, residuals = {}, {}
    for name, solver in solvers.items():
        started = time.perf_counter()
        u = solver()
        seconds[name] = time.perf_counter() - started
        residuals[name] = float(np.linalg.norm(matrix @ u - right) / np.linalg.norm(right))
    started = time.perf_counter()
    for _ in range(5):
        matrix @ right
    return LinearSolve(free, seconds, residuals, (time.perf_counter() - started) / 5)


@dataclass(frozen=True)
class PathGrowth:
    """What a J2 load path costs on meshes of n x n nodes, means over surfaces, (k,) each: CG and
    Newton iterations of the whole path, and seconds over those of a bare FFT pair."""

    nodes: Sequence[int]
    cg: FloatArray
    newton: FloatArray
    fft_pairs: FloatArray


def path_growth(
    meshes: Sequence[tuple[int, int]], seeds: Sequence[int], progress: Progress
) -> PathGrowth:
    """Solve the load paths of `fem_check.benchmarks.speed` on meshes of (nodes a side, layers)."""
    from fem_check.benchmarks.speed import fft_pair_seconds, speed_scene

    pair, rows = fft_pair_seconds(), []
    _solve(speed_scene(16))  # compiled before it is timed
    for nodes, layers in meshes:
        progress(f"fem: load paths, {nodes} x {nodes} x {layers}")
        costs = [_solve(speed_scene(nodes, seed=seed), layers=layers).cost for seed in seeds]
        counts = [(c["cg_iterations"], c["newton_steps"], c["seconds"] / pair) for c in costs]
        rows.append(np.mean(counts, axis=0))
    cg, newton, pairs = np.array(rows).T
    return PathGrowth([nodes for nodes, _ in meshes], cg, newton, pairs)


def _assembled(problem: Any) -> Any:
    """The elastic stiffness as a sparse matrix, rows 3 node + component."""
    from fem_check.benchmarks.limit_loads import sparse_matrix
    from fem_check.element import elastic_stiffness

    bricks, law = problem.bricks, problem.law
    shapes = range(bricks.weights.shape[0])
    stiffness = np.stack([elastic_stiffness(bricks, k, law.shear, law.bulk) for k in shapes])
    return sparse_matrix(
        bricks, stiffness[bricks.shape_of], math.prod(problem.block.field_shape[:3])
    )


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Elements, meshes, depths, load steps, linear solvers, load paths."""
    from epcontact.studies.fem_charts import (
        draw_depths,
        draw_linear_solvers,
        draw_meshes,
        draw_paths,
        draw_punch,
        draw_steps,
    )

    fast = size == "fast"
    progress("fem: elements")
    counts = [2, 3] if fast else [2, 3, 4, 6, 8]
    punch = {
        "mean dilatation": punch_errors(counts, True),
        "full integration": punch_errors(counts, False),
    }
    bandwidth, finest, seeds = (4, 10, range(7, 9)) if fast else (8, 16, range(7, 11))
    points = [3, 4, 6] if fast else [3, 4, 6, 8, 12]
    errors, claimed = mesh_errors(points, finest, bandwidth, seeds, progress)
    steps, many = ([1, 2, 4], 8) if fast else ([1, 2, 4, 8, 16], 32)
    off, iterations = step_errors(steps, many, bandwidth, seeds, progress)
    progress("fem: depths and linear solvers")
    depths, waves = [0.125, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0], [1, 2, 4]
    blocks = [linear_solve(n) for n in ((8, 12, 16) if fast else (8, 12, 16, 24))]
    sizes = [(16, 8), (32, 16), (64, 24)] if fast else [(32, 16), (64, 24), (128, 32)]
    surfaces = range(5, 7) if fast else range(5, 9)
    paths = path_growth(sizes, surfaces, progress)
    return (
        draw_punch(counts, punch),
        draw_meshes(points, errors, claimed, finest, (bandwidth, len(seeds))),
        draw_depths(depths, waves, depth_errors(depths, waves, 64)),
        draw_steps((*steps, many), off, iterations, (bandwidth, len(seeds))),
        draw_linear_solvers(blocks),
        draw_paths(paths, len(surfaces)),
    )
