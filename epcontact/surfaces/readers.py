"""Heights from files: .npy, tables of numbers, results (.vti), meshes and instruments'
formats.

Nothing is executed, so pickles are refused.  A .npy file is memory-mapped, so that a
header that promises more than the file holds is detected before memory is allocated.

A table of numbers is one as instruments and spreadsheets write it.  Its separator is a
semicolon, a tabulator, a comma or white space.  With any but the comma, numbers may
have a decimal comma.  Lines above the table that do not begin with a number are its
header, and # begins a comment.  Empty cells and NaN are points without a height.  Text
that is not UTF-8 is read as UTF-16 if it begins like it, otherwise as Latin-1.  The
heights of a table or .npy file are as in a picture: x runs along its lines.  Three
columns of x, y and height on a grid are a map, whose missing points have no height.
"""

from __future__ import annotations

import hashlib
import math
import re
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidScene, OutputError
from epcontact.machine import available_memory
from epcontact.output.vtk import read_fields
from epcontact.results import FloatArray

#: Words for a point without a height.
MISSING = {"", "nan", "na", "n/a", "bad", "---", "--", "-"}
_AS_PICTURE = (
    "x runs along the lines of the file and y from line to line, as in its picture"
)
#: Bytes that a zip file (.x3p) may unpack to, unless they are few for its size: heights
#: shrink ten times or so, zeros a thousand times.  A reader holds three times as much
#: (measured, 1.27).
_UNPACKED, _SHRUNK, _HELD = 2**28, 100, 3


@dataclass(frozen=True, eq=False)
class HeightMap:
    """The heights of a file, as it stores them, and sentences on how it was read."""

    heights: NDArray[Any]
    in_metres: bool = False  # whether the file gives its unit, and the heights are in m
    periods: tuple[float, ...] | None = (
        None  # in the unit of the heights, if the file gives them
    )
    notes: tuple[str, ...] = ()
    filled: NDArray[np.bool_] | None = None  # where a result says that heights were


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's content.  Raises InvalidScene if it cannot be
    read.
    """
    with _refusing(path), path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_heights(path: Path) -> HeightMap:
    """Read a file of heights by its ending.  Raises InvalidScene if it holds none."""
    with _refusing(path):
        if path.is_dir():
            raise InvalidScene(f"{path}: is a folder, but a file of heights is needed")
        if path.stat().st_size == 0:
            raise InvalidScene(f"{path}: is empty")
        return READERS.get(path.suffix.lower(), _read_instrument)(path)


@contextmanager
def _refusing(path: Path, words: str = "") -> Iterator[None]:
    """Turn errors of the system into InvalidScene; with words for them, those of a
    parser, too.
    """
    try:
        yield
    except InvalidScene:
        raise
    except OSError as error:
        raise InvalidScene(
            f"{path}: {(error.strerror or str(error)).lower()}"
        ) from None
    except (Exception, SystemExit) as error:  # each parser has errors of its own
        if not words:
            raise
        said = (
            " ".join(str(error).split("; use")[0].split()).rstrip(".")
            or type(error).__name__
        )
        said = said if len(said) <= 160 else said[:159] + "…"
        what, semicolon, remedy = words.partition(";")
        raise InvalidScene(f"{path}: {what} ({said}){semicolon}{remedy}") from None


def _read_npy(path: Path) -> HeightMap:
    with _refusing(path, "is no complete .npy file of numbers"):
        heights = np.lib.format.open_memmap(path, mode="r")
    return HeightMap(heights.T, notes=(_AS_PICTURE,) if heights.ndim == 2 else ())


def _read_fields(path: Path) -> HeightMap:
    """The surface that a result has left: the heights of its .vti file, less the
    plastic flow.
    """
    try:
        file = read_fields(path)
        heights = file.field("heights").astype(np.float64)
    except OutputError:
        raise InvalidScene(
            f"{path}: is no whole .vti file of a result with heights"
        ) from None
    if "plastic_displacement" in file.fields:
        heights -= file.fields["plastic_displacement"]
    elif file.attributes.get("option.law") == "j2":
        raise InvalidScene(
            f"{path}: its body is under load, and J2 flow shows only without it; let the load path "
            "of the result end at 0"
        )
    mask = file.fields.get("filled")
    filled = None if mask is None else mask.astype(bool)
    return HeightMap(heights, in_metres=True, periods=file.periods, filled=filled)


def _read_mesh(path: Path) -> HeightMap:
    """The heights z of a mesh whose points lie on a regular grid in x and y, NaN where
    none is.
    """
    import meshio

    # Text that meshio tries as numbers may overflow.
    with _refusing(path, "meshio cannot read it"), np.errstate(all="ignore"):
        mesh = getattr(meshio, path.suffix.lower()[1:]).read(path)
    return _gridded(np.asarray(mesh.points, np.float64), path)


def _gridded(points: FloatArray, path: Path) -> HeightMap:
    """The map of points (n, 3), x, y and height on a regular grid; NaN where no point
    is.
    """
    if (
        points.shape[1:] == (3,)
        and len(points) >= 4
        and np.isfinite(points[:, :2]).all()
    ):
        (x, dx), (y, dy) = map(_even_places, points.T[:2])
        nx, ny = int(x.max()) + 1, int(y.max()) + 1
        if min(nx, ny) >= 2 and nx * ny <= 2 * len(points) and dx * dy > 0:
            heights = np.full((nx, ny), np.nan)
            heights[x, y] = points[:, 2]
            if np.array_equal(
                heights[x, y], points[:, 2], equal_nan=True
            ):  # none above another
                return HeightMap(heights, periods=(nx * dx, ny * dy))
    raise InvalidScene(
        f"{path}: its points are no height map: they lie on no regular grid in x and y, or above "
        "each other; sample them on a grid first, or export the heights alone, line by line"
    )


def _even_places(values: FloatArray) -> tuple[NDArray[np.intp], float]:
    """Return the place of each coordinate on a ladder of even steps, and the step; 0 if
    off it by a hundredth of the step, as files keep few digits.
    """
    span, gaps = float(np.ptp(values)), np.diff(np.unique(values))
    if span == 0:
        return np.zeros(values.size, np.intp), 0.0
    step = span / round(span / float(np.median(gaps[gaps > 0.01 * gaps.max()])))
    ladder = (values - values.min()) / step
    place = np.rint(ladder).astype(np.intp)
    return place, step if np.abs(ladder - place).max() <= 0.01 else 0.0


def _read_instrument(path: Path) -> HeightMap:
    try:
        from SurfaceTopography import open_topography
    except ImportError:
        raise InvalidScene(
            f"{path}: reading {path.suffix or 'such'} files needs SurfaceTopography; "
            "pip install 'epcontact[instruments]', or convert it to .npy or text"
        ) from None
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as packed:
            size = sum(part.file_size for part in packed.infolist())
        shrunk = size > max(_UNPACKED, _SHRUNK * path.stat().st_size)
        if shrunk or size > max(_UNPACKED, available_memory() / _HELD):
            raise InvalidScene(
                f"{path}: unpacks from {path.stat().st_size / 2**20:.3g} MiB to "
                f"{size / 2**20:.3g} MiB, more than a map of heights does or memory holds; export "
                "it again"
            )
    words = (
        "SurfaceTopography cannot read it; export the map from the instrument's software as .x3p, "
        ".sur or .nc, which know their units, or as text, one line of heights after the other"
    )
    with _refusing(path, words), open_topography(str(path)) as reader:
        topography = reader.topography()
        if in_metres := topography.unit is not None:
            topography = topography.to_unit("m")
        if not topography.is_uniform:
            raise InvalidScene(
                f"{path}: its points lie on no regular grid; resample it first"
            )
        # Points without a height are masked.
        heights = np.ma.filled(np.ma.asarray(topography.heights(), np.float64), np.nan)
        periods = tuple(map(float, topography.physical_sizes)) if in_metres else None
        return HeightMap(heights, in_metres, periods)


# --- tables of numbers
# ---------------------------------------------------------------------------


def _read_table(path: Path) -> HeightMap:
    """The heights of a table: its lines are those of a picture, a single row or column
    a line.
    """
    text, encoding = _text(path.read_bytes())
    text = re.sub("no data", "nan", text, flags=re.IGNORECASE)
    stripped = (
        line.partition("#")[0].strip(" \r\n\ufeff") for line in text.splitlines()
    )
    lines = {number: line for number, line in enumerate(stripped, 1) if line}
    if not lines or "\0" in text:
        raise InvalidScene(f"{path}: is no table of numbers")
    separator, decimal = _form(list(lines.values())[-1])
    if (separator, decimal) == (",", ".") and _both(list(lines.values())[-16:]):
        raise InvalidScene(
            f"{path}: its commas separate the numbers and are decimal commas, too; separate the "
            "numbers by ; or tabs, or write them with points"
        )
    try:
        table = np.array(list(_rows(lines, separator, decimal)))
    except ValueError as error:
        raise InvalidScene(f"{path}: is no table of numbers: {error}") from None
    header = len(lines) - len(table)
    if table.shape[1] > 1 and separator and np.isnan(table[:, -1]).all():
        table = table[:, :-1]  # each line ends with a separator
    points = _is_list_of_points(table) or path.suffix.lower() == ".xyz"
    notes = [
        f"the first {part} of the file has even steps; if these are coordinates, leave them out"
        for part, grid in (("column", table), ("line", table.T))
        if not points and _looks_like_coordinates(grid)
    ]
    notes += [f"lines skipped above the table of heights: {header}"] * bool(header)
    notes += ["the commas of the file were read as decimal commas"] * (decimal == ",")
    notes += [f"the file is no UTF-8 and was read as {encoding}"] * (
        encoding != "utf-8"
    )
    if points:
        notes.append("its columns are x, y and height, all in one unit")
        return replace(_gridded(table, path), notes=tuple(notes))
    if 1 in table.shape:
        return HeightMap(table.ravel(), notes=tuple(notes))
    return HeightMap(table.T, notes=(*notes, _AS_PICTURE))


def _text(content: bytes) -> tuple[str, str]:
    encoding = "UTF-16" if content.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8"
    try:
        return content.decode(encoding), encoding
    except UnicodeDecodeError:
        return content.decode("latin-1"), "Latin-1"


def _form(line: str) -> tuple[str | None, str]:
    """Return the separator (None: white space) and the decimal mark of a line of
    numbers.
    """
    for separator in (";", "\t"):
        if separator in line:
            return separator, "," if "," in line else "."
    cells = line.split()
    decimal_commas = all(re.fullmatch(r"[^,]*\d,\d[^,]*|[^,]+", cell) for cell in cells)
    if "," not in line or (len(cells) > 1 and decimal_commas):
        return None, "," if "," in line else "."
    return ",", "."


def _both(lines: list[str]) -> bool:
    """True if every second cell between commas holds decimals: digits of one length,
    some with a zero in front.
    """
    rows = [line.rstrip(", ").split(",") for line in lines]
    after = [cell.strip() for row in rows for cell in row[1::2]]
    even = len({*map(len, after)}) == 1 and not any(len(row) % 2 for row in rows)
    return (
        even
        and all(map(str.isdigit, after))
        and any(re.match(r"0\d", one) for one in after)
    )


def _rows(
    lines: dict[int, str], separator: str | None, decimal: str
) -> Iterator[list[float]]:
    """Yield the numbers of each line below the header.  Raises ValueError, which names
    a line.
    """
    # With a decimal comma, a point makes no number.
    marks = str.maketrans(",.", ".,") if decimal == "," else {}
    width = 0
    for number, line in lines.items():
        row, wrong = [], ""
        for cell in (part.strip() for part in line.split(separator)):
            try:
                row.append(
                    math.nan
                    if cell.lower() in MISSING
                    else float(cell.translate(marks))
                )
            except ValueError:
                wrong = wrong or cell
        if wrong and (width or re.match(r"[+-]?[.,]?\d", line)):
            shown = repr(wrong if len(wrong) <= 40 else wrong[:39] + "…")
            hint = "; begin the lines of a header with #, and separate numbers by ; , tabs or spaces"
            hint = "" if width else hint
            raise ValueError(f"line {number} holds {shown}{hint}")
        if wrong:
            continue
        if len(row) != (width or len(row)):
            raise ValueError(
                f"line {number} holds {len(row)} numbers, the one above {width}"
            )
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
    """Return whether the first column alone has even steps, which heights may have as
    well.
    """
    # The corner between the coordinates of both axes may be empty.
    steps = np.diff(
        table[1:, :2] / 4, axis=0
    )  # a quarter, as the largest numbers would overflow
    if steps.shape[0] < 8 or steps.shape[1] < 2:
        return False
    even, beside = np.ptp(steps, axis=0) < 0.01 * np.abs(steps[0])
    return bool(even and not beside)


#: The reader of each ending; SurfaceTopography reads all others.
READERS: dict[str, Callable[[Path], HeightMap]] = {
    ".npy": _read_npy,
    ".vti": _read_fields,
    **dict.fromkeys((".txt", ".dat", ".csv", ".tsv", ".xyz"), _read_table),
    **dict.fromkeys((".stl", ".ply", ".vtu"), _read_mesh),
}
