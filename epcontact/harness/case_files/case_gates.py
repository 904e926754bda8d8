"""The gates of a case file, checked against what its scene and methods can answer."""

from __future__ import annotations

import functools
import math
import tomllib
from collections.abc import Sequence
from importlib.resources import files

from epcontact.errors import InvalidCase, nearest
from epcontact.harness.case_files.schema import CaseFile, GateTable
from epcontact.harness.gates.gate import Gate
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.quantities.registry import QUANTITIES, REPORTED_GROUPS
from epcontact.reference import CLOSED_FORMS


@functools.cache
def default_gates() -> tuple[GateTable, ...]:
    """Return the gates of `default_gates.toml`, which every case of a method must hold.

    Example:
        >>> [gate.quantity for gate in default_gates() if gate.of == "bem"][0]
        'quantity.measured_force'
    """
    text = files("epcontact.harness.case_files").joinpath("default_gates.toml").read_text("utf-8")
    return tuple(GateTable.model_validate(gate) for gate in tomllib.loads(text)["gate"])


def gates_of(where: str, table: CaseFile, size: str) -> tuple[Gate, ...]:
    """Return the gates of a case at a size: its own, and the default gates of its methods.

    A gate of the case replaces the default gate on the same quantity of the same method; a table
    [[omit]] removes a default gate.  A case that is there for its sweep, without a gate of its own,
    is not judged.

    Raises:
        InvalidCase: if a gate cannot be judged, or [[omit]] names no default gate.
    """
    for number, gate in enumerate(table.gate, start=1):
        _require_answerable(f"{where}: gate {number}", gate, table)
    own = [gate for gate in table.gate if gate.sizes is None or size in gate.sizes]
    if not table.gate:
        if table.sweep is None:
            raise InvalidCase(f"{where}: gate is missing; add it (a table [[gate]])")
        return ()
    if table.gate and not own:
        raise InvalidCase(f"{where}: no gate applies to size {size!r}, which the case offers")
    names = [_gate(gate).name for gate in own]
    repeated = next((name for name in names if names.count(name) > 1), "")
    if repeated:
        raise InvalidCase(f"{where}: there are {names.count(repeated)} gates {repeated}; keep one")
    defaults = {(gate.of, gate.quantity): gate for gate in default_gates()}
    for omitted in table.omit:
        if (omitted.of, omitted.quantity) not in defaults:
            known = [quantity for of, quantity in defaults if of == omitted.of]
            raise InvalidCase(
                f"{where}: omit has {omitted.quantity!r} of {omitted.of}, which is no default "
                f"gate{nearest(omitted.quantity, known)}"
            )
    replaced = {(gate.of, gate.quantity) for gate in (*own, *table.omit)}
    shared = [
        gate
        for key, gate in defaults.items()
        if gate.of in table.case.methods and size in (gate.sizes or ()) and key not in replaced
    ]
    return tuple(map(_gate, (*own, *shared)))


def not_judged(where: str, table: CaseFile, size: str, sizes: Sequence[str]) -> tuple[str, ...]:
    """Return a sentence for each gate that the case has or omits and that this size leaves out.

    Raises:
        InvalidCase: if a gate applies to a size that the case does not offer.
    """
    sentences = []
    for number, gate in enumerate(table.gate, start=1):
        absent = [each for each in gate.sizes or () if each not in sizes]
        if absent:
            raise InvalidCase(
                f"{where}: gate {number} applies to size {absent[0]!r}, which the case does not "
                f"offer; it has {', '.join(sizes)}"
            )
        if gate.sizes and size not in gate.sizes:
            sentences.append(f"{_gate(gate).name} applies to size {' and '.join(gate.sizes)} only")
    return (
        *sentences,
        *(f"default gate {o.quantity} of {o.of} is omitted: {o.because}" for o in table.omit),
    )


def _require_answerable(where: str, gate: GateTable, table: CaseFile) -> None:
    for method in (gate.of, gate.against):
        if method in METHODS and method not in table.case.methods:
            raise InvalidCase(
                f"{where} reads {method}, which case.methods does not name; add it there"
            )
    needs = _needs(where, gate)
    if "fields" in needs and not METHODS[gate.of].has_fields:
        raise InvalidCase(
            f"{where}: {gate.quantity} is read of the fields of a method, but {gate.of} has none"
        )
    if "J2 flow" in needs:
        _require_model(where, gate, table, needs)
    if isinstance(gate.against, str) and gate.against not in METHODS:
        _require_closed_form(where, gate)
    elif gate.norm == "l2" or (
        gate.quantity == "distribution" and not isinstance(gate.against, str)
    ):
        raise InvalidCase(
            f"{where}: {gate.quantity} is compared with {gate.against!r}, but needs a closed "
            "form that has it" + (" or a method" if gate.norm != "l2" else "")
        )


def _needs(where: str, gate: GateTable) -> tuple[str, ...]:
    """Return the needs of the gate's quantity; a user's solver may report quantities of its own."""
    if gate.quantity in QUANTITIES:
        return QUANTITIES[gate.quantity].needs
    if METHODS[gate.of].source and gate.quantity.startswith(REPORTED_GROUPS):
        return ()
    raise InvalidCase(
        f"{where}: no quantity is called {gate.quantity!r}{nearest(gate.quantity, QUANTITIES)}"
    )


def _require_closed_form(where: str, gate: GateTable) -> None:
    name = str(gate.against)
    if name not in CLOSED_FORMS:
        raise InvalidCase(
            f"{where} has against = {name!r}, which is neither a method nor a closed "
            f"form{nearest(name, CLOSED_FORMS)}"
        )
    if not CLOSED_FORMS[name].knows(gate.quantity):
        raise InvalidCase(
            f"{where}: the closed form {name} has no {gate.quantity!r}; it has "
            f"{', '.join(CLOSED_FORMS[name].quantities)}"
        )


def _require_model(where: str, gate: GateTable, table: CaseFile, needs: tuple[str, ...]) -> None:
    """Refuse a gate on a model measure (J2 flow against a cap) that the case cannot answer."""
    wrong, able = "", [m.name for m in METHODS.values() if m.has_model_measures]
    if not {gate.of, *([gate.against] if isinstance(gate.against, str) else [])} <= set(able):
        wrong = (
            f"needs a gate of {' or '.join(able)} against a number or each other, not of {gate.of} "
            f"against {gate.against!r}"
        )
    elif table.fem.law != "j2":
        wrong = f"needs fem.law = 'j2', but it is {table.fem.law!r}"
    elif table.fem.geometry != "gap":
        wrong = f"needs fem.geometry = 'gap', but it is {table.fem.geometry!r}"
    elif not math.isfinite(table.material.yield_stress):
        wrong = "needs a finite material.yield_stress, at which J2 flows"
    elif not math.isfinite(table.material.hardness) and "hardness" in needs:
        wrong = "needs a finite material.hardness, the cap that J2 is compared with"
    elif isinstance(table.load.mean_pressure, list) and len(table.load.mean_pressure) > 1:
        wrong = "needs a single load.mean_pressure, but it is a path"
    if wrong:
        raise InvalidCase(f"{where}: {gate.quantity} {wrong}")


def _gate(table: GateTable) -> Gate:
    low, high = table.between or (-float(table.tolerance or 0), float(table.tolerance or 0))
    return Gate(
        table.quantity, table.of, table.against, table.norm, low, high, table.because, table.source
    )
