"""Python processes that call functions for this one, and that can be ended at any moment.

A `Child` calls one function after the other, so that many calls pay for one start and one import.
It has a session of its own, which Ctrl-C does not reach, and it ends with its parent.

The pools of libraries were tried, but none ends a call at its time limit, survives the death of a
process, leaves the caller's script alone and ends with its parent.  `concurrent.futures` loses
every call if one process dies, and has no time limit; pebble 5.2 waits for the whole time limit of
a process that has ended with exit code 0, and it and `multiprocessing` run the caller's main script
again in every process; the pool of loky 3.7 and joblib has no time limit and outlives its parent.
"""

from __future__ import annotations

import atexit
import contextlib
import io
import json
import math
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import IO, Any, NoReturn, Protocol, TypeVar

import psutil

from epcontact.errors import EpcontactError, printable
from epcontact.machine import alive

Result = TypeVar("Result")

_PROGRAM = (
    "import json, sys; parent, sys.path[:] = json.loads(sys.argv.pop()); "
    "from epcontact.harness.processes.child import serve; serve(parent)"
)
_PATIENCE = 5.0  # seconds for a process to end by itself


class ChildDied(EpcontactError):
    """A process that ended or was ended before it answered; the message says how."""


class Process(Protocol):
    """What a `Child` needs of a `subprocess.Popen`, or of another process."""

    @property
    def pid(self) -> int:
        """The number of the process."""

    @property
    def stdin(self) -> IO[bytes] | None:
        """The file that its standard input reads."""

    @property
    def stdout(self) -> IO[bytes] | None:
        """The file that its standard output writes."""

    def poll(self) -> int | None:
        """Return the exit code, or None while it runs."""

    def wait(self, timeout: float | None = None) -> int:
        """Return the exit code at the end.  Raises subprocess.TimeoutExpired."""


class Child:
    """A process that calls functions of modules that it can import.

    It starts at the first call, and again at the first call after its end.  It ends with this
    process, if nobody ends it before.
    """

    def __init__(self, copied: Callable[[], Process | None] = lambda: None) -> None:
        self._process: Process | None = None
        self._copied = copied
        self._calling, self._starting = threading.Lock(), threading.Lock()
        self._ended = False

    def call(
        self, function: Callable[..., Result], *arguments: Any, limit: float = math.inf
    ) -> Result:
        """Return function(*arguments), called in the process."""
        request = pickle.dumps((function, arguments))
        answers: SimpleQueue[bytes] = SimpleQueue()
        with self._calling:
            process = self._started()
            exchange = threading.Thread(
                target=lambda: answers.put(_exchange(process, request)), daemon=True
            )
            exchange.start()
            try:
                answer = answers.get(timeout=None if limit > threading.TIMEOUT_MAX else limit)
            except Empty:
                self._kill()
                raise ChildDied(f"was not finished within {limit:g} s and was ended") from None
            except BaseException:
                self._kill()
                raise
            if not answer:
                self._bury(process)
        done, value = pickle.loads(answer)
        if not done:
            raise ChildDied(value)
        result: Result = value
        return result

    def end(self, *, now: bool = True) -> None:
        """End the process for good, at once or (now=False) after what it is doing."""
        with self._starting:
            self._ended = True
        atexit.unregister(self.end)
        if self._process is not None and not now:
            assert self._process.stdin is not None
            with contextlib.suppress(OSError, subprocess.TimeoutExpired):
                self._process.stdin.close()
                self._process.wait(timeout=_PATIENCE)
        self._kill()

    def _started(self) -> Process:
        with self._starting:
            if self._ended:
                raise ChildDied("was ended")
            if self._process is None or self._process.poll() is not None:
                self._kill()
                atexit.register(self.end)
                self._process = self._copied() or subprocess.Popen(
                    [sys.executable, "-c", _PROGRAM, json.dumps((os.getpid(), sys.path))],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    start_new_session=True,
                )
            return self._process

    def _kill(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            kill_tree(process.pid)
            process.wait()
            for pipe in (process.stdin, process.stdout):
                with contextlib.suppress(OSError, AttributeError):
                    pipe.close()  # type: ignore[union-attr]

    def _bury(self, process: Process) -> NoReturn:
        """Raise ChildDied with the way in which a process ended that gave no answer."""
        try:
            code = process.wait(timeout=_PATIENCE)
        except subprocess.TimeoutExpired:
            code = None
        self._kill()
        if code is None:
            raise ChildDied("closed all its files without an answer")
        raise ChildDied(f"{death_of(code)} and gave no answer")


def death_of(code: int) -> str:
    """Return how a process ended, from its exit code; -n means the signal n."""
    if code >= 0:
        return f"ended with exit code {code}"
    causes = {"SIGKILL": " (most likely for want of memory)", "SIGSEGV": " (invalid memory access)"}
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    return f"was killed by {name}{causes.get(name, '')}"


def _exchange(process: Process, request: bytes) -> bytes:
    """Send a request and return the answer; empty if the process ends before it."""
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        pickle.dump((sys.path, request), process.stdin)
        process.stdin.flush()
        answer: bytes = pickle.load(process.stdout)
    except (OSError, EOFError, ValueError, pickle.UnpicklingError):
        return b""
    return answer


def kill_tree(pid: int) -> None:
    """Kill a process and all that it started, also in sessions of their own, and see them end."""
    with contextlib.suppress(psutil.NoSuchProcess):
        process = psutil.Process(pid)
        all_of_them = (*process.children(recursive=True), process)
        for each in all_of_them:
            with contextlib.suppress(psutil.NoSuchProcess):
                each.kill()
        patience = time.monotonic() + _PATIENCE
        while any(alive(each.pid) for each in all_of_them) and time.monotonic() < patience:
            time.sleep(0.001)


def serve(parent: int) -> None:
    """Answer the requests of the process `parent` on standard input until it is closed.

    What the functions print goes to standard error, because standard output is the parent's.
    """
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    threading.Thread(target=_end_with_parent, args=(parent,), daemon=True).start()
    while True:
        try:
            path, request = pickle.load(requests)
        except EOFError:
            return
        sys.path[:] = path
        answer = _answer(request)
        try:
            pickle.dump(answer, answers)
            answers.flush()
        except BrokenPipeError:  # the parent was killed
            return


def _answer(request: bytes) -> bytes:
    try:
        function, arguments = pickle.loads(request)
        buffer = io.BytesIO()
        pickle.dump((True, function(*arguments)), buffer)
        return buffer.getvalue()
    except BaseException as error:
        return pickle.dumps((False, printable(f"raised {type(error).__name__}: {error}")))


def _end_with_parent(parent: int) -> None:
    """End this process and its children when its parent has gone."""
    while os.getppid() == parent:
        time.sleep(0.3)
    kill_tree(os.getpid())
