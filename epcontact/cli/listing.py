"""The list of cases.  It reads their text only, so it waits for no schema and no solver to load."""

from __future__ import annotations

import click
from rich.console import Console
from rich.table import Table

from epcontact.errors import InvalidCase
from epcontact.harness.case_text import CaseText, at_size, case_files, read_cases


def open_console() -> Console:
    """Open standard output; in a pipe it is as wide as a table needs, not 80 columns."""
    plain = Console()
    return plain if plain.is_terminal else Console(width=200)


@click.command("list")
def list_cases() -> None:
    """List the cases, one line each."""
    table = Table(box=None, pad_edge=False)
    for heading in ("case", "sizes", "methods", "requirement"):
        table.add_column(heading, overflow="fold")
    for path in case_files():
        for case in read_cases(path):
            table.add_row(*_row(case))
    open_console().print(table)


def _row(case: CaseText) -> tuple[str, str, str, str]:
    sizes = case.sizes
    head = at_size(case.tables.get("case"), sizes[0])
    methods = head.get("methods") if isinstance(head, dict) else None
    requirement = head.get("requirement") if isinstance(head, dict) else None
    if not (isinstance(methods, list) and isinstance(requirement, str)):
        raise InvalidCase(f"{case.where}: needs a table [case] with a requirement and methods")
    return case.id, " ".join(sizes), " ".join(map(str, methods)), requirement
