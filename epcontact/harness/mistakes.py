"""What is wrong with a case file, in one sentence that names the key and the remedy."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from epcontact.errors import nearest
from epcontact.harness.methods import Table
from epcontact.harness.schema import (
    TABLES,
    CaseFile,
    FileTable,
    FlatPunchTable,
    ParaboloidTable,
    SelfAffineTable,
    SinusoidTable,
)


def sentence(error: ValidationError) -> str:
    """The first of pydantic's errors as one sentence naming the key and the remedy."""
    # A misspelt key is both unknown and missing: the former says more.
    errors = sorted(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
    first, more = errors[0], len(errors) - 1
    where = _where(first["loc"])
    kind, given = first["type"], first.get("input")
    if kind == "extra_forbidden":
        message = f"{where} is no key of a case file{_suggest(first['loc'])}"
    elif kind == "missing":
        message = f"{where} is missing; add it ({_describe(first['loc'])})"
    elif kind in ("union_tag_not_found", "union_tag_invalid"):
        message = f"{where}.kind must be one of {', '.join(_KINDS)}"
    elif kind == "value_error":
        message = f"{where}: {first['ctx']['error']}"
    else:
        message = f"{where} is {given!r}, but must be right: {first['msg'].lower()}"
    return message + (f" (and {more} more)" if more else "")


def _where(location: tuple[Any, ...]) -> str:
    """The key as it stands in the file: gates counted from 1, no names of types or kinds."""
    parts = [str(part) for part in location if part not in _KINDS and part not in _TYPES]
    if parts[:1] == ["gate"] and len(parts) > 1:
        parts[:2] = [f"gate {int(parts[1]) + 1}"]
    return ".".join(parts) or "the case"


#: What pydantic calls the members of a union.
_TYPES = ("float", "int", "str", "list[float]")

_KINDS: dict[str, type[Table]] = {
    "self_affine": SelfAffineTable,
    "sinusoid": SinusoidTable,
    "paraboloid": ParaboloidTable,
    "flat_punch": FlatPunchTable,
    "file": FileTable,
}


def _table_at(location: tuple[Any, ...]) -> type[Table]:
    """The schema of the table that holds the key at `location`."""
    if len(location) == 1:
        return CaseFile
    if location[0] == "surface":
        return _KINDS.get(str(location[1]), SelfAffineTable)
    return TABLES[str(location[0])]


def _suggest(location: tuple[Any, ...]) -> str:
    return nearest(str(location[-1]), _table_at(location).model_fields)


def _describe(location: tuple[Any, ...]) -> str:
    field = _table_at(location).model_fields.get(str(location[-1]))
    return (field.description if field else None) or f"a table [{location[-1]}]"
