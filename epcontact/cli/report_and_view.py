"""The commands that show results: report and view."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click

from epcontact.cli.main import print_text
from epcontact.cli.progress import show_progress
from epcontact.files import require_writable
from epcontact.harness.verdict.judgement import Verdict
from epcontact.harness.verdict.overview import overview
from epcontact.output import view as viewing
from epcontact.output.charts.maps import save_map
from epcontact.output.report import report_folder
from epcontact.pictures.drawn import draw_saved_cases


def report(folder: Path, output: Path | None) -> None:
    """Write one self-contained page of the verification run in FOLDER.

    The arguments are those of `commands.report`.
    """
    verdict = Verdict.read(folder / "verdict.json")
    require_writable(folder)  # before pictures are drawn into it
    with show_progress("report") as progress:
        page = report_folder(
            folder,
            verdict.content,
            output,
            draw=partial(draw_saved_cases, progress=progress),
            overview=overview(verdict),
        )
    print_text(f"report in {page}")


def view(
    result: Path,
    screenshot: Path | None,
    contact_map: Path | None,
    against: Path | None,
    film: Path | None,
    factor: float | None,
) -> None:
    """Show the fields of a result in three dimensions.

    The arguments are those of `commands.view`.
    """
    if against is not None and screenshot is None:
        raise click.UsageError("--against draws to a file; give --screenshot too")
    if contact_map is not None:
        save_map(viewing.find_result(result), contact_map)
        print_text(f"map in {contact_map}")
    if film is not None:
        with show_progress("view"):
            viewing.animate([result], film, factor=factor)
        print_text(f"film in {film}")
    if screenshot is not None:
        with show_progress("view"):
            if against is None:
                viewing.screenshot(result, screenshot, factor=factor)
            else:
                viewing.compare(result, against, screenshot)
        print_text(f"picture in {screenshot}")
    if screenshot is None and contact_map is None and film is None:
        viewing.show(result, factor=factor)
