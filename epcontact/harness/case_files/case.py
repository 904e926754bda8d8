"""Case files are read and checked; every mistake of a file is reported in a sentence.

The mistakes that pydantic finds in a table hide those between the tables, which cannot
be read then.  A case is read at every size, so that a mistake in its full size shows
when the fast one is run.
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
from epcontact.harness.case_files.mistakes import sentences_of
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
from epcontact.scene import HARDENING_LAWS, check_load, check_loading
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
    """Read a case at one size, and check it at all of its sizes.

    Args:
        case: a name, a path or a case from `find_case`.
        size: "fast", "full" or "large".

    Raises:
        InvalidCase: if there is no such case or size, or if the case has mistakes.  The
            arguments of the exception are a sentence for each mistake.
    """
    text = case if isinstance(case, CaseText) else find_case(case)
    if size not in text.sizes:
        raise InvalidCase(
            f"{text.where}: has no size {size!r}; it has {', '.join(text.sizes)}"
        )
    at_sizes = {each: _read(text, each) for each in text.sizes}
    return at_sizes[size]


def load_cases(texts: Iterable[CaseText | Case], size: str = "fast") -> list[Case]:
    """Return cases at a size, in their order.

    Args:
        texts: cases as their files state them, or loaded cases, which are returned
            unchanged.
        size: the size at which the others are loaded.

    Raises:
        InvalidCase: with the mistakes of all cases.  A mistake that several variants of
            a file share is reported for the first of them.
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
    """Return the case at a point of its sweep, without gates.

    Args:
        text: the case.
        point: values by their keys, such as "material.hardness".
        size: one of its sizes.

    Raises:
        InvalidCase: if such a case is wrong, or if no method reads one of the keys.
    """
    tables = {
        name: table
        for name, table in text.tables.items()
        if name not in ("gate", "sweep")
    }
    for key, value in point.items():
        section, _, name = key.partition(".")
        tables[section] = {**tables.get(section, {}), name: value}
    try:
        case = _read(replace(text, tables=tables), size, judged=False)
    except InvalidCase as error:
        values = ", ".join(f"{key} = {value!r:.40}" for key, value in point.items())
        at = f"(at the point {values} of its sweep)"
        raise InvalidCase(*(f"{sentence} {at}" for sentence in error.args)) from None
    unread = {method.table for method in METHODS.values()}
    unread -= {METHODS[name].table for name in case.methods}
    for key in point:
        if key.partition(".")[0] in unread:
            raise InvalidCase(
                f"{text.where}: [sweep] no method of the case reads {key}"
            )
    return case


def _read(text: CaseText, size: str, *, judged: bool = True) -> Case:
    """Return a case at one size, after a check for mistakes.

    Args:
        text: the case as its file states it.
        size: one of its sizes.
        judged: whether its gates are checked, too.

    Raises:
        InvalidCase: with a sentence for each mistake.
    """
    context = {"path": text.path, "folder": text.path.parent, "size": size}
    try:
        case = Case.model_validate(at_size(text.tables, size), context=context)
        mistakes = list(_mistakes(case, text))
        if judged:
            mistakes += _gate_mistakes(case, text.sizes)
        if not mistakes:
            return case
    except ValidationError as error:
        mistakes = sentences_of(error)
    # A grid may be too large for the memory; pydantic wraps ValueErrors alone.
    except EpcontactError as error:
        mistakes = [str(error)]
    raise InvalidCase(*(f"{text.where}: {sentence}" for sentence in mistakes))


# --- mistakes between tables


def _mistakes(case: Case, text: CaseText) -> Iterator[str]:
    """Yield a sentence for each mistake of a case that involves several tables.

    Its gates are not checked here.  `text` gives the name that the case must have.
    """
    if case.id != text.id:
        yield f"case.id is {case.id!r}, but must be the file's name, {text.id!r}"
    yield from _method_mistakes(case)
    yield from _counterface_mistakes(case)
    # A sweep may give what its case lacks.
    if case.sweep is None and not isinstance(case.surface, SurfaceAbsent):
        yield from _strength_mistakes(case)
        yield from _hardening_mistakes(case)
    try:
        check_load(case.material, case.load)
        if not all(METHODS[name].follows_unloading for name in case.methods):
            check_loading(case.material, case.load)
    except EpcontactError as error:
        yield str(error)


def _method_mistakes(case: Case) -> Iterator[str]:
    """Yield a sentence for each method of a case that lacks its table, or that needs an
    analytic spectrum on a surface without one.
    """
    kind = getattr(case.surface, "kind", "self_affine")  # an absent file has none
    for name in case.methods:
        table = METHODS[name].table
        if not table:
            continue
        given = getattr(case, table)
        if given is None:
            yield (
                f"case.methods asks for {name}, which needs a table [{table}]; "
                "`epcontact keys` lists its keys"
            )
        if getattr(given, "spectrum", "") == "analytic" and kind != "self_affine":
            yield (
                f"{table}.spectrum is 'analytic', but a surface of kind {kind} is not "
                "drawn from one; write spectrum = 'surface', which takes that of the "
                "heights"
            )


def _counterface_mistakes(case: Case) -> Iterator[str]:
    """Yield a sentence for each reason why the two bodies of a case cannot be replaced
    by a single one of the same E*; nothing without a counterface.
    """
    if case.counterface is None:
        return
    if case.body.kind != "half_space":
        yield (
            f"[counterface] is a half-space, but [body] kind is {case.body.kind}; "
            "leave one out"
        )
    if _law_of_elements(case) == "j2":
        yield (
            "[counterface] deforms, but J2 flow of fem is against a rigid flat; take "
            "fem.law = 'capped', or leave [counterface] out"
        )
    analytic = case.theory is not None and case.theory.spectrum == "analytic"
    if case.counterface.surface is not None and "persson" in case.methods and analytic:
        yield (
            "theory.spectrum is 'analytic', but the roughness of two surfaces is drawn "
            "from none; write spectrum = 'surface', which takes that of the heights"
        )
    try:
        _ = case.recipes
    except EpcontactError as error:
        yield str(error)


def _law_of_elements(case: Case) -> str:
    """Return the law of the table [fem]; empty if no method of the case has it."""
    if any(METHODS[name].table == "fem" for name in case.methods):
        return case.fem.law
    return ""


def _strength_mistakes(case: Case) -> Iterator[str]:
    """Yield a sentence for each law without the stress at which it flows.

    A metal with a yield stress alone would be elastic in all methods but J2 flow, and
    nothing would say so.
    """
    law = _law_of_elements(case)
    needed = {"j2": "yield_stress", "capped": "hardness"}.get(law, "")
    if needed and getattr(case.solid, needed) == math.inf:
        yield (
            f"fem.law is {law!r}, but [material] {needed} is missing; give it, or "
            "another law"
        )
    hardness = case.solid.hardness
    if isinstance(hardness, float) and hardness < case.solid.yield_stress < math.inf:
        yield (
            f"[material] hardness is {hardness:g} Pa, below the yield_stress of "
            f"{case.solid.yield_stress:g} Pa, so that contacts would flow before they "
            "yield; it is 1.1 to 3 times the yield_stress, and 'effective' takes that "
            "of the map"
        )
    capped = [name for name in case.methods if not METHODS[name].has_model_measures]
    flows = case.solid.yield_stress < math.inf
    if capped and flows and "hardness" not in case.solid.model_fields_set:
        yield (
            f"[material] has a yield_stress and no hardness, at which {capped[0]} "
            "flows; give hardness in Pa, as 'effective' (the cap that stands for J2 "
            "flow), or as inf for an elastic body"
        )


def _hardening_mistakes(case: Case) -> Iterator[str]:
    """Yield a sentence for each reason why hardening would have no effect.

    A method with a cap on the pressure needs none: its hardness in Pa, which the case
    must give, is one number for the hardened metal.
    """
    solid = case.solid
    keys = [name for name in HARDENING_LAWS if getattr(solid, name)]
    if not keys:
        return
    key = keys[0]
    if solid.hardness == "effective":
        yield (
            f"[material] hardness is 'effective', the cap that stands for J2 flow "
            f"without hardening; leave {key} out, or give the hardness in Pa"
        )
    follows = [name for name in case.methods if METHODS[name].follows_hardening]
    if not follows or case.fem.law != "j2":
        yield (
            f"[material] {key} has no effect: theory and boundary elements have one "
            "largest pressure, and do not know the plastic strain; leave it out, or "
            "take the method fem with fem.law = 'j2'"
        )
    for name in case.methods:
        method = METHODS[name]
        if method.has_model_measures and not method.follows_hardening:
            yield f"{name} does not know [material] {key}; leave one of them out"


# --- mistakes of gates


def _gate_mistakes(case: Case, sizes: tuple[str, ...]) -> Iterator[str]:
    """Yield a sentence for each gate that the case cannot answer.

    Args:
        case: the case at one of its sizes.
        sizes: all of its sizes.
    """
    for number, gate in enumerate(case.gate, start=1):
        for mistake in _unanswerable(gate, case, sizes):
            yield f"gate {number}: {mistake}"
    names = Counter(
        gate.gate.name
        for gate in case.gate
        if gate.sizes is None or case.size in gate.sizes
    )
    if case.gate and not names:
        yield f"no gate applies to size {case.size!r}, which the case offers"
    for name, count in names.items():
        if count > 1:
            yield f"there are {count} gates {name}; keep one"


def _unanswerable(gate: GateTable, case: Case, sizes: tuple[str, ...]) -> Iterator[str]:
    """Yield a sentence for each reason why a case cannot be judged by a gate.

    Args:
        gate: one of its tables [[gate]].
        case: the case at one of its sizes.
        sizes: all of its sizes.
    """
    for method in (gate.of, gate.against):
        if method in METHODS and method not in case.methods:
            yield f"reads {method}, which case.methods does not name; add it there"
    absent = [size for size in gate.sizes or () if size not in sizes]
    if absent:
        yield f"applies to size {absent[0]!r}, which the case does not offer"
    yield from _missing_needs(gate, case)
    against_number = not isinstance(gate.against, str)
    other = METHODS.get(str(gate.against))
    has_no_field = against_number or (other and not other.has_fields)
    if gate.norm == "l2" and has_no_field:
        yield (
            f"{gate.quantity} against {gate.against!r}: give a closed form that has "
            "it, or a method with fields"
        )
    if gate.quantity == "distribution" and against_number:
        yield (
            f"a distribution against {gate.against!r}: give a closed form, or a method"
        )


def _missing_needs(gate: GateTable, case: Case) -> Iterator[str]:
    """Yield a sentence for each need of a gate's quantity that the case does not meet,
    such as fields of the method or a finite hardness.
    """
    if gate.quantity not in QUANTITIES:
        return
    needs = QUANTITIES[gate.quantity].needs
    if "fields" in needs and not METHODS[gate.of].has_fields:
        yield (
            f"{gate.quantity} is read of the fields of a method, but {gate.of} has none"
        )
    hardness = case.solid.hardness
    if "hardness" in needs and hardness != "effective" and not math.isfinite(hardness):
        yield f"{gate.quantity} needs a finite material.hardness"
    if "J2 flow" in needs and not _has_model(gate, case):
        able = " or ".join(m.name for m in METHODS.values() if m.has_model_measures)
        yield (
            f"{gate.quantity} needs a gate of {able} against a number or each other, "
            "fem.law = 'j2' and geometry = 'gap', a finite yield_stress, and one "
            "mean_pressure"
        )


def _has_model(gate: GateTable, case: Case) -> bool:
    """Return whether a case can be judged by a gate that compares J2 flow with a
    pressure cap.

    This needs methods with J2 flow, `fem.law = "j2"`, the geometry "gap" (the roughness
    is the initial gap over a flat block), a finite yield stress and a single load.
    """
    sides = {gate.of}
    if isinstance(gate.against, str):
        sides.add(gate.against)
    return (
        all(name in METHODS and METHODS[name].has_model_measures for name in sides)
        and case.fem.law == "j2"
        and case.fem.geometry == "gap"
        and case.solid.yield_stress < math.inf
        and len(case.load.path) == 1
    )
