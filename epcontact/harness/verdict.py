"""The verdict: the gates of cases judged on their answers, as data, JSON and JUnit.

A case *holds* if all its gates do, *falls short* if one does not, is *skipped* where its surface
is not to be had, and is in *error* if a method gave no answer that a gate needs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from junitparser import Error, Failure, JUnitXml, Skipped, TestCase, TestSuite

from epcontact.errors import EpcontactError
from epcontact.harness.case import Case
from epcontact.harness.gates import (
    DISTRIBUTION_NORMS,
    Estimate,
    Gate,
    Verdict,
    distance,
    judge,
    judge_distance,
    read_quantity,
)
from epcontact.harness.run import Answer
from epcontact.output.files import whole_file, write_json
from epcontact.reference import CLOSED_FORMS
from epcontact.results import PressureDistribution, package_versions

HOLDS, FALLS_SHORT, SKIPPED, ERROR = "holds", "falls short", "skipped", "error"


@dataclass(frozen=True)
class GateOutcome:
    """One gate: judged, or the sentence why it could not be."""

    gate: Gate
    verdict: Verdict | None
    error: str = ""

    @property
    def status(self) -> str:
        """holds, falls short or error."""
        if self.verdict is None:
            return ERROR
        return HOLDS if self.verdict.holds else FALLS_SHORT


@dataclass(frozen=True)
class CaseOutcome:
    """All gates of a case."""

    case: Case
    gates: tuple[GateOutcome, ...]
    answers: Mapping[str, Answer]

    @property
    def status(self) -> str:
        """The worst of the gates' statuses, or skipped."""
        if self.case.skip:
            return SKIPPED
        found = {gate.status for gate in self.gates}
        return next((s for s in (ERROR, FALLS_SHORT) if s in found), HOLDS)


def judge_case(case: Case, answers: Mapping[str, Answer]) -> CaseOutcome:
    """Judge every gate of a case on its answers."""
    if case.skip:
        return CaseOutcome(case, (), {})
    return CaseOutcome(case, tuple(_outcome(case, g, answers) for g in case.gates), answers)


def exit_code(outcomes: Sequence[CaseOutcome]) -> int:
    """0 if all gates hold, 1 if one falls short, 2 if one could not be judged."""
    found = {outcome.status for outcome in outcomes}
    return 2 if ERROR in found else 1 if FALLS_SHORT in found else 0


def _outcome(case: Case, gate: Gate, answers: Mapping[str, Answer]) -> GateOutcome:
    needed = [m for m in (gate.of, gate.against) if isinstance(m, str) and m in case.methods]
    failed = [sentence for m in needed for sentence in answers[m].errors]
    if failed:
        return GateOutcome(gate, None, _joined(failed))
    try:
        return GateOutcome(gate, _judge(case, gate, answers))
    except EpcontactError as error:
        return GateOutcome(gate, None, str(error))


def _joined(sentences: Sequence[str]) -> str:
    """Errors of many surfaces as one line; what they share is said once.

    Each is "method, surface: reason", as `run` makes them.
    """
    by_reason: dict[str, list[str]] = {}
    for sentence in dict.fromkeys(sentences):
        where, _, reason = sentence.partition(": ")
        by_reason.setdefault(reason, []).append(where)
    parts = []
    for reason, places in by_reason.items():
        more = f" and {len(places) - 1} more" if len(places) > 1 else ""
        parts.append(f"{places[0]}{more}: {reason}")
    return "; ".join(parts)


def _judge(case: Case, gate: Gate, answers: Mapping[str, Answer]) -> Verdict:
    of = answers[gate.of]
    against = answers.get(str(gate.against))
    if gate.norm in DISTRIBUTION_NORMS:
        return judge_distance(gate, _distances(case, gate, of, against))
    if gate.norm == "l2":
        name = f"quantity.l2.{gate.against}." + gate.quantity.removeprefix("field.")
        return judge_distance(gate, [read_quantity(r, name) for r in of.results])
    value = [read_quantity(result, gate.quantity) for result in of.results]
    if against is not None:
        reference = [read_quantity(result, gate.quantity) for result in against.results]
        paired = len(value) > 1 and of.labels == against.labels
        return judge(gate, value, reference, paired)
    if isinstance(gate.against, str):
        exact = CLOSED_FORMS[gate.against].scalar(gate.quantity, case.scene(case.recipes[0]))
        return judge(gate, value, [exact], False)
    return judge(gate, value, [gate.against], False)


def _distances(case: Case, gate: Gate, of: Answer, against: Answer | None) -> list[float]:
    others: list[PressureDistribution | None]
    if against is None:
        form = CLOSED_FORMS[str(gate.against)]
        others = [form.pressures(case.scene(recipe)) for recipe in case.recipes]
    else:
        others = [result.distribution for result in against.results]
    if len(others) == 1:
        others *= len(of.results)
    if len(others) != len(of.results):
        raise EpcontactError("distributions can be compared with one answer, or one a surface")
    distances: list[float] = []
    for mine, other in zip(of.results, others, strict=True):
        if mine.distribution is None or other is None:
            raise EpcontactError(f"{gate.name}: a method gave no pressure distribution")
        distances.append(distance(gate.norm, mine.distribution, other, case.material.hardness))
    return distances


# --- the verdict as files ----------------------------------------------------------------------


def verdict_json(outcomes: Sequence[CaseOutcome], size: str) -> dict[str, Any]:
    """The verdict as JSON can hold it."""
    return {
        "schema": "epcontact-verdict-1",
        "passed": exit_code(outcomes) == 0,
        "exit_code": exit_code(outcomes),
        "size": size,
        "versions": package_versions(),
        "cases": [_case_json(outcome) for outcome in outcomes],
    }


def _case_json(outcome: CaseOutcome) -> dict[str, Any]:
    case = outcome.case
    return {
        "id": case.id,
        "size": case.size,
        "status": outcome.status,
        "requirement": case.requirement,
        "source": case.source,
        "skipped_because": case.skip,
        "methods": {
            method: {"surfaces": len(a.results), "reused": a.reused, "errors": list(a.errors)}
            for method, a in outcome.answers.items()
        },
        "gates": [_gate_json(gate) for gate in outcome.gates],
    }


def _gate_json(outcome: GateOutcome) -> dict[str, Any]:
    gate, verdict = outcome.gate, outcome.verdict
    data: dict[str, Any] = asdict(gate) | {"name": gate.name, "status": outcome.status}
    if verdict is None:
        return data | {"error": outcome.error}
    return data | {
        "value": _estimate_json(verdict.value),
        "reference": _estimate_json(verdict.reference),
        "difference": _estimate_json(verdict.difference),
    }


def _estimate_json(estimate: Estimate) -> dict[str, float | int]:
    return {
        "mean": estimate.mean,
        "half_width_95": estimate.half_width,
        "surfaces": len(estimate.values),
    }


def write_verdict(outcomes: Sequence[CaseOutcome], size: str, folder: Path) -> None:
    """Write verdict.json and junit.xml into `folder`, whole or not at all."""
    write_json(folder / "verdict.json", verdict_json(outcomes, size))
    xml = JUnitXml("epcontact")
    for outcome in outcomes:
        xml.add_testsuite(_suite(outcome))
    xml.update_statistics()  # type: ignore[no-untyped-call]
    with whole_file(folder / "junit.xml") as path:
        xml.write(str(path), pretty=True)


def _suite(outcome: CaseOutcome) -> TestSuite:
    suite = TestSuite(outcome.case.id)
    if outcome.status == SKIPPED:
        test = TestCase(outcome.case.requirement, classname=outcome.case.id)
        test.result = [Skipped(outcome.case.skip)]
        suite.add_testcase(test)
    for gate in outcome.gates:
        test = TestCase(gate.gate.name, classname=outcome.case.id)
        if gate.status == ERROR:
            test.result = [Error(gate.error)]
        elif gate.status == FALLS_SHORT:
            test.result = [Failure(describe(gate))]
        suite.add_testcase(test)
    return suite


def describe(outcome: GateOutcome) -> str:
    """The gate, its figures and its reason in a few lines of text."""
    gate, verdict = outcome.gate, outcome.verdict
    if verdict is None:
        return f"{gate.name}: {outcome.error}"
    return (
        f"{gate.name}: difference {verdict.difference.mean:+.4g} "
        f"± {verdict.difference.half_width:.2g} must lie in [{gate.low:g}, {gate.high:g}] "
        f"({verdict.value.mean:.6g} against {verdict.reference.mean:.6g}); because {gate.because}"
    )
