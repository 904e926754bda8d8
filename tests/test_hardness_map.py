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
from laboratory.hardness_map import (
    LADDER,
    inverse_hardness,
    make_map,
    mapped,
    measured_areas,
)
from scipy.interpolate import RegularGridInterpolator

from epcontact import MappedHardness, effective_hardness
from epcontact.cli.main import cli
from epcontact.errors import EpcontactError, InvalidCase, InvalidScene
from epcontact.harness.answers.run import Run, tasks_of
from epcontact.harness.answers.solve import solve_task
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
    fit = fitted_ratio(*(known[name][inside] for name in SYMBOLS))
    off = fit * known["inverse_hardness"][inside] - 1
    # What the formula misses, and the scatter of the places, each at 95 %.
    assert (np.abs(off) < np.hypot(known["scatter"][inside], formula()[1])).mean() > 0.9
    # The map was made until neither its surfaces nor its grids leave more than 2 %.
    for part in ("statistical_error", "grid_error"):
        assert known[part][inside].max() <= 0.02
    # No cap is lower than the mean pressure in the contact of the J2 body.
    bound = known["load"] / known["area"]
    assert (bound[inside] < 1.02 / known["inverse_hardness"][inside]).all()


def test_the_hardness_rises_with_severity_load_and_poisson_ratio() -> None:
    assert at(rms_slope=0.05).ratio < at().ratio < at(rms_slope=0.4).ratio < 3
    assert at(mean_pressure=0.1e9).ratio < at().ratio < at(mean_pressure=1e9).ratio
    assert at(poisson_ratio=0.0).ratio < at().ratio


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


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"rms_slope": 0.01}, r"E\*ξ/σ_Y is 2.308, but the map .* from 3 to 100, and it is not"),
        ({"poisson_ratio": 0.49}, "nu is 0.49, but the map"),
        ({"mean_pressure": 0.01e9}, "p0/σ_Y is 0.01, but the map"),
        ({"rms_slope": 0.014, "mean_pressure": 2e9}, "follows the load and not the material"),
        ({"yield_stress": math.inf}, "yield_stress is inf, but must be a positive"),
        ({"rms_slope": -1.0}, "rms_slope is -1.0, but must be a positive"),
        ({"mean_pressure": math.nan}, "mean_pressure is nan, but must be a positive"),
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
    assert f"hardness = {at().value:.3g} Pa" in done.output
    assert "E*ξ/σ_Y = 23.1, p0/σ_Y = 0.25, nu = 0.3" in done.output
    assert f"touch on {100 * at().area:.3g} % of their nodes (raw area)" in done.output
    # A cap presses with at most its hardness; raw areas are larger than it needs.
    assert at().area > 0.25 / at().ratio
    assert "places of the map" in done.output


def test_a_case_may_take_its_hardness_from_the_map(write_case, tmp_path) -> None:
    given = ("hardness = 6.0e9", 'hardness = "effective"\nyield_stress = 2.0e9')
    case = load_case(write_case(given))
    material = case.material
    expected = effective_hardness(
        yield_stress=2e9, young_modulus=material.young_modulus, rms_slope=0.1, mean_pressure=5e8,
        poisson_ratio=material.poisson_ratio,
    )  # fmt: skip
    assert material.hardness == expected.value
    theory, *_ = tasks_of(case, Run(tmp_path))
    source = solve_task(theory, 1).provenance.about["hardness_source"]["value"]
    assert f"map {map_digest()}" in source
    assert f"95 % interval {expected.interval[0]:.3g} to" in source
    with pytest.raises(
        InvalidCase, match="yield_stress is inf, but must be a positive number in Pa"
    ):
        load_case(write_case((given[0], 'hardness = "effective"')))
    thin = (given[1] + '\n\n[body]\nkind = "bonded_layer"\ndepth = 1e-4', given[0])[::-1]
    with pytest.raises(InvalidCase, match=r"for deep bodies, .* 0\.0001 m and the period 0\.001 m"):
        load_case(write_case(thin))
    with pytest.raises(InvalidCase, match="valid number or be 'effective'"):
        load_case(write_case((given[0], 'hardness = "efective"')))


def test_a_yield_stress_alone_is_not_taken_for_an_elastic_body(write_case) -> None:
    given = "hardness = 6.0e9"
    with pytest.raises(InvalidCase, match="yield_stress and no hardness, at which persson flows"):
        load_case(write_case((given, "yield_stress = 2.0e9")))
    elastic = load_case(write_case((given, "yield_stress = 2.0e9\nhardness = inf")))
    assert math.isinf(elastic.material.hardness)


def test_a_measured_map_has_the_hardness_of_its_own_slope(write_case, tmp_path) -> None:
    """The slope is that of the heights once they are treated, and a case without its map waits."""
    given = write_case(
        ("hardness = 6.0e9", 'hardness = "effective"\nyield_stress = 2.0e9'),
        ("energy_reduction = 0.536", 'energy_reduction = 0.536\nspectrum = "surface"'),
    )
    text = given.read_text(encoding="utf-8")
    start, end = text.index("[surface]"), text.index("[material]")
    recipe = '[surface]\nkind = "file"\npath = "map.npy"\nunit = 1.0\npixel_size = 1e-6\n'
    whole = text[:start] + recipe + "optional = true\n\n" + text[end:]
    given.write_text(whole, encoding="utf-8")
    assert "map.npy is not here" in load_case(given).skip
    x = 2 * np.pi * np.arange(32) / 32
    heights = 0.1 * np.sqrt(2) * 32e-6 / (2 * np.pi) * np.cos(x)[:, None] * np.ones(32)
    np.save(tmp_path / "map.npy", heights)
    case = load_case(given)
    expected = effective_hardness(
        yield_stress=2e9, young_modulus=case.material.young_modulus, rms_slope=0.1,
        poisson_ratio=case.material.poisson_ratio, mean_pressure=5e8,
    )  # fmt: skip
    assert case.material.hardness == pytest.approx(expected.value, rel=1e-12)
    assert str(expected).partition(" (")[0] in case.hardness_source
    tilted = heights + 1e-5 * np.arange(32)[:, None]
    np.save(tmp_path / "map.npy", tilted)
    with pytest.raises(InvalidCase, match=r"map\.npy: not periodic"):
        load_case(given)


def test_a_surface_off_the_map_s_kind_is_refused(tmp_path) -> None:
    punch = tmp_path / "punch-capped-light.toml"
    text = (CASES / punch.name).read_text(encoding="utf-8")
    punch.write_text(text.replace("hardness = 1.0e9", 'hardness = "effective"'), encoding="utf-8")
    with pytest.raises(
        InvalidCase, match="known for rough surfaces only, those of kind self_affine"
    ):
        load_case(punch)


def test_a_path_gives_the_hardness_that_a_single_load_gives() -> None:
    task = read_sweep("hardness-map-30", "fast").tasks[0]
    scene = task.case.scene(task.recipe)
    j2 = task.method.solve(scene, task.case.options["fem"], 1)
    areas = measured_areas(task, j2)
    assert set(areas["load"]) == {0.1, 0.25}
    assert (areas[["severity", "nodes", "waves", "depth"]] == [5.0, 12, 2, 1.0]).all(axis=None)
    (light, _) = 1 / inverse_hardness(areas)["inverse"]
    found = measured_hardness(replace(scene, load=Load(scene.load.path[0])), coarse=False)
    # One interpolates areas between the caps of the ladder, the other searches the cap.
    assert light == pytest.approx(found.ratio, rel=0.03)


def test_loads_of_the_same_share_of_the_modulus_times_the_slope_are_similar() -> None:
    task = read_sweep("hardness-map-30", "fast").tasks[0]
    scene = task.case.scene(task.recipe)
    surface, material = scene.surface, scene.material
    twice = replace(
        scene,
        surface=replace(surface, heights=2 * surface.heights, spectrum=None),
        material=replace(material, yield_stress=2 * material.yield_stress),
        load=Load([2 * pressure for pressure in scene.load.path]),
    )
    one, other = (task.method.solve(s, task.case.options["fem"], 1) for s in (scene, twice))
    # E* xi/sigma_Y, p0/sigma_Y and so p0/(E* xi) are the same, and so is the contact.
    for step, similar in zip(one.steps, other.steps, strict=True):
        assert similar.areas["raw"] == step.areas["raw"]
    np.testing.assert_allclose(
        other.fields["pressure"], 2 * one.fields["pressure"], atol=1e-6 * material.yield_stress
    )


USUAL = {"nodes": 24, "waves": 4, "hurst": 0.8, "depth": 1.0, "step_tolerance": 0.03}
CHECKS = [
    {"nodes": 48},
    {"nodes": 96},
    {"hurst": 0.4},
    {"waves": 2, "nodes": 12},
    {"step_tolerance": 0.01},
    {"depth": 2.0},
]


def made_up(kinds, severities=(5.0, 15.0, 50.0), seeds=(1, 2), order=2) -> pd.DataFrame:
    """Areas of bodies whose cap of equal area is known; under it the area is m/c.

    order: of the error in the spacing, which is .04 of `size_of_error` on 24 nodes.
    """
    rows = []
    for kind, severity, seed, load in product(kinds, severities, seeds, (0.1, 0.25, 0.5)):
        body = USUAL | kind | {"severity": severity, "poisson_ratio": 0.3, "load": load}
        inverse = exact(severity, load) * (1 + 0.02 * (-1) ** seed)
        spots = size_of_error(load * exact(severity, load))
        spacing = 6 * body["waves"] / body["nodes"]
        inverse *= 1 + 0.04 * spots * spacing**order
        inverse *= 1.05 if body["hurst"] != 0.8 else 1.01 if body["step_tolerance"] == 0.01 else 1
        for cap in (*LADDER, math.inf):
            area = min(1.0, load / cap) if cap > load else 1.0
            rows.append(
                body | {"seed": seed, "j2_area": load * inverse, "cap": cap, "cap_area": area}
            )
    return pd.DataFrame(rows)


def size_of_error(area):
    return (1 - area) * area**-0.25


def exact(severity, load):
    return 0.4 + 0.02 * load + 0.2 / (1 + severity / 8)


def test_the_map_takes_off_the_grid_and_says_how_much_surfaces_scatter() -> None:
    areas = made_up([{}, *CHECKS])
    found = mapped(areas)
    # Shorter steps change all places by 1 %, which is taken off.
    wanted = 1.01 * exact(found["severity"], found["load"])
    # Errors of second and of first order are at the two ends of what is doubted.
    assert_held(found, wanted)
    assert_held(mapped(made_up([{}, *CHECKS], order=1)), wanted)
    # Two surfaces, 2 % from their mean: 2.8 % of scatter, twice that over the root of two.
    np.testing.assert_allclose(found["scatter"], 0.04, rtol=0.05)
    # They shift all places together, so that the formula pools nothing.
    np.testing.assert_allclose(found["statistical_error"], 0.04, rtol=0.05)
    np.testing.assert_allclose(found["steps_error"], 0.005, rtol=0.1)
    np.testing.assert_allclose(found["depth_error"], 0, atol=1e-12)
    # One spectrum of two changes it by 5 %; the surfaces scatter by 2 % in both ensembles.
    by_surfaces = 2 * 0.02**2
    np.testing.assert_allclose(
        found["spectrum_error"], 2 * math.sqrt(0.05**2 / 2 - by_surfaces), rtol=0.1
    )
    # After each halving a third of its change is left by second order, and all of it by first.
    coarser = mapped(areas[areas["nodes"] != 96])
    size = size_of_error(wanted * found["load"])
    np.testing.assert_allclose(coarser["grid_error"], 0.03 * size / (1 + 0.04 * size) / 3, rtol=0.1)
    assert (found["grid_error"] < 0.3 * coarser["grid_error"]).all()
    # Another spectrum shows what the next halving leaves, so that less is doubted.
    others = [{"waves": 2, "nodes": nodes} for nodes in (24, 48, 96)]
    shown = mapped(made_up([{}, *CHECKS, *others]))
    assert (shown["grid_error"] < 0.5 * found["grid_error"]).all()
    assert_held(shown, wanted)


def assert_held(found, wanted) -> None:
    """Assert that what is left of the grid's error is what is claimed: not more, nor much less."""
    # The change is not quite proportional to the open share of the surface.
    left = np.abs(found["inverse_hardness"] / wanted - 1)
    np.testing.assert_allclose(left, found["grid_error"], atol=2.5e-3)


def test_surfaces_of_their_own_scatter_less_in_the_formula() -> None:
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
