"""Three-dimensional pictures of result files: contacts, cut blocks, two methods
compared, films.

The kind of a file follows from its name: .vti holds fields on the surface's grid, .vtu
a finite-element block, .pvd a list of load steps.  Where a function takes a file, it
takes a method's .json with its fields beside it as well, and raises OutputError if the
file cannot be read or drawn.
"""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from epcontact.errors import OutputError
from epcontact.files import atomic_write, path_inside, read_bytes, write_bytes
from epcontact.output.charts.maps import pressure_difference, profiles
from epcontact.output.vtk import read_fields

if TYPE_CHECKING:
    from PIL import Image

Size = tuple[int, int]  # width and height in pixels


def screenshot(
    result: Path | str,
    picture: Path | str,
    *,
    factor: float | None = None,
    size: Size = (1600, 800),
) -> None:
    """Draw a result file to a PNG.

    A surface (.vti) is shown as the deformed topography in contact, elastic yellow and
    plastic black, beside its pressure; a line (.vti) as its profile and pressure; a
    block (.vtu) cut open, with von Mises stress beside plastic strain.  `factor`
    stretches the heights or displacements, by default so that they show, and the
    picture states it.
    """
    source = find_result(result)
    _require_ending(picture, "a screenshot", ".png")
    with atomic_write(picture) as temporary:
        _draw([source], size, factor)[0].save(temporary)


def show(result: Path | str, *, factor: float | None = None) -> None:
    """Open a result file in a window and return when it is closed; see `screenshot`."""
    _draw([find_result(result)], None, factor)


def compare(first: Path | str, second: Path | str, picture: Path | str) -> None:
    """Draw the pressures of two .vti files side by side, in one scale, with their
    difference.
    """
    _require_ending(picture, "a screenshot", ".png")
    files = [read_fields(find_result(path)) for path in (first, second)]
    grids = [" x ".join(map(str, file.shape)) + " points" for file in files]
    differ = (
        f"their grids are of {grids[0]} and {grids[1]}" if grids[0] != grids[1] else ""
    )
    if why := differ or (
        "they are lines, not surfaces" if len(files[0].shape) == 1 else ""
    ):
        raise OutputError(f"cannot compare {first} with {second}: {why}")
    one, two = (str(file.attributes.get("method", "?")).upper() for file in files)
    if one == two:
        one, two = (f"{one} {Path(path).stem}" for path in (first, second))
    pressure, other = (file.field("pressure") for file in files)
    chart = pressure_difference(pressure, other, files[0].spacing, names=(one, two))
    write_bytes(picture, chart.png())


def animate(
    results: Sequence[Path | str],
    film: Path | str,
    *,
    factor: float | None = None,
    frames_per_second: float = 3.0,
    size: Size = (1200, 600),
) -> None:
    """Draw load steps, of one .pvd or a file each, as a film of one camera and one
    scale.  The film is a .gif or, with imageio and imageio-ffmpeg (the extra `films`),
    an .mp4.
    """
    _require_ending(film, "a film", ".gif", ".mp4")
    sources = [step for path in results for step in _steps(path)]
    if len({source.suffix for source in sources}) != 1:
        raise OutputError(
            "a film needs the load steps of one .pvd, or .vti or .vtu files alone"
        )
    write = _write_gif if Path(film).suffix.lower() == ".gif" else _write_mp4
    with atomic_write(film) as temporary:
        write(temporary, _draw(sources, size, factor), frames_per_second)


def find_result(path: Path | str) -> Path:
    """Return the file of fields that `path` means: itself, the last of a .pvd, or a
    .json's.
    """
    return _steps(path)[-1]


def _steps(path: Path | str) -> list[Path]:
    given = Path(path)
    if not given.exists():
        raise OutputError(f"cannot read {path}: there is no such file")
    if given.suffix in (".vti", ".vtu", ".pvd"):
        return load_steps(given) if given.suffix == ".pvd" else [given]
    if given.suffix != ".json":
        raise OutputError(
            f"cannot show {path}: a .vti, .vtu, .pvd or a method's .json is needed"
        )
    for end in ("pvd", "vtu", "vti"):
        # If there are several surfaces, the first one is shown.
        several = sorted(given.parent.glob(f"{given.stem}-*.{end}"))
        for beside in (given.with_suffix(f".{end}"), *several):
            if beside.is_file():
                return _steps(beside)
    raise OutputError(f"no fields lie beside {path}; run the case with its fields kept")


def load_steps(collection: Path | str) -> list[Path]:
    """Return the files of a ParaView collection (.pvd), part 0 of each, by their
    times.  Raises OutputError if it is none, or names a file outside of its folder.
    """
    try:
        entries = ET.fromstring(read_bytes(collection)).findall("./Collection/DataSet")
        first = [entry for entry in entries if entry.get("part", "0") == "0"]
        steps = [(float(e.get("timestep", "0")), e.attrib["file"]) for e in first]
    except (ET.ParseError, KeyError, ValueError):
        raise OutputError(
            f"cannot read {collection}: it is no ParaView collection"
        ) from None
    if not steps:
        raise OutputError(f"cannot read {collection}: it names no file")
    return [
        path_inside(Path(collection).parent, file)
        for _, file in sorted(steps, key=lambda step: step[0])
    ]


def _is_line(source: Path) -> bool:
    """True if the file holds a line; only its head is read, because the fields may be
    large.
    """
    extent = rb'WholeExtent="0 \d+ 0 0 '
    return (
        source.suffix == ".vti"
        and re.search(extent, read_bytes(source, 512)) is not None
    )


def _require_ending(path: Path | str, what: str, *endings: str) -> None:
    if Path(path).suffix.lower() not in endings:
        raise OutputError(
            f"cannot write {path}: {what} must be named {' or '.join(endings)}"
        )


def _draw(
    sources: Sequence[Path], size: Size | None, factor: float | None
) -> list[Image.Image]:
    """Draw files; lines are drawn by matplotlib."""
    lines = [source for source in sources if _is_line(source)]
    if lines and (size is None or factor is not None or lines != sources):
        how = "is drawn to a file, without a factor and in no film with surfaces"
        raise OutputError(f"{lines[0]} is a line, which {how}")
    if lines:
        from PIL import Image

        return [
            Image.open(io.BytesIO(one.png())).convert("RGB") for one in profiles(lines)
        ]
    from epcontact.output import drawing  # pyvista takes a second to load

    return drawing.draw(sources, size, factor)


def _write_gif(
    path: Path, frames: Sequence[Image.Image], frames_per_second: float
) -> None:
    """Write a GIF with one palette: with one for each frame, what does not move would
    flicker.
    """
    from PIL import Image

    strip = Image.fromarray(
        np.concatenate([np.asarray(frame)[::2, ::2] for frame in frames])
    )
    palette = strip.quantize(
        256, Image.Quantize.MAXCOVERAGE, kmeans=2, dither=Image.Dither.NONE
    )
    first, *rest = (
        f.quantize(palette=palette, dither=Image.Dither.NONE) for f in frames
    )
    pause = round(1000 / frames_per_second)
    first.save(path, save_all=True, append_images=rest, duration=pause, loop=0)


def _write_mp4(
    path: Path, frames: Sequence[Image.Image], frames_per_second: float
) -> None:
    try:
        import imageio.v2
        import imageio_ffmpeg  # noqa: F401 - the plugin for .mp4
    except ImportError:
        raise OutputError(
            "an MP4 needs the packages imageio and imageio-ffmpeg; without them, name the film .gif"
        ) from None
    even = [np.asarray(f)[: f.height // 2 * 2, : f.width // 2 * 2] for f in frames]
    imageio.v2.mimwrite(path, even, fps=frames_per_second, macro_block_size=2)
