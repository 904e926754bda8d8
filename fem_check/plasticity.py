"""Small-strain J2 plasticity with radial return, at a point and over all elements.

Stress and strain have the tensor components xx, yy, zz, xy, yz, zx.  With the shear
modulus mu, the bulk modulus K, the yield stress sigma_Y, the modulus H of isotropic
hardening, a strain e, its plastic part e_p and the accumulated plastic strain a, radial
return is

    s_trial = 2 mu (dev e - e_p)
    R = sqrt(2/3) (sigma_Y + H a)
    excess = max(|s_trial| - R, 0) / (1 + H/(3 mu))  (2 mu times the multiplier)
    n = s_trial/|s_trial|
    s = s_trial - excess n
    p = K tr e
    e_p <- e_p + excess/(2 mu) n
    a <- a + sqrt(2/3) excess/(2 mu)

(Simo and Hughes, Computational Inelasticity, box 3.1).  The consistent tangent is

    C = K I (x) I + 2 mu theta I_dev - 2 mu theta_bar n (x) n
    theta = 1 - excess/|s_trial|
    theta_bar = 1/(1 + H/(3 mu)) - (1 - theta)

(box 3.2).  A hardening curve has a modulus H and a line sigma_Y + H a in each of its
segments.  The return ends on the segment that it reaches, on whose line R is taken, so
that the formulas above hold there.  Any law of isotropic hardening comes as such a
curve, the `yield_curve` of the material (`epcontact.scene.HARDENING_LAWS`).

Only elements that have flowed have a history (e_p, a): they are few, and a history is
large.  Two compiled loops work on LANES elements at a time (`lanes`).  `_stress_update`
computes Hooke's stresses and returns those that violate the yield condition to the
yield surface.  `_add_correction` multiplies by the consistent tangent less the elastic
stiffness.
"""

# mypy: allow-untyped-defs
# numba infers the types of the compiled functions.

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from epcontact.results import FloatArray
from epcontact.scene import Material
from fem_check.element import (
    Elements,
    deviatoric_stiffness,
    disjoint_layers,
    elastic_stiffness,
)
from fem_check.lanes import (
    LANES,
    compiled,
    forces,
    gather,
    inlined,
    scatter,
    strains,
    workspace,
)
from fem_check.workers import SERIAL, Workers

#: sqrt(2/3): |dev s| of a uniaxial stress of 1.
_ROOT = sqrt(2.0 / 3.0)


class Moduli(NamedTuple):
    """The moduli and the stress of a `J2Law`, in Pa, without its hardening curve.

    Compiled functions take the curve as an argument of its own.  Without a curve it is
    None, and numba leaves out what belongs to a curve: otherwise the stress update
    would take a third longer.

    Attributes:
        shear_modulus: mu.
        bulk_modulus: K.
        yield_stress: sigma_Y; infinite for an elastic body.
        hardening_modulus: H.
    """

    shear_modulus: float
    bulk_modulus: float
    yield_stress: float
    hardening_modulus: float


class J2Law(NamedTuple):
    """The law of an elastoplastic material with the yield condition of von Mises (J2).

    Without hardening it is the elastic and perfectly plastic solid in Figure 1 of the
    paper by Almqvist and Persson, "Multiscale contact mechanics for elastoplastic
    contacts".  Below the yield stress it is linearly elastic.

    Attributes:
        shear_modulus: mu, in Pa.
        bulk_modulus: K, in Pa.
        yield_stress: sigma_Y in uniaxial tension, in Pa; infinite for an elastic body.
        hardening_modulus: H, the slope of the yield stress over the accumulated plastic
            strain, in Pa; of a hardening curve that of the first segment.
        bends: (n, 2) points where the slope of a hardening curve changes: accumulated
            plastic strain, ascending, and change of the slope in Pa; None: there is no
            curve.
        saturates: whether the yield stress is bounded, so that a body can flow freely.
    """

    shear_modulus: float
    bulk_modulus: float
    yield_stress: float
    hardening_modulus: float = 0.0
    bends: FloatArray | None = None
    saturates: bool = True

    @property
    def moduli(self) -> Moduli:
        """The moduli and the yield stress of this law."""
        return Moduli(*self[:4])


def law_of(material: Material, flows: bool) -> J2Law:
    """Return the law of a material.

    Args:
        material: elastic constants, yield stress and hardening.
        flows: whether it flows; otherwise the law has an infinite yield stress.
    """
    if not flows:
        return j2_law(material.young_modulus, material.poisson_ratio, math.inf)
    curve = material.yield_curve
    slopes = np.diff(curve.stresses) / np.diff(curve.strains)
    slopes = np.append(slopes, curve.last_slope)
    bends = None
    if len(slopes) > 1:
        bends = np.stack([curve.strains[1:], np.diff(slopes)], axis=1)
    law = j2_law(
        material.young_modulus,
        material.poisson_ratio,
        curve.stresses[0],
        float(slopes[0]),
    )
    return law._replace(bends=bends, saturates=curve.last_slope == 0)


def j2_law(
    young_modulus: float,
    poisson_ratio: float,
    yield_stress: float,
    hardening_modulus: float = 0.0,
) -> J2Law:
    """Return the law of a J2 material with linear hardening, or without hardening.

    Args:
        young_modulus: in Pa.
        poisson_ratio: below 0.5.
        yield_stress: in uniaxial tension, in Pa; infinite for an elastic body.
        hardening_modulus: slope of the yield stress over the accumulated plastic
            strain, in Pa; 0 is perfect plasticity.
    """
    return J2Law(
        shear_modulus=young_modulus / (2 * (1 + poisson_ratio)),
        bulk_modulus=young_modulus / (3 * (1 - 2 * poisson_ratio)),
        yield_stress=float(yield_stress),
        hardening_modulus=float(hardening_modulus),
        saturates=hardening_modulus == 0,
    )


@inlined
def _yield_radius(accumulated, law):
    """Return the radius R of the yield surface, the largest |dev s|, in Pa.

    Args:
        accumulated: accumulated plastic strain, dimensionless.
        law: the `Moduli` of a law without a hardening curve.
    """
    return _ROOT * (law.yield_stress + law.hardening_modulus * accumulated)


@inlined
def _plastic_excess(norm, radius, law):
    """Return the stress excess of radial return in Pa, and 1/(1 + H/(3 mu)).

    The excess is what a trial stress loses when it returns to the yield surface: 2 mu
    times the plastic multiplier.  The second value enters the consistent tangent.

    Args:
        norm: Frobenius norm |s| of the deviatoric trial stress, in Pa, above the
            radius.
        radius: of the yield surface in the same norm, in Pa.
        law: the `Moduli` of a law without a hardening curve.
    """
    resistance = 1 + law.hardening_modulus / (3 * law.shear_modulus)
    return (norm - radius) / resistance, 1 / resistance


@compiled
def _radius_on_curve(accumulated, law, bends):
    """Return the radius of the yield surface of a law with a hardening curve, in Pa.

    Args:
        accumulated: accumulated plastic strain, dimensionless.
        law: the `Moduli` of the law.
        bends: of the law, see `J2Law`.
    """
    stress = law.yield_stress + law.hardening_modulus * accumulated
    for k in range(bends.shape[0]):
        if accumulated <= bends[k, 0]:
            break
        stress += bends[k, 1] * (accumulated - bends[k, 0])
    return _ROOT * stress


@compiled
def _excess_on_curve(norm, accumulated, law, bends):
    """Return what `_plastic_excess` returns, of a law with a hardening curve.

    The modulus H is that of the curve's segment in which the return ends.

    Args:
        norm: Frobenius norm |s| of the deviatoric trial stress, in Pa, above the radius
            of the yield surface.
        accumulated: accumulated plastic strain before the return, dimensionless.
        law: the `Moduli` of the law.
        bends: of the law, see `J2Law`.
    """
    # The line of the segment, extended to the strain `accumulated`.
    slope = law.hardening_modulus
    stress = law.yield_stress + slope * accumulated
    resistance = 1 + slope / (3 * law.shear_modulus)
    excess = (norm - _ROOT * stress) / resistance
    for k in range(bends.shape[0]):
        # A line that is extended beyond its segment may lie above the trial stress.
        growth = _ROOT * max(excess, 0.0) / (2 * law.shear_modulus)
        if accumulated + growth <= bends[k, 0]:
            break
        slope += bends[k, 1]
        stress += bends[k, 1] * (accumulated - bends[k, 0])
        resistance = 1 + slope / (3 * law.shear_modulus)
        excess = (norm - _ROOT * stress) / resistance
    return excess, 1 / resistance


def plastic_work_density(accumulated: FloatArray, law: J2Law) -> FloatArray:
    """Return the plastic work per volume in J/m^3 after accumulated plastic strains.

    It is sigma_Y a + H a^2/2, and (a - b)^2/2 times the change of the slope for each
    bend b of a hardening curve below a.

    Args:
        accumulated: accumulated plastic strains a, of any shape, dimensionless.
        law: with the yield stress sigma_Y, the hardening modulus H and the changes of
            the slope in Pa.
    """
    work = law.yield_stress * accumulated + law.hardening_modulus * accumulated**2 / 2
    if law.bends is not None:
        for strain, change in law.bends:
            work += change * np.maximum(accumulated - strain, 0.0) ** 2 / 2
    return work


def layer_stiffness(bricks: Elements, law: J2Law) -> tuple[FloatArray, FloatArray]:
    """Return the element stiffness of each shape of elements, row by row.

    Args:
        bricks: the elements, whose shapes are layers in a flat block.
        law: of the material, whose two elastic moduli are used.

    Returns:
        elastic: (shapes, 24 * 24) stiffness, in N/m.
        deviatoric: (shapes, 8, 24 * 24) integrals of dev e : dev e at each Gauss point,
            in m, from `deviatoric_stiffness`.
    """
    moduli = law.shear_modulus, law.bulk_modulus
    shapes = range(len(bricks.weights))
    elastic = [elastic_stiffness(bricks, shape, *moduli) for shape in shapes]
    deviatoric = [deviatoric_stiffness(bricks, shape) for shape in shapes]
    return np.reshape(elastic, (-1, 576)), np.reshape(deviatoric, (-1, 8, 576))


class History(NamedTuple):
    """The plastic strains of m elements, k of which have flowed.

    Attributes:
        rows: (m,) index of each element in the two arrays below; 0 for all elements
            that have never flowed.
        plastic_strain: (k + 1, 6, 8) e_p at the Gauss points; row 0 is zero.
        accumulated: (k + 1, 8) accumulated plastic strain a; row 0 is zero.
    """

    rows: NDArray[np.int32]
    plastic_strain: FloatArray
    accumulated: FloatArray


class TangentCorrection(NamedTuple):
    """The consistent tangent less the elastic stiffness, in the elements that flow.

    Attributes:
        elements: (k,) numbers of these elements.
        terms: (k, 8, 8) by Gauss point (last index): the six components of n, then
            2 mu (1 - theta) and 2 mu theta_bar in Pa.
    """

    elements: NDArray[np.int64]
    terms: FloatArray


def initial_history(count: int) -> History:
    """Return the history of `count` elements that have never flowed."""
    return History(np.zeros(count, np.int32), np.zeros((1, 6, 8)), np.zeros((1, 8)))


@compiled
def _elastic_stress(e, dilatation, law, largest):
    """Turn local strains into Hooke's stresses, in place, for LANES elements at once.

    Arrays are flat, with the element as the last index.

    Args:
        e: (6, 8, LANES) strains xx, yy, zz, xy, yz, zx at the Gauss points; they become
            stresses in Pa.
        dilatation: (LANES,) mean dilatation of each element.
        law: a `J2Law`, with moduli in Pa.
        largest: (LANES,) receives the largest |dev s|^2 of each element, in Pa^2.
    """
    G2 = 2 * law.shear_modulus
    L = LANES
    pressure = np.empty(L)
    for n in range(L):
        pressure[n] = law.bulk_modulus * dilatation[n]
        largest[n] = 0.0
    for q in range(0, 8 * L, L):
        for n in range(q, q + L):
            xx = e[n]
            yy = e[n + 8 * L]
            zz = e[n + 16 * L]
            mean = (xx + yy + zz) / 3
            xx = G2 * (xx - mean)
            yy = G2 * (yy - mean)
            zz = G2 * (zz - mean)
            xy = G2 * e[n + 24 * L]
            yz = G2 * e[n + 32 * L]
            zx = G2 * e[n + 40 * L]
            squared = xx * xx + yy * yy + zz * zz + 2 * (xy * xy + yz * yz + zx * zx)
            largest[n - q] = max(largest[n - q], squared)
            e[n] = xx + pressure[n - q]
            e[n + 8 * L] = yy + pressure[n - q]
            e[n + 16 * L] = zz + pressure[n - q]
            e[n + 24 * L] = xy
            e[n + 32 * L] = yz
            e[n + 40 * L] = zx


@compiled
def _trial_stress(s, at, p, history, row, q, law, bends):  # noqa: PLR0913, PLR0917
    """Return what radial return needs at Gauss point q of one element.

    Args:
        s: (6, 8, LANES) Hooke's stresses in Pa, flat, with the element as the last
            index.
        at: index in `s` of the point's component xx.
        p: mean stress, in Pa.
        history: plastic strains before the increment.
        row: of the element in the arrays of the history.
        q: number of the Gauss point, below 8.
        law: the `Moduli` of the law, in Pa.
        bends: of the law, see `J2Law`; None: it has no curve.

    Returns:
        The deviatoric trial stress (xx, yy, zz, xy, yz, zx) in Pa; its norm in Pa (1 if
        the point does not flow); the excess in Pa and 1/(1 + H/(3 mu)), as in
        `_plastic_excess` (both 0 if it does not flow).
    """
    G2 = 2 * law.shear_modulus
    L = 8 * LANES
    plastic = history.plastic_strain
    xx = s[at] - p - G2 * plastic[row, 0, q]
    yy = s[at + L] - p - G2 * plastic[row, 1, q]
    zz = s[at + 2 * L] - p - G2 * plastic[row, 2, q]
    xy = s[at + 3 * L] - G2 * plastic[row, 3, q]
    yz = s[at + 4 * L] - G2 * plastic[row, 4, q]
    zx = s[at + 5 * L] - G2 * plastic[row, 5, q]
    squared = xx * xx + yy * yy + zz * zz + 2 * (xy * xy + yz * yz + zx * zx)
    radius = _yield_radius(history.accumulated[row, q], law)
    if bends is not None:
        radius = _radius_on_curve(history.accumulated[row, q], law, bends)
    norm = 1.0
    excess = 0.0
    plastic_fraction = 0.0
    if squared > radius * radius:
        norm = sqrt(squared)
        excess, plastic_fraction = _plastic_excess(norm, radius, law)
        if bends is not None:
            excess, plastic_fraction = _excess_on_curve(
                norm, history.accumulated[row, q], law, bends
            )
    return (xx, yy, zz, xy, yz, zx), norm, excess, plastic_fraction


@compiled
def _return_to_yield_surface(s, n, p, history, row, law, bends, updated, terms, k):  # noqa: PLR0913, PLR0917
    """Move the stresses of one element back to the yield surface, in place.

    Args:
        s: (6, 8, LANES) Hooke's stresses in Pa, flat, which are changed.
        n: index of the element among the LANES that are computed at once.
        p: mean stress, in Pa.
        history: plastic strains before the increment.
        row: of the element in the arrays of the history.
        law: the `Moduli` of the law, in Pa.
        bends: of the law, see `J2Law`; None: it has no curve.
        updated: history to which the increment of plastic strain is added, or None.
        terms: those of a `TangentCorrection`, whose entry k is written, or None.
        k: index of the element in `terms`.

    Returns:
        True if a Gauss point flows.
    """
    G2 = 2 * law.shear_modulus
    flows = False
    for q in range(8):
        at = q * LANES + n
        trial, norm, excess, plastic_fraction = _trial_stress(
            s, at, p, history, row, q, law, bends
        )
        flows = flows or excess > 0
        reduction = excess / norm  # 1 - theta
        for i in range(3):
            s[at + 8 * LANES * i] = (1 - reduction) * trial[i] + p
        for i in range(3, 6):
            s[at + 8 * LANES * i] = (1 - reduction) * trial[i]
        if updated is not None and excess > 0:
            for i in range(6):
                updated.plastic_strain[row, i, q] += reduction / G2 * trial[i]
            updated.accumulated[row, q] += _ROOT * excess / G2
        if terms is not None:
            for i in range(6):
                terms[k, i, q] = trial[i] / norm
            terms[k, 6, q] = G2 * reduction
            terms[k, 7, q] = G2 * (plastic_fraction - reduction)
    return flows


@compiled
def _stress_update(  # noqa: PLR0913, PLR0917
    u, bricks, law, bends, history, selected, nodal, stress, updated, terms, ranges
):
    """Compute stresses at displacements u by radial return, and write the outputs.

    An output may be None; numba then leaves it out.

    Args:
        u: (nodes, 3) displacements, in m.
        bricks: the m elements.
        law: the `Moduli` of the law, in Pa.
        bends: of the law, see `J2Law`; None: it has no curve.
        history: plastic strains of all elements; None: the law is elastic.
        selected: numbers of the elements that are meant; None: all.
        nodal: (force, flowing): the internal force in N is added to (nodes, 3), and
            (m,) receives True for elements that flow.
        stress: (m, 6, 8) receives the stresses at the Gauss points, in Pa.
        updated: history to which the increments of plastic strain are added.
        terms: (k, 8, 8) receives those of a `TangentCorrection`.
        ranges: (r, 2) first index and stop index of ranges of `selected`, or of
            elements.
    """
    ue, shapes, derivatives, s, dilatation, fe = workspace()
    largest = np.empty(LANES)
    limit = _yield_radius(0.0, law) ** 2
    for r in range(ranges.shape[0]):
        stop = ranges[r, 1]
        for first in range(ranges[r, 0], stop, LANES):
            gather(u, bricks, selected, first, stop, ue, shapes)
            strains(bricks.sides, bricks, shapes, ue, derivatives, s, dilatation)
            _elastic_stress(s, dilatation, law, largest)
            for n in range(min(LANES, stop - first)):
                k = first + n
                element = k
                if selected is not None:
                    element = selected[k]
                if history is not None:
                    row = history.rows[element]
                    flows = False
                    # Most elements have never flowed and stay below the yield stress.
                    if selected is not None or row > 0 or largest[n] > limit:
                        p = law.bulk_modulus * dilatation[n]
                        flows = _return_to_yield_surface(
                            s, n, p, history, row, law, bends, updated, terms, k
                        )
                    if nodal is not None:
                        nodal[1][element] = flows
                if stress is not None:
                    for i in range(6):
                        for q in range(8):
                            stress[element, i, q] = s[(8 * i + q) * LANES + n]
            if nodal is not None:
                forces(bricks.sides, bricks, shapes, s, fe)
                scatter(fe, bricks, selected, first, stop, nodal[0])


@compiled
def _correct(e, n, terms, k, scale):
    """Turn the strains of one element into its scaled stress correction, in place.

    The correction by the consistent tangent is `scale` times -2 mu (1 - theta) dev e -
    2 mu theta_bar (n : e) n, with the flow direction n.

    Args:
        e: (6, 8, LANES) strains xx, yy, zz, xy, yz, zx, flat, with the element as the
            last index; they become stresses in Pa.
        n: index of the element among the LANES that are computed at once.
        terms: those of a `TangentCorrection`.
        k: index of the element in `terms`.
        scale: dimensionless.
    """
    L = 8 * LANES
    for at in range(n, L, LANES):
        q = at // LANES
        xx = e[at]
        yy = e[at + L]
        zz = e[at + 2 * L]
        xy = e[at + 3 * L]
        yz = e[at + 4 * L]
        zx = e[at + 5 * L]
        mean = (xx + yy + zz) / 3
        t = terms[k, :6, q]
        along = (
            t[0] * xx + t[1] * yy + t[2] * zz + 2 * (t[3] * xy + t[4] * yz + t[5] * zx)
        )
        a = -scale * terms[k, 6, q]
        b = -scale * terms[k, 7, q] * along
        e[at] = a * (xx - mean) + b * t[0]
        e[at + L] = a * (yy - mean) + b * t[1]
        e[at + 2 * L] = a * (zz - mean) + b * t[2]
        e[at + 3 * L] = a * xy + b * t[3]
        e[at + 4 * L] = a * yz + b * t[4]
        e[at + 5 * L] = a * zx + b * t[5]


@compiled
def _add_correction(v, bricks, correction, scale, f, ranges):
    """Add `scale` times the tangent's correction times v to the forces f, in place.

    Args:
        v: (nodes, 3) displacements, in m.
        bricks: the elements.
        correction: consistent tangent less elastic stiffness, in the elements that
            flow.
        scale: dimensionless.
        f: (nodes, 3) forces, in N.
        ranges: (r, 2) first index and stop index of ranges of the correction's
            elements.
    """
    ue, shapes, derivatives, s, dilatation, fe = workspace()
    selected, terms = correction
    for r in range(ranges.shape[0]):
        stop = ranges[r, 1]
        for first in range(ranges[r, 0], stop, LANES):
            gather(v, bricks, selected, first, stop, ue, shapes)
            strains(bricks.sides, bricks, shapes, ue, derivatives, s, dilatation)
            for n in range(min(LANES, stop - first)):
                _correct(s, n, terms, first + n, scale)
            forces(bricks.sides, bricks, shapes, s, fe)
            scatter(fe, bricks, selected, first, stop, f)


def internal_force(
    u: FloatArray,
    bricks: Elements,
    law: J2Law,
    history: History | None,
    workers: Workers = SERIAL,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the internal force of the elements, and the elements that flow.

    Args:
        u: (nodes, 3) displacements, in m.
        bricks: the m elements.
        law: of the material.
        history: plastic strains of the elements before this increment; None: the law is
            elastic.
        workers: threads that share the work.

    Returns:
        force: (nodes, 3) integrals of the stresses times the gradients of the basis
            functions, in N.
        flowing: (m,) True for the elements with a Gauss point that flows.
    """
    nodal = np.zeros_like(u), np.zeros(bricks.number, dtype=np.bool_)
    task = partial(
        _stress_update,
        u,
        bricks,
        law.moduli,
        law.bends,
        history,
        None,
        nodal,
        None,
        None,
        None,
    )
    _run_by_layers(task, bricks, None, workers)
    return nodal


def stresses(
    u: FloatArray, bricks: Elements, law: J2Law, history: History | None
) -> FloatArray:
    """Return (m, 6, 8) stresses xx, yy, zz, xy, yz, zx at the Gauss points, in Pa.

    Args:
        u: (nodes, 3) displacements, in m.
        bricks: the m elements.
        law: of the material.
        history: plastic strains of the elements; None: the law is elastic.
    """
    stress = np.empty((bricks.number, 6, 8))
    task = partial(
        _stress_update,
        u,
        bricks,
        law.moduli,
        law.bends,
        history,
        None,
        None,
        stress,
        None,
        None,
    )
    _run_by_layers(task, bricks, None, SERIAL)
    return stress


def stored_energy(stress: FloatArray, bricks: Elements, law: J2Law) -> float:
    """Return the elastic energy in J: the integral of |dev s|^2/(4 mu) + p^2/(2 K).

    Args:
        stress: (m, 6, 8) at the Gauss points, in Pa.
        bricks: the m elements.
        law: with the shear modulus mu and the bulk modulus K, in Pa.
    """
    p = stress[:, :3].mean(axis=1)
    normal = stress[:, :3] - p[:, None]
    shears = stress[:, 3:]
    squared = (normal**2).sum(axis=1) + 2 * (shears**2).sum(axis=1)
    density = squared / (4 * law.shear_modulus) + p**2 / (2 * law.bulk_modulus)
    return float((bricks.weights[bricks.shape_of] * density).sum())


def commit(
    u: FloatArray,
    bricks: Elements,
    law: J2Law,
    history: History,
    flowing: NDArray[np.bool_],
) -> History:
    """Return the history after a converged increment; the old one stays as it was.

    The plastic strains of the increment are added to the elements that flow.

    Args:
        u: (nodes, 3) converged displacements, in m.
        bricks: the m elements.
        law: of the material.
        history: of the elements before the increment.
        flowing: (m,) True for the elements that flow, from `internal_force` at u.
    """
    selected = np.flatnonzero(flowing)
    new = selected[history.rows[selected] == 0]
    count = len(history.accumulated)
    rows = history.rows.copy()
    rows[new] = np.arange(count, count + new.size)
    updated = History(
        rows,
        np.concatenate([history.plastic_strain, np.zeros((new.size, 6, 8))]),
        np.concatenate([history.accumulated, np.zeros((new.size, 8))]),
    )
    task = partial(
        _stress_update,
        u,
        bricks,
        law.moduli,
        law.bends,
        updated,
        selected,
        None,
        None,
        updated,
        None,
    )
    _run_by_layers(task, bricks, selected, SERIAL)
    return updated


def tangent_correction(
    u: FloatArray,
    bricks: Elements,
    law: J2Law,
    history: History,
    flowing: NDArray[np.bool_],
    workers: Workers = SERIAL,
) -> TangentCorrection:
    """Return the consistent tangent less the elastic stiffness at the displacements u.

    Args:
        u: (nodes, 3) displacements, in m.
        bricks: the m elements.
        law: of the material.
        history: plastic strains of the elements before the increment.
        flowing: (m,) True for the elements that flow, from `internal_force` at u.
        workers: threads that share the work.
    """
    selected = np.flatnonzero(flowing)
    terms = np.empty((selected.size, 8, 8))
    task = partial(
        _stress_update,
        u,
        bricks,
        law.moduli,
        law.bends,
        history,
        selected,
        None,
        None,
        None,
        terms,
    )
    _run_by_layers(task, bricks, selected, workers)
    return TangentCorrection(selected, terms)


def add_correction(
    v: FloatArray,
    bricks: Elements,
    correction: TangentCorrection,
    scale: float,
    force: FloatArray,
    workers: Workers = SERIAL,
) -> None:
    """Add `scale` (tangent - elastic stiffness) v to the force, in place.

    Args:
        v: (nodes, 3) displacements, in m.
        bricks: the elements.
        correction: from `tangent_correction`.
        scale: dimensionless.
        force: (nodes, 3) in N, which is changed.
        workers: threads that share the work.
    """
    task = partial(_add_correction, v, bricks, correction, scale, force)
    _run_by_layers(task, bricks, correction.elements, workers)


def _run_by_layers(
    task: Callable[[NDArray[np.int64]], Any],
    bricks: Elements,
    selected: NDArray[np.int64] | None,
    workers: Workers,
) -> None:
    """Call `task` for all elements or the selected ones, half of the layers at a time.

    Neighbouring layers are never computed together, so that threads never add to the
    same node.

    Args:
        task: called with (r, 2) first index and stop index of ranges.
        bricks: the elements.
        selected: ascending numbers of elements, which the ranges index; None: all.
        workers: threads that share a half.
    """
    for layers in disjoint_layers(bricks, selected):
        workers.run(task, layers)
