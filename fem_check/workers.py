"""Compiled loops that threads share, and the vector operations of the iterations.

A loop is cut into parts that write to different places, and sums are added up piece by
piece, so that a result has the same bits on any number of threads.  Vectors have loops
of their own, because numpy's products call a BLAS whose threads cost more than these
short loops take.
"""

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

#: The fewest elements that are worth a thread: their forces take .2 ms.
FEWEST = 1024
_PIECE = 1 << 14  # entries of a vector
_WEIGHT = 1 / 64  # the work on an entry over that on an element


class Workers:
    """Threads of which the caller is one; the others end with this object."""

    def __init__(self, threads: int = 1, fewest: int = FEWEST) -> None:
        self.threads, self.fewest = threads, fewest
        self._pool = ThreadPoolExecutor(threads - 1) if threads > 1 else None

    def share(
        self,
        task: Callable[..., Any],
        ranges: NDArray[np.int64],
        *,
        weight: float = 1.0,
    ) -> None:
        """Call `task` with parts of the (r, 2) ranges, in any order, each writing to
        other places. `weight` is the work on an item over that on an element.
        """
        if self._pool is None or len(ranges) == 1:
            task(ranges)
            return
        lengths = ranges[:, 1] - ranges[:, 0]
        ends, total = np.cumsum(lengths), int(lengths.sum())
        threads = min(self.threads, max(1, int(total * weight / self.fewest)))
        cuts = np.searchsorted(
            ends - lengths / 2, total * np.arange(1, threads) / threads
        )
        first, *parts = [part for part in np.split(ranges, cuts) if len(part)]
        others = [self._pool.submit(task, part) for part in parts]
        task(first)
        for other in others:
            other.result()


def pieces(count: int, length: int) -> NDArray[np.int64]:
    """(r, 2) ranges that cut 0 to `count` into pieces of one length; the last may be
    less.
    """
    if count <= length:  # in a tenth of the time, which tells on small fields
        return np.array([[0, count]])
    first = np.arange(0, count, length)
    return np.stack([first, np.minimum(first + length, count)], axis=1)


#: No threads but the caller's.
ALONE = Workers()


@compiled
def _dot(a, b, sums, ranges):  # type: ignore[no-untyped-def]
    for first, stop in ranges:
        total = 0.0
        for i in range(first, stop):
            total += a[i] * b[i]
        sums[first // _PIECE] = total


@compiled
def _axpy(y, s, x, ranges):  # type: ignore[no-untyped-def]
    for i in range(ranges[0, 0], ranges[-1, 1]):
        y[i] += s * x[i]


@compiled
def _xpay(p, s, z, ranges):  # type: ignore[no-untyped-def]
    for i in range(ranges[0, 0], ranges[-1, 1]):
        p[i] = z[i] + s * p[i]


def dot(a: FloatArray, b: FloatArray, workers: Workers = ALONE) -> float:
    """The sum of the products of two arrays of one shape."""
    ranges = pieces(a.size, _PIECE)
    sums = np.zeros(len(ranges))
    workers.share(partial(_dot, np.ravel(a), np.ravel(b), sums), ranges, weight=_WEIGHT)
    return math.fsum(sums)


def norm(a: FloatArray, workers: Workers = ALONE) -> float:
    """The Euclidean norm."""
    return math.sqrt(dot(a, a, workers))


def axpy(y: FloatArray, scale: float, x: FloatArray, workers: Workers = ALONE) -> None:
    """Set y to y + scale x, in place."""
    task = partial(_axpy, y.reshape(-1), scale, x.reshape(-1))
    workers.share(task, pieces(y.size, _PIECE), weight=_WEIGHT)


def xpay(p: FloatArray, scale: float, z: FloatArray, workers: Workers = ALONE) -> None:
    """Set p to z + scale p, in place."""
    task = partial(_xpay, p.reshape(-1), scale, z.reshape(-1))
    workers.share(task, pieces(p.size, _PIECE), weight=_WEIGHT)
