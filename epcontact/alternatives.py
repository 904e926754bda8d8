"""The errors that the measurement of a surface causes, by solving what it leaves open.

A measured map has `Surface.alternatives`: other planes and other heights in its holes
that agree with the measurement, too.  A method solves the scene on each of them.  The
differences from its result are the error parts "form" and "missing" of each value.

Differences need fewer points than values: on a large grid, the surface and its
alternatives are solved on every second, third ... point.  That keeps the distribution
of the heights and the fraction of filled points.  Heights without their short waves
would lose the narrow summits, with which contact begins, and single filled points.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from epcontact.results import COLUMNS, Areas, LoadStep
from epcontact.scene import Alternative, Scene, Surface

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

#: The most grid points on which a surface is solved for these errors.  On every fourth
#: point of 1280 x 1280 points the errors of gap, conductance and percolation change by
#: a fiftieth (median of six kinds); those of the areas, which were .2 % of the area,
#: grow by a fifth to a half.  As many errors are within the estimates as with all
#: points (`tests/laboratory/measured_maps.py`, `--largest`).
LARGEST_GRID = 2**18

#: Columns without such errors: they say how much is on filled points.
_FRACTIONS = {"filled_contact", "filled_load"}
#: Solves a scene, and returns its load steps.
SolveSteps = Callable[[Scene], Sequence[LoadStep]]


def without_alternatives(scene: Scene) -> Scene:
    """Return the scene with a surface without alternatives, or the scene itself."""
    if not scene.surface.alternatives:
        return scene
    return replace(scene, surface=scene.surface.annotated(alternatives=()))


def on_coarser_grid(scene: Scene) -> Scene:
    """Return the scene for a solve of its alternatives: on fewer points if it has many.

    Args:
        scene: the scene, whose surface has alternatives.

    Returns:
        The scene itself if its surface has up to LARGEST_GRID points.  Otherwise one
        with every second, third ... point, about as many as LARGEST_GRID, of the
        surface and of its alternatives.
    """
    surface = scene.surface
    heights = surface.heights
    step = math.ceil((heights.size / LARGEST_GRID) ** (1 / heights.ndim))
    if step == 1:
        return scene
    indices = []
    for size in heights.shape:
        count = math.ceil(size / step)
        indices.append(np.arange(count) * size // count)
    points = np.ix_(*indices)
    filled = surface.filled
    if filled is not None:
        filled = filled[points]
    alternatives = [_at(points, surface, each) for each in surface.alternatives]
    coarse = replace(
        surface,
        heights=heights[points],
        filled=filled,
        recipe=f"{surface.fingerprint}, one of {step} points along each side",
        alternatives=tuple(alternatives),
        sampled=False,  # so that no error by this grid is solved for
    )
    return replace(scene, surface=coarse)


def _at(
    points: tuple[np.ndarray, ...], surface: Surface, alternative: Alternative
) -> Alternative:
    """Return an alternative of a surface for some of its points.

    Args:
        points: the index of these points, from `numpy.ix_`.
        surface: the surface.
        alternative: one of its alternatives.
    """
    changes = []
    for change in alternative.changes:
        if alternative.points is ...:
            field = np.broadcast_to(change, surface.shape)
        else:
            field = np.zeros(surface.shape)
            field[alternative.points] = change
        changes.append(field[points])
    return Alternative(alternative.source, ..., tuple(changes))


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
            `steps`.  If another method solves the alternatives, or the same one on a
            coarser grid, these are its steps for the scene.

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
