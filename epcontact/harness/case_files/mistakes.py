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

#: The number of mistakes of a file that are reported; a file with more is hardly a
#: case file.
MOST_REPORTED = 20
#: Pydantic's names of the mistake that a table has no such key.
_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
#: What pydantic puts between the keys of a place: the names of types.
_TYPES = re.compile(r"(float|str|int|bool)$|(list|literal)\[")


@functools.cache
def case_schema() -> dict[str, Any]:
    """Return the JSON Schema of a case file, with the keys of a case and of its
    variants; the same dictionary at each call, which must not be changed.
    """
    schema = Case.model_json_schema()
    of_variant = {
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
            "properties": of_variant,
            "additionalProperties": False,
        },
    }
    return schema


@functools.cache
def _tables() -> dict[str, dict[str, Any]]:
    """Return the JSON Schema of each table of a case file by the table's name, such as
    "case"; for a kind of surface the name is "surface, sinusoid".
    """
    schema = case_schema()
    tables = {}
    for name, entry in schema["properties"].items():
        form = entry.get("items") or entry.get("anyOf", [entry])[0]
        kinds = entry.get("discriminator", {}).get("mapping")
        if not kinds:
            kinds = {"": form.get("$ref", "")}
        for kind, reference in kinds.items():
            table = schema["$defs"].get(reference.rpartition("/")[2], form)
            full_name = f"{name}, {kind}" if kind else name
            tables[full_name] = table
    return tables


# --- the table of all keys


def key_table() -> list[tuple[str, str, str, str]]:
    """Return a row for every key of a case file.

    A row has the table, the key, its default ("–": empty; "required"), and its meaning
    with the unit and the words that it may have.
    """
    rows = []
    for name, table in _tables().items():
        required = table.get("required", ())
        for key, entry in table["properties"].items():
            default = _default(entry)
            if key in required or "const" in entry:
                default = "required"
            rows.append((name, key, default, _meaning(entry)))
    return rows


def _default(entry: Mapping[str, Any]) -> str:
    """Return the default of a key as text; "–" if it is empty.

    `entry` is the JSON Schema of the key.
    """
    default = entry.get("default")
    return "–" if default in (None, "", [], {}) else str(default)


def _meaning(entry: Mapping[str, Any]) -> str:
    """Return the description of a key and the words that its schema allows.

    `entry` is the JSON Schema of the key.
    """
    if "const" in entry:
        return f"kind of surface: {entry['const']}"
    forms = [entry, *entry.get("anyOf", ()), entry.get("items", {})]
    text = next((form["description"] for form in forms if "description" in form), "")
    words = ", ".join(str(word) for form in forms for word in form.get("enum", ()))
    return f"{text}: {words}" if words else text


# --- sentences on mistakes


def sentences_of(error: ValidationError) -> list[str]:
    """Return the mistakes that pydantic found in a case as sentences.

    Each sentence names the key and what it must be.  At most `MOST_REPORTED` mistakes
    are listed; one more sentence then counts the others.
    """
    by_key: dict[str, list[Any]] = {}
    errors = error.errors()
    misspelt = [
        _meant(detail["loc"]) for detail in errors if detail["type"] in _UNKNOWN
    ]
    for detail in errors:
        # A misspelt key is unknown, and the key that is meant is missing: the sentence
        # on the unknown one says more.
        if detail["loc"] not in misspelt:
            by_key.setdefault(_key_at(detail["loc"]), []).append(detail)
    # For a list that contains a word, pydantic reports both the list and the word; only
    # the sentence on the word is kept.
    keys = [key for key in by_key if not any(o.startswith(f"{key}[") for o in by_key)]
    sentences = [_sentence(key, by_key[key]) for key in keys[:MOST_REPORTED]]
    if len(keys) > MOST_REPORTED:
        sentences.append(f"there are {len(keys) - MOST_REPORTED} more mistakes")
    return sentences


def _meant(location: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the location of the key that a misspelt key probably means.

    `location` is pydantic's location of the misspelt key: the keys and indices that
    lead to it.
    """
    name = closest(str(location[-1]), _keys_beside(location))
    return (*location[:-1], name)


def _sentence(key: str, errors: Sequence[Any]) -> str:
    """Return the sentence on a key.

    Args:
        key: as written in the file.
        errors: pydantic's; a key that takes a number or a word has two.
    """
    kind = errors[0]["type"]
    given = errors[0].get("input")
    location = errors[0]["loc"]
    if kind in _UNKNOWN:
        hint = nearest(str(location[-1]), _keys_beside(location))
        return f"{key} is no key of a case file{hint}"
    if kind == "missing":
        meaning = _keys_beside(location).get(str(location[-1]), {}).get("description")
        return f"{key} is missing; add it ({meaning or f'a table [{location[-1]}]'})"
    if kind == "value_error":
        return f"{key}: {errors[0]['ctx']['error']}"
    if kind.startswith("union_tag"):
        return f"{key}.kind must be one of {', '.join(_kinds())}"
    return f"{key}{_wrong_value(given, errors)}"


def _wrong_value(given: Any, errors: Sequence[Any]) -> str:
    """Return the end of a sentence on a value of the wrong type, such as " is 'a', but
    must be a valid number".

    Args:
        given: the value in the file.
        errors: pydantic's errors on the key, one at least.
    """
    location = errors[0]["loc"]
    needs_list = errors[0]["type"] == "list_type"
    if needs_list and isinstance(given, dict) and len(location) == 1:
        return f" is one table of a list; write [[{location[0]}]]"
    if needs_list and location[0] == "sweep":
        return f" is {given!r:.200}, but must be a list of values, such as [1e8, 2e8]"
    if isinstance(given, dict) and given:
        names = ", ".join(map(repr, given))
        hint = nearest(next(iter(given)), SIZES)
        return (
            f" has the keys {names}, but must be one value, or one each for sizes{hint}"
        )
    needed = [error["msg"].partition(" should ")[2] or "be valid" for error in errors]
    return f" is {given!r:.200}, but must {' or '.join(needed)}"


def _kinds() -> list[str]:
    """Return the words that the key surface.kind may have, such as "sinusoid"."""
    return [
        name.removeprefix("surface, ")
        for name in _tables()
        if name.startswith("surface, ")
    ]


def _key_at(location: tuple[Any, ...]) -> str:
    """Return a key as it is written in the file, such as "gate 1.norm".

    Args:
        location: pydantic's location of the key.  It counts gates from 0 and contains
            names of types and kinds of surfaces, which the file does not.
    """
    kinds = _kinds()
    parts = [
        part for part in location if part not in kinds and not _TYPES.match(str(part))
    ]
    if parts[:1] == ["gate"] and len(parts) > 1:
        parts[:2] = [f"gate {parts[1] + 1}"]
    key = ""
    for part in parts:
        if isinstance(part, int):
            key += f"[{part}]"
        else:
            key += f".{part}"
    return key.removeprefix(".") or "the case"


def _keys_beside(location: tuple[Any, ...]) -> Mapping[str, Any]:
    """Return the JSON Schemas of all keys of one table, by the names of the keys.

    The table is the one of the key at `location`, pydantic's location in the case.
    """
    if len(location) == 1:
        return {key: {} for key in case_schema()["properties"]}
    name = str(location[0])
    if name == "surface":
        name = f"surface, {location[1]}"
    return dict(_tables()[name]["properties"])
