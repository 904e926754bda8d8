"""Solve a scene by boundary elements: check input and memory, and put the result
together.

The modules below do not know the scene: they take a `GridProblem` for each load, and
`Options`.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.bem.areas.distribution import pressure_distribution
from epcontact.bem.areas.rim_correction import estimate_areas
from epcontact.bem.flow import LoadedSurface, loaded
from epcontact.bem.kernel import quarter_compliance, surface_compliance
from epcontact.bem.level import GRADIENT_STEP, states
from epcontact.bem.memory import require_memory
from epcontact.bem.problem import (
    GridProblem,
    Method,
    Options,
    checked_field,
    checked_start,
    checked_symbol,
)
from epcontact.bem.transforms import KEPT_POINTS, Symbol
from epcontact.machine import available_cores, compile_seconds, forget_peak, peak_memory
from epcontact.materials.moduli import effective_modulus, oedometric_modulus
from epcontact.results import Areas, ContactResult, FloatArray, LoadStep, Provenance
from epcontact.scene import Scene, require_kind

_DISTRIBUTION_BINS = 1024
# Along a load path the last solution is the better start up to this ratio of loads;
# beyond it, coarse grids give the better one.
_WARM_RATIO = 1.03
#: The grid's error of the mean gap is this times rms slope times spacing times the
#: share of the area that its correction, with its claim, may move
#: (`laboratory.area_bank --gaps`).
_GAP_ERROR = 0.28


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
    """Solve the capped contact problem of a scene at each mean pressure of its load
    path.

    The path may go down and up again.  Each load meets the surface that the loads
    before it have left behind: where the pressure reached the hardness, flow has
    lowered it (`bem.flow`).

    Args:
        scene: surface, material, body and load.
        tolerance: on the Karush-Kuhn-Tucker residuals, dimensionless.
        area_tolerance: stop as soon as the areas are settled to this relative change
            (the residuals reached are in the result); None: stop only when the
            residuals meet `tolerance`.
        threads: number of threads; None: all cores of the process.
        compliance: surface compliance in m/Pa for each mode of
            `numpy.fft.rfftn(heights)`, instead of the body's own.
        method: "newton", or the name of a baseline.
        start: pressure field in Pa to start the first load from, instead of coarser
            grids.
        plastic_displacement: how far earlier flow has lowered the surface, in m, of the
            heights' shape: the field of this name of an earlier result, whose path this
            one continues.
        max_steps: most steps of the method; None: its own limit.
        progress: called now and then with the share of the path that is done and a
            sentence.
        on_step: called at each load with the result so far, whose fields are those of
            that load; it must not change them.

    Returns:
        The areas and other quantities at each load, and the fields at the last one.
        The fields gap and heights refer to the surface before any flow, so that the
        open gap is gap + plastic_displacement.

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
    require_kind("scene", scene, Scene)
    cores = available_cores() if threads is None else threads
    options = Options(tolerance, area_tolerance, cores, method, max_steps)
    started, compiled = time.perf_counter(), compile_seconds()
    forget_peak()
    require_memory(scene.surface, scene.load, scene.material)
    symbol, shape = _symbol(scene, compliance), scene.surface.shape
    if start is not None:
        start = checked_start(start, shape).reshape(symbol.shape)
    if (before := plastic_displacement) is not None:
        right = "finite lengths of at least 0 m"
        before = checked_field("plastic_displacement", before, shape, right, 0.0)
        before = before.reshape(symbol.shape)
    path = _Path(scene, symbol, options, compliance is not None, progress, on_step)
    steps, last, pairs = path.walk(start, before)
    seconds = time.perf_counter() - started - (compile_seconds() - compiled)
    size, peak = float(scene.surface.heights.size), float(peak_memory())
    cost = {**pairs, "seconds": seconds, "unknowns": size, "peak_memory_bytes": peak}
    return path.result(steps, last, cost)


def _symbol(scene: Scene, compliance: NDArray[np.floating] | None) -> Symbol:
    """The scene's compliance, or the one that is given; a line is a grid of one row."""
    if compliance is not None:
        return checked_symbol(compliance, scene.surface.shape)
    (nx, ny), (x, y) = (
        (1, *scene.surface.shape)[-2:],
        (1.0, *scene.surface.periods)[-2:],
    )
    quarter = quarter_compliance((nx, ny), (x, y), scene.body, scene.material)
    symbol = Symbol.from_quarter(quarter, (nx, ny))
    if scene.surface.heights.size > KEPT_POINTS:
        return symbol
    return _kept(
        symbol.values.tobytes(), symbol.rows.astype(np.int32).tobytes(), (nx, ny)
    )


@functools.lru_cache(maxsize=4)
def _kept(values: bytes, rows: bytes, grid: tuple[int, int]) -> Symbol:
    """The one symbol of these values; it keeps what solves of other surfaces need,
    too.
    """
    numbers = np.frombuffer(values).reshape(-1, grid[1] // 2 + 1).copy()
    return Symbol(numbers, np.frombuffer(rows, dtype=np.int32).copy(), grid)


@dataclass(frozen=True, eq=False)
class _Path:
    """The load path of a scene, and how it is solved; see `solve`."""

    scene: Scene
    symbol: Symbol
    options: Options
    given_compliance: bool
    progress: Callable[[float, str], None] | None
    on_step: Callable[[ContactResult], None] | None

    def walk(
        self, start: FloatArray | None, before: FloatArray | None
    ) -> tuple[tuple[LoadStep, ...], LoadedSurface, dict[str, float]]:
        """Solve at each load, on the surface that the loads before it have left.  Returns the load
        steps, the surface under the last load, and the transforms of all loads.  start, before:
        pressure in Pa to start from, and plastic displacement before the first load.
        """
        heights, path = (
            self.scene.surface.heights.reshape(self.symbol.shape),
            self.scene.load.path,
        )
        left = heights if before is None else heights - before
        steps: list[LoadStep] = []
        peak = 0.0  # that has left the flow `before`, if it is one of this path
        pairs = dict.fromkeys(("fft_pairs", "equivalent_fft_pairs"), 0.0)
        while True:
            load = path[len(steps)]
            problem = GridProblem(left, self.symbol, load, self.scene.material.hardness)
            shown = replace(self.options, progress=self.share_done(len(steps)))
            now = loaded(problem, shown, start, before, peak)
            steps.append(_load_step(self.scene, now, self.options.threads))
            pairs = {
                name: count + now.solution.counts[name] for name, count in pairs.items()
            }
            if self.on_step is not None:
                self.on_step(self.result(tuple(steps), now, dict(pairs)))
            if len(steps) == len(path):
                return tuple(steps), now, pairs
            if path[len(steps)] < load and now.after is not None:
                before, peak = now.after, max(peak, load)
                left = heights - before
            start = _warm_start(now, left, path[len(steps)])
            del (
                now,
                problem,
            )  # their fields would stay in memory beside those of the next load

    def share_done(self, load: int) -> Callable[[tuple[int, ...], float], None] | None:
        """The progress of the load of a number, as a function of grid and residual.  A
        grid has its share of the work by its points, so that all coarser ones have a
        quarter of its own, and residuals fall by equal factors in equal times.
        """
        if (progress := self.progress) is None:
            return None
        path, tolerance = self.scene.load.path, self.options.tolerance
        size = self.scene.surface.heights.size

        def report(grid: tuple[int, ...], residual: float) -> None:
            settled = math.log(max(residual, tolerance)) / math.log(tolerance)
            share = math.prod(grid) / size * (0.25 + 0.75 * min(max(settled, 0.0), 1.0))
            words = " x ".join(map(str, grid))
            sentence = (
                f"bem: mean pressure {path[load]:.3g} Pa, {words} points, residual "
            )
            progress((load + share) / len(path), f"{sentence}{residual:.1e}")

        return report

    def result(
        self, steps: tuple[LoadStep, ...], last: LoadedSurface, cost: dict[str, float]
    ) -> ContactResult:
        """The result after some steps, with the fields of the last one."""
        surface, solution, options = self.scene.surface, last.solution, self.options
        hardness = self.scene.material.hardness
        pressure = solution.pressure.reshape(surface.shape)
        displacement = solution.displacement.reshape(surface.shape)
        if compression := _compression(self.scene, steps[-1].mean_pressure):
            displacement = displacement + compression
        fields: dict[str, NDArray[Any]] = {
            "heights": surface.heights,
            "pressure": pressure,
            "gap": solution.gap(surface.heights),
            "displacement": displacement,
            "state": states(pressure, hardness),
        }
        if last.after is not None:
            fields["plastic_displacement"] = last.after.reshape(surface.shape)
        chosen: dict[str, Any] = {
            "method": options.method,
            "tolerance": options.tolerance,
        }
        if options.area_tolerance:
            chosen["area_tolerance"] = options.area_tolerance
        if self.given_compliance:
            chosen["compliance"] = "given"
        return ContactResult(
            method="bem",
            steps=steps,
            provenance=Provenance(self.scene.digest, surface.seed, chosen),
            distribution=pressure_distribution(pressure, hardness, _DISTRIBUTION_BINS),
            fields=fields,
            cost=cost,
            history=solution.history,
            notes=surface.notes + solution.notes,
        )


def _warm_start(
    last: LoadedSurface, left: FloatArray, following: float
) -> FloatArray | None:
    """p - c g of the last solution in Pa, scaled to the next load; None for a distant load.  Where
    p is 0, it still shows how far away contact is.  left: the heights that the load meets.
    """
    problem, solution = last.problem, last.solution
    ratio = following / problem.mean_pressure if problem.mean_pressure else math.inf
    if not 1 / _WARM_RATIO <= ratio <= _WARM_RATIO:
        return None
    stiffness = GRADIENT_STEP / problem.symbol.shortest()
    return np.asarray(solution.pressure * ratio - stiffness * solution.gap(left))


def _load_step(scene: Scene, now: LoadedSurface, threads: int) -> LoadStep:
    load, solution = now.problem.mean_pressure, now.solution
    # Unlike a product of a linear algebra library, this starts no threads.
    work = float(np.einsum("ij,ij->", solution.pressure, solution.displacement))
    energy = (work / solution.pressure.size + _compression(scene, load) * load) / 2
    found = figures(
        scene, solution.pressure, now.gap(), energy, now.before, now.after, threads
    )
    counts = {name: int(count) for name, count in solution.counts.items()}
    step = LoadStep(load, found[0], dict(solution.residuals), counts, found[1])
    return step.with_errors(scene.surface.treatment_errors, "treatment")


def figures(
    scene: Scene,
    pressure: FloatArray,
    gap: FloatArray,
    energy: float,
    before: FloatArray | None,
    after: FloatArray | None,
    threads: int = 1,
) -> tuple[dict[str, Areas], dict[str, float]]:
    """The areas and quantities of a load; gap, which is changed, and flow as of
    `LoadedSurface`.
    """
    shape, hardness = scene.surface.shape, scene.material.hardness
    open_gap = float(np.sum(gap, where=gap > 0)) / gap.size
    separation, flow, flowed = float(gap.mean()), 0.0, 0.0
    separation -= 0.0 if before is None else float(before.mean())
    if after is not None:
        flow, flowed = float(after.mean()), np.count_nonzero(after) / gap.size
        # Fronts of plastic flow are placed by the whole depth of the flow.
        np.negative(after, out=gap, where=pressure >= hardness)
    spacing, modulus = scene.surface.spacing, effective_modulus(scene.material)
    p, g = pressure.reshape(shape), gap.reshape(shape)
    old = None if before is None else before.reshape(shape)
    step_areas = estimate_areas(p, g, hardness, spacing, modulus, threads, flowed=old)
    step_areas = (*step_areas[:2], _error_on_layers(scene, *step_areas))
    raw, corrected, error = (areas.total for areas in step_areas)
    moved = (abs(raw - corrected) + error) / raw if raw else 0.0
    quantities = {
        "mean_gap": open_gap,
        "mean_gap_error_by_grid": (
            _GAP_ERROR * moved * scene.surface.rms_slope * max(scene.surface.spacing)
        ),
        "mean_plastic_displacement": flow,
        "flowed_share": flowed,
        "plastic_work": hardness * flow if math.isfinite(hardness) else 0.0,
        "mean_separation": separation,
        "elastic_energy": energy,
        "largest_pressure": float(pressure.max()),
    }
    return dict(zip(("raw", "corrected", "error"), step_areas, strict=True)), quantities


def _error_on_layers(scene: Scene, raw: Areas, corrected: Areas, error: Areas) -> Areas:
    """The error of areas whose correction is that of a half-space.  By what share a
    layer is stiffer against waves of two spacings, twice as much of the correction is
    in doubt.
    """
    shortest, modulus = (
        math.pi / max(scene.surface.spacing),
        effective_modulus(scene.material),
    )
    compliance = surface_compliance(np.array([shortest]), scene.body, scene.material)[0]
    stiffer = 1 - compliance * modulus * shortest / 2
    doubts = (
        2 * stiffer * (getattr(raw, part) - getattr(corrected, part))
        for part in vars(error)
    )
    return Areas(*map(math.hypot, vars(error).values(), doubts))


def _compression(scene: Scene, mean_pressure: float) -> float:
    """The uniform displacement of a layer's surface, in m; a half-space has none."""
    if scene.body.kind == "half_space":
        return 0.0
    return mean_pressure * scene.body.depth / oedometric_modulus(scene.material)
