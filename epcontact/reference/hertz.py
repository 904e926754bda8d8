"""Hertzian contact of a sphere and of a cylinder, alone and repeated with a period.

A parabola, of height -r^2/(2 R), is pressed by a rigid flat; in the mirrored problem, a rigid
parabola on a flat elastic body, every formula is the same.  Symbols: F = force (N), P' = force
per length (N/m), R = radius (m), E* = effective_modulus (Pa), a = contact radius or half-width
(m), delta = approach (m), L = period (m).

Sources: Johnson, Contact Mechanics (1985), sections 3.4, 4.2 and appendix 3.  The periodic
results are derived here:

sphere    A neighbour at distance d presses the surface down by F/(pi E* d) there.  Summed over
          the square lattice of images this is, up to a constant and to terms in cos(4 theta),
              F/(pi E*) [S_3 r^2/4 + (9/64) S_5 (r^4 + 4 r^2 <y^2>)],  <y^2> = 2 a^2/5,
          with S_n = sum' |R|^-n.  The quadratic part adds to the curvature, the quartic part
          B r^4 takes the further force (64/15) E* B a^5 (Sneddon 1965).  To leading order
              1/R_eff = (1/R) (1 + 1.917 (a/L)^3).
cylinder  The kernel of a periodic row is -(2/(pi E*)) ln|2 sin(pi x/L)|; building the contact
          up from periodic flat punches gives an Abel equation in sin^2(pi x/L) whose solution
          is closed: P' = -(E* L^2/(2 pi R)) ln cos(pi a/L).  To leading order
              1/R_eff = (1/R) (1 + (pi^2/6) (a/L)^2).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

from epcontact.results import FloatArray

#: sum' |R|^-3 = 4 zeta(3/2) beta(3/2) over the square lattice of unit spacing, without the origin.
LATTICE_SUM_3 = 9.033621683100950
#: sum' |R|^-5 = 4 zeta(5/2) beta(5/2).
LATTICE_SUM_5 = 5.090258233665482
#: -sum' |R|^-1 continued analytically, -4 zeta(1/2) beta(1/2): the square lattice's constant.
MADELUNG = 3.900264920001956


def sphere_contact_radius(force: float, radius: float, effective_modulus: float) -> float:
    """a = (3 F R / (4 E*))^(1/3) in m."""
    return math.cbrt(3 * force * radius / (4 * effective_modulus))


def sphere_force(contact_radius: float, radius: float, effective_modulus: float) -> float:
    """F = 4 E* a^3 / (3 R) in N."""
    return 4 * effective_modulus * contact_radius**3 / (3 * radius)


def sphere_approach(contact_radius: float, radius: float) -> float:
    """delta = a^2 / R in m, of the flat against points of the body far away."""
    return contact_radius**2 / radius


def sphere_peak_pressure(contact_radius: float, radius: float, effective_modulus: float) -> float:
    """p_0 = 2 E* a / (pi R) = 3 F / (2 pi a^2) in Pa."""
    return 2 * effective_modulus * contact_radius / (math.pi * radius)


def sphere_energy(approach: float, radius: float, effective_modulus: float) -> float:
    """U = (8/15) E* sqrt(R) delta^(5/2) in J, the work done by the force."""
    return float(8 / 15 * effective_modulus * math.sqrt(radius) * approach**2.5)


def sphere_pressure(
    distance: FloatArray, contact_radius: float, radius: float, effective_modulus: float
) -> FloatArray:
    """p = p_0 sqrt(1 - r^2/a^2) in Pa at distances r (any shape, m) from the axis."""
    peak = sphere_peak_pressure(contact_radius, radius, effective_modulus)
    inside = np.maximum(1 - (np.asarray(distance) / contact_radius) ** 2, 0)
    return np.asarray(peak * np.sqrt(inside))


def sphere_gap(distance: FloatArray, contact_radius: float, radius: float) -> FloatArray:
    """Gap in m between flat and deformed sphere at distances r (any shape, m) from the axis.

    g = (a^2/(pi R)) [sqrt(t^2 - 1) - (2 - t^2) arccos(1/t)], t = r/a > 1; zero inside.
    """
    t = np.maximum(np.asarray(distance) / contact_radius, 1)
    shape = np.sqrt(t**2 - 1) - (2 - t**2) * np.arccos(1 / t)
    return np.asarray(contact_radius**2 / (math.pi * radius) * shape)


def sphere_contact_radius_periodic(
    force: float, radius: float, effective_modulus: float, period: float
) -> float:
    """Contact radius a in m of one of a square lattice of spheres `period` apart.

    The smallest root of F = (4/3) E* a^3 K + (64/15) E* B a^5 with
        K = 1/R + F/(pi E*) [S_3/(2 L^3) + (9/20) S_5 a^2/L^5],  B = F/(pi E*) (9/64) S_5/L^5.
    `period = inf` is Hertz.  Validity: the first omitted terms are of order (a/L)^7, and the
    square symmetry of the rim of order (a/L)^10; good to 1e-4 of the area at a/L = 0.25.
    """
    free = sphere_contact_radius(force, radius, effective_modulus)
    strength = force / (math.pi * effective_modulus)

    def excess(a: float) -> float:
        curvature = 1 / radius + strength * (
            LATTICE_SUM_3 / (2 * period**3) + 0.45 * LATTICE_SUM_5 * a**2 / period**5
        )
        quartic = strength * 9 / 64 * LATTICE_SUM_5 / period**5
        carried = 4 / 3 * a**3 * curvature + 64 / 15 * quartic * a**5
        return effective_modulus * carried / force - 1

    return float(brentq(excess, 0.0, free * (1 + 1e-12), xtol=1e-15 * free, rtol=1e-14))


def sphere_mean_approach_shift(force: float, effective_modulus: float, period: float) -> float:
    """Change in m of the approach where displacements have zero mean over the period.

    -3.9003 F / (pi E* L): the potential of the lattice of images less the uniform background.
    """
    return -MADELUNG * force / (math.pi * effective_modulus * period)


def cylinder_half_width(force_per_length: float, radius: float, effective_modulus: float) -> float:
    """a = sqrt(4 P' R / (pi E*)) in m."""
    return math.sqrt(4 * force_per_length * radius / (math.pi * effective_modulus))


def cylinder_force(half_width: float, radius: float, effective_modulus: float) -> float:
    """P' = pi E* a^2 / (4 R) in N/m."""
    return math.pi * effective_modulus * half_width**2 / (4 * radius)


def cylinder_peak_pressure(half_width: float, radius: float, effective_modulus: float) -> float:
    """p_0 = E* a / (2 R) = 2 P' / (pi a) in Pa."""
    return effective_modulus * half_width / (2 * radius)


def cylinder_pressure(
    distance: FloatArray, half_width: float, radius: float, effective_modulus: float
) -> FloatArray:
    """p = p_0 sqrt(1 - x^2/a^2) in Pa at distances x (any shape, m) from the middle."""
    peak = cylinder_peak_pressure(half_width, radius, effective_modulus)
    inside = np.maximum(1 - (np.asarray(distance) / half_width) ** 2, 0)
    return np.asarray(peak * np.sqrt(inside))


def cylinder_half_width_periodic(
    force_per_length: float, radius: float, effective_modulus: float, period: float
) -> float:
    """a = (L/pi) arccos(exp(-2 pi R P' / (E* L^2))) in m: a row of parabolas `period` apart.

    Exact at any load; contact is complete only as P' grows without bound, the parabolas
    meeting in a cusp.
    """
    if math.isinf(period):
        return cylinder_half_width(force_per_length, radius, effective_modulus)
    load = 2 * math.pi * radius * force_per_length / (effective_modulus * period**2)
    # arccos(e^-w) = arcsin(sqrt(1 - e^-2w)), which keeps its digits at small loads.
    return period / math.pi * math.asin(math.sqrt(-math.expm1(-2 * load)))


def cylinder_force_periodic(
    half_width: float, radius: float, effective_modulus: float, period: float
) -> float:
    """P' = -(E* L^2/(2 pi R)) ln cos(pi a/L) in N/m; the inverse of the above."""
    if math.isinf(period):
        return cylinder_force(half_width, radius, effective_modulus)
    sine = math.sin(math.pi * half_width / period)
    return -effective_modulus * period**2 / (4 * math.pi * radius) * math.log1p(-(sine**2))


def cylinder_pressure_periodic(
    distance: FloatArray,
    half_width: float,
    radius: float,
    effective_modulus: float,
    period: float,
) -> FloatArray:
    """p = (E* L/(2 pi R)) artanh(sqrt(sin^2 t_a - sin^2 t) / cos t), t = pi x/L, in Pa.

    distance: x in m, any shape, |x| <= L/2, from the middle of one parabola.
    """
    angle = np.pi * np.asarray(distance) / period
    depth = np.sin(math.pi * half_width / period) ** 2 - np.sin(angle) ** 2
    inside = depth > 0
    cosine = np.where(inside, np.cos(angle), 1)
    ratio = np.sqrt(np.maximum(depth, 0)) / cosine
    return np.asarray(effective_modulus * period / (2 * math.pi * radius) * np.arctanh(ratio))
