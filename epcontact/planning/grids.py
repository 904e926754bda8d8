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
        """The text that identifies the line in results: direction and surface."""
        return f"section/1 axis={self.axis} of {self.surface.fingerprint}"

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of grid points along the line, a tuple of one number."""
        return (self.surface.shape[self.axis],)

    @property
    def periods(self) -> tuple[float, ...]:
        """The period along the line in m, a tuple of one number."""
        return (self.surface.periods[self.axis],)

    def build(self) -> Surface:
        """Return the line as a `Surface` with heights of shape (n,).

        The two-dimensional surface is built on two points across the line, if its
        recipe can be put on such a grid, to save time.
        """
        points = [2, 2]
        points[self.axis] = self.shape[0]
        narrow = on_grid(self.surface, tuple(points)) or self.surface
        surface = narrow.build()
        return replace(
            surface,
            heights=np.take(surface.heights, 0, axis=1 - self.axis),
            periods=self.periods,
            spectrum=None,
            recipe=self.fingerprint,
        )


def one_directional(recipe: Recipe) -> int | None:
    """Return the axis, 0 or 1, along which alone the heights of a surface vary.

    None if they vary along both axes or not at all, or if the recipe is that of a line.
    The heights are built on 64 x 64 points, if the recipe can be put on such a grid.
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
    """Return the shapes of the grids that a plan tries, from coarse to fine.

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
    """Return the points per shortest wavelength of the surface of a recipe.

    They are counted along the axis with the larger spacing.  NaN if the surface is not
    self-affine, and so has no shortest wavelength.
    """
    base = recipe
    if isinstance(recipe, Section):
        base = recipe.surface
    if not isinstance(base, SelfAffine):
        return math.nan
    spacings = np.array(recipe.periods) / np.array(recipe.shape)
    return 2 * math.pi / base.spectrum.wavenumber_high / float(spacings.max())


def on_grid(recipe: Recipe, shape: tuple[int, ...]) -> Recipe | None:
    """Return the recipe of the same surface on a grid of another shape.

    The result is None if the surface has only one grid, as measured heights have, or if
    the grid is too coarse for it.  The recipe of a line takes a shape of one number.
    """
    if shape == recipe.shape:
        return recipe
    if isinstance(recipe, Section):
        points_across = recipe.surface.shape[1 - recipe.axis]
        points = [points_across, points_across]
        points[recipe.axis] = shape[0]
        surface = on_grid(recipe.surface, tuple(points))
        if surface is None:
            return None
        return Section(surface, recipe.axis)
    if isinstance(recipe, HeightsFromArray | HeightsFromFile | Mirrored | Facing):
        return None
    try:
        changed: Recipe = replace(recipe, shape=shape)  # type: ignore[type-var]
    except InvalidScene:
        return None
    return changed
