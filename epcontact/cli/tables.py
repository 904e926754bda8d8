"""Answers and verdicts as tables for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.console import Console, JustifyMethod
from rich.table import Table

from epcontact.harness.case import Case
from epcontact.harness.gates import Estimate, estimate
from epcontact.harness.run import Answer
from epcontact.harness.verdict import CaseOutcome, GateOutcome, describe

#: Columns of a terminal from which on every figure of a gate stands in its row.
WIDE = 150
STYLES = {"holds": "green", "falls short": "bold red", "error": "bold red", "skipped": "yellow"}


def answers_table(answers: Mapping[str, Answer]) -> Table:
    """The areas of each method, with the interval of their mean."""
    table = Table(box=None, pad_edge=False)
    headings = ("method", "areas", "total", "elastic", "plastic", "surfaces", "reused")
    for heading in headings:
        side: JustifyMethod = "left" if heading in ("method", "areas") else "right"
        table.add_column(heading, justify=side, overflow="fold")
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


def verdict_table(outcomes: Sequence[CaseOutcome], width: int = WIDE) -> Table:
    """One row a gate; on a terminal narrower than WIDE without the values themselves, which
    verdict.json holds, as columns of a few letters can be read by nobody."""
    table = Table(box=None, pad_edge=False)
    wide = width >= WIDE
    headings = ("case", "quantity", "of", "against", "value", "reference") if wide else ("gate",)
    for heading in headings:
        table.add_column(heading, overflow="fold")
    table.add_column("difference", justify="right", overflow="fold")
    table.add_column("band", justify="right", overflow="fold", no_wrap=wide)
    table.add_column("verdict", no_wrap=True)
    for outcome in outcomes:
        skipped = (f"[{STYLES['skipped']}]skipped[/]",) if outcome.case.skip else ()
        if skipped or not wide:
            blank = [""] * (len(table.columns) - 1 - len(skipped))
            table.add_row(f"[bold]{outcome.case.id}[/]", *blank, *skipped)
        name = outcome.case.id
        for gate in outcome.gates:
            row = _gate_row(gate)
            if wide:
                table.add_row(name, *row)
            else:
                quantity, of, against, _, _, *judged = row
                table.add_row(f"  {quantity} of {of} against {against}", *judged)
            name = ""
    return table


def _gate_row(outcome: GateOutcome) -> tuple[str, ...]:
    gate, verdict = outcome.gate, outcome.verdict
    against = gate.against if isinstance(gate.against, str) else "number"
    status = f"[{STYLES[outcome.status]}]{outcome.status}[/]"
    if verdict is None:
        return (gate.quantity, gate.of, against, "", "", "", "", status)
    percent = gate.norm == "relative" and max(abs(gate.low), abs(gate.high)) >= 1e-4

    def show(x: float, digits: int = 2) -> str:
        return f"{100 * x:+.{digits}f} %" if percent else f"{x:+.{digits}e}"

    difference = show(verdict.difference.mean)
    if verdict.difference.half_width:
        difference += f" ± {show(verdict.difference.half_width).lstrip('+')}"
    if gate.low == -gate.high:
        band = f"± {show(gate.high)[1:]}"
    else:
        # As many digits as tell the ends of a narrow band apart.
        apart = (n for n in range(2, 12) if show(gate.low, n) != show(gate.high, n))
        digits = next(apart, 2)
        band = f"{show(gate.low, digits)} … {show(gate.high, digits)}"
    values = (_figure(verdict.value), _figure(verdict.reference))
    return (gate.quantity, gate.of, against, *values, difference, band, status)


def gamma_sentence(cases: Sequence[Case]) -> str:
    """The energy reduction behind every figure of the theory, or nothing where it gave none."""
    by_gamma: dict[float, list[str]] = {}
    for case in cases:
        if "persson" in case.methods and not case.skip:
            gamma = float(case.options["persson"]["energy_reduction"])
            by_gamma.setdefault(gamma, []).append(case.id)
    if not by_gamma:
        return ""
    if len(by_gamma) == 1:
        return f"theory with energy reduction gamma = {next(iter(by_gamma)):g}"
    parts = (f"{gamma:g} in {', '.join(ids)}" for gamma, ids in by_gamma.items())
    return f"theory with energy reduction gamma = {'; '.join(parts)}"


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
