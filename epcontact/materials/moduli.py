"""Elastic moduli of contact.

The finite elements do not use this module: they are an independent check and have their
own.
"""

from __future__ import annotations

from dataclasses import replace

from epcontact.scene import Material


def effective_modulus(material: Material) -> float:
    """Return E* = E / (1 - nu^2) in Pa, of a body against a rigid counterface."""
    return material.young_modulus / (1 - material.poisson_ratio**2)


def combined_material(material: Material, counterface: Material) -> Material:
    """Return one material, against a rigid counterface, that replaces two half-spaces.

    Its effective modulus is that of both, 1/E* = sum of (1 - nu^2)/E.  Its hardness,
    yield stress and Poisson's ratio are those of `material`, the body that flows.

    counterface: the material of the other half-space, which stays elastic.
    """
    compliance = 1 / effective_modulus(material) + 1 / effective_modulus(counterface)
    young_modulus = (1 - material.poisson_ratio**2) / compliance
    return replace(material, young_modulus=young_modulus)


def oedometric_modulus(material: Material) -> float:
    """Return the modulus of uniaxial strain (no lateral strain) in Pa.

    It is M = E (1 - nu) / ((1 + nu)(1 - 2 nu)).
    """
    nu = material.poisson_ratio
    return material.young_modulus * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
