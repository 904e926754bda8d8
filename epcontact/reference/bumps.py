"""Hertzian contact of one round bump a period: formulas, and the closed form that gates
use.

A parabola, of height -r^2/(2 R), is pressed by a rigid flat.  Symbols: F = force (N),
P' = force per length (N/m), R = radius (m), E* = effective_modulus (Pa), a = contact
radius or half-width (m), L = period (m).

Sources: Johnson, Contact Mechanics (1985), sections 3.4, 4.2 and appendix 3.  The
periodic results are derived here:

sphere    A neighbour at distance d presses the surface down by F/(pi E* d) there.
Summed over
          the square lattice of images this is, up to a constant and to terms in cos(4
          theta),
              F/(pi E*) [S_3 r^2/4 + (9/64) S_5 (r^4 + 4 r^2 <y^2>)],  <y^2> = 2 a^2/5,
          with S_n = sum' |R|^-n.  The quadratic part adds to the curvature, the quartic
          part B r^4 takes the further force (64/15) E* B a^5 (Sneddon 1965).  To
          leading order
              1/R_eff = (1/R) (1 + 1.917 (a/L)^3).
cylinder  The kernel of a periodic row is -(2/(pi E*)) ln|2 sin(pi x/L)|; building the contact
          up from periodic flat punches gives an Abel equation in sin^2(pi x/L) with the
          closed solution P' = -(E* L^2/(2 pi R)) ln cos(pi a/L).  To leading order
              1/R_eff = (1/R) (1 + (pi^2/6) (a/L)^2).
"""

from __future__ import annotations

import math

import numpy as np

from epcontact.reference.form import ClosedForm
from epcontact.results import FloatArray
from epcontact.scene import Scene

HERTZ = ClosedForm(
    "hertz",
    "Johnson, Contact Mechanics (1985), with the curvature of the periodic images",
)
#: sum' |R|^-3 = 4 zeta(3/2) beta(3/2) over the square lattice of unit spacing, without
#: the origin.
LATTICE_SUM_3 = 9.033621683100950
#: sum' |R|^-5 = 4 zeta(5/2) beta(5/2).
LATTICE_SUM_5 = 5.090258233665482
#: -sum' |R|^-1 continued analytically, -4 zeta(1/2) beta(1/2): the square lattice's
#: constant.
MADELUNG = 3.900264920001956

# --- formulas
# -------------------------------------------------------------------------------------


def sphere_contact_radius(
    force: float, radius: float, effective_modulus: float
) -> float:
    """a = (3 F R / (4 E*))^(1/3) in m, of a single sphere."""
    return math.cbrt(3 * force * radius / (4 * effective_modulus))


def sphere_contact_radius_periodic(
    force: float, radius: float, effective_modulus: float, period: float
) -> float:
    """Contact radius a of each sphere of a square lattice, `period` apart.

    The smallest root of F = (4/3) E* a^3 K + (64/15) E* B a^5 with
        K = 1/R + F/(pi E*) [S_3/(2 L^3) + (9/20) S_5 a^2/L^5],  B = F/(pi E*) (9/64)
        S_5/L^5.
    The first omitted terms are of order (a/L)^7: 2e-5 of the area at a/L = 0.2, 2e-4 at
    0.25.
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

    from scipy.optimize import (
        brentq,
    )  # takes a second to load, and every command loads this module

    return float(brentq(excess, 0.0, free * (1 + 1e-12), xtol=1e-15 * free, rtol=1e-14))


def cylinder_half_width_periodic(
    force_per_length: float, radius: float, effective_modulus: float, period: float
) -> float:
    """a = (L/pi) arccos(exp(-2 pi R P' / (E* L^2))) in m, of a row of parabolas;
    exact.
    """
    load = 2 * math.pi * radius * force_per_length / (effective_modulus * period**2)
    # arccos(e^-w) = arcsin(sqrt(1 - e^-2w)), which keeps its digits at small loads.
    return period / math.pi * math.asin(math.sqrt(-math.expm1(-2 * load)))


def cylinder_pressure_periodic(
    distance: FloatArray,
    half_width: float,
    radius: float,
    effective_modulus: float,
    period: float,
) -> FloatArray:
    """p = (E* L/(2 pi R)) artanh(sqrt(sin^2 t_a - sin^2 t) / cos t) in Pa, t = pi
    x/L.
    """
    angle = np.pi * np.asarray(distance) / period
    depth = np.sin(math.pi * half_width / period) ** 2 - np.sin(angle) ** 2
    cosine = np.where(depth > 0, np.cos(angle), 1)
    ratio = np.sqrt(np.maximum(depth, 0)) / cosine
    return np.asarray(
        effective_modulus * period / (2 * math.pi * radius) * np.arctanh(ratio)
    )


# --- the closed form
# ------------------------------------------------------------------------------


def _bump(scene: Scene) -> tuple[float, FloatArray, float, float]:
    """Radius (m), distance of each grid point from the summit (m), load (N or N/m),
    E*.
    """
    E = HERTZ.elastic_half_space(scene)
    surface = scene.surface
    curvatures, squares = [], []
    for axis, (n, d, period) in enumerate(
        zip(surface.shape, surface.spacing, surface.periods, strict=True)
    ):
        centre, curvature = _parabola(scene, axis)
        curvatures.append(curvature)
        x = np.arange(n) * d - centre
        squares.append((x - np.rint(x / period) * period) ** 2)
    radius = 1 / curvatures[0]
    round_bump = np.allclose(curvatures, curvatures[0], rtol=1e-6)
    square = len(set(surface.periods)) == 1
    HERTZ.needs(bool(round_bump) and square, "one round bump in a square period")
    force = scene.load.final * math.prod(surface.periods)
    return radius, np.sqrt(sum(np.ix_(*squares))), force, E


def _parabola(scene: Scene, axis: int) -> tuple[float, float]:
    """Summit (m) and curvature (1/m) of the parabola through the highest and its next
    points.
    """
    heights, d = scene.surface.heights, scene.surface.spacing[axis]
    summit = np.unravel_index(int(np.argmax(heights)), heights.shape)
    line = np.moveaxis(heights, axis, -1)[
        tuple(j for a, j in enumerate(summit) if a != axis)
    ]
    i = int(summit[axis])
    before, top, after = line[i - 1], line[i], line[(i + 1) % line.size]
    second = (after - 2 * top + before) / d**2
    first = (after - before) / (2 * d)
    HERTZ.needs(bool(second < 0), "one round bump in a square period")
    return i * d - first / second, -second


@HERTZ.gives("area.total")
def _bump_fraction(scene: Scene) -> float:
    radius, _, force, E = _bump(scene)
    period = scene.surface.periods[0]
    if scene.surface.heights.ndim == 1:
        return 2 * cylinder_half_width_periodic(force, radius, E, period) / period
    return (
        math.pi
        * sphere_contact_radius_periodic(force, radius, E, period) ** 2
        / period**2
    )


def _pressure_at(scene: Scene, distance: FloatArray) -> FloatArray:
    """Pressure at distances from the summit.  On a surface it is the semi-ellipse that
    carries the load on the area of the periodic problem; the images change it by less
    than (a/L)^5.
    """
    radius, _, force, E = _bump(scene)
    share, period = _bump_fraction(scene), scene.surface.periods[0]
    if scene.surface.heights.ndim == 1:
        return cylinder_pressure_periodic(
            distance, share * period / 2, radius, E, period
        )
    a = period * math.sqrt(share / math.pi)
    peak = 3 * force / (2 * math.pi * a**2)
    return np.asarray(peak * np.sqrt(np.maximum(1 - (distance / a) ** 2, 0)))


HERTZ.gives("field.pressure")(lambda scene: _pressure_at(scene, _bump(scene)[1]))
HERTZ.gives("quantity.largest_pressure")(
    lambda scene: _pressure_at(scene, np.zeros(1))[0]
)
