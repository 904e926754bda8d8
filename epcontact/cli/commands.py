"""Commands around the main job: charts, cross-checks, plans, maps, reports, views, schemas.

Imports inside functions load what takes long and few commands need: the solvers and the charts.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.table import Table

from epcontact.errors import EpcontactError, InvalidCase
from epcontact.harness import case as casefile
from epcontact.harness.schema import Family
from epcontact.harness.verdict import Verdict, verify
from epcontact.output import view as viewing
from epcontact.output.charts.maps import save_map
from epcontact.results import plain
from epcontact.studies import STUDIES, save_charts

if TYPE_CHECKING:
    from epcontact.studies.stability import StabilityMap

_folder = click.Path(path_type=Path, file_okay=True)
_file = click.Path(path_type=Path, dir_okay=False)


def _tell(sentence: str) -> None:
    click.echo(sentence, err=True)


@click.command()
@click.argument("names", nargs=-1)
@click.option("--full", is_flag=True, help="Minutes instead of seconds, and finer.")
@click.option("--peers", is_flag=True, help="Add the comparison with other solvers (extra peers).")
@click.option("--output", type=_folder, default=Path("charts"), show_default=True)
def chart(names: tuple[str, ...], full: bool, peers: bool, output: Path) -> None:
    """Draw accuracy against cost, by NAME (none: the list); each with its data and a caption."""
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
@click.argument("case")
@click.option(
    "--tolerance",
    default="1%",
    show_default=True,
    help="On the contact area, relative, at 95 % confidence: 1% or 0.01.",
)
@click.option("--size", type=click.Choice(casefile.SIZES), default=None, help="Of the case.")
@click.option("--check", is_flag=True, help="Run the plan and say whether its promise held.")
def plan(case: str, tolerance: str, size: str | None, check: bool) -> None:
    """Say what the cheapest model of CASE is that meets a tolerance, why, and what it costs."""
    from epcontact import planning

    path = casefile.find_case(case)
    loaded = casefile.load_case(path, size or casefile.case_sizes(path)[-1])
    if loaded.skip:
        raise InvalidCase(f"{path}: {loaded.skip}")
    chosen = planning.plan(loaded, _share(tolerance), progress=_tell)
    surfaces = f"{chosen.surfaces} surface{'s' if chosen.surfaces > 1 else ''}"
    grid = " x ".join(map(str, chosen.shape))
    areas = "" if chosen.method == "persson" else f", {grid} points, {surfaces}"
    click.echo(f"{chosen.case}: {chosen.method}{areas}, {chosen.areas} areas")
    for reason in chosen.reasons:
        click.echo(f"  {reason}")
    click.echo(
        f"  expected: error {100 * chosen.expected_error:.2g} %, "
        f"work {chosen.work:.3g} point-transforms against {chosen.given_work:.3g} of the case"
    )
    if not chosen.meets:
        raise InvalidCase(f"{chosen.case}: no model within reach meets {tolerance}")
    if check:
        cheaper = replace(planning.planned_case(loaded, chosen), methods=(chosen.method,), gates=())
        with TemporaryDirectory() as folder:
            (checked,) = verify(cheaper, size="auto", output=folder).cases
        answer = checked.answers[chosen.method]
        if answer.errors:
            raise EpcontactError("; ".join(answer.errors))
        error = planning.achieved_error(chosen, answer)
        verdict = "held" if error <= chosen.tolerance else "was broken"
        click.echo(
            f"  {chosen.case}: the promise {verdict}: error {error:.2g}, "
            f"{chosen.expected_error:.2g} expected, {chosen.tolerance:.2g} allowed"
        )


def _share(text: str) -> float:
    try:
        number = text.strip()
        return float(number[:-1]) / 100 if number.endswith("%") else float(number)
    except ValueError:
        raise InvalidCase(
            f"--tolerance is {text!r}, but must be a share such as 1% or 0.01"
        ) from None


@click.command()
@click.argument("maps", nargs=-1)
@click.option("--full", is_flag=True, help="Minutes instead of seconds, and finer.")
@click.option("--output", type=_folder, default=Path("stability"), show_default=True)
def stability(maps: tuple[str, ...], full: bool, output: Path) -> None:
    """Sweep loads and hardnesses, and map where each method converges and how fast."""
    from epcontact.studies.stability import MAPS, stability_map, write

    data = stability_map(maps or MAPS, "full" if full else "coarse", progress=_tell)
    for path in write(data, output):
        click.echo(path)
    Console().print(_stability_table(data))


def _stability_table(data: StabilityMap) -> Table:
    """Points, failures and the largest effort of each method; the map's CSV tells each point."""
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
    """Make one self-contained page of a verification run from its output FOLDER."""
    click.echo(f"report in {write_report(folder, output)}")


def write_report(folder: Path, output: Path | None = None) -> Path:
    """Write the page of a verification run from its folder; returns the file."""
    from epcontact.harness.pictures import theory_densities
    from epcontact.output.report import report_folder

    return report_folder(folder, output, theory=theory_densities)


@click.command()
@click.argument("result", type=click.Path(path_type=Path))
@click.option("--screenshot", type=_file, help="Draw to this PNG instead of a window.")
@click.option(
    "--map",
    "contact_map",
    type=_file,
    help="Draw contact state and pressure in the plane: a .png, or by a name without ending a "
    "picture, its data and a caption.",
)
@click.option(
    "--against",
    type=click.Path(path_type=Path),
    help="Draw this result's pressure beside it, with the difference (with --screenshot).",
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
    """Show the fields of a result (.vti, .vtu, .pvd, or a method's .json) in three dimensions."""
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


@click.command()
@click.argument("kind", type=click.Choice(["case", "verdict"]))
def schema(kind: str) -> None:
    """Print the JSON Schema of a case file, or of verdict.json."""
    model = Family if kind == "case" else Verdict
    click.echo(json.dumps(plain(model.model_json_schema()), indent=2, allow_nan=False))


@click.command()
@click.argument("case")
@click.option("--size", type=click.Choice(casefile.SIZES), default="fast", show_default=True)
@click.option(
    "--seeds", default=None, metavar="FIRST-LAST", help="other random surfaces by the case's recipe"
)
def crosscheck(case: str, size: str, seeds: str | None) -> None:
    """Split the difference of finite and boundary elements on CASE: grid, depth, model."""
    from epcontact.harness.crosscheck import crosscheck as check

    others = () if seeds is None else _seeds(seeds)
    found = casefile.load_case(casefile.find_case(case), size)
    click.echo(check(found, others))


#: Far more surfaces than any ensemble here needs, and a list of them is still nothing.
_MOST_SEEDS = 10_000


def _seeds(text: str) -> range:
    """The seeds FIRST to LAST, both included."""
    first, _, last = text.partition("-")
    # Digits beyond those of the largest seed, 2**63 - 1, are no number to Python at some length.
    digits = all(t.isdecimal() and len(t) <= 19 for t in (first, last))
    if not (digits and int(first) <= int(last) < 2**63):
        raise click.BadParameter(f"{text!r:.60} is no range of seeds; give such as 101-112")
    if int(last) - int(first) >= _MOST_SEEDS:
        raise click.BadParameter(
            f"{text} asks for {int(last) - int(first) + 1} surfaces; give at most {_MOST_SEEDS}"
        )
    return range(int(first), int(last) + 1)


COMMANDS = (chart, crosscheck, plan, stability, report, view, schema)
