"""Recipes on other grids: a ladder of grids, and the line of a one-directional surface.

Only recipes can be put on another grid: measured heights stay on their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from epcontact import surfaces
from epcontact.errors import InvalidScene
from epcontact.scene import Surface

#: Grid points per shortest wavelength of self-affine roughness; fewer than 3 lose its phases.
WAVELENGTH_LADDER = (3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48, 64)
#: Grids for other shapes, as fractions of the case's own grid.
SHAPE_LADDER = (1 / 16, 1 / 8, 1 / 4, 3 / 8, 1 / 2, 3 / 4, 1, 3 / 2, 2, 3, 4)
FEWEST_POINTS = 16


@dataclass(frozen=True)
class Section:
    """The line that stands for a one-directional surface: its heights along `axis`."""

    whole: surfaces.Recipe
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
        across = 1 - self.axis
        shape = list(self.whole.shape)
        shape[across] = 2
        narrow = _with_shape(self.whole, tuple(shape)) or self.whole
        surface = narrow.build()
        heights = np.take(surface.heights, 0, axis=across)
        return replace(
            surface, heights=heights, periods=self.periods, spectrum=None, recipe=self.fingerprint
        )


def one_directional(recipe: surfaces.Recipe) -> int | None:
    """Return the only axis along which the heights vary, or None if they vary along both.

    A coarse grid decides; for measured heights their own.
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
    """Return grids from coarse to fine, including the recipe's own; finer ones if `beyond`."""
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
    """Return the points per shortest wavelength of self-affine roughness; else NaN."""
    base = recipe.whole if isinstance(recipe, Section) else recipe
    if not isinstance(base, surfaces.SelfAffine):
        return math.nan
    shortest = 2 * math.pi / base.spectrum.wavenumber_high
    return min(
        shortest * n / period for n, period in zip(recipe.shape, recipe.periods, strict=True)
    )


def on_grid(recipe: surfaces.Recipe, shape: tuple[int, ...]) -> surfaces.Recipe | None:
    """Return the surface on another grid; None if that is impossible or the grid too coarse."""
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
