"""Tasks and their results on disk: one file for each result, found again by its key.

`<output>/<case>/<size>/members/<method>-<surface>.json` holds one result, its key (scene, size,
options, and the sources and libraries that it rests on), a digest of this content, and the hash of
the fields written with it.  A task of the same key is not run again if the content has that digest
and the fields it asks for have that hash.  A solver from outside the package always runs, because
its sources are not known here.
"""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import json
import math
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic_core import to_json

from epcontact.files import write_json
from epcontact.harness.answers.foundation import Foundation, foundation
from epcontact.harness.case_files.case import Case
from epcontact.harness.gates.statistics import estimate, standard_deviation
from epcontact.harness.methods.memory import of_task
from epcontact.harness.methods.registry import Method
from epcontact.harness.quantities.registry import QUANTITIES
from epcontact.output.vtk import Precision
from epcontact.results import ContactResult, package_versions
from epcontact.surfaces import Recipe


@dataclass(frozen=True, eq=False)
class Task:
    """One solve: a method on one surface of a case.

    Attributes:
        case: the case with its recipes, which are small.
        method: the method that solves it.
        member: index of the recipe in the case.
        label: the name of the surface in files.
        fields: file to write the fields to; None if they are not kept.
        steps: folder for the files of every load; None if they are not kept.
        quantities: what is measured beside the quantities of gates.
        words: what a reader calls it; the label where it is empty.
        precision: of the numbers in the files of fields, at least.
    """

    case: Case
    method: Method
    member: int
    label: str
    fields: Path | None = None
    steps: Path | None = None
    quantities: tuple[str, ...] = ()
    words: str = ""
    precision: Precision = "single"

    @property
    def recipe(self) -> Recipe:
        """The recipe of the surface."""
        return self.case.recipes[self.member]

    @property
    def measured(self) -> tuple[str, ...]:
        """The quantities that the harness measures on the result, sorted."""
        names = {name for name in self.quantities if QUANTITIES[name].measure}
        for gate in self.case.gates:
            if self.method.name not in (gate.of, gate.against):
                continue
            if gate.norm == "l2":
                names.add(f"l2.{gate.against}.{gate.quantity.removeprefix('field.')}")
            elif gate.quantity in QUANTITIES and QUANTITIES[gate.quantity].measure:
                names.add(gate.quantity)
        return tuple(sorted(names))

    @property
    def memory(self) -> float:
        """The estimated bytes of a process that solves it."""
        scene = (self.case.material, self.case.body, self.case.load)
        return of_task(self.method.memory, self.recipe, scene, self.case.options[self.method.name])

    def fields_path(self, output: Path) -> Path:
        """Return the file for its fields: `<method>[-<surface>].vti` in the case's folder."""
        name = self.method.name + ("" if self.label == "single" else f"-{self.label}")
        return self.case.folder(output) / f"{name}.vti"

    def steps_path(self, output: Path) -> Path:
        """Return the folder for the files of every load, with a collection path.pvd."""
        fields = self.fields_path(output)
        return fields.with_name(f"{fields.stem}-steps")

    def result_path(self, output: Path) -> Path:
        """Return the file for its result."""
        return self.case.folder(output) / "members" / f"{self.method.name}-{self.label}.json"


# Solutions of one surface, wherever it is on the grid, agree to the tolerance of their solver.
_SAME = 1e-6


@dataclass(frozen=True)
class Answer:
    """The answer of a method to a case: one result for each surface, and sentences on failures."""

    results: tuple[ContactResult, ...] = ()
    labels: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()
    reused: int = 0

    @property
    def twins(self) -> tuple[str, str] | None:
        """The labels of two surfaces with the same answer, which no ensemble may have.

        Two different surfaces may have the same areas and energies, but not all figures of their
        single points: answers without a largest pressure are not compared.
        """
        for (label, one), (other, two) in itertools.combinations(
            zip(self.labels, self.results, strict=True), 2
        ):
            a, b = one.final.quantities, two.final.quantities
            known = "largest_pressure" in a and a.keys() == b.keys()
            if known and all(math.isclose(a[k], b[k], rel_tol=_SAME) for k in a):
                return label, other
        return None


#: What every result rests on beside its method: the scene, and what composes and describes a task.
_SCENE = ("epcontact.surfaces", "epcontact.scene")
_FRAME = (
    "epcontact.harness.answers.solve",
    "epcontact.harness.methods.registry",
    "epcontact.harness.answers.description",
)
_MEASURES = "epcontact.harness.quantities"
#: It solves by other methods, and few quantities need it.
_MODEL = "epcontact.harness.quantities.model_difference"
_MACHINE = "epcontact.machine"  # cores, memory and the folder of kernels: no numbers


def rests_on(task: Task) -> Foundation:
    """Return the sources and the libraries behind the result of a task."""
    roots = (*task.method.modules, *_SCENE)
    names = [name for name in task.measured if name in QUANTITIES]
    model = any("J2 flow" in QUANTITIES[name].needs for name in names)
    if task.measured:
        roots += (_MEASURES,)
    return foundation(roots, _FRAME, (_MACHINE,) if model else (_MACHINE, _MODEL))


def basis(task: Task) -> dict[str, str]:
    """Return the digest of the sources of a task, and the versions of its libraries, by name."""
    base, versions = rests_on(task), package_versions()
    return {"sources": base.digest} | {n: versions[n] for n in ("epcontact", *base.libraries)}


def key_of(task: Task) -> str:
    """Return the digest of all that a result depends on."""
    content = {
        "scene": task.case.digest(task.recipe),
        "size": task.case.size,
        "method": task.method.name,
        "options": repr(sorted(task.case.options[task.method.name].items())),
        "measured": task.measured,
        "basis": basis(task),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def keep(task: Task, output: Path, result: ContactResult) -> None:
    """Write the result of a task.  Raises OutputError.

    Fields of an earlier, different result are removed, because they would pass for this one's.
    """
    about = {"case": task.case.id, "size": task.case.size, "key": key_of(task)}
    earlier = read_member(task.result_path(output))
    same = earlier.get("key") == about["key"]
    fields_digest, steps = _digest(task.fields), task.steps is not None
    precision: Any = task.precision
    if task.fields is None and same:
        fields_digest, precision = earlier.get("fields_digest"), earlier.get("precision")
    elif task.fields is None:
        with contextlib.suppress(OSError):
            task.fields_path(output).unlink()
    if not steps and same:
        steps = bool(earlier.get("steps_kept"))
    elif not steps:
        shutil.rmtree(task.steps_path(output), ignore_errors=True)
    files = {"fields_digest": fields_digest, "steps_kept": steps, "precision": precision}
    data = about | files | result.to_json()
    write_json(task.result_path(output), {"digest": _content_digest(data)} | data)


def kept(task: Task, output: Path) -> ContactResult | None:
    """Return the result of an earlier run of the same task, if it is there as it was written."""
    if task.method.foreign:
        return None
    data = read_member(task.result_path(output))
    if data.get("key") != key_of(task):
        return None
    precise = data.get("precision") in (task.precision, "double")
    if task.fields and not (precise and data.get("fields_digest") == _digest(task.fields)):
        return None
    written = data.get("steps_kept") is True and (task.steps_path(output) / "path.pvd").is_file()
    if task.steps is not None and not written:
        return None
    try:
        return ContactResult.from_json(data)
    except (ValueError, KeyError, TypeError):
        return None


def read_member(path: Path) -> dict[str, Any]:
    """Read the file that `keep` wrote for a task; empty if there is none, or another content."""
    try:
        data = json.loads(path.read_bytes())
        written = data.pop("digest")
    except (OSError, ValueError, RecursionError, KeyError, TypeError, AttributeError):
        return {}
    return data if written == _content_digest(data) else {}


def _content_digest(data: dict[str, Any]) -> str:
    return hashlib.sha256(to_json(data)).hexdigest()


def _digest(fields: Path | None) -> str | None:
    """Return the SHA-256 of a file of fields; empty if it is absent, None without a path."""
    if fields is None:
        return None
    try:
        with fields.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


def summary(case: Case, answer: Answer) -> dict[str, Any]:
    """Return a method's answer as JSON: means over surfaces, their scatter, every member."""
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
    return {
        "mean": e.mean,
        "standard_deviation": standard_deviation(values),
        "half_width_95": e.half_width,
    }
