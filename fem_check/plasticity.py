"""Small-strain J2 plasticity with radial return, point by point and over all elements.

Stress and strain: tensor components xx, yy, zz, xy, yz, zx.  With the shear modulus mu, the bulk
modulus K, the yield stress sigma_Y and the hardening modulus H (isotropic, linear; 0: perfect
plasticity), a strain e, its plastic part e_p and the accumulated plastic strain a:

    s_trial = 2 mu (dev e - e_p),   R = sqrt(2/3) (sigma_Y + H a)
    over    = max(|s_trial| - R, 0) / (1 + H/(3 mu))            (= 2 mu times the multiplier)
    n = s_trial/|s_trial|,   s = s_trial - over n,   p = K tr e
    e_p <- e_p + over/(2 mu) n,   a <- a + sqrt(2/3) over/(2 mu)

(Simo and Hughes, Computational Inelasticity, box 3.1), with the consistent tangent

    C = K I (x) I + 2 mu theta I_dev - 2 mu theta_bar n (x) n,
    theta = 1 - over/|s_trial|,   theta_bar = 1/(1 + H/(3 mu)) - (1 - theta)     (box 3.2).

The history (e_p, a) changes in `commit` alone, after an increment has converged; all other
functions only read it.  Two compiled loops over the elements do the work: `_stress_update` returns
the stress to the yield surface, and `_add_correction` multiplies by the difference between the
consistent tangent and the elastic stiffness.  The dilatation of the B-bar brick (`element`) is its
mean over the element.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from epcontact.results import FloatArray
from fem_check.element import Elements

_ROOT = sqrt(2.0 / 3.0)
_GAUSS = sqrt(1.0 / 3.0)
# Sums may be reordered and products fused; infinities and NaNs keep their meaning.
_FAST = {"contract", "reassoc", "nsz"}


class Law(NamedTuple):
    """mu = shear, K = bulk, sigma_Y = yield_stress, H = hardening; all in Pa."""

    shear: float
    bulk: float
    yield_stress: float
    hardening: float = 0.0


def law(
    young_modulus: float, poisson_ratio: float, yield_stress: float, hardening: float = 0.0
) -> Law:
    """The law of a material: Figure 1 of the paper where the hardening is 0.

    In uniaxial tension the stress rises with slope E up to the yield stress and stays there.

    Args:
        young_modulus: E in Pa.
        poisson_ratio: nu.
        yield_stress: sigma_Y in Pa; infinite for an elastic material.
        hardening: H in Pa; 0 is perfect plasticity.

    Returns:
        The law, with the shear modulus E/(2 (1 + nu)) and the bulk modulus E/(3 (1 - 2 nu)).

    Example:
        >>> law(2.6, 0.3, yield_stress=0.01).shear
        1.0
    """
    E, nu = young_modulus, poisson_ratio
    return Law(E / (2 * (1 + nu)), E / (3 * (1 - 2 * nu)), float(yield_stress), float(hardening))


class History(NamedTuple):
    """The history variables of m elements: plastic_strain (m, 6, 8) and accumulated (m, 8)."""

    plastic_strain: FloatArray
    accumulated: FloatArray


class TangentCorrection(NamedTuple):
    """The consistent tangent less the elastic stiffness, in the elements that flow.

    which: (k,) numbers of the elements.  terms: (k, 8, 8): the six components of n, then
    2 mu (1 - theta) and 2 mu theta_bar times the Gauss point's volume, at each Gauss point.
    """

    which: NDArray[np.int64]
    terms: FloatArray


def initial_history(count: int) -> History:
    """The history of `count` elements that have never yielded."""
    return History(np.zeros((count, 6, 8)), np.zeros((count, 8)))


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _return(strain, ep, acc, law):  # type: ignore[no-untyped-def]
    """Trial deviatoric stress, its norm, and its distance from the yield surface (`over`).

    The norm is found only where the point flows; elsewhere it is 1.
    """
    xx, yy, zz, xy, yz, zx = strain
    m = (xx + yy + zz) / 3
    G2 = 2 * law[0]
    sxx, syy, szz = G2 * (xx - m - ep[0]), G2 * (yy - m - ep[1]), G2 * (zz - m - ep[2])
    sxy, syz, szx = G2 * (xy - ep[3]), G2 * (yz - ep[4]), G2 * (zx - ep[5])
    squared = sxx * sxx + syy * syy + szz * szz + 2 * (sxy * sxy + syz * syz + szx * szx)
    radius = _ROOT * (law[2] + law[3] * acc)
    norm, over = 1.0, 0.0
    if squared > radius * radius:
        norm = sqrt(squared)
        over = (norm - radius) / (1 + law[3] / (3 * law[0]))
    return (sxx, syy, szz, sxy, syz, szx), norm, over


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _elastic_stress(strain, law):  # type: ignore[no-untyped-def]
    """Deviatoric stress of Hooke's law."""
    xx, yy, zz, xy, yz, zx = strain
    m, G2 = (xx + yy + zz) / 3, 2 * law[0]
    return G2 * (xx - m), G2 * (yy - m), G2 * (zz - m), G2 * xy, G2 * yz, G2 * zx


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _gather(u, nodes, Gm, shape, ue):  # type: ignore[no-untyped-def]
    """Copies an element's displacements to ue (8, 3) and returns its mean dilatation."""
    dilatation = 0.0
    for a in range(8):
        n = nodes[a]
        for i in range(3):
            ue[a, i] = u[n, i]
            dilatation += Gm[shape, i, a] * u[n, i]
    return dilatation


# In a box a derivative along one axis does not depend on the place along it: it is interpolated
# from the four edges along that axis to the four places of the Gauss points across it.


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _across(a, b, c, d):  # type: ignore[no-untyped-def]
    """Four times the values at the 2 x 2 Gauss points of a square, from those at its corners.

    Both go as (-, -), (-, +), (+, -), (+, +).  The map is its own transpose.
    """
    s, t, u, v = a + b, (b - a) * _GAUSS, c + d, (d - c) * _GAUSS
    a, b, c, d = s - t, s + t, u - v, u + v
    s, t, u, v = a + c, (c - a) * _GAUSS, b + d, (d - b) * _GAUSS
    return s - t, u - v, s + t, u + v


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _box_strains(sides, ue, d, e):  # type: ignore[no-untyped-def]
    """As `_strains`; d (3, 3, 4) is overwritten with the derivatives [component, axis, place]."""
    hx, hy, hz = 0.25 / sides[0], 0.25 / sides[1], 0.25 / sides[2]
    for i in range(3):
        # Corners by their sides along x, y and z.
        mmm, mmp, mpm, pmm = ue[0, i], ue[1, i], ue[2, i], ue[3, i]
        mpp, pmp, ppm, ppp = ue[4, i], ue[5, i], ue[6, i], ue[7, i]
        a, b, c, f = _across(pmm - mmm, pmp - mmp, ppm - mpm, ppp - mpp)
        d[i, 0, 0], d[i, 0, 1], d[i, 0, 2], d[i, 0, 3] = hx * a, hx * b, hx * c, hx * f
        a, b, c, f = _across(mpm - mmm, mpp - mmp, ppm - pmm, ppp - pmp)
        d[i, 1, 0], d[i, 1, 1], d[i, 1, 2], d[i, 1, 3] = hy * a, hy * b, hy * c, hy * f
        a, b, c, f = _across(mmp - mmm, mpp - mpm, pmp - pmm, ppp - ppm)
        d[i, 2, 0], d[i, 2, 1], d[i, 2, 2], d[i, 2, 3] = hz * a, hz * b, hz * c, hz * f
    for q in range(8):
        r = 7 - q  # scikit-fem counts its Gauss points from the corner (+, +, +)
        x, y, z = (r >> 1) & 1, r & 1, r >> 2
        yz, xz, xy = 2 * y + z, 2 * x + z, 2 * x + y
        e[0, q], e[1, q], e[2, q] = d[0, 0, yz], d[1, 1, xz], d[2, 2, xy]
        e[3, q] = 0.5 * (d[0, 1, xz] + d[1, 0, yz])
        e[4, q] = 0.5 * (d[1, 2, xy] + d[2, 1, xz])
        e[5, q] = 0.5 * (d[2, 0, yz] + d[0, 2, xy])


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _box_scatter(sides, nodes, s, f):  # type: ignore[no-untyped-def]
    """As `_scatter`."""
    hx, hy, hz = 0.25 / sides[0], 0.25 / sides[1], 0.25 / sides[2]
    for i in range(3):
        # The stresses on the faces across x, y and z.
        if i == 0:
            p, q, r = s[0], s[3], s[5]
        elif i == 1:
            p, q, r = s[3], s[1], s[4]
        else:
            p, q, r = s[5], s[4], s[2]
        a, b, c, d = _across(p[7] + p[5], p[3] + p[1], p[6] + p[4], p[2] + p[0])
        a, b, c, d = hx * a, hx * b, hx * c, hx * d
        k, o, m, n = _across(q[7] + q[6], q[3] + q[2], q[5] + q[4], q[1] + q[0])
        k, o, m, n = hy * k, hy * o, hy * m, hy * n
        u, v, w, x = _across(r[7] + r[3], r[6] + r[2], r[5] + r[1], r[4] + r[0])
        u, v, w, x = hz * u, hz * v, hz * w, hz * x
        f[nodes[0], i] += -a - k - u
        f[nodes[1], i] += -b - o + u
        f[nodes[2], i] += -c + k - v
        f[nodes[3], i] += a - m - w
        f[nodes[4], i] += -d + o + v
        f[nodes[5], i] += b - n + w
        f[nodes[6], i] += c + m - x
        f[nodes[7], i] += d + n + x


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _strains(sides, G, shape, ue, d, e):  # type: ignore[no-untyped-def]
    """Writes the tensor components of the local strains to e (6, 8); d (3, 3, 4) is scratch."""
    if sides is not None:
        _box_strains(sides[shape], ue, d, e)
        return
    for q in range(8):
        xx = yy = zz = xy = yz = zx = 0.0
        for a in range(8):
            gx, gy, gz = G[shape, 0, a, q], G[shape, 1, a, q], G[shape, 2, a, q]
            xx += gx * ue[a, 0]
            yy += gy * ue[a, 1]
            zz += gz * ue[a, 2]
            xy += gy * ue[a, 0] + gx * ue[a, 1]
            yz += gz * ue[a, 1] + gy * ue[a, 2]
            zx += gx * ue[a, 2] + gz * ue[a, 0]
        e[0, q], e[1, q], e[2, q] = xx, yy, zz
        e[3, q], e[4, q], e[5, q] = 0.5 * xy, 0.5 * yz, 0.5 * zx


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _scatter(sides, G, shape, nodes, s, f):  # type: ignore[no-untyped-def]
    """f += sum over the Gauss points of the weighted stresses s (6, 8) times the gradients."""
    if sides is not None:
        _box_scatter(sides[shape], nodes, s, f)
        return
    for a in range(8):
        fx = fy = fz = 0.0
        for q in range(8):
            gx, gy, gz = G[shape, 0, a, q], G[shape, 1, a, q], G[shape, 2, a, q]
            fx += gx * s[0, q] + gy * s[3, q] + gz * s[5, q]
            fy += gx * s[3, q] + gy * s[1, q] + gz * s[4, q]
            fz += gx * s[5, q] + gy * s[4, q] + gz * s[2, q]
        n = nodes[a]
        f[n, 0] += fx
        f[n, 1] += fy
        f[n, 2] += fz


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _stress_update(  # type: ignore[no-untyped-def]  # noqa: PLR0912, PLR0913, PLR0917 - one law
    u, bricks, law, history, which, nodal, stress, updated, terms
):
    """Radial return at every Gauss point of all elements, or of `which`.

    Without a history the law is elastic.  Each of the outputs may be None, and numba then leaves
    its part out of the compiled loop: nodal = (force, flowing), where the internal force is added
    to `force`; stress (m, 6, 8); updated, the history to change; terms, those of the correction.
    """
    ue, d, strains, s = np.empty((8, 3)), np.empty((3, 3, 4)), np.empty((6, 8)), np.empty((6, 8))
    conn, shape_of, w = bricks.connectivity, bricks.shape_of, bricks.weights
    count = conn.shape[0]
    if which is not None:
        count = which.size
    for k in range(count):
        e = k
        if which is not None:
            e = which[k]
        shape = shape_of[e]
        p = law[1] * _gather(u, conn[e], bricks.mean_gradients, shape, ue)
        _strains(bricks.sides, bricks.gradients, shape, ue, d, strains)
        worst = 0.0
        for q in range(8):
            strain = (
                strains[0, q], strains[1, q], strains[2, q],
                strains[3, q], strains[4, q], strains[5, q],
            )  # fmt: skip
            if history is None:
                t, norm, over = _elastic_stress(strain, law), 1.0, 0.0
            else:
                t, norm, over = _return(strain, history[0][e, :, q], history[1][e, q], law)
            loss = over / norm  # 1 - theta
            if nodal is not None:
                wq = w[shape, q]
                c = wq * (1 - loss)
                s[0, q], s[1, q], s[2, q] = c * t[0] + wq * p, c * t[1] + wq * p, c * t[2] + wq * p
                s[3, q], s[4, q], s[5, q] = c * t[3], c * t[4], c * t[5]
                worst = max(worst, over)
            if stress is not None:
                for i in range(6):
                    stress[e, i, q] = (1 - loss) * t[i] + (p if i < 3 else 0.0)
            if updated is not None and over > 0:
                for i in range(6):
                    updated[0][e, i, q] += over / (2 * law[0]) * t[i] / norm
                updated[1][e, q] += _ROOT * over / (2 * law[0])
            if terms is not None:
                for i in range(6):
                    terms[k, i, q] = t[i] / norm
                stiff, flows = 2 * law[0] * w[shape, q], 1.0 if over > 0 else 0.0
                terms[k, 6, q] = stiff * loss
                terms[k, 7, q] = stiff * flows * (1 / (1 + law[3] / (3 * law[0])) - loss)
        if nodal is not None:
            nodal[1][e] = worst > 0
            _scatter(bricks.sides, bricks.gradients, shape, conn[e], s, nodal[0])


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _add_correction(v, bricks, correction, scale, f):  # type: ignore[no-untyped-def]
    ue, d, e, s = np.empty((8, 3)), np.empty((3, 3, 4)), np.empty((6, 8)), np.empty((6, 8))
    which, terms = correction
    for k in range(which.size):
        nodes, shape = bricks.connectivity[which[k]], bricks.shape_of[which[k]]
        for c in range(8):
            for i in range(3):
                ue[c, i] = v[nodes[c], i]
        _strains(bricks.sides, bricks.gradients, shape, ue, d, e)
        for q in range(8):
            xx, yy, zz, xy, yz, zx = e[0, q], e[1, q], e[2, q], e[3, q], e[4, q], e[5, q]
            m = (xx + yy + zz) / 3
            n = terms[k, :6, q]
            along = n[0] * xx + n[1] * yy + n[2] * zz + 2 * (n[3] * xy + n[4] * yz + n[5] * zx)
            a, b = -scale * terms[k, 6, q], -scale * terms[k, 7, q] * along
            s[0, q], s[1, q], s[2, q] = (
                a * (xx - m) + b * n[0],
                a * (yy - m) + b * n[1],
                a * (zz - m) + b * n[2],
            )
            s[3, q], s[4, q], s[5, q] = a * xy + b * n[3], a * yz + b * n[4], a * zx + b * n[5]
        _scatter(bricks.sides, bricks.gradients, shape, nodes, s, f)


def internal_force(
    u: FloatArray, bricks: Elements, law: Law, history: History | None
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The internal force of a displacement.

    Args:
        u: (nodes, 3) displacement in m.
        bricks: the elements.
        law: the material.
        history: at the beginning of the increment; None: the material is elastic, and the force is
            the elastic stiffness times `u`.

    Returns:
        The (nodes, 3) force in N, and (m,) which elements flow.
    """
    force, flowing = np.zeros_like(u), np.empty(bricks.number, dtype=np.bool_)
    _stress_update(u, bricks, law, history, None, (force, flowing), None, None, None)
    return force, flowing


def stresses(u: FloatArray, bricks: Elements, law: Law, history: History | None) -> FloatArray:
    """(m, 6, 8) stresses at the Gauss points in Pa; arguments as for `internal_force`."""
    stress = np.empty((bricks.number, 6, 8))
    _stress_update(u, bricks, law, history, None, None, stress, None, None)
    return stress


def commit(u: FloatArray, bricks: Elements, law: Law, history: History) -> None:
    """Move `history` on, in place, to the end of the increment with the displacement `u`.

    The history is the largest array of a solve, so no copy of it is made.
    """
    _stress_update(u, bricks, law, history, None, None, None, history, None)


def tangent_correction(
    u: FloatArray, bricks: Elements, law: Law, history: History, flowing: NDArray[np.bool_]
) -> TangentCorrection:
    """The consistent tangent less the elastic stiffness at the displacement `u`.

    `flowing` says which elements flow there, as `internal_force` returns it.
    """
    which = np.flatnonzero(flowing)
    terms = np.empty((which.size, 8, 8))
    _stress_update(u, bricks, law, history, which, None, None, None, terms)
    return TangentCorrection(which, terms)


def add_correction(
    v: FloatArray, bricks: Elements, correction: TangentCorrection, scale: float, out: FloatArray
) -> None:
    """Add `scale` (tangent - elastic stiffness) v to `out`, in place; both are (nodes, 3)."""
    _add_correction(v, bricks, correction, scale, out)
