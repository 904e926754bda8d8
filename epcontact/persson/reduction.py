"""The reduction S of elastic energy, and with it the diffusion G of equation (2).

In full contact the roughness up to a wave number q gives the pressure half the variance
tau = (pi/4) E*^2 int q^3 C dq.  In partial contact less elastic energy is stored in what is in
contact; the theory accounts for it by dG = S dtau, where S depends on the relative contact
area A (elastic and plastic) at the magnification:

    constant     S = gamma                                    (the limit A << 1 of the next)
    persson      S = gamma + (1 - gamma) A^2                  Yang and Persson (2008)
    wang_muser   S = gamma - (2/9) A^2 + (11/9 - gamma) A^4   Wang and Mueser (2017)
    xu           G = [gamma + (1 - gamma) A] tau, with the area at the end of the range:
                 one implicit equation instead of a differential one; Xu et al. (2024)

A depends on the spectrum through G alone, so the implicit equation separates:
tau(G) = int_0^G dG' / S(A(G')).  It is integrated in steps of constant ratio of G by Gauss's
three-point rule, whose error falls with the sixth power of the step, and inverted by Newton's
method; as S > 0, tau(G) is monotone and there is no root to miss.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from epcontact.errors import InvalidScene, NotConverged
from epcontact.persson.elastoplastic import areas, boundary_slopes
from epcontact.results import FloatArray

Rule = Literal["constant", "persson", "wang_muser", "xu"]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1), 0.5 * _WEIGHTS
#: Steps to a decade of G; with three Gauss points the error is below 1e-11 (tested).
STEPS_PER_DECADE = 24


@dataclass(frozen=True)
class EnergyReduction:
    """A rule for S and its parameter gamma, the value of S in the limit of no contact.

    Raises InvalidScene for an unknown rule or a gamma outside (0, 1] (wang_muser: at least
    0.011, below which its polynomial is negative at some area).
    """

    gamma: float
    rule: Rule = "constant"

    def __post_init__(self) -> None:
        rules = get_args(Rule)
        if self.rule not in rules:
            raise InvalidScene(
                f"energy reduction rule is {self.rule!r}, but must be one of {', '.join(rules)}"
            )
        least = 0.011 if self.rule == "wang_muser" else 0.0
        if not least < self.gamma <= 1:
            raise InvalidScene(
                f"energy_reduction is {self.gamma!r}, but must lie between {least:g} (excluded) "
                "and 1"
            )


#: Each rule with a gamma that was published for it; the constant is that of Almqvist and Persson.
PUBLISHED = (
    EnergyReduction(0.536, "constant"),
    EnergyReduction(0.45, "persson"),
    EnergyReduction(5 / 9, "wang_muser"),
    EnergyReduction(0.42, "xu"),
)


def reduction_factor(reduction: EnergyReduction, contact_area: ArrayLike) -> FloatArray:
    """S at a relative contact area A in [0, 1]; of `xu`, the factor G / tau."""
    A = np.asarray(contact_area, dtype=np.float64)
    g = reduction.gamma
    match reduction.rule:
        case "constant":
            return np.full(A.shape, g)
        case "persson":
            return g + (1 - g) * A**2
        case "wang_muser":
            return g - 2 / 9 * A**2 + (11 / 9 - g) * A**4
        case "xu":
            return g + (1 - g) * A


def reduced_diffusion(
    reduction: EnergyReduction,
    full_contact_diffusion: ArrayLike,
    mean_pressure: float,
    hardness: float = math.inf,
    steps_per_decade: int = STEPS_PER_DECADE,
) -> FloatArray:
    """G in Pa^2, of the shape of tau = full_contact_diffusion (Pa^2).

    Raises InvalidScene unless tau is finite and not negative and 0 < mean_pressure < hardness.
    """
    tau = np.asarray(full_contact_diffusion, dtype=np.float64)
    if not (np.isfinite(tau).all() and (tau >= 0).all()):
        raise InvalidScene("full_contact_diffusion must hold finite numbers >= 0 in Pa^2")
    areas(0.0, mean_pressure, hardness)  # checks the pressures
    if reduction.rule == "constant":
        return reduction.gamma * tau

    def area(G: FloatArray) -> FloatArray:
        return areas(G, mean_pressure, hardness).total

    flat = tau.ravel()
    # Up to here A = 1 to 1e-22, and all these rules have S(1) = 1.
    smallest = mean_pressure**2 / 200
    late = flat > smallest
    G = flat.copy()
    if late.any():
        if reduction.rule == "xu":
            G[late] = _xu(reduction, flat[late], area, mean_pressure, hardness)
        else:
            ratio = max(flat.max() / smallest, 1 + 1e-9)
            steps = math.ceil(math.log10(ratio) * steps_per_decade) + 1
            edges = np.geomspace(smallest, smallest * ratio, steps + 1)
            G[late] = _invert(reduction, flat[late], area, edges)
    return G.reshape(tau.shape)


def _integral(
    reduction: EnergyReduction,
    area: Callable[[FloatArray], FloatArray],
    low: FloatArray,
    high: FloatArray,
) -> FloatArray:
    """int dG / S from low to high, each pair by one Gauss rule."""
    width = high - low
    points = low[:, None] + width[:, None] * _NODES
    return np.asarray(width * ((1 / reduction_factor(reduction, area(points))) @ _WEIGHTS))


def _invert(
    reduction: EnergyReduction,
    tau: FloatArray,
    area: Callable[[FloatArray], FloatArray],
    edges: FloatArray,
) -> FloatArray:
    """G with tau(G) = tau, from tau at the edges of the steps; tau(edges[0]) = edges[0]."""
    reached = edges[0] + np.cumsum(_integral(reduction, area, edges[:-1], edges[1:]))
    step = np.searchsorted(reached[:-1], tau)
    low, high = edges[step], edges[step + 1]
    rest = tau - np.concatenate([edges[:1], reached])[step]

    def miss(G: FloatArray) -> tuple[FloatArray, FloatArray]:
        slope = 1 / reduction_factor(reduction, area(G))
        return _integral(reduction, area, low, G) - rest, slope

    return _bracketed_newton(miss, low, high, tau)


def _xu(
    reduction: EnergyReduction,
    tau: FloatArray,
    area: Callable[[FloatArray], FloatArray],
    mean_pressure: float,
    hardness: float,
) -> FloatArray:
    """G with G = [gamma + (1 - gamma) A(G)] tau; as A falls with G, there is just one."""

    def miss(G: FloatArray) -> tuple[FloatArray, FloatArray]:
        loss, _ = boundary_slopes(G, mean_pressure, hardness)  # -dA/dG
        slope = 1 + (1 - reduction.gamma) * tau * loss
        return G - reduction_factor(reduction, area(G)) * tau, slope

    return _bracketed_newton(miss, reduction.gamma * tau, tau, tau)


def _bracketed_newton(
    miss: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    low: FloatArray,
    high: FloatArray,
    scale: FloatArray,
) -> FloatArray:
    """The roots of an increasing function in [low, high], to 1e-14 of `scale`."""
    x = 0.5 * (low + high)
    for _ in range(100):
        value, slope = miss(x)
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
