"""Surfaces: recipes that make them, and what can be done to them.

A recipe is frozen and cheap: it has the `fingerprint`, `shape` and `periods` that identify its
surface in a scene's digest before any heights exist, and `build()` makes the `Surface`.

    self_affine   random phases on an analytic spectrum
    shapes        sinusoids, paraboloid, sphere, flat punch
    maps          heights from an array or a file, and what is done if they are not periodic
    readers       the file formats
    filters       the same surface on a finer grid, or without its short waves
"""

from epcontact.surfaces.filters import filtered, refined
from epcontact.surfaces.measured import HeightsFromArray, HeightsFromFile, Treatment
from epcontact.surfaces.recipe import Recipe
from epcontact.surfaces.self_affine import SelfAffine, grid_shape
from epcontact.surfaces.shapes import FlatPunch, Paraboloid, Sinusoid, Sphere

__all__ = [
    "FlatPunch",
    "HeightsFromArray",
    "HeightsFromFile",
    "Paraboloid",
    "Recipe",
    "SelfAffine",
    "Sinusoid",
    "Sphere",
    "Treatment",
    "filtered",
    "grid_shape",
    "refined",
]
