"""What no grid point shows: gaps and plastic ridges narrower than a spacing.

Where two slopes of a surface meet, at a crease, the pressure falls as a logarithm of
the distance.  So the width of a gap there, or of the plastic ridge of the mirror image,
follows from the pressures beside it.  The functions take v = p - c g (`grid`) at five
points in a row across the crease; lengths are in spacings.
"""

from __future__ import annotations

import math

import numba

from epcontact.bem.workers import OPTIONS

#: c of v = p - c g, in E*/dx: pi/(2 e), by the factorisation in `front`.
STIFFNESS = math.pi / (2 * math.e)
#: b = Si(pi)/pi of the factorisation in `front`.
MIX = 0.5894898722360835

# On the grid the pressure of a crease at a point is P + k f(r), with these values of f
# at 0, 1 and 2 spacings (solutions on lines).  Far away f(r) = ln r.
_F0 = math.log(0.1033)
_F1 = 0.197
_F2 = 0.664
# By the load of a wedge that one point carries, its neighbours and the points beyond
# them move by these displacements, in load dx/E*.
_NEAR_MOVES = 1.05
_FAR_MOVES = 1.55
# A round crest opens three times as much beside its load as the two slopes of a wedge;
# the limit between them is half of this.
_ROUND_CREST = 1.5

#: Compiles a function into its caller: to hand over arrays takes as long as the work.
inlined = numba.njit(**OPTIONS, no_cpython_wrapper=True, forceinline=True, _nrt=False)


@inlined
def crease_gap(
    far_left: float, left: float, centre: float, right: float, far_right: float
) -> tuple[float, float]:
    """Return the half-width of the gap at a crease and its shift to the left.

    A crease is the line where two slopes of the surface meet in a valley; a gap there
    can be narrower than a grid spacing.  Both results are in spacings, and both are 0
    if the values are not those of a crease with such a gap.

    far_left, left, centre, right, far_right: v of five points in a row across the
    crease, all in Pa: the pressure where a point is in contact, and minus STIFFNESS
    E*/dx times the gap where it is not.

    In the continuum p falls to P + k ln s at a crease, and to k arccosh(s/w) beside a
    gap of the half-width w.  Both are the same far away if w = 2 exp(-P/k).  On the
    grid a crease between two points has the mean of the pressures of creases at these
    points, weighted by the distances.  So the difference of v left and right of the
    centre gives the shift, and their sum gives k.

    The centre may be apart.  Its gap g has then changed p there by c g e/2, and beside
    it by -c g 2 e/pi^2.
    """
    if centre < 0:
        left -= 2 * math.e / math.pi**2 * centre
        right -= 2 * math.e / math.pi**2 * centre
        centre *= math.e / 2
    # With the shift t: |left - right| = (F2 - F0) k t, and
    # left + right - 2 centre = [2 (F1 - F0) - (4 F1 - 3 F0 - F2) t] k.
    difference = abs(left - right)
    k_shift = difference / (_F2 - _F0)
    k = left + right - 2 * centre + (4 * _F1 - 3 * _F0 - _F2) * k_shift
    k /= 2 * (_F1 - _F0)
    # The second difference on the far side is -k to -2 k at a crease, and positive on a
    # smooth surface.
    bend = centre + (far_left - 2 * left if left > right else far_right - 2 * right)
    if min(left, right) < centre or bend > k_shift - k:
        return 0.0, 0.0
    half_width = 2 * math.exp(_F0 + ((_F1 - _F0) * k_shift - centre) / k)
    if half_width >= 1:
        return 0.0, 0.0
    return half_width, (right - left) / ((_F2 - _F0) * k)


@inlined
def wedge_width(
    hardness: float,
    far_left: float,
    left: float,
    centre: float,
    right: float,
    far_right: float,
) -> float:
    """Return the width in spacings of the plastic ridge that one grid point shows.

    A wedge is a crest where two slopes of the surface meet.  Its ridge is plastic and
    can be narrower than a spacing, so that one point carries its load.

    hardness: in Pa; far_left, left, centre, right, far_right: hardness - v, in Pa, of
    five points in a row across the ridge, with v as in `crease_gap`.

    The values v are those of the mirror image (`grid`), in which the wedge is a groove
    between two plastic points, `left` and `right`; the centre is elastic.  Where the
    load has moved these points, both sides still have their slopes t.  The ridge is
    theta_4(exp(-pi E* t/(2 H)))^2 times as wide as its load at the hardness H.  The
    width is 0 if the surface is round there, not a wedge.
    """
    load = hardness - centre
    moved = STIFFNESS * load
    slope_left = (_FAR_MOVES - _NEAR_MOVES) * moved + far_left - left
    slope_right = (_FAR_MOVES - _NEAR_MOVES) * moved + far_right - right
    opening = 2 * _NEAR_MOVES * moved + left + right - 2 * hardness
    if min(slope_left, slope_right) <= 0:
        return 0.0
    if slope_left + slope_right > _ROUND_CREST * opening:
        return 0.0
    slope = math.sqrt(slope_left * slope_right) / STIFFNESS
    nome = math.exp(-math.pi / 2 * slope / hardness)
    return load / hardness * max(1 - 2 * nome, 0.0) ** 2
