"""What a result's own fields say of it, whatever its method claims: the harness's own residuals.

A gate that names `quantity.measured_<name>` has the harness compute it with plain numpy from the
pressure field, the scene's heights and the compliance of `reference.layers`, so that a solver
cannot vouch for itself:

    measured_force       mean(p)/p0 - 1
    measured_bounds      how far p leaves [0, hardness], divided by p0
    measured_gap         the largest violation of the contact conditions on the gap, divided by
                         the rms height: |g| where 0 < p < hardness, -g where p = 0, g where
                         p = hardness (Karush-Kuhn-Tucker)
    measured_raw_total   share of grid points with p > 0, less the raw area that is claimed
    measured_raw_plastic share of grid points at the hardness, less the claimed one
    measured_carried     (int sigma dF + hardness A_pl)/p0 - 1 of the claimed distribution
    smallest_contact_pressure  in Pa, where p > 0

and of the surface that the scene was given, whatever recipe it claims to follow:

    surface_rms_height   in m
    surface_rms_slope    by spectral derivatives
    surface_curvature    in 1/m, at the highest point, by differences, mean over the axes

and of finite elements under J2 how they differ from the boundary elements on the elements' own
compliance: `model_difference` says what model_area, model_overlap, model_distance,
effective_hardness, effective_overlap and elements_area are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection

import numpy as np

from epcontact.errors import InvalidCase
from epcontact.reference.layers import compliance
from epcontact.reference.roughness import rms_slope
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Scene

# A pressure this close to the hardness counts as at it: scaling by p0 and back rounds.
_AT_THE_CAP = 1e-12


def _force(p: FloatArray, scene: Scene, _: ContactResult) -> float:
    return float(p.mean()) / scene.load.final - 1


def _bounds(p: FloatArray, scene: Scene, _: ContactResult) -> float:
    beyond = max(-float(p.min()), float(p.max()) - scene.material.hardness, 0.0)
    return beyond / scene.load.final


def _gap(p: FloatArray, scene: Scene, _: ContactResult) -> float:
    C = compliance(scene)
    C.flat[0] = 0.0
    gap = np.fft.ifftn(C * np.fft.fftn(p)).real - scene.surface.heights
    apart, flowing = p <= 0, p >= scene.material.hardness * (1 - _AT_THE_CAP)
    between = ~apart & ~flowing
    if between.any():
        gap -= gap[between].mean()
    elif flowing.any():
        gap -= gap[flowing].max()
    wrong = np.where(apart, -gap, np.where(flowing, gap, np.abs(gap)))
    return float(wrong.max()) / float(scene.surface.heights.std())


def _raw_total(p: FloatArray, _: Scene, result: ContactResult) -> float:
    return float((p > 0).mean()) - result.final.areas["raw"].total


def _raw_plastic(p: FloatArray, scene: Scene, result: ContactResult) -> float:
    flowing = p >= scene.material.hardness * (1 - _AT_THE_CAP)
    return float(flowing.mean()) - result.final.areas["raw"].plastic


def _carried(_: FloatArray, scene: Scene, result: ContactResult) -> float:
    found = result.distribution
    if found is None:
        raise InvalidCase(f"{result.method} gives no pressure distribution for a gate")
    middle = (found.pressure[1:] + found.pressure[:-1]) / 2
    carried = float(np.sum(middle * np.diff(found.cumulative)))
    if math.isfinite(scene.material.hardness):
        carried += scene.material.hardness * found.plastic
    return carried / scene.load.final - 1


def _smallest(p: FloatArray, _: Scene, __: ContactResult) -> float:
    return float(p[p > 0].min()) if (p > 0).any() else 0.0


def _rms_height(scene: Scene) -> float:
    return float(scene.surface.heights.std())


def _summit_curvature(scene: Scene) -> float:
    heights, curvatures = scene.surface.heights, []
    summit = np.unravel_index(int(np.argmax(heights)), heights.shape)
    for axis, d in enumerate(scene.surface.spacing):
        beside = [np.roll(heights, shift, axis)[summit] for shift in (1, -1)]
        curvatures.append((2 * heights[summit] - sum(beside)) / d**2)
    return float(np.mean(curvatures))


SURFACE_MEASURES: dict[str, Callable[[Scene], float]] = {
    "surface_rms_height": _rms_height,
    "surface_rms_slope": rms_slope,
    "surface_curvature": _summit_curvature,
}
FIELD_MEASURES: dict[str, Callable[[FloatArray, Scene, ContactResult], float]] = {
    "measured_force": _force,
    "measured_bounds": _bounds,
    "measured_gap": _gap,
    "measured_raw_total": _raw_total,
    "measured_raw_plastic": _raw_plastic,
    "measured_carried": _carried,
    "smallest_contact_pressure": _smallest,
}
#: Of `model_difference`, which is imported where they are asked for: it takes both solvers.
MODEL_MEASURES = (
    "model_area",
    "model_overlap",
    "model_distance",
    "effective_hardness",
    "effective_overlap",
    "elements_area",
)
MEASURES = (*SURFACE_MEASURES, *FIELD_MEASURES, *MODEL_MEASURES)


def measure(name: str, scene: Scene, result: ContactResult) -> float:
    """The measure called `name`.  Raises InvalidCase if the result lacks what it takes."""
    return measure_all((name,), scene, result)[name]


def measure_all(names: Collection[str], scene: Scene, result: ContactResult) -> dict[str, float]:
    """`measure` of each name; those that share a solve share it."""
    found = {name: SURFACE_MEASURES[name](scene) for name in names if name in SURFACE_MEASURES}
    if len(found) == len(names):
        return found
    pressure = result.fields.get("pressure")
    if pressure is None:
        raise InvalidCase(f"{result.method} gives no field 'pressure' for a gate")
    if np.shape(pressure) != scene.surface.shape:
        raise InvalidCase(
            f"{result.method} gives a pressure of shape {np.shape(pressure)} on a grid of "
            f"{scene.surface.shape}"
        )
    p = np.asarray(pressure, dtype=np.float64)
    found |= {n: FIELD_MEASURES[n](p, scene, result) for n in names if n in FIELD_MEASURES}
    if model := set(names) & set(MODEL_MEASURES):
        from epcontact.harness.model_difference import model_measures

        found |= model_measures(model, scene, result)
    return found
