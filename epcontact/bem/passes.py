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
    """modes[i] *= factor symbol[rows[i]]; real and imaginary parts follow one another."""
    for i in range(modes.shape[0]):
        row = rows[i]
        for j in range(symbol.shape[1]):
            weight = factor * symbol[row, j]
            modes[i, 2 * j] *= weight
            modes[i, 2 * j + 1] *= weight


@_jit
def divide_rows(modes: Any, symbol: Any, rows: Any, factor: float) -> None:
    """modes[i] *= factor / symbol[rows[i]]; a mode without compliance becomes 0."""
    for i in range(modes.shape[0]):
        row = rows[i]
        for j in range(symbol.shape[1]):
            s = symbol[row, j]
            weight = factor / s if s > 0 else 0.0
            modes[i, 2 * j] *= weight
            modes[i, 2 * j + 1] *= weight


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
def dot(a: Any, b: Any) -> float:
    """Sum of a b; on one thread, as the threads of a linear algebra library would fight ours."""
    total = 0.0
    for k in range(a.size):
        total += a[k] * b[k]
    return total


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
) -> tuple[int, int, int, int, int, float]:
    """The sets to solve on, given the offset z: elastic is what is between its bounds, and what is
    on a bound where the gap g = u + z - h has the wrong sign.

    Returns the number of changes, of elastic and of plastic points, of points that come into
    contact and that cease to be plastic, and the largest violation of the conditions on g.
    """
    changed = 0
    elastic = 0
    plastic = 0
    entering = 0
    unloading = 0
    worst = 0.0
    for i in range(p.size):
        g = u[i] + z - h[i]
        if p[i] <= 0.0:
            new = 1 if g < 0.0 else 0
            entering += new
            violation = -g
        elif p[i] >= cap:
            new = 1 if g > 0.0 else 2
            unloading += g > 0.0
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
    return changed, elastic, plastic, entering, unloading, worst


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
def put_clipped(  # noqa: PLR0913, PLR0917 - a compiled pass takes its arrays one by one
    p: Any, index: Any, pressure: Any, x: Any, cap: float, cell: Any, first: int, sums: Any
) -> None:
    """p = pressure + x at the listed points, moved into [0, cap].

    sums: by cell, counted from `first`, of what the bounds cut off, and of p (1 - p/cap).
    """
    sums[:] = 0.0
    for k in range(index.size):
        wanted = pressure[k] + x[k]
        value = min(max(wanted, 0.0), cap)
        p[index[k]] = value
        sums[0, cell[k] - first] += wanted - value
        sums[1, cell[k] - first] += value * (1.0 - value / cap)


@_jit
def spread(p: Any, index: Any, cell: Any, factor: Any, cap: float) -> tuple[float, float]:
    """p += factor[cell] p (1 - p/cap) at the listed points.

    Returns the sums of p and of p (1 - p/cap) after it.
    """
    total = 0.0
    weight = 0.0
    for k in range(index.size):
        i = index[k]
        value = p[i] + factor[cell[k]] * p[i] * (1.0 - p[i] / cap)
        p[i] = value
        total += value
        weight += value * (1.0 - value / cap)
    return total, weight


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
def step_product(p: Any, index: Any, before: Any, gap: Any) -> float:
    """Sum over the listed points of gap (p - before)."""
    total = 0.0
    for k in range(index.size):
        total += gap[k] * (p[index[k]] - before[k])
    return total


@_jit
def shift_clip(w: Any, z: float, cap: float, out: Any) -> None:
    """out = clip(w + z, 0, cap)."""
    for i in range(w.size):
        out[i] = min(max(w[i] + z, 0.0), cap)


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
