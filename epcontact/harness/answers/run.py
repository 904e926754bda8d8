"""Cases become answers: one task per surface and method, spread over processes or a cluster.

Each result is written to disk at once (see `store`), so that an interrupted run resumes where it
stopped.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from numbers import Real
from pathlib import Path

from epcontact.errors import InvalidCase
from epcontact.harness.answers.solve import Outcome, Parcel, get_ready, solve_elsewhere, solve_task
from epcontact.harness.answers.store import Answer, Task, basis, keep, kept, summary
from epcontact.harness.case_files.case import Case
from epcontact.harness.methods.registry import METHODS, Method
from epcontact.harness.processes.pool import Factory, Processes, made, spread
from epcontact.machine import available_cores, available_memory
from epcontact.output.files import remove_leftovers, require_writable, write_json
from epcontact.output.vtk import Precision
from epcontact.results import ContactResult


@dataclass(frozen=True)
class Progress:
    """A report that one more task is done.

    Attributes:
        done: tasks done so far, this one included.
        total: number of tasks.
        task: the case, the method and the surface, in words.
        note: "reused", "failed" or empty.
        seconds_left: the time that the other tasks will take at the pace of those solved last;
            nan before the first one.
    """

    done: int
    total: int
    task: str
    note: str
    seconds_left: float = math.nan


@dataclass(frozen=True)
class Done:
    """Tasks that were done: the outcome of each, and those whose kept result was used again."""

    outcomes: Mapping[Task, Outcome]
    reused: frozenset[Task]


def run_cases(  # noqa: PLR0913 - the options of the commands
    cases: Sequence[Case],
    output: Path,
    *,
    jobs: int = 1,
    executor: Factory = "",
    fresh: bool = False,
    fields: str = "none",
    precision: Precision = "single",
    methods: Mapping[str, Method] = METHODS,
    progress: Callable[[Progress], None] | None = None,
    moving: Callable[[float, int], None] | None = None,
) -> dict[str, dict[str, Answer]]:
    """Answer each case by each of its methods.

    Args:
        cases: cases with different ids.
        output: folder for the results.
        jobs, executor, fresh: see `run_tasks`.
        fields: write the fields of each surface ("all"), of the first ("first"), of the first at
            every load of the path, with the body of the finite elements ("steps"), or none
            ("none").
        precision: of the numbers in the .vti files: "single", seven digits, or "double".
        methods: the registry of the cases' methods.
        progress, moving: see `run_tasks`.

    Returns:
        {case id: {method: Answer}}.  The error of a solve is kept in the Answer as its sentence.

    Raises:
        InvalidCase: if two cases have one id, so that they would share a folder, or there is no
            such executor.
        OutputError: if a result cannot be written.
    """
    _require_distinct(cases)
    tasks = [task for case in cases for task in tasks_of(case, methods, fields, output)]
    tasks = [replace(task, precision=precision) for task in tasks]
    done = run_tasks(
        tasks, output, jobs=jobs, executor=executor, fresh=fresh, progress=progress, moving=moving
    )
    answers: dict[str, dict[str, Answer]] = {case.id: {} for case in cases}
    for case in cases:
        for method in case.methods:
            mine = [t for t in tasks if t.case is case and t.method.name == method]
            answer = _collect(mine, done)
            answers[case.id][method] = answer
            if answer.results:
                write_json(case.folder(output) / f"{method}.json", summary(case, answer))
    return answers


def run_tasks(
    tasks: Sequence[Task],
    output: Path,
    *,
    jobs: int = 1,
    executor: Factory = "",
    fresh: bool = False,
    progress: Callable[[Progress], None] | None = None,
    moving: Callable[[float, int], None] | None = None,
) -> Done:
    """Solve tasks, but for those whose result is kept; keep each new result at once.

    Args:
        tasks: the tasks.
        output: folder for the results.
        jobs: number of worker processes, which share the cores; fewer are started where their
            solves are estimated not to fit into memory side by side.  With an executor, the number
            of tasks that share the cores of one of its workers.
        executor: a factory of a `concurrent.futures.Executor`, or its name `module:function`, whose
            workers solve the tasks; empty: processes of this machine.
        fresh: solve again what is already in the output folder.
        progress: called after every task.
        moving: called at the start, and within tasks that are solved one by one in this process,
            with the number of tasks done, the share of the present one included, and of all.

    Raises:
        InvalidCase: if there is no such executor.
        OutputError: if a result cannot be written; asked before the first solve, too.
    """
    outcomes: dict[Task, Outcome] = {}
    reused: set[Task] = set()
    moments: list[float] = []  # of the start, and of the end of each solve

    def finish(task: Task, outcome: Outcome, note: str) -> None:
        outcomes[task] = outcome
        if progress is not None:
            name = f"{task.case.id} {task.method.name} {task.words or task.label}"
            left = (len(tasks) - len(outcomes)) * _pace(moments)
            progress(Progress(len(outcomes), len(tasks), name, note, left))

    for task in tasks:
        earlier = None if fresh else kept(task, output)
        if earlier is not None:
            reused.add(task)
            finish(task, earlier, "reused")
    waiting = [task for task in tasks if task not in outcomes]
    folders = {task.case.folder(output) for task in waiting}
    for folder in folders:
        require_writable(folder)
    moments.append(time.monotonic())
    move: Callable[[float], None] | None = None
    if moving is not None:
        moving(len(outcomes), len(tasks))
        move = lambda share: moving(len(outcomes) + share, len(tasks))  # noqa: E731
    try:
        with contextlib.closing(_solved(waiting, jobs, executor, move)) as solved:
            for task, outcome in solved:
                if isinstance(outcome, ContactResult):
                    keep(task, output, outcome)
                moments.append(time.monotonic())
                finish(task, outcome, "failed" if isinstance(outcome, str) else "")
    finally:
        for folder in folders:
            remove_leftovers(folder)
    return Done(outcomes, frozenset(reused))


def _pace(moments: Sequence[float]) -> float:
    """Return the seconds from one solve's end to the next; nan before the first.

    The last half of them counts: the first ones may have compiled kernels.

    Example:
        >>> _pace([0.0, 60.0, 61.0, 62.0, 63.0])
        1.0
    """
    if len(moments) < 2:
        return math.nan
    first = (len(moments) - 2) // 2
    return (moments[-1] - moments[first]) / (len(moments) - 1 - first)


def _solved(
    tasks: Sequence[Task], jobs: int, executor: Factory, moving: Callable[[float], None] | None
) -> Generator[tuple[Task, Outcome]]:
    """Yield each task with its outcome, in any order."""
    if executor:
        yield from _solved_by(executor, tasks, jobs)
        return
    jobs = _fitting(tasks, min(jobs, len(tasks)))
    threads = max(1, available_cores() // max(1, jobs))
    if jobs <= 1:
        yield from ((task, solve_task(task, threads, moving)) for task in tasks)
    else:
        # Each method begins at once, so that on a new machine processes compile different kernels.
        first = {task.method.name: task for task in reversed(tasks)}
        tasks = [*first.values(), *(task for task in tasks if first[task.method.name] is not task)]
        processes = Processes(jobs, get_ready, sorted(first))
        yield from spread(partial(solve_task, threads=threads), tasks, processes)


def _solved_by(
    factory: Factory, tasks: Sequence[Task], share: int
) -> Iterator[tuple[Task, Outcome]]:
    """Have the workers of an executor solve the tasks that fit into the memory of one of them."""
    if not tasks:
        return
    executor = made(factory)
    room = getattr(executor, "worker_memory", math.inf)
    if not isinstance(room, Real):
        executor.shutdown(wait=False)
        raise InvalidCase(f"the executor's worker_memory is {room!r}, but must be in bytes")
    large = [task for task in tasks if room < math.inf and task.memory > room]
    orders = [(task, basis(task)) for task in tasks if task not in large]
    for (task, _), parcel in spread(partial(solve_elsewhere, share=share), orders, executor):
        if isinstance(parcel, Parcel):
            yield task, parcel.unpacked()
        else:
            other = f"the executor returned {parcel!r:.60}, not what the task returns"
            yield task, parcel if isinstance(parcel, str) else other
    for task in large:
        yield (
            task,
            (
                f"it needs about {task.memory / 2**30:.1f} GiB, but the largest worker has "
                f"{room / 2**30:.1f} GiB"
            ),
        )


def _fitting(tasks: Sequence[Task], jobs: int) -> int:
    """Return the number of tasks, at most `jobs`, that fit into memory side by side."""
    if jobs <= 1:
        return jobs
    largest = max(task.memory for task in tasks)
    return max(1, min(jobs, int(available_memory() // largest)))


def default_jobs(size: str) -> int:
    """Return the number of worker processes: one for each core, or a single one for size large.

    Large grids are solved one by one, each with all cores, because two would not fit into memory.
    """
    return 1 if size == "large" else available_cores()


def _require_distinct(cases: Sequence[Case]) -> None:
    by_id: dict[str, Case] = {}
    for case in cases:
        other = by_id.setdefault(case.id, case)
        if other is not case:
            raise InvalidCase(
                f"{case.path}: case.id is {case.id!r} like that of {other.path}; results are "
                "kept by id, so run them one after the other into folders of their own"
            )


def tasks_of(
    case: Case, methods: Mapping[str, Method], fields: str, output: Path
) -> Iterator[Task]:
    """Yield the tasks of a case: each method on each surface, or on one if that answers all."""
    for name in case.methods:
        method = methods[name]
        single = method.one_answer(case.options[name])
        for member, recipe in enumerate(case.recipes[:1] if single else case.recipes):
            seed = None if single else getattr(recipe, "seed", None)
            task = Task(case, method, member, "single" if seed is None else f"seed{seed}")
            wanted = fields == "all" or (fields in ("first", "steps") and member == 0)
            if wanted and method.has_fields:
                task = replace(task, fields=task.fields_path(output))
                if fields == "steps" and method.steps:
                    task = replace(task, steps=task.steps_path(output))
            yield task


def _collect(tasks: Sequence[Task], done: Done) -> Answer:
    results = [(t, r) for t in tasks if isinstance(r := done.outcomes[t], ContactResult)]
    errors = [(t, r) for t in tasks if isinstance(r := done.outcomes[t], str)]
    return Answer(
        results=tuple(result for _, result in results),
        labels=tuple(task.label for task, _ in results),
        errors=tuple(f"{t.method.name}, {t.label}: {sentence}" for t, sentence in errors),
        reused=len(done.reused & set(tasks)),
    )
