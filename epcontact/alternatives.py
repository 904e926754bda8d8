"""The errors that the measurement of a surface causes, by solving what it leaves open.

A measured map has `Surface.alternatives`: other planes and other heights in its holes
that agree with the measurement, too.  A method solves the scene on each of them.  The
differences from its result are the error parts "form" and "missing" of each value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from epcontact.results import COLUMNS, Areas, LoadStep
from epcontact.scene import Scene

#: An error is this number times the largest difference that an alternative makes.
#: More than 92 % of the errors of areas, gap, stiffness, conductance and percolation
#: are within it, on each of seven kinds of surfaces and six kinds of holes from which
#: it was not derived (`tests/laboratory/measured_maps.py`).
FACTOR = 2.0
#: Fraction of the load on filled points above which no area is claimed: most of the
#: contact is then one of the filling.
MOST = 0.5
#: The areas of a solve for an error may stop at this relative change: two digits of the
#: error are enough.
TOLERANCE_OF_ERROR = 1e-4

#: Columns without such errors: they say how much is on filled points.
_FRACTIONS = {"filled_contact", "filled_load"}
#: Solves a scene, and returns its load steps.
SolveSteps = Callable[[Scene], Sequence[LoadStep]]


def without_alternatives(scene: Scene) -> Scene:
    """Return the scene with a surface without alternatives, or the scene itself."""
    if not scene.surface.alternatives:
        return scene
    return replace(scene, surface=replace(scene.surface, alternatives=()))


def with_measurement_errors(
    scene: Scene,
    steps: Sequence[LoadStep],
    solve: SolveSteps,
    base: Sequence[LoadStep] | None = None,
) -> tuple[LoadStep, ...]:
    """Return load steps with the errors that the measurement of the surface causes.

    Args:
        scene: the scene that was solved; without alternatives of its surface, the steps
            are returned as they are.
        steps: its load steps.
        solve: solves the same load path on another surface.
        base: the steps from which the results on the alternatives differ; None:
            `steps`.  Another method than that of `steps` may solve the alternatives,
            and then also gives these.

    Raises:
        What `solve` raises.
    """
    by_source: dict[str, list[Sequence[LoadStep]]] = {}
    for alternative in scene.surface.alternatives:
        surface = alternative.applied_to(scene.surface)
        solved = solve(replace(scene, surface=surface))
        by_source.setdefault(alternative.source, []).append(solved)
    result = list(steps)
    for source, paths in by_source.items():
        for k, step in enumerate(result):
            compared = [path[k] for path in paths]
            from_step = steps[k] if base is None else base[k]
            result[k] = _with_differences(step, from_step, compared, source)
    return tuple(result)


def _with_differences(
    step: LoadStep, base: LoadStep, others: Sequence[LoadStep], source: str
) -> LoadStep:
    """Return a load step with the errors by one source.

    An error is `FACTOR` times the largest difference from `base`.  It is infinite for
    the areas if most of the load is on filled points, see `is_unmeasured`.

    Args:
        step: the load step.
        base: the step from which the others differ.
        others: the results at this load on the alternatives.
        source: "form" or "missing", a part of the names of the errors.
    """
    if not step.areas:  # a solver of single loads has no other steps
        return step
    errors = {}
    unmeasured = source == "missing" and any(map(is_unmeasured, (step, *others)))
    for part, area in vars(base.best_areas).items():
        differences = [abs(vars(s.best_areas)[part] - area) for s in others]
        errors[part] = math.inf if unmeasured else FACTOR * max(differences)
    quantities = dict(step.quantities)
    reported = COLUMNS.keys() & quantities.keys() & base.quantities.keys()
    for name in reported - _FRACTIONS:
        values = [s.quantities.get(name, math.nan) for s in others]
        differences = [abs(value - base.quantities[name]) for value in values]
        quantities[f"{name}_error_by_{source}"] = FACTOR * max(differences)
    areas = {**step.areas, f"{source}_error": Areas(**errors)}
    return replace(step, areas=areas, quantities=quantities)


def is_unmeasured(step: LoadStep) -> bool:
    """Return True if most of the load of a step is on points that nobody measured."""
    return step.quantities.get("filled_load", 0.0) > MOST


def filled_notes(steps: Sequence[LoadStep]) -> tuple[str, ...]:
    """Return a note if no area is claimed at some load, because most of the load is, or
    may be, on heights that nobody measured.

    Args:
        steps: the load steps of a path, one at least, with their measurement errors.

    Returns:
        One sentence for users, with the fraction and the mean pressure where it is
        largest; () if no note is needed.
    """
    fractions = [step.quantities.get("filled_load", 0.0) for step in steps]
    unclaimed = []
    for step in steps:
        error = step.areas.get("missing_error")
        unclaimed.append(error is not None and math.isinf(error.total))
    largest = max(fractions)
    if largest > MOST:
        pressure = steps[fractions.index(largest)].mean_pressure
        found = f"{100 * largest:.3g} % of the load at {pressure:.4g} Pa is on heights"
    elif any(unclaimed):
        pressure = steps[unclaimed.index(True)].mean_pressure
        found = f"more than half of the load at {pressure:.4g} Pa may be on heights"
    else:
        return ()
    return (
        f"{found} that were filled, clipped or replaced and not measured, so that no "
        "area is claimed there (its error is infinite): measure the points without a "
        "height again (other exposure, range, objective or tilt, or a stylus), or crop "
        "the map to a part with fewer of them",
    )
