"""Mistakes in a case file, each as a sentence that names the key, and the table of all keys."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from epcontact.errors import closest, nearest
from epcontact.harness.case_files.axes import Range
from epcontact.harness.case_files.model import Case
from epcontact.harness.case_files.text import SIZES

#: The number of mistakes of a file that are told; a file with more is hardly a case file.
MOST_TOLD = 20
#: Pydantic's names of the mistake that a key is none of its table.
_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")


@functools.cache
def case_schema() -> dict[str, Any]:
    """Return the JSON Schema of a case file: the keys of a case, and of variants of it."""
    schema = Case.model_json_schema()
    differ = {
        name: {
            "type": "array" if name in ("gate", "omit") else "object",
            "description": f"keys of [{name}] that differ in this variant",
        }
        for name in schema["properties"]
    }
    schema["$defs"]["Variant"] = {
        "type": "object", "properties": differ, "additionalProperties": False,
    }  # fmt: skip
    schema["properties"]["variant"] = {
        "type": "array",
        "description": "partial case files, each laid over the rest of this one",
        "items": {"$ref": "#/$defs/Variant"},
    }
    return schema


@functools.cache
def _tables() -> dict[str, dict[str, Any]]:
    """Return the JSON Schema of each table by name, such as "case" or "surface, sinusoid"."""
    schema, tables = case_schema(), {}
    for name, entry in schema["properties"].items():
        form = entry.get("items") or entry.get("anyOf", [entry])[0]
        kinds = entry.get("discriminator", {}).get("mapping") or {"": form["$ref"]}
        for kind, reference in kinds.items():
            table = schema["$defs"][reference.rpartition("/")[2]]
            tables[f"{name}, {kind}" if kind else name] = table
    return tables


def key_table() -> list[tuple[str, str, str, str]]:
    """Return every key of a case file as (table, key, default, meaning with unit and words)."""
    rows = []
    for name, table in _tables().items():
        for key, entry in table["properties"].items():
            needed = key in table.get("required", ()) or "const" in entry
            given = entry.get("default")
            default = "required" if needed else "–" if given in (None, "", [], {}) else str(given)
            rows.append((name, key, default, _meaning(entry)))
    return rows


def _meaning(entry: Mapping[str, Any]) -> str:
    """Return the description of a key and the words that its schema allows."""
    if "const" in entry:
        return f"kind of surface: {entry['const']}"
    forms = [entry, *entry.get("anyOf", ()), entry.get("items", {})]
    text = next((form["description"] for form in forms if "description" in form), "")
    words = ", ".join(str(word) for form in forms for word in form.get("enum", ()))
    return f"{text}: {words}" if words else text


def told(error: ValidationError) -> list[str]:
    """Return pydantic's errors as sentences, each of which names the key and the remedy."""
    found: dict[str, list[Any]] = {}
    misspelt = {
        (*e["loc"][:-1], closest(str(e["loc"][-1]), _keys_beside(e["loc"])))
        for e in error.errors()
        if e["type"] in _UNKNOWN
    }
    for e in error.errors():
        # A misspelt key is both unknown and missing; that it is unknown says more.
        if e["type"] != "missing" or e["loc"] not in misspelt:
            found.setdefault(_where(e["loc"]), []).append(e)
    # Of a path with a word in it both are said to be no number, the path and the word.
    keys = [where for where in found if not any(o.startswith(f"{where}[") for o in found)]
    sentences = [_sentence(where, found[where]) for where in keys[:MOST_TOLD]]
    more = len(keys) - len(sentences)
    return [*sentences, f"there are {more} more mistakes"] if more else sentences


def _sentence(where: str, errors: Sequence[Any]) -> str:
    """Return the sentence for the errors of one key: one that takes a number or a word has two."""
    location, kind, given = errors[0]["loc"], errors[0]["type"], errors[0].get("input")
    if kind in _UNKNOWN:
        known = nearest(str(location[-1]), _keys_beside(location))
        sentence = f"{where} is no key of a case file{known}"
    elif kind == "missing":
        meaning = _keys_beside(location).get(str(location[-1]), {}).get("description")
        sentence = f"{where} is missing; add it ({meaning or f'a table [{location[-1]}]'})"
    elif kind.startswith("union_tag"):
        sentence = f"{where}.kind must be one of {', '.join(_kinds())}"
    elif kind == "value_error":
        table = len(location) == 1 or location[0] in ("surface", "material")
        sentence = f"{f'[{location[0]}]' if table else f'{where}:'} {errors[0]['ctx']['error']}"
    elif isinstance(given, dict) and kind in ("list_type", "tuple_type") and len(location) == 1:
        sentence = f"[{where}] is one table of a list; write [[{where}]]"
    elif isinstance(given, dict) and given:
        names = ", ".join(map(repr, given))
        sentence = f"{where} has the keys {names}, but must be one value, or one each for the sizes"
        sentence += nearest(next(iter(given)), SIZES)
    else:
        needed = " or ".join(_needed(e["msg"]) for e in errors)
        sentence = f"{where} is {given!r}, but must {needed.replace(' or be ', ' or ')}"
    return sentence


def _needed(message: str) -> str:
    """Return what pydantic asks for: "Input should be greater than 0" becomes "be greater ..."."""
    needed = message.lower().partition(" should ")[2] or "be valid"
    if "valid dictionary" in needed:
        return "be a table"
    return needed.replace("valid tuple", "valid list").removesuffix(" after validation, not 0")


def _kinds() -> list[str]:
    return [name.partition(", ")[2] for name in _tables() if name.startswith("surface, ")]


def _where(location: tuple[Any, ...]) -> str:
    """Return the key as written in the file: gates count from 1, no names of types or kinds."""
    types = (*_kinds(), "float", "str", "int", "bool", "range", "values")
    parts = [part for part in location if part not in types]
    parts = [part for part in parts if not str(part).startswith(("list[", "literal["))]
    if parts[:1] in (["gate"], ["omit"]) and len(parts) > 1:
        parts[:2] = [f"{parts[0]} {parts[1] + 1}"]
    keys = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts)
    return "".join(keys).removeprefix(".") or "the case"


def _keys_beside(location: tuple[Any, ...]) -> dict[str, Any]:
    """Return the JSON Schema of each key of the table that holds the key at `location`."""
    if len(location) == 1:
        return {key: {} for key in case_schema()["properties"]}
    if location[:1] == ("sweep",) and len(location) > 2:
        return dict(Range.model_json_schema()["properties"])
    name = str(location[0])
    return dict(_tables()[f"{name}, {location[1]}" if name == "surface" else name]["properties"])
