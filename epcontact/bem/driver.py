"""A scene solved by boundary elements: input checked, memory estimated, result put together."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.areas.distribution import pressure_distribution
from epcontact.bem.areas.estimate import estimate_areas
from epcontact.bem.baselines import BASELINES
from epcontact.bem.constraints import GRADIENT_STEP, states
from epcontact.bem.kernel import quarter_compliance
from epcontact.bem.memory import require_memory
from epcontact.bem.solver import (
    Options,
    PressureSolution,
    checked_start,
    checked_symbol,
    solve_symbol,
)
from epcontact.bem.transforms import Symbol
from epcontact.errors import InvalidScene
from epcontact.machine import available_cores, peak_memory
from epcontact.moduli import effective_modulus, oedometric_modulus
from epcontact.results import ContactResult, FloatArray, LoadStep, Provenance
from epcontact.scene import Scene

Method = Literal["newton", "relaxation", "polonsky_keer", "projected_gradient"]

_DISTRIBUTION_BINS = 1024
# Along a load path the last answer is the better start up to this ratio of loads; beyond it the
# coarse grids are.
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

    tolerance: on the Karush-Kuhn-Tucker residuals, dimensionless.
    area_tolerance: stop as soon as the areas are settled to this relative change (the residuals
        reached are in the result); None: not before the residuals meet `tolerance`.
    threads: of the transforms and passes; None: all cores of the process.
    compliance: surface compliance in m/Pa per mode of `numpy.fft.rfftn(heights)`, in the place
        of the body's own.
    method: "newton", or the name of a baseline.
    start: pressure field in Pa to start the first load from, instead of coarser grids.
    max_steps: of the method; None: its own limit.
    progress: called with a sentence now and then.

    Raises InvalidScene, NotConverged, NotEnoughMemory.
    """
    scene.require_loading()
    _require_options(tolerance, area_tolerance, threads, method, max_steps)
    started = time.perf_counter()
    setup = _Setup(scene, tolerance, area_tolerance or 0.0, threads or available_cores(),
                   method, max_steps, progress)  # fmt: skip
    require_memory(scene)
    symbol = _symbol(scene, compliance)
    first = None if start is None else checked_start(start, scene.surface.shape)
    solution: PressureSolution | None = None
    steps: list[LoadStep] = []
    totals = dict.fromkeys(("fft_pairs", "equivalent_fft_pairs"), 0.0)
    for mean_pressure in scene.load.path:
        warm = first
        if solution is not None:
            warm = _warm_start(scene, symbol, solution, mean_pressure / steps[-1].mean_pressure)
        solution = None
        solution = _solve_step(setup, symbol, mean_pressure, warm)
        steps.append(_load_step(scene, symbol, solution, mean_pressure))
        totals = {name: count + solution.counts[name] for name, count in totals.items()}
    assert solution is not None
    cost = totals | {
        "seconds": time.perf_counter() - started,
        "unknowns": float(scene.surface.heights.size),
        "peak_memory_bytes": float(peak_memory()),
    }
    return _result(setup, tuple(steps), solution, cost, compliance is not None)


@dataclass(frozen=True)
class _Setup:
    scene: Scene
    tolerance: float
    area_tolerance: float
    threads: int
    method: Method
    max_steps: int | None
    progress: Callable[[str], None] | None


def _require_options(
    tolerance: float,
    area_tolerance: float | None,
    threads: int | None,
    method: str,
    max_steps: int | None,
) -> None:
    checks = (
        (0 < tolerance < 1, f"tolerance is {tolerance!r}, but must lie between 0 and 1"),
        (
            area_tolerance is None or 0 < area_tolerance < 1,
            f"area_tolerance is {area_tolerance!r}, but must lie between 0 and 1",
        ),
        (threads is None or threads >= 1, f"threads is {threads!r}, but must be at least 1"),
        (max_steps is None or max_steps >= 1, f"max_steps is {max_steps!r}, but must be >= 1"),
        (method in METHODS, f"method is {method!r}, but must be one of {', '.join(METHODS)}"),
    )
    for good, message in checks:
        if not good:
            raise InvalidScene(message)


METHODS = ("newton", *BASELINES)
#: Of a baseline, unless the caller says otherwise; each step costs one or two pairs.
_BASELINE_STEPS = 5000


def _symbol(scene: Scene, compliance: NDArray[np.floating] | None) -> Symbol:
    if compliance is not None:
        return checked_symbol(compliance, scene.surface.shape)
    shape, periods = scene.surface.shape, scene.surface.periods
    if len(shape) == 1:
        shape, periods = (1, shape[0]), (1.0, periods[0])
    grid, lengths = (shape[0], shape[1]), (periods[0], periods[1])
    return Symbol.from_quarter(quarter_compliance(grid, lengths, scene.body, scene.material), grid)


def _warm_start(
    scene: Scene, symbol: Symbol, last: PressureSolution, ratio: float
) -> FloatArray | None:
    """p - c g of the last answer, in Pa: where its pressure vanishes, how far contact is."""
    if not 1 / _WARM_RATIO <= ratio <= _WARM_RATIO:
        return None
    gap = last.displacement + (last.offset - scene.surface.heights.reshape(symbol.shape))
    return np.asarray(last.pressure * ratio - GRADIENT_STEP / symbol.shortest() * gap)


def _solve_step(
    setup: _Setup, symbol: Symbol, mean_pressure: float, start: FloatArray | None
) -> PressureSolution:
    heights = setup.scene.surface.heights.reshape(symbol.shape)
    options = Options(
        setup.tolerance,
        setup.area_tolerance,
        setup.threads,
        setup.method,
        progress=setup.progress,
    )
    default = options.max_steps if setup.method == "newton" else _BASELINE_STEPS
    options = replace(options, max_steps=setup.max_steps or default)
    hardness = setup.scene.material.hardness
    first = None if start is None else start.reshape(symbol.shape)
    return solve_symbol(heights, symbol, mean_pressure, hardness, options, first)


def _load_step(
    scene: Scene, symbol: Symbol, solution: PressureSolution, mean_pressure: float
) -> LoadStep:
    shape = scene.surface.shape
    gap = solution.displacement + (solution.offset - scene.surface.heights.reshape(symbol.shape))
    raw, corrected, error = estimate_areas(
        solution.pressure.reshape(shape),
        gap.reshape(shape),
        scene.material.hardness,
        scene.surface.spacing,
        effective_modulus(scene.material),
    )
    compression = _mean_displacement(scene, mean_pressure)
    fluctuation = float(np.vdot(solution.pressure, solution.displacement)) / gap.size
    quantities = {
        "mean_gap": float(np.maximum(gap, 0).mean()),
        "mean_plastic_displacement": float(
            -gap.mean(where=solution.pressure >= scene.material.hardness)
            * float((solution.pressure >= scene.material.hardness).mean())
        )
        if np.any(solution.pressure >= scene.material.hardness)
        else 0.0,
        "mean_separation": float(gap.mean()),
        "elastic_energy": (fluctuation + compression * mean_pressure) / 2,
        "largest_pressure": float(solution.pressure.max()),
    }
    counts = {name: int(count) for name, count in solution.counts.items()}
    return LoadStep(
        mean_pressure,
        {"raw": raw, "corrected": corrected, "error": error},
        dict(solution.residuals),
        counts,
        quantities,
    )


def _mean_displacement(scene: Scene, mean_pressure: float) -> float:
    """Of a layer, uniformly compressed, in m; a half-space has none."""
    if scene.body.kind == "half_space":
        return 0.0
    return mean_pressure * scene.body.depth / oedometric_modulus(scene.material)


def _result(
    setup: _Setup,
    steps: tuple[LoadStep, ...],
    solution: PressureSolution,
    cost: dict[str, float],
    foreign: bool,
) -> ContactResult:
    scene = setup.scene
    shape, hardness = scene.surface.shape, scene.material.hardness
    pressure = solution.pressure.reshape(shape)
    displacement = solution.displacement.reshape(shape)
    gap = displacement + (solution.offset - scene.surface.heights)
    displacement += _mean_displacement(scene, steps[-1].mean_pressure)
    options: dict[str, Any] = {"method": setup.method, "tolerance": setup.tolerance}
    if setup.area_tolerance:
        options["area_tolerance"] = setup.area_tolerance
    if foreign:
        options["compliance"] = "given"
    return ContactResult(
        method="bem",
        steps=steps,
        provenance=Provenance(scene.digest, scene.surface.seed, options),
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
