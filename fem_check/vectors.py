"""Vector operations of the iterations on whole displacement fields, each in one compiled loop.

numpy's own products call a BLAS whose threads cost more than these short loops take.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from epcontact.results import FloatArray

_FAST = {"contract", "reassoc", "nsz"}


@njit(cache=True, fastmath=_FAST)
def _dot(a, b):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@njit(cache=True, fastmath=_FAST)
def _axpy(y, s, x):  # type: ignore[no-untyped-def]
    for i in range(y.size):
        y[i] += s * x[i]


@njit(cache=True, fastmath=_FAST)
def _xpay(p, s, z):  # type: ignore[no-untyped-def]
    for i in range(p.size):
        p[i] = z[i] + s * p[i]


def dot(a: FloatArray, b: FloatArray) -> float:
    """The sum of the products of two arrays of one shape."""
    return float(_dot(np.ravel(a), np.ravel(b)))


def norm(a: FloatArray) -> float:
    """The Euclidean norm."""
    return math.sqrt(dot(a, a))


def axpy(y: FloatArray, scale: float, x: FloatArray) -> None:
    """Set y to y + scale x, in place."""
    _axpy(y.reshape(-1), scale, x.reshape(-1))


def xpay(p: FloatArray, scale: float, z: FloatArray) -> None:
    """Set p to z + scale p, in place."""
    _xpay(p.reshape(-1), scale, z.reshape(-1))
