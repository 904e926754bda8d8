"""The judge of a converged state: scikit-fem's own mesh, basis and assembly.

`certify` hands the stresses at the Gauss points to scikit-fem, which assembles the internal
force  int sigma : grad(v) dV  layer by layer and compares it with the contact forces.  With
stresses whose mean part is constant in an element, this standard form is the B-bar element's
internal force.  Nothing of the solver's loops takes part but the stresses themselves.
`assembled_stiffness` is the elastic stiffness as scikit-fem assembles it: deviatoric part at the
Gauss points, dilatation by the element's mean.
"""

from __future__ import annotations

import numpy as np

from epcontact.results import FloatArray
from fem_check import plasticity
from fem_check.element import CORNERS
from fem_check.mesh import Block
from fem_check.plasticity import History
from fem_check.problem import Problem, State

_PAIR = ((0, 3, 5), (3, 1, 4), (5, 4, 2))


def certify(problem: Problem, state: State, history: History) -> dict[str, float]:
    """certified_balance: norm of (assembled internal force + contact forces) over the total
    contact force, all but the held base; certified_load: relative difference of the base's
    reaction and the contact forces' sum.  Where nothing touches, both are forces in N, as the
    solver's own residuals are."""
    u = state.displacement
    count = problem.bricks.number
    if not problem.plastic:
        history = plasticity.virgin(count)
    stress = plasticity.stresses(u.reshape(-1, 3), problem.bricks, problem.law, history)
    force = assembled_force(problem.block, stress)
    reaction = float(force[-1, ..., 2].sum())
    force[0, ..., 2] += state.forces
    if problem.block.sliding:
        force[-1, ..., 2] = 0
    else:
        force[-1] = 0
    pressed = float(state.forces.sum())
    total = pressed or 1.0
    return {
        "certified_balance": float(np.linalg.norm(force)) / total,
        "certified_load": abs(reaction - pressed) / total,
    }


def assembled_force(block: Block, stress: FloatArray) -> FloatArray:
    """The internal force (nz + 1, nx, ny, 3) of (m, 6, 8) stresses, assembled by scikit-fem."""
    nz, (nx, ny) = len(block.layers), block.shape
    force = np.zeros(block.field_shape)
    positions = block.positions()
    per_layer = nx * ny
    for k in range(nz):
        assembled = _layer_force(block, positions[k : k + 2], stress[k * per_layer :][:per_layer])
        force[k : k + 2] += assembled
    return force


def _layer_mesh(block: Block, positions: FloatArray):  # type: ignore[no-untyped-def]
    """One layer as a conforming mesh of (nx + 1)(ny + 1) columns; and the periodic node of each
    of its nodes, as indices into [level, x, y]."""
    from skfem import MeshHex

    nx, ny = block.shape
    i, j, level = np.meshgrid(np.arange(nx + 1), np.arange(ny + 1), np.arange(2), indexing="ij")
    at = (level.ravel(), (i % nx).ravel(), (j % ny).ravel())
    points = positions[at].T.copy()
    points[0] += (i == nx).ravel() * nx * block.spacing[0]
    points[1] += (j == ny).ravel() * ny * block.spacing[1]
    a, b = np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij")
    cells = np.empty((8, nx * ny), dtype=np.int64)
    for c, (cx, cy, cz) in enumerate(CORNERS):
        cells[c] = (((a + cx) * (ny + 1) + b + cy) * 2 + 1 - cz).ravel()
    return MeshHex(points, cells, validate=False, sort_t=False), at


def _layer_force(block: Block, positions: FloatArray, stress: FloatArray) -> FloatArray:
    from skfem import Basis, ElementHex1, LinearForm

    mesh, at = _layer_mesh(block, positions)
    basis = Basis(mesh, ElementHex1(), intorder=2)
    form = LinearForm(lambda v, w: w["x_"] * v.grad[0] + w["y_"] * v.grad[1] + w["z_"] * v.grad[2])
    out = np.zeros((2, *block.shape, 3))
    for component in range(3):
        rows = [stress[:, _PAIR[component][j]] for j in range(3)]
        nodal = form.assemble(basis, x_=rows[0], y_=rows[1], z_=rows[2])
        # Degree of freedom n of scikit-fem's scalar basis is not node n in general.
        np.add.at(out[..., component], at, nodal[basis.nodal_dofs[0]])
    return out


def assembled_stiffness(block: Block, shear: float, bulk: float):  # type: ignore[no-untyped-def]
    """The sparse elastic stiffness of a small block, degrees of freedom 3 node + component.

    With b_e the integral of the divergence over element e, the dilatational part is the sum of
    K/V_e b_e b_e^T: the mean dilatation's energy.
    """
    import scipy.sparse as sp
    from skfem import Basis, BilinearForm, ElementHex1, ElementVector, LinearForm
    from skfem.helpers import ddot, div, sym_grad

    nx, ny = block.shape
    size = 3 * (len(block.layers) + 1) * nx * ny
    total = sp.csr_matrix((size, size))
    positions = block.positions()
    deviatoric = BilinearForm(  # dev e : dev f = e : f - tr e tr f / 3
        lambda u, v, w: 2 * shear * (ddot(sym_grad(u), sym_grad(v)) - div(u) * div(v) / 3)
    )
    divergence = LinearForm(lambda v, w: div(v))
    for k in range(len(block.layers)):
        mesh, at = _layer_mesh(block, positions[k : k + 2])
        basis = Basis(mesh, ElementVector(ElementHex1()), intorder=2)
        local = divergence.coo_data(basis)
        element = np.tile(np.arange(basis.nelems), basis.Nbfun)
        b = sp.csr_matrix((local.data, (local.indices[0], element)), (basis.N, basis.nelems))
        K = deviatoric.assemble(basis) + b @ sp.diags(bulk / basis.dx.sum(axis=1)) @ b.T
        node = ((k + at[0]) * nx + at[1]) * ny + at[2]
        target = np.empty(basis.N, dtype=np.int64)
        for component in range(3):
            target[basis.nodal_dofs[component]] = 3 * node + component
        join = sp.csr_matrix((np.ones(basis.N), (np.arange(basis.N), target)), (basis.N, size))
        total = total + join.T @ K @ join
    return total.tocsr()
