"""Every load of a path is a row of its own: figures, errors and units, computed a
second time.
"""

import io
import itertools
import json
import pickle
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from command_line import invoke
from conftest import SMALL_CASE

import epcontact
import fem_check
from epcontact import bem, effective_hardness
from epcontact.harness.case_files.case import load_case
from epcontact.harness.quantities.registry import QUANTITIES
from epcontact.harness.solving.method_results import MethodResults, load_rows
from epcontact.harness.solving.run import run_cases
from epcontact.harness.solving.tasks import Run
from epcontact.harness.verdict.judgement import judge_case
from epcontact.interface import find_patches, interface_stiffness, percolation_fraction
from epcontact.output.loads import load_cells
from epcontact.pictures.loads import load_charts
from epcontact.reference.waves import line_mean_gap
from epcontact.results import COLUMNS, ContactResult
from epcontact.scene import Load, Material, Scene, Surface

PATH = ("mean_pressure = 5.0e8", "mean_pressure = [2.0e8, 5.0e8, 1.0e8, 3.0e8]")
BEM = ('["persson", "bem"]', '["bem"]')
AREA = (
    'against = "persson"\ntolerance = 0.5',
    'against = 0.1\nsource = "none"\ntolerance = 5.0',
)


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """A case of two surfaces along a path, run from the command line, and its JSON
    file.
    """
    home, text = tmp_path_factory.mktemp("loads"), SMALL_CASE
    for old, new in (BEM, AREA, PATH, ("[3, 5, 7]", "[3, 5]")):
        text = text.replace(old, new)
    path = home / "small.toml"
    path.write_text(text)
    done = invoke(
        "run", path, "--output", home, "--jobs", 1, "--fields", "steps", "--charts"
    )
    assert done.returncode == 0, done
    folder = home / "small" / "fast"
    return (
        load_case(path),
        done.stdout,
        folder,
        json.loads((folder / "bem.json").read_text()),
    )


def alone(case, number, recipe):
    """The answer to a path that ends at the load of a number."""
    scene = case.scene(recipe)
    there = Scene(
        scene.surface, scene.material, Load(scene.load.path[: number + 1]), scene.body
    )
    return there, bem.solve(there)


def test_every_load_has_its_own_figures_and_fields(ran):
    case, _, folder, data = ran
    branches = ["loading", "loading", "unloading", "reloading"]
    assert [row["branch"] for row in data["loads"]] == branches
    for number, (load, row) in enumerate(
        zip(case.load.path, data["loads"], strict=True)
    ):
        answers = [alone(case, number, recipe) for recipe in case.recipes]
        ways = ("loading", "unloading")
        stiff = [
            [interface_stiffness(*answer, way) for answer in answers] for way in ways
        ]
        found = {"mean_pressure": [load, load], "hardness": [6e9, 6e9]}
        found["mean_gap"] = [a.final.quantities["mean_gap"] for _, a in answers]
        for part in ("total", "plastic"):
            found[f"{part}_area"] = [
                vars(a.final.areas["corrected"])[part] for _, a in answers
            ]
        for way, each in zip(ways, stiff, strict=True):
            found[f"stiffness_{way}"] = [x.corrected for x in each]
        for name, values in found.items():
            assert row[name]["mean"] == pytest.approx(np.mean(values), rel=1e-6), (
                number,
                name,
            )
            scatter = 12.706204736 * np.std(
                values
            )  # of two surfaces: Student's t over sqrt(2)
            told = row[name]["parts"].get("scatter", 0)
            assert told == pytest.approx(scatter, rel=1e-4, abs=1e-9)
        sure = np.mean([x.error for x in stiff[0]])
        assert row["stiffness_loading"]["parts"]["grid"] == pytest.approx(
            sure, rel=1e-4
        )
        grid = np.mean([a.final.areas["error"].total for _, a in answers])
        parts = row["total_area"]["parts"]
        assert parts.keys() == {"grid", "scatter"}
        assert parts["grid"] == pytest.approx(grid, rel=1e-4)
        error = np.hypot(grid, parts["scatter"])
        assert row["total_area"]["error"] == pytest.approx(error, rel=1e-4)
    # A share that percolates: so many of the closest points, and not one less, join
    # across.
    scene, answer = alone(case, 1, case.recipes[0])
    p, gap = answer.fields["pressure"], answer.fields["gap"]
    loose = answer.fields["state"] != 1
    closest = p / p.max() - np.where(loose, gap / np.ptp(scene.surface.heights), 0.0)
    share = data["members"][0]["steps"][1]["quantities"]["contact_percolation"]
    limit = percolation_fraction(closest)
    assert share == limit.corrected
    rank = np.argsort(np.argsort(-closest, axis=None)).reshape(closest.shape)
    assert [
        find_patches(rank < limit.raw * rank.size - less).spans for less in (0, 1)
    ] == [
        True,
        False,
    ]
    assert len(list(folder.glob("contact-bem-step-*.png"))) == 4


def test_units_are_those_of_the_quantities():
    for name, unit in COLUMNS.items():
        if (known := QUANTITIES.get(f"quantity.{name}")) is not None:
            assert (known.unit == "–" and unit == "") or known.unit == unit, name


def test_a_mean_gap_has_an_error_of_the_grid_that_covers_the_closed_form():
    claims = []
    for points, load in itertools.product((32, 128), (0.1, 0.4, 0.8)):
        wave = 0.01 * np.cos(2 * np.pi * np.arange(points) / points)
        scene = Scene(
            Surface(wave, (1.0,)), Material(1.0, 0.0), Load(load * 0.01 * np.pi)
        )
        step = bem.solve(scene).final
        off = abs(step.row["mean_gap"] - 0.01 * line_mean_gap(load))
        claims.append(step.row["mean_gap_error_by_grid"])
        assert 0 < off < claims[-1] < 0.05 * step.row["mean_gap"]
    assert max(claims[3:]) < min(claims[:3])


def test_finite_elements_have_all_figures_of_every_load(write_case, tmp_path):
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
    (answer,) = run_cases([case], Run(tmp_path, jobs=1, rows=True))["small"][
        "fem"
    ].results
    scene = case.scene(case.recipes[0])
    for number, step in enumerate(answer.steps):
        there = replace(scene, load=Load(scene.load.path[: number + 1]))
        alone = fem_check.solve(there, **case.options["fem"])
        stiffness = interface_stiffness(there, alone, "unloading").corrected
        assert step.row["stiffness_unloading"] == pytest.approx(stiffness, rel=1e-6)
        assert {
            "conductance",
            "contact_percolation",
            "gap_percolation",
        } <= step.row.keys()
    metal = replace(
        scene.material, hardness=np.inf, yield_stress=2e9
    )  # what has flowed, then
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
    assert load_charts({}) == {}


def test_a_load_without_a_value_has_a_dash_in_its_cell():
    first = {"branch": "loading", "mean_gap": {"mean": 2e-6, "error": 1e-8}}
    second = {"branch": "unloading"}
    heading = ["branch", "mean gap (µm)", "error of the total area by"]
    assert load_cells([first, second]) == [
        heading,
        ["loading", "2 ± 0.01", ""],
        ["unloading", "–", ""],
    ]


def test_python_draws_what_a_run_draws(ran, tmp_path):
    case, _, folder, _ = ran
    scene = case.scene(case.recipes[0])
    charts = epcontact.plot(
        scene, *(bem.solve(case.scene(recipe)) for recipe in case.recipes)
    )
    drawn = {path.stem for path in folder.glob("*.csv") if "-step-" not in path.stem}
    drawn -= {
        f"loads-{name}" for name in ("stiffness", "conductance", "percolation")
    }  # of a run
    assert drawn == charts.keys() > {"power-spectrum", "loads-areas", "contact-bem"}
    for name, chart in charts.items():
        table, same = (
            pd.read_csv(f) for f in (folder / f"{name}.csv", io.StringIO(chart.csv()))
        )
        assert table.shape == same.shape, name
        pd.testing.assert_frame_equal(table, same, rtol=1e-5, atol=1e-9)


def test_results_and_scenes_compare_by_what_they_hold(write_case):
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


EFFECTIVE = ("hardness = 6.0e9", 'hardness = "effective"\nyield_stress = 2.0e9')
LOADS = (2e8, 5e8, 1e8, 6e8)


@pytest.fixture
def metal(write_case, tmp_path):
    """A metal along a path, its answer, and the effective hardness at each mean
    pressure.
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
    return (
        case,
        answer,
        lambda p: effective_hardness(**given, mean_pressure=p, breadth=4),
    )


def solved(case, hardness, *loads):
    scene = case.scene(case.recipes[0])
    there = replace(
        scene, material=replace(scene.material, hardness=hardness), load=Load(loads)
    )
    return there, bem.solve(there)


def with_cap(*given):
    return solved(*given)[1].final


def test_every_load_has_its_own_hardness_and_what_its_interval_is_worth(metal):
    """A load beyond all before it is that of a fresh surface; one below keeps the
    peak's cap.
    """
    case, answer, known = metal
    paths = [(2e8,), (5e8,), (5e8, 1e8), (6e8,)]
    one = solved(case, known(2e8).value, 2e8)[1].cost
    assert (
        answer.cost["peak_memory_bytes"] < 2 * one["peak_memory_bytes"]
    )  # the largest of three
    for step, path in zip(answer.steps, paths, strict=True):
        mapped = known(path[0])
        assert step.row["hardness"] == mapped.value
        assert step.row["hardness_error"] == pytest.approx(mapped.value * mapped.error)
        alone = with_cap(case, mapped.value, *path)
        for kind in ("raw", "corrected", "error"):
            assert vars(step.areas[kind]) == pytest.approx(
                vars(alone.areas[kind]), abs=1e-6
            )
        soft, hard = (
            with_cap(case, end, *path).areas["corrected"] for end in mapped.interval
        )
        error = abs(soft.total - hard.total) / 2
        assert step.areas["hardness_error"].total == pytest.approx(error, rel=5e-3)
        parts = [
            step.row[f"total_area_error_by_{source}"] for source in ("grid", "hardness")
        ]
        assert parts[1] == step.areas["hardness_error"].total
        assert step.row["total_area_error"] == pytest.approx(np.hypot(*parts))
        ends = (
            interface_stiffness(*solved(case, end, *path), "unloading")
            for end in mapped.interval
        )
        error = abs(next(ends).corrected - next(ends).corrected) / 2
        found = step.row["stiffness_unloading_error_by_hardness"]
        assert found == pytest.approx(error, rel=2e-2)
        assert step.row["stiffness_unloading_error"] > found > 0
        ratio = step.row["conductance"] / step.row["stiffness_unloading"]
        assert step.row["conductance_error_by_hardness"] == pytest.approx(ratio * found)
    told = [line.partition(" 95 %")[0] for line in case.told_hardness.splitlines()]
    each = [
        f"at {p:.4g} Pa: hardness = {known(p).value:.3g} Pa," for p in (2e8, 5e8, 6e8)
    ]
    assert told[:-1] == each
    assert answer.steps[2].row["hardness"] > answer.steps[0].row["hardness"]


def test_conductances_are_those_of_both_bodies_conductivities(write_case, tmp_path):
    conducts = (
        "yield_stress = 2.0e9",
        "yield_stress = 2.0e9\nthermal_conductivities = [16.0, 50.0]",
    )
    case = load_case(write_case(BEM, AREA, EFFECTIVE, conducts, ("[3, 5, 7]", "[3]")))
    (answer,) = run_cases([case], Run(tmp_path, jobs=1))["small"]["bem"].results
    row, scale = answer.final.row, 1 / (1 / 16 + 1 / 50)
    for end in ("", "_error", "_error_by_grid", "_error_by_hardness"):
        assert row[f"thermal_conductance{end}"] == pytest.approx(
            scale * row[f"conductance{end}"]
        )
    assert "thermal_conductance_W_per_m2_K" in answer.table()
    assert "electrical_conductance" not in row


def test_a_gate_against_a_number_counts_the_interval_of_the_hardness(metal):
    case, answer, _ = metal
    judged = judge_case(case, {"bem": MethodResults((answer,), ("seed3",))}).gates[0]
    areas = answer.final.areas
    claim = np.hypot(areas["error"].total, areas["hardness_error"].total) / 0.1
    assert judged.grid_error == pytest.approx(claim)
    mine, other = (
        MethodResults((replace(answer, method=m),), ("seed3",))
        for m in ("bem", "other")
    )
    shared = replace(case.gates[0], against="persson")
    against = case.changed(gates=(shared,), methods=("bem", "persson"))
    both = judge_case(against, {"bem": mine, "persson": other}).gates[0]
    assert both.grid_error == pytest.approx(
        areas["error"].total / areas["corrected"].total
    )
    # Two answers under one cap share its error.
