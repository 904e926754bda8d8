"""Compiled strains and nodal forces of LANES elements at once, one per vector lane.

The arrays of a group of elements are flat, and the element is their last index: entry
[i, j] of element n of an (I, J, LANES) array is at (i J + j) LANES + n.  The distances
between its rows are constants, so that the compiler sees that rows do not overlap and
uses vector instructions.  It does not do so for an array with several axes.

The names of these arrays in all compiled functions are:

    ue  (3, 8, LANES)  displacements of the corners, in m
    e   (6, 8, LANES)  strains at the Gauss points, as xx, yy, zz, xy, yz, zx
    s   (6, 8, LANES)  stresses in the same order, in Pa; they overwrite the strains
    fe  (3, 8, LANES)  nodal forces, in N
"""

# mypy: allow-untyped-defs
# numba infers the types of the compiled functions.

from __future__ import annotations

from math import sqrt

import numpy as np
from numba import njit

#: Elements that are computed at once.
LANES = 16

#: Distance of a Gauss point from the centre of the brick with corners at -1 and 1.
_GAUSS = sqrt(1.0 / 3.0)

#: Options of all compiled functions.  No C code calls them; without the wrapper for C
#: they compile in a tenth less time.
OPTIONS = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
}
# Sums may be reordered and products fused; infinities and NaNs keep their meaning.
compiled = njit(fastmath={"contract", "reassoc", "nsz"}, **OPTIONS)
# A part of the functions that call it, which is not compiled on its own.
inlined = njit(inline="always")


@compiled
def invert_symmetric(xx, yy, zz, xy, yz, zx):
    """Return the entries xx, yy, zz, xy, yz, zx of the inverse of a symmetric matrix.

    The arguments are the entries of the 3 x 3 matrix in the same order.  A singular
    matrix gives infinities or NaNs, without an error.
    """
    cofactor_xx = yy * zz - yz * yz
    cofactor_yy = xx * zz - zx * zx
    cofactor_zz = xx * yy - xy * xy
    cofactor_xy = yz * zx - xy * zz
    cofactor_yz = xy * zx - xx * yz
    cofactor_zx = xy * yz - yy * zx
    determinant = xx * cofactor_xx - xy * (xy * zz - yz * zx) + zx * cofactor_zx
    return (
        cofactor_xx / determinant,
        cofactor_yy / determinant,
        cofactor_zz / determinant,
        cofactor_xy / determinant,
        cofactor_yz / determinant,
        cofactor_zx / determinant,
    )


@compiled
def workspace():
    """Return empty work arrays for LANES elements, which are computed at once.

    All are flat, with the element (the vector lane) as the last index:

    Returns:
        ue: (3, 8, LANES) displacements of the corners, in m.
        shapes: (LANES,) int32 indices of the elements' shapes.
        derivatives: (3, 3, 4, LANES) derivatives of boxes, a scratch array.
        e: (6, 8, LANES) strains, then stresses, at the Gauss points.
        dilatation: (LANES,) mean dilatations.
        fe: (3, 8, LANES) nodal forces, in N.
    """
    ue = np.empty(24 * LANES)
    shapes = np.empty(LANES, np.int32)
    derivatives = np.empty(36 * LANES)
    e = np.empty(48 * LANES)
    dilatation = np.empty(LANES)
    fe = np.empty(24 * LANES)
    return ue, shapes, derivatives, e, dilatation, fe


@compiled
def gather(u, bricks, selected, first, stop, ue, shapes):
    """Copy the displacements of up to LANES elements to ue, the corners' displacements.

    The last element is repeated until all LANES vector lanes are filled.

    Args:
        u: (nodes, 3) displacements, in m.
        bricks: the elements.
        selected: array of element numbers; None: all elements.
        first: index of the first element, in `selected` or among all.
        stop: index after the last element that may be copied.
        ue: (3, 8, LANES), flat: receives component i of corner a of element n at (8 i +
            a) LANES + n.
        shapes: (LANES,) receives the indices of the elements' shapes.
    """
    for n in range(LANES):
        element = min(first + n, stop - 1)
        if selected is not None:
            element = selected[element]
        shapes[n] = bricks.shape_of[element]
        for a in range(8):
            node = bricks.connectivity[element, a]
            for i in range(3):
                ue[(8 * i + a) * LANES + n] = u[node, i]


@compiled
def scatter(fe, bricks, selected, first, stop, f):
    """Add the nodal forces of up to LANES elements to those of all nodes, in place.

    Args:
        fe: (3, 8, LANES) forces on the corners in N, flat: component i of corner a of
            element n is at (8 i + a) LANES + n.
        bricks: the elements.
        selected: array of element numbers; None: all elements.
        first: index of the first element, in `selected` or among all.
        stop: index after the last element; at most LANES elements are added.
        f: (nodes, 3) forces in N, which are changed.
    """
    for n in range(min(LANES, stop - first)):
        element = first + n
        if selected is not None:
            element = selected[element]
        for a in range(8):
            node = bricks.connectivity[element, a]
            for i in range(3):
                f[node, i] += fe[(8 * i + a) * LANES + n]


# In a box, a derivative along one axis does not vary along that axis.  It is the
# difference of the ends of the four edges along the axis, interpolated to the four
# positions that the Gauss points have across the axis.


@compiled
def _interpolate_square(a, b, c, d):
    """Return four times the values at the 2 x 2 Gauss points of a square.

    The values are interpolated bilinearly.  The corner values a, b, c, d and the four
    results have the order (-, -), (-, +), (+, -), (+, +).  The map is its own
    transpose.
    """
    # Along the second axis of the square.
    low_sum = a + b
    low_step = (b - a) * _GAUSS
    high_sum = c + d
    high_step = (d - c) * _GAUSS
    a = low_sum - low_step
    b = low_sum + low_step
    c = high_sum - high_step
    d = high_sum + high_step
    # Along its first axis.
    low_sum = a + c
    low_step = (c - a) * _GAUSS
    high_sum = b + d
    high_step = (d - b) * _GAUSS
    return (
        low_sum - low_step,
        high_sum - high_step,
        low_sum + low_step,
        high_sum + high_step,
    )


#: Offsets in ue of the far and the near corner of the four edges along x, y and z.
_EDGES = LANES * np.array(
    [[3, 0, 5, 1, 6, 2, 7, 4], [2, 0, 4, 1, 6, 3, 7, 5], [1, 0, 4, 2, 5, 3, 7, 6]]
)


@compiled
def _box_derivatives(sides, ue, derivatives):
    """Write the displacement gradients of LANES equal boxes to `derivatives`.

    A derivative along one axis does not vary along that axis, so that it has only four
    values, at the positions of the Gauss points across the axis.

    Args:
        sides: (3,) edge lengths along x, y and z, in m.
        ue: (3, 8, LANES) displacements of the corners in m, flat.
        derivatives: receives (3 components, 3 axes, 4 positions, LANES), flat and
            dimensionless.
    """
    for i in range(3):
        for j in range(3):
            scale = 0.25 / sides[j]
            edges = _EDGES[j]
            corners = 8 * i * LANES
            start = (12 * i + 4 * j) * LANES
            for n in range(LANES):
                u = corners + n
                a, b, c, d = _interpolate_square(
                    ue[edges[0] + u] - ue[edges[1] + u],
                    ue[edges[2] + u] - ue[edges[3] + u],
                    ue[edges[4] + u] - ue[edges[5] + u],
                    ue[edges[6] + u] - ue[edges[7] + u],
                )
                at = start + n
                derivatives[at] = scale * a
                derivatives[at + LANES] = scale * b
                derivatives[at + 2 * LANES] = scale * c
                derivatives[at + 3 * LANES] = scale * d


@compiled
def _box_strains(sides, mean_gradients, ue, d, e, dilatation):
    """Write local strains and mean dilatations of LANES boxes of one size.

    It does what `strains` does, faster.  All arrays are flat, with the element as the
    last index.

    Args:
        sides: (3,) edge lengths along x, y and z, in m.
        mean_gradients: (3, 8) volume averages of the corners' basis gradients, in 1/m.
        ue: (3, 8, LANES) displacements of the corners, in m.
        d: (3, 3, 4, LANES) scratch array for the derivatives.
        e: (6, 8, LANES) receives xx, yy, zz, xy, yz, zx (tensor shears) at the Gauss
            points.
        dilatation: (LANES,) receives the mean dilatation of each element.
    """
    L = LANES
    _box_derivatives(sides, ue, d)
    for n in range(L):
        dilatation[n] = 0.0
    for i in range(3):
        for a in range(8):
            gradient = mean_gradients[i, a]
            start = (8 * i + a) * L
            for n in range(L):
                dilatation[n] += gradient * ue[start + n]
    for q in range(8):
        # scikit-fem counts its Gauss points from the corner (+, +, +); bits of `corner`
        # are 1 on the positive side.
        corner = 7 - q
        x = (corner >> 1) & 1
        y = corner & 1
        z = corner >> 2
        # Offsets of the Gauss point among the positions across x, across y, across z.
        yz = (2 * y + z) * L
        xz = (2 * x + z) * L
        xy = (2 * x + y) * L
        start = q * L
        for n in range(L):
            at = start + n
            e[at] = d[yz + n]
            e[at + 8 * L] = d[16 * L + xz + n]
            e[at + 16 * L] = d[32 * L + xy + n]
            e[at + 24 * L] = 0.5 * (d[4 * L + xz + n] + d[12 * L + yz + n])
            e[at + 32 * L] = 0.5 * (d[20 * L + xy + n] + d[28 * L + xz + n])
            e[at + 40 * L] = 0.5 * (d[24 * L + yz + n] + d[8 * L + xy + n])


@compiled
def _box_forces(sides, weight, s, fe):
    """Write the nodal forces of the stresses in LANES boxes of one size.

    It does what `forces` does, faster.

    Args:
        sides: (3,) edge lengths along x, y and z, in m.
        weight: volume of a Gauss point, in m^3.
        s: (6, 8, LANES) stresses xx, yy, zz, xy, yz, zx at the Gauss points in Pa,
            flat.
        fe: (3, 8, LANES), flat: receives the forces on the corners, in N.
    """
    scale_x = 0.25 * weight / sides[0]
    scale_y = 0.25 * weight / sides[1]
    scale_z = 0.25 * weight / sides[2]
    L = LANES
    for i in range(3):
        # Offsets of the stress components that act along axis i on the faces across x,
        # y and z.
        if i == 0:
            xi, yi, zi = 0, 24 * L, 40 * L
        elif i == 1:
            xi, yi, zi = 24 * L, 8 * L, 32 * L
        else:
            xi, yi, zi = 40 * L, 32 * L, 16 * L
        start = 8 * i * L
        for n in range(L):
            x0, x1, x2, x3 = _interpolate_square(
                s[xi + 7 * L + n] + s[xi + 5 * L + n],
                s[xi + 3 * L + n] + s[xi + L + n],
                s[xi + 6 * L + n] + s[xi + 4 * L + n],
                s[xi + 2 * L + n] + s[xi + n],
            )
            y0, y1, y2, y3 = _interpolate_square(
                s[yi + 7 * L + n] + s[yi + 6 * L + n],
                s[yi + 3 * L + n] + s[yi + 2 * L + n],
                s[yi + 5 * L + n] + s[yi + 4 * L + n],
                s[yi + L + n] + s[yi + n],
            )
            z0, z1, z2, z3 = _interpolate_square(
                s[zi + 7 * L + n] + s[zi + 3 * L + n],
                s[zi + 6 * L + n] + s[zi + 2 * L + n],
                s[zi + 5 * L + n] + s[zi + L + n],
                s[zi + 4 * L + n] + s[zi + n],
            )
            x0 *= scale_x
            x1 *= scale_x
            x2 *= scale_x
            x3 *= scale_x
            y0 *= scale_y
            y1 *= scale_y
            y2 *= scale_y
            y3 *= scale_y
            z0 *= scale_z
            z1 *= scale_z
            z2 *= scale_z
            z3 *= scale_z
            at = start + n
            fe[at] = -x0 - y0 - z0
            fe[at + L] = -x1 - y1 + z0
            fe[at + 2 * L] = -x2 + y0 - z1
            fe[at + 3 * L] = x0 - y2 - z2
            fe[at + 4 * L] = -x3 + y1 + z1
            fe[at + 5 * L] = x1 - y3 + z2
            fe[at + 6 * L] = x2 + y2 - z3
            fe[at + 7 * L] = x3 + y3 + z3


@compiled
def _brick_strains(gradients, mean_gradients, ue, n, e, dilatation):
    """Write local strains and mean dilatation of one of LANES elements of any shape.

    The arrays ue, e and dilatation hold LANES elements, with the element as the last
    index.

    Args:
        gradients: (3, 8, 8) basis gradients as [axis, corner, Gauss point], in 1/m.
        mean_gradients: (3, 8) their volume averages, in 1/m.
        ue: (3, 8, LANES) displacements of the corners in m, flat.
        n: index of the element, below LANES.
        e: (6, 8, LANES), flat: receives xx, yy, zz, xy, yz, zx (tensor shears) of this
            element.
        dilatation: (LANES,) receives the mean dilatation of this element.
    """
    L = LANES
    dilatation[n] = 0.0
    for a in range(8):
        for i in range(3):
            dilatation[n] += mean_gradients[i, a] * ue[(8 * i + a) * L + n]
    for q in range(8):
        xx = yy = zz = xy = yz = zx = 0.0
        for a in range(8):
            gx = gradients[0, a, q]
            gy = gradients[1, a, q]
            gz = gradients[2, a, q]
            ux = ue[a * L + n]
            uy = ue[(8 + a) * L + n]
            uz = ue[(16 + a) * L + n]
            xx += gx * ux
            yy += gy * uy
            zz += gz * uz
            xy += gy * ux + gx * uy
            yz += gz * uy + gy * uz
            zx += gx * uz + gz * ux
        at = q * L + n
        e[at] = xx
        e[at + 8 * L] = yy
        e[at + 16 * L] = zz
        e[at + 24 * L] = 0.5 * xy
        e[at + 32 * L] = 0.5 * yz
        e[at + 40 * L] = 0.5 * zx


@compiled
def _brick_forces(gradients, weights, s, n, fe):
    """Write the nodal forces of the stresses in one of LANES elements of any shape.

    Args:
        gradients: (3, 8, 8) basis gradients as [axis, corner, Gauss point], in 1/m.
        weights: (8,) volumes of the Gauss points, in m^3.
        s: (6, 8, LANES) stresses xx, yy, zz, xy, yz, zx at the Gauss points in Pa,
            flat.
        n: index of the element, below LANES.
        fe: (3, 8, LANES), flat: receives the forces on this element's corners, in N.
    """
    L = LANES
    for a in range(8):
        fx = fy = fz = 0.0
        for q in range(8):
            gx = weights[q] * gradients[0, a, q]
            gy = weights[q] * gradients[1, a, q]
            gz = weights[q] * gradients[2, a, q]
            at = q * L + n
            xy = s[at + 24 * L]
            yz = s[at + 32 * L]
            zx = s[at + 40 * L]
            fx += gx * s[at] + gy * xy + gz * zx
            fy += gx * xy + gy * s[at + 8 * L] + gz * yz
            fz += gx * zx + gy * yz + gz * s[at + 16 * L]
        fe[a * L + n] = fx
        fe[(8 + a) * L + n] = fy
        fe[(16 + a) * L + n] = fz


@compiled
def strains(sides, bricks, shapes, ue, derivatives, e, dilatation):
    """Write the local strains and the mean dilatations of LANES elements.

    Args:
        sides: `bricks.sides`, (shapes, 3) edge lengths in m: all elements are boxes
            with the shape of the first; None: elements of any shape.  It is an argument
            of its own because numba compiles only one branch for an argument that is
            None.
        bricks: the elements.
        shapes: (LANES,) indices of the elements' shapes.
        ue: (3, 8, LANES) displacements of the corners in m, flat.
        derivatives: scratch array of 36 LANES numbers.
        e: (6, 8, LANES), flat: receives the strains xx, yy, zz, xy, yz, zx at the Gauss
            points.
        dilatation: (LANES,) receives the mean dilatation of each element.
    """
    if sides is not None:
        k = shapes[0]
        _box_strains(sides[k], bricks.mean_gradients[k], ue, derivatives, e, dilatation)
        return
    for n in range(LANES):
        k = shapes[n]
        _brick_strains(
            bricks.gradients[k], bricks.mean_gradients[k], ue, n, e, dilatation
        )


@compiled
def forces(sides, bricks, shapes, s, fe):
    """Write the nodal forces of the stresses in LANES elements.

    They are the integrals of the stresses times the gradients of the basis functions.

    Args:
        sides: `bricks.sides`, (shapes, 3) edge lengths in m: all elements are boxes
            with the shape of the first; None: elements of any shape.
        bricks: the elements.
        shapes: (LANES,) indices of the elements' shapes.
        s: (6, 8, LANES) stresses xx, yy, zz, xy, yz, zx at the Gauss points in Pa,
            flat.
        fe: (3, 8, LANES), flat: receives the forces on the corners, in N.
    """
    if sides is not None:
        k = shapes[0]
        _box_forces(sides[k], bricks.weights[k, 0], s, fe)
        return
    for n in range(LANES):
        k = shapes[n]
        _brick_forces(bricks.gradients[k], bricks.weights[k], s, n, fe)
