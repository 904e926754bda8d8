"""Persson's theory of elastic and elastoplastic contact of isotropic rough surfaces.

`solve` solves a scene.  `Theory` gives curves against magnification and pressure.  The
other modules are `elastoplastic` (the equations for areas and pressures), `series` (the
evaluation of their sums), `reduction` (the energy reduction S and the diffusion),
`near_bounds` (an S that depends on the pressure), `roughness` (the moments of a
spectrum), `separation` (elastic energy and gaps), `clipped_pressure` (mean gap, plastic
displacement and elastic energy for the rule `near_bounds`), `validity` (the error of
the theory) and `random_field` (the surfaces for which it is known).
"""

from epcontact.persson.clipped_pressure import Displacements, displacements
from epcontact.persson.driver import solve
from epcontact.persson.elastoplastic import (
    ContactAreas,
    areas,
    pressure_cumulative,
    pressure_density,
)
from epcontact.persson.reduction import EnergyReduction, full_contact_diffusion
from epcontact.persson.roughness import analytic_roughness, roughness_of
from epcontact.persson.theory import (
    MagnificationCurve,
    PressureCurve,
    Theory,
    pressure_curve,
)

__all__ = [
    "ContactAreas",
    "Displacements",
    "EnergyReduction",
    "MagnificationCurve",
    "PressureCurve",
    "Theory",
    "analytic_roughness",
    "areas",
    "displacements",
    "full_contact_diffusion",
    "pressure_cumulative",
    "pressure_curve",
    "pressure_density",
    "roughness_of",
    "solve",
]
