"""Charts of studies that the charts of results do not cover, in the same style."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from epcontact.output.charts import observed_order, pareto_front
from epcontact.output.figures import (
    Chart,
    Series,
    draw,
    long_table,
    new_figure,
    outside_legend,
    styled,
    zeros_at_the_bottom,
)


def curves(  # noqa: PLR0913 - what a chart consists of, by keyword
    series: Sequence[Series],
    *,
    x: str,
    y: str,
    columns: tuple[str, str],
    caption: str,
    log: str = "",
    colours: Mapping[str, str] | None = None,
    labels: Mapping[str, str] | None = None,
    upright: Mapping[str, float] | None = None,
    level: float | None = None,
    pareto: Sequence[str] = (),
    limits: Mapping[str, Any] | None = None,
    ticks: Sequence[float] = (),
    apart: Sequence[str] = (),
    hollow: Sequence[str] = (),
    zeros: bool = False,
) -> Chart:
    """Curves and points on one axis, its legend beside it.

    x, y: labels with units; columns: the names of both in the CSV; log: "x", "y" or "xy";
    upright: dotted lines by their labels; level: a dotted horizontal line; pareto: the series
    among whose points (cost, error) the front is drawn; limits: of the axes; ticks: along x;
    apart: series whose points are not joined; hollow: series of open marks; zeros: show
    values of 0 below a logarithmic axis.
    """
    with styled():
        figure, (axes,) = new_figure(6.4, 3.9)
        draw(axes, series, colours=colours, labels=labels, positive="y" in log)
        axes.set(xlabel=x, ylabel=y, **(limits or {}))
        for name in log:
            axes.set(**{f"{name}scale": "log"})
            _readable_ticks(getattr(axes, f"{name}axis"))
        if ticks:
            axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks], minor=False)
            axes.set_xticks([], minor=True)
        for drawn in axes.lines:
            if drawn.get_label() in apart:
                drawn.set_linestyle("none")
            if drawn.get_label() in hollow:
                drawn.set_fillstyle("none")
        if zeros:
            zeros_at_the_bottom(axes, series)
        if level is not None:
            axes.axhline(level, color="#7f7f7f", linewidth=0.9, linestyle=":")
        for label, where in (upright or {}).items():
            axes.axvline(where, color="#7f7f7f", linewidth=0.9, linestyle=":")
            axes.annotate(
                f" {label}",
                (where, 0.99),
                xycoords=("data", "axes fraction"),
                va="top",
                color="#555555",
            )
        if pareto:
            _draw_front(axes, [one for one in series if one.name in pareto])
        outside_legend(axes)
    return Chart(figure, ("series", *columns, "low", "high"), long_table(series), caption)


def with_orders(series: Sequence[Series], names: Sequence[str], sign: int = 1) -> dict[str, str]:
    """Labels that tell the observed order of the series called `names`.

    sign: -1 where x counts points, so that the error falls as x rises.
    """
    orders = {one.name: sign * observed_order(one.x, one.y) for one in series if one.name in names}
    return {name: f"{name}: order {p:.2f}" for name, p in orders.items() if math.isfinite(p)}


def _draw_front(axes: Any, series: Sequence[Series]) -> None:
    cost, error = (np.concatenate([getattr(one, key) for one in series]) for key in "xy")
    # No error at all beats every dearer point; it has no place on the axis, but ends the front.
    cheapest_exact = cost[error == 0].min(initial=math.inf)
    shown = (error > 0) & (cost < cheapest_exact)
    front = pareto_front(cost[shown], error[shown])
    look = {"color": "#999999", "linewidth": 4, "alpha": 0.4, "zorder": 0}
    axes.step(*front.T, where="post", label="Pareto front", **look)


def _readable_ticks(axis: Any) -> None:
    """Ticks at 1, 2 and 5 where an axis spans little, whole decades elsewhere: labels of every
    minor tick would overlap."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    axis.set_minor_formatter(NullFormatter())
    if high < 200 * low:
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(FuncFormatter(_tick))


def _tick(value: float, _: object) -> str:
    if 0.01 <= value < 1e4:
        return f"{value:g}"
    power = math.floor(math.log10(value) + 1e-9)
    return rf"${value / 10**power:g}\times10^{{{power}}}$"
