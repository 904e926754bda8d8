"""The commands beyond one run of a case: plan, crosscheck, export, hardness, joint and
sweep.
"""

from __future__ import annotations

import itertools
import re
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import pandas as pd

from epcontact import planning
from epcontact.cli.listing import open_console
from epcontact.cli.main import tell
from epcontact.cli.options import of_run, own_size, shown_progress
from epcontact.cli.tables import loads_table
from epcontact.crosscheck.report import crosscheck as check_models
from epcontact.errors import EpcontactError, InvalidCase
from epcontact.harness.case_files.case import SIZES, Case, find_case, load_case
from epcontact.harness.quantities.registry import QUANTITIES
from epcontact.harness.solving.tasks import Run
from epcontact.harness.sweep import digest, run_sweep
from epcontact.harness.verdict.verification import verify
from epcontact.materials.hardness_map import effective_hardness
from epcontact.peers import calculix
from epcontact.reference.conductance import joint_conductance


@click.command()
@click.argument("case")
@click.option(
    "--tolerance",
    default="1%",
    show_default=True,
    help="Relative, at 95 % confidence: 1% or 0.01.",
)
@click.option(
    "--part",
    "parts",
    multiple=True,
    default=["total"],
    show_default=True,
    type=click.Choice(["total", "elastic", "plastic"]),
    help="Of the area; may be given again.",
)
@click.option(
    "--size",
    type=click.Choice(SIZES),
    default=None,
    help="Size of the case; else its largest.",
)
@click.option(
    "--check",
    is_flag=True,
    help="Run the plan and a finer grid; exit 1 if the error is larger.",
)
@of_run("executor")
def plan(
    case: str,
    tolerance: str,
    size: str | None,
    parts: tuple[str, ...],
    check: bool,
    run: Run,
) -> None:
    """Find the cheapest model of CASE whose contact area is within a tolerance; print
    the reasons and the cost.

    --executor is for the solves of --check.
    """
    text = find_case(case)
    loaded = load_case(text, size or text.sizes[-1])
    if loaded.skip:
        raise InvalidCase(f"{text.where}: {loaded.skip}")
    chosen = planning.plan(loaded, _share(tolerance), parts=parts, progress=tell)
    surfaces = f"{chosen.surfaces} surface{'s' if chosen.surfaces > 1 else ''}"
    grid = " x ".join(map(str, chosen.shape))
    areas = f", {grid} points, {surfaces}" if chosen.on_grid else ""
    click.echo(f"{chosen.case}: {chosen.method}{areas}, {chosen.areas} areas")
    cap = loaded.mapped_hardness
    exact = "the plan takes this hardness as exact; its own uncertainty comes on top"
    edges = any("treatment of the edges" in note for note in chosen.notes)
    more = (
        "the plan is for the error of the grid; what the edges may change comes on top"
    )
    told = [*chosen.reasons, *([more] if edges else []), *([cap, exact] if cap else [])]
    for sentence in (*told, *chosen.notes):
        click.echo(f"  {sentence}")
    click.echo(
        f"  expected: error {100 * chosen.expected_error:.2g} %, "
        f"work {chosen.work:.3g} (grid points times transforms); the case as it is takes "
        f"{chosen.given_work:.3g}"
    )
    if not chosen.meets:
        raise InvalidCase(f"{chosen.case}: no model within reach meets {tolerance}")
    if check:
        _check(loaded, chosen, run)


def _check(case: Case, chosen: planning.Plan, run: Run) -> None:
    """Run a plan and the finer grid that judges it; exit with 1 if it breaks its
    promise.
    """
    cheaper = planning.planned_case(case, chosen).changed(
        methods=(chosen.method,), gates=()
    )
    finer = planning.finer_case(case, chosen)
    with TemporaryDirectory() as folder:
        cases = [one for one in (cheaper, finer) if one is not None]
        judged = verify(cases, run, size="auto", output=folder).cases
    answers = [answer for one in judged for answer in one.results.values()]
    if errors := [error for answer in answers for error in answer.errors]:
        raise EpcontactError("; ".join(errors))
    error = planning.achieved_error(chosen, *answers)
    held = error <= chosen.tolerance
    figures = f"{chosen.expected_error:.2g} expected, {chosen.tolerance:.2g} allowed"
    kept = f"the promise {'held' if held else 'was broken'}: error {error:.2g} by"
    if finer is not None:
        said = (
            f"{kept} {' x '.join(map(str, finer.recipes[0].shape))} points, {figures}"
        )
    else:
        said = (
            f"the error is {error:.2g} by its own claim, {figures}; nothing checks the claim, "
            "because the heights have one grid"
        )
    click.echo(f"  {chosen.case}: {said}")
    if not held:
        sys.exit(1)


def _share(text: str) -> float:
    number = text.strip()
    try:
        return float(number.removesuffix("%")) / (100 if number.endswith("%") else 1)
    except ValueError:
        raise InvalidCase(
            f"--tolerance is {text!r}, but must be a share such as 1% or 0.01"
        ) from None


@click.command()
@click.argument("case")
@own_size
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
    """Split the difference of finite and boundary elements on CASE into grid, depth,
    model.

    A case that names calculix or tamaas_j2 is also answered by these codes, in a table.
    """
    others = () if seeds is None else _seeds(seeds)
    click.echo(check_models(load_case(find_case(case), size), others, steps=steps))


#: Largest number of seeds: far more than an ensemble needs, and still a short list.
_MOST_SEEDS = 10_000


def _seeds(text: str) -> range:
    """Return the seeds FIRST to LAST, both included."""
    ends = re.fullmatch(r"(\d{1,19})-(\d{1,19})", text)  # the largest seed is 2**63 - 1
    seeds = range(int(ends[1]), int(ends[2]) + 1) if ends else range(0)
    if not 0 < seeds.stop - seeds.start <= _MOST_SEEDS or seeds.stop > 2**63:
        raise click.BadParameter(
            f"{text!r:.60} is no range of at most {_MOST_SEEDS} seeds; give such as 101-112"
        )
    return seeds


@click.command()
@click.argument("case")
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
@own_size
def export(case: str, file: Path, size: str) -> None:
    """Write the finite-element block of CASE, with its first surface, for another code.

    FILE.inp is a whole input file of CalculiX, which `ccx FILE` runs without its ending.  .vtu,
    .vtk, .msh, .med and .xdmf (these two with the package h5py) have the bricks, the nodes of "top"
    and "base", and the gap (m) of each top node to the rigid flat on the highest of them.
    """
    loaded = load_case(find_case(case), size)
    if loaded.skip:
        raise InvalidCase(f"{loaded.path}: {loaded.skip}")
    options = loaded.fem.model_dump(exclude_none=True)
    click.echo(calculix.export(loaded.scene(loaded.recipes[0]), file, options))


@click.command()
@click.option("--yield-stress", type=float, required=True, help="sigma_Y in Pa.")
@click.option("--young-modulus", type=float, required=True, help="E in Pa.")
@click.option("--poisson-ratio", type=float, required=True, help="nu.")
@click.option(
    "--rms-slope",
    type=float,
    required=True,
    help="Of all roughness, short waves included.",
)
@click.option(
    "--mean-pressure", type=float, required=True, help="Force over nominal area, in Pa."
)
@click.option(
    "--breadth",
    type=float,
    help="Longest (roll-off) over shortest wavelength; else any.",
)
def hardness(**scene: Any) -> None:
    """Print the pressure cap that stands for a rough J2 metal, from the map of the
    package.

    hardness = "effective" in a case file is the same with the rms slope of the case's
    surface, which may be a measured map.
    """
    found = effective_hardness(**scene)
    click.echo(str(found))
    click.echo(found.source)


@click.command()
@click.option(
    "--conductivities",
    type=float,
    nargs=2,
    required=True,
    help="Of both bodies, in W/(m K).",
)
@click.option(
    "--rms-height", type=float, required=True, help="Of both surfaces together, in m."
)
@click.option(
    "--rms-slope",
    type=float,
    required=True,
    help="Of both together: 1.77 times the mean absolute slope of a profile.",
)
@click.option(
    "--hardness", type=float, required=True, help="Of the softer body, in Pa."
)
@click.option(
    "--effective-modulus", type=float, required=True, help="E* of both bodies, in Pa."
)
@click.option(
    "--mean-pressure", type=float, required=True, help="Force over nominal area, in Pa."
)
@click.option(
    "--breadth",
    type=float,
    help="Longest (roll-off) over shortest wavelength; else 2 to 12.",
)
def joint(**given: Any) -> None:
    """Print what a rough joint conducts, with its interval, and what textbooks say of
    it.

    Gaussian, isotropic roughness, vacuum, clean metals and a joint much larger than its
    longest waves are assumed.  The exact route is a case of this surface with a gate on
    quantity.conductance.
    """
    click.echo(str(joint_conductance(**given)))


#: Points that a terminal shows; the CSV file has all.
_ROWS = 40


@click.command()
@click.argument("case")
@own_size
@of_run("jobs", "output", "fresh", "executor", "precision")
@click.option(
    "--fields",
    type=click.Choice(["first", "all", "steps", "none"]),
    default="none",
    show_default=True,
    help="Write the fields (.vti) of the first surface of each point, of all, or at every load.",
)
@click.option(
    "--among",
    default="",
    metavar="WORDS",
    help="Write them where a point contains this, as the table shows it: 'hardness 3e+09'.",
)
@click.option(
    "--charts", is_flag=True, help="Draw the loads of the points, and each field."
)
def sweep(
    case: str, size: str, run: Run, fields: str, among: str, charts: bool
) -> None:
    """Solve CASE at every point of its table [sweep], on one machine or on a cluster.

    The results are kept in a folder as soon as they are solved: stop the command at any
    moment, and start it again to go on. `epcontact.harness.sweep.table(FOLDER)` reads
    them as a pandas table.
    """
    with shown_progress(replace(run, fields=fields)) as shown:
        swept = run_sweep(case, shown, size=size, among=among)
    console = open_console()
    shown_points = dict(itertools.islice(swept.loads.items(), _ROWS))
    units = {
        n.removeprefix("quantity."): QUANTITIES[n].unit.strip("–")
        for n in swept.quantities
    }
    console.print(loads_table(shown_points, "point", console.width, **units))
    if (left := len(swept.loads) - len(shown_points)) > 0:
        click.echo(f"and {left} more")
    for note, count in swept.notes.items():
        click.echo(f"note of {count} task{'s' * (count > 1)}: {note}")
    if charts:
        # Charts take long to load.
        from epcontact.pictures.folder import draw_sweep

        rows_by_point = {point: rows for point, (rows, _) in swept.loads.items()}
        draw_sweep(swept.folder, rows_by_point, swept.fields)
    for path, words in swept.fields.items():
        click.echo(f"fields of {words} in {path}")
    tasks = swept.table.loc[swept.table["load"] == 0, "solved"]
    click.echo(
        f"{tasks.sum()} of {len(tasks)} tasks are solved, {swept.reused} of them earlier; "
        f"table in {swept.folder / 'sweep.csv'}, digest {digest(swept.table)[:12]}"
    )
    if swept.failures:
        reasons = pd.Series(
            swept.failures
        ).value_counts()  # each once, with its number of tasks
        told = "; ".join(
            f"{count} with: {reason}" for reason, count in reasons.head(5).items()
        )
        raise EpcontactError(
            f"{len(swept.failures)} tasks failed, which the next run tries again: {told}"
        )
