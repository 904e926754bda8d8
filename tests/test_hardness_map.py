"""The map of the effective hardness: its formula, its refusals, its users, and how it is made."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from laboratory.hardness_map import LADDER, inverse_hardness, make_map, mapped, measured_areas
from scipy.interpolate import RegularGridInterpolator

from epcontact import MappedHardness, effective_hardness
from epcontact.cli.main import cli
from epcontact.errors import EpcontactError, InvalidCase, InvalidScene
from epcontact.harness.answers.run import Run, solve_task, tasks_of
from epcontact.harness.case_files.case import load_case
from epcontact.harness.crosscheck import measured_hardness
from epcontact.harness.sweep import Swept, read_sweep
from epcontact.materials.hardness_map import (
    FULL,
    PARTS,
    SYMBOLS,
    fitted_ratio,
    formula,
    hardness_map,
    map_digest,
)
from epcontact.scene import Load

CASES = Path(__file__).parent.parent / "cases"
STEEL = {"young_modulus": 210e9, "poisson_ratio": 0.3, "rms_slope": 0.1}


def at(**changed: Any) -> MappedHardness:
    return effective_hardness(**({"yield_stress": 1e9, "mean_pressure": 0.25e9} | STEEL | changed))


def test_the_map_covers_what_it_says_and_is_smooth() -> None:
    known = hardness_map()
    assert known["load"].size == np.prod([np.unique(known[name]).size for name in SYMBOLS])
    inside = known["area"] <= FULL
    inverse = known["inverse_hardness"][inside]
    off = fitted_ratio(*(known[name][inside] for name in SYMBOLS)) * inverse - 1
    # What the formula misses, and the scatter of the places, each at 95 %.
    assert (np.abs(off) < np.hypot(known["scatter"][inside], formula()[1])).mean() > 0.9
    # The map was made until neither its surfaces nor its grids leave more than 2 %.
    assert max(known[part][inside].max() for part in ("statistical_error", "grid_error")) <= 0.02
    # No cap is lower than the mean pressure in the contact of the J2 body.
    assert ((known["load"] / known["area"])[inside] < 1.02 / inverse).all()


def test_the_area_is_interpolated_linearly_in_ln_s_nu_and_m() -> None:
    columns = {**hardness_map()}
    order = np.lexsort([columns[name] for name in reversed(SYMBOLS)])
    axes = [np.unique(columns[name]) for name in SYMBOLS]
    area = columns["area"][order].reshape([axis.size for axis in axes])
    linear = RegularGridInterpolator((np.log(axes[0]), *axes[1:]), area)
    for changed in ({}, {"rms_slope": 0.07, "poisson_ratio": 0.1}, {"mean_pressure": 0.4e9}):
        found = at(**changed)
        place = (math.log(found.severity), found.poisson_ratio, found.load)
        assert found.area == pytest.approx(linear(place).item(), rel=1e-12)


def test_only_ratios_matter_and_the_interval_holds_the_value() -> None:
    found = at()
    scaled = at(yield_stress=1e3, mean_pressure=0.25e3, young_modulus=210e3)
    assert scaled.value == pytest.approx(1e-6 * found.value)
    assert found.interval[0] < found.value < found.interval[1]
    assert set(found.errors) == {*PARTS, "formula_error"}
    assert found.value == pytest.approx(found.ratio * 1e9)
    # The hardness rises with severity, load and Poisson's ratio.
    assert at(rms_slope=0.05).ratio < at().ratio < at(rms_slope=0.4).ratio < 3
    assert at(mean_pressure=0.1e9).ratio < at().ratio < at(mean_pressure=1e9).ratio
    assert at(poisson_ratio=0.0).ratio < at().ratio


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"rms_slope": 0.01}, r"E\*ξ/σ_Y is 2.308, but the map .* from 3 to 100, and it is not"),
        ({"poisson_ratio": 0.49}, "nu is 0.49, but the map"),
        ({"mean_pressure": 0.01e9}, "p0/σ_Y is 0.01, but the map"),
        ({"rms_slope": 0.014, "mean_pressure": 2e9}, "follows the load and not the material"),
        ({"yield_stress": math.inf}, "yield_stress is inf, but must be a positive"),
        ({"rms_slope": "steep"}, "rms_slope is 'steep', but must be a positive"),
        ({"poisson_ratio": None}, "poisson_ratio is None, but must be a number"),
    ],
)
def test_nothing_is_extrapolated(changed: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InvalidScene, match=sentence):
        at(**changed)


def test_the_command_prints_value_interval_and_what_they_rest_on() -> None:
    options = STEEL | {"yield_stress": 1e9, "mean_pressure": 0.25e9}
    words = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]
    done = CliRunner().invoke(cli, ["hardness", *words])
    assert done.exit_code == 0
    for told in (
        f"hardness = {at().value:.3g} Pa",
        "E*ξ/σ_Y = 23.1, p0/σ_Y = 0.25, nu = 0.3",
        f"touch on {100 * at().area:.3g} % of their nodes (raw area)",
        "places of the map",
    ):
        assert told in done.output
    # A cap presses with at most its hardness; raw areas are larger than it needs.
    assert at().area > 0.25 / at().ratio


GIVEN = "hardness = 6.0e9"
EFFECTIVE = (GIVEN, 'hardness = "effective"\nyield_stress = 2.0e9')


def hardness_of(case: Any) -> MappedHardness:
    E, nu = case.material.young_modulus, case.material.poisson_ratio
    return at(yield_stress=2e9, young_modulus=E, poisson_ratio=nu, rms_slope=0.1, mean_pressure=5e8)


def test_a_case_may_take_its_hardness_from_the_map(write_case, tmp_path) -> None:
    case = load_case(write_case(EFFECTIVE))
    expected = hardness_of(case)
    assert case.material.hardness == expected.value
    theory, *_ = tasks_of(case, Run(tmp_path))
    source = solve_task(theory, 1).provenance.about["hardness_source"]["value"]
    assert f"map {map_digest()}" in source
    assert f"95 % interval {expected.interval[0]:.3g} to" in source
    elastic = load_case(write_case((GIVEN, "yield_stress = 2.0e9\nhardness = inf")))
    assert math.isinf(elastic.material.hardness)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ('hardness = "effective"', "yield_stress is inf, but must be a positive number in Pa"),
        ('hardness = "efective"', "valid number or be 'effective'"),
        ("yield_stress = 2.0e9", "yield_stress and no hardness, at which persson flows"),
        (
            EFFECTIVE[1] + '\n\n[body]\nkind = "bonded_layer"\ndepth = 1e-4',
            r"for deep bodies, .* 0\.0001 m and the period 0\.001 m",
        ),
    ],
)
def test_a_case_that_has_no_hardness_is_refused(write_case, words: str, sentence: str) -> None:
    with pytest.raises(InvalidCase, match=sentence):
        load_case(write_case((GIVEN, words)))


def test_a_measured_map_has_the_hardness_of_its_own_slope(write_case, tmp_path) -> None:
    """The slope is that of the heights once they are treated, and a case without its map waits."""
    spectrum = ("energy_reduction = 0.536", 'energy_reduction = 0.536\nspectrum = "surface"')
    given = write_case(EFFECTIVE, spectrum)
    text = given.read_text(encoding="utf-8")
    start, end = text.index("[surface]"), text.index("[material]")
    recipe = '[surface]\nkind = "file"\npath = "map.npy"\nunit = 1.0\npixel_size = 1e-6\n'
    given.write_text(text[:start] + recipe + "optional = true\n\n" + text[end:], encoding="utf-8")
    assert "map.npy is not here" in load_case(given).skip
    x = 2 * np.pi * np.arange(32) / 32
    heights = 0.1 * np.sqrt(2) * 32e-6 / (2 * np.pi) * np.cos(x)[:, None] * np.ones(32)
    np.save(tmp_path / "map.npy", heights)
    case = load_case(given)
    assert case.material.hardness == pytest.approx(hardness_of(case).value, rel=1e-12)
    assert str(hardness_of(case)).partition(" (")[0] in case.hardness_source
    np.save(tmp_path / "map.npy", heights + 1e-5 * np.arange(32)[:, None])
    with pytest.raises(InvalidCase, match=r"map\.npy: not periodic"):
        load_case(given)


def test_a_surface_off_the_map_s_kind_is_refused(tmp_path) -> None:
    punch = tmp_path / "punch-capped-light.toml"
    text = (CASES / punch.name).read_text(encoding="utf-8")
    punch.write_text(text.replace("hardness = 1.0e9", 'hardness = "effective"'), encoding="utf-8")
    with pytest.raises(InvalidCase, match="rough surfaces only, those of kind self_affine"):
        load_case(punch)


def test_a_path_gives_the_hardness_that_a_single_load_gives_and_only_ratios_matter() -> None:
    task = read_sweep("hardness-map-30", "fast").tasks[0]
    scene = task.case.scene(task.recipe)
    j2 = task.method.solve(scene, task.case.options["fem"], 1)
    areas = measured_areas(task, j2)
    assert set(areas["load"]) == {0.1, 0.25}
    assert (areas[["severity", "nodes", "waves", "depth"]] == [5.0, 12, 2, 1.0]).all(axis=None)
    (light, _) = 1 / inverse_hardness(areas)[0]["inverse"]
    found = measured_hardness(replace(scene, load=Load(scene.load.path[0])), coarse=False)
    # One interpolates areas between the caps of the ladder, the other searches the cap.
    assert light == pytest.approx(found.ratio, rel=0.03)
    # E* xi/sigma_Y, p0/sigma_Y and so p0/(E* xi) are the same, and so is the contact.
    surface = replace(scene.surface, heights=2 * scene.surface.heights, spectrum=None)
    material = replace(scene.material, yield_stress=2 * scene.material.yield_stress)
    load = Load([2 * pressure for pressure in scene.load.path])
    twice = replace(scene, surface=surface, material=material, load=load)
    similar = task.method.solve(twice, task.case.options["fem"], 1)
    for step, other in zip(j2.steps, similar.steps, strict=True):
        assert step.areas["raw"] == other.areas["raw"]
    pressure, error = 2 * j2.fields["pressure"], 5e-7 * material.yield_stress
    np.testing.assert_allclose(similar.fields["pressure"], pressure, atol=error)


USUAL = {"nodes": 24, "waves": 4, "hurst": 0.8, "depth": 1.0, "step_tolerance": 0.03}
CHECKS = [
    *({"nodes": 48}, {"nodes": 96}, {"hurst": 0.4}, {"waves": 2, "nodes": 12}),
    *({"step_tolerance": 0.01}, {"depth": 2.0}),
]


def made_up(kinds, severities=(5.0, 15.0, 50.0), seeds=(1, 2), order=2) -> pd.DataFrame:
    """Areas of bodies whose cap of equal area is known; under it the area is m/c.

    order: of the error in the spacing, which is .04 of `size_of_error` on 24 nodes.
    """
    rows = []
    for kind, severity, seed, load in product(kinds, severities, seeds, (0.1, 0.25, 0.5)):
        body = USUAL | kind | {"severity": severity, "poisson_ratio": 0.3, "load": load}
        inverse = exact(severity, load) * (1 + 0.02 * (-1) ** seed)
        spacing = 6 * body["waves"] / body["nodes"]
        inverse *= 1 + 0.04 * size_of_error(load * exact(severity, load)) * spacing**order
        inverse *= 1.05 if body["hurst"] != 0.8 else 1.01 if body["step_tolerance"] == 0.01 else 1
        body |= {"seed": seed, "j2_area": load * inverse}
        for cap in (*LADDER, math.inf):
            area = min(1.0, load / cap) if cap > load else 1.0
            rows.append(body | {"cap": cap, "cap_area": area})
    return pd.DataFrame(rows)


def size_of_error(area):
    return (1 - area) * area**-0.25


def exact(severity, load):
    return 0.4 + 0.02 * load + 0.2 / (1 + severity / 8)


def assert_held(found) -> None:
    """Assert that what is left of the grid's error is what is claimed: not more, nor much less."""
    # Shorter steps change all places by 1 %, which is taken off.  The change is not quite
    # proportional to the open share of the surface.
    left = np.abs(found["inverse_hardness"] / (1.01 * exact(found["severity"], found["load"])) - 1)
    np.testing.assert_allclose(left, found["grid_error"], atol=2.5e-3)


def test_the_map_takes_off_the_grid_and_says_how_much_surfaces_scatter() -> None:
    areas = made_up([{}, *CHECKS])
    found = mapped(areas)
    # Errors of second and of first order are at the two ends of what is doubted.
    assert_held(found)
    assert_held(mapped(made_up([{}, *CHECKS], order=1)))
    # Two surfaces, 2 % from their mean: 2.8 % of scatter, twice that over the root of two.  They
    # shift all places together, so that the formula pools nothing.
    np.testing.assert_allclose(found[["scatter", "statistical_error"]], 0.04, rtol=0.05)
    np.testing.assert_allclose(found["steps_error"], 0.005, rtol=0.1)
    np.testing.assert_allclose(found["depth_error"], 0, atol=1e-12)
    # One spectrum of two changes it by 5 %; the surfaces scatter by 2 % in both ensembles.
    spectrum = 2 * math.sqrt(0.05**2 / 2 - 2 * 0.02**2)
    np.testing.assert_allclose(found["spectrum_error"], spectrum, rtol=0.1)
    # After each halving a third of its change is left by second order, and all of it by first.
    coarser = mapped(areas[areas["nodes"] != 96])
    size = size_of_error(1.01 * exact(found["severity"], found["load"]) * found["load"])
    np.testing.assert_allclose(coarser["grid_error"], 0.03 * size / (1 + 0.04 * size) / 3, rtol=0.1)
    assert (found["grid_error"] < 0.3 * coarser["grid_error"]).all()
    # Another spectrum shows what the next halving leaves, so that less is doubted.
    others = [{"waves": 2, "nodes": nodes} for nodes in (24, 48, 96)]
    shown = mapped(made_up([{}, *CHECKS, *others]))
    assert (shown["grid_error"] < 0.5 * found["grid_error"]).all()
    assert_held(shown)
    # Surfaces of their own scatter less in the formula.
    own = [made_up([{}], (s,), (10 * k, 10 * k + 1)) for k, s in enumerate((5.0, 15.0, 50.0))]
    found = mapped(pd.concat([*own, made_up(CHECKS, seeds=(0, 1))]))
    assert (found["statistical_error"] < 0.9 * found["scatter"]).any()


def test_a_map_without_a_check_or_with_one_surface_is_refused() -> None:
    with pytest.raises(InvalidCase, match="differs from those of the map in depth alone"):
        mapped(made_up([{}, *CHECKS[:-1]]))
    with pytest.raises(InvalidCase, match="has one surface, but its scatter needs two"):
        mapped(made_up([{}, *CHECKS], seeds=(1,)))


@pytest.mark.slow
def test_a_map_is_made_and_kept_paths_are_used_again(tmp_path, capsys) -> None:
    made, file = make_map("fast", tmp_path)
    assert len(made) == 4
    assert list(pd.read_csv(file, comment="#")) == list(hardness_map())
    again, _ = make_map("fast", tmp_path)
    assert sum(int(n) for n in re.findall(r"(\d+) paths reused", capsys.readouterr().out)) == 11
    pd.testing.assert_frame_equal(again, made)


def test_a_path_without_a_result_is_one_sentence(tmp_path, monkeypatch) -> None:
    def fails(case, **options) -> Swept:
        return Swept(tmp_path, pd.DataFrame(), {"fem-1": "not finished"}, 0, ())

    # The cases of the map are the package's own, whatever cases a user has.
    (tmp_path / "cases").mkdir()
    (tmp_path / "cases" / "hardness-map.toml").write_text("[case]\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(EpcontactError, match=r"hardness-map-30: 1 paths .* fem-1 .not finished"):
        make_map("fast", tmp_path, fails)
