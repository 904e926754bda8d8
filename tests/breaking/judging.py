"""Faults of the harness: measurements, statistics, gates, verdict, kept results."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from breaking.fault import Fault, Patch, at, changed, given, on_result, scaled
from epcontact.harness.quantities import QUANTITIES

H = "epcontact.harness."


def _blind(name: str) -> Patch:
    """A measured quantity that is always zero."""

    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(QUANTITIES, name, replace(QUANTITIES[name], measure=lambda a: 0.0))

    return patch


def _fault(what: str, patch: Patch, *seen: Any, **more: Any) -> Fault:
    return Fault(what, "harness", patch, *seen, **more)


def _without_width(estimate: Any) -> Any:
    return estimate.model_copy(update={"half_width": 0.0})


def _median(original: Callable[..., Any]) -> Callable[..., Any]:
    def wrong(values: Any) -> Any:
        return original(values).model_copy(update={"mean": float(np.median(values))})

    return wrong


def _elastic(case: Any, recipe: Any) -> tuple[Any, Any]:
    return replace(case, material=replace(case.material, hardness=math.inf)), recipe


MEASURES = "tests/test_closed_forms.py::test_measures_see_what_is_wrong_by_as_much_as_it_is"

FAULTS = (
    # comparison
    _fault(
        "no distance between distributions", at(H + "verdict.distance", lambda *_: 0.0),
        "yardstick", "distribution",
    ),
    _fault(
        "distance not divided by its scale", scaled(H + "verdict.distance", 1e9),
        "yardstick", "distribution",
    ),
    _fault(
        "the reference's distribution compared with itself",
        given(H + "verdict.distance", lambda norm, a, b, hardness: (norm, b, b, hardness)),
        "yardstick", "distribution",
    ),
    _fault(
        "the supremum for the Wasserstein distance",
        given(H + "verdict.distance", lambda norm, *rest: ("supremum", *rest)),
        "yardstick", "distribution",
    ),
    _fault(
        "carried pressure without the factor 1/2", scaled(H + "distances.carried_pressure", 2.0),
        "yardstick", "distribution",
    ),
    _fault(
        "absolute for relative",
        at(H + "gates.deviation", lambda norm, value, reference: value - reference),
        "yardstick", "area.total.raw", 0.5,
    ),
    _fault(
        "relative to the value, not to the reference",
        changed(H + "gates.deviation", lambda f: lambda norm, a, b: -f(norm, b, a)),
        "yardstick", "area.total.raw", 0.5,
    ),
    _fault(
        "sign of a difference lost",
        changed(H + "gates.deviation", lambda f: lambda *a: abs(f(*a))),
        "yardstick", "area.total.raw", 1.5,
    ),
    _fault(
        "half a difference", scaled(H + "gates.deviation", 0.5), "yardstick", "area.total.raw", 1.5,
    ),
    _fault(
        "distance of a field not measured", at(H + "quantities.l2_distance", lambda *_: 0.0),
        "yardstick", "field.pressure",
    ),
    _fault(
        "the maximum norm for L2",
        at(H + "quantities.l2_distance", lambda a, b: float(np.abs(a - b).max() / np.abs(b).max())),
        "yardstick", "field.pressure",
    ),
    _fault(
        "L2 relative to the answer, not to the closed form",
        given(H + "quantities.l2_distance", lambda a, b: (b, a)),
        "yardstick", "field.pressure",
    ),
    _fault(
        "the first load step judged, not the last",
        at("epcontact.results.ContactResult.final", property(lambda self: self.steps[0])),
        "fem-uniaxial", "quantity.approach",
    ),
    _fault(
        "the closed form of another surface",
        given(
            H + "case.Case.scene",
            lambda case, recipe: (case, replace(recipe, amplitude=1.01 * recipe.amplitude)),
        ),
        "westergaard-line", "quantity.surface_rms_height",
    ),
    _fault(
        "the hardness of a case lost",
        given(H + "case.Case.scene", _elastic),
        "punch-capped", "area.plastic.corrected", status="error",
    ),
    # statistics
    _fault(
        "intervals without width", on_result(H + "gates.estimate", _without_width),
        test="tests/test_compare.py::test_gate_holds_only_if_the_whole_interval_does",
    ),
    _fault(
        "an interval of 68 %", at(H + "statistics.CONFIDENCE", 0.68),
        test="tests/test_compare.py::test_interval_is_students",
    ),
    _fault(
        "the interval of a single value for that of the mean",
        changed(H + "statistics.student_half_width", lambda f: lambda s, n: f(s, n) * n**0.5),
        test="tests/test_compare.py::test_interval_is_students",
    ),
    # measurements
    *(
        _fault(f"{name} always zero", _blind(f"quantity.{name}"), test=MEASURES)
        for name in ("measured_force", "measured_bounds", "measured_gap", "measured_carried")
    ),
    # gates and verdict
    _fault(
        "the default gates dropped", at(H + "case_gates.default_gates", lambda: ()),
        test="tests/test_casefile.py::test_a_case_has_the_default_gates_of_its_methods",
    ),
    _fault(
        "a shortfall passes", at(H + "verdict.FALLS_SHORT", "fell short"),
        test="tests/test_verify.py::test_status_and_exit_code",
    ),
    _fault(
        "an error passes", at(H + "verdict.ERROR", "failed"),
        test="tests/test_verify.py::test_method_without_answer_is_an_error_not_a_shortfall",
    ),
)  # fmt: skip
