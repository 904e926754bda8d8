"""The capped contact problem on plain arrays, and the scene solved by it.

Minimise 1/2 <p, S p> - <p, h> over 0 <= p <= hardness with mean(p) = p0 on a periodic grid or
line; S is diagonal in Fourier space.  The minimiser is unique.  hardness = inf is the elastic
problem (Kalker's variational principle; the cap after Tian and Bhushan, 1996).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.baselines import BASELINES
from epcontact.bem.cascade import coarsened_heights, coarser, interpolated
from epcontact.bem.constraints import Level, kkt_residuals, make_level, measured, project
from epcontact.bem.descent import Iterate
from epcontact.bem.newton import Counts, Goal, solve_level
from epcontact.bem.passes import Workers
from epcontact.bem.transforms import Convolution, Symbol
from epcontact.errors import InvalidScene, NotConverged
from epcontact.results import FloatArray

# The areas' tolerance on coarser grids: finer ones took as many steps from 1e-4, and more from 1e-2
# where there are many points a wavelength.
_COARSE_AREAS = 1e-3


@dataclass(frozen=True)
class PressureSolution:
    """The answer at one mean pressure, on the grid of the heights.

    pressure, displacement: in Pa and m, displacement without its mean; offset: z in m, so that
    the gap is displacement + offset - heights; residuals: see `constraints.kkt_residuals`;
    counts: newton, cg and gradient steps and fft_pairs of the finest grid,
    equivalent_fft_pairs of all grids by their points, levels.
    """

    pressure: FloatArray
    displacement: FloatArray
    offset: float
    residuals: Mapping[str, float]
    counts: Mapping[str, float]
    history: tuple[float, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Options:
    """How to solve; see `solve_pressure`."""

    tolerance: float = 1e-8
    area_tolerance: float = 0.0
    threads: int = 1
    method: str = "newton"
    max_steps: int = 500
    progress: Callable[[str], None] | None = field(default=None, compare=False)


def gap_scale(heights: FloatArray, symbol: Symbol, mean_pressure: float) -> float:
    """h_rms in m; for a surface so flat that pressures hide it, that of p0 dx / E*.

    With p = p0 + a fluctuation, p keeps the fluctuation to eps p0 only, so gaps below
    eps p0 dx / E* cannot be told: below a millionth of p0 dx / E* the latter takes over.
    """
    floor = mean_pressure * symbol.shortest() * math.pi / 2
    rms = float(np.std(heights))
    return rms if rms > 1e-6 * floor else floor


def solve_symbol(
    heights: FloatArray,
    symbol: Symbol,
    mean_pressure: float,
    hardness: float,
    options: Options,
    start: FloatArray | None = None,
) -> PressureSolution:
    """Solve for heights (nx, ny), from coarse to fine or from `start` (Pa).

    Raises NotConverged.
    """
    cap = hardness / mean_pressure
    heights, datum = _lowered(heights)
    with Workers(options.threads) as workers:
        run = _Run(
            symbol, mean_pressure, hardness, gap_scale(heights, symbol, mean_pressure), workers
        )
        guess = None
        if start is None and options.method == "newton":
            guess = _coarse_guess(run, heights, options)
        level = run.level(heights)
        if start is not None:
            # No point can carry more than all of the load: beyond that, digits would be lost.
            guess = np.clip(start / mean_pressure, -heights.size, min(cap, heights.size))
        p = np.ones(heights.shape) if guess is None else guess
        project(p, cap, float(heights.size), workers, out=p)
        method = BASELINES.get(options.method, solve_level)
        it, counts = method(level, p, _goal(options))
        solution = _solution(run, level, it, counts, options)
        return replace(solution, offset=solution.offset + datum)


def _lowered(heights: FloatArray) -> tuple[FloatArray, float]:
    """Heights measured from a datum among them where they lie far from zero, and the datum.

    A gap is the difference of heights: a common part would cost it digits.
    """
    datum = float(heights[0, 0])
    if abs(datum) <= 10 * float(np.ptp(heights)):
        return heights, 0.0
    return heights - datum, datum


@dataclass
class _Run:
    """What the grids of one solve share, and the pairs that coarser grids have cost."""

    symbol: Symbol
    mean_pressure: float
    hardness: float
    scale: float
    workers: Workers
    coarse_pairs: float = 0.0
    levels: int = 0

    @property
    def cap(self) -> float:
        return self.hardness / self.mean_pressure

    @property
    def points(self) -> int:
        return self.symbol.shape[0] * self.symbol.shape[1]

    def level(self, heights: FloatArray) -> Level:
        shape = (heights.shape[0], heights.shape[1])
        symbol = self.symbol if shape == self.symbol.shape else self.symbol.coarsened(shape)
        conv = Convolution(symbol, self.mean_pressure, self.workers)
        self.levels += 1
        return make_level(heights, conv, self.cap, self.scale)


def _goal(options: Options) -> Goal:
    return Goal(options.tolerance, options.area_tolerance, options.max_steps, options.progress)


def _coarse_guess(run: _Run, heights: FloatArray, options: Options) -> FloatArray | None:
    """p - c g of the next coarser grid, interpolated; None where there is no coarser grid."""
    shape = (heights.shape[0], heights.shape[1])
    below = coarser(shape)
    if below is None:
        return None
    coarse = coarsened_heights(heights, below, run.workers)
    guess = _coarse_guess(run, coarse, options)
    level = run.level(coarse)
    p = np.ones(below) if guess is None else guess
    project(p, run.cap, float(coarse.size), run.workers, out=p)
    goal = replace(
        _goal(options), tolerance=max(1e-4, options.tolerance), area_tolerance=_COARSE_AREAS
    )
    it, counts = solve_level(level, p, goal)
    run.coarse_pairs += counts.pairs * coarse.size / run.points
    w = it.p - level.step * (it.u + it.z - coarse)
    return interpolated(w, shape, run.workers)


def _solution(
    run: _Run, level: Level, it: Iterate, counts: Counts, options: Options
) -> PressureSolution:
    if _put_on_bounds(it.p, level.cap):
        it.z = measured(level, it.p, it.u).offset
    residuals = kkt_residuals(level, it.p, it.u, it.z)
    history = tuple(counts.history)
    if not it.settled:
        raise NotConverged(
            f"{options.method} did not reach {options.tolerance:g} in {len(history) - 1} steps: "
            f"the largest residual is {max(residuals.values()):.1e}; "
            "give more steps or a larger tolerance",
            residuals,
            history,
        )
    notes: tuple[str, ...] = ()
    if counts.cut:
        notes = (
            f"{counts.cut} of {counts.newton} Newton steps would have raised the energy and were "
            f"cut short; {counts.gradient} projected gradient steps followed them.",
        )
    pairs = level.convolution.pairs
    numbers = {
        "newton": counts.newton,
        "cg": counts.cg,
        "gradient": counts.gradient,
        "fft_pairs": pairs,
        "equivalent_fft_pairs": counts.pairs + run.coarse_pairs,
        "levels": run.levels,
    }
    at_cap = it.p >= level.cap
    it.p *= run.mean_pressure
    it.p[at_cap] = run.hardness  # exactly, whatever the rounding of cap = hardness / p0
    return PressureSolution(it.p, it.u, it.z, residuals, numbers, history, notes)


def _put_on_bounds(p: FloatArray, cap: float) -> bool:
    """Put pressures that differ from a bound by the rounding of the force exactly on it.

    Where points at the cap alone carry the load, one of them may otherwise keep 1e-15 of it, be
    counted as elastic and set the offset: the state then depends on the order of a sum. Returns
    whether there were such points.
    """
    rounding = 8 * p.size * np.finfo(np.float64).eps
    low, high = (p > 0) & (p < rounding), (p < cap) & (p > cap - rounding)
    p[low], p[high] = 0.0, cap
    return bool(low.any() or high.any())


def checked_symbol(compliance: NDArray[np.floating], shape: tuple[int, ...]) -> Symbol:
    """A user's compliance per mode of `numpy.fft.rfftn` as a Symbol; a line becomes (1, n).

    Raises InvalidScene unless it has the modes' shape, is finite, positive but for mode zero,
    and belongs to a real symmetric operator.
    """
    values = np.atleast_2d(np.array(compliance, dtype=np.float64))
    grid = (1, shape[0]) if len(shape) == 1 else (shape[0], shape[1])
    expected = (grid[0], grid[1] // 2 + 1)
    if values.shape != expected:
        raise InvalidScene(
            f"compliance has shape {np.shape(compliance)}, but one value per mode of the real "
            f"transform of {shape} heights is needed: {expected}"
        )
    good = np.isfinite(values) & (values > 0)
    good[0, 0] = np.isfinite(values[0, 0]) and values[0, 0] >= 0
    if not good.all():
        raise InvalidScene("compliance must be finite and positive in every mode but the mean")
    edges = [0] if grid[1] % 2 else [0, grid[1] // 2]
    mirrored = values[:, edges][-np.arange(grid[0])]
    if not np.allclose(values[:, edges], mirrored, rtol=1e-12, atol=0):
        raise InvalidScene("compliance differs between a mode and its mirror image")
    return Symbol(values, np.arange(grid[0], dtype=np.int32), grid)


def solve_pressure(
    heights: NDArray[np.floating],
    compliance: NDArray[np.floating],
    mean_pressure: float,
    hardness: float = math.inf,
    *,
    options: Options | None = None,
    start: NDArray[np.floating] | None = None,
) -> PressureSolution:
    """Solve on plain arrays.

    heights: (nx, ny) or (nx,), in m; compliance: one value in m/Pa per mode of
    `numpy.fft.rfftn(heights)`, mode zero being ignored; pressures in Pa; start: a pressure field.

    Raises InvalidScene for input that makes no problem, NotConverged.
    """
    h = np.asarray(heights, dtype=np.float64)
    if h.ndim not in (1, 2) or not np.isfinite(h).all():
        raise InvalidScene("heights must be a finite array of one or two dimensions")
    if not 0 < mean_pressure < hardness:
        raise InvalidScene(
            f"mean_pressure is {mean_pressure:g} Pa, but must lie between 0 and the hardness of "
            f"{hardness:g} Pa"
        )
    symbol = checked_symbol(compliance, h.shape)
    first = None if start is None else checked_start(start, h.shape).reshape(symbol.shape)
    solution = solve_symbol(
        np.ascontiguousarray(h).reshape(symbol.shape),
        symbol, mean_pressure, hardness, options or Options(), first,
    )  # fmt: skip
    return replace(
        solution,
        pressure=solution.pressure.reshape(h.shape),
        displacement=solution.displacement.reshape(h.shape),
    )


def checked_start(start: NDArray[np.floating], shape: tuple[int, ...]) -> FloatArray:
    """A start pressure as a finite float64 array of the grid's shape.

    Raises InvalidScene.
    """
    first = np.asarray(start, dtype=np.float64)
    if first.shape != shape or not np.isfinite(first).all():
        raise InvalidScene(
            f"start has shape {np.shape(start)}, but a finite pressure field of shape {shape} "
            "is needed"
        )
    return first
