"""Solve a grid problem, from coarse grids to the finest one.

Each grid starts from the solution on a grid of half as many points in each direction.
Coarse heights are the fine ones without the modes that the coarse grid cannot hold.
The coarse solution is passed on as p - c g, interpolated by cubics.  It is positive in
contact, negative outside it and above the cap where the pressure is capped.  It crosses
these bounds at the fronts, so the fine grid starts with fronts that are right to a
fraction of a coarse cell.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import ducc0
import numpy as np
from numpy.typing import NDArray

from epcontact.bem.baselines import BASELINES
from epcontact.bem.bounds import project
from epcontact.bem.level import Level, kkt_residuals, measured, put_on_bounds
from epcontact.bem.newton import solve_level
from epcontact.bem.problem import (
    GridProblem,
    Options,
    PressureSolution,
    checked_start,
    checked_symbol,
)
from epcontact.bem.transforms import (
    BLOCK_POINTS,
    ComplexArray,
    Symbol,
    through_columns,
    to_modes,
    to_values,
)
from epcontact.bem.workers import Workers, compiled, ranges, split
from epcontact.errors import InvalidScene, NotConverged
from epcontact.results import FloatArray
from epcontact.scene import array, number, positive

#: A direction of at most this many points is not coarsened further.  Solves of 107
#: scenes took 6 % less time than with 32, because the calls of a small grid cost more
#: than its points.
COARSEST = 64
# Tolerances on the coarse grids.  With 1e-4 for the areas, finer grids took as many
# steps; with 1e-2 they took more where there are many points a wavelength.
_COARSE_AREAS, _COARSE_RESIDUAL = 1e-3, 1e-4


def solve_pressure(
    heights: NDArray[np.floating],
    compliance: NDArray[np.floating],
    mean_pressure: float,
    hardness: float = math.inf,
    *,
    options: Options | None = None,
    start: NDArray[np.floating] | None = None,
) -> PressureSolution:
    """Solve the capped contact problem on plain arrays.

    Args:
        heights: (nx, ny) or (nx,), in m.
        compliance: one value in m/Pa for each mode of `numpy.fft.rfftn(heights)`; mode
            zero is ignored.
        mean_pressure: in Pa.
        hardness: in Pa, may be infinite.
        options: how to solve; None: the defaults.
        start: pressure field in Pa to start from, instead of coarser grids.

    Returns:
        Fields of the shape of the heights.

    Raises:
        InvalidScene: the input is not valid.
        NotConverged: the tolerance was not met within the steps allowed.

    Example:
        Under half of the load that flattens a wave, half of its length is in contact
        (E* = 1).

        >>> h = np.cos(2 * np.pi * np.arange(8) / 8)
        >>> q = 2 * np.pi * np.arange(5) / 8
        >>> q[0] = np.inf
        >>> solution = solve_pressure(h, 2 / q, mean_pressure=np.pi / 8 / 2)
        >>> int(np.count_nonzero(solution.pressure))
        5
    """
    h = array("heights", heights)
    if h.ndim not in (1, 2) or not np.isfinite(h).all():
        raise InvalidScene("heights must be a finite array of one or two dimensions")
    cap = positive("hardness", hardness, "Pa", finite=False)
    right = f"a number between 0 and the hardness of {cap:g} Pa"
    load = number("mean_pressure", mean_pressure, right, lambda p: 0 < p < cap)
    symbol = checked_symbol(compliance, h.shape)
    if start is not None:
        start = checked_start(start, h.shape).reshape(symbol.shape)
    problem = GridProblem(
        np.ascontiguousarray(h).reshape(symbol.shape), symbol, load, cap
    )
    solution = solve_problem(problem, options or Options(), start)
    p, u = solution.pressure.reshape(h.shape), solution.displacement.reshape(h.shape)
    return replace(solution, pressure=p, displacement=u)


def solve_problem(
    problem: GridProblem, options: Options, start: FloatArray | None = None
) -> PressureSolution:
    """Solve from coarse to fine, or from a pressure `start` (nx, ny) in Pa."""
    datum = float(problem.heights[0, 0])
    if abs(datum) > 10 * float(np.ptp(problem.heights)):  # which would cost gaps digits
        problem = replace(problem, heights=problem.heights - datum)
    else:
        datum = 0.0
    scale, cap, size = problem.gap_scale(), problem.cap, problem.heights.size
    with Workers(options.threads) as workers:
        coarse_work: list[float] = []
        if start is not None:
            # No point can carry more than the whole load, and larger values would cost
            # digits.
            guess = np.clip(start / problem.mean_pressure, -size, min(cap, size))
        elif options.method == "newton":
            guess, coarse_work = _coarse_guess(problem, scale, options, workers)
        else:
            guess = np.ones(problem.symbol.shape)
        level = Level(problem, scale, workers)
        p = project(guess, cap, float(size), workers, out=guess)
        it = BASELINES.get(options.method, solve_level)(level, p, options)
        if put_on_bounds(level, it.p):
            it.z, _, _ = measured(level, it.p, it.u)
        residuals = kkt_residuals(level, it)
    if not it.settled:
        raise NotConverged(
            f"{options.method} did not reach {options.tolerance:g} in {len(it.history) - 1} steps: "
            f"the largest residual is {max(residuals.values()):.1e}; "
            "give more steps or a larger tolerance",
            residuals,
            tuple(it.history),
        )
    counts = {
        "newton": it.newton,
        "cg": it.cg,
        "gradient": it.gradient,
        "fft_pairs": level.convolution.pairs,
        "equivalent_fft_pairs": it.pairs + sum(work / size for work in coarse_work),
        "levels": len(coarse_work) + 1,
    }
    at_cap = it.p >= cap
    it.p *= problem.mean_pressure
    it.p[at_cap] = problem.hardness  # exactly, whatever the rounding of the cap
    note = (
        f"{it.cut} of {it.newton} Newton steps would have raised the energy and were "
        f"cut short; {it.gradient} projected gradient steps followed them."
    )
    history, notes = tuple(it.history), (note,) if it.cut else ()
    return PressureSolution(it.p, it.u, it.z + datum, residuals, counts, history, notes)


def _coarse_guess(
    problem: GridProblem, scale: float, options: Options, workers: Workers
) -> tuple[FloatArray, list[float]]:
    """A start for a grid from the next coarser one, or a uniform one, and the work done
    for it: the pairs of transforms of each grid times its points.
    """
    below = coarser(problem.symbol)
    if below is None:
        return np.ones(problem.symbol.shape), []
    coarse = replace(
        problem,
        heights=coarsened_heights(problem.heights, below, workers),
        symbol=problem.symbol.once(Symbol.coarsened, below),
    )
    guess, work = _coarse_guess(coarse, scale, options, workers)
    level, size = Level(coarse, scale, workers), coarse.heights.size
    p = project(guess, level.cap, float(size), workers, out=guess)
    tolerance = max(_COARSE_RESIDUAL, options.tolerance)
    it = solve_level(
        level, p, replace(options, tolerance=tolerance, area_tolerance=_COARSE_AREAS)
    )
    w = it.p - level.step * (it.u + it.z - coarse.heights)
    return interpolated(w, problem.symbol.shape, workers), [*work, it.pairs * size]


def coarser(symbol: Symbol) -> tuple[int, int] | None:
    """Halve each direction of more than COARSEST points; None if there is none.  Where
    points are far apart along one axis, the other is halved alone as long as it can be.
    """
    (nx, ny), (x_far, y_far) = symbol.shape, symbol.far()
    mx, my = (_half(n) if n > COARSEST else n for n in symbol.shape)
    near = nx if x_far else mx, ny if y_far else my
    chosen = (mx, my) if near == symbol.shape else near
    return None if chosen == symbol.shape else chosen


def _half(number: int) -> int:
    """Half as many points, or a few more, so that large grids transform fast on all
    levels.
    """
    half = (number + 1) // 2
    if half < 64 or number % 4 == 0:
        return half
    return 16 * int(ducc0.fft.good_size(-(-half // 16), True))


def coarsened_heights(
    heights: FloatArray, shape: tuple[int, int], workers: Workers
) -> FloatArray:
    """Heights on a coarser grid of the same periods, without the modes it cannot hold.
    The unpaired mode of an even number of points is left out, too.
    """
    (nx, ny), (mx, my) = heights.shape, shape
    kept_rows = (mx + 1) // 2 if mx < nx else mx
    kept_columns = (my + 1) // 2 if my < ny else my // 2 + 1
    fine = np.empty((nx, kept_columns), dtype=np.complex128)
    coarse = np.zeros((mx, my // 2 + 1), dtype=np.complex128)
    out = np.empty(shape)
    step = max(1, BLOCK_POINTS // ny)

    def cut(block: ComplexArray, columns: slice) -> ComplexArray:
        target = coarse[:, columns]
        target[:kept_rows] = block[:kept_rows]
        if mx < nx and kept_rows > 1:
            target[1 - kept_rows :] = block[1 - kept_rows :]
        target /= nx * ny
        return target

    rows = ranges(nx, step)
    workers.each(to_modes, split(heights, rows), split(fine, rows))
    through_columns(workers, fine, max(8, BLOCK_POINTS // (2 * nx)), cut)
    rows = ranges(mx, step)
    workers.each(to_values, split(coarse, rows), split(out, rows))
    return out


def interpolated(
    coarse: FloatArray, shape: tuple[int, ...], workers: Workers
) -> FloatArray:
    """Interpolate a periodic field to a finer grid, by cubics through four points a
    direction.
    """
    index, weights = _neighbours(coarse.shape[0], shape[0])
    columns, column_weights = _neighbours(coarse.shape[1], shape[1])
    out = np.empty(shape)
    rows = ranges(shape[0], max(1, 65536 // shape[1]))
    workers.each(
        interpolate,
        coarse,
        split(index, rows),
        split(weights, rows),
        columns,
        column_weights,
        split(out, rows),
    )
    return out


def _neighbours(coarse: int, fine: int) -> tuple[NDArray[np.int32], FloatArray]:
    """Four coarse neighbours of each fine point, periodically, and their cubic
    weights.
    """
    position = np.arange(fine) * (coarse / fine)
    left = np.floor(position).astype(np.int64)
    t = position - left
    weights = [
        -t * (t - 1) * (t - 2) / 6,
        (t + 1) * (t - 1) * (t - 2) / 2,
        -(t + 1) * t * (t - 2) / 2,
        (t + 1) * t * (t - 1) / 6,
    ]
    neighbours = (left[:, None] + np.arange(-1, 3)) % coarse
    return neighbours.astype(np.int32), np.stack(weights, axis=1)


@compiled
def interpolate(
    coarse: Any,
    rows: Any,
    row_weights: Any,
    columns: Any,
    column_weights: Any,
    out: Any,
) -> None:
    """out[i, j] = the weighted sum of the 4 x 4 coarse neighbours."""
    line = np.empty(coarse.shape[1])
    for i in range(out.shape[0]):
        a, b, c, d = (
            coarse[rows[i, 0]],
            coarse[rows[i, 1]],
            coarse[rows[i, 2]],
            coarse[rows[i, 3]],
        )
        w = row_weights[i]
        for j in range(line.size):
            line[j] = w[0] * a[j] + w[1] * b[j] + w[2] * c[j] + w[3] * d[j]
        for j in range(out.shape[1]):
            value = 0.0
            for k in range(4):
                value += column_weights[j, k] * line[columns[j, k]]
            out[i, j] = value
