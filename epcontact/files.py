"""Files that are written completely or not at all.

A file is written under a temporary name beside its destination, flushed to the disk and
renamed over the destination, which the system does in one step.  Only a killed process
can leave a temporary file behind.  Its name holds the machine and the number of the
process, so that `remove_leftovers` recognises it.  The module `tempfile` is not used,
because it creates files that only their owner can read.
"""

from __future__ import annotations

import contextlib
import glob
import itertools
import os
import platform
import secrets
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from epcontact.errors import OutputError
from epcontact.machine import alive, try_lock
from epcontact.results import plain

#: Pattern of names that become a file or folder: the id of a case, a size, a method and
#: the label of a surface.  Such a name is not absolute and cannot lead to another
#: folder.
NAME_PATTERN = r"^[A-Za-z0-9_][A-Za-z0-9._-]*$"
#: A text near the beginning of each file that a command writes under a name that the
#: user gives, by the end of the name.
MARKS = {
    ".gif": "GIF8",
    ".html": "<title>epcontact: verification report</title>",
    ".inp": "** the block of the scene ",
    ".med": "HDF",
    ".mp4": "ftyp",
    ".msh": "$MeshFormat",
    ".png": "PNG",
    ".vtk": "vtk DataFile",
    ".vtu": "VTKFile",
    ".xdmf": "Xdmf",
}
#: Beginning of the name of a temporary file; the number of the process follows.
_PREFIX = f".epcontact-{platform.node()}-"


@contextlib.contextmanager
def atomic_write(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path whose file replaces `path` when the block ends.

    The destination is unchanged if the block raises.  Missing folders are created, and
    a symbolic link is replaced, not followed.

    Raises:
        OutputError: The path names no file, or the system refuses to write.
    """
    final = Path(path)
    if not final.name or "\0" in str(path):
        raise OutputError(f"cannot write {str(path)!r}: it names no file")
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise output_error("write", path, error) from error
    if os.path.exists(final) and not os.path.isfile(final):
        kind = "folder" if os.path.isdir(final) else "device or pipe"
        raise OutputError(f"cannot write {path}: it is a {kind}, not a file")
    unique = f"{os.getpid()}-{secrets.token_hex(6)}{final.suffix[:16]}"
    temporary = final.with_name(f"{_PREFIX}{unique}")
    try:
        temporary.touch(exist_ok=False)
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(temporary, final)
    except OSError as error:
        concerns_temporary = error.filename in (None, str(temporary))
        if isinstance(error, OutputError) or not concerns_temporary:
            raise
        raise output_error("write", path, error) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def remove_leftovers(folder: Path, *, below: bool = True) -> None:
    """Remove temporary files that killed processes of this machine left in a folder.

    Files of running processes stay, and so do files that the system does not let this
    process remove.

    Args:
        folder: The folder; it need not exist.
        below: Whether folders inside of it are searched, too.
    """
    pattern = f"{glob.escape(_PREFIX)}*"
    for path in folder.rglob(pattern) if below else folder.glob(pattern):
        pid = path.name.removeprefix(_PREFIX).partition("-")[0]
        if pid.isdecimal() and not alive(int(pid)):
            with contextlib.suppress(OSError):
                path.unlink()


def write_bytes(path: Path | str, content: bytes) -> None:
    """Write `content` to the file `path`, completely or not at all.

    Raises OutputError if the file cannot be written.
    """
    with atomic_write(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path | str, text: str) -> None:
    """Write `text` to the file `path` in UTF-8, with its line ends unchanged.

    The file is written completely or not at all.  Raises OutputError if it cannot be.
    """
    write_bytes(path, text.encode())


def write_json(path: Path | str, data: Any) -> None:
    """Write `data` to the file `path` as indented JSON, completely or not at all.

    Raises TypeError if `results.plain` has no JSON type for a value, and OutputError
    if the file cannot be written.
    """
    from pydantic_core import to_json  # eight times as fast as json.dumps

    write_bytes(path, to_json(plain(data), indent=2) + b"\n")


def step_name(number: int, end: str) -> str:
    """Return the file name of a step of a load path, such as `step-0003.vti`.

    number: index of the step from 0; end: end of the name, such as ".vti".
    """
    return f"step-{number:04d}{end}"


def write_collection(
    path: Path | str, mean_pressures: Sequence[float], ends: tuple[str, ...] = (".vti",)
) -> None:
    """Write the ParaView collection (.pvd) that lists the files of a load path.

    The files lie in the same folder and have the names of `step_name`.  ParaView's time
    of a step is its mean pressure in Pa while the load grows at each step.  If it falls
    anywhere along the path, the time is the number of the step, from 0, because times
    must grow.  The name of each entry states the mean pressure.

    Args:
        path: The .pvd file.
        mean_pressures: Mean pressure of each step in Pa.
        ends: Ends of the names of the files of one step (see `step_name`), such as
            (".vti",); the n-th file is part n of the data set.

    Raises:
        OutputError: The file cannot be written.
    """
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="Collection" version="0.1">',
        "<Collection>",
    ]
    times: Sequence[float] = range(len(mean_pressures))
    if all(low < high for low, high in itertools.pairwise(mean_pressures)):
        times = [float(pressure) for pressure in mean_pressures]
    for number, pressure in enumerate(mean_pressures):
        name = f"mean pressure {float(pressure)!r} Pa"
        for part, end in enumerate(ends):
            lines.append(
                f'<DataSet timestep="{times[number]!r}" part="{part}" name="{name}" '
                f'file="{step_name(number, end)}"/>'
            )
    lines += ["</Collection>", "</VTKFile>", ""]
    write_text(path, "\n".join(lines))


def require_replaceable(path: Path | str, mark: str = "") -> None:
    """Raise OutputError if a file exists that epcontact did not write for this purpose.

    A mistyped name would otherwise replace a file of the user's, or one that the
    command reads.  An empty file may be replaced.

    Args:
        path: The file that is to be written.
        mark: A text that each file of this purpose has in its first 2000 bytes; "":
            that of `MARKS` for the end of the name, and a file whose name has another
            end is not replaced.
    """
    if not os.path.isfile(path):
        return
    beginning = read_bytes(path, 2000)
    expected = mark or MARKS.get(Path(path).suffix)
    if beginning and (expected is None or expected.encode() not in beginning):
        raise OutputError(
            f"cannot write {path}: it exists and holds something else; give another "
            "name, or remove it"
        )


@contextlib.contextmanager
def lock_folders(folders: Iterable[Path]) -> Iterator[None]:
    """Let no other process of epcontact write into folders as long as the block lasts.

    Missing folders are created.  A lock ends with its process, also if that is killed.
    There are no locks on Windows and on file systems without them.

    Raises:
        OutputError: Another process holds a lock, or a folder cannot be created.
    """
    with contextlib.ExitStack() as stack:
        for folder in folders:
            try:
                folder.mkdir(parents=True, exist_ok=True)
                if sys.platform == "win32":
                    continue  # Windows opens no folder
                descriptor = os.open(folder, os.O_RDONLY)
                stack.callback(os.close, descriptor)
            except OSError as error:
                raise output_error("write", folder, error) from None
            if not try_lock(descriptor):
                raise OutputError(
                    f"cannot write {folder}: another epcontact writes into it; wait "
                    "for its end, or give another --output"
                )
        yield


def require_writable(folder: Path | str) -> None:
    """Raise OutputError if no file can be created in a folder.

    It is called before a long computation.
    """
    path = Path(folder).absolute()
    existing = next(parent for parent in (path, *path.parents) if parent.exists())
    try:
        os.rmdir(tempfile.mkdtemp(prefix=".epcontact-", dir=existing))
    except OSError as error:
        raise output_error("write", folder, error) from error


def read_bytes(path: Path | str, count: int = -1) -> bytes:
    """Return the first `count` bytes of the file `path`, or all if `count` is -1.

    Raises OutputError if the file cannot be read, or is a pipe or a device, which may
    never end.
    """
    if os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)):
        raise OutputError(f"cannot read {path}: it is a device or pipe, not a file")
    try:
        with Path(path).open("rb") as file:
            return file.read(count)
    except OSError as error:
        raise output_error("read", path, error) from None


def path_inside(folder: Path | str, name: str) -> Path:
    """Return the path of a file whose name was read from another file.

    That other file may come from somebody else, so the named file must lie in the same
    folder or below it.

    Args:
        folder: The folder of the file that holds the name.
        name: The name, relative to the folder; it may lead into a folder below.

    Raises:
        OutputError: The path leaves the folder, by "..", as an absolute path or
            through a symbolic link.
    """
    path = Path(folder) / name
    if not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder)):
        raise OutputError(f"cannot use {path}: it leads out of the folder {folder}")
    return path


def require_links_inside(folder: Path | str) -> None:
    """Raise OutputError if a symbolic link anywhere below a folder leads out of it.

    A folder of results that somebody else made can hold links to private files.
    """
    for parent, folders, files in os.walk(folder):  # does not follow links
        for name in (*folders, *files):
            path = os.path.join(parent, name)
            if os.path.islink(path):
                path_inside(folder, os.path.relpath(path, folder))


def output_error(
    verb: str, path: Path | str, error: OSError | ValueError
) -> OutputError:
    """Return (not raise) the OutputError for what the system refused to do.

    Args:
        verb: What was tried, such as "write".
        path: The file or folder of the message.
        error: The error of the system; if it concerns another file, the message names
            this file, too.
    """
    reason = (getattr(error, "strerror", None) or str(error)).lower()
    message = f"cannot {verb} {path}: {reason}"
    culprit = str(getattr(error, "filename", None) or path)
    is_temporary = Path(culprit).name.startswith(".epcontact-")
    if culprit != str(path) and not is_temporary:
        message += f": {culprit}"
    return OutputError(message)
