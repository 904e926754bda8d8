"""pytest collects case files with one item for each gate, so that any CI shows them as tests.

A folder of cases opts in with a conftest.py that holds
`from epcontact.harness.pytest_cases import pytest_addoption, pytest_collect_file  # noqa: F401`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from epcontact.errors import EpcontactError
from epcontact.harness.case import SIZES, Case, find_named, load_case
from epcontact.harness.verdict import CaseVerdict, verify


class GateFellShort(Exception):
    """A gate does not hold or could not be judged."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --case-size and --case-output."""
    group = parser.getgroup("epcontact")
    group.addoption("--case-size", choices=SIZES, default="fast", help="size of the cases to run")
    group.addoption("--case-output", default=None, help="folder for results; else a temporary one")


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Collect the TOML files beside the conftest that imported this."""
    if file_path.suffix == ".toml":
        return CaseModule.from_parent(parent, path=file_path)
    return None


class CaseModule(pytest.File):
    """A case file.  The methods of a case run once, with the first of its gates."""

    def collect(self) -> Iterator[pytest.Item]:
        """Yield one item for each gate; in a file of several cases its name includes the case."""
        size = self.config.getoption("--case-size")
        self.verdicts: dict[str, CaseVerdict] = {}
        for text in find_named(self.path):
            if size not in text.sizes:
                continue
            case = load_case(text, size)
            for number, gate in enumerate(case.gates):
                name = f"{case.id}: {gate.name}" if text.is_variant else gate.name
                yield GateItem.from_parent(self, name=name, case=case, number=number)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return the one sentence of an unreadable case file instead of a traceback."""
        if isinstance(excinfo.value, EpcontactError):
            return str(excinfo.value)
        return super().repr_failure(excinfo)

    def judged(self, case: Case) -> CaseVerdict:
        """Return the verdict on a case, which is solved at the first call."""
        if case.id not in self.verdicts:
            config: Any = self.config
            folder = config.getoption("--case-output")
            output = Path(folder) if folder else config._tmp_path_factory.mktemp("results")
            self.verdicts[case.id] = verify(case, size=case.size, output=output).cases[0]
        return self.verdicts[case.id]


class GateItem(pytest.Item):
    """One gate of a case."""

    def __init__(self, *, case: Case, number: int, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.case = case
        self.number = number

    def runtest(self) -> None:
        """Judge the gate."""
        module = self.parent
        assert isinstance(module, CaseModule)
        verdict = module.judged(self.case)
        if verdict.skipped_because:
            pytest.skip(verdict.skipped_because)
        gate = verdict.gates[self.number]
        if not gate.holds:
            raise GateFellShort(str(gate))
        if verdict.unread_errors:
            raise GateFellShort("; ".join(verdict.unread_errors))

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return the gate's sentence instead of a traceback."""
        if isinstance(excinfo.value, GateFellShort | EpcontactError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, None, str]:
        """Return the file and the name of the gate."""
        return self.path, None, f"{self.path.stem}: {self.name}"
