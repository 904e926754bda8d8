"""Answers and verdicts as tables for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from epcontact.cli.listing import WIDE, fitting, table_of
from epcontact.harness.case_files.case import Case
from epcontact.harness.gates import Estimate, GateVerdict
from epcontact.harness.solving.method_results import MethodResults, load_rows
from epcontact.harness.verdict.judgement import CaseVerdict, tightest
from epcontact.harness.verdict.overview import margin_text
from epcontact.output.loads import Row, load_cells
from epcontact.results import COLUMNS

STYLES = {
    "holds": "green",
    "falls short": "bold red",
    "error": "bold red",
    "skipped": "yellow",
}


def loads_table(
    found: Mapping[str, tuple[Sequence[Row], str]],
    of: str,
    width: int = WIDE,
    **units: str,
) -> Table:
    """Tabulate rows of loads by what they are `of`, such as a method, each with a last
    remark; in fewer columns than WIDE a line for each figure.  The elastic area is left
    to the files.
    """
    rows = [row for each, _ in found.values() for row in each]
    names = [(name, said) for name, (each, said) in found.items() for _ in each]
    shown = {name: unit for name, unit in COLUMNS.items() if name != "elastic_area"}
    titles, *cells = load_cells(rows, {**shown, **units})
    titles = [of, *titles, "surfaces"]
    table = table_of(titles[:2], titles[2:])
    for (name, said), texts in zip(names, cells, strict=True):
        line, wide = (name, *texts, said), width >= WIDE
        table.add_row(
            *(x.replace(", ", "\n").replace(" ±", "\n±") if wide else x for x in line)
        )
    return fitting(table, width, WIDE)


def results_table(results: Mapping[str, MethodResults], width: int = WIDE) -> Table:
    """Tabulate each load of each method: what is known of it, and how sure that is."""
    found = {name: answer for name, answer in results.items() if answer.results}
    rows = {m: (load_rows(a.results), f"{len(a.results)}") for m, a in found.items()}
    return loads_table(rows, "method", width)


def cases_table(cases: Sequence[CaseVerdict], width: int) -> Table:
    """Tabulate the cases, one in each row, each with the gate that is nearest to its
    band's end, or that could not be judged; in WIDE columns with what it requires, as
    far as there is room.
    """
    table = table_of(("case", "verdict"), ("gates", "margin"))
    table.add_column("tightest gate", overflow="fold", no_wrap=width >= WIDE)
    if width >= WIDE:
        table.add_column("requirement", no_wrap=True, max_width=width - 110)
    for case in cases:
        row: list[str | Text] = [case.id, _styled(case.status), f"{len(case.gates)}"]
        if gate := tightest(case.gates):
            row += [margin_text(gate), Text(f"{gate.quantity} of {gate.of}")]
        row += [""] * (5 - len(row)) + [Text(case.requirement)] * (width >= WIDE)
        table.add_row(*row)
    return fitting(table, width)


def verdict_table(cases: Sequence[CaseVerdict], width: int = WIDE) -> Table:
    """Tabulate the gates, one in each row; in fewer columns than WIDE without their
    values.
    """
    wide = width >= WIDE
    names = (
        ("case", "quantity", "of", "against", "value", "reference")
        if wide
        else ("gate",)
    )
    table = table_of(names, ("difference", "band"))
    table.columns[-1].no_wrap = wide
    table.add_column("verdict", no_wrap=True)
    for case in cases:
        skipped = (_styled(case.status),) if case.skipped_because else ()
        if skipped or not wide:
            blank = [""] * (len(table.columns) - 1 - len(skipped))
            table.add_row(f"[bold]{case.id}[/]", *blank, *skipped)
        for number, gate in enumerate(case.gates):
            row = _gate_row(gate)
            if wide:
                table.add_row("" if number else case.id, *row)
            else:
                quantity, of, against, _, _, *judged = row
                gate_of = Padding(f"{quantity} of {of} against {against}", (0, 0, 0, 2))
                table.add_row(gate_of, *judged)
    return fitting(table, width)


def _styled(status: str) -> str:
    return f"[{STYLES[status]}]{status}[/]"


def _gate_row(gate: GateVerdict) -> tuple[str, ...]:
    against = gate.against if isinstance(gate.against, str) else "number"
    norm = "" if gate.norm in ("relative", "absolute") else f" ({gate.norm})"
    names = (gate.quantity + norm, gate.of, against)
    if gate.value is None or gate.reference is None or gate.difference is None:
        return (*names, "", "", "", "", _styled(gate.status))
    percent = gate.norm == "relative" and max(abs(gate.low), abs(gate.high)) >= 1e-4

    def show(x: float, digits: int = 2) -> str:
        return f"{100 * x:+.{digits}f} %" if percent else f"{x:+.{digits}e}"

    difference = show(gate.difference.mean)
    if gate.half_width:
        difference += f" ± {show(gate.half_width).lstrip('+')}"
    # The fewest digits that distinguish the ends of a narrow band.
    apart = (n for n in range(2, 12) if show(gate.low, n) != show(gate.high, n))
    digits = next(apart, 2)
    band = f"{show(gate.low, digits)} … {show(gate.high, digits)}"
    if gate.low == -gate.high:
        band = f"± {show(gate.high)[1:]}"
    values = (shown_estimate(gate.value), shown_estimate(gate.reference))
    return (*names, *values, difference, band, _styled(gate.status))


def gamma_sentence(case: Case) -> str:
    """Return the sentence on the theory's energy reduction; empty if no method is the
    theory.
    """
    options = [case.options[method] for method in case.methods]
    gammas = [o["energy_reduction"] for o in options if "energy_reduction" in o]
    return f"theory with energy reduction gamma = {gammas[0]:g}" if gammas else ""


def shown_estimate(estimate: Estimate) -> str:
    """Return a mean, with the half-width of its interval if it has one."""
    half = f" ± {estimate.half_width:.2g}" if estimate.half_width else ""
    return f"{estimate.mean:.5g}{half}"


def print_surface_notes(
    console: Console, case: Case, results: Mapping[str, MethodResults]
) -> None:
    """Print what was done to the surfaces of a case, and what to beware of."""
    notes = [result.notes for answer in results.values() for result in answer.results]
    for note in notes[0] if notes else ():
        if all(note in others for others in notes):
            print_hanging(console, f"{case.id}: {note}")


def print_shortfalls(console: Console, case: CaseVerdict) -> None:
    """Print why a case was skipped, the gates that do not hold, and each error once."""
    first = {gate.error or gate.name: gate for gate in reversed(case.gates)}
    failed = [g for g in case.gates if not g.holds and first[g.error or g.name] is g]
    for sentence in filter(None, (case.skipped_because, *failed, *case.unread_errors)):
        print_hanging(console, f"{case.id}: {sentence}")


def print_hanging(console: Console, sentence: str) -> None:
    """Print a sentence, on a terminal in lines of whole words of which the further are
    indented.
    """
    width = console.width - 2 if console.is_terminal else 2 * len(sentence)
    for number, line in enumerate(Text(sentence).wrap(console, width)):
        console.print(Text("  " * bool(number)) + line, soft_wrap=True)
