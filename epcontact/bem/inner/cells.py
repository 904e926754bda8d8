"""The preconditioner of the inner iterations: a stencil within cells, one small problem of cells.

Restricted to scattered contacts, the inverse of the compliance S is a poor inverse of S
restricted to them: it answers the collective displacement of many contacts, which is long-range,
with the stiffness of each contact, and conjugate gradients meet outlying eigenvalues of about
(share of contact) x (wavelength) / (size of a contact).  So the two are told apart.  With Z the
indicators of square cells of some points a side, and Pi = Z (Z^T Z)^-1 Z^T the mean over each,

    P = (1 - Pi) K (1 - Pi) + Z E^-1 Z^T,

an additive two-level preconditioner whose fine part sees no collective displacement.  K need only
be right within a cell: a stencil of 3 x 3 points, fitted to 1/S over the wavelengths up to two
cells.  E stands for Z^T S Z, the cells' forces and displacements: with c the points of each cell,

    E ~ c (B + delta(c)) c,   delta(c) = 0.6 [b(square of c points) - b(cell)],

B is the kernel averaged over pairs of cells, b the mean displacement that a unit force on a
square gives it: contact within a cell is denser than the cell.  (0.6: contacts are no squares;
0.5 to 1 were measured to need the same number of iterations.)  Neither part takes a transform of
the fine grid; the cells' problem is solved by conjugate gradients of its own.

The cells also tell the neighbourhoods within which a Newton step keeps the force (`newton`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from epcontact.bem import passes
from epcontact.bem.inner import cell_passes
from epcontact.bem.inner.split import MaskedGrid
from epcontact.bem.transforms import Convolution, Points, Symbol, filtered
from epcontact.results import FloatArray

IntArray = NDArray[np.int32]

#: Points a side of a cell.
CELL = 16
_FEWEST = 32  # points a direction, unless there is only one, that make enough cells
_DENSITY = 0.6
_SAMPLE = 128  # modes a direction that the stencil and the squares are found from
_WORST_FIT = 5.0  # of the stencil, as a ratio to 1/S
_LEAST_DELTA = 0.05  # of b(square): keeps the cells' problem definite where cells are full
_ENOUGH = 1e-2  # reduction of the residual of the cells' problem


def cells_of(shape: tuple[int, int]) -> tuple[int, int]:
    """The number of cells in each direction of a grid; (1, 1) where it is too small for more."""
    if any(1 < n < _FEWEST for n in shape) or max(shape) < _FEWEST:
        return 1, 1
    return max(1, shape[0] // CELL), max(1, shape[1] // CELL)


class Cells:
    """The cells that listed points lie in.

    counts: (cells,) the points of each, as floats.
    """

    def __init__(self, convolution: Convolution, points: Points) -> None:
        self.workers, self.points = convolution.workers, points
        self.shape = cells_of(convolution.shape)
        nx = convolution.shape[0]
        mx, my = self.shape
        self._cell = np.empty(points.index.size, dtype=np.int32)
        # Blocks of rows share the cells at their edges only, so each sums over its own range.
        step = convolution.row_step
        self._ranges = {
            start: slice(start * mx // nx * my, ((min(start + step, nx) - 1) * mx // nx + 1) * my)
            for start in points.begins
        }

        def number(start: int, sums: FloatArray) -> None:
            part = points.part(start)
            first = self._ranges[start].start
            cell_passes.number_cells(
                points.index[part], convolution.shape, self.shape, self._cell[part], first, sums[0]
            )

        (self.counts,) = self.sums(number, 1)

    def part(self, start: int) -> tuple[IntArray, int]:
        """The cells of a block's points, and the first cell of the block."""
        return self._cell[self.points.part(start)], self._ranges[start].start

    def sums(self, task: Callable[[int, FloatArray], None], number: int) -> FloatArray:
        """(number, cells) sums, of what `task` sums over the cells of a block, from its first."""

        def block(start: int) -> FloatArray:
            cells = self._ranges[start]
            sums = np.empty((number, cells.stop - cells.start))
            task(start, sums)
            return sums

        out = np.zeros((number, self.shape[0] * self.shape[1]))
        parts = self.workers.run(block, self.points.begins)
        for cells, part in zip(self._ranges.values(), parts, strict=True):
            out[:, cells] += part
        return out


@dataclass(frozen=True)
class CellBody:
    """What the symbol of a grid says, whatever the points.

    taps: (3, 3) the stencil; kernel: (mx, my // 2 + 1) modes of B; delta: by the number of points
    of a cell, from 0.
    """

    taps: FloatArray
    kernel: FloatArray
    delta: FloatArray


def cell_body(symbol: Symbol, scale: float) -> CellBody | None:
    """For a grid's symbol times `scale`; None where there are too few cells, or where no stencil
    is near enough to the inverse (very oblong spacings, bodies unlike a half-space)."""
    cells = cells_of(symbol.shape)
    if cells == (1, 1):
        return None
    sample, weights = _sample(symbol)
    sides = (symbol.shape[0] / cells[0], symbol.shape[1] / cells[1])
    taps = _stencil(sample, 2 * np.pi / (2 * max(sides)))
    if taps is None:
        return None
    return CellBody(
        taps / scale,
        _kernel(symbol, cells) * scale,
        _delta(sample, weights, sides) * scale,
    )


class CellPreconditioner:
    """P for the points of some cells."""

    def __init__(self, body: CellBody, cells: Cells, masked: MaskedGrid) -> None:
        self._body, self._cells, self._masked = body, cells, masked
        counts = cells.counts
        self._used = counts > 0
        self._per_point = self._used / np.maximum(counts, 1)
        self._delta = np.where(self._used, body.delta[counts.astype(int)], 0.0)
        mean = 1 / np.mean(1 / self._delta[self._used])
        self._smoother = 1 / (body.kernel + mean)

    def apply(self, r: FloatArray, y: FloatArray, scratch: FloatArray) -> tuple[float, float]:
        """y = P r, using `scratch` of the same size; returns sum(y) and sum(y r)."""
        cells, points = self._cells, self._cells.points

        def residual_sums(start: int, sums: FloatArray) -> None:
            cell, first = cells.part(start)
            cell_passes.sum_cells(cell, r[points.part(start)], first, sums[0])

        def within(start: int) -> None:
            part = points.part(start)
            cell_passes.subtract(cells.part(start)[0], r[part], mean, scratch[part])

        def stencil_sums(start: int, sums: FloatArray) -> None:
            part = points.part(start)
            cell, first = cells.part(start)
            cell_passes.gather_stencil(
                self._masked.array, self._body.taps, points.index[part], cell, first, y[part],
                sums[0],
            )  # fmt: skip

        def shifted(start: int) -> tuple[float, float]:
            part = points.part(start)
            sums: tuple[float, float] = cell_passes.add_cells(
                cells.part(start)[0], shift, y[part], r[part]
            )
            return sums

        mean = cells.sums(residual_sums, 1)[0] * self._per_point
        forces = self._solve(mean)
        cells.workers.run(within, points.begins)
        self._masked.put(points, scratch)
        shift = (forces - cells.sums(stencil_sums, 1)[0]) * self._per_point
        parts = cells.workers.run(shifted, points.begins)
        return sum(s for s, _ in parts), sum(s for _, s in parts)

    def _filter(self, values: FloatArray, modes: FloatArray) -> FloatArray:
        field = filtered(values.reshape(self._cells.shape), modes, self._cells.workers)
        return np.asarray(field.reshape(-1))

    def _solve(self, mean: FloatArray) -> FloatArray:
        """The cells' forces that give them the mean displacements `mean`, (B + delta) y = mean."""
        y, r, d = np.zeros_like(mean), mean.copy(), np.zeros_like(mean)
        goal, rho_old = _ENOUGH**2 * passes.dot(r, r), np.inf
        for _ in range(50):
            s = self._filter(r, self._smoother)
            rho = cell_passes.keep_used(s, self._delta, r)
            if not rho > 0:
                break
            d = s + (rho / rho_old) * d
            v = self._filter(d, self._body.kernel)
            alpha = rho / cell_passes.add_own(v, self._delta, d)
            rho_old = rho
            if cell_passes.descend(y, r, d, v, alpha) <= goal:
                break
        return y


def _sample(symbol: Symbol) -> tuple[FloatArray, list[FloatArray]]:
    """A quarter of the modes on a coarse raster, and each direction's weights in a mean of all."""
    at, weights = [], []
    for n in symbol.shape:
        k = np.arange(min(n, _SAMPLE) // 2 + 1)
        at.append(np.minimum(np.rint(k * n / min(n, _SAMPLE)), n // 2).astype(int))
        weight = np.where((k == 0) | (2 * k == min(n, _SAMPLE)), 1.0, 2.0)
        weights.append(weight / weight.sum())
    return symbol.values[np.ix_(symbol.rows[at[0]], at[1])], weights


def _phases(sample: FloatArray) -> tuple[FloatArray, FloatArray]:
    theta = [np.linspace(0, np.pi, n) if n > 1 else np.zeros(1) for n in sample.shape]
    return theta[0][:, None], theta[1][None, :]


def _stencil(sample: FloatArray, lowest: float) -> FloatArray | None:
    """Taps (3, 3) nearest to 1/S, relatively, over the phases a point from `lowest` on."""
    x, y = _phases(sample)
    one = np.ones(sample.shape)
    parts = [one, 2 * np.cos(y) * one]
    if sample.shape[0] > 1:
        parts += [2 * np.cos(x) * one, 4 * np.cos(x) * np.cos(y)]
    wanted = (np.hypot(x, y) >= lowest) & (sample > 0)
    columns = np.stack([part[wanted] * sample[wanted] for part in parts], axis=1)
    found = np.linalg.lstsq(columns, np.ones(len(columns)))[0]
    ratio = columns @ found
    symbol = sum(c * part for c, part in zip(found, parts, strict=True))
    if ratio.max() > _WORST_FIT or ratio.min() < 1 / _WORST_FIT or np.min(symbol) <= 0:
        return None
    centre, along, across, corner = (*found, 0.0, 0.0)[:4]
    return np.array([[corner, across, corner], [along, centre, along], [corner, across, corner]])


def _box(theta: FloatArray, side: float) -> FloatArray:
    """The mean of exp(i theta j) over `side` neighbouring points, up to its phase."""
    half = theta / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        value = np.sin(side * half) / (side * np.sin(half))
    return np.where(np.sin(half) == 0, 1.0, value)


def _kernel(symbol: Symbol, cells: tuple[int, int]) -> FloatArray:
    """Modes of B, from each of the cells' modes and its nearest aliases on the grid."""
    (nx, ny), (mx, my) = symbol.shape, cells
    i, j = np.arange(mx // 2 + 1), np.arange(my // 2 + 1)
    out = np.zeros((i.size, j.size))
    for a in (-1, 0, 1) if mx > 1 else (0,):
        for b in (-1, 0, 1) if my > 1 else (0,):
            k, m = i + a * mx, j + b * my
            box = np.outer(_box(2 * np.pi * k / nx, nx / mx), _box(2 * np.pi * m / ny, ny / my))
            out += symbol.values[np.ix_(symbol.rows[np.abs(k)], np.abs(m))] * box**2
    out[0, 0] = 0.0
    rows = np.arange(mx)
    return np.asarray(out[np.minimum(rows, mx - rows)] * (mx * my / (nx * ny)))


def _delta(sample: FloatArray, weights: list[FloatArray], sides: tuple[float, float]) -> FloatArray:
    """delta by the number of points, up to those of a full cell."""
    x, y = _phases(sample)
    line = sample.shape[0] == 1

    def displacement(a: float, b: float) -> float:
        box = _box(y, b) ** 2 if line else _box(x, a) ** 2 * _box(y, b) ** 2
        return float(weights[0] @ (sample * box) @ weights[1])

    most = int(np.ceil(sides[0]) * np.ceil(sides[1]))
    whole = displacement(*sides)
    share = (np.arange(1, most + 1) / (sides[0] * sides[1])) ** (1.0 if line else 0.5)
    alone = np.array([displacement(max(1, s * sides[0]), max(1, s * sides[1])) for s in share])
    delta = _DENSITY * np.maximum(alone - whole, _LEAST_DELTA * alone)
    return np.concatenate([delta[:1], delta])
