"""Files that appear whole or not at all.

A file is written under a temporary name beside its destination, flushed to the disk and
renamed over the destination, which the system does in one step.  Only a killed process
can leave a temporary file behind; its name says on which machine it was and which
process, so that `remove_leftovers` knows it.  `tempfile` would make files that only
their owner can read.
"""

from __future__ import annotations

import contextlib
import glob
import os
import platform
import secrets
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from epcontact.errors import OutputError
from epcontact.machine import alive
from epcontact.results import plain

#: What may become the name of a file or folder: the id of a case, a size, a method, the
#: label of a surface.  Such a name is not absolute and cannot lead to another folder.
NAME_PATTERN = r"^[A-Za-z0-9_][A-Za-z0-9._-]*$"
#: The begin of the name of a temporary file; the number of the process follows.
_BEGIN = f".epcontact-{platform.node()}-"


@contextlib.contextmanager
def whole_file(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path, whose file replaces `path` if the block ends without an
    error. Missing folders are made, and a symbolic link is replaced, not followed.
    Raises OutputError if the system refuses; what else the block raises passes.
    """
    if not Path(path).name or "\0" in str(path):
        raise OutputError(f"cannot write {str(path)!r}: it names no file")
    final = Path(path)
    try:
        final.parent.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise refusal("write", path, error) from error
    if os.path.exists(final) and not os.path.isfile(final):
        kind = "folder" if os.path.isdir(final) else "device or pipe"
        raise OutputError(f"cannot write {path}: it is a {kind}, not a file")
    temporary = final.with_name(
        f"{_BEGIN}{os.getpid()}-{secrets.token_hex(6)}{final.suffix[:16]}"
    )
    try:
        temporary.touch(exist_ok=False)
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(temporary, final)
    except OSError as error:
        if isinstance(error, OutputError) or error.filename not in (
            None,
            str(temporary),
        ):
            raise
        raise refusal("write", path, error) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def remove_leftovers(folder: Path) -> None:
    """Remove the temporary files of killed processes of this machine below a folder."""
    for path in folder.rglob(f"{glob.escape(_BEGIN)}*"):
        pid = path.name.removeprefix(_BEGIN).partition("-")[0]
        if pid.isdecimal() and not alive(int(pid)):
            with contextlib.suppress(OSError):
                path.unlink()


def write_bytes(path: Path | str, content: bytes) -> None:
    """Write `content` to `path`, whole or not at all.  Raises OutputError."""
    with whole_file(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path | str, text: str) -> None:
    """Write `text` in UTF-8 with unchanged line ends, as `write_bytes` does."""
    write_bytes(path, text.encode())


def write_json(path: Path | str, data: Any) -> None:
    """Write `data` as indented JSON of the types of `epcontact.results.plain`."""
    from pydantic_core import to_json  # eight times as fast as json.dumps

    write_bytes(path, to_json(plain(data), indent=2) + b"\n")


def step_name(number: int, end: str) -> str:
    """Return the file name of a step of a load path, as in `step-0003.vti`."""
    return f"step-{number:04d}{end}"


def write_collection(
    path: Path | str, mean_pressures: Sequence[float], ends: tuple[str, ...] = (".vti",)
) -> None:
    """Write a ParaView collection (.pvd) over the steps of a load path beside it.  The
    time of a step is its number, because a path may unload; its name has the mean
    pressure (Pa).  Part n of a step is its file with the n-th of the `ends`.
    """
    entries = "".join(
        f'<DataSet timestep="{number}" part="{part}" name="mean pressure {float(pressure)!r} Pa" '
        f'file="{step_name(number, end)}"/>\n'
        for number, pressure in enumerate(mean_pressures)
        for part, end in enumerate(ends)
    )
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n<Collection>\n'
    write_text(path, f"{head}{entries}</Collection>\n</VTKFile>\n")


def require_writable(folder: Path | str) -> None:
    """Raise OutputError, before a long computation, if no file can be made in a
    folder.
    """
    path = Path(folder).absolute()
    present = next(place for place in (path, *path.parents) if place.exists())
    try:
        os.rmdir(tempfile.mkdtemp(prefix=".epcontact-", dir=present))
    except OSError as error:
        raise refusal("write", folder, error) from error


def read_bytes(path: Path | str, count: int = -1) -> bytes:
    """Read the first `count` bytes of a file, or all of them.  Raises OutputError."""
    try:
        with Path(path).open("rb") as file:
            return file.read(count)
    except OSError as error:
        raise refusal("read", path, error) from None


def path_inside(folder: Path | str, name: str) -> Path:
    """Return the path of a file that another file names.

    The other file may come from somebody else, so the named one must lie in its folder.

    Args:
        folder: the folder of the file that holds the name.
        name: the name, relative to the folder; it may lead into a folder below.

    Raises:
        OutputError: if the path leaves the folder, by "..", as an absolute path or
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


def refusal(verb: str, path: Path | str, error: OSError | ValueError) -> OutputError:
    """Return the error that says what the system refused to do with `path`."""
    reason = (getattr(error, "strerror", None) or str(error)).lower()
    culprit = str(getattr(error, "filename", None) or path)
    known = culprit == str(path) or Path(culprit).name.startswith(".epcontact-")
    return OutputError(
        f"cannot {verb} {path}: {reason}{'' if known else f': {culprit}'}"
    )
