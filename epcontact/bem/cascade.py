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

FloatArray = NDArray[np.float64]

#: A direction of at most this many points is not coarsened further.
COARSEST = 32


def coarser(shape: tuple[int, int]) -> tuple[int, int] | None:
    """Half as many points in each direction that has enough, rounded up; None: coarse enough."""
    half = tuple((n + 1) // 2 if n > COARSEST else n for n in shape)
    return None if half == shape else (half[0], half[1])


def coarsened_heights(heights: FloatArray, shape: tuple[int, int], threads: int) -> FloatArray:
    """`heights` on a coarser grid of the same periods, by leaving out the modes beyond it.

    The unpaired mode of an even number of points is left out too.
    """
    (nx, ny), (mx, my) = heights.shape, shape
    columns = (my + 1) // 2 if my < ny else my // 2 + 1
    modes = np.zeros((mx, my // 2 + 1), dtype=np.complex128)
    narrow = np.empty((nx, columns), dtype=np.complex128)
    rows = max(1, 262144 // ny)
    for start in range(0, nx, rows):
        wide = ducc0.fft.r2c(heights[start : start + rows], axes=(1,), nthreads=threads)
        narrow[start : start + rows] = wide[:, :columns]
    if nx > 1:
        ducc0.fft.c2c(narrow, axes=(0,), forward=True, out=narrow, nthreads=threads)
    keep = (mx + 1) // 2 if mx < nx else mx
    modes[:keep, :columns] = narrow[:keep]
    if mx < nx and keep > 1:
        modes[1 - keep :, :columns] = narrow[1 - keep :]
    modes /= nx * ny
    return np.asarray(
        ducc0.fft.c2r(modes, axes=(0, 1), lastsize=my, forward=False, nthreads=threads)
    )


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
