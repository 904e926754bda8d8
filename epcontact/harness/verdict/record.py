"""What a verification found: `Verdict` and the classes of its parts.

They are the schema of verdict.json (`epcontact schema verdict`).  Version 1 of the schema may gain
keys; no key is renamed, removed or given another meaning.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr

from epcontact.errors import InvalidCase
from epcontact.harness.answers.store import Answer
from epcontact.harness.case_files.case import Case
from epcontact.harness.gates.gate import ERROR, FALLS_SHORT, GateVerdict
from epcontact.results import package_versions

SKIPPED: Literal["skipped"] = "skipped"


class MethodEntry(BaseModel):
    """The work of a method for a case."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    surfaces: int
    reused: int
    errors: list[str]


class CaseVerdict(BaseModel):
    """One case and its gates."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: str
    size: str
    status: Literal["holds", "falls short", "error", "skipped"]
    requirement: str
    source: str
    skipped_because: str
    methods: dict[str, MethodEntry]
    gates: list[GateVerdict]
    not_judged: list[str] = Field(
        default=[], description="the gates that this size leaves out or that the case omits"
    )
    _case: Case | None = PrivateAttr(default=None)
    _answers: Mapping[str, Answer] = PrivateAttr(default_factory=dict)

    @property
    def case(self) -> Case:
        """The case that was judged.  Raises InvalidCase if this was read from a file."""
        if self._case is None:
            raise InvalidCase(f"{self.id}: a verdict that was read from a file has no case")
        return self._case

    @property
    def unread_errors(self) -> list[str]:
        """The errors of methods that no gate reads; they make the case an error as well."""
        read = {name for gate in self.gates for name in (gate.of, gate.against)}
        return [e for name, entry in self.methods.items() if name not in read for e in entry.errors]

    @property
    def answers(self) -> Mapping[str, Answer]:
        """The answer of each method; empty if this was read from a file or skipped."""
        return self._answers


class Verdict(BaseModel):
    """The verdict on all cases; verdict.json holds it."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["epcontact-verdict-1"] = Field(alias="schema")
    passed: bool
    exit_code: Literal[0, 1, 2]
    size: str
    versions: dict[str, str] = Field(
        description="of the packages that made the results; several, if results were reused"
    )
    cases: list[CaseVerdict]

    @classmethod
    def on(cls, cases: Sequence[CaseVerdict], size: str) -> Verdict:
        """Make the verdict: exit code 0 if all gates hold, 1 if one falls short, 2 on an error."""
        statuses = {case.status for case in cases}
        exit_code: Any = 2 if ERROR in statuses else 1 if FALLS_SHORT in statuses else 0
        return cls(
            schema="epcontact-verdict-1",
            passed=exit_code == 0,
            exit_code=exit_code,
            size=size,
            versions=_versions(cases),
            cases=list(cases),
        )


def _versions(cases: Sequence[CaseVerdict]) -> dict[str, str]:
    """Return the versions that made the results, which may be older than this run's."""
    found: dict[str, set[str]] = {}
    answers = (answer for case in cases for answer in case.answers.values())
    for result in (result for answer in answers for result in answer.results):
        for name, version in result.provenance.versions.items():
            found.setdefault(name, set()).add(str(version))
    joined = {name: ", ".join(sorted(versions)) for name, versions in found.items()}
    return joined or package_versions()
