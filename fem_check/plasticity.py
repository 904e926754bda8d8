"""Small-strain J2 plasticity with radial return, point by point and over all elements.

Stress and strain: tensor components xx, yy, zz, xy, yz, zx.  With the shear modulus mu,
the bulk modulus K, the yield stress sigma_Y, the modulus H of linear isotropic
hardening, a strain e, its plastic part e_p and the accumulated plastic strain a:

    s_trial = 2 mu (dev e - e_p),   R = sqrt(2/3) (sigma_Y + H a)
    over    = max(|s_trial| - R, 0) / (1 + H/(3 mu))            (= 2 mu times the multiplier)
    n = s_trial/|s_trial|,   s = s_trial - over n,   p = K tr e
    e_p <- e_p + over/(2 mu) n,   a <- a + sqrt(2/3) over/(2 mu)

(Simo and Hughes, Computational Inelasticity, box 3.1), with the consistent tangent

    C = K I (x) I + 2 mu theta I_dev - 2 mu theta_bar n (x) n,
    theta = 1 - over/|s_trial|,   theta_bar = 1/(1 + H/(3 mu)) - (1 - theta)     (box 3.2).

Only elements that have flowed have a history (e_p, a): they are few, and it is large.
Two compiled loops work on LANES elements at a time (`lanes`): `_stress_update` finds
Hooke's stresses, and returns those of the elements that have flowed or would flow to
the yield surface; `_add_correction` multiplies by the consistent tangent less the
elastic stiffness.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.results import FloatArray
from fem_check import element
from fem_check.element import Elements, layers_apart
from fem_check.lanes import LANES, compiled, forces, gather, scatter, strains, workspace
from fem_check.workers import ALONE, Workers

_ROOT = sqrt(2.0 / 3.0)


class Law(NamedTuple):
    """mu = shear, K = bulk, sigma_Y = yield_stress, H = hardening; all in Pa."""

    shear: float
    bulk: float
    yield_stress: float
    hardening: float = 0.0


def law(
    young_modulus: float,
    poisson_ratio: float,
    yield_stress: float,
    hardening: float = 0.0,
) -> Law:
    """The law of a material: Figure 1 of the paper where the hardening is 0."""
    E, nu = young_modulus, poisson_ratio
    return Law(
        E / (2 * (1 + nu)),
        E / (3 * (1 - 2 * nu)),
        float(yield_stress),
        float(hardening),
    )


def layer_stiffness(bricks: Elements, law: Law) -> tuple[FloatArray, FloatArray]:
    """The elastic (layers, 24 x 24) and deviatoric (layers, 8, 24 x 24) stiffness of
    elements.
    """
    layers = range(len(bricks.weights))
    elastic = [
        element.elastic_stiffness(bricks, k, law.shear, law.bulk) for k in layers
    ]
    deviatoric = [element.deviatoric_stiffness(bricks, k) for k in layers]
    return np.reshape(elastic, (-1, 576)), np.reshape(deviatoric, (-1, 8, 576))


class History(NamedTuple):
    """The history variables of m elements, of which k have flowed.

    rows: (m,) each element's index in plastic_strain (k + 1, 6, 8) and accumulated (k +
    1, 8), whose first row, of zeros, is that of all elements that have never flowed.
    """

    rows: NDArray[np.int32]
    plastic_strain: FloatArray
    accumulated: FloatArray


class TangentCorrection(NamedTuple):
    """The consistent tangent less the elastic stiffness, in the elements `which` flow.

    terms: (k, 8, 8), the six components of n, 2 mu (1 - theta) and 2 mu theta_bar, by
        Gauss point.
    """

    which: NDArray[np.int64]
    terms: FloatArray


def initial_history(count: int) -> History:
    """The history of `count` elements that have never yielded."""
    return History(np.zeros(count, np.int32), np.zeros((1, 6, 8)), np.zeros((1, 8)))


@compiled
def _elastic_stress(e, dilatation, law, worst):  # type: ignore[no-untyped-def]
    """Turns local strains into Hooke's stresses; `worst` is each element's largest |dev
    s|^2.
    """
    G, p, L = law[0], np.empty(LANES), LANES
    for n in range(L):
        p[n] = law[1] * dilatation[n]
        worst[n] = 0.0
    for q in range(0, 8 * L, L):
        for n in range(q, q + L):
            xx, yy, zz = e[n], e[n + 8 * L], e[n + 16 * L]
            m = (xx + yy + zz) / 3
            xx, yy, zz = 2 * G * (xx - m), 2 * G * (yy - m), 2 * G * (zz - m)
            xy, yz, zx = (
                2 * G * e[n + 24 * L],
                2 * G * e[n + 32 * L],
                2 * G * e[n + 40 * L],
            )
            norm = xx * xx + yy * yy + zz * zz + 2 * (xy * xy + yz * yz + zx * zx)
            worst[n - q] = max(worst[n - q], norm)
            e[n], e[n + 8 * L], e[n + 16 * L] = (
                xx + p[n - q],
                yy + p[n - q],
                zz + p[n - q],
            )
            e[n + 24 * L], e[n + 32 * L], e[n + 40 * L] = xy, yz, zx


@compiled
def _trial(s, at, p, history, row, q, law):  # type: ignore[no-untyped-def]
    """Trial deviatoric stress, its norm (1 where the point does not flow), and
    `over`.
    """
    G2, L, ep = 2 * law[0], 8 * LANES, history.plastic_strain
    xx = s[at] - p - G2 * ep[row, 0, q]
    yy = s[at + L] - p - G2 * ep[row, 1, q]
    zz = s[at + 2 * L] - p - G2 * ep[row, 2, q]
    xy = s[at + 3 * L] - G2 * ep[row, 3, q]
    yz = s[at + 4 * L] - G2 * ep[row, 4, q]
    zx = s[at + 5 * L] - G2 * ep[row, 5, q]
    squared = xx * xx + yy * yy + zz * zz + 2 * (xy * xy + yz * yz + zx * zx)
    radius = _ROOT * (law[2] + law[3] * history.accumulated[row, q])
    norm, over = 1.0, 0.0
    if squared > radius * radius:
        norm = sqrt(squared)
        over = (norm - radius) / (1 + law[3] / (3 * law[0]))
    return (xx, yy, zz, xy, yz, zx), norm, over


@compiled
def _return(  # type: ignore[no-untyped-def]  # noqa: PLR0913, PLR0917 - one law
    s, n, p, history, row, law, updated, terms, k
):
    """Returns the stresses of lane n to the yield surface; True if a point flows.
    `updated` is the history to move on, and terms[k] are those of the correction, or
    they are None.
    """
    flows = False
    for q in range(8):
        at = q * LANES + n
        t, norm, over = _trial(s, at, p, history, row, q, law)
        loss = over / norm  # 1 - theta
        flows = flows or over > 0
        for i in range(6):
            s[at + 8 * LANES * i] = (1 - loss) * t[i] + (p if i < 3 else 0.0)
        if updated is not None and over > 0:
            for i in range(6):
                updated.plastic_strain[row, i, q] += loss / (2 * law[0]) * t[i]
            updated.accumulated[row, q] += _ROOT * over / (2 * law[0])
        if terms is not None:
            for i in range(6):
                terms[k, i, q] = t[i] / norm
            terms[k, 6, q] = 2 * law[0] * loss
            still = 1 / (1 + law[3] / (3 * law[0])) if over > 0 else 0.0
            terms[k, 7, q] = 2 * law[0] * (still - loss)
    return flows


@compiled
def _stress_update(  # type: ignore[no-untyped-def]  # noqa: PLR0913, PLR0917 - one law
    u, bricks, law, history, which, nodal, stress, updated, terms, ranges
):
    """Radial return of all elements, or of `which`; without a history the law is
    elastic.  Each of the outputs may be None, and is then left out of the compiled
    loop: nodal = (force, flowing), where the internal force is added to `force`; stress
    (m, 6, 8); updated; terms.
    """
    ue, d, s, fe = workspace()
    dilatation, worst, shapes = (
        np.empty(LANES),
        np.empty(LANES),
        np.empty(LANES, np.int32),
    )
    limit = (_ROOT * law[2]) ** 2
    for r in range(ranges.shape[0]):
        stop = ranges[r, 1]
        for first in range(ranges[r, 0], stop, LANES):
            gather(u, bricks, which, first, stop, ue, shapes)
            strains(bricks.sides, bricks, shapes, ue, d, s, dilatation)
            _elastic_stress(s, dilatation, law, worst)
            for n in range(min(LANES, stop - first)):
                k = first + n
                e = k if which is None else which[k]
                if history is not None:
                    row, flows = history.rows[e], False
                    if which is not None or row > 0 or worst[n] > limit:
                        p = law[1] * dilatation[n]
                        flows = _return(s, n, p, history, row, law, updated, terms, k)
                    if nodal is not None:
                        nodal[1][e] = flows
                if stress is not None:
                    for i in range(6):
                        for q in range(8):
                            stress[e, i, q] = s[(8 * i + q) * LANES + n]
            if nodal is not None:
                forces(bricks.sides, bricks, shapes, s, fe)
                scatter(fe, bricks, which, first, stop, nodal[0])


@compiled
def _correct(e, n, terms, k, scale):  # type: ignore[no-untyped-def]
    """Turns the strains of lane n into `scale` times the correction of the stresses."""
    L = 8 * LANES
    for at in range(n, L, LANES):
        q = at // LANES
        xx, yy, zz = e[at], e[at + L], e[at + 2 * L]
        xy, yz, zx = e[at + 3 * L], e[at + 4 * L], e[at + 5 * L]
        m, t = (xx + yy + zz) / 3, terms[k, :6, q]
        along = (
            t[0] * xx + t[1] * yy + t[2] * zz + 2 * (t[3] * xy + t[4] * yz + t[5] * zx)
        )
        a, b = -scale * terms[k, 6, q], -scale * terms[k, 7, q] * along
        e[at], e[at + L] = a * (xx - m) + b * t[0], a * (yy - m) + b * t[1]
        e[at + 2 * L], e[at + 3 * L] = a * (zz - m) + b * t[2], a * xy + b * t[3]
        e[at + 4 * L], e[at + 5 * L] = a * yz + b * t[4], a * zx + b * t[5]


@compiled
def _add_correction(v, bricks, correction, scale, f, ranges):  # type: ignore[no-untyped-def]
    ue, d, s, fe = workspace()
    dilatation, shapes = np.empty(LANES), np.empty(LANES, np.int32)
    which, terms = correction
    for r in range(ranges.shape[0]):
        stop = ranges[r, 1]
        for first in range(ranges[r, 0], stop, LANES):
            gather(v, bricks, which, first, stop, ue, shapes)
            strains(bricks.sides, bricks, shapes, ue, d, s, dilatation)
            for n in range(min(LANES, stop - first)):
                _correct(s, n, terms, first + n, scale)
            forces(bricks.sides, bricks, shapes, s, fe)
            scatter(fe, bricks, which, first, stop, f)


def internal_force(
    u: FloatArray,
    bricks: Elements,
    law: Law,
    history: History | None,
    workers: Workers = ALONE,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The internal force (nodes, 3) of `u` after a history, if any, and which elements
    flow.
    """
    nodal = np.zeros_like(u), np.zeros(bricks.number, dtype=np.bool_)
    task = partial(
        _stress_update, u, bricks, law, history, None, nodal, None, None, None
    )
    _share(task, bricks, None, workers)
    return nodal


def stresses(
    u: FloatArray, bricks: Elements, law: Law, history: History | None
) -> FloatArray:
    """(m, 6, 8) stresses at the Gauss points in Pa; arguments as for
    `internal_force`.
    """
    stress = np.empty((bricks.number, 6, 8))
    task = partial(
        _stress_update, u, bricks, law, history, None, None, stress, None, None
    )
    _share(task, bricks, None, ALONE)
    return stress


def stored_energy(stress: FloatArray, bricks: Elements, law: Law) -> float:
    """The integral of |s|^2/(4 mu) + p^2/(2 K), in J, of (m, 6, 8) stresses."""
    p = stress[:, :3].mean(axis=1)
    normal, shears = stress[:, :3] - p[:, None], stress[:, 3:]
    squared = (normal**2).sum(axis=1) + 2 * (shears**2).sum(axis=1)
    density = squared / (4 * law.shear) + p**2 / (2 * law.bulk)
    return float((bricks.weights[bricks.shape_of] * density).sum())


def commit(
    u: FloatArray,
    bricks: Elements,
    law: Law,
    history: History,
    flowing: NDArray[np.bool_],
) -> History:
    """The history after an increment to `u`, where the elements flow that
    `internal_force` says.
    """
    which, count = np.flatnonzero(flowing), len(history.accumulated)
    new = which[history.rows[which] == 0]
    rows = history.rows.copy()
    rows[new] = np.arange(count, count + new.size)
    longer = History(
        rows,
        np.concatenate([history.plastic_strain, np.zeros((new.size, 6, 8))]),
        np.concatenate([history.accumulated, np.zeros((new.size, 8))]),
    )
    task = partial(
        _stress_update, u, bricks, law, longer, which, None, None, longer, None
    )
    _share(task, bricks, which, ALONE)
    return longer


def tangent_correction(
    u: FloatArray,
    bricks: Elements,
    law: Law,
    history: History,
    flowing: NDArray[np.bool_],
    workers: Workers = ALONE,
) -> TangentCorrection:
    """The consistent tangent less the elastic one at `u`; `flowing` as from
    `internal_force`.
    """
    which = np.flatnonzero(flowing)
    terms = np.empty((which.size, 8, 8))
    task = partial(
        _stress_update, u, bricks, law, history, which, None, None, None, terms
    )
    _share(task, bricks, which, workers)
    return TangentCorrection(which, terms)


def add_correction(
    v: FloatArray,
    bricks: Elements,
    correction: TangentCorrection,
    scale: float,
    out: FloatArray,
    workers: Workers = ALONE,
) -> None:
    """Add `scale` (tangent - elastic stiffness) v to `out`, in place; both are (nodes,
    3).
    """
    task = partial(_add_correction, v, bricks, correction, scale, out)
    _share(task, bricks, correction.which, workers)


def _share(
    task: Callable[[NDArray[np.int64]], Any],
    bricks: Elements,
    which: NDArray[np.int64] | None,
    workers: Workers,
) -> None:
    """Call `task` with the layers of all elements or of `which`, half of the layers at
    a time.
    """
    for layers in layers_apart(bricks, which):
        workers.share(task, layers)
