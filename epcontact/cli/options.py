"""The options that several commands share, and the way they show progress."""

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
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from epcontact.cli.main import tell
from epcontact.harness.case_files.case import SIZES
from epcontact.harness.solving.tasks import Run

size = click.option(
    "--size",
    type=click.Choice((*SIZES, "auto")),
    default="fast",
    show_default=True,
    help="Which of a case's sizes to run; auto: the cheapest that its gates allow.",
)
own_size = click.option(
    "--size", type=click.Choice(SIZES), default="fast", show_default=True
)
folder = functools.partial(
    click.option, "--output", type=click.Path(path_type=Path), show_default=True
)

#: The options that make a `Run`, by its attributes.
_OF_RUN = {
    "jobs": click.option(
        "--jobs",
        type=click.IntRange(min=1),
        default=None,
        help="Number of worker processes, which share the cores. "
        "Default: one for each core, or one for size large.",
    ),
    "output": folder(
        default=Path("results"),
        help="Folder for results; existing results of the same scene and sources are reused.",
    ),
    "fresh": click.option(
        "--fresh", is_flag=True, help="Solve again even if a result exists."
    ),
    "executor": click.option(
        "--executor",
        default="",
        metavar="MODULE:FUNCTION",
        help="Solve on the workers of the concurrent.futures.Executor that the function returns, "
        "such as epcontact.harness.cluster:dask. --jobs is then how many solves share the cores of "
        "a worker, by default 1.",
    ),
    "precision": click.option(
        "--precision",
        type=click.Choice(["single", "double"]),
        default="single",
        show_default=True,
        help="Of the fields in .vti files: single keeps seven digits, double all at twice the "
        "size.",
    ),
}
fields = click.option(
    "--fields",
    type=click.Choice(["first", "all", "steps", "film", "none"]),
    default=None,
    help="Write the fields (.vti) of the first surface, of all of them, or of none; steps: of the "
    "first one at every load, with the body of the finite elements (.vtu) and a collection (.pvd); "
    "film: draw these loads as a .gif, too.  Default: first; of verify none, or first with "
    "--report.",
)


def of_run(*names: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the options of these names, and hand them to it as one `Run`, its
    `run`.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(command)
        def handed(**given: Any) -> None:
            command(run=Run(**{name: given.pop(name) for name in names}), **given)

        for name in reversed(names):
            handed = _OF_RUN[name](handed)
        return handed

    return decorate


#: Less time than this many seconds is not worth a note.
_SOON = 10


class _Bar(Progress):
    """The bar, and above it what is known already, in so many lines."""

    above: Callable[[int, int], RenderableType] | None = None

    def get_renderables(self) -> Iterator[RenderableType]:
        """Yield what a terminal shows."""
        if self.above is not None:
            yield self.above(self.console.height // 2, self.console.width)
        yield self.make_tasks_table(self.tasks)


@contextlib.contextmanager
def shown_progress(
    run: Run, above: Callable[[int, int], RenderableType] | None = None
) -> Iterator[Run]:
    """Show the progress of a run on stderr: a bar on a terminal, elsewhere a line a
    solve.
    """
    console = Console(stderr=True)
    terminal = console.is_terminal
    columns = (
        "{task.description}",
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    # The time left is estimated from all solves of a day, which may take longer than
    # rich's 30 s.
    bar = _Bar(
        *columns,
        "left",
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not terminal,
        speed_estimate_period=86400,
    )
    bar.above = above
    # A disabled bar of an older rich ends with an empty line.
    with bar if terminal else contextlib.nullcontext():
        row, solved = bar.add_task("solving", total=None), 0

        def show(done: float, total: int, words: str) -> None:
            nonlocal solved
            # What is reused says nothing about the time of a solve, and the first
            # solves compile: the estimate is that of the last half of the solves or
            # more.
            solved += bool(words) and not words.endswith("(reused)")
            if words.endswith("(reused)") or (words and not solved & (solved - 1)):
                bar.reset(row, completed=int(done), total=total, description=words)
            else:
                bar.update(row, completed=done, total=total, description=words or None)
            if words and not terminal:
                left = bar.tasks[row].time_remaining if done < total else None
                about = timedelta(seconds=math.ceil(left or 0))
                note = f" (about {about} left)" if left and left >= _SOON else ""
                tell(f"[{done}/{total}] {words}{note}")

        yield replace(run, progress=show)
