"""Results of the large cases, run by hand and kept: they are whole, and their gates hold.

They are regression values of this package's own, not references: `epcontact run CASE --size large`
makes each of them again.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from epcontact.casefile import find_case, load_case
from epcontact.results import ContactResult
from epcontact.run import Answer
from epcontact.verify import judge_case

KEPT = sorted((Path(__file__).parent.parent / "cases" / "regression").glob("*.json"))


def test_there_are_some() -> None:
    assert len(KEPT) >= 2


@pytest.mark.parametrize("path", KEPT, ids=lambda path: path.stem)
def test_kept_result_is_of_its_case_and_holds_its_gates(path: Path) -> None:
    data = json.loads(path.read_text())
    case = load_case(find_case(data["case"]), "large")
    results = tuple(ContactResult.from_json(member) for member in data["members"])
    scenes = [case.digest(recipe) for recipe in case.recipes]
    assert [r.provenance.scene for r in results] == scenes
    assert all(r.converged for r in results)
    assert max(r.final.residuals["gap_elastic"] for r in results) <= 1e-8
    answer = Answer(results, tuple(data["ensemble"]["surfaces"]))
    outcome = judge_case(case, {data["method"]: answer})
    assert outcome.status == "holds", [g.verdict for g in outcome.gates]
