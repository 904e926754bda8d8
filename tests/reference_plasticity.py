"""Yield of solids under contact and pressure: onset, limit loads, cavities, and fits.

All solids are perfectly plastic.  Symbols: Y = yield_stress (Pa, uniaxial), k = shear yield
(Y/sqrt 3 by von Mises, Y/2 by Tresca), nu = poisson_ratio, E = young_modulus, E* =
effective_modulus (Pa), R = radius (m), a = contact radius (m), p_0 = peak and p_m = mean
contact pressure (Pa).

Exact within their model: onset, thick sphere and cylinder, Prandtl's strip.  Rigorous bounds:
the circular punch.  A model: Johnson's cavity.  Fits to finite elements, not closed forms:
Kogut and Etsion, Jackson and Green; at equal load their areas differ by up to 7 %.
"""

from __future__ import annotations

import math
from typing import Literal

from scipy.optimize import brentq, minimize_scalar

Criterion = Literal["von_mises", "tresca"]


def shear_yield(yield_stress: float, criterion: Criterion = "von_mises") -> float:
    """k in Pa: Y/sqrt 3 by von Mises, Y/2 by Tresca."""
    return yield_stress / (2 if criterion == "tresca" else math.sqrt(3))


# Onset of yield ----------------------------------------------------------------------------


def sphere_axis_stresses(depth: float, poisson_ratio: float) -> tuple[float, float]:
    """(sigma_r, sigma_z)/p_0 on the axis of a Hertzian sphere contact at z/a = depth.

    Tension positive; the hoop stress is sigma_r.  Johnson (1985), equations 3.45.
    """
    bulge = 1 - depth * math.atan2(1, depth)
    axial = -1 / (1 + depth**2)
    return -(1 + poisson_ratio) * bulge - axial / 2, axial


def sphere_onset(poisson_ratio: float) -> tuple[float, float]:
    """(p_0/Y, z/a) at first yield under a sphere, von Mises and Tresca alike on the axis.

    Validity: 0 <= nu < 0.5; yield starts on the axis for every such nu.
    """

    def negative_stress(depth: float) -> float:
        radial, axial = sphere_axis_stresses(depth, poisson_ratio)
        return axial - radial

    best = minimize_scalar(
        negative_stress, bounds=(0, 1), method="bounded", options={"xatol": 1e-9}
    )
    return -1 / float(best.fun), float(best.x)


def cylinder_axis_stresses(depth: float, poisson_ratio: float) -> tuple[float, float, float]:
    """(sigma_x, sigma_y, sigma_z)/p_0 under the middle of a Hertzian line contact at z/a = depth.

    Tension positive, plane strain along y: sigma_y = nu (sigma_x + sigma_z).  Johnson (1985),
    equations 4.46.
    """
    root = math.sqrt(1 + depth**2)
    across = -((1 + 2 * depth**2) / root - 2 * depth)
    axial = -1 / root
    return across, poisson_ratio * (across + axial), axial


def cylinder_onset(poisson_ratio: float, criterion: Criterion = "von_mises") -> tuple[float, float]:
    """(p_0/Y, z/a) at first yield under a cylinder in plane strain.

    For nu below about 0.16 von Mises puts it at the surface, p_0/Y = 1/(1 - 2 nu).
    Validity: 0 <= nu < 0.5.
    """

    def negative_stress(depth: float) -> float:
        x, y, z = cylinder_axis_stresses(depth, poisson_ratio)
        if criterion == "tresca":
            return -(max(x, y, z) - min(x, y, z))
        return -math.sqrt(((x - y) ** 2 + (y - z) ** 2 + (z - x) ** 2) / 2)

    inside = minimize_scalar(
        negative_stress, bounds=(0.2, 2), method="bounded", options={"xatol": 1e-9}
    )
    candidates = [(float(inside.fun), float(inside.x)), (negative_stress(0.0), 0.0)]
    stress, depth = min(candidates)
    return -1 / stress, depth


def sphere_onset_force(
    radius: float, effective_modulus: float, yield_stress: float, poisson_ratio: float
) -> float:
    """F = (pi^3 R^2/(6 E*^2)) p_0^3 in N with p_0 from `sphere_onset`."""
    peak = sphere_onset(poisson_ratio)[0] * yield_stress
    return math.pi**3 * radius**2 * peak**3 / (6 * effective_modulus**2)


# Limit loads and bodies of revolution --------------------------------------------------------


def strip_limit_pressure(yield_stress: float, criterion: Criterion = "von_mises") -> float:
    """Prandtl (1920): mean pressure (2 + pi) k in Pa under a flat strip in plane strain."""
    return (2 + math.pi) * shear_yield(yield_stress, criterion)


#: Smooth circular punch by Tresca, p_m/k: Shield (1955).
CIRCULAR_PUNCH_TRESCA = 5.69


def circular_punch_bracket(yield_stress: float) -> tuple[float, float]:
    """Rigorous bounds in Pa of the mean limit pressure under a smooth circular punch, von Mises.

    Tresca's hexagon of the same Y lies inside the von Mises circle, and that inside the hexagon
    of Y 2/sqrt 3: the limit lies between 5.69 (Y/2) and 2/sqrt 3 times as much (Shield 1955).
    """
    low = CIRCULAR_PUNCH_TRESCA * yield_stress / 2
    return low, 2 / math.sqrt(3) * low


def thick_sphere_pressure(
    plastic_radius: float, inner_radius: float, outer_radius: float, yield_stress: float
) -> float:
    """Inner pressure in Pa at which a hollow sphere has yielded out to `plastic_radius` c.

    p = 2 Y ln(c/a) + (2 Y/3)(1 - c^3/b^3), a <= c <= b; von Mises and Tresca alike.
    c = a is the onset, c = b the collapse, 2 Y ln(b/a).  Hill (1950), chapter 5.
    """
    a, b, c = inner_radius, outer_radius, plastic_radius
    return 2 * yield_stress * (math.log(c / a) + (1 - (c / b) ** 3) / 3)


def thick_sphere_plastic_radius(
    pressure: float, inner_radius: float, outer_radius: float, yield_stress: float
) -> float:
    """c in m: the inverse of `thick_sphere_pressure`, `inner_radius` below the onset.

    Raises ValueError above the collapse pressure.
    """

    def excess(c: float) -> float:
        return thick_sphere_pressure(c, inner_radius, outer_radius, yield_stress) - pressure

    if excess(inner_radius) >= 0:
        return inner_radius
    if excess(outer_radius) < 0:
        collapse = thick_sphere_pressure(outer_radius, inner_radius, outer_radius, yield_stress)
        raise ValueError(f"pressure is {pressure:g} Pa, above the collapse at {collapse:g} Pa")
    return float(brentq(excess, inner_radius, outer_radius, xtol=1e-15 * outer_radius, rtol=1e-14))


def thick_cylinder_pressure(
    plastic_radius: float,
    inner_radius: float,
    outer_radius: float,
    yield_stress: float,
    criterion: Criterion = "von_mises",
) -> float:
    """Inner pressure in Pa at which a long tube has yielded out to `plastic_radius` c.

    p = 2 k ln(c/a) + k (1 - c^2/b^2).  Exact by Tresca while the axial stress is the middle
    one; by von Mises exact in plane strain of an incompressible solid (nu = 1/2), and at
    collapse (c = b), 2 k ln(b/a), for every nu.  Hill (1950), chapter 5.
    """
    k = shear_yield(yield_stress, criterion)
    a, b, c = inner_radius, outer_radius, plastic_radius
    return k * (2 * math.log(c / a) + 1 - (c / b) ** 2)


def cavity_mean_pressure(
    contact_radius: float,
    radius: float,
    young_modulus: float,
    yield_stress: float,
    poisson_ratio: float,
) -> float:
    """Johnson's expanding cavity (1970; 1985, section 6.3): mean pressure in Pa under a sphere.

    p_m = (2 Y/3) {1 + ln[(E a/(Y R) + 4 (1 - 2 nu))/(6 (1 - nu))]}: a core of radius a under the
    contact, p_m = Y [2/3 + 2 ln(c/a)], whose volume feeds an elastic-plastic sphere of radius c.
    A model: similarity (c/a constant), exact for a cone of slope a/R, is taken over to the
    sphere.  Validity: between the onset and full plasticity, c >= a and p_m below about 3 Y.
    """
    strain = young_modulus * contact_radius / (yield_stress * radius)
    cubed = (strain + 4 * (1 - 2 * poisson_ratio)) / (6 * (1 - poisson_ratio))
    return 2 / 3 * yield_stress * (1 + math.log(cubed))


# Fits to finite elements ---------------------------------------------------------------------


def kogut_etsion_critical(
    radius: float, effective_modulus: float, yield_stress: float, poisson_ratio: float
) -> tuple[float, float, float]:
    """(interference m, force N, area m^2) at first yield in Kogut and Etsion's scaling.

    w_c = (pi K H/(2 E*))^2 R, K = 0.454 + 0.41 nu, H = 2.8 Y; force and area by Hertz.
    Journal of Applied Mechanics 69 (2002) 657.
    """
    ratio = (0.454 + 0.41 * poisson_ratio) * 2.8 * yield_stress / effective_modulus
    interference = (math.pi * ratio / 2) ** 2 * radius
    force = 4 / 3 * effective_modulus * math.sqrt(radius) * interference**1.5
    return interference, force, math.pi * radius * interference


def kogut_etsion(interference: float, poisson_ratio: float) -> tuple[float, float]:
    """(force, area) over their critical values at interference x = w/w_c.

    Hertz for x <= 1; 1.03 x^1.425, 0.93 x^1.136 to 6; 1.40 x^1.263, 0.94 x^1.146 to 110; beyond
    it full plasticity, 3 x/K and 2 x.  A fit in pieces, discontinuous by up to 8 % at its joints.
    """
    x = interference
    if x <= 1:
        return x**1.5, x
    if x <= 6:
        return 1.03 * x**1.425, 0.93 * x**1.136
    if x <= 110:
        return 1.40 * x**1.263, 0.94 * x**1.146
    return 3 * x / (0.454 + 0.41 * poisson_ratio), 2 * x


def jackson_green_critical(
    radius: float, effective_modulus: float, yield_stress: float, poisson_ratio: float
) -> tuple[float, float, float]:
    """(interference m, force N, area m^2) at first yield in Jackson and Green's scaling.

    w_c = (pi C Y/(2 E*))^2 R, C = 1.295 e^(0.736 nu); force and area by Hertz.
    Journal of Tribology 127 (2005) 343.
    """
    ratio = 1.295 * math.exp(0.736 * poisson_ratio) * yield_stress / effective_modulus
    interference = (math.pi * ratio / 2) ** 2 * radius
    force = 4 / 3 * effective_modulus * math.sqrt(radius) * interference**1.5
    return interference, force, math.pi * radius * interference


def jackson_green(
    interference: float,
    radius: float,
    effective_modulus: float,
    yield_stress: float,
    poisson_ratio: float,
) -> tuple[float, float]:
    """(force, area) over their critical values at interference x = w/w_c.

    Hertz for x <= 1.9; beyond it A = x (x/1.9)^B with B = 0.14 e^(23 Y/E*) and
    F = e^(-x^(5/12)/4) x^(3/2) + (4 H_G/(C Y)) (1 - e^(-x^(5/9)/25)) x with
    H_G/Y = 2.84 [1 - exp(-0.82 (a/R)^(-0.7))], pi a^2 the area.  The hardness H_G falls with
    a/R, an effect of finite deformation.  Fitted for a/R <= 0.41.
    """
    x = interference
    if x <= 1.9:
        return x**1.5, x
    critical = jackson_green_critical(radius, effective_modulus, yield_stress, poisson_ratio)
    area = x * (x / 1.9) ** (0.14 * math.exp(23 * yield_stress / effective_modulus))
    slope = math.sqrt(area * critical[2] / math.pi) / radius
    hardness = 2.84 * (1 - math.exp(-0.82 * slope**-0.7))
    c = 1.295 * math.exp(0.736 * poisson_ratio)
    elastic = math.exp(-(x ** (5 / 12)) / 4) * x**1.5
    return elastic + 4 * hardness / c * (1 - math.exp(-(x ** (5 / 9)) / 25)) * x, area
