"""Connected patches of a periodic mask, and the area fraction that percolates.

A patch percolates if it connects with its own periodic image (`runs`).  The points that
are closest join first.  Nearly all of them join at once, as runs, up to a guess of the
fraction at which a patch percolates; only the few points near this fraction are sorted
and join one by one.  The fractions of coarser grids give the guess.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidCase
from epcontact.interface.limit import Limit
from epcontact.interface.runs import (
    add_points,
    find_roots,
    join,
    label_points,
    runs_above,
)

Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

# The fraction of every so many points along each direction gives the first guess.
_COARSE = 8
# The fractions of this coarse grid and of every second point differ by less than this
# on most surfaces.  A wider interval costs more points that join one by one.
_COARSE_MARGIN = 0.02
# The same for every second point and all points, and for sides and corners.
_MARGIN = 0.004
# Values from which the cut of a fraction is estimated.  It is then off by a quarter of
# _MARGIN, which costs time only.
_SAMPLE = 1 << 17

#: Points of a block of rows, half a megabyte, which stays in the cache of a core.
_BLOCK_POINTS = 1 << 16

# Factors in the error: of what the grid itself shows by sides, corners and every second
# point, and of the change on a grid with interpolated midpoints.  They come from nine
# kinds of surfaces, among them ridges, plateaus and spheres, where one saddle decides
# (`laboratory.patches --kinds`).
_GRID = 1.5
_SADDLES = 2.0


class Patches(NamedTuple):
    """The connected patches of a mask on a periodic grid.

    Attributes:
        areas: (patches,) their areas over the nominal area, the largest first.
        spans: True if a patch percolates.
    """

    areas: NDArray[np.float64]
    spans: bool


def find_patches(mask: Mask, diagonals: bool = False) -> Patches:
    """Return the areas of the connected patches of a mask, and whether one percolates.

    Args:
        mask: (nx, ny) or (nx,), True at the points that may connect.  The grid is
            periodic.
        diagonals: False if points connect over their sides only, True if they connect
            over their corners as well.

    Example:
        >>> found = find_patches(np.array([True, False, True, True]))
        >>> found.areas.tolist(), found.spans
        ([0.75], False)
    """
    numbers, spans = number_patches(mask, diagonals)
    areas = np.sort(np.bincount(numbers))[::-1] / mask.size
    return Patches(areas, spans)


def number_patches(mask: Mask, diagonals: bool = False) -> tuple[Indices, bool]:
    """Return the patch number of each point of a mask, and whether a patch percolates.

    Args:
        mask, diagonals: as of `find_patches`.

    Returns:
        The numbers, counted from 0, of the points in the order of `mask.nonzero()`; and
        True if a patch percolates.
    """
    values = np.atleast_2d(mask).astype(np.float64)
    runs = runs_above(values, 0.5, math.inf)
    forest, spans = join(runs, values.shape[1], diagonals, line=mask.ndim == 1)
    roots = find_roots(*forest, runs.starts.size)
    _, number_of_run = np.unique(roots, return_inverse=True)
    return np.repeat(number_of_run, runs.ends - runs.starts), spans


def percolation_fraction(closeness: NDArray[np.floating]) -> Limit:
    """Return the smallest fraction of the area, closest points first, that percolates.

    A grid does not show whether two points that touch at a corner are connected.  If
    points connect over their sides only, they percolate too late, and if they connect
    over their corners as well, too early.  The limit is the mean of the two fractions.

    The error has three parts: `_GRID` times half of the difference of these fractions;
    `_GRID` times the root mean square of the differences between the limit and those of
    every second point; and `_SADDLES` times the change of the limit on a grid twice as
    fine, with cubic interpolation.  The third part counts where one saddle decides:
    sides and corners then agree, but a saddle between grid points may be higher or
    lower than the grid shows.

    Args:
        closeness: (nx, ny) or (nx,), at least two points a direction; larger where the
            surfaces are closer, for example minus the gap.  With its sign changed, the
            function returns the fraction at which the open gap percolates.  Of equal
            values the one with the smaller index counts as closer.

    Returns:
        The limit; its `raw` value is that of points that connect over their sides.

    Raises:
        InvalidCase: the array has fewer than two points a direction, or numbers that
            are not finite.

    Example:
        >>> percolation_fraction(np.array([[3.0, 2.0, 1.0], [0.0, -1.0, -2.0]])).raw
        0.5
    """
    values = np.ascontiguousarray(closeness, dtype=np.float64)
    if values.ndim not in (1, 2) or min(values.shape) < 2:
        raise InvalidCase(
            f"closeness has the shape {values.shape}, but must be a line (nx,) or a "
            "grid (nx, ny) of two points a direction or more"
        )
    if not np.isfinite(values).all():
        raise InvalidCase("closeness holds NaN or infinity; give finite numbers")
    coarse = values[(slice(None, None, _COARSE),) * values.ndim]
    guess = _spanning_fraction(coarse, False, 0.5, 0.5)
    margin = _COARSE_MARGIN
    by_sides = []
    by_corners = []
    every_second = (slice(0, None, 2), slice(1, None, 2))
    for points in itertools.product(every_second, repeat=values.ndim):
        grid = np.ascontiguousarray(values[points])
        guess = _spanning_fraction(grid, False, guess, margin)
        margin = _MARGIN
        by_sides.append(guess)
        by_corners.append(_spanning_fraction(grid, True, guess, margin))
    sides = _spanning_fraction(values, False, guess, margin)
    corners = _spanning_fraction(values, True, sides, margin)
    limit = (sides + corners) / 2
    differences = (np.array(by_sides) + by_corners) / 2 - limit
    scatter = math.sqrt(np.mean(np.square(differences)))
    finer = _with_midpoints(values)
    finer_sides = _spanning_fraction(finer, False, sides, margin / 2)
    finer_corners = _spanning_fraction(finer, True, finer_sides, margin / 4)
    change = (finer_sides + finer_corners) / 2 - limit
    of_grid = math.hypot((sides - corners) / 2, scatter)
    return Limit(limit, sides, math.hypot(_GRID * of_grid, _SADDLES * change))


def _with_midpoints(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a field on a grid twice as fine, by cubic interpolation along each axis.

    Args:
        values: (nx, ny) or (nx,), periodic, in any unit.
    """
    if values.ndim == 1:
        finer_line: NDArray[np.float64] = _midpoints_along_rows(values[None])[0]
        return finer_line
    rows, columns = values.shape
    finer = np.empty((2 * rows, 2 * columns))
    step = max(1, _BLOCK_POINTS // columns)
    for start in range(0, rows, step):
        block = slice(start, min(start + step, rows))
        # One row before the block and two after it are needed.
        around = values[np.arange(start - 1, block.stop + 2) % rows]
        between = (9 * (around[1:-2] + around[2:-1]) - (around[:-3] + around[3:])) / 16
        finer[2 * start : 2 * block.stop : 2] = _midpoints_along_rows(around[1:-2])
        finer[2 * start + 1 : 2 * block.stop : 2] = _midpoints_along_rows(between)
    return finer


def _midpoints_along_rows(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return periodic rows (rows, columns) with twice as many columns.

    A midpoint is the value of the cubic polynomial through the four points around it.
    """
    around = np.pad(values, [(0, 0), (1, 2)], mode="wrap")
    inner = around[:, 1:-2] + around[:, 2:-1]
    outer = around[:, :-3] + around[:, 3:]
    return np.stack([values, (9 * inner - outer) / 16], axis=-1).reshape(
        len(values), -1
    )


def _spanning_fraction(
    closeness: NDArray[np.float64], diagonals: bool, guess: float, margin: float
) -> float:
    """Return the fraction of the points, closest first, at which a patch percolates.

    The result does not depend on the guess, but the time does.

    Args:
        closeness: (nx, ny) or (nx,); of equal values the one with the smaller index
            joins first.
        diagonals: True if points also connect over their corners.
        guess: the expected result.
        margin: how far the guess may be off.
    """
    line = closeness.ndim == 1
    values = np.ascontiguousarray(np.atleast_2d(closeness))
    stride = max(1, values.size // _SAMPLE) | 1  # odd: it meets all columns of the grid
    sample = np.sort(values.reshape(-1)[::stride])
    low = guess - margin
    high = guess + margin
    while True:
        runs = runs_above(values, _cut(sample, low), _cut(sample, high))
        forest, spans = join(runs, values.shape[1], diagonals, line)
        if spans:
            high = low
            low -= 4 * margin
            margin *= 4
            continue
        order = runs.below[np.argsort(-values.flat[runs.below], kind="stable")]
        label = np.full(values.shape, -1, dtype=np.int32)
        label_points(runs.starts, runs.ends, runs.first, label)
        steps = _steps_to_neighbours(line, diagonals)
        count = add_points(order, steps, label, runs.starts.size, *forest)
        if count:
            return float((runs.points + count) / values.size)
        low = high
        high += 4 * margin
        margin *= 4


def _cut(sample: NDArray[np.float64], fraction: float) -> float:
    """Return the value above which about a fraction of all values is.

    It is infinite for a fraction of 0 or less, and minus infinite for one of 1 or more.

    Args:
        sample: (n,) some of the values in rising order.
        fraction: the fraction.
    """
    above = round(fraction * sample.size)
    if above <= 0:
        return math.inf
    if above >= sample.size:
        return -math.inf
    return float(sample[-above - 1])


def _steps_to_neighbours(line: bool, diagonals: bool) -> Indices:
    """Return the steps from a grid point to its neighbours, shape (steps, 2).

    A step is the number of rows and the number of columns: -1, 0 or 1.

    Args:
        line: True if the grid is a line, whose points have neighbours along the second
            axis only.
        diagonals: True if the four neighbours over the corners count, too.
    """
    steps: Indices = np.argwhere(np.ones((3, 3))) - 1
    distance = np.abs(steps).sum(axis=1)
    keep = (distance > 0) & (distance <= 1 + diagonals)
    if line:
        keep &= steps[:, 0] == 0
    return np.asarray(steps[keep])
