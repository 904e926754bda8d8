"""The half-block in plain scikit-fem, and the fast elements state by state."""

from dataclasses import replace

import numpy as np
import pytest
from fem_scenes import rough_scene

import fem_check
from epcontact.errors import InvalidScene, NotConverged
from epcontact.results import APART
from epcontact.scene import Body, Surface
from fem_check import FemOptions, plain, plain_result

#: Scenes in which each part of the problem decides: flow of a few elements and of most
#: of them, unloading to nothing and loading again, a base that slides, moved nodes,
#: oblong elements, a line, and hardening.
SCENES = {
    "elastic": (rough_scene(12, 3), {"law": "elastic"}),
    "path": (rough_scene(12, 3, pressure=(0.05, 0.02, 0.08, 0.0, 0.04)), {}),
    "severe": (rough_scene(10, 2, pressure=0.03, yield_stress=0.03), {"steps": 4}),
    "sliding": (rough_scene(10, 3, body=Body("sliding_layer", 0.5)), {}),
    "moved": (rough_scene(12, 3, pressure=(0.05, 0.02)), {"geometry": "moved"}),
    "line": (rough_scene(24, 5, pressure=(0.05, 0.01), dimensions=1), {}),
}


def oblong(scene, **material):
    """Return a scene with the periods 1 and 0.7, and other values of its material."""
    surface = Surface(scene.surface.heights[:, :8], (1.0, 0.7))
    return replace(scene, surface=surface, material=replace(scene.material, **material))


SCENES["hardening"] = (oblong(rough_scene(10, 3), hardening_modulus=4.0), {})
SCENES["curve"] = (
    oblong(
        rough_scene(10, 3, pressure=(0.05, 0.02)),
        hardening_curve=((0.0, 0.2), (0.004, 0.22), (0.01, 0.35)),
    ),
    {},
)


@pytest.mark.parametrize("name", SCENES)
def test_fast_elements_have_the_states_of_the_plain_ones(name):
    """At each load the forces, the plastic strains and the approach are equal to 1e-8.

    Both solvers iterate to residuals of 1e-10.
    """
    scene, changes = SCENES[name]
    options = FemOptions(tolerance=1e-10, layers=4, **{"steps": 4, **changes})
    block = plain_result.plain_block(scene, options)
    states = plain.solve_path(block, scene.load.path, options.steps, 1e-10)
    path = fem_check.solve_path(scene, options)
    for point, state in zip(path.points, states, strict=True):
        forces = point.state.forces.ravel()
        largest = scene.load.path[0] * block.area
        assert np.abs(state.forces - forces).max() < 1e-8 * largest
        assert np.array_equal(state.contact, point.state.states.ravel() != APART)
        assert state.flat == pytest.approx(-point.state.approach, rel=1e-8)
    strains = np.sort(path.history.accumulated[path.history.rows], axis=None)
    plain_strains = np.sort(state.history.accumulated, axis=None)
    if block.law.flows:
        assert plain_strains[-1] > 1e-3
        assert np.abs(plain_strains - strains).max() < 1e-8 * strains[-1]


@pytest.mark.parametrize("name", ["path", "sliding", "line"])
def test_the_results_of_both_have_the_same_quantities(name):
    """Areas, fields and each quantity of each load agree to 1e-7 of the largest."""
    scene, changes = SCENES[name]
    fast = fem_check.solve(scene, layers=4, tolerance=1e-10, steps=3, **changes)
    result = plain_result.solve(scene, layers=4, tolerance=1e-10, steps=3, **changes)
    for step, expected in zip(result.steps, fast.steps, strict=True):
        assert step.areas == expected.areas
        assert step.quantities.keys() == expected.quantities.keys()
        for quantity, value in expected.quantities.items():
            assert step.quantities[quantity] == pytest.approx(value, rel=1e-7), quantity
    for field, values in fast.fields.items():
        scale = np.abs(values).max() or 1.0
        assert np.abs(result.fields[field] - values).max() < 1e-7 * scale, field


def test_a_call_after_each_load_has_the_result_so_far():
    """`on_step` is called once for each load; the last call has the complete result."""
    scene, _ = SCENES["moved"]
    calls = []
    result = plain_result.solve(
        scene, layers=3, geometry="moved", law="elastic", on_step=calls.append
    )
    assert [len(call.steps) for call in calls] == [1, 2]
    assert calls[-1] == result


@pytest.mark.parametrize(
    "changes", [{"law": "capped"}, {"geometry": "punch"}, {"approach": 0.01}]
)
def test_what_it_does_not_have_is_refused(changes):
    """A cap, a punch and a prescribed approach are refused with a sentence."""
    with pytest.raises(InvalidScene, match="take the method fem"):
        plain_result.solve(SCENES["elastic"][0], **changes)


def test_large_blocks_are_refused_before_they_are_built():
    """A block of more than 20,000 elements is refused, and the sentence has both."""
    with pytest.raises(InvalidScene, match=r"409600 elements.*at most 20000"):
        plain_result.solve(rough_scene(64, 3), layers=100)


def test_deep_valleys_are_refused_where_nodes_are_moved():
    """A valley below the base turns an element inside out."""
    scene = rough_scene(8, 2, slope=0.5)
    with pytest.raises(InvalidScene, match="inside out"):
        plain_result.solve(scene, geometry="moved", depth=0.02, layers=2)


def test_a_solve_that_does_not_converge_raises(monkeypatch):
    """With a single Newton step an increment ends with the residuals that it has."""
    monkeypatch.setattr(plain, "MOST_NEWTON_STEPS", 1)
    with pytest.raises(NotConverged) as raised:
        plain_result.solve(SCENES["elastic"][0], law="elastic", layers=3)
    assert raised.value.residuals["load"] == pytest.approx(1.0)
