"""The commands of the finite-element block: crosscheck and export."""

from __future__ import annotations

import re
from pathlib import Path

import click

from epcontact.cli.main import print_text
from epcontact.cli.progress import show_progress
from epcontact.crosscheck.report import crosscheck as check_models
from epcontact.errors import InvalidCase
from epcontact.harness.case_files.case import find_case, load_case
from epcontact.peers import calculix

#: Largest number of seeds: far more than an ensemble needs, and still a short list.
_MOST_SEEDS = 10_000


def crosscheck(case: str, size: str, seeds: str | None, steps: int | None) -> None:
    """Split the difference of finite and boundary elements into grid, depth, model.

    The arguments are those of `commands.crosscheck`.
    """
    loaded = load_case(find_case(case), size)
    numbers = range(0)
    if seeds is not None:
        numbers = _seeds(seeds)
    with show_progress("crosscheck"):
        text = check_models(loaded, numbers, steps=steps)
    print_text(text)


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


def export(case: str, file: Path, size: str) -> None:
    """Write the finite-element block of CASE, with its first surface, to FILE.

    The arguments are those of `commands.export`.
    """
    loaded = load_case(find_case(case), size)
    if not loaded.recipes:
        raise InvalidCase(f"{loaded.path}: {loaded.skip}")
    options = loaded.fem.model_dump(exclude_none=True)
    with show_progress("export"):
        text = calculix.export(loaded.scene(loaded.recipes[0]), file, options)
    print_text(text)
