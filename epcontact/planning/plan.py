"""The cheapest model that meets a tolerance on the contact area, and the reasons for
it.

The plan chooses the method (theory, boundary or finite elements), a line if the
roughness has one direction, the grid, raw or corrected areas, the number of surfaces
and, for finite elements, depth and load increments.  The tolerance is on the area,
relative, at 95 % confidence.  Cheap pilots (`pilots`) give the error e of each grid and
the scatter s between surfaces.  Of all grids with e < tolerance the plan takes the one
with the least cost times number n of surfaces, where

    e^2 + (t s / sqrt(n))^2 <= tolerance^2,

with Student's 97.5 % quantile t.  s is an upper 80 % bound, because the pilots are few.
A case with one surface asks for the area of that surface, so n = 1 and there is no
scatter.

The theory is chosen if its error by the map of `persson.validity` is within the
tolerance or, where that map does not reach, its difference from the pilots' mean and
their uncertainty together.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from epcontact.errors import EpcontactError, InvalidCase, InvalidScene
from epcontact.harness.answers.store import Answer
from epcontact.harness.case_files.case import Case, CaseText, load_case
from epcontact.harness.gates import Gate, standard_deviation, student_half_width
from epcontact.harness.methods.registry import METHODS
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
    carried_work,
    cheapest,
    climb,
    coarsest,
    deviation_of,
    finite_element_options,
    solve_pilot,
)
from epcontact.scene import Scene
from epcontact.surfaces import Recipe, SelfAffine


@dataclass(frozen=True)
class Plan:
    """A chosen model, its expected error and cost, and the reasons."""

    case: str  # its id
    tolerance: float  # on the areas of the parts, relative
    parts: tuple[str, ...]  # of the area, that must be within it
    method: str
    areas: str  # "raw" or "corrected"
    options: dict[str, Any]  # of the method
    grid_error: float  # relative; of the theory, its distance from the pilots and their uncertainty
    scatter: (
        float  # half-width of the 95 % interval of the mean over the surfaces, relative
    )
    work: float  # FFT pairs (or solver sweeps) times points of the chosen model
    given_work: float  # of the given case
    pilot_work: float
    reasons: tuple[str, ...]  # sentences
    notes: tuple[str, ...]  # of the surface that the finest pilot solved
    recipes: tuple[Recipe, ...] = field(
        repr=False
    )  # of the surfaces on the chosen grid
    step: int = (
        -1
    )  # number of the load that is the hardest to answer, which the plan is for

    @property
    def shape(self) -> tuple[int, ...]:
        """The grid; a single number if a line stands for the surface."""
        return self.recipes[0].shape

    @property
    def surfaces(self) -> int:
        """The number of surfaces that are solved; the theory needs one spectrum."""
        return len(self.recipes) if self.on_grid else 1

    @property
    def on_grid(self) -> bool:
        """True unless a theory answers without a grid."""
        return METHODS[self.method].has_fields

    @property
    def expected_error(self) -> float:
        """Relative error of the areas at 95 % confidence."""
        return math.hypot(self.grid_error, self.scatter)

    @property
    def meets(self) -> bool:
        """True if the expected error is within the tolerance."""
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
    """Choose the cheapest model of a case whose areas are within the tolerance.

    Args:
        case: a case with boundary or finite elements among its methods.
        tolerance: tolerance on the areas, relative, at 95 % confidence.
        parts: the parts of the area that must be within it: total, elastic, plastic.
        threads: number of threads of the pilots; None: all cores.
        capped: if True, the grid is no finer and the surfaces no more than those of the
            case, even if the plan then misses the tolerance (see `Plan.meets`).
        progress: called with a sentence before each pilot.

    Raises:
        InvalidCase: the tolerance is out of range, or no pilot can answer the case.
        EpcontactError: a pilot fails.
    """
    if not 0 < tolerance < 1:
        raise InvalidCase(f"tolerance is {tolerance!r}, but must lie between 0 and 1")
    if case.skip or not (methods := methods_on_grids(case)):
        raise InvalidCase(
            f"{case.id}: {case.skip or 'no method on a grid answers it, so it needs no plan'}"
        )
    if (
        "plastic" in parts
        and math.isinf(case.material.hardness)
        and methods[0] != "fem"
    ):
        raise InvalidCase(
            f"{case.id}: a body without hardness has no plastic area to plan for"
        )
    method, recipes, why = methods[0], case.recipes, []
    if (axis := one_directional(recipes[0])) is not None:
        recipes = tuple(Section(recipe, axis) for recipe in recipes)
        why = [f"all roughness runs along {'xy'[axis]}: a line stands for the surface"]

    def solve(recipe: Recipe, **options: Any) -> Pilot:
        if progress is not None:
            progress(
                f"plan: pilot by {method} on {' x '.join(map(str, recipe.shape))} points"
            )
        found = solve_pilot(case, recipe, method, parts, threads, steps[-1], **options)
        steps.append(found.step)
        return found

    # Gates, which an automatic size is for, read the last load; a single load is the
    # last one.
    steps: list[int | None] = [-1 if capped or len(case.load.path) == 1 else None]
    options: dict[str, Any] = {}
    if method == "fem":
        options, reasons = finite_element_options(case, recipes[0], solve, tolerance)
        why += reasons
    if case.options.get("fem", {}).get("law") == "j2" and isinstance(
        recipes[0], SelfAffine
    ):
        if method != "fem" and not case.mapped_hardness:
            cap = case.material.hardness
            why.append(
                f"the plan is for the body with a cap of {cap:.3g} Pa, not for J2 flow"
            )
        why.append(_cap_instead(case, recipes[0].spectrum.rms_slope, tolerance))
    pilots = climb(recipes, partial(solve, **options), tolerance)
    deviation = deviation_of(pilots, parts)
    chosen = cheapest(recipes, pilots, tolerance, deviation, capped)
    raw = all(pilot.raw_error <= pilot.error for pilot in pilots)
    limit = (
        "the case's own grid and surfaces" if capped else "the finest grid considered"
    )
    missed = f"the tolerance of {tolerance:.2g} is not met: with {limit} the error is {chosen.error:.2g}"
    if len(case.load.path) > 1:
        step = pilots[0].step
        hardest = f"{case.load.path[step]:.4g} Pa, number {step + 1} of the path"
        why.append(
            f"the plan is for the load of {hardest}: its area is the hardest to find"
        )
    solved = chosen.shape in [pilot.shape for pilot in pilots]
    why += _reasons(recipes[0], len(recipes) > 1, chosen, solved, raw, deviation)
    across = math.prod(case.recipes[0].shape) / math.prod(
        recipes[0].shape
    )  # above 1 for a line
    result = Plan(
        case=case.id,
        tolerance=tolerance,
        parts=tuple(parts),
        method=method,
        areas="raw" if raw else "corrected",
        options=options,
        grid_error=chosen.grid_error,
        scatter=chosen.scatter,
        work=chosen.work,
        given_work=carried_work(pilots, recipes[0].shape) * across * len(recipes),
        pilot_work=sum(pilot.work for pilot in pilots),
        reasons=(*why, missed) if chosen.error > tolerance else tuple(why),
        notes=max(pilots, key=lambda pilot: math.prod(pilot.shape)).notes,
        recipes=_chosen_recipes(recipes, chosen),
        step=pilots[0].step,
    )
    theories = [m for m in case.methods if not METHODS[m].has_fields]
    return _theory_instead(case, theories[0], pilots, result) if theories else result


def methods_on_grids(case: Case) -> list[str]:
    """Return the case's methods that a grid makes exact, the cheapest first, as METHODS
    has them. Solvers of the user's are left out: their claimed errors are not known.
    """
    return [
        m for m, method in METHODS.items() if m in case.methods and method.plannable
    ]


def _cap_instead(case: Case, rms_slope: float, tolerance: float) -> str:
    """The sentence that says whether a pressure cap can stand for the J2 body of a
    case.
    """
    try:
        found = case.cap_at(rms_slope, max(case.load.path))
    except InvalidScene as error:
        return f"no pressure cap is known to stand for the J2 body: {error}"
    can = "can" if found.error <= tolerance else "cannot"
    # The area under a cap grows at most as the inverse of the cap.
    return (
        f"boundary elements with hardness = 'effective', {found.value:.3g} Pa, {can} stand for the "
        f"J2 body: their area is that of J2 within {found.error:.2g}, with the tolerance at "
        f"{tolerance:g}; the two contacts overlap by 0.90 to 0.99 in the cases fem-model"
    )


def _reasons(
    first: Recipe,
    several: bool,
    chosen: Candidate,
    solved: bool,
    raw: bool,
    deviation: float,
) -> list[str]:
    """Return the reasons for a grid and a number of surfaces."""
    resolution = points_per_wavelength(on_grid(first, chosen.shape) or first)
    fine = (
        ""
        if math.isnan(resolution)
        else f" ({resolution:.3g} points per shortest wavelength)"
    )
    how = "as a pilot solve found" if solved else "extrapolated from pilot solves"
    grid = " x ".join(map(str, chosen.shape))
    kind = (
        "raw areas, which are as good as corrected ones" if raw else "corrected areas"
    )
    why = [
        f"on {grid} points{fine} the grid's error of {kind} is {chosen.grid_error:.2g}, {how}"
    ]
    if not several:
        return [
            *why,
            "the case has one surface, so the plan is for the area of that surface",
        ]
    return [
        *why,
        f"the mean of {chosen.surfaces} surfaces is within {chosen.scatter:.2g} at 95 %, as a "
        f"surface scatters by at most {deviation:.2g} (80 %)",
    ]


def _chosen_recipes(given: Sequence[Recipe], chosen: Candidate) -> tuple[Recipe, ...]:
    """Return the case's first surfaces on the chosen grid, and new ones if it has too
    few.
    """
    recipes = [on_grid(r, chosen.shape) or r for r in given[: chosen.surfaces]]
    seeded = [r for r in recipes if isinstance(r, SelfAffine)]
    fresh = max((r.seed for r in seeded), default=0) + 1
    more = range(fresh, fresh + chosen.surfaces - len(recipes)) if seeded else ()
    return (*recipes, *(replace(seeded[0], seed=seed) for seed in more))


def _theory_instead(
    case: Case, method: str, pilots: Sequence[Pilot], numerical: Plan
) -> Plan:
    """Return the plan with the theory as its method if that is close enough to the
    pilots.
    """
    scene = case.scene(on_grid(case.recipes[0], pilots[0].shape) or case.recipes[0])
    if known := _mapped_error(case, method, scene, numerical):
        error, middle = known
        distance = (
            f"the theory is off by {f'{middle:.2g} here, and by ' if middle else ''}at most "
            f"{error:.2g} at 95 %, by the map of its error against boundary elements: this"
        )
    else:
        error, distance = _off_the_pilots(case, method, scene, pilots, numerical.parts)
    if error > numerical.tolerance:
        why = f"{distance} exceeds the tolerance, so the theory will not do"
        return replace(numerical, reasons=(*numerical.reasons, why))
    return replace(
        numerical,
        method=method,
        areas="raw",
        options=dict(case.options[method]),
        grid_error=error,
        scatter=0.0,
        work=0.0,
        reasons=(f"{distance} is within the tolerance, and the theory costs nothing",),
    )


def _mapped_error(
    case: Case, method: str, scene: Scene, numerical: Plan
) -> tuple[float, float] | None:
    """Return the largest relative error of the theory's areas and its middle, if a map
    knows it.
    """
    if method != "persson" or not isinstance(case.recipes[0], SelfAffine):
        return None
    try:
        theory = Theory.of_scene(scene, **case.options[method])
        known = expected_errors(
            theory, scene.load.path[numerical.step], len(case.recipes)
        )
    except InvalidScene:
        return None
    if not known.keys() >= set(numerical.parts):
        return None
    found = (known[part] for part in numerical.parts)
    worst = max(found, key=lambda error: max(-error.low, error.high))
    return max(-worst.low, worst.high), abs(worst.middle)


def _off_the_pilots(
    case: Case, method: str, scene: Scene, pilots: Sequence[Pilot], parts: Sequence[str]
) -> tuple[float, str]:
    """Return how far the theory is off the pilots, with their uncertainty, and a
    sentence on it.
    """
    steps = METHODS[method].solve(scene, case.options[method], 1).steps
    theory = steps[pilots[0].step].areas["raw"]
    sample, finest = coarsest(pilots), max(pilots, key=lambda p: math.prod(p.shape))
    off = []
    for part in parts:
        mean = float(np.mean([getattr(p.areas, part) for p in sample]))
        # A finer grid is assumed to change all surfaces as it changed the first.
        mean *= getattr(finest.areas, part) / getattr(pilots[0].areas, part)
        off.append(abs(getattr(theory, part) / mean - 1))
    doubt = math.hypot(
        finest.error, student_half_width(deviation_of(pilots, parts), len(sample))
    )
    differs = f"the theory differs from the pilot solves by {max(off):.2g}"
    return max(
        off
    ) + doubt, f"{differs}, and they are uncertain by {doubt:.2g}: together this"


def planned_case(case: Case, chosen: Plan) -> Case:
    """Return the case with the plan's grid, surfaces and options, as size "auto"."""
    options = {m: dict(given) for m, given in case.options.items()}
    if chosen.method in options and chosen.on_grid:
        options[chosen.method] |= chosen.options
    return case.changed(size="auto", recipes=chosen.recipes, options=options)


def finer_case(case: Case, chosen: Plan) -> Case | None:
    """Return the case that checks a plan: its first surfaces on twice the points each
    way.

    A method on a grid answers it, of a theory's plan, too.  Heights that have but one
    grid, such as measured ones, leave nothing to check by: None.
    """
    doubled = (
        on_grid(r, tuple(2 * n for n in r.shape))
        for r in chosen.recipes[:PILOT_SURFACES]
    )
    recipes = tuple(r for r in doubled if r is not None)
    if not recipes:
        return None
    planned = planned_case(case, chosen)
    methods = tuple(methods_on_grids(case)[:1])
    return planned.changed(
        id=f"{case.id}-finer", methods=methods, recipes=recipes, gates=()
    )


def achieved_error(chosen: Plan, answer: Answer, finer: Answer | None = None) -> float:
    """Return the relative error of the answer to a planned case, the largest of its
    parts.

    It combines, as independent errors, the difference of the mean areas from those of a
    finer grid, the error that the finer grid still claims, and the 95 % interval of the
    mean over the surfaces. Without a finer grid it rests on the error that the areas
    claim themselves or, for a theory, that the pilots expected.

    Args:
        chosen: the plan.
        answer: the answer of the plan's method to `planned_case`.
        finer: the answer to `finer_case`.

    Raises:
        InvalidCase: an answer has no results.
    """
    if not answer.results or (finer is not None and not finer.results):
        raise InvalidCase(f"{chosen.case}: there is no answer to judge the plan by")
    if finer is None and not chosen.on_grid:
        return chosen.expected_error
    best = answer if finer is None else finer
    sample = answer if chosen.on_grid else best

    def areas(of: Answer, kind: str, part: str) -> list[float]:
        return [getattr(r.steps[chosen.step].areas[kind], part) for r in of.results]

    errors = []
    for part in chosen.parts:
        found = areas(answer, chosen.areas, part)[: len(best.results)]
        mean = float(np.mean(areas(best, "corrected", part)))
        off = float(np.mean(found)) / mean - 1 if finer is not None else 0.0
        claimed = float(np.mean(areas(best, "error", part))) / mean
        values = areas(sample, "corrected", part)
        scatter = student_half_width(standard_deviation(values) / mean, len(values))
        errors.append(math.hypot(off, claimed, scatter))
    return max(errors)


def load_auto(text: CaseText) -> tuple[Case, str]:
    """Load a case at its full or only size and make it cheaper by `auto_case`, if not
    skipped.
    """
    sizes = [size for size in text.sizes if size != "large"]
    given = load_case(text, (sizes or ["large"])[-1])
    return (given, "") if given.skip else auto_case(given)


def auto_case(case: Case, *, threads: int | None = None) -> tuple[Case, str]:
    """Make a case cheaper if its gates allow.

    Grids are chosen by the errors of corrected areas, to a third of the narrowest band
    on them.  A case stays as it is if a gate reads anything else that depends on the
    grid (fields, raw areas, distributions, gaps), or if it has finite elements beside
    boundary elements.

    Args:
        case: the case.
        threads: number of threads of the pilots; None: all cores.

    Returns:
        The case, never dearer than the given one, and a sentence that says what was
        done.
    """
    unchanged = case.changed(size="auto")
    blocking = [g.name for g in case.gates if not _plannable(g)]
    corrected = [g for g in case.gates if _CORRECTED.fullmatch(g.quantity)]
    if blocking or not corrected or len(methods_on_grids(case)) > 1:
        reason = (
            f"its gate on {blocking[0]} asks for its grid" if blocking else "unchanged"
        )
        return unchanged, f"{case.id}: {reason}"
    wanted = min(g.high - g.low for g in corrected) / 2 / 3
    parts = sorted({g.quantity.split(".")[1] for g in corrected})
    try:
        chosen = plan(case, min(wanted, 0.5), parts=parts, threads=threads, capped=True)
    except EpcontactError as error:
        return unchanged, f"{case.id}: unchanged, because {error}"
    if not chosen.on_grid or not chosen.meets or chosen.work > chosen.given_work:
        return unchanged, f"{case.id}: unchanged; {chosen.reasons[-1]}"
    return planned_case(case, chosen), f"{case.id}: {'; '.join(chosen.reasons)}"


_CORRECTED = re.compile(r"area\.(total|elastic|plastic)\.corrected")


def _plannable(gate: Gate) -> bool:
    """True if a gate depends on the grid only through corrected areas, or not at
    all.
    """
    free = ("residual.", "iterations.", "quantity.measured_")
    return (
        not METHODS[gate.of].has_fields
        or bool(_CORRECTED.fullmatch(gate.quantity))
        or (gate.quantity.startswith(free) and not gate.quantity.endswith("carried"))
    )
