"""Move a pressure into its bounds 0 <= p <= cap and keep its mean.

`project` finds the nearest feasible pressure.  `put` writes the result of a Newton step
and restores, cell by cell, the force that the bounds cut off.  A projected gradient
step is p <- P(p - lambda (u - h)), P the projection, lambda the spectral length of
Barzilai and Borwein, with an exact line search: the energy along it is a parabola.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from epcontact.bem.inner.cells import Cells
from epcontact.bem.level import Iterate, Level
from epcontact.bem.transforms import BLOCK_POINTS, Points
from epcontact.bem.workers import Workers, compiled, ranges, split
from epcontact.results import FloatArray

# To restore the force, a point moves by at most this share of its distance to its
# bounds, so that it reaches neither.  The numbers of transform pairs with 0.5 to 0.999
# agree to 0.4 %.
_LARGEST_SHARE = 0.9


def project(
    w: FloatArray,
    cap: float,
    total: float,
    workers: Workers | None = None,
    out: FloatArray | None = None,
) -> FloatArray:
    """clip(w + z, 0, cap), the p nearest to w with 0 <= p <= cap and sum(p) = total.
    The sum is piecewise linear and increasing in z; Newton steps within a bracket find
    z.  The result is written to `out`, which may be w itself.
    """
    workers, parts = workers or Workers(), ranges(w.size, BLOCK_POINTS)
    blocks = split(w.reshape(-1), parts)
    extremes = workers.each(
        lambda block: (float(block.min()), float(block.max())), blocks
    )
    low = -max(largest for _, largest in extremes)
    high = (cap if np.isfinite(cap) else total) - min(
        smallest for smallest, _ in extremes
    )
    z = min(max(0.0, low), high)
    for _ in range(200):
        summed, inside = workers.total(clipped_sum, blocks, z, cap)
        excess = summed - total
        low, high = (low, z) if excess > 0 else (z, high)
        following = z - excess / inside if inside else low
        if not low < following < high:
            following = (low + high) / 2
        if abs(excess) <= 1e-15 * total or following == z:
            break
        z = following
    out = np.empty_like(w) if out is None else out
    workers.each(shift_clip, blocks, z, cap, split(out.reshape(-1), parts))
    return out


def put(
    level: Level,
    p: FloatArray,
    points: Points,
    cells: Cells,
    pressure: FloatArray,
    x: FloatArray,
) -> None:
    """Write pressure + x at the points of p, move it into the bounds and restore its
    force.  If all points shared the force that the bounds cut off equally, a long-wave
    imbalance, whose displacement is large, would be left, and steps would overshoot.
    So each cell keeps its force if its points can carry it, and otherwise the rest goes
    to as small a block of cells as can.
    """
    flat, cap, target = p.reshape(-1), level.cap, float(pressure.sum())
    index, pressures, steps = points.split(points.index, pressure, x)
    missing, weight = cells.sums(put_clipped, 2, flat, index, pressures, steps, cap)
    factor = np.zeros(missing.size)
    forces = [sums.reshape(cells.shape) for sums in (missing, weight, factor)]
    share_forces(*forces, 1e-12 * float(np.abs(missing).max()))
    carried, weight = level.workers.total(
        spread, flat, index, cells.numbers, cells.split(factor), cap
    )
    left = target - carried
    if abs(left) < _LARGEST_SHARE * weight:
        factor = np.full(factor.shape, left / weight)
        level.workers.each(spread, flat, index, cells.numbers, cells.split(factor), cap)
    else:
        flat[points.index] = project(pressure + x, cap, target)


def gradient_step(level: Level, it: Iterate, length: float) -> float:
    """Take one projected gradient step with exact line search; returns the next
    length.
    """
    p_old, u_old = it.p, it.u
    w = u_old - level.heights
    w *= -length
    w += p_old
    it.p = project(w, level.cap, float(w.size), level.workers, out=w)
    it.u = np.empty_like(u_old)
    level.convolution.apply(it.p, it.u)
    it.gradient += 1
    p, u, h, *old = (a.reshape(-1) for a in (it.p, it.u, level.heights, p_old, u_old))
    slope, curvature, square = descent_products(p, u, h, *old)
    if curvature <= 0:
        return level.step
    if (t := min(1.0, max(0.0, -slope / curvature))) < 1:
        blend(p, u, *old, t)
    return float(square / curvature)


@compiled
def share_forces(left: Any, weight: Any, share: Any, rounding: float) -> None:
    """The shares, by cell, that restore the forces `left` as near to it as possible.
    Each share times its weight is a force, and no share is beyond _LARGEST_SHARE.
    Cells that cannot carry their force pass the rest to blocks of 2 x 2, 4 x 4, ...
    cells, until no more than `rounding` is left.
    """
    mx, my = left.shape
    side, worst = 1, np.inf
    while worst > rounding and side < 2 * max(mx, my):
        worst = 0.0
        for i in range(0, mx, side):
            for j in range(0, my, side):
                block = i, min(i + side, mx), j, min(j + side, my)
                worst = max(worst, share_block(left, weight, share, block))
        side *= 2


@compiled
def share_block(
    left: Any, weight: Any, share: Any, block: tuple[int, int, int, int]
) -> float:
    """Restore the forces of a block by equal parts of what its cells can carry.

    block: its first cell and the one behind its last, along x and along y.  Returns the
    largest force that is left.
    """
    first, last, begin, end = block
    wanted = able = worst = 0.0
    for i in range(first, last):
        for j in range(begin, end):
            wanted += left[i, j]
    sign = 1.0 if wanted >= 0.0 else -1.0
    for i in range(first, last):
        for j in range(begin, end):
            able += (_LARGEST_SHARE - sign * share[i, j]) * weight[i, j]
    part = min(max(wanted / able, -1.0), 1.0) if able > 0.0 else 0.0
    for i in range(first, last):
        for j in range(begin, end):
            if weight[i, j] > 0.0:
                step = part * (_LARGEST_SHARE - sign * share[i, j])
                share[i, j] += step
                left[i, j] -= step * weight[i, j]
            worst = max(worst, abs(left[i, j]))
    return worst


@compiled
def clipped_sum(w: Any, z: float, cap: float) -> tuple[float, int]:
    """Sum of clip(w + z, 0, cap), and the number of points strictly between the
    bounds.
    """
    total, inside = 0.0, 0
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
    """out = clip(w + z, 0, cap)."""
    for i in range(w.size):
        out[i] = min(max(w[i] + z, 0.0), cap)


@compiled
def put_clipped(
    cell: Any, sums: Any, p: Any, index: Any, pressure: Any, x: Any, cap: float
) -> None:
    """p = clip(pressure + x, 0, cap) at the points; sums: by cell what is cut, p (1 -
    p/cap).
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
    """p += factor[cell] p (1 - p/cap) at the points; returns the sums of p and p (1 -
    p/cap).
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
    """(u_old - h).d, d.(u - u_old) and d.d for d = p - p_old."""
    slope = curvature = square = 0.0
    for i in range(p.size):
        d = p[i] - p_old[i]
        slope += (u_old[i] - h[i]) * d
        curvature += d * (u[i] - u_old[i])
        square += d * d
    return slope, curvature, square


@compiled
def blend(p: Any, u: Any, p_old: Any, u_old: Any, t: float) -> None:
    """Move p and u back to the fraction t of the way from the old to the new."""
    for i in range(p.size):
        p[i] = p_old[i] + t * (p[i] - p_old[i])
        u[i] = u_old[i] + t * (u[i] - u_old[i])
