"""One way to draw curves: a table of points, and a `Plot` that says what of it is
shown, and how.

A table is tidy: it has one row for each point, and its columns are named with their
units.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from epcontact.output.charts.figures import Chart, logarithmic, new_figure, styled
from epcontact.output.charts.style import (
    CYCLE,
    DASHES,
    MARKERS,
    METHOD_COLOURS,
    typeset,
)
from epcontact.results import FloatArray

#: Error bars stand side by side, within so many points of length at their marks.
_ABREAST = 6.0
_FILLS = {"open": "none", "half": "left"}
_GUIDE = {"color": "#7f7f7f", "linewidth": 0.9, "linestyle": ":"}


@dataclass(frozen=True)
class Plot:
    """The look of the chart of a table.

    x, y: the columns of the two axes, each with its label.  Columns `<y>_low` and
        `<y>_high` are drawn as error bars, along curves as bands.
    series: columns whose values name a series, joined by commas (an empty one is left
        out); the legend has the series in the order of their first rows.
    styles: how series are drawn, by their name or a value of one of their columns:
        "points" (marks joined by lines), "marks", "open" or "half" (full, open or half
        open marks alone) or "curve" (no marks); a column `style` of the table does the
        same.  Others have the style `style`.
    colour: the column whose values share a colour, with `colours` from value to colour,
        or in turn; none: each series has its own.
    mark: the column whose values share a mark, or the dashes of a curve; none: as of
        the colour.
    labels: entries of the legend that differ from the names of the series; "_" is none.
    scale: what x and y are divided by in the picture; the data keep their units.
    log: the axes that are logarithmic, "x", "y" or "xy".
    ticks: places along x that are labelled; limits: of the axes, as keywords of
        `Axes.set`.
    level: height of a dotted line; upright: places of dotted upright lines, by their
        labels.
    orders: series whose observed order is shown in the legend as a positive number.
    front: draw the Pareto front of all series except curves; x is a cost and y an
        error.
    """

    x: tuple[str, str]
    y: tuple[str, str]
    series: Sequence[str] = ("series",)
    styles: Mapping[Any, str] = field(default_factory=dict)
    style: str = "points"
    colour: str = ""
    colours: Mapping[Any, str] = field(default_factory=dict)
    mark: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)
    scale: tuple[float, float] = (1.0, 1.0)
    log: str = ""
    ticks: Sequence[float] = ()
    limits: Mapping[str, Any] = field(default_factory=dict)
    level: float | None = None
    upright: Mapping[str, float] = field(default_factory=dict)
    orders: Sequence[str] = ()
    front: bool = False


@dataclass(frozen=True)
class _Line:
    """One series: its points, their bounds (NaN for none), its style, and the values of
    the columns by which it shares its colour and its mark.
    """

    name: str
    x: FloatArray
    y: FloatArray
    low: FloatArray
    high: FloatArray
    style: str
    group: Any
    kind: Any

    @property
    def bounded(self) -> bool:
        return not np.isnan(self.low).all()

    @property
    def barred(self) -> bool:
        return self.bounded and self.style != "curve"


def draw_table(table: pd.DataFrame, plot: Plot, caption: str) -> Chart:
    """Draw a table as series on one pair of axes, with the legend beside it.  Points
    that are not finite, or not positive on a logarithmic axis, are left out of the
    picture; values of zero of joined points are drawn as open marks at its lower edge.
    The CSV of the chart has the columns series, x, y, low and high.  Raises ValueError
    if there is no point to draw.
    """
    groups = table.groupby(list(plot.series), sort=False, dropna=False)
    lines = [_line(values, group, plot) for values, group in groups]
    if not any((np.isfinite(one.x) & np.isfinite(one.y)).any() for one in lines):
        raise ValueError("there is nothing to draw: no series has a finite point")
    undecided, looks = _undecided(lines), _looks(lines, plot)
    with styled():
        figure, (axes,) = new_figure(6.4, 3.9)
        count = sum(one.barred for one in lines)
        places = iter(np.linspace(-0.5, 0.5, count) * min(2.0 * (count - 1), _ABREAST))
        for one, look in zip(lines, looks, strict=True):
            _draw(axes, one, look, plot, next(places) if one.barred else 0.0)
        axes.set(xlabel=typeset(plot.x[1]), ylabel=typeset(plot.y[1]), **plot.limits)
        for name in plot.log:
            logarithmic(axes, name)
        if plot.ticks:
            axes.set_xticks(
                plot.ticks, [f"{tick:g}" for tick in plot.ticks], minor=False
            )
            axes.set_xticks([], minor=True)
        if "y" in plot.log:
            _draw_zeros(axes, lines, looks)
        _draw_guides(axes, plot)
        if plot.front:
            _draw_front(axes, [one for one in lines if one.style != "curve"])
        # Beside the axes the legend can cover no point.
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
        if undecided:
            axes.set_title(
                "the intervals are wider than the differences", color="#a63c00"
            )
    rows = [
        (one.name, x, y, *((low, high) if one.bounded else ("", "")))
        for one in lines
        for x, y, low, high in np.column_stack(
            [one.x, one.y, one.low, one.high]
        ).tolist()
    ]
    words = f"{caption} {undecided}".rstrip()
    columns = ("series", plot.x[0], plot.y[0], "low", "high")
    return Chart(figure, columns, rows, typeset(words, mathtext=False))


def _line(values: Sequence[Any], group: pd.DataFrame, plot: Plot) -> _Line:
    name = ", ".join(str(value) for value in values if value != "")
    style = group["style"].iloc[0] if "style" in group else None
    if not isinstance(style, str):
        known = (plot.styles[key] for key in (name, *values) if key in plot.styles)
        style = next(known, plot.style)
    columns = [plot.x[0], plot.y[0], f"{plot.y[0]}_low", f"{plot.y[0]}_high"]
    x, y, low, high = group.reindex(columns=columns).to_numpy(np.float64).T
    colour, mark = (
        group[by].iloc[0] if by else name for by in (plot.colour, plot.mark)
    )
    return _Line(name, x, y, low, high, style, colour, mark)


def _looks(lines: Sequence[_Line], plot: Plot) -> list[dict[str, Any]]:
    """The colour, mark and dashes of each series, as keywords of matplotlib's `plot`.
    A series whose name begins with a method's name has the colour of the method; the
    others share the remaining colours of the cycle.  Curves have dashes but no marks.
    """
    own = [METHOD_COLOURS.get(one.name.split(" ")[0].rstrip(",:")) for one in lines]
    taken = METHOD_COLOURS.values() if any(own) else ()
    rest = itertools.cycle(colour for colour in CYCLE if colour not in taken)
    kinds: dict[bool, dict[Any, int]] = {
        False: {},
        True: {},
    }  # of curves, and of the others
    groups = dict.fromkeys(one.group for one in lines)
    shared = (
        dict(zip(groups, CYCLE, strict=False)) | dict(plot.colours)
        if plot.colour
        else {}
    )
    looks = []
    for one, colour in zip(lines, own, strict=True):
        curve, alone = one.style == "curve", one.style in ("marks", *_FILLS)
        number = kinds[curve].setdefault(one.kind, len(kinds[curve]))
        look: dict[str, Any] = {"color": colour or next(rest)}
        look["marker"] = None if curve else MARKERS[number % len(MARKERS)]
        dashes = DASHES[number % len(DASHES)]
        look["linestyle"] = dashes if curve else "none" if alone else "-"
        look["color"] = shared.get(one.group, look["color"])
        look |= {"fillstyle": _FILLS[one.style]} if one.style in _FILLS else {}
        if not curve and one.x.size > 25:
            look["markersize"] = 3.0
        looks.append(look)
    return looks


def _draw(
    axes: Any, one: _Line, look: Mapping[str, Any], plot: Plot, aside: float
) -> None:
    """Draw a series, its error bars so many points of length beside its marks."""
    from matplotlib.transforms import ScaledTranslation

    order = abs(observed_order(one.x, one.y)) if one.name in plot.orders else math.nan
    name = f"{one.name}: order {order:.2f}" if math.isfinite(order) else one.name
    good = np.isfinite(one.x) & np.isfinite(one.y)
    if "y" in plot.log:
        good &= one.y > 0
    x, unit = one.x[good] / plot.scale[0], plot.scale[1]
    axes.plot(
        x, one.y[good] / unit, label=typeset(plot.labels.get(one.name, name)), **look
    )
    if not one.bounded:
        return
    bounds = x, one.low[good] / unit, one.high[good] / unit
    if one.style == "curve":
        axes.fill_between(*bounds, color=look["color"], alpha=0.2, linewidth=0)
        return
    bars = axes.vlines(*bounds, color=look["color"], linewidth=0.9)
    move = ScaledTranslation(aside / 72, 0, axes.figure.dpi_scale_trans)
    bars.set_transform(axes.transData + move)


def _draw_zeros(
    axes: Any, lines: Sequence[_Line], looks: Sequence[dict[str, Any]]
) -> None:
    """Draw open marks on the lower edge of a logarithmic axis for values that are
    exactly zero.
    """
    floor = axes.get_ylim()[0]
    for one, look in zip(lines, looks, strict=True):
        x = one.x[one.y == 0]
        if one.style == "points" and x.size:
            hollow = look | {"linestyle": "none", "fillstyle": "none", "clip_on": False}
            known = "open, on the axis: 0" in axes.get_legend_handles_labels()[1]
            label = "_" if known else "open, on the axis: 0"
            axes.plot(x, np.full(x.size, floor), label=label, **hollow)
            axes.set_ylim(bottom=floor)


def _draw_guides(axes: Any, plot: Plot) -> None:
    if plot.level is not None:
        axes.axhline(plot.level, **_GUIDE)
    for label, x in plot.upright.items():
        axes.axvline(x, **_GUIDE)
        # A label in the right half of the picture is to the left of its line.
        left = (
            axes.transAxes.inverted().transform(axes.transData.transform((x, 0)))[0]
            > 0.5
        )
        text = f"{typeset(label)} " if left else f" {typeset(label)}"
        look = {"va": "top", "ha": "right" if left else "left", "color": "#555555"}
        axes.annotate(text, (x, 0.985), xycoords=("data", "axes fraction"), **look)


def _draw_front(axes: Any, lines: Sequence[_Line]) -> None:
    """Draw the Pareto front of the points (cost, error) as steps behind them; an error
    of zero is not on the axis, but it beats every dearer point and ends the front.
    """
    cost, error = (np.concatenate([getattr(one, key) for one in lines]) for key in "xy")
    cheapest_exact = cost[error == 0].min(initial=np.inf)
    shown = (error > 0) & (cost < cheapest_exact)
    front = pareto_front(cost[shown], error[shown])
    look = {"color": "#999999", "linewidth": 4, "alpha": 0.4, "zorder": 0}
    axes.step(*front.T, where="post", label="Pareto front", **look)


def _undecided(lines: Sequence[_Line]) -> str:
    """Return a warning if intervals are wider than the differences of series at most
    places.
    """
    told = pd.DataFrame(
        [
            (f"{x:.6g}", y, high - low)
            for one in lines
            if one.barred
            for x, y, low, high in zip(one.x, one.y, one.low, one.high, strict=True)
        ],
        columns=["x", "y", "width"],
    ).dropna()
    several = [place for _, place in told.groupby("x") if len(place) > 1]
    wide = [place["width"].median() > np.ptp(place["y"]) for place in several]
    if 2 * sum(wide) <= len(wide):
        return ""
    return (
        "At most places the intervals are wider than the differences between the series, so this "
        "chart does not tell them apart; more surfaces or a finer grid narrow the intervals."
    )


def observed_order(x: ArrayLike, y: ArrayLike) -> float:
    """Return the least-squares slope of log y against log x; NaN with fewer than two
    points.
    """
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    good = (x > 0) & (y > 0) & np.isfinite(x) & np.isfinite(y)
    if np.unique(x[good]).size < 2:
        return float("nan")
    return float(np.polyfit(np.log(x[good]), np.log(y[good]), 1)[0])


def pareto_front(cost: ArrayLike, error: ArrayLike) -> FloatArray:
    """Return the points (m, 2) that no other point beats in both, by rising cost; of
    ties one.
    """
    pairs = np.column_stack([np.ravel(cost), np.ravel(error)]).astype(np.float64)
    pairs = pairs[np.isfinite(pairs).all(axis=1)]
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    before = np.concatenate([[np.inf], np.minimum.accumulate(pairs[:, 1])[:-1]])
    return pairs[pairs[:, 1] < before]
