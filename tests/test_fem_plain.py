"""The half-block in plain scikit-fem, and the fast elements state by state."""

from dataclasses import replace

import numpy as np
import pytest
from fem_scenes import rough_scene

import fem_check
from epcontact.errors import InvalidScene, NotConverged
from epcontact.results import APART
from epcontact.scene import Body, Load, Surface
from fem_check import FemOptions, plain, plain_result
from fem_check.certificate import certify
from fem_check.plasticity import initial_history

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
    result = plain_result.solve_plain(
        scene, layers=4, tolerance=1e-10, steps=3, **changes
    )
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
    result = plain_result.solve_plain(
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
        plain_result.solve_plain(SCENES["elastic"][0], **changes)


def test_large_blocks_are_refused_before_they_are_built():
    """A block of more than 20,000 elements is refused, and the sentence has both."""
    with pytest.raises(InvalidScene, match=r"409600 elements.*at most 20000"):
        plain_result.solve_plain(rough_scene(64, 3), layers=100)


def test_deep_valleys_are_refused_where_nodes_are_moved():
    """A valley below the base turns an element inside out."""
    scene = rough_scene(8, 2, slope=0.5)
    with pytest.raises(InvalidScene, match="inside out"):
        plain_result.solve_plain(scene, geometry="moved", depth=0.02, layers=2)


def test_a_solve_that_does_not_converge_raises(monkeypatch):
    """With a single Newton step an increment ends with the residuals that it has."""
    monkeypatch.setattr(plain, "MOST_NEWTON_STEPS", 1)
    with pytest.raises(NotConverged) as raised:
        plain_result.solve_plain(SCENES["elastic"][0], law="elastic", layers=3)
    assert raised.value.residuals["load"] == pytest.approx(1.0)


def wrong_shears(tensor):
    """Return a symmetric tensor whose shear components are 5 % too small."""
    weights = 0.95 + 0.05 * np.eye(3)[:, :, None, None]
    return weights * tensor


def scaled_field(name):
    """Return a fault that makes a field of the law 5 % too large."""
    return lambda law: law._replace(**{name: 1.05 * getattr(law, name)})


def stronger(law):
    """Return a law whose yield stress is 5 % too high."""
    (begin, stress, slope), *rest = law.segments
    return law._replace(segments=((begin, 1.05 * stress, slope), *rest))


def harder(law):
    """Return a law whose hardening modulus is 5 % too large."""
    (begin, stress, slope), *rest = law.segments
    return law._replace(segments=((begin, stress, 1.05 * slope), *rest))


WRONG_LAWS = {
    "shear modulus": scaled_field("shear_modulus"),
    "bulk modulus": scaled_field("bulk_modulus"),
    "yield stress": stronger,
    "hardening modulus": harder,
}


@pytest.fixture(scope="module")
def hardening_path():
    """A path of a block with linear hardening, loaded and partly unloaded."""
    scene = rough_scene(8, 2, pressure=(0.08, 0.05))
    material = replace(scene.material, hardening_modulus=4.0)
    scene = replace(scene, material=material)
    return scene, FemOptions(layers=3, steps=3)


@pytest.mark.parametrize("name", WRONG_LAWS)
def test_the_certificate_sees_a_law_that_differs_by_a_twentieth(
    name, hardening_path, monkeypatch
):
    """Fast elements with another law than the material's are not confirmed."""
    right = plain.law_of
    make_wrong = WRONG_LAWS[name]

    def law_of(material, flows):
        """Return the wrong law of a material."""
        return make_wrong(right(material, flows))

    monkeypatch.setattr(plain, "law_of", law_of)
    with pytest.raises(NotConverged, match="does not confirm"):
        fem_check.solve_path(*hardening_path)


@pytest.mark.parametrize(
    ("owner", "function", "wrong"),
    [
        # von Mises' stress with weak shears: the norm of the trial stress
        (plain, "ddot", lambda right, a, b: right(wrong_shears(a), b)),
        # strains with engineering shears, or with weak ones
        (plain, "sym_grad", lambda right, u: wrong_shears(right(u))),
        (plain.Elements, "deviatoric_strain", lambda right, e, u: -right(e, u)),
        # a local dilatation in part: 5 % of the element's mean is missing
        (plain.Elements, "mean_dilatation", lambda right, e, u: 0.95 * right(e, u)),
        (plain.Elements, "force", lambda right, e, s, p: right(e, wrong_shears(s), p)),
        (plain.Elements, "force", lambda right, e, s, p: right(e, s, -p)),
    ],
)
def test_the_certificate_sees_a_wrong_term(
    owner, function, wrong, hardening_path, monkeypatch
):
    """A term of strain, law or force that is wrong on one side is not confirmed."""
    right = getattr(owner, function)
    monkeypatch.setattr(owner, function, lambda *args: wrong(right, *args))
    with pytest.raises(NotConverged, match="does not confirm"):
        fem_check.solve_path(*hardening_path)


def test_the_certificate_sees_a_wrong_history(hardening_path):
    """Plastic strains that are 5 % too large, or absent, differ from the check's."""
    scene, options = hardening_path
    path = fem_check.solve_path(replace(scene, load=Load(0.08)), options)
    law = plain.law_of(scene.material, flows=True)
    [point] = path.points
    nothing = initial_history(path.problem.bricks.number)
    last_strains = path.history.plastic_strain
    large = path.history._replace(plastic_strain=1.05 * last_strains)
    for before, after in ((path.history, large), (path.history, nothing)):
        found = certify(path.problem, law, point.state, before, after, point.peak)
        assert found["certified_balance"] < 1e-7
        assert found["certified_flow"] > 0.01


def test_loads_below_the_largest_one_take_few_newton_steps():
    """Unloading to a fifth and loading again take at most 6 Newton steps each.

    From the contact of the load before they take 17 and 21, and on larger blocks
    Newton's method does not converge.
    """
    scene = rough_scene(12, 3, pressure=(0.15, 0.03, 0.15))
    options = FemOptions(layers=4, steps=4, tolerance=1e-10)
    block = plain_result.plain_block(scene, options)
    states = plain.solve_path(block, scene.load.path, options.steps, 1e-10)
    _, unloaded, again = states
    assert unloaded.newton_steps <= 6
    assert again.newton_steps <= 6
