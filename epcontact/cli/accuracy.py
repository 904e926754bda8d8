"""The command that tells how far apart answers are, and what they cost: accuracy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np

from epcontact.cli.listing import open_console, print_rows
from epcontact.studies import STUDIES, save_charts
from epcontact.studies import accuracy as ledgers

_path = click.Path(path_type=Path)
#: The grids of a terminal, in points or nodes per shortest wave; the file has all.
_GRIDS = (4, 8)


@click.command()
@click.argument("folders", nargs=-1, type=_path)
@click.option("--csv", "table", type=_path, help="Write the ledger, with every grid, to this file.")
@click.option("--keep", type=_path, help="Write what it rests on, a row for each scene and pair.")
@click.option("--charts", type=_path, help="Draw the charts into this folder.")
def accuracy(
    folders: tuple[Path, ...], table: Path | None, keep: Path | None, charts: Path | None
) -> None:
    """Tell bias and scatter of each quantity between methods, grids and references, and the cost.

    FOLDERS are those of `epcontact sweep` (CASE/SIZE in its output) and of `epcontact verify`; with
    none it is the ledger of this release.  The bias is the median of the relative differences over
    scenes, the scatter half the width of their central 68 %.  Differences of areas are over the
    reference, or over a thousandth of the nominal area where that is more.  Times are over those of
    boundary elements on 4 points per shortest wave.
    """
    rows = ledgers.read_rows(folders)
    found = ledgers.ledger(rows)
    if table is not None:
        ledgers.keep(found, table)
    if keep is not None:
        ledgers.keep(rows, keep)
    shown = found[found["points"].isna() | found["points"].isin(_GRIDS)]
    headings = ("quantity", "of – against", "bias", "scatter", "scenes", "time", "FFT pairs", "of")
    print_rows(open_console(), headings, [_row(row) for row in shown.to_dict("records")])
    if charts is not None:
        drawn = STUDIES["accuracy"].run(folders=tuple(map(str, folders)))
        for path in save_charts("accuracy", drawn, charts):
            click.echo(path)


def _row(row: dict[str, Any]) -> tuple[str, ...]:
    pair = row["pair"]
    if np.isfinite(row["points"]):
        pair = pair.replace(" – ", f", {row['points']:g} points a wave – ")
    spans = {
        words: (row[f"{name}_min"], row[f"{name}_max"]) for name, words in ledgers.PLACE.items()
    }
    known = {words: ends for words, ends in spans.items() if not np.isnan(ends[0])}
    reach = (f"{words} {_span(*ends)}" for words, ends in known.items())
    counts = (f"{row[name]:.3g}" if row[name] > 0 else "" for name in ("time", "fft_pairs"))
    scatter = f"{100 * row['scatter']:.2g} %" if row["scenes"] > 1 else "–"
    words = (f"{100 * row['bias']:+.2g} %", scatter, f"{row['scenes']}", *counts)
    return row["quantity"], pair, *words, ", ".join(reach)


def _span(low: float, high: float) -> str:
    low_high = [f"{end:.3g}" for end in (low, high)]
    return low_high[0] if low_high[0] == low_high[1] else " to ".join(low_high)
