"""The first screen of the report: what was verified by what evidence, and what was
not.
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

_Judged = tuple[CaseVerdict, GateVerdict]


def overview(verdict: Verdict) -> dict[str, Any]:
    """Return the matrix of a verdict, its cases by family, and what no gate judges."""
    judged = [(case, gate) for case in verdict.cases for gate in case.gates]
    subjects = [*SUBJECTS, *sorted({gate.subject for _, gate in judged} - {*SUBJECTS})]
    kinds = [*KINDS, *sorted({gate.kind for _, gate in judged} - {*KINDS})]
    families: dict[str, list[dict[str, Any]]] = {}
    for case in verdict.cases:
        row = _row((case, gate) for gate in case.gates)
        row |= {"id": case.id, "status": case.status, "requirement": case.requirement}
        families.setdefault(case.family or case.id, []).append(row)
    known = {gate.quantity for _, gate in judged}
    return {
        "kinds": {kind: KINDS.get(kind, "") for kind in kinds},
        "matrix": {
            subject: [
                _cell(
                    [
                        (c, g)
                        for c, g in judged
                        if (g.subject, g.kind) == (subject, kind)
                    ]
                )
                for kind in kinds
            ]
            for subject in subjects
        },
        "references": references(verdict),
        "families": families,
        "uncovered": [one for name, one in QUANTITIES.items() if name not in known],
        "experiments": {}
        if any(g.kind == "experiment" for _, g in judged)
        else EXPERIMENTS,
    }


def references(verdict: Verdict) -> str:
    """Return one sentence on the kinds of the gates' references."""
    counts = Counter(gate.kind for case in verdict.cases for gate in case.gates)
    told = ", ".join(f"{kind} {counts[kind]}" for kind in KINDS if counts[kind])
    others = sum(counts[kind] for kind in OF_OTHERS)
    return (
        f"references: {told}; {others} of {counts.total()} gates compare with the work "
        "of others"
    )


def _row(judged: Iterable[_Judged]) -> dict[str, Any]:
    """Return how many gates there are and hold, and the one nearest to its band's
    end.
    """
    found = list(judged)
    nearest = tightest(gate for _, gate in found)
    row = {"gates": len(found), "held": sum(gate.holds for _, gate in found)}
    return row | (
        {"margin": margin_text(nearest), "nearest": nearest.name} if nearest else {}
    )


def _cell(judged: list[_Judged]) -> dict[str, Any]:
    """Return the row of a cell, with its cases, each with its own worst margin
    there.
    """
    if not judged:
        return {}
    statuses = {gate.status for _, gate in judged}
    worst = next((s for s in (ERROR, FALLS_SHORT) if s in statuses), "holds")
    ids = dict.fromkeys(case.id for case, _ in judged)
    cases = {name: _row(pair for pair in judged if pair[0].id == name) for name in ids}
    return _row(judged) | {"status": worst, "cases": cases}


def margin_text(gate: GateVerdict) -> str:
    """Return a margin in words: that of rounding is "exact", and what was not judged
    has none.
    """
    if math.isnan(gate.margin):
        return "–"
    return "exact" if gate.margin > 1000 else f"{gate.margin:.3g}"
