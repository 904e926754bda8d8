"""Solve a grid problem, from coarse grids to the finest one.

`solve_pressure` takes plain arrays; `solve_problem` takes a `GridProblem`, which the driver makes
from a scene.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.baselines import BASELINES
from epcontact.bem.bounds import project
from epcontact.bem.cascade import coarsened_heights, coarser, interpolated
from epcontact.bem.level import Level, kkt_residuals, measured, put_on_bounds
from epcontact.bem.newton import solve_level
from epcontact.bem.problem import (
    GridProblem,
    Options,
    PressureSolution,
    checked_start,
    checked_symbol,
)
from epcontact.bem.transforms import Symbol
from epcontact.bem.workers import Workers
from epcontact.errors import InvalidScene, NotConverged
from epcontact.results import FloatArray
from epcontact.scene import array, number, positive

# Tolerances on the coarse grids.  With 1e-4 for the areas, finer grids took as many steps; with
# 1e-2 they took more where there are many points a wavelength.
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
        compliance: one value in m/Pa for each mode of `numpy.fft.rfftn(heights)`; mode zero is
            ignored.
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
        Under half of the load that flattens a wave, half of its length is in contact (E* = 1).

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
    first = None if start is None else checked_start(start, h.shape).reshape(symbol.shape)
    grid = np.ascontiguousarray(h).reshape(symbol.shape)
    problem = GridProblem(grid, symbol, load, cap)
    solution = solve_problem(problem, options or Options(), first)
    return replace(
        solution,
        pressure=solution.pressure.reshape(h.shape),
        displacement=solution.displacement.reshape(h.shape),
    )


def solve_problem(
    problem: GridProblem, options: Options, start: FloatArray | None = None
) -> PressureSolution:
    """Solve from coarse to fine, or from a pressure `start` (nx, ny) in Pa."""
    problem, datum = _lowered(problem)
    scale, cap, size = problem.gap_scale(), problem.cap, problem.heights.size
    with Workers(options.threads) as workers:
        coarse_work: list[float] = []
        if start is not None:
            # No point can carry more than the whole load, and larger values would cost digits.
            guess = np.clip(start / problem.mean_pressure, -size, min(cap, size))
        elif options.method == "newton":
            guess, coarse_work = _coarse_guess(problem, scale, options, workers)
        else:
            guess = np.ones(problem.shape)
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
    history, offset, notes = tuple(it.history), it.z + datum, []
    if it.cut:
        notes.append(
            f"{it.cut} of {it.newton} Newton steps would have raised the energy and were "
            f"cut short; {it.gradient} projected gradient steps followed them."
        )
    return PressureSolution(it.p, it.u, offset, residuals, counts, history, tuple(notes))


def _lowered(problem: GridProblem) -> tuple[GridProblem, float]:
    """Subtract a datum from heights that are far from zero; return the problem and the datum.

    A gap is a difference of heights, and a large common part would cost it digits.
    """
    heights = problem.heights
    datum = float(heights[0, 0])
    if abs(datum) <= 10 * float(np.ptp(heights)):
        return problem, 0.0
    return replace(problem, heights=heights - datum), datum


def _coarse_guess(
    problem: GridProblem, scale: float, options: Options, workers: Workers
) -> tuple[FloatArray, list[float]]:
    """A start for a grid from the next coarser one, and the work done for it.

    The start is p - c g of the coarser grid, interpolated; it is uniform if there is no coarser
    grid.  The work of each grid is its pairs of transforms times its points.
    """
    below = coarser(problem.symbol)
    if below is None:
        return np.ones(problem.shape), []
    coarse = replace(
        problem,
        heights=coarsened_heights(problem.heights, below, workers),
        symbol=problem.symbol.once(Symbol.coarsened, below),
    )
    guess, work = _coarse_guess(coarse, scale, options, workers)
    level = Level(coarse, scale, workers)
    size = coarse.heights.size
    p = project(guess, level.cap, float(size), workers, out=guess)
    tolerance = max(_COARSE_RESIDUAL, options.tolerance)
    loose = replace(options, tolerance=tolerance, area_tolerance=_COARSE_AREAS)
    it = solve_level(level, p, loose)
    w = it.p - level.step * (it.u + it.z - coarse.heights)
    return interpolated(w, problem.shape, workers), [*work, it.pairs * size]
