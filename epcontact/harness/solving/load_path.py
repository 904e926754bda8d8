"""Solve a load path, each load with its hardness.

An effective hardness depends on the load.  While the load grows, the problem with a
pressure cap has no memory: a load above all earlier ones is solved on the original
surface, with the hardness of this load.  A smaller load after it is solved on the
surface that the larger load has lowered, and with the hardness of that larger load.
"""

from __future__ import annotations

import itertools
import math
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from epcontact.alternatives import (
    TOLERANCE_OF_ERROR,
    filled_notes,
    on_coarser_grid,
    with_measurement_errors,
)
from epcontact.errors import InvalidCase, NotConverged
from epcontact.files import step_name, write_collection
from epcontact.harness.methods.load_by_load import total_cost
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.quantities.registry import QUANTITIES
from epcontact.harness.solving.measure import (
    QUANTITIES_OF_EACH_LOAD,
    at_each_load,
    measure_load,
)
from epcontact.harness.solving.saved import DoneLoads, load_done, save_loads
from epcontact.harness.solving.scene_description import describe_scene
from epcontact.harness.solving.tasks import Task
from epcontact.materials.hardness_map import MappedHardness
from epcontact.notebook import OnProgress
from epcontact.output.vtk import write_fields
from epcontact.results import Areas, ContactResult, FloatArray, LoadStep
from epcontact.scene import Load, Scene

#: The unit of each quantity in the field data of a .vti.
_UNITS = {quantity.name: quantity.unit for quantity in QUANTITIES.values()}

#: Mean pressure at which rough J2 bodies touch and flow, over the yield stress: 2.5 to
#: 2.8 in `materials.hardness_map`.  It is the hardness of the boundary elements whose
#: differences are the errors of a J2 body by the measurement of its surface.
_CAP = 2.7

#: Loads that take less time are saved together.
_SECONDS_BETWEEN_SAVES = 1.0


def solve_path(
    task: Task, scene: Scene, threads: int, on_progress: OnProgress | None = None
) -> ContactResult:
    """Solve the load path of a task; measure and write at each load what it asks for.

    Each load is saved when it is done, and the loads that an earlier run has saved are
    not solved again, except for the last one of the path, whose fields are needed.

    Args:
        task: the method, its options, and what is measured and written.
        scene: the scene of the task.
        threads: the number of threads that the method may use.
        on_progress: see `OnProgress`.

    Raises:
        InvalidCase, NotConverged, NotEnoughMemory, InvalidScene: from the method.
    """
    done = load_done(task)
    if task.steps_folder is not None and done is None:
        # A longer path may have been written there.
        shutil.rmtree(task.steps_folder, ignore_errors=True)
    flows = task.case.options[task.method.name].get("law") == "j2"
    mapped = () if flows else task.case.mapped
    hardnesses = [of_load.value for of_load in mapped]
    if not mapped:
        hardnesses = [scene.material.hardness] * len(scene.load.path)
    result = _solve_with_hardnesses(
        task, scene, hardnesses, threads, on_progress=on_progress, done=done
    )
    steps = list(result.steps)
    if scene.surface.alternatives:
        caps = hardnesses
        if flows or task.method.name == "calculix":
            caps = [_cap_of_flow(scene)] * len(scene.load.path)
        steps = _with_measurement_errors(task, scene, caps, threads, steps)
    if not flows:
        steps = list(map(_with_hardness, steps, hardnesses))
    if mapped:
        steps = _with_hardness_errors(task, scene, mapped, threads, steps)
    steps = [_with_conductances(step, task.case.conductances) for step in steps]
    notes = (*result.notes, *filled_notes(steps))
    return replace(result, steps=tuple(steps), notes=notes)


def _without_files(task: Task) -> Task:
    """Return a task that writes no files: that of a solve for an error estimate."""
    return replace(task, steps_folder=None, fields_file=None, loads_file=None)


def _with_hardness(step: LoadStep, hardness: float) -> LoadStep:
    """Return the load step with the quantity "hardness" (Pa) at which it was solved.

    An infinite hardness is that of an elastic body; then the step is unchanged.
    """
    if math.isinf(hardness):
        return step
    return replace(step, quantities={**step.quantities, "hardness": hardness})


def _with_conductances(step: LoadStep, factors: dict[str, float]) -> LoadStep:
    """Return a load step with its thermal and electrical conductance and their errors.

    Args:
        step: its quantities "conductance..." are those times the sum of the
            resistivities of both bodies, in 1/m.
        factors: for "thermal" and "electrical", if known, the factor from 1/m to
            W/(m² K) or S/m².
    """
    quantities = dict(step.quantities)
    for kind, factor in factors.items():
        for name, value in step.quantities.items():
            if name.startswith("conductance"):
                quantities[f"{kind}_{name}"] = factor * value
    return replace(step, quantities=quantities)


# --- the errors that the measurement of the surface causes


def _cap_of_flow(scene: Scene) -> float:
    """Return the hardness (Pa) of boundary elements that stand for a J2 body.

    It is a little above the largest load if this is larger: no smaller hardness could
    carry it.  A body that does not flow has an infinite one.
    """
    return max(_CAP * scene.material.yield_stress, 1.001 * max(scene.load.path))


def _with_measurement_errors(
    task: Task,
    scene: Scene,
    hardnesses: Sequence[float],
    threads: int,
    steps: Sequence[LoadStep],
) -> list[LoadStep]:
    """Return the steps with the errors that the measurement of a surface causes.

    The path is solved with each alternative of the surface.  Boundary elements solve
    them for all methods but the theory, on a coarser grid if there are many points: the
    differences are those of the surfaces, and finite elements would take hours for
    each.

    Args:
        task: the method and its options.
        scene: the scene with its complete load path, and a surface with alternatives.
        hardnesses: the hardness of each load, in Pa; for a J2 body that of
            `_cap_of_flow`.
        threads: the number of threads that the method may use.
        steps: the solved load steps of the method.

    Raises:
        NotConverged: if a solve with an alternative does not converge.
    """
    solving = _without_files(task)

    def solve(changed: Scene) -> tuple[LoadStep, ...]:
        """Solve the path on a surface, accurately enough for an error estimate."""
        return _solve_with_hardnesses(
            solving, changed, hardnesses, threads, for_error=True
        ).steps

    base = None
    if task.method.name != "persson":
        solving = replace(solving, method=METHODS["bem"])
        compared = on_coarser_grid(scene)
        if compared is not scene or task.method.name != "bem":
            base = solve(compared)
        scene = compared
    return list(with_measurement_errors(scene, steps, solve, base))


# --- the error that the uncertainty of an effective hardness causes


def _with_hardness_errors(
    task: Task,
    scene: Scene,
    mapped: Sequence[MappedHardness],
    threads: int,
    steps: Sequence[LoadStep],
) -> list[LoadStep]:
    """Return the steps with the errors that the uncertain hardnesses cause.

    The path is solved with both ends of the 95 % interval of each hardness.  The lower
    end is at least a little above the largest load so far: no smaller hardness could
    carry it.

    Args:
        task: the method and its options.
        scene: the scene with its complete load path.
        mapped: the effective hardness of each load, with its interval (Pa).
        threads: the number of threads that the method may use.
        steps: the solved load steps.

    Raises:
        NotConverged: if a solve at an end of the intervals does not converge.
    """
    peaks = itertools.accumulate(scene.load.path, max)
    lowest = [
        max(of_load.interval[0], 1.001 * peak)
        for of_load, peak in zip(mapped, peaks, strict=True)
    ]
    highest = [of_load.interval[1] for of_load in mapped]
    without_files = _without_files(task)
    soft, hard = (
        _solve_with_hardnesses(without_files, scene, bound, threads, for_error=True)
        for bound in (lowest, highest)
    )
    return list(map(with_hardness_error, steps, soft.steps, hard.steps, mapped))


def with_hardness_error(
    step: LoadStep,
    at_lowest_hardness: LoadStep,
    at_highest_hardness: LoadStep,
    hardness: MappedHardness,
) -> LoadStep:
    """Return the load step with the error that the uncertain hardness causes.

    The same load was solved with both ends of the 95 % interval of the hardness.  The
    error of each area and quantity is half the difference of these two solutions.

    Args:
        step: the load step at the hardness itself.
        at_lowest_hardness: the same load with the lower end of the interval.
        at_highest_hardness: the same load with the upper end.
        hardness: the hardness (Pa) with its relative error.

    Returns:
        A copy of `step` with areas "hardness_error", a quantity "..._error_by_hardness"
        for each measured quantity, and "hardness_error_by_map" in Pa.
    """
    kind = "corrected" if "corrected" in step.areas else "raw"
    lowest = at_lowest_hardness.areas[kind]
    highest = at_highest_hardness.areas[kind]
    area_error = Areas(
        total=abs(lowest.total - highest.total) / 2,
        elastic=abs(lowest.elastic - highest.elastic) / 2,
        plastic=abs(lowest.plastic - highest.plastic) / 2,
    )
    quantities = dict(step.quantities)
    quantities["hardness_error_by_map"] = hardness.value * hardness.error
    low, high = at_lowest_hardness.quantities, at_highest_hardness.quantities
    measured = (name.removeprefix("quantity.") for name in QUANTITIES_OF_EACH_LOAD)
    for name in ("mean_gap", *measured):
        if name.endswith(".error"):
            continue
        if name in step.quantities and name in low and name in high:
            error = abs(low[name] - high[name]) / 2
            quantities[f"{name}_error_by_hardness"] = error
    areas = {**step.areas, "hardness_error": area_error}
    return replace(step, areas=areas, quantities=quantities)


# --- solves


def _solve_with_hardnesses(
    task: Task,
    scene: Scene,
    hardnesses: Sequence[float],
    threads: int,
    *,
    on_progress: OnProgress | None = None,
    done: DoneLoads | None = None,
    for_error: bool = False,
) -> ContactResult:
    """Solve a path on which each load has its hardness.

    Loads that follow each other with the same hardness are solved together.

    Args:
        task: the method, its options, and what is measured and written.
        scene: the scene with its complete load path.
        hardnesses: the hardness of each load, in Pa.
        threads: the number of threads that the method may use.
        on_progress: see `OnProgress`.
        done: the first loads of the path that an earlier run has solved.
        for_error: whether the result is used for an error estimate alone, so that a
            coarse solution is enough.

    Raises:
        InvalidCase: if the hardness changes along the path of the finite elements.
        NotConverged: if a solve does not converge.
    """
    path = scene.load.path
    steps: list[LoadStep] = []
    costs: list[Mapping[str, float]] = []
    saved_steps: tuple[LoadStep, ...] = ()
    flow = None
    if done is not None:
        saved_steps = done.result.steps
        costs.append(done.result.cost)
        flow = done.flow
    pairs = zip(hardnesses, path, strict=True)
    for hardness, group in itertools.groupby(pairs, key=lambda pair: pair[0]):
        loads = tuple(load for _, load in group)
        material = replace(scene.material, hardness=hardness)
        part_of_path = replace(scene, material=material, load=Load(loads))
        if part_of_path.load != scene.load and task.method.load_files == "bodies":
            raise InvalidCase(
                "hardness is 'effective' and differs from load to load, but fem "
                "follows a path with one; give one load, a hardness in Pa, or a sweep "
                "over load.mean_pressure"
            )
        saved = saved_steps[len(steps) : len(steps) + len(loads)]
        if len(saved) == len(loads):  # not of the last part: its last load is not saved
            steps += saved
            continue
        result = _solve_part(
            task,
            part_of_path,
            threads,
            _Before(tuple(steps), saved, tuple(costs), flow if saved else None),
            on_progress=_within(on_progress, len(steps), len(loads), len(path)),
            for_error=for_error,
        )
        steps += result.steps
        costs.append(result.cost)
    provenance = replace(result.provenance, scene=scene.digest)
    cost = total_cost(costs)
    return replace(result, steps=tuple(steps), provenance=provenance, cost=cost)


def _within(
    on_progress: OnProgress | None, done: int, count: int, total: int
) -> OnProgress | None:
    """Return the function that reports the progress of one part of a load path.

    Args:
        on_progress: is called with the solved fraction of the complete path; None: the
            return value is None, too.
        done: number of loads of the path before this part.
        count: number of loads in this part.
        total: number of loads of the complete path.
    """
    if on_progress is None:
        return None

    def report(fraction: float, sentence: str) -> None:
        """Report the solved fraction of the part as that of the complete path."""
        on_progress((done + fraction * count) / total, sentence)

    return report


@dataclass(frozen=True)
class _Before:
    """What was solved of a path before one of its parts, or of this part itself.

    Attributes:
        steps: the load steps before the part.
        saved: the first load steps of the part, which an earlier run has solved.
        costs: the costs of all these loads, by name, of each solve.
        flow: the plastic displacement in m after the saved steps; None: no need for it.
    """

    steps: tuple[LoadStep, ...]
    saved: tuple[LoadStep, ...]
    costs: tuple[Mapping[str, float], ...]
    flow: FloatArray | None


def _solve_part(
    task: Task,
    scene: Scene,
    threads: int,
    before: _Before,
    on_progress: OnProgress | None,
    for_error: bool,
) -> ContactResult:
    """Solve those loads of a path that have the same hardness.

    Args:
        task: the method, its options, and what is measured and written.
        scene: the scene with these loads alone, and their hardness.
        threads: the number of threads that the method may use.
        before: what was solved of the path before.
        on_progress: called with the solved fraction of these loads.
        for_error: see `_solve_with_hardnesses`.

    Raises:
        NotConverged: if the method does not converge.
    """
    method = task.method
    options = dict(task.case.options.get(method.name, {}))
    if for_error and method.name == "bem":
        options["area_tolerance"] = TOLERANCE_OF_ERROR
    if method.load_files == "bodies" and task.steps_folder is not None:
        options["output"] = task.steps_folder
    if (method.load_files or method.reports_progress) and on_progress is not None:
        options["progress"] = on_progress
    if method.source:
        options["limit"] = task.case.head.time_limit
    if before.flow is not None:
        options["plastic_displacement"] = before.flow
    observer = _LoadObserver(task, scene, threads, before)
    on_load = observer if observer.is_needed else None
    unsolved = scene.load.path[len(before.saved) :]
    result = method.solve(
        replace(scene, load=Load(unsolved)), options, threads, on_load
    )
    if not result.converged:
        raise NotConverged("the result says that it has not converged")
    return replace(result, steps=observer.add_to(result.steps))


@dataclass
class _LoadObserver:
    """Measures, writes and saves what a task asks for at each load of a solve.

    Attributes:
        task: says what is measured and written.
        scene: the scene that is solved, with the loads of this part of the path.
        threads: the number of threads that a measurement may use.
        before: what was solved of the path before.
        steps: the steps with what was measured, one for each call.
        saved_at: `time.monotonic` when the loads were last saved.
    """

    task: Task
    scene: Scene
    threads: int
    before: _Before
    steps: list[LoadStep] = field(default_factory=list)
    saved_at: float = field(default_factory=time.monotonic)

    @property
    def is_needed(self) -> bool:
        """Whether anything is measured or written at a load."""
        measured = any(at_each_load(self.task, self.scene))
        task = self.task
        files = (task.steps_folder, task.peak_file, task.loads_file)
        return measured or any(file is not None for file in files)

    def __call__(self, result: ContactResult) -> None:
        """Measure, write and save the last load of a result.

        Appends the load step with the measured quantities to `self.steps`.

        Args:
            result: the result of this solve so far, with the fields of its last load.

        Raises:
            InvalidCase: if a quantity that must be defined is not.
            OutputError: if a file cannot be written.
        """
        result = replace(result, steps=(*self.before.saved, *result.steps))
        loads = self.scene.load.path[: len(result.steps)]
        scene = replace(self.scene, load=Load(loads))
        step = measure_load(self.task, scene, result, self.threads)
        self.steps.append(step)
        result = replace(result, steps=(*self.before.steps, *result.steps[:-1], step))
        if self.task.steps_folder and self.task.method.load_files == "fields":
            self._write(scene, result, self.task.steps_folder)
        path = self.task.case.load.path
        if self.task.peak_file and len(result.steps) - 1 == path.index(max(path)):
            result = with_description(self.task, scene, result)
            write_result_fields(self.task, scene, result, self.task.peak_file)
        is_due = time.monotonic() - self.saved_at >= _SECONDS_BETWEEN_SAVES
        if is_due and len(result.steps) < len(path):
            self._save(result)

    def _save(self, result: ContactResult) -> None:
        """Save all loads of the path that are done.

        `result` is that of these loads, with the fields of the last one.
        """
        before = self.before
        save_loads(
            self.task,
            replace(
                result,
                steps=(*before.steps, *before.saved, *self.steps),
                cost=total_cost([*before.costs, result.cost]),
            ),
        )
        self.saved_at = time.monotonic()

    def _write(self, scene: Scene, result: ContactResult, folder: Path) -> None:
        """Write the fields of a load to a .vti file, and the list path.pvd of all
        files so far.

        Args:
            scene: the scene, with a load path that ends at this load.
            result: the result of all loads of the task so far, with the fields of the
                last one.
            folder: the folder of both files.

        Raises:
            OutputError: if a file cannot be written.
        """
        number = len(result.steps) - 1
        result = with_description(self.task, scene, result)
        write_result_fields(
            self.task, scene, result, folder / step_name(number, ".vti")
        )
        pressures = [step.mean_pressure for step in result.steps]
        write_collection(folder / "path.pvd", pressures)

    def add_to(self, steps: Sequence[LoadStep]) -> tuple[LoadStep, ...]:
        """Return the load steps of a method's result with what this observer measured.

        The steps that an earlier run has saved come first.  A quantity that the method
        itself reports is not replaced.  The observer may have seen only the last loads,
        because some methods have fields only there.
        """
        unobserved = len(steps) - len(self.steps)
        observed = [
            replace(step, quantities={**measured.quantities, **step.quantities})
            for step, measured in zip(steps[unobserved:], self.steps, strict=True)
        ]
        return (*self.before.saved, *steps[:unobserved], *observed)


# --- files


def with_description(task: Task, scene: Scene, result: ContactResult) -> ContactResult:
    """Return a copy of a result whose provenance describes the scene of the task that
    was solved: surface, material, body and load, see `describe_scene`.
    """
    about = describe_scene(scene, task.recipe, task.case.hardness_source)
    about.update(task.case.two_bodies)
    return replace(result, provenance=replace(result.provenance, about=about))


def write_result_fields(
    task: Task, scene: Scene, result: ContactResult, path: Path
) -> None:
    """Write the fields of a result to a .vti file, in the precision of its task.

    Args:
        task: names the case and the precision.
        scene: gives the grid.
        result: its fields are written, and the quantities of its last load with units.
        path: the file.

    Raises:
        OutputError: if the file cannot be written.
    """
    attributes: dict[str, Any] = {"case": task.case.id, "size": task.case.size}
    write_fields(
        path,
        result,
        scene.surface,
        attributes,
        precision=task.precision,
        units=_UNITS,
    )
