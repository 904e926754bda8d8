"""Mean gap, plastic displacement and elastic energy by a clipped random pressure.

Potential.  The contact pressure minimises J = <p, S p>/2 - <p, h> over 0 <= p <=
sigma_P with the mean p_0, where S takes p of wave number q to 2 p/(E* q).  Its minimum
Phi, by nominal area, is a function of p_0 and p_1 = sigma_P - p_0, and

    mean gap = -dPhi/dp_0 at constant p_1,
    mean plastic displacement = -dPhi/dp_1 at constant p_0,
    U_el = -Phi - p_0 (mean gap) - p_1 (mean plastic displacement).

For Gaussian heights Phi is symmetric: p -> sigma_P - p and h -> -h exchange gap and
plastic displacement.

Trial pressures.  p = clip(m + y, 0, sigma_P) with the field y_q = a(q) h_q.  By
Mehler's formula, with the Hermite coefficients c_k of the clipped pressure, the
correlation rho(r) of y and f, the fraction of the area with 0 < p < sigma_P,

    J = (1/E*) [c_1^2 I_1 + (1 - eps) sum_k c_k^2 I_k] - f <y h>,   k >= 2,
    I_k = int_0^inf rho(r)^k dr.

m follows from p_0, and a(q), five numbers over ln q, minimises J.  With eps = 0 this is
a bound of Phi without constants.  It is exact in full contact, for rigid-plastic bodies
(gap = h_rms [n Phi(n) + phi(n)], n the normal quantile of the area out of contact) and
to the first order in the hardness.  The contact of a real surface stores less energy
than that of a Gaussian field, because the field cannot follow single asperities.
eps = .24 reduces what clipping adds to the energy; it is the only fitted constant, see
`laboratory.near_bounds`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.special import j1, ndtr

from epcontact.persson.elastoplastic import areas
from epcontact.persson.roughness import Roughness
from epcontact.persson.theory import Theory
from epcontact.results import FloatArray

#: eps, the fraction of the energy of the clipped harmonics that single asperities save.
SAVED_ENERGY = 0.24
#: Knots of ln a(q) over ln q.
_KNOTS = 5
#: Hermite coefficients of the clipped pressure.
_HARMONICS = 60
#: Least ratio of the wave numbers at the ends of a band.
_BAND_RATIO = 1.04
#: Number of lags, and the least lag times the highest wave number and the largest times
#: the lowest.
_LAGS = 200
_LEAST_LAG = 0.02
_LARGEST_LAG = 60.0
#: Standard deviations of y within which the mean m of y + m is sought.
_FARTHEST_MEAN = 40.0
#: Largest |ln| of a(q) over that of full contact.  In rigid-plastic contact a(q) is
#: infinite, and from this value on the clipped pressure is a step.
_LARGEST_LOGARITHM = 8.0
#: The gradient of J over p_0 h_rms at which the minimum is accepted.
_GRADIENT = 1e-5


class Displacements(NamedTuple):
    """Mean gap and plastic displacement in m, and elastic energy in J/m^2.

    Attributes:
        mean_gap: Mean of the open gap over the nominal area.
        plastic_displacement: Mean of the plastic displacement over the nominal area.
        elastic_energy: By nominal area.
    """

    mean_gap: float
    plastic_displacement: float
    elastic_energy: float


def displacements(
    theory: Theory, mean_pressure: float, saved_energy: float = SAVED_ENERGY
) -> Displacements:
    """Return mean gap, mean plastic displacement and elastic energy of a rough body.

    They depend on roughness, modulus and hardness, and not on the theory's reduction.

    Args:
        theory: The body.
        mean_pressure: p_0 in Pa.
        saved_energy: eps, the dimensionless constant of this module's formula.

    Raises:
        InvalidScene: The pressure is not between 0 and the hardness.
    """
    areas(0.0, mean_pressure, theory.hardness)  # checks the pressure
    if theory.roughness.rms_slope == 0:
        return Displacements(0.0, 0.0, 0.0)
    modulus = theory.effective_modulus
    field = _Field(theory.roughness, saved_energy)
    hardness = theory.hardness / modulus
    load = mean_pressure / modulus
    # Exchanging plastic and separated area leaves the trial pressures in the half that
    # is out of contact for the most part.
    p0 = min(load, hardness - load)
    scale = p0 * field.rms_height

    def scaled(x: FloatArray) -> tuple[float, FloatArray]:
        """Return J over p_0 h_rms at parameters x (_KNOTS,), and its gradient."""
        found = field.evaluate(x, p0, hardness)
        return found.potential / scale, found.gradient / scale

    best = minimize(
        scaled,
        np.zeros(_KNOTS),
        jac=True,
        method="L-BFGS-B",
        bounds=[(-_LARGEST_LOGARITHM, _LARGEST_LOGARITHM)] * _KNOTS,
        options={"gtol": _GRADIENT, "ftol": _GRADIENT**2},
    )
    found = field.evaluate(best.x, p0, hardness)
    # The approximate potential may grow with the hardness by rounding, or where hardly
    # any of the contact flows.
    gap = max(-found.by_load - found.by_hardness, 0.0)
    plastic = max(-found.by_hardness, 0.0)
    if p0 < load:
        gap, plastic = plastic, gap
    return Displacements(
        mean_gap=gap / field.unit,
        plastic_displacement=plastic / field.unit,
        elastic_energy=found.energy * modulus / field.unit,
    )


class _Evaluation(NamedTuple):
    """J of a trial pressure and its derivatives, in the units of `_Field`.

    Attributes:
        potential: J.
        energy: The elastic part of J.
        gradient: Derivatives of J by the parameters of a(q) at constant p_0, (_KNOTS,).
        by_load: Derivative of J by p_0 at constant hardness.
        by_hardness: Derivative of J by the hardness at constant p_0; 0 for an elastic
            body.
    """

    potential: float
    energy: float
    gradient: FloatArray
    by_load: float
    by_hardness: float


class _Field:
    """Gaussian fields y_q = a(q) h_q of a roughness, and their clipped pressures.

    Pressures are in units of E*, lengths in units of 1/q_0.

    Attributes:
        unit: q_0 in rad/m.
        rms_height: Times q_0.
    """

    def __init__(self, roughness: Roughness, saved_energy: float) -> None:
        """Prepare the bands and the correlation of each band.

        Args:
            roughness: With slopes.
            saved_energy: eps.
        """
        self.unit = roughness.lowest
        lower, upper, slopes, heights = _merged_bands(roughness)
        self._wavenumber = np.sqrt(slopes / heights)
        self._height_variance = heights
        self.rms_height = math.sqrt(self._height_variance.sum())
        lags = np.geomspace(_LEAST_LAG / upper[-1], _LARGEST_LAG, _LAGS)
        lags = np.concatenate([[0.0], lags])
        # The mean of J_0(q r) over the area of a band between two wave numbers.
        r = lags[1:]
        rings = upper[:, None] * j1(upper[:, None] * r)
        rings -= lower[:, None] * j1(lower[:, None] * r)
        area = (upper**2 - lower**2)[:, None]
        self._correlation = np.ones((lower.size, lags.size))
        self._correlation[:, 1:] = 2 * rings / (r * area)
        width = np.diff(lags, prepend=0.0, append=lags[-1])
        self._weights = (width[1:] + width[:-1]) / 2
        position = np.log(self._wavenumber / lower[0]) / math.log(upper[-1] / lower[0])
        knots = np.linspace(0, 1, _KNOTS)
        hats = [np.interp(position, knots, hat) for hat in np.eye(_KNOTS)]
        self._hats = np.array(hats)
        self._stored = np.full(_HARMONICS, 1 - saved_energy)
        self._stored[0] = 1.0

    def evaluate(self, x: FloatArray, p0: float, hardness: float) -> _Evaluation:
        """Return J and its derivatives for a trial pressure.

        Args:
            x: Parameters of ln a(q), relative to full contact, (_KNOTS,).
            p0: Mean pressure over E*.
            hardness: sigma_P over E*; infinite for an elastic body.
        """
        q = self._wavenumber
        amplitude = q / 2 * np.exp(x @ self._hats)
        variance = amplitude**2 * self._height_variance  # of y in each band
        overlap = amplitude * self._height_variance
        s = math.sqrt(variance.sum())
        correlation = variance @ self._correlation / s**2
        order = np.arange(1, _HARMONICS + 1)
        powers = np.cumprod(
            np.broadcast_to(correlation, (_HARMONICS, correlation.size)), 0
        )
        integrals = powers @ self._weights  # I_k
        integrals[0] = variance @ (1 / q) / s**2

        clip = _Clip.of_mean(p0, hardness, s)
        c = clip.coefficients
        weight = self._stored * integrals
        stored = c**2 * self._stored
        energy = float(c**2 @ weight)
        potential = energy - clip.elastic_area * overlap.sum()

        def derivative(of_coefficients: FloatArray, of_area: float) -> float:
            """Return dJ/dz from dc_k/dz (_HARMONICS,) and df/dz."""
            return float(2 * c * weight @ of_coefficients - of_area * overlap.sum())

        by_mean = derivative(clip.coefficients_by_mean, clip.area_by_mean)
        by_load = by_mean / clip.elastic_area
        by_spread = derivative(clip.coefficients_by_spread, clip.area_by_spread)
        by_spread -= by_load * clip.load_by_spread
        by_hardness = 0.0
        if hardness < math.inf:
            by_hardness = derivative(
                clip.coefficients_by_hardness, clip.area_by_hardness
            )
            by_hardness -= by_load * clip.load_by_hardness
        # Derivatives of s and of the integrals by the variance of each band.
        of_powers = (order * stored)[1:] @ powers[:-1] * self._weights
        of_band = self._correlation @ of_powers - of_powers @ correlation
        of_band += stored[0] * (1 / q - integrals[0])
        by_variance = by_spread / (2 * s) + of_band / s**2
        by_logarithm = 2 * variance * by_variance - clip.elastic_area * overlap
        gradient = self._hats @ by_logarithm
        return _Evaluation(potential, energy, gradient, by_load, by_hardness)


class _Clip(NamedTuple):
    """The clipped pressure p = clip(m + s x, 0, hardness) of a standard normal x.

    The k-th coefficient is the mean of p He_k(x)/sqrt(k!), for k from 1 on.

    Attributes:
        elastic_area: Fraction f of the area with 0 < p < hardness.
        coefficients: c_k, (_HARMONICS,).
        coefficients_by_mean: dc_k/dm, (_HARMONICS,).
        area_by_mean: df/dm.
        coefficients_by_spread: dc_k/ds, (_HARMONICS,).
        area_by_spread: df/ds.
        load_by_spread: Derivative of the mean of p by s.
        coefficients_by_hardness: Derivatives of c_k by the hardness, (_HARMONICS,).
        area_by_hardness: Derivative of f by the hardness.
        load_by_hardness: Derivative of the mean of p by the hardness.
    """

    elastic_area: float
    coefficients: FloatArray
    coefficients_by_mean: FloatArray
    area_by_mean: float
    coefficients_by_spread: FloatArray
    area_by_spread: float
    load_by_spread: float
    coefficients_by_hardness: FloatArray
    area_by_hardness: float
    load_by_hardness: float

    @classmethod
    def of_mean(cls, p0: float, hardness: float, spread: float) -> _Clip:
        """Return the clipped pressure of mean p_0.

        Args:
            p0: Mean of p.
            hardness: Its upper bound, infinite or larger than p0.
            spread: s, the standard deviation of the unclipped field.
        """

        def load_beyond(m: float) -> float:
            """Return the mean of the pressure clipped from m + s x, less p_0."""
            mean = m * ndtr(m / spread) + spread * _normal(m / spread)
            if hardness < math.inf:
                above = m - hardness
                mean -= above * ndtr(above / spread) + spread * _normal(above / spread)
            return float(mean - p0)

        lowest = -_FARTHEST_MEAN * spread
        highest = p0 if math.isinf(hardness) else hardness - lowest
        m = brentq(load_beyond, lowest, highest, xtol=1e-14 * spread)
        at_zero = _hermite_functions(-m / spread)
        at_hardness = np.zeros_like(at_zero)
        plastic = 0.0
        if hardness < math.inf:
            at_hardness = _hermite_functions((hardness - m) / spread)
            plastic = float(ndtr((m - hardness) / spread))
        root = np.sqrt(np.arange(1, at_zero.size + 1))
        inside = np.empty(at_zero.size + 1)  # means of He_k/sqrt(k!) where 0 < p < H
        inside[0] = ndtr(m / spread) - plastic
        inside[1:] = (at_zero - at_hardness) / root
        n = _HARMONICS
        by_spread = root[1 : n + 1] * inside[2 : n + 2] + root[:n] * inside[:n]
        return cls(
            elastic_area=float(inside[0]),
            coefficients=spread * inside[:n] / root[:n],
            coefficients_by_mean=inside[1 : n + 1],
            area_by_mean=float(inside[1] / spread),
            coefficients_by_spread=by_spread,
            area_by_spread=float(root[1] * inside[2] / spread),
            load_by_spread=float(inside[1]),
            coefficients_by_hardness=at_hardness[:n] / root[:n],
            area_by_hardness=float(at_hardness[0] / spread),
            load_by_hardness=plastic,
        )


def _normal(x: float) -> float:
    """Return the standard normal density at x."""
    return math.exp(-x * x / 2) / math.sqrt(2 * math.pi)


def _hermite_functions(x: float) -> FloatArray:
    """Return He_k(x)/sqrt(k!) times the normal density, k = 0 to _HARMONICS + 1."""
    values = np.zeros(_HARMONICS + 2)
    values[0] = _normal(x)
    values[1] = x * values[0]
    for k in range(2, values.size):
        last = x * values[k - 1] - math.sqrt(k - 1) * values[k - 2]
        values[k] = last / math.sqrt(k)
    return values


def _merged_bands(
    roughness: Roughness,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the bands of a roughness with neighbours of nearly equal q merged.

    Bands without slopes are left out.

    Args:
        roughness: With slopes.

    Returns:
        Lower and upper edges over q_0, slope variance, and height variance times q_0^2,
        (n,) each.
    """
    upper = roughness.upper_edge / roughness.lowest
    lower = np.concatenate([[1.0], upper[:-1]])
    filled = roughness.slope_variance > 0
    lower = lower[filled]
    upper = upper[filled]
    starts = [0]
    for band in range(1, lower.size):
        if upper[band] > _BAND_RATIO * lower[starts[-1]]:
            starts.append(band)
    ends = np.append(starts[1:], lower.size) - 1
    slopes = np.add.reduceat(roughness.slope_variance[filled], starts)
    heights = np.add.reduceat(roughness.height_variance[filled], starts)
    return lower[starts], upper[ends], slopes, heights * roughness.lowest**2
