"""Scenes and results as files, for solvers in any language: `--solver 'command {scene} {result}'`.

The command reads a scene from one file and writes its result to the other.  {scene} and {result}
stand for text files, {scene.npz} and {result.npz} for files of `numpy.savez` with the same names,
where `shape` and `periods` have one entry for a line and `loads` and `heights` are arrays.  All
numbers are in SI units; the conventions are those of `help(epcontact)`.

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

import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from epcontact.errors import InvalidCase, NotConverged
from epcontact.harness.processes.child import death_of
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Scene

#: What a command has in the place of the files.
PLACEHOLDER = re.compile(r"\{(scene|result)(\.npz)?\}")
SCENE, RESULT = "epcontact-scene", "epcontact-result"
_ARRAYS, _NUMBERS = ("pressure", "gap", "displacement"), ("converged", "residual")


def answer_of_command(words: Sequence[str], scene: Scene) -> ContactResult:
    """Return the result that a command gives for a scene.

    Args:
        words: the program and its arguments, with placeholders.
        scene: the scene.

    Raises:
        InvalidCase: if the command fails or writes no result.
        NotConverged: if the result says so.
    """
    from epcontact.harness.methods.peers import result_of  # loads solvers

    with tempfile.TemporaryDirectory(prefix="epcontact-") as folder:

        def path(match: re.Match[str]) -> str:
            return os.path.join(folder, match[1] + (match[2] or ".txt"))

        command = [PLACEHOLDER.sub(path, word) for word in words]
        result = Path(folder) / (
            "result.npz" if "{result.npz}" in " ".join(words) else "result.txt"
        )
        if "{scene.npz}" in " ".join(words):
            np.savez(Path(folder) / "scene.npz", **scene_items(scene))
        else:
            (Path(folder) / "scene.txt").write_text(scene_text(scene), encoding="utf-8")
        started = time.perf_counter()
        done = subprocess.run(command, check=False, stderr=subprocess.PIPE)
        seconds = time.perf_counter() - started
        said = done.stderr.decode(errors="replace")
        sys.stderr.write(said)
        if done.returncode:
            last = f"; it said: {said.strip().splitlines()[-1]}" if said.strip() else ""
            raise InvalidCase(f"a command that {death_of(done.returncode)}{last}")
        if not result.is_file():
            raise InvalidCase("a command that ended with exit code 0 and wrote no result")
        found = _read(result, scene.surface.shape)
    if found["converged"] != 1:
        raise NotConverged(f"a result that has not converged (converged {found['converged']:g})")
    gap, displacement = found.get("gap"), found.get("displacement")
    return result_of(scene, found["pressure"], words[0], seconds, gap, displacement)


def scene_items(scene: Scene) -> dict[str, Any]:
    """Return the entries of a scene's file by name."""
    surface, material, body = scene.surface, scene.material, scene.body
    return {
        SCENE: 1,
        "dimensions": len(surface.shape),
        "shape": surface.shape,
        "periods": surface.periods,
        "young_modulus": material.young_modulus,
        "poisson_ratio": material.poisson_ratio,
        "hardness": material.hardness,
        "yield_stress": material.yield_stress,
        "body": body.kind,
        "depth": body.depth,
        "loads": scene.load.path,
        "heights": surface.heights,
    }


def scene_text(scene: Scene) -> str:
    """Return a scene as text; floats have the digits that make them exact.

    Example:
        >>> from epcontact import Load, Material, Surface
        >>> line = Surface(np.array([0.0, 1e-6]), periods=(1e-3,))
        >>> scene_text(Scene(line, Material(1e11, 0.3), Load(1e8))).splitlines()[:4]
        ['epcontact-scene 1', 'dimensions 1', 'shape 2 1', 'periods 0.001 0.0']
    """
    items = scene_items(scene)
    loads, heights = items.pop("loads"), items.pop("heights")
    if items["dimensions"] == 1:
        items |= {"shape": (*items["shape"], 1), "periods": (*items["periods"], 0.0)}
    rows = [
        f"{name} {' '.join(map(str, value)) if isinstance(value, tuple) else value}"
        for name, value in items.items()
    ]
    rows += [f"loads {len(loads)}", *map(repr, loads)]
    return "\n".join([*rows, "heights", *map(repr, heights.ravel().tolist()), ""])


def result_of_text(text: str, shape: tuple[int, ...]) -> dict[str, Any]:
    """Read the text of a result.

    Raises:
        InvalidCase: if it is not one; the message says what is wrong.

    Example:
        >>> result_of_text("epcontact-result 1 converged 1 pressure 0 2e8", (2,))["pressure"]
        array([0.e+00, 2.e+08])
    """
    words, found, at = text.split(), {}, 2
    if words[:2] != [RESULT, "1"]:
        raise InvalidCase(f"a file that does not begin with '{RESULT} 1'")
    while at < len(words):
        name = words[at]
        if name not in (*_ARRAYS, *_NUMBERS):
            known = ", ".join((*_NUMBERS, *_ARRAYS))
            raise InvalidCase(f"a file with {name!r:.40} in the place of one of {known}")
        count = int(np.prod(shape)) if name in _ARRAYS else 1
        values = words[at + 1 : at + 1 + count]
        try:
            found[name] = np.array(values, dtype=np.float64)
        except ValueError:
            found[name] = np.empty(0)
        if found[name].size != count:
            raise InvalidCase(f"a file with fewer than {count} numbers after {name!r}")
        at += 1 + count
    return _required({n: v.reshape(shape) if n in _ARRAYS else v[0] for n, v in found.items()})


def _read(path: Path, shape: tuple[int, ...]) -> dict[str, Any]:
    if path.suffix == ".txt":
        return result_of_text(path.read_text(encoding="utf-8", errors="replace"), shape)
    with np.load(path, allow_pickle=False) as file:
        return _required({n: np.asarray(file[n], dtype=np.float64) for n in file.files})


def _required(found: Mapping[str, FloatArray]) -> dict[str, Any]:
    for name in ("converged", "pressure"):
        if name not in found:
            raise InvalidCase(f"a file without {name!r}")
    return dict(found)
