"""Areas against magnification for a hardness that depends on the magnification.

The small sees a harder solid: sigma_P(zeta) grows (indentation size effect; work hardening is
often cast in the same form).  The equations are those of `moving_wall`; here the magnification
is turned into steps of it.  S is the constant gamma, so that G(zeta) is known beforehand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from epcontact.errors import InvalidScene
from epcontact.persson.elastoplastic import areas
from epcontact.persson.moving_wall import StressState, evolve, start, unfelt_diffusion
from epcontact.persson.reduction import EnergyReduction, full_contact_diffusion
from epcontact.persson.roughness import Roughness
from epcontact.persson.theory import MagnificationCurve, PressureCurve
from epcontact.results import FloatArray

HardnessLaw = Callable[[FloatArray], ArrayLike]

#: Points at which G(zeta) and sigma_P(zeta) are looked at to place the steps.
_LOOKS = 20001


@dataclass(frozen=True)
class HardnessCurve:
    """The answer for a hardness that depends on the magnification.

    areas: against magnification; hardness: (n,) sigma_P in Pa at the same magnifications;
    pressures: the distribution at the last of them, None while no wall was felt;
    force_error: the largest relative departure of the force from the load on the way.
    """

    areas: MagnificationCurve
    hardness: FloatArray
    pressures: PressureCurve | None
    force_error: float

    def columns(self) -> dict[str, FloatArray]:
        """The columns by name and unit."""
        return self.areas.columns() | {"hardness_Pa": self.hardness}


def hardness_curve(
    roughness: Roughness,
    effective_modulus: float,
    energy_reduction: float,
    mean_pressure: float,
    hardness: HardnessLaw,
    magnifications: ArrayLike | None = None,
    resolution: tuple[int, int] = (1024, 400),
) -> HardnessCurve:
    """Elastic, plastic and total area at magnifications (n,), ascending.

    hardness: maps magnifications (m,) to sigma_P in Pa, not decreasing; energy_reduction: gamma;
    pressures and modulus in Pa; magnifications: from 1 to the highest of the roughness, by
    default 200 of equal ratio; resolution: cells of the pressure and steps of the magnification,
    in both of which the areas are of second order (constant hardness: right to 1e-6 by default).

    Raises InvalidScene for a falling hardness, one that the mean pressure reaches, one that is
    no positive number, magnifications out of order or range, or too few cells.
    """
    zeta = _magnifications(roughness, magnifications)
    gamma = EnergyReduction(energy_reduction).gamma
    variance = _continuous_slope_variance(roughness)

    def diffusion(z: FloatArray) -> FloatArray:
        return gamma * full_contact_diffusion(effective_modulus, variance(z * roughness.lowest))

    cells, steps = resolution
    nodes = _nodes(diffusion, hardness, zeta, mean_pressure, steps)
    G, Y = diffusion(zeta), _values(hardness, zeta)
    # Up to the first node the wall is not felt, and the body is elastic.
    elastic = areas(G, mean_pressure).elastic.copy()
    plastic = np.zeros_like(G)
    state, force_error = None, 0.0
    if nodes.size:
        node_G, node_Y = diffusion(nodes), _values(hardness, nodes)
        begun = start(float(node_G[0]), mean_pressure, float(node_Y[0]), cells)
        for z, state in zip(nodes[1:], evolve(begun, node_G, node_Y), strict=True):
            force_error = max(force_error, abs(state.mean_pressure / mean_pressure - 1))
            asked = zeta == z
            elastic[asked], plastic[asked] = state.elastic, state.plastic
    curve = MagnificationCurve(
        zeta, zeta * roughness.lowest, G, elastic, plastic, elastic + plastic
    )
    return HardnessCurve(curve, Y, None if state is None else _pressures(state), force_error)


def _magnifications(roughness: Roughness, given: ArrayLike | None) -> FloatArray:
    highest = roughness.highest / roughness.lowest
    if given is None:
        return np.geomspace(1.0, highest, 200)
    zeta = np.atleast_1d(np.asarray(given, dtype=np.float64))
    inside = (zeta >= 1) & (zeta <= highest * (1 + 1e-9))
    if zeta.ndim != 1 or not inside.all() or not (np.diff(zeta) > 0).all():
        raise InvalidScene(
            f"magnifications must ascend from 1 or more to the highest of the roughness, "
            f"{highest:g} at the most"
        )
    return zeta


def _continuous_slope_variance(roughness: Roughness) -> Callable[[FloatArray], FloatArray]:
    """xi^2(q) without steps: those of a surface's own modes are spread over their rings."""
    edges = np.concatenate([[roughness.lowest], roughness.upper_edge])
    edges = edges[np.concatenate([[True], np.diff(edges) > 0])]
    exact = roughness.slope_variance_up_to
    if (np.diff(exact(np.linspace(edges[0], edges[1], 9))) > 0).all():
        return exact
    reached = np.concatenate([[0.0], np.cumsum(roughness.slope_variance)])[-edges.size :]
    return lambda q: np.asarray(np.interp(q, edges, reached))


def _values(hardness: HardnessLaw, zeta: FloatArray) -> FloatArray:
    Y = np.broadcast_to(np.asarray(hardness(zeta), dtype=np.float64), zeta.shape)
    if not (np.isfinite(Y).all() and (Y > 0).all()):
        raise InvalidScene("hardness must be finite and positive, in Pa, at every magnification")
    return Y


def _nodes(
    diffusion: HardnessLaw,
    hardness: HardnessLaw,
    zeta: FloatArray,
    mean_pressure: float,
    steps: int,
) -> FloatArray:
    """Magnifications to step over, those asked for among them; empty if no wall is ever felt.

    They begin where the wall is not yet felt, and share out ln G + 2 ln Y evenly.
    """
    looks = np.geomspace(1.0, zeta[-1], _LOOKS)
    G, Y = np.asarray(diffusion(looks)), _values(hardness, looks)
    if not mean_pressure < Y[0]:
        raise InvalidScene(
            f"mean_pressure is {mean_pressure:g} Pa, but must stay below the hardness at "
            f"magnification 1, {Y[0]:g} Pa"
        )
    falls = np.flatnonzero(np.diff(Y) < 0)
    if falls.size:
        raise InvalidScene(
            f"hardness falls at magnification {looks[falls[0]]:g}, but there the theory does not "
            "conserve the force: it must not decrease"
        )
    unfelt = np.flatnonzero(unfelt_diffusion(mean_pressure, float(Y[0])) >= G)[-1]
    if unfelt == looks.size - 1:
        return looks[:0]
    if G[unfelt] == 0:
        raise InvalidScene("the roughness at magnification 1 is too much for the theory to start")
    share = np.log(G[unfelt:]) + 2 * np.log(Y[unfelt:])
    even = np.interp(np.linspace(share[0], share[-1], steps + 1), share, looks[unfelt:])
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
