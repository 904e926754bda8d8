"""The command gates: every band with its margin and reason."""

from __future__ import annotations

import sys
from pathlib import Path

import click
from pydantic import ValidationError
from rich.console import Console

from epcontact.cli.listing import print_rows
from epcontact.errors import InvalidCase
from epcontact.harness.case_files.case import find_cases, find_named, load_case
from epcontact.harness.verdict.record import Verdict

#: A larger margin is one of rounding.
_EXACT = 1e3


@click.command()
@click.argument("cases", nargs=-1)
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    default=Path("results"),
    show_default=True,
    help="Folder of the verification whose margins are shown.",
)
def gates(cases: tuple[str, ...], output: Path) -> None:
    """List every gate's band, margin and reason.

    The margin is that of the verdict in the output folder: the band over the difference and its
    interval.
    """
    margins = _margins(output)
    named = [text for name in cases for text in find_named(name)]
    rows = [
        (text.id, size, gate.name, f"{gate.low:g} … {gate.high:g}", margin, gate.because)
        for text in named or find_cases()
        for size in text.sizes
        for gate in load_case(text, size).gates
        for margin in [margins.get((text.id, size, gate.name), "–")]
    ]
    console = Console(width=None if sys.stdout.isatty() else 300)
    print_rows(console, ("case", "size", "gate", "band", "margin", "because"), rows)


def _margins(output: Path) -> dict[tuple[str, str, str], str]:
    file = output / "verdict.json"
    if not file.exists():
        return {}
    try:
        verdict = Verdict.model_validate_json(file.read_text("utf-8"))
    except (ValidationError, UnicodeDecodeError):
        raise InvalidCase(f"{file}: is no verdict; run `epcontact verify` again") from None
    return {
        (case.id, case.size, gate.name): "exact" if gate.margin > _EXACT else f"{gate.margin:.2g}"
        for case in verdict.cases
        for gate in case.gates
        if gate.difference is not None
    }
