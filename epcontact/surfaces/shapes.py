"""Surfaces with closed-form contact solutions: sinusoids, paraboloid, sphere, flat
punch.

Grid point i along a direction is at x = i L / n.  Heights are measured upward and the
rigid flat comes from above, so each shape touches first at its summit.  Only the
sinusoids are band-limited.  The others have kinks or walls, and their contact areas
depend on the grid spacing until it is small.

To add a shape, write a frozen dataclass like these with its own `kind` and `formula`,
and add its name to the union `CaseSurface` of `epcontact.surfaces`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import StrictFloat, StrictInt

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.scene import as_tuple, number, set_frozen
from epcontact.surfaces.recipe import (
    Generated,
    Periods,
    Shape,
    entry,
    sequence,
)

#: Relative rounding error of r^2 that is allowed for grid points on a rim.  Without it
#: some of them would count as outside.
_ON_THE_RIM = 1e-9

_Centre = Annotated[
    tuple[StrictFloat, ...],
    sequence(float),
    entry("", "as fractions of the periods; the middle where it is not given"),
]


@dataclass(frozen=True)
class Sinusoid(Generated):
    """Waves along x, along y, or the product of both, with a crest at the origin and
    zero mean.

    h = amplitude cos X, or amplitude cos X cos Y, with X = 2 pi waves x / Lx and Y
    likewise, as in Westergaard (1939) and in Johnson, Greenwood and Higginson (1985).
    With lambda = L / waves, complete contact needs the pressure p* = pi E* amplitude /
    lambda, or sqrt(2) times as much for the product on a square period.  A wave needs
    more than two grid points.

    Example:
        >>> recipe = Sinusoid((1e-3, 1e-3), (8, 8), amplitude=1e-6, direction="both")
        >>> surface = recipe.build()
        >>> surface.shape, float(surface.heights[0, 0]), surface.shortest_wavelength
        ((8, 8), 1e-06, 0.001)
    """

    formula = "sinusoid/1"
    periods: Periods
    shape: Shape
    amplitude: Annotated[
        StrictFloat, entry("m", "from the mean plane to a crest", gt=0)
    ]
    waves: Annotated[StrictInt, entry("", "whole waves in a period", ge=1)] = 1
    direction: Annotated[
        Literal["x", "y", "both"],
        entry("", "waves along one direction, or the product of both"),
    ] = "x"
    kind: Literal["sinusoid"] = field(default="sinusoid", kw_only=True)

    def __post_init__(self) -> None:
        """Check the fields of this sinusoid.

        Raises InvalidScene if a field is out of its range, if a line has waves along y,
        or if a wave has two grid points or fewer.
        """
        super().__post_init__()
        if self.direction != "x" and len(self.shape) == 1:
            raise InvalidScene(
                f"direction is {self.direction!r}, but a line has only x"
            )
        for axis in self._axes:
            if self.shape[axis] <= 2 * self.waves:
                raise InvalidScene(
                    f"{self.shape[axis]} grid points do not resolve waves = "
                    f"{self.waves}, which needs at least {2 * self.waves + 1}"
                )

    @property
    def _axes(self) -> tuple[int, ...]:
        """The axes along which this surface has waves: 0 for x, 1 for y."""
        return {"x": (0,), "y": (1,), "both": (0, 1)}[self.direction]

    def _heights(self) -> FloatArray:
        """Return the heights of this sinusoid in m, of the shape of its grid."""
        waves = [np.ones(n) for n in self.shape]
        for axis in self._axes:
            n = self.shape[axis]
            # Whole turns are removed as integers, so that equal phases have equal
            # heights.
            waves[axis] = np.cos(2 * math.pi * ((self.waves * np.arange(n)) % n / n))
        return np.asarray(math.prod(np.ix_(*waves), start=self.amplitude))

    def _about(self) -> dict[str, Any]:
        """Return the shortest wavelength of this sinusoid in m, by its name."""
        shortest_period = min(self.periods[axis] for axis in self._axes)
        return {"shortest_wavelength": shortest_period / self.waves}


class _Centred(Generated):
    """The base of shapes about a `centre`, by default the middle of the period."""

    def __post_init__(self: Any) -> None:
        """Check the fields of this shape, and set its centre to fractions in [0, 1).

        Raises InvalidScene if a field is out of its range, or if the centre is not one
        finite number for each direction.
        """
        super().__post_init__()
        centre = as_tuple(self.centre) or (0.5,) * len(self.shape)
        expected = f"{len(self.shape)} fractions of the period"
        if len(centre) != len(self.shape):
            raise InvalidScene(f"centre is {self.centre!r}, but must be {expected}")
        fractions = [number("centre", c, expected, math.isfinite) for c in centre]
        set_frozen(self, centre=tuple(c % 1.0 for c in fractions))


@dataclass(frozen=True)
class _Round(_Centred):
    """The fields of shapes with a round summit."""

    periods: Periods
    shape: Shape
    radius: Annotated[
        StrictFloat, entry("m", "radius of curvature at the summit", gt=0)
    ]
    centre: _Centre = ()


@dataclass(frozen=True)
class Paraboloid(_Round):
    """One bump h = -r^2 / (2 radius) (on a line a parabolic cylinder), summit at h = 0.

    r is the distance to the nearest periodic image.  Hertz's theory is exact for this
    shape except for the effect of the images.

    Example:
        >>> bump = Paraboloid((1e-3, 1e-3), (64, 64), radius=1e-2).build()
        >>> bool(bump.heights[32, 32] == 0.0), f"{bump.heights[32, 0]:.4g} m"
        (True, '-1.25e-05 m')
    """

    formula = "paraboloid/1"
    kind: Literal["paraboloid"] = field(default="paraboloid", kw_only=True)

    def _heights(self) -> FloatArray:
        """Return the heights of this paraboloid in m, of the shape of its grid."""
        return squared_distance(self) * (-0.5 / self.radius)


@dataclass(frozen=True)
class Sphere(_Round):
    """The upper half of a ball (on a line, of a cylinder) on a flat, summit at h = 0.

    h = sqrt(radius^2 - r^2) - radius within r < radius, -radius outside; r as in
    Paraboloid.

    Example:
        >>> ball = Sphere((1e-3,), (8,), radius=2.5e-4).build()
        >>> [round(1e6 * h) for h in ball.heights]
        [-250, -250, -250, -33, 0, -33, -250, -250]
    """

    formula = "sphere/1"
    kind: Literal["sphere"] = field(default="sphere", kw_only=True)

    def _heights(self) -> FloatArray:
        """Return the heights of this half ball in m, of the shape of its grid."""
        # -r^2 / (R + sqrt(R^2 - r^2)) is sqrt(R^2 - r^2) - R without cancellation at
        # the summit.
        within = np.minimum(squared_distance(self), self.radius**2)
        return np.asarray(within / -(self.radius + np.sqrt(self.radius**2 - within)))


@dataclass(frozen=True)
class FlatPunch(_Centred):
    """A flat circular plateau (on a line a strip) at h = 0 over a flat floor at h =
    -depth.

    Grid points on the rim belong to the plateau.

    Example:
        >>> FlatPunch((8.0,), (8,), radius=1.0, depth=0.5).build().heights.tolist()
        [-0.5, -0.5, -0.5, 0.0, 0.0, 0.0, -0.5, -0.5]
    """

    formula = "flat_punch/1"
    periods: Periods
    shape: Shape
    radius: Annotated[StrictFloat, entry("m", "radius, or half-width of a strip", gt=0)]
    depth: Annotated[
        StrictFloat, entry("m", "height of the post over what surrounds it", gt=0)
    ]
    centre: _Centre = ()
    kind: Literal["flat_punch"] = field(default="flat_punch", kw_only=True)

    def _heights(self) -> FloatArray:
        """Return the heights of this punch in m, of the shape of its grid.

        They are 0 on the plateau and -depth around it.
        """
        outside = squared_distance(self) > self.radius**2 * (1 + _ON_THE_RIM)
        return np.where(outside, -self.depth, 0.0)


def squared_distance(recipe: Any) -> FloatArray:
    """Return the squared distance of each grid point to the centre of a periodic shape.

    Of the periodic images of the centre, the nearest one counts.

    Args:
        recipe: its `shape` (grid points along each direction), `periods` (m) and
            `centre` (fractions of the periods) are used.

    Returns:
        The squares in m^2, of the shape of the grid.
    """
    squares = []
    for n, period, centre in zip(
        recipe.shape, recipe.periods, recipe.centre, strict=True
    ):
        offset = np.arange(n) / n - centre
        squares.append((period * (offset - np.rint(offset))) ** 2)
    return np.asarray(sum(np.ix_(*squares)))
