"""Move a pressure into its bounds 0 <= p <= cap and keep its mean.

`project` finds the nearest feasible pressure.  `put` writes the result of a Newton step
and restores, cell by cell, the force that the bounds cut off.  `gradient_step` is a
projected gradient step p <- P(p - lambda (u - h)), with P the projection and lambda the
spectral length of Barzilai and Borwein.  Its line search is exact, because the energy
along the step is a parabola.

Pressures are in units of the mean pressure, heights and displacements in m.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from epcontact.bem.inner.cells import Cells
from epcontact.bem.level import Iterate, Level
from epcontact.bem.transforms import BLOCK_POINTS, Points
from epcontact.bem.workers import Workers, compiled, ranges, split
from epcontact.results import FloatArray

# To restore the force, a point moves by at most this fraction of its distance to its
# bounds, so that it reaches neither.  The numbers of transform pairs with 0.5 to 0.999
# agree to 0.4 %.
_LARGEST_FRACTION = 0.9


def project(
    w: FloatArray,
    cap: float,
    total: float,
    workers: Workers | None = None,
    out: FloatArray | None = None,
) -> FloatArray:
    """Return the pressure nearest to `w` with 0 <= p <= cap and the sum `total`.

    That pressure is clip(w + z, 0, cap) for one number z.  Its sum is piecewise linear
    and increasing in z; Newton steps within a bracket find z.

    Args:
        w: field of any shape.
        cap: upper bound of the pressure; may be infinite.
        total: sum of the result over all points.
        workers: threads of the passes; None: this thread alone.
        out: array of the shape of w for the result, may be w itself; None: a new array.
    """
    workers = workers or Workers()
    parts = ranges(w.size, BLOCK_POINTS)
    blocks = split(w.reshape(-1), parts)
    extremes = workers.each(smallest_and_largest, blocks)
    highest_sum_at = cap if np.isfinite(cap) else total
    low = -max(largest for _, largest in extremes)
    high = highest_sum_at - min(smallest for smallest, _ in extremes)
    z = min(max(0.0, low), high)
    for _ in range(200):
        summed, inside = workers.total(clipped_sum, blocks, z, cap)
        excess = summed - total
        if excess > 0:
            high = z
        else:
            low = z
        following = z - excess / inside if inside else low
        if not low < following < high:
            following = (low + high) / 2
        if abs(excess) <= 1e-15 * total or following == z:
            break
        z = following
    if out is None:
        out = np.empty_like(w)
    workers.each(shift_clip, blocks, z, cap, split(out.reshape(-1), parts))
    return out


def smallest_and_largest(block: FloatArray) -> tuple[float, float]:
    """Return the smallest and the largest value of an array."""
    return float(block.min()), float(block.max())


def put(
    level: Level,
    p: FloatArray,
    points: Points,
    cells: Cells,
    pressure: FloatArray,
    x: FloatArray,
) -> None:
    """Write pressure + x at the points of p, within the bounds, and keep the force.

    If all points shared the force that the bounds cut off equally, a long-wave
    imbalance, whose displacement is large, would be left, and steps would overshoot.
    So each cell keeps its force if its points can carry it.  Otherwise the rest goes to
    the smallest block of cells around it that can carry it.

    Args:
        level: the grid, with the cap of the pressure.
        p: (nx, ny) pressure; its values at the points are overwritten.
        points: the elastic points.
        cells: the cells (squares of grid points) of these points.
        pressure: (points,) pressures before the step.
        x: (points,) change of the pressures, of zero mean.

    All pressures are in units of the mean pressure.
    """
    flat = p.reshape(-1)
    cap = level.cap
    target = float(pressure.sum())
    index, pressures, steps = points.split(points.index, pressure, x)
    missing, weight = cells.sums(put_clipped, 2, flat, index, pressures, steps, cap)
    factor = np.zeros(missing.size)
    share_forces(
        missing.reshape(cells.shape),
        weight.reshape(cells.shape),
        factor.reshape(cells.shape),
        1e-12 * float(np.abs(missing).max()),
    )
    workers = level.workers
    carried, able = workers.total(
        spread, flat, index, cells.numbers, cells.split(factor), cap
    )
    rest = target - carried
    if abs(rest) < _LARGEST_FRACTION * able:
        factor = np.full(factor.shape, rest / able)
        workers.each(spread, flat, index, cells.numbers, cells.split(factor), cap)
    else:
        flat[points.index] = project(pressure + x, cap, target)


def gradient_step(level: Level, iterate: Iterate, length: float) -> float:
    """Take one projected gradient step; return the length of the next one.

    The step goes to the nearest feasible pressure of p - length * gap, or to the point
    before it at which the energy is least.  The iterate's pressure and displacement are
    replaced by new arrays.

    level: the grid; iterate: changed in place; length: of this step.  Lengths are in
    mean pressures per m of gap.
    """
    p_old = iterate.p
    u_old = iterate.u
    w = u_old - level.heights
    w *= -length
    w += p_old
    iterate.p = project(w, level.cap, float(w.size), level.workers, out=w)
    iterate.u = np.empty_like(u_old)
    level.convolution.apply(iterate.p, iterate.u)
    iterate.gradient += 1
    p = iterate.p.reshape(-1)
    u = iterate.u.reshape(-1)
    h = level.heights.reshape(-1)
    before = (p_old.reshape(-1), u_old.reshape(-1))
    slope, curvature, square = descent_products(p, u, h, *before)
    if curvature <= 0:
        return level.step
    fraction = min(1.0, max(0.0, -slope / curvature))
    if fraction < 1:
        blend(p, u, *before, fraction)
    return float(square / curvature)


@compiled
def share_forces(missing: Any, weight: Any, factor: Any, rounding: float) -> None:
    """Find a factor for each cell, so that the cells carry the missing forces.

    A cell then carries factor times weight more.  No factor is beyond
    -_LARGEST_FRACTION or _LARGEST_FRACTION.  The force that a cell cannot carry goes to
    blocks of 2 x 2, 4 x 4, ... cells around it.

    Arrays are (mx, my), forces in mean pressures times points.  missing: force that
    each cell lacks, reduced in place; weight: the largest change of force; factor: 0 at
    first, changed in place; rounding: force below which nothing counts as missing.
    """
    mx, my = missing.shape
    side = 1
    worst = np.inf
    while worst > rounding and side < 2 * max(mx, my):
        worst = 0.0
        for i in range(0, mx, side):
            for j in range(0, my, side):
                block = i, min(i + side, mx), j, min(j + side, my)
                worst = max(worst, share_block(missing, weight, factor, block))
        side *= 2


@compiled
def share_block(
    missing: Any, weight: Any, factor: Any, block: tuple[int, int, int, int]
) -> float:
    """Spread the missing force of a block over its cells, by what each can carry.

    Returns the largest force that a cell of the block still lacks.

    missing, weight, factor: (mx, my), see `share_forces`; missing and factor are
    changed in place.  block: first row of cells, row after the last, first column,
    column after the last.
    """
    first, last, begin, end = block
    wanted = 0.0
    for i in range(first, last):
        for j in range(begin, end):
            wanted += missing[i, j]
    sign = 1.0 if wanted >= 0.0 else -1.0
    able = 0.0
    for i in range(first, last):
        for j in range(begin, end):
            able += (_LARGEST_FRACTION - sign * factor[i, j]) * weight[i, j]
    part = 0.0
    if able > 0.0:
        part = min(max(wanted / able, -1.0), 1.0)
    worst = 0.0
    for i in range(first, last):
        for j in range(begin, end):
            if weight[i, j] > 0.0:
                step = part * (_LARGEST_FRACTION - sign * factor[i, j])
                factor[i, j] += step
                missing[i, j] -= step * weight[i, j]
            worst = max(worst, abs(missing[i, j]))
    return worst


@compiled
def clipped_sum(w: Any, z: float, cap: float) -> tuple[float, int]:
    """Return the sum of clip(w + z, 0, cap), and the number of values not clipped.

    w: (points,); z: shift; cap: upper bound; all are in the same unit.
    """
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


@compiled
def shift_clip(w: Any, z: float, cap: float, out: Any) -> None:
    """Write clip(w + z, 0, cap) to `out`, which may be w.

    w, out: (points,); z: shift; cap: upper bound; all are in the same unit.
    """
    for i in range(w.size):
        out[i] = min(max(w[i] + z, 0.0), cap)


@compiled
def put_clipped(
    cell: Any, sums: Any, p: Any, index: Any, pressure: Any, x: Any, cap: float
) -> None:
    """Write clip(pressure + x, 0, cap) to p at listed points, and sum by cell.

    cell: (points,) number of the cell (square of grid points) of each point; sums: (2,
    cells), overwritten by the sums of the pressure that is cut off and of p (1 -
    p/cap); p: (nx ny,) pressures of the grid; index: (points,) flat indices of the
    points; pressure, x: (points,) pressures and their changes; cap: upper bound, in the
    unit of the pressures.
    """
    sums[:] = 0.0
    for k in range(index.size):
        wanted = pressure[k] + x[k]
        value = min(max(wanted, 0.0), cap)
        p[index[k]] = value
        sums[0, cell[k]] += wanted - value
        sums[1, cell[k]] += value * (1.0 - value / cap)


@compiled
def spread(
    p: Any, index: Any, cell: Any, factor: Any, cap: float
) -> tuple[float, float]:
    """Add factor[cell] p (1 - p/cap) to p at listed points.

    Returns the sums of the new p and of p (1 - p/cap) with the new p.

    p: (nx ny,) pressures of the grid, changed in place; index: (points,) flat indices
    of the points; cell: (points,) number of the cell (square of grid points) of each
    point; factor: (cells,); cap: upper bound, in the unit of the pressures.
    """
    total = weight = 0.0
    for k in range(index.size):
        i = index[k]
        value = p[i] + factor[cell[k]] * p[i] * (1.0 - p[i] / cap)
        p[i] = value
        total += value
        weight += value * (1.0 - value / cap)
    return total, weight


@compiled
def descent_products(
    p: Any, u: Any, h: Any, p_old: Any, u_old: Any
) -> tuple[float, float, float]:
    """Return (u_old - h).d, d.(u - u_old) and d.d for the step d = p - p_old.

    The first two are slope and curvature of the energy along the step.

    p, p_old: (points,) pressures after and before the step; u, u_old: (points,) their
    displacements; h: (points,) heights.
    """
    slope = curvature = square = 0.0
    for i in range(p.size):
        d = p[i] - p_old[i]
        slope += (u_old[i] - h[i]) * d
        curvature += d * (u[i] - u_old[i])
        square += d * d
    return slope, curvature, square


@compiled
def blend(p: Any, u: Any, p_old: Any, u_old: Any, fraction: float) -> None:
    """Replace p and u by values at a fraction, from 0 to 1, of a step, in place.

    p, u: (points,) pressures and displacements after the complete step; p_old, u_old:
    those before it.
    """
    for i in range(p.size):
        p[i] = p_old[i] + fraction * (p[i] - p_old[i])
        u[i] = u_old[i] + fraction * (u[i] - u_old[i])
