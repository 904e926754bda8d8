"""Compiled passes over a grid, run block by block on a few threads.

A pass is a compiled function that works on one block of its arrays and releases the
interpreter's lock.  `Workers` calls it for every block of a fixed partition, and adds
up the results of the calls in the order of the blocks.  So a result has the same bits
on any number of threads.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from itertools import repeat
from typing import Any, TypeVar

import numba
from numpy.typing import NDArray

from epcontact.machine import provide_kernel_cache

provide_kernel_cache()  # before the first kernel is defined

T = TypeVar("T")

#: Sums may be reordered so that they vectorise; infinities (an infinite hardness, a
#: division by zero) keep their meaning.  No C code calls a pass, which saves a wrapper.
OPTIONS: dict[str, Any] = {
    "nogil": True,
    "cache": True,
    "fastmath": {"reassoc", "contract", "nsz"},
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
}
#: Compiles a pass.
compiled = numba.njit(**OPTIONS)


def ranges(size: int, step: int) -> list[slice]:
    """Return slices of `step` indices each that cover 0 to `size`.

    The last slice may be shorter; there is none if size is 0.
    """
    return [slice(start, min(start + step, size)) for start in range(0, size, step)]


def split(array: NDArray[Any], parts: list[slice]) -> list[NDArray[Any]]:
    """Return a list of views array[part], one for each part.

    parts: slices of the first index.  A single part is assumed to be the complete
    array, which is returned itself.
    """
    if len(parts) == 1:
        return [array]
    return [array[part] for part in parts]


class Workers:
    """The threads that share the blocks of one solve, to be used as a context manager.

    A list among the arguments of `each` and `total` has one item for each block; any
    other argument is passed to every call.
    """

    def __init__(self, threads: int = 1) -> None:
        """Start a pool for `threads` threads, of which the calling thread is one."""
        self._helpers = threads - 1
        self._pool = ThreadPoolExecutor(self._helpers) if threads > 1 else None

    def __enter__(self) -> Workers:
        """Return these workers; the end of the `with` block stops the threads."""
        return self

    def __exit__(self, *_: object) -> None:
        """Stop the threads once they have finished."""
        if self._pool is not None:
            self._pool.shutdown()

    def each(self, task: Callable[..., T], *arguments: Any) -> list[T]:
        """Call a task for every block; return the results in the order of the blocks.

        task: the function; arguments: of the function.  An argument that is a list has
        one item for each block, and at least one argument must be a list; any other
        argument is passed to every call.  An error of a task is raised once all threads
        have stopped.
        """
        blocks = next(len(one) for one in arguments if type(one) is list)
        if blocks == 1:  # on a small grid the calls themselves cost most
            return [task(*[a[0] if type(a) is list else a for a in arguments])]
        columns = [a if type(a) is list else repeat(a) for a in arguments]
        if self._pool is None:
            return list(map(task, *columns))
        # This thread works, too, and each of the others takes blocks for one request.
        # A None for each thread tells it to stop.
        helpers = min(self._helpers, blocks - 1)
        waiting = deque(
            [*enumerate(zip(*columns, strict=False)), *repeat(None, helpers + 1)]
        )
        results: dict[int, T] = {}

        def work() -> None:
            """Call the task for waiting blocks until a None is found."""
            for number, block in iter(waiting.popleft, None):
                results[number] = task(*block)

        requests = [self._pool.submit(work) for _ in range(helpers)]
        try:
            work()
        finally:
            wait(requests)
        for request in requests:
            request.result()
        return [results[number] for number in range(blocks)]

    def total(
        self, task: Callable[..., tuple[Any, ...]], *arguments: Any
    ) -> tuple[Any, ...]:
        """Call a task for every block, and return the sums of the numbers it returns.

        task: a function that returns a tuple of numbers; arguments: as for `each`.
        """
        parts = self.each(task, *arguments)
        if len(parts) == 1:
            return parts[0]
        return tuple(sum(column) for column in zip(*parts, strict=True))
