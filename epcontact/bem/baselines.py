"""Classic methods of rough contact, with which the Newton method is compared.

They start from a uniform pressure, use no coarser grids, and are judged by the same
residuals. relaxation is that of Almqvist, Sahlin, Larsson and Glavatskih, Tribology
International 40 (2007) 574, p <- clip(p - omega K g) with the pressure cut at the
hardness; polonsky_keer are the constrained conjugate gradients of Polonsky and Keer,
Wear 231 (1999) 206, where points at the hardness leave the set on which directions are
conjugate; projected_gradient is that of `bounds`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from epcontact.bem.bounds import gradient_step, project
from epcontact.bem.level import Iterate, Level, first_iterate, kkt_residuals, measured
from epcontact.bem.problem import Options
from epcontact.results import FloatArray

#: Solves from a feasible p in units of the mean pressure, which is overwritten.
Baseline = Callable[[Level, FloatArray, Options], Iterate]
_MAX_STEPS = 5000  # default limit; each step costs one or two pairs of transforms


def _finished(level: Level, it: Iterate, options: Options) -> bool:
    it.z, _, _ = measured(level, it.p, it.u)
    it.history.append(max(kkt_residuals(level, it).values()))
    it.pairs = level.convolution.pairs
    it.settled = it.history[-1] <= options.tolerance
    if options.progress is not None and it.gradient % 100 == 0:
        options.progress(level.heights.shape, it.history[-1])
    return it.settled or it.gradient >= (options.max_steps or _MAX_STEPS)


def projected_gradient(level: Level, p: FloatArray, options: Options) -> Iterate:
    """Solve from a feasible p."""
    it = first_iterate(level, p)
    length = level.step
    while not _finished(level, it, options):
        length = gradient_step(level, it, length)
    return it


def relaxation(level: Level, p: FloatArray, options: Options) -> Iterate:
    """Solve from a feasible p; K is the stiffness of the longest wave, which is stable
    for all.
    """
    it = first_iterate(level, p)
    symbol = level.convolution.symbol
    length = 1 / (float(symbol.values.max()) * level.convolution.scale)
    while not _finished(level, it, options):
        w = it.p - length * (it.u - level.heights)
        it.p[...] = project(w, level.cap, float(w.size))
        level.convolution.apply(it.p, it.u)
        it.gradient += 1
    return it


def polonsky_keer(level: Level, p: FloatArray, options: Options) -> Iterate:
    """Solve from a feasible p."""
    it = first_iterate(level, p)
    cap, count = level.cap, float(p.size)
    direction, image = np.zeros_like(p), np.empty_like(p)
    old, keep = 1.0, 0.0
    while not _finished(level, it, options):
        it.gradient += 1
        free = (it.p > 0) & (it.p < cap)
        if not free.any():
            break
        gap = it.u - level.heights
        gap -= gap[free].mean()
        square = float(gap[free] @ gap[free])
        direction = np.where(free, gap + keep * square / old * direction, 0.0)
        old = square
        level.convolution.apply(direction, image)
        image -= image[free].mean()
        curvature = float(image[free] @ direction[free])
        if not curvature > 0:
            break
        length = float(gap[free] @ direction[free]) / curvature
        it.p[...] = np.clip(it.p - length * direction, 0.0, cap)
        wrong = ((it.p <= 0) & (gap < 0)) | ((it.p >= cap) & (gap > 0))
        keep = 0.0 if wrong.any() else 1.0
        it.p[wrong] = np.clip(it.p[wrong] - length * gap[wrong], 0.0, cap)
        _rescale(it.p, cap, count)
        level.convolution.apply(it.p, it.u)
    return it


def _rescale(p: FloatArray, cap: float, total: float) -> None:
    """Scale the pressures below the cap so that their sum is kept; cut those above the
    cap.
    """
    below = p < cap
    full = float(np.count_nonzero(~below))
    wanted, carried = total - cap * full if full else total, float(p[below].sum())
    if carried > 0 and wanted > 0:
        p[below] = np.minimum(p[below] * (wanted / carried), cap)
    if abs(float(p.sum()) - total) > 1e-12 * total:
        p[...] = project(p, cap, total)


BASELINES: dict[str, Baseline] = {
    "relaxation": relaxation,
    "polonsky_keer": polonsky_keer,
    "projected_gradient": projected_gradient,
}
