"""The finite-element body as a mesh for other codes, and as files for ParaView.

`step-0000.vtu` is the body at one point of the load path, with the data of `mesh_of`,
and `step-0000-surface.vtu` its top as quadrilaterals.  Each array has its unit, and the
field data say where it comes from.  `path.pvd` is the list of the steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.files import atomic_write, step_name
from epcontact.results import FloatArray, package_versions
from epcontact.scene import Scene
from fem_check import plasticity
from fem_check.options import FemOptions
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

_STRENGTHS = ("young_modulus", "poisson_ratio", "yield_stress", "hardness")

#: The ends of the names of the files of a step.
ENDS = (".vtu", "-surface.vtu")

#: The corners of a hexahedron in the order of meshio and VTK.
_CORNERS = (
    (0, 0, 0),
    (1, 0, 0),
    (1, 1, 0),
    (0, 1, 0),
    (0, 0, 1),
    (1, 0, 1),
    (1, 1, 1),
    (0, 1, 1),
)


def mesh_of(
    problem: Problem,
    state: State | None = None,
    history: History | None = None,
    *,
    reference: bool = False,
) -> Any:
    """The block of a problem as a `meshio.Mesh`, which other finite-element codes can
    read.

    Args:
        problem: of `solve_path(...).problem`.
        state: whose displacement (m), nodal stress (Pa; means of the Gauss points
            around a node, volume-weighted, as xx, yy, zz, xy, yz, zx), von Mises norm
            and equivalent plastic strain are added to the points, and their means over
            an element to the cells.
        history: of the material at that state, if it can flow.
        reference: whether the points are those of the block in which the elements are
            solved, whose top is flat in a gap geometry, with the "gap" (m) that its top
            nodes then have to a flat on the highest of them as data of the points, and
            0 elsewhere.

    Returns:
        Hexahedra over one period, with the sets of nodes "top" and "base".  The points
        are those of the undeformed rough body; the roughness of a gap geometry is
        shared out over the layers. Copies of the first nodes close the periodic edges.

    Example:
        >>> from fem_check.options import FemOptions
        >>> from fem_check.driver import problem_of
        >>> from epcontact.scene import Load, Material, Scene, Surface
        >>> scene = Scene(Surface(np.zeros((4, 4)), (1.0, 1.0)), Material(1.0, 0.3), Load(0.01))
        >>> mesh = mesh_of(problem_of(scene, FemOptions(law="elastic", layers=2)))
        >>> len(mesh.points), mesh.cells_dict["hexahedron"].shape, len(mesh.point_sets["top"])
        (75, (32, 8), 25)
    """
    import meshio  # slow to load, and few solves write files

    block = problem.block
    nz, (nx, ny) = len(block.layers), block.shape
    where = block.positions()
    if block.moved is None and problem.tilt is None and not reference:
        fade = 1 + block.levels / block.depth
        where[..., 2] += fade[:, None, None] * (
            problem.heights - problem.heights.mean()
        )
    nodes = closed(np.arange(where[..., 0].size).reshape(where.shape[:3])).ravel()
    number = np.arange(len(nodes)).reshape(nz + 1, nx + 1, ny + 1)
    points = where.reshape(-1, 3)[nodes].reshape(*number.shape, 3)
    points[:, -1, :, 0] += nx * block.spacing[0]
    points[:, :, -1, 1] += ny * block.spacing[1]
    corners = [
        number[1 - z : nz + 1 - z, x : nx + x, y : ny + y].ravel()
        for x, y, z in _CORNERS
    ]
    on_points, on_cells = ({}, {}) if state is None else _data(problem, state, history)
    if reference:
        gap = np.zeros(block.field_shape[:3])
        gap[0] = problem.heights.max() - problem.heights
        on_points["gap"] = gap.ravel()
    return meshio.Mesh(
        points.reshape(-1, 3),
        [("hexahedron", np.stack(corners, axis=1))],
        {name: values[nodes] for name, values in on_points.items()},
        {name: [values] for name, values in on_cells.items()},
        point_sets={"top": number[0].ravel(), "base": number[-1].ravel()},
    )


def closed(field: NDArray[Any]) -> NDArray[Any]:
    """A (..., nx, ny) field with its first row and column copied to the end of the
    period.
    """
    return np.pad(field, [(0, 0)] * (field.ndim - 2) + [(0, 1), (0, 1)], mode="wrap")


def write_step(
    folder: Path,
    number: int,
    scene: Scene,
    options: FemOptions,
    problem: Problem,
    point: PathPoint,
    history: History,
) -> None:
    """Write the body and its surface at one point of the path.  Raises OutputError."""
    told = {
        "mean_pressure": point.mean_pressure,
        "method": "fem",
        "law": options.law,
        "geometry": options.geometry,
        "scene": scene.digest,
        **{name: getattr(scene.material, name) for name in _STRENGTHS},
        "body": scene.body.kind,
        "depth": problem.block.depth,
        "notes": "; ".join(scene.surface.notes),
        **{f"version.{name}": number for name, number in package_versions().items()},
    }
    body = mesh_of(problem, point.state, history)
    for mesh, end in zip((body, _top_of(body, problem, point)), ENDS, strict=True):
        with atomic_write(folder / step_name(number, end)) as temporary:
            _write_grid(mesh, told, str(temporary))


def _top_of(body: Any, problem: Problem, point: PathPoint) -> Any:
    """The top of the body's mesh as quadrilaterals, with the contact's fields."""
    import meshio

    top, cells = body.point_sets["top"], body.cells[0].data
    fields: dict[str, NDArray[Any]] = {
        "contact_pressure": point.state.forces / problem.block.node_area,
        "gap": point.gap,
        "state": point.surface_states.astype(np.uint8),
    }
    if problem.capped:
        fields["plastic_displacement"] = point.plastic_displacement
    data = {name: closed(values).ravel() for name, values in fields.items()}
    data["displacement"] = body.point_data["displacement"][top]
    # The points of the top come first, and each brick of the top layer has its last
    # face there.
    return meshio.Mesh(
        body.points[top], [("quad", cells[: problem.heights.size, 4:])], data
    )


def _write_grid(mesh: Any, about: Mapping[str, str | float], path: str) -> None:
    """Write a mesh with units and field data, which meshio leaves out; pyvista's writer
    crashes on a full disk.  Raises OSError.
    """
    import pyvista as pv
    from vtkmodules.vtkCommonCore import vtkDataArray
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    grid = pv.from_meshio(mesh)
    grid.point_data.update(mesh.point_data)  # with its own types of numbers
    for data in (grid.point_data, grid.cell_data):
        for name in data:
            told = data.GetAbstractArray(name).GetInformation()
            told.Set(vtkDataArray.UNITS_LABEL(), UNITS[name])
    units = {f"unit.{name}": UNITS[name] for name in (*UNITS, *about) if name in UNITS}
    for name, value in {**about, **units}.items():
        grid.field_data[name] = [value]
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    writer.EncodeAppendedDataOff()
    writer.SetCompressorTypeToLZ4()
    writer.SetFileName(path)
    with pv.vtk_verbosity("off"), pv.VtkErrorCatcher(send_to_logging=False):
        if not writer.Write() or writer.GetErrorCode():
            raise OSError("VTK could not write all of it; is the disk full?")


def _data(
    problem: Problem, state: State, history: History | None
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """The displacement, stresses and strains at the block's nodes and in its
    elements.
    """
    bricks, past = problem.bricks, history if problem.plastic else None
    u = problem.turned(state.displacement).reshape(-1, 3)
    stress = plasticity.stresses(u, bricks, problem.law, past)
    weights = bricks.weights[bricks.shape_of]
    volumes = weights.sum(axis=1)
    mean = np.einsum("eig,eg->ei", stress, weights) / volumes[:, None]
    strain = np.zeros(bricks.number)
    if past is not None:
        strain = np.einsum("eg,eg->e", past.accumulated[past.rows], weights) / volumes
    corners = bricks.connectivity.ravel()
    shared = np.bincount(corners, np.repeat(volumes, 8), len(u))
    both = np.column_stack([mean, strain])
    summed = [
        np.bincount(corners, np.repeat(v * volumes, 8), len(u)) / shared for v in both.T
    ]
    points, cells = (
        {
            "stress": s[:, :6],
            "von_mises": von_mises(s[:, :6]),
            "equivalent_plastic_strain": s[:, 6],
        }
        for s in (np.stack(summed, axis=1), both)
    )
    return {"displacement": u, **points}, cells


def von_mises(stress: FloatArray) -> FloatArray:
    """The von Mises norm of stresses (..., 6) with the components xx, yy, zz, xy, yz,
    zx.
    """
    s = np.moveaxis(stress, -1, 0)
    normal = (s[0] - s[1]) ** 2 + (s[1] - s[2]) ** 2 + (s[2] - s[0]) ** 2
    return np.asarray(np.sqrt(normal / 2 + 3 * (s[3] ** 2 + s[4] ** 2 + s[5] ** 2)))
