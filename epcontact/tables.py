"""Answers and verdicts as tables for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.table import Table

from epcontact.compare import Estimate, estimate
from epcontact.run import Answer
from epcontact.verify import CaseOutcome, GateOutcome, describe

STYLES = {"holds": "green", "falls short": "bold red", "error": "bold red", "skipped": "yellow"}


def answers_table(answers: Mapping[str, Answer]) -> Table:
    """The areas of each method, with the interval of their mean."""
    table = Table(box=None, pad_edge=False)
    headings = ("method", "areas", "total", "elastic", "plastic", "surfaces", "reused")
    for heading in headings:
        table.add_column(heading, justify="left" if heading in ("method", "areas") else "right")
    for method, answer in answers.items():
        for kind in ("raw", "corrected"):
            if not answer.results or kind not in answer.results[0].final.areas:
                continue
            parts = [
                _figure(estimate([getattr(r.final.areas[kind], p) for r in answer.results]))
                for p in ("total", "elastic", "plastic")
            ]
            table.add_row(method, kind, *parts, str(len(answer.results)), str(answer.reused))
    return table


def verdict_table(outcomes: Sequence[CaseOutcome]) -> Table:
    """One row a gate."""
    table = Table(box=None, pad_edge=False)
    for heading in ("case", "quantity", "of", "against", "value", "reference"):
        table.add_column(heading, overflow="fold")
    table.add_column("difference", justify="right")
    table.add_column("band", justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    for outcome in outcomes:
        if outcome.case.skip:
            table.add_row(outcome.case.id, *[""] * 7, f"[{STYLES['skipped']}]skipped[/]")
        name = outcome.case.id
        for gate in outcome.gates:
            table.add_row(name, *_gate_row(gate))
            name = ""
    return table


def _gate_row(outcome: GateOutcome) -> tuple[str, ...]:
    gate, verdict = outcome.gate, outcome.verdict
    against = gate.against if isinstance(gate.against, str) else "number"
    status = f"[{STYLES[outcome.status]}]{outcome.status}[/]"
    if verdict is None:
        return (gate.quantity, gate.of, against, "", "", "", "", status)
    percent = gate.norm == "relative" and max(abs(gate.low), abs(gate.high)) >= 1e-4

    def show(x: float) -> str:
        return f"{100 * x:+.2f} %" if percent else f"{x:+.2e}"

    difference = show(verdict.difference.mean)
    if verdict.difference.half_width:
        difference += f" ± {show(verdict.difference.half_width).lstrip('+')}"
    symmetric = gate.low == -gate.high
    band = f"± {show(gate.high)[1:]}" if symmetric else f"{show(gate.low)} … {show(gate.high)}"
    values = (_figure(verdict.value), _figure(verdict.reference))
    return (gate.quantity, gate.of, against, *values, difference, band, status)


def _figure(estimate: Estimate) -> str:
    if not estimate.half_width:
        return f"{estimate.mean:.5g}"
    return f"{estimate.mean:.5g} ± {estimate.half_width:.1g}"


def print_shortfalls(console: Console, outcome: CaseOutcome) -> None:
    """Say why a case was skipped, and what did not hold."""
    if outcome.case.skip:
        console.print(f"{outcome.case.id}: {outcome.case.skip}", markup=False)
    for gate in outcome.gates:
        if gate.status != "holds":
            console.print(f"{outcome.case.id}: {describe(gate)}", markup=False)
