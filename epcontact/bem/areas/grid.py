"""What the fronts of a contact on a periodic grid enclose: sums over its cells.

All that is needed of a point is v = p - c g: at most 0 where apart, at least the hardness where
plastic; c is that of `front` for links along x and, on oblong cells, for those along y.  A front
crosses links between neighbouring points, where `front` locates it, and straight segments between
the two crossings of a cell bound the area.

Front 0 bounds the contact and front 1 its plastic part.  A cell is named after its last corner,
point (i, j).  Its corners 0 to 3 are (i - 1, j - 1), (i, j - 1), (i, j) and (i - 1, j), and side k
runs from corner k to the next.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.areas.front import Link, compiled, crease, inner, locate, release, wedge
from epcontact.results import FloatArray

#: Width of the elastic strip beside a front, in spacings, and the offset of a located front there
#: (`rim.calibrate_strips`); the last is that of a front alone (`rim.calibrate_directions`).
WIDTHS = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.05, 1.25, 1.5, 1.8, 2.2, 2.8, 3.5])
OFFSETS = np.array([0.0, 0.0721, 0.137, 0.1916, 0.2198, 0.2229, 0.215, 0.1933,
                    0.18, 0.1742, 0.1694, 0.1782, 0.1773, 0.1783])  # fmt: skip
#: Along a crease the pressure changes by less than this share of its change across, and from copy
#: to copy of its range (`area_bank`; from 1/3 on claims of straight grooves are too small).
ALIKE = 0.2
#: Cells that a spot lacks because its front is curved (`rim.calibrate_corner`).  A lone point that
#: carries next to nothing is taken for a spot of this area.
CORNER = 0.6
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
    flowed: FloatArray  # (nx, ny) what earlier flow has lowered the surface by, or (0, 0)
    yielded: float  # the hardness of that flow


class Sums(NamedTuple):
    """Sums over the fronts around the contact and around its plastic part: (..., 2 fronts).

    Lengths are in spacings, and no edge of the surface holds "free" ones.  A front of u < 1
    spacings, the width hardness/|grad v| of the elastic strip beside it, moves with the other front
    there: the share u^2 of it is its own.
    """

    points: FloatArray  # inside the front
    tips: FloatArray  # of `_tip`
    squares: FloatArray  # of `_hidden`
    crease: FloatArray  # of `_hidden`
    area: FloatArray  # inside the located front, in cells
    offset: FloatArray  # free length times the tabulated offset at u
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
    sunk: FloatArray  # (rows, columns) c w, or (0, 0) where nothing has flowed before
    links: Any  # (2, 2, columns) `Link` along x and y that ends at a point, of even and odd rows
    work: FloatArray  # (5, 6)


@compiled
def sweep(solution: Solution, blocks: NDArray[np.int64], offsets: FloatArray) -> Any:
    """The `Sums` over blocks of the cells of a periodic grid, (n, 2) records.

    blocks: (n, 4) the first row and the row after the last of the cells, and so their columns;
    offsets: of a front, at WIDTHS.
    """
    found = np.zeros((len(blocks), 2), SUMS)
    rows = np.max(blocks[:, 1] - blocks[:, 0]) + 2 * PAD
    columns, c = np.max(blocks[:, 3] - blocks[:, 2]) + 2 * PAD, solution.stiffness
    layers, flowed = 1 if c[0] == c[1] else 2, rows if solution.flowed.size else 0
    block = Block(
        np.empty((layers, rows, columns)),
        np.empty((rows, columns), np.uint8),
        np.empty((flowed, columns)),
        np.empty((2, 2, columns), LINK),
        np.empty((5, 6)),
    )
    for k in range(len(blocks)):
        (first, last, left, right), inside = blocks[k], block.inside
        _fill(block, solution, blocks[k])
        for front in range(2 if solution.hardness < np.inf else 1):
            sums, state, points = found[k, front], 16 * front, 0
            for i in range(PAD - 1, last - first + PAD):
                d, c = inside[i - 1, PAD - 2], inside[i, PAD - 2]
                for j in range(PAD - 1, right - left + PAD):
                    a, b, c, d = d, c, inside[i, j], inside[i - 1, j]
                    own = i >= PAD and j >= PAD
                    points += own and c > state
                    if c == a == b == d and c != 1:
                        continue
                    code = (a > state) + 2 * (b > state) + 4 * (c > state) + 8 * (d > state)
                    if code not in (0, 15):
                        _cross(block, solution, front, (i, j))
                        if own:
                            _segments(block, solution, front, (i, j), code, offsets, sums)
                    if own and c == 1:
                        square, crease = _hidden(block, (i, j), solution.hardness, front)
                        sums.squares += square
                        sums.crease += crease
                    elif own and c == 17 * front:
                        sums.tips += _tip(block.v, inside, (i, j), solution.hardness)
            sums.points, sums.area = points, sums.area + points
    return found


@inner
def _fill(block: Block, solution: Solution, place: NDArray[np.int64]) -> None:
    """Fill the memory with the points of a block."""
    (pressure, gap, hardness, stiffness, flowed, _), (first, last, left, right) = solution, place
    (nx, ny), (v, inside, sunk, _, _) = pressure.shape, block
    for i in range(last - first + 2 * PAD):
        row, column = (first - PAD + i) % nx, (left - PAD) % ny
        for j in range(right - left + 2 * PAD):
            p, g = pressure[row, column], gap[row, column]
            inside[i, j] = (p > 0) + 16 * (p >= hardness)
            base = hardness if p >= hardness else max(p, 0.0)
            depth = max(g, 0.0) if p <= 0 else min(g, 0.0) if p >= hardness else 0.0
            for layer in range(len(v)):
                v[layer, i, j] = base - stiffness[layer] * depth
            if flowed.size:  # points that flow again are as on a first loading
                sunk[i, j] = stiffness[0] * flowed[row, column] if p < hardness else 0.0
            column = column + 1 if column + 1 < ny else 0


@inner
def _cross(block: Block, solution: Solution, front: int, place: tuple[int, int]) -> None:
    """Locate the front on the links to a point along x and y that it crosses."""
    (v, inside, sunk, links, work), (i, j) = block, place
    state, cap, sign = (16, solution.hardness, -1.0) if front else (0, 0.0, 1.0)
    ends_inside = (inside[i, j] > state) != (front == 1)
    for y in range(2):
        beside = inside[i, j - 1] if y else inside[i - 1, j]
        if (inside[i, j] > state) == (beside > state):
            continue
        for k in range(6):  # from inside
            way = 2 - k if ends_inside else k - 3
            work[0, k] = cap + sign * (v[-1, i, j + way] if y else v[0, i + way, j])
        below = 0.0
        if sunk.size and front == 0:
            w, beyond = sunk[i, j], sunk[i, j - 1] if y else sunk[i - 1, j]
            w, beyond = (w, beyond) if ends_inside else (beyond, w)
            aspect = solution.stiffness[y] / solution.stiffness[0]
            below = w * aspect if beyond == 0 else -1.0 if w > 0 else 0.0
        found = locate(work, below, solution.hardness, solution.yielded)
        link = links[y, i & 1, j]
        link.place = 1 - found.place if ends_inside else found.place
        link.doubt, link.held, link.zone = found.doubt, found.held, found.zone
        link.kinked, link.fallen = found.kinked, found.fallen


@inner
def _segments(
    block: Block,
    solution: Solution,
    front: int,
    cell: tuple[int, int],
    code: int,
    offsets: FloatArray,
    sums: Any,
) -> None:
    """Add the segments of a front in a cell to the `Sums`; code: of 2^k for corners inside."""
    (v, _, sunk, links, _), (i, j) = block, cell
    x_field, y_field = v[0], v[-1]
    cut, saddle, straight = _CUT[code], code % 5 == 0, int(code % 3 == 0)
    a, b, c, d = x_field[i - 1, j - 1], x_field[i, j - 1], x_field[i, j], x_field[i - 1, j]
    e, f, g, h = y_field[i - 1, j - 1], y_field[i, j - 1], y_field[i, j], y_field[i - 1, j]
    if saddle and a + b + c + d + e + f + g + h > (8 * solution.hardness if front else 0.0):
        cut ^= 1  # the inside is connected
    dx, dy = (b + c - a - d) / 2, (g + h - e - f) / 2
    square = max(dx * dx + dy * dy, 1e-300)
    cos4 = 1 - 8 * (dx * dy / square) ** 2
    sin4 = 4 * (dx * dy / square) * ((dx - dy) * (dx + dy) / square)
    steep, gradient = math.sqrt(square), (dx, dy)
    narrow = min(solution.hardness / steep, 1.0) ** 2
    if sunk.size and front == 0:
        a, b, c, d = sunk[i - 1, j - 1], sunk[i, j - 1], sunk[i, j], sunk[i - 1, j]
        gradient = dx + (b + c - a - d) / 2, dy + (c + d - a - b) / 2  # that of the peak load
        if min(a, b, c, d) > 0:  # inside a flattened spot nothing moves along
            steep = 1e-150
    is_inside, sign = (code >> cut) & 1, 2.0 * ((code >> cut) & 1) - 1
    sums.area += 1 - is_inside - ((code >> 2) & 1)  # which was counted as a point
    for corner in range(cut, cut + (4 if saddle else 1), 2):
        after, before = (corner + straight) & 3, (corner + 3) & 3
        one = links[after & 1, (i - (after == 3)) & 1, j - (after == 0)]
        other = links[before & 1, (i - (before == 3)) & 1, j - (before == 0)]
        x = 1 - one.place if after > 1 else one.place
        y = other.place if before > 1 else 1 - other.place
        held, doubt = (one.held + other.held) / 2, (one.doubt + other.doubt) / 2
        at_edge, back, away = max(one.fallen, other.fallen) > 0, 0.0, 0.0
        u = solution.yielded / steep
        if at_edge:  # along a link that is more than 60 degrees off the front moves twice as far
            peak = max(math.hypot(gradient[0], gradient[1]), solution.yielded)
            u = solution.yielded / peak
            back, away = release(one.fallen, u), release(other.fallen, u)
            x -= sign * back / max(abs(gradient[after & 1]) / peak, 0.5)
            y -= sign * away / max(abs(gradient[before & 1]) / peak, 0.5)
        length = math.sqrt(1 + (x - y) ** 2 if straight else x * x + y * y)
        sums.area += sign * (x + y if straight else x * y) / 2
        sums.released += (back + away) / 2 * length
        own, free = max(narrow, held) * length, (1 - held) * length
        sums.offset += _offset(u, offsets) * free
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
def _offset(u: float, offsets: FloatArray) -> float:
    """Interpolate between the offsets at WIDTHS."""
    k = 1 if u < WIDTHS[-1] else len(WIDTHS) - 1
    while u > WIDTHS[k] and k < len(WIDTHS) - 1:
        k += 1
    share = min((u - WIDTHS[k - 1]) / (WIDTHS[k] - WIDTHS[k - 1]), 1.0)
    return float(offsets[k - 1] + share * (offsets[k] - offsets[k - 1]))


@inner
def _tip(
    v: FloatArray, inside: NDArray[np.uint8], place: tuple[int, int], hardness: float
) -> float:
    """1 where a point is a tip of its state, less where the strip beside it is narrow, or 0.

    A tip has at most two of its eight neighbours in the same state, and not both on one line.  A
    spot of two or three points with no others within two points shows all that it has.  Where a
    front moves with another one, a tip counts less: the steepest way to a neighbour gives the width
    of the strip between them.  A lone point counts less if even the gentlest way is steep: it is a
    post or a pit of its own cell.
    """
    (i, j), like, near, steepest, gentlest = place, -1, -1, 0.0, np.inf
    for a in range(i - 2, i + 3):
        for b in range(j - 2, j + 3):
            alike = inside[a, b] == inside[i, j]
            near += alike
            if max(abs(a - i), abs(b - j)) <= 1:
                like += alike
                way = abs(v[0, a, b] + v[-1, a, b] - v[0, i, j] - v[-1, i, j]) / 2
                steepest = max(steepest, way)
                gentlest = min(gentlest, way) if a != i or b != j else gentlest
    own, rows, columns = inside[i, j], inside[i - 1 : i + 2 : 2, j], inside[i, j - 1 : j + 2 : 2]
    line = rows[0] == rows[1] == own or columns[0] == columns[1] == own
    if like > 2 or 0 < like == near or line:
        return 0.0
    way = steepest if like else gentlest
    return float((hardness / way) ** 2 if way > hardness else 1.0)


@inner
def _hidden(
    block: Block, place: tuple[int, int], hardness: float, front: int
) -> tuple[float, float]:
    """(square of areas, area at a crease) that an elastic point may hide beside it.

    In full contact p is a smooth wave.  If it would fall to -p1 + p2 s^2 at the distance s from its
    lowest place, a gap of radius sqrt(3 p1/(2 p2)) opens, like a penny-shaped crack that closes
    smoothly.  This place is at most half a cell's diagonal away, so that p1 <= p2/2 - p.

    Along a crease (`front`) the pressure changes less than across by ALIKE; where it is 0, the gap
    shows.  A tip is bound by creases in both directions, as wide as where p rises by k ln 3 from
    half a spacing to 3/2.  A lone wedge of slope t carries its load p on a width p/H at the
    hardness H, or on y/sinh y of it, y = pi H/(E* t), where it is not steep enough.

    A lone point lacks a part of CORNER, as its spot may have no area.
    """
    (v, p, (i, j)), sign, cap = (block.v, block.work, place), 1 - 2 * front, front * hardness
    here = sign * v[0, i, j] + (cap if front else 0.0)
    x0, x1, y0, y1 = v[0, i - 1, j], v[0, i + 1, j], v[-1, i, j - 1], v[-1, i, j + 1]
    if front:
        x0, x1, y0, y1 = cap - x0, cap - x1, cap - y0, cap - y1
    if here > min(x0, x1) and here > min(y0, y1) and max(x0, x1, y0, y1) > 0:
        return 0.0, 0.0
    most = rise = area = 0.0
    tip, spot, lowest = 1.0, 0.5, True
    for axis in range(2):  # p runs across the crease first
        spread = 0.0
        for a in range(5):
            for b in range(1, 4):
                x, y = (b, a) if axis else (a, b)
                q = sign * v[-axis, i + x - 2, j + y - 2] + (cap if front else 0.0)
                p[a, b] = min(max(q, 0.0), hardness)
                p[a, 4] = q if b == 2 else p[a, 4]
                spread += here / (here - q) if b == 2 and a % 2 else 0.0
        before, after = p[1, 2], p[3, 2]
        spot, most, rise = spot * spread, max(most, before, after), rise + before + after
        low, across = here <= min(before, after), max(before, after) - here
        lowest, cone = lowest and low, 0.0
        if low and across > 0:
            bent = min(p[0, 2] - 2 * before, p[4, 2] - 2 * after) + here < 0
            cone = 2 * math.exp(-math.log(3) * here / across) if bent else 0.0
            width = 2 * crease(p[0, 2], before, here, after, p[4, 2])[0]
            one, other = min(p[1, 1], p[2, 1], p[3, 1]), min(p[1, 3], p[2, 3], p[3, 3])
            along = max(one - here, other - here, 0.0) / (ALIKE * across)
            alike = (before < hardness) == (after < hardness) and min(one, other) > 0
            area = max(area, width * max(1 - along, 0.0) * alike)
        if min(before, after) >= hardness:
            v0, v1, v2, v3, v4 = hardness - p[:5, 4]
            steep = math.sqrt(wedge(v2, v1, v0) * wedge(v2, v3, v4))
            if steep > 0:
                ratio = min(math.pi * hardness / steep, 99.0)
                area = max(area, v2 / hardness * ratio / math.sinh(ratio))
        tip *= cone
    if most <= 0:
        return max(CORNER - spot, 0.0) ** 2, 0.0
    rise = math.pi**2 / 8 * (rise / 4 - here)  # p2 of a wave with points a quarter of it apart
    gap = math.pi * 1.5 * (0.5 - here / rise) if lowest and most < hardness else 0.0
    return max(gap, 0.0) ** 2 + tip**2, area
