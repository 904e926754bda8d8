"""Tables of numbers in text files, as instruments and spreadsheets write them.

The separator is a semicolon, a tabulator, a comma or white space.  With any but the comma, numbers
may have a decimal comma.  Lines above the table that do not begin with a number are its header,
and # begins a comment.  Empty cells and NaN are points without a height.  Text that is not UTF-8
is read as UTF-16 if it begins like it, otherwise as Latin-1.  A list of x, y and height is refused.
"""

from __future__ import annotations

import codecs
import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray

#: Words for a point without a height.
MISSING = {"", "nan", "na", "n/a", "bad", "---", "--", "-"}


def read_table(path: Path) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the heights of a file, NaN where there is none, and notes on how it was read.

    Each line is a row of the grid; a single row or column is a line of heights.  Raises
    InvalidScene if the file holds no table of numbers; the sentence names the line.
    """
    text, encoding = _text(path)
    lines = [
        (number, stripped)
        for number, line in enumerate(text.splitlines(), 1)
        if (stripped := line.partition("#")[0].strip(" \r\n\ufeff"))
    ]
    if not lines or "\0" in text:
        raise InvalidScene(f"{path}: is no table of numbers")
    separator, decimal = _form(lines[-1][1])
    try:
        table = np.array(_rows(lines, separator, decimal))
    except ValueError as error:
        raise InvalidScene(f"{path}: is no table of numbers: {error}") from None
    header = len(lines) - len(table)
    if table.shape[1] > 1 and separator and np.isnan(table[:, -1]).all():
        table = table[:, :-1]  # each line ends with a separator
    if _is_list_of_points(table):
        raise InvalidScene(
            f"{path}: its three columns are x, y and height; write the heights alone, one row of "
            "the grid in each line"
        )
    notes = [
        f"the first {part} of the file has even steps; if these are coordinates, leave them out"
        for part in _even_edges(table)
    ]
    if header:
        notes.append(f"lines skipped above the table of heights: {header}")
    if decimal == ",":
        notes.append("the commas of the file were read as decimal commas")
    if encoding != "utf-8":
        notes.append(f"the file is no UTF-8 and was read as {encoding}")
    return (table.ravel() if 1 in table.shape else table), tuple(notes)


def _text(path: Path) -> tuple[str, str]:
    content = path.read_bytes()
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    encoding = "UTF-16" if wide else "utf-8"
    try:
        return content.decode(encoding), encoding
    except UnicodeDecodeError:
        return content.decode("latin-1"), "Latin-1"


def _form(line: str) -> tuple[str | None, str]:
    """Return the separator (None: white space) and the decimal mark of a line of numbers."""
    for separator in (";", "\t"):
        if separator in line:
            return separator, "," if "," in line else "."
    if "," not in line:
        return None, "."
    cells = line.split()
    if len(cells) > 1 and all(re.fullmatch(r"[^,]*\d,\d[^,]*|[^,]+", cell) for cell in cells):
        return None, ","
    return ",", "."


def _rows(lines: list[tuple[int, str]], separator: str | None, decimal: str) -> list[list[float]]:
    """Return the numbers of each line below the header.  Raises ValueError, which names a line."""
    rows: list[list[float]] = []
    # With a decimal comma, a point makes no number.
    marks = str.maketrans(",.", ".,") if decimal == "," else {}
    for number, line in lines:
        row, wrong = [], None
        for cell in (part.strip() for part in line.split(separator)):
            try:
                row.append(math.nan if cell.lower() in MISSING else float(cell.translate(marks)))
            except ValueError:
                wrong = wrong or cell
        if wrong is None:
            if rows and len(row) != len(rows[-1]):
                raise ValueError(
                    f"line {number} holds {len(row)} numbers, the one above {len(rows[-1])}"
                )
            rows.append(row)
        elif rows or re.match(r"[+-]?[.,]?\d", line):
            shown = repr(wrong if len(wrong) <= 40 else wrong[:39] + "…")
            hint = "" if rows else "; begin the lines of a header with #"
            raise ValueError(f"line {number} holds {shown}{hint}")
    if not rows:
        raise ValueError("no line begins with a number")
    return rows


def _is_list_of_points(table: FloatArray) -> bool:
    """Return whether the first two of three columns are the coordinates of a grid."""
    if table.shape[1] != 3 or len(table) < 4:
        return False
    points = len(np.unique(table[:, :2], axis=0))
    grid = np.unique(table[:, 0]).size * np.unique(table[:, 1]).size
    return points == len(table) and grid <= 2 * len(table)


def _even_edges(table: FloatArray) -> Iterator[str]:
    """Yield the edges of a table that look like coordinates, which heights may do as well."""
    if min(table.shape) < 2:
        return
    # The corner between the coordinates of both axes may be empty.
    for part, grid in (("column", table), ("line", table.T)):
        if _even_steps(grid[1:, 0]) and not _even_steps(grid[1:, 1]):
            yield part


def _even_steps(values: FloatArray) -> bool:
    steps = np.diff(values)
    return steps.size >= 8 and bool(np.ptp(steps) < 0.01 * abs(steps[0]))
