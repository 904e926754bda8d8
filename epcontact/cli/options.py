"""The options that several commands share, and the display of progress."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import click
from rich.console import Console, RenderableType
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from epcontact.cli.main import print_error
from epcontact.errors import printable
from epcontact.harness.case_files.case import SIZES
from epcontact.harness.solving.tasks import Run

size = click.option(
    "--size",
    type=click.Choice((*SIZES, "auto")),
    default="fast",
    show_default=True,
    help="Which of a case's sizes to run; auto: the cheapest that its gates allow.",
)
case_size = click.option(
    "--size", type=click.Choice(SIZES), default="fast", show_default=True
)
folder = functools.partial(
    click.option, "--output", type=click.Path(path_type=Path), show_default=True
)

#: The options of a `Run`, by the names of its attributes.
_RUN_OPTIONS = {
    "jobs": click.option(
        "--jobs",
        type=click.IntRange(min=1),
        default=None,
        help="Number of worker processes, which share the cores. "
        "Default: one for each core, or one for size large.",
    ),
    "output": folder(
        default=Path("results"),
        help="Folder for results; existing results of the same scene and sources are "
        "reused.",
    ),
    "fresh": click.option(
        "--fresh", is_flag=True, help="Solve again even if a result exists."
    ),
    "executor": click.option(
        "--executor",
        default="",
        metavar="MODULE:FUNCTION",
        help="Solve on the workers of the concurrent.futures.Executor that the "
        "function returns, such as epcontact.harness.cluster:dask. --jobs is then how "
        "many solves share the cores of a worker, by default 1.",
    ),
    "precision": click.option(
        "--precision",
        type=click.Choice(["single", "double"]),
        default="single",
        show_default=True,
        help="Of the fields in .vti files: single keeps seven digits, double all at "
        "twice the size.",
    ),
}
fields = click.option(
    "--fields",
    type=click.Choice(["first", "all", "steps", "film", "none"]),
    default=None,
    help="Write the fields (.vti) of the first surface, of all of them, or of none; "
    "steps: of the first one at every load, with the body of the finite elements "
    "(.vtu) and a collection (.pvd); film: draw these loads as a .gif, too.  Default: "
    "first; of verify none, or first with --report.",
)


def run_options(*names: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that gives a command the options of a `Run`.

    The command receives one argument `settings`, a `Run` with their values.

    Args:
        names: Names of options, keys of `_RUN_OPTIONS`: "jobs", "output", "fresh",
            "executor" or "precision".
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        """Return a command with the options, which passes them to it as a `Run`."""

        @functools.wraps(command)
        def call(**arguments: Any) -> None:
            """Call the command with a `Run` of the options, and its other arguments."""
            settings = Run(**{name: arguments.pop(name) for name in names})
            command(settings=settings, **arguments)

        decorated: Callable[..., None] = call
        for name in reversed(names):
            decorated = _RUN_OPTIONS[name](decorated)
        return decorated

    return decorate


#: Shorter remaining times, in s, are not shown.
_SOON = 10


class _Bar(Progress):
    """A progress bar below a table.

    Attributes:
        above: Returns the table for a number of lines and columns; None: no table.
    """

    above: Callable[[int, int], RenderableType] | None = None

    def get_renderables(self) -> Iterator[RenderableType]:
        """Yield the table of `self.above`, if there is one, and then the progress bar.

        The table may take half of the terminal's lines.
        """
        if self.above is not None:
            yield self.above(self.console.height // 2, self.console.width)
        yield self.make_tasks_table(self.tasks)


@contextlib.contextmanager
def show_progress(
    run: Run, above: Callable[[int, int], RenderableType] | None = None
) -> Iterator[Run]:
    """Show the progress of a run on stderr as long as the `with` block lasts.

    A terminal shows a bar; a pipe gets a line for each solve.

    Args:
        run: The run; the block gets a copy of it whose `progress` moves the bar.
        above: Returns the table above the bar, for its largest number of lines and
            columns; None: no table.
    """
    console = Console(stderr=True)
    is_terminal = console.is_terminal
    bar = _Bar(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        "left",
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not is_terminal,
        # The remaining time follows from all solves of a day, because a solve may take
        # longer than the 30 s that rich looks back.
        speed_estimate_period=86400,
    )
    bar.above = above
    # A disabled bar of an older rich ends with an empty line.
    with bar if is_terminal else contextlib.nullcontext():
        line = bar.add_task("solving", total=None)
        solves = 0

        def report(done: float, total: int, words: str) -> None:
            """Show how many solves are done.

            Args:
                done: Number of finished solves; fractions count running ones.
                total: Number of all solves.
                words: Description of the solve that has just finished; it ends with
                    "(reused)" if an earlier result was taken.  Empty: none finished.
            """
            nonlocal solves
            words = printable(words)
            is_reused = words.endswith("(reused)")
            if words and not is_reused:
                solves += 1
            # A reused result says nothing about the time of a solve, and the first
            # solves compile.  So the estimate begins again after each reused result and
            # when the number of solves has doubled.
            has_doubled = not solves & (solves - 1)
            if is_reused or (words and has_doubled):
                bar.reset(line, completed=int(done), total=total, description=words)
            else:
                bar.update(line, completed=done, total=total, description=words or None)
            if words and not is_terminal:
                remaining = ""
                if done < total:
                    remaining = _remaining_time(bar, line)
                print_error(f"[{done}/{total}] {words}{remaining}")

        yield replace(run, progress=report)


def _remaining_time(bar: Progress, line: TaskID) -> str:
    """Return the estimated remaining time in words, such as " (about 0:01:30 left)".

    It is empty if there is no estimate, or less than `_SOON` seconds are left.

    Args:
        bar: The progress bar.
        line: The task of the bar that counts the solves.
    """
    seconds = bar.tasks[line].time_remaining
    if not seconds or seconds < _SOON:
        return ""
    return f" (about {timedelta(seconds=math.ceil(seconds))} left)"
