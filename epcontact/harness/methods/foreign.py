"""Solvers from outside the package, in a process of their own and on a copy of the
scene.

A solver is named by its source: `module:function`, which maps a Scene to a
ContactResult, or a command in any language, 'command {scene} {result}'.  Whatever it
does to its scene, its machine or its process, of which words and numbers alone are
read, the caller gets a checked result or an error that says what happened.  A process
serves all solves of one solver until it dies.

A command reads one text file and writes another, in the units and conventions of
`help(epcontact)`.

The scene is a text of one item a line, always in this order:

    epcontact-scene 1
    dimensions 2                 1 for a line
    shape 64 64                  points nx ny; ny is 1 for a line
    periods 1e-3 1e-3            lengths Lx Ly; Ly is 0 for a line
    young_modulus 1e11
    poisson_ratio 0.3
    hardness 6e9                 largest contact pressure; inf: elastic
    yield_stress inf             of the J2 solid; inf: elastic
    body half_space              or bonded_layer, sliding_layer
    depth inf                    of a layer
    loads 2                      number of mean pressures, and then each of them
    4e8
    5e8
    heights                      nx*ny numbers, one a line, [0,0] [0,1] ... [0,ny-1] [1,0] ...

The result is a text of words and numbers, separated by blanks or line ends, in any
order:

    epcontact-result 1
    converged 1                  or 0, which is an error: the result is not judged
    residual 1e-9                optional: what decided it, dimensionless, from 0 up to 1
    pressure                     and then nx*ny numbers at the last load, ordered as the heights
    gap                          optional, the same; or displacement

Fortran's numbers are read, too (5.0D+08, 1.0-120, T).  Of any solver that gives a
pressure, this process computes what follows from it and, where they are given, from gap
and displacement.  A solver is asked for each load of a path, as the last one of a
scene, as fields are those of one.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import json
import math
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from epcontact import results
from epcontact.errors import InvalidCase, NotConverged, sentence_of
from epcontact.harness.processes import Child, ChildDied, death_of
from epcontact.harness.quantities.registry import QUANTITIES, scalar_quantities
from epcontact.results import (
    Areas,
    ContactResult,
    FloatArray,
    LoadStep,
    Provenance,
    plain,
)
from epcontact.scene import Scene

#: What a command has in the place of the files.
PLACEHOLDER = re.compile(r"\{(scene|result)\}")
_EXPONENT = re.compile(r"(?<=[\d.])(?:[dD]|(?=[+-]))")  # of Fortran's double precision
_LOGICAL = {"T": "1", "F": "0"}
_ARRAYS, _NUMBERS = ("pressure", "gap", "displacement"), ("converged", "residual")


def is_command(source: str) -> bool:
    """Return whether a source is a command with placeholders and not
    `module:function`.
    """
    return "{" in source or any(map(str.isspace, source))


def require_solver(source: str) -> None:
    """Raise InvalidCase if a function cannot be imported, or there is no such
    program.
    """
    if not is_command(source):
        _asked(source, None)
    elif sorted(match[1] for match in PLACEHOLDER.finditer(source)) != [
        "result",
        "scene",
    ]:
        needed = "the placeholders {scene} and {result} once each"
        raise InvalidCase(f"solver {source}: a command needs {needed}")
    elif shutil.which(program := _words(source)[0]) is None:
        raise InvalidCase(f"solver {source}: there is no program {program!r} to run")


def solve(
    name: str,
    source: str,
    scene: Scene,
    limit: float = math.inf,
    before: FloatArray | None = None,
) -> ContactResult:
    """Return the result of a foreign solver, called `name`, at the last load of a copy
    of the scene; before: how far the load before has left the surface lowered, in m.
    """
    answer, said = (
        _asked(source, scene, limit),
        "a ContactResult that cannot be read ({})",
    )
    try:
        data = json.loads(answer[: (end := answer.index(b"\n") + 1)])
        names, numbers = data["fields"], np.frombuffer(memoryview(answer)[end:]).copy()
        fields = dict(
            zip(names, numbers.reshape(len(names), *scene.surface.shape), strict=True)
        )
        result, said = replace(ContactResult.from_json(data), fields=fields), "{}"
        result = _checked(result, scene, before)
    except (
        ArithmeticError,
        AttributeError,
        LookupError,
        RuntimeError,
        TypeError,
        ValueError,
    ) as e:
        raise InvalidCase(
            f"solver {source} returned {said.format(sentence_of(e))}"
        ) from None
    options = {**result.provenance.options, "solver": source}
    provenance = replace(result.provenance, scene=scene.digest, options=options)
    return replace(result, method=name, provenance=provenance)


@functools.cache
def _child(source: str) -> Child:
    """Return the process of a solver."""
    return Child(plain=True)


def _asked(source: str, scene: Scene | None, limit: float = math.inf) -> bytes:
    """Return what `_answer` does in the process of a solver; raises InvalidCase if it
    says why.
    """
    try:
        answer = _child(source).call(_answer, source, scene, limit=limit)
    except ChildDied as end:
        what = "" if scene else "cannot be imported: it "
        raise InvalidCase(f"solver {source} {what}{end}") from None
    if not answer.startswith(b"{"):
        raise InvalidCase(answer.decode(errors="replace"))
    return answer


def _checked(result: ContactResult, scene: Scene, before: Any = None) -> ContactResult:
    """Return a result with what follows from its pressures, or raise what is wrong with
    it.
    """
    loads, path = [step.mean_pressure for step in result.steps], scene.load.path
    if loads != [*path]:
        raise InvalidCase(
            f"load steps at {loads} Pa, but the scene has loads at {[*path]} Pa"
        )
    _require_solved(result.converged, result.final.residuals, result.cost)
    for name in result.fields:
        if not (isinstance(name, str) and re.fullmatch(r"[\w .-]+", name)):
            raise InvalidCase(
                f"a field named {name!r}, but names are letters, digits, '.' and '-'"
            )
    if "pressure" in result.fields:
        return _by_its_pressures(result, scene, before)
    if missing := sorted({"raw", "corrected"} - result.final.areas.keys()):
        raise InvalidCase(
            f"no pressure and no areas[{missing[0]!r}] of its last load step"
        )
    areas = {
        k: a for k, a in result.final.areas.items() if k != "error"
    }  # no unchecked claim
    result = replace(
        result, steps=(*result.steps[:-1], replace(result.final, areas=areas))
    )
    return _told(result, scalar_quantities(result))


def _require_solved(
    converged: Any, residuals: Mapping[str, Any], cost: Any = None
) -> None:
    """Raise if a solver says that it has not converged, or nothing that can be
    understood.
    """
    for what, most, given in (
        ("residuals", 1, residuals),
        ("costs", math.inf, cost or {}),
    ):
        for name, v in given.items():
            if not 0 <= v < most:
                raise InvalidCase(
                    f"{name} {v!s:.40}, but {what} are numbers from 0 up to {most}"
                )
    if converged not in (0, 1):
        raise InvalidCase(f"converged {converged!s:.40}, but it is 0 or 1")
    if not converged:
        raise NotConverged("a result that has not converged")


def _told(result: ContactResult, names: Iterable[str]) -> ContactResult:
    """Add the note that figures are a solver's word."""
    note = f"{', '.join(sorted(names))}: the solver's word, which nothing here checks"
    return replace(result, notes=(*result.notes, *[note][: len({*names})]))


def _by_its_pressures(
    result: ContactResult, scene: Scene, before: Any = None
) -> ContactResult:
    """Return a result with what follows from its pressures.  Of other figures that the
    package knows, it keeps the word only of a body that flows by J2, as its surface
    does not show them.
    """
    from epcontact.harness.methods.peers import result_of  # loads solvers

    flows = result.provenance.options.get("law") == "j2"  # no cap bounds its pressures
    found = result_of(scene, result.fields, result.method, before=before, flows=flows)
    areas, known, fields = (
        dict(found.final.areas),
        found.final.quantities,
        dict(result.fields),
    )
    if (
        flows and "state" in fields
    ):  # the pressures do not show which of the contact has flowed
        kept = 1 - float((fields["state"] == results.PLASTIC).mean()) / (
            areas["raw"].total or 1.0
        )
        areas = {
            k: Areas(a.total, kept * a.total, a.total * (1 - kept))
            for k, a in areas.items()
        }
    own = {
        name: value
        for name, value in result.final.quantities.items()
        if (named := QUANTITIES.get(f"quantity.{name}")) is None
        or (flows and not named.measure)
    }
    residuals = {**result.final.residuals, **found.final.residuals}
    final = replace(
        result.final, areas=areas, residuals=residuals, quantities={**own, **known}
    )
    if not flows:
        lowered = {"plastic_displacement": found.fields["plastic_displacement"]}
        fields = {**found.fields, **fields, **lowered}
    steps, distribution = (*found.steps[:-1], final), found.distribution
    result = replace(result, steps=steps, distribution=distribution, fields=fields)
    return _told(result, own.keys() - known.keys())


# --- in the process of the solver
# ----------------------------------------------------------------


def _answer(source: str, scene: Scene | None) -> bytes:
    """Return what a solver says as plain data, as it may have changed all that computes
    in its process: a line of JSON and the numbers of its fields, or the sentence that
    says why there is no result.  Without a scene a function is only imported.
    """
    said, solver = "cannot be imported ({}); give package.module:function", None
    try:
        if not is_command(source):
            module, _, name = source.partition(":")
            solver = getattr(importlib.import_module(module), name)
        if scene is None:
            return b"{}"
        scene = replace(
            scene, surface=replace(scene.surface)
        )  # heights are read-only again
        said = "raised {}" if solver else "returned {}"
        result = solver(scene) if solver else answer_of_command(_words(source), scene)
        said, shape = "returned {}", scene.surface.shape
        if not isinstance(result, ContactResult):
            raise InvalidCase(
                f"no epcontact.ContactResult but {type(result).__name__!r}"
            )
        fields = {name: np.asarray(values) for name, values in result.fields.items()}
        for name, values in fields.items():
            wrong = f"the field {name} of"
            if values.shape != shape:
                raise InvalidCase(
                    f"{wrong} shape {values.shape}, but the scene's grid is {shape}"
                )
            if values.dtype.kind not in "biuf":
                raise InvalidCase(
                    f"{wrong} type {values.dtype}, but numbers are needed"
                )
        said = "returned a ContactResult that cannot be read ({})"
        head = json.dumps(
            plain(result.to_json()) | {"fields": [*fields]}, allow_nan=False
        )
        numbers = (values.astype(np.float64).tobytes() for values in fields.values())
        return b"".join((head.encode(), b"\n", *numbers))
    except (Exception, SystemExit) as error:
        return f"solver {source} {said.format(sentence_of(error))}".encode()


def _words(source: str) -> list[str]:
    try:
        return shlex.split(source)
    except ValueError as error:
        raise InvalidCase(f"solver {source}: is no command ({error})") from None


# --- commands
# ------------------------------------------------------------------------------------


def answer_of_command(words: Sequence[str], scene: Scene) -> ContactResult:
    """Return the fields that a program, given by its words, has for a scene, as a
    result.
    """
    with tempfile.TemporaryDirectory(prefix="epcontact-") as name:
        given, written = Path(name) / "scene.txt", Path(name) / "result.txt"
        given.write_text(scene_text(scene), encoding="utf-8")
        files = {"scene": str(given), "result": str(written)}
        command = [
            PLACEHOLDER.sub(lambda match: files[match[1]], word) for word in words
        ]
        started = time.perf_counter()
        done = subprocess.run(command, check=False, stderr=subprocess.PIPE)
        cost = {
            "seconds": time.perf_counter() - started,
            "unknowns": scene.surface.heights.size,
        }
        said = done.stderr.decode(errors="replace")
        with contextlib.suppress(OSError):  # that nobody can read it there is no error
            sys.stderr.write(said)
        if done.returncode:
            last = f"; it said: {said.strip().splitlines()[-1]}" if said.strip() else ""
            raise InvalidCase(f"a command that {death_of(done.returncode)}{last}")
        if not written.is_file():
            raise InvalidCase(
                "a command that ended with exit code 0 and wrote no result"
            )
        found = result_of_text(
            written.read_text("utf-8", "replace"), scene.surface.shape
        )
    steps = tuple(LoadStep(load, {}) for load in scene.load.path)
    origin, notes = Provenance(scene.digest, scene.surface.seed), scene.surface.notes
    fields = {name: found[name] for name in _ARRAYS if name in found}
    notes = (
        *notes,
        f"the pressure is {words[0]}'s, everything else follows from it here",
    )
    return ContactResult(words[0], steps, origin, fields=fields, cost=cost, notes=notes)


def scene_text(scene: Scene) -> str:
    """Return a scene as text; floats have the digits that make them exact."""
    surface, material, body = scene.surface, scene.material, scene.body
    strengths = ("young_modulus", "poisson_ratio", "hardness", "yield_stress")
    rows = [
        "epcontact-scene 1",
        f"dimensions {len(surface.shape)}",
        "shape {} {}".format(*surface.shape, 1),
        "periods {} {}".format(*surface.periods, 0.0),
        *(f"{name} {getattr(material, name)}" for name in strengths),
        f"body {body.kind}",
        f"depth {body.depth}",
        f"loads {len(scene.load.path)}",
        *map(repr, scene.load.path),
        "heights",
        *map(repr, surface.heights.ravel().tolist()),
    ]
    return "\n".join(rows) + "\n"


def result_of_text(text: str, shape: tuple[int, ...]) -> dict[str, FloatArray]:
    """Read the text of a result."""
    words, at = text.split(), 2
    found: dict[str, FloatArray] = {}
    if words[:2] != ["epcontact-result", "1"]:
        raise InvalidCase("a file that does not begin with 'epcontact-result 1'")
    while at < len(words):
        name = words[at]
        if name not in (*_ARRAYS, *_NUMBERS):
            known = ", ".join((*_NUMBERS, *_ARRAYS))
            raise InvalidCase(
                f"a file with {name!r:.40} in the place of one of {known}"
            )
        form = shape if name in _ARRAYS else ()
        end = at + 1 + (count := math.prod(form))
        if name in found:
            raise InvalidCase(f"a file with {name!r} twice")
        numbers = [
            _LOGICAL.get(w) or _EXPONENT.sub("e", w) for w in words[at + 1 : end]
        ]
        try:
            found[name] = np.array(numbers, dtype=np.float64).reshape(form)
        except ValueError:
            raise InvalidCase(
                f"a file with fewer than {count} numbers after {name!r}"
            ) from None
        at = end
    for name in ("converged", "pressure"):
        if name not in found:
            raise InvalidCase(f"a file without {name!r}")
    said = {name: float(found[name]) for name in _NUMBERS if name in found}
    _require_solved(said.pop("converged"), said)
    return found
