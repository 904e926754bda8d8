"""Charts of curves: distributions, areas, spectra, accuracy against cost, convergence.

Every function takes plain numbers in SI units and returns a `Chart`, which is saved as PNG, SVG,
CSV and caption by its `save`.  A chart without a single point to draw is a ValueError.
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
    new_figure,
    outside_legend,
    styled,
    zeros_at_the_bottom,
)
from epcontact.output.charts.style import CYCLE, STATE_COLOURS, unit_for
from epcontact.results import ELASTIC, PLASTIC, FloatArray, PressureDistribution


def pressure_density(
    distribution: PressureDistribution, bins: int = 60, largest: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """The density P(sigma) of the elastic contact, (bins,) pressures in Pa and values in 1/Pa.

    The mean density in `bins` intervals of one width, from 0 to the largest pressure (or to
    `largest`, to give several distributions the same intervals): differences of the cumulative
    areas, so that their sum is the elastic area exactly.
    """
    edges = np.linspace(0.0, largest or distribution.pressure[-1], bins + 1)
    pressure = np.concatenate([[0.0], distribution.pressure])
    cumulative = np.concatenate([[0.0], distribution.cumulative])
    area = np.interp(edges, pressure, cumulative)
    area[0] = 0.0
    # Equal pressures make a step, which belongs to the interval below it.
    return 0.5 * (edges[1:] + edges[:-1]), np.diff(area) / np.diff(edges)


def pressure_distribution(
    series: Sequence[Series],
    *,
    mean_pressure: float,
    hardness: float = np.inf,
    plastic: Mapping[str, float] | None = None,
    caption: str = "",
) -> Chart:
    """P(sigma) of several methods on one axis; `series` hold sigma in Pa and P in 1/Pa.

    Theory goes in as `Series(..., line=True)`: equation (1) of the elastic and (3) of the capped
    contact.  `plastic`: areas at the hardness by name, told in the legend, as the delta function
    there cannot be drawn.
    """
    largest = max(float(np.max(one.x, initial=0.0)) for one in series) if series else 0.0
    scale, unit = unit_for(hardness if np.isfinite(hardness) else largest, "Pa")
    with styled():
        figure, (axes,) = new_figure()
        told = plastic or {}
        draw(
            axes,
            [_scaled(one, 1 / scale, scale) for one in series],
            labels={n: f"{n} (plastic area {a:.4g})" for n, a in told.items()},
        )
        axes.axvline(mean_pressure / scale, color="#7f7f7f", linewidth=0.9, linestyle=":")
        axes.annotate(
            r" $\sigma_0$",
            (mean_pressure / scale, 0.985),
            xycoords=("data", "axes fraction"),
            va="top",
            color="#555555",
        )
        right = 1.04 * (hardness if np.isfinite(hardness) else largest) / scale
        axes.set(
            xlim=(0, right),
            ylim=(0, None),
            xlabel=rf"contact pressure $\sigma$ ({unit})",
            ylabel=rf"density $P(\sigma)$ (1/{unit})",
        )
        if np.isfinite(hardness):
            axes.axvline(hardness / scale, color=STATE_COLOURS[PLASTIC], linewidth=0.9)
            axes.annotate(
                r"$\sigma_\mathrm{P}$ ",
                (hardness / scale, 0.985),
                xycoords=("data", "axes fraction"),
                va="top",
                ha="right",
            )
        axes.legend()
    told_caption = caption or (
        "Probability density of the contact pressure, per nominal area. The shares of the area "
        "without contact and at the hardness (delta functions) are not drawn."
    )
    header = ("series", "pressure_Pa", "density_per_Pa", "low_per_Pa", "high_per_Pa")
    return Chart(figure, header, long_table(series), told_caption)


def areas_against_magnification(
    series: Sequence[Series], *, points: Mapping[str, float] | None = None, caption: str = ""
) -> Chart:
    """Contact areas as fractions of the nominal area against the magnification, log-log.

    `series`: usually total, elastic and plastic; areas of zero are left out.  `points`: areas
    found by another method, drawn at the highest magnification.
    """
    if not series:
        raise ValueError("there is nothing to draw: no areas are given")
    last = max(float(np.max(one.x)) for one in series)
    marks = [Series(name, [last], [area]) for name, area in (points or {}).items()]
    curves = [Series(s.name, s.x, s.y, s.low, s.high, line=True) for s in series]
    with styled():
        figure, (axes,) = new_figure()
        names = [one.name for one in [*curves, *marks]]
        draw(axes, [*curves, *marks], colours=_state_colours(names), positive=True)
        axes.set(
            xlabel=r"magnification $\zeta = q / q_0$ (–)", ylabel=r"contact area $A / A_0$ (–)"
        )
        _room_below(axes, [*curves, *marks])
        for name in "xy":
            logarithmic(axes, name)
        axes.legend()
    told = caption or "Contact areas against the magnification at which the surfaces are seen."
    header = ("series", "magnification", "area_fraction", "low", "high")
    return Chart(figure, header, long_table([*curves, *marks]), told)


def power_spectrum(
    series: Sequence[Series],
    *,
    line: bool = False,
    marks: Mapping[str, float] | None = None,
    caption: str = "",
) -> Chart:
    """Power spectral density against the wave number (rad/m), log-log.

    `line`: the density is the one-dimensional C1 (m^3) rather than C (m^4).  `marks`: wave
    numbers drawn as upright lines, such as the roll-off, by their symbols.
    """
    power = 3 if line else 4
    name = "C_1" if line else "C"
    with styled():
        figure, (axes,) = new_figure()
        draw(axes, series, positive=True)
        for axis in "xy":
            logarithmic(axes, axis)
        axes.set_xlabel(r"wave number $q$ (rad/m)")
        axes.set_ylabel(rf"spectral density ${name}(q)$ (m$^{power}$)")
        for symbol, q in (marks or {}).items():
            axes.axvline(q, color="#7f7f7f", linewidth=0.9, linestyle=":")
            axes.annotate(
                f" {symbol}", (q, 0.02), xycoords=("data", "axes fraction"), color="#555555"
            )
        if len(series) > 1:
            axes.legend()
    told = caption or "Power spectrum of the surface roughness."
    header = ("series", "wavenumber_rad_per_m", f"density_m{power}", "low", "high")
    return Chart(figure, header, long_table(series), told)


def work_precision(
    series: Sequence[Series],
    *,
    cost: str = "time (s)",
    error: str = "relative error (–)",
    pareto: bool = False,
    caption: str = "",
) -> Chart:
    """Error against cost, log-log: down and to the left is better.

    `series`: cost and error of one method at rising effort; errors of zero are drawn at the
    bottom edge as open marks.  `pareto`: draw what no other point beats in both.
    """
    with styled():
        figure, (axes,) = new_figure(5.6, 3.8)
        draw(axes, series, positive=True)
        axes.set(xlabel=cost, ylabel=error)
        for name in "xy":
            logarithmic(axes, name)
        zeros_at_the_bottom(axes, series)
        if pareto:
            draw_front(axes, series)
        outside_legend(axes)
    told = caption or "Error against cost; down and to the left is better."
    return Chart(figure, ("series", cost, error, "low", "high"), long_table(series), told)


def convergence(
    series: Sequence[Series],
    *,
    resolution: str,
    error: str = "relative error (–)",
    caption: str = "",
) -> Chart:
    """Error against grid spacing (or another measure of resolution), log-log, with the slope of
    each series (its observed order, a least-squares fit) in the legend."""
    orders = {one.name: observed_order(one.x, one.y) for one in series}
    labels = {n: f"{n}: order {o:.2f}" for n, o in orders.items() if np.isfinite(o)}
    with styled():
        figure, (axes,) = new_figure(5.6, 3.8)
        draw(axes, series, labels=labels, positive=True)
        axes.set(xlabel=resolution, ylabel=error)
        for name in "xy":
            logarithmic(axes, name)
        outside_legend(axes)
    told = caption or "Error against resolution; the order is the slope of a fitted line."
    return Chart(figure, ("series", resolution, error, "low", "high"), long_table(series), told)


def history(
    series: Sequence[Series],
    *,
    count: str = "iterations",
    tolerance: float | None = None,
    caption: str = "",
) -> Chart:
    """Dimensionless residual against a count of iterations or transforms, logarithmic."""
    with styled():
        figure, (axes,) = new_figure(5.6, 3.6)
        draw(axes, series, positive=True)
        axes.set(xlabel=f"{count} (–)", ylabel="residual (–)")
        logarithmic(axes, "y")
        if tolerance is not None:
            axes.axhline(tolerance, color="#7f7f7f", linestyle=":", label="tolerance")
        outside_legend(axes)
    told = caption or "Residual of the solvers against their effort."
    return Chart(figure, ("series", count, "residual", "low", "high"), long_table(series), told)


def observed_order(x: ArrayLike, y: ArrayLike) -> float:
    """Slope of log y against log x by least squares; NaN with fewer than two positive points."""
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    good = (x > 0) & (y > 0) & np.isfinite(x) & np.isfinite(y)
    if np.unique(x[good]).size < 2:
        return float("nan")
    return float(np.polyfit(np.log(x[good]), np.log(y[good]), 1)[0])


def pareto_front(cost: ArrayLike, error: ArrayLike) -> FloatArray:
    """The points (m, 2) that no other beats in both, by rising cost; ties are kept once."""
    pairs = np.column_stack([np.ravel(cost), np.ravel(error)]).astype(np.float64)
    pairs = pairs[np.isfinite(pairs).all(axis=1)]
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    before = np.concatenate([[np.inf], np.minimum.accumulate(pairs[:, 1])[:-1]])
    return pairs[pairs[:, 1] < before]


def draw_front(axes: Any, series: Sequence[Series]) -> None:
    """What no point (cost, error) of the series beats in both, as steps behind them.

    No error at all beats every dearer point; it has no place on the axis, but ends the front.
    """
    cost, error = (np.concatenate([getattr(one, key) for one in series]) for key in "xy")
    cheapest_exact = cost[error == 0].min(initial=np.inf)
    shown = (error > 0) & (cost < cheapest_exact)
    front = pareto_front(cost[shown], error[shown])
    look = {"color": "#999999", "linewidth": 4, "alpha": 0.4, "zorder": 0}
    axes.step(*front.T, where="post", label="Pareto front", **look)


def _scaled(one: Series, x: float, y: float) -> Series:
    low, high = (None if b is None else b * y for b in (one.low, one.high))
    return Series(one.name, one.x * x, one.y * y, low, high, one.line)


def _room_below(axes: Any, series: Sequence[Series]) -> None:
    """Cut a logarithmic axis three decades below the largest value: areas vanish
    exponentially at low magnification and would squeeze everything else."""
    top = max(float(np.max(one.y)) for one in series)
    low = min(float(np.min(one.y[one.y > 0])) for one in series)
    axes.set_ylim(max(0.7 * low, 1e-3 * top), 1.5 * top)


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
