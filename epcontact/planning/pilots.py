"""Pilots: cheap solves that estimate the error and cost of every candidate grid.

The coarsest grids of the ladder are solved.  The relative error estimate of their areas
is extrapolated to finer grids by its observed order, and the number of transforms by
the number of points.  A candidate is a grid with the number of surfaces that it would
need.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtri

from epcontact.harness.case_files.case import Case
from epcontact.harness.gates import standard_deviation, student_half_width
from epcontact.harness.methods.registry import METHODS
from epcontact.machine import available_cores
from epcontact.planning.grids import ladder, on_grid
from epcontact.results import Areas, ContactResult, factor_to_95
from epcontact.surfaces import Recipe
from fem_check.mesh import half_space_depth

#: Largest number of surfaces that a plan asks for, and that pilots solve.
MOST_SURFACES = 1000
PILOT_SURFACES = 8
#: Largest work of all pilots together, as a fraction of the work of the given case.
PILOT_FRACTION = 0.2
#: Numbers of increments that are tried on a plastic body; the others are compared with
#: the last.
STEPS = (5, 10, 20, 80)

#: A function that solves a case on the surface of one recipe; further keywords are
#: options of the method.
Solver = Callable[..., "Pilot"]


class Pilot(NamedTuple):
    """One solve of one surface.

    Attributes:
        shape: Shape of the grid.
        areas: Corrected areas at one load.
        error: Largest relative error of the wanted parts of the area by the grid, the
            half-width of its 95 % interval.
        raw_error: The same for raw areas.
        work: Cost that does not depend on the machine: FFT pairs (boundary elements) or
            iterations (finite elements) times the number of unknowns.
        notes: Notes on the surface.
        step: Number of the load whose areas these are.
    """

    shape: tuple[int, ...]
    areas: Areas
    error: float
    raw_error: float
    work: float
    notes: tuple[str, ...] = ()
    step: int = -1


class Candidate(NamedTuple):
    """A grid with the number of surfaces that it needs.

    Attributes:
        shape: Shape of the grid.
        surfaces: Number of surfaces.
        grid_error: Relative half-width of the areas' 95 % interval by the grid.
        scatter: Relative half-width of the 95 % interval of the mean over surfaces.
        work: The work, as in `Pilot`, of all surfaces together.
    """

    shape: tuple[int, ...]
    surfaces: int
    grid_error: float
    scatter: float
    work: float

    @property
    def error(self) -> float:
        """The relative error of grid and scatter together, at 95 % confidence."""
        return math.hypot(self.grid_error, self.scatter)


#: Options of a quick solve, from which only the areas are wanted, by method.  Finite
#: elements have no such option.
_QUICK: dict[str, dict[str, Any]] = {"bem": {"area_tolerance": 1e-4}}


def solve_pilot(
    case: Case,
    recipe: Recipe,
    method: str,
    parts: Sequence[str],
    threads: int | None,
    step: int | None = None,
    **options: Any,
) -> Pilot:
    """Solve a case on one surface to the accuracy that a plan needs.

    Args:
        case: The case.
        recipe: The surface, on any grid.
        method: Name of the method.
        parts: Parts of the area whose errors are wanted: total, elastic, plastic.
        threads: Number of threads; None: all cores.
        step: Number of the load whose areas are wanted; None: the load whose total area
            has the largest relative error estimate.
        options: Options of the method that replace those of the case.

    Raises:
        EpcontactError: The options do not fit, or the solve fails.
    """
    scene = case.scene(recipe)
    all_options = _QUICK.get(method, {}) | dict(case.options.get(method, {})) | options
    result = METHODS[method].solve(scene, all_options, threads or available_cores())
    if step is None:
        step = _least_accurate_step(result)
    areas = result.steps[step].areas
    corrected = areas["corrected"]
    errors = [math.nan]
    raw_errors = [math.nan]
    for part in parts:
        area = getattr(corrected, part)
        if area:  # a part that does not exist has no relative error
            error = getattr(areas["error"], part) / area * factor_to_95("grid")
            correction = abs(getattr(areas["raw"], part) - area) / area
            errors.append(error)
            raw_errors.append(correction + error)
    sweeps = result.cost.get("equivalent_fft_pairs")
    if not sweeps:
        counts = result.final.iterations
        sweeps = sum(counts.get(name, 0) for name in ("cg", "newton", "sweeps"))
    return Pilot(
        shape=recipe.shape,
        areas=corrected,
        error=float(np.fmax.reduce(errors)),
        raw_error=float(np.fmax.reduce(raw_errors)),
        work=sweeps * result.cost["unknowns"],
        notes=scene.surface.notes,
        step=step,
    )


def _least_accurate_step(result: ContactResult) -> int:
    """Return the index of the load whose area has the largest relative error estimate.

    An area of 0 counts as one without an error.
    """
    errors = []
    for step in result.steps:
        area = step.areas["corrected"].total
        errors.append(step.areas["error"].total / (area or math.inf))
    return int(np.argmax(errors))


def estimate_error(pilots: Sequence[Pilot], shape: tuple[int, ...]) -> float:
    """Return the relative error of the areas on a grid, at 95 % confidence.

    If no pilot was solved on this grid, the error of the finest solved grid is
    extrapolated with the order of convergence between the two finest solved grids.  The
    order is limited to 1 to 2: the random position of a contact's edge between grid
    points has the order 1, its curvature 2.

    Args:
        pilots: Solves on one or more grids.
        shape: Shape of the grid.
    """
    errors: dict[tuple[int, ...], float] = {}
    for pilot in pilots:
        errors[pilot.shape] = max(errors.get(pilot.shape, 0.0), pilot.error)
    if shape in errors:
        return errors[shape]
    finest, *coarser = sorted(errors, key=math.prod, reverse=True)
    order = 1.0
    if coarser and errors[finest] > 0 and errors[coarser[0]] > 0:
        error_ratio = errors[coarser[0]] / errors[finest]
        order = math.log(error_ratio) / math.log(finest[0] / coarser[0][0])
    order = min(max(order, 1.0), 2.0)
    return errors[finest] * math.pow(finest[0] / shape[0], order)


def estimate_work(pilots: Sequence[Pilot], shape: tuple[int, ...]) -> float:
    """Return the work, as in `Pilot`, of a solve of one surface on a grid.

    It is the mean of the pilots on this grid or, if there are none, that on the finest
    solved grid times the ratio of the numbers of points.

    Args:
        pilots: Solves on one or more grids.
        shape: Shape of the grid.
    """
    solved = shape
    if all(pilot.shape != shape for pilot in pilots):
        solved = max((pilot.shape for pilot in pilots), key=math.prod)
    work = np.mean([pilot.work for pilot in pilots if pilot.shape == solved])
    return float(work) * (math.prod(shape) / math.prod(solved))


def finite_element_options(
    case: Case, recipe: Recipe, solve: Solver, tolerance: float
) -> tuple[dict[str, Any], list[str]]:
    """Choose the depth of the block and the number of increments.

    The depth follows from the compliance, the increments from pilots.  Each may cause a
    quarter of the tolerance.

    Args:
        case: A case with finite elements.
        recipe: The surface.
        solve: Solves a pilot with finite elements.
        tolerance: Relative tolerance on the area.

    Returns:
        The options by name, `depth` (m) and `steps`, and a sentence with the reason for
        each.  An option is left out if the case has the depth, if its body is a layer,
        or if its law has no increments.
    """
    options: dict[str, Any] = {}
    reasons = []
    allowed = tolerance / 4
    if case.body.kind == "half_space" and "depth" not in case.options["fem"]:
        longest = max(case.recipes[0].periods)
        depth = half_space_depth(longest, case.material.poisson_ratio, allowed)
        options["depth"] = depth
        reasons.append(
            f"a block {depth:.3g} m deep answers the longest wave within {allowed:.1g} "
            "of the half-space; its layers grow from the grid spacing as fast as the "
            "waves allow"
        )
    if case.options["fem"].get("law") == "j2":
        coarse = on_grid(recipe, ladder(recipe, beyond=False)[0]) or recipe
        areas = [solve(coarse, steps=n, **options).areas.total for n in STEPS]
        differences = {}
        for count, area in zip(STEPS[:-1], areas[:-1], strict=True):
            differences[count] = abs(area / areas[-1] - 1)
        sufficient = [n for n, error in differences.items() if error <= allowed]
        options["steps"] = min(sufficient, default=STEPS[-1])
        listed = ", ".join(f"{error:.1g} with {n}" for n, error in differences.items())
        reasons.append(
            f"{options['steps']} increments: on the coarsest grid the area differs "
            f"from that of {STEPS[-1]} by {listed}; a quarter of the tolerance is "
            "allowed"
        )
    return options, reasons


def solve_pilots(
    recipes: Sequence[Recipe], solve: Solver, tolerance: float
) -> list[Pilot]:
    """Solve the first surface on several grids, and the others on the coarsest one.

    The grids become finer until the error estimate is at most 0.7 of the tolerance, or
    the pilots would cost more than `PILOT_FRACTION` of the case.  Up to
    `PILOT_SURFACES` surfaces are solved on the coarsest grid.

    Args:
        recipes: The surfaces of the case.
        solve: Solves a pilot.
        tolerance: Relative tolerance on the area.
    """
    first = recipes[0]
    shapes = ladder(first, beyond=False)
    pilots: list[Pilot] = []
    for shape, next_shape in zip(shapes, [*shapes[1:], None], strict=True):
        pilots.append(solve(on_grid(first, shape) or first))
        case_work = estimate_work(pilots, first.shape) * len(recipes)
        if next_shape is None or pilots[-1].error <= 0.7 * tolerance:
            break
        next_work = estimate_work(pilots, next_shape)
        if len(pilots) > 1 and next_work > PILOT_FRACTION * case_work / 2:
            break
    for recipe in recipes[1:PILOT_SURFACES]:
        pilots.append(solve(on_grid(recipe, shapes[0]) or recipe))
    return pilots


def on_coarsest_grid(pilots: Sequence[Pilot]) -> list[Pilot]:
    """Return the pilots on the grid of the first pilot, one for each surface.

    The pilots are in the order of `solve_pilots`, whose first grid is the coarsest.
    """
    return [pilot for pilot in pilots if pilot.shape == pilots[0].shape]


def largest_deviation(pilots: Sequence[Pilot], parts: Sequence[str]) -> float:
    """Return the relative standard deviation of the areas between surfaces.

    It is the largest of those of the `parts` of the area (total, elastic, plastic) on
    the coarsest grid, and an upper 80 % bound, because the pilots are few.  It is 0 for
    one surface.
    """
    largest = 0.0
    for part in parts:
        values = [getattr(pilot.areas, part) for pilot in on_coarsest_grid(pilots)]
        degrees = len(values) - 1
        if degrees and sum(values) > 0:
            factor = math.sqrt(degrees / float(chdtri(degrees, 0.8)))
            deviation = standard_deviation(values) / float(np.mean(values))
            largest = max(largest, factor * deviation)
    return largest


def cheapest(
    recipes: Sequence[Recipe],
    pilots: Sequence[Pilot],
    tolerance: float,
    deviation: float,
    capped: bool,
) -> Candidate:
    """Return the cheapest grid that meets the tolerance, or the most accurate one.

    The error of a candidate combines that of the grid with the scatter of the mean over
    its surfaces.  A candidate whose largest allowed number of surfaces leaves too much
    scatter does not meet the tolerance.

    Args:
        recipes: The surfaces of the case.
        pilots: The pilots that were solved.
        tolerance: Relative tolerance on the area at 95 % confidence.
        deviation: Relative standard deviation between surfaces.
        capped: Whether grids finer and ensembles larger than those of the case are
            excluded.
    """
    candidates = []
    most = MOST_SURFACES
    if capped:
        most = len(recipes)
    for shape in ladder(recipes[0], beyond=not capped):
        error = estimate_error(pilots, shape)
        count = 1
        scatter = 0.0
        if len(recipes) > 1 and deviation > 0:
            allowed = math.sqrt(max(tolerance**2 - error**2, 0.0))
            count = _sufficient_surfaces(deviation, allowed, most)
            scatter = student_half_width(deviation, count)
        work = estimate_work(pilots, shape) * count
        candidates.append(Candidate(shape, count, error, scatter, work))
    sufficient = [c for c in candidates if c.error <= tolerance]
    if sufficient:
        return min(sufficient, key=lambda c: c.work)
    return min(candidates, key=lambda c: (c.error, c.work))


def _sufficient_surfaces(deviation: float, half_width: float, most: int) -> int:
    """Return the fewest surfaces whose mean has a narrow 95 % interval.

    Args:
        deviation: Relative standard deviation between surfaces.
        half_width: Largest relative half-width of the interval.
        most: The number that is returned if no smaller one suffices.
    """
    for count in range(2, most + 1):
        if student_half_width(deviation, count) <= half_width:
            return count
    return most
