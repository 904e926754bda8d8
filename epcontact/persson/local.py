"""The rule "local": a reduction S of elastic energy that depends on the pressure.

A point whose pressure is far from both walls has a neighbourhood in full contact, which
takes up the next waves with S = 1; next to a wall it does not.  With tau, the diffusion
of full contact,

    dP/dtau = d^2(S P)/dsigma^2,   P = 0 at both walls,   S = 1 - (1 - A_el)^(1/4) (1 - x^p),
    x^-8 = r^3 [(g + b u)^-8 + (g + b v)^-8 + (c w)^-8],   g = gamma^(1/p),   p = 8/5,

where u, v and w are sigma, sigma_P - sigma and sigma_P over sqrt(2 tau), r is the mean
wave number of the slopes over the highest, and x^p is at most 2.  So gamma is S at a
wall that is alone, where hardly any contact is left and all waves have one length (r =
1).  Area and load are kept for any S, and sigma_0 -> sigma_P - sigma_0 swaps plastic
and separated area.  The form follows the study `walls`; `laboratory.local_reduction`
fits gamma, b and c to boundary elements.

The equation is solved by linear elements on nodes that are dense next to the walls,
where they grow with the pressure, and in steps of constant ratio of tau by Alexander's
L-stable method (1977), with A_el extrapolated; both are of second order.  The start is
the closed form, before a wall is felt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded

from epcontact.persson.elastoplastic import ContactAreas, areas, pressure_density
from epcontact.persson.roughness import Roughness
from epcontact.results import FloatArray

Constants = tuple[float, float, float]
#: gamma, b and c of the rule, from tests/laboratory/local_reduction.py.
CONSTANTS = (0.168, 0.288, 0.340)
_POWER, _SHARE, _BREADTH, _SHARPNESS, _MOST = 8 / 5, 1 / 4, 3 / 8, 8, 2.0
#: Nodes to a factor e of the distance from a wall, and steps to a factor e of tau.
RESOLUTION = (50, 8)
#: The nearer wall is so many standard deviations from the start: erfc(6.5 / sqrt 2) =
#: 8e-11.
_UNFELT = 6.5
#: The diagonal of Alexander's method.
_GAMMA = 1 - math.sqrt(0.5)


@dataclass(frozen=True)
class LocalState:
    """Areas (n,) along tau (n,) in Pa^2; density (m,) in 1/Pa at pressures in Pa at its
    end.
    """

    diffusion: FloatArray
    elastic: FloatArray
    plastic: FloatArray
    separated: FloatArray
    pressure: FloatArray
    density: FloatArray

    @property
    def weights(self) -> FloatArray:
        """The integral of a function over the pressures is the sum of its values times
        these.
        """
        dx = np.diff(self.pressure, prepend=self.pressure[0], append=self.pressure[-1])
        return np.asarray((dx[1:] + dx[:-1]) / 2)

    @property
    def cumulative(self) -> FloatArray:
        """The elastic area up to the pressures (m,)."""
        parts = (self.density[1:] + self.density[:-1]) / 2 * np.diff(self.pressure)
        return np.concatenate([[0.0], np.cumsum(parts)])

    @property
    def areas(self) -> ContactAreas:
        """Those at the end."""
        return ContactAreas(self.elastic[-1], self.plastic[-1], self.separated[-1])

    @property
    def force(self) -> float:
        """The part of the mean pressure that elastic contact carries, in Pa."""
        return float(self.weights @ (self.pressure * self.density))

    @property
    def slopes(self) -> tuple[float, float]:
        """dP/dsigma in 1/Pa^2 at zero and at the last pressure."""
        first, last = self.density[[1, -2]] / np.diff(self.pressure)[[0, -1]]
        return float(first), float(-last)

    def at(self, diffusion: FloatArray) -> ContactAreas:
        """The areas at a tau of any shape, interpolated; before the start nothing is
        lost.
        """
        known = np.log(self.diffusion)
        with np.errstate(divide="ignore"):
            wanted = np.log(diffusion)
        curves = ((self.elastic, 1.0), (self.plastic, 0.0), (self.separated, 0.0))
        return ContactAreas(
            *(np.interp(wanted, known, curve, left=v) for curve, v in curves)
        )


def local_reduction(
    pressure: FloatArray,
    hardness: float,
    spread: float,
    breadth: float,
    elastic: float,
    constants: Constants = CONSTANTS,
) -> FloatArray:
    """S at pressures (n,); spread: sqrt(2 tau) in Pa; breadth: r; elastic: A_el."""
    gamma, b, c = constants
    wall = gamma ** (1 / _POWER)
    distances = wall + b / spread * pressure, wall + b / spread * (hardness - pressure)
    inverse = (c * hardness / spread) ** -_SHARPNESS + sum(
        d**-_SHARPNESS for d in distances
    )
    power = (breadth**_BREADTH * inverse ** (1 / _SHARPNESS)) ** -_POWER
    lost = max(1 - elastic, 0.0) ** _SHARE
    return np.asarray(1 - lost * (1 - np.minimum(power, _MOST)))


def breadths(roughness: Roughness) -> tuple[FloatArray, FloatArray]:
    """xi^2 (n,) up to the end of each band with slopes, and r, its mean wave number
    over it.
    """
    filled = roughness.slope_variance > 0
    added, edge = roughness.slope_variance[filled], roughness.upper_edge[filled]
    wavenumber = np.minimum(added / roughness.first_moment[filled], edge)
    variance = np.cumsum(added)
    return variance, np.cumsum(wavenumber * added) / variance / edge


def march(
    diffusion: FloatArray,
    breadth: FloatArray,
    mean_pressure: float,
    hardness: float = math.inf,
    constants: Constants = CONSTANTS,
    resolution: tuple[int, int] = RESOLUTION,
) -> LocalState:
    """Solve the equation along tau (n,) in Pa^2, ascending, with the breadth r (n,)
    there.
    """
    start, end = (
        (min(mean_pressure, hardness - mean_pressure) / _UNFELT) ** 2 / 2,
        diffusion[-1],
    )
    x = _nodes(
        mean_pressure,
        min(hardness, mean_pressure + 12 * math.sqrt(2 * end)),
        resolution[0],
    )
    density = pressure_density(x, min(start, end), mean_pressure, hardness)
    if end <= start:
        unfelt = areas(diffusion, mean_pressure, hardness)
        parts = unfelt.elastic, unfelt.plastic, unfelt.separated
        return LocalState(diffusion, *parts, x, density)
    steps = math.ceil(math.log(end / start) * resolution[1])
    t = np.geomspace(start, end, steps + 1)
    r = np.exp(np.interp(np.log(t), np.log(diffusion), np.log(breadth)))
    dx, inner = np.diff(x), x[1:-1]
    width = (dx[1:] + dx[:-1]) / 2
    # The sampled start gets the exact area and load.
    P, away = density[1:-1] / (density[1:-1] @ width), inner - mean_pressure
    first, second = (P * width @ away**n for n in (1, 2))
    P = P * (1 - first / (second - first**2) * (away - first))
    up, down = 1 / dx[1:] / width, 1 / dx[:-1] / width
    # The flows into the plastic and the separated area, which the state has in front of
    # P.
    out = np.array([1 / dx[-1] if hardness < math.inf else 0.0, 1 / dx[0]])

    def stage(
        known: FloatArray, k: int, part: float, h: float, elastic: float
    ) -> FloatArray:
        """The state U = known + h dU/dt, with S at a part of the step k."""
        spread = math.sqrt(2 * (t[k] + part * (t[k + 1] - t[k])))
        r_there = r[k] + part * (r[k + 1] - r[k])
        S = local_reduction(inner, hardness, spread, r_there, elastic, constants)
        bands = np.zeros((3, S.size))
        bands[1] = 1 + h * (up + down) * S
        bands[0, 1:], bands[2, :-1] = -h * (up[:-1] * S[1:]), -h * (down[1:] * S[:-1])
        new = solve_banded((1, 1), bands, known[2:], check_finite=False)
        return np.concatenate([known[:2] + h * out * (S * new)[[-1, 0]], new])

    state, found, change = np.concatenate([[0.0, 0.0], P]), [(0.0, 0.0, 1.0)], 0.0
    for k, step in enumerate(np.diff(t)):
        held, h = found[-1][2], _GAMMA * step
        middle = stage(state, k, _GAMMA, h, held + change * h)
        state = state + (1 - _GAMMA) / _GAMMA * (middle - state)
        state = stage(state, k, 1.0, h, held + change * step)
        found.append((state[0], state[1], float(state[2:] @ width)))
        change = (found[-1][2] - held) / step
    plastic, separated, elastic = np.array(found).T
    return LocalState(
        t, elastic, plastic, separated, x, np.concatenate([[0.0], state[2:], [0.0]])
    )


def _nodes(mean_pressure: float, top: float, nodes_per_e_fold: int) -> FloatArray:
    """Pressures from 0 to the top, whose spacing near both ends grows from that of the
    start.
    """
    below, above = mean_pressure, top - mean_pressure
    ends = math.log(below / (top + above)), math.log((top + below) / above)
    count = math.ceil((ends[1] - ends[0]) * nodes_per_e_fold)
    e = np.exp(np.linspace(*ends, count + 1))
    x = ((top + above) * e - below) / (1 + e)
    x[[0, -1]] = 0.0, top
    return np.asarray(x)
