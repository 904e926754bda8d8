"""The loads of a path as a table of texts, from the rows of a method's JSON file.

A row has a branch ("loading", "unloading" or "reloading") and, by the names of COLUMNS,
a mean over the surfaces, its error and the parts of the error by their sources.  The
error is None if it is not known.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from epcontact.output.charts.style import unit_for
from epcontact.results import COLUMNS

#: Relative differences below this are those of rounding, and are shown without digits.
_ROUNDING = 1e-6
#: A row of a load, see `epcontact.harness.solving.method_results.load_rows`.
Row = Mapping[str, Any]


def load_cells(
    rows: Sequence[Row], units: Mapping[str, str] = COLUMNS
) -> list[list[str]]:
    """Return the results at each load as the texts of a table.

    Args:
        rows: one row for each load: its branch and, for each quantity by its name, the
            "mean" and the "error" in SI units and the "parts" of the error.
        units: the SI unit of each quantity that may be a column, by name, "" for a
            fraction; a quantity that no row has gets no column.

    Returns:
        The list of headings, and after it a list of texts for each row.  Each column
        has a prefixed unit that suits its largest value.  The last column has the
        error of the total area by sources.
    """
    scales = {}
    headings = ["branch"]
    for name, unit in units.items():
        means = [float(row[name]["mean"]) for row in rows if name in row]
        if means:
            scales[name], prefixed_unit = column_unit(means, unit)
            heading = name.replace("_", " ")
            if prefixed_unit:
                heading += f" ({prefixed_unit})"
            headings.append(heading)
    cells = [[*headings, "error of the total area by"]]
    for row in rows:
        texts = [_cell(row.get(name), scale) for name, scale in scales.items()]
        sources = row.get("total_area", {}).get("parts", {})
        parts = [f"{source} {float(part):.2g}" for source, part in sources.items()]
        cells.append([row.get("branch", ""), *texts, ", ".join(parts)])
    return cells


def difference_text(difference: float) -> str:
    """Return an absolute relative difference as text in per cent, with two digits.

    Differences below a millionth are those of rounding and have no digits.
    """
    if difference < _ROUNDING:
        return "< 0.0001 %"
    return f"{100 * difference:.2g} %"


def column_unit(values: Sequence[float], unit: str) -> tuple[float, str]:
    """Return the prefixed unit that suits the values of a column.

    Fractions and conductances times resistivity (1/m) keep their unit.

    Args:
        values: the values of the column in `unit`; some may not be finite.
        unit: the SI unit of the column, "" for a fraction.

    Returns:
        The number by which the values are divided, and the prefixed unit.
    """
    if unit in ("", "1/m"):
        return 1.0, unit
    sizes = filter(math.isfinite, map(abs, values))
    return unit_for(max(sizes, default=0.0), unit)


def _cell(entry: Row | None, scale: float) -> str:
    """Return a mean with its error as text, such as "1.25 ± 0.03".

    Args:
        entry: a dictionary with "mean" and "error" in an SI unit; the error is left out
            if it is 0 or None.  An entry of None gives "–".
        scale: mean and error are divided by this number.
    """
    if entry is None:
        return "–"
    mean = float(entry["mean"] or 0) / scale
    error = float(entry["error"] or 0) / scale
    if error == 0:
        return f"{mean:.4g}"
    return f"{mean:.4g} ± {error:.2g}"
