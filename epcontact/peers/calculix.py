"""CalculiX, a finite-element code, as a method, and its input file.

CalculiX solves the block of `fem_check` with the same material law and load, but with
elements, solver and contact of its own.  Each top node of the block presses through a
unilateral spring (element type GAPUNI) on a node of a rigid flat.  The loads act on the
flat.  Equations tie the periodic edges.

Three things differ from `fem_check`; `epcontact crosscheck` changes one at a time:

    element              C3D8I has incompatible modes, C3D8 has nothing against locking,
                         and `fem_check` has the mean dilatation; their results
                         converge to each other on finer grids
    penalty              a spring shortens by force / (PENALTY E spacing)
    large displacements  GAPUNI needs the option NLGEOM, with which the body has finite
                         strains; `fem_check` has small strains, and the difference
                         decreases with the slope of the surface

On elastic blocks of small slope the pressures with C3D8 agree with those of a plain
assembly of linear elasticity to 6e-4, which is the error of the springs
(tests/test_calculix.py).

CalculiX reads at most twenty characters of a number; numbers are written with thirteen
digits.
"""

from __future__ import annotations

import math
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact import results
from epcontact.errors import InvalidScene, NotConverged, sentence_of
from epcontact.files import atomic_write
from epcontact.machine import describe_death
from epcontact.results import ContactResult, FloatArray, LoadStep, Provenance
from epcontact.scene import Material, Scene
from fem_check.driver import problem_of
from fem_check.options import FemOptions
from fem_check.path import nodes_of
from fem_check.problem import Problem
from fem_check.result import areas, distribution
from fem_check.vtu import mesh_of

#: Name of CalculiX's executable.
PROGRAM = "ccx"
#: CalculiX's name of the element: eight nodes, with incompatible modes.
ELEMENT = "C3D8I"
#: Stiffness of a spring over Young's modulus times the grid spacing.
PENALTY = 1e3
#: Tensile force of a spring across an open gap, over the force on a node at the largest
#: mean pressure.  CalculiX's default is 1e-3 in the unit of force of the input file.
PULL = 1e-7
#: The variants of `solve` that `epcontact crosscheck` adds to its table: for the name
#: of each row the arguments that differ from the defaults.
CHANGES: dict[str, dict[str, Any]] = {
    "calculix, C3D8": {"element": "C3D8"},
    "calculix, stiffer springs": {"penalty": 10 * PENALTY},
}
#: Relative size of the residual forces and of the last correction at which CalculiX
#: stops its iterations.
TOLERANCE = 1e-7
#: For each file ending that `export` accepts beside .inp, meshio's name of the format.
#: "vtk42" is version 4.2 of VTK's legacy format, the newest one that gmsh reads.
_FORMATS = {
    ".vtu": "vtu",
    ".vtk": "vtk42",
    ".msh": "gmsh",
    ".med": "med",
    ".xdmf": "xdmf",
}


# --- the input file


@dataclass(frozen=True)
class _NodeNumbers:
    """The node numbers of an input file, which count from 1.

    Attributes:
        block: (nz + 1, nx + 1, ny + 1); level 0 is the top, and the last index along x
            and y is the copy of index 0 at the periodic edge.
        top: (nx * ny,), the nodes of the top without the copies.
        flat: (nx * ny,), the node of the rigid flat above each of these.
        whole: the node that moves with the complete flat and carries its load.
    """

    block: NDArray[np.int_]
    top: NDArray[np.int_]
    flat: NDArray[np.int_]
    whole: int


def deck(
    problem: Problem,
    scene: Scene,
    options: FemOptions,
    element: str = ELEMENT,
    penalty: float = PENALTY,
) -> str:
    """Return the text of CalculiX's input file for a scene.

    The file has the block, the springs, the equations of the periodic edges, and a step
    for each mean pressure of the load path.

    Args:
        problem: the block of the scene, from `problem_of(scene, options)`.
        scene: the scene; all mean pressures must be positive.
        options: the law "elastic" or "j2", with the geometry "gap" and no approach.
        element: CalculiX's name of the element, such as "C3D8I".
        penalty: stiffness of a spring over Young's modulus times the grid spacing.

    Raises:
        InvalidScene: if CalculiX is not used for such options or such a load.
    """
    _require_supported(scene, options)
    block = problem.block
    nx, ny = block.shape
    mesh = mesh_of(problem, reference=True)
    count = len(mesh.points)
    block_numbers = np.arange(1, count + 1).reshape(-1, nx + 1, ny + 1)
    flat = np.arange(nx * ny) + count + 1
    nodes = _NodeNumbers(
        block=block_numbers,
        top=block_numbers[0, :-1, :-1].ravel(),
        flat=flat,
        whole=int(flat[-1]) + 1,
    )
    lines = [
        *_mesh_lines(mesh, element),
        *_flat_lines(problem, mesh, nodes),
        *_spring_lines(problem, scene, nodes, penalty),
        *_equation_lines(nodes),
        *_boundary_lines(nodes, block.sliding),
        *_material_lines(scene, options),
        "*ELSET, ELSET=upper, GENERATE",
        f"1, {nx * ny}, 1",
    ]
    for pressure in scene.load.path:
        force = pressure * block.node_area * nx * ny
        lines += _step_lines(force, options)
    return "\n".join(lines) + "\n"


def _require_supported(scene: Scene, options: FemOptions) -> None:
    """Raise InvalidScene if CalculiX is not used for a scene with these options.

    The law must be "elastic" or "j2", the geometry "gap", and all mean pressures of the
    scene positive; an approach cannot be prescribed.
    """
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


def _mesh_lines(mesh: Any, element: str) -> list[str]:
    """Return the lines with nodes, elements and node sets of a `meshio.Mesh`.

    `element` is CalculiX's name of the element.
    """
    import meshio

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "mesh.inp"
        meshio.abaqus.write(file, mesh, float_fmt=".12e", translate_cell_names=False)
        text = file.read_text(encoding="utf-8")
    text = text.replace(
        "*ELEMENT, TYPE=hexahedron", f"*ELEMENT, TYPE={element}, ELSET=block"
    )
    return [line.rstrip() for line in text.splitlines()]


def _clearances(problem: Problem) -> FloatArray:
    """Return the gaps between the undeformed surface of a block and a flat.

    The flat touches the highest point.  The gaps are in m, of shape (nx, ny).
    """
    return np.asarray(problem.heights.max() - problem.heights)


def _flat_lines(problem: Problem, mesh: Any, nodes: _NodeNumbers) -> list[str]:
    """Return the lines with the nodes of the rigid flat.

    The nodes lie a grid spacing above the block, where a viewer shows them.  Their
    distance does not matter, because the springs have the gaps.

    Args:
        problem: the block of the scene.
        mesh: its `meshio.Mesh`.
        nodes: the node numbers.
    """
    spacing = min(problem.block.spacing)
    clearance = _clearances(problem).reshape(-1, 1)
    points = mesh.points[nodes.top - 1] + [0, 0, 1] * (spacing + clearance)
    lines = ["*NODE, NSET=flat"]
    for node, point in zip(nodes.flat, points, strict=True):
        coordinates = ", ".join(map(_number, point))
        lines.append(f"{node}, {coordinates}")
    lines.append("*NODE, NSET=whole")
    lines.append(f"{nodes.whole}, 0., 0., {_number(2 * spacing)}")
    return lines


def _spring_lines(
    problem: Problem, scene: Scene, nodes: _NodeNumbers, penalty: float
) -> list[str]:
    """Return the lines with a unilateral spring between each top node and the flat.

    Args:
        problem: the block of the scene.
        scene: the scene.
        nodes: the node numbers.
        penalty: stiffness of a spring over Young's modulus times the grid spacing.
    """
    spacing = min(problem.block.spacing)
    stiffness = _number(penalty * scene.material.young_modulus * spacing)
    pull = _number(_pull(problem, scene))
    first_spring = problem.bricks.number + 1
    pairs = zip(nodes.top, nodes.flat, _clearances(problem).ravel(), strict=True)
    lines = []
    for spring, (top, flat, clearance) in enumerate(pairs, first_spring):
        lines.append(f"*ELEMENT, TYPE=GAPUNI, ELSET=gap{spring}")
        lines.append(f"{spring}, {top}, {flat}")
        lines.append(f"*GAP, ELSET=gap{spring}")
        # Clearance, direction (0, 0, 1), an unused field, stiffness, tensile force.
        lines.append(f"{_number(clearance)}, 0., 0., 1., , {stiffness}, {pull}")
    return lines


def _equation_lines(nodes: _NodeNumbers) -> list[str]:
    """Return the lines that tie copies to their nodes, and the flat's nodes together.

    Each equation says that two degrees of freedom are equal.  The base has none,
    because it is fixed.
    """
    above_base = nodes.block[:-1]
    periodic = [(0, 0), (0, 1), (0, 1)]
    originals = np.pad(above_base[:, :-1, :-1], periodic, mode="wrap")
    is_copy = originals != above_base
    lines = ["*EQUATION"]
    for copy, node in zip(above_base[is_copy], originals[is_copy], strict=True):
        for axis in (1, 2, 3):
            lines.append(f"2\n{copy}, {axis}, 1., {node}, {axis}, -1.")
    for node in nodes.flat:
        lines.append(f"2\n{node}, 3, 1., {nodes.whole}, 3, -1.")
    return lines


def _boundary_lines(nodes: _NodeNumbers, slides: bool) -> list[str]:
    """Return the lines with the fixed degrees of freedom.

    The flat moves along z only.  If the base slides, its nodes are fixed along z, and
    one of them along all axes; else all are fixed along all axes.
    """
    base = nodes.block[-1].ravel()
    axes = "3, 3" if slides else "1, 3"
    lines = ["*BOUNDARY"]
    lines += [f"{node}, {axes}" for node in base]
    if slides:
        lines.append(f"{base[0]}, 1, 3")
    return [*lines, "flat, 1, 2", "whole, 1, 2"]


def _material_lines(scene: Scene, options: FemOptions) -> list[str]:
    """Return the lines of the input file with the scene's material, in SI units.

    They have the elastic constants and, if the law of the options is "j2", the yield
    curve.
    """
    material = scene.material
    elastic = (_number(material.young_modulus), _number(material.poisson_ratio))
    lines = ["*MATERIAL, NAME=solid", "*ELASTIC", ", ".join(elastic)]
    if options.law == "j2":
        lines.append("*PLASTIC")
        for strain, stress in _yield_curve(material):
            lines.append(f"{_number(stress)}, {_number(strain)}")
    return [*lines, "*SOLID SECTION, ELSET=block, MATERIAL=solid"]


def _yield_curve(material: Material) -> tuple[tuple[float, float], ...]:
    """Return points (plastic strain, yield stress in Pa) of a material.

    CalculiX, too, takes straight lines between the points, and the last stress beyond
    the last point.
    """
    curve = material.yield_curve
    points = list(zip(curve.strains, curve.stresses, strict=True))
    if curve.last_slope > 0 or len(points) == 1:
        strain, stress = points[-1]
        points.append((strain + 1.0, stress + curve.last_slope))
    return tuple(points)


def _step_lines(force: float, options: FemOptions) -> list[str]:
    """Return the lines of a step to a downward force (N) on the flat.

    `options` have the law and, of a J2 body, the number of increments.  A step prints,
    in this order, the tables that `_read_step` reads: the forces on the
    nodes of the flat, the displacements of the top and of the flat and, of a J2 body,
    the plastic strains of the top layer of elements.
    """
    is_j2 = options.law == "j2"
    # A J2 body is loaded in equal increments, an elastic one at once.
    increment = 1 / options.steps if is_j2 else 1.0
    lines = [
        "*STEP, NLGEOM, INC=10000",
        "*CONTROLS, PARAMETERS=FIELD",
        f"{TOLERANCE}, {TOLERANCE}, , , {TOLERANCE}",
        "*STATIC",
        f"{_number(increment)}, 1., 1e-6, {_number(increment)}",
        "*CLOAD",
        f"whole, 3, {_number(-force)}",
    ]
    for nodes, quantity in (("flat", "RF"), ("top", "U"), ("whole", "U")):
        lines += [f"*NODE PRINT, NSET={nodes}, FREQUENCY=10000", quantity]
    if is_j2:
        lines += ["*EL PRINT, ELSET=upper, FREQUENCY=10000", "PEEQ"]
    return [*lines, "*END STEP"]


def _number(x: float) -> str:
    """Return a number as text with thirteen digits, which CalculiX can read."""
    return f"{x:.12e}"


def _pull(problem: Problem, scene: Scene) -> float:
    """Return the tensile force (N) of a spring across an open gap of the block.

    It is PULL times the force on a node at the largest mean pressure of the scene.
    """
    return PULL * max(scene.load.path) * problem.block.node_area


# --- the solve


def _run_ccx(text: str, folder: Path) -> tuple[list[FloatArray], int]:
    """Run CalculiX on the text of an input file.

    Args:
        text: from `deck`.
        folder: an existing folder for CalculiX's files.

    Returns:
        The tables that CalculiX printed, in the order of the input file, each of shape
        (rows, columns), and the number of its iterations.

    Raises:
        NotConverged: if CalculiX reports an error, dies, or prints no tables.
    """
    (folder / "block.inp").write_text(text, encoding="utf-8")
    process = subprocess.run(
        [PROGRAM, "block"],
        cwd=folder,
        check=False,
        capture_output=True,
        text=True,
        errors="replace",
    )
    log = process.stdout.splitlines()
    errors = [line.strip() for line in log if "*ERROR" in line]
    printed = folder / "block.dat"
    if process.returncode or errors or not printed.is_file():
        reason = f"it {describe_death(process.returncode)}"
        if errors:
            reason = errors[0]
        raise NotConverged(f"CalculiX did not solve the block: {reason}")
    tables: list[list[list[float]]] = []
    for line in printed.read_text(encoding="utf-8").splitlines():
        words = line.split()
        if not words:
            continue
        if words[0].isdigit():
            tables[-1].append([float(word) for word in words])
        else:  # the heading of the next table
            tables.append([])
    iterations = sum(line.startswith(" iteration ") for line in log)
    return [np.array(table) for table in tables], iterations


@dataclass(frozen=True)
class _StepTables:
    """What CalculiX printed for one load.

    Attributes:
        forces: (nx, ny) downward forces on the top nodes, in N.
        lowered: (nx, ny) downward displacements of the top nodes, in m.
        approach: downward displacement of the flat, in m.
        flowed: (nx, ny) True for the top nodes of elements with a plastic strain.
    """

    forces: FloatArray
    lowered: FloatArray
    approach: float
    flowed: NDArray[np.bool_]


def _read_step(
    tables: Iterator[FloatArray], shape: tuple[int, int], is_j2: bool
) -> _StepTables:
    """Return the values of the next load from the tables that CalculiX printed.

    Args:
        tables: the tables; those of one load are taken, see `_step_lines`.
        shape: number of nodes (nx, ny) of the top over one period.
        is_j2: whether there is a table of plastic strains.
    """
    nx, ny = shape
    # A row of nodes is: number, x, y, z; a row of elements: number, point, strain.
    forces = -next(tables)[:, 3].reshape(nx, ny)
    lowered = -next(tables)[:, 3].reshape(nx + 1, ny + 1)[:-1, :-1]
    approach = -float(next(tables)[0, 3])
    elements_flowed = np.zeros((nx, ny), dtype=bool)
    if is_j2:
        strains = next(tables)[:, 2].reshape(nx * ny, -1)
        elements_flowed = (strains.max(axis=1) > 0).reshape(nx, ny)
    return _StepTables(forces, lowered, approach, nodes_of(elements_flowed))


def _result_of_step(
    problem: Problem, scene: Scene, load: float, tables: _StepTables
) -> tuple[LoadStep, dict[str, Any]]:
    """Return the load step of a mean pressure, and its fields.

    Args:
        problem: the block of the scene.
        scene: the scene.
        load: the mean pressure in Pa.
        tables: what CalculiX printed for this load.

    Returns:
        The load step with areas and quantities, and the fields of shape (nx, ny) by
        name: pressure (Pa), gap (m), displacement (m, downward) and state.
    """
    # An open spring pulls with a small force; a closed one presses with a far larger.
    in_contact = tables.forces > 100 * _pull(problem, scene)
    contact_states = np.where(tables.flowed, results.PLASTIC, results.ELASTIC)
    state = np.where(in_contact, contact_states, results.APART).astype(np.int8)
    pressure = np.where(in_contact, tables.forces, 0.0) / problem.block.node_area
    open_gap = _clearances(problem) + tables.lowered - tables.approach
    gap = np.where(in_contact, 0.0, open_gap)
    raw, corrected, error = areas(state, scene.material.poisson_ratio, capped=False)
    load_error = abs(float(pressure.mean()) - load) / max(scene.load.path)
    step = LoadStep(
        load,
        {"raw": raw, "corrected": corrected, "error": error},
        {"force": load_error},
        quantities={
            "mean_gap": float(np.maximum(gap, 0).mean()),
            "approach": tables.approach,
            "largest_pressure": float(pressure.max()),
            "mean_contact_pressure": float(pressure[pressure > 0].mean()),
        },
    )
    fields = {
        "pressure": pressure,
        "gap": gap,
        "displacement": tables.lowered,
        "state": state,
    }
    return step, fields


def solve(
    scene: Scene,
    options: Mapping[str, Any] | None = None,
    *,
    element: str = ELEMENT,
    penalty: float = PENALTY,
    on_load: Callable[[ContactResult], None] | None = None,
) -> ContactResult:
    """Solve a scene by CalculiX on the block of `fem_check`.

    Args:
        scene: the scene; all mean pressures must be positive.
        options: those of `FemOptions`, with the law "elastic" or "j2" and the geometry
            "gap"; None: the defaults.
        element: CalculiX's name of the element, such as "C3D8I".
        penalty: stiffness of a spring over Young's modulus times the grid spacing.
        on_load: called for each load, after the last one is solved, with the result up
            to this load, whose fields belong to it.

    Returns:
        The result, with a load step for each mean pressure and the fields of the last
        one.  Its areas are those of `fem_check.result`.

    Raises:
        InvalidScene: if the options are not valid, or CalculiX is not used for them or
            for such a load.
        NotConverged: if CalculiX fails.
    """
    given = FemOptions(**(options or {}))
    problem = problem_of(scene, given, 1)
    started = time.perf_counter()
    block = problem.block
    nx, ny = block.shape
    text = deck(problem, scene, given, element, penalty)
    with tempfile.TemporaryDirectory(prefix="epcontact-") as folder:
        printed, iterations = _run_ccx(text, Path(folder))
    tables = iter(printed)
    described = {
        **asdict(given),
        "depth": block.depth,
        "element": element,
        "layers": len(block.layers),
        "first_layer": float(block.layers[0]),
        "solver": PROGRAM,
    }
    steps = []
    # The fields of a line are without the second axis.
    shape = scene.surface.shape
    for load in scene.load.path:
        step_tables = _read_step(tables, (nx, ny), given.law == "j2")
        step, fields = _result_of_step(problem, scene, load, step_tables)
        steps.append(step)
        of_scene = {name: values.reshape(shape) for name, values in fields.items()}
        result = ContactResult(
            method="calculix",
            steps=tuple(steps),
            provenance=Provenance(scene.digest, scene.surface.seed, described),
            distribution=distribution(fields["pressure"], fields["state"], np.inf),
            fields={"heights": scene.surface.heights, **of_scene},
            cost={
                "seconds": time.perf_counter() - started,
                "iterations": iterations,
                "unknowns": 3 * nx * ny * len(block.layers),
            },
            notes=(*scene.surface.notes, *_unused_hardness(scene, given)),
        )
        if on_load is not None:
            on_load(result)
    return result


def _unused_hardness(scene: Scene, options: FemOptions) -> tuple[str, ...]:
    """Return a note that the hardness of a scene has no effect; () without a hardness.

    `options` have the law.
    """
    hardness = scene.material.hardness
    if math.isinf(hardness):
        return ()
    return (
        f"the hardness of {hardness:.3g} Pa has no effect on CalculiX, which has no "
        f"cap on the pressure: the law is {options.law}",
    )


# --- files for other codes


def export(scene: Scene, file: Path, options: Mapping[str, Any]) -> str:
    """Write the finite-element block of a scene to a file for another code.

    Args:
        scene: the scene.
        file: its ending selects the format: .inp is an input file of CalculiX, and the
            endings of `_FORMATS` are meshes with "top", "base" and "gap" on their
            nodes.
        options: those of `FemOptions`.

    Returns:
        A sentence for the user on what the file contains.

    Raises:
        InvalidScene: if the ending is another one, the options do not fit the scene or,
            for .inp, CalculiX, or meshio needs a package that is not installed.
        OutputError: if the file cannot be written.
    """
    given = FemOptions(**options)
    problem = problem_of(scene, given, 1)
    mesh = mesh_of(problem, reference=True)
    if file.suffix not in (".inp", *_FORMATS):
        raise InvalidScene(
            f"{file} ends in {file.suffix!r}, but must end in .inp (an input file of "
            f"CalculiX) or {', '.join(_FORMATS)}"
        )
    description = _describe(scene, given)
    with atomic_write(file) as temporary:
        if file.suffix == ".inp":
            comments = "".join(f"** {line}\n" for line in description)
            text = comments + deck(problem, scene, given)
            Path(temporary).write_text(text, encoding="utf-8")
        else:
            _write_mesh(mesh, temporary, file)
    size = f"{len(mesh.points)} nodes and {problem.bricks.number} bricks"
    return f"{file}: {size}; {'; '.join(description)}"


def _describe(scene: Scene, options: FemOptions) -> list[str]:
    """Return phrases on the body, the material and the loads of a scene.

    `options` have the law.  The phrases are comments of the exported file.
    """
    material = scene.material
    loads = ", ".join(f"{pressure:g}" for pressure in scene.load.path)
    return [
        *_unused_hardness(scene, options),
        f"the block of the scene {scene.digest} in SI units, {scene.body.kind}",
        f"E {material.young_modulus:g} Pa, nu {material.poisson_ratio:g}, yield stress "
        f"{material.yield_stress:g} Pa, hardness {material.hardness:g} Pa, law "
        f"{options.law}",
        *_describe_hardening(material),
        f"mean pressures {loads} Pa",
    ]


def _describe_hardening(material: Material) -> list[str]:
    """Return a phrase on the hardening of a material; no phrase if it has none."""
    return [
        f"{name.replace('_', ' ')} {law.text(getattr(material, name))}"
        for name, law in material.hardening.items()
    ]


def _write_mesh(mesh: Any, path: Any, file: Path) -> None:
    """Write a `meshio.Mesh`, and change its node sets to data on the nodes.

    Args:
        mesh: the mesh; its sets become data of 1 in the set and 0 elsewhere, because
            meshio does not write sets in these formats.  The data are floats, because
            VTK does not read meshio's small integers.
        path: where to write.
        file: the file that the user named; its ending selects the format.

    Raises:
        InvalidScene: if meshio needs a package that is not installed.
    """
    for name, nodes in mesh.point_sets.items():
        mesh.point_data[name] = np.zeros(len(mesh.points))
        mesh.point_data[name][nodes] = 1
    mesh.point_sets = {}
    extra = {}
    if file.suffix == ".xdmf":
        extra["data_format"] = "XML"  # inside of the file, not in a second one
    try:
        mesh.write(path, file_format=_FORMATS[file.suffix], **extra)
    except ImportError as error:
        raise InvalidScene(
            f"meshio cannot write {file}: {sentence_of(error)}"
        ) from None
