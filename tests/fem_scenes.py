"""Scenes and surfaces that the tests of the finite elements share."""

import numpy as np

from epcontact.scene import Body, Load, Material, Scene, Surface


def rough_heights(nodes, highest, *, seed=7, slope=0.05, dimensions=2):
    """Return self-affine heights of zero mean on a period of 1, as an array of `nodes`
    points along each of `dimensions` axes, in units of the period.

    They have the wave numbers 1 to `highest` per period, a Hurst exponent of 0.8 and
    the rms slope `slope` (dimensionless). `seed` draws the phases and amplitudes, and
    these do not depend on the number of nodes: finer grids refine one surface.
    """
    rng = np.random.default_rng(seed)
    waves = np.arange(-highest, highest + 1)
    q = np.hypot.reduce(np.meshgrid(*[waves] * dimensions))
    noise = rng.standard_normal(q.shape) + 1j * rng.standard_normal(q.shape)
    exponent = {1: -1.3, 2: -1.8}[dimensions]
    inside = (q > 0) & (q <= highest)
    amplitude = np.where(inside, np.where(inside, q, 1.0) ** exponent, 0.0) * noise
    spectrum = np.zeros((nodes,) * dimensions, dtype=complex)
    spectrum[np.ix_(*[waves % nodes] * dimensions)] = amplitude
    heights = np.fft.ifftn(spectrum).real * nodes**dimensions
    # The real part of a sum of waves has half of each wave and of its mirror image.
    real_amplitude = (amplitude + np.flip(amplitude).conj()) / 2
    rms_slope = np.sqrt(np.sum(np.abs(real_amplitude * 2 * np.pi * q) ** 2))
    return heights * slope / rms_slope


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
    """Return a rough scene in units in which E* xi = 1, with xi the rms slope `slope`.

    The surface is that of `rough_heights` with a period of 1. `pressure` (the mean
    pressure, or a tuple of them for a path), `yield_stress` and `hardness` are in units
    of E* xi; `body` is a half-space if None.
    """
    heights = rough_heights(
        nodes, highest, seed=seed, slope=slope, dimensions=dimensions
    )
    young_modulus = (1 - poisson_ratio**2) / slope
    material = Material(young_modulus, poisson_ratio, hardness, yield_stress)
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
    """Return a paraboloid of radius R = 1 m and E = 1 Pa under `force` (N), on a square
    period.

    The grid has `nodes` x `nodes` points, spaced such that a contact radius of 0.05 m
    is `nodes_to_rim` spacings. The summit lies at the middle of the period, and
    `offset` shifts the grid against it, as fractions of the spacing along x and y.
    `yield_stress` is in Pa.
    """
    period = nodes * 0.05 / nodes_to_rim
    x, y = (np.arange(nodes) + np.reshape(offset, (2, 1))) * (period / nodes)
    heights = -((x[:, None] - period / 2) ** 2 + (y - period / 2) ** 2) / 2
    return Scene(
        Surface(heights, (period, period)),
        Material(1.0, poisson_ratio, yield_stress=yield_stress),
        Load(force / period**2),
    )


#: A case file with the first of the cases of cases/fem-model.toml, to be changed.
J2_CASE = """
[case]
id = "fem-model-5"
requirement = "J2 flow carries the load on more area than a cap at 3 sigma_Y does."
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

#: A gate that compares J2 flow with a cap: it needs a flat block and one load.
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
