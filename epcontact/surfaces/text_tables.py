"""Tables of numbers in text files, as instruments and spreadsheets write them.

The separator is a semicolon, a tabulator, a comma or white space.  With any but the comma, numbers
may have a decimal comma.  Lines above the table that do not begin with a number are its header,
and # begins a comment.  Empty cells and NaN are points without a height.  Text that is not UTF-8
is read as UTF-16 if it begins like it, otherwise as Latin-1.  A list of x, y and height is refused.
"""

from __future__ import annotations

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
    text, encoding = _text(path.read_bytes())
    stripped = (line.partition("#")[0].strip(" \r\n\ufeff") for line in text.splitlines())
    lines = {number: line for number, line in enumerate(stripped, 1) if line}
    if not lines or "\0" in text:
        raise InvalidScene(f"{path}: is no table of numbers")
    separator, decimal = _form(list(lines.values())[-1])
    try:
        table = np.array(list(_rows(lines, separator, decimal)))
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
        for part, grid in (("column", table), ("line", table.T))
        if _looks_like_coordinates(grid)
    ]
    notes += [f"lines skipped above the table of heights: {header}"] * bool(header)
    notes += ["the commas of the file were read as decimal commas"] * (decimal == ",")
    notes += [f"the file is no UTF-8 and was read as {encoding}"] * (encoding != "utf-8")
    return (table.ravel() if 1 in table.shape else table), tuple(notes)


def _text(content: bytes) -> tuple[str, str]:
    encoding = "UTF-16" if content.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8"
    try:
        return content.decode(encoding), encoding
    except UnicodeDecodeError:
        return content.decode("latin-1"), "Latin-1"


def _form(line: str) -> tuple[str | None, str]:
    """Return the separator (None: white space) and the decimal mark of a line of numbers."""
    for separator in (";", "\t"):
        if separator in line:
            return separator, "," if "," in line else "."
    cells = line.split()
    decimal_commas = all(re.fullmatch(r"[^,]*\d,\d[^,]*|[^,]+", cell) for cell in cells)
    if "," not in line or (len(cells) > 1 and decimal_commas):
        return None, "," if "," in line else "."
    return ",", "."


def _rows(lines: dict[int, str], separator: str | None, decimal: str) -> Iterator[list[float]]:
    """Yield the numbers of each line below the header.  Raises ValueError, which names a line."""
    # With a decimal comma, a point makes no number.
    marks = str.maketrans(",.", ".,") if decimal == "," else {}
    width = 0
    for number, line in lines.items():
        row, wrong = [], ""
        for cell in (part.strip() for part in line.split(separator)):
            try:
                row.append(math.nan if cell.lower() in MISSING else float(cell.translate(marks)))
            except ValueError:
                wrong = wrong or cell
        if wrong and (width or re.match(r"[+-]?[.,]?\d", line)):
            shown = repr(wrong if len(wrong) <= 40 else wrong[:39] + "…")
            hint = "" if width else "; begin the lines of a header with #"
            raise ValueError(f"line {number} holds {shown}{hint}")
        if wrong:
            continue
        if len(row) != (width or len(row)):
            raise ValueError(f"line {number} holds {len(row)} numbers, the one above {width}")
        width = len(row)
        yield row
    if not width:
        raise ValueError("no line begins with a number")


def _is_list_of_points(table: FloatArray) -> bool:
    """Return whether the first two of three columns are the coordinates of a grid."""
    if table.shape[1] != 3 or len(table) < 4:
        return False
    x, y = table.T[:2]
    points = len(np.unique(table[:, :2], axis=0))
    return points == len(table) and np.unique(x).size * np.unique(y).size <= 2 * points


def _looks_like_coordinates(table: FloatArray) -> bool:
    """Return whether the first column alone has even steps, which heights may have as well."""
    # The corner between the coordinates of both axes may be empty.
    steps = np.diff(table[1:, :2], axis=0)
    if steps.shape[0] < 8 or steps.shape[1] < 2:
        return False
    even, beside = np.ptp(steps, axis=0) < 0.01 * np.abs(steps[0])
    return bool(even and not beside)
