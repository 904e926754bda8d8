"""Locate a front between two grid points, exactly for a straight front along the grid.

At a front between apart and elastic points the discrete problem on the half-line is solved by a
Wiener-Hopf factorisation of the compliance 2/(E* |q|), |q| < pi/dx.  Let q(x) = alpha + beta x +
... be the polynomial that sqrt(distance) p is in the continuum.  The pressure inside is
(1/S_+) q and the gap outside is -S_- q.  The leading coefficients of S give, in units of
c = pi E*/(2 e dx), with b = Si(pi)/pi and points counted from the last in contact outwards,

    q(0) = p_0,  q(-1) = p_1 + b p_0 (to a common factor),  q(1) = -c g_1,  q(2) = -c g_2 + b c g_1.

The front is AXIS_OFFSET dx short of the root of q between 0 and 1.  The root is that of the
polynomial through the four values (three or two where the contact or the gap has one point only):
the offset is exact up to the third order in dx, as the magnitude of S has no further terms.

The plastic front is the same with hardness - p for p and -g for g.
"""

from __future__ import annotations

import math

import numba

from epcontact.results import FloatArray

#: Offset of a front along an axis, in dx: 1/4 - (1/2 pi) int_0^{pi/2} (cot t/t - cot^2 t) dt.
AXIS_OFFSET = 0.190009285925947
#: STIFFNESS is c in E*/dx, and MIX is b.
STIFFNESS = math.pi / (2 * math.e)
MIX = 0.5894898722360835  # Si(pi)/pi
#: A gap that changes between two points by more than this multiple of its changes beside them has
#: a step there.  Of the links of smooth roughness at 4 points per wavelength 2 to 3 % exceed it, of
#: those at steps 70 to 100 % (`epcontact chart areas`).
PINNED_JUMP = 3.0
#: Plastic zones at the kinks of worn plateaus are so many times as wide as at steps.
KINK = 4.0

_jit = numba.njit(cache=True, nogil=True)


@_jit
def kind(p: float, hardness: float) -> int:
    """The state of a point with the pressure p: APART, ELASTIC or PLASTIC."""
    return int(p > 0) + int(p >= hardness)


@_jit
def field(p: float, g: float, hardness: float, c: float) -> float:
    """v = p - c g: at most 0 where apart, at least the hardness where plastic."""
    if p <= 0:
        return float(-c * max(g, 0.0))
    if p >= hardness:
        return float(hardness - c * min(g, 0.0))
    return p


@_jit
def _cubic_shift(q: FloatArray, before: bool, after: bool) -> float:
    """The root of a polynomial less the root of a straight line.

    The line goes through (0, q[1]) and (1, q[2]) with q[1] > 0 >= q[2]; the polynomial also
    through (-1, q[0]) if `before` and (2, q[3]) if `after`.
    """
    a, b = q[1], q[2] - q[1]
    # q = a + b x + x (x - 1) (d + e (x + 1)), or with (x - 2) without the point before.
    d = e = 0.0
    if before:
        d = (q[0] - a + b) / 2
        if after:
            e = ((q[3] - a - 2 * b) / 2 - d) / 3
    elif after:
        d = (q[3] - a - 2 * b) / 2
    line = x = -a / b
    low, high = 0.0, 1.0
    for _ in range(20):
        bend = d + e * (x + 1)
        value = a + b * x + x * (x - 1) * bend
        slope = b + (2 * x - 1) * bend + x * (x - 1) * e
        if value > 0:
            low = x
        else:
            high = x
        new = x - value / slope if slope < 0 else -1.0
        if not low <= new <= high:
            new = (low + high) / 2
        step, x = abs(new - x), new
        if step < 1e-7:
            break
    return float(x - line)


@_jit
def _stepped(v: FloatArray) -> bool:
    """True if v changes between v[1] and v[2] by far more than beside them."""
    return v[1] - v[2] > PINNED_JUMP * max(v[0] - v[1], v[2] - v[3])  # type: ignore[no-any-return]


@_jit
def _zone(share: float, step: bool) -> float:
    """Width of the plastic zone at an edge where the last point has this share of the hardness.

    At a step the mean of K/sqrt(distance) over the last spacing is 2 K, and Dugdale's zone is
    (pi^2/4) K^2/H^2 wide.  At a kink the pressure grows as a logarithm only, but over more points.
    """
    return (math.pi * share / 4) ** 2 * (1 if step else KINK) if share < 1 else 0.0


@_jit
def crossing(v: FloatArray, hardness: float, front: int) -> tuple[float, float, float, float]:
    """The place, 0 to 1, between the middle two of four points where v crosses 0 or the hardness.

    v: (4,) values of `field`, which are overwritten.  front: 0, or 1 for the hardness.

    Returns:
        (place, bend, edge, beyond): bend is the distance of the place from the root of a straight
        line, and edge and beyond are 0.  If an edge of the surface holds the front, any place in
        the link is equally likely, and the result is (1/2, 0, 1, beyond), where beyond is the
        width of the zone next to the edge in which the singular pressure exceeds the hardness.

    At a resolved rim the pressure vanishes as sqrt(distance) and therefore falls towards the rim;
    at an edge it is singular and rises.  If a plastic point has a point apart beside it, v is
    proportional to the gap, which jumps at a step.
    """
    if front:
        for k in range(4):
            v[k] = hardness - v[k]
    turned = v[1] <= 0
    if turned:
        v[0], v[1], v[2], v[3] = v[3], v[2], v[1], v[0]
    step = _stepped(v)
    pinned = 0 < v[0] < v[1] if v[1] < hardness else step
    last, line = v[1], v[1] / (v[1] - v[2])
    root = line
    if v[1] < hardness:
        before, after = 0 < v[0] < hardness, v[3] <= 0
        v[0] += MIX * v[1]
        v[3] -= MIX * v[2]
        root += _cubic_shift(v, before, after)
    elif v[1] - v[2] > hardness:
        # No point is in the strip.  The bend follows from the gap, which is smooth elsewhere.
        before, after = v[0] >= hardness, v[3] <= 0
        v[0] -= hardness
        v[1] -= hardness
        root += _cubic_shift(v, before, after)
    if pinned and root < 0.5 + AXIS_OFFSET:
        return 0.5, 0.0, 1.0, _zone(last / hardness, step)
    root = min(max(root, 0.0), 1.0)
    return float(1 - root if turned else root), abs(root - line), 0.0, 0.0
