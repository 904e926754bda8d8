"""The flat punch on the points of a contact, on the grid.

A flat punch that touches the points F and carries the mean pressure 1 sinks by u:

    S p = u on F,   p = 0 elsewhere,   mean(p) = 1,

with the operators of the boundary elements: S is the surface compliance
(`bem.transforms`), and conjugate gradients are preconditioned cell by cell
(`bem.inner`).  The iterations run in single precision, at half the cost of double
precision.  They correct the pressure until the displacement, which is evaluated in
double precision, is uniform on F.  A correction cannot reduce the residual by more than
the rounding of single precision allows, so that two corrections may be needed.

The sinking is the mean of p S p.  It is stationary at the solution, and its error is of
the second order in that of the pressure: seven digits of the pressure give thirteen of
the sinking.  On a large grid, where such a punch takes longer than the solve of the
contact, fewer digits are enough, and single precision throughout.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.driver import scene_symbol
from epcontact.bem.inner.cells import Cells
from epcontact.bem.inner.cg import InnerOperators, conjugate_gradients
from epcontact.bem.inner.preconditioner import dot
from epcontact.bem.inner.split import MaskedGrid
from epcontact.bem.transforms import Convolution, IntArray, Points, Symbol
from epcontact.bem.workers import Workers
from epcontact.errors import NotConverged
from epcontact.results import FloatArray
from epcontact.scene import Scene

Mask = NDArray[np.bool_]

# The displacement on F is uniform when the 2-norm of its deviation from its mean is
# below this fraction of the 2-norm of the displacement under a uniform pressure on F.
# On the paper's surface the sinking is then off by 3e-13, and the limit of the
# stiffness, which depends on the pressure at the rim, by at most 5e-10 or 1e-7 of its
# error estimate.  1e-12 would take 17 to 20 pairs of transforms instead of 9 to 12.
_TOLERANCE = 3e-7
# The same fraction on a grid of more than _LARGE points.  On a map of 1800 x 1800
# points the sinking is then off by at most 3e-6, and the limit of the stiffness by a
# thousandth of its error estimate.
_LARGE_TOLERANCE = 1e-3
_LARGE = 1 << 18
# Rounding of a transform, over the 2-norm of what is transformed.  Near full contact it
# is more than the tolerance, because the displacement is small.
_ROUNDING = 8 * float(np.finfo(np.float64).eps)
# A correction reduces the residual by this factor.  Rounding of single precision ends
# near 1e-7, and 1e-5 takes a third correction.
_REDUCTION = 1e-6
# One or two are the rule.  So many would take 2000 iterations, if none converged.
_MOST_CORRECTIONS = 10


class Punch(NamedTuple):
    """A flat punch under the mean pressure 1.

    Attributes:
        sinking: how far it sinks, in m/Pa, without the uniform compression of a layer.
        pressure: the dimensionless pressure on the grid of the mask, 0 off the mask.
        pairs: its transforms and back, in pairs of the grid in double precision; a pair
            in single precision is half a pair.
    """

    sinking: float
    pressure: FloatArray
    pairs: float


def solve_punch(scene: Scene, mask: Mask, threads: int = 1) -> Punch:
    """Return sinking and pressure of a flat punch that touches the points of a mask.

    The punch carries the mean pressure 1.  Up to 2^18 grid points, and on more than
    half of a grid, the relative error of the sinking is below 1e-12; else it is about
    1e-6.

    Args:
        scene: its surface gives the grid and the periods, its body the compliance.
        mask: True at the points that the punch touches, at least one but not all.
        threads: the number of threads; the result is the same with any.

    Raises:
        NotConverged: the displacement under the punch did not become uniform.
    """
    with Workers(threads) as workers:
        return _solve_with(workers, scene_symbol(scene), mask)


def _solve_with(workers: Workers, symbol: Symbol, mask: Mask) -> Punch:
    """Return the flat punch on a mask, see `solve_punch`.

    Args:
        workers: the threads of the transforms.
        symbol: the compliance of each mode of the grid, in m/Pa.
        mask: True at the points that the punch touches.

    Raises:
        NotConverged: the displacement under the punch did not become uniform.
    """
    unit = symbol.shortest()
    convolution = Convolution(symbol, 1 / unit, workers)
    in_single_precision = convolution.in_single_precision()
    displace = convolution.apply_on
    tolerance = _TOLERANCE
    # On most of a grid the displacement is below the rounding of single precision.
    if mask.size > _LARGE and 2 * np.count_nonzero(mask) <= mask.size:
        displace = in_single_precision.apply_on
        tolerance = _LARGE_TOLERANCE
    points = _points_of_mask(mask, convolution)
    cells = Cells(convolution, points)
    masked = MaskedGrid(points, np.empty(symbol.shape), convolution.workers)
    precondition = InnerOperators(convolution).preconditioner(cells, masked)
    size = points.index.size
    pressure = np.full(size, mask.size / size)
    displacement = np.empty(size)
    displace(points, pressure, displacement, pressure)
    rounding = _ROUNDING * _norm(pressure) * float(symbol.values.max()) / unit
    goal = max(tolerance * _norm(displacement), rounding)
    # The mean by numpy, whose pairwise sums round less than those of the pass.
    residual = displacement.mean() - displacement
    corrections = 0
    while _norm(residual) > goal:
        if corrections == _MOST_CORRECTIONS:
            raise NotConverged(
                "the stiffness of the interface did not converge: after "
                f"{corrections} corrections the displacement under a flat punch is "
                f"uneven by {_norm(residual) / goal:.1g} times the tolerance"
            )
        corrections += 1
        correction = np.zeros(size)
        conjugate_gradients(
            in_single_precision,
            precondition,
            points,
            residual,
            correction,
            # Half of the goal, because rounding adds to the residual.
            reduction=max(_REDUCTION, goal / _norm(residual) / 2),
            floor=0.0,
        )
        pressure += correction - correction.mean()
        displace(points, pressure, displacement, pressure)
        residual = displacement.mean() - displacement
    field = np.zeros(mask.shape)
    field[mask] = pressure
    sinking = unit * float((pressure * displacement).sum()) / mask.size
    return Punch(sinking, field, convolution.pairs + in_single_precision.pairs / 2)


def _norm(values: FloatArray) -> float:
    """Return the 2-norm of an array (n,), computed without the threads of a library."""
    return math.sqrt(dot(values, values))


def _points_of_mask(mask: Mask, convolution: Convolution) -> Points:
    """Return the points of a mask for a convolution, which works by blocks of rows.

    Args:
        mask: (nx, ny) or (nx,), True at the points.
        convolution: its `rows` are the blocks, as slices of rows of the grid.

    Returns:
        The flat indices of the points in rising order, and for each block the slice of
        these indices that lies in it.
    """
    index: IntArray = np.flatnonzero(mask)
    if mask.size < 2**31:
        index = index.astype(np.int32)
    columns = mask.shape[-1]
    first = [rows.start * columns for rows in convolution.rows]
    ends = np.searchsorted(index, [*first, mask.size]).tolist()
    parts = [slice(begin, end) for begin, end in itertools.pairwise(ends)]
    return Points(index, parts)
