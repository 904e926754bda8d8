"""Elastic energy, mean separation and open gap of elastic and elastoplastic contact.

Energy.  Yang and Persson, J. Phys.: Condens. Matter 20, 215214 (2008), per nominal
area:

    U_el = (pi/2) E* int q^2 C S A_el dq = (E*/4) int S A_el dxi^2(q) / q

In full contact (S = A_el = 1) this is exact.  A_el is the area at the diffusion G of
*full* contact: gamma enters the energy once, by S, and not again by the area.  S
follows the rule of the areas where that rule is "persson" or "wang_muser".  "constant"
is the limit of small contacts and "xu" describes no single wave number: for these two
the energy uses "persson" with the same gamma. The formula holds for plastic flow as
well, because the diffusion equation with both walls still has d<p^2> = 2 A_el dG for
<p^2> = int sigma^2 P dsigma + sigma_P^2 A_pl.

Separation.  In elastic contact the load's work is the elastic energy, dU_el = -p
d(ubar), so

    ubar(p) = int_p^inf dU_el(p') / p'       Almqvist et al., J. Mech. Phys. Solids 59, 2355 (2011)

is the mean of the open gap.  An elastoplastic contact is treated as the elastic contact
of the surface that it has flattened, with the effective spectrum

    C_eff(q) = C(q) [1 - (A_pl(q) sigma_P / p)^6]

and the plastic area at the magnification of q (by the reduced G).  This form is used by
Persson and co-workers, Tiwari et al., Lubricants 7, 90 (2019); its exponent is
empirical.

Open gap.  As the magnification grows from zeta to zeta + d zeta, an area -A'(zeta) d
zeta comes out of contact.  With ubar(zeta) the mean separation within the area in
contact at zeta, under its pressure p A_0/A(zeta) and the roughness of wave numbers
beyond zeta q_0, this area has the mean separation u_1 and spreads about it by that
roughness, of rms height h(zeta):

    u_1(zeta) = d(A ubar)/dA,    P(u) = int d zeta (-A') [N(u; u_1, h) + N(u; -u_1, h)],   u > 0,

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

#: Steps to a factor e of the pressure in the integral over the load; each is halved
#: once more.
STEPS_PER_E_FOLD = 8
_FLATTENING_EXPONENT = 6
#: Magnifications at which the gap's area and mean separation are found.  Twice as many
#: change the cumulative distribution by less than 0.002 (0.014 where flow has left few
#: bands).
_LEVELS = 48


def elastic_energy(theory: Theory, mean_pressure: float) -> float:
    """Elastic energy U_el in J per m^2 of nominal area.  Raises InvalidScene."""
    tau = _band_diffusion(theory)
    found = areas(tau, mean_pressure, theory.hardness)
    return float(_energy(theory, found.total, found.elastic))


def flattened_roughness(theory: Theory, mean_pressure: float) -> Roughness:
    """The roughness of C_eff, after plastic flow at a mean pressure (Pa), band by
    band.
    """
    before, hardness = theory.roughness, theory.hardness
    G = reduced_diffusion(
        theory.reduction, _band_diffusion(theory), mean_pressure, hardness
    )
    most = mean_pressure / hardness if math.isfinite(hardness) else 1.0
    carried = areas(G, mean_pressure, hardness).plastic / most
    left = 1 - np.minimum(carried, 1) ** _FLATTENING_EXPONENT
    slope_variance = left * before.slope_variance
    reached = np.concatenate([[0.0], np.cumsum(slope_variance)])
    edges = np.concatenate([[before.lowest], before.upper_edge])
    return replace(
        before,
        slope_variance=slope_variance,
        first_moment=left * before.first_moment,
        slope_variance_up_to=lambda q: np.interp(np.asarray(q), edges, reached),
    )


def mean_separation(
    theory: Theory, mean_pressure: float, steps_per_e_fold: int = STEPS_PER_E_FOLD
) -> float:
    """Mean separation ubar in m, the mean of the open gap.  Raises InvalidScene."""
    areas(0.0, mean_pressure, theory.hardness)  # checks the pressure
    theory = flattened(theory, mean_pressure)
    # Above this pressure every band is in full contact to 1e-17.
    variance = theory.roughness.slope_variance.sum()
    top = (
        6.1 * 2 * math.sqrt(full_contact_diffusion(theory.effective_modulus, variance))
    )
    if mean_pressure >= top:
        return 0.0
    steps = math.ceil(math.log(top / mean_pressure) * steps_per_e_fold)
    p = np.geomspace(mean_pressure, top, 2 * steps + 1)
    # A band flattened to nothing is in full contact.
    spread = np.maximum(2 * np.sqrt(_band_diffusion(theory)), 1e-30 * top)
    area = erf(p[:, None] / spread)
    U = _energy(theory, area, area)
    # The trapezoidal rule in 1/p is of second order.
    coarse, fine = (
        float(np.diff(U[::k]) @ (0.5 / p[k::k] + 0.5 / p[:-k:k])) for k in (2, 1)
    )
    return fine + (fine - coarse) / 3


def flattened(theory: Theory, mean_pressure: float) -> Theory:
    """The elastic theory of the surface that an elastoplastic contact has flattened."""
    if math.isinf(theory.hardness):
        return theory
    flat = flattened_roughness(theory, mean_pressure)
    return replace(theory, roughness=flat, hardness=math.inf)


def _band_diffusion(theory: Theory) -> FloatArray:
    """The diffusion of full contact in the middle of each band, in Pa^2."""
    variance = theory.roughness.slope_variance
    middle = np.cumsum(variance) - 0.5 * variance
    return full_contact_diffusion(theory.effective_modulus, middle)


def _energy(theory: Theory, contact: FloatArray, elastic: FloatArray) -> FloatArray:
    """U_el for the contact area and its elastic part at each band, (..., bands)."""
    reduction = theory.reduction
    if reduction.rule in ("constant", "xu"):
        reduction = EnergyReduction(reduction.gamma, "persson")
    stored = (reduction.factor(contact) * elastic) @ theory.roughness.first_moment
    return np.asarray(0.25 * theory.effective_modulus * stored)


# --- the open gap
# --------------------------------------------------------------------------------


def gap_distribution(
    theory: Theory, mean_pressure: float, gap: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Density (1/m) and cumulative share of the open gap; at 0 that is the share in
    contact.
    """
    u = np.asarray(gap, dtype=np.float64)
    share, lost, beyond = _levels(flattened(theory, mean_pressure), mean_pressure)
    density, cumulative = np.zeros_like(u), np.full_like(u, share[-1])
    for part, mean, spread in zip(-np.diff(share), lost, beyond, strict=True):
        near, image = (u - mean) / spread, (u + mean) / spread
        bells = np.exp(-(near**2) / 2) + np.exp(-(image**2) / 2)
        density += part * bells / (math.sqrt(2 * math.pi) * spread)
        cumulative += part * (ndtr(near) + ndtr(image) - 1)
    return density, cumulative


def _levels(
    theory: Theory, mean_pressure: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Areas (n + 1,) at ascending magnifications; u_1 and h (n,) of what is lost
    between them.
    """
    rough = theory.roughness
    slopes = np.concatenate([[0.0], np.cumsum(rough.slope_variance)])
    tau = full_contact_diffusion(theory.effective_modulus, slopes)
    G = reduced_diffusion(theory.reduction, tau, mean_pressure, math.inf)
    share = np.asarray(areas(G, mean_pressure, math.inf).total)
    # Each level loses about the same area, and the last one reaches the highest wave
    # number.
    cuts = np.searchsorted(-share, -np.linspace(1, share[-1], _LEVELS + 1))
    cuts = np.unique(np.append(np.minimum(cuts, share.size - 1), share.size - 1))
    share = share[cuts]
    within = [
        mean_separation(_beyond(theory, int(cut)), mean_pressure / area)
        for cut, area in zip(cuts[:-1], share[:-1], strict=True)
    ]
    held = share * np.array([*within, 0.0])
    parts = -np.diff(share)
    # Bands that take no area out of contact have no separation of their own.
    mean = np.divide(-np.diff(held), parts, out=np.zeros_like(parts), where=parts > 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        variance = np.nan_to_num(rough.first_moment**2 / rough.slope_variance)
    left = np.concatenate([np.cumsum(variance[::-1])[::-1], [0.0]])[cuts]
    spread = np.sqrt((left[:-1] + left[1:]) / 2)
    tiny = 1e-12 * math.sqrt(left[0])
    return share, np.maximum(mean, 0.0), np.maximum(spread, tiny)


def _beyond(theory: Theory, cut: int) -> Theory:
    """The theory of the roughness without its first `cut` bands."""
    rough = theory.roughness
    part = replace(
        rough,
        upper_edge=rough.upper_edge[cut:],
        slope_variance=rough.slope_variance[cut:],
        first_moment=rough.first_moment[cut:],
    )
    return replace(theory, roughness=part)
