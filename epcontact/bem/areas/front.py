"""Where a front is: its place between two grid points, exact for a straight front along the grid.

Between apart and elastic points the discrete problem on the half-line is solved by a Wiener-Hopf
factorisation S_- S_+ of the compliance 2/(E* |q|), |q| < pi/dx.  In the continuum the pressure
times the root of the distance from the front is a polynomial q(x) that vanishes at the front.  On
the grid the pressure inside is (1/S_+) q and the gap outside is -S_- q.  Let x count points from
the last in contact outwards, p_0, p_1, ... be the pressures from there inwards, and g_1, g_2, ...
the gaps outwards.  With c = pi E*/(2 e dx), b = Si(pi)/pi and d = Si(2 pi)/(2 pi)

    q(0) = p_0,  q(-1) = p_1 + b p_0,  q(-2) = p_2 + b p_1 + (b^2/2 + d) p_0  (to a common factor),
    q(1) = -c g_1,  q(2) = -c (g_2 - b g_1),  q(3) = -c (g_3 - b g_2 + (b^2/2 - d) g_1).

The front is AXIS_OFFSET dx short of the root, between 0 and 1, of the polynomial through those of
the six values that this contact and this gap have, exactly up to the fifth order in dx.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba

from epcontact.bem.workers import OPTIONS, compiled
from epcontact.results import FloatArray

#: Offset of a front along an axis, in dx: 1/4 - 1/(2 pi) int_0^{pi/2} (cot t/t - cot^2 t) dt.
AXIS_OFFSET = 0.190009285925947
#: STIFFNESS is c in E*/dx; MIX is b, INNER is b^2/2 + d and OUTER b^2/2 - d.
STIFFNESS = math.pi / (2 * math.e)
MIX, INNER, OUTER = 0.5894898722360835, 0.3994549881295272, -0.05195667866061313
#: Standard deviation of the place of a front of which only the link is known.
ANYWHERE = 1 / math.sqrt(12)
#: A step is where p - c g changes by this multiple of its changes on both sides (3 to 12 do).
STEP = 6.0
#: At a kink the gap's parabola closes KINK p/(p + c g) spacings too far out (`rim.calibrate_kink`).
KINK = 0.13

#: Compiles a function into its caller: to hand over arrays takes as long as the work.
inner = numba.njit(**OPTIONS, no_cpython_wrapper=True, forceinline=True, _nrt=False)


class Link(NamedTuple):
    """What is found on a link between two points that a front crosses, in spacings."""

    place: float  # of the root of q from the point inside; 1/2 where a step holds the front
    doubt: float  # by how much the last term of the polynomial moves it outwards: it may be there
    held: float  # 1 if a step of the surface holds the front: any place is equally likely
    zone: float  # width of the zone at an edge that must be plastic, but shows no point
    kinked: float  # 1 at a kink, and where the point inside has flowed before
    fallen: float  # what the last point has lost since it flowed, over the hardness; 0 elsewhere
    steeper: float  # by what share v is steeper than on the link inside; 0 if it does not rise on


@compiled
def release(fallen: float, u: float) -> float:
    """How far a front has come off the edge of a flattened spot, in spacings.

    fallen: as of `Link`; u: width of the strip at the peak load, at most 1.  In the continuum it is
    d = 4/pi exp(e (1 - 1/u) - gamma) wide and has the pressure H (2/pi) arcsin sqrt(s/d).  A fall
    takes K/sqrt(s) off, or all of it up to x, where K = fallen sqrt(e)/pi H is the integral over
    the strip of (2/pi) sqrt(x - a) dp(a).  Both ends are expanded in k = pi K/(H sqrt d).
    """
    strip, square = 4 / math.pi * math.exp(math.e * (1 - 1 / u) - 0.577216), math.e * fallen**2
    k = math.sqrt(square / max(strip, 1e-300))
    if k < 4 / math.pi:
        return strip * k * (1 - k / 8 - 0.0342 * k * k)
    return strip / 2 + square / 4 + strip**2 / (8 * square)


@inner
def crease(a: float, b: float, centre: float, d: float, e: float) -> tuple[float, float]:
    """(half-width, shift towards b) in spacings of the gap at a kink of the surface, or zeros.

    a to e: p - c g of five points, of which the centre may be apart.  In the continuum p falls
    to P + k ln s at a kink, and to k arccosh(s/w) beside a gap of half-width w, which is the same
    far away if w = 2 exp(-P/k).  On the grid p of a kink at a point is P + k (ln .1033, 0.197,
    0.664) at 0, 1 and 2 spacings, and that of a kink between two points is the mean of theirs.  A
    gap at the centre changes p there by c g e/2 and beside it by -c g 2 e/pi^2.
    """
    if centre < 0:
        b, d = b - 2 * math.e / math.pi**2 * centre, d - 2 * math.e / math.pi**2 * centre
        centre *= math.e / 2
    lean = abs(b - d)
    k = (b + d - 2 * centre + 2.363 * lean) / 4.935
    bend = centre + (a - 2 * b if b > d else e - 2 * d)  # -k to -2 k at a kink, positive if smooth
    if min(b, d) < centre or bend > lean / 2.935 - k:
        return 0.0, 0.0
    half = 0.20655 * math.exp((0.841 * lean - centre) / k)
    return (half, (d - b) / (2.935 * k)) if half < 1 else (0.0, 0.0)


@inner
def wedge(hardness: float, load: float, near: Any, far: Any) -> float:
    """Width of the plastic ridge of a wedge whose load one point carries, in spacings, or 0.

    near, far: -c g of the points beside it, which it has moved by 1.05 and 1.55 dx p/E*.  Between
    them both sides have their slopes t, wherever the ridge is; a round crest opens thrice as much
    there.  The ridge is theta_4(exp(-pi E* t/2H))^2 times as wide as its load at the hardness H.
    """
    one, other = 0.29 * load + near[0] - far[0], 0.29 * load + near[1] - far[1]
    rounded = one + other > 1.5 * (1.213 * load - near[0] - near[1])
    if rounded or max(near[0], near[1]) > 0 or min(one, other) <= 0:
        return 0.0
    nome = math.exp(-math.pi / 2 * math.sqrt(one * other) / (hardness * STIFFNESS))
    return load / hardness * max(1 - 2 * nome, 0.0) ** 2


@compiled
def locate(values: FloatArray, count: int, hardness: float, found: Any) -> None:
    """Find the `Link` between the third of six points, which is inside, and the fourth; of many.

    values: (10, n), v of `grid` at the six points; flow, 0 where the third has not flowed before,
    -1 where both have, else 1, by `fallen` more at an edge; memory; the hardness.  found: records.
    """
    _roots(values, count)
    for n in range(count):
        first, before, last, out = values[0, n], values[1, n], values[2, n], values[3, n]
        after, end, flow, place = values[4, n], values[5, n], values[6, n], values[7, n]
        elastic, gap, link = last < hardness, after <= 0, found[n]
        link.doubt = link.held = link.zone = link.kinked = link.fallen = link.steeper = 0.0
        if flow > 1:  # at the peak by the polynomial, far below it by the line
            fallen, line = flow - 1, last / (last - out)
            link.place = min(max(place + fallen * (line - place), 0.0), 1.0)
            link.doubt, link.fallen = (1 - fallen) * values[8, n], fallen
            continue
        if elastic and first > before > last:
            link.steeper = (last - out) / (before - last) - 1
        if flow == 0 and elastic and 0 < after < hardness:
            half, shift = crease(before, last, out, after, end)
            if half > 0:
                link.place, link.kinked = 1 - half - shift + AXIS_OFFSET, 1.0
                continue
        step = last - out > STEP * max(before - last, out - after) and (
            not elastic or 0 < before < last or (first > 0 and before > 0 and gap)
        )
        kink = elastic and first > 0 and last - before > max(before - first, 0.0)
        held, away = step and (place < 0.5 or not elastic), 1.0
        if kink and not held:  # the gap's parabola (a line without `end`) closes so far from `out`
            bend = ((-end if end <= 0 else out - 2 * after) + 2 * after - out) / 2
            rise = out - after - bend
            if gap and rise > 0:
                root = math.sqrt(max(rise * rise + 4 * bend * out, 0.0))
                away = min(-2 * out / (rise + root), 1.0)
            held = away >= 1
        if (step or kink) and elastic:  # a singular pressure, or one that rises as a logarithm
            at_step = (math.pi / 4 * last / hardness) ** 2
            link.zone = at_step if step else 3 ** ((last - hardness) / (last - before))
        if held:
            link.place, link.held = 0.5, 1.0
            continue
        if kink:
            place = 1 - away - KINK * last / (last - out) + AXIS_OFFSET
        link.place, link.doubt = min(max(place, 0.0), 1.0), values[8, n]
        link.kinked = 1.0 if kink or flow > 0 else 0.0


@inner
def _roots(values: FloatArray, count: int) -> None:
    """Fill the memory with place and doubt of smooth fronts, by the polynomial.

    It is q0 + x (t1 + (x - 1) (t2 + (x + 1) (t3 + (x - 2) (t4 + (x + 2) t5)))), Newton's, less the
    factors of points that this contact and this gap do not have.  The outermost are left out where
    they would move the front more than the fourth term does.  Two steps of Halley's from the line's
    root err less than the root, on all kinds.  Without branches many links are found at once.
    """
    for n in range(count):
        first, before, last = values[0, n], values[1, n], values[2, n]
        out, after, end, hardness = values[3, n], values[4, n], values[5, n], values[9, n]
        elastic, gap = last < hardness, (after <= 0) & (values[6, n] >= 0)
        mix, inside, outside = MIX * elastic, INNER * elastic, OUTER * elastic
        less = 0.0 if elastic else hardness
        within = (before > 0) & (before < hardness)
        contact = within if elastic else before >= hardness
        deep = within & elastic & (first > 0) & (first < hardness)
        q0, t1 = last - less, out - last + less
        t2 = (t1 + before + (mix - 1) * last) / 2 if contact else 0.0
        t3 = ((after - mix * out - q0) / 2 - t1 - t2) / (3.0 if contact else 1.0) if gap else 0.0
        t4 = t2 - ((first + mix * before + (inside - 1) * last) / 2 + t1) / 3
        t4 = (t3 - t4) / 4 if gap else t4
        t5 = ((end - mix * after + outside * out - q0) / 3 - t1) / 8 - t2 / 4 - t3
        # What terms add in the middle of the link.
        third = t3 * (-0.375 if contact else -0.25)
        fourth = t4 * (0.5625 if gap else -0.375)
        far = deep & ((abs(fourth) <= abs(third)) | (not gap))
        t4 = t4 if far else 0.0
        t5 = (t5 - t4) / 5 if far else t5
        fifth = t5 * (1.40625 if far else 0.5625)
        farther = deep & gap & (end <= 0) & (abs(fifth) <= abs(third))
        t5 = t5 if farther else 0.0
        known = third if gap else -t2 / 4
        known = fourth if gap & far else known
        known = fifth if farther else known
        known = min(max(-known / t1, -ANYWHERE), ANYWHERE) if contact | gap else ANYWHERE
        hump = deep & (not far) & (before > max(first, last))  # behind it may be a kink
        values[8, n], x = -KINK if hump else known, -q0 / t1
        for _ in range(2):
            value, rate, bend = _nested(t4, x + 2, far, t5, 0.0, 0.0)
            value, rate, bend = _nested(t3, x - 2, gap, value, rate, bend)
            value, rate, bend = _nested(t2, x + 1, contact, value, rate, bend)
            value, rate, bend = _nested(t1, x - 1, True, value, rate, bend)
            value, rate, bend = _nested(q0, x, True, value, rate, bend)
            steep = min(rate - value * bend / rate, rate / 2) if rate < 0 else t1
            x = min(max(x - value / steep, 0.0), 1.0)
        values[7, n] = x + last / (last - out) + q0 / t1


@inner
def _nested(
    term: float, away: float, known: bool, value: float, rate: float, bend: float
) -> tuple[float, float, float]:
    """Value, slope and half of the second derivative of a polynomial with one factor more."""
    more = term + away * value, value + away * rate, rate + away * bend
    return more if known else (value, rate, bend)
