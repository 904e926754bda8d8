"""Three-dimensional pictures are drawn in a process of their own.

Without a display, VTK's wheels fall back from X to EGL to a software renderer, with warnings at
each step, and where a library is missing the process may simply die.  So nothing is ever drawn
in the caller's process: a worker draws, its output stays off the terminal, and its death is one
sentence to the caller.  Whether drawing works at all is tried once, on a small picture.
"""

from __future__ import annotations

import functools
import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from epcontact.errors import OutputError

#: Seconds until a worker that draws a small picture is taken to hang.
PROBE_PATIENCE = 120.0
#: Before its error sentence, on the worker's standard output.
MARK = "epcontact: "

_WINDOW = "VTK_DEFAULT_OPENGL_WINDOW"
#: What is tried in turn: VTK's own choice, then its two renderers without a display.
_WINDOWS = ("", "vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")


def can_render() -> tuple[bool, str]:
    """Whether pictures can be drawn on this machine, and if not, a sentence why.

    The first call draws a small picture in another process, which takes a second or two; further
    calls remember its answer.
    """
    window, reason = _probed(os.environ.get("DISPLAY", ""), os.environ.get(_WINDOW, ""))
    return window is not None, reason


def draw(task: Mapping[str, Any], *, off_screen: bool = True) -> None:
    """Have a worker draw `task`, a JSON-able mapping that names a function of the scenes module
    as "scene" and its arguments.

    Raises OutputError if drawing does not work here or the worker fails.
    """
    window = ""
    if off_screen:
        found, reason = _probed(os.environ.get("DISPLAY", ""), os.environ.get(_WINDOW, ""))
        if found is None:
            raise OutputError(reason)
        window = found
    failure = _work(task, window, None)
    if failure:
        raise OutputError(failure)


@functools.cache
def _probed(display: str, chosen: str) -> tuple[str | None, str]:
    """The window class that works ("" for VTK's own choice), or None and why there is none."""
    del display  # a key of the cache only: another display may be another answer
    windows = (chosen,) if chosen or not sys.platform.startswith("linux") else _WINDOWS
    failures = [_work({"scene": "probe"}, windows[0], PROBE_PATIENCE)]
    for window in windows[1:]:
        if not failures[-1]:
            break
        failures.append(_work({"scene": "probe"}, window, PROBE_PATIENCE))
    if not failures[-1]:
        return windows[len(failures) - 1], ""
    return None, f"pictures cannot be drawn on this machine: {failures[0]}"


def _work(task: Mapping[str, Any], window: str, patience: float | None) -> str:
    """Run a worker; the empty string if it did its work, else a sentence why not."""
    environment = dict(os.environ)
    if window:
        environment[_WINDOW] = window
    # The worker imports this very package, and nothing from the folder it happens to run in.
    home = str(Path(__file__).parents[3])
    known = environment.get("PYTHONPATH", "")
    environment["PYTHONPATH"] = os.pathsep.join([home, known] if known else [home])
    command = [sys.executable, "-P", "-W", "ignore", "-m", "epcontact.output.view.worker"]
    try:
        done = subprocess.run(
            command,
            input=json.dumps(task),
            capture_output=True,
            text=True,
            errors="replace",
            env=environment,
            timeout=patience,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"VTK did not draw anything within {patience:g} s"
    except OSError as error:
        return f"no process could be started to draw in: {error.strerror}"
    if done.returncode == 0:
        return ""
    told = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    if told:
        return told[-1].removeprefix(MARK)
    if done.returncode < 0:
        return f"VTK crashed ({_signal_name(-done.returncode)}) while drawing"
    last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
    return f"the drawing process failed: {last}"


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
