"""The trilinear brick with mean dilatation (B-bar), from scikit-fem's own basis and
quadrature.

The strain at a Gauss point is the deviatoric part of the local strain plus the
element's mean dilatation (Nagtegaal, Parks and Rice 1974; Hughes 1980):

    e = dev sym(sum_a u_a (x) grad N_a) + I/3 * sum_a u_a . <grad N_a>,
    <g> = (1/V) int_e g dV,

so that plastic flow, which keeps volume, does not lock the element.  Elements of one
shape share the gradients of their eight basis functions at the eight Gauss points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from skfem import Basis, ElementHex1, MeshHex

from epcontact.results import FloatArray

#: Corners of the unit brick in scikit-fem's local order; a column is x, y or z.
CORNERS = np.array(
    [
        [0, 0, 0],
        [0, 0, 1],
        [0, 1, 0],
        [1, 0, 0],
        [0, 1, 1],
        [1, 0, 1],
        [1, 1, 0],
        [1, 1, 1],
    ]
)


class Elements(NamedTuple):
    """Bricks of any shape.

    connectivity: (m, 8) node numbers in the order of CORNERS.  shape_of: (m,) index of the shape.
    gradients: (shapes, 3, 8, 8) dN_a/dx_j as [shape, j, a, Gauss point], in 1/m.
    mean_gradients: (shapes, 3, 8) their volume averages.  weights: (shapes, 8) in m^3.
    sides: (shapes, 3) edges along x, y and z in m, if the elements are those of a flat
        block, layer by layer, each of one shape; None otherwise.
    """

    connectivity: NDArray[np.int32]
    shape_of: NDArray[np.int32]
    gradients: FloatArray
    mean_gradients: FloatArray
    weights: FloatArray
    sides: FloatArray | None = None

    @property
    def number(self) -> int:
        """Number of elements."""
        return len(self.connectivity)


def layers_apart(
    bricks: Elements, which: NDArray[np.int64] | None
) -> tuple[NDArray[np.int64], ...]:
    """Parts of all elements, or of `which`, to be worked on one after the other.  A
    part has (r, 2) ranges of indices, one a layer; its layers have no node in common.
    """
    shapes = bricks.shape_of if which is None else bricks.shape_of[which]
    if bricks.sides is None:
        return (np.array([[0, len(shapes)]]),)
    cuts = np.searchsorted(shapes, np.arange(len(bricks.sides) + 1, dtype=shapes.dtype))
    ranges = np.stack([cuts[:-1], cuts[1:]], axis=1)
    return ranges[::2].copy(), ranges[1::2].copy()


def elements(
    connectivity: NDArray[np.integer],
    shape_of: NDArray[np.integer],
    corners: FloatArray,
) -> Elements:
    """Elements with corners (shapes, 8, 3) in m.  Raises ValueError if one is turned
    inside out.
    """
    # The bricks share no node here, so that scikit-fem need not find their neighbours.
    apart = np.arange(8 * len(corners)).reshape(-1, 8).T.copy()
    mesh = MeshHex(corners.reshape(-1, 3).T.copy(), apart, validate=False, sort_t=False)
    basis = Basis(mesh, ElementHex1(), intorder=2)
    if abs(np.sign(mesh.mapping().detDF(basis.X)).sum()) < basis.dx.size:
        raise ValueError(
            "an element is turned inside out: the top is too rough for its layers"
        )
    gradients = np.empty((len(corners), 3, 8, 8))
    for a, (function,) in enumerate(basis.basis):
        gradients[:, :, a] = np.moveaxis(np.asarray(function.grad), 0, 1)
    weights = np.ascontiguousarray(basis.dx)
    mean = (
        np.einsum("sjag,sg->sja", gradients, weights)
        / weights.sum(axis=1)[:, None, None]
    )
    return Elements(
        np.ascontiguousarray(connectivity, dtype=np.int32),
        np.ascontiguousarray(shape_of, dtype=np.int32),
        gradients,
        mean,
        weights,
    )


def strain_operator(
    shape: Elements, index: int, *, mean_dilatation: bool = True
) -> FloatArray:
    """The strain operator B (8 Gauss points, 6, 24) of one shape; the plain element's
    locks.  Its rows are xx, yy, zz, xy, yz, zx with engineering shears, its columns go
    node by node.
    """
    g = np.moveaxis(shape.gradients[index], 2, 0)  # [gauss, j, a]
    B = np.zeros((8, 6, 8, 3))
    for j in range(3):
        B[:, j, :, j] = g[:, j]
    for row, (i, j) in enumerate(((0, 1), (1, 2), (2, 0)), start=3):
        B[:, row, :, i] = g[:, j]
        B[:, row, :, j] = g[:, i]
    if mean_dilatation:
        excess = (shape.mean_gradients[index][None] - g) / 3  # [gauss, j, a]
        B[:, :3] += np.moveaxis(excess, 1, 2)[:, None]
    return B.reshape(8, 6, 24)


def elastic_stiffness(
    shape: Elements,
    index: int,
    shear: float,
    bulk: float,
    *,
    mean_dilatation: bool = True,
) -> FloatArray:
    """The (24, 24) stiffness of one shape for the moduli mu = `shear` and K =
    `bulk`.
    """
    D = np.diag([2 * shear] * 3 + [shear] * 3)
    D[:3, :3] += bulk - 2 * shear / 3
    B = strain_operator(shape, index, mean_dilatation=mean_dilatation)
    result: FloatArray = np.einsum(
        "gia,ij,gjb,g->ab", B, D, B, shape.weights[index], optimize=True
    )
    return result


def deviatoric_stiffness(shape: Elements, index: int) -> FloatArray:
    """(8, 24, 24) the integral of dev e : dev e at each Gauss point of one shape."""
    B = strain_operator(shape, index, mean_dilatation=False)
    B[:, :3] -= B[:, :3].mean(axis=1, keepdims=True)
    norm = np.array(
        [1.0, 1.0, 1.0, 0.5, 0.5, 0.5]
    )  # of a strain with engineering shears
    weighted = B * norm[:, None] * shape.weights[index][:, None, None]
    return np.asarray(np.swapaxes(B, 1, 2) @ weighted)
