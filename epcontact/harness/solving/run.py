"""Cases become results: every task is solved here, in processes, or by an executor.

    for case, results in solve_cases(cases, run):
        ...  # the results of each method, when the last task of the case is done

Each result is written to disk at once (see `saved`), so that an interrupted run resumes
where it stopped.  A process does a whole task, so nothing large passes between
processes.  The workers of an executor need the versions of this machine and, to write
fields, its output folder.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
import platform
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from numbers import Real
from pathlib import Path
from typing import Any

from epcontact.errors import EpcontactError, InvalidCase, place_of, sentence_of
from epcontact.files import (
    lock_folders,
    output_error,
    path_inside,
    remove_leftovers,
    require_links_inside,
    require_writable,
    write_json,
)
from epcontact.harness.case_files.case import Case
from epcontact.harness.methods.registry import METHODS, Method
from epcontact.harness.quantities.solved_scene import SolvedScene
from epcontact.harness.solving.load_path import (
    solve_path,
    with_description,
    write_result_fields,
)
from epcontact.harness.solving.measure import MEASURING, measure_end
from epcontact.harness.solving.method_results import MethodResults, summary
from epcontact.harness.solving.saved import (
    delete_loads,
    load_done,
    load_saved,
    save_result,
    software_versions,
)
from epcontact.harness.solving.tasks import Run, Task, tasks_of
from epcontact.harness.workers import (
    WorkerPool,
    call_in_process,
    executor_from,
    spread,
)
from epcontact.machine import (
    available_cores,
    children,
    children_seconds,
    compile_seconds,
    compiling,
    processor_seconds,
)
from epcontact.notebook import OnProgress
from epcontact.results import ContactResult

#: The result of a task, or the sentence that says why there is none.
Outcome = ContactResult | str

#: Shortest time in seconds after which an alarm comes again.
_LATER = 0.05
#: Times as long as the limit of processor time by the clock until a solve is stopped.
_PATIENCE = 20


class TimeUp(EpcontactError):
    """The time limit of a case has passed.

    It is no NotConverged, after which methods try smaller steps.
    """


@dataclass(frozen=True)
class FinishedTask:
    """A task with its outcome: its result, or the sentence that says why it failed.

    `reused` says that an earlier run had saved the result.
    """

    task: Task
    outcome: Outcome
    reused: bool = False


# --- cases


def solve_cases(
    cases: Sequence[Case], run: Run, methods: Mapping[str, Method] = METHODS
) -> Generator[tuple[Case, dict[str, MethodResults]]]:
    """Yield each case with the results of its methods, when all its tasks are done.

    The results of each method are also written to `<method>.json` in the folder of the
    case.  Skipped cases, which have no tasks, come last.

    Args:
        cases: the cases, with different ids.
        run: how they are solved, and the output folder.
        methods: all methods by their names; the options of `--solver` add one.

    Raises:
        InvalidCase: if two cases have one id, or there is no executor of that name.
        OutputError: if a result cannot be written.
    """
    _require_different_ids(cases)
    tasks = {case.id: list(tasks_of(case, run, methods)) for case in cases}
    unfinished = {case_id: len(of_case) for case_id, of_case in tasks.items()}
    finished: dict[Task, FinishedTask] = {}
    every_task = [task for of_case in tasks.values() for task in of_case]
    with contextlib.closing(solve_tasks(every_task, run)) as solving:
        for done in solving:
            finished[done.task] = done
            case = done.task.case
            unfinished[case.id] -= 1
            if not unfinished[case.id]:
                of_case = [finished[task] for task in tasks[case.id]]
                yield case, collect_results(case, of_case, run.folder)
    for case in cases:
        if not tasks[case.id]:
            yield case, collect_results(case, [], run.folder)


def run_cases(
    cases: Sequence[Case], run: Run, methods: Mapping[str, Method] = METHODS
) -> dict[str, dict[str, MethodResults]]:
    """Solve cases; return the results of each method by its name, by the case's id.

    The arguments and the errors are those of `solve_cases`.
    """
    results = {}
    with lock_cases(cases, run.folder):
        for case, of_case in solve_cases(cases, run, methods):
            results[case.id] = of_case
    return {case.id: results[case.id] for case in cases}


@contextlib.contextmanager
def lock_cases(cases: Sequence[Case], output: Path) -> Iterator[None]:
    """Let no other process write the results of cases as long as the block lasts.

    Args:
        cases: the cases; those that are skipped need no lock.
        output: the output folder of the run.

    Raises:
        OutputError: if another process writes them, if their folder cannot be created,
            or if it or a link inside of it leads out of the output folder.
        InvalidCase: if two cases have one id.
    """
    _require_different_ids(cases)
    folders = {case.folder(output) for case in cases if not case.skip}
    for folder in folders:
        path_inside(output, str(folder.relative_to(output)))
        require_links_inside(folder)
    with lock_folders(sorted(folders)):
        yield


def _require_different_ids(cases: Sequence[Case]) -> None:
    """Raise InvalidCase if two different cases have one id, because the results of both
    would be in one folder.
    """
    by_id: dict[str, Case] = {}
    for case in cases:
        other = by_id.setdefault(case.id, case)
        if other is not case:
            raise InvalidCase(
                f"{case.path}: case.id is {case.id!r} like that of {other.path}; "
                "results are kept by id, so run them one after the other into folders "
                "of their own"
            )


def collect_results(
    case: Case, finished: Sequence[FinishedTask], output: Path
) -> dict[str, MethodResults]:
    """Return the results of each method of a case, by the method's name.

    A file `<method>.json` with the results is written for each method that has any.

    Args:
        case: the case.
        finished: its tasks with their outcomes.
        output: the output folder of the run.

    Raises:
        OutputError: if a file cannot be written.
    """
    collected = {}
    for name in case.methods:
        of_method = [done for done in finished if done.task.method.name == name]
        results = []
        labels = []
        errors = []
        for done in of_method:
            if isinstance(done.outcome, ContactResult):
                results.append(done.outcome)
                labels.append(done.task.label)
            else:
                errors.append(f"{name}, {done.task.label}: {done.outcome}")
        reused = sum(done.reused for done in of_method)
        collected[name] = MethodResults(
            tuple(results), tuple(labels), tuple(errors), reused
        )
        if results:
            content = summary(case, collected[name])
            write_json(case.folder(output) / f"{name}.json", content)
    return collected


# --- tasks


def solve_tasks(tasks: Sequence[Task], run: Run) -> Generator[FinishedTask]:
    """Return an iterator over the tasks as they are finished, those saved earlier
    first.

    Each new result is saved before it is yielded.  Nothing is solved, and nothing is
    written, before the first task is requested from the iterator.

    Args:
        tasks: the tasks, of any cases.
        run: how they are solved, and the output folder.

    Raises:
        InvalidCase: at once, if the executor cannot be created.
        OutputError: at once, if no file can be written to a folder of a case.
    """
    saved = {}
    if not run.fresh:
        for task in tasks:
            result = load_saved(task, run.folder)
            if result is not None:
                saved[task] = result
    unsolved = [task for task in tasks if task not in saved]
    executor = executor_from(run.executor) if run.executor and unsolved else None
    for folder in _folders(unsolved, run):
        require_writable(folder)
    return _finish_tasks(tasks, saved, unsolved, executor, run)


def _folders(tasks: Sequence[Task], run: Run) -> set[Path]:
    """Return the folders for the results of the tasks' cases."""
    return {task.case.folder(run.folder) for task in tasks}


def _finish_tasks(
    tasks: Sequence[Task],
    saved: Mapping[Task, ContactResult],
    unsolved: Sequence[Task],
    executor: Executor | None,
    run: Run,
) -> Generator[FinishedTask]:
    """Yield all tasks with their outcomes, and report the progress; see `solve_tasks`.

    Args:
        tasks: all tasks.
        saved: those with a saved result, and this result.
        unsolved: the others.
        executor: solves these, and is shut down at the end; None: this machine solves.
        run: how they are solved; its function `progress` is called.

    Raises:
        OutputError: if a result cannot be written.
        EpcontactError: if the executor fails.
    """
    done = 0
    for task, result in saved.items():
        done += 1
        run.progress(done, len(tasks), f"{task.name} (reused)")
        yield FinishedTask(task, result, reused=True)
    run.progress(done, len(tasks), "")

    def on_progress(fraction: float, _: str) -> None:
        """Report the progress inside of a task, of which this fraction is solved."""
        run.progress(done + fraction, len(tasks), "")

    if run.fresh:
        for task in unsolved:
            delete_loads(task)
    for folder in _folders(unsolved, run):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise output_error("write", folder, error) from None
    if executor is not None:
        solving = _solve_by_executor(executor, run, unsolved)
    else:
        solving = _solve_here(run, unsolved, on_progress)
    try:
        with contextlib.closing(solving):
            for task, outcome in solving:
                name = task.name
                if isinstance(outcome, ContactResult):
                    save_result(task, run.folder, outcome)
                else:
                    name += " (failed)"
                done += 1
                run.progress(done, len(tasks), name)
                yield FinishedTask(task, outcome)
    finally:
        for folder in _folders(unsolved, run):
            remove_leftovers(folder)


def _solve_here(
    run: Run, tasks: Sequence[Task], on_progress: OnProgress
) -> Generator[tuple[Task, Outcome]]:
    """Yield tasks with their outcomes, solved on this machine.

    A single job solves in this process and reports the progress inside of a task to
    `on_progress`.  Several jobs solve in processes of their own, and then tasks come in
    the order in which they finish.
    """
    jobs = run.jobs_for(tasks)
    threads = max(1, available_cores() // jobs)
    if jobs == 1:
        for task in tasks:
            yield task, solve_task(task, threads, on_progress)
        return
    yield from spread(partial(solve_task, threads=threads), tasks, WorkerPool(jobs))


def solve_task(
    task: Task, threads: int, on_progress: OnProgress | None = None
) -> Outcome:
    """Solve one task, and write the files of fields that it asks for.

    Args:
        task: the task.
        threads: the number of threads that the method may use.
        on_progress: called with the solved fraction of the task and a sentence.

    Returns:
        The result with only those fields that gates compare; or, after any error, the
        sentence that says what went wrong, so that other tasks are still solved and
        judged.
    """
    measuring_before = MEASURING.seconds
    loads_before = _count_done(task)
    try:
        with _time_limit(task.case.head.time_limit, threads):
            scene = task.case.scene(task.recipe)
            result = solve_path(task, scene, threads, on_progress)
        result = with_description(task, scene, result)
        result = measure_end(task, scene, result, threads)
        if task.fields_file is not None and result.fields:
            write_result_fields(task, scene, result, task.fields_file)
        if task.method.has_fields:
            seconds = MEASURING.seconds - measuring_before
            cost = {**result.cost, "measuring_seconds": seconds}
            result = replace(result, cost=cost)
        solved = SolvedScene(scene, result)
        compared = {name: solved.field(name) for name in task.compared_fields}
        return replace(result, fields=compared)
    except TimeUp as error:
        return f"{sentence_of(error)}; {_how_to_go_on(task, loads_before)}"
    except Exception as error:
        logging.getLogger("epcontact").debug("%s failed", task.label, exc_info=error)
        sentence = sentence_of(error)
        if not isinstance(error, EpcontactError | MemoryError):
            # An unexpected error is found by its place alone if it does not return.
            sentence += place_of(error)
        return sentence


def _count_done(task: Task) -> int:
    """Return the number of loads of a task that are done and saved."""
    done = load_done(task)
    return 0 if done is None else len(done.result.steps)


def _how_to_go_on(task: Task, loads_before: int) -> str:
    """Return what is done of a task that its time limit has stopped, and how a user
    goes on, as the end of a sentence.

    `loads_before` is the number of loads that were done when this run began.
    """
    count = _count_done(task)
    total = len(task.case.load.path)
    if count == 0:
        return "none of its loads is done: raise time_limit, or take a smaller grid"
    kept = f"{count} of {total} loads are done and kept"
    if count == loads_before:
        return f"{kept}, and load {count + 1} alone takes longer: raise time_limit"
    return (
        f"{kept}: the same command goes on with load {count + 1}, also with a larger "
        "time_limit"
    )


@contextlib.contextmanager
def _time_limit(seconds: float, threads: int = 1) -> Iterator[None]:
    """Raise TimeUp in the `with` block after a processor time.

    The time of child processes counts.  The time in which kernels are compiled and the
    time of measuring do not.  A block that takes _PATIENCE times as long by the clock
    is stopped, too, because it may wait for something that does not come.  The limit
    uses the alarm of the system, so that there is no limit on Windows, and none outside
    the main thread.

    Args:
        seconds: processor time of each thread in s.
        threads: the number of threads that share the work.
    """
    in_main_thread = threading.current_thread() is threading.main_thread()
    if not in_main_thread or not hasattr(signal, "SIGALRM"):
        yield
        return
    limit = seconds * threads

    def solving_seconds() -> float:
        """Return the processor time of this process without compiling and measuring."""
        others = compile_seconds() + MEASURING.processor_seconds
        return processor_seconds() - others

    started = solving_seconds()
    started_by_clock = time.time()
    earlier = children()

    def on_alarm(*_: object) -> None:
        """Raise TimeUp, or set the alarm again if processor time is left."""
        spent = solving_seconds() - started + children_seconds(earlier)
        left = limit - spent
        waited = time.time() - started_by_clock
        is_over = left <= 0 or waited > _PATIENCE * limit
        if is_over and not compiling() and not MEASURING.running:
            raise TimeUp(
                f"stopped at its time_limit in [case], {seconds:g} s of processor time"
            )
        signal.setitimer(signal.ITIMER_REAL, min(max(left / threads, _LATER), 1e8))

    previous = signal.signal(signal.SIGALRM, on_alarm)
    signal.setitimer(signal.ITIMER_REAL, min(seconds, 1e8))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)


# --- executors


def _solve_by_executor(
    executor: Executor, run: Run, tasks: Sequence[Task]
) -> Generator[tuple[Task, Outcome]]:
    """Yield tasks with their outcomes, solved by the workers of an executor.

    A task whose estimated memory exceeds that of a worker is not sent; its outcome is a
    sentence.

    Args:
        executor: may have `worker_memory`, the memory of its largest worker in bytes.
            It is shut down at the end.
        run: how the tasks are solved, and the output folder.
        tasks: the tasks.

    Raises:
        InvalidCase: if `worker_memory` is no number.
        EpcontactError: if the executor takes no task or does not end.
    """
    memory = getattr(executor, "worker_memory", math.inf)
    if not isinstance(memory, Real):
        executor.shutdown(wait=False)
        raise InvalidCase(
            f"the executor's worker_memory is {memory!r}, but must be in bytes"
        )
    sent: dict[Task, Task] = {}
    too_large: dict[Task, float] = {}
    for task in tasks:
        if memory < math.inf and task.memory > memory:
            too_large[task] = task.memory
        else:
            sent[_with_absolute_paths(task)] = task
    solve: Callable[[Task], Any] = partial(
        solve_on_worker, versions=software_versions(), jobs=run.jobs_for(tasks)
    )
    for task, outcome in spread(solve, list(sent), executor):
        if isinstance(outcome, Outcome):
            yield sent[task], outcome
        else:
            sentence = f"the executor returned {outcome!r:.60}, "
            yield sent[task], f"{sentence}not what the task returns"
    for task, needed in too_large.items():
        yield (
            task,
            f"it needs about {needed / 2**30:.1f} GiB, but the largest worker has "
            f"{memory / 2**30:.1f} GiB",
        )


def _with_absolute_paths(task: Task) -> Task:
    """Return the task with absolute paths: a worker has another current folder."""
    if task.fields_file is not None:
        task = replace(task, fields_file=task.fields_file.absolute())
    if task.steps_folder is not None:
        task = replace(task, steps_folder=task.steps_folder.absolute())
    if task.loads_file is not None:
        task = replace(task, loads_file=task.loads_file.absolute())
    return task


def solve_on_worker(task: Task, versions: Mapping[str, str], jobs: int) -> Outcome:
    """Solve a task on a worker of an executor.

    Args:
        task: the task, with absolute paths.
        versions: the software versions of the sender, which the worker needs as well.
        jobs: how many solves share the cores of the worker.

    Returns:
        The result; or the sentence that says why there is none, such as that the worker
        has other versions, or does not have the folder for the fields.
    """
    host = platform.node()
    mine = software_versions()
    different = [name for name in versions if mine.get(name) != versions[name]]
    if different:
        listed = ", ".join(
            f"{name} {mine.get(name)} in the place of {versions[name]}"
            for name in different
        )
        return f"the worker on {host} has {listed}; install the same there"
    if task.fields_file is not None and not task.fields_file.parent.is_dir():
        return (
            f"the worker on {host} does not see the folder {task.fields_file.parent}; "
            "to write fields, workers need the output folder of the sender"
        )
    # Schedulers of clusters set this variable to the cores that a worker may use.
    cores = os.environ.get("OMP_NUM_THREADS", "")
    usable = available_cores()
    if cores.isdecimal() and int(cores) > 0:
        usable = int(cores)
    threads = max(1, usable // jobs)
    if threading.current_thread() is threading.main_thread():
        return solve_task(task, threads)
    # The time limit of a case works in the main thread only: that of a process.
    return call_in_process(solve_task, task, threads)
