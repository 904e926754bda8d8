"""Convolutions of a grid with a surface compliance, or its inverse, by blocks of rows.

One application transforms the rows.  Then it transforms each block of columns,
multiplies the block by the symbol and transforms it back, while the block is in cache.
Then it transforms the rows back.  If a convolution is from listed points (the elastic
set) to these points, each thread fills and reads the rows in a small buffer.  A grid
that fits into cache is transformed in one call.

Each transform handles a fixed block on one thread.  The library's own threads would
group lines by the number of threads, and the last digits of a result would depend on
this number.
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
ROWS = (1,)
BOTH = (0, 1)
#: Points of a block of rows or columns: 4 MiB of reals are near a core, and a pass over
#: them takes ten times as long as a request to a thread.
BLOCK_POINTS = 524288
#: Points up to which a symbol caches what is computed from it.  On 128 x 128 points
#: this computation takes a sixth of a solve; on larger grids it takes little time, and
#: the cache much memory.
KEPT_POINTS = 1 << 20
# Points are far apart along an axis if the shortest wave along it is more compliant by
# this factor than the shortest wave along the other axis.
_OBLONG = 2.0
# Columns beside those of a buffer: rows a power of two apart would share a part of the
# cache.
_PAD = 16
# Points of a block of cells.  Fields of cells are small, and smaller blocks leave work
# for every thread.
_FILTER_POINTS = 65536
_NARROWEST_BLOCK = 8  # columns


def to_modes(values: RealArray, modes: ComplexArray, axes: Axes = ROWS) -> None:
    """Write the real Fourier transform of `values` to `modes`.

    values: (rows, ny); modes: (rows, columns), overwritten; the first modes of each row
    are kept if it has fewer columns than ny // 2 + 1; axes: ROWS to transform each row,
    BOTH to transform rows and columns, which keeps all modes.
    """
    if modes.shape[1] == values.shape[1] // 2 + 1:
        ducc0.fft.r2c(values, axes=axes, out=modes, nthreads=1)
    else:
        modes[...] = ducc0.fft.r2c(values, axes=axes, nthreads=1)[:, : modes.shape[1]]


def to_values(
    modes: ComplexArray, values: RealArray, inorm: int = 0, axes: Axes = ROWS
) -> None:
    """Write the inverse of `to_modes` to `values`; `modes` is overwritten, too.

    modes: (rows, ny // 2 + 1); values: (rows, ny); inorm: 2 divides by the number of
    points, 0 does not; axes: as in `to_modes`.
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
    """Transform the columns of `modes`, change them, and transform them back in place.

    Args:
        workers: threads that share the blocks of columns.
        modes: (nx, columns).
        step: columns of a block.
        change: called with each transformed block and the slice of its columns; what it
            returns is transformed back.
        inorm: 2 divides by the number of rows, 0 does not.
    """

    def through(columns: slice) -> None:
        """Transform, change and transform back one block of columns."""
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
    """Return a field with each mode of its Fourier transform times a factor.

    values: (mx, my); modes: (mx, my // 2 + 1) the factors; workers: threads.
    """
    mx, my = values.shape
    if values.size <= _FILTER_POINTS:
        small = ducc0.fft.r2c(values, axes=BOTH, nthreads=1)
        small *= modes
        small_out: FloatArray = ducc0.fft.c2r(
            small,
            axes=BOTH,
            lastsize=my,
            forward=False,
            inorm=2,
            nthreads=1,
            allow_overwriting_input=True,
        )
        return small_out
    rows = ranges(mx, max(1, _FILTER_POINTS // my))
    spectrum = np.empty(modes.shape, dtype=np.complex128)
    out = np.empty((mx, my))

    def change(block: ComplexArray, columns: slice) -> ComplexArray:
        """Multiply a block of columns by its factors, in place, and return it."""
        block *= modes[:, columns]
        return block

    step = max(_NARROWEST_BLOCK, _FILTER_POINTS // mx)
    workers.each(to_modes, split(values, rows), split(spectrum, rows))
    through_columns(workers, spectrum, step, change, inorm=2)
    workers.each(to_values, split(spectrum, rows), split(out, rows), 2)
    return out


@dataclass(frozen=True, eq=False)
class Symbol:
    """A compliance for each mode.

    Attributes:
        values: in m/Pa; mode (i, j) of `numpy.fft.rfft2` has values[rows[i], j].
        rows: (nx,) row of `values` for each mode along the first axis.
        shape: (nx, ny) points of the grid.
    """

    values: FloatArray
    rows: IntArray
    shape: tuple[int, int]
    _cache: dict[Any, Any] = field(default_factory=dict, repr=False)

    def once(self, function: Callable[..., T], *arguments: Any) -> T:
        """Return function(self, *arguments), from a cache if it was called before.

        One result then serves all loads of a path and all surfaces of an ensemble.
        Results of grids above KEPT_POINTS points are not cached.

        function: takes this symbol; arguments: further ones, hashable.
        """
        key = (function, *arguments)
        if key in self._cache:
            result: T = self._cache[key]
        else:
            result = function(self, *arguments)
        if self.shape[0] * self.shape[1] <= KEPT_POINTS:
            self._cache[key] = result
        return result

    @classmethod
    def from_quarter(cls, values: FloatArray, shape: tuple[int, int]) -> Symbol:
        """Return the symbol of a compliance on the non-negative quarter of the modes.

        values: (nx // 2 + 1, ny // 2 + 1) in m/Pa; shape: (nx, ny) points of the grid.
        """
        i = np.arange(shape[0])
        return cls(values, np.minimum(i, shape[0] - i).astype(np.int32), shape)

    def coarsened(self, shape: tuple[int, int]) -> Symbol:
        """Return the symbol of the same body on a coarser grid of the same periods.

        shape: (mx, my) points of that grid, at most those of this one.
        """
        i = np.fft.fftfreq(shape[0], 1 / shape[0]).astype(int)
        values = np.ascontiguousarray(self.values[:, : shape[1] // 2 + 1])
        return Symbol(values, self.rows[i], shape)

    def shortest(self) -> float:
        """Return the compliance (m/Pa) of the shortest wave along an axis.

        It is the larger one of the two axes, that is, the one of the wider spacing.
        """
        return max(self._shortest_waves())

    def oblong(self) -> float:
        """Return how oblong the cells of the grid are.

        It is the compliance of the shortest wave along y over that along x.  On the
        half-space this is the ratio of the spacings dy/dx, and on a line 0.
        """
        first, second = self._shortest_waves()
        return second / first if first > 0 else 0.0

    def far(self) -> tuple[bool, bool]:
        """Return, for x and for y, whether the spacing along this axis is much wider.

        It is compared with the spacing along the other axis by the compliances of the
        shortest waves, whose ratio must be above _OBLONG.
        """
        return self.oblong() < 1 / _OBLONG, self.oblong() > _OBLONG

    def _shortest_waves(self) -> tuple[float, float]:
        """Return the compliances (m/Pa) of the shortest waves along both axes."""
        nx, ny = self.shape
        first = self.values[self.rows[nx // 2], 0] if nx > 1 else 0.0
        return float(first), float(self.values[self.rows[0], ny // 2])

    def sampled(
        self, most: int
    ) -> tuple[FloatArray, list[FloatArray], list[FloatArray]]:
        """Return compliances on a raster of a quarter of the modes.

        most: largest number of modes that stand for all modes of a direction, both
        signs counted.

        Returns:
            The compliances (mx, my) in m/Pa, a copy.
            For each direction, the phases of the modes from point to point in rad.
            For each direction, the weights of the modes in a mean over all modes.
        """
        at = []
        phases = []
        weights = []
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
    """Listed points of a grid.

    Attributes:
        index: (points,) their flat indices, ascending.
        parts: the range of these points in each block of rows.
    """

    index: IntArray
    parts: list[slice]

    def split(self, *arrays: NDArray[Any]) -> list[list[NDArray[Any]]]:
        """Return, for each array (points,), its views by block of rows of the grid."""
        return [split(array, self.parts) for array in arrays]


class Convolution:
    """Applies a symbol times a scale, or its inverse, with 0 in mode zero.

    Attributes:
        symbol: the compliance.
        shape: (nx, ny) points of the grid.
        scale: factor of the symbol.
        workers: threads of the transforms.
        pairs: number of applications so far, each a transform and one back.
        row_step: rows of a block.
        rows: the blocks of rows.
    """

    def __init__(
        self,
        symbol: Symbol,
        scale: float,
        workers: Workers,
        dtype: type = np.float64,
        modes: ComplexArray | None = None,
    ) -> None:
        """Create the convolution.

        symbol: compliance of each mode, in m/Pa; scale: factor of the symbol; workers:
        threads of the transforms; dtype: of the fields, float64 or float32; modes: (nx,
        ny // 2 + 1) memory for the modes; None: new memory.
        """
        nx, ny = symbol.shape
        self.shape = symbol.shape
        self.symbol = symbol
        self.scale = scale
        self.workers = workers
        self.pairs = 0
        self.row_step = max(1, min(nx, BLOCK_POINTS // ny))
        self.rows = ranges(nx, self.row_step)
        if modes is None:
            modes = np.empty((nx, ny // 2 + 1), np.result_type(dtype, np.complex64))
        self._dtype = np.dtype(dtype)
        self._modes = modes
        self._local = threading.local()
        self._axes: Axes = BOTH if nx == self.row_step > 1 else ROWS

    def in_single_precision(self) -> Convolution:
        """Return this convolution in single precision, at half the cost.

        It uses the memory of this convolution, so only one can be applied at a time.
        """
        modes = self._modes.reshape(-1).view(np.complex64)[: self._modes.size]
        modes = modes.reshape(self._modes.shape)
        return single_precision(self.symbol, self.scale, self.workers, modes)

    def apply(self, values: RealArray, out: RealArray) -> None:
        """Write the convolution of a field to `out`.

        The convolution multiplies each mode by the symbol times the scale; mode zero
        becomes 0.  values, out: (nx, ny), which may be the same array.
        """
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
        """Apply the convolution S, or its inverse, to values at points alone.

        S multiplies the modes of a field by the symbol (a compliance: the field is a
        pressure, and S gives its displacement).

        Args:
            points: the grid points of the values.
            values: (points,) of a field that is 0 at all other points.
            out: (points,) is overwritten by the result at the points.
            other: (points,) that the result is multiplied with.
            inverse: whether the inverse of S is applied.

        Returns:
            The sum of `out`, and that of `out` times `other`.
        """
        index, value_blocks, out_blocks, other_blocks = points.split(
            points.index, values, out, other
        )
        first = [rows.start * self.shape[1] for rows in self.rows]
        modes = split(self._modes, self.rows)
        self.workers.each(self._forward, modes, first, index, value_blocks)
        self._multiply(inverse)
        total, product = self.workers.total(
            self._backward, modes, first, index, out_blocks, other_blocks
        )
        return total, product

    def _forward(self, modes: ComplexArray, *points: Any) -> None:
        """Transform a block of rows that is 0 except at listed points.

        modes: (rows, ny // 2 + 1), overwritten; points: the arguments of `scatter` but
        the first.
        """
        block = self._buffer(len(modes))
        scatter(block, *points)
        to_modes(block, modes, self._axes)

    def _backward(self, modes: ComplexArray, *points: Any) -> tuple[float, float]:
        """Transform a block of rows back and write it at listed points.

        modes: (rows, ny // 2 + 1), overwritten; points: the arguments of `gather_dot`
        but the first.  Returns the sums of `gather_dot`.
        """
        block = self._buffer(len(modes))
        to_values(modes, block, 0, self._axes)
        total, product = gather_dot(block, *points)
        return total, product

    def _buffer(self, rows: int) -> RealArray:
        """Return an array (rows, ny) that this thread may overwrite; see `dtype`."""
        if not hasattr(self._local, "buffer"):
            width = self.shape[1] + _PAD
            self._local.buffer = np.empty((self.row_step, width), dtype=self._dtype)
        buffer: RealArray = self._local.buffer[:rows, : self.shape[1]]
        return buffer

    def _multiply(self, inverse: bool) -> None:
        """Transform the columns of the modes, multiply by the symbol, transform back.

        With `inverse`, modes are divided by the symbol.  The factor includes 1/(nx ny),
        which the transforms leave out.  `pairs` grows by 1.
        """
        nx, ny = self.shape
        symbol = self.symbol
        scale = 1 / self.scale if inverse else self.scale
        factor = self._dtype.type(scale / (nx * ny))
        reals = self._modes.view(self._dtype)

        def change(block: ComplexArray, columns: slice) -> ComplexArray:
            """Multiply a block of columns by the symbol in place, and return it."""
            if inverse:
                values = symbol.values[symbol.rows, columns]
                zeros = np.zeros_like(values)
                block *= np.divide(factor, values, out=zeros, where=values > 0)
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

        if self._axes == BOTH:
            change(self._modes, slice(0, ny // 2 + 1))
        else:
            step = min(ny // 2 + 1, BLOCK_POINTS // (2 * nx))
            step = max(_NARROWEST_BLOCK, step)
            through_columns(self.workers, self._modes, step, change)
        self.pairs += 1


def single_precision(
    symbol: Symbol, scale: float, workers: Workers, modes: ComplexArray | None = None
) -> Convolution:
    """Return the convolution of a symbol times `scale` in single precision.

    The symbol is brought to order one, so that it does not underflow.  symbol:
    compliance of each mode in m/Pa; workers: threads; modes: (nx, ny // 2 + 1) memory
    for the modes; None: new memory.
    """
    single, largest = symbol.once(_single)
    return Convolution(single, scale * largest, workers, np.float32, modes)


def _single(symbol: Symbol) -> tuple[Symbol, float]:
    """Return a symbol over its largest value, in single precision, and this value.

    The largest value is in m/Pa.
    """
    largest = float(symbol.values.max())
    values: Any = (symbol.values / largest).astype(np.float32)
    return Symbol(values, symbol.rows, symbol.shape), largest


@compiled
def multiply(
    modes: Any, symbol: Any, rows: Any, factor: float, start: int, stop: int
) -> None:
    """Multiply the modes in a range of columns by the symbol, in place.

    modes: (nx, 2 (ny // 2 + 1)) real and imaginary parts in turn; symbol: values in
    m/Pa, of which row rows[i] belongs to row i of the modes; rows: (nx,); factor: of
    the symbol; start, stop: the range of columns of complex modes.
    """
    for i in range(modes.shape[0]):
        row = rows[i]
        for j in range(start, stop):
            weight = factor * symbol[row, j]
            modes[i, 2 * j] *= weight
            modes[i, 2 * j + 1] *= weight


@compiled
def scatter(block: Any, first: int, index: Any, values: Any) -> None:
    """Write values to listed points of a block of rows, and 0 to its other points.

    block: (rows, ny), overwritten; first: flat index in the grid of the block's first
    point; index: (points,) flat indices of the points in the grid, ascending; values:
    (points,).
    """
    block[:] = 0.0
    columns = block.shape[1]
    row = begin = end = 0
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
    """Write the values of a block of rows at listed points to `out`.

    Returns sum(out) and sum(out other).

    block: (rows, ny); first: flat index in the grid of the block's first point; index:
    (points,) flat indices of the points in the grid, ascending; out, other: (points,).
    """
    total = product = 0.0
    columns = block.shape[1]
    row = begin = end = 0
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
