"""Solve a scene by boundary elements: check the input and the memory, build the result.

The modules below do not import the scene: they take a `GridProblem` for each load, and
`Options`.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.alternatives import (
    TOLERANCE_OF_ERROR,
    filled_notes,
    on_coarser_grid,
    with_measurement_errors,
    without_alternatives,
)
from epcontact.bem.areas.distribution import pressure_distribution
from epcontact.bem.areas.rim_correction import estimate_areas
from epcontact.bem.flow import LoadedSurface, solve_load
from epcontact.bem.kernel import quarter_compliance, surface_compliance
from epcontact.bem.level import GRADIENT_STEP, states
from epcontact.bem.memory import require_memory
from epcontact.bem.problem import (
    GridProblem,
    Method,
    Options,
    checked_field,
    start_pressure,
    symbol_from_compliance,
)
from epcontact.bem.resolution import (
    every_second_point,
    unresolved_weight,
    with_resolution_error,
)
from epcontact.bem.transforms import KEPT_POINTS, Symbol
from epcontact.machine import available_cores, compile_seconds, forget_peak, peak_memory
from epcontact.materials.moduli import effective_modulus, oedometric_modulus
from epcontact.notebook import notebook_bar
from epcontact.results import Areas, ContactResult, FloatArray, LoadStep, Provenance
from epcontact.scene import Scene, require_kind

#: Bins of the pressure distribution in a result.
_DISTRIBUTION_BINS = 1024
# Along a load path the last solution is the better start up to this ratio of loads.
# Beyond it, coarse grids give the better one.
_WARM_RATIO = 1.03
#: The grid's error of the mean gap is this number times the rms slope, the spacing and
#: the fraction of the area by which its correction and its error estimate may move it
#: (nine of ten errors of `laboratory.area_bank --gaps` are smaller).
_GAP_ERROR = 0.28
# Progress at which a grid begins, as a fraction of the progress at its end.  The
# coarser grid has ended there, because it has a quarter of the points.
_COARSER_WORK = 0.25


def solve(  # noqa: PLR0913 - options by keyword only, each with its default
    scene: Scene,
    *,
    tolerance: float = 1e-8,
    area_tolerance: float | None = None,
    threads: int | None = None,
    compliance: NDArray[np.floating] | None = None,
    method: Method | None = None,
    start: NDArray[np.floating] | None = None,
    plastic_displacement: NDArray[np.floating] | None = None,
    max_steps: int | None = None,
    progress: Callable[[float, str], None] | None = None,
    on_step: Callable[[ContactResult], None] | None = None,
) -> ContactResult:
    """Solve the capped contact problem of a scene at each mean pressure of its load
    path.

    The path may go down and up again.  Each load meets the surface that the loads
    before it have left behind.  Plastic flow has lowered this surface where the
    pressure reached the hardness (`bem.flow`).

    Args:
        scene: surface, material, body and load.
        tolerance: on the Karush-Kuhn-Tucker residuals, dimensionless.
        area_tolerance: stop as soon as the areas are settled to this relative change
            (the residuals reached are in the result); None: stop only when the
            residuals meet `tolerance`.
        threads: number of threads; None: all cores of the process.
        compliance: surface compliance in m/Pa for each mode of
            `numpy.fft.rfftn(heights)`, instead of the body's own.
        method: solves in the place of Newton's method, see `problem.Method` and
            `epcontact.studies.baselines`; None: Newton's method.
        start: pressure field in Pa to start the first load from, instead of coarser
            grids.
        plastic_displacement: how far earlier flow has lowered the surface, in m, with
            the shape of the heights.  The field of this name of an earlier result
            continues the load path of that result.
        max_steps: most steps of the method; None: its own limit.
        progress: called now and then with the fraction of the path that is done, from
            0 to 1, and a sentence.  Without it a notebook shows a bar.
        on_step: called at each load with the result so far, whose fields are those of
            that load; it must not change them.

    A measured surface is also solved with each of its `alternatives`, which gives the
    errors "form" and "missing" of each value (`epcontact.alternatives`).  These solves
    have fewer points if there are many, unless `compliance` or `plastic_displacement`
    is given.  Heights whose shortest waves the grid does not resolve are solved first
    at every second point, which is a part of the error by the grid (`bem.resolution`);
    not so if `compliance` is given.

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
    if threads is None:
        threads = available_cores()
    options = Options(tolerance, area_tolerance, threads, method, max_steps)
    started = time.perf_counter() - compile_seconds()
    forget_peak()
    require_memory(scene.surface, scene.load, scene.material)
    shape = scene.surface.shape
    if compliance is None:
        symbol = scene_symbol(scene)
    else:
        symbol = symbol_from_compliance(compliance, shape)
    if start is not None:
        start = start_pressure(start, shape).reshape(symbol.shape)
    flow = None
    if plastic_displacement is not None:
        expected = "finite lengths of at least 0 m"
        flow = checked_field(
            "plastic_displacement", plastic_displacement, shape, expected, 0.0
        )
        flow = flow.reshape(symbol.shape)
    given_compliance = compliance is not None
    weight = 0.0 if given_compliance else unresolved_weight(scene.surface)
    coarse: Sequence[LoadStep] = ()
    if weight > 0:
        coarse = _steps_at_every_second_point(scene, plastic_displacement, threads)
    with notebook_bar(progress) as report:
        path = _Path(
            scene,
            symbol,
            options,
            given_compliance,
            report,
            on_step,
            started,
            weight,
            coarse,
        )
        result = path.solve(start, flow)
    if not scene.surface.alternatives:
        return result

    def solve_alternative(changed: Scene) -> Sequence[LoadStep]:
        """Solve the path on a surface with other heights, for an error estimate."""
        return solve(
            changed,
            tolerance=tolerance,
            area_tolerance=TOLERANCE_OF_ERROR,
            threads=threads,
            compliance=compliance,
            method=method,
            plastic_displacement=plastic_displacement,
            max_steps=max_steps,
        ).steps

    base = None
    if not given_compliance and plastic_displacement is None:
        compared = on_coarser_grid(scene)
        if compared is not scene:
            base = solve_alternative(without_alternatives(compared))
            scene = compared
    steps = with_measurement_errors(scene, result.steps, solve_alternative, base)
    return replace(
        result,
        steps=steps,
        cost={**result.cost, "seconds": path.seconds},
        notes=(*result.notes, *filled_notes(steps)),
    )


def _steps_at_every_second_point(
    scene: Scene, flow: NDArray[np.floating] | None, threads: int
) -> Sequence[LoadStep]:
    """Return the load steps of a scene with every second point of its surface.

    scene: with its complete load path; flow: plastic displacement in m before the first
    load, of the shape of the heights; None: there was none; threads: number of threads.
    """
    surface, points = every_second_point(scene.surface)
    if flow is not None:
        flow = np.asarray(flow)[points]
    return solve(
        replace(scene, surface=surface),
        area_tolerance=TOLERANCE_OF_ERROR,
        threads=threads,
        plastic_displacement=flow,
    ).steps


def scene_symbol(scene: Scene) -> Symbol:
    """Return the compliance (m/Pa) of a scene's body for each mode of its grid.

    The grid of a line of n points is (1, n).  Up to KEPT_POINTS points, scenes of equal
    compliance share one symbol and with it what solves have cached there.
    """
    surface = scene.surface
    nx, ny = (1, *surface.shape)[-2:]
    period_x, period_y = (1.0, *surface.periods)[-2:]
    quarter = quarter_compliance(
        (nx, ny), (period_x, period_y), scene.body, scene.material
    )
    symbol = Symbol.from_quarter(quarter, (nx, ny))
    if surface.heights.size > KEPT_POINTS:
        return symbol
    rows = symbol.rows.astype(np.int32)
    return _shared_symbol(symbol.values.tobytes(), rows.tobytes(), (nx, ny))


@functools.lru_cache(maxsize=4)
def _shared_symbol(values: bytes, rows: bytes, shape: tuple[int, int]) -> Symbol:
    """Return one and the same symbol for equal arguments.

    Scenes of equal compliance then share what is cached in the symbol.

    values: bytes of the float64 array `Symbol.values`, in m/Pa; rows: bytes of the
    int32 array `Symbol.rows`; shape: (nx, ny) points of the grid.
    """
    numbers = np.frombuffer(values).reshape(-1, shape[1] // 2 + 1).copy()
    return Symbol(numbers, np.frombuffer(rows, dtype=np.int32).copy(), shape)


@dataclass(frozen=True, eq=False)
class _Path:
    """The load path of a scene with the options of its solution; see `solve`.

    Attributes:
        scene: surface, material, body and load.
        symbol: compliance of each mode, in m/Pa.
        options: how each load is solved.
        given_compliance: whether the user gave the compliance.
        progress: the argument of `solve`.
        on_step: the argument of `solve`.
        started: time in seconds at which the solve began, by a clock that stands still
            while kernels are compiled.
        weight: fraction by which differences from `coarse` count as an error.
        coarse: the load steps at every second point; empty: they were not needed.
    """

    scene: Scene
    symbol: Symbol
    options: Options
    given_compliance: bool
    progress: Callable[[float, str], None] | None
    on_step: Callable[[ContactResult], None] | None
    started: float
    weight: float
    coarse: Sequence[LoadStep]

    @property
    def seconds(self) -> float:
        """The time since the solve began, without that of compiling kernels, in s."""
        return time.perf_counter() - compile_seconds() - self.started

    def solve(self, start: FloatArray | None, flow: FloatArray | None) -> ContactResult:
        """Solve each load on the surface that the loads before it have left.

        start: (nx, ny) pressure in Pa to start from; flow: (nx, ny) plastic
        displacement in m before the first load.  Returns the result of all loads.
        """
        path = self.scene.load.path
        original = self.scene.surface.heights.reshape(self.symbol.shape)
        heights = original
        if flow is not None:
            heights = original - flow
        steps: list[LoadStep] = []
        peak = 0.0  # the load of this path that has left `flow`; 0: it was given
        pairs = {"fft_pairs": 0.0, "equivalent_fft_pairs": 0.0}
        while True:
            load = path[len(steps)]
            hardness = self.scene.material.hardness
            problem = GridProblem(heights, self.symbol, load, hardness)
            options = replace(self.options, progress=self._progress_of(len(steps)))
            surface = solve_load(problem, options, start, flow, peak)
            step = _load_step(self.scene, surface, self.options.threads)
            if self.coarse:
                coarse = self.coarse[len(steps)]
                step = with_resolution_error(step, coarse, self.weight, hardness)
            steps.append(step)
            for name in pairs:
                pairs[name] += surface.solution.counts[name]
            if self.on_step is not None:
                self.on_step(self.result(tuple(steps), surface, pairs))
            if len(steps) == len(path):
                return self.result(tuple(steps), surface, pairs)
            following = path[len(steps)]
            if following < load and surface.flow_after is not None:
                flow = surface.flow_after
                peak = max(peak, load)
                heights = original - flow
            start = _warm_start(surface, heights, following)
            # Their fields would stay in memory beside those of the next load.
            del surface, problem

    def _progress_of(
        self, load: int
    ) -> Callable[[tuple[int, ...], float], None] | None:
        """Return a function (shape of grid, residual) that reports progress at a load.

        It is None if the user wants no progress.  load: index of the load in the path.

        A grid's part of the work is proportional to its points, so that all coarser
        grids have a quarter of its work.  Residuals fall by equal factors in equal
        times.
        """
        progress = self.progress
        if progress is None:
            return None
        path = self.scene.load.path
        tolerance = self.options.tolerance
        size = self.scene.surface.heights.size

        def report(grid: tuple[int, ...], residual: float) -> None:
            """Report the progress at a residual (dimensionless) on a grid."""
            converged = math.log(max(residual, tolerance)) / math.log(tolerance)
            converged = min(max(converged, 0.0), 1.0)
            own_work = _COARSER_WORK + (1 - _COARSER_WORK) * converged
            fraction = math.prod(grid) / size * own_work
            points = " x ".join(map(str, grid))
            progress(
                (load + fraction) / len(path),
                f"bem: mean pressure {path[load]:.3g} Pa, {points} points, "
                f"residual {residual:.1e}",
            )

        return report

    def result(
        self, steps: tuple[LoadStep, ...], last: LoadedSurface, pairs: dict[str, float]
    ) -> ContactResult:
        """Return the result after some load steps, with the fields of the last one.

        steps: of the loads that are solved; last: the surface under the last of these
        loads; pairs: numbers of pairs of transforms so far.
        """
        cost = {
            **pairs,
            "seconds": self.seconds,
            "unknowns": float(self.scene.surface.heights.size),
            "peak_memory_bytes": float(peak_memory()),
        }
        surface = self.scene.surface
        solution = last.solution
        hardness = self.scene.material.hardness
        pressure = solution.pressure.reshape(surface.shape)
        displacement = solution.displacement.reshape(surface.shape)
        compression = _compression(self.scene, steps[-1].mean_pressure)
        if compression:
            displacement = displacement + compression
        fields: dict[str, NDArray[Any]] = {
            "heights": surface.heights,
            "pressure": pressure,
            "gap": solution.gap(surface.heights),
            "displacement": displacement,
            "state": states(pressure, hardness),
        }
        if last.flow_after is not None:
            fields["plastic_displacement"] = last.flow_after.reshape(surface.shape)
        options: dict[str, Any] = {
            "method": self.options.method_name,
            "tolerance": self.options.tolerance,
        }
        if self.options.area_tolerance:
            options["area_tolerance"] = self.options.area_tolerance
        if self.given_compliance:
            options["compliance"] = "given"
        return ContactResult(
            method="bem",
            steps=steps,
            provenance=Provenance(self.scene.digest, surface.seed, options),
            distribution=pressure_distribution(pressure, hardness, _DISTRIBUTION_BINS),
            fields=fields,
            cost=cost,
            history=solution.history,
            notes=surface.notes + solution.notes,
        )


def _warm_start(
    last: LoadedSurface, heights: FloatArray, following: float
) -> FloatArray | None:
    """Return a pressure (nx, ny) in Pa from which the following load is solved.

    It is p - c g of the last solution, with the gap g and a stiffness c, scaled to the
    following load: negative where p is 0, by how far away contact is.  The result is
    None if the loads are far apart or the last load was 0.

    last: the surface under the last load; heights: (nx, ny) in m under the following
    load; following: this load in Pa.
    """
    problem = last.problem
    solution = last.solution
    if not problem.mean_pressure:
        return None
    ratio = following / problem.mean_pressure
    if not 1 / _WARM_RATIO <= ratio <= _WARM_RATIO:
        return None
    stiffness = GRADIENT_STEP / problem.symbol.shortest()
    return np.asarray(solution.pressure * ratio - stiffness * solution.gap(heights))


def _load_step(scene: Scene, surface: LoadedSurface, threads: int) -> LoadStep:
    """Return the load step (areas, quantities, residuals) of a solved load.

    scene: of the load path; surface: the solution, and the plastic flow before and
    after it; threads: number of threads.
    """
    load = surface.problem.mean_pressure
    solution = surface.solution
    # Unlike a product of a linear algebra library, this starts no threads.
    work = float(np.einsum("ij,ij->", solution.pressure, solution.displacement))
    work_per_area = work / solution.pressure.size + _compression(scene, load) * load
    areas, quantities = areas_and_quantities(
        scene,
        solution.pressure,
        surface.gap(),
        work_per_area / 2,
        surface.flow_before,
        surface.flow_after,
        threads,
    )
    filled = scene.surface.filled
    if filled is not None and load:
        on_filled = solution.pressure.reshape(filled.shape)[filled].sum()
        quantities["filled_load"] = float(on_filled / solution.pressure.sum())
    counts = {name: int(count) for name, count in solution.counts.items()}
    step = LoadStep(load, areas, dict(solution.residuals), counts, quantities)
    return step.with_errors(scene.surface.treatment_errors, "treatment")


def areas_and_quantities(
    scene: Scene,
    pressure: FloatArray,
    gap: FloatArray,
    elastic_energy: float,
    flow_before: FloatArray | None,
    flow_after: FloatArray | None,
    threads: int = 1,
) -> tuple[dict[str, Areas], dict[str, float]]:
    """Return the areas and the quantities of one load from its fields.

    Args:
        scene: surface, material and body.
        pressure: (nx, ny) or (nx,), in Pa.
        gap: in m, to the surface that earlier flow has left; it is overwritten.
        elastic_energy: by nominal area, in J/m^2.
        flow_before: plastic displacement before this load in m; None: there was none.
        flow_after: plastic displacement after it in m; None: the material cannot flow.
        threads: number of threads.

    Returns:
        The areas raw, corrected and error as fractions of the nominal area, and the
        quantities by their names in a result, in SI units.
    """
    surface = scene.surface
    hardness = scene.material.hardness
    open_gap = float(np.sum(gap, where=gap > 0)) / gap.size
    separation = float(gap.mean())
    flowed_before = None
    if flow_before is not None:
        separation -= float(flow_before.mean())
        flowed_before = flow_before.reshape(surface.shape)
    mean_flow = 0.0
    flowed_fraction = 0.0
    plastic_work = 0.0
    if flow_after is not None:
        mean_flow = float(flow_after.mean())
        flowed_fraction = np.count_nonzero(flow_after) / gap.size
        # Fronts of plastic flow are placed by the whole depth of the flow.
        np.negative(flow_after, out=gap, where=pressure >= hardness)
    if math.isfinite(hardness):
        plastic_work = hardness * mean_flow
    raw, corrected, error = estimate_areas(
        pressure.reshape(surface.shape),
        gap.reshape(surface.shape),
        hardness,
        surface.spacing,
        effective_modulus(scene.material),
        threads,
        flowed=flowed_before,
    )
    error = _error_on_layers(scene, raw, corrected, error)
    moved = 0.0
    if raw.total:
        moved = (abs(raw.total - corrected.total) + error.total) / raw.total
    quantities = {
        "mean_gap": open_gap,
        "mean_gap_error_by_grid": (
            _GAP_ERROR * moved * surface.rms_slope * max(surface.spacing)
        ),
        "mean_plastic_displacement": mean_flow,
        "flowed_share": flowed_fraction,
        "plastic_work": plastic_work,
        "mean_separation": separation,
        "elastic_energy": elastic_energy,
        "largest_pressure": float(pressure.max()),
    }
    return {"raw": raw, "corrected": corrected, "error": error}, quantities


def _error_on_layers(scene: Scene, raw: Areas, corrected: Areas, error: Areas) -> Areas:
    """Return the error of areas on any body, from that on a half-space.

    scene: its body, material and spacing; raw, corrected, error: areas as fractions of
    the nominal area, the last two for a half-space of the same material.

    On a layer this correction is uncertain: by twice the fraction by which the layer is
    stiffer than the half-space against waves of two spacings.
    """
    wavenumber = math.pi / max(scene.surface.spacing)
    modulus = effective_modulus(scene.material)
    compliance = surface_compliance(np.array([wavenumber]), scene.body, scene.material)
    stiffer = 1 - compliance[0] * modulus * wavenumber / 2
    return Areas(
        math.hypot(error.total, 2 * stiffer * (raw.total - corrected.total)),
        math.hypot(error.elastic, 2 * stiffer * (raw.elastic - corrected.elastic)),
        math.hypot(error.plastic, 2 * stiffer * (raw.plastic - corrected.plastic)),
    )


def _compression(scene: Scene, mean_pressure: float) -> float:
    """Return the uniform displacement (m) of a layer's surface; 0 for a half-space.

    scene: its body and material; mean_pressure: in Pa.
    """
    if scene.body.kind == "half_space":
        return 0.0
    return mean_pressure * scene.body.depth / oedometric_modulus(scene.material)
