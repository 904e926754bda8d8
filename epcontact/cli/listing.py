"""The list of cases.  It reads their text only, so it waits for no schema and no solver
to load.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import click
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from epcontact.errors import InvalidCase
from epcontact.harness.case_files.text import (
    SIZES,
    CaseText,
    at_size,
    case_files,
    case_name,
    read_cases,
)

#: Smallest terminal widths, in columns, at which rows of long texts and others are a
#: table.
WIDE, NARROW = 150, 75


def open_console() -> Console:
    """Open standard output; in a pipe it is as wide as a table needs, not 80
    columns.
    """
    plain = Console()
    return plain if plain.is_terminal else Console(width=200)


def table_of(texts: Sequence[str], figures: Sequence[str] = ()) -> Table:
    """Return a table without lines whose columns of texts stand left, those of figures
    right.
    """
    table = Table(box=None, pad_edge=False)
    for heading in (*texts, *figures):
        side: Any = "right" if heading in figures else "left"
        table.add_column(heading, overflow="fold", justify=side)
    return table


def fitting(table: Table, width: int, least: int = NARROW) -> Table:
    """Return a table, or in fewer columns than the least a line for each cell that is
    not empty.
    """
    if width >= least:
        return table
    lines, names = table_of(("", "")), [column.header for column in table.columns]
    lines.show_header = False
    for row in zip(*(column.cells for column in table.columns), strict=True):
        found = [pair for pair in zip(names, row, strict=True) if pair[1] != ""]
        for name, cell in found:
            told = getattr(cell, "renderable", cell)  # without a padding
            lines.add_row(*(name, told)[len(found) == 1 :])  # one alone is a title
    return lines


@click.command()
@click.option(
    "--all", "each", is_flag=True, help="Each case of a family, one line each."
)
def list(each: bool) -> None:
    """List the families of cases, one line each: of a file that holds several, or of
    one case.
    """
    families = ((case_name(path), read_cases(path)) for path in case_files())
    if each:
        families = ((case.id, (case,)) for _, cases in families for case in cases)
    headings = (
        "case" if each else "family",
        "cases",
        "sizes",
        "methods",
        "requirement",
    )
    print_rows(
        open_console(), headings, (_row(*family) for family in families), named=False
    )


def print_rows(
    console: Console, headings: Sequence[str], rows: Any, named: bool = True
) -> None:
    """Print texts: a table, or on a narrow terminal a paragraph for each row, of
    `named` cells.
    """
    if console.width >= WIDE:
        table = table_of(headings)
        for row in rows:
            table.add_row(*map(Text, row))
        console.print(table)
        return
    for name, *others, last in rows:
        told = (
            f"{h * named} {x}".strip()
            for h, x in zip(headings[1:], others, strict=False)
            if x
        )
        console.print(Text(name, "bold"), Text("  ".join(told)))
        if last:
            console.print(Padding(Text(last), (0, 0, 0, 2)))


def _row(name: str, cases: Sequence[CaseText]) -> tuple[str, ...]:
    heads = [_head(case) for case in cases]
    sizes = [size for size in SIZES if any(size in case.sizes for case in cases)]
    methods = dict.fromkeys(method for head in heads for method in head["methods"])
    first, *others = dict.fromkeys(str(head["requirement"]) for head in heads)
    verified = sum(map(_verified, cases, heads))
    few = f"{verified} of {len(cases)}" if verified else "not"
    count = f"{len(cases)} cases" * (len(cases) > 1)
    told = ", ".join(
        filter(None, (count, f"{few} in a bare verify" * (verified < len(cases))))
    )
    said = f"{first} (the first of {len(others) + 1})" if others else first
    return name, told, " ".join(sizes), " ".join(methods), said


def _verified(case: CaseText, head: Mapping[str, Any]) -> bool:
    """Whether a bare `epcontact verify` runs the case, which is always at the size
    "fast".
    """
    return (
        "fast" in case.sizes
        and "sweep" not in case.tables
        and bool(head.get("verify", True))
    )


def _head(case: CaseText) -> Mapping[str, Any]:
    try:
        head: Mapping[str, Any] = at_size(case.tables, case.sizes[0])["case"]
        _ = (*head["methods"], head["requirement"])
    except (KeyError, TypeError):
        told = "needs a table [case] with a requirement and methods"
        raise InvalidCase(f"{case.where}: {told}") from None
    return head
