"""The verdict as files: verdict.json, and junit.xml for front ends of continuous integration."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

from junitparser import Error, Failure, JUnitXml, Skipped, TestCase, TestSuite

from epcontact.errors import printable
from epcontact.files import refusal, whole_file, write_json
from epcontact.harness.gates.gate import ERROR, FALLS_SHORT
from epcontact.harness.verdict.record import SKIPPED, CaseVerdict, Verdict

#: The files that say what a run found.
FILES = ("verdict.json", "junit.xml", "report.html")
#: Before the name of a file of the verdict that was there before.
EARLIER = "earlier-"


def set_verdict_aside(folder: Path) -> None:
    """Rename the verdict of an earlier run, which would pass for that of a run that breaks off.

    It stays, with `EARLIER` before its name, until there is a new one.
    """
    for path in (folder / name for name in FILES):
        if path.is_file():  # what else has that name is refused when the file is written
            try:
                path.replace(path.with_name(f"{EARLIER}{path.name}"))
            except OSError as error:
                raise refusal("rename", path, error) from None


def remove_earlier_verdict(folder: Path) -> None:
    """Remove the verdict that `set_verdict_aside` has renamed, as there is a new one."""
    for name in FILES:
        with contextlib.suppress(OSError):
            (folder / f"{EARLIER}{name}").unlink()


def content(verdict: Verdict) -> dict[str, Any]:
    """Return the content of verdict.json."""
    return verdict.model_dump(mode="json", by_alias=True, exclude_none=True)


def write_verdict(verdict: Verdict, folder: Path) -> None:
    """Write verdict.json and junit.xml into `folder`, whole or not at all."""
    write_json(folder / "verdict.json", content(verdict))
    xml = JUnitXml("epcontact")
    for case in verdict.cases:
        xml.add_testsuite(_suite(case))
    xml.update_statistics()  # type: ignore[no-untyped-call]
    with whole_file(folder / "junit.xml") as path:
        xml.write(str(path), pretty=True)


def _suite(case: CaseVerdict) -> TestSuite:
    suite = TestSuite(case.id)

    def add(name: str, *result: Error | Failure | Skipped) -> None:
        test = TestCase(printable(name), classname=case.id)
        test.result = list(result)
        suite.add_testcase(test)

    # XML has no word for most control characters: names and messages show them as escapes.
    if case.status == SKIPPED:
        add(case.requirement, Skipped(printable(case.skipped_because)))
    for gate in case.gates:
        if gate.status == ERROR:
            add(gate.name, Error(printable(str(gate.error))))
        elif gate.status == FALLS_SHORT:
            add(gate.name, Failure(printable(str(gate))))
        else:
            add(gate.name)
    for sentence in case.unread_errors:
        add("a method that no gate reads", Error(printable(sentence)))
    return suite
