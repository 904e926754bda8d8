"""Results and verdicts as tables for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from epcontact.cli.terminal import (
    WIDE,
    WordsTable,
    as_list,
    fit_table,
    new_table,
    print_sentence,
    text_of,
)
from epcontact.harness.case_files.case import Case
from epcontact.harness.gates import Estimate, GateVerdict
from epcontact.harness.solving.method_results import MethodResults, load_rows
from epcontact.harness.verdict.judgement import CaseVerdict, Verdict, tightest
from epcontact.harness.verdict.overview import (
    agreement,
    cases_by_subject,
    evidence,
    gate_words,
    headline,
    margin_text,
    skipped_cases,
    tightest_gates,
    uncovered_sentence,
)
from epcontact.output.charts.style import difference_text
from epcontact.output.loads import (
    Row,
    connection_sentences,
    load_cells,
)
from epcontact.results import COLUMNS

#: The style of each status of a case or gate.
STYLES = {
    "holds": "green",
    "falls short": "bold red",
    "error": "bold red",
    "skipped": "yellow",
}
#: Columns of the cases' table beside the requirement.
_BESIDE_REQUIREMENT = 110


def loads_table(
    loads: Mapping[str, tuple[Sequence[Row], str]],
    kind: str,
    width: int = WIDE,
    **units: str,
) -> Table:
    """Return a table of the loads of several results.

    Each load is a row, and each quantity a column.  Where a row has no room, and on a
    terminal with fewer columns than WIDE, each quantity is a row and each load a
    column; where that has no room, either, there is a line for each cell.  The elastic
    area is left out, because it is in the files.

    A cell "mean ± error" has the half-width of a 95 % interval; it is written by
    `epcontact.output.loads._cell`.  The error is computed from the solved load steps by
    `_mean_row` in `epcontact/harness/solving/method_results.py`: it is the root of the
    sum of squares of its parts.  Of the area, the column "error of the total area by"
    lists the parts.  The part "scatter" is half the 95 % interval of the mean over the
    surfaces; the solver reports the other parts for each load (`LoadStep.row` in
    `epcontact/results.py`).

    Args:
        loads: For each name the rows of its loads, from `load_rows`, and the text of
            the last column.
        kind: Heading of the names, such as "method".
        width: Columns of the terminal.
        units: Units of further columns, by name of the quantity; "" for none.
    """
    columns = {name: unit for name, unit in COLUMNS.items() if name != "elastic_area"}
    all_rows = [row for rows, _ in loads.values() for row in rows]
    titles, *cells = load_cells(all_rows, {**columns, **units})
    lines = [[kind, *titles, "surfaces"]]
    names = [(name, last) for name, (rows, last) in loads.items() for _ in rows]
    for (name, last), texts in zip(names, cells, strict=True):
        lines.append([name, *(x.replace(", ", "\n") for x in texts), last])
    in_two_lines = [[text.replace(" ±", "\n±") for text in line] for line in lines]
    table = _table_of_lines(in_two_lines, 2)
    table.narrower = _table_of_lines([*zip(*lines, strict=True)], 1)
    table.narrower.narrower = _table_of_lines([*zip(*in_two_lines, strict=True)], 1)
    table.narrower.narrower.narrower = as_list(_table_of_lines(lines, 2))
    if width >= WIDE:
        return table
    return table.narrower


def _table_of_lines(lines: Sequence[Sequence[str]], names: int) -> WordsTable:
    """Return a table of lines, the first of which has the headings.

    `names` is the number of columns, from the left, that hold words; the numbers in the
    others stay in one piece.
    """
    headings, *rows = lines
    table = new_table(headings[:names], headings[names:])
    for column in table.columns[names:]:
        column.no_wrap = names == 1
    for row in rows:
        table.add_row(*row)
    return table


def results_table(results: Mapping[str, MethodResults], width: int = WIDE) -> Table:
    """Return the table that `epcontact run` prints: each load of each method.

    `results` are those of a case by method, and `width` is that of the terminal in
    columns.  `loads_table` says where the numbers behind each ± are computed.
    """
    loads = {}
    for name, method in results.items():
        if method.results:
            loads[name] = (load_rows(method.results), str(len(method.results)))
    return loads_table(loads, "method", width)


def print_summary(console: Console, verdict: Verdict) -> None:
    """Print what a person reads first of a verdict.

    This is: whether it holds, how well methods agree, the gates nearest to falling
    short, and what is not covered.  `epcontact/harness/verdict/overview.py` says what
    each of them is; the first screen of the report has the same content.
    """
    style = STYLES["falls short"]
    if verdict.passed:
        style = STYLES["holds"]
    elif verdict.exit_code == 0:
        style = STYLES["skipped"]
    console.print(text_of(headline(verdict), f"bold {style}"))
    if evidence(verdict):
        print_sentence(console, evidence(verdict))
    table = _agreement_table(verdict, console.width)
    if table.row_count:
        console.print()
        console.print(table)
    if any(case.gates for case in verdict.cases):
        console.print()
        console.print(_tightest_table(verdict, console.width))
        print_sentence(
            console,
            "a gate holds if a difference, with its 95 % interval, lies in the band "
            "that is allowed; margin: the band over both, measured from its middle",
        )
    if uncovered_sentence(verdict):
        console.print()
        print_sentence(console, f"not covered: {uncovered_sentence(verdict)}")
    for reason, names in skipped_cases(verdict).items():
        print_sentence(console, f"  skipped: {', '.join(names)}: {reason}")


def _tightest_table(verdict: Verdict, width: int) -> Table:
    """Return the table of the gates nearest to falling short.

    A terminal of fewer than `_BESIDE_REQUIREMENT` columns gets no differences and
    bands.  `width` is the number of columns of the terminal.
    """
    is_wide = width >= _BESIDE_REQUIREMENT
    table = new_table(("least margin in", "gate"), ("margin",))
    if is_wide:
        for heading in ("difference ± 95 %", "band"):
            table.add_column(heading, no_wrap=True, justify="right")
    for case, gate in tightest_gates(verdict):
        row: list[str | Text] = [case.id, gate_words(gate), margin_text(gate)]
        if is_wide:
            row += _gate_row(gate)[5:7]
        table.add_row(*row)
    return fit_table(table, width)


def _agreement_table(verdict: Verdict, width: int) -> Table:
    """Return the table of how well methods agree, a row for each pair and quantity.

    The rows of a pair follow one with its name.  `width` is the number of columns of
    the terminal.
    """
    table = new_table(("agreement of",), ("gates", "median", "largest difference"))
    table.add_column("in case", overflow="fold")
    pair = ""
    for row in agreement(verdict):
        if row.pair != pair:
            table.add_row(text_of(row.pair, "bold"))
        pair = row.pair
        cells = [difference_text(row.median), difference_text(row.largest), row.case]
        table.add_row(Padding(row.quantity, (0, 0, 0, 2)), str(row.gates), *cells)
    return fit_table(table, width)


def subjects_table(verdict: Verdict, width: int) -> Table:
    """Return a table of what the cases of a verdict verify, a row for each subject.

    `width` is the number of columns of the terminal.
    """
    table = new_table(("cases that verify",), ("cases", "hold", "gates", "margin"))
    table.add_column("least in case", overflow="fold")
    for subject, cases in cases_by_subject(verdict).items():
        gates = [(case.id, gate) for case in cases for gate in case.gates]
        nearest = tightest(gate for _, gate in gates)
        margin = ""
        case_id = ""
        if nearest is not None:
            margin = margin_text(nearest)
            case_id = next(name for name, gate in gates if gate is nearest)
        held = sum(case.status == "holds" for case in cases)
        counts = map(str, (len(cases), held, len(gates)))
        table.add_row(subject, *counts, margin, case_id)
    return fit_table(table, width)


def leak_sentences(results: Mapping[str, MethodResults]) -> list[str]:
    """Return sentences that say whether the gap and the contact connect across the
    surface, by each method that measures it.

    `results` are those of a case by method.
    """
    sentences = []
    for name, method in results.items():
        if method.results:
            for sentence in connection_sentences(method.results):
                sentences.append(f"{name}: {sentence}")
    return sentences


#: The meaning of ± in every table, printed below the tables of loads.
MEANING_OF_ERRORS = (
    "±: half the width of the 95 % interval, from the grid, the treatment of a map, "
    "the hardness and the scatter of surfaces, as far as they are known"
)


def cases_table(cases: Sequence[CaseVerdict], width: int) -> Table:
    """Return a table of cases, each with its tightest gate.

    The tightest gate is the one nearest to the bound of its band, or one that could not
    be judged.  A terminal of WIDE columns also shows the requirement, as far as there
    is room.  `width` is the number of columns of the terminal.
    """
    is_wide = width >= WIDE
    table = new_table(("case", "verdict"), ("gates", "margin"))
    table.add_column("tightest gate", overflow="fold", no_wrap=is_wide)
    if is_wide:
        room = width - _BESIDE_REQUIREMENT
        table.add_column("requirement", no_wrap=True, max_width=room)
    for case in cases:
        margin = ""
        name = ""
        gate = tightest(case.gates)
        if gate:
            margin = margin_text(gate)
            name = f"{gate.quantity} of {gate.of}"
        count = str(len(case.gates))
        row: list[str | Text] = [case.id, _styled(case.status), count, margin, name]
        if is_wide:
            row.append(case.requirement)
        table.add_row(*row)
    return fit_table(table, width)


def verdict_table(cases: Sequence[CaseVerdict], width: int = WIDE) -> Table:
    """Return a table with a row for each gate of some cases.

    A terminal whose `width` is less than WIDE columns gets no values and references.
    """
    if width >= WIDE:
        table = _wide_gates(cases)
    else:
        table = _narrow_gates(cases)
    return fit_table(table, width)


def _wide_gates(cases: Sequence[CaseVerdict]) -> Table:
    """Return the table of gates with their values and references, for a wide terminal.

    A skipped case has a row without a gate.
    """
    texts = ("case", "quantity", "of", "against", "value", "reference")
    table = new_table(texts, ("difference", "band"))
    table.columns[-1].no_wrap = True
    table.add_column("verdict", no_wrap=True)
    for case in cases:
        if case.skipped_because:
            blank = [""] * (len(table.columns) - 2)
            table.add_row(text_of(case.id, "bold"), *blank, _styled(case.status))
        name = case.id
        for gate in case.gates:
            table.add_row(name, *_gate_row(gate))
            name = ""
    return table


def _narrow_gates(cases: Sequence[CaseVerdict]) -> Table:
    """Return the table of gates without values and references, for a narrow terminal.

    Each case has a row with its name, above those of its gates.
    """
    table = new_table(("gate",), ("difference", "band"))
    table.add_column("verdict", no_wrap=True)
    for case in cases:
        status = text_of("")
        if case.skipped_because:
            status = _styled(case.status)
        table.add_row(text_of(case.id, "bold"), "", "", status)
        for gate in case.gates:
            quantity, of, against, _, _, difference, band, verdict = _gate_row(gate)
            words = text_of(f"{quantity} of {of} against {against}")
            table.add_row(Padding(words, (0, 0, 0, 2)), difference, band, verdict)
    return table


def _styled(status: str) -> Text:
    """Return a status, a key of STYLES, in its colour."""
    return text_of(status, STYLES[status])


def _gate_row(gate: GateVerdict) -> tuple[str | Text, ...]:
    """Return the eight texts of a judged gate.

    They are: quantity with the norm of its difference, the method that is judged (of),
    its reference (against), value, reference, difference, band and verdict.  Value,
    reference, difference and band are empty if the gate could not be judged.  The
    number behind a ± is the half-width of a 95 % interval; a band "± x" reaches from -x
    to x.
    """
    against = gate.against if isinstance(gate.against, str) else "number"
    norm = "" if gate.norm in ("relative", "absolute") else f" ({gate.norm})"
    names = (gate.quantity + norm, gate.of, against)
    if gate.value is None or gate.reference is None or gate.difference is None:
        return (*names, "", "", "", "", _styled(gate.status))
    values = (shown_estimate(gate.value), shown_estimate(gate.reference))
    in_percent = gate.norm == "relative" and max(abs(gate.low), abs(gate.high)) >= 1e-4

    def show(x: float, digits: int = 2) -> str:
        """Return a difference `x` with its sign, in per cent or with an exponent.

        `digits` is the number of decimals.
        """
        return f"{100 * x:+.{digits}f} %" if in_percent else f"{x:+.{digits}e}"

    difference = show(gate.difference.mean)
    if gate.half_width:
        difference += f" ± {show(gate.half_width).lstrip('+')}"
    # The fewest digits that distinguish the ends of a narrow band.
    sufficient = (n for n in range(2, 12) if show(gate.low, n) != show(gate.high, n))
    digits = next(sufficient, 2)
    band = f"{show(gate.low, digits)} … {show(gate.high, digits)}"
    if gate.low == -gate.high:
        band = f"± {show(gate.high)[1:]}"
    return (*names, *values, difference, band, _styled(gate.status))


def gamma_sentence(case: Case) -> str:
    """Return the sentence on the energy reduction gamma of a case's theory.

    It is empty if no method of the case has the option `energy_reduction`.
    """
    for method in case.methods:
        gamma = case.options[method].get("energy_reduction")
        if gamma is not None:
            return f"theory with energy reduction gamma = {gamma:g}"
    return ""


def shown_estimate(estimate: Estimate) -> str:
    """Return a mean as text, with " ± " and the half-width of its 95 % interval.

    The interval joins the scatter of the surfaces and all error estimates.  A mean
    without an interval stands alone.
    """
    mean = f"{estimate.mean:.5g}"
    if estimate.uncertainty:
        return f"{mean} ± {estimate.uncertainty:.2g}"
    return mean


def print_surface_notes(
    console: Console, case: Case, results: Mapping[str, MethodResults]
) -> None:
    """Print the notes that all results of a case have: those on its surfaces.

    `results` are those of the case by method.
    """
    notes = []
    for method in results.values():
        notes += [result.notes for result in method.results]
    if not notes:
        return
    for note in notes[0]:
        if all(note in others for others in notes):
            print_sentence(console, f"{case.id}: {note}")


def print_shortfalls(console: Console, case: CaseVerdict) -> None:
    """Print the reasons why a case does not hold.

    These are each gate that does not hold, and each error of a solve that no gate
    reports; gates with the same error are printed once.
    """
    printed = set()
    for gate in case.gates:
        reason = gate.error or gate.name
        if not gate.holds and reason not in printed:
            printed.add(reason)
            print_sentence(console, f"{case.id}: {gate}")
    for error in case.unread_errors:
        print_sentence(console, f"{case.id}: {error}")
