"""The commands of the finite-element block: crosscheck and export."""

from __future__ import annotations

import re
from pathlib import Path

import click

from epcontact.cli.main import print_text
from epcontact.cli.options import case_size
from epcontact.crosscheck.report import crosscheck as check_models
from epcontact.errors import InvalidCase
from epcontact.harness.case_files.case import find_case, load_case
from epcontact.peers import calculix

#: Largest number of seeds: far more than an ensemble needs, and still a short list.
_MOST_SEEDS = 10_000


@click.command()
@click.argument("case")
@case_size
@click.option(
    "--seeds",
    default=None,
    metavar="FIRST-LAST",
    help="Surfaces of these seeds, not the case's.",
)
@click.option(
    "--steps", type=click.IntRange(1), help="Increments of the J2 body, not the case's."
)
def crosscheck(case: str, size: str, seeds: str | None, steps: int | None) -> None:
    """Split the difference of finite and boundary elements into grid, depth, model.

    A case that names calculix or tamaas_j2 is also solved by these codes, in a table.
    """
    loaded = load_case(find_case(case), size)
    numbers = range(0)
    if seeds is not None:
        numbers = _seeds(seeds)
    print_text(check_models(loaded, numbers, steps=steps))


def _seeds(text: str) -> range:
    """Return the seeds of a text "FIRST-LAST", both ends included.

    Raises BadParameter if the text has another form, no seed or more than `_MOST_SEEDS`
    of them, or a seed that is too large for numpy's generators.
    """
    ends = re.fullmatch(r"(\d{1,19})-(\d{1,19})", text)
    seeds = range(0)
    if ends:
        seeds = range(int(ends[1]), int(ends[2]) + 1)
    largest = 2**63  # of numpy's generators
    if not 0 < seeds.stop - seeds.start <= _MOST_SEEDS or seeds.stop > largest:
        raise click.BadParameter(
            f"{text!r:.60} is no range of at most {_MOST_SEEDS} seeds; give such as "
            "101-112"
        )
    return seeds


@click.command()
@click.argument("case")
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
@case_size
def export(case: str, file: Path, size: str) -> None:
    """Write the finite-element block of CASE, with its first surface, to FILE.

    FILE.inp is a complete input file of CalculiX, which `ccx FILE` runs without its
    ending.  .vtu, .vtk, .msh, .med and .xdmf (these two with the package h5py) hold the
    bricks, the nodes of "top" and "base", and the gap (m) of each top node to the rigid
    flat on the highest of them.
    """
    loaded = load_case(find_case(case), size)
    if loaded.skip:
        raise InvalidCase(f"{loaded.path}: {loaded.skip}")
    options = loaded.fem.model_dump(exclude_none=True)
    print_text(calculix.export(loaded.scene(loaded.recipes[0]), file, options))
