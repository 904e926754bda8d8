"""Worker processes that end with their parent and leave Ctrl-C to it.

`concurrent.futures` does the work.  This module adds three things.  The workers ignore Ctrl-C from
the start, so that an interrupted command prints none of their tracebacks.  They end when the
parent is killed.  A running solve is ended too, because no exception reaches compiled code.  (The
pool of loky and joblib was tried: its workers print such tracebacks and outlive the parent.)
"""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from epcontact.machine import available_cores

Item = TypeVar("Item")
Result = TypeVar("Result")


def spread(
    function: Callable[[Item, int], Result], items: Sequence[Item], jobs: int
) -> Iterator[tuple[Item, Result | str]]:
    """Yield (item, function(item, threads)) as the calls finish.

    Args:
        function: a function at module level, so that a process can import it.
        items: the arguments, one for each call.
        jobs: number of processes; with 1, the calls are made in this process.

    Returns:
        Pairs in any order.  If a worker process dies, a sentence replaces its result.
    """
    jobs = min(jobs, len(items))
    threads = max(1, available_cores() // max(1, jobs))
    if jobs <= 1:
        for item in items:
            yield item, function(item, threads)
        return
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_set_up_worker)
    try:
        with _interrupts_held():
            futures = {pool.submit(function, item, threads): item for item in items}
        for future in as_completed(futures):
            try:
                yield futures[future], future.result()
            except BrokenProcessPool:
                yield futures[future], "a worker process died, most likely out of memory"
        pool.shutdown()
    except BaseException:
        # A solve in C can only be killed; nothing of it is on disk yet.
        for process in list((getattr(pool, "_processes", None) or {}).values()):
            process.terminate()
        pool.shutdown(wait=False, cancel_futures=True)
        raise


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C and termination back while workers start, and answer them afterwards.

    Workers inherit the signal mask, so they ignore Ctrl-C from their first instruction and print
    no traceback of an interrupted import.  The mask alone is not enough, because a thread of a
    library may take the signal: a parent that is interrupted while it sends a task would leave a
    worker with half of it.
    """
    main = threading.current_thread() is threading.main_thread()
    if not (main and hasattr(signal, "pthread_sigmask")):
        yield
        return
    held: list[int] = []
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    kinds = (signal.SIGINT, signal.SIGTERM)
    handlers = [signal.signal(kind, lambda number, _: held.append(number)) for kind in kinds]
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for kind, handler in zip(kinds, handlers, strict=True):
            signal.signal(kind, handler)
    if held:
        raise KeyboardInterrupt


def _set_up_worker() -> None:
    """Leave Ctrl-C, which reaches the whole process group, to the parent; end with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this worker with its parent: a killed parent cannot stop workers that wait for tasks."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)
