"""Studies of the theory: its gamma, its magnifications, and the ends of P(sigma)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from epcontact import bem, persson
from epcontact.bem.areas.distribution import end_fits, extrapolate
from epcontact.harness.gates import estimate
from epcontact.output.charts.plot import Axis, Plot
from epcontact.output.charts.style import CYCLE, PART_COLOURS
from epcontact.results import ContactResult, PressureDistribution
from epcontact.scene import Scene
from epcontact.studies import paper_scene as paper
from epcontact.studies.frame import (
    Charts,
    Ints,
    Rows,
    Say,
    list_rows,
    mean_with_interval,
    study,
    tabulate,
)
from epcontact.surfaces import filtered

# --- gamma

#: The areas that the theory must have: of the paper's scene, and of the body without
#: hardness.
ELASTIC_BODY = "elastic body"
AREAS = (*paper.PARTS, ELASTIC_BODY)
_AREA = Axis("area_fraction", r"contact area $A / A_0$ (–)")
#: The endings of a column and of the columns of its interval.
_ENDS = ("", "_low", "_high")


def theory_areas() -> pd.DataFrame:
    """Return the areas of the paper's scene by the theory.

    Columns: gamma and AREAS, with a row for each gamma.
    """
    tau = float(
        persson.full_contact_diffusion(paper.MODULUS, 1.0)
    )  # the rms slope is 1
    gammas = np.linspace(0.3, 1.0, 141)
    capped = persson.areas(gammas * tau, paper.MEAN_PRESSURE, paper.HARDNESS)
    elastic = persson.areas(gammas * tau, paper.MEAN_PRESSURE)
    columns = {"gamma": gammas}
    for part in paper.PARTS:
        columns[part] = getattr(capped, part)
    columns[ELASTIC_BODY] = elastic.total
    return pd.DataFrame(columns)


def fit_gamma(
    table: pd.DataFrame, measured: Mapping[Any, Any]
) -> tuple[float, float, float]:
    """Return the gamma at which the theory has a measured area, and its interval.

    gamma is the theory's energy reduction.

    Args:
        table: The areas of `theory_areas`.
        measured: A row with `area` (name of a column of `table`), `area_fraction`, and
            the ends `area_fraction_low` and `area_fraction_high` of its interval.

    Returns:
        The gamma, and the lower and upper end of its interval; NaN for none.
    """
    rising = table.sort_values(measured["area"])
    fits = np.interp(
        [measured[f"area_fraction{end}"] for end in _ENDS],
        rising[measured["area"]],
        rising["gamma"],
        left=math.nan,
        right=math.nan,
    )
    gamma, first_end, second_end = fits.tolist()
    return gamma, min(first_end, second_end), max(first_end, second_end)


def one_gamma(fits: Sequence[tuple[float, float, float]]) -> bool:
    """Return whether one gamma lies within the intervals of all fits.

    `fits` are those of `fit_gamma`: gamma, lower and upper end of its interval.  The
    result is False if one of them is NaN.
    """
    _, lows, highs = np.transpose(fits)
    return bool(lows.max() <= highs.min())


@study("gamma", points=8, bandwidth=256)
def gamma(
    say: Say, points: int = 4, bandwidth: int = 128, seeds: Ints = range(7, 15)
) -> Charts:
    """Areas of the theory against its energy reduction, beside boundary elements.

    The theory has one parameter, a constant gamma in G = gamma E*^2 xi^2 / 8, and it
    has each of four measured areas at a gamma of its own.  If the intervals of these
    gammas do not overlap, no single gamma fits.  The elastic body is the paper's scene
    without hardness.
    """

    def row(seed: int, law: str) -> Rows:
        """Return rows of the areas of one surface by boundary elements.

        `law` is "capped" or "elastic", and `seed` that of the surface.  The rows are
        those of `paper_scene.area_rows`.
        """
        scene = paper.rough_scene(points, seed, bandwidth, paper.LAWS[law])
        return paper.area_rows(paper.solve_bem(scene))

    table = tabulate(say, row, seed=seeds, law=paper.LAWS)
    is_capped = table["law"] == "capped"
    table["area"] = table["part"].where(is_capped, table["part"] + " body")
    measured = mean_with_interval(table, _AREA.column, ["area"], "estimated_error")
    measured = measured[measured["area"].isin(AREAS)]
    by_theory = theory_areas()
    fits = {row["area"]: fit_gamma(by_theory, row) for _, row in measured.iterrows()}
    listed = []
    for area, (best, low, high) in fits.items():
        listed.append(f"{area} {best:.3f} ({low:.3f} to {high:.3f})")
    gammas = ", ".join(listed)
    if not one_gamma([*fits.values()]):
        gammas += ": no single gamma fits all four"

    curves = by_theory.melt("gamma", list(AREAS), "area", _AREA.column)
    off = curves.merge(measured, on="area", suffixes=("", "_bem"))
    for end, bound in zip(_ENDS, ("_bem", "_low", "_high"), strict=True):
        # The interval of the mean gives that of the ratio, because the theory has no
        # interval.
        by_bem = off["area_fraction_bem"]
        ratio = off["area_fraction"] / by_bem**2 * off[f"area_fraction{bound}"]
        off[f"deviation_percent{end}"] = 100 * (ratio - 1)
    plot = Plot(
        Axis("gamma", r"energy reduction $\gamma$ (–)"),
        Axis("deviation_percent", "theory over boundary elements, less 1 (%)"),
        ("area",),
        style="curve",
        colour="area",
        colours=PART_COLOURS | {ELASTIC_BODY: CYCLE[1]},
        level=0.0,
        limits={"ylim": (-40, 60)},
        upright={r"$\gamma$ of the paper": paper.GAMMA},
    )
    caption = (
        "Which energy reduction gives the areas of boundary elements? The theory has "
        f"them at the gammas {gammas}."
    )
    yield plot, off, caption


# --- magnification

#: Smallest area over the nominal one whose ratio is shown; a smaller area is a few grid
#: points.
_SMALLEST_AREA = 0.01
_DENSITY = ("pressure_GPa", "density_per_GPa")
#: Number of cut-offs whose distribution of the pressure is shown.
_DISTRIBUTIONS = 5


def _curves(body: persson.Theory, magnifications: Sequence[float]) -> pd.DataFrame:
    """Return the theory's contact areas at several magnifications.

    The columns are part (total, elastic, plastic), magnification and area_fraction.

    Args:
        body: The theory of the paper's scene.
        magnifications: Wave numbers up to which roughness is included, over the lowest.
    """
    curve = body.magnification_curve(paper.MEAN_PRESSURE, magnifications)
    columns = {name: getattr(curve, name) for name in ("magnification", *paper.PARTS)}
    return pd.DataFrame(columns).melt(
        "magnification", list(paper.PARTS), "part", _AREA.column
    )


@study("magnification", points=8, bandwidth=256, count=10)
def magnification(
    say: Say,
    points: int = 4,
    bandwidth: int = 64,
    count: int = 13,
    seeds: Ints = range(7, 11),
) -> Charts:
    """Theory against boundary elements on one surface filtered at many cut-offs.

    A surface filtered at the wave number zeta q_0 is what the theory sees at the
    magnification zeta.  Surfaces of random phases share their amplitudes, and so the
    theory's spectrum.  Areas are in the continuum limit, densities of the pressure raw;
    the scene is the paper's.
    """
    cut_offs = np.geomspace(1.5, bandwidth, count).round(1).tolist()
    evenly = np.linspace(0, count - 1, min(count, _DISTRIBUTIONS + 1))
    distributed = [cut_offs[round(i)] for i in evenly][-_DISTRIBUTIONS:]
    densities = []

    def row(seed: int, magnification: float) -> Rows:
        """Return rows of the areas of one surface without its short waves.

        `magnification` is the largest wave number that is kept, over the lowest.  The
        rows are those of `paper_scene.area_rows`.
        """
        scene = paper.rough_scene(points, seed, bandwidth)
        surface = filtered(scene.surface, magnification * paper.LOWEST)
        result = paper.solve_bem(replace(scene, surface=surface))
        if magnification in distributed:
            density = paper.binned(result.distribution, 1e9, _DENSITY)
            densities.append(density.assign(magnification=magnification))
        return paper.area_rows(result)

    table = tabulate(say, row, seed=seeds, magnification=cut_offs)
    by = ["part", "magnification"]
    areas = mean_with_interval(table, _AREA.column, by, "estimated_error")
    body = paper.theory_of(paper.rough_scene(points, seeds[0], bandwidth))
    curves = _curves(body, np.geomspace(1, cut_offs[-1], 1000).tolist())
    lows = areas["area_fraction_low"].clip(lower=1e-12)  # for a logarithmic axis
    measured = areas.assign(area_fraction_low=lows)
    both = pd.concat([curves.assign(method="theory"), measured.assign(method="bem")])
    plot = Plot(
        Axis("magnification", r"magnification $\zeta = q / q_0$ (–)"),
        _AREA,
        ("part", "method"),
        {"theory": "curve", "bem": "marks"},
        colour="part",
        colours=PART_COLOURS,
        log="xy",
        limits={"ylim": (1e-3, 1.3)},
    )
    yield plot, both, "How does the contact shrink as finer roughness is included?"

    off = areas.merge(_curves(body, cut_offs), on=by, suffixes=("", "_theory"))
    off = off[off["area_fraction_theory"] > _SMALLEST_AREA]
    for end in _ENDS:
        ratio = off[f"area_fraction{end}"] / off["area_fraction_theory"]
        off[f"deviation_percent{end}"] = 100 * (ratio - 1)
    y = Axis("deviation_percent", "boundary elements over theory, less 1 (%)")
    deviation = replace(
        plot,
        y=y,
        series=("part",),
        log="x",
        limits={},
        level=0.0,
    )
    caption = (
        "How far are boundary elements from the theory at each magnification? Areas "
        f"above {_SMALLEST_AREA} are shown."
    )
    yield deviation, off, caption

    groups = pd.concat(densities).groupby(["magnification", _DENSITY[0]], sort=False)
    tables = []
    for zeta in distributed:
        curve = body.pressure_curve(paper.MEAN_PRESSURE, zeta)
        distribution = PressureDistribution(
            curve.pressure, curve.cumulative, curve.plastic
        )
        density = paper.binned(distribution, 1e9, _DENSITY)
        tables.append(density.assign(method="theory", magnification=zeta))
    tables.append(groups.mean().reset_index().assign(method="bem"))
    both = pd.concat(tables).sort_values("magnification", kind="stable")
    both["zeta"] = both["magnification"].map("zeta = {:.3g}".format)
    plot = replace(
        plot,
        x=Axis(_DENSITY[0], r"contact pressure $\sigma$ (GPa)"),
        y=Axis(_DENSITY[1], r"density $P(\sigma, \zeta)$ (1/GPa)"),
        series=("zeta", "method"),
        colour="zeta",
        log="y",
        limits={"ylim": (1e-5, None), "xlim": (0, paper.HARDNESS / 1e9)},
    )
    yield plot, both, "How do the pressures spread as finer roughness is included?"


# --- the ends of P(sigma)

ENDS = ("0+", "hardness-")
#: Width of the window at an end over the hardness; of the density that at COARSEST
#: points per shortest wavelength.
WINDOW = 0.2
COARSEST = 4
DENSITY = "relative_density"
SLOPE = "relative_slope"
#: Name and label of each quantity of an end, and the power of the spacing with which it
#: approaches its limit.
QUANTITIES = {
    DENSITY: ("density", r"density at the end, $P\,\sigma_\mathrm{P}$ (–)", 0.5),
    SLOPE: (
        "mean slope",
        rf"slope within {WINDOW:g} of the end, $P'\,\sigma_\mathrm{{P}}^2$ (–)",
        1.0,
    ),
}
_RELATIVE = ("relative_pressure", DENSITY)


@study("pressures", bandwidth=128)
def pressures(
    say: Say,
    bandwidth: int = 32,
    points: Ints = (4, 8, 16, 32),
    seeds: Ints = range(7, 15),
) -> Charts:
    """P(sigma) at 0 and at the hardness, raw and extrapolated, beside the theory.

    The density is the value at the end of a straight line that has the area and the
    mean pressure of the points within a window, which shrinks as the root of the
    spacing, like the pressure next to a rim; the mean slope is 2 F/w^2 of the corrected
    area F within a window w.  Each is extrapolated for every surface to ever finer
    grids, with the root of the spacing or, the mean slope, with the spacing.  Units:
    the hardness.
    """
    densities = []

    def row(seed: int, points_per_wavelength: int) -> Rows:
        """Return the rows of `end_values` for the surface of a seed on one grid.

        The grid has `points_per_wavelength` points per shortest wavelength.  The
        density of the pressure is added to `densities`.
        """
        scene = paper.rough_scene(points_per_wavelength, seed, bandwidth)
        result = bem.solve(scene, area_tolerance=1e-6)
        density = paper.binned(result.distribution, paper.HARDNESS, _RELATIVE)
        densities.append(density.assign(points_per_wavelength=points_per_wavelength))
        return end_values(result, points_per_wavelength)

    values = tabulate(say, row, seed=seeds, points_per_wavelength=points)
    scene = paper.rough_scene(points[0], seeds[0], bandwidth)
    by = ["points_per_wavelength", _RELATIVE[0]]
    groups = pd.concat(densities).groupby(by, sort=False)
    measured = groups[_RELATIVE[1]].mean().reset_index()
    measured["series"] = measured[by[0]].map("{:g} points a wavelength".format)
    distribution = paper.solve_theory(scene).distribution
    by_theory = paper.binned(distribution, paper.HARDNESS, _RELATIVE)
    x = Axis(
        _RELATIVE[0], r"contact pressure over hardness, $\sigma / \sigma_\mathrm{P}$"
    )
    y = Axis(_RELATIVE[1], r"density $P(\sigma)\,\sigma_\mathrm{P}$ (–)")
    plot = Plot(
        x,
        y,
        style="curve",
        limits={"ylim": (0, None), "xlim": (0, 1)},
    )
    table = pd.concat([by_theory.assign(series="persson"), measured])
    yield plot, table, "Does the density of the pressure vanish at 0 and the hardness?"

    exact = pd.DataFrame(theory_values(scene))
    x = Axis("root_of_spacing", "root of 1 / points per shortest wavelength (–)")
    values[x.column] = 1 / np.sqrt(values["points_per_wavelength"])
    for quantity, (name, label, _) in QUANTITIES.items():
        limits = grid_limits(values, quantity)
        table = _ends_table(values, limits, exact, quantity, x.column)
        columns = {"limit": limits[quantity], "theory": exact[quantity]}
        form = "{end} {limit:+.3g} (theory {theory:.3g})"
        listed = list_rows(limits.assign(**columns), form)
        series = ("method", "end", "kind")
        names = {", ".join(filter(None, row)) for row in table[[*series]].to_numpy()}
        plot = Plot(
            x,
            Axis(quantity, label),
            series,
            labels={name: _in_words(name) for name in names},
            colour="end",
            level=0.0,
        )
        caption = (
            f"What is the {name} of P at its ends on ever finer grids? The limits are "
            f"{listed}."
        )
        yield plot, table, caption


def _in_words(name: str) -> str:
    """Return the name of a series with the name of its end, from ENDS, in words."""
    return name.replace(ENDS[0], "at 0").replace(ENDS[1], "at the hardness")


def _ends_table(
    values: pd.DataFrame,
    limits: pd.DataFrame,
    exact: pd.DataFrame,
    quantity: str,
    x: str,
) -> pd.DataFrame:
    """Return the means on the grids, their limits and the levels of the theory.

    Args:
        values: Rows of `end_values` with the column x.
        limits: Rows of `grid_limits`.
        exact: Rows of `theory_values`.
        quantity: DENSITY or SLOPE.
        x: Column of the root of the spacing.
    """
    means = mean_with_interval(values, quantity, ["end", x])
    limits = limits.assign(**{x: 0.0}, kind="limit", style="open")
    ends = pd.Series([0.0, values[x].max()], name=x)
    levels = exact.merge(ends, how="cross").assign(method="persson", style="curve")
    levels = levels[levels[quantity] != 0]  # a dotted line is drawn at 0 anyway
    table = pd.concat([means, limits, levels]).sort_values("end", kind="stable")
    table[["method", "kind"]] = table[["method", "kind"]].fillna("")
    return table


def end_values(result: ContactResult, points_per_wavelength: float) -> Rows:
    """Return the density of the pressure at its two ends, and its mean slope there.

    The ends are the pressures 0 and the hardness, the unit of the pressure is the
    hardness.

    Args:
        result: A result of the paper's scene by boundary elements.
        points_per_wavelength: Grid points per shortest wavelength, which determine the
            width of the window of the density.

    Returns:
        A row for each end, with the columns end, DENSITY and SLOPE.
    """
    relative = result.fields["pressure"] / paper.HARDNESS
    areas = result.final.areas["raw"], result.final.areas["corrected"]
    narrow = WINDOW * math.sqrt(COARSEST / points_per_wavelength)
    narrow_fits = end_fits(relative, 1.0, narrow, areas)
    wide_fits = end_fits(relative, 1.0, WINDOW, areas)
    rows = []
    for end, of_density, of_slope in zip(ENDS, narrow_fits, wide_fits, strict=True):
        density = of_density.density
        rows.append(
            {
                "end": end,
                DENSITY: density,
                SLOPE: of_slope.continuum_slope,
            }
        )
    return rows


def theory_values(scene: Scene) -> Rows:
    """Return the theory's density of the pressure at its two ends, and its mean slope.

    The theory takes the spectrum of the scene's surface.  The rows have the columns of
    `end_values`.
    """
    final = paper.solve_theory(scene).final
    G = final.quantities["diffusion"] / paper.HARDNESS**2
    p0 = scene.load.final / paper.HARDNESS
    ends = np.array([WINDOW, 1 - WINDOW])
    at_zero, below_window = persson.pressure_cumulative(ends, G, p0, 1.0)
    at_hardness = final.areas["raw"].elastic - below_window
    rows = []
    for end, area in zip(ENDS, (at_zero, at_hardness), strict=True):
        rows.append(
            {
                "end": end,
                DENSITY: 0.0,
                SLOPE: float(2 * area / WINDOW**2),
            }
        )
    return rows


def grid_limits(values: pd.DataFrame, quantity: str) -> pd.DataFrame:
    """Extrapolate a quantity to ever finer grids, surface by surface.

    The limit of each end has the errors of scatter and of the fit.  Slopes are taken
    without the coarsest grid, whose rims fill the window.

    Args:
        values: Rows of `end_values` with seed and points_per_wavelength.
        quantity: DENSITY or SLOPE.

    Returns:
        Columns end, the quantity, and the ends of its interval.
    """
    _, _, order = QUANTITIES[quantity]
    rows = []
    for end, group in values.groupby("end", sort=False):
        table = group.pivot(
            index="seed", columns="points_per_wavelength", values=quantity
        )
        if quantity == SLOPE:
            table = table.iloc[:, 1:]
        n = table.columns.to_numpy()
        limit = estimate([extrapolate(n, row, order)[0] for row in table.to_numpy()])
        # The error of the fit is common to all surfaces and does not fall with their
        # number.
        _, fit_error = extrapolate(n, table.mean().to_numpy(), order)
        error = math.hypot(limit.half_width, fit_error)
        rows.append((end, limit.mean, limit.mean - error, limit.mean + error))
    columns = ["end", quantity, f"{quantity}_low", f"{quantity}_high"]
    return pd.DataFrame(rows, columns=columns)
