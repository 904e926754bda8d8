"""Classic methods of rough contact, with which the Newton method is compared.

All methods start from a uniform pressure, use no coarser grids, and are judged by the
same residuals as the Newton method.  `bem.solve` takes one as its argument `method`.

* `relaxation` is the method of Almqvist, Sahlin, Larsson and Glavatskih, Tribology
  International 40 (2007) 574: p <- clip(p - omega K g), with the pressure cut at the
  hardness.
* `polonsky_keer` are the constrained conjugate gradients of Polonsky and Keer, Wear 231
  (1999) 206.  Points at the hardness leave the set on which directions are conjugate.
* `projected_gradient` repeats the projected gradient step of `bounds`.
"""

from __future__ import annotations

import numpy as np

from epcontact.bem.bounds import gradient_step, project
from epcontact.bem.level import (
    Iterate,
    Level,
    first_iterate,
    kkt_residuals,
    measure_iterate,
)
from epcontact.bem.problem import Method, Options
from epcontact.results import FloatArray

_MAX_STEPS = 5000  # default limit; each step costs one or two pairs of transforms
_STEPS_PER_REPORT = 100  # a step is short, so progress is not reported at each


def _is_finished(level: Level, iterate: Iterate, options: Options) -> bool:
    """Record the residual and the cost in the iterate; return True to stop.

    A method stops if the residual is at most `options.tolerance`, or after the largest
    number of steps.  level: the grid; iterate: the state after the last step; options:
    tolerance, number of steps and the function that reports progress.
    """
    iterate.z, _, _ = measure_iterate(level, iterate.p, iterate.u)
    residual = max(kkt_residuals(level, iterate).values())
    iterate.history.append(residual)
    iterate.pairs = level.convolution.pairs
    iterate.settled = residual <= options.tolerance
    if options.progress is not None and iterate.gradient % _STEPS_PER_REPORT == 0:
        options.progress(level.heights.shape, residual)
    return iterate.settled or iterate.gradient >= (options.max_steps or _MAX_STEPS)


def projected_gradient(level: Level, p: FloatArray, options: Options) -> Iterate:
    """Solve by projected gradients from a feasible pressure; return the last iterate.

    level: the grid; p: (nx, ny) pressures in units of the mean pressure, from 0 to the
    cap and of mean 1; options: tolerance and largest number of steps.
    """
    iterate = first_iterate(level, p)
    length = level.step
    while not _is_finished(level, iterate, options):
        length = gradient_step(level, iterate, length)
    return iterate


def relaxation(level: Level, p: FloatArray, options: Options) -> Iterate:
    """Solve by relaxation from a feasible pressure; return the last iterate.

    level: the grid; p: (nx, ny) pressures in units of the mean pressure, from 0 to the
    cap and of mean 1, overwritten; options: tolerance and largest number of steps.

    The factor omega K is the stiffness of the longest wave: larger factors are unstable
    for it.
    """
    iterate = first_iterate(level, p)
    symbol = level.convolution.symbol
    length = 1 / (float(symbol.values.max()) * level.convolution.scale)
    while not _is_finished(level, iterate, options):
        moved = iterate.p - length * (iterate.u - level.heights)
        iterate.p[...] = project(moved, level.cap, float(moved.size))
        level.convolution.apply(iterate.p, iterate.u)
        iterate.gradient += 1
    return iterate


def polonsky_keer(level: Level, p: FloatArray, options: Options) -> Iterate:
    """Solve by the conjugate gradients of Polonsky and Keer; return the last iterate.

    Args:
        level: heights and compliance; its cap is over the mean pressure.
        p: (nx, ny) pressures over the mean pressure, with the sum nx ny, between 0 and
            the cap.  They are not changed.
        options: tolerance and largest number of iterations.

    Returns:
        The last iterate.  Without a free point, or along a direction that costs no
        energy, the method can go no further and stops; the caller then finds that the
        residual exceeds the tolerance.
    """
    iterate = first_iterate(level, p)
    cap = level.cap
    total = float(p.size)
    direction = np.zeros_like(p)
    image = np.empty_like(p)
    last_square = 1.0
    conjugate = 0.0  # 1 while the set of free points has not changed
    while not _is_finished(level, iterate, options):
        iterate.gradient += 1
        free = (iterate.p > 0) & (iterate.p < cap)
        if not free.any():
            break
        gap = iterate.u - level.heights
        gap -= gap[free].mean()
        square = float(gap[free] @ gap[free])
        beta = conjugate * square / last_square
        direction = np.where(free, gap + beta * direction, 0.0)
        last_square = square
        level.convolution.apply(direction, image)
        image -= image[free].mean()
        curvature = float(image[free] @ direction[free])
        if not curvature > 0:
            break
        length = float(gap[free] @ direction[free]) / curvature
        iterate.p[...] = np.clip(iterate.p - length * direction, 0.0, cap)
        penetrates = (iterate.p <= 0) & (gap < 0)
        unloads = (iterate.p >= cap) & (gap > 0)
        wrong = penetrates | unloads
        conjugate = 0.0 if wrong.any() else 1.0
        iterate.p[wrong] = np.clip(iterate.p[wrong] - length * gap[wrong], 0.0, cap)
        _rescale(iterate.p, cap, total)
        level.convolution.apply(iterate.p, iterate.u)
    return iterate


def _rescale(p: FloatArray, cap: float, total: float) -> None:
    """Scale the pressures below the cap, in place, so that all pressures sum to total.

    p: pressures of any shape; cap: their upper bound, in the same unit.
    total: the sum that is wanted.  Pressures that the scaling brings above the cap are
    cut; if the sum is then wrong, the nearest feasible pressure is taken.
    """
    below = p < cap
    wanted = total
    capped_points = float(np.count_nonzero(~below))
    if capped_points:
        wanted -= cap * capped_points
    carried = float(p[below].sum())
    if carried > 0 and wanted > 0:
        p[below] = np.minimum(p[below] * (wanted / carried), cap)
    if abs(float(p.sum()) - total) > 1e-12 * total:
        p[...] = project(p, cap, total)


BASELINES: dict[str, Method] = {
    "relaxation": relaxation,
    "polonsky_keer": polonsky_keer,
    "projected_gradient": projected_gradient,
}
#: The argument `method` of `bem.solve` for each method; None is the Newton method.
METHODS: dict[str, Method | None] = {"newton": None, **BASELINES}
