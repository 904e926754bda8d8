"""A cheap approximation of the compliance of a grid on few elastic points.

The kernel is split by a Gaussian, as in Ewald's sums: the short-range part becomes a
stencil of a few points around each elastic one, the long-range part is smooth and is
applied on a grid of half as many points a direction, with cubic interpolation P from it
and its transpose to it:

    S ~ stencil + P G P^T,    G = [S phi + (S (1 - phi) - sigma) sqrt(phi)] / T^2

phi = exp(-(a theta)^2/4), theta the phase per grid point, sigma the symbol of the
stencil and T that of P; the second term of G adds the part that the cut stencil lacks.
It is off by a few per cent, which is enough for inner iterations: the displacement of
every outer iterate is exact.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from epcontact.bem.transforms import Convolution, Points, Symbol, single_precision
from epcontact.bem.workers import Workers, compiled, ranges, split
from epcontact.results import FloatArray

_WIDTH = (
    2.0  # a: a larger one lowers the alias of the interpolation, but the stencil grows
)
_SAMPLE = 128  # modes in each direction from which the stencil is computed
# Smaller grids, and larger shares of elastic points, are faster by transforms in single
# precision. From the second size on, where grids are not in cache, transforms are
# slower.
_FEWEST, _LARGE = 64, 1 << 20
_MOST_ELASTIC = 0.06, 0.15
#: Grid points that a stencil reaches to each side, points that it handles at once (a
#: register of single precision), and columns that a masked grid repeats on its left and
#: right.
REACH, RUN = 3, 16
LEFT, RIGHT = REACH, RUN + REACH
# Weights of the cubic through four coarse points in their middle: -FAR, NEAR, NEAR,
# -FAR.
_NEAR, _FAR = np.float32(9 / 16), np.float32(1 / 16)
# Unsigned indices need no test for a negative one that would keep a loop from
# vectorising.
_UINT, _RUN = np.uint64, np.uint64(RUN)
# Compiled with what calls it: of functions of their own, kernels that are loaded would
# round differently from those just compiled.
inlined = numba.njit(inline="always")


def split_pays(symbol: Symbol, elastic: int) -> bool:
    """True if the split operator is faster on so many points than single precision.
    The grid's sides must be even, and its points about as far apart along both.
    """
    nx, ny = symbol.shape
    fits = (
        nx % 2 == ny % 2 == 0
        and min(nx, ny) >= _FEWEST
        and symbol.far() == (False, False)
    )
    return fits and elastic <= _MOST_ELASTIC[nx * ny >= _LARGE] * nx * ny


class MaskedGrid:
    """A grid in single precision that is 0 except at listed points, the same ones for
    ever. `array` (nx, LEFT + ny + RIGHT), with the columns at its sides repeated, is in
    the memory of `field` (nx, ny), which is in double precision, unless this is too
    narrow.
    """

    def __init__(self, points: Points, field: FloatArray, workers: Workers) -> None:
        nx, self.columns = field.shape
        width = self.columns + LEFT + RIGHT
        memory = field.reshape(-1).view(np.float32)
        if memory.size < nx * width:
            memory = np.empty(nx * width, dtype=np.float32)
        self.array = memory[: nx * width].reshape(nx, width)
        self.array.fill(0)
        self.points, self._workers = points, workers

    def put(self, values: FloatArray) -> None:
        """Set the values at the points."""
        at = self.points
        self._workers.each(put_single, self.array, *at.split(at.index, values))


class SplitOperator:
    """The counterpart of `Convolution.apply_on`; `masked` is to be set before it is
    applied.
    """

    masked: MaskedGrid

    def __init__(self, convolution: Convolution) -> None:
        self.workers = convolution.workers
        taps, coarse = convolution.symbol.once(_parts)
        self._taps = (taps * convolution.scale).astype(np.float32)
        self._coarse = single_precision(coarse, convolution.scale, self.workers)
        self._half = np.empty(coarse.shape, dtype=np.float32)
        self._rows = ranges(coarse.shape[0], max(1, convolution.row_step // 2))

    @property
    def pairs(self) -> float:
        """Pairs of transforms, in pairs of the fine grid."""
        return self._coarse.pairs / 4

    def apply_on(
        self, points: Points, values: FloatArray, out: FloatArray, other: FloatArray
    ) -> tuple[float, float]:
        """out = S values at the points, approximately; returns sum(out) and sum(out
        other).
        """
        masked, half = self.masked.array, self._half
        self.masked.put(values)
        first = [rows.start for rows in self._rows]
        self.workers.each(restrict, masked, first, split(half, self._rows))
        self._coarse.apply(half, half)
        lists = points.split(points.index, out, other)
        total, product = self.workers.total(
            gather_split, masked, half, self._taps, *lists
        )
        return total, product


def _parts(symbol: Symbol) -> tuple[FloatArray, Symbol]:
    """The stencil, and the symbol of the half grid."""
    nx, ny = symbol.shape
    sample, phases, weights = symbol.sampled(_SAMPLE)
    i, j = np.arange(nx // 4 + 1), np.arange(ny // 4 + 1)
    x, y = 2 * np.pi * i / nx, 2 * np.pi * j / ny
    coarse = symbol.values[symbol.rows[: i.size], : j.size].copy()
    coarse[0, 0] = sample[0, 0] = 0.0
    phi, at = _gaussian(x, y), np.arange(-REACH, REACH + 1)
    pairs = zip(phases, weights, strict=True)
    along, across = (weight * np.cos(np.outer(at, theta)) for theta, weight in pairs)
    taps = (
        along @ (sample * (1 - _gaussian(*phases))) @ across.T
    )  # the kernel within its reach
    taps[at[:, None] ** 2 + at**2 > REACH**2] = 0.0
    short = np.cos(np.outer(x, at)) @ taps @ np.cos(np.outer(at, y))
    rest = coarse * (1 - phi) - short
    # Half of the fine points lie on coarse ones, half between four: weights (-1, 9, 9,
    # -1)/16.
    along_x, along_y = (0.5 + (9 * np.cos(t) - np.cos(3 * t)) / 16 for t in (x, y))
    coarse = (coarse * phi + rest * np.sqrt(phi)) / (
        4 * np.outer(along_x, along_y) ** 2
    )
    coarse[0, 0] = 0.0
    return taps, Symbol.from_quarter(np.maximum(coarse, 0.0), (nx // 2, ny // 2))


def _gaussian(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-(_WIDTH**2) / 4 * (x[:, None] ** 2 + y**2)))


@compiled
def put_single(masked: Any, index: Any, values: Any) -> None:
    """masked = values at the listed points of the grid, and in its repeated columns."""
    ny = masked.shape[1] - LEFT - RIGHT
    for k in range(index.size):
        i = index[k] // ny
        j = index[k] - i * ny
        masked[i, j + LEFT] = values[k]
        if j < RIGHT:
            masked[i, j + LEFT + ny] = values[k]
        if j >= ny - LEFT:
            masked[i, j + LEFT - ny] = values[k]


@compiled
def restrict(masked: Any, first: int, half: Any) -> None:
    """half = P^T masked for rows from `first` on: the weights of coarse points -3 to 3
    away.
    """
    nx = masked.shape[0]
    line = np.empty(masked.shape[1], dtype=np.float32)
    for row in range(half.shape[0]):
        i = 2 * (first + row)
        here, up, down = masked[i], masked[(i - 1) % nx], masked[(i + 1) % nx]
        above, below = masked[(i - 3) % nx], masked[(i + 3) % nx]
        for j in range(line.size):
            line[j] = here[j] + _NEAR * (up[j] + down[j]) - _FAR * (above[j] + below[j])
        for j in range(half.shape[1]):
            at = 2 * j + LEFT
            pair, outer = line[at - 1] + line[at + 1], line[at - 3] + line[at + 3]
            half[row, j] = line[at] + _NEAR * pair - _FAR * outer


@compiled
def gather_split(
    fine: Any, coarse: Any, taps: Any, index: Any, out: Any, other: Any
) -> tuple[float, float]:
    """out = the stencil on the fine grid plus the coarse one interpolated, at the
    listed points. Those among RUN neighbours of a row are handled together.  Returns
    sum(out), sum(out other).
    """
    nx, ny = fine.shape[0], fine.shape[1] - LEFT - RIGHT
    near = np.empty(RUN, dtype=np.float32)
    total, product, k = 0.0, 0.0, 0
    while k < index.size:
        i = index[k] // ny
        first = index[k] - i * ny
        near[:] = 0
        for a in range(-REACH, REACH + 1):
            row = i + a
            row = row + nx if row < 0 else (row - nx if row >= nx else row)
            add_row(near, fine[row, first:], taps[a + REACH])
        stop = index[k] + min(RUN, ny - first)
        while k < index.size and index[k] < stop:
            j = index[k] - i * ny
            value = near[j - first] + interpolated_at(coarse, i, j)
            out[k] = value
            total += value
            product += value * other[k]
            k += 1
    return total, product


@inlined
def add_row(near: Any, row: Any, tap: Any) -> None:
    """Add a row of the stencil at RUN points; `row` begins REACH columns before the
    first.
    """
    c0, c1, c2, c3 = tap[3], tap[2], tap[1], tap[0]
    for t in range(_RUN):
        at = _UINT(t)
        near[t] += (
            c0 * row[at + _UINT(3)]
            + c1 * (row[at + _UINT(2)] + row[at + _UINT(4)])
            + c2 * (row[at + _UINT(1)] + row[at + _UINT(5)])
            + c3 * (row[at] + row[at + _UINT(6)])
        )


@inlined
def interpolated_at(coarse: Any, i: int, j: int) -> Any:
    """The coarse grid interpolated to a fine point, by cubics where it lies between."""
    row, last = i // 2, coarse.shape[0] - 1
    if i % 2 == 0:
        return along_row(coarse[row], j)
    before, after = row - 1 if row else last, row + 1 if row < last else 0
    beyond = after + 1 if after < last else 0
    near = along_row(coarse[row], j) + along_row(coarse[after], j)
    far = along_row(coarse[before], j) + along_row(coarse[beyond], j)
    return _NEAR * near - _FAR * far


@inlined
def along_row(row: Any, j: int) -> Any:
    """A row of the coarse grid interpolated to a column of the fine one."""
    k, last = j // 2, row.size - 1
    if j % 2 == 0:
        return row[k]
    before, after = k - 1 if k else last, k + 1 if k < last else 0
    beyond = after + 1 if after < last else 0
    return _NEAR * (row[k] + row[after]) - _FAR * (row[before] + row[beyond])
