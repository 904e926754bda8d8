"""Elastic contact of sinusoidal waviness with a rigid flat.

One direction, h(x) = h (1 + cos(2 pi x/lambda)) up to a constant: Westergaard (1939), in the
form of Johnson, International Journal of Solids and Structures 32 (1995) 423.  Exact.
Two directions, h (1 + cos cos): the asymptotes of Johnson, Greenwood and Higginson,
International Journal of Mechanical Sciences 27 (1985) 383; no closed form is known between.

Symbols: h = amplitude (m; half the distance from valley to crest of the line), lambda =
wavelength (m), E* = effective_modulus (Pa), p* = pressure of complete contact (Pa),
s = mean pressure / p*, psi = pi x/lambda with x measured from a crest, a = half-width of a
contact.  Results hold for 0 <= s <= 1.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import xlogy

from epcontact.results import FloatArray


def line_complete_pressure(amplitude: float, wavelength: float, effective_modulus: float) -> float:
    """p* = pi E* h / lambda in Pa: the mean pressure at which no gap is left."""
    return math.pi * effective_modulus * amplitude / wavelength


def line_contact_fraction(load: float) -> float:
    """2 a/lambda = (2/pi) arcsin(sqrt(s)), with load s = mean pressure / p*."""
    return 2 / math.pi * math.asin(math.sqrt(load))


def line_load(contact_fraction: float) -> float:
    """s = sin^2(pi a/lambda); the inverse of `line_contact_fraction`."""
    return math.sin(math.pi * contact_fraction / 2) ** 2


def line_pressure(position: FloatArray, load: float) -> FloatArray:
    """p/p* = 2 cos(psi) sqrt(s - sin^2 psi) in contact, 0 elsewhere.

    position: x/lambda from a crest, any shape.  This is (2 p_mean cos psi / sin^2 psi_a)
    sqrt(sin^2 psi_a - sin^2 psi) with sin^2 psi_a = s.
    """
    angle = np.pi * (np.asarray(position) - np.rint(position))
    depth = np.maximum(load - np.sin(angle) ** 2, 0)
    return np.asarray(2 * np.cos(angle) * np.sqrt(depth))


def line_gap(position: FloatArray, load: float) -> FloatArray:
    """g/h at positions x/lambda (any shape) from a crest: zero in contact.

    The slope dg/dx = (2 pi h/lambda) 2 cos(psi) sqrt(sin^2 psi - s) continues the pressure
    analytically; integrated from the rim, with S = |sin psi|,
    g/h = 2 [S sqrt(S^2 - s) - s arccosh(S/sqrt(s))].
    """
    sine = np.abs(np.sin(np.pi * (np.asarray(position) - np.rint(position))))
    if load == 0:
        return np.asarray(2 * sine**2)
    ratio = np.maximum(sine / math.sqrt(load), 1)
    return np.asarray(2 * load * (ratio * np.sqrt(ratio**2 - 1) - np.arccosh(ratio)))


def line_mean_gap(load: float) -> float:
    """Mean gap / h = 1 - s + s ln s."""
    return 1 - load + float(xlogy(load, load))


def line_energy(load: float) -> float:
    """Elastic energy per nominal area / (h p*) = s^2 (1/4 - ln(s)/2).

    It is the work of the load, the integral of p_mean d(approach) with the approach measured by
    the mean gap: U' = s d(1 - mean gap) = -s ln(s) ds.
    """
    return load**2 / 4 - float(xlogy(load**2, load)) / 2


def surface_complete_pressure(
    amplitude: float, wavelength: float, effective_modulus: float
) -> float:
    """p* = sqrt(2) pi E* h / lambda in Pa for the surface h (1 + cos(2 pi x/lambda)
    cos(2 pi y/lambda)), h = amplitude."""
    return math.sqrt(2) * math.pi * effective_modulus * amplitude / wavelength


def surface_contact_fraction_light(load: float) -> float:
    """Contact fraction pi (3 s/(8 pi))^(2/3), in the limit s -> 0.

    The period lambda^2 of cos cos holds two crests, each of curvature (2 pi/lambda)^2 h and each
    a Hertzian contact that carries half of the load.
    """
    return math.pi * float((3 * load / (8 * math.pi)) ** (2 / 3))


def surface_contact_fraction_heavy(load: float) -> float:
    """Contact fraction 1 - (3/(2 pi)) (1 - s), in the limit s -> 1.

    The gaps that are left are penny-shaped cracks without stress intensity: two of radius b a
    period, b^2 = 3 (1 - s) lambda^2/(4 pi^2).
    """
    return 1 - 3 / (2 * math.pi) * (1 - load)
