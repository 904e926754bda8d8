"""The commands that judge verdicts as a whole: compare."""

from __future__ import annotations

import sys
from pathlib import Path

import click
from rich.console import Console
from rich.text import Text

from epcontact.cli.listing import table_of
from epcontact.files import whole_file
from epcontact.harness.verdict import compare as comparing
from epcontact.harness.verdict.compare import KEPT, Comparison, keep, read_figures

_path = click.Path(path_type=Path)
#: Rows of a table, and names of a list, that a terminal shows; the CSV file has all.
_ROWS, _NAMES = 20, 5


@click.command()
@click.argument("verdicts", type=_path, nargs=-1, required=True, metavar="[OLD] NEW")
@click.option("--csv", "table", type=_path, help="Write every value that moved to this file.")
@click.option(
    "--keep", "kept", type=_path, help="Keep the figures of NEW in this small .csv, a later OLD."
)
def compare(verdicts: tuple[Path, ...], table: Path | None, kept: Path | None) -> None:
    """Tell what moved from one verdict to another, in units of what the values claim.

    OLD and NEW are verdict.json, a folder that holds it, or a table that --keep wrote; without OLD
    it is the table of this release.  The exit code is 1 if a value moved by more than the error
    that it claims, though its band may hold, or if a gate that held does not.  A value that claims
    no error claims a ten-thousandth; one that must be 0 claims its band.  More work is told in
    counts; seconds depend on the machine, and their ratio judges nothing.
    """
    if len(verdicts) > 2:
        raise click.UsageError(f"compares OLD and NEW, but {len(verdicts)} are given")
    figures = read_figures(verdicts[-1])
    if kept is not None:
        keep(figures, kept)
        click.echo(f"figures in {kept}")
        if len(verdicts) == 1:
            return
    found = comparing.compare(read_figures((KEPT, *verdicts)[-2]), figures)
    if table is not None:
        names = [*comparing.ROW, "value_old", "value_new", "error", "moved"]
        with whole_file(table) as file:
            found.moved[names].to_csv(file, index=False)
    _show(found)
    sys.exit(found.exit_code)


def _show(found: Comparison) -> None:
    console = Console()
    rows = table_of(("moved",), ("old", "new", "in claims"))
    rows.columns[-1].no_wrap = True
    place = ""
    for row in found.moved.head(_ROWS).sort_values(["case", "size"], kind="stable").itertuples():
        if place != (place := f"{row.case} {row.size}"):
            rows.add_row(f"[bold]{place}[/]")
        style = "bold red" if row.moved > 1 else ""
        rows.add_row(
            Text(f"  {row.figure}"), f"{row.value_old:.6g}", f"{row.value_new:.6g}",
            Text(f"{row.moved:.2g}", style),
        )  # fmt: skip
    if len(found.moved):
        console.print(rows)
    work = table_of(("more work",), ("old", "new", "ratio"))
    for row in found.slower.head(_ROWS).itertuples():
        name = row.name.removeprefix("cost.")
        figures = (f"{row.value_old:.6g}", f"{row.value_new:.6g}", f"{row.ratio:.2f}")
        work.add_row(Text(f"{row.case} {row.size}: {name}"), *figures)
    if len(found.slower):
        console.print(work)
    for words, names in found.told.items():
        left = f" and {len(names) - _NAMES} more" if len(names) > _NAMES else ""
        if names:
            said = f"{words}: {', '.join(names[:_NAMES])}{left}"
            console.print(said, markup=False, highlight=False)
    ratios = sorted(found.seconds.values())
    timed = f"; seconds: {ratios[len(ratios) // 2]:.2f} times as many" if ratios else ""
    console.print(
        f"{found.compared} values compared: {len(found.beyond)} moved beyond their claim, "
        f"{len(found.moved) - len(found.beyond)} within it; {len(found.slower)} counts of work "
        f"grew{timed}",
        highlight=False,
    )
