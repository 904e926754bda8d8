"""Gates as a case file states them, checked against what its scene and methods can answer."""

from __future__ import annotations

import math
from pathlib import Path

from epcontact.errors import InvalidCase, nearest
from epcontact.harness.gates import Gate
from epcontact.harness.methods import METHODS
from epcontact.harness.quantities import QUANTITIES, REPORTED_GROUPS
from epcontact.harness.schema import CaseFile, GateTable
from epcontact.reference import CLOSED_FORMS


def gates_of(path: Path, table: CaseFile, size: str) -> tuple[Gate, ...]:
    """The gates that apply to a size.  Raises InvalidCase for any that cannot be judged."""
    gates = []
    for number, gate in enumerate(table.gate, start=1):
        where = f"{path}: gate {number}"
        for method in (gate.of, gate.against):
            if method in METHODS and method not in table.case.methods:
                raise InvalidCase(
                    f"{where} reads {method}, which case.methods does not name; add it there"
                )
        needs = _needs(where, gate)
        if "J2 flow" in needs:
            _require_model(where, gate, table, needs)
        if isinstance(gate.against, str) and gate.against not in METHODS:
            _require_closed_form(where, gate)
        elif gate.norm == "l2" or (
            gate.quantity == "distribution" and not isinstance(gate.against, str)
        ):
            raise InvalidCase(
                f"{where}: {gate.quantity} is held against {gate.against!r}, but needs a closed "
                "form that has it" + (" or a method" if gate.norm != "l2" else "")
            )
        if gate.sizes is None or size in gate.sizes:
            gates.append(_gate(gate))
    if not gates:
        raise InvalidCase(f"{path}: no gate applies to size {size!r}, which the case offers")
    return tuple(gates)


def _needs(where: str, gate: GateTable) -> tuple[str, ...]:
    """The needs of the gate's quantity; a solver of the user's may report others than ours."""
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
    """Model measures say how J2 flow differs from a cap; a gate holds them against a number."""
    wrong = ""
    if not METHODS[gate.of].has_model_measures or isinstance(gate.against, str):
        able = " or ".join(m.name for m in METHODS.values() if m.has_model_measures)
        wrong = f"is read of {able} against a number, not of {gate.of} against {gate.against!r}"
    elif table.fem.law != "j2":
        wrong = f"needs fem.law = 'j2', but it is {table.fem.law!r}"
    elif table.fem.geometry != "gap":
        wrong = f"needs fem.geometry = 'gap', but it is {table.fem.geometry!r}"
    elif not math.isfinite(table.material.yield_stress):
        wrong = "needs a finite material.yield_stress, at which J2 flows"
    elif not math.isfinite(table.material.hardness) and "hardness" in needs:
        wrong = "needs a finite material.hardness, the cap that J2 is held against"
    elif isinstance(table.load.mean_pressure, list) and len(table.load.mean_pressure) > 1:
        wrong = "needs a single load.mean_pressure, but it is a path"
    if wrong:
        raise InvalidCase(f"{where}: {gate.quantity} {wrong}")


def _gate(table: GateTable) -> Gate:
    low, high = table.between or (-float(table.tolerance or 0), float(table.tolerance or 0))
    return Gate(
        table.quantity, table.of, table.against, table.norm, low, high, table.because, table.source
    )
