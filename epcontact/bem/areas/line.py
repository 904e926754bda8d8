"""The rim correction on a line: lengths of contact, each front located inside its cell by `front`.

Each front is moved by its offset: AXIS_OFFSET, or, where points apart and plastic points are
close to each other, the value of LINE_OFFSETS at u = hardness/|difference of v| (see `grid`).
The middle of an elastic strip narrower than a spacing follows from the force, because the
pressure rises antisymmetrically about it, p = (2 H/pi) arcsin sqrt(s/w): it is half a spacing
beyond the last plastic point plus the sum of p/H over the elastic points.

Chance decides whether a gap (or plastic spot) narrower than a spacing contains a grid point.  If it
does, it shows as a single point between points in contact, and the count misses LONE of a spacing,
which was fitted to rough lines.  On smooth lines with gaps whose widths are equally likely, it
would miss STRAIGHT_LONE.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from epcontact.bem.areas.front import ANYWHERE, STIFFNESS, crossing, field
from epcontact.bem.areas.grid import SEEN, interpolated
from epcontact.results import FloatArray

Pair = tuple[float, float]

#: Offset of a located front in spacings at grid.U_NODES (`rim.calibrate_strips`).
LINE_OFFSETS = np.array(
    [
        *(0.0, 0.0717, 0.1382, 0.1932, 0.2292, 0.2358, 0.2471, 0.2106),
        *(0.2007, 0.1976, 0.168, 0.1886, 0.19, 0.19),
    ]
)
#: Spacings missed for each lone point: by calibration (`rim.calibrate_straight_tip`), and as
#: fitted to rough lines.
STRAIGHT_LONE, LONE = 0.109, 0.2
#: Least standard deviation of the place of a front that no edge holds.
PLACE = 0.025

_jit = numba.njit(cache=True, nogil=True)


def line_lengths(
    pressure: FloatArray, gap: FloatArray, hardness: float, stiffness: float
) -> tuple[Pair, Pair, Pair]:
    """(contact, plastic) lengths in grid spacings: as counted, as located, and their errors.

    pressure, gap: (n,); stiffness: E*/dx in Pa/m.
    """
    c, capped = STIFFNESS * stiffness, math.isfinite(hardness)
    contact, contact_error = _located(pressure, gap, hardness, c)
    rest, rest_error = _located(hardness - pressure, -gap, hardness, c) if capped else (0.0, 0.0)
    n = pressure.size
    plastic = n - rest if capped else 0.0
    counted = (
        float(np.count_nonzero(pressure > 0)),
        float(np.count_nonzero(pressure >= hardness)),
    )
    errors = (
        contact_error + _order(counted[0], contact, n, capped),
        rest_error + _order(counted[1], plastic, n, capped),
    )
    return counted, (contact, plastic), errors


def _order(counted: float, located: float, n: int, capped: bool) -> float:
    """The error of the next order: the correction times its ratio to the smaller part.

    The factors are measured on rough lines; with strips between the fronts the error is larger.
    """
    smaller = max(min(located, n - located), 1.0)
    return (
        (1.5 if capped else 1.0)
        * abs(counted - located)
        * min(1.0, abs(counted - located) / smaller)
    )


@_jit
def _located(p: FloatArray, g: FloatArray, hardness: float, c: float) -> tuple[float, float]:
    """The length where p > 0, and twice the standard deviation of its error, from all fronts."""
    n = p.size
    length = chance = 0.0
    for i in range(n):
        before, after = p[i - 1], p[(i + 1) % n]
        if p[i] > 0:
            length += 1
            if 0 < before < hardness and 0 < after < hardness and p[i] < hardness:
                chance += (_dip(before, p[i], after) / 2) ** 2
        elif before > 0 and after > 0:
            length -= LONE
            chance += 0.16
        for d in (-1, 1):
            if p[i] <= 0 or p[(i + d) % n] > 0:
                continue
            outer, doubt = _front(p, g, hardness, c, i, d, 0)
            width, middle = _strip(p, g, hardness, c, i, d, outer)
            if width < 1:
                length += middle + width / 2
                chance += (0.1 + 0.2 * width) ** 2
            else:
                length += outer - 0.5
                chance += doubt**2
            # Short runs end where the half-line's solution does not hold any more.
            short = int(p[(i - d) % n] <= 0) + int(p[(i + 2 * d) % n] > 0)
            chance += (0.06 * short) ** 2
    return length, 2 * math.sqrt(chance)


@_jit
def _front(
    p: FloatArray, g: FloatArray, hardness: float, c: float, i: int, d: int, front: int
) -> tuple[float, float]:
    """Place of a front between i and i + d and its standard deviation, in spacings from i."""
    n = p.size
    v = (
        field(p[(i - 2 * d) % n], g[(i - 2 * d) % n], hardness, c),
        field(p[(i - d) % n], g[(i - d) % n], hardness, c),
        field(p[i], g[i], hardness, c),
        field(p[(i + d) % n], g[(i + d) % n], hardness, c),
        field(p[(i + 2 * d) % n], g[(i + 2 * d) % n], hardness, c),
        field(p[(i + 3 * d) % n], g[(i + 3 * d) % n], hardness, c),
    )
    offset = interpolated(hardness / (v[2] - v[3]), LINE_OFFSETS)
    where, held, _, doubt, _ = crossing(v, hardness, front)
    if held:
        return where, ANYWHERE
    # Twice, because the two fronts of a contact are often alike.
    return where + (offset if front else -offset), max(PLACE, 2 * abs(doubt))


@_jit
def _strip(
    p: FloatArray, g: FloatArray, hardness: float, c: float, i: int, d: int, outer: float
) -> tuple[float, float]:
    """Width of the elastic strip behind a front between i and i + d, and the place of its middle.

    The middle follows from the force and is counted from the edge of the points in contact.  The
    width is 9 if there is no narrow strip.
    """
    n = p.size
    force = 0.0
    for m in range(4):
        k = (i - m * d) % n
        if p[k] <= 0 or not np.isfinite(hardness):
            break
        if p[k] >= hardness:
            inner = _front(p, g, hardness, c, k, d, 1)[0] - m
            return max(outer - inner, 0.0), force - m
        force += p[k] / hardness
    return 9.0, 0.0


@_jit
def _dip(before: float, here: float, after: float) -> float:
    """Width of a gap that may be hidden next to a minimum of the pressure.

    In full contact p is a smooth wave.  If it would fall to -p1 + p2 s^2 at the
    distance s from its lowest place, a gap of half-width sqrt(2 p1/p2) opens.  The lowest place
    is at most half a spacing away, so p1 is at most p2/4 - p.  The second difference of a wave
    with four points to its length is p2 divided by SEEN.
    """
    bend = SEEN * (before + after - 2 * here) / 2
    if here > min(before, after) or here >= bend / 4:
        return 0.0
    return float(2 * math.sqrt(0.5 - 2 * here / bend))
