"""The gates of a case file, checked against what its scene and methods can answer."""

from __future__ import annotations

import functools
import math
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from importlib.resources import files

from epcontact.errors import nearest
from epcontact.harness.case_files.schema import CaseFile, GateTable
from epcontact.harness.gates.gate import Gate
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.quantities.registry import QUANTITIES


@functools.cache
def default_gates() -> tuple[GateTable, ...]:
    """Return the gates of `default_gates.toml`, which every case of a method must hold.

    Example:
        >>> [gate.quantity for gate in default_gates() if gate.of == "bem"][0]
        'quantity.measured_force'
    """
    text = files("epcontact.harness.case_files").joinpath("default_gates.toml").read_text("utf-8")
    return tuple(GateTable.model_validate(gate) for gate in tomllib.loads(text)["gate"])


def gates_of(table: CaseFile, size: str) -> tuple[Gate, ...]:
    """Return the gates of a case at a size: its own, and the default gates of its methods.

    A gate of the case replaces the default gate on the same quantity of the same method; a table
    [[omit]] removes a default gate.  A case that is there for its sweep, without a gate of its own,
    is not judged.
    """
    if not table.gate:
        return ()
    own = _gates_at(table, size)
    replaced = {(gate.of, gate.quantity) for gate in (*own, *table.omit)}
    shared = [
        gate
        for gate in default_gates()
        if gate.of in table.case.methods
        and size in (gate.sizes or ())
        and (gate.of, gate.quantity) not in replaced
    ]
    return tuple(map(_gate, (*own, *shared)))


def not_judged(table: CaseFile, size: str) -> tuple[str, ...]:
    """Return a sentence for each gate that the case has or omits and that this size leaves out."""
    return (
        *(
            f"{_gate(gate).name} applies to size {' and '.join(gate.sizes)} only"
            for gate in table.gate
            if gate.sizes and size not in gate.sizes
        ),
        *(f"default gate {o.quantity} of {o.of} is omitted: {o.because}" for o in table.omit),
    )


def gate_mistakes(table: CaseFile, size: str, sizes: Sequence[str]) -> Iterator[str]:
    """Yield a sentence for each gate that the case cannot answer, and for each wrong [[omit]].

    Args:
        table: the case.
        size: the size at which it is read.
        sizes: all sizes that it offers.
    """
    for number, gate in enumerate(table.gate, start=1):
        for wrong in _unanswerable(gate, table, sizes):
            yield f"gate {number}: {wrong}"
    if not table.gate and table.sweep is None:
        yield "gate is missing; add it (a table [[gate]])"
    own = _gates_at(table, size)
    if table.gate and not own:
        yield f"no gate applies to size {size!r}, which the case offers"
    for name, count in Counter(_gate(gate).name for gate in own).items():
        if count > 1:
            yield f"there are {count} gates {name}; keep one"
    for omitted in table.omit:
        known = [gate.quantity for gate in default_gates() if gate.of == omitted.of]
        if omitted.quantity not in known:
            yield (
                f"omit has {omitted.quantity!r} of {omitted.of}, which is no default "
                f"gate{nearest(omitted.quantity, known)}"
            )


def _gates_at(table: CaseFile, size: str) -> list[GateTable]:
    return [gate for gate in table.gate if gate.sizes is None or size in gate.sizes]


def _unanswerable(gate: GateTable, table: CaseFile, sizes: Sequence[str]) -> Iterator[str]:
    """Yield why the case cannot answer a gate."""
    for method in (gate.of, gate.against):
        if method in METHODS and method not in table.case.methods:
            yield f"reads {method}, which case.methods does not name; add it there"
    for size in gate.sizes or ():
        if size not in sizes:
            yield (
                f"applies to size {size!r}, which the case does not offer; it has "
                f"{', '.join(sizes)}"
            )
    needs = QUANTITIES[gate.quantity].needs if gate.quantity in QUANTITIES else ()
    if "fields" in needs and not METHODS[gate.of].has_fields:
        yield f"{gate.quantity} is read of the fields of a method, but {gate.of} has none"
    if "J2 flow" in needs and (wrong := _no_model(gate, table, needs)):
        yield f"{gate.quantity} {wrong}"
    number = not isinstance(gate.against, str)
    if (gate.norm == "l2" and (number or gate.against in METHODS)) or (
        gate.quantity == "distribution" and number
    ):
        yield (
            f"{gate.quantity} is compared with {gate.against!r}, but needs a closed form that has "
            "it" + (" or a method" if gate.norm != "l2" else "")
        )


def _no_model(gate: GateTable, table: CaseFile, needs: tuple[str, ...]) -> str:
    """Return what the case lacks for a gate on a model measure (J2 flow against a cap), or ""."""
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
    return wrong


def _gate(table: GateTable) -> Gate:
    low, high = table.between or (-float(table.tolerance or 0), float(table.tolerance or 0))
    return Gate(
        table.quantity, table.of, table.against, table.norm, low, high, table.because, table.source
    )
