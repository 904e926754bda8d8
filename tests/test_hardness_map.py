"""The map of the effective hardness: its formula, its refusals, its users, and how it
is made.
"""

import math
import re
from dataclasses import replace
from functools import partial
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
from epcontact.materials import hardness_map as kept
from epcontact.materials.hardness_map import hardness_map
from epcontact.scene import Load

CASES = Path(__file__).parent.parent / "cases"
USUAL = {"yield_stress": 1e9, "mean_pressure": 0.25e9, "young_modulus": 210e9}
USUAL |= {"poisson_ratio": 0.3, "rms_slope": 0.1}


def at(**changed):
    return effective_hardness(**(USUAL | changed))


def test_the_map_covers_what_it_says_and_is_smooth():
    assert (
        kept.map_digest() == "515071162a27"
    )  # a map that was made anew has another one
    known = hardness_map()
    assert known["load"].size == np.prod(
        [np.unique(known[name]).size for name in kept.COORDINATES]
    )
    inside = known["area"] <= kept.LARGEST_AREA
    inverse = known["inverse_hardness"][inside]
    off = (
        kept.fitted_ratio(*(known[name][inside] for name in kept.COORDINATES)) * inverse
        - 1
    )
    # What the formula misses, and the scatter of the places, each at 95 %.
    assert (
        np.abs(off) < np.hypot(known["scatter"][inside], kept.fitted_formula()[1])
    ).mean() > 0.9
    assert np.abs(off).max() < 0.08
    # The map was made until its surfaces leave no more than 2 %, and its grids 2 to 4
    # %.
    assert known["statistical_error"][inside].max() <= 0.02
    assert 0.02 < known["grid_error"][inside].max() < 0.04
    # No cap is lower than the mean pressure in the contact of the J2 body.
    assert ((known["load"] / known["area"])[inside] < 1.02 / inverse).all()


@pytest.mark.parametrize(
    "changed", [{}, {"rms_slope": 0.07, "poisson_ratio": 0.1}, {"mean_pressure": 0.4e9}]
)
def test_the_area_is_interpolated_linearly_in_ln_s_nu_and_m(changed):
    places = (
        pd.DataFrame({**hardness_map()})
        .set_index([*kept.COORDINATES])["area"]
        .sort_index()
    )
    axes = [level.to_numpy() for level in places.index.levels]
    area = places.to_numpy().reshape([axis.size for axis in axes])
    linear, found = (
        RegularGridInterpolator((np.log(axes[0]), *axes[1:]), area),
        at(**changed),
    )
    place = (math.log(found.severity), found.poisson_ratio, found.load)
    assert found.area == pytest.approx(linear(place).item(), rel=1e-12)


def test_only_ratios_matter_and_the_interval_holds_the_value():
    found = at()
    scaled = at(yield_stress=1e3, mean_pressure=0.25e3, young_modulus=210e3)
    assert scaled.value == pytest.approx(1e-6 * found.value)
    ends = [found.value / (1 + found.error), found.value / (1 - found.error)]
    assert [*found.interval] == pytest.approx(ends, rel=1e-12)
    assert set(found.errors) == {*kept.ERROR_COLUMNS, "formula_error", "breadth_error"}
    # The hardness rises with severity, load and Poisson's ratio.
    assert at(rms_slope=0.05).ratio < at().ratio < at(rms_slope=0.4).ratio < 3.25
    assert at(mean_pressure=0.1e9).ratio < at().ratio < at(mean_pressure=1e9).ratio
    assert at(poisson_ratio=0.0).ratio < at().ratio


def test_the_breadth_is_judged_by_ensembles_that_taught_nothing():
    """Within the claim of the breadth alone, which is a third of what all spectra
    differed by.
    """
    table = breadth.judged(pd.read_csv(breadth.FILE))
    for _, some in table[~table["taught"]].groupby("nodes"):
        assert some["within"].mean() >= 0.83
    assert table[~table["taught"]]["within"].mean() >= 0.95
    assert (table["claimed"] < 0.051).all()
    assert table[table["first_seed"] == 501]["within"].all()  # of severity 50 and 100
    narrow = at(breadth=2)
    large = kept.SIZE_EFFECT / 0.25  # over the load
    flowing = at().severity / (8 + at().severity)
    for breadths in (2, 4, 32, 300, None):  # an unknown one lies anywhere in between
        ends = (2, 300) if breadths is None else (breadths,) * 2
        low, high, beyond = (
            kept.BREADTH_TREND * flowing * math.log(b)
            for b in (ends[0] / 4, ends[1] / 4, ends[1] / 32)
        )
        trend = (low + high) / 2
        parts = (
            kept.CORRECTION_ERROR * (abs(trend) + large),
            max(beyond, 0.0),
            kept.SPECTRA_ERROR,
            (high - low) / 2,
        )
        found = at(breadth=breadths)
        assert found.errors["breadth_error"] == pytest.approx(math.hypot(*parts))
        bare = found.ratio / (1 + trend + large)
        assert bare == pytest.approx(
            kept.fitted_ratio(*np.array([[at().severity], [0.3], [0.25]]))
        )
    unknown = at()
    assert (
        unknown.interval[0] < narrow.value < at(breadth=300).value < unknown.interval[1]
    )
    with pytest.raises(InvalidScene, match=r"breadth is 1\.5, but .* at least 2"):
        at(breadth=1.5)


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        (
            {"rms_slope": 0.01},
            r"E\*ξ/σ_Y is 2.308, but the map .* from 3 to 100, and it is not",
        ),
        ({"poisson_ratio": 0.49}, "nu is 0.49, but the map"),
        (
            {"mean_pressure": 0.0029e9},
            "p0/σ_Y is 0.0029, but the map .* from 0.003 to 2",
        ),
        (
            {"rms_slope": 0.014, "mean_pressure": 2e9},
            "follows the load and not the material",
        ),
        ({"yield_stress": math.inf}, "yield_stress is inf, but must be a positive"),
        ({"rms_slope": "steep"}, "rms_slope is 'steep', but must be a positive"),
        ({"poisson_ratio": None}, "poisson_ratio is None, but must be a number"),
    ],
)
def test_nothing_is_extrapolated(changed, sentence):
    with pytest.raises(InvalidScene, match=sentence):
        at(**changed)


def test_light_loads_have_an_interval_that_holds_what_j2_bodies_showed():
    """c/c(.1) of J2 bodies by `laboratory.light_loads`; 30 is of surfaces that taught
    nothing.
    """
    measured = {
        15: (0.935, 0.858, 0.758),
        50: (0.947, 0.863, 0.755),
        30: (0.924, 0.867, 0.759),
    }
    for severity, falls in measured.items():
        slope = severity * 1e9 / (210e9 / 0.91)
        heavy = at(rms_slope=slope, mean_pressure=0.1e9, breadth=4)
        for load, fall in zip((0.03, 0.01, 0.003), falls, strict=True):
            found = at(rms_slope=slope, mean_pressure=load * 1e9, breadth=4)
            light = found.errors["light_error"]
            low, high = found.ratio * (1 - light), found.ratio * (1 + light)
            assert 0.99 * low <= fall * heavy.ratio < high == pytest.approx(heavy.ratio)
            assert heavy.error < found.error < 0.2
            assert found.area == pytest.approx(heavy.area * load / 0.1)
    # Steel of 600 MPa at 10 MPa; the map's own lightest load is met without a jump.
    steel = at(yield_stress=0.6e9, mean_pressure=10e6, breadth=16)
    assert 1.1e9 < steel.interval[0] < steel.value < steel.interval[1] < 2.0e9
    assert at(mean_pressure=0.0999999e9).ratio == pytest.approx(
        at(mean_pressure=0.1e9).ratio
    )


def test_the_command_prints_what_the_function_finds():
    words = [f"--{name.replace('_', '-')}={value}" for name, value in USUAL.items()]
    assert invoke("hardness", *words).stdout == f"{at()}\n{at().source}\n"


GIVEN = "hardness = 6.0e9"
EFFECTIVE = (GIVEN, 'hardness = "effective"\nyield_stress = 2.0e9')
LAYER = '\n\n[body]\nkind = "bonded_layer"\ndepth = 1e-4'
#: What the map says of the small case, and of a measured map, which tells no breadth.
SMALL = partial(at, yield_stress=2e9, young_modulus=100e9, mean_pressure=5e8)
EXPECTED, MEASURED = SMALL(breadth=4), SMALL()


def test_a_case_may_take_its_hardness_from_the_map(write_case, tmp_path):
    case = load_case(write_case(EFFECTIVE))
    assert case.material.hardness == EXPECTED.value
    theory, *_ = tasks_of(case, Run(tmp_path))
    source = solve_task(theory, 1).provenance.about["hardness_source"]["value"]
    assert f"map {kept.map_digest()}" in source
    assert f"95 % interval {EXPECTED.interval[0]:.3g} to" in source
    elastic = load_case(write_case((GIVEN, "yield_stress = 2.0e9\nhardness = inf")))
    assert math.isinf(elastic.material.hardness)


@pytest.mark.parametrize(
    ("words", "sentence"),
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
            EFFECTIVE[1] + LAYER,
            r"for deep bodies, .* 0\.0001 m and the period 0\.001 m",
        ),
    ],
)
def test_a_case_that_has_no_hardness_is_refused(write_case, words, sentence):
    with pytest.raises(InvalidCase, match=sentence):
        load_case(write_case((GIVEN, words)))


def test_only_rough_surfaces_have_a_hardness_of_the_map(tmp_path):
    punch = (CASES / "punch-capped-light.toml").read_text(encoding="utf-8")
    path = tmp_path / "punch-capped-light.toml"
    path.write_text(punch.replace("hardness = 1.0e9", EFFECTIVE[1]), encoding="utf-8")
    with pytest.raises(
        InvalidCase, match="rough surfaces only, those of kind self_affine"
    ):
        load_case(path)


def test_a_measured_map_has_the_hardness_of_its_own_slope(write_case, tmp_path):
    spectrum = (
        "energy_reduction = 0.536",
        'energy_reduction = 0.536\nspectrum = "surface"',
    )
    given = write_case(EFFECTIVE, spectrum)
    before, _, rest = given.read_text(encoding="utf-8").partition("[surface]")
    recipe = (
        '[surface]\nkind = "file"\npath = "map.npy"\nunit = 1.0\npixel_size = 1e-6\n'
    )
    recipe += 'treatment = "refuse"\n'
    text = before + recipe + "optional = true\n\n" + rest[rest.index("[material]") :]
    given.write_text(text, encoding="utf-8")
    assert "map.npy is not here" in load_case(given).skip
    x = 2 * np.pi * np.arange(32) / 32
    heights = 0.1 * np.sqrt(2) * 32e-6 / (2 * np.pi) * np.cos(x)[:, None] * np.ones(32)
    np.save(tmp_path / "map.npy", heights)
    case = load_case(given)
    assert case.material.hardness == pytest.approx(MEASURED.value, rel=1e-12)
    assert str(MEASURED).partition(" (")[0] in case.hardness_source
    np.save(tmp_path / "map.npy", heights + 1e-5 * np.arange(32)[:, None])
    with pytest.raises(InvalidCase, match=r"map\.npy: not periodic"):
        load_case(given)


# --- the laboratory of the map
# --------------------------------------------------------------------


def test_a_path_gives_the_hardness_that_a_single_load_gives():
    task = read_sweep("hardness-map-30", "fast").tasks[0]
    scene = task.case.scene(task.recipe)
    areas = measured_areas(task, task.method.solve(scene, task.case.options["fem"], 1))
    assert (areas[["severity", "nodes", "waves", "depth"]] == [5.0, 12, 2, 1.0]).all(
        axis=None
    )
    (light, _) = 1 / inverse_hardness(areas)[0]["inverse"]
    found = measured_hardness(replace(scene, load=Load(scene.load.path[0])))
    # One interpolates areas between the caps of the ladder, the other searches the cap.
    assert light == pytest.approx(found.ratio, rel=0.03)


BODIES = [
    *({}, {"nodes": 48}, {"nodes": 96}, {"hurst": 0.4}, {"waves": 2, "nodes": 12}),
    *({"steps": 40}, {"depth": 2.0}),
]


@pytest.mark.parametrize("order", [1, 2])
def test_the_map_takes_off_the_grid_and_claims_what_is_left(order):
    """Bodies whose cap of equal area is known have an error of an order in the
    spacing.
    """
    rows, usual = [], {"nodes": 24, "waves": 4, "hurst": 0.8, "depth": 1.0, "steps": 10}
    for kind, severity, seed, load in product(
        BODIES, (5, 15, 50), (1, 2), (0.1, 0.25, 0.5)
    ):
        body = usual | kind | {"severity": severity, "poisson_ratio": 0.3, "load": load}
        exact = 0.4 + 0.02 * load + 0.2 / (1 + severity / 8)
        spacing, area = 6 * body["waves"] / body["nodes"], load * exact
        grid = 1 + 0.04 * (1 - area) * area**-0.25 * spacing**order
        other = 1.05 if body["hurst"] != 0.8 else 1.01 if body["steps"] == 40 else 1
        body |= {
            "j2_area": area * (1 + 0.02 * (-1) ** seed) * grid * other,
            "seed": seed,
        }
        for cap in (*LADDER, math.inf):
            rows.append(
                body
                | {"cap": cap, "cap_area": min(1.0, load / cap) if cap > load else 1}
            )
    found = mapped(pd.DataFrame(rows))
    # Shorter steps change all places by 1 %, which is taken off.
    exact = 1.01 * (0.4 + 0.02 * found["load"] + 0.2 / (1 + found["severity"] / 8))
    # Errors of second and of first order are at the two ends of what is doubted.
    left = np.abs(found["inverse_hardness"] / exact - 1)
    np.testing.assert_allclose(CAUTION * left, found["grid_error"], atol=5e-3)
    # Two surfaces, 2 % from their mean: 2.8 % of scatter, twice that over the root of
    # two.
    np.testing.assert_allclose(found[["scatter", "statistical_error"]], 0.04, rtol=0.05)
    np.testing.assert_allclose(found["steps_error"], 0.005, rtol=0.1)
    np.testing.assert_allclose(found["depth_error"], 0, atol=1e-12)
    for kind, sentence in (
        ("depth", "in depth alone; solve"),
        ("seed", "has one surface, but"),
    ):
        with pytest.raises(InvalidCase, match=sentence):
            mapped(pd.DataFrame([row for row in rows if row[kind] != 2]))


@pytest.mark.slow
def test_a_map_is_made_and_kept_paths_are_used_again(tmp_path, capsys):
    made, file = make_map("fast", tmp_path)
    assert len(made) == 4
    assert list(pd.read_csv(file, comment="#")) == list(hardness_map())
    again, _ = make_map("fast", tmp_path)
    reused = re.findall(r"(\d+) of \d+ results reused", capsys.readouterr().out)
    assert sum(map(int, reused)) == 10
    pd.testing.assert_frame_equal(again, made)
