"""Scenes answered: three laws, two geometries, paths, errors, warnings."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from fem_scenes import rough_scene

import fem_check
from epcontact.errors import InvalidScene, NotConverged, NotEnoughMemory
from epcontact.results import APART, ELASTIC, PLASTIC, ContactResult
from epcontact.scene import Body, Load, Material, Scene, Surface
from epcontact.studies.stability import rough_surface
from fem_check import driver, increments
from fem_check.newton import NewtonOptions, solve_increment
from fem_check.problem import Control


@pytest.mark.parametrize("dimensions", [1, 2])
@pytest.mark.parametrize("geometry", ["gap", "moved"])
@pytest.mark.parametrize("law", ["elastic", "capped", "j2"])
@pytest.mark.parametrize("body", [Body(), Body("bonded_layer", 0.3), Body("sliding_layer", 0.3)])
def test_every_law_geometry_and_body_converges_and_is_certified(
    dimensions: int, geometry: str, law: str, body: Body
) -> None:
    hardness = 0.4 if dimensions == 2 else 0.15  # below the elastic peak of these scenes
    scene = rough_scene(16, 2, dimensions=dimensions, body=body, hardness=hardness)
    result = fem_check.solve(scene, law=law, geometry=geometry)  # type: ignore[arg-type]
    assert max(result.final.residuals.values()) < 1e-7
    # scikit-fem's own assembly of the stresses balances the contact forces.
    assert result.final.residuals["certified_balance"] < 1e-8
    fields = result.fields
    assert all(fields[name].shape == scene.surface.shape for name in fields)
    assert fields["pressure"].mean() == pytest.approx(0.05, rel=1e-7)
    touching = fields["state"] != APART
    assert (fields["pressure"][~touching] == 0).all()
    assert (fields["gap"][~touching] > 0).all()
    plastic = fields["state"] == PLASTIC
    if law == "capped":
        np.testing.assert_allclose(fields["pressure"][plastic], hardness, rtol=1e-12)
        assert (fields["gap"][plastic] <= 1e-9).all()
    else:
        assert (fields["gap"][touching] == 0).all()
    assert plastic.any() == (law != "elastic")
    areas = result.final.areas["raw"]
    assert areas.total == touching.mean()
    assert areas.total == pytest.approx(areas.elastic + areas.plastic)


def test_the_result_survives_json() -> None:
    result = fem_check.solve(rough_scene(16, 2))
    again = ContactResult.from_json(json.loads(json.dumps(result.to_json())))
    assert again.final.areas["raw"] == result.final.areas["raw"]
    assert result.cost["newton_steps"] > 0
    assert result.cost["unknowns"] == 3 * 256 * result.provenance.options["layers"]
    assert result.history[-1] <= 1e-8
    assert result.distribution is not None
    assert result.distribution.cumulative[-1] == pytest.approx(result.final.areas["raw"].total)


def test_the_answer_does_not_depend_on_place_or_orientation() -> None:
    scene = rough_scene(16, 3)
    heights = scene.surface.heights
    base = fem_check.solve(scene).fields["pressure"]
    for move in (
        lambda a: np.roll(a, (3, 5), (0, 1)),
        lambda a: a[::-1],
        lambda a: a.T,
        np.rot90,
    ):
        moved = dataclasses.replace(scene, surface=Surface(move(heights), (1.0, 1.0)))
        found = fem_check.solve(moved).fields["pressure"]
        np.testing.assert_allclose(found, move(base), atol=1e-6 * base.max())


def test_only_the_groups_of_the_similarity_matter_in_the_gap_geometry() -> None:
    """Slope 0.05 and 0.005 with the same p0/(E* xi) and sigma_Y/(E* xi)."""
    one, other = rough_scene(16, 3), rough_scene(16, 3, slope=0.005)
    a, b = (fem_check.solve(s).fields["pressure"] for s in (one, other))
    np.testing.assert_allclose(a, b, atol=1e-6 * a.max())


def test_a_line_is_a_ridge_in_plane_strain() -> None:
    line = rough_scene(32, 4, dimensions=1)
    ridge = dataclasses.replace(
        line, surface=Surface(np.repeat(line.surface.heights[:, None], 2, 1), (1.0, 2 / 32))
    )
    one = fem_check.solve(line, depth=0.9)
    two = fem_check.solve(ridge, depth=0.9)
    np.testing.assert_allclose(
        two.fields["pressure"], np.repeat(one.fields["pressure"][:, None], 2, 1), atol=1e-7
    )


def test_an_unreachable_yield_stress_is_elastic() -> None:
    scene = rough_scene(16, 3, yield_stress=1e6)
    j2, elastic = (fem_check.solve(scene, law=law, steps=1) for law in ("j2", "elastic"))
    np.testing.assert_allclose(j2.fields["pressure"], elastic.fields["pressure"], atol=1e-8)
    assert j2.final.areas["raw"].plastic == 0


def test_uniform_compression_yields_where_uniaxial_strain_does() -> None:
    """sigma_Y (1 - nu)/(1 - 2 nu) in uniaxial strain (Lame)."""
    onset = 0.2 * 0.7 / 0.4
    for factor, yields in ((0.999, False), (1.001, True)):
        scene = Scene(
            Surface(np.zeros(4), (1.0,)),
            Material(20.0, 0.3, yield_stress=0.2),
            Load(factor * onset),
            Body("bonded_layer", 1.0),
        )
        volume = fem_check.solve(scene).final.quantities["plastic_volume"]
        assert volume == (1.0 if yields else 0.0)


def test_unloading_is_elastic_at_first_and_leaves_its_mark() -> None:
    scene = rough_scene(16, 3, pressure=(0.05, 0.049, 0.01, 0.05), hardness=math.inf)
    steps = fem_check.solve(scene).steps
    peak, eased, low, again = steps
    strain = [s.quantities["largest_plastic_strain"] for s in steps]
    assert strain[1] == strain[0]  # nothing flows on the first bit of unloading
    # Conforming on the way down: more contact than on the way up at the same load.
    up = fem_check.solve(rough_scene(16, 3, pressure=0.01)).final
    assert low.areas["raw"].total > up.areas["raw"].total
    assert eased.areas["raw"].total <= peak.areas["raw"].total
    # Back at the peak load the body is where it was: shakedown to 1 %.
    assert again.quantities["mean_gap"] == pytest.approx(peak.quantities["mean_gap"], rel=0.01)


def test_elastic_unloading_comes_back_the_same_way() -> None:
    scene = rough_scene(16, 3, pressure=(0.02, 0.05, 0.02), hardness=math.inf)
    up, _, down = fem_check.solve(scene, law="elastic").steps
    assert down.areas["raw"] == up.areas["raw"]
    assert down.quantities["mean_gap"] == pytest.approx(up.quantities["mean_gap"], rel=1e-9)


@pytest.mark.parametrize("law", ["elastic", "capped", "j2"])
def test_prescribing_the_approach_finds_the_load_that_gives_it(law: str) -> None:
    by_load = fem_check.solve(rough_scene(16, 3), law=law, steps=1)  # type: ignore[arg-type]
    approach = by_load.final.quantities["approach"]
    by_approach = fem_check.solve(
        rough_scene(16, 3),
        law=law,
        steps=1,
        approach=approach,  # type: ignore[arg-type]
    )
    # One step each: J2 paths of load and of approach differ by their flow along the way.
    assert by_approach.final.mean_pressure == pytest.approx(0.05, rel=5e-3 if law == "j2" else 1e-7)


@pytest.mark.parametrize("body", [Body(), Body("bonded_layer", 0.3)], ids=lambda b: b.kind)
def test_a_capped_body_unloads_as_an_elastic_one_with_the_surface_left_behind(body: Body) -> None:
    """And from its largest load on it goes as if it had never been unloaded."""
    scene, peak = rough_scene(16, 5, hardness=0.25, body=body), 0.05

    def solved(*path: float) -> ContactResult:
        return fem_check.solve(
            dataclasses.replace(scene, load=Load(path)), law="capped", certified=False
        )

    lowered = solved(peak).fields["plastic_displacement"]
    result = solved(0.3 * peak, peak, 0.7 * peak, 0.4 * peak)
    np.testing.assert_allclose(result.fields["plastic_displacement"], lowered, atol=1e-12)
    left = dataclasses.replace(scene.surface, heights=scene.surface.heights - lowered)
    elastic = fem_check.solve(
        dataclasses.replace(scene, surface=left, load=Load(0.4 * peak)), law="elastic"
    )
    for name, scale in (("pressure", 0.25), ("displacement", lowered.max())):
        difference = np.abs(result.fields[name] - elastic.fields[name]).max()
        assert difference < 1e-7 * scale
    open_gap = result.fields["gap"] + result.fields["plastic_displacement"]
    np.testing.assert_allclose(open_gap, elastic.fields["gap"], atol=1e-7 * lowered.max())
    assert result.final.areas["raw"].plastic == 0.0
    *_, again, beyond = solved(peak, 0.0, 0.2 * peak, peak, 1.3 * peak).steps
    assert again.areas == solved(peak).final.areas
    assert beyond.quantities == pytest.approx(solved(1.3 * peak).final.quantities, rel=1e-7)


@pytest.mark.parametrize("law", ["elastic", "j2"])
def test_a_path_may_end_where_nothing_touches(law: str) -> None:
    """The certificate has no contact force to divide by there."""
    result = fem_check.solve(
        rough_scene(12, 2),
        law=law,  # type: ignore[arg-type]
        approach=(0.01, 1e-5),
    )
    assert result.steps[0].mean_pressure > 0
    if law == "j2":
        # Flattened for good, it leaves the flat before that is back at its first touch.
        assert result.final.mean_pressure == 0
    assert result.final.residuals["certified_balance"] < 1e-7


def test_hardening_bears_more_on_less() -> None:
    soft, hard = (fem_check.solve(rough_scene(16, 2), hardening=h) for h in (0.0, 5.0))
    assert hard.final.areas["raw"].total < soft.final.areas["raw"].total
    assert hard.final.quantities["largest_pressure"] > soft.final.quantities["largest_pressure"]


def test_no_poisson_ratio_locks() -> None:
    """As nu tends to 1/2 the answer settles; a locking element would stiffen without bound."""
    areas = [
        fem_check.solve(rough_scene(24, 3, poisson_ratio=nu), certified=False)
        .final.areas["raw"]
        .total
        for nu in (0.45, 0.49, 0.499)
    ]
    assert max(areas) - min(areas) < 0.03 * areas[0]


@pytest.mark.parametrize("law", ["elastic", "j2"])
def test_moved_nodes_tend_to_the_gap_as_the_slope_vanishes(law: str) -> None:
    """At equal groups the answers differ by an amount of first order in the slope (a little more
    where plastic flow adds its own), and by a measurable one at slope 0.2."""
    slopes, differences = np.array([0.0125, 0.2]), []
    for slope in slopes:
        scene = rough_scene(12, 2, slope=float(slope), pressure=0.2)
        gap, moved = (
            fem_check.solve(scene, law=law, geometry=g, certified=False).fields["pressure"]  # type: ignore[arg-type]
            for g in ("gap", "moved")
        )
        differences.append(np.linalg.norm(moved - gap) / np.linalg.norm(gap))
    order = np.polyfit(np.log(slopes), np.log(differences), 1)[0]
    assert 0.8 < order < 1.8, (order, differences)
    assert differences[0] < 0.02
    assert differences[-1] > 0.02


def test_what_makes_no_sense_is_refused_in_one_sentence() -> None:
    scene = rough_scene(8, 2)
    for options, words in (
        ({"law": "viscous"}, "law is 'viscous'"),
        ({"geometry": "curved"}, "geometry is 'curved'"),
        ({"hardening": -1.0}, "hardening is -1.0"),
        ({"tolerance": 0.0}, "tolerance is 0.0"),
        ({"steps": 0}, "steps is 0"),
        ({"step_tolerance": 1.0}, "step_tolerance is 1.0"),
        ({"approach": -0.1}, "approach is -0.1"),
        ({"approach": ()}, "approach is ()"),
        ({"layers": -3}, "layers is -3"),
        ({"depth": math.nan}, "depth is nan"),
    ):
        with pytest.raises(InvalidScene) as caught:
            fem_check.solve(scene, **options)  # type: ignore[arg-type]
        assert words in str(caught.value)
    with pytest.raises(InvalidScene, match="finite yield_stress"):
        fem_check.solve(rough_scene(8, 2, yield_stress=math.inf))
    with pytest.raises(InvalidScene, match="finite hardness"):
        fem_check.solve(rough_scene(8, 2, hardness=math.inf), law="capped")


def test_a_body_that_flows_wherever_it_touches_has_the_area_of_the_load_over_the_hardness() -> None:
    """Fronts between open and capped nodes are not corrected, as no elastic rim is between them.
    On a scene without any the load is a whole number of nodes at the cap, or cannot be met."""
    soft = rough_scene(16, 4, hardness=0.03, pressure=0.006)
    areas = fem_check.solve(soft, law="capped", threads=1, certified=False).final.areas
    assert areas["corrected"].total == pytest.approx(0.2, rel=0.01)
    assert areas["error"].total > 0.01
    softest = rough_scene(16, 4, hardness=1e-5, pressure=2e-6)
    with pytest.raises(NotConverged, match="narrower than a node"):
        fem_check.solve(softest, law="capped", threads=1)


def test_a_step_that_does_not_converge_raises_with_its_history_and_commits_nothing() -> None:
    path = driver.solve_path(rough_scene(16, 3))
    history, state = path.history, path.points[-1].state
    before = history.accumulated.copy()
    with pytest.raises(NotConverged, match="did not converge in 1 Newton") as caught:
        solve_increment(
            path.problem, state, history, Control(0.2, scale=0.2), NewtonOptions(max_newton=1)
        )
    assert len(caught.value.history) == 2
    assert caught.value.residuals["balance"] > 1e-8
    np.testing.assert_array_equal(history.accumulated, before)


def test_increments_that_fail_are_halved(monkeypatch: pytest.MonkeyPatch) -> None:
    real = increments.solve_increment
    asked = []

    def reluctant(problem, state, history, control, options):  # type: ignore[no-untyped-def]
        asked.append(control.load)
        if control.load > 0.03 and not (asked[:-1] and max(asked[:-1]) > 0.03 and len(asked) > 2):
            raise NotConverged("too far")
        return real(problem, state, history, control, options)

    monkeypatch.setattr(increments, "solve_increment", reluctant)
    result = fem_check.solve(rough_scene(8, 2), steps=1)
    assert asked[:2] == [pytest.approx(0.05), pytest.approx(0.025)]
    assert result.final.mean_pressure == 0.05
    assert any("halved" in note for note in result.notes)


def test_progress_is_told() -> None:
    told: list[float] = []
    scene = rough_scene(8, 2, pressure=(0.02, 0.05))
    fem_check.solve(scene, progress=lambda share, sentence: told.append(share))
    assert told == [0.5, 1.0]


def test_a_scene_outside_what_it_can_answer_is_answered_with_a_warning() -> None:
    steep = fem_check.solve(rough_scene(16, 2, slope=0.3), law="elastic")
    assert any("slope" in note for note in steep.notes)
    fine = fem_check.solve(rough_scene(32, 15, pressure=0.001), law="elastic", certified=False)
    assert any("nodes across" in note for note in fine.notes)
    deep = fem_check.solve(rough_scene(16, 2, pressure=0.5))
    assert any("reaches the base" in note for note in deep.notes)
    good = fem_check.solve(rough_scene(32, 2, pressure=0.1), certified=False)
    assert good.notes == ()


def test_j2_flow_is_elastic_again_where_the_surface_has_not_yielded() -> None:
    """Plastic nodes are contact nodes over yielded elements, and no others."""
    path = driver.solve_path(rough_scene(16, 3))
    states = path.points[-1].surface_states
    flowed = (path.history.accumulated[path.history.rows[:256]] > 0).any(axis=1).reshape(16, 16)
    for i, j in np.ndindex(16, 16):
        around = flowed[[i - 1, i - 1, i, i], [j - 1, j, j - 1, j]].any()
        touching = path.points[-1].state.states[i, j] == ELASTIC
        assert states[i, j] == (PLASTIC if touching and around else ELASTIC if touching else APART)


def test_a_block_that_will_not_fit_is_refused_before_anything_is_made() -> None:
    scene = rough_scene(64, 4)
    with pytest.raises(NotEnoughMemory, match=r"64 x 64 x 1000000 elements needs about"):
        fem_check.solve(scene, layers=1_000_000)


@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_full_contact_leaves_nothing_to_press(nu: float) -> None:
    """With every node in contact the load alone decides: no direction is left to search along."""
    unit = 1e11 / (1 - nu**2) * 0.1
    material = Material(1e11, nu, yield_stress=unit / 50)
    scene = Scene(rough_surface((12, 12)), material, Load(unit))
    assert fem_check.solve(scene, law="j2").final.areas["raw"].total == 1.0
