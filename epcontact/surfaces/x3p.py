"""Heights from .x3p files, by the rules of ISO 25178-72 (before: ISO 5436-2).

A file is a zip archive with a document main.xml, which may lie in a folder.  It
describes three axes and the matrix or the list of points.  The values are in the
document or in a binary member of the archive, all lengths are in m, and points without
a height are NaN or have no bit in a further member.  Elements are found by their names,
because programs write different namespaces and revisions.
"""

from __future__ import annotations

import math
import zipfile
from dataclasses import replace
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.surfaces.height_map import HeightMap, map_of_points
from epcontact.surfaces.map_errors import errors_of, require_small_archive
from epcontact.surfaces.profiles import profile_map

#: numpy's types of the values of an axis, by their letters in the document.
_TYPES = {"I": "<i2", "L": "<i4", "F": "<f4", "D": "<f8"}
_AXES = ("CX", "CY", "CZ")
#: What a user can do with a file that breaks the rules.
_REMEDY = "export it again, or as .sur, .nc or text"


def read_x3p(path: Path) -> HeightMap:
    """Return the heights of an .x3p file in m: a map, or a profile.

    Raises InvalidScene if the file is no zip archive, is damaged, holds several layers
    or points on no grid, or is far larger than a map.
    """
    with errors_of(path, "is no complete .x3p file", _REMEDY):
        require_small_archive(path)
        with zipfile.ZipFile(path) as archive:
            main = _main_member(archive, path)
            document = ElementTree.fromstring(archive.read(main))
            return _map_of_document(document, archive, PurePosixPath(main), path)


def _main_member(archive: zipfile.ZipFile, path: Path) -> str:
    """Return the name of the main.xml of an archive that lies in the fewest folders.

    Raises InvalidScene if the archive has none.
    """
    names = [n for n in archive.namelist() if n.lower().split("/")[-1] == "main.xml"]
    if not names:
        raise InvalidScene(
            f"{path}: is no .x3p file, because its archive holds no main.xml; {_REMEDY}"
        )
    return min(names, key=lambda name: (name.count("/"), name))


def _text(element: ElementTree.Element | None, names: str) -> str:
    """Return the text of an element below another, "" if it is absent.

    Args:
        element: the element to begin at, or None.
        names: the names on the way to the element, as "Record1/Axes/CX", in any
            namespace.
    """
    if element is None:
        return ""
    steps = "/".join(f"{{*}}{name}" for name in names.split("/"))
    return (element.findtext(steps) or "").strip()


def _number(element: ElementTree.Element | None, name: str, otherwise: float) -> float:
    """Return the finite number in an element below another, or `otherwise`."""
    text = _text(element, name).replace(",", ".")
    value = float(text) if text else otherwise
    return value if math.isfinite(value) else otherwise


def _map_of_document(
    document: ElementTree.Element,
    archive: zipfile.ZipFile,
    main: PurePosixPath,
    path: Path,
) -> HeightMap:
    """Return the map that the document of an archive describes.

    Args:
        document: the root of main.xml.
        archive: the open archive.
        main: the name of main.xml in the archive, to which links are relative.
        path: the file, for messages.

    Raises:
        InvalidScene: The document breaks the rules, or describes no map or profile.
    """
    axes = [document.find(f"{{*}}Record1/{{*}}Axes/{{*}}{name}") for name in _AXES]
    if axes[2] is None:
        raise InvalidScene(f"{path}: its main.xml describes no z axis; {_REMEDY}")
    record = document.find("{*}Record3")
    sizes = [_text(record, f"MatrixDimension/Size{name}") for name in "XYZ"]
    points = _text(record, "ListDimension")
    shape = (int(sizes[0] or points), int(sizes[1] or 1), int(sizes[2] or 1))
    if shape[2] > 1:
        raise InvalidScene(
            f"{path}: holds {shape[2]} layers of heights, but one is needed; export "
            "one layer"
        )
    if min(shape) < 1:
        raise InvalidScene(f"{path}: its main.xml states a size of {shape}; {_REMEDY}")
    is_absolute = [_text(axis, "AxisType").upper() == "A" for axis in axes[:2]]
    columns = [*is_absolute, True]
    values = _values(record, axes, columns, math.prod(shape), archive, main, path)
    x, y, z = (_scaled(values[:, i], axes[i]) for i in range(3))
    increments = [_number(axis, "Increment", 0.0) for axis in axes[:2]]
    has_one_y = not is_absolute[1] or bool((y == y[0]).all())
    if any(is_absolute) and shape[1] == 1 and has_one_y:
        if not is_absolute[0]:
            x = increments[0] * np.arange(float(z.size))
        return _in_metres(profile_map(x, z))
    if any(is_absolute):
        rows, line = np.divmod(np.arange(z.size), shape[0])
        if not is_absolute[0]:
            x = increments[0] * line.astype(np.float64)
        if not is_absolute[1]:
            y = increments[1] * rows.astype(np.float64)
        return _in_metres(map_of_points(np.stack([x, y, z], axis=1), path))
    heights = z.reshape(shape[1], shape[0]).T
    periods = [n * step for n, step in zip(shape, increments, strict=False)]
    if shape[1] == 1:
        heights = heights[:, 0]
        periods = periods[:1]
    has_sizes = min(periods) > 0
    return _in_metres(HeightMap(heights, periods=tuple(periods) if has_sizes else None))


def _in_metres(stored: HeightMap) -> HeightMap:
    """Return a map whose heights and lengths are in m, as the standard says."""
    return replace(
        stored,
        unit=1.0,
        length_unit=1.0,
        unit_source=".x3p files are in m",
        size_source="the increments of its axes",
    )


def _scaled(values: FloatArray, axis: ElementTree.Element | None) -> FloatArray:
    """Return the values of an axis in m: times its increment, plus its offset."""
    increment = _number(axis, "Increment", 1.0) or 1.0
    return values * increment + _number(axis, "Offset", 0.0)


def _values(
    record: ElementTree.Element | None,
    axes: list[ElementTree.Element | None],
    columns: list[bool],
    size: int,
    archive: zipfile.ZipFile,
    main: PurePosixPath,
    path: Path,
) -> FloatArray:
    """Return the values of all points along the three axes, (size, 3), before scaling.

    Args:
        record: the element Record3 of the document.
        axes: the elements of the axes x, y and z.
        columns: for each axis whether its values are stored; others are NaN.
        size: the number of points.
        archive: the open archive.
        main: the name of main.xml in the archive.
        path: the file, for messages.

    Raises:
        InvalidScene: A member is absent or too short, or a type is unknown.
    """
    values = np.full((size, 3), np.nan)
    link = _text(record, "DataLink/PointDataLink")
    if not link:
        listed = [] if record is None else record.findall("{*}DataList/{*}Datum")
        _require_points(len(listed), size, path)
        for row, datum in zip(values, listed, strict=False):
            numbers = [word.strip() for word in (datum.text or "").split(";")]
            if numbers[-1]:
                row[3 - len(numbers) :] = [float(word or "nan") for word in numbers]
        return values
    fields = []
    for name, axis, is_stored in zip(_AXES, axes, columns, strict=True):
        letter = _text(axis, "DataType").upper()
        if is_stored and letter not in _TYPES:
            raise InvalidScene(
                f"{path}: the values of its axis {name} have the type {letter!r}, but "
                f"{', '.join(_TYPES)} are the types of the standard; {_REMEDY}"
            )
        if is_stored:
            fields.append((name, _TYPES[letter]))
    content = archive.read(_member(archive, main, link, path))
    kind = np.dtype(fields)
    _require_points(len(content) // kind.itemsize, size, path)
    stored = np.frombuffer(content, kind, size)
    for index, name in enumerate(_AXES):
        if columns[index]:
            values[:, index] = stored[name]
    mask = _text(record, "DataLink/ValidPointsLink")
    if mask:
        bits = archive.read(_member(archive, main, mask, path))
        _require_points(8 * len(bits), size, path)
        values[~_valid_points(bits, size), 2] = np.nan
    return values


def _valid_points(content: bytes, size: int) -> NDArray[np.bool_]:
    """Return which of `size` points are valid: one bit each, the lowest bit first."""
    bits = np.frombuffer(content, np.uint8)
    return np.unpackbits(bits, count=size, bitorder="little").astype(bool)


def _require_points(stored: int, size: int, path: Path) -> None:
    """Raise InvalidScene if fewer points are stored than main.xml states.

    Args:
        stored: the number of points that a member or the document holds.
        size: the number of points that main.xml states.
        path: the file, for the message.
    """
    if stored < size:
        raise InvalidScene(
            f"{path}: holds {stored} of the {size} points that its main.xml states; "
            f"{_REMEDY}"
        )


def _member(
    archive: zipfile.ZipFile, main: PurePosixPath, link: str, path: Path
) -> str:
    """Return the name of the member of an archive that a link of main.xml names.

    Args:
        archive: the open archive.
        main: the name of main.xml, to whose folder a link is relative.
        link: the link, with strokes or backslashes.
        path: the file, for the message.

    Raises:
        InvalidScene: The archive has no such member.
    """
    relative = link.replace("\\", "/").removeprefix("./").lstrip("/").lower()
    beside_main = str(main.parent / relative).lower()
    names = {name.replace("\\", "/").lower(): name for name in archive.namelist()}
    for candidate in (beside_main, relative):
        if candidate in names:
            return names[candidate]
    last = relative.split("/")[-1]
    for name in sorted(names):
        if name.split("/")[-1] == last:
            return names[name]
    raise InvalidScene(
        f'{path}: its archive does not hold "{link}", which main.xml names; {_REMEDY}'
    )
