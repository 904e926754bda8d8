"""Every load of a path is a row of its own: figures, errors and units, computed a
second time.
"""

import functools
import io
import itertools
import json
import pickle
from dataclasses import replace
from typing import get_args

import numpy as np
import pandas as pd
import pytest
from command_line import invoke
from conftest import SMALL_CASE

import epcontact
import fem_check
from epcontact import bem, effective_hardness
from epcontact.harness.case_files.case import load_case
from epcontact.harness.case_files.model import MeasuredColumn
from epcontact.harness.quantities.registry import QUANTITIES
from epcontact.harness.solving import load_path, measure, run, saved
from epcontact.harness.solving.method_results import MethodResults, load_rows
from epcontact.harness.solving.run import run_cases
from epcontact.harness.solving.tasks import Run, tasks_of
from epcontact.harness.verdict.judgement import judge_case
from epcontact.interface import find_patches, interface_stiffness, percolation_fraction
from epcontact.output.loads import connection_sentences, load_cells
from epcontact.output.vtk import read_fields
from epcontact.pictures.loads import load_charts
from epcontact.reference.waves import line_mean_gap
from epcontact.results import (
    COLUMNS,
    ELASTIC,
    PLASTIC,
    Areas,
    ContactResult,
    LoadStep,
    Provenance,
)
from epcontact.scene import Load, Material, Scene, Surface

PATH = ("mean_pressure = 5.0e8", "mean_pressure = [2.0e8, 5.0e8, 1.0e8, 3.0e8]")
BEM = ('["persson", "bem"]', '["bem"]')
AREA = (
    'against = "persson"\ntolerance = 0.5',
    'against = 0.1\nsource = "none"\ntolerance = 5.0',
)


CONDUCTING = "thermal_conductivities = [16.0, 50.0]"
MEASURED_COLUMNS = get_args(MeasuredColumn)
MEASURED = set(MEASURED_COLUMNS)


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Return a case of two surfaces along a path, run from the command line: the case,
    the folder of its results, and its JSON file as a dictionary.
    """
    home = tmp_path_factory.mktemp("loads")
    text = SMALL_CASE
    for old, new in (BEM, AREA, PATH, ("[3, 5, 7]", "[3, 5]")):
        text = text.replace(old, new)
    path = home / "small.toml"
    path.write_text(text)
    options = ("--output", home, "--jobs", 1, "--fields", "steps", "--charts")
    done = invoke("run", path, *options)
    assert done.returncode == 0, done
    folder = home / "small" / "fast"
    data = json.loads((folder / "bem.json").read_text())
    return load_case(path), folder, data


def solve_until(case, number, recipe):
    """Return the scene and the solution by boundary elements of a path that ends early.

    `number` is the index of its last load, and `recipe` that of the case's surface.
    """
    scene = case.scene(recipe)
    shorter = replace(scene, load=Load(scene.load.path[: number + 1]))
    return shorter, bem.solve(shorter)


def test_every_load_has_its_own_figures_and_fields(ran):
    """Each row of `loads` has the mean of two surfaces, its scatter, grid error and
    branch, as paths that end at this load give them.

    Each load has a picture.
    """
    case, folder, data = ran
    branches = ["loading", "loading", "unloading", "reloading"]
    assert [row["branch"] for row in data["loads"]] == branches
    for number, row in enumerate(data["loads"]):
        solutions = [solve_until(case, number, recipe) for recipe in case.recipes]
        steps = [result.final for _, result in solutions]
        loading = [interface_stiffness(*pair, "loading") for pair in solutions]
        unloading = [interface_stiffness(*pair, "unloading") for pair in solutions]
        corrected = [step.areas["corrected"] for step in steps]
        expected = {
            "mean_pressure": [case.load.path[number]] * 2,
            "hardness": [6e9, 6e9],
            "mean_gap": [step.quantities["mean_gap"] for step in steps],
            "total_area": [areas.total for areas in corrected],
            "plastic_area": [areas.plastic for areas in corrected],
            "stiffness_loading": [limit.corrected for limit in loading],
            "stiffness_unloading": [limit.corrected for limit in unloading],
        }
        for name, values in expected.items():
            assert row[name]["mean"] == pytest.approx(np.mean(values), rel=1e-6), name
            # Student's t of two surfaces, 12.7, at 95 %; over sqrt(2) for the mean,
            # and times sqrt(2) because np.std divides by 2 and not by 1.
            scatter = 12.706204736 * np.std(values)
            found = row[name]["parts"].get("scatter", 0)
            assert found == pytest.approx(scatter, rel=1e-4, abs=1e-9)
        stiffness_error = np.mean([limit.error for limit in loading])
        found = row["stiffness_loading"]["parts"]["grid"]
        assert found == pytest.approx(1.19 * stiffness_error, rel=1e-4)
        grid = 1.19 * np.mean([step.areas["error"].total for step in steps])
        parts = row["total_area"]["parts"]
        assert parts.keys() == {"grid", "scatter"}
        assert parts["grid"] == pytest.approx(grid, rel=1e-4)
        error = np.hypot(grid, parts["scatter"])
        assert row["total_area"]["error"] == pytest.approx(error, rel=1e-4)
    assert len(list(folder.glob("contact-bem-step-*.png"))) == 4


def test_the_time_of_measuring_is_apart_from_the_time_of_solving(ran):
    """Each result has both times in seconds, and both are parts of the run."""
    _, folder, _ = ran
    for path in (folder / "members").glob("bem-seed*.json"):
        cost = json.loads(path.read_text())["cost"]
        assert cost["seconds"] > 0
        assert cost["measuring_seconds"] > 0


def test_a_percolation_is_the_fraction_of_the_closest_points_that_connects(ran):
    """The contact percolation of a load is the fraction of closest points that span the
    period.

    With one point less they do not span it. The closest are the points of highest
    pressure, and then those of smallest gap.
    """
    case, _, data = ran
    scene, result = solve_until(case, 1, case.recipes[0])
    pressure = result.fields["pressure"]
    elevation = result.fields["gap"] / np.ptp(scene.surface.heights)
    elevation[result.fields["state"] == ELASTIC] = 0.0
    closeness = pressure / pressure.max() - elevation
    limit = percolation_fraction(closeness)
    quantities = data["members"][0]["steps"][1]["quantities"]
    assert quantities["contact_percolation"] == limit.corrected
    rank = np.argsort(np.argsort(-closeness, axis=None)).reshape(closeness.shape)
    points = limit.raw * rank.size
    assert find_patches(rank < points).spans
    assert not find_patches(rank < points - 1).spans


def test_a_path_that_ends_at_no_load_shows_its_peak_and_what_it_leaves(
    write_case, tmp_path
):
    """After a path back to no load there are fields and maps of the peak and of the
    end, and the flattened points are counted at each smaller load.

    The fraction is that of the points at the hardness under the largest load.  Without
    fields, the run of another path leaves no peak of this one behind.
    """
    path = ("mean_pressure = 5.0e8", "mean_pressure = [2.0e8, 5.0e8, 1.0e8, 0.0]")
    file = write_case(BEM, AREA, path, ("[3, 5, 7]", "[3]"))
    done = invoke("run", file, "--output", tmp_path, "--jobs", 1, "--charts")
    assert done.returncode == 0, done
    assert "largest load in bem-seed3-peak.vti, at the last in bem-seed3.vti" in (
        done.stdout
    )
    folder = tmp_path / "small" / "fast"
    peak, end = (read_fields(folder / f"bem-seed3{name}.vti") for name in ("-peak", ""))
    case = load_case(file)
    _, expected = solve_until(case, 1, case.recipes[0])
    assert peak.attributes["mean_pressure"] == 5e8
    pressure = np.float32(expected.fields["pressure"])
    assert peak.fields["pressure"] == pytest.approx(pressure, rel=1e-5, abs=1e3)
    flowed = np.mean(expected.fields["state"] == PLASTIC)
    assert np.mean(end.fields["plastic_displacement"] > 0) == flowed > 0
    rows = json.loads((folder / "bem.json").read_text())["loads"]
    shares = [row.get("flowed_share", {}).get("mean") for row in rows]
    assert shares == [None, None, flowed, flowed]
    counts = pd.read_csv(folder / "contact-bem.csv").set_index("quantity").squeeze()
    assert counts["apart, flattened"] == flowed
    assert (
        "largest load of the path, 500 MPa"
        in (folder / "contact-bem-peak.txt").read_text()
    )
    assert not (folder / "pressure-distribution.png").exists()
    write_case(BEM, AREA, ("5.0e8", "4.0e8"), ("[3, 5, 7]", "[3]"))
    invoke("verify", file, "--output", tmp_path, "--jobs", 1)
    assert not [*folder.glob("*.vti")]


def test_the_gap_connects_where_a_patch_of_it_spans_the_surface(ran):
    """The sentence on the gap says yes, and that on the contact no, as the patches of
    points apart and in contact do or do not span the period.
    """
    case, _, data = ran
    masks = [
        solve_until(case, number, recipe)[1].fields["state"] > 0
        for number in range(4)
        for recipe in case.recipes
    ]
    assert all(find_patches(~mask).spans for mask in masks)
    assert not any(find_patches(mask).spans for mask in masks)
    results = [ContactResult.from_json(member) for member in data["members"]]
    gap, contact = connection_sentences(results)
    assert gap.startswith("The gap connects across the surface: yes at every load.")
    assert contact.startswith("The contact connects across the surface: no at every")
    needed = [r.steps[1].quantities["contact_percolation"] for r in results]
    assert f"closest {min(needed):.3g} to {max(needed):.3g} of the area" in contact


def test_the_load_at_which_the_gap_closes_is_between_its_neighbours():
    """On a path whose gap closes, each load has its answer, and a load near which it
    changes, which linear interpolation gives; within its error nothing is decided.
    """
    error = Areas(0.03, 0.03, 0.0)
    quantities = {"gap_percolation": 0.4, "gap_percolation.error": 0.04}
    steps = []
    for load, area in ((1e6, 0.3), (2e6, 0.5), (4e6, 0.7), (5e6, 0.62)):
        areas = {"raw": Areas(area, area, 0.0), "error": error}
        steps.append(LoadStep(load, areas, quantities=quantities))
    result = ContactResult("bem", tuple(steps), Provenance("digest"))
    answer = (
        "yes at 1, 2 MPa; no at 4 MPa; undecided within its error at 5 MPa "
        "(it changes near 3 MPa)"
    )
    # The estimate .04 covers nine of ten errors; the 95 % that ± means are 1.19 times.
    needs = "It needs the widest 0.4 ± 0.048 of the area open; at 5 MPa, 0.38 is open."
    assert connection_sentences([result]) == [
        f"The gap connects across the surface: {answer}. {needs}"
    ]
    open_steps = tuple(replace(steps[0], mean_pressure=s.mean_pressure) for s in steps)
    (sentence,) = connection_sentences([result, replace(result, steps=open_steps)])
    assert "yes on 1, no on 1 of 2 surfaces at 4 MPa" in sentence.replace(
        "no on 1, yes on 1", "yes on 1, no on 1"
    )


def test_columns_of_a_large_grid_are_measured_where_a_case_asks_for_them(
    ran, write_case, tmp_path, monkeypatch
):
    """On a grid that counts as large, no column is measured and a sentence names them;
    the key `columns`, or conductivities, measure those that a case asks for.

    Their values are those of the same case on a grid that counts as small.
    """
    seeds = ("[3, 5, 7]", "[3, 5]")
    monkeypatch.setattr(measure, "_LARGEST_GRID", 0)
    none = load_case(write_case(BEM, AREA, PATH, seeds))
    results = run_cases([none], Run(tmp_path / "none", jobs=1))["small"]["bem"].results
    assert not MEASURED & load_rows(results)[0].keys()
    asked = {"gap_percolation", "stiffness_unloading"}
    change = ("[case]\n", f"[case]\ncolumns = {json.dumps(sorted(asked))}\n")
    some = load_case(write_case(BEM, AREA, PATH, seeds, change))
    results = run_cases([some], Run(tmp_path / "some", jobs=1))["small"]["bem"].results
    rows = load_rows(results)
    for row, expected in zip(rows, ran[2]["loads"], strict=True):
        assert MEASURED & row.keys() == asked
        for column in asked:
            assert row[column]["mean"] == expected[column]["mean"]
    left_out = "stiffness_loading, conductance, contact_percolation"
    sentence = measure.left_out_sentence(some)
    assert f"{left_out}; columns = [" in sentence
    conducts = ("hardness = 6.0e9", "hardness = 6.0e9\n" + CONDUCTING)
    conducting = load_case(write_case(BEM, AREA, conducts))
    assert "conductance" not in measure.left_out_sentence(conducting)
    monkeypatch.undo()
    assert measure.left_out_sentence(none) == ""
    assert measure.columns_left_out(none, 2**20 + 1) == [*MEASURED_COLUMNS]


LONG_PATH = (
    PATH[0],
    "mean_pressure = [2.0e8, 5.0e8, 5.1e8, 1.0e8, 3.0e8, 6.0e8, 2.0e8]",
)


def stop_at_once(*_):
    """Raise TimeUp, as the alarm of a time limit does."""
    raise run.TimeUp("stopped")


@pytest.mark.parametrize("stopped_after", [1, 3, 4, 6])
def test_a_path_goes_on_from_the_loads_that_are_done(
    stopped_after, write_case, tmp_path, monkeypatch
):
    """A run that its time limit stops after some loads says how many are kept; the next
    run solves the others alone, and ends with the values and the files of a run that
    was not stopped.

    The loads that are done are not used by a run that measures something else. A run
    in which no load ends says that the limit is too short. `stopped_after` is the
    number of loads before the first stop.
    """
    case = load_case(write_case(BEM, AREA, LONG_PATH, ("[3, 5, 7]", "[3]")))
    settings = Run(tmp_path / "stopped", jobs=1, fields="steps", rows=True)
    expected = run_cases([case], replace(settings, output=tmp_path / "expected"))
    (expected,) = expected["small"]["bem"].results
    monkeypatch.setattr(load_path, "_SECONDS_BETWEEN_SAVES", 0)

    def stop(task, result):
        """Save the loads of a task, and raise TimeUp after those of the test."""
        saved.save_loads(task, result)
        if len(result.steps) == stopped_after:
            raise run.TimeUp("stopped")

    with monkeypatch.context() as stopping:
        stopping.setattr(load_path, "save_loads", stop)
        (error,) = run_cases([case], settings)["small"]["bem"].errors
    assert f"stopped; {stopped_after} of 7 loads are done and kept" in error
    assert f"goes on with load {stopped_after + 1}, also with a larger" in error
    with monkeypatch.context() as stopping:
        stopping.setattr(load_path, "measure_load", stop_at_once)
        (error,) = run_cases([case], settings)["small"]["bem"].errors
    assert f"load {stopped_after + 1} alone takes longer: raise time_limit" in error
    solved = []
    solve = bem.solve

    def spy(scene, **options):
        """Note the load path of a scene, and solve it."""
        solved.append(scene.load.path)
        return solve(scene, **options)

    (task,) = tasks_of(case, settings)
    assert saved.load_done(task) is not None
    assert saved.load_done(replace(task, lists_loads=False)) is None
    with monkeypatch.context() as spying:
        spying.setattr(bem, "solve", spy)
        (found,) = run_cases([case], settings)["small"]["bem"].results
    assert solved == [case.load.path[stopped_after:]]
    assert not task.loads_file.exists()
    for step, expected_step in zip(found.steps, expected.steps, strict=True):
        # Rims and patches change by a point within the tolerance of the solver.
        assert step.row == pytest.approx(expected_step.row, rel=1e-4)
        assert step.areas["raw"] == expected_step.areas["raw"]
    assert found.cost.keys() == expected.cost.keys()
    assert found.cost["fft_pairs"] == pytest.approx(expected.cost["fft_pairs"], rel=0.2)
    names = [
        {path.name for path in (tmp_path / folder).rglob("*")}
        for folder in ("stopped", "expected")
    ]
    assert names[0] == names[1]
    task.loads_file.write_bytes(b"damaged")
    assert saved.load_done(task) is None
    run_cases([case], replace(settings, fresh=True))
    assert not task.loads_file.exists()


def test_an_unexpected_error_of_a_task_names_its_place(
    write_case, tmp_path, monkeypatch
):
    """An error that is none of the package ends its task with a sentence that has the
    file and the function in which it was raised.
    """

    def divide_by_zero(*_):
        """Raise ZeroDivisionError, as a mistake in a method might."""
        return 1.0 / 0.0

    monkeypatch.setattr(run, "solve_path", divide_by_zero)
    (task, *_) = tasks_of(load_case(write_case(BEM, AREA)), Run(tmp_path, jobs=1))
    sentence = run.solve_task(task, threads=1)
    assert sentence.startswith("ZeroDivisionError: float division by zero (test_loads")
    assert sentence.endswith("in divide_by_zero: return 1.0 / 0.0)")


def test_units_are_those_of_the_quantities():
    """A column of the loads has the unit of the quantity of the same name."""
    for name, unit in COLUMNS.items():
        quantity = QUANTITIES.get(f"quantity.{name}")
        if quantity is not None:
            assert quantity.unit.replace("–", "") == unit, name


def test_a_mean_gap_has_an_error_of_the_grid_that_covers_the_closed_form():
    """The grid error of the mean gap of a wave covers its closed form and is below 5 %.

    On 128 points it is smaller than on 32 at any load.
    """
    claims = []
    for points, load in itertools.product((32, 128), (0.1, 0.4, 0.8)):
        wave = 0.01 * np.cos(2 * np.pi * np.arange(points) / points)
        scene = Scene(
            Surface(wave, (1.0,)), Material(1.0, 0.0), Load(load * 0.01 * np.pi)
        )
        step = bem.solve(scene).final
        off = abs(step.row["mean_gap"] - 0.01 * line_mean_gap(load))
        claims.append(step.quantities["mean_gap_error_by_grid"])
        assert 0 < off < claims[-1] < 0.05 * step.row["mean_gap"]
    assert max(claims[3:]) < min(claims[:3])


def test_finite_elements_have_all_figures_of_every_load(write_case, tmp_path):
    """Each load of the finite elements has the stiffness, conductance and percolation
    of the path that ends there.

    Of a J2 body, a load on unloading has a `flowed_area`, the others a `plastic_area`.
    """
    edits = (
        ("[theory]\nenergy_reduction = 0.536", '[fem]\nlaw = "capped"\nlayers = 6'),
        ("5.026548245743669e4", "1.8e4"),
        ('of = "bem"', 'of = "fem"'),
        AREA,
        PATH,
    )
    case = load_case(
        write_case(('["persson", "bem"]', '["fem"]'), *edits, ("[3, 5, 7]", "[3]"))
    )
    runs = run_cases([case], Run(tmp_path, jobs=1, rows=True))
    (result,) = runs["small"]["fem"].results
    scene = case.scene(case.recipes[0])
    for number, step in enumerate(result.steps):
        shorter = replace(scene, load=Load(scene.load.path[: number + 1]))
        until_here = fem_check.solve(shorter, **case.options["fem"])
        stiffness = interface_stiffness(shorter, until_here, "unloading").corrected
        assert step.row["stiffness_unloading"] == pytest.approx(stiffness, rel=1e-6)
        names = {"conductance", "contact_percolation", "gap_percolation"}
        assert names <= step.row.keys()
    flowed = result.steps[1].areas["raw"].plastic
    shares = [step.row.get("flowed_share") for step in result.steps]
    assert shares == [None, None, flowed, flowed]
    metal = replace(scene.material, hardness=np.inf, yield_stress=2e9)
    eased = replace(scene, material=metal, load=Load((5e8, 2e8, 5e8)))
    rows = load_rows([fem_check.solve(eased, law="j2", layers=6, certified=False)])
    assert ["flowed_area" in row for row in rows] == [False, True, False]
    assert ["plastic_area" in row for row in rows] == [True, False, True]


@pytest.mark.parametrize(
    ("name", "points"),  # values, errors that reach beyond 0 and 1, and what is drawn
    [
        ("total_area", [(0.9, 0.2, 0.7, 1), (0.1, 0.3, 0, 0.4)]),
        ("mean_gap", [(3e-6, 4e-6, 0.0, 7e-6), (4e-6, 1e-6, 3e-6, 5e-6)]),
        ("contact_percolation", [(0.2, None, 0.2, 0.2)]),
    ],
)
def test_a_chart_of_loads_has_values_and_bounds(name, points):
    """A chart of loads has a value and its bounds, which stay within 0 and 1 for areas
    and above 0 for gaps.

    `name` is the column, and `points` are tuples of value, error, lower and upper
    bound.
    """
    rows = [
        {
            "branch": "reloading",
            "mean_pressure": {"mean": 2e3 * k, "error": None},
            name: {"mean": mean, "error": error},
        }
        for k, (mean, error, *_) in enumerate(points, 1)
    ]
    (chart,) = load_charts({"bem": rows}).values()
    series = f"bem, {name.replace('_', ' ')}, reloading"
    assert [*map(list, chart.rows)] == [
        [series, *map(pytest.approx, (2e3 * k, mean, low, high))]
        for k, (mean, _, low, high) in enumerate(points, 1)
    ]
    assert {line.get_fillstyle() for line in chart.figure.axes[0].lines} == {"left"}


def test_no_load_makes_no_chart():
    """Without loads there are no charts."""
    assert load_charts({}) == {}


def test_a_load_without_a_value_has_a_dash_in_its_cell():
    """A table of loads shows value ± error, and a dash where a load has no value."""
    first = {"branch": "loading", "mean_gap": {"mean": 2e-6, "error": 1e-8}}
    second = {"branch": "unloading"}
    heading = ["branch", "mean gap (µm)", "error of the total area by"]
    assert load_cells([first, second]) == [
        heading,
        ["loading", "2 ± 0.01", ""],
        ["unloading", "–", ""],
    ]


def test_python_draws_what_a_run_draws(ran, tmp_path):
    """`epcontact.plot` draws the charts of a run, with the same names and numbers."""
    case, folder, _ = ran
    scene = case.scene(case.recipes[0])
    charts = epcontact.plot(
        scene, *(bem.solve(case.scene(recipe)) for recipe in case.recipes)
    )
    drawn = {path.stem for path in folder.glob("*.csv") if "-step-" not in path.stem}
    # Only a run computes these.
    drawn -= {"loads-stiffness", "loads-conductance", "loads-percolation"}
    drawn -= {"contact-bem-peak"}
    assert drawn == charts.keys() > {"power-spectrum", "loads-areas", "contact-bem"}
    for name, chart in charts.items():
        of_run = pd.read_csv(folder / f"{name}.csv")
        of_python = pd.read_csv(io.StringIO(chart.csv()))
        pd.testing.assert_frame_equal(of_run, of_python, rtol=1e-5, atol=1e-9)


def test_results_and_scenes_compare_by_what_they_hold(write_case):
    """Equal scenes and results are equal and have one hash, also after pickling.

    Others, and a result read from JSON, which has no fields, differ.
    """
    case = load_case(write_case(BEM, AREA))
    scene, other = (case.scene(recipe) for recipe in case.recipes[:2])
    first, second = bem.solve(scene), bem.solve(scene)
    for one, same in ((scene, pickle.loads(pickle.dumps(scene))), (first, second)):
        assert one == same
        assert hash(one) == hash(same)
    assert first == pickle.loads(pickle.dumps(first))
    assert len({scene, other, first, second, bem.solve(other)}) == 4
    assert first != ContactResult.from_json(first.to_json())  # which has no fields
    assert first.distribution == second.distribution != bem.solve(other).distribution
    assert scene != first


#: Replaces the hardness of SMALL_CASE by that of the map, and its loads in Pa.
EFFECTIVE = ("hardness = 6.0e9", 'hardness = "effective"\nyield_stress = 2.0e9')
LOADS = (2e8, 5e8, 1e8, 6e8)


@pytest.fixture
def metal(write_case, tmp_path):
    """Return a case along the path LOADS with an effective hardness, its result, and a
    function.

    The function returns the effective hardness for the keyword `mean_pressure` in Pa.
    """
    path = ("mean_pressure = 5.0e8", f"mean_pressure = {[*LOADS]}")
    case = load_case(write_case(BEM, AREA, path, EFFECTIVE, ("[3, 5, 7]", "[3]")))
    (answer,) = run_cases([case], Run(tmp_path, jobs=1))["small"]["bem"].results
    given = {
        "yield_stress": 2e9,
        "young_modulus": 100e9,
        "poisson_ratio": 0.3,
        "rms_slope": 0.1,
    }
    return case, answer, functools.partial(effective_hardness, **given, breadth=4)


def half_difference(first, second):
    """Return half the distance of two numbers."""
    return abs(first - second) / 2


def solve_with_hardness(case, hardness, loads):
    """Return the scene of a case with another hardness and loads (both in Pa), and its
    solution by boundary elements.
    """
    scene = case.scene(case.recipes[0])
    material = replace(scene.material, hardness=hardness)
    changed = replace(scene, material=material, load=Load(loads))
    return changed, bem.solve(changed)


def test_every_load_has_its_own_hardness_and_what_its_interval_is_worth(metal):
    """A load beyond all before has the hardness and the areas of a fresh surface, and a
    load below keeps the hardness of the peak.

    Errors by the hardness are half the difference of the solutions at both bounds of
    its interval.
    """
    case, answer, hardness_at = metal
    paths = [(2e8,), (5e8,), (5e8, 1e8), (6e8,)]
    for step, path in zip(answer.steps, paths, strict=True):
        row = step.row
        mapped = hardness_at(mean_pressure=path[0])
        assert row["hardness"] == mapped.value
        assert row["hardness_error"] == pytest.approx(mapped.value * mapped.error)
        _, expected = solve_with_hardness(case, mapped.value, path)
        for kind in ("raw", "corrected", "error"):
            areas = vars(expected.final.areas[kind])
            assert vars(step.areas[kind]) == pytest.approx(areas, abs=1e-6)
        # The memory is the largest of the three solves, not their sum.
        peak = expected.cost["peak_memory_bytes"]
        assert answer.cost["peak_memory_bytes"] < 2 * peak
        bounds = [solve_with_hardness(case, bound, path) for bound in mapped.interval]
        totals = [result.final.areas["corrected"].total for _, result in bounds]
        error = half_difference(*totals)
        assert step.areas["hardness_error"].total == pytest.approx(error, rel=5e-3)
        assert row["total_area_error_by_hardness"] == step.areas["hardness_error"].total
        parts = (row["total_area_error_by_grid"], row["total_area_error_by_hardness"])
        assert row["total_area_error"] == pytest.approx(np.hypot(*parts))
        limits = [interface_stiffness(*pair, "unloading") for pair in bounds]
        error = half_difference(*(limit.corrected for limit in limits))
        found = row["stiffness_unloading_error_by_hardness"]
        assert found == pytest.approx(error, rel=2e-2)
        assert row["stiffness_unloading_error"] > found > 0
        ratio = row["conductance"] / row["stiffness_unloading"]
        assert row["conductance_error_by_hardness"] == pytest.approx(ratio * found)
    for line, load in zip(
        case.told_hardness.splitlines(), (2e8, 5e8, 6e8), strict=False
    ):
        value = hardness_at(mean_pressure=load).value
        assert line.startswith(f"at {load:.4g} Pa: hardness = {value:.3g} Pa, 95 %")
    assert answer.steps[2].row["hardness"] > answer.steps[0].row["hardness"]


def test_conductances_are_those_of_both_bodies_conductivities(write_case, tmp_path):
    """The thermal conductance and its errors are the conductance over the sum of the
    bodies' resistivities, 1/16 and 1/50 m K/W.
    """
    conducts = (
        "yield_stress = 2.0e9",
        "yield_stress = 2.0e9\nthermal_conductivities = [16.0, 50.0]",
    )
    case = load_case(write_case(BEM, AREA, EFFECTIVE, conducts, ("[3, 5, 7]", "[3]")))
    (answer,) = run_cases([case], Run(tmp_path, jobs=1))["small"]["bem"].results
    row = answer.final.row
    scale = 1 / (1 / 16 + 1 / 50)
    for end in ("", "_error", "_error_by_grid", "_error_by_hardness"):
        expected = scale * row[f"conductance{end}"]
        assert row[f"thermal_conductance{end}"] == pytest.approx(expected)
    assert "thermal_conductance_W_per_m2_K" in answer.table()
    assert "electrical_conductance" not in row


def test_a_gate_against_a_number_counts_the_interval_of_the_hardness(metal):
    """The grid error of a gate against a number includes the error by the hardness.  An
    error estimate of the grid covers nine of ten errors, and 1.19 times it 95 %.

    Between two methods with one hardness it does not.
    """
    case, answer, _ = metal
    judged = judge_case(case, {"bem": MethodResults((answer,), ("seed3",))}).gates[0]
    areas = answer.final.areas
    claim = np.hypot(1.19 * areas["error"].total, areas["hardness_error"].total) / 0.1
    assert judged.grid_error == pytest.approx(claim)
    mine = MethodResults((answer,), ("seed3",))
    other = MethodResults((replace(answer, method="other"),), ("seed3",))
    shared = replace(case.gates[0], against="persson")
    against = case.changed(gates=(shared,), methods=("bem", "persson"))
    judged = judge_case(against, {"bem": mine, "persson": other}).gates[0]
    # Two results with one hardness share its error, which does not count.
    claim = 1.19 * areas["error"].total / areas["corrected"].total
    assert judged.grid_error == pytest.approx(claim)


@pytest.mark.parametrize("quantity", ["mean_gap", "conductance", "hardness"])
def test_a_gate_counts_the_error_that_the_table_of_loads_states(metal, quantity):
    """A gate's interval holds the errors of a mean gap, a conductance and a hardness by
    each source: by the grid (covers nine of ten, times 1.19) and by the hardness.
    """
    case, result, _ = metal
    gate = replace(
        case.gates[0], quantity=f"quantity.{quantity}", norm="absolute", against=0.0
    )
    judged = judge_case(
        case.changed(gates=(gate,)), {"bem": MethodResults((result,), ("seed3",))}
    ).gates[0]
    values = result.final.quantities
    by_grid = {
        "mean_gap": values["mean_gap_error_by_grid"],
        "conductance": values["conductance.error"],
        "hardness": 0.0,
    }
    by_hardness = {
        "mean_gap": values["mean_gap_error_by_hardness"],
        "conductance": values["conductance_error_by_hardness"],
        "hardness": values["hardness_error_by_map"],
    }
    error = np.hypot(1.19 * by_grid[quantity], by_hardness[quantity])
    assert 0 < error == pytest.approx(judged.grid_error)
    assert error == pytest.approx(judged.value.error_95)
    assert error == pytest.approx(result.final.row[f"{quantity}_error"])
    # Another method on this grid has the same error of a gap by the grid, but states
    # none; the theory has no grid.
    for method, counted in (("fem", quantity != "mean_gap"), ("persson", True)):
        values = {name: v for name, v in values.items() if "_by_grid" not in name}
        values = {name: v for name, v in values.items() if ".error" not in name}
        step = replace(result.final, quantities=values)
        other = replace(result, method=method, steps=(step,))
        against = replace(gate, against=method)
        judged = judge_case(
            case.changed(gates=(against,), methods=("bem", method)),
            {
                "bem": MethodResults((result,), ("seed3",)),
                method: MethodResults((other,), ("seed3",)),
            },
        ).gates[0]
        expected = 1.19 * by_grid[quantity] if counted else 0.0
        assert (judged.grid_error or 0.0) == pytest.approx(expected)
