"""Convolutions of a grid with a surface compliance, or with its inverse, by blocks of
rows.

One application transforms the rows; then, for each block of columns while it is in
cache, it transforms the columns, multiplies by the symbol and transforms them back;
then the rows.  If a convolution is from listed points (the elastic set) to these
points, each thread makes and reads the rows in a small buffer.  A grid that is in cache
as a whole is transformed in one call.

Each transform handles a fixed block on one thread: the library's own threads would
group lines by the number of threads, and the last digits of a result would depend on
it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import ducc0
import numpy as np
from numpy.typing import NDArray

from epcontact.bem.workers import Workers, compiled, ranges, split
from epcontact.results import FloatArray

T = TypeVar("T")
IntArray = NDArray[np.signedinteger]
RealArray = NDArray[np.floating]  # float64, or float32 in single precision
ComplexArray = NDArray[np.complexfloating]
Axes = tuple[int, ...]  # of a transform of each row, or of rows and columns
ROWS, BOTH = (1,), (0, 1)
#: Points of a block of rows or columns: 4 MiB of reals are near a core, and a pass over
#: them takes ten times as long as a request to a thread.
BLOCK_POINTS = 524288
#: Points up to which a symbol keeps what follows from it: on 128 x 128 points it takes
#: a sixth of a solve, on larger grids little, and memory.
KEPT_POINTS = 1 << 20
# Points are far apart if the shortest wave along their axis is this much more compliant
# than the other's.
_OBLONG = 2.0
# Columns beside those of a buffer: rows a power of two apart would share a part of the
# cache.
_PAD = 16
# Fields of cells are small: smaller blocks leave work for every thread.
_FILTER_POINTS = 65536


def to_modes(values: RealArray, modes: ComplexArray, axes: Axes = ROWS) -> None:
    """Transform each row of `values`, and keep as many modes as `modes` has columns."""
    if modes.shape[1] == values.shape[1] // 2 + 1:
        ducc0.fft.r2c(values, axes=axes, out=modes, nthreads=1)
    else:
        modes[...] = ducc0.fft.r2c(values, axes=axes, nthreads=1)[:, : modes.shape[1]]


def to_values(
    modes: ComplexArray, values: RealArray, inorm: int = 0, axes: Axes = ROWS
) -> None:
    """Transform each row of `modes` back into `values`; inorm 2 divides by the number
    of points.
    """
    ducc0.fft.c2r(
        modes,
        axes=axes,
        lastsize=values.shape[1],
        forward=False,
        inorm=inorm,
        out=values,
        nthreads=1,
        allow_overwriting_input=True,
    )


def through_columns(
    workers: Workers,
    modes: ComplexArray,
    step: int,
    change: Callable[[ComplexArray, slice], ComplexArray],
    inorm: int = 0,
) -> None:
    """Transform the columns of `modes`, `step` at a time, and transform back what
    `change` returns. It is called with the block and its columns.
    """

    def through(columns: slice) -> None:
        block = modes[:, columns]
        if block.shape[0] > 1:
            ducc0.fft.c2c(block, axes=(0,), forward=True, out=block, nthreads=1)
        block = change(block, columns)
        if block.shape[0] > 1:
            ducc0.fft.c2c(
                block, axes=(0,), forward=False, inorm=inorm, out=block, nthreads=1
            )

    workers.each(through, ranges(modes.shape[1], step))


def filtered(values: FloatArray, modes: FloatArray, workers: Workers) -> FloatArray:
    """`values` (mx, my) with each mode of its real transform times `modes` (mx, my // 2
    + 1).
    """
    mx, my = values.shape
    if values.size <= _FILTER_POINTS:
        small = ducc0.fft.r2c(values, axes=BOTH, nthreads=1)
        small *= modes
        found: FloatArray = ducc0.fft.c2r(
            small,
            axes=BOTH,
            lastsize=my,
            forward=False,
            inorm=2,
            nthreads=1,
            allow_overwriting_input=True,
        )
        return found
    rows = ranges(mx, max(1, _FILTER_POINTS // my))
    spectrum = np.empty(modes.shape, dtype=np.complex128)
    out = np.empty((mx, my))

    def change(block: ComplexArray, columns: slice) -> ComplexArray:
        block *= modes[:, columns]
        return block

    workers.each(to_modes, split(values, rows), split(spectrum, rows))
    through_columns(workers, spectrum, max(8, _FILTER_POINTS // mx), change, inorm=2)
    workers.each(to_values, split(spectrum, rows), split(out, rows), 2)
    return out


@dataclass(frozen=True, eq=False)
class Symbol:
    """A compliance per mode: mode (i, j) of `numpy.fft.rfft2` has values[rows[i], j],
    in m/Pa.
    """

    values: FloatArray
    rows: IntArray
    shape: tuple[int, int]
    _known: dict[Any, Any] = field(default_factory=dict, repr=False)

    def once(self, function: Callable[..., T], *arguments: Any) -> T:
        """function(self, *arguments), up to KEPT_POINTS computed at the first call
        only.  So it serves all loads of a path, and all surfaces of an ensemble.
        """
        key = function, *arguments
        found: T = (
            self._known[key] if key in self._known else function(self, *arguments)
        )
        if self.shape[0] * self.shape[1] <= KEPT_POINTS:
            self._known[key] = found
        return found

    @classmethod
    def from_quarter(cls, values: FloatArray, shape: tuple[int, int]) -> Symbol:
        """The symbol of a compliance given on the non-negative quarter of the modes."""
        i = np.arange(shape[0])
        return cls(values, np.minimum(i, shape[0] - i).astype(np.int32), shape)

    def coarsened(self, shape: tuple[int, int]) -> Symbol:
        """The symbol of the same body on a coarser grid of the same periods."""
        i = np.fft.fftfreq(shape[0], 1 / shape[0]).astype(int)
        values = np.ascontiguousarray(self.values[:, : shape[1] // 2 + 1])
        return Symbol(values, self.rows[i], shape)

    def shortest(self) -> float:
        """The compliance of the shortest wave along an axis, the larger of the two, in
        m/Pa.
        """
        return max(self._ends())

    def oblong(self) -> float:
        """The compliance of the shortest wave along the second axis by that along the
        first.  On the half-space this is the ratio of the spacings, and on a line 0.
        """
        across, along = self._ends()
        return along / across if across > 0 else 0.0

    def far(self) -> tuple[bool, bool]:
        """True for each axis along which points are far apart beside those along the
        other.
        """
        return self.oblong() < 1 / _OBLONG, self.oblong() > _OBLONG

    def _ends(self) -> tuple[float, float]:
        nx, ny = self.shape
        across = self.values[self.rows[nx // 2], 0] if nx > 1 else 0.0
        return float(across), float(self.values[self.rows[0], ny // 2])

    def sampled(
        self, most: int
    ) -> tuple[FloatArray, list[FloatArray], list[FloatArray]]:
        """A quarter of the modes on a raster of at most `most` modes in each direction.
        Their values, and each direction's phases per point and weights in a mean of
        all.
        """
        at, phases, weights = [], [], []
        for n in self.shape:
            count = min(n, most)
            k = np.arange(count // 2 + 1)
            at.append(np.minimum(np.rint(k * n / count), n // 2).astype(int))
            phases.append(2 * np.pi * k / count)
            weight = np.where((k == 0) | (2 * k == count), 1.0, 2.0)
            weights.append(weight / weight.sum())
        return self.values[np.ix_(self.rows[at[0]], at[1])], phases, weights


@dataclass(frozen=True, eq=False)
class Points:
    """Flat indices of listed points, ascending, and the part of them in each block of
    rows.
    """

    index: IntArray
    parts: list[slice]

    def split(self, *arrays: NDArray[Any]) -> list[list[NDArray[Any]]]:
        """The views by block of each array, which has one value for each point."""
        return [split(array, self.parts) for array in arrays]


class Convolution:
    """Applies a symbol, times `scale`, but 0 in mode zero, or its inverse; counts its
    `pairs`.
    """

    def __init__(
        self,
        symbol: Symbol,
        scale: float,
        workers: Workers,
        dtype: type = np.float64,
        modes: ComplexArray | None = None,
    ) -> None:
        nx, ny = self.shape = symbol.shape
        self.symbol, self.scale, self.workers, self.pairs = symbol, scale, workers, 0
        self.row_step = max(1, min(nx, BLOCK_POINTS // ny))
        self.rows = ranges(nx, self.row_step)
        if modes is None:
            modes = np.empty((nx, ny // 2 + 1), np.result_type(dtype, np.complex64))
        self._dtype, self._modes, self._local = (
            np.dtype(dtype),
            modes,
            threading.local(),
        )
        self._axes: Axes = BOTH if nx == self.row_step > 1 else ROWS

    def in_single_precision(self) -> Convolution:
        """The same in single precision, at half the cost and in the same memory."""
        modes = self._modes.reshape(-1).view(np.complex64)[: self._modes.size]
        modes = modes.reshape(self._modes.shape)
        return single_precision(self.symbol, self.scale, self.workers, modes)

    def apply(self, values: RealArray, out: RealArray) -> None:
        """out = S values on the whole grid; both (nx, ny)."""
        modes = split(self._modes, self.rows)
        self.workers.each(to_modes, split(values, self.rows), modes, self._axes)
        self._multiply(inverse=False)
        self.workers.each(to_values, modes, split(out, self.rows), 0, self._axes)

    def apply_on(
        self,
        points: Points,
        values: FloatArray,
        out: FloatArray,
        other: FloatArray,
        inverse: bool = False,
    ) -> tuple[float, float]:
        """out = S, or its inverse, of a field that is `values` at the points and 0
        elsewhere. Returns sum(out) and sum(out other).
        """
        index, values_, out_, other_ = points.split(points.index, values, out, other)
        first = [rows.start * self.shape[1] for rows in self.rows]
        modes = split(self._modes, self.rows)
        self.workers.each(self._forward, modes, first, index, values_)
        self._multiply(inverse)
        total, product = self.workers.total(
            self._backward, modes, first, index, out_, other_
        )
        return total, product

    def _forward(self, modes: ComplexArray, *points: Any) -> None:
        block = self._buffer(len(modes))
        scatter(block, *points)
        to_modes(block, modes, self._axes)

    def _backward(self, modes: ComplexArray, *points: Any) -> tuple[float, float]:
        block = self._buffer(len(modes))
        to_values(modes, block, 0, self._axes)
        total, product = gather_dot(block, *points)
        return total, product

    def _buffer(self, rows: int) -> RealArray:
        """This thread's buffer for some rows of the grid."""
        if not hasattr(self._local, "buffer"):
            width = self.shape[1] + _PAD
            self._local.buffer = np.empty((self.row_step, width), dtype=self._dtype)
        buffer: RealArray = self._local.buffer[:rows, : self.shape[1]]
        return buffer

    def _multiply(self, inverse: bool) -> None:
        (nx, ny), symbol = self.shape, self.symbol
        factor = self._dtype.type(
            (1 / self.scale if inverse else self.scale) / (nx * ny)
        )
        reals = self._modes.view(self._dtype)

        def change(block: ComplexArray, columns: slice) -> ComplexArray:
            if inverse:
                values = symbol.values[symbol.rows, columns]
                block *= np.divide(
                    factor, values, out=np.zeros_like(values), where=values > 0
                )
            else:
                multiply(
                    reals,
                    symbol.values,
                    symbol.rows,
                    factor,
                    columns.start,
                    columns.stop,
                )
            if columns.start == 0:
                block[0, 0] = 0.0
            return block

        step = max(8, min(ny // 2 + 1, BLOCK_POINTS // (2 * nx)))
        if self._axes == BOTH:
            change(self._modes, slice(0, ny // 2 + 1))
        else:
            through_columns(self.workers, self._modes, step, change)
        self.pairs += 1


def single_precision(
    symbol: Symbol, scale: float, workers: Workers, modes: ComplexArray | None = None
) -> Convolution:
    """The convolution of a symbol in single precision, the symbol brought to order
    one.
    """
    single, largest = symbol.once(_single)
    return Convolution(single, scale * largest, workers, np.float32, modes)


def _single(symbol: Symbol) -> tuple[Symbol, float]:
    largest = float(symbol.values.max())
    values: Any = (symbol.values / largest).astype(np.float32)
    return Symbol(values, symbol.rows, symbol.shape), largest


@compiled
def multiply(
    modes: Any, symbol: Any, rows: Any, factor: float, start: int, stop: int
) -> None:
    """modes[i] *= factor symbol[rows[i]] in a range of columns of complex numbers."""
    for i in range(modes.shape[0]):
        row = rows[i]
        for j in range(start, stop):
            weight = factor * symbol[row, j]
            modes[i, 2 * j] *= weight
            modes[i, 2 * j + 1] *= weight


@compiled
def scatter(block: Any, first: int, index: Any, values: Any) -> None:
    """block[index - first] = values, and block = 0 elsewhere."""
    block[:] = 0.0
    columns, row, begin, end = block.shape[1], 0, 0, 0
    for k in range(index.size):
        if index[k] >= end:
            row = (index[k] - first) // columns
            begin = first + row * columns
            end = begin + columns
        block[row, index[k] - begin] = values[k]


@compiled
def gather_dot(
    block: Any, first: int, index: Any, out: Any, other: Any
) -> tuple[float, float]:
    """out = block[index - first]; returns sum(out) and sum(out other)."""
    total = product = 0.0
    columns, row, begin, end = block.shape[1], 0, 0, 0
    for k in range(index.size):
        if index[k] >= end:
            row = (index[k] - first) // columns
            begin = first + row * columns
            end = begin + columns
        value = block[row, index[k] - begin]
        out[k] = value
        total += value
        product += value * other[k]
    return total, product
