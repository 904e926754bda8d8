"""The commands on changes and accuracy: compare, accuracy and benchmark."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from epcontact.cli.main import print_text
from epcontact.cli.progress import show_progress
from epcontact.cli.terminal import (
    new_table,
    open_console,
    print_rows,
    print_sentence,
    text_of,
)
from epcontact.files import atomic_write, require_replaceable
from epcontact.harness.verdict import compare as comparing
from epcontact.harness.verdict.compare import (
    RELEASE_VALUES,
    Comparison,
    read_values,
    save_values,
)
from epcontact.studies import STUDIES, save_charts
from epcontact.studies import accuracy as ledgers
from epcontact.studies import benchmark as benchmarks

#: Rows of a table, and names of a list, that a terminal shows; the CSV file has all.
_ROWS = 20
_NAMES = 5


def compare(verdicts: tuple[Path, ...], table: Path | None, saved: Path | None) -> None:
    """Compare two verdicts and list the values that changed.

    The arguments are those of `commands.compare`.
    """
    if len(verdicts) > 2:
        raise click.UsageError(f"compares OLD and NEW, but {len(verdicts)} are given")
    new = read_values(verdicts[-1])
    if saved is not None:
        save_values(new, saved)
        print_text(f"figures in {saved}")
        if len(verdicts) == 1:
            return
    old_file = RELEASE_VALUES
    if len(verdicts) == 2:
        old_file = verdicts[0]
    old = read_values(old_file)
    comparison = comparing.compare(old, new)
    if table is not None:
        names = [*comparing.KEYS, "value_old", "value_new", "error", "moved"]
        require_replaceable(table, ",".join(names))
        with atomic_write(table) as file:
            comparison.moved[names].to_csv(file, index=False)
    _print_comparison(comparison)
    sys.exit(comparison.exit_code)


def _print_comparison(comparison: Comparison) -> None:
    """Print the comparison of two verdicts on standard output.

    First come the values that changed most, then the solves with more work, the notes
    on values that could not be compared, and the counts of all of these.
    """
    console = open_console()
    _print_moved(console, comparison)
    if len(comparison.slower):
        work = new_table(("more work",), ("old", "new", "ratio"))
        for row in comparison.slower.head(_ROWS).itertuples():
            name = f"{row.case} {row.size}: {row.name.removeprefix('cost.')}"
            values = (f"{row.value_old:.6g}", f"{row.value_new:.6g}")
            work.add_row(name, *values, f"{row.ratio:.2f}")
        console.print(work)
    for words, names in comparison.notes.items():
        if names:
            sentence = f"{words}: {', '.join(names[:_NAMES])}"
            if len(names) > _NAMES:
                sentence += f" and {len(names) - _NAMES} more"
            print_sentence(console, sentence)
    within = len(comparison.moved) - comparison.beyond
    summary = (
        f"{comparison.compared} values compared: {comparison.beyond} moved beyond "
        f"their claim, {within} within it; more work: {len(comparison.slower)}"
    )
    if comparison.time > 0:
        summary += f"; seconds: {comparison.time:.2f} times as many"
    print_sentence(console, summary)


def _print_moved(console: Console, comparison: Comparison) -> None:
    """Print a table of the `_ROWS` values that changed most, by case and size.

    The last column is the change over the error estimate of the value; a change of more
    than 1 is red.  Nothing is printed if no value changed.
    """
    if not len(comparison.moved):
        return
    table = new_table(("moved",), ("old", "new", "in claims"))
    table.columns[-1].no_wrap = True
    largest = comparison.moved.head(_ROWS)
    in_order = largest.sort_values(["case", "size"], kind="stable")
    for (case, size), group in in_order.groupby(["case", "size"], sort=False):
        table.add_row(text_of(f"{case} {size}", "bold"))
        for row in group.itertuples():
            values = (f"{row.value_old:.6g}", f"{row.value_new:.6g}")
            style = "bold red" if row.moved > 1 else ""
            change = text_of(f"{row.moved:.2g}", style)
            table.add_row(f"  {row.quantity}", *values, change)
    console.print(table)


#: The grids of the release that a terminal shows, in points per shortest wave; the file
#: has all.
_GRIDS = (4, 8)


def accuracy(
    folders: tuple[Path, ...],
    table: Path | None,
    saved: Path | None,
    charts: Path | None,
) -> None:
    """Print bias, scatter and cost of each quantity between methods and references.

    The arguments are those of `commands.accuracy`.
    """
    with show_progress("accuracy"):
        rows = ledgers.read_rows(folders)
        ledger = ledgers.ledger(rows)
    if table is not None:
        ledgers.write_table(ledger, table)
    if saved is not None:
        ledgers.write_table(rows, saved)
    shown = ledger
    if not folders:
        shown = ledger[ledger["points"].isna() | ledger["points"].isin(_GRIDS)]
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
    cells = [_ledger_row(row) for row in shown.to_dict("records")]
    print_rows(open_console(), headings, cells)
    if charts is not None:
        names = tuple(map(str, folders))
        with show_progress("accuracy"):
            drawn = STUDIES["accuracy"].run(folders=names, known=rows)
        for path in save_charts("accuracy", drawn, charts):
            print_text(path)


def _ledger_row(row: dict[str, Any]) -> tuple[str, ...]:
    """Return the texts of a row of the ledger of accuracy, for a terminal.

    Args:
        row: A row of `studies.accuracy.ledger`: its columns by name.

    Returns:
        Quantity, pair of methods with points per shortest wave, bias in %, scatter in %
        ("–" for one scene), number of scenes, relative time, FFT pairs (empty where
        they were not measured), and the ranges of the dimensionless groups.
    """
    pair = row["pair"]
    if np.isfinite(row["points"]):
        pair = pair.replace(" – ", f", {row['points']:g} points a wave – ")
    ranges = []
    for name, words in ledgers.PLACE.items():
        low = row[f"{name}_min"]
        high = row[f"{name}_max"]
        if not np.isnan(low):
            ranges.append(f"{words} {_range_text(low, high)}")
    scatter = "–"
    if row["scenes"] > 1:
        scatter = f"{100 * row['scatter']:.2g} %"
    costs = []
    for name in ("time", "fft_pairs"):
        cell = ""
        if row[name] > 0:
            cell = f"{row[name]:.3g}"
        costs.append(cell)
    bias = f"{100 * row['bias']:+.2g} %"
    scenes = str(row["scenes"])
    return (row["quantity"], pair, bias, scatter, scenes, *costs, ", ".join(ranges))


def _range_text(low: float, high: float) -> str:
    """Return "low to high", or one number if both are the same in three digits."""
    ends = (f"{low:.3g}", f"{high:.3g}")
    return " to ".join(dict.fromkeys(ends))


def benchmark(files: tuple[Path, ...], table: Path | None, copy: Path | None) -> None:
    """Print how far codes are from plain finite elements on the benchmark.

    The arguments are those of `commands.benchmark`.
    """
    if copy is not None:
        benchmarks.copy_files(copy)
    results = benchmarks.compare_codes(files)
    if table is not None:
        ledgers.write_table(results, table)
    headings = ("code", "loads", *benchmarks.COLUMNS)
    cells = []
    for code, row in benchmarks.summarise(results).iterrows():
        texts = [str(code), f"{row['loads']:.0f}"]
        for name, form in benchmarks.COLUMNS.values():
            text = form.format(row[name], row[f"{name}_largest"])
            texts.append(re.sub(r"[+]?nan%?", "–", text))
        cells.append(tuple(texts))
    console = open_console()
    print_rows(console, headings, cells)
    console.print(
        "median (largest) difference from plain finite elements over the loads of a "
        "code; the results of all codes but FILES are stored, nothing was solved"
    )
