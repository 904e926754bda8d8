"""Runs of points on a periodic grid, and the patches that they join to.

A run is a row's consecutive points above a cut, between two points that are not.  The
runs of neighbouring rows join where they touch, and points join one by one after them
(Newman and Ziff, Phys. Rev. E 64, 016706 (2001)).  A node is a run or such a point.
Each patch is a tree: every node has a parent in its patch, and the parents lead to the
root.  With its parent a node keeps the winding to it: how many periods the way from the
node to its parent crosses.

If a neighbour has the same root, there are two ways from a node to the root: its own
one, and the step to the neighbour with the neighbour's way.  Their windings are equal,
unless the patch meets its own periodic image (Machta et al., Phys. Rev. E 54, 1332
(1996)): it percolates.

A winding by x periods along the columns and y along the rows is kept as one number,
x ROW + y, so that windings add and compare as numbers do.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.workers import compiled

#: The number of a winding by one period from row to row.  Windings within a row are far
#: smaller: no way has so many crossings.
ROW = 1 << 32


class Runs(NamedTuple):
    """The runs of a grid's points above a cut, row by row.

    Attributes:
        starts: (runs,) column of the first point of each run.
        ends: (runs,) column after the last point of each run.
        first: (rows + 1,) index of the first run of each row.
        points: the number of points in all runs.
        below: flat indices of the points below the cut but above a lower one, in rising
            order.
    """

    starts: NDArray[np.int32]
    ends: NDArray[np.int32]
    first: NDArray[np.int64]
    points: int
    below: NDArray[np.int64]


class Forest(NamedTuple):
    """The trees of nodes that patches are.

    Attributes:
        parent: (nodes,) the parent of each node; a root is its own.
        winding: (nodes,) the winding to the parent, columns times ROW plus rows.
    """

    parent: NDArray[np.int32]
    winding: NDArray[np.int64]


def runs_above(values: NDArray[np.float64], cut: float, lower: float) -> Runs:
    """Return the runs of the points whose values are above a cut.

    Args:
        values: (rows, columns), contiguous.
        cut: points of larger values are in the runs.
        lower: points of values above this one, but not above the cut, are listed as
            `Runs.below`.
    """
    rows, columns = values.shape
    # Memory that no run needs is never touched.
    most = rows * (columns // 2 + 1)
    starts = np.empty(most, dtype=np.int32)
    ends = np.empty(most, dtype=np.int32)
    first = np.empty(rows + 1, dtype=np.int64)
    below = np.empty(values.size, dtype=np.int64)
    points, listed = find_runs(values, cut, lower, starts, ends, first, below)
    count = first[rows]
    return Runs(starts[:count], ends[:count], first, points, below[:listed])


def join(runs: Runs, columns: int, diagonals: bool, line: bool) -> tuple[Forest, bool]:
    """Return the patches of the runs, and True if one of them percolates.

    Args:
        runs: the runs of a periodic grid.
        columns: the number of columns of the grid.
        diagonals: True if points also connect over their corners.
        line: True if the grid is a line, whose only row has no neighbours.

    Returns:
        The forest has a node for each run, and room for each point in `runs.below`.
    """
    count = runs.starts.size
    nodes = count + runs.below.size
    forest = Forest(np.arange(nodes, dtype=np.int32), np.zeros(nodes, dtype=np.int64))
    spans = join_runs(
        runs.starts, runs.ends, runs.first, columns, diagonals, line, *forest
    )
    return forest, bool(spans)


@compiled
def find_runs(
    values: Any,
    cut: float,
    lower: float,
    starts: Any,
    ends: Any,
    first: Any,
    below: Any,
) -> tuple[int, int]:
    """Write the runs of points above a cut, and list those between two cuts.

    Args:
        values: (rows, columns).
        cut, lower: see `runs_above`.
        starts, ends: memory for the first column of each run and that after its last.
        first: (rows + 1,) memory for the index of the first run of each row.
        below: memory for the flat indices of points above `lower` and not above `cut`.

    Returns:
        The number of points in the runs, and the number of those listed in `below`.
    """
    rows, columns = values.shape
    count = points = listed = 0
    for row in range(rows):
        first[row] = count
        inside = False
        for column in range(columns):
            value = values[row, column]
            if value > cut:
                if not inside:
                    starts[count] = column
                    inside = True
            else:
                if inside:
                    ends[count] = column
                    points += column - starts[count]
                    count += 1
                    inside = False
                if value > lower:
                    below[listed] = row * columns + column
                    listed += 1
        if inside:
            ends[count] = columns
            points += columns - starts[count]
            count += 1
    first[rows] = count
    return points, listed


@compiled
def find_root(parent: Any, winding: Any, node: int) -> tuple[int, int]:
    """Return the root of the tree of a node, and the winding from the node to it.

    The nodes on the way are attached to the parents of their parents, in place, so that
    later searches are shorter.

    Args:
        parent, winding: (nodes,) see `Forest`.
        node: the node.

    Returns:
        The root, and the winding as one number, columns times ROW plus rows.
    """
    total = 0
    while parent[node] != node:
        above = parent[node]
        parent[node] = parent[above]
        winding[node] += winding[above]
        total += winding[node]
        node = parent[node]
    return node, total


@compiled
def find_roots(parent: Any, winding: Any, count: int) -> Any:
    """Return the roots (count,) of the first `count` nodes.

    parent, winding: (nodes,) see `Forest`; changed in place.
    """
    roots = np.empty(count, dtype=np.int64)
    for node in range(count):
        roots[node] = find_root(parent, winding, node)[0]
    return roots


@compiled
def connect(parent: Any, winding: Any, node: int, neighbour: int, step: int) -> bool:
    """Connect two nodes; return True if their patch meets its own periodic image.

    Args:
        parent, winding: (nodes,) see `Forest`; changed in place.
        node, neighbour: two nodes, which may be the same.
        step: the winding of the step from the node to its neighbour.
    """
    root, to_root = find_root(parent, winding, node)
    other, to_other = find_root(parent, winding, neighbour)
    between = step + to_other - to_root
    if root != other:
        parent[root] = other
        winding[root] = between
        return False
    return bool(between != 0)


@compiled
def join_runs(  # noqa: PLR0913, PLR0917 - a compiled pass takes its arrays one by one
    starts: Any,
    ends: Any,
    first: Any,
    columns: int,
    diagonals: bool,
    line: bool,
    parent: Any,
    winding: Any,
) -> bool:
    """Connect the runs of each row with those of the row before it, periodically.

    The last run of each row is also connected with the first one, over the period.

    Args:
        starts, ends, first: see `Runs`.
        columns: the number of columns of the grid.
        diagonals: True if points also connect over their corners.
        line: True if the grid is a line, whose only row has no neighbours.
        parent, winding: (nodes,) see `Forest`; changed in place.

    Returns:
        True if a patch percolates.
    """
    spans = False
    rows = first.size - 1
    for row in range(rows):
        before = row - 1
        step = 0
        if row == 0:
            before = rows - 1
            step = -ROW
        run = first[row]
        end = first[row + 1]
        if run < end and starts[run] == 0 and ends[end - 1] == columns:
            spans |= connect(parent, winding, end - 1, run, np.int64(1))
        if line:
            break
        other = first[before]
        other_end = first[before + 1]
        if diagonals and run < end and other < other_end:
            if ends[end - 1] == columns and starts[other] == 0:
                spans |= connect(parent, winding, end - 1, other, step + 1)
            if starts[run] == 0 and ends[other_end - 1] == columns:
                spans |= connect(parent, winding, run, other_end - 1, step - 1)
        while run < end and other < other_end:
            reach = ends[other] + diagonals
            other_reach = ends[run] + diagonals
            if starts[run] < reach and starts[other] < other_reach:
                spans |= connect(parent, winding, run, other, step)
            if ends[run] < ends[other]:
                run += 1
            else:
                other += 1
    return spans


@compiled
def label_points(starts: Any, ends: Any, first: Any, label: Any) -> None:
    """Write the number of its run to each point of the runs.

    Args:
        starts, ends, first: see `Runs`.
        label: (rows, columns); points outside of the runs are left unchanged.
    """
    for row in range(first.size - 1):
        for run in range(first[row], first[row + 1]):
            for column in range(starts[run], ends[run]):
                label[row, column] = run


@compiled
def add_points(
    order: Any,
    steps: Any,
    label: Any,
    node: int,
    parent: Any,
    winding: Any,
) -> int:
    """Join points to the patches one by one, until a patch percolates.

    Args:
        order: (n,) flat indices of the points, in the order in which they join.
        steps: (steps, 2) rows and columns from a point to each of its neighbours.
        label: (rows, columns) the node of each point, -1 where no point has joined;
            changed in place.
        node: the node of the first of these points; the others follow.
        parent, winding: (nodes,) see `Forest`; changed in place.

    Returns:
        How many of these points had joined when a patch percolated; 0 if none does.
    """
    rows, columns = label.shape
    for count in range(order.size):
        row = order[count] // columns
        column = order[count] - row * columns
        label[row, column] = node
        for k in range(steps.shape[0]):
            i = row + steps[k, 0]
            j = column + steps[k, 1]
            step = 0
            if i < 0 or i >= rows:
                step += ROW * steps[k, 0]
                i -= rows * steps[k, 0]
            if j < 0 or j >= columns:
                step += steps[k, 1]
                j -= columns * steps[k, 1]
            neighbour = np.int64(label[i, j])  # so that `connect` compiles once
            if neighbour >= 0 and connect(parent, winding, node, neighbour, step):
                return count + 1
        node += 1
    return 0
