"""An independent check of a converged state: the internal force by scikit-fem."""

from __future__ import annotations

from typing import Any

import numpy as np
from skfem import Basis, ElementHex1, LinearForm, MeshHex

from epcontact.results import FloatArray
from fem_check.element import CORNERS
from fem_check.mesh import PeriodicBlock
from fem_check.plasticity import History
from fem_check.problem import Problem, State

#: Rows of the stress tensor as indices into xx, yy, zz, xy, yz, zx.
_ROWS = ((0, 3, 5), (3, 1, 4), (5, 4, 2))


def certify(
    problem: Problem, state: State, history: History, largest_force: float
) -> dict[str, float]:
    """Return the residuals of a state, with internal forces that scikit-fem assembles.

    Only the stresses come from the solver's own loops.  Their mean part is constant in
    an element, so that the standard form int sigma : grad(v) dV is the internal force
    of the B-bar element (mean dilatation).

    Args:
        problem: the finite-element problem.
        state: converged state of the problem.
        history: plastic strains of the elements at this state.
        largest_force: largest total contact force of the load path in N, to which the
            residuals are relative.

    Returns:
        A dictionary of two dimensionless residuals: `certified_balance`, the norm of
            the unbalanced nodal forces, and `certified_load`, the absolute difference
            between the reaction of the base and the sum of the contact forces.
    """
    block = problem.block
    positions = block.positions()
    force = np.zeros(block.field_shape)
    for k in range(len(block.layers)):
        stress, _ = problem.layer_stresses(state, history, k)
        force[k : k + 2] += _layer_force(block, positions[k : k + 2], stress)
    base_reaction = float(force[-1, ..., 2].sum())
    load = float(state.forces.sum())
    problem.force_on_unknowns(force)
    force[0, ..., 2] += state.forces
    balance = float(np.linalg.norm(problem.clear_base(force)))
    scale = largest_force or 1.0  # without any force on the path, all forces are zero
    return {
        "certified_balance": balance / scale,
        "certified_load": abs(base_reaction - load) / scale,
    }


def _work_density(v: Any, w: Any) -> Any:
    """Return one row of the stress tensor times the gradient of a test function.

    Args:
        v: test function of scikit-fem, with its gradient in 1/m.
        w: parameters of the form: the row's three stresses x_, y_ and z_, in Pa.
    """
    return w["x_"] * v.grad[0] + w["y_"] * v.grad[1] + w["z_"] * v.grad[2]


def _layer_force(
    block: PeriodicBlock, positions: FloatArray, stress: FloatArray
) -> FloatArray:
    """Return the internal force of one layer of elements, assembled by scikit-fem.

    The mesh of scikit-fem has (nx + 1) (ny + 1) columns of nodes; the last row and
    column of them are copies of the first, because the block is periodic.

    Args:
        block: the periodic block with nx times ny nodes on a level.
        positions: (2, nx, ny, 3) positions x, y, z of the nodes on the level above and
            on the level below the layer, in m.
        stress: (nx ny, 6, 8) stresses xx, yy, zz, xy, yz, zx at the eight Gauss points
            of each element, in Pa.

    Returns:
        (2, nx, ny, 3) forces on the nodes of these two levels, in N.
    """
    nx, ny = block.shape
    level, i, j = np.indices((2, nx + 1, ny + 1)).reshape(3, -1)
    node = level, i % nx, j % ny
    points = positions[node].T.copy()
    points[0] += (i == nx) * nx * block.spacing[0]
    points[1] += (j == ny) * ny * block.spacing[1]
    number = np.arange(level.size).reshape(2, nx + 1, ny + 1)
    corners = [number[1 - z, x : nx + x, y : ny + y].ravel() for x, y, z in CORNERS]
    mesh = MeshHex(points, np.stack(corners), validate=False, sort_t=False)
    basis = Basis(mesh, ElementHex1(), intorder=2)
    form = LinearForm(_work_density)
    force = np.zeros((2, nx, ny, 3))
    for component in range(3):
        x, y, z = stress[:, _ROWS[component]].swapaxes(0, 1)
        nodal = form.assemble(basis, x_=x, y_=y, z_=z)
        # Degree of freedom n of scikit-fem's scalar basis is not node n in general.
        np.add.at(force[..., component], node, nodal[basis.nodal_dofs[0]])
    return force
