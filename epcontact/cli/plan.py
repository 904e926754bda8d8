"""The command `plan`: the cheapest model of a case that meets a tolerance."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from tempfile import TemporaryDirectory

from epcontact import planning
from epcontact.cli.main import print_text
from epcontact.cli.progress import show_progress, show_sentences
from epcontact.errors import EpcontactError, InvalidCase
from epcontact.harness.case_files.case import Case, find_case, load_case
from epcontact.harness.solving.tasks import Run
from epcontact.harness.verdict.verification import verify


def plan(
    case: str,
    tolerance: str,
    size: str | None,
    parts: tuple[str, ...],
    check: bool,
    settings: Run,
) -> None:
    """Find the cheapest model of CASE whose contact area is within a tolerance.

    The arguments are those of `commands.plan`.
    """
    text = find_case(case)
    loaded = load_case(text, size or text.sizes[-1])
    if loaded.skip:
        raise InvalidCase(f"{text.where}: {loaded.skip}")
    loaded = loaded.with_available_methods()
    allowed = _fraction(tolerance)
    with show_sentences("plan") as say:
        chosen = planning.plan(loaded, allowed, parts=parts, progress=say)
        say("what the measurement of the map leaves open")
        map_errors = _map_errors(loaded, chosen)
    print_text(f"{chosen.case}: {_model(chosen)}, {chosen.areas} areas")
    sentences = [*chosen.reasons, *chosen.notes]
    if loaded.mapped_hardness:
        sentences.insert(len(chosen.reasons), str(loaded.mapped_hardness))
    for sentence in sentences:
        print_text(f"  {sentence}")
    print_text(
        f"  work {chosen.work:.3g} (grid points times transforms); the case as it is "
        f"takes {chosen.given_work:.3g}"
    )
    if map_errors is not None and map_errors.solves:
        points = " x ".join(map(str, map_errors.shape))
        print_text(
            f"  the errors by form and missing heights take {map_errors.work:.3g} more "
            f"for each load: {map_errors.solves} solves on {points} points"
        )
    print_text(f"  expected: {_expected(loaded, chosen, map_errors)}")
    if not chosen.meets:
        raise InvalidCase(f"{chosen.case}: no model within reach meets {tolerance}")
    if check:
        _check(loaded, chosen, settings)


def _model(chosen: planning.Plan) -> str:
    """Return a plan's method, grid and number of surfaces in words.

    An example is "bem, 64 x 64 points, 3 surfaces"; the theory has its name alone.
    """
    if not chosen.on_grid:
        return chosen.method
    grid = " x ".join(map(str, chosen.shape))
    surfaces = "1 surface" if chosen.surfaces == 1 else f"{chosen.surfaces} surfaces"
    return f"{chosen.method}, {grid} points, {surfaces}"


def _map_errors(case: Case, chosen: planning.Plan) -> planning.MapErrors | None:
    """Return the errors by the measurement of a map; None if the surface is no map, or
    if the plan chooses the theory.
    """
    if not chosen.on_grid or not chosen.notes:  # every map has notes
        return None
    return planning.expected_map_errors(case, chosen.recipes[0], chosen.step)


def _expected(
    case: Case, chosen: planning.Plan, map_errors: planning.MapErrors | None
) -> str:
    """Return the expected error of the area with all its parts, as `run` reports it.

    The plan bounds the parts by the model and by the scatter of surfaces.  The
    errors by the measurement of a map and a hardness that was looked up for a J2 body
    come on top: no grid makes them smaller.  Each part is half the width of a 95 %
    interval, relative to the area.
    """
    model = "grid" if chosen.on_grid else "theory"
    parts = {model: chosen.grid_error}
    if len(chosen.recipes) > 1 or chosen.scatter:
        parts["scatter of surfaces"] = chosen.scatter
    if map_errors is not None:
        names = {
            "treatment": "edges of the map",
            "form": "its removed form",
            "missing": "its missing heights",
        }
        for source, error in map_errors.parts.items():
            parts[names[source]] = error
    if case.mapped_hardness:
        # Where all of the contact flows, the area is the load over the hardness.
        parts["hardness at most"] = case.mapped_hardness.error
    total = math.hypot(*parts.values())
    listed = ", ".join(f"{name} {100 * error:.2g} %" for name, error in parts.items())
    return f"area ± {100 * total:.2g} % at 95 %: {listed}"


def _check(case: Case, chosen: planning.Plan, settings: Run) -> None:
    """Solve a case by its plan and on a finer grid, and print the error of the plan.

    Args:
        case: The case.
        chosen: Its plan.
        settings: How the cases are solved; only the executor counts.

    Raises:
        EpcontactError: A solve fails.
        SystemExit: With code 1, if the error exceeds the tolerance of the plan.
    """
    planned = planning.planned_case(case, chosen)
    planned = planned.changed(methods=(chosen.method,), gates=())
    finer = planning.finer_case(case, chosen)
    cases = [planned]
    if finer is not None:
        cases.append(finer)
    with TemporaryDirectory() as folder, show_progress("plan") as progress:
        settings = replace(settings, output=folder, progress=progress)
        judged = verify(cases, settings, size="auto").cases
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
    print_text(f"  {chosen.case}: {sentence}")
    if not holds:
        sys.exit(1)


def _fraction(text: str) -> float:
    """Return the number of a text such as "1%" or "0.01", both of which are 0.01.

    Raises InvalidCase if the text is not a number.
    """
    number = text.strip()
    try:
        if number.endswith("%"):
            return float(number.removesuffix("%")) / 100
        return float(number)
    except ValueError:
        raise InvalidCase(
            f"--tolerance is {text!r}, but must be a fraction such as 1% or 0.01"
        ) from None
