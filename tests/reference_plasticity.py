"""Yield of solids under contact and pressure: onset, limit loads, a cavity, and fits.

All solids are perfectly plastic.  Symbols: Y = yield_stress (Pa, uniaxial), k = shear yield
(Y/sqrt 3 by von Mises), nu = poisson_ratio, E = young_modulus, E* = effective_modulus (Pa),
R = radius (m), a = contact radius (m), p_0 = peak and p_m = mean contact pressure (Pa).

Exact within their model: onset, thick sphere, Prandtl's strip.  A model: Johnson's cavity.  Fits to
finite elements, not closed forms: Kogut and Etsion, Jackson and Green; at equal load their areas
differ by up to 7 %.
"""

from __future__ import annotations

import math

from scipy.optimize import minimize_scalar


def sphere_axis_stresses(depth: float, poisson_ratio: float) -> tuple[float, float]:
    """(sigma_r, sigma_z)/p_0 on the axis of a Hertzian sphere contact at z/a = depth.

    Tension positive; the hoop stress is sigma_r.  Johnson (1985), equations 3.45.
    """
    bulge = 1 - depth * math.atan2(1, depth)
    axial = -1 / (1 + depth**2)
    return -(1 + poisson_ratio) * bulge - axial / 2, axial


def sphere_onset(poisson_ratio: float) -> tuple[float, float]:
    """(p_0/Y, z/a) at first yield under a sphere, von Mises and Tresca alike on the axis, where
    yield starts for every 0 <= nu < 0.5."""

    def negative_stress(depth: float) -> float:
        radial, axial = sphere_axis_stresses(depth, poisson_ratio)
        return axial - radial

    options = {"xatol": 1e-9}
    best = minimize_scalar(negative_stress, bounds=(0, 1), method="bounded", options=options)
    return -1 / float(best.fun), float(best.x)


def sphere_onset_force(
    radius: float, effective_modulus: float, yield_stress: float, poisson_ratio: float
) -> float:
    """F = (pi^3 R^2/(6 E*^2)) p_0^3 in N with p_0 from `sphere_onset`."""
    peak = sphere_onset(poisson_ratio)[0] * yield_stress
    return math.pi**3 * radius**2 * peak**3 / (6 * effective_modulus**2)


def strip_limit_pressure(yield_stress: float) -> float:
    """Prandtl (1920): mean pressure (2 + pi) k in Pa under a flat strip in plane strain."""
    return (2 + math.pi) * yield_stress / math.sqrt(3)


def thick_sphere_pressure(
    plastic_radius: float, inner_radius: float, outer_radius: float, yield_stress: float
) -> float:
    """Inner pressure in Pa at which a hollow sphere has yielded out to `plastic_radius` c.

    p = 2 Y ln(c/a) + (2 Y/3)(1 - c^3/b^3), a <= c <= b; von Mises and Tresca alike.
    c = a is the onset, c = b the collapse, 2 Y ln(b/a).  Hill (1950), chapter 5.
    """
    a, b, c = inner_radius, outer_radius, plastic_radius
    return 2 * yield_stress * (math.log(c / a) + (1 - (c / b) ** 3) / 3)


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


def _hertz(ratio: float, radius: float, effective_modulus: float) -> tuple[float, float, float]:
    """(interference, force, area) of a sphere with w = (pi ratio/2)^2 R."""
    w = (math.pi * ratio / 2) ** 2 * radius
    return w, 4 / 3 * effective_modulus * math.sqrt(radius) * w**1.5, math.pi * radius * w


def kogut_etsion_critical(
    radius: float, effective_modulus: float, yield_stress: float, poisson_ratio: float
) -> tuple[float, float, float]:
    """(interference m, force N, area m^2) at first yield in Kogut and Etsion's scaling.

    w_c = (pi K H/(2 E*))^2 R, K = 0.454 + 0.41 nu, H = 2.8 Y; force and area by Hertz.
    Journal of Applied Mechanics 69 (2002) 657.
    """
    ratio = (0.454 + 0.41 * poisson_ratio) * 2.8 * yield_stress / effective_modulus
    return _hertz(ratio, radius, effective_modulus)


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
    return _hertz(ratio, radius, effective_modulus)


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
