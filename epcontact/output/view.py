"""Three-dimensional pictures of result files: contacts, cut blocks, two methods
compared, films.

The kind of a file follows from its name: .vti holds fields on the surface's grid, .vtu
a finite-element block, .pvd a list of load steps.  A function that takes a file also
takes a method's .json that has its fields beside it.  It raises OutputError if the file
cannot be read or drawn.
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
from epcontact.output.charts.maps import compare_pressures, profiles
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

    A surface (.vti) is drawn as the deformed topography in contact, elastic yellow and
    plastic black, beside its pressure; a line (.vti) as its profile and pressure; a
    block (.vtu) cut open, with von Mises stress beside plastic strain.

    Args:
        result: a .vti, .vtu or .pvd file, or a method's .json with such a file beside
            it.
        picture: the PNG to write.
        factor: the dimensionless number by which heights or displacements are
            stretched; None: a round number that makes them visible.  The picture states
            it.
        size: width and height of the picture in pixels.

    Raises:
        OutputError: if the file cannot be read or drawn, or the picture not written.
    """
    source = find_result(result)
    _require_ending(picture, "a screenshot", ".png")
    with atomic_write(picture) as temporary:
        _draw([source], size, factor)[0].save(temporary)


def show(result: Path | str, *, factor: float | None = None) -> None:
    """Open a result file in a window and return when the window is closed.

    Args:
        result: a .vti, .vtu or .pvd file, or a method's .json with such a file beside
            it.
        factor: the dimensionless number by which heights or displacements are
            stretched; None: a round number that makes them visible.

    Raises:
        OutputError: if the file cannot be read or drawn, if it holds a line, or if
            there is no display.
    """
    _draw([find_result(result)], None, factor)


def compare(first: Path | str, second: Path | str, picture: Path | str) -> None:
    """Draw the pressures of two results side by side, in one scale, and their
    difference.

    Args:
        first, second: .vti files with the pressure (Pa) on the same grid, or methods'
            .json files with such files beside them.
        picture: the PNG to write.

    Raises:
        OutputError: if the grids differ or are lines, or if a file cannot be read or
            written.
    """
    _require_ending(picture, "a screenshot", ".png")
    paths = (first, second)
    files = [read_fields(find_result(path)) for path in paths]
    sizes = [" x ".join(map(str, file.shape)) + " points" for file in files]
    refusal = f"cannot compare {first} with {second}"
    if sizes[0] != sizes[1]:
        raise OutputError(f"{refusal}: their grids are of {sizes[0]} and {sizes[1]}")
    if len(files[0].shape) == 1:
        raise OutputError(f"{refusal}: they are lines, not surfaces")
    write_bytes(picture, compare_pressures(*files).png())


def animate(
    results: Sequence[Path | str],
    film: Path | str,
    *,
    factor: float | None = None,
    frames_per_second: float = 3.0,
    size: Size = (1200, 600),
) -> None:
    """Draw load steps as a film with one camera and one scale.

    Args:
        results: one .pvd, or the files of the steps in their order.
        film: a .gif or, with imageio and imageio-ffmpeg (the extra `films`), an .mp4.
        factor: the dimensionless number by which heights or displacements are
            stretched; None: a round number that makes them visible at all steps.  The
            film states it.
        frames_per_second: load steps for each second of the film.
        size: width and height of the film in pixels.

    Raises:
        OutputError: if there is no step, if the steps are of different kinds, or if a
            file cannot be read, drawn or written.
    """
    _require_ending(film, "a film", ".gif", ".mp4")
    sources = [step for path in results for step in _steps(path)]
    if len({source.suffix for source in sources}) != 1:
        raise OutputError(
            "a film needs the load steps of one .pvd, or .vti or .vtu files alone"
        )
    write = _write_mp4
    if Path(film).suffix.lower() == ".gif":
        write = _write_gif
    with atomic_write(film) as temporary:
        write(temporary, _draw(sources, size, factor), frames_per_second)


def find_result(path: Path | str) -> Path:
    """Return the file of fields that `path` stands for.

    The file is the path itself for a .vti or .vtu, the last load step of a .pvd, and
    the file of fields beside a method's .json.  If the method has solved several
    surfaces, the file is that of the first one.

    Raises:
        OutputError: if there is no such file, or if it is of another kind.
    """
    return _steps(path)[-1]


def _steps(path: Path | str) -> list[Path]:
    """Return the files of fields that a path stands for, in the order of the loads.

    Args:
        path: a .vti or .vtu file, which stands for itself; a .pvd, which stands for its
            load steps; or a method's .json, which stands for the fields beside it.

    Raises:
        OutputError: if there is no such file, if it is of another kind, or if no fields
            are beside a .json.
    """
    given = Path(path)
    if not given.exists():
        raise OutputError(f"cannot read {path}: there is no such file")
    if given.suffix == ".pvd":
        return load_steps(given)
    if given.suffix in (".vti", ".vtu"):
        return [given]
    if given.suffix != ".json":
        raise OutputError(
            f"cannot show {path}: a .vti, .vtu, .pvd or a method's .json is needed"
        )
    for ending in (".pvd", ".vtu", ".vti"):
        of_surfaces = sorted(given.parent.glob(f"{given.stem}-*{ending}"))
        for file in (given.with_suffix(ending), *of_surfaces):
            if file.is_file() and not file.stem.endswith("-peak"):
                return _steps(path_inside(given.parent, file.name))
    raise OutputError(f"no fields lie beside {path}; run the case with its fields kept")


def load_steps(collection: Path | str) -> list[Path]:
    """Return the files of a ParaView collection (.pvd) in the order of their times.

    Of files of the same time only part 0 is returned.

    Raises:
        OutputError: if the file cannot be read, is no collection, or names no file or
            one outside of its folder.
    """
    try:
        entries = ET.fromstring(read_bytes(collection)).findall("./Collection/DataSet")
        first_parts = [entry for entry in entries if entry.get("part", "0") == "0"]
        first_parts.sort(key=_time_of)
        names = [entry.attrib["file"] for entry in first_parts]
    except (ET.ParseError, KeyError, ValueError):
        raise OutputError(
            f"cannot read {collection}: it is no ParaView collection"
        ) from None
    if not names:
        raise OutputError(f"cannot read {collection}: it names no file")
    return [path_inside(Path(collection).parent, name) for name in names]


def _time_of(entry: ET.Element) -> float:
    """Return the attribute `timestep` of an entry of a .pvd collection; 0 without it.

    Raises ValueError if the attribute is no number.
    """
    return float(entry.get("timestep", "0"))


def _is_line(source: Path) -> bool:
    """Return whether a result file holds a line: a .vti with points along x only.

    Only the first 512 bytes are read, because the fields may be large.  Raises
    OutputError if the file cannot be read.
    """
    if source.suffix != ".vti":
        return False
    extent = rb'WholeExtent="0 \d+ 0 0 '
    return re.search(extent, read_bytes(source, 512)) is not None


def _require_ending(path: Path | str, what: str, *endings: str) -> None:
    """Raise OutputError if the name of a file to write has none of the endings.

    Args:
        path: the file to write.
        what: what the file is, such as "a film", for the message.
        endings: the endings that are allowed, in lower case with their dots.
    """
    if Path(path).suffix.lower() not in endings:
        raise OutputError(
            f"cannot write {path}: {what} must be named {' or '.join(endings)}"
        )


def _draw(
    sources: Sequence[Path], size: Size | None, factor: float | None
) -> list[Image.Image]:
    """Draw result files, each to a picture, or show them in windows.

    Lines are drawn by matplotlib, everything else by pyvista.

    Args:
        sources: .vti or .vtu files, all of one kind.
        size: width and height of the pictures in pixels; None: windows.
        factor: the dimensionless number by which heights or displacements are
            stretched; None: a round number that makes them visible.

    Returns:
        A picture for each file; none if they were shown in windows.

    Raises:
        OutputError: if a file cannot be read or drawn, or if a line is to be shown in a
            window, with a factor, or together with surfaces.
    """
    lines = [source for source in sources if _is_line(source)]
    if not lines:
        from epcontact.output import drawing  # pyvista takes a second to load

        return drawing.draw(sources, size, factor)
    if size is None or factor is not None or lines != sources:
        raise OutputError(
            f"{lines[0]} is a line, which is drawn to a file, without a factor and in "
            "no film with surfaces"
        )
    from PIL import Image

    pictures = [io.BytesIO(chart.png()) for chart in profiles(lines)]
    return [Image.open(picture).convert("RGB") for picture in pictures]


def _write_gif(
    path: Path, frames: Sequence[Image.Image], frames_per_second: float
) -> None:
    """Write pictures as an endless GIF.

    All frames have one palette of 256 colours.  With a palette for each frame, parts of
    the picture that do not move would flicker.

    Args:
        path: the file to write.
        frames: pictures of one size.
        frames_per_second: how many pictures are shown in a second.
    """
    from PIL import Image

    reduced = [np.asarray(frame)[::2, ::2] for frame in frames]
    palette = Image.fromarray(np.concatenate(reduced)).quantize(
        256, Image.Quantize.MAXCOVERAGE, kmeans=2, dither=Image.Dither.NONE
    )
    no_dither = Image.Dither.NONE
    first, *rest = (
        frame.quantize(palette=palette, dither=no_dither) for frame in frames
    )
    milliseconds = round(1000 / frames_per_second)
    first.save(path, save_all=True, append_images=rest, duration=milliseconds, loop=0)


def _write_mp4(
    path: Path, frames: Sequence[Image.Image], frames_per_second: float
) -> None:
    """Write pictures as an MP4.

    Args:
        path: the file to write.
        frames: pictures of one size.  The codec needs an even width and height, so that
            an odd last row or column of pixels is cut off.
        frames_per_second: how many pictures are shown in a second.

    Raises:
        OutputError: if the packages imageio and imageio-ffmpeg are not installed.
    """
    try:
        import imageio.v2
        import imageio_ffmpeg  # noqa: F401 - the plugin for .mp4
    except ImportError:
        raise OutputError(
            "an MP4 needs the packages imageio and imageio-ffmpeg; without them, name "
            "the film .gif"
        ) from None
    pictures = []
    for frame in frames:
        height = frame.height // 2 * 2
        width = frame.width // 2 * 2
        pictures.append(np.asarray(frame)[:height, :width])
    imageio.v2.mimwrite(path, pictures, fps=frames_per_second, macro_block_size=2)
