"""Elastic energy and mean separation of elastic and elastoplastic contact.

Energy.  Yang and Persson, J. Phys.: Condens. Matter 20, 215214 (2008), per nominal area:

    U_el = (pi/2) E* int q^2 C S A_el dq = (E*/4) int S A_el dxi^2(q) / q

In full contact (S = A_el = 1) this is exact.  A_el is the area at the diffusion G of *full*
contact: gamma enters the energy once, by S, and not again by the area.  (With the reduced G the
energy of small elastic contacts is 1.6 to 2.2 times that of boundary elements.)  S follows the
rule of the areas where that rule is "persson" or "wang_muser".  "constant" is the limit of small
contacts, wrong for the long waves in full contact, and "xu" describes no single wave number: for
these two the energy uses "persson" with the same gamma.

The formula holds for plastic flow as well, because the diffusion equation with both walls still
has d<p^2> = 2 A_el dG for <p^2> = int sigma^2 P dsigma + sigma_P^2 A_pl: roughness of wave
number q adds pressure of wave number q in elastic contact only.

Separation.  In elastic contact the load's work is the elastic energy, dU_el = -p d(ubar), so

    ubar(p) = int_p^inf dU_el(p') / p'       Almqvist et al., J. Mech. Phys. Solids 59, 2355 (2011)

An elastoplastic contact is treated as the elastic contact of the surface that it has flattened.
The effective spectrum of that surface is

    C_eff(q) = C(q) [1 - (A_pl(q) sigma_P / p)^6]

with the plastic area at the magnification of q (by the reduced G).  This form is used by Persson
and co-workers, Tiwari et al., Lubricants 7, 90 (2019); its exponent is empirical.

Accuracy: against boundary elements (three self-affine surfaces of H = 0.8, q_1/q_0 = 64,
gamma = 0.536) ubar is 11 % too large at A = 0.02, 5 % at 0.1 and 9 % too small at 0.4 in elastic
contact (gamma = 0.45: within 5 %), 2 to 12 % too large at a hardness of 0.6 and 0.3 E* xi, and
20 to 24 % too small at 0.16 E* xi.  U_el is 1.1 to 1.4 times as large in elastic contact, 1.3 to
1.5 times at 0.6 E* xi, and more where most of the contact flows.

ubar is the distance of the flat from the mean plane of the flattened, deformed surface: the
mean of the open gap.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.special import erf

from epcontact.persson.elastoplastic import areas
from epcontact.persson.reduction import EnergyReduction, full_contact_diffusion, reduced_diffusion
from epcontact.persson.roughness import Roughness
from epcontact.persson.theory import Theory
from epcontact.results import FloatArray

#: Steps to a factor e of the pressure in the integral over the load; each is halved once more.
STEPS_PER_E_FOLD = 8
_FLATTENING_EXPONENT = 6


def elastic_energy(theory: Theory, mean_pressure: float) -> float:
    """Elastic energy U_el in J per m^2 of nominal area.  Raises InvalidScene."""
    tau = _band_diffusion(theory)
    found = areas(tau, mean_pressure, theory.hardness)
    stored = _energy_reduction(theory).factor(found.total) * found.elastic
    return float(_energy(theory, stored))


def flattened_roughness(theory: Theory, mean_pressure: float) -> Roughness:
    """The roughness of C_eff, after plastic flow at a mean pressure (Pa).  Raises InvalidScene.

    Only the bands are flattened; `slope_variance_up_to` interpolates between them.
    """
    before, hardness = theory.roughness, theory.hardness
    G = reduced_diffusion(theory.reduction, _band_diffusion(theory), mean_pressure, hardness)
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
    if math.isfinite(theory.hardness):
        flat = flattened_roughness(theory, mean_pressure)
        theory = replace(theory, roughness=flat, hardness=math.inf)
    # Above this pressure every band is in full contact to 1e-17.
    variance = theory.roughness.slope_variance.sum()
    top = 6.1 * 2 * math.sqrt(full_contact_diffusion(theory.effective_modulus, variance))
    if mean_pressure >= top:
        return 0.0
    steps = math.ceil(math.log(top / mean_pressure) * steps_per_e_fold)
    p = np.geomspace(mean_pressure, top, 2 * steps + 1)
    # A band flattened to nothing is in full contact.
    spread = np.maximum(2 * np.sqrt(_band_diffusion(theory)), 1e-30 * top)
    area = erf(p[:, None] / spread)
    U = _energy(theory, _energy_reduction(theory).factor(area) * area)
    # The trapezoidal rule in 1/p is of second order.
    coarse, fine = (float(np.diff(U[::k]) @ (0.5 / p[k::k] + 0.5 / p[:-k:k])) for k in (2, 1))
    return fine + (fine - coarse) / 3


def _band_diffusion(theory: Theory) -> FloatArray:
    """The diffusion of full contact in the middle of each band, in Pa^2."""
    variance = theory.roughness.slope_variance
    middle = np.cumsum(variance) - 0.5 * variance
    return full_contact_diffusion(theory.effective_modulus, middle)


def _energy_reduction(theory: Theory) -> EnergyReduction:
    local = theory.reduction.rule in ("persson", "wang_muser")
    return theory.reduction if local else EnergyReduction(theory.reduction.gamma, "persson")


def _energy(theory: Theory, stored: FloatArray) -> FloatArray:
    """U_el for the stored shares S A_el of the bands, (..., bands)."""
    return np.asarray(0.25 * theory.effective_modulus * (stored @ theory.roughness.first_moment))
