"""The charts of results that the report and the pictures of a case share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
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
    """Figure 5 of the paper: the probability density of the contact pressure, by each
    method.

    Draws the mean over the results of each method, one for each surface, and marks the
    hardness (Pa).  `theory` has densities by formula in the columns series, PRESSURE
    and DENSITY; one with the name of a method replaces that method's binned pressures.
    The delta functions at zero pressure and at the hardness cannot be drawn; the legend
    names the area at the hardness.
    """
    known = {
        m: [r.distribution for r in each if r.distribution]
        for m, each in results.items()
    }
    found = {method: each for method, each in known.items() if each}
    exact = {} if theory is None else dict(list(theory.groupby("series", sort=False)))
    tables = {
        m: exact.get(m, _mean_density(m, each)) for m, each in found.items()
    } | exact
    table = pd.concat(tables.values())
    areas = {
        method: float(np.mean([t.plastic for t in each]))
        for method, each in found.items()
    }
    how = {method: "" if method in exact else "counted " for method in found}
    top = hardness if np.isfinite(hardness) else float(table[PRESSURE].max())
    scale, unit = unit_for(top, "Pa")
    pressure = next(r.final.mean_pressure for each in results.values() for r in each)
    upright = {r"$\sigma_0$": pressure / scale}
    if np.isfinite(hardness):
        upright[r"$\sigma_\mathrm{P}$"] = hardness / scale
    plot = Plot(
        (PRESSURE, rf"contact pressure $\sigma$ ({unit})"),
        (DENSITY, rf"density $P(\sigma)$ (1/{unit})"),
        styles=dict.fromkeys(exact, "curve"),
        labels={
            m: f"{m} ({how[m]}plastic area {a:.4g})" for m, a in areas.items() if a > 0
        },
        scale=(scale, 1 / scale),
        limits={"xlim": (0, 1.04 * top / scale), "ylim": (0, None)},
        upright=upright,
    )
    caption = (
        "Probability density of the contact pressure per nominal area, mean of all surfaces. "
        "The shares of the area without contact and at the hardness are delta functions, which "
        "are not drawn."
    )
    chart = draw_table(table, plot, caption)
    return replace(
        chart, header=("series", PRESSURE, DENSITY, "low_per_Pa", "high_per_Pa")
    )


def residual_history(histories: Mapping[str, ArrayLike]) -> Chart:
    """The dimensionless residual of each method against its iterations, logarithmic."""
    tables = [
        pd.DataFrame(
            {"series": method, "iterations": range(np.size(values)), "residual": values}
        )
        for method, values in histories.items()
    ]
    most = max(map(np.size, histories.values()), default=1)
    ticks = range(0, most, max(most // 8, 1))
    x, y = ("iterations", "iterations (–)"), ("residual", "residual (–)")
    caption = "Residual of the iteration on the finest grid, of the surface that took longest."
    return draw_table(pd.concat(tables), Plot(x, y, log="y", ticks=ticks), caption)


def pressure_density(
    distribution: PressureDistribution, bins: int = 60, largest: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """The middles (Pa) of `bins` intervals up to `largest`, and the mean density
    P(sigma) in each: a difference of cumulative areas (1/Pa), so that their sum is
    exactly the elastic area.
    """
    edges = np.linspace(0.0, largest or distribution.pressure[-1], bins + 1)
    pressure = np.concatenate([[0.0], distribution.pressure])
    area = np.interp(edges, pressure, np.concatenate([[0.0], distribution.cumulative]))
    area[0] = 0.0
    # Equal pressures make a step, which counts in the interval below it.
    return 0.5 * (edges[1:] + edges[:-1]), np.diff(area) / np.diff(edges)


def _mean_density(method: str, tables: Sequence[PressureDistribution]) -> pd.DataFrame:
    """The density averaged over the surfaces, in common intervals."""
    largest = max(float(table.pressure[-1]) for table in tables)
    densities = [pressure_density(table, largest=largest) for table in tables]
    mean = np.mean([density for _, density in densities], axis=0)
    return pd.DataFrame({"series": method, PRESSURE: densities[0][0], DENSITY: mean})
