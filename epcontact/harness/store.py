"""Results on disk: kept one file a task, found again by what made them, summed up by method.

`<output>/<case>/members/<method>-<surface>.json` holds one result and its key: scene, size,
options, solver and the package's own sources, and the hash of the fields written with it.  A task
of the same key need not run again, as long as the fields it asks for are those very ones; one of
a solver that is not the package's always runs, as its sources are not known here.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from epcontact.harness.case import Case
from epcontact.harness.gates import estimate
from epcontact.harness.tasks import Task, measured_by
from epcontact.output.files import write_json
from epcontact.results import ContactResult


@dataclass(frozen=True)
class Answer:
    """What a method said of a case: one result a surface, or the sentence why not."""

    results: tuple[ContactResult, ...] = ()
    labels: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()
    reused: int = 0


@functools.cache
def sources_digest() -> str:
    """SHA-256 of the package's own sources: a result of other sources is not reused."""
    import fem_check

    digest = hashlib.sha256()
    for package in (Path(__file__).parents[1], Path(fem_check.__file__ or "").parent):
        for file in sorted(package.rglob("*.py")):
            digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()


def _key(task: Task) -> str:
    content = {
        "scene": task.case.digest(task.recipe),
        "size": task.case.size,
        "method": task.method,
        "solver": task.solver,
        "options": repr(sorted(task.case.options[task.method].items())),
        "fields": sorted(measured_by(task.case, task.method)),
        "sources": sources_digest(),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _member_path(task: Task, output: Path) -> Path:
    return output / task.case.id / "members" / f"{task.method}-{task.label}.json"


def keep(task: Task, output: Path, result: ContactResult) -> None:
    """Write the result of a task.  Raises OutputError.

    Fields of an earlier, other result would pass for those of this one: they are removed.
    """
    about = {"case": task.case.id, "size": task.case.size, "key": _key(task)}
    fields_digest = _digest(task.fields)
    if task.fields is None:
        earlier = _read_member(task, output)
        if earlier.get("key") == about["key"]:
            fields_digest = earlier.get("fields_digest")
        else:
            with contextlib.suppress(OSError):
                task.fields_path(output).unlink()
    write_json(
        _member_path(task, output), about | {"fields_digest": fields_digest} | result.to_json()
    )


def kept(task: Task, output: Path) -> ContactResult | None:
    """The result of an earlier run of just this task, if it is there and whole."""
    if task.solver:
        return None
    data = _read_member(task, output)
    if data.get("key") != _key(task):
        return None
    if task.fields is not None and data.get("fields_digest") != _digest(task.fields):
        return None
    try:
        return ContactResult.from_json(data)
    except (ValueError, KeyError, TypeError):
        return None


def _read_member(task: Task, output: Path) -> dict[str, Any]:
    """What `keep` wrote of a task, or nothing."""
    try:
        data = json.loads(_member_path(task, output).read_bytes())
    except (OSError, ValueError):
        return {}
    return data if isinstance(data, dict) else {}


def _digest(fields: Path | None) -> str | None:
    """SHA-256 of a file of fields; empty where there is none, None where none was asked for."""
    if fields is None:
        return None
    try:
        with fields.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


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
