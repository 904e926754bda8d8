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
    """Return the number of cells along x and along y of a symbol's grid.

    A cell is a square of grid points, CELL to a side where the spacings are equal.
    Cells are as wide as long in units of length, not in points.  The result is (1, 1)
    if the grid is too small for two cells along each direction.
    """
    nx, ny = symbol.shape
    oblong = symbol.oblong()
    mx = _cells_along(nx, CELL * min(1.0, oblong))
    my = _cells_along(ny, CELL / max(1.0, oblong))
    too_few = (nx > 1 and mx < 2) or (ny > 1 and my < 2)
    return (1, 1) if too_few else (mx, my)


def _cells_along(points: int, side: float) -> int:
    """Return how many cells fit along a direction, at least one.

    points: number of grid points along it; side: points along a side of a cell, which
    counts as 1 if it is less than _NARROWEST.
    """
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
        """Find the cell of each listed point, and count the points of each cell.

        convolution: of the grid, with its blocks of rows and threads; points: the
        listed points.
        """
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
        """Return, for each block of rows, the values of the cells that it touches.

        values: (cells,) of all cells, row by row.  The results are views.
        """
        return split(values, self._ranges)

    def sums(
        self, kernel: Callable[..., None], number: int, *arguments: Any
    ) -> FloatArray:
        """Return sums (number, cells) over the listed points of each cell.

        kernel: a compiled function that is called for each block of rows with the cell
        of each of its points, an array (number, cells of the block) to fill with sums,
        and the arguments; number: how many sums there are for each cell; arguments: of
        the kernel; a list holds one item for each block.
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
    """Return (ny,) the column of cells in which each column of grid points lies.

    symbol: compliance of each mode of the grid (nx, ny).
    """
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
    """Find the cells of the listed points of a block, and count the points by cell.

    cell: (points,) overwritten by the number of each point's cell; sums: (1, cells of
    the block) overwritten by the numbers of points; index: (points,) flat indices of
    the points in the grid, ascending; columns: (ny,) the column of cells of each column
    of points; nx: rows of points; cells: number of cells along x and along y; first:
    number of the block's first cell, from which the numbers in `cell` are counted.
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
    """Overwrite `sums` (1, cells) by the sum of the values of the points of each cell.

    cell: (points,) number of the cell (square of grid points) of each point; values:
    (points,).
    """
    sums[:] = 0.0
    for k in range(cell.size):
        sums[0, cell[k]] += values[k]
