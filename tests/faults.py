"""Deliberately wrong solvers: each must turn a named gate red (see test_faults.py).

They stand in for the boundary elements through `--solver faults:<name>`; `epcontact verify`
knows nothing of them.  Each is the honest solver but for one mistake that somebody could make.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from epcontact.bem import driver
from epcontact.bem.kernel import rfft_wavenumbers, surface_compliance
from epcontact.errors import SurfaceWarning
from epcontact.results import Areas, ContactResult, LoadStep, PressureDistribution
from epcontact.scene import Body, Load, Scene


def honest(scene: Scene) -> ContactResult:
    """No fault: what the others are measured against."""
    return driver.solve(scene, threads=1)


# --- material and load ---------------------------------------------------------------------------


def stiff(scene: Scene) -> ContactResult:
    """The modulus 5 % too high."""
    return honest(_with_material(scene, young_modulus=1.05 * scene.material.young_modulus))


def plane_stress(scene: Scene) -> ContactResult:
    """E in the place of E*: seen only where Poisson's ratio is not zero."""
    return honest(_with_material(scene, poisson_ratio=0.0))


def light(scene: Scene) -> ContactResult:
    """Force not conserved: 2 % of the load lost."""
    return honest(replace(scene, load=Load(tuple(0.98 * p for p in scene.load.path))))


def first_load(scene: Scene) -> ContactResult:
    """A path of loads answered at half its last."""
    return honest(replace(scene, load=Load(scene.load.final / 2)))


# --- the cap -------------------------------------------------------------------------------------


def no_cap(scene: Scene) -> ContactResult:
    """The cap lost."""
    return honest(_with_material(scene, hardness=math.inf))


def low_cap(scene: Scene) -> ContactResult:
    """The cap 3 % too low."""
    return honest(_with_material(scene, hardness=0.97 * scene.material.hardness))


def high_cap(scene: Scene) -> ContactResult:
    """The cap 3 % too high."""
    return honest(_with_material(scene, hardness=1.03 * scene.material.hardness))


def clipped(scene: Scene) -> ContactResult:
    """The elastic pressure cut at the hardness, and what is cut off forgotten."""
    result = no_cap(scene)
    return _with_pressure(result, np.minimum(result.fields["pressure"], scene.material.hardness))


def clipped_and_scaled(scene: Scene) -> ContactResult:
    """The elastic pressure cut at the hardness, again and again scaled back to the load."""
    pressure = no_cap(scene).fields["pressure"]
    for _ in range(200):
        pressure = np.minimum(pressure, scene.material.hardness)
        pressure = pressure * (scene.load.final / pressure.mean())
    return _with_pressure(honest(scene), pressure)


# --- the surface ---------------------------------------------------------------------------------


def upside_down(scene: Scene) -> ContactResult:
    """The sign of the heights flipped."""
    return honest(_with_heights(scene, -scene.surface.heights))


def transposed(scene: Scene) -> ContactResult:
    """Rows taken for columns: the periods are exchanged, the arrays are not."""
    with warnings.catch_warnings(action="ignore", category=SurfaceWarning):  # of oblong cells
        surface = replace(scene.surface, periods=scene.surface.periods[::-1], recipe="")
    return honest(replace(scene, surface=surface))


def half_cell(scene: Scene) -> ContactResult:
    """Heights taken at the middles of the cells, pressures at their corners."""
    heights = scene.surface.heights
    for axis, n in enumerate(heights.shape):
        turn = np.exp(1j * np.pi * np.fft.fftfreq(n))
        shape = [-1 if a == axis else 1 for a in range(heights.ndim)]
        modes = np.fft.fft(heights, axis=axis) * turn.reshape(shape)
        heights = np.fft.ifft(modes, axis=axis).real
    return honest(_with_heights(scene, heights))


def shifted(scene: Scene) -> ContactResult:
    """Fields an eighth of the grid off along every direction."""
    result = honest(scene)
    fields = {
        name: np.roll(a, [n // 8 for n in a.shape], range(a.ndim))
        for name, a in result.fields.items()
    }
    return replace(result, fields=fields)


def coarse(scene: Scene) -> ContactResult:
    """Solved on every second point, each answer given to the points of its cell."""
    every = (slice(None, None, 2),) * scene.surface.heights.ndim
    result = honest(_with_heights(scene, scene.surface.heights[every]))
    fields = dict(result.fields)
    for axis in range(scene.surface.heights.ndim):
        fields = {name: np.repeat(a, 2, axis) for name, a in fields.items()}
    return replace(result, fields=fields)


# --- the kernel ----------------------------------------------------------------------------------


def half_compliance(scene: Scene) -> ContactResult:
    """C = 1/(E* q): the factor 2 of Boussinesq's sum forgotten."""
    return _with_compliance(scene, lambda q, C: C / 2)


def cycles_for_radians(scene: Scene) -> ContactResult:
    """Wave numbers without their 2 pi."""
    return _with_compliance(scene, lambda q, C: C * 2 * math.pi)


def difference_kernel(scene: Scene) -> ContactResult:
    """(2/dx) sin(q dx/2) in the place of q, as a difference scheme would have it."""
    dx = scene.surface.spacing[0]

    def kernel(q: np.ndarray, C: np.ndarray) -> np.ndarray:
        angle = np.minimum(q * dx / 2, math.pi / 2)
        return C * np.where(q > 0, angle / np.sin(np.where(q > 0, angle, 1.0)), 1.0)

    return _with_compliance(scene, kernel)


def no_depth(scene: Scene) -> ContactResult:
    """The depth of the layer ignored."""
    return honest(replace(scene, body=Body()))


def wrong_base(scene: Scene) -> ContactResult:
    """A bonded layer for a sliding one, and the other way round."""
    kinds = {"bonded_layer": "sliding_layer", "sliding_layer": "bonded_layer"}
    return honest(replace(scene, body=Body(kinds[scene.body.kind], scene.body.depth)))  # type: ignore[arg-type]


def no_compression(scene: Scene) -> ContactResult:
    """The mode q = 0 of a layer dropped, as if it were a half-space."""
    result, material = honest(scene), scene.material
    nu = material.poisson_ratio
    modulus = material.young_modulus * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    energy = result.final.quantities["elastic_energy"]
    energy -= scene.load.final**2 * scene.body.depth / modulus / 2
    return _with_quantities(result, {"elastic_energy": energy})


# --- the solver ----------------------------------------------------------------------------------


def impatient(scene: Scene) -> ContactResult:
    """Stops as soon as the areas move by less than a tenth, and calls it converged."""
    return driver.solve(scene, threads=1, area_tolerance=0.1)


def tensile(scene: Scene) -> ContactResult:
    """Every gap closed, if need be by tension."""
    q = rfft_wavenumbers(scene.surface.shape, scene.surface.periods)
    C = surface_compliance(q, scene.body, scene.material)
    C.flat[0] = math.inf
    modes = np.fft.rfftn(scene.surface.heights) / C
    axes = range(scene.surface.heights.ndim)
    pressure = np.fft.irfftn(modes, scene.surface.shape, axes) + scene.load.final
    return _with_pressure(honest(scene), pressure)


def single_precision(scene: Scene) -> ContactResult:
    """The pressure kept in float32."""
    result = honest(scene)
    return _with_pressure(result, result.fields["pressure"].astype(np.float32).astype(float))


# --- what is reported ----------------------------------------------------------------------------


def gap_sign(scene: Scene) -> ContactResult:
    """The gap given with the wrong sign."""
    result = honest(scene)
    return replace(result, fields=dict(result.fields) | {"gap": -result.fields["gap"]})


def raw_called_corrected(scene: Scene) -> ContactResult:
    """The share of grid points passed off as the area in the continuum limit."""
    return _with_areas(honest(scene), lambda areas: areas | {"corrected": areas["raw"]})


def corrected_called_raw(scene: Scene) -> ContactResult:
    """The other way round."""
    return _with_areas(honest(scene), lambda areas: areas | {"raw": areas["corrected"]})


def corrected_the_wrong_way(scene: Scene) -> ContactResult:
    """The correction added where it should be taken off."""

    def turned(areas: Mapping[str, Areas]) -> dict[str, Areas]:
        raw, good = areas["raw"], areas["corrected"]
        total, plastic = 2 * raw.total - good.total, 2 * raw.plastic - good.plastic
        return dict(areas) | {"corrected": Areas(total, total - plastic, plastic)}

    return _with_areas(honest(scene), turned)


def elastic_called_total(scene: Scene) -> ContactResult:
    """The plastic area forgotten in the sum."""

    def forgotten(areas: Mapping[str, Areas]) -> dict[str, Areas]:
        return {k: Areas(a.elastic, a.elastic, a.plastic) for k, a in areas.items()}

    return _with_areas(honest(scene), forgotten)


def plastic_from_gap(scene: Scene) -> ContactResult:
    """Plastic points counted where the gap is below minus a thousandth of its extent."""
    result = honest(scene)
    gap = result.fields["gap"]
    plastic = float((gap < 1e-3 * gap.min()).mean()) if gap.min() < 0 else 0.0

    def counted(areas: Mapping[str, Areas]) -> dict[str, Areas]:
        total = areas["raw"].total
        return dict(areas) | {"raw": Areas(total, total - plastic, plastic)}

    return _with_areas(result, counted)


def lost_delta(scene: Scene) -> ContactResult:
    """A pressure distribution without its plastic part."""
    result = honest(scene)
    assert result.distribution is not None
    return replace(result, distribution=replace(result.distribution, plastic=0.0))


def of_the_contact(scene: Scene) -> ContactResult:
    """A pressure distribution normalised by the contact in the place of the nominal area."""
    result = honest(scene)
    found = result.distribution
    assert found is not None
    total = found.cumulative[-1] + found.plastic
    normalised = PressureDistribution(
        found.pressure, found.cumulative / total, found.plastic / total
    )
    return replace(result, distribution=normalised)


# --- helpers -------------------------------------------------------------------------------------


def _with_material(scene: Scene, **changes: float) -> Scene:
    return replace(scene, material=replace(scene.material, **changes))


def _with_heights(scene: Scene, heights: np.ndarray) -> Scene:
    return replace(scene, surface=replace(scene.surface, heights=heights, recipe=""))


def _with_compliance(scene: Scene, change: Any) -> ContactResult:
    q = rfft_wavenumbers(scene.surface.shape, scene.surface.periods)
    C = surface_compliance(q, scene.body, scene.material)
    return driver.solve(scene, threads=1, compliance=change(q, C))


def _with_pressure(result: ContactResult, pressure: np.ndarray) -> ContactResult:
    return replace(result, fields=dict(result.fields) | {"pressure": pressure})


def _with_last(result: ContactResult, last: LoadStep) -> ContactResult:
    return replace(result, steps=(*result.steps[:-1], last))


def _with_quantities(result: ContactResult, changes: Mapping[str, float]) -> ContactResult:
    quantities = dict(result.final.quantities) | changes
    return _with_last(result, replace(result.final, quantities=quantities))


def _with_areas(result: ContactResult, change: Any) -> ContactResult:
    return _with_last(result, replace(result.final, areas=change(dict(result.final.areas))))
