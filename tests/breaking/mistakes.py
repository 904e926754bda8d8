"""Mistakes that do not fit into one expression, for the rows of `table.tsv`.

The functions take what the correct code has, and return what the mistake makes of it.
All names of this module may be used in the expressions of the table.
"""

import math
import warnings
from dataclasses import replace

import numpy as np
from junitparser import Skipped
from scipy.ndimage import label
from scipy.special import erf, erfc, j0, j1, struve

from epcontact.bem import driver
from epcontact.bem.kernel import rfft_wavenumbers, surface_compliance
from epcontact.bem.transforms import Symbol
from epcontact.errors import SurfaceWarning
from epcontact.interface import Limit
from epcontact.materials.moduli import effective_modulus
from epcontact.persson.validity import ExpectedError
from epcontact.results import APART, ELASTIC, PLASTIC, Areas
from epcontact.scene import Body, Load
from fem_check.plasticity import commit

__all__ = [
    "Body",
    "ExpectedError",
    "Limit",
    "Load",
    "Skipped",
    "commit",
    "erf",
    "erfc",
    "math",
]

OTHER_BRANCH = {"loading": "unloading", "unloading": "loading"}


# --- scenes


def with_material(scene, **changes):
    """Return a scene with other values of its material, given by the names of its
    fields.
    """
    return replace(scene, material=replace(scene.material, **changes))


def with_heights(scene, heights):
    """Return a scene with other heights (m, of any shape) on the same periods."""
    return replace(scene, surface=replace(scene.surface, heights=heights, recipe=""))


def with_exchanged_periods(scene):
    """Return a scene with exchanged periods, but heights as they are."""
    periods = scene.surface.periods[::-1]
    with warnings.catch_warnings(action="ignore", category=SurfaceWarning):
        surface = replace(scene.surface, periods=periods, recipe="")
    return replace(scene, surface=surface)


def transposed_surface(surface):
    """Return a surface with its heights transposed, but not its periods."""
    if surface.heights.ndim == 1:
        return surface
    heights = surface.heights.T.reshape(surface.heights.shape)
    return replace(surface, heights=np.ascontiguousarray(heights))


def half_a_cell_off(heights):
    """Return heights (m) at the corners of the cells instead of their centres, by
    Fourier interpolation.

    The array has any number of axes.
    """
    for axis, n in enumerate(heights.shape):
        turn = np.exp(1j * np.pi * np.fft.fftfreq(n))
        shape = [1] * heights.ndim
        shape[axis] = -1
        modes = np.fft.fft(heights, axis=axis) * turn.reshape(shape)
        heights = np.fft.ifft(modes, axis=axis).real
    return heights


# --- pressures and compliances of boundary elements


def clipped_and_scaled_pressure(scene):
    """Return the elastic pressure (Pa), repeatedly cut at the hardness and scaled to
    the load.

    The array has the shape of the scene's grid.
    """
    elastic = driver.solve(with_material(scene, hardness=math.inf), threads=1)
    pressure = elastic.fields["pressure"]
    for _ in range(200):
        pressure = np.minimum(pressure, scene.material.hardness)
        pressure = pressure * (scene.load.final / pressure.mean())
    return pressure


def tensile_pressure(scene):
    """Return the pressure (Pa) that closes every gap, by tension where necessary.

    The array has the shape of the scene's grid.
    """
    compliance = compliance_of(scene)
    compliance.flat[0] = math.inf
    modes = np.fft.rfftn(scene.surface.heights) / compliance
    axes = range(scene.surface.heights.ndim)
    return np.fft.irfftn(modes, scene.surface.shape, axes) + scene.load.final


def compliance_of(scene):
    """Return the compliance (m/Pa) of each wave of a scene's grid, in the order of
    numpy's rfftn.
    """
    q = rfft_wavenumbers(scene.surface.shape, scene.surface.periods)
    return surface_compliance(q, scene.body, scene.material)


def difference_compliance(scene):
    """Return the compliance (m/Pa) of a difference scheme, with (2/dx) sin(q dx/2) for
    the wavenumber q.

    The order is that of numpy's rfftn.
    """
    q = rfft_wavenumbers(scene.surface.shape, scene.surface.periods)
    angle = np.minimum(q * scene.surface.spacing[0] / 2, math.pi / 2)
    ratio = np.ones_like(angle)
    np.divide(angle, np.sin(angle), out=ratio, where=q > 0)
    return compliance_of(scene) * ratio


def compression_energy(scene):
    """Return the elastic energy (J/m^2) of a layer under a uniform pressure."""
    nu = scene.material.poisson_ratio
    modulus = scene.material.young_modulus * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    return scene.load.final**2 * scene.body.depth / modulus / 2


# --- results of boundary elements


def an_eighth_off(result):
    """Return a ContactResult with fields moved by an eighth of the grid in each
    direction.
    """
    fields = {}
    for name, field in result.fields.items():
        eighth = [n // 8 for n in field.shape]
        fields[name] = np.roll(field, eighth, range(field.ndim))
    return replace(result, fields=fields)


def every_second_point(scene):
    """Return the solution of a scene on every second point, with fields repeated on the
    others.
    """
    axes = range(scene.surface.heights.ndim)
    every_second = (slice(None, None, 2),) * len(axes)
    coarse = with_heights(scene, scene.surface.heights[every_second])
    result = driver.solve(coarse, threads=1)
    fields = {}
    for name, field in result.fields.items():
        repeated = field
        for axis in axes:
            repeated = np.repeat(repeated, 2, axis)
        fields[name] = repeated
    return replace(result, fields=fields)


def corrected_the_wrong_way(areas):
    """Return areas whose correction was added instead of subtracted.

    `areas` is a dictionary of Areas with the keys "raw" and "corrected", fractions of
    the nominal area.
    """
    raw, corrected = areas["raw"], areas["corrected"]
    total = 2 * raw.total - corrected.total
    plastic = 2 * raw.plastic - corrected.plastic
    return {**areas, "corrected": Areas(total, total - plastic, plastic)}


def only_total_corrected(raw, corrected, error):
    """Return raw and corrected areas and their error, without a correction of the
    plastic part.

    The arguments and the returned tuple are Areas, fractions of the nominal area.
    """
    total = corrected.total
    return raw, Areas(total, total - raw.plastic, raw.plastic), error


def plastic_by_gap(result):
    """Return a result that counts plastic points by their gap.

    A point is plastic if its gap is below a thousandth of the lowest gap.
    """
    gap, last = result.fields["gap"], result.final
    plastic = float((gap < 1e-3 * min(gap.min(), 0.0)).mean())
    total = last.areas["raw"].total
    areas = {**last.areas, "raw": Areas(total, total - plastic, plastic)}
    return replace(result, steps=(*result.steps[:-1], replace(last, areas=areas)))


def scaled_areas(areas, factor):
    """Return areas (an Areas) times a factor."""
    return Areas(*(factor * area for area in vars(areas).values()))


def over_the_contact(distribution):
    """Return a pressure distribution over the contact, not the nominal area."""
    total = distribution.cumulative[-1] + distribution.plastic
    return replace(
        distribution,
        cumulative=distribution.cumulative / total,
        plastic=distribution.plastic / total,
    )


def exchanged_states(state):
    """Return a field of states with elastic and plastic points exchanged."""
    exchanged = np.full_like(state, APART)
    exchanged[state == ELASTIC] = PLASTIC
    exchanged[state == PLASTIC] = ELASTIC
    return exchanged


def quantities_a_step_late(result):
    """Return a result whose steps have the quantities of the step before."""
    steps = [result.steps[0]]
    for step, before in zip(result.steps[1:], result.steps, strict=False):
        steps.append(replace(step, quantities=before.quantities))
    return replace(result, steps=tuple(steps))


def deepest_half(flow):
    """Return the plastic displacement (m, an array) with the less deep half set to 0.

    Points that have not flowed are 0 in `flow`.
    """
    return np.where(flow > np.median(flow[flow > 0]), flow, 0.0)


def with_deformation(flow, displacement):
    """Return the plastic displacement (m) with a tenth of the elastic one added."""
    return flow + 0.1 * (displacement - displacement.min())


def between_nodes(pressure):
    """Return the pressures (Pa) at the centres of the elements, of shape (nx, ny).

    `pressure` are those of the nodes, in the same shape.
    """
    for axis in (0, 1):
        pressure = (pressure + np.roll(pressure, 1, axis)) / 2
    return pressure


# --- theory, interface and materials


def without_shortest_ring(rings):
    """Return a radial spectrum without its shortest ring of waves."""
    shortest = rings.wavenumber[rings.slope_variance > 1e-9].max()
    kept = rings.wavenumber < 0.95 * shortest
    return replace(rings, slope_variance=np.where(kept, rings.slope_variance, 0))


def without_images(symbol, scene):
    """Return the compliance, a Symbol, of a force that acts only within half a period.

    `symbol` holds the compliance (m/Pa) of each wave of the scene's grid.

    The transform of 1/r up to R is the integral of J_0 from 0 to q R.
    """
    modulus = effective_modulus(scene.material)
    compliance = symbol.values
    wavenumber = 1 / modulus / np.where(compliance > 0, compliance, np.inf)
    # The integral by Struve's functions: scipy's own, itj0y0, is wrong in scipy 1.15.
    x = scene.surface.periods[0] * wavenumber
    curved = j1(x) * struve(0, x) - j0(x) * struve(1, x)
    near = compliance * x * (j0(x) + np.pi / 2 * curved)
    return Symbol(near, symbol.rows, symbol.shape)


def number_patches_without_period(mask):
    """Return the patch number from 0 of each point in contact, and False for
    percolation.

    `mask` is true in contact, and its edges are free.
    """
    return label(mask)[0][mask] - 1, False


def with_a_low_row(hardness_map):
    """Return the map of the hardness (arrays by the names of columns) with one row 15 %
    too hard.
    """
    inverse_hardness = hardness_map["inverse_hardness"].copy()
    inverse_hardness[60] *= 0.85
    return {**hardness_map, "inverse_hardness": inverse_hardness}


# --- results of the harness


def with_reversed_results(answers, method):
    """Return answers (MethodResults by method) with one method's surfaces in reverse
    order.
    """
    answer = answers[method]
    return {**answers, method: replace(answer, results=answer.results[::-1])}


def with_reversed_surfaces(summary):
    """Return the summary of an answer with labels of surfaces in the reverse order."""
    ensemble = dict(summary["ensemble"])
    ensemble["surfaces"] = ensemble["surfaces"][::-1]
    return {**summary, "ensemble": ensemble}


def with_exchanged_areas(summary):
    """Return the summary of a method's results, a dictionary, with raw and corrected
    areas exchanged.
    """
    areas = dict(summary["areas"])
    areas["raw"], areas["corrected"] = areas["corrected"], areas["raw"]
    return {**summary, "areas": areas}


def with_best_residuals(summary):
    """Return the summary of an answer with the best residuals of its surfaces."""
    residuals = {}
    for name in summary["residuals"]:
        residuals[name] = min(one["residuals"][name] for one in summary["members"])
    return {**summary, "residuals": residuals}
