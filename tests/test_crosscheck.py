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

import fem_check
from epcontact import bem
from epcontact.errors import InvalidCase, InvalidScene
from epcontact.harness.case_files.case import Case, load_case
from epcontact.harness.crosscheck import crosscheck, error_budget, measured_hardness
from epcontact.harness.gates.distances import Difference, difference
from epcontact.harness.quantities.model_difference import combined
from epcontact.results import Areas, ContactResult, LoadStep, PressureDistribution, Provenance
from epcontact.scene import Body, Scene
from epcontact.studies.hardness import model_scene
from epcontact.surfaces import Sinusoid

# --- the budget ----------------------------------------------------------------------------------


@pytest.mark.parametrize("dimensions", [1, 2])
def test_the_budget_tells_the_parts_apart(dimensions: int) -> None:
    nodes, highest = (48, 6) if dimensions == 2 else (128, 8)
    scene = rough_scene(nodes, highest, dimensions=dimensions)
    j2 = fem_check.solve(scene, certified=False)
    model, solver, discretisation, depth = error_budget(scene, "j2", j2).values()
    # The same discrete body: nothing but rounding and the solvers' tolerances.
    assert solver.nodes == 0
    assert solver.pressure < 1e-5
    # A depth chosen to hide the base to 0.1 % of the longest wave.
    assert depth.pressure < 1e-3
    # 8 (or 16) points a wave: per cents, and far above the other two.
    assert 1e-2 < discretisation.pressure < 0.1
    assert model.pressure > 2 * discretisation.pressure
    assert model.area > 0.03
    # Each part begins at the body at which the one before it ends: the elements with J2 first, the
    # scene's own half-space last.
    assert model.areas == (j2.final.areas["raw"].total, solver.areas[1])
    assert solver.areas[1] == discretisation.areas[0]
    assert discretisation.areas[1] == depth.areas[0]
    assert depth.areas[1] == bem.solve(scene).final.areas["raw"].total


def test_each_part_falls_with_what_it_is_the_error_of() -> None:
    coarse, fine = (error_budget(rough_scene(n, 4)) for n in (32, 64))
    # First order: halved by twice the grid, here and there by a little less.
    assert fine["discretisation"].pressure < coarse["discretisation"].pressure / 1.7
    assert fine["depth"].pressure == pytest.approx(coarse["depth"].pressure, rel=0.5)
    # The base's influence falls as exp(-2 q d), and a thin layer is stiffer than the half-space.
    budgets = (error_budget(rough_scene(32, 4), "elastic", depth=d) for d in (0.15, 0.4, 0.8))
    thin, shallow, deep = (budget["depth"] for budget in budgets)
    assert deep.pressure < shallow.pressure / 20
    assert thin.area < 0


def answer(pressure: list[float], low: float) -> ContactResult:
    """Pressures, tabulated as spread evenly over (low, low + 1)."""
    sigma, p = np.linspace(0, 2, 20001), np.array(pressure)
    step = LoadStep(1.0, {"raw": Areas(0.5, 0.5, 0.0)})
    table = PressureDistribution(sigma, np.clip(sigma - low, 0, 1))
    fields = {"pressure": p, "state": (p > 0).astype(int)}
    return ContactResult("bem", (step,), Provenance("known"), table, fields)


def test_differences_of_known_answers() -> None:
    one, other = answer([1.0, 1, 1, 1, 0, 0], 0.2), answer([0.0, 0, 2, 2, 2, 0], 0.5)
    assert difference(one, one, 4.0) == Difference(0.0, 0.0, 1.0, 0.0, 0, (4 / 6, 4 / 6))
    found = dataclasses.astuple(difference(one, other, 4.0))
    assert found[:5] == pytest.approx((1 / 3, math.sqrt(8 / 12), 2 / 5, 0.3 / 4, 3), rel=2e-4)
    with pytest.raises(InvalidScene, match="cannot be compared"):
        difference(answer([1.0], 0.2), one, 4.0)


# --- the effective hardness ----------------------------------------------------------------------


def test_each_part_of_the_error_is_that_of_a_solve_that_differs_in_it() -> None:
    scene = rough_scene(16, 2, hardness=math.inf)
    found = measured_hardness(scene, steps=2)
    depth = fem_check.solve(scene, steps=2, certified=False).provenance.options["depth"]
    shallow = measured_hardness(scene, steps=2, depth=0.75 * depth, coarse=False)
    fewer = measured_hardness(scene, steps=1, coarse=False)
    assert set(found.parts) == {"node", "grid", "depth", "steps"}
    assert found.parts["depth"] == pytest.approx(found.ratio - shallow.ratio, abs=1e-9)
    assert found.parts["steps"] == pytest.approx(found.ratio - fewer.ratio, abs=1e-9) != 0
    tight = measured_hardness(scene, step_tolerance=0.002, coarse=False)
    assert set(tight.parts) == {"node"}
    assert tight.ratio == pytest.approx(found.ratio, abs=3 * found.error)


# --- the report on a case ------------------------------------------------------------------------

SMALLER = (("[48, 48]", "[24, 24]"), ("[5, 6, 7, 8, 9, 10, 11, 12]", "[5]"))
ELASTIC = ('law = "j2"', 'law = "elastic"')


@pytest.fixture
def tiny(tmp_path: Path) -> Callable[..., Case]:
    """fem-model-5 on one surface of 24 x 24 nodes, with replacements."""

    def load(*replacements: tuple[str, str]) -> Case:
        text, path = J2_CASE, tmp_path / "fem-model-5.toml"
        for old, new in (*SMALLER, *replacements):
            text = text.replace(old, new)
        path.write_text(text, encoding="utf-8")
        return load_case(path)

    return load


def test_a_case_is_cross_checked_in_words(tiny) -> None:
    head, budget, areas, effective = crosscheck(case := tiny()).splitlines()
    assert head == "fem-model-5, fast, seed 5"
    assert budget.startswith("  fem j2 against bem: model: ")
    # A layer: the boundary elements know its depth, too.
    assert budget.endswith("depth: area +0.00%, pressure 0.0e+00")
    j2 = fem_check.solve(case.scene(case.recipes[0]), certified=False)
    assert f"j2 touches on {j2.final.areas['raw'].total:.4f}, the capped body on 0." in areas
    ratio, error = (float(word) for word in re.findall(r"c_eff = (\S+) \+- (\S+) ", effective)[0])
    assert 1.5 < ratio < 2.6
    assert 0 < error < 2
    _, elastic = crosscheck(tiny(ELASTIC)).splitlines()
    assert elastic.startswith("  fem elastic against bem: solver: ")
    assert crosscheck(tiny(("[24, 24]", "[15, 15]"))).endswith("; no coarser grid in the error")


def test_an_ensemble_is_summed_up_with_its_standard_errors(tiny) -> None:
    *alone, head = (lines := crosscheck(tiny(), seeds=[21, 22], steps=4).splitlines())[:-10]
    assert [line[-2:] for line in alone if "seed" in line] == ["21", "22"]
    assert head.startswith("fem-model-5, fast, 2 surfaces: mean +- standard error")
    summed = dict(line.strip().split(": ") for line in lines[-10:-1])
    low, high = sorted(float(r) for r in re.findall(r"c_eff = (\S+) ", "\n".join(alone)))
    numbers = re.findall(r"[+-]?\d\.\d+", summed["effective hardness c_eff"])
    expected = ((low + high) / 2, (high - low) / 2, (high - low) / math.sqrt(2))
    assert [float(number) for number in numbers] == pytest.approx(expected, abs=1e-3)
    assert float(summed["model, area"].split()[0]) > 0
    assert {"its change by the grid", "its change by the steps"} < set(summed)
    # The error of the mean: the scatter of the surfaces, and what all of them share.
    parts = {k: float(v) for k, v in re.findall(r"(seeds|grid|steps) ([+-]\S+?)[,)]", lines[-1])}
    found = re.findall(r"mean c_eff = (\S+) \+- (\S+) ", lines[-1])[0]
    assert [float(x) for x in found] == pytest.approx([expected[0], combined(parts)], abs=4e-3)
    assert parts["seeds"] == pytest.approx(expected[1], abs=1e-3)
    # Between the peak under a sphere at first yield and what the most confined contact bears.
    assert 1.6 < float(summed["largest pressure of j2 over sigma_Y"].split()[0]) < 3.5


@pytest.mark.parametrize(
    ("edits", "options", "sentence"),
    [
        ([('"fem", "bem"]', '"fem"]')], {}, "lacks bem"),
        ([("mean_pressure = 5.7692e+08", "mean_pressure = [1e8, 5e8]")], {}, "is a path of 2"),
        ([('law = "j2"', 'law = "j2"\ngeometry = "moved"')], {}, "fem.geometry is 'moved'"),
        ([ELASTIC], {"steps": 4}, r"steps is for fem.law = 'j2' only"),
        ([], {"steps": 4, "step_tolerance": 0.1}, "either steps or step_tolerance"),
        ([], {"seeds": [3, 3]}, "different numbers"),
    ],
)
def test_what_cannot_be_cross_checked_is_refused(tiny, edits, options, sentence) -> None:
    with pytest.raises(InvalidCase, match=sentence):
        crosscheck(tiny(*edits), **options)
    wavy = tiny().changed(recipes=(Sinusoid((1e-3,) * 2, (16, 16), 1e-6),))
    with pytest.raises(InvalidCase, match="surface is not random"):
        crosscheck(wavy, seeds=[1, 2])


# --- whether the error bars hold -----------------------------------------------------------------

#: c_eff of 20 scenes on 48 x 48 nodes, as `measured_hardness(scene_of(k, 48), coarse=False)` gives
#: it; the first three with step_tolerance=0.01.
FINE = """
1.913 2.019 2.819 2.451 1.592 2.634 2.743 2.488 2.104 2.387
2.692 2.632 1.985 2.290 2.820 2.689 1.514 2.512 2.651 2.623
"""


def scene_of(k: int, nodes: int) -> Scene:
    severity, nu = (5.0, 15.0, 50.0, 30.0)[k % 4], (0.3, 0.0, 0.45)[k % 3]
    scene = model_scene(severity, nu, 201 + k, nodes, waves=2)
    return dataclasses.replace(scene, body=Body()) if k % 2 == 0 else scene


@pytest.mark.long  # some two minutes
def test_the_error_bars_hold_the_ratios_of_a_fine_grid() -> None:
    """Of 20 bars 19 hold; one may be infinite, as half of its grid has no cap of equal area."""
    found = [measured_hardness(scene_of(k, 16 if k < 10 else 24)) for k in range(20)]
    fine = map(float, FINE.split())
    assert sum(abs(own.ratio - c) <= own.error for own, c in zip(found, fine, strict=True)) >= 19
    assert sum(math.isfinite(each.error) for each in found) >= 19
    # On grids as coarse as these they are wide: 0.29 of the ratio on the median.
    assert np.median([each.error / each.ratio for each in found]) < 0.35
    assert all(("depth" in each.parts) == (k % 2 == 0) for k, each in enumerate(found) if k)
