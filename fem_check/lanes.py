"""Strains and nodal forces of LANES elements at once, which lets the compiler use
vector units.

Arrays of a group of elements are flat and have the element as their last index: entry
[i, j] of element n of an (I, J, LANES) array is at (i J + j) LANES + n.  With constant
distances between its rows the compiler sees that they do not overlap, as it does not in
an array with several axes.

ue (3, 8, LANES) displacements at the corners; e (6, 8, LANES) tensor components xx, yy,
zz, xy, yz, zx of strains, and later of stresses, at the Gauss points; fe (3, 8, LANES)
nodal forces.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numba import njit

#: Elements that are worked on at once.
LANES = 16

_GAUSS = sqrt(1.0 / 3.0)
# Sums may be reordered and products fused; infinities and NaNs keep their meaning.  No
# C code calls a kernel, so it needs no wrapper for that, which takes a tenth of a
# compilation.
OPTIONS = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
}
compiled = njit(fastmath={"contract", "reassoc", "nsz"}, **OPTIONS)


@compiled
def inverse_of_symmetric(a, b, d, e, f, g):  # type: ignore[no-untyped-def]
    """The components 00, 11, 22, 01, 12, 20 of the inverse of the matrix that has a to
    g there.
    """
    x, y, z = b * d - f * f, f * g - e * d, e * f - b * g
    det = a * x - e * (e * d - f * g) + g * z
    others = (
        (a * d - g * g) / det,
        (a * b - e * e) / det,
        y / det,
        (e * g - a * f) / det,
    )
    return x / det, *others, z / det


@compiled
def workspace():  # type: ignore[no-untyped-def]
    """Arrays ue, derivatives (scratch of `strains`), e and fe."""
    return (
        np.empty(24 * LANES),
        np.empty(36 * LANES),
        np.empty(48 * LANES),
        np.empty(24 * LANES),
    )


@compiled
def gather(u, bricks, which, first, stop, ue, shapes):  # type: ignore[no-untyped-def]
    """Copies displacements (nodes, 3) to ue, and the elements' shapes.  The elements
    are those from `first` to `stop`, of `which` if given; the last one is repeated.
    """
    for n in range(LANES):
        e = min(first + n, stop - 1)
        if which is not None:
            e = which[e]
        shapes[n] = bricks.shape_of[e]
        for a in range(8):
            node = bricks.connectivity[e, a]
            for i in range(3):
                ue[(8 * i + a) * LANES + n] = u[node, i]


@compiled
def scatter(fe, bricks, which, first, stop, f):  # type: ignore[no-untyped-def]
    """Adds the nodal forces of the same elements to f (nodes, 3)."""
    for n in range(min(LANES, stop - first)):
        e = first + n
        if which is not None:
            e = which[e]
        for a in range(8):
            node = bricks.connectivity[e, a]
            for i in range(3):
                f[node, i] += fe[(8 * i + a) * LANES + n]


# In a box a derivative along one axis does not depend on the place along it: it is
# interpolated from the four edges along that axis to the four places of the Gauss
# points across it.


@compiled
def _across(a, b, c, d):  # type: ignore[no-untyped-def]
    """Four times the values at the 2 x 2 Gauss points of a square, from those at its
    corners, both as (-, -), (-, +), (+, -), (+, +); the map is its own transpose.
    """
    s, t, u, v = a + b, (b - a) * _GAUSS, c + d, (d - c) * _GAUSS
    a, b, c, d = s - t, s + t, u - v, u + v
    s, t, u, v = a + c, (c - a) * _GAUSS, b + d, (d - b) * _GAUSS
    return s - t, u - v, s + t, u + v


#: Places in ue of the far and the near corner of the four edges along x, y and z.
_EDGES = LANES * np.array(
    [[3, 0, 5, 1, 6, 2, 7, 4], [2, 0, 4, 1, 6, 3, 7, 5], [1, 0, 4, 2, 5, 3, 7, 6]]
)


@compiled
def _derivatives(sides, ue, d):  # type: ignore[no-untyped-def]
    """Writes the derivatives of a box to d (3 components, 3 axes, 4 places, LANES)."""
    for i in range(3):
        for j in range(3):
            h, o, v, f = (
                0.25 / sides[j],
                (12 * i + 4 * j) * LANES,
                8 * i * LANES,
                _EDGES[j],
            )
            for n in range(v, v + LANES):
                a, b, c, e = _across(
                    ue[f[0] + n] - ue[f[1] + n],
                    ue[f[2] + n] - ue[f[3] + n],
                    ue[f[4] + n] - ue[f[5] + n],
                    ue[f[6] + n] - ue[f[7] + n],
                )
                m = o + n - v
                d[m], d[m + LANES], d[m + 2 * LANES], d[m + 3 * LANES] = (
                    h * a,
                    h * b,
                    h * c,
                    h * e,
                )


@compiled
def _box_strains(sides, mean, ue, d, e, dilatation):  # type: ignore[no-untyped-def]
    """Do what `strains` does, for boxes of one size; d is scratch."""
    L = LANES
    _derivatives(sides, ue, d)
    for n in range(L):
        dilatation[n] = 0.0
    for i in range(3):
        for a in range(8):
            g, o = mean[i, a], (8 * i + a) * L
            for n in range(L):
                dilatation[n] += g * ue[o + n]
    for q in range(8):
        r = 7 - q  # scikit-fem counts its Gauss points from the corner (+, +, +)
        x, y, z = (r >> 1) & 1, r & 1, r >> 2
        yz, xz, xy, o = (2 * y + z) * L, (2 * x + z) * L, (2 * x + y) * L, q * L
        for n in range(L):
            e[o + n] = d[yz + n]
            e[o + 8 * L + n] = d[16 * L + xz + n]
            e[o + 16 * L + n] = d[32 * L + xy + n]
            e[o + 24 * L + n] = 0.5 * (d[4 * L + xz + n] + d[12 * L + yz + n])
            e[o + 32 * L + n] = 0.5 * (d[20 * L + xy + n] + d[28 * L + xz + n])
            e[o + 40 * L + n] = 0.5 * (d[24 * L + yz + n] + d[8 * L + xy + n])


@compiled
def _box_forces(sides, weight, s, fe):  # type: ignore[no-untyped-def]
    """Do what `forces` does, for boxes of one size."""
    hx, hy, hz = (
        0.25 * weight / sides[0],
        0.25 * weight / sides[1],
        0.25 * weight / sides[2],
    )
    L = LANES
    for i in range(3):
        # The stresses on the faces across x, y and z, from the components xx, yy, zz,
        # xy, yz, zx.
        if i == 0:
            p, q, r = 0, 24 * L, 40 * L
        elif i == 1:
            p, q, r = 24 * L, 8 * L, 32 * L
        else:
            p, q, r = 40 * L, 32 * L, 16 * L
        o = 8 * i * L
        for e in range(L):
            a, b, c, d = _across(
                s[p + 7 * L + e] + s[p + 5 * L + e],
                s[p + 3 * L + e] + s[p + L + e],
                s[p + 6 * L + e] + s[p + 4 * L + e],
                s[p + 2 * L + e] + s[p + e],
            )
            a, b, c, d = hx * a, hx * b, hx * c, hx * d
            k, j, m, n = _across(
                s[q + 7 * L + e] + s[q + 6 * L + e],
                s[q + 3 * L + e] + s[q + 2 * L + e],
                s[q + 5 * L + e] + s[q + 4 * L + e],
                s[q + L + e] + s[q + e],
            )
            k, j, m, n = hy * k, hy * j, hy * m, hy * n
            u, v, w, x = _across(
                s[r + 7 * L + e] + s[r + 3 * L + e],
                s[r + 6 * L + e] + s[r + 2 * L + e],
                s[r + 5 * L + e] + s[r + L + e],
                s[r + 4 * L + e] + s[r + e],
            )
            u, v, w, x = hz * u, hz * v, hz * w, hz * x
            fe[o + e] = -a - k - u
            fe[o + L + e] = -b - j + u
            fe[o + 2 * L + e] = -c + k - v
            fe[o + 3 * L + e] = a - m - w
            fe[o + 4 * L + e] = -d + j + v
            fe[o + 5 * L + e] = b - n + w
            fe[o + 6 * L + e] = c + m - x
            fe[o + 7 * L + e] = d + n + x


@compiled
def _brick_strains(G, mean, ue, n, e, dilatation):  # type: ignore[no-untyped-def]
    """Do what `strains` does, for lane n, whose element has the gradients G (3, 8,
    8).
    """
    L = LANES
    dilatation[n] = 0.0
    for a in range(8):
        for i in range(3):
            dilatation[n] += mean[i, a] * ue[(8 * i + a) * L + n]
    for q in range(8):
        xx = yy = zz = xy = yz = zx = 0.0
        for a in range(8):
            gx, gy, gz = G[0, a, q], G[1, a, q], G[2, a, q]
            ux, uy, uz = ue[a * L + n], ue[(8 + a) * L + n], ue[(16 + a) * L + n]
            xx += gx * ux
            yy += gy * uy
            zz += gz * uz
            xy += gy * ux + gx * uy
            yz += gz * uy + gy * uz
            zx += gx * uz + gz * ux
        o = q * L + n
        e[o], e[o + 8 * L], e[o + 16 * L] = xx, yy, zz
        e[o + 24 * L], e[o + 32 * L], e[o + 40 * L] = 0.5 * xy, 0.5 * yz, 0.5 * zx


@compiled
def _brick_forces(G, weights, s, n, fe):  # type: ignore[no-untyped-def]
    """Do what `forces` does, for lane n."""
    L = LANES
    for a in range(8):
        fx = fy = fz = 0.0
        for q in range(8):
            gx, gy, gz = (
                weights[q] * G[0, a, q],
                weights[q] * G[1, a, q],
                weights[q] * G[2, a, q],
            )
            o = q * L + n
            xy, yz, zx = s[o + 24 * L], s[o + 32 * L], s[o + 40 * L]
            fx += gx * s[o] + gy * xy + gz * zx
            fy += gx * xy + gy * s[o + 8 * L] + gz * yz
            fz += gx * zx + gy * yz + gz * s[o + 16 * L]
        fe[a * L + n], fe[(8 + a) * L + n], fe[(16 + a) * L + n] = fx, fy, fz


@compiled
def strains(sides, bricks, shapes, ue, d, e, dilatation):  # type: ignore[no-untyped-def]
    """Writes the local strains to e and the mean dilatations (LANES,); d is scratch."""
    if sides is not None:
        s = shapes[0]
        _box_strains(sides[s], bricks.mean_gradients[s], ue, d, e, dilatation)
        return
    for n in range(LANES):
        s = shapes[n]
        _brick_strains(
            bricks.gradients[s], bricks.mean_gradients[s], ue, n, e, dilatation
        )


@compiled
def forces(sides, bricks, shapes, s, fe):  # type: ignore[no-untyped-def]
    """Writes the integrals of the stresses s times the gradients of the basis functions
    to fe.
    """
    if sides is not None:
        _box_forces(sides[shapes[0]], bricks.weights[shapes[0], 0], s, fe)
        return
    for n in range(LANES):
        _brick_forces(bricks.gradients[shapes[n]], bricks.weights[shapes[n]], s, n, fe)
