"""One way to draw the table of a study: a `Plot` says which columns are shown, and how.

A table is tidy: it has one row for each point, and the columns are named with their units.  A
column `style` says how the points of a series are drawn: "points" (marks joined by lines; the
default), "marks" (marks alone), "open" (open marks alone) or "curve" (a line without marks).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

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
from epcontact.output.charts.style import CYCLE, typeset

_GUIDE = {"color": "#7f7f7f", "linewidth": 0.9, "linestyle": ":"}


@dataclass(frozen=True)
class Plot:
    """The look of the chart of a table.

    x, y: the columns of the two axes, each with its label.  Columns `<y>_low` and `<y>_high`
        are drawn as error bars, along curves as bands.
    series: columns whose values name a series, joined by commas (an empty one is left out); the
        legend has the series in the order of their first rows.
    colour: the column whose values share a colour, with `colours` from value to colour, or in
        turn; none: each series has its own.
    log: the axes that are logarithmic, "x", "y" or "xy".
    ticks: places along x that are labelled; limits: of the axes, as keywords of `Axes.set`.
    level: height of a dotted line; upright: places of dotted upright lines, by their labels.
    orders: series whose observed order is shown in the legend as a positive number.
    front: draw the Pareto front of all series except curves; x is a cost and y an error.
    """

    x: tuple[str, str]
    y: tuple[str, str]
    series: Sequence[str] = ("series",)
    colour: str = ""
    colours: Mapping[Any, str] = field(default_factory=dict)
    log: str = ""
    ticks: Sequence[float] = ()
    limits: Mapping[str, Any] = field(default_factory=dict)
    level: float | None = None
    upright: Mapping[str, float] = field(default_factory=dict)
    orders: Sequence[str] = ()
    front: bool = False


def draw_table(table: pd.DataFrame, plot: Plot, caption: str) -> Chart:
    """Draw a table as series on one pair of axes, with the legend beside it.

    Args:
        table: one row for each point.  Points that are not finite, or not positive on a logarithmic
            axis, are left out of the picture; values of zero of joined points are drawn as open
            marks at its lower edge.
        plot: the columns and their look.
        caption: a description of the picture with its parameters.

    Returns:
        The chart; its CSV has the columns series, x, y, low and high.

    Raises:
        ValueError: there is no point to draw.

    Example:
        >>> table = pd.DataFrame({"series": "raw", "points": [4, 8], "error": [0.1, 0.05]})
        >>> plot = Plot(x=("points", "points (–)"), y=("error", "error (–)"), log="xy")
        >>> print(draw_table(table, plot, "Error of the raw area.").csv())
        series,points,error,low,high
        raw,4.0,0.1,,
        raw,8.0,0.05,,
        <BLANKLINE>
    """
    groups = table.groupby(list(plot.series), sort=False, dropna=False)
    rows = {", ".join(str(part) for part in name if part != ""): group for name, group in groups}
    styles = {name: _style(group) for name, group in rows.items()}
    series = [_series(name, group, plot, styles[name]) for name, group in rows.items()]
    with styled():
        figure, (axes,) = new_figure(6.4, 3.9)
        orders, colours = _labels(series, plot.orders), _colours(rows, plot)
        labels = {name: typeset(orders.get(name, name)) for name in rows}
        draw(axes, series, colours=colours, labels=labels, positive="y" in plot.log)
        axes.set(xlabel=typeset(plot.x[1]), ylabel=typeset(plot.y[1]), **plot.limits)
        for name in plot.log:
            logarithmic(axes, name)
        if plot.ticks:
            axes.set_xticks(plot.ticks, [f"{tick:g}" for tick in plot.ticks], minor=False)
            axes.set_xticks([], minor=True)
        looks = {labels[name]: style for name, style in styles.items()}
        for line in axes.lines:
            if looks.get(line.get_label()) in ("marks", "open"):
                line.set_linestyle("none")
            if looks.get(line.get_label()) == "open":
                line.set_fillstyle("none")
        if "y" in plot.log:
            zeros_at_the_bottom(axes, [one for one in series if styles[one.name] == "points"])
        _draw_guides(axes, plot)
        if plot.front:
            draw_front(axes, [one for one in series if not one.line])
        outside_legend(axes)
        undecided = _undecided(series)
        if undecided:
            axes.set_title("the intervals are wider than the differences", color="#a63c00")
    header = ("series", plot.x[0], plot.y[0], "low", "high")
    words = f"{caption} {undecided}".rstrip()
    return Chart(figure, header, long_table(series), typeset(words, mathtext=False))


def _undecided(series: Sequence[Series]) -> str:
    """Return a warning if the intervals of most points are wider than all differences shown.

    Such a chart shows no trend; more surfaces would.
    """
    told = [one for one in series if one.low is not None and not one.line]
    if not told:
        return ""
    widths = np.concatenate([one.high - one.low for one in told])
    means = np.concatenate([one.y for one in told])
    known = np.isfinite(widths) & np.isfinite(means)
    if known.sum() < 2 or np.median(widths[known]) <= np.ptp(means[known]):
        return ""
    return (
        "The intervals are wider than the differences between the points, so this chart decides "
        "nothing; more surfaces (--full) narrow them."
    )


def _style(group: pd.DataFrame) -> str:
    style = group["style"].iloc[0] if "style" in group else "points"
    return style if isinstance(style, str) else "points"


def _series(name: str, group: pd.DataFrame, plot: Plot, style: str) -> Series:
    y = plot.y[0]
    low, high = (group.get(f"{y}_{end}") for end in ("low", "high"))
    if low is None or low.isna().all():
        low = high = None
    return Series(name, group[plot.x[0]], group[y], low, high, line=style == "curve")


def _colours(rows: Mapping[str, pd.DataFrame], plot: Plot) -> dict[str, str]:
    if not plot.colour:
        return {}
    values = {name: group[plot.colour].iloc[0] for name, group in rows.items()}
    cycle = dict(zip(dict.fromkeys(values.values()), CYCLE, strict=False)) | dict(plot.colours)
    return {name: cycle[value] for name, value in values.items()}


def _labels(series: Sequence[Series], names: Sequence[str]) -> dict[str, str]:
    orders = {s.name: abs(observed_order(s.x, s.y)) for s in series if s.name in names}
    return {name: f"{name}: order {p:.2f}" for name, p in orders.items() if math.isfinite(p)}


def _draw_guides(axes: Any, plot: Plot) -> None:
    if plot.level is not None:
        axes.axhline(plot.level, **_GUIDE)
    for label, place in plot.upright.items():
        axes.axvline(place, **_GUIDE)
        axes.annotate(
            f" {typeset(label)}",
            (place, 0.99),
            xycoords=("data", "axes fraction"),
            va="top",
            color="#555555",
        )
