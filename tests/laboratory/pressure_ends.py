"""The density of the contact pressure at its ends, zero and the hardness.

`python -m laboratory.pressure_ends [--full]` draws the charts.
"""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from epcontact import bem, persson
from epcontact.bem.areas.distribution import end_fits, extrapolate
from epcontact.harness.gates import estimate
from epcontact.output.charts.plot import Axis, Plot
from epcontact.results import ContactResult
from epcontact.scene import Scene
from epcontact.studies import paper_scene as paper
from epcontact.studies.frame import (
    Charts,
    Ints,
    Rows,
    Say,
    Study,
    list_rows,
    mean_with_interval,
    tabulate,
)
from laboratory import charts

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


STUDY = Study("pressures", pressures, {"bandwidth": 128})

if __name__ == "__main__":
    charts.save(STUDY)
