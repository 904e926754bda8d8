"""The loads of a path as a table of texts, from the rows of a method's JSON file, and
sentences on what connects across the surface.

A row has a branch ("loading", "unloading" or "reloading") and, by the names of COLUMNS,
a mean over the surfaces, its error and the parts of the error by their sources.  The
error is None if it is not known.
"""

from __future__ import annotations

import collections
import itertools
import math
from collections.abc import Mapping, Sequence
from statistics import fmean
from typing import Any, NamedTuple

from epcontact.output.charts.style import unit_for
from epcontact.results import COLUMNS, ContactResult

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
            heading = words_of_column(name)
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


def words_of_column(name: str) -> str:
    """Return a name of COLUMNS in words.

    The flowed share is a fraction of grid points, and a little smaller than the plastic
    area of the largest load, which is a limit of fine grids; its words say so.
    """
    words = name.replace("_", " ")
    if name == "flowed_share":
        words += " of grid points"
    return words


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


class _Connection(NamedTuple):
    """Whether the gap or the contact connects across the surfaces at one load.

    Attributes:
        pressure: the mean pressure in Pa.
        areas: for each surface the fraction of the nominal area that is open, or in
            contact.
        needed: for each surface the fraction at which it would first connect, the
            widest gaps or the closest points first.
        errors: for each surface the error estimate of `needed`.
        answer: "yes", "no", "undecided within its error", or on how many of several
            surfaces it is each of these.
    """

    pressure: float
    areas: Sequence[float]
    needed: Sequence[float]
    errors: Sequence[float]
    answer: str

    @property
    def margin(self) -> float:
        """The mean area less that which is needed; positive if it connects."""
        return fmean(self.areas) - fmean(self.needed)


#: What can connect, with the ends of its sentence: what it needs, and what it has; {}
#: is a fraction of the nominal area.
_PARTS = {
    "gap": ("the widest {} of the area open", "{} is open"),
    "contact": ("the closest {} of the area in contact", "{} is in contact"),
}


def connection_sentences(results: Sequence[ContactResult]) -> list[str]:
    """Return sentences that say at which loads the gap and the contact connect.

    A gap that connects across the surface leaks.  What connects meets its own image in
    the next period; the answer compares the area with the smallest one that connects.

    Args:
        results: the results of one method, one for each surface.  Of a load without a
            percolation fraction nothing is said.

    Returns:
        A sentence on the gap and one on the contact; none without their values.
    """
    sentences = []
    for part in _PARTS:
        name = f"{part}_percolation"
        loads = []
        for steps in zip(*(result.steps for result in results), strict=True):
            rows = [step.row for step in steps]
            if all(name in row for row in rows):
                loads.append(_connection(rows, part))
        if loads:
            sentences.append(_connection_sentence(part, loads))
    return sentences


def _connection(rows: Sequence[Mapping[str, float]], part: str) -> _Connection:
    """Return whether the gap or the contact connects at a load.

    Args:
        rows: for each surface the columns of the load, see `LoadStep.row`.
        part: "gap" or "contact".
    """
    name = f"{part}_percolation"
    needed = [row[name] for row in rows]
    errors = [row.get(f"{name}_error", 0.0) for row in rows]
    areas = []
    answers = []
    for row, fraction, error in zip(rows, needed, errors, strict=True):
        area = row["total_area"]
        if part == "gap":
            area = 1 - area
        areas.append(area)
        margin = area - fraction
        if abs(margin) <= math.hypot(error, row.get("total_area_error", 0.0)):
            answers.append("undecided within its error")
        else:
            answers.append("yes" if margin > 0 else "no")
    counts = collections.Counter(answers)
    answer = answers[0]
    if len(counts) > 1:
        parts = [f"{answer} on {count}" for answer, count in counts.items()]
        answer = f"{', '.join(parts)} of {len(rows)} surfaces"
    return _Connection(rows[0]["mean_pressure"], areas, needed, errors, answer)


def _connection_sentence(part: str, loads: Sequence[_Connection]) -> str:
    """Return the sentence on the gap or the contact of `connection_sentences`.

    Args:
        part: "gap" or "contact".
        loads: whether it connects at each load, in the order of the path.
    """
    needs, has = _PARTS[part]
    scale, unit = unit_for(max(load.pressure for load in loads), "Pa")
    by_answer = itertools.groupby(loads, key=lambda load: load.answer)
    groups = [(answer, [*group]) for answer, group in by_answer]
    text = groups[0][0]
    if len(groups) > 1:
        texts = []
        for answer, group in groups:
            pressures = ", ".join(f"{load.pressure / scale:.4g}" for load in group)
            texts.append(f"{answer} at {pressures} {unit}")
        text = "; ".join(texts)
        for before, after in itertools.pairwise(loads):
            if before.margin * after.margin < 0:
                weight = before.margin / (before.margin - after.margin)
                change = before.pressure + weight * (after.pressure - before.pressure)
                text += f" (it changes near {change / scale:.3g} {unit})"
                break
    elif len(loads) > 1:
        text += " at every load"
    nearest = min(loads, key=lambda load: abs(load.margin))
    if len(nearest.needed) == 1:
        entry = {"mean": nearest.needed[0], "error": nearest.errors[0]}
        needed = _cell(entry, 1.0)
    else:
        needed = f"{min(nearest.needed):.3g} to {max(nearest.needed):.3g}"
    area = f"{fmean(nearest.areas):.4g}"
    return (
        f"The {part} connects across the surface: {text}. It needs "
        f"{needs.format(needed)}; at {nearest.pressure / scale:.4g} {unit}, "
        f"{has.format(area)}."
    )
