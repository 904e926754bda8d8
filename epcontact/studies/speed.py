"""What a solve by boundary elements costs, told in counts and in bare FFT pairs.

The paper's scene, capped and elastic, on finer and finer grids, each solved to residuals and to
areas.  Counted are the FFT pairs of the finest grid and those of all grids by their points.
Timed is the whole solve, coarse grids, symbol and areas included, against one bare pair (r2c and
c2r by ducc0 into arrays that are there already) of the same grid on the same threads, between
the solves: by the wall clock, which a busy machine slows more for a solve than for the best
of many pairs, and by the processor time of all threads, which does not see a core that waits or
belongs to others.  Areas are judged by those of the solve to residuals on the same grid; memory is
the largest resident set of a solve, beyond what the process held before the first.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from epcontact.output.charts.figures import Series
from epcontact.output.charts.study import curves
from epcontact.studies import Progress, Size
from epcontact.studies import paper_scene as scenes
from epcontact.studies.bem import bare_pair_times

if TYPE_CHECKING:
    from epcontact.output.charts.figures import Chart
    from epcontact.results import ContactResult
    from epcontact.scene import Scene

RESIDUAL, AREA = 1e-8, 1e-4
#: What a solve is asked for, by name, as options of `bem.solve`.
TIGHT, LOOSE = f"residuals {RESIDUAL:g}", f"areas {AREA:g}"
AIMS = {TIGHT: {"tolerance": RESIDUAL}, LOOSE: {"area_tolerance": AREA}}
#: FFT pairs of the finest grid, and time in bare pairs, that the capped solve on GOAL_SIDE points
#: a side shall not exceed.
GOAL_SIDE = 2048
GOALS = {"finest_pairs": {TIGHT: 60, LOOSE: 30}, "time": {TIGHT: 120, LOOSE: 60}}
LAWS = {"capped": scenes.HARDNESS, "elastic": math.inf}
BANDWIDTH, FEWEST_POINTS = 256, 4
#: Times are the least of so many solves; of grids that are solved in no time, of more.
FEWEST_SOLVES, MOST_SOLVES = 3, 10


@dataclass(frozen=True)
class Solve:
    """One law, one grid of `side` x `side` points, one aim.

    points: per shortest wavelength; finest_pairs, all_pairs: FFT pairs of the finest grid, and
    of all by their points; time, processor_time: in those of a bare pair of the finest grid;
    area_error: largest relative difference of total, elastic and plastic area, raw and corrected,
    from the solve to residuals; bytes_per_point: memory.
    """

    law: str
    side: int
    points: float
    aim: str
    finest_pairs: float
    all_pairs: float
    time: float
    processor_time: float
    area_error: float
    bytes_per_point: float


def measure(
    sides: Sequence[int],
    progress: Progress,
    *,
    threads: int | None = None,
    most_solves: int = MOST_SOLVES,
) -> list[Solve]:
    """Both laws on grids of so many points a side, rising, to both aims; one surface each.

    A grid that is too coarse for the paper's band of roughness has the widest one that leaves
    FEWEST_POINTS per shortest wavelength.
    threads: of the solves and of the bare pairs; None: all cores.  most_solves: to time one.
    """
    from epcontact import bem
    from epcontact.machine import available_cores

    threads = threads or available_cores()
    bem.solve(scenes.rough_scene(4, 7, 8), threads=threads)  # compiled before it is timed
    held = _peak_since(lambda: None)
    found: list[Solve] = []
    for side in sides:
        bandwidth = min(BANDWIDTH, side // FEWEST_POINTS)
        for law, hardness in LAWS.items():
            progress(f"speed: {side} x {side} points, {law}")
            scene = scenes.rough_scene(side / bandwidth, 7, bandwidth, hardness)
            found += _solves(scene, law, side / bandwidth, threads, held, most_solves)
    return found


_Run = tuple["ContactResult", tuple[float, float], int]


def _solves(
    scene: Scene, law: str, points: float, threads: int, held: int, most_solves: int
) -> list[Solve]:
    shape = scene.surface.shape
    count = min(most_solves, max(FEWEST_SOLVES, 2**23 // scene.surface.heights.size))
    unit = bare_pair_times(shape, threads)
    runs: dict[str, list[_Run]] = {aim: [] for aim in AIMS}
    for _ in range(count):  # in turns, so that a busy moment of the machine strikes all alike
        for aim, options in AIMS.items():
            runs[aim].append(_watched(scene, options, threads))
        wall, processor = bare_pair_times(shape, threads)
        unit = min(unit[0], wall), min(unit[1], processor)
    exact = runs[TIGHT][0][0]
    found = []
    for aim, solved in runs.items():
        result = solved[0][0]
        wall, processor = np.min([times for _, times, _ in solved], axis=0) / np.array(unit)
        memory = max(memory for _, _, memory in solved) - held
        found.append(
            Solve(
                law,
                shape[0],
                points,
                aim,
                result.cost["fft_pairs"],
                result.cost["equivalent_fft_pairs"],
                float(wall),
                float(processor),
                area_difference(result, exact),
                memory / scene.surface.heights.size,
            )
        )
    return found


def _watched(scene: Scene, options: Mapping[str, Any], threads: int) -> _Run:
    """A result without its fields, its wall-clock and processor time (s), and the largest memory
    of the process meanwhile (bytes)."""
    from epcontact import bem

    found: list[ContactResult] = []
    started = time.perf_counter(), time.process_time()
    memory = _peak_since(lambda: found.append(bem.solve(scene, threads=threads, **options)))
    times = time.perf_counter() - started[0], time.process_time() - started[1]
    return replace(found[0], fields={}), times, memory


def _peak_since(work: Callable[[], None]) -> int:
    """Largest resident memory of this process during `work`, in bytes; where the system cannot
    begin to count anew, since the process began."""
    from epcontact.machine import peak_memory

    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    work()
    return peak_memory()


def area_difference(result: ContactResult, exact: ContactResult) -> float:
    """Largest relative difference of an area, of those that are not zero."""
    pairs = [
        (scenes.area_of(result, part, kind), scenes.area_of(exact, part, kind))
        for kind in ("raw", "corrected")
        for part in scenes.PARTS
    ]
    return max(abs(a / b - 1) for a, b in pairs if b > 0)


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """FFT pairs, time in bare pairs, error of the areas and memory against the grid."""
    sides = [512, 1024] if size == "fast" else [512, 1024, 2048, 4096]
    return draw_speed(measure(sides, progress))


def draw_speed(found: Sequence[Solve]) -> tuple[Chart, ...]:
    """Charts of FFT pairs (finest grid, all grids), times, the areas' errors and memory."""
    from epcontact.machine import available_cores

    grids = ", ".join(f"{n}² ({p:g})" for n, p in sorted({(s.side, s.points) for s in found}))
    scene = (
        "the paper's roughness, material and load, capped and elastic, one surface on grids of "
        f"so many points (per shortest wavelength): {grids}"
    )
    told = (
        f"for {scene}, to residuals of {RESIDUAL:g} or to areas settled within {AREA:g} (relative)"
    )
    timed = (
        f"least of {FEWEST_SOLVES} solves or more, least of the pairs between them, "
        f"{available_cores()} threads for both"
    )
    loose = [one for one in found if one.aim == LOOSE]
    return (
        _chart(
            found,
            "finest_pairs",
            "FFT pairs of the finest grid (–)",
            f"FFT pairs on the finest grid of a solve {told}. {_table(found, 'finest_pairs')} "
            f"{_goals_told(found, 'finest_pairs')}",
        ),
        _chart(
            found,
            "all_pairs",
            "FFT pairs of all grids, by their points (–)",
            f"FFT pairs of a solve {told}; those of coarser grids count by their points. "
            f"{_table(found, 'all_pairs')}",
        ),
        _chart(
            found,
            "time",
            "time of a solve in bare FFT pairs of its grid (–)",
            f"Time of a solve {told}, coarse grids and all, in bare real FFT pairs of the finest "
            f"grid: {timed}. {_table(found, 'time')} {_goals_told(found, 'time')}",
        ),
        _chart(
            found,
            "processor_time",
            "processor time of a solve in that of a bare FFT pair (–)",
            f"Processor time, all threads together, of a solve {told}, coarse grids and all, in "
            f"that of a bare real FFT pair of the finest grid: {timed}. It does not see a core "
            f"that waits or that others use. {_table(found, 'processor_time')}",
        ),
        _chart(
            loose,
            "area_error",
            "relative error of the areas, largest (–)",
            "Largest relative difference of total, elastic and plastic area, raw or corrected, "
            f"between a solve to areas settled within {AREA:g} and one to residuals of "
            f"{RESIDUAL:g} on the same grid, for {scene}. {_table(loose, 'area_error')} Those of "
            f"zero are drawn as open marks at the bottom. Goal: {AREA:g}.",
            log="xy",
        ),
        _chart(
            found,
            "bytes_per_point",
            "largest memory of a solve (bytes per point)",
            "Largest resident memory of a solve, heights included, beyond what the process held "
            f"before the first, {told}. {_table(found, 'bytes_per_point')}",
        ),
    )


def _chart(found: Sequence[Solve], key: str, label: str, caption: str, log: str = "x") -> Chart:
    """One figure of every solve against the grid, with its goals where it has some."""
    sides = sorted({one.side for one in found})
    series = [
        Series(name, [one.side for one in mine], [getattr(one, key) for one in mine])
        for name, mine in _lines(found).items()
    ]
    goals = [(f"goal, {aim}", goal) for aim, goal in GOALS.get(key, {}).items()]
    series += [Series(name, sides, [goal] * len(sides), line=True) for name, goal in goals]
    return curves(
        series,
        x="grid points a side (–)",
        y=label,
        columns=("points_a_side", key),
        caption=caption,
        log=log,
        ticks=sides,
        limits={} if "y" in log else {"ylim": (0, None)},
        zeros="y" in log,
    )


def _lines(found: Sequence[Solve]) -> dict[str, list[Solve]]:
    """The solves of each law to each aim, from the coarsest grid to the finest."""
    lines: dict[str, list[Solve]] = {}
    for one in found:
        lines.setdefault(f"{one.law}, {one.aim}", []).append(one)
    return lines


def _table(found: Sequence[Solve], key: str) -> str:
    rows = (
        f"{name}: " + ", ".join(f"{getattr(one, key):.3g} at {one.side}²" for one in mine)
        for name, mine in _lines(found).items()
    )
    return "; ".join(rows).capitalize() + "."


def _goals_told(found: Sequence[Solve], key: str) -> str:
    """The goals, and how much of them the capped body takes on their grid or the finest here."""
    sides = {one.side for one in found}
    side = GOAL_SIDE if GOAL_SIDE in sides else max(sides)
    told = ", ".join(
        f"{GOALS[key][one.aim]} for {one.aim} (here {getattr(one, key) / GOALS[key][one.aim]:.2f} "
        f"of it at {side}²)"
        for one in found
        if one.law == "capped" and one.side == side
    )
    return f"Goals for the capped body at {GOAL_SIDE}²: {told}."
