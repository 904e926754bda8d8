"""The J2 law, point by point and through the elements."""

from __future__ import annotations

import numpy as np
import pytest
from fem_scenes import rough_scene

from fem_check import plasticity
from fem_check.driver import problem_of
from fem_check.element import CORNERS, elastic_stiffness, elements
from fem_check.plasticity import Law, law
from fem_check.vtu import von_mises


def return_map(strain: np.ndarray, rule: Law) -> tuple[np.ndarray, float]:
    """Stress and accumulated plastic strain at a (3, 3) strain from the virgin state: Simo and
    Hughes, box 3.1, written with tensors."""
    mean = np.trace(strain) * np.eye(3)
    trial = 2 * rule.shear * (strain - mean / 3)
    norm = np.linalg.norm(trial)
    over = max(norm - np.sqrt(2 / 3) * rule.yield_stress, 0.0)
    multiplier = over / (2 * rule.shear + 2 / 3 * rule.hardening)
    stress = trial * (1 - 2 * rule.shear * multiplier / norm) + rule.bulk * mean
    return stress, np.sqrt(2 / 3) * multiplier


def six(tensor: np.ndarray) -> np.ndarray:
    """Components xx, yy, zz, xy, yz, zx."""
    return tensor[[0, 1, 2, 0, 1, 2], [0, 1, 2, 1, 2, 0]]


def brick(seed: int = 3):  # type: ignore[no-untyped-def]
    """One skewed brick and a random displacement that makes it yield."""
    rng = np.random.default_rng(seed)
    corners = (CORNERS + 0.1 * rng.standard_normal((8, 3)))[None]
    return elements(np.arange(8)[None], np.zeros(1), corners), 0.05 * rng.standard_normal((8, 3))


@pytest.mark.parametrize("hardening", [0.0, 0.3])
def test_the_element_tangent_is_the_derivative_of_the_internal_force(hardening: float) -> None:
    bricks, u = brick()
    rule, history = law(2.0, 0.3, 0.02, hardening), plasticity.initial_history(1)
    rng = np.random.default_rng(4)
    _, flowing = plasticity.internal_force(u, bricks, rule, history)
    assert flowing.all()
    correction = plasticity.tangent_correction(u, bricks, rule, history, flowing)
    for _ in range(5):
        v = rng.standard_normal((8, 3))
        product, _ = plasticity.internal_force(v, bricks, rule, None)
        plasticity.add_correction(v, bricks, correction, 1.0, product)
        up, down = (
            plasticity.internal_force(u + s * 1e-7 * v, bricks, rule, history)[0] for s in (1, -1)
        )
        numeric = (up - down) / 2e-7
        assert np.abs(product - numeric).max() < 1e-6 * np.abs(numeric).max()


@pytest.mark.parametrize("yield_stress", [0.02, 1e3])
def test_the_compiled_element_agrees_with_the_point_law(yield_stress: float) -> None:
    bricks, u = brick(5)
    rule, history = law(2.0, 0.3, yield_stress, 0.1), plasticity.initial_history(1)
    stress = plasticity.stresses(u, bricks, rule, history)[0]
    _, flowing = plasticity.internal_force(u, bricks, rule, history)
    history = plasticity.commit(u, bricks, rule, history, flowing)
    assert (history.rows > 0).all() == flowing.all() == (yield_stress < 1)
    g = bricks.gradients[0]
    dilatation = float(np.einsum("ja,aj->", bricks.mean_gradients[0], u))
    for q in range(8):
        local = np.einsum("ja,ai->ij", g[:, :, q], u)
        e = (local + local.T) / 2
        e += np.eye(3) * (dilatation - np.trace(e)) / 3
        expected, accumulated = return_map(e, rule)
        np.testing.assert_allclose(stress[:, q], six(expected), rtol=1e-12, atol=1e-15)
        assert history.accumulated[history.rows[0], q] == pytest.approx(accumulated, rel=1e-12)


@pytest.mark.parametrize("hardening", [0.0, 0.5])
def test_the_return_lies_on_the_yield_surface_and_keeps_the_volume(hardening: float) -> None:
    bricks, u = brick(12)
    rule, history = law(2.0, 0.3, 0.01, hardening), plasticity.initial_history(1)
    for factor in (1.0, -0.5):  # on the way back, too
        stress = plasticity.stresses(factor * u, bricks, rule, history)
        _, flowing = plasticity.internal_force(factor * u, bricks, rule, history)
        history = plasticity.commit(factor * u, bricks, rule, history, flowing)
        radius = 0.01 + hardening * history.accumulated[history.rows]
        np.testing.assert_allclose(von_mises(np.moveaxis(stress, 1, 2)), radius, rtol=1e-12)
        np.testing.assert_allclose(
            history.plastic_strain[history.rows[0], :3].sum(axis=0), 0, atol=1e-15
        )


def test_committed_flow_leaves_the_same_force() -> None:
    bricks, u = brick(6)
    rule, history = law(2.0, 0.3, 0.02), plasticity.initial_history(1)
    first, flowing = plasticity.internal_force(u, bricks, rule, history)
    after = plasticity.commit(u, bricks, rule, history, flowing)
    again, _ = plasticity.internal_force(u, bricks, rule, after)
    # The return is idempotent.
    np.testing.assert_allclose(again, first, rtol=1e-12, atol=1e-15)


def test_the_elastic_element_passes_the_patch_test_on_any_shape() -> None:
    bricks, _ = brick(7)
    rng = np.random.default_rng(8)
    rule = law(2.0, 0.3, np.inf)
    corners = CORNERS + 0.1 * np.random.default_rng(7).standard_normal((8, 3))
    gradient = 1e-3 * rng.standard_normal((3, 3))
    for history in (plasticity.initial_history(1), None):  # without one, the law is elastic
        stress = plasticity.stresses(corners @ gradient.T, bricks, rule, history)[0]
        e = (gradient + gradient.T) / 2
        s = 2 * rule.shear * e + (rule.bulk - 2 * rule.shear / 3) * np.trace(e) * np.eye(3)
        np.testing.assert_allclose(stress, np.repeat(six(s), 8).reshape(6, 8), rtol=1e-11)


def test_the_element_has_the_six_rigid_motions_and_no_more() -> None:
    bricks, _ = brick(9)
    values = np.linalg.eigvalsh(elastic_stiffness(bricks, 0, 0.4, 0.9))
    assert (np.abs(values[:6]) < 1e-14).all()
    assert values[6] > 1e-3


def test_an_element_turned_inside_out_is_refused() -> None:
    corners = np.stack([CORNERS.astype(float), CORNERS * [1.0, 1.0, -1.0]])
    with pytest.raises(ValueError, match="inside out"):
        elements(np.arange(16).reshape(2, 8), np.arange(2), corners)


def test_a_box_answers_as_a_brick_of_any_shape() -> None:
    """The short cut for boxes against the gradients that scikit-fem gives, in a body that flows."""
    scene = rough_scene(8, 2)
    problem = problem_of(scene, law="j2", layers=3)
    rng, boxes = np.random.default_rng(11), problem.bricks
    assert boxes.sides is not None
    bricks, histories = boxes._replace(sides=None), []
    u = 0.01 * rng.standard_normal((int(np.prod(problem.block.field_shape[:3])), 3))
    for shape in (boxes, bricks):
        virgin = plasticity.initial_history(boxes.number)
        _, flowing = plasticity.internal_force(u, shape, problem.law, virgin)
        histories.append(plasticity.commit(u, shape, problem.law, virgin, flowing))
    np.testing.assert_array_equal(*[h.rows for h in histories])
    np.testing.assert_allclose(*[h.plastic_strain for h in histories], atol=1e-15)
    history = histories[0]
    v = u + 0.01 * rng.standard_normal(u.shape)
    found = [plasticity.internal_force(v, b, problem.law, history) for b in (boxes, bricks)]
    assert 0 < found[0][1].sum() == found[1][1].sum()
    scale = np.abs(found[1][0]).max()
    np.testing.assert_allclose(found[0][0], found[1][0], atol=1e-13 * scale)
    products = []
    for b, (_, flowing) in zip((boxes, bricks), found, strict=True):
        correction = plasticity.tangent_correction(v, b, problem.law, history, flowing)
        plasticity.add_correction(u, b, correction, 0.9, out := np.zeros_like(u))
        products.append(out)
    np.testing.assert_allclose(*products, atol=1e-13 * np.abs(products[1]).max())
