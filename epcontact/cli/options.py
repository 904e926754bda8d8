"""The options that several commands share.

The modules of solvers are not imported here, so that `--help` is fast.
"""

from __future__ import annotations

import functools
import itertools
import os
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from epcontact.errors import NotEnoughMemory
from epcontact.harness.case_files.text import SIZES
from epcontact.machine import address_space_limit


class OutputFile(click.Path):
    """The type of an option or argument that names a file to write.

    A file that exists is refused unless it is of the kind that its name says, see
    `files.require_replaceable`.  Tables (.csv) are checked by their columns when they
    are written.  `require_separate_outputs` refuses a file that the command reads.
    """

    def __init__(self) -> None:
        """Describe a path that is no folder."""
        super().__init__(dir_okay=False, path_type=Path)

    def convert(
        self,
        value: str | os.PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> Path:
        """Return the path; raise OutputError if its file must not be replaced."""
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        if path.suffix != ".csv":
            import_module("epcontact.files").require_replaceable(path)
        return path


def require_separate_outputs(command: click.Command, values: Mapping[str, Any]) -> None:
    """Raise UsageError if a command would write over a file that it reads.

    Args:
        command: The command; its outputs have the type `OutputFile`.
        values: The values of its options and arguments by name; any other text or path
            may name a file to read.
    """
    outputs: list[str | Path] = []
    inputs: list[str | Path] = []
    for parameter in command.params:
        given = values.get(parameter.name or "")
        is_output = isinstance(parameter.type, OutputFile)
        for value in given if isinstance(given, tuple) else (given,):
            if isinstance(value, str | Path) and os.path.isfile(value):
                (outputs if is_output else inputs).append(value)
    for output, source in itertools.product(outputs, inputs):
        if os.path.samefile(output, source):
            raise click.UsageError(
                f"{output} is read by this command; write to another file"
            )


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


#: Address space in bytes without which no command begins.  The libraries and the
#: compiler abort the process where they get no memory, without a message.  Small cases
#: ran with 0.7 GB; the verification of several did not.
_ADDRESS_SPACE = 2**30


def require_address_space() -> None:
    """Raise NotEnoughMemory if this process may have less than _ADDRESS_SPACE."""
    limit = address_space_limit()
    if limit < _ADDRESS_SPACE:
        raise NotEnoughMemory(
            f"this process may have {limit / 2**30:.2g} GiB of address space "
            f"(ulimit -v), but epcontact needs {_ADDRESS_SPACE / 2**30:.2g} GiB for "
            "its libraries and its compiler; raise the limit, or remove it by "
            "ulimit -v unlimited"
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
            require_address_space()
            tasks = import_module("epcontact.harness.solving.tasks")
            settings = tasks.Run(**{name: arguments.pop(name) for name in names})
            command(settings=settings, **arguments)

        decorated: Callable[..., None] = call
        for name in reversed(names):
            decorated = _RUN_OPTIONS[name](decorated)
        return decorated

    return decorate
