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


@_jit
def put_single(masked: Any, index: Any, values: Any, factor: float) -> None:
    """masked = factor values at the listed points of the grid, and in its repeated columns."""
    ny = masked.shape[1] - HALO_LEFT - HALO_RIGHT
    for k in range(index.size):
        i = index[k] // ny
        j = index[k] - i * ny
        value = factor * values[k]
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
    outer = np.float32(-1 / 16)
    inner = np.float32(9 / 16)
    for row in range(first, last):
        i = 2 * row
        at = masked[i, HALO_LEFT - 3 :]
        a = masked[(i - 3) % nx, HALO_LEFT - 3 :]
        b = masked[(i - 1) % nx, HALO_LEFT - 3 :]
        c = masked[(i + 1) % nx, HALO_LEFT - 3 :]
        d = masked[(i + 3) % nx, HALO_LEFT - 3 :]
        for j in range(width):
            line[j] = at[j] + inner * (b[j] + c[j]) + outer * (a[j] + d[j])
        for j in range(half.shape[1]):
            k = 2 * j + 3
            half[row, j] = (
                line[k] + inner * (line[k - 1] + line[k + 1]) + outer * (line[k - 3] + line[k + 3])
            )


# Unsigned indices cannot count from the end, which spares the loops below a test that would keep
# them from vectorising; flat arrays spare them views.
_UINT = np.uint64


@_jit
def _coarse_line(half: Any, my: int, rows: Any, first: int, line: Any, middle: Any) -> None:
    """The half grid (flat) interpolated by cubics to a row of the fine grid.

    rows: the half grid's row that the fine one lies on, or the four around it; first: a column.
    Fills line at the columns from `first`, and middle[k] midway between line[k] and line[k + 1].
    """
    if first >= 0 and first + line.size <= my:
        b = _UINT(rows[1] * my + first)
        if rows.size == 3:
            for t in range(_UINT(line.size)):
                line[t] = half[b + t]
        else:
            a = _UINT(rows[0] * my + first)
            c, d = _UINT(rows[2] * my + first), _UINT(rows[3] * my + first)
            for t in range(_UINT(line.size)):
                line[t] = (9 * (half[b + t] + half[c + t]) - half[a + t] - half[d + t]) * 0.0625
    else:
        for t in range(line.size):
            k = (first + t) % my
            if rows.size == 3:
                line[t] = half[rows[1] * my + k]
            else:
                line[t] = (
                    9 * (half[rows[1] * my + k] + half[rows[2] * my + k])
                    - half[rows[0] * my + k]
                    - half[rows[3] * my + k]
                ) / 16
    for k in range(_UINT(1), _UINT(line.size - 2)):
        middle[k] = (
            9 * (line[k] + line[k + _UINT(1)]) - line[k - _UINT(1)] - line[k + _UINT(2)]
        ) * 0.0625


@_jit
def gather_split(
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
    line = np.empty(RUN // 2 + 4)
    middle = np.empty(RUN // 2 + 4)
    on, between = np.empty(3, dtype=np.int64), np.empty(4, dtype=np.int64)
    reach = 0
    for a in range(4):
        if taps[3 - a, 3] != 0:
            reach = a
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
        for a in range(-reach, reach + 1):
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
        first = j // 2 - 1
        if i % 2 == 0:
            on[1] = i // 2
            _coarse_line(coarse, my, on, first, line, middle)
        else:
            r = i // 2
            between[0] = r - 1 if r > 0 else mx - 1
            between[1] = r
            between[2] = r + 1 if r + 1 < mx else 0
            between[3] = between[2] + 1 if between[2] + 1 < mx else 0
            _coarse_line(coarse, my, between, first, line, middle)
        origin = index[k] - j
        for m in range(k, last + 1):
            column = index[m] - origin
            c = column // 2 - first
            value = near[column - j] + (line[c] if column % 2 == 0 else middle[c])
            out[m] = value
            total += value
            product += value * other[m]
        k = last + 1
    return total, product
