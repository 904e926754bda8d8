"""The map of the effective hardness: its formula, its refusals, its users, and how it
is made.
"""

import math
import re
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import invoke
from laboratory import breadth
from laboratory.hardness_map import (
    CAUTION,
    LADDER,
    inverse_hardness,
    make_map,
    mapped,
    measured_areas,
)
from scipy.interpolate import RegularGridInterpolator

from epcontact import effective_hardness
from epcontact.crosscheck.report import measured_hardness
from epcontact.errors import InvalidCase, InvalidScene
from epcontact.harness.case_files.case import load_case
from epcontact.harness.solving.run import solve_task
from epcontact.harness.solving.tasks import Run, tasks_of
from epcontact.harness.sweep import read_sweep
from epcontact.materials import hardness_map
from epcontact.scene import Load

CASES = Path(__file__).parent.parent / "cases"
USUAL = {
    "yield_stress": 1e9,
    "young_modulus": 210e9,
    "poisson_ratio": 0.3,
    "rms_slope": 0.1,
    "mean_pressure": 0.25e9,
}
#: The coordinates of the usual body, as arguments of `fitted_ratio`.
SEVERITY = 210 / 0.91 * 0.1
PLACE = np.array([[SEVERITY], [0.3], [0.25]])


def hardness(**changes):
    """Return the effective hardness of the usual body with some changes."""
    return effective_hardness(**{**USUAL, **changes})


# --- the map and its formula ----------------------------------------------------------


@pytest.fixture(scope="module")
def columns():
    """The columns of the map, without its nearly full places."""
    table = pd.DataFrame(dict(hardness_map.hardness_map()))
    return table[table["area"] <= hardness_map.LARGEST_AREA]


def test_the_map_is_that_of_the_release():
    assert hardness_map.map_digest() == "515071162a27"


def test_the_map_is_a_grid():
    table = pd.DataFrame(dict(hardness_map.hardness_map()))
    coordinates = table[list(hardness_map.COORDINATES)]
    assert len(coordinates.drop_duplicates()) == math.prod(coordinates.nunique())


def test_the_formula_fits_the_map_within_scatter_and_misfit(columns):
    coordinates = (columns[name].to_numpy() for name in hardness_map.COORDINATES)
    ratio = hardness_map.fitted_ratio(*coordinates)
    residual = np.abs(ratio * columns["inverse_hardness"] - 1)
    _, misfit = hardness_map.fitted_formula()
    within = residual < np.hypot(columns["scatter"], misfit)
    assert within.mean() > 0.9  # both are errors at 95 %
    assert residual.max() < 0.08


def test_the_errors_of_the_map_are_those_it_was_made_for(columns):
    assert columns["statistical_error"].max() <= 0.02
    assert 0.02 < columns["grid_error"].max() < 0.04


def test_no_cap_is_lower_than_the_mean_pressure_in_contact(columns):
    contact_pressure = columns["load"] / columns["area"]
    assert (contact_pressure < 1.02 / columns["inverse_hardness"]).all()


@pytest.mark.parametrize(
    "changes", [{}, {"rms_slope": 0.07, "poisson_ratio": 0.1}, {"mean_pressure": 0.4e9}]
)
def test_the_area_is_interpolated_linearly_in_ln_s_nu_and_m(changes):
    table = pd.DataFrame(dict(hardness_map.hardness_map()))
    area = table.set_index(list(hardness_map.COORDINATES))["area"].sort_index()
    severity, poisson_ratio, load = (level.to_numpy() for level in area.index.levels)
    grid = area.to_numpy().reshape(severity.size, poisson_ratio.size, load.size)
    axes = (np.log(severity), poisson_ratio, load)
    found = hardness(**changes)
    place = (math.log(found.severity), found.poisson_ratio, found.load)
    expected = RegularGridInterpolator(axes, grid)(place).item()
    assert found.area == pytest.approx(expected, rel=1e-12)


def test_only_ratios_matter():
    found = hardness(yield_stress=1e3, mean_pressure=0.25e3, young_modulus=210e3)
    assert found.value == pytest.approx(1e-6 * hardness().value)


def test_the_interval_holds_the_value_by_its_error():
    found = hardness()
    expected = {*hardness_map.ERROR_COLUMNS, "formula_error", "breadth_error"}
    assert found.errors.keys() == expected
    assert found.error == pytest.approx(math.hypot(*found.errors.values()))
    low, high = found.interval
    assert low == pytest.approx(found.value / (1 + found.error), rel=1e-12)
    assert high == pytest.approx(found.value / (1 - found.error), rel=1e-12)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("rms_slope", (0.05, 0.1, 0.4)),
        ("mean_pressure", (0.1e9, 0.25e9, 1e9)),
        ("poisson_ratio", (0.0, 0.3)),
    ],
)
def test_the_hardness_rises_with_severity_load_and_poisson_s_ratio(name, values):
    ratios = [hardness(**{name: value}).ratio for value in values]
    assert ratios == sorted(ratios)
    assert ratios[0] < ratios[-1] < 3.25


# --- breadth and light loads ----------------------------------------------------------


def test_the_breadth_is_judged_by_ensembles_that_taught_nothing():
    """By the error of the breadth alone, a third of the scatter of all spectra."""
    table = breadth.judged(pd.read_csv(breadth.FILE))
    untaught = table[~table["taught"]]
    for _, ensembles in untaught.groupby("nodes"):
        assert ensembles["within"].mean() >= 0.83
    assert untaught["within"].mean() >= 0.95
    assert (table["claimed"] < 0.051).all()
    assert table[table["first_seed"] == 501]["within"].all()  # of severity 50 and 100


@pytest.mark.parametrize(
    ("given", "low_breadth", "high_breadth"),
    [(2, 2, 2), (4, 4, 4), (32, 32, 32), (300, 300, 300), (None, 2, 300)],
)
def test_a_breadth_changes_the_hardness_by_its_trend(given, low_breadth, high_breadth):
    """A breadth that is not given lies anywhere from 2 to 300."""
    slope = hardness_map.BREADTH_TREND * SEVERITY / (8 + SEVERITY)
    low = slope * math.log(low_breadth / 4)
    high = slope * math.log(high_breadth / 4)
    trend = (low + high) / 2
    size = hardness_map.SIZE_EFFECT / 0.25
    error = math.hypot(
        hardness_map.CORRECTION_ERROR * (abs(trend) + size),
        slope * math.log(max(high_breadth / 32, 1)),  # untested
        hardness_map.SPECTRA_ERROR,
        (high - low) / 2,
    )
    found = hardness(breadth=given)
    assert found.errors["breadth_error"] == pytest.approx(error)
    expected = hardness_map.fitted_ratio(*PLACE).item() * (1 + trend + size)
    assert found.ratio == pytest.approx(expected)


def test_the_interval_of_an_unknown_breadth_holds_all_others():
    low, high = hardness().interval
    assert low < hardness(breadth=2).value < hardness(breadth=300).value < high


@pytest.mark.parametrize(
    ("severity", "falls"),
    [
        (15, (0.935, 0.858, 0.758)),
        (50, (0.947, 0.863, 0.755)),
        (30, (0.924, 0.867, 0.759)),  # of surfaces that taught nothing
    ],
)
def test_light_loads_have_an_interval_that_holds_what_j2_bodies_showed(severity, falls):
    """c/c(.1) of J2 bodies by `laboratory.light_loads`."""
    body = {"rms_slope": severity * 1e9 / (210e9 / 0.91), "breadth": 4}
    heavy = hardness(**body, mean_pressure=0.1e9)
    for load, fall in zip((0.03, 0.01, 0.003), falls, strict=True):
        found = hardness(**body, mean_pressure=load * 1e9)
        error = found.errors["light_error"]
        assert 0.99 * found.ratio * (1 - error) <= fall * heavy.ratio
        assert fall * heavy.ratio < found.ratio * (1 + error)
        assert found.ratio * (1 + error) == pytest.approx(heavy.ratio)
        assert heavy.error < found.error < 0.2
        assert found.area == pytest.approx(heavy.area * load / 0.1)


def test_the_lightest_load_of_the_map_is_met_without_a_jump():
    found = hardness(mean_pressure=0.0999999e9)
    assert found.ratio == pytest.approx(hardness(mean_pressure=0.1e9).ratio)


def test_a_light_load_on_steel():
    steel = hardness(yield_stress=0.6e9, mean_pressure=10e6, breadth=16)
    low, high = steel.interval
    assert 1.1e9 < low < steel.value < high < 2.0e9


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"rms_slope": 0.01},
            r"E\*ξ/σ_Y is 2.308, but the map .* from 3 to 100, and it is not",
        ),
        ({"poisson_ratio": 0.49}, "nu is 0.49, but the map"),
        ({"mean_pressure": 0.0029e9}, "σ_Y is 0.0029, but the map .* from 0.003 to 2"),
        ({"rms_slope": 0.014, "mean_pressure": 2e9}, "the load and not the material"),
        ({"breadth": 1.5}, r"breadth is 1\.5, but .* at least 2"),
        ({"yield_stress": math.inf}, "yield_stress is inf, but must be a positive"),
        ({"rms_slope": "steep"}, "rms_slope is 'steep', but must be a positive"),
        ({"poisson_ratio": None}, "poisson_ratio is None, but must be a number"),
    ],
)
def test_nothing_is_extrapolated(changes, message):
    with pytest.raises(InvalidScene, match=message):
        hardness(**changes)


# --- users ----------------------------------------------------------------------------


def test_the_command_prints_what_the_function_finds():
    words = [f"--{name.replace('_', '-')}={value}" for name, value in USUAL.items()]
    expected = hardness()
    assert invoke("hardness", *words).stdout == f"{expected}\n{expected.source}\n"


GIVEN = "hardness = 6.0e9"
EFFECTIVE = 'hardness = "effective"\nyield_stress = 2.0e9'


def hardness_of_small_case(**changes):
    """Return what the map says of the small case of `conftest`."""
    return hardness(yield_stress=2e9, young_modulus=100e9, mean_pressure=5e8, **changes)


def test_a_case_may_take_its_hardness_from_the_map(write_case, tmp_path):
    expected = hardness_of_small_case(breadth=4)
    case = load_case(write_case((GIVEN, EFFECTIVE)))
    assert case.material.hardness == expected.value
    theory, *_ = tasks_of(case, Run(tmp_path))
    source = solve_task(theory, 1).provenance.about["hardness_source"]["value"]
    assert f"map {hardness_map.map_digest()}" in source
    assert f"95 % interval {expected.interval[0]:.3g} to" in source


def test_a_case_may_have_no_hardness(write_case):
    case = load_case(write_case((GIVEN, "yield_stress = 2.0e9\nhardness = inf")))
    assert math.isinf(case.material.hardness)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            'hardness = "effective"',
            "yield_stress is inf, but must be a positive number in Pa",
        ),
        ('hardness = "efective"', "valid number or be 'effective'"),
        (
            "yield_stress = 2.0e9",
            "yield_stress and no hardness, at which persson flows",
        ),
        (
            f'{EFFECTIVE}\n\n[body]\nkind = "bonded_layer"\ndepth = 1e-4',
            r"for deep bodies, .* 0\.0001 m and the period 0\.001 m",
        ),
    ],
)
def test_a_case_that_has_no_hardness_is_refused(write_case, words, message):
    with pytest.raises(InvalidCase, match=message):
        load_case(write_case((GIVEN, words)))


def test_only_rough_surfaces_have_a_hardness_of_the_map(tmp_path):
    punch = (CASES / "punch-capped-light.toml").read_text(encoding="utf-8")
    path = tmp_path / "punch-capped-light.toml"
    path.write_text(punch.replace("hardness = 1.0e9", EFFECTIVE), encoding="utf-8")
    message = "rough surfaces only, those of kind self_affine"
    with pytest.raises(InvalidCase, match=message):
        load_case(path)


MAP_TABLE = """[surface]
kind = "file"
path = "map.npy"
unit = 1.0
pixel_size = 1e-6
treatment = "refuse"
optional = true

"""


@pytest.fixture
def case_of_map(write_case):
    """A case with a measured map, which does not tell the breadth of its spectrum."""
    spectrum = "energy_reduction = 0.536"
    path = write_case(
        (GIVEN, EFFECTIVE), (spectrum, f'{spectrum}\nspectrum = "surface"')
    )
    text = path.read_text(encoding="utf-8")
    start = text.index("[surface]")
    end = text.index("[material]")
    path.write_text(text[:start] + MAP_TABLE + text[end:], encoding="utf-8")
    return path


def test_a_measured_map_has_the_hardness_of_its_own_slope(case_of_map, tmp_path):
    assert "map.npy is not here" in load_case(case_of_map).skip
    amplitude = 0.1 * np.sqrt(2) * 32e-6 / (2 * np.pi)
    wave = amplitude * np.cos(2 * np.pi * np.arange(32) / 32)
    np.save(tmp_path / "map.npy", np.repeat(wave[:, None], 32, axis=1))
    expected = hardness_of_small_case()
    case = load_case(case_of_map)
    assert case.material.hardness == pytest.approx(expected.value, rel=1e-12)
    assert str(expected).partition(" (")[0] in case.hardness_source


def test_the_hardness_of_a_map_that_is_refused_is_refused(case_of_map, tmp_path):
    np.save(tmp_path / "map.npy", np.add.outer(np.arange(32.0), np.zeros(32)))
    with pytest.raises(InvalidCase, match=r"map\.npy: not periodic"):
        load_case(case_of_map)


# --- the laboratory of the map --------------------------------------------------------


def test_a_path_gives_the_hardness_that_a_single_load_gives():
    """One interpolates areas between the caps of the ladder, the other searches the
    cap.
    """
    task = read_sweep("hardness-map-30", "fast").tasks[0]
    scene = task.case.scene(task.recipe)
    result = task.method.solve(scene, task.case.options["fem"], 1)
    areas = measured_areas(task, result)
    body = areas[["severity", "nodes", "waves", "depth"]]
    assert body.drop_duplicates().to_numpy().tolist() == [[5.0, 12, 2, 1.0]]
    inverse, *_ = inverse_hardness(areas)
    lightest = 1 / inverse["inverse"].iloc[0]
    single = replace(scene, load=Load(scene.load.path[0]))
    assert lightest == pytest.approx(measured_hardness(single).ratio, rel=0.03)


#: A body of the map, and the changes of those that show its errors.
BODY = {"nodes": 24, "waves": 4, "hurst": 0.8, "depth": 1.0, "steps": 10}
CHANGES = [
    {},
    {"nodes": 48},
    {"nodes": 96},
    {"hurst": 0.4},
    {"waves": 2, "nodes": 12},
    {"steps": 40},
    {"depth": 2.0},
]


def inverse_of_made_up_bodies(severity, load):
    return 0.4 + 0.02 * load + 0.2 / (1 + severity / 8)


def rows_of_made_up_bodies(order):
    """Return areas of bodies whose cap of equal area is known.

    The area of the J2 body has an error of an order in the spacing, and two surfaces
    are 2 % from their mean.
    """
    rows = []
    for change, severity, seed, load in product(
        CHANGES, (5, 15, 50), (1, 2), (0.1, 0.25, 0.5)
    ):
        body = {**BODY, **change, "seed": seed, "load": load}
        body |= {"severity": severity, "poisson_ratio": 0.3}
        area = load * inverse_of_made_up_bodies(severity, load)
        spacing = 6 * body["waves"] / body["nodes"]
        error = 0.04 * (1 - area) * area**-0.25 * spacing**order
        body["j2_area"] = area * (1 + error) * (1 + 0.02 * (-1) ** seed)
        if body["hurst"] != 0.8:
            body["j2_area"] *= 1.05
        elif body["steps"] == 40:
            body["j2_area"] *= 1.01
        for cap in (*LADDER, math.inf):
            cap_area = load / cap if cap > load else 1.0
            rows.append({**body, "cap": cap, "cap_area": cap_area})
    return pd.DataFrame(rows)


@pytest.mark.parametrize("order", [1, 2])
def test_the_map_takes_off_the_grid_and_claims_what_is_left(order):
    """Errors of first and of second order are the two ends of what is uncertain."""
    found = mapped(rows_of_made_up_bodies(order))
    # Shorter steps change all places by 1 %, which is taken off.
    exact = 1.01 * inverse_of_made_up_bodies(found["severity"], found["load"])
    error = np.abs(found["inverse_hardness"] / exact - 1)
    np.testing.assert_allclose(CAUTION * error, found["grid_error"], atol=5e-3)
    # 2.8 % of scatter of single surfaces, twice that over the root of two.
    np.testing.assert_allclose(found[["scatter", "statistical_error"]], 0.04, rtol=0.05)
    np.testing.assert_allclose(found["steps_error"], 0.005, rtol=0.1)
    np.testing.assert_allclose(found["depth_error"], 0, atol=1e-12)


@pytest.mark.parametrize(
    ("column", "message"),
    [("depth", "in depth alone; solve"), ("seed", "has one surface, but")],
)
def test_a_map_that_lacks_bodies_is_refused(column, message):
    """A map needs a body of the other depth, and a second surface."""
    rows = rows_of_made_up_bodies(order=1)
    with pytest.raises(InvalidCase, match=message):
        mapped(rows[rows[column] != 2])


@pytest.mark.slow
def test_a_map_is_made_and_saved_paths_are_used_again(tmp_path, capsys):
    table, file = make_map("fast", tmp_path)
    assert len(table) == 4
    columns = pd.read_csv(file, comment="#").columns
    assert list(columns) == list(hardness_map.hardness_map())
    again, _ = make_map("fast", tmp_path)
    reused = re.findall(r"(\d+) of \d+ results reused", capsys.readouterr().out)
    assert sum(map(int, reused)) == 10
    pd.testing.assert_frame_equal(again, table)
