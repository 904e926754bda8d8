"""The linear problem: the block inverted wave by wave, the contact on its surface, the
sweeps.
"""

import math

import numpy as np
import pytest
from fem_scenes import rough_heights, rough_scene
from scipy.sparse.linalg import spsolve

import fem_check
from epcontact.reference.layers import surface_compliance as exact_compliance
from epcontact.results import APART, ELASTIC, PLASTIC
from epcontact.studies.hardness import model_scene
from fem_check import driver, linearised, plasticity, solve_path
from fem_check.contact import rigid_contact
from fem_check.driver import problem_of
from fem_check.limit_load import assemble, element_tangents
from fem_check.linear_solver import (
    eliminate,
    factorise,
    inverse_transform,
    substitute,
    top_descent,
    transform,
)
from fem_check.linearised import Tangent, linear_contact
from fem_check.mesh import PeriodicBlock, flat_elements, graded_layers
from fem_check.options import FemOptions
from fem_check.problem import Control
from fem_check.smoother import Smoother, assemble_rows
from fem_check.workers import Workers

RULE = plasticity.j2_law(1.7, 0.3, math.inf)

# The block, wave by wave
# ---------------------------------------------------------------------


@pytest.mark.parametrize("sliding", [False, True])
@pytest.mark.parametrize("shape", [(8, 6), (7, 5), (12, 1), (2, 2)])
def test_it_inverts_the_assembled_stiffness(shape, sliding):
    block = PeriodicBlock(shape, (0.1, 0.13), graded_layers(0.6, 0.1, 5), sliding)
    bricks, u = (
        flat_elements(block),
        np.random.default_rng(21).standard_normal(block.field_shape),
    )
    u[-1] -= u[-1].mean(axis=(0, 1))
    u[-1, ..., 2 if sliding else 0 :] = 0
    force = plasticity.internal_force(u.reshape(-1, 3), bricks, RULE, None)[0].reshape(
        u.shape
    )
    elastic = plasticity.layer_stiffness(bricks, RULE)[0][bricks.shape_of].reshape(
        -1, 24, 24
    )
    product = (assemble(bricks, elastic) @ u.ravel()).reshape(u.shape)
    np.testing.assert_allclose(product, force, atol=1e-12 * np.abs(force).max())
    force[-1, ..., 2 if sliding else 0 :] = 0
    factor, pressing = factorise(block, bricks, RULE), -force[0, ..., 2]
    descent = top_descent(factor, eliminate(factor, force))
    np.testing.assert_allclose(descent, -u[0, ..., 2], atol=1e-12)
    force[0, ..., 2] = 0  # a contact force presses down
    found = substitute(factor, eliminate(factor, force), pressing)
    assert np.abs(found - u).max() < 1e-12 * np.abs(u).max()


@pytest.mark.parametrize("sliding", [False, True])
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.45])
def test_every_waves_compliance_converges_to_the_closed_form(nu, sliding):
    """Layer of depth 1/2 and equal layers: second order in the points a wave."""
    rule, errors = plasticity.j2_law(1.0, nu, math.inf), []
    grids, waves = np.array([32, 64, 128]), np.array([1, 2, 4])
    for n in grids:
        block = PeriodicBlock((n, 1), (1 / n, 1 / n), np.full(n // 2, 1 / n), sliding)
        found = (
            factorise(block, flat_elements(block), rule).surface[:, 0] * block.node_area
        )
        exact = exact_compliance(2 * np.pi * waves, 0.5, 1.0, nu, bonded=not sliding)
        errors.append(np.abs(found[waves] / exact - 1))
        # Uniform compression is exact on any mesh.
        assert found[0] == pytest.approx(
            0.5 * (1 + nu) * (1 - 2 * nu) / (1 - nu), rel=1e-12
        )
    order = -np.polyfit(np.log(grids), np.log(errors), 1)[0]
    assert (np.abs(order - 2) < 0.1).all(), order
    assert errors[-1][2] < 5e-3  # 32 points a wave; measured 0.2 to 0.4 %


# The contact on the surface
# ------------------------------------------------------------------


@pytest.mark.parametrize("highest", [4, 8, 15])
@pytest.mark.parametrize("share", [1e-4, 0.02, 0.3, 0.9, 0.99])
@pytest.mark.parametrize("cap", [math.inf, 1.0, 0.05])
def test_the_solution_meets_every_condition(highest, share, cap):
    """Scenes go from one asperity to a surface nearly all at the cap, or nearly all in
    contact.
    """
    block = PeriodicBlock((32, 32), (1 / 32, 1 / 32), graded_layers(0.9, 1 / 32))
    rule = plasticity.j2_law(1.0, 0.3, math.inf)
    symbol = factorise(block, flat_elements(block), rule).surface
    heights, load = (
        rough_heights(32, highest),
        share * (cap if math.isfinite(cap) else 0.3),
    )
    meets_every_condition(symbol, heights, load, cap / 32**2)


@pytest.mark.parametrize(
    ("nodes", "hardness", "seed", "share"),
    [(512, 0.3, 0, 0.2), (512, 0.3, 2, 0.5), (1024, 1.0, 3, 0.99), (32, 0.03, 0, 0.5)],
)
def test_lines_where_full_steps_cycle_or_whole_nodes_carry_the_load(
    nodes, hardness, seed, share
):
    scene = rough_scene(
        nodes,
        nodes // 8,
        hardness=hardness,
        pressure=share * hardness,
        dimensions=1,
        seed=seed,
    )
    problem = problem_of(scene, FemOptions(law="capped"), 1)
    load = share * problem.cap * nodes
    meets_every_condition(problem.factor.surface, problem.heights, load, problem.cap)


def meets_every_condition(symbol, heights, load, nodal_cap):
    solved = rigid_contact(symbol, heights, load=load, cap=nodal_cap)
    forces, states = solved.forces, solved.states
    gap = (
        inverse_transform(symbol * transform(forces), len(heights))
        - heights
        - solved.approach
    )
    gap /= heights.std()
    assert forces.sum() == pytest.approx(load, rel=1e-12)
    assert np.abs(gap[states == ELASTIC]).max(initial=0) < 1e-9
    assert gap[states == APART].min(initial=0) > -1e-9
    assert gap[states == PLASTIC].max(initial=0) < 1e-9
    assert not forces[states == APART].any()
    assert (forces[states == PLASTIC] == nodal_cap).all()
    assert -1e-12 * load <= forces.min() <= forces.max() <= nodal_cap * (1 + 1e-9)


# The sweeps over the flowing nodes
# -----------------------------------------------------------


def flowing(*, dimensions=2, depth=None):
    """A problem with its state and tangent, pushed on by a fifth from its converged
    state.
    """
    scene = rough_scene(12, 2, dimensions=dimensions, pressure=0.1)
    path = solve_path(scene, depth=depth, layers=5 if depth else None, certified=False)
    problem, state = path.problem, path.points[-1].state
    u = 1.2 * state.displacement
    which = problem.internal_force(u, path.history)[1]
    assert which.any()
    correction = plasticity.tangent_correction(
        u.reshape(-1, 3), problem.bricks, problem.law, path.history, which
    )
    return problem, state, correction


def tangent_matrix(problem, correction, scale=1.0):
    stiffness = plasticity.layer_stiffness(problem.bricks, problem.law)
    return assemble(
        problem.bricks, element_tangents(problem.bricks, stiffness, correction, scale)
    )


@pytest.mark.parametrize(("dimensions", "depth"), [(1, None), (2, None), (2, 0.2)])
def test_the_rows_are_the_assembled_tangents(dimensions, depth):
    """In plane strain both sides of a node across are the node itself; a shallow block
    flows to its held base.
    """
    problem, state, correction = flowing(dimensions=dimensions, depth=depth)
    K = tangent_matrix(problem, correction, 0.9)
    sweeps = Smoother(assemble_rows(problem, correction, 0.9), state.states == ELASTIC)
    residual = np.random.default_rng(4).standard_normal(problem.block.field_shape)
    for swept in (sweeps.smooth(residual), sweeps.smooth(residual, transposed=True)):
        z, product = np.zeros_like(residual), np.zeros_like(residual)
        sweeps.add(swept, z)
        sweeps.add_product(1.0, swept, product)
        expected = (K @ z.ravel()).reshape(z.shape)
        np.testing.assert_allclose(
            product, expected, atol=1e-12 * np.abs(expected).max()
        )
        # It moves what flows, and neither the base nor what the contact holds.
        assert z.any()
        assert not z[-1].any()
        assert not z[0, ..., 2][state.states == ELASTIC].any()


def test_the_sweeps_halve_the_iterations_of_the_direct_solve(monkeypatch):
    problem, state, correction = flowing()
    right, size = np.zeros(problem.block.field_shape), 3 * problem.heights.size
    keep = np.ones(right.size, dtype=bool)
    keep[-size:] = False  # the base, and the normal motion of the contact
    keep[2:size:3] = (state.states != ELASTIC).ravel()
    right.ravel()[keep] = np.random.default_rng(6).standard_normal(keep.sum())
    direct, spent = np.zeros(right.size), []
    K = tangent_matrix(problem, correction)[keep][:, keep]
    direct[keep] = spsolve(K.tocsc(), right.ravel()[keep])
    for worth in (linearised.SMOOTHING_GOAL, 0.0):
        monkeypatch.setattr(linearised, "SMOOTHING_GOAL", worth)
        tangent, control = (
            Tangent(problem, correction),
            Control(approach=state.approach),
        )
        found, counts = linear_contact(
            state, right, tangent, control, forcing=1e-10, max_sweeps=1
        )
        # The surface solves inside an iteration stop at 1e-6: Newton's next step mends
        # the rest.
        np.testing.assert_allclose(
            found.step.ravel(), direct, atol=1e-5 * np.abs(direct).max()
        )
        spent.append(counts.cg)
    assert spent[0] <= 0.6 * spent[1]


# Costs in counts
# -----------------------------------------------------------------------------


def test_a_load_path_stays_within_its_iterations_on_any_threads(monkeypatch):
    """Threads do not change a bit, however little they share."""
    monkeypatch.setattr(
        driver, "Workers", lambda threads: Workers(threads, min_elements=1)
    )
    scene, options = (
        model_scene(5.0, 0.3, 5, 32),
        {"layers": 16, "steps": 4, "certified": False},
    )
    one, two = (
        fem_check.solve(scene, threads=threads, **options) for threads in (1, 3)
    )
    np.testing.assert_array_equal(one.fields["pressure"], two.fields["pressure"])
    assert one.cost["most_newton_steps"] <= 10
    assert one.cost["cg_iterations"] <= 20 * one.cost["newton_steps"]


def test_newton_is_quadratic_at_the_end_of_a_step():
    history = fem_check.solve(
        model_scene(5.0, 0.3, 5, 32), steps=2, tolerance=1e-10
    ).history
    last = [r for r in history if r < 1e-2]
    # Two decades, then four or more: faster than any fixed factor.
    assert np.diff(np.log10(last)).min() < -2.5
    assert last[-1] <= 1e-10
