"""Cheap solves that tell what a scene needs: a ladder of grids, and what each rung is worth.

A rung is one grid of the case's surfaces.  The lowest rungs are solved; the relative error that
their areas claim of themselves is carried to finer grids by its observed order, the number of
transforms by their points.  Only recipes can be put on another grid: measured heights stay on
their own.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from epcontact import surfaces
from epcontact.errors import InvalidScene
from epcontact.harness.case import Case
from epcontact.harness.methods import METHODS
from epcontact.results import Areas, ContactResult
from epcontact.scene import Scene, Surface

PARTS = ("total", "elastic", "plastic")
#: Grid points per shortest wavelength of self-affine roughness; fewer than 3 lose its phases.
WAVELENGTH_LADDER = (3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48, 64)
#: Of the case's own grid, for other shapes.
SHAPE_LADDER = (1 / 16, 1 / 8, 1 / 4, 3 / 8, 1 / 2, 3 / 4, 1, 3 / 2, 2, 3, 4)
FEWEST_POINTS = 16
#: Options of a method that make a pilot cheaper than an answer.
_PILOT_OPTIONS: dict[str, dict[str, Any]] = {"bem": {"area_tolerance": 1e-4}}


@dataclass(frozen=True)
class Section:
    """The line that a one-directional surface is: its heights along `axis`, at one place."""

    whole: surfaces.Recipe
    axis: int

    @property
    def fingerprint(self) -> str:
        """That of the whole surface, and the direction."""
        return f"section/1 axis={self.axis} of {self.whole.fingerprint}"

    @property
    def shape(self) -> tuple[int, ...]:
        """Grid points along the line."""
        return (self.whole.shape[self.axis],)

    @property
    def periods(self) -> tuple[float, ...]:
        """Its period in m."""
        return (self.whole.periods[self.axis],)

    def build(self) -> Surface:
        """Make the heights; two points across are enough where the recipe can."""
        across = 1 - self.axis
        shape = list(self.whole.shape)
        shape[across] = 2
        narrow = _with_shape(self.whole, tuple(shape)) or self.whole
        surface = narrow.build()
        heights = np.take(surface.heights, 0, axis=across)
        return replace(
            surface, heights=heights, periods=self.periods, spectrum=None, recipe=self.fingerprint
        )


@dataclass(frozen=True)
class Pilot:
    """One solve of one surface.

    errors, raw_errors: of the corrected and the raw areas, relative, by part; NaN where there is
    no such area.  work: FFT pairs, or sweeps over the unknowns, times points.
    """

    shape: tuple[int, ...]
    areas: Areas
    errors: dict[str, float]
    raw_errors: dict[str, float]
    work: float
    seconds: float


def one_directional(recipe: surfaces.Recipe) -> int | None:
    """The axis along which all of the roughness runs, None if it runs along both.

    Judged on a coarse grid, and for measured heights on their own.
    """
    if len(recipe.shape) != 2:
        return None
    coarse = _with_shape(recipe, (64, 64)) or recipe
    heights = coarse.build().heights
    height = float(np.ptp(heights))
    for axis in (0, 1):
        if float(np.ptp(heights, axis=1 - axis).max()) <= 1e-9 * height and height > 0:
            return axis
    return None


def ladder(recipe: surfaces.Recipe, *, beyond: bool) -> list[tuple[int, ...]]:
    """Grids from coarse to fine, the recipe's own among them; finer ones only if `beyond`."""
    own = recipe.shape
    base = recipe.whole if isinstance(recipe, Section) else recipe
    if isinstance(base, surfaces.SelfAffine):
        factors = [p / points_per_wavelength(recipe) for p in WAVELENGTH_LADDER]
        factors.append(1.0)
    else:
        factors = list(SHAPE_LADDER)
    shapes = {own}
    for factor in factors:
        shape = tuple(round(factor * n) for n in own)
        if (factor < 1 or beyond) and min(shape) >= FEWEST_POINTS and on_grid(recipe, shape):
            shapes.add(shape)
    return sorted(shapes, key=math.prod)


def points_per_wavelength(recipe: surfaces.Recipe) -> float:
    """Grid points per shortest wavelength of self-affine roughness; NaN of other surfaces."""
    base = recipe.whole if isinstance(recipe, Section) else recipe
    if not isinstance(base, surfaces.SelfAffine):
        return math.nan
    shortest = 2 * math.pi / base.spectrum.wavenumber_high
    return min(
        shortest * n / period for n, period in zip(recipe.shape, recipe.periods, strict=True)
    )


def on_grid(recipe: surfaces.Recipe, shape: tuple[int, ...]) -> surfaces.Recipe | None:
    """The same surface on another grid; None where it cannot be, or not on so coarse a one."""
    if shape == recipe.shape:
        return recipe
    if isinstance(recipe, Section):
        full = list(recipe.whole.shape)
        full[recipe.axis] = shape[0]
        whole = _with_shape(recipe.whole, tuple(full))
        return None if whole is None else Section(whole, recipe.axis)
    return _with_shape(recipe, shape)


def _with_shape(recipe: surfaces.Recipe, shape: tuple[int, ...]) -> surfaces.Recipe | None:
    if isinstance(recipe, surfaces.HeightsFromArray | surfaces.HeightsFromFile | Section):
        return None
    try:
        changed: surfaces.Recipe = replace(recipe, shape=shape)  # type: ignore[type-var]
    except InvalidScene:
        return None
    return changed


def solve(
    case: Case, recipe: surfaces.Recipe, method: str, threads: int | None, **options: Any
) -> tuple[Pilot, ContactResult]:
    """Solve the case on one surface by a method of its own, with further options.

    The areas of the boundary elements are settled to 1e-4, which is enough for a plan.

    Raises:
        InvalidScene, NotConverged: as the method does.
    """
    scene = Scene(recipe.build(), case.material, case.load, case.body)
    given = _PILOT_OPTIONS.get(method, {}) | dict(case.options.get(method, {})) | options
    started = time.perf_counter()
    result = METHODS[method].solve(scene, given, threads)
    return _pilot(result, recipe.shape, time.perf_counter() - started), result


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
    """The largest relative error of the parts that exist; NaN if none does."""
    found = [errors[part] for part in parts if not math.isnan(errors[part])]
    return max(found, default=math.nan)


def carried_error(
    pilots: Sequence[Pilot], shape: tuple[int, ...], parts: Sequence[str]
) -> tuple[float, bool]:
    """The relative error on a grid, and whether raw areas have no more of it.

    Solved grids say it themselves.  To finer ones it is carried by the order between the two
    finest solved, taken to be between 1 and 2, the orders of a rim's chance and of its curvature.
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
    """(work, seconds) of one solve on a grid, by points from the finest grid solved below it."""
    known = [p for p in pilots if p.shape == shape]
    base = known or [p for p in pilots if math.prod(p.shape) == _finest(pilots)]
    ratio = math.prod(shape) / math.prod(base[0].shape)
    work, seconds = (float(np.mean([getattr(p, k) for p in base])) for k in ("work", "seconds"))
    return work * ratio, seconds * ratio


def _finest(pilots: Sequence[Pilot]) -> int:
    return max(math.prod(p.shape) for p in pilots)
