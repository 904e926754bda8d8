"""Cases become answers: one task per surface and method, spread over processes or a cluster.

Each result is written to disk at once (see `store`), so that an interrupted run resumes where it
stopped.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from numbers import Real
from pathlib import Path
from typing import get_args

from epcontact.errors import InvalidCase
from epcontact.files import remove_leftovers, require_writable, write_json
from epcontact.harness.answers.solve import Outcome, Parcel, solve_elsewhere, solve_task
from epcontact.harness.answers.store import Answer, Task, basis, keep, kept, summary
from epcontact.harness.case_files.case import Case
from epcontact.harness.methods.registry import METHODS, Method
from epcontact.harness.processes import Factory, Processes, made, spread
from epcontact.machine import available_cores, available_memory
from epcontact.output.vtk import Precision
from epcontact.results import ContactResult
from epcontact.scene import whole

#: The fields that can be written, see `Run`, and the precisions of their numbers.
FIELDS, PRECISIONS = ("none", "first", "all", "steps"), get_args(Precision)


#: Called with the number of tasks done (within a solve with its share, too), the number of all and,
#: at the end of a task, its name, which ends with "(reused)" or "(failed)" if it was.
Progress = Callable[[float, int, str], None]


def silent(done: float, total: int, words: str) -> None:
    """Tell nobody about progress."""


@dataclass(frozen=True)
class Run:
    """How cases are solved: made once by a command or a caller, and handed down whole.

    Attributes:
        output: folder for the results.
        jobs: number of worker processes, which share the cores; fewer are started where their
            solves are estimated not to fit into memory side by side.  None: one for each core, or a
            single one for size large, whose solves fill the memory.  With an executor, the number
            of solves that share the cores of one of its workers; None: 1.
        executor: a factory of a `concurrent.futures.Executor` whose workers solve, or its name
            `module:function`; empty: processes of this machine.
        fresh: solve again what is already in the output folder.
        fields: write the fields (.vti) of the "first" surface of each case, of "all" or of "none";
            "steps": those of the first one at every load, and the bodies of the finite elements.
        precision: of the numbers in the .vti files: "single", seven digits, or "double".
        progress: see `Progress`.
    """

    output: str | Path = "results"
    jobs: int | None = None
    executor: Factory = ""
    fresh: bool = False
    fields: str = "none"
    precision: Precision = "single"
    progress: Progress = silent

    def __post_init__(self) -> None:
        if self.jobs is not None:
            whole("jobs", self.jobs, 1)
        for name, known in (("fields", FIELDS), ("precision", PRECISIONS)):
            if getattr(self, name) not in known:
                given = getattr(self, name)
                raise InvalidCase(f"{name} is {given!r}, but must be one of {', '.join(known)}")

    @property
    def folder(self) -> Path:
        """The folder for the results."""
        return Path(self.output)

    def jobs_for(self, tasks: Sequence[Task]) -> int:
        """Return the number of jobs, chosen if it is not given."""
        if self.jobs is not None:
            return self.jobs
        large = any(task.case.size == "large" for task in tasks)
        return 1 if self.executor or large else available_cores()


@dataclass(frozen=True)
class Done:
    """Tasks that were done: the outcome of each, and those whose kept result was used again."""

    outcomes: Mapping[Task, Outcome]
    reused: frozenset[Task]


def run_cases(
    cases: Sequence[Case], run: Run, methods: Mapping[str, Method] = METHODS
) -> dict[str, dict[str, Answer]]:
    """Answer each case by each of its methods."""
    _require_distinct(cases)
    tasks = [task for case in cases for task in tasks_of(case, run, methods)]
    done = run_tasks(tasks, run)
    answers: dict[str, dict[str, Answer]] = {case.id: {} for case in cases}
    for case in cases:
        for method in case.methods:
            mine = [t for t in tasks if t.case is case and t.method.name == method]
            answer = _collect(mine, done)
            answers[case.id][method] = answer
            if answer.results:
                write_json(case.folder(run.folder) / f"{method}.json", summary(case, answer))
    return answers


def run_tasks(tasks: Sequence[Task], run: Run) -> Done:
    """Solve tasks, but for those whose result is kept; keep each new result at once."""
    outcomes: dict[Task, Outcome] = {}
    reused: set[Task] = set()

    def finish(task: Task, outcome: Outcome, note: str = "") -> None:
        outcomes[task] = outcome
        name = f"{task.case.id} {task.method.name} {task.words or task.label}{note}"
        run.progress(len(outcomes), len(tasks), name)

    for task in tasks:
        earlier = None if run.fresh else kept(task, run.folder)
        if earlier is not None:
            reused.add(task)
            finish(task, earlier, " (reused)")
    waiting = [task for task in tasks if task not in outcomes]
    folders = {task.case.folder(run.folder) for task in waiting}
    for folder in folders:
        require_writable(folder)
    run.progress(len(outcomes), len(tasks), "")

    def move(share: float) -> None:
        run.progress(len(outcomes) + share, len(tasks), "")

    try:
        with contextlib.closing(_solved(waiting, run, move)) as solved:
            for task, outcome in solved:
                if isinstance(outcome, ContactResult):
                    keep(task, run.folder, outcome)
                finish(task, outcome, " (failed)" if isinstance(outcome, str) else "")
    finally:
        for folder in folders:
            remove_leftovers(folder)
    return Done(outcomes, frozenset(reused))


def _solved(
    tasks: Sequence[Task], run: Run, moving: Callable[[float], None]
) -> Generator[tuple[Task, Outcome]]:
    """Yield each task with its outcome, in any order."""
    jobs = run.jobs_for(tasks)
    if run.executor:
        yield from _solved_by(run.executor, tasks, jobs)
        return
    jobs = _fitting(tasks, min(jobs, len(tasks)))
    threads = max(1, available_cores() // max(1, jobs))
    if jobs <= 1:
        yield from ((task, solve_task(task, threads, moving)) for task in tasks)
    else:
        # Each method begins at once, so that on a new machine processes compile different kernels.
        first = {task.method.name: task for task in reversed(tasks)}
        tasks = [*first.values(), *(task for task in tasks if first[task.method.name] is not task)]
        processes = Processes(jobs, sorted(first))
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


def _require_distinct(cases: Sequence[Case]) -> None:
    by_id: dict[str, Case] = {}
    for case in cases:
        other = by_id.setdefault(case.id, case)
        if other is not case:
            raise InvalidCase(
                f"{case.path}: case.id is {case.id!r} like that of {other.path}; results are "
                "kept by id, so run them one after the other into folders of their own"
            )


def tasks_of(case: Case, run: Run, methods: Mapping[str, Method] = METHODS) -> Iterator[Task]:
    """Yield the tasks of a case: each method on each surface, or on one if that answers all."""
    for name in case.methods:
        method = methods[name]
        # The theory of the spectrum from which all surfaces are drawn is one answer.
        single = case.options[name].get("spectrum") == "analytic"
        for member, recipe in enumerate(case.recipes[:1] if single else case.recipes):
            seed = None if single else getattr(recipe, "seed", None)
            label = "single" if seed is None else f"seed{seed}"
            task = Task(case, method, member, label, precision=run.precision)
            if method.has_fields and (
                run.fields == "all" or (member == 0 and run.fields != "none")
            ):
                task = replace(task, fields=task.fields_path(run.folder))
                if run.fields == "steps" and method.steps:
                    task = replace(task, steps=task.steps_path(run.folder))
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
