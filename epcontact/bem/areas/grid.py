"""The fronts of a contact on a periodic grid: one pass over its cells, and what it adds up.

All that the pass needs to know of a point is v = p - c g: at most 0 where apart, at least the
hardness where plastic; c is that of `front` for links along x and, on oblong cells, for those along
y.  A front crosses links between neighbouring points, where `front` locates it, and straight
segments between the two crossings of a cell bound the area.  `Sums` says what is added up.

Front 0 bounds the contact and front 1 its plastic part.  A cell is named after its last corner,
point (i, j).  Its corners 0 to 3 are (i - 1, j - 1), (i, j - 1), (i, j) and (i - 1, j), and side k
runs from corner k to the next.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.areas.front import Links, compiled, empty_links, inlined, locate, release
from epcontact.bem.areas.hidden import Bytes, Columns, add_hidden, add_tips
from epcontact.results import FloatArray

#: Values of u at which the offset is tabulated.
U_NODES = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.05, 1.25, 1.5, 1.8, 2.2, 2.8, 3.5])
#: Points around the cells of a block that are looked at, too.
PAD = 4
#: By the sum of 2^k over the corners inside: the corner that is cut off, or the first of the two
#: that are on one side of the front.
_CUT = np.array([0, 0, 1, 0, 2, 0, 1, 3, 3, 1, 1, 2, 0, 1, 0, 0])


class Solution(NamedTuple):
    """A solution on a periodic grid."""

    pressure: FloatArray  # (nx, ny)
    gap: FloatArray  # (nx, ny)
    hardness: float  # the least pressure of a plastic point
    stiffness: tuple[float, float]  # c of `front` for links along x and along y
    offsets: FloatArray  # of a front, at U_NODES
    flowed: FloatArray  # (nx, ny) what earlier flow has lowered the surface by, or (0, 0)
    yielded: float  # the hardness of that flow


class Sums(NamedTuple):
    """Sums over the fronts around the contact and around its plastic part: (..., 2 fronts, 2).

    A front of u < 1 spacings, the width hardness/|grad v| of the elastic strip beside it, moves
    with the other front there.  The share u^2 of it is summed in the first place of the last axis,
    the rest in the second.  Lengths are in spacings; no edge of the surface holds "free" ones.
    """

    area: FloatArray  # inside the located front, in cells
    offset: FloatArray  # free length times the tabulated offset at u
    turn: FloatArray  # a quarter for each corner cut off: over a whole front its Euler number
    flowing: FloatArray  # length held at edges where plastic points are next to points apart
    length: FloatArray  # of the front
    harmonic: FloatArray  # free length times cos 4 theta
    sine: FloatArray  # free length times sin 4 theta
    chance: FloatArray  # free length times the square of the doubt of `front`
    #: Free length times this doubt, which is positive outwards: it adds up where all of a front
    #: meets the grid alike, or is bent alike.
    common: FloatArray
    held: FloatArray  # length held at edges
    aligned: FloatArray  # length held at edges times cos 4 theta
    hidden: FloatArray  # length times the width of the zone hidden at edges
    released: FloatArray  # length times the width that has come off flattened spots
    edges: FloatArray  # length of the front at edges of flattened spots
    kinked: FloatArray  # length where the surface has a kink
    points: FloatArray  # inside the front
    #: Points apart (or plastic) with at most two of their eight neighbours in the same state, but
    #: for those of spots of two or three points.
    tips: FloatArray
    #: Squares of the areas of gaps that may be hidden between points that all touch, and of what
    #: lone points lack of CORNER.
    squares: FloatArray
    crease: FloatArray  # areas of gaps that may be hidden at creases between points that all touch


class Block(NamedTuple):
    """The points of a block of cells, and PAD more on each side."""

    v: FloatArray  # (1 or 2, rows, columns) for links along x and, where it differs, along y
    inside: Bytes  # (rows, columns) 0 where apart, 1 where elastic and 17 where plastic
    #: For each cell of a row a bit for each corner inside front 0, and the next four for front 1.
    codes: Bytes
    depth: FloatArray  # (rows, columns) c w, or (0, 0) where nothing has flowed before


def sweep(solution: Solution, blocks: NDArray[np.int64]) -> FloatArray:
    """The `Sums` over blocks of the cells of a periodic grid, as an array (n, 19, 2, 2).

    blocks: (n, 4) the first row and the row after the last of the cells, and so their columns.
    """
    sums = np.zeros((len(Sums._fields), len(blocks), 2, 2))
    _sweep(solution, blocks, Sums(*sums))
    return np.moveaxis(sums, 1, 0)


@compiled
def _sweep(solution: Solution, blocks: NDArray[np.int64], sums: Sums) -> None:
    hardness = solution.hardness
    for n in range(len(blocks)):
        block = _block(solution, blocks[n])
        rows, width = block.inside.shape
        # By front and column, what was found on the link along x, and on those along y of even and
        # of odd rows, that end in the column.
        of = np.empty((7, 2, 3, width))
        found = Links(np.empty((0, 0)), of[0], of[1], of[2], of[3], of[4], of[5], of[6])
        # The row and the column before have links of the first cells.
        for i in range(PAD - 1, rows - PAD):
            busy = _busy_cells(block, i)
            _locate(block, found, i, busy, solution)
            if i < PAD:
                continue
            busy = busy[int(len(busy) > 0 and busy[0] < PAD) :]
            for front in range(2 if hardness < np.inf else 1):
                _add_segments(block, found, i, busy, solution, sums, (n, front))
                points = 0
                for inside in block.inside[i, PAD : width - PAD]:
                    points += inside > 16 * front
                sums.points[n, front, 0] += points
                sums.area[n, front, 0] += points
            add_tips(block.v, block.inside, i, busy, hardness, sums.tips[n, :, 0])
            add_hidden(block.v, i, busy, hardness, (sums.squares[n, :, 0], sums.crease[n, :, 0]))


@compiled
def _block(solution: Solution, place: NDArray[np.int64]) -> Block:
    (pressure, gap, hardness, stiffness, _, flowed, _), (first, last, left, right) = solution, place
    nx, ny = pressure.shape
    rows, columns = last - first + 2 * PAD, right - left + 2 * PAD
    v = np.empty((1 if stiffness[0] == stiffness[1] else 2, rows, columns))
    inside = np.empty((rows, columns), np.uint8)
    depth = np.zeros((rows, columns) if flowed.size else (0, 0))
    for i in range(rows):
        row, done, start = (first - PAD + i) % nx, 0, (left - PAD) % ny
        while done < columns:  # from one end of the period to the next
            stop = min(start + columns - done, ny)
            p, g, states = pressure[row, start:stop], gap[row, start:stop], inside[i, done:]
            for j in range(len(p)):
                states[j] = (p[j] > 0) + 16 * (p[j] >= hardness)
            for layer in range(len(v)):
                c, fields = stiffness[layer], v[layer, i, done:]
                for j in range(len(p)):
                    outside, plastic = -c * max(g[j], 0.0), hardness - c * min(g[j], 0.0)
                    fields[j] = outside if p[j] <= 0 else plastic if p[j] >= hardness else p[j]
            if flowed.size:
                w, sunk = flowed[row, start:stop], depth[i, done:]
                for j in range(len(p)):  # points that flow again are as on a first loading
                    sunk[j] = stiffness[0] * w[j] if p[j] < hardness else 0.0
            done, start = done + len(p), 0
    return Block(v, inside, np.empty(columns, np.uint8), depth)


@compiled
def _busy_cells(block: Block, i: int) -> Columns:
    """Find the codes of a row, and its cells that have a front or whose last corner is elastic."""
    before, here, codes = block.inside[i - 1], block.inside[i], block.codes
    busy, count = np.empty(len(codes), np.uint32), 0
    for j in range(1, len(codes)):
        codes[j] = before[j - 1] + 2 * here[j - 1] + 4 * here[j] + 8 * before[j]
    for j in range(PAD - 1, len(codes) - PAD):
        busy[count] = j
        count += (codes[j] != 0) & (codes[j] != 255)
    return busy[:count]


@inlined
def _locate(block: Block, found: Links, i: int, columns: Columns, solution: Solution) -> None:
    """Locate fronts on the links along x and y that end in row i and in `columns`."""
    v, codes, hardness = block.v, block.codes, solution.hardness
    links = empty_links(4 * len(columns))
    crossed, ends, count = np.empty(4 * len(columns), np.uint32), np.zeros((2, 2), np.int64), 0
    for front in range(2):
        cap, sign = (hardness, -1.0) if front else (0.0, 1.0)
        for y in range(2):
            begin, layer = count, len(v) - 1 if y else 0
            aspect = solution.stiffness[y] / solution.stiffness[0]
            for j in columns:  # between corners 2 and 3 along x, and 1 and 2 along y
                crossed[count] = j
                count += ((codes[j] ^ codes[j] >> 1) >> (4 * front + 2 - y)) & 1
            ends[front, y] = count
            for n in range(begin, count):
                j = crossed[n]
                turned = _ends_inside(codes[j], front)
                for k in range(6):  # from inside
                    way = 2 - k if turned else k - 3
                    p = v[layer, i, j + way] if y else v[layer, i + way, j]
                    links.values[k, n] = cap + sign * p
                links.depth[n] = 0.0
                if block.depth.size and front == 0:
                    last, out = (-1, 0) if not turned else (0, -1)
                    w = block.depth[i, j + last] if y else block.depth[i + last, j]
                    beyond = block.depth[i, j + out] if y else block.depth[i + out, j]
                    links.depth[n] = w * aspect if beyond == 0 else 0.0
                    next_ = 2 * out - last
                    after = block.depth[i, j + next_] if y else block.depth[i + next_, j]
                    if w > 0 and beyond > 0:
                        links.depth[n] = -1.0 if after == 0 else -2.0
    locate(links, count, hardness, solution.yielded)
    begin = 0
    for front in range(2):
        for y in range(2):
            to = 1 + (i & 1) if y else 0
            for n in range(begin, ends[front, y]):
                at, place = (front, to, crossed[n]), links.place[n]
                found.place[at] = 1 - place if _ends_inside(codes[crossed[n]], front) else place
                found.held[at] = links.held[n]
                found.hidden[at] = links.hidden[n]
                found.doubt[at] = links.doubt[n]
                found.kinked[at] = links.kinked[n]
                found.released[at] = links.released[n]
                found.depth[at] = links.depth[n] > 0
            begin = ends[front, y]


@inlined
def _ends_inside(code: int, front: int) -> int:
    """True if the last corner of a cell is inside front 0, or outside front 1."""
    return ((code >> (4 * front + 2)) & 1) ^ front


class _Cell(NamedTuple):
    """A cell with a front, and the means of what was found at its crossings."""

    dx: float  # changes of v along x and y
    dy: float
    steep: float  # |grad v|; at edges of flattened spots that at the peak of the load
    sign: float  # 1 if the corner that is cut off, or the first of two, is inside, else -1
    corner: bool  # whether the front cuts off a corner
    flows: bool  # whether plastic points are next to points apart
    held: float
    hidden: float
    doubt: float
    kinked: float
    released: float
    edge: float


@inlined
def _add_segments(
    block: Block,
    found: Links,
    i: int,
    columns: Columns,
    solution: Solution,
    sums: Sums,
    place: tuple[int, int],
) -> None:
    """Add the segments of a front in a row's cells to the sums of `place`: block and front."""
    v, codes, (n, front) = block.v, block.codes, place
    x_0, x_1, y_0, y_1 = v[0, i - 1], v[0, i], v[-1, i - 1], v[-1, i]
    deep = block.depth
    for j in columns:
        code = (codes[j] >> (4 * front)) & 15
        if code % 15 == 0:  # all of its corners are inside, or none
            continue
        cut, opposite, straight = _CUT[code], code % 5 == 0, int(code % 3 == 0)
        if opposite:
            middle = x_0[j - 1] + x_0[j] + x_1[j - 1] + x_1[j]
            middle += y_0[j - 1] + y_0[j] + y_1[j - 1] + y_1[j]
            if middle > (8 * solution.hardness if front else 0.0):  # the inside is connected
                cut ^= 1
        inside, held, hidden, doubt, kinked = float((code >> cut) & 1), 0.0, 0.0, 0.0, 0.0
        released = edge = 0.0
        sums.area[n, front, 0] += 1 - inside - ((code >> 2) & 1)  # which was counted as a point
        crossings = 4 if opposite else 2
        for k in range(crossings):  # of the front and the sides
            at = _link(front, i, j, (cut + (straight, 3, 1, 2)[k]) & 3)
            held, hidden = held + found.held[at], hidden + found.hidden[at]
            doubt, kinked = doubt + found.doubt[at], kinked + found.kinked[at]
            released, edge = released + found.released[at], edge + found.depth[at]
        held, hidden = held / crossings, hidden / crossings
        doubt, kinked = doubt / crossings, kinked / crossings
        released, edge = released / crossings, edge / crossings
        dx = (x_1[j - 1] + x_1[j] - x_0[j - 1] - x_0[j]) / 2
        dy = (y_0[j] + y_1[j] - y_0[j - 1] - y_1[j - 1]) / 2
        steep = sqrt(dx * dx + dy * dy)
        if deep.size:
            a, b, c, d = deep[i - 1, j - 1], deep[i, j - 1], deep[i, j], deep[i - 1, j]
            if min(a, b, c, d) > 0 and front == 0:  # inside a flattened spot nothing moves along
                steep = 0.0
            elif edge > 0:  # at the peak of the load
                along_x, along_y = dx + (b + c - a - d) / 2, dy + (d + c - a - b) / 2
                steep = sqrt(along_x * along_x + along_y * along_y)
        flows = codes[j] == 17 * (codes[j] & 15)
        cell = _Cell(
            dx,
            dy,
            steep,
            2 * inside - 1,
            not straight,
            flows,
            held,
            hidden,
            doubt,
            kinked,
            released,
            edge,
        )
        for corner in range(cut, cut + (4 if opposite else 1), 2):
            first = _way(found, front, i, j, corner + straight)
            second = 1 - _way(found, front, i, j, corner + 3)
            _add(sums, place, cell, first, second, solution)


@compiled
def _link(front: int, i: int, j: int, side: int) -> tuple[int, int, int]:
    """Return the place in `Links` of the link along a side of a cell."""
    if side & 1 == 0:
        return front, 0, j - 1 if side == 0 else j
    return front, 1 + ((i + (side >> 1)) & 1), j


@compiled
def _way(found: Links, front: int, i: int, j: int, side: int) -> float:
    """The distance from a side's first corner to its crossing; links run against sides 2 and 3."""
    place = found.place[_link(front, i, j, side & 3)]
    return float(1 - place if side & 2 else place)


@compiled
def _add(
    sums: Sums, place: tuple[int, int], cell: _Cell, x: float, y: float, solution: Solution
) -> None:
    """Add a segment to the sums of a block and front.  x, y: the ways to its ends from the corner
    that it cuts off, or from the two on one side of it."""
    dx, dy, steep, sign, corner, flows, held, hidden, doubt, kinked, released, edge = cell
    square, cos4, sin4 = dx * dx + dy * dy, 0.0, 0.0
    if square > 0:
        cos4 = 1 - 8 * (dx * dy / square) ** 2
        sin4 = 4 * dx * dy * (dx - dy) * (dx + dy) / square**2
    length = sqrt(x * x + y * y) if corner else sqrt(1 + (x - y) * (x - y))
    u = solution.yielded / steep if steep > 0 else np.inf
    stuck, free = held * length, (1 - held) * length
    own = max(min(solution.hardness / sqrt(square), 1.0) ** 2, held)
    released = edge * release(released / edge, u) if edge > 0 else 0.0
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
        sums.hidden[block, front, part] += share * hidden * length
        sums.kinked[block, front, part] += share * kinked * length
        sums.released[block, front, part] += share * released * length
        sums.edges[block, front, part] += share * edge * length


@compiled
def _interpolated(u: float, offsets: FloatArray) -> float:
    """The offset at u; constant beyond the table."""
    k = 1
    while u > U_NODES[k] and k < len(U_NODES) - 1:
        k += 1
    share = min((u - U_NODES[k - 1]) / (U_NODES[k] - U_NODES[k - 1]), 1.0)
    return float(offsets[k - 1] + share * (offsets[k] - offsets[k - 1]))
