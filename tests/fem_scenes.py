"""Scenes and surfaces that the tests of the finite elements share."""

import numpy as np

from epcontact.scene import Body, Load, Material, Scene, Surface


def rough_heights(nodes, highest, *, seed=7, slope=0.05, dimensions=2):
    """Self-affine heights of unit period, wave numbers 1 to `highest` per period, Hurst
    exponent 0.8, rms slope `slope`.  The waves do not depend on `nodes`: grids refine
    one surface.
    """
    rng = np.random.default_rng(seed)
    waves, shape = np.arange(-highest, highest + 1), (2 * highest + 1,) * dimensions
    q = np.sqrt(sum(g.astype(float) ** 2 for g in np.meshgrid(*[waves] * dimensions)))
    noise = rng.standard_normal(shape) + 1j * rng.standard_normal(shape)
    inside = (q > 0) & (q <= highest)
    power = np.where(inside, q, 1.0) ** (-1.8 if dimensions == 2 else -1.3)
    amplitude = np.where(inside, power, 0.0) * noise
    spectrum = np.zeros((nodes,) * dimensions, dtype=complex)
    spectrum[np.ix_(*[waves % nodes] * dimensions)] = amplitude
    # The real part of a sum of waves: half of each wave and of its mirror.
    heights = np.fft.ifftn(spectrum).real * nodes**dimensions
    mirrored = (amplitude + np.flip(amplitude).conj()) / 2
    return np.asarray(
        heights * slope / np.sqrt(np.sum(np.abs(mirrored * 2 * np.pi * q) ** 2))
    )


def rough_scene(
    nodes,
    highest,
    *,
    pressure=0.05,
    poisson_ratio=0.3,
    yield_stress=0.2,
    hardness=0.6,
    dimensions=2,
    seed=7,
    slope=0.05,
    body=None,
):
    """A rough scene with E* xi = 1 at slope 0.05, so pressures are in units of E*
    xi.
    """
    heights = rough_heights(
        nodes, highest, seed=seed, slope=slope, dimensions=dimensions
    )
    material = Material(
        (1 - poisson_ratio**2) / slope, poisson_ratio, hardness, yield_stress
    )
    surface = Surface(heights, (1.0,) * dimensions, seed=seed)
    return Scene(surface, material, Load(pressure), body or Body())


def sphere_scene(
    force,
    *,
    nodes,
    nodes_to_rim,
    poisson_ratio=0.3,
    yield_stress=np.inf,
    offset=(0.21, 0.37),
):
    """A sphere of R = 1 m and E = 1 Pa under `force` (N); a contact of radius 0.05 m would have
    `nodes_to_rim` nodes along its radius.  offset: of its top from a node, in spacings.
    """
    period = nodes * 0.05 / nodes_to_rim
    x, y = (((np.arange(nodes) + o) / nodes - 0.5) * period for o in offset)
    return Scene(
        Surface(-(x[:, None] ** 2 + y[None, :] ** 2) / 2, (period, period)),
        Material(1.0, poisson_ratio, yield_stress=yield_stress),
        Load(force / period**2),
    )


#: The first of the cases fem-model, as a file of its own that tests can change.
J2_CASE = """
[case]
id = "fem-model-5"
requirement = "J2 flow carries the load on more area than a pressure cap at 3 sigma_Y does."
source = "made for the tests"
methods = ["fem", "bem"]

[surface]
kind = "self_affine"
period = 1.0e-3
hurst = 0.8
wavenumber_low = 6283.185307179586
wavenumber_roll_off = 6283.185307179586
wavenumber_high = 25132.741228718346
rms_slope = 0.05
shape = [48, 48]
seeds = [5, 6, 7, 8, 9, 10, 11, 12]

[material]
young_modulus = 210.0e9
poisson_ratio = 0.3
yield_stress = 2.3077e+09
hardness = 6.9231e+09

[body]
kind = "bonded_layer"
depth = 1.0e-3

[fem]
law = "j2"

[load]
mean_pressure = 5.7692e+08

[[gate]]
quantity = "quantity.measured_force"
of = "fem"
against = 0.0
norm = "absolute"
tolerance = 3e-8
source = "the load"
because = "the tolerance of the solver"
"""

#: A gate that only J2 flow on a flat block, under one load and beside a cap, can
#: answer.
MODEL_GATE = """
[[gate]]
quantity = "quantity.model_area"
of = "fem"
against = 0.219
norm = "absolute"
tolerance = 0.16
source = "the case fem-model-5"
because = "the band of the case fem-model-5"
"""
