"""J2 against a cap on one discrete body: the measures that gates read, and their study."""

from __future__ import annotations

import ast
import inspect
import math
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from fem_scenes import rough_scene

import fem_check
from epcontact import bem
from epcontact.errors import InvalidCase
from epcontact.harness import crosscheck
from epcontact.harness.case_files.case import load_case
from epcontact.harness.gates.distances import distance
from epcontact.harness.quantities import model_difference
from epcontact.harness.quantities.model_difference import elements_compliance
from epcontact.harness.quantities.registry import QUANTITIES, measure_all
from epcontact.results import Areas, ContactResult, Provenance
from epcontact.scene import Body, Scene
from epcontact.studies.hardness import model_scene

MODEL = [name for name, quantity in QUANTITIES.items() if "J2 flow" in quantity.needs]


def measured(scene: Scene, result: ContactResult, names: Sequence[str] = MODEL) -> dict[str, float]:
    values = measure_all(names, scene, result)
    return {name.removeprefix("quantity."): value for name, value in values.items()}


@pytest.fixture(scope="module")
def scene() -> Scene:
    return rough_scene(32, 4)


@pytest.fixture(scope="module")
def j2(scene: Scene) -> ContactResult:
    return fem_check.solve(scene, law="j2", certified=False)


@pytest.mark.parametrize("body", [Body(), Body("bonded_layer", 0.7), Body("sliding_layer", 0.7)])
def test_the_compliance_is_that_of_the_block_that_answered(body: Body) -> None:
    scene = rough_scene(16, 3, body=body)
    result = fem_check.solve(scene, law="elastic", layers=7, certified=False)
    expected = fem_check.surface_compliance(scene, layers=7)
    np.testing.assert_allclose(elements_compliance(scene, result), expected, rtol=1e-12)


def test_a_cap_by_the_elements_does_not_differ_from_a_cap_by_the_boundary_elements() -> None:
    """The null test: with the law taken out, grid and depth leave nothing behind."""
    scene = rough_scene(32, 4, hardness=0.35)
    capped, exact = fem_check.solve(scene, law="capped", certified=False), bem.solve(scene)
    options = dict(capped.provenance.options) | {"law": "j2"}
    found = measured(scene, replace(capped, provenance=Provenance("", options=options)))
    assert found["model_area"] == 0
    assert found["model_overlap"] == 1
    assert found["model_distance"] < 1e-3  # the elements tabulate 1025 pressures
    # Its effective hardness is its hardness, to the node by which the area can tell.
    assert found["effective_hardness"] == pytest.approx(1.75, rel=0.02)
    assert found["effective_overlap"] > 0.98
    # The same holds on the half-space, as of volume integrals.
    options = {"law": "j2", "compliance": "half_space"}
    found = measured(scene, replace(exact, provenance=Provenance("", options=options)))
    assert found["effective_hardness"] == pytest.approx(1.75, rel=0.02)


def test_the_measures_say_what_they_mean(scene: Scene, j2: ContactResult) -> None:
    found = measured(scene, j2)
    own = bem.solve(scene, compliance=fem_check.surface_compliance(scene))
    touching, below = j2.fields["state"] > 0, own.fields["state"] > 0
    exact = (bem.solve(scene).fields["state"] > 0).sum()
    assert found["model_area"] == pytest.approx(touching.sum() / below.sum() - 1)
    assert found["model_overlap"] == (touching & below).sum() / (touching | below).sum()
    expected = distance("wasserstein", j2.distribution, own.distribution, 0.6)
    assert found["model_distance"] == pytest.approx(expected)
    assert found["elements_area"] == pytest.approx(below.sum() / exact - 1)
    # The area of the J2 body tells the model from 8 nodes a wave, as its grid is taken out.
    assert found["model_area"] > 2 * abs(found["elements_area"])
    assert 1.5 < found["effective_hardness"] < 2.3
    assert found["effective_overlap"] > found["model_overlap"]
    # One measure alone is what it is among all, and the place of the contact counts.
    turned = replace(j2, fields=dict(j2.fields) | {"state": j2.fields["state"].T})
    (area,) = measured(scene, turned, ["quantity.model_area"]).values()
    (overlap,) = measured(scene, turned, ["quantity.model_overlap"]).values()
    assert area == found["model_area"]
    assert overlap < found["model_overlap"] / 2


def test_what_has_no_effective_hardness_or_no_block_is_refused(scene, j2) -> None:
    stiff = rough_scene(16, 3, yield_stress=10.0, hardness=math.inf)
    elastic = fem_check.solve(stiff, law="j2", certified=False)
    capped = fem_check.solve(scene, law="capped", certified=False)
    full = dict(j2.final.areas) | {"raw": Areas(0.95, 0.0, 0.95)}
    too_full = replace(j2, steps=(replace(j2.final, areas=full),))
    nameless = replace(j2, provenance=Provenance("", options={"law": "j2"}))
    for name, place, result, sentence in (
        ("effective_hardness", stiff, elastic, "no cap gives its area"),
        ("model_area", scene, capped, "law of the elements is capped, but"),
        ("elements_pressure", scene, j2, "law of the elements is j2, but"),
        ("effective_hardness", scene, too_full, r"c_eff means nothing .* 0\.950 of the nodes"),
        ("model_area", scene, nameless, "does not say its block's layers"),
    ):
        with pytest.raises(InvalidCase, match=sentence):
            measured(place, result, [f"quantity.{name}"])


def test_nothing_but_the_compliance_passes_from_one_solver_to_the_other() -> None:
    allowed = {"bem": {"compliance", "threads"}, "fem_check": {"law", "certified"}}
    allowed["fem_check"] |= {"block", "path", "options"}  # depth, layers, increments
    calls = [
        (node.func.value.id, node)
        for module in (crosscheck, model_difference)
        for node in ast.walk(ast.parse(inspect.getsource(module)))
        if isinstance(node, ast.Call) and re.match(r"(bem|fem_check)\.solve\(", ast.unparse(node))
    ]
    assert len(calls) == 7
    for owner, call in calls:
        assert len(call.args) == 1
        given = {k.arg or getattr(k.value, "id", "?") for k in call.keywords}
        assert given <= allowed[owner], ast.unparse(call)


@pytest.mark.parametrize(
    ("name", "severity", "nu"),
    [("fem-model-5", 5, 0.3), ("fem-model-50-nu0", 50, 0.0), ("fem-model-15-nu045", 15, 0.45)],
)
def test_the_study_answers_the_scenes_of_the_cases(name: str, severity: float, nu: float) -> None:
    case = load_case(name)
    recipe = case.recipes[0]
    ours, theirs = model_scene(severity, nu, recipe.seed, recipe.shape[0]), case.scene(recipe)
    np.testing.assert_array_equal(ours.surface.heights, theirs.surface.heights)
    assert ours.body == theirs.body
    # The case's stresses have five figures.
    assert vars(ours.material) == pytest.approx(vars(theirs.material), rel=1e-4)
    assert ours.load.final == pytest.approx(theirs.load.final, rel=1e-4)
