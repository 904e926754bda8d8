"""Elastic energy and mean separation of elastic and elastoplastic contact.

Energy.  Added roughness with slope variance dxi^2 raises the pressure's mean square by
2 A_el dG, dG = (E*^2/8) S dxi^2, for <p^2> = int sigma^2 P dsigma + sigma_P^2 A_pl and the
diffusion equation give exactly that, with or without plastic flow.  Pressure of wave number q
stores |p_q|^2 / (E* q), hence per nominal area

    U_el = (E*/4) int S A_el dxi^2(q) / q                  (= (pi/2) E* int q^2 C S A_el dq)

which for elastic contact is the energy of Yang and Persson, J. Phys.: Condens. Matter 20,
215214 (2008).

Separation.  In elastic contact the load's work is the elastic energy, dU_el = -p d(ubar), so

    ubar(p) = int_p^inf dU_el(p') / p'                     (Almqvist et al., JMPS 59, 2355 (2011))

An elastoplastic contact is treated as the elastic contact of the surface it has flattened:
the companion of the paper (Almqvist and Persson, arXiv 2508.15492) proposes an effective
spectrum for that.  Here roughness counts for the share of the contact that is still elastic at
its magnification, C_eff = C A_el / (A_el + A_pl) at the load asked for, the share with which the
flattened surface stores the energy U_el above.  This closure is ours, not derived from the
diffusion equation.

ubar is the distance of the flat from the mean plane of the (flattened, deformed) surface, that
is the mean of the open gap.  G here is reduced by the area's rule of `EnergyReduction`; S in the
energy is a rule of its own: the constant gamma is the limit of small contacts and would leave
the long waves, in full contact, (1 - gamma) of their energy short, so its default is the rule
"persson" with the same gamma.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import erf

from epcontact.errors import InvalidScene
from epcontact.persson.elastoplastic import areas
from epcontact.persson.reduction import EnergyReduction, reduced_diffusion, reduction_factor
from epcontact.persson.roughness import Roughness

FloatArray = NDArray[np.float64]

#: Steps to a factor e of the pressure in the integral over the load; halved once more.
STEPS_PER_E_FOLD = 16


@dataclass(frozen=True)
class TheoryModel:
    """A rough body and the theory's rules.

    effective_modulus: E* in Pa; hardness in Pa, infinite for an elastic body; area_reduction:
    of the diffusion G; energy_reduction: of the elastic energy, by default the rule "persson"
    with the gamma of the area's.
    """

    roughness: Roughness
    effective_modulus: float
    area_reduction: EnergyReduction
    hardness: float = math.inf
    energy_reduction: EnergyReduction | None = None

    @property
    def energy_rule(self) -> EnergyReduction:
        """The rule for the elastic energy."""
        return self.energy_reduction or EnergyReduction(self.area_reduction.gamma, "persson")


def elastic_energy(model: TheoryModel, mean_pressure: float) -> float:
    """U_el in J per m^2 of nominal area.  Raises InvalidScene for a pressure out of range."""
    stored, _ = _band_shares(model, mean_pressure)
    return 0.25 * model.effective_modulus * float(model.roughness.first_moment @ stored)


def flattened_roughness(model: TheoryModel, mean_pressure: float) -> Roughness:
    """The roughness after plastic flow: each band times A_el / (A_el + A_pl).

    Only the bands are flattened; its `slope_variance_up_to` is that of the bands.
    """
    _, share = _band_shares(model, mean_pressure)
    before = model.roughness
    slope_variance = share * before.slope_variance
    reached = np.concatenate([[0.0], np.cumsum(slope_variance)])
    edges = np.concatenate([[before.lowest], before.upper_edge])
    return replace(
        before,
        slope_variance=slope_variance,
        first_moment=share * before.first_moment,
        slope_variance_up_to=lambda q: np.interp(np.asarray(q), edges, reached),
    )


def mean_separation(
    model: TheoryModel, mean_pressure: float, steps_per_e_fold: int = STEPS_PER_E_FOLD
) -> float:
    """ubar in m: the mean open gap.  Raises InvalidScene for a pressure out of range."""
    if math.isfinite(model.hardness):
        model = replace(
            model, roughness=flattened_roughness(model, mean_pressure), hardness=math.inf
        )
    top = _full_contact_pressure(model)
    if mean_pressure >= top:
        return 0.0 * elastic_energy(model, mean_pressure)  # checks the pressure
    steps = math.ceil(math.log(top / mean_pressure) * steps_per_e_fold)
    p = np.geomspace(mean_pressure, top, 2 * steps + 1)
    U = _elastic_energies(model, p)
    coarse, fine = (float(np.diff(U[::k]) @ (0.5 / p[k::k] + 0.5 / p[:-k:k])) for k in (2, 1))
    return fine + (fine - coarse) / 3  # the trapezoidal rule in 1/p is of second order


def pressure_at_separation(model: TheoryModel, separation: float) -> float:
    """The mean pressure in Pa at which the mean separation is `separation` (m).

    Raises InvalidScene unless the separation belongs to a pressure between 1e-12 and 1 - 1e-9
    of the hardness (elastic: of the pressure of full contact).
    """
    top = min(model.hardness * (1 - 1e-9), _full_contact_pressure(model))
    low, high = 1e-12 * top, top

    def miss(log_pressure: float) -> float:
        return mean_separation(model, math.exp(log_pressure)) - separation

    a, b = math.log(low), math.log(high)
    if not miss(a) >= 0 >= miss(b):
        raise InvalidScene(
            f"separation is {separation:g} m, but at pressures between {low:g} and {high:g} Pa "
            f"it lies between {separation + miss(b):g} and {separation + miss(a):g} m"
        )
    return math.exp(brentq(miss, a, b, xtol=1e-12))


def _full_contact_pressure(model: TheoryModel) -> float:
    """Above it every band is in full contact to 1e-17, whatever S <= 1."""
    most = model.effective_modulus**2 * model.roughness.slope_variance.sum() / 8
    return 6.1 * 2 * math.sqrt(most)


def _middle_diffusion(model: TheoryModel) -> FloatArray:
    """tau in the middle of each band."""
    variance = model.roughness.slope_variance
    return np.asarray(model.effective_modulus**2 / 8 * (np.cumsum(variance) - 0.5 * variance))


def _band_shares(model: TheoryModel, mean_pressure: float) -> tuple[FloatArray, FloatArray]:
    """S A_el, and A_el / (A_el + A_pl), in the middle of each band."""
    tau = _middle_diffusion(model)
    G = reduced_diffusion(model.area_reduction, tau, mean_pressure, model.hardness)
    found = areas(G, mean_pressure, model.hardness)
    factor = reduction_factor(model.energy_rule, found.total)
    return factor * found.elastic, found.elastic / found.total


def _elastic_energies(model: TheoryModel, mean_pressures: FloatArray) -> FloatArray:
    """U_el of an elastic body at many pressures."""
    if model.area_reduction.rule != "constant":
        return np.array([elastic_energy(model, float(p)) for p in mean_pressures])
    # Here G does not depend on the pressure, and neither do the denominators of erf.
    spread = 2 * np.sqrt(model.area_reduction.gamma * _middle_diffusion(model))
    area = erf(mean_pressures[:, None] / spread)
    stored = reduction_factor(model.energy_rule, area) * area
    return np.asarray(0.25 * model.effective_modulus * (stored @ model.roughness.first_moment))
