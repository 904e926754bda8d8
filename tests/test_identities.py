"""Identities between the parts of a result, and the judge of known comparisons."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from epcontact import Load, Material, Scene, bem
from epcontact.errors import InvalidCase
from epcontact.harness.answers.store import Answer
from epcontact.harness.quantities.registry import measure
from epcontact.results import Areas, ContactResult
from epcontact.surfaces import Sinusoid

SURFACE = Sinusoid((1.0, 0.75), (16, 12), amplitude=0.01, direction="both").build()
SCENE = Scene(SURFACE, Material(1.0, 0.3, hardness=0.05), Load((0.008, 0.01, 0.012)))


@pytest.fixture(scope="module")
def honest() -> ContactResult:
    return bem.solve(SCENE, threads=1)


def measured(name: str, result: ContactResult) -> float:
    return measure(f"quantity.{name}", SCENE, result)


def with_step(result: ContactResult, number: int, **changes: object) -> ContactResult:
    steps = list(result.steps)
    steps[number] = replace(steps[number], **changes)
    return replace(result, steps=tuple(steps))


def with_figure(result: ContactResult, number: int, name: str, factor: float) -> ContactResult:
    quantities = dict(result.steps[number].quantities)
    return with_step(result, number, quantities=quantities | {name: factor * quantities[name]})


def test_an_honest_result_holds_every_identity(honest) -> None:
    for name in ("areas", "figures", "fields", "distribution"):
        # The open gap of an earlier load leaves out what the solver's tolerance lets overlap.
        assert measured(f"measured_{name}", honest) < (1e-8 if name == "figures" else 1e-12)
    assert measured("distribution_balance", honest) < 0.05
    assert abs(measured("path_work", honest)) < 0.05


@pytest.mark.parametrize(
    "figure",
    ["mean_gap", "mean_separation", "mean_plastic_displacement", "elastic_energy"],
)
def test_a_wrong_figure_is_a_wrong_figure(honest, figure) -> None:
    assert measured("measured_figures", with_figure(honest, -1, figure, 1.01)) > 1e-5


@pytest.mark.parametrize("step", [0, 1, 2])
def test_the_work_sees_every_step_of_a_path(honest, step) -> None:
    wrong = with_figure(honest, step, "mean_separation", 1.01)
    assert abs(measured("path_work", wrong) - measured("path_work", honest)) > 1e-3


def test_a_repeated_load_does_no_work(honest) -> None:
    first, second, third = honest.steps
    path = Load((*SCENE.load.path[:2], *SCENE.load.path[1:]))
    twice = replace(honest, steps=(first, second, second, third))
    again = measure("quantity.path_work", replace(SCENE, load=path), twice)
    assert again == measured("path_work", honest)


def test_the_areas_of_every_step_must_add_up(honest) -> None:
    wrong = dict(honest.steps[0].areas) | {"corrected": Areas(0.5, 0.1, 0.1)}
    assert measured("measured_areas", with_step(honest, 0, areas=wrong)) == pytest.approx(0.3)
    swapped = replace(honest, steps=honest.steps[::-1])
    assert measured("measured_areas", swapped) > 0.1
    with pytest.raises(InvalidCase, match="2 load steps for 3 mean pressures"):
        measured("measured_areas", replace(honest, steps=honest.steps[1:]))


@pytest.mark.parametrize("name", ["gap", "displacement", "state", "heights"])
def test_a_field_turned_round_is_a_wrong_field(honest, name) -> None:
    turned = dict(honest.fields) | {name: np.roll(honest.fields[name], 3, 0)}
    assert measured("measured_fields", replace(honest, fields=turned)) > 1e-2


def test_what_is_missing_is_said(honest) -> None:
    single = replace(SCENE, load=Load(0.012))
    with pytest.raises(InvalidCase, match="three mean pressures or more"):
        measure("quantity.path_work", single, replace(honest, steps=honest.steps[-1:]))
    without = replace(honest, distribution=None)
    for name in ("measured_distribution", "distribution_balance"):
        with pytest.raises(InvalidCase, match="no pressure distribution"):
            measured(name, without)
    with pytest.raises(InvalidCase, match="does not report the residual gap_elastic"):
        measured("measured_residuals", with_step(honest, -1, residuals={}))


def test_a_path_that_ends_as_it_began_is_refused_by_the_name_of_the_quantity(honest) -> None:
    first, second, _ = honest.steps
    there_and_back = replace(SCENE, load=Load((0.008, 0.01, 0.008)))
    result = replace(honest, steps=(first, second, first))
    with pytest.raises(InvalidCase, match=r"quantity\.path_work: .* energy that it began with"):
        measure("quantity.path_work", there_and_back, result)
    nothing = replace(first, areas=dict(first.areas) | {"corrected": Areas(0.0, 0.0, 0.0)})
    bare = replace(honest, steps=(nothing, second, replace(nothing)))
    with pytest.raises(InvalidCase, match=r"quantity\.cycle_area: .* no contact before"):
        measure("quantity.cycle_area", there_and_back, bare)


def test_a_repeated_member_is_found_and_no_other(honest) -> None:
    other = with_figure(honest, -1, "mean_gap", 1.001)
    assert Answer((honest, other), ("seed1", "seed2")).twins is None
    assert Answer((honest, other, honest), ("a", "b", "c")).twins == ("a", "c")
