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
import numpy as np

from epcontact.bem.workers import OPTIONS, compiled
from epcontact.results import FloatArray

#: Offset of a front along an axis, in dx: 1/4 - 1/(2 pi) int_0^{pi/2} (cot t/t - cot^2 t) dt.
AXIS_OFFSET = 0.190009285925947
#: STIFFNESS is c in E*/dx; MIX is b, INNER is b^2/2 + d and OUTER b^2/2 - d.
STIFFNESS = math.pi / (2 * math.e)
MIX, INNER, OUTER = 0.5894898722360835, 0.3994549881295272, -0.05195667866061313
#: Places of the points in the order in which the polynomial takes them, and inverse distances.
NODES = np.array([0.0, 1.0, -1.0, 2.0, -2.0, 3.0])
INVERSE = 1 / (NODES[:, None] - NODES + np.eye(6))
#: Standard deviation of the place of a front of which only the link is known.
ANYWHERE = 1 / math.sqrt(12)
#: A step is where p - c g changes by this multiple of its changes on both sides (3 to 12 do).
STEP = 6.0
#: At a kink the gap's parabola closes KINK p/(p + c g) spacings too far out (`rim.calibrate_kink`).
KINK = 0.13
#: An edge of a flattened spot is one where the strip beside it was below this width (`area_bank`).
EDGE = 0.75

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


@compiled
def release(fallen: float, u: float) -> float:
    """How far a front has come off the edge of a flattened spot, in spacings.

    fallen: as of `Link`; u: width of the strip between flow and open gap at the peak of the load,
    as of `grid`, below 1.  In the continuum this strip has the width d = 4/pi exp(e (1 - 1/u) -
    gamma) and the pressure H (2/pi) arcsin sqrt(s/d).  Unloading takes K/sqrt(s) off, or all of it
    up to x, where K = fallen sqrt(e)/pi H is the integral over the strip of (2/pi) sqrt(x - a)
    dp(a).  Both ends are expanded in k = pi K/(H sqrt d).  (`rim.calibrate_release`)
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
    bend = (
        a - 2 * b if b > d else e - 2 * d
    ) + centre  # -k to -2 k at a kink, positive where smooth
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
def locate(work: FloatArray, sunk: float, hardness: float, yielded: float) -> Link:
    """Find the `Link` between the third of six points, which is inside, and the fourth.

    work: (4, 6) memory that begins with v of `grid`; sunk: c w where flow has lowered the third by
    w and the fourth never, negative where it has lowered both; yielded: the hardness of that flow.
    Unloading has taken the same from both beside a steep edge: the place there is that of the peak.
    """
    first, before, last, out, after, end = work[0]
    slope, elastic = last + sunk - out, last < hardness
    if sunk > 0 and EDGE * slope > yielded:
        return Link(min((yielded + sunk) / slope, 1.0), 0.0, 0.0, 0.0, 0.0, 1 - last / yielded)
    gap = after <= 0
    if sunk == 0 and elastic and 0 < after < hardness:
        half, shift = crease(before, last, out, after, end)
        if half > 0:
            return Link(1 - half - shift + AXIS_OFFSET, 0.0, 0.0, 0.0, 1.0, 0.0)
    step = last - out > STEP * max(before - last, out - after) and (
        not elastic or 0 < before < last or (first > 0 and before > 0 and gap)
    )
    kink = elastic and first > 0 and last - before > max(before - first, 0.0)
    place, doubt = _root(work, hardness, gap and sunk >= 0)
    held, away, zone = step and (place < 0.5 or not elastic), 1.0, 0.0
    if kink and not held:  # the gap's parabola (a line without `end`) closes so far from `out`
        bend = ((-end if end <= 0 else out - 2 * after) + 2 * after - out) / 2
        rise = out - after - bend
        if gap and rise > 0:
            away = min(-2 * out / (rise + math.sqrt(max(rise * rise + 4 * bend * out, 0.0))), 1.0)
        held = away >= 1
    if (step or kink) and elastic:  # a singular pressure, or one that rises as a logarithm
        at_step = (math.pi / 4 * last / hardness) ** 2
        zone = at_step if step else 3 ** ((last - hardness) / (last - before))
    if held:
        return Link(0.5, 0.0, 1.0, zone, 0.0, 0.0)
    if kink:
        place = 1 - away - KINK * last / (last - out) + AXIS_OFFSET
    return Link(min(max(place, 0.0), 1.0), doubt, 0.0, zone, 1.0 if kink or sunk > 0 else 0.0, 0.0)


@inner
def _root(work: FloatArray, hardness: float, gap: bool) -> tuple[float, float]:
    """(place, doubt) by the polynomial.

    It is Newton's, from the points beside the front outwards, for the pressure or, if no point is
    in the strip, the gap.  The outermost points are left out where they would move the front more
    than the fourth term does; if the pressure then peaks before its last point, a kink may move the
    front inwards.  Two steps of Halley's from the line's root err less than the root, on all kinds.
    """
    first, before, last, out, after, end = work[0]
    elastic = last < hardness
    mix, inner, outer, less = (MIX, INNER, OUTER, 0.0) if elastic else (0.0, 0.0, 0.0, hardness)
    contact = 0 < before < hardness if elastic else before >= hardness
    deep = elastic and contact and 0 < first < hardness
    q, terms, known = work[1], work[2], work[3]
    q[0], known[0], q[1], known[1] = last - less, 1.0, out, 1.0
    q[2], known[2] = before + mix * last - less, contact
    q[3], known[3] = after - mix * out, gap
    q[4], known[4] = first + mix * before + inner * last - less, deep
    q[5], known[5] = end - mix * after + outer * out, deep and gap and end <= 0
    found, doubt, limit, shift, hump = 0, 0.0, 0.0, 1.0, False
    for k in range(6):
        if known[k] == 0:
            continue
        value = q[k]
        for m in range(k):
            value = (value - terms[m]) * INVERSE[k, m] if known[m] else value
        term = value * shift  # what it adds in the middle of the link
        limit = abs(term) if found <= 3 else limit
        if abs(term) > limit:
            known[k], hump = 0.0, hump or (k == 4 and before > max(first, last))
            continue
        if found == 2 or (contact and gap):
            doubt = term
        terms[k], found, shift = value, found + 1, shift * (0.5 - NODES[k])
    x, slope = q[0] / (q[0] - out), out - q[0]
    doubt = min(max(-doubt / slope, -ANYWHERE), ANYWHERE) if found > 2 else ANYWHERE
    doubt = -KINK if hump else doubt
    for _ in range(2):
        value = rate = bend = 0.0
        for k in range(5, -1, -1):
            if known[k]:
                away = x - NODES[k]
                value, rate, bend = terms[k] + away * value, value + away * rate, rate + away * bend
        steep = min(rate - value * bend / rate, rate / 2) if rate < 0 else slope
        x = min(max(x - value / steep, 0.0), 1.0)
    return x + last / (last - out) + q[0] / slope, doubt
