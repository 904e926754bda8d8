"""Scenes, surfaces and linear systems that the tests of the finite elements share."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from epcontact.results import ELASTIC
from epcontact.scene import Body, Load, Material, Scene, Surface
from epcontact.studies.fem import speed_scene
from fem_check import plasticity, solve_path
from fem_check.limit_load import assembled, tangents
from fem_check.linearised import Tangent, linear_contact
from fem_check.plasticity import TangentCorrection
from fem_check.problem import Control, Problem, State, internal_force
from fem_check.smoother import layer_stiffness


def rough_heights(
    nodes: int, highest: int, *, seed: int = 7, slope: float = 0.05, dimensions: int = 2
) -> NDArray[np.float64]:
    """Self-affine heights of unit period, wave numbers 1 to `highest` per period, Hurst exponent
    0.8, rms slope `slope`.  The waves do not depend on `nodes`: grids refine one surface."""
    rng = np.random.default_rng(seed)
    waves = np.arange(-highest, highest + 1)
    grid = np.meshgrid(*[waves] * dimensions, indexing="ij")
    q = np.sqrt(sum(g.astype(float) ** 2 for g in grid))
    shape = (2 * highest + 1,) * dimensions
    noise = rng.standard_normal(shape) + 1j * rng.standard_normal(shape)
    power = -1.8 if dimensions == 2 else -1.3
    inside = (q > 0) & (q <= highest)
    amplitude = np.where(inside, np.where(inside, q, 1.0) ** power, 0.0) * noise
    spectrum = np.zeros((nodes,) * dimensions, dtype=complex)
    spectrum[np.ix_(*[waves % nodes] * dimensions)] = amplitude
    # The real part of a sum of waves: half of each wave and of its mirror.
    heights = np.fft.ifftn(spectrum).real * nodes**dimensions
    mirrored = amplitude[(slice(None, None, -1),) * dimensions].conj()
    real_waves = (amplitude + mirrored) / 2
    present = np.sqrt(np.sum(np.abs(real_waves) ** 2 * (2 * np.pi * q) ** 2))
    return np.asarray(heights * slope / present)


def rough_scene(
    nodes: int,
    highest: int,
    *,
    pressure: float | tuple[float, ...] = 0.05,
    poisson_ratio: float = 0.3,
    yield_stress: float = 0.2,
    hardness: float = 0.6,
    dimensions: int = 2,
    seed: int = 7,
    slope: float = 0.05,
    body: Body | None = None,
) -> Scene:
    """A rough scene with E* xi = 1 at slope 0.05, so pressures are in units of E* xi."""
    return Scene(
        Surface(
            rough_heights(nodes, highest, seed=seed, slope=slope, dimensions=dimensions),
            (1.0,) * dimensions,
            seed=seed,
        ),
        Material((1 - poisson_ratio**2) / slope, poisson_ratio, hardness, yield_stress),
        Load(pressure),
        body or Body(),
    )


def sphere_scene(
    force: float, *, nodes: int, nodes_to_rim: float, poisson_ratio: float = 0.3,
    yield_stress: float = np.inf, offset: tuple[float, float] = (0.21, 0.37),
) -> Scene:  # fmt: skip
    """A sphere of R = 1 m and E = 1 Pa under `force` (N); a contact of radius 0.05 m would have
    `nodes_to_rim` nodes along its radius.  offset: of its top from a node, in spacings."""
    period = nodes * 0.05 / nodes_to_rim
    x, y = (((np.arange(nodes) + o) / nodes - 0.5) * period for o in offset)
    return Scene(
        Surface(-(x[:, None] ** 2 + y[None, :] ** 2) / 2, (period, period)),
        Material(1.0, poisson_ratio, yield_stress=yield_stress),
        Load(force / period**2),
    )


def middle_of_a_path(nodes: int, layers: int) -> tuple[Problem, State, TangentCorrection]:
    """Half-way through the last increment: its start's history, its end's displacement."""
    before = solve_path(speed_scene(nodes, load=0.0375), layers=layers, steps=3, certified=False)
    after = solve_path(speed_scene(nodes, load=0.05), layers=layers, steps=4, certified=False)
    problem, state = after.problem, after.points[-1].state
    return problem, state, correction_at(problem, state.displacement, before.history)


def correction_at(problem: Problem, u: Any, history: Any) -> TangentCorrection:
    """The tangent's correction at the displacement `u` that starts from `history`."""
    _, flowing = internal_force(problem, u, history)
    return plasticity.tangent_correction(
        u.reshape(-1, 3), problem.bricks, problem.law, history, flowing
    )


def random_force(problem: Problem, state: State, seed: int) -> NDArray[np.float64]:
    """Random nodal forces where the base and the contact hold nothing."""
    right = np.random.default_rng(seed).standard_normal(problem.block.field_shape)
    right[-1] = 0
    right[0, ..., 2][state.states == ELASTIC] = 0
    return right


def solve_on_the_contact(
    problem: Problem, state: State, correction: TangentCorrection, right: Any, reduction: float
) -> tuple[Any, int]:
    """The step under the forces `right` on the contact set of `state`, and the CG iterations."""
    # One change of the set at most, after the solve; its goal is five times the forcing.
    linear, counts = linear_contact(
        state, right, Tangent(problem, correction), Control(approach=state.approach),
        forcing=reduction / 5, sweeps=1,
    )  # fmt: skip
    return linear.step, counts.cg


def whole_matrix(problem: Problem, correction: TangentCorrection, scale: float) -> sp.csr_matrix:
    """The elastic stiffness of all nodes less `scale` times the correction."""
    stiffness = layer_stiffness(problem.bricks, problem.law)
    return assembled(problem.bricks, tangents(problem.bricks, stiffness, correction, scale))


def contact_matrix(
    problem: Problem, state: State, correction: TangentCorrection
) -> tuple[sp.csr_matrix, NDArray[np.bool_]]:
    """The tangent without the held base and without the normal motion of the contact nodes, and
    which degrees of freedom it has."""
    K, size = whole_matrix(problem, correction, 1.0), 3 * problem.heights.size
    keep = np.ones(K.shape[0], dtype=bool)
    keep[-size:] = False
    keep[2:size:3] = (state.states != ELASTIC).ravel()
    return K[keep][:, keep].tocsr(), keep


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

#: A gate that only J2 flow on a flat block, under one load and beside a cap, can answer.
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
