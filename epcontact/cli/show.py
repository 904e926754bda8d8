"""The commands that show what there is: keys, schema, gates and cite."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click
from rich.console import Console

from epcontact.cli.listing import open_console, print_rows
from epcontact.cli.options import folder, own_size
from epcontact.harness.case_files.case import (
    find_case,
    find_cases,
    find_named,
    load_case,
)
from epcontact.harness.case_files.citations import citation
from epcontact.harness.case_files.mistakes import case_schema, key_table
from epcontact.harness.quantities.registry import QUANTITIES
from epcontact.harness.verdict.judgement import Verdict
from epcontact.harness.verdict.overview import margin_text
from epcontact.results import plain


@click.command()
def keys() -> None:
    """Print every key of a case file, and every quantity of a gate, with unit and
    meaning.
    """
    quantities = [(one.name, one.unit, one.meaning) for one in QUANTITIES.values()]
    console = open_console()
    print_rows(console, ("table", "key", "default", "meaning"), key_table())
    console.print()
    print_rows(console, ("quantity of a gate", "unit", "meaning"), quantities)


@click.command()
@click.argument("kind", type=click.Choice(["case", "verdict"]))
def schema(kind: str) -> None:
    """Print the JSON Schema of a case file, or of verdict.json."""
    found = case_schema() if kind == "case" else Verdict.model_json_schema()
    click.echo(json.dumps(plain(found), indent=2, allow_nan=False))


@click.command()
@click.argument("case")
@own_size
def cite(case: str, size: str) -> None:
    """Print what a case's results rest on: sources, papers by DOI, versions of the
    software.
    """
    for line in citation(load_case(find_case(case), size)):
        click.echo(line)


@click.command()
@click.argument("cases", nargs=-1)
@folder(
    default=Path("results"), help="Folder of the verification whose margins are shown."
)
def gates(cases: tuple[str, ...], output: Path) -> None:
    """List every gate's band, margin and reason.

    The margin is that of the verdict in the output folder: the band over the difference
    and its interval.
    """
    margins = _margins(output / "verdict.json")
    named = [text for name in cases for text in find_named(name)]
    rows = [
        (
            text.id,
            size,
            gate.name,
            f"{gate.low:g} … {gate.high:g}",
            margin,
            gate.because,
        )
        for text in named or find_cases()
        for size in text.sizes
        for gate in load_case(text, size).gates
        for margin in [margins.get((text.id, size, gate.name), "–")]
    ]
    console = Console(width=None if sys.stdout.isatty() else 300)
    print_rows(console, ("case", "size", "gate", "band", "margin", "because"), rows)


def _margins(file: Path) -> dict[tuple[str, str, str], str]:
    return {
        (case.id, case.size, gate.name): margin_text(gate)
        for case in (Verdict.read(file).cases if file.exists() else ())
        for gate in case.gates
        if gate.difference is not None
    }
