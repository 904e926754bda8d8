"""pytest collects case files: one item a gate, so that any CI shows them as tests.

A folder of cases opts in with a conftest.py that holds
`from epcontact.harness.pytest_cases import pytest_addoption, pytest_collect_file  # noqa: F401`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from epcontact.errors import EpcontactError
from epcontact.harness.case import SIZES, case_sizes, load_case
from epcontact.harness.verdict import CaseVerdict, verify


class GateFellShort(Exception):
    """A gate that does not hold, or could not be judged."""


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
    """A case file; its methods run once, when the first of its gates does."""

    verdict: CaseVerdict | None = None

    def collect(self) -> Iterator[pytest.Item]:
        """One item a gate."""
        size = self.config.getoption("--case-size")
        if size not in case_sizes(self.path):
            return
        case = load_case(self.path, size)
        for number, gate in enumerate(case.gates):
            yield GateItem.from_parent(self, name=gate.name, number=number)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """A case file that cannot be read says so in its one sentence."""
        if isinstance(excinfo.value, EpcontactError):
            return str(excinfo.value)
        return super().repr_failure(excinfo)

    def judged(self) -> CaseVerdict:
        """The verdict on the case, which is solved at the first call."""
        if self.verdict is None:
            config: Any = self.config
            folder = config.getoption("--case-output")
            output = Path(folder) if folder else config._tmp_path_factory.mktemp("results")
            size = config.getoption("--case-size")
            self.verdict = verify([self.path], size=size, output=output).cases[0]
        return self.verdict


class GateItem(pytest.Item):
    """One gate of a case."""

    def __init__(self, *, number: int, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.number = number

    def runtest(self) -> None:
        """Judge the gate."""
        module = self.parent
        assert isinstance(module, CaseModule)
        verdict = module.judged()
        if verdict.skipped_because:
            pytest.skip(verdict.skipped_because)
        gate = verdict.gates[self.number]
        if not gate.holds:
            raise GateFellShort(str(gate))

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """The gate's sentence rather than a traceback."""
        if isinstance(excinfo.value, GateFellShort | EpcontactError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, None, str]:
        """Where the gate stands."""
        return self.path, None, f"{self.path.stem}: {self.name}"
