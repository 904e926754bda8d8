"""The fronts of a contact on a grid: one pass locates them in every cell that has one.

A front crosses the links between neighbouring points, where `front` locates it.  Straight
segments between the crossings of a cell bound the area.  What is done at a few points or cells goes
through lists of them, so that the loops have no branches and processors do several at a time.

Besides the area, the pass adds up over each front the sums that `rim_correction` needs:

OFFSET    segment length that no edge holds times the tabulated offset at u = hardness/|grad v|
          (grad per spacing).  u is the width of the elastic strip in spacings where both fronts
          pass the cell, and large where there is one front only.
LENGTH    segment length
HARMONIC  segment length that no edge holds times cos 4 theta
SINE      segment length that no edge holds times sin 4 theta
CHANCE    segment length that no edge holds times the square of the doubt of `front`
COMMON    segment length that no edge holds times the doubt of `front`, outwards positive: it adds
          up where all of a front meets the grid alike, or is bent alike
HELD      segment length that edges hold
FLOWING   segment length that edges hold where plastic points are next to points apart
ALIGNED   segment length that edges hold times cos 4 theta
HIDDEN    segment length times the width of the zone hidden at edges
KINKED    segment length where the surface has a kink
TURN      turn of the front, a quarter for each corner cut off.  Over a whole front this adds up
          to its Euler number.
TIPS      points apart (or plastic) with at most two of their eight neighbours in the same state,
          but for those of spots of two or three points
SQUARES   squares of the areas of gaps that may be hidden between points that all touch, in waves,
          at tips and at creases, and of what lone points lack of CORNER
CREASE    areas of gaps that may be hidden at creases between points that all touch
POINTS    points inside

Sums have two parts: those of the front for itself, and those of fronts so steep that they move
with the other front beside them.  A front of u < 1 spacings belongs by u^2 to the first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.bem import workers
from epcontact.bem.areas.front import LINK_ROWS, PLACE, compiled, inlined, locate
from epcontact.bem.areas.hidden import add_hidden, add_tips
from epcontact.bem.areas.rows import (
    LAST,
    PAD,
    Bytes,
    Columns,
    Rows,
    Solution,
    busy_cells,
    empty_rows,
    fill,
)
from epcontact.results import FloatArray

#: Values of u at which the offset is tabulated, all of them multiples of U_STEP.
U_NODES = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.05, 1.25, 1.5, 1.8, 2.2, 2.8, 3.5])
U_STEP = 0.05
#: What `front` misses on straight fronts that meet all their cells alike, beside its doubt, in
#: spacings: the rms of the direction that has most of it (`rim.calibrate_directions`).
LOCATED = 0.005

#: Indices of the sums (SUMS, front, part).
AREA, OFFSET, TURN, FLOWING, LENGTH, HARMONIC, SINE, CHANCE, COMMON = range(9)
HELD, ALIGNED, HIDDEN, KINKED, POINTS, TIPS, SQUARES, CREASE = range(9, 17)
SUMS = (17, 2, 2)

#: For each set of corners inside (`Rows.codes`), the two sides that a front crosses; side k is that
#: from corner k to the next.  A corner that is cut off is between the second side and the first.
#: Of two opposite corners the first, or its neighbour, and the other one are cut off.
_SIDES = np.array(
    [
        *((0, 0), (0, 3), (1, 0), (1, 3), (2, 1), (0, 3), (2, 0), (3, 2)),
        *((3, 2), (2, 0), (1, 0), (2, 1), (1, 3), (1, 0), (0, 3), (0, 0)),
    ]
)
#: Whether the corner cut off, or the first of two neighbours, is inside.
_INSIDE = np.array([0, 1, 1, 1, 1, 1, 1, 0, 1, 0, 1, 0, 0, 0, 0, 0], np.bool_)
#: Links run along sides 0 and 1 and against sides 2 and 3.  A place on a link is at
#: _WAY[side, 0] + _WAY[side, 1] * place of the side.
_WAY = np.array([[0.0, 1.0], [0.0, 1.0], [1.0, -1.0], [1.0, -1.0]])

#: Rows of a table of segments, as `_put_segments` and then `_add_segments` leave them:
#: 1; u, then the share that counts for itself; the changes of v along x and y, then cos 4 theta and
#: sin 4 theta; the way from the corner, or the first of two neighbours, then the length;
_ONE, _OWN, _COS4, _SIN4, _LENGTH = range(5)
#: the way from the same corner, or the second, then the length that no edge holds; the share that
#: edges hold, then this length; the width of hidden zones; the doubt; its square, at first u;
_FREE, _STUCK, _ZONE, _DOUBT, _SQUARE = range(5, 10)
#: the share of a kink; the area inside, less that of the last corner; 1 where the corner is inside
#: and -1 where not, then the turn; whether it is a corner, then the offset; if plastic points are
#: next to points apart.
_KINK, _AREA, _TURN, _OFFSET, _FLOWS = range(10, 15)
#: What the sums from AREA to KINKED add up: the share, and two factors.
_SUMMED = np.array(
    [
        *((_ONE, _ONE, _AREA), (_ONE, _OFFSET, _FREE), (_ONE, _ONE, _TURN), (_ONE, _FLOWS, _STUCK)),
        *((_OWN, _ONE, _LENGTH), (_OWN, _COS4, _FREE), (_OWN, _SIN4, _FREE)),
        *((_OWN, _SQUARE, _FREE), (_OWN, _DOUBT, _FREE), (_OWN, _ONE, _STUCK)),
        *((_OWN, _COS4, _STUCK), (_OWN, _ZONE, _LENGTH), (_OWN, _KINK, _LENGTH)),
    ]
)
#: Segments are added up as soon as there are so many.
_BATCH = 256


class Fronts(NamedTuple):
    """Links that fronts cross, and segments of fronts in cells, in w columns.

    Attributes:
        crossed: (4 w,) links: 8 * (column - 3) + 4 * front + 2 along x or 1 along y.
        links: (LINK_ROWS, 4 w) as of `front.locate`.
        found: (6 w + 1, 5) what it found, for either front on links along x, and along y in even
            and in odd rows; the link that ends in column j is at j + 1 of its w.
        segments: (2, 15, _BATCH + 2 w) of either front.
    """

    crossed: Columns
    links: FloatArray
    found: FloatArray
    segments: FloatArray


def tabulated(offsets: FloatArray) -> FloatArray:
    """The table that `sweep` needs, from offsets at U_NODES."""
    return np.interp(U_STEP * np.arange(round(U_NODES[-1] / U_STEP) + 1), U_NODES, offsets)


@compiled
def sweep(solution: Solution, table: FloatArray, blocks: NDArray[np.int64]) -> FloatArray:
    """The sums (n, *SUMS) over blocks of the cells of a periodic grid.

    table: of `tabulated`; blocks: (n, 4) the first row and the row after the last of the cells'
    last corners, and so their columns; none has more columns than the first.
    """
    sums, w = np.zeros((len(blocks), *SUMS)), blocks[0, 3] - blocks[0, 2] + 2 * PAD
    rows = empty_rows(w, solution.stiffness[0] != solution.stiffness[1])
    links, found = np.empty((LINK_ROWS, 4 * w)), np.empty((6 * w + 1, 5))
    segments = np.empty((2, 15, _BATCH + 2 * w))
    fronts = Fronts(np.empty(4 * w, np.uint32), links, found, segments)
    for n in range(len(blocks)):
        first, stop, left, right = blocks[n]
        _sweep_block(solution, table, rows, fronts, (first, stop), (left, right), sums[n])
    return sums


@inlined
def _sweep_block(
    solution: Solution,
    table: FloatArray,
    rows: Rows,
    fronts: Fronts,
    block: tuple[int, int],
    columns: tuple[int, int],
    sums: FloatArray,
) -> None:
    """Add the sums over the cells of a block of rows and columns."""
    hardness, stop = solution.hardness, columns[1] - columns[0] + PAD
    counts = np.zeros(2, np.int64)
    for i in range(block[0] - 4, block[0] + 2):
        fill(rows, i, columns, solution)
    # The row and the column before have links of the first cells.
    for i in range(block[0] - 1, block[1]):
        fill(rows, i + 2, columns, solution)
        busy = busy_cells(rows, i, stop)
        _locate(rows, fronts, i, busy, hardness)
        if i < block[0]:
            continue
        busy = busy[int(len(busy) > 0 and busy[0] < PAD) :]
        for front in range(2 if hardness < np.inf else 1):
            segments, points = fronts.segments[front], 0
            count = _put_segments(rows, fronts, i, busy, front, hardness, counts[front])
            if count > _BATCH or i == block[1] - 1:
                _add_segments(segments, count, hardness, table, sums[:, front])
                count = 0
            counts[front] = count
            for inside in rows.inside[i & LAST, PAD:stop]:
                points += inside > 16 * front
            sums[POINTS, front, 0] += points
            sums[AREA, front, 0] += points
        add_tips(rows, i, busy, hardness, sums[TIPS, :, 0])
        add_hidden(rows, i, busy, hardness, sums[SQUARES : CREASE + 1, :, 0])


@compiled
def _find_links(codes: Bytes, columns: Columns, crossed: Columns) -> int:
    """Put the links along x and y that fronts cross, at last corners in `columns`, into memory."""
    count = 0
    for j in columns:
        changes = codes[j] ^ codes[j] >> 1
        for link in (1, 2, 5, 6):
            crossed[count] = 8 * (j - 3) + link
            count += (changes >> link) & 1
    return count


@inlined
def _locate(rows: Rows, fronts: Fronts, i: int, columns: Columns, hardness: float) -> None:
    """Locate fronts on the links along x and y that end in row i and in `columns`."""
    codes, (crossed, links, found, _), w = rows.codes, fronts, len(rows.codes)
    count = _find_links(codes, columns, crossed)
    v, across = rows.v.reshape(-1), (len(rows.v) - 1) * (LAST + 1) * w
    six = np.empty((4, 6), np.uint32)  # the points of links along y and x, from inside or outside
    for k in range(6):
        along_y, along_x = across + (i & LAST) * w + k, ((i + k - 3) & LAST) * w + 3
        six[0, k], six[1, 5 - k], six[2, k], six[3, 5 - k] = along_y, along_y, along_x, along_x
    for n in range(count):
        link = int(crossed[n])
        j, front, x = link >> 3, (link >> 2) & 1, (link >> 1) & 1
        cap, sign = (hardness, -1.0) if front else (0.0, 1.0)
        turned = ((codes[j + 3] >> (4 * front + 2)) & 1) ^ front
        for k in range(6):
            links[k, n] = cap + sign * v[six[2 * x + turned, k] + j]
    locate(links, count, hardness)
    into, y = np.empty(4, np.uint32), 1 + (i & 1)
    into[0], into[1], into[2], into[3] = y * w + 4, 4, (3 + y) * w + 4, 3 * w + 4
    for n in range(count):
        link = int(crossed[n])
        j, front, x = link >> 3, (link >> 2) & 1, (link >> 1) & 1
        turned = ((codes[j + 3] >> (4 * front + 2)) & 1) ^ front
        to, place = into[2 * front + x] + j, links[PLACE, n]
        found[to, 0] = 1 - place if turned else place
        for k in range(1, 5):
            found[to, k] = links[PLACE + k, n]


@inlined
def _put_segments(
    rows: Rows, fronts: Fronts, i: int, columns: Columns, front: int, hardness: float, start: int
) -> int:
    """Put the segments of a front in a row's cells into memory from `start` on; where they end."""
    codes, cells, w, number = rows.codes, rows.lists[1], len(rows.codes), 0
    for j in columns:
        code = (codes[j] >> (4 * front)) & 15
        cells[number] = j
        number += (code != 0) & (code != 15)
    (x_0, x_1), (y_0, y_1) = _two_rows(rows.v[0], i), _two_rows(rows.v[-1], i)
    segments, first, y = fronts.segments[front], 3 * front * w, (i & 1) * w
    sides = np.empty(4, np.uint32)
    sides[0], sides[1], sides[2], sides[3] = (
        first,
        first + w + y + 1,
        first + 1,
        first + 2 * w - y + 1,
    )
    end = start + number
    for n in range(start, start + number):
        j = cells[n - start]
        code = (codes[j] >> (4 * front)) & 15
        a, b, inside = _SIDES[code, 0], _SIDES[code, 1], _INSIDE[code]
        opposite = code % 5 == 0  # 5 or 10
        if opposite:
            middle = x_0[j - 1] + x_0[j] + x_1[j - 1] + x_1[j]
            middle += y_0[j - 1] + y_0[j] + y_1[j - 1] + y_1[j]
            if middle > (8 * hardness if front else 0.0):  # the inside corners are connected
                a, b, inside = a ^ 1, b ^ 3, False
        segments[_ONE, n] = 1.0
        segments[_COS4, n] = (x_1[j - 1] + x_1[j] - x_0[j - 1] - x_0[j]) / 2
        segments[_SIN4, n] = (y_0[j] + y_1[j] - y_0[j - 1] - y_1[j - 1]) / 2
        segments[_OFFSET, n] = (a ^ b) & 1
        segments[_AREA, n] = (0.0 if inside else 1.0) - ((code >> 2) & 1)
        segments[_TURN, n] = 1.0 if inside else -1.0
        segments[_FLOWS, n] = codes[j] == 17 * (codes[j] & 15)
        _put_ends(fronts.found, sides[a] + j, sides[b] + j, (a, b), segments, n)
        if opposite:
            for k in range(len(segments)):
                segments[k, end] = segments[k, n]
            a, b = a ^ 2, b ^ 2
            _put_ends(fronts.found, sides[a] + j, sides[b] + j, (a, b), segments, end)
            for k in (_STUCK, _ZONE, _DOUBT, _KINK):
                segments[k, n] = segments[k, end] = (segments[k, n] + segments[k, end]) / 2
            segments[_AREA, end] = 0.0
            end += 1
    return end


@compiled
def _two_rows(v: FloatArray, i: int) -> tuple[FloatArray, FloatArray]:
    """The row before, and row i."""
    return v[(i - 1) & LAST], v[i & LAST]


@compiled
def _put_ends(
    found: FloatArray, one: int, other: int, sides: tuple[int, int], table: FloatArray, n: int
) -> None:
    """Put what was found at both ends of a segment, on two sides, into memory."""
    a, b = sides[0], sides[1] ^ 2
    table[_LENGTH, n] = _WAY[a, 0] + _WAY[a, 1] * found[one, 0]
    table[_FREE, n] = _WAY[b, 0] + _WAY[b, 1] * found[other, 0]
    table[_STUCK, n] = (found[one, 1] + found[other, 1]) / 2
    table[_ZONE, n] = (found[one, 2] + found[other, 2]) / 2
    table[_DOUBT, n] = (found[one, 3] + found[other, 3]) / 2
    table[_KINK, n] = (found[one, 4] + found[other, 4]) / 2


@compiled
def _add_segments(
    segments: FloatArray, count: int, hardness: float, table: FloatArray, sums: FloatArray
) -> None:
    """Add segments of a front to its sums."""
    t = segments
    for n in range(count):
        dx, dy = t[_COS4, n], t[_SIN4, n]
        square = dx * dx + dy * dy
        t[_SQUARE, n] = hardness / math.sqrt(square)
        t[_COS4, n] = 1 - 8 * (dx * dy / square) ** 2 if square > 0 else 0.0
        t[_SIN4, n] = 4 * dx * dy * (dx - dy) * (dx + dy) / square**2 if square > 0 else 0.0
    for n in range(count):
        x, y, held, corner = t[_LENGTH, n], t[_FREE, n], t[_STUCK, n], t[_OFFSET, n] > 0
        t[_AREA, n] += t[_TURN, n] * (x * y if corner else x + y) / 2
        t[_TURN, n] = 0.25 * t[_TURN, n] if corner else 0.0
        x, y = (x, y) if corner else (1.0, x - y)
        length = math.sqrt(x * x + y * y)
        t[_LENGTH, n], t[_FREE, n], t[_STUCK, n] = length, (1 - held) * length, held * length
        t[_OWN, n] = max(min(t[_SQUARE, n], 1.0) ** 2, held)
    for n in range(count):
        t[_OFFSET, n] = _interpolated(t[_SQUARE, n], table)
        t[_SQUARE, n] = t[_DOUBT, n] ** 2
    for m in range(len(_SUMMED)):
        _add_up(t, _SUMMED[m], count, sums[m])


@workers.compiled
def _add_up(segments: FloatArray, rows: NDArray[np.int64], count: int, sums: FloatArray) -> None:
    """Add up products of two rows in two parts, of which a third row has the share of the first."""
    own = shared = 0.0
    for n in range(count):
        share, value = segments[rows[0], n], segments[rows[1], n] * segments[rows[2], n]
        own += share * value
        shared += (1 - share) * value
    sums[0] += own
    sums[1] += shared


@compiled
def _interpolated(u: float, table: FloatArray) -> float:
    """The offset at u; constant beyond the table."""
    place = min(u / U_STEP, len(table) - 1.0)
    k = min(int(place), len(table) - 2)
    return float(table[k] + (place - k) * (table[k + 1] - table[k]))
