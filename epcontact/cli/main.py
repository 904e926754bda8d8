"""The command line: the names of the commands, their exit codes and error sentences.

The exit code is 0 if all gates hold (or the command did its work), 1 if a gate fell short, 2 after
an error, with one sentence on stderr for each mistake, and 130 after an interrupt.

The module of a command is imported when the command runs, so that the list of commands, and every
command that solves nothing, does not wait for solvers and charts to load.
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

import click

from epcontact.errors import EpcontactError, InvalidCase, nearest, printable
from epcontact.harness.threads import LINEAR_ALGEBRA, single_threads

#: The module of each command, whose function has the name of the command.
COMMANDS = {
    "chart": "studies",
    "cite": "show",
    "crosscheck": "plans",
    "gates": "show",
    "hardness": "plans",
    "keys": "show",
    "list": "listing",
    "plan": "plans",
    "report": "figures",
    "run": "cases",
    "schema": "show",
    "stability": "studies",
    "sweep": "sweeps",
    "verify": "cases",
    "view": "figures",
}

#: Click (from 8.2) raises it if no command is given; its message is the help.
_NO_ARGUMENTS: type[click.UsageError] | tuple[()]
_NO_ARGUMENTS = getattr(click.exceptions, "NoArgsIsHelpError", ())


class _Commands(click.Group):
    """The group of `COMMANDS`; each is imported when it runs."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands."""
        del ctx
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command."""
        del ctx
        if cmd_name not in COMMANDS:
            return None
        # No command has matrices that need threads, and to start them takes as long as numpy's
        # import.  A number of threads that the user sets counts.
        with single_threads(*({LINEAR_ALGEBRA} - os.environ.keys())):
            module = import_module(f"epcontact.cli.{COMMANDS[cmd_name]}")
        command: click.Command = getattr(module, _function(cmd_name))
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Refuse an unknown command and name the nearest one."""
        if args[0] not in COMMANDS:
            raise click.UsageError(f"there is no command {args[0]!r}{nearest(args[0], COMMANDS)}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the first line of each command's docstring, which is read without an import."""
        del ctx
        functions = {
            f"{file.stem}.{node.name}": (ast.get_docstring(node) or "").partition("\n")[0]
            for file in Path(__file__).parent.glob("*.py")
            for node in ast.parse(file.read_text(encoding="utf-8")).body
            if isinstance(node, ast.FunctionDef)
        }
        with formatter.section("Commands"):
            formatter.write_dl(
                [(name, functions[f"{file}.{_function(name)}"]) for name, file in COMMANDS.items()]
            )


def _function(command: str) -> str:
    """Return the name of a command's function; `list` is a word of Python's."""
    return "list_cases" if command == "list" else command


@click.command(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="epcontact")
def cli() -> None:
    """Cross-validate rough elastoplastic contact: theory, boundary and finite elements."""


def main() -> None:
    """Run the command line; an intended error is a sentence on stderr and exit code 2."""
    signal.signal(signal.SIGTERM, _ended)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # a job may ignore Ctrl-C
        signal.signal(signal.SIGINT, _ended)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a code page without a symbol shows "?" for it
            stream.reconfigure(errors="replace")
    out = sys.stdout
    sentences: tuple[str, ...]
    try:
        sys.exit(cli.main(prog_name="epcontact", standalone_mode=False))
    except (click.Abort, KeyboardInterrupt):
        code, sentences = 130, ("interrupted; results finished so far are kept",)
    except EpcontactError as error:
        code = 2
        sentences = error.args if isinstance(error, InvalidCase) else (str(error),)
    except _NO_ARGUMENTS as error:
        click.echo(error.format_message(), err=True)
        code, sentences = 2, ()
    except click.ClickException as error:
        context = error.ctx if isinstance(error, click.UsageError) else None
        command = context.command_path if context else "epcontact"
        code, sentences = 2, (f"{error.format_message().rstrip('.')} (see {command} --help)",)
    except SystemExit as end:
        # click and rich turn a closed pipe into exit code 1, which means that a gate fell short;
        # click replaces the output then.
        if not isinstance(end.__context__, BrokenPipeError) and sys.stdout is out:
            raise
        sys.stdout = out
        forget_output()
        code, sentences = 2, ()
    except BrokenPipeError:
        forget_output()
        code, sentences = 2, ()
    except Exception as error:
        code, sentences = 2, (_unexpected(error),)
    for sentence in sentences:
        click.echo(f"epcontact: {printable(sentence)}", err=True)
    sys.exit(code)


def _unexpected(error: Exception) -> str:
    """Return the sentence for a full disk, for a name that can be no file's, or for a bug.

    The traceback of a bug is printed.
    """
    if isinstance(error, OSError) and error.errno == errno.ENOSPC:  # files have OutputError
        forget_output()
        return "cannot write the output: no space left on device"
    if isinstance(error, OSError) and error.errno in (errno.ENAMETOOLONG, errno.EACCES):
        return f"cannot open {error.filename}: {os.strerror(error.errno).lower()}"
    traceback.print_exc()
    return "this is a bug in epcontact; please report it"


def forget_output() -> None:
    """Discard further output: the pipe is closed, and exit would flush into it again."""
    with contextlib.suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _ended(number: int, _: object) -> None:
    """End the command, but not in the middle of a compilation, see `machine`."""
    # It is loaded with the first solver, and may be half loaded now.
    compiling = getattr(sys.modules.get("epcontact.machine"), "compiling", None)
    if compiling is not None and compiling():
        threading.Timer(0.05, signal.raise_signal, (number,)).start()
        return
    raise KeyboardInterrupt
