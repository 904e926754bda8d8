"""P(sigma) at both its ends: does it vanish at 0+ and at hardness-, and how steep is it there?

The scene is the paper's with a narrow band of roughness, on ever finer grids.  The points next to
the rims fill the ends of a grid's P(sigma), so that no raw density is zero there.  Three
figures are measured at each end, in units of the hardness, by the distance from the end:

    density     the value at the end of a straight line that has the area and the mean pressure of
                the points within a window.  The window is WINDOW at COARSEST points per shortest
                wavelength and shrinks as the root of the spacing, like the pressure next to a rim.
                P bends within a fixed window, so its line would not tend to P at the end
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

import numpy as np
import pandas as pd

from epcontact import bem, persson
from epcontact.bem.areas.distribution import end_fit, end_fits, extrapolated
from epcontact.harness.gates.statistics import estimate
from epcontact.output.charts.curves import pressure_density
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.results import ContactResult, PressureDistribution
from epcontact.scene import Scene
from epcontact.studies.paper_scene import GAMMA, HARDNESS, rough_scene
from epcontact.studies.tables import Progress, Size, listed, mean_with_interval

ENDS = ("0+", "hardness-")
#: Windows as shares of the hardness.
WINDOW, COARSEST = 0.2, 4
WINDOWS = (0.1, 0.15, 0.2, 0.25, 0.3, 0.4)
DENSITY, RAW_SLOPE, MEAN_SLOPE = "density", "raw slope", "mean slope"
#: The power of the spacing with which a figure approaches its limit.
ORDERS = {DENSITY: 0.5, RAW_SLOPE: 0.5, MEAN_SLOPE: 1.0}
BINS = 40


def boundary_element_tables(
    points: Sequence[int], bandwidth: int, seeds: Sequence[int], progress: Progress
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Solve surfaces on grids of so many points per shortest wavelength.

    Returns:
        The figures of both ends, one row for each surface, grid and figure: seed,
        points_per_wavelength and the columns of `end_figures`; and the densities, one row for each
        bin, means over the surfaces: points_per_wavelength, relative_pressure, relative_density.
    """
    figures, densities = [], []
    for seed in seeds:
        progress(f"pressures: seed {seed}")
        for n in points:
            result = bem.solve(rough_scene(n, seed, bandwidth), area_tolerance=1e-6)
            key = {"seed": seed, "points_per_wavelength": n}
            figures.append(end_figures(result, n).assign(**key))
            densities.append(binned(result.distribution).assign(**key))
    bins = pd.concat(densities).groupby(["points_per_wavelength", "relative_pressure"], sort=False)
    return pd.concat(figures), bins["relative_density"].mean().reset_index()


def end_figures(result: ContactResult, points_per_wavelength: float) -> pd.DataFrame:
    """The figures of a solution on a grid, in units of the hardness.

    Returns:
        One row for each end, figure (DENSITY, RAW_SLOPE, MEAN_SLOPE) and window (over the hardness;
        of the density, that at COARSEST points): end, figure, window, value.
    """
    relative = result.fields["pressure"] / HARDNESS
    areas = result.final.areas["raw"], result.final.areas["corrected"]

    def fits(window: float) -> list[tuple[str, float, float, float]]:
        pair = zip(ENDS, end_fits(relative, 1.0, window, areas), strict=True)
        return [(e, f.density, f.slope, f.continuum_slope) for e, f in pair if f is not None]

    shrinking = WINDOW * math.sqrt(COARSEST / points_per_wavelength)
    rows = [(end, DENSITY, WINDOW, density) for end, density, _, _ in fits(shrinking)]
    rows += [(end, RAW_SLOPE, WINDOW, slope) for end, _, slope, _ in fits(WINDOW)]
    rows += [(end, MEAN_SLOPE, w, slope) for w in WINDOWS for end, _, _, slope in fits(w)]
    return pd.DataFrame(rows, columns=["end", "figure", "window", "value"])


def theory_tables(scene: Scene) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the theory's figures and density for the spectrum of the scene's surface.

    Returns:
        The columns of `end_figures`, with the slope at the very end as the mean slope within a
        window of 0; and relative_pressure, relative_density.
    """
    solved = persson.solve(scene, energy_reduction=GAMMA, spectrum="surface")
    quantities, p0 = solved.final.quantities, scene.load.final / HARDNESS
    G, elastic = quantities["diffusion"] / HARDNESS**2, solved.final.areas["raw"].elastic
    names = ("density_slope_at_zero", "density_slope_at_hardness")
    rows = []
    for end, name in zip(ENDS, names, strict=True):
        rows.append((end, DENSITY, WINDOW, 0.0))
        rows.append((end, MEAN_SLOPE, 0.0, abs(HARDNESS**2 * quantities[name])))
        for w in WINDOWS:
            d = np.linspace(0, w, 2001)
            within = persson.pressure_cumulative(d if end == "0+" else 1 - d, G, p0, 1.0)
            share = within if end == "0+" else elastic - within
            # int d P dd = w F(w) - int F dd; the trapezoidal rule is right to 1e-7 of it.
            fit = end_fit(share[-1], w * share[-1] - np.trapezoid(share, d), w)
            rows.append((end, MEAN_SLOPE, w, fit.continuum_slope))
            if w == WINDOW:
                rows.append((end, RAW_SLOPE, w, fit.slope))
    table = pd.DataFrame(rows, columns=["end", "figure", "window", "value"])
    return table, binned(solved.distribution)


def grid_limits(figures: pd.DataFrame) -> pd.DataFrame:
    """Extrapolate figures to ever finer grids, surface by surface.

    Args:
        figures: the table of `boundary_element_tables`.  Slopes are taken without the coarsest
            grid, whose rims fill the window.

    Returns:
        One row for each end, figure and window: end, figure, window, and the limit as value with
        its error, of scatter and of fit together, as value_low and value_high.
    """
    rows = []
    for (end, figure, window), group in figures.groupby(["end", "figure", "window"], sort=False):
        table = group.pivot(index="seed", columns="points_per_wavelength", values="value")
        if figure != DENSITY:
            table = table.iloc[:, 1:]
        n, order = table.columns.to_numpy(), ORDERS[figure]
        limit = estimate([extrapolated(n, row, order)[0] for row in table.to_numpy()])
        # The error of the fit is common to all surfaces: it does not fall with their number.
        error = math.hypot(limit.half_width, extrapolated(n, table.mean().to_numpy(), order)[1])
        rows.append((end, figure, window, limit.mean, limit.mean - error, limit.mean + error))
    names = ["end", "figure", "window", "value", "value_low", "value_high"]
    return pd.DataFrame(rows, columns=names)


def binned(distribution: PressureDistribution | None) -> pd.DataFrame:
    """Return the density of the pressure in BINS bins, over the hardness."""
    assert distribution is not None
    pressure, density = pressure_density(distribution, BINS, HARDNESS)
    columns = {"relative_pressure": pressure / HARDNESS, "relative_density": density * HARDNESS}
    return pd.DataFrame(columns)


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Chart P(sigma), its ends and end slopes against the grid, and its slopes by window."""
    points, bandwidth, seeds = (4, 8, 16, 32), 32 if size == "fast" else 128, range(7, 15)
    figures, densities = boundary_element_tables(points, bandwidth, seeds, progress)
    theory, density = theory_tables(rough_scene(points[0], seeds[0], bandwidth))
    of_scene = (
        f"of {len(seeds)} surfaces of the paper's roughness, 1/{bandwidth} of the longest wave "
        "being the shortest, material and load, capped, by boundary elements, in units of the "
        "hardness"
    )
    slope = rf"slope within {WINDOW:g} of the end, $P'\,\sigma_\mathrm{{P}}^2$ (–)"
    captions = {
        DENSITY: (
            r"density at the end, $P\,\sigma_\mathrm{P}$ (–)",
            f"Density of the pressure at 0+ and at hardness- as the raw grid shows it, {of_scene}",
        ),
        RAW_SLOPE: (
            slope,
            "Slope of the density of the pressure as the raw grid shows it, of the line through "
            f"the points within {WINDOW:g} of either end, {of_scene}",
        ),
        MEAN_SLOPE: (
            slope,
            "Mean slope of the density of the pressure in the continuum limit, 2 F/w² of the "
            f"corrected area F within w = {WINDOW:g} of either end, {of_scene}",
        ),
    }
    return (
        draw_densities(densities, density, of_scene),
        *(draw_limits(figures, theory, figure, *captions[figure]) for figure in captions),
        draw_windows(figures, theory, of_scene),
    )


def draw_densities(measured: pd.DataFrame, theory: pd.DataFrame, of_scene: str) -> Chart:
    """Draw P(sigma) on every grid, and the theory's."""
    names = measured["points_per_wavelength"].map("{:g} points a wavelength".format)
    both = pd.concat([theory.assign(series="persson"), measured.assign(series=names)])
    return draw_table(
        both.assign(style="curve"),
        Plot(
            ("relative_pressure", r"contact pressure over hardness, $\sigma / \sigma_\mathrm{P}$"),
            ("relative_density", r"density $P(\sigma)\,\sigma_\mathrm{P}$ (–)"),
            limits={"ylim": (0, None), "xlim": (0, 1)},
        ),
        f"Density of the pressure in elastic contact {of_scene}: raw, by points per shortest "
        f"wavelength, mean of {BINS} bins and of the surfaces, beside that of the theory (gamma = "
        f"{GAMMA}) with the spectrum of the same surfaces.",
    )


def draw_limits(
    figures: pd.DataFrame, theory: pd.DataFrame, figure: str, label: str, meaning: str
) -> Chart:
    """A figure of both ends against the root of the spacing, with limits at 0 and the theory's
    value; `label` names the axis, `meaning` opens the caption."""
    own, exact, limits = (
        table[(table["figure"] == figure) & (table["window"] == WINDOW)]
        for table in (figures, theory, grid_limits(figures))
    )
    means = mean_with_interval(own, "value", ["end", "points_per_wavelength"])
    means["root_of_spacing"] = 1 / np.sqrt(means["points_per_wavelength"])
    spacings = pd.DataFrame({"root_of_spacing": [0.0, means["root_of_spacing"].max()]})
    levels = exact.merge(spacings, how="cross").assign(style="curve")
    if figure == DENSITY:
        levels = levels.iloc[:0]  # it is zero, where the dotted line is
    table = pd.concat(
        [
            means.assign(series=means["end"]),
            limits.assign(root_of_spacing=0.0, style="open", series=limits["end"] + ", limit"),
            levels.assign(series="persson, " + levels["end"]),
        ]
    ).sort_values("end", kind="stable")
    both = limits.merge(exact, on="end", suffixes=("", "_theory"))
    both["error"] = both["value_high"] - both["value"]
    form = "{end}: {value:+.3g} ± {error:.2g} (theory {value_theory:.3g})"
    column = "relative_density" if figure == DENSITY else "relative_slope"
    return draw_table(
        table.rename(columns=lambda name: name.replace("value", column)),
        Plot(
            ("root_of_spacing", "root of 1 / points per shortest wavelength (–)"),
            (column, label),
            colour="end",
            level=0.0,
        ),
        f"{meaning}, as means with 95 % intervals, with the limits for ever finer grids (open "
        f"marks, at 0), beside the theory's. Limits: {listed(both, form)}.",
    )


def draw_windows(figures: pd.DataFrame, theory: pd.DataFrame, of_scene: str) -> Chart:
    """Draw mean slopes on the finest grid against the window, and the theory's."""
    finest = figures["points_per_wavelength"].max()
    own = figures[(figures["figure"] == MEAN_SLOPE) & (figures["points_per_wavelength"] == finest)]
    means = mean_with_interval(own, "value", ["end", "window"])
    exact = theory[theory["figure"] == MEAN_SLOPE]
    table = pd.concat(
        [
            means.assign(series=means["end"] + ", corrected"),
            exact.assign(series="persson, " + exact["end"], style="curve"),
        ]
    )
    both = means.merge(exact, on=["end", "window"], suffixes=("", "_theory"))
    both["ratio"] = both["value"] / both["value_theory"]
    return draw_table(
        table.sort_values("end", kind="stable").rename(
            columns=lambda name: name.replace("value", "relative_slope")
        ),
        Plot(
            ("window", "window over hardness (–)"),
            ("relative_slope", r"mean slope within it, $P'\,\sigma_\mathrm{P}^2$ (–)"),
            colour="end",
            limits={"ylim": (0, None)},
        ),
        "Mean slope of the density of the pressure within a window of either end, 2 F/w² of the "
        f"corrected area F within a window w, at {finest:g} points per shortest wavelength, "
        f"{of_scene}, with 95 % intervals, beside the theory's. Boundary elements over theory, by "
        f"window: {listed(both, '{ratio:.2f} at {window:g} from {end}')}.",
    )
