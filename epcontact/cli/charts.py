"""The commands of studies: chart and stability."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from rich.table import Table

from epcontact.cli.main import print_text
from epcontact.cli.progress import show_sentences
from epcontact.cli.terminal import new_table, open_console, text_of
from epcontact.errors import InvalidCase
from epcontact.studies import STUDIES, save_charts
from epcontact.studies import stability as stability_maps


def chart(names: tuple[str, ...], full: bool, peers: bool, output: Path) -> None:
    """Draw the charts of the studies NAMES with data and captions; none: list them.

    The arguments are those of `commands.chart`.
    """
    wanted = list(names)
    if peers:
        wanted.append("peers")
    for name in wanted:
        if name not in STUDIES:
            raise InvalidCase(
                f"no chart is called {name!r}; there are {', '.join(STUDIES)}"
            )
    if not wanted:
        table = new_table(("chart", "shows"))
        for study in STUDIES.values():
            table.add_row(study.name, study.description)
        open_console().print(table)
    for name in dict.fromkeys(wanted):
        with show_sentences("chart") as say:
            charts = STUDIES[name].run(say, full=full)
        for path in save_charts(name, charts, output):
            print_text(path)
        for drawn in charts:
            print_text(drawn.caption)


def stability(maps: tuple[str, ...], full: bool, output: Path) -> None:
    """Sweep loads and hardnesses; map where each method converges and how fast.

    The arguments are those of `commands.stability`.
    """
    size = "coarse"
    if full:
        size = "full"
    with show_sentences("stability") as say:
        points = stability_maps.stability(maps, size, say=say)
        paths = stability_maps.write(points, size, output)
    for path in paths:
        print_text(path)
    open_console().print(_summary(points))


def _summary(points: pd.DataFrame) -> Table:
    """Return a table for a terminal, with a row for each map and method.

    `points` has a row for each solve, from `studies.stability.stability`.  The table
    has the number of points, the number of failures, and the largest effort of a solve
    in the unit of the map (transform pairs, terms or Newton steps).
    """
    table = new_table(("map", "method"), ("points", "failures", "largest effort"))
    for (name, method), group in points.groupby(["map", "method"], sort=False):
        failures = int((~group["converged"]).sum())
        style = "bold red" if failures else ""
        effort = f"{group['effort'].max():g}"
        table.add_row(name, method, str(len(group)), text_of(failures, style), effort)
    return table
