"""Recipes on other grids: a ladder of grids, and the line of a one-directional surface.

Only recipes can be put on another grid; measured heights stay on their own.
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

#: Grid points per shortest wavelength of self-affine roughness that are tried; fewer
#: than 3 lose the phases of the shortest waves.
WAVELENGTH_LADDER = (3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48, 64)
#: Grids of other shapes that are tried, as multiples of the case's grid.
SHAPE_LADDER = (1 / 16, 1 / 8, 1 / 4, 3 / 8, 1 / 2, 3 / 4, 1, 3 / 2, 2, 3, 4)
#: No grid has fewer points along a direction.
FEWEST_POINTS = 16
#: Heights that vary by less than this fraction of their range are constant.
_CONSTANT = 1e-9


@dataclass(frozen=True)
class Section:
    """The line that represents a one-directional surface.

    Attributes:
        surface: Recipe of the surface.
        axis: 0 or 1, the axis along which its heights vary.
    """

    surface: Recipe
    axis: int

    @property
    def fingerprint(self) -> str:
        """The fingerprint of the surface, and the direction."""
        return f"section/1 axis={self.axis} of {self.surface.fingerprint}"

    @property
    def shape(self) -> tuple[int, ...]:
        """Grid points along the line."""
        return (self.surface.shape[self.axis],)

    @property
    def periods(self) -> tuple[float, ...]:
        """The period in m."""
        return (self.surface.periods[self.axis],)

    def build(self) -> Surface:
        """Return the line, from two points across it if the recipe allows."""
        shape = (*self.shape, 2) if self.axis == 0 else (2, *self.shape)
        narrow = on_grid(self.surface, shape) or self.surface
        surface = narrow.build()
        return replace(
            surface,
            heights=np.take(surface.heights, 0, axis=1 - self.axis),
            periods=self.periods,
            spectrum=None,
            recipe=self.fingerprint,
        )


def one_directional(recipe: Recipe) -> int | None:
    """Return the only axis along which the heights vary; None if there are two or none.

    The heights are judged on a coarse grid if the recipe allows.
    """
    if len(recipe.shape) != 2:
        return None
    coarse = on_grid(recipe, (64, 64)) or recipe
    heights = coarse.build().heights
    height_range = float(np.ptp(heights))
    if height_range == 0:
        return None
    for axis in (0, 1):
        if np.ptp(heights, axis=1 - axis).max() <= _CONSTANT * height_range:
            return axis
    return None


def ladder(recipe: Recipe, *, beyond: bool) -> list[tuple[int, ...]]:
    """Return the shapes of the grids that are tried, from coarse to fine.

    Args:
        recipe: The surface, whose own grid is among them.
        beyond: Whether grids finer than that of the recipe are tried.
    """
    points = points_per_wavelength(recipe)
    if math.isnan(points):
        factors: list[float] = list(SHAPE_LADDER)
    else:
        factors = [count / points for count in WAVELENGTH_LADDER]
    shapes = {recipe.shape}
    for factor in factors:
        shape = tuple(round(factor * n) for n in recipe.shape)
        is_wanted = factor < 1 or beyond
        if is_wanted and min(shape) >= FEWEST_POINTS and on_grid(recipe, shape):
            shapes.add(shape)
    return sorted(shapes, key=math.prod)


def points_per_wavelength(recipe: Recipe) -> float:
    """Return the points per shortest wavelength of self-affine roughness; else NaN."""
    base = recipe.surface if isinstance(recipe, Section) else recipe
    if not isinstance(base, SelfAffine):
        return math.nan
    spacings = np.array(recipe.periods) / np.array(recipe.shape)
    return 2 * math.pi / base.spectrum.wavenumber_high / float(spacings.max())


def on_grid(recipe: Recipe, shape: tuple[int, ...]) -> Recipe | None:
    """Return the surface on a grid of another shape.

    The result is None if the surface has but one grid, as measured heights have, or if
    the grid is too coarse for it.
    """
    if shape == recipe.shape:
        return recipe
    if isinstance(recipe, Section):
        points_across = recipe.surface.shape[1 - recipe.axis]
        full = (*shape, points_across) if recipe.axis == 0 else (points_across, *shape)
        surface = on_grid(recipe.surface, full)
        return None if surface is None else Section(surface, recipe.axis)
    if isinstance(recipe, HeightsFromArray | HeightsFromFile | Mirrored | Facing):
        return None
    try:
        changed: Recipe = replace(recipe, shape=shape)  # type: ignore[type-var]
    except InvalidScene:
        return None
    return changed
