"""The keys of a case file: names, types, units and meaning, and the messages about mistakes.

There is one class for each table; those of [surface] are the recipes of `epcontact.surfaces`.  Any
value may be given by size, as in `shape = { fast = [256, 256], full = [1024, 1024] }`;
sizes are resolved before these classes see the values.  `epcontact keys` prints these keys.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    WrapValidator,
    create_model,
    field_validator,
    model_validator,
)

from epcontact.errors import closest, nearest
from epcontact.harness.case_files.axes import SweepTable
from epcontact.harness.case_files.text import SIZES
from epcontact.harness.gates.gate import Norm
from epcontact.harness.methods.registry import METHODS, Table
from epcontact.harness.quantities.registry import QUANTITIES, REPORTED_GROUPS
from epcontact.reference import CLOSED_FORMS
from epcontact.scene import Body, Load, Material
from epcontact.surfaces import CaseSurface, SurfaceAbsent

#: The number of mistakes of a file that are told; a file with more is hardly a case file.
MOST_TOLD = 20
#: Pydantic's names of the mistake that a key is none of its table.
UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")


def _registered(name: str) -> str:
    if name not in METHODS:
        raise ValueError(f"no method is called {name!r}{nearest(name, METHODS)}")
    return name


def _each_once(names: list[str]) -> list[str]:
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{name} is named {names.count(name)} times; name each method once")
    return names


MethodName = Annotated[
    str, AfterValidator(_registered), Field(json_schema_extra={"enum": list(METHODS)})
]


Size = Literal["fast", "full", "large"]


class CaseTable(Table):
    """[case]: the requirement, its source, and the methods."""

    id: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9._-]*$", max_length=80)] = Field(
        description="name of the case, of its folder of results and on the command line"
    )
    requirement: str = Field(min_length=1, description="the requirement, one English sentence")
    source: str = Field(min_length=1, description="the source of the requirement and its figures")
    methods: Annotated[list[MethodName], AfterValidator(_each_once)] = Field(
        min_length=1, description="the methods that answer the scene"
    )
    time_limit: float = Field(
        default=900.0, gt=0, description="seconds after which one solve is given up"
    )
    verify: bool = Field(
        default=True, description="whether a bare `epcontact verify` includes the case"
    )


def _or_absent(table: Any, validate: Any) -> Any:
    """Return the recipe of a table [surface], or the error of an absent optional file."""
    try:
        return validate(table)
    except ValidationError as error:
        reasons = [detail.get("ctx", {}).get("error") for detail in error.errors()]
        absent = [reason for reason in reasons if isinstance(reason, SurfaceAbsent)]
        if not absent:
            raise
        return absent[0]


SurfaceTable = Annotated[CaseSurface, Field(discriminator="kind"), WrapValidator(_or_absent)]


class MaterialTable(Table):
    """[material]: an elastoplastic solid against a rigid flat."""

    young_modulus: float = Field(description="Pa")
    poisson_ratio: float = Field(description="between -1 and 0.5")
    hardness: float | Literal["effective"] = Field(
        default=float("inf"),
        description="Pa; cap of the contact pressure; 'effective': that which stands for a J2 body "
        "of yield_stress",
    )
    yield_stress: float = Field(default=float("inf"), description="Pa; of the J2 solid")

    @field_validator("*")
    @classmethod
    def _in_range(cls, value: Any, info: ValidationInfo) -> Any:
        if value != "effective":  # each key by itself, so that the mistakes of all are told
            Material(**{"young_modulus": 1.0, "poisson_ratio": 0.0, str(info.field_name): value})
        return value


class BodyTable(Table):
    """[body]: the body under the surface."""

    kind: Literal["half_space", "bonded_layer", "sliding_layer"] = Field(
        default="half_space", description="half-space, or layer on a rigid base"
    )
    depth: float = Field(default=float("inf"), description="m; of a layer")

    @model_validator(mode="after")
    def _a_body(self) -> BodyTable:
        self.body()
        return self

    def body(self) -> Body:
        """Return the body.  Raises InvalidScene."""
        return Body(**self.model_dump())


class LoadTable(Table):
    """[load]: the force over the nominal area."""

    mean_pressure: float | list[float] = Field(description="Pa; one, or a path of them")

    @model_validator(mode="after")
    def _a_load(self) -> LoadTable:
        self.load()
        return self

    def load(self) -> Load:
        """Return the load.  Raises InvalidScene."""
        given = self.mean_pressure
        return Load(tuple(given) if isinstance(given, list) else given)


class GateTable(Table):
    """[[gate]]: one comparison that must hold."""

    quantity: str = Field(
        description="the scalar that is compared, such as area.total.corrected; "
        "`epcontact keys` lists them all"
    )
    of: MethodName = Field(description="the method that is judged")
    against: str | float = Field(description="a method, a closed form's name, or a number")
    norm: Norm = Field(default="relative", description="how the difference is measured")
    tolerance: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="the difference must be within +- tolerance",
    )
    between: list[float] | None = Field(
        default=None,
        min_length=2,
        max_length=2,
        description="or the difference must be within [low, high]",
    )
    because: str = Field(min_length=1, description="why the band is as wide as it is")
    source: str = Field(default="", description="where a number comes from; needed for one")
    sizes: list[Size] | None = Field(
        default=None, min_length=1, description="the sizes it applies to; else all"
    )

    @model_validator(mode="after")
    def _one_band(self) -> GateTable:
        if (self.tolerance is None) == (self.between is None):
            raise ValueError("give either tolerance or between")
        if self.between is not None and not self.between[0] <= self.between[1]:
            raise ValueError("between is out of order; give [low, high]")
        if self.between is not None and all(map(math.isinf, self.between)):
            raise ValueError(
                "between holds whatever the difference is, or never; give it a finite end"
            )
        if isinstance(self.against, float | int) and not math.isfinite(self.against):
            raise ValueError(f"against is {self.against}, but must be a finite number")
        if self.against == self.of:
            raise ValueError(
                f"{self.of} is compared with itself; name another method, a closed form or a number"
            )
        if isinstance(self.against, float | int) and not self.source:
            raise ValueError("against is a number without a source; say where it comes from")
        if (self.quantity == "distribution") != (self.norm in ("wasserstein", "supremum")):
            raise ValueError(
                "only a distribution has the norm wasserstein or supremum, and no other norm"
            )
        if self.quantity.startswith("field.") != (self.norm == "l2"):
            raise ValueError("only a field has the norm l2, and no other norm")
        return self

    @model_validator(mode="after")
    def _known_names(self) -> GateTable:
        # A user's solver may report quantities of its own.
        own = METHODS[self.of].source and self.quantity.startswith(REPORTED_GROUPS)
        if self.quantity not in QUANTITIES and not own:
            raise ValueError(
                f"no quantity is called {self.quantity!r}{nearest(self.quantity, QUANTITIES)}"
            )
        form = self.against
        if isinstance(form, str) and form not in METHODS:
            if form not in CLOSED_FORMS:
                raise ValueError(
                    f"against is {form!r}, which is neither a method nor a closed form"
                    f"{nearest(form, CLOSED_FORMS)}"
                )
            if not CLOSED_FORMS[form].knows(self.quantity):
                raise ValueError(
                    f"the closed form {form} has no {self.quantity!r}; it has "
                    f"{', '.join(CLOSED_FORMS[form].quantities)}"
                )
        return self


class OmitTable(Table):
    """[[omit]]: a default gate of a method that does not apply to the case."""

    quantity: str = Field(description="quantity of the default gate")
    of: MethodName = Field(description="the method whose default gate it is")
    because: str = Field(min_length=1, description="why the case cannot hold it")


class _Sections(Table):
    """The sections of a case file that do not depend on its methods."""

    # Each table is strict by itself; a strict recipe could not be made from a table.
    model_config = ConfigDict(strict=False)

    case: CaseTable
    surface: SurfaceTable
    material: MaterialTable
    load: LoadTable
    body: BodyTable = BodyTable()
    gate: list[GateTable] = Field(
        default=[], description="comparisons; only a case with a sweep may have none"
    )
    omit: list[OmitTable] = Field(default=[], description="default gates that do not apply")
    sweep: SweepTable | None = Field(default=None, description="values that a sweep gives to keys")


def _method_sections() -> dict[str, Any]:
    """Return the table of each method's options; its default is None if a key has none."""
    sections: dict[str, Any] = {}
    for method in METHODS.values():
        needed = any(field.is_required() for field in method.options.model_fields.values())
        if needed:
            sections[method.table] = (method.options | None, None)
        elif method.table:
            sections[method.table] = (method.options, method.options())
    return sections


def _partial(name: str) -> tuple[Any, Any]:
    """Return the field of a variant that is laid over the section `name`."""
    form = list[dict[str, Any]] if name in ("gate", "omit") else dict[str, Any]
    return form, Field(default={}, description=f"keys of [{name}] that differ in this variant")


class CaseFile(create_model("CaseFile", __base__=_Sections, **_method_sections())):  # type: ignore[misc]
    """One case: a whole file, or one of its variants laid over the rest."""


class Family(CaseFile):
    """A case file with variants, each a case of its own."""

    variant: list[
        create_model(  # type: ignore[valid-type]
            "Variant", __base__=Table, **{name: _partial(name) for name in CaseFile.model_fields}
        )
    ] = Field(default=[], description="partial case files, each laid over the rest of this one")


@functools.cache
def _tables() -> dict[str, dict[str, Any]]:
    """Return the JSON Schema of each table by name, such as "case" or "surface, sinusoid"."""
    schema = Family.model_json_schema()
    tables = {}
    for name, entry in schema["properties"].items():
        references = entry.get("discriminator", {}).get("mapping")
        if references is None:
            form = entry.get("items") or entry.get("anyOf", [entry])[0]
            references = {"": form["$ref"]}
        for kind, reference in references.items():
            table = schema["$defs"][reference.rsplit("/", 1)[-1]]
            tables[f"{name}, {kind}" if kind else name] = table
    return tables


def key_table() -> list[tuple[str, str, str, str]]:
    """Return every key of a case file as (table, key, default, meaning with unit and words).

    Example:
        >>> [row for row in key_table() if row[1] == "young_modulus"]
        [('material', 'young_modulus', 'required', 'Pa')]
        >>> [row[3] for row in key_table() if row[:2] == ("fem", "law")]
        ['material law: elastic, capped, j2']
    """
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
    forms = [entry, *entry.get("anyOf", ()), entry.get("items", {})]
    text = next((form["description"] for form in forms if "description" in form), "")
    words = [str(word) for form in forms for word in form.get("enum", ())]
    if "const" in entry:
        text, words = "kind of surface", [str(entry["const"])]
    return f"{text}: {', '.join(words)}" if words else text


def mistakes(error: ValidationError) -> list[str]:
    """Return pydantic's errors as sentences, each of which names the key and the remedy."""
    misspelt: dict[tuple[Any, ...], str] = {}
    for e in error.errors():
        if e["type"] in UNKNOWN:
            *table, key = e["loc"]
            misspelt[(*table, closest(str(key), _keys_beside(e["loc"])))] = str(key)
    # A misspelt key is both unknown and missing; that it is unknown says more.
    errors = [e for e in error.errors() if e["type"] != "missing" or e["loc"] not in misspelt]
    found: dict[str, list[Any]] = {}
    for e in errors:
        found.setdefault(_where(e["loc"]), []).append(e)
    # Of a path with a word in it both are said to be no number, the path and the word.
    told = [where for where in found if not any(o.startswith(f"{where}[") for o in found)]
    sentences = [_mistake(where, found[where]) for where in told[:MOST_TOLD]]
    more = len(told) - len(sentences)
    return [*sentences, f"there are {more} more mistakes"] if more else sentences


def _mistake(where: str, errors: Sequence[Any]) -> str:
    """Return the sentence for the errors of one key: one that takes a number or a word has two."""
    location, kind, given = errors[0]["loc"], errors[0]["type"], errors[0].get("input")
    if kind in UNKNOWN:
        known = _keys_beside(location)
        sentence = f"{where} is no key of a case file{nearest(str(location[-1]), known)}"
    elif kind == "missing":
        meaning = _keys_beside(location).get(str(location[-1]), {}).get("description")
        sentence = f"{where} is missing; add it ({meaning or f'a table [{location[-1]}]'})"
    elif kind in ("union_tag_not_found", "union_tag_invalid"):
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
    """Return what pydantic asks for: "Input should be greater than 0", "List should have at least
    1 item after validation, not 0".
    """
    needed = message.lower().partition(" should ")[2] or "be valid"
    if "valid dictionary" in needed:
        return "be a table"
    return needed.replace("valid tuple", "valid list").removesuffix(" after validation, not 0")


def _kinds() -> list[str]:
    """Return the kinds of [surface]."""
    return [name.partition(", ")[2] for name in _tables() if name.startswith("surface, ")]


def _where(location: tuple[Any, ...]) -> str:
    """Return the key as written in the file: gates count from 1, no names of types or kinds."""
    parts = [part for part in location if part not in (*_kinds(), "float", "str")]
    parts = [part for part in parts if not str(part).startswith(("list[", "literal["))]
    if parts[:1] in (["gate"], ["omit"]) and len(parts) > 1:
        parts[:2] = [f"{parts[0]} {parts[1] + 1}"]
    keys = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts)
    return "".join(keys).removeprefix(".") or "the case"


def _keys_beside(location: tuple[Any, ...]) -> dict[str, Any]:
    """Return the JSON Schema of each key of the table that holds the key at `location`."""
    if len(location) == 1:
        return {key: {} for key in Family.model_fields}
    name = str(location[0])
    table = _tables()[f"{name}, {location[1]}" if name == "surface" else name]
    return dict(table["properties"])
