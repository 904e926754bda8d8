"""The commands that tell what moved, and how accurate answers are: compare and
accuracy.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.text import Text

from epcontact.cli.listing import open_console, print_rows, table_of
from epcontact.files import atomic_write
from epcontact.harness.verdict import compare as comparing
from epcontact.harness.verdict.compare import KEPT, Comparison, keep, read_figures
from epcontact.studies import STUDIES, save_charts
from epcontact.studies import accuracy as ledgers

_path = click.Path(path_type=Path)
#: Rows of a table, and names of a list, that a terminal shows; the CSV file has all.
_ROWS, _NAMES = 20, 5


@click.command()
@click.argument("verdicts", type=_path, nargs=-1, required=True, metavar="[OLD] NEW")
@click.option(
    "--csv", "table", type=_path, help="Write every value that moved to this file."
)
@click.option(
    "--keep",
    "kept",
    type=_path,
    help="Keep the figures of NEW in this small .csv, a later OLD.",
)
def compare(verdicts: tuple[Path, ...], table: Path | None, kept: Path | None) -> None:
    """Tell what moved from one verdict to another, in units of what the values claim.

    OLD and NEW are verdict.json, a folder that holds it, or a table that --keep wrote;
    without OLD it is the table of this release.  The exit code is 1 if a value moved by
    more than the error that it claims, though its band may hold, or if a gate that held
    does not.  A value that claims no error claims a ten-thousandth; one that must be 0
    claims its band.  More work is told in counts; seconds depend on the machine, and
    their ratio judges nothing.
    """
    if len(verdicts) > 2:
        raise click.UsageError(f"compares OLD and NEW, but {len(verdicts)} are given")
    figures = read_figures(verdicts[-1])
    if kept is not None:
        keep(figures, kept)
        click.echo(f"figures in {kept}")
        if len(verdicts) == 1:
            return
    found = comparing.compare(read_figures((KEPT, *verdicts)[-2]), figures)
    if table is not None:
        names = [*comparing.ROW, "value_old", "value_new", "error", "moved"]
        with atomic_write(table) as file:
            found.moved[names].to_csv(file, index=False)
    _show(found)
    sys.exit(found.exit_code)


def _show(found: Comparison) -> None:
    console = Console()
    rows = table_of(("moved",), ("old", "new", "in claims"))
    rows.columns[-1].no_wrap = True
    place = ""
    for row in (
        found.moved.head(_ROWS)
        .sort_values(["case", "size"], kind="stable")
        .itertuples()
    ):
        if place != (place := f"{row.case} {row.size}"):
            rows.add_row(f"[bold]{place}[/]")
        style = "bold red" if row.moved > 1 else ""
        rows.add_row(
            Text(f"  {row.figure}"),
            f"{row.value_old:.6g}",
            f"{row.value_new:.6g}",
            Text(f"{row.moved:.2g}", style),
        )
    if len(found.moved):
        console.print(rows)
    work = table_of(("more work",), ("old", "new", "ratio"))
    for row in found.slower.head(_ROWS).itertuples():
        name = row.name.removeprefix("cost.")
        figures = (f"{row.value_old:.6g}", f"{row.value_new:.6g}", f"{row.ratio:.2f}")
        work.add_row(Text(f"{row.case} {row.size}: {name}"), *figures)
    if len(found.slower):
        console.print(work)
    for words, names in found.told.items():
        left = f" and {len(names) - _NAMES} more" if len(names) > _NAMES else ""
        if names:
            said = f"{words}: {', '.join(names[:_NAMES])}{left}"
            console.print(said, markup=False, highlight=False)
    timed = f"; seconds: {found.time:.2f} times as many" if found.time > 0 else ""
    said = (
        f"{found.compared} values compared: {found.beyond} moved beyond their claim, "
    )
    said += (
        f"{len(found.moved) - found.beyond} within it; more work: {len(found.slower)}"
    )
    console.print(said + timed, highlight=False)


#: The grids of the release that a terminal shows, in points per shortest wave; the file
#: has all.
_GRIDS = (4, 8)


@click.command()
@click.argument("folders", nargs=-1, type=_path)
@click.option(
    "--csv",
    "table",
    type=_path,
    help="Write the ledger, with every grid, to this file.",
)
@click.option(
    "--keep",
    "kept",
    type=_path,
    help="Write what it rests on, a row for each scene and pair.",
)
@click.option("--charts", type=_path, help="Draw the charts into this folder.")
def accuracy(
    folders: tuple[Path, ...],
    table: Path | None,
    kept: Path | None,
    charts: Path | None,
) -> None:
    """Tell bias and scatter of each quantity between methods, grids and references, and
    the cost.

    FOLDERS are those of `epcontact sweep` (CASE/SIZE in its output) and of `epcontact
    verify`; with none it is the ledger of this release.  The bias is the median of the
    relative differences over scenes, the scatter half the width of their central 68 %.
    Differences of areas are over the reference, or over a thousandth of the nominal
    area where that is more.  Times are over those of boundary elements on 4 points per
    shortest wave.
    """
    rows = ledgers.read_rows(folders)
    found = ledgers.ledger(rows)
    if table is not None:
        ledgers.write_table(found, table)
    if kept is not None:
        ledgers.write_table(rows, kept)
    shown = found[found["points"].isna() | found["points"].isin(_GRIDS) | bool(folders)]
    headings = (
        "quantity",
        "of – against",
        "bias",
        "scatter",
        "scenes",
        "time",
        "FFT pairs",
        "of",
    )
    print_rows(
        open_console(), headings, [_row(row) for row in shown.to_dict("records")]
    )
    if charts is not None:
        drawn = STUDIES["accuracy"].run(folders=tuple(map(str, folders)), known=rows)
        for path in save_charts("accuracy", drawn, charts):
            click.echo(path)


def _row(row: dict[str, Any]) -> tuple[str, ...]:
    pair = row["pair"]
    if np.isfinite(row["points"]):
        pair = pair.replace(" – ", f", {row['points']:g} points a wave – ")
    spans = {
        words: (row[f"{name}_min"], row[f"{name}_max"])
        for name, words in ledgers.PLACE.items()
    }
    known = {words: ends for words, ends in spans.items() if not np.isnan(ends[0])}
    reach = (f"{words} {_span(*ends)}" for words, ends in known.items())
    counts = (
        f"{row[name]:.3g}" if row[name] > 0 else "" for name in ("time", "fft_pairs")
    )
    scatter = f"{100 * row['scatter']:.2g} %" if row["scenes"] > 1 else "–"
    words = (f"{100 * row['bias']:+.2g} %", scatter, f"{row['scenes']}", *counts)
    return row["quantity"], pair, *words, ", ".join(reach)


def _span(low: float, high: float) -> str:
    return " to ".join(dict.fromkeys(f"{end:.3g}" for end in (low, high)))
