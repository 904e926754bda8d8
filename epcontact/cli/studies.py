"""The commands of studies: chart and stability."""

from __future__ import annotations

from pathlib import Path

import click
import pandas as pd
from rich.console import Console
from rich.table import Table

from epcontact.cli.listing import table_of
from epcontact.cli.main import tell
from epcontact.cli.options import folder
from epcontact.errors import InvalidCase
from epcontact.studies import STUDIES, save_charts
from epcontact.studies import stability as maps_of_methods

_full = click.option(
    "--full", is_flag=True, help="Minutes instead of seconds, and finer."
)


@click.command()
@click.argument("names", nargs=-1)
@_full
@click.option(
    "--peers", is_flag=True, help="Add the comparison with other solvers (extra peers)."
)
@folder(default=Path("charts"))
def chart(names: tuple[str, ...], full: bool, peers: bool, output: Path) -> None:
    """Draw charts of accuracy against cost by NAME (none: the list), with data and
    captions.
    """
    wanted = (*names, "peers") if peers else names
    unknown = [name for name in wanted if name not in STUDIES]
    if unknown:
        raise InvalidCase(
            f"no chart is called {unknown[0]!r}; there are {', '.join(STUDIES)}"
        )
    if not wanted:
        table = table_of(("chart", "shows"))
        for study in STUDIES.values():
            table.add_row(study.name, study.description)
        Console().print(table)
    for name in dict.fromkeys(wanted):
        charts = STUDIES[name].run(tell, full=full)
        for path in save_charts(name, charts, output):
            click.echo(path)
        for one in charts:
            click.echo(one.caption)


@click.command()
@click.argument("maps", nargs=-1)
@_full
@folder(default=Path("stability"))
def stability(maps: tuple[str, ...], full: bool, output: Path) -> None:
    """Sweep loads and hardnesses and map the convergence and speed of each method.

    MAPS are some of capped, elastic, theory and fem; all of them where none is named.
    """
    size = "full" if full else "coarse"
    found = maps_of_methods.stability(maps, size, say=tell)
    for path in maps_of_methods.write(found, size, output):
        click.echo(path)
    Console().print(_summary(found))


def _summary(found: pd.DataFrame) -> Table:
    """Tabulate points, failures and the largest effort of each method."""
    table = table_of(("map", "method"), ("points", "failures", "largest effort"))
    for key, mine in found.groupby(["map", "method"], sort=False):
        failed = int((~mine["converged"]).sum())
        shown = f"[bold red]{failed}[/]" if failed else "0"
        table.add_row(*key, str(len(mine)), shown, f"{mine['effort'].max():g}")
    return table
