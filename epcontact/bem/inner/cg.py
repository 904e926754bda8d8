"""The linear problem within a Newton step, on the elastic set alone.

(S p)_F + z = h_F with the mean of p kept: conjugate gradients in the space of zero mean, with the
exact compliance or a cheap one, preconditioned cell by cell (`cells`), or by the inverse of S
restricted to F where a grid has no cells.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from epcontact.bem import passes
from epcontact.bem.constraints import Level
from epcontact.bem.inner.cells import CellPreconditioner, Cells, cell_body
from epcontact.bem.inner.split import MaskedGrid, SplitOperator, splittable
from epcontact.bem.transforms import Convolution, Points
from epcontact.results import FloatArray

# Share of elastic points up to which the stencil of the cheap operator beats transforms.
_FEW = 0.4

Operator = Convolution | SplitOperator
#: y = P r, given r, y and a scratch array; returns sum(y) and sum(y r).
Preconditioner = Callable[[FloatArray, FloatArray, FloatArray], tuple[float, float]]


class Inner:
    """The operators of a level's inner iterations: the cheap ones where they exist and serve."""

    def __init__(self, level: Level) -> None:
        self._level = level
        self._serves = splittable(level.heights.shape)
        self._split: SplitOperator | None = None
        self._last = math.inf
        convolution = level.convolution
        self._masked = MaskedGrid(convolution.shape, convolution.workers)
        self._body = cell_body(convolution.symbol, convolution.scale)

    @property
    def pairs(self) -> float:
        """Pairs of transforms of the cheap operator, in pairs of the level's grid."""
        return 0.0 if self._split is None else self._split.pairs

    def choose(self, changed: int, elastic: int, residual: float) -> Operator:
        """The cheap operator serves while the sets change or the residual falls, and while the
        elastic points are few: its stencil costs by the point."""
        stuck = not changed and residual > 0.5 * self._last
        self._last = residual
        self._serves = self._serves and not stuck
        if not self._serves or elastic > _FEW * self._level.heights.size:
            return self._level.convolution
        if self._split is None:
            self._split = SplitOperator(self._level.convolution, self._masked)
        return self._split

    def preconditioner(self, cells: Cells) -> Preconditioner:
        """By cells, or by the inverse of the whole compliance, exact in full contact."""
        full = cells.points.index.size == self._level.heights.size
        if self._body is not None and not full:
            return CellPreconditioner(self._body, cells, self._masked).apply
        convolution, points = self._level.convolution, cells.points

        def inverse(r: FloatArray, y: FloatArray, _: FloatArray) -> tuple[float, float]:
            return convolution.apply_on(points, r, y, r, inverse=True)

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
    """Solve S_F x = r up to a constant for x of zero mean, adding to x and overwriting r.

    Stops when the 2-norm of r has fallen by `reduction`, or its largest element below `floor`.
    Returns the number of iterations.
    """
    v, y = np.empty_like(r), np.empty_like(r)
    d = np.zeros_like(r)
    goal = reduction * math.sqrt(passes.dot(r, r))
    rho_old = math.inf
    n = r.size
    if np.abs(r).max() <= floor:
        return 0
    for k in range(200):
        total, rho = precondition(r, y, v)
        if not rho > 0:
            return k
        passes.cg_direction(d, y, total / n, rho / rho_old)
        total, curvature = operator.apply_on(points, d, v, d)
        if not curvature > 0:
            return k
        square, largest = passes.cg_step(x, r, d, v, rho / curvature, total / n)
        rho_old = rho
        if math.sqrt(square) <= goal or largest <= floor:
            return k + 1
    return 200
