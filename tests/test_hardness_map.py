"""The map of the effective hardness: its formula, its refusals, its users, and how it is made."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from epcontact import MappedHardness, effective_hardness
from epcontact.cli.main import cli
from epcontact.errors import InvalidCase, InvalidScene
from epcontact.harness.case import load_case
from epcontact.harness.model_difference import effective_hardness as measured_hardness
from epcontact.reference.hardness_map import (
    FULL,
    PARTS,
    SYMBOLS,
    fitted_ratio,
    formula,
    hardness_map,
)
from epcontact.scene import Load
from epcontact.studies import STUDIES
from epcontact.studies.hardness_map import (
    LADDER,
    LOADS,
    USUAL,
    Point,
    charts,
    inverse_hardness,
    mapped,
    measured_areas,
)
from epcontact.studies.persistence import EFFECTIVE, J2, TABORS, area_table, draw_areas

CASES = Path(__file__).parent.parent / "cases"
STEEL = {"young_modulus": 210e9, "poisson_ratio": 0.3, "rms_slope": 0.1}


def at(**changed: float) -> MappedHardness:
    return effective_hardness(**({"yield_stress": 1e9, "mean_pressure": 0.25e9} | STEEL | changed))


def test_the_map_covers_what_it_says_and_is_smooth() -> None:
    known = hardness_map()
    assert known["load"].size == np.prod([np.unique(known[name]).size for name in SYMBOLS])
    error = np.sqrt(sum(known[part] ** 2 for part in PARTS))
    inside = (known["area"] <= FULL) & (error < 0.2)
    fit = fitted_ratio(*(known[name][inside] for name in SYMBOLS))
    off = fit * known["inverse_hardness"][inside] - 1
    # Twice the residual, which belongs to the fit, and what belongs to a place.
    assert (np.abs(off) < np.hypot(error[inside], formula()[1])).mean() > 0.9
    # No cap is lower than the mean pressure in the contact of the J2 body.
    bound = known["load"] / known["area"]
    assert (bound[inside] < 1.02 / known["inverse_hardness"][inside]).all()


def test_the_hardness_rises_with_severity_load_and_poisson_ratio() -> None:
    assert at(rms_slope=0.05).ratio < at().ratio < at(rms_slope=0.4).ratio < 3
    assert at(mean_pressure=0.1e9).ratio < at().ratio < at(mean_pressure=1e9).ratio
    assert at(poisson_ratio=0.0).ratio < at().ratio


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
        ({"yield_stress": math.inf}, "yield_stress is inf, but must be positive"),
        ({"rms_slope": -1.0}, "rms_slope is -1.0, but must be positive"),
    ],
)
def test_nothing_is_extrapolated(changed: dict[str, float], sentence: str) -> None:
    with pytest.raises(InvalidScene, match=sentence):
        at(**changed)


def test_the_command_prints_value_interval_and_what_they_rest_on() -> None:
    options = STEEL | {"yield_stress": 1e9, "mean_pressure": 0.25e9}
    words = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]
    done = CliRunner().invoke(cli, ["hardness", *words])
    assert done.exit_code == 0
    assert f"hardness = {at().value:.3g} Pa" in done.output
    assert "E*ξ/σ_Y = 23.1, p0/σ_Y = 0.25, nu = 0.3" in done.output
    assert "places of the map" in done.output


def test_a_case_may_take_its_hardness_from_the_map(write_case) -> None:
    given = ("hardness = 6.0e9", 'hardness = "effective"\nyield_stress = 2.0e9')
    case = load_case(write_case(given))
    material = case.material
    expected = effective_hardness(
        yield_stress=2e9, young_modulus=material.young_modulus, rms_slope=0.1, mean_pressure=5e8,
        poisson_ratio=material.poisson_ratio,
    )  # fmt: skip
    assert material.hardness == expected.value
    with pytest.raises(InvalidCase, match=r"\[material\] yield_stress is inf"):
        load_case(write_case((given[0], 'hardness = "effective"')))
    with pytest.raises(InvalidCase, match="hardness is 'efective', but must be"):
        load_case(write_case((given[0], 'hardness = "efective"')))


def test_a_surface_off_the_map_s_kind_is_refused(tmp_path) -> None:
    punch = tmp_path / "punch-capped-light.toml"
    text = (CASES / punch.name).read_text(encoding="utf-8")
    punch.write_text(text.replace("hardness = 1.0e9", 'hardness = "effective"'), encoding="utf-8")
    with pytest.raises(InvalidCase, match="known for surfaces of kind self_affine only"):
        load_case(punch)


def test_a_path_gives_the_hardness_that_a_single_load_gives() -> None:
    point = Point(5.0, 0.3, seed=1, nodes=12, waves=2, largest=0.25)
    areas = measured_areas([point], lambda _: None)
    assert set(areas["load"]) == {0.1, 0.25}
    (light, _) = 1 / inverse_hardness(areas)["inverse"]
    scene = replace(point.scene, load=Load(point.scene.load.path[0]))
    found = measured_hardness(scene, coarse=False)
    # One interpolates areas between the caps of the ladder, the other searches the cap.
    assert light == pytest.approx(found.ratio, rel=0.03)


def made_up(inverse, points) -> pd.DataFrame:
    """Areas of bodies whose cap of equal area is known; under it the area is m/c."""
    rows = []
    for point in points:
        for load in LOADS[:3]:
            c = 1 / inverse(point, load)
            for cap in (*LADDER, math.inf):
                fields = {name: getattr(point, name) for name in Point.__dataclass_fields__}
                area = min(1.0, load / cap) if cap > load else 1.0
                rows.append(
                    fields | {"load": load, "j2_area": load / c, "cap": cap, "cap_area": area}
                )
    return pd.DataFrame(rows)


def test_the_map_takes_off_the_grid_and_says_how_much_surfaces_scatter() -> None:
    def inverse(point: Point, load: float) -> float:
        exact = 0.4 + 0.02 * load - 0.01 * math.log(point.severity)
        of_grid = 1 + 0.1 * (24 / point.nodes if point.waves == 4 else 1)
        of_spectrum = 1.05 if point.hurst != 0.8 else 1.0
        return exact * of_grid * of_spectrum * (1 + 0.02 * (-1) ** point.seed)

    kinds = [{}, {"nodes": 48}, {"hurst": 0.4}, {"waves": 2, "nodes": 12}]
    points = [
        Point(s, 0.3, seed, **(USUAL | kind))
        for s in (5.0, 15.0, 50.0) for seed in (1, 2) for kind in kinds
    ]  # fmt: skip
    found = mapped(made_up(inverse, points))
    exact = 0.4 + 0.02 * found["load"] - 0.01 * np.log(found["severity"])
    # The grids differ by 1.1 to 1.05; half as much again is taken off, and half is the error.
    change = 0.05 / 1.1
    np.testing.assert_allclose(
        found["inverse_hardness"], exact * 1.1 * (1 - 1.5 * change), rtol=2e-3
    )
    np.testing.assert_allclose(found["grid_error"], change / 2, rtol=0.05)
    # Two surfaces, 2 % from their mean: 2.8 % of scatter, twice that over the root of two.
    np.testing.assert_allclose(found["statistical_error"], 0.04, rtol=0.05)
    np.testing.assert_allclose(found["spectrum_error"], 0.05 / math.sqrt(2), rtol=0.1)


def test_the_chart_draws_the_kept_map() -> None:
    assert "hardness-map" in STUDIES
    drawn = charts("fast", lambda _: None)
    assert len(drawn) == np.unique(hardness_map()["poisson_ratio"]).size
    names = {row[0] for row in drawn[0].rows}
    assert {"E* xi / sigma_Y = 50", "50, formula"} <= names


def test_asperities_persist_where_a_cap_would_have_closed() -> None:
    table = area_table(5.0, [1], 24, lambda _: None)
    areas = table.pivot_table(index="load", columns="series", values="area")
    assert areas[J2].is_monotonic_increasing
    assert areas[TABORS][3.0] == 1
    # Above the cap of light loads, 1.96 sigma_Y, the J2 body is still open.
    assert areas[J2][2.0] < 0.95
    # Tabor's cap is too hard for so elastic a body, and the map's cap is nearer.
    inside = areas[areas[EFFECTIVE].notna()]
    assert (inside[TABORS] < inside[J2]).all()
    off = {name: np.abs(inside[name] / inside[J2] - 1).mean() for name in (TABORS, EFFECTIVE)}
    assert off[EFFECTIVE] < off[TABORS] / 2
    assert {row[0] for row in draw_areas(table, 5.0).rows} == set(table["series"])
