"""Saved results of the large cases belong to their cases and hold their gates.

They were run by hand with this package: `epcontact run CASE --size large` writes each
of them as `results/CASE/large/METHOD.json`.  The saved file has one entry a line.
"""

import json
from pathlib import Path

import pytest

from epcontact.harness.case_files.case import find_case, load_case
from epcontact.harness.solving.method_results import MethodResults
from epcontact.harness.verdict.judgement import judge_case
from epcontact.results import ContactResult

FOLDER = Path(__file__).parent.parent / "cases" / "regression"
SAVED = [json.loads(path.read_text()) for path in FOLDER.glob("*.json")]
CASES = sorted({data["case"] for data in SAVED})
#: The residual that decides whether a method has converged.
RESIDUALS = {"bem": "gap_elastic", "fem": "balance"}


def test_large_cases_have_saved_results():
    """At least three large cases have saved results."""
    assert len(CASES) >= 3


@pytest.mark.parametrize("name", CASES)
def test_saved_results_are_of_their_case_and_hold_its_gates(name):
    """The saved results of a case (`name`) are of its present scenes, have converged to
    1e-8, and hold all its gates.
    """
    case = load_case(find_case(name), "large")
    digests = [case.digest(recipe) for recipe in case.recipes]
    by_method = {}
    for data in SAVED:
        if data["case"] != name:
            continue
        results = tuple(ContactResult.from_json(member) for member in data["members"])
        assert [result.provenance.scene for result in results] == digests
        residual = RESIDUALS[data["method"]]
        for result in results:
            assert result.converged
            assert result.final.residuals[residual] <= 1e-8
        surfaces = tuple(data["ensemble"]["surfaces"])
        by_method[data["method"]] = MethodResults(results, surfaces)
    assert set(by_method) == set(case.methods)
    assert judge_case(case, by_method).status == "holds"
