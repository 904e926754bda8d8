"""The fronts of a contact on a grid: one pass locates them in every cell that has one.

A front crosses the links between neighbouring points, where `front` locates it.  Straight
segments between the crossings of a cell bound the area.  All that the pass needs to know of a point
is `front.field`, v: at most 0 where apart, at least the hardness where plastic.

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
TIPS      points apart (or plastic) with one or two of their eight neighbours in the same state
DIPS      squares of the areas of gaps that may be hidden between points that all touch, in waves
          and at tips
CREASE    areas of gaps that may be hidden at creases between points that all touch
LACKING   areas that lone points lack of LONE

Sums have two parts: those of the front for itself, and those of fronts so steep that they move
with the other front beside them.  A front of u < 1 spacings belongs by u^2 to the first.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from epcontact.bem.areas.front import Six, compiled, crossing, field, kind
from epcontact.results import ELASTIC, PLASTIC, FloatArray

#: Values of u at which the offset is tabulated.
U_NODES = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.05, 1.25, 1.5, 1.8, 2.2, 2.8, 3.5])
#: A wave's curvature divided by its second difference between points a quarter wavelength apart.
SEEN = 1.25
#: What `front` misses on straight fronts that meet all their cells alike, beside its doubt, in
#: spacings: the rms of the direction that has most of it (`rim.calibrate_directions`).
LOCATED = 0.005
#: Along a crease the pressure changes by less than this share of its change across.  The loss of
#: the fit of `epcontact.studies.error_bars` is 2.68 with 0.1, 2.65 with 0.2 and 1, and 2.63 with
#: 1/3, but from 1/3 on the claims of straight grooves that no point shows become too small.
STRAIGHT = 0.2
#: A lone point that carries next to nothing is taken for a spot of this area (CORNER).
LONE = 0.6
#: A tip has at most this number of neighbours in its own state.
TIP_NEIGHBOURS = 2

#: What is called at one place is compiled there: a call counts references to each array, which
#: took an eighth of the time of the pass.
_inlined = numba.njit(nogil=True, error_model="numpy", inline="always")
#: The corner, or the side, of a cell before and after each.
_BEFORE, _AFTER = (3, 0, 1, 2), (1, 2, 3, 0)
#: v of eight rows is in memory, that of row i at i & _LAST, with _PAD columns repeated at both
#: ends.  A cell needs three rows before its last corner and two after it.
_LAST, _PAD = 7, 3
Corners = tuple[float, float, float, float]
States = tuple[int, int, int, int]


class Rows(NamedTuple):
    """v of the rows in memory, with c of `front` for the links along x and for those along y."""

    along: FloatArray
    across: FloatArray


class Crossings(NamedTuple):
    """Where a front crosses links.

    links: (2, columns + 1, 5), what `front` found for each front on the sides that the cell shares
    with those of the next row, and with the next cell of its own; cut: (4,) the places on a cell's
    sides.
    """

    links: FloatArray
    cut: FloatArray


#: Indices of the sums (SUMS, front, part).
AREA, OFFSET, TURN, FLOWING, TIPS, LACKING, DIPS, CREASE = range(8)
LENGTH, HARMONIC, SINE, CHANCE, COMMON, HELD, ALIGNED, HIDDEN, KINKED = range(8, 17)
SUMS = (17, 2, 2)


@compiled
def sweep(
    pressure: FloatArray,
    gap: FloatArray,
    hardness: float,
    stiffness: tuple[float, float],
    table: FloatArray,
    rows: tuple[int, int],
    columns: tuple[int, int],
) -> FloatArray:
    """The sums over the cells of a periodic grid whose last corners are in `rows` and `columns`.

    pressure, gap: (nx, ny); stiffness: c of `front` for the links along x and along y; table:
    offsets at U_NODES.
    """
    sums, size = np.zeros(SUMS), pressure.shape[1]
    along = np.empty((_LAST + 1, size + 2 * _PAD))
    across = along if stiffness[0] == stiffness[1] else np.empty_like(along)
    window, crossings = Rows(along, across), Crossings(np.empty((2, size + 1, 5)), np.empty(4))
    fronts = 2 if hardness < np.inf else 1
    for i in range(rows[0] - _PAD, rows[0] + 2):
        _fill(pressure, gap, hardness, stiffness, i, window)
    for i in range(rows[0], rows[1]):
        _fill(pressure, gap, hardness, stiffness, i + 2, window)
        row, last = i & _LAST, (i - 1) & _LAST
        above = kind(along[last, columns[0] + _PAD - 1], hardness)
        left = kind(along[row, columns[0] + _PAD - 1], hardness)
        for j in range(columns[0], columns[1]):
            over, here = kind(along[last, j + _PAD], hardness), kind(along[row, j + _PAD], hardness)
            if above == left == over == here:
                sums[AREA, 0, 0] += here > 0
                sums[AREA, 1, 0] += here > 1
            else:
                known = i > rows[0], j > columns[0]
                _add_cell(window, (i, j), hardness, table, known, crossings, sums)
                if here != ELASTIC:
                    _add_tip(window, (i, j), hardness, sums)
            if here == ELASTIC:
                for front in range(fronts):
                    _add_hidden(window, (i, j), hardness, front, sums)
            above, left = over, here
    return sums


@compiled
def _fill(
    pressure: FloatArray,
    gap: FloatArray,
    hardness: float,
    stiffness: tuple[float, float],
    i: int,
    window: Rows,
) -> None:
    """Put v of row i into memory, with the stiffness of links along x and of links along y."""
    (rows, columns), into, (along, across) = pressure.shape, i & _LAST, window
    for j in range(columns):
        p, g = pressure[i % rows, j], gap[i % rows, j]
        along[into, j + _PAD] = field(p, g, hardness, stiffness[0])
        if across is not along:
            across[into, j + _PAD] = field(p, g, hardness, stiffness[1])
    for v in (along, across):
        for j in range(_PAD):
            v[into, j] = v[into, (j - _PAD) % columns + _PAD]
            v[into, columns + _PAD + j] = v[into, j % columns + _PAD]


@compiled
def _interpolated(u: float, table: FloatArray) -> float:
    """A table given at U_NODES, interpolated to u; constant beyond the nodes."""
    if u >= U_NODES[-1]:
        return float(table[-1])
    k = 1
    while U_NODES[k] < u:
        k += 1
    t = (u - U_NODES[k - 1]) / (U_NODES[k] - U_NODES[k - 1])
    return float(table[k - 1] + t * (table[k] - table[k - 1]))


@compiled
def _polygon(
    kinds: States, front: int, cut: FloatArray, joined: bool
) -> tuple[float, float, float]:
    """(area, length of front, turn) of the part of a unit cell that is inside a front.

    kinds: (4,) the states of the corners (0, 0), (1, 0), (1, 1), (0, 1); cut: where the front
    crosses each side, from its first corner to the next; joined: whether two opposite corners that
    are inside are connected.  The turn is a quarter for each corner cut off.
    """
    n = 0
    for k in range(4):
        n += kinds[k] > front
    opposite = n == 2 and (kinds[0] > front) == (kinds[2] > front)
    if n == 2 and not opposite:
        # first: the side with no crossing, or its opposite
        first = 0 if (kinds[0] > front) == (kinds[1] > front) else 1
        s, t = cut[first + 1], 1 - cut[_BEFORE[first]]
        area = (s + t) / 2
        return (area if kinds[first] > front else 1 - area), math.sqrt(1 + (s - t) ** 2), 0.0
    # Cut off the single corner or, of two opposite pairs, the outside one if the inside is
    # connected and else the inside one.
    inside = n == 1 or (opposite and not joined)
    area = length = turn = 0.0
    for k in range(4):
        if (kinds[k] > front) == inside:
            x, y = cut[k], 1 - cut[_BEFORE[k]]
            area += x * y / 2
            length += math.sqrt(x * x + y * y)
            turn += 0.25
    return (area, length, turn) if inside else (1 - area, length, -turn)


@compiled
def _six(v: FloatArray, i: int, j: int, x: int) -> Six:
    """Six values one after another along x (1) or y (0), from row i and column j of the memory."""
    y = 1 - x
    return (
        v[i & _LAST, j],
        v[(i + x) & _LAST, j + y],
        v[(i + 2 * x) & _LAST, j + 2 * y],
        v[(i + 3 * x) & _LAST, j + 3 * y],
        v[(i + 4 * x) & _LAST, j + 4 * y],
        v[(i + 5 * x) & _LAST, j + 5 * y],
    )


@_inlined
def _locate(
    window: Rows,
    place: tuple[int, int],
    hardness: float,
    front: int,
    known: tuple[bool, bool],
    kinds: States,
    found: Crossings,
) -> tuple[float, float, float, float]:
    """Locate a front on the sides of a cell, in `found.cut`; the means of what else is found."""
    (i, j), (along, across), (links, cut) = place, window, found
    crossings, held, hidden, doubt, kinked = 0, 0.0, 0.0, 0.0, 0.0
    for k in (3, 0, 1, 2):
        if (kinds[k] > front) == (kinds[_AFTER[k]] > front):
            continue
        # Sides 0 and 2 run along x, 1 and 3 along y.
        x_side = k in (0, 2)
        m = links.shape[1] - 1 if x_side else j
        if not ((k == 3 and known[0]) or (k == 0 and known[1])):
            if x_side:
                v = _six(along, i - 3, j + _PAD - (k == 0), 1)
            else:
                v = _six(across, i - (k == 3), j, 0)
            link = crossing(v, hardness, front)
            for n in range(5):
                links[front, m, n] = link[n]
        cut[k] = links[front, m, 0] if k < 2 else 1 - links[front, m, 0]
        crossings += 1
        held += links[front, m, 1]
        hidden += links[front, m, 2]
        doubt += links[front, m, 3]
        kinked += links[front, m, 4]
    return held / crossings, hidden / crossings, doubt / crossings, kinked / crossings


@compiled
def _slope(along: Corners, across: Corners, hardness: float) -> tuple[float, float, float]:
    """(u, cos 4 theta, sin 4 theta) of a cell, from v at its corners."""
    dx = (along[1] + along[2] - along[0] - along[3]) / 2
    dy = (across[2] + across[3] - across[0] - across[1]) / 2
    square = dx * dx + dy * dy
    if square <= 0:
        return np.inf, 0.0, 0.0
    sin4 = 4 * dx * dy * (dx - dy) * (dx + dy) / square**2
    return hardness / math.sqrt(square), 1 - 8 * (dx * dy / square) ** 2, sin4


@_inlined
def _add_cell(
    window: Rows,
    place: tuple[int, int],
    hardness: float,
    table: FloatArray,
    known: tuple[bool, bool],
    found: Crossings,
    sums: FloatArray,
) -> None:
    """Add a cell with a front to the sums; its corners are (i - 1, j - 1) and (i, j).

    known: whether the cell of the row before, and the cell before in this row, have been added.
    """
    (i, j), (along, across) = place, window
    r, s, b, a = (i - 1) & _LAST, i & _LAST, j + _PAD, j + _PAD - 1
    x = along[r, a], along[s, a], along[s, b], along[r, b]
    y = across[r, a], across[s, a], across[s, b], across[r, b]
    kinds = kind(x[0], hardness), kind(x[1], hardness), kind(x[2], hardness), kind(x[3], hardness)
    elastic = ELASTIC in kinds
    middle = (x[0] + x[1] + x[2] + x[3] + y[0] + y[1] + y[2] + y[3]) / 8
    u, cos4, sin4 = _slope(x, y, hardness)
    offset, steep = _interpolated(u, table), min(u, 1.0) ** 2
    for front in range(2):
        n = 0
        for k in range(4):
            n += kinds[k] > front
        if n == 4:
            sums[AREA, front, 0] += 1
        if n in (0, 4):
            continue
        held, hidden, doubt, kinked = _locate(window, place, hardness, front, known, kinds, found)
        area, length, turn = _polygon(
            kinds, front, found.cut, middle > (hardness if front else 0.0)
        )
        resolved, stuck = (1 - held) * length, held * length
        apart = max(steep, held)
        sums[AREA, front, 0] += area
        sums[OFFSET, front, 0] += offset * resolved
        sums[TURN, front, 0] += turn
        sums[FLOWING, front, 0] += 0.0 if elastic else stuck
        more = (
            length,
            cos4 * resolved,
            sin4 * resolved,
            doubt**2 * resolved,
            doubt * resolved,
            stuck,
            cos4 * stuck,
            hidden * length,
            kinked * length,
        )
        for m in range(9):  # LENGTH to KINKED
            sums[LENGTH + m, front, 0] += apart * more[m]
            sums[LENGTH + m, front, 1] += (1 - apart) * more[m]


@compiled
def _add_tip(window: Rows, place: tuple[int, int], hardness: float, sums: FloatArray) -> None:
    """Count a point that is a tip; the steepest way to a neighbour gives the width of a strip."""
    (i, j), (along, across) = place, window
    here, column = along[i & _LAST, j + _PAD], j + _PAD
    state, like, steepest = kind(here, hardness), -1, 0.0
    for a in range(i - 1, i + 2):
        for b in range(column - 1, column + 2):
            like += kind(along[a & _LAST, b], hardness) == state
    if not 0 < like <= TIP_NEIGHBOURS:
        return
    here += across[i & _LAST, column]
    for a in range(i - 1, i + 2):
        for b in range(column - 1, column + 2):
            there = along[a & _LAST, b] + across[a & _LAST, b]
            steepest = max(steepest, abs(there - here) / 2)
    apart = min(hardness / steepest, 1.0) ** 2 if steepest > hardness else 1.0
    front = int(state == PLASTIC)
    sums[TIPS, front, 0] += apart
    sums[TIPS, front, 1] += 1 - apart


@compiled
def _short(v: FloatArray, i: int, j: int, hardness: float, front: int) -> float:
    """The pressure at a point, or what it lacks of the hardness for front 1."""
    p = min(max(v[i & _LAST, j + _PAD], 0.0), hardness)
    return float(hardness - p if front else p)


@_inlined
def _add_hidden(
    window: Rows, place: tuple[int, int], hardness: float, front: int, sums: FloatArray
) -> None:
    """Add what an elastic point may hide beside it: gaps, or for front 1 plastic zones."""
    v, (i, j) = window.along, place
    here = _short(v, i, j, hardness, front)
    above, below = _short(v, i - 1, j, hardness, front), _short(v, i + 1, j, hardness, front)
    left, right = _short(v, i, j - 1, hardness, front), _short(v, i, j + 1, hardness, front)
    least, most = min(above, below, left, right), max(above, below, left, right)
    if most <= 0:
        sums[LACKING, front, 0] += _lacking(window, place, hardness, front)
    if here <= least and most < hardness:
        sums[DIPS, front, 0] += _dip(here, (above + below + left + right) / 4 - here)
    x_width = y_width = x_straight = y_straight = 0.0
    if here <= min(above, below) and min(above, below) > 0:
        x_width, x_straight = _crease(v, place, 1, hardness, front)
    if here <= min(left, right) and min(left, right) > 0:
        y_width, y_straight = _crease(v, place, 0, hardness, front)
    sums[CREASE, front, 0] += max(x_straight, y_straight)
    sums[DIPS, front, 0] += (x_width * y_width) ** 2


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
    v: FloatArray, place: tuple[int, int], x: int, hardness: float, front: int
) -> tuple[float, float]:
    """Width of a gap that may be hidden at a crease across x (1) or y (0), and that along which it
    may be straight.

    At a crease the pressure falls to k ln s, where s is the distance from it, and k ln 3 is the
    rise from half a spacing to 3/2.  A gap opens where it would fall below 0, and twice as wide
    (as in `front`).  The pressure bends the other way beside a crease, and along it, it changes
    less than across by STRAIGHT; where it is 0, the gap shows.  A tip is a crease in both
    directions.
    """
    (i, j), y = place, 1 - x
    here = _short(v, i, j, hardness, front)
    before = _short(v, i - x, j - y, hardness, front)
    after = _short(v, i + x, j + y, hardness, front)
    outer = _short(v, i - 2 * x, j - 2 * y, hardness, front)
    other = _short(v, i + 2 * x, j + 2 * y, hardness, front)
    across = max(before, after) - here
    if across <= 0 or min(outer + here - 2 * before, other + here - 2 * after) >= 0:
        return 0.0, 0.0
    width, along = float(2 * 3 ** (-here / across)), 0.0
    for side in (-1, 1):
        lowest = hardness
        for shift in (-1, 0, 1):
            a, b = i + side * y + shift * x, j + side * x + shift * y
            lowest = min(lowest, _short(v, a, b, hardness, front))
        if lowest <= 0:
            return width, 0.0
        along = max(along, lowest - here)
    return width, width * max(1 - along / (STRAIGHT * across), 0.0)


@compiled
def _lacking(window: Rows, place: tuple[int, int], hardness: float, front: int) -> float:
    """What the located area of a lone point lacks of LONE, because its spot may have no area.

    Front 1: the point is the only elastic one.
    """
    (i, j), area = place, 1.0
    here = _short(window.along, i, j, hardness, front)
    for x in range(2):
        v, cut = window.along if x else window.across, 0.0
        for side in (-1, 1):
            out = v[(i + side * x) & _LAST, j + side * (1 - x) + _PAD]
            cut += here / (here - (hardness - out if front else out))
        area *= cut
    return float(max(LONE - area / 2, 0.0))
