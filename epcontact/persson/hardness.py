"""Areas against magnification for a hardness that depends on the magnification.

A solid can be harder on a small scale: sigma_P(zeta) grows with the magnification (indentation
size effect; work hardening is often cast in the same form).  `moving_wall` has the equations; here
the magnification is divided into steps for them.  S is the constant gamma, so that G(zeta) is
known beforehand.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from epcontact.errors import InvalidScene
from epcontact.persson.elastoplastic import areas
from epcontact.persson.moving_wall import StressState, evolve, start, unfelt_diffusion
from epcontact.persson.reduction import full_contact_diffusion
from epcontact.persson.roughness import Roughness
from epcontact.persson.theory import MagnificationCurve, PressureCurve, Theory
from epcontact.results import FloatArray
from epcontact.scene import array

#: Points at which G(zeta) and sigma_P(zeta) are sampled to place the steps.
_SAMPLES = 20001


class HardnessCurve(NamedTuple):
    """The answer for a hardness that depends on the magnification.

    Attributes:
        areas: Areas against magnification.
        hardness: (n,) sigma_P in Pa at the same magnifications.
        pressures: The distribution at the last of them; None if no point has reached the hardness.
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
    """Areas against magnification for a hardness that depends on it.

    Args:
        theory: The rough body, with a constant reduction; its own hardness is not used.
        mean_pressure: In Pa.
        hardness: Function from magnifications (m,) to sigma_P in Pa, which must not decrease.
        magnifications: (n,), ascending, from 1 to the highest of the roughness; by default 200 in
            a geometric sequence.
        resolution: Cells of the pressure and steps of the magnification.  The areas are of second
            order in both; with the default they are right to 1e-6 at a constant hardness.

    Raises:
        InvalidScene: The hardness decreases, is not above the mean pressure or is not a positive
            number; a magnification is out of order or range; the cells are too few; or the
            reduction is not constant.

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
        tau = full_contact_diffusion(theory.effective_modulus, variance(z * roughness.lowest))
        return theory.reduction.gamma * tau, _checked_hardness(hardness, z)

    cells, steps = resolution
    nodes = _nodes(path, zeta, mean_pressure, steps)
    G, Y = path(zeta)
    # Up to the first node no point reaches the hardness, and the body is elastic.
    elastic = areas(G, mean_pressure).elastic.copy()
    plastic = np.zeros_like(G)
    state, force_error = None, 0.0
    if nodes.size:
        node_G, node_Y = path(nodes)
        first = start(float(node_G[0]), mean_pressure, float(node_Y[0]), cells)
        for z, state in zip(nodes[1:], evolve(first, node_G, node_Y), strict=True):
            force_error = max(force_error, abs(state.mean_pressure / mean_pressure - 1))
            here = zeta == z
            elastic[here], plastic[here] = state.elastic, state.plastic
    total, q = elastic + plastic, zeta * roughness.lowest
    curve = MagnificationCurve(zeta, q, G, elastic, plastic, total)
    return HardnessCurve(curve, Y, None if state is None else _pressures(state), force_error)


def _magnifications(roughness: Roughness, given: ArrayLike | None) -> FloatArray:
    highest = roughness.highest / roughness.lowest
    if given is None:
        return np.geomspace(1.0, highest, 200)
    zeta = np.atleast_1d(array("magnifications", given))
    inside = (zeta >= 1) & (zeta <= highest * (1 + 1e-9))
    if zeta.ndim != 1 or not inside.all() or not (np.diff(zeta) > 0).all():
        raise InvalidScene(
            f"magnifications must ascend from 1 or more to the highest of the roughness, "
            f"{highest:g} at the most"
        )
    return zeta


def _continuous_slope_variance(roughness: Roughness) -> Callable[[FloatArray], FloatArray]:
    """xi^2(q) as a continuous function: the steps at a surface's modes are spread over rings."""
    edges = np.concatenate([[roughness.lowest], roughness.upper_edge])
    edges = edges[np.concatenate([[True], np.diff(edges) > 0])]
    exact = roughness.slope_variance_up_to
    if (np.diff(exact(np.linspace(edges[0], edges[1], 9))) > 0).all():
        return exact
    reached = np.concatenate([[0.0], np.cumsum(roughness.slope_variance)])[-edges.size :]
    return lambda q: np.asarray(np.interp(q, edges, reached))


def _checked_hardness(hardness: Callable[[FloatArray], ArrayLike], zeta: FloatArray) -> FloatArray:
    Y = np.broadcast_to(np.asarray(hardness(zeta), dtype=np.float64), zeta.shape)
    if not (np.isfinite(Y).all() and (Y > 0).all()):
        raise InvalidScene("hardness must be finite and positive, in Pa, at every magnification")
    return Y


def _nodes(
    path: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    zeta: FloatArray,
    mean_pressure: float,
    steps: int,
) -> FloatArray:
    """Magnifications of the steps, `zeta` among them; empty if no point reaches the hardness.

    At the first of them the upper wall is just not felt; ln G + 2 ln Y grows in equal steps.
    """
    samples = np.geomspace(1.0, zeta[-1], _SAMPLES)
    G, Y = path(samples)
    if not mean_pressure < Y[0]:
        raise InvalidScene(
            f"mean_pressure is {mean_pressure:g} Pa, but must stay below the hardness at "
            f"magnification 1, {Y[0]:g} Pa"
        )
    falls = np.flatnonzero(np.diff(Y) < 0)
    if falls.size:
        raise InvalidScene(
            f"hardness falls at magnification {samples[falls[0]]:g}, but there the theory does not "
            "conserve the force: it must not decrease"
        )
    unfelt = np.flatnonzero(unfelt_diffusion(mean_pressure, float(Y[0])) >= G)[-1]
    if unfelt == samples.size - 1:
        return samples[:0]
    if G[unfelt] == 0:
        raise InvalidScene("the roughness at magnification 1 is too much for the theory to start")
    share = np.log(G[unfelt:]) + 2 * np.log(Y[unfelt:])
    even = np.interp(np.linspace(share[0], share[-1], steps + 1), share, samples[unfelt:])
    return np.union1d(even, zeta[zeta > even[0]])


def _pressures(state: StressState) -> PressureCurve:
    n = state.density.size
    P = state.density / state.hardness
    ends = ([0.0], 0.5 * (P[1:] + P[:-1]), [max(1.5 * P[-1] - 0.5 * P[-2], 0.0)])
    return PressureCurve(
        pressure=np.linspace(0.0, state.hardness, n + 1),
        density=np.concatenate(ends),
        cumulative=np.concatenate([[0.0], np.cumsum(state.density) / n]),
        plastic=state.plastic,
    )
