"""The list of cases.  It reads their text only, so it waits for no schema and no solver to load."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import click
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from epcontact.errors import InvalidCase
from epcontact.harness.case_text import CaseText, at_size, case_files, read_cases


def open_console() -> Console:
    """Open standard output; in a pipe it is as wide as a table needs, not 80 columns."""
    plain = Console()
    return plain if plain.is_terminal else Console(width=200)


@click.command("list")
def list_cases() -> None:
    """List the cases, one line each."""
    rows = [_row(case) for path in case_files() for case in read_cases(path)]
    console = open_console()
    if console.width >= 150:
        console.print(plain_table(("case", "sizes", "methods", "requirement"), rows))
        return
    for name, sizes, methods, requirement in rows:
        console.print(Text(name, "bold"), Text(f" {sizes}; {methods}"))
        console.print(Padding(Text(requirement), (0, 0, 0, 2)))


def plain_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """Tabulate texts as they are: brackets in them are no markup."""
    table = Table(*headings, box=None, pad_edge=False)
    for row in rows:
        table.add_row(*map(Text, row))
    return table


def _row(case: CaseText) -> tuple[str, str, str, str]:
    sizes = case.sizes
    head = at_size(case.tables.get("case"), sizes[0])
    methods = head.get("methods") if isinstance(head, dict) else None
    requirement = head.get("requirement") if isinstance(head, dict) else None
    if not (isinstance(methods, list) and isinstance(requirement, str)):
        raise InvalidCase(f"{case.where}: needs a table [case] with a requirement and methods")
    return case.id, " ".join(sizes), " ".join(map(str, methods)), requirement
