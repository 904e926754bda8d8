"""One task: make the surface, solve, measure what is asked for, write the fields.

A process does a whole task, so nothing large passes between processes.  A worker of an executor may
share nothing with this machine but the installed packages: `solve_elsewhere` refuses other versions
than those of the sender, counts the worker's cores, and sends back every file that the task writes.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
import platform
import shutil
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from epcontact.errors import InvalidCase, NotConverged, sentence_of
from epcontact.files import step_name, write_collection
from epcontact.harness.answers.description import described
from epcontact.harness.answers.store import Task, basis
from epcontact.harness.methods import foreign
from epcontact.harness.processes import Child, ChildDied
from epcontact.harness.quantities.answered import Answered
from epcontact.harness.quantities.registry import QUANTITIES, measured
from epcontact.machine import available_cores, compile_seconds, compiling
from epcontact.output.vtk import write_fields
from epcontact.results import ContactResult
from epcontact.scene import Scene

Outcome = ContactResult | str  # the result of a task, or the sentence that says why there is none
Files = Mapping[Path, bytes]  # the content of files by their paths

#: The unit of each quantity in the field data of a .vti.
_UNITS = {quantity.name: quantity.unit for quantity in QUANTITIES.values()}
_MOMENT = 0.05  # seconds after which an alarm that came at a wrong moment comes again


def solve_task(task: Task, threads: int, moving: Callable[[float], None] | None = None) -> Outcome:
    """Solve one task; return the sentence of whatever went wrong, so that others are judged."""
    try:
        case, method = task.case, task.method
        with contextlib.nullcontext() if method.source else _limited(case.head.time_limit):
            scene = case.scene(task.recipe)
            if method.source:  # its limit is enforced from outside its process
                result = foreign.solve(method.name, method.source, scene, case.head.time_limit)
            else:
                options = {**case.options[method.name], **_step_options(task, scene)}
                if moving is not None and method.steps:
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
    if source := task.case.hardness_source:
        meaning = "where the hardness comes from"
        about["hardness_source"] = {"value": source, "unit": "", "meaning": meaning}
    return replace(result, provenance=replace(result.provenance, about=about))


def _write(task: Task, scene: Scene, result: ContactResult, path: Path) -> None:
    attributes = {"case": task.case.id, "size": task.case.size}
    write_fields(path, result, scene.surface, attributes, precision=task.precision, units=_UNITS)


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
        _write(task, scene, _told(task, scene, result), folder / step_name(number, ".vti"))
        write_collection(folder / "path.pvd", [step.mean_pressure for step in result.steps])

    return {"on_step": on_step}


def _with_measurements(task: Task, scene: Scene, result: ContactResult) -> ContactResult:
    """Add what is measured, while the fields are in memory.

    A quantity that only a sweep asks for is nan where it is not defined, and a note says why.
    """
    if not task.measured:
        return result
    answered, notes = Answered(scene, result), list(result.notes)
    values = dict(result.final.quantities)
    for name in task.measured:
        try:
            value = measured(name, answered)
        except InvalidCase as error:
            if name not in task.quantities:
                raise
            value = math.nan
            notes.append(f"no value: {error}")
        values[name.removeprefix("quantity.")] = value
    final = replace(result.final, quantities=values)
    return replace(result, steps=(*result.steps[:-1], final), notes=tuple(notes))


@contextlib.contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raise NotConverged after `seconds` and the time for kernels, if an alarm can be set here."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "SIGALRM"):
        yield
        return
    compiled = compile_seconds()

    def expire(*_: object) -> None:
        nonlocal compiled
        more, compiled = compile_seconds() - compiled, compile_seconds()
        if more > 0 or compiling():
            signal.setitimer(signal.ITIMER_REAL, max(more, _MOMENT))
            return
        raise NotConverged(f"not finished within the case's time limit of {seconds:g} s")

    previous = signal.signal(signal.SIGALRM, expire)
    signal.setitimer(signal.ITIMER_REAL, min(seconds, 1e8))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)


# --- on a worker elsewhere -----------------------------------------------------------------------


def solve_elsewhere(order: tuple[Task, Mapping[str, str]], share: int) -> tuple[Outcome, Files]:
    """Solve a task on a worker that need not see the folders of the sender; return the files."""
    task, sent = order
    here = basis()
    if other := [name for name, version in sent.items() if here.get(name) != version]:
        found = ", ".join(f"{name} {here.get(name)} in the place of {sent[name]}" for name in other)
        return f"the worker on {platform.node()} has {found}; install the same there", {}
    threads = max(1, _worker_cores() // share)
    with tempfile.TemporaryDirectory(prefix="epcontact-") as name:
        folder = Path(name)
        fields = task.fields and folder / task.fields.name
        steps = task.steps and folder / task.steps.name
        outcome = _called(replace(task, fields=fields, steps=steps), threads)
        above = (task.fields or task.steps or folder).parent
        files = [path for path in folder.rglob("*") if path.is_file()]
        return outcome, {above / p.relative_to(folder): p.read_bytes() for p in files}


def _worker_cores() -> int:
    """Return the cores of this process, or OMP_NUM_THREADS, by which schedulers give fewer."""
    given = os.environ.get("OMP_NUM_THREADS", "")
    return int(given) if given.isdecimal() and int(given) else available_cores()


#: Processes that have done a task of one of this process's threads and wait for another one.
_IDLE: list[Child] = []


def _called(task: Task, threads: int) -> Outcome:
    """Solve a task; a thread, which no time limit could interrupt, has a process do it."""
    if threading.current_thread() is threading.main_thread():
        return solve_task(task, threads)
    child = _IDLE.pop() if _IDLE else Child()
    try:
        return child.call(solve_task, task, threads)
    except ChildDied as error:
        return f"its process {error}"
    finally:
        _IDLE.append(child)
