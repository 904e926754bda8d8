"""Heights from files: .npy, tables of numbers, results (.vti), meshes and instruments'
formats.

Nothing is executed, so pickles are refused.  A .npy file is memory-mapped, so that a
header that promises more than the file holds is detected before memory is allocated.
Its heights are as in a picture: x runs along its lines.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from epcontact.errors import InvalidScene, OutputError
from epcontact.machine import available_memory
from epcontact.output.vtk import read_fields
from epcontact.surfaces.height_map import HeightMap, map_of_points
from epcontact.surfaces.text_headers import unit_in_metres
from epcontact.surfaces.text_tables import AS_PICTURE, read_table

#: Bytes that a zip file (.x3p) may always unpack to, if they fit into memory.
_UNPACKED = 2**28
#: Times its size that a larger zip file may unpack to: heights shrink ten times or so,
#: zeros a thousand times.
_SHRUNK = 100
#: Times the unpacked bytes that a reader holds in memory; 1.27 were measured.
_HELD = 3
#: Most characters of the message of a parser that a message shows.
_SHOWN = 160


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's content, as hexadecimal digits.

    Raises InvalidScene if it cannot be read.
    """
    with _errors_of(path), path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_heights(path: Path) -> HeightMap:
    """Return the heights of a file, whose ending says how it is read.

    Raises InvalidScene if the file cannot be read, or holds no map of heights.
    """
    with _errors_of(path):
        if path.is_dir():
            raise InvalidScene(f"{path}: is a folder, but a file of heights is needed")
        if path.stat().st_size == 0:
            raise InvalidScene(f"{path}: is empty")
        read = READERS.get(path.suffix.lower(), _read_instrument)
        return read(path)


@contextmanager
def _errors_of(path: Path, problem: str = "", remedy: str = "") -> Iterator[None]:
    """Return a context manager that turns errors of reading a file into InvalidScene.

    Args:
        path: the file, with which the message begins.
        problem: what an error of a parser means, such as "is no .npy file"; the message
            of the parser follows in parentheses.  "": errors of a parser are raised
            unchanged, and only those of the operating system are turned.
        remedy: what the user can do, the end of the message; "" for nothing.
    """
    try:
        yield
    except InvalidScene:
        raise
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InvalidScene(f"{path}: {reason}") from None
    except (Exception, SystemExit) as error:  # each parser has errors of its own
        if not problem:
            raise
        sentence = " ".join(str(error).split("; use")[0].split()).rstrip(".")
        sentence = sentence or type(error).__name__
        if len(sentence) > _SHOWN:
            sentence = sentence[: _SHOWN - 1] + "…"
        message = f"{path}: {problem} ({sentence})"
        if remedy:
            message += f"; {remedy}"
        raise InvalidScene(message) from None


def _read_npy(path: Path) -> HeightMap:
    """Return the heights of a .npy file, transposed so that x is the first axis.

    Raises InvalidScene if the file is damaged or holds other objects than numbers.
    """
    with _errors_of(path, "is no complete .npy file of numbers"):
        heights = np.lib.format.open_memmap(path, mode="r")
    return HeightMap(heights.T, notes=(AS_PICTURE,) if heights.ndim == 2 else ())


def _read_fields(path: Path) -> HeightMap:
    """Return the surface that a contact has left, from the .vti file of its result.

    The heights (m) are those before the contact less the plastic displacement.

    Raises InvalidScene if the file cannot be read or has no heights, or if it holds a
    J2 body under load, whose plastic displacement is not known.
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
            f"{path}: its body is under load, and J2 flow shows only without it; let "
            "the load path of the result end at 0"
        )
    mask = file.fields.get("filled")
    filled = None if mask is None else mask.astype(bool)
    return HeightMap(
        heights,
        unit=1.0,
        periods=file.periods,
        length_unit=1.0,
        unit_source="a result is in m",
        size_source="the spacing of its grid",
        filled=filled,
    )


def _read_mesh(path: Path) -> HeightMap:
    """Return the heights z of a mesh file (.stl, .ply, .vtu), in the file's unit.

    Raises InvalidScene if the file cannot be read, or if the points of the mesh are on
    no regular grid in x and y.
    """
    import meshio

    read = getattr(meshio, path.suffix.lower()[1:]).read
    # Text that meshio tries as numbers may overflow.
    with _errors_of(path, "meshio cannot read it"), np.errstate(all="ignore"):
        mesh = read(path)
    return map_of_points(np.asarray(mesh.points, np.float64), path)


def _read_instrument(path: Path) -> HeightMap:
    """Return the heights of a file in any format of SurfaceTopography.

    The heights are in m if the file gives their unit.

    Raises InvalidScene if SurfaceTopography is not installed or cannot read the file,
    if the points are on no regular grid, or if an archive is far larger than a map.
    """
    try:
        from SurfaceTopography import open_topography
    except ImportError:
        raise InvalidScene(
            f"{path}: reading {path.suffix or 'such'} files needs SurfaceTopography; "
            "pip install 'epcontact[instruments]', or convert it to .npy or text"
        ) from None
    if zipfile.is_zipfile(path):
        _require_small_archive(path)
    problem = "SurfaceTopography cannot read it"
    remedy = (
        "export the map from the instrument's software as .x3p, .sur or .nc, which "
        "know their units, or as text, one line of heights after the other"
    )
    with _errors_of(path, problem, remedy), open_topography(str(path)) as reader:
        topography = reader.topography()
        unit = None
        periods = None
        if topography.unit is not None:
            unit = unit_in_metres(topography.unit)
            periods = tuple(map(float, topography.physical_sizes))
        if not topography.is_uniform:
            raise InvalidScene(
                f"{path}: its points lie on no regular grid; resample it first"
            )
        # Points without a height are masked.
        heights = np.ma.filled(np.ma.asarray(topography.heights(), np.float64), np.nan)
        return HeightMap(
            heights,
            unit,
            periods,
            length_unit=unit,
            unit_source=f"its unit is {topography.unit}",
            size_source="the size that it stores",
        )


def _require_small_archive(path: Path) -> None:
    """Raise InvalidScene if a zip file is too large once it is unpacked.

    Too large is more than 256 MiB and, in addition, more than a hundred times the
    size of the file or more than a third of the free memory.
    """
    packed = path.stat().st_size
    with zipfile.ZipFile(path) as archive:
        unpacked = sum(part.file_size for part in archive.infolist())
    allowed = min(_SHRUNK * packed, available_memory() / _HELD)
    if unpacked > max(_UNPACKED, allowed):
        raise InvalidScene(
            f"{path}: unpacks from {packed / 2**20:.3g} MiB to "
            f"{unpacked / 2**20:.3g} MiB, more than a map of heights does or memory "
            "holds; export it again"
        )


#: The reader of each ending; SurfaceTopography reads all others.
READERS: dict[str, Callable[[Path], HeightMap]] = {
    ".npy": _read_npy,
    ".vti": _read_fields,
    **dict.fromkeys((".txt", ".dat", ".csv", ".tsv", ".xyz"), read_table),
    **dict.fromkeys((".stl", ".ply", ".vtu"), _read_mesh),
}
