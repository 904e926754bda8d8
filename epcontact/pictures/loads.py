"""Charts of results against the load, from the rows of the methods' JSON files."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas as pd

from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.output.charts.style import unit_for
from epcontact.output.loads import Row, column_unit
from epcontact.results import COLUMNS

#: For each chart of the loads a pattern of the names in COLUMNS that it shows, and the
#: label of its axis.
_CHARTS = {
    "areas": ("_area$", "contact area / nominal area"),
    "gap": ("mean_gap", "mean gap"),
    "stiffness": ("stiffness_", "stiffness"),
    "conductance": ("^conductance", "conductance times resistivity"),
    "thermal": ("thermal_conductance", "thermal conductance"),
    "electrical": ("electrical_conductance", "electrical conductance"),
    "percolation": ("_percolation", "share of the area that percolates"),
}
#: The names of these charts in a folder.
LOAD_CHARTS = tuple(f"loads-{name}" for name in _CHARTS)
_STYLES = {"unloading": "open", "reloading": "half"}


def load_charts(paths: Mapping[str, Sequence[Row]]) -> dict[str, Chart]:
    """Draw results against the mean pressure of their loads.

    Args:
        paths: the rows of each load path, by the name of its method.

    Returns:
        The charts by name, see LOAD_CHARTS; a chart without a value is left out.
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
    return charts


def _points_of_load(method: str, row: Row) -> Iterator[dict[str, Any]]:
    """Yield a point for each value of a load and each chart that shows it."""
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
        for chart, (pattern, _) in _CHARTS.items():
            if re.search(pattern, name):
                yield {
                    "chart": chart,
                    "method": method,
                    "quantity": words.replace("_", " "),
                    "branch": row["branch"],
                    "mean_pressure_Pa": float(row["mean_pressure"]["mean"]),
                    "value": mean,
                    # An error bar does not cross zero.
                    "value_low": max(mean - error, min(mean, 0.0)),
                    "value_high": highest,
                    "unit": unit,
                }


def _load_chart(name: str, table: pd.DataFrame) -> Chart:
    """Draw the points of one chart."""
    _, label = _CHARTS[name]
    pressure_scale, pressure_unit = unit_for(
        float(table["mean_pressure_Pa"].max()), "Pa"
    )
    scale, unit = column_unit([*table["value"]], table["unit"].iloc[0])
    unit = unit.replace("2", "²") or "–"
    plot = Plot(
        ("mean_pressure_Pa", f"mean pressure ({pressure_unit})"),
        ("value", f"{label} ({unit})"),
        ("method", "quantity", "branch"),
        _STYLES,
        mark="quantity",
        scale=(pressure_scale, scale),
    )
    marks = "marks are open on unloading, and half open on reloading"
    return draw_table(table, plot, f"{label.capitalize()} at each load; {marks}.")
