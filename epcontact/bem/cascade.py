"""From coarse to fine: the same problem on half as many points a direction starts the finer one.

Coarse heights are the fine ones without the modes that the coarse grid cannot hold.  What is
handed down is not the pressure but p - c g, interpolated by cubics: positive in contact, negative
outside and beyond the cap where the pressure is capped, it crosses its bounds where the fronts
are, so the fine grid starts with fronts placed to a fraction of a coarse cell.
"""

from __future__ import annotations

import ducc0
import numpy as np
from numpy.typing import NDArray

from epcontact.bem import passes
from epcontact.bem.passes import Workers
from epcontact.results import FloatArray

#: A direction of at most this many points is not coarsened further.
COARSEST = 32

_BLOCK = 262144  # points that a thread transforms at once


def coarser(shape: tuple[int, int]) -> tuple[int, int] | None:
    """Half as many points in each direction that has enough, rounded up; None: coarse enough."""
    half = tuple((n + 1) // 2 if n > COARSEST else n for n in shape)
    return None if half == shape else (half[0], half[1])


def coarsened_heights(heights: FloatArray, shape: tuple[int, int], workers: Workers) -> FloatArray:
    """`heights` on a coarser grid of the same periods, by leaving out the modes beyond it.

    The unpaired mode of an even number of points is left out too.  The transforms are shared out
    by fixed blocks: the library's own threads group lines, and so round, by their number.
    """
    (nx, ny), (mx, my) = heights.shape, shape
    columns = (my + 1) // 2 if my < ny else my // 2 + 1
    modes = np.zeros((mx, my // 2 + 1), dtype=np.complex128)
    narrow = np.empty((nx, columns), dtype=np.complex128)
    keep = (mx + 1) // 2 if mx < nx else mx
    rows, width = max(1, _BLOCK // ny), max(8, _BLOCK // (2 * nx))
    out = np.empty(shape)

    def along_rows(start: int) -> None:
        wide = ducc0.fft.r2c(heights[start : start + rows], axes=(1,), nthreads=1)
        narrow[start : start + rows] = wide[:, :columns]

    def along_columns(start: int) -> None:
        part = slice(start, min(start + width, columns))
        column = narrow[:, part]
        if nx > 1:
            column = ducc0.fft.c2c(column, axes=(0,), forward=True, nthreads=1)
        modes[:keep, part] = column[:keep]
        if mx < nx and keep > 1:
            modes[1 - keep :, part] = column[1 - keep :]
        modes[:, part] /= nx * ny
        if mx > 1:
            modes[:, part] = ducc0.fft.c2c(modes[:, part], axes=(0,), forward=False, nthreads=1)

    def back_along_rows(start: int) -> None:
        some = slice(start, start + rows)
        out[some] = ducc0.fft.c2r(modes[some], axes=(1,), lastsize=my, forward=False, nthreads=1)

    workers.run(along_rows, range(0, nx, rows))
    workers.run(along_columns, range(0, columns, width))
    workers.run(back_along_rows, range(0, mx, rows))
    return out


def _stencil(coarse: int, fine: int) -> tuple[NDArray[np.int32], FloatArray]:
    """Four coarse neighbours of each fine point, periodically, and their cubic weights."""
    if coarse == fine:
        index = np.repeat(np.arange(fine, dtype=np.int32)[:, None], 4, axis=1)
        return index, np.tile([0.0, 1.0, 0.0, 0.0], (fine, 1))
    position = np.arange(fine) * (coarse / fine)
    left = np.floor(position).astype(np.int32)
    t = position - left
    weights = np.stack(
        [
            -t * (t - 1) * (t - 2) / 6,
            (t + 1) * (t - 1) * (t - 2) / 2,
            -(t + 1) * t * (t - 2) / 2,
            (t + 1) * t * (t - 1) / 6,
        ],
        axis=1,
    )
    index = (left[:, None] + np.arange(-1, 3, dtype=np.int32)) % coarse
    return index.astype(np.int32), weights


def interpolated(coarse: FloatArray, shape: tuple[int, int], workers: Workers) -> FloatArray:
    """A periodic grid on a finer one, by cubics through four neighbours a direction."""
    rows, row_weights = _stencil(coarse.shape[0], shape[0])
    columns, column_weights = _stencil(coarse.shape[1], shape[1])
    out = np.empty(shape)
    step = max(1, 65536 // shape[1])

    def block(start: int) -> None:
        part = slice(start, start + step)
        passes.interpolate(
            coarse, rows[part], row_weights[part], columns, column_weights, out[part]
        )

    workers.run(block, range(0, shape[0], step))
    return out
