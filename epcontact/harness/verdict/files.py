"""The files of a verdict: verdict.json, and junit.xml for continuous integration."""

from __future__ import annotations

from collections.abc import Iterator
from math import fsum
from pathlib import Path

from junitparser import (
    Error,
    Failure,
    JUnitXml,
    Properties,
    Property,
    Skipped,
    TestCase,
    TestSuite,
)

from epcontact.errors import printable
from epcontact.files import (
    atomic_write,
    output_error,
    remove_leftovers,
    write_json,
)
from epcontact.harness.gates import ERROR, FALLS_SHORT, GateVerdict
from epcontact.harness.verdict.digest import digest_of
from epcontact.harness.verdict.judgement import SKIPPED, CaseVerdict, Verdict

#: The files that say what a run found.
_FILES = ("verdict.json", "junit.xml", "report.html")


def delete_verdict(folder: Path) -> None:
    """Delete verdict.json, junit.xml and report.html in a folder, if they exist.

    A run deletes them at its start.  If it is interrupted, nobody takes the verdict of
    an earlier run for its own.  Temporary files that a killed run left beside them are
    removed, too.  Raises OutputError if a file cannot be deleted.
    """
    remove_leftovers(folder, below=False)
    for name in _FILES:
        path = folder / name
        if path.is_file():
            try:
                path.unlink()
            except OSError as error:
                raise output_error("delete", path, error) from None


def write_verdict(verdict: Verdict, folder: Path) -> None:
    """Write verdict.json and junit.xml into a folder, each completely or not at all.

    The verdict is written with the digest of itself and of the results in the folder.
    Raises OutputError if a file cannot be written.
    """
    digest = {"digest": digest_of(verdict.content, folder)}
    write_json(folder / "verdict.json", verdict.content | digest)
    xml = JUnitXml("epcontact")
    for case in verdict.cases:
        suite = _suite(case)
        if verdict.made:
            suite.timestamp = verdict.made.date
        xml.add_testsuite(suite)
    xml.update_statistics()  # type: ignore[no-untyped-call]
    with atomic_write(folder / "junit.xml") as path:
        xml.write(str(path), pretty=True)


def _suite(case: CaseVerdict) -> TestSuite:
    """Return a case as a test suite of junit.xml.

    It has a test for each gate, and a failed test for each error of a method that no
    gate reads.  A skipped case has a single, skipped test.
    """
    suite = TestSuite(case.id)
    if case.status == SKIPPED:
        skipped = TestCase(printable(case.requirement), classname=case.id, time=0.0)
        skipped.result = [Skipped(printable(case.skipped_because))]
        suite.add_testcase(skipped)
        return suite
    for gate, seconds in zip(case.gates, _waiting_times(case), strict=True):
        suite.add_testcase(_test_of(gate, case.id, seconds))
    for sentence in case.unread_errors:
        test = TestCase("a method that no gate reads", classname=case.id, time=0.0)
        test.result = [Error(printable(sentence))]
        suite.add_testcase(test)
    return suite


def _test_of(gate: GateVerdict, case_id: str, seconds: float) -> TestCase:
    """Return a judged gate as a test of junit.xml.

    The kind of the gate's reference and what it verifies are properties of the test.
    XML cannot contain most control characters: they are written as escapes.

    Args:
        gate: the verdict on the gate.
        case_id: the id of its case, which is the class name of the test.
        seconds: the time of the test.
    """
    test = TestCase(printable(gate.name), classname=case_id, time=seconds)
    kinds = {ERROR: Error, FALLS_SHORT: Failure}
    if gate.status in kinds:
        test.result = [kinds[gate.status](printable(gate.error or str(gate)))]
    properties = Properties()  # type: ignore[no-untyped-call]
    for name, value in (("reference", gate.kind), ("verifies", gate.subject)):
        properties.append(Property(name, value))  # type: ignore[no-untyped-call]
    test.append(properties)  # type: ignore[no-untyped-call]
    return test


def _waiting_times(case: CaseVerdict) -> Iterator[float]:
    """Yield the time of each gate of a case, in seconds.

    As in pytest, the first gate that reads a method has the time of all its solves.
    The time of methods that no gate reads is added to the first gate.
    """
    unread = {
        name: fsum(entry.seconds.values()) for name, entry in case.methods.items()
    }
    times = []
    for gate in case.gates:
        methods = (gate.of, str(gate.against))
        times.append(fsum(unread.pop(method, 0.0) for method in methods))
    if times:
        times[0] += fsum(unread.values())
    yield from times
