"""The commands that show results: report and view."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click

from epcontact.cli.main import print_text
from epcontact.cli.options import show_progress
from epcontact.harness.verdict.judgement import Verdict
from epcontact.harness.verdict.overview import overview
from epcontact.output import view as viewing
from epcontact.output.charts.maps import save_map
from epcontact.output.report import report_folder
from epcontact.pictures.drawn import draw_saved_cases

_file = click.Path(path_type=Path, dir_okay=False)


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), default=Path("results"))
@click.option(
    "--output", type=_file, help="Page to write; else report.html in the folder."
)
def report(folder: Path, output: Path | None) -> None:
    """Write one self-contained page of the verification run in FOLDER.

    FOLDER is the output folder of `epcontact verify`.
    """
    verdict = Verdict.read(folder / "verdict.json")
    with show_progress("report") as progress:
        page = report_folder(
            folder,
            verdict.content,
            output,
            draw=partial(draw_saved_cases, progress=progress),
            overview=overview(verdict),
        )
    print_text(f"report in {page}")


@click.command()
@click.argument("result", type=click.Path(path_type=Path))
@click.option("--screenshot", type=_file, help="Draw to this PNG instead of a window.")
@click.option(
    "--map",
    "contact_map",
    type=_file,
    help="Draw contact state and pressure from above, as a .png; a name without an "
    "ending gives the picture, its data and a caption.",
)
@click.option(
    "--against",
    type=click.Path(path_type=Path),
    help="With --screenshot: draw the pressures of RESULT and of this one, and their "
    "difference.",
)
@click.option(
    "--film",
    type=_file,
    help="Draw the load steps of a .pvd as a film: .gif, or .mp4 with imageio-ffmpeg.",
)
@click.option(
    "--factor", type=float, default=None, help="Stretch the deformation by this."
)
def view(
    result: Path,
    screenshot: Path | None,
    contact_map: Path | None,
    against: Path | None,
    film: Path | None,
    factor: float | None,
) -> None:
    """Show the fields of a result in three dimensions.

    RESULT is a .vti, .vtu or .pvd file, or the .json file of a method.
    """
    if against is not None and screenshot is None:
        raise click.UsageError("--against draws to a file; give --screenshot too")
    if contact_map is not None:
        save_map(viewing.find_result(result), contact_map)
        print_text(f"map in {contact_map}")
    if film is not None:
        viewing.animate([result], film, factor=factor)
        print_text(f"film in {film}")
    if screenshot is not None:
        if against is None:
            viewing.screenshot(result, screenshot, factor=factor)
        else:
            viewing.compare(result, against, screenshot)
        print_text(f"picture in {screenshot}")
    if screenshot is None and contact_map is None and film is None:
        viewing.show(result, factor=factor)
