"""Processes that call functions for this one, and calls spread over them or any other
executor.

A `Child` makes one call after the other, so that many pay for one start.  It can be
ended at any moment, a death costs its own call and no other, and it ends with its
parent.  Those of a pool are forked from a server that has loaded the solvers, see
`preload`.
"""

from __future__ import annotations

import atexit
import contextlib
import math
import multiprocessing
import os
import pickle
import pkgutil
import signal
import sys
import threading
import time
import types
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, TypeVar, cast

import psutil

from epcontact.errors import EpcontactError, InvalidCase, printable, sentence_of
from epcontact.machine import alive, available_memory

Item = TypeVar("Item")
Result = TypeVar("Result")

#: A function that makes an executor, or its name, `module:function`.
Factory = str | Callable[[], Executor]

_PATIENCE = 5.0  # seconds for a process to end by itself
_LONGEST = (
    1e6  # seconds; the system cannot wait for many more, and a longer limit is none
)
_STARTING = threading.RLock()


class ChildDied(EpcontactError):
    """A process that ended or was ended before it answered; the message says how."""


class Child:
    """A process that calls functions of modules that it can import.  It starts at the first call,
    and again at the first call after its end.  plain: its functions return bytes, and nothing that
    it sends is unpickled here, which could run any code.
    """

    def __init__(self, method: str = "spawn", plain: bool = False) -> None:
        self._context: Any = multiprocessing.get_context(method)
        self._process, self._pipe = cast(Any, None), cast(Any, None)
        self._calling, self._ended, self._plain = threading.Lock(), False, plain

    def call(
        self, function: Callable[..., Result], *arguments: Any, limit: float = math.inf
    ) -> Result:
        """Return function(*arguments), called in the process."""
        request = pickle.dumps((function, arguments, self._plain))
        with self._calling:
            pipe = self._started()
            try:
                pipe.send(sys.path)
                pipe.send_bytes(request)
                if not pipe.poll(limit if limit < _LONGEST else None):
                    raise ChildDied(
                        f"was not finished within {limit:g} s and was ended"
                    )
                done, answer = (
                    pipe.recv_bytes(1),
                    pipe.recv_bytes(available_memory() // 2),
                )
            except (EOFError, OSError):
                raise ChildDied(
                    f"{death_of(self._bury(_PATIENCE))} and gave no answer"
                ) from None
            except BaseException:
                self._bury()
                raise
        if done != b"1":
            raise ChildDied(answer.decode(errors="replace"))
        return cast(Result, answer if self._plain else pickle.loads(answer))

    def end(self) -> None:
        """End the process for good, at once."""
        self._ended = True
        atexit.unregister(self.end)
        self._bury()

    def _started(self) -> Any:
        """Return the pipe of the process, and start it if need be."""
        with _STARTING:
            if self._ended:
                raise ChildDied("was ended")
            if self._process is None or not self._process.is_alive():
                self._bury()
                self._pipe, theirs = self._context.Pipe()
                process = self._context.Process(
                    target=_serve, args=(theirs,), daemon=True
                )
                # The workers of Dask are daemons, which may have no processes
                # otherwise.
                multiprocessing.current_process().daemon = False
                atexit.register(self.end)
                with _apart():
                    process.start()
                    self._process = process
                theirs.close()
            return self._pipe

    def _bury(self, patience: float = 0.0) -> int | None:
        """End the process, if there is one; return its exit code if it ends by
        itself.
        """
        with _STARTING:
            process, self._process, code = self._process, None, None
            if process is not None:
                process.join(patience)
                code = process.exitcode
                kill_tree(process.pid)
                process.join()
            return code


def preload(methods: Sequence[str]) -> str:
    """Start the server of a pool, which loads methods; return how processes are to
    start.  Windows cannot fork, and libraries of macOS start threads of their own.
    """
    if sys.platform != "linux":
        return "spawn"
    os.environ["EPCONTACT_PRELOAD"] = " ".join(methods)
    try:
        with _apart():
            forkserver.set_forkserver_preload(["epcontact.harness.preload"])
            forkserver.ensure_running()
    except OSError:  # the path of its socket is too long, for example
        return "spawn"
    finally:
        del os.environ["EPCONTACT_PRELOAD"]
    return "forkserver"


@contextlib.contextmanager
def _apart() -> Iterator[None]:
    """Keep what starts in the block from the caller's script, and Ctrl-C from it for
    ever.
    """
    masks = hasattr(signal, "pthread_sigmask")
    if masks:
        resource_tracker.ensure_running()  # whose start would let interrupts through
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    main, sys.modules["__main__"] = (
        sys.modules["__main__"],
        types.ModuleType("__main__"),
    )
    try:
        yield
    finally:
        sys.modules["__main__"] = main
        if masks:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def death_of(code: int | None) -> str:
    """Return how a process ended, from its exit code; -n means the signal n, None by
    force.
    """
    if code is None or code >= 0:
        return "was ended" if code is None else f"ended with exit code {code}"
    name = {each.value: each.name for each in signal.Signals}.get(
        -code, f"signal {-code}"
    )
    causes = {
        "SIGKILL": " (most likely for want of memory)",
        "SIGSEGV": " (invalid memory access)",
    }
    return f"was killed by {name}{causes.get(name, '')}"


def kill_tree(pid: int) -> None:
    """Kill a process and all that it started, also in sessions of their own, and see
    them end.
    """
    with contextlib.suppress(psutil.NoSuchProcess):
        process = psutil.Process(pid)
        all_of_them = (*process.children(recursive=True), process)
        for each in all_of_them:
            with contextlib.suppress(psutil.NoSuchProcess):
                each.kill()
        patience = time.monotonic() + _PATIENCE
        while (
            any(alive(each.pid) for each in all_of_them) and time.monotonic() < patience
        ):
            time.sleep(0.001)


def _serve(pipe: Connection) -> None:
    """In the process: answer the requests of the parent until it closes the pipe or
    ends.
    """
    if hasattr(os, "setsid"):
        os.setsid()  # signals to the parent's group are not meant for this process
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.dup2(2, 1)  # standard output is the parent's
    multiprocessing.current_process().daemon = (
        False  # a solver may have processes of its own
    )
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with contextlib.suppress(EOFError, OSError):
        while True:
            sys.path[:] = pipe.recv()
            for part in _answer(pipe.recv_bytes()):
                pipe.send_bytes(part)


def _answer(request: bytes) -> tuple[bytes, bytes]:
    try:
        function, arguments, plain = pickle.loads(request)
        found = function(*arguments)
        return b"1", found if plain else pickle.dumps(found)
    except BaseException as error:
        return b"0", printable(f"raised {type(error).__name__}: {error}").encode()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    kill_tree(os.getpid())


class Processes(ThreadPoolExecutor):
    """Processes of this machine as an executor: each thread waits for the calls of a
    `Child`.
    """

    def __init__(self, jobs: int, methods: Sequence[str] = ()) -> None:
        super().__init__(jobs)
        start = preload(methods)
        self._children = [Child(start) for _ in range(jobs)]
        self._idle = list(self._children)

    def submit(
        self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any
    ) -> Future[Any]:
        """Have a process call `fn`, a function at module level."""
        return super().submit(self._call, fn, *args, **kwargs)

    def _call(self, function: Callable[..., Result], *arguments: Any) -> Result:
        child = self._idle.pop()
        try:
            return child.call(function, *arguments)
        finally:
            self._idle.append(child)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes: at once, or (wait=True) after what they are doing."""
        super().shutdown(wait, cancel_futures=cancel_futures)
        for child in self._children:
            child.end()
        super().shutdown()


def made(factory: Factory) -> Executor:
    """Return the executor that a factory makes.  Raises InvalidCase."""
    name = (
        factory
        if isinstance(factory, str)
        else getattr(factory, "__name__", repr(factory))
    )
    try:
        executor = (
            pkgutil.resolve_name(factory) if isinstance(factory, str) else factory
        )()
    except EpcontactError:
        raise
    except (Exception, SystemExit) as error:
        raise InvalidCase(
            f"executor {name} cannot be made ({sentence_of(error)}); give module:function, which "
            "is called without arguments"
        ) from None
    if not isinstance(executor, Executor):
        raise InvalidCase(
            f"executor {name} is {executor!r:.60}, not a concurrent.futures.Executor"
        )
    return executor


def spread(
    function: Callable[[Item], Result], items: Sequence[Item], executor: Executor
) -> Iterator[tuple[Item, Result | str]]:
    """Yield (item, function(item)) as the calls finish, then shut the executor down.
    The sentence that says why a call failed stands in the place of its result.
    """
    futures: dict[Future[Result], Item] = {}
    done, waiting = SimpleQueue[Future[Result]](), deque(items)
    try:
        while waiting or futures:
            if waiting and done.empty():  # an executor may make a call when it takes it
                try:
                    future = executor.submit(function, waiting[0])
                except Exception as error:
                    reason = sentence_of(error)
                    raise EpcontactError(
                        f"the executor takes no task: {reason}"
                    ) from None
                futures[future] = waiting.popleft()
                future.add_done_callback(done.put)
                continue
            ended = done.get()
            result = _result(ended)
            yield futures.pop(ended), result
    finally:
        for future in futures:
            future.cancel()
        try:
            executor.shutdown(wait=not futures and not waiting)
        except Exception as error:
            raise EpcontactError(
                f"the executor does not end: {sentence_of(error)}"
            ) from None


def _result(future: Future[Result]) -> Result | str:
    try:
        return future.result()
    except ChildDied as error:
        return f"its process {error}"
    except Exception as error:
        return f"its worker failed: {sentence_of(error)}"
