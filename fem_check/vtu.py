"""Write the finite-element body: a .vtu file for each point of the load path, a .pvd over them.

Points carry displacement (m), the equivalent plastic strain and the nodal stress (means of the
Gauss points around a node, volume-weighted), its von Mises norm, contact_pressure, gap and state
of the top; the nodes below have pressure 0, gap NaN and state 0.  Cells carry the means over an
element.  Coordinates are those of the deformed rough body: the roughness of a gap geometry is added
here, shared out over the layers as in the moved geometry.  Files are written under a temporary name
and renamed, so that no half-written file is left.
"""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Callable, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import OutputError
from epcontact.results import APART, ELASTIC, FloatArray
from fem_check import plasticity
from fem_check.path import PathPoint
from fem_check.plasticity import History
from fem_check.problem import Problem, State, gap

#: VTK's order of a hexahedron's corners.
_VTK_CORNERS = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
)


def step_name(number: int) -> str:
    """The file name of one point of the path."""
    return f"step-{number:04d}.vtu"


def write_step(
    folder: Path, number: int, problem: Problem, point: PathPoint, history: History
) -> Path:
    """Write one point of the path, and return its file.  Raises OutputError."""
    import meshio  # slow to load, and few solves write files

    points, cells, nodes = _mesh(problem, point.state)
    point_data, cell_data = _data(problem, point.state, history, point.surface_states)
    mesh = meshio.Mesh(
        points,
        [("hexahedron", cells)],
        point_data={name: values[nodes] for name, values in point_data.items()},
        cell_data={name: [values] for name, values in cell_data.items()},
        field_data={},
    )
    target = folder / step_name(number)
    _write_atomically(target, lambda path: meshio.write(path, mesh, file_format="vtu"))
    return target


def write_collection(folder: Path, mean_pressures: Sequence[float]) -> Path:
    """Write path.pvd, the list of the steps' files.  Raises OutputError.

    Its time is the number of the step, because a path may unload; the mean pressure (Pa) is in the
    `name` of each step.
    """
    lines = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "<Collection>"]
    for number, pressure in enumerate(mean_pressures):
        lines.append(
            f'<DataSet timestep="{number}" part="0" name="mean pressure {float(pressure)!r} Pa" '
            f"file={quoteattr(step_name(number))}/>"
        )
    text = "\n".join([*lines, "</Collection>", "</VTKFile>", ""])
    target = folder / "path.pvd"
    _write_atomically(target, lambda path: Path(path).write_text(text, encoding="utf-8"))
    return target


def _write_atomically(target: Path, write: Callable[[str], object]) -> None:
    """Call `write` with a temporary name beside `target`, and rename the file at the end."""
    # Not `tempfile`, because only their owner could read its files.
    temporary = target.with_name(f".{secrets.token_hex(6)}{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        write(str(temporary))
        os.replace(temporary, target)
    except OSError as error:
        raise OutputError(f"{target} could not be written: {error.strerror or error}") from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def _mesh(
    problem: Problem, state: State
) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]:
    """Points, with copies that close the periodic edge; cells; the block's node of each point."""
    block = problem.block
    nz, (nx, ny) = len(block.layers), block.shape
    where = block.positions()
    if block.moved is None:
        fade = 1 + block.levels / block.depth
        where[..., 2] += fade[:, None, None] * (problem.heights - problem.heights.mean())
    where += state.displacement
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
    problem: Problem, state: State, history: History, states: NDArray[np.int8]
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    bricks = problem.bricks
    u, past = state.displacement.reshape(-1, 3), history if problem.plastic else None
    stress = plasticity.stresses(u, bricks, problem.law, past)
    weights = bricks.weights[bricks.shape_of]
    volumes = weights.sum(axis=1)
    mean_stress = np.einsum("eig,eg->ei", stress, weights) / volumes[:, None]
    strain = np.zeros(bricks.number)
    if problem.plastic:
        strain = np.einsum("eg,eg->e", history.accumulated, weights) / volumes
    shared = np.bincount(bricks.connectivity.ravel(), np.repeat(volumes, 8), len(u))

    def at_nodes(values: FloatArray) -> FloatArray:
        return (
            np.bincount(bricks.connectivity.ravel(), np.repeat(values * volumes, 8), len(u))
            / shared
        )

    nodal = np.stack([at_nodes(mean_stress[:, i]) for i in range(6)], axis=1)
    between = gap(problem, state.displacement, state.approach)
    between[state.states == ELASTIC] = 0.0
    point_data = {
        "displacement": u,
        "stress": nodal,
        "von_mises": von_mises(nodal),
        "equivalent_plastic_strain": at_nodes(strain),
        "contact_pressure": _on_top(problem, state.forces / problem.block.node_area, 0.0),
        "gap": _on_top(problem, between, np.nan),
        "state": _on_top(problem, states.astype(float), float(APART)),
    }
    cell_data = {
        "stress": mean_stress,
        "von_mises": von_mises(mean_stress),
        "equivalent_plastic_strain": strain,
    }
    return point_data, cell_data


def _on_top(problem: Problem, values: FloatArray, elsewhere: float) -> FloatArray:
    out = np.full(problem.block.field_shape[:3], elsewhere)
    out[0] = values
    return out.ravel()


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
