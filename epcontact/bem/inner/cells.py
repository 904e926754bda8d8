"""Cells of the grid, in which the elastic points are counted and summed.

The preconditioner works on these cells, and a Newton step keeps the force of each
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

#: Points a side of a cell; where the spacings differ, along the axis of the closer
#: points.
CELL = 16


def cells_of(symbol: Symbol) -> tuple[int, int]:
    """The number of cells in each direction of a grid; (1, 1) where it is too small for
    more. Cells are as wide as long in units of length, not in points; they are at least
    three points wide, or one, so that a wave has its aliases on the cells' grid at
    other waves of the points.
    """
    (nx, ny), oblong = symbol.shape, symbol.oblong()
    wanted = CELL * min(1.0, oblong), CELL / max(1.0, oblong)
    along, across = (side if side >= 3 else 1.0 for side in wanted)
    mx, my = max(1, int(nx / along)), max(1, int(ny / across))
    return (1, 1) if (nx > 1 and mx < 2) or (ny > 1 and my < 2) else (mx, my)


class Cells:
    """The cells that listed points lie in; `counts` (cells,) are the points of each, as
    floats. Blocks of rows share the cells at their edges, so each block sums over a
    range of cells of its own; `numbers` are the cells of its points, counted from the
    first one of that range.
    """

    def __init__(self, convolution: Convolution, points: Points) -> None:
        self.workers, self.points = convolution.workers, points
        self.shape = cells_of(convolution.symbol)
        nx, (mx, my) = convolution.shape[0], self.shape
        self._ranges = [
            slice(rows.start * mx // nx * my, ((rows.stop - 1) * mx // nx + 1) * my)
            for rows in convolution.rows
        ]
        self.numbers = split(np.empty(points.index.size, dtype=np.int32), points.parts)
        first = [cells.start for cells in self._ranges]
        (index,) = points.split(points.index)
        columns = convolution.symbol.once(_cell_columns)
        (self.counts,) = self.sums(
            number_cells, 1, index, columns, nx, self.shape, first
        )

    def split(self, values: FloatArray) -> list[NDArray[Any]]:
        """For each block the values (cells,) of its range of cells."""
        return split(values, self._ranges)

    def sums(
        self, kernel: Callable[..., None], number: int, *arguments: Any
    ) -> FloatArray:
        """(number, cells) sums over the points of each cell.

        kernel: fills an array (number, cells of a block) by the cells of its points.
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
    """The column of cells of each column of points."""
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
    """cell = the number of the cell of each point, from `first` on; sums: points by
    cell.

    columns: the column of cells of each of the columns of points; nx: rows of points.
    """
    ny, (mx, my) = columns.size, cells
    sums[:] = 0.0
    row, end, begin = -1, 0, 0
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
    """sums = the sums of values by cell."""
    sums[:] = 0.0
    for k in range(cell.size):
        sums[0, cell[k]] += values[k]
