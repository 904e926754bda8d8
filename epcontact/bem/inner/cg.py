"""The linear problem of a Newton step, on the elastic set F.

Conjugate gradients in the space of zero mean solve (S p)_F + z = h_F with the mean of p
kept, with the exact compliance or a cheap one (`split`, or in single precision),
preconditioned cell by cell (`preconditioner`), or by the inverse of S restricted to F
if a grid has no cells.
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
#: y = P r, given r, y and a scratch array; returns sum(y) and sum(y r).
Preconditioner = Callable[[FloatArray, FloatArray, FloatArray], tuple[float, float]]


class InnerOperators:
    """The operators of a grid's inner iterations, made when they are first used."""

    def __init__(self, convolution: Convolution) -> None:
        self._convolution = convolution
        self._points = convolution.shape[0] * convolution.shape[1]
        body = convolution.symbol.once(cell_body)
        self._body = None if body is None else body.scaled(convolution.scale)
        self._split: SplitOperator | None = None
        self._single: Convolution | None = None
        self._cheap, self._last_residual = True, math.inf

    @property
    def pairs(self) -> float:
        """Pairs of transforms of the cheap operators, in pairs of the grid."""
        single = self._single.pairs / 2 if self._single else 0.0
        return single + (self._split.pairs if self._split else 0.0)

    def choose(self, changed: int, masked: MaskedGrid, residual: float) -> Operator:
        """A cheap operator or the exact one for the next step, on the points of a
        masked grid.  A cheap one is used while the sets change or the residual falls:
        the split one on few elastic points, otherwise single precision.  One exact step
        solves full contact.
        """
        if not changed and residual > 0.5 * self._last_residual:
            self._cheap = False
        self._last_residual, exact = residual, self._convolution
        elastic = masked.points.index.size
        if not self._cheap or elastic == self._points:
            return exact
        if not split_pays(exact.symbol, elastic):
            self._single = self._single or exact.in_single_precision()
            return self._single
        self._split = self._split or SplitOperator(exact)
        self._split.masked = masked
        return self._split

    def preconditioner(self, cells: Cells, masked: MaskedGrid) -> Preconditioner:
        """The preconditioner by cells, or the inverse compliance (exact in full
        contact).
        """
        if self._body is not None and cells.points.index.size < self._points:
            return CellPreconditioner(self._body, cells, masked).apply

        def inverse(r: FloatArray, y: FloatArray, _: FloatArray) -> tuple[float, float]:
            return self._convolution.apply_on(cells.points, r, y, r, inverse=True)

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
    """Solve S_F x = r up to a constant for x of zero mean, adding to x and overwriting
    r.  Stops when the 2-norm of r has fallen by `reduction`, or its largest element
    below `floor`, and returns the number of iterations.
    """
    v, y, d = np.empty_like(r), np.empty_like(r), np.zeros_like(r)
    goal, rho_old, n = reduction * math.sqrt(dot(r, r)), math.inf, r.size
    if np.abs(r).max() <= floor:
        return 0
    for k in range(200):
        total, rho = precondition(r, y, v)
        if not rho > 0:
            return k
        cg_direction(d, y, total / n, rho / rho_old)
        total, curvature = operator.apply_on(points, d, v, d)
        if not curvature > 0:
            return k
        square, largest = cg_step(x, r, d, v, rho / curvature, total / n)
        rho_old = rho
        if math.sqrt(square) <= goal or largest <= floor:
            return k + 1
    return 200


@compiled
def cg_step(
    x: Any, r: Any, d: Any, v: Any, alpha: float, mean: float
) -> tuple[float, float]:
    """x += alpha d, r -= alpha (v - mean); returns sum(r^2) and max|r|."""
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
    """d = (y - mean) + beta d."""
    for k in range(d.size):
        d[k] = y[k] - mean + beta * d[k]
