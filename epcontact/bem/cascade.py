"""Start each grid from the solution on a grid of half as many points in each direction.

Coarse heights are the fine ones without the modes that the coarse grid cannot hold.  The coarse
solution is passed on as p - c g, interpolated by cubics.  It is positive in contact, negative
outside it and above the cap where the pressure is capped.  It crosses these bounds at the fronts,
so the fine grid starts with fronts that are right to a fraction of a coarse cell.
"""

from __future__ import annotations

from typing import Any

import ducc0
import numpy as np
from numpy.typing import NDArray

from epcontact.bem.transforms import (
    BLOCK_POINTS,
    ComplexArray,
    Symbol,
    through_columns,
    to_modes,
    to_values,
)
from epcontact.bem.workers import Workers, compiled, ranges, split
from epcontact.results import FloatArray

#: A direction of at most this many points is not coarsened further.  Solves of 107 scenes took 6 %
#: less time than with 32, because the calls of a small grid cost more than its points.
COARSEST = 64


def coarser(symbol: Symbol) -> tuple[int, int] | None:
    """Halve each direction of more than COARSEST points; None if there is none.

    Where points are far apart along one axis, the other is halved alone as long as it can be.
    """
    shape, far = symbol.shape, symbol.far()
    half = [_half(n) if n > COARSEST else n for n in shape]
    near = [n if apart else m for n, m, apart in zip(shape, half, far, strict=True)]
    chosen = half if tuple(near) == shape else near
    return None if tuple(chosen) == shape else (chosen[0], chosen[1])


def _half(number: int) -> int:
    """Half as many points or a few more, so that large grids can be halved again and transform
    fast."""
    half = (number + 1) // 2
    if half < 64 or number % 4 == 0:
        return half
    return 16 * int(ducc0.fft.good_size(-(-half // 16), True))


def coarsened_heights(heights: FloatArray, shape: tuple[int, int], workers: Workers) -> FloatArray:
    """Heights on a coarser grid of the same periods, without the modes it cannot hold.

    The unpaired mode of an even number of points is left out, too.
    """
    (nx, ny), (mx, my) = heights.shape, shape
    kept_rows = (mx + 1) // 2 if mx < nx else mx
    kept_columns = (my + 1) // 2 if my < ny else my // 2 + 1
    fine = np.empty((nx, kept_columns), dtype=np.complex128)
    coarse = np.zeros((mx, my // 2 + 1), dtype=np.complex128)
    out = np.empty(shape)
    step = max(1, BLOCK_POINTS // ny)

    def cut(block: ComplexArray, columns: slice) -> ComplexArray:
        target = coarse[:, columns]
        target[:kept_rows] = block[:kept_rows]
        if mx < nx and kept_rows > 1:
            target[1 - kept_rows :] = block[1 - kept_rows :]
        target /= nx * ny
        return target

    rows = ranges(nx, step)
    workers.each(to_modes, split(heights, rows), split(fine, rows))
    through_columns(workers, fine, max(8, BLOCK_POINTS // (2 * nx)), cut)
    rows = ranges(mx, step)
    workers.each(to_values, split(coarse, rows), split(out, rows))
    return out


def interpolated(coarse: FloatArray, shape: tuple[int, ...], workers: Workers) -> FloatArray:
    """Interpolate a periodic field to a finer grid, by cubics through four points a direction."""
    index, weights = _neighbours(coarse.shape[0], shape[0])
    columns, column_weights = _neighbours(coarse.shape[1], shape[1])
    out = np.empty(shape)
    rows = ranges(shape[0], max(1, 65536 // shape[1]))
    workers.each(interpolate, coarse, split(index, rows), split(weights, rows),
                 columns, column_weights, split(out, rows))  # fmt: skip
    return out


def _neighbours(coarse: int, fine: int) -> tuple[NDArray[np.int32], FloatArray]:
    """Four coarse neighbours of each fine point, periodically, and their cubic weights."""
    position = np.arange(fine) * (coarse / fine)
    left = np.floor(position).astype(np.int64)
    t = position - left
    weights = [
        -t * (t - 1) * (t - 2) / 6,
        (t + 1) * (t - 1) * (t - 2) / 2,
        -(t + 1) * t * (t - 2) / 2,
        (t + 1) * t * (t - 1) / 6,
    ]
    neighbours = (left[:, None] + np.arange(-1, 3)) % coarse
    return neighbours.astype(np.int32), np.stack(weights, axis=1)


@compiled
def interpolate(
    coarse: Any, rows: Any, row_weights: Any, columns: Any, column_weights: Any, out: Any
) -> None:
    """out[i, j] = the weighted sum of the 4 x 4 coarse neighbours."""
    line = np.empty(coarse.shape[1])
    for i in range(out.shape[0]):
        a, b, c, d = coarse[rows[i, 0]], coarse[rows[i, 1]], coarse[rows[i, 2]], coarse[rows[i, 3]]
        w = row_weights[i]
        for j in range(line.size):
            line[j] = w[0] * a[j] + w[1] * b[j] + w[2] * c[j] + w[3] * d[j]
        for j in range(out.shape[1]):
            value = 0.0
            for k in range(4):
                value += column_weights[j, k] * line[columns[j, k]]
            out[i, j] = value
