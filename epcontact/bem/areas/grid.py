"""The fronts of a contact on a periodic grid: one pass over its cells, and what it adds up.

All that the pass needs to know of a point is v = p - c g: at most 0 where apart, at least the
hardness where plastic; c is that of `front` for links along x and, on oblong cells, for those along
y.  A front crosses links between neighbouring points, where `front` locates it, and straight
segments between the two crossings of a cell bound the area.  `Sums` says what is added up.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.areas.front import Links, compiled, empty_links, inlined, locate
from epcontact.bem.areas.hidden import LAST, Bytes, Columns, add_hidden, add_tips
from epcontact.results import FloatArray

#: Values of u at which the offset is tabulated, all of them multiples of U_STEP.
U_NODES = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.05, 1.25, 1.5, 1.8, 2.2, 2.8, 3.5])
U_STEP = 0.05
#: Columns in memory before the first cell's and after the last one's.
PAD = 4

#: For each set of corners inside (a bit each), the two sides that a front crosses; side k is that
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


class Solution(NamedTuple):
    """A solution on a periodic grid.

    Attributes:
        pressure, gap: (nx, ny).
        hardness: the least pressure of a plastic point.
        stiffness: c of `front` for links along x and along y.
        offsets: table of the offsets of a front, of `tabulated`.
    """

    pressure: FloatArray
    gap: FloatArray
    hardness: float
    stiffness: tuple[float, float]
    offsets: FloatArray


class Sums(NamedTuple):
    """Sums over the fronts around the contact and around its plastic part: (..., 2 fronts, 2).

    A front of u < 1 spacings, the width hardness/|grad v| of the elastic strip beside it, moves
    with the other front there: it belongs by u^2 to the first of the last two parts, else to the
    second.  Lengths are in spacings, "free" ones are those that no edge of the surface holds.

    Attributes:
        area: inside the located front, in cells.
        offset: free length times the tabulated offset at u.
        turn: of the front, a quarter for each corner cut off: over a whole front its Euler number.
        flowing: length held at edges where plastic points are next to points apart.
        length: of the front.
        harmonic, sine: free length times cos and sin of 4 theta.
        chance: free length times the square of the doubt of `front`.
        common: free length times this doubt, which is positive outwards: it adds up where all of a
            front meets the grid alike, or is bent alike.
        held: length held at edges.
        aligned: length held at edges times cos 4 theta.
        hidden: length times the width of the zone hidden at edges.
        kinked: length where the surface has a kink.
        points: inside the front.
        tips: points apart (or plastic) with at most two of their eight neighbours in the same
            state, but for those of spots of two or three points.
        squares: of the areas of gaps that may be hidden between points that all touch, and of what
            lone points lack of CORNER.
        crease: areas of gaps that may be hidden at creases between points that all touch.
    """

    area: FloatArray
    offset: FloatArray
    turn: FloatArray
    flowing: FloatArray
    length: FloatArray
    harmonic: FloatArray
    sine: FloatArray
    chance: FloatArray
    common: FloatArray
    held: FloatArray
    aligned: FloatArray
    hidden: FloatArray
    kinked: FloatArray
    points: FloatArray
    tips: FloatArray
    squares: FloatArray
    crease: FloatArray


class Rows(NamedTuple):
    """The rows of a solution around a row of cells, row i at i & LAST, in w columns.

    A link needs three points before its second one and two after it.

    Attributes:
        v: (1 or 2, 8, w) for links along x and, where it differs, along y.
        inside: (8, w) 0 where apart, 1 where elastic and 17 where plastic.
        codes: (w,) which corners are inside, of the cell whose last corner is in a column: a bit
            for each of (0, 0), (1, 0), (1, 1), (0, 1), four for each front.
        lists: (3, w) columns where there is something to do.
        crossed: (4 w,) links: 8 * (column - 3) + 4 * front + 2 along x or 1 along y.
        links: 4 w of them, as `front.locate` needs them.
        found: (2, 3, w) for each front what was found on the link that ends in a column: along x,
            and along y in even and in odd rows.
    """

    v: FloatArray
    inside: Bytes
    codes: Bytes
    lists: Columns
    crossed: Columns
    links: Links
    found: Links


def tabulated(offsets: FloatArray) -> FloatArray:
    """The table of a `Solution`, from offsets at U_NODES."""
    return np.interp(U_STEP * np.arange(round(U_NODES[-1] / U_STEP) + 1), U_NODES, offsets)


def sweep(solution: Solution, blocks: NDArray[np.int64]) -> FloatArray:
    """The `Sums` over blocks of the cells of a periodic grid, as an array (n, 17, 2, 2).

    blocks: (n, 4) the first row and the row after the last of the cells' last corners, and so their
    columns; none has more columns than the first.
    """
    w, oblong = blocks[0, 3] - blocks[0, 2] + 2 * PAD, len(set(solution.stiffness)) - 1
    sums = np.zeros((len(Sums._fields), len(blocks), 2, 2))
    rows = Rows(
        v=np.empty((1 + oblong, LAST + 1, w)),
        inside=np.empty((LAST + 1, w), np.uint8),
        codes=np.empty(w, np.uint8),
        lists=np.empty((3, w), np.uint32),
        crossed=np.empty(4 * w, np.uint32),
        links=empty_links(4 * w),
        found=Links(np.empty((0, 0)), *np.empty((5, 2, 3, w))),
    )
    _sweep(solution, blocks, rows, Sums(*sums))
    return np.moveaxis(sums, 1, 0)


@compiled
def _sweep(solution: Solution, blocks: NDArray[np.int64], rows: Rows, sums: Sums) -> None:
    hardness = solution.hardness
    for n in range(len(blocks)):
        first, stop, left, right = blocks[n]
        for i in range(first - 4, first + 2):
            _fill(rows, i, (left, right), solution)
        # The row and the column before have links of the first cells.
        for i in range(first - 1, stop):
            _fill(rows, i + 2, (left, right), solution)
            busy = _busy_cells(rows, i, right - left + PAD)
            _locate(rows, i, busy, hardness)
            if i < first:
                continue
            busy = busy[int(len(busy) > 0 and busy[0] < PAD) :]
            for front in range(2 if hardness < np.inf else 1):
                _add_segments(rows, i, busy, solution, sums, (n, front))
                points = 0
                for inside in rows.inside[i & LAST, PAD : right - left + PAD]:
                    points += inside > 16 * front
                sums.points[n, front, 0] += points
                sums.area[n, front, 0] += points
            add_tips(rows.v, rows.inside, i, busy, hardness, sums.tips[n, :, 0])
            squares, crease = sums.squares[n, :, 0], sums.crease[n, :, 0]
            add_hidden(rows.v, rows.lists[1:], i, busy, hardness, squares, crease)


@compiled
def _fill(rows: Rows, i: int, columns: tuple[int, int], solution: Solution) -> None:
    """Put row i into memory, from PAD columns before the first to PAD after the last."""
    (pressure, gap, hardness, stiffness, _), done = solution, 0
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
def _busy_cells(rows: Rows, i: int, stop: int) -> Columns:
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
def _locate(rows: Rows, i: int, columns: Columns, hardness: float) -> None:
    """Locate fronts on the links along x and y that end in row i and in `columns`."""
    codes, crossed, links, found = rows.codes, rows.crossed, rows.links, rows.found
    w = len(codes)
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
            links.values[k, n] = cap + sign * v[six[2 * x + turned, k] + j]
    locate(links, count, hardness)
    for n in range(count):
        link = int(crossed[n])
        j, front, x = (link >> 3) + 3, (link >> 2) & 1, (link >> 1) & 1
        turned, to = ((codes[j] >> (4 * front + 2)) & 1) ^ front, 0 if x else 1 + (i & 1)
        found.place[front, to, j] = 1 - links.place[n] if turned else links.place[n]
        found.held[front, to, j], found.hidden[front, to, j] = links.held[n], links.hidden[n]
        found.doubt[front, to, j], found.kinked[front, to, j] = links.doubt[n], links.kinked[n]


class _Cell(NamedTuple):
    """A cell with a front.

    Attributes:
        dx, dy: changes of v along x and y.
        sign: 1 if the corner that is cut off, or the first of two neighbours, is inside, else -1.
        corner: whether the front cuts off a corner.
        flows: whether plastic points are next to points apart.
    """

    dx: float
    dy: float
    sign: float
    corner: bool
    flows: bool


class _Segment(NamedTuple):
    """A segment of a front in a cell, between its crossings of two sides of the cell.

    Attributes:
        first: the way from the corner between the sides, or the first of two neighbours, to the
            crossing; second: that from this corner, or the second.
        held, zone, doubt, kinked: the means of both crossings.
    """

    first: float
    second: float
    held: float
    zone: float
    doubt: float
    kinked: float


@inlined
def _add_segments(
    rows: Rows, i: int, columns: Columns, solution: Solution, sums: Sums, place: tuple[int, int]
) -> None:
    """Add the segments of a front in a row's cells to the sums of `place`: block and front."""
    codes, (block, front) = rows.codes, place
    x_0, x_1 = rows.v[0, (i - 1) & LAST], rows.v[0, i & LAST]
    y_0, y_1 = rows.v[-1, (i - 1) & LAST], rows.v[-1, i & LAST]
    for j in columns:
        code = (codes[j] >> (4 * front)) & 15
        if code % 15 == 0:  # all of its corners are inside, or none
            continue
        a, b, inside = _SIDES[code, 0], _SIDES[code, 1], _INSIDE[code]
        opposite = code % 5 == 0  # 5 or 10
        if opposite:
            middle = x_0[j - 1] + x_0[j] + x_1[j - 1] + x_1[j]
            middle += y_0[j - 1] + y_0[j] + y_1[j - 1] + y_1[j]
            if middle > (8 * solution.hardness if front else 0.0):  # the inside is connected
                a, b, inside = a ^ 1, b ^ 3, False
        cell = _Cell(
            (x_1[j - 1] + x_1[j] - x_0[j - 1] - x_0[j]) / 2,
            (y_0[j] + y_1[j] - y_0[j - 1] - y_1[j - 1]) / 2,
            1.0 if inside else -1.0,
            ((a ^ b) & 1) == 1,
            codes[j] == 17 * (codes[j] & 15),
        )
        # The last corner is counted as a point.
        sums.area[block, front, 0] += (0.0 if inside else 1.0) - ((code >> 2) & 1)
        segment = _segment(rows.found, front, i, j, (a, b))
        if opposite:
            other = _segment(rows.found, front, i, j, (a ^ 2, b ^ 2))
            segment, other = _alike(segment, other), _alike(other, segment)
            _add(sums, place, cell, other, solution)
        _add(sums, place, cell, segment, solution)


@compiled
def _segment(found: Links, front: int, i: int, j: int, sides: tuple[int, int]) -> _Segment:
    """The segment between two sides of the cell whose last corner is in row i and column j."""
    a, b = sides
    one, other = _link(front, i, j, a), _link(front, i, j, b)
    first, second = found.place[one], found.place[other]
    return _Segment(
        1 - first if a > 1 else first,  # links run along sides 0 and 1 and against sides 2 and 3
        second if b > 1 else 1 - second,
        (found.held[one] + found.held[other]) / 2,
        (found.hidden[one] + found.hidden[other]) / 2,
        (found.doubt[one] + found.doubt[other]) / 2,
        (found.kinked[one] + found.kinked[other]) / 2,
    )


@compiled
def _link(front: int, i: int, j: int, side: int) -> tuple[int, int, int]:
    """Where what was found on the link along a side of a cell is."""
    if side % 2 == 0:
        return front, 0, j - 1 if side == 0 else j
    return front, 1 + (i + side // 2) % 2, j


@compiled
def _alike(segment: _Segment, other: _Segment) -> _Segment:
    """A segment with the means of what it and the other one of its cell have but their ways."""
    return _Segment(
        segment.first,
        segment.second,
        (segment.held + other.held) / 2,
        (segment.zone + other.zone) / 2,
        (segment.doubt + other.doubt) / 2,
        (segment.kinked + other.kinked) / 2,
    )


@compiled
def _add(
    sums: Sums, place: tuple[int, int], cell: _Cell, segment: _Segment, solution: Solution
) -> None:
    """Add a segment to the sums of a block and front."""
    (dx, dy, sign, corner, flows), (x, y, held, zone, doubt, kinked) = cell, segment
    square = dx * dx + dy * dy
    u, cos4, sin4 = solution.hardness / math.sqrt(square), 0.0, 0.0
    if square > 0:
        cos4 = 1 - 8 * (dx * dy / square) ** 2
        sin4 = 4 * dx * dy * (dx - dy) * (dx + dy) / square**2
    length = math.sqrt(x * x + y * y) if corner else math.sqrt(1 + (x - y) * (x - y))
    stuck, free, own = held * length, (1 - held) * length, max(min(u, 1.0) ** 2, held)
    block, front = place
    sums.area[block, front, 0] += sign * (x * y if corner else x + y) / 2
    sums.offset[block, front, 0] += _interpolated(u, solution.offsets) * free
    sums.turn[block, front, 0] += 0.25 * sign if corner else 0.0
    sums.flowing[block, front, 0] += stuck if flows else 0.0
    for part in range(2):
        share = own if part == 0 else 1 - own
        sums.length[block, front, part] += share * length
        sums.harmonic[block, front, part] += share * cos4 * free
        sums.sine[block, front, part] += share * sin4 * free
        sums.chance[block, front, part] += share * doubt * doubt * free
        sums.common[block, front, part] += share * doubt * free
        sums.held[block, front, part] += share * stuck
        sums.aligned[block, front, part] += share * cos4 * stuck
        sums.hidden[block, front, part] += share * zone * length
        sums.kinked[block, front, part] += share * kinked * length


@compiled
def _interpolated(u: float, table: FloatArray) -> float:
    """The offset at u; constant beyond the table."""
    place = min(u / U_STEP, len(table) - 1.0)
    k = min(int(place), len(table) - 2)
    return float(table[k] + (place - k) * (table[k + 1] - table[k]))
