"""Every gate can fail: each deliberate fault turns its gate red or makes its test fail.

The faults are the table of the package `breaking`; `python -m breaking` prints them.  A
fault changes a function of the package, and the named gate alone is judged.  `pytest
cases` shows that all gates hold without the faults.
"""

import sys
from collections import Counter

import pytest
from breaking.check import reason_stale
from breaking.fault import fails_under, status_under
from breaking.rewrite import StaleFault
from breaking.table import FAULTS

from epcontact.harness.gates import HOLDS

#: Fraction of the faults that may be stale: rewriting a function should not stop work
#: elsewhere, and `python -m breaking --check` lists what is to be mended.
MOST_STALE = 0.03

#: Commands whose saved screens are those of a scene that is solved.
SCREENS = ("run", "verify", "report", "gates", "plan")
#: Tests whose scene is solved once for all of them, and for a fault once more.
SLOW_TESTS = (
    "a_view_shows_the_fields",
    "a_field_file_is_that_of_the_last_load",
    "a_chart_shows_the_fields_and_the_figures",
    "a_map_shows_state_and_pressure_and_their_fractions",
    "curves_show_the_pressures_the_residuals_and_the_spectrum",
    "a_film_of_a_block_shows_its_stresses_in_one_scale",
    "a_collection_stands_for_its_last_load",
    *(f"test_screens.py::test_{command}" for command in SCREENS),
)
#: Beginnings of cases that take seconds, even with one surface.
SLOW_CASES = ("fem-model", "paper")


@pytest.fixture(autouse=True)
def empty_caches():
    """Empty the package's caches, which may hold what it computed under a fault."""
    yield
    for name, module in list(sys.modules.items()):
        if name.startswith("epcontact"):
            for value in list(vars(module).values()):
                if hasattr(value, "cache_clear"):
                    value.cache_clear()


def parameters(seen_by_test):
    """Return pytest parameters of the faults that a test sees (True) or a gate sees
    (False).

    Each has the fault's description as its id, and slow ones have the mark `long`.
    """
    faults = [fault for fault in FAULTS if bool(fault.test) == seen_by_test]
    return [
        pytest.param(fault, id=fault.what, marks=[pytest.mark.long] * is_slow(fault))
        for fault in faults
    ]


def is_slow(fault):
    """Return whether judging a fault takes seconds, by its test or its case."""
    slow_test = any(name in fault.test for name in SLOW_TESTS)
    return slow_test or fault.case.startswith(SLOW_CASES)


def apply(fault, monkeypatch):
    """Apply the fault with pytest's `monkeypatch`, or skip the test if the code has
    changed.
    """
    try:
        fault.apply(monkeypatch)
    except StaleFault as reason:
        pytest.skip(f"stale: {reason}")


@pytest.mark.parametrize("fault", parameters(seen_by_test=False))
def test_fault_turns_its_gate_red(fault, tmp_path, monkeypatch):
    """With the fault in place, the named gate has the expected status, such as "falls
    short".
    """
    if fault.surfaces is not None:
        # The case's own test judges all of its surfaces together, but not these alone.
        honest = status_under(fault, tmp_path / "honest")
        assert honest == HOLDS
    apply(fault, monkeypatch)
    assert status_under(fault, tmp_path / "wrong") == fault.status


@pytest.mark.parametrize("fault", parameters(seen_by_test=True))
def test_fault_makes_its_test_fail(fault, tmp_path, monkeypatch):
    """With the fault in place, the test that the fault names fails."""
    with monkeypatch.context() as patched:
        apply(fault, patched)
        assert fails_under(fault, tmp_path / "tests")


def test_nearly_all_faults_fit_the_code():
    """At most 3 % of the faults name a place that the code no longer has."""
    reasons = {fault.what: reason_stale(fault) for fault in FAULTS}
    stale = {what: reason for what, reason in reasons.items() if reason}
    assert len(stale) <= MOST_STALE * len(FAULTS), stale


def test_faults_have_different_names_and_a_bare_verify_sees_many():
    """Faults have different names, and a bare `verify` sees at least 90 of 440."""
    names = {fault.what for fault in FAULTS}
    seen_by = Counter(fault.seen_by for fault in FAULTS)
    assert len(names) == len(FAULTS) >= 440
    assert seen_by["verify"] >= 90
