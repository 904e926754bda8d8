"""Processes that are copies of one, which has loaded what all of them need.

To start Python and to import a solver takes longer than many a solve.  A `Template` does it once,
with the compiled kernels, and is forked for each process.  It has no threads, because what another
thread holds at the moment of a fork would be held for ever in the copy.  `multiprocessing` has such
a server, too, but it runs the caller's main script again in every process.
"""

from __future__ import annotations

import contextlib
import gc
import json
import logging
import os
import pickle
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import IO, Any

from epcontact.harness.processes.child import ChildDied, kill_tree, serve
from epcontact.harness.processes.threads import LINEAR_ALGEBRA, TRANSFORMS, single_threads

#: Windows cannot fork, and libraries of macOS start threads of their own.
POSSIBLE = sys.platform == "linux"

_PROGRAM = (
    "import json, sys; channel, sys.path[:] = json.loads(sys.argv.pop()); "
    "from epcontact.harness.processes.template import serve_copies; serve_copies(channel)"
)
_REQUEST = struct.Struct("q")  # the copy whose end is asked for; with two files: make a copy
_REPLY = struct.Struct("qq")  # the copy and its exit code; 0: there is none, or it has not ended
_MOMENT = 0.01  # seconds


class Template:
    """A process that loads modules, and of which copies are made."""

    def __init__(self, load: Callable[..., object], *arguments: Any) -> None:
        self._asking, self._gone = threading.Lock(), False
        self._channel, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _PROGRAM, json.dumps((theirs.fileno(), sys.path))],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        assert self._process.stdin is not None
        with contextlib.suppress(OSError), self._process.stdin as order:
            pickle.dump(pickle.dumps((load, arguments)), order)

    def copy(self) -> Copy | None:
        """Return a copy; None if it cannot be made, so that a process must start otherwise."""
        (requests, stdin), (stdout, answers) = os.pipe(), os.pipe()
        pid, _ = self._reply(0, requests, answers)
        os.close(requests)
        os.close(answers)
        if pid:
            return Copy(self, pid, os.fdopen(stdin, "wb"), os.fdopen(stdout, "rb"))
        os.close(stdin)
        os.close(stdout)
        if self._gone:
            raise ChildDied("was ended")
        logging.getLogger("epcontact").debug(
            "a process loads everything itself, as its template has several threads"
        )
        return None

    def exit_code(self, pid: int) -> int | None:
        """Return the exit code of a copy, or None while it runs."""
        ended, code = self._reply(pid)
        return code if ended else None

    def end(self) -> None:
        """End the process and its copies at once."""
        self._gone = True
        kill_tree(self._process.pid)
        self._process.wait()
        with self._asking:
            self._channel.close()

    def _reply(self, number: int, *files: int) -> tuple[int, int]:
        """Return the reply to a request; where the template has gone, its copies have, too."""
        with self._asking, contextlib.suppress(OSError):
            socket.send_fds(self._channel, [_REQUEST.pack(number)], files)
            if reply := self._channel.recv(_REPLY.size):
                found, code = _REPLY.unpack(reply)
                return found, code
        return number, -9


class Copy:
    """A forked process, with as much of `subprocess.Popen` as a `Child` needs."""

    def __init__(self, template: Template, pid: int, stdin: IO[bytes], stdout: IO[bytes]) -> None:
        self.pid, self.stdin, self.stdout = pid, stdin, stdout
        self._template = template
        self._code: int | None = None

    def poll(self) -> int | None:
        """Return the exit code, or None while it runs."""
        if self._code is None:
            self._code = self._template.exit_code(self.pid)
        return self._code

    def wait(self, timeout: float | None = None) -> int:
        """Return the exit code.  Raises TimeoutExpired."""
        started = time.monotonic()
        while (code := self.poll()) is None:
            if timeout is not None and time.monotonic() - started > timeout:
                raise subprocess.TimeoutExpired("a copy", timeout)
            time.sleep(_MOMENT)
        return code


# --- in the template ------------------------------------------------------------------------------


def serve_copies(descriptor: int) -> None:
    """Load what standard input names, and make copies until the other end of the socket closes."""
    channel = socket.socket(fileno=descriptor)
    try:
        order = pickle.load(sys.stdin.buffer)
    except EOFError:  # the other end was interrupted before it could ask
        return
    with contextlib.suppress(Exception), single_threads(LINEAR_ALGEBRA, TRANSFORMS):
        load, arguments = pickle.loads(order)
        load(*arguments)
    gc.freeze()  # the collector would write to the pages that copies share
    while True:
        request, files = b"", list[int]()
        with contextlib.suppress(ConnectionResetError):  # the other end was killed
            request, files, _, _ = socket.recv_fds(channel, _REQUEST.size, 2)
        if not request:
            return
        if not files:
            reply = _ended(*_REQUEST.unpack(request))
        elif len(os.listdir("/proc/self/task")) > 1:  # `load` has started threads
            reply = 0, 0
        elif pid := os.fork():
            reply = pid, 0
        else:
            channel.close()
            _serve(*files)
            return
        for file in files:
            os.close(file)
        with contextlib.suppress(BrokenPipeError):  # then the next request is empty
            channel.sendall(_REPLY.pack(*reply))


def _serve(requests: int, answers: int) -> None:
    """Be the process of a `Child`, with these files as standard input and output."""
    os.setsid()
    os.dup2(requests, 0)
    os.dup2(answers, 1)
    os.close(requests)
    os.close(answers)
    serve(os.getppid())


def _ended(pid: int) -> tuple[int, int]:
    ended, status = os.waitpid(pid, os.WNOHANG)
    return ended, os.waitstatus_to_exitcode(status)
