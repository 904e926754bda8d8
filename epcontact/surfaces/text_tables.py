"""Tables of numbers in text files, as instruments and spreadsheets write them.

The separator is a semicolon, a tabulator, a comma or white space.  With any but the comma, numbers
may have a decimal comma.  Lines above the table that do not begin with a number are its header,
and # begins a comment.  Empty cells and NaN are points without a height.  Text that is not UTF-8
is read as UTF-16 if it begins like it, otherwise as Latin-1.  A list of x, y and height is
refused.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray

#: Words for a point without a height.
MISSING = {"", "nan", "na", "n/a", "bad", "---", "--", "-"}


def read_table(path: Path) -> tuple[FloatArray, tuple[str, ...]]:
    """Read a table: one row of the grid in each line, or a line of heights in a row or column.

    Args:
        path: the file.

    Returns:
        The heights, NaN where there is none, and notes on what was skipped or taken for granted.

    Raises:
        InvalidScene: if the file holds no table of numbers; the sentence names the line.
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
    rows: list[FloatArray] = []
    header = 0
    for number, line in lines:
        cells = [cell.strip() for cell in (line.split(separator) if separator else line.split())]
        try:
            rows.append(_numbers(cells, decimal))
        except ValueError:
            if rows or re.match(r"[+-]?[.,]?\d", cells[0]):
                hint = "" if rows else "; begin the lines of a header with #"
                raise InvalidScene(
                    f"{path}: is no table of numbers: line {number} holds {_wrong(cells, decimal)}"
                    f"{hint}"
                ) from None
            header += 1
    lengths = {row.size for row in rows}
    if len(lengths) != 1:
        raise InvalidScene(f"{path}: is no table of numbers: {_uneven(lines[header:], rows)}")
    table = np.array(rows)
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


def _numbers(cells: list[str], decimal: str) -> FloatArray:
    """Return the cells as numbers.  Raises ValueError if one is neither number nor missing."""
    if decimal == ",":
        if any("." in cell for cell in cells):
            raise ValueError("a point in a number with a decimal comma")
        cells = [cell.replace(",", ".") for cell in cells]
    try:
        return np.array(cells, dtype=np.float64)
    except ValueError:
        words = ["nan" if cell.lower() in MISSING else cell for cell in cells]
        return np.array(words, dtype=np.float64)


def _is_number(cell: str, decimal: str) -> bool:
    try:
        _numbers([cell], decimal)
    except ValueError:
        return False
    return True


def _wrong(cells: list[str], decimal: str) -> str:
    bad = next(cell for cell in cells if not _is_number(cell, decimal))
    return repr(bad if len(bad) <= 40 else bad[:39] + "…")


def _uneven(lines: list[tuple[int, str]], rows: list[FloatArray]) -> str:
    if not rows:
        return "no line begins with a number"
    for (before, after), (number, _) in zip(pairwise(rows), lines[1:], strict=False):
        if before.size != after.size:
            return f"line {number} holds {after.size} numbers, the one above {before.size}"
    return "its lines differ in length"
