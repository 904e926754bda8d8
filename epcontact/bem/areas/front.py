"""Locate a front between two grid points, exactly for a straight front along the grid.

At a front between apart and elastic points the discrete problem on the half-line is solved by a
Wiener-Hopf factorisation of the compliance 2/(E* |q|), |q| < pi/dx.  Let q(x) = alpha + beta x +
... be the polynomial that sqrt(distance) p is in the continuum.  The pressure inside is
(1/S_+) q and the gap outside is -S_- q.  The leading coefficients of S give, in units of
c = pi E*/(2 e dx), with b = Si(pi)/pi and points counted from the last in contact outwards,

    q(0) = p_0,  q(-1) = p_1 + b p_0,  q(-2) = p_2 + b p_1 + (b^2/2 + d) p_0  (to a common factor),
    q(1) = -c g_1,  q(2) = -c (g_2 - b g_1),  q(3) = -c (g_3 - b g_2 + (b^2/2 - d) g_1)

with d = Si(2 pi)/(2 pi).  The front is AXIS_OFFSET dx short of the root of q between 0 and 1.  The
root is that of the polynomial through those of the six values that this contact and this gap have:
the offset is exact up to the fifth order in dx, as the magnitude of S has no further terms.  A
parabola beside a contact of one point would put the fronts of waves of four points a tenth of a
spacing too far in.

The plastic front is the same with hardness - p for p and -g for g.
"""

from __future__ import annotations

import math

import numba

#: Offset of a front along an axis, in dx: 1/4 - (1/2 pi) int_0^{pi/2} (cot t/t - cot^2 t) dt.
AXIS_OFFSET = 0.190009285925947
#: STIFFNESS is c in E*/dx, and MIX is b.
STIFFNESS = math.pi / (2 * math.e)
MIX = 0.5894898722360835  # Si(pi)/pi
#: b^2/2 + d and b^2/2 - d.
INNER, OUTER = 0.3994549881295272, -0.05195667866061313
#: With this ratio to the third difference, a fourth one moves the middle of a link as far.
EQUAL = 8 / 3
#: Standard deviation of the place of a front of which only the link is known.
ANYWHERE = 1 / math.sqrt(12)
#: A gap that changes between two points by more than this multiple of its changes beside them has
#: a step there.  The loss of the fit of `epcontact.studies.error_bars` is 2.78 with 1.5, 2.67 with
#: 3, 2.65 with 6 and 2.68 with 12.
STEP = 6.0
#: At a kink, what the place where the gap closes is too far out, and its doubt, in spacings times
#: the share of the pressure in the change of v (`epcontact.studies.rim.calibrate_kink`).
KINK = 0.13

Six = tuple[float, float, float, float, float, float]
#: Compiles a function of this room; nothing calls one from C.
compiled = numba.njit(cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True)


@compiled
def kind(p: float, hardness: float) -> int:
    """The state of a point with the pressure p: APART, ELASTIC or PLASTIC."""
    return int(p > 0) + int(p >= hardness)


@compiled
def field(p: float, g: float, hardness: float, c: float) -> float:
    """v = p - c g: at most 0 where apart, at least the hardness where plastic."""
    if p <= 0:
        return float(-c * max(g, 0.0))
    if p >= hardness:
        return float(hardness - c * min(g, 0.0))
    return p


@compiled
def _differences(
    q: Six, inside: int, outside: int
) -> tuple[float, float, float, float, float, bool]:
    """(second to fifth differences, last term, whether q(-2) is left out) of `_shift`.

    The outermost values may belong to another part of the surface: they are left out where the term
    of the fourth difference exceeds that of the third.  The last term is the one in the middle of
    the link.
    """
    # Second differences about -1, 0, 1 and 2.
    first, near = q[2] - 2 * q[1] + q[0], q[3] - 2 * q[2] + q[1]
    far, last = q[4] - 2 * q[3] + q[2], q[5] - 2 * q[4] + q[3]
    if inside > 0 and outside > 0:
        third, inner, outer = far - near, far - 2 * near + first, last - 2 * far + near
        most = EQUAL * abs(third)
        deep, wide = inside > 1 and abs(inner) <= most, outside > 1 and abs(outer) <= most
        left = inside > 1 and not deep
        if deep and wide:
            return near, third, inner, outer - inner, (outer - inner) * 3 / 256, left
        if deep or wide:
            fourth = inner if deep else outer
            return near, third, fourth, 0.0, fourth * 3 / 128, left
        return near, third, 0.0, 0.0, -third / 16, left
    if inside > 0:
        third = near - first if inside > 1 else 0.0
        return near, third, 0.0, 0.0, -(third / 16 if inside > 1 else near / 8), False
    third = last - far if outside > 1 else 0.0
    return far - third, third, 0.0, 0.0, third / 16 if outside > 1 else -far / 8, False


@compiled
def _shift(q: Six, inside: int, outside: int) -> tuple[float, float, bool]:
    """The root of the polynomial through q less that of a straight line, and the doubt of it.

    q: at -2 to 3, with q(0) > 0 >= q(1); inside, outside: how many of the two values before, and of
    the two after these, there are.

    Returns:
        (shift, doubt, left): the root is between 0 and 1.  The doubt is by how much the last term
        of the polynomial moves the middle of the link, outwards if positive.  left: whether q(-2)
        is left out.
    """
    slope = q[3] - q[2]
    line = -q[2] / slope
    if inside + outside == 0:
        return 0.0, ANYWHERE, False
    second, third, fourth, fifth, term, left = _differences(q, inside, outside)
    x, low, high = line, 0.0, 1.0
    for _ in range(20):
        value, rate = fourth + fifth * (x + 2) / 5, fifth / 5
        value, rate = third + value * (x - 2) / 4, (value + rate * (x - 2)) / 4
        value, rate = second + value * (x + 1) / 3, (value + rate * (x + 1)) / 3
        value, rate = slope + value * (x - 1) / 2, (value + rate * (x - 1)) / 2
        value, rate = q[2] + value * x, value + rate * x
        if value > 0:
            low = x
        else:
            high = x
        new = x - value / rate if rate < 0 else -1.0
        if not low <= new <= high:
            new = (low + high) / 2
        step, x = abs(new - x), new
        if step < 1e-7:
            break
    return float(x - line), min(max(-term / slope, -ANYWHERE), ANYWHERE), left


@compiled
def _hidden(p: float, before: float, hardness: float, step: bool) -> float:
    """Width of the plastic zone between the last point in contact, of pressure p, and an edge.

    At a step the mean of K/sqrt(distance) over the last spacing is 2 K, and Dugdale's zone is
    (pi^2/4) K^2/H^2 wide.  At a kink the pressure grows by p - before, as the logarithm of the
    distance does from 3/2 to 1/2 of a spacing.  Capped, H - k ln s becomes H - k arcosh(s/w), and
    the zone is twice as wide as that in which the elastic pressure exceeds the hardness.
    """
    if p >= hardness:
        return 0.0
    if step:
        return float((math.pi / 4 * p / hardness) ** 2)
    return float(3 ** ((p - hardness) / (p - before)))


@compiled
def _closing(near: float, middle: float, far: float) -> float:
    """How far before the first of three neighbouring points the parabola of their gaps is 0.

    The distance is at most 1: there the gaps do not close within the spacing.
    """
    bend = (far - 2 * middle + near) / 2
    slope = middle - near - bend
    if slope <= 0:
        return 1.0
    square = max(slope * slope - 4 * bend * near, 0.0)
    return float(min(2 * near / (slope + math.sqrt(square)), 1.0))


@compiled
def crossing(v: Six, hardness: float, front: int) -> tuple[float, float, float, float, float]:
    """The place, 0 to 1, between the middle two of six points where v crosses 0 or the hardness.

    v: values of `field`.  front: 0, or 1 for the hardness.

    Returns:
        (place, held, hidden, doubt, kinked): if a step of the surface holds the front, any place in
        the link is equally likely, and place is 1/2 and held is 1, else held is 0.  hidden is the
        width of the zone next to an edge in which the singular pressure exceeds the hardness, but
        which no point shows.  doubt is by how much the front may be elsewhere, outwards if
        positive, as the last term of the polynomial says.  kinked is 1 where the surface has a kink
        at the front or close behind it.

    At a resolved rim the pressure vanishes as sqrt(distance).  At a step of the surface the gap
    jumps.  At a kink the pressure rises towards the edge, and ever faster, and the surfaces part at
    an angle: the front is where the parabola of the gap closes, but for KINK.  Where a kink is
    behind the front, the pressure has its peak at the last point but one, and the value before that
    is left out of the polynomial.
    """
    if front:
        v = (
            hardness - v[0],
            hardness - v[1],
            hardness - v[2],
            hardness - v[3],
            hardness - v[4],
            hardness - v[5],
        )
    turned = v[2] <= 0
    if turned:
        v = v[5], v[4], v[3], v[2], v[1], v[0]
    last, before, jump = v[2], v[1], v[2] - v[3]
    elastic, open_after = last < hardness, v[4] <= 0
    step = jump > STEP * max(before - last, v[3] - v[4]) and (
        not elastic or 0 < before < last or (v[0] > 0 and before > 0 and open_after)
    )
    kink = elastic and v[0] > 0 and last - before > max(before - v[0], 0.0)
    # The polynomial is that of the pressure, or, if no point is in the strip, of the gap.
    inside = outside = 0
    if elastic:
        q = (
            v[0] + MIX * before + INNER * last,
            before + MIX * last,
            last,
            v[3],
            v[4] - MIX * v[3],
            v[5] - MIX * v[4] + OUTER * v[3],
        )
        if 0 < before < hardness and not kink:
            inside = 1 + int(0 < v[0] < hardness)
    else:
        q = v[0] - hardness, before - hardness, last - hardness, v[3], v[4], v[5]
        if before >= hardness:
            inside = 1 + int(v[0] >= hardness)
    if open_after:
        outside = 1 + int(v[5] <= 0)
    shift, doubt, left = _shift(q, inside, outside)
    root = last / jump + shift
    hidden = _hidden(last, before, hardness, step) if step or kink else 0.0
    if step and (root < 0.5 or not elastic):
        return 0.5, 1.0, hidden, 0.0, 0.0
    kinked = 0.0
    if kink:
        away = 1.0
        if open_after:
            away = _closing(-v[3], -v[4], -v[5] if v[5] <= 0 else v[3] - 2 * v[4])
        if away >= 1:
            return 0.5, 1.0, hidden, 0.0, 0.0
        root = 1 - away - KINK * last / jump + AXIS_OFFSET
        doubt, kinked = 0.0, 1.0
    elif left and elastic and before > max(v[0], last):
        kinked = 1.0
    root = min(max(root, 0.0), 1.0)
    return float(1 - root if turned else root), 0.0, hidden, doubt, kinked
