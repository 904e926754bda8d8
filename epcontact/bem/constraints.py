"""The constraints 0 <= p <= cap and mean(p) = 1: sets, residuals and the projection onto them.

Inside the solver a pressure is in units of the mean pressure, a height or gap in metres.  With
g = u + z - h (u the displacement, z the offset of the flat) the Karush-Kuhn-Tucker conditions
are g >= 0 where p = 0, g = 0 where 0 < p < cap, g <= 0 where p = cap.  z is the multiplier of the
mean: the value that makes g vanish on average over the points between their bounds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from epcontact.bem import passes
from epcontact.bem.passes import Workers
from epcontact.bem.transforms import Convolution
from epcontact.results import APART, ELASTIC, PLASTIC, FloatArray

StateArray = NDArray[np.uint8]

#: First length of a projected gradient step, in stiffnesses of the shortest wave along an axis.
GRADIENT_STEP = 0.3

_CHUNK = 262144  # points that a thread takes at once in a projection


@dataclass(frozen=True)
class Level:
    """One grid of the problem: heights (nx, ny) in m, the compliance, cap = hardness / p0.

    step: first length c of a gradient step p - c g, in units of the mean pressure per m.
    gap_scale: m; the gap residuals are divided by it.
    """

    heights: FloatArray
    convolution: Convolution
    cap: float
    step: float
    gap_scale: float

    @property
    def workers(self) -> Workers:
        """The threads that share out the blocks."""
        return self.convolution.workers

    def part(self, start: int) -> slice:
        """The flat range of the block of rows from `start`."""
        nx, ny = self.heights.shape
        stop = min(start + self.convolution.row_step, nx)
        return slice(start * ny, stop * ny)


def make_level(
    heights: FloatArray, convolution: Convolution, cap: float, gap_scale: float
) -> Level:
    """A level whose gradient step follows from its shortest wave."""
    step = GRADIENT_STEP / (convolution.scale * convolution.symbol.shortest())
    return Level(heights, convolution, cap, step, gap_scale)


@dataclass(frozen=True)
class Measures:
    """Of a pressure: the offset z in m, the mean of p, and the energy (in mean pressures times m,
    summed over the points)."""

    offset: float
    force: float
    energy: float


def measured(level: Level, p: FloatArray, u: FloatArray) -> Measures:
    """The offset is the one that makes the gap vanish on average between the bounds.

    Where no point is between its bounds, it lies midway between what the two other sets allow.
    """
    pf, uf, hf = (a.reshape(-1) for a in (p, u, level.heights))

    def block(start: int) -> tuple[float, int, float, float]:
        k = level.part(start)
        sums: tuple[float, int, float, float] = passes.measure(pf[k], uf[k], hf[k], level.cap)
        return sums

    parts = level.workers.run(block, level.convolution.blocks)
    number = sum(s[1] for s in parts)
    z = sum(s[0] for s in parts) / number if number else _offset_between(level, p, u)
    return Measures(z, sum(s[2] for s in parts) / p.size, sum(s[3] for s in parts))


def _offset_between(level: Level, p: FloatArray, u: FloatArray) -> float:
    needed = level.heights - u
    below, above = needed[p <= 0], needed[p > 0]
    limits = [x for x in (below.max(initial=-np.inf), above.min(initial=np.inf)) if np.isfinite(x)]
    return float(np.mean(limits))


def project(
    w: FloatArray,
    cap: float,
    total: float,
    workers: Workers | None = None,
    out: FloatArray | None = None,
) -> FloatArray:
    """The point nearest to w with 0 <= p <= cap and sum(p) = total: clip(w + z, 0, cap).

    out: where to write it, w itself if need be.

    The sum is piecewise linear and increasing in z; Newton's steps on it are kept in a bracket.
    """
    flat = w.reshape(-1)
    parts = [slice(start, start + _CHUNK) for start in range(0, flat.size, _CHUNK)]
    run = Workers(1).run if workers is None else workers.run
    blocks = range(len(parts))

    def summed(offset: float, k: int) -> tuple[float, int]:
        sums: tuple[float, int] = passes.clipped_sum(flat[parts[k]], offset, cap)
        return sums

    ends = run(lambda k: (float(flat[parts[k]].min()), float(flat[parts[k]].max())), blocks)
    low = -max(e[1] for e in ends)
    high = (cap if np.isfinite(cap) else total) - min(e[0] for e in ends)
    z = min(max(0.0, low), high)
    for _ in range(200):
        sums = run(partial(summed, z), blocks)
        excess = sum(s[0] for s in sums) - total
        inside = sum(s[1] for s in sums)
        low, high = (low, z) if excess > 0 else (z, high)
        if abs(excess) <= 1e-15 * total:
            break
        following = z - excess / inside if inside else (low + high) / 2
        if not low < following < high:
            following = (low + high) / 2
        if following == z:
            break
        z = following
    found = np.empty_like(w) if out is None else out
    target = found.reshape(-1)
    run(lambda k: passes.shift_clip(flat[parts[k]], z, cap, target[parts[k]]), blocks)
    return found


def states(p: FloatArray, cap: float) -> StateArray:
    """APART where p = 0, PLASTIC where p = cap, ELASTIC between."""
    out = np.full(p.shape, ELASTIC, dtype=np.uint8)
    out[p <= 0] = APART
    out[p >= cap] = PLASTIC
    return out


def kkt_residuals(level: Level, p: FloatArray, u: FloatArray, z: float) -> dict[str, float]:
    """Largest violations, dimensionless, each by its name.

    gap_elastic: |g| where 0 < p < cap; gap_sign: wrong sign of g at a bound (both divided by the
    level's gap scale); bounds: pressure beyond its bounds, by the mean pressure; force: mean(p).
    """
    worst = {"gap_elastic": 0.0, "gap_sign": 0.0, "bounds": 0.0}
    total = 0.0
    flat = [a.reshape(-1) for a in (p, u, level.heights)]
    for start in level.convolution.blocks:
        pb, ub, hb = (a[level.part(start)] for a in flat)
        g = ub + (z - hb)
        inside = (pb > 0) & (pb < level.cap)
        wrong = np.where(pb <= 0, -g, g)
        found = {
            "gap_elastic": np.abs(g).max(where=inside, initial=0.0) / level.gap_scale,
            "gap_sign": wrong.max(where=~inside, initial=0.0) / level.gap_scale,
            "bounds": max(-pb.min(), pb.max() - level.cap, 0.0),
        }
        worst = {name: max(value, float(found[name])) for name, value in worst.items()}
        total += float(pb.sum())
    return worst | {"force": abs(total / p.size - 1)}
