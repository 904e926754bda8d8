"""Studies of what boundary elements cost; `accuracy` has the errors of areas against
that.

Times are in bare FFT pairs of the same grid, timed in the same run, so that a level
line is growth as N log N.  The wall clock slows more for a solve than for the best of
many pairs on a busy machine; the processor time of all threads does not count cores
that wait or work for others.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import ducc0
import numpy as np

from epcontact import bem
from epcontact.errors import NotConverged
from epcontact.machine import available_cores, forget_peak, peak_memory
from epcontact.output.charts.plot import Plot
from epcontact.results import ContactResult
from epcontact.scene import Scene
from epcontact.studies.frame import Charts, Ints, Rows, Say, rows, study
from epcontact.studies.paper_scene import LAWS, PARTS, area_of, rough_scene

RESIDUAL, AREA = 1e-8, 1e-4
#: The accuracies to which a scene is solved, by name, as options of `bem.solve`.
TIGHT, LOOSE = f"residuals {RESIDUAL:g}", f"areas {AREA:g}"
AIMS: dict[str, dict[str, Any]] = {
    TIGHT: {"tolerance": RESIDUAL},
    LOOSE: {"area_tolerance": AREA},
}

_SIDE = ("points_a_side", "grid points a side (–)")


def timed(function: Callable[[], Any]) -> tuple[Any, tuple[float, float]]:
    """The answer of a function with its wall-clock and processor time in s."""
    started = time.perf_counter(), time.process_time()
    answer = function()
    return answer, (time.perf_counter() - started[0], time.process_time() - started[1])


def cost(
    scene: Scene, *, solves: int = 1, threads: int = 1, **options: Any
) -> tuple[ContactResult, dict[str, Any]]:
    """A result with its FFT pairs, the least times of several solves in those of the
    bare pairs between them, and the largest memory of the process meanwhile (bytes).
    """
    times, pairs = [], [pair_times(scene.surface.shape, threads)]
    forget_peak()
    for _ in range(solves):
        result, spent = timed(lambda: bem.solve(scene, threads=threads, **options))
        times.append(spent)
        pairs.append(pair_times(scene.surface.shape, threads))
    wall, processor = (np.min(times, axis=0) / np.min(pairs, axis=0)).tolist()
    told = {
        "finest_pairs": result.cost["fft_pairs"],
        "time": wall,
        "processor_time": processor,
    }
    told |= {"all_pairs": result.cost["equivalent_fft_pairs"], "memory": peak_memory()}
    return replace(result, fields={}), told


def pair_times(
    shape: tuple[int, ...], threads: int, repeats: int = 5
) -> tuple[float, float]:
    """The least wall-clock and processor time, in s, of a real FFT pair into existing
    arrays; new arrays would add the time for clearing their pages.
    """
    field = np.random.default_rng(1).random(shape)
    modes = np.zeros((*shape[:-1], shape[-1] // 2 + 1), dtype=np.complex128)
    back = {
        "lastsize": shape[-1],
        "forward": False,
        "inorm": 2,
        "allow_overwriting_input": True,
    }

    def pair() -> None:
        ducc0.fft.r2c(field, out=modes, nthreads=threads)
        ducc0.fft.c2r(modes, out=field, nthreads=threads, **back)

    wall, processor = np.min([timed(pair)[1] for _ in range(repeats)], axis=0)
    return float(wall), float(processor)


@study("bem", bandwidth=64, max_steps=2000)
def by_method(
    say: Say,
    bandwidth: int = 32,
    max_steps: int = 1000,
    points: int = 8,
    methods: Sequence[str] = bem.METHODS,
    tolerances: Sequence[float] = tuple(10.0**-k for k in range(1, 11)),
) -> Charts:
    """Residual and area error of Newton and the baselines against FFT pairs and time.

    The scene is the paper's, areas are compared with those of the same grid solved to
    1e-10, and times are on one thread.  Newton starts from coarser grids, the baselines
    from a uniform pressure.  A method that misses a tolerance within its steps has no
    further points.
    """
    scene, failures = rough_scene(points, 7, bandwidth), dict[str, str]()
    for method in methods:  # compiled and cached before it is timed
        bem.solve(scene, tolerance=0.5, method=method, threads=1)  # type: ignore[arg-type]
    exact = bem.solve(scene, tolerance=1e-10, threads=1)

    def row(method: str, tolerance: float) -> list[dict[str, float]]:
        if method in failures:
            return []
        try:
            options: Any = {
                "tolerance": tolerance,
                "method": method,
                "max_steps": max_steps,
            }
            result, spent = cost(scene, **options)
        except NotConverged as error:
            reached = max(error.residuals.values(), default=math.nan)
            failures[method] = f"; {method} stops at a residual of {reached:.1e}"
            return []
        told = {"fft_pairs": spent["all_pairs"], "time_in_fft_pairs": spent["time"]}
        told["residual"] = max(result.final.residuals.values())
        return [told | {"relative_error": area_difference(result, exact, ("raw",))}]

    table, failed = (
        rows(say, row, method=methods, tolerance=tolerances),
        "".join(failures.values()),
    )
    work = (
        "fft_pairs",
        "FFT pairs of the finest grid, coarser ones by their points (–)",
    )
    spent = ("time_in_fft_pairs", "time in bare FFT pairs of the same grid (–)")
    residual = ("residual", "largest KKT residual (–)")
    error = ("relative_error", "relative error of the raw areas, largest (–)")
    for x, y, title in (
        (work, residual, "Residual against work"),
        (work, error, "Error of the areas against work"),
        (spent, error, "Error of the areas against time"),
    ):
        yield Plot(x, y, ("method",), log="xy", front=True), table, title + failed


#: The columns of `speed`, each with the label of its chart.
_SPEED = {
    "finest_pairs": "FFT pairs of the finest grid (–)",
    "all_pairs": "FFT pairs of all grids, by their points (–)",
    "time": "time of a solve in bare FFT pairs of its grid (–)",
    "processor_time": "processor time of a solve in that of a bare FFT pair (–)",
    "area_error": "relative error of the areas, largest (–)",
    "bytes_per_point": "largest memory of a solve (bytes per point)",
}


@study("speed", sides=(128, 256, 512, 1024, 2048, 4096))
def speed(
    say: Say,
    sides: Ints = (512, 1024),
    threads: int | None = None,
    solves: Ints = (3, 10),
) -> Charts:
    """FFT pairs, time in bare FFT pairs, area errors and memory on the paper's scene.

    The band is the paper's, or the widest that leaves 4 points to its shortest wave.
    The fewest and most solves are of the largest and smallest grids.  Up to 1024 x 1024
    points the least time is that of a solve that finds its symbol and operators
    prepared, as every one but the first in an ensemble does.  Areas are compared with
    those of a solve to residuals of 1e-8.
    """
    threads = threads or available_cores()
    bem.solve(rough_scene(4, 7, 8), threads=threads)  # compiled before it is timed
    forget_peak()
    held = peak_memory()

    def row(points_a_side: int, law: str) -> Rows:
        bandwidth = min(256, points_a_side // 4)
        scene = rough_scene(points_a_side / bandwidth, 7, bandwidth, LAWS[law])
        count = min(solves[1], max(solves[0], 2**23 // points_a_side**2))
        options = {"solves": count, "threads": threads}
        costs, found = {aim: cost(scene, **options, **AIMS[aim]) for aim in AIMS}, []
        for aim, (result, spent) in costs.items():
            errors = {"area_error": area_difference(result, costs[TIGHT][0])}
            errors["bytes_per_point"] = (spent["memory"] - held) / points_a_side**2
            found.append({"aim": aim} | spent | errors)
        return found

    table = rows(say, row, points_a_side=sides, law=LAWS)
    for column, label in _SPEED.items():
        error = column == "area_error"
        look: Any = (
            {"log": "xy"} if error else {"log": "x", "limits": {"ylim": (0, None)}}
        )
        look |= {"colour": "law", "mark": "aim", "ticks": sides}
        drawn = table[table["aim"] == LOOSE] if error else table
        title = f"{label[0].upper()}{label[1:].partition(' (')[0]}"
        yield Plot(_SIDE, (column, label), ("law", "aim"), **look), drawn, title


def area_difference(
    result: ContactResult,
    exact: ContactResult,
    kinds: Sequence[str] = ("raw", "corrected"),
) -> float:
    """Largest relative difference of an area of these kinds, of those that are not
    zero.
    """
    areas = [*product(PARTS, kinds)]
    pairs = [(area_of(result, *area), area_of(exact, *area)) for area in areas]
    return max(abs(a / b - 1) for a, b in pairs if b > 0)
