"""J2 against a cap on one discrete body: differences, their parts, and the effective
hardness.
"""

import dataclasses
import inspect
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from fem_scenes import J2_CASE, rough_scene

import fem_check
from epcontact import bem
from epcontact.cli.crosscheck_and_export import _seeds
from epcontact.crosscheck.model_difference import (
    EffectiveHardness,
    combined,
    elements_compliance,
)
from epcontact.crosscheck.report import crosscheck, error_budget, measured_hardness
from epcontact.errors import InvalidCase, InvalidScene
from epcontact.harness.case_files.case import load_case
from epcontact.harness.gates import Difference, difference, distance
from epcontact.harness.quantities.registry import QUANTITIES, measure_all
from epcontact.results import (
    Areas,
    ContactResult,
    LoadStep,
    PressureDistribution,
    Provenance,
)
from epcontact.scene import Body, Load, Material, Scene, Surface
from epcontact.studies.hardness import model_scene
from epcontact.surfaces import Sinusoid


@pytest.mark.parametrize("dimensions", [1, 2])
def test_the_budget_tells_the_parts_apart(dimensions):
    """The error budget splits a difference into model, solver, grid and depth.

    Each part is the difference of two solves that share all but that property.
    """
    nodes, highest = (48, 6) if dimensions == 2 else (128, 8)
    scene = rough_scene(nodes, highest, dimensions=dimensions)
    j2 = fem_check.solve(scene, certified=False)
    model, solver, discretisation, depth = error_budget(scene, "j2", j2).values()
    # The same discrete body: only rounding and the solvers' tolerances.  The depth
    # hides the base to 0.1 % of the longest wave, and 8 (or 16) points a wave are good
    # to per cents.
    assert solver.nodes == 0
    assert solver.pressure < 1e-5
    assert depth.pressure < 1e-3
    assert 1e-2 < discretisation.pressure < 0.1
    assert model.pressure > 2 * discretisation.pressure
    assert model.area > 0.03
    # Each part begins at the body at which the one before it ends.
    assert model.areas == (j2.final.areas["raw"].total, solver.areas[1])
    assert solver.areas[1] == discretisation.areas[0]
    assert discretisation.areas[1] == depth.areas[0]
    assert depth.areas[1] == bem.solve(scene).final.areas["raw"].total


def test_each_part_falls_with_what_it_is_the_error_of():
    """The part of the grid is halved by twice the grid, and that of the depth falls
    with it.
    """
    coarse, fine = (error_budget(rough_scene(n, 4)) for n in (32, 64))
    # First order: halved by twice the grid, here and there by a little less.
    assert fine["discretisation"].pressure < coarse["discretisation"].pressure / 1.7
    assert fine["depth"].pressure == pytest.approx(coarse["depth"].pressure, rel=0.5)
    # The base's influence falls as exp(-2 q d), and a thin layer is stiffer than the
    # half-space.
    budgets = (
        error_budget(rough_scene(32, 4), "elastic", depth=d) for d in (0.15, 0.4, 0.8)
    )
    thin, shallow, deep = (budget["depth"] for budget in budgets)
    assert deep.pressure < shallow.pressure / 20
    assert thin.area < 0


def answer(pressure, low):
    """Return a result with these pressures and a made-up pressure distribution.

    The distribution is even over (`low`, `low` + 1); the step's area is 0.5.
    """
    sigma = np.linspace(0, 2, 20001)
    p = np.array(pressure)
    step = LoadStep(1.0, {"raw": Areas(0.5, 0.5, 0.0)})
    table = PressureDistribution(sigma, np.clip(sigma - low, 0, 1))
    fields = {"pressure": p, "state": (p > 0).astype(int)}
    return ContactResult("bem", (step,), Provenance("known"), table, fields)


def test_differences_of_known_answers():
    """`difference` gives relative pressures, overlap, distance and areas of known
    fields.

    Grids of different size raise `InvalidScene`.
    """
    one = answer([1.0, 1, 1, 1, 0, 0], 0.2)
    other = answer([0.0, 0, 2, 2, 2, 0], 0.5)
    assert difference(one, one, 4.0) == Difference(
        0.0, 0.0, 1.0, 0.0, 0, (4 / 6, 4 / 6)
    )
    found = dataclasses.astuple(difference(one, other, 4.0))
    assert found[:5] == pytest.approx(
        (1 / 3, math.sqrt(8 / 12), 2 / 5, 0.3 / 4, 3), rel=2e-4
    )
    with pytest.raises(InvalidScene, match="cannot be compared"):
        difference(answer([1.0], 0.2), one, 4.0)


MODEL = [name for name, quantity in QUANTITIES.items() if "J2 flow" in quantity.needs]


def measured(scene, result, *names):
    """Return quantities of a result by their short names, by default those of MODEL."""
    values = measure_all(names or MODEL, scene, result)
    return {name.removeprefix("quantity."): value for name, value in values.items()}


@pytest.fixture(scope="module")
def flowed():
    """Return a rough scene and its result by J2 finite elements."""
    scene = rough_scene(32, 4)
    return scene, fem_check.solve(scene, law="j2", certified=False)


@pytest.mark.parametrize(
    "body", [Body(), Body("bonded_layer", 0.7), Body("sliding_layer", 0.7)]
)
def test_the_compliance_is_that_of_the_block_that_answered(body):
    """`elements_compliance` rebuilds the compliance of a result's block to 1e-12."""
    scene = rough_scene(16, 3, body=body)
    result = fem_check.solve(scene, law="elastic", layers=7, certified=False)
    expected = fem_check.surface_compliance(scene, layers=7)
    np.testing.assert_allclose(elements_compliance(scene, result), expected, rtol=1e-12)


def test_a_cap_by_the_elements_does_not_differ_from_a_cap_by_the_boundary_elements():
    """Capped elements compared as if they were J2 show no difference of the model.

    This is the null test: with the law taken out, grid and depth leave nothing behind.
    The effective hardness is 0.35/0.2 = 1.75, hardness over yield stress.
    """
    scene = rough_scene(32, 4, hardness=0.35)
    capped = fem_check.solve(scene, law="capped", certified=False)
    exact = bem.solve(scene)
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


def test_the_measures_say_what_they_mean(flowed):
    """The measures of a model difference follow from the states of both solutions.

    A transposed state keeps the area, and loses half of the overlap.
    """
    scene, j2 = flowed
    found = measured(scene, j2)
    own = bem.solve(scene, compliance=fem_check.surface_compliance(scene))
    touching = j2.fields["state"] > 0
    below = own.fields["state"] > 0
    exact = (bem.solve(scene).fields["state"] > 0).sum()
    assert found["model_area"] == pytest.approx(touching.sum() / below.sum() - 1)
    assert found["model_overlap"] == (touching & below).sum() / (touching | below).sum()
    expected = distance("wasserstein", j2.distribution, own.distribution, 0.6)
    assert found["model_distance"] == pytest.approx(expected)
    assert found["elements_area"] == pytest.approx(below.sum() / exact - 1)
    assert found["model_area"] > 2 * abs(found["elements_area"])  # 8 nodes a wave do
    assert found["effective_overlap"] > found["model_overlap"]
    turned = replace(j2, fields=dict(j2.fields) | {"state": j2.fields["state"].T})
    assert (
        measured(scene, turned, "quantity.model_area")["model_area"]
        == found["model_area"]
    )
    assert measured(scene, turned)["model_overlap"] < found["model_overlap"] / 2


@pytest.mark.parametrize("law", ["elastic", "j2"])
def test_what_a_moved_top_changes_falls_with_the_slope(law):
    """quantity.moved_* compare a rough top with a flat one: at a tenth of the slope
    about a tenth of the difference of the pressures is left.

    The gap gives the same result for both slopes, up to units.
    """
    changes = []
    for slope in (0.1, 0.01):
        scene = rough_scene(16, 2, slope=slope)
        result = fem_check.solve(scene, law=law, geometry="moved", certified=False)
        names = [f"quantity.moved_{part}" for part in ("area", "pressure", "peak")]
        changes.append(measured(scene, result, *names))
    large, small = changes
    assert small["moved_area"] == 0  # no node changes its state
    assert 0 < small["moved_peak"] / large["moved_peak"] < 0.25
    assert large["moved_pressure"] > 0.002
    assert small["moved_pressure"] == pytest.approx(
        large["moved_pressure"] / 10, rel=0.5
    )


def test_the_limit_pressure_is_that_of_a_flat_contact():
    """quantity.limit_pressure of a strip of 10 nodes is Prandtl's on a width that is
    smaller by .33 spacings, whatever the load; a rough surface has none.
    """
    surface = Surface(np.where(np.arange(48) < 10, 0.0, -1.0), (48.0,))
    material = Material(1e4, 0.3, yield_stress=1.0)
    expected = (2 + math.pi) / math.sqrt(3) * (1 - 0.33 / 10)
    for load in (0.02, 0.4):
        scene = Scene(surface, material, Load(load))
        result = fem_check.solve(scene, certified=False)
        found = measured(scene, result, "quantity.limit_pressure")["limit_pressure"]
        assert found == pytest.approx(expected, rel=0.01)
    scene = rough_scene(16, 2, dimensions=1)
    result = fem_check.solve(scene, certified=False)
    with pytest.raises(InvalidCase, match="carries four yield stresses"):
        measured(scene, result, "quantity.limit_pressure")


def test_what_has_no_effective_hardness_or_no_block_is_refused(flowed):
    """Results without flow, of another law, too full or without a block raise
    `InvalidCase`.
    """
    scene, j2 = flowed
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
        (
            "effective_hardness",
            scene,
            too_full,
            r"c_eff means nothing .* 0\.950 of the nodes",
        ),
        ("model_area", scene, nameless, "does not say its block's layers"),
        ("moved_area", scene, j2, "geometry is gap, but a rough top needs"),
    ):
        with pytest.raises(InvalidCase, match=sentence):
            measured(place, result, f"quantity.{name}")


@pytest.mark.parametrize(
    ("measured", "text"),
    [
        (EffectiveHardness(math.inf, 0.1, 0.2), "there is no c_eff: .* 0.200 of the"),
        (
            EffectiveHardness(2.0, 5.0, 0.2, None, {"grid": -math.inf, "node": 0.1}),
            r"c_eff = 2.000 at .* \(by grid unknown: no c_eff in .*, node \+0.100\)",
        ),
    ],
)
def test_no_ratio_is_printed_as_infinite(measured, text):
    """A body, or a second solve, without c_eff is described in words.

    `measured` is the effective hardness, and `text` a pattern of its description.
    """
    assert re.search(text, str(measured))
    assert "inf" not in str(measured)


def test_nothing_but_the_compliance_passes_from_one_solver_to_the_other():
    """The source of the cross-check passes only the compliance between the solvers."""
    source = "".join(
        inspect.getsource(inspect.getmodule(f)) for f in (crosscheck, combined)
    )
    calls = re.findall(r"(?:bem|fem_check)\.solve\((.*)", source)
    assert len(calls) == 7
    passed = {
        name for call in calls for name in re.findall(r"\w+(?==)|(?<=\*\*)\w+", call)
    }
    changed = {"material", "body"}
    numbers = {"threads", "law", "certified"}
    assert passed - changed - numbers == {"compliance", "block", "steps", "options"}


def test_each_part_of_the_error_is_that_of_a_solve_that_differs_in_it():
    """The parts of the error of c_eff are differences of solves with other depth and
    steps.

    Many steps change c_eff by less than three error estimates.
    """
    scene = rough_scene(16, 2, hardness=math.inf)
    found = measured_hardness(scene, steps=2)
    depth = fem_check.solve(scene, steps=2, certified=False).provenance.options["depth"]
    shallow = measured_hardness(scene, steps=2, depth=0.75 * depth)
    fewer = measured_hardness(scene, steps=1)
    assert set(found.parts) == {"node", "grid", "depth", "steps"}
    assert found.parts["depth"] == pytest.approx(found.ratio - shallow.ratio, abs=1e-9)
    assert (
        found.parts["steps"] == pytest.approx(found.ratio - fewer.ratio, abs=1e-9) != 0
    )
    tight = measured_hardness(scene, steps=20)
    assert tight.ratio == pytest.approx(found.ratio, abs=3 * found.error)
    # The severity E* ξ / σ_Y is that with which a scene of the study is built.
    severe = measured_hardness(model_scene(5.0, 0.45, 201, 16, waves=2), steps=1)
    assert severe.severity == pytest.approx(5.0, rel=1e-9)


@pytest.mark.parametrize(
    ("name", "severity", "nu"),
    [
        ("fem-model-5", 5, 0.3),
        ("fem-model-50-nu0", 50, 0.0),
        ("fem-model-15-nu045", 15, 0.45),
    ],
)
def test_the_study_answers_the_scenes_of_the_cases(name, severity, nu):
    """The study builds the scenes of the cases `fem-model`.

    `severity` is E* xi / sigma_Y and `nu` Poisson's ratio of the case of this name.
    """
    case = load_case(name)
    recipe = case.recipes[0]
    ours = model_scene(severity, nu, recipe.seed, recipe.shape[0])
    theirs = case.scene(recipe)
    np.testing.assert_array_equal(ours.surface.heights, theirs.surface.heights)
    assert ours.body == theirs.body
    # The case's stresses have five figures.
    assert ours.material.hardening_curve == theirs.material.hardening_curve == ()
    moduli = ("young_modulus", "poisson_ratio", "yield_stress", "hardness")
    for modulus in moduli:
        value = getattr(ours.material, modulus)
        assert value == pytest.approx(getattr(theirs.material, modulus), rel=1e-4)
    assert ours.load.final == pytest.approx(theirs.load.final, rel=1e-4)


SMALLER = (("[48, 48]", "[24, 24]"), ("[5, 6, 7, 8, 9, 10, 11, 12]", "[5]"))
ELASTIC = ('law = "j2"', 'law = "elastic"')


@pytest.fixture
def tiny(tmp_path):
    """Return a function that loads fem-model-5 on one surface of 24 x 24 nodes."""

    def load(*replacements):
        """Return the case of J2_CASE with texts replaced: pairs of old and new text."""
        text = J2_CASE
        path = tmp_path / "fem-model-5.toml"
        for old, new in (*SMALLER, *replacements):
            text = text.replace(old, new)
        path.write_text(text, encoding="utf-8")
        return load_case(path)

    return load


def test_an_ensemble_is_summed_up_with_its_standard_errors(tiny):
    """The report of two seeds has mean, standard error and spread of their values.

    The error of the mean c_eff combines the parts of grid, steps and seeds.
    """
    *alone, head = (
        lines := crosscheck(tiny(), seeds=_seeds("21-22"), steps=4).splitlines()
    )[:-10]
    assert head.startswith("fem-model-5, fast, 2 surfaces: mean +- standard error")
    summed = dict(line.strip().split(": ") for line in lines[-10:-1])
    low, high = sorted(
        float(r) for r in re.findall(r"c_eff = (\S+) ", "\n".join(alone))
    )
    numbers = re.findall(r"[+-]?\d\.\d+", summed["effective hardness c_eff"])
    expected = ((low + high) / 2, (high - low) / 2, (high - low) / math.sqrt(2))
    assert [float(number) for number in numbers] == pytest.approx(expected, abs=1e-3)
    assert float(summed["model, area"].split()[0]) > 0
    assert {"its change by the grid", "its change by the steps"} < set(summed)
    parts = {
        k: float(v)
        for k, v in re.findall(r"(seeds|grid|steps) ([+-]\S+?)[,)]", lines[-1])
    }
    found = re.findall(r"mean c_eff = (\S+) \+- (\S+) ", lines[-1])[0]
    assert [float(x) for x in found] == pytest.approx(
        [expected[0], combined(parts)], abs=4e-3
    )
    assert parts["seeds"] == pytest.approx(expected[1], abs=1e-3)


@pytest.mark.parametrize(
    ("edits", "options", "sentence"),
    [
        ([('"fem", "bem"]', '"fem"]')], {}, "lacks bem"),
        (
            [("mean_pressure = 5.7692e+08", "mean_pressure = [1e8, 5e8]")],
            {},
            "is a path of 2",
        ),
        (
            [('law = "j2"', 'law = "j2"\ngeometry = "moved"')],
            {},
            "fem.geometry is 'moved'",
        ),
        ([ELASTIC], {"steps": 4}, r"steps is for fem.law = 'j2' only"),
        ([], {"seeds": [3, 3]}, "different numbers"),
    ],
)
def test_what_cannot_be_cross_checked_is_refused(tiny, edits, options, sentence):
    """Cases that cannot be cross-checked raise `InvalidCase`.

    `edits` are replacements in the case, `options` those of `crosscheck`, and
    `sentence` is a pattern of the message.
    """
    with pytest.raises(InvalidCase, match=sentence):
        crosscheck(tiny(*edits), **options)
    wavy = tiny().changed(recipes=(Sinusoid((1e-3,) * 2, (16, 16), 1e-6),))
    with pytest.raises(InvalidCase, match="surface is not random"):
        crosscheck(wavy, seeds=[1, 2])


#: c_eff on 48 x 48 nodes: `measured_hardness(scene_of(k, 48))` for k from 0.
FINE = """
1.913 2.019 2.811 2.474 1.609 2.634 2.745 2.488 2.114 2.387 2.664 2.632
1.985 2.290 2.820 2.689 1.524 2.512 2.651 2.623 2.026 2.540 2.686 2.435
1.981 2.355 2.801 2.609 1.553 2.359 2.778 2.192 2.057 2.303 2.597 2.687
2.094 2.257 2.780 2.690 1.596 2.457 2.548 2.400 2.206 2.356 2.743 2.732
1.792 2.114 2.555 2.379 1.745 2.557 2.709 2.354 2.262 2.473 2.384 2.670
"""


def scene_of(k, nodes):
    """Return the k-th scene of an ensemble over E* xi/sigma_Y, nu and body, on nodes x
    nodes points.
    """
    severity = (5.0, 15.0, 50.0, 30.0)[k % 4]
    nu = (0.3, 0.0, 0.45)[k % 3]
    scene = model_scene(severity, nu, 201 + k, nodes, waves=2)
    return replace(scene, body=Body()) if k % 2 == 0 else scene


@pytest.mark.long  # some two minutes
def test_the_error_bars_hold_the_ratios_of_a_fine_grid():
    """Of 60 errors of c_eff on coarse grids 57 hold its value on a fine grid.

    An error is infinite if no cap gives the area of the J2 body on every second point,
    which is needed to measure it.  Every second scene has a body of finite depth, and
    so a part of the error that is due to it.
    """
    fine = [float(c) for c in FINE.split()]
    # On grids as coarse as these the bars are wide: .24 of the ratio on the median.
    found = [
        measured_hardness(scene_of(k, 16 if k < 10 else 24)) for k in range(len(fine))
    ]
    assert (
        sum(abs(own.ratio - c) <= own.error for own, c in zip(found, fine, strict=True))
        >= 57
    )
    assert sum(math.isfinite(each.error) for each in found) >= 57
    assert np.median([each.error / each.ratio for each in found]) < 0.3
    assert all(
        ("depth" in each.parts) == (k % 2 == 0) for k, each in enumerate(found) if k
    )
