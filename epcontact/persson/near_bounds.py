"""The rule "near_bounds": a reduction S of elastic energy that depends on the pressure.

A point whose pressure is far from both bounds (zero and the hardness) has a
neighbourhood in full contact, which follows the next waves with S = 1.  A point whose
pressure is close to a bound has not.  With tau, the diffusion of full contact,

    dP/dtau = d^2(S P)/dsigma^2,   P = 0 at both bounds,
    1/S = 1 + 1/Y_0 + 1/Y_P + 1/Y_h.

Each Y is S/(1 - S) of one obstacle that is alone, and the obstacles act as resistances
in series:

    bound at zero           Y_0 = [gamma + u^2/R^2(A_non)]/(1 - gamma)
    bound at the hardness   Y_P = [gamma + v^2/R^2(A_pl)]/(1 - gamma)
    both bounds close       Y_h = c r^(-1/2) w^(12/5)
    reach of a bound        R^2(A) = rho r^(5/2) exp(kappa n(A)),   kappa = 2/3

u, v and w are sigma, sigma_P - sigma and sigma_P over sqrt(2 tau); r is the mean wave
number of the slopes over the highest; A_non and A_pl are the areas that each bound has
absorbed, and n is the standard normal quantile.  So gamma is S at a bound that is
alone; a bound reaches farther the more area it has absorbed, and the fewer wavelengths
the roughness has (r closer to 1).  Between two close bounds S depends on w alone, and P
is half a sine.  Area and load are conserved for any S, and sigma_0 -> sigma_P - sigma_0
exchanges the plastic and the separated area.

Soft bodies.  Below a hardness of about a quarter of E* xi the elastic area is that of
strips between contact at the hardness and gaps.  By Flamant's kernel the width of a
strip falls as exp(-pi E* s/(2 sigma_P)) with the slope s of the gap, and with Gaussian
slopes along the front

    A_strip = C alpha^m e^(-n^2/2) F(h),
    F(h) = int_0^inf s^3 e^(-s^2 - pi s/(2 h)) ds.

h is sigma_P/(E* xi), alpha is Nayak's parameter and n is the normal quantile of
p_0/sigma_P.  The elastic area of the diffusion equation is multiplied by (A_strip/
A_el)^w with w = 1/[1 + (h/h_0)^8], its pressures by the same factor, and the plastic
area carries the rest of the load.  C, m and h_0 are fitted.

The form of S follows measurements of S on boundary elements (`laboratory.walls`): 1 - S
falls with the distance from a bound as a Lorentz curve, and S P is a sine between two
close bounds.  `laboratory.near_bounds` fits gamma, rho and c; kappa and the three
powers were chosen beside such fits.

The equation is solved by linear elements on nodes that are dense next to the bounds,
and in steps of constant ratio of tau by Alexander's L-stable method (1977), with the
absorbed areas extrapolated.  Both are of second order.  The start is the closed form,
before a bound is felt.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dgtsv
from scipy.special import ndtri

from epcontact.persson.elastoplastic import ContactAreas, areas, pressure_density
from epcontact.persson.roughness import Roughness
from epcontact.results import FloatArray

#: gamma, rho and c of the rule.
Constants = tuple[float, float, float]
#: The values fitted to boundary elements by tests/laboratory/near_bounds.py.
CONSTANTS = (0.385, 2.27, 0.531)
#: kappa, the exponent by which a bound reaches farther the more it has absorbed.
_ABSORPTION = 2 / 3
#: Exponents of r in the reach of a bound and between close bounds, and that of w.
_REACH_EXPONENT = 5 / 2
_CLOSE_EXPONENT = 1 / 2
_WIDTH_EXPONENT = 12 / 5
#: The absorbed areas are kept from 0 and 1, where their quantiles are infinite.
_SMALLEST_ABSORBED = 1e-12
#: C, m and h_0 of the strips of soft bodies, fitted by the same laboratory, and the
#: exponent by which they take over.
STRIPS = (13.3, -0.32, 0.233)
_TAKE_OVER = 8
#: Nodes of the integral F over the slopes.
_SLOPE_NODES = 32
#: Nodes to a factor e of the distance from a bound, and steps to a factor e of tau.
#: Areas err by 3e-3 of a small elastic area of soft bodies and by 1e-4 elsewhere.
RESOLUTION = (100, 16)
#: Distance of the nearer bound from the start in standard deviations, beyond which the
#: bound is not felt: erfc(6.5 / sqrt 2) = 8e-11.
_UNFELT = 6.5
#: An elastic distribution is cut off this many standard deviations above the start.
_TAIL = 12
#: The diagonal of Alexander's method.
_DIAGONAL = 1 - math.sqrt(0.5)


@dataclass(frozen=True)
class StressState:
    """Areas along the diffusion, and the pressures at its end.

    Attributes:
        diffusion: tau in Pa^2, ascending, (n,).
        elastic: Elastic area at each tau as a fraction of the nominal area, (n,).
        plastic: Plastic area, (n,).
        separated: Area out of contact, (n,).
        pressure: Pressures in Pa from 0 to the hardness, (m,).
        density: P at these pressures in 1/Pa at the last tau, (m,).
    """

    diffusion: FloatArray
    elastic: FloatArray
    plastic: FloatArray
    separated: FloatArray
    pressure: FloatArray
    density: FloatArray

    @property
    def weights(self) -> FloatArray:
        """Weights (m,) in Pa of the trapezoidal rule over the state's m pressures."""
        width = np.diff(
            self.pressure, prepend=self.pressure[0], append=self.pressure[-1]
        )
        return np.asarray((width[1:] + width[:-1]) / 2)

    @property
    def cumulative(self) -> FloatArray:
        """Elastic area at pressures from 0 up to each of the state's m pressures, (m,).

        It is a fraction of the nominal area.
        """
        mean_density = (self.density[1:] + self.density[:-1]) / 2
        masses = mean_density * np.diff(self.pressure)
        return np.concatenate([[0.0], np.cumsum(masses)])

    @property
    def areas(self) -> ContactAreas:
        """The areas at the end of the diffusion, as fractions of the nominal area."""
        return ContactAreas(self.elastic[-1], self.plastic[-1], self.separated[-1])

    @property
    def force(self) -> float:
        """The mean pressure in Pa that elastic contact carries, at the end."""
        return float(self.weights @ (self.pressure * self.density))

    @property
    def slopes(self) -> tuple[float, float]:
        """dP/dsigma at pressure zero and at the state's last pressure, in 1/Pa^2.

        P is the density of elastic contact at the end of the diffusion.
        """
        first, last = self.density[[1, -2]] / np.diff(self.pressure)[[0, -1]]
        return float(first), float(-last)

    def areas_at(self, diffusion: FloatArray) -> ContactAreas:
        """Return the areas at diffusions of full contact, interpolated in ln tau.

        Before the first diffusion of the state all of the area is in elastic contact.

        Args:
            diffusion: tau in Pa^2, of any shape.

        Returns:
            Fractions of the nominal area, of the same shape.
        """
        nodes = np.log(self.diffusion)
        with np.errstate(divide="ignore"):
            at = np.log(diffusion)
        return ContactAreas(
            elastic=np.interp(at, nodes, self.elastic, left=1.0),
            plastic=np.interp(at, nodes, self.plastic, left=0.0),
            separated=np.interp(at, nodes, self.separated, left=0.0),
        )


def energy_reduction_at(
    pressure: FloatArray,
    hardness: float,
    spread: float,
    breadth: float,
    plastic: float,
    separated: float,
    constants: Constants = CONSTANTS,
) -> FloatArray:
    """Return the reduction S of elastic energy at pressures (n,).

    Args:
        pressure: sigma in Pa, between 0 and the hardness, (n,).
        hardness: sigma_P in Pa; infinite for an elastic body.
        spread: sqrt(2 tau) in Pa, the standard deviation of the pressure in full
            contact.
        breadth: r, the mean wave number of the slopes over the highest, in (0, 1].
        plastic: A_pl, the plastic area as a fraction of the nominal area.
        separated: A_non, the area out of contact as a fraction of the nominal area.
        constants: gamma, rho and c, without dimension.

    Returns:
        S, between 0 and 1, without dimension, (n,).
    """
    gamma, rho, c = constants

    def odds_of_bound(distance: FloatArray, absorbed: float) -> FloatArray:
        """Return Y (n,) of a bound at distances (n,) in Pa that has absorbed an area.

        The area is a fraction of the nominal area.
        """
        fraction = min(max(absorbed, _SMALLEST_ABSORBED), 1 - _SMALLEST_ABSORBED)
        level = float(ndtri(fraction))
        reach_squared = rho * breadth**_REACH_EXPONENT * math.exp(_ABSORPTION * level)
        odds = (gamma + (distance / spread) ** 2 / reach_squared) / (1 - gamma)
        return np.asarray(odds)

    resistance = 1 / odds_of_bound(pressure, separated)
    if hardness < math.inf:
        width = hardness / spread
        between = c * breadth**-_CLOSE_EXPONENT * width**_WIDTH_EXPONENT
        resistance += 1 / odds_of_bound(hardness - pressure, plastic) + 1 / between
    return np.asarray(1 / (1 + resistance))


def relative_wavenumbers(roughness: Roughness) -> tuple[FloatArray, FloatArray]:
    """Return the slope variance and the relative mean wave number of bands, (n,) each.

    The first is xi^2 of the roughness up to the end of each band.  The second is r, the
    mean wave number of these slopes over the wave number at the band's end.  Bands
    without slopes are left out.

    Args:
        roughness: The bands of the surface.
    """
    filled = roughness.slope_variance > 0
    added = roughness.slope_variance[filled]
    edge = roughness.upper_edge[filled]
    wavenumber = np.minimum(added / roughness.first_moment[filled], edge)
    variance = np.cumsum(added)
    return variance, np.cumsum(wavenumber * added) / variance / edge


def nayak_along(roughness: Roughness) -> FloatArray:
    """Return Nayak's parameter m0 m4/m2^2 of the roughness up to each band, (n,).

    Bands without slopes are left out.

    Args:
        roughness: The bands of the surface.
    """
    filled = roughness.slope_variance > 0
    m2 = roughness.slope_variance[filled]
    m0 = roughness.height_variance[filled]
    m4 = m2**2 / m0
    return np.asarray(np.cumsum(m0) * np.cumsum(m4) / np.cumsum(m2) ** 2)


def strip_area(
    relative_hardness: FloatArray,
    nayak: FloatArray,
    load_fraction: float,
    strips: tuple[float, float, float] = STRIPS,
) -> FloatArray:
    """Return the elastic area of strips along the fronts of soft bodies, (n,).

    It is a fraction of the nominal area.

    Args:
        relative_hardness: h, the hardness over E* xi, (n,).
        nayak: Nayak's parameter, (n,).
        load_fraction: p_0 over the hardness.
        strips: C, m and h_0; the last is not used.
    """
    C, m, _ = strips
    level = float(ndtri(load_fraction))
    nodes, weights = _laguerre()
    decay = math.pi / (2 * relative_hardness)
    # With x = (decay + 2) s the exponent is bounded.
    slope = nodes / (decay[:, None] + 2)
    integral = slope**3 * np.exp(2 * slope - slope**2) @ weights / (decay + 2)
    return np.asarray(C * nayak**m * math.exp(-(level**2) / 2) * integral)


@functools.cache
def _laguerre() -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights of the Gauss-Laguerre rule, (_SLOPE_NODES,) each."""
    nodes, weights = np.polynomial.laguerre.laggauss(_SLOPE_NODES)
    return nodes, weights


def with_strips(
    state: StressState,
    nayak: FloatArray,
    mean_pressure: float,
    hardness: float,
    strips: tuple[float, float, float] = STRIPS,
) -> StressState:
    """Return a stress whose elastic area is that of strips where the body is soft.

    The factor of the elastic area multiplies its pressures.  The plastic area carries
    the rest of the load, and the exchange of plastic and separated area stays exact.

    Args:
        state: The stress by the diffusion equation, of a body with a hardness.
        nayak: Nayak's parameter at each diffusion of the state, (n,).
        mean_pressure: p_0 in Pa.
        hardness: sigma_P in Pa.
        strips: C, m and h_0, see this module.
    """
    relative_hardness = hardness / np.sqrt(8 * state.diffusion)  # over E* xi
    of_strips = strip_area(relative_hardness, nayak, mean_pressure / hardness, strips)
    weight = 1 / (1 + (relative_hardness / strips[2]) ** _TAKE_OVER)
    factor = (of_strips / state.elastic) ** weight
    elastic = factor * state.elastic
    elastic_load = factor * (mean_pressure - hardness * state.plastic)
    plastic = (mean_pressure - elastic_load) / hardness
    return replace(
        state,
        elastic=elastic,
        plastic=plastic,
        separated=1 - elastic - plastic,
        density=factor[-1] * state.density,
    )


def integrate(
    diffusion: FloatArray,
    breadth: FloatArray,
    mean_pressure: float,
    hardness: float = math.inf,
    constants: Constants = CONSTANTS,
    resolution: tuple[int, int] = RESOLUTION,
) -> StressState:
    """Solve the diffusion equation of the rule "near_bounds" along the diffusion tau.

    Args:
        diffusion: tau of full contact in Pa^2, ascending, (n,); the last is the end.
        breadth: r at each tau, (n,): mean wave number of the slopes over the highest.
        mean_pressure: p_0 in Pa.
        hardness: sigma_P in Pa; infinite for an elastic body.
        constants: gamma, rho and c of the rule, without dimension.
        resolution: Nodes to a factor e of the distance from a bound, and steps to a
            factor e of tau.

    Returns:
        The areas along tau, and the pressures at its end.
    """
    nodes_per_e_fold, steps_per_e_fold = resolution
    nearer_bound = min(mean_pressure, hardness - mean_pressure)
    start = (nearer_bound / _UNFELT) ** 2 / 2
    end = diffusion[-1]
    top = min(hardness, mean_pressure + _TAIL * math.sqrt(2 * end))
    x = _nodes(mean_pressure, top, nodes_per_e_fold)
    density = pressure_density(x, min(start, end), mean_pressure, hardness)
    if end <= start:
        unfelt = areas(diffusion, mean_pressure, hardness)
        return StressState(
            diffusion, unfelt.elastic, unfelt.plastic, unfelt.separated, x, density
        )
    steps = math.ceil(math.log(end / start) * steps_per_e_fold)
    t = np.geomspace(start, end, steps + 1)
    r = np.exp(np.interp(np.log(t), np.log(diffusion), np.log(breadth)))
    dx = np.diff(x)
    inner = x[1:-1]
    width = (dx[1:] + dx[:-1]) / 2
    P = _with_exact_moments(density[1:-1], inner - mean_pressure, width)
    to_right = 1 / dx[1:] / width
    to_left = 1 / dx[:-1] / width
    # Rates at which the state flows into the plastic and the separated area, which are
    # its first two components.
    into_plastic = 1 / dx[-1] if hardness < math.inf else 0.0
    outflow = np.array([into_plastic, 1 / dx[0]])

    def solve_stage(
        known: FloatArray, step: int, fraction: float, absorbed: FloatArray
    ) -> FloatArray:
        """Return the state after a stage: U with U = known + h dU/dt.

        h is the size of the stage, the diagonal of the method times that of the step.

        Args:
            known: Plastic area, separated area, and densities in 1/Pa at the inner
                nodes.
            step: Number of the step.
            fraction: Of the step at which the reduction S is taken.
            absorbed: Plastic and separated area there, as fractions of the nominal
                area, (2,).
        """
        h = _DIAGONAL * (t[step + 1] - t[step])
        tau = t[step] + fraction * (t[step + 1] - t[step])
        breadth_there = r[step] + fraction * (r[step + 1] - r[step])
        plastic, separated = absorbed
        S = energy_reduction_at(
            inner,
            hardness,
            math.sqrt(2 * tau),
            breadth_there,
            plastic,
            separated,
            constants,
        )
        above = -h * (to_right[:-1] * S[1:])
        diagonal = 1 + h * (to_right + to_left) * S
        below = -h * (to_left[1:] * S[:-1])
        # `scipy.linalg.solve_banded` calls the same function and takes twice the time.
        *_, new, _ = dgtsv(below, diagonal, above, known[2:])
        areas_after = known[:2] + h * outflow * (S * new)[[-1, 0]]
        return np.concatenate([areas_after, new])

    state = np.concatenate([[0.0, 0.0], P])
    change = np.zeros(2)  # of the absorbed areas in the step before, for each Pa^2
    history = [(0.0, 0.0, 1.0)]
    for step, step_size in enumerate(np.diff(t)):
        before = state[:2]
        expected = before + _DIAGONAL * step_size * change
        middle = solve_stage(state, step, _DIAGONAL, expected)
        known = state + (1 - _DIAGONAL) / _DIAGONAL * (middle - state)
        state = solve_stage(known, step, 1.0, before + step_size * change)
        change = (state[:2] - before) / step_size
        history.append((state[0], state[1], float(state[2:] @ width)))
    plastic, separated, elastic = np.array(history).T
    density = np.concatenate([[0.0], state[2:], [0.0]])
    return StressState(t, elastic, plastic, separated, x, density)


def _with_exact_moments(
    density: FloatArray, distance: FloatArray, width: FloatArray
) -> FloatArray:
    """Return the sampled start (n,) with the area 1 and the mean pressure p_0.

    Args:
        density: P in 1/Pa at the inner nodes, (n,).
        distance: Pressure less p_0 at the nodes in Pa, (n,).
        width: Width of each node's cell in Pa, (n,).
    """
    P = density / (density @ width)
    first = P * width @ distance
    second = P * width @ distance**2
    return np.asarray(P * (1 - first / (second - first**2) * (distance - first)))


def _nodes(mean_pressure: float, top: float, nodes_per_e_fold: int) -> FloatArray:
    """Return ascending pressures in Pa from 0 to `top`, dense next to both ends.

    The spacing next to an end is that next to the mean pressure times the ratio of the
    distances from the end.

    Args:
        mean_pressure: In Pa.
        top: Largest pressure in Pa, above the mean pressure.
        nodes_per_e_fold: Number of nodes to a factor e of the distance from an end.
    """
    below = mean_pressure
    above = top - mean_pressure
    first = math.log(below / (top + above))
    last = math.log((top + below) / above)
    count = math.ceil((last - first) * nodes_per_e_fold)
    e = np.exp(np.linspace(first, last, count + 1))
    x = ((top + above) * e - below) / (1 + e)
    x[[0, -1]] = 0.0, top
    return np.asarray(x)
