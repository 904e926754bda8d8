"""Yield of perfectly plastic solids under contact and pressure: onset, a limit, a
cavity, and fits.

Y = yield_stress (Pa, uniaxial), nu = poisson_ratio, E* = effective_modulus (Pa), R =
radius (m), a = contact radius (m), p_0 = peak and p_m = mean contact pressure (Pa).
The fits are to finite elements, not closed forms: at equal load their areas differ by
up to 7 %.
"""

import math

from scipy.optimize import minimize_scalar

Triple = tuple[float, float, float]


def sphere_axis_stresses(depth, nu):
    """(sigma_r, sigma_z)/p_0 on the axis of a Hertzian sphere contact at z/a = depth,
    tension positive; the hoop stress is sigma_r.  Johnson (1985), equations 3.45.
    """
    axial = -1 / (1 + depth**2)
    return -(1 + nu) * (1 - depth * math.atan2(1, depth)) - axial / 2, axial


def sphere_onset(nu):
    """(p_0/Y, z/a) at first yield under a sphere, von Mises and Tresca alike, on the
    axis.
    """

    def negative_stress(depth):
        radial, axial = sphere_axis_stresses(depth, nu)
        return axial - radial

    options = {"xatol": 1e-9}
    best = minimize_scalar(
        negative_stress, bounds=(0, 1), method="bounded", options=options
    )
    return -1 / float(best.fun), float(best.x)


def sphere_onset_force(radius, modulus, yield_stress, nu):
    """F = (pi^3 R^2/(6 E*^2)) p_0^3 in N with p_0 from `sphere_onset`."""
    return (
        math.pi**3
        * radius**2
        * (sphere_onset(nu)[0] * yield_stress) ** 3
        / (6 * modulus**2)
    )


def thick_sphere_pressure(c, a, b, yield_stress):
    """Inner pressure in Pa at which a hollow sphere of radii a to b has yielded out to
    c.

    c = a is the onset, c = b the collapse, 2 Y ln(b/a).  Hill (1950), chapter 5.
    """
    return 2 * yield_stress * (math.log(c / a) + (1 - (c / b) ** 3) / 3)


def cavity_mean_pressure(a, radius, young, Y, nu):
    """Johnson's expanding cavity (1985, section 6.3): mean pressure in Pa under a
    sphere.

    A core of radius a, p_m = Y [2/3 + 2 ln(c/a)], whose volume feeds an elastic-plastic
    sphere of radius c.  Validity: between the onset and full plasticity.
    """
    cubed = (young * a / (Y * radius) + 4 * (1 - 2 * nu)) / (6 * (1 - nu))
    return 2 / 3 * Y * (1 + math.log(cubed))


# Fits to finite elements: (interference, force, area) at first yield, and (force, area)
# over these at the interference x over its critical value.


def _hertz(ratio, radius, modulus):
    w = (math.pi * ratio / 2) ** 2 * radius
    return w, 4 / 3 * modulus * math.sqrt(radius) * w**1.5, math.pi * radius * w


def kogut_etsion_critical(radius, modulus, yield_stress, nu):
    """Journal of Applied Mechanics 69 (2002) 657: K = 0.454 + 0.41 nu, H = 2.8 Y."""
    return _hertz((0.454 + 0.41 * nu) * 2.8 * yield_stress / modulus, radius, modulus)


def kogut_etsion(x, nu):
    """A fit in pieces, discontinuous by up to 8 % at its joints; beyond 110 full
    plasticity.
    """
    if x <= 1:
        return x**1.5, x
    if x <= 6:
        return 1.03 * x**1.425, 0.93 * x**1.136
    if x <= 110:
        return 1.40 * x**1.263, 0.94 * x**1.146
    return 3 * x / (0.454 + 0.41 * nu), 2 * x


def jackson_green_critical(radius, modulus, yield_stress, nu):
    """Journal of Tribology 127 (2005) 343: C = 1.295 e^(0.736 nu)."""
    return _hertz(
        1.295 * math.exp(0.736 * nu) * yield_stress / modulus, radius, modulus
    )


def jackson_green(x, radius, modulus, yield_stress, nu):
    """Hertz for x <= 1.9.  Beyond it the hardness falls with a/R; fitted for a/R <=
    0.41.
    """
    if x <= 1.9:
        return x**1.5, x
    critical = jackson_green_critical(radius, modulus, yield_stress, nu)
    area = x * (x / 1.9) ** (0.14 * math.exp(23 * yield_stress / modulus))
    slope = math.sqrt(area * critical[2] / math.pi) / radius
    hardness = 2.84 * (1 - math.exp(-0.82 * slope**-0.7))
    plastic = (
        4
        * hardness
        / (1.295 * math.exp(0.736 * nu))
        * (1 - math.exp(-(x ** (5 / 9)) / 25))
    )
    return math.exp(-(x ** (5 / 12)) / 4) * x**1.5 + plastic * x, area
