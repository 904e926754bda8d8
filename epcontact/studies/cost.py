"""Studies of the cost of boundary elements; `accuracy` has errors of areas against it.

Times are in bare FFT pairs of the same grid, timed in the same run, so that a level
line is growth as N log N.  On a busy machine the wall clock slows more for a solve than
for the best of many pairs.  The processor time of all threads does not count cores that
wait or work for others.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import ducc0
import numpy as np

from epcontact import bem
from epcontact.errors import NotConverged
from epcontact.machine import available_cores, forget_peak, peak_memory
from epcontact.output.charts.plot import Axis, Plot
from epcontact.results import ContactResult
from epcontact.scene import Scene
from epcontact.studies.baselines import METHODS
from epcontact.studies.frame import Charts, Ints, Rows, Say, study, tabulate
from epcontact.studies.paper_scene import LAWS, PARTS, area_of, rough_scene

#: The two accuracies to which a scene is solved: the tolerance of the residuals and the
#: relative change of the areas.
RESIDUAL = 1e-8
AREA = 1e-4
TIGHT = f"residuals {RESIDUAL:g}"
LOOSE = f"areas {AREA:g}"
#: These accuracies by their names, as options of `bem.solve`.
AIMS: dict[str, dict[str, Any]] = {
    TIGHT: {"tolerance": RESIDUAL},
    LOOSE: {"area_tolerance": AREA},
}

_SIDE = Axis("points_a_side", "grid points a side (–)")


def timed(function: Callable[[], Any]) -> tuple[Any, tuple[float, float]]:
    """Call a function without arguments and measure its time.

    Returns the value of the function, and the pair of wall-clock and processor time in
    s.
    """
    wall = time.perf_counter()
    processor = time.process_time()
    value = function()
    return value, (time.perf_counter() - wall, time.process_time() - processor)


def cost(
    scene: Scene, *, solves: int = 1, threads: int = 1, **options: Any
) -> tuple[ContactResult, dict[str, Any]]:
    """Solve a scene by boundary elements several times and measure the cost.

    Args:
        scene: The scene.
        solves: Number of solves, of which the least time counts.
        threads: Number of threads.
        options: Options of `bem.solve`.

    Returns:
        The result without fields, and a row: all_pairs (FFT pairs of all grids), time
        and processor_time (over those of a bare FFT pair, timed between the
        solves), memory (largest of the process meanwhile, in bytes).
    """
    shape = scene.surface.shape
    times = []
    pairs = [pair_times(shape, threads)]
    forget_peak()
    for _ in range(solves):
        result, spent = timed(lambda: bem.solve(scene, threads=threads, **options))
        times.append(spent)
        pairs.append(pair_times(shape, threads))
    wall, processor = (np.min(times, axis=0) / np.min(pairs, axis=0)).tolist()
    row = {
        "time": wall,
        "processor_time": processor,
        "all_pairs": result.cost["equivalent_fft_pairs"],
        "memory": peak_memory(),
    }
    return replace(result, fields={}), row


def pair_times(
    shape: tuple[int, ...], threads: int, repeats: int = 5
) -> tuple[float, float]:
    """Return the least wall-clock and processor time in s of a real FFT pair.

    A pair is a transform forward and one back.  The transforms write into existing
    arrays, because new arrays would add the time for clearing their pages.

    Args:
        shape: Shape of the grid.
        threads: Number of threads of a transform.
        repeats: Number of pairs, of which the least times are returned.
    """
    field = np.random.default_rng(1).random(shape)
    modes = np.zeros((*shape[:-1], shape[-1] // 2 + 1), dtype=np.complex128)

    def pair() -> None:
        """Transform the field (real to complex) and back, in place."""
        ducc0.fft.r2c(field, out=modes, nthreads=threads)
        ducc0.fft.c2r(
            modes,
            out=field,
            nthreads=threads,
            lastsize=shape[-1],
            forward=False,
            inorm=2,
            allow_overwriting_input=True,
        )

    wall, processor = np.min([timed(pair)[1] for _ in range(repeats)], axis=0)
    return float(wall), float(processor)


@study("bem", bandwidth=64, max_steps=2000)
def by_method(
    say: Say,
    bandwidth: int = 32,
    max_steps: int = 1000,
    points: int = 8,
    methods: Sequence[str] = tuple(METHODS),
    tolerances: Sequence[float] = tuple(10.0**-k for k in range(1, 11)),
) -> Charts:
    """Residual and area error of Newton and the baselines against FFT pairs.

    The scene is the paper's, and areas are compared with those of the same grid solved
    to 1e-10.  Newton starts from coarser grids, the baselines from a uniform pressure.
    A method that misses a tolerance within its steps has no further points.
    """
    scene = rough_scene(points, 7, bandwidth)
    failures: dict[str, str] = {}
    exact = bem.solve(scene, tolerance=1e-10, threads=1)

    def row(method: str, tolerance: float) -> Rows:
        """Return cost, residual and area error of a solve, as a list of one row.

        The list is empty if the method misses this tolerance or missed a looser one.
        """
        if method in failures:
            return []
        try:
            result = bem.solve(
                scene,
                tolerance=tolerance,
                threads=1,
                method=METHODS[method],
                max_steps=max_steps,
            )
        except NotConverged as error:
            residual = max(error.residuals.values(), default=math.nan)
            failures[method] = f" {method} stops at a residual of {residual:.1e}."
            return []
        values = {
            "fft_pairs": result.cost["equivalent_fft_pairs"],
            "residual": max(result.final.residuals.values()),
            "relative_error": area_difference(result, exact, ("raw",)),
        }
        return [values]

    table = tabulate(say, row, method=methods, tolerance=tolerances)
    failed = "".join(failures.values())
    work = Axis(
        "fft_pairs",
        "FFT pairs of the finest grid, coarser ones by their points (–)",
    )
    residual = Axis("residual", "largest KKT residual (–)")
    error = Axis("relative_error", "relative error of the raw areas, largest (–)")
    for y, question in (
        (residual, "How much work does a small residual take?"),
        (error, "How much work do accurate areas take?"),
    ):
        plot = Plot(work, y, ("method",), log="xy", front=True)
        yield plot, table, question + failed


#: The columns of `speed`, each with the label and the question of its chart.
_SPEED = {
    "all_pairs": (
        "FFT pairs of all grids, by their points (–)",
        "How many FFT pairs does a solve take?",
    ),
    "time": (
        "time of a solve in bare FFT pairs of its grid (–)",
        "How long does a user wait for a solve?",
    ),
    "processor_time": (
        "processor time of a solve in that of a bare FFT pair (–)",
        "How long does a solve keep the processor busy?",
    ),
    "area_error": (
        "relative error of the areas, largest (–)",
        "How accurate are areas that are solved to 1e-4?",
    ),
    "bytes_per_point": (
        "largest memory of a solve (bytes per point)",
        "How much memory does a solve take?",
    ),
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
    memory_before = peak_memory()
    fewest, most = solves

    def row(points_a_side: int, law: str) -> Rows:
        """Return cost and area error of one surface, a row for each accuracy of AIMS.

        The grid has `points_a_side` points along each direction; `law` is "capped" or
        "elastic".
        """
        bandwidth = min(256, points_a_side // 4)
        scene = rough_scene(points_a_side / bandwidth, 7, bandwidth, LAWS[law])
        count = min(most, max(fewest, 2**23 // points_a_side**2))
        found = {}
        for aim, options in AIMS.items():
            found[aim] = cost(
                scene,
                solves=count,
                threads=threads,
                **options,
            )
        exact, _ = found[TIGHT]
        rows = []
        for aim, (result, spent) in found.items():
            memory = spent["memory"] - memory_before
            rows.append(
                {
                    "aim": aim,
                    **spent,
                    "area_error": area_difference(result, exact),
                    "bytes_per_point": memory / points_a_side**2,
                }
            )
        return rows

    table = tabulate(say, row, points_a_side=sides, law=LAWS)
    for column, (label, question) in _SPEED.items():
        look: dict[str, Any] = {
            "colour": "law",
            "mark": "aim",
            "ticks": sides,
        }
        drawn = table
        if column == "area_error":
            look["log"] = "xy"
            drawn = table[table["aim"] == LOOSE]
        else:
            look["log"] = "x"
            look["limits"] = {"ylim": (0, None)}
        yield Plot(_SIDE, Axis(column, label), ("law", "aim"), **look), drawn, question


def area_difference(
    result: ContactResult,
    exact: ContactResult,
    kinds: Sequence[str] = ("raw", "corrected"),
) -> float:
    """Return the largest relative difference of the areas of two results.

    Args:
        result: The result.
        exact: The result that it is compared with; areas that are 0 here do not count.
        kinds: Kinds of areas that are compared.
    """
    largest = 0.0
    for part in PARTS:
        for kind in kinds:
            reference = area_of(exact, part, kind)
            if reference > 0:
                ratio = area_of(result, part, kind) / reference
                largest = max(largest, abs(ratio - 1))
    return largest
