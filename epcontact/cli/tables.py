"""Answers and verdicts as tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from rich.console import Console, JustifyMethod
from rich.table import Table

from epcontact.harness.answers.store import Answer
from epcontact.harness.case_files.case import Case
from epcontact.harness.gates.gate import GateVerdict
from epcontact.harness.gates.statistics import Estimate, estimate
from epcontact.harness.verdict.record import CaseVerdict
from epcontact.results import ContactResult

#: Smallest terminal width, in columns, at which a row shows every figure of a gate.
WIDE = 150
STYLES = {"holds": "green", "falls short": "bold red", "error": "bold red", "skipped": "yellow"}


def answers_table(answers: Mapping[str, Answer]) -> Table:
    """Tabulate the areas of each method, with the interval of their mean.

    The estimated error of the corrected areas is the mean of the surfaces' errors.
    """
    table = Table(box=None, pad_edge=False)
    headings = ("method", "areas", "total", "elastic", "plastic", "surfaces", "reused")
    for heading in headings:
        side: JustifyMethod = "left" if heading in ("method", "areas") else "right"
        table.add_column(heading, justify=side, overflow="fold")
    for method, answer in answers.items():
        for kind, parts in _area_rows(answer.results):
            table.add_row(method, kind, *parts, str(len(answer.results)), str(answer.reused))
    return table


def _area_rows(results: Sequence[ContactResult]) -> Iterator[tuple[str, list[str]]]:
    """Yield the kinds of areas that a method has, with their three parts as text."""
    means = {
        kind: [
            estimate([getattr(result.final.areas[kind], part) for result in results])
            for part in ("total", "elastic", "plastic")
        ]
        for kind in (results[0].final.areas if results else ())
    }
    for kind in ("raw", "corrected"):
        if kind in means:
            yield kind, [shown_estimate(mean) for mean in means[kind]]
    if any(mean.mean for mean in means.get("error", ())):  # a theory has no grid, so no error
        yield "error", [f"{mean.mean:.2g}" for mean in means["error"]]


def verdict_table(cases: Sequence[CaseVerdict], width: int = WIDE) -> Table:
    """Tabulate the gates, one in each row.

    A terminal narrower than WIDE omits the values, which would not be legible in so few columns;
    verdict.json holds them.
    """
    table = Table(box=None, pad_edge=False)
    wide = width >= WIDE
    headings = ("case", "quantity", "of", "against", "value", "reference") if wide else ("gate",)
    for heading in headings:
        table.add_column(heading, overflow="fold")
    table.add_column("difference", justify="right", overflow="fold")
    table.add_column("band", justify="right", overflow="fold", no_wrap=wide)
    table.add_column("verdict", no_wrap=True)
    for case in cases:
        skipped = (_styled(case.status),) if case.skipped_because else ()
        if skipped or not wide:
            blank = [""] * (len(table.columns) - 1 - len(skipped))
            table.add_row(f"[bold]{case.id}[/]", *blank, *skipped)
        name = case.id
        for gate in case.gates:
            row = _gate_row(gate)
            if wide:
                table.add_row(name, *row)
            else:
                quantity, of, against, _, _, *judged = row
                table.add_row(f"  {quantity} of {of} against {against}", *judged)
            name = ""
    return table


def _styled(status: str) -> str:
    return f"[{STYLES[status]}]{status}[/]"


def _gate_row(gate: GateVerdict) -> tuple[str, ...]:
    against = gate.against if isinstance(gate.against, str) else "number"
    names = (gate.quantity, gate.of, against)
    if gate.value is None or gate.reference is None or gate.difference is None:
        return (*names, "", "", "", "", _styled(gate.status))
    percent = gate.norm == "relative" and max(abs(gate.low), abs(gate.high)) >= 1e-4

    def show(x: float, digits: int = 2) -> str:
        return f"{100 * x:+.{digits}f} %" if percent else f"{x:+.{digits}e}"

    difference = show(gate.difference.mean)
    if gate.half_width:
        difference += f" ± {show(gate.half_width).lstrip('+')}"
    if gate.low == -gate.high:
        band = f"± {show(gate.high)[1:]}"
    else:
        # The fewest digits that distinguish the ends of a narrow band.
        apart = (n for n in range(2, 12) if show(gate.low, n) != show(gate.high, n))
        digits = next(apart, 2)
        band = f"{show(gate.low, digits)} … {show(gate.high, digits)}"
    values = (shown_estimate(gate.value), shown_estimate(gate.reference))
    return (*names, *values, difference, band, _styled(gate.status))


def gamma_sentence(cases: Sequence[Case]) -> str:
    """Return the sentence on the theory's energy reduction; empty if no case uses the theory."""
    by_gamma: dict[float, list[str]] = {}
    for case in cases:
        options = [case.options[method] for method in case.methods]
        gammas = [o["energy_reduction"] for o in options if "energy_reduction" in o]
        if gammas and not case.skip:
            by_gamma.setdefault(float(gammas[0]), []).append(case.id)
    if not by_gamma:
        return ""
    if len(by_gamma) == 1:
        return f"theory with energy reduction gamma = {next(iter(by_gamma)):g}"
    parts = (f"{gamma:g} in {', '.join(ids)}" for gamma, ids in by_gamma.items())
    return f"theory with energy reduction gamma = {'; '.join(parts)}"


def shown_estimate(estimate: Estimate) -> str:
    """Return a mean, with the half-width of its interval if it has one."""
    if not estimate.half_width:
        return f"{estimate.mean:.5g}"
    return f"{estimate.mean:.5g} ± {estimate.half_width:.1g}"


def print_surface_notes(console: Console, case: Case, answers: Mapping[str, Answer]) -> None:
    """Print what was done to the surfaces of a case, and what to beware of."""
    results = [result for answer in answers.values() for result in answer.results]
    shared = [set(result.notes) for result in results] or [set()]
    for note in results[0].notes if results else ():
        if all(note in notes for notes in shared):
            console.print(f"{case.id}: {note}", markup=False, highlight=False)


def print_shortfalls(console: Console, case: CaseVerdict) -> None:
    """Print why a case was skipped, the gates that do not hold, and each error once."""
    if case.skipped_because:
        console.print(f"{case.id}: {case.skipped_because}", markup=False)
    first = {gate.error or gate.name: gate for gate in reversed(case.gates)}
    for gate in case.gates:
        if not gate.holds and first[gate.error or gate.name] is gate:
            console.print(f"{case.id}: {gate}", markup=False)
    for sentence in case.unread_errors:
        console.print(f"{case.id}: {sentence}", markup=False)
