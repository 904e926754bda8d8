"""The preconditioner of the inner iterations: a stencil within cells, and a small
problem of cells.

Restricted to scattered contacts, the inverse of the compliance S is a poor inverse of S
restricted to them: it answers the collective displacement of many contacts, which is
long-range, with the stiffness of each.  So the two are treated apart.  With Z the
indicators of square cells of some points a side, and Pi = Z (Z^T Z)^-1 Z^T the mean
over each,

    P = (1 - Pi) K (1 - Pi) + Z E^-1 Z^T,

an additive two-level preconditioner whose fine part sees no collective displacement.  K
need only be right within a cell: a stencil of 3 x 3 points, fitted to 1/S over the
wavelengths up to two cells.  E approximates Z^T S Z, the cells' displacements by their
forces: with c the number of points of each cell,

    E ~ c (B + delta(c)) c,   delta(c) = 0.6 [b(square of c points) - b(cell)],

B is the kernel averaged over pairs of cells, and b the mean displacement of a square
under a unit force on it; delta is needed because contact within a cell is denser than
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
_SAMPLE = (
    128  # modes in each direction from which the stencil and the squares are computed
)
# The stencil is used if it is within this factor of 1/S on every wave up to two cells;
# otherwise (some bodies and oblong grids) there is no preconditioner by cells (`cg`).
_WORST_FIT = 5.0
_LEAST_DELTA = (
    0.05  # of b(square): keeps the cells' problem definite where cells are full
)
# Of the residual of the cells' problem: 1e-1 takes more iterations on the points, 1e-2
# as many.
_REDUCTION = 3e-2
_PATCHES = 32  # numbers of points, between which delta is interpolated
# So few cells with points are solved directly; such matrices start no threads of a
# library.
_DIRECT = 96


@dataclass(frozen=True, eq=False)
class CellBody:
    """The parts of the preconditioner that do not depend on the elastic points."""

    taps: FloatArray  # (3, 3) the stencil K
    kernel: FloatArray  # (mx, my // 2 + 1) modes of B
    delta: FloatArray  # by the number of points of a cell, from 0
    field: FloatArray  # (mx, my) B from the first cell to each

    def scaled(self, scale: float) -> CellBody:
        """The cell body of the symbol times `scale`."""
        rest = (part * scale for part in (self.kernel, self.delta, self.field))
        return CellBody(self.taps / scale, *rest)


def cell_body(symbol: Symbol) -> CellBody | None:
    """The cell body of a grid's symbol; None where cells are too few, or no stencil
    fits.
    """
    cells = cells_of(symbol)
    if cells == (1, 1):
        return None
    sample, _, weights = symbol.sampled(_SAMPLE)
    sides = (symbol.shape[0] / cells[0], symbol.shape[1] / cells[1])
    if (taps := _stencil(sample, sides)) is None:
        return None
    kernel = _kernel(symbol, cells)
    return CellBody(
        taps, kernel, _delta(sample, weights, sides), np.fft.irfft2(kernel, s=cells)
    )


class CellPreconditioner:
    """The preconditioner P for the points of given cells."""

    def __init__(self, body: CellBody, cells: Cells, masked: MaskedGrid) -> None:
        self._body, self._cells, self._masked = body, cells, masked
        used = cells.counts > 0
        self._per_point = used / np.maximum(cells.counts, 1)
        self._delta = np.where(used, body.delta[cells.counts.astype(int)], 0.0)
        self._smoother = 1 / (body.kernel + 1 / np.mean(1 / self._delta[used]))
        self._used, self._inverse = np.flatnonzero(used), None
        if self._used.size <= _DIRECT:
            i, j = np.divmod(self._used, cells.shape[1])
            matrix = body.field[
                i[:, None] - i, j[:, None] - j
            ]  # negative indices are periodic
            matrix[np.diag_indices(i.size)] += self._delta[self._used]
            self._inverse = np.linalg.inv(matrix)

    def apply(
        self, r: FloatArray, y: FloatArray, scratch: FloatArray
    ) -> tuple[float, float]:
        """y = P r, using `scratch` of the same size; returns sum(y) and sum(y r)."""
        cells, points = self._cells, self._cells.points
        index, r_, y_, rest = points.split(points.index, r, y, scratch)
        mean = cells.sums(sum_cells, 1, r_)[0] * self._per_point
        forces = self._solve(mean)
        cells.workers.each(subtract, cells.numbers, r_, cells.split(mean), rest)
        self._masked.put(scratch)
        masked, ny = self._masked.array.reshape(-1), self._masked.columns
        within = cells.sums(gather_stencil, 1, masked, ny, self._body.taps, index, y_)[
            0
        ]
        shift = cells.split((forces - within) * self._per_point)
        total, product = cells.workers.total(add_cells, cells.numbers, shift, y_, r_)
        return total, product

    def _solve(self, mean: FloatArray) -> FloatArray:
        """The cells' forces that give them the mean displacements `mean`, (B + delta) y
        = mean.
        """
        if self._inverse is not None:
            y = np.zeros_like(mean)
            y[self._used] = self._inverse @ mean[self._used]
            return y
        y, r, d = np.zeros_like(mean), mean.copy(), np.zeros_like(mean)
        goal, rho_old = _REDUCTION**2 * dot(r, r), np.inf
        for _ in range(50):
            s = self._filter(r, self._smoother)
            rho = keep_used(s, self._delta, r)
            if not rho > 0:
                break
            d = s + (rho / rho_old) * d
            v = self._filter(d, self._body.kernel)
            alpha, rho_old = rho / add_own(v, self._delta, d), rho
            if descend(y, r, d, v, alpha) <= goal:
                break
        return y

    def _filter(self, values: FloatArray, modes: FloatArray) -> FloatArray:
        cells = self._cells
        return filtered(values.reshape(cells.shape), modes, cells.workers).reshape(-1)


def _phases(sample: FloatArray) -> tuple[FloatArray, FloatArray]:
    x, y = (np.linspace(0, np.pi, n) if n > 1 else np.zeros(1) for n in sample.shape)
    return x[:, None], y[None, :]


def _stencil(sample: FloatArray, sides: tuple[float, float]) -> FloatArray | None:
    """Fit (3, 3) taps to 1/S in relative terms, over the wavelengths up to two
    cells.
    """
    x, y = _phases(sample)
    one = np.ones(sample.shape)
    parts = [one, 2 * np.cos(y) * one]
    if sample.shape[0] > 1:
        parts += [2 * np.cos(x) * one, 4 * np.cos(x) * np.cos(y)]
    wanted = (np.hypot(x * sides[0], y * sides[1]) >= np.pi) & (sample > 0)
    columns = np.stack([part[wanted] * sample[wanted] for part in parts], axis=1)
    found = np.linalg.lstsq(columns, np.ones(len(columns)))[0]
    ratio, symbol = (
        columns @ found,
        sum(c * part for c, part in zip(found, parts, strict=True)),
    )
    if ratio.max() > _WORST_FIT or ratio.min() < 1 / _WORST_FIT or np.min(symbol) <= 0:
        return None
    centre, along, across, corner = (*found, 0.0, 0.0)[:4]
    return np.array(
        [[corner, across, corner], [along, centre, along], [corner, across, corner]]
    )


def _box(theta: FloatArray, side: FloatArray | float) -> FloatArray:
    """The mean of exp(i theta j) over `side` neighbouring points, up to its phase."""
    sine = np.sin(theta / 2)
    zero = sine == 0
    return np.where(
        zero, 1.0, np.sin(side * theta / 2) / (side * np.where(zero, 1.0, sine))
    )


def _kernel(symbol: Symbol, cells: tuple[int, int]) -> FloatArray:
    """Modes of B, from each of the cells' modes and its nearest aliases on the grid."""
    (nx, ny), (mx, my) = symbol.shape, cells
    i, j = np.arange(mx // 2 + 1), np.arange(my // 2 + 1)
    out = np.zeros((i.size, j.size))
    columns = [j + b * my for b in (-1, 0, 1)] if my < ny else [j]
    across = [(m, _box(2 * np.pi * m / ny, ny / my) ** 2) for m in columns]
    for k in [i + a * mx for a in (-1, 0, 1)] if mx < nx else [i]:
        along = _box(2 * np.pi * k / nx, nx / mx)[:, None] ** 2
        for m, box in across:
            out += symbol.values[np.ix_(symbol.rows[np.abs(k)], np.abs(m))] * (
                along * box
            )
    out[0, 0] = 0.0
    rows = np.arange(mx)
    return np.asarray(out[np.minimum(rows, mx - rows)] * (mx * my / (nx * ny)))


def _delta(
    sample: FloatArray, weights: list[FloatArray], sides: tuple[float, float]
) -> FloatArray:
    """delta by the number of points, up to those of a full cell."""
    x, y = (theta.reshape(1, -1) for theta in _phases(sample))

    def displacement(a: FloatArray, b: FloatArray) -> FloatArray:
        """The mean displacement of patches of a x b points under a unit force on
        each.
        """
        along = _box(x, a[:, None]) ** 2 * weights[0]
        across = _box(y, b[:, None]) ** 2 * weights[1]
        return np.asarray(np.sum((along @ sample) * across, axis=1))

    # Patches of so many points each, no narrower than a point.
    most = int(np.ceil(sides[0]) * np.ceil(sides[1]))
    number = np.unique(np.rint(np.geomspace(1, most, _PATCHES)))
    share = np.sqrt(number / (sides[0] * sides[1]))
    wide = np.maximum(1.0, number / np.maximum(1.0, share * sides[1]))
    each = displacement(wide, number / wide)
    whole = displacement(np.array([sides[0]]), np.array([sides[1]]))
    delta = _DENSITY * np.maximum(each - whole, _LEAST_DELTA * each)
    return np.interp(np.arange(most + 1), number, delta)


@compiled
def subtract(cell: Any, values: Any, mean: Any, out: Any) -> None:
    """out = values - mean[cell]."""
    for k in range(cell.size):
        out[k] = values[k] - mean[cell[k]]


@compiled
def gather_stencil(
    cell: Any, sums: Any, flat: Any, ny: int, taps: Any, index: Any, out: Any
) -> None:
    """out = the 3 x 3 stencil on a masked grid at the points; sums: of out by cell.

    flat: the masked grid, of ny columns and their halo, in one dimension.
    """
    width, size = ny + LEFT + RIGHT, flat.size
    centre, along, across, corner = taps[1, 1], taps[1, 2], taps[2, 1], taps[2, 2]
    sums[:] = 0.0
    row, end = -1, 0
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
    """out += shift[cell]; returns sum(out) and sum(out other)."""
    total = product = 0.0
    for k in range(cell.size):
        value = out[k] + shift[cell[k]]
        out[k] = value
        total += value
        product += value * other[k]
    return total, product


@compiled
def dot(a: Any, b: Any) -> float:
    """Sum of a b, without the threads of a library, which cost more than they gain."""
    total = 0.0
    for k in range(a.size):
        total += a[k] * b[k]
    return total


@compiled
def keep_used(s: Any, delta: Any, r: Any) -> float:
    """s = 0 in cells without points, whose delta is 0; returns sum(s r)."""
    total = 0.0
    for k in range(s.size):
        if delta[k] > 0.0:
            total += s[k] * r[k]
        else:
            s[k] = 0.0
    return total


@compiled
def add_own(v: Any, delta: Any, d: Any) -> float:
    """v += delta d, but 0 in cells without points; returns sum(v d)."""
    total = 0.0
    for k in range(v.size):
        v[k] = v[k] + delta[k] * d[k] if delta[k] > 0.0 else 0.0
        total += v[k] * d[k]
    return total


@compiled
def descend(y: Any, r: Any, d: Any, v: Any, alpha: float) -> float:
    """y += alpha d, r -= alpha v; returns sum(r^2)."""
    total = 0.0
    for k in range(y.size):
        y[k] += alpha * d[k]
        r[k] -= alpha * v[k]
        total += r[k] * r[k]
    return total
