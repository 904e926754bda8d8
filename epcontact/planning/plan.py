"""The cheapest model that meets a tolerance on the contact area, and why it is that one.

What is asked: the area, relative, at 95 % confidence.  What is chosen: theory, boundary elements
or finite elements; a line where the roughness has one direction; the grid; raw or corrected
areas; the number of surfaces; and for finite elements depth and load steps.  How: cheap pilots
(`pilots`) give the error e of each grid and the scatter s between surfaces; of all grids with
e < tolerance the one is taken for which grid cost times the number n of surfaces is least,

    e^2 + (t s / sqrt(n))^2 <= tolerance^2,

t being Student's 97.5 % quantile.  s is the upper 80 % bound of what few pilots can say.  A
case that names one surface asks for that surface's area: n = 1, no scatter.

The theory is chosen where it lies so near to the pilots' mean that difference and uncertainty
together stay within the tolerance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from epcontact.errors import InvalidCase
from epcontact.harness.case import Case
from epcontact.harness.statistics import student_half_width
from epcontact.planning.candidates import (
    Candidate,
    Setup,
    candidates_for,
    cheapest,
    climb,
    coarsest,
    deviation_of,
    finite_element_options,
    sample_surfaces,
)
from epcontact.planning.pilots import (
    Pilot,
    Section,
    carried_cost,
    on_grid,
    one_directional,
    points_per_wavelength,
    worst,
)
from epcontact.surfaces import Recipe, SelfAffine

if TYPE_CHECKING:
    from epcontact.harness.store import Answer


@dataclass(frozen=True)
class Plan:
    """What was chosen, what it should cost, and why.

    method: "persson", "bem" or "fem"; dimension: 1 for a line, 2 for a surface; shape: of the
    grid; points_per_wavelength: of self-affine roughness, else NaN; areas: "raw" or "corrected";
    surfaces: how many; seeds: theirs, where they are random; options: of the method.
    expected_error: relative, of the parts' areas at 95 %; grid_error, scatter: what it consists
    of; meets: whether that is within the tolerance.
    work: FFT pairs (or solver sweeps) times points of the chosen model; given_work: of the case
    as it stands; pilot_work: of the pilots; seconds, pilot_seconds: the same as times.
    """

    case: str
    tolerance: float
    parts: tuple[str, ...]
    method: str
    dimension: int
    shape: tuple[int, ...]
    points_per_wavelength: float
    areas: str
    surfaces: int
    seeds: tuple[int, ...]
    options: dict[str, Any]
    expected_error: float
    grid_error: float
    scatter: float
    work: float
    given_work: float
    pilot_work: float
    seconds: float
    pilot_seconds: float
    reasons: tuple[str, ...]
    recipes: tuple[Recipe, ...] = field(repr=False, default=())

    @property
    def meets(self) -> bool:
        """Whether the expected error is within the tolerance."""
        return self.expected_error <= self.tolerance


@dataclass(frozen=True)
class Promise:
    """Whether an answer kept the plan's promise: its error, relative, and a sentence."""

    held: bool
    error: float
    sentence: str


def plan(
    case: Case,
    tolerance: float = 0.01,
    *,
    parts: Sequence[str] = ("total",),
    threads: int | None = None,
    capped: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Plan:
    """Choose the cheapest model of a case whose areas are within `tolerance` (relative, 95 %).

    parts: of the area that must be: total, elastic, plastic.  capped: never a finer grid or more
    surfaces than the case has, even if the tolerance is then missed (`Plan.meets` says so).

    Raises InvalidCase for a tolerance out of range or a case without contact to plan, and what
    the pilots raise.
    """
    if not 0 < tolerance < 1:
        raise InvalidCase(f"tolerance is {tolerance!r}, but must lie between 0 and 1")
    if case.skip or not {"bem", "fem"} & set(case.methods):
        raise InvalidCase(
            f"{case.id}: {case.skip or 'only the theory answers it, and needs no plan'}"
        )
    method = "bem" if "bem" in case.methods else "fem"
    recipes, why = _dimension(case)
    tell = progress or (lambda _: None)
    setup = Setup(case, method, recipes, {}, tolerance, tuple(parts), threads, tell)
    if method == "fem":
        options, told = finite_element_options(setup)
        setup, why = replace(setup, options=options), why + told
    pilots = climb(setup) + sample_surfaces(setup)
    chosen = cheapest(candidates_for(setup, pilots, capped), tolerance)
    why += _why(setup, pilots, chosen, capped)
    result = _assemble(setup, pilots, chosen, tuple(why))
    return _theory_instead(setup, pilots, result) if "persson" in case.methods else result


def _dimension(case: Case) -> tuple[tuple[Recipe, ...], list[str]]:
    axis = one_directional(case.recipes[0])
    if axis is None:
        return case.recipes, []
    sentence = f"all roughness runs along {'xy'[axis]}: a line stands for the surface"
    return tuple(Section(recipe, axis) for recipe in case.recipes), [sentence]


def _why(setup: Setup, pilots: Sequence[Pilot], chosen: Candidate, capped: bool) -> list[str]:
    resolution = points_per_wavelength(on_grid(setup.recipes[0], chosen.shape) or setup.recipes[0])
    fine = "" if math.isnan(resolution) else f" ({resolution:.3g} points per shortest wavelength)"
    how = "said by a pilot" if chosen.shape in [p.shape for p in pilots] else "carried from pilots"
    grid = " x ".join(map(str, chosen.shape))
    kind = "raw areas are as good as corrected ones" if chosen.raw else "corrected areas"
    why = [f"on {grid} points{fine} the grid's error is {chosen.grid_error:.2g}, {how}; {kind}"]
    if len(setup.recipes) > 1:
        deviation = max(deviation_of(pilots, part) for part in setup.parts)
        why.append(
            f"{chosen.surfaces} surfaces, which scatter by {deviation:.2g} at the most (80 %), "
            f"leave {chosen.scatter:.2g} at 95 %"
        )
    else:
        why.append("the case names one surface, so that it is its own area that is asked for")
    if chosen.error > setup.tolerance:
        limit = "the case's own grid and surfaces" if capped else "the finest grid considered"
        why.append(
            f"the tolerance of {setup.tolerance:.2g} is not met: with {limit} "
            f"{chosen.error:.2g} is left"
        )
    return why


def _assemble(
    setup: Setup, pilots: Sequence[Pilot], chosen: Candidate, why: tuple[str, ...]
) -> Plan:
    own, case = setup.recipes[0], setup.case
    recipes = _chosen_recipes(setup.recipes, chosen)
    across = math.prod(case.recipes[0].shape) / math.prod(own.shape)  # more than 1 of a line
    return Plan(
        case=case.id,
        tolerance=setup.tolerance,
        parts=setup.parts,
        method=setup.method,
        dimension=len(chosen.shape),
        shape=chosen.shape,
        points_per_wavelength=points_per_wavelength(recipes[0]),
        areas="raw" if chosen.raw else "corrected",
        surfaces=chosen.surfaces,
        seeds=tuple(r.seed for r in recipes if isinstance(r, SelfAffine)),
        options=setup.options,
        expected_error=chosen.error,
        grid_error=chosen.grid_error,
        scatter=chosen.scatter,
        work=chosen.work,
        given_work=carried_cost(pilots, own.shape)[0] * across * len(case.recipes),
        pilot_work=sum(p.work for p in pilots),
        seconds=chosen.seconds,
        pilot_seconds=sum(p.seconds for p in pilots),
        reasons=why,
        recipes=recipes,
    )


def _chosen_recipes(given: Sequence[Recipe], chosen: Candidate) -> tuple[Recipe, ...]:
    """The first surfaces of the case on the chosen grid, and more of their kind if need be."""
    recipes = [on_grid(r, chosen.shape) or r for r in given[: chosen.surfaces]]
    seeded = [r for r in recipes if isinstance(r, SelfAffine)]
    fresh = max((r.seed for r in seeded), default=0) + 1
    while seeded and len(recipes) < chosen.surfaces:
        recipes.append(replace(seeded[0], seed=fresh))
        fresh += 1
    return tuple(recipes)


def _theory_instead(setup: Setup, pilots: Sequence[Pilot], found: Plan) -> Plan:
    """The plan with the theory in it, where that is near enough to the pilots."""
    from epcontact import persson

    case, parts = setup.case, setup.parts
    scene = case.scene(on_grid(case.recipes[0], pilots[0].shape) or case.recipes[0])
    theory = persson.solve(scene, **case.options["persson"]).final.areas["raw"]
    sample, finest = coarsest(pilots), max(pilots, key=lambda p: math.prod(p.shape))
    off = []
    for part in parts:
        mean = float(np.mean([getattr(p.areas, part) for p in sample]))
        # What the finer grid changed on the first surface, it would on all.
        mean *= getattr(finest.areas, part) / getattr(pilots[0].areas, part)
        off.append(abs(getattr(theory, part) / mean - 1))
    deviation = max(deviation_of(pilots, part) for part in parts)
    scatter = student_half_width(deviation, len(sample)) if len(sample) > 1 else 0.0
    doubt = math.hypot(worst(finest.errors, parts), scatter)
    told = (
        f"the theory lies {max(off):.2g} from the pilots, which are uncertain by {doubt:.2g} "
        "themselves"
    )
    if max(off) + doubt > setup.tolerance:
        return replace(found, reasons=(*found.reasons, f"{told}: too far to stand in"))
    return replace(
        found,
        method="persson",
        areas="raw",
        surfaces=1,
        options=dict(case.options["persson"]),
        expected_error=max(off) + doubt,
        grid_error=0.0,
        scatter=0.0,
        work=0.0,
        seconds=1e-3,
        reasons=(f"{told}: within the tolerance, and for nothing",),
    )


def planned_case(case: Case, chosen: Plan) -> Case:
    """The case with the plan's grid, surfaces and options, of size "auto"; gates as they are."""
    options = {m: dict(given) for m, given in case.options.items()}
    if chosen.method in options and chosen.method != "persson":
        options[chosen.method] |= chosen.options
    return replace(case, size="auto", recipes=chosen.recipes, options=options)


def promise_held(chosen: Plan, answer: Answer) -> Promise:
    """Hold the answer that a plan was carried out with against its tolerance.

    The error is what the areas claim of themselves and the 95 % interval of their mean.  The
    theory's answer says nothing of its own error: there the pilots' word stands.
    """
    if not answer.results:
        raise InvalidCase(f"{chosen.case}: there is no answer to hold the plan against")
    if chosen.method == "persson":
        error = chosen.expected_error
    else:
        error = max(_achieved(answer, part) for part in chosen.parts)
    held = error <= chosen.tolerance
    verdict = "held" if held else "was broken"
    return Promise(
        held,
        error,
        f"{chosen.case}: the promise {verdict}: error {error:.2g}, {chosen.expected_error:.2g} "
        f"expected, {chosen.tolerance:.2g} allowed",
    )


def _achieved(answer: Answer, part: str) -> float:
    found = [r.final.areas for r in answer.results]
    values = np.array([getattr(a["corrected"], part) for a in found])
    claimed = float(np.mean([getattr(a["error"], part) for a in found])) / float(values.mean())
    if values.size < 2:
        return claimed
    return math.hypot(
        claimed, student_half_width(float(values.std(ddof=1) / values.mean()), values.size)
    )
