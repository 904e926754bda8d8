"""One way to draw curves: a table of points, and a `Plot` that says how it is drawn.

A table is tidy: it has one row for each point, and its columns are named with their
units.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from epcontact.output.charts.figures import Chart, logarithmic, new_figure, styled
from epcontact.output.charts.style import (
    CYCLE,
    DASHES,
    MARKERS,
    METHOD_COLOURS,
    label_text,
    typeset,
)
from epcontact.results import FloatArray

#: Width and height of a chart, and the margins for titles and labels of its axes
#: (inches).  The right margin is added to the width of the legend.
_SIZE = (6.4, 3.9)
_LEFT, _BOTTOM, _RIGHT, _TOP = 0.95, 0.5, 0.2, 0.45
#: Left margin beside the label and the ticks of the y axis, if these have names
#: (inches).
_TICKS = 0.2
#: Marks with error bars of several series stand side by side within this width, and
#: two are at most this far from each other (points of length).
_BARS_WIDTH, _BAR_DISTANCE = 6.0, 2.0
#: A series of more points has smaller marks.
_FEW_POINTS = 25
_FILLS = {"open": "none", "half": "left"}
_GUIDE = {"color": "#7f7f7f", "linewidth": 0.9, "linestyle": ":"}
#: The paper behind a text inside of the axes, which a curve may cross.
_PAPER = {"facecolor": "white", "alpha": 0.7, "linewidth": 0, "pad": 1.0}
_ZERO_LABEL = "open, on the axis: 0"


class Axis(NamedTuple):
    """What an axis of a chart shows.

    Attributes:
        column: the column of the table whose values lie along the axis.
        label: the text at the axis: quantity and, in parentheses, its unit.
    """

    column: str
    label: str


@dataclass(frozen=True)
class Plot:
    """How the chart of a table is drawn.

    Attributes:
        title: the question that the chart answers, above the axes.
        x, y: the column and the label of the horizontal and of the vertical axis.
            Columns `<y>_low` and `<y>_high` are drawn as error bars, along curves as
            bands.
        series: columns whose values name a series, joined by commas without empty ones.
            The legend has the series in the order of their first rows.
        styles: how series are drawn, by their name or a value of one of their columns:
            "points" (marks joined by lines), "marks", "open" or "half" (full, open or
            half open marks alone) or "curve" (no marks).  A column `style` of the table
            does the same.
        style: how the other series are drawn.
        colour: the column whose values share a colour; "": each series has its own.
        colours: the colours by values of that column; others follow in turn.
        mark: the column whose values share a mark, or the dashes of a curve; "": each
            series has its own.
        labels: entries of the legend that differ from the names of the series; "_" is
            no entry.
        scale: x and y are divided by these numbers in the picture; the data keep their
            units.
        log: the axes that are logarithmic, "x", "y" or "xy".
        ticks: the places along x that are labelled.
        limits: limits of the axes, as keywords of `Axes.set`.
        level: the height of a dotted line; None: no line.
        upright: the places of dotted upright lines, by their labels.
        orders: the series whose observed order is shown in the legend as a positive
            number.
        front: whether to draw the Pareto front of all series but curves; x is a cost
            and y an error then.
        compares: whether the series are compared with each other, so that a warning is
            added if their intervals are wider than their differences.
    """

    x: Axis
    y: Axis
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
    title: str = ""
    compares: bool = True


@dataclass(frozen=True)
class _Series:
    """One series of a chart.

    Attributes:
        name: its name.
        x, y: its points.
        low, high: the bounds of y; NaN if there are none.
        style: how it is drawn, see `Plot.styles`.
        colour_key: series of the same key share a colour.
        mark_key: series of the same key share a mark.
    """

    name: str
    x: FloatArray
    y: FloatArray
    low: FloatArray
    high: FloatArray
    style: str
    colour_key: Any
    mark_key: Any

    @property
    def is_finite(self) -> NDArray[np.bool_]:
        """True for each point of the series whose x and y are finite numbers."""
        return np.isfinite(self.x) & np.isfinite(self.y)

    @property
    def has_bounds(self) -> bool:
        """True if a point of the series has an interval, from `low` to `high`."""
        return not np.isnan(self.low).all()

    @property
    def has_bars(self) -> bool:
        """True if the intervals of the series are drawn as error bars, not as a
        band.
        """
        return self.has_bounds and self.style != "curve"

    def rows(self) -> Iterator[tuple[Any, ...]]:
        """Yield for each point of this series a row of the chart's data.

        A row is (name of the series, x, y, lower bound of y, upper bound of y).  Both
        bounds are "" if the series has none.
        """
        columns = np.column_stack([self.x, self.y, self.low, self.high])
        for x, y, low, high in columns.tolist():
            if self.has_bounds:
                yield self.name, x, y, low, high
            else:
                yield self.name, x, y, "", ""


def draw_table(table: pd.DataFrame, plot: Plot, caption: str) -> Chart:
    """Draw the rows of a table as series of points or curves in one chart.

    The legend is to the right of the axes.

    Points that are not finite, or not positive on a logarithmic axis, are left out of
    the picture; values of zero of joined points are drawn as open marks at its lower
    edge.

    Args:
        table: a row for each point.
        plot: the columns that are drawn, and how.
        caption: the caption.  A sentence is added if most intervals are wider than the
            differences between the series.

    Returns:
        The chart; its data have the columns series, x, y, low and high.

    Raises:
        ValueError: if there is no point to draw.
    """
    groups = table.groupby(list(plot.series), sort=False, dropna=False)
    all_series = [_series(values, group, plot) for values, group in groups]
    if not any(one.is_finite.any() for one in all_series):
        raise ValueError("there is nothing to draw: no series has a finite point")
    warning = _interval_warning(all_series) if plot.compares else ""
    looks = _looks(all_series, plot)
    with styled():
        figure, (axes,) = new_figure(*_SIZE, layout=None)
        shifts = _bar_shifts(all_series)
        for one, look, shift in zip(all_series, looks, shifts, strict=True):
            _draw_series(axes, one, look, plot, shift)
        axes.set_xlabel(typeset(plot.x.label))
        axes.set_ylabel(typeset(plot.y.label))
        axes.set(**plot.limits)
        for name in plot.log:
            logarithmic(axes, name)
        if plot.ticks:
            labels = [f"{tick:g}" for tick in plot.ticks]
            axes.set_xticks(plot.ticks, labels, minor=False)
            axes.set_xticks([], minor=True)
        if "y" in plot.log:
            _draw_zeros(axes, all_series, looks)
        _draw_guides(axes, plot)
        if plot.front:
            _draw_front(axes, all_series)
        # Beside the axes the legend can cover no point.
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2)
        _place_axes(figure, axes, "yticklabels" in plot.limits)
        # The title begins at the left edge, because the legend is at the right.
        title = typeset(plot.title)
        figure.text(0.1 / _SIZE[0], 0.985, title, va="top", fontsize=10)
        if warning:
            words = "the intervals are wider than the differences"
            axes.set_title(words, color="#a63c00", loc="left", fontsize=8)
    header = ("series", plot.x.column, plot.y.column, "low", "high")
    rows = [row for one in all_series for row in one.rows()]
    text = f"{caption} {warning}".rstrip()
    return Chart(figure, header, rows, typeset(text, mathtext=False))


def _place_axes(figure: Any, axes: Any, named_ticks: bool) -> None:
    """Place the axes of a chart between fixed margins, left of the legend.

    A layout engine of matplotlib would measure all labels twice, which takes longer
    than the drawing itself.

    Args:
        figure: the figure of matplotlib, of the size `_SIZE`.
        axes: its only axes, with or without a legend.
        named_ticks: whether the ticks of y have names, which may be longer than
            numbers, so that they are measured.
    """
    width, height = _SIZE
    right = _RIGHT
    left = _LEFT
    if named_ticks:
        ticks = axes.yaxis.get_tightbbox(figure.canvas.get_renderer())
        left = max(left, _TICKS + ticks.width / figure.dpi)
    legend = axes.get_legend()
    if legend is not None:
        right += legend.get_window_extent().width / figure.dpi
    figure.subplots_adjust(
        left=left / width,
        bottom=_BOTTOM / height,
        right=1 - right / width,
        top=1 - _TOP / height,
    )


def _series(values: Sequence[Any], group: pd.DataFrame, plot: Plot) -> _Series:
    """Return one series of a chart, with its points and the keys of its look.

    Args:
        values: what the rows of the series have in the columns `plot.series`.  The name
            of the series is these values without "", joined by commas.
        group: the rows of the series, with the columns that `plot` names.
        plot: the look of the chart: its columns and the style of each series.
    """
    name = ", ".join(str(value) for value in values if value != "")
    style = None
    if "style" in group:
        style = group["style"].iloc[0]
    if not isinstance(style, str):
        keys = (key for key in (name, *values) if key in plot.styles)
        style = plot.styles.get(next(keys, None), plot.style)
    y_column = plot.y.column
    columns = [plot.x.column, y_column, f"{y_column}_low", f"{y_column}_high"]
    x, y, low, high = group.reindex(columns=columns).to_numpy(np.float64).T
    colour_key = group[plot.colour].iloc[0] if plot.colour else name
    mark_key = group[plot.mark].iloc[0] if plot.mark else name
    return _Series(name, x, y, low, high, style, colour_key, mark_key)


def _looks(all_series: Sequence[_Series], plot: Plot) -> list[dict[str, Any]]:
    """Return colour, mark and dashes of each series, as keywords of `Axes.plot`.

    A series whose name begins with a method's name ("persson", "bem" or "fem") has the
    colour of the method; the others share the remaining colours of the cycle.  Curves
    have dashes but no marks.

    Args:
        all_series: the series of the chart, in the order of the legend.
        plot: the look of the chart, which may state colours.

    Returns:
        One dictionary for each series, in the same order.
    """
    of_methods = [_method_colour(one.name) for one in all_series]
    taken = METHOD_COLOURS.values() if any(of_methods) else ()
    free = itertools.cycle(colour for colour in CYCLE if colour not in taken)
    shared: dict[Any, str] = {}
    if plot.colour:
        keys = dict.fromkeys(one.colour_key for one in all_series)
        shared = dict(zip(keys, CYCLE, strict=False)) | dict(plot.colours)
    mark_numbers: dict[Any, int] = {}
    dash_numbers: dict[Any, int] = {}
    looks = []
    for one, of_method in zip(all_series, of_methods, strict=True):
        colour = of_method or next(free)
        look: dict[str, Any] = {"color": shared.get(one.colour_key, colour)}
        if one.style == "curve":
            number = dash_numbers.setdefault(one.mark_key, len(dash_numbers))
            look["linestyle"] = DASHES[number % len(DASHES)]
        else:
            number = mark_numbers.setdefault(one.mark_key, len(mark_numbers))
            look["marker"] = MARKERS[number % len(MARKERS)]
            if one.style != "points":
                look["linestyle"] = "none"
            if one.style in _FILLS:
                look["fillstyle"] = _FILLS[one.style]
            if one.x.size > _FEW_POINTS:
                look["markersize"] = 3.0
        looks.append(look)
    return looks


def _method_colour(name: str) -> str | None:
    """Return the colour of the method with which the name of a series begins.

    The colour is a text such as "#0072b2".  It is None if the first word of the name is
    not a method.
    """
    return METHOD_COLOURS.get(name.partition(" ")[0].rstrip(",:"))


def _bar_shifts(all_series: Sequence[_Series]) -> list[float]:
    """Return how far each series is shifted to the right.

    Without a shift, the bars of series that overlap at one x would hide each other.
    Shifts are in typographic points (1/72 inch), one for each series in the given
    order: 0 for a series whose bars meet no other bar.
    """
    tables = [
        pd.DataFrame({"series": number, "x": one.x, "low": one.low, "high": one.high})
        for number, one in enumerate(all_series)
        if one.has_bars
    ]
    shifts = [0.0] * len(all_series)
    if not tables:
        return shifts
    bars = pd.concat(tables).dropna()
    pairs = bars.merge(bars, on="x", suffixes=("", "_other"))
    overlaps = (pairs["low"] <= pairs["high_other"]) & (
        pairs["low_other"] <= pairs["high"]
    )
    is_other = pairs["series"] != pairs["series_other"]
    meeting = sorted(set(pairs["series"][overlaps & is_other]))
    width = min(_BAR_DISTANCE * (len(meeting) - 1), _BARS_WIDTH)
    places = np.linspace(-0.5, 0.5, len(meeting)) * width
    for number, place in zip(meeting, places.tolist(), strict=True):
        shifts[number] = place
    return shifts


def _draw_series(
    axes: Any, one: _Series, look: Mapping[str, Any], plot: Plot, shift: float
) -> None:
    """Draw the finite points of a series with their error bars or their band.

    Args:
        axes: the axes of matplotlib.
        one: the series.
        look: colour, mark and dashes of the series, keywords of `Axes.plot`.
        plot: the look of the chart: scales, logarithmic axes and labels.
        shift: how far the marks and their error bars are drawn to the right of their
            places, in typographic points (1/72 inch).
    """
    from matplotlib.transforms import ScaledTranslation

    label = one.name
    if one.name in plot.orders:
        order = abs(observed_order(one.x, one.y))
        if math.isfinite(order):
            label = f"{one.name}: order {order:.2f}"
    drawn = one.is_finite
    if "y" in plot.log:
        drawn &= one.y > 0
    x_scale, y_scale = plot.scale
    x = one.x[drawn] / x_scale
    label = typeset(label_text(plot.labels.get(one.name, label)))
    move = ScaledTranslation(shift / 72, 0, axes.figure.dpi_scale_trans)
    (line,) = axes.plot(x, one.y[drawn] / y_scale, label=label, **look)
    line.set_transform(axes.transData + move)
    if not one.has_bounds:
        return
    low = one.low[drawn] / y_scale
    high = one.high[drawn] / y_scale
    colour = look["color"]
    if one.style == "curve":
        axes.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0)
        return
    bars = axes.vlines(x, low, high, color=colour, linewidth=0.9)
    bars.set_transform(axes.transData + move)


def _draw_zeros(
    axes: Any, all_series: Sequence[_Series], looks: Sequence[dict[str, Any]]
) -> None:
    """Draw values that are exactly zero as open marks on the lower edge of the axes.

    The y axis is logarithmic, so that a zero has no place on it.  Series of other
    styles than "points" get no such marks.

    Args:
        axes: the axes of matplotlib, whose lower limit stays as it is.
        all_series: the series of the chart.
        looks: colour, mark and dashes of each series, keywords of `Axes.plot`.
    """
    lower_edge = axes.get_ylim()[0]
    for one, look in zip(all_series, looks, strict=True):
        x = one.x[one.y == 0]
        if one.style != "points" or x.size == 0:
            continue
        label = _ZERO_LABEL
        if label in axes.get_legend_handles_labels()[1]:
            label = "_"  # the legend has it once
        hollow = {"linestyle": "none", "fillstyle": "none", "clip_on": False}
        axes.plot(x, np.full(x.size, lower_edge), label=label, **(look | hollow))
        axes.set_ylim(bottom=lower_edge)


def _draw_guides(axes: Any, plot: Plot) -> None:
    """Draw the dotted horizontal line and the dotted vertical lines of a chart.

    Args:
        axes: the axes of matplotlib, which already show the data.
        plot: the look of the chart; `level` is the height of the horizontal line and
            `upright` has the places of the vertical ones by their labels.
    """
    if plot.level is not None:
        axes.axhline(plot.level, **_GUIDE)
    for label, x in plot.upright.items():
        axes.axvline(x, **_GUIDE)
        pixels = axes.transData.transform((x, 0))
        text = f" {typeset(label)}"
        side = "left"
        # A label in the right half of the picture is to the left of its line.
        if axes.transAxes.inverted().transform(pixels)[0] > 0.5:
            text = f"{typeset(label)} "
            side = "right"
        look = {"va": "top", "ha": side, "color": "#555555", "bbox": _PAPER}
        axes.annotate(text, (x, 0.985), xycoords=("data", "axes fraction"), **look)


def _draw_front(axes: Any, all_series: Sequence[_Series]) -> None:
    """Draw the Pareto front of all points, without those of curves, as a grey line.

    The x of a point is a cost and its y an error; the front joins the points that no
    other point beats in both.  A point with an error of zero is not on the logarithmic
    axis, but it beats every point of a higher cost and so ends the front.

    Args:
        axes: the axes of matplotlib.
        all_series: the series of the chart; at least one of them is not a curve.
    """
    points = [one for one in all_series if one.style != "curve"]
    cost = np.concatenate([one.x for one in points])
    error = np.concatenate([one.y for one in points])
    cheapest_exact = cost[error == 0].min(initial=np.inf)
    drawn = (error > 0) & (cost < cheapest_exact)
    front = pareto_front(cost[drawn], error[drawn])
    look = {"color": "#999999", "linewidth": 4, "alpha": 0.4, "zorder": 0}
    axes.step(*front.T, where="post", label="Pareto front", **look)


def _interval_warning(all_series: Sequence[_Series]) -> str:
    """Return a warning for the caption if the error bars hide all differences.

    The warning is a sentence.  It is "" unless, at more than half of the x where
    several series have a point, the median width of their intervals exceeds the
    difference between their largest and their smallest y.
    """
    tables = [
        pd.DataFrame({"x": one.x, "y": one.y, "width": one.high - one.low})
        for one in all_series
        if one.has_bars
    ]
    if not tables:
        return ""
    points = pd.concat(tables).dropna()
    places = points.groupby(points["x"].map("{:.6g}".format))
    wide = [
        place["width"].median() > np.ptp(place["y"])
        for _, place in places
        if len(place) > 1
    ]
    if 2 * sum(wide) <= len(wide):
        return ""
    return (
        "At most places the intervals are wider than the differences between the "
        "series, so this chart does not tell them apart; more surfaces or a finer grid "
        "narrow the intervals."
    )


def observed_order(x: ArrayLike, y: ArrayLike) -> float:
    """Return the observed order of convergence: the slope of log y against log x.

    The slope is that of the least-squares line through all points.

    Args:
        x, y: positive numbers of one shape, for example grid spacings and errors.
            Points that are not positive and finite are left out.

    Returns:
        The dimensionless slope; NaN with fewer than two different x.
    """
    x = np.asarray(x, dtype=float)
    y = np.asarray(y, dtype=float)
    good = (x > 0) & (y > 0) & np.isfinite(x) & np.isfinite(y)
    if np.unique(x[good]).size < 2:
        return float("nan")
    slope, _ = np.polyfit(np.log(x[good]), np.log(y[good]), 1)
    return float(slope)


def pareto_front(cost: ArrayLike, error: ArrayLike) -> FloatArray:
    """Return the points that no other point beats in both cost and error.

    Args:
        cost, error: two numbers of each point, in any unit, as arrays of one size.
            Points with a number that is not finite are left out.

    Returns:
        An array (m, 2) of the costs and errors, by rising cost.  Of equal points it has
        one.
    """
    pairs = np.column_stack([np.ravel(cost), np.ravel(error)]).astype(np.float64)
    pairs = pairs[np.isfinite(pairs).all(axis=1)]
    costs, errors = pairs.T
    by_cost = pairs[np.lexsort((errors, costs))]
    errors = by_cost[:, 1]
    least_before = np.minimum.accumulate([np.inf, *errors[:-1]])
    return by_cost[errors < least_before]
