"""The surface problem: contact of a body given by its compliance."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fem_scenes import rough_heights

from epcontact.results import APART, ELASTIC, PLASTIC
from fem_check import plasticity
from fem_check.contact import rigid_contact, solve_contact_forces
from fem_check.linear_solver import factorise, inverse, transform
from fem_check.mesh import PeriodicBlock, flat_elements, graded_layers


def compliance(shape: tuple[int, int]) -> np.ndarray:
    n = shape[0]
    block = PeriodicBlock(shape, (1 / n, 1 / n), graded_layers(0.9, 1 / n))
    return factorise(block, flat_elements(block), plasticity.law(1.0, 0.3, math.inf)).surface


def dense(symbol: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    count = shape[0] * shape[1]
    columns = [
        inverse(symbol * transform(np.eye(count)[i].reshape(shape)), shape[0]).ravel()
        for i in range(count)
    ]
    return np.array(columns).T


def test_press_ends_where_only_rounding_is_left() -> None:
    """A flat body in full contact, or forces that are right from the start: nothing to search."""
    shape = (6, 5)
    symbol, everywhere = compliance(shape), np.ones(shape, dtype=bool)
    even = solve_contact_forces(symbol, np.full(shape, 0.3), everywhere, 2.0)
    np.testing.assert_allclose(even.forces, 2.0 / everywhere.sum(), rtol=1e-12)
    rng = np.random.default_rng(37)
    forces = rng.random(shape)
    wanted = inverse(symbol * transform(forces), shape[0]) + 0.2
    again = solve_contact_forces(symbol, wanted, everywhere, float(forces.sum()), start=forces)
    np.testing.assert_allclose(again.forces, forces, rtol=1e-9)


@pytest.mark.parametrize("load", [0.3, None])
def test_press_agrees_with_a_dense_solve(load: float | None) -> None:
    shape = (6, 5)
    symbol = compliance(shape)
    rng = np.random.default_rng(31)
    contact, wanted = rng.random(shape) < 0.5, rng.standard_normal(shape)
    S = dense(symbol, shape)[np.ix_(contact.ravel(), contact.ravel())]
    if load is None:
        expected, d = np.linalg.solve(S, wanted[contact]), 0.0
    else:
        one = np.ones((len(S), 1))
        K = np.block([[S, -one], [one.T, np.zeros((1, 1))]])
        *expected, d = np.linalg.solve(K, np.append(wanted[contact], load))
    found = solve_contact_forces(symbol, wanted, contact, load)
    np.testing.assert_allclose(found.forces[contact], expected, rtol=1e-8, atol=1e-8)
    assert found.approach == pytest.approx(d, abs=1e-8)
    assert not found.forces[~contact].any()


@pytest.mark.parametrize("highest", [4, 8, 15])
@pytest.mark.parametrize("share", [1e-4, 0.02, 0.3, 0.9, 0.99])
@pytest.mark.parametrize("cap", [math.inf, 1.0, 0.05])
def test_the_solution_meets_every_condition(highest: int, share: float, cap: float) -> None:
    """From a single asperity to a surface nearly all at the cap or nearly all in contact."""
    n = 32
    symbol, heights = compliance((n, n)), rough_heights(n, highest, slope=0.05)
    nodal_cap = cap / n**2
    load = share * (cap if math.isfinite(cap) else 0.3)
    solved = rigid_contact(symbol, heights, load=load, cap=nodal_cap)
    forces, states = solved.forces, solved.states
    gap = inverse(symbol * transform(forces), n) - heights - solved.approach
    rms = heights.std()
    assert forces.sum() == pytest.approx(load, rel=1e-12)
    assert np.abs(gap[states == ELASTIC]).max(initial=0) < 1e-9 * rms
    assert gap[states == APART].min(initial=0) > -1e-9 * rms
    assert gap[states == PLASTIC].max(initial=0) < 1e-9 * rms
    assert not forces[states == APART].any()
    assert forces.min() >= -1e-12 * load
    assert (forces[states == PLASTIC] == nodal_cap).all()
    assert forces.max() <= nodal_cap * (1 + 1e-9)


def test_pressing_to_the_approach_of_a_load_finds_that_load() -> None:
    symbol, heights = compliance((32, 32)), rough_heights(32, 6)
    by_load = rigid_contact(symbol, heights, load=0.02)
    by_approach = rigid_contact(symbol, heights, approach=by_load.approach)
    np.testing.assert_allclose(by_approach.forces, by_load.forces, atol=1e-9 * 0.02)


def test_the_capped_contact_is_symmetric_in_particles_and_holes() -> None:
    n = 32
    symbol, heights = compliance((n, n)), rough_heights(n, 6)
    cap = 0.4 / n**2
    one = rigid_contact(symbol, heights, load=0.1, cap=cap)
    other = rigid_contact(symbol, -heights, load=0.4 - 0.1, cap=cap)
    np.testing.assert_allclose(other.forces, cap - one.forces, atol=1e-8 * cap)
