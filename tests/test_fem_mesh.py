"""The block: its depth, its layers, its nodes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fem_scenes import rough_scene

from epcontact.errors import InvalidScene
from epcontact.reference.layers import surface_compliance as exact_compliance
from epcontact.scene import Body
from fem_check import plasticity, surface_compliance
from fem_check.linear_solver import factorise
from fem_check.mesh import (
    GROWTH,
    PeriodicBlock,
    block_for,
    flat_elements,
    graded_layers,
    half_space_depth,
    moved_elements,
)


@pytest.mark.parametrize("poisson_ratio", [0.0, 0.3, 0.45])
def test_the_depth_is_the_least_that_hides_the_base(poisson_ratio: float) -> None:
    depth = half_space_depth(2.0, poisson_ratio, 1e-3)
    q = np.array([math.pi])
    half = 2 * (1 - poisson_ratio**2) / q

    def off(d: float) -> float:
        return abs(float((exact_compliance(q, d, 1.0, poisson_ratio) / half)[0]) - 1)

    assert off(depth) == pytest.approx(1e-3, rel=1e-3)
    assert off(0.98 * depth) > 1e-3


def test_the_layers_fill_the_depth_and_thicken_no_faster_than_allowed() -> None:
    for depth, first in ((1.0, 1 / 64), (0.9, 1 / 1024), (0.1, 0.05)):
        layers = graded_layers(depth, first)
        assert layers.sum() == pytest.approx(depth, rel=1e-12)
        assert layers[0] == pytest.approx(first, rel=1e-6)
        ratios = layers[1:] / layers[:-1]
        assert ratios.max() <= GROWTH * (1 + 1e-9)
        # One layer fewer would break the rule: no finer than needed.
        fewer = graded_layers(depth, first, len(layers) - 1)
        assert len(layers) == 2 or (fewer[1:] / fewer[:-1]).max() > GROWTH


def test_grading_changes_no_wave_by_more_than_its_bound() -> None:
    n, depth = 64, half_space_depth(1.0, 0.3)
    rule = plasticity.law(1.0, 0.3, math.inf)

    def compliance(layers: np.ndarray) -> np.ndarray:
        block = PeriodicBlock((n, 1), (1 / n, 1 / n), layers)
        return factorise(block, flat_elements(block), rule).surface[:, 0]

    equal = compliance(np.full(round(depth * n), depth / round(depth * n)))
    # 0.7 %, as the rule's docstring says; 64 points a wave are off by 0.4 % on their own.
    assert np.abs(compliance(graded_layers(depth, 1 / n)) / equal - 1).max() < 7e-3


def test_a_deeper_or_finer_block_changes_the_longest_waves_little() -> None:
    scene = rough_scene(32, 4, dimensions=1)
    chosen = surface_compliance(scene)
    depth = half_space_depth(1.0, 0.3)
    deeper = surface_compliance(scene, depth=2 * depth)
    assert np.abs(deeper[1:] / chosen[1:] - 1).max() < 3e-3
    finer = surface_compliance(scene, layers=3 * block_for(scene).layers.size)
    assert np.abs(finer[1:5] / chosen[1:5] - 1).max() < 1.5e-2


def test_moved_nodes_put_the_top_at_the_heights_and_leave_the_base() -> None:
    scene = rough_scene(8, 2)
    block = block_for(scene, moved=True)
    where = block.positions()
    heights = scene.surface.heights
    np.testing.assert_allclose(where[0, ..., 2], heights - heights.mean(), atol=1e-15)
    np.testing.assert_allclose(where[-1, ..., 2], -block.depth, rtol=1e-14)
    volume = moved_elements(block).weights.sum()
    # The shift has zero mean over every level, so the body keeps its volume.
    assert volume == pytest.approx(block.depth, rel=1e-12)


@pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")
def test_what_cannot_be_meshed_is_refused() -> None:
    scene = rough_scene(8, 2, body=Body("bonded_layer", 0.5))
    with pytest.raises(InvalidScene, match=r"depth is 1 m.*0\.5 m"):
        block_for(scene, depth=1.0)
    with pytest.raises(InvalidScene, match="first_layer is -1"):
        block_for(scene, first_layer=-1.0)
    rough = rough_scene(16, 6, slope=20.0, body=Body("bonded_layer", 0.2))
    with pytest.raises(InvalidScene, match="inside out"):
        moved_elements(block_for(rough, moved=True))


def test_a_block_may_be_a_million_spacings_deep() -> None:
    """The bisection for the ratio of its layers once raised large ratios to high powers."""
    layers = graded_layers(1e7, 1.0)
    assert layers.sum() == pytest.approx(1e7)
    assert layers[0] == pytest.approx(1.0, rel=0.1)
