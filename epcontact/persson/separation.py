"""Elastic energy and mean separation of elastic and elastoplastic contact.

Energy.  Yang and Persson, J. Phys.: Condens. Matter 20, 215214 (2008), per nominal area:

    U_el = (pi/2) E* int q^2 C S A_el dq = (E*/4) int S A_el dxi^2(q) / q

In full contact (S = A_el = 1) this is exact.  A_el is the area at the diffusion G of *full*
contact: gamma enters the energy once, by S, and not again by the area.  (With the reduced G of
equation (2) the energy of small elastic contacts is 1.6 to 2.2 times that of boundary elements.)
The formula carries over to plastic flow, because the diffusion equation with both walls still
has d<p^2> = 2 A_el dG for <p^2> = int sigma^2 P dsigma + sigma_P^2 A_pl: roughness of wave
number q adds pressure of wave number q in elastic contact only.

Separation.  In elastic contact the load's work is the elastic energy, dU_el = -p d(ubar), so

    ubar(p) = int_p^inf dU_el(p') / p'       Almqvist et al., J. Mech. Phys. Solids 59, 2355 (2011)

An elastoplastic contact is treated as the elastic contact of the surface that it has flattened,
of the effective spectrum

    C_eff(q) = C(q) [1 - (A_pl(q) sigma_P / p)^6]

with the plastic area at the magnification of q (by the reduced G): the form used by Persson and
co-workers, Tiwari et al., Lubricants 7, 90 (2019), its exponent empirical.

How good that is: against boundary elements (three self-affine surfaces of H = 0.8, q_1/q_0 = 64,
gamma = 0.536) ubar is 11 % too large at A = 0.02, 5 % at 0.1 and 9 % too small at 0.4 in elastic
contact (gamma = 0.45: within 5 %), 2 to 12 % too large at a hardness of 0.6 and 0.3 E* xi, and
20 to 24 % too small at 0.16 E* xi.  U_el is 1.1 to 1.4 times as large in elastic contact, 1.3 to
1.5 times at 0.6 E* xi, and more where most of the contact flows.

ubar is the distance of the flat from the mean plane of the flattened, deformed surface: the
mean of the open gap.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import erf

from epcontact.errors import InvalidScene
from epcontact.persson.elastoplastic import areas
from epcontact.persson.reduction import EnergyReduction, reduced_diffusion, reduction_factor
from epcontact.persson.roughness import Roughness
from epcontact.results import FloatArray

#: Steps to a factor e of the pressure in the integral over the load; halved once more.
STEPS_PER_E_FOLD = 8
_FLATTENING_EXPONENT = 6


@dataclass(frozen=True)
class SeparationModel:
    """A rough body and the reductions that set its energy and its plastic area.

    effective_modulus: E* in Pa; hardness in Pa, infinite for an elastic body; area_reduction: of
    the diffusion that the plastic area has; energy_reduction: S in the energy, by default the
    area's rule, or "persson" with the area's gamma where that rule is "constant" (which is the
    limit of small contacts, and wrong for the long waves in full contact) or "xu".

    Raises InvalidScene for the energy rule "xu", which is none of a single wave number.
    """

    roughness: Roughness
    effective_modulus: float
    area_reduction: EnergyReduction
    hardness: float = math.inf
    energy_reduction: EnergyReduction | None = None

    def __post_init__(self) -> None:
        area = self.area_reduction
        if self.energy_reduction is None:
            local = area.rule in ("persson", "wang_muser")
            chosen = area if local else EnergyReduction(area.gamma, "persson")
            object.__setattr__(self, "energy_reduction", chosen)
        elif self.energy_reduction.rule == "xu":
            raise InvalidScene("the energy's reduction cannot follow the rule 'xu'")

    @property
    def full_contact_diffusion(self) -> FloatArray:
        """tau in the middle of each band, in Pa^2."""
        variance = self.roughness.slope_variance
        return np.asarray(self.effective_modulus**2 / 8 * (np.cumsum(variance) - 0.5 * variance))


def elastic_energy(model: SeparationModel, mean_pressure: float) -> float:
    """U_el in J per m^2 of nominal area.  Raises InvalidScene for a pressure out of range."""
    found = areas(model.full_contact_diffusion, mean_pressure, model.hardness)
    stored = _factor(model, found.total) * found.elastic
    return 0.25 * model.effective_modulus * float(model.roughness.first_moment @ stored)


def flattened_roughness(model: SeparationModel, mean_pressure: float) -> Roughness:
    """The roughness of C_eff, after plastic flow at a mean pressure (Pa).

    Only the bands are flattened; `slope_variance_up_to` interpolates between them.
    Raises InvalidScene for a pressure out of range.
    """
    before = model.roughness
    G = reduced_diffusion(
        model.area_reduction, model.full_contact_diffusion, mean_pressure, model.hardness
    )
    most = mean_pressure / model.hardness if math.isfinite(model.hardness) else 1.0
    carried = areas(G, mean_pressure, model.hardness).plastic / most
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
    model: SeparationModel, mean_pressure: float, steps_per_e_fold: int = STEPS_PER_E_FOLD
) -> float:
    """ubar in m: the mean open gap.  Raises InvalidScene for a pressure out of range."""
    areas(0.0, mean_pressure, model.hardness)  # checks the pressure
    if math.isfinite(model.hardness):
        flat = flattened_roughness(model, mean_pressure)
        model = replace(model, roughness=flat, hardness=math.inf)
    top = _full_contact_pressure(model)
    if mean_pressure >= top:
        return 0.0
    steps = math.ceil(math.log(top / mean_pressure) * steps_per_e_fold)
    p = np.geomspace(mean_pressure, top, 2 * steps + 1)
    # A band flattened to nothing is in full contact.
    spread = np.maximum(2 * np.sqrt(model.full_contact_diffusion), 1e-30 * top)
    area = erf(p[:, None] / spread)
    stored = (_factor(model, area) * area) @ model.roughness.first_moment
    U = 0.25 * model.effective_modulus * stored
    # The trapezoidal rule in 1/p is of second order.
    coarse, fine = (float(np.diff(U[::k]) @ (0.5 / p[k::k] + 0.5 / p[:-k:k])) for k in (2, 1))
    return fine + (fine - coarse) / 3


def _factor(model: SeparationModel, area: FloatArray) -> FloatArray:
    assert model.energy_reduction is not None  # set by __post_init__
    return reduction_factor(model.energy_reduction, area)


def _full_contact_pressure(model: SeparationModel) -> float:
    """Above it every band is in full contact to 1e-17."""
    variance = float(model.roughness.slope_variance.sum())
    return 6.1 * 2 * math.sqrt(model.effective_modulus**2 * variance / 8)
