"""The command line for tests: in this process, or in one of its own as a user has it."""

from __future__ import annotations

import contextlib
import io
import signal
import subprocess
import sys

from epcontact.cli.main import main

Done = subprocess.CompletedProcess[str]


def invoke(*arguments: object) -> Done:
    """Run the command line in this process, where the package is loaded and warnings are errors.

    An exception that escapes is an error of the test.
    """
    out, err = io.StringIO(), io.StringIO()
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    argv, sys.argv = sys.argv, ["epcontact", *map(str, arguments)]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            main()
        code: object = 0
    except SystemExit as stop:
        code = stop.code or 0
    finally:
        sys.argv = argv
        for number, handler in handlers.items():
            signal.signal(number, handler)
    assert isinstance(code, int), code
    return subprocess.CompletedProcess(
        list(map(str, arguments)), code, out.getvalue(), err.getvalue()
    )


def start(*arguments: object, **options: object) -> Done:
    """Run the command line as a user does; the new process takes a second to load the package."""
    return python("-m", "epcontact", *arguments, **options)


def python(*arguments: object, **options: object) -> Done:
    """Run Python in a process of its own."""
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(
        command, check=False, capture_output=True, text=True, timeout=300, **options
    )
