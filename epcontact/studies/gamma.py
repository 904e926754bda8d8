"""The energy reduction gamma that fits: the theory's areas against gamma and boundary elements.

The theory has one parameter, a constant gamma in G = gamma E*^2 xi^2 / 8.  Boundary elements, in
the continuum limit and averaged over surfaces, give four areas of one roughness: total, elastic
and plastic of the capped body, and the contact of the elastic body.  The theory has each of them
at a gamma of its own.  If the intervals of these gammas do not overlap, no single gamma fits.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pandas as pd

from epcontact import bem, persson
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.output.charts.style import CYCLE, STATE_COLOURS
from epcontact.results import ELASTIC, PLASTIC, FloatArray
from epcontact.studies.paper_scene import (
    GAMMA,
    HARDNESS,
    LAWS,
    MEAN_PRESSURE,
    MODULUS,
    area_rows,
    rough_scene,
)
from epcontact.studies.tables import Progress, Size, listed, mean_with_interval

AREAS = ("total", "elastic", "plastic", "elastic body")
_COLOURS = dict(
    zip(AREAS, (CYCLE[0], STATE_COLOURS[ELASTIC], STATE_COLOURS[PLASTIC], CYCLE[1]), strict=True)
)


def theory_areas() -> pd.DataFrame:
    """Areas of the paper's scene by the theory: columns gamma and AREAS, one row for each gamma."""
    diffusion = float(persson.full_contact_diffusion(MODULUS, 1.0))  # the rms slope is 1
    table = pd.DataFrame(persson.gamma_columns(diffusion, MEAN_PRESSURE, HARDNESS))
    return table.rename(columns={f"{area.replace(' ', '_')}_area": area for area in AREAS})


def boundary_element_areas(
    points_per_wavelength: float, bandwidth: int, seeds: range, progress: Progress
) -> pd.DataFrame:
    """Solve the capped and the elastic body on every surface.

    Returns:
        One row for each area: area (of AREAS) and area_fraction with its interval.
    """
    rows = []
    for seed in seeds:
        for law, hardness in LAWS.items():
            progress(f"gamma: seed {seed}, {law}")
            scene = rough_scene(points_per_wavelength, seed, bandwidth, hardness)
            rows += area_rows(bem.solve(scene, area_tolerance=1e-5), law=law)
    table = pd.DataFrame(rows)
    table["area"] = table["part"].where(table["law"] == "capped", table["part"] + " body")
    means = mean_with_interval(table, "area_fraction", ["area"], "estimated_error")
    return means[means["area"].isin(AREAS)]


def fit_gamma(theory: pd.DataFrame, measured: pd.DataFrame) -> pd.DataFrame:
    """Find the gamma at which the theory has each area.

    Args:
        theory: a column gamma, and a column an area.
        measured: one row for each area: area, area_fraction, area_fraction_low, area_fraction_high.

    Returns:
        One row for each area: area, gamma and, for the ends of its interval, gamma_low and
        gamma_high (NaN where the theory has the area at no gamma, or at several), and
        deviation_percent, that of the theory at the gamma of the paper.
    """
    gamma, rows = theory["gamma"].to_numpy(), []
    for row in measured.to_dict("records"):
        areas = theory[row["area"]].to_numpy()
        middle, *ends = (
            _crossing(gamma, areas, row[key])
            for key in ("area_fraction", "area_fraction_low", "area_fraction_high")
        )
        deviation = 100 * (float(np.interp(GAMMA, gamma, areas)) / row["area_fraction"] - 1)
        rows.append((row["area"], middle, min(ends), max(ends), deviation))
    names = ["area", "gamma", "gamma_low", "gamma_high", "deviation_percent"]
    return pd.DataFrame(rows, columns=names)


def one_gamma_fits(fits: pd.DataFrame) -> bool:
    """True if one gamma is within the intervals of all areas."""
    ends = fits[["gamma_low", "gamma_high"]]
    return bool(ends.notna().all(axis=None) and ends["gamma_low"].max() <= ends["gamma_high"].min())


def _crossing(x: FloatArray, y: FloatArray, level: float) -> float:
    """Return the only x at which y, interpolated linearly, has the level; NaN if not unique."""
    above = y > level
    crossings = np.flatnonzero(above[1:] != above[:-1])
    if crossings.size != 1:
        return math.nan
    i = crossings[0]
    return float(x[i] + (level - y[i]) * (x[i + 1] - x[i]) / (y[i + 1] - y[i]))


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Chart areas against gamma, and their deviation from the boundary elements."""
    points, bandwidth = (4, 128) if size == "fast" else (8, 256)
    seeds = range(7, 15)
    measured = boundary_element_areas(points, bandwidth, seeds, progress)
    surfaces = (
        f"{len(seeds)} surfaces, {points} points per shortest wavelength, which is 1/{bandwidth} "
        "of the longest"
    )
    return draw_gamma(theory_areas(), measured, surfaces)


def draw_gamma(theory: pd.DataFrame, measured: pd.DataFrame, surfaces: str) -> tuple[Chart, Chart]:
    """Draw the two charts; `surfaces` describes the surfaces of the means in `measured`."""
    curves = theory.melt("gamma", list(AREAS), "area", "area_fraction")
    levels = measured.merge(theory["gamma"].iloc[[0, -1]], how="cross")
    areas = pd.concat([curves.assign(method="theory"), levels.assign(method="bem")])
    areas = areas.sort_values("area", key=lambda area: area.map(AREAS.index), kind="stable")
    deviations = curves.merge(measured, on="area", suffixes=("", "_bem"))
    for end, bound in (("", "_bem"), ("_low", "_low"), ("_high", "_high")):
        # The interval of the mean gives that of the ratio, because the theory has no interval.
        ratio = deviations["area_fraction"] / deviations["area_fraction_bem"] ** 2
        deviations[f"deviation_percent{end}"] = 100 * (
            ratio * deviations[f"area_fraction{bound}"] - 1
        )
    fits = fit_gamma(theory, measured)
    caption = (
        f"boundary elements in the continuum limit, mean with its 95 % interval of {surfaces}; "
        "p0/(E* xi) = 0.05, hardness/(E* xi) = 0.6 (capped body) or infinite (elastic body). Gamma "
        "that meets each area, with the interval: "
        f"{listed(fits, '{area} {gamma:.3f} ({gamma_low:.3f} to {gamma_high:.3f})')}. "
        f"At gamma = {GAMMA}: {listed(fits, '{area} {deviation_percent:+.1f} %')}. "
        f"{'One gamma fits' if one_gamma_fits(fits) else 'No single gamma fits'} all four."
    )
    plot = Plot(
        ("gamma", r"energy reduction $\gamma$ (–)"),
        ("area_fraction", r"contact area $A / A_0$ (–)"),
        series=("area", "method"),
        colour="area",
        colours=_COLOURS,
        upright={r"$\gamma$ of the paper": GAMMA},
    )
    deviation = replace(
        plot,
        y=("deviation_percent", "theory over boundary elements, less 1 (%)"),
        series=("area",),
        level=0.0,
        limits={"ylim": (-40, 60)},
    )
    first = f"Contact areas of the theory against gamma; level lines: {caption}"
    second = f"Deviation of the theory's areas from {caption}"
    return (
        draw_table(areas.assign(style="curve"), plot, first),
        draw_table(deviations.assign(style="curve"), deviation, second),
    )
