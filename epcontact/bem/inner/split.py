"""A cheap approximation of the compliance of a grid on the elastic set.

The kernel is split by a Gaussian, as in Ewald's sums: the short-range part becomes a stencil of a
few points around each elastic one, the long-range part is smooth and is applied on the grid of
half as many points a direction, with cubic interpolation from it and its transpose to it:

    S ~ stencil + P G P^T,    G = [S phi + (S (1 - phi) - sigma) sqrt(phi)] / T^2

phi = exp(-(a theta)^2/4), theta the phase per grid point, sigma the symbol of the stencil and T
that of P; the second term of G adds to the coarse grid the part that the cut stencil lacks.  An
application costs a quarter of a pair of transforms, in single precision.  It is off by a few per
cent, which is enough for inner iterations: the displacement of every outer iterate is exact, so
each outer step corrects what the last one left.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from epcontact.bem.transforms import Convolution, Points, Symbol
from epcontact.bem.workers import Workers, compiled, ranges, split
from epcontact.results import FloatArray

_WIDTH = 2.0  # a: a larger one lowers the alias of the interpolation, but the stencil grows
_SIDE = 3  # grid points that a stencil reaches to each side
_SAMPLE = 128  # modes in each direction from which the stencil is computed

#: Columns that a masked grid repeats on its left and right, and the number of points that a stencil
#: handles at once (a register of single precision).
HALO_LEFT, HALO_RIGHT, RUN = 3, 20, 16
# Points of the half grid along a run with their neighbours, and the midpoints between them:
# constants, so that the loops over them are unrolled.
_LINE, _MIDDLE = RUN // 2 + 4, RUN // 2 + 1

# Weights of cubic interpolation midway between points.
_INNER, _OUTER = np.float32(9 / 16), np.float32(-1 / 16)


def splittable(shape: tuple[int, int]) -> bool:
    """True if a grid has an exact half, and enough points for the split to pay."""
    return min(shape) >= 64 and shape[0] % 2 == 0 and shape[1] % 2 == 0


class MaskedGrid:
    """A grid in single precision that is 0 except at listed points.

    Attributes:
        array: (nx, HALO_LEFT + ny + HALO_RIGHT), the columns at its sides repeated.
    """

    def __init__(self, shape: tuple[int, int], workers: Workers) -> None:
        self.array = np.zeros((shape[0], HALO_LEFT + shape[1] + HALO_RIGHT), dtype=np.float32)
        self._workers = workers
        self._points: Points | None = None

    def put(self, points: Points, values: FloatArray) -> None:
        """Set the values at the points, and 0 elsewhere."""
        if self._points is not points:
            if self._points is not None:
                self._write(self._points, np.zeros(self._points.index.size))
            self._points = points
        self._write(points, values)

    def _write(self, points: Points, values: FloatArray) -> None:
        self._workers.each(put_single, self.array, *points.split(points.index, values))


class SplitOperator:
    """The approximate compliance of a grid on listed points.

    The counterpart of `Convolution.apply_on`, with the same units.
    """

    def __init__(self, convolution: Convolution, masked: MaskedGrid) -> None:
        nx, ny = convolution.shape
        self.workers, self._masked = convolution.workers, masked
        half = (nx // 2, ny // 2)
        taps, coarse = _halves(convolution.symbol)
        self._taps = (taps * convolution.scale).astype(np.float32)
        self._coarse = _single(coarse, half, convolution.scale, self.workers)
        self._half = np.empty(half, dtype=np.float32)
        self._rows = ranges(half[0], max(1, convolution.row_step // 2))

    @property
    def pairs(self) -> float:
        """Pairs of transforms, in pairs of the fine grid."""
        return self._coarse.pairs / 4

    def apply_on(
        self, points: Points, values: FloatArray, out: FloatArray, other: FloatArray
    ) -> tuple[float, float]:
        """Apply S approximately to a field that is `values` at the points and 0 elsewhere.

        out: the result at the points, overwritten.  Returns sum(out) and sum(out other).
        """
        masked, half = self._masked.array, self._half
        self._masked.put(points, values)
        first = [rows.start for rows in self._rows]
        self.workers.each(restrict, masked, split(half, self._rows), first)
        self._coarse.apply(half, half)
        index, out_, other_ = points.split(points.index, out, other)
        total, product = self.workers.total(
            gather_split, masked, half, self._taps, index, out_, other_
        )
        return total, product


def _single(
    quarter: FloatArray, shape: tuple[int, int], scale: float, workers: Workers
) -> Convolution:
    """The coarse part in single precision, its symbol brought to order one."""
    largest = float(quarter.max())
    symbol = Symbol.from_quarter((quarter / largest).astype(np.float32), shape)
    return Convolution(symbol, scale * largest, workers, np.float32)


def _halves(symbol: Symbol) -> tuple[FloatArray, FloatArray]:
    """Stencil and coarse symbol (a quarter of the modes)."""
    nx, ny = symbol.shape
    k = np.arange(_SAMPLE // 2 + 1)
    sample = symbol.values[np.ix_(symbol.rows[np.rint(k * nx / _SAMPLE).astype(int)],
                                  np.rint(k * ny / _SAMPLE).astype(int))]  # fmt: skip
    theta = 2 * np.pi * k / _SAMPLE
    coarse = symbol.values[symbol.rows[: nx // 4 + 1], : ny // 4 + 1].copy()
    tx, ty = 2 * np.pi * np.arange(nx // 4 + 1) / nx, 2 * np.pi * np.arange(ny // 4 + 1) / ny
    coarse[0, 0] = sample[0, 0] = 0.0
    taps = _stencil(sample, theta)
    phi = np.exp(-(_WIDTH**2) / 4 * (tx[:, None] ** 2 + ty**2))
    rest = coarse * (1 - phi) - _stencil_symbol(taps, tx, ty)
    interpolation = np.outer(_interpolation_symbol(tx), _interpolation_symbol(ty))
    coarse = np.maximum((coarse * phi + rest * np.sqrt(phi)) * 4 / interpolation**2, 0.0)
    coarse[0, 0] = 0.0
    return taps, coarse


def _stencil(part: FloatArray, theta: FloatArray) -> FloatArray:
    """The short-range part's kernel within its reach, from its symbol on a quarter."""
    phi = np.exp(-(_WIDTH**2) / 4 * (theta[:, None] ** 2 + theta**2))
    weight = np.where((theta == 0) | (theta == theta[-1]), 1.0, 2.0) / _SAMPLE
    i = np.arange(-_SIDE, _SIDE + 1)
    wave = weight[:, None] * np.cos(theta[:, None] * i)
    taps = wave.T @ (part * (1 - phi)) @ wave
    taps[i[:, None] ** 2 + i**2 > _SIDE**2] = 0.0
    return np.asarray(taps, dtype=np.float64)


def _stencil_symbol(taps: FloatArray, tx: FloatArray, ty: FloatArray) -> FloatArray:
    i = np.arange(-_SIDE, _SIDE + 1)
    return np.asarray(np.cos(np.outer(tx, i)) @ taps @ np.cos(np.outer(i, ty)), dtype=np.float64)


def _interpolation_symbol(theta: FloatArray) -> FloatArray:
    """Symbol of cubic interpolation to twice as many points, whose weights are 1 and -1/16, 9/16,
    9/16, -1/16."""
    return np.asarray(1 + 9 / 8 * np.cos(theta) - 1 / 8 * np.cos(3 * theta), dtype=np.float64)


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
def restrict(masked: Any, half: Any, first: int) -> None:
    """half = P^T masked for its rows from `first` on, P being cubic interpolation (periodic)."""
    nx = masked.shape[0]
    width = 2 * half.shape[1] + 6
    line = np.empty(width, dtype=np.float32)
    for row in range(half.shape[0]):
        i = 2 * (first + row)
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


# Unsigned indices cannot count from the end, so the loops below need no test for it, which would
# keep them from vectorising; flat arrays save views.
_UINT = np.uint64


@compiled
def _around_the_edge(
    half: Any, my: int, rows: tuple[int, int, int, int], first: int, line: Any
) -> None:
    """Interpolate the half grid midway between rows, at periodic columns from `first` on.

    rows: flat indices of the first points of the four rows."""
    a, b, c, d = rows
    for t in range(line.size):
        k = (first + t) % my
        line[t] = _INNER * (half[b + k] + half[c + k]) + _OUTER * (half[a + k] + half[d + k])


@compiled
def gather_split(  # noqa: PLR0912, PLR0915 - one loop: cut into functions it took a third longer
    masked: Any, half: Any, taps: Any, index: Any, out: Any, other: Any
) -> tuple[float, float]:
    """out = the 7 x 7 stencil on `masked` plus `half` interpolated, at the listed points.

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
        # line: the half grid interpolated to this row; middle: line interpolated between columns.
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
