"""The command line for tests: in this process, or in one of its own as a user has
it.
"""

import contextlib
import io
import signal
import subprocess
import sys
from unittest import mock

import pytest

from epcontact.cli import progress
from epcontact.cli.main import main

Done = subprocess.CompletedProcess[str]


def invoke(*arguments):
    """Run the command line in this process and return its exit code and texts.

    The `arguments` are the words after `epcontact`; paths and numbers are converted to
    text. The result is a `subprocess.CompletedProcess` with `returncode`, `stdout` and
    `stderr`. Warnings are errors, and any exception but SystemExit is raised. The
    handlers of SIGTERM and SIGINT are restored afterwards. Lines of progress, which
    depend on the speed of the machine, are not printed, but for the last one.
    """
    out = io.StringIO()
    err = io.StringIO()
    command = ["epcontact", *map(str, arguments)]
    with contextlib.ExitStack() as after, mock.patch("sys.argv", command):
        for number in (signal.SIGTERM, signal.SIGINT):
            after.callback(signal.signal, number, signal.getsignal(number))
        after.enter_context(mock.patch.object(progress, "_FIRST_LINE", 1e6))
        after.enter_context(contextlib.redirect_stdout(out))
        after.enter_context(contextlib.redirect_stderr(err))
        end = after.enter_context(pytest.raises(SystemExit))
        main()
    return Done(command, int(end.value.code or 0), out.getvalue(), err.getvalue())


def python(*arguments, **options):
    """Run Python with arguments in a new process, and return the `CompletedProcess`
    with its texts.

    It takes a second to load the package, and raises `subprocess.TimeoutExpired` after
    300 s. `options` are those of `subprocess.run`, such as cwd or env.
    """
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(
        command, check=False, capture_output=True, text=True, timeout=300, **options
    )
