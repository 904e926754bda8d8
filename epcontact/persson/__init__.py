"""Persson's theory of elastic and elastoplastic contact of isotropic rough surfaces.

`solve` answers a scene.  Underneath: `elastoplastic` (areas and pressure distribution in closed
form), `reduction` (the energy reduction S), `roughness` (what is read of a spectrum), `curves`
(tables against magnification and pressure), `separation` (mean gap and elastic energy).
"""

from epcontact.persson.curves import (
    MagnificationCurve,
    PressureCurve,
    magnification_curve,
    pressure_curve,
)
from epcontact.persson.elastoplastic import (
    ContactAreas,
    areas,
    boundary_slopes,
    elastic_force,
    pressure_cumulative,
    pressure_density,
)
from epcontact.persson.reduction import (
    PUBLISHED,
    EnergyReduction,
    reduced_diffusion,
    reduction_factor,
)
from epcontact.persson.roughness import (
    Roughness,
    analytic_roughness,
    roughness_of,
    surface_roughness,
)
from epcontact.persson.separation import (
    TheoryModel,
    elastic_energy,
    flattened_roughness,
    mean_separation,
    pressure_at_separation,
)
from epcontact.persson.solve import (
    scene_magnification_curve,
    scene_pressure_curve,
    solve,
    theory_model,
)

__all__ = [
    "PUBLISHED",
    "ContactAreas",
    "EnergyReduction",
    "MagnificationCurve",
    "PressureCurve",
    "Roughness",
    "TheoryModel",
    "analytic_roughness",
    "areas",
    "boundary_slopes",
    "elastic_energy",
    "elastic_force",
    "flattened_roughness",
    "magnification_curve",
    "mean_separation",
    "pressure_at_separation",
    "pressure_cumulative",
    "pressure_curve",
    "pressure_density",
    "reduced_diffusion",
    "reduction_factor",
    "roughness_of",
    "scene_magnification_curve",
    "scene_pressure_curve",
    "solve",
    "surface_roughness",
    "theory_model",
]
