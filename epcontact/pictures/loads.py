"""Charts of results against the load, from the rows of the methods' JSON files."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import pandas as pd

from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Axis, Plot, draw_table
from epcontact.output.charts.style import PART_COLOURS, unit_for
from epcontact.output.loads import Row, column_unit, words_of_column
from epcontact.results import COLUMNS


class _LoadChart(NamedTuple):
    """A chart of results against the load.

    Attributes:
        pattern: a regular expression for the names in COLUMNS that the chart shows.
        label: the label of its vertical axis; {unit} stands for the unit.
        title: the question that the chart answers.
    """

    pattern: str
    label: str
    title: str


#: The charts of the loads by their names.
_CHARTS = {
    "areas": _LoadChart(
        "_area$|^flowed_share$",
        "contact area / nominal area ({unit})",
        "How much of the surface is in contact?",
    ),
    "gap": _LoadChart("mean_gap", "mean gap ({unit})", "How far apart are the faces?"),
    "stiffness": _LoadChart(
        "stiffness_", "stiffness ({unit})", "How stiff is the contact?"
    ),
    "conductance": _LoadChart(
        "^conductance",
        "conductance times resistivity ({unit})",
        "How well does the contact conduct?",
    ),
    "thermal": _LoadChart(
        "thermal_conductance",
        "thermal conductance ({unit})",
        "How well does the joint conduct heat?",
    ),
    "electrical": _LoadChart(
        "electrical_conductance",
        "electrical conductance ({unit})",
        "How well does the joint conduct electricity?",
    ),
    "percolation": _LoadChart(
        "_percolation",
        "fraction of the area at which it connects ({unit})",
        "How much open or touching area would connect across the surface?",
    ),
}
#: The names of these charts in a folder.
LOAD_CHARTS = tuple(f"loads-{name}" for name in _CHARTS)
_STYLES = {"unloading": "open", "reloading": "half"}


def load_charts(paths: Mapping[str, Sequence[Row]]) -> dict[str, Chart]:
    """Draw results against the mean pressure of their loads.

    Args:
        paths: the rows of each load path, by the name of its method.

    Returns:
        The charts by name, see LOAD_CHARTS.  A chart without a value is left out, and
        so is that of conductance times resistivity if a conductance has a chart.
        Unloading and reloading have marks of their own.
    """
    points = [
        point
        for method, rows in paths.items()
        for row in rows
        for point in _points_of_load(method, row)
    ]
    if not points:
        return {}
    charts = {}
    for name, table in pd.DataFrame(points).groupby("chart", sort=False):
        charts[f"loads-{name}"] = _load_chart(str(name), table)
    if charts.keys() & {"loads-thermal", "loads-electrical"}:
        # It would show the same curve, without the conductivities.
        charts.pop("loads-conductance", None)
    return charts


def _points_of_load(method: str, row: Row) -> Iterator[dict[str, Any]]:
    """Yield a point for each quantity of a load and each chart that shows it.

    Args:
        method: the name of the method or of the curve, as the legend shows it.
        row: the results at one load, from `load_rows`: its branch, and for the mean
            pressure and each quantity a mean and an error (None: no error) in SI units.

    Yields:
        A row of the table of `_load_chart`: the chart's name, the method, the quantity
        in words, the branch, the mean pressure (Pa), the value with the ends of its
        error bar, and its unit ("" for a fraction).  Values that are not finite are
        left out.
    """
    for name, unit in COLUMNS.items():
        if name not in row:
            continue
        mean = float(row[name]["mean"])
        error = float(row[name]["error"] or 0)
        if not math.isfinite(mean):
            continue
        highest = mean + error
        if not unit:  # fractions of the nominal area
            highest = min(highest, 1.0)
        words = name.replace("ness_", "ness_if_").replace("loading", "loaded")
        for chart_name, chart in _CHARTS.items():
            if re.search(chart.pattern, name):
                yield {
                    "chart": chart_name,
                    "method": method,
                    "quantity": words_of_column(words),
                    "branch": row["branch"],
                    "mean_pressure_Pa": float(row["mean_pressure"]["mean"]),
                    "value": mean,
                    # An error bar does not cross zero.
                    "value_low": max(mean - error, min(mean, 0.0)),
                    "value_high": highest,
                    "unit": unit,
                }


def _load_chart(name: str, table: pd.DataFrame) -> Chart:
    """Draw the points of one chart.

    Args:
        name: the name of the chart, a key of _CHARTS.
        table: a row for each point, with the keys of `_points_of_load` as columns;
            values in SI units.  Unit and scale of the axis are those of its values.
    """
    highest_pressure = float(table["mean_pressure_Pa"].max())
    pressure_scale, pressure_unit = unit_for(highest_pressure, "Pa")
    scale, unit = column_unit([*table["value"]], table["unit"].iloc[0])
    label = _CHARTS[name].label
    # The colour of a method would be that of all series.
    one_method = table["method"].nunique() == 1
    labels = {}
    if one_method:
        # The legend needs no method, and is narrower.
        for row in table[["method", "quantity", "branch"]].to_numpy():
            labels[", ".join(row)] = ", ".join(row[1:])
    plot = Plot(
        Axis("mean_pressure_Pa", f"mean pressure ({pressure_unit})"),
        Axis("value", label.format(unit=unit.replace("2", "²") or "–")),
        ("method", "quantity", "branch"),
        _STYLES,
        colour="quantity" if one_method else "",
        colours={f"{part} area": colour for part, colour in PART_COLOURS.items()},
        mark="quantity",
        labels=labels,
        title=_CHARTS[name].title,
        compares=not one_method,
        scale=(pressure_scale, scale),
    )
    quantity = label.removesuffix(" ({unit})").capitalize()
    marks = "marks are open on unloading, and half open on reloading"
    methods = ", ".join(table["method"].unique())
    return draw_table(table, plot, f"{quantity} at each load by {methods}; {marks}.")
