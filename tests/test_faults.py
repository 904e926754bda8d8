"""Every gate can fail: each deliberate fault turns its gate red, or makes its test
fail.

The table is the package `breaking`; `python -m breaking` prints it.  A fault is a wrong
solver of `faults.py` in the place of the boundary elements, or a patch of a function
that the package calls. The named gate alone is judged; `pytest cases` shows that all
gates hold without the faults.
"""

import sys
from collections import Counter

import breaking
import pytest
from breaking import FAULTS, fails_under, status_under
from breaking.check import reason_stale
from breaking.fault import REFUSED
from breaking.rewrite import StaleFault

from epcontact.harness.gates import HOLDS

#: Fraction of the faults that may be stale: rewriting a function should not stop work
#: elsewhere, and `python -m breaking --check` lists what is to be mended.
MOST_STALE = 0.03

#: Tests whose scene is run once for all of them, and for a fault once more.
SCENE = {
    f"tests/test_shown.py::test_{name}"
    for name in (
        "every_figure_of_an_answer_follows_from_the_pressures",
        "a_view_shows_the_fields",
        "a_field_file_is_that_of_the_last_load",
        "a_chart_shows_the_fields_and_the_figures",
    )
}


@pytest.fixture(autouse=True)
def nothing_is_kept():
    """What the package has computed under a fault, and kept, does not outlive it."""
    yield
    modules = [
        module for name, module in sys.modules.items() if name.startswith("epcontact")
    ]
    for kept in [kept for module in modules for kept in vars(module).values()]:
        getattr(kept, "cache_clear", lambda: None)()


def dear(fault):
    """True if the case of a fault takes seconds, even with one surface."""
    whole = fault.test in SCENE or "as_it_was_read" in fault.test
    return whole or fault.case.startswith(("fem-model", "paper"))


def as_parameters(faults):
    return [
        pytest.param(
            fault, id=fault.what, marks=[pytest.mark.long] if dear(fault) else []
        )
        for fault in faults
    ]


def apply(fault, monkeypatch):
    """Put a fault in place; skip the test if it no longer fits the code."""
    try:
        fault.patch(monkeypatch)
    except StaleFault as reason:
        pytest.skip(f"stale: {reason}")


def test_nearly_all_faults_fit_the_code():
    reasons = {name: reason_stale(fault) for name, fault in FAULTS.items()}
    stale = {name: reason for name, reason in reasons.items() if reason}
    assert len(stale) <= MOST_STALE * len(FAULTS), stale


@pytest.mark.parametrize(
    "fault", as_parameters([f for f in FAULTS.values() if not f.test])
)
def test_fault_turns_its_gate_red(fault, tmp_path, monkeypatch):
    if (
        fault.surfaces is not None
    ):  # the case's own test judges all of its surfaces together
        honest = status_under(fault, tmp_path / "honest")
        assert honest != REFUSED if fault.status == REFUSED else honest == HOLDS
    apply(fault, monkeypatch)
    assert status_under(fault, tmp_path / "wrong") == fault.status


@pytest.mark.parametrize("fault", as_parameters([f for f in FAULTS.values() if f.test]))
def test_fault_makes_its_test_fail(fault, tmp_path, monkeypatch):
    with monkeypatch.context() as patched:
        apply(fault, patched)
        assert fails_under(fault, tmp_path / "tests")


def test_no_fault_is_listed_twice_and_most_are_seen_by_a_bare_verify():
    assert len(FAULTS) == sum(len(room.FAULTS) for room in breaking.ROOMS)
    seen = Counter(fault.seen_by for fault in FAULTS.values())
    assert len(FAULTS) >= 120
    assert seen["verify"] >= 90
