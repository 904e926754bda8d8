"""Mistakes in a case file, each as a sentence that names the key, and the table of all
keys.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from epcontact.errors import closest, nearest
from epcontact.harness.case_files.model import Case
from epcontact.harness.case_files.text import SIZES

#: The number of mistakes of a file that are told; a file with more is hardly a case
#: file.
MOST_TOLD = 20
#: Pydantic's names of the mistake that a key is none of its table.
_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
#: What pydantic puts between the keys of a place: types, and tags of unions.
_TYPES = re.compile(r"(float|str|int|bool)$|(list|literal)\[")


@functools.cache
def case_schema() -> dict[str, Any]:
    """Return the JSON Schema of a case file: the keys of a case, and of variants of
    it.
    """
    schema = Case.model_json_schema()
    differ = {
        name: {
            "type": "array" if name == "gate" else "object",
            "description": f"keys of [{name}] that differ in this variant",
        }
        for name in schema["properties"]
    }
    schema["properties"]["variant"] = {
        "type": "array",
        "description": "partial case files, each laid over the rest of this one",
        "items": {
            "type": "object",
            "properties": differ,
            "additionalProperties": False,
        },
    }
    return schema


@functools.cache
def _tables() -> dict[str, dict[str, Any]]:
    """Return the keys of each table by name, such as "case" or "surface, sinusoid"."""
    schema, tables = case_schema(), {}
    for name, entry in schema["properties"].items():
        form = entry.get("items") or entry.get("anyOf", [entry])[0]
        kinds = entry.get("discriminator", {}).get("mapping") or {
            "": form.get("$ref", "")
        }
        for kind, reference in kinds.items():
            table = schema["$defs"].get(reference.rpartition("/")[2], form)
            tables[f"{name}, {kind}" if kind else name] = table
    return tables


def key_table() -> list[tuple[str, str, str, str]]:
    """Return every key of a case file as (table, key, default, meaning with unit and
    words).
    """
    rows = []
    for name, table in _tables().items():
        for key, entry in table["properties"].items():
            needed = key in table.get("required", ()) or "const" in entry
            given = entry.get("default")
            default = (
                "required"
                if needed
                else "–"
                if given in (None, "", [], {})
                else str(given)
            )
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
    """Return pydantic's errors as sentences, each of which names the key and the
    remedy.
    """
    errors, found = error.errors(), dict[str, list[Any]]()
    meant = [
        (*e["loc"][:-1], closest(str(e["loc"][-1]), _keys_beside(e["loc"])))
        for e in errors
        if e["type"] in _UNKNOWN
    ]
    for e in errors:
        if (
            e["loc"] not in meant
        ):  # a misspelt key is unknown and missing; the first says more
            found.setdefault(_where(e["loc"]), []).append(e)
    # Of a path with a word in it both are said to be no number, the path and the word.
    keys = [
        where for where in found if not any(o.startswith(f"{where}[") for o in found)
    ]
    more = (
        [f"there are {len(keys) - MOST_TOLD} more mistakes"]
        if len(keys) > MOST_TOLD
        else []
    )
    return [_sentence(where, found[where]) for where in keys[:MOST_TOLD]] + more


def _sentence(where: str, errors: Sequence[Any]) -> str:
    """Return the sentence for the errors of one key: one that takes a number or a word
    has two.
    """
    location, kind, given = errors[0]["loc"], errors[0]["type"], errors[0].get("input")
    if kind in _UNKNOWN:
        said = f" is no key of a case file{nearest(str(location[-1]), _keys_beside(location))}"
    elif kind == "missing":
        meaning = _keys_beside(location).get(str(location[-1]), {}).get("description")
        said = f" is missing; add it ({meaning or f'a table [{location[-1]}]'})"
    elif kind == "value_error":
        said = f": {errors[0]['ctx']['error']}"
    elif kind.startswith("union_tag"):
        said = f".kind must be one of {', '.join(_kinds())}"
    elif kind == "list_type" and isinstance(given, dict) and len(location) == 1:
        said = f" is one table of a list; write [[{where}]]"
    elif kind == "list_type" and location[0] == "sweep":
        said = f" is {given!r:.200}, but must be a list of values, such as [1e8, 2e8]"
    elif isinstance(given, dict) and given:
        names, size = ", ".join(map(repr, given)), nearest(next(iter(given)), SIZES)
        said = (
            f" has the keys {names}, but must be one value, or one each for sizes{size}"
        )
    else:
        needed = " or ".join(
            e["msg"].partition(" should ")[2] or "be valid" for e in errors
        )
        said = f" is {given!r:.200}, but must {needed}"
    return f"{where}{said}"


def _kinds() -> list[str]:
    return [
        name.removeprefix("surface, ")
        for name in _tables()
        if name.startswith("surface, ")
    ]


def _where(location: tuple[Any, ...]) -> str:
    """Return the key as written in the file: gates count from 1, no names of types or
    kinds.
    """
    parts = [
        part
        for part in location
        if part not in _kinds() and not _TYPES.match(str(part))
    ]
    if parts[:1] == ["gate"] and len(parts) > 1:
        parts[:2] = [f"{parts[0]} {parts[1] + 1}"]
    keys = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts)
    return "".join(keys).removeprefix(".") or "the case"


def _keys_beside(location: tuple[Any, ...]) -> Mapping[str, Any]:
    """Return the JSON Schema of each key of the table that holds the key at
    `location`.
    """
    if len(location) == 1:
        return {key: {} for key in case_schema()["properties"]}
    name = f"surface, {location[1]}" if location[0] == "surface" else str(location[0])
    return dict(_tables()[name]["properties"])
