"""Solve a scene by boundary elements: check input and memory, and put the result together.

The modules below this one do not know the scene: they take a `GridProblem` for each load, and
`Options`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.areas.distribution import pressure_distribution
from epcontact.bem.areas.rim_correction import estimate_areas
from epcontact.bem.flow import (
    at_hardness_again,
    checked_plastic_displacement,
    flowed,
    unloaded,
)
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


@dataclass(frozen=True)
class _Watch:
    """What `solve` calls on the way; see its arguments."""

    progress: Callable[[float, str], None] | None = None
    on_step: Callable[[ContactResult], None] | None = None

    def of_load(
        self, scene: Scene, tolerance: float, load: int
    ) -> Callable[[tuple[int, ...], float], None] | None:
        """Return the progress of the load of a number, as a function of grid and residual.

        A grid has its share of the work by its points, so that all coarser ones have a quarter of
        its own, and residuals fall by equal factors in equal times.
        """
        progress, path, size = self.progress, scene.load.path, scene.surface.heights.size
        if progress is None:
            return None

        def told(grid: tuple[int, ...], residual: float) -> None:
            settled = math.log(max(residual, tolerance)) / math.log(tolerance)
            share = math.prod(grid) / size * (0.25 + 0.75 * min(max(settled, 0.0), 1.0))
            words = " x ".join(map(str, grid))
            sentence = f"bem: mean pressure {path[load]:.3g} Pa, {words} points, residual "
            progress((load + share) / len(path), f"{sentence}{residual:.1e}")

        return told


def solve(  # noqa: PLR0913 - options by keyword only, each with its default
    scene: Scene,
    *,
    tolerance: float = 1e-8,
    area_tolerance: float | None = None,
    threads: int | None = None,
    compliance: NDArray[np.floating] | None = None,
    method: Method = "newton",
    start: NDArray[np.floating] | None = None,
    plastic_displacement: NDArray[np.floating] | None = None,
    max_steps: int | None = None,
    progress: Callable[[float, str], None] | None = None,
    on_step: Callable[[ContactResult], None] | None = None,
) -> ContactResult:
    """Solve the capped contact problem of a scene at each mean pressure of its load path.

    The path may go down and up again.  Each load meets the surface that the loads before it have
    left behind: where the pressure reached the hardness, flow has lowered it (`bem.flow`).

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
        plastic_displacement: how far earlier flow has lowered the surface, in m, of the heights'
            shape: the field of this name of an earlier result, whose path this one continues.
        max_steps: most steps of the method; None: its own limit.
        progress: called now and then with the share of the path that is done and a sentence.
        on_step: called at each load with the result so far, whose fields are those of that load;
            it must not change them.

    Returns:
        The areas and other quantities at each load, and the fields at the last one.  The fields
        gap and heights refer to the surface before any flow, so that the open gap is gap +
        plastic_displacement.

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
    cores = available_cores() if threads is None else threads
    options = Options(tolerance, area_tolerance, cores, method, max_steps)
    started, compiled = time.perf_counter(), compile_seconds()
    surface, material = scene.surface, scene.material
    mean_pressure = scene.load.final or max(scene.load.path)
    lightest = min(mean_pressure, material.hardness - mean_pressure)
    modulus = effective_modulus(material)
    needed = estimated_memory(surface.heights, surface.spacing, lightest, modulus)
    require_memory(needed, surface.shape)
    symbol = _symbol(scene, compliance)
    warm = None if start is None else checked_start(start, surface.shape).reshape(symbol.shape)
    sunk: FloatArray | None = None
    if plastic_displacement is not None:
        sunk = checked_plastic_displacement(plastic_displacement, surface.shape)
        sunk = sunk.reshape(symbol.shape)
    steps, solution, sunk, totals = _walk(
        scene, symbol, options, warm, sunk, _Watch(progress, on_step)
    )
    cost = totals | {
        "seconds": time.perf_counter() - started - (compile_seconds() - compiled),
        "unknowns": float(surface.heights.size),
        "peak_memory_bytes": float(peak_memory()),
    }
    result = _result(scene, options, steps, solution, sunk, cost)
    if compliance is None:
        return result
    given = {**result.provenance.options, "compliance": "given"}
    return replace(result, provenance=replace(result.provenance, options=given))


def _walk(
    scene: Scene,
    symbol: Symbol,
    options: Options,
    warm: FloatArray | None,
    sunk: FloatArray | None,
    watch: _Watch,
) -> tuple[tuple[LoadStep, ...], PressureSolution, FloatArray | None, dict[str, float]]:
    """Solve at each load of the path, on the surface that the loads before it have left.

    Args:
        scene, symbol, options: the scene, its compliance and the options.
        warm: pressure in Pa to start the first load from.
        sunk: plastic displacement before the first load, in m.
        watch: what is called on the way.

    Returns:
        The load steps, the solution at the last load, the plastic displacement on which that load
        was solved, and the pairs of transforms of all loads.
    """
    heights, hardness = scene.surface.heights.reshape(symbol.shape), scene.material.hardness
    left = heights if sunk is None else heights - sunk
    steps: list[LoadStep] = []
    totals = dict.fromkeys(("fft_pairs", "equivalent_fft_pairs"), 0.0)
    loads = iter(scene.load.path)
    mean_pressure = next(loads)
    while True:
        problem = GridProblem(left, symbol, mean_pressure, hardness)
        watched = replace(options, progress=watch.of_load(scene, options.tolerance, len(steps)))
        solution = solve_problem(problem, watched, warm) if mean_pressure else unloaded(problem)
        if sunk is not None:
            at_hardness_again(problem, solution, sunk)
        steps.append(_load_step(scene, problem, solution, sunk))
        totals = {name: count + solution.counts[name] for name, count in totals.items()}
        if watch.on_step is not None:
            # `_result` adds the compression of a layer to the displacement in place.
            own = replace(solution, displacement=solution.displacement.copy())
            watch.on_step(_result(scene, options, tuple(steps), own, sunk, dict(totals)))
        following = next(loads, None)
        if following is None:
            return tuple(steps), solution, sunk, totals
        if following < mean_pressure and math.isfinite(hardness):
            sunk = flowed(problem, solution, sunk)
            left = heights - sunk
        warm = _warm_start(replace(problem, heights=left), solution, following)
        del solution  # its fields would stay in memory beside those of the next load
        mean_pressure = following


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
    if not problem.mean_pressure:
        return None
    ratio = mean_pressure / problem.mean_pressure
    if not 1 / _WARM_RATIO <= ratio <= _WARM_RATIO:
        return None
    gap = last.displacement + (last.offset - problem.heights)
    return np.asarray(last.pressure * ratio - GRADIENT_STEP / problem.symbol.shortest() * gap)


def _load_step(
    scene: Scene, problem: GridProblem, solution: PressureSolution, before: FloatArray | None
) -> LoadStep:
    """The step of a solution on the surface that the plastic displacement `before` has left."""
    shape, hardness = scene.surface.shape, problem.hardness
    pressure, gap = solution.pressure, solution.displacement + (solution.offset - problem.heights)
    plastic = pressure >= hardness
    separation = float(gap.mean())
    sunk = 0.0
    if before is not None:
        separation -= float(before.mean())
        sunk = float(before.mean(where=~plastic)) * float(np.mean(~plastic))
        # Fronts of plastic flow are placed by the whole depth of the flow.
        np.subtract(gap, before, out=gap, where=plastic)
    if plastic.any():
        sunk -= float(gap.mean(where=plastic)) * float(plastic.mean())
    raw, corrected, error = estimate_areas(
        pressure.reshape(shape),
        gap.reshape(shape),
        hardness,
        scene.surface.spacing,
        effective_modulus(scene.material),
    )
    compression = _compression(scene, problem.mean_pressure)
    # Unlike a product of a linear algebra library, this starts no threads.
    fluctuation = float(np.einsum("ij,ij->", pressure, solution.displacement)) / gap.size
    quantities = {
        "mean_gap": float(np.maximum(gap, 0).mean()),
        "mean_plastic_displacement": sunk,
        "plastic_work": hardness * sunk if sunk else 0.0,
        "mean_separation": separation,
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
    before: FloatArray | None,
    cost: dict[str, float],
) -> ContactResult:
    shape, hardness = scene.surface.shape, scene.material.hardness
    pressure = solution.pressure.reshape(shape)
    displacement = solution.displacement.reshape(shape)
    gap = displacement + (solution.offset - scene.surface.heights)
    displacement += _compression(scene, steps[-1].mean_pressure)
    fields: dict[str, NDArray[Any]] = {
        "heights": scene.surface.heights,
        "pressure": pressure,
        "gap": gap,
        "displacement": displacement,
        "state": states(pressure, hardness),
    }
    if math.isfinite(hardness):
        deeper = np.maximum(-gap, 0.0, out=np.zeros(shape), where=pressure >= hardness)
        # On the hardness -gap is all of the plastic displacement, the earlier one included.
        fields["plastic_displacement"] = (
            deeper if before is None else np.maximum(deeper, before.reshape(shape), out=deeper)
        )
    chosen: dict[str, Any] = {"method": options.method, "tolerance": options.tolerance}
    if options.area_tolerance:
        chosen["area_tolerance"] = options.area_tolerance
    return ContactResult(
        method="bem",
        steps=steps,
        provenance=Provenance(scene.digest, scene.surface.seed, chosen),
        distribution=pressure_distribution(pressure, hardness, _DISTRIBUTION_BINS),
        fields=fields,
        cost=cost,
        history=solution.history,
        notes=scene.surface.notes + solution.notes,
    )
