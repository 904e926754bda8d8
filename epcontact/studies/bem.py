"""The cost of the boundary-element solvers: residual and area error against work and time.

Every method solves one capped scene on one grid to the tolerances 1e-1, 1e-2, ...  Its figures are
the residual of the Karush-Kuhn-Tucker conditions, the error of its areas against the same problem
solved to 1e-10, its FFT pairs (those of coarser grids count by their points) and its time in bare
FFT pairs of the same grid, timed in the same run.  A method that misses a tolerance within its
steps has no further points.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import ducc0
import numpy as np
import pandas as pd

from epcontact import bem
from epcontact.bem import METHODS
from epcontact.errors import NotConverged
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.scene import Scene
from epcontact.studies.paper_scene import PARTS, area_of, rough_scene
from epcontact.studies.tables import Progress, Size, listed

TOLERANCES = tuple(10.0**-k for k in range(1, 11))


def bare_pair_times(shape: tuple[int, ...], threads: int, repeats: int = 5) -> tuple[float, float]:
    """Time one real FFT pair of a shape into existing arrays.

    Returns the least wall-clock time and the least processor time of all threads, in s.  New
    arrays would add the time for clearing their pages.
    """
    field, times = np.random.default_rng(1).random(shape), []
    modes = np.zeros((*shape[:-1], shape[-1] // 2 + 1), dtype=np.complex128)
    for _ in range(repeats):
        started = time.perf_counter(), time.process_time()
        ducc0.fft.r2c(field, out=modes, nthreads=threads)
        ducc0.fft.c2r(
            modes,
            lastsize=shape[-1],
            forward=False,
            inorm=2,
            out=field,
            nthreads=threads,
            allow_overwriting_input=True,
        )
        times.append((time.perf_counter() - started[0], time.process_time() - started[1]))
    wall, processor = np.min(times, axis=0)
    return float(wall), float(processor)


def solver_costs(
    scene: Scene,
    methods: Sequence[str],
    tolerances: Sequence[float] = TOLERANCES,
    *,
    max_steps: int = 1000,
    progress: Progress = lambda _: None,
) -> pd.DataFrame:
    """Solve the scene by every method at every tolerance, from loose to tight, on one thread.

    Args:
        scene: a scene whose contact is partly elastic and partly plastic.
        methods: methods of `bem.solve`.
        tolerances: tolerances on the residuals, in falling order.
        max_steps: number of steps after which a method has not converged.
        progress: called with a sentence before each method.

    Returns:
        One row for each method and tolerance: method, tolerance, residual (the largest), fft_pairs
        (of the finest grid, coarser ones by their points), relative_error (of the raw areas, the
        largest) and seconds.  A method that fails has a last row with its residual
        and its steps, in which fft_pairs and the later columns are NaN.
    """
    bem.solve(scene, tolerance=0.5, threads=1)  # compiled and cached before it is timed
    exact = bem.solve(scene, tolerance=1e-10, threads=1)
    rows = []
    for method in methods:
        progress(f"bem: {method}")
        for tolerance in tolerances:
            row = {"method": method, "tolerance": tolerance}
            started = time.perf_counter()
            try:
                result = bem.solve(
                    scene,
                    tolerance=tolerance,
                    method=method,  # type: ignore[arg-type]
                    max_steps=max_steps,
                    threads=1,
                )
            except NotConverged as error:
                reached = max(error.residuals.values(), default=math.nan)
                rows.append(row | {"residual": reached, "steps": len(error.history) - 1})
                break
            seconds = time.perf_counter() - started
            errors = [area_of(result, p, "raw") / area_of(exact, p, "raw") - 1 for p in PARTS]
            row |= {"residual": max(result.final.residuals.values())}
            row |= {"fft_pairs": result.cost["equivalent_fft_pairs"], "seconds": seconds}
            rows.append(row | {"relative_error": max(map(abs, errors))})
    columns = ["method", "tolerance", "residual", "fft_pairs", "relative_error", "seconds", "steps"]
    return pd.DataFrame(rows, columns=columns)


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Chart residual and area error against FFT pairs, and area error against time."""
    points, bandwidth, steps = (8, 32, 1000) if size == "fast" else (8, 64, 2000)
    scene = rough_scene(points, 7, bandwidth)
    costs = solver_costs(scene, METHODS, max_steps=steps, progress=progress)
    pair_seconds, _ = bare_pair_times(scene.surface.shape, 1)
    return draw_costs(costs, scene.surface.shape, pair_seconds)


def draw_costs(
    costs: pd.DataFrame, shape: tuple[int, ...], pair_seconds: float
) -> tuple[Chart, Chart, Chart]:
    """Draw the three charts of a table of costs.

    Args:
        costs: the table of `solver_costs`.
        shape: shape of the grid.
        pair_seconds: time of a bare FFT pair on it.
    """
    solved = costs.dropna(subset="fft_pairs")
    solved = solved.assign(time_in_fft_pairs=solved["seconds"] / pair_seconds)
    failed = costs[costs["fft_pairs"].isna()]
    reached = solved[solved["residual"] <= 1e-6].groupby("method", sort=False).first()
    failures = listed(
        failed, "{method} stops at a residual of {residual:.1e} after {steps:.0f} steps"
    )
    caption = (
        f"for the paper's roughness, material and load, capped, {' x '.join(map(str, shape))} "
        "points, 8 per shortest wavelength. Newton starts from coarser grids, whose FFT pairs "
        "count by their points; the baselines start from a uniform pressure. FFT pairs to a "
        f"residual of 1e-6: {listed(reached.reset_index(), '{method} {fft_pairs:.3g}')}."
        + (f" Not converged: {failures}." if failures else "")
    )
    exact = "Reference: the same grid solved to residuals of 1e-10."
    residual = Plot(
        ("fft_pairs", "FFT pairs of the finest grid, coarser ones by their points (–)"),
        ("residual", "largest KKT residual (–)"),
        series=("method",),
        log="xy",
        front=True,
    )
    work = replace(residual, y=("relative_error", "relative error of the raw areas, largest (–)"))
    timed = replace(work, x=("time_in_fft_pairs", "time in bare FFT pairs of the same grid (–)"))
    return (
        draw_table(solved, residual, f"Residual against work, {caption}"),
        draw_table(
            solved,
            work,
            f"Error of the areas against work, {caption} {exact} Errors of zero are drawn as open "
            "marks at the bottom.",
        ),
        draw_table(
            solved,
            timed,
            "Error of the areas against time on one thread, in units of one bare real FFT pair of "
            f"the same grid ({1e3 * pair_seconds:.2g} ms in the same run), {caption} {exact}",
        ),
    )
