"""Tasks and their results on disk: one file for each result, found again by its key.

`<output>/<case>/<size>/members/<method>-<surface>.json` holds one result, its key
(scene, size, options, and the sources and libraries of all solvers), a digest of this
content, and the hash of the fields written with it.  A task of the same key is not run
again if the content has that digest and the fields it asks for have that hash.  A
solver from outside the package always runs, because its sources are not known here.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import itertools
import json
import math
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from statistics import fmean
from typing import Any

from pydantic_core import to_json

from epcontact.files import write_json
from epcontact.harness.case_files.case import Case
from epcontact.harness.gates import estimate, standard_deviation
from epcontact.harness.methods.registry import Method, bytes_of_task
from epcontact.harness.quantities.registry import QUANTITIES, claim_of
from epcontact.materials.moduli import effective_modulus
from epcontact.output.vtk import Precision
from epcontact.results import COLUMNS, ContactResult, package_versions
from epcontact.scene import Scene, Surface
from epcontact.surfaces import Recipe, unit_of

#: What the harness measures for a table of loads.
_NAMES = (f"quantity.{column}{kind}" for column in COLUMNS for kind in ("", ".error"))
ROW = tuple(name for name in _NAMES if name in QUANTITIES and QUANTITIES[name].measure)


@dataclass(frozen=True, eq=False)
class Task:
    """One solve: a method on one surface of a case."""

    case: Case
    method: Method
    member: int  # index of the recipe in the case
    label: str  # the name of the surface in files
    fields: Path | None = None  # file for the fields; None if they are not kept
    steps: Path | None = (
        None  # folder for the files of every load; None if they are not kept
    )
    quantities: tuple[str, ...] = ()  # what is measured beside the quantities of gates
    words: str = ""  # what a reader calls it; the label where it is empty
    precision: Precision = "single"  # of the numbers in the files of fields, at least
    rows: bool = False  # whether ROW is measured at every load

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
                names |= {gate.quantity, claim_of(gate.quantity)} - {""}
        return tuple(sorted(names))

    @property
    def memory(self) -> float:
        """The estimated bytes of a process that solves it."""
        scene = (self.case.material, self.case.body, self.case.load)
        return bytes_of_task(
            self.method.memory, self.recipe, scene, self.case.options[self.method.name]
        )

    def fields_path(self, output: Path) -> Path:
        """Return the file for its fields: `<method>[-<surface>].vti` in the case's
        folder.
        """
        name = self.method.name + ("" if self.label == "single" else f"-{self.label}")
        return self.case.folder(output) / f"{name}.vti"

    def steps_path(self, output: Path) -> Path:
        """Return the folder for the files of every load, with a collection path.pvd."""
        fields = self.fields_path(output)
        return fields.with_name(f"{fields.stem}-steps")

    def result_path(self, output: Path) -> Path:
        """Return the file for its result."""
        return (
            self.case.folder(output)
            / "members"
            / f"{self.method.name}-{self.label}.json"
        )


@dataclass(frozen=True)
class Answer:
    """The answer of a method to a case: one result a surface, and sentences on
    failures.
    """

    results: tuple[ContactResult, ...] = ()
    labels: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()
    reused: int = 0

    @property
    def twins(self) -> tuple[str, str] | None:
        """The labels of two surfaces with the same answer, which no ensemble may have.
        Two different surfaces may have the same areas and energies, but not all figures
        of their single points: answers without a largest pressure are not compared.
        Solutions of one surface, wherever it is on the grid, agree to the tolerance of
        their solver.
        """
        found = [result.final.quantities for result in self.results]
        for i, j in itertools.combinations(range(len(found)), 2):
            a, b = found[i], found[j]
            known = "largest_pressure" in a and a.keys() == b.keys()
            if known and all(math.isclose(a[k], b[k], rel_tol=1e-6) for k in a):
                return self.labels[i], self.labels[j]
        return None


#: Rooms that show results or ask for them, and what makes numbers within them: an edit
#: of the rest of these rooms keeps what is solved, one of any other source of the
#: packages does not.
_SHOWS = {"cli", "planning", "studies", "output", "harness"}
_MAKES = (
    *("output/vtk.py", "harness/methods", "harness/quantities"),
    *(f"harness/answers/{name}.py" for name in ("loads", "run", "store")),
)
_LIBRARIES = ("epcontact", "numpy", "scipy", "ducc0", "numba", "scikit-fem")


@functools.cache
def sources(home: Path = Path(__file__).parents[2]) -> str:
    """Return the digest of the sources on which every result rests."""
    rooms = {path for path in home.iterdir() if path.name not in _SHOWS}
    digest = hashlib.sha256()
    for path in sorted(
        {*rooms, home.parent / "fem_check", *(home / name for name in _MAKES)}
    ):
        for file in [path] if path.suffix == ".py" else sorted(path.rglob("*.py")):
            digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def basis() -> dict[str, str]:
    """Return what results rest on by name: sources, and the versions of numerical
    libraries.
    """
    versions = package_versions()
    return {"sources": sources()} | {name: versions[name] for name in _LIBRARIES}


def key_of(task: Task) -> str:
    """Return the digest of all that a result depends on."""
    content = {
        "scene": task.case.digest(task.recipe),
        "size": task.case.size,
        "method": task.method.name,
        "options": repr(sorted(task.case.options[task.method.name].items())),
        "mapped": repr((task.case.mapped, task.case.conductances)),
        "basis": basis(),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def keep(task: Task, output: Path, result: ContactResult) -> None:
    """Write the result of a task.  Raises OutputError.  Fields of an earlier, different
    result are removed, because they would pass for this one's.
    """
    about: dict[str, Any] = {
        "case": task.case.id,
        "size": task.case.size,
        "key": key_of(task),
    }
    about |= {
        "fields_digest": _digest(task.fields),
        "steps_kept": task.steps is not None,
    }
    about |= {"precision": task.precision, "measured": task.measured, "rows": task.rows}
    earlier = read_member(task.result_path(output))
    same = earlier.get("key") == about["key"]
    if task.fields is None and same:
        about |= {name: earlier.get(name) for name in ("fields_digest", "precision")}
    elif task.fields is None:
        with contextlib.suppress(OSError):
            task.fields_path(output).unlink()
    if task.steps is None and same:
        about["steps_kept"] = bool(earlier.get("steps_kept"))
    elif task.steps is None:
        shutil.rmtree(task.steps_path(output), ignore_errors=True)
    data = about | result.to_json()
    write_json(task.result_path(output), {"digest": _content_digest(data)} | data)


def kept(task: Task, output: Path) -> ContactResult | None:
    """Return the result of an earlier run of the same task, if it is there as it was
    written.
    """
    data = {} if task.method.foreign else read_member(task.result_path(output))
    precise = data.get("precision") in (task.precision, "double")
    written = (
        data.get("steps_kept") is True
        and (task.steps_path(output) / "path.pvd").is_file()
    )
    asked = set(task.measured) <= set(
        data.get("measured", ())
    ) and task.rows <= data.get("rows", 0)
    if (
        data.get("key") != key_of(task)
        or not asked
        or (
            task.fields
            and not (precise and data.get("fields_digest") == _digest(task.fields))
        )
        or (task.steps and not written)
    ):
        return None
    try:
        return ContactResult.from_json(data)
    except (ValueError, KeyError, TypeError):
        return None


def read_member(path: Path) -> dict[str, Any]:
    """Read the file that `keep` wrote for a task; empty if there is none, or another
    content.
    """
    try:
        data = json.loads(path.read_bytes())
        written = data.pop("digest")
    except (OSError, ValueError, RecursionError, KeyError, TypeError, AttributeError):
        return {}
    return data if written == _content_digest(data) else {}


def _content_digest(data: dict[str, Any]) -> str:
    return hashlib.sha256(to_json(data)).hexdigest()


def _digest(fields: Path | None) -> str | None:
    """Return the SHA-256 of a file of fields; empty if it is absent, None without a
    path.
    """
    if fields is None:
        return None
    try:
        with fields.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


def summary(case: Case, answer: Answer) -> dict[str, Any]:
    """Return a method's answer as JSON: means over surfaces, their scatter, every
    member.
    """
    members = [result.to_json() for result in answer.results]
    finals, costs = [r.final for r in answer.results], [r.cost for r in answer.results]
    parts = ("total", "elastic", "plastic")
    ensemble = {
        kind: {
            part: _spread([getattr(f.areas[kind], part) for f in finals])
            for part in parts
        }
        for kind in finals[0].areas
    }
    return {
        "case": case.id,
        "method": answer.results[0].method,
        "size": case.size,
        "converged": all(r.converged for r in answer.results),
        "residuals": {
            key: max(final.residuals[key] for final in finals)
            for key in finals[0].residuals
        },
        "areas": {
            kind: {part: ensemble[kind][part]["mean"] for part in parts}
            for kind in ensemble
        },
        "ensemble": {"surfaces": list(answer.labels), "areas": ensemble},
        "mean_pressure": finals[0].mean_pressure,
        "loads": load_rows(answer.results),
        "cost": {
            key: (max if key == "peak_memory_bytes" else sum)(
                cost[key] for cost in costs
            )
            for key in costs[0]
        },
        "provenance": members[0]["provenance"],
        "members": members,
    }


def load_rows(
    results: Sequence[ContactResult], more: Sequence[str] = ()
) -> list[dict[str, Any]]:
    """Return a row a load: its branch, and means, errors at 95 % and their parts by
    sources, None where none is known.
    """
    rows, j2 = [], results[0].provenance.options.get("law") == "j2"
    for branch, *steps in zip(
        results[0].branches, *(r.steps for r in results), strict=True
    ):
        each = [
            {n: step.quantities.get(n, math.nan) for n in more} | step.row
            for step in steps
        ]
        if j2 and branch != "loading":
            each = [
                {n.replace("plastic", "flowed"): v for n, v in one.items()}
                for one in each
            ]
        row: dict[str, Any] = {"branch": branch}
        for name in (*COLUMNS, *more):
            found = estimate([one.get(name, math.nan) for one in each])
            start = f"{name}_error_by_"
            known = [source for source in each[0] if source.startswith(start)]
            parts = {
                s.removeprefix(start): fmean(one.get(s, 0.0) for one in each)
                for s in known
            }
            parts |= {"scatter": found.half_width} if found.half_width else {}
            if not math.isnan(
                found.mean
            ):  # a figure without a known error is not exact
                exact = name in ("mean_pressure", "hardness")
                error = math.hypot(*parts.values()) if parts or exact else None
                row[name] = {"mean": found.mean, "error": error, "parts": parts}
        rows.append(row)
    return rows


def _spread(values: Sequence[float]) -> dict[str, float]:
    found = estimate(values)
    return {
        "mean": found.mean,
        "standard_deviation": standard_deviation(values),
        "half_width_95": found.half_width,
    }


# --- a scene in words and figures
# ----------------------------------------------------------------

_BODIES = {
    "half_space": "half-space",
    "bonded_layer": "layer bonded to a rigid base",
    "sliding_layer": "layer sliding on a rigid base",
}


def described(
    scene: Scene, recipe: Recipe, hardness_source: str
) -> dict[str, dict[str, Any]]:
    """Return the figures of a scene by name, each with `value`, `unit` and `meaning`.
    A result carries them in its provenance, so that its JSON, .vti and report need no
    case.  Values are numbers, lists of numbers or words, the units "" for words and "–"
    for numbers without one. What the scene does not have, such as a hardness, is left
    out or infinite.
    """
    surface, material = scene.surface, scene.material
    modulus, body = effective_modulus(material), _BODIES[scene.body.kind]
    if scene.body.kind != "half_space":
        body += f", {scene.body.depth:g} m deep"
    how = (
        "from differences of neighbours"
        if surface.spectrum is None
        else "of the spectrum"
    )
    slope = (surface.spectrum or surface).rms_slope
    rows: list[tuple[str, Any, str, str]] = [
        ("surface", _surface_in_words(surface, recipe), "", "surface"),
        ("points", list(surface.shape), "–", "grid points along each direction"),
        ("periods", list(surface.periods), "m", "period"),
        ("spacing", list(surface.spacing), "m", "distance of grid points"),
        ("rms_height", surface.rms_height, "m", "rms height"),
        ("rms_slope", slope, "–", f"rms slope ξ, {how}"),
        ("young_modulus", material.young_modulus, "Pa", "Young's modulus E"),
        ("poisson_ratio", material.poisson_ratio, "–", "Poisson's ratio ν"),
        ("effective_modulus", modulus, "Pa", "effective modulus E* = E / (1 − ν²)"),
        (
            "hardness",
            material.hardness,
            "Pa",
            "hardness σ_P, the largest contact pressure",
        ),
        (
            "yield_stress",
            material.yield_stress,
            "Pa",
            "yield stress σ_Y of the J2 solid",
        ),
        ("body", body, "", "body"),
        (
            "load_path",
            list(scene.load.path),
            "Pa",
            "mean pressure p₀ (force / nominal area)",
        ),
    ]
    if surface.shortest_wavelength is not None:
        resolved = surface.shortest_wavelength / max(surface.spacing)
        rows.insert(
            4, ("resolution", resolved, "–", "grid points per shortest wavelength")
        )
    if slope > 0:
        rows.append(
            ("load_group", scene.load.final / (modulus * slope), "–", "p₀ / (E* ξ)")
        )
        rows.append(
            (
                "hardness_group",
                material.hardness / (modulus * slope),
                "–",
                "σ_P / (E* ξ)",
            )
        )
    if hardness_source:
        rows.append(
            ("hardness_source", hardness_source, "", "where the hardness comes from")
        )
    return {
        name: dict(zip(("value", "unit", "meaning"), row, strict=True))
        for name, *row in rows
    }


def _surface_in_words(surface: Surface, recipe: Recipe) -> str:
    spectrum = surface.spectrum
    if spectrum is not None:
        return (
            f"self-affine roughness: Hurst exponent {spectrum.hurst:g}, flat spectrum from "
            f"{spectrum.wavenumber_low:.5g} to {spectrum.wavenumber_roll_off:.5g} rad/m, power law "
            f"up to {spectrum.wavenumber_high:.5g} rad/m, rms slope {spectrum.rms_slope:g}, "
            f"seed {surface.seed}"
        )
    recipe = getattr(recipe, "map", recipe)  # of one that is mirrored
    kind = str(getattr(recipe, "kind", type(recipe).__name__)).replace("_", " ")
    return f"{kind}: {', '.join(_parameters(recipe))}"


def _parameters(recipe: Any) -> Iterator[str]:
    """Yield the parameters of a recipe as "radius 0.01 m", with the units of its
    annotations.
    """
    for name in (field.name for field in fields(recipe)):
        value = getattr(recipe, name)
        if name in ("kind", "periods", "shape", "heights") or value in (
            None,
            (),
            False,
        ):
            continue
        shown = f"{value:g}" if isinstance(value, float) else str(value)
        yield f"{name.replace('_', ' ')} {shown} {unit_of(recipe, name)}".rstrip()
