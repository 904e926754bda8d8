"""The rows of a solution around a row of cells, in memory for one pass over a periodic grid.

All that the pass needs to know of a point is v = p - c g: at most 0 where apart, at least the
hardness where plastic.  c is that of `front` for links along x and, on oblong cells, for those
along y.  A link needs three points before its second one and two after it, so that eight rows are
enough, row i at i & LAST, with PAD more columns at both ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.areas.front import compiled
from epcontact.results import FloatArray

LAST, PAD = 7, 4

Bytes = NDArray[np.uint8]
#: Numbers of columns.  Those without a sign need no test for a negative index.
Columns = NDArray[np.uint32]


class Solution(NamedTuple):
    """A solution on a periodic grid.

    Attributes:
        pressure, gap: (nx, ny).
        hardness: the least pressure of a plastic point.
        stiffness: c of `front` for links along x and along y.
    """

    pressure: FloatArray
    gap: FloatArray
    hardness: float
    stiffness: tuple[float, float]


class Rows(NamedTuple):
    """What is in memory, in w columns.

    Attributes:
        v: (1 or 2, 8, w) for links along x and, where it differs, along y.
        inside: (8, w) 0 where apart, 1 where elastic and 17 where plastic.
        codes: (w,) which corners are inside, of the cell whose last corner is in a column: a bit
            for each of (0, 0), (1, 0), (1, 1), (0, 1), four for each front.
        lists: (3, w) columns where there is something to do.
    """

    v: FloatArray
    inside: Bytes
    codes: Bytes
    lists: Columns


@compiled
def empty_rows(w: int, oblong: bool) -> Rows:
    """Memory for w columns."""
    v, inside = np.empty((1 + oblong, LAST + 1, w)), np.empty((LAST + 1, w), np.uint8)
    return Rows(v, inside, np.empty(w, np.uint8), np.empty((3, w), np.uint32))


@compiled
def fill(rows: Rows, i: int, columns: tuple[int, int], solution: Solution) -> None:
    """Put row i into memory, from PAD columns before the first to PAD after the last."""
    (pressure, gap, hardness, stiffness), done = solution, 0
    nx, ny = pressure.shape
    first, width = (columns[0] - PAD) % ny, columns[1] - columns[0] + 2 * PAD
    while done < width:
        p, g = pressure[i % nx, first:], gap[i % nx, first:]
        inside, count = rows.inside[i & LAST, done:], min(ny - first, width - done)
        for j in range(count):
            inside[j] = (p[j] > 0) + 16 * (p[j] >= hardness)
        for layer in range(len(rows.v)):
            v, c = rows.v[layer, i & LAST, done:], stiffness[layer]
            for j in range(count):
                v[j] = _field(p[j], g[j], hardness, c)
        done, first = done + count, 0


@compiled
def _field(p: float, g: float, hardness: float, c: float) -> float:
    """v of a point."""
    if p <= 0:
        return float(-c * max(g, 0.0))
    if p >= hardness:
        return float(hardness - c * min(g, 0.0))
    return p


@compiled
def busy_cells(rows: Rows, i: int, stop: int) -> Columns:
    """Columns from PAD - 1 of cells that have a front, or whose last corner is elastic."""
    busy: Columns = rows.lists[0]
    start, count = PAD - 1, 0
    above, here = rows.inside[(i - 1) & LAST, start - 1 :], rows.inside[i & LAST, start - 1 :]
    codes = rows.codes[start:stop]
    for j in range(len(codes)):
        codes[j] = above[j] + 2 * here[j] + 4 * here[j + 1] + 8 * above[j + 1]
    for j in range(len(codes)):
        busy[count] = start + j
        count += (codes[j] != 0) & (codes[j] != 255)
    return busy[:count]
