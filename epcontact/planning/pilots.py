"""Pilots: cheap solves that estimate the error and cost of every candidate grid.

The coarsest grids of the ladder are solved.  The relative error that their areas claim
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
from epcontact.results import Areas
from epcontact.surfaces import Recipe
from fem_check.mesh import half_space_depth

MOST_SURFACES = 1000
PILOT_SURFACES = 8
#: Largest work of all pilots together, as a share of the work of the given case.
PILOT_SHARE = 0.2
#: Increments that are tried on a plastic body; the last are the reference of the
#: others.
STEPS = (5, 10, 20, 80)

#: A function that solves one recipe; further keywords are options of the method.
Solver = Callable[..., "Pilot"]


class Pilot(NamedTuple):
    """One solve of one surface."""

    shape: tuple[int, ...]
    areas: Areas
    error: float  # the largest relative one of the parts wanted
    raw_error: float  # the same of raw areas
    work: float  # FFT pairs, or sweeps over the unknowns, times points
    notes: tuple[str, ...] = ()
    step: int = -1  # number of the load whose areas these are


class Candidate(NamedTuple):
    """A grid with the number of surfaces it needs, its relative errors and the cost of
    all.
    """

    shape: tuple[int, ...]
    surfaces: int
    grid_error: float
    scatter: float
    work: float

    @property
    def error(self) -> float:
        """The combined error of grid and scatter."""
        return math.hypot(self.grid_error, self.scatter)


#: Options of a quick solve, which only has to show the areas.
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
    """Solve the case on one surface roughly; None: the step whose area is the hardest
    to find.
    """
    given = _QUICK.get(method, {}) | dict(case.options.get(method, {})) | options
    scene = case.scene(recipe)
    result = METHODS[method].solve(scene, given, threads or available_cores())
    if step is None:
        claims = [
            one.areas["error"].total / (one.areas["corrected"].total or math.inf)
            for one in result.steps
        ]
        step = int(np.argmax(claims))
    areas, counts = result.steps[step].areas, result.final.iterations
    best, errors, raw_errors = areas["corrected"], [math.nan], [math.nan]
    for part in parts:
        if area := getattr(
            best, part
        ):  # a part that does not exist has no relative error
            errors.append(getattr(areas["error"], part) / area)
            raw_errors.append(
                abs(getattr(areas["raw"], part) - area) / area + errors[-1]
            )
    sweeps = result.cost.get("equivalent_fft_pairs") or sum(
        counts.get(name, 0) for name in ("cg", "newton", "sweeps")
    )
    largest, raw = float(np.fmax.reduce(errors)), float(np.fmax.reduce(raw_errors))
    work = sweeps * result.cost["unknowns"]
    return Pilot(recipe.shape, best, largest, raw, work, scene.surface.notes, step)


def carried_error(pilots: Sequence[Pilot], shape: tuple[int, ...]) -> float:
    """Return the relative error on a grid: its own, or by the order of the two finest
    solved ones. That order is between 1 and 2: a rim's random position has the order 1,
    its curvature 2.
    """
    level: dict[tuple[int, ...], float] = {}
    for pilot in pilots:
        level[pilot.shape] = max(level.get(pilot.shape, 0.0), pilot.error)
    if shape in level:
        return level[shape]
    finest, *coarser = sorted(level, key=math.prod, reverse=True)
    order = 1.0
    if coarser and level[finest] > 0 and level[coarser[0]] > 0:
        order = math.log(level[coarser[0]] / level[finest]) / math.log(
            finest[0] / coarser[0][0]
        )
    return level[finest] * math.pow(finest[0] / shape[0], min(max(order, 1.0), 2.0))


def carried_work(pilots: Sequence[Pilot], shape: tuple[int, ...]) -> float:
    """Return the work of a solve on a grid, scaled by points from the finest solved
    grid.
    """
    finest = max((p.shape for p in pilots), key=math.prod)
    base = [p for p in pilots if p.shape == shape] or [
        p for p in pilots if p.shape == finest
    ]
    ratio = math.prod(shape) / math.prod(base[0].shape)
    return float(np.mean([p.work for p in base])) * ratio


def finite_element_options(
    case: Case, recipe: Recipe, solve: Solver, tolerance: float
) -> tuple[dict[str, Any], list[str]]:
    """Choose increments by pilots and depth by compliance, to a quarter each, and say
    why.
    """
    options: dict[str, Any] = {}
    why = []
    share = tolerance / 4
    if case.body.kind == "half_space" and "depth" not in case.options["fem"]:
        longest = max(case.recipes[0].periods)
        options["depth"] = half_space_depth(longest, case.material.poisson_ratio, share)
        why.append(
            f"a block {options['depth']:.3g} m deep answers the longest wave within {share:.1g} "
            "of the half-space; its layers grow from the grid spacing as fast as the waves allow"
        )
    if case.options["fem"].get("law") == "j2":
        coarse = on_grid(recipe, ladder(recipe, beyond=False)[0]) or recipe
        *tried, best = [
            solve(coarse, steps=count, **options).areas.total for count in STEPS
        ]
        off = {s: abs(area / best - 1) for s, area in zip(STEPS, tried, strict=False)}
        options["steps"] = min(
            (s for s, error in off.items() if error <= share), default=STEPS[-1]
        )
        changes = ", ".join(f"{error:.1g} with {count}" for count, error in off.items())
        why.append(
            f"{options['steps']} increments: on the coarsest grid the area differs from that of "
            f"{STEPS[-1]} by {changes}; a quarter of the tolerance is allowed"
        )
    return options, why


def climb(recipes: Sequence[Recipe], solve: Solver, tolerance: float) -> list[Pilot]:
    """Solve the first surface on finer grids until one will do, and others on the
    coarsest grid.
    """
    first, pilots = recipes[0], list[Pilot]()
    rungs = ladder(first, beyond=False)
    for shape, following in zip(rungs, [*rungs[1:], None], strict=True):
        pilots.append(solve(on_grid(first, shape) or first))
        most = PILOT_SHARE * carried_work(pilots, first.shape) * len(recipes)
        if following is None or pilots[-1].error <= 0.7 * tolerance:
            break
        if len(pilots) > 1 and carried_work(pilots, following) > most / 2:
            break
    others = recipes[1:PILOT_SURFACES]
    return pilots + [solve(on_grid(recipe, rungs[0]) or recipe) for recipe in others]


def coarsest(pilots: Sequence[Pilot]) -> list[Pilot]:
    """Return the pilots on the coarsest grid, one for each surface."""
    return [p for p in pilots if p.shape == pilots[0].shape]


def deviation_of(pilots: Sequence[Pilot], parts: Sequence[str]) -> float:
    """Return the largest relative standard deviation of the parts, by its upper 80 %
    bound.
    """
    bounds = [0.0]
    for part in parts:
        values = [getattr(pilot.areas, part) for pilot in coarsest(pilots)]
        degrees = len(values) - 1
        if degrees and sum(values) > 0:
            bound = math.sqrt(degrees / float(chdtri(degrees, 0.8)))
            bounds.append(bound * standard_deviation(values) / float(np.mean(values)))
    return max(bounds)


def cheapest(
    recipes: Sequence[Recipe],
    pilots: Sequence[Pilot],
    tolerance: float,
    deviation: float,
    capped: bool,
) -> Candidate:
    """Return the cheapest grid that meets the tolerance with its surfaces, or the most
    accurate. If `capped`, no grid is finer and no ensemble larger than that of the
    case.
    """
    candidates = []
    most = len(recipes) if capped else MOST_SURFACES
    for shape in ladder(recipes[0], beyond=not capped):
        error, count, scatter = carried_error(pilots, shape), 1, 0.0
        if len(recipes) > 1 and deviation > 0:
            room = math.sqrt(max(tolerance**2 - error**2, 0.0))
            enough = (
                n
                for n in range(2, most + 1)
                if student_half_width(deviation, n) <= room
            )
            count = next(enough, most)
            scatter = student_half_width(deviation, count)
        work = carried_work(pilots, shape) * count
        candidates.append(Candidate(shape, count, error, scatter, work))
    if good := [c for c in candidates if c.error <= tolerance]:
        return min(good, key=lambda c: c.work)
    return min(candidates, key=lambda c: (c.error, c.work))
