"""One task: a method on one surface of a case, solved in the process it is called in.

A task carries its case, whose recipes are small; the surface is made where it is solved, and the
fields are written or measured there, so that nothing large travels between processes.
"""

from __future__ import annotations

import contextlib
import math
import signal
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from epcontact.errors import EpcontactError, InvalidCase, NotConverged
from epcontact.harness.case import Case
from epcontact.harness.gates import l2_distance
from epcontact.harness.methods import METHODS, solver_named
from epcontact.harness.quantities import MEASURES, measure_all
from epcontact.reference import CLOSED_FORMS
from epcontact.results import ContactResult
from epcontact.scene import Scene
from epcontact.surfaces import Recipe


@dataclass(frozen=True, eq=False)
class Task:
    """One solve: a method on one surface of a case, and what to keep of it.

    member: which of the case's recipes; label: its name in files; solver: what stands in for the
    boundary elements, `module:function`; fields: file to write the fields to.
    """

    case: Case
    method: str
    member: int
    label: str
    solver: str = ""
    fields: Path | None = None

    @property
    def recipe(self) -> Recipe:
        """Of the surface."""
        return self.case.recipes[self.member]

    def fields_path(self, output: Path) -> Path:
        """Where the fields lie, if they are kept: `<output>/<case>/<method>[-<surface>].vti`."""
        name = self.method if self.label == "single" else f"{self.method}-{self.label}"
        return output / self.case.id / f"{name}.vti"


def solve_task(task: Task, threads: int) -> ContactResult | str:
    """Run one task; a deliberate error comes back as its sentence."""
    try:
        case, recipe = task.case, task.recipe
        with _limited(case.time_limit):
            scene = case.scene(recipe)
            method = solver_named(task.solver) if task.solver else METHODS[task.method]
            result = method.solve(scene, case.options[task.method], threads)
        result = _with_field_measures(task, scene, result)
        if task.fields is not None and result.fields:
            from epcontact.output.vtk import write_fields

            attributes: dict[str, str | float | int]
            attributes = {"case": case.id, "size": case.size, "hardness": case.material.hardness}
            write_fields(task.fields, result, scene.surface, attributes)
        return replace(result, fields={})
    except EpcontactError as error:
        return str(error)


def _with_field_measures(task: Task, scene: Scene, result: ContactResult) -> ContactResult:
    """Add what gates ask of the fields to the quantities: the distance of a field from its
    closed form as l2.<form>.<field>, and the harness's own measures (see `measures`).

    They are taken here because fields do not leave the process that made them.
    """
    asked = measured_by(task.case, task.method)
    measures = measure_all({n for n in asked if not n.startswith("l2.")}, scene, result)
    for name in asked - measures.keys():
        _, form, field_name = name.split(".")
        exact = CLOSED_FORMS[form].field(field_name, scene)
        found = result.fields.get(field_name)
        if found is None or np.shape(found) != exact.shape:
            raise InvalidCase(
                f"{task.method} gives no field {field_name!r} on the scene's grid for a gate"
            )
        measures[name] = l2_distance(found, exact)
    if not measures:
        return result
    final = replace(result.final, quantities=dict(result.final.quantities) | measures)
    return replace(result, steps=(*result.steps[:-1], final))


def measured_by(case: Case, method: str) -> set[str]:
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
