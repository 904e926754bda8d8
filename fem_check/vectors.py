"""Vector operations of the iterations on whole displacement fields, each in one compiled loop.

numpy's own products call a BLAS whose threads cost more than these short loops take.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from epcontact.results import FloatArray
from fem_check.lanes import compiled
from fem_check.workers import ALONE, Workers, pieces

# Threads share pieces of this many entries.  Sums are added up piece by piece on any number of
# them, so that they have the same bits.
_PIECE = 1 << 14
# The work on an entry over that on an element.
_WEIGHT = 1 / 64


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
