"""The one place that measures quantities of a solve.

Methods report quantities; the harness measures others on the fields of a load, so that
no solver checks itself.  The fields of a load exist only while it is the last one that
was solved, so some quantities are measured at each load.

| what                                    | when         | if it is undefined     |
|-----------------------------------------|--------------|------------------------|
| `QUANTITIES_OF_EACH_LOAD`, if the task  | at each load | it is left out, such   |
| lists its loads (`columns_left_out`)    |              | as a layer's conductance |
| fractions on filled heights, if the     | at each load | they are left out      |
| surface has such heights                |              |                        |
| `quantity.measured_*` that gates read,  | at each load; gates read | the task fails |
| of a method that knows one load at once | the largest of all loads |            |
| what gates read                         | at the end   | the task fails         |
| what only a sweep asks for              | at the end   | NaN, and a note        |

A quantity that was measured at each load is not measured again at the end.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, get_args

from epcontact.errors import InvalidCase, NotConverged
from epcontact.harness.case_files.case import Case
from epcontact.harness.case_files.model import MeasuredColumn
from epcontact.harness.quantities.filled import FILLED
from epcontact.harness.quantities.registry import QUANTITIES, measure_on
from epcontact.harness.quantities.solved_scene import SolvedScene
from epcontact.harness.solving.tasks import Task
from epcontact.machine import Stopwatch
from epcontact.results import COLUMNS, ContactResult, LoadStep
from epcontact.scene import Scene

#: The quantities that the harness measures for a table of loads.
QUANTITIES_OF_EACH_LOAD = tuple(
    name
    for column in COLUMNS
    for name in (f"quantity.{column}", f"quantity.{column}.error")
    if name in QUANTITIES and QUANTITIES[name].measure
)
#: The largest number of grid points on which `MeasuredColumn` are measured without a
#: request.  Each of them takes more than a tenth of a solve: a stiffness a linear solve
#: on the contact, a percolation passes over a grid twice as fine.
_LARGEST_GRID = 2**20


#: The time that this process has spent on measuring.
MEASURING = Stopwatch()


@dataclass(frozen=True)
class Measurement:
    """A quantity of a task, by its name in gates, and what happens if it is
    undefined.
    """

    name: str
    if_undefined: Literal["leave out", "NaN and a note", "fail"]

    @property
    def key(self) -> str:
        """The name of this quantity in `LoadStep.quantities`: without "quantity."."""
        return self.name.removeprefix("quantity.")


def at_each_load(task: Task, scene: Scene) -> Iterator[Measurement]:
    """Yield what is measured at each load of a task on its scene.

    The fractions on filled heights are measured for a surface that has such heights,
    whatever the task lists, because a note depends on them.
    """
    if task.method.knows_one_load:
        for name in task.measured:
            if _is_check(name):
                yield Measurement(name, "fail")
    if task.lists_loads:
        # The grid of the task, and not that of a coarser scene for an error estimate.
        left_out = columns_left_out(task.case, math.prod(task.recipe.shape))
        for name in QUANTITIES_OF_EACH_LOAD:
            column = name.removeprefix("quantity.").removesuffix(".error")
            if name not in FILLED and column not in left_out:
                yield Measurement(name, "leave out")
    if task.method.has_fields and scene.surface.filled is not None:
        for name in FILLED:
            yield Measurement(name, "leave out")


def columns_left_out(case: Case, points: int) -> list[str]:
    """Return the columns of the table of loads that are not measured on a large grid.

    These take longer than a tenth of a solve there.  A column that the case asks for is
    not among them: by `columns`, or the conductance by the conductivities of the
    bodies.

    Args:
        case: the case.
        points: the number of points of its grid.
    """
    requested: set[str] = set(case.head.columns)
    if case.conductances:
        requested.add("conductance")
    if points <= _LARGEST_GRID:
        return []
    return [name for name in get_args(MeasuredColumn) if name not in requested]


def left_out_sentence(case: Case) -> str:
    """Return a sentence on the columns that are not measured on the grid of a case,
    with the key that measures them; "" if all are measured.
    """
    columns = columns_left_out(case, math.prod(case.recipes[0].shape))
    if not columns:
        return ""
    listed = ", ".join(columns)
    return (
        f"not measured on a grid of this size, because it takes long: {listed}; "
        f'columns = ["{columns[0]}"] in [case] measures it all the same'
    )


def at_the_end(task: Task) -> Iterator[Measurement]:
    """Yield what is measured at the last load of a task.

    What was measured at each load already is among it.  A quantity that a gate reads
    must be defined; one that only a sweep asks for may be NaN.
    """
    for name in task.measured:
        asked_by_sweep = name in task.extra_quantities
        yield Measurement(name, "NaN and a note" if asked_by_sweep else "fail")


def _is_check(name: str) -> bool:
    """Return whether a quantity, by its name in gates, compares the parts of a result
    with each other; these are the quantities "quantity.measured_...".
    """
    return ".measured_" in name


def measure_load(
    task: Task, scene: Scene, result: ContactResult, threads: int = 1
) -> LoadStep:
    """Return the last step of a result with what is measured at each load.

    Args:
        task: says what is measured.
        scene: the scene, with a load path that ends at this load.
        result: has the fields of this load.
        threads: the number of threads that a measurement may use.

    Raises:
        InvalidCase: if a check is undefined.
    """
    measurements = list(at_each_load(task, scene))
    solved = SolvedScene(scene, result, threads)
    quantities = dict(result.final.quantities)
    for measurement in measurements:
        try:
            with MEASURING:
                quantities[measurement.key] = measure_on(solved, measurement.name)
        except (InvalidCase, NotConverged):
            if measurement.if_undefined == "fail":
                raise
    step = replace(result.final, quantities=quantities)
    if any(measurement.if_undefined == "leave out" for measurement in measurements):
        step = step.with_errors(scene.surface.treatment_errors, "treatment")
    return step


def measure_end(
    task: Task, scene: Scene, result: ContactResult, threads: int = 1
) -> ContactResult:
    """Return a result whose last step has everything that gates and sweeps read.

    Args:
        task: says what is measured.
        scene: the scene of the task, with its complete load path.
        result: the result of the complete path, with the fields of the last load.
        threads: the number of threads that a measurement may use.

    Raises:
        InvalidCase: if a quantity that a gate reads is undefined.
    """
    solved = SolvedScene(scene, result, threads)
    quantities = dict(result.final.quantities)
    notes = list(result.notes)
    for measurement in at_the_end(task):
        key = measurement.key
        if key in quantities and _is_check(measurement.name):
            quantities[key] = _largest(result, key)
            continue
        if key in quantities and measurement.name in QUANTITIES_OF_EACH_LOAD:
            continue
        try:
            with MEASURING:
                quantities[key] = measure_on(solved, measurement.name)
        except InvalidCase as error:
            if measurement.if_undefined == "fail":
                raise
            quantities[key] = math.nan
            notes.append(f"no value: {error}")
    final = replace(result.final, quantities=quantities)
    return replace(result, steps=(*result.steps[:-1], final), notes=tuple(notes))


def _largest(result: ContactResult, key: str) -> float:
    """Return the largest value of a quantity over all load steps; NaN if any is NaN.

    `key` is the name of the quantity in `LoadStep.quantities`.  Raises KeyError if a
    load step does not have it.
    """
    values = [step.quantities[key] for step in result.steps]
    if any(math.isnan(value) for value in values):
        return math.nan
    return max(values)
