"""Case files as tests of pytest: one item for each gate; see
`epcontact.harness.pytest_plugin`.

The methods of a case run once, in the set-up of the first of its gates, so `pytest
--durations` and a JUnit file show their time there.  `pytest -n 2 --dist loadscope`
gives all gates of a case to one worker.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from epcontact.errors import EpcontactError
from epcontact.harness.case_files.case import Case, find_named, load_case
from epcontact.harness.verdict.judgement import CaseVerdict
from epcontact.harness.verdict.verification import require_gate, verify


class GateFellShort(Exception):
    """A gate does not hold or could not be judged."""


class CaseModule(pytest.File):
    """A case file."""

    def collect(self) -> Iterator[pytest.Collector]:
        """Yield a collector for each case of this file that has the size of pytest's
        option `--case-size`.

        Raises InvalidCase if the file cannot be read, or if a case has neither a gate
        nor a sweep.
        """
        size = self.config.getoption("--case-size")
        for text in find_named(self.path):
            if size in text.sizes:
                case = load_case(text, size)
                if case.sweep is None:
                    require_gate(case)
                yield CaseGates.from_parent(self, name=text.id, case=case)

    def repr_failure(
        self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None
    ) -> Any:
        """Return what pytest prints if this file could not be collected.

        For an error of epcontact this is its sentence, for any other error pytest's
        traceback.
        """
        if isinstance(excinfo.value, EpcontactError):
            return str(excinfo.value)
        return super().repr_failure(excinfo)


class CaseGates(pytest.Collector):
    """One case, which pytest shows as a group of tests."""

    def __init__(self, *, case: Case, **kwargs: Any) -> None:
        """Create the collector of a loaded case; `kwargs` are those of pytest."""
        super().__init__(**kwargs)
        self.case = case
        self.add_marker(pytest.mark.xdist_group(case.id))  # for --dist loadgroup

    def collect(self) -> Iterator[pytest.Item]:
        """Yield one test for each gate of this case, named like the gate."""
        for number, gate in enumerate(self.case.gates):
            yield GateItem.from_parent(self, name=gate.name, number=number)

    @functools.cached_property
    def verdict(self) -> CaseVerdict:
        """The verdict on this case.

        The case is solved at the first access, into the folder of pytest's option
        `--case-output` or into a temporary one.  Raises what `verify` raises.
        """
        config: Any = self.config
        folder = config.getoption("--case-output")
        if folder:
            output = Path(folder)
        else:
            output = config._tmp_path_factory.mktemp("results")
        jobs = None
        if "PYTEST_XDIST_WORKER" in os.environ:
            jobs = 1  # the workers of pytest-xdist use all cores already
        return verify(self.case, size=self.case.size, output=output, jobs=jobs).cases[0]


class GateItem(pytest.Item):
    """One gate of a case."""

    parent: CaseGates

    def __init__(self, *, number: int, **kwargs: Any) -> None:
        """Create the test of a gate.

        `number` is the index of the gate in its case, from 0; `kwargs` are those of
        pytest.
        """
        super().__init__(**kwargs)
        self.number = number

    def setup(self) -> None:
        """Solve the case of this gate, unless an earlier gate did.

        Skips the test if a surface of the case or a solver of the gate is missing.
        """
        case = self.parent.case
        reason = case.unavailable(case.gates[self.number])
        if reason:
            pytest.skip(f"skipped: {reason}")
        if self.parent.verdict.skipped_because:
            pytest.skip(self.parent.verdict.skipped_because)

    def runtest(self) -> None:
        """Raise GateFellShort if this gate does not hold or could not be judged, or if
        a method failed whose results no gate reads.

        The kind of the gate's reference and its subject become properties of the test,
        which junit.xml lists.
        """
        verdict = self.parent.verdict
        case = self.parent.case
        before = [g for g in case.gates[: self.number] if not case.unavailable(g)]
        gate = verdict.gates[len(before)]
        self.user_properties += [("reference", gate.kind), ("verifies", gate.subject)]
        if not gate.holds:
            raise GateFellShort(str(gate))
        if verdict.unread_errors:
            raise GateFellShort("; ".join(verdict.unread_errors))

    def repr_failure(
        self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None
    ) -> Any:
        """Return what pytest prints if this test fails: the sentence of the gate or of
        an error of epcontact; for any other error pytest's traceback.
        """
        if isinstance(excinfo.value, GateFellShort | EpcontactError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, None, str]:
        """Return the path of the case file, no line number, and "case: gate" as the
        heading of the test in pytest's output.
        """
        return self.path, None, f"{self.parent.name}: {self.name}"
