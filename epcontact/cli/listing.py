"""The list of cases.  It reads their text only, so it waits for no schema and no solver to load."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import click
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from epcontact.errors import InvalidCase
from epcontact.harness.case_files.text import CaseText, at_size, case_files, read_cases

#: Smallest terminal width, in columns, at which rows of long texts are a table.
WIDE = 150


def open_console() -> Console:
    """Open standard output; in a pipe it is as wide as a table needs, not 80 columns."""
    plain = Console()
    return plain if plain.is_terminal else Console(width=200)


def table_of(texts: Sequence[str], figures: Sequence[str] = ()) -> Table:
    """Return a table without lines whose columns of texts stand left, those of figures right."""
    table = Table(box=None, pad_edge=False)
    for heading in (*texts, *figures):
        table.add_column(
            heading, overflow="fold", justify="right" if heading in figures else "left"
        )
    return table


@click.command()
def list() -> None:
    """List the cases, one line each."""
    rows = (_row(case) for path in case_files() for case in read_cases(path))
    print_rows(open_console(), ("case", "sizes", "methods", "requirement"), rows)


def print_rows(console: Console, headings: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print texts, no markup: a table, or on a narrow terminal a paragraph for each row."""
    if console.width >= WIDE:
        table = table_of(headings)
        for row in rows:
            table.add_row(*map(Text, row))
        console.print(table)
        return
    for name, *others, last in rows:
        console.print(Text(name, "bold"), Text("  ".join(others)))
        console.print(Padding(Text(last), (0, 0, 0, 2)))


def _row(case: CaseText) -> tuple[str, str, str, str]:
    try:
        head = at_size(case.tables, case.sizes[0])["case"]
        methods = " ".join(head["methods"])
        return case.id, " ".join(case.sizes), methods, str(head["requirement"])
    except (KeyError, TypeError):
        raise InvalidCase(
            f"{case.where}: needs a table [case] with a requirement and methods"
        ) from None
