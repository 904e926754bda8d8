"""The linear problem of a Newton step, on the elastic set F.

Conjugate gradients in the space of zero mean solve (S p)_F + z = h_F with the mean of p
kept.  They apply the exact compliance S or a cheap one (`split`, or single precision).
They are preconditioned cell by cell (`preconditioner`), or by the inverse of S
restricted to F if a grid has no cells.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from epcontact.bem.inner.cells import Cells
from epcontact.bem.inner.preconditioner import CellPreconditioner, cell_body, dot
from epcontact.bem.inner.split import MaskedGrid, SplitOperator, split_pays
from epcontact.bem.transforms import Convolution, Points
from epcontact.bem.workers import compiled
from epcontact.results import FloatArray

Operator = Convolution | SplitOperator
#: Writes P r to y, given r, y and a scratch array, and returns sum(y) and sum(y r).
Preconditioner = Callable[[FloatArray, FloatArray, FloatArray], tuple[float, float]]
_MAX_ITERATIONS = 200
# The exact operator is used once the residual is not below this fraction of the last
# one.
_STALLED = 0.5


class InnerOperators:
    """The operators of a grid's inner iterations, created at their first use."""

    def __init__(self, convolution: Convolution) -> None:
        """Prepare the operators for a grid, whose exact compliance is `convolution`."""
        self._exact = convolution
        self._points = convolution.shape[0] * convolution.shape[1]
        body = convolution.symbol.once(cell_body)
        self._body = None if body is None else body.scaled(convolution.scale)
        self._split: SplitOperator | None = None
        self._single: Convolution | None = None
        self._cheap = True
        self._last_residual = math.inf

    @property
    def pairs(self) -> float:
        """Cost so far of the cheap operators, in pairs of transforms of the grid.

        A pair is a Fourier transform of a field in double precision, and one back.
        """
        pairs = 0.0
        if self._single is not None:
            pairs += self._single.pairs / 2
        if self._split is not None:
            pairs += self._split.pairs
        return pairs

    def choose(self, changed: int, masked: MaskedGrid, residual: float) -> Operator:
        """Return the operator, cheap or exact, for the next Newton step.

        A cheap operator is used while the sets change or the residual falls: the split
        one on few elastic points, otherwise single precision.  In full contact one step
        with the exact operator is enough.

        Args:
            changed: number of points whose set (apart, elastic or plastic) has changed
                in the last step.
            masked: a masked grid of the elastic points.
            residual: largest residual after the last step, dimensionless.
        """
        if not changed and residual > _STALLED * self._last_residual:
            self._cheap = False
        self._last_residual = residual
        elastic = masked.points.index.size
        if not self._cheap or elastic == self._points:
            return self._exact
        if not split_pays(self._exact.symbol, elastic):
            if self._single is None:
                self._single = self._exact.in_single_precision()
            return self._single
        if self._split is None:
            self._split = SplitOperator(self._exact)
        self._split.masked = masked
        return self._split

    def preconditioner(self, cells: Cells, masked: MaskedGrid) -> Preconditioner:
        """Return the preconditioner of the inner iterations, see `Preconditioner`.

        It works cell by cell.  In full contact, where the inverse of the compliance is
        exact, and on a grid without cells, it is this inverse.

        cells: cells of the elastic points; masked: a masked grid of these points.
        """
        if self._body is not None and cells.points.index.size < self._points:
            return CellPreconditioner(self._body, cells, masked).apply

        def inverse(r: FloatArray, y: FloatArray, _: FloatArray) -> tuple[float, float]:
            """Write the inverse compliance of r to y; return sum(y) and sum(y r)."""
            return self._exact.apply_on(cells.points, r, y, r, inverse=True)

        return inverse


def conjugate_gradients(
    operator: Operator,
    precondition: Preconditioner,
    points: Points,
    r: FloatArray,
    x: FloatArray,
    reduction: float,
    floor: float,
) -> int:
    """Solve S_F x = r up to a constant; return the number of iterations.

    S_F is the compliance between the elastic points, x is a change of their pressures
    of zero mean, and r is a displacement.  The iterations also stop after
    _MAX_ITERATIONS, or where rounding makes a step impossible.

    Args:
        operator: applies S.
        precondition: applies the preconditioner.
        points: the elastic points F.
        r: (points,) right-hand side in m, overwritten by the residual at the end.
        x: (points,) in mean pressures, to which the solution is added in place.
        reduction: stop when the 2-norm of r is at most this fraction of the first one.
        floor: stop when no element of r is above this value, in m.
    """
    v = np.empty_like(r)
    y = np.empty_like(r)
    d = np.zeros_like(r)
    goal = reduction * math.sqrt(dot(r, r))
    last_rho = math.inf
    if np.abs(r).max() <= floor:
        return 0
    for iteration in range(_MAX_ITERATIONS):
        total, rho = precondition(r, y, v)
        if not rho > 0:
            return iteration
        cg_direction(d, y, total / r.size, rho / last_rho)
        total, curvature = operator.apply_on(points, d, v, d)
        if not curvature > 0:
            return iteration
        square, largest = cg_step(x, r, d, v, rho / curvature, total / r.size)
        last_rho = rho
        if math.sqrt(square) <= goal or largest <= floor:
            return iteration + 1
    return _MAX_ITERATIONS


@compiled
def cg_step(
    x: Any, r: Any, d: Any, v: Any, alpha: float, mean: float
) -> tuple[float, float]:
    """Take a step of conjugate gradients; return sum(r^2) and max|r| after it.

    alpha d is added to x, and alpha (v - mean) subtracted from r, both in place.

    x: (points,) solution; r: (points,) residual; d: (points,) direction; v: (points,)
    operator times d; alpha: length of the step; mean: mean of v.
    """
    square = largest = 0.0
    for k in range(x.size):
        x[k] += alpha * d[k]
        value = r[k] - alpha * (v[k] - mean)
        r[k] = value
        square += value * value
        largest = max(largest, abs(value))
    return square, largest


@compiled
def cg_direction(d: Any, y: Any, mean: float, beta: float) -> None:
    """Overwrite the direction d by (y - mean) + beta d.

    y: (points,) preconditioned residual; mean: its mean; beta: factor of the last
    direction.
    """
    for k in range(d.size):
        d[k] = y[k] - mean + beta * d[k]
