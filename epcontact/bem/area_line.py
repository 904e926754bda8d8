"""Lengths of contact on a line, each front located inside its cell.

At a front between apart and elastic points the discrete problem on the half-line is solved by a
Wiener-Hopf factorisation of the compliance 2/(E* |q|), |q| < pi/dx.  With q(x) = alpha + beta x +
... the polynomial that the continuum has for its square root times p, the pressure inside is
(1/S_+) q and the gap outside is -S_- q.  The leading coefficients of S give, in units of
c = pi E*/(2 e dx), with b = Si(pi)/pi and points counted from the last in contact outwards,

    q(0) = p_0,  q(-1) = p_1 + b p_0 (to a common factor),  q(1) = -c g_1,  q(2) = -c g_2 + b c g_1.

The front lies AXIS_OFFSET dx short of the root of q between 0 and 1.  The root is that of the
polynomial through the four values (three or two where the contact or the gap has one point only):
the offset is exact up to the third order in dx, as the magnitude of S has no further terms.

The plastic front is the same with hardness - p for p and -g for g.  Where apart and plastic lie
within two spacings, the strip between them is taken as wide as the roots of p - c g and
p - c g - hardness on straight lines between points, less twice what STRIP_OFFSETS has for that
width: calibrated in `rim_calibration` like its counterpart on grids.  Its middle is where the
force puts it, as the pressure rises antisymmetrically about it (p = (2 H/pi) arcsin sqrt(s/w)):
half a spacing beyond the last plastic point plus the sum of p/H over the elastic ones.  Strips
wider than a spacing are placed by the roots.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Pair = tuple[float, float]

#: Offset of a front along an axis, in dx: 1/4 - (1/2 pi) int_0^{pi/2} (cot t/t - cot^2 t) dt.
AXIS_OFFSET = 0.190009285925947
#: Interpolated width of a strip in dx, and the offset of each of its fronts.
WIDTH_NODES = np.array([0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.9, 1.05, 1.2, 1.4, 1.7, 2.0])
STRIP_OFFSETS = np.array(
    [
        0,
        0.0625,
        0.1246,
        0.1836,
        0.2303,
        0.2582,
        0.267,
        0.2601,
        0.2424,
        0.2307,
        0.2157,
        0.2019,
        0.2047,
    ]
)
STIFFNESS = math.pi / (2 * math.e)
MIX = 0.5894898722360835  # Si(pi)/pi

_jit = numba.njit(cache=True, nogil=True)


def line_lengths(
    pressure: FloatArray, gap: FloatArray, hardness: float, stiffness: float
) -> tuple[Pair, Pair, Pair]:
    """(contact, plastic) lengths in grid spacings: counted, located, and their errors.

    pressure, gap: (n,); stiffness: E*/dx in Pa/m.
    """
    c, capped = STIFFNESS * stiffness, math.isfinite(hardness)
    contact, contact_error = _located(pressure, gap, hardness, c)
    rest, rest_error = _located(hardness - pressure, -gap, hardness, c) if capped else (0.0, 0.0)
    n = pressure.size
    plastic = n - rest if capped else 0.0
    counted = (
        float(np.count_nonzero(pressure > 0)),
        float(np.count_nonzero(pressure >= hardness)),
    )
    errors = (
        contact_error + _order(counted[0], contact, n, capped),
        rest_error + _order(counted[1], plastic, n, capped),
    )
    return counted, (contact, plastic), errors


def _order(counted: float, located: float, n: int, capped: bool) -> float:
    """What a next order may leave: the correction times its share of the smaller part.

    The factors are measured on rough lines; with strips between the fronts more is left.
    """
    smaller = max(min(located, n - located), 1.0)
    return (
        (2.5 if capped else 1.0)
        * abs(counted - located)
        * min(1.0, abs(counted - located) / smaller)
    )


@_jit
def _root(q: FloatArray, low: int, high: int) -> float:
    """Root in [0, 1] of the polynomial through (i - 1, q[i]), low <= i < high, by bisection."""
    a, b = 0.0, 1.0
    for _ in range(50):
        x = (a + b) / 2
        value = 0.0
        for i in range(low, high):
            term = q[i]
            for k in range(low, high):
                if k != i:
                    term *= (x - (k - 1)) / (i - k)
            value += term
        if value > 0:
            a = x
        else:
            b = x
    return (a + b) / 2


@_jit
def _located(p: FloatArray, g: FloatArray, hardness: float, c: float) -> tuple[float, float]:
    """Length where p > 0, and its error: sums over the fronts."""
    n = p.size
    length = error = chance = 0.0
    for i in range(n):
        if p[i] > 0:
            length += 1
        for d in (-1, 1):
            j = (i + d) % n
            if p[i] <= 0 or p[j] > 0:
                continue
            near, far = p[i] - c * min(g[i], 0.0), -c * max(g[j], 0.0)
            plain = near / (near - far) if near > far else 0.5
            width, middle = _strip(p, g, hardness, c, i, d, plain)
            if width < 2:
                offset = np.interp(width, WIDTH_NODES, STRIP_OFFSETS)
                true = width - 2 * offset
                length += middle + true / 2 if true < 1 else plain - 0.5 - offset
                chance += (0.04 + 0.2 * true) ** 2
                continue
            inner, outer = (i - d) % n, (j + d) % n
            q = np.array([p[inner] + MIX * p[i], near, far, -c * g[outer] + MIX * c * g[j]])
            low = 0 if 0 < p[inner] < hardness else 1
            high = 4 if p[outer] <= 0 else 3
            root = _root(q, low, high)
            length += root - 0.5 - AXIS_OFFSET
            # Short runs end where the half-line's solution does not hold any more.
            error += 0.1 * abs(root - plain) + 0.03 * (4 - high + low)
            chance += 0.02**2
    return length, error + 2 * math.sqrt(chance)


@_jit
def _strip(
    p: FloatArray, g: FloatArray, hardness: float, c: float, i: int, d: int, plain: float
) -> tuple[float, float]:
    """Width of the strip behind a front beyond i (looking along d), and where the force has its
    middle, counted from the edge of the points in contact; width 9 if there is none."""
    n = p.size
    if not np.isfinite(hardness):
        return 9.0, 0.0
    if p[i] >= hardness:
        drop = hardness - c * (min(g[i], 0.0) - max(g[(i + d) % n], 0.0))
        return hardness / drop, 0.0
    force = 0.0
    for m in range(1, 4):
        force += p[(i - (m - 1) * d) % n] / hardness
        k = (i - m * d) % n
        if p[k] <= 0:
            break
        if p[k] >= hardness:
            low, high = p[(k + d) % n], hardness - c * min(g[k], 0.0)
            return plain + m - 1 + (hardness - low) / (high - low), force - m
    return 9.0, 0.0
