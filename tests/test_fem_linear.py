"""The linear problem: the inverse of the block, contact on its surface, the sweeps."""

import math

import numpy as np
import pytest
from fem_scenes import rough_heights, rough_scene
from limit_load import assemble, element_tangents
from scipy.sparse.linalg import spsolve

import fem_check
from epcontact.reference.layers import surface_compliance as exact_compliance
from epcontact.results import APART, ELASTIC, PLASTIC
from epcontact.studies.hardness import model_scene
from fem_check import driver, linearised, plasticity, solve_path
from fem_check.contact import rigid_contact
from fem_check.driver import problem_of
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
from fem_check.plasticity import j2_law
from fem_check.problem import Control
from fem_check.smoother import Smoother, assemble_rows
from fem_check.workers import Workers


def assert_close(actual, expected, relative):
    """Require |actual - expected| <= relative * max |expected| for each element of two
    arrays.
    """
    scale = np.abs(expected).max()
    np.testing.assert_allclose(actual, expected, rtol=0, atol=relative * scale)


# --- the inverse of the block, wave by wave


@pytest.mark.parametrize("sliding", [False, True])
@pytest.mark.parametrize("shape", [(8, 6), (7, 5), (12, 1), (2, 2)])
def test_it_inverts_the_elastic_forces(shape, sliding):
    """The layered solver finds a random displacement again from the forces that cause
    it.

    The forces are those of the element kernel; displacements agree to 1e-12. `shape` is
    the number of nodes along x and y; `sliding` holds only the normal displacement of
    the base.
    """
    law = j2_law(1.7, 0.3, math.inf)
    block = PeriodicBlock(shape, (0.1, 0.13), graded_layers(0.6, 0.1, 5), sliding)
    bricks = flat_elements(block)
    held = slice(0, 3)
    if sliding:
        held = slice(2, 3)
    u = np.random.default_rng(21).standard_normal(block.field_shape)
    u[-1] -= u[-1].mean(axis=(0, 1))
    u[-1, ..., held] = 0
    force, _ = plasticity.internal_force(u.reshape(-1, 3), bricks, law, None)
    force = force.reshape(u.shape)
    force[-1, ..., held] = 0
    factor = factorise(block, bricks, law)
    descent = top_descent(factor, eliminate(factor, force))
    np.testing.assert_allclose(descent, -u[0, ..., 2], atol=1e-12)
    contact_forces = -force[0, ..., 2]  # they press down
    force[0, ..., 2] = 0
    solution = substitute(factor, eliminate(factor, force), contact_forces)
    assert_close(solution, u, 1e-12)


@pytest.mark.parametrize("sliding", [False, True])
@pytest.mark.parametrize("poisson_ratio", [0.0, 0.3, 0.45])
def test_every_waves_compliance_converges_to_the_closed_form(poisson_ratio, sliding):
    """The compliance of a layer of depth 1/2 converges with second order for each wave.

    The layers are equal, and the waves have 1, 2 and 4 periods on the unit length.
    Uniform compression is exact.
    """
    law = j2_law(1.0, poisson_ratio, math.inf)
    grids = [32, 64, 128]
    waves = np.array([1, 2, 4])
    exact = exact_compliance(
        2 * np.pi * waves, 0.5, 1.0, poisson_ratio, bonded=not sliding
    )
    uniform = (1 + poisson_ratio) * (1 - 2 * poisson_ratio) / (1 - poisson_ratio)
    errors = []
    for n in grids:
        block = PeriodicBlock((n, 1), (1 / n, 1 / n), np.full(n // 2, 1 / n), sliding)
        factor = factorise(block, flat_elements(block), law)
        compliance = factor.surface[:, 0] * block.node_area
        errors.append(np.abs(compliance[waves] / exact - 1))
        # Uniform compression is exact on any mesh.
        assert compliance[0] == pytest.approx(0.5 * uniform, rel=1e-12)
    order = -np.polyfit(np.log(grids), np.log(errors), 1)[0]
    np.testing.assert_allclose(order, 2, atol=0.1)
    assert errors[-1][2] < 5e-3  # 32 points a wave; measured 0.2 to 0.4 %


# --- the contact on the surface


def assert_contact_conditions(compliance, heights, load, cap):
    """Solve the contact of a rigid flat, and check forces and gaps at every node.

    `compliance` is that of each mode in m/N; `heights`, (n,) or (n, n), are in m;
    `load`, in N, is the sum of the forces; `cap` is the largest force of a node in N.
    Gaps are judged to 1e-9 of the rms height, and forces to 1e-12 of the load.
    """
    contact = rigid_contact(compliance, heights, load=load, cap=cap)
    forces = contact.forces
    states = contact.states
    displacement = inverse_transform(compliance * transform(forces), len(heights))
    gap = (displacement - heights - contact.approach) / heights.std()
    assert forces.sum() == pytest.approx(load, rel=1e-12)
    assert np.abs(gap[states == ELASTIC]).max(initial=0) < 1e-9
    assert gap[states == APART].min(initial=0) > -1e-9
    assert gap[states == PLASTIC].max(initial=0) < 1e-9
    assert not forces[states == APART].any()
    assert (forces[states == PLASTIC] == cap).all()
    assert -1e-12 * load <= forces.min() <= forces.max() <= cap * (1 + 1e-9)


@pytest.mark.parametrize("highest", [4, 8, 15])
@pytest.mark.parametrize("fraction", [1e-4, 0.02, 0.3, 0.9, 0.99])
@pytest.mark.parametrize("hardness", [math.inf, 1.0, 0.05])
def test_the_solution_meets_every_condition(highest, fraction, hardness):
    """Forces and gaps meet the contact conditions from one asperity to full contact.

    `highest` is the largest wave number of the surface; `fraction` is the mean pressure
    over the hardness or, without a hardness, over 0.3 E. With `hardness` (in units of
    E) 0.05 nearly all nodes reach the cap.
    """
    block = PeriodicBlock((32, 32), (1 / 32, 1 / 32), graded_layers(0.9, 1 / 32))
    law = j2_law(1.0, 0.3, math.inf)
    factor = factorise(block, flat_elements(block), law)
    load = fraction * 0.3
    if math.isfinite(hardness):
        load = fraction * hardness
    heights = rough_heights(32, highest)
    assert_contact_conditions(factor.surface, heights, load, hardness / 32**2)


@pytest.mark.parametrize(
    ("nodes", "hardness", "seed", "fraction"),
    [(512, 0.3, 0, 0.2), (512, 0.3, 2, 0.5), (1024, 1.0, 3, 0.99), (32, 0.03, 0, 0.5)],
)
def test_lines_where_full_steps_cycle_or_whole_nodes_carry_the_load(
    nodes, hardness, seed, fraction
):
    """Profiles on which the active-set method once cycled meet the contact conditions.

    `hardness` is in units of E* xi, and `fraction` is the mean pressure over the
    hardness. In the last row a whole number of nodes at the hardness carries the load.
    """
    scene = rough_scene(
        nodes,
        nodes // 8,
        hardness=hardness,
        pressure=fraction * hardness,
        dimensions=1,
        seed=seed,
    )
    problem = problem_of(scene, FemOptions(law="capped"), 1)
    load = fraction * problem.cap * nodes
    assert_contact_conditions(
        problem.factor.surface, problem.heights, load, problem.cap
    )


# --- the sweeps over the flowing nodes


def flowing_body(*, dimensions=2, **options):
    """Return a problem, its converged state, and the plastic correction of its tangent.

    The correction is that at a displacement a fifth larger than the converged one, with
    some flowing elements. `options` are fields of `FemOptions`.
    """
    scene = rough_scene(12, 2, dimensions=dimensions, pressure=0.1)
    path = solve_path(scene, certified=False, **options)
    problem = path.problem
    state = path.points[-1].state
    u = 1.2 * state.displacement
    _, flowing = problem.internal_force(u, path.history)
    assert flowing.any()
    correction = plasticity.tangent_correction(
        u.reshape(-1, 3), problem.bricks, problem.law, path.history, flowing
    )
    return problem, state, correction


def tangent_matrix(problem, correction, scale):
    """Return the assembled sparse tangent, with `scale` times the plastic
    correction.
    """
    tangents = element_tangents(problem.bricks, problem.stiffness, correction, scale)
    return assemble(problem.bricks, tangents)


@pytest.mark.parametrize(
    "body",
    [{"dimensions": 1}, {"dimensions": 2}, {"depth": 0.2, "layers": 5}],
    ids=["line", "surface", "shallow"],
)
def test_the_rows_are_the_assembled_tangents(body):
    """The product of a sweep equals the assembled tangent times the sweep's
    displacement.

    The sweep moves flowing nodes, but neither the base nor the contact. On a line a
    node is its own neighbour, and in a shallow block elements flow down to the base.
    """
    problem, state, correction = flowing_body(**body)
    K = tangent_matrix(problem, correction, 0.9)
    contact = state.states == ELASTIC
    smoother = Smoother(assemble_rows(problem, correction, 0.9), contact)
    residual = np.random.default_rng(4).standard_normal(problem.block.field_shape)
    for transposed in (False, True):
        swept = smoother.smooth(residual, transposed=transposed)
        z = np.zeros_like(residual)
        smoother.add(swept, z)
        product = np.zeros_like(residual)
        smoother.add_product(1.0, swept, product)
        assert_close(product, (K @ z.ravel()).reshape(z.shape), 1e-12)
        # The sweeps move flowing nodes, but not the base nor the contact.
        assert z.any()
        assert not z[-1].any()
        assert not z[0, ..., 2][contact].any()


def test_the_sweeps_halve_the_iterations_of_the_direct_solve(monkeypatch):
    """With smoothing sweeps CG takes at most 0.6 of its iterations without them.

    Both solutions are those of scipy's direct sparse solver to 1e-5 of the largest
    value.
    """
    problem, state, correction = flowing_body()
    free = np.ones(problem.block.field_shape, dtype=bool)
    free[-1] = False
    free[0, ..., 2] = state.states != ELASTIC
    force = np.zeros(free.shape)
    force[free] = np.random.default_rng(6).standard_normal(free.sum())
    K = tangent_matrix(problem, correction, 1.0)[free.ravel()][:, free.ravel()]
    direct = np.zeros(free.shape)
    direct[free] = spsolve(K.tocsc(), force[free])
    iterations = []
    for goal in (linearised.SMOOTHING_GOAL, 0.0):
        monkeypatch.setattr(linearised, "SMOOTHING_GOAL", goal)
        solution, counts = linear_contact(
            state,
            force,
            Tangent(problem, correction),
            Control(approach=state.approach),
            forcing=1e-10,
            max_sweeps=1,
        )
        # The surface solves inside an iteration stop at 1e-6; Newton's next step mends
        # the difference.
        assert_close(solution.step, direct, 1e-5)
        iterations.append(counts.cg)
    with_sweeps, without_sweeps = iterations
    assert with_sweeps <= 0.6 * without_sweeps


def test_contact_forces_in_balance_up_to_rounding_are_not_improved():
    """A solve from a state that balances the load up to its last digit needs one
    elastic solve, and no conjugate gradients, on each contact set.

    In these rest forces there may be no direction left, and the step along it would be
    a division by zero.  Each load differs from the sum of the contact forces by another
    number of units in its last place, so that some of these solves leave a rest.
    """
    path = solve_path(rough_scene(12, 2, pressure=0.1), law="elastic", certified=False)
    problem = path.problem
    state = path.points[-1].state
    internal, _ = problem.internal_force(state.displacement, path.history)
    R = problem.reaction(state.states, internal)
    load = float(state.forces.sum())
    tangent = Tangent(problem, None)
    for excess in range(-20, 21):
        control = Control(load=load + excess * np.spacing(load))
        _, counts = linear_contact(state, R, tangent, control, forcing=1e-4)
        assert counts.most_cg == 1


# --- costs in counts


def test_a_load_path_stays_within_its_iterations_on_any_threads(monkeypatch):
    """One and three threads give the same pressures to the bit, within bounds of
    iterations.

    The bounds are 10 Newton steps an increment, and 20 CG iterations a Newton step.
    """

    def small_workers(threads):
        """Return `Workers` that use threads even for a single element."""
        return Workers(threads, min_elements=1)

    monkeypatch.setattr(driver, "Workers", small_workers)
    scene = model_scene(5.0, 0.3, 5, 32)
    options = FemOptions(layers=16, steps=4, certified=False)
    serial = fem_check.solve(scene, options, threads=1)
    threaded = fem_check.solve(scene, options, threads=3)
    np.testing.assert_array_equal(
        serial.fields["pressure"], threaded.fields["pressure"]
    )
    assert serial.cost["most_newton_steps"] <= 10
    assert serial.cost["cg_iterations"] <= 20 * serial.cost["newton_steps"]


def test_newton_is_quadratic_at_the_end_of_a_step():
    """The last residuals of Newton's method fall by more than 2.5 decades
    in one step.
    """
    scene = model_scene(5.0, 0.3, 5, 32)
    history = fem_check.solve(scene, steps=2, tolerance=1e-10).history
    final = [residual for residual in history if residual < 1e-2]
    # Two decades, then four or more: faster than any fixed factor.
    assert np.diff(np.log10(final)).min() < -2.5
    assert final[-1] <= 1e-10
