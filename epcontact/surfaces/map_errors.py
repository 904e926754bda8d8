"""What the readers of map files share: their errors, and the size of archives."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from epcontact.errors import InvalidScene
from epcontact.machine import available_memory

#: Bytes that a zip file (.x3p) may always unpack to, if they fit into memory.
_UNPACKED = 2**28
#: Times its size that a larger zip file may unpack to: heights shrink ten times or so,
#: zeros a thousand times.
_SHRUNK = 100
#: Times the unpacked bytes that a reader holds in memory; 1.27 were measured.
_HELD = 3
#: Most characters of the message of a parser that a message shows.
_SHOWN = 160


@contextmanager
def errors_of(path: Path, problem: str = "", remedy: str = "") -> Iterator[None]:
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
        if type(error) in (IndexError, KeyError, TypeError, AttributeError):
            # The parser has failed itself, and its message is about its own code.
            sentence = "it is damaged or of another kind"
        sentence = sentence or type(error).__name__
        if len(sentence) > _SHOWN:
            sentence = sentence[: _SHOWN - 1] + "…"
        message = f"{path}: {problem} ({sentence})"
        if remedy:
            message += f"; {remedy}"
        raise InvalidScene(message) from None


def require_small_archive(path: Path) -> None:
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
