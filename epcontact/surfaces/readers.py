"""Heights from files: .npy, tables of numbers, results (.vti), meshes and instruments'
formats.

Nothing is executed, so pickles are refused.  A .npy file is memory-mapped, so that a
header that promises more than the file holds is detected before memory is allocated.
The first index of an array runs along x, and so do the lines of a table.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from epcontact.errors import InvalidScene, OutputError
from epcontact.output.vtk import read_fields
from epcontact.surfaces.height_map import AS_ARRAY, HeightMap, map_of_points
from epcontact.surfaces.instruments import read_instrument
from epcontact.surfaces.map_errors import errors_of
from epcontact.surfaces.text_tables import read_table
from epcontact.surfaces.x3p import read_x3p

#: Endings of compressed files, which are not read.
ARCHIVES = {".gz", ".zip", ".bz2", ".xz", ".7z", ".rar", ".tar", ".tgz", ".zst", ".npz"}
#: Endings of tables of numbers in text.
_TABLES = (".txt", ".text", ".dat", ".csv", ".tsv", ".tab", ".prn", ".xyz")
#: Most members of an archive that a message lists.
_LISTED = 5


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's content, as hexadecimal digits.

    Raises InvalidScene if it cannot be read.
    """
    with errors_of(path), path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_heights(path: Path, channel: str | None = None) -> HeightMap:
    """Return the heights of a file, whose ending says how it is read.

    Args:
        path: the file.
        channel: the name of the channel of an instrument's file; None for its default.

    Raises:
        InvalidScene: The file cannot be read, holds no map of heights, or has no
            channels although one is named.
    """
    # Numbers near the largest overflow; the heights are checked afterwards.
    with errors_of(path), np.errstate(all="ignore"):
        if path.is_dir():
            raise InvalidScene(f"{path}: is a folder, but a file of heights is needed")
        if path.stat().st_size == 0:
            raise InvalidScene(f"{path}: is empty")
        suffix = path.suffix.lower()
        if suffix in ARCHIVES:
            _require_no_archive(path)
        read = READERS.get(suffix)
        if read is None or (suffix == ".dat" and _is_binary(path)):
            return read_instrument(path, channel)
        if channel is not None:
            raise InvalidScene(
                f"{path}: {suffix} files have no channels; leave out channel"
            )
        return read(path)


def _require_no_archive(path: Path) -> None:
    """Raise InvalidScene for a compressed file, with the files that a .zip holds.

    A .zip with a .dsc file is a map of a nanomeasuring machine, which SurfaceTopography
    reads.
    """
    inside = ""
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if not name.endswith("/")]
        if any(name.lower().endswith(".dsc") for name in names):
            return
        inside = f" ({', '.join(names[:_LISTED])})"
    raise InvalidScene(
        f"{path}: is a compressed file; unpack it and give the path of the map inside"
        f"{inside}"
    )


def _is_binary(path: Path) -> bool:
    """Return True if a file is no text: if it holds a zero byte, but is no UTF-16."""
    with path.open("rb") as file:
        first_bytes = file.read(4096)
    is_utf16 = first_bytes.startswith((b"\xff\xfe", b"\xfe\xff"))
    return b"\0" in first_bytes and not is_utf16


def _read_npy(path: Path) -> HeightMap:
    """Return the heights of a .npy file, whose first index runs along x.

    Raises InvalidScene if the file is damaged or holds other objects than numbers.
    """
    with errors_of(path, "is no complete .npy file of numbers"):
        heights = np.lib.format.open_memmap(path, mode="r")
    return HeightMap(heights, orientation=AS_ARRAY)


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


def _read_asc(path: Path) -> HeightMap:
    """Return the heights of an .asc file: a table, or text of an instrument.

    Raises InvalidScene if the file is neither; the message is that of the reader of
    tables if SurfaceTopography cannot read the file, too.
    """
    try:
        if not path.read_bytes().startswith(b"Wyko"):
            return read_table(path)
    except InvalidScene as error:
        try:
            return read_instrument(path)
        except InvalidScene:
            raise error from None
    return read_instrument(path)


def _read_mesh(path: Path) -> HeightMap:
    """Return the heights z of a mesh file (.stl, .ply, .vtu), in the file's unit.

    Raises InvalidScene if the file cannot be read, or if the points of the mesh are on
    no regular grid in x and y.
    """
    import meshio

    read = getattr(meshio, path.suffix.lower()[1:]).read
    # Text that meshio tries as numbers may overflow.
    with errors_of(path, "meshio cannot read it"), np.errstate(all="ignore"):
        mesh = read(path)
    return map_of_points(np.asarray(mesh.points, np.float64), path)


#: The reader of each ending; SurfaceTopography reads all others.
READERS: dict[str, Callable[[Path], HeightMap]] = {
    ".npy": _read_npy,
    ".vti": _read_fields,
    ".x3p": read_x3p,
    ".asc": _read_asc,
    **dict.fromkeys(_TABLES, read_table),
    **dict.fromkeys((".stl", ".ply", ".vtu"), _read_mesh),
}
