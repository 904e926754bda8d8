"""Results of the large cases, run by hand and kept, are whole and hold the gates of
their cases.

They are this package's own: `epcontact run CASE --size large` makes each of them again
as `results/CASE/large/METHOD.json`; here that file has one entry a line.
"""

import json
from pathlib import Path

import pytest

from epcontact.harness.case_files.case import find_case, load_case
from epcontact.harness.solving.method_results import MethodResults
from epcontact.harness.verdict.judgement import judge_case
from epcontact.results import ContactResult

KEPT = [
    json.loads(path.read_text())
    for path in (Path(__file__).parent.parent / "cases" / "regression").glob("*.json")
]
CASES = sorted({data["case"] for data in KEPT})
assert len(CASES) >= 3


@pytest.mark.parametrize("name", CASES)
def test_kept_results_are_of_their_case_and_hold_its_gates(name):
    case = load_case(find_case(name), "large")
    answers = {}
    for data in (data for data in KEPT if data["case"] == name):
        results = tuple(ContactResult.from_json(member) for member in data["members"])
        assert [r.provenance.scene for r in results] == [
            case.digest(r) for r in case.recipes
        ]
        assert all(r.converged for r in results)
        residual = {"bem": "gap_elastic", "fem": "balance"}[data["method"]]
        assert max(r.final.residuals[residual] for r in results) <= 1e-8
        answers[data["method"]] = MethodResults(
            results, tuple(data["ensemble"]["surfaces"])
        )
    assert set(answers) == set(case.methods)
    assert judge_case(case, answers).status == "holds"
