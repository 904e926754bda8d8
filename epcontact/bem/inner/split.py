"""A cheap stand-in for the compliance of a grid on the elastic set.

The kernel is split by a Gaussian, as in Ewald's sums: the short-range part becomes a stencil of a
few points around each elastic one, the long-range part is smooth and is applied on the grid of
half as many points a direction, with cubic interpolation from it and its transpose to it:

    S ~ stencil + P G P^T,    G = [S phi + (S (1 - phi) - sigma) sqrt(phi)] / T^2

phi = exp(-(a theta)^2/4), theta the phase per grid point, sigma the symbol of the stencil and T
that of P; the second term of G hands to the coarse grid what the stencil's cut left out.  An
application costs a quarter of a pair of transforms, in single precision.  It is off by a few per
cent, which is enough for inner iterations: the displacement of every outer iterate is exact, so
each outer step corrects what the last one left.
"""

from __future__ import annotations

import numpy as np

from epcontact.bem.inner import split_passes
from epcontact.bem.passes import Workers
from epcontact.bem.transforms import Convolution, Points, Symbol
from epcontact.results import FloatArray

_WIDTH = 2.0  # a: the alias of the interpolation falls with it, the stencil grows
_SIDE = 3  # grid points that a stencil reaches to each side
_SAMPLE = 128  # modes a direction that the stencil is found from


def splittable(shape: tuple[int, int]) -> bool:
    """Whether a grid has an exact half, and enough points for it to pay."""
    return min(shape) >= 64 and shape[0] % 2 == 0 and shape[1] % 2 == 0


class MaskedGrid:
    """A grid in single precision that is 0 but for values at listed points.

    array: (nx, HALO_LEFT + ny + HALO_RIGHT), the columns at its sides repeated.
    """

    def __init__(self, shape: tuple[int, int], workers: Workers) -> None:
        width = shape[1] + split_passes.HALO_LEFT + split_passes.HALO_RIGHT
        self.array = np.zeros((shape[0], width), dtype=np.float32)
        self._workers = workers
        self._points: Points | None = None

    def put(self, points: Points, values: FloatArray) -> None:
        """The values at the points, 0 elsewhere."""
        if self._points is not points:
            if self._points is not None:
                self._write(self._points, np.zeros(self._points.index.size))
            self._points = points
        self._write(points, values)

    def _write(self, points: Points, values: FloatArray) -> None:
        def write(start: int) -> None:
            part = points.part(start)
            split_passes.put_single(self.array, points.index[part], values[part])

        self._workers.run(write, points.begins)


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
        self._row_step = max(2, convolution.row_step // 2 * 2)

    @property
    def pairs(self) -> float:
        """Pairs of transforms, in pairs of the fine grid."""
        return self._coarse.pairs / 4

    def apply_on(
        self, points: Points, values: FloatArray, out: FloatArray, other: FloatArray
    ) -> tuple[float, float]:
        """out = approximately S applied to `values`, at the points.

        Returns sum(out) and sum(out other).
        """
        masked, half = self._masked.array, self._half

        def restrict(start: int) -> None:
            split_passes.restrict(
                masked, half, start // 2, min(start + self._row_step, len(masked)) // 2
            )

        def gather(start: int) -> tuple[float, float]:
            part = points.part(start)
            sums: tuple[float, float] = split_passes.gather_split(
                masked, half, self._taps, points.index[part], out[part], other[part]
            )
            return sums

        self._masked.put(points, values)
        self.workers.run(restrict, range(0, len(masked), self._row_step))
        self._coarse.apply(half, half)
        sums = self.workers.run(gather, points.begins)
        return sum(s for s, _ in sums), sum(s for _, s in sums)


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
    """Of cubic interpolation to twice as many points: weights 1 and -1/16, 9/16, 9/16, -1/16."""
    return np.asarray(1 + 9 / 8 * np.cos(theta) - 1 / 8 * np.cos(3 * theta), dtype=np.float64)
