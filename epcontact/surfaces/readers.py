"""Heights from files: .npy, tables of numbers, results (.vti), meshes and instruments' formats.

Nothing is executed, so pickles are refused.  A .npy file is memory-mapped, so that a header that
promises more than the file holds is detected before memory is allocated.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidScene, OutputError
from epcontact.output.vtk import read_fields
from epcontact.results import FloatArray
from epcontact.surfaces.text_tables import read_table


@dataclass(frozen=True, eq=False)
class HeightMap:
    """The heights of a file, as it stores them.

    Attributes:
        heights: the stored heights.
        in_metres: True if they are in m because the file gives its unit.
        periods: in the unit of the heights, if the file gives them.
        notes: sentences on how the file was read.
    """

    heights: NDArray[Any]
    in_metres: bool = False
    periods: tuple[float, ...] | None = None
    notes: tuple[str, ...] = ()


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's content.  Raises InvalidScene if it cannot be read."""
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
    """Turn errors of the system into InvalidScene; with words for them, those of a parser, too."""
    try:
        yield
    except InvalidScene:
        raise
    except OSError as error:
        raise InvalidScene(f"{path}: {(error.strerror or str(error)).lower()}") from None
    except (Exception, SystemExit) as error:  # each parser has errors of its own
        if not words:
            raise
        lines = str(error).strip().splitlines() or [type(error).__name__]
        said = " ".join(lines[0].split("; use")[0].split()).rstrip(".")
        said = said if len(said) <= 100 else said[:99] + "…"
        raise InvalidScene(f"{path}: {words} ({said})") from None


def _read_text(path: Path) -> HeightMap:
    heights, notes = read_table(path)
    return HeightMap(heights, notes=notes)


def _read_npy(path: Path) -> HeightMap:
    with _refusing(path, "is no complete .npy file of numbers"):
        return HeightMap(np.lib.format.open_memmap(path, mode="r"))


def _read_fields(path: Path) -> HeightMap:
    """The surface that a result has left: the heights of its .vti file, less the plastic flow."""
    try:
        file = read_fields(path)
        heights = file.field("heights").astype(np.float64)
    except OutputError:
        raise InvalidScene(f"{path}: is no whole .vti file of a result with heights") from None
    if "plastic_displacement" in file.fields:
        heights -= file.fields["plastic_displacement"]
    elif file.attributes.get("option.law") == "j2":
        raise InvalidScene(
            f"{path}: its body is under load, and J2 flow shows only without it; let the load path "
            "of the result end at 0"
        )
    return HeightMap(heights, in_metres=True, periods=file.periods)


def _read_mesh(path: Path) -> HeightMap:
    """The heights z of a mesh whose points lie on a regular grid in x and y, NaN where none is."""
    import meshio

    # Text that meshio tries as numbers may overflow.
    with _refusing(path, "meshio cannot read it"), np.errstate(all="ignore"):
        mesh = getattr(meshio, path.suffix.lower()[1:]).read(path)
    points = np.asarray(mesh.points, np.float64)
    if points.shape[1:] == (3,) and len(points) >= 4 and np.isfinite(points).all():
        (x, dx), (y, dy) = map(_even_places, points.T[:2])
        nx, ny = int(x.max()) + 1, int(y.max()) + 1
        if min(nx, ny) >= 2 and nx * ny <= 2 * len(points) and dx * dy > 0:
            heights = np.full((nx, ny), np.nan)
            heights[x, y] = points[:, 2]
            if np.array_equal(heights[x, y], points[:, 2]):  # no two points at one place
                return HeightMap(heights, periods=(nx * dx, ny * dy))
    raise InvalidScene(
        f"{path}: its points are no height map: they lie on no regular grid in x and y, or above "
        "each other; sample the mesh on a grid first"
    )


def _even_places(values: FloatArray) -> tuple[NDArray[np.intp], float]:
    """Return the place of each coordinate on a ladder of even steps, and the step; 0 if off it.

    Files keep few digits, so a coordinate may be off by a hundredth of the step.
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
    with (
        _refusing(path, "SurfaceTopography cannot read it"),
        open_topography(str(path)) as reader,
    ):
        topography = reader.topography()
        if in_metres := topography.unit is not None:
            topography = topography.to_unit("m")
        if not topography.is_uniform:
            raise InvalidScene(f"{path}: its points lie on no regular grid; resample it first")
        # Points without a height are masked.
        heights = np.ma.filled(np.ma.asarray(topography.heights(), np.float64), np.nan)
        periods = tuple(map(float, topography.physical_sizes)) if in_metres else None
        return HeightMap(heights, in_metres, periods)


#: The reader of each ending; SurfaceTopography reads all others.
READERS: dict[str, Callable[[Path], HeightMap]] = {
    ".npy": _read_npy,
    ".vti": _read_fields,
    **dict.fromkeys((".txt", ".dat", ".csv", ".tsv"), _read_text),
    **dict.fromkeys((".stl", ".ply", ".vtu"), _read_mesh),
}
