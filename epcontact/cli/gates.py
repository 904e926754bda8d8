"""The command gates: every band with its margin and reason, and the ratchet on them."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from pathlib import Path

import click
from pydantic import ValidationError
from rich.console import Console

from epcontact.cli.listing import print_rows
from epcontact.errors import InvalidCase
from epcontact.harness.case_files import case as casefile
from epcontact.harness.verdict import ratchet
from epcontact.harness.verdict.ratchet import Banded, Kept
from epcontact.harness.verdict.record import Verdict


@click.command()
@click.argument("cases", nargs=-1)
@click.option("--check", is_flag=True, help="Exit with 1 if a band grew, or a gate is gone.")
@click.option("--keep", is_flag=True, help="Keep the bands of all cases as they are now.")
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    default=Path("results"),
    show_default=True,
    help="Folder of the verification whose margins are shown and kept.",
)
def gates(cases: tuple[str, ...], check: bool, keep: bool, output: Path) -> None:
    """List every gate's band, margin and reason; --check or --keep the bands of all cases.

    The margin is that of the verdict in the output folder or else the kept one: the band over the
    difference and its interval.
    """
    if (check or keep) and cases:
        raise click.UsageError("--check and --keep take no CASE: they are about all of them")
    named = [text for name in cases for text in casefile.find_named(name)] if cases else None
    found = ratchet.banded_gates(named)
    path = ratchet.kept_file()
    kept, known = ratchet.read_kept(path), _margins(output)
    if check:
        wrong = ratchet.problems(kept, found)
        for sentence in wrong:
            click.echo(sentence)
        click.echo(f"{len(found)} gates checked against {path}")
        sys.exit(1 if wrong else 0)
    if keep:
        ratchet.write_kept(path, ratchet.updated(kept, found, known))
        click.echo(f"{len(found)} gates kept in {path}")
        return
    console = Console(width=None if sys.stdout.isatty() else 300)
    headings = ("case", "size", "gate", "band", "margin", "because")
    print_rows(console, headings, _rows(found, kept, known))


def _margins(output: Path) -> dict[tuple[str, str, str], float]:
    file = output / "verdict.json"
    if not file.exists():
        return {}
    try:
        return ratchet.margins(Verdict.model_validate_json(file.read_text("utf-8")))
    except (ValidationError, UnicodeDecodeError):
        raise InvalidCase(f"{file}: is no verdict; run `epcontact verify` again") from None


def _rows(
    found: list[Banded], kept: Kept, known: dict[tuple[str, str, str], float]
) -> Iterator[tuple[str, ...]]:
    for gate in found:
        old = kept.band(gate.key)
        value = known.get(gate.key, old.margin if old is not None else None)
        shown = "–" if value is None else "exact" if math.isinf(value) else f"{value:.2g}"
        band = f"{gate.low:g} … {gate.high:g}"
        yield gate.case, gate.size, gate.gate, band, shown, gate.because
