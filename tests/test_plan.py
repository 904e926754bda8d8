"""Plans: the rule by which a model is chosen, that promises hold, and that plans are
cheaper.
"""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke
from scipy import ndimage

from epcontact import alternatives, bem
from epcontact.errors import InvalidCase
from epcontact.harness.case_files.case import load_case
from epcontact.harness.solving.method_results import MethodResults
from epcontact.planning import (
    achieved_error,
    auto_case,
    expected_map_errors,
    finer_case,
    grids,
    pilots,
    plan,
)
from epcontact.planning import planned_case as planned
from epcontact.reference import CLOSED_FORMS
from epcontact.results import FACTOR_TO_95, Areas
from epcontact.scene import Load
from epcontact.surfaces import HeightsFromArray, Sinusoid


def solved(case):
    """Return the results of boundary elements for all surfaces of a case."""
    options = case.options["bem"]
    results = [bem.solve(case.scene(r), threads=1, **options) for r in case.recipes]
    return MethodResults(tuple(results), tuple(f"seed{i}" for i in range(len(results))))


def with_areas(result, corrected, error):
    """Return a result whose corrected area and error of the area (fractions of the
    nominal area) are replaced, with no plastic area.
    """
    areas = {"corrected": Areas(corrected, 0.0, 0.0), "error": Areas(error, 0.0, 0.0)}
    areas = result.final.areas | areas
    return replace(result, steps=(replace(result.final, areas=areas),))


def mean_total(answer):
    """Return the mean corrected contact area of results, a fraction of the nominal
    area.
    """
    return float(np.mean([r.final.areas["corrected"].total for r in answer.results]))


def true_total(case):
    """Return the contact area of a case's closed form, or that of its own fine grid, as
    a fraction of the nominal area.
    """
    gates = (g.against for g in case.gates if g.quantity == "area.total.corrected")
    scene = case.scene(case.recipes[0])
    against = next(gates, "")
    if against in CLOSED_FORMS:
        return CLOSED_FORMS[against].scalar("area.total.corrected", scene)
    return bem.solve(scene, area_tolerance=1e-4).final.areas["corrected"].total


def pilot(n, error, total=0.1):
    """Return a pilot solution on n x n points with a relative error and a total area.

    Its work is 30 FFT pairs.
    """
    return pilots.Pilot((n, n), Areas(total, 0.06, 0.04), error, 1.0, 30.0 * n**2)


@pytest.mark.parametrize(("ratio", "order"), [(2**1.5, 1.5), (0.9, 1), (16.0, 2)])
def test_errors_are_carried_by_their_observed_order_within_1_to_2(ratio, order):
    """The error on a finer grid follows the observed order of two pilots, limited to 1
    and 2.

    `ratio` is that of the pilots' errors, and `order` the order that is used.
    """
    known = [pilot(64, 0.08), pilot(128, 0.08 / ratio)]
    assert pilots.estimate_error(known, (512, 512)) == pytest.approx(
        0.08 / ratio / 4**order
    )
    assert pilots.estimate_work(known, (256, 256)) == pytest.approx(30 * 256**2)


def test_few_pilots_are_not_taken_at_their_word():
    """The standard deviation of few surfaces is raised to its upper 80 % limit."""
    spread = [pilot(64, 0.01, total=total) for total in (0.09, 0.10, 0.11)]
    # chi^2(2 degrees, lower 20 %) = -2 ln 0.8
    expected = 0.1 * math.sqrt(2 / (-2 * math.log(0.8)))
    assert pilots.largest_deviation(spread, ["total"]) == pytest.approx(expected)


def test_a_ladder_starts_at_three_points_a_wavelength_and_holds_the_case_s_own_grid():
    """The grids of the pilots begin with three points in the shortest wavelength and
    end with the case's, or a finer one.

    A measured surface has its own grid alone.
    """
    recipe = load_case("rough-capped", "full").recipes[0]
    rungs = grids.ladder(recipe, beyond=False)
    coarse = grids.on_grid(recipe, rungs[0])
    assert grids.points_per_wavelength(coarse) == pytest.approx(3, rel=0.02)
    assert rungs[-1] == recipe.shape
    assert math.prod(grids.ladder(recipe, beyond=True)[-1]) > math.prod(recipe.shape)
    measured = HeightsFromArray(
        np.random.default_rng(1).random((32, 32)), (1.0, 1.0), "periodic"
    )
    assert grids.ladder(measured, beyond=True) == [(32, 32)]


@pytest.mark.parametrize("axis", [0, 1])
def test_a_section_is_the_line_of_a_one_directional_surface(axis):
    """A surface that varies along one axis is planned as a line of it.

    `axis` is the index of this axis; other surfaces and lines have no such axis.
    """
    whole = Sinusoid((1e-3, 2e-3), (64, 96), 1e-6, 2, "xy"[axis])
    assert grids.one_directional(whole) == axis
    line = grids.Section(whole, axis).build()
    assert np.array_equal(
        line.heights, np.take(whole.build().heights, 5, axis=1 - axis)
    )
    assert line.periods == (whole.periods[axis],)
    assert line.fingerprint != whole.fingerprint
    assert (
        grids.one_directional(Sinusoid((1e-3, 1e-3), (64, 64), 1e-6, 1, "both")) is None
    )
    assert grids.one_directional(Sinusoid((1e-3,), (64,), 1e-6)) is None


@pytest.mark.parametrize(
    ("name", "size", "tolerance", "said"),
    [
        ("hertz-sphere-dense", "full", 0.003, ""),
        ("westergaard-surface", "fast", 0.002, "a line stands for the surface"),
        ("rough-capped", "full", 0.005, ""),
    ],
)
def test_a_plan_keeps_its_promise_and_is_cheaper_than_the_hand_chosen_size(
    name, size, tolerance, said
):
    """The area by a plan is within the tolerance of the true one, for less than a tenth
    of the work.

    `name` and `size` are those of the case, and `said` is a part of the plan's first
    reason.
    """
    case = load_case(name, size)
    chosen = plan(case, tolerance, threads=1)
    answer = solved(planned(case, chosen))
    assert achieved_error(chosen, answer) <= tolerance
    assert mean_total(answer) == pytest.approx(true_total(case), rel=tolerance)
    assert chosen.work + chosen.pilot_work < 0.1 * chosen.given_work
    assert said in chosen.reasons[0]
    with pytest.raises(InvalidCase, match="no answer"):
        achieved_error(chosen, MethodResults())


def test_a_plan_refines_where_edges_hold_the_fronts():
    """A flat punch needs four times the points for a fifth of the tolerance.

    Heights that cannot be refined miss the tolerance, and the plan says so.
    """
    punch = load_case("punch-disc")
    recipe = punch.recipes[0]
    chosen = plan(punch, 0.02, threads=1)
    assert math.prod(chosen.shape) >= 4 * math.prod(plan(punch, 0.1, threads=1).shape)
    answer = solved(planned(punch, chosen))
    assert achieved_error(chosen, answer) <= 0.02
    exact = math.pi * recipe.radius**2 / math.prod(recipe.periods)
    assert mean_total(answer) == pytest.approx(exact, rel=0.02)
    # Heights that cannot be refined miss the tolerance.
    measured = HeightsFromArray(
        recipe.build().heights[::16, ::16], recipe.periods, "periodic"
    )
    stuck = plan(punch.changed(recipes=(measured,)), 0.02, threads=1)
    assert not stuck.meets
    assert "is not met" in stuck.reasons[-1]
    assert finer_case(punch, stuck) is None


@pytest.mark.parametrize("step", [0, -1])
def test_the_errors_by_the_measurement_of_a_map_are_those_of_its_run(monkeypatch, step):
    """A plan expects the parts of the error of the area that a solve of the map
    reports, also on every second point, and counts the solves that they take.
    """
    case = load_case("rough-capped")
    generated = case.recipes[0]
    surface = generated.build()
    heights = surface.heights[:48, :40].copy()
    heights[heights > np.quantile(heights, 0.99)] = np.nan
    periods = (48 * surface.spacing[0], 40 * surface.spacing[1])
    recipe = HeightsFromArray(heights, periods, "mirrored", missing="nearest")
    loads = Load((0.05 * case.material.hardness, 0.2 * case.material.hardness))
    case = case.changed(recipes=(recipe,), load=loads)
    for most, solves in ((2**18, 4), (96 * 80 // 4, 5)):
        monkeypatch.setattr(alternatives, "LARGEST_GRID", most)
        errors = expected_map_errors(case, recipe, step, threads=1)
        solved_step = bem.solve(case.scene(recipe)).steps[step]
        area = solved_step.best_areas.total
        reported = solved_step.error_parts("total_area")
        assert errors.solves == solves
        assert math.prod(errors.shape) <= most
        assert errors.work >= 5 * solves * math.prod(errors.shape)
        assert errors.parts.keys() == {"treatment", "form", "missing"}
        assert errors.parts["treatment"] == pytest.approx(reported["treatment"] / area)
        for source in ("form", "missing"):
            expected = pytest.approx(reported[source] / area, 0.05, abs=1e-4)
            assert errors.parts[source] == expected
        assert min(errors.parts.values()) > 1e-3
    assert expected_map_errors(case, generated, step).parts == {}


def test_a_finer_grid_finds_out_a_claim_that_is_too_small():
    """`achieved_error` includes the difference from a grid twice as fine.

    An area 10 % too large with no stated error is found by that.
    """
    case = load_case("rough-capped")
    chosen = plan(case, 0.02, threads=1)
    answer = solved(planned(case, chosen))
    check = finer_case(case, chosen)
    assert check.recipes[0].shape == tuple(2 * n for n in chosen.shape)
    finer = solved(check)
    assert achieved_error(chosen, answer, finer) <= 0.02
    best = mean_total(answer)
    sure = MethodResults((with_areas(answer.results[0], 1.1 * best, 0.0),), ("seed0",))
    assert achieved_error(chosen, sure) == 0
    assert achieved_error(chosen, sure, finer) == pytest.approx(0.1, abs=0.02)


def test_as_few_surfaces_as_the_tolerance_allows_and_new_ones_where_it_needs_more(
    write_case,
):
    """A plan takes as few surfaces as its tolerance allows, the case's first, and then
    new seeds.

    With `capped` it never takes more points or surfaces than the case.
    """
    case = load_case(
        write_case(("seeds = [3, 5, 7]", "seeds = [1, 2, 3, 4, 5, 9]")), "full"
    )
    chosen = plan(case.changed(methods=("bem",)), 0.05, threads=1)
    assert chosen.meets
    room = math.sqrt(0.05**2 - chosen.grid_error**2)
    # Student's quantile grows with one surface less, too.
    one_less = chosen.scatter * math.sqrt(chosen.surfaces / (chosen.surfaces - 1))
    assert chosen.scatter <= room < one_less * 1.5
    expected = (1, 2, 3, 4, 5, 9, *range(10, 10 + chosen.surfaces))
    assert (
        tuple(recipe.seed for recipe in chosen.recipes) == expected[: chosen.surfaces]
    )
    bound = plan(case, 1e-4, threads=1, capped=True)  # never beyond the case
    assert bound.surfaces <= 6
    assert math.prod(bound.shape) <= math.prod(case.recipes[0].shape)
    assert not bound.meets


def test_an_ensemble_s_error_holds_its_scatter(write_case):
    """The achieved error is the root of the sum of the squares of grid error and
    scatter, the 95 % interval of the mean of the surfaces.
    """
    case = load_case(write_case())
    chosen = plan(case.changed(methods=("bem",)), 0.3, threads=1)
    result = bem.solve(case.scene(case.recipes[0]), threads=1)
    best = result.final.areas["corrected"].total
    error = result.final.areas["error"].total
    shifted = tuple(
        with_areas(result, best * factor, error) for factor in (0.9, 1.0, 1.1)
    )
    answer = MethodResults(shifted, ("a", "b", "c"))
    # t(2 degrees, 97.5 %) = 4.302653; an error estimate of an area holds 90 %.
    expected = math.hypot(FACTOR_TO_95 * error / best, 0.4302653 / math.sqrt(3))
    assert achieved_error(chosen, answer) == pytest.approx(expected, rel=1e-6)


@pytest.mark.long
def test_plans_keep_their_promise_on_surfaces_they_have_not_seen(write_case):
    """At least 11 of 12 plans with a tolerance of 5 % keep it on new surfaces.

    The true area is the mean of 300 surfaces on a finer grid.
    """
    case = load_case(write_case(), "full").changed(methods=("bem",))
    first = case.recipes[0]
    kept = 0
    fine = replace(first, shape=tuple(2 * n for n in first.shape))
    truths = tuple(replace(fine, seed=s) for s in range(1000, 1300))
    truth = mean_total(solved(case.changed(recipes=truths)))
    for k in range(12):
        given = tuple(replace(first, seed=s) for s in range(8 * k, 8 * k + 8))
        chosen = plan(case.changed(recipes=given), 0.05, threads=1)
        fresh = tuple(
            replace(r, seed=5000 + 200 * k + i) for i, r in enumerate(chosen.recipes)
        )
        kept += abs(mean_total(solved(case.changed(recipes=fresh))) / truth - 1) <= 0.05
    # Of promises at 95 %, more than one broken in twelve has a chance of one in eight.
    assert kept >= 11


def test_the_theory_stands_in_only_where_it_is_near_enough(write_case):
    """A plan chooses the theory for a tolerance of 90 % and boundary elements for 2
    %.
    """
    case = load_case(write_case())
    loose = plan(case, 0.9, threads=1)
    tight = plan(case, 0.02, threads=1)
    assert (loose.method, loose.work) == ("persson", 0.0)
    assert tight.method == "bem"
    assert any("so the theory does not suffice" in reason for reason in tight.reasons)
    assert achieved_error(loose, MethodResults((object(),), ("x",))) <= 0.9


def test_the_map_of_its_error_decides_where_the_theory_stands_in():
    """The theory may stand in for the contact area but not for the plastic area, by the
    map of its errors.

    Where it misses a tenth of the area it misses three quarters of the plastic spots.
    """
    spots = load_case("where-spots")
    area = plan(spots, 0.2, parts=("total",), threads=1)
    plastic = plan(spots, 0.2, parts=("plastic",), threads=1)
    assert (area.method, plastic.method) == ("persson", "bem")
    assert 0.1 < area.expected_error < 0.2
    assert any("off by 0.7" in reason for reason in plastic.reasons)
    assert "by the map of its error" in area.reasons[0]


J2 = (
    ('methods = ["persson", "bem"]', 'methods = ["bem", "fem"]'),
    ('of = "bem"\nagainst = "persson"', 'of = "fem"\nagainst = 0.1\nsource = "made"'),
)


def test_finite_elements_are_given_depth_and_increments(write_case):
    """A plan of a J2 body chooses depth and load increments of the finite elements."""
    material = ("hardness = 6.0e9", "yield_stress = 2.0e9")
    short = (
        "wavenumber_high = 5.026548245743669e4",
        "wavenumber_high = 1.8849555921538758e4",
    )
    small = (
        ("{ fast = 4, full = 8 }", "6"),
        ("[3, 5, 7]", "[3]"),
        ('"bem", "fem"', '"fem"'),
    )
    case = load_case(write_case(*J2, material, short, *small))
    chosen = plan(case, 0.2, threads=1)
    assert chosen.method == "fem"
    assert chosen.options["depth"] > 0
    # The most increments are the reference of the others, which is not compared with
    # itself.
    assert chosen.options["steps"] in sorted(pilots.STEPS)[:-1] == [*pilots.STEPS[:-1]]
    assert chosen.options.items() <= planned(case, chosen).options["fem"].items()


@pytest.mark.parametrize(
    ("hardness", "tolerance", "said"),
    [
        ("6.0e9", 0.2, ["a cap of 6e+09 Pa, not for J2", "can represent the J2 body"]),
        ('"effective"', 0.05, ["cannot represent the J2 body"]),
    ],
)
def test_a_plan_with_a_cap_says_whether_it_stands_for_the_j2_body(
    write_case, hardness, tolerance, said
):
    """A plan with boundary elements states whether their hardness can represent a J2
    body.

    `hardness` is that of the case, in Pa or "effective", and `said` are parts of the
    reasons in order.
    """
    strength = ("hardness = 6.0e9", f"hardness = {hardness}\nyield_stress = 2.0e9")
    chosen = plan(load_case(write_case(*J2, strength)), tolerance)
    assert chosen.method == "bem"
    assert all(
        words in reason for reason, words in zip(chosen.reasons, said, strict=False)
    )


def test_auto_keeps_what_gates_ask_for_and_makes_corrected_areas_cheaper():
    """The size "auto" keeps a grid that a gate needs, and takes a coarser one where
    gates read only corrected areas.
    """
    given = load_case("hertz-sphere")
    auto, told = auto_case(given, threads=1)
    assert (auto.recipes, auto.size) == (given.recipes, "auto")
    assert "asks for its grid" in told
    given = load_case("hertz-sphere-dense", "full")
    # Gates of 1 %: those of the case itself are a thirtieth of that and keep its grid.
    case = given.changed(
        gates=tuple(replace(g, low=-0.01, high=0.01) for g in given.gates)
    )
    auto, told = auto_case(case, threads=1)
    assert math.prod(auto.recipes[0].shape) < math.prod(case.recipes[0].shape)
    assert "corrected areas" in told
    assert mean_total(solved(auto)) == pytest.approx(true_total(case), rel=0.01)


def test_what_can_have_no_plan_is_refused():
    """`plan` raises InvalidCase for a tolerance that is not between 0 and 1, and for a
    case without a numerical method.
    """
    for tolerance in (0.0, 1.0, math.nan):
        with pytest.raises(InvalidCase, match="between 0 and 1"):
            plan(load_case("rough-capped"), tolerance)
    with pytest.raises(InvalidCase, match="needs no plan"):
        plan(load_case("theory-elastic"))


def test_a_path_is_planned_for_the_load_that_is_the_hardest_to_answer(write_case):
    """A plan of a load path holds for the load with the largest relative error on a
    coarse grid, here the third of four.
    """
    path = ("mean_pressure = 5.0e8", "mean_pressure = [5.0e8, 1.0e9, 1.0e8, 0]")
    gate = ('against = "persson"', 'against = 0.1\nsource = "made"')
    case = load_case(write_case(('"persson", "bem"', '"bem"'), gate, path))
    case = case.changed(recipes=case.recipes[:1], gates=())
    chosen = plan(case, 0.05, threads=1)
    first = case.recipes[0]
    coarse = grids.on_grid(first, grids.ladder(first, beyond=False)[0])
    steps = bem.solve(case.scene(coarse), area_tolerance=1e-4).steps
    claims = [
        s.areas["error"].total / (s.areas["corrected"].total or np.inf) for s in steps
    ]
    assert chosen.step == np.argmax(claims) == 2
    assert chosen.reasons[0].startswith(
        "the plan is for the load of 1e+08 Pa, number 3 of the"
    )
    answer = solved(planned(case, chosen))
    areas = answer.results[0].steps[2].areas
    error = FACTOR_TO_95 * areas["error"].total / areas["corrected"].total
    assert achieved_error(chosen, answer) == pytest.approx(error, rel=1e-6)
    assert error <= 0.05


@pytest.mark.parametrize(
    ("case_id", "tolerance", "parts"),
    [
        ("rough-interface", 0.01, ("total",)),
        ("rough-capped", 0.018, ("total",)),
        ("rough-elastic", 0.01, ("total",)),
        ("rough-capped", 0.03, ("total", "plastic")),
    ],
)
def test_every_part_of_a_plan_s_error_is_at_95(case_id, tolerance, parts):
    """The grid's part is the half-width of the interval that a solve of the planned
    case reports, and together with the scatter it is within the tolerance, or the plan
    says that it is not.
    """
    case = load_case(case_id).changed(methods=("bem",))
    chosen = plan(case, tolerance, parts=parts, threads=1)
    first = planned(case, chosen).changed(recipes=chosen.recipes[:1])
    step = solved(first).results[0].steps[chosen.step]
    reported = []
    for part in parts:
        grid = step.error_parts(f"{part}_area")["grid"]
        reported.append(grid / getattr(step.best_areas, part))
    if not any("extrapolated" in reason for reason in chosen.reasons):
        assert chosen.grid_error == pytest.approx(max(reported), rel=0.02)
    assert chosen.grid_error >= 0.7 * max(reported)
    total = math.hypot(chosen.grid_error, chosen.scatter)
    assert chosen.expected_error == pytest.approx(total)
    assert chosen.meets is (total <= tolerance)
    assert any("is not met" in reason for reason in chosen.reasons) is not chosen.meets


@pytest.mark.parametrize(
    ("case_id", "tolerance"), [("rough-interface", 1.0), ("rough-capped", 1.8)]
)
def test_the_printed_error_is_within_the_tolerance_or_the_command_fails(
    case_id, tolerance
):
    """`plan` ends with 0 only if the area's error that it prints is at most the
    tolerance, in %.
    """
    done = invoke("plan", case_id, "--tolerance", f"{tolerance}%")
    printed = float(re.search(r"area ± (\S+) % at 95 %", done.stdout)[1])
    assert (printed <= tolerance) is (done.returncode == 0), done.stdout
    assert ("is not met" in done.stdout) is (done.returncode != 0)


def test_a_plan_of_a_map_has_the_errors_that_run_reports(monkeypatch, tmp_path):
    """The last line of `plan` has each part of the error of the area, and they are
    those of `run` on the same grid: by the grid, the edges, the form and the holes.
    """
    monkeypatch.chdir(tmp_path)
    heights = np.random.default_rng(5).normal(size=(24, 20))
    heights = ndimage.gaussian_filter(heights, 1.5, mode="wrap")
    heights[7:9, 5:8] = np.nan
    np.savetxt("steel.csv", heights, delimiter=",")
    assert invoke("new", "steel.csv", "--pixel-size", 1e-6).returncode == 0
    planned_line = invoke("plan", "steel.toml", "--tolerance", "0.1%").stdout
    assert invoke("run", "steel.toml", "--jobs", 1).returncode == 0
    content = json.loads(Path("results/steel/fast/bem.json").read_text())
    load = int(re.search(r"number (\d) of the path", planned_line)[1]) - 1
    area = content["loads"][load]["total_area"]
    *_, line = planned_line.splitlines()
    total = float(re.search(r"area ± (\S+) %", line)[1])
    assert total == pytest.approx(100 * area["error"] / area["mean"], rel=0.06)
    words = {
        "grid": "grid",
        "treatment": "edges of the map",
        "form": "its removed form",
        "missing": "its missing heights",
    }
    assert area["parts"].keys() == words.keys()
    for part, error in area["parts"].items():
        found = float(re.search(rf"{words[part]} (\S+) %", line)[1])
        # Below 0.001 % is what the two solves are apart by their tolerance.
        expected = pytest.approx(100 * error / area["mean"], rel=0.06, abs=1e-3)
        assert found == expected
