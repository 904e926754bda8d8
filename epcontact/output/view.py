"""Three-dimensional pictures of result files: contacts, cut blocks, two methods compared, films.

The kind of a file follows from its name: .vti holds fields on the surface's grid, .vtu a
finite-element block, .pvd a list of .vtu load steps.

`epcontact.output.worker` draws everything in a separate process.  Without a display, VTK tries one
way of drawing after another with warnings at each, and if a library is missing the process may
crash.  The worker's output does not reach the terminal, and the caller gets a crash as one
sentence.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from epcontact.errors import OutputError
from epcontact.output.charts.maps import map_of_file
from epcontact.output.files import read_bytes, whole_file, write_bytes
from epcontact.output.vtk import read_fields

#: The mark before the sentence that a worker prints, and its exit code if no window can help.
MARK, REFUSED = "epcontact: ", 3
#: Seconds for each frame after which a worker counts as hanging; large grids take ten.
PATIENCE = 300.0
#: VTK's default window, then its two ways to draw without a display; they are tried in turn.
WINDOWS = ("", "vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")


def screenshot(
    result: Path | str,
    picture: Path | str,
    *,
    factor: float | None = None,
    size: tuple[int, int] = (1600, 800),
) -> None:
    """Draw a result file to a PNG.

    A surface (.vti) is shown as the deformed topography in contact, elastic yellow and plastic
    black, beside its pressure; a line (.vti) as its profile and pressure; a block (.vtu, or the
    last of a .pvd) cut open, with von Mises stress beside plastic strain.

    Args:
        result: The file, or a method's .json beside it.
        picture: A name that ends in .png.
        factor: Stretches the heights of a surface, or the displacements of a block.  The default
            shows the shape.  The picture states the factor.
        size: Width and height in pixels.

    Raises:
        OutputError: If the result cannot be read or drawn, or the PNG cannot be written.
    """
    source = find_result(result)
    if Path(picture).suffix.lower() != ".png":
        raise OutputError(f"cannot write {picture}: a screenshot must be named .png")
    if _is_line(source):  # drawn by matplotlib
        write_bytes(picture, map_of_file(source).png())
        return
    with whole_file(picture) as temporary:
        _draw(_task([_last_step(source)], temporary, size, factor=factor))


def show(result: Path | str, *, factor: float | None = None) -> None:
    """Open a result file in a window and return when it is closed; see `screenshot`.

    Raises:
        OutputError: If the result cannot be shown, or there is no display.
    """
    source = find_result(result)
    displays = ("DISPLAY", "WAYLAND_DISPLAY")
    if sys.platform.startswith("linux") and not any(os.environ.get(name) for name in displays):
        raise OutputError("no window can be opened without a display; ask for a screenshot instead")
    if _is_line(source):
        raise OutputError(f"{source} is a line, which has no view; ask for a screenshot instead")
    _draw(_task([_last_step(source)], None, (1600, 800), factor=factor))


def compare(
    first: Path | str,
    second: Path | str,
    picture: Path | str,
    *,
    names: tuple[str, str] | None = None,
    size: tuple[int, int] = (1800, 700),
) -> None:
    """Draw the pressures of two .vti files side by side, in one scale, with their difference.

    Args:
        first, second: The files, or the methods' .json beside them.
        picture: A name that ends in .png.
        names: Titles of the pressures, by default the methods that the files name.
        size: Width and height in pixels.

    Raises:
        OutputError: If the two have different grids, or as for `screenshot`.
    """
    sources = [find_result(path) for path in (first, second)]
    files = [read_fields(source) for source in sources]
    if files[0].shape != files[1].shape or len(files[0].shape) != 2:
        raise OutputError(
            f"cannot compare {first} with {second}: their grids are {files[0].shape} and "
            f"{files[1].shape}, but one and the same surface grid is needed"
        )
    methods = [str(file.attributes.get("method", "?")).upper() for file in files]
    with whole_file(picture) as temporary:
        _draw(_task(sources, temporary, size, names=list(names or methods)))


def animate(
    results: Sequence[Path | str],
    film: Path | str,
    *,
    factor: float | None = None,
    frames_per_second: float = 3.0,
    size: tuple[int, int] = (1200, 600),
) -> None:
    """Draw load steps as a film, with one camera, one scale of colours and one factor.

    Args:
        results: One .pvd, or a .vti or .vtu for each step.
        film: A name that ends in .gif, or in .mp4 where the packages imageio and imageio-ffmpeg
            are installed.
        factor: As for `screenshot`.
        frames_per_second: Speed of the film.
        size: Width and height in pixels.

    Raises:
        OutputError: If the steps cannot be read or drawn, or the film cannot be written.
    """
    if Path(film).suffix.lower() not in (".gif", ".mp4"):
        raise OutputError(f"cannot write {film}: a film must be named .gif or .mp4")
    sources = [find_result(path) for path in results]
    if len(sources) == 1 and sources[0].suffix == ".pvd":
        sources = load_steps(sources[0])
    if not sources or len({s.suffix for s in sources}) != 1 or sources[0].suffix == ".pvd":
        raise OutputError("a film needs the load steps of one .pvd, or .vti or .vtu files alone")
    with whole_file(film) as temporary:
        _draw(_task(sources, temporary, size, factor=factor, frames_per_second=frames_per_second))


def find_result(path: Path | str) -> Path:
    """Return the file of fields that `path` means.

    Args:
        path: The file itself, or a method's .json with fields beside it.

    Raises:
        OutputError: If there is no such file, or it is of a kind that cannot be shown.
    """
    given = Path(path)
    if not given.exists():
        raise OutputError(f"cannot read {path}: there is no such file")
    if given.suffix in (".vti", ".vtu", ".pvd"):
        return given
    if given.suffix != ".json":
        raise OutputError(f"cannot show {path}: a .vti, .vtu, .pvd or a method's .json is needed")
    for end in ("pvd", "vtu", "vti"):
        # If there are several surfaces, the first one is shown.
        several = sorted(given.parent.glob(f"{given.stem}-*.{end}"))
        for beside in (given.with_suffix(f".{end}"), *several):
            if beside.is_file():
                return beside
    raise OutputError(f"no fields lie beside {path}; run the case with its fields kept")


def load_steps(collection: Path | str) -> list[Path]:
    """Return the files of a ParaView collection (.pvd) in the order of their times.

    Args:
        collection: The path; the collection names its files relative to its folder.  Of a step of
            several parts only part 0 is returned.

    Raises:
        OutputError: If it cannot be read, is not a collection or names no file.

    Example:
        >>> import tempfile
        >>> step = '<DataSet timestep="0" file="step-0000.vtu"/>'
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = Path(folder) / "path.pvd"
        ...     _ = path.write_text(f"<VTKFile><Collection>{step}</Collection></VTKFile>")
        ...     [file.name for file in load_steps(path)]
        ['step-0000.vtu']
    """
    try:
        entries = ET.fromstring(read_bytes(collection)).findall("./Collection/DataSet")
        first = [entry for entry in entries if entry.get("part", "0") == "0"]
        steps = [(float(e.get("timestep", "0")), e.attrib["file"]) for e in first]
    except (ET.ParseError, KeyError, ValueError):
        raise OutputError(f"cannot read {collection}: it is no ParaView collection") from None
    if not steps:
        raise OutputError(f"cannot read {collection}: it names no file")
    ordered = sorted(steps, key=lambda step: step[0])
    return [Path(collection).parent / file for _, file in ordered]


def _last_step(source: Path) -> Path:
    return load_steps(source)[-1] if source.suffix == ".pvd" else source


def _is_line(source: Path) -> bool:
    """True if the file holds a line; only its head is read, because the fields may be large."""
    if source.suffix != ".vti":
        return False
    extent = re.search(rb'WholeExtent="0 \d+ 0 (\d+) ', read_bytes(source, 512))
    return extent is not None and extent[1] == b"0"


def _task(
    sources: Sequence[Path], target: Path | None, size: tuple[int, int], **options: Any
) -> dict[str, Any]:
    """Return the arguments of `epcontact.output.worker.draw` in JSON types."""
    names = [str(source) for source in sources]
    return {"sources": names, "target": target and str(target), "size": list(size), **options}


def _draw(task: Mapping[str, Any]) -> None:
    """Let a worker draw, trying each kind of window until one works."""
    failures = []
    chosen = "VTK_DEFAULT_OPENGL_WINDOW" in os.environ or not sys.platform.startswith("linux")
    for window in WINDOWS[:1] if chosen or task["target"] is None else WINDOWS:
        failure, final = _work(task, window)
        if not failure:
            return
        if final:
            raise OutputError(failure)
        failures.append(failure)
    raise OutputError(f"pictures cannot be drawn on this machine: {failures[0]}")


def _work(task: Mapping[str, Any], window: str) -> tuple[str, bool]:
    """Run a worker; return the reason of a failure, and True if no other window can help."""
    environment = {**os.environ} | ({"VTK_DEFAULT_OPENGL_WINDOW": window} if window else {})
    # The worker must import this package, and nothing from its working folder.
    home = str(Path(__file__).parents[2])
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [home, environment.get("PYTHONPATH")]))
    patience = None if task["target"] is None else PATIENCE * len(task["sources"])
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-W", "ignore", "-m", "epcontact.output.worker"],
            input=json.dumps(task),
            capture_output=True,
            text=True,
            errors="replace",
            env=environment,
            timeout=patience,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"VTK did not draw anything within {patience:g} s", False
    except OSError as error:
        return f"no process could be started to draw in: {error.strerror}", False
    sentences = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    if done.returncode == 0 or sentences:
        sentence = sentences[-1].removeprefix(MARK) if done.returncode else ""
        return sentence, done.returncode == REFUSED
    if done.returncode < 0:
        names = {member.value: member.name for member in signal.Signals}
        name = names.get(-done.returncode, f"signal {-done.returncode}")
        return f"VTK crashed ({name}) while drawing", False
    last = (done.stderr.strip().splitlines() or ["no reason is given"])[-1]
    return f"the drawing process failed: {last}", False
