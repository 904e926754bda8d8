"""What the points of a contact may hide between them: gaps, plastic zones and the ends of both."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.areas.front import compiled
from epcontact.results import FloatArray

Bytes = NDArray[np.uint8]
#: Numbers of columns.  Those without a sign need no test for a negative index.
Columns = NDArray[np.uint32]
#: Eight rows are in memory, row i at i & LAST.
LAST = 7

#: A wave's curvature divided by its second difference between points a quarter wavelength apart.
SEEN = 1.25
#: Along a crease the pressure changes by less than this share of its change across (`error_bars`:
#: from 1/3 on the claims of straight grooves that no point shows are too small).
STRAIGHT = 0.2
#: Cells that a spot lacks because its front is curved (`rim.calibrate_corner`).  A lone point that
#: carries next to nothing is taken for a spot of this area.
CORNER = 0.6
#: A tip has at most this number of neighbours in its own state.
TIP_NEIGHBOURS = 2


@compiled
def add_tips(
    v: FloatArray, inside: Bytes, i: int, columns: Columns, hardness: float, tips: FloatArray
) -> None:
    """Add the tips among the points of a row to the sum of each front.

    A spot of two or three points in a block, with no others within two points, shows all that it
    has.  A tip of a front that moves with another one counts less: the steepest way to a neighbour
    gives the width of the strip between them.  A lone point counts less if even the gentlest way is
    steep: then it is a post or a pit of its own cell, which the count has right.
    """
    row = i & LAST
    for j in columns:
        state, like = inside[row, j], -1
        if state == 1:
            continue
        for a in ((i - 1) & LAST, row, (i + 1) & LAST):
            for b in range(j - 1, j + 2):
                like += inside[a, b] == state
        if like > TIP_NEIGHBOURS:
            continue
        near, steepest, gentlest = -1, 0.0, np.inf
        for x in range(-2, 3):
            for y in range(-2, 3):
                a, b = (i + x) & LAST, j + y
                near += inside[a, b] == state
                if max(abs(x), abs(y)) == 1:
                    way = abs(v[0, a, b] + v[-1, a, b] - v[0, row, j] - v[-1, row, j]) / 2
                    steepest, gentlest = max(steepest, way), min(gentlest, way)
        if like == 0 or near > like:
            way = steepest if like else gentlest
            tips[state >> 4] += (hardness / way) ** 2 if way > hardness else 1.0


@compiled
def add_hidden(
    layers: FloatArray,
    lists: Columns,
    i: int,
    columns: Columns,
    hardness: float,
    squares: FloatArray,
    creases: FloatArray,
) -> None:
    """Add what the elastic points of a row may hide beside them: gaps, and plastic zones."""
    v, row, elastic, chosen = layers[0], i & LAST, lists[0], lists[1]
    up, down, count = (i - 1) & LAST, (i + 1) & LAST, 0
    for j in columns:
        elastic[count] = j
        count += (v[row, j] > 0) & (v[row, j] < hardness)
    for front in range(2 if hardness < np.inf else 1):
        cap, sign = (hardness, -1.0) if front else (0.0, 1.0)
        found = 0
        for j in elastic[:count]:
            here = cap + sign * v[row, j]
            above, below = cap + sign * v[up, j], cap + sign * v[down, j]
            left, right = cap + sign * v[row, j - 1], cap + sign * v[row, j + 1]
            lowest = (here <= above) & (here <= below) | (here <= left) & (here <= right)
            lone = (above <= 0) & (below <= 0) & (left <= 0) & (right <= 0)
            chosen[found] = j
            found += lowest | lone
        square, crease = _hidden_at(layers, i, chosen[:found], hardness, front)
        squares[front] += square
        creases[front] += crease


@compiled
def _hidden_at(
    layers: FloatArray, i: int, columns: Columns, hardness: float, front: int
) -> tuple[float, float]:
    """Squares and areas that elastic points hide which are lone, or lowest along x or y."""
    v, row, up, down = layers[0], i & LAST, (i - 1) & LAST, (i + 1) & LAST
    squares = creases = 0.0
    cap, sign = (hardness, -1.0) if front else (0.0, 1.0)
    for j in columns:
        here = cap + sign * v[row, j]
        above, below = _short(v[up, j], hardness, front), _short(v[down, j], hardness, front)
        left, right = _short(v[row, j - 1], hardness, front), _short(v[row, j + 1], hardness, front)
        most = max(above, below, left, right)
        if most <= 0:
            squares += _lacking(layers, (i, j), cap, sign) ** 2
            continue
        if here <= min(above, below, left, right) and most < hardness:
            squares += _dip(here, (above + below + left + right) / 4 - here)
        a, b = _short(v[up, j - 1], hardness, front), _short(v[up, j + 1], hardness, front)
        c, d = _short(v[down, j - 1], hardness, front), _short(v[down, j + 1], hardness, front)
        outer = _short(v[(i - 2) & LAST, j], hardness, front)
        other = _short(v[(i + 2) & LAST, j], hardness, front)
        sides = min(a, left, c), min(b, right, d)
        x_log, x_straight = _crease(here, (above, below), (outer, other), sides)
        outer = _short(v[row, j - 2], hardness, front)
        other = _short(v[row, j + 2], hardness, front)
        sides = min(a, above, b), min(c, below, d)
        y_log, y_straight = _crease(here, (left, right), (outer, other), sides)
        if min(x_log, y_log) > -np.inf:
            squares += 16 * math.exp(2 * (x_log + y_log))
        if max(x_straight, y_straight) > 0:
            area = 2 * max(x_straight * math.exp(x_log), y_straight * math.exp(y_log))
            squares += area * area
            creases += area
    return squares, creases


@compiled
def _short(p: float, hardness: float, front: int) -> float:
    """A pressure from 0 to the hardness, or what it lacks of the hardness for front 1."""
    p = min(max(p, 0.0), hardness)
    return float(hardness - p if front else p)


@compiled
def _dip(here: float, rise: float) -> float:
    """Square of the area of a gap that may be hidden next to a minimum of the pressure.

    here: the pressure there; rise: the mean of its neighbours less it.

    Between the points p may fall to 0 (front 1: hardness - p).  In full contact p is a smooth
    wave.  If it would fall to -p1 + p2 s^2 at the distance s from its lowest place, a gap of
    radius sqrt(3 p1/(2 p2)) opens, like a penny-shaped crack that closes smoothly.  The
    lowest place is at most half of a cell's diagonal away, so p1 is at most p2/2 - p with p the
    pressure at the point.  The second difference of a wave with four points to its length is p2
    divided by SEEN.
    """
    if here >= SEEN * rise / 2:
        return 0.0
    return float((math.pi * 1.5 * (0.5 - here / (SEEN * rise))) ** 2)


@compiled
def _crease(
    here: float,
    beside: tuple[float, float],
    outer: tuple[float, float],
    sides: tuple[float, float],
) -> tuple[float, float]:
    """Width of a gap that may be hidden at a crease, and that along which it may be straight.

    beside, outer: the pressures one and two points across the crease, before and after it; sides:
    the lowest of three along it, on either side.

    At a crease the pressure falls to k ln s, where s is the distance from it, and k ln 3 is the
    rise from half a spacing to 3/2.  A gap opens where it would fall below 0, and twice as wide
    (as in `front`).  The pressure bends the other way beside a crease, and along it, it changes
    less than across by STRAIGHT; where it is 0, the gap shows.  A tip is a crease in both
    directions.
    """
    (before, after), across = beside, max(beside[0], beside[1]) - here
    bends = min(outer[0] - 2 * before, outer[1] - 2 * after) + here < 0
    if here > min(before, after) or across <= 0 or not bends:
        return -np.inf, 0.0
    along = max(sides[0] - here, sides[1] - here, 0.0)
    straight = max(1 - along / (STRAIGHT * across), 0.0) if min(sides) > 0 else 0.0
    return -math.log(3) * here / across, straight


@compiled
def _lacking(layers: FloatArray, place: tuple[int, int], cap: float, sign: float) -> float:
    """What the located area of a lone point lacks of CORNER, because its spot may have no area.

    Front 1: the point is the only elastic one.
    """
    (i, j), row = place, place[0] & LAST
    here, area = cap + sign * layers[0, row, j], 1.0
    for v, x in ((layers[-1], 0), (layers[0], 1)):
        before = cap + sign * v[(i - x) & LAST, j - 1 + x]
        after = cap + sign * v[(i + x) & LAST, j + 1 - x]
        area *= here / (here - before) + here / (here - after)
    return float(max(CORNER - area / 2, 0.0))
