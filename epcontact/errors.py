"""The errors that epcontact raises on purpose.

Each message is one sentence for the person who gave the input: it says what is wrong,
where, and what would be right.  The command line prints it unchanged and exits with 2.
"""

from __future__ import annotations

import difflib
import textwrap
from collections.abc import Iterable, Mapping, Sequence


class EpcontactError(Exception):
    """Base of every error raised on purpose."""


class InvalidScene(EpcontactError, ValueError):
    """A surface, material, body or load that describes no contact problem."""


class SurfaceWarning(UserWarning):
    """A surface that can be answered and is probably not what its maker means."""


class InvalidCase(EpcontactError, ValueError):
    """A case file that is unreadable or inconsistent; `args` has a sentence for each
    mistake.
    """

    def __str__(self) -> str:
        return "\n".join(map(str, self.args))


class OutputError(EpcontactError, OSError):
    """A file that could not be written or read back."""


class NotEnoughMemory(EpcontactError, MemoryError):
    """A problem that is estimated not to fit into memory; raised before anything is
    allocated.
    """


class NotConverged(EpcontactError, RuntimeError):
    """An iteration that ended without meeting its tolerance.

    `residuals` holds the last dimensionless residuals by name, `history` one value an
    iteration.
    """

    def __init__(
        self,
        message: str,
        residuals: Mapping[str, float] = {},
        history: Sequence[float] = (),
    ) -> None:
        super().__init__(message)
        self.residuals, self.history = dict(residuals), tuple(history)


class StudyUnavailable(EpcontactError):
    """A study that needs a package that is not installed."""


def printable(text: str) -> str:
    """Return `text` on one line, with escapes for characters that a terminal or XML
    cannot show.
    """
    line = " ".join(text.split())
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in line)


def sentence_of(error: BaseException) -> str:
    """Return what an error says in one line; one not raised on purpose is named by its
    type.
    """
    if isinstance(error, EpcontactError):
        return printable(str(error))
    text = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return printable(
        f"not enough memory ({text})" if isinstance(error, MemoryError) else text
    )


def closest(name: str, known: Iterable[str]) -> str:
    """Return the known name that is so close to an unknown one that it is probably
    meant, or "".
    """
    return next(iter(difflib.get_close_matches(name, sorted(known), n=1)), "")


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the end of a sentence on an unknown name: the closest known one, or their
    list.
    """
    listed = textwrap.shorten(", ".join(sorted(known)), 500, placeholder=" and others")
    close = closest(name, known)
    return f"; did you mean {close!r}?" if close else f"; there are {listed}"
