"""The command that tells what a result rests on."""

from __future__ import annotations

import click

from epcontact.harness.case_files import case as casefile
from epcontact.harness.case_files.citations import citation


@click.command()
@click.argument("case")
@click.option(
    "--size",
    type=click.Choice(casefile.SIZES),
    default="fast",
    show_default=True,
    help="Which of a case's sizes to cite; gates may differ.",
)
def cite(case: str, size: str) -> None:
    """Print what a case's results rest on: sources, papers by DOI, versions of the software."""
    for line in citation(casefile.load_case(casefile.find_case(case), size)):
        click.echo(line)
