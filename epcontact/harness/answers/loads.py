"""A load path, solved: each load with its own hardness, and with what a table of loads
shows of it.

An effective hardness depends on the load.  While a load grows, the capped problem has
no memory: each load beyond all before it is solved on the surface as it was made, with
its own hardness. Smaller loads after it meet what it has left behind, and keep its
hardness.
"""

from __future__ import annotations

import itertools
import math
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from epcontact.errors import EpcontactError, InvalidCase, NotConverged
from epcontact.files import step_name, write_collection
from epcontact.harness.answers.store import ROW, Task, described
from epcontact.harness.quantities.answered import Answered
from epcontact.harness.quantities.filled import FILLED, filled_notes
from epcontact.harness.quantities.registry import QUANTITIES, measured
from epcontact.materials.hardness_map import MappedHardness
from epcontact.output.vtk import write_fields
from epcontact.results import Areas, ContactResult, LoadStep
from epcontact.scene import Load, Scene

#: The unit of each quantity in the field data of a .vti.
_UNITS = {quantity.name: quantity.unit for quantity in QUANTITIES.values()}
#: Most points of a grid on which a row has what takes a linear solve on the contact.
_MOST_POINTS = 2**22

#: Called at a load with the scene up to it and the result, which it returns with more
#: quantities.
AtLoad = Callable[[Scene, ContactResult], ContactResult]
Moving = Callable[[float], None]


class TimeUp(EpcontactError):
    """The time limit of a case has passed; no NotConverged, after which smaller steps
    are tried.
    """


def solve_path(
    task: Task, scene: Scene, threads: int, moving: Moving | None = None
) -> ContactResult:
    """Solve a load path; measure and write of every load what the task asks for."""
    j2 = task.case.options[task.method.name].get("law") == "j2"
    mapped, path = () if j2 else task.case.mapped, scene.load.path
    if task.steps is not None:
        shutil.rmtree(
            task.steps, ignore_errors=True
        )  # a longer path may have been there
    fills = task.method.has_fields and scene.surface.filled is not None
    at_load = partial(_shown, task) if task.rows or task.steps or fills else None
    own = [found.value for found in mapped] or [scene.material.hardness] * len(path)
    result = _walked(task, scene, own, threads, at_load, moving)
    known = [{} if math.isinf(cap) or j2 else {"hardness": cap} for cap in own]
    both = zip(result.steps, known, strict=True)
    steps = [
        replace(step, quantities={**step.quantities, **more}) for step, more in both
    ]
    if mapped:
        peaks = itertools.accumulate(path, max)
        low = [
            max(found.interval[0], 1.001 * p)
            for found, p in zip(mapped, peaks, strict=True)
        ]
        high = [found.interval[1] for found in mapped]
        again = partial(_shown, replace(task, steps=None)) if task.rows else None
        soft, hard = (
            _walked(task, scene, end, threads, again, quick=True).steps
            for end in (low, high)
        )
        steps = list(map(_with_hardness_error, steps, soft, hard, mapped))
    for kind, scale in task.case.conductances.items():
        for at, step in enumerate(steps):
            names = [n for n in step.quantities if n.startswith("conductance")]
            made = {f"{kind}_{name}": scale * step.quantities[name] for name in names}
            steps[at] = replace(step, quantities={**step.quantities, **made})
    return replace(
        result, steps=tuple(steps), notes=(*result.notes, *filled_notes(steps))
    )


def _walked(
    task: Task,
    scene: Scene,
    own: Sequence[float],
    threads: int,
    at_load: AtLoad | None = None,
    moving: Moving | None = None,
    *,
    quick: bool = False,
) -> ContactResult:
    """Solve the parts of a path that have one of their `own` hardnesses each; join the
    results.
    """
    path, result = scene.load.path, None
    costs, done = list[Mapping[str, float]](), list[LoadStep]()
    for hardness, group in itertools.groupby(
        zip(own, path, strict=True), key=lambda pair: pair[0]
    ):
        loads = tuple(load for _, load in group)
        material = replace(scene.material, hardness=hardness)
        there = replace(scene, material=material, load=Load(loads))
        if there.load != scene.load and task.method.steps == "output":
            raise InvalidCase(
                "hardness is 'effective' and differs from load to load, but fem follows a path "
                "with one; give one load, a hardness in Pa, or a sweep over load.mean_pressure"
            )
        before, part = len(done) / len(path), len(loads) / len(path)
        share = (
            None if moving is None else lambda s, b=before, p=part: moving(b + p * s)
        )
        result = _part(task, there, threads, tuple(done), at_load, share, quick)
        done += result.steps
        costs.append(result.cost)
    assert result is not None, "a path has a load"
    about = replace(result.provenance, scene=scene.digest)
    return replace(result, steps=tuple(done), provenance=about, cost=_total(costs))


def _total(costs: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the cost of several solves."""
    most = ("unknowns", "peak_memory_bytes")
    return {
        n: (max if n in most else sum)(c.get(n, 0.0) for c in costs) for n in costs[0]
    }


def _part(
    task: Task,
    scene: Scene,
    threads: int,
    before: tuple[LoadStep, ...],
    at_load: AtLoad | None,
    moving: Moving | None,
    quick: bool,
) -> ContactResult:
    """Solve a path of one hardness, which other loads may come before."""
    method, options = task.method, dict(task.case.options[task.method.name])
    steps, spent = list[LoadStep](), 0.0

    def show(now: ContactResult) -> None:
        nonlocal spent
        started = time.perf_counter()
        if at_load is not None:
            there = replace(scene, load=Load(scene.load.path[: len(now.steps)]))
            steps.append(
                at_load(there, replace(now, steps=(*before, *now.steps))).final
            )
        spent += time.perf_counter() - started

    if quick and method.name == "bem":
        options["area_tolerance"] = 1e-4
    if at_load is not None and method.steps:
        options["on_step"] = show
    if task.steps is not None and method.steps == "output":
        options["output"] = task.steps
    if moving is not None and method.steps:
        options["progress"] = lambda share, _: moving(share)
    known, costs, path = (
        tuple[LoadStep, ...](),
        list[dict[str, float]](),
        scene.load.path,
    )
    end, lowered = time.monotonic() + task.case.head.time_limit, None
    outside = (
        method.source or method.requires
    )  # whose pressures are those of a last load alone
    for number in range(1 if outside else len(path), len(path) + 1):
        there = replace(scene, load=Load(path[:number]))
        if method.source:  # its limit is enforced from outside its process
            options |= {"limit": end - time.monotonic(), "before": lowered}
        result = method.solve(there, options, threads)
        if not result.converged:
            raise NotConverged("the result says that it has not converged")
        costs.append({**result.cost})
        known = (*known, *result.steps[len(known) :])
        if outside:  # no later load shows these fields
            answered, own = (
                Answered(there, replace(result, steps=known)),
                {**known[-1].quantities},
            )
            # Of a body that flows by J2 it is the word of the solver alone.
            lowered = (
                None if answered.flows else result.fields.get("plastic_displacement")
            )
            for name in (name for name in task.measured if ".measured_" in name):
                own[name.removeprefix("quantity.")] = measured(name, answered)
            known = (*known[:-1], replace(known[-1], quantities=own))
        result = replace(result, steps=known)
        if "on_step" not in options:
            show(result)  # of its last load alone are there fields
    if "on_step" in options:
        costs[-1]["seconds"] -= spent
    # What the method reports at the end stands, and what was measured at each load is
    # added to it.
    rows = [*result.steps[: len(result.steps) - len(steps)], *steps]
    both = zip(result.steps, rows, strict=True)
    joined = [
        replace(s, quantities={**row.quantities, **s.quantities}) for s, row in both
    ]
    return replace(result, steps=tuple(joined), cost=_total(costs))


def _shown(task: Task, scene: Scene, result: ContactResult) -> ContactResult:
    """Add what a table of loads shows, as far as it is defined; write the fields of a
    load.
    """
    surface = scene.surface
    names = ROW if task.rows and surface.heights.size <= _MOST_POINTS else FILLED
    if surface.filled is None:
        names = tuple(name for name in names if name not in FILLED)
    if names:
        answered, values = Answered(scene, result), dict(result.final.quantities)
        for name in names:
            try:
                values[name.removeprefix("quantity.")] = measured(name, answered)
            except (InvalidCase, NotConverged):  # such as the conductance of a layer
                continue
        final = replace(result.final, quantities=values)
        final = final.with_errors(surface.treatment_errors, "treatment")
        result = replace(result, steps=(*result.steps[:-1], final))
    if task.steps is not None and task.method.steps == "on_step":
        number = len(result.steps) - 1
        write(
            task,
            scene,
            told(task, scene, result),
            task.steps / step_name(number, ".vti"),
        )
        write_collection(
            task.steps / "path.pvd", [step.mean_pressure for step in result.steps]
        )
    return result


def _with_hardness_error(
    step: LoadStep, soft: LoadStep, hard: LoadStep, mapped: MappedHardness
) -> LoadStep:
    """Add what the interval of a hardness is worth: half of what the answers at its
    ends differ.
    """
    kind = "corrected" if "corrected" in step.areas else "raw"
    a, b = (vars(one.areas[kind]) for one in (soft, hard))
    areas = {
        **step.areas,
        "hardness_error": Areas(**{k: abs(a[k] - b[k]) / 2 for k in a}),
    }
    more = {"hardness_error_by_map": mapped.value * mapped.error}
    for name in ("mean_gap", *(row.removeprefix("quantity.") for row in ROW)):
        if "." not in name and all(
            name in one.quantities for one in (step, soft, hard)
        ):
            apart = abs(soft.quantities[name] - hard.quantities[name])
            more[f"{name}_error_by_hardness"] = apart / 2
    return replace(step, areas=areas, quantities={**step.quantities, **more})


def told(task: Task, scene: Scene, result: ContactResult) -> ContactResult:
    """Add to a result what was computed, in words and figures."""
    about = (
        described(scene, task.recipe, task.case.hardness_source) | task.case.two_bodies
    )
    return replace(result, provenance=replace(result.provenance, about=about))


def write(task: Task, scene: Scene, result: ContactResult, path: Any) -> None:
    """Write the fields of a result."""
    attributes = {"case": task.case.id, "size": task.case.size}
    write_fields(
        path, result, scene.surface, attributes, precision=task.precision, units=_UNITS
    )
