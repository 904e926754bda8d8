"""The memory of a task, estimated from its recipe before the surface is made.

The formulas are those by which the solvers themselves refuse a scene.  Here they decide how many
solves a machine makes side by side, and which solves a worker of a cluster is not asked to do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from epcontact.bem.memory import bytes_per_point
from epcontact.materials.moduli import effective_modulus
from epcontact.scene import Body, Load, Material, Scene, Surface
from epcontact.surfaces import Recipe, SelfAffine

#: The estimate of a method in bytes, beside the process and its libraries.
Estimate = Callable[[Recipe, Material, Body, Load, Mapping[str, Any]], float]

_PROCESS = 2**28  # bytes of a process with its libraries
_SMALL, _MOST = 2**14, 2**15  # below so many points a solve takes at most so many bytes a point


def of_task(
    estimate: Estimate,
    recipe: Recipe,
    scene: tuple[Material, Body, Load],
    options: Mapping[str, Any],
) -> float:
    """Return the bytes of a process that solves a scene; a rough bound for small grids."""
    points = math.prod(recipe.shape)
    needed = _MOST * points if points < _SMALL else estimate(recipe, *scene, options)
    return _PROCESS + needed


def of_surface(recipe: Recipe, *_: Any) -> float:
    """Estimate the bytes of a method that needs little more than the heights and their modes."""
    return 32.0 * math.prod(recipe.shape)


def of_grid(recipe: Recipe, material: Material, _: Body, load: Load, *__: Any) -> float:
    """Estimate the bytes of the boundary elements, heights included."""
    stiffness = effective_modulus(material) * _slope(recipe)
    pressure = load.final or max(load.path)
    return (8 + bytes_per_point(pressure, material.hardness, stiffness)) * math.prod(recipe.shape)


def of_block(
    recipe: Recipe, material: Material, body: Body, load: Load, options: Mapping[str, Any]
) -> float:
    """Estimate the bytes of the finite elements."""
    from fem_check.mesh import block_for, bytes_needed  # loads solvers
    from fem_check.options import FemOptions

    flat = Scene(Surface(np.zeros(recipe.shape), recipe.periods), material, load, body)
    given = FemOptions(**options)
    return bytes_needed(flat, given, block_for(flat, given), _slope(recipe))


def _slope(recipe: Recipe) -> float:
    return recipe.spectrum.rms_slope if isinstance(recipe, SelfAffine) else 0.0
