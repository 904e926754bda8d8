"""What several commands share: their options, and how they show progress."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import click
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bar

from epcontact.harness.answers.run import Progress
from epcontact.harness.case_files import case as casefile

size = click.option(
    "--size",
    type=click.Choice((*casefile.SIZES, "auto")),
    default="fast",
    show_default=True,
    help="Which of a case's sizes to run; auto: the cheapest that its gates allow.",
)
jobs = click.option(
    "--jobs",
    type=click.IntRange(min=1),
    default=None,
    help="Number of worker processes, which share the cores. "
    "Default: one for each core, or one for size large.",
)
executor = click.option(
    "--executor",
    default="",
    metavar="MODULE:FUNCTION",
    help="Solve on the workers of the concurrent.futures.Executor that the function returns, such "
    "as epcontact.harness.cluster:dask. --jobs is then how many solves share the cores of a "
    "worker, by default 1.",
)
output = click.option(
    "--output",
    type=click.Path(path_type=Path),
    default=Path("results"),
    show_default=True,
    help="Folder for results; existing results of the same scene and sources are reused.",
)
fresh = click.option("--fresh", is_flag=True, help="Solve again even if a result exists.")
fields = click.option(
    "--fields",
    type=click.Choice(["first", "all", "steps", "film", "none"]),
    default="first",
    show_default=True,
    help="Write the fields (.vti) of the first surface, of all of them, or of none; steps: of the "
    "first one at every load, with the body of the finite elements (.vtu) and a collection (.pvd); "
    "film: draw these loads as a .gif, too.",
)
precision = click.option(
    "--precision",
    type=click.Choice(["single", "double"]),
    default="single",
    show_default=True,
    help="Of the fields in .vti files: single keeps seven digits, double all at twice the size.",
)


@contextlib.contextmanager
def shown_progress() -> Iterator[tuple[Callable[[Progress], None], Callable[[float, int], None]]]:
    """Show progress on stderr with the time left: a bar on a terminal, elsewhere a line a solve.

    The second function moves the bar within a solve.
    """
    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    # The time left is estimated from all solves, which may take longer than rich's 30 s each.
    terminal = console.is_terminal
    bar = Bar(
        *columns, console=console, transient=True, disable=not terminal, speed_estimate_period=_DAY
    )
    # A disabled bar of an older rich ends with an empty line.
    with bar if terminal else contextlib.nullcontext():
        row = bar.add_task("solving", total=None)

        def advance(at: Progress) -> None:
            if at.note == "reused":  # says nothing about the time of a solve
                bar.reset(row, completed=at.done, total=at.total, description=at.task)
            else:
                bar.update(row, completed=at.done, total=at.total, description=at.task)
            if not terminal:
                notes = [at.note] if at.note else []
                if at.done < at.total and at.seconds_left >= _SOON:
                    notes.append(f"about {duration(at.seconds_left)} left")
                note = f" ({', '.join(notes)})" if notes else ""
                click.echo(f"[{at.done}/{at.total}] {at.task}{note}", err=True)

        def move(done: float, total: int) -> None:
            bar.update(row, completed=done, total=total)

        yield advance, move


#: Less time than this many seconds is not worth a note.
_SOON = 10
_DAY = 86400


def duration(seconds: float) -> str:
    """Return a length of time in two digits.

    Example:
        >>> duration(42), duration(4000), duration(200_000)
        ('42 s', '67 min', '56 h')
    """
    for unit, length, most in (("s", 1, 100), ("min", 60, 100), ("h", 3600, 72)):
        if seconds < length * most:
            return f"{math.ceil(seconds / length)} {unit}"
    return f"{math.ceil(seconds / _DAY)} days"
