"""Verdicts in JSON and JUnit, from answers made by hand: no solver runs here."""

from __future__ import annotations

import errno
import json
import os
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from epcontact.errors import OutputError
from epcontact.harness.answers.store import Answer
from epcontact.harness.case_files.case import Case, load_case
from epcontact.harness.verdict.files import write_verdict
from epcontact.harness.verdict.judgement import judge_case
from epcontact.harness.verdict.record import Verdict
from epcontact.harness.verdict.verification import verify
from epcontact.results import Areas, ContactResult, LoadStep, PressureDistribution, Provenance


def result(method: str, total: float, claim: float = 0.0) -> ContactResult:
    areas = Areas(total, total / 2, total / 2)
    step = LoadStep(
        5e8, {"raw": areas, "corrected": areas, "error": Areas(claim, claim / 2, claim / 2)}
    )
    distribution = PressureDistribution(
        np.array([0.0, 6e9]), np.array([0, total / 2]), plastic=total / 2
    )
    return ContactResult(method, (step,), Provenance("digest"), distribution)


def answers(bem: list[float], theory: float = 0.1) -> dict[str, Answer]:
    return {
        "persson": Answer((result("persson", theory),), ("single",)),
        "bem": Answer(
            tuple(result("bem", a) for a in bem), tuple(f"seed{i}" for i in range(len(bem)))
        ),
    }


def with_its_own_gate(case: Case) -> Case:
    """Without the default gates, which read fields that the results here do not have."""
    return case.changed(gates=case.gates[:1])


@pytest.fixture
def case(write_case):
    return with_its_own_gate(load_case(write_case(("tolerance = 0.5", "tolerance = 0.1"))))


@pytest.mark.parametrize(
    ("areas", "status", "code"),
    [
        ([0.1, 0.101, 0.102], "holds", 0),
        ([0.12, 0.121, 0.122], "falls short", 1),
        ([0.05, 0.1, 0.15], "falls short", 1),
        ([float("nan")], "falls short", 1),
    ],
)
def test_status_and_exit_code(case, areas, status, code) -> None:
    outcome = judge_case(case, answers(areas))
    assert outcome.status == status
    assert Verdict.on([outcome], "fast").exit_code == code


def test_areas_less_sure_than_the_band_do_not_hold(case) -> None:
    """The surer of two grids counts, and that of one beside a theory."""
    sure, unsure, lost = (result("bem", 0.1, claim) for claim in (0.005, 0.02, float("nan")))
    fem = {"fem": Answer((result("fem", 0.1, 0.03),), ("seed0",))}
    on_fem = replace(case.gates[0], against="fem")
    gates = case.changed(methods=("persson", "bem", "fem"), gates=(case.gates[0], on_fem))
    for given, theory_gate, fem_gate in (
        (sure, "holds", "holds"),
        (unsure, "falls short", "falls short"),
        (lost, "falls short", "falls short"),
    ):
        judged = judge_case(gates, answers([0.1]) | fem | {"bem": Answer((given,), ("seed0",))})
        assert [gate.status for gate in judged.gates] == [theory_gate, fem_gate]
    assert judged.gates[1].grid_error == pytest.approx(0.3)
    assert "± 0.3 (of which 0.3 by the grid)" in str(judged.gates[1])


def test_method_without_answer_is_an_error_not_a_shortfall(case) -> None:
    given = answers([0.1]) | {"bem": Answer(errors=("bem, seed3: stalled",))}
    outcome = judge_case(case, given)
    assert outcome.status == "error"
    assert Verdict.on([outcome], "fast").exit_code == 2
    assert "stalled" in outcome.gates[0].error


def test_one_failed_surface_of_an_ensemble_is_an_error(case) -> None:
    good = answers([0.1, 0.1])["bem"]
    given = answers([0.1]) | {"bem": Answer(good.results, good.labels, ("bem, seed7: stalled",))}
    assert judge_case(case, given).status == "error"


def test_distributions_are_compared_surface_by_surface(write_case) -> None:
    path = write_case(
        ('"area.total.corrected"', '"distribution"'),
        ("tolerance = 0.5", 'norm = "wasserstein"\ntolerance = 0.1'),
    )
    case = with_its_own_gate(load_case(path))
    same = judge_case(case, answers([0.1, 0.1]))
    assert same.gates[0].difference.mean == pytest.approx(0, abs=1e-12)
    assert same.status == "holds"


def test_files_say_what_the_verdict_says(case, tmp_path) -> None:
    judged = Verdict.on([judge_case(case, answers([0.12, 0.121, 0.122]))], "fast")
    write_verdict(judged, tmp_path)
    verdict = json.loads((tmp_path / "verdict.json").read_text())
    assert Verdict.model_validate(verdict).model_dump() == judged.model_dump()
    assert verdict["passed"] is False
    assert verdict["exit_code"] == 1
    gate = verdict["cases"][0]["gates"][0]
    assert gate["difference"]["mean"] == pytest.approx(0.21)
    assert (gate["low"], gate["high"]) == (-0.1, 0.1)
    suites = ET.parse(tmp_path / "junit.xml").getroot()
    assert suites.attrib["failures"] == "1"
    failure = suites.find("testsuite/testcase/failure")
    assert failure is not None
    assert "only a smoke test" in failure.attrib["message"]


def test_verdict_of_what_could_not_be_judged_has_the_same_shape(case, tmp_path) -> None:
    given = answers([0.1]) | {"bem": Answer(errors=("bem, seed3: stalled",))}
    write_verdict(Verdict.on([judge_case(case, given)], "fast"), tmp_path)
    verdict = Verdict.model_validate_json((tmp_path / "verdict.json").read_text())
    assert verdict.cases[0].gates[0].error == "bem, seed3: stalled"
    assert "cases" in Verdict.model_json_schema()["required"]


def test_versions_are_those_of_the_results(case) -> None:
    given = answers([0.1])
    for method, version in (("bem", "1.0"), ("persson", "2")):
        made = Provenance("digest", versions={"numpy": version})
        result = replace(given[method].results[0], provenance=made)
        given[method] = replace(given[method], results=(result,))
    assert Verdict.on([judge_case(case, given)], "fast").versions == {"numpy": "1.0, 2"}


def test_the_last_verdict_survives_a_full_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    verify("bearing-area", output=tmp_path, jobs=1)
    last = {name: (tmp_path / name).read_bytes() for name in ("verdict.json", "junit.xml")}
    with monkeypatch.context() as disk:
        disk.setattr(os, "fsync", full)
        for _ in range(2):
            with pytest.raises(OutputError, match="no space left on device"):
                verify("bearing-area", output=tmp_path, jobs=1)
            # Under its own name it would pass for the verdict of the run that has failed.
            assert not [name for name in last if (tmp_path / name).exists()]
            assert {name: (tmp_path / f"earlier-{name}").read_bytes() for name in last} == last
    assert verify("bearing-area", output=tmp_path, jobs=1).passed
    assert sorted(path.name for path in tmp_path.iterdir() if path.is_file()) == sorted(last)
