"""What a plan chooses from: pilots up a ladder of grids, and what each grid would take.

See `plan` for the rule.  `Setup` is what planning starts from, `Candidate` a grid with the number
of surfaces it would need.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtri

from epcontact import surfaces
from epcontact.harness.case import Case
from epcontact.harness.statistics import student_half_width
from epcontact.planning.pilots import (
    Pilot,
    carried_cost,
    carried_error,
    ladder,
    on_grid,
    solve,
    worst,
)

MOST_SURFACES = 1000
PILOT_SURFACES = 8
#: Of the work of the case as it stands, what pilots may cost together.
PILOT_SHARE = 0.2
#: Load steps a plastic path is tried with; the last is the reference.
LOAD_STEPS = (1, 2, 4, 8)


@dataclass(frozen=True)
class Candidate:
    """A grid with the surfaces it needs, the relative errors left, and what it costs.

    raw: whether raw areas are as good as corrected ones; work, seconds: of all surfaces.
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
        """Of grid and scatter together."""
        return math.hypot(self.grid_error, self.scatter)


@dataclass(frozen=True)
class Setup:
    """What planning starts from; `recipes` are lines where the surfaces have one direction."""

    case: Case
    method: str
    recipes: tuple[surfaces.Recipe, ...]
    options: dict[str, Any]
    tolerance: float
    parts: tuple[str, ...]
    threads: int | None
    tell: Callable[[str], None]

    def solve(self, recipe: surfaces.Recipe, **options: Any) -> Pilot:
        """A pilot on one surface.  Raises InvalidScene, NotConverged."""
        shape = " x ".join(map(str, recipe.shape))
        self.tell(f"plan: pilot by {self.method} on {shape} points")
        given = self.options | options
        return solve(self.case, recipe, self.method, self.threads, **given)[0]


def finite_element_options(setup: Setup) -> tuple[dict[str, Any], list[str]]:
    """Load steps by pilots on the coarsest grid, and the depth from the layer's compliance."""
    case, options, why = setup.case, {}, []
    if case.body.kind == "half_space" and "depth" not in case.options["fem"]:
        from fem_check.mesh import half_space_depth

        share = setup.tolerance / 4
        longest = max(case.recipes[0].periods)
        options["depth"] = half_space_depth(longest, case.material.poisson_ratio, share)
        why.append(
            f"a block {options['depth']:.3g} m deep answers the longest wave within {share:.1g} "
            "of the half-space; its layers grow from the grid spacing as fast as the waves allow"
        )
    if case.options["fem"].get("law") == "j2":
        coarse = on_grid(setup.recipes[0], ladder(setup.recipes[0], beyond=False)[0])
        areas = [
            setup.solve(coarse or setup.recipes[0], steps=steps, **options).areas.total
            for steps in LOAD_STEPS
        ]
        off = [abs(area / areas[-1] - 1) for area in areas]
        at = next(i for i, e in enumerate(off) if e <= setup.tolerance / 4)
        options["steps"] = LOAD_STEPS[at]
        why.append(
            f"{LOAD_STEPS[at]} load steps: on the coarsest grid the area differs from that of "
            f"{LOAD_STEPS[-1]} steps by {off[at]:.1g}, a quarter of the tolerance at the most"
        )
    return options, why


def climb(setup: Setup) -> list[Pilot]:
    """The first surface on finer and finer grids, until one is fine enough or the next too dear."""
    recipe, pilots = setup.recipes[0], []
    rungs = ladder(recipe, beyond=False)
    for shape in rungs:
        pilots.append(setup.solve(on_grid(recipe, shape) or recipe))
        whole = carried_cost(pilots, recipe.shape)[0] * len(setup.recipes)
        following = rungs[rungs.index(shape) + 1] if shape != rungs[-1] else None
        if following is None or worst(pilots[-1].errors, setup.parts) <= 0.7 * setup.tolerance:
            break
        if len(pilots) > 1 and carried_cost(pilots, following)[0] > PILOT_SHARE * whole / 2:
            break
    return pilots


def sample_surfaces(setup: Setup) -> list[Pilot]:
    """The other surfaces, as far as they serve to know the scatter, on the coarsest grid."""
    shape = ladder(setup.recipes[0], beyond=False)[0]
    others = setup.recipes[1:PILOT_SURFACES]
    return [setup.solve(on_grid(recipe, shape) or recipe) for recipe in others]


def coarsest(pilots: Sequence[Pilot]) -> list[Pilot]:
    """The pilots on the coarsest grid, one a surface."""
    return [p for p in pilots if p.shape == pilots[0].shape]


def deviation_of(pilots: Sequence[Pilot], part: str) -> float:
    """Standard deviation between surfaces, relative: the upper 80 % bound of what is known."""
    values = np.array([getattr(p.areas, part) for p in coarsest(pilots)])
    if values.size < 2 or values.mean() <= 0:
        return 0.0
    degrees = values.size - 1
    bound = math.sqrt(degrees / float(chdtri(degrees, 0.8)))
    return bound * float(values.std(ddof=1) / values.mean())


def candidates_for(setup: Setup, pilots: Sequence[Pilot], capped: bool) -> list[Candidate]:
    """Every grid of the ladder with the fewest surfaces that meet the tolerance on it."""
    found = []
    most = len(setup.recipes) if capped else MOST_SURFACES
    deviation = max(deviation_of(pilots, part) for part in setup.parts)
    for shape in ladder(setup.recipes[0], beyond=not capped):
        error, raw = carried_error(pilots, shape, setup.parts)
        count, scatter = 1, 0.0
        if len(setup.recipes) > 1 and deviation > 0:
            room = math.sqrt(max(setup.tolerance**2 - error**2, 0.0))
            good = (n for n in range(2, most + 1) if student_half_width(deviation, n) <= room)
            count = next(good, most)
            scatter = student_half_width(deviation, count)
        work, seconds = carried_cost(pilots, shape)
        found.append(Candidate(shape, count, error, scatter, raw, work * count, seconds * count))
    return found


def cheapest(candidates: Sequence[Candidate], tolerance: float) -> Candidate:
    """The cheapest that meets the tolerance; if none does, the one of least error."""
    good = [c for c in candidates if c.error <= tolerance]
    if good:
        return min(good, key=lambda c: c.work)
    return min(candidates, key=lambda c: (c.error, c.work))
