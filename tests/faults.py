"""Deliberately wrong solvers: each must turn a named gate red.

They stand in for the boundary elements through `--solver faults:<name>`; `epcontact verify`
knows nothing of them.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from epcontact import bem
from epcontact.errors import NotConverged
from epcontact.results import ContactResult
from epcontact.scene import Load, Scene


def honest(scene: Scene) -> ContactResult:
    """No fault: what the others are measured against."""
    return bem.solve(scene)


def stiff(scene: Scene) -> ContactResult:
    """The modulus 5 % too high."""
    material = replace(scene.material, young_modulus=1.05 * scene.material.young_modulus)
    return bem.solve(replace(scene, material=material))


def plane_stress(scene: Scene) -> ContactResult:
    """E in the place of E*: seen only where Poisson's ratio is not zero."""
    material = replace(scene.material, poisson_ratio=0.0)
    return bem.solve(replace(scene, material=material))


def no_cap(scene: Scene) -> ContactResult:
    """The cap lost."""
    return bem.solve(replace(scene, material=replace(scene.material, hardness=math.inf)))


def low_cap(scene: Scene) -> ContactResult:
    """The cap 3 % too low."""
    material = replace(scene.material, hardness=0.97 * scene.material.hardness)
    return bem.solve(replace(scene, material=material))


def upside_down(scene: Scene) -> ContactResult:
    """The sign of the heights flipped."""
    return bem.solve(_reshaped(scene, -scene.surface.heights))


def transposed(scene: Scene) -> ContactResult:
    """Rows taken for columns on the way in, and not turned back."""
    return bem.solve(_reshaped(scene, scene.surface.heights.T))


def shifted(scene: Scene) -> ContactResult:
    """Fields half a wave off: here an eighth of the grid along every direction."""
    result = bem.solve(scene)
    fields = {
        name: np.roll(a, [n // 8 for n in a.shape], range(a.ndim))
        for name, a in result.fields.items()
    }
    return replace(result, fields=fields)


def light(scene: Scene) -> ContactResult:
    """Force not conserved: 2 % of the load lost."""
    load = Load(tuple(0.98 * p for p in scene.load.path))
    return bem.solve(replace(scene, load=load))


def raw_called_corrected(scene: Scene) -> ContactResult:
    """The share of grid points passed off as the area in the continuum limit."""
    result = bem.solve(scene)
    steps = tuple(
        replace(step, areas=dict(step.areas) | {"corrected": step.areas["raw"]})
        for step in result.steps
    )
    return replace(result, steps=steps)


def never_converges(scene: Scene) -> ContactResult:
    """Gives up, and says so."""
    raise NotConverged("the residual stalled at 1e-2", {"gap": 1e-2}, (1.0, 1e-2))


def returns_nonsense(scene: Scene) -> ContactResult:
    """Something else than a result."""
    return {"area": 0.1}  # type: ignore[return-value]


def _reshaped(scene: Scene, heights: np.ndarray) -> Scene:
    return replace(scene, surface=replace(scene.surface, heights=heights, recipe=""))
