"""The trilinear brick with mean dilatation (B-bar).

The basis functions and the quadrature are those of scikit-fem.  The strain at a Gauss
point is the deviatoric part of the local strain plus the element's mean dilatation
(Nagtegaal, Parks and Rice 1974; Hughes 1980):

    e = dev sym(sum_a u_a (x) grad N_a) + I/3 * sum_a u_a . <grad N_a>,
    <g> = (1/V) int_e g dV,

so that plastic flow, which keeps the volume, does not lock the element.  Elements of
one shape share the gradients of their eight basis functions at the eight Gauss points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from skfem import Basis, ElementHex1, MeshHex

from epcontact.results import FloatArray

#: (8, 3) corners of the unit brick in scikit-fem's local order, mirrored at the centre:
#: the first corner is (0, 0, 0).
CORNERS: NDArray[np.int64] = (1 - ElementHex1.doflocs).astype(np.int64)


class Elements(NamedTuple):
    """Bricks of any number of shapes.

    Attributes:
        connectivity: (m, 8) node numbers of each element, in the order of CORNERS.
        shape_of: (m,) index of each element's shape.
        gradients: (shapes, 3, 8, 8) dN_a/dx_j as [shape, j, a, Gauss point], in 1/m.
        mean_gradients: (shapes, 3, 8) volume averages of the gradients, in 1/m.
        weights: (shapes, 8) volumes of the Gauss points, in m^3.
        sides: (shapes, 3) edge lengths along x, y and z in m, if the elements are those
            of a flat block, layer by layer, with one shape per layer; None otherwise.
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


def disjoint_layers(
    bricks: Elements, selected: NDArray[np.int64] | None
) -> tuple[NDArray[np.int64], ...]:
    """Return the layers of the elements in groups without a common node.

    Threads may add nodal forces of different layers of a group at the same time.

    Args:
        bricks: the elements.
        selected: (k,) ascending numbers of the elements that are meant; None: all.

    Returns:
        Two groups, every other layer from the top and the rest.  A group is an (r, 2)
        array with the first index and the stop index of each layer, which count entries
        of `selected`, or elements if it is None.  Elements without layers are a single
        group of one range.
    """
    shapes = bricks.shape_of
    if selected is not None:
        shapes = shapes[selected]
    if bricks.sides is None:
        return (np.array([[0, len(shapes)]]),)
    layers = np.arange(len(bricks.sides) + 1, dtype=shapes.dtype)
    cuts = np.searchsorted(shapes, layers)
    ranges = np.stack([cuts[:-1], cuts[1:]], axis=1)
    return ranges[::2].copy(), ranges[1::2].copy()


def elements_of(
    connectivity: NDArray[np.integer],
    shape_of: NDArray[np.integer],
    corners: FloatArray,
) -> Elements:
    """Return the elements with given nodes and shapes.

    Args:
        connectivity: (m, 8) node numbers, in the order of CORNERS.
        shape_of: (m,) index of each element's shape in `corners`.
        corners: (shapes, 8, 3) positions of the corners of each shape, in m.

    Raises:
        ValueError: a shape is turned inside out.
    """
    # No two shapes share a node here: scikit-fem need not look for neighbours.
    nodes = np.arange(8 * len(corners)).reshape(-1, 8).T.copy()
    points = corners.reshape(-1, 3).T.copy()
    mesh = MeshHex(points, nodes, validate=False, sort_t=False)
    basis = Basis(mesh, ElementHex1(), intorder=2)
    jacobian_signs = np.sign(mesh.mapping().detDF(basis.X))
    if abs(jacobian_signs.sum()) < basis.dx.size:
        raise ValueError("an element is turned inside out")
    gradients = np.empty((len(corners), 3, 8, 8))
    for a, (function,) in enumerate(basis.basis):
        gradients[:, :, a] = np.moveaxis(np.asarray(function.grad), 0, 1)
    weights = np.ascontiguousarray(basis.dx)
    volumes = weights.sum(axis=1)[:, None, None]
    return Elements(
        np.ascontiguousarray(connectivity, dtype=np.int32),
        np.ascontiguousarray(shape_of, dtype=np.int32),
        gradients,
        np.einsum("sjag,sg->sja", gradients, weights) / volumes,
        weights,
    )


def strain_operator(
    bricks: Elements, shape: int, *, mean_dilatation: bool = True
) -> FloatArray:
    """Return the (8, 6, 24) strain operator B of one shape of elements, in 1/m.

    B[g] times the 24 nodal displacements in m is the strain at Gauss point g.

    Args:
        bricks: the elements.
        shape: index of the shape.
        mean_dilatation: whether the element has mean dilatation; the plain element
            without it locks.

    Returns:
        The six rows are xx, yy, zz, xy, yz, zx with engineering shears; the columns are
        3 corner + component.
    """
    g = np.moveaxis(bricks.gradients[shape], 2, 0)  # [Gauss point, j, a]
    B = np.zeros((8, 6, 8, 3))
    for j in range(3):
        B[:, j, :, j] = g[:, j]
    for row, (i, j) in enumerate(((0, 1), (1, 2), (2, 0)), start=3):
        B[:, row, :, i] = g[:, j]
        B[:, row, :, j] = g[:, i]
    if mean_dilatation:
        excess = (bricks.mean_gradients[shape][None] - g) / 3
        B[:, :3] += np.moveaxis(excess, 1, 2)[:, None]
    return B.reshape(8, 6, 24)


def elastic_stiffness(
    bricks: Elements,
    shape: int,
    shear_modulus: float,
    bulk_modulus: float,
    *,
    mean_dilatation: bool = True,
) -> FloatArray:
    """Return the (24, 24) elastic stiffness of one shape of elements, in N/m.

    Rows and columns are 3 corner + component.

    Args:
        bricks: the elements.
        shape: index of the shape in `bricks`.
        shear_modulus: in Pa.
        bulk_modulus: in Pa.
        mean_dilatation: whether the element has mean dilatation (B-bar); the plain
            element without it locks.
    """
    D = np.diag([2 * shear_modulus] * 3 + [shear_modulus] * 3)
    D[:3, :3] += bulk_modulus - 2 * shear_modulus / 3
    B = strain_operator(bricks, shape, mean_dilatation=mean_dilatation)
    stiffness: FloatArray = np.einsum(
        "gia,ij,gjb,g->ab", B, D, B, bricks.weights[shape], optimize=True
    )
    return stiffness


def deviatoric_stiffness(bricks: Elements, shape: int) -> FloatArray:
    """Return the (8, 24, 24) integrals of dev e : dev e at each Gauss point, in m.

    2 mu times their sum over the Gauss points is the deviatoric elastic stiffness, with
    the local strain e.  Rows and columns are 3 corner + component.

    Args:
        bricks: the elements.
        shape: index of the shape in `bricks`.
    """
    B = strain_operator(bricks, shape, mean_dilatation=False)
    B[:, :3] -= B[:, :3].mean(axis=1, keepdims=True)
    # Engineering shears g count as 2 (g/2)^2 in the double contraction.
    metric = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
    weights = bricks.weights[shape][:, None, None]
    return np.asarray(np.swapaxes(B, 1, 2) @ (B * metric[:, None] * weights))
