"""The command `sweep`: a case at every point of its table [sweep]."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pandas as pd

from epcontact.cli.main import print_text
from epcontact.cli.progress import show_progress
from epcontact.cli.tables import MEANING_OF_ERRORS, loads_table
from epcontact.cli.terminal import open_console, print_sentence
from epcontact.errors import EpcontactError
from epcontact.harness.quantities.registry import QUANTITIES
from epcontact.harness.solving.tasks import Run
from epcontact.harness.sweep import Swept, digest, run_sweep

#: Points that a terminal shows; the CSV file has all.
_ROWS = 40
#: Reasons of failed tasks that are listed.
_REASONS = 5


def sweep(
    case: str, size: str, settings: Run, fields: str, among: str, charts: bool
) -> None:
    """Solve CASE at every point of its table [sweep], here or on a cluster.

    The arguments are those of `commands.sweep`.
    """
    with show_progress("sweep") as progress:
        run = replace(settings, fields=fields, progress=progress)
        swept = run_sweep(case, run, size=size, among=among)
    _print_points(swept)
    if charts:
        # Charts take long to load.
        from epcontact.pictures.folder import draw_sweep

        rows_by_point = {point: rows for point, (rows, _) in swept.loads.items()}
        with show_progress("sweep"):
            draw_sweep(swept.folder, rows_by_point, swept.fields)
    for path, words in swept.fields.items():
        print_text(f"fields of {words} in {path}")
    solved = swept.table.loc[swept.table["load"] == 0, "solved"]  # a row for each task
    print_text(
        f"{solved.sum()} of {len(solved)} tasks are solved, {swept.reused} of them "
        f"earlier; table in {swept.folder / 'sweep.csv'}, digest "
        f"{digest(swept.table)[:12]}"
    )
    if swept.failures:
        counts = pd.Series(swept.failures).value_counts().head(_REASONS)
        reasons = "; ".join(f"{count} with: {why}" for why, count in counts.items())
        raise EpcontactError(
            f"{len(swept.failures)} tasks failed, which the next run tries again: "
            f"{reasons}"
        )


def _print_points(swept: Swept) -> None:
    """Print a table of the loads of the first `_ROWS` points of a sweep.

    Below the table is each note of the results, with the number of tasks that have it.
    """
    console = open_console()
    shown = dict(itertools.islice(swept.loads.items(), _ROWS))
    units = {}
    for name in swept.quantities:
        units[name.removeprefix("quantity.")] = QUANTITIES[name].unit.strip("–")
    console.print(loads_table(shown, "point", console.width, **units))
    print_sentence(console, MEANING_OF_ERRORS)
    hidden = len(swept.loads) - len(shown)
    if hidden > 0:
        print_text(f"and {hidden} more")
    for note, count in swept.notes.items():
        tasks = "1 task" if count == 1 else f"{count} tasks"
        print_text(f"note of {tasks}: {note}")
