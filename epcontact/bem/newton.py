"""Semi-smooth Newton method on the sets apart, elastic, plastic, with feasible iterates.

One outer step, from a pressure p that keeps its bounds and its mean:

1. predict the sets from p - c g;
2. put the points of the outer sets on their bounds and solve (S p)_F + z = h_F with the mean of p
   kept on the elastic set F, by conjugate gradients in the space of zero mean, preconditioned by
   the inverse of S restricted to F; only so far as the sets are worth;
3. move the outcome into the bounds, restore the mean, and find the displacement of all points.

So a step costs one pair of transforms and two for each inner iteration, and the Karush-Kuhn-Tucker
residuals of every iterate are known.  The plain method is fast but may cycle.  When its residual
stops falling, or from the start where asked, a step is taken as a direction only: the energy
1/2 <p, S p> - <p, h> is minimised exactly along it, and a step that does not help is replaced by
projected gradient steps (spectral step length, exact line search), which decrease the energy from
any feasible point to the unique minimiser.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from epcontact.bem import passes
from epcontact.bem.constraints import Level, offset_and_force, project, states
from epcontact.bem.transforms import Points

FloatArray = NDArray[np.float64]
StateArray = NDArray[np.uint8]

# Plain steps without a residual below 0.7 of the best before the energy takes over.
_PATIENCE = 6
_GRADIENT_STEPS = 5


@dataclass
class Iterate:
    """A feasible pressure (units of the mean), its displacement (m), the offset z (m)."""

    p: FloatArray
    u: FloatArray
    z: float = 0.0
    residual: float = math.inf
    settled: bool = False


@dataclass
class Counts:
    """What a level has cost."""

    newton: int = 0
    cg: int = 0
    gradient: int = 0
    safeguarded: bool = False
    history: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class Goal:
    """When to stop: residual <= tolerance, or sets settled to the share `area_tolerance`."""

    tolerance: float
    area_tolerance: float = 0.0
    max_steps: int = 60
    max_safeguarded_steps: int = 1000
    safeguard: bool = False
    progress: Callable[[str], None] | None = None


def solve_level(level: Level, p: FloatArray, goal: Goal) -> tuple[Iterate, Counts]:
    """Solve on one grid from a feasible start p (nx, ny), which is overwritten.

    Returns the last iterate, whether or not it meets the goal (`settled`), and the counts.
    """
    counts = Counts(safeguarded=goal.safeguard)
    it = Iterate(p, np.empty_like(p))
    level.convolution.apply(p, it.u)
    state = states(p, level.cap)
    best, stalled = math.inf, 0
    limit = goal.max_steps
    while counts.newton <= limit:
        found = _classify(level, it, state)
        it.residual = max(found.worst / level.gap_scale, found.force)
        counts.history.append(it.residual)
        if _settled(it, found, counts, goal):
            it.settled = True
            break
        stalled = 0 if it.residual < 0.7 * best else stalled + 1
        best = min(best, it.residual)
        if stalled > _PATIENCE and not counts.safeguarded:
            counts.safeguarded = True
        if counts.safeguarded:
            limit = goal.max_safeguarded_steps
        counts.newton += 1
        if goal.progress is not None:
            goal.progress(f"{level.heights.shape}: step {counts.newton}, {it.residual:.1e}")
        _step(level, it, state, found, counts, goal)
    return it, counts


@dataclass(frozen=True)
class _Found:
    """What a prediction of the sets found."""

    changed: int
    elastic: int
    contact: int
    worst: float
    force: float
    away: float
    per_block: list[int]


def _settled(it: Iterate, found: _Found, counts: Counts, goal: Goal) -> bool:
    if it.residual <= goal.tolerance:
        return True
    few = found.changed <= goal.area_tolerance * max(found.contact, 1)
    return goal.area_tolerance > 0 and counts.newton > 0 and few


def _classify(level: Level, it: Iterate, state: StateArray) -> _Found:
    """Offset, residuals of the iterate, and its predicted sets (written to `state`)."""
    it.z, force = offset_and_force(level, it.p, it.u)
    p, u, h, s = (a.reshape(-1) for a in (it.p, it.u, level.heights, state))

    def block(start: int) -> tuple[int, int, int, float, float]:
        k, _ = level.part(start)
        out: tuple[int, int, int, float, float] = passes.classify(
            p[k], u[k], h[k], s[k], it.z, level.step, level.cap
        )
        return out

    parts = level.workers.run(block, level.convolution.blocks)
    return _Found(
        changed=sum(x[0] for x in parts),
        elastic=sum(x[1] for x in parts),
        contact=sum(x[1] + x[2] for x in parts),
        worst=max(x[3] for x in parts),
        force=abs(force - 1),
        away=sum(x[4] for x in parts) / p.size,
        per_block=[x[1] for x in parts],
    )


def _step(
    level: Level, it: Iterate, state: StateArray, found: _Found, counts: Counts, goal: Goal
) -> None:
    """One outer step, in place."""
    old = (it.p.copy(), it.u.copy()) if counts.safeguarded else None
    if not _newton_step(level, it, state, found, counts, goal):
        # No pressure on these sets carries the load: take the nearest sets that do.
        counts.gradient += 1
        if old is None:
            it.p[...] = project(level, it.p - level.step * (it.u - level.heights))
            level.convolution.apply(it.p, it.u)
        else:
            it.p[...], it.u[...] = old
            gradient_step(level, it, level.step)
        return
    if old is None:
        return
    t = line_search(level, it, *old)[0]
    if t < 0.5:
        length = level.step
        for _ in range(_GRADIENT_STEPS):
            length = gradient_step(level, it, length)
            counts.gradient += 1


def _newton_step(
    level: Level, it: Iterate, state: StateArray, found: _Found, counts: Counts, goal: Goal
) -> bool:
    """Steps 2 and 3 of the module's docstring; False if the sets cannot carry the load."""
    n = found.elastic
    points, pressure, r, force = _collect(level, it, state, found)
    deficit = level.heights.size - force
    weight = pressure * (1 - pressure / level.cap)
    total = float(weight.sum())
    if abs(deficit) > 1e-15 * level.heights.size:
        if n == 0 or total <= 0 or abs(deficit) > 0.9 * total:
            return False
        pressure += weight * (deficit / total)
    if found.away > 1e-3:
        # Points thrown out took force with them: the residual must know.
        it.p.reshape(-1)[points.index] = pressure
        level.convolution.apply(it.p, it.u)
        _residual(level, it, points, r)
    mean = float(r.mean()) if n else 0.0
    r -= mean
    x = np.zeros(n)
    if n > 1:
        reduction = 0.1 if found.changed else 1e-3
        counts.cg += conjugate_gradients(
            level, points, r, x, reduction, 0.3 * goal.tolerance * level.gap_scale
        )
    _put(level, it, points, pressure, x)
    level.convolution.apply(it.p, it.u)
    return True


def _collect(
    level: Level, it: Iterate, state: StateArray, found: _Found
) -> tuple[Points, FloatArray, FloatArray, float]:
    """The elastic points with their pressure and residual; the others are put on their bound."""
    n = found.elastic
    begins, begin = {}, 0
    for start, number in zip(level.convolution.blocks, found.per_block, strict=True):
        begins[start] = slice(begin, begin + number)
        begin += number
    points = Points(np.empty(n, dtype=np.int32), begins)
    pressure, r = np.empty(n), np.empty(n)
    p, u, h, s = (a.reshape(-1) for a in (it.p, it.u, level.heights, state))

    def block(start: int) -> float:
        k, base = level.part(start)
        j = points.part(start)
        force: float = passes.collect(
            p[k], u[k], h[k], s[k], base, it.z, level.cap,
            points.index[j], pressure[j], r[j],
        )  # fmt: skip
        return force

    return points, pressure, r, sum(level.workers.run(block, level.convolution.blocks))


def _residual(level: Level, it: Iterate, points: Points, r: FloatArray) -> None:
    u, h = it.u.reshape(-1), level.heights.reshape(-1)

    def block(start: int) -> None:
        k, base = level.part(start)
        j = points.part(start)
        passes.residual_at(u[k], h[k], base, points.index[j], r[j])

    level.workers.run(block, level.convolution.blocks)


def conjugate_gradients(
    level: Level, points: Points, r: FloatArray, x: FloatArray, reduction: float, floor: float
) -> int:
    """Solve S_F x = r up to a constant for x of zero mean, adding to x and overwriting r.

    Stops when the 2-norm of r has fallen by `reduction`, or its largest element below `floor`.
    Returns the number of iterations.
    """
    v, y = np.empty_like(r), np.empty_like(r)
    d = np.zeros_like(r)
    goal = reduction * math.sqrt(float(r @ r))
    rho_old = math.inf
    conv, n = level.convolution, r.size
    if np.abs(r).max() <= floor:
        return 0
    for k in range(200):
        total, rho = conv.apply_on(points, r, y, r, inverse=True)
        if not rho > 0:
            return k
        passes.cg_direction(d, y, total / n, rho / rho_old)
        total, curvature = conv.apply_on(points, d, v, d, inverse=False)
        if not curvature > 0:
            return k
        square, largest = passes.cg_step(x, r, d, v, rho / curvature, total / n)
        rho_old = rho
        if math.sqrt(square) <= goal or largest <= floor:
            return k + 1
    return 200


def _put(level: Level, it: Iterate, points: Points, pressure: FloatArray, x: FloatArray) -> None:
    """Write pressure + x, moved into the bounds, and restore the mean."""
    p = it.p.reshape(-1)
    target = float(pressure.sum() + x.sum())

    def put(start: int) -> tuple[float, float]:
        k, base = level.part(start)
        j = points.part(start)
        sums: tuple[float, float] = passes.put_clipped(
            p[k], base, points.index[j], pressure[j], x[j], level.cap
        )
        return sums

    sums = level.workers.run(put, level.convolution.blocks)
    total, weight = (sum(s[i] for s in sums) for i in (0, 1))
    missing = target - total
    if missing == 0:
        return
    if weight <= 0 or abs(missing) > 0.9 * weight:
        it.p[...] = project(level, it.p)
        return

    def spread(start: int) -> None:
        k, base = level.part(start)
        passes.spread(p[k], base, points.index[points.part(start)], missing / weight, level.cap)

    level.workers.run(spread, level.convolution.blocks)


def line_search(
    level: Level, it: Iterate, p_old: FloatArray, u_old: FloatArray
) -> tuple[float, float, float]:
    """Move back along the step to the minimum of the energy on it.

    Returns the share of the step kept, and <d, S d> and <d, d> of the whole step d.
    """
    arrays = [a.reshape(-1) for a in (it.p, it.u, level.heights, p_old, u_old)]

    def products(start: int) -> tuple[float, float, float]:
        k, _ = level.part(start)
        out: tuple[float, float, float] = passes.descent_products(*(a[k] for a in arrays))
        return out

    sums = level.workers.run(products, level.convolution.blocks)
    slope, curvature, square = (sum(s[i] for s in sums) for i in range(3))
    t = 1.0 if curvature <= 0 else min(1.0, max(0.0, -slope / curvature))
    if t < 1:
        passes.blend(arrays[0], arrays[1], arrays[3], arrays[4], t)
    return t, curvature, square


def gradient_step(level: Level, it: Iterate, length: float) -> float:
    """One projected gradient step with exact line search; returns the next spectral length."""
    p_old, u_old = it.p.copy(), it.u.copy()
    it.p[...] = project(level, p_old - length * (u_old - level.heights))
    level.convolution.apply(it.p, it.u)
    _, curvature, square = line_search(level, it, p_old, u_old)
    return square / curvature if curvature > 0 else level.step
