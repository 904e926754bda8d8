"""Threads for compiled loops, and the vector operations of the iterative solvers.

A loop is cut into ranges that write to different places, and partial sums are added up
range by range.  A result therefore has the same bits on any number of threads.  The
vector operations are compiled here because numpy's products call a BLAS, whose threads
cost more than these short loops take.
"""

# mypy: allow-untyped-defs
# numba infers the types of the compiled functions.

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.results import FloatArray
from fem_check.lanes import compiled

#: Fewest elements that a thread gets: their internal force takes 0.2 ms, which is much
#: longer than the start of a thread's task.
MIN_ELEMENTS = 1024
#: Vector entries that are summed up in one range.
_RANGE_LENGTH = 1 << 14
#: Work on a vector entry, relative to the work on an element.
_ENTRY_WORK = 1 / 64


class Workers:
    """A pool of threads, one of which is the caller's; the others end with this object.

    Args:
        threads: number of threads, the caller's included.
        min_elements: fewest elements (or equivalent work) that a thread gets.
    """

    def __init__(self, threads: int = 1, min_elements: int = MIN_ELEMENTS) -> None:
        """Start the pool of threads.

        Args:
            threads: number of threads, the caller's included.
            min_elements: fewest elements (or equivalent work) that a thread gets.
        """
        self.threads = threads
        self.min_elements = min_elements
        self._pool: ThreadPoolExecutor | None = None
        if threads > 1:
            self._pool = ThreadPoolExecutor(threads - 1)

    def run(
        self,
        task: Callable[..., Any],
        ranges: NDArray[np.int64],
        *,
        work: float = 1.0,
    ) -> None:
        """Call `task` with parts of the ranges until all ranges are done.

        An error that a task raises in any thread is raised here.

        Args:
            task: is called with an (r, 2) array of ranges, in any order and in several
                threads; each range must write to different places.
            ranges: (r, 2) first index and stop index of each range.
            work: on one index, relative to that on an element.
        """
        if self._pool is None or len(ranges) == 1:
            task(ranges)
            return
        lengths = ranges[:, 1] - ranges[:, 0]
        stops = np.cumsum(lengths)
        total = int(lengths.sum())
        threads = min(self.threads, max(1, int(total * work / self.min_elements)))
        targets = total * np.arange(1, threads) / threads
        cuts = np.searchsorted(stops - lengths / 2, targets)
        first, *parts = [part for part in np.split(ranges, cuts) if len(part)]
        futures = [self._pool.submit(task, part) for part in parts]
        task(first)
        for future in futures:
            future.result()


def split_range(count: int, length: int) -> NDArray[np.int64]:
    """Return an (r, 2) array with the first index and the stop index of r ranges.

    The ranges cover 0 to `count`.  Each is `length` long; the last may be shorter.
    """
    if count <= length:  # a tenth of the time of what follows, for small fields
        return np.array([[0, count]])
    first = np.arange(0, count, length)
    return np.stack([first, np.minimum(first + length, count)], axis=1)


#: Runs everything in the caller's thread.
SERIAL = Workers()


# The loops below run over slices from 0 on: of an index that may be negative the
# compiler asks at every entry whether it counts from the end, and it then makes no
# vector instructions, which take a quarter of the time.


@compiled
def _dot(a, b, sums, ranges):
    """Write the partial sums of the products of two vectors of one length.

    Args:
        a: (n,) first vector.
        b: (n,) second vector.
        sums: receives at index k the sum over the k-th range of `_RANGE_LENGTH`
            entries.
        ranges: (r, 2) first index and stop index of the ranges to sum.
    """
    for first, stop in ranges:
        x = a[first:stop]
        y = b[first:stop]
        total = 0.0
        for i in range(x.size):
            total += x[i] * y[i]
        sums[first // _RANGE_LENGTH] = total


@compiled
def _axpy(y, scale, x, ranges):
    """Set y (n,) to y + scale x in place, over consecutive ranges (r, 2) of entries."""
    y = y[ranges[0, 0] : ranges[-1, 1]]
    x = x[ranges[0, 0] : ranges[-1, 1]]
    for i in range(y.size):
        y[i] += scale * x[i]


@compiled
def _xpay(p, scale, z, ranges):
    """Set p (n,) to z + scale p in place, over consecutive ranges (r, 2) of entries."""
    p = p[ranges[0, 0] : ranges[-1, 1]]
    z = z[ranges[0, 0] : ranges[-1, 1]]
    for i in range(p.size):
        p[i] = z[i] + scale * p[i]


def _run_by_entries(workers: Workers, task: Callable[..., Any], count: int) -> None:
    """Call `task` with ranges of a vector's entries, in several threads.

    Args:
        workers: the threads.
        task: called with (r, 2) first index and stop index of ranges.
        count: number of entries of the vector.
    """
    workers.run(task, split_range(count, _RANGE_LENGTH), work=_ENTRY_WORK)


def dot(a: FloatArray, b: FloatArray, workers: Workers = SERIAL) -> float:
    """Return the sum of the products of two arrays of one shape, as a float.

    The result has the same bits on any number of threads.

    Args:
        a: any shape, in any unit.
        b: of the same shape.
        workers: threads that share the work.
    """
    sums = np.zeros(a.size // _RANGE_LENGTH + 1)
    task = partial(_dot, np.ravel(a), np.ravel(b), sums)
    _run_by_entries(workers, task, a.size)
    return math.fsum(sums)


def norm(a: FloatArray, workers: Workers = SERIAL) -> float:
    """Return the Euclidean norm of an array, in its unit.

    Args:
        a: contiguous or not, of any shape.
        workers: threads that share the work.
    """
    return math.sqrt(dot(a, a, workers))


def axpy(y: FloatArray, scale: float, x: FloatArray, workers: Workers = SERIAL) -> None:
    """Set y to y + scale x, in place.

    Args:
        y: contiguous array of any shape, which is changed.
        scale: a number.
        x: array of the shape of y.
        workers: threads that share the work.
    """
    task = partial(_axpy, y.reshape(-1), scale, x.reshape(-1))
    _run_by_entries(workers, task, y.size)


def xpay(p: FloatArray, scale: float, z: FloatArray, workers: Workers = SERIAL) -> None:
    """Set p to z + scale p, in place.

    Args:
        p: contiguous array of any shape, which is changed.
        scale: a number.
        z: array of the shape of p.
        workers: threads that share the work.
    """
    task = partial(_xpay, p.reshape(-1), scale, z.reshape(-1))
    _run_by_entries(workers, task, p.size)
