"""Locate a front between two grid points, exactly for a straight front along the grid.

At a front between apart and elastic points the discrete problem on the half-line is solved by a
Wiener-Hopf factorisation of the compliance 2/(E* |q|), |q| < pi/dx.  Let q(x) = alpha + beta x +
... be the polynomial that sqrt(distance) p is in the continuum.  The pressure inside is
(1/S_+) q and the gap outside is -S_- q.  The leading coefficients of S give, in units of
c = pi E*/(2 e dx), with b = Si(pi)/pi and points counted from the last in contact outwards,

    q(0) = p_0,  q(-1) = p_1 + b p_0,  q(-2) = p_2 + b p_1 + (b^2/2 + d) p_0  (to a common factor),
    q(1) = -c g_1,  q(2) = -c (g_2 - b g_1),  q(3) = -c (g_3 - b g_2 + (b^2/2 - d) g_1)

with d = Si(2 pi)/(2 pi).  The front is AXIS_OFFSET dx short of the root of q between 0 and 1, that
of the polynomial through those of the six values that this contact and this gap have: the offset is
exact up to the fifth order in dx, as the magnitude of S has no further terms.

The plastic front is the same with hardness - p for p and -g for g.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from epcontact.results import FloatArray

#: Offset of a front along an axis, in dx: 1/4 - (1/2 pi) int_0^{pi/2} (cot t/t - cot^2 t) dt.
AXIS_OFFSET = 0.190009285925947
#: STIFFNESS is c in E*/dx, and MIX is b.
STIFFNESS = math.pi / (2 * math.e)
MIX = 0.5894898722360835  # Si(pi)/pi
#: b^2/2 + d and b^2/2 - d.
INNER, OUTER = 0.3994549881295272, -0.05195667866061313
#: With this ratio to the third difference, a fourth one moves the middle of a link as far.
EQUAL = 8 / 3
#: A contact of fewer than three points that carries more than this share of the hardness hides a
#: plastic spot: four values locate its front, with which the errors of two fronts cancel (without
#: it a third more error, `area_bank`).
FAR = 0.1
#: Standard deviation of the place of a front of which only the link is known.
ANYWHERE = 1 / math.sqrt(12)
#: A gap that changes between two points by more than this multiple of its changes beside them has
#: a step there (`error_bars`, which tells little between 3 and 12).
STEP = 6.0
#: At a kink the parabola of the gap closes too far out, by KINK times p/(p + c g) spacings, with p
#: and g on either side of the front (`rim.calibrate_kink`).
KINK = 0.13
#: An edge of a flattened spot is one where the strip beside it was below this width (`area_bank`).
EDGE = 0.75
#: Release of a front by that of a straight one along the grid: .87 for straight ones of all
#: directions (`rim.calibrate_release`), .5 to .8 on rough surfaces (`area_bank`).
RELEASE = 0.75

#: Compiles a function of this room; nothing calls one from C, and an inner one not from Python.
compiled = numba.njit(cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True)
inner = numba.njit(
    cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True, no_cpython_wrapper=True
)


class Links(NamedTuple):
    """What is found on n links that a front crosses, in spacings."""

    place: FloatArray  # of the front from the point inside, 0 to 1; 1/2 where a step holds it
    #: By how much the last term of the polynomial moves the middle of the link, outwards if
    #: positive: the front may be elsewhere by as much.
    doubt: FloatArray
    held: FloatArray  # 1 if a step of the surface holds the front: any place is equally likely
    zone: FloatArray  # width of the zone at an edge that must be plastic, but shows no point
    kinked: FloatArray  # 1 where the surface has a kink at the front or close behind it
    spot: FloatArray  # 1 where the front is at the edge of a spot that earlier flow has flattened
    fallen: FloatArray  # what the pressure of its last point has lost since, by the hardness


@compiled
def locate(v: FloatArray, sunk: FloatArray, count: int, hardness: float, yielded: float) -> Links:
    """Find the `Links` from v (6, n) at six points in a row, the first `count` of n.

    The front is between the third, which is inside, and the fourth; v is p - c g, for the plastic
    front hardness - (p - c g).  sunk: (n,) c w where flow has lowered the third point by w and the
    fourth never; negative where it has lowered both; yielded: the hardness of that flow.
    """
    found = np.zeros((7, count))
    links = Links(found[0], found[1], found[2], found[3], found[4], found[5], found[6])
    for n in range(count):
        first, before, last, out, after, end = v[0, n], v[1, n], v[2, n], v[3, n], v[4, n], v[5, n]
        slope = last + sunk[n] - out
        if sunk[n] > 0 and EDGE * slope > yielded:
            links.place[n], links.spot[n] = min((yielded + sunk[n]) / slope, 1.0), 1.0
            links.fallen[n] = 1 - last / yielded
            continue
        place, doubt, hump = _root((first, before, last, out, after, end), hardness, sunk[n] >= 0)
        step, kink = _edges(first, before, last, out, after, hardness)
        held, away = step and (place < 0.5 or last >= hardness), 1.0
        if kink and not held:
            if after <= 0:
                away = _closing(-out, -after, -end if end <= 0 else out - 2 * after)
            held = away >= 1
        if (step or kink) and last < hardness:
            at_kink = 3 ** ((last - hardness) / (last - before))
            links.zone[n] = (math.pi / 4 * last / hardness) ** 2 if step else at_kink
        if held:
            place, doubt, hump, links.held[n] = 0.5, 0.0, False, 1.0
        elif kink:
            place, hump = 1 - away - KINK * last / (last - out) + AXIS_OFFSET, True
        links.place[n], links.doubt[n] = min(max(place, 0.0), 1.0), doubt
        links.kinked[n] = 1.0 if hump else 0.0
    return links


@inner
def _root(
    v: tuple[float, float, float, float, float, float], hardness: float, of_gap: bool
) -> tuple[float, float, bool]:
    """(place, doubt, whether the pressure peaks before its last point) by the polynomial.

    Points may belong to another part of the surface: the outermost are left out where the term of
    the fourth difference exceeds that of the third.  The polynomial is that of the pressure, or, if
    no point is in the strip, of the gap.
    """
    first, before, last, out, after, end = v
    elastic = last < hardness
    mix, inner, outer, less = (MIX, INNER, OUTER, 0.0) if elastic else (0.0, 0.0, 0.0, hardness)
    one = 0 < before < hardness if elastic else before >= hardness
    two = one and (0 < first < hardness if elastic else first >= hardness)
    three = of_gap and after <= 0
    four = three and end <= 0
    a, b, c = first + mix * before + inner * last - less, before + mix * last - less, last - less
    d, e, f = out, after - mix * out, end - mix * after + outer * out
    # Second differences about the four points in the middle.
    before_2, near, far, after_2 = c - 2 * b + a, d - 2 * c + b, e - 2 * d + c, f - 2 * e + d
    second = third = fourth = fifth = 0.0
    free = elastic and (two or max(first, before, last) <= FAR * hardness)
    hump = False
    if one and three:
        second, third = near, far - near
        low, high = far - 2 * near + before_2, after_2 - 2 * far + near
        hump = two and abs(low) > EQUAL * abs(third)
        deep = two and free and not hump
        wide = four and free and abs(high) <= EQUAL * abs(third)
        fourth = low if deep else high if wide else 0.0
        fifth = high - low if deep and wide else 0.0
        term = -third / 16
        term = fifth * 3 / 256 if deep and wide else fourth * 3 / 128 if deep or wide else term
    elif one:
        second, third = near, near - before_2 if two and free else 0.0
        term = -second / 8
    elif three:
        third = after_2 - far if four and free else 0.0
        second = far - third
        term = -second / 8
    # Of a contact or gap of one point the doubt is that of a parabola: it may be a crest.
    slope = d - c
    doubt = min(max(-term / slope, -ANYWHERE), ANYWHERE) if one or three else ANYWHERE
    x = -c / slope
    for _ in range(4):
        value, rate = fourth / 24 + (x + 2) * fifth / 120, fifth / 120
        value, rate = third / 6 + (x - 2) * value, value + (x - 2) * rate
        value, rate = second / 2 + (x + 1) * value, value + (x + 1) * rate
        value, rate = slope + (x - 1) * value, value + (x - 1) * rate
        value, rate = c + x * value, value + x * rate
        x = min(max(x - value / (rate if rate < 0 else slope), 0.0), 1.0)
    straight = last / (last - out) + c / slope  # a line through v, not through the polynomial's
    return x + straight, doubt, hump and elastic and before > max(first, last)


@inner
def _edges(
    first: float, before: float, last: float, out: float, after: float, hardness: float
) -> tuple[bool, bool]:
    """Return if a front is at a step, where the gap jumps; at a kink, where p rises ever faster."""
    elastic, carried = last < hardness, first > 0 and before > 0 and after <= 0
    step = last - out > STEP * max(before - last, out - after)
    step = step and (not elastic or 0 < before < last or carried)
    return step, elastic and first > 0 and last - before > max(before - first, 0.0)


@inner
def _closing(near: float, middle: float, far: float) -> float:
    """The distance from the first of three points to the zero of their gaps' parabola, up to 1."""
    bend = (far - 2 * middle + near) / 2
    slope = middle - near - bend
    if slope <= 0:
        return 1.0
    square = max(slope * slope - 4 * bend * near, 0.0)
    return float(min(2 * near / (slope + math.sqrt(square)), 1.0))


@compiled
def release(fallen: float, u: float) -> float:
    """How far a front has come off the edge of a flattened spot, in spacings.

    fallen: what the pressure of the last point has lost since it flowed, by the hardness; u: width
    of the strip between flow and open gap at the peak of the load, as of `grid`, below 1.  In the
    continuum this strip has the width d and the pressure H (2/pi) arcsin sqrt(s/d).  Unloading
    takes K/sqrt(s) off, or all of it up to a front at x, where K is the integral over the strip of
    (2/pi) sqrt(x - a) dp(a): Dugdale's x = (pi K/2 H)^2 for a step, and d/2 more for a narrow
    strip, of which little is left at first.  By the factorisation, K is fallen sqrt(e)/pi.
    """
    strip, k = 2 * math.exp(-1 - math.e * (1 / u - 1)), fallen * math.sqrt(math.e) / math.pi
    far = strip / 2 + (math.pi * k / 2) ** 2
    return RELEASE * float(min(math.pi * k * math.sqrt(strip), far) if k * k < strip / 4 else far)
