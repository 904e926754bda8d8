"""An independent check of a converged state, by plain scikit-fem.

The check takes from the fast elements only the displacements and the contact forces of
the state, and the plastic strains before and after its last increment.  The strains,
the mean dilatation, the radial return and the nodal forces are those of `plain`, which
shares nothing with the fast loops.  A wrong term of the law, a wrong yield stress, a
wrong element or a wrong sign in these loops is seen as forces that are not in balance
or as plastic strains that differ.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from skfem import MeshHex

from epcontact.results import FloatArray
from fem_check import plain
from fem_check.element import CORNERS
from fem_check.mesh import CERTIFIED_AT_ONCE, PeriodicBlock
from fem_check.plasticity import History
from fem_check.problem import Problem, State

IntArray = NDArray[np.integer]

#: Rows of a tensor as indices into xx, yy, zz, xy, yz, zx.
_TENSOR = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])


def certify(
    problem: Problem,
    law: plain.Law,
    state: State,
    before: History,
    after: History,
    largest_force: float,
) -> dict[str, float]:
    """Return the residuals of a state, computed anew by plain finite elements.

    Args:
        problem: the finite-element problem.
        law: of the material, by `plain.law_of`.
        state: converged state of the problem.
        before: plastic strains of the elements before the last increment.
        after: plastic strains of the elements at the state.
        largest_force: largest total contact force of the load path in N, to which the
            forces are relative.

    Returns:
        A dictionary of dimensionless residuals: `certified_balance`, the norm of the
            unbalanced nodal forces; `certified_load`, the absolute difference between
            the reaction of the base and the sum of the contact forces; and for a body
            that flows `certified_flow`, the largest difference of a plastic strain,
            over the largest accumulated plastic strain, or over the uniaxial yield
            strain if that is larger.
    """
    block = problem.block
    positions = block.positions()
    u = problem.physical_displacement(state.displacement)
    force = np.zeros(block.field_shape)
    flow_error = 0.0
    for part in _parts(block):
        elements, node = _elements_of_part(block, positions, part)
        dofs = elements.basis.nodal_dofs
        displacement = np.empty(elements.basis.N)
        displacement[dofs] = u[node].T
        nodal, returned = elements.internal_force(
            law, displacement, _history_of_part(before, part)
        )
        np.add.at(force, node, nodal[dofs].T)
        if law.flows:
            expected = _history_of_part(after, part)
            for found, other in zip(returned.history, expected, strict=True):
                difference = float(np.abs(found - other).max())
                flow_error = max(flow_error, difference)
    base_reaction = float(force[-1, ..., 2].sum())
    load = float(state.forces.sum())
    problem.force_on_unknowns(force)
    force[0, ..., 2] += state.forces
    balance = float(np.linalg.norm(problem.clear_base(force)))
    scale = largest_force or 1.0  # without any force on the path, all forces are zero
    residuals = {
        "certified_balance": balance / scale,
        "certified_load": abs(base_reaction - load) / scale,
    }
    if law.flows:
        yield_strain = law.segments[0][1] / (3 * law.shear_modulus)
        strain = max(float(after.accumulated.max()), yield_strain)
        residuals["certified_flow"] = flow_error / strain
    return residuals


class _Part(NamedTuple):
    """Some rows of elements of one layer, which are checked at once.

    Attributes:
        layer: number of the layer, 0 at the top.
        first: number along x of the first row of elements.
        stop: number of the first row beyond the part.
        elements: numbers of the part's elements in the block.
    """

    layer: int
    first: int
    stop: int
    elements: slice


def _parts(block: PeriodicBlock) -> Iterator[_Part]:
    """Yield the parts of the block, of some `CERTIFIED_AT_ONCE` elements each."""
    nx, ny = block.shape
    rows = max(1, CERTIFIED_AT_ONCE // ny)
    for layer in range(len(block.layers)):
        for first in range(0, nx, rows):
            stop = min(first + rows, nx)
            of_block = slice((layer * nx + first) * ny, (layer * nx + stop) * ny)
            yield _Part(layer, first, stop, of_block)


def _elements_of_part(
    block: PeriodicBlock, positions: FloatArray, part: _Part
) -> tuple[plain.Elements, tuple[IntArray, IntArray, IntArray]]:
    """Return the elements of a part of the block, and where their nodes are.

    The mesh of the part has one more column of nodes along x and y than it has
    elements.  Beyond the period these are copies of the first ones.

    Args:
        block: the periodic block with nx times ny nodes on a level.
        positions: (nz + 1, nx, ny, 3) positions of its nodes, in m.
        part: of the block.

    Returns:
        The elements, in the order of the block's, and the numbers (level, along x,
        along y) of each node of the mesh in the block.
    """
    nx, ny = block.shape
    count = part.stop - part.first
    level, i, j = np.indices((2, count + 1, ny + 1)).reshape(3, -1)
    along_x = i + part.first
    node = level + part.layer, along_x % nx, j % ny
    points = positions[node].T.copy()
    points[0] += (along_x == nx) * nx * block.spacing[0]
    points[1] += (j == ny) * ny * block.spacing[1]
    number = np.arange(level.size).reshape(2, count + 1, ny + 1)
    corners = [number[1 - z, x : count + x, y : ny + y].ravel() for x, y, z in CORNERS]
    mesh = MeshHex(points, np.stack(corners), validate=False, sort_t=False)
    return plain.Elements(mesh), node


def _history_of_part(history: History, part: _Part) -> plain.History:
    """Return the history of a part's elements, as `plain` has it.

    Args:
        history: of all elements, or of none for an elastic body.
        part: of the block.
    """
    if not history.rows.size:
        return plain.initial_history(part.elements.stop - part.elements.start)
    rows = history.rows[part.elements]
    strain = history.plastic_strain[rows][:, _TENSOR]  # (elements, 3, 3, 8)
    return plain.History(np.moveaxis(strain, 0, 2), history.accumulated[rows])
