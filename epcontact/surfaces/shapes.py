"""Surfaces with closed-form contact solutions: sinusoids, paraboloid, sphere, flat punch.

Grid point i along a direction is at x = i L / n.  Heights are measured upward and the rigid flat
comes from above, so each shape touches first at its summit.  Only the sinusoids are band-limited.
The others have kinks or walls, so their area converges with the grid spacing.

To add a shape, write a frozen dataclass like these with its own `kind`, and add its name to the
union `CaseSurface` of `epcontact.surfaces`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.scene import Surface, listed, number, positive, settle, whole
from epcontact.surfaces.recipe import (
    Centre,
    Periods,
    Real,
    Shape,
    Whole,
    described,
    normalise_grid,
    out_of_memory,
)

#: Relative rounding of r^2; without it a rim through grid points would lose some of them.
_ON_THE_RIM = 1e-9

_Radius = Annotated[Real, Field(gt=0, description="m; radius of curvature at the summit")]


@dataclass(frozen=True)
class Sinusoid:
    """Waves along x, along y, or the product of both, with a crest at the origin and zero mean.

    h = amplitude cos X, or amplitude cos X cos Y, with X = 2 pi waves x / Lx and Y likewise: the
    gap under the summits is amplitude (1 - cos) or amplitude (1 - cos cos), the convention of
    Westergaard (1939) and of Johnson, Greenwood and Higginson (1985).  With the wavelength
    lambda = L / waves, complete contact needs the pressure p* = pi E* amplitude / lambda or, for
    the product on a square period, p* = sqrt(2) pi E* amplitude / lambda.

    Args:
        periods: (Lx, Ly), or (L,) for a line, in m.
        shape: grid points (nx, ny), or (nx,) for a line.
        amplitude: in m, from the mean plane to a crest.
        waves: number of waves in a period.
        direction: "x", "y" or "both".

    Raises:
        InvalidScene: if a value is out of its range, or a wave has two grid points or fewer.

    Example:
        >>> surface = Sinusoid((1e-3, 1e-3), (8, 8), amplitude=1e-6, direction="both").build()
        >>> surface.shape, float(surface.heights[0, 0]), surface.shortest_wavelength
        ((8, 8), 1e-06, 0.001)
    """

    periods: Periods
    shape: Shape
    amplitude: Annotated[Real, Field(gt=0, description="m; from the mean plane to a crest")]
    waves: Annotated[Whole, Field(ge=1, description="whole waves in a period")] = 1
    direction: Annotated[
        Literal["x", "y", "both"],
        Field(description="waves along one direction, or the product of both"),
    ] = "x"
    kind: Literal["sinusoid"] = field(default="sinusoid", kw_only=True)

    def __post_init__(self) -> None:
        normalise_grid(self)
        settle(self, amplitude=positive("amplitude", self.amplitude, "m"))
        settle(self, waves=whole("waves", self.waves, 1))
        if self.direction not in ("x", "y", "both"):
            raise InvalidScene(f"direction is {self.direction!r}, but must be x, y or both")
        if self.direction != "x" and len(self.shape) == 1:
            raise InvalidScene(f"direction is {self.direction!r}, but a line has only x")
        for axis in self._axes:
            if self.shape[axis] <= 2 * self.waves:
                raise InvalidScene(
                    f"{self.shape[axis]} grid points do not resolve waves = {self.waves}, which "
                    f"needs at least {2 * self.waves + 1}"
                )

    @property
    def _axes(self) -> tuple[int, ...]:
        return {"x": (0,), "y": (1,), "both": (0, 1)}[self.direction]

    @property
    def fingerprint(self) -> str:
        """The parameters, and the version of the formula."""
        return described("sinusoid/1", self)

    def build(self) -> Surface:
        """Make the heights."""
        heights = _empty(self.shape)
        heights[...] = self.amplitude
        for axis in self._axes:
            n = self.shape[axis]
            # Whole turns are removed as integers, so that equal phases have equal heights.
            turns = (self.waves * np.arange(n)) % n / n
            heights *= _along(np.cos(2 * math.pi * turns), axis, len(self.shape))
        shortest = min(self.periods[axis] for axis in self._axes) / self.waves
        return surface_with(self, heights, shortest_wavelength=shortest)


@dataclass(frozen=True)
class Paraboloid:
    """One bump h = -r^2 / (2 radius) (on a line a parabolic cylinder), summit at h = 0.

    r is the distance to the nearest periodic image.  Hertz's theory is exact for this shape except
    for the effect of the images.

    Args:
        periods: (Lx, Ly), or (L,) for a line, in m.
        shape: grid points (nx, ny), or (nx,) for a line.
        radius: radius of curvature at the summit, in m.
        centre: position of the summit as fractions of the periods, by default the middle.

    Raises:
        InvalidScene: if a length is not positive or the sizes do not fit.

    Example:
        >>> bump = Paraboloid((1e-3, 1e-3), (64, 64), radius=1e-2).build()
        >>> bool(bump.heights[32, 32] == 0.0), f"{bump.heights[32, 0]:.4g} m"
        (True, '-1.25e-05 m')
    """

    periods: Periods
    shape: Shape
    radius: _Radius
    centre: Centre = ()
    kind: Literal["paraboloid"] = field(default="paraboloid", kw_only=True)

    def __post_init__(self) -> None:
        normalise_grid(self)
        settle(self, radius=positive("radius", self.radius, "m"))
        _normalise_centre(self)

    @property
    def fingerprint(self) -> str:
        """The parameters, and the version of the formula."""
        return described("paraboloid/1", self)

    def build(self) -> Surface:
        """Make the heights."""
        heights = squared_distance(self)
        heights *= -0.5 / self.radius
        return surface_with(self, heights)


@dataclass(frozen=True)
class Sphere:
    """The upper half of a ball (on a line, of a cylinder) on a flat, summit at h = 0.

    h = sqrt(radius^2 - r^2) - radius within r < radius, -radius outside.  The arguments and
    errors are those of Paraboloid.

    Example:
        >>> ball = Sphere((1e-3,), (8,), radius=2.5e-4).build()
        >>> [round(1e6 * h) for h in ball.heights]
        [-250, -250, -250, -33, 0, -33, -250, -250]
    """

    periods: Periods
    shape: Shape
    radius: _Radius
    centre: Centre = ()
    kind: Literal["sphere"] = field(default="sphere", kw_only=True)

    def __post_init__(self) -> None:
        normalise_grid(self)
        settle(self, radius=positive("radius", self.radius, "m"))
        _normalise_centre(self)

    @property
    def fingerprint(self) -> str:
        """The parameters, and the version of the formula."""
        return described("sphere/1", self)

    def build(self) -> Surface:
        """Make the heights."""
        # -r^2 / (R + sqrt(R^2 - r^2)) is sqrt(R^2 - r^2) - R without cancellation at the summit.
        heights = squared_distance(self)
        np.minimum(heights, self.radius**2, out=heights)
        heights /= -(self.radius + np.sqrt(self.radius**2 - heights))
        return surface_with(self, heights)


@dataclass(frozen=True)
class FlatPunch:
    """A flat circular plateau (on a line a strip) at h = 0 over a flat floor at h = -depth.

    Grid points on the rim belong to the plateau.

    Args:
        periods: (Lx, Ly), or (L,) for a line, in m.
        shape: grid points (nx, ny), or (nx,) for a line.
        radius: radius of the plateau, or half the width of a strip, in m.
        depth: height of the plateau over the floor, in m.
        centre: centre of the plateau as fractions of the periods, by default the middle.

    Raises:
        InvalidScene: if a length is not positive or the sizes do not fit.

    Example:
        >>> FlatPunch((8.0,), (8,), radius=1.0, depth=0.5).build().heights.tolist()
        [-0.5, -0.5, -0.5, 0.0, 0.0, 0.0, -0.5, -0.5]
    """

    periods: Periods
    shape: Shape
    radius: Annotated[Real, Field(gt=0, description="m; radius, or half-width of a strip")]
    depth: Annotated[Real, Field(gt=0, description="m; height of the post over what surrounds it")]
    centre: Centre = ()
    kind: Literal["flat_punch"] = field(default="flat_punch", kw_only=True)

    def __post_init__(self) -> None:
        normalise_grid(self)
        settle(self, radius=positive("radius", self.radius, "m"))
        settle(self, depth=positive("depth", self.depth, "m"))
        _normalise_centre(self)

    @property
    def fingerprint(self) -> str:
        """The parameters, and the version of the formula."""
        return described("flat_punch/1", self)

    def build(self) -> Surface:
        """Make the heights."""
        heights = squared_distance(self)
        outside = heights > self.radius**2 * (1 + _ON_THE_RIM)
        heights[...] = 0.0
        heights[outside] = -self.depth
        return surface_with(self, heights)


def _normalise_centre(recipe: Any) -> None:
    centre = listed(recipe.centre) or (0.5,) * len(recipe.shape)
    right = f"{len(recipe.shape)} fractions of the period"
    if len(centre) != len(recipe.shape):
        raise InvalidScene(f"centre is {recipe.centre!r}, but must be {right}")
    shares = [number("centre", c, right, math.isfinite) for c in centre]
    settle(recipe, centre=tuple(c % 1.0 for c in shares))


def squared_distance(recipe: Any) -> FloatArray:
    """Return r^2 from each grid point to the nearest image of the centre, in m^2."""
    squared = _empty(recipe.shape)
    squared[...] = 0.0
    grid = zip(recipe.shape, recipe.periods, recipe.centre, strict=True)
    for axis, (n, period, centre) in enumerate(grid):
        offset = np.arange(n) / n - centre
        offset -= np.rint(offset)
        squared += _along((period * offset) ** 2, axis, len(recipe.shape))
    return squared


def _along(values: FloatArray, axis: int, dimensions: int) -> FloatArray:
    return values.reshape([-1 if a == axis else 1 for a in range(dimensions)])


def _empty(shape: tuple[int, ...]) -> FloatArray:
    try:
        return np.empty(shape)
    except MemoryError:
        raise out_of_memory(shape, arrays=1) from None


def surface_with(
    recipe: Any, heights: FloatArray, shortest_wavelength: float | None = None
) -> Surface:
    """Make the surface of a recipe from its heights, which become read-only."""
    heights.flags.writeable = False
    return Surface(
        heights,
        recipe.periods,
        shortest_wavelength=shortest_wavelength,
        recipe=recipe.fingerprint,
    )
