"""The command on sweeps."""

from __future__ import annotations

import click
import pandas as pd
from rich.table import Table

from epcontact.cli.listing import open_console, table_of
from epcontact.cli.options import of_run, own_size, shown_progress
from epcontact.cli.tables import shown_estimate
from epcontact.errors import EpcontactError
from epcontact.harness.answers.run import Run
from epcontact.harness.gates.statistics import estimate
from epcontact.harness.sweep import Swept, digest, in_words, run_sweep

#: Rows that a terminal shows; the CSV file has all.
_ROWS = 40


@click.command()
@click.argument("case")
@own_size
@of_run("jobs", "output", "fresh", "executor")
def sweep(case: str, size: str, run: Run) -> None:
    """Solve CASE at every point of its table [sweep], on one machine or on a cluster.

    The results are kept in a folder as soon as they are solved: stop the command at any moment, and
    start it again to go on. `epcontact.harness.sweep.table(FOLDER)` reads them as a pandas table.
    """
    with shown_progress(run) as shown:
        swept = run_sweep(case, shown, size=size)
    open_console().print(_points_table(swept))
    solved = int(swept.table["solved"].sum())
    click.echo(
        f"{solved} of {len(swept.table)} tasks are solved, {swept.reused} of them earlier; "
        f"table in {swept.folder / 'sweep.csv'}, digest {digest(swept.table)[:12]}"
    )
    if swept.failures:
        reasons = pd.Series(swept.failures).value_counts()  # each once, with its number of tasks
        told = "; ".join(f"{count} with: {reason}" for reason, count in reasons.head(5).items())
        raise EpcontactError(
            f"{len(swept.failures)} tasks failed, which the next run tries again: {told}"
        )


def _points_table(swept: Swept) -> Table:
    """Tabulate the mean total area at each point with its interval, and what the sweep measures."""
    found, quantities = swept.table, ("area.total.corrected", *swept.quantities)
    keys = [*found.columns[: found.columns.get_loc("solved")].difference(["seed"], sort=False)]
    names = [name.removeprefix("quantity.") for name in swept.quantities]
    shown = table_of([*(key.rpartition(".")[2] for key in keys), "surfaces", "total area", *names])
    groups = found.reindex(columns=[*keys, *quantities]).groupby(keys, sort=False)
    for values, rows in list(groups)[:_ROWS]:
        columns = [rows[name].dropna().to_numpy() for name in quantities]
        figures = [shown_estimate(estimate(c)) if len(c) else "" for c in columns]
        shown.add_row(*map(in_words, values), str(len(columns[0])), *figures)
    if len(groups) > _ROWS:
        shown.add_row(f"and {len(groups) - _ROWS} more")
    return shown
