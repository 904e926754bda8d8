"""How the cost of the boundary elements grows with the grid.

Twice: with the roughness fixed, so that a larger grid has more points per wavelength, and with
the points per wavelength fixed, so that it has more roughness.  FFT pairs are counted, those of
the finest grid and of all grids by their points; times are told in bare FFT pairs of the same
grid, timed in the same run, so that a flat line means growth as N log N.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from epcontact.output.charts.curves import observed_order
from epcontact.output.charts.figures import Series
from epcontact.output.charts.study import curves
from epcontact.results import FloatArray
from epcontact.studies import Progress, Size
from epcontact.studies import paper_scene as scenes
from epcontact.studies.bem import bare_pair_seconds

if TYPE_CHECKING:
    from epcontact.output.charts.figures import Chart


#: Times are the least of so many solves.
REPEATS = 2


@dataclass(frozen=True)
class Growth:
    """Costs on grids of n x n points, (k,) each: FFT pairs of the finest grid and of all grids by
    their points, and seconds of a solve over those of one bare pair."""

    points: FloatArray
    finest_pairs: FloatArray
    all_pairs: FloatArray
    relative_time: FloatArray


def measure(
    grids: Sequence[tuple[int, int]], progress: Progress, *, tolerance: float = 1e-8
) -> Growth:
    """Solve grids given as (points per shortest wavelength, bandwidth), one surface each."""
    from epcontact import bem

    rows = []
    bem.solve(scenes.rough_scene(4, 7, 8), threads=1)  # compiled and cached before it is timed
    for points, bandwidth in grids:
        n = points * bandwidth
        progress(f"growth: {n} x {n} points, {points} per wavelength")
        scene = scenes.rough_scene(points, 7, bandwidth)
        pair = bare_pair_seconds((n, n), 1)
        costs = [bem.solve(scene, tolerance=tolerance, threads=1).cost for _ in range(REPEATS)]
        cost = costs[0]
        # Timed before and after: on a busy machine the lesser is the truer.
        pair = min(pair, bare_pair_seconds((n, n), 1))
        time = min(one["seconds"] for one in costs) / pair
        rows.append((n, cost["fft_pairs"], cost["equivalent_fft_pairs"], time))
    return Growth(*np.array(rows, dtype=np.float64).T)


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """FFT pairs and time in bare pairs against the grid, for both ways to grow."""
    largest = 1024 if size == "fast" else 4096
    grids = [2**k for k in range(7, 13) if 2**k <= largest]
    fixed_roughness = measure([(n // 16, 16) for n in grids], progress)
    fixed_points = measure([(4, n // 4) for n in grids], progress)
    return draw_growth(fixed_roughness, fixed_points)


def draw_growth(fixed_roughness: Growth, fixed_points: Growth) -> tuple[Chart, Chart]:
    """Counts and times against the points a side."""
    both = {"roughness fixed": fixed_roughness, "points per wavelength fixed": fixed_points}
    slopes = ", ".join(
        f"{n}: {observed_order(g.points, g.all_pairs):+.2f}" for n, g in both.items()
    )
    told = (
        "for the paper's roughness, material and load, capped, to KKT residuals of 1e-8: with 16 "
        "wavelengths a side and more and more points, and with 4 points per shortest wavelength "
        "and more and more of them."
    )
    ticks = fixed_roughness.points.tolist()
    pairs = [
        Series(f"{name}, {which}", g.points, values)
        for name, g in both.items()
        for which, values in (("finest grid", g.finest_pairs), ("all grids", g.all_pairs))
    ]
    times = [Series(name, g.points, g.relative_time) for name, g in both.items()]
    side = "grid points a side (–)"
    return (
        curves(
            pairs,
            x=side,
            y="FFT pairs (–)",
            columns=("points_a_side", "fft_pairs"),
            caption=f"FFT pairs of a solve {told} Coarser grids count by their points. "
            f"Exponents of the pairs of all grids against points a side: {slopes}.",
            log="x",
            ticks=ticks,
            limits={"ylim": (0, None)},
        ),
        curves(
            times,
            x=side,
            y="time of a solve in bare FFT pairs of its grid (–)",
            columns=("points_a_side", "time_in_fft_pairs"),
            caption=f"Time of a solve on one thread {told} In units of one bare real FFT pair of "
            "the same grid, the least times of the same run; a level line grows as N log N.",
            log="xy",
            ticks=ticks,
        ),
    )
