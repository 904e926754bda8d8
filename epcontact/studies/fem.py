"""The error and cost of finite elements: elements, meshes, depth, load steps, linear solvers.

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
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import scipy.sparse.linalg as sla

import fem_check
from epcontact.errors import NotConverged
from epcontact.materials.moduli import effective_modulus
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.results import ContactResult
from epcontact.scene import Load, Material, Scene, Surface
from epcontact.studies.bem import bare_pair_times
from epcontact.studies.paper_scene import HARDNESS, MODULUS, area_of, rough_scene
from epcontact.studies.tables import Progress, Size, listed, root_mean_square
from fem_check.driver import problem_of
from fem_check.element import elastic_stiffness
from fem_check.limit_load import STRIP_LIMIT, assembled, strip_punch
from fem_check.linear_solver import eliminate, substitute
from fem_check.options import FemOptions

YIELD_STRESS = HARDNESS / 3  # Tabor's ratio, as in the paper
DEPTHS, WAVES = (0.125, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0), (1, 2, 4)


def plastic_scene(points_per_wavelength: int, seed: int, bandwidth: int) -> Scene:
    """The paper's scene as a J2 body with Poisson's ratio 0.3 of the same E*."""
    scene = rough_scene(points_per_wavelength, seed, bandwidth)
    material = Material(MODULUS * (1 - 0.3**2), 0.3, math.inf, YIELD_STRESS)
    return replace(scene, material=material)


def flat_scene(points: int) -> Scene:
    """The J2 body without roughness, on points x points nodes."""
    scene = plastic_scene(4, 7, 4)
    return replace(scene, surface=Surface(np.zeros((points, points)), scene.surface.periods))


def _solve(scene: Scene, **options: Any) -> ContactResult:
    result: ContactResult = fem_check.solve(scene, law="j2", certified=False, **options)
    return result


def punch_errors(counts: Sequence[int]) -> pd.DataFrame:
    """Errors of the limit load of a strip punch.

    Args:
        counts: numbers of elements in the half-width of the punch.

    Returns:
        One row for each formulation ("mean dilatation", "full integration") and count: formulation,
        elements, relative_error; NaN where the solver does not converge, as on elements that lock.
    """
    rows = []
    for formulation in ("mean dilatation", "full integration"):
        for count in counts:
            try:
                found = strip_punch(count, mean_dilatation=formulation == "mean dilatation")
                error = abs(found[-1] / STRIP_LIMIT - 1)
            except NotConverged:
                error = math.nan
            rows.append((formulation, count, error))
    return pd.DataFrame(rows, columns=["formulation", "elements", "relative_error"])


def mesh_errors(
    points: Sequence[int], bandwidth: int, seeds: Sequence[int], progress: Progress
) -> pd.DataFrame:
    """Errors of the contact area of the J2 body against the corrected one on the finest mesh.

    Args:
        points: nodes per shortest wavelength, rising; the last are those of the reference.
        bandwidth: highest over lowest wave number.
        seeds: one surface each.
        progress: called with a sentence before each surface.

    Returns:
        One row for each kind and mesh but the finest: kind ("raw", "corrected", "uncertainty of the
        reference"), nodes_per_wavelength, relative_error (root mean square over the surfaces; of
        the uncertainty the mean).
    """
    rows, worth = [], []
    for seed in seeds:
        progress(f"fem: meshes, seed {seed}")
        results = [_solve(plastic_scene(n, seed, bandwidth)) for n in points]
        exact = area_of(results[-1], "total")
        worth.append(area_of(results[-1], "total", "error") / exact)
        for kind in ("raw", "corrected"):
            errors = [area_of(result, "total", kind) / exact - 1 for result in results[:-1]]
            rows += [(kind, n, error) for n, error in zip(points, errors, strict=False)]
    claimed = float(np.mean(worth))
    rows += [("uncertainty of the reference", n, claimed) for n in points[:-1]]
    by = ["kind", "nodes_per_wavelength"]
    table = pd.DataFrame(rows, columns=[*by, "relative_error"])
    return root_mean_square(table, "relative_error", by)


def step_errors(
    steps: Sequence[int], bandwidth: int, seeds: Sequence[int], progress: Progress
) -> pd.DataFrame:
    """Errors of the J2 body's raw contact area and mean gap by its load increments.

    Args:
        steps: numbers of increments, rising; the last is the reference.
        bandwidth: highest over lowest wave number.
        seeds: one surface each.
        progress: called with a sentence before each surface.

    Returns:
        One row for each quantity ("contact area", "mean gap") and number of increments but the
        last: quantity, load_steps, relative_error (root mean square over the surfaces) and
        cg_iterations (mean).
    """
    rows = []
    for seed in seeds:
        progress(f"fem: load steps, seed {seed}")
        results = [_solve(plastic_scene(6, seed, bandwidth), steps=count) for count in steps]
        areas = [area_of(result, "total", "raw") for result in results]
        gaps = [result.final.quantities["mean_gap"] for result in results]
        for quantity, values in (("contact area", areas), ("mean gap", gaps)):
            for count, result, value in zip(steps[:-1], results, values, strict=False):
                error = value / values[-1] - 1
                rows.append((quantity, count, error, result.cost["cg_iterations"]))
    by = ["quantity", "load_steps"]
    table = pd.DataFrame(rows, columns=[*by, "relative_error", "cg_iterations"])
    iterations = table.groupby(by, sort=False)["cg_iterations"].mean().reset_index()
    return root_mean_square(table, "relative_error", by).merge(iterations, on=by)


def depth_errors(depths: Sequence[float], waves: Sequence[int], points: int) -> pd.DataFrame:
    """Return the block's compliance of a wave over the half-space's 2/(E* q), minus 1.

    Args:
        depths: over the period.
        waves: in a period.
        points: nodes a period.

    Returns:
        One row for each wave and depth: waves, depth_over_period, relative_error.
    """
    scene = flat_scene(points)
    period = scene.surface.periods[0]
    tables = []
    for depth in depths:
        compliance = fem_check.surface_compliance(scene, depth=depth * period)
        exact = 2 / (effective_modulus(scene.material) * 2 * math.pi / period * np.array(waves))
        error = np.abs(compliance[0, list(waves)] / exact - 1)
        columns = {"waves": waves, "depth_over_period": depth, "relative_error": error}
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables).sort_values("waves", kind="stable")


def linear_solves(points: int) -> pd.DataFrame:
    """Solve an elastic block with points x points nodes in each level under random forces.

    Returns:
        One row for each solver: solver (the Fourier elimination of `fem_check`, a sparse
        factorisation by SuperLU, conjugate gradients with the diagonal to 1e-8), unknowns,
        time_in_products (of the assembled matrix with a vector) and residual (relative).
    """
    problem = problem_of(flat_scene(points), FemOptions(law="elastic", certified=False))
    shape = problem.block.field_shape
    free = 3 * math.prod(shape[:3]) - 3 * math.prod(shape[1:3])  # the base is held
    matrix = _assembled(problem)[:free, :free]
    right = np.random.default_rng(1).standard_normal(free)
    force = np.append(right, np.zeros(math.prod(shape) - free)).reshape(shape)
    diagonal = sla.LinearOperator(matrix.shape, lambda v: v / matrix.diagonal())

    def fourier() -> Any:
        spectrum = eliminate(problem.factor, force)
        return substitute(problem.factor, spectrum, np.zeros(shape[1:3])).reshape(-1)[:free]

    solvers = {
        "Fourier elimination": fourier,
        "sparse factorisation": lambda: sla.splu(matrix.tocsc()).solve(right),
        "conjugate gradients": lambda: sla.cg(matrix, right, rtol=1e-8, M=diagonal)[0],
    }
    fourier()  # compiled before it is timed
    product = min(_timed(lambda: matrix @ right)[1] for _ in range(5))
    rows = []
    for name, solver in solvers.items():
        solution, seconds = _timed(solver)
        residual = float(np.linalg.norm(matrix @ solution - right) / np.linalg.norm(right))
        rows.append((name, free, seconds / product, residual))
    return pd.DataFrame(rows, columns=["solver", "unknowns", "time_in_products", "residual"])


def _timed(function: Any) -> tuple[Any, float]:
    started = time.perf_counter()
    answer = function()
    return answer, time.perf_counter() - started


def _assembled(problem: Any) -> Any:
    """The elastic stiffness as a sparse matrix, rows 3 node + component."""
    bricks, law = problem.bricks, problem.law
    shapes = range(bricks.weights.shape[0])
    stiffness = np.stack([elastic_stiffness(bricks, k, law.shear, law.bulk) for k in shapes])
    return assembled(bricks, stiffness[bricks.shape_of])


def speed_scene(nodes: int, *, load: float = 0.05, seed: int = 5) -> Scene:
    """A self-affine J2 scene of unit period with eight nodes to its shortest wave.

    `load` is the mean pressure in units of E* xi, which is 1 at the rms slope of 0.05; the yield
    stress is 0.2, and nu = 0.3.
    """
    frequency = np.abs(np.fft.fftfreq(nodes, 1 / nodes))
    q = np.hypot(frequency[:, None], frequency[None, :])
    inside = (q > 0) & (q <= nodes // 8)
    power = np.where(inside, np.where(inside, q, 1.0) ** -1.8, 0.0)
    noise = np.random.default_rng(seed).standard_normal(q.shape)
    heights = np.fft.ifftn(power * np.fft.fftn(noise)).real
    spectrum = np.abs(np.fft.fftn(heights)) / heights.size
    slope = np.sqrt(np.sum((2 * np.pi * q * spectrum) ** 2))
    return Scene(
        Surface(heights * 0.05 / slope, (1.0, 1.0), seed=seed),
        Material((1 - 0.3**2) / 0.05, 0.3, yield_stress=0.2),
        Load(load),
    )


def path_costs(
    meshes: Sequence[tuple[int, int]], seeds: Sequence[int], progress: Progress
) -> pd.DataFrame:
    """Solve load paths of four increments on one thread.

    Args:
        meshes: (nodes a side, layers) of each.
        seeds: one surface each.
        progress: called with a sentence before each mesh.

    Returns:
        One row for each mesh, means over the surfaces: nodes, the iterations of the whole path as
        "conjugate gradients" and "Newton", and time_in_fft_pairs (of 2048 x 2048 points).
    """
    rows = []
    _solve(speed_scene(16), layers=8, steps=4, threads=1)  # compiled before it is timed
    for nodes, layers in meshes:
        progress(f"fem: load paths, {nodes} x {nodes} x {layers}")
        for seed in seeds:
            scene, pair = speed_scene(nodes, seed=seed), bare_pair_times((2048, 2048), 1, 3)[1]
            begun = time.thread_time()  # other programs on the machine hardly disturb it
            cost = _solve(scene, layers=layers, steps=4, threads=1).cost
            seconds = time.thread_time() - begun
            rows.append((nodes, cost["cg_iterations"], cost["newton_steps"], seconds / pair))
    names = ["nodes", "conjugate gradients", "Newton", "time_in_fft_pairs"]
    return pd.DataFrame(rows, columns=names).groupby("nodes", sort=False).mean().reset_index()


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Chart elements, meshes, depths, load steps, linear solvers and load paths."""
    fast = size == "fast"
    progress("fem: elements")
    punch = punch_errors([2, 3] if fast else [2, 3, 4, 6, 8])
    bandwidth, seeds = (4, range(7, 9)) if fast else (8, range(7, 11))
    points = [3, 4, 6, 10] if fast else [3, 4, 6, 8, 12, 16]
    meshes = mesh_errors(points, bandwidth, seeds, progress)
    increments = [1, 2, 4, 8] if fast else [1, 2, 4, 8, 16, 32]
    steps = step_errors(increments, bandwidth, seeds, progress)
    progress("fem: depths and linear solvers")
    depths = depth_errors(DEPTHS, WAVES, 64)
    blocks = pd.concat([linear_solves(n) for n in ((8, 12, 16) if fast else (8, 12, 16, 24))])
    sizes = [(16, 8), (32, 16), (64, 24)] if fast else [(32, 16), (64, 24), (128, 32)]
    surfaces = range(5, 7) if fast else range(5, 9)
    paths = path_costs(sizes, surfaces, progress)
    sample = (
        f"{len(seeds)} surfaces (root mean square) of the paper's roughness, 1/{bandwidth} of its "
        "longest wave being the shortest, and load, yield_stress/(E* xi) = 0.2, Poisson's ratio 0.3"
    )
    return (
        draw_punch(punch),
        draw_meshes(meshes, f"{sample}. Reference: the corrected area at {points[-1]} nodes"),
        draw_depths(depths),
        draw_steps(steps, f"{sample}. Reference: {increments[-1]} increments"),
        draw_linear_solves(blocks),
        draw_paths(paths, len(surfaces)),
    )


def draw_punch(errors: pd.DataFrame) -> Chart:
    """Draw the error of the limit load against the elements in the punch's half-width."""
    lost = sorted(errors["formulation"][errors["relative_error"].isna()].unique())
    missing = f" Not converged where no point is: {', '.join(lost)}." if lost else ""
    return draw_table(
        errors,
        Plot(
            ("elements", "elements to the half-width of the punch (–)"),
            ("relative_error", "relative error of the limit load (–)"),
            series=("formulation",),
            log="xy",
            ticks=errors["elements"].unique().tolist(),
            orders=("mean dilatation", "full integration"),
        ),
        "Limit load of a smooth strip punch in plane strain, J2 body of Poisson's ratio 0.3, by "
        "bricks with mean dilatation and with full integration of all strain, against Prandtl's "
        "exact (2 + pi) k. The former misses by half an element's width, of first order; the "
        f"latter locks.{missing}",
    )


def draw_meshes(errors: pd.DataFrame, sample: str) -> Chart:
    """Draw the error of the J2 contact area against nodes per wavelength."""
    claimed = errors["kind"] == "uncertainty of the reference"
    return draw_table(
        errors.assign(style=np.where(claimed, "curve", "points")),
        Plot(
            ("nodes_per_wavelength", "nodes per shortest wavelength (–)"),
            ("relative_error", "relative error of the contact area (–)"),
            series=("kind",),
            log="xy",
            ticks=errors["nodes_per_wavelength"].unique().tolist(),
            orders=("raw", "corrected"),
        ),
        "Contact area of the J2 body against the mesh, as fine in depth at the surface: "
        f"{sample}, uncertain by {errors['relative_error'][claimed].iloc[0]:.1e} of itself.",
    )


def draw_depths(errors: pd.DataFrame) -> Chart:
    """Draw the difference between block and half-space compliance against the depth."""
    names = errors["waves"].map("{} waves a period".format)
    return draw_table(
        errors.assign(series=names.replace("1 waves a period", "one wave a period")),
        Plot(
            ("depth_over_period", "depth of the block over the period (–)"),
            ("relative_error", "compliance over half-space's, less 1 (–)"),
            log="xy",
            ticks=errors["depth_over_period"].unique().tolist(),
        ),
        "Difference of the surface compliance of the bonded finite-element block from that of the "
        "half-space, 2/(E* q), against its depth, for the longest waves, 64 nodes a period, "
        "Poisson's ratio 0.3. The part that no depth removes is the discretisation of each wave.",
    )


def draw_steps(errors: pd.DataFrame, sample: str) -> Chart:
    """Draw the errors of the J2 body against load increments."""
    gaps = errors[errors["quantity"] == "mean gap"]
    return draw_table(
        errors,
        Plot(
            ("load_steps", "load steps (–)"),
            ("relative_error", "relative error (–)"),
            series=("quantity",),
            log="xy",
            ticks=errors["load_steps"].unique().tolist(),
            orders=("mean gap",),
        ),
        "Raw contact area and mean gap of the J2 body, 6 nodes per shortest wavelength, against "
        f"the number of load increments: {sample}, which is a path of its own and not exact: "
        "differences of its order mean nothing. CG iterations of the whole path, mean: "
        f"{listed(gaps, '{load_steps}: {cg_iterations:.0f}')}. An error of zero (no node changed) "
        "is drawn as an open mark at the bottom.",
    )


def draw_linear_solves(solves: pd.DataFrame) -> Chart:
    """Draw the time of a linear solve, in products with the matrix, against unknowns."""
    worst = solves.groupby("solver", sort=False)["residual"].max().reset_index()
    return draw_table(
        solves,
        Plot(
            ("unknowns", "unknowns (–)"),
            ("time_in_products", "time in products with the assembled matrix (–)"),
            series=("solver",),
            log="xy",
        ),
        "One linear solve of an elastic block under random forces: Fourier transforms along the "
        "surface and elimination over the levels (its factorisation, made once a block, left "
        "out), sparse factorisation (SuperLU) and conjugate gradients with the diagonal. Time in "
        "products of the assembled sparse matrix with a vector, timed in the same run on one "
        f"thread. Largest relative residuals: {listed(worst, '{solver} {residual:.0e}')}.",
    )


def draw_paths(costs: pd.DataFrame, surfaces: int) -> Chart:
    """Draw the iterations of a load path against the mesh, with times in the caption."""
    growth = costs["conjugate gradients"].iloc[-1] / costs["conjugate gradients"].iloc[0]
    return draw_table(
        costs.melt("nodes", ["conjugate gradients", "Newton"], "solver", "iterations"),
        Plot(
            ("nodes", "nodes a side (–)"),
            ("iterations", "iterations of the load path (–)"),
            series=("solver",),
            log="x",
            ticks=costs["nodes"].tolist(),
        ),
        f"A J2 load path of 4 steps to p0/(E* xi) = 0.05, mean of {surfaces} surfaces whose "
        "shortest wave has 8 nodes, so that a finer mesh has more roughness; "
        "yield_stress/(E* xi) = 0.2, Poisson's ratio 0.3. From the coarsest to the finest mesh "
        f"the CG iterations grow by {growth:.2f}. Time of a path in bare FFT pairs of 2048 x 2048 "
        f"points, by nodes a side: {listed(costs, '{nodes:.0f}: {time_in_fft_pairs:.3g}')}.",
    )
