"""An independent check of a converged state: scikit-fem's own mesh, basis and assembly.

`certify` hands the stresses at the Gauss points to scikit-fem, which assembles the internal
force  int sigma : grad(v) dV  layer by layer and compares it with the contact forces.  With
stresses whose mean part is constant in an element, this standard form is the B-bar element's
internal force.  Only the stresses come from the solver's own loops.
"""

from __future__ import annotations

import numpy as np
from skfem import Basis, ElementHex1, LinearForm, MeshHex

from epcontact.results import FloatArray
from fem_check.element import CORNERS
from fem_check.mesh import PeriodicBlock
from fem_check.plasticity import History
from fem_check.problem import Problem, State

#: Rows of the stress tensor as indices into xx, yy, zz, xy, yz, zx.
_ROWS = ((0, 3, 5), (3, 1, 4), (5, 4, 2))


def certify(problem: Problem, state: State, history: History, largest: float) -> dict[str, float]:
    """Residuals, over the path's `largest` force, of the force that scikit-fem assembles."""
    force, positions = np.zeros(problem.block.field_shape), problem.block.positions()
    for k in range(len(problem.block.layers)):
        stress, _ = problem.layer_stresses(state, history, k)
        force[k : k + 2] += _layer_force(problem.block, positions[k : k + 2], stress)
    reaction, pressed = float(force[-1, ..., 2].sum()), float(state.forces.sum())
    force[0, ..., 2] += state.forces
    total = largest or 1.0  # without any force on the path, all are zero
    return {
        "certified_balance": float(np.linalg.norm(problem.without_base(force))) / total,
        "certified_load": abs(reaction - pressed) / total,
    }


def _layer_force(block: PeriodicBlock, positions: FloatArray, stress: FloatArray) -> FloatArray:
    """The internal force of one layer, as a mesh of scikit-fem with (nx + 1)(ny + 1) columns."""
    nx, ny = block.shape
    level, i, j = np.indices((2, nx + 1, ny + 1)).reshape(3, -1)
    at = level, i % nx, j % ny
    points = positions[at].T.copy()
    points[0] += (i == nx) * nx * block.spacing[0]
    points[1] += (j == ny) * ny * block.spacing[1]
    number = np.arange(level.size).reshape(2, nx + 1, ny + 1)
    cells = np.stack([number[1 - z, x : nx + x, y : ny + y].ravel() for x, y, z in CORNERS])
    mesh = MeshHex(points, cells, validate=False, sort_t=False)
    basis = Basis(mesh, ElementHex1(), intorder=2)
    form = LinearForm(lambda v, w: w["x_"] * v.grad[0] + w["y_"] * v.grad[1] + w["z_"] * v.grad[2])
    out = np.zeros((2, nx, ny, 3))
    for component in range(3):
        x, y, z = stress[:, _ROWS[component]].swapaxes(0, 1)
        nodal = form.assemble(basis, x_=x, y_=y, z_=z)
        # Degree of freedom n of scikit-fem's scalar basis is not node n in general.
        np.add.at(out[..., component], at, nodal[basis.nodal_dofs[0]])
    return out
