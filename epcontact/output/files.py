"""Files that appear whole or not at all.

Everything is written to a temporary file in the folder of its destination, flushed to the disk
and then renamed over the destination, which the system does in one step: a reader, a second run
into the same folder or a crash never meets half a file.  The temporary file is removed on every
exception, a keyboard interrupt included; only a killed process can leave one behind, under a
name that begins with `.epcontact-`.

Whatever the system refuses becomes one sentence of an `OutputError` that names the file.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from epcontact.errors import OutputError
from epcontact.results import plain

_REASONS = {
    errno.EACCES: "permission is denied",
    errno.EPERM: "permission is denied",
    errno.EROFS: "the file system is read-only",
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file would be larger than allowed",
    errno.ENAMETOOLONG: "its name is too long for the file system",
    errno.ENOTDIR: "a part of its path is a file, not a folder",
    errno.ENOENT: "a folder of its path does not exist",
    errno.EEXIST: "a file of that name is in the way",
    errno.ELOOP: "its symbolic links run in a circle",
    errno.EMFILE: "too many files are open",
}


def _reason(error: OSError) -> str:
    known = _REASONS.get(error.errno or 0)
    return known or (error.strerror or str(error) or type(error).__name__).lower()


def make_folder(folder: Path | str) -> Path:
    """Make `folder` and the folders above it, where they are missing, and return it.

    Raises OutputError if the system refuses.
    """
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make the folder {folder}: {_reason(error)}") from error
    return Path(folder)


@contextlib.contextmanager
def whole_file(path: Path | str) -> Iterator[Path]:
    """Lend a temporary path; when the block ends well, its file takes the place of `path`.

    For libraries that write by name: the temporary path has the suffix of `path`.  Missing
    folders are made, and a symbolic link keeps pointing where it points.  The file gets the
    permissions of any new file.

    Raises OutputError if the system refuses; other exceptions of the block pass through.
    """
    final = _destination(path)
    make_folder(final.parent)
    temporary: Path | None = None
    try:
        temporary = _new_file(final.parent, final.suffix)
        yield temporary
        _flush(temporary)
        os.replace(temporary, final)
        temporary = None
        _flush_folder(final.parent)
    except OSError as error:
        if not _concerns(error, temporary, final):
            raise
        raise OutputError(f"cannot write {path}: {_reason(error)}") from error
    finally:
        if temporary is not None:
            with contextlib.suppress(OSError):
                temporary.unlink()


def write_bytes(path: Path | str, content: bytes) -> None:
    """Write `content` to `path`, whole or not at all.  Raises OutputError."""
    with whole_file(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path | str, text: str) -> None:
    """Write `text` in UTF-8 with its line ends as they are, whole or not at all.

    Raises OutputError.
    """
    write_bytes(path, text.encode())


def write_json(path: Path | str, data: Any) -> None:
    """Write `data` as indented JSON, whole or not at all.

    Infinities and NaN become the strings inf, -inf and nan; numpy arrays and numbers, tuples,
    mappings and paths become what JSON has for them.

    Raises OutputError if the system refuses, TypeError if `data` holds anything else.
    """
    write_text(path, json.dumps(plain(data), indent=2, allow_nan=False, ensure_ascii=False) + "\n")


def _destination(path: Path | str) -> Path:
    """Where `path` leads, refused unless a regular file is there or could be."""
    if not Path(path).name:
        raise OutputError(f"cannot write {str(path)!r}: it names no file")
    try:
        if os.path.islink(path) and not os.path.exists(path):
            raise OutputError(
                f"cannot write {path}: it is a symbolic link to {os.readlink(path)}, "
                "which does not exist"
            )
        final = Path(os.path.realpath(path))
        mode = final.stat().st_mode if final.exists() else stat.S_IFREG
    except OutputError:
        raise
    except (OSError, ValueError) as error:
        reason = _reason(error) if isinstance(error, OSError) else str(error)
        raise OutputError(f"cannot write {path}: {reason}") from error
    if stat.S_ISDIR(mode):
        raise OutputError(f"cannot write {path}: it is a folder")
    if not stat.S_ISREG(mode):
        raise OutputError(f"cannot write {path}: it is a device or pipe, not a file")
    return final


def _new_file(folder: Path, suffix: str) -> Path:
    """An empty file of a name nobody else has, with the permissions of any new file.

    `tempfile` would make it readable by its owner alone, and such it would stay.
    """
    while True:
        path = folder / f".epcontact-{secrets.token_hex(6)}{suffix[:16]}"
        try:
            os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        except FileExistsError:
            continue
        return path


def _flush(path: Path) -> None:
    """Have the system put the file on the disk, so that a power cut after the renaming cannot
    leave an empty file under the final name."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    """The same for the name itself; not every system can open a folder, and none needs to."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _concerns(error: OSError, temporary: Path | None, final: Path) -> bool:
    """Whether the error is about this file, not about another one used inside the block."""
    if isinstance(error, OutputError):
        return False
    ours = {str(name) for name in (temporary, final, final.parent) if name is not None}
    return error.filename is None or str(error.filename) in ours or temporary is None
