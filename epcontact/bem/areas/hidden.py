"""Gaps and plastic zones that the points of a contact hide between them, and their ends.

Front 0 bounds the contact and front 1 its plastic part, with hardness - p in the place of p.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.areas.front import compiled
from epcontact.results import FloatArray

Bytes = NDArray[np.uint8]
#: Numbers of columns.  Those without a sign need no test for a negative index.
Columns = NDArray[np.uint32]

#: A wave's curvature p2 divided by its second difference between points a quarter wavelength apart.
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
    for j in columns:
        state, like = inside[i, j], -1
        if state == 1:
            continue
        for a in range(i - 1, i + 2):
            for b in range(j - 1, j + 2):
                like += inside[a, b] == state
        if like > TIP_NEIGHBOURS:
            continue
        near, steepest, gentlest = -1, 0.0, np.inf
        for a in range(i - 2, i + 3):
            for b in range(j - 2, j + 3):
                near += inside[a, b] == state
                if max(abs(a - i), abs(b - j)) == 1:
                    way = abs(v[0, a, b] + v[-1, a, b] - v[0, i, j] - v[-1, i, j]) / 2
                    steepest, gentlest = max(steepest, way), min(gentlest, way)
        if like == 0 or near > like:
            way = steepest if like else gentlest
            tips[state >> 4] += (hardness / way) ** 2 if way > hardness else 1.0


@compiled
def add_hidden(
    v: FloatArray, i: int, columns: Columns, hardness: float, sums: tuple[FloatArray, FloatArray]
) -> None:
    """Add what a row's elastic points may hide to the sums of squares and creases of each front."""
    for front in range(2 if hardness < np.inf else 1):
        squares = creases = 0.0
        for j in columns:
            if 0 < v[0, i, j] < hardness:
                square, crease = _hidden_beside(v, (i, j), hardness, front)
                squares, creases = squares + square, creases + crease
        sums[0][front] += squares
        sums[1][front] += creases


@compiled
def _hidden_beside(
    layers: FloatArray, place: tuple[int, int], hardness: float, front: int
) -> tuple[float, float]:
    """(square of areas, area at a crease) that an elastic point may hide beside it."""
    v, (i, j) = layers[0], place
    here = _short(v[i, j], hardness, front)
    above, below = _short(v[i - 1, j], hardness, front), _short(v[i + 1, j], hardness, front)
    left, right = _short(v[i, j - 1], hardness, front), _short(v[i, j + 1], hardness, front)
    most, squares = max(above, below, left, right), 0.0
    if most <= 0:
        return _lacking(layers, place, hardness, front) ** 2, 0.0
    if here > min(above, below) and here > min(left, right):
        return 0.0, 0.0
    # In full contact p is a smooth wave.  If it would fall to -p1 + p2 s^2 at the distance s from
    # its lowest place, a gap of radius sqrt(3 p1/(2 p2)) opens, like a penny-shaped crack that
    # closes smoothly.  This place is at most half a cell's diagonal away, so that p1 <= p2/2 - p.
    rise = SEEN * ((above + below + left + right) / 4 - here)
    if here <= min(above, below, left, right) and most < hardness and here < rise / 2:
        squares = (math.pi * 1.5 * (0.5 - here / rise)) ** 2
    a, b = _short(v[i - 1, j - 1], hardness, front), _short(v[i - 1, j + 1], hardness, front)
    c, d = _short(v[i + 1, j - 1], hardness, front), _short(v[i + 1, j + 1], hardness, front)
    outer = _short(v[i - 2, j], hardness, front), _short(v[i + 2, j], hardness, front)
    sides = min(a, left, c), min(b, right, d)
    x_log, x_straight = _crease(here, (above, below), outer, sides)
    outer = _short(v[i, j - 2], hardness, front), _short(v[i, j + 2], hardness, front)
    sides = min(a, above, b), min(c, below, d)
    y_log, y_straight = _crease(here, (left, right), outer, sides)
    if min(x_log, y_log) > -np.inf:
        squares += 16 * math.exp(2 * (x_log + y_log))
    area = 2 * max(x_straight * math.exp(x_log), y_straight * math.exp(y_log))
    return squares + area * area, area


@compiled
def _short(p: float, hardness: float, front: int) -> float:
    """A pressure from 0 to the hardness, or what it lacks of the hardness for front 1."""
    p = min(max(p, 0.0), hardness)
    return float(hardness - p if front else p)


@compiled
def _crease(
    here: float, beside: tuple[float, float], outer: tuple[float, float], sides: tuple[float, float]
) -> tuple[float, float]:
    """(ln of half the width of a gap that a crease may hide, share of it that may be straight).

    beside, outer: the pressures one and two points across the crease; sides: the lowest of three
    along it, on either side.  At a crease the pressure falls to k ln s, where s is the distance
    from it, and k ln 3 is the rise from half a spacing to 3/2.  A gap opens where it would fall
    below 0, and twice as wide (as in `front`).  The pressure bends the other way beside a crease,
    and along it, it changes less than across by STRAIGHT; where it is 0, the gap shows.  A tip is
    a crease in both directions.
    """
    (before, after), across = beside, max(beside[0], beside[1]) - here
    bends = min(outer[0] - 2 * before, outer[1] - 2 * after) + here < 0
    if here > min(before, after) or across <= 0 or not bends:
        return -np.inf, 0.0
    along = max(sides[0] - here, sides[1] - here, 0.0)
    straight = max(1 - along / (STRAIGHT * across), 0.0) if min(sides) > 0 else 0.0
    return -math.log(3) * here / across, straight


@compiled
def _lacking(layers: FloatArray, place: tuple[int, int], hardness: float, front: int) -> float:
    """The part of CORNER that a lone point's located area lacks, as its spot may have no area."""
    (i, j), area = place, 1.0
    cap, sign = (hardness, -1.0) if front else (0.0, 1.0)
    here = cap + sign * layers[0, i, j]
    for layer, x in ((-1, 0), (0, 1)):
        v = layers[layer]
        before, after = cap + sign * v[i - x, j - 1 + x], cap + sign * v[i + x, j + 1 - x]
        area *= here / (here - before) + here / (here - after)
    return float(max(CORNER - area / 2, 0.0))
