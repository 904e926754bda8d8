"""Solvers from outside the package, in a process of their own and on a copy of the
scene.

A solver is named by its source: `module:function`, which maps a Scene to a
ContactResult, or a command in any language, 'command {scene} {result}'.  Whatever it
does to its scene or its process, the caller gets a checked result or an error that says
what happened.  A process serves all solves of one solver until it dies.

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
    heights                      nx*ny numbers: [0,0] [0,1] ... [0,ny-1] [1,0] ...

The result is a text of words and numbers, separated by blanks or line ends, in any
order:

    epcontact-result 1
    converged 1                  or 0, which is an error: the result is not judged
    residual 1e-9                optional: what decided it, without unit, 0 to 1
    pressure                     and then nx*ny numbers, ordered as the heights
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
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from epcontact import results
from epcontact.errors import (
    InvalidCase,
    NotConverged,
    place_of,
    sentence_of,
    without_controls,
)
from epcontact.harness.quantities.registry import QUANTITIES, scalar_quantities
from epcontact.harness.workers import Worker, WorkerDied
from epcontact.machine import describe_death
from epcontact.results import (
    Areas,
    ContactResult,
    FloatArray,
    LoadStep,
    Provenance,
    plain,
)
from epcontact.scene import Scene

#: Lines of a traceback that the message on an error of a solver has.
_PLACES = 2
#: What a command has in the place of the files.
PLACEHOLDER = re.compile(r"\{(scene|result)\}")
_EXPONENT = re.compile(r"(?<=[\d.])(?:[dD]|(?=[+-]))")  # of Fortran's double precision
_LOGICAL = {"T": "1", "F": "0"}
#: What the checks of a result raise that holds something else than numbers.
_MISTAKES = (
    ArithmeticError,
    AttributeError,
    LookupError,
    RuntimeError,
    TypeError,
    ValueError,
)
_ARRAYS, _NUMBERS = ("pressure", "gap", "displacement"), ("converged", "residual")


def is_command(source: str) -> bool:
    """Return whether the source of a solver is a command and not `module:function`.

    A command contains a blank or a brace, as in "./solver {scene} {result}".
    """
    return "{" in source or any(map(str.isspace, source))


def require_solver(source: str) -> None:
    """Check that a solver exists.

    Raises InvalidCase if its function cannot be imported, if its program is not found,
    or if its command does not contain `{scene}` and `{result}` once each.

    Args:
        source: `module:function` or a command.
    """
    if not is_command(source):
        _ask(source, None)
        return
    placeholders = [match[1] for match in PLACEHOLDER.finditer(source)]
    if sorted(placeholders) != ["result", "scene"]:
        needed = "the placeholders {scene} and {result} once each"
        raise InvalidCase(f"solver {source}: a command needs {needed}")
    program = _words(source)[0]
    if shutil.which(program) is None:
        raise InvalidCase(f"solver {source}: there is no program {program!r} to run")


def solve(
    name: str,
    source: str,
    scene: Scene,
    limit: float = math.inf,
    before: FloatArray | None = None,
) -> ContactResult:
    """Return the checked result of a foreign solver at the last load of a scene.

    Args:
        name: the name of the solver in results.
        source: its `module:function` or command.
        scene: the solver gets a copy of it.
        limit: seconds after which the process of the solver is ended.
        before: how far the load before has left the surface lowered, in m; None: by
            nothing.

    Raises:
        InvalidCase: if the process dies, or the result is wrong or not converged.
    """
    result = _ask(source, scene, limit)
    assert result is not None, "a solver that has a scene answers with a result"
    try:
        result = _checked(result, scene, before)
    except _MISTAKES as error:
        sentence = sentence_of(error)
        raise InvalidCase(f"solver {source} returned {sentence}") from None
    options = {**result.provenance.options, "solver": source}
    provenance = replace(result.provenance, scene=scene.digest, options=options)
    return replace(result, method=name, provenance=provenance)


@functools.cache
def _worker(source: str) -> Worker:
    """Return the worker whose process runs the solver of this source; always the same
    one, so that its module is imported once.
    """
    return Worker()


def _ask(
    source: str, scene: Scene | None, limit: float = math.inf
) -> ContactResult | None:
    """Call a solver in its own process and return its unchecked result.

    Args:
        source: `module:function` or a command.
        scene: the scene; None: only import the function, and return None.
        limit: seconds after which the process is ended.

    Raises:
        InvalidCase: if the process ends, exceeds the limit, or has no result.
    """
    try:
        answer = _worker(source).call(_solve_here, source, scene, limit=limit)
    except WorkerDied as death:
        what = "" if scene else "cannot be imported: it "
        raise InvalidCase(f"solver {source} {what}{death}") from None
    if isinstance(answer, str):
        raise InvalidCase(answer)
    return answer


def _checked(
    result: ContactResult, scene: Scene, before: FloatArray | None = None
) -> ContactResult:
    """Return a solver's result with the values that follow from its pressures.

    A result without pressures keeps its areas and other quantities, with a note that
    nothing checks them.

    Args:
        result: what the solver returned.
        scene: the scene that it was given.
        before: how far the earlier loads have lowered the surface by flow, in m on the
            grid; None: by nothing.

    Raises:
        InvalidCase: if the loads, the fields, the residuals or the areas are wrong.
        NotConverged: if the solver reports that it has not converged.
    """
    loads = [step.mean_pressure for step in result.steps]
    path = list(scene.load.path)
    if loads != path:
        raise InvalidCase(
            f"load steps at {loads} Pa, but the scene has loads at {path} Pa"
        )
    _require_solved(result.converged, result.final.residuals, result.cost)
    for name in result.fields:
        if not (isinstance(name, str) and re.fullmatch(r"[\w .-]+", name)):
            raise InvalidCase(
                f"a field named {name!r}, but names are letters, digits, '.' and '-'"
            )
    if "pressure" in result.fields:
        return _by_its_pressures(result, scene, before)
    missing = sorted({"raw", "corrected"} - result.final.areas.keys())
    if missing:
        raise InvalidCase(
            f"no pressure and no areas[{missing[0]!r}] of its last load step"
        )
    areas = dict(result.final.areas)
    areas.pop("error", None)  # nothing here checks its error estimate
    final = replace(result.final, areas=areas)
    result = replace(result, steps=(*result.steps[:-1], final))
    return _with_note(result, list(scalar_quantities(result)))


def _require_solved(
    converged: Any, residuals: Mapping[str, Any], cost: Any = None
) -> None:
    """Check the numbers that a solver reports of its solve.

    Args:
        converged: what the solver says: 0 or 1.
        residuals: must be from 0 up to 1.
        cost: its numbers must not be negative; None: there is none.

    Raises:
        InvalidCase: if one is no such number.
        NotConverged: if the solver has not converged.
    """
    for what, limit, given in (
        ("residuals", 1, residuals),
        ("costs", math.inf, cost or {}),
    ):
        for name, value in given.items():
            if not 0 <= value < limit:
                raise InvalidCase(
                    f"{name} {value!s:.40}, but {what} are numbers from 0 up to {limit}"
                )
    if converged not in (0, 1):
        raise InvalidCase(f"converged {converged!s:.40}, but it is 0 or 1")
    if not converged:
        raise NotConverged("a result that has not converged")


def _with_note(result: ContactResult, names: Collection[str]) -> ContactResult:
    """Return a copy of a result with a note that some of its quantities are unchecked.

    `names` are the names of these quantities; without any, the result is unchanged.
    """
    if not names:
        return result
    note = f"{', '.join(sorted(names))}: the solver's word, which nothing here checks"
    return replace(result, notes=(*result.notes, note))


def _by_its_pressures(
    result: ContactResult, scene: Scene, before: FloatArray | None = None
) -> ContactResult:
    """Return a result with the areas, quantities and fields that follow from its
    pressures.

    Quantities that the solver reports are kept only if the package cannot compute them:
    unlisted ones, and for J2 flow those that pressures do not show.  A note lists them.
    Raw areas and quantities that the package computes are kept as "reported_..."; the
    quantities `measured_areas` and `measured_figures` compare them with the fields.

    Args:
        result: the result of the solver, with the field "pressure" in Pa.
        scene: the scene that was solved.
        before: how far the earlier loads have lowered the surface by flow, in m on the
            grid; None: by nothing.
    """
    from epcontact.peers.pressure_result import result_of_pressures  # loads solvers

    flows = result.provenance.options.get("law") == "j2"  # no cap bounds its pressures
    computed = result_of_pressures(
        scene, result.fields, result.method, before=before, flows=flows
    )
    areas = dict(computed.final.areas)
    if flows and "state" in result.fields:
        areas = _with_flowing_part(areas, result.fields["state"])
    unchecked = {}
    for name, value in result.final.quantities.items():
        known = QUANTITIES.get(f"quantity.{name}")
        if known is None or (flows and not known.measure):
            unchecked[name] = value
    quantities = computed.final.quantities
    reported = {
        f"reported_{name}": value
        for name, value in result.final.quantities.items()
        if name in quantities
    }
    if "raw" in result.final.areas:
        for part, area in vars(result.final.areas["raw"]).items():
            reported[f"reported_{part}_area"] = area
    final = replace(
        result.final,
        areas=areas,
        residuals={**result.final.residuals, **computed.final.residuals},
        quantities={**unchecked, **quantities, **reported},
    )
    fields = dict(result.fields)
    if not flows:
        lowered = computed.fields["plastic_displacement"]
        fields = {**computed.fields, **fields, "plastic_displacement": lowered}
    result = replace(
        result,
        steps=(*computed.steps[:-1], final),
        distribution=computed.distribution,
        fields=fields,
    )
    return _with_note(result, unchecked.keys() - quantities.keys())


def _with_flowing_part(
    areas: Mapping[str, Areas], state: FloatArray
) -> dict[str, Areas]:
    """Return areas that are divided into elastic and plastic by the reported states.

    Pressures of J2 flow do not show which part of the contact has flowed.

    Args:
        areas: the areas of each kind, such as "raw", as fractions of the nominal area.
        state: APART, ELASTIC or PLASTIC at each grid point.
    """
    plastic = float((state == results.PLASTIC).mean())
    elastic_part = 1 - plastic / (areas["raw"].total or 1.0)
    divided = {}
    for kind, area in areas.items():
        elastic = elastic_part * area.total
        flowed = area.total * (1 - elastic_part)
        divided[kind] = Areas(area.total, elastic, flowed)
    return divided


# --- in the process of the solver


def _solve_here(source: str, scene: Scene | None) -> ContactResult | str | None:
    """Call a solver in this process, which is its own, and return its result.

    Args:
        source: `module:function` or a command.
        scene: the scene; None: the function is only imported.

    Returns:
        The result, with plain numbers, words and float arrays on the grid; None without
        a scene; or, after any error, the sentence that says what went wrong.  A solver
        may have changed anything in this process, so that the caller checks its result
        again.
    """
    doing = "cannot be imported ({}{}); give package.module:function"
    try:
        solver = None
        if not is_command(source):
            module, _, name = source.partition(":")
            solver = getattr(importlib.import_module(module), name)
        if scene is None:
            return None
        # The heights of a copy are read-only again, after those of another solve.
        scene = replace(scene, surface=replace(scene.surface))
        if solver is None:
            doing = "returned {}"
            result = answer_of_command(_words(source), scene)
        else:
            doing = "raised {}{}"
            result = solver(scene)
        doing = "returned {}"
        fields = _checked_fields(result, scene.surface.shape)
        doing = "returned a ContactResult that cannot be read ({})"
        data = json.loads(json.dumps(plain(result.to_json()), allow_nan=False))
        return replace(ContactResult.from_json(data), fields=fields)
    except (Exception, SystemExit) as error:
        place = place_of(error, above=__file__, count=_PLACES)
        return f"solver {source} {doing.format(sentence_of(error), place)}"


def _checked_fields(result: Any, shape: tuple[int, ...]) -> dict[str, FloatArray]:
    """Return the fields of a solver's result by their names, as new float arrays.

    Raises InvalidCase if the result is no ContactResult, or if a field is not numeric
    or does not have the given shape of the grid.
    """
    if not isinstance(result, ContactResult):
        raise InvalidCase(f"no epcontact.ContactResult but {type(result).__name__!r}")
    fields = {}
    for name, given in result.fields.items():
        values = np.asarray(given)
        if values.shape != shape:
            raise InvalidCase(
                f"the field {name} of shape {values.shape}, but the scene's grid is "
                f"{shape}"
            )
        if values.dtype.kind not in "biuf":
            raise InvalidCase(
                f"the field {name} of type {values.dtype}, but numbers are needed"
            )
        plain_name = str(name) if isinstance(name, str) else name
        fields[plain_name] = np.array(values, dtype=np.float64)
    return fields


def _words(source: str) -> list[str]:
    """Split a command into its words as a shell does.  Raises InvalidCase if a quote is
    not closed.
    """
    try:
        return shlex.split(source)
    except ValueError as error:
        raise InvalidCase(f"solver {source}: is no command ({error})") from None


# --- commands


def answer_of_command(words: Sequence[str], scene: Scene) -> ContactResult:
    """Return the fields that a program writes for a scene, as a result.

    Args:
        words: the program and its arguments, with placeholders.
        scene: the scene.

    Raises:
        InvalidCase: if the program fails or writes no result.
        NotConverged: if it says so.
    """
    with tempfile.TemporaryDirectory(prefix="epcontact-") as name:
        scene_file = Path(name) / "scene.txt"
        result_file = Path(name) / "result.txt"
        scene_file.write_text(scene_text(scene), encoding="utf-8")
        files = {"scene": str(scene_file), "result": str(result_file)}
        command = [
            PLACEHOLDER.sub(lambda match: files[match[1]], word) for word in words
        ]
        started = time.perf_counter()
        done = subprocess.run(command, check=False, stderr=subprocess.PIPE)
        seconds = time.perf_counter() - started
        stderr = done.stderr.decode(errors="replace")
        with contextlib.suppress(OSError):  # a full or closed stderr is no error
            sys.stderr.write(without_controls(stderr))
        if done.returncode:
            lines = stderr.strip().splitlines()
            last = f"; it said: {lines[-1]}" if lines else ""
            raise InvalidCase(f"a command that {describe_death(done.returncode)}{last}")
        if not result_file.is_file():
            raise InvalidCase(
                "a command that ended with exit code 0 and wrote no result"
            )
        text = result_file.read_text("utf-8", "replace")
    found = result_of_text(text, scene.surface.shape)
    note = f"the pressure is {words[0]}'s, everything else follows from it here"
    return ContactResult(
        words[0],
        tuple(LoadStep(load, {}) for load in scene.load.path),
        Provenance(scene.digest, scene.surface.seed),
        fields={name: found[name] for name in _ARRAYS if name in found},
        cost={"seconds": seconds, "unknowns": scene.surface.heights.size},
        notes=(*scene.surface.notes, note),
    )


def scene_text(scene: Scene) -> str:
    """Return a scene as the text that a command reads, see the module's docstring.

    Each number has enough digits to be read back exactly.
    """
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
    """Read the text of a result: its arrays and numbers by their names.

    Args:
        text: see the module's docstring.
        shape: of the grid, and of the arrays that are returned.

    Raises:
        InvalidCase: if it is no such text.
        NotConverged: if it says so.
    """
    words = text.split()
    found: dict[str, FloatArray] = {}
    if words[:2] != ["epcontact-result", "1"]:
        raise InvalidCase("a file that does not begin with 'epcontact-result 1'")
    start = 2
    while start < len(words):
        name = words[start]
        if name not in (*_ARRAYS, *_NUMBERS):
            known = ", ".join((*_NUMBERS, *_ARRAYS))
            raise InvalidCase(
                f"a file with {name!r:.40} in the place of one of {known}"
            )
        if name in found:
            raise InvalidCase(f"a file with {name!r} twice")
        form = shape if name in _ARRAYS else ()
        count = math.prod(form)
        end = start + 1 + count
        numbers = [
            _LOGICAL.get(word) or _EXPONENT.sub("e", word)
            for word in words[start + 1 : end]
        ]
        try:
            found[name] = np.array(numbers, dtype=np.float64).reshape(form)
        except ValueError:
            raise InvalidCase(
                f"a file with fewer than {count} numbers after {name!r}"
            ) from None
        start = end
    for name in ("converged", "pressure"):
        if name not in found:
            raise InvalidCase(f"a file without {name!r}")
    numbers_found = {name: float(found[name]) for name in _NUMBERS if name in found}
    _require_solved(numbers_found.pop("converged"), numbers_found)
    return found
