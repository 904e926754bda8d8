"""Persson's theory of elastic and elastoplastic contact of isotropic rough surfaces.

`solve` answers a scene.  Underneath: `elastoplastic` (areas and pressure distribution in closed
form), `reduction` (the energy reduction S), `roughness` (what is read of a spectrum), `curves`
(columns against magnification and pressure), `tables` (what the reduction does),
`separation` (mean gap and elastic energy) and `hardness` (a hardness that depends on the
magnification, by `moving_wall`).
"""

from epcontact.persson.curves import (
    MagnificationCurve,
    PressureCurve,
    magnification_curve,
    pressure_curve,
)
from epcontact.persson.driver import (
    scene_magnification_curve,
    scene_pressure_curve,
    separation_model,
    solve,
)
from epcontact.persson.elastoplastic import (
    ContactAreas,
    areas,
    boundary_slopes,
    elastic_force,
    pressure_cumulative,
    pressure_density,
)
from epcontact.persson.gamma import gamma_columns
from epcontact.persson.hardness import HardnessCurve, hardness_curve
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
    SeparationModel,
    elastic_energy,
    flattened_roughness,
    mean_separation,
)

__all__ = [
    "PUBLISHED",
    "ContactAreas",
    "EnergyReduction",
    "HardnessCurve",
    "MagnificationCurve",
    "PressureCurve",
    "Roughness",
    "SeparationModel",
    "analytic_roughness",
    "areas",
    "boundary_slopes",
    "elastic_energy",
    "elastic_force",
    "flattened_roughness",
    "gamma_columns",
    "hardness_curve",
    "magnification_curve",
    "mean_separation",
    "pressure_cumulative",
    "pressure_curve",
    "pressure_density",
    "reduced_diffusion",
    "reduction_factor",
    "roughness_of",
    "scene_magnification_curve",
    "scene_pressure_curve",
    "separation_model",
    "solve",
    "surface_roughness",
]
