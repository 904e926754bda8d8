"""Cells of the grid, in which the elastic points are counted and summed.

The preconditioner works on these cells, and a Newton step keeps the force of each cell
(`bounds.put`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.transforms import Convolution, Points, Symbol
from epcontact.bem.workers import compiled, split
from epcontact.results import FloatArray

#: Points along a side of a cell.  Where the spacings differ, these are the points along
#: the axis of the closer points.
CELL = 16
# A side of fewer points is one point wide instead, so that a wave has its aliases on
# the cells' grid at other waves of the points.
_NARROWEST = 3


def cells_of(symbol: Symbol) -> tuple[int, int]:
    """Return the number of cells along each direction of a symbol's grid.

    Cells are as wide as long in units of length, not in points.  The result is (1, 1)
    where the grid is too small for more cells.
    """
    nx, ny = symbol.shape
    oblong = symbol.oblong()
    mx = _cells_along(nx, CELL * min(1.0, oblong))
    my = _cells_along(ny, CELL / max(1.0, oblong))
    too_few = (nx > 1 and mx < 2) or (ny > 1 and my < 2)
    return (1, 1) if too_few else (mx, my)


def _cells_along(points: int, side: float) -> int:
    """Return how many cells of a side, in points, a direction has, at least one."""
    if side < _NARROWEST:
        side = 1.0
    return max(1, int(points / side))


class Cells:
    """The cells that listed points lie in.

    Blocks of rows share the cells at their edges, so each block sums over a range of
    cells of its own.

    Attributes:
        workers: threads of the passes.
        points: the listed points.
        shape: number of cells along each direction.
        counts: (cells,) the points in each cell, as floats.
        numbers: for each block, the cell of each point, counted from the first cell of
            the block's range.
    """

    def __init__(self, convolution: Convolution, points: Points) -> None:
        self.workers = convolution.workers
        self.points = points
        self.shape = cells_of(convolution.symbol)
        nx = convolution.shape[0]
        mx, my = self.shape
        self._ranges = []
        for rows in convolution.rows:
            begin = rows.start * mx // nx
            end = (rows.stop - 1) * mx // nx + 1
            self._ranges.append(slice(begin * my, end * my))
        self.numbers = split(np.empty(points.index.size, dtype=np.int32), points.parts)
        first = [cells.start for cells in self._ranges]
        (index,) = points.split(points.index)
        columns = convolution.symbol.once(_cell_columns)
        (self.counts,) = self.sums(
            number_cells, 1, index, columns, nx, self.shape, first
        )

    def split(self, values: FloatArray) -> list[NDArray[Any]]:
        """Return, for each block, the values (cells,) of its range of cells."""
        return split(values, self._ranges)

    def sums(
        self, kernel: Callable[..., None], number: int, *arguments: Any
    ) -> FloatArray:
        """Return (number, cells) sums over the points of each cell.

        kernel: called for each block with the cells of its points, an array (number,
        cells of the block) to fill, and the arguments.
        """
        parts = [np.empty((number, cells.stop - cells.start)) for cells in self._ranges]
        self.workers.each(kernel, self.numbers, parts, *arguments)
        if len(parts) == 1:
            return parts[0]
        out = np.zeros((number, self.shape[0] * self.shape[1]))
        for cells, part in zip(self._ranges, parts, strict=True):
            out[:, cells] += part
        return out


def _cell_columns(symbol: Symbol) -> NDArray[np.int32]:
    """Return the column of cells of each column of points."""
    ny = symbol.shape[1]
    return (np.arange(ny) * cells_of(symbol)[1] // ny).astype(np.int32)


@compiled
def number_cells(
    cell: Any,
    sums: Any,
    index: Any,
    columns: Any,
    nx: int,
    cells: tuple[int, int],
    first: int,
) -> None:
    """Write the number of each point's cell to `cell`, and count its points in `sums`.

    index: flat indices of the points; columns: the column of cells of each column of
    points; nx: rows of points; cells: cells along each direction; first: number of the
    block's first cell, from which the numbers are counted.
    """
    ny = columns.size
    mx, my = cells
    sums[:] = 0.0
    row = -1
    begin = end = 0
    for k in range(index.size):
        if index[k] >= end:
            row = index[k] // ny
            end = (row + 1) * ny
            begin = row * mx // nx * my - first
        number = begin + columns[index[k] - row * ny]
        cell[k] = number
        sums[0, number] += 1.0


@compiled
def sum_cells(cell: Any, sums: Any, values: Any) -> None:
    """Write the sums of values by cell to `sums`."""
    sums[:] = 0.0
    for k in range(cell.size):
        sums[0, cell[k]] += values[k]
