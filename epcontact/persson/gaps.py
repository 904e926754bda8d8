"""The distribution of the open gap between the surfaces.

Almqvist, Campana, Prodanov and Persson, J. Mech. Phys. Solids 59, 2355 (2011).  As the
magnification grows from zeta to zeta + d zeta, an area -A'(zeta) d zeta comes out of contact.  With
ubar(zeta) the mean separation within the area in contact at zeta, under its pressure p A_0/A(zeta)
and the roughness of wave numbers beyond zeta q_0, this area has the mean separation

    u_1(zeta) = d(A ubar)/dA = ubar + ubar' A/A'

and spreads about it by that roughness, of rms height h(zeta):

    P(u) = int d zeta (-A') [N(u; u_1, h) + N(u; -u_1, h)],    u > 0,

N being the normal density.  The area in contact at the highest magnification has no gap.

An elastoplastic contact is the elastic contact of the surface that it has flattened, as for the
mean separation (`separation`).  The mean of P is larger than ubar, because the normal densities
are folded at u = 0: by 1 % at A = 0.02, 6 % at 0.11 and 15 % at 0.34 (a surface of Hurst exponent
0.8 and q_1/q_0 = 64).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import norm

from epcontact.persson.elastoplastic import areas
from epcontact.persson.reduction import full_contact_diffusion, reduced_diffusion
from epcontact.persson.separation import flattened_roughness, mean_separation
from epcontact.persson.theory import Theory
from epcontact.results import FloatArray

#: Magnifications at which the area and the mean separation are found.  Twice as many change the
#: cumulative distribution by less than 0.002, and by 0.014 where flow has left few bands
#: (hardness 0.3 E* xi, A = 0.54).
_LEVELS = 48


class GapDistribution(NamedTuple):
    """Density in 1/m and cumulative share at gaps (n,) in m, and the share without a gap."""

    gap: FloatArray
    density: FloatArray
    cumulative: FloatArray
    contact: float


def gap_distribution(theory: Theory, mean_pressure: float, gap: ArrayLike) -> GapDistribution:
    """Return the distribution of the open gap under a mean pressure (Pa), at gaps of 0 or more."""
    u = np.asarray(gap, dtype=np.float64)
    if math.isfinite(theory.hardness):
        flat = flattened_roughness(theory, mean_pressure)
        theory = replace(theory, roughness=flat, hardness=math.inf)
    share, lost, beyond = _levels(theory, mean_pressure)
    density, cumulative = np.zeros_like(u), np.full_like(u, share[-1])
    for part, mean, spread in zip(-np.diff(share), lost, beyond, strict=True):
        near, image = norm(mean, spread), norm(-mean, spread)
        density += part * (near.pdf(u) + image.pdf(u))
        cumulative += part * (near.cdf(u) + image.cdf(u) - 1)
    return GapDistribution(u, density, cumulative, float(share[-1]))


def _levels(theory: Theory, mean_pressure: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Areas (n + 1,) at ascending magnifications; u_1 and h (n,) of what is lost between them."""
    rough = theory.roughness
    slopes = np.concatenate([[0.0], np.cumsum(rough.slope_variance)])
    tau = full_contact_diffusion(theory.effective_modulus, slopes)
    G = reduced_diffusion(theory.reduction, tau, mean_pressure, math.inf)
    share = np.asarray(areas(G, mean_pressure, math.inf).total)
    # Each level loses about the same area, and the last one reaches the highest wave number.
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
