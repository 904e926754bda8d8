"""A hardness that grows with the magnification: diffusion with a moving upper bound.

A solid can be harder on a small scale: sigma_P(zeta) = Y grows with the magnification
(indentation size effect; work hardening is often described in the same form).  The
stress distribution still diffuses, dP/dG = d2P/dsigma2 on (0, Y(G)), P(0) = 0, but the
upper bound moves.  The area that flows carries Y A_pl.  Force and area are conserved if

    P(Y) = (dY/dG) A_pl,    dA_pl/dG = -(dY/dG) P(Y) - dP/dsigma(Y)

[Persson, Surf. Sci. Rep. 61, 201 (2006), section 7; Lambert and Brodsky].  At dY/dG = 0
this is the bound of a constant hardness.  P(Y) >= 0 needs dY/dG >= 0: a falling
hardness is refused.

On x = sigma / Y, with Q = Y P, D = 1/Y^2 and v = d ln Y / dG,

    dQ/dG = -dJ/dx,   J = -D dQ/dx - v x Q,   dA_pl/dG = J(1),   Q(1) = v A_pl / D.

It is solved by finite volumes with centred fluxes inside, half cells at the bounds, and
J = 2 D (Q_N - v A_pl / D) / h - v Q_N at the upper bound.  With this flux R = Y Q and B
= Y A_pl satisfy d/dG (sum x_i R_i h + B) = 0 exactly.  Every Runge-Kutta method keeps a
linear invariant, so the force is conserved to rounding.  The method in G is the
two-stage diagonally implicit one of Alexander (1977), which is L-stable and of second
order and tolerates a kink in Y.

The start is a closed form: while (Y - p_0) / (2 sqrt G) > 6 the upper bound is not
felt.
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
#: The bound is not felt while (Y - p_0) / (2 sqrt G) is larger: erfc(6) = 2e-17.
UNFELT = 6.0
#: The diagonal of Alexander's method.
_DIAGONAL = 1 - math.sqrt(0.5)
#: Number of cells within sqrt(G) / Y that the start needs.
_CELLS_PER_WIDTH = 4

#: Function from magnifications (m,) to G in Pa^2 and sigma_P in Pa, (m,) each.
Path = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


class HardnessCurve(NamedTuple):
    """Areas for a hardness that depends on the magnification.

    Attributes:
        areas: Areas at n magnifications.
        hardness: sigma_P in Pa at these magnifications, (n,).
        pressures: Distribution of the pressure at the last magnification; None if no
            point has reached the hardness.
        force_error: Largest relative difference of force and load over all steps.
    """

    areas: MagnificationCurve
    hardness: FloatArray
    pressures: PressureCurve | None
    force_error: float


def hardness_curve(
    theory: Theory,
    mean_pressure: float,
    hardness: Callable[[FloatArray], ArrayLike],
    magnifications: ArrayLike | None = None,
    resolution: tuple[int, int] = (1024, 400),
) -> HardnessCurve:
    """Return the areas against magnification for a hardness that depends on it.

    Args:
        theory: The rough body, with a constant reduction; its own hardness is not used.
        mean_pressure: In Pa.
        hardness: Function from magnifications (m,) to sigma_P in Pa, which must not
            decrease.
        magnifications: Ascending, from 1 to the highest of the roughness, (n,); None:
            200 in a geometric sequence.
        resolution: Cells of the pressure and steps of the magnification.  The areas are
            of second order in both; with the default they err by 1e-6 at a constant
            hardness.

    Raises:
        InvalidScene: An argument is out of range, or the cells are too few.

    Example:
        >>> from epcontact import SelfAffineSpectrum
        >>> from epcontact.persson import EnergyReduction, analytic_roughness
        >>> spectrum = SelfAffineSpectrum(0.8, 2.5e4, 1e5, 64e5, rms_slope=1.0)
        >>> rough = analytic_roughness(spectrum)
        >>> theory = Theory(rough, 250e9, EnergyReduction(0.536))
        >>> curve = hardness_curve(
        ...     theory, 12.5e9, lambda zeta: 100e9 * zeta**0.15, [16, 256]
        ... )
        >>> curve.areas.plastic.round(4)
        array([0.0004, 0.0067])
    """
    if theory.reduction.rule != "constant":
        raise InvalidScene(
            f"the energy reduction follows the rule {theory.reduction.rule!r}, but "
            "must be constant where the hardness depends on the magnification"
        )
    roughness = theory.roughness
    zeta = _magnifications(roughness, magnifications)
    variance = _continuous_slope_variance(roughness)

    def path(z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return G and sigma_P at magnifications z (n,), in Pa^2 and Pa.

        Raises InvalidScene if a hardness is not finite and positive.
        """
        q = z * roughness.lowest
        tau = full_contact_diffusion(theory.effective_modulus, variance(q))
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
    pressures = None
    force_error = 0.0
    if nodes.size:
        node_G, node_Y = path(nodes)
        _refuse_falling_hardness(nodes, node_Y)
        state = start(float(node_G[0]), mean_pressure, float(node_Y[0]), cells)
        states = evolve(state, node_G, node_Y)
        for z, state in zip(nodes[1:], states, strict=True):
            force_error = max(force_error, abs(state.mean_pressure / mean_pressure - 1))
            here = zeta == z
            elastic[here] = state.elastic
            plastic[here] = state.plastic
        if nodes.size > 1:
            pressures = _pressures(state)
    curve = MagnificationCurve(
        magnification=zeta,
        wavenumber=zeta * roughness.lowest,
        diffusion=G,
        elastic=elastic,
        plastic=plastic,
        total=elastic + plastic,
    )
    return HardnessCurve(curve, Y, pressures, force_error)


def _magnifications(roughness: Roughness, given: ArrayLike | None) -> FloatArray:
    """Return the checked magnifications (n,), or the default ones for None.

    Args:
        roughness: Whose highest wave number limits the magnification.
        given: Ascending numbers of at least 1; None: 200 in a geometric sequence.

    Raises:
        InvalidScene: The magnifications do not ascend, or leave the range.
    """
    highest = roughness.highest / roughness.lowest
    if given is None:
        return np.geomspace(1.0, highest, 200)
    zeta = np.atleast_1d(array("magnifications", given))
    ascends = (
        zeta.ndim == 1 and zeta.size and zeta[0] >= 1 and (np.diff(zeta) > 0).all()
    )
    if not ascends or zeta[-1] > highest * (1 + 1e-9):
        raise InvalidScene(
            "magnifications must ascend from 1 or more to the highest of the "
            f"roughness, {highest:g} at the most"
        )
    return zeta


def _continuous_slope_variance(
    roughness: Roughness,
) -> Callable[[FloatArray], FloatArray]:
    """Return the slope variance xi^2(q) as a continuous function of the wave number q.

    The slope variance of a surface jumps at its modes; the jumps are spread over rings.

    Args:
        roughness: The bands of the surface.

    Returns:
        Function from wave numbers in rad/m, of any shape, to xi^2 of the roughness up
        to them.
    """
    edges = np.concatenate([[roughness.lowest], roughness.upper_edge])
    is_new = np.concatenate([[True], np.diff(edges) > 0])
    edges = edges[is_new]
    exact = roughness.slope_variance_up_to
    samples = np.linspace(edges[0], edges[1], 9)
    if (np.diff(exact(samples)) > 0).all():
        return exact
    variance = np.concatenate([[0.0], np.cumsum(roughness.slope_variance)])
    variance_at_edges = variance[-edges.size :]
    return lambda q: np.asarray(np.interp(q, edges, variance_at_edges))


def _nodes(
    path: Path, zeta: FloatArray, mean_pressure: float, steps: int
) -> FloatArray:
    """Return the magnifications of the steps, with `zeta` among them.

    At the first step no point has reached the hardness yet; from there on ln G + 2 ln Y
    grows in equal steps.

    Args:
        path: Function that returns G in Pa^2 and the hardness Y in Pa at
            magnifications.
        zeta: Magnifications at which areas are wanted, (n,).
        mean_pressure: In Pa.
        steps: Number of steps.

    Returns:
        The magnifications, ascending; none if no point reaches the hardness.

    Raises:
        InvalidScene: The mean pressure reaches the hardness at magnification 1, the
            hardness falls, or the roughness at magnification 1 is too large.
    """
    samples = np.geomspace(1.0, zeta[-1], _SAMPLES)
    G, Y = path(samples)
    if not mean_pressure < Y[0]:
        raise InvalidScene(
            f"mean_pressure is {mean_pressure:g} Pa, but must stay below the hardness "
            f"at magnification 1, {Y[0]:g} Pa"
        )
    _refuse_falling_hardness(samples, Y)
    felt_from = unfelt_diffusion(mean_pressure, float(Y[0]))
    first = np.flatnonzero(felt_from >= G)[-1]
    if first == samples.size - 1:
        return samples[:0]
    if G[first] == 0:
        raise InvalidScene(
            "the first band of roughness at magnification 1 already reaches the "
            "hardness, where the theory cannot start; lower the mean pressure"
        )
    spread = np.log(G[first:]) + 2 * np.log(Y[first:])
    equal_steps = np.linspace(spread[0], spread[-1], steps + 1)
    nodes = np.interp(equal_steps, spread, samples[first:])
    return np.union1d(nodes, zeta[zeta > nodes[0]])


def _refuse_falling_hardness(zeta: FloatArray, hardness: FloatArray) -> None:
    """Raise InvalidScene if the hardness falls along the magnifications.

    Args:
        zeta: Ascending magnifications, (n,).
        hardness: In Pa at each of them, (n,).
    """
    falls = np.flatnonzero(np.diff(hardness) < 0)
    if falls.size:
        raise InvalidScene(
            f"hardness falls at magnification {zeta[falls[0]]:g}, but there the theory "
            "does not conserve the force: it must not decrease"
        )


# --- the moving bound


@dataclass(frozen=True)
class StressState:
    """The stress distribution at one magnification.

    Attributes:
        density: Q = hardness * P, the mean over each of n cells of (0, hardness), (n,).
        plastic: A_pl as a fraction of the nominal area.
        hardness: sigma_P in Pa.
    """

    density: FloatArray
    plastic: float
    hardness: float

    @property
    def elastic(self) -> float:
        """The elastic area of the state as a fraction of the nominal area."""
        return float(self.density.mean())

    @property
    def mean_pressure(self) -> float:
        """The force of the state over the nominal area, elastic and plastic, in Pa."""
        n = self.density.size
        centres = (np.arange(n) + 0.5) / n
        return self.hardness * float(centres @ self.density / n + self.plastic)


def _pressures(state: StressState) -> PressureCurve:
    """Return the distribution of the pressure of a state at the ends of its cells.

    Density (1/Pa) and cumulative area (fraction) are given at n + 1 pressures from 0 to
    the hardness; the state must have two cells at least.
    """
    n = state.density.size
    P = state.density / state.hardness
    pressure = np.linspace(0.0, state.hardness, n + 1)
    at_hardness = max(1.5 * P[-1] - 0.5 * P[-2], 0.0)
    density = np.concatenate([[0.0], 0.5 * (P[1:] + P[:-1]), [at_hardness]])
    cumulative = np.concatenate([[0.0], np.cumsum(state.density) / n])
    return PressureCurve(pressure, density, cumulative, state.plastic)


def unfelt_diffusion(mean_pressure: float, hardness: float) -> float:
    """Return the largest diffusion G in Pa^2 at which no point reaches the hardness.

    Up to there a fraction of less than 2e-17 of the area is at the hardness.

    Args:
        mean_pressure: In Pa.
        hardness: In Pa, above the mean pressure.
    """
    return ((hardness - mean_pressure) / (2 * UNFELT)) ** 2


def start(
    diffusion: float, mean_pressure: float, hardness: float, cells: int
) -> StressState:
    """Return the stress state at a small diffusion from the closed form, without flow.

    Args:
        diffusion: G in Pa^2, at most `unfelt_diffusion`.
        mean_pressure: In Pa.
        hardness: sigma_P in Pa.
        cells: Number of cells of equal width between 0 and the hardness.

    Raises:
        InvalidScene: The cells are too few to resolve the pressures.
    """
    needed = _CELLS_PER_WIDTH * hardness / math.sqrt(diffusion)
    if cells < needed:
        raise InvalidScene(
            f"{cells} cells do not resolve the pressures where flow begins; at least "
            f"{needed:.0f} cells are needed"
        )
    ends = np.linspace(0, hardness, cells + 1)
    cumulative = pressure_cumulative(ends, diffusion, mean_pressure)
    return StressState(np.diff(cumulative) * cells, 0.0, hardness)


def evolve(
    state: StressState, diffusion: FloatArray, hardness: FloatArray
) -> Iterator[StressState]:
    """Yield the stress states at diffusion[1:], one step each, with a growing hardness.

    Args:
        state: The state at diffusion[0].
        diffusion: G in Pa^2, ascending, (n,).
        hardness: sigma_P in Pa at each G, (n,).

    Raises:
        InvalidScene: The diffusion does not increase from step to step: the hardness
            then grows at no finite rate.
    """
    G = np.asarray(diffusion, dtype=np.float64)
    log_Y = np.log(hardness)
    if not (np.diff(G) > 0).all():
        raise InvalidScene(
            "diffusion does not increase along the steps; a hardness that grows where "
            "no roughness is added has no finite rate"
        )
    rate = np.gradient(log_Y, G, edge_order=2 if G.size > 2 else 1)
    rate = np.maximum(rate, 0)  # the parabola through the ends may overshoot
    for k in range(G.size - 1):
        both_ends = slice(k, k + 2)
        state = _step(state, G[both_ends], log_Y[both_ends], rate[both_ends])
        yield state


def _step(
    state: StressState, G: FloatArray, log_Y: FloatArray, rate: FloatArray
) -> StressState:
    """Return the stress state after one step of Alexander's two-stage method.

    The unknowns are the densities of the n cells times the hardness Y, Y Q_1 .. Y Q_n,
    and the plastic area times Y.

    Args:
        state: The state at the beginning.
        G: Diffusion in Pa^2 at both ends, (2,).
        log_Y: ln of the hardness in Pa at both ends, (2,).
        rate: v = d ln Y / dG in 1/Pa^2 at both ends, (2,).
    """
    n = state.density.size
    dG = _DIAGONAL * (G[1] - G[0])
    U = math.exp(log_Y[0]) * np.append(state.density, state.plastic)
    inner_Y = math.exp(log_Y[0] + _DIAGONAL * (log_Y[1] - log_Y[0]))
    inner_rate = rate[0] + _DIAGONAL * (rate[1] - rate[0])
    U = U + (1 / _DIAGONAL - 1) * _stage_change(U, dG, inner_Y, inner_rate)
    Y = math.exp(log_Y[1])
    U = U + _stage_change(U, dG, Y, rate[1])
    return StressState(U[:n] / Y, float(U[n] / Y), Y)


def _stage_change(known: FloatArray, dG: float, Y: float, v: float) -> FloatArray:
    """Return U - known, where U - dG L U = known, for the operator L at one G.

    L is dR_i/dG = -(J_{i+1/2} - J_{i-1/2}) / h + v R_i and dB/dG = J_{n+1/2} + v B,
    with J formed from R and B; the bands are those of the matrix 1 - dG L.

    Args:
        known: R_1 .. R_n and B, (n + 1,).
        dG: Size of the stage in Pa^2.
        Y: Hardness in Pa.
        v: d ln Y / dG in 1/Pa^2.
    """
    n = known.size - 1
    h = 1.0 / n
    D = 1 / Y**2
    drift = 0.5 * v * np.arange(1, n) * h  # v x / 2 at the inner faces
    # J = outward Q_i - inward Q_{i+1} inside, and last Q_n - (2 v / h) A at the bound.
    outward = D / h - drift
    inward = D / h + drift
    last = 2 * D / h - v
    bands = np.zeros((3, n + 1))
    above, diagonal, below = bands
    diagonal[:] = 1 - dG * v
    diagonal[: n - 1] += dG / h * outward
    diagonal[1:n] += dG / h * inward
    diagonal[[0, n - 1, n]] += dG / h * np.array([2 * D / h, last, 2 * v])
    above[1:n] = -dG / h * inward
    above[n] = -dG / h * 2 * v / h
    below[: n - 1] = -dG / h * outward
    below[n - 1] = -dG * last
    return np.asarray(solve_banded((1, 1), bands, known, check_finite=False) - known)
