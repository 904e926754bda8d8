"""Flat punches without friction on an elastic half-space.

Symbols: F = force (N), P' = force per length (N/m), a = radius or half-width (m), E* =
effective_modulus (Pa), L = period (m).  Source: Johnson, Contact Mechanics (1985), sections
2.8 and 3.4; the periodic strip is Westergaard's stress function for a row of cracks (1939).
The pressure is singular at the rim: where it is capped, plastic flow starts there at any load.
"""

from __future__ import annotations

import math

import numpy as np

from epcontact.results import FloatArray


def circular_approach(force: float, punch_radius: float, effective_modulus: float) -> float:
    """delta = F / (2 a E*) in m, against points far away."""
    return force / (2 * punch_radius * effective_modulus)


def circular_force(approach: float, punch_radius: float, effective_modulus: float) -> float:
    """F = 2 a E* delta in N; the inverse of the above."""
    return 2 * punch_radius * effective_modulus * approach


def circular_energy(approach: float, punch_radius: float, effective_modulus: float) -> float:
    """U = a E* delta^2 in J."""
    return punch_radius * effective_modulus * approach**2


def circular_pressure(distance: FloatArray, force: float, punch_radius: float) -> FloatArray:
    """p = F/(2 pi a^2) (1 - r^2/a^2)^(-1/2) in Pa; 0 outside; infinite at r = a."""
    return _punch(distance, punch_radius, force / (2 * math.pi * punch_radius**2))


def strip_pressure(distance: FloatArray, force_per_length: float, half_width: float) -> FloatArray:
    """p = P' / (pi sqrt(a^2 - x^2)) in Pa; 0 outside; infinite at |x| = a."""
    return _punch(distance, half_width, force_per_length / (math.pi * half_width))


def strip_pressure_periodic(
    distance: FloatArray, force_per_length: float, half_width: float, period: float
) -> FloatArray:
    """p = (P'/L) cos(t) (sin^2 t_a - sin^2 t)^(-1/2), t = pi x/L, in Pa, for |x| <= L/2."""
    angle = np.pi * np.asarray(distance) / period
    depth = math.sin(math.pi * half_width / period) ** 2 - np.sin(angle) ** 2
    with np.errstate(divide="ignore"):
        inside = np.cos(angle) / np.sqrt(np.maximum(depth, 0))
    return np.asarray(np.where(depth >= 0, force_per_length / period * inside, 0.0))


def _punch(distance: FloatArray, size: float, centre_pressure: float) -> FloatArray:
    depth = 1 - (np.asarray(distance) / size) ** 2
    with np.errstate(divide="ignore"):
        inside = centre_pressure / np.sqrt(np.maximum(depth, 0))
    return np.asarray(np.where(depth >= 0, inside, 0.0))
