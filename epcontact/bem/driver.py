"""Solve a scene by boundary elements: check input and memory, and put the result together.

The modules below this one do not know the scene: they take a `GridProblem` for each load, and
`Options`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.areas.distribution import pressure_distribution
from epcontact.bem.areas.rim_correction import estimate_areas
from epcontact.bem.kernel import quarter_compliance
from epcontact.bem.level import GRADIENT_STEP, states
from epcontact.bem.memory import estimated_memory, require_memory
from epcontact.bem.problem import (
    GridProblem,
    Method,
    Options,
    PressureSolution,
    checked_start,
    checked_symbol,
)
from epcontact.bem.solver import solve_problem
from epcontact.bem.transforms import Symbol
from epcontact.machine import available_cores, compile_seconds, peak_memory
from epcontact.moduli import effective_modulus, oedometric_modulus
from epcontact.results import ContactResult, FloatArray, LoadStep, Provenance
from epcontact.scene import Scene

_DISTRIBUTION_BINS = 1024
# Along a load path the last solution is the better start up to this ratio of loads; beyond it,
# coarse grids give the better one.
_WARM_RATIO = 1.03


def solve(  # noqa: PLR0913 - options by keyword only, each with its default
    scene: Scene,
    *,
    tolerance: float = 1e-8,
    area_tolerance: float | None = None,
    threads: int | None = None,
    compliance: NDArray[np.floating] | None = None,
    method: Method = "newton",
    start: NDArray[np.floating] | None = None,
    max_steps: int | None = None,
    progress: Callable[[str], None] | None = None,
) -> ContactResult:
    """Solve the capped contact problem of a scene at each mean pressure of its load path.

    Args:
        scene: surface, material, body and load.
        tolerance: on the Karush-Kuhn-Tucker residuals, dimensionless.
        area_tolerance: stop as soon as the areas are settled to this relative change (the
            residuals reached are in the result); None: stop only when the residuals meet
            `tolerance`.
        threads: number of threads; None: all cores of the process.
        compliance: surface compliance in m/Pa for each mode of `numpy.fft.rfftn(heights)`,
            instead of the body's own.
        method: "newton", or the name of a baseline.
        start: pressure field in Pa to start the first load from, instead of coarser grids.
        max_steps: most steps of the method; None: its own limit.
        progress: called with a sentence now and then.

    Returns:
        The areas and other quantities at each load, and the fields at the last one.

    Raises:
        InvalidScene: the scene or an option is not valid.
        NotConverged: the tolerance was not met within the steps allowed.
        NotEnoughMemory: the solve is estimated not to fit into memory.

    Example:
        >>> from epcontact import Load, Material, Scene, Surface
        >>> heights = 1e-6 * np.cos(2 * np.pi * np.arange(64) / 64)
        >>> scene = Scene(Surface(heights, (1e-4,)), Material(100e9, 0.0), Load(1e9))
        >>> round(solve(scene).final.areas["corrected"].total, 4)
        0.3816
    """
    scene.require_loading()
    cores = available_cores() if threads is None else threads
    options = Options(tolerance, area_tolerance, cores, method, max_steps, progress)
    started, compiled = time.perf_counter(), compile_seconds()
    surface, material = scene.surface, scene.material
    lightest = min(scene.load.final, material.hardness - scene.load.final)
    modulus = effective_modulus(material)
    needed = estimated_memory(surface.heights, surface.spacing, lightest, modulus)
    require_memory(needed, surface.shape)
    symbol = _symbol(scene, compliance)
    heights = surface.heights.reshape(symbol.shape)
    warm = None if start is None else checked_start(start, surface.shape).reshape(symbol.shape)
    steps: list[LoadStep] = []
    totals = dict.fromkeys(("fft_pairs", "equivalent_fft_pairs"), 0.0)
    for i, mean_pressure in enumerate(scene.load.path):
        problem = GridProblem(heights, symbol, mean_pressure, material.hardness)
        solution = solve_problem(problem, options, warm)
        steps.append(_load_step(scene, problem, solution))
        totals = {name: count + solution.counts[name] for name, count in totals.items()}
        if i + 1 < len(scene.load.path):
            warm = _warm_start(problem, solution, scene.load.path[i + 1])
            del solution  # its fields would stay in memory beside those of the next load
    cost = totals | {
        "seconds": time.perf_counter() - started - (compile_seconds() - compiled),
        "unknowns": float(heights.size),
        "peak_memory_bytes": float(peak_memory()),
    }
    result = _result(scene, options, tuple(steps), solution, cost)
    if compliance is None:
        return result
    given = {**result.provenance.options, "compliance": "given"}
    return replace(result, provenance=replace(result.provenance, options=given))


def _symbol(scene: Scene, compliance: NDArray[np.floating] | None) -> Symbol:
    if compliance is not None:
        return checked_symbol(compliance, scene.surface.shape)
    shape, periods = scene.surface.shape, scene.surface.periods
    if len(shape) == 1:
        shape, periods = (1, shape[0]), (1.0, periods[0])
    grid, lengths = (shape[0], shape[1]), (periods[0], periods[1])
    return Symbol.from_quarter(quarter_compliance(grid, lengths, scene.body, scene.material), grid)


def _warm_start(
    problem: GridProblem, last: PressureSolution, mean_pressure: float
) -> FloatArray | None:
    """Return p - c g of the last solution in Pa, scaled to the next load; None for a distant load.

    Where p is 0, p - c g still shows how far away contact is.
    """
    ratio = mean_pressure / problem.mean_pressure
    if not 1 / _WARM_RATIO <= ratio <= _WARM_RATIO:
        return None
    gap = last.displacement + (last.offset - problem.heights)
    return np.asarray(last.pressure * ratio - GRADIENT_STEP / problem.symbol.shortest() * gap)


def _load_step(scene: Scene, problem: GridProblem, solution: PressureSolution) -> LoadStep:
    shape, hardness = scene.surface.shape, problem.hardness
    pressure, gap = solution.pressure, solution.displacement + (solution.offset - problem.heights)
    raw, corrected, error = estimate_areas(
        pressure.reshape(shape),
        gap.reshape(shape),
        hardness,
        scene.surface.spacing,
        effective_modulus(scene.material),
    )
    compression = _compression(scene, problem.mean_pressure)
    fluctuation = float(np.vdot(pressure, solution.displacement)) / gap.size
    plastic = pressure >= hardness
    sunk = -gap.mean(where=plastic) * float(plastic.mean()) if plastic.any() else 0.0
    quantities = {
        "mean_gap": float(np.maximum(gap, 0).mean()),
        "mean_plastic_displacement": float(sunk),
        "mean_separation": float(gap.mean()),
        "elastic_energy": (fluctuation + compression * problem.mean_pressure) / 2,
        "largest_pressure": float(pressure.max()),
    }
    return LoadStep(
        problem.mean_pressure,
        {"raw": raw, "corrected": corrected, "error": error},
        dict(solution.residuals),
        {name: int(count) for name, count in solution.counts.items()},
        quantities,
    )


def _compression(scene: Scene, mean_pressure: float) -> float:
    """The uniform displacement of a layer's surface, in m; a half-space has none."""
    if scene.body.kind == "half_space":
        return 0.0
    return mean_pressure * scene.body.depth / oedometric_modulus(scene.material)


def _result(
    scene: Scene,
    options: Options,
    steps: tuple[LoadStep, ...],
    solution: PressureSolution,
    cost: dict[str, float],
) -> ContactResult:
    shape, hardness = scene.surface.shape, scene.material.hardness
    pressure = solution.pressure.reshape(shape)
    displacement = solution.displacement.reshape(shape)
    gap = displacement + (solution.offset - scene.surface.heights)
    displacement += _compression(scene, steps[-1].mean_pressure)
    chosen: dict[str, Any] = {"method": options.method, "tolerance": options.tolerance}
    if options.area_tolerance:
        chosen["area_tolerance"] = options.area_tolerance
    return ContactResult(
        method="bem",
        steps=steps,
        provenance=Provenance(scene.digest, scene.surface.seed, chosen),
        distribution=pressure_distribution(pressure, hardness, _DISTRIBUTION_BINS),
        fields={
            "heights": scene.surface.heights,
            "pressure": pressure,
            "gap": gap,
            "displacement": displacement,
            "state": states(pressure, hardness),
        },
        cost=cost,
        history=solution.history,
        notes=scene.surface.notes + solution.notes,
    )
