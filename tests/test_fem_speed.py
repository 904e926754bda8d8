"""Costs in counts: iterations hardly grow with the mesh, and every solver solves one system."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from fem_linear import contact_matrix, middle_of_a_path, random_force, solve_on_the_contact
from scipy.sparse.linalg import cg, spsolve

import fem_check
from epcontact.studies import fem
from fem_check import driver, increments
from fem_check.benchmarks import speed
from fem_check.problem import State
from fem_check.workers import Workers


def test_the_preconditioned_solve_is_the_direct_solve() -> None:
    problem, state, correction = middle_of_a_path(16, 6)
    assert correction.which.size > 0
    right = random_force(problem, state, 1)
    K, keep = contact_matrix(problem, state, correction)
    direct = np.zeros(right.size)
    direct[keep] = spsolve(K.tocsc(), right.ravel()[keep])
    # To a residual of 1e-10 N, as the forces are of the order of 1.
    reduction = 1e-10 / float(np.linalg.norm(right))
    found, _ = solve_on_the_contact(problem, state, correction, right, reduction)
    # The surface solves inside an iteration stop at 1e-6: Newton's next step mends what is left.
    np.testing.assert_allclose(found.ravel(), direct, atol=1e-6 * np.abs(direct).max())


@pytest.mark.slow
def test_iterations_hardly_grow_with_the_mesh() -> None:
    """A grid three times as fine: the linear solve by at most half as many iterations again, and
    Jacobi's many times as many throughout."""
    ours, jacobis = [], []
    for nodes in (12, 36):
        problem, state, correction = middle_of_a_path(nodes, nodes // 2)
        right, spent = random_force(problem, state, 9), []
        ours.append(solve_on_the_contact(problem, state, correction, right, 1e-8)[1])
        K, keep = contact_matrix(problem, state, correction)
        M = sp.diags(1 / K.diagonal())
        _, failed = cg(K, right.ravel()[keep], rtol=1e-8, maxiter=5000, M=M, callback=spent.append)
        assert not failed
        jacobis.append(len(spent))
    assert ours[1] <= 25
    assert ours[1] < 1.5 * ours[0]
    assert jacobis[1] > 1.5 * jacobis[0]
    assert jacobis[1] > 10 * ours[1]


@pytest.mark.parametrize(
    ("nodes", "layers"), [(32, 16), pytest.param(64, 24, marks=pytest.mark.slow)]
)
def test_a_load_path_stays_within_its_iterations_on_any_threads(
    nodes: int, layers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Threads do not change a bit, however little they share."""
    monkeypatch.setattr(driver, "Workers", lambda threads: Workers(threads, fewest=1))
    scene = speed.speed_scene(nodes)
    one, two = (
        fem_check.solve(scene, layers=layers, steps=4, certified=False, threads=threads)
        for threads in (1, 3)
    )
    np.testing.assert_array_equal(one.fields["pressure"], two.fields["pressure"])
    cost = one.cost
    assert cost["most_newton_steps"] <= 10
    assert cost["cg_iterations"] <= 20 * cost["newton_steps"]
    assert cost["unknowns"] == 3 * nodes**2 * layers


@pytest.mark.long
def test_iterations_of_a_path_hardly_grow_with_the_mesh() -> None:
    """All CG iterations of a path, from 32^2 to 128^2, mean of four surfaces that gain short waves
    with the mesh: 68.5 to 102.8, by 1.50; the order of sums moves each count by 2.

    Of surface 5's growth from 74 to 98, 12 are solves after a change of the contact set, which has
    farther to go in nodes.  256 x 256 x 32 elements take 118, and fem-largest takes 144."""
    found = {}
    for nodes, layers in ((32, 16), (128, 32)):
        results = [
            fem_check.solve(
                speed.speed_scene(nodes, seed=seed), layers=layers, steps=4, certified=False
            )
            for seed in (5, 6, 7, 8)
        ]
        assert max(r.cost["most_newton_steps"] for r in results) <= 10
        assert max(r.cost["most_cg_iterations"] for r in results) <= 20
        found[nodes] = np.mean([r.cost["cg_iterations"] for r in results])
    assert found[128] <= 1.55 * found[32]


@pytest.mark.long
def test_what_a_better_start_of_an_increment_would_save(monkeypatch: pytest.MonkeyPatch) -> None:
    """The final contact set, known beforehand, saves nothing; and the displacement ten times nearer
    than by extrapolation, which no coarser grid gives, saves a third but leaves the growth."""
    solve, kept = increments.solve_increment, list[State]()
    counts = np.zeros((2, 3))

    def started(nearer: float) -> Any:
        final = iter(kept)

        def better(problem: Any, state: State, *rest: Any) -> Any:
            end = next(final)
            u = end.displacement + nearer * (state.displacement - end.displacement)
            d = end.approach + nearer * (state.approach - end.approach)
            return solve(problem, State(u, d, end.states.copy(), state.forces), *rest)

        return better

    def remembered(*given: Any) -> Any:
        found = solve(*given)
        kept.append(found.state)
        return found

    for row, (nodes, layers) in zip(counts, ((32, 16), (128, 32)), strict=True):
        for seed in (5, 6):
            kept.clear()
            for i, start in enumerate((remembered, started(1.0), started(0.1))):
                monkeypatch.setattr(increments, "solve_increment", start)
                scene = speed.speed_scene(nodes, seed=seed)
                path = fem_check.solve(scene, layers=layers, steps=4, certified=False)
                row[i] += path.cost["cg_iterations"]
    as_it_is, set_known, near = counts.T
    assert (set_known >= 0.95 * as_it_is).all()
    assert (near >= 0.6 * as_it_is).all()
    assert near[1] / near[0] >= 0.95 * as_it_is[1] / as_it_is[0]


def test_the_growth_of_paths_is_that_of_their_results(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fem, "fft_pair_seconds", lambda: 0.1)  # of 2048 x 2048: longer than these
    costs = fem.path_costs([(8, 4), (16, 8)], [5, 6], lambda sentence: None).set_index("nodes")
    for nodes in (8, 16):
        paths = [fem_check.solve(speed.speed_scene(nodes, seed=s), layers=nodes // 2, steps=4).cost
                 for s in (5, 6)]  # fmt: skip
        mean = np.mean([path["cg_iterations"] for path in paths])
        assert costs["conjugate gradients"][nodes] == mean
        assert costs["Newton"][nodes] == np.mean([path["newton_steps"] for path in paths])
    assert (costs["time_in_fft_pairs"] > 0).all()
    assert costs["two_threads"].between(1, 2).all()
    growth = costs["conjugate gradients"][16] / costs["conjugate gradients"][8]
    assert f"grow by {growth:.2f}" in fem.draw_paths(costs.reset_index(), 2).caption


def test_newton_is_quadratic_at_the_end_of_a_step() -> None:
    history = fem_check.solve(speed.speed_scene(32), steps=2, tolerance=1e-10).history
    last = [r for r in history if r < 1e-2]
    # Two decades, then four or more: faster than any fixed factor.
    rates = np.diff(np.log10(last))
    assert rates.min() < -2.5
    assert last[-1] <= 1e-10


def test_the_unit_of_time_is_positive() -> None:
    assert speed.fft_pair_seconds(64, 1) > 0
