"""The sweeps over the flowing nodes: their rows are the assembled tangent's, their product with
the elastic block is symmetric, and they keep iterations from growing with the flowing zone."""

from __future__ import annotations

import numpy as np
import pytest
from fem_linear import (
    correction_at,
    middle_of_a_path,
    random_force,
    solve_on_the_contact,
    whole_matrix,
)
from fem_scenes import rough_scene

from epcontact.results import ELASTIC
from fem_check import linearised, plasticity, solve_path
from fem_check import smoother as sweeping
from fem_check.linear_solver import extend_to_base
from fem_check.linearised import Tangent
from fem_check.smoother import assemble, smoother


def flowing(nodes: int, *, dimensions: int = 2, depth: float | None = None) -> tuple:
    """A problem with its state and tangent, pushed on by a fifth from its converged state."""
    scene = rough_scene(nodes, 2, dimensions=dimensions, pressure=0.1)
    path = solve_path(scene, depth=depth, layers=5 if depth else None)
    state, problem = path.points[-1].state, path.problem
    correction = correction_at(problem, 1.2 * state.displacement, path.history)
    assert correction.which.size > 0
    return problem, state, correction


@pytest.mark.parametrize(("dimensions", "depth"), [(1, None), (2, None), (2, 0.2)])
def test_the_rows_are_the_assembled_tangents(dimensions: int, depth: float | None) -> None:
    """In plane strain both sides of a node across are the node itself; a shallow block flows to
    its held base."""
    problem, state, correction = flowing(12, dimensions=dimensions, depth=depth)
    scale, nodes = 0.9, int(np.prod(problem.block.field_shape[:3]))
    K = whole_matrix(problem, correction, 1 - scale)
    rows = assemble(problem.block.shape, problem.bricks, problem.stiffness, correction, scale)
    assert (rows.nodes < nodes - problem.heights.size).all()
    sweeps = smoother(rows, state.states == ELASTIC)
    residual = np.random.default_rng(4).standard_normal(problem.block.field_shape)
    for swept in (sweeps.pre_smooth(residual), sweeps.post_smooth(residual)):
        z, product = np.zeros_like(residual), np.zeros_like(residual)
        sweeps.add(swept, z)
        sweeps.add_product(1.0, swept, product)
        expected = (K @ z.ravel()).reshape(z.shape)
        np.testing.assert_allclose(product, expected, atol=1e-12 * np.abs(expected).max())
        # It moves what flows and not what the contact holds.
        assert not z[0, ..., 2][state.states == ELASTIC].any()
        assert set(np.flatnonzero(z.reshape(-1, 3).any(axis=1))) <= set(rows.nodes)
        assert z.any()


@pytest.mark.parametrize("load", [True, False])
def test_the_preconditioner_is_symmetric_and_keeps_its_product(load: bool) -> None:
    problem, state, correction = flowing(12)
    tangent = Tangent(problem, correction)
    contact = state.states == ELASTIC
    sweeps = smoother(tangent.rows, contact)
    rng, found = np.random.default_rng(5), []
    for _ in range(2):
        r = rng.standard_normal((tangent.levels, *problem.block.field_shape[1:]))
        r[0, ..., 2][contact] = 0
        # Residuals live where elements flow.
        flows = np.zeros(r.size // 3, dtype=bool)
        flows[tangent.rows.nodes] = True
        r.reshape(-1, 3)[~flows] = 0
        missing = float(rng.standard_normal()) if load else None
        z, Kz, approach = linearised.precondition(tangent, sweeps, r, missing, state.states)
        # The surface solves inside stop at 1e-6.
        np.testing.assert_allclose(
            z[0, ..., 2][contact], -approach, atol=1e-5 * np.abs(z[0, ..., 2]).max()
        )
        # Cut off below the flow, it goes on to the base without force.
        whole = np.concatenate([z, extend_to_base(problem.factor, z[-1], tangent.levels)])
        u = whole.reshape(-1, 3)
        product, _ = plasticity.internal_force(u, problem.bricks, problem.law, None)
        plasticity.add_correction(u, problem.bricks, correction, 1.0, product)
        product = product.reshape(whole.shape)
        product[-1] = 0
        scale = np.abs(product).max()
        np.testing.assert_allclose(product[: tangent.levels], Kz, atol=1e-11 * scale)
        np.testing.assert_allclose(product[tangent.levels :], 0, atol=1e-11 * scale)
        found.append((r, missing or 0.0, z, approach, Kz))
    (r, a, z, d, Kz), (s, b, w, e, Kw) = found
    assert np.vdot(s, z) + b * d == pytest.approx(np.vdot(r, w) + a * e, rel=1e-5)
    assert np.vdot(w, Kz) == pytest.approx(np.vdot(z, Kw), rel=1e-5)


def test_the_sweeps_halve_the_iterations_and_do_not_change_the_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem, state, correction = middle_of_a_path(24, 10)
    right, answers, iterations = random_force(problem, state, 6), [], []
    for worth in (linearised.WORTH_SMOOTHING, 0.0):
        monkeypatch.setattr(linearised, "WORTH_SMOOTHING", worth)
        answer, spent = solve_on_the_contact(problem, state, correction, right, 1e-8)
        answers.append(answer)
        iterations.append(spent)
    # The surface solves inside an iteration stop at 1e-6: Newton's next step mends the rest.
    np.testing.assert_allclose(answers[0], answers[1], atol=1e-5 * np.abs(answers[1]).max())
    assert iterations[0] <= 0.6 * iterations[1]


@pytest.mark.long
def test_more_sweeps_save_iterations_but_no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """128 x 128 x 32 elements: 14, 12 and 10 iterations to 1e-8 with 3, 6 and 20 sweeps on either
    side.  Exact solves of the flowing nodes would take 10, as 12 x 12 nodes take 7."""
    problem, state, correction = middle_of_a_path(128, 32)
    right, iterations = random_force(problem, state, 9), {}
    for sweeps in (3, 6, 20):
        monkeypatch.setattr(sweeping, "SWEEPS", sweeps)
        iterations[sweeps] = solve_on_the_contact(problem, state, correction, right, 1e-8)[1]
    assert 15 >= iterations[3] > iterations[6] > iterations[20]
    assert 3 * iterations[3] < 6 * iterations[6] < 20 * iterations[20]
