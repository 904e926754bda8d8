"""Case files are read and checked; all mistakes of a file are told, each in one
sentence.

Mistakes that pydantic finds in a table hide those between the tables, which it could
not read. A case is read at every size, so that a mistake in its full size shows when
the fast one is run.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from epcontact.errors import EpcontactError, InvalidCase
from epcontact.harness.case_files.mistakes import told
from epcontact.harness.case_files.model import Case, GateTable
from epcontact.harness.case_files.text import (
    SIZES,
    CaseText,
    at_size,
    find_case,
    find_cases,
    find_named,
)
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.quantities.registry import QUANTITIES
from epcontact.scene import check_load, check_loading
from epcontact.surfaces import SurfaceAbsent

__all__ = [
    "SIZES",
    "Case",
    "CaseText",
    "find_case",
    "find_cases",
    "find_named",
    "load_case",
]


def load_case(case: CaseText | Path | str, size: str = "fast") -> Case:
    """Read a case at one size, and check it at all of them; one sentence tells each
    mistake.
    """
    text = case if isinstance(case, CaseText) else find_case(case)
    if size not in text.sizes:
        raise InvalidCase(
            f"{text.where}: has no size {size!r}; it has {', '.join(text.sizes)}"
        )
    return {each: _read(text, each) for each in text.sizes}[size]


def load_cases(texts: Iterable[CaseText | Case], size: str = "fast") -> list[Case]:
    """Read cases that are not loaded yet; a mistake that variants share is told of the
    first.
    """
    cases: list[Case] = []
    sentences: dict[tuple[Path, str], str] = {}
    for text in texts:
        if isinstance(text, Case):
            cases.append(text)
            continue
        try:
            cases.append(load_case(text, size))
        except InvalidCase as error:
            for sentence in error.args:
                key = (text.path, sentence.removeprefix(text.where))
                sentences.setdefault(key, sentence)
    if sentences:
        raise InvalidCase(*sentences.values())
    return cases


def case_at(text: CaseText, point: Mapping[str, Any], size: str) -> Case:
    """Return the case at a point of its sweep (values by their keys), which no gate
    judges.
    """
    tables = {k: v for k, v in text.tables.items() if k not in ("gate", "sweep")}
    for key, value in point.items():
        section, _, name = key.partition(".")
        tables[section] = {**tables.get(section, {}), name: value}
    try:
        case = _read(replace(text, tables=tables), size, judged=False)
    except InvalidCase as error:
        values = ", ".join(f"{key} = {value!r:.40}" for key, value in point.items())
        at = f"(at the point {values} of its sweep)"
        raise InvalidCase(*(f"{sentence} {at}" for sentence in error.args)) from None
    unread = {m.table for m in METHODS.values()} - {
        METHODS[name].table for name in case.methods
    }
    for key in point:
        if key.partition(".")[0] in unread:
            raise InvalidCase(
                f"{text.where}: [sweep] no method of the case reads {key}"
            )
    return case


def _read(text: CaseText, size: str, *, judged: bool = True) -> Case:
    context = {"path": text.path, "folder": text.path.parent, "size": size}
    try:
        case = Case.model_validate(at_size(text.tables, size), context=context)
        mistakes = [
            *_mistakes(case, text),
            *(_gate_mistakes(case, text.sizes) if judged else ()),
        ]
        if not mistakes:
            return case
    except ValidationError as error:
        mistakes = told(error)
    except (
        EpcontactError
    ) as error:  # a grid too large for memory; pydantic wraps only ValueErrors
        mistakes = [str(error)]
    raise InvalidCase(*(f"{text.where}: {sentence}" for sentence in mistakes))


def _mistakes(case: Case, text: CaseText) -> Iterator[str]:
    """Yield a sentence for each mistake between the tables of a case, its gates
    apart.
    """
    if case.id != text.id:
        yield f"case.id is {case.id!r}, but must be the file's name, {text.id!r}"
    for name in case.methods:
        table = METHODS[name].table
        given = getattr(case, table) if table else None
        if table and given is None:
            yield (
                f"case.methods asks for {name}, which needs a table [{table}]; "
                "`epcontact keys` lists its keys"
            )
        kind = getattr(case.surface, "kind", "self_affine")  # an absent file has none
        if getattr(given, "spectrum", "") == "analytic" and kind != "self_affine":
            yield (
                f"{table}.spectrum is 'analytic', but a surface of kind {kind} is not drawn from "
                "one; write spectrum = 'surface', which takes that of the heights"
            )
    yield from _counterface_mistakes(case)
    if case.sweep is None and not isinstance(case.surface, SurfaceAbsent):
        yield from _strength_mistakes(case)  # a sweep may give what its case lacks
    try:
        check_load(case.material, case.load)
        if not all(METHODS[name].follows_unloading for name in case.methods):
            check_loading(case.material, case.load)
    except EpcontactError as error:
        yield str(error)


def _counterface_mistakes(case: Case) -> Iterator[str]:
    """Yield why two bodies cannot be taken for one of their E*."""
    if case.counterface is None:
        return
    if case.body.kind != "half_space":
        yield f"[counterface] is a half-space, but [body] kind is {case.body.kind}; leave one out"
    if "fem" in case.methods and case.fem.law == "j2":
        yield (
            "[counterface] deforms, but J2 flow of fem is against a rigid flat; take fem.law = "
            "'capped', or leave [counterface] out"
        )
    analytic = case.theory is not None and case.theory.spectrum == "analytic"
    if case.counterface.surface is not None and "persson" in case.methods and analytic:
        yield (
            "theory.spectrum is 'analytic', but the roughness of two surfaces is drawn from none; "
            "write spectrum = 'surface', which takes that of the heights"
        )
    try:
        _ = case.recipes
    except EpcontactError as error:
        yield str(error)


def _strength_mistakes(case: Case) -> Iterator[str]:
    """Yield a sentence for a law without the stress at which it flows: a metal with a
    yield stress alone would be elastic to all methods but J2 flow, unseen.
    """
    law = case.fem.law if "fem" in case.methods else ""
    needed = {"j2": "yield_stress", "capped": "hardness"}.get(law, "")
    if needed and getattr(case.solid, needed) == math.inf:
        yield f"fem.law is {law!r}, but [material] {needed} is missing; give it, or another law"
    cap = case.solid.hardness
    if isinstance(cap, float) and cap < case.solid.yield_stress < math.inf:
        yield (
            f"[material] hardness is {cap:g} Pa, below the yield_stress of "
            f"{case.solid.yield_stress:g} Pa, so that contacts would flow before they yield; it is "
            "1.1 to 3 times the yield_stress, and 'effective' takes that of the map"
        )
    elastic = [name for name in case.methods if not METHODS[name].has_model_measures]
    flows = case.solid.yield_stress < math.inf
    if elastic and flows and "hardness" not in case.solid.model_fields_set:
        yield (
            f"[material] has a yield_stress and no hardness, at which {elastic[0]} flows; give "
            "hardness in Pa, as 'effective' (the cap that stands for J2 flow), or as inf for an "
            "elastic body"
        )


def _gate_mistakes(case: Case, sizes: tuple[str, ...]) -> Iterator[str]:
    """Yield a sentence for each gate that the case cannot answer."""
    for number, gate in enumerate(case.gate, start=1):
        for wrong in _unanswerable(gate, case, sizes):
            yield f"gate {number}: {wrong}"
    own = Counter(
        g.gate.name for g in case.gate if g.sizes is None or case.size in g.sizes
    )
    if case.gate and not own:
        yield f"no gate applies to size {case.size!r}, which the case offers"
    yield from (
        f"there are {n} gates {name}; keep one" for name, n in own.items() if n > 1
    )


def _unanswerable(gate: GateTable, case: Case, sizes: tuple[str, ...]) -> Iterator[str]:
    """Yield why the case cannot answer a gate."""
    for method in (gate.of, gate.against):
        if method in METHODS and method not in case.methods:
            yield f"reads {method}, which case.methods does not name; add it there"
    if absent := [size for size in gate.sizes or () if size not in sizes]:
        yield f"applies to size {absent[0]!r}, which the case does not offer"
    needs = QUANTITIES[gate.quantity].needs if gate.quantity in QUANTITIES else ()
    if "fields" in needs and not METHODS[gate.of].has_fields:
        yield f"{gate.quantity} is read of the fields of a method, but {gate.of} has none"
    capped = case.solid.hardness == "effective" or math.isfinite(case.solid.hardness)
    if "hardness" in needs and not capped:
        yield f"{gate.quantity} needs a finite material.hardness"
    if "J2 flow" in needs and not _has_model(gate, case):
        able = " or ".join(m.name for m in METHODS.values() if m.has_model_measures)
        yield (
            f"{gate.quantity} needs a gate of {able} against a number or each other, fem.law = "
            "'j2' and geometry = 'gap', a finite yield_stress, and one mean_pressure"
        )
    number = not isinstance(gate.against, str)
    if gate.norm == "l2" and (number or gate.against in METHODS):
        yield f"{gate.quantity} against {gate.against!r}: give a closed form that has it"
    if gate.quantity == "distribution" and number:
        yield f"a distribution against {gate.against!r}: give a closed form, or a method"


def _has_model(gate: GateTable, case: Case) -> bool:
    """Return whether a case can answer a gate on a model measure: J2 flow against a
    cap.
    """
    sides = {gate.of, gate.against} if isinstance(gate.against, str) else {gate.of}
    return (
        all(name in METHODS and METHODS[name].has_model_measures for name in sides)
        and (case.fem.law, case.fem.geometry) == ("j2", "gap")
        and case.solid.yield_stress < math.inf
        and len(case.load.path) == 1
    )
