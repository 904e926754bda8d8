"""The command `plan`: the cheapest model of a case that meets a tolerance."""

from __future__ import annotations

import sys
from tempfile import TemporaryDirectory

import click

from epcontact import planning
from epcontact.cli.main import print_error
from epcontact.cli.options import run_options
from epcontact.errors import EpcontactError, InvalidCase
from epcontact.harness.case_files.case import SIZES, Case, find_case, load_case
from epcontact.harness.solving.tasks import Run
from epcontact.harness.verdict.verification import verify


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
@run_options("executor")
def plan(
    case: str,
    tolerance: str,
    size: str | None,
    parts: tuple[str, ...],
    check: bool,
    settings: Run,
) -> None:
    """Find the cheapest model of CASE whose contact area is within a tolerance.

    Prints the reasons and the cost.  --executor is for the solves of --check.
    """
    text = find_case(case)
    loaded = load_case(text, size or text.sizes[-1])
    if loaded.skip:
        raise InvalidCase(f"{text.where}: {loaded.skip}")
    chosen = planning.plan(
        loaded, _fraction(tolerance), parts=parts, progress=print_error
    )
    click.echo(f"{chosen.case}: {_model(chosen)}, {chosen.areas} areas")
    for sentence in (*chosen.reasons, *_caveats(loaded, chosen), *chosen.notes):
        click.echo(f"  {sentence}")
    click.echo(
        f"  expected: error {100 * chosen.expected_error:.2g} %, "
        f"work {chosen.work:.3g} (grid points times transforms); the case as it is "
        f"takes {chosen.given_work:.3g}"
    )
    if not chosen.meets:
        raise InvalidCase(f"{chosen.case}: no model within reach meets {tolerance}")
    if check:
        _check(loaded, chosen, settings)


def _model(chosen: planning.Plan) -> str:
    """Return method, grid and number of surfaces of a plan in words."""
    if not chosen.on_grid:
        return chosen.method
    grid = " x ".join(map(str, chosen.shape))
    surfaces = "1 surface" if chosen.surfaces == 1 else f"{chosen.surfaces} surfaces"
    return f"{chosen.method}, {grid} points, {surfaces}"


def _caveats(case: Case, chosen: planning.Plan) -> list[str]:
    """Return sentences on errors that a plan does not count."""
    sentences = []
    if any("treatment of the edges" in note for note in chosen.notes):
        sentences.append(
            "the plan is for the error of the grid; what the edges may change comes on "
            "top"
        )
    if case.mapped_hardness:
        sentences.append(str(case.mapped_hardness))
        sentences.append(
            "the plan takes this hardness as exact; its own uncertainty comes on top"
        )
    return sentences


def _check(case: Case, chosen: planning.Plan, settings: Run) -> None:
    """Run a plan and the finer grid that judges it; exit with 1 if its error is larger.

    Raises EpcontactError if a solve fails.
    """
    planned = planning.planned_case(case, chosen)
    planned = planned.changed(methods=(chosen.method,), gates=())
    finer = planning.finer_case(case, chosen)
    cases = [planned] if finer is None else [planned, finer]
    with TemporaryDirectory() as folder:
        judged = verify(cases, settings, size="auto", output=folder).cases
    results = [each for case in judged for each in case.results.values()]
    errors = [error for each in results for error in each.errors]
    if errors:
        raise EpcontactError("; ".join(errors))
    error = planning.achieved_error(chosen, *results)
    holds = error <= chosen.tolerance
    bounds = f"{chosen.expected_error:.2g} expected, {chosen.tolerance:.2g} allowed"
    if finer is None:
        sentence = (
            f"the error is {error:.2g} by its own estimate, {bounds}; nothing checks "
            "the estimate, because the heights have one grid"
        )
    else:
        grid = " x ".join(map(str, finer.recipes[0].shape))
        outcome = "held" if holds else "was broken"
        sentence = (
            f"the promise {outcome}: error {error:.2g} by {grid} points, {bounds}"
        )
    click.echo(f"  {chosen.case}: {sentence}")
    if not holds:
        sys.exit(1)


def _fraction(text: str) -> float:
    """Return the number of a text such as "1%" or "0.01"; raise InvalidCase."""
    number = text.strip()
    try:
        if number.endswith("%"):
            return float(number.removesuffix("%")) / 100
        return float(number)
    except ValueError:
        raise InvalidCase(
            f"--tolerance is {text!r}, but must be a share such as 1% or 0.01"
        ) from None
