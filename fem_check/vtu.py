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
from fem_check.element import CORNERS
from fem_check.options import FemOptions
from fem_check.path import PathPoint
from fem_check.plasticity import History
from fem_check.problem import Problem, State

#: Units of the arrays and field data; "1" is dimensionless.
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

#: Properties of the material that the field data contain.
_MATERIAL = ("young_modulus", "poisson_ratio", "yield_stress", "hardness")

#: Suffixes of the names of a step's two files: the body and its surface.
SUFFIXES = (".vtu", "-surface.vtu")

#: Corners of a hexahedron in the order of meshio and VTK.
_VTK_CORNERS = CORNERS[[0, 3, 6, 2, 1, 5, 7, 4]]


def mesh_of(
    problem: Problem,
    state: State | None = None,
    history: History | None = None,
    *,
    reference: bool = False,
) -> Any:
    """Return the block of a problem as a `meshio.Mesh`, for other finite-element codes.

    Args:
        problem: as in `solve_path(...).problem`.
        state: adds data to the points: the displacement (m), and the stress (Pa, as
            xx, yy, zz, xy, yz, zx), its von Mises norm and the equivalent plastic
            strain as volume-weighted means of the Gauss points around a node.  The
            cells get their means over an element.  None: no data.
        history: of the elements at that state, if the material can flow.
        reference: whether the points are those of the block in which the elements
            are solved.  Its top is flat in the gap geometry; the data of the points
            then contain the "gap" (m) from the top nodes to a flat on the highest
            of them, and 0 elsewhere.

    Returns:
        Hexahedra over one period, with the point sets "top" and "base".  By default
        the points are those of the undeformed rough body, and the roughness of a
        gap geometry is spread over the layers.  Copies of the first nodes close the
        periodic edges.

    Example:
        >>> from fem_check.element import CORNERS
        >>> from fem_check.options import FemOptions
        >>> from fem_check.driver import problem_of
        >>> from epcontact.scene import Load, Material, Scene, Surface
        >>> surface = Surface(np.zeros((4, 4)), (1.0, 1.0))
        >>> scene = Scene(surface, Material(1.0, 0.3), Load(0.01))
        >>> mesh = mesh_of(problem_of(scene, FemOptions(law="elastic", layers=2)))
        >>> len(mesh.points), len(mesh.point_sets["top"])
        (75, 25)
        >>> mesh.cells_dict["hexahedron"].shape
        (32, 8)
    """
    import meshio  # slow to load, and few solves write files

    block = problem.block
    nx, ny = block.shape
    nz = len(block.layers)
    positions = block.positions()
    if block.moved is None and problem.tilt is None and not reference:
        fraction = 1 + block.levels / block.depth
        roughness = problem.heights - problem.heights.mean()
        positions[..., 2] += fraction[:, None, None] * roughness
    nodes = close_periods(np.arange((nz + 1) * nx * ny).reshape(nz + 1, nx, ny)).ravel()
    points = positions.reshape(-1, 3)[nodes].reshape(nz + 1, nx + 1, ny + 1, 3)
    points[:, -1, :, 0] += nx * block.spacing[0]
    points[:, :, -1, 1] += ny * block.spacing[1]
    number = np.arange(len(nodes)).reshape(nz + 1, nx + 1, ny + 1)
    corners = [
        number[1 - z : nz + 1 - z, x : nx + x, y : ny + y].ravel()
        for x, y, z in _VTK_CORNERS
    ]
    point_data: dict[str, FloatArray] = {}
    cell_data: dict[str, FloatArray] = {}
    if state is not None:
        point_data, cell_data = _data(problem, state, history)
    if reference:
        gap = np.zeros(block.field_shape[:3])
        gap[0] = problem.heights.max() - problem.heights
        point_data["gap"] = gap.ravel()
    return meshio.Mesh(
        points.reshape(-1, 3),
        [("hexahedron", np.stack(corners, axis=1))],
        {name: values[nodes] for name, values in point_data.items()},
        {name: [values] for name, values in cell_data.items()},
        point_sets={"top": number[0].ravel(), "base": number[-1].ravel()},
    )


def close_periods(field: NDArray[Any]) -> NDArray[Any]:
    """Return a field with its first row and column along x and y copied to the end.

    Args:
        field: (..., nx, ny) of any type.

    Returns:
        (..., nx + 1, ny + 1) new array.
    """
    unchanged = [(0, 0)] * (field.ndim - 2)
    return np.pad(field, [*unchanged, (0, 1), (0, 1)], mode="wrap")


def write_step(
    folder: Path,
    number: int,
    scene: Scene,
    options: FemOptions,
    problem: Problem,
    point: PathPoint,
    history: History,
) -> None:
    """Write the body and its surface at one point of the path.

    Args:
        folder: in which the two files are written.
        number: of the point, from 0.
        scene: the scene.
        options: of the solve.
        problem: the problem.
        point: of the path.
        history: of the elements at this point.

    Raises:
        OutputError: a file could not be written.
    """
    material = {name: getattr(scene.material, name) for name in _MATERIAL}
    field_data = {
        "mean_pressure": point.mean_pressure,
        "method": "fem",
        "law": options.law,
        "geometry": options.geometry,
        "scene": scene.digest,
        **material,
        "body": scene.body.kind,
        "depth": problem.block.depth,
        "notes": "; ".join(scene.surface.notes),
    }
    for name, version in package_versions().items():
        field_data[f"version.{name}"] = version
    body = mesh_of(problem, point.state, history)
    top = _top_of(body, problem, point)
    for mesh, suffix in zip((body, top), SUFFIXES, strict=True):
        with atomic_write(folder / step_name(number, suffix)) as temporary:
            _write_grid(mesh, field_data, str(temporary))


def _top_of(body: Any, problem: Problem, point: PathPoint) -> Any:
    """Return the top of the body as a `meshio.Mesh` of quadrilaterals.

    Its points have contact pressure (Pa), gap (m), state, displacement (m), and the
    plastic displacement (m) of a capped body.

    Args:
        body: mesh of the body from `mesh_of`, with displacements.
        problem: the finite-element problem.
        point: of the load path.
    """
    import meshio

    top = body.point_sets["top"]
    bricks = body.cells[0].data
    fields: dict[str, NDArray[Any]] = {
        "contact_pressure": point.state.forces / problem.block.node_area,
        "gap": point.gap,
        "state": point.surface_states.astype(np.uint8),
    }
    if problem.capped:
        fields["plastic_displacement"] = point.plastic_displacement
    data = {name: close_periods(values).ravel() for name, values in fields.items()}
    data["displacement"] = body.point_data["displacement"][top]
    # The points of the top come first, and the last four corners of each brick of the
    # top layer are on the top.
    faces = bricks[: problem.heights.size, 4:]
    return meshio.Mesh(body.points[top], [("quad", faces)], data)


def _write_grid(mesh: Any, field_data: Mapping[str, str | float], path: str) -> None:
    """Write a mesh with units and field data, which meshio cannot write.

    VTK's own writer is used because pyvista's crashes on a full disk.

    Args:
        mesh: a `meshio.Mesh`, whose data have their units in `UNITS`.
        field_data: values that describe the complete file, by name.
        path: of the .vtu file.

    Raises:
        OSError: VTK could not write the complete file.
    """
    import pyvista as pv
    from vtkmodules.vtkCommonCore import vtkDataArray
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    grid = pv.from_meshio(mesh)
    grid.point_data.update(mesh.point_data)  # with the types of its numbers
    for data in (grid.point_data, grid.cell_data):
        for name in data:
            information = data.GetAbstractArray(name).GetInformation()
            information.Set(vtkDataArray.UNITS_LABEL(), UNITS[name])
    for name, value in field_data.items():
        grid.field_data[name] = [value]
    for name, unit in UNITS.items():
        grid.field_data[f"unit.{name}"] = [unit]
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
    """Return the data of the block's nodes and of its elements, by name.

    Both have `stress` (Pa), `von_mises` (Pa) and `equivalent_plastic_strain`; the nodes
    also have the `displacement` (m).

    Args:
        problem: the finite-element problem.
        state: state with the displacements.
        history: plastic strains of the elements at this state, or None.
    """
    bricks = problem.bricks
    if not problem.plastic:
        history = None
    u = problem.physical_displacement(state.displacement).reshape(-1, 3)
    stress = plasticity.stresses(u, bricks, problem.law, history)
    weights = bricks.weights[bricks.shape_of]
    volumes = weights.sum(axis=1)
    # The columns of values (elements, 7): six stresses and the plastic strain.
    values = np.zeros((bricks.number, 7))
    values[:, :6] = np.einsum("eig,eg->ei", stress, weights) / volumes[:, None]
    if history is not None:
        strain = history.accumulated[history.rows]
        values[:, 6] = np.einsum("eg,eg->e", strain, weights) / volumes
    corners = bricks.connectivity.ravel()
    nodal_volumes = np.bincount(corners, np.repeat(volumes, 8), len(u))
    nodal_values = np.empty((len(u), 7))
    for column in range(7):
        weighted = np.repeat(values[:, column] * volumes, 8)
        nodal_values[:, column] = np.bincount(corners, weighted, len(u)) / nodal_volumes
    return {"displacement": u, **_named(nodal_values)}, _named(values)


def _named(values: FloatArray) -> dict[str, FloatArray]:
    """Return stresses, their von Mises norm and the plastic strain by name.

    Args:
        values: (n, 7): stresses xx, yy, zz, xy, yz, zx in Pa, and the plastic strain.
    """
    stress = values[:, :6]
    return {
        "stress": stress,
        "von_mises": von_mises(stress),
        "equivalent_plastic_strain": values[:, 6],
    }


def von_mises(stress: FloatArray) -> FloatArray:
    """Return the (...) von Mises norm of stresses, in Pa.

    Args:
        stress: (..., 6) components xx, yy, zz, xy, yz, zx, in Pa.
    """
    xx, yy, zz, xy, yz, zx = np.moveaxis(stress, -1, 0)
    normal = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    return np.asarray(np.sqrt(normal / 2 + 3 * (xy**2 + yz**2 + zx**2)))
