"""Sweeps: one case solved for many values of its keys, with the results in a folder.

A point of a sweep is one choice of these values.  There is one task for each point,
method and surface.  The folder is `<output>/<case>/<size>`.  `sweep.json` lists the
tasks with the keys of their results, and `members/<method>-<point>-<surface>.json`
holds each result as soon as it is solved, so that an interrupted sweep resumes where it
stopped.  The file name of a point is a hash of its values: if points are added to a
sweep or removed, the results of the others stay valid.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from epcontact.errors import InvalidCase, OutputError, nearest
from epcontact.files import atomic_write, path_inside, read_bytes, write_json
from epcontact.harness.case_files.axes import MOST_TASKS, Point, Scalar
from epcontact.harness.case_files.case import (
    Case,
    CaseText,
    case_at,
    find_case,
    load_case,
)
from epcontact.harness.methods.registry import METHODS, Method
from epcontact.harness.quantities.registry import QUANTITIES, scalar_quantities
from epcontact.harness.solving.method_results import load_rows
from epcontact.harness.solving.run import FinishedTask, lock_cases, solve_tasks
from epcontact.harness.solving.saved import key_of, read_saved
from epcontact.harness.solving.tasks import Run, Task, tasks_of
from epcontact.results import ContactResult

_LIST, _FORMAT = "sweep.json", "epcontact-sweep-1"
#: Columns that another run of the same sweep does not repeat.
COSTS = ("cost.seconds", "cost.measuring_seconds", "cost.peak_memory_bytes")


class Sweep(NamedTuple):
    """The tasks of a sweep.

    Attributes:
        tasks: one for each point, method and surface.
        points: the point of each task, in the same order.
        quantities: the names of the quantities that the table [sweep] asks for; None:
            it asks for those of `epcontact run`.
    """

    tasks: list[Task]
    points: list[Point]
    quantities: list[str] | None


@dataclass(frozen=True)
class Swept:
    """A sweep that was run to its end.

    Attributes:
        folder: the folder with its files.
        table: see the function `table`.
        failures: for each task without a result, by the task's name in files, the
            sentence that says why.
        reused: the number of tasks whose saved result was used again.
        loads: for each point and method in words, the rows of `load_rows` and the
            number of surfaces as text.
        quantities: the names of the quantities that the table [sweep] asks for.
        notes: the notes of surfaces and solves, each with the number of tasks that
            have it.
        fields: the written files of fields, each with its point and method in words.
    """

    folder: Path
    table: pd.DataFrame
    failures: Mapping[str, str]
    reused: int
    loads: Mapping[str, tuple[list[dict[str, Any]], str]]
    quantities: Sequence[str]
    notes: Mapping[str, int]
    fields: Mapping[Path, str]


def read_sweep(
    case: CaseText | Path | str,
    size: str = "fast",
    run: Run | None = None,
    among: str = "",
) -> Sweep:
    """Return the tasks of the table [sweep] of a case.

    Args:
        case: a name, a path or a case from `find_case`.
        size: one of the sizes of the case.
        run: how the tasks are solved; None: as `Run()`.
        among: the fields that the run asks for are written only for tasks whose
            description contains this text, such as "hardness 3e+09".

    Raises:
        InvalidCase: if the case has no table [sweep], if the case at one of the points
            is wrong or cannot run here, or if the sweep has too many tasks.
    """
    text = case if isinstance(case, CaseText) else find_case(case)
    sweep_table = load_case(text, size).sweep
    if sweep_table is None:
        raise InvalidCase(
            f"{text.where}: has no table [sweep], such as load.mean_pressure = "
            "[1e8, 2e8]"
        )
    seeds: dict[str, Any] = {}
    if sweep_table.seeds is not None:
        seeds["surface.seeds"] = sweep_table.seeds
    sweep = Sweep([], [], sweep_table.quantities)
    for point in sweep_table.points():
        case_at_point = case_at(text, {**point, **seeds}, size)
        tasks = _tasks_at(point, case_at_point, sweep.quantities, run or Run(), among)
        for task in tasks:
            sweep.tasks.append(task)
            sweep.points.append(point)
        if len(sweep.tasks) > MOST_TASKS:
            raise InvalidCase(
                f"{text.where}: [sweep] {sweep_table.size} points with their surfaces "
                f"and methods are more than {MOST_TASKS} tasks"
            )
    return sweep


def _tasks_at(
    point: Point, case: Case, requested: Sequence[str] | None, run: Run, among: str
) -> Iterator[Task]:
    """Yield the tasks at one point of a sweep: each method on each surface.

    Args:
        point: the values of the swept keys.
        case: the case with these values.
        requested: the names of the quantities that the sweep asks for; None: those of a
            table of loads.
        run: how the tasks are solved.
        among: files of fields are written only for tasks whose description contains
            this text.

    Raises:
        InvalidCase: if the case cannot run here, or if none of its methods has one of
            the requested quantities.
    """
    if case.skip:
        raise InvalidCase(f"{case.path}: {case.skip}")
    case = case.with_available_methods()
    quantities = requested or ()
    for quantity in quantities:
        if not any(_has_quantity(METHODS[name], quantity) for name in case.methods):
            hint = "" if quantity in QUANTITIES else nearest(quantity, QUANTITIES)
            raise InvalidCase(
                f"{case.path}: [sweep] no method of the case answers {quantity!r}{hint}"
            )
    values = json.dumps(point, sort_keys=True).encode()
    file_name = hashlib.sha256(values).hexdigest()[:10]
    for task in tasks_of(case, replace(run, rows=requested is None)):
        description = f"{describe_point(point)}, {task.label}"
        at_point = replace(
            task,
            label=f"{file_name}-{task.label}",
            description=description.removesuffix(", single"),
            extra_quantities=tuple(
                name for name in quantities if _has_quantity(task.method, name)
            ),
            fields_file=None,
            steps_folder=None,
        )
        if among in at_point.description and task.fields_file:
            fields_file = at_point.fields_path(run.folder)
            at_point = replace(at_point, fields_file=fields_file)
        if among in at_point.description and task.steps_folder:
            steps_folder = at_point.steps_path(run.folder)
            at_point = replace(at_point, steps_folder=steps_folder)
        if task.loads_file:
            loads_file = at_point.loads_path(run.folder)
            at_point = replace(at_point, loads_file=loads_file)
        yield at_point


def describe_point(point: Point) -> str:
    """Return the values of a point as text: "hardness 3e+09, mean_pressure 2e+08" for
    the keys "material.hardness" and "load.mean_pressure".
    """
    values = []
    for key, value in point.items():
        name = key.partition(".")[2]
        values.append(f"{name} {in_words(value)}")
    return ", ".join(values)


def in_words(value: Scalar) -> str:
    """Return one value of a swept key as text; a float has six significant digits."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def _has_quantity(method: Method, name: str) -> bool:
    """Return whether a quantity of this name exists and the method has the fields, or
    the J2 flow, that the quantity needs.
    """
    if name not in QUANTITIES:
        return False
    needs = QUANTITIES[name].needs
    if "fields" in needs and not method.has_fields:
        return False
    return method.has_model_measures or "J2 flow" not in needs


def run_sweep(
    case: CaseText | Path | str,
    run: Run | None = None,
    *,
    size: str = "fast",
    among: str = "",
    **options: Any,
) -> Swept:
    """Solve the sweep of a case and write `sweep.csv`.

    Tasks whose results an earlier run has saved are not solved again.

    Args:
        case: a name, a path or a case from `find_case`.
        run: how it is solved, see `Run`.
        size: one of the sizes of the case.
        among: fields are written only for tasks whose description contains this text,
            such as "hardness 3e+09".
        options: attributes of `Run` that replace those of `run`, such as `jobs`.

    Raises:
        InvalidCase: if the case has no sweep, or one that cannot be solved.
        OutputError: if a file cannot be written.
    """
    run = replace(run or Run(), **options)
    sweep = read_sweep(case, size, run, among)
    folder = sweep.tasks[0].case.folder(run.folder)
    solving = solve_tasks(sweep.tasks, run)
    with (
        lock_cases([sweep.tasks[0].case], run.folder),
        contextlib.closing(solving),
    ):
        write_json(folder / _LIST, _list_of_tasks(sweep, size, run, folder))
        finished = {done.task: done for done in solving}
    swept = table(folder)
    with atomic_write(folder / "sweep.csv") as temporary:
        swept.to_csv(temporary, index=False)
    failures = {}
    notes: Counter[str] = Counter()
    for task, done in finished.items():
        if isinstance(done.outcome, ContactResult):
            notes.update(done.outcome.notes)
        else:
            failures[f"{task.method.name}-{task.label}"] = done.outcome
    fields = {
        task.fields_file: f"{task.description}, {task.method.name}"
        for task in sweep.tasks
        if task.fields_file is not None
    }
    return Swept(
        folder=folder,
        table=swept,
        failures=failures,
        reused=sum(done.reused for done in finished.values()),
        loads=_loads(sweep, finished),
        quantities=sweep.quantities or (),
        notes=notes,
        fields=fields,
    )


def _list_of_tasks(sweep: Sweep, size: str, run: Run, folder: Path) -> dict[str, Any]:
    """Return the content of sweep.json.

    Its rows `tasks` hold, for each task, its point, method and seed, the path of the
    file of its result, and the key by which `saved` finds that result.

    Args:
        sweep: the sweep, with one task at least.
        size: the size of its case.
        run: names the output folder.
        folder: the folder of the sweep, to which the paths are relative.
    """
    rows = []
    for task, point in zip(sweep.tasks, sweep.points, strict=True):
        seed = None
        if not task.label.endswith("-single"):
            seed = getattr(task.recipe, "seed", None)
        rows.append(
            {
                "point": point,
                "method": task.method.name,
                "seed": seed,
                "file": str(task.result_path(run.folder).relative_to(folder)),
                "key": key_of(task),
            }
        )
    case_id = sweep.tasks[0].case.id
    return {"schema": _FORMAT, "case": case_id, "size": size, "tasks": rows}


def _loads(
    sweep: Sweep, finished: Mapping[Task, FinishedTask]
) -> dict[str, tuple[list[dict[str, Any]], str]]:
    """Return a table of loads for each point and method of a sweep.

    Args:
        sweep: the sweep.
        finished: each of its tasks with its outcome; a task that failed is left out.

    Returns:
        By the point and method in words, the rows of `load_rows`, which are means over
        the surfaces, and the number of surfaces as text.
    """
    results: dict[str, list[ContactResult]] = {}
    for task, point in zip(sweep.tasks, sweep.points, strict=True):
        outcome = finished[task].outcome
        if isinstance(outcome, ContactResult):
            name = f"{describe_point(point)}, {task.method.name}"
            results.setdefault(name, []).append(outcome)
    extra = [name.removeprefix("quantity.") for name in sweep.quantities or ()]
    return {
        name: (load_rows(of_point, extra), str(len(of_point)))
        for name, of_point in results.items()
    }


def table(folder: str | Path) -> pd.DataFrame:
    """Read a sweep from its folder, finished or not.

    Args:
        folder: `<output>/<case>/<size>`.

    Returns:
        One row for each task of the sweep and each load of its path, with a column for
        each swept key ("material.hardness"), `method`, `seed` (where the surfaces have
        seeds), `solved`, `load` (its number), and one for each quantity of a result by
        its name in gates ("area.total.corrected"), in SI units; nan where there is
        none.

    Raises:
        OutputError: if there is no sweep in the folder.
    """
    rows = []
    for task, result in members(folder):
        row = dict(task["point"])
        row["method"] = task["method"]
        row["seed"] = task["seed"]
        row["solved"] = result is not None
        if result is None:
            rows.append(row | {"load": 0})
            continue
        for number, step in enumerate(result.steps):
            quantities = scalar_quantities(replace(result, steps=(step,)))
            rows.append(row | {"load": number} | quantities)
    return pd.DataFrame(rows).dropna(axis="columns", how="all")


def members(
    folder: str | Path,
) -> Iterator[tuple[dict[str, Any], ContactResult | None]]:
    """Yield each task of a sweep with its result.

    Args:
        folder: `<output>/<case>/<size>`.

    Yields:
        The row of the task in sweep.json, with the keys point, method, seed, file and
        key; and its result, or None if it is not solved yet or its file was changed.

    Raises:
        OutputError: if the folder has no sweep.json, or one of another format.
    """
    path = Path(folder) / _LIST
    try:
        data = json.loads(read_bytes(path))
        if data["schema"] != _FORMAT:
            raise ValueError(data["schema"])
        for task in data["tasks"]:
            member = read_saved(path_inside(folder, task["file"]))
            result = None
            if member.get("key") == task["key"]:
                result = ContactResult.from_json(member)
            yield task, result
    except (ValueError, KeyError, TypeError):
        raise OutputError(
            f"{path} is no list of a sweep; run `epcontact sweep` again"
        ) from None


def digest(results: pd.DataFrame) -> str:
    """Return the SHA-256 of a table of a sweep without the columns `COSTS`.

    Two runs of the same sweep have the same digest, though their times differ.

    Example:
        >>> one = pd.DataFrame({"area.total.raw": [0.1], "cost.seconds": [2.0]})
        >>> digest(one) == digest(one.assign(**{"cost.seconds": 3.0}))
        True
    """
    repeatable = results.drop(columns=list(COSTS), errors="ignore")
    return hashlib.sha256(repeatable.to_csv(index=False).encode()).hexdigest()
