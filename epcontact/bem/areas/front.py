"""Where a front is: its place between two grid points, by what is exact for fronts
along the grid.

Between apart and elastic points the discrete problem on the half-line is solved by a
Wiener-Hopf factorisation S_- S_+ of the compliance 2/(E* |q|), |q| < pi/dx.  In the
continuum the pressure times the root of the distance from the front is a polynomial
q(x) that vanishes at the front.  On the grid the pressure inside is (1/S_+) q and the
gap outside is -S_- q.  Let x count points from the last in contact outwards, p_0, p_1,
... be the pressures from there inwards, and g_1, g_2, ... the gaps outwards.  With c =
pi E*/(2 e dx) and b = Si(pi)/pi, to a common factor,

    q(-2) = p_2 + b p_1 + (b^2/2 + Si(2 pi)/(2 pi)) p_0,  q(-1) = p_1 + b p_0,  q(0) = p_0,
    q(1) = -c g_1,  q(2) = -c (g_2 - b g_1).

The front is AXIS_OFFSET dx short of the root, between 0 and 1, of the cubic through the
last four, or of the polynomial through those that this contact and this gap have.
Where q falls at once, beyond an edge of the surface, the parabola through the first
three has the root, because what is cut away outside a contact does not change it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba

from epcontact.bem.workers import OPTIONS, compiled
from epcontact.results import FloatArray

#: Offset of a front along an axis, in dx: 1/4 - 1/(2 pi) int_0^{pi/2} (cot t/t - cot^2
#: t) dt.
AXIS_OFFSET = 0.190009285925947
#: STIFFNESS is c in E*/dx; MIX is b and INNER the factor of p_0 in q(-2).
STIFFNESS = math.pi / (2 * math.e)
MIX, INNER = 0.5894898722360835, 0.3994549881295272
#: Standard deviation of the place of a front of which only the link is known.
ANYWHERE = 1 / math.sqrt(12)
#: A step is where p - c g changes by this multiple of its changes on both sides (3 to
#: 12 do).
STEP = 6.0

#: Compiles a function into its caller: to hand over arrays takes as long as the work.
inner = numba.njit(**OPTIONS, no_cpython_wrapper=True, forceinline=True, _nrt=False)


class Links(NamedTuple):
    """What is found on links (n,) between two points that a front crosses, in
    spacings.
    """

    place: FloatArray  # of the root of q from the point inside; 1/2 where the front is held
    doubt: FloatArray  # how far out it may be instead: what the polynomial's last term moves it by
    held: FloatArray  # 1 if a step or an edge holds the front: any place is equally likely
    zone: FloatArray  # width of the zone at an edge that must be plastic, but shows no point
    kinked: FloatArray  # 1 at a kink, beside an edge, and beside old flow that is not `fallen`
    fallen: FloatArray  # what the last point has lost since it flowed, over the hardness, or 0
    steeper: FloatArray  # by what share v is steeper than on the link inside, or 0 if it is not


@inner
def width(u: float) -> float:
    """Width in the continuum of a strip that is u spacings, at most 1, wide by its
    gradient.
    """
    return 4 / math.pi * math.exp(math.e * (1 - 1 / u) - 0.577216)  # Euler's gamma


@inner
def release(fallen: float, strip: float) -> float:
    """How far a front has come off the edge of a flattened spot, in spacings.

    fallen: as of `Links`; strip: d, its `width`.  In the continuum the pressure there
    was H (2/pi) arcsin sqrt(s/d).  A fall takes K/sqrt(s) off, or all of it up to x,
    where K = fallen sqrt(e)/pi H is the integral over the strip of (2/pi) sqrt(x - a)
    dp(a).  Both ends are expanded in k = pi K/(H sqrt d).
    """
    square = math.e * fallen**2
    k = math.sqrt(square / max(strip, 1e-300))
    if k < 4 / math.pi:
        return strip * k * (1 - k / 8 - 0.0342 * k * k)
    return strip / 2 + square / 4 + strip**2 / (8 * square)


@inner
def crease(
    a: float, b: float, centre: float, d: float, e: float
) -> tuple[float, float]:
    """(half-width, shift towards b) in spacings of the gap at a kink of the surface, or
    zeros.

    a to e: p - c g of five points, of which the centre may be apart.  In the continuum
    p falls to P + k ln s at a kink, and to k arccosh(s/w) beside a gap of half-width w,
    which is the same far away if w = 2 exp(-P/k).  On the grid p of a kink at a point
    is P + k (ln .1033, 0.197, 0.664) at 0, 1 and 2 spacings, and that of a kink between
    two points is the mean of theirs.  A gap at the centre changes p there by c g e/2
    and beside it by -c g 2 e/pi^2.
    """
    if centre < 0:
        b, d = (
            b - 2 * math.e / math.pi**2 * centre,
            d - 2 * math.e / math.pi**2 * centre,
        )
        centre *= math.e / 2
    lean = abs(b - d)
    k = (b + d - 2 * centre + 2.363 * lean) / 4.935
    bend = centre + (
        a - 2 * b if b > d else e - 2 * d
    )  # -k to -2 k at a kink, positive if smooth
    if min(b, d) < centre or bend > lean / 2.935 - k:
        return 0.0, 0.0
    half = 0.20655 * math.exp((0.841 * lean - centre) / k)
    return (half, (d - b) / (2.935 * k)) if half < 1 else (0.0, 0.0)


@inner
def wedge(
    hardness: float, a: float, b: float, centre: float, d: float, e: float
) -> float:
    """Width of the plastic ridge of a wedge whose load one point carries, in spacings,
    or 0.

    a to e: p - c g of five points, of which b and d are plastic and the centre is
    elastic.  The load has moved b and d by 1.05 and a and e by 1.55 dx p/E*, so that
    between them both sides have their slopes t, wherever the ridge is; a round crest
    opens thrice as much there.  The ridge is theta_4(exp(-pi E* t/2H))^2 times as wide
    as its load at the hardness H.
    """
    load = hardness - centre
    one, other = 0.29 * load + a - b, 0.29 * load + e - d
    if (
        one + other > 1.5 * (1.213 * load + b + d - 2 * hardness)
        or min(one, other) <= 0
    ):
        return 0.0
    nome = math.exp(-math.pi / 2 * math.sqrt(one * other) / (hardness * STIFFNESS))
    return load / hardness * max(1 - 2 * nome, 0.0) ** 2


@inner
def inside(first: float, before: float, last: float) -> tuple[float, float]:
    """By how much q falls from the point before to the last one, and how much more than
    before.
    """
    fall = before + (MIX - 1) * last
    return fall, fall - (first + (MIX - 1) * before + (INNER - MIX) * last)


@inner
def vanishes(value: float, fall: float, bend: float) -> float:
    """Where value - fall x - bend x^2 first vanishes, at most 1."""
    root = math.sqrt(max(fall * fall + 4 * bend * value, 0.0))
    return min(2 * value / (fall + root), 1.0) if fall > 0 else 1.0


@compiled
def locate(values: FloatArray, count: int, hardness: float, links: Links) -> None:
    """Find `Links` between the third of six points, which is inside, and the fourth, if
    smooth.

    values: (9, n), v of `grid` at the six points; flow, 0 where the third has not
    flowed before, -1 where both have, else 1, by `fallen` more at an edge; the hardness
    there; what to `relocate`.
    """
    place, doubt, held, zone, kinked, fallen, steeper = links
    for n in range(count):  # without branches, many are found at once
        first, before, last = values[0, n], values[1, n], values[2, n]
        out, after, flow, top = values[3, n], values[4, n], values[6, n], values[7, n]
        elastic, gap = last < top, (after <= 0) & (flow >= 0)
        mix, contact = (
            MIX * elastic,
            (before > 0) & (before < top) if elastic else before >= top,
        )
        # Newton's polynomial q0 + x (t1 + (x - 1) (t2 + (x + 1) t3)), less a factor
        # where a value is missing.
        q0 = last if elastic else last - top
        t1 = min(out - q0, -1e-150)  # 0 between a flow and a gap of 0
        t2 = (t1 + before + (mix - 1) * last) / 2 if contact else 0.0
        t3 = (
            ((after - mix * out - q0) / 2 - t1 - t2) * (1 / 3 if contact else 1.0)
            if gap
            else 0.0
        )
        # What it adds in the middle of the link, and a fifth more beside a lone point.
        known = t3 * (0.375 if contact else 0.3) if gap else t2 / 4
        known = min(max(known / t1, -ANYWHERE), ANYWHERE) if contact | gap else ANYWHERE
        # Where the pressure peaks one point inside, the front may be at a kink there,
        # so that it is AXIS_OFFSET too far out, unless the cubic through q(-2) differs
        # less in the middle of the link than the last term is large.
        drop, curve = inside(first, before, last)
        other = t2 - (drop - curve / 2 + t1) / 3
        peak = elastic & contact & gap & (first > 0) & (before > max(first, last))
        smooth = (not peak) | (abs(t3 - other) <= 8 / 3 * abs(t3))
        square, cube = (t2, t3) if contact else (t3, 0.0)
        x, slope = -q0 / t1, t1 - square - cube
        for _ in range(
            2
        ):  # steps of Halley's method: areas err as little as with the exact root
            value = q0 + x * (slope + x * (square + x * cube))
            bend = square + 3 * x * cube
            rate = slope + x * (square + bend)
            steep = max(rate * rate - value * bend, rate * rate / 2) if rate < 0 else t1
            x = min(max(x - value * (rate if rate < 0 else 1.0) / steep, 0.0), 1.0)
        # Where the last point is plastic, q tells how far the front is off the root of
        # a line in v.
        place[n] = min(max(x + last / (last - out) + q0 / t1, 0.0), 1.0)
        doubt[n] = known if smooth else -AXIS_OFFSET
        held[n], zone[n], kinked[n], fallen[n] = 0.0, 0.0, 0.0, 0.0
        elastic, fall, deeper = last < hardness, before - last, first - before
        steeper[n] = (
            (last - out) / fall - 1 if elastic & (fall > 0) & (deeper > 0) else 0.0
        )
        within = (before > 0) & ((fall < 0) | ((first > 0) & (after <= 0)))
        step = (last - out > STEP * max(fall, out - after)) & (within | (not elastic))
        kink = elastic & (first > 0) & (-fall > max(-deeper, 0.0))
        near = elastic & (flow == 0) & (after > 0) & (after < hardness)
        # Beyond an edge, q at once falls faster, by a quarter and by STEP times its
        # bend inside.
        fast = max(last - out, (1 + MIX) * out - after) > 1.25 * drop + STEP * abs(
            curve
        )
        edge = (
            fast
            & elastic
            & contact
            & gap
            & (first > 0)
            & (drop > 0)
            & (not (step | kink))
        )
        values[8, n] = step + 2 * kink + 4 * near + 8 * (flow > 0) + 16 * edge


@compiled
def relocate(values: FloatArray, count: int, hardness: float, links: Links) -> None:
    """Find again the `Links` at steps, kinks, gaps of one point, old flow and edges."""
    place, doubt, held, zone, kinked, fallen, steeper = links
    for n in range(count):
        kind, last, out, flow = (
            int(values[8, n]),
            values[2, n],
            values[3, n],
            values[6, n],
        )
        if kind == 0:
            continue
        step, kink, elastic, line = (
            kind & 1 > 0,
            kind & 2 > 0,
            last < hardness,
            last / (last - out),
        )
        if flow > 1:  # at the peak by the polynomial, far below it by the line
            fallen[n], steeper[n] = flow - 1, 0.0
            place[n] += fallen[n] * (line - place[n])
            doubt[n] *= 1 - fallen[n]
            continue
        before, after, end = values[1, n], values[4, n], values[5, n]
        if kind & 4:
            half, shift = crease(before, last, out, after, end)
            if half > 0:
                place[n], doubt[n], kinked[n] = 1 - half - shift + AXIS_OFFSET, 0.0, 1.0
                continue
        holds, away = step and (place[n] < 0.5 or not elastic), 0.0
        if (
            kink and not holds
        ):  # the gap's parabola (a line without `end`) closes so far from `out`
            bend = ((-end if end <= 0 else out - 2 * after) + 2 * after - out) / 2
            away = vanishes(-out, out - after - bend, -bend) if after <= 0 else 1.0
        if kind & 16:  # an edge
            fall, bend = inside(values[0, n], before, last)
            place[n], doubt[n] = (
                vanishes(last, fall + bend / 2, bend / 2),
                bend / 2 / fall,
            )
            away = place[n]
        if (
            step or kink or away >= 1
        ) and elastic:  # singular, or rising as a logarithm at kinks
            at_edge = (math.pi / 4 * last / hardness) ** 2
            zone[n] = (
                at_edge
                if step or not kink
                else 3 ** ((last - hardness) / (last - before))
            )
        if holds or away >= 1:
            place[n], doubt[n], held[n] = 0.5, 0.0, 1.0
            continue
        if kink:
            place[n] = min(max(1 - away + AXIS_OFFSET * (1 - line), 0.0), 1.0)
        kinked[n] = 1.0 if kind & 18 or flow > 0 else 0.0
