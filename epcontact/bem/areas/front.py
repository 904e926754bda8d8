"""Where a front is: its position between two grid points.

A front is the line around the contact, or around its plastic part.  A link joins two
neighbouring grid points on both sides of a front.

Between apart and elastic points the discrete problem on the half-line is solved by a
Wiener-Hopf factorisation S_- S_+ of the compliance 2/(E* |q|), |q| < pi/dx.  In the
continuum the pressure times the root of the distance from the front is a polynomial
q(x) that vanishes at the front.  On the grid the pressure inside is (1/S_+) q and the
gap outside is -S_- q.  Let x count points from the last in contact outwards.  p_0, p_1,
... are the pressures from there inwards, and g_1, g_2, ... the gaps outwards.  With
c = pi E*/(2 e dx) and b = Si(pi)/pi, to a common factor,

    q(-2) = p_2 + b p_1 + (b^2/2 + Si(2 pi)/(2 pi)) p_0
    q(-1) = p_1 + b p_0
    q(0)  = p_0
    q(1)  = -c g_1
    q(2)  = -c (g_2 - b g_1)

The front is AXIS_OFFSET dx inside the root, between 0 and 1, of the cubic through the
last four values, or of the polynomial through those that this contact and this gap
have.

Some fronts are not smooth, and are located by what is known of them:

* At a step of the surface the front is anywhere between the two points: it is pinned.
* At a kink the gap closes before it reaches the contact; the front is where it closes.
* Beyond an edge just outside the contact q falls at once.  The parabola through the
  first three values has the root, because what is cut away outside a contact does not
  change it.
* Between two contacts there may be a gap of one point, at the crease of two slopes
  (`hidden.crease_gap`).
* At the edge of a spot that flowed under an earlier load, the position is that at the
  peak load, and goes over to the root of a straight line while the load falls.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from epcontact.bem.areas.hidden import MIX, crease_gap, inlined
from epcontact.bem.workers import compiled
from epcontact.results import FloatArray

#: Offset of a straight front along an axis, in spacings:
#: 1/4 - 1/(2 pi) int_0^{pi/2} (cot t/t - cot^2 t) dt.
AXIS_OFFSET = 0.190009285925947
#: b^2/2 + Si(2 pi)/(2 pi), the factor of p_0 in q(-2).
INNER = 0.3994549881295272
#: Standard deviation of a position between two points of which nothing is known.
ANYWHERE = 1 / math.sqrt(12)
#: A step is where v changes by this multiple of its changes on both sides (3 to 12 do).
STEP = 6.0
_EULER_GAMMA = 0.577216
# At an edge, q falls faster outside by this factor, and by STEP times its bend inside.
_EDGE = 1.25
# Kinds of links that are not smooth, as bits of a number.
_STEP = 1
_KINK = 2
_CREASE = 4
_FLOWED = 8
_EDGED = 16
#: Rows of the values of a link.  Rows 0 to 5 are v at six points from inside out, of
#: which the third is the last point inside the front.  FLOWED is whether its third
#: point (1), or its third and fourth (2), flowed under an earlier load; UNLOADED is the
#: fraction of the hardness by which the third has unloaded since; TOP is the least v of
#: a point that is plastic, or was at the peak load; KIND is the kind of the link.
ROWS = 10
FLOWED = 6
UNLOADED = 7
TOP = 8
KIND = 9


class Links(NamedTuple):
    """Fronts on links between two neighbouring points; lengths are in spacings.

    Each field is an array (n,) with one value for each link.

    Attributes:
        position: of the root of q, from the point inside; 1/2 if the front is pinned.
        uncertainty: of the position: the shift caused by the polynomial's last term.
        pinned: 1 if a step or an edge holds the front, at any position; else 0.
        hidden_width: width of the zone at an edge that is plastic but shows no point.
        at_kink: 1 at a kink, beside an edge, or beside earlier flow; else 0.
        unloaded_fraction: pressure that the point inside has lost since it flowed, over
            the hardness; 0 if the front is not at the edge of a flattened spot.
        steepening: fraction by which v is steeper than on the link inside; 0 if the
            pressure does not fall there.
    """

    position: FloatArray
    uncertainty: FloatArray
    pinned: FloatArray
    hidden_width: FloatArray
    at_kink: FloatArray
    unloaded_fraction: FloatArray
    steepening: FloatArray


@inlined
def strip_width(width: float) -> float:
    """Return the width in the continuum of a narrow strip of elastic contact.

    The strip lies between points apart and plastic points that are neighbours on the
    grid.  Widths are in grid spacings.

    width: the width by the gradient on the grid, hardness/|grad p|, at most 1.
    """
    return 4 / math.pi * math.exp(math.e * (1 - 1 / width) - _EULER_GAMMA)


@inlined
def released_width(unloaded_fraction: float, strip: float) -> float:
    """Return the distance from the edge of a flattened spot to the front, in spacings.

    A flattened spot flowed plastically under an earlier, larger load; at its edge the
    front is held until the load falls.

    unloaded_fraction: the pressure that the last point inside has lost since the peak
    load, as a fraction of the hardness; strip: width, in spacings, of the strip of
    elastic contact beside the spot at the peak load.

    In the continuum the pressure beside the edge was H (2/pi) arcsin sqrt(s/d), with H
    the hardness and d the width of the `strip`.  A fall of the last pressure by a
    fraction of H takes K/sqrt(s) off, or all of the pressure up to the new front, at x.
    K = H sqrt(e)/pi times the fraction is the integral over the strip of (2/pi)
    sqrt(x - a) dp(a).  Both ends of x are expanded in k = pi K/(H sqrt d).  A narrow
    strip has the yield zone of Dugdale's crack, x = e/4 times the fraction squared.
    """
    square = math.e * unloaded_fraction**2
    k = math.sqrt(square / max(strip, 1e-300))
    if k < 4 / math.pi:
        return strip * k * (1 - k / 8 - 0.0342 * k * k)
    return strip / 2 + square / 4 + strip**2 / (8 * square)


@inlined
def fall_and_bend(first: float, before: float, last: float) -> tuple[float, float]:
    """Return the fall of q between the last two points inside a front, and its bend.

    q is pressure times the root of the distance from the front, which is smooth.  With
    x counted from the last point outwards, the fall is q(-1) - q(0), and the bend is
    this fall minus q(-2) - q(-1).

    first, before, last: pressures in Pa of the last three points inside, from inside
    out.
    """
    fall = before + (MIX - 1) * last
    return fall, fall - (first + (MIX - 1) * before + (INNER - MIX) * last)


@inlined
def parabola_root(value: float, fall: float, bend: float) -> float:
    """Return the least x > 0 at which value - fall x - bend x^2 is 0, at most 1.

    All coefficients are in the same unit, and x is dimensionless; value > 0.  The
    result is 1 if the parabola does not fall at x = 0.
    """
    if fall <= 0:
        return 1.0
    root = math.sqrt(max(fall * fall + 4 * bend * value, 0.0))
    return min(2 * value / (fall + root), 1.0)


@inlined
def cubic_root(value: float, slope: float, square: float, cube: float) -> float:
    """Return the root of a cubic between 0 and 1, by two steps of Halley's method.

    The cubic is value + slope x + square x^2 + cube x^3: positive at 0 and negative at
    1.  The root is approximate, but areas are as accurate as with the exact root.
    """
    chord = slope + square + cube
    x = -value / chord
    for _ in range(2):
        here = value + x * (slope + x * (square + x * cube))
        bend = square + 3 * x * cube
        rate = slope + x * (square + bend)
        step = here / chord  # if the cubic does not fall here
        if rate < 0:
            step = here * rate / max(rate * rate - here * bend, rate * rate / 2)
        x = min(max(x - step, 0.0), 1.0)
    return x


@compiled
def locate(  # noqa: PLR0915 - one loop, which the compiler makes one over vectors
    values: FloatArray, count: int, hardness: float, links: Links
) -> None:
    """Locate the fronts on links as if all were smooth, and find each link's kind.

    A link joins two neighbouring points on both sides of a front.  The loop has almost
    no branches, so that the compiler handles several links at once.

    values: (ROWS, n) values around each link, in Pa, see ROWS: row 2 is the last point
    inside the front, row 3 the point outside; the row KIND is overwritten with bits for
    `locate_special`.  count: the number of links, at most n.  hardness: the least value
    of a plastic point, in Pa.  links: the arrays (n,) that are overwritten.
    """
    for n in range(count):
        first = values[0, n]
        before = values[1, n]
        last = values[2, n]
        out = values[3, n]
        after = values[4, n]
        flowed = values[FLOWED, n]
        top = values[TOP, n]
        # Whether two pressures and two gaps are known of this contact and this gap.
        contact = before >= top
        mix = 0.0
        q0 = last - top
        if last < top:
            contact = (before > 0) & (before < top)
            mix = MIX
            q0 = last
        gap = (after <= 0) & (flowed < 2)
        # Newton's polynomial q0 + x (t1 + (x - 1) (t2 + (x + 1) t3)); without q(-1) the
        # second difference is that of the gap.
        t1 = min(out - q0, -1e-150)  # 0 between a flow and a gap of 0
        t2 = t3 = 0.0
        if contact:
            t2 = (t1 + before + (mix - 1) * last) / 2
        if gap:
            t3 = (after - mix * out - q0) / 2 - t1 - t2
            if contact:
                t3 *= 1 / 3
        square = t2
        cube = t3
        if not contact:
            square = t3
            cube = 0.0
        x = cubic_root(q0, t1 - square - cube, square, cube)
        # Where the last point is plastic, q tells by how much the front is off the root
        # of a straight line in v.
        line = last / (last - out)
        links.position[n] = min(max(x + line + q0 / t1, 0.0), 1.0)
        # The shift in the middle of the link if the last term is left out.
        last_term = t3 * 0.375 if gap else t2 / 4
        shift = min(max(last_term / t1, -ANYWHERE), ANYWHERE)
        if not contact | gap:
            shift = ANYWHERE
        # Where the pressure peaks one point inside, the front may be at a kink there.
        # It is then AXIS_OFFSET too far out.  Not so if the cubic through q(-2) agrees
        # in the middle of the link as well as the last term is small.
        drop, bend = fall_and_bend(first, before, last)
        peak = contact & gap & (last < top) & (first > 0) & (before > max(first, last))
        other_t3 = t2 - (drop - bend / 2 + t1) / 3
        if peak & (abs(t3 - other_t3) > 8 / 3 * abs(t3)):
            shift = -AXIS_OFFSET
        links.uncertainty[n] = shift
        links.pinned[n] = 0.0
        links.hidden_width[n] = 0.0
        links.at_kink[n] = 0.0
        links.unloaded_fraction[n] = 0.0
        elastic = last < hardness
        fall = before - last
        deeper_fall = first - before
        steeper = elastic & (fall > 0) & (deeper_fall > 0)
        links.steepening[n] = (last - out) / fall - 1 if steeper else 0.0
        # The kind of the link, for `locate_special`.
        resolved = (before > 0) & ((fall < 0) | ((first > 0) & (after <= 0)))
        jump = last - out > STEP * max(fall, out - after)
        step = jump & (resolved | (not elastic))
        kink = elastic & (first > 0) & (-fall > max(-deeper_fall, 0.0))
        crease = elastic & (flowed == 0) & (after > 0) & (after < hardness)
        outer_drop = max(last - out, (1 + MIX) * out - after)
        smooth = (
            elastic & contact & gap & (first > 0) & (drop > 0) & (not (step | kink))
        )
        edge = smooth & (outer_drop > _EDGE * drop + STEP * abs(bend))
        kind = _STEP * step + _KINK * kink + _CREASE * crease + _EDGED * edge
        values[KIND, n] = kind + _FLOWED * (flowed == 1)


@compiled
def locate_special(  # noqa: PLR0912, PLR0915 - one kind of link after the other
    values: FloatArray, count: int, hardness: float, links: Links
) -> None:
    """Locate the fronts again on the links where `locate` found a kind that is not 0.

    These fronts are not smooth: they are at a step, a kink, an edge or a crease of the
    surface, or at the edge of a spot that flowed under an earlier load (see the
    module).

    values: (ROWS, n) values around each link, in Pa, see ROWS, with the KIND that
    `locate` wrote; count: the number of links, at most n; hardness: the least value of
    a plastic point, in Pa; links: the arrays (n,) that are changed in place.
    """
    for n in range(count):
        kind = int(values[KIND, n])
        if kind == 0:
            continue
        first = values[0, n]
        before = values[1, n]
        last = values[2, n]
        out = values[3, n]
        after = values[4, n]
        end = values[5, n]
        line = last / (last - out)
        if values[UNLOADED, n] > 0:
            fraction = values[UNLOADED, n]
            links.unloaded_fraction[n] = fraction
            links.steepening[n] = 0.0
            links.position[n] += fraction * (line - links.position[n])
            links.uncertainty[n] *= 1 - fraction
            continue
        if kind & _CREASE:
            half_width, shift = crease_gap(before, last, out, after, end)
            if half_width > 0:
                links.position[n] = 1 - half_width - shift + AXIS_OFFSET
                links.uncertainty[n] = 0.0
                links.at_kink[n] = 1.0
                continue
        elastic = last < hardness
        step = kind & _STEP > 0
        kink = kind & _KINK > 0
        edge = kind & _EDGED > 0
        holds = step and (links.position[n] < 0.5 or not elastic)
        closes = 0.0  # where the gap closes, from the point outside, or the edge is
        if kink and not holds:
            closes = 1.0
            if after <= 0:
                far_gap = -end if end <= 0 else out - 2 * after
                bend = (far_gap + 2 * after - out) / 2
                closes = parabola_root(-out, out - after - bend, -bend)
        if edge:
            fall, bend = fall_and_bend(first, before, last)
            links.position[n] = parabola_root(last, fall + bend / 2, bend / 2)
            links.uncertainty[n] = bend / 2 / fall
            closes = links.position[n]
        if elastic and (step or kink or closes >= 1):
            # The pressure is singular at an edge, and rises as a logarithm at a kink.
            links.hidden_width[n] = (math.pi / 4 * last / hardness) ** 2
            if kink and not step:
                links.hidden_width[n] = 3 ** ((last - hardness) / (last - before))
        if holds or closes >= 1:
            links.position[n] = 0.5
            links.uncertainty[n] = 0.0
            links.pinned[n] = 1.0
            continue
        if kink:
            x = 1 - closes + AXIS_OFFSET * (1 - line)
            links.position[n] = min(max(x, 0.0), 1.0)
        if kink or edge or kind & _FLOWED:
            links.at_kink[n] = 1.0
