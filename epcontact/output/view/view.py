"""Views of result files: contact in three dimensions, the cut block, two methods compared, films.

Everything works from the files alone, without a display, and in a process of its own; see
`epcontact.output.view.render`.  What a file is follows from its name: .vti holds fields on the
surface's grid, .vtu a finite-element block, .pvd a list of .vtu load steps.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from epcontact.errors import OutputError
from epcontact.output.files import whole_file
from epcontact.output.view.render import draw
from epcontact.output.vtk import read_fields

#: Width and height in pixels.
SIZE = (1600, 800)


def screenshot(
    result: Path | str,
    picture: Path | str,
    *,
    factor: float | None = None,
    size: tuple[int, int] = SIZE,
) -> None:
    """Draw a result file to a PNG.

    A surface (.vti): the deformed topography in contact, elastic yellow and plastic black, beside
    its pressure; `factor` stretches the heights.  A line (.vti): its profile and pressure.  A
    block (.vtu, the last of a .pvd): cut open, von Mises stress beside plastic strain, on the mesh
    deformed by `factor` times its displacement (1: as it is).  Without a factor, one is chosen that
    shows the shape; the picture names it.

    Raises OutputError if the result cannot be read, shown or drawn, or the PNG not be written.
    """
    source = find_result(result)
    if Path(picture).suffix.lower() != ".png":
        raise OutputError(f"cannot write {picture}: a screenshot must be named .png")
    if _is_line(source):
        _profile(source, picture)
        return
    with whole_file(picture) as temporary:
        draw({**_scene_of(source), "picture": str(temporary), "factor": factor, "size": list(size)})


def show(result: Path | str, *, factor: float | None = None) -> None:
    """Open a result file in a window and return when it is closed; see `screenshot`.

    Raises OutputError where there is no display.
    """
    source = find_result(result)
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise OutputError("no window can be opened without a display; ask for a screenshot instead")
    if _is_line(source):
        raise OutputError(f"{source} is a line, which has no view; ask for a screenshot instead")
    task = {**_scene_of(source), "picture": None, "factor": factor, "size": list(SIZE)}
    draw(task, off_screen=False)


def compare(
    first: Path | str,
    second: Path | str,
    picture: Path | str,
    *,
    names: tuple[str, str] | None = None,
    size: tuple[int, int] = (1800, 700),
) -> None:
    """Draw the pressures of two .vti files side by side, in one scale, with their difference.

    `names` default to the methods the files name.

    Raises OutputError, also where the two do not lie on one grid.
    """
    files = [read_fields(find_result(path)) for path in (first, second)]
    if files[0].shape != files[1].shape or len(files[0].shape) != 2:
        raise OutputError(
            f"cannot compare {first} with {second}: their grids are {files[0].shape} and "
            f"{files[1].shape}, but one and the same surface grid is needed"
        )
    methods = tuple(str(file.attributes.get("method", "?")).upper() for file in files)
    with whole_file(picture) as temporary:
        draw(
            {
                "scene": "compare",
                "sources": [str(find_result(path)) for path in (first, second)],
                "names": list(names or methods),
                "picture": str(temporary),
                "size": list(size),
            }
        )


def animate(
    results: Sequence[Path | str],
    film: Path | str,
    *,
    factor: float | None = None,
    frames_per_second: float = 3.0,
    size: tuple[int, int] = (1200, 600),
) -> None:
    """Draw the load steps of a .pvd, or one .vti or .vtu a step, as a film: .gif, or .mp4 where
    the packages imageio and imageio-ffmpeg are installed.

    Camera, colours and factor are the same in every frame.

    Raises OutputError.
    """
    from epcontact.output.pvd import read_pvd

    end = Path(film).suffix.lower()
    if end not in (".gif", ".mp4"):
        raise OutputError(f"cannot write {film}: a film must be named .gif or .mp4")
    sources = [find_result(path) for path in results]
    if len(sources) == 1 and sources[0].suffix == ".pvd":
        sources = [step.path for step in read_pvd(sources[0])]
    if not sources or len({s.suffix for s in sources}) != 1 or sources[0].suffix == ".pvd":
        raise OutputError("a film needs the load steps of one .pvd, or .vti or .vtu files alone")
    with whole_file(film) as temporary:
        draw(
            {
                "scene": "animate",
                "kind": "surface" if sources[0].suffix == ".vti" else "block",
                "sources": [str(source) for source in sources],
                "picture": str(temporary),
                "factor": factor,
                "frames_per_second": frames_per_second,
                "size": list(size),
            }
        )


def find_result(path: Path | str) -> Path:
    """The file of fields meant by `path`: itself, or the one that lies beside a method's .json.

    Raises OutputError if there is none, or it is of a kind that cannot be shown.
    """
    given = Path(path)
    if not given.exists():
        raise OutputError(f"cannot read {path}: there is no such file")
    if given.suffix in (".vti", ".vtu", ".pvd"):
        return given
    if given.suffix == ".json":
        for end in ("pvd", "vtu", "vti"):
            # The fields of the first surface of several.
            beside = [
                given.with_suffix(f".{end}"),
                *sorted(given.parent.glob(f"{given.stem}-*.{end}")),
            ]
            for found in beside:
                if found.is_file():
                    return found
        raise OutputError(f"no fields lie beside {path}; run the case with its fields kept")
    raise OutputError(f"cannot show {path}: a .vti, .vtu, .pvd or a method's .json is needed")


def _scene_of(source: Path) -> dict[str, Any]:
    from epcontact.output.pvd import read_pvd

    if source.suffix == ".vti":
        return {"scene": "surface", "source": str(source)}
    if source.suffix == ".pvd":
        source = read_pvd(source)[-1].path
    return {"scene": "block", "source": str(source)}


def _is_line(source: Path) -> bool:
    """From the head of the file alone: the fields are the worker's to read."""
    if source.suffix != ".vti":
        return False
    try:
        with source.open("rb") as file:
            extent = re.search(rb'WholeExtent="0 \d+ 0 (\d+) ', file.read(512))
    except OSError as error:
        raise OutputError(f"cannot read {source}: {(error.strerror or '').lower()}") from None
    return extent is not None and extent[1] == b"0"


def _profile(source: Path, picture: Path | str) -> None:
    """A line needs no third dimension: matplotlib draws it."""
    from epcontact.output.charts.maps import contact_profile
    from epcontact.output.files import write_bytes

    read = read_fields(source)
    try:
        state, pressure, gap = (read.fields[name] for name in ("state", "pressure", "gap"))
    except KeyError as missing:
        raise OutputError(f"cannot show {source}: it holds no field {missing}") from None
    write_bytes(picture, contact_profile(state, pressure, gap, read.spacing).png())
