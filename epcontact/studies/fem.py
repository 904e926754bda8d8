"""The study of the finite elements: elements, meshes, depth, load steps, linear solvers, paths."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import scipy.sparse.linalg as sla

import fem_check
from epcontact.errors import NotConverged
from epcontact.materials.moduli import effective_modulus
from epcontact.output.charts.plot import Plot
from epcontact.results import ContactResult
from epcontact.scene import Load, Material, Scene, Surface
from epcontact.studies.cost import pair_times
from epcontact.studies.frame import Charts, Say, listed, root_mean_square, rows, study
from epcontact.studies.paper_scene import CONSTRAINT, HARDNESS, MODULUS, area_of, rough_scene
from fem_check.driver import problem_of
from fem_check.element import elastic_stiffness
from fem_check.limit_load import STRIP_LIMIT, assembled, strip_punch
from fem_check.linear_solver import eliminate, substitute
from fem_check.options import FemOptions

DEPTHS, WAVES = (0.125, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0), (1, 2, 4)
REFERENCE = "uncertainty of the reference"


@study(
    "fem",
    fast={
        "elements": (2, 3),
        "nodes": (3, 4, 6, 10),
        "steps": (1, 2, 4, 8),
        "sample": (4, range(7, 9)),
        "blocks": (8, 12, 16),
        "paths": ([(16, 8), (32, 16), (64, 24)], range(5, 7)),
    },
    full={
        "elements": (2, 3, 4, 6, 8),
        "nodes": (3, 4, 6, 8, 12, 16),
        "steps": (1, 2, 4, 8, 16, 32),
        "sample": (8, range(7, 11)),
        "blocks": (8, 12, 16, 24),
        "paths": ([(32, 16), (64, 24), (128, 32)], range(5, 9)),
    },
)
def fem(
    say: Say,
    elements: Sequence[int],
    nodes: Sequence[int],
    steps: Sequence[int],
    sample: tuple[int, Sequence[int]],
    blocks: Sequence[int],
    paths: tuple[Sequence[tuple[int, int]], Sequence[int]],
) -> Charts:
    """Errors and costs of finite elements: element, mesh, depth, linear solver, load path.

    `sample` is the bandwidth of the J2 bodies and the seeds of their surfaces; `paths` are the
    meshes (nodes a side, layers) of the load paths and their seeds.
    """
    errors = rows(
        say, punch_error, formulation=("mean dilatation", "full integration"), elements=elements
    )
    lost = errors["formulation"][errors["relative_error"].isna()].unique()
    yield (
        _plot(
            ("elements", "elements to the half-width of the punch (–)"),
            "limit load",
            "formulation",
            elements,
        ),
        errors,
        "Limit load of a smooth strip punch in plane strain, J2 body of Poisson's ratio 0.3, by "
        "bricks with mean dilatation and with full integration of all strain, against Prandtl's "
        "exact (2 + pi) k. The former misses by half an element's width, of first order; the "
        f"latter locks.{f' Not converged where no point is: {lost[0]}.' if lost.size else ''}",
    )
    bandwidth, seeds = sample
    of_sample = (
        f"{len(seeds)} surfaces (root mean square) of the paper's roughness, 1/{bandwidth} of its "
        "longest wave being the shortest, and load, yield_stress/(E* xi) = 0.2, Poisson's ratio 0.3"
    )
    table = mesh_errors(say, nodes, bandwidth, seeds)
    worth = table["relative_error"][table["kind"] == REFERENCE].iloc[0]
    yield (
        _plot(
            ("nodes_per_wavelength", "nodes per shortest wavelength (–)"),
            "contact area",
            "kind",
            nodes[:-1],
        ),
        table,
        f"Contact area of the J2 body against the mesh, as fine in depth at the surface: "
        f"{of_sample}. Reference: the corrected area at {nodes[-1]} nodes, uncertain by "
        f"{worth:.1e} of itself.",
    )
    names = {1: "one wave a period"} | {n: f"{n} waves a period" for n in WAVES[1:]}
    table = rows(say, depth_error, waves=WAVES, depth_over_period=DEPTHS)
    yield (
        replace(
            _plot(("depth_over_period", "depth over the period (–)"), "", "series", DEPTHS),
            y=("relative_error", "compliance over half-space's, less 1 (–)"),
        ),
        table.assign(series=table["waves"].map(names)),
        "Difference of the surface compliance of the bonded finite-element block from that of the "
        "half-space, 2/(E* q), against its depth, for the longest waves, 64 nodes a period, "
        "Poisson's ratio 0.3. The part that no depth removes is the discretisation of each wave.",
    )
    table = step_errors(say, steps, bandwidth, seeds)
    gaps = table[table["quantity"] == "mean gap"]
    yield (
        _plot(("load_steps", "load steps (–)"), "", "quantity", steps[:-1]),
        table,
        "Raw contact area and mean gap of the J2 body, 6 nodes per shortest wavelength, against "
        f"the number of load increments: {of_sample}. Reference: {steps[-1]} increments, which is "
        "a path of its own and not exact: differences of its order mean nothing. CG iterations of "
        f"the whole path, mean: {listed(gaps, '{load_steps}: {cg_iterations:.0f}')}. An error of "
        "zero (no node changed) is drawn as an open mark at the bottom.",
    )
    solves = rows(say, linear_solves, nodes=blocks)
    worst = solves.groupby("solver", sort=False)["residual"].max().reset_index()
    yield (
        Plot(
            ("unknowns", "unknowns (–)"),
            ("time_in_products", "time in products with the assembled matrix (–)"),
            series=("solver",),
            log="xy",
        ),
        solves,
        "One linear solve of an elastic block under random forces: Fourier transforms along the "
        "surface and elimination over the levels (its factorisation, made once a block, left "
        "out), sparse factorisation (SuperLU) and conjugate gradients with the diagonal. Time in "
        "products of the assembled sparse matrix with a vector, timed in the same run on one "
        f"thread. Largest relative residuals: {listed(worst, '{solver} {residual:.0e}')}.",
    )
    costs = path_costs(say, *paths)
    growth = costs["conjugate gradients"].iloc[-1] / costs["conjugate gradients"].iloc[0]
    yield (
        Plot(
            ("nodes", "nodes a side (–)"),
            ("iterations", "iterations of the load path (–)"),
            series=("solver",),
            log="x",
            ticks=costs["nodes"].tolist(),
        ),
        costs.melt("nodes", ["conjugate gradients", "Newton"], "solver", "iterations"),
        f"A J2 load path of 4 steps to p0/(E* xi) = 0.05, mean of {len(paths[1])} surfaces whose "
        "shortest wave has 8 nodes, so that a finer mesh has more roughness; "
        "yield_stress/(E* xi) = 0.2, Poisson's ratio 0.3. From the coarsest to the finest mesh "
        f"the CG iterations grow by {growth:.2f}. Time of a path in bare FFT pairs of 2048 x 2048 "
        f"points, by nodes a side: {listed(costs, '{nodes:.0f}: {time_in_fft_pairs:.3g}')}.",
    )


def _plot(x: tuple[str, str], what: str, series: str, ticks: Sequence[float]) -> Plot:
    return Plot(
        x,
        ("relative_error", f"relative error of the {what} (–)" if what else "relative error (–)"),
        series=(series,),
        styles={REFERENCE: "curve"},
        log="xy",
        ticks=ticks,
        orders=("mean dilatation", "full integration", "raw", "corrected", "mean gap"),
    )


def plastic_scene(points_per_wavelength: int, seed: int, bandwidth: int) -> Scene:
    """The paper's scene as a J2 body with Poisson's ratio 0.3 of the same E*."""
    scene = rough_scene(points_per_wavelength, seed, bandwidth)
    material = Material(MODULUS * (1 - 0.3**2), 0.3, math.inf, HARDNESS / CONSTRAINT)
    return replace(scene, material=material)


def flat_scene(points: int) -> Scene:
    """The J2 body without roughness, on points x points nodes."""
    scene = plastic_scene(4, 7, 4)
    return replace(scene, surface=Surface(np.zeros((points, points)), scene.surface.periods))


def _solved(scene: Scene, **options: Any) -> ContactResult:
    result: ContactResult = fem_check.solve(scene, law="j2", certified=False, **options)
    return result


def punch_error(formulation: str, elements: int) -> dict[str, float]:
    """Error of the limit load of a strip punch with so many elements in its half-width; NaN where
    the solver does not converge, as on elements that lock."""
    try:
        found = strip_punch(elements, mean_dilatation=formulation == "mean dilatation")
    except NotConverged:
        return {"relative_error": math.nan}
    return {"relative_error": abs(found[-1] / STRIP_LIMIT - 1)}


def mesh_errors(
    say: Say, nodes: Sequence[int], bandwidth: int, seeds: Sequence[int]
) -> pd.DataFrame:
    """Errors of the J2 body's contact area against the corrected one on the finest mesh, root mean
    square over the surfaces: kind, nodes_per_wavelength, relative_error."""

    def row(seed: int) -> list[dict[str, Any]]:
        results = [_solved(plastic_scene(n, seed, bandwidth)) for n in nodes]
        exact = area_of(results[-1], "total")
        claimed = area_of(results[-1], "total", "error") / exact
        return [
            {"kind": kind, "nodes_per_wavelength": n, "relative_error": error}
            for n, result in zip(nodes[:-1], results, strict=False)
            for kind, error in (
                ("raw", area_of(result, "total", "raw") / exact - 1),
                ("corrected", area_of(result, "total") / exact - 1),
                (REFERENCE, claimed),
            )
        ]

    table = rows(say, row, seed=seeds)
    by = ["kind", "nodes_per_wavelength"]
    errors = root_mean_square(table, "relative_error", by)
    means = table.groupby(by, sort=False)["relative_error"].mean().to_numpy()
    errors["relative_error"] = errors["relative_error"].where(errors["kind"] != REFERENCE, means)
    return errors


def depth_error(waves: int, depth_over_period: float, points: int = 64) -> dict[str, float]:
    """The block's compliance of a wave over the half-space's 2/(E* q), minus 1."""
    scene = flat_scene(points)
    period = scene.surface.periods[0]
    compliance = fem_check.surface_compliance(scene, depth=depth_over_period * period)[0, waves]
    exact = 2 / (effective_modulus(scene.material) * 2 * math.pi / period * waves)
    return {"relative_error": abs(float(compliance) / exact - 1)}


def step_errors(
    say: Say, steps: Sequence[int], bandwidth: int, seeds: Sequence[int]
) -> pd.DataFrame:
    """Errors of the J2 body's raw contact area and mean gap against those with the most load
    increments, root mean square over the surfaces, and the mean of the CG iterations."""

    def row(seed: int) -> list[dict[str, Any]]:
        scene = plastic_scene(6, seed, bandwidth)
        results = [_solved(scene, steps=count) for count in steps]
        areas = [area_of(result, "total", "raw") for result in results]
        gaps = [result.final.quantities["mean_gap"] for result in results]
        return [
            {
                "quantity": quantity,
                "load_steps": count,
                "relative_error": value / values[-1] - 1,
                "cg_iterations": result.cost["cg_iterations"],
            }
            for quantity, values in (("contact area", areas), ("mean gap", gaps))
            for count, result, value in zip(steps[:-1], results, values, strict=False)
        ]

    table, by = rows(say, row, seed=seeds), ["quantity", "load_steps"]
    iterations = table.groupby(by, sort=False)["cg_iterations"].mean().reset_index()
    return root_mean_square(table, "relative_error", by).merge(iterations, on=by)


def linear_solves(nodes: int) -> list[dict[str, Any]]:
    """Solve an elastic block with nodes x nodes points in each level under random forces by each
    solver: unknowns, time in products of the assembled matrix with a vector, residual (relative).
    """
    problem = problem_of(flat_scene(nodes), FemOptions(law="elastic", certified=False))
    shape = problem.block.field_shape
    free = 3 * math.prod(shape[:3]) - 3 * math.prod(shape[1:3])  # the base is held
    matrix = _assembled(problem)[:free, :free]
    right = np.random.default_rng(1).standard_normal(free)
    force = np.append(right, np.zeros(math.prod(shape) - free)).reshape(shape)
    diagonal = sla.LinearOperator(matrix.shape, lambda v: v / matrix.diagonal())

    def fourier() -> Any:
        spectrum = eliminate(problem.factor, force)
        return substitute(problem.factor, spectrum, np.zeros(shape[1:3])).reshape(-1)[:free]

    solvers: dict[str, Callable[[], Any]] = {
        "Fourier elimination": fourier,
        "sparse factorisation": lambda: sla.splu(matrix.tocsc()).solve(right),
        "conjugate gradients": lambda: sla.cg(matrix, right, rtol=1e-8, M=diagonal)[0],
    }
    fourier()  # compiled before it is timed
    product = min(_timed(lambda: matrix @ right)[1] for _ in range(5))
    found = []
    for name, solver in solvers.items():
        solution, seconds = _timed(solver)
        residual = float(np.linalg.norm(matrix @ solution - right) / np.linalg.norm(right))
        row = {"solver": name, "unknowns": free, "time_in_products": seconds / product}
        found.append(row | {"residual": residual})
    return found


def _timed(function: Callable[[], Any]) -> tuple[Any, float]:
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


def path_costs(say: Say, meshes: Sequence[tuple[int, int]], seeds: Sequence[int]) -> pd.DataFrame:
    """Means over the surfaces of load paths in four increments on meshes (nodes a side, layers).

    Columns: nodes, the iterations of the whole path as "conjugate gradients" and "Newton", and
    time_in_fft_pairs (of 2048 x 2048 points), all on one thread.
    """

    def row(mesh: tuple[int, int], seed: int) -> dict[str, float]:
        scene, pair = speed_scene(mesh[0], seed=seed), pair_times((2048, 2048), 1, 3)[1]
        begun = time.thread_time()  # other programs on the machine hardly disturb it
        spent = _solved(scene, layers=mesh[1], steps=4, threads=1).cost
        return {
            "nodes": mesh[0],
            "conjugate gradients": spent["cg_iterations"],
            "Newton": spent["newton_steps"],
            "time_in_fft_pairs": (time.thread_time() - begun) / pair,
        }

    _solved(speed_scene(16), layers=8, steps=4, threads=1)  # compiled before it is timed
    table = rows(say, row, mesh=meshes, seed=seeds)
    return table.groupby("nodes", sort=False).mean(numeric_only=True).reset_index()
