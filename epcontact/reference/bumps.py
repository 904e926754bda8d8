"""Hertzian contact of one round bump per period: formulas and a closed form.

A parabola, of height -r^2/(2 R), is pressed by a rigid flat.  Symbols: F = force (N),
P' = force per length (N/m), R = radius (m), E* = effective_modulus (Pa), a = contact
radius or half-width (m), L = period (m).

Sources: Johnson, Contact Mechanics (1985), sections 3.4, 4.2 and appendix 3.  The
periodic results are derived here:

sphere    A neighbour at distance d lowers the surface by F/(pi E* d).  The sum over the
          square lattice of images is, up to a constant and to terms in cos(4 theta),
              F/(pi E*) [S_3 r^2/4 + (9/64) S_5 (r^4 + 4 r^2 <y^2>)],  <y^2> = 2 a^2/5,
          with S_n = sum' |R|^-n.  The quadratic part adds to the curvature.  The
          quartic part B r^4 needs the additional force (64/15) E* B a^5 (Sneddon 1965).
          To leading order
              1/R_eff = (1/R) (1 + 1.917 (a/L)^3).
cylinder  The kernel of a periodic row is -(2/(pi E*)) ln|2 sin(pi x/L)|.  Building the
          contact up from periodic flat punches gives an Abel equation in sin^2(pi x/L)
          with the closed solution P' = -(E* L^2/(2 pi R)) ln cos(pi a/L).  To leading
          order
              1/R_eff = (1/R) (1 + (pi^2/6) (a/L)^2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

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
#: -sum' |R|^-1 continued analytically, -4 zeta(1/2) beta(1/2): Madelung's constant of
#: the square lattice.
MADELUNG = 3.900264920001956

# --- formulas


def sphere_contact_radius(
    force: float, radius: float, effective_modulus: float
) -> float:
    """Return a = (3 F R / (4 E*))^(1/3) in m, the contact radius of a single sphere.

    Args:
        force: F in N.
        radius: R in m.
        effective_modulus: E* in Pa.
    """
    return math.cbrt(3 * force * radius / (4 * effective_modulus))


def sphere_contact_radius_periodic(
    force: float, radius: float, effective_modulus: float, period: float
) -> float:
    """Return the contact radius a in m of each sphere of a square lattice.

    It is the smallest root of F = (4/3) E* a^3 K + (64/15) E* B a^5 with
        K = 1/R + F/(pi E*) [S_3/(2 L^3) + (9/20) S_5 a^2/L^5],
        B = F/(pi E*) (9/64) S_5/L^5.
    The first omitted terms are of order (a/L)^7: 2e-5 of the area at a/L = 0.2, 2e-4 at
    0.25.

    Args:
        force: F on one sphere in N.
        radius: R in m.
        effective_modulus: E* in Pa.
        period: Distance L of neighbours in m.
    """
    # scipy.optimize takes a second to load, and every command loads this module.
    from scipy.optimize import brentq

    single = sphere_contact_radius(force, radius, effective_modulus)
    strength = force / (math.pi * effective_modulus)

    def excess(a: float) -> float:
        """Return the force that a contact of radius a in m carries, over F, less 1."""
        curvature = 1 / radius + strength * (
            LATTICE_SUM_3 / (2 * period**3) + 0.45 * LATTICE_SUM_5 * a**2 / period**5
        )
        quartic = strength * 9 / 64 * LATTICE_SUM_5 / period**5
        carried = 4 / 3 * a**3 * curvature + 64 / 15 * quartic * a**5
        return effective_modulus * carried / force - 1

    largest = single * (1 + 1e-12)
    return float(brentq(excess, 0.0, largest, xtol=1e-15 * single, rtol=1e-14))


def cylinder_half_width_periodic(
    force_per_length: float, radius: float, effective_modulus: float, period: float
) -> float:
    """Return the exact half-width in m of the contacts of a row of parabolas.

    It is a = (L/pi) arccos(exp(-2 pi R P' / (E* L^2))).

    Args:
        force_per_length: P' on one parabola, in N/m.
        radius: R of the summits, in m.
        effective_modulus: E* in Pa.
        period: L, the distance of neighbours, in m.
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
    """Return the pressure in Pa under a row of parabolas, with t = pi x/L:

        p = (E* L/(2 pi R)) artanh(sqrt(sin^2 t_a - sin^2 t) / cos t)

    It is 0 outside of the contact, whose rim is at t_a = pi a/L.

    Args:
        distance: x from a crest in m, of any shape.
        half_width: a of the contact, in m.
        radius: R of the summits, in m.
        effective_modulus: E* in Pa.
        period: L, the distance of neighbours, in m.
    """
    angle = np.pi * np.asarray(distance) / period
    depth = np.sin(math.pi * half_width / period) ** 2 - np.sin(angle) ** 2
    cosine = np.where(depth > 0, np.cos(angle), 1)
    ratio = np.sqrt(np.maximum(depth, 0)) / cosine
    scale = effective_modulus * period / (2 * math.pi * radius)
    return np.asarray(scale * np.arctanh(ratio))


# --- the closed form


@dataclass(frozen=True)
class _Bump:
    """One round bump per period, as measured on the heights of a scene.

    Attributes:
        radius: R in m.
        distance: Distance of each grid point from the summit in m, of the grid's shape.
        force: Load on one bump in N, of a line in N/m.
        modulus: E* in Pa.
        period: L in m.
    """

    radius: float
    distance: FloatArray
    force: float
    modulus: float
    period: float

    @classmethod
    def of(cls, scene: Scene) -> _Bump:
        """Return the bump that is measured on the heights of a scene.

        Raises:
            InvalidCase: The scene is no elastic half-space with one round bump in a
                square period.
        """
        modulus = HERTZ.elastic_half_space(scene)
        surface = scene.surface
        curvatures = []
        squares = []
        for axis, period in enumerate(surface.periods):
            spacing = surface.spacing[axis]
            centre, curvature = _parabola(scene, axis)
            curvatures.append(curvature)
            x = np.arange(surface.shape[axis]) * spacing - centre
            squares.append((x - np.rint(x / period) * period) ** 2)
        is_round = np.allclose(curvatures, curvatures[0], rtol=1e-6)
        is_square = len(set(surface.periods)) == 1
        HERTZ.require(is_round and is_square, _DESCRIBED)
        return cls(
            radius=1 / curvatures[0],
            distance=np.sqrt(sum(np.ix_(*squares))),
            force=scene.load.final * math.prod(surface.periods),
            modulus=modulus,
            period=surface.periods[0],
        )


#: The scenes that the closed form describes.
_DESCRIBED = "one round bump in a square period"


def _parabola(scene: Scene, axis: int) -> tuple[float, float]:
    """Return position (m) and curvature (1/m) of the bump's summit along one axis.

    They are those of the parabola through the highest point and its two neighbours.

    Args:
        scene: Whose heights are measured.
        axis: 0 for x or 1 for y.

    Raises:
        InvalidCase: This parabola has no summit.
    """
    heights = scene.surface.heights
    spacing = scene.surface.spacing[axis]
    summit = np.unravel_index(int(np.argmax(heights)), heights.shape)
    line = np.moveaxis(heights, axis, -1)
    for other, index in enumerate(summit):
        if other != axis:
            line = line[index]
    i = int(summit[axis])
    before = line[i - 1]
    top = line[i]
    after = line[(i + 1) % line.size]
    second = (after - 2 * top + before) / spacing**2
    first = (after - before) / (2 * spacing)
    HERTZ.require(bool(second < 0), _DESCRIBED)
    return i * spacing - first / second, -second


@HERTZ.gives("area.total")
def _contact_fraction(scene: Scene) -> float:
    """Return the contact area of Hertz's bump as a fraction of the nominal area.

    Raises:
        InvalidCase: The scene is no elastic half-space with one round bump in a square
            period.
    """
    bump = _Bump.of(scene)
    arguments = (bump.force, bump.radius, bump.modulus, bump.period)
    if scene.surface.heights.ndim == 1:
        return 2 * cylinder_half_width_periodic(*arguments) / bump.period
    a = sphere_contact_radius_periodic(*arguments)
    return math.pi * a**2 / bump.period**2


def _pressure_at(scene: Scene, distance: FloatArray) -> FloatArray:
    """Return the pressure in Pa at given distances from the bump's summit.

    Under a sphere it is the semi-ellipse that carries the load on the contact area of
    the periodic problem; the images change it by less than (a/L)^5, with the contact
    radius a and the period L.

    Args:
        scene: The surface, the material and the load; the last load is used.
        distance: In m, of any shape.

    Raises:
        InvalidCase: The scene is no elastic half-space with one round bump in a square
            period.
    """
    bump = _Bump.of(scene)
    fraction = _contact_fraction(scene)
    if scene.surface.heights.ndim == 1:
        half_width = fraction * bump.period / 2
        return cylinder_pressure_periodic(
            distance, half_width, bump.radius, bump.modulus, bump.period
        )
    a = bump.period * math.sqrt(fraction / math.pi)
    peak = 3 * bump.force / (2 * math.pi * a**2)
    return np.asarray(peak * np.sqrt(np.maximum(1 - (distance / a) ** 2, 0)))


@HERTZ.gives("field.pressure")
def _pressure(scene: Scene) -> FloatArray:
    """Return Hertz's pressure in Pa at each grid point of the scene.

    Raises InvalidCase if the scene has no round bump on an elastic half-space.
    """
    return _pressure_at(scene, _Bump.of(scene).distance)


@HERTZ.gives("quantity.largest_pressure")
def _largest_pressure(scene: Scene) -> float:
    """Return Hertz's pressure at the summit of the scene's bump, in Pa.

    Raises InvalidCase if the scene has no round bump on an elastic half-space.
    """
    return float(_pressure_at(scene, np.zeros(1))[0])
