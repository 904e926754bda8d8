"""The first screen of the report: what was verified by what evidence, and what was not.

Gates are counted in a table, here called the matrix.  It has a row for each subject
(what a gate verifies) and a column for each kind of reference.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from typing import Any

from epcontact.harness.gates import ERROR, FALLS_SHORT, GateVerdict
from epcontact.harness.quantities.registry import QUANTITIES
from epcontact.harness.verdict.evidence import EXPERIMENTS, KINDS, OF_OTHERS, SUBJECTS
from epcontact.harness.verdict.judgement import CaseVerdict, Verdict, tightest

_GateOfCase = tuple[CaseVerdict, GateVerdict]
#: A margin above this is that of a difference by rounding alone.
_MARGIN_OF_ROUNDING = 1000


def overview(verdict: Verdict) -> dict[str, Any]:
    """Return the data of the report's first screen.

    Args:
        verdict: the verdict on all cases.

    Returns:
        A dictionary with these keys:

        - `kinds`: the meaning of each kind of reference by its name, the columns;
        - `matrix`: for each subject, the row of cells, see `_cell`; one cell per kind;
        - `references`: a sentence, see `references`;
        - `families`: for each case file, a list with one dictionary per case: its id,
          status, requirement and counts of gates, see `_gate_counts`;
        - `uncovered`: the quantities that no gate reads;
        - `experiments`: the measurements that no case uses, by kind; empty if a gate
          compares with an experiment.
    """
    gates = [(case, gate) for case in verdict.cases for gate in case.gates]
    subjects = _with_others(SUBJECTS, (gate.subject for _, gate in gates))
    kinds = _with_others(KINDS, (gate.kind for _, gate in gates))
    families: dict[str, list[dict[str, Any]]] = {}
    for case in verdict.cases:
        row = _gate_counts((case, gate) for gate in case.gates)
        row |= {"id": case.id, "status": case.status, "requirement": case.requirement}
        families.setdefault(case.family or case.id, []).append(row)
    judged_quantities = {gate.quantity for _, gate in gates}
    has_experiment = any(gate.kind == "experiment" for _, gate in gates)
    return {
        "kinds": {kind: KINDS.get(kind, "") for kind in kinds},
        "matrix": {subject: _matrix_row(gates, subject, kinds) for subject in subjects},
        "references": references(verdict),
        "families": families,
        "uncovered": [
            quantity
            for name, quantity in QUANTITIES.items()
            if name not in judged_quantities
        ],
        "experiments": {} if has_experiment else EXPERIMENTS,
    }


def _with_others(names: Iterable[str], used: Iterable[str]) -> list[str]:
    """Return names in their order, followed by the used ones that are not among them,
    sorted.
    """
    listed = list(names)
    return [*listed, *sorted({*used} - {*listed})]


def _matrix_row(
    gates: Iterable[_GateOfCase], subject: str, kinds: Iterable[str]
) -> list[dict[str, Any]]:
    """Return a row of the matrix: the cell of each kind of reference for one subject.

    Args:
        gates: all gates of the verdict, each with its case.
        subject: what the gates of the row verify.
        kinds: the kinds of reference, the columns in their order.
    """
    of_kind: dict[str, list[_GateOfCase]] = {kind: [] for kind in kinds}
    for case, gate in gates:
        if gate.subject == subject:
            of_kind[gate.kind].append((case, gate))
    return [_cell(gates_of_kind) for gates_of_kind in of_kind.values()]


def references(verdict: Verdict) -> str:
    """Return one sentence that counts the gates of a verdict by the kind of their
    reference, such as "references: identity 3; 0 of 3 gates compare with the work of
    others".
    """
    counts = Counter(gate.kind for case in verdict.cases for gate in case.gates)
    listed = ", ".join(f"{kind} {counts[kind]}" for kind in KINDS if counts[kind])
    others = sum(counts[kind] for kind in OF_OTHERS)
    return (
        f"references: {listed}; {others} of {counts.total()} gates compare with the "
        "work of others"
    )


def _gate_counts(gates: Iterable[_GateOfCase]) -> dict[str, Any]:
    """Return how many gates there are and hold, and the tightest one.

    Args:
        gates: gates of a verdict, each with its case.

    Returns:
        `gates` and `held`, two numbers of gates, and, unless there is no gate,
        `nearest`, the name of the gate with the least margin, and `margin`, its text.
    """
    verdicts = [gate for _, gate in gates]
    counts: dict[str, Any] = {
        "gates": len(verdicts),
        "held": sum(gate.holds for gate in verdicts),
    }
    nearest = tightest(verdicts)
    if nearest is not None:
        counts["margin"] = margin_text(nearest)
        counts["nearest"] = nearest.name
    return counts


def _cell(gates: list[_GateOfCase]) -> dict[str, Any]:
    """Return one cell of the matrix; empty if it has no gates.

    Args:
        gates: the gates of one subject and one kind of reference, with their cases.

    Returns:
        The counts of `_gate_counts`; `status`, the worst status of the gates; and
        `cases`, the counts of each case by its id.
    """
    if not gates:
        return {}
    statuses = {gate.status for _, gate in gates}
    worst = next((s for s in (ERROR, FALLS_SHORT) if s in statuses), "holds")
    by_case: dict[str, list[_GateOfCase]] = {}
    for case, gate in gates:
        by_case.setdefault(case.id, []).append((case, gate))
    cases = {name: _gate_counts(of_case) for name, of_case in by_case.items()}
    return _gate_counts(gates) | {"status": worst, "cases": cases}


def margin_text(gate: GateVerdict) -> str:
    """Return the margin of a judged gate as text, in three digits.

    The margin is the width of the band over the difference; see `GateVerdict.margin`.
    The text is "exact" for a margin above 1000, because only rounding separates such
    values, and "–" for a gate that could not be judged.
    """
    if math.isnan(gate.margin):
        return "–"
    return "exact" if gate.margin > _MARGIN_OF_ROUNDING else f"{gate.margin:.3g}"
