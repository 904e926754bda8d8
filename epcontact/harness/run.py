"""Cases become answers: one task per surface and method, spread over processes.

One process does a whole task: it makes the surface, solves, and writes or measures the fields, so
nothing large passes between processes.  Each result is written to disk at once (see `store`), so
that an interrupted run resumes where it stopped.
"""

from __future__ import annotations

import contextlib
import logging
import math
import shutil
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from epcontact.errors import InvalidCase, NotConverged, sentence_of
from epcontact.harness import foreign
from epcontact.harness.case import Case
from epcontact.harness.description import described
from epcontact.harness.methods import METHODS, Method
from epcontact.harness.pool import spread
from epcontact.harness.quantities import QUANTITIES, measure_all
from epcontact.harness.store import Answer, Task, keep, kept, summary
from epcontact.machine import available_cores, compile_seconds
from epcontact.output.files import write_json
from epcontact.output.vtk import step_name, write_collection, write_fields
from epcontact.results import ContactResult
from epcontact.scene import Scene

#: The unit of each quantity in the field data of a .vti.
_UNITS = {quantity.name: quantity.unit for quantity in QUANTITIES.values()}

Outcome = ContactResult | str  # the result of a task, or the sentence that says why there is none


@dataclass(frozen=True)
class Progress:
    """A report that one more task is done.

    Attributes:
        done: tasks done so far, this one included.
        total: number of tasks.
        task: the case, the method and the surface, in words.
        note: "reused", "failed" or empty.
    """

    done: int
    total: int
    task: str
    note: str


def run_cases(  # noqa: PLR0913 - the options of the commands
    cases: Sequence[Case],
    output: Path,
    *,
    jobs: int = 1,
    fresh: bool = False,
    fields: str = "none",
    methods: Mapping[str, Method] = METHODS,
    progress: Callable[[Progress], None] | None = None,
    moving: Callable[[float, int], None] | None = None,
) -> dict[str, dict[str, Answer]]:
    """Answer each case by each of its methods.

    Args:
        cases: cases with different ids.
        output: folder for the results.
        jobs: number of worker processes, which share the cores.
        fresh: solve again what is already in the output folder.
        fields: write the fields of each surface ("all"), of the first ("first"), of the first at
            every load of the path, with the body of the finite elements ("steps"), or none
            ("none").
        methods: the registry of the cases' methods.
        progress: called after every task.
        moving: called at the start, and within tasks that are solved one by one in this process,
            with the number of tasks done, the share of the present one included, and of all.

    Returns:
        {case id: {method: Answer}}.  The error of a solve is kept in the Answer as its sentence.

    Raises:
        InvalidCase: if two cases have one id, so that they would share a folder.
        OutputError: if a result cannot be written.
    """
    _require_distinct(cases)
    tasks = [task for case in cases for task in _tasks_of(case, methods, fields, output)]
    outcomes: dict[Task, Outcome] = {}
    reused = set()

    def finish(task: Task, outcome: Outcome, note: str) -> None:
        outcomes[task] = outcome
        if progress is not None:
            name = f"{task.case.id} {task.method.name} {task.label}"
            progress(Progress(len(outcomes), len(tasks), name, note))

    for task in tasks:
        earlier = None if fresh else kept(task, output)
        if earlier is not None:
            reused.add(task)
            finish(task, earlier, "reused")
    waiting = [task for task in tasks if task not in outcomes]
    solve: Callable[[Task, int], Outcome] = _solve
    if moving is not None:
        moving(len(outcomes), len(tasks))
        if min(jobs, len(waiting)) <= 1:  # another process could not call it
            solve = partial(_solve, moving=lambda share: moving(len(outcomes) + share, len(tasks)))
    for task, outcome in spread(solve, waiting, jobs):
        if isinstance(outcome, ContactResult):
            keep(task, output, outcome)
        finish(task, outcome, "failed" if isinstance(outcome, str) else "")
    answers: dict[str, dict[str, Answer]] = {case.id: {} for case in cases}
    for case in cases:
        for method in case.methods:
            mine = [t for t in tasks if t.case is case and t.method.name == method]
            answer = _collect(mine, outcomes, len(reused & set(mine)))
            answers[case.id][method] = answer
            if answer.results:
                write_json(case.folder(output) / f"{method}.json", summary(case, answer))
    return answers


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


def _tasks_of(
    case: Case, methods: Mapping[str, Method], fields: str, output: Path
) -> Iterator[Task]:
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


def _collect(tasks: Sequence[Task], outcomes: Mapping[Task, Outcome], reused: int) -> Answer:
    results = [(t, r) for t in tasks if isinstance(r := outcomes[t], ContactResult)]
    errors = [(t, r) for t in tasks if isinstance(r := outcomes[t], str)]
    return Answer(
        results=tuple(result for _, result in results),
        labels=tuple(task.label for task, _ in results),
        errors=tuple(f"{t.method.name}, {t.label}: {sentence}" for t, sentence in errors),
        reused=reused,
    )


def _solve(task: Task, threads: int, moving: Callable[[float], None] | None = None) -> Outcome:
    """Solve one task; return the sentence of whatever went wrong, so that others are judged."""
    try:
        case = task.case
        method = task.method
        with contextlib.nullcontext() if method.source else _limited(case.time_limit):
            scene = case.scene(task.recipe)
            if method.source:  # its limit is enforced from outside its process
                result = foreign.solve(method.name, method.source, scene, case.time_limit)
            else:
                options = {**case.options[method.name], **_step_options(task, scene)}
                if moving is not None and method.tells_progress:
                    options["progress"] = lambda share, _: moving(share)
                result = method.solve(scene, options, threads)
        if not result.converged:
            raise NotConverged("the result says that it has not converged")
        result = _with_measurements(task, scene, _told(task, scene, result))
        if task.fields is not None and result.fields:
            _write(task, scene, result, task.fields)
        return replace(result, fields={})
    except Exception as error:
        logging.getLogger("epcontact").debug("%s failed", task.label, exc_info=error)
        return sentence_of(error)


def _told(task: Task, scene: Scene, result: ContactResult) -> ContactResult:
    """Add to a result what was computed, in words and figures."""
    about = described(scene, task.recipe)
    return replace(result, provenance=replace(result.provenance, about=about))


def _write(task: Task, scene: Scene, result: ContactResult, path: Path) -> None:
    attributes = {"case": task.case.id, "size": task.case.size}
    write_fields(path, result, scene.surface, attributes, units=_UNITS)


def _step_options(task: Task, scene: Scene) -> dict[str, Any]:
    """Return the options by which the method writes the files of every load."""
    folder = task.steps
    if folder is None:
        return {}
    shutil.rmtree(folder, ignore_errors=True)  # a longer path may have been there
    if task.method.steps == "output":
        return {"output": folder}

    def on_step(result: ContactResult) -> None:
        number = len(result.steps) - 1
        _write(task, scene, _told(task, scene, result), folder / step_name(number))
        pressures = [step.mean_pressure for step in result.steps]
        write_collection(folder / "path.pvd", pressures)

    return {"on_step": on_step}


def _with_measurements(task: Task, scene: Scene, result: ContactResult) -> ContactResult:
    """Add the measured quantities that the gates need, while the fields are in memory."""
    measured = measure_all(task.measured, scene, result)
    if not measured:
        return result
    named = {name.removeprefix("quantity."): value for name, value in measured.items()}
    final = replace(result.final, quantities=dict(result.final.quantities) | named)
    return replace(result, steps=(*result.steps[:-1], final))


@contextlib.contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raise NotConverged after `seconds` if the platform and the thread allow an alarm.

    The time that kernels take to compile is given on top.
    """
    main = threading.current_thread() is threading.main_thread()
    if not (main and hasattr(signal, "SIGALRM")):
        yield
        return

    compiled = compile_seconds()

    def expire(*_: object) -> None:
        nonlocal compiled
        compiling, compiled = compile_seconds() - compiled, compile_seconds()
        if compiling > 0:
            signal.setitimer(signal.ITIMER_REAL, compiling)
            return
        raise NotConverged(f"not finished within the case's time limit of {seconds:g} s")

    previous = signal.signal(signal.SIGALRM, expire)
    signal.setitimer(signal.ITIMER_REAL, min(seconds, math.floor(1e8)))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)
