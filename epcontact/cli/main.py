"""The command line: the names of the commands, their exit codes and error sentences.

The exit code is 0 if all gates hold (or the command did its work), 1 if a gate fell
short, 2 after an error, with one sentence on stderr for each mistake, and 130 after an
interrupt.  The module of a command is imported when it runs, so that no other command
waits for solvers and charts to load.
"""

from __future__ import annotations

import ast
import contextlib
import errno
import io
import os
import signal
import sys
import threading
import traceback
from importlib import import_module
from pathlib import Path
from typing import TextIO

import click

from epcontact.errors import EpcontactError, InvalidCase, nearest, printable
from epcontact.machine import LINEAR_ALGEBRA, single_threads

#: The module of each command, whose function has the name of the command.
COMMANDS = {
    "accuracy": "ledger",
    "chart": "studies",
    "cite": "show",
    "compare": "ledger",
    "crosscheck": "plans",
    "export": "plans",
    "gates": "show",
    "hardness": "plans",
    "joint": "plans",
    "keys": "show",
    "list": "listing",
    "plan": "plans",
    "report": "figures",
    "run": "cases",
    "schema": "show",
    "stability": "studies",
    "sweep": "plans",
    "verify": "cases",
    "view": "figures",
}


class _Commands(click.Group):
    """The group of `COMMANDS`; each is imported when it runs."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command:
        """Import a command, or refuse an unknown one and name the nearest."""
        if cmd_name not in COMMANDS:
            raise click.UsageError(
                f"there is no command {cmd_name!r}{nearest(cmd_name, COMMANDS)}"
            )
        # No command has matrices that need threads, and to start them takes as long as
        # numpy's import.  A number of threads that the user sets counts.
        with single_threads(*({LINEAR_ALGEBRA} - os.environ.keys())):
            module = import_module(f"epcontact.cli.{COMMANDS[cmd_name]}")
        command: click.Command = getattr(module, cmd_name)
        return command

    def format_commands(
        self, ctx: click.Context, formatter: click.HelpFormatter
    ) -> None:
        """Write the first line of each command's docstring, which is read without an
        import.
        """
        functions = {
            f"{file.stem}.{node.name}": (ast.get_docstring(node) or "").partition("\n")[
                0
            ]
            for file in Path(__file__).parent.glob("*.py")
            for node in ast.parse(file.read_text(encoding="utf-8")).body
            if isinstance(node, ast.FunctionDef)
        }
        lines = [(name, functions[f"{file}.{name}"]) for name, file in COMMANDS.items()]
        with formatter.section("Commands"):
            formatter.write_dl(lines)


@click.command(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="epcontact")
def cli() -> None:
    """Cross-validate rough elastoplastic contact: theory, boundary and finite
    elements.
    """


def main() -> None:
    """Run the command line; an intended error is a sentence on stderr and exit code
    2.
    """
    signal.signal(signal.SIGTERM, _ended)
    if (
        signal.getsignal(signal.SIGINT) is signal.default_int_handler
    ):  # a job may ignore Ctrl-C
        signal.signal(signal.SIGINT, _ended)
    for name in ("stdin", "stdout", "stderr"):
        if (
            stream := getattr(sys, name)
        ) is None:  # closed: no other file must get its number
            os.set_inheritable(
                null := os.open(os.devnull, os.O_RDWR), True
            )  # nor of a child's
            setattr(sys, name, os.fdopen(null, "w"))
        if isinstance(
            stream, io.TextIOWrapper
        ):  # a code page without a symbol shows "?" for it
            stream.reconfigure(errors="replace")
    out, code, sentences = sys.stdout, 2, tuple[object, ...]()
    try:
        sys.exit(cli.main(prog_name="epcontact", standalone_mode=False))
    except (click.Abort, KeyboardInterrupt):
        code, sentences = 130, ("interrupted; results finished so far are kept",)
    except EpcontactError as error:
        sentences = error.args if isinstance(error, InvalidCase) else (error,)
    except click.exceptions.NoArgsIsHelpError as error:
        tell(error.format_message())
    except click.ClickException as error:
        context = error.ctx if isinstance(error, click.UsageError) else None
        command = context.command_path if context else "epcontact"
        sentences = (f"{error.format_message().rstrip('.')} (see {command} --help)",)
    except (SystemExit, BrokenPipeError) as end:
        # click and rich turn a closed pipe into exit code 1, which means that a gate
        # fell short; click replaces the output then.
        closed = (
            BrokenPipeError in (type(end), type(end.__context__))
            or sys.stdout is not out
        )
        if not closed:
            raise
        sys.stdout = out
        forget_output()
    except Exception as error:
        sentences = (_unexpected(error),)
    for sentence in sentences:
        tell(f"epcontact: {printable(str(sentence))}")
    sys.exit(code)


def _unexpected(error: Exception) -> str:
    """Return the sentence for a full disk, a name of no file, or a bug, which is
    traced.
    """
    if (
        isinstance(error, OSError) and error.errno == errno.ENOSPC
    ):  # files have OutputError
        forget_output()
        return "cannot write the output: no space left on device"
    if isinstance(error, OSError) and error.errno in (errno.ENAMETOOLONG, errno.EACCES):
        return f"cannot open {error.filename}: {os.strerror(error.errno).lower()}"
    traceback.print_exc()
    return "this is a bug in epcontact; please report it"


def tell(sentence: str) -> None:
    """Print a sentence on stderr; that nobody can read it there is no error."""
    try:
        click.echo(sentence, err=True)
    except OSError:
        forget_output(sys.stderr)


def forget_output(stream: TextIO | None = None) -> None:
    """Discard further output: it is full or a closed pipe, and exit would flush into it
    again.
    """
    with contextlib.suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), (stream or sys.stdout).fileno())


def _ended(number: int, _: object) -> None:
    """End the command, but not in the middle of a compilation, see `machine`."""
    # It is loaded with the first solver, and may be half loaded now.
    compiling = getattr(sys.modules.get("epcontact.machine"), "compiling", None)
    if compiling is None or not compiling():
        raise KeyboardInterrupt
    threading.Timer(0.05, signal.raise_signal, (number,)).start()
