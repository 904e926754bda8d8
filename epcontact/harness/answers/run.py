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
from epcontact.files import remove_leftovers, require_writable, write_bytes, write_json
from epcontact.harness.answers.solve import Outcome, solve_elsewhere, solve_task
from epcontact.harness.answers.store import Answer, Task, basis, keep, kept, summary
from epcontact.harness.case_files.case import Case
from epcontact.harness.methods.registry import METHODS, Method
from epcontact.harness.processes import Factory, Processes, made, spread
from epcontact.machine import available_cores, available_memory
from epcontact.output.vtk import Precision
from epcontact.results import ContactResult
from epcontact.scene import whole

#: The values of two attributes of `Run`.
_KNOWN = {"fields": ("none", "first", "all", "steps"), "precision": get_args(Precision)}

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
        for name, known in _KNOWN.items():
            if (given := getattr(self, name)) not in known:
                raise InvalidCase(f"{name} is {given!r}, but must be one of {', '.join(known)}")

    @property
    def folder(self) -> Path:
        """The folder for the results."""
        return Path(self.output)

    def jobs_for(self, tasks: Sequence[Task]) -> int:
        """Return how many tasks are solved at once; on this machine as many as fit into memory."""
        if self.executor:
            return self.jobs or 1
        large = any(task.case.size == "large" for task in tasks)
        jobs = min(self.jobs or (1 if large else available_cores()), len(tasks))
        if jobs <= 1:
            return 1
        return max(1, min(jobs, int(available_memory() // max(task.memory for task in tasks))))


def run_cases(
    cases: Sequence[Case], run: Run, methods: Mapping[str, Method] = METHODS
) -> dict[str, dict[str, Answer]]:
    """Answer each case by each of its methods."""
    _require_distinct(cases)
    tasks = [task for case in cases for task in tasks_of(case, run, methods)]
    outcomes, reused = run_tasks(tasks, run)
    answers: dict[str, dict[str, Answer]] = {case.id: {} for case in cases}
    for case in cases:
        for method in case.methods:
            mine = [t for t in tasks if t.case is case and t.method.name == method]
            answer = _collect({task: outcomes[task] for task in mine}, len(reused & set(mine)))
            answers[case.id][method] = answer
            if answer.results:
                write_json(case.folder(run.folder) / f"{method}.json", summary(case, answer))
    return answers


def run_tasks(tasks: Sequence[Task], run: Run) -> tuple[dict[Task, Outcome], set[Task]]:
    """Solve tasks, but for those whose result is kept; keep each new result at once.

    Returns the outcome of each task, and the tasks whose kept result was used again.
    """
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

    solved = _solved_by(run, waiting) if run.executor else _solved(run, waiting, move)
    try:
        with contextlib.closing(solved):
            for task, outcome in solved:
                if isinstance(outcome, ContactResult):
                    keep(task, run.folder, outcome)
                finish(task, outcome, " (failed)" if isinstance(outcome, str) else "")
    finally:
        for folder in folders:
            remove_leftovers(folder)
    return outcomes, reused


_Solved = Generator[tuple[Task, Outcome]]  # tasks with their outcomes, in any order


def _solved(run: Run, tasks: Sequence[Task], moving: Callable[[float], None]) -> _Solved:
    """Solve tasks here, or in processes of this machine."""
    jobs = run.jobs_for(tasks)
    threads = max(1, available_cores() // jobs)
    if jobs == 1:
        yield from ((task, solve_task(task, threads, moving)) for task in tasks)
        return
    # Each method begins at once, so that on a new machine processes compile different kernels.
    first = {task.method.name: task for task in reversed(tasks)}
    tasks = [*first.values(), *(task for task in tasks if first[task.method.name] is not task)]
    yield from spread(partial(solve_task, threads=threads), tasks, Processes(jobs, sorted(first)))


def _solved_by(run: Run, tasks: Sequence[Task]) -> _Solved:
    """Have the workers of an executor solve the tasks that fit into the memory of one of them."""
    if not tasks:
        return
    executor = made(run.executor)
    room = getattr(executor, "worker_memory", math.inf)
    if not isinstance(room, Real):
        executor.shutdown(wait=False)
        raise InvalidCase(f"the executor's worker_memory is {room!r}, but must be in bytes")
    large = {task: task.memory for task in tasks if room < math.inf and task.memory > room}
    orders = [(task, basis()) for task in tasks if task not in large]
    call = partial(solve_elsewhere, share=run.jobs_for(tasks))
    for (task, _), answer in spread(call, orders, executor):
        if isinstance(answer, tuple):
            outcome, files = answer
            for path, content in files.items():
                write_bytes(path, content)
            yield task, outcome
        else:
            other = f"the executor returned {answer!r:.60}, not what the task returns"
            yield task, answer if isinstance(answer, str) else other
    for task, needed in large.items():
        sizes = f"{needed / 2**30:.1f} GiB, but the largest worker has {room / 2**30:.1f} GiB"
        yield task, f"it needs about {sizes}"


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


def _collect(outcomes: Mapping[Task, Outcome], reused: int) -> Answer:
    results = [(t.label, r) for t, r in outcomes.items() if isinstance(r, ContactResult)]
    return Answer(
        results=tuple(result for _, result in results),
        labels=tuple(label for label, _ in results),
        errors=tuple(
            f"{task.method.name}, {task.label}: {sentence}"
            for task, sentence in outcomes.items()
            if isinstance(sentence, str)
        ),
        reused=reused,
    )
