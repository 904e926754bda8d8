"""Recipes on other grids: a ladder of grids, and the line of a one-directional surface.

Only recipes can be put on another grid: measured heights stay on their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from epcontact.errors import InvalidScene
from epcontact.scene import Surface
from epcontact.surfaces import (
    Facing,
    HeightsFromArray,
    HeightsFromFile,
    Mirrored,
    Recipe,
    SelfAffine,
)

#: Grid points per shortest wavelength of self-affine roughness; fewer than 3 lose its
#: phases.
WAVELENGTH_LADDER = (3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48, 64)
#: Grids for other shapes, as fractions of the case's own grid.
SHAPE_LADDER = (1 / 16, 1 / 8, 1 / 4, 3 / 8, 1 / 2, 3 / 4, 1, 3 / 2, 2, 3, 4)
FEWEST_POINTS = 16


@dataclass(frozen=True)
class Section:
    """The line that stands for a one-directional surface: its heights along `axis`."""

    whole: Recipe
    axis: int

    @property
    def fingerprint(self) -> str:
        """The fingerprint of the whole surface, and the direction."""
        return f"section/1 axis={self.axis} of {self.whole.fingerprint}"

    @property
    def shape(self) -> tuple[int, ...]:
        """Grid points along the line."""
        return (self.whole.shape[self.axis],)

    @property
    def periods(self) -> tuple[float, ...]:
        """The period in m."""
        return (self.whole.periods[self.axis],)

    def build(self) -> Surface:
        """Make the heights, from two points across the line if the recipe allows."""
        shape = (*self.shape, 2) if self.axis == 0 else (2, *self.shape)
        surface = (on_grid(self.whole, shape) or self.whole).build()
        heights = np.take(surface.heights, 0, axis=1 - self.axis)
        return replace(
            surface,
            heights=heights,
            periods=self.periods,
            spectrum=None,
            recipe=self.fingerprint,
        )


def one_directional(recipe: Recipe) -> int | None:
    """Return the only axis along which the heights vary, judged on a coarse grid; else
    None.
    """
    if len(recipe.shape) != 2:
        return None
    heights = (on_grid(recipe, (64, 64)) or recipe).build().heights
    height = float(np.ptp(heights))
    same = (a for a in (0, 1) if np.ptp(heights, axis=1 - a).max() <= 1e-9 * height)
    return next(same, None) if height > 0 else None


def ladder(recipe: Recipe, *, beyond: bool) -> list[tuple[int, ...]]:
    """Return grids from coarse to fine, including the recipe's own; finer ones if
    `beyond`.
    """
    own, points = recipe.shape, points_per_wavelength(recipe)
    factors = (
        SHAPE_LADDER if math.isnan(points) else [p / points for p in WAVELENGTH_LADDER]
    )
    shapes = {own}
    for factor in factors:
        shape = tuple(round(factor * n) for n in own)
        if (
            (factor < 1 or beyond)
            and min(shape) >= FEWEST_POINTS
            and on_grid(recipe, shape)
        ):
            shapes.add(shape)
    return sorted(shapes, key=math.prod)


def points_per_wavelength(recipe: Recipe) -> float:
    """Return the points per shortest wavelength of self-affine roughness; else NaN."""
    base = recipe.whole if isinstance(recipe, Section) else recipe
    if not isinstance(base, SelfAffine):
        return math.nan
    spacing = max(
        period / n for n, period in zip(recipe.shape, recipe.periods, strict=True)
    )
    return 2 * math.pi / base.spectrum.wavenumber_high / spacing


def on_grid(recipe: Recipe, shape: tuple[int, ...]) -> Recipe | None:
    """Return the surface on another grid; None if that is impossible or the grid too
    coarse.
    """
    if shape == recipe.shape:
        return recipe
    if isinstance(recipe, Section):
        across = recipe.whole.shape[1 - recipe.axis]
        whole = on_grid(
            recipe.whole, (*shape, across) if recipe.axis == 0 else (across, *shape)
        )
        return whole and Section(whole, recipe.axis)
    if isinstance(recipe, HeightsFromArray | HeightsFromFile | Mirrored | Facing):
        return None
    try:
        changed: Recipe = replace(recipe, shape=shape)  # type: ignore[type-var]
    except InvalidScene:
        return None
    return changed
