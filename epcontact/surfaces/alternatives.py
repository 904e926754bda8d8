"""Heights that a measured map may have instead of those that a surface was made of.

A map leaves two things open.  The plane that was removed is known only as well as the
longest waves of the map are, and heights that nobody measured are guesses.  Solving the
alternative heights shows what that means for each value: see `epcontact.alternatives`.

Planes: the true surface continues beyond the map.  One alternative has the plane with
which opposite edges of the map meet, and another one has this plane with the other sign
along y.  If curvatures were removed, too, four alternatives have their likely size with
all signs along both axes.

Missing heights: a smooth filling continues heights and slopes of the points around a
hole (it minimizes the sum of the squared Laplacians), so that it rises above the rim
of a hole at a summit.  How far it is off is seen where heights are known: the same
holes are laid over another part of the map, filled there, and compared.  This
difference is added to the smooth filling, and subtracted from it.
`tests/laboratory/measured_maps.py` shows how many errors these alternatives cover.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.results import FloatArray
from epcontact.scene import Alternative

Mask = NDArray[np.bool_]
#: Signs of the alternative planes along each axis, and of the alternative curvatures.
_Signs = tuple[tuple[int, ...], tuple[int, ...]]
#: How many times as large the term of order 2 of a mean profile is as those of orders 3
#: and 4 (Legendre's polynomials), on self-affine roughness of Hurst exponent H = .65:
#: the term of order k is proportional to sqrt(2 k + 1) k^-(H + 1).
_TO_CUBIC = 1.65
_TO_QUARTIC = 2.34
#: Shifts over which holes are laid over other parts of a map, in sides of the map.
_SHIFTS = (0.0, 0.25, 0.5, 0.75, 1.0)


def form_alternatives(
    heights: FloatArray, order: int, mirrored: bool
) -> list[Alternative]:
    """Return other forms that a map from which a polynomial was removed may have.

    A period keeps its true plane if its opposite edges meet.  Without a plane that was
    removed, or on a map whose edges meet already, there is nothing to change.

    Args:
        heights: (nx, ny) or (nx,), in m, levelled and without NaN.
        order: the total order of the polynomial that was removed, 0, 1 or 2.
        mirrored: True if the map is mirrored at its edges; alternatives with another
            plane are only for such a map.

    Returns:
        Alternatives with the source "form", whose changes are on the map and not on
        its mirror images; [] if the polynomial was a mean height.
    """
    if order == 0 or np.ptp(heights) == 0:
        return []
    planes = []
    curvatures = []
    for axis, size in enumerate(heights.shape):
        steps = np.take(heights, -1, axis) - np.take(heights, 0, axis)
        x = np.linspace(-0.5, 0.5, size)
        shape = [1] * heights.ndim
        shape[axis] = size
        planes.append(-float(steps.mean()) * x.reshape(shape))
        bow = 0.0
        if order == 2:
            bow = _curvature(heights, axis)
        curvatures.append(bow * (x * x - np.mean(x * x)).reshape(shape))
    alternatives = []
    for of_planes, of_curvatures in _signs(order, mirrored, heights.ndim):
        changes = [
            of_plane * plane + of_curvature * curvature
            for plane, of_plane, curvature, of_curvature in zip(
                planes, of_planes, curvatures, of_curvatures, strict=True
            )
        ]
        alternatives.append(Alternative("form", ..., tuple(changes)))
    return alternatives


def _signs(order: int, mirrored: bool, dimensions: int) -> list[_Signs]:
    """Return the signs of the alternative planes and curvatures along each axis.

    Args:
        order: the total order of the polynomial that was removed, 1 or 2.
        mirrored: True if the map is mirrored; its plane may then have the other sign
            along y, too.
        dimensions: 2 for a map, 1 for a line.

    Returns:
        For each alternative the signs of its planes and those of its curvatures.
    """
    if dimensions == 1:
        of_line: list[_Signs] = [((1,), (1,)), ((1,), (-1,))]
        return of_line[:order]
    opposite = (1, -1) if mirrored else (1, 1)
    signs: list[_Signs] = [((1, 1), (1, 1))]
    if mirrored or order == 2:
        signs.append((opposite, (-1, -1)))
    if order == 2:
        signs += [((1, 1), (1, -1)), (opposite, (-1, 1))]
    return signs


def _curvature(heights: FloatArray, axis: int) -> float:
    """Return the uncertain curvature of a map whose quadratic form was removed.

    It is estimated from the terms of orders 3 and 4, the longest waves that are left.

    Args:
        heights: (nx, ny) or (nx,), in m.
        axis: the direction of the curvature.

    Returns:
        The coefficient in m of the square of the position over the side of the map.
    """
    other_axes = tuple(k for k in range(heights.ndim) if k != axis)
    profile = heights.mean(axis=other_axes)
    x = np.linspace(-1.0, 1.0, profile.size)
    order = min(4, profile.size - 1)
    terms = np.zeros(5)
    terms[: order + 1] = np.polynomial.legendre.legfit(x, profile, order)
    quadratic = math.hypot(_TO_CUBIC * terms[3], _TO_QUARTIC * terms[4]) / math.sqrt(2)
    # A Legendre polynomial of order 2 has the leading term 3/2 x² = 6 (x / side)².
    return 6 * quadratic


def hole_alternatives(
    heights: FloatArray, holes: Mask, least: FloatArray, most: FloatArray
) -> list[Alternative]:
    """Return other heights that the filled points of a map may have.

    Args:
        heights: (nx, ny) or (nx,), in m, filled at the holes.
        holes: the mask of the filled or clipped points, of the same shape.
        least: the lowest heights (m) that the points in holes can have, (points,) or a
            number.
        most: the highest, like `least`.

    Returns:
        Two alternatives with the source "missing", whose changes are on the map and not
        on its mirror images; [] if there are no holes, or no other points.
    """
    if not holes.any() or holes.all():
        return []
    smooth = fill_smoothly(heights, holes)[holes]
    other, other_is_filled = _other_part(heights, holes)
    misfit = other[holes] - fill_smoothly(other, holes)[holes]
    misfit[other_is_filled[holes]] = 0.0
    points = np.nonzero(holes)
    alternatives = []
    for sign in (1, -1):
        filling = np.clip(smooth + sign * misfit, least, most)
        change = filling - heights[holes]
        alternatives.append(Alternative("missing", points, (change,)))
    return alternatives


def _other_part(heights: FloatArray, holes: Mask) -> tuple[FloatArray, Mask]:
    """Return another part of the mirrored map, and the mask of its filled points.

    It has the size of the map.  Of several parts, this is the one with the fewest
    filled points at the places of the map's own holes.

    Args:
        heights: (nx, ny) or (nx,), filled at the holes.
        holes: the mask of the filled points.
    """
    margins = [(0, size) for size in heights.shape]
    continued = np.pad(heights, margins, mode="symmetric")
    continued_holes = np.pad(holes, margins, mode="symmetric")
    fewest = heights.size + 1
    best = (heights, holes)
    for window in _windows(heights.shape):
        mask = continued_holes[window]
        count = int(np.count_nonzero(mask & holes))
        if count < fewest:
            fewest = count
            best = (continued[window], mask)
    return best


def _windows(shape: tuple[int, ...]) -> Iterator[tuple[slice, ...]]:
    """Yield windows of the size of a map in the map with its mirror images.

    Args:
        shape: the grid of the map; the continued map is twice as long along each axis.
    """
    for shifts in itertools.product(_SHIFTS, repeat=len(shape)):
        if not any(shifts):
            continue  # the map itself has the same holes
        starts = [int(shift * size) for shift, size in zip(shifts, shape, strict=True)]
        yield tuple(
            slice(start, start + size)
            for start, size in zip(starts, shape, strict=True)
        )


def fill_smoothly(heights: FloatArray, holes: Mask) -> FloatArray:
    """Return heights with the points in holes replaced by a smooth continuation.

    The filling minimizes the sum of the squared Laplacians of the map, whose slope
    across its edges is 0, as that of a mirrored map.  The direct solve takes 1 to 5 s
    for 300 000 points; conjugate gradients took 11 to 78 times as long on wide holes of
    80 000 points, and were far off.

    Args:
        heights: (nx, ny) or (nx,), in any unit; those in holes do not count, but must
            be finite.
        holes: the mask of the points that are replaced.
    """
    from scipy import sparse  # slow to load
    from scipy.sparse import linalg

    laplacian: Any = sparse.csr_matrix((heights.size, heights.size))
    for axis, size in enumerate(heights.shape):
        factors = [sparse.identity(n) for n in heights.shape]
        factors[axis] = _second_difference(size)
        term = factors[0]
        for factor in factors[1:]:
            term = sparse.kron(term, factor)
        laplacian = laplacian + term
    columns = laplacian.tocsc()[:, np.flatnonzero(holes)]
    known = np.where(holes, 0.0, heights).ravel()
    matrix = (columns.T @ columns).tocsc()
    right = -(columns.T @ (laplacian @ known))
    filling = linalg.spsolve(matrix, right)
    result = heights.copy()
    result[holes] = filling
    return result


def _second_difference(size: int) -> Any:
    """Return the matrix (size, size) of second differences along a mirrored line."""
    from scipy import sparse

    diagonal = np.full(size, -2.0)
    diagonal[[0, -1]] += 1.0
    beside = np.ones(size - 1)
    return sparse.diags([beside, diagonal, beside], [-1, 0, 1])
