"""Going down the energy 1/2 <p, S p> - <p, h> from a feasible pressure: cut steps, gradient steps.

The energy along a step is a parabola, known from its two ends and the slope at one: a step that
raised it is cut where it is least.  A projected gradient step is p <- P(p - lambda (u - h)), P
the projection on bounds and mean, lambda the spectral length of Barzilai and Borwein, with an
exact line search.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from epcontact.bem import passes
from epcontact.bem.constraints import Level, project
from epcontact.bem.transforms import Points
from epcontact.results import FloatArray

# Differences of the energy below this share of (points x mean pressure x gap scale) are rounding.
_ENERGY_NOISE = 1e-12


@dataclass
class Iterate:
    """A feasible pressure (units of the mean), its displacement (m), the offset z (m)."""

    p: FloatArray
    u: FloatArray
    z: float = 0.0
    residual: float = math.inf
    settled: bool = False


@dataclass(frozen=True)
class Step:
    """A step that was taken: where from, with which gap."""

    points: Points
    before: FloatArray
    gap: FloatArray
    energy: float


def best_share(level: Level, it: Iterate, step: Step, energy: float) -> float:
    """The share of the step at which the energy, a parabola along it, is least; at most 1.

    1 where the step is so small that rounding hides what it did to the energy.
    """
    p = it.p.reshape(-1)
    slope: float = passes.step_product(p, step.points.index, step.before, step.gap)
    curvature = 2 * (energy - step.energy - slope)
    noise = _ENERGY_NOISE * level.heights.size * level.gap_scale
    if abs(slope) <= noise and abs(energy - step.energy) <= noise:
        return 1.0
    return min(1.0, max(0.0, -slope / curvature)) if curvature > 0 else float(slope < 0)


def cut_back(level: Level, it: Iterate, step: Step, share: float) -> None:
    """Go back along the step."""
    p = it.p.reshape(-1)
    index = step.points.index
    p[index] = step.before + share * (p[index] - step.before)
    level.convolution.apply(it.p, it.u)


def gradient_steps(level: Level, it: Iterate, number: int) -> int:
    """A few projected gradient steps; returns their number."""
    length = level.step
    for _ in range(number):
        length = gradient_step(level, it, length)
    return number


def gradient_step(level: Level, it: Iterate, length: float) -> float:
    """One projected gradient step with exact line search; returns the next spectral length."""
    p_old, u_old = it.p, it.u
    w = u_old - level.heights
    w *= -length
    w += p_old
    it.p = project(w, level.cap, float(w.size), level.workers, out=w)
    it.u = np.empty_like(u_old)
    level.convolution.apply(it.p, it.u)
    arrays = [a.reshape(-1) for a in (it.p, it.u, level.heights, p_old, u_old)]
    slope, curvature, square = passes.descent_products(*arrays)
    if curvature <= 0:
        return level.step
    t = min(1.0, max(0.0, -slope / curvature))
    if t < 1:
        passes.blend(arrays[0], arrays[1], arrays[3], arrays[4], t)
    return float(square / curvature)
