"""Charts of studies that the charts of results do not cover, in the same style."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from epcontact.output.charts.curves import draw_front, observed_order
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
            logarithmic(axes, name)
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
            draw_front(axes, [one for one in series if one.name in pareto])
        outside_legend(axes)
    return Chart(figure, ("series", *columns, "low", "high"), long_table(series), caption)


def with_orders(series: Sequence[Series], names: Sequence[str], sign: int = 1) -> dict[str, str]:
    """Labels that tell the observed order of the series called `names`.

    sign: -1 where x counts points, so that the error falls as x rises.
    """
    orders = {one.name: sign * observed_order(one.x, one.y) for one in series if one.name in names}
    return {name: f"{name}: order {p:.2f}" for name, p in orders.items() if math.isfinite(p)}
