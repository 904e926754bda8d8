"""What the fronts of a contact on a periodic grid enclose: sums over its cells.

All that is needed of a point is v = p - c g: at most 0 where apart, at least the hardness where
plastic; c is that of `front` for links along x and, on oblong cells, for those along y.  A front
crosses links between neighbouring points, where `front` locates it, and straight segments between
the two crossings of a cell bound the area.

Front 0 bounds the contact.  Front 1 bounds its plastic part: it is the front 0 of the mirror image,
hardness - v, in which plastic points are apart.  A cell is named after its last corner, point
(i, j).  Its corners 0 to 3 are (i - 1, j - 1), (i, j - 1), (i, j) and (i - 1, j), and side k runs
from corner k to the next.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.areas.front import Link, crease, inner, locate, release, wedge
from epcontact.bem.workers import compiled
from epcontact.results import FloatArray

#: Width of the elastic strip beside a front, in spacings, and the offset of a located front there
#: (`rim.calibrate_strips`); the last is that of a front alone (`rim.calibrate_directions`).
WIDTHS = np.array([0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.05, 1.25, 1.65, 2.2])
OFFSETS = np.array([0, 0.072, 0.1367, 0.1913, 0.22, 0.2244, 0.2164, 0.1982, 0.1752, 0.1706, 0.1783])
#: Along a crease the pressure changes by less than this share of its change across, and from copy
#: to copy of its range (`area_bank`; from 1/3 on claims of straight grooves are too small).
ALIKE = 0.2
#: Cells that a spot lacks because its front is curved (`rim.calibrate_corner`).
CORNER = 0.6
#: Points around the cells of a block that are read, too; entries for a spacing in the offsets.
PAD, FINE = 4, 500
#: By the sum of 2^k over the corners inside: the corner that is cut off, or the first of the two
#: that are on one side of the front.
_CUT = np.array([0, 0, 1, 0, 2, 0, 1, 3, 3, 1, 1, 2, 0, 1, 0, 0])


class Solution(NamedTuple):
    """A solution on a periodic grid."""

    pressure: FloatArray  # (nx, ny)
    gap: FloatArray  # (nx, ny)
    hardness: float  # the least pressure of a plastic point
    stiffness: tuple[float, float]  # c of `front` for links along x and along y
    flowed: FloatArray  # (nx, ny) what earlier flow has lowered the surface by, or (0, 0)
    yielded: float  # the hardness of that flow


class Sums(NamedTuple):
    """Sums over the fronts around the contact and around its plastic part: (..., 2 fronts).

    Lengths are in spacings; "free" ones are not held by an edge of the surface.  A front of u < 1
    spacings, the width hardness/|grad v| of the elastic strip beside it, moves with the other front
    there: the share u^2 of it is its own.
    """

    points: FloatArray  # inside the front
    tips: FloatArray  # of `_tip`
    squares: FloatArray  # of `_hidden`
    crease: FloatArray  # of `_hidden`
    area: FloatArray  # inside the located front, in cells
    offset: FloatArray  # free length times the offset at the strip's width there
    harmonic: FloatArray  # free length times cos 4 theta
    turn: FloatArray  # a quarter for each corner cut off: over a whole front its Euler number
    zone: FloatArray  # length times the width of the zone hidden at edges
    released: FloatArray  # length times the width that has come off flattened spots
    length: FloatArray  # own
    shared: FloatArray  # the rest of it
    held: FloatArray  # own length at edges
    kinked: FloatArray  # own length where the surface has a kink
    sine: FloatArray  # free length times sin 4 theta
    doubt: FloatArray  # own free length times the doubt of `front`
    chance: FloatArray  # and times its square


#: The `Sums` of a front and its `Link` as records.
SUMS, LINK = (np.dtype([(name, float) for name in one._fields]) for one in (Sums, Link))


class Block(NamedTuple):
    """The points of a block of cells, and PAD more on each side."""

    v: FloatArray  # (1 or 2, rows, columns) for links along x and, where it differs, along y
    inside: NDArray[np.uint8]  # (rows, columns) 0 where apart, 1 where elastic and 17 where plastic
    sunk: FloatArray  # (rows, columns) c w, 0 where nothing has flowed before
    values: FloatArray  # (9, 2 columns) of the links of a row, as of `locate`
    links: Any  # (2, 2 columns) `Link` of even and odd rows
    number: Any  # (2, 2, columns) of that along x and along y, from before, to a point of a row
    cells: NDArray[np.uint16]  # (columns,) of a row that have a front or are elastic


def sweep(solution: Solution, blocks: NDArray[np.int64], offsets: FloatArray) -> Any:
    """The `Sums` (n, 2) over blocks (n, 4), first row, row after the last, and so the columns, of
    the cells of a periodic grid; offsets: at WIDTHS."""
    found = np.zeros((len(blocks), 2), SUMS)
    rows, columns = (blocks[:, 1::2] - blocks[:, ::2]).max(axis=0) + 2 * PAD
    block = Block(
        np.empty((len({*solution.stiffness}), rows, columns)),
        np.empty((rows, columns), np.uint8),
        np.zeros((rows, columns)),
        np.empty((9, 2 * columns)),
        np.empty((2, 2 * columns), LINK),
        np.empty((2, 2, columns), np.int64),
        np.empty(columns, np.uint16),
    )
    table = np.interp(np.arange(round(WIDTHS[-1] * FINE) + 1) / FINE, WIDTHS, offsets)
    for k, (first, last, left, right) in enumerate(blocks):
        ends, sums = (last - first + PAD, right - left + PAD), found[k]
        for front in range(2 if solution.hardness < np.inf else 1):
            _fill(block, solution, blocks[k], front)
            _pass(block, solution, ends, table, sums[front : front + 1])
        # What is inside the plastic front is outside its mirror image.
        sums["area"][1], sums["turn"][1] = -sums["area"][1], -sums["turn"][1]
        p = solution.pressure[first:last, left:right]
        sums["points"] = np.count_nonzero(p > 0), np.count_nonzero(p >= solution.hardness)
        sums["area"] += sums["points"]
    return found


@compiled
def _fill(block: Block, solution: Solution, place: NDArray[np.int64], front: int) -> None:
    """Fill the memory with the points of a block, or with their mirror images for front 1."""
    (pressure, gap, hardness, stiffness, flowed, _), (first, last, left, right) = solution, place
    (nx, ny), (v, inside, sunk) = pressure.shape, block[:3]
    for i in range(last - first + 2 * PAD):
        row, done, width = (first - PAD + i) % nx, 0, right - left + 2 * PAD
        while done < width:  # from one end of the period to the next
            start = (left - PAD + done) % ny
            stop = min(ny, start + width - done)
            p, g, states = pressure[row, start:stop], gap[row, start:stop], inside[i, done:]
            for j in range(stop - start):
                contact, plastic = p[j] > 0, p[j] >= hardness
                states[j] = 17 - 16 * contact - plastic if front else contact + 16 * plastic
            for layer in range(len(v)):
                c, values = stiffness[layer], v[layer, i, done:]
                for j in range(stop - start):
                    depth = min(g[j], 0.0) if p[j] >= hardness else 0.0
                    depth = max(g[j], 0.0) if p[j] <= 0 else depth
                    value = min(max(p[j], 0.0), hardness) - c * depth
                    values[j] = hardness - value if front else value
            if flowed.size:  # points that flow again are as on a first loading
                for j in range(stop - start):
                    again = front == 1 or p[j] >= hardness
                    sunk[i, done + j] = 0.0 if again else stiffness[0] * flowed[row, start + j]
            done += stop - start


@compiled
def _pass(block: Block, solution: Solution, ends: Any, offsets: FloatArray, found: Any) -> None:
    """Add up the `Sums` of a front over the cells of a block; ends: the row and column after it."""
    (v, inside, _, values, links, number, cells), sums = block, found[0]
    hardness, yielded = solution.hardness, solution.yielded
    for i in range(PAD - 1, ends[0]):  # from the row before, which has links of the first cells
        before, here, count, crossed = inside[i - 1], inside[i], 0, np.int64(0)  # no literal
        for j in range(1, len(cells)):  # a loop that the compiler makes one over vectors
            c = here[j]
            cells[j] = (here[j - 1] != c) | (before[j - 1] != c) | (before[j] != c) | (c == 1)
        for j in range(PAD - 1, ends[1]):
            wanted, cells[count] = cells[j], j
            count += wanted
        for j in cells[:count]:
            for y in range(2):
                if (here[j] > 0) != (inside[i - 1 + y, j - y] > 0):
                    _cross(block, solution, (i, j, y), crossed)
                    number[y, i & 1, j] = crossed
                    crossed += 1
        locate(values, crossed, hardness, yielded, links[i & 1])
        for j in cells[:count]:
            if i < PAD or j < PAD:
                continue
            a, b, c, d = before[j - 1], here[j - 1], here[j], before[j]
            code = (a > 0) + 2 * (b > 0) + 4 * (c > 0) + 8 * (d > 0)
            if 0 < code < 15:
                _segments(block, solution, (i, j, code), offsets, sums)
            if c == 1:
                square, area = _hidden(v, (i, j), hardness)
                sums.squares += square
                sums.crease += area
            elif c == 0:
                sums.tips += _tip(v, inside, (i, j), hardness)


@inner
def _cross(block: Block, solution: Solution, place: tuple[int, int, int], number: int) -> None:
    """Gather what `locate` needs of the link to a point along x or y, which a front crosses."""
    v, inside, sunk, values = block[:4]
    (i, j, y), (_, rows, columns), field = place, v.shape, v.reshape(-1)
    is_inside, before = inside[i, j] > 0, (i - 1 + y, j - y)
    step = (1 if y else columns) * (-1 if is_inside else 1)
    here = (y * (len(v) - 1) * rows + i) * columns + j + (-2 if is_inside else -3) * step
    for k in range(6):  # from inside
        values[k, number] = field[np.uint64(here + k * step)]
    last, out = (sunk[i, j], sunk[before]) if is_inside else (sunk[before], sunk[i, j])
    aspect = solution.stiffness[y] / solution.stiffness[0]
    values[6, number] = last * aspect if out == 0 else -1.0 if last > 0 else 0.0


@inner
def _segments(block: Block, solution: Solution, cell: Any, offsets: FloatArray, sums: Any) -> None:
    """Add the segments of a front in a cell to the `Sums`; cell: i, j, 2^k for corners inside."""
    v, sunk, links, number, (i, j, code) = block.v, block.sunk, block.links, block.number, cell
    cut, saddle, straight = _CUT[code], code % 5 == 0, int(code % 3 == 0)
    a, b, c, d = v[0, i - 1, j - 1], v[0, i, j - 1], v[0, i, j], v[0, i - 1, j]
    e, f, g, h = v[-1, i - 1, j - 1], v[-1, i, j - 1], v[-1, i, j], v[-1, i - 1, j]
    if saddle and a + b + c + d + e + f + g + h > 0:
        cut ^= 1  # the inside is connected
    dx, dy = (b + c - a - d) / 2, (g + h - e - f) / 2
    square = max(dx * dx + dy * dy, 1e-300)
    sin4 = 4 * (dx * dy / square) * ((dx - dy) * (dx + dy) / square)
    steep, cos4 = math.sqrt(square), 1 - 8 * (dx * dy / square) ** 2
    narrow, u = min(solution.hardness / steep, 1.0) ** 2, solution.yielded / steep
    a, b, c, d = sunk[i - 1, j - 1], sunk[i, j - 1], sunk[i, j], sunk[i - 1, j]
    if max(a, b, c, d) > 0:
        dx += (b + c - a - d) / 2  # the gradient at the peak load
        dy += solution.stiffness[1] / solution.stiffness[0] * (c + d - a - b) / 2
        if min(a, b, c, d) > 0:  # inside a flattened spot nothing moves along
            u = np.inf
    is_inside, sign = (code >> cut) & 1, 2.0 * ((code >> cut) & 1) - 1
    sums.area += 1 - is_inside - ((code >> 2) & 1)  # which was counted as a point
    for corner in range(cut, cut + (4 if saddle else 1), 2):
        after, before = (corner + straight) & 3, (corner + 3) & 3
        row, column = (i - (after == 3)) & 1, j - (after == 0)
        one = links[row, number[after & 1, row, column]]
        row, column = (i - (before == 3)) & 1, j - (before == 0)
        other = links[row, number[before & 1, row, column]]
        x, y = (one.place, other.place) if is_inside else (1 - one.place, 1 - other.place)
        held, doubt, away = (one.held + other.held) / 2, (one.doubt + other.doubt) / 2, 0.0
        if max(one.fallen, other.fallen) > 0:
            u = solution.yielded / max(math.hypot(dx, dy), solution.yielded)
            back, gone = release(one.fallen, u), release(other.fallen, u)
            x -= sign * back
            y -= sign * gone
            away = (back + gone) / 2
        length = math.sqrt(1 + (x - y) ** 2 if straight else x * x + y * y)
        sums.area += sign * (x + y if straight else x * y) / 2
        own, free = max(narrow, held) * length, (1 - held) * length
        sums.released += away * length
        wide = u * (1 + (one.steeper + other.steeper) / 4)  # by the slope of both its fronts
        sums.offset += offsets[int(FINE * wide + 0.5) if wide < WIDTHS[-1] else -1] * free
        sums.harmonic += cos4 * free
        sums.sine += sin4 * free
        sums.turn += 0.0 if straight else 0.25 * sign
        sums.zone += (one.zone + other.zone) / 2 * length
        sums.length += own
        sums.shared += length - own
        sums.held += held * own
        sums.kinked += (one.kinked + other.kinked) / 2 * own
        sums.doubt += doubt * own * (1 - held)
        sums.chance += doubt * doubt * own * (1 - held)


@inner
def _tip(v: FloatArray, inside: Any, place: tuple[int, int], hardness: float) -> float:
    """1 where a point apart is a tip, less where the strip beside it is narrow, or 0.

    At most two of its eight neighbours are apart, not both on one line.  The steepest way to a
    neighbour gives the width of the strip between this front and the other.
    """
    (i, j), apart, steepest = place, 0, 0.0
    if inside[i - 1, j] == inside[i + 1, j] == 0 or inside[i, j - 1] == inside[i, j + 1] == 0:
        return 0.0
    for a in range(i - 1, i + 2):
        for b in range(j - 1, j + 2):
            apart += inside[a, b] == 0
            way = abs(v[0, a, b] + v[-1, a, b] - v[0, i, j] - v[-1, i, j]) / 2
            steepest = max(steepest, way)
    return 0.0 if apart > 3 else min(hardness / steepest, 1.0) ** 2


@inner
def _hidden(v: FloatArray, place: tuple[int, int], hardness: float) -> tuple[float, float]:
    """(square of a gap, area at a crease) that an elastic point may hide beside it.

    In full contact p is a smooth wave.  If it would fall to -p1 + p2 s^2 at the distance s from its
    lowest place, a gap of radius sqrt(3 p1/(2 p2)) opens, like a penny-shaped crack that closes
    smoothly.  This place is at most half a cell's diagonal away, so that p1 <= p2/2 - p.

    Along a crease (`front`) the pressure changes less than across by ALIKE; where it is 0, the gap
    shows.  A lone point may be on a wedge.
    """
    (i, j), lowest, rise, area = place, True, 0.0, 0.0
    here = v[0, i, j]
    for axis in range(2):
        q, x, y = v[-axis], 1 - axis, axis  # (x, y) is the way across the crease
        before, after = q[i - x, j - y], q[i + x, j + y]
        if here > min(before, after):
            lowest = False
            continue
        first, end = q[i - 2 * x, j - 2 * y], q[i + 2 * x, j + 2 * y]
        if min(before, after) >= hardness:
            near, far = (hardness - before, hardness - after), (hardness - first, hardness - end)
            area = max(area, wedge(hardness, hardness - here, near, far))
        alike = (before < hardness) == (after < hardness)
        before, after = min(before, hardness), min(after, hardness)
        first, end = min(max(first, 0.0), hardness), min(max(end, 0.0), hardness)
        across, rise = max(before, after) - here, rise + before + after
        one = min(q[i - 1, j - 1], q[i - y, j - x], q[i + x - y, j + y - x])
        other = min(q[i + 1, j + 1], q[i + y, j + x], q[i + y - x, j + x - y])
        if alike and min(one, other, across) > 0:
            along = max(min(max(one, other), hardness) - here, 0.0) / (ALIKE * across)
            width = 2 * crease(first, before, here, after, end)[0]
            area = max(area, width * max(1 - along, 0.0))
    rise = math.pi**2 / 8 * (rise / 4 - here)  # p2 of a wave with points a quarter of it apart
    gap = max(math.pi * 1.5 * (0.5 - here / rise), 0.0) if rise > 0 else 0.0  # ±0 if flat
    return (gap**2 if lowest else 0.0), area
