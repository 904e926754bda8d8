"""The growth of the cost of boundary elements with the grid.

The grid grows in two ways: with fixed roughness, so that a larger grid has more points per
wavelength, and with fixed points per wavelength, so that it has more roughness.  FFT pairs are
counted, those of the finest grid and of all grids by their points; times are in bare FFT pairs of
the same grid, timed in the same run, so that a flat line means growth as N log N.
"""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from epcontact import bem
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table, observed_order
from epcontact.studies.bem import bare_pair_times
from epcontact.studies.paper_scene import rough_scene
from epcontact.studies.tables import Progress, Size

FIXED_ROUGHNESS, FIXED_POINTS = "roughness fixed", "points per wavelength fixed"
#: Number of solves, of which the least time is taken.
REPEATS = 2


def grid_costs(
    grids: Sequence[tuple[str, int, int]], progress: Progress, *, tolerance: float = 1e-8
) -> pd.DataFrame:
    """Solve one surface on each grid, on one thread.

    Args:
        grids: what is fixed, points per shortest wavelength and bandwidth of each.
        progress: called with a sentence before each grid.
        tolerance: on the residuals.

    Returns:
        One row for each grid: fixed, points_a_side, FFT pairs of the "finest grid" and of
        "all grids" by their points, time_in_fft_pairs (of the finest grid).
    """
    bem.solve(rough_scene(4, 7, 8), threads=1)  # compiled and cached before it is timed
    rows = []
    for fixed, points, bandwidth in grids:
        n = points * bandwidth
        progress(f"growth: {n} x {n} points, {points} per wavelength")
        scene = rough_scene(points, 7, bandwidth)
        # Timed before and after, because on a busy machine the smaller time is the better one.
        before, _ = bare_pair_times((n, n), 1)
        costs = [bem.solve(scene, tolerance=tolerance, threads=1).cost for _ in range(REPEATS)]
        after, _ = bare_pair_times((n, n), 1)
        time = min(cost["seconds"] for cost in costs) / min(before, after)
        rows.append((fixed, n, costs[0]["fft_pairs"], costs[0]["equivalent_fft_pairs"], time))
    names = ["fixed", "points_a_side", "finest grid", "all grids", "time_in_fft_pairs"]
    return pd.DataFrame(rows, columns=names)


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Chart FFT pairs and time in bare pairs against the grid, for both ways to grow."""
    sides = [128, 256, 512, 1024] + ([2048, 4096] if size == "full" else [])
    grids = [(FIXED_ROUGHNESS, n // 16, 16) for n in sides]
    return draw_growth(grid_costs(grids + [(FIXED_POINTS, 4, n // 4) for n in sides], progress))


def draw_growth(costs: pd.DataFrame) -> tuple[Chart, Chart]:
    """Draw counts and times against the points a side; `costs` is the table of `grid_costs`."""
    pairs = costs.melt(
        ["fixed", "points_a_side"], ["finest grid", "all grids"], "grids", "fft_pairs"
    )
    slopes = ", ".join(
        f"{fixed} {observed_order(group['points_a_side'], group['all grids']):+.2f}"
        for fixed, group in costs.groupby("fixed", sort=False)
    )
    caption = (
        "for the paper's roughness, material and load, capped, to KKT residuals of 1e-8: with 16 "
        "wavelengths a side and a growing number of points, and with 4 points per shortest "
        "wavelength and a growing number of wavelengths."
    )
    side = ("points_a_side", "grid points a side (–)")
    ticks = sorted(costs["points_a_side"].unique())
    return (
        draw_table(
            pairs,
            Plot(
                side,
                ("fft_pairs", "FFT pairs (–)"),
                series=("fixed", "grids"),
                log="x",
                ticks=ticks,
                limits={"ylim": (0, None)},
            ),
            f"FFT pairs of a solve {caption} Coarser grids count by their points. Exponents of the "
            f"pairs of all grids against points a side: {slopes}.",
        ),
        draw_table(
            costs,
            Plot(
                side,
                ("time_in_fft_pairs", "time of a solve in bare FFT pairs of its grid (–)"),
                series=("fixed",),
                log="xy",
                ticks=ticks,
            ),
            f"Time of a solve on one thread {caption} In units of one bare real FFT pair of the "
            "same grid, the least times of the same run; a level line grows as N log N.",
        ),
    )
