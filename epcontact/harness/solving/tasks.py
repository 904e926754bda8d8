"""What is solved, and how: a `Task` is one solve, and `Run` holds what all solves
share.

A case has one task for each of its methods on each of its surfaces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

from epcontact.errors import InvalidCase
from epcontact.harness.case_files.case import Case
from epcontact.harness.methods.registry import METHODS, Method, bytes_of_task
from epcontact.harness.quantities.registry import QUANTITIES, error_name_of
from epcontact.machine import available_cores, available_memory
from epcontact.output.vtk import Precision
from epcontact.scene import integer
from epcontact.surfaces import Recipe

#: Called with the number of finished tasks (within a solve also the fraction of it
#: that is done), the number of all tasks and, at the end of a task, its name.  The name
#: ends with " (reused)" if a saved result was used, and with " (failed)" if there is
#: no result.
Progress = Callable[[float, int, str], None]

#: The values that two attributes of `Run` may have.
_CHOICES = {
    "fields": ("none", "first", "all", "steps"),
    "precision": get_args(Precision),
}


def _no_progress(done: float, total: int, name: str) -> None:
    """Do nothing: the default of `Run.progress`, see `Progress`."""


@dataclass(frozen=True)
class Run:
    """How cases are solved.

    Attributes:
        output: folder for the results.
        jobs: number of worker processes, which share the cores of this machine.  Fewer
            are started if their solves are estimated not to fit into memory together.
            None: one for each core, or a single one for size large, whose solves fill
            the memory.  With an executor, the number of solves that share the cores of
            one of its workers; None: 1.
        executor: a function without arguments that returns the
            `concurrent.futures.Executor` whose workers solve, or the name of such a
            function, `module:function`; empty: this machine solves.
        fresh: solve again what is already in the output folder.
        fields: which fields are written (.vti): of the "first" surface of each case, of
            "all" surfaces, "none"; "steps": those of the first surface at every load,
            with the bodies of the finite elements.
        precision: of the numbers in the .vti files: "single" keeps seven digits;
            "double".
        rows: measure the quantities of a table of loads for every case; False: only
            for cases that list their loads (`Case.lists_loads`).
        progress: see `Progress`.
    """

    output: str | Path = "results"
    jobs: int | None = None
    executor: str | Callable[[], Executor] = ""
    fresh: bool = False
    fields: str = "none"
    precision: Precision = "single"
    rows: bool = False
    progress: Progress = _no_progress

    def __post_init__(self) -> None:
        """Raise InvalidCase if `jobs` is no positive integer, or if `fields` or
        `precision` is none of the allowed words.
        """
        if self.jobs is not None:
            integer("jobs", self.jobs, 1)
        for name, choices in _CHOICES.items():
            value = getattr(self, name)
            if value not in choices:
                expected = ", ".join(choices)
                raise InvalidCase(f"{name} is {value!r}, but must be one of {expected}")

    @property
    def folder(self) -> Path:
        """The folder for the results."""
        return Path(self.output)

    def jobs_for(self, tasks: Sequence[Task]) -> int:
        """Return how many of the tasks are solved at the same time, at least 1.

        The number follows from `jobs` of this run.  On this machine it is at most the
        number of tasks whose estimated memory fits into the available memory.  With an
        executor it is the number of solves that share the cores of one worker.
        """
        if self.executor:
            return self.jobs or 1
        jobs = self.jobs
        if jobs is None:
            large = any(task.case.size == "large" for task in tasks)
            jobs = 1 if large else available_cores()
        jobs = min(jobs, len(tasks))
        if jobs <= 1:
            return 1
        largest = max(task.memory for task in tasks)
        return max(1, min(jobs, int(available_memory() // largest)))


@dataclass(frozen=True, eq=False)
class Task:
    """One solve: a method on one surface of a case.

    Attributes:
        case, method: what is solved, and by which method.
        surface_index: index of the surface in `case.recipes`.
        label: name of the surface in files, such as "seed3"; "single" without seeds.
        fields_file: file for the fields (.vti); None: they are not written.
        steps_folder: folder for the files of every load; None: they are not written.
        loads_file: file for the loads of the path that are done, see `saved`; None:
            they are not saved.
        extra_quantities: quantities that are measured beside those that gates read.
        description: what a reader calls the surface; empty: the label.
        precision: least precision of the numbers in the files of fields.
        lists_loads: whether the quantities of a table of loads are measured at every
            load.
    """

    case: Case
    method: Method
    surface_index: int
    label: str
    fields_file: Path | None = None
    steps_folder: Path | None = None
    loads_file: Path | None = None
    extra_quantities: tuple[str, ...] = ()
    description: str = ""
    precision: Precision = "single"
    lists_loads: bool = False

    @property
    def name(self) -> str:
        """The case, the method and the surface of this task in words, such as
        "two-spheres bem single", as the progress reports them.
        """
        surface = self.description or self.label
        return f"{self.case.id} {self.method.name} {surface}"

    @property
    def recipe(self) -> Recipe:
        """The recipe from which the surface of this task is made."""
        return self.case.recipes[self.surface_index]

    @property
    def peak_file(self) -> Path | None:
        """The .vti file for the fields at the largest load of the path.

        It is beside the file for the last load and has its name with "-peak".  None if
        no fields are written, if the last load is the largest one, or if the method has
        fields at the last load alone.
        """
        path = self.case.load.path
        ends_at_peak = path[-1] == max(path) or not self.method.load_files
        if self.fields_file is None or ends_at_peak:
            return None
        return peak_path(self.fields_file)

    @property
    def measured(self) -> tuple[str, ...]:
        """The sorted names of the quantities that the harness measures at the last load
        of this task.

        These are the quantities that gates read of its method, with their error
        estimates, and the `extra_quantities`.  Quantities that the method reports
        itself are left out.  A name "l2.FORM.FIELD" is the distance of a field from a
        closed form.  Fields of two methods are compared later, see `compared_fields`.
        """
        names = {name for name in self.extra_quantities if QUANTITIES[name].measure}
        for gate in self.case.gates:
            if self.method.name not in (gate.of, gate.against):
                continue
            if gate.norm == "l2" and gate.against not in self.case.methods:
                names.add(f"l2.{gate.against}.{gate.field}")
            elif gate.quantity in QUANTITIES and QUANTITIES[gate.quantity].measure:
                names.add(gate.quantity)
                names.add(error_name_of(gate.quantity))
        return tuple(sorted(names - {""}))

    @property
    def compared_fields(self) -> set[str]:
        """The names of the fields that gates compare with those of another method.

        The result of this task keeps these fields, such as "pressure", and its file has
        them.
        """
        return {
            gate.field
            for gate in self.case.gates
            if gate.norm == "l2"
            and gate.against in self.case.methods
            and self.method.name in (gate.of, gate.against)
        }

    @property
    def memory(self) -> float:
        """The estimated memory in bytes of a process that solves this task."""
        scene = (self.case.material, self.case.body, self.case.load)
        options = self.case.options[self.method.name]
        return bytes_of_task(self.method.memory, self.recipe, scene, options)

    def fields_path(self, output: Path) -> Path:
        """Return the path of the .vti file for the fields of this task, whether the
        file is written or not: `<method>[-<surface>].vti` in the folder of the case
        below the output folder.
        """
        name = self.method.name
        if self.label != "single":
            name += f"-{self.label}"
        return self.case.folder(output) / f"{name}.vti"

    def steps_path(self, output: Path) -> Path:
        """Return the path of the folder for the files of each load of this task, below
        the output folder, whether they are written or not.
        """
        fields = self.fields_path(output)
        return fields.with_name(f"{fields.stem}-steps")

    def loads_path(self, output: Path) -> Path:
        """Return the path of the file for the loads of this task that are done, below
        the output folder, whether it is written or not.
        """
        return self.result_path(output).with_suffix(".loads.npz")

    def result_path(self, output: Path) -> Path:
        """Return the path of the JSON file for the result of this task, below the
        output folder.
        """
        name = f"{self.method.name}-{self.label}.json"
        return self.case.folder(output) / "members" / name


def peak_path(fields: Path) -> Path:
    """Return the path of the fields at the largest load of a path.

    `fields` is the path of the file with the fields at the last load.
    """
    return fields.with_name(f"{fields.stem}-peak.vti")


def tasks_of(
    case: Case, run: Run, methods: Mapping[str, Method] = METHODS
) -> Iterator[Task]:
    """Yield the tasks of a case: each method that can run here on each surface.

    The theory of an analytic spectrum has one task, as all surfaces are drawn from this
    spectrum.

    Args:
        case: the case; a skipped one has no surfaces and no tasks.
        run: says which files are written and what is measured.
        methods: all methods by their names.
    """
    for name in case.methods:
        method = methods[name]
        if method.missing:
            continue
        recipes = case.recipes
        single = case.options[name].get("spectrum") == "analytic"
        if single:
            recipes = recipes[:1]
        for index, recipe in enumerate(recipes):
            seed = None if single else getattr(recipe, "seed", None)
            task = Task(
                case,
                method,
                surface_index=index,
                label="single" if seed is None else f"seed{seed}",
                precision=run.precision,
                lists_loads=(run.rows or case.lists_loads) and method.has_fields,
            )
            yield _with_files(task, run)


def _with_files(task: Task, run: Run) -> Task:
    """Return the task with the paths of the files that the run asks for.

    These are the file of its loads, if a run can go on from a load of its path, and the
    files of fields, if the method has any and the run asks for those of this surface.
    """
    if task.method.load_files == "fields" and len(task.case.load.path) > 1:
        task = replace(task, loads_file=task.loads_path(run.folder))
    of_first_alone = run.fields in ("first", "steps")
    if run.fields == "none" or not task.method.has_fields:
        return task
    if of_first_alone and task.surface_index > 0:
        return task
    task = replace(task, fields_file=task.fields_path(run.folder))
    if run.fields == "steps" and task.method.load_files:
        task = replace(task, steps_folder=task.steps_path(run.folder))
    return task
