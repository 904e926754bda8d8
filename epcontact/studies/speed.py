"""The cost of a solve by boundary elements, in counts and in bare FFT pairs.

The paper's scene, capped and elastic, is solved on ever finer grids, both to small residuals and to
settled areas.  FFT pairs are counted on the finest grid, and on all grids by their points.  The
time of the whole solve, with coarse grids and areas, is divided by that of one bare pair (r2c and
c2r by ducc0 into existing arrays) of the same grid on the same threads, timed between the solves.
Up to 1024 x 1024 points the least time is that of a solve that finds its symbol and operators
prepared, as every one but the first in an ensemble does.  Two clocks are used: the wall clock,
which a busy machine slows more for a solve than for the best of many pairs, and the processor time
of all threads, which does not count cores that wait or work for others.  Areas are compared with
the solve to residuals on the same grid.  Memory is the largest resident set of a solve minus that
of the process before the first solve.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from epcontact import bem
from epcontact.machine import available_cores, peak_memory
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.results import ContactResult
from epcontact.scene import Scene
from epcontact.studies.bem import bare_pair_times
from epcontact.studies.paper_scene import LAWS, PARTS, area_of, rough_scene
from epcontact.studies.tables import Progress, Size, listed

RESIDUAL, AREA = 1e-8, 1e-4
#: The accuracies to which each grid is solved, by name, as options of `bem.solve`.
TIGHT, LOOSE = f"residuals {RESIDUAL:g}", f"areas {AREA:g}"
AIMS: dict[str, dict[str, Any]] = {TIGHT: {"tolerance": RESIDUAL}, LOOSE: {"area_tolerance": AREA}}
#: Goals of a capped solve by points a side, in bare pairs; a solve to areas has a share of each.
GOALS = {128: 300.0, 256: 200.0, 512: 100.0, 1024: 65.0, 2048: 60.0, 4096: 50.0}
GOAL_SHARES = {TIGHT: 1.0, LOOSE: 0.6}
BANDWIDTH, FEWEST_POINTS = 256, 4
#: Number of solves, of which the least time is taken; the most on small grids.
FEWEST_SOLVES, MOST_SOLVES = 3, 10

_Run = tuple[ContactResult, tuple[float, float], int]


def solve_costs(
    sides: Sequence[int],
    progress: Progress,
    *,
    threads: int | None = None,
    most_solves: int = MOST_SOLVES,
) -> pd.DataFrame:
    """Solve one surface on each grid, under both laws and to both aims.

    Args:
        sides: points a side of the grids, rising.  A grid that is too coarse for the paper's band
            of roughness has the widest one that leaves FEWEST_POINTS per shortest wavelength.
        progress: called with a sentence before each grid and law.
        threads: of the solves and of the bare pairs; None: all cores.
        most_solves: of which the least time is taken.

    Returns:
        One row for each law, grid and aim: law, points_a_side, points_per_wavelength, aim;
        finest_pairs and all_pairs (by their points); time and processor_time, in those of a bare
        pair; area_error, the largest relative difference of an area from that of the solve to
        residuals; bytes_per_point.
    """
    threads = threads or available_cores()
    bem.solve(rough_scene(4, 7, 8), threads=threads)  # compiled before it is timed
    held = _peak_since(lambda: None)
    rows = []
    for side in sides:
        bandwidth = min(BANDWIDTH, side // FEWEST_POINTS)
        grid = {"points_a_side": side, "points_per_wavelength": side / bandwidth}
        for law, hardness in LAWS.items():
            progress(f"speed: {side} x {side} points, {law}")
            scene = rough_scene(side / bandwidth, 7, bandwidth, hardness)
            count = min(most_solves, max(FEWEST_SOLVES, 2**23 // side**2))
            rows += [{"law": law} | grid | row for row in _costs(scene, threads, held, count)]
    return pd.DataFrame(rows)


def _costs(scene: Scene, threads: int, held: int, count: int) -> list[dict[str, Any]]:
    """The costs of one scene, one row for each aim; `held` is the memory before the first solve."""
    shape, points = scene.surface.shape, scene.surface.heights.size
    pairs = [bare_pair_times(shape, threads)]
    runs: dict[str, list[_Run]] = {aim: [] for aim in AIMS}
    for _ in range(count):  # in turns, so that a busy moment of the machine slows both aims
        for aim, options in AIMS.items():
            runs[aim].append(_watched(scene, options, threads))
        pairs.append(bare_pair_times(shape, threads))
    exact = runs[TIGHT][0][0]
    rows = []
    for aim, solved in runs.items():
        result = solved[0][0]
        wall, processor = np.min([t for _, t, _ in solved], axis=0) / np.min(pairs, axis=0)
        rows.append(
            {
                "aim": aim,
                "finest_pairs": result.cost["fft_pairs"],
                "all_pairs": result.cost["equivalent_fft_pairs"],
                "time": wall,
                "processor_time": processor,
                "area_error": area_difference(result, exact),
                "bytes_per_point": (max(memory for *_, memory in solved) - held) / points,
            }
        )
    return rows


def _watched(scene: Scene, options: Mapping[str, Any], threads: int) -> _Run:
    """A result without its fields, its wall-clock and processor time (s), and the largest memory
    of the process meanwhile (bytes)."""
    results: list[ContactResult] = []
    started = time.perf_counter(), time.process_time()
    memory = _peak_since(lambda: results.append(bem.solve(scene, threads=threads, **options)))
    times = time.perf_counter() - started[0], time.process_time() - started[1]
    return replace(results[0], fields={}), times, memory


def _peak_since(work: Callable[[], None]) -> int:
    """Return the largest resident memory during `work`, in bytes (or since the process began, if
    the system cannot reset the count)."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    work()
    return peak_memory()


def area_difference(result: ContactResult, exact: ContactResult) -> float:
    """Largest relative difference of an area, raw or corrected, of those that are not zero."""
    pairs = [
        (area_of(result, part, kind), area_of(exact, part, kind))
        for kind in ("raw", "corrected")
        for part in PARTS
    ]
    return max(abs(a / b - 1) for a, b in pairs if b > 0)


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Chart FFT pairs, time in bare pairs, error of the areas and memory against the grid."""
    sides = [512, 1024] if size == "fast" else [128, 256, 512, 1024, 2048, 4096]
    return draw_speed(solve_costs(sides, progress))


#: The label and the caption of each chart; "area_error" is drawn only for solves to areas.
_CHARTS = {
    "finest_pairs": (
        "FFT pairs of the finest grid (–)",
        "FFT pairs on the finest grid of a solve",
    ),
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


def draw_speed(costs: pd.DataFrame) -> tuple[Chart, ...]:
    """Charts of FFT pairs (finest grid, all grids), times, the areas' errors and memory; `costs`
    as `solve_costs` makes it."""
    sides = costs[["points_a_side", "points_per_wavelength"]].drop_duplicates()
    scene = (
        "for the paper's roughness, material and load, capped and elastic, one surface on grids "
        "of so many points (per shortest wavelength): "
        f"{listed(sides, '{points_a_side:.0f}² ({points_per_wavelength:g})')}; solved to "
        f"residuals of {RESIDUAL:g} or to areas settled within {AREA:g} (relative)"
    )
    aimed_at = sides.assign(goal=sides["points_a_side"].map(GOALS)).dropna()
    drawn = []
    for column, (label, meaning) in _CHARTS.items():
        error = column == "area_error"
        table = costs[costs["aim"] == LOOSE] if error else costs
        goals = [
            aimed_at.assign(
                law="goal", aim=aim, style="curve", **{column: share * aimed_at["goal"]}
            )
            for aim, share in GOAL_SHARES.items()
            if "time" in column and len(aimed_at)
        ]
        plot = Plot(
            ("points_a_side", "grid points a side (–)"),
            (column, label),
            series=("law", "aim"),
            log="xy" if error else "x",
            ticks=sides["points_a_side"].tolist(),
            limits={} if error else {"ylim": (0, None)},
        )
        form = "{law}, {aim}: {" + column + ":.3g} at {points_a_side}²"
        goal = " Goals (lines) are for the capped body." if goals else ""
        caption = f"{meaning}, {scene}. {listed(table, form)}.{goal}"
        drawn.append(draw_table(pd.concat([table, *goals]), plot, caption))
    return tuple(drawn)
