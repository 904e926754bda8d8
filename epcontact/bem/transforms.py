"""Convolutions of a grid with a surface compliance, or with its inverse, by blocks of rows.

One application is: real transform of the rows, then for each block of columns the transform
along the columns, the multiplication by the symbol and the transform back, while the block is in
cache, then the rows back.  Where a convolution starts from or ends in the values at listed
points (the elastic set), rows are made and read in a small buffer of each block, and no array of
the grid's size but the one of the modes is touched.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import ducc0
import numpy as np
from numpy.typing import NDArray

from epcontact.bem import passes
from epcontact.bem.passes import Workers
from epcontact.results import FloatArray

IntArray = NDArray[np.int32]
RealArray = NDArray[np.floating]  # float64, or float32 in single precision

_BLOCK_POINTS = 262144  # of a block of rows or columns: 2 MiB of reals, within a core's cache
_FILTER_POINTS = 65536  # of small fields, that a thread takes at once


@dataclass(frozen=True)
class Symbol:
    """A compliance per mode: mode (i, j) of `numpy.fft.rfft2` has values[rows[i], j], in m/Pa."""

    values: FloatArray
    rows: IntArray
    shape: tuple[int, int]

    @classmethod
    def from_quarter(cls, values: FloatArray, shape: tuple[int, int]) -> Symbol:
        """Of a compliance on the non-negative quarter of the modes (isotropic bodies)."""
        i = np.arange(shape[0])
        return cls(values, np.minimum(i, shape[0] - i).astype(np.int32), shape)

    def coarsened(self, shape: tuple[int, int]) -> Symbol:
        """The same body on a coarser grid of the same periods."""
        i = np.fft.fftfreq(shape[0], 1 / shape[0]).astype(int)
        return Symbol(self.values[:, : shape[1] // 2 + 1], self.rows[i], shape)

    def shortest(self) -> float:
        """The compliance of the shortest wave along an axis, the larger of the two, in m/Pa."""
        nx, ny = self.shape
        first = self.values[self.rows[nx // 2], 0] if nx > 1 else 0.0
        return float(max(first, self.values[self.rows[0], ny // 2]))


class Convolution:
    """Applies a symbol, times `scale`, or its inverse; counts its pairs of transforms.

    The mean of the result is that of mode zero of the symbol, here always taken as 0.  With
    `dtype` float32 the fields are in single precision, at half the cost.
    """

    def __init__(
        self, symbol: Symbol, scale: float, workers: Workers, dtype: type = np.float64
    ) -> None:
        nx, ny = symbol.shape
        self.symbol, self.scale, self.workers = symbol, scale, workers
        self.shape = symbol.shape
        self._dtype = np.dtype(dtype)
        self.pairs = 0
        self.row_step = max(1, min(nx, _BLOCK_POINTS // ny))
        self.column_step = max(8, min(ny // 2 + 1, _BLOCK_POINTS // (2 * nx)))
        self._modes = np.empty((nx, ny // 2 + 1), dtype=np.result_type(dtype, np.complex64))
        self._local = threading.local()

    @property
    def blocks(self) -> range:
        """The first row of each block of rows."""
        return range(0, self.shape[0], self.row_step)

    def _buffer(self, rows: int) -> RealArray:
        if not hasattr(self._local, "buffer"):
            self._local.buffer = np.empty((self.row_step, self.shape[1]), dtype=self._dtype)
        return self._local.buffer[:rows]  # type: ignore[no-any-return]

    def _columns(self, inverse: bool) -> None:
        kernel = passes.divide_rows if inverse else passes.multiply_rows
        count = self.shape[0] * self.shape[1]
        factor = self._dtype.type((1 / self.scale if inverse else self.scale) / count)
        values, rows = self.symbol.values, self.symbol.rows

        def block(start: int) -> None:
            part = slice(start, start + self.column_step)
            modes = self._modes[:, part]
            if self.shape[0] > 1:
                ducc0.fft.c2c(modes, axes=(0,), forward=True, out=modes, nthreads=1)
            parts = self._modes.view(self._dtype)[:, 2 * part.start : 2 * part.stop]
            kernel(parts, values[:, part], rows, factor)
            if start == 0:
                modes[0, 0] = 0.0
            if self.shape[0] > 1:
                ducc0.fft.c2c(modes, axes=(0,), forward=False, out=modes, nthreads=1)

        self.workers.run(block, range(0, self._modes.shape[1], self.column_step))

    def _apply(
        self,
        source: Callable[[int, int], RealArray],
        sink: Callable[[int, int, RealArray | None], Any],
        target: RealArray | None,
        inverse: bool,
    ) -> list[Any]:
        nx, ny = self.shape

        def forward(start: int) -> None:
            stop = min(start + self.row_step, nx)
            ducc0.fft.r2c(source(start, stop), axes=(1,), out=self._modes[start:stop], nthreads=1)

        def backward(start: int) -> Any:
            stop = min(start + self.row_step, nx)
            out = self._buffer(stop - start) if target is None else target[start:stop]
            ducc0.fft.c2r(
                self._modes[start:stop],
                axes=(1,),
                lastsize=ny,
                forward=False,
                out=out,
                nthreads=1,
                allow_overwriting_input=True,
            )
            return sink(start, stop, out)

        self.workers.run(forward, self.blocks)
        self._columns(inverse)
        self.pairs += 1
        return self.workers.run(backward, self.blocks)

    def apply(self, field: RealArray, out: RealArray) -> None:
        """out = S field on the whole grid; both (nx, ny)."""
        self._apply(lambda a, b: field[a:b], lambda *_: None, out, inverse=False)

    def apply_on(
        self,
        points: Points,
        values: FloatArray,
        out: FloatArray,
        other: FloatArray,
        inverse: bool = False,
    ) -> tuple[float, float]:
        """out = (S or its inverse) applied to `values` at the points and 0 elsewhere, at them.

        Returns sum(out) and sum(out other).
        """
        ny = self.shape[1]

        def source(start: int, stop: int) -> RealArray:
            buffer = self._buffer(stop - start)
            part = points.part(start)
            passes.scatter(buffer.reshape(-1), start * ny, points.index[part], values[part])
            return buffer

        def sink(start: int, _stop: int, block: RealArray | None) -> tuple[float, float]:
            assert block is not None
            part = points.part(start)
            flat = block.reshape(-1)
            sums: tuple[float, float] = passes.gather_dot(
                flat, start * ny, points.index[part], out[part], other[part]
            )
            return sums

        sums = self._apply(source, sink, None, inverse)
        return sum(s for s, _ in sums), sum(s for _, s in sums)


@dataclass(frozen=True)
class Points:
    """Flat indices of listed points, in order, and where each block of rows begins in them."""

    index: IntArray
    begins: dict[int, slice]

    def part(self, start: int) -> slice:
        """The share of the block whose first row is `start`."""
        return self.begins[start]


def filtered(field: FloatArray, modes: FloatArray, workers: Workers) -> FloatArray:
    """`field` (mx, my) with each mode of its real transform times `modes` (mx, my // 2 + 1).

    By fixed blocks: the library's own threads group lines, and so round, by their number.
    """
    mx, my = field.shape[0], field.shape[1]
    rows, columns = max(1, _FILTER_POINTS // my), max(8, _FILTER_POINTS // mx)
    spectrum = np.empty((mx, my // 2 + 1), dtype=np.complex128)
    out = np.empty((mx, my))

    def forward(start: int) -> None:
        part = slice(start, start + rows)
        spectrum[part] = ducc0.fft.r2c(field[part], axes=(1,), nthreads=1)

    def along(start: int) -> None:
        part = spectrum[:, start : start + columns]
        ducc0.fft.c2c(part, axes=(0,), forward=True, out=part, nthreads=1)
        part *= modes[:, start : start + columns]
        ducc0.fft.c2c(part, axes=(0,), forward=False, inorm=2, out=part, nthreads=1)

    def backward(start: int) -> None:
        part = slice(start, start + rows)
        out[part] = ducc0.fft.c2r(
            spectrum[part], axes=(1,), lastsize=my, forward=False, inorm=2, nthreads=1
        )

    workers.run(forward, range(0, mx, rows))
    workers.run(along, range(0, spectrum.shape[1], columns))
    workers.run(backward, range(0, mx, rows))
    return out
