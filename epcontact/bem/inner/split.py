"""A cheap approximation of the compliance of a grid on the elastic set.

The kernel is split by a Gaussian, as in Ewald's sums: the short-range part becomes a stencil of a
few points around each elastic one, the long-range part is smooth and is applied on a grid of
about half as many points a direction, with cubic interpolation from it and its transpose to it:

    S ~ stencil + P G P^T,    G = [S phi + (S (1 - phi) - sigma) sqrt(phi)] / T^2

phi = exp(-(a theta)^2/4), theta the phase per grid point, sigma the symbol of the stencil and T
that of P; the second term of G adds to the coarse grid the part that the cut stencil lacks.  An
application costs a quarter of a pair of transforms, in single precision.  It is off by a few per
cent, which is enough for inner iterations: the displacement of every outer iterate is exact, so
each outer step corrects what the last one left.

The coarse grid of an odd number of points has a size that transforms like, and T is the mean over
the positions that fine points have between coarse ones.  Where the waves along one axis are much
more compliant than those along the other, as where points are closer along it, only the closer
points are halved, and theta is the phase along this axis: the rest of the kernel is short along
both.  A line is such a grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import ducc0
import numpy as np
from numpy.typing import NDArray

from epcontact.bem.transforms import Convolution, Points, Symbol, single_precision
from epcontact.bem.workers import Workers, compiled, ranges, split
from epcontact.results import FloatArray

_WIDTH = 2.0  # a: a larger one lowers the alias of the interpolation, but the stencil grows
_SIDE = 3  # grid points that a stencil reaches to each side
_SAMPLE = 128  # modes in each direction from which the stencil is computed
_FEWEST = 64  # points of a direction that is halved
_POSITIONS = 64  # between coarse points, over which the symbol of interpolation is averaged

#: Columns that a masked grid repeats on its left and right, and the number of points that a stencil
#: handles at once (a register of single precision).
HALO_LEFT, HALO_RIGHT, RUN = 3, 20, 16
# Coarse points under a run and its neighbours: a constant, so that loops over them are unrolled.
_LINE = RUN + 4


def half_shape(symbol: Symbol) -> tuple[int, int] | None:
    """The grid of the long-range part; None where no direction has enough points to be halved.

    Example:
        >>> half_shape(Symbol.from_quarter(np.ones((51, 129)), (101, 256)))
        (54, 128)
    """
    nx, ny = symbol.shape
    if 1 < nx < _FEWEST or ny < _FEWEST:
        return None
    far_x, far_y = symbol.far()
    return nx if far_x else _half(nx), ny if far_y else _half(ny)


def _half(number: int) -> int:
    half = (number + 1) // 2
    return int(ducc0.fft.good_size(half, True)) if number % 2 else half


@dataclass(frozen=True, eq=False)
class Interpolation:
    """Periodic interpolation along one direction, by cubics through four coarse points.

    Attributes:
        first: (n,) the first coarse point of each fine one; it may lie before point 0.
        weights: (n, 4)
        first_fine: (m,) the first fine point that each coarse one serves; also before point 0.
        fine_weights: (m, k) the weights of these fine points, the transpose of `weights`.
    """

    first: NDArray[np.int64]
    weights: NDArray[np.float32]
    first_fine: NDArray[np.int64]
    fine_weights: NDArray[np.float32]

    @classmethod
    def between(cls, coarse: int, fine: int) -> Interpolation:
        """From `coarse` to `fine` points over the same period; equal numbers are the identity."""
        first, weights = cubic_stencil(coarse, fine)
        reach = 2 * fine / coarse
        low = np.floor(np.arange(coarse) * (fine / coarse) - reach).astype(np.int64) + 1
        at = low[:, None] + np.arange(int(np.ceil(2 * reach)))
        tap = np.arange(coarse)[:, None] - (first[at % fine] + at // fine * coarse)
        found = np.where((tap >= 0) & (tap < 4), weights[at % fine, np.clip(tap, 0, 3)], 0.0)
        used = np.flatnonzero(found.any(axis=0))
        found = np.ascontiguousarray(found[:, used[0] : used[-1] + 1], dtype=np.float32)
        return cls(first, weights.astype(np.float32), low + used[0], found)

    def symbol(self, theta: FloatArray) -> FloatArray:
        """The factor of waves of phase `theta` per coarse point: the mean over the fine points."""
        coarse, fine = len(self.first_fine), len(self.first)
        positions = fine // math.gcd(coarse, fine)
        if positions > _POSITIONS:  # they are spread evenly
            t = (np.arange(_POSITIONS) + 0.5) / _POSITIONS
        else:
            t = np.arange(positions) / positions
        offset = (np.arange(-1, 3) - t[:, None]).reshape(-1)
        waves = np.cos(np.outer(theta, offset))
        return np.asarray(waves @ cubic_weights(t).reshape(-1) / t.size, dtype=np.float64)


def cubic_stencil(coarse: int, fine: int) -> tuple[NDArray[np.int64], FloatArray]:
    """The first of four coarse neighbours of each fine point, and their cubic weights."""
    position = np.arange(fine) * (coarse / fine)
    left = np.floor(position).astype(np.int64)
    return left - 1, cubic_weights(position - left)


def cubic_weights(t: FloatArray) -> FloatArray:
    """Weights (n, 4) of the points -1, 0, 1 and 2 in the cubics through them at t in [0, 1)."""
    return np.stack(
        [
            -t * (t - 1) * (t - 2) / 6,
            (t + 1) * (t - 1) * (t - 2) / 2,
            -(t + 1) * t * (t - 2) / 2,
            (t + 1) * t * (t - 1) / 6,
        ],
        axis=1,
    )


class MaskedGrid:
    """A grid in single precision that is 0 except at listed points, the same ones for ever.

    Attributes:
        points: the points.
        columns: ny.
        array: (nx, HALO_LEFT + ny + HALO_RIGHT), the columns at its sides repeated.

    Args:
        points: the points.
        field: (nx, ny) in double precision; the grid is in its memory, unless it is too narrow.
        workers: threads to use.
    """

    def __init__(self, points: Points, field: FloatArray, workers: Workers) -> None:
        nx, self.columns = field.shape
        shape = nx, HALO_LEFT + self.columns + HALO_RIGHT
        memory = field.reshape(-1).view(np.float32)
        if memory.size < math.prod(shape):
            memory = np.empty(math.prod(shape), dtype=np.float32)
        self.array = memory[: math.prod(shape)].reshape(shape)
        self.array.fill(0)
        self.points, self._workers = points, workers

    def put(self, values: FloatArray) -> None:
        """Set the values at the points."""
        at = self.points
        self._workers.each(put_single, self.array, *at.split(at.index, values))


class SplitOperator:
    """The approximate compliance of a grid on listed points.

    The counterpart of `Convolution.apply_on`, with the same units.

    Attributes:
        masked: of the points to which it is applied; to be set before.
    """

    masked: MaskedGrid

    def __init__(self, convolution: Convolution, half: tuple[int, int]) -> None:
        self.workers = convolution.workers
        taps, coarse, self._rows, self._columns = convolution.symbol.once(_parts, half)
        self._taps = (taps * convolution.scale).astype(np.float32)
        self._coarse = single_precision(coarse, convolution.scale, self.workers)
        self._half = np.empty(half, dtype=np.float32)
        step = max(1, convolution.row_step * half[0] // convolution.shape[0])
        self._parts = ranges(half[0], step)

    @property
    def pairs(self) -> float:
        """Pairs of transforms, in pairs of the fine grid."""
        return (
            self._coarse.pairs * self._half.size / len(self._rows.first) / len(self._columns.first)
        )

    def apply_on(
        self, points: Points, values: FloatArray, out: FloatArray, other: FloatArray
    ) -> tuple[float, float]:
        """Apply S approximately to a field that is `values` at the points and 0 elsewhere.

        out: the result at the points, overwritten.  Returns sum(out) and sum(out other).
        """
        masked, half, rows, columns = self.masked.array, self._half, self._rows, self._columns
        self.masked.put(values)
        coarse_rows = (split(a, self._parts) for a in (half, rows.first_fine, rows.fine_weights))
        self.workers.each(restrict, masked, *coarse_rows, columns.first_fine, columns.fine_weights)
        self._coarse.apply(half, half)
        index, out_, other_ = points.split(points.index, out, other)
        total, product = self.workers.total(
            gather_split, masked.reshape(-1), half.reshape(-1), self._taps,
            rows.first, rows.weights, columns.first, columns.weights, half.shape,
            index, out_, other_,
        )  # fmt: skip
        return total, product


def _parts(
    symbol: Symbol, half: tuple[int, int]
) -> tuple[FloatArray, Symbol, Interpolation, Interpolation]:
    """Stencil, coarse symbol, and interpolation of rows and of columns."""
    (nx, ny), (mx, my) = symbol.shape, half
    rows, columns = Interpolation.between(mx, nx), Interpolation.between(my, ny)
    sample, (sx, sy), _ = symbol.sampled(_SAMPLE)
    i, j = np.arange(mx // 2 + 1), np.arange(my // 2 + 1)
    tx, ty = 2 * np.pi * i / nx, 2 * np.pi * j / ny
    coarse = symbol.values[symbol.rows[: i.size], : j.size].copy()
    coarse[0, 0] = sample[0, 0] = 0.0
    width = np.array([mx < nx, my < ny]) * _WIDTH**2 / 4

    def gaussian(x: FloatArray, y: FloatArray) -> FloatArray:
        return np.asarray(np.exp(-width[0] * x[:, None] ** 2 - width[1] * y**2))

    taps = _stencil(sample * (1 - gaussian(sx, sy)), symbol.shape)
    phi = gaussian(tx, ty)
    rest = coarse * (1 - phi) - _stencil_symbol(taps, tx, ty)
    along_x, along_y = rows.symbol(2 * np.pi * i / mx), columns.symbol(2 * np.pi * j / my)
    interpolation = np.outer(along_x, along_y) ** 2 * (nx * ny / (mx * my))
    coarse = np.maximum((coarse * phi + rest * np.sqrt(phi)) / interpolation, 0.0)
    coarse[0, 0] = 0.0
    return taps, Symbol.from_quarter(coarse, half), rows, columns


def _stencil(part: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """The kernel within its reach, from its symbol on a quarter of sampled modes."""
    waves, reach = [], [min(_SIDE, (n - 1) // 2) for n in shape]
    for n, side in zip(shape, reach, strict=True):
        count = min(n, _SAMPLE)
        theta, i = 2 * np.pi * np.arange(count // 2 + 1) / count, np.arange(-side, side + 1)
        weight = np.where((theta == 0) | (theta == np.pi), 1.0, 2.0) / count
        waves.append(weight[:, None] * np.cos(theta[:, None] * i))
    taps = waves[0].T @ part @ waves[1]
    x, y = (np.arange(-side, side + 1) for side in reach)
    taps[x[:, None] ** 2 + y**2 > _SIDE**2] = 0.0
    return np.asarray(taps, dtype=np.float64)


def _stencil_symbol(taps: FloatArray, tx: FloatArray, ty: FloatArray) -> FloatArray:
    x, y = (np.arange(n) - n // 2 for n in taps.shape)
    return np.asarray(np.cos(np.outer(tx, x)) @ taps @ np.cos(np.outer(y, ty)), dtype=np.float64)


@compiled
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


@compiled
def restrict(
    masked: Any, half: Any, first_row: Any, row_weights: Any, first_column: Any, weights: Any
) -> None:
    """half = P^T masked for the rows whose first fine rows are listed, P being interpolation."""
    nx = masked.shape[0]
    line = np.empty(masked.shape[1], dtype=np.float32)
    for row in range(half.shape[0]):
        line[:] = 0
        for k in range(row_weights.shape[1]):
            weight = row_weights[row, k]
            if weight != 0:
                fine = masked[(first_row[row] + k) % nx]
                for j in range(line.size):
                    line[j] += weight * fine[j]
        for j in range(half.shape[1]):
            at = _UINT(first_column[j] + HALO_LEFT)
            value = np.float32(0)
            for k in range(_UINT(weights.shape[1])):
                value += weights[j, k] * line[at + k]
            half[row, j] = value


# Unsigned indices cannot count from the end, so the loops below need no test for it, which would
# keep them from vectorising; flat arrays save views.
_UINT = np.uint64


@compiled
def gather_split(  # noqa: PLR0913, PLR0917 - one loop: cut into functions it took longer
    fine: Any,
    coarse: Any,
    taps: Any,
    first_row: Any,
    row_weights: Any,
    first_column: Any,
    column_weights: Any,
    half: tuple[int, int],
    index: Any,
    out: Any,
    other: Any,
) -> tuple[float, float]:
    """out = the stencil on the fine grid plus the coarse one interpolated, at the listed points.

    fine: the masked grid in one dimension; coarse: the grid of the shape `half`, too.  Listed
    points among RUN neighbours of a row are handled together.  Returns sum(out) and sum(out other).
    """
    nx, ny = first_row.size, first_column.size
    width = ny + HALO_LEFT + HALO_RIGHT
    mx, my = half
    reach = taps.shape[0] // 2
    near = np.empty(RUN, dtype=np.float32)
    line = np.empty(_LINE, dtype=np.float32)
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
            tap = a + reach
            c0, c1, c2, c3 = taps[tap, 3], taps[tap, 2], taps[tap, 1], taps[tap, 0]
            for t in range(_UINT(RUN)):
                at = base + t
                near[t] += (
                    c0 * fine[at + _UINT(3)]
                    + c1 * (fine[at + _UINT(2)] + fine[at + _UINT(4)])
                    + c2 * (fine[at + _UINT(1)] + fine[at + _UINT(5)])
                    + c3 * (fine[at] + fine[at + _UINT(6)])
                )
        # line: the coarse grid interpolated to this row.
        start = first_column[j]
        inside = start >= 0 and start + _LINE <= my
        line[:] = 0
        for a in range(4):
            weight = row_weights[i, a]
            if weight != 0:
                begin = (first_row[i] + a) % mx * my
                if inside:
                    base = _UINT(begin + start)
                    for t in range(_UINT(_LINE)):
                        line[t] += weight * coarse[base + t]
                else:
                    for t in range(_LINE):
                        line[t] += weight * coarse[begin + (start + t) % my]
        origin = index[k] - j
        for m in range(k, last + 1):
            column = index[m] - origin
            c = _UINT(first_column[column] - start)
            value = near[column - j]
            for t in range(_UINT(4)):
                value += column_weights[column, t] * line[c + t]
            out[m] = value
            total += value
            product += value * other[m]
        k = last + 1
    return total, product
