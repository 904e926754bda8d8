"""The charts of results that the report and the pictures of a case share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from epcontact.errors import InvalidCase
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Axis, Plot, draw_table
from epcontact.output.charts.style import unit_for
from epcontact.results import ContactResult, FloatArray, PressureDistribution

#: The columns of pressures and of their densities, in SI units.
PRESSURE, DENSITY = "pressure_Pa", "density_per_Pa"


def pressure_distribution(
    results: Mapping[str, Sequence[ContactResult]],
    *,
    hardness: float = np.inf,
    theory: pd.DataFrame | None = None,
) -> Chart:
    """Draw Figure 5 of the paper: the probability density of the contact pressure.

    Densities (1/Pa) are fractions of the nominal area per pressure.

    The delta functions at zero pressure and at the hardness cannot be drawn; the legend
    states the area at the hardness.

    Args:
        results: the results of each method, one for each surface; the chart shows their
            mean.
        hardness: the hardness in Pa, which is marked; infinite for none.
        theory: densities by formula, with the columns series, PRESSURE and DENSITY.  A
            series with the name of a method replaces the method's binned pressures.

    Returns:
        The chart; its data have the columns series, pressure_Pa, density_per_Pa and the
        bounds of the density.

    Raises:
        InvalidCase: if no result has a pressure distribution, or there is no result.
    """
    distributions: dict[str, list[PressureDistribution]] = {}
    for method, each in results.items():
        for result in each:
            if result.distribution is not None:
                distributions.setdefault(method, []).append(result.distribution)
    if not distributions:
        raise InvalidCase(
            f"results of {len(results)} methods hold no pressure distribution; give "
            "results of a method that computes pressures, such as bem or persson"
        )
    formulas: dict[str, pd.DataFrame] = {}
    if theory is not None:
        formulas = {str(name): t for name, t in theory.groupby("series", sort=False)}
    densities = {
        method: formulas.get(method, _mean_density(method, tables))
        for method, tables in distributions.items()
    }
    table = pd.concat((densities | formulas).values())
    labels = {}
    for method, tables in distributions.items():
        plastic_area = float(np.mean([each.plastic for each in tables]))
        if plastic_area > 0:
            kind = "" if method in formulas else "counted "
            labels[method] = f"{method} ({kind}plastic area {plastic_area:.4g})"
    capped = bool(np.isfinite(hardness))
    # J2 elements press with more than the hardness of the other methods.
    largest = float(table[PRESSURE].max())
    if capped:
        largest = max(largest, hardness)
    scale, unit = unit_for(largest, "Pa")
    first_result = next(result for each in results.values() for result in each)
    upright = {r"$\sigma_0$": first_result.final.mean_pressure / scale}
    if capped:
        upright[r"$\sigma_\mathrm{P}$"] = hardness / scale
    plot = Plot(
        Axis(PRESSURE, rf"contact pressure $\sigma$ ({unit})"),
        Axis(DENSITY, rf"density $P(\sigma)$ (1/{unit})"),
        styles=dict.fromkeys(formulas, "curve"),
        labels=labels,
        scale=(scale, 1 / scale),
        limits={"xlim": (0, 1.04 * largest / scale), "ylim": (0, None)},
        upright=upright,
        title="How are the contact pressures distributed?",
    )
    caption = (
        "Probability density of the contact pressure per nominal area, mean of all "
        "surfaces. The shares of the area without contact and at the hardness are "
        "delta functions, which are not drawn."
    )
    chart = draw_table(table, plot, caption)
    header = ("series", PRESSURE, DENSITY, "low_per_Pa", "high_per_Pa")
    return replace(chart, header=header)


def residual_history(histories: Mapping[str, ArrayLike]) -> Chart:
    """Draw the dimensionless residual of each method against its iterations.

    Args:
        histories: the dimensionless residual after each iteration, by method.

    Raises:
        InvalidCase: if there is no history.
        ValueError: if no residual is a finite number.
    """
    if not histories:
        raise InvalidCase("histories are empty; give the residuals of a method by name")
    tables = []
    longest = 1
    for method, residuals in histories.items():
        count = np.size(residuals)
        longest = max(longest, count)
        columns = {"series": method, "iterations": range(count), "residual": residuals}
        tables.append(pd.DataFrame(columns))
    plot = Plot(
        Axis("iterations", "iterations (–)"),
        Axis("residual", "residual (–)"),
        log="y",
        ticks=range(0, longest, max(longest // 8, 1)),
        title="Did the iterations converge?",
    )
    caption = (
        "Residual of the iteration on the finest grid, of the surface that took "
        "longest."
    )
    return draw_table(pd.concat(tables), plot, caption)


def pressure_density(
    distribution: PressureDistribution, bins: int = 60, largest: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the mean density of the contact pressure in equal intervals.

    The density of an interval is the difference of the cumulative areas at its ends
    over its width.  So the sum of density times width is exactly the elastic area.

    Args:
        distribution: pressures (Pa) in rising order with their cumulative areas, as
            fractions of the nominal area.
        bins: the number of intervals.
        largest: the end of the last interval (Pa); None: the largest pressure.

    Returns:
        The middles of the intervals (Pa) and the densities (1/Pa), both of shape
        (bins,).
    """
    edges = np.linspace(0.0, largest or distribution.pressure[-1], bins + 1)
    pressure = np.concatenate([[0.0], distribution.pressure])
    area = np.interp(edges, pressure, np.concatenate([[0.0], distribution.cumulative]))
    area[0] = 0.0
    # Equal pressures make a step, which counts in the interval below it.
    return 0.5 * (edges[1:] + edges[:-1]), np.diff(area) / np.diff(edges)


def _mean_density(method: str, tables: Sequence[PressureDistribution]) -> pd.DataFrame:
    """Return the density of the pressure averaged over the surfaces of a method.

    Args:
        method: the name of the method, the value of the column `series`.
        tables: the distribution of each surface.  All are counted in the same 60
            intervals, which end at the largest pressure of any surface.

    Returns:
        A table with the columns series, PRESSURE (Pa, middles of the intervals) and
        DENSITY (1/Pa).
    """
    largest = max(float(table.pressure[-1]) for table in tables)
    densities = []
    for table in tables:
        middles, density = pressure_density(table, largest=largest)
        densities.append(density)
    mean = np.mean(densities, axis=0)
    return pd.DataFrame({"series": method, PRESSURE: middles, DENSITY: mean})
