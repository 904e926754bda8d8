"""Elastic moduli of contact, for every method but the finite elements, which have their own."""

from __future__ import annotations

from epcontact.scene import Material


def effective_modulus(material: Material) -> float:
    """E* = E / (1 - nu^2) in Pa, against a rigid counterface."""
    return material.young_modulus / (1 - material.poisson_ratio**2)


def oedometric_modulus(material: Material) -> float:
    """M = E (1 - nu) / ((1 + nu)(1 - 2 nu)) in Pa: uniaxial strain."""
    nu = material.poisson_ratio
    return material.young_modulus * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
