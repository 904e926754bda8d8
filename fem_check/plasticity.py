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

The history (e_p, a) changes in `commit` alone, which a converged step calls; until then it is
only read.  The loops are compiled; `force` is the internal force of the B-bar brick of
`element`, whose dilatation is the element's mean.
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
    """The law of a material; an infinite yield_stress is elasticity."""
    E, nu = young_modulus, poisson_ratio
    return Law(E / (2 * (1 + nu)), E / (3 * (1 - 2 * nu)), float(yield_stress), float(hardening))


class History(NamedTuple):
    """What the material remembers: plastic_strain (m, 6, 8) and accumulated (m, 8)."""

    plastic_strain: FloatArray
    accumulated: FloatArray


class Softening(NamedTuple):
    """What the consistent tangent lacks of the elastic stiffness, in the elements that flow.

    which: (k,) their numbers.  terms: (k, 8, 8): n, then the weighted 2 mu (1 - theta) and
    2 mu theta_bar, at each Gauss point.
    """

    which: NDArray[np.int64]
    terms: FloatArray


def virgin(count: int) -> History:
    """The history of `count` elements that never yielded."""
    return History(np.zeros((count, 6, 8)), np.zeros((count, 8)))


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _strain(G, shape, q, ue):  # type: ignore[no-untyped-def]
    """Tensor components of the local strain at Gauss point q."""
    xx = yy = zz = xy = yz = zx = 0.0
    for a in range(8):
        gx, gy, gz = G[shape, 0, a, q], G[shape, 1, a, q], G[shape, 2, a, q]
        xx += gx * ue[a, 0]
        yy += gy * ue[a, 1]
        zz += gz * ue[a, 2]
        xy += gy * ue[a, 0] + gx * ue[a, 1]
        yz += gz * ue[a, 1] + gy * ue[a, 2]
        zx += gx * ue[a, 2] + gz * ue[a, 0]
    return xx, yy, zz, 0.5 * xy, 0.5 * yz, 0.5 * zx


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _trial(strain, ep, acc, law):  # type: ignore[no-untyped-def]
    """Trial deviatoric stress, its norm, and how far it lies beyond the yield surface."""
    xx, yy, zz, xy, yz, zx = strain
    m = (xx + yy + zz) / 3
    G2 = 2 * law[0]
    sxx, syy, szz = G2 * (xx - m - ep[0]), G2 * (yy - m - ep[1]), G2 * (zz - m - ep[2])
    sxy, syz, szx = G2 * (xy - ep[3]), G2 * (yz - ep[4]), G2 * (zx - ep[5])
    norm = sqrt(sxx * sxx + syy * syy + szz * szz + 2 * (sxy * sxy + syz * syz + szx * szx))
    over = max(norm - _ROOT * (law[2] + law[3] * acc), 0.0) / (1 + law[3] / (3 * law[0]))
    return (sxx, syy, szz, sxy, syz, szx), norm, over


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _scatter(G, shape, nodes, s, f):  # type: ignore[no-untyped-def]
    """f += sum over the Gauss points of the weighted stresses s (6, 8) times the gradients."""
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
def _gather(u, nodes, Gm, shape, ue):  # type: ignore[no-untyped-def]
    """Copies an element's displacements to ue (8, 3) and returns its mean dilatation."""
    dilatation = 0.0
    for a in range(8):
        n = nodes[a]
        for i in range(3):
            ue[a, i] = u[n, i]
            dilatation += Gm[shape, i, a] * u[n, i]
    return dilatation


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _force(u, bricks, history, law, f, yielded):  # type: ignore[no-untyped-def]
    ue, s = np.empty((8, 3)), np.empty((6, 8))
    conn, shape_of, G, Gm, w = bricks
    ep, acc = history
    for e in range(conn.shape[0]):
        shape = shape_of[e]
        p = law[1] * _gather(u, conn[e], Gm, shape, ue)
        worst = 0.0
        for q in range(8):
            t, norm, over = _trial(_strain(G, shape, q, ue), ep[e, :, q], acc[e, q], law)
            worst = max(worst, over)
            wq = w[shape, q]
            c = wq * (1 - over / max(norm, 1e-300))
            s[0, q], s[1, q], s[2, q] = c * t[0] + wq * p, c * t[1] + wq * p, c * t[2] + wq * p
            s[3, q], s[4, q], s[5, q] = c * t[3], c * t[4], c * t[5]
        yielded[e] = worst > 0
        _scatter(G, shape, conn[e], s, f)


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _elastic(u, bricks, law, f):  # type: ignore[no-untyped-def]
    ue, s = np.empty((8, 3)), np.empty((6, 8))
    conn, shape_of, G, Gm, w = bricks
    for e in range(conn.shape[0]):
        shape = shape_of[e]
        p = law[1] * _gather(u, conn[e], Gm, shape, ue)
        for q in range(8):
            xx, yy, zz, xy, yz, zx = _strain(G, shape, q, ue)
            wq = w[shape, q]
            c, m = 2 * law[0] * wq, (xx + yy + zz) / 3
            s[0, q], s[1, q], s[2, q] = c * (xx - m), c * (yy - m), c * (zz - m)
            for i in range(3):
                s[i, q] += wq * p
            s[3, q], s[4, q], s[5, q] = c * xy, c * yz, c * zx
        _scatter(G, shape, conn[e], s, f)


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _linearise(u, bricks, history, law, which, out):  # type: ignore[no-untyped-def]
    ue = np.empty((8, 3))
    conn, shape_of, G, Gm, w = bricks
    ep, acc = history
    for k in range(which.size):
        e = which[k]
        shape = shape_of[e]
        _gather(u, conn[e], Gm, shape, ue)
        for q in range(8):
            t, norm, over = _trial(_strain(G, shape, q, ue), ep[e, :, q], acc[e, q], law)
            safe = max(norm, 1e-300)
            for i in range(6):
                out[k, i, q] = t[i] / safe
            loss = over / safe  # 1 - theta
            stiff = 2 * law[0] * w[shape, q]
            out[k, 6, q] = stiff * loss
            flows = 1.0 if over > 0 else 0.0
            out[k, 7, q] = stiff * flows * (1 / (1 + law[3] / (3 * law[0])) - loss)


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _soften(v, bricks, softening, scale, f):  # type: ignore[no-untyped-def]
    ue, s = np.empty((8, 3)), np.empty((6, 8))
    conn, shape_of, G, Gm, _ = bricks
    which, terms = softening
    for k in range(which.size):
        e = which[k]
        shape = shape_of[e]
        _gather(v, conn[e], Gm, shape, ue)
        for q in range(8):
            xx, yy, zz, xy, yz, zx = _strain(G, shape, q, ue)
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
        _scatter(G, shape, conn[e], s, f)


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _stresses(u, bricks, history, law, out):  # type: ignore[no-untyped-def]
    ue = np.empty((8, 3))
    conn, shape_of, G, Gm, _ = bricks
    ep, acc = history
    for e in range(conn.shape[0]):
        shape = shape_of[e]
        p = law[1] * _gather(u, conn[e], Gm, shape, ue)
        for q in range(8):
            t, norm, over = _trial(_strain(G, shape, q, ue), ep[e, :, q], acc[e, q], law)
            keep = 1 - over / max(norm, 1e-300)
            for i in range(6):
                out[e, i, q] = keep * t[i] + (p if i < 3 else 0.0)


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def _commit(u, bricks, history, law):  # type: ignore[no-untyped-def]
    ue = np.empty((8, 3))
    conn, shape_of, G, Gm, _ = bricks
    ep, acc = history
    for e in range(conn.shape[0]):
        shape = shape_of[e]
        _gather(u, conn[e], Gm, shape, ue)
        for q in range(8):
            t, norm, over = _trial(_strain(G, shape, q, ue), ep[e, :, q], acc[e, q], law)
            if over > 0:
                for i in range(6):
                    ep[e, i, q] += over / (2 * law[0]) * t[i] / norm
                acc[e, q] += _ROOT * over / (2 * law[0])


def force(
    u: FloatArray, bricks: Elements, law: Law, history: History, force: FloatArray
) -> NDArray[np.bool_]:
    """Writes the internal force of the (nodes, 3) displacement `u` to `force`, in N; returns
    (m,) which elements flow at it."""
    force[:] = 0
    yielded = np.empty(bricks.number, dtype=np.bool_)
    _force(u, bricks, history, law, force, yielded)
    return yielded


def elastic_force(u: FloatArray, bricks: Elements, law: Law, force: FloatArray) -> None:
    """Writes the elastic stiffness times `u`, both (nodes, 3), to `force`."""
    force[:] = 0
    _elastic(u, bricks, law, force)


def linearise(
    u: FloatArray, bricks: Elements, law: Law, history: History, yielded: NDArray[np.bool_]
) -> Softening:
    """The softening at the displacement `u`, given which elements flow there."""
    which = np.flatnonzero(yielded)
    terms = np.empty((which.size, 8, 8))
    _linearise(u, bricks, history, law, which, terms)
    return Softening(which, terms)


def soften(
    v: FloatArray, bricks: Elements, softening: Softening, scale: float, product: FloatArray
) -> None:
    """Adds `scale` (tangent - elastic stiffness) v to `product`, both (nodes, 3)."""
    _soften(v, bricks, softening, scale, product)


def stresses(u: FloatArray, bricks: Elements, law: Law, history: History) -> FloatArray:
    """(m, 6, 8) stress at the Gauss points in Pa; the dilatation is the element's mean."""
    out = np.empty((bricks.number, 6, 8))
    _stresses(u, bricks, history, law, out)
    return out


def commit(u: FloatArray, bricks: Elements, law: Law, history: History) -> None:
    """Moves `history` on to the state of the converged displacement `u`, in place."""
    _commit(u, bricks, history, law)


def return_map(
    strain: FloatArray, plastic_strain: FloatArray, accumulated: float, law: Law
) -> tuple[FloatArray, FloatArray, float, FloatArray]:
    """One point: (stress (6,), new plastic strain (6,), new accumulated, tangent (6, 6)).

    The strain is (6,) with tensor shears; the tangent is d stress / d strain with both shears of
    the strain tensor moving together, so its shear columns count twice.
    """
    K, mu, H = law.bulk, law.shear, law.hardening
    trial, norm, over = _trial(tuple(strain), plastic_strain, accumulated, law)
    t = np.array(trial)
    n = t / max(norm, 1e-300)
    loss = over / max(norm, 1e-300)
    flow = (1 / (1 + H / (3 * mu)) - loss) if over > 0 else 0.0
    eye = np.array([1.0, 1, 1, 0, 0, 0])
    twice = np.array([1.0, 1, 1, 2, 2, 2])
    deviator = np.diag([1.0] * 6) - np.outer(eye, eye) / 3
    tangent = (
        K * np.outer(eye, eye)
        + 2 * mu * (1 - loss) * deviator
        - 2 * mu * flow * np.outer(n, n * twice)
    )
    stress = t - over * n + K * strain[:3].sum() * eye
    return (
        stress,
        plastic_strain + over / (2 * mu) * n,
        accumulated + _ROOT * over / (2 * mu),
        tangent,
    )
