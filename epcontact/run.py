"""From cases to results: one task a surface and method, spread over processes, kept on disk.

A task is named by its case file, size, method and surface, so that a worker process can make
the scene itself and nothing large travels between processes.  Its result is kept as
`<output>/<case>/members/<method>-<surface>.json`; a task whose key (scene, options, size,
sources of the package) is found there is not run again.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib
import json
import math
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from epcontact.casefile import Case, load_case
from epcontact.closed_forms import CLOSED_FORMS
from epcontact.compare import estimate
from epcontact.errors import EpcontactError, InvalidCase, NotConverged
from epcontact.measures import MEASURES, measure
from epcontact.output.files import write_json
from epcontact.results import ContactResult
from epcontact.scene import Scene
from epcontact.surfaces import Recipe

Solver = Callable[..., ContactResult]


@dataclass(frozen=True)
class Task:
    """One solve: a method on one surface of a case, and what to keep of it."""

    path: Path
    size: str
    method: str
    member: int
    label: str
    solver: str = ""
    fields: Path | None = None


@dataclass(frozen=True)
class Answer:
    """What a method said of a case: one result a surface, or the sentence why not."""

    results: tuple[ContactResult, ...] = ()
    labels: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()
    reused: int = 0


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
        one = method == "persson" and case.options[method]["spectrum"] == "analytic"
        for member, recipe in enumerate(case.recipes[:1] if one else case.recipes):
            seed = None if one else getattr(recipe, "seed", None)
            label = "single" if seed is None else f"seed{seed}"
            keep = plan.fields == "all" or (plan.fields == "first" and member == 0)
            name = method if seed is None else f"{method}-{label}"
            fields = plan.output / case.id / f"{name}.vti" if keep else None
            solver = plan.solver if method == "bem" else ""
            if method == "persson":
                fields = None
            tasks.append(Task(case.path, case.size, method, member, label, solver, fields))
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
    """
    by_task: dict[Task, Case] = {}
    for case in cases:
        by_task |= dict.fromkeys(tasks_of(case, methods[case.id], plan), case)
    outcomes: dict[Task, ContactResult | str] = {}
    reused: set[Task] = set()
    for task, case in by_task.items():
        found = None if plan.fresh else _kept(task, case, plan.output)
        if found is not None:
            outcomes[task] = found
            reused.add(task)
            progress(task, "reused")
    waiting = [task for task in by_task if task not in outcomes]
    for task, outcome in _solve_all(waiting, plan.jobs):
        outcomes[task] = outcome
        good = isinstance(outcome, ContactResult)
        if isinstance(outcome, ContactResult):
            _keep(task, by_task[task], plan.output, outcome)
        progress(task, "" if good else "failed")
    answers = {
        case.id: {m: _collect(case, m, by_task, outcomes, reused) for m in methods[case.id]}
        for case in cases
    }
    for case in cases:
        for method, answer in answers[case.id].items():
            if answer.results:
                write_json(plan.output / case.id / f"{method}.json", summary(case, answer))
    return answers


def summary(case: Case, answer: Answer) -> dict[str, Any]:
    """A method's answer as JSON: means over the surfaces, their scatter, and every member."""
    members = [result.to_json() for result in answer.results]
    first = answer.results[0]
    ensemble = {
        kind: {
            part: _spread([getattr(r.final.areas[kind], part) for r in answer.results])
            for part in ("total", "elastic", "plastic")
        }
        for kind in first.final.areas
    }
    mean = {
        kind: {part: spread["mean"] for part, spread in parts.items()}
        for kind, parts in ensemble.items()
    }
    cost = {
        key: (max if key == "peak_memory_bytes" else sum)(r.cost[key] for r in answer.results)
        for key in first.cost
    }
    residuals = {
        key: max(r.final.residuals[key] for r in answer.results) for key in first.final.residuals
    }
    return {
        "case": case.id,
        "method": first.method,
        "size": case.size,
        "converged": all(r.converged for r in answer.results),
        "residuals": residuals,
        "areas": mean,
        "ensemble": {"surfaces": list(answer.labels), "areas": ensemble},
        "mean_pressure": first.final.mean_pressure,
        "cost": cost,
        "provenance": members[0]["provenance"],
        "members": members,
    }


def _spread(values: Sequence[float]) -> dict[str, float]:
    e = estimate(values)
    return {"mean": e.mean, "standard_deviation": e.deviation, "half_width_95": e.half_width}


def _collect(
    case: Case,
    method: str,
    by_task: Mapping[Task, Case],
    outcomes: Mapping[Task, ContactResult | str],
    reused: set[Task],
) -> Answer:
    mine = [t for t, c in by_task.items() if c is case and t.method == method]
    good = [(t, r) for t in mine if isinstance(r := outcomes[t], ContactResult)]
    return Answer(
        results=tuple(r for _, r in good),
        labels=tuple(t.label for t, _ in good),
        errors=tuple(
            f"{t.method}, {t.label}: {r}" for t in mine if isinstance(r := outcomes[t], str)
        ),
        reused=sum(t in reused for t in mine),
    )


# --- keeping results ---------------------------------------------------------------------------


@functools.cache
def sources_digest() -> str:
    """SHA-256 of the package's own sources: a result of other sources is not reused."""
    import fem_check

    digest = hashlib.sha256()
    for package in (__file__, fem_check.__file__):
        for file in sorted(Path(package or "").parent.rglob("*.py")):
            digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()


def _key(task: Task, case: Case) -> str:
    content = {
        "scene": case.digest(case.recipes[task.member]),
        "size": task.size,
        "method": task.method,
        "options": repr(sorted(case.options[task.method].items())),
        "solver": task.solver,
        "fields": sorted(_measured_by(case, task.method)),
        "sources": sources_digest(),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _member_path(task: Task, case: Case, output: Path) -> Path:
    return output / case.id / "members" / f"{task.method}-{task.label}.json"


def _keep(task: Task, case: Case, output: Path, result: ContactResult) -> None:
    content = {"case": case.id, "size": case.size, "key": _key(task, case)} | result.to_json()
    write_json(_member_path(task, case, output), content)


def _kept(task: Task, case: Case, output: Path) -> ContactResult | None:
    """The result of an earlier run of just this task, if it is there and whole."""
    if task.fields is not None and not task.fields.exists():
        return None
    try:
        data = json.loads(_member_path(task, case, output).read_bytes())
        if data["key"] != _key(task, case):
            return None
        return ContactResult.from_json(data)
    except (OSError, ValueError, KeyError, TypeError):
        return None


# --- solving -----------------------------------------------------------------------------------


def available_cores() -> int:
    """Cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


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


def _quiet_worker() -> None:
    """Ctrl-C reaches the whole process group; the parent alone answers it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def solve_task(task: Task, threads: int) -> ContactResult | str:
    """Run one task; a deliberate error comes back as its sentence."""
    try:
        case = load_case(task.path, task.size)
        recipe: Recipe = case.recipes[task.member]
        with _limited(case.time_limit):
            scene = case.scene(recipe)
            result = _solver_of(task)(scene, case.options[task.method], threads)
        result = _with_field_measures(case, task, scene, result)
        if task.fields is not None and result.fields:
            from epcontact.output.vtk import write_fields

            attributes: dict[str, str | float | int]
            attributes = {"case": case.id, "size": case.size, "hardness": case.material.hardness}
            write_fields(task.fields, result, scene.surface, attributes)
        return replace(result, fields={})
    except EpcontactError as error:
        return str(error)


def _solver_of(task: Task) -> Solver:
    if task.solver:
        return _foreign(task.solver)
    return {"persson": _persson, "bem": _bem, "fem": _fem}[task.method]


def _persson(scene: Scene, options: Mapping[str, Any], threads: int) -> ContactResult:
    from epcontact import persson

    del threads  # closed forms
    return persson.solve(scene, **options)


def _bem(scene: Scene, options: Mapping[str, Any], threads: int) -> ContactResult:
    from epcontact import bem

    return bem.solve(scene, threads=threads, **options)


def _fem(scene: Scene, options: Mapping[str, Any], threads: int) -> ContactResult:
    from fem_check.driver import solve

    del threads
    return solve(scene, **options)


def _foreign(name: str) -> Solver:
    """A solver of the user's, `package.module:function`.  Raises InvalidCase."""
    module_name, _, attribute = name.partition(":")
    try:
        function = getattr(importlib.import_module(module_name), attribute)
    except Exception as error:
        raise InvalidCase(
            f"--solver {name}: cannot be imported ({_one_line(error)}); "
            "give package.module:function"
        ) from None

    def solve(scene: Scene, options: Mapping[str, Any], threads: int) -> ContactResult:
        del options, threads
        try:
            result = function(scene)
        except EpcontactError:
            raise
        except Exception as error:
            raise InvalidCase(f"--solver {name} raised {_one_line(error)}") from error
        if not isinstance(result, ContactResult):
            raise InvalidCase(f"{name} returned no epcontact.ContactResult")
        return result

    return solve


def _one_line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())


def _with_field_measures(
    case: Case, task: Task, scene: Scene, result: ContactResult
) -> ContactResult:
    """Add what gates ask of the fields to the quantities: the distance of a field from its
    closed form as l2.<form>.<field>, and the harness's own measures (see `measures`).

    They are taken here because fields do not leave the process that made them.
    """
    measures = {}
    for name in _measured_by(case, task.method):
        if not name.startswith("l2."):
            measures[name] = measure(name, scene, result)
            continue
        _, form, field_name = name.split(".")
        exact = CLOSED_FORMS[form].field(field_name, scene)
        found = result.fields.get(field_name)
        if found is None or np.shape(found) != exact.shape:
            raise InvalidCase(
                f"{task.method} gives no field {field_name!r} on the scene's grid for a gate"
            )
        error = np.linalg.norm(found - exact) / np.linalg.norm(exact)
        measures[name] = float(error)
    if not measures:
        return result
    final = replace(result.final, quantities=dict(result.final.quantities) | measures)
    return replace(result, steps=(*result.steps[:-1], final))


def _measured_by(case: Case, method: str) -> set[str]:
    """The names of what the gates on a method ask of its fields."""
    names = set()
    for gate in case.gates:
        if gate.norm == "l2" and method in (gate.of, gate.against):
            names.add(f"l2.{gate.against}.{gate.quantity.removeprefix('field.')}")
        elif method in (gate.of, gate.against):
            names.add(gate.quantity.removeprefix("quantity."))
    return {name for name in names if name.startswith("l2.") or name in MEASURES}


@contextlib.contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raise NotConverged after `seconds`, where the platform and the thread allow an alarm."""
    main = threading.current_thread() is threading.main_thread()
    if not (main and hasattr(signal, "SIGALRM")):
        yield
        return

    def expire(*_: object) -> None:
        raise NotConverged(f"not done after the case's time limit of {seconds:g} s")

    previous = signal.signal(signal.SIGALRM, expire)
    signal.setitimer(signal.ITIMER_REAL, min(seconds, math.floor(1e8)))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)
