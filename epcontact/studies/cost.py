"""Studies of what the boundary elements cost: by method, by the size of the grid, by accuracy.

FFT pairs are counted; times are in bare FFT pairs of the same grid, timed in the same run, so that
a level line is growth as N log N.  The wall clock slows more for a solve than for the best of many
pairs on a busy machine; the processor time of all threads does not count cores that wait or work
for others.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import ducc0
import numpy as np
import pandas as pd

from epcontact import bem
from epcontact.errors import NotConverged
from epcontact.machine import available_cores, peak_memory
from epcontact.output.charts.plot import Plot
from epcontact.results import ContactResult
from epcontact.scene import Scene
from epcontact.studies.frame import Charts, Say, listed, rows, study
from epcontact.studies.paper_scene import LAWS, PAPER, PARTS, area_of, rough_scene

RESIDUAL, AREA = 1e-8, 1e-4
#: The accuracies to which a scene is solved, by name, as options of `bem.solve`.
TIGHT, LOOSE = f"residuals {RESIDUAL:g}", f"areas {AREA:g}"
AIMS: dict[str, dict[str, Any]] = {TIGHT: {"tolerance": RESIDUAL}, LOOSE: {"area_tolerance": AREA}}
#: Goals of a capped solve by points a side, in bare pairs; a solve to areas has a share of each.
GOALS = {128: 300.0, 256: 200.0, 512: 100.0, 1024: 65.0, 2048: 60.0, 4096: 50.0}
GOAL_SHARES = {TIGHT: 1.0, LOOSE: 0.6}

_SIDE = ("points_a_side", "grid points a side (–)")


class Cost(NamedTuple):
    """A result without its fields, the times of its solve in bare FFT pairs, and the largest
    memory of the process meanwhile (bytes)."""

    result: ContactResult
    time: float
    processor_time: float
    memory: int


def cost(scene: Scene, *, solves: int = 1, threads: int = 1, **options: Any) -> Cost:
    """Solve a scene several times; the least times of a solve and of the pairs between them."""
    shape, times, memories = scene.surface.shape, [], []
    pairs = [pair_times(shape, threads)]
    for _ in range(solves):
        found: list[ContactResult] = []
        started = time.perf_counter(), time.process_time()
        memories.append(
            peak_since(lambda: found.append(bem.solve(scene, threads=threads, **options)))  # noqa: B023 - called at once
        )
        times.append((time.perf_counter() - started[0], time.process_time() - started[1]))
        pairs.append(pair_times(shape, threads))
    wall, processor = np.min(times, axis=0) / np.min(pairs, axis=0)
    return Cost(replace(found[0], fields={}), float(wall), float(processor), max(memories))


def pair_times(shape: tuple[int, ...], threads: int, repeats: int = 5) -> tuple[float, float]:
    """The least wall-clock and processor time, in s, of a real FFT pair into existing arrays.

    New arrays would add the time for clearing their pages.
    """
    field, times = np.random.default_rng(1).random(shape), []
    modes = np.zeros((*shape[:-1], shape[-1] // 2 + 1), dtype=np.complex128)
    back = {"lastsize": shape[-1], "forward": False, "inorm": 2, "allow_overwriting_input": True}
    for _ in range(repeats):
        started = time.perf_counter(), time.process_time()
        ducc0.fft.r2c(field, out=modes, nthreads=threads)
        ducc0.fft.c2r(modes, out=field, nthreads=threads, **back)
        times.append((time.perf_counter() - started[0], time.process_time() - started[1]))
    wall, processor = np.min(times, axis=0)
    return float(wall), float(processor)


def peak_since(work: Callable[[], Any]) -> int:
    """The largest resident memory during `work`, in bytes (or since the process began, if the
    system cannot reset the count)."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    work()
    return peak_memory()


@study("bem", fast={"bandwidth": 32, "max_steps": 1000}, full={"bandwidth": 64, "max_steps": 2000})
def by_method(
    say: Say,
    bandwidth: int,
    max_steps: int,
    points: int = 8,
    methods: Sequence[str] = bem.METHODS,
    tolerances: Sequence[float] = tuple(10.0**-k for k in range(1, 11)),
) -> Charts:
    """Residual and area error of Newton and the baselines against FFT pairs and time.

    Areas are compared with those of the same grid solved to 1e-10.  A method that misses a
    tolerance within its steps has no further points.
    """
    scene, failures = rough_scene(points, 7, bandwidth), dict[str, str]()
    bem.solve(scene, tolerance=0.5, threads=1)  # compiled and cached before it is timed
    exact = bem.solve(scene, tolerance=1e-10, threads=1)

    def row(method: str, tolerance: float) -> list[dict[str, float]]:
        if method in failures:
            return []
        try:
            found = cost(scene, tolerance=tolerance, method=method, max_steps=max_steps)
        except NotConverged as error:
            reached = max(error.residuals.values(), default=math.nan)
            failures[method] = f"{method} stops at a residual of {reached:.1e}"
            return []
        result = found.result
        errors = [area_of(result, p, "raw") / area_of(exact, p, "raw") - 1 for p in PARTS]
        return [
            {
                "fft_pairs": result.cost["equivalent_fft_pairs"],
                "time_in_fft_pairs": found.time,
                "residual": max(result.final.residuals.values()),
                "relative_error": max(map(abs, errors)),
            }
        ]

    table = rows(say, row, method=methods, tolerance=tolerances)
    caption = (
        f"for {PAPER}, capped, {' x '.join(map(str, scene.surface.shape))} points, {points} per "
        "shortest wavelength. Newton starts from coarser grids, whose FFT pairs count by their "
        "points; the baselines start from a uniform pressure."
        + (f" Not converged: {', '.join(failures.values())}." if failures else "")
    )
    exact_areas = " Reference: the same grid solved to residuals of 1e-10."
    pairs = ("fft_pairs", "FFT pairs of the finest grid, coarser ones by their points (–)")
    residual = Plot(
        pairs, ("residual", "largest KKT residual (–)"), ("method",), log="xy", front=True
    )
    yield residual, table, f"Residual against work, {caption}"
    work = replace(residual, y=("relative_error", "relative error of the raw areas, largest (–)"))
    yield work, table, f"Error of the areas against work, {caption}{exact_areas}"
    timed = replace(work, x=("time_in_fft_pairs", "time in bare FFT pairs of the same grid (–)"))
    yield timed, table, f"Error of the areas against time on one thread, {caption}{exact_areas}"


@study(
    "growth",
    fast={"sides": (128, 256, 512, 1024)},
    full={"sides": (128, 256, 512, 1024, 2048, 4096)},
)
def growth(say: Say, sides: Sequence[int], waves: int = 16) -> Charts:
    """FFT pairs and time of boundary elements against the size of the grid."""
    bem.solve(rough_scene(4, 7, 8), threads=1)  # compiled and cached before it is timed

    def row(fixed: str, points_a_side: int) -> list[dict[str, Any]]:
        bandwidth = waves if fixed == "roughness fixed" else points_a_side // 4
        found = cost(rough_scene(points_a_side // bandwidth, 7, bandwidth), solves=2)
        counts = found.result.cost
        pairs = {"finest grid": counts["fft_pairs"], "all grids": counts["equivalent_fft_pairs"]}
        return [
            {"grids": grids, "fft_pairs": count, "time_in_fft_pairs": found.time}
            for grids, count in pairs.items()
        ]

    fixed = ("roughness fixed", "points per wavelength fixed")
    table = rows(say, row, fixed=fixed, points_a_side=sides)
    caption = (
        f"for {PAPER}, capped, to KKT residuals of 1e-8: with {waves} wavelengths a side and a "
        "growing number of points, and with 4 points per shortest wavelength and a growing number "
        "of wavelengths."
    )
    pairs = Plot(
        _SIDE,
        ("fft_pairs", "FFT pairs (–)"),
        series=("fixed", "grids"),
        log="x",
        ticks=sides,
        limits={"ylim": (0, None)},
    )
    yield pairs, table, f"FFT pairs of a solve {caption} Coarser grids count by their points."
    label = "time of a solve in bare FFT pairs of its grid (–)"
    yield (
        replace(pairs, y=("time_in_fft_pairs", label), series=("fixed",), log="xy", limits={}),
        table[table["grids"] == "all grids"],
        f"Time of a solve on one thread {caption} In units of one bare real FFT pair of the "
        "same grid, the least times of the same run; a level line grows as N log N.",
    )


#: The columns of `speed`, each with the label and the caption of its chart.
_SPEED = {
    "finest_pairs": ("FFT pairs of the finest grid (–)", "FFT pairs on the finest grid of a solve"),
    "all_pairs": (
        "FFT pairs of all grids, by their points (–)",
        "FFT pairs of a solve (those of coarser grids count by their points)",
    ),
    "time": (
        "time of a solve in bare FFT pairs of its grid (–)",
        "Time of a solve, coarse grids and all, in bare real FFT pairs of the finest grid (the "
        "least of several solves and of the pairs between them, with the same threads)",
    ),
    "processor_time": (
        "processor time of a solve in that of a bare FFT pair (–)",
        "Processor time of a solve, all threads together, in that of a bare real FFT pair of the "
        "finest grid; it does not see a core that waits or that others use",
    ),
    "area_error": (
        "relative error of the areas, largest (–)",
        "Largest relative difference of total, elastic and plastic area, raw or corrected, from "
        f"that of a solve to residuals of {RESIDUAL:g} on the same grid (open marks at the bottom "
        f"are zero; the goal is {AREA:g})",
    ),
    "bytes_per_point": (
        "largest memory of a solve (bytes per point)",
        "Largest resident memory of a solve, heights included, beyond what the process held "
        "before the first",
    ),
}


@study(
    "speed",
    fast={"sides": (512, 1024)},
    full={"sides": (128, 256, 512, 1024, 2048, 4096)},
)
def speed(
    say: Say, sides: Sequence[int], threads: int | None = None, solves: tuple[int, int] = (3, 10)
) -> Charts:
    """FFT pairs, time in bare FFT pairs, area errors and memory on the paper's scene.

    The fewest and most `solves` are of the largest and smallest grids.  Up to 1024 x 1024 points
    the least time is that of a solve that finds its symbol and operators prepared, as every one but
    the first in an ensemble does.
    """
    threads = threads or available_cores()
    bem.solve(rough_scene(4, 7, 8), threads=threads)  # compiled before it is timed
    held = peak_since(lambda: None)

    def row(points_a_side: int, law: str) -> list[dict[str, Any]]:
        bandwidth = min(256, points_a_side // 4)
        scene = rough_scene(points_a_side / bandwidth, 7, bandwidth, LAWS[law])
        count = min(solves[1], max(solves[0], 2**23 // points_a_side**2))
        costs = {
            aim: cost(scene, solves=count, threads=threads, **options)
            for aim, options in AIMS.items()
        }
        return [
            {
                "aim": aim,
                "finest_pairs": one.result.cost["fft_pairs"],
                "all_pairs": one.result.cost["equivalent_fft_pairs"],
                "time": one.time,
                "processor_time": one.processor_time,
                "area_error": area_difference(one.result, costs[TIGHT].result),
                "bytes_per_point": (one.memory - held) / points_a_side**2,
            }
            for aim, one in costs.items()
        ]

    table = rows(say, row, points_a_side=sides, law=LAWS)
    goals = pd.DataFrame({"points_a_side": GOALS.keys(), "goal": GOALS.values(), "law": "goal"})
    goals = goals[goals["points_a_side"].isin(sides)].merge(
        pd.DataFrame({"aim": GOAL_SHARES.keys(), "share": GOAL_SHARES.values()}), how="cross"
    )
    for column, (label, meaning) in _SPEED.items():
        error = column == "area_error"
        plot = Plot(
            _SIDE,
            (column, label),
            series=("law", "aim"),
            styles={"goal": "curve"},
            log="xy" if error else "x",
            ticks=sides,
            limits={} if error else {"ylim": (0, None)},
        )
        drawn = table[table["aim"] == LOOSE] if error else table
        if "time" in column:
            drawn = pd.concat([drawn, goals.assign(**{column: goals["goal"] * goals["share"]})])
        form = "{law}, {aim}: {" + column + ":.3g} at {points_a_side}²"
        yield (
            plot,
            drawn,
            f"{meaning}, for {PAPER}, capped and elastic, one surface with the paper's band of "
            "roughness or the widest that leaves 4 points to its shortest wave, solved to "
            f"residuals of {RESIDUAL:g} or to areas settled within {AREA:g} (relative). "
            f"{listed(drawn, form)}.",
        )


def area_difference(result: ContactResult, exact: ContactResult) -> float:
    """Largest relative difference of an area, raw or corrected, of those that are not zero."""
    pairs = [
        (area_of(result, part, kind), area_of(exact, part, kind))
        for kind in ("raw", "corrected")
        for part in PARTS
    ]
    return max(abs(a / b - 1) for a, b in pairs if b > 0)
