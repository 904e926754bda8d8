"""Charts of results as curves: spectra, areas, pressure distributions, residuals.

Every function takes results or plain numbers in SI units and returns a `Chart`, whose `save` writes
PNG, SVG, CSV and caption.  A chart without any point to draw raises ValueError.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from epcontact.output.charts.figures import (
    Chart,
    Series,
    draw,
    logarithmic,
    long_table,
    mark_upright,
    new_figure,
    outside_legend,
    styled,
)
from epcontact.output.charts.style import CYCLE, STATE_COLOURS, unit_for
from epcontact.results import ELASTIC, PLASTIC, ContactResult, FloatArray, PressureDistribution


def power_spectrum(series: Sequence[Series], *, line: bool = False) -> Chart:
    """Figure 2 of the paper: the power spectral density against the wave number, log-log.

    Args:
        series: Wave numbers in rad/m and densities, of a surface or of a formula.
        line: The density is the one-dimensional C1 of a line in m^3, not C of a surface in m^4.

    Example:
        >>> chart = power_spectrum([Series("surface", [1e5, 1e6], [1e-20, 1e-24])])
        >>> chart.header[1:3]
        ('wavenumber_rad_per_m', 'density_m4')
    """
    power, name = (3, "C_1") if line else (4, "C")
    with styled():
        figure, (axes,) = new_figure()
        draw(axes, series, positive=True)
        for axis in "xy":
            logarithmic(axes, axis)
        axes.set_xlabel(r"wave number $q$ (rad/m)")
        axes.set_ylabel(rf"spectral density ${name}(q)$ (m$^{power}$)")
        if len(series) > 1:
            axes.legend()
    header = ("series", "wavenumber_rad_per_m", f"density_m{power}", "low", "high")
    return Chart(figure, header, long_table(series), "Power spectrum of the surface roughness.")


def areas_against_magnification(
    series: Sequence[Series], *, points: Mapping[str, float] | None = None, caption: str = ""
) -> Chart:
    """Figure 4 of the paper: contact areas against the magnification, log-log.

    Args:
        series: Magnifications and areas as fractions of the nominal area, usually the total,
            the elastic and the plastic area.  Areas of zero are left out.
        points: Areas by another method, by name, drawn at the highest magnification.
        caption: Replaces the general caption.

    Example:
        >>> chart = areas_against_magnification([Series("total", [1, 10], [1.0, 0.2])])
        >>> chart.rows[1][:3]
        ('total', 10.0, 0.2)
    """
    if not series:
        raise ValueError("there is nothing to draw: no areas are given")
    last = max(float(np.max(curve.x)) for curve in series)
    marks = [Series(name, [last], [area]) for name, area in (points or {}).items()]
    curves = [Series(s.name, s.x, s.y, s.low, s.high, line=True) for s in series]
    drawn = [*curves, *marks]
    with styled():
        figure, (axes,) = new_figure()
        draw(axes, drawn, colours=_state_colours([s.name for s in drawn]), positive=True)
        axes.set(
            xlabel=r"magnification $\zeta = q / q_0$ (–)", ylabel=r"contact area $A / A_0$ (–)"
        )
        # Areas vanish exponentially at low magnification and would squeeze everything else, so
        # the axis ends three decades below the largest area.
        top = max(float(np.max(s.y)) for s in drawn)
        low = min(float(np.min(s.y[s.y > 0])) for s in drawn)
        axes.set_ylim(max(0.7 * low, 1e-3 * top), 1.5 * top)
        for name in "xy":
            logarithmic(axes, name)
        axes.legend()
    header = ("series", "magnification", "area_fraction", "low", "high")
    general = "Contact areas against the magnification at which the surfaces are seen."
    return Chart(figure, header, long_table(drawn), caption or general)


def pressure_distribution(
    results: Mapping[str, Sequence[ContactResult]],
    *,
    hardness: float = np.inf,
    theory: Sequence[Series] = (),
) -> Chart:
    """Figure 5 of the paper: the probability density of the contact pressure, by each method.

    The delta functions at zero pressure and at the hardness cannot be drawn; the legend names
    the area at the hardness.

    Args:
        results: The results of each method, one for each surface; their mean is drawn.
        hardness: In Pa.
        theory: Densities by formula, in Pa and 1/Pa.  A density with the name of a method replaces
            that method's binned pressures.

    Raises:
        ValueError: If no result has a distribution.
    """
    tables = {
        method: [r.distribution for r in found if r.distribution is not None]
        for method, found in results.items()
    }
    tables = {method: found for method, found in tables.items() if found}
    plastic = {m: float(np.mean([t.plastic for t in found])) for m, found in tables.items()}
    curves = {curve.name: curve for curve in theory}
    series = [
        curves.pop(m) if m in curves else _mean_density(m, found) for m, found in tables.items()
    ]
    series += curves.values()
    top = hardness if np.isfinite(hardness) else max((s.x.max() for s in series), default=0.0)
    scale, unit = unit_for(float(top), "Pa")
    with styled():
        figure, (axes,) = new_figure(7.0, 3.6)
        draw(
            axes,
            [Series(s.name, s.x / scale, s.y * scale, line=s.line) for s in series],
            labels={m: f"{m} (plastic area {a:.4g})" for m, a in plastic.items() if a > 0},
        )
        mean_pressure = next(r.final.mean_pressure for found in results.values() for r in found)
        mark_upright(axes, mean_pressure / scale, r"$\sigma_0$")
        if np.isfinite(hardness):
            mark_upright(axes, hardness / scale, r"$\sigma_\mathrm{P}$", left=True)
        axes.set(
            xlim=(0, 1.04 * top / scale),
            ylim=(0, None),
            xlabel=rf"contact pressure $\sigma$ ({unit})",
            ylabel=rf"density $P(\sigma)$ (1/{unit})",
        )
        # Beside the axes: the legend would cover the label of the hardness at their upper end.
        outside_legend(axes)
    header = ("series", "pressure_Pa", "density_per_Pa", "low_per_Pa", "high_per_Pa")
    caption = (
        "Probability density of the contact pressure per nominal area, mean of all surfaces. "
        "The shares of the area without contact and at the hardness are delta functions, which "
        "are not drawn."
    )
    return Chart(figure, header, long_table(series), caption)


def residual_history(histories: Mapping[str, ArrayLike]) -> Chart:
    """The dimensionless residual of each method against its iterations, logarithmic.

    Example:
        >>> len(residual_history({"bem": [1.0, 1e-4, 1e-9]}).rows)
        3
    """
    series = [Series(m, np.arange(np.size(values)), values) for m, values in histories.items()]
    with styled():
        figure, (axes,) = new_figure(5.6, 3.6)
        draw(axes, series, positive=True)
        axes.set(xlabel="iterations (–)", ylabel="residual (–)")
        logarithmic(axes, "y")
        outside_legend(axes)
    header = ("series", "iterations", "residual", "low", "high")
    caption = "Residual of the iteration on the finest grid, of the surface that took longest."
    return Chart(figure, header, long_table(series), caption)


def pressure_density(
    distribution: PressureDistribution, bins: int = 60, largest: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """The mean density P(sigma) of the elastic contact in intervals of one width.

    The densities are differences of the cumulative areas, so that their sum is exactly the elastic
    area.

    Args:
        distribution: The pressure distribution of a result.
        bins: Number of intervals.
        largest: Pressure in Pa at which the last interval ends, to give several distributions
            the same intervals.  By default the largest pressure of this one.

    Returns:
        The middles of the intervals in Pa and the densities in 1/Pa, both of shape (bins,).

    Example:
        >>> half = PressureDistribution(np.array([0.0, 2.0]), np.array([0.0, 0.5]))
        >>> pressure_density(half, bins=2)
        (array([0.5, 1.5]), array([0.25, 0.25]))
    """
    edges = np.linspace(0.0, largest or distribution.pressure[-1], bins + 1)
    pressure = np.concatenate([[0.0], distribution.pressure])
    cumulative = np.concatenate([[0.0], distribution.cumulative])
    area = np.interp(edges, pressure, cumulative)
    area[0] = 0.0
    # Equal pressures make a step, which counts in the interval below it.
    return 0.5 * (edges[1:] + edges[:-1]), np.diff(area) / np.diff(edges)


def observed_order(x: ArrayLike, y: ArrayLike) -> float:
    """Return the least-squares slope of log y against log x; NaN with fewer than two points.

    Example:
        >>> round(observed_order([0.1, 0.2, 0.4], [0.01, 0.04, 0.16]), 12)
        2.0
    """
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    good = (x > 0) & (y > 0) & np.isfinite(x) & np.isfinite(y)
    if np.unique(x[good]).size < 2:
        return float("nan")
    return float(np.polyfit(np.log(x[good]), np.log(y[good]), 1)[0])


def pareto_front(cost: ArrayLike, error: ArrayLike) -> FloatArray:
    """Return the points (m, 2) that no other point beats in both, by rising cost; of ties one.

    Example:
        >>> pareto_front([1, 2, 3], [0.3, 0.5, 0.1]).tolist()
        [[1.0, 0.3], [3.0, 0.1]]
    """
    pairs = np.column_stack([np.ravel(cost), np.ravel(error)]).astype(np.float64)
    pairs = pairs[np.isfinite(pairs).all(axis=1)]
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    before = np.concatenate([[np.inf], np.minimum.accumulate(pairs[:, 1])[:-1]])
    return pairs[pairs[:, 1] < before]


def draw_front(axes: Any, series: Sequence[Series]) -> None:
    """Draw the Pareto front of the points (cost, error) of the series as steps behind them.

    An error of zero is not on the axis, but it beats every dearer point and ends the front.
    """
    cost, error = (np.concatenate([getattr(s, key) for s in series]) for key in "xy")
    cheapest_exact = cost[error == 0].min(initial=np.inf)
    shown = (error > 0) & (cost < cheapest_exact)
    front = pareto_front(cost[shown], error[shown])
    look = {"color": "#999999", "linewidth": 4, "alpha": 0.4, "zorder": 0}
    axes.step(*front.T, where="post", label="Pareto front", **look)


def _mean_density(method: str, tables: Sequence[PressureDistribution]) -> Series:
    """The density averaged over the surfaces, in common intervals."""
    largest = max(float(table.pressure[-1]) for table in tables)
    densities = [pressure_density(table, largest=largest) for table in tables]
    return Series(method, densities[0][0], np.mean([density for _, density in densities], axis=0))


def _state_colours(names: Sequence[str]) -> dict[str, str]:
    """The states' colours for series that have a state in their name, blue for totals."""
    words = {
        "total": CYCLE[0],
        "elastic": STATE_COLOURS[ELASTIC],
        "plastic": STATE_COLOURS[PLASTIC],
    }
    return {
        n: colour for n in names for word, colour in words.items() if word in re.findall(r"\w+", n)
    }
