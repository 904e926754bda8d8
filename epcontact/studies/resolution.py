"""The benefit of resolution: errors of raw and corrected areas against resolution and cost.

One roughness is solved on ever finer grids.  The reference is the corrected area of the finest
grid; its own estimated error is drawn with it, and no error below it means anything.  Four figures
of each grid are judged: the raw areas (share of grid points), these extrapolated to a vanishing
spacing from two grids (2 A(n) - A(n/2), because their error is of first order), the published
perimeter correction, and the corrected areas, with the error that these claim.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from epcontact import bem
from epcontact.bem.areas.rim_correction import perimeter_areas
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table, observed_order
from epcontact.studies.paper_scene import PARTS, rough_scene
from epcontact.studies.tables import Progress, Size, listed, root_mean_square

KINDS = ("raw", "raw, extrapolated", "perimeter correction", "corrected")
CLAIMED = "claimed by the corrected"
REFERENCE = "uncertainty of the reference"


def solved_areas(
    points: Sequence[int], bandwidth: int, seeds: Sequence[int], progress: Progress
) -> pd.DataFrame:
    """Solve surfaces on grids of so many points per shortest wavelength.

    Returns:
        One row for each surface, grid and part of the area: seed, part, points_per_wavelength, the
        areas raw, perimeter correction and corrected, claimed by the corrected (as a share of
        them), and work_points_transformed (FFT pairs times points, the sum over all grids of the
        solve).
    """
    rows = []
    for seed in seeds:
        progress(f"resolution: seed {seed}")
        for n in points:
            scene = rough_scene(n, seed, bandwidth)
            result = bem.solve(scene, area_tolerance=1e-6)
            areas = result.final.areas
            _, corrected = perimeter_areas(result.fields["pressure"], scene.material.hardness)
            work = result.cost["equivalent_fft_pairs"] * result.cost["unknowns"]
            for part in PARTS:
                row = {"seed": seed, "part": part, "points_per_wavelength": n}
                row |= {"raw": getattr(areas["raw"], part)}
                row |= {"perimeter correction": getattr(corrected, part)}
                row |= {"corrected": getattr(areas["corrected"], part)}
                row |= {CLAIMED: getattr(areas["error"], part), "work_points_transformed": work}
                rows.append(row)
    return pd.DataFrame(rows)


def area_errors(solved: pd.DataFrame) -> pd.DataFrame:
    """Errors of the areas of `solved_areas` against the corrected ones on the finest grid.

    Returns:
        One row for each part, kind (KINDS, CLAIMED and REFERENCE) and grid but the finest:
        relative_error, root mean square over the surfaces (of REFERENCE the mean), and
        work_points_transformed, mean over them.
    """
    key = ["seed", "part"]
    finest = solved["points_per_wavelength"] == solved["points_per_wavelength"].max()
    reference = solved[finest][[*key, "corrected", CLAIMED]]
    worth = (reference[CLAIMED] / reference["corrected"]).groupby(reference["part"]).mean()
    reference = reference.rename(columns={"corrected": "exact"}).drop(columns=CLAIMED)
    table = solved.merge(reference, on=key)
    half = solved[[*key, "points_per_wavelength", "raw", "work_points_transformed"]].copy()
    half["points_per_wavelength"] *= 2
    table = table.merge(half, "left", [*key, "points_per_wavelength"], suffixes=("", "_half"))
    table["raw, extrapolated"] = 2 * table["raw"] - table["raw_half"]
    table[list(KINDS)] = table[list(KINDS)].div(table["exact"], axis=0) - 1
    table[CLAIMED] /= table["exact"]
    table = table[table["points_per_wavelength"] < table["points_per_wavelength"].max()]
    table = table.assign(**{REFERENCE: table["part"].map(worth)})
    by = ["part", "kind", "points_per_wavelength"]
    long = table.melt(
        [*key, "points_per_wavelength", "work_points_transformed", "work_points_transformed_half"],
        [*KINDS, CLAIMED, REFERENCE],
        "kind",
        "relative_error",
    )
    # Extrapolation pays for both of its grids.
    extra = long["work_points_transformed_half"].where(long["kind"] == "raw, extrapolated", 0.0)
    long["work_points_transformed"] += extra
    errors = root_mean_square(long, "relative_error", by)
    work = long.groupby(by, sort=False)["work_points_transformed"].mean().reset_index()
    return errors.merge(work, on=by)


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Chart errors of total and plastic area against points per wavelength and against work."""
    points = (3, 4, 6, 8, 12, 16, 32)
    bandwidth, seeds = (32, range(7, 13)) if size == "fast" else (64, range(7, 15))
    errors = area_errors(solved_areas(points, bandwidth, seeds, progress))
    surfaces = f"{len(seeds)} surfaces, relative to the corrected area at {points[-1]} points"
    return (*draw_errors(errors, "total", surfaces), *draw_errors(errors, "plastic", surfaces))


def draw_errors(errors: pd.DataFrame, part: str, surfaces: str) -> tuple[Chart, Chart]:
    """Error of one part against grid spacing with its order, and against work; `surfaces` describes
    the surfaces and the reference grid."""
    table = errors[errors["part"] == part]
    table = table.assign(style=np.where(table["kind"].isin(KINDS), "points", "curve"))
    worth = table.loc[table["kind"] == REFERENCE, "relative_error"].iloc[0]
    raw = table[table["kind"] == "raw"]
    order = -observed_order(raw["points_per_wavelength"], raw["relative_error"])
    at_four = table[(table["points_per_wavelength"] == 4) & table["kind"].isin(KINDS)].dropna()
    percentages = listed(
        at_four.assign(percent=100 * at_four["relative_error"]), "{kind} {percent:.2g} %"
    )
    caption = (
        f"Error of the {part} contact area of the capped body, root mean square over {surfaces} "
        f"per shortest wavelength, which is uncertain by {worth:.1e}"
    )
    points = Plot(
        ("points_per_wavelength", "points per shortest wavelength (–)"),
        ("relative_error", f"relative error of the {part} area (–)"),
        series=("kind",),
        log="xy",
        ticks=sorted(table["points_per_wavelength"].unique()),
        orders=KINDS,
    )
    work = replace(
        points,
        x=("work_points_transformed", "work: FFT pairs × grid points (–)"),
        ticks=(),
        orders=(),
        front=True,
    )
    return (
        draw_table(
            table,
            points,
            f"{caption}. At 4 points: {percentages}. Observed order of the raw area: {order:.2f}.",
        ),
        draw_table(
            table[table["kind"].isin(KINDS)],
            work,
            f"{caption}; against the work of a solve: FFT pairs of all its grids, each times its "
            "points. Extrapolation pays for both of its grids.",
        ),
    )
