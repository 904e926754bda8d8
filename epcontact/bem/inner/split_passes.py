"""The passes of the cheap operator: a stencil on the elastic points, a grid of half the points."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

# Sums may be reordered so that they vectorise.
_jit = numba.njit(nogil=True, cache=True, fastmath={"reassoc", "contract", "nsz"})

#: Columns that a masked grid repeats on its left and right, and points that a stencil handles at
#: once: a register of single precision.
HALO_LEFT, HALO_RIGHT, RUN = 3, 20, 16
# Points of the half grid along a run with their neighbours, and the midpoints between them:
# constants, so that the loops over them are unrolled.
_LINE, _MIDDLE = RUN // 2 + 4, RUN // 2 + 1

# Weights of cubic interpolation midway between points.
_INNER, _OUTER = np.float32(9 / 16), np.float32(-1 / 16)


@_jit
def put_single(masked: Any, index: Any, values: Any) -> None:
    """masked = values at the listed points of the grid, and in its repeated columns."""
    ny = masked.shape[1] - HALO_LEFT - HALO_RIGHT
    for k in range(index.size):
        i = index[k] // ny
        j = index[k] - i * ny
        value = values[k]
        masked[i, j + HALO_LEFT] = value
        if j < HALO_RIGHT:
            masked[i, j + HALO_LEFT + ny] = value
        if j >= ny - HALO_LEFT:
            masked[i, j + HALO_LEFT - ny] = value


@_jit
def restrict(masked: Any, half: Any, first: int, last: int) -> None:
    """half = P^T masked for its rows first to last, P being cubic interpolation (periodic)."""
    nx = masked.shape[0]
    width = 2 * half.shape[1] + 6
    line = np.empty(width, dtype=np.float32)
    for row in range(first, last):
        i = 2 * row
        at = masked[i, HALO_LEFT - 3 :]
        a = masked[(i - 3) % nx, HALO_LEFT - 3 :]
        b = masked[(i - 1) % nx, HALO_LEFT - 3 :]
        c = masked[(i + 1) % nx, HALO_LEFT - 3 :]
        d = masked[(i + 3) % nx, HALO_LEFT - 3 :]
        for j in range(width):
            line[j] = at[j] + _INNER * (b[j] + c[j]) + _OUTER * (a[j] + d[j])
        for j in range(half.shape[1]):
            k = 2 * j + 3
            half[row, j] = (
                line[k]
                + _INNER * (line[k - 1] + line[k + 1])
                + _OUTER * (line[k - 3] + line[k + 3])
            )


# Unsigned indices cannot count from the end, which spares the loops below a test that would keep
# them from vectorising; flat arrays spare them views.
_UINT = np.uint64


@_jit
def _around_the_edge(
    half: Any, my: int, rows: tuple[int, int, int, int], first: int, line: Any
) -> None:
    """The rows of the half grid (flat indices of their first points) interpolated midway, at
    columns from `first` on that reach beyond the grid and are repeated."""
    a, b, c, d = rows
    for t in range(line.size):
        k = (first + t) % my
        line[t] = _INNER * (half[b + k] + half[c + k]) + _OUTER * (half[a + k] + half[d + k])


@_jit
def gather_split(  # noqa: PLR0912, PLR0915 - one loop: cut into functions it took a third longer
    masked: Any, half: Any, taps: Any, index: Any, out: Any, other: Any
) -> tuple[float, float]:
    """At the listed points, the 7 x 7 stencil on `masked` plus `half` interpolated.

    Listed points among RUN neighbours of a row are handled together.  Returns sum(out) and
    sum(out other).
    """
    nx, width = masked.shape
    ny = width - HALO_LEFT - HALO_RIGHT
    mx, my = half.shape
    fine, coarse = masked.reshape(-1), half.reshape(-1)
    near = np.empty(RUN, dtype=np.float32)
    line = np.empty(_LINE, dtype=np.float32)
    middle = np.empty(_MIDDLE, dtype=np.float32)
    total = 0.0
    product = 0.0
    k = 0
    while k < index.size:
        i = index[k] // ny
        j = index[k] - i * ny
        last = k
        limit = index[k] + min(RUN, ny - j)
        while last + 1 < index.size and index[last + 1] < limit:
            last += 1
        near[:] = 0
        for a in range(-3, 4):
            row = i + a
            row = row + nx if row < 0 else (row - nx if row >= nx else row)
            base = _UINT(row * width + j)
            c0, c1, c2, c3 = taps[a + 3, 3], taps[a + 3, 2], taps[a + 3, 1], taps[a + 3, 0]
            for t in range(_UINT(RUN)):
                at = base + t
                near[t] += (
                    c0 * fine[at + _UINT(3)]
                    + c1 * (fine[at + _UINT(2)] + fine[at + _UINT(4)])
                    + c2 * (fine[at + _UINT(1)] + fine[at + _UINT(5)])
                    + c3 * (fine[at] + fine[at + _UINT(6)])
                )
        # The half grid's rows around this one, interpolated to it: line, and midway: middle.
        first = j // 2 - 1
        r = i // 2
        b = r * my
        if i % 2 == 0:
            if first >= 0 and first + _LINE <= my:
                ub = _UINT(b + first)
                for t in range(_UINT(_LINE)):
                    line[t] = coarse[ub + t]
            else:
                for t in range(_LINE):
                    line[t] = coarse[b + (first + t) % my]
        else:
            a = (r - 1 if r > 0 else mx - 1) * my
            c = (r + 1 if r + 1 < mx else 0) * my
            d = (r + 2 if r + 2 < mx else r + 2 - mx) * my
            if first >= 0 and first + _LINE <= my:
                ua, ub, uc, ud = (
                    _UINT(a + first),
                    _UINT(b + first),
                    _UINT(c + first),
                    _UINT(d + first),
                )
                for t in range(_UINT(_LINE)):
                    line[t] = _INNER * (coarse[ub + t] + coarse[uc + t]) + _OUTER * (
                        coarse[ua + t] + coarse[ud + t]
                    )
            else:
                _around_the_edge(coarse, my, (a, b, c, d), first, line)
        for t in range(_UINT(_MIDDLE)):
            middle[t] = _INNER * (line[t + _UINT(1)] + line[t + _UINT(2)]) + _OUTER * (
                line[t] + line[t + _UINT(3)]
            )
        origin = index[k] - j
        for m in range(k, last + 1):
            column = index[m] - origin
            c = column // 2 - first
            value = near[column - j] + (line[c] if column % 2 == 0 else middle[c - 1])
            out[m] = value
            total += value
            product += value * other[m]
        k = last + 1
    return total, product
