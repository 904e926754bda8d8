"""Cases become answers: one task per surface and method, spread over processes or a
cluster.

Each result is written to disk at once (see `store`), so that an interrupted run resumes
where it stopped.  A process does a whole task, so nothing large passes between
processes.  A worker of an executor may share nothing with this machine but the
installed packages: `solve_elsewhere` refuses other versions than those of the sender,
and sends back every file that the task writes.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
import platform
import signal
import tempfile
import threading
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence, Set
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from numbers import Real
from pathlib import Path
from typing import get_args

from epcontact.errors import InvalidCase, sentence_of
from epcontact.files import remove_leftovers, require_writable, write_bytes, write_json
from epcontact.harness.answers.loads import TimeUp, solve_path, told, write
from epcontact.harness.answers.store import (
    ROW,
    Answer,
    Task,
    basis,
    keep,
    kept,
    summary,
)
from epcontact.harness.case_files.case import Case
from epcontact.harness.methods.registry import METHODS, Method
from epcontact.harness.processes import (
    Child,
    ChildDied,
    Factory,
    Processes,
    made,
    spread,
)
from epcontact.harness.quantities.answered import Answered
from epcontact.harness.quantities.registry import measured
from epcontact.machine import (
    available_cores,
    available_memory,
    compile_seconds,
    compiling,
)
from epcontact.output.vtk import Precision
from epcontact.results import ContactResult
from epcontact.scene import Scene, integer

Outcome = (
    ContactResult | str
)  # the result of a task, or the sentence that says why there is none
Files = Mapping[Path, bytes]  # the content of files by their paths

_MOMENT = 0.05  # seconds after which an alarm that came at a wrong moment comes again

#: The values of two attributes of `Run`.
_KNOWN = {"fields": ("none", "first", "all", "steps"), "precision": get_args(Precision)}

#: Called with the number of tasks done (within a solve with its share, too), the number
#: of all and, at the end of a task, its name, which ends with "(reused)" or "(failed)"
#: if it was.
Progress = Callable[[float, int, str], None]


@dataclass(frozen=True)
class Run:
    """The way cases are solved; a command or a caller makes it once, and it is handed
    down whole.

    Attributes:
        output: folder for the results.
        jobs: number of worker processes, which share the cores; fewer are started where
            their solves are estimated not to fit into memory side by side.  None: one
            for each core, or a single one for size large, whose solves fill the memory.
            With an executor, the number of solves that share the cores of one of its
            workers; None: 1.
        executor: a factory of a `concurrent.futures.Executor` whose workers solve, or
            its name `module:function`; empty: processes of this machine.
        fresh: solve again what is already in the output folder.
        fields: write the fields (.vti) of the "first" surface of each case, of "all" or
            of "none"; "steps": those of the first one at every load, and the bodies of
            the finite elements.
        precision: of the numbers in the .vti files: "single", seven digits, or
            "double".
        rows: measure for every case what a table of loads shows; else where cases list
            loads.
        progress: see `Progress`.
    """

    output: str | Path = "results"
    jobs: int | None = None
    executor: Factory = ""
    fresh: bool = False
    fields: str = "none"
    precision: Precision = "single"
    rows: bool = False
    progress: Progress = lambda done, total, words: None

    def __post_init__(self) -> None:
        if self.jobs is not None:
            integer("jobs", self.jobs, 1)
        for name, known in _KNOWN.items():
            if (given := getattr(self, name)) not in known:
                raise InvalidCase(
                    f"{name} is {given!r}, but must be one of {', '.join(known)}"
                )

    @property
    def folder(self) -> Path:
        """The folder for the results."""
        return Path(self.output)

    def jobs_for(self, tasks: Sequence[Task]) -> int:
        """Return how many tasks are solved at once; on this machine as many as fit into
        memory.
        """
        if self.executor:
            return self.jobs or 1
        large = any(task.case.size == "large" for task in tasks)
        jobs = min(self.jobs or (1 if large else available_cores()), len(tasks))
        if jobs <= 1:
            return 1
        return max(
            1, min(jobs, int(available_memory() // max(task.memory for task in tasks)))
        )


#: Called with a case and its answers when it has them all.
CaseDone = Callable[[Case, Mapping[str, Answer]], None]


def run_cases(
    cases: Sequence[Case],
    run: Run,
    methods: Mapping[str, Method] = METHODS,
    done: CaseDone = lambda case, answers: None,
) -> dict[str, dict[str, Answer]]:
    """Answer each case by each of its methods.  Raises InvalidCase if two have one
    id.
    """
    by_id: dict[str, Case] = {}
    for case in cases:
        if (other := by_id.setdefault(case.id, case)) is not case:
            raise InvalidCase(
                f"{case.path}: case.id is {case.id!r} like that of {other.path}; results are "
                "kept by id, so run them one after the other into folders of their own"
            )
    tasks = [task for case in cases for task in tasks_of(case, run, methods)]
    answers: dict[str, dict[str, Answer]] = {case.id: {} for case in cases}
    left = Counter(task.case.id for task in tasks)

    def finish(task: Task, outcomes: Mapping[Task, Outcome], reused: Set[Task]) -> None:
        left[task.case.id] -= 1
        if not left[task.case.id]:
            mine = [each for each in tasks if each.case is task.case]
            answers[task.case.id] = _answers(mine, outcomes, reused, run)
            done(task.case, answers[task.case.id])

    run_tasks(tasks, run, finished=finish)
    return answers


def _answers(
    tasks: Sequence[Task], outcomes: Mapping[Task, Outcome], reused: Set[Task], run: Run
) -> dict[str, Answer]:
    """Return the answers to all tasks of one case by their methods, and write what sums
    them up.
    """
    case, answers = tasks[0].case, {}
    for method in case.methods:
        mine = [t for t in tasks if t.method.name == method]
        results = [
            (t.label, r) for t in mine if isinstance(r := outcomes[t], ContactResult)
        ]
        failures = [(t.label, r) for t in mine if isinstance(r := outcomes[t], str)]
        answers[method] = answer = Answer(
            results=tuple(result for _, result in results),
            labels=tuple(label for label, _ in results),
            errors=tuple(
                f"{method}, {label}: {sentence}" for label, sentence in failures
            ),
            reused=len(reused & set(mine)),
        )
        if results:
            write_json(
                case.folder(run.folder) / f"{method}.json", summary(case, answer)
            )
    return answers


def run_tasks(
    tasks: Sequence[Task],
    run: Run,
    begin: Callable[[], None] = lambda: None,
    finished: Callable[[Task, Mapping[Task, Outcome], Set[Task]], None] = lambda *_: (
        None
    ),
) -> tuple[dict[Task, Outcome], set[Task]]:
    """Solve tasks, but for those whose result is kept; keep each new result at once.
    `begin` is called when nothing is in the way of the solves, and before anything is
    written, and `finished` after each task.  Returns the outcome of each task, and the
    tasks whose kept result was used again.
    """
    outcomes: dict[Task, Outcome] = {}
    reused: set[Task] = set()

    def finish(task: Task, outcome: Outcome, note: str = "") -> None:
        outcomes[task] = outcome
        name = f"{task.case.id} {task.method.name} {task.words or task.label}{note}"
        run.progress(len(outcomes), len(tasks), name)
        finished(task, outcomes, reused)

    for task in tasks:
        earlier = None if run.fresh else kept(task, run.folder)
        if earlier is not None:
            reused.add(task)
            finish(task, earlier, " (reused)")
    waiting = [task for task in tasks if task not in outcomes]
    executor = made(run.executor) if run.executor and waiting else None
    begin()
    folders = {task.case.folder(run.folder) for task in waiting}
    for folder in folders:
        require_writable(folder)
    run.progress(len(outcomes), len(tasks), "")

    def move(share: float) -> None:
        run.progress(len(outcomes) + share, len(tasks), "")

    solved = (
        _solved_by(executor, run, waiting) if executor else _solved(run, waiting, move)
    )
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


def _solved(
    run: Run, tasks: Sequence[Task], moving: Callable[[float], None]
) -> _Solved:
    """Solve tasks here, or in processes of this machine."""
    jobs = run.jobs_for(tasks)
    threads = max(1, available_cores() // jobs)
    if jobs == 1:
        yield from ((task, solve_task(task, threads, moving)) for task in tasks)
        return
    processes = Processes(jobs, sorted({task.method.name for task in tasks}))
    yield from spread(partial(solve_task, threads=threads), tasks, processes)


def _solved_by(executor: Executor, run: Run, tasks: Sequence[Task]) -> _Solved:
    """Have the workers of an executor solve the tasks that fit into the memory of one
    of them.
    """
    room = getattr(executor, "worker_memory", math.inf)
    if not isinstance(room, Real):
        executor.shutdown(wait=False)
        raise InvalidCase(
            f"the executor's worker_memory is {room!r}, but must be in bytes"
        )
    large = {
        task: task.memory for task in tasks if room < math.inf and task.memory > room
    }
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


def tasks_of(
    case: Case, run: Run, methods: Mapping[str, Method] = METHODS
) -> Iterator[Task]:
    """Yield the tasks of a case: each method on each surface, or on one if that answers
    all.
    """
    for name in case.methods:
        method = methods[name]
        # The theory of the spectrum from which all surfaces are drawn is one answer.
        single = case.options[name].get("spectrum") == "analytic"
        for member, recipe in enumerate(case.recipes[:1] if single else case.recipes):
            seed = None if single else getattr(recipe, "seed", None)
            label = "single" if seed is None else f"seed{seed}"
            rows = (run.rows or case.lists_loads) and method.has_fields
            task = Task(case, method, member, label, precision=run.precision, rows=rows)
            written = run.fields == "all" or (member == 0 and run.fields != "none")
            if method.has_fields and written:
                task = replace(task, fields=task.fields_path(run.folder))
                if run.fields == "steps" and method.steps:
                    task = replace(task, steps=task.steps_path(run.folder))
            yield task


def solve_task(
    task: Task, threads: int, moving: Callable[[float], None] | None = None
) -> Outcome:
    """Solve one task; return the sentence of whatever went wrong, so that others are
    judged.
    """
    try:
        with _limited(task.case.head.time_limit):
            scene = task.case.scene(task.recipe)
            result = solve_path(task, scene, threads, moving)
        result = _with_measurements(task, scene, told(task, scene, result))
        if task.fields is not None and result.fields:
            write(task, scene, result, task.fields)
        return replace(result, fields={})
    except Exception as error:
        logging.getLogger("epcontact").debug("%s failed", task.label, exc_info=error)
        return sentence_of(error)


def _with_measurements(
    task: Task, scene: Scene, result: ContactResult
) -> ContactResult:
    """Add what is measured, while the fields are in memory; what only a sweep asks for
    is nan where it is not defined, and a note says why.
    """
    if not task.measured:
        return result
    answered, notes = Answered(scene, result), list(result.notes)
    values = dict(result.final.quantities)
    for name in task.measured:
        short = name.removeprefix("quantity.")
        if name in ROW and short in values:
            continue
        if (
            ".measured_" in name and short in values
        ):  # of a load each, of which the worst is judged
            each = [step.quantities[short] for step in result.steps]
            values[short] = max(each, key=lambda value: (math.isnan(value), value))
            continue
        try:
            values[short] = measured(name, answered)
        except InvalidCase as error:
            if name not in task.quantities:
                raise
            values[short] = math.nan
            notes.append(f"no value: {error}")
    final = replace(result.final, quantities=values)
    return replace(result, steps=(*result.steps[:-1], final), notes=tuple(notes))


@contextlib.contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raise TimeUp after `seconds` and the time for kernels, if an alarm can be set
    here.
    """
    if threading.current_thread() is not threading.main_thread() or not hasattr(
        signal, "SIGALRM"
    ):
        yield
        return
    compiled = compile_seconds()

    def expire(*_: object) -> None:
        nonlocal compiled
        more, compiled = compile_seconds() - compiled, compile_seconds()
        if more > 0 or compiling():
            signal.setitimer(signal.ITIMER_REAL, max(more, _MOMENT))
            return
        raise TimeUp(f"not finished within the case's time limit of {seconds:g} s")

    previous = signal.signal(signal.SIGALRM, expire)
    signal.setitimer(signal.ITIMER_REAL, min(seconds, 1e8))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)


def solve_elsewhere(
    order: tuple[Task, Mapping[str, str]], share: int
) -> tuple[Outcome, Files]:
    """Solve a task on a worker that need not see the folders of the sender; return the
    files.
    """
    task, sent = order
    here = basis()
    if other := [name for name, version in sent.items() if here.get(name) != version]:
        found = ", ".join(
            f"{name} {here.get(name)} in the place of {sent[name]}" for name in other
        )
        return (
            f"the worker on {platform.node()} has {found}; install the same there",
            {},
        )
    given = os.environ.get(
        "OMP_NUM_THREADS", ""
    )  # by which schedulers give fewer cores
    cores = int(given) if given.isdecimal() and int(given) else available_cores()
    with tempfile.TemporaryDirectory(prefix="epcontact-") as name:
        folder = Path(name)
        fields = task.fields and folder / task.fields.name
        steps = task.steps and folder / task.steps.name
        outcome = _called(
            replace(task, fields=fields, steps=steps), max(1, cores // share)
        )
        above = (task.fields or task.steps or folder).parent
        files = [path for path in folder.rglob("*") if path.is_file()]
        return outcome, {above / p.relative_to(folder): p.read_bytes() for p in files}


#: Processes that have done a task of one of this process's threads and wait for another
#: one.
_IDLE: list[Child] = []


def _called(task: Task, threads: int) -> Outcome:
    """Solve a task; a thread, which no time limit could interrupt, has a process do
    it.
    """
    if threading.current_thread() is threading.main_thread():
        return solve_task(task, threads)
    child = _IDLE.pop() if _IDLE else Child()
    try:
        return child.call(solve_task, task, threads)
    except ChildDied as error:
        return f"its process {error}"
    finally:
        _IDLE.append(child)
