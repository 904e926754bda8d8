"""Elastic moduli of contact.

The finite elements do not use this module: they are an independent check and have their
own.
"""

from __future__ import annotations

from dataclasses import replace

from epcontact.scene import Material


def effective_modulus(material: Material) -> float:
    """The effective modulus E* = E / (1 - nu^2) in Pa, against a rigid counterface."""
    return material.young_modulus / (1 - material.poisson_ratio**2)


def of_both(material: Material, counterface: Material) -> Material:
    """The body that has the E* of two half-spaces, and the strengths of the first,
    which flows.
    """
    compliance = sum(1 / effective_modulus(body) for body in (material, counterface))
    return replace(material, young_modulus=(1 - material.poisson_ratio**2) / compliance)


def oedometric_modulus(material: Material) -> float:
    """The modulus of uniaxial strain M = E (1 - nu) / ((1 + nu)(1 - 2 nu)) in Pa."""
    nu = material.poisson_ratio
    return material.young_modulus * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
