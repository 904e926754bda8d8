"""The errors that epcontact raises on purpose.

Each message is one sentence for the person who gave the input.  It says what is wrong,
where, and what is expected.  The command line prints it unchanged and exits with 2.
"""

from __future__ import annotations

import difflib
import os
import textwrap
import traceback
from collections.abc import Iterable, Mapping, Sequence


class EpcontactError(Exception):
    """Base of every error raised on purpose."""


class InvalidScene(EpcontactError, ValueError):
    """A surface, material, body or load that describes no contact problem."""


class SurfaceWarning(UserWarning):
    """A surface that can be solved, but is probably not what the user intended."""


class InvalidCase(EpcontactError, ValueError):
    """A case file that is unreadable or inconsistent.

    `args` holds a sentence for each mistake.
    """

    def __str__(self) -> str:
        """Return the mistakes of the case file, one a line."""
        return "\n".join(map(str, self.args))


class OutputError(EpcontactError, OSError):
    """A file that could not be written or read back."""


class NotEnoughMemory(EpcontactError, MemoryError):
    """A problem that is estimated not to fit into memory.

    It is raised before anything is allocated.
    """


class NotConverged(EpcontactError, RuntimeError):
    """An iteration that ended without meeting its tolerance.

    Attributes:
        residuals: The last dimensionless residuals, by name.
        history: The residual that decides convergence, one value for each iteration.
    """

    def __init__(
        self,
        message: str,
        residuals: Mapping[str, float] = {},
        history: Sequence[float] = (),
    ) -> None:
        """Create the error that an iteration did not converge.

        Args:
            message: The sentence for the user.
            residuals: The last dimensionless residuals, by name; they are copied.
            history: The residual that decides convergence after each iteration.
        """
        super().__init__(message)
        self.residuals = dict(residuals)
        self.history = tuple(history)


class StudyUnavailable(EpcontactError):
    """A study that needs a package that is not installed."""


#: Characters of the longest sentence that is shown; the rest of its middle is left out.
LONGEST_SENTENCE = 2000


def without_controls(text: str) -> str:
    """Return a text in which every character is shown as itself, not obeyed.

    Every word that a file or a solver supplies passes through this function before a
    terminal, an XML file or a chart shows it.  Line breaks stay.  Other characters that
    are not printable, such as those that begin a command to a terminal or turn the
    direction of writing, become escapes such as \\x1b.
    """
    characters = []
    for character in text:
        if character.isprintable() or character == "\n":
            characters.append(character)
        else:
            characters.append(repr(character)[1:-1])
    return "".join(characters)


def printable(text: str) -> str:
    """Return a text on one line without control characters, for a sentence.

    Line breaks and runs of blanks become one blank; see `without_controls` for other
    characters.  Of a text longer than `LONGEST_SENTENCE` the middle is left out, and
    the number of its characters is stated.
    """
    line = without_controls(" ".join(text.split()))
    omitted = len(line) - LONGEST_SENTENCE
    if omitted <= 0:
        return line
    half = LONGEST_SENTENCE // 2
    return f"{line[:half]} … {omitted} characters left out … {line[-half:]}"


def sentence_of(error: BaseException) -> str:
    """Return the message of an error on one line, see `printable`.

    An `EpcontactError` has a message for the user.  The message of any other error is
    preceded by the name of its class, and a MemoryError is called "not enough memory".
    """
    if isinstance(error, EpcontactError):
        return printable(str(error))
    text = type(error).__name__
    if str(error):
        text += f": {error}"
    if isinstance(error, MemoryError):
        text = f"not enough memory ({text})"
    return printable(text)


def place_of(error: BaseException, above: str = "", count: int = 1) -> str:
    """Return where an error was raised, such as " (my_solver.py, line 6, in solve: x)".

    Args:
        error: an error that was raised.
        above: the path of a module; the places are those that it called.
        count: the largest number of places; the last is the innermost.

    Returns:
        The text begins with a blank; it is empty for an error without a traceback.
    """
    frames = traceback.extract_tb(error.__traceback__)
    called = [index for index, frame in enumerate(frames) if frame.filename == above]
    below = frames[called[-1] + 1 :] if called else frames
    places = []
    for frame in below[-count:]:
        name = os.path.basename(frame.filename)
        places.append(f"{name}, line {frame.lineno}, in {frame.name}: {frame.line}")
    return f" ({printable('; '.join(places))})" if places else ""


def closest(name: str, known: Iterable[str]) -> str:
    """Return the known name that is spelt most like `name`; "" if none is similar.

    known: the names that exist, in any order.
    """
    matches = difflib.get_close_matches(name, sorted(known), n=1)
    if not matches:
        return ""
    return matches[0]


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the end of an error message about the unknown `name`.

    It is '; did you mean "..."?' with the known name that is spelt most alike, or
    "; there are ..." with the known names (at most 500 characters) if none is similar.
    """
    known = sorted(known)
    suggestion = closest(name, known)
    if suggestion:
        return f"; did you mean {suggestion!r}?"
    listed = textwrap.shorten(", ".join(known), 500, placeholder=" and others")
    return f"; there are {listed}"
