"""What the fronts of a contact on a periodic grid enclose: sums over its cells.

All that is needed of a point is v = p - c g: at most 0 where apart, at least the
hardness where plastic; c is that of `front` for links along x and, on oblong cells, for
those along y.  A front crosses links between neighbouring points, where `front` locates
it, and straight segments between the two crossings of a cell bound the area.

Front 0 bounds the contact.  Front 1 bounds its plastic part: it is the front 0 of the
mirror image, hardness - v, in which plastic points are apart.  A cell is named after
its last corner, point (i, j).  Its corners 0 to 3 are (i - 1, j - 1), (i, j - 1), (i,
j) and (i - 1, j), and side k runs from corner k to the next.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.areas.front import (
    Links,
    crease,
    inner,
    locate,
    release,
    relocate,
    wedge,
    width,
)
from epcontact.bem.workers import compiled
from epcontact.results import FloatArray

#: Width of the elastic strip beside a front, in spacings, and the offset of a located
#: front there (`rim.calibrate_strips`); the last is that of a front alone
#: (`rim.calibrate_directions`).
WIDTHS = np.array([0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.05, 1.25, 1.65, 2.2])
OFFSETS = np.array(
    [0, 0.072, 0.1367, 0.1913, 0.22, 0.2244, 0.2164, 0.1981, 0.1753, 0.1706, 0.1786]
)
#: Along a crease and from copy to copy pressures change by less than this share
#: (`area_bank`).
ALIKE = 0.2
#: Cells that a spot lacks because its front is curved (`rim.calibrate_corner`).
CORNER = 0.6
#: Standard deviation of the place of strips narrower than a spacing (chosen on
#: `area_bank`).
NARROW = 0.22
#: Points around the cells of a block that are read, too; entries for a spacing in the
#: offsets.
PAD, FINE = 4, 500
#: By the sum of 2^k over the corners inside: the one that is cut off, or the first of
#: two.
_CUT = np.array([0, 0, 1, 0, 2, 0, 1, 3, 3, 1, 1, 2, 0, 1, 0, 0])


class Solution(NamedTuple):
    """A solution on a periodic grid."""

    pressure: FloatArray  # (nx, ny)
    gap: FloatArray  # (nx, ny)
    hardness: float  # the least pressure of a plastic point
    stiffness: tuple[float, float]  # c of `front` for links along x and along y
    flowed: (
        FloatArray  # (nx, ny) what earlier flow has lowered the surface by, or (0, 0)
    )
    yielded: float  # the hardness of that flow


class Sums(NamedTuple):
    """Sums over the fronts around the contact and around its plastic part: (..., 2
    fronts).

    Lengths are in spacings; "free" ones are not held by an edge of the surface.  Where
    the elastic strip beside a front is u = hardness/|grad v| < 1 spacings wide, the two
    fronts move together, and only a share u^2 of the length counts as this front's own.
    """

    points: FloatArray  # inside the front
    tips: FloatArray  # of `_tip`
    squares: FloatArray  # of `_hidden`
    crease: FloatArray  # of `_hidden`
    area: FloatArray  # inside the located front, in cells
    offset: FloatArray  # free length times the offset at the strip's width there
    harmonic: FloatArray  # the offset times cos 4 theta
    turn: FloatArray  # a quarter for each corner cut off: over a whole front its Euler number
    zone: FloatArray  # length times the width of the zone hidden at edges
    released: FloatArray  # length times the width that has come off flattened spots
    length: FloatArray  # own
    shared: FloatArray  # the rest of it
    held: FloatArray  # own length at edges
    kinked: FloatArray  # own length that is `kinked`
    sine: FloatArray  # the offset times sin 4 theta
    doubt: FloatArray  # own free length times the doubt of `front`
    chance: FloatArray  # and times its square


def sweep(solution: Solution, blocks: NDArray[np.int64], offsets: FloatArray) -> Any:
    """The `Sums` (n, 2) over blocks (n, 4), first row, row after the last, and so the
    columns, of the cells of a periodic grid; offsets: at WIDTHS.
    """
    sizes, layers = blocks[:, 1::2] - blocks[:, ::2], len({*solution.stiffness})
    rows, columns = (sizes.max(axis=0) + 2 * PAD + (0, 7)) // (1, 8) * (1, 8)
    points, record = rows * columns, [(name, float) for name in Sums._fields]
    # Of the points of a block, and PAD more on each side, row by row: the steps to the
    # next point and row, and from v along x to v along y, if it differs; 0 where apart,
    # 1 where elastic, 2 where plastic; c times the flow before, as v is.
    steps = np.uint64(1), np.uint64(columns), np.uint64((layers - 1) * points)
    v, sunk = (
        np.zeros(layers * points),
        np.zeros(layers * points if solution.flowed.size else 0),
    )
    (state, codes), found = (
        np.zeros((2, points), np.uint8),
        np.zeros((len(blocks), 2), record),
    )
    # Of cells: 2^k for corners on the other side of the front than the last, 16 where
    # elastic, and the same of eight at once; those that a front crosses, and the links
    # on their sides; elastic.
    (cells, elastic), sides = (
        np.empty((2, points), np.uint32),
        np.empty((4, points), np.uint32),
    )
    # Of as many links at a time, for two rows at least: the first of six points, the
    # way on, what `locate` takes and finds; the last one along y in each column.
    room, above = points // 8 + 4 * columns, np.empty(columns, np.uint32)
    (starts, ways), values = np.empty((2, room), np.int32), np.empty((9, room))
    located = Links(*np.empty((len(Links._fields), room)))
    lists = codes, codes.view(np.uint64), cells, elastic, sides, above, starts, ways
    grid, fronts = (steps, v, state, sunk), (codes, cells, sides, located)
    hardness, caps = solution.hardness, (solution.hardness, solution.yielded)
    table = np.interp(np.arange(round(WIDTHS[-1] * FINE) + 1) / FINE, WIDTHS, offsets)
    for place, both in zip(blocks, found, strict=True):
        _fill(grid, solution, place)
        for front in range(2 if hardness < np.inf else 1):
            if front:  # the mirror image, which has not flowed before
                np.subtract(hardness, v, v)
                np.subtract(2, state, state)
                sunk[:] = 0.0
            sums, row = both[front : front + 1], PAD
            while row < PAD + place[1] - place[0]:  # as many as memory has links for
                inside, crossed, count, links, row = _number(
                    grid, lists, values, place, row, caps
                )
                sums["points"] += inside
                locate(values, links, hardness, located)
                relocate(values, links, hardness, located)
                _segments(grid, fronts, crossed, caps, table, sums)
                _hidden(grid, elastic, count, hardness, sums)
    if hardness < np.inf:  # inside the plastic front is outside its mirror image
        found["points"][:, 1] = sizes.prod(axis=1) - found["points"][:, 1]
        found["area"][:, 1], found["turn"][:, 1] = (
            -found["area"][:, 1],
            -found["turn"][:, 1],
        )
    found["area"] += found["points"]
    return found


@compiled
def _fill(grid: Any, solution: Solution, place: NDArray[np.int64]) -> None:
    """Fill the memory with the points of a block."""
    (pressure, gap, top, stiffness, flowed, _), (first, last, left, right) = (
        solution,
        place,
    )
    (steps, v, state, sunk), (nx, ny) = grid, pressure.shape
    for i in range(last - first + 2 * PAD):
        row, done, wide = (first - PAD + i) % nx, 0, right - left + 2 * PAD
        while done < wide:  # from one end of the period to the next
            start, at = (left - PAD + done) % ny, i * np.int64(steps[1]) + done
            stop = min(ny, start + wide - done)
            p, g, states = pressure[row, start:stop], gap[row, start:stop], state[at:]
            for layer in range(len(v) // len(state)):
                c, values = stiffness[layer], v[layer * len(state) + at :]
                for j in range(stop - start):
                    depth = (
                        max(g[j], 0.0)
                        if p[j] <= 0
                        else min(g[j], 0.0)
                        if p[j] >= top
                        else 0.0
                    )
                    values[j] = min(max(p[j], 0.0), top) - c * depth
                    states[j] = (p[j] > 0) + (p[j] >= top)
                for j in range(
                    stop - start if flowed.size else 0
                ):  # not of what flows again
                    sunk[layer * len(state) + at + j] = (
                        c * flowed[row, start + j] * (p[j] < top)
                    )
            done += stop - start


@compiled
def _number(
    grid: Any, lists: Any, values: Any, place: Any, begun: int, caps: Any
) -> Any:
    """Number crossed cells, elastic points and links, and gather what `locate` needs of
    these.
    """
    codes, eights, cells, elastic, sides, above, starts, ways = lists
    (steps, v, state, sunk), (first, last, left, right), columns = (
        grid,
        place,
        len(above),
    )
    inside, crossed, count, links = 0, 0, 0, 0
    for i in range(begun - 1, last - first + PAD):  # from the row before, for its links
        row, old, kept = i * columns, crossed, int(i >= begun)
        if links + 2 * columns > len(ways):
            break
        begin, end, begun = row + PAD - 1, row + PAD + right - left, max(begun, i + 1)
        a, b, code = state[begin - columns - 1 :], state[begin - 1 :], codes[begin:end]
        c, d = state[begin:], state[begin - columns :]
        for j in range(len(code)):  # of slices, the compiler makes loops over vectors
            here = c[j] > 0
            corners = (
                (a[j] > 0) ^ here | ((b[j] > 0) ^ here) << 1 | ((d[j] > 0) ^ here) << 3
            )
            code[j] = corners | (c[j] & 1) << 4
        for j in range(1, len(code)):
            inside += c[j] > 0
        codes[end : row + columns], code[0] = 0, code[0] & 15
        for eight in range(row // 8, (row + columns) // 8):
            if eights[eight]:
                for k in range(
                    8 * eight, 8 * eight + 8
                ):  # without branches, hard to foresee
                    cells[np.uint64(crossed)], elastic[np.uint64(count)] = k, k
                    crossed += codes[k] & 15 > 0
                    count += codes[k] >> 4
        for m in range(old, crossed):
            point, column = np.int64(cells[m]), np.uint64(cells[m] - np.uint64(row))
            sides[0, m], sides[3, m] = sides[2, m - 1], above[column]
            for y in range(2):
                link, way = np.uint64(links), 1 if y else columns
                starts[link] = (
                    point + np.int64(steps[2]) * y + (2 if state[point] else -3) * way
                )
                ways[link], sides[2 - y, m] = -way if state[point] else way, link
                links += codes[point] >> (3 - 2 * y) & 1
            above[column] = sides[1, m]
        codes[begin] = 0
        inside, crossed, count = kept * inside, kept * crossed, kept * count
    for n in range(links):
        for k in range(6):
            values[k, n] = v[np.uint64(starts[n] + k * ways[n])]
        values[6, n], values[7, n] = 0.0, caps[0]
        if len(sunk):
            _recall(values[:, n], sunk, starts[n], ways[n], caps[1])
    return inside, crossed, count, links, begun


@inner
def _recall(link: Any, sunk: FloatArray, start: Any, way: Any, top: float) -> None:
    """Tell a link of earlier flow; in a strip and at an edge, v becomes that of the
    peak load.
    """
    last, out = sunk[start + 2 * way], sunk[start + 3 * way]
    edge = last > 0 == out and (1 - NARROW) * (link[2] + last - link[3]) > top
    fall = top - link[2] if edge else 0.0
    link[6] = 0.0 if last == 0 else -1.0 if out > 0 else 1 + fall / top
    for j in range(6 if out == 0 and (edge or last == 0) else 0):
        lost = sunk[start + j * way] if j < 3 else 0.0
        link[j] += fall + lost
        link[7] = min(link[7], top, link[j]) if lost > 0 else link[7]


@compiled
def _segments(  # noqa: PLR0915
    grid: Any, fronts: Any, count: int, caps: Any, offsets: Any, out: Any
) -> None:
    """Add the segments of a front in cells that it crosses, and tips, to the `Sums`."""
    ((unit, columns, shift), v, state, sunk), (codes, cells, sides, links) = (
        grid,
        fronts,
    )
    place, doubts, holds, zones, kinks, falls, steeper = links
    (hardness, top), sums = caps, out[0]
    for m in range(count):
        k, q = np.uint64(cells[m]), np.uint64(cells[m]) + shift
        is_point, code = int(state[k] > 0), int(codes[k]) & 15
        if code == 0:  # before the block
            continue
        code ^= 15 * is_point
        cut, saddle, straight = _CUT[code], int(code % 5 == 0), int(code % 3 == 0)
        a, b, c, d = v[k - columns - unit], v[k - unit], v[k], v[k - columns]
        e, f, g, h = v[q - columns - unit], v[q - unit], v[q], v[q - columns]
        cut ^= saddle & int(
            a + b + c + d + e + f + g + h > 0
        )  # the inside is connected
        dx, dy = (b + c - a - d) / 2, (g + h - e - f) / 2
        inverse = 1 / max(dx * dx + dy * dy, 1e-300)
        product, flat = dx * dy * inverse, math.sqrt(inverse)
        sin4, cos4 = (
            4 * product * (dx - dy) * (dx + dy) * inverse,
            1 - 8 * product * product,
        )
        narrow, u, strip = min(hardness * flat, 1.0) ** 2, top * flat, 0.0
        if len(sunk):
            a, b, c, d = (
                sunk[k - columns - unit],
                sunk[k - unit],
                sunk[k],
                sunk[k - columns],
            )
            if max(a, b, c, d) > 0:
                dx += (b + c - a - d) / 2  # the gradient at the peak load
                dy += (
                    sunk[q]
                    + sunk[q - columns]
                    - sunk[q - unit]
                    - sunk[q - columns - unit]
                ) / 2
                u = top / max(math.hypot(dx, dy), 1e-150)
                u = (
                    np.inf if min(a, b, c, d) > 0 else u
                )  # in a flattened spot nothing moves along
                strip = width(min(u, 1.0))
        is_inside, sign = (code >> cut) & 1, 2.0 * ((code >> cut) & 1) - 1
        sums.area += 1 - is_inside - is_point  # which was counted as a point
        for corner in range(cut, cut + 1 + 2 * saddle, 2):
            one = np.uint64(sides[(corner + straight) & 3, m])
            other, away = np.uint64(sides[(corner + 3) & 3, m]), 0.0
            x, y = (
                1 - is_inside + sign * place[one],
                1 - is_inside + sign * place[other],
            )
            held, doubt = (
                (holds[one] + holds[other]) / 2,
                (doubts[one] + doubts[other]) / 2,
            )
            if len(sunk) and max(falls[one], falls[other]) > 0:
                back, gone = release(falls[one], strip), release(falls[other], strip)
                x, y, away = x - sign * back, y - sign * gone, (back + gone) / 2
            length = math.sqrt(x * x + y * y + straight * (1 - 2 * x * y))
            sums.area += sign * (x * y + straight * (x + y - x * y)) / 2
            own, free = max(narrow, held) * length, (1 - held) * length
            sums.released += away * length
            wide = u * (
                1 + (steeper[one] + steeper[other]) / 4
            )  # by the slope of both its fronts
            offset = (
                offsets[np.uint64(min(FINE * wide + 0.5, len(offsets) - 1.0))] * free
            )
            sums.offset += offset
            sums.harmonic += cos4 * offset
            sums.sine += sin4 * offset
            sums.turn += 0.25 * sign * (1 - straight)
            sums.zone += (zones[one] + zones[other]) / 2 * length
            sums.length += own
            sums.shared += length - own
            sums.held += held * own
            sums.kinked += (kinks[one] + kinks[other]) / 2 * own
            sums.doubt += doubt * own * (1 - held)
            sums.chance += (doubt * doubt * (1 - held) + NARROW**2 * (away > 0)) * own
        sums.tips += _tip(grid, k, hardness)


@inner
def _tip(grid: Any, k: Any, hardness: float) -> float:
    """1 where a point apart with at most two such neighbours, not on one line, is a
    tip, and less by the steepest way to a neighbour, which gives the width of the strip
    beside the front.
    """
    ((unit, columns, shift), v, state), apart, steepest = grid[:3], 0, 0.0
    along, across = (
        state[k - unit] | state[k + unit],
        state[k - columns] | state[k + columns],
    )
    for row in (k - columns, k, k + columns):
        apart += (state[row - unit] == 0) + (state[row] == 0) + (state[row + unit] == 0)
    if (state[k] > 0) | (along == 0) | (across == 0) | (apart > 3):
        return 0.0
    for row in (k - columns, k, k + columns):
        for near in (row - unit, row, row + unit):
            steepest = max(
                steepest, abs(v[near] + v[near + shift] - v[k] - v[k + shift]) / 2
            )
    return min(hardness / steepest, 1.0) ** 2


@compiled
def _hidden(grid: Any, elastic: Any, count: int, hardness: float, out: Any) -> None:
    """Add the squares of gaps and the areas at creases that elastic points may hide.

    In full contact p is a smooth wave.  If it would fall to -p1 + p2 s^2 at the
    distance s from its lowest place, a gap of radius sqrt(3 p1/(2 p2)) opens, like a
    penny-shaped crack that closes smoothly.  This place is at most half a cell's
    diagonal away, so that p1 <= p2/2 - p.  Along a crease (`front`) the pressure
    changes less than across by ALIKE; where it is 0, the gap shows. A lone point may be
    on a wedge.
    """
    ((unit, columns, shift), v), sums, low = grid[:2], out[0], 0
    for k in elastic[:count]:  # without branches, hard to foresee
        elastic[np.uint64(low)] = k
        least = (
            v[k] <= min(v[k - unit], v[k + unit]),
            v[k] <= min(v[k - columns], v[k + columns]),
        )
        low += least[0] | least[1]
    for k in elastic[:low]:
        here, lowest, rise, area = v[k], True, 0.0, 0.0
        for axis in range(2):
            q, across, along = (
                (k + shift, unit, columns) if axis else (k, columns, unit)
            )
            before, after = v[q - across], v[q + across]
            if here > min(before, after):
                lowest = False
                continue
            first, end = v[q - across - across], v[q + across + across]
            if min(before, after) >= hardness:
                area = max(area, wedge(hardness, first, before, here, after, end))
            before, after = min(before, hardness), min(after, hardness)
            first, end = min(max(first, 0.0), hardness), min(max(end, 0.0), hardness)
            rise, one, other = rise + before + after, q - along, q + along
            one = min(v[one - across], v[one], v[one + across], hardness)
            other = min(v[other - across], v[other], v[other + across], hardness)
            most, drift = (
                ALIKE * (max(before, after) - here),
                max(max(one, other) - here, 0.0),
            )
            if (
                (before < hardness) == (after < hardness)
                and min(one, other) > 0
                and drift < most
            ):
                area = max(
                    area,
                    2 * crease(first, before, here, after, end)[0] * (1 - drift / most),
                )
        sums.crease += area
        rise = (
            math.pi**2 / 8 * (rise / 4 - here)
        )  # p2 of a wave with points a quarter of it apart
        if lowest and rise > 0:  # ±0 if flat
            sums.squares += max(math.pi * 1.5 * (0.5 - here / rise), 0.0) ** 2
