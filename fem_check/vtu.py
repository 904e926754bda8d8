"""Write the finite-element body: two .vtu files for each point of the load path, a .pvd over them.

`step-0000.vtu` is the body.  Its points are those of the *undeformed* rough body, and carry the
displacement (m), so that ParaView's Warp By Vector shows the deformed body; the roughness of a gap
geometry is added here, shared out over the layers as in the moved geometry.  They also carry the
equivalent plastic strain and the nodal stress (means of the Gauss points around a node,
volume-weighted), and its von Mises norm.  Cells carry the means over an element.

`step-0000-surface.vtu` is its top as quadrilaterals, with displacement, contact_pressure, gap and
state.  In both files each array has its unit, and the field data say where it comes from.  Files
are written under a temporary name and renamed, so that no half-written file is left.
"""

from __future__ import annotations

import contextlib
import functools
import os
import platform
import secrets
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import OutputError
from epcontact.results import FloatArray
from fem_check import plasticity
from fem_check.path import PathPoint
from fem_check.plasticity import History
from fem_check.problem import Problem, State

#: The unit of each array; "1" has none.
UNITS = {
    "displacement": "m",
    "stress": "Pa",
    "von_mises": "Pa",
    "equivalent_plastic_strain": "1",
    "contact_pressure": "Pa",
    "gap": "m",
    "plastic_displacement": "m",
    "state": "1",
    "mean_pressure": "Pa",
    "young_modulus": "Pa",
    "yield_stress": "Pa",
    "hardness": "Pa",
    "depth": "m",
}

_HEXAHEDRON, _QUADRILATERAL = 12, 9  # VTK's numbers of the kinds of cells
#: VTK's order of a hexahedron's corners.
_VTK_CORNERS = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
)


def step_name(number: int) -> str:
    """The file name of one point of the path."""
    return f"step-{number:04d}.vtu"


def write_step(
    folder: Path,
    number: int,
    problem: Problem,
    point: PathPoint,
    history: History,
    about: Mapping[str, str | float] | None = None,
) -> Path:
    """Write the body and its surface at one point of the path.

    Args:
        folder: the folder of the path's files.
        number: of the point.
        problem, point, history: the problem, its state and the material's history there.
        about: field data, such as the digest of the scene.

    Returns:
        The file of the body.

    Raises:
        OutputError: a file could not be written.
    """
    points, cells, nodes = _mesh(problem)
    point_data, cell_data = _data(problem, point.state, history)
    told = {"mean_pressure": point.mean_pressure, **(about or {})}
    body = _grid(points, cells, _HEXAHEDRON)
    _add(body.GetPointData(), {name: values[nodes] for name, values in point_data.items()})
    _add(body.GetCellData(), cell_data)
    # The points of the top come first, and each brick of the top layer has its last face there.
    nx, ny = problem.block.shape
    count = (nx + 1) * (ny + 1)
    top = _grid(points[:count], cells[: nx * ny, 4:], _QUADRILATERAL)
    on_top: dict[str, NDArray[Any]] = {
        "contact_pressure": (point.state.forces / problem.block.node_area).ravel(),
        "gap": point.gap.ravel(),
        "state": point.surface_states.astype(np.uint8).ravel(),
    }
    if problem.capped:
        on_top["plastic_displacement"] = point.plastic_displacement.ravel()
    on_top["displacement"] = point_data["displacement"]
    _add(top.GetPointData(), {name: values[nodes[:count]] for name, values in on_top.items()})
    target = folder / step_name(number)
    for grid, path in ((body, target), (top, folder / surface_name(number))):
        _add_field_data(grid, told)
        _write_atomically(path, functools.partial(_write_grid, grid))
    return target


def surface_name(number: int) -> str:
    """The file name of the surface at one point of the path."""
    return f"step-{number:04d}-surface.vtu"


def write_collection(folder: Path, mean_pressures: Sequence[float]) -> Path:
    """Write path.pvd, the list of the steps' files.  Raises OutputError.

    Its time is the number of the step, because a path may unload; the mean pressure (Pa) is in the
    `name` of each step.  Part 0 of a step is the body, part 1 its surface.
    """
    lines = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "<Collection>"]
    for number, pressure in enumerate(mean_pressures):
        for part, name in enumerate((step_name(number), surface_name(number))):
            lines.append(
                f'<DataSet timestep="{number}" part="{part}" '
                f'name="mean pressure {float(pressure)!r} Pa" file={quoteattr(name)}/>'
            )
    text = "\n".join([*lines, "</Collection>", "</VTKFile>", ""])
    target = folder / "path.pvd"
    _write_atomically(target, lambda path: Path(path).write_text(text, encoding="utf-8"))
    return target


def _grid(points: FloatArray, cells: NDArray[np.int64], kind: int) -> Any:
    """Return VTK's unstructured grid of cells of one kind."""
    import pyvista as pv  # slow to load, and few solves write files

    rows = np.column_stack([np.full(len(cells), cells.shape[1]), cells])
    return pv.UnstructuredGrid(rows.ravel(), np.full(len(cells), kind, np.uint8), points)


def _add(data: Any, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Add arrays to the data of points or cells, each with its unit."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkDataArray

    for name, values in arrays.items():
        array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
        array.SetName(name)
        array.GetInformation().Set(vtkDataArray.UNITS_LABEL(), UNITS[name])
        data.AddArray(array)


def _add_field_data(grid: Any, about: Mapping[str, str | float]) -> None:
    from vtkmodules.vtkCommonCore import vtkDoubleArray, vtkStringArray

    units = {f"unit.{name}": UNITS[name] for name in (*UNITS, *about) if name in UNITS}
    for name, value in {**about, **units}.items():
        array: Any = vtkStringArray() if isinstance(value, str) else vtkDoubleArray()
        array.SetName(name)
        array.InsertNextValue(value)
        grid.GetFieldData().AddArray(array)


def _write_grid(grid: Any, path: str) -> None:
    """Write a grid, compressed.  Raises OSError."""
    from vtkmodules.vtkCommonCore import vtkObject
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.SetDataModeToAppended()
    writer.EncodeAppendedDataOff()
    writer.SetHeaderTypeToUInt64()
    writer.SetCompressorTypeToLZ4()
    writer.SetFileName(path)
    Path(path).touch()  # the system's own reason, where the file cannot be made
    shown = vtkObject.GetGlobalWarningDisplay()
    vtkObject.GlobalWarningDisplayOff()
    try:
        if not writer.Write() or writer.GetErrorCode():
            raise OSError("VTK could not write all of it; is the disk full?")
    finally:
        vtkObject.SetGlobalWarningDisplay(shown)


def _write_atomically(target: Path, write: Callable[[str], object]) -> None:
    """Call `write` with a temporary name beside `target`, and rename the file at the end."""
    # Not `tempfile`, because only their owner could read its files.
    # The harness, by which a process may be killed, knows its files by this name.
    owner = f"{platform.node()}-{os.getpid()}"
    temporary = target.with_name(f".epcontact-{owner}-{secrets.token_hex(6)}{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        write(str(temporary))
        os.replace(temporary, target)
    except OSError as error:
        raise OutputError(f"{target} could not be written: {error.strerror or error}") from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def _mesh(problem: Problem) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]:
    """Points, with copies that close the periodic edge; cells; the block's node of each point."""
    block = problem.block
    nz, (nx, ny) = len(block.layers), block.shape
    where = block.positions()
    if block.moved is None:
        fade = 1 + block.levels / block.depth
        where[..., 2] += fade[:, None, None] * (problem.heights - problem.heights.mean())
    k, i, j = np.meshgrid(np.arange(nz + 1), np.arange(nx + 1), np.arange(ny + 1), indexing="ij")
    nodes = ((k * nx + i % nx) * ny + j % ny).ravel()
    points = where.reshape(-1, 3)[nodes]
    points[:, 0] += (i == nx).ravel() * nx * block.spacing[0]
    points[:, 1] += (j == ny).ravel() * ny * block.spacing[1]
    k, i, j = np.meshgrid(np.arange(nz), np.arange(nx), np.arange(ny), indexing="ij")
    cells = np.empty((nz * nx * ny, 8), dtype=np.int64)
    for c, (cx, cy, cz) in enumerate(_VTK_CORNERS):
        cells[:, c] = (((k + 1 - cz) * (nx + 1) + i + cx) * (ny + 1) + j + cy).ravel()
    return points, cells, nodes


def _data(
    problem: Problem, state: State, history: History
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    bricks = problem.bricks
    u, past = state.displacement.reshape(-1, 3), history if problem.plastic else None
    stress = plasticity.stresses(u, bricks, problem.law, past)
    weights = bricks.weights[bricks.shape_of]
    volumes = weights.sum(axis=1)
    mean_stress = np.einsum("eig,eg->ei", stress, weights) / volumes[:, None]
    strain = np.zeros(bricks.number)
    if problem.plastic:
        accumulated = history.accumulated[history.rows]
        strain = np.einsum("eg,eg->e", accumulated, weights) / volumes
    shared = np.bincount(bricks.connectivity.ravel(), np.repeat(volumes, 8), len(u))

    def at_nodes(values: FloatArray) -> FloatArray:
        return (
            np.bincount(bricks.connectivity.ravel(), np.repeat(values * volumes, 8), len(u))
            / shared
        )

    nodal = np.stack([at_nodes(mean_stress[:, i]) for i in range(6)], axis=1)
    point_data = {
        "displacement": u,
        "stress": nodal,
        "von_mises": von_mises(nodal),
        "equivalent_plastic_strain": at_nodes(strain),
    }
    cell_data = {
        "stress": mean_stress,
        "von_mises": von_mises(mean_stress),
        "equivalent_plastic_strain": strain,
    }
    return point_data, cell_data


def von_mises(stress: FloatArray) -> FloatArray:
    """The von Mises norm of stresses.

    Args:
        stress: (..., 6) components xx, yy, zz, xy, yz, zx.

    Example:
        >>> float(von_mises(np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0])))
        2.0
    """
    s = np.moveaxis(stress, -1, 0)
    normal = (s[0] - s[1]) ** 2 + (s[1] - s[2]) ** 2 + (s[2] - s[0]) ** 2
    result: FloatArray = np.sqrt(normal / 2 + 3 * (s[3] ** 2 + s[4] ** 2 + s[5] ** 2))
    return result
