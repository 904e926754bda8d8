"""Sweeps: a case at many points, one task a point and surface, kept in a folder.

The folder is `<output>/<case>/<size>`.  `sweep.json` lists the tasks with the keys of their
results, and `members/<method>-<point>-<surface>.json` holds each result from the moment that it is
solved, so a sweep that is stopped goes on where it was.  A point is named by its values: a sweep
that gains or loses points keeps the results of the others.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from epcontact.errors import InvalidCase, OutputError, nearest
from epcontact.files import read_bytes, whole_file, write_json
from epcontact.harness.answers.run import Run, run_tasks, tasks_of
from epcontact.harness.answers.store import Task, key_of, read_member
from epcontact.harness.case_files.axes import MOST_TASKS, Point, Scalar
from epcontact.harness.case_files.case import Case, CaseText, case_at, find_case, sweep_of
from epcontact.harness.methods.registry import METHODS, Method
from epcontact.harness.processes import made
from epcontact.harness.quantities.registry import QUANTITIES, scalar_quantities
from epcontact.results import ContactResult

_LIST, _FORMAT = "sweep.json", "epcontact-sweep-1"
#: Columns that another run of the same sweep does not repeat.
COSTS = ("cost.seconds", "cost.peak_memory_bytes")


@dataclass(frozen=True)
class Sweep:
    """The tasks of a sweep, each with its point.

    Attributes:
        case: the id of the case.
        size: its size.
        tasks: the tasks, in the order of the table.
        points: the point of each task.
        quantities: what is measured beside what the methods report.
    """

    case: str
    size: str
    tasks: tuple[Task, ...]
    points: tuple[Point, ...]
    quantities: tuple[str, ...]


@dataclass(frozen=True)
class Swept:
    """A sweep that was run to its end.

    Attributes:
        folder: the folder that holds it.
        table: see `table`.
        failures: the sentence of each task that has no result, by its name in files.
        reused: the number of tasks whose kept result was used again.
        quantities: what was measured beside what the methods report.
    """

    folder: Path
    table: pd.DataFrame
    failures: Mapping[str, str]
    reused: int
    quantities: tuple[str, ...]


def read_sweep(case: CaseText | Path | str, size: str = "fast") -> Sweep:
    """Return the tasks of the table [sweep] of a case; every point is checked.

    Args:
        case: a case from `find_case`, or a name or path for it.
        size: "fast", "full" or "large", if the case has it.

    Raises:
        InvalidCase: if there is no such table, or a point of it is no valid case.
    """
    text = case if isinstance(case, CaseText) else find_case(case)
    swept = sweep_of(text, size)
    tasks: list[Task] = []
    points: list[Point] = []
    for point in swept.points():
        values: Mapping[str, Any] = point
        if swept.seeds is not None:
            values = {**point, "surface.seeds": swept.seeds}
        found = [*_tasks_at(point, case_at(text, values, size), swept.quantities)]
        tasks += found
        points += [point] * len(found)
        if len(tasks) > MOST_TASKS:
            raise InvalidCase(
                f"{text.where}: [sweep] {swept.size} points with their surfaces and methods are "
                f"more than {MOST_TASKS} tasks"
            )
    return Sweep(text.id, size, tuple(tasks), tuple(points), tuple(swept.quantities))


def _tasks_at(point: Point, case: Case, quantities: Sequence[str]) -> Iterator[Task]:
    if case.skip:
        raise InvalidCase(f"{case.path}: {case.skip}")
    for name in quantities:
        if name not in QUANTITIES:
            known = nearest(name, QUANTITIES)
            raise InvalidCase(f"{case.path}: [sweep] no quantity is called {name!r}{known}")
        if not any(_answers(METHODS[method], name) for method in case.methods):
            raise InvalidCase(
                f"{case.path}: [sweep] quantities has {name!r}, which no method of the case answers"
            )
    name = hashlib.sha256(json.dumps(point, sort_keys=True).encode()).hexdigest()[:10]
    values = ", ".join(f"{key.partition('.')[2]} {in_words(value)}" for key, value in point.items())
    for task in tasks_of(case, Run()):
        yield replace(
            task,
            label=f"{name}-{task.label}",
            words=f"{values}, {task.label}".removesuffix(", single"),
            quantities=tuple(q for q in quantities if _answers(task.method, q)),
        )


def in_words(value: Scalar) -> str:
    """Return a value of a point for a reader: numbers in six digits."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def _answers(method: Method, name: str) -> bool:
    """Return whether a method has what a quantity needs."""
    needs = QUANTITIES[name].needs
    return (method.has_fields or "fields" not in needs) and (
        method.has_model_measures or "J2 flow" not in needs
    )


def run_sweep(
    case: CaseText | Path | str, run: Run | None = None, *, size: str = "fast", **options: Any
) -> Swept:
    """Solve the sweep of a case, but for what is kept of an earlier run; write `sweep.csv`.

    Args:
        case: a name, a path or a case from `find_case`.
        run: how it is solved, see `Run`; or its attributes as keywords: `output`, `jobs`,
            `executor`, `fresh` and `progress`.
        size: one of its sizes.

    Raises:
        InvalidCase: if the case has no sweep, or one that cannot be solved.
        OutputError: if a file cannot be written.
    """
    run = replace(run or Run(), **options)
    sweep = read_sweep(case, size)
    folder = sweep.tasks[0].case.folder(run.folder)
    executor = run.executor

    def listed() -> Executor:  # the list is not left behind where there is no such executor
        found = made(executor)
        _write_list(sweep, run.folder, folder)
        return found

    if not executor:
        _write_list(sweep, run.folder, folder)
    outcomes, reused = run_tasks(sweep.tasks, replace(run, executor=listed if executor else ""))
    if executor and len(reused) == len(sweep.tasks):  # then no executor was made
        _write_list(sweep, run.folder, folder)
    failures = {
        f"{task.method.name}-{task.label}": outcome
        for task, outcome in outcomes.items()
        if isinstance(outcome, str)
    }
    found = table(folder)
    with whole_file(folder / "sweep.csv") as temporary:
        found.to_csv(temporary, index=False)
    return Swept(folder, found, failures, len(reused), sweep.quantities)


def _write_list(sweep: Sweep, output: Path, folder: Path) -> None:
    rows = [
        {
            "point": point,
            "method": task.method.name,
            "seed": None if task.label.endswith("-single") else getattr(task.recipe, "seed", None),
            "file": str(task.result_path(output).relative_to(folder)),
            "key": key_of(task),
        }
        for task, point in zip(sweep.tasks, sweep.points, strict=True)
    ]
    data = {"schema": _FORMAT, "case": sweep.case, "size": sweep.size, "tasks": rows}
    write_json(folder / _LIST, data)


def table(folder: str | Path) -> pd.DataFrame:
    """Read a sweep from its folder, finished or not.

    Args:
        folder: `<output>/<case>/<size>`.

    Returns:
        One row for each task of the sweep, with a column for each swept key ("material.hardness"),
        `method`, `seed` (where the surfaces have seeds), `solved`, and one for each quantity of a
        result by its name in gates ("area.total.corrected"), in SI units; nan where there is none.

    Raises:
        OutputError: if there is no sweep in the folder.
    """
    path = Path(folder) / _LIST
    try:
        data = json.loads(read_bytes(path))
        if data["schema"] != _FORMAT:
            raise ValueError(data["schema"])
        rows = [_row(Path(folder), task) for task in data["tasks"]]
    except (ValueError, KeyError, TypeError):
        raise OutputError(f"{path} is no list of a sweep; run `epcontact sweep` again") from None
    found = pd.DataFrame(rows)
    return found.dropna(axis="columns", how="all")


def _row(folder: Path, task: Mapping[str, Any]) -> dict[str, Any]:
    member = read_member(folder / task["file"])
    solved = member.get("key") == task["key"]
    row = {**task["point"], "method": task["method"], "seed": task["seed"], "solved": solved}
    return row | (scalar_quantities(ContactResult.from_json(member)) if solved else {})


def digest(found: pd.DataFrame) -> str:
    """Return the SHA-256 of a table without its `COSTS`.

    Example:
        >>> one = pd.DataFrame({"area.total.raw": [0.1], "cost.seconds": [2.0]})
        >>> digest(one) == digest(one.assign(**{"cost.seconds": 3.0}))
        True
    """
    kept = found.drop(columns=list(COSTS), errors="ignore")
    return hashlib.sha256(kept.to_csv(index=False).encode()).hexdigest()
