"""Sweeps: a case at many points, one task a point and surface, kept in a folder.

The folder is `<output>/<case>/<size>`.  `sweep.json` lists the tasks with the keys of
their results, and `members/<method>-<point>-<surface>.json` holds each result from the
moment that it is solved, so a sweep that is stopped goes on where it was.  A point is
named by its values: a sweep that gains or loses points keeps the results of the others.
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
from epcontact.harness.solving.run import FinishedTask, solve_tasks
from epcontact.harness.solving.saved import key_of, read_saved
from epcontact.harness.solving.tasks import Run, Task, tasks_of
from epcontact.results import ContactResult

_LIST, _FORMAT = "sweep.json", "epcontact-sweep-1"
#: Columns that another run of the same sweep does not repeat.
COSTS = ("cost.seconds", "cost.peak_memory_bytes")


class Sweep(NamedTuple):
    """The tasks of a sweep, the point of each, and what is measured beside what methods
    report.
    """

    tasks: list[Task]
    points: list[Point]
    quantities: list[str] | None


@dataclass(frozen=True)
class Swept:
    """A sweep that was run to its end."""

    folder: Path
    table: pd.DataFrame
    failures: Mapping[
        str, str
    ]  # the sentence of each task without a result, by its name in files
    reused: int  # the number of tasks whose kept result was used again
    #: For each point and method in words its rows, see `load_rows`, and the number of
    #: surfaces.
    loads: Mapping[str, tuple[list[dict[str, Any]], str]]
    quantities: Sequence[str]  # measured beside what the methods report
    notes: Mapping[
        str, int
    ]  # of surfaces and solves, with the number of tasks that told them
    fields: Mapping[Path, str]  # the files of fields, and what they show in words


def read_sweep(
    case: CaseText | Path | str,
    size: str = "fast",
    run: Run | None = None,
    among: str = "",
) -> Sweep:
    """Return the tasks of the table [sweep] of a case; every point is checked.  Those
    whose words contain `among` keep the fields that the run asks for.
    """
    text = case if isinstance(case, CaseText) else find_case(case)
    swept = load_case(text, size).sweep
    if swept is None:
        told = "has no table [sweep], such as load.mean_pressure = [1e8, 2e8]"
        raise InvalidCase(f"{text.where}: {told}")
    sweep = Sweep([], [], swept.quantities)
    for point in swept.points():
        seeds = {} if swept.seeds is None else {"surface.seeds": swept.seeds}
        there = case_at(text, {**point, **seeds}, size)
        found = [*_tasks_at(point, there, swept.quantities, run or Run(), among)]
        sweep.tasks.extend(found)
        sweep.points.extend([point] * len(found))
        if len(sweep.tasks) > MOST_TASKS:
            told = f"[sweep] {swept.size} points with their surfaces and methods"
            raise InvalidCase(f"{text.where}: {told} are more than {MOST_TASKS} tasks")
    return sweep


def _tasks_at(
    point: Point, case: Case, asked: Sequence[str] | None, run: Run, among: str
) -> Iterator[Task]:
    if case.skip:
        raise InvalidCase(f"{case.path}: {case.skip}")
    quantities = asked or ()
    for quantity in quantities:
        if not any(_answers(METHODS[method], quantity) for method in case.methods):
            known = "" if quantity in QUANTITIES else nearest(quantity, QUANTITIES)
            told = f"[sweep] no method of the case answers {quantity!r}{known}"
            raise InvalidCase(f"{case.path}: {told}")
    name = hashlib.sha256(json.dumps(point, sort_keys=True).encode()).hexdigest()[:10]
    values = describe_point(point)
    for task in tasks_of(case, replace(run, rows=asked is None)):
        named = replace(
            task,
            label=f"{name}-{task.label}",
            description=f"{values}, {task.label}".removesuffix(", single"),
            extra_quantities=tuple(q for q in quantities if _answers(task.method, q)),
        )
        chosen = among in named.description
        fields = named.fields_path(run.folder) if chosen and task.fields_file else None
        steps = named.steps_path(run.folder) if chosen and task.steps_folder else None
        yield replace(named, fields_file=fields, steps_folder=steps)


def describe_point(point: Point) -> str:
    """Return a point for a reader, such as "hardness 3e+09, mean_pressure 2e+08"."""
    values = (f"{key.partition('.')[2]} {in_words(v)}" for key, v in point.items())
    return ", ".join(values)


def in_words(value: Scalar) -> str:
    """Return a value of a point for a reader: numbers in six digits."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def _answers(method: Method, name: str) -> bool:
    """Return whether there is such a quantity, and a method has what it needs."""
    has = {"fields": method.has_fields, "J2 flow": method.has_model_measures}
    return name in QUANTITIES and all(
        has.get(need, True) for need in QUANTITIES[name].needs
    )


def run_sweep(
    case: CaseText | Path | str,
    run: Run | None = None,
    *,
    size: str = "fast",
    among: str = "",
    **options: Any,
) -> Swept:
    """Solve the sweep of a case, but for what is kept of an earlier run; write
    `sweep.csv`.

    Args:
        case: a name, a path or a case from `find_case`.
        run: how it is solved, see `Run`, whose attributes are keywords, too.
        size: one of its sizes.
        among: fields are kept where a point in words contains this, such as "hardness
            3e+09".

    Raises:
        InvalidCase: if the case has no sweep, or one that cannot be solved.
        OutputError: if a file cannot be written.
    """
    run = replace(run or Run(), **options)
    sweep = read_sweep(case, size, run, among)
    folder = sweep.tasks[0].case.folder(run.folder)
    solving = solve_tasks(sweep.tasks, run)
    with contextlib.closing(solving):
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
    """Return the content of sweep.json: for each task its point, method, seed, the file
    of its result and the key of this result.
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
    """Return the rows of loads of each point and method, and the number of surfaces."""
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
        about = {
            "method": task["method"],
            "seed": task["seed"],
            "solved": result is not None,
        }
        for number, step in enumerate(result.steps if result else [None]):
            found = (
                scalar_quantities(replace(result, steps=(step,)))
                if result and step
                else {}
            )
            rows.append(task["point"] | about | {"load": number} | found)
    return pd.DataFrame(rows).dropna(axis="columns", how="all")


def members(
    folder: str | Path,
) -> Iterator[tuple[dict[str, Any], ContactResult | None]]:
    """Yield each task of a sweep's list with its result, or None.  Raises OutputError
    if there is no sweep in the folder.
    """
    path = Path(folder) / _LIST
    try:
        data = json.loads(read_bytes(path))
        if data["schema"] != _FORMAT:
            raise ValueError(data["schema"])
        for task in data["tasks"]:
            member = read_saved(path_inside(folder, task["file"]))
            solved = member.get("key") == task["key"]
            yield task, ContactResult.from_json(member) if solved else None
    except (ValueError, KeyError, TypeError):
        raise OutputError(
            f"{path} is no list of a sweep; run `epcontact sweep` again"
        ) from None


def digest(found: pd.DataFrame) -> str:
    """Return the SHA-256 of a table without its `COSTS`.

    Example:
        >>> one = pd.DataFrame({"area.total.raw": [0.1], "cost.seconds": [2.0]})
        >>> digest(one) == digest(one.assign(**{"cost.seconds": 3.0}))
        True
    """
    kept = found.drop(columns=list(COSTS), errors="ignore")
    return hashlib.sha256(kept.to_csv(index=False).encode()).hexdigest()
