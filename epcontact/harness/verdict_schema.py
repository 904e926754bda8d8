"""The shape of verdict.json, for programs that read it; `epcontact schema verdict` prints it.

A number that JSON has no word for is one of the words inf, -inf and nan.  Keys may be added
within version 1 of the schema; none is renamed, removed or given another meaning.
"""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

Number = float | Literal["inf", "-inf", "nan"]
GateStatus = Literal["holds", "falls short", "error"]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid")


class EstimateEntry(_Part):
    """A mean over surfaces with its 95 % interval."""

    mean: Number
    half_width_95: Number = Field(description="half the width of Student's interval; 0 for one")
    surfaces: int = Field(ge=0, description="how many values the mean was taken of")


class GateEntry(_Part):
    """One gate: the difference's whole interval must lie within [low, high]."""

    name: str
    status: GateStatus
    quantity: str
    of: str
    against: str | float
    norm: str
    low: Number
    high: Number
    because: str
    source: str
    value: EstimateEntry | None = None
    reference: EstimateEntry | None = None
    difference: EstimateEntry | None = None
    error: str | None = Field(default=None, description="why the gate could not be judged")


class MethodEntry(_Part):
    """What a method did for a case."""

    surfaces: int
    reused: int
    errors: list[str]


class CaseEntry(_Part):
    """One case and its gates."""

    id: str
    size: str
    status: Literal["holds", "falls short", "error", "skipped"]
    requirement: str
    source: str
    skipped_because: str
    methods: dict[str, MethodEntry]
    gates: list[GateEntry]


class VerdictFile(_Part):
    """verdict.json as a whole."""

    format: Literal["epcontact-verdict-1"] = Field(alias="schema")
    passed: bool
    exit_code: Literal[0, 1, 2]
    size: str
    versions: dict[str, str]
    cases: list[CaseEntry]


def verdict_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of verdict.json."""
    return VerdictFile.model_json_schema()
