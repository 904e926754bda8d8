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
exact up to the fifth order in dx, as the magnitude of S has no further terms.  In a narrow contact
near the cap (FAR) only four values are used.

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
#: Only four points locate a front of a contact of fewer than three points that carries more than
#: this share of the hardness: it hides a plastic spot, and with four points the errors of the two
#: fronts cancel in the elastic area (fit of `error_bars`).
FAR = 0.1
#: Standard deviation of the place of a front of which only the link is known.
ANYWHERE = 1 / math.sqrt(12)
#: Release of a front by that of a straight one along the grid: .87 for straight ones of all
#: directions (`rim.calibrate_release`), .5 to .8 on rough surfaces (`area_bank`).
RELEASE = 0.75
#: An edge of a flattened spot is one where the strip beside it was below this width.
EDGE = 0.75
#: Doubt of the place of a front at the edge of a flattened spot (`area_bank`).
RELEASED = 0.05
#: A gap that changes between two points by more than this multiple of its changes beside them has
#: a step there (fit of `error_bars`, which tells little between 3 and 12).
STEP = 6.0
#: At a kink the parabola of the gap closes too far out, by KINK times p/(p + c g) spacings, with p
#: and g on either side of the front (`rim.calibrate_kink`).
KINK = 0.13

#: Compiles a function of this room; nothing calls one from C.
compiled = numba.njit(cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True)

#: Compiles a function with the one that calls it, which takes less time.
inlined = numba.njit(nogil=True, error_model="numpy", inline="always")


class Links(NamedTuple):
    """Links that a front crosses, and what `locate` finds on each, in spacings."""

    #: (6, n) v at six points in a row: the front is between the third, which is inside, and the
    #: fourth.  For the plastic front v is hardness - v.
    values: FloatArray
    place: FloatArray  # of the front from the third point, 0 to 1; 1/2 where a step holds it
    held: FloatArray  # 1 if a step of the surface holds the front: any place is equally likely
    hidden: FloatArray  # width of the zone at an edge that must be plastic, but shows no point
    #: By how much the last term of the polynomial moves the middle of the link, outwards if
    #: positive: the front may be elsewhere by as much.
    doubt: FloatArray
    kinked: FloatArray  # 1 where the surface has a kink at the front or close behind it
    #: c w where a flattened spot ends at the front: w is what flow has lowered the third point by,
    #: and the fourth has never flowed; else 0.
    depth: FloatArray
    released: FloatArray  # what the pressure of the third point has lost since, by the hardness


@compiled
def empty_links(n: int) -> Links:
    """Memory for n links."""
    found = np.zeros((7, n))
    return Links(
        np.empty((6, n)), found[0], found[1], found[2], found[3], found[4], found[5], found[6]
    )


@compiled
def locate(links: Links, count: int, hardness: float, yielded: float) -> None:
    """Find where the first `count` links are crossed.  Where a kink is behind the front, the
    pressure has its peak at the last point but one, and the value before that is left out.  Without
    branches, a processor does several links at a time."""
    terms, roots, v = np.empty((6, count)), np.empty(count), links.values
    for n in range(count):
        first, before, last, out, after, end = v[0, n], v[1, n], v[2, n], v[3, n], v[4, n], v[5, n]
        step, kink = _edges(first, before, last, out, after, hardness)
        # The polynomial is that of the pressure, or, if no point is in the strip, of the gap.
        elastic = last < hardness
        mix, inner, outer, less = (MIX, INNER, OUTER, 0.0) if elastic else (0.0, 0.0, 0.0, hardness)
        one = (before > 0) & (before < hardness) if elastic else before >= hardness
        two = (first > 0) & (first < hardness) if elastic else first >= hardness
        q_0, q_3 = first + mix * before + inner * last - less, after - mix * out
        q_1, q_2, q_4 = before + mix * last - less, last - less, end - mix * after + outer * out
        q, inside = (q_0, q_1, q_2, out, q_3, q_4), one * (1 + two)
        outside, slope = (after <= 0) * (1 + (end <= 0)), out - q_2
        outside *= links.depth[n] >= 0
        free = elastic & ((inside == 2) | (max(first, before, last) <= FAR * hardness))
        second, third, fourth, fifth, term, left = _differences(q, inside, outside, free)
        terms[0, n], terms[1, n], terms[2, n] = q_2, slope, second / 2
        terms[3, n], terms[4, n], terms[5, n] = third / 6, fourth / 24, fifth / 120
        doubt = min(max(-term / slope, -ANYWHERE), ANYWHERE)
        links.doubt[n] = doubt if inside + outside > 0 else ANYWHERE
        links.kinked[n] = 1.0 if left & elastic & (before > max(first, last)) else 0.0
        links.held[n] = 1.0 if step | kink else 0.0
    _solve(terms, roots)
    for n in range(count):
        shift = roots[n] + terms[0, n] / terms[1, n]  # to the root from that of a straight line
        root = v[2, n] / (v[2, n] - v[3, n]) + shift
        links.place[n], links.hidden[n] = min(max(root, 0.0), 1.0), 0.0
        links.released[n], slope = 0.0, v[2, n] + links.depth[n] - v[3, n]
        links.depth[n] *= (EDGE * slope > yielded) | (links.depth[n] < 0)
        if links.depth[n] > 0:
            links.place[n] = min((yielded + links.depth[n]) / slope, 1.0)
            links.released[n] = 1 - v[2, n] / yielded
            links.held[n] = links.kinked[n] = 0.0
            links.doubt[n] = RELEASED
        elif links.held[n] > 0:
            _place_at_edge(links, n, hardness)


@inlined
def _differences(
    q: tuple[float, float, float, float, float, float], inside: int, outside: int, free: bool
) -> tuple[float, float, float, float, float, bool]:
    """(second to fifth differences, last term, whether q(-2) is left out) of a polynomial.

    q: at -2 to 3; inside, outside: how many of the two values on either side there are; free:
    whether to use the outermost of them.  These may belong to another part of the surface: they are
    left out where the term of the fourth difference exceeds that of the third.
    """
    # Second differences about -1, 0, 1 and 2.
    first, near = q[2] - 2 * q[1] + q[0], q[3] - 2 * q[2] + q[1]
    far, last = q[4] - 2 * q[3] + q[2], q[5] - 2 * q[4] + q[3]
    both, inner, outer = (inside > 0) & (outside > 0), far - 2 * near + first, last - 2 * far + near
    left = both & (inside > 1) & (abs(inner) > EQUAL * abs(far - near))
    deep = both & (inside > 1) & free & (not left)
    wide = both & (outside > 1) & free & (abs(outer) <= EQUAL * abs(far - near))
    more = (inside + outside > 1) & free  # than a parabola, on one side
    third = near - first if inside > 1 else last - far
    third = third if more else 0.0
    third = far - near if both else third
    second = near if inside > 0 else far - third if outside > 0 else 0.0
    fourth = inner if deep else outer if wide else 0.0
    fifth = outer - inner if deep & wide else 0.0
    # Of a contact or gap of one point the doubt is that of a parabola: it may be a crest.
    term = -third / 16 if both else -second / 8
    term = fifth * 3 / 256 if deep & wide else fourth * 3 / 128 if deep | wide else term
    return second, third, fourth, fifth, term, left


@compiled
def _edges(
    first: float, before: float, last: float, out: float, after: float, hardness: float
) -> tuple[bool, bool]:
    """Return if a front is at a step, where the gap jumps; at a kink, where p rises ever faster."""
    elastic, carried = last < hardness, (first > 0) & (before > 0) & (after <= 0)
    step = last - out > STEP * max(before - last, out - after)
    step &= (not elastic) | (before > 0) & (before < last) | carried
    kink = elastic & (first > 0) & (last - before > max(before - first, 0.0))
    return step, kink


@compiled
def _solve(terms: FloatArray, roots: FloatArray) -> None:
    """Roots between 0, where the polynomials are positive, and 1, where they are not.

    terms: (6, n) of q(0) + x (slope + (x - 1) (second/2 + (x + 1) (third/6 + (x - 2) (fourth/24 +
    (x + 2) fifth/120)))).
    """
    low, high = np.zeros(len(roots)), np.ones(len(roots))
    for n in range(len(roots)):
        roots[n] = -terms[0, n] / terms[1, n]
    for _ in range(20):
        moving = 0
        for n in range(len(roots)):
            x = roots[n]
            value, rate = terms[4, n] + (x + 2) * terms[5, n], terms[5, n]
            value, rate = terms[3, n] + (x - 2) * value, value + (x - 2) * rate
            value, rate = terms[2, n] + (x + 1) * value, value + (x + 1) * rate
            value, rate = terms[1, n] + (x - 1) * value, value + (x - 1) * rate
            value, rate = terms[0, n] + x * value, value + x * rate
            low[n] = x if value > 0 else low[n]
            high[n] = high[n] if value > 0 else x
            new = x - value / rate
            inside = (rate < 0) & (low[n] <= new) & (new <= high[n])
            roots[n] = new if inside else (low[n] + high[n]) / 2
            moving += abs(roots[n] - x) > 1e-5
        if moving == 0:
            break


@compiled
def _place_at_edge(links: Links, n: int, hardness: float) -> None:
    """Place a front at a step, or at a kink, where the parabola of the gap closes, but for KINK.

    There may be a plastic zone between the last point and the edge.  At a step the mean of
    K/sqrt(distance) over the last spacing is 2 K, and Dugdale's zone is (pi^2/4) K^2/H^2 wide.  At
    a kink the pressure grows as the logarithm of the distance does from 3/2 to 1/2 of a spacing.
    Capped, H - k ln s becomes H - k arcosh(s/w), and the zone is twice as wide as that in which the
    elastic pressure exceeds the hardness.
    """
    v = links.values
    first, before, last, out, after, far = v[0, n], v[1, n], v[2, n], v[3, n], v[4, n], v[5, n]
    step, kink = _edges(first, before, last, out, after, hardness)
    held, away = step and (links.place[n] < 0.5 or last >= hardness), 1.0
    if kink and not held:
        if after <= 0:
            away = _closing(-out, -after, -far if far <= 0 else out - 2 * after)
        held = away >= 1
    if last < hardness:
        at_kink = 3 ** ((last - hardness) / (last - before))
        links.hidden[n] = (math.pi / 4 * last / hardness) ** 2 if step else at_kink
    links.held[n] = 1.0 if held else 0.0
    if held:
        links.place[n], links.doubt[n], links.kinked[n] = 0.5, 0.0, 0.0
    elif kink:
        root = 1 - away - KINK * last / (last - out) + AXIS_OFFSET
        links.place[n], links.doubt[n], links.kinked[n] = min(max(root, 0.0), 1.0), 0.0, 1.0


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


@compiled
def _closing(near: float, middle: float, far: float) -> float:
    """The distance from the first of three points to the zero of their gaps' parabola, up to 1."""
    bend = (far - 2 * middle + near) / 2
    slope = middle - near - bend
    if slope <= 0:
        return 1.0
    square = max(slope * slope - 4 * bend * near, 0.0)
    return float(min(2 * near / (slope + math.sqrt(square)), 1.0))
