"""Compiled passes over a grid, run block by block on a few threads.

A pass is a compiled function that works on one block of its arrays and releases the
interpreter's lock.  `Workers` calls it for every block of a fixed partition and adds up
what the calls return in the order of the blocks, so a result has the same bits on any
number of threads.
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
    """Cut 0 to `size` into ranges of `step`; the last one may be shorter."""
    return [slice(start, min(start + step, size)) for start in range(0, size, step)]


def split(array: NDArray[Any], parts: list[slice]) -> list[NDArray[Any]]:
    """A view of the array for each part; a single part is the array itself."""
    return [array] if len(parts) == 1 else [array[part] for part in parts]


class Workers:
    """The threads that share the blocks of one solve, to be used as a context manager.
    A list among the arguments of `each` and `total` has one item for each block; any
    other argument is passed to every call.
    """

    def __init__(self, threads: int = 1) -> None:
        self._helpers = threads - 1
        self._pool = ThreadPoolExecutor(self._helpers) if threads > 1 else None

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown()

    def each(self, task: Callable[..., T], *arguments: Any) -> list[T]:
        """The results of `task` for every block, in the order of the blocks."""
        blocks = len(next(a for a in arguments if type(a) is list))
        if blocks == 1:  # on a small grid the calls themselves cost most
            return [task(*[a[0] if type(a) is list else a for a in arguments])]
        columns = [a if type(a) is list else repeat(a) for a in arguments]
        if self._pool is None:
            return list(map(task, *columns))
        # This thread works, too, and each of the others takes blocks for one request.
        helpers = min(self._helpers, blocks - 1)
        waiting = deque(
            [*enumerate(zip(*columns, strict=False)), *repeat(None, helpers + 1)]
        )
        found: dict[int, T] = {}

        def work() -> None:
            for number, block in iter(waiting.popleft, None):
                found[number] = task(*block)

        requests = [self._pool.submit(work) for _ in range(helpers)]
        try:
            work()
        finally:
            wait(requests)
        for request in requests:
            request.result()
        return [found[number] for number in range(blocks)]

    def total(
        self, task: Callable[..., tuple[Any, ...]], *arguments: Any
    ) -> tuple[Any, ...]:
        """The sum over the blocks of each number that `task` returns."""
        found = self.each(task, *arguments)
        if len(found) == 1:
            return found[0]
        return tuple(sum(column) for column in zip(*found, strict=True))
