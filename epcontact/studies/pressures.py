"""The study of P(sigma): does it vanish at 0+ and at the hardness, and how steep is it there?

Three figures are measured at each end, in units of the hardness, by the distance from the end:

    density     the value at the end of a straight line that has the area and the mean pressure of
                the points within a window.  The window is WINDOW at COARSEST points per shortest
                wavelength and shrinks as the root of the spacing, like the pressure next to a rim
                (these points fill the ends of a grid's P).  P bends within a fixed window, so its
                line would not tend to P at the end
    raw slope   the slope of such a line, within WINDOW on every grid
    mean slope  2 F(w)/w^2 of the corrected area F(w) within a window w: the slope at the end if P
                is straight there and vanishes at the end

Each is extrapolated for every surface to ever finer grids: density and raw slope with the root of
the spacing, the mean slope with the spacing.  They are compared with the theory's distribution
in elastic contact, with slopes in the same windows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from epcontact import bem, persson
from epcontact.bem.areas.distribution import end_fit, end_fits, extrapolated
from epcontact.harness.gates.statistics import estimate
from epcontact.output.charts.curves import pressure_density
from epcontact.output.charts.plot import Plot
from epcontact.results import ContactResult, PressureDistribution
from epcontact.scene import Scene
from epcontact.studies.frame import Charts, Say, listed, mean_with_interval, rows, study
from epcontact.studies.paper_scene import GAMMA, HARDNESS, rough_scene

ENDS = ("0+", "hardness-")
#: Windows as shares of the hardness.
WINDOW, COARSEST = 0.2, 4
WINDOWS = (0.1, 0.15, 0.2, 0.25, 0.3, 0.4)
DENSITY, RAW_SLOPE, MEAN_SLOPE = "density", "raw slope", "mean slope"
#: The power of the spacing with which a figure approaches its limit.
ORDERS = {DENSITY: 0.5, RAW_SLOPE: 0.5, MEAN_SLOPE: 1.0}
BINS = 40

_SLOPE = rf"slope within {WINDOW:g} of the end, $P'\,\sigma_\mathrm{{P}}^2$ (–)"
#: The label and the meaning of each figure.
_FIGURES = {
    DENSITY: (
        r"density at the end, $P\,\sigma_\mathrm{P}$ (–)",
        "Density of the pressure at 0+ and at hardness- as the raw grid shows it",
    ),
    RAW_SLOPE: (
        _SLOPE,
        "Slope of the density of the pressure as the raw grid shows it, of the line through "
        f"the points within {WINDOW:g} of either end",
    ),
    MEAN_SLOPE: (
        _SLOPE,
        "Mean slope of the density of the pressure in the continuum limit, 2 F/w² of the "
        f"corrected area F within w = {WINDOW:g} of either end",
    ),
}


@study("pressures", fast={"bandwidth": 32}, full={"bandwidth": 128})
def pressures(
    say: Say,
    bandwidth: int,
    points: Sequence[int] = (4, 8, 16, 32),
    seeds: Sequence[int] = range(7, 15),
) -> Charts:
    """P(sigma) at 0 and at the hardness, raw and extrapolated, beside the theory."""
    densities = []

    def row(seed: int, points_per_wavelength: int) -> list[dict[str, Any]]:
        scene = rough_scene(points_per_wavelength, seed, bandwidth)
        result = bem.solve(scene, area_tolerance=1e-6)
        binned = _binned(result.distribution)
        densities.append(binned.assign(points_per_wavelength=points_per_wavelength))
        return end_figures(result, points_per_wavelength)

    figures = rows(say, row, seed=seeds, points_per_wavelength=points)
    scene = rough_scene(points[0], seeds[0], bandwidth)
    of_scene = (
        f"of {len(seeds)} surfaces of the paper's roughness, 1/{bandwidth} of the longest wave "
        "being the shortest, material and load, capped, by boundary elements, in units of the "
        "hardness"
    )
    by = ["points_per_wavelength", "relative_pressure"]
    measured = pd.concat(densities).groupby(by, sort=False)["relative_density"].mean().reset_index()
    names = measured["points_per_wavelength"].map("{:g} points a wavelength".format)
    solved = persson.solve(scene, energy_reduction=GAMMA, spectrum="surface")
    theory = _binned(solved.distribution).assign(series="persson")
    yield (
        Plot(
            ("relative_pressure", r"contact pressure over hardness, $\sigma / \sigma_\mathrm{P}$"),
            ("relative_density", r"density $P(\sigma)\,\sigma_\mathrm{P}$ (–)"),
            style="curve",
            limits={"ylim": (0, None), "xlim": (0, 1)},
        ),
        pd.concat([theory, measured.assign(series=names)]),
        f"Density of the pressure in elastic contact {of_scene}: raw, by points per shortest "
        f"wavelength, mean of {BINS} bins and of the surfaces, beside that of the theory (gamma = "
        f"{GAMMA}) with the spectrum of the same surfaces.",
    )
    exact, limits = pd.DataFrame(theory_figures(scene)), grid_limits(figures)
    for figure in _FIGURES:
        yield _limit_chart(figures, limits, exact, figure, of_scene)
    yield _window_chart(figures, exact, of_scene)


def end_figures(result: ContactResult, points_per_wavelength: float) -> list[dict[str, Any]]:
    """The figures of a solution on a grid, in units of the hardness, a row for each end, figure and
    window (over the hardness; of the density, that at COARSEST points): end, figure, window, value.
    """
    relative = result.fields["pressure"] / HARDNESS
    areas = result.final.areas["raw"], result.final.areas["corrected"]
    shrinking = WINDOW * math.sqrt(COARSEST / points_per_wavelength)
    wanted = [(DENSITY, WINDOW, shrinking), (RAW_SLOPE, WINDOW, WINDOW)]
    wanted += [(MEAN_SLOPE, window, window) for window in WINDOWS]
    names = {DENSITY: "density", RAW_SLOPE: "slope", MEAN_SLOPE: "continuum_slope"}
    return [
        {"end": end, "figure": figure, "window": told, "value": getattr(fit, names[figure])}
        for figure, told, window in wanted
        for end, fit in zip(ENDS, end_fits(relative, 1.0, window, areas), strict=True)
        if fit is not None
    ]


def theory_figures(scene: Scene) -> list[dict[str, Any]]:
    """The theory's figures for the spectrum of the scene's surface, as `end_figures` has them; the
    slope at the very end is the mean slope within a window of 0."""
    final = persson.solve(scene, energy_reduction=GAMMA, spectrum="surface").final
    G, p0 = final.quantities["diffusion"] / HARDNESS**2, scene.load.final / HARDNESS
    found = []
    for end, name in zip(ENDS, ("zero", "hardness"), strict=True):
        slope = abs(HARDNESS**2 * final.quantities[f"density_slope_at_{name}"])
        found += [(end, DENSITY, WINDOW, 0.0), (end, MEAN_SLOPE, 0.0, slope)]
        for w in WINDOWS:
            d = np.linspace(0, w, 2001)
            within = persson.pressure_cumulative(d if end == "0+" else 1 - d, G, p0, 1.0)
            share = within if end == "0+" else final.areas["raw"].elastic - within
            # int d P dd = w F(w) - int F dd; the trapezoidal rule is right to 1e-7 of it.
            fit = end_fit(share[-1], w * share[-1] - np.trapezoid(share, d), w)
            found.append((end, MEAN_SLOPE, w, fit.continuum_slope))
            if w == WINDOW:
                found.append((end, RAW_SLOPE, w, fit.slope))
    return [dict(zip(("end", "figure", "window", "value"), row, strict=True)) for row in found]


def grid_limits(figures: pd.DataFrame) -> pd.DataFrame:
    """Extrapolate figures to ever finer grids, surface by surface: end, figure, window and the
    limit as value with its error, of scatter and of fit together, as value_low and value_high.

    Slopes are taken without the coarsest grid, whose rims fill the window.
    """
    found = []
    for (end, figure, window), group in figures.groupby(["end", "figure", "window"], sort=False):
        table = group.pivot(index="seed", columns="points_per_wavelength", values="value")
        if figure != DENSITY:
            table = table.iloc[:, 1:]
        n, order = table.columns.to_numpy(), ORDERS[figure]
        limit = estimate([extrapolated(n, row, order)[0] for row in table.to_numpy()])
        # The error of the fit is common to all surfaces: it does not fall with their number.
        error = math.hypot(limit.half_width, extrapolated(n, table.mean().to_numpy(), order)[1])
        found.append((end, figure, window, limit.mean, limit.mean - error, limit.mean + error))
    names = ["end", "figure", "window", "value", "value_low", "value_high"]
    return pd.DataFrame(found, columns=names)


def _binned(distribution: PressureDistribution | None) -> pd.DataFrame:
    """The density of the pressure in BINS bins, over the hardness."""
    assert distribution is not None
    pressure, density = pressure_density(distribution, BINS, HARDNESS)
    columns = {"relative_pressure": pressure / HARDNESS, "relative_density": density * HARDNESS}
    return pd.DataFrame(columns)


def _renamed(table: pd.DataFrame, column: str) -> pd.DataFrame:
    return table.rename(columns=lambda name: name.replace("value", column))


def _limit_chart(
    figures: pd.DataFrame, limits: pd.DataFrame, theory: pd.DataFrame, figure: str, of_scene: str
) -> tuple[Plot, pd.DataFrame, str]:
    """A figure of both ends against the root of the spacing, with limits at 0 and the theory's."""
    own, exact, limits = (
        table[(table["figure"] == figure) & (table["window"] == WINDOW)]
        for table in (figures, theory, limits)
    )
    means = mean_with_interval(own, "value", ["end", "points_per_wavelength"])
    means["root_of_spacing"] = 1 / np.sqrt(means["points_per_wavelength"])
    spacings = pd.DataFrame({"root_of_spacing": [0.0, means["root_of_spacing"].max()]})
    levels = exact.merge(spacings, how="cross").assign(style="curve")
    if figure == DENSITY:
        levels = levels.iloc[:0]  # it is zero, where the dotted line is
    tables = [
        means.assign(series=means["end"]),
        limits.assign(root_of_spacing=0.0, style="open", series=limits["end"] + ", limit"),
        levels.assign(series="persson, " + levels["end"]),
    ]
    both = limits.merge(exact, on="end", suffixes=("", "_theory"))
    both["error"] = both["value_high"] - both["value"]
    form = "{end}: {value:+.3g} ± {error:.2g} (theory {value_theory:.3g})"
    column = "relative_density" if figure == DENSITY else "relative_slope"
    label, meaning = _FIGURES[figure]
    return (
        Plot(
            ("root_of_spacing", "root of 1 / points per shortest wavelength (–)"),
            (column, label),
            colour="end",
            level=0.0,
        ),
        _renamed(pd.concat(tables).sort_values("end", kind="stable"), column),
        f"{meaning}, {of_scene}, as means with 95 % intervals, with the limits for ever finer "
        f"grids (open marks, at 0), beside the theory's. Limits: {listed(both, form)}.",
    )


def _window_chart(
    figures: pd.DataFrame, theory: pd.DataFrame, of_scene: str
) -> tuple[Plot, pd.DataFrame, str]:
    """Mean slopes on the finest grid against the window, and the theory's."""
    finest = figures["points_per_wavelength"].max()
    own = figures[(figures["figure"] == MEAN_SLOPE) & (figures["points_per_wavelength"] == finest)]
    means = mean_with_interval(own, "value", ["end", "window"])
    exact = theory[theory["figure"] == MEAN_SLOPE]
    tables = [
        means.assign(series=means["end"] + ", corrected"),
        exact.assign(series="persson, " + exact["end"], style="curve"),
    ]
    return (
        Plot(
            ("window", "window over hardness (–)"),
            ("relative_slope", r"mean slope within it, $P'\,\sigma_\mathrm{P}^2$ (–)"),
            colour="end",
            limits={"ylim": (0, None)},
        ),
        _renamed(pd.concat(tables).sort_values("end", kind="stable"), "relative_slope"),
        "Mean slope of the density of the pressure within a window of either end, 2 F/w² of the "
        f"corrected area F within a window w, at {finest:g} points per shortest wavelength, "
        f"{of_scene}, with 95 % intervals, beside the theory's.",
    )
