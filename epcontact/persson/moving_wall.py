"""Diffusion of the stress under a moving wall: a hardness that grows with the magnification.

With sigma_P(zeta) = Y the stress distribution still diffuses, dP/dG = d2P/dsigma2 on (0, Y(G)),
P(0) = 0, but the upper wall moves.  The area that flows carries Y A_pl.  Force and area are
conserved if

    P(Y) = (dY/dG) A_pl,    dA_pl/dG = -(dY/dG) P(Y) - dP/dsigma(Y)

[Persson, Surf. Sci. Rep. 61, 201 (2006), section 7; Lambert and Brodsky].  At dY/dG = 0 it is
the wall of constant hardness.  P(Y) >= 0 needs dY/dG >= 0: a falling hardness is refused.

On x = sigma / Y, with Q = Y P, D = 1/Y^2 and v = d ln Y / dG,

    dQ/dG = -dJ/dx,   J = -D dQ/dx - v x Q,   dA_pl/dG = J(1),   Q(1) = v A_pl / D.

It is solved by finite volumes with centred fluxes inside, half cells at the walls, and
J = 2 D (Q_N - v A_pl / D) / h - v Q_N at the upper wall.  With this flux R = Y Q and B = Y A_pl
satisfy d/dG (sum x_i R_i h + B) = 0 exactly.  Every Runge-Kutta method keeps a linear invariant,
so the force is conserved to rounding.  The method in G is the two-stage diagonally implicit one of
Alexander (1977), which is L-stable and of second order and tolerates a kink in Y.

The start is a closed form: while (Y - p_0) / (2 sqrt G) > 6 the upper wall is not felt.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded

from epcontact.errors import InvalidScene
from epcontact.persson.elastoplastic import pressure_cumulative
from epcontact.results import FloatArray

#: The wall is not felt while (Y - p_0) / (2 sqrt G) is larger: erfc(6) = 2e-17.
UNFELT = 6.0
#: The diagonal of Alexander's method.
_GAMMA = 1 - math.sqrt(0.5)
#: Cells within sqrt(G) / Y that the start needs.
_CELLS_PER_WIDTH = 4


@dataclass(frozen=True)
class StressState:
    """The stress distribution at one magnification.

    density: (n,) Q = hardness * P, the mean over each of n equal cells of (0, hardness);
    plastic: A_pl, share of the nominal area; hardness: in Pa.
    """

    density: FloatArray
    plastic: float
    hardness: float

    @property
    def elastic(self) -> float:
        """A_el, share of the nominal area."""
        return float(self.density.mean())

    @property
    def mean_pressure(self) -> float:
        """The force over the nominal area, in Pa."""
        n = self.density.size
        centres = (np.arange(n) + 0.5) / n
        return self.hardness * float(centres @ self.density / n + self.plastic)


def unfelt_diffusion(mean_pressure: float, hardness: float) -> float:
    """The largest G (Pa^2) at which a wall at `hardness` or above is not felt."""
    return ((hardness - mean_pressure) / (2 * UNFELT)) ** 2


def start(diffusion: float, mean_pressure: float, hardness: float, cells: int) -> StressState:
    """The state at a small diffusion (Pa^2, see `unfelt_diffusion`), from the closed form.

    Raises InvalidScene if the wall is felt already, or the cells do not resolve the state.
    """
    needed = _CELLS_PER_WIDTH * hardness / math.sqrt(diffusion)
    if cells < needed:
        raise InvalidScene(
            f"{cells} cells do not resolve the pressures where flow begins; {needed:.0f} do"
        )
    if diffusion > unfelt_diffusion(mean_pressure, hardness) * (1 + 1e-9):
        raise InvalidScene("diffusion is too large for a start from the elastic closed form")
    edges = np.linspace(0, hardness, cells + 1)
    below = pressure_cumulative(edges, diffusion, mean_pressure)
    return StressState(np.diff(below) * cells, 0.0, hardness)


def evolve(
    state: StressState, diffusion: FloatArray, hardness: FloatArray
) -> Iterator[StressState]:
    """The states at diffusion[1:] (Pa^2), one step each, from `state` at diffusion[0].

    The areas are of second order in the steps and the cells.  Raises InvalidScene where the
    hardness (Pa) falls, or grows without more roughness: there the force is not conserved.
    """
    G, Y = np.asarray(diffusion, dtype=np.float64), np.asarray(hardness, dtype=np.float64)
    _check(G, Y)
    log_Y = np.log(Y)
    rate = np.gradient(log_Y, G, edge_order=2 if G.size > 2 else 1)
    rate = np.maximum(rate, 0)  # the parabola through the ends may overshoot
    for k in range(G.size - 1):
        state = _step(state, G[k : k + 2], log_Y[k : k + 2], rate[k : k + 2])
        yield state


def _check(G: FloatArray, Y: FloatArray) -> None:
    falls = np.flatnonzero(~(np.diff(Y) >= 0))
    if falls.size:
        k = falls[0]
        raise InvalidScene(
            f"hardness falls from {Y[k]:g} to {Y[k + 1]:g} Pa with growing magnification, but "
            "there the theory does not conserve the force: it must not decrease"
        )
    if not (np.diff(G) > 0).all():
        raise InvalidScene(
            "diffusion does not increase along the steps; a hardness that grows where no "
            "roughness is added has no finite rate"
        )


def _step(state: StressState, G: FloatArray, log_Y: FloatArray, rate: FloatArray) -> StressState:
    """Take a step of the two-stage method in U = (R_1 .. R_n, B), given the pairs at its ends."""
    n = state.density.size
    dG = _GAMMA * (G[1] - G[0])
    U = math.exp(log_Y[0]) * np.append(state.density, state.plastic)
    inner_Y, inner_rate = (e[0] + _GAMMA * (e[1] - e[0]) for e in (log_Y, rate))
    change = _stage_change(U, dG, math.exp(inner_Y), inner_rate)
    U = U + (1 / _GAMMA - 1) * change
    Y = math.exp(log_Y[1])
    U = U + _stage_change(U, dG, Y, rate[1])
    return StressState(U[:n] / Y, float(U[n] / Y), Y)


def _stage_change(known: FloatArray, dG: float, Y: float, v: float) -> FloatArray:
    """U - known, where U - dG L U = known and L is the semi-discrete operator at one G.

    L is dR_i/dG = -(J_{i+1/2} - J_{i-1/2}) / h + v R_i and dB/dG = J_{n+1/2} + v B, with J formed
    from R and B; the bands are those of the matrix 1 - dG L.
    """
    n = known.size - 1
    h = 1.0 / n
    D = 1 / Y**2
    drift = 0.5 * v * np.arange(1, n) * h  # v x / 2 at the inner faces
    outward, inward = D / h - drift, D / h + drift  # J = outward Q_i - inward Q_{i+1}
    last = 2 * D / h - v  # J at the wall = last Q_n - (2 v / h) A
    bands = np.zeros((3, n + 1))
    diagonal = bands[1]
    diagonal[:] = 1 - dG * v
    diagonal[: n - 1] += dG / h * outward
    diagonal[1:n] += dG / h * inward
    diagonal[0] += dG / h * 2 * D / h
    diagonal[n - 1] += dG / h * last
    diagonal[n] += dG * 2 * v / h
    bands[0, 1:n] = -dG / h * inward
    bands[2, : n - 1] = -dG / h * outward
    bands[0, n] = -dG / h * 2 * v / h
    bands[2, n - 1] = -dG * last
    return np.asarray(solve_banded((1, 1), bands, known, check_finite=False) - known)
