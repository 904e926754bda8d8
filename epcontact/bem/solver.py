"""Solve a grid problem, from coarse grids to the finest one.

Each grid starts from the solution on a grid of half as many points in each direction.
Coarse heights are the fine ones without the modes that the coarse grid cannot hold.
The coarse solution is passed on as p - c g, interpolated by cubics.  This field is
positive in contact, negative outside it, and above the cap where the pressure is
capped.  It crosses these bounds at the fronts, so the fronts with which the fine grid
starts are right to a fraction of a coarse cell.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import ducc0
import numpy as np
from numpy.typing import NDArray

from epcontact.bem.bounds import project
from epcontact.bem.level import (
    Iterate,
    Level,
    kkt_residuals,
    measure_iterate,
    put_on_bounds,
)
from epcontact.bem.newton import solve_level
from epcontact.bem.problem import (
    GridProblem,
    Options,
    PressureSolution,
    start_pressure,
    symbol_from_compliance,
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
_COARSE_AREAS = 1e-3
_COARSE_RESIDUAL = 1e-4
# Heights are shifted by their first value if it is more than this multiple of their
# range, because a large datum would cost gaps digits.
_FAR_DATUM = 10
_POINTS_AT_ONCE = 65536  # of `interpolated`


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
    hardness = positive("hardness", hardness, "Pa", finite=False)
    expected = f"a number between 0 and the hardness of {hardness:g} Pa"
    load = number("mean_pressure", mean_pressure, expected, lambda p: 0 < p < hardness)
    symbol = symbol_from_compliance(compliance, h.shape)
    if start is not None:
        start = start_pressure(start, h.shape).reshape(symbol.shape)
    grid_heights = np.ascontiguousarray(h).reshape(symbol.shape)
    problem = GridProblem(grid_heights, symbol, load, hardness)
    solution = solve_problem(problem, options or Options(), start)
    return replace(
        solution,
        pressure=solution.pressure.reshape(h.shape),
        displacement=solution.displacement.reshape(h.shape),
    )


def solve_problem(
    problem: GridProblem, options: Options, start: FloatArray | None = None
) -> PressureSolution:
    """Solve a grid problem with a mean pressure above 0.

    problem: heights, compliance, mean pressure and hardness; options: how to solve;
    start: (nx, ny) pressure in Pa to start from; None: start on coarser grids.  Raises
    NotConverged if the tolerance is not met within the steps allowed.
    """
    datum = float(problem.heights[0, 0])
    if abs(datum) > _FAR_DATUM * float(np.ptp(problem.heights)):
        problem = replace(problem, heights=problem.heights - datum)
    else:
        datum = 0.0
    scale = problem.gap_scale()
    cap = problem.cap
    size = problem.heights.size
    with Workers(options.threads) as workers:
        coarse_work: list[float] = []
        if start is not None:
            # No point can carry more than the total load, and larger values would cost
            # digits.
            guess = np.clip(start / problem.mean_pressure, -size, min(cap, size))
        elif options.method is None:
            guess, coarse_work = _coarse_guess(problem, scale, options, workers)
        else:
            guess = np.ones(problem.symbol.shape)
        level = Level(problem, scale, workers)
        p = project(guess, cap, float(size), workers, out=guess)
        iterate = (options.method or solve_level)(level, p, options)
        if put_on_bounds(level, iterate.p):
            iterate.z, _, _ = measure_iterate(level, iterate.p, iterate.u)
        residuals = kkt_residuals(level, iterate)
    if not iterate.settled:
        raise NotConverged(
            f"{options.method_name} did not reach {options.tolerance:g} in "
            f"{len(iterate.history) - 1} steps: "
            f"the largest residual is {max(residuals.values()):.1e}; "
            "give more steps or a larger tolerance",
            residuals,
            tuple(iterate.history),
        )
    coarse_pairs = sum(work / size for work in coarse_work)
    counts = {
        "newton": iterate.newton,
        "cg": iterate.cg,
        "gradient": iterate.gradient,
        "fft_pairs": level.convolution.pairs,
        "equivalent_fft_pairs": iterate.pairs + coarse_pairs,
        "levels": len(coarse_work) + 1,
    }
    at_cap = iterate.p >= cap
    iterate.p *= problem.mean_pressure
    iterate.p[at_cap] = problem.hardness  # exactly, whatever the rounding of the cap
    return PressureSolution(
        iterate.p,
        iterate.u,
        iterate.z + datum,
        residuals,
        counts,
        tuple(iterate.history),
        _notes(iterate),
    )


def _notes(iterate: Iterate) -> tuple[str, ...]:
    """Return sentences for the user about fallbacks of a solve; none if it had none.

    iterate: the state and the numbers of steps at the end of the solve.
    """
    if not iterate.cut:
        return ()
    return (
        f"{iterate.cut} of {iterate.newton} Newton steps would have raised the energy "
        f"and were cut short; {iterate.gradient} projected gradient steps followed "
        "them.",
    )


def _coarse_guess(
    problem: GridProblem, scale: float, options: Options, workers: Workers
) -> tuple[FloatArray, list[float]]:
    """Return a start for a grid from the next coarser one, and the work done for it.

    The start (nx, ny) is in units of the mean pressure, and uniform if no grid is
    coarser.  The work is the number of pairs of transforms of each coarser grid times
    its points.

    problem: the grid for which a start is needed; scale: length in m by which gap
    residuals are divided; options: of the solve on the finest grid; workers: threads.
    """
    shape = coarser(problem.symbol)
    if shape is None:
        return np.ones(problem.symbol.shape), []
    coarse = replace(
        problem,
        heights=coarsened_heights(problem.heights, shape, workers),
        symbol=problem.symbol.once(Symbol.coarsened, shape),
    )
    guess, work = _coarse_guess(coarse, scale, options, workers)
    level = Level(coarse, scale, workers)
    size = coarse.heights.size
    p = project(guess, level.cap, float(size), workers, out=guess)
    coarse_options = replace(
        options,
        tolerance=max(_COARSE_RESIDUAL, options.tolerance),
        area_tolerance=_COARSE_AREAS,
    )
    iterate = solve_level(level, p, coarse_options)
    gap = iterate.u + iterate.z - coarse.heights
    field = iterate.p - level.step * gap
    work.append(iterate.pairs * size)
    return interpolated(field, problem.symbol.shape, workers), work


def coarser(symbol: Symbol) -> tuple[int, int] | None:
    """Return the shape (nx, ny) of the next coarser grid; None if there is none.

    symbol: compliance of each mode of the grid.  Each direction of more than COARSEST
    points is halved.  If points are far apart along one axis, the other axis is halved
    alone as long as it can be.
    """
    nx, ny = symbol.shape
    x_far, y_far = symbol.far()
    half_x = _half(nx)
    half_y = _half(ny)
    if x_far and half_y < ny:
        half_x = nx
    elif y_far and half_x < nx:
        half_y = ny
    shape = (half_x, half_y)
    return None if shape == symbol.shape else shape


def _half(number: int) -> int:
    """Return half as many points of a direction, or a few more for fast transforms.

    A number of at most COARSEST points is returned as it is.
    """
    if number <= COARSEST:
        return number
    half = (number + 1) // 2
    if half < 64 or number % 4 == 0:
        return half
    return 16 * int(ducc0.fft.good_size(-(-half // 16), True))


def coarsened_heights(
    heights: FloatArray, shape: tuple[int, int], workers: Workers
) -> FloatArray:
    """Return heights on a coarser grid of the same periods.

    They lack the modes that the coarse grid cannot hold, and the unpaired mode of an
    even number of points.

    heights: (nx, ny) in m; shape: (mx, my) of the result, at most (nx, ny); workers:
    threads of the transforms.
    """
    nx, ny = heights.shape
    mx, my = shape
    rows_kept = (mx + 1) // 2 if mx < nx else mx
    columns_kept = (my + 1) // 2 if my < ny else my // 2 + 1
    fine = np.empty((nx, columns_kept), dtype=np.complex128)
    coarse = np.zeros((mx, my // 2 + 1), dtype=np.complex128)
    out = np.empty(shape)

    def cut(block: ComplexArray, columns: slice) -> ComplexArray:
        """Return modes of the coarse grid, (mx, columns).

        block: (nx, columns) modes of the fine grid; columns: which columns these are.
        """
        target = coarse[:, columns]
        target[:rows_kept] = block[:rows_kept]
        if mx < nx and rows_kept > 1:
            target[1 - rows_kept :] = block[1 - rows_kept :]
        target /= nx * ny
        return target

    step = max(1, BLOCK_POINTS // ny)
    rows = ranges(nx, step)
    workers.each(to_modes, split(heights, rows), split(fine, rows))
    through_columns(workers, fine, max(8, BLOCK_POINTS // (2 * nx)), cut)
    rows = ranges(mx, step)
    workers.each(to_values, split(coarse, rows), split(out, rows))
    return out


def interpolated(
    coarse: FloatArray, shape: tuple[int, ...], workers: Workers
) -> FloatArray:
    """Return a periodic field on a finer grid, by cubic interpolation.

    coarse: (mx, my); shape: (nx, ny) of the result; workers: threads.
    """
    index, weights = _neighbours(coarse.shape[0], shape[0])
    columns, column_weights = _neighbours(coarse.shape[1], shape[1])
    out = np.empty(shape)
    rows = ranges(shape[0], max(1, _POINTS_AT_ONCE // shape[1]))
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
    """Return the four coarse neighbours of each fine point and their cubic weights.

    coarse, fine: points of a period.  Both results are (fine, 4).
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
    """Write the weighted sums of the 4 x 4 coarse neighbours of each point to `out`.

    coarse: (mx, my); rows, row_weights: (rows of out, 4) coarse rows beside each row of
    out, and their weights; columns, column_weights: (columns of out, 4) the same for
    the columns; out: rows of the fine grid, overwritten.
    """
    line = np.empty(coarse.shape[1])
    for i in range(out.shape[0]):
        a = coarse[rows[i, 0]]
        b = coarse[rows[i, 1]]
        c = coarse[rows[i, 2]]
        d = coarse[rows[i, 3]]
        w = row_weights[i]
        for j in range(line.size):
            line[j] = w[0] * a[j] + w[1] * b[j] + w[2] * c[j] + w[3] * d[j]
        for j in range(out.shape[1]):
            value = 0.0
            for k in range(4):
                value += column_weights[j, k] * line[columns[j, k]]
            out[i, j] = value
