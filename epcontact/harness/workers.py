"""Processes that call functions for this one, and calls spread over an executor.

A `Worker` makes one call after the other, so that many calls pay for one start.  It can
be ended at any moment, its death costs its own call and no other, and it ends with its
parent, whatever kills that.
"""

from __future__ import annotations

import atexit
import contextlib
import math
import multiprocessing
import os
import pickle
import pkgutil
import shutil
import signal
import sys
import tempfile
import threading
import time
import types
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, TypeVar

import psutil

from epcontact.errors import EpcontactError, InvalidCase, printable, sentence_of
from epcontact.machine import alive, describe_death

Item = TypeVar("Item")
Result = TypeVar("Result")

#: Seconds within which a process that has closed its pipe ends by itself.
_PATIENCE = 5.0
#: Seconds beyond which a limit is no limit: the system cannot wait for many more.
_LONGEST = 1e6
#: Processes are started one at a time, as `_isolated_start` changes the interpreter.
_STARTING = threading.RLock()


class WorkerDied(EpcontactError):
    """A process returned no result: it ended, was ended, or its function raised.

    The message completes a sentence that begins with "its process".
    """


class Worker:
    """A process that calls functions of modules which it can import.

    It starts at the first call, and again at the first call after its end.
    """

    def __init__(self) -> None:
        """Create a worker without a process, which the first call starts."""
        self._process: Any = None
        self._pipe: Any = None
        self._folder = ""
        self._calling = threading.Lock()

    def call(
        self, function: Callable[..., Result], *arguments: Any, limit: float = math.inf
    ) -> Result:
        """Return function(*arguments), called in the process.

        Args:
            function: a function at module level.
            arguments: are pickled, as is the result.
            limit: seconds after which the process is ended.

        Raises:
            WorkerDied: if the function raises, if the process ends, or after the limit.
        """
        with self._calling:
            if self._process is None or not self._process.is_alive():
                self._start()
            try:
                self._pipe.send(sys.path)
                self._pipe.send((function, arguments))
                seconds: float | None = limit
                if limit >= _LONGEST:
                    seconds = None  # the pipe waits without a limit
                if not self._pipe.poll(seconds):
                    raise WorkerDied(
                        f"was not finished within {limit:g} s and was ended"
                    )
                returned, answer = self._pipe.recv()
            except (EOFError, OSError):
                death = describe_death(self._stop(_PATIENCE))
                raise WorkerDied(f"{death} and gave no answer") from None
            except BaseException:  # also an interrupt of this process
                self._stop()
                raise
        if not returned:
            raise WorkerDied(answer)
        result: Result = answer
        return result

    def end(self) -> None:
        """End the process at once, with all that it has started."""
        atexit.unregister(self.end)
        self._stop()

    def _start(self) -> None:
        """Start the process of this worker, after the end of an earlier one."""
        self._stop()
        context = multiprocessing.get_context("spawn")
        self._pipe, other_end = context.Pipe()
        self._folder = tempfile.mkdtemp(prefix="epcontact-")
        process = context.Process(
            target=_serve, args=(other_end, self._folder), daemon=True
        )
        # The workers of Dask are daemons, which could not start processes otherwise.
        multiprocessing.current_process().daemon = False
        atexit.register(self.end)
        with _isolated_start():
            process.start()
        self._process = process
        other_end.close()

    def _stop(self, patience: float = 0.0) -> int | None:
        """End the process of this worker, with all processes that it has started.

        Returns its exit code if it ends by itself within `patience` seconds; None if it
        has to be killed, or if there is no process.
        """
        process, self._process = self._process, None
        if process is None:
            return None
        process.join(patience)
        code: int | None = process.exitcode
        kill_tree(process.pid)
        process.join()
        # A process that is killed leaves its temporary folders behind.
        shutil.rmtree(self._folder, ignore_errors=True)
        return code


@contextlib.contextmanager
def _isolated_start() -> Iterator[None]:
    """Isolate processes that start in the `with` block from this one's script and
    interrupts.

    Without this, a new process would run the script of the caller again, if that has no
    `if __name__ == "__main__"`.  It would also receive Ctrl-C, which the terminal sends
    to all processes; this process ends the others itself.
    """
    can_block = hasattr(signal, "pthread_sigmask")
    with _STARTING:
        if can_block:
            resource_tracker.ensure_running()  # its start would unblock interrupts
            mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        script = sys.modules["__main__"]
        sys.modules["__main__"] = types.ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = script
            if can_block:
                signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def kill_tree(pid: int) -> None:
    """Kill a process and all processes that it has started, also in other sessions.

    Waits until they have ended, for 5 s at most.  `pid` is the id of the process; if it
    has ended already, nothing happens.
    """
    with contextlib.suppress(psutil.NoSuchProcess):
        process = psutil.Process(pid)
        processes = [*process.children(recursive=True), process]
        for child_or_self in processes:
            with contextlib.suppress(psutil.NoSuchProcess):
                child_or_self.kill()
        pids = [killed.pid for killed in processes]
        end = time.monotonic() + _PATIENCE
        while any(map(alive, pids)) and time.monotonic() < end:
            time.sleep(0.001)


# --- in the process of a worker


def _serve(pipe: Connection, folder: str) -> None:
    """Run in a worker's process: answer the calls of the parent process.

    Each call is two messages in the pipe: the parent's `sys.path`, then the pickled
    function with its arguments.  It returns when the parent closes the pipe, and the
    process is killed when the parent ends.

    Args:
        pipe: of the calls and their results.
        folder: for the temporary files of this process and of those that it starts.
            This process deletes it at its end, or the parent if this one is killed.
    """
    tempfile.tempdir = folder
    os.environ["TMPDIR"] = folder
    if hasattr(os, "setsid"):
        os.setsid()  # signals to the group of the parent are not for this process
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.dup2(2, 1)  # standard output is that of the parent
    # A solver may start processes of its own.
    multiprocessing.current_process().daemon = False
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with contextlib.suppress(EOFError, OSError):
        while True:
            sys.path[:] = pipe.recv()
            pipe.send_bytes(_answer(pipe.recv_bytes()))
    shutil.rmtree(folder, ignore_errors=True)


def _answer(request: bytes) -> bytes:
    """Call a function and return a pickled pair.

    The pair is True and the result of the call; or, after any exception, False and a
    sentence that says what was raised.  `request` is the pickled pair of the function
    and its arguments.
    """
    try:
        function, arguments = pickle.loads(request)
        return pickle.dumps((True, function(*arguments)))
    except BaseException as error:
        sentence = printable(f"raised {type(error).__name__}: {error}")
        return pickle.dumps((False, sentence))


def _end_with_parent() -> None:
    """Wait for the end of the parent process, then kill this one and its children."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    if tempfile.tempdir is not None:
        shutil.rmtree(tempfile.tempdir, ignore_errors=True)
    kill_tree(os.getpid())


# --- many calls


class WorkerPool(ThreadPoolExecutor):
    """Workers as an executor: each of its threads waits for the calls of a worker."""

    def __init__(self, count: int) -> None:
        """Create an executor with a number of workers, whose processes start later."""
        super().__init__(count)
        self._workers = [Worker() for _ in range(count)]
        self._idle = list(self._workers)

    def submit(
        self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any
    ) -> Future[Any]:
        """Return the future of fn(*args, **kwargs), which one of the workers will call.

        `fn` is a function at module level.  The future raises WorkerDied if the call
        has no result.
        """
        return super().submit(self._call, fn, *args, **kwargs)

    def _call(self, function: Callable[..., Result], *arguments: Any) -> Result:
        """Return function(*arguments), called by an idle worker.  Raises WorkerDied."""
        worker = self._idle.pop()
        try:
            return worker.call(function, *arguments)
        finally:
            self._idle.append(worker)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers of this executor.

        Args:
            wait: end them after their present calls; False: at once.
            cancel_futures: drop the calls that have not begun.
        """
        super().shutdown(wait, cancel_futures=cancel_futures)
        for worker in self._workers:
            worker.end()
        super().shutdown()


#: Workers that have answered a call of `call_in_process` and wait for the next one.
_IDLE: list[Worker] = []


def call_in_process(function: Callable[..., Result], *arguments: Any) -> Result | str:
    """Return function(*arguments), called in another process.

    Returns a sentence if there is no result, because the process ended or the function
    raised.  `function` is at module level.
    """
    worker = _IDLE.pop() if _IDLE else Worker()
    try:
        return worker.call(function, *arguments)
    except WorkerDied as error:
        return f"its process {error}"
    finally:
        _IDLE.append(worker)


def executor_from(factory: str | Callable[[], Executor]) -> Executor:
    """Return the executor that a function returns.

    Args:
        factory: a function without arguments, or its name, `module:function`.

    Raises:
        InvalidCase: if there is no such function, or it returns no executor.
    """
    name = factory
    if not isinstance(factory, str):
        name = getattr(factory, "__name__", repr(factory))
    try:
        if isinstance(factory, str):
            factory = pkgutil.resolve_name(factory)
        executor = factory()  # type: ignore[operator]
    except EpcontactError:
        raise
    except (Exception, SystemExit) as error:
        raise InvalidCase(
            f"executor {name} cannot be made ({sentence_of(error)}); give "
            "module:function, which is called without arguments"
        ) from None
    if not isinstance(executor, Executor):
        raise InvalidCase(
            f"executor {name} is {executor!r:.60}, not a concurrent.futures.Executor"
        )
    return executor


def spread(
    function: Callable[[Item], Result], items: Sequence[Item], executor: Executor
) -> Generator[tuple[Item, Result | str]]:
    """Yield (item, function(item)) as the calls finish, then shut the executor down.

    If a call fails, the sentence that says why takes the place of its result.

    Args:
        function: a function of one item, at module level.
        items: the items; the order of the results may differ.
        executor: makes the calls.

    Raises:
        EpcontactError: if the executor takes no task or cannot be shut down.
    """
    running: dict[Future[Result], Item] = {}
    finished = SimpleQueue[Future[Result]]()
    waiting = deque(items)
    try:
        while waiting or running:
            # An executor may make a call when it takes it: results come first.
            if waiting and finished.empty():
                future = _submit(executor, function, waiting[0])
                running[future] = waiting.popleft()
                future.add_done_callback(finished.put)
            else:
                future = finished.get()
                result = _result_of(future)
                yield running.pop(future), result
    finally:
        for future in running:
            future.cancel()
        try:
            executor.shutdown(wait=not running and not waiting)
        except Exception as error:
            reason = sentence_of(error)
            raise EpcontactError(f"the executor does not end: {reason}") from None


def _submit(
    executor: Executor, function: Callable[[Item], Result], item: Item
) -> Future[Result]:
    """Return the future of function(item), which an executor will call.

    Raises EpcontactError if the executor raises, such as after a lost connection.
    """
    try:
        return executor.submit(function, item)
    except Exception as error:
        reason = sentence_of(error)
        raise EpcontactError(f"the executor takes no task: {reason}") from None


def _result_of(future: Future[Result]) -> Result | str:
    """Wait for a call and return its result, or a sentence that says why it failed."""
    try:
        return future.result()
    except WorkerDied as error:
        return f"its process {error}"
    except Exception as error:
        return f"its worker failed: {sentence_of(error)}"
