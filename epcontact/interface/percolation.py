"""Connected patches of a periodic mask, and the area fraction that percolates.

A patch percolates if it connects with its own periodic image.  Points join their
patches one by one (Newman and Ziff, Phys. Rev. E 64, 016706 (2001)).  Each patch is a
tree: every point has a parent in its patch, and the parents lead to the root.  With its
parent a point keeps the displacement to it, counted in points without the period.

If a neighbour has the same root, there are two ways from the point to the root: its own
one, and the step to the neighbour with the neighbour's way.  Their displacements are
equal, unless the patch meets its own periodic image (Machta et al., Phys. Rev. E 54,
1332 (1996)).

A displacement of x rows and y columns is kept as one number, x ROW + y, so that
displacements add and compare as numbers do.
"""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.workers import compiled
from epcontact.interface.limit import Limit

Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]

#: The number of a displacement by one row.  Displacements in columns are far smaller.
ROW = 1 << 32


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
    points = np.flatnonzero(mask)
    count, parent, offset = _join(points, mask.shape, diagonals, stop=False)
    roots = find_roots(points, parent, offset)
    is_root = parent == np.arange(mask.size)
    number_of_root = np.cumsum(is_root) - 1
    return number_of_root[roots], count > 0


def percolation_fraction(closeness: NDArray[np.floating]) -> Limit:
    """Return the smallest fraction of the area, closest points first, that percolates.

    A grid does not show whether two points that touch at a corner are connected.  If
    points connect over their sides only, they percolate too late, and if they connect
    over their corners as well, too early.  The limit is the mean of the two fractions.

    The error has two parts: half of the difference of these fractions, and the root
    mean square of the differences between the limit and those of every second point.

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
    order = np.argsort(-closeness, axis=None, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(order.size)
    rank = rank.reshape(closeness.shape)
    by_sides, by_corners = _spanning_fractions(rank)
    limit = (by_sides + by_corners) / 2
    every_second = (slice(0, None, 2), slice(1, None, 2))
    differences = []
    for points in itertools.product(every_second, repeat=closeness.ndim):
        coarse = _spanning_fractions(rank[points])
        differences.append(sum(coarse) / 2 - limit)
    scatter = math.sqrt(np.mean(np.square(differences)))
    error = math.hypot((by_sides - by_corners) / 2, scatter)
    return Limit(limit, by_sides, error)


def _spanning_fractions(rank: Indices) -> tuple[float, float]:
    """Return the fractions of the points of a grid at which a patch first percolates.

    The points of the periodic grid are added one by one, and a patch percolates as soon
    as it connects with its own periodic image.

    Args:
        rank: (nx, ny) or (nx,), different integers; points of smaller rank are added
            earlier.

    Returns:
        The fraction if points connect over their sides only, and the fraction if they
        connect over their corners as well.
    """
    order = np.argsort(rank, axis=None)
    by_sides = _join(order, rank.shape, diagonals=False, stop=True)[0]
    by_corners = _join(order, rank.shape, diagonals=True, stop=True)[0]
    return by_sides / order.size, by_corners / order.size


def _join(
    order: Indices, shape: tuple[int, ...], diagonals: bool, stop: bool
) -> tuple[int, NDArray[Any], NDArray[np.int64]]:
    """Join the points of an empty periodic grid to connected patches.

    Each patch is a tree: every point has a parent, and the parents lead to the root.

    Args:
        order: the flat indices of the points, in the order in which they join.
        shape: the grid, (nx, ny) or (nx,).
        diagonals: True if points also connect over their corners.
        stop: True to end as soon as a patch percolates.

    Returns:
        How many points had joined when a patch first percolated, or 0; the flat index
        of the parent of each point of the grid, -1 where no point has joined; and the
        displacement to the parent as one number, rows times ROW plus columns.
    """
    size = math.prod(shape)
    integer = np.int32 if size < 2**31 else np.int64
    parent = np.full(size, -1, dtype=integer)
    offset = np.zeros(size, dtype=np.int64)
    rows = size // shape[-1]
    steps = _steps_to_neighbours(len(shape), diagonals)
    count = join_points(order, (rows, shape[-1]), steps, parent, offset, stop)
    return count, parent, offset


def _steps_to_neighbours(dimensions: int, diagonals: bool) -> Indices:
    """Return the steps from a grid point to its neighbours, shape (steps, 2).

    A step is the number of rows and the number of columns: -1, 0 or 1.

    Args:
        dimensions: 2 for a surface, 1 for a line, whose points have neighbours along
            the second axis only.
        diagonals: True if the four neighbours over the corners count, too.
    """
    steps = np.argwhere(np.ones((3,) * dimensions)) - 1
    distance = np.abs(steps).sum(axis=1)
    farthest = dimensions if diagonals else 1
    steps = steps[(distance > 0) & (distance <= farthest)]
    return np.pad(steps, [(0, 0), (2 - dimensions, 0)])


@compiled
def periodic_index(index: int, size: int) -> int:
    """Return an index along a periodic axis as one between 0 and size - 1.

    The index must be from -1 to size, at most one point beyond an end of the axis.
    """
    if index < 0:
        return index + size
    if index >= size:
        return index - size
    return index


@compiled
def find_root(parent: Any, offset: Any, point: int) -> tuple[int, int]:
    """Return the root of the tree of a point, and the displacement from point to root.

    The points on the way are attached to the parents of their parents, in place, so
    that later searches are shorter.

    Args:
        parent: (points,) the flat index of the parent of each point; a root is its own.
        offset: (points,) the displacement to the parent, rows times ROW plus columns.
        point: the flat index of the point.

    Returns:
        The flat index of the root, and the displacement as one number like `offset`.
    """
    displacement = 0
    while parent[point] != point:
        above = parent[point]
        parent[point] = parent[above]
        offset[point] += offset[above]
        displacement += offset[point]
        point = parent[point]
    return point, displacement


@compiled
def find_roots(points: Any, parent: Any, offset: Any) -> Any:
    """Return the flat index of the root of the tree of each listed point.

    Args:
        points: (n,) flat indices of the points.
        parent: (grid points,) the flat index of each parent; changed in place.
        offset: (grid points,) the displacement to the parent; changed in place.
    """
    roots = np.empty_like(points)
    for k in range(points.size):
        roots[k] = find_root(parent, offset, points[k])[0]
    return roots


@compiled
def join_points(
    order: Any,
    shape: tuple[int, int],
    steps: Any,
    parent: Any,
    offset: Any,
    stop: bool,
) -> int:
    """Join points of a periodic grid to connected patches, one by one.

    Args:
        order: (n,) flat indices of the points, in the order in which they join.
        shape: the numbers of rows and columns of the grid.
        steps: (steps, 2) rows and columns from a point to each of its neighbours.
        parent: (grid points,) flat index of the parent of each point, -1 for points
            that have not joined; changed in place.
        offset: (grid points,) displacement to the parent, rows times ROW plus columns;
            changed in place.
        stop: True to end as soon as a patch percolates.

    Returns:
        How many points had joined when a patch first percolated; 0 if none did.
    """
    rows, columns = shape
    spanning = 0
    for count in range(order.size):
        point = order[count]
        parent[point] = point
        row = point // columns
        column = point - row * columns
        for k in range(steps.shape[0]):
            i = periodic_index(row + steps[k, 0], rows)
            j = periodic_index(column + steps[k, 1], columns)
            neighbour = i * columns + j
            if parent[neighbour] < 0:
                continue
            root, to_root = find_root(parent, offset, point)
            other, to_other = find_root(parent, offset, neighbour)
            between = ROW * steps[k, 0] + steps[k, 1] + to_other - to_root
            if root != other:
                parent[root] = other
                offset[root] = between
            elif between != 0 and spanning == 0:
                spanning = count + 1
        if stop and spanning > 0:
            break
    return spanning
