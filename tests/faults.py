"""Deliberately wrong solvers of more than one line, and the parts of those in
`breaking.boundary`.

They stand in for the boundary elements, and each must turn a named gate red (see
test_faults.py). Each is the honest solver but for one mistake that somebody could make.
"""

import math
import warnings
from dataclasses import replace

import numpy as np

from epcontact.bem import driver
from epcontact.bem.kernel import rfft_wavenumbers, surface_compliance
from epcontact.errors import SurfaceWarning
from epcontact.results import Areas
from epcontact.scene import Body


def honest(scene):
    """No fault: what the others are measured against."""
    return driver.solve(scene, threads=1)


def stiff(scene):
    """The modulus 5 % too high."""
    return with_material(scene, young_modulus=1.05 * scene.material.young_modulus)


def no_cap(scene):
    """The cap lost."""
    return with_material(scene, hardness=math.inf)


def clipped(scene):
    """The elastic pressure cut at the hardness, and what is cut off forgotten."""
    result = no_cap(scene)
    return with_pressure(
        result, np.minimum(result.fields["pressure"], scene.material.hardness)
    )


def clipped_and_scaled(scene):
    """The elastic pressure cut at the hardness, again and again scaled back to the
    load.
    """
    pressure = no_cap(scene).fields["pressure"]
    for _ in range(200):
        pressure = np.minimum(pressure, scene.material.hardness)
        pressure = pressure * (scene.load.final / pressure.mean())
    return with_pressure(honest(scene), pressure)


def transposed(scene):
    """Rows taken for columns: the periods are exchanged, the arrays are not."""
    with warnings.catch_warnings(
        action="ignore", category=SurfaceWarning
    ):  # of oblong cells
        surface = replace(scene.surface, periods=scene.surface.periods[::-1], recipe="")
    return honest(replace(scene, surface=surface))


def half_cell(scene):
    """Heights taken at the middles of the cells, pressures at their corners."""
    heights = scene.surface.heights
    for axis, n in enumerate(heights.shape):
        turn = np.exp(1j * np.pi * np.fft.fftfreq(n))
        shape = [-1 if a == axis else 1 for a in range(heights.ndim)]
        modes = np.fft.fft(heights, axis=axis) * turn.reshape(shape)
        heights = np.fft.ifft(modes, axis=axis).real
    return with_heights(scene, heights)


def shifted(scene):
    """Fields an eighth of the grid off along every direction."""
    result, eighth = honest(scene), [n // 8 for n in scene.surface.shape]
    axes = range(len(eighth))
    fields = {
        name: np.roll(field, eighth, axes) for name, field in result.fields.items()
    }
    return replace(result, fields=fields)


def coarse(scene):
    """Solved on every second point, each answer given to the points of its cell."""
    every = (slice(None, None, 2),) * scene.surface.heights.ndim
    result = with_heights(scene, scene.surface.heights[every])
    fields = dict(result.fields)
    for axis in range(scene.surface.heights.ndim):
        fields = {name: np.repeat(a, 2, axis) for name, a in fields.items()}
    return replace(result, fields=fields)


def difference_kernel(scene):
    """(2/dx) sin(q dx/2) in the place of q, as a difference scheme would have it."""
    dx = scene.surface.spacing[0]

    def kernel(q, C):
        angle = np.minimum(q * dx / 2, math.pi / 2)
        return C * np.where(q > 0, angle / np.sin(np.where(q > 0, angle, 1.0)), 1.0)

    return with_compliance(scene, kernel)


def wrong_base(scene):
    """A bonded layer for a sliding one, and the other way round."""
    kinds = {"bonded_layer": "sliding_layer", "sliding_layer": "bonded_layer"}
    return honest(replace(scene, body=Body(kinds[scene.body.kind], scene.body.depth)))


def no_compression(scene):
    """The mode q = 0 of a layer dropped, as if it were a half-space."""
    result, material = honest(scene), scene.material
    nu = material.poisson_ratio
    modulus = material.young_modulus * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    energy = result.final.quantities["elastic_energy"]
    energy -= scene.load.final**2 * scene.body.depth / modulus / 2
    return with_last(
        result, quantities={**result.final.quantities, "elastic_energy": energy}
    )


def tensile(scene):
    """Every gap closed, if need be by tension."""
    q = rfft_wavenumbers(scene.surface.shape, scene.surface.periods)
    C = surface_compliance(q, scene.body, scene.material)
    C.flat[0] = math.inf
    modes = np.fft.rfftn(scene.surface.heights) / C
    axes = range(scene.surface.heights.ndim)
    pressure = np.fft.irfftn(modes, scene.surface.shape, axes) + scene.load.final
    return with_pressure(honest(scene), pressure)


def corrected_the_wrong_way(scene):
    """The correction added where it should be taken off."""

    def turned(areas):
        raw, good = areas["raw"], areas["corrected"]
        total, plastic = 2 * raw.total - good.total, 2 * raw.plastic - good.plastic
        return dict(areas) | {"corrected": Areas(total, total - plastic, plastic)}

    return with_areas(honest(scene), turned)


def plastic_from_gap(scene):
    """Plastic points counted where the gap is below minus a thousandth of its
    extent.
    """
    result = honest(scene)
    gap = result.fields["gap"]
    plastic = float((gap < 1e-3 * gap.min()).mean()) if gap.min() < 0 else 0.0

    def counted(areas):
        total = areas["raw"].total
        return dict(areas) | {"raw": Areas(total, total - plastic, plastic)}

    return with_areas(result, counted)


# --- helpers
# -------------------------------------------------------------------------------------


def with_material(scene, **changes):
    return honest(replace(scene, material=replace(scene.material, **changes)))


def with_heights(scene, heights):
    return honest(
        replace(scene, surface=replace(scene.surface, heights=heights, recipe=""))
    )


def with_compliance(scene, change):
    q = rfft_wavenumbers(scene.surface.shape, scene.surface.periods)
    C = surface_compliance(q, scene.body, scene.material)
    return driver.solve(scene, threads=1, compliance=change(q, C))


def with_pressure(result, pressure):
    return replace(result, fields=dict(result.fields) | {"pressure": pressure})


def with_areas(result, change):
    return with_last(result, areas=change(dict(result.final.areas)))


def with_last(result, **changes):
    return replace(result, steps=(*result.steps[:-1], replace(result.final, **changes)))
