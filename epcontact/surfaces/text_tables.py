"""Heights from tables of numbers in text, as instruments and spreadsheets write them.

The separator is a semicolon, a tabulator, a comma or white space.  With any but the
comma, numbers may have a decimal comma.  Lines above the table that do not begin with a
number are its header, and # begins a comment.  Empty cells, NaN and the errors of
spreadsheets (#N/A) are points without a height.  Text that is not UTF-8 is read as
UTF-16 if it begins like it, otherwise as Latin-1.  The heights of a table are as in a
picture: x runs along its lines.  Three columns of x, y and height on a grid are a map,
whose missing points have no height, and columns of x and height are a profile.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.surfaces.height_map import (
    AS_PICTURE,
    HeightMap,
    lengths_agree,
    map_of_points,
)
from epcontact.surfaces.profiles import (
    FEWEST,
    is_coordinate,
    profile_columns,
    profile_map,
)
from epcontact.surfaces.text_headers import (
    StatedLength,
    StatedScale,
    missing_mark,
    read_scale,
)

#: Words for a point without a height.
MISSING = {"", "nan", "na", "n/a", "bad", "---", "--", "-"}
#: What C writes for a number that is none, and spreadsheets for a cell without a value.
#: The # in these cells begins no comment.
_NO_NUMBER = r"[-+]?1[.,]#(?!inf)[a-z]+\d*|#(?:n/?a|nv|\w+(?:/0)?[!?])"
_INFINITE = r"1[.,]#inf\d*"
#: How a line that begins with a number begins.
_NUMBER_FIRST = r"[+-]?[.,]?\d"
#: Most characters of a wrong cell that a message shows.
_SHOWN = 40
#: Most columns of a table that may hold several profiles, and how many times as many
#: rows it then has.
_PROFILES, _LONG = 6, 3
#: Most lines that are searched for commas which separate and are decimal, too.
_SEARCHED = 16


def read_table(path: Path) -> HeightMap:
    """Return the heights of a text file, in the unit of the file.

    A table of several rows and columns is a surface (x runs along the rows), and a
    single row or column is a line.  Three columns of x, y and height are points on a
    grid, and two columns of x and height, or three with the number of the point in
    front, are a profile.  Units and lengths are those that the header states.

    Raises InvalidScene, with the number of the line, if the file is no table of
    numbers, or if its header states two different lengths, and OSError if the file
    cannot be read.
    """
    text, encoding = _decode(path.read_bytes())
    lines = _numbered_lines(text)
    if not lines or "\0" in text:
        raise InvalidScene(f"{path}: is no table of numbers")
    rows_of_text = [line for line in lines.values() if re.match(_NUMBER_FIRST, line)]
    rows_of_text = rows_of_text or list(lines.values())
    separator, decimal = _number_format(rows_of_text[-1])
    if separator == "," and _has_decimal_commas(rows_of_text[-_SEARCHED:]):
        raise InvalidScene(
            f"{path}: its commas separate the numbers and are decimal commas, too; "
            "separate the numbers by ; or tabs, or write them with points"
        )
    try:
        table = np.array(_rows(lines, separator, decimal))
    except ValueError as error:
        raise InvalidScene(f"{path}: is no table of numbers: {error}") from None
    skipped = len(lines) - len(table)
    first_row = list(lines)[skipped]
    header = text.splitlines()[: first_row - 1]
    scale = read_scale(header)
    while table.shape[1] > 1 and separator and np.isnan(table[:, -1]).all():
        table = table[:, :-1]  # each line ends with separators
    notes: list[str] = []
    if skipped:
        notes.append(f"lines skipped above the table of heights: {skipped}")
    if decimal == ",":
        notes.append("the commas of the file were read as decimal commas")
    if encoding != "utf-8":
        notes.append(f"the file is no UTF-8 and was read as {encoding}")
    mark = missing_mark(header)
    if mark is not None and (table == mark).any():
        table[table == mark] = math.nan
        notes.append(f"{mark:g} marks points without a height, as the header states")
    stored = _map_of_table(table, scale, path)
    return replace(stored, notes=(*notes, *stored.notes))


def _map_of_table(table: FloatArray, scale: StatedScale, path: Path) -> HeightMap:
    """Return the map, the line or the profile that a table of numbers is.

    Args:
        table: the numbers of the file, (rows, columns).
        scale: the units and lengths that the header of the file states.
        path: the file, for messages.

    Raises:
        InvalidScene: The points of the table are on no grid, two columns are no
            profile, or the header states two different lengths or a unit that is no
            length.
    """
    if scale.no_length:
        raise InvalidScene(
            f'{path}: its header states "{scale.no_length}", which is no unit of '
            "heights; export the channel of the heights, or correct the header"
        )
    profile = profile_columns(table)
    if profile is not None:
        return _with_column_units(profile_map(*profile), "x and height", scale)
    is_xyz = path.suffix.lower() == ".xyz" and table.shape[1] == 3
    if is_xyz or _lists_points(table):
        return _with_column_units(map_of_points(table, path), "x, y and height", scale)
    _require_no_profile(table, path)
    heights = table.ravel() if 1 in table.shape else table.T
    periods, source = _stated_lengths(heights.shape, scale, path)
    return HeightMap(
        heights,
        scale.unit,
        periods,
        length_unit=None if periods is None else 1.0,
        unit_source=scale.unit_source,
        size_source=source,
        notes=tuple(_coordinate_notes(table)),
        orientation=AS_PICTURE,
    )


def _require_no_profile(table: FloatArray, path: Path) -> None:
    """Raise InvalidScene if a table is too narrow for a map, but is no profile either.

    Args:
        table: the numbers of the file, (rows, columns).
        path: the file, for the message.
    """
    rows, columns = table.shape
    if rows < FEWEST:
        return
    if columns == 2:
        raise InvalidScene(
            f"{path}: its two columns are no profile, because the first does not "
            "increase from row to row; give x and height, or the heights alone"
        )
    is_long = rows > _LONG * columns
    if 3 <= columns <= _PROFILES and is_long and is_coordinate(table[:, 0]):
        raise InvalidScene(
            f"{path}: its {columns} columns are neither x, y and height of points on a "
            "grid, nor number, x and height of a profile; leave one column of heights "
            "beside x"
        )


def _with_column_units(
    stored: HeightMap, columns: str, scale: StatedScale
) -> HeightMap:
    """Return a list of points with the units that the header states for its columns.

    Args:
        stored: the map or line of the points; its lengths are in the unit of x.
        columns: what the columns are, for the note.
        scale: what the header states.
    """
    length_unit = scale.length_unit
    unit = scale.unit
    source = scale.unit_source
    if scale.columns:
        length_unit, unit = scale.columns[-2:]
        source = "the header of its columns"
    note = f"its columns are {columns}"
    if length_unit is not None:
        note += f", with x in units of {length_unit:g} m"
    return replace(
        stored,
        unit=unit,
        length_unit=length_unit,
        unit_source=source,
        notes=(*stored.notes, note),
    )


def _stated_lengths(
    shape: tuple[int, ...], scale: StatedScale, path: Path
) -> tuple[tuple[float, ...] | None, str]:
    """Return the lengths of a map in m that the header states, and its words for them.

    Args:
        shape: the number of heights along x and y, or along the line.
        scale: what the header states.
        path: the file, for the message.

    Returns:
        The lengths, None if the header does not state all of them; and the lines of
        the header that state them.

    Raises:
        InvalidScene: The distance of the points and the length of the map contradict
            each other.
    """
    y_length = scale.y_length
    if shape[0] == shape[-1] and y_length is None and scale.y_pixel is None:
        y_length = scale.x_length  # the one size of a square map
    lengths = (scale.x_length, y_length)
    pixels = (scale.x_pixel, scale.y_pixel)
    periods = []
    sources = []
    for points, length, pixel in zip(shape, lengths, pixels, strict=False):
        if length is None and pixel is None:
            return None, ""
        stated = []
        if length is not None:
            stated.append(length)
        if pixel is not None:
            stated.append(StatedLength(points * pixel.value, pixel.source))
        first = stated[0]
        last = stated[-1]
        if not lengths_agree(first.value, last.value, points):
            raise InvalidScene(
                f'{path}: its header states "{first.source}" and, for {points} '
                f'points, "{last.source}", which contradict each other; correct one '
                "of them"
            )
        periods.append(first.value)
        sources.append(first.source)
    return tuple(periods), ", ".join(dict.fromkeys(sources))


def _decode(content: bytes) -> tuple[str, str]:
    """Return the text of a file's content, and the name of its encoding.

    The encoding is UTF-16 if the content begins with its mark, otherwise UTF-8 or, if
    the content is no UTF-8, Latin-1.
    """
    encoding = "UTF-16" if content.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8"
    try:
        return content.decode(encoding), encoding
    except UnicodeDecodeError:
        return content.decode("latin-1"), "Latin-1"


def _numbered_lines(text: str) -> dict[int, str]:
    """Return the lines of a text that hold more than a comment, by numbers from 1.

    Comments (from # on), quotes and white space at both ends are removed.
    """
    for cell, number_word in (("no data|" + _NO_NUMBER, "nan"), (_INFINITE, "inf")):
        pattern = rf"(?<![\w#])(?:{cell})(?![\w#])"
        text = re.sub(pattern, number_word, text, flags=re.IGNORECASE)
    lines = {}
    for number, line in enumerate(text.splitlines(), 1):
        content = line.partition("#")[0].replace('"', "").strip(" \r\n\ufeff")
        if content:
            lines[number] = content
    return lines


def _number_format(line: str) -> tuple[str | None, str]:
    """Return how the numbers of a line of text are separated and written.

    Returns:
        The separator of the numbers, ";", a tabulator, "," or None for white space; and
        the decimal mark, "." or ",".
    """
    has_comma = "," in line
    decimal = "," if has_comma else "."
    for separator in (";", "\t"):
        if separator in line:
            return separator, decimal
    cells = line.split()
    decimal_commas = all(re.fullmatch(r"[^,]*\d,\d[^,]*|[^,]+", cell) for cell in cells)
    if not has_comma or (len(cells) > 1 and decimal_commas):
        return None, decimal
    return ",", "."


def _has_decimal_commas(lines: list[str]) -> bool:
    """Return True if the commas of these lines both separate numbers and are decimal.

    An example is "1,05,2,17" for 1.05 and 2.17.  Such lines are recognised by every
    second cell: all of these hold digits of one length, and some begin with a zero.
    """
    rows = [line.rstrip(", ").split(",") for line in lines]
    if any(len(row) % 2 for row in rows):
        return False
    decimals = [cell.strip() for row in rows for cell in row[1::2]]
    one_length = len({len(cell) for cell in decimals}) == 1
    if not one_length or not all(cell.isdigit() for cell in decimals):
        return False
    return any(re.match(r"0\d", cell) for cell in decimals)


def _rows(
    lines: dict[int, str], separator: str | None, decimal: str
) -> list[list[float]]:
    """Return the numbers of each line below the header, NaN for an empty cell.

    Args:
        lines: the lines of the file by their numbers, without comments.  Lines above
            the first line of numbers are the header, and so is a first line with
            fewer numbers than the second, such as the number of points.
        separator: the text between two numbers; None for white space.
        decimal: the decimal mark, "." or ",".

    Raises:
        ValueError: A line of the table holds anything but numbers, or another number of
            cells than the line above; or no line begins with a number.
    """
    # With a decimal comma, a point makes no number.
    marks = str.maketrans(",.", ".,") if decimal == "," else {}
    rows: list[list[float]] = []
    width = 0
    for number, line in lines.items():
        try:
            row = [_value(cell.strip(), marks) for cell in line.split(separator)]
        except ValueError as error:
            message = f"line {number} holds {error}"
            if width:
                raise ValueError(message) from None
            if re.match(_NUMBER_FIRST, line):
                raise ValueError(
                    f"{message}; begin the lines of a header with #, and separate "
                    "numbers by ; , tabs or spaces"
                ) from None
            continue  # a line of the header
        if len(rows) == 1 and width < len(row):
            rows.clear()
        elif width not in (0, len(row)):
            raise ValueError(
                f"line {number} holds {len(row)} numbers, the one above {width}"
            )
        width = len(row)
        rows.append(row)
    if not rows:
        raise ValueError("no line begins with a number")
    return rows


def _value(cell: str, marks: dict[int, int]) -> float:
    """Return the number in a cell of a table, NaN for a point without a height.

    Args:
        cell: the text of the cell without white space at its ends.
        marks: a table of `str.translate` that turns the decimal mark into a point.

    Raises:
        ValueError: The cell holds neither a number nor a word for a missing height; the
            message is the quoted cell.
    """
    if cell.lower() in MISSING:
        return math.nan
    try:
        return float(cell.translate(marks))
    except ValueError:
        shown = cell if len(cell) <= _SHOWN else cell[: _SHOWN - 1] + "…"
        raise ValueError(repr(shown)) from None


def _lists_points(table: FloatArray) -> bool:
    """Return True if a table lists points as x, y and height, not heights alone.

    Such a table has three columns, and its first two are the coordinates of at least
    four different points, which are at least half of the points of a grid.

    Args:
        table: the numbers of a file, (rows, columns).
    """
    if table.shape[1] != 3 or len(table) < 4:
        return False
    points = len(np.unique(table[:, :2], axis=0))
    places = np.unique(table[:, 0]).size * np.unique(table[:, 1]).size
    return points == len(table) and places <= 2 * points


def _coordinate_notes(table: FloatArray) -> Iterator[str]:
    """Yield a note if the first column or row may hold coordinates instead of heights.

    Coordinates are suspected where the numbers have even steps, and those of the column
    or row beside them have not.

    Args:
        table: the numbers of a file, (rows, columns).
    """
    for part, columns in (("column", table), ("line", table.T)):
        # The corner between the coordinates of both axes may be empty.  The difference
        # of the largest numbers would overflow without the factor.
        steps = np.diff(columns[1:, :2] / 4, axis=0)
        if steps.shape[0] >= 8 and steps.shape[1] == 2:
            first_is_even, second_is_even = np.ptp(steps, axis=0) < 0.01 * np.abs(
                steps[0]
            )
            if first_is_even and not second_is_even:
                yield (
                    f"the first {part} of the file has even steps; if these are "
                    "coordinates, leave them out"
                )
