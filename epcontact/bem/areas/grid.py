"""The fronts of a contact on a grid: one pass locates them in every cell that has one.

A front crosses the links between neighbouring points, where `front` locates it.  Straight
segments between the crossings of a cell bound the area.

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
STRIP     segment length times cos 4 theta and u, of fronts that move with the one beside them
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
from numpy.typing import NDArray

from epcontact.bem.areas.front import crossing, field, kind
from epcontact.results import ELASTIC, PLASTIC, FloatArray

#: Values of u at which the offset is tabulated.
U_NODES = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.05, 1.25, 1.5, 1.8, 2.2, 2.8, 3.5])
#: A wave's curvature divided by its second difference between points a quarter wavelength apart.
SEEN = 1.25
#: What `front` misses on straight fronts that meet all their cells alike, beside its doubt, in
#: spacings: the rms of the direction that has most of it (`rim.calibrate_directions`).
LOCATED = 0.005
#: Along a crease the pressure changes by less than this share of its change across.  The loss of
#: the fit of `epcontact.studies.error_bars` is 2.41 with 0.1, 2.39 with 0.2 and 2.37 from 1/3 to 1,
#: but from 1/3 on the claims of straight grooves that no point shows become too small.
STRAIGHT = 0.2
#: A lone point that carries next to nothing is taken for a spot of this area (CORNER).
LONE = 0.6
#: A tip has at most this number of neighbours in its own state.
TIP_NEIGHBOURS = 2

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")
#: The corner, or the side, of a cell before and after each.
_BEFORE, _AFTER = (3, 0, 1, 2), (1, 2, 3, 0)
#: Indices of the sums (SUMS, front, part).
AREA, OFFSET, TURN, FLOWING, STRIP, TIPS, LACKING, DIPS, CREASE = range(9)
LENGTH, HARMONIC, SINE, CHANCE, COMMON, HELD, ALIGNED, HIDDEN, KINKED = range(9, 18)
SUMS = (18, 2, 2)


class Fields(NamedTuple):
    """A solution (nx, ny), its hardness, and c of `front` for the links along x and along y."""

    pressure: FloatArray
    gap: FloatArray
    hardness: float
    stiffness: tuple[float, float]


class Work(NamedTuple):
    """Arrays for one cell: its states, v along x and y, the crossings of its sides, v of a link.

    links: (2, columns + 1, 5), what `front` found for each front on the sides that the cell shares
    with those of the next row, and with the next cell of its own.
    """

    kinds: NDArray[np.int64]
    along: FloatArray
    across: FloatArray
    cut: FloatArray
    v: FloatArray
    links: FloatArray


@_jit
def _wrapped(index: int, size: int) -> int:
    """index modulo size; a division takes as long as all the rest of a point."""
    return index if 0 <= index < size else index % size


@_jit
def interpolated(u: float, table: FloatArray) -> float:
    """A table given at U_NODES, interpolated to u; constant beyond the nodes."""
    if u >= U_NODES[-1]:
        return float(table[-1])
    k = 1
    while U_NODES[k] < u:
        k += 1
    t = (u - U_NODES[k - 1]) / (U_NODES[k] - U_NODES[k - 1])
    return float(table[k - 1] + t * (table[k] - table[k - 1]))


@_jit
def _polygon(
    kinds: NDArray[np.int64], front: int, cut: FloatArray, joined: bool
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


def workspace(columns: int) -> Work:
    """The arrays of `add_cell`, allocated once for all cells."""
    along, across, cut, v = np.empty((4, 6))
    return Work(np.empty(4, np.int64), along, across, cut, v, np.empty((2, columns + 1, 5)))


@_jit
def _locate(
    fields: Fields, place: tuple[int, int], front: int, known: tuple[bool, bool], work: Work
) -> tuple[float, float, float, float]:
    """Locate a front on the sides of a cell, in `work.cut`; the means of what else is found."""
    (i, j), (nx, ny), v, links = place, fields.pressure.shape, work.v, work.links
    crossings, held, hidden, doubt, kinked = 0, 0.0, 0.0, 0.0, 0.0
    for k in (3, 0, 1, 2):
        if (work.kinds[k] > front) == (work.kinds[_AFTER[k]] > front):
            continue
        # Sides 0 and 2 run along x, 1 and 3 along y.
        x_side = k in (0, 2)
        m = ny if x_side else j
        if not ((k == 3 and known[0]) or (k == 0 and known[1])):
            c = fields.stiffness[0] if x_side else fields.stiffness[1]
            row, column = i if k == 1 else i - 1, j if k == 2 else j - 1
            for n in range(6):
                a, b = (row + n - 2, column) if x_side else (row, column + n - 2)
                a, b = _wrapped(a, nx), _wrapped(b, ny)
                v[n] = field(fields.pressure[a, b], fields.gap[a, b], fields.hardness, c)
            found = crossing(v, fields.hardness, front)
            for n in range(5):
                links[front, m, n] = found[n]
        work.cut[k] = links[front, m, 0] if k < 2 else 1 - links[front, m, 0]
        crossings += 1
        held += links[front, m, 1]
        hidden += links[front, m, 2]
        doubt += links[front, m, 3]
        kinked += links[front, m, 4]
    return held / crossings, hidden / crossings, doubt / crossings, kinked / crossings


@_jit
def _slope(along: FloatArray, across: FloatArray, hardness: float) -> tuple[float, float, float]:
    """(u, cos 4 theta, sin 4 theta) of a cell, from v at its corners."""
    dx = (along[1] + along[2] - along[0] - along[3]) / 2
    dy = (across[2] + across[3] - across[0] - across[1]) / 2
    square = dx * dx + dy * dy
    if square <= 0:
        return np.inf, 0.0, 0.0
    sin4 = 4 * dx * dy * (dx - dy) * (dx + dy) / square**2
    return hardness / math.sqrt(square), 1 - 8 * (dx * dy / square) ** 2, sin4


@_jit
def add_cell(
    fields: Fields,
    place: tuple[int, int],
    table: FloatArray,
    sums: FloatArray,
    known: tuple[bool, bool],
    work: Work,
) -> None:
    """Add a cell with a front to the sums; its corners are (i - 1, j - 1) and (i, j).

    known: whether the cell of the row before, and the cell before in this row, have been added.
    """
    i, j = place
    kinds, hardness, middle, elastic = work.kinds, fields.hardness, 0.0, False
    # v with the stiffness of links along x and of links along y
    along, across = work.along, work.across
    for k in range(4):
        a = i if k in (1, 2) else i - 1
        b = j if k >= 2 else j - 1
        p, g = fields.pressure[a, b], fields.gap[a, b]
        kinds[k] = kind(p, hardness)
        elastic = elastic or kinds[k] == ELASTIC
        along[k] = field(p, g, hardness, fields.stiffness[0])
        across[k] = field(p, g, hardness, fields.stiffness[1])
        middle += (along[k] + across[k]) / 8
    u, cos4, sin4 = _slope(along, across, hardness)
    offset, narrow = interpolated(u, table), min(u, 1.0)
    for front in range(2):
        n = 0
        for k in range(4):
            n += kinds[k] > front
        if n == 4:
            sums[AREA, front, 0] += 1
        if n in (0, 4):
            continue
        held, hidden, doubt, kinked = _locate(fields, place, front, known, work)
        area, length, turn = _polygon(kinds, front, work.cut, middle > (hardness if front else 0.0))
        resolved, stuck = (1 - held) * length, held * length
        apart = max(narrow**2, held)
        values = area, offset * resolved, turn, 0.0 if elastic else stuck
        for m in range(4):  # AREA to FLOWING
            sums[m, front, 0] += values[m]
        sums[STRIP, front, 1] += cos4 * (1 - apart) * length * narrow
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


@_jit
def add_tip(fields: Fields, place: tuple[int, int], sums: FloatArray) -> None:
    """Count a point that is a tip; the steepest way to a neighbour gives the width of a strip."""
    (i, j), (nx, ny), hardness = place, fields.pressure.shape, fields.hardness
    p, g = fields.pressure, fields.gap
    state, like = kind(p[i, j], hardness), -1
    if state == ELASTIC:
        return
    rows, columns = (i - 1, i, _wrapped(i + 1, nx)), (j - 1, j, _wrapped(j + 1, ny))
    for a in rows:
        for b in columns:
            like += kind(p[a, b], hardness) == state
    if not 0 < like <= TIP_NEIGHBOURS:
        return
    c, steepest = math.sqrt(fields.stiffness[0] * fields.stiffness[1]), 0.0
    here = field(p[i, j], g[i, j], hardness, c)
    for a in rows:
        for b in columns:
            steepest = max(steepest, abs(field(p[a, b], g[a, b], hardness, c) - here))
    apart = min(hardness / steepest, 1.0) ** 2 if steepest > hardness else 1.0
    front = int(state == PLASTIC)
    sums[TIPS, front, 0] += apart
    sums[TIPS, front, 1] += 1 - apart


@_jit
def _dip(pressure: FloatArray, i: int, j: int, hardness: float, front: int) -> float:
    """Square of the area of a gap that may be hidden next to a minimum of the pressure.

    Between the points p may fall to 0 (front 1: hardness - p).  In full contact p is a smooth
    wave.  If it would fall to -p1 + p2 s^2 at the distance s from its lowest place, a gap of
    radius sqrt(3 p1/(2 p2)) opens, like a penny-shaped crack that closes smoothly.  The
    lowest place is at most half of a cell's diagonal away, so p1 is at most p2/2 - p with p the
    pressure at the point.  The second difference of a wave with four points to its length is p2
    divided by SEEN.
    """
    nx, ny = pressure.shape
    here, above, below = pressure[i, j], pressure[i - 1, j], pressure[_wrapped(i + 1, nx), j]
    left, right = pressure[i, j - 1], pressure[i, _wrapped(j + 1, ny)]
    if front:
        here, above, below = hardness - here, hardness - above, hardness - below
        left, right = hardness - left, hardness - right
    if here <= 0 or here > min(above, below, left, right):
        return 0.0
    if max(above, below, left, right) >= hardness:
        return 0.0
    bend = SEEN * (above + below + left + right - 4 * here) / 4
    if here >= bend / 2:
        return 0.0
    return float((math.pi * 1.5 * (0.5 - here / bend)) ** 2)


@_jit
def _crease(
    pressure: FloatArray, i: int, j: int, hardness: float, front: int
) -> tuple[float, float]:
    """Areas of a gap that may be hidden beside a point, at a crease and at a tip of the surface.

    At a crease the pressure falls to k ln s, where s is the distance from it, and k ln 3 is the
    rise from half a spacing to 3/2.  A gap opens where it would fall below 0, and twice as wide
    (as in `front`).  The pressure bends the other way beside a crease, and along it, it changes
    less than across by STRAIGHT.  At a tip it is the same in two directions at right angles.
    """
    nx, ny = pressure.shape
    sign, base = (-1, hardness) if front else (1, 0.0)
    here, widest, area = base + sign * pressure[i, j], 0.0, 1.0
    for x in range(2):
        y = 1 - x
        a, b = _wrapped(i + x, nx), _wrapped(j + y, ny)
        before, after = base + sign * pressure[i - x, j - y], base + sign * pressure[a, b]
        across, width = max(before, after) - here, 0.0
        if min(before, after) >= here and min(before, after) > 0 and across > 0:
            outer = base + sign * pressure[i - 2 * x, j - 2 * y]
            other = base + sign * pressure[_wrapped(i + 2 * x, nx), _wrapped(j + 2 * y, ny)]
            bend = min(outer + here - 2 * before, other + here - 2 * after)
            if bend < 0:
                width = 2 * 3 ** (-here / across)
                along = 0.0
                for side in (-1, 1):
                    lowest = hardness
                    for shift in (-1, 0, 1):
                        a, b = (
                            _wrapped(i + side * y + shift * x, nx),
                            _wrapped(j + side * x + shift * y, ny),
                        )
                        lowest = min(lowest, base + sign * pressure[a, b])
                    along = max(along, lowest - here)
                widest = max(widest, width * max(1 - along / (STRAIGHT * across), 0.0))
        area *= width
    return widest, area


@_jit
def _lone(fields: Fields, i: int, j: int, front: int) -> float:
    """What the located area of a lone point lacks of LONE, because its spot may have no area.

    Front 1: the point is the only elastic one.
    """
    (nx, ny), hardness, area = fields.pressure.shape, fields.hardness, 1.0
    here = hardness - fields.pressure[i, j] if front else fields.pressure[i, j]
    for x in range(2):
        cut = 0.0
        for side in (-1, 1):
            a, b = _wrapped(i + side * x, nx), _wrapped(j + side * (1 - x), ny)
            v = field(fields.pressure[a, b], fields.gap[a, b], hardness, fields.stiffness[1 - x])
            out = hardness - v if front else v
            if out > 0:
                return 0.0
            cut += here / (here - out)
        area *= cut
    return float(max(LONE - area / 2, 0.0))


@_jit
def sweep(fields: Fields, table: FloatArray, sums: FloatArray, work: Work) -> None:
    """Add up the sums over every cell of the periodic grid; table: offsets at U_NODES."""
    pressure, hardness = fields.pressure, fields.hardness
    nx, ny = pressure.shape
    fronts = 2 if hardness < np.inf else 1
    for i in range(nx):
        above, here = kind(pressure[i - 1, -1], hardness), kind(pressure[i, -1], hardness)
        for j in range(ny):
            above_2, here_2 = kind(pressure[i - 1, j], hardness), kind(pressure[i, j], hardness)
            if above == here == above_2 == here_2:
                sums[AREA, 0, 0] += here > 0
                sums[AREA, 1, 0] += here > 1
            else:
                add_cell(fields, (i, j), table, sums, (i > 0, j > 0), work)
                add_tip(fields, (i, j), sums)
                for front in range(fronts if here_2 == ELASTIC else 0):
                    sums[LACKING, front, 0] += _lone(fields, i, j, front)
            if here_2 == ELASTIC:
                for front in range(fronts):
                    sums[DIPS, front, 0] += _dip(pressure, i, j, hardness, front)
                    crease, tip = _crease(pressure, i, j, hardness, front)
                    sums[CREASE, front, 0] += crease
                    sums[DIPS, front, 0] += tip**2
            above, here = above_2, here_2
