"""The loads of a path as texts of a table and as curves, from the rows of a method's
JSON file.

A row has a branch and, by the names of COLUMNS, a mean over the surfaces, its error and
the parts of the error by their sources.  The error is None where none is known.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.output.charts.style import unit_for
from epcontact.results import COLUMNS

Row = Mapping[str, Any]


def load_cells(
    rows: Sequence[Row], units: Mapping[str, str] = COLUMNS
) -> list[list[str]]:
    """Return headings and rows of texts, in units that suit the largest value of each
    column.
    """
    known = {
        name: unit for name, unit in units.items() if any(name in row for row in rows)
    }
    scales = {
        name: _scale([r[name] for r in rows if name in r], u)
        for name, u in known.items()
    }
    titles = (
        f"{n.replace('_', ' ')}{f' ({u})' if u else ''}" for n, (_, u) in scales.items()
    )
    cells = [["branch", *titles, "error of the total area by"]]
    for row in rows:
        texts = (_cell(row.get(name), scale) for name, (scale, _) in scales.items())
        parts = row.get("total_area", {}).get("parts", {})
        made = ", ".join(
            f"{source} {float(part):.2g}" for source, part in parts.items()
        )
        cells.append([row.get("branch", ""), *texts, made])
    return cells


def _scale(entries: Sequence[Row], unit: str) -> tuple[float, str]:
    sizes = (abs(float(entry["mean"])) for entry in entries)
    largest = max(filter(math.isfinite, sizes), default=0.0)
    return (1.0, unit) if unit in ("", "1/m") else unit_for(largest, unit)


def _cell(entry: Row | None, scale: float) -> str:
    if entry is None:
        return "–"
    mean, error = (float(entry[key] or 0) / scale for key in ("mean", "error"))
    return f"{mean:.4g}" + (f" ± {error:.2g}" if error else "")


#: The charts of the loads: which quantities share one, and the label of their axis.
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
    """Draw the rows of each method against the mean pressure; branches have marks of
    their own.
    """
    points = [
        {
            "method": method,
            "quantity": said.replace("_", " "),
            "branch": row["branch"],
            "mean_pressure_Pa": float(row["mean_pressure"]["mean"]),
            "value": mean,
            "value_low": max(mean - error, min(mean, 0.0)),
            "chart": chart,
            "unit": COLUMNS[name],
            "value_high": mean + error if COLUMNS[name] else min(mean + error, 1.0),
        }
        for method, rows in paths.items()
        for row in rows
        for name in COLUMNS
        if name in row
        for chart, (part, _) in _CHARTS.items()
        if re.search(part, name)
        for mean, error in [(float(row[name]["mean"]), float(row[name]["error"] or 0))]
        for said in [name.replace("ness_", "ness_if_").replace("loading", "loaded")]
        if math.isfinite(mean)
    ]
    charts = {}
    for chart, table in pd.DataFrame(points).groupby("chart", sort=False):
        scale, unit = unit_for(float(table["mean_pressure_Pa"].max()), "Pa")
        over, of = _scale(
            [{"mean": mean} for mean in table["value"]], table["unit"].iloc[0]
        )
        y = ("value", f"{_CHARTS[str(chart)][1]} ({of.replace('2', '²') or '–'})")
        x, by = (
            ("mean_pressure_Pa", f"mean pressure ({unit})"),
            ("method", "quantity", "branch"),
        )
        plot = Plot(x, y, by, _STYLES, mark="quantity", scale=(scale, over))
        said = _CHARTS[str(chart)][1].capitalize()
        said += (
            " at each load; marks are open on unloading, and half open on reloading."
        )
        charts[f"loads-{chart}"] = draw_table(table, plot, said)
    return charts
