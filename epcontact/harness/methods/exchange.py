"""Scenes and results as files, for solvers in any language: `--solver 'command {scene} {result}'`.

The command reads a scene from one text file and writes its result to the other.  All numbers are
in SI units; the conventions are those of `help(epcontact)`.

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

The result is a text of words and numbers, separated by blanks or line ends, in any order:

    epcontact-result 1
    converged 1                  0 is an error: the result is not judged
    residual 1e-9                optional: what decided it, dimensionless
    pressure                     and then nx*ny numbers at the last load, ordered as the heights
    gap                          optional, the same; or displacement

The package computes the areas and everything else of the result from the pressure and, where it is
given, the gap.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from epcontact.errors import InvalidCase, NotConverged
from epcontact.harness.processes import death_of
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Scene

#: What a command has in the place of the files.
PLACEHOLDER = re.compile(r"\{(scene|result)\}")
_ARRAYS, _NUMBERS = ("pressure", "gap", "displacement"), ("converged", "residual")


def answer_of_command(words: Sequence[str], scene: Scene) -> ContactResult:
    """Return the result that a program, given by its words, has for a scene."""
    from epcontact.harness.methods.peers import result_of  # loads solvers

    with tempfile.TemporaryDirectory(prefix="epcontact-") as name:
        given, written = Path(name) / "scene.txt", Path(name) / "result.txt"
        given.write_text(scene_text(scene), encoding="utf-8")
        files = {"scene": str(given), "result": str(written)}
        command = [PLACEHOLDER.sub(lambda match: files[match[1]], word) for word in words]
        started = time.perf_counter()
        done = subprocess.run(command, check=False, stderr=subprocess.PIPE)
        seconds = time.perf_counter() - started
        said = done.stderr.decode(errors="replace")
        sys.stderr.write(said)
        if done.returncode:
            last = f"; it said: {said.strip().splitlines()[-1]}" if said.strip() else ""
            raise InvalidCase(f"a command that {death_of(done.returncode)}{last}")
        if not written.is_file():
            raise InvalidCase("a command that ended with exit code 0 and wrote no result")
        text = written.read_text(encoding="utf-8", errors="replace")
    found = result_of_text(text, scene.surface.shape)
    if found["converged"] != 1:
        raise NotConverged(f"a result that has not converged (converged {found['converged']:g})")
    gap, displacement = found.get("gap"), found.get("displacement")
    return result_of(scene, found["pressure"], words[0], seconds, gap, displacement)


def scene_text(scene: Scene) -> str:
    """Return a scene as text; floats have the digits that make them exact."""
    surface, material, body = scene.surface, scene.material, scene.body
    line = len(surface.shape) == 1
    shape = (*surface.shape, 1) if line else surface.shape
    periods = (*surface.periods, 0.0) if line else surface.periods
    rows = [
        "epcontact-scene 1",
        f"dimensions {len(surface.shape)}",
        f"shape {shape[0]} {shape[1]}",
        f"periods {periods[0]} {periods[1]}",
        f"young_modulus {material.young_modulus}",
        f"poisson_ratio {material.poisson_ratio}",
        f"hardness {material.hardness}",
        f"yield_stress {material.yield_stress}",
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
            raise InvalidCase(f"a file with {name!r:.40} in the place of one of {known}")
        form = shape if name in _ARRAYS else ()
        count = int(np.prod(form))
        try:
            found[name] = np.array(words[at + 1 : at + 1 + count], dtype=np.float64).reshape(form)
        except ValueError:
            raise InvalidCase(f"a file with fewer than {count} numbers after {name!r}") from None
        at += 1 + count
    for name in ("converged", "pressure"):
        if name not in found:
            raise InvalidCase(f"a file without {name!r}")
    return found
