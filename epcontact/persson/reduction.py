"""The reduction S of elastic energy, and with it the diffusion G of the stress.

In full contact the roughness up to a wave number q gives the pressure the variance
2 tau, see `full_contact_diffusion`.  A partial contact stores less elastic energy.  The
theory accounts for this by dG = S dtau, where S depends on the relative contact area A
(elastic and plastic) at the magnification:

    constant     S = gamma
    persson      S = gamma + (1 - gamma) A^2
    wang_muser   S = gamma - (2/9) A^2 + (11/9 - gamma) A^4
    xu           G = [gamma + (1 - gamma) A] tau, with the area at the end of the range:
                 one implicit equation instead of a differential one
    near_bounds  S depends on the pressure, too, so that no G describes the stress: see
                 `near_bounds`

Values of gamma: constant .536 (Almqvist and Persson), persson .45 (Yang and Persson,
2008), wang_muser 5/9 (Wang and Mueser, 2017), xu .42 (Xu et al., 2024).

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
from epcontact.scene import array, number, require_one_of, set_frozen

Rule = Literal["constant", "persson", "wang_muser", "xu", "near_bounds"]

#: Gauss points and weights on (0, 1).
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(3)
_POINTS = 0.5 * (_POINTS + 1)
_WEIGHTS = 0.5 * _WEIGHTS
#: Steps to a decade of G; with three Gauss points the error is below 1e-11 (tested).
STEPS_PER_DECADE = 24


@dataclass(frozen=True)
class EnergyReduction:
    """A rule for S and its parameter gamma, the value of S in the limit of no contact.

    Attributes:
        gamma: Between 0, excluded, and 1.  The rule "wang_muser" needs 0.011 at least,
            because below it its polynomial is negative at some area.
        rule: One of the rules of this module; "near_bounds" is that of
            `persson.near_bounds`.

    Raises:
        InvalidScene: The rule is unknown or gamma is out of range.
    """

    gamma: float
    rule: Rule = "constant"

    def __post_init__(self) -> None:
        """Check the rule and gamma, and convert gamma to a float.

        Raises InvalidScene if the rule is unknown or gamma is out of range.
        """
        require_one_of("energy reduction rule", self.rule, Rule)
        least = 0.011 if self.rule == "wang_muser" else 0.0
        expected = f"a number between {least:g} (excluded) and 1"
        gamma = number(
            "energy_reduction", self.gamma, expected, lambda v: least < v <= 1
        )
        set_frozen(self, gamma=gamma)

    def factor(self, contact_area: ArrayLike) -> FloatArray:
        """Return the reduction S of elastic energy at a contact area, by this rule.

        For the rule "xu" it is the factor G / tau between the reduced diffusion and
        that of full contact.

        Args:
            contact_area: A in [0, 1], elastic and plastic, of any shape.

        Returns:
            Dimensionless factor of the same shape.

        Raises:
            InvalidScene: The rule is "near_bounds", whose S depends on the pressure.
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
            case "near_bounds":
                raise InvalidScene(
                    "the rule 'near_bounds' has an S for each pressure, and no "
                    "diffusion G: it gives no distribution of the gap and no moving "
                    "hardness; `persson.clipped_pressure` gives its mean gap and energy"
                )


def full_contact_diffusion(
    effective_modulus: float, slope_variance: ArrayLike
) -> FloatArray:
    """Return the diffusion without reduction (S = 1) by equation (2) of the paper:

        tau = (pi/4) E*^2 int q^3 C dq = E*^2 xi^2 / 8,   xi^2 = 2 pi int q^3 C dq

    Args:
        effective_modulus: E* in Pa.
        slope_variance: xi^2 of the roughness up to a wave number, of any shape.

    Returns:
        tau in Pa^2, of the shape of the slope variance.

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
    """Return G in Pa^2, the diffusion with the reduction S of elastic energy.

    Args:
        reduction: The rule of S; the rule "near_bounds" has no G.
        full_contact_diffusion: tau in Pa^2, of any shape.
        mean_pressure: p_0 in Pa.
        hardness: sigma_P in Pa; infinite for an elastic body.
        steps_per_decade: Steps of the integration to a decade of G.

    Returns:
        G of the shape of tau.

    Raises:
        InvalidScene: tau is negative or not finite, the mean pressure is not between 0
            and the hardness, or the rule is "near_bounds".
        NotConverged: Newton's method did not find G.
    """
    tau = array("full_contact_diffusion", full_contact_diffusion)
    if not (np.isfinite(tau).all() and (tau >= 0).all()):
        raise InvalidScene(
            "full_contact_diffusion must hold finite numbers >= 0 in Pa^2"
        )
    areas(0.0, mean_pressure, hardness)  # checks the pressures
    if reduction.rule in ("constant", "near_bounds"):  # `factor` refuses the second
        return reduction.factor(1.0) * tau
    # Up to here A = 1 to 1e-22, and all other rules have S(1) = 1.
    smallest = mean_pressure**2 / 200
    G = tau.copy()
    beyond = tau > smallest
    if not beyond.any():
        return G

    def factor(G: FloatArray) -> FloatArray:
        """Return S (n,) at the contact areas of the diffusions G (n,) in Pa^2."""
        return reduction.factor(areas(G, mean_pressure, hardness).total)

    if reduction.rule == "xu":
        tau_beyond = tau[beyond]

        def residual(G: FloatArray) -> tuple[FloatArray, FloatArray]:
            """Return G - [gamma + (1 - gamma) A(G)] tau in Pa^2, and its derivative."""
            loss_of_area, _ = boundary_slopes(G, mean_pressure, hardness)  # -dA/dG
            slope = 1 + (1 - reduction.gamma) * tau_beyond * loss_of_area
            return G - factor(G) * tau_beyond, slope

        G[beyond] = _newton(residual, reduction.gamma * tau_beyond, tau_beyond)
    else:
        ratio = max(tau.max() / smallest, 1 + 1e-9)
        steps = math.ceil(math.log10(ratio) * steps_per_decade) + 1
        edges = np.geomspace(smallest, smallest * ratio, steps + 1)
        G[beyond] = _integrate(factor, tau[beyond], edges)
    return G


def _integrate(
    factor: Callable[[FloatArray], FloatArray], tau: FloatArray, edges: FloatArray
) -> FloatArray:
    """Return the reduced diffusion G (n,) with int_0^G dG' / S(G') = tau, in Pa^2.

    Args:
        factor: Function from G (Pa^2) to the reduction S, arrays of one shape.
        tau: Diffusion of full contact in Pa^2, (n,).
        edges: Ends of the steps of G in Pa^2, (m,); up to the first, G = tau.

    Raises:
        NotConverged: Newton's method did not find a G.
    """

    def integral(low: FloatArray, high: FloatArray) -> FloatArray:
        """Return int dG / S from `low` to `high`, (k,) in Pa^2, by Gauss's rule."""
        points = low[:, None] + (high - low)[:, None] * _POINTS
        return np.asarray((high - low) * ((1 / factor(points)) @ _WEIGHTS))

    tau_at_edges = edges[0] + np.cumsum(integral(edges[:-1], edges[1:]))
    step = np.searchsorted(tau_at_edges[:-1], tau)
    low = edges[step]
    remainder = tau - np.concatenate([edges[:1], tau_at_edges])[step]

    def residual(G: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return int_low^G dG / S less the remainder of tau, and its derivative."""
        return integral(low, G) - remainder, 1 / factor(G)

    return _newton(residual, low, edges[step + 1])


def _newton(
    function: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    low: FloatArray,
    high: FloatArray,
) -> FloatArray:
    """Return the roots (n,) of an increasing function in brackets, to 1e-14 of `high`.

    Newton's method is used, with bisection where a step would leave the bracket.

    Args:
        function: Returns values and derivatives (n,) at arguments (n,).
        low: Lower ends of the brackets, (n,).
        high: Upper ends of the brackets, (n,).

    Raises:
        NotConverged: 100 steps did not reach the tolerance.
    """
    x = 0.5 * (low + high)
    scale = high
    for _ in range(100):
        value, slope = function(x)
        low = np.where(value < 0, x, low)
        high = np.where(value > 0, x, high)
        new = x - value / slope
        inside = (new >= low) & (new <= high)
        new = np.where(inside, new, 0.5 * (low + high))
        change = np.abs(new - x)
        x = new
        if np.all(change <= 1e-14 * scale):
            return np.asarray(x)
    raise NotConverged(
        "Newton's method did not find the theory's diffusion in 100 steps",
        residuals={"diffusion": float(np.max(change / scale))},
    )
