"""Results of tasks on disk: one file for each, which a later run finds by its key.

`<output>/<case>/<size>/members/<method>-<surface>.json` holds one result, its key
(scene, size, options, and the sources and libraries of all solvers), a digest of this
content, and the hash of the fields written with it.  A task of the same key is not run
again if the content has that digest and the fields it asks for have that hash.  The
key of a program, such as CalculiX, has the hash of its file.  Any other solver from
outside the package always runs, because its sources are not known here.

While a load path is solved by boundary elements, `<method>-<surface>.loads.npz` holds
the loads that are done, and the plastic displacement from which the next one starts.  A
run that was stopped goes on from there; the file is deleted when the result is saved.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic_core import to_json

from epcontact.errors import OutputError
from epcontact.files import atomic_write, write_json
from epcontact.harness.solving.tasks import Task, peak_path
from epcontact.results import ContactResult, FloatArray, package_versions, plain
from epcontact.scene import Load

#: Rooms of the package that show results or ask for them.  An edit there keeps saved
#: results valid, unless it is in one of `_SOLVING`, which changes numbers.
_SHOWING = {
    "cli",
    "crosscheck",
    "harness",
    "output",
    "pictures",
    "planning",
    "studies",
}
_SOLVING = (
    "crosscheck/model_difference.py",
    "output/vtk.py",
    "harness/methods",
    "harness/quantities",
    "harness/solving",
)
_LIBRARIES = ("epcontact", "numpy", "scipy", "ducc0", "numba", "scikit-fem")


@functools.cache
def sources_digest(package: Path = Path(__file__).parents[2]) -> str:
    """Return the SHA-256 of the source files that can change the numbers of a result.

    Args:
        package: the folder of the package epcontact; fem_check is beside it.
    """
    rooms = {path for path in package.iterdir() if path.name not in _SHOWING}
    rooms.add(package.parent / "fem_check")
    rooms.update(package / name for name in _SOLVING)
    digest = hashlib.sha256()
    for room in sorted(rooms):
        files = [room] if room.suffix == ".py" else sorted(room.rglob("*.py"))
        for file in files:
            digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def software_versions() -> dict[str, str]:
    """Return what can change the numbers of a result, by name: the digest of the
    sources, and the versions of the numerical libraries.
    """
    versions = package_versions()
    libraries = {name: versions[name] for name in _LIBRARIES}
    return {"sources": sources_digest(), **libraries}


def key_of(task: Task) -> str:
    """Return the SHA-256 of everything that the result of a task depends on."""
    content = {
        "scene": task.case.digest(task.recipe),
        "method": task.method.name,
        "options": repr(sorted(task.case.options[task.method.name].items())),
        "columns": sorted(task.case.head.columns),
        "mapped": repr((task.case.mapped, task.case.conductances)),
        "basis": software_versions(),
    }
    if task.method.code_digest:
        content["program"] = task.method.code_digest
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def save_result(task: Task, output: Path, result: ContactResult) -> None:
    """Write the result of a task to its file, whole or not at all.

    Files of fields that belong to an earlier, different result of the task are deleted:
    a reader would take them for those of this result.

    Args:
        task: the task.
        output: the output folder of the run.
        result: its result, with the fields that gates compare.

    Raises:
        OutputError: if the file cannot be written.
    """
    about: dict[str, Any] = {
        "case": task.case.id,
        "size": task.case.size,
        "key": key_of(task),
        "fields_digest": _file_digest(task.fields_file),
        "steps_kept": task.steps_folder is not None,
        "precision": task.precision,
        "measured": task.measured,
        "rows": task.lists_loads,
        "fields": plain(result.fields),
    }
    earlier = read_saved(task.result_path(output))
    same = earlier.get("key") == about["key"]
    if task.fields_file is None and same:
        about["fields_digest"] = earlier.get("fields_digest")
        about["precision"] = earlier.get("precision")
    elif task.fields_file is None:
        with contextlib.suppress(OSError):
            task.fields_path(output).unlink()
    if task.peak_file is None and not same:
        with contextlib.suppress(OSError):
            peak_path(task.fields_path(output)).unlink()
    if task.steps_folder is None and same:
        about["steps_kept"] = bool(earlier.get("steps_kept"))
    elif task.steps_folder is None:
        shutil.rmtree(task.steps_path(output), ignore_errors=True)
    content = about | result.to_json()
    digest = {"digest": _content_digest(content)}
    write_json(task.result_path(output), digest | content)
    delete_loads(task)


# --- the loads of a path that is not solved to its end


class DoneLoads(NamedTuple):
    """The loads of a path that an earlier run has solved.

    Attributes:
        result: its load steps, with all that is measured at each load, and its cost.
        flow: plastic displacement in m on the grid, from which the next load starts;
            None: the path has not fallen.
    """

    result: ContactResult
    flow: FloatArray | None


def save_loads(task: Task, result: ContactResult) -> None:
    """Write the loads of a task that are done to its file, whole or not at all.

    Nothing is written if the folder of the case does not exist, such as on a worker
    that does not see it, or if the file cannot be written: then the loads are solved
    again after an interruption.

    Args:
        task: has a `loads_file`.
        result: the result of the loads that are done, with the fields of the last one.
    """
    file_path = task.loads_file
    if file_path is None or not file_path.parents[1].is_dir():
        return
    path = task.case.load.path[: len(result.steps) + 1]
    content = {"about": _about_loads(task), "result": result.to_json()}
    arrays: dict[str, Any] = {"content": np.frombuffer(to_json(content), np.uint8)}
    if not Load(path).non_decreasing and "plastic_displacement" in result.fields:
        arrays["flow"] = result.fields["plastic_displacement"]
    with (
        contextlib.suppress(OutputError),
        atomic_write(file_path) as temporary,
        temporary.open("wb") as file,
    ):
        np.savez(file, **arrays)


def load_done(task: Task) -> DoneLoads | None:
    """Return the loads of a task that an earlier run has saved.

    Returns None if there are none, if they are damaged, or if their run had another
    scene, other software or other things to measure and to write.
    """
    if task.loads_file is None or not task.loads_file.is_file():
        return None
    try:
        with np.load(task.loads_file) as arrays:
            content = json.loads(arrays["content"].tobytes())
            flow = arrays.get("flow")
        if content["about"] != _about_loads(task):
            return None
        return DoneLoads(ContactResult.from_json(content["result"]), flow)
    except Exception:  # reading a damaged archive may raise anything
        return None


def delete_loads(task: Task) -> None:
    """Delete the file with the loads of a task that are done, if there is one."""
    if task.loads_file is not None:
        with contextlib.suppress(OSError):
            task.loads_file.unlink()


def _about_loads(task: Task) -> dict[str, Any]:
    """Return what the saved loads of a task depend on, in JSON types."""
    return {
        "key": key_of(task),
        "measured": list(task.measured),
        "rows": task.lists_loads,
        "peak": task.peak_file is not None,
        "steps": task.steps_folder is not None,
        "precision": task.precision,
    }


# --- results


def load_saved(task: Task, output: Path) -> ContactResult | None:
    """Return the result of a task that an earlier run saved in the output folder.

    Returns None if there is none, if it or its files were changed, if it lacks
    something that the task asks for, or if the method's code is not the package's.
    """
    if task.method.code_digest is None:
        return None
    content = read_saved(task.result_path(output))
    if content.get("key") != key_of(task):
        return None
    if not (_has_measured(content, task) and _has_files(content, task, output)):
        return None
    try:
        fields = {
            name: np.array(content["fields"][name]) for name in task.compared_fields
        }
        return replace(ContactResult.from_json(content), fields=fields)
    except (ValueError, KeyError, TypeError):
        return None


def _has_measured(content: dict[str, Any], task: Task) -> bool:
    """Return whether a saved result has all quantities that the task asks for.

    `content` is that of the file of the result.
    """
    has_rows = content.get("rows", False) or not task.lists_loads
    return has_rows and set(task.measured) <= set(content.get("measured", ()))


def _has_files(content: dict[str, Any], task: Task, output: Path) -> bool:
    """Return whether the files of fields that the task asks for exist, unchanged and in
    its precision or a better one.

    `content` is that of the file of the saved result, which has the digest of the
    fields.  `output` is the output folder.
    """
    if task.fields_file is not None:
        precise = content.get("precision") in (task.precision, "double")
        digest = content.get("fields_digest")
        if not precise or digest != _file_digest(task.fields_file):
            return False
    if task.peak_file is not None and not task.peak_file.is_file():
        return False
    if task.steps_folder is not None:
        collection = task.steps_path(output) / "path.pvd"
        return content.get("steps_kept") is True and collection.is_file()
    return True


def read_saved(path: Path) -> dict[str, Any]:
    """Return the content of a file that `save_result` wrote, without its digest.

    Returns an empty dictionary if there is no such file, or if it was changed.
    """
    try:
        content = json.loads(path.read_bytes())
        digest = content.pop("digest")
    except (OSError, ValueError, RecursionError, KeyError, TypeError, AttributeError):
        return {}
    return content if digest == _content_digest(content) else {}


def _content_digest(content: dict[str, Any]) -> str:
    """Return the SHA-256 of a saved result's content as JSON, without its digest."""
    return hashlib.sha256(to_json(content)).hexdigest()


def _file_digest(path: Path | None) -> str | None:
    """Return the SHA-256 of a file: "" if it cannot be read, None without a path."""
    if path is None:
        return None
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""
