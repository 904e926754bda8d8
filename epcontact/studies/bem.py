"""What the solvers of the boundary elements cost: residual and area error against work and time.

One capped scene, one grid, every method with the tolerances 1e-1, 1e-2, ...: the residual of the
Karush-Kuhn-Tucker conditions it reached, the error of its areas against the same problem solved
to 1e-10, the FFT pairs it took (those of coarser grids by their points) and its time, the latter
in bare FFT pairs of the same grid timed in the same run.  A method that does not reach a
tolerance within its steps has no more points.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from epcontact.errors import NotConverged
from epcontact.output.charts.figures import Series
from epcontact.output.charts.study import curves
from epcontact.results import FloatArray
from epcontact.studies import Progress, Size
from epcontact.studies import paper_scene as scenes

if TYPE_CHECKING:
    from epcontact.output.charts.figures import Chart
    from epcontact.scene import Scene

TOLERANCES = tuple(10.0**-k for k in range(1, 11))


@dataclass(frozen=True)
class Work:
    """One method at rising effort, (n,) each.

    residual: largest of the KKT residuals; pairs: equivalent FFT pairs of the finest grid;
    area_error: largest relative error of total, elastic and plastic raw area; seconds.
    failure: why there are no more points, or empty.
    """

    residual: FloatArray
    pairs: FloatArray
    area_error: FloatArray
    seconds: FloatArray
    failure: str = ""


def bare_pair_seconds(shape: tuple[int, ...], threads: int, repeats: int = 5) -> float:
    """The least time of one real FFT pair of that shape; see `bare_pair_times`."""
    return bare_pair_times(shape, threads, repeats)[0]


def bare_pair_times(shape: tuple[int, ...], threads: int, repeats: int = 5) -> tuple[float, float]:
    """The least wall-clock and the least processor time (all threads together), in s, of one real
    FFT pair of that shape, into arrays that are there already.

    Fresh arrays would have their pages cleared while the clock runs, and make the unit of every
    relative time longer than the transforms are.
    """
    import ducc0

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


def measure(
    scene: Scene,
    methods: Sequence[str],
    tolerances: Sequence[float] = TOLERANCES,
    *,
    max_steps: int = 1000,
    threads: int = 1,
    progress: Progress = lambda _: None,
) -> dict[str, Work]:
    """Solve the scene by every method at every tolerance, from loose to tight."""
    from epcontact import bem

    bem.solve(scene, tolerance=0.5, threads=threads)  # compiled and cached before it is timed
    exact = bem.solve(scene, tolerance=1e-10, threads=threads).final.areas["raw"]
    found = {}
    for method in methods:
        progress(f"bem: {method}")
        found[method] = _rising_effort(
            scene, method, tolerances, exact, max_steps=max_steps, threads=threads
        )
    return found


def _rising_effort(
    scene: Scene,
    method: str,
    tolerances: Sequence[float],
    exact: object,
    *,
    max_steps: int,
    threads: int,
) -> Work:
    from epcontact import bem

    rows: list[tuple[float, ...]] = []
    failure = ""
    for tolerance in tolerances:
        started = time.perf_counter()
        try:
            result = bem.solve(
                scene,
                tolerance=tolerance,
                method=method,  # type: ignore[arg-type]
                max_steps=max_steps,
                threads=threads,
            )
        except NotConverged as error:
            reached = max(error.residuals.values(), default=math.nan)
            steps = len(error.history) - 1
            failure = f"{method} stops at a residual of {reached:.1e} after {steps} steps"
            break
        seconds = time.perf_counter() - started
        raw = result.final.areas["raw"]
        off = max(abs(getattr(raw, p) / getattr(exact, p) - 1) for p in scenes.PARTS)
        residual = max(result.final.residuals.values())
        rows.append((residual, result.cost["equivalent_fft_pairs"], off, seconds))
    columns = np.array(rows).reshape(-1, 4).T
    return Work(columns[0], columns[1], columns[2], columns[3], failure)


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Residual against FFT pairs, area error against FFT pairs, area error against time."""
    from epcontact.bem import METHODS

    points, bandwidth, steps = (8, 32, 1000) if size == "fast" else (8, 64, 2000)
    scene = scenes.rough_scene(points, 7, bandwidth)
    found = measure(scene, METHODS, max_steps=steps, progress=progress)
    return draw_work(found, scene.surface.shape, bare_pair_seconds(scene.surface.shape, 1))


def draw_work(
    found: dict[str, Work], shape: tuple[int, ...], pair_seconds: float
) -> tuple[Chart, Chart, Chart]:
    """The three charts of a measurement."""
    shown = {name: work for name, work in found.items() if work.pairs.size}
    failures = "; ".join(w.failure for w in found.values() if w.failure)
    told = (
        f"for the paper's roughness, material and load, capped, {' x '.join(map(str, shape))} "
        "points, 8 per shortest wavelength. Newton starts from coarser grids, whose FFT pairs "
        f"count by their points; the baselines start from a uniform pressure. {_ratios(shown)}"
        + (f" Not converged: {failures}." if failures else "")
    )
    pairs = "FFT pairs of the finest grid, coarser ones by their points (–)"
    by_pairs = [Series(name, w.pairs, w.residual) for name, w in shown.items()]
    area = [Series(name, w.pairs, w.area_error) for name, w in shown.items()]
    timed = [Series(name, w.seconds / pair_seconds, w.area_error) for name, w in shown.items()]
    against = "relative error of the raw areas, largest (–)"
    reference = "Reference: the same grid solved to residuals of 1e-10."
    return (
        curves(
            by_pairs,
            x=pairs,
            y="largest KKT residual (–)",
            columns=("fft_pairs", "residual"),
            caption=f"Residual against work, {told}",
            log="xy",
            pareto=list(shown),
        ),
        curves(
            area,
            x=pairs,
            y=against,
            columns=("fft_pairs", "relative_error"),
            caption=f"Error of the areas against work, {told} {reference} Errors of zero are "
            "drawn as open marks at the bottom.",
            log="xy",
            pareto=list(shown),
            zeros=True,
        ),
        curves(
            timed,
            x="time in bare FFT pairs of the same grid (–)",
            y=against,
            columns=("time_in_fft_pairs", "relative_error"),
            caption=f"Error of the areas against time on one thread, in units of one bare real "
            f"FFT pair of the same grid ({1e3 * pair_seconds:.2g} ms in the same run), {told} "
            f"{reference}",
            log="xy",
            pareto=list(shown),
            zeros=True,
        ),
    )


def _ratios(found: dict[str, Work], target: float = 1e-6) -> str:
    """Work of each method over Newton's at the first residual within the target."""
    reached = {n: np.flatnonzero(w.residual <= target) for n, w in found.items()}
    pairs = {n: float(found[n].pairs[at[0]]) for n, at in reached.items() if at.size}
    if "newton" not in pairs:
        return ""
    others = ", ".join(
        f"{name} {count / pairs['newton']:.3g} times as many"
        for name, count in pairs.items()
        if name != "newton"
    )
    end = f"; {others}." if others else "."
    return f"To a residual of {target:g} Newton takes {pairs['newton']:.3g} pairs{end}"
