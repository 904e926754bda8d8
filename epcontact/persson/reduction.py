"""The reduction S of elastic energy, and with it the diffusion G of the stress.

In full contact the roughness up to a wave number q gives the pressure half the variance
tau, see `full_contact_diffusion`.  In partial contact less elastic energy is stored in
the contact; the theory accounts for it by dG = S dtau, where S depends on the relative
contact area A (elastic and plastic) at the magnification:

    constant     S = gamma                                    Almqvist and Persson: gamma = 0.536
    persson      S = gamma + (1 - gamma) A^2                  Yang and Persson (2008): 0.45
    wang_muser   S = gamma - (2/9) A^2 + (11/9 - gamma) A^4   Wang and Mueser (2017): 5/9
    xu           G = [gamma + (1 - gamma) A] tau, with the area at the end of the range:
                 one implicit equation instead of a differential one; Xu et al. (2024):
                 0.42
    local        S depends on the pressure, too, so that no G describes the stress: see `local`

A depends on the spectrum through G alone, so the differential equation separates:
tau(G) = int_0^G dG' / S(A(G')).  It is integrated in steps of constant ratio of G by
Gauss's three-point rule, whose error falls with the sixth power of the step, and
inverted step by step by Newton's method; as S > 0, tau(G) is monotone and the root is
unique.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from epcontact.errors import InvalidScene, NotConverged
from epcontact.persson.elastoplastic import areas, boundary_slopes
from epcontact.results import FloatArray
from epcontact.scene import array, number, require_one_of, settle

Rule = Literal["constant", "persson", "wang_muser", "xu", "local"]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1), 0.5 * _WEIGHTS
#: Steps to a decade of G; with three Gauss points the error is below 1e-11 (tested).
STEPS_PER_DECADE = 24


@dataclass(frozen=True)
class EnergyReduction:
    """A rule for S and its parameter gamma, the value of S in the limit of no contact.

    Attributes:
        gamma: Between 0 (wang_muser: 0.011, below which its polynomial is negative at
            some area), excluded, and 1.
        rule: One of the rules of this module; "local" is that of `persson.local`.

    Raises:
        InvalidScene: The rule is unknown or gamma is out of range.
    """

    gamma: float
    rule: Rule = "constant"

    def __post_init__(self) -> None:
        require_one_of("energy reduction rule", self.rule, Rule)
        least = 0.011 if self.rule == "wang_muser" else 0.0
        right = f"a number between {least:g} (excluded) and 1"
        gamma = number("energy_reduction", self.gamma, right, lambda v: least < v <= 1)
        settle(self, gamma=gamma)

    def factor(self, contact_area: ArrayLike) -> FloatArray:
        """S at a relative contact area A in [0, 1] of any shape; for "xu", the factor G
        / tau.
        """
        A = np.asarray(contact_area, dtype=np.float64)
        g = self.gamma
        match self.rule:
            case "constant":
                return np.full(A.shape, g)
            case "persson":
                return g + (1 - g) * A**2
            case "wang_muser":
                return g - 2 / 9 * A**2 + (11 / 9 - g) * A**4
            case "xu":
                return g + (1 - g) * A
            case "local":
                raise InvalidScene(
                    "the rule 'local' has an S for each pressure: its areas and pressures are at "
                    "hand, but no diffusion G, elastic energy, gap or moving hardness"
                )


def full_contact_diffusion(
    effective_modulus: float, slope_variance: ArrayLike
) -> FloatArray:
    """Diffusion without reduction (S = 1) by equation (2) of the paper:

        tau = (pi/4) E*^2 int q^3 C dq = E*^2 xi^2 / 8,   xi^2 = 2 pi int q^3 C dq

    Args:
        effective_modulus: E* in Pa.
        slope_variance: xi^2 of the roughness up to a wave number, of any shape.

    Example:
        >>> float(full_contact_diffusion(250.0, 1.0))  # GPa
        7812.5
    """
    return np.asarray(effective_modulus**2 / 8 * np.asarray(slope_variance))


def reduced_diffusion(
    reduction: EnergyReduction,
    full_contact_diffusion: ArrayLike,
    mean_pressure: float,
    hardness: float = math.inf,
    steps_per_decade: int = STEPS_PER_DECADE,
) -> FloatArray:
    """G in Pa^2, the diffusion with the reduction S, for a tau in Pa^2 of any shape.
    Raises InvalidScene if tau is not finite or negative, or the mean pressure not
    between 0 and the hardness.
    """
    tau = array("full_contact_diffusion", full_contact_diffusion)
    if not (np.isfinite(tau).all() and (tau >= 0).all()):
        raise InvalidScene(
            "full_contact_diffusion must hold finite numbers >= 0 in Pa^2"
        )
    areas(0.0, mean_pressure, hardness)  # checks the pressures
    if reduction.rule in ("constant", "local"):  # of which the second refuses
        return reduction.factor(1.0) * tau

    def factor(G: FloatArray) -> FloatArray:
        return reduction.factor(areas(G, mean_pressure, hardness).total)

    def xu(G: FloatArray) -> tuple[FloatArray, FloatArray]:
        """G - [gamma + (1 - gamma) A(G)] tau and its derivative; dA/dG is minus the
        first slope.
        """
        loss, _ = boundary_slopes(G, mean_pressure, hardness)
        return G - factor(G) * late, 1 + (1 - reduction.gamma) * late * loss

    # Up to here A = 1 to 1e-22, and all these rules have S(1) = 1.
    smallest = mean_pressure**2 / 200
    G, wide = tau.copy(), tau > smallest
    late = tau[wide]
    if late.size and reduction.rule == "xu":
        G[wide] = _newton(xu, reduction.gamma * late, late)
    elif late.size:
        ratio = max(late.max() / smallest, 1 + 1e-9)
        steps = math.ceil(math.log10(ratio) * steps_per_decade) + 1
        edges = np.geomspace(smallest, smallest * ratio, steps + 1)
        G[wide] = _integrate(factor, late, edges)
    return G


def _integrate(
    factor: Callable[[FloatArray], FloatArray], tau: FloatArray, edges: FloatArray
) -> FloatArray:
    """G with int dG / S = tau; edges: (n,) of the steps of G; up to the first edge tau
    = G.
    """

    def integral(low: FloatArray, high: FloatArray) -> FloatArray:
        points = low[:, None] + (high - low)[:, None] * _NODES
        return np.asarray((high - low) * ((1 / factor(points)) @ _WEIGHTS))

    reached = edges[0] + np.cumsum(integral(edges[:-1], edges[1:]))
    step = np.searchsorted(reached[:-1], tau)
    low, rest = edges[step], tau - np.concatenate([edges[:1], reached])[step]
    return _newton(
        lambda G: (integral(low, G) - rest, 1 / factor(G)), low, edges[step + 1]
    )


def _newton(
    function: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    low: FloatArray,
    high: FloatArray,
) -> FloatArray:
    """Find roots of an increasing function in brackets by its derivative, to 1e-14 of
    `high`.
    """
    x, scale = 0.5 * (low + high), high
    for _ in range(100):
        value, slope = function(x)
        low, high = np.where(value < 0, x, low), np.where(value > 0, x, high)
        new = x - value / slope
        new = np.where((new >= low) & (new <= high), new, 0.5 * (low + high))
        change, x = np.abs(new - x), new
        if np.all(change <= 1e-14 * scale):
            return np.asarray(x)
    raise NotConverged(
        "the reduction of elastic energy did not settle in 100 Newton steps",
        residuals={"diffusion": float(np.max(change / scale))},
    )
