"""Passes over the grid that numpy would make in several, compiled, each over a range of points.

Every function works on flat arrays between two indices (or on a block), releases the
interpreter's lock and returns partial sums; `Workers` runs them on the blocks of a fixed
partition and the caller adds the partial sums in order, so that a result does not depend on the
number of threads.  No threading layer of the compiler is involved, so solves may run side by
side in threads and in processes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import Any, TypeVar

import numba
import numpy as np

T = TypeVar("T")

# Sums may be reordered so that they vectorise; infinities (hardness) keep their meaning.
_jit = numba.njit(nogil=True, cache=True, fastmath={"reassoc", "contract", "nsz"})


class Workers:
    """A few threads that share out the blocks of one solve; use as a context."""

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def __enter__(self) -> Workers:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown()

    def run(self, task: Callable[[int], T], blocks: Iterable[int]) -> list[T]:
        """`task(block)` for every block, in any order; the results in the order of the blocks."""
        jobs = list(blocks)
        if self._pool is None or len(jobs) == 1:
            return [task(job) for job in jobs]
        return list(self._pool.map(task, jobs))


@_jit
def multiply_rows(modes: Any, symbol: Any, rows: Any, factor: float) -> None:
    """modes[i] *= factor symbol[rows[i]]."""
    for i in range(modes.shape[0]):
        row = rows[i]
        for j in range(modes.shape[1]):
            modes[i, j] *= factor * symbol[row, j]


@_jit
def divide_rows(modes: Any, symbol: Any, rows: Any, factor: float) -> None:
    """modes[i] *= factor / symbol[rows[i]]; a mode without compliance becomes 0."""
    for i in range(modes.shape[0]):
        row = rows[i]
        for j in range(modes.shape[1]):
            s = symbol[row, j]
            modes[i, j] *= factor / s if s > 0 else 0.0


@_jit
def scatter(block: Any, base: int, index: Any, values: Any) -> None:
    """block = 0 but for block[index - base] = values."""
    block[:] = 0.0
    for k in range(index.size):
        block[index[k] - base] = values[k]


@_jit
def gather_dot(block: Any, base: int, index: Any, out: Any, other: Any) -> tuple[float, float]:
    """out = block[index - base]; returns sum(out) and sum(out other)."""
    total = 0.0
    product = 0.0
    for k in range(index.size):
        value = block[index[k] - base]
        out[k] = value
        total += value
        product += value * other[k]
    return total, product


@_jit
def cg_step(x: Any, r: Any, d: Any, v: Any, alpha: float, mean: float) -> tuple[float, float]:
    """x += alpha d, r -= alpha (v - mean); returns sum(r^2) and max|r|."""
    square = 0.0
    largest = 0.0
    for k in range(x.size):
        x[k] += alpha * d[k]
        value = r[k] - alpha * (v[k] - mean)
        r[k] = value
        square += value * value
        largest = max(largest, abs(value))
    return square, largest


@_jit
def cg_direction(d: Any, y: Any, mean: float, beta: float) -> None:
    """d = (y - mean) + beta d."""
    for k in range(d.size):
        d[k] = y[k] - mean + beta * d[k]


@_jit
def measure(p: Any, u: Any, h: Any, cap: float) -> tuple[float, int, float, float]:
    """Over points with 0 < p < cap the sum of h - u and their number; over all, the sums of p
    and of p (u/2 - h)."""
    total = 0.0
    number = 0
    force = 0.0
    energy = 0.0
    for i in range(p.size):
        force += p[i]
        energy += p[i] * (0.5 * u[i] - h[i])
        if p[i] > 0.0 and p[i] < cap:
            total += h[i] - u[i]
            number += 1
    return total, number, force, energy


@_jit
def classify(
    p: Any, u: Any, h: Any, state: Any, z: float, cap: float
) -> tuple[int, int, int, float]:
    """The sets to solve on, given the offset z: elastic is what is between its bounds, and what is
    on a bound where the gap g = u + z - h has the wrong sign.

    Returns the number of changes, of elastic and of plastic points and the largest violation of
    the conditions on g.
    """
    changed = 0
    elastic = 0
    plastic = 0
    worst = 0.0
    for i in range(p.size):
        g = u[i] + z - h[i]
        if p[i] <= 0.0:
            new = 1 if g < 0.0 else 0
            violation = -g
        elif p[i] >= cap:
            new = 1 if g > 0.0 else 2
            violation = g
        else:
            new = 1
            violation = abs(g)
        worst = max(worst, violation)
        elastic += new == 1
        plastic += new == 2
        if new != state[i]:
            state[i] = new
            changed += 1
    return changed, elastic, plastic, worst


@_jit
def collect(  # noqa: PLR0913, PLR0917 - a compiled pass takes its arrays one by one
    p: Any,
    u: Any,
    h: Any,
    state: Any,
    base: int,
    z: float,
    index: Any,
    pressure: Any,
    residual: Any,
) -> None:
    """List the elastic points with their pressure and h - u - z."""
    k = 0
    for i in range(p.size):
        if state[i] == 1:
            index[k] = base + i
            pressure[k] = p[i]
            residual[k] = h[i] - u[i] - z
            k += 1


@_jit
def put_clipped(p: Any, index: Any, pressure: Any, x: Any, cap: float) -> tuple[float, float]:
    """p = pressure + x at the listed points, moved into [0, cap].

    Returns the sum of what is put, and of the weights p (1 - p/cap).
    """
    total = 0.0
    weight = 0.0
    for k in range(index.size):
        value = min(max(pressure[k] + x[k], 0.0), cap)
        p[index[k]] = value
        total += value
        weight += value * (1.0 - value / cap)
    return total, weight


@_jit
def spread(p: Any, index: Any, amount: float, cap: float) -> None:
    """p += amount p (1 - p/cap) at the listed points."""
    for k in range(index.size):
        i = index[k]
        p[i] += amount * p[i] * (1.0 - p[i] / cap)


@_jit
def clipped_sum(w: Any, z: float, cap: float) -> tuple[float, int]:
    """Sum of clip(w + z, 0, cap) and the number of points strictly between."""
    total = 0.0
    inside = 0
    for i in range(w.size):
        value = w[i] + z
        if value >= cap:
            total += cap
        elif value > 0.0:
            total += value
            inside += 1
    return total, inside


@_jit
def extremes(w: Any) -> tuple[float, float]:
    """Smallest and largest value."""
    low = w[0]
    high = w[0]
    for i in range(w.size):
        low = min(low, w[i])
        high = max(high, w[i])
    return low, high


@_jit
def descent_products(p: Any, u: Any, h: Any, p_old: Any, u_old: Any) -> tuple[float, float, float]:
    """With d = p - p_old: (u_old - h).d, d.(u - u_old) and d.d."""
    slope = 0.0
    curvature = 0.0
    square = 0.0
    for i in range(p.size):
        d = p[i] - p_old[i]
        slope += (u_old[i] - h[i]) * d
        curvature += d * (u[i] - u_old[i])
        square += d * d
    return slope, curvature, square


@_jit
def blend(p: Any, u: Any, p_old: Any, u_old: Any, t: float) -> None:
    """Move p and u back to the fraction t of the way from the old to the new."""
    for i in range(p.size):
        p[i] = p_old[i] + t * (p[i] - p_old[i])
        u[i] = u_old[i] + t * (u[i] - u_old[i])


@_jit
def interpolate(
    coarse: Any, rows: Any, row_weights: Any, columns: Any, column_weights: Any, out: Any
) -> None:
    """out[i, j] = sum of the 4 x 4 coarse neighbours with their weights."""
    line = np.empty(coarse.shape[1])
    for i in range(out.shape[0]):
        a, b, c, d = rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3]
        wa, wb, wc, wd = (
            row_weights[i, 0],
            row_weights[i, 1],
            row_weights[i, 2],
            row_weights[i, 3],
        )
        for j in range(line.size):
            line[j] = wa * coarse[a, j] + wb * coarse[b, j] + wc * coarse[c, j] + wd * coarse[d, j]
        for j in range(out.shape[1]):
            value = 0.0
            for k in range(4):
                value += column_weights[j, k] * line[columns[j, k]]
            out[i, j] = value


#: Columns that a masked grid repeats on its left and right, and points that a stencil handles at
#: once: a register of single precision.
HALO_LEFT, HALO_RIGHT, RUN = 4, 20, 16


@_jit
def put_single(masked: Any, index: Any, values: Any, factor: float) -> None:
    """masked = factor values at the listed points of the grid, and in its repeated columns."""
    ny = masked.shape[1] - HALO_LEFT - HALO_RIGHT
    for k in range(index.size):
        i = index[k] // ny
        j = index[k] - i * ny
        value = factor * values[k]
        masked[i, j + HALO_LEFT] = value
        if j < HALO_RIGHT:
            masked[i, j + HALO_LEFT + ny] = value
        if j >= ny - HALO_LEFT:
            masked[i, j + HALO_LEFT - ny] = value


@_jit
def restrict(masked: Any, half: Any, first: int, last: int) -> None:
    """half = P^T masked for its rows first to last, P being cubic interpolation (periodic)."""
    nx = masked.shape[0]
    width = 2 * half.shape[1] + 6
    line = np.empty(width, dtype=np.float32)
    outer = np.float32(-1 / 16)
    inner = np.float32(9 / 16)
    for row in range(first, last):
        i = 2 * row
        at = masked[i, HALO_LEFT - 3 :]
        a = masked[(i - 3) % nx, HALO_LEFT - 3 :]
        b = masked[(i - 1) % nx, HALO_LEFT - 3 :]
        c = masked[(i + 1) % nx, HALO_LEFT - 3 :]
        d = masked[(i + 3) % nx, HALO_LEFT - 3 :]
        for j in range(width):
            line[j] = at[j] + inner * (b[j] + c[j]) + outer * (a[j] + d[j])
        for j in range(half.shape[1]):
            k = 2 * j + 3
            half[row, j] = (
                line[k] + inner * (line[k - 1] + line[k + 1]) + outer * (line[k - 3] + line[k + 3])
            )


@_jit
def _interpolated_run(half: Any, i: int, j: int, length: int, line: Any, out: Any) -> None:
    """out[t] = `half` interpolated by cubics to the fine points (i, j + t), t < length."""
    mx, my = half.shape
    r = i // 2
    first = j // 2 - 1
    for t in range(length // 2 + 5):
        c = first + t
        c = c + my if c < 0 else (c - my if c >= my else c)
        if i % 2 == 0:
            line[t] = half[r, c]
        else:
            up = r + 1 if r + 1 < mx else 0
            far = up + 1 if up + 1 < mx else 0
            near = half[r, c] + half[up, c]
            line[t] = (9 * near - half[r - 1, c] - half[far, c]) / 16
    for t in range(length):
        k = (j + t) // 2 - first
        if (j + t) % 2 == 0:
            out[t] = line[k]
        else:
            out[t] = (9 * (line[k] + line[k + 1]) - line[k - 1] - line[k + 2]) / 16


@_jit
def _add_row(near: Any, row: Any, taps: Any) -> None:
    """near[t] += sum of taps[b] row[t + b], for a symmetric row of a stencil."""
    c0, c1, c2, c3, c4 = taps[4], taps[3], taps[2], taps[1], taps[0]
    for t in range(RUN):
        near[t] += (
            c0 * row[t + 4]
            + c1 * (row[t + 3] + row[t + 5])
            + c2 * (row[t + 2] + row[t + 6])
            + c3 * (row[t + 1] + row[t + 7])
            + c4 * (row[t] + row[t + 8])
        )


@_jit
def gather_split(
    masked: Any, half: Any, taps: Any, index: Any, out: Any, other: Any
) -> tuple[float, float]:
    """At the listed points, the 9 x 9 stencil on `masked` plus `half` interpolated.

    Listed points among RUN neighbours of a row are handled together.  Returns sum(out) and
    sum(out other).
    """
    nx = masked.shape[0]
    ny = masked.shape[1] - HALO_LEFT - HALO_RIGHT
    near = np.empty(RUN, dtype=np.float32)
    far = np.empty(RUN)
    line = np.empty(RUN // 2 + 6)
    total = 0.0
    product = 0.0
    k = 0
    while k < index.size:
        i = index[k] // ny
        j = index[k] - i * ny
        last = k
        limit = index[k] + min(RUN, ny - j)
        while last + 1 < index.size and index[last + 1] < limit:
            last += 1
        length = index[last] - index[k] + 1
        near[:] = 0
        for a in range(9):
            _add_row(near, masked[(i + a - 4) % nx, j : j + RUN + 8], taps[a])
        _interpolated_run(half, i, j, length, line, far)
        origin = index[k]
        for m in range(k, last + 1):
            t = index[m] - origin
            value = near[t] + far[t]
            out[m] = value
            total += value
            product += value * other[m]
        k = last + 1
    return total, product
