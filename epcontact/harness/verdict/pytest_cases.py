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
        """Yield the cases of the file that have the size."""
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
        """Return the one sentence of an unreadable case file instead of a traceback."""
        if isinstance(excinfo.value, EpcontactError):
            return str(excinfo.value)
        return super().repr_failure(excinfo)


class CaseGates(pytest.Collector):
    """One case."""

    def __init__(self, *, case: Case, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.case = case
        self.add_marker(pytest.mark.xdist_group(case.id))  # for --dist loadgroup

    def collect(self) -> Iterator[pytest.Item]:
        """Yield one item for each gate."""
        for number, gate in enumerate(self.case.gates):
            yield GateItem.from_parent(self, name=gate.name, number=number)

    @functools.cached_property
    def verdict(self) -> CaseVerdict:
        """The verdict on the case, which is solved when the first gate asks for it."""
        config: Any = self.config
        folder = config.getoption("--case-output")
        output = Path(folder) if folder else config._tmp_path_factory.mktemp("results")
        jobs = (
            1 if "PYTEST_XDIST_WORKER" in os.environ else None
        )  # the workers are enough
        return verify(self.case, size=self.case.size, output=output, jobs=jobs).cases[0]


class GateItem(pytest.Item):
    """One gate of a case."""

    parent: CaseGates

    def __init__(self, *, number: int, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.number = number

    def setup(self) -> None:
        """Solve the case, unless an earlier gate did; skip the gate where that is
        impossible.
        """
        if self.parent.verdict.skipped_because:
            pytest.skip(self.parent.verdict.skipped_because)

    def runtest(self) -> None:
        """Judge the gate."""
        verdict = self.parent.verdict
        gate = verdict.gates[self.number]
        self.user_properties += [("reference", gate.kind), ("verifies", gate.subject)]
        if not gate.holds:
            raise GateFellShort(str(gate))
        if verdict.unread_errors:
            raise GateFellShort("; ".join(verdict.unread_errors))

    def repr_failure(
        self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None
    ) -> Any:
        """Return the gate's sentence instead of a traceback."""
        if isinstance(excinfo.value, GateFellShort | EpcontactError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, None, str]:
        """Return the file, the case and the gate."""
        return self.path, None, f"{self.parent.name}: {self.name}"
