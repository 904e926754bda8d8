"""The preconditioner of the inner iterations: a stencil, and a small problem of cells.

Restricted to scattered contacts, the inverse of the compliance S is a poor inverse of S
restricted to them: it answers the collective displacement of many contacts, which is
long-range, with the stiffness of each.  So the two parts are treated separately.  With
Z the indicators of square cells of some points a side, and Pi = Z (Z^T Z)^-1 Z^T the
mean over each cell,

    P = (1 - Pi) K (1 - Pi) + Z E^-1 Z^T,

an additive two-level preconditioner whose fine part sees no collective displacement.  K
need only be right within a cell: a stencil of 3 x 3 points, fitted to 1/S over the
wavelengths up to two cells.  E approximates Z^T S Z, the cells' displacements by their
forces: with c the number of points of each cell,

    E ~ c (B + delta(c)) c,   delta(c) = 0.6 [b(square of c points) - b(cell)],

B is the kernel averaged over pairs of cells, and b is the mean displacement of a square
under a unit force on it.  delta is needed because contact within a cell is denser than
the cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from epcontact.bem.inner.cells import Cells, cells_of, sum_cells
from epcontact.bem.inner.split import LEFT, RIGHT, MaskedGrid
from epcontact.bem.transforms import Symbol, filtered
from epcontact.bem.workers import compiled
from epcontact.results import FloatArray

# The factor 0.6 of delta: contacts are not squares.  0.5 to 1 took the same number of
# iterations.
_DENSITY = 0.6
# Least delta as a fraction of b(square): it keeps the cells' problem definite where
# cells are full.
_LEAST_DELTA = 0.05
# Modes in each direction from which the stencil and the squares are computed.
_SAMPLE = 128
# The stencil is used if it is within this factor of 1/S on every wave up to two cells.
# Otherwise (some bodies and oblong grids) there is no preconditioner by cells (`cg`).
_WORST_FIT = 5.0
# Reduction of the residual of the cells' problem: 1e-1 takes more iterations on the
# points, 1e-2 takes as many.
_REDUCTION = 3e-2
_MAX_ITERATIONS = 50
_PATCHES = 32  # numbers of points, between which delta is interpolated
# At most so many cells with points are solved directly; such matrices start no threads
# of a library.
_DIRECT = 96


@dataclass(frozen=True, eq=False)
class CellBody:
    """The parts of the preconditioner that do not depend on the elastic points.

    Attributes:
        taps: (3, 3) the stencil K.
        kernel: (mx, my // 2 + 1) modes of B.
        delta: (most points of a cell + 1,) delta by the number of points, from 0.
        field: (mx, my) B from the first cell to each.
    """

    taps: FloatArray
    kernel: FloatArray
    delta: FloatArray
    field: FloatArray

    def scaled(self, scale: float) -> CellBody:
        """Return the parts of the preconditioner for the symbol times `scale`.

        The stencil is an inverse and is divided by `scale`; the other parts are
        multiplied by it.
        """
        return CellBody(
            self.taps / scale,
            self.kernel * scale,
            self.delta * scale,
            self.field * scale,
        )


def cell_body(symbol: Symbol) -> CellBody | None:
    """Return the parts of the preconditioner that depend on the compliance alone.

    symbol: compliance of each mode of the grid.  The result is None if the grid is too
    small for cells, or if no stencil is near the inverse of the compliance.
    """
    cells = cells_of(symbol)
    if cells == (1, 1):
        return None
    sample, _, weights = symbol.sampled(_SAMPLE)
    sides = (symbol.shape[0] / cells[0], symbol.shape[1] / cells[1])
    taps = _stencil(sample, sides)
    if taps is None:
        return None
    kernel = _kernel(symbol, cells)
    field = np.fft.irfft2(kernel, s=cells)
    return CellBody(taps, kernel, _delta(sample, weights, sides), field)


class CellPreconditioner:
    """The preconditioner P for listed points, which lie in known cells."""

    def __init__(self, body: CellBody, cells: Cells, masked: MaskedGrid) -> None:
        """Prepare the preconditioner for the elastic points.

        body: the parts that do not depend on these points; cells: the cells of the
        points; masked: a masked grid of the same points.
        """
        self._body = body
        self._cells = cells
        self._masked = masked
        used = cells.counts > 0
        self._used = np.flatnonzero(used)
        self._per_point = used / np.maximum(cells.counts, 1)
        self._delta = np.where(used, body.delta[cells.counts.astype(int)], 0.0)
        self._smoother = 1 / (body.kernel + 1 / np.mean(1 / self._delta[used]))
        self._inverse = None
        if self._used.size <= _DIRECT:
            i, j = np.divmod(self._used, cells.shape[1])
            # Negative indices are right, because the field is periodic.
            matrix = body.field[i[:, None] - i, j[:, None] - j]
            matrix[np.diag_indices(i.size)] += self._delta[self._used]
            self._inverse = np.linalg.inv(matrix)

    def apply(
        self, r: FloatArray, y: FloatArray, scratch: FloatArray
    ) -> tuple[float, float]:
        """Write the preconditioner P times r to y; return sum(y) and sum(y r).

        All arrays are (points,), for the listed points of the cells.  y and scratch are
        overwritten.
        """
        cells = self._cells
        workers = cells.workers
        index, r_blocks, y_blocks, rests = cells.points.split(
            cells.points.index, r, y, scratch
        )
        mean = cells.sums(sum_cells, 1, r_blocks)[0] * self._per_point
        forces = self._solve(mean)
        workers.each(subtract, cells.numbers, r_blocks, cells.split(mean), rests)
        self._masked.put(scratch)
        masked = self._masked.array.reshape(-1)
        taps = self._body.taps
        (within,) = cells.sums(
            gather_stencil, 1, masked, self._masked.columns, taps, index, y_blocks
        )
        shift = cells.split((forces - within) * self._per_point)
        total, product = workers.total(
            add_cells, cells.numbers, shift, y_blocks, r_blocks
        )
        return total, product

    def _solve(self, mean: FloatArray) -> FloatArray:
        """Return the cells' forces that give them the mean displacements `mean`.

        They solve (B + delta) y = mean on the cells with points, directly or by
        conjugate gradients.
        """
        y = np.zeros_like(mean)
        if self._inverse is not None:
            y[self._used] = self._inverse @ mean[self._used]
            return y
        r = mean.copy()
        d = np.zeros_like(mean)
        goal = _REDUCTION**2 * dot(r, r)
        last_rho = np.inf
        for _ in range(_MAX_ITERATIONS):
            s = self._filter(r, self._smoother)
            rho = keep_used(s, self._delta, r)
            if not rho > 0:
                break
            d = s + (rho / last_rho) * d
            last_rho = rho
            v = self._filter(d, self._body.kernel)
            alpha = rho / add_delta(v, self._delta, d)
            if descend(y, r, d, v, alpha) <= goal:
                break
        return y

    def _filter(self, values: FloatArray, modes: FloatArray) -> FloatArray:
        """Return values (cells,) with each mode of their Fourier transform multiplied.

        modes: (mx, my // 2 + 1) the factors; the cells are mx x my.
        """
        cells = self._cells
        return filtered(values.reshape(cells.shape), modes, cells.workers).reshape(-1)


def _phases(sample: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the phases per grid point, from 0 to pi, of a sample of the modes.

    They are (mx, 1) along x and (1, my) along y.  sample: (mx, my), equally spaced
    modes from the mean to the shortest wave.
    """
    x, y = (np.linspace(0, np.pi, n) if n > 1 else np.zeros(1) for n in sample.shape)
    return x[:, None], y[None, :]


def _stencil(sample: FloatArray, sides: tuple[float, float]) -> FloatArray | None:
    """Return a stencil (3, 3) that is near the inverse of the compliance S.

    The stencil is fitted to 1/S, relative to it, over the wavelengths up to two cells.
    The result is None if the fit is poor, or the stencil is not positive definite.

    sample: a quarter of the modes of S; sides: points of a cell along each direction.
    """
    x, y = _phases(sample)
    one = np.ones(sample.shape)
    parts = [one, 2 * np.cos(y) * one]
    if sample.shape[0] > 1:
        parts += [2 * np.cos(x) * one, 4 * np.cos(x) * np.cos(y)]
    fitted = (np.hypot(x * sides[0], y * sides[1]) >= np.pi) & (sample > 0)
    columns = np.stack([part[fitted] * sample[fitted] for part in parts], axis=1)
    coefficients = np.linalg.lstsq(columns, np.ones(len(columns)))[0]
    ratio = columns @ coefficients
    symbol = sum(c * part for c, part in zip(coefficients, parts, strict=True))
    if ratio.max() > _WORST_FIT or ratio.min() < 1 / _WORST_FIT or np.min(symbol) <= 0:
        return None
    centre, along, across, corner = (*coefficients, 0.0, 0.0)[:4]
    return np.array(
        [[corner, across, corner], [along, centre, along], [corner, across, corner]]
    )


def _box(theta: FloatArray, side: FloatArray | float) -> FloatArray:
    """Return the mean of a wave exp(i theta j) over a row of points j, a real number.

    The points are centred at 0.  theta: phase from point to point, in rad; side: number
    of points, which need not be whole.
    """
    sine = np.sin(theta / 2)
    zero = sine == 0
    mean = np.sin(side * theta / 2) / (side * np.where(zero, 1.0, sine))
    return np.where(zero, 1.0, mean)


def _kernel(symbol: Symbol, cells: tuple[int, int]) -> FloatArray:
    """Return the modes (mx, my // 2 + 1) of the compliance B between cells.

    B gives the mean displacement of each cell by unit forces on the cells.  Each mode
    of the cells sums the mode of the points and its nearest aliases.

    symbol: compliance of each mode of the grid; cells: (mx, my).
    """
    nx, ny = symbol.shape
    mx, my = cells
    i = np.arange(mx // 2 + 1)
    j = np.arange(my // 2 + 1)
    quarter = np.zeros((i.size, j.size))
    aliases_x = [i + alias * mx for alias in (-1, 0, 1)] if mx < nx else [i]
    aliases_y = [j + alias * my for alias in (-1, 0, 1)] if my < ny else [j]
    for k in aliases_x:
        along = _box(2 * np.pi * k / nx, nx / mx)[:, None] ** 2
        for m in aliases_y:
            across = _box(2 * np.pi * m / ny, ny / my) ** 2
            values = symbol.values[np.ix_(symbol.rows[np.abs(k)], np.abs(m))]
            quarter += values * (along * across)
    quarter[0, 0] = 0.0
    rows = np.arange(mx)
    return np.asarray(quarter[np.minimum(rows, mx - rows)] * (mx * my / (nx * ny)))


def _delta(
    sample: FloatArray, weights: list[FloatArray], sides: tuple[float, float]
) -> FloatArray:
    """Return delta for each number of contact points in a cell, from 0 to a full cell.

    The result is (most points + 1,).  delta is the displacement under a unit force that
    a cell with few contact points has beyond that of a uniformly loaded cell.

    sample: a quarter of the modes of the compliance; weights: those of the modes along
    each direction in a mean of all; sides: points of a cell along each direction.
    """
    x, y = (theta.reshape(1, -1) for theta in _phases(sample))

    def displacement(a: FloatArray, b: FloatArray) -> FloatArray:
        """Return the mean displacement of each patch under a unit force on it.

        a, b: (n,) points of the patches along x and along y.
        """
        along = _box(x, a[:, None]) ** 2 * weights[0]
        across = _box(y, b[:, None]) ** 2 * weights[1]
        return np.asarray(np.sum((along @ sample) * across, axis=1))

    # Patches of so many points each, no narrower than a point.
    full = int(np.ceil(sides[0]) * np.ceil(sides[1]))
    number = np.unique(np.rint(np.geomspace(1, full, _PATCHES)))
    fraction = np.sqrt(number / (sides[0] * sides[1]))
    width = np.maximum(1.0, number / np.maximum(1.0, fraction * sides[1]))
    of_patches = displacement(width, number / width)
    of_cell = displacement(np.array([sides[0]]), np.array([sides[1]]))
    delta = _DENSITY * np.maximum(of_patches - of_cell, _LEAST_DELTA * of_patches)
    return np.interp(np.arange(full + 1), number, delta)


@compiled
def subtract(cell: Any, values: Any, mean: Any, out: Any) -> None:
    """Write the values minus the mean of their cell to `out`.

    cell: (points,) number of the cell (square of grid points) of each point; values,
    out: (points,); mean: (cells,).
    """
    for k in range(cell.size):
        out[k] = values[k] - mean[cell[k]]


@compiled
def gather_stencil(
    cell: Any, sums: Any, flat: Any, ny: int, taps: Any, index: Any, out: Any
) -> None:
    """Apply a 3 x 3 stencil at listed points, and sum the results by cell.

    cell: (points,) number of the cell (square of grid points) of each point; sums: (1,
    cells), overwritten; flat: the grid of `MaskedGrid`, one row of LEFT + ny + RIGHT
    values after the other; ny: columns of the grid; taps: (3, 3) symmetric; index:
    (points,) flat indices of the points in the grid (nx, ny), ascending; out:
    (points,), overwritten by the results.
    """
    width = ny + LEFT + RIGHT
    size = flat.size
    centre = taps[1, 1]
    along = taps[1, 2]
    across = taps[2, 1]
    corner = taps[2, 2]
    sums[:] = 0.0
    row = -1
    end = 0
    for k in range(index.size):
        if index[k] >= end:
            row = index[k] // ny
            end = (row + 1) * ny
        at = row * (LEFT + RIGHT) + index[k] + LEFT
        up = at - width if at >= width else at - width + size
        down = at + width if at + width < size else at + width - size
        value = (
            centre * flat[at]
            + along * (flat[at - 1] + flat[at + 1])
            + across * (flat[up] + flat[down])
            + corner * (flat[up - 1] + flat[up + 1] + flat[down - 1] + flat[down + 1])
        )
        out[k] = value
        sums[0, cell[k]] += value


@compiled
def add_cells(cell: Any, shift: Any, out: Any, other: Any) -> tuple[float, float]:
    """Add the shift of each point's cell to `out`; return sum(out) and sum(out other).

    cell: (points,) number of the cell (square of grid points) of each point; shift:
    (cells,); out, other: (points,).
    """
    total = product = 0.0
    for k in range(cell.size):
        value = out[k] + shift[cell[k]]
        out[k] = value
        total += value
        product += value * other[k]
    return total, product


@compiled
def dot(a: Any, b: Any) -> float:
    """Return the dot product of two real arrays (n,), a number.

    A library of linear algebra would start threads, which cost more than they gain.
    """
    total = 0.0
    for k in range(a.size):
        total += a[k] * b[k]
    return total


@compiled
def keep_used(s: Any, delta: Any, r: Any) -> float:
    """Set s to 0 in cells without elastic points, in place; return sum(s r).

    A cell is a square of grid points.
    All arrays are (cells,).  delta: 0 in cells without points, above 0 in others.
    """
    total = 0.0
    for k in range(s.size):
        if delta[k] > 0.0:
            total += s[k] * r[k]
        else:
            s[k] = 0.0
    return total


@compiled
def add_delta(v: Any, delta: Any, d: Any) -> float:
    """Add delta d to v in place; return sum(v d).

    A cell is a square of grid points.
    In cells without points, whose delta is 0, v is set to 0.  All arrays are (cells,).
    """
    total = 0.0
    for k in range(v.size):
        v[k] = v[k] + delta[k] * d[k] if delta[k] > 0.0 else 0.0
        total += v[k] * d[k]
    return total


@compiled
def descend(y: Any, r: Any, d: Any, v: Any, alpha: float) -> float:
    """Take a step of conjugate gradients on the cells; return sum(r^2) after it.

    alpha d is added to y and alpha v is subtracted from r, both in place.

    y: (cells,) solution; r: (cells,) residual; d: (cells,) direction; v: (cells,)
    operator times d; alpha: length of the step.
    """
    total = 0.0
    for k in range(y.size):
        y[k] += alpha * d[k]
        r[k] -= alpha * v[k]
        total += r[k] * r[k]
    return total
