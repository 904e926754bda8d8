"""Yield of perfectly plastic solids: onset, limit loads, a cavity model, and fits.

In all functions yield_stress is Y, uniaxial in Pa, poisson_ratio is nu,
effective_modulus is E* in Pa, radius is R in m, p_0 is the peak of a contact pressure
and p_m its mean.
The fits are to finite elements, and no closed forms: at equal load their areas differ
by up to 7 %.
"""

import math

from scipy.optimize import minimize_scalar


def sphere_axis_stresses(depth, poisson_ratio):
    """Return (sigma_r, sigma_z)/p_0 on the axis of a Hertzian contact of a sphere.

    p_0 is the largest contact pressure. `depth` is z/a, with the contact radius a;
    tension is positive, and the hoop stress is sigma_r. Johnson (1985), equations 3.45.
    """
    axial = -1 / (1 + depth**2)
    bulk = -(1 + poisson_ratio) * (1 - depth * math.atan2(1, depth))
    return bulk - axial / 2, axial


def sphere_onset(poisson_ratio):
    """Return (p_0/Y, z/a) at first yield under a sphere, which is on the axis.

    p_0 is the largest contact pressure, Y the uniaxial yield stress, z the depth and a
    the contact radius. Von Mises and Tresca agree on the axis.
    """

    def negative_stress(depth):
        """Return (sigma_z - sigma_r)/p_0 at the depth z/a: minus the stress that
        yields.
        """
        radial, axial = sphere_axis_stresses(depth, poisson_ratio)
        return axial - radial

    best = minimize_scalar(
        negative_stress, bounds=(0, 1), method="bounded", options={"xatol": 1e-9}
    )
    return -1 / best.fun, best.x


def sphere_onset_force(radius, effective_modulus, yield_stress, poisson_ratio):
    """Return the force at first yield under a sphere in N: (pi^3 R^2/(6 E*^2)) p_0^3.

    `radius` is R in m, `effective_modulus` is E* in Pa, `yield_stress` is uniaxial in
    Pa; p_0 is the largest pressure at first yield.
    """
    peak = sphere_onset(poisson_ratio)[0] * yield_stress
    return math.pi**3 * radius**2 * peak**3 / (6 * effective_modulus**2)


def thick_sphere_pressure(c, a, b, yield_stress):
    """Return the inner pressure in Pa at which a hollow sphere has yielded out to
    radius `c`.

    `a` and `b` are the inner and the outer radius, in the unit of `c`, with a <= c <=
    b; `yield_stress` is uniaxial in Pa. c = a is the onset, and c = b the collapse, at
    2 Y ln(b/a). Hill (1950), chapter 5.
    """
    return 2 * yield_stress * (math.log(c / a) + (1 - (c / b) ** 3) / 3)


def cavity_mean_pressure(a, radius, young_modulus, yield_stress, poisson_ratio):
    """Return the mean pressure under an elastic-plastic sphere by the cavity model, in
    Pa.

    `a` is the contact radius and `radius` the sphere's, in m; `young_modulus` and
    `yield_stress` are in Pa. A core of radius a under p_m = Y [2/3 + 2 ln(c/a)] feeds
    an elastic-plastic sphere of radius c with its volume. Valid between first yield and
    full plasticity. Johnson (1985), section 6.3.
    """
    strain = young_modulus * a / (yield_stress * radius)
    cubed = (strain + 4 * (1 - 2 * poisson_ratio)) / (6 * (1 - poisson_ratio))
    return 2 / 3 * yield_stress * (1 + math.log(cubed))


# Fits to finite elements.  The critical values are (interference in m, force in N, area
# in m^2) at first yield.  The fits return force and area over these values, at the
# interference x over its critical value.


def _hertz_at(pressure_ratio, radius, effective_modulus):
    """Return (interference in m, force in N, contact area in m^2) of Hertz's sphere at
    p_0.

    `pressure_ratio` is p_0/E*, with p_0 the largest pressure at first yield; `radius`
    is in m and `effective_modulus`, E*, in Pa.
    """
    interference = (math.pi * pressure_ratio / 2) ** 2 * radius
    force = 4 / 3 * effective_modulus * math.sqrt(radius) * interference**1.5
    return interference, force, math.pi * radius * interference


def kogut_etsion_critical(radius, effective_modulus, yield_stress, poisson_ratio):
    """Return (interference in m, force in N, area in m^2) at first yield by Kogut and
    Etsion.

    `radius` is the sphere's in m, `effective_modulus` and `yield_stress` (uniaxial) are
    in Pa. The constants are K = 0.454 + 0.41 nu and H = 2.8 Y: Journal of Applied
    Mechanics 69 (2002) 657.
    """
    peak = (0.454 + 0.41 * poisson_ratio) * 2.8 * yield_stress
    return _hertz_at(peak / effective_modulus, radius, effective_modulus)


def kogut_etsion(x, poisson_ratio):
    """Return (force, area) of a flattened sphere over their values at first yield.

    `x` is the interference over that at first yield. The fit of Kogut and Etsion
    consists of pieces, and jumps by up to 8 % at their joints. Beyond x = 110 the
    contact is fully plastic.
    """
    if x <= 1:
        return x**1.5, x
    if x <= 6:
        return 1.03 * x**1.425, 0.93 * x**1.136
    if x <= 110:
        return 1.40 * x**1.263, 0.94 * x**1.146
    return 3 * x / (0.454 + 0.41 * poisson_ratio), 2 * x


def jackson_green_critical(radius, effective_modulus, yield_stress, poisson_ratio):
    """Return (interference in m, force in N, area in m^2) at first yield by Jackson and
    Green.

    `radius` is the sphere's in m, `effective_modulus` and `yield_stress` (uniaxial) are
    in Pa. The constant is C = 1.295 e^(0.736 nu): Journal of Tribology 127 (2005) 343.
    """
    peak = 1.295 * math.exp(0.736 * poisson_ratio) * yield_stress
    return _hertz_at(peak / effective_modulus, radius, effective_modulus)


def jackson_green(x, radius, effective_modulus, yield_stress, poisson_ratio):
    """Return (force, area) of a flattened sphere over their values at first yield.

    `x` is the interference over that at first yield; the other arguments are those of
    `jackson_green_critical`. The fit of Jackson and Green is Hertz for x <= 1.9. Beyond
    it the hardness falls with a/R, contact radius over sphere radius; the fit holds for
    a/R <= 0.41.
    """
    if x <= 1.9:
        return x**1.5, x
    solid = (radius, effective_modulus, yield_stress, poisson_ratio)
    critical_area = jackson_green_critical(*solid)[2]
    area = x * (x / 1.9) ** (0.14 * math.exp(23 * yield_stress / effective_modulus))
    slope = math.sqrt(area * critical_area / math.pi) / radius
    hardness = 2.84 * (1 - math.exp(-0.82 * slope**-0.7))
    fraction = 1 - math.exp(-(x ** (5 / 9)) / 25)
    plastic = 4 * hardness / (1.295 * math.exp(0.736 * poisson_ratio)) * fraction
    return math.exp(-(x ** (5 / 12)) / 4) * x**1.5 + plastic * x, area
