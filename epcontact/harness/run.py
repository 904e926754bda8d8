"""From cases to results: one task a surface and method, spread over processes, kept on disk.

`tasks` solves one of them, `store` keeps its result; here they are listed, those that are on
disk already are set aside, and the others are spread over worker processes.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from epcontact.errors import InvalidCase
from epcontact.harness.case import Case
from epcontact.harness.methods import METHODS
from epcontact.harness.store import Answer, keep, kept, summary
from epcontact.harness.tasks import Task, solve_task
from epcontact.machine import available_cores
from epcontact.output.files import write_json
from epcontact.results import ContactResult

__all__ = ["Answer", "Plan", "Task", "available_cores", "run_cases", "tasks_of"]

Progress = Callable[[Task, str], None]  # a task is done; the note is "reused", "failed" or empty


@dataclass(frozen=True)
class Plan:
    """How tasks are run: worker processes, output folder, what stands in for the BEM, fields.

    solver: `package.module:function` mapping a Scene to a ContactResult, in the place of bem.
    fields: write the fields of each surface ("all"), the first ("first"), or none ("none").
    fresh: run even what is already in the output folder.
    """

    jobs: int = 1
    output: Path = field(default_factory=lambda: Path("results"))
    solver: str = ""
    fields: str = "none"
    fresh: bool = False


def tasks_of(case: Case, methods: Sequence[str], plan: Plan) -> list[Task]:
    """The tasks of a case.  The theory of an analytic spectrum is one task for all surfaces."""
    tasks = []
    for method in methods:
        one = METHODS[method].one_answer(case.options[method])
        for member, recipe in enumerate(case.recipes[:1] if one else case.recipes):
            seed = None if one else getattr(recipe, "seed", None)
            label = "single" if seed is None else f"seed{seed}"
            wanted = plan.fields == "all" or (plan.fields == "first" and member == 0)
            solver = plan.solver if method == "bem" else ""
            task = Task(case, method, member, label, solver)
            if wanted and METHODS[method].has_fields:
                task = replace(task, fields=task.fields_path(plan.output))
            tasks.append(task)
    return tasks


def run_cases(
    cases: Sequence[Case],
    methods: Mapping[str, Sequence[str]],
    plan: Plan,
    progress: Progress,
) -> dict[str, dict[str, Answer]]:
    """Answer each case by each of its methods; `{case id: {method: Answer}}`.

    Deliberate errors of a task are kept in its Answer; anything else propagates.  Results are
    on disk as soon as they exist, so that an interrupted run resumes where it stopped.
    Raises InvalidCase if two cases have one id: they would share a folder.
    """
    _require_distinct(cases)
    tasks = [task for case in cases for task in tasks_of(case, methods[case.id], plan)]
    outcomes: dict[Task, ContactResult | str] = {}
    reused: set[Task] = set()
    for task in tasks:
        found = None if plan.fresh else kept(task, plan.output)
        if found is not None:
            outcomes[task] = found
            reused.add(task)
            progress(task, "reused")
    waiting = [task for task in tasks if task not in outcomes]
    for task, outcome in _solve_all(waiting, plan.jobs):
        outcomes[task] = outcome
        good = isinstance(outcome, ContactResult)
        if isinstance(outcome, ContactResult):
            keep(task, plan.output, outcome)
        progress(task, "" if good else "failed")
    answers = {
        case.id: {m: _collect(case, m, outcomes, reused) for m in methods[case.id]}
        for case in cases
    }
    for case in cases:
        for method, answer in answers[case.id].items():
            if answer.results:
                write_json(plan.output / case.id / f"{method}.json", summary(case, answer))
    return answers


def _require_distinct(cases: Sequence[Case]) -> None:
    by_id: dict[str, Case] = {}
    for case in cases:
        other = by_id.setdefault(case.id, case)
        if other is not case:
            raise InvalidCase(
                f"{case.path}: case.id is {case.id!r} like that of {other.path}; results are "
                "kept by id, so run them one after the other into folders of their own"
            )


def _collect(
    case: Case,
    method: str,
    outcomes: Mapping[Task, ContactResult | str],
    reused: set[Task],
) -> Answer:
    mine = sorted(
        (t for t in outcomes if t.case is case and t.method == method), key=lambda t: t.member
    )
    good = [(t, r) for t in mine if isinstance(r := outcomes[t], ContactResult)]
    return Answer(
        results=tuple(r for _, r in good),
        labels=tuple(t.label for t, _ in good),
        errors=tuple(
            f"{t.method}, {t.label}: {r}" for t in mine if isinstance(r := outcomes[t], str)
        ),
        reused=sum(t in reused for t in mine),
    )


def _solve_all(tasks: Sequence[Task], jobs: int) -> Iterator[tuple[Task, ContactResult | str]]:
    jobs = min(jobs, len(tasks))
    threads = max(1, available_cores() // max(1, jobs))
    if jobs <= 1:
        for task in tasks:
            yield task, solve_task(task, threads)
        return
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_quiet_worker)
    try:
        with _interrupts_held():
            futures: dict[Future[Any], Task] = {
                pool.submit(solve_task, task, threads): task for task in tasks
            }
        for future in as_completed(futures):
            try:
                yield futures[future], future.result()
            except BrokenProcessPool:
                yield futures[future], "a worker process died, most likely out of memory"
        pool.shutdown()
    except BaseException:
        # A solve in C cannot be interrupted politely; nothing of it is on disk yet.
        for process in list((getattr(pool, "_processes", None) or {}).values()):
            process.terminate()
        pool.shutdown(wait=False, cancel_futures=True)
        raise


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C and termination back while workers start, and answer them afterwards.

    Workers inherit the mask: deaf to Ctrl-C from their first instruction, they print no traceback
    of an import that was cut short.  The mask alone is not enough, as a thread of a library may
    take the signal; interrupted while it hands a worker its task, the parent would leave one that
    reads half of it.
    """
    main = threading.current_thread() is threading.main_thread()
    if not (main and hasattr(signal, "pthread_sigmask")):
        yield
        return
    held: list[int] = []
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    kinds = (signal.SIGINT, signal.SIGTERM)
    handlers = [signal.signal(kind, lambda number, _: held.append(number)) for kind in kinds]
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for kind, handler in zip(kinds, handlers, strict=True):
            signal.signal(kind, handler)
    if held:
        raise KeyboardInterrupt


def _quiet_worker() -> None:
    """Ctrl-C reaches the whole process group; the parent alone answers it.

    A parent that is killed cannot stop its workers, who would wait for tasks for ever.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)
