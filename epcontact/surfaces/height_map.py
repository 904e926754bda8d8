"""The heights of a file, as it stores them, and maps from lists of points on a grid."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray

#: The notes on which direction of a map is x: of an array, of a picture, and of a file
#: that names the directions itself.
AS_ARRAY = "x runs along the first index of the array (from row to row), y along a row"
AS_PICTURE = (
    "x runs along the lines of the file and y from line to line, as in its picture"
)
AS_STATED = "x and y are those that the file states"
#: Distance of a coordinate from a regular grid, over its step, that counts as none:
#: files keep few digits.
_OFF_GRID = 0.01
#: Relative difference of two lengths, beyond a step of the grid, that counts as none:
#: people round lengths.
_SAME_LENGTH = 0.01


@dataclass(frozen=True, eq=False)
class HeightMap:
    """The heights of a file, as it stores them."""

    heights: NDArray[Any]  #: (nx, ny) or (nx,) in `unit`, NaN where one is missing.
    unit: float | None = None  #: Unit of the heights in m, if the file states it.
    #: Lengths of the map along x and y in `length_unit`, if the file states them.
    periods: tuple[float, ...] | None = None
    #: Unit of the lengths in m; None if they are in the unit of the heights, or in a
    #: unit that the file does not state.
    length_unit: float | None = None
    unit_source: str = ""  #: How the file states the unit, for messages.
    size_source: str = ""  #: How the file states the lengths, for messages.
    notes: tuple[str, ...] = ()  #: Sentences on how the file was read.
    orientation: str = AS_STATED  #: The note on which direction of the file is x.
    #: Mask of the heights that were filled before, if the file is a result with some.
    filled: NDArray[np.bool_] | None = None
    #: Heights of the same points that another interpolation gives, of the same shape
    #: and unit; None if no heights were interpolated.
    otherwise: FloatArray | None = None

    def transposed(self) -> HeightMap:
        """Return this map with x and y exchanged, its lengths included."""
        return replace(
            self,
            heights=self.heights.T,
            periods=None if self.periods is None else self.periods[::-1],
            filled=None if self.filled is None else self.filled.T,
            orientation=f"transpose exchanged x and y; before, {self.orientation}",
        )


def lengths_agree(first: float, second: float, points: int) -> bool:
    """Return True if two lengths of a map differ by less than a step and 1 % of them.

    Some programs count the steps between the points, and others the points.

    Args:
        first, second: the lengths in one unit, positive.
        points: the number of points along the length.
    """
    largest = max(first, second)
    return abs(first - second) <= (_SAME_LENGTH + 1 / points) * largest


def map_of_points(points: FloatArray, path: Path) -> HeightMap:
    """Return the map of points on a regular grid; NaN where the grid has no point.

    Args:
        points: x, y and height of each point, (n, 3), in any order.
        path: the file of the points, for a message.

    Raises:
        InvalidScene: The points lie on no grid, on less than half of its places, or
            above each other.
    """
    has_columns = points.shape[1:] == (3,) and len(points) >= 4
    if has_columns and np.isfinite(points[:, :2]).all():
        x, dx = grid_indices(points[:, 0])
        y, dy = grid_indices(points[:, 1])
        nx = int(x.max()) + 1
        ny = int(y.max()) + 1
        is_grid = dx * dy > 0 and min(nx, ny) >= 2
        if is_grid and nx * ny <= 2 * len(points):
            heights = np.full((nx, ny), np.nan)
            heights[x, y] = points[:, 2]
            none_above_another = np.array_equal(
                heights[x, y], points[:, 2], equal_nan=True
            )
            if none_above_another:
                periods = (nx * dx, ny * dy)
                return HeightMap(
                    heights,
                    periods=periods,
                    size_source="the x and y of its points",
                )
    raise InvalidScene(
        f"{path}: its points are no height map: they lie on no regular grid in x and "
        "y, or above each other; sample them on a grid first, or export the heights "
        "alone, line by line"
    )


def grid_indices(values: FloatArray) -> tuple[NDArray[np.intp], float]:
    """Return the grid index of each coordinate along one axis, and the grid's spacing.

    Args:
        values: the coordinates of the points along the axis, shape (n,), in any unit
            and order.

    Returns:
        The indices from 0, shape (n,), and the spacing in the unit of the coordinates;
        0 if the coordinates are on no grid of even spacing.
    """
    span = float(np.ptp(values))
    if span == 0 or not np.isfinite(span):
        return np.zeros(values.size, np.intp), 0.0
    gaps = np.diff(np.unique(values))
    usual_gap = float(np.median(gaps[gaps > _OFF_GRID * gaps.max()]))
    step = span / round(span / usual_gap)
    positions = (values - values.min()) / step
    index = np.rint(positions).astype(np.intp)
    is_even = np.abs(positions - index).max() <= _OFF_GRID
    return index, step if is_even else 0.0
