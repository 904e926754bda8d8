"""The command line: names of the commands, exit codes and error sentences.

The exit code is 0 if all gates hold (or the command did its work), 1 if a gate fell
short, 2 after an error, with one sentence on stderr for each mistake, and 130 after an
interrupt.  The module of a command is imported when it runs, so that no other command
waits for solvers and charts to load.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import signal
import sys
import threading
import traceback
from typing import TextIO

import click

from epcontact.cli import commands
from epcontact.cli.ascii_forms import ASCII_FORMS
from epcontact.cli.commands import COMMANDS, EXAMPLES
from epcontact.errors import (
    EpcontactError,
    InvalidCase,
    nearest,
    printable,
    without_controls,
)


class _Commands(click.Group):
    """The group of all commands."""

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command:
        """Return a command by its name; raise UsageError if there is none.

        `ctx` is not used.
        """
        if cmd_name not in self.commands:
            raise click.UsageError(
                f"there is no command {cmd_name!r}{nearest(cmd_name, self.commands)}"
            )
        command = self.commands[cmd_name]
        lines = [f"  epcontact {example}" for example in EXAMPLES[cmd_name]]
        command.epilog = "\n".join(("\b", "Examples:", *lines))
        return command

    def format_commands(
        self, ctx: click.Context, formatter: click.HelpFormatter
    ) -> None:
        """Write the list of the commands, each with the first line of its help.

        `ctx` is not used; `formatter` collects the help text.
        """
        rows = []
        for name, command in sorted(self.commands.items()):
            first_line, *_ = (command.help or "").split("\n")
            rows.append((name, first_line))
        with formatter.section("Commands"):
            formatter.write_dl(rows)


#: Help is as wide as the terminal, but has at most so many columns.
_WIDEST_HELP = 120


@click.command(
    cls=_Commands,
    commands=[getattr(commands, name) for name in COMMANDS],
    context_settings={
        "help_option_names": ["-h", "--help"],
        "max_content_width": _WIDEST_HELP,
    },
)
@click.version_option(package_name="epcontact")
def cli() -> None:
    """Compare J2 finite elements and boundary elements of one rough contact."""


def main() -> None:
    """Run the command of `sys.argv` and exit with its code.

    The code is 0 if the command did its work, 1 if a gate fell short, 2 after an error,
    which is a sentence on stderr, and 130 after an interrupt.
    """
    signal.signal(signal.SIGTERM, _interrupt)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)  # unless a job ignores Ctrl-C
    _prepare_streams()
    sys.exit(_run(sys.stdout))


def _prepare_streams() -> None:
    """Replace closed standard streams by the null device.

    All streams also write ASCII forms of characters that their encoding lacks.
    """
    for name in ("stdin", "stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            # No other file may get the number of a closed stream, nor in a child.
            null = os.open(os.devnull, os.O_RDWR)
            os.set_inheritable(null, True)
            setattr(sys, name, os.fdopen(null, "w"))
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=ASCII_FORMS)


def _run(output: TextIO) -> int:
    """Run the command and return the exit code; print errors as sentences.

    `output` is standard output, which click replaces if its reader is gone.
    """
    try:
        code = cli.main(prog_name="epcontact", standalone_mode=False)
        return code if isinstance(code, int) else 0
    except (click.Abort, KeyboardInterrupt):
        _print_sentences("interrupted; results finished so far are kept")
        return 130
    except InvalidCase as error:
        _print_sentences(*error.args)
    except EpcontactError as error:
        _print_sentences(error)
    except click.exceptions.NoArgsIsHelpError as error:
        print_error(error.format_message())
    except click.ClickException as error:
        _print_sentences(_usage_sentence(error))
    except (SystemExit, BrokenPipeError) as end:
        # click and rich turn a closed pipe into exit code 1, which means that a gate
        # fell short.
        is_pipe = BrokenPipeError in (type(end), type(end.__context__))
        if not is_pipe and sys.stdout is output:
            raise
        sys.stdout = output
        discard_output()
    except Exception as error:
        _print_sentences(_unexpected(error))
    return 2


def _print_sentences(*sentences: object) -> None:
    """Print sentences on stderr, each on a line that begins with the program's name."""
    for sentence in sentences:
        print_error(f"epcontact: {printable(str(sentence))}")


def _usage_sentence(error: click.ClickException) -> str:
    """Return the sentence for a mistake on the command line, without a full stop.

    It refers to the help of the command whose arguments are wrong.
    """
    command = "epcontact"
    if isinstance(error, click.UsageError) and error.ctx:
        command = error.ctx.command_path
    return f"{error.format_message().rstrip('.')} (see {command} --help)"


def _unexpected(error: Exception) -> str:
    """Return the sentence for an error that no command has handled.

    It is about a full disk, a bad file name, a current folder that was removed or, for
    all other errors, a bug in epcontact, whose traceback is printed on stderr.
    """
    number = getattr(error, "errno", None)
    if number == errno.ENOSPC:  # of standard output; files raise OutputError
        discard_output()
        return "cannot write the output: no space left on device"
    if isinstance(error, OSError) and number in (errno.ENAMETOOLONG, errno.EACCES):
        return f"cannot open {error.filename}: {os.strerror(number).lower()}"
    if isinstance(error, FileNotFoundError) and not _has_current_folder():
        return "the current folder was removed; change to another one"
    print_error(traceback.format_exc())
    return "this is a bug in epcontact; please report it"


def _has_current_folder() -> bool:
    """Return whether the current folder exists; another process may have removed it."""
    try:
        os.getcwd()
    except FileNotFoundError:
        return False
    return True


def print_text(text: object) -> None:
    """Print a text of one or more lines on standard output.

    Control characters in it are shown as escapes, because parts of the text, such as
    names of files, may come from elsewhere.
    """
    # Without a file, click would write UTF-8 to a stream whose encoding is ASCII.
    click.echo(without_controls(str(text)), file=sys.stdout)


def print_error(sentence: str) -> None:
    """Print a sentence on stderr; do nothing if stderr is closed.

    Control characters in it are shown as escapes.
    """
    try:
        click.echo(without_controls(sentence), file=sys.stderr)
    except OSError:
        discard_output(sys.stderr)


def discard_output(stream: TextIO | None = None) -> None:
    """Discard further output to a stream, by default standard output.

    A stream that is full, or a closed pipe, would raise again when the process ends.
    """
    with contextlib.suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), (stream or sys.stdout).fileno())


def _interrupt(number: int, _: object) -> None:
    """Raise KeyboardInterrupt, except in the middle of a compilation.

    During a compilation (see `machine`) the signal is raised again 0.05 s later.

    Args:
        number: Number of the signal, SIGINT or SIGTERM.
        _: The stack frame, which is not used.
    """
    # The module is loaded with the first solver, and may be half loaded now.
    compiling = getattr(sys.modules.get("epcontact.machine"), "compiling", None)
    if compiling is None or not compiling():
        raise KeyboardInterrupt
    threading.Timer(0.05, signal.raise_signal, (number,)).start()
