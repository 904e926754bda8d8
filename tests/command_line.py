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

from epcontact.cli.main import main

Done = subprocess.CompletedProcess[str]


def invoke(*arguments):
    """Run the command line here, where warnings are errors and an exception ends the
    test.
    """
    out, err, command = (
        io.StringIO(),
        io.StringIO(),
        ["epcontact", *map(str, arguments)],
    )
    with contextlib.ExitStack() as after, mock.patch("sys.argv", command):
        for number in (signal.SIGTERM, signal.SIGINT):
            after.callback(signal.signal, number, signal.getsignal(number))
        after.enter_context(contextlib.redirect_stdout(out))
        after.enter_context(contextlib.redirect_stderr(err))
        end = after.enter_context(pytest.raises(SystemExit))
        main()
    return Done(command, int(end.value.code or 0), out.getvalue(), err.getvalue())


def python(*arguments, **options):
    """Run Python in a process of its own, which takes a second to load the package."""
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(
        command, check=False, capture_output=True, text=True, timeout=300, **options
    )
