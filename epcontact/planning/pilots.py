"""Pilots: cheap solves that estimate the error and cost of every candidate grid.

The coarsest grids of the ladder are solved.  The relative error that their areas claim is
extrapolated to finer grids by its observed order, and the number of transforms by the number of
points.  A candidate is a grid with the number of surfaces that it would need.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import chdtri

from epcontact import surfaces
from epcontact.harness.case_files.case import Case
from epcontact.harness.gates.statistics import standard_deviation, student_half_width
from epcontact.harness.methods.registry import METHODS
from epcontact.machine import available_cores
from epcontact.planning.grids import ladder, on_grid
from epcontact.results import Areas, ContactResult
from fem_check.mesh import half_space_depth

PARTS = ("total", "elastic", "plastic")
MOST_SURFACES = 1000
PILOT_SURFACES = 8
#: Largest work of all pilots together, as a share of the work of the given case.
PILOT_SHARE = 0.2
#: Step tolerances that are tried on a plastic path; the last is the reference of the others.
STEP_TOLERANCES = (0.03, 0.01, 0.003)

#: A function that solves one recipe; further keywords are options of the method.
Solver = Callable[..., "Pilot"]


@dataclass(frozen=True)
class Pilot:
    """One solve of one surface.

    Attributes:
        errors, raw_errors: relative errors of the corrected and the raw areas, by part; NaN if
            the area is zero.
        work: FFT pairs, or sweeps over the unknowns, times points.
        notes: those of the surface.
    """

    shape: tuple[int, ...]
    areas: Areas
    errors: dict[str, float]
    raw_errors: dict[str, float]
    work: float
    seconds: float
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Candidate:
    """A grid with the number of surfaces it needs, its relative errors and its cost.

    Attributes:
        raw: True if raw areas are as good as corrected ones.
        work, seconds: the cost of all surfaces.
    """

    shape: tuple[int, ...]
    surfaces: int
    grid_error: float
    scatter: float
    raw: bool
    work: float
    seconds: float

    @property
    def error(self) -> float:
        """The combined error of grid and scatter."""
        return math.hypot(self.grid_error, self.scatter)


def solve_pilot(
    case: Case, recipe: surfaces.Recipe, method: str, threads: int | None, **options: Any
) -> Pilot:
    """Solve the case on one surface, no more exactly than a pilot of the method needs.

    Raises InvalidScene, NotConverged.
    """
    started = time.perf_counter()
    given = dict(METHODS[method].pilot) | dict(case.options.get(method, {})) | options
    scene = case.scene(recipe)
    result = METHODS[method].solve(scene, given, threads or available_cores())
    pilot = _pilot(result, recipe.shape, time.perf_counter() - started)
    return replace(pilot, notes=scene.surface.notes)


def _pilot(result: ContactResult, shape: tuple[int, ...], seconds: float) -> Pilot:
    areas = result.final.areas
    best, raw, error = areas["corrected"], areas["raw"], areas["error"]
    errors, raw_errors = {}, {}
    for part in PARTS:
        area, claimed = getattr(best, part), getattr(error, part)
        scale = area if area > 0 else math.nan
        errors[part] = claimed / scale
        raw_errors[part] = abs(getattr(raw, part) - area) / scale + claimed / scale
    sweeps = result.cost.get("equivalent_fft_pairs")
    if sweeps is None:
        counts = result.final.iterations
        sweeps = sum(counts.get(name, 0) for name in ("cg", "newton", "sweeps"))
    points = result.cost["unknowns"]
    return Pilot(shape, best, errors, raw_errors, sweeps * points, seconds)


def worst(errors: dict[str, float], parts: Sequence[str]) -> float:
    """Return the largest relative error of the parts that exist; NaN if none does."""
    return max((errors[p] for p in parts if not math.isnan(errors[p])), default=math.nan)


def carried_error(
    pilots: Sequence[Pilot], shape: tuple[int, ...], parts: Sequence[str]
) -> tuple[float, bool]:
    """Return the relative error on a grid, and True if raw areas have no larger error.

    A solved grid has its own error.  The error on a finer grid follows from the order between the
    two finest solved grids, limited to 1 to 2: a rim's random position has the order 1, its
    curvature 2.
    """
    by_shape: dict[tuple[int, ...], list[Pilot]] = {}
    for pilot in pilots:
        by_shape.setdefault(pilot.shape, []).append(pilot)
    raw = all(worst(p.raw_errors, parts) <= worst(p.errors, parts) for p in pilots)
    level = {s: max(worst(p.errors, parts) for p in group) for s, group in by_shape.items()}
    if shape in level:
        return level[shape], raw
    solved = sorted(level, key=math.prod)
    finest = solved[-1]
    order = 1.0
    if len(solved) > 1 and level[finest] > 0 and level[solved[-2]] > 0:
        order = math.log(level[solved[-2]] / level[finest]) / math.log(finest[0] / solved[-2][0])
    return level[finest] * (finest[0] / shape[0]) ** min(max(order, 1.0), 2.0), raw


def carried_cost(pilots: Sequence[Pilot], shape: tuple[int, ...]) -> tuple[float, float]:
    """Return (work, seconds) of a solve on a grid, scaled by points from the finest solved grid."""
    known = [p for p in pilots if p.shape == shape]
    base = known or [p for p in pilots if math.prod(p.shape) == _finest(pilots)]
    ratio = math.prod(shape) / math.prod(base[0].shape)
    work, seconds = (float(np.mean([getattr(p, k) for p in base])) for k in ("work", "seconds"))
    return work * ratio, seconds * ratio


def _finest(pilots: Sequence[Pilot]) -> int:
    return max(math.prod(p.shape) for p in pilots)


def finite_element_options(
    case: Case, recipe: surfaces.Recipe, solve: Solver, tolerance: float
) -> tuple[dict[str, Any], list[str]]:
    """Choose the increments by pilots on the coarsest grid and the depth by the layer's compliance.

    Returns:
        The options and the reasons.
    """
    options: dict[str, Any] = {}
    why = []
    if case.body.kind == "half_space" and "depth" not in case.options["fem"]:
        share = tolerance / 4
        longest = max(case.recipes[0].periods)
        options["depth"] = half_space_depth(longest, case.material.poisson_ratio, share)
        why.append(
            f"a block {options['depth']:.3g} m deep answers the longest wave within {share:.1g} "
            "of the half-space; its layers grow from the grid spacing as fast as the waves allow"
        )
    if case.options["fem"].get("law") == "j2":
        coarse = on_grid(recipe, ladder(recipe, beyond=False)[0]) or recipe
        options["steps"] = None  # chosen, whatever the case has
        *tried, best = [
            solve(coarse, step_tolerance=share, **options).areas.total for share in STEP_TOLERANCES
        ]
        off = {s: abs(area / best - 1) for s, area in zip(STEP_TOLERANCES, tried, strict=False)}
        enough = [share for share, error in off.items() if error <= tolerance / 4]
        options["step_tolerance"] = max(enough, default=STEP_TOLERANCES[-1])
        changes = ", ".join(f"{error:.1g} at {share:g}" for share, error in off.items())
        why.append(
            f"a step tolerance of {options['step_tolerance']:g}: on the coarsest grid the area "
            f"differs from that at {STEP_TOLERANCES[-1]:g} by {changes}; a quarter of the "
            "tolerance is allowed"
        )
    return options, why


def climb(
    recipes: Sequence[surfaces.Recipe], solve: Solver, tolerance: float, parts: Sequence[str]
) -> list[Pilot]:
    """Solve the first surface on ever finer grids until one suffices or the next costs too much."""
    recipe, pilots = recipes[0], list[Pilot]()
    rungs = ladder(recipe, beyond=False)
    for shape in rungs:
        pilots.append(solve(on_grid(recipe, shape) or recipe))
        whole = carried_cost(pilots, recipe.shape)[0] * len(recipes)
        following = rungs[rungs.index(shape) + 1] if shape != rungs[-1] else None
        if following is None or worst(pilots[-1].errors, parts) <= 0.7 * tolerance:
            break
        if len(pilots) > 1 and carried_cost(pilots, following)[0] > PILOT_SHARE * whole / 2:
            break
    return pilots


def sample_surfaces(recipes: Sequence[surfaces.Recipe], solve: Solver) -> list[Pilot]:
    """Solve other surfaces on the coarsest grid, enough to estimate the scatter."""
    shape = ladder(recipes[0], beyond=False)[0]
    return [solve(on_grid(recipe, shape) or recipe) for recipe in recipes[1:PILOT_SURFACES]]


def coarsest(pilots: Sequence[Pilot]) -> list[Pilot]:
    """Return the pilots on the coarsest grid, one for each surface."""
    return [p for p in pilots if p.shape == pilots[0].shape]


def deviation_of(pilots: Sequence[Pilot], parts: Sequence[str]) -> float:
    """Return the largest relative standard deviation of the parts between surfaces.

    For each part it is the upper 80 % bound, because the pilots are few.
    """
    bounds = [0.0]
    for part in parts:
        values = np.array([getattr(pilot.areas, part) for pilot in coarsest(pilots)])
        if values.size > 1 and values.mean() > 0:
            degrees = values.size - 1
            bound = math.sqrt(degrees / float(chdtri(degrees, 0.8)))
            bounds.append(bound * standard_deviation(values.tolist()) / float(values.mean()))
    return max(bounds)


def candidates_for(
    recipes: Sequence[surfaces.Recipe],
    pilots: Sequence[Pilot],
    tolerance: float,
    parts: Sequence[str],
    capped: bool,
) -> list[Candidate]:
    """Return each grid of the ladder with the fewest surfaces that meet the tolerance on it.

    If `capped`, no grid is finer and no ensemble larger than that of the case.
    """
    candidates = []
    most = len(recipes) if capped else MOST_SURFACES
    deviation = deviation_of(pilots, parts)
    for shape in ladder(recipes[0], beyond=not capped):
        error, raw = carried_error(pilots, shape, parts)
        count, scatter = 1, 0.0
        if len(recipes) > 1 and deviation > 0:
            room = math.sqrt(max(tolerance**2 - error**2, 0.0))
            enough = (n for n in range(2, most + 1) if student_half_width(deviation, n) <= room)
            count = next(enough, most)
            scatter = student_half_width(deviation, count)
        work, seconds = carried_cost(pilots, shape)
        candidates.append(
            Candidate(shape, count, error, scatter, raw, work * count, seconds * count)
        )
    return candidates


def cheapest(candidates: Sequence[Candidate], tolerance: float) -> Candidate:
    """Return the cheapest candidate that meets the tolerance, or else the most accurate one."""
    good = [c for c in candidates if c.error <= tolerance]
    if good:
        return min(good, key=lambda c: c.work)
    return min(candidates, key=lambda c: (c.error, c.work))
