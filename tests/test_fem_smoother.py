"""The sweeps over the flowing nodes: their rows are the assembled tangent's, their product with
the elastic block is symmetric, and they keep iterations from growing with the flowing zone."""

from __future__ import annotations

import numpy as np
import pytest
from fem_scenes import rough_scene

from epcontact.results import ELASTIC
from fem_check import linearised, plasticity
from fem_check.benchmarks import speed
from fem_check.benchmarks.bodies import assembled, elastic_tangents, tangents
from fem_check.driver import solve_path
from fem_check.element import strain_operator
from fem_check.linear_solver import continued
from fem_check.linearised import Tangent
from fem_check.problem import Control, Counts, internal_force
from fem_check.smoother import assemble, smoother


def flowing(nodes: int, *, dimensions: int = 2, depth: float | None = None) -> tuple:
    """A problem with its state and softening, pushed on by a fifth from its converged state."""
    scene = rough_scene(nodes, 2, dimensions=dimensions, pressure=0.1)
    path = solve_path(scene, depth=depth, layers=5 if depth else None)
    state, problem = path.reached[-1].state, path.problem
    u = 1.2 * state.displacement
    _, yielded = internal_force(problem, u, path.history)
    softening = plasticity.linearise(
        u.reshape(-1, 3), problem.bricks, problem.law, path.history, yielded
    )
    assert softening.which.size > 0
    return problem, state, softening


@pytest.mark.parametrize(("dimensions", "depth"), [(1, None), (2, None), (2, 0.2)])
def test_the_rows_are_the_assembled_tangents(dimensions: int, depth: float | None) -> None:
    """In plane strain both sides of a node across are the node itself; a shallow block flows to
    its held base."""
    problem, state, softening = flowing(12, dimensions=dimensions, depth=depth)
    bricks, scale = problem.bricks, 0.9
    strain = np.stack([strain_operator(bricks, s) for s in range(len(bricks.gradients))])
    elastic = elastic_tangents(bricks, problem.law, strain)
    nodes = int(np.prod(problem.block.field_shape[:3]))
    K = assembled(bricks, tangents(bricks, elastic, strain, softening, 1 - scale), nodes)
    rows = assemble(problem.block.shape, bricks, problem.law, softening, scale)
    assert (rows.nodes < nodes - problem.heights.size).all()
    sweeps = smoother(rows, state.states == ELASTIC)
    residual = np.random.default_rng(4).standard_normal(problem.block.field_shape)
    for swept in (sweeps.before(residual), sweeps.after(residual)):
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
    problem, state, softening = flowing(12)
    tangent = Tangent(problem, softening)
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
        z, Kz, approach = linearised._preconditioned(tangent, sweeps, r, missing, state.states)
        # The surface solves inside stop at 1e-6.
        np.testing.assert_allclose(
            z[0, ..., 2][contact], -approach, atol=1e-5 * np.abs(z[0, ..., 2]).max()
        )
        # Cut off below the flow, it goes on to the base without force.
        whole = np.concatenate([z, continued(problem.factor, z[-1], tangent.levels)])
        product = np.empty_like(whole)
        plasticity.elastic_force(
            whole.reshape(-1, 3), problem.bricks, problem.law, product.reshape(-1, 3)
        )
        plasticity.soften(
            whole.reshape(-1, 3), problem.bricks, softening, 1.0, product.reshape(-1, 3)
        )
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
    problem, state, softening = speed._middle(24, 10)
    right = np.random.default_rng(6).standard_normal(problem.block.field_shape)
    right[-1] = 0
    right[0, ..., 2][state.states == ELASTIC] = 0
    answers, iterations = [], []
    for worth in (linearised.WORTH_SWEEPING, 0.0):
        monkeypatch.setattr(linearised, "WORTH_SWEEPING", worth)
        counts = Counts()
        control = Control(approach=state.approach)
        goal = 1e-8 * float(np.linalg.norm(right))
        answers.append(
            linearised.solve_linear(problem, state, softening, right, control, goal, counts)
        )
        iterations.append(counts.cg)
    # The surface solves inside an iteration stop at 1e-6: Newton's next step mends the rest.
    np.testing.assert_allclose(answers[0], answers[1], atol=1e-5 * np.abs(answers[1]).max())
    assert iterations[0] <= 0.6 * iterations[1]
