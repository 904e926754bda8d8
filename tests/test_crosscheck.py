"""The parts of a difference between finite and boundary elements, and the effective hardness."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fem_scenes import J2_CASE, rough_scene
from reference_plasticity import sphere_onset

import fem_check
from epcontact import bem
from epcontact.errors import InvalidCase, InvalidScene
from epcontact.harness.case_files.case import load_case
from epcontact.harness.crosscheck import (
    Difference,
    EffectiveHardness,
    crosscheck,
    difference,
    error_budget,
    measured_hardness,
)
from epcontact.harness.quantities.model_difference import combined
from epcontact.scene import Body, Scene
from epcontact.studies.hardness import model_scene
from epcontact.surfaces import Sinusoid


@pytest.mark.parametrize("dimensions", [1, 2])
def test_the_budget_tells_the_parts_apart(dimensions: int) -> None:
    said: list[str] = []
    nodes, highest = (48, 6) if dimensions == 2 else (128, 8)
    scene = rough_scene(nodes, highest, dimensions=dimensions)
    budget = error_budget(scene, law="j2", report=said.append)
    # The same discrete body: nothing but rounding and the solvers' tolerances.
    assert budget.solver.nodes == 0
    assert budget.solver.pressure < 1e-5
    # A depth chosen to hide the base to 0.1 % of the longest wave.
    assert budget.depth.pressure < 1e-3
    # 8 (or 16) points a wave: per cents, and far above the other two.
    assert 1e-2 < budget.discretisation.pressure < 0.1
    assert budget.model is not None
    assert budget.model.pressure > 2 * budget.discretisation.pressure
    assert budget.model.area > 0.03
    assert said == [str(budget)]
    assert said[0].count(";") == 3
    assert "\n" not in said[0]


def test_the_discretisation_alone_falls_with_the_grid() -> None:
    budgets = [error_budget(rough_scene(n, 4), report=None) for n in (32, 64)]
    parts = np.array([[b.discretisation.pressure, b.depth.pressure] for b in budgets])
    # First order: halved by twice the grid, here and there by a little less.
    assert parts[1, 0] < parts[0, 0] / 1.7
    np.testing.assert_allclose(parts[1, 1], parts[0, 1], rtol=0.5)


def test_the_depth_alone_falls_with_the_depth() -> None:
    found = [
        error_budget(rough_scene(32, 4), law="elastic", depth=d, report=None) for d in (0.4, 0.8)
    ]
    # The base's influence falls as exp(-2 q d): by 150 here.
    assert found[1].depth.pressure < found[0].depth.pressure / 20
    assert found[0].depth.pressure > 1e-3


def test_a_layer_has_no_depth_part() -> None:
    scene = rough_scene(32, 4, body=Body("sliding_layer", 0.4))
    assert error_budget(scene, report=None).depth.pressure == 0


def test_differences_of_known_answers() -> None:
    scene = rough_scene(32, 4)
    one = bem.solve(scene)
    same = difference(one, one, 0.6)
    area = one.final.areas["raw"].total
    assert same == Difference(0.0, 0.0, 1.0, 0.0, 0, (area, area))
    fields = dict(one.fields)
    fields["pressure"] = 1.01 * fields["pressure"]
    assert difference(dataclasses.replace(one, fields=fields), one, 0.6).pressure == pytest.approx(
        0.01
    )
    with pytest.raises(InvalidScene, match="cannot be compared"):
        difference(bem.solve(rough_scene(16, 4)), one, 0.6)


def test_the_effective_hardness_gives_the_area_of_the_j2_body() -> None:
    scene = rough_scene(32, 4, hardness=math.inf)
    found = measured_hardness(scene)
    assert found.severity == pytest.approx(5, rel=1e-9)
    # nu = 0.3 at E* xi/sigma_Y = 5: 1.9 to 2.1 on every surface and grid tried.
    assert 1.85 < found.ratio < 2.15
    assert 0 < found.error < 0.6  # mostly by 8 nodes a wave, of which the half has 4
    at_cap = dataclasses.replace(scene.material, hardness=found.ratio * 0.2)
    capped = bem.solve(
        dataclasses.replace(scene, material=at_cap),
        compliance=fem_check.surface_compliance(scene),
    )
    # Bisection to 1e-4 of the ratio: the area may jump by a few nodes there.
    assert capped.final.areas["raw"].total == pytest.approx(found.area, abs=3 / 32**2)
    assert found.at_cap is not None
    assert found.at_cap.overlap > 0.9
    assert "c_eff = " in str(found)


def test_each_part_of_the_error_is_that_of_a_solve_that_differs_in_it() -> None:
    scene = rough_scene(16, 2, hardness=math.inf)
    found = measured_hardness(scene, steps=2)
    depth = fem_check.solve(scene, steps=2, certified=False).provenance.options["depth"]
    others = {
        "depth": measured_hardness(scene, steps=2, depth=0.75 * depth, coarse=False),
        "steps": measured_hardness(scene, steps=1, coarse=False),
    }
    assert set(found.parts) == {"node", "grid", *others}
    for name, other in others.items():
        assert found.parts[name] == pytest.approx(found.ratio - other.ratio, abs=1e-9)
    assert found.parts["steps"] != 0
    assert found.error == combined(found.parts)
    tight = measured_hardness(scene, step_tolerance=0.002, coarse=False)
    assert set(tight.parts) == {"node"}
    assert tight.ratio == pytest.approx(found.ratio, abs=3 * found.error)


def test_a_body_that_hardly_flows_has_no_effective_hardness() -> None:
    scene = rough_scene(32, 4, yield_stress=10.0, hardness=math.inf)
    found = measured_hardness(scene)
    assert found.ratio == math.inf
    assert found.at_cap is None


def test_paths_and_odd_grids_are_refused() -> None:
    path = rough_scene(16, 4, pressure=(0.01, 0.02))
    for function in (error_budget, measured_hardness):
        with pytest.raises(InvalidScene, match="path of 2 mean pressures"):
            function(path)
    with pytest.raises(InvalidScene, match="no half"):
        measured_hardness(rough_scene(15, 3, hardness=math.inf))


@pytest.fixture
def tiny(tmp_path: Path) -> Callable[..., Path]:
    """fem-model-5 on one surface of 24 x 24 nodes, with replacements."""

    def write(*replacements: tuple[str, str]) -> Path:
        text = J2_CASE
        for old, new in (
            ("[48, 48]", "[24, 24]"),
            ("[5, 6, 7, 8, 9, 10, 11, 12]", "[5]"),
            *replacements,
        ):
            assert old in text, old
            text = text.replace(old, new)
        path = tmp_path / "fem-model-5.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_a_case_is_cross_checked_in_words(tiny) -> None:
    case = load_case(tiny())
    head, budget, areas, effective = crosscheck(case).splitlines()
    assert head == "fem-model-5, fast, seed 5"
    assert budget.startswith("  fem j2 against bem: model: ")
    # A layer: the boundary elements know its depth, too.
    assert budget.endswith("depth: area +0.00%, pressure 0.0e+00")
    # The areas said are those of the two bodies.
    found = [float(word) for word in re.findall(r"on (\d\.\d+)", areas)]
    j2 = fem_check.solve(case.scene(case.recipes[0]), certified=False)
    assert found[0] == pytest.approx(j2.final.areas["raw"].total, abs=1e-4)
    assert found[0] > found[1]
    assert "of the hardness" in areas
    ratio, error = (float(word) for word in re.findall(r"c_eff = (\S+) \+- (\S+) ", effective)[0])
    assert 1.5 < ratio < 2.6
    assert 0 < error < 2


def test_an_elastic_case_has_a_budget_and_no_model(tiny) -> None:
    lines = crosscheck(load_case(tiny(('law = "j2"', 'law = "elastic"')))).splitlines()
    assert len(lines) == 2
    assert lines[1].startswith("  fem elastic against bem: solver: ")


def test_an_odd_grid_says_what_its_error_lacks(tiny) -> None:
    text = crosscheck(load_case(tiny(("[24, 24]", "[15, 15]"))))
    assert text.endswith("; no coarser grid in the error")


def test_an_ensemble_is_summed_up_with_its_standard_errors(tiny) -> None:
    case = load_case(tiny())
    lines = crosscheck(case, seeds=[21, 22], steps=4).splitlines()
    alone, head = lines[:-11], lines[-11]
    _, area, _, _, largest, hardness, grid, steps, _, mean_line = lines[-10:]
    assert [line for line in alone if "seed" in line] == [
        "fem-model-5, fast, seed 21",
        "fem-model-5, fast, seed 22",
    ]
    assert head.startswith("fem-model-5, fast, 2 surfaces: mean +- standard error")
    ratios = [float(r) for r in re.findall(r"c_eff = (\S+) ", "\n".join(alone))]
    low, high = sorted(ratios)
    mean, error, deviation = (float(x) for x in re.findall(r"[+-]?\d\.\d+", hardness))
    assert mean == pytest.approx((low + high) / 2, abs=1e-3)
    assert error == pytest.approx((high - low) / 2, abs=1e-3)
    assert deviation == pytest.approx((high - low) / math.sqrt(2), abs=1e-3)
    assert area.startswith("  model, area: +")
    assert grid.startswith("  its change by the grid: ")
    assert steps.startswith("  its change by the steps: ")
    # The error of the mean: the scatter of the surfaces, and what all of them share.
    parts = [float(x) for x in re.findall(r"(?:seeds|grid|steps) ([+-]\S+?)[,)]", mean_line)]
    named = dict(zip(("seeds", "grid", "steps"), parts, strict=True))
    found = re.findall(r"mean c_eff = (\S+) \+- (\S+) ", mean_line)[0]
    assert [float(x) for x in found] == pytest.approx([mean, combined(named)], abs=4e-3)
    assert parts[0] == pytest.approx(error, abs=1e-3)
    # Between the peak under a sphere at first yield and what the most confined contact bears.
    assert 1.6 < float(re.findall(r"\d\.\d+", largest)[0]) < 3.5


def test_seeds_and_steps_that_mean_nothing_are_refused(tiny) -> None:
    with pytest.raises(InvalidCase, match=r"steps is for fem.law = 'j2' only"):
        crosscheck(load_case(tiny(('law = "j2"', 'law = "elastic"'))), steps=4)
    case = load_case(tiny())
    with pytest.raises(InvalidCase, match="either steps or step_tolerance"):
        crosscheck(case, steps=4, step_tolerance=0.1)
    with pytest.raises(InvalidCase, match="different numbers"):
        crosscheck(case, seeds=[3, 3])
    wavy = case.changed(recipes=(Sinusoid((1e-3,) * 2, (16, 16), 1e-6),))
    with pytest.raises(InvalidCase, match="surface is not random"):
        crosscheck(wavy, seeds=[1, 2])


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('"fem", "bem"]', '"fem"]', "lacks bem"),
        ("mean_pressure = 5.7692e+08", "mean_pressure = [1.0e8, 5.0e8]", "is a path of 2"),
        ('law = "j2"', 'law = "j2"\ngeometry = "moved"', "fem.geometry is 'moved'"),
    ],
)
def test_a_case_that_cannot_be_cross_checked_is_refused(
    tiny, old: str, new: str, sentence: str
) -> None:
    with pytest.raises(InvalidCase, match=sentence):
        crosscheck(load_case(tiny((old, new))))


def severities(seed: int, nu: float, severity: float) -> EffectiveHardness:
    scene = rough_scene(
        64, 8, seed=seed, poisson_ratio=nu, yield_stress=1 / severity, hardness=math.inf,
        pressure=0.25 / severity,
    )  # fmt: skip
    return measured_hardness(scene, coarse=False, steps=4)


@pytest.mark.long
def test_the_effective_hardness_rises_towards_three_yield_stresses() -> None:
    """With E* xi/sigma_Y, for every Poisson's ratio, from above the mean pressure at which a
    sphere first yields; the cases fem-model-* gate the figures themselves."""
    for nu in (0.0, 0.3, 0.45):
        onset = 2 / 3 * sphere_onset(nu)[0]
        ratios = [severities(11, nu, s).ratio for s in (5.0, 15.0, 50.0)]
        assert ratios == sorted(ratios)
        assert onset < ratios[0]
        assert ratios[-1] < 3
    # nu = 0 is the softest: the mean pressure alone shears it.
    assert severities(7, 0.0, 5.0).ratio < severities(7, 0.3, 5.0).ratio


#: c_eff of 20 scenes on 48 x 48 nodes, as `measured_hardness(scene_of(k, 48), coarse=False)` gives
#: it; the first three with step_tolerance=0.01.
FINE = (
    1.913,
    2.019,
    2.819,
    2.451,
    1.592,
    2.634,
    2.743,
    2.488,
    2.104,
    2.387,
    2.692,
    2.632,
    1.985,
    2.290,
    2.820,
    2.689,
    1.514,
    2.512,
    2.651,
    2.623,
)
#: The grids on which their error bars are judged.
NODES = (16,) * 10 + (24,) * 10


def scene_of(k: int, nodes: int) -> Scene:
    severity, nu = (5.0, 15.0, 50.0, 30.0)[k % 4], (0.3, 0.0, 0.45)[k % 3]
    scene = model_scene(severity, nu, 201 + k, nodes, waves=2)
    return dataclasses.replace(scene, body=Body()) if k % 2 == 0 else scene


# Some two minutes.
@pytest.mark.long
def test_the_error_bars_hold_the_ratios_of_a_fine_grid() -> None:
    """Of 20 bars, 19; one may be infinite: half of its grid has no cap of equal area."""
    found = [measured_hardness(scene_of(k, nodes)) for k, nodes in enumerate(NODES)]
    held = [abs(own.ratio - fine) <= own.error for own, fine in zip(found, FINE, strict=True)]
    assert sum(held) >= 19
    assert sum(math.isfinite(each.error) for each in found) >= 19
    # On grids as coarse as these they are wide: 0.29 of the ratio on the median.
    assert np.median([each.error / each.ratio for each in found]) < 0.35
    assert all(("depth" in each.parts) == (k % 2 == 0) for k, each in enumerate(found) if k)
