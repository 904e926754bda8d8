"""The commands that draw: chart, stability, report and view."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from epcontact.errors import InvalidCase
from epcontact.harness.answers.pictures import draw_answers
from epcontact.output import view as viewing
from epcontact.output.charts.maps import save_map
from epcontact.output.report import report_folder
from epcontact.studies import STUDIES, save_charts
from epcontact.studies.stability import MAPS, StabilityMap, stability_map, write

_folder = click.Path(path_type=Path, file_okay=True)
_file = click.Path(path_type=Path, dir_okay=False)


@click.command()
@click.argument("names", nargs=-1)
@click.option("--full", is_flag=True, help="Minutes instead of seconds, and finer.")
@click.option("--peers", is_flag=True, help="Add the comparison with other solvers (extra peers).")
@click.option("--output", type=_folder, default=Path("charts"), show_default=True)
def chart(names: tuple[str, ...], full: bool, peers: bool, output: Path) -> None:
    """Draw charts of accuracy against cost by NAME (none: the list), with data and captions."""
    wanted = (*names, "peers") if peers else names
    unknown = [name for name in wanted if name not in STUDIES]
    if unknown:
        raise InvalidCase(f"no chart is called {unknown[0]!r}; there are {', '.join(STUDIES)}")
    if not wanted:
        table = Table(box=None, pad_edge=False)
        table.add_column("chart")
        table.add_column("shows")
        for study in STUDIES.values():
            table.add_row(study.name, study.description)
        Console().print(table)
    for name in dict.fromkeys(wanted):
        charts = STUDIES[name].run("full" if full else "fast", _tell)
        for path in save_charts(name, charts, output):
            click.echo(path)
        for one in charts:
            click.echo(one.caption)


@click.command()
@click.argument("maps", nargs=-1)
@click.option("--full", is_flag=True, help="Minutes instead of seconds, and finer.")
@click.option("--output", type=_folder, default=Path("stability"), show_default=True)
def stability(maps: tuple[str, ...], full: bool, output: Path) -> None:
    """Sweep loads and hardnesses and map the convergence and speed of each method.

    MAPS are some of capped, elastic, theory and fem; all of them where none is named.
    """
    data = stability_map(maps or MAPS, "full" if full else "coarse", progress=_tell)
    for path in write(data, output):
        click.echo(path)
    Console().print(_stability_table(data))


def _stability_table(data: StabilityMap) -> Table:
    """Tabulate points, failures and the largest effort of each method."""
    table = Table(box=None, pad_edge=False)
    for heading in ("map", "method", "points", "failures", "largest effort"):
        table.add_column(heading, justify="left" if heading in ("map", "method") else "right")
    for key in dict.fromkeys((point.map, point.method) for point in data.points):
        mine = [point for point in data.points if (point.map, point.method) == key]
        failed = sum(not point.converged for point in mine)
        effort = max((point.effort for point in mine if point.converged), default=float("nan"))
        shown = f"[bold red]{failed}[/]" if failed else "0"
        table.add_row(*key, str(len(mine)), shown, f"{effort:g}")
    return table


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), default=Path("results"))
@click.option("--output", type=_file, help="Page to write; else report.html in the folder.")
def report(folder: Path, output: Path | None) -> None:
    """Make one self-contained page of a verification run, with pictures, from its output FOLDER."""
    click.echo(f"report in {report_folder(folder, output, draw=draw_answers)}")


@click.command()
@click.argument("result", type=click.Path(path_type=Path))
@click.option("--screenshot", type=_file, help="Draw to this PNG instead of a window.")
@click.option(
    "--map",
    "contact_map",
    type=_file,
    help="Draw contact state and pressure from above, as a .png; a name without an ending gives "
    "the picture, its data and a caption.",
)
@click.option(
    "--against",
    type=click.Path(path_type=Path),
    help="With --screenshot: draw the pressures of RESULT and of this one, and their difference.",
)
@click.option(
    "--film",
    type=_file,
    help="Draw the load steps of a .pvd as a film: .gif, or .mp4 with imageio-ffmpeg.",
)
@click.option("--factor", type=float, default=None, help="Stretch the deformation by this.")
def view(
    result: Path,
    screenshot: Path | None,
    contact_map: Path | None,
    against: Path | None,
    film: Path | None,
    factor: float | None,
) -> None:
    """Show the fields of a result in three dimensions: .vti, .vtu, .pvd, or a method's .json."""
    if contact_map is not None:
        save_map(viewing.find_result(result), contact_map)
    if film is not None:
        viewing.animate([result], film, factor=factor)
    if against is not None:
        if screenshot is None:
            raise click.UsageError("--against draws to a file; give --screenshot too")
        viewing.compare(result, against, screenshot)
    elif screenshot is not None:
        viewing.screenshot(result, screenshot, factor=factor)
    elif contact_map is None and film is None:
        viewing.show(result, factor=factor)
    for what, file in (("map", contact_map), ("film", film), ("picture", screenshot)):
        if file is not None:
            click.echo(f"{what} in {file}")


def _tell(sentence: str) -> None:
    click.echo(sentence, err=True)
