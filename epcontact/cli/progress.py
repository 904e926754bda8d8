"""The progress of a command: one line on a terminal, or now and then one in a pipe."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Iterator
from datetime import timedelta
from typing import ClassVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from epcontact.cli.main import print_error
from epcontact.errors import printable

#: Shorter remaining times, in s, are not shown.
_SOON = 10
#: Seconds of a command after which a pipe gets its first line, and seconds between two
#: lines.
_FIRST_LINE, _LINES_APART = 1.0, 10.0
#: Seconds after which work counts as long enough for a line.
_SHORTEST_WAIT = 0.2
#: How often the line on a terminal is drawn (1/s).  A drawing takes about 2 ms.
_DRAWINGS = 2


class ProgressLine:
    """The progress of a command as one line: what is done, and the remaining time.

    Attributes:
        bar: the bar of a terminal.
        last_printed: when a pipe got the latest line of any command, in s of the
            monotonic clock.
    """

    last_printed: ClassVar[float] = -math.inf

    def __init__(self, console: Console, command: str) -> None:
        """Create the line of a command of which nothing is done.

        Args:
            console: Console of stderr.  A terminal shows a bar while `bar` is entered
                as a context manager.
            command: Name of the command.
        """
        self.bar = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            "left",
            TimeRemainingColumn(),
            console=console,
            transient=True,
            disable=not console.is_terminal,
            refresh_per_second=_DRAWINGS,
            # The remaining time follows from all solves of a day, because a solve may
            # take longer than the 30 s that rich looks back.
            speed_estimate_period=86400,
        )
        self._command = command
        self._line = self.bar.add_task(command, total=None)
        self._solves = 0
        self._reused = 0

    def describe(self, sentence: str) -> None:
        """Show a sentence on the work that has just begun, beside the passed time."""
        self.bar.update(self._line, description=printable(sentence))

    def update(self, done: float, total: int, words: str) -> None:
        """Show how many solves, or cases with pictures, are done.

        Args:
            done: Number of finished ones; fractions count running ones.
            total: Number of all of them.
            words: Description of the solve that has just finished; it contains
                "(reused)" if an earlier result was taken.  Empty: none finished.
        """
        words = printable(words)
        is_reused = "(reused)" in words
        if is_reused:
            self._reused += 1
        elif words:
            self._solves += 1
        # A reused result says nothing about the time of a solve, and the first solves
        # compile.  So the estimate begins again after each reused result and when the
        # number of solves has doubled.
        has_doubled = not self._solves & (self._solves - 1)
        is_new_count = total != self.bar.tasks[self._line].total
        if is_new_count or is_reused or (words and has_doubled):
            self.bar.reset(
                self._line, completed=int(done), total=total, description=words or None
            )
        else:
            self.bar.update(
                self._line, completed=done, total=total, description=words or None
            )

    def text(self) -> str:
        """Return the line for a pipe.

        An example is "verify: 3 of 120, fem-capped bem seed5 (about 0:01:30 left)".  It
        has the passed time where nothing is counted.
        """
        task = self.bar.tasks[self._line]
        passed = timedelta(seconds=math.floor(task.elapsed or 0))
        text = f"{self._command}: running for {passed}"
        if task.total is not None:
            text = f"{self._command}: {int(task.completed)} of {int(task.total)}"
        if task.description != self._command:
            text += f", {task.description}"
        seconds = task.time_remaining
        if seconds and seconds >= _SOON:
            text += f" (about {timedelta(seconds=math.ceil(seconds))} left)"
        return text

    def last_text(self) -> str:
        """Return the last line for a pipe, such as "verify: 3 of 3, 2 reused".

        It is empty if there was nothing to do.
        """
        task = self.bar.tasks[self._line]
        if not task.total:
            return ""
        text = f"{self._command}: {int(task.completed)} of {int(task.total)}"
        if self._reused:
            text += f", {self._reused} reused"
        return text


@contextlib.contextmanager
def show_progress(command: str) -> Iterator[Callable[[float, int, str], None]]:
    """Show the progress of a command on stderr as long as the `with` block lasts.

    A terminal shows a bar.  A pipe gets a line after one second and then every ten
    seconds, also while nothing is finished, and a last line.

    Args:
        command: Name of the command.

    Yields:
        A function that updates the progress; its arguments are those of
        `ProgressLine.update`.
    """
    with _show_line(command) as line:
        yield line.update


@contextlib.contextmanager
def show_sentences(command: str) -> Iterator[Callable[[str], None]]:
    """Show what a command that counts nothing works on; see `show_progress`.

    Args:
        command: Name of the command.

    Yields:
        A function that is called with a sentence before each piece of work.  A pipe
        gets the latest sentence in each of its lines.
    """
    with _show_line(command) as line:
        yield line.describe


@contextlib.contextmanager
def _show_line(command: str) -> Iterator[ProgressLine]:
    """Show the line of a command as long as the `with` block lasts, and yield it."""
    console = Console(stderr=True)
    line = ProgressLine(console, command)
    if console.is_terminal:
        with line.bar:
            yield line
        return
    ended = threading.Event()

    def print_lines() -> None:
        """Print the line again and again until the block has ended."""
        # The imports of a command take much of its first second.
        seconds = max(_FIRST_LINE - time.process_time(), _SHORTEST_WAIT)
        earliest = ProgressLine.last_printed + _LINES_APART
        seconds = max(seconds, earliest - time.monotonic())
        while not ended.wait(seconds):
            print_error(line.text())
            ProgressLine.last_printed = time.monotonic()
            seconds = _LINES_APART

    printing = threading.Thread(target=print_lines, daemon=True)
    printing.start()
    try:
        yield line
    finally:
        ended.set()
        printing.join()
    if line.last_text():
        print_error(line.last_text())
