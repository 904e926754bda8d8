"""The J2 law, point by point and through the elements."""

from __future__ import annotations

import numpy as np
import pytest

from fem_check import plasticity
from fem_check.element import CORNERS, elastic_stiffness, elements
from fem_check.plasticity import law, return_map

TWICE = np.array([1.0, 1, 1, 2, 2, 2])


def von_mises(s: np.ndarray) -> float:
    d = s - np.array([1.0, 1, 1, 0, 0, 0]) * s[:3].mean()
    return float(np.sqrt(1.5 * (d * d * TWICE).sum()))


@pytest.mark.parametrize("hardening", [0.0, 0.3])
def test_the_consistent_tangent_is_the_derivative_of_the_stress(hardening: float) -> None:
    rng = np.random.default_rng(11)
    rule = law(2.0, 0.3, 0.01, hardening)
    for _ in range(20):
        strain, before = 0.02 * rng.standard_normal(6), 0.002 * rng.standard_normal(6)
        before[:3] -= before[:3].mean()
        tangent = return_map(strain, before, 0.1, rule)[3]
        numeric = np.empty((6, 6))
        for j in range(6):
            e = np.zeros(6)
            e[j] = 1e-7
            up, down = (return_map(strain + s * e, before, 0.1, rule)[0] for s in (1, -1))
            numeric[:, j] = (up - down) / 2e-7
        # Central differences of step 1e-7 on strains of 1e-2 err by 1e-9 of the modulus.
        assert np.abs(tangent - numeric).max() < 1e-6 * np.abs(tangent).max()


def test_the_return_lies_on_the_yield_surface_and_keeps_the_volume() -> None:
    rng = np.random.default_rng(12)
    for hardening in (0.0, 0.5):
        rule = law(2.0, 0.3, 0.01, hardening)
        strain = 0.05 * rng.standard_normal(6)
        stress, plastic, accumulated, _ = return_map(strain, np.zeros(6), 0.0, rule)
        assert accumulated > 0
        assert von_mises(stress) == pytest.approx(0.01 + hardening * accumulated, rel=1e-12)
        assert plastic[:3].sum() == pytest.approx(0.0, abs=1e-15)
        assert stress[:3].mean() == pytest.approx(rule.bulk * strain[:3].sum(), rel=1e-12)


def test_below_yield_it_is_hookes_law() -> None:
    rule = law(2.0, 0.3, 0.01)
    strain = np.array([1e-4, -2e-4, 3e-4, 1e-4, 0.0, -1e-4])
    stress, plastic, accumulated, _ = return_map(strain, np.zeros(6), 0.0, rule)
    lame = 2.0 * 0.3 / (1.3 * 0.4)
    hooke = 2 * 2.0 / 2.6 * strain + lame * strain[:3].sum() * np.array([1, 1, 1, 0, 0, 0])
    np.testing.assert_allclose(stress, hooke, rtol=1e-13, atol=1e-18)
    assert accumulated == 0
    assert not plastic.any()


def brick(seed: int = 3):  # type: ignore[no-untyped-def]
    """One skewed brick and a random displacement that makes it yield."""
    rng = np.random.default_rng(seed)
    corners = (CORNERS + 0.1 * rng.standard_normal((8, 3)))[None]
    return elements(np.arange(8)[None], np.zeros(1), corners), 0.05 * rng.standard_normal((8, 3))


@pytest.mark.parametrize("hardening", [0.0, 0.3])
def test_the_element_tangent_is_the_derivative_of_the_internal_force(hardening: float) -> None:
    bricks, u = brick()
    rule, history = law(2.0, 0.3, 0.02, hardening), plasticity.virgin(1)
    rng = np.random.default_rng(4)
    force, up, down, product = (np.empty((8, 3)) for _ in range(4))
    yielded = plasticity.force(u, bricks, rule, history, force)
    assert yielded.all()
    soft = plasticity.linearise(u, bricks, rule, history, yielded)
    for _ in range(5):
        v = rng.standard_normal((8, 3))
        plasticity.elastic_force(v, bricks, rule, product)
        plasticity.soften(v, bricks, soft, 1.0, product)
        plasticity.force(u + 1e-7 * v, bricks, rule, history, up)
        plasticity.force(u - 1e-7 * v, bricks, rule, history, down)
        numeric = (up - down) / 2e-7
        assert np.abs(product - numeric).max() < 1e-6 * np.abs(numeric).max()


def test_the_compiled_element_agrees_with_the_point_law() -> None:
    bricks, u = brick(5)
    rule, history = law(2.0, 0.3, 0.02, 0.1), plasticity.virgin(1)
    stress = plasticity.stresses(u, bricks, rule, history)[0]
    g = bricks.gradients[0]
    dilatation = float(np.einsum("ja,aj->", bricks.mean_gradients[0], u))
    for q in range(8):
        local = np.einsum("ja,ai->ij", g[:, :, q], u)
        e = (local + local.T) / 2
        e += np.eye(3) * (dilatation - np.trace(e)) / 3
        point = np.array([e[0, 0], e[1, 1], e[2, 2], e[0, 1], e[1, 2], e[2, 0]])
        expected = return_map(point, np.zeros(6), 0.0, rule)[0]
        np.testing.assert_allclose(stress[:, q], expected, rtol=1e-12, atol=1e-15)
    plasticity.commit(u, bricks, rule, history)
    assert (history.accumulated > 0).all()
    np.testing.assert_allclose(history.plastic_strain[0, :3].sum(axis=0), 0, atol=1e-15)


def test_force_reads_the_history_and_commit_alone_moves_it() -> None:
    bricks, u = brick(6)
    rule, history = law(2.0, 0.3, 0.02), plasticity.virgin(1)
    first, again = np.empty((8, 3)), np.empty((8, 3))
    plasticity.force(u, bricks, rule, history, first)
    assert not history.accumulated.any()
    plasticity.commit(u, bricks, rule, history)
    plasticity.force(u, bricks, rule, history, again)
    # Committed, the same displacement bears the same force: the return is idempotent.
    np.testing.assert_allclose(again, first, rtol=1e-12, atol=1e-15)


def test_the_elastic_element_passes_the_patch_test_on_any_shape() -> None:
    bricks, _ = brick(7)
    rng = np.random.default_rng(8)
    rule = law(2.0, 0.3, np.inf)
    corners = CORNERS + 0.1 * np.random.default_rng(7).standard_normal((8, 3))
    gradient = 1e-3 * rng.standard_normal((3, 3))
    stress = plasticity.stresses(corners @ gradient.T, bricks, rule, plasticity.virgin(1))[0]
    e = (gradient + gradient.T) / 2
    s = 2 * rule.shear * e + (rule.bulk - 2 * rule.shear / 3) * np.trace(e) * np.eye(3)
    expected = [s[0, 0], s[1, 1], s[2, 2], s[0, 1], s[1, 2], s[2, 0]]
    np.testing.assert_allclose(stress, np.repeat(expected, 8).reshape(6, 8), rtol=1e-11)


def test_the_element_has_the_six_rigid_motions_and_no_more() -> None:
    bricks, _ = brick(9)
    values = np.linalg.eigvalsh(elastic_stiffness(bricks, 0, 0.4, 0.9))
    assert (np.abs(values[:6]) < 1e-14).all()
    assert values[6] > 1e-3


def test_an_element_turned_inside_out_is_refused() -> None:
    corners = np.stack([CORNERS.astype(float), CORNERS * [1.0, 1.0, -1.0]])
    with pytest.raises(ValueError, match="inside out"):
        elements(np.arange(16).reshape(2, 8), np.arange(2), corners)
