"""Solvers from outside the package, in a process of their own and on a copy of the scene.

A solver is named by its source: `module:function`, which maps a Scene to a ContactResult, or a
command with the placeholders {scene} and {result}, see `exchange`.  Whatever it does to its
process, its scene or its machine, the caller gets a checked result or an error that says what
happened.  One process serves all foreign solves of this one until it dies.
"""

from __future__ import annotations

import functools
import importlib
import json
import math
import shlex
import shutil
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from epcontact.errors import InvalidCase, sentence_of
from epcontact.harness.methods.exchange import PLACEHOLDER, answer_of_command
from epcontact.harness.processes import Child, ChildDied
from epcontact.results import ContactResult, plain
from epcontact.scene import Scene

# A checked result as plain data, so that no class of the solver's is needed to read it.
_Plain = tuple[str, dict[str, Any]]


def is_command(source: str) -> bool:
    """Return whether a source is a command with placeholders and not `module:function`."""
    return "{" in source or any(map(str.isspace, source))


def require_solver(source: str) -> None:
    """Raise InvalidCase if a function cannot be imported, or there is no such program."""
    if is_command(source):
        if sorted(match[1] for match in PLACEHOLDER.finditer(source)) != ["result", "scene"]:
            raise InvalidCase(
                f"solver {source}: a command needs the placeholders {{scene}} and {{result}} once "
                "each"
            )
        words = _words(source)
        if shutil.which(words[0]) is None:
            raise InvalidCase(f"solver {source}: there is no program {words[0]!r} to run")
        return
    try:
        refusal = _child().call(_refusal, source)
    except ChildDied as death:
        refusal = f"solver {source} cannot be imported: it {death}"
    if refusal:
        raise InvalidCase(refusal)


def solve(name: str, source: str, scene: Scene, limit: float = math.inf) -> ContactResult:
    """Return the result of a foreign solver, called `name`, on a copy of the scene."""
    try:
        answer = _child().call(_answer, source, scene, limit=limit)
    except ChildDied as death:
        raise InvalidCase(f"solver {source} {death}") from None
    if isinstance(answer, str):
        raise InvalidCase(answer)
    text, fields = answer
    result = ContactResult.from_json(json.loads(text))
    options = dict(result.provenance.options) | {"solver": source}
    provenance = replace(result.provenance, scene=scene.digest, options=options)
    return replace(result, method=name, fields=fields, provenance=provenance)


@functools.cache
def _child() -> Child:
    """Return the process of the foreign solvers."""
    return Child()


# --- in the process of the solver ----------------------------------------------------------------


def _refusal(source: str) -> str:
    """Return why `module:function` cannot be imported; empty if it can."""
    try:
        _imported(source)
    except (Exception, SystemExit) as error:
        reason = sentence_of(error)
        return f"solver {source} cannot be imported ({reason}); give package.module:function"
    return ""


def _imported(source: str) -> Callable[[Scene], Any]:
    module_name, _, attribute = source.partition(":")
    function: Callable[[Scene], Any] = getattr(importlib.import_module(module_name), attribute)
    return function


def _answer(source: str, scene: Scene) -> _Plain | str:
    """Return the checked result of a solver, or the sentence that says why there is none."""
    if refusal := "" if is_command(source) else _refusal(source):
        return refusal
    # What pickle copies is writable: these heights are read-only again.
    scene = replace(scene, surface=replace(scene.surface))
    verb = "raised"
    try:
        if is_command(source):
            verb = "returned"
            return _checked(answer_of_command(_words(source), scene), scene)
        result = _imported(source)(scene)
        verb = "returned"
        return _checked(result, scene)
    except (Exception, SystemExit) as error:
        return f"solver {source} {verb} {sentence_of(error)}"


def _words(source: str) -> list[str]:
    try:
        return shlex.split(source)
    except ValueError as error:
        raise InvalidCase(f"solver {source}: is no command ({error})") from None


def _checked(result: Any, scene: Scene) -> _Plain:
    """Return a result as plain data.  Raises InvalidCase if gates could not read it."""
    if not isinstance(result, ContactResult):
        raise InvalidCase(f"no epcontact.ContactResult but {type(result).__name__!r}")
    for kind in ("raw", "corrected"):
        if kind not in result.final.areas:
            raise InvalidCase(f"no areas[{kind!r}] of its last load step")
    fields = {name: np.array(values) for name, values in result.fields.items()}
    for name, values in fields.items():
        if values.shape != scene.surface.shape:
            raise InvalidCase(
                f"the field {name} of shape {values.shape}, but the scene's grid is "
                f"{scene.surface.shape}"
            )
        if values.dtype.kind not in "biuf":
            raise InvalidCase(f"the field {name} of type {values.dtype}, but numbers are needed")
    try:
        data = plain(replace(result, fields={}).to_json())
        ContactResult.from_json(data)
        return json.dumps(data, allow_nan=False), fields
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidCase(f"a ContactResult that cannot be read ({sentence_of(error)})") from None
