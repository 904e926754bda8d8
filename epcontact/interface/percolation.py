"""Connected patches of a periodic mask, and the area fraction that percolates.

A patch percolates if it connects with its own periodic image (`runs`).  The points that
are closest join first.  Nearly all of them join at once, as runs, up to a guess of the
fraction at which a patch percolates; only the few points near this fraction are sorted
and join one by one.  The fractions of coarser grids give the guess.
"""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.workers import compiled
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

    Example:
        >>> percolation_fraction(np.array([[3.0, 2.0, 1.0], [0.0, -1.0, -2.0]])).raw
        0.5
    """
    values = np.ascontiguousarray(closeness, dtype=np.float64)
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
        values: (nx, ny) or (nx,), periodic and contiguous, in any unit.
    """
    shape = [2 * size for size in values.shape]
    finer = np.empty(shape)
    interpolate_rows(np.atleast_2d(values), np.atleast_2d(finer))
    return finer


@compiled
def interpolate_rows(values: Any, finer: Any) -> None:
    """Interpolate a periodic field to a grid twice as fine.

    A midpoint is the value of the cubic polynomial through the four points around it.

    Args:
        values: (rows, columns).
        finer: overwritten; it has twice as many columns, and twice as many rows, unless
            `values` is a line with a single row.
    """
    rows, columns = values.shape
    between = np.empty(columns)
    for row in range(rows):
        interpolate_row(values[row], finer[row * finer.shape[0] // rows])
        if finer.shape[0] == rows:
            continue
        outer = row - 1
        following = (row + 1) % rows
        second = (row + 2) % rows
        for column in range(columns):
            inner_sum = values[row, column] + values[following, column]
            outer_sum = values[outer, column] + values[second, column]
            between[column] = (9 * inner_sum - outer_sum) / 16
        interpolate_row(between, finer[2 * row + 1])


@compiled
def interpolate_row(values: Any, finer: Any) -> None:
    """Interpolate a periodic row to twice as many points; see `interpolate_rows`.

    Args:
        values: (columns,).
        finer: (2 columns,), overwritten: values and midpoints in turn.
    """
    columns = values.size
    for column in range(columns):
        inner_sum = values[column] + values[(column + 1) % columns]
        outer_sum = values[column - 1] + values[(column + 2) % columns]
        finer[2 * column] = values[column]
        finer[2 * column + 1] = (9 * inner_sum - outer_sum) / 16


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
