"""A hardness that grows with the magnification: diffusion of the stress under a moving
wall.

A solid can be harder on a small scale: sigma_P(zeta) = Y grows with the magnification
(indentation size effect; work hardening is often cast in the same form).  The stress
distribution still diffuses, dP/dG = d2P/dsigma2 on (0, Y(G)), P(0) = 0, but the upper
wall moves.  The area that flows carries Y A_pl.  Force and area are conserved if

    P(Y) = (dY/dG) A_pl,    dA_pl/dG = -(dY/dG) P(Y) - dP/dsigma(Y)

[Persson, Surf. Sci. Rep. 61, 201 (2006), section 7; Lambert and Brodsky].  At dY/dG = 0
it is the wall of constant hardness.  P(Y) >= 0 needs dY/dG >= 0: a falling hardness is
refused.

On x = sigma / Y, with Q = Y P, D = 1/Y^2 and v = d ln Y / dG,

    dQ/dG = -dJ/dx,   J = -D dQ/dx - v x Q,   dA_pl/dG = J(1),   Q(1) = v A_pl / D.

It is solved by finite volumes with centred fluxes inside, half cells at the walls, and
J = 2 D (Q_N - v A_pl / D) / h - v Q_N at the upper wall.  With this flux R = Y Q and B
= Y A_pl satisfy d/dG (sum x_i R_i h + B) = 0 exactly.  Every Runge-Kutta method keeps a
linear invariant, so the force is conserved to rounding.  The method in G is the
two-stage diagonally implicit one of Alexander (1977), which is L-stable and of second
order and tolerates a kink in Y.

The start is a closed form: while (Y - p_0) / (2 sqrt G) > 6 the upper wall is not felt.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_banded

from epcontact.errors import InvalidScene
from epcontact.persson.elastoplastic import areas, pressure_cumulative
from epcontact.persson.reduction import full_contact_diffusion
from epcontact.persson.roughness import Roughness
from epcontact.persson.theory import MagnificationCurve, PressureCurve, Theory
from epcontact.results import FloatArray
from epcontact.scene import array

#: Points at which G(zeta) and sigma_P(zeta) are sampled to place the steps.
_SAMPLES = 20001
#: The wall is not felt while (Y - p_0) / (2 sqrt G) is larger: erfc(6) = 2e-17.
UNFELT = 6.0
#: The diagonal of Alexander's method.
_GAMMA = 1 - math.sqrt(0.5)
#: Cells within sqrt(G) / Y that the start needs.
_CELLS_PER_WIDTH = 4


class HardnessCurve(NamedTuple):
    """Areas and sigma_P (n,) at magnifications, and the distribution of pressures at
    the last.
    """

    areas: MagnificationCurve
    hardness: FloatArray
    pressures: PressureCurve | None  # None if no point has reached the hardness
    force_error: (
        float  # the largest relative difference of force and load over all steps
    )


def hardness_curve(
    theory: Theory,
    mean_pressure: float,
    hardness: Callable[[FloatArray], ArrayLike],
    magnifications: ArrayLike | None = None,
    resolution: tuple[int, int] = (1024, 400),
) -> HardnessCurve:
    """Areas against magnification for a hardness that depends on it.

    Args:
        theory: The rough body, with a constant reduction; its own hardness is not used.
        mean_pressure: In Pa.
        hardness: Function from magnifications (m,) to sigma_P in Pa, which must not
            decrease.
        magnifications: (n,), ascending, from 1 to the highest of the roughness; by
            default 200 in a geometric sequence.
        resolution: Cells of the pressure and steps of the magnification.  The areas are
            of second order in both; with the default they are right to 1e-6 at a
            constant hardness.

    Raises:
        InvalidScene: An argument is out of range, or the cells are too few.

    Example:
        >>> from epcontact import SelfAffineSpectrum
        >>> from epcontact.persson import EnergyReduction, analytic_roughness
        >>> rough = analytic_roughness(SelfAffineSpectrum(0.8, 2.5e4, 1e5, 64e5, rms_slope=1.0))
        >>> theory = Theory(rough, 250e9, EnergyReduction(0.536))
        >>> curve = hardness_curve(theory, 12.5e9, lambda zeta: 100e9 * zeta**0.15, [16, 256])
        >>> curve.areas.plastic.round(4)
        array([0.0004, 0.0067])
    """
    if theory.reduction.rule != "constant":
        raise InvalidScene(
            f"the energy reduction follows the rule {theory.reduction.rule!r}, but must be "
            "constant where the hardness depends on the magnification"
        )
    roughness = theory.roughness
    zeta = _magnifications(roughness, magnifications)
    variance = _continuous_slope_variance(roughness)

    def path(z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """G and sigma_P at magnifications."""
        tau = full_contact_diffusion(
            theory.effective_modulus, variance(z * roughness.lowest)
        )
        Y = np.broadcast_to(np.asarray(hardness(z), dtype=np.float64), z.shape)
        if not (np.isfinite(Y).all() and (Y > 0).all()):
            raise InvalidScene(
                "hardness must be finite and positive, in Pa, at every magnification"
            )
        return theory.reduction.gamma * tau, Y

    cells, steps = resolution
    nodes = _nodes(path, zeta, mean_pressure, steps)
    G, Y = path(zeta)
    # Up to the first node no point reaches the hardness, and the body is elastic.
    elastic = areas(G, mean_pressure).elastic.copy()
    plastic = np.zeros_like(G)
    state, force_error = None, 0.0
    if nodes.size:
        node_G, node_Y = path(nodes)
        _refuse_fall(nodes, node_Y)
        first = start(float(node_G[0]), mean_pressure, float(node_Y[0]), cells)
        for z, state in zip(nodes[1:], evolve(first, node_G, node_Y), strict=True):
            force_error = max(force_error, abs(state.mean_pressure / mean_pressure - 1))
            here = zeta == z
            elastic[here], plastic[here] = state.elastic, state.plastic
    total, q = elastic + plastic, zeta * roughness.lowest
    curve = MagnificationCurve(zeta, q, G, elastic, plastic, total)
    return HardnessCurve(
        curve, Y, None if state is None else _pressures(state), force_error
    )


def _magnifications(roughness: Roughness, given: ArrayLike | None) -> FloatArray:
    highest = roughness.highest / roughness.lowest
    if given is None:
        return np.geomspace(1.0, highest, 200)
    zeta = np.atleast_1d(array("magnifications", given))
    good = zeta.ndim == 1 and zeta.size and zeta[0] >= 1 and (np.diff(zeta) > 0).all()
    if not good or zeta[-1] > highest * (1 + 1e-9):
        raise InvalidScene(
            "magnifications must ascend from 1 or more to the highest of the roughness, "
            f"{highest:g} at the most"
        )
    return zeta


def _continuous_slope_variance(
    roughness: Roughness,
) -> Callable[[FloatArray], FloatArray]:
    """xi^2(q) as a continuous function: the steps at a surface's modes are spread over
    rings.
    """
    edges = np.concatenate([[roughness.lowest], roughness.upper_edge])
    edges = edges[np.concatenate([[True], np.diff(edges) > 0])]
    exact = roughness.slope_variance_up_to
    if (np.diff(exact(np.linspace(edges[0], edges[1], 9))) > 0).all():
        return exact
    reached = np.concatenate([[0.0], np.cumsum(roughness.slope_variance)])[
        -edges.size :
    ]
    return lambda q: np.asarray(np.interp(q, edges, reached))


def _nodes(
    path: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    zeta: FloatArray,
    mean_pressure: float,
    steps: int,
) -> FloatArray:
    """Magnifications of the steps, `zeta` among them; empty if no point reaches the
    hardness.  From the first, where the upper wall is just not felt, ln G + 2 ln Y
    grows in equal steps.
    """
    samples = np.geomspace(1.0, zeta[-1], _SAMPLES)
    G, Y = path(samples)
    if not mean_pressure < Y[0]:
        raise InvalidScene(
            f"mean_pressure is {mean_pressure:g} Pa, but must stay below the hardness at "
            f"magnification 1, {Y[0]:g} Pa"
        )
    _refuse_fall(samples, Y)
    unfelt = np.flatnonzero(unfelt_diffusion(mean_pressure, float(Y[0])) >= G)[-1]
    if unfelt == samples.size - 1:
        return samples[:0]
    if G[unfelt] == 0:
        raise InvalidScene(
            "the roughness at magnification 1 is too much for the theory to start"
        )
    share = np.log(G[unfelt:]) + 2 * np.log(Y[unfelt:])
    even = np.interp(
        np.linspace(share[0], share[-1], steps + 1), share, samples[unfelt:]
    )
    return np.union1d(even, zeta[zeta > even[0]])


def _refuse_fall(zeta: FloatArray, hardness: FloatArray) -> None:
    falls = np.flatnonzero(np.diff(hardness) < 0)
    if falls.size:
        raise InvalidScene(
            f"hardness falls at magnification {zeta[falls[0]]:g}, but there the theory does not "
            "conserve the force: it must not decrease"
        )


# --- the moving wall
# -----------------------------------------------------------------------------


@dataclass(frozen=True)
class StressState:
    """The stress distribution at one magnification."""

    density: FloatArray  # (n,) Q = hardness * P, the mean over each of n cells of (0, hardness)
    plastic: float  # A_pl, share of the nominal area
    hardness: float  # in Pa

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


def _pressures(state: StressState) -> PressureCurve:
    n, P = state.density.size, state.density / state.hardness
    pressure = np.linspace(0.0, state.hardness, n + 1)
    at_wall = max(1.5 * P[-1] - 0.5 * P[-2], 0.0)
    density = np.concatenate([[0.0], 0.5 * (P[1:] + P[:-1]), [at_wall]])
    cumulative = np.concatenate([[0.0], np.cumsum(state.density) / n])
    return PressureCurve(pressure, density, cumulative, state.plastic)


def unfelt_diffusion(mean_pressure: float, hardness: float) -> float:
    """The largest G (Pa^2) at which a wall at `hardness` or above is not felt."""
    return ((hardness - mean_pressure) / (2 * UNFELT)) ** 2


def start(
    diffusion: float, mean_pressure: float, hardness: float, cells: int
) -> StressState:
    """The state at a diffusion (Pa^2) of at most `unfelt_diffusion`, from the closed
    form.
    """
    needed = _CELLS_PER_WIDTH * hardness / math.sqrt(diffusion)
    if cells < needed:
        raise InvalidScene(
            f"{cells} cells do not resolve the pressures where flow begins; {needed:.0f} do"
        )
    below = pressure_cumulative(
        np.linspace(0, hardness, cells + 1), diffusion, mean_pressure
    )
    return StressState(np.diff(below) * cells, 0.0, hardness)


def evolve(
    state: StressState, diffusion: FloatArray, hardness: FloatArray
) -> Iterator[StressState]:
    """The states at diffusion[1:] (Pa^2), one step each, from `state` at diffusion[0].
    Raises InvalidScene where the hardness (Pa) grows without more roughness, at no
    finite rate.
    """
    G, log_Y = np.asarray(diffusion, dtype=np.float64), np.log(hardness)
    if not (np.diff(G) > 0).all():
        raise InvalidScene(
            "diffusion does not increase along the steps; a hardness that grows where no "
            "roughness is added has no finite rate"
        )
    rate = np.gradient(log_Y, G, edge_order=2 if G.size > 2 else 1)
    rate = np.maximum(rate, 0)  # the parabola through the ends may overshoot
    for k in range(G.size - 1):
        state = _step(state, G[k : k + 2], log_Y[k : k + 2], rate[k : k + 2])
        yield state


def _step(
    state: StressState, G: FloatArray, log_Y: FloatArray, rate: FloatArray
) -> StressState:
    """Take a step of the two-stage method in U = (R_1 .. R_n, B), given the pairs at
    its ends.
    """
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
    L is dR_i/dG = -(J_{i+1/2} - J_{i-1/2}) / h + v R_i and dB/dG = J_{n+1/2} + v B,
    with J formed from R and B; the bands are those of the matrix 1 - dG L.
    """
    n = known.size - 1
    h = 1.0 / n
    D = 1 / Y**2
    drift = 0.5 * v * np.arange(1, n) * h  # v x / 2 at the inner faces
    outward, inward = D / h - drift, D / h + drift  # J = outward Q_i - inward Q_{i+1}
    last = 2 * D / h - v  # J at the wall = last Q_n - (2 v / h) A
    above, diagonal, below = bands = np.zeros((3, n + 1))
    diagonal[:] = 1 - dG * v
    diagonal[: n - 1] += dG / h * outward
    diagonal[1:n] += dG / h * inward
    diagonal[[0, n - 1, n]] += dG / h * np.array([2 * D / h, last, 2 * v])
    above[1:n], above[n] = -dG / h * inward, -dG / h * 2 * v / h
    below[: n - 1], below[n - 1] = -dG / h * outward, -dG * last
    return np.asarray(solve_banded((1, 1), bands, known, check_finite=False) - known)
