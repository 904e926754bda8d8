"""The cheapest model that meets a tolerance on the contact area, and why.

The plan chooses the method (theory, boundary or finite elements), a line if the
roughness has one direction, the grid, raw or corrected areas, the number of surfaces
and, for finite elements, depth and load increments.  The tolerance is on the area,
relative, at 95 % confidence.  Cheap pilots (`pilots`) give the 95 % error e of each
grid and the scatter s between surfaces.  Of all grids with e < tolerance the plan takes
the one with the least cost times number n of surfaces, where

    e^2 + (t s / sqrt(n))^2 <= tolerance^2,

with Student's 97.5 % quantile t.  s is an upper 80 % bound, because the pilots are few.
A case with one surface asks for the area of that surface, so n = 1 and there is no
scatter.

The theory is chosen if its error by the map of `persson.validity` is within the
tolerance.  Where that map does not reach, the sum of the theory's difference from the
pilots' mean and of the uncertainty of this mean must be within the tolerance.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from epcontact.errors import EpcontactError, InvalidCase, InvalidScene
from epcontact.harness.case_files.case import Case, CaseText, load_case
from epcontact.harness.gates import Gate, standard_deviation, student_half_width
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.solving.method_results import MethodResults
from epcontact.persson.theory import Theory
from epcontact.persson.validity import expected_errors
from epcontact.planning.grids import (
    Section,
    on_grid,
    one_directional,
    points_per_wavelength,
)
from epcontact.planning.pilots import (
    PILOT_SURFACES,
    Candidate,
    Pilot,
    cheapest,
    estimate_work,
    finite_element_options,
    largest_deviation,
    on_coarsest_grid,
    solve_pilot,
    solve_pilots,
)
from epcontact.results import factor_to_95
from epcontact.scene import Scene
from epcontact.surfaces import Recipe, SelfAffine


@dataclass(frozen=True)
class Plan:
    """A chosen model, its expected error and cost, and the reasons.

    Attributes:
        case: Id of the case.
        tolerance: Relative tolerance on the areas.
        parts: Parts of the area that must be within it: total, elastic, plastic.
        method: Name of the method.
        areas: "raw" or "corrected".
        options: Options of the method.
        grid_error: Relative half-width of the areas' 95 % interval by the grid; for the
            theory its error by the map, or its distance from the pilots with their
            uncertainty.
        scatter: Relative half-width of the 95 % interval of the mean over surfaces.
        work: FFT pairs, or iterations of finite elements, times the number of unknowns,
            of all surfaces.
        given_work: The same for the given case.
        pilot_work: The same for the pilots.
        reasons: Sentences.
        notes: Notes on the surface of the finest pilot.
        recipes: The surfaces on the chosen grid.
        step: Number of the load that the plan is for, whose area is the hardest to
            compute.
    """

    case: str
    tolerance: float
    parts: tuple[str, ...]
    method: str
    areas: str
    options: dict[str, Any]
    grid_error: float
    scatter: float
    work: float
    given_work: float
    pilot_work: float
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    recipes: tuple[Recipe, ...] = field(repr=False)
    step: int = -1

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the grid; one number if a line represents the surface."""
        return self.recipes[0].shape

    @property
    def surfaces(self) -> int:
        """Number of surfaces that are solved; the theory needs one spectrum."""
        if self.on_grid:
            return len(self.recipes)
        return 1

    @property
    def on_grid(self) -> bool:
        """Whether the method has a grid; the theory has none."""
        return METHODS[self.method].has_fields

    @property
    def expected_error(self) -> float:
        """Relative error of the areas at 95 % confidence."""
        return math.hypot(self.grid_error, self.scatter)

    @property
    def meets(self) -> bool:
        """Whether the expected error is within the tolerance."""
        return self.expected_error <= self.tolerance


def plan(
    case: Case,
    tolerance: float = 0.01,
    *,
    parts: Sequence[str] = ("total",),
    threads: int | None = None,
    capped: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Plan:
    """Return the cheapest model of a case whose areas are within a tolerance.

    Args:
        case: A case with boundary or finite elements among its methods.
        tolerance: Relative tolerance on the areas at 95 % confidence.
        parts: The parts of the area that must be within it: total, elastic, plastic.
        threads: Number of threads of the pilots; None: all cores.
        capped: If True, the grid is no finer and the surfaces no more than those of the
            case, even if the plan then misses the tolerance (see `Plan.meets`).
        progress: Called with a sentence before each pilot.

    Raises:
        InvalidCase: The tolerance is out of range, or no pilot can solve the case.
        EpcontactError: A pilot fails.
    """
    if not 0 < tolerance < 1:
        raise InvalidCase(f"tolerance is {tolerance!r}, but must lie between 0 and 1")
    method = _method_to_plan(case, parts)
    recipes = case.recipes
    reasons = []
    axis = one_directional(recipes[0])
    if axis is not None:
        recipes = tuple(Section(recipe, axis) for recipe in recipes)
        direction = "xy"[axis]
        reasons.append(
            f"all roughness runs along {direction}: a line stands for the surface"
        )
    options: dict[str, Any] = {}
    # Gates, which an automatic size is for, read the last load.  On a longer path the
    # first pilot finds the load that is the hardest to compute.
    only_last_load = capped or len(case.load.path) == 1
    step: int | None = -1 if only_last_load else None

    def solve(recipe: Recipe, **tried: Any) -> Pilot:
        """Return a pilot of the case on the surface of one recipe.

        `tried` are options of the method that are added to those chosen so far.  The
        first pilot chooses the load that all later ones are for.  Raises EpcontactError
        if the solve fails.
        """
        nonlocal step
        if progress is not None:
            points = " x ".join(map(str, recipe.shape))
            progress(f"pilot by {method} on {points} points")
        pilot = solve_pilot(
            case, recipe, method, parts, threads, step, **(options | tried)
        )
        step = pilot.step
        return pilot

    # Finite elements are the only such method with a grid that a plan can choose.
    if METHODS[method].has_model_measures:
        options, of_options = finite_element_options(case, recipes[0], solve, tolerance)
        reasons += of_options
    # "fem" is the table of the case file with the law of the finite elements.
    if case.options.get("fem", {}).get("law") == "j2":
        reasons += _reasons_on_cap(case, recipes[0], method, tolerance)
    pilots = solve_pilots(recipes, solve, tolerance)
    deviation = largest_deviation(pilots, parts)
    chosen = cheapest(recipes, pilots, tolerance, deviation, capped)
    raw = all(pilot.raw_error <= pilot.error for pilot in pilots)
    hardest = pilots[0].step
    if len(case.load.path) > 1:
        load = f"{case.load.path[hardest]:.4g} Pa, number {hardest + 1} of the path"
        reasons.append(
            f"the plan is for the load of {load}: its area is the hardest to compute"
        )
    is_solved = any(pilot.shape == chosen.shape for pilot in pilots)
    reasons.append(_reason_for_grid(recipes[0], chosen, is_solved, raw))
    reasons.append(_reason_for_surfaces(len(recipes), chosen, deviation))
    if chosen.error > tolerance:
        limit = "the finest grid considered"
        if capped:
            limit = "the case's own grid and surfaces"
        reasons.append(
            f"the tolerance of {tolerance:.2g} is not met: with {limit} the error is "
            f"{chosen.error:.2g}"
        )
    points_of_line = math.prod(recipes[0].shape)
    points_across = math.prod(case.recipes[0].shape) / points_of_line
    work_of_case = estimate_work(pilots, recipes[0].shape) * len(recipes)
    finest = max(pilots, key=lambda pilot: math.prod(pilot.shape))
    numerical = Plan(
        case=case.id,
        tolerance=tolerance,
        parts=tuple(parts),
        method=method,
        areas="raw" if raw else "corrected",
        options=options,
        grid_error=chosen.grid_error,
        scatter=chosen.scatter,
        work=chosen.work,
        given_work=points_across * work_of_case,
        pilot_work=sum(pilot.work for pilot in pilots),
        reasons=tuple(reasons),
        notes=finest.notes,
        recipes=_chosen_recipes(recipes, chosen),
        step=hardest,
    )
    theories = [name for name in case.methods if not METHODS[name].has_fields]
    if theories:
        return _with_theory(case, theories[0], pilots, numerical)
    return numerical


def _method_to_plan(case: Case, parts: Sequence[str]) -> str:
    """Return the cheapest method of a case that a plan can choose a grid for.

    Args:
        case: The case.
        parts: The wanted parts of the area: total, elastic, plastic.

    Raises:
        InvalidCase: The case is skipped, has no such method, or wants a plastic area of
            an elastic body.
    """
    if case.skip:
        raise InvalidCase(f"{case.id}: {case.skip}")
    methods = methods_on_grids(case)
    if not methods:
        raise InvalidCase(
            f"{case.id}: no method on a grid answers it, so it needs no plan"
        )
    is_elastic = math.isinf(case.material.hardness)
    flows = METHODS[methods[0]].has_model_measures  # J2 flow needs no hardness
    if "plastic" in parts and is_elastic and not flows:
        raise InvalidCase(
            f"{case.id}: a body without hardness has no plastic area to plan for"
        )
    return methods[0]


def methods_on_grids(case: Case) -> list[str]:
    """Return the methods of a case whose grid a plan can choose, the cheapest first.

    These are boundary elements ("bem") and finite elements ("fem").  Solvers of the
    user and other codes are left out, because the errors of their areas are not known.
    """
    return [
        name
        for name, method in METHODS.items()
        if name in case.methods and method.plannable
    ]


def _reasons_on_cap(
    case: Case, recipe: Recipe, method: str, tolerance: float
) -> list[str]:
    """Return sentences on whether a pressure cap represents the J2 body of a case.

    Args:
        case: A case whose finite elements flow by J2.
        recipe: One of its surfaces; there are no sentences unless it is self-affine.
        method: Name of the method that the plan is for.
        tolerance: Relative tolerance on the area.
    """
    if not isinstance(recipe, SelfAffine):
        return []
    reasons = []
    if not METHODS[method].has_model_measures and not case.mapped_hardness:
        reasons.append(
            f"the plan is for the body with a cap of {case.material.hardness:.3g} Pa, "
            "not for J2 flow"
        )
    try:
        cap = case.cap_at(recipe.spectrum.rms_slope, max(case.load.path))
    except InvalidScene as error:
        return [*reasons, f"no pressure cap is known for the J2 body: {error}"]
    # The area under a cap grows at most as the inverse of the cap.
    verb = "cannot"
    if cap.error <= tolerance:
        verb = "can"
    reasons.append(
        f"boundary elements with hardness = 'effective', {cap.value:.3g} Pa, {verb} "
        f"represent the J2 body: their area is that of J2 within {cap.error:.2g}, with "
        f"the tolerance at {tolerance:g}; the two contacts overlap by 0.90 to 0.99 in "
        "the cases fem-model"
    )
    return reasons


def _reason_for_grid(
    recipe: Recipe, chosen: Candidate, is_solved: bool, raw: bool
) -> str:
    """Return the sentence on the grid of a plan and its error.

    Args:
        recipe: The surface.
        chosen: The grid.
        is_solved: Whether a pilot was solved on this grid.
        raw: Whether the plan takes raw areas, not corrected ones.
    """
    grid = " x ".join(map(str, chosen.shape)) + " points"
    resolution = points_per_wavelength(on_grid(recipe, chosen.shape) or recipe)
    if not math.isnan(resolution):
        grid += f" ({resolution:.3g} points per shortest wavelength)"
    kind = "corrected areas"
    if raw:
        kind = "raw areas, which are as good as corrected ones"
    origin = "extrapolated from pilot solves"
    if is_solved:
        origin = "as a pilot solve found"
    return f"on {grid} the grid's error of {kind} is {chosen.grid_error:.2g}, {origin}"


def _reason_for_surfaces(given: int, chosen: Candidate, deviation: float) -> str:
    """Return the sentence on the number of surfaces of a plan.

    Args:
        given: Number of surfaces of the case.
        chosen: The grid with the number of surfaces that was chosen.
        deviation: Relative standard deviation between surfaces, an upper 80 % bound.
    """
    if given == 1:
        return "the case has one surface, so the plan is for the area of that surface"
    return (
        f"the mean of {chosen.surfaces} surfaces is within {chosen.scatter:.2g} at "
        f"95 %, because surfaces scatter by at most {deviation:.2g} (80 %)"
    )


def _chosen_recipes(given: Sequence[Recipe], chosen: Candidate) -> tuple[Recipe, ...]:
    """Return the recipes of as many surfaces as a plan needs, on the chosen grid.

    They are the first ones of the case.  If the plan needs more, copies of the first
    one get the seeds after the largest of the case.

    Args:
        given: Recipes of the case.
        chosen: The grid and the number of surfaces.
    """
    recipes = [on_grid(r, chosen.shape) or r for r in given[: chosen.surfaces]]
    seeded = [recipe for recipe in recipes if isinstance(recipe, SelfAffine)]
    if seeded:
        seed = max(recipe.seed for recipe in seeded)
        while len(recipes) < chosen.surfaces:
            seed += 1
            recipes.append(replace(seeded[0], seed=seed))
    return tuple(recipes)


def _with_theory(
    case: Case, method: str, pilots: Sequence[Pilot], numerical: Plan
) -> Plan:
    """Return the plan for the theory, if the theory is accurate enough.

    Otherwise the plan is the numerical one with the reason why the theory is not.

    Args:
        case: The case.
        method: Name of the theory among its methods.
        pilots: The pilots of the numerical method.
        numerical: The plan for the numerical method.
    """
    coarse = on_grid(case.recipes[0], pilots[0].shape) or case.recipes[0]
    scene = case.scene(coarse)
    mapped = _error_by_map(case, method, scene, numerical)
    if mapped is None:
        error, sentence = _error_by_pilots(case, method, scene, pilots, numerical.parts)
    else:
        error, middle = mapped
        offset = f"{middle:.2g} here, and by " if middle else ""
        sentence = (
            f"the theory is off by {offset}at most {error:.2g} at 95 %, by the map of "
            "its error against boundary elements: this"
        )
    if error > numerical.tolerance:
        reason = f"{sentence} exceeds the tolerance, so the theory does not suffice"
        return replace(numerical, reasons=(*numerical.reasons, reason))
    reason = f"{sentence} is within the tolerance, and the theory costs nothing"
    return replace(
        numerical,
        method=method,
        areas="raw",
        options=dict(case.options[method]),
        grid_error=error,
        scatter=0.0,
        work=0.0,
        reasons=(reason,),
    )


def _error_by_map(
    case: Case, method: str, scene: Scene, numerical: Plan
) -> tuple[float, float] | None:
    """Return the relative error of the theory's areas by the map of its errors.

    Args:
        case: The case.
        method: Name of the theory.
        scene: A scene of the case.
        numerical: The plan for the numerical method, which has load and parts.

    Returns:
        Among the wanted parts of the area, the largest bound of a 95 % interval of the
        relative error, and the absolute value of the middle of this interval.  None if
        the map does not contain such a scene.
    """
    # The map is one of this theory on self-affine roughness.
    if method != "persson" or not isinstance(case.recipes[0], SelfAffine):
        return None
    load = scene.load.path[numerical.step]
    try:
        theory = Theory.of_scene(scene, **case.options[method])
        errors = expected_errors(theory, load, len(case.recipes))
    except InvalidScene:
        return None
    if not errors.keys() >= set(numerical.parts):
        return None
    largest = (0.0, 0.0)
    for part in numerical.parts:
        error = errors[part]
        bound = max(-error.low, error.high)
        if bound > largest[0]:
            largest = (bound, abs(error.middle))
    return largest


def _error_by_pilots(
    case: Case, method: str, scene: Scene, pilots: Sequence[Pilot], parts: Sequence[str]
) -> tuple[float, str]:
    """Return the relative error of the theory's areas by its difference from pilots.

    Args:
        case: The case.
        method: Name of the theory.
        scene: A scene of the case.
        pilots: The pilots of the numerical method.
        parts: The wanted parts of the area: total, elastic, plastic.

    Returns:
        The largest relative difference of a part plus the uncertainty of the pilots,
        and the beginning of a sentence that says so.
    """
    result = METHODS[method].solve(scene, case.options[method], 1)
    theory = result.steps[pilots[0].step].areas["raw"]
    sample = on_coarsest_grid(pilots)
    finest = max(pilots, key=lambda pilot: math.prod(pilot.shape))
    difference = 0.0
    for part in parts:
        mean = float(np.mean([getattr(pilot.areas, part) for pilot in sample]))
        # A finer grid is assumed to change all surfaces as it changed the first.
        mean *= getattr(finest.areas, part) / getattr(pilots[0].areas, part)
        difference = max(difference, abs(getattr(theory, part) / mean - 1))
    scatter = student_half_width(largest_deviation(pilots, parts), len(sample))
    uncertainty = math.hypot(finest.error, scatter)
    sentence = (
        f"the theory differs from the pilot solves by {difference:.2g}, and they are "
        f"uncertain by {uncertainty:.2g}: together this"
    )
    return difference + uncertainty, sentence


def planned_case(case: Case, chosen: Plan) -> Case:
    """Return a case with the grid, surfaces and options of the plan `chosen` for it.

    The size of the case becomes "auto".
    """
    options = {method: dict(given) for method, given in case.options.items()}
    if chosen.method in options and chosen.on_grid:
        options[chosen.method] |= chosen.options
    return case.changed(size="auto", recipes=chosen.recipes, options=options)


def finer_case(case: Case, chosen: Plan) -> Case | None:
    """Return the case that checks a plan, with twice the points along each direction.

    The cheapest method on a grid solves it, even if the plan `chosen` has the theory as
    its method.  The case has up to PILOT_SURFACES surfaces of the plan and no gates.
    The result is None if the surfaces have only one grid, as measured ones have.
    """
    recipes = []
    for recipe in chosen.recipes[:PILOT_SURFACES]:
        doubled = on_grid(recipe, tuple(2 * n for n in recipe.shape))
        if doubled is not None:
            recipes.append(doubled)
    if not recipes:
        return None
    return planned_case(case, chosen).changed(
        id=f"{case.id}-finer",
        methods=tuple(methods_on_grids(case)[:1]),
        recipes=tuple(recipes),
        gates=(),
    )


def achieved_error(
    chosen: Plan, results: MethodResults, finer: MethodResults | None = None
) -> float:
    """Return the 95 % error that a planned case achieved, relative, the largest part's.

    It combines, as independent errors, the difference of the mean areas from those of a
    finer grid, the error estimate of the finer grid, and the 95 % interval of the mean
    over the surfaces.  Without a finer grid it rests on the error estimate of the areas
    or, for a theory, on the error that the pilots gave.

    Args:
        chosen: The plan.
        results: The results of the plan's method for `planned_case`.
        finer: The results for `finer_case`.

    Raises:
        InvalidCase: There are no results.
    """
    if not results.results or (finer is not None and not finer.results):
        raise InvalidCase(f"{chosen.case}: there is no answer to judge the plan by")
    if finer is None and not chosen.on_grid:
        return chosen.expected_error
    best = results
    if finer is not None:
        best = finer
    ensemble = best
    if chosen.on_grid:
        ensemble = results

    def areas(of: MethodResults, kind: str, part: str) -> list[float]:
        """Return one area of each surface at the plan's load, over the nominal area.

        `kind` is "raw", "corrected" or "error"; `part` is "total", "elastic" or
        "plastic".
        """
        steps = [result.steps[chosen.step] for result in of.results]
        return [getattr(step.areas[kind], part) for step in steps]

    largest = 0.0
    for part in chosen.parts:
        mean = float(np.mean(areas(best, "corrected", part)))
        difference = 0.0
        if finer is not None:
            planned = areas(results, chosen.areas, part)[: len(best.results)]
            difference = float(np.mean(planned)) / mean - 1
        estimate = float(np.mean(areas(best, "error", part))) / mean
        estimate *= factor_to_95("grid")
        values = areas(ensemble, "corrected", part)
        scatter = student_half_width(standard_deviation(values) / mean, len(values))
        largest = max(largest, math.hypot(difference, estimate, scatter))
    return largest


def load_auto(text: CaseText) -> tuple[Case, str]:
    """Load a case at size "auto": with the cheapest grid that its gates allow.

    The case is loaded at its largest size, but at "large" only if it has no other, and
    is given to `auto_case` unless it is skipped.

    Returns:
        The case, and the sentence of `auto_case`; empty for a skipped case.

    Raises:
        InvalidCase: The case file has a mistake.
    """
    sizes = [size for size in text.sizes if size != "large"] or ["large"]
    case = load_case(text, sizes[-1])
    if case.skip:
        return case, ""
    return auto_case(case)


def auto_case(case: Case, *, threads: int | None = None) -> tuple[Case, str]:
    """Make a case cheaper if its gates allow.

    The grid is chosen so that the error of corrected areas is a third of the narrowest
    band on them.  A case stays as it is if a gate reads anything else that depends on
    the grid (fields, raw areas, distributions, gaps), or if it has finite elements
    beside boundary elements.

    Args:
        case: The case.
        threads: Number of threads of the pilots; None: all cores.

    Returns:
        The case, which costs no more than the given one, and a sentence that says what
        was done.
    """
    unchanged = case.changed(size="auto")
    for gate in case.gates:
        if not _is_plannable(gate):
            return unchanged, f"{case.id}: its gate on {gate.name} asks for its grid"
    corrected = [gate for gate in case.gates if _CORRECTED.fullmatch(gate.quantity)]
    if not corrected or len(methods_on_grids(case)) > 1:
        return unchanged, f"{case.id}: unchanged"
    half_width = min(gate.high - gate.low for gate in corrected) / 2
    tolerance = min(half_width / 3, 0.5)
    parts = sorted({gate.quantity.split(".")[1] for gate in corrected})
    try:
        chosen = plan(case, tolerance, parts=parts, threads=threads, capped=True)
    except EpcontactError as error:
        return unchanged, f"{case.id}: unchanged, because {error}"
    if not chosen.on_grid or not chosen.meets or chosen.work > chosen.given_work:
        return unchanged, f"{case.id}: unchanged; {chosen.reasons[-1]}"
    return planned_case(case, chosen), f"{case.id}: {'; '.join(chosen.reasons)}"


#: Names of the quantities of gates that are corrected areas.
_CORRECTED = re.compile(r"area\.(total|elastic|plastic)\.corrected")


def _is_plannable(gate: Gate) -> bool:
    """Return whether a gate depends on the grid only through corrected areas.

    Corrected areas are those in the limit of a vanishing grid spacing.  Gates on
    methods without a grid, on residuals, on counts of iterations and on the identities
    that are measured on a result (`quantity.measured_...`) do not depend on the grid.
    The exception is the identity `measured_carried`, which compares corrected areas
    with the load that the pressures carry.
    """
    if not METHODS[gate.of].has_fields or _CORRECTED.fullmatch(gate.quantity):
        return True
    independent = ("residual.", "iterations.", "quantity.measured_")
    carried = gate.quantity.endswith("carried")
    return gate.quantity.startswith(independent) and not carried
