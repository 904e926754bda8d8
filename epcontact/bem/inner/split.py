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

# a of the Gaussian.  A larger one lowers the alias of the interpolation, but needs a
# larger stencil.
_WIDTH = 2.0
_SAMPLE = 128  # modes in each direction from which the stencil is computed
# Smaller grids, and larger fractions of elastic points, are faster by transforms in
# single precision.
_FEWEST = 64
_MOST_ELASTIC = 0.06
# From so many points on grids are not in cache.  Transforms are then slower, and more
# elastic points pay.
_LARGE = 1 << 20
_MOST_ELASTIC_IF_LARGE = 0.15
#: Grid points that a stencil reaches to each side.
REACH = 3
#: Points that a stencil handles at once: a register of single precision.
RUN = 16
#: Columns that a masked grid repeats on its left and right.
LEFT = REACH
RIGHT = RUN + REACH
# Weights of the cubic through four coarse points in their middle: -FAR, NEAR, NEAR,
# -FAR.
_NEAR = np.float32(9 / 16)
_FAR = np.float32(1 / 16)
# Unsigned indices need no test for a negative one that would keep a loop from
# vectorising.
_UINT = np.uint64
_RUN = np.uint64(RUN)
# Functions that are compiled into their callers.  As functions of their own, kernels
# loaded from the cache would round differently from those just compiled.
inlined = numba.njit(inline="always")


def split_pays(symbol: Symbol, elastic: int) -> bool:
    """Return True if `SplitOperator` is faster than transforms in single precision.

    The result is False if the grid has an odd number of points along a side, is small,
    or has points that are much farther apart along one axis than along the other.

    symbol: compliance of each mode of the grid; elastic: number of elastic points.
    """
    nx, ny = symbol.shape
    if nx % 2 or ny % 2 or min(nx, ny) < _FEWEST or any(symbol.far()):
        return False
    most = _MOST_ELASTIC if nx * ny < _LARGE else _MOST_ELASTIC_IF_LARGE
    return elastic <= most * nx * ny


class MaskedGrid:
    """A grid in single precision that is 0 except at listed points.

    Attributes:
        array: (nx, LEFT + ny + RIGHT), with the columns at its sides repeated.
        columns: ny.
        points: the listed points, which do not change.
    """

    def __init__(self, points: Points, field: FloatArray, workers: Workers) -> None:
        """Create the grid in the memory of `field`, or in new memory if that is small.

        points: the listed points; field: (nx, ny) in double precision, which is
        overwritten; workers: threads that write values.
        """
        nx, self.columns = field.shape
        width = self.columns + LEFT + RIGHT
        memory = field.reshape(-1).view(np.float32)
        if memory.size < nx * width:
            memory = np.empty(nx * width, dtype=np.float32)
        self.array = memory[: nx * width].reshape(nx, width)
        self.array.fill(0)
        self.points = points
        self._workers = workers

    def put(self, values: FloatArray) -> None:
        """Write values (points,) to the listed points of the grid, in order."""
        index, blocks = self.points.split(self.points.index, values)
        self._workers.each(put_single, self.array, index, blocks)


class SplitOperator:
    """The cheap counterpart of `Convolution.apply_on`.

    Attributes:
        masked: a masked grid of the points, to be set before the operator is applied.
    """

    masked: MaskedGrid

    def __init__(self, convolution: Convolution) -> None:
        """Prepare the approximation of the operator `convolution`.

        convolution: on a grid with an even number of points along each side.
        """
        self.workers = convolution.workers
        taps, coarse = convolution.symbol.once(_parts)
        self._taps = (taps * convolution.scale).astype(np.float32)
        self._coarse = single_precision(coarse, convolution.scale, self.workers)
        self._half = np.empty(coarse.shape, dtype=np.float32)
        self._rows = ranges(coarse.shape[0], max(1, convolution.row_step // 2))

    @property
    def pairs(self) -> float:
        """Cost so far, in pairs of transforms (one and one back) of the fine grid."""
        return self._coarse.pairs / 4

    def apply_on(
        self, points: Points, values: FloatArray, out: FloatArray, other: FloatArray
    ) -> tuple[float, float]:
        """Apply the compliance approximately to values at points alone.

        Arrays are (points,).

        Args:
            points: the points; `masked` must be a grid of the same points.
            values: pressures at the points; the pressure is 0 elsewhere.
            out: overwritten by the displacements at the points.
            other: values by which the result is multiplied.

        Returns:
            The sum of `out`, and that of `out` times `other`.
        """
        fine = self.masked.array
        half = self._half
        self.masked.put(values)
        first = [rows.start for rows in self._rows]
        self.workers.each(restrict, fine, first, split(half, self._rows))
        self._coarse.apply(half, half)
        lists = points.split(points.index, out, other)
        total, product = self.workers.total(
            gather_split, fine, half, self._taps, *lists
        )
        return total, product


def _parts(symbol: Symbol) -> tuple[FloatArray, Symbol]:
    """Return the stencil of near points and the compliance of the half grid.

    The stencil has 2 REACH + 1 values to a side.  The half grid has half as many points
    along each direction; its compliance G is that of the module.

    symbol: compliance of each mode of the grid.
    """
    nx, ny = symbol.shape
    # The stencil is the short-range part of the kernel within its reach.
    sample, phases, weights = symbol.sampled(_SAMPLE)
    sample[0, 0] = 0.0
    at = np.arange(-REACH, REACH + 1)
    along, across = (
        weight * np.cos(np.outer(at, theta))
        for theta, weight in zip(phases, weights, strict=True)
    )
    taps = along @ (sample * (1 - _gaussian(*phases))) @ across.T
    taps[at[:, None] ** 2 + at**2 > REACH**2] = 0.0
    # The long-range part, with what the stencil lacks of the short-range one.
    i = np.arange(nx // 4 + 1)
    j = np.arange(ny // 4 + 1)
    x = 2 * np.pi * i / nx
    y = 2 * np.pi * j / ny
    coarse = symbol.values[symbol.rows[: i.size], : j.size].copy()
    coarse[0, 0] = 0.0
    phi = _gaussian(x, y)
    stencil = np.cos(np.outer(x, at)) @ taps @ np.cos(np.outer(at, y))
    rest = coarse * (1 - phi) - stencil
    # Half of the fine points lie on coarse ones, half between four: weights (-1, 9, 9,
    # -1)/16.
    cubic_x, cubic_y = (0.5 + (9 * np.cos(t) - np.cos(3 * t)) / 16 for t in (x, y))
    coarse = coarse * phi + rest * np.sqrt(phi)
    coarse /= 4 * np.outer(cubic_x, cubic_y) ** 2
    coarse[0, 0] = 0.0
    return taps, Symbol.from_quarter(np.maximum(coarse, 0.0), (nx // 2, ny // 2))


def _gaussian(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return phi (m, n), the fraction of the compliance that is long-range.

    x: (m,) phase of a mode from point to point along x, in rad; y: (n,) along y.
    """
    return np.asarray(np.exp(-(_WIDTH**2) / 4 * (x[:, None] ** 2 + y**2)))


@compiled
def put_single(masked: Any, index: Any, values: Any) -> None:
    """Write values to listed points of a masked grid, and to its repeated columns.

    masked: (nx, LEFT + ny + RIGHT) grid, see `MaskedGrid`; index: (points,) flat
    indices of the points in the grid (nx, ny); values: (points,).
    """
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
    """Write rows of the half grid: sums of fine points up to 3 away, with weights.

    This is the transpose P^T of the cubic interpolation P from the half grid.

    masked: (nx, LEFT + ny + RIGHT) fine grid, see `MaskedGrid`; first: number of the
    first row; half: (rows, ny // 2) rows of the half grid, overwritten.
    """
    nx = masked.shape[0]
    line = np.empty(masked.shape[1], dtype=np.float32)
    for row in range(half.shape[0]):
        i = 2 * (first + row)
        here = masked[i]
        up = masked[(i - 1) % nx]
        down = masked[(i + 1) % nx]
        above = masked[(i - 3) % nx]
        below = masked[(i + 3) % nx]
        for j in range(line.size):
            line[j] = here[j] + _NEAR * (up[j] + down[j]) - _FAR * (above[j] + below[j])
        for j in range(half.shape[1]):
            at = 2 * j + LEFT
            near = line[at - 1] + line[at + 1]
            far = line[at - 3] + line[at + 3]
            half[row, j] = line[at] + _NEAR * near - _FAR * far


@compiled
def gather_split(
    fine: Any, coarse: Any, taps: Any, index: Any, out: Any, other: Any
) -> tuple[float, float]:
    """Write the stencil plus the interpolated half grid at listed points to `out`.

    Returns sum(out) and sum(out other).  Points among RUN neighbours of a row are
    handled together.

    fine: (nx, LEFT + ny + RIGHT) grid, see `MaskedGrid`; coarse: (nx // 2, ny // 2)
    the half grid; taps: (2 REACH + 1, 2 REACH + 1) the stencil; index: (points,) flat
    indices of the points in the grid (nx, ny), ascending; out, other: (points,).
    """
    nx = fine.shape[0]
    ny = fine.shape[1] - LEFT - RIGHT
    near = np.empty(RUN, dtype=np.float32)
    total = product = 0.0
    k = 0
    while k < index.size:
        i = index[k] // ny
        first = index[k] - i * ny
        near[:] = 0
        for a in range(-REACH, REACH + 1):
            row = i + a
            if row < 0:
                row += nx
            elif row >= nx:
                row -= nx
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
    """Add the products of one row of a stencil to the results of RUN neighbours.

    near: (RUN,) results, changed in place; row: values of the grid, from REACH columns
    before the first of the RUN points; tap: (2 REACH + 1,) symmetric row of the
    stencil.
    """
    c0 = tap[3]  # the centre; c1 to c3 are those of points 1 to 3 columns away
    c1 = tap[2]
    c2 = tap[1]
    c3 = tap[0]
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
    """Return the half grid at a fine point, by cubic interpolation along both axes.

    coarse: (nx // 2, ny // 2) periodic; i, j: row and column of the fine point.
    """
    row = i // 2
    if i % 2 == 0:
        return along_row(coarse[row], j)
    before, after, beyond = around(row, coarse.shape[0])
    near = along_row(coarse[row], j) + along_row(coarse[after], j)
    far = along_row(coarse[before], j) + along_row(coarse[beyond], j)
    return _NEAR * near - _FAR * far


@inlined
def along_row(row: Any, j: int) -> Any:
    """Return one row of the half grid at a fine column, by cubic interpolation.

    row: (ny // 2,) periodic; j: column of the fine grid.
    """
    k = j // 2
    if j % 2 == 0:
        return row[k]
    before, after, beyond = around(k, row.size)
    return _NEAR * (row[k] + row[after]) - _FAR * (row[before] + row[beyond])


@inlined
def around(k: int, size: int) -> tuple[int, int, int]:
    """Return the indices k - 1, k + 1 and k + 2 in a periodic array of a given size."""
    last = size - 1
    before = k - 1 if k else last
    after = k + 1 if k < last else 0
    beyond = after + 1 if after < last else 0
    return before, after, beyond
