"""CalculiX as a method, and its input file: a code that the field trusts, on our block.

The block, its law and its load are those of `fem_check`; elements, solver and contact
are CalculiX's own.  Each top node presses through a unilateral spring (GAPUNI) on a
node of a rigid flat, and the loads act on the flat.  The periodic edges are tied by
equations.

Three things differ from `fem_check`, and `epcontact crosscheck` changes each alone:

    element              C3D8I has incompatible modes, C3D8 nothing against locking,
                         ours the mean dilatation; all of them meet on finer grids
    penalty              the springs yield by pressure times spacing over PENALTY E
    large displacements  GAPUNI needs NLGEOM, with which the body is at finite
                         strain: a part that falls as the slope of the surface,
                         and that small strain leaves out

On elastic blocks of small slope C3D8 has the pressures of a plain assembly of linear
elasticity to 6e-4, which is the springs' part (tests/test_calculix.py).

CalculiX reads at most twenty characters of a number, so numbers have thirteen digits.
"""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from epcontact import results
from epcontact.errors import InvalidScene, NotConverged, sentence_of
from epcontact.files import atomic_write
from epcontact.machine import describe_death
from epcontact.results import ContactResult, FloatArray, LoadStep, Provenance
from epcontact.scene import Scene
from fem_check.driver import problem_of
from fem_check.options import FemOptions
from fem_check.path import nodes_of
from fem_check.problem import Problem
from fem_check.result import areas, distribution
from fem_check.vtu import mesh_of

PROGRAM, ELEMENT = "ccx", "C3D8I"
#: Stiffness of a spring over E times the spacing, and its pull across an open gap over
#: the force on a node (the default of CalculiX is 1e-3 in the scene's own unit of
#: force).
PENALTY, PULL = 1e3, 1e-7
#: What `epcontact crosscheck` changes, by its name: arguments of `solve`.
CHANGES: dict[str, dict[str, Any]] = {
    "calculix, C3D8": {"element": "C3D8"},
    "calculix, stiffer springs": {"penalty": 10 * PENALTY},
}
#: Relative size of the residual forces and of the last correction.
TOLERANCE = 1e-7
#: Names that meshio has for the formats of bricks with data on their nodes; gmsh reads
#: VTK's 4.2.
_FORMATS = {
    ".vtu": "vtu",
    ".vtk": "vtk42",
    ".msh": "gmsh",
    ".med": "med",
    ".xdmf": "xdmf",
}


def deck(
    problem: Problem,
    scene: Scene,
    options: FemOptions,
    element: str = ELEMENT,
    penalty: float = PENALTY,
) -> str:
    """The input file of a scene: block, springs, equations, and a step for each mean
    pressure. Raises InvalidScene.
    """
    import meshio

    if (
        options.law == "capped"
        or options.geometry != "gap"
        or options.approach is not None
    ):
        raise InvalidScene(
            "calculix answers the laws elastic and j2, with the geometry gap, under "
            "pressures"
        )
    if not min(scene.load.path) > 0:
        raise InvalidScene(
            "mean_pressure is 0, but calculix needs a load that holds the flat"
        )
    (nx, ny), material, block = problem.block.shape, scene.material, problem.block
    mesh = mesh_of(problem, reference=True)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "mesh.inp"
        meshio.abaqus.write(file, mesh, float_fmt=".12e", translate_cell_names=False)
        text = file.read_text(encoding="utf-8")
    text = text.replace(
        "*ELEMENT, TYPE=hexahedron", f"*ELEMENT, TYPE={element}, ELSET=block"
    )
    number = np.arange(1, len(mesh.points) + 1).reshape(-1, nx + 1, ny + 1)
    top, flat = number[0, :-1, :-1].ravel(), np.arange(nx * ny) + number.size + 1
    whole = flat[-1] + 1
    clearance = problem.heights.max() - problem.heights.ravel()
    # Springs end a spacing above the block, where a viewer shows them.
    above, bricks = min(block.spacing), problem.bricks.number
    spring, pull = penalty * material.young_modulus * above, _pull(problem, scene)
    lines = [line.rstrip() for line in text.splitlines()] + ["*NODE, NSET=flat"]
    where = mesh.points[top - 1] + [0, 0, 1] * (above + clearance[:, None])
    lines += [
        f"{n}, " + ", ".join(map(_number, x)) for n, x in zip(flat, where, strict=True)
    ]
    lines += ["*NODE, NSET=whole", f"{whole}, 0., 0., {_number(2 * above)}"]
    for spot, (a, b, gap) in enumerate(
        zip(top, flat, clearance, strict=True), bricks + 1
    ):
        lines += [f"*ELEMENT, TYPE=GAPUNI, ELSET=gap{spot}", f"{spot}, {a}, {b}"]
        lines += [f"*GAP, ELSET=gap{spot}"]
        lines += [f"{_number(gap)}, 0., 0., 1., , {_number(spring)}, {_number(pull)}"]
    lines += ["*EQUATION"]
    source = np.pad(number[:-1, :-1, :-1], [(0, 0), (0, 1), (0, 1)], mode="wrap")
    tied = source != number[:-1]
    for image, node in zip(number[:-1][tied], source[tied], strict=True):
        lines += [f"2\n{image}, {axis}, 1., {node}, {axis}, -1." for axis in (1, 2, 3)]
    lines += [f"2\n{node}, 3, 1., {whole}, 3, -1." for node in flat]
    base = [
        f"{node}, {'3, 3' if block.sliding else '1, 3'}" for node in number[-1].ravel()
    ]
    held = [f"{number[-1, 0, 0]}, 1, 3"] * block.sliding
    lines += ["*BOUNDARY", *base, *held, "flat, 1, 2", "whole, 1, 2"]
    lines += ["*MATERIAL, NAME=solid", "*ELASTIC"]
    lines += [f"{_number(material.young_modulus)}, {_number(material.poisson_ratio)}"]
    if options.law == "j2":
        limit, slope = material.yield_stress, options.hardening
        lines += ["*PLASTIC", f"{_number(limit)}, 0.", f"{_number(limit + slope)}, 1."]
    lines += ["*SOLID SECTION, ELSET=block, MATERIAL=solid"]
    lines += ["*ELSET, ELSET=upper, GENERATE", f"1, {nx * ny}, 1"]
    for pressure in scene.load.path:
        force = -pressure * block.node_area * nx * ny
        lines += ["*STEP, NLGEOM, INC=10000", "*CONTROLS, PARAMETERS=FIELD"]
        lines += [f"{TOLERANCE}, {TOLERANCE}, , , {TOLERANCE}", "*STATIC"]
        share = 1 / options.steps if options.law == "j2" else 1.0  # equal increments
        lines += [f"{_number(share)}, 1., 1e-6, {_number(share)}"]
        lines += ["*CLOAD", f"whole, 3, {_number(force)}"]
        for nodes, printed in (("flat", "RF"), ("top", "U"), ("whole", "U")):
            lines += [f"*NODE PRINT, NSET={nodes}, FREQUENCY=10000", printed]
        lines += ["*EL PRINT, ELSET=upper, FREQUENCY=10000", "PEEQ"] * (
            options.law == "j2"
        )
        lines += ["*END STEP"]
    return "\n".join(lines) + "\n"


def _number(x: float) -> str:
    return f"{x:.12e}"


def _pull(problem: Problem, scene: Scene) -> float:
    """The force in N of an open spring."""
    return PULL * max(scene.load.path) * problem.block.node_area


def _ran(text: str, folder: Path) -> tuple[list[FloatArray], int]:
    """Run an input file; the tables that it printed, in their order, and its
    iterations.
    """
    (folder / "block.inp").write_text(text, encoding="utf-8")
    how: dict[str, Any] = {"capture_output": True, "text": True, "errors": "replace"}
    done = subprocess.run([PROGRAM, "block"], cwd=folder, check=False, **how)
    said = [line.strip() for line in done.stdout.splitlines() if "*ERROR" in line]
    printed = folder / "block.dat"
    if done.returncode or said or not printed.is_file():
        why = said[0] if said else f"it {describe_death(done.returncode)}"
        raise NotConverged(f"CalculiX did not solve the block: {why}")
    tables: list[list[list[float]]] = []
    for line in printed.read_text(encoding="utf-8").splitlines():
        words = line.split()
        if words and not words[0].lstrip("-").isdigit():
            tables.append([])
        elif words:
            tables[-1].append([float(word) for word in words])
    iterations = sum(
        line.startswith(" iteration ") for line in done.stdout.splitlines()
    )
    return [np.array(table) for table in tables], iterations


def solve(
    scene: Scene,
    options: Mapping[str, Any] | None = None,
    *,
    element: str = ELEMENT,
    penalty: float = PENALTY,
) -> ContactResult:
    """Answer a scene on the block of `fem_check`.  Raises InvalidScene,
    NotConverged.
    """
    given = FemOptions(**(options or {}))
    problem, started = problem_of(scene, given, 1), time.perf_counter()
    (nx, ny), block = problem.block.shape, problem.block
    with tempfile.TemporaryDirectory(prefix="epcontact-") as folder:
        printed, iterations = _ran(
            deck(problem, scene, given, element, penalty), Path(folder)
        )
    steps, tables = list[LoadStep](), iter(printed)
    for load in scene.load.path:
        forces = -next(tables)[:, 3].reshape(nx, ny)
        down = -next(tables)[:, 3].reshape(nx + 1, ny + 1)[:-1, :-1]
        approach = -float(next(tables)[0, 3])
        flowed = np.zeros((nx, ny), dtype=bool)
        if given.law == "j2":
            flowed = (next(tables)[:, 2].reshape(nx * ny, -1).max(axis=1) > 0).reshape(
                nx, ny
            )
        # An open spring pulls a little; a closed one presses with far more.
        touching = forces > 100 * _pull(problem, scene)
        reached = np.where(nodes_of(flowed), results.PLASTIC, results.ELASTIC)
        state = np.where(touching, reached, results.APART).astype(np.int8)
        pressure = np.where(state == results.APART, 0.0, forces) / block.node_area
        clearance = problem.heights.max() - problem.heights + down - approach
        gap = np.where(state == results.APART, clearance, 0.0)
        kinds = areas(state, scene.material.poisson_ratio, capped=False)
        measured = {
            "mean_gap": float(np.maximum(gap, 0).mean()),
            "approach": approach,
            "largest_pressure": float(pressure.max()),
            "mean_contact_pressure": float(pressure[pressure > 0].mean()),
        }
        missing = abs(float(pressure.mean()) - load) / max(scene.load.path)
        named = dict(zip(("raw", "corrected", "error"), kinds, strict=True))
        steps.append(LoadStep(load, named, {"force": missing}, quantities=measured))
    layers = {"layers": len(block.layers), "first_layer": float(block.layers[0])}
    told = asdict(given) | {"depth": block.depth, "element": element, **layers}
    fields = {"pressure": pressure, "gap": gap, "displacement": down, "state": state}
    fields = {
        name: values.reshape(scene.surface.shape) for name, values in fields.items()
    }
    cost = {"seconds": time.perf_counter() - started, "iterations": iterations}
    return ContactResult(
        method="calculix",
        steps=tuple(steps),
        provenance=Provenance(
            scene.digest, scene.surface.seed, told | {"solver": PROGRAM}
        ),
        distribution=distribution(pressure, state, np.inf),
        fields={"heights": scene.surface.heights} | fields,
        cost=cost | {"unknowns": 3 * nx * ny * len(block.layers)},
        notes=scene.surface.notes,
    )


def export(scene: Scene, file: Path, options: Mapping[str, Any]) -> str:
    """Write the block of a scene for another code; what was written, in a sentence."""
    given = FemOptions(**options)
    problem = problem_of(scene, given, 1)
    mesh, material = mesh_of(problem, reference=True), scene.material
    if file.suffix not in (".inp", *_FORMATS):
        raise InvalidScene(
            f"{file} ends in {file.suffix!r}, but must end in .inp (an input file of "
            "CalculiX) or "
            f"{', '.join(_FORMATS)}"
        )
    about = [
        f"the block of the scene {scene.digest} in SI units, {scene.body.kind}",
        f"E {material.young_modulus:g} Pa, nu {material.poisson_ratio:g}, yield stress "
        f"{material.yield_stress:g} Pa, hardness {material.hardness:g} Pa, law "
        f"{given.law}",
        f"mean pressures {', '.join(f'{p:g}' for p in scene.load.path)} Pa",
    ]
    with atomic_write(file) as temporary:
        if file.suffix == ".inp":
            told = "".join(f"** {line}\n" for line in about)
            Path(temporary).write_text(
                told + deck(problem, scene, given), encoding="utf-8"
            )
        else:
            # meshio writes no sets of nodes here, and VTK reads none of its small
            # integers.
            for name, nodes in mesh.point_sets.items():
                mesh.point_data[name] = np.zeros(len(mesh.points))
                mesh.point_data[name][nodes] = 1
            mesh.point_sets = {}
            try:
                inline = (
                    {"data_format": "XML"} if file.suffix == ".xdmf" else {}
                )  # one file
                mesh.write(temporary, file_format=_FORMATS[file.suffix], **inline)
            except ImportError as error:
                raise InvalidScene(
                    f"meshio cannot write {file}: {sentence_of(error)}"
                ) from None
    size = f"{len(mesh.points)} nodes and {problem.bricks.number} bricks"
    return f"{file}: {size}; {'; '.join(about)}"
