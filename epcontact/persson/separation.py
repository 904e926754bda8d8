"""Elastic energy, mean separation and open gap of elastic and elastoplastic contact.

Energy.  Yang and Persson, J. Phys.: Condens. Matter 20, 215214 (2008), per nominal
area:

    U_el = (pi/2) E* int q^2 C S A_el dq = (E*/4) int S A_el dxi^2(q) / q

In full contact (S = A_el = 1) this is exact.  A_el is the area at the diffusion G of
*full* contact: gamma enters the energy once, by S, and not again by the area.  S
follows the rule of the areas where that rule is "persson" or "wang_muser".  The rule
"constant" is the limit of small contacts, and the rule "xu" describes no single wave
number: for these two the energy uses "persson" with the same gamma.  The formula holds
for plastic flow as well, because the diffusion equation with both bounds still has
d<p^2> = 2 A_el dG for <p^2> = int sigma^2 P dsigma + sigma_P^2 A_pl.

Separation.  In elastic contact the load's work is the elastic energy, dU_el = -p
d(ubar), so

    ubar(p) = int_p^inf dU_el(p') / p'

is the mean of the open gap [Almqvist et al., J. Mech. Phys. Solids 59, 2355 (2011)].
An elastoplastic contact is treated as the elastic contact of the surface that it has
flattened, with the effective spectrum

    C_eff(q) = C(q) [1 - (A_pl(q) sigma_P / p)^6]

and the plastic area at the magnification of q (by the reduced G).  Persson and
co-workers use this form (Tiwari et al., Lubricants 7, 90 (2019)); its exponent is
empirical.

Open gap.  As the magnification grows from zeta to zeta + d zeta, an area -A'(zeta) d
zeta comes out of contact.  With ubar(zeta) the mean separation within the area in
contact at zeta, under its pressure p A_0/A(zeta) and the roughness of wave numbers
beyond zeta q_0, this area has the mean separation u_1 and spreads about it by that
roughness, of rms height h(zeta):

    u_1(zeta) = d(A ubar)/dA,
    P(u) = int d zeta (-A') [N(u; u_1, h) + N(u; -u_1, h)],   u > 0,

N being the normal density [Almqvist et al., as above].  The normal densities are folded
at u = 0, so the mean of P is larger than ubar: by 1 % at A = 0.02, 6 % at 0.11 and 15 %
at 0.34.

Accuracy, against boundary elements on surfaces of H = 0.8, q_1/q_0 = 64, gamma = 0.536:
ubar is 11 % too large at A = 0.02 and 9 % too small at 0.4 in elastic contact, 2 to 12
% too large at a hardness of 0.6 and 0.3 E* xi and 20 to 24 % too small at 0.16 E* xi.
U_el is 1.1 to 1.5 times as large, and more where most of the contact flows.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erf, ndtr

from epcontact.persson.elastoplastic import areas
from epcontact.persson.reduction import (
    EnergyReduction,
    full_contact_diffusion,
    reduced_diffusion,
)
from epcontact.persson.roughness import Roughness
from epcontact.persson.theory import Theory
from epcontact.results import FloatArray

#: Steps to a factor e of the pressure in the integral over the load.  The integral is
#: also taken with half as many steps, and the two are extrapolated.
STEPS_PER_E_FOLD = 8
#: The exponent 6 of the effective spectrum.
_FLATTENING_EXPONENT = 6
#: Magnifications at which the gap's area and mean separation are computed.  Twice as
#: many change the cumulative distribution by less than 0.002 (0.014 where flow has left
#: few bands).
_LEVELS = 48


def elastic_energy(theory: Theory, mean_pressure: float) -> float:
    """Return the elastic energy U_el in J per m^2 of nominal area.

    Args:
        theory: The body; its reduction must not be "near_bounds".
        mean_pressure: In Pa.

    Raises:
        InvalidScene: The pressure is out of range, or the reduction is "near_bounds".
    """
    tau = _band_diffusion(theory)
    contact = areas(tau, mean_pressure, theory.hardness)
    return float(_energy(theory, contact.total, contact.elastic))


def flattened_roughness(theory: Theory, mean_pressure: float) -> Roughness:
    """Return the roughness that remains after plastic flow, by the effective spectrum.

    The spectrum of each wave number is multiplied by 1 - (A_pl sigma_P / p)^6, with the
    plastic area A_pl at its magnification.

    Args:
        theory: The elastoplastic body.
        mean_pressure: p in Pa.

    Raises:
        InvalidScene: The pressure is out of range, or the reduction is "near_bounds".
    """
    roughness = theory.roughness
    hardness = theory.hardness
    G = reduced_diffusion(
        theory.reduction, _band_diffusion(theory), mean_pressure, hardness
    )
    all_plastic = mean_pressure / hardness if math.isfinite(hardness) else 1.0
    load_fraction = areas(G, mean_pressure, hardness).plastic / all_plastic
    remaining = 1 - np.minimum(load_fraction, 1) ** _FLATTENING_EXPONENT
    slope_variance = remaining * roughness.slope_variance
    edges = np.concatenate([[roughness.lowest], roughness.upper_edge])
    variance_at_edges = np.concatenate([[0.0], np.cumsum(slope_variance)])

    def slope_variance_up_to(q: ArrayLike) -> FloatArray:
        """Return xi^2 of the flattened roughness up to wave numbers q in rad/m."""
        q = np.asarray(q, dtype=np.float64)
        return np.asarray(np.interp(q, edges, variance_at_edges))

    return replace(
        roughness,
        slope_variance=slope_variance,
        first_moment=remaining * roughness.first_moment,
        height_variance=remaining * roughness.height_variance,
        slope_variance_up_to=slope_variance_up_to,
    )


def mean_separation(
    theory: Theory, mean_pressure: float, steps_per_e_fold: int = STEPS_PER_E_FOLD
) -> float:
    """Return the mean separation ubar in m, the mean of the open gap.

    Args:
        theory: The body; its reduction must not be "near_bounds".
        mean_pressure: In Pa.
        steps_per_e_fold: Steps of the integral to a factor e of the pressure.

    Raises:
        InvalidScene: The pressure is out of range, or the reduction is "near_bounds".
    """
    areas(0.0, mean_pressure, theory.hardness)  # checks the pressure
    theory = flattened(theory, mean_pressure)
    variance = theory.roughness.slope_variance.sum()
    tau = full_contact_diffusion(theory.effective_modulus, variance)
    # Above this pressure every band is in full contact to 1e-17.
    top = 6.1 * 2 * math.sqrt(tau)
    if mean_pressure >= top:
        return 0.0
    steps = math.ceil(math.log(top / mean_pressure) * steps_per_e_fold)
    p = np.geomspace(mean_pressure, top, 2 * steps + 1)
    # A band flattened to nothing is in full contact.
    spread = np.maximum(2 * np.sqrt(_band_diffusion(theory)), 1e-30 * top)
    area = erf(p[:, None] / spread)
    U = _energy(theory, area, area)
    # The trapezoidal rule in 1/p is of second order.
    coarse = float(np.diff(U[::2]) @ (0.5 / p[2::2] + 0.5 / p[:-2:2]))
    fine = float(np.diff(U) @ (0.5 / p[1:] + 0.5 / p[:-1]))
    return fine + (fine - coarse) / 3


def flattened(theory: Theory, mean_pressure: float) -> Theory:
    """Return the elastic theory of the surface that an elastoplastic contact flattens.

    Args:
        theory: The body; that of an elastic body is returned as it is.
        mean_pressure: In Pa.

    Raises:
        InvalidScene: The pressure is out of range, or the reduction is "near_bounds".
    """
    if math.isinf(theory.hardness):
        return theory
    roughness = flattened_roughness(theory, mean_pressure)
    return replace(theory, roughness=roughness, hardness=math.inf)


def _band_diffusion(theory: Theory) -> FloatArray:
    """Return the diffusion of full contact in the middle of each band, in Pa^2.

    Args:
        theory: The body, whose roughness has n bands.

    Returns:
        Ascending values without the reduction of elastic energy, (n,).
    """
    variance = theory.roughness.slope_variance
    middle = np.cumsum(variance) - 0.5 * variance
    return full_contact_diffusion(theory.effective_modulus, middle)


def _energy(theory: Theory, contact: FloatArray, elastic: FloatArray) -> FloatArray:
    """Return the elastic energy (...,) in J per m^2 of nominal area.

    Args:
        theory: The body, with `bands` bands of roughness.
        contact: Contact area at each band as a fraction of the nominal area, (...,
            bands).
        elastic: Its elastic part, (..., bands).
    """
    reduction = theory.reduction
    if reduction.rule in ("constant", "xu"):
        reduction = EnergyReduction(reduction.gamma, "persson")
    stored = (reduction.factor(contact) * elastic) @ theory.roughness.first_moment
    return np.asarray(0.25 * theory.effective_modulus * stored)


# --- the open gap


def gap_distribution(
    theory: Theory, mean_pressure: float, gap: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return the probability density and the cumulative fraction of the open gap.

    Args:
        theory: The body; its reduction must not be "near_bounds".
        mean_pressure: In Pa.
        gap: Gaps u in m, of any shape.

    Returns:
        The density in 1/m at each gap, and the fraction of the nominal area with a gap
        of at most u; at u = 0 this is the fraction in contact.

    Raises:
        InvalidScene: The pressure is out of range, or the reduction is "near_bounds".
    """
    u = np.asarray(gap, dtype=np.float64)
    area, means, spreads = _levels(flattened(theory, mean_pressure), mean_pressure)
    density = np.zeros_like(u)
    cumulative = np.full_like(u, area[-1])
    for lost_area, mean, spread in zip(-np.diff(area), means, spreads, strict=True):
        near = (u - mean) / spread
        image = (u + mean) / spread
        bells = np.exp(-(near**2) / 2) + np.exp(-(image**2) / 2)
        density += lost_area * bells / (math.sqrt(2 * math.pi) * spread)
        cumulative += lost_area * (ndtr(near) + ndtr(image) - 1)
    return density, cumulative


def _levels(
    theory: Theory, mean_pressure: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what the contact loses between ascending magnifications.

    Args:
        theory: An elastic body.
        mean_pressure: In Pa.

    Returns:
        The contact area as a fraction at n + 1 magnifications; and of the area that
        comes out of contact between two of them, the mean separation and the rms height
        of the finer roughness in m, (n,) each.

    Raises:
        InvalidScene: The pressure is out of range, or the reduction is "near_bounds".
    """
    roughness = theory.roughness
    variance = np.concatenate([[0.0], np.cumsum(roughness.slope_variance)])
    tau = full_contact_diffusion(theory.effective_modulus, variance)
    G = reduced_diffusion(theory.reduction, tau, mean_pressure, math.inf)
    area = np.asarray(areas(G, mean_pressure, math.inf).total)
    # Each level loses about the same area; the last reaches the highest wave number.
    last = area.size - 1
    bands = np.searchsorted(-area, -np.linspace(1, area[-1], _LEVELS + 1))
    bands = np.unique(np.append(np.minimum(bands, last), last))
    area = area[bands]
    separation = np.zeros(area.size)
    for level, (band, contact) in enumerate(zip(bands[:-1], area[:-1], strict=True)):
        finer = _without_first_bands(theory, int(band))
        separation[level] = mean_separation(finer, mean_pressure / contact)
    volume = area * separation
    lost_area = -np.diff(area)
    # Bands that take no area out of contact have no separation of their own.
    mean = np.zeros_like(lost_area)
    np.divide(-np.diff(volume), lost_area, out=mean, where=lost_area > 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        height_variance = np.nan_to_num(
            roughness.first_moment**2 / roughness.slope_variance
        )
    finer_variance = np.cumsum(height_variance[::-1])[::-1]
    finer_variance = np.append(finer_variance, 0.0)[bands]
    spread = np.sqrt((finer_variance[:-1] + finer_variance[1:]) / 2)
    smallest = 1e-12 * math.sqrt(finer_variance[0])
    return area, np.maximum(mean, 0.0), np.maximum(spread, smallest)


def _without_first_bands(theory: Theory, count: int) -> Theory:
    """Return the theory of the roughness without its first (longest) `count` bands."""
    roughness = theory.roughness
    finer = replace(
        roughness,
        upper_edge=roughness.upper_edge[count:],
        slope_variance=roughness.slope_variance[count:],
        first_moment=roughness.first_moment[count:],
        height_variance=roughness.height_variance[count:],
    )
    return replace(theory, roughness=finer)
