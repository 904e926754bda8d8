"""Rough surfaces: their recipes, spectra and filters.

A recipe is frozen and cheap.  Its `fingerprint`, `shape` and `periods` identify the
surface in a scene's digest before any heights exist, and `build()` makes the `Surface`.
The same classes check the table [surface] of a case file, which selects one by its
`kind`.

    self_affine     random phases on an analytic spectrum
    shapes          sinusoids, paraboloid, sphere, flat punch
    measured        heights from an array, a file or a result
    treatment       holes, form, edges and band of measured maps
    readers         the file formats
    text_tables     tables of numbers in text files
    height_map      the heights of a file, and maps from lists of points
    spectrum        analytic spectra: densities and moments in closed form
    power_spectrum  spectrum, moments and statistics of any heights, and filters
"""

from epcontact.surfaces.measured import (
    Facing,
    HeightsFromArray,
    HeightsFromFile,
    Mirrored,
    residual_surface,
)
from epcontact.surfaces.power_spectrum import (
    Topography,
    filtered,
    power_by_octave,
    topography,
)
from epcontact.surfaces.recipe import Recipe, SurfaceAbsent, require_room, unit_of
from epcontact.surfaces.self_affine import SelfAffine, SelfAffineEnsemble, grid_shape
from epcontact.surfaces.shapes import FlatPunch, Paraboloid, Sinusoid, Sphere
from epcontact.surfaces.treatment import Treatment

#: The registry: every form of the table [surface] of a case file, selected by its
#: `kind`.
CaseSurface = (
    SelfAffineEnsemble | Sinusoid | Paraboloid | Sphere | FlatPunch | HeightsFromFile
)


def recipes_of(surface: CaseSurface) -> tuple[Recipe, ...]:
    """Return the recipes of all surfaces of a case file's table [surface].

    An ensemble has one recipe for each seed.  Any other table is a recipe itself, or,
    for a file of heights that are mirrored, the recipe of the mirrored map.

    Example:
        >>> len(recipes_of(Paraboloid((1e-3,), (8,), radius=1e-2)))
        1
    """
    if isinstance(surface, SelfAffineEnsemble):
        return surface.recipes()
    if isinstance(surface, HeightsFromFile) and surface.treatment == "mirrored":
        return (Mirrored(surface),)
    return (surface,)


__all__ = [
    "CaseSurface",
    "Facing",
    "FlatPunch",
    "HeightsFromArray",
    "HeightsFromFile",
    "Mirrored",
    "Paraboloid",
    "Recipe",
    "SelfAffine",
    "SelfAffineEnsemble",
    "Sinusoid",
    "Sphere",
    "SurfaceAbsent",
    "Topography",
    "Treatment",
    "filtered",
    "grid_shape",
    "power_by_octave",
    "recipes_of",
    "require_room",
    "residual_surface",
    "topography",
    "unit_of",
]
