"""The passes of the preconditioner over listed points, each over the points of a block of rows."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from epcontact.bem.inner.split_passes import HALO_LEFT, HALO_RIGHT

# Sums may be reordered so that they vectorise.
_jit = numba.njit(nogil=True, cache=True, fastmath={"reassoc", "contract", "nsz"})


@_jit
def number_cells(
    index: Any, shape: tuple[int, int], cells: tuple[int, int], out: Any, first: int, count: Any
) -> None:
    """out = the flat number of the cell of each point; count: points by cell, from `first`."""
    nx, ny = shape
    mx, my = cells
    columns = np.empty(ny, dtype=np.int32)
    for j in range(ny):
        columns[j] = j * my // ny
    count[:] = 0.0
    row, end, begin = -1, 0, 0
    for k in range(index.size):
        if index[k] >= end:
            row = index[k] // ny
            end = (row + 1) * ny
            begin = row * mx // nx * my
        cell = begin + columns[index[k] - row * ny]
        out[k] = cell
        count[cell - first] += 1.0


@_jit
def sum_cells(cell: Any, values: Any, first: int, sums: Any) -> None:
    """sums = the sums of values by cell, counted from the cell `first`."""
    sums[:] = 0.0
    for k in range(cell.size):
        sums[cell[k] - first] += values[k]


@_jit
def subtract(cell: Any, values: Any, mean: Any, out: Any) -> None:
    """out = values - mean[cell]."""
    for k in range(cell.size):
        out[k] = values[k] - mean[cell[k]]


@_jit
def gather_stencil(
    masked: Any, taps: Any, index: Any, cell: Any, first: int, out: Any, sums: Any
) -> None:
    """out = the 3 x 3 stencil on `masked` at the points; sums: of out by cell, from `first`."""
    nx, width = masked.shape
    ny = width - HALO_LEFT - HALO_RIGHT
    flat = masked.reshape(-1)
    size = nx * width
    centre, along, across, corner = taps[1, 1], taps[1, 2], taps[2, 1], taps[2, 2]
    sums[:] = 0.0
    row, end = -1, 0
    for k in range(index.size):
        if index[k] >= end:
            row = index[k] // ny
            end = (row + 1) * ny
        at = row * (HALO_LEFT + HALO_RIGHT) + index[k] + HALO_LEFT
        up = at - width if at >= width else at - width + size
        down = at + width if at + width < size else at + width - size
        value = (
            centre * flat[at]
            + along * (flat[at - 1] + flat[at + 1])
            + across * (flat[up] + flat[down])
            + corner * (flat[up - 1] + flat[up + 1] + flat[down - 1] + flat[down + 1])
        )
        out[k] = value
        sums[cell[k] - first] += value


@_jit
def add_cells(cell: Any, shift: Any, out: Any, other: Any) -> tuple[float, float]:
    """out += shift[cell]; returns sum(out) and sum(out other)."""
    total = 0.0
    product = 0.0
    for k in range(cell.size):
        value = out[k] + shift[cell[k]]
        out[k] = value
        total += value
        product += value * other[k]
    return total, product


# Of the cells' problem: its vectors are short, and a linear algebra library's threads would cost
# more than they gain.


@_jit
def keep_used(s: Any, delta: Any, r: Any) -> float:
    """s = 0 in cells without points, whose delta is 0; returns sum(s r)."""
    total = 0.0
    for k in range(s.size):
        if delta[k] > 0.0:
            total += s[k] * r[k]
        else:
            s[k] = 0.0
    return total


@_jit
def add_own(v: Any, delta: Any, d: Any) -> float:
    """v += delta d, but 0 in cells without points; returns sum(v d)."""
    total = 0.0
    for k in range(v.size):
        v[k] = v[k] + delta[k] * d[k] if delta[k] > 0.0 else 0.0
        total += v[k] * d[k]
    return total


@_jit
def descend(y: Any, r: Any, d: Any, v: Any, alpha: float) -> float:
    """y += alpha d, r -= alpha v; returns sum(r^2)."""
    total = 0.0
    for k in range(y.size):
        y[k] += alpha * d[k]
        r[k] -= alpha * v[k]
        total += r[k] * r[k]
    return total
