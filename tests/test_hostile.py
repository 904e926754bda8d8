"""What a verdict says when a solver, a case or the machine misbehaves: never that all is well."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from epcontact import planning
from epcontact.cli.plans import plan
from epcontact.errors import InvalidCase
from epcontact.harness.case import load_case
from epcontact.harness.methods import METHODS
from epcontact.harness.verdict import Verdict, verify
from epcontact.results import Areas, ContactResult, LoadStep, Provenance

THEORY = (
    ('methods = ["persson", "bem"]', 'methods = ["persson"]'),
    ('of = "bem"\nagainst = "persson"', 'of = "persson"\nagainst = 0.1\nsource = "a guess"'),
    ("tolerance = 0.5", "tolerance = 10.0"),
)


def answered(*_: Any) -> ContactResult:
    areas = Areas(0.1, 0.1, 0.0)
    return ContactResult("persson", (LoadStep(5e8, {"corrected": areas}),), Provenance("digest"))


def raises(error: BaseException) -> Callable[..., ContactResult]:
    def solve(*_: Any) -> ContactResult:
        raise error

    return solve


@pytest.fixture
def verified(write_case, tmp_path, monkeypatch) -> Callable[..., Verdict]:
    """Verify two cases of the theory, of which the first one is answered by `solve`."""
    first = load_case(write_case(*THEORY, name="first"))
    second = load_case(write_case(*THEORY, name="second"))

    def run(solve: Callable[..., ContactResult], **options: Any) -> Verdict:
        def chosen(scene: Any, given: Any, threads: Any) -> ContactResult:
            return (solve if next(turns) == 0 else answered)(scene, given, threads)

        turns = iter(range(9))
        monkeypatch.setitem(METHODS, "persson", replace(METHODS["persson"], solve=chosen))
        cases = [replace(first, **options), second]
        return verify(cases, output=tmp_path / "out", jobs=1, fresh=True)

    return run


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (np.linalg.LinAlgError("Singular matrix"), "LinAlgError: Singular matrix"),
        (MemoryError(), "not enough memory"),
        (RecursionError("too deep"), "RecursionError: too deep"),
        (ValueError("bell \a, NUL \0, half \udc80"), r"bell \x07, NUL \x00, half \udc80"),
    ],
)  # fmt: skip
def test_the_error_of_a_solve_is_its_cases_error(verified, tmp_path, error, sentence) -> None:
    verdict = verified(raises(error))
    assert [case.status for case in verdict.cases] == ["error", "holds"]
    assert verdict.exit_code == 2
    assert sentence in str(verdict.cases[0].gates[0].error)
    assert json.loads((tmp_path / "out" / "verdict.json").read_text())["exit_code"] == 2
    suites = ET.parse(tmp_path / "out" / "junit.xml").getroot()
    assert (suites.attrib["errors"], suites.attrib["tests"]) == ("1", "2")


def test_what_has_not_converged_does_not_hold(verified) -> None:
    verdict = verified(lambda *_: replace(answered(), converged=False))
    assert verdict.exit_code == 2
    assert "not converged" in str(verdict.cases[0].gates[0].error)


def test_result_without_load_steps_is_an_error(verified) -> None:
    assert verified(lambda *_: replace(answered(), steps=())).exit_code == 2


def test_error_of_a_method_that_no_gate_reads_is_its_cases_error(
    write_case, tmp_path, monkeypatch
) -> None:
    case = load_case(write_case(*THEORY))
    gate = replace(case.gates[0], of="bem")
    case = replace(
        case, gates=(gate,), methods=("persson", "bem"), options={"persson": {}, "bem": {}}
    )
    for name, solve in (("persson", raises(MemoryError())), ("bem", answered)):
        method = replace(METHODS[name], solve=solve, one_answer=lambda _: True)
        monkeypatch.setitem(METHODS, name, method)
    verdict = verify(case, output=tmp_path, jobs=1, fresh=True)
    assert [gate.status for gate in verdict.cases[0].gates] == ["holds"]
    assert (verdict.cases[0].status, verdict.exit_code) == ("error", 2)
    assert ET.parse(tmp_path / "junit.xml").getroot().attrib["errors"] == "1"


def test_control_characters_leave_the_files_readable(verified, tmp_path) -> None:
    verdict = verified(answered, requirement="a \0 and a \x1b", skip="no \0 surface")
    assert verdict.cases[0].status == "skipped"
    test = ET.parse(tmp_path / "out" / "junit.xml").getroot().find("testsuite/testcase")
    assert test is not None
    assert test.attrib["name"] == r"a \x00 and a \x1b"
    written = Verdict.model_validate_json((tmp_path / "out" / "verdict.json").read_text())
    assert written.cases[0].requirement == "a \0 and a \x1b"


def test_earlier_verdict_is_gone_before_the_first_solve(verified, tmp_path) -> None:
    files = [tmp_path / "out" / name for name in ("verdict.json", "junit.xml")]
    seen: list[list[bool]] = []

    def solve(*_: Any) -> ContactResult:
        seen.append([path.exists() for path in files])
        raise KeyboardInterrupt

    verified(answered)
    assert all(path.exists() for path in files)
    with pytest.raises(KeyboardInterrupt):
        verified(solve)
    assert seen == [[False, False]]
    with pytest.raises(InvalidCase, match="no case is called"):
        verify("no-such-case", output=tmp_path / "out")
    assert not any(path.exists() for path in files)


@pytest.mark.parametrize(("error", "code"), [(0.5, 0), (1.0, 1), (float("nan"), 1)])
def test_broken_promise_of_a_plan_is_exit_1(write_case, monkeypatch, error, code) -> None:
    monkeypatch.setattr(planning, "achieved_error", lambda *_: error)
    path = write_case(("seeds = [3, 5, 7]", "seeds = [3]"), ("fast = 4, full = 8", "fast = 4"))
    command = [str(path), "--tolerance", "90%", "--check"]
    done = CliRunner().invoke(plan, command)
    assert done.exit_code == code, done.output
    assert ("was broken" in done.output) == (code == 1)
