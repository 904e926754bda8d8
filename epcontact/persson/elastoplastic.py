"""Persson's theory in closed form: contact areas and pressure distribution at a magnification.

The stress distribution P(sigma, zeta) of a solid that flows at the hardness solves
dP/dG = d2P/dsigma2 with P = 0 at sigma = 0 and at sigma = hardness, starting from all points
at the mean pressure.  What the walls absorb is the area that has lost contact and the area
that flows; an infinite hardness gives the elastic theory.

Symbols: G = diffusion (half the variance the pressure would have in full contact, times the
reduction of elastic energy, in Pa^2), p_0 = mean_pressure, sigma_P = hardness and sigma =
pressure, in Pa.  Every function broadcasts its arguments like a numpy function, returns float64
and raises InvalidScene unless 0 < p_0 < sigma_P and 0 <= G < inf.

Accuracy there, for p_0 / sigma_P above 1e-140: each area is right to 1e-10 of itself (and
underflows to zero where the true value does), P(sigma) to 1e-12 of the larger of 1/sigma_P and
1/sqrt(4 pi G), the cumulative distribution to 1e-12 of the elastic area.

Sources: Persson, J. Chem. Phys. 115, 3840 (2001); Almqvist and Persson, "Multiscale contact
mechanics for elastoplastic contacts", equations (1), (3), (4) and (5).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erf, erfc

from epcontact.errors import InvalidScene
from epcontact.persson import series
from epcontact.results import FloatArray

_Formula = Callable[..., FloatArray]

# The spread c is clipped to a range in which its powers neither overflow nor vanish; beyond it
# nothing but the limits G -> 0 and G -> inf is left.
_NARROWEST, _WIDEST = 1e-150, 1e3


@dataclass(frozen=True)
class ContactAreas:
    """Shares of the nominal area, arrays of one shape; elastic + plastic + separated = 1."""

    elastic: FloatArray
    plastic: FloatArray
    separated: FloatArray

    @property
    def total(self) -> FloatArray:
        """The contact area: elastic and plastic."""
        return np.asarray(self.elastic + self.plastic)


def areas(
    diffusion: ArrayLike, mean_pressure: ArrayLike, hardness: ArrayLike = np.inf
) -> ContactAreas:
    """Elastic, plastic and separated area: equations (4), (5) and what is left."""
    walk = _Walk(diffusion, mean_pressure, hardness)
    return ContactAreas(
        elastic=walk.evaluate(
            series.elastic_images, series.elastic_modes, lambda s, _, c: erf(s / c)
        ),
        plastic=walk.evaluate(
            series.plastic_images, series.plastic_modes, lambda s, _r, _c: np.zeros_like(s)
        ),
        separated=walk.evaluate(
            lambda s, r, c: series.plastic_images(r, s, c),
            lambda s, r, c: series.plastic_modes(r, s, c),
            lambda s, _, c: erfc(s / c),
        ),
    )


def elastic_force(
    diffusion: ArrayLike, mean_pressure: ArrayLike, hardness: ArrayLike = np.inf
) -> FloatArray:
    """int sigma P dsigma in Pa: the share of the mean pressure that elastic contact carries.

    The plastic contact carries hardness * A_pl; together they are the mean pressure.
    """
    walk = _Walk(diffusion, mean_pressure, hardness)
    return walk.unit * walk.evaluate(series.force_images, series.force_modes, lambda s, _r, _c: s)


def pressure_density(
    pressure: ArrayLike,
    diffusion: ArrayLike,
    mean_pressure: ArrayLike,
    hardness: ArrayLike = np.inf,
) -> FloatArray:
    """P(sigma) in 1/Pa of the elastic contact: equations (1) and (3).  Needs diffusion > 0."""
    walk = _Walk(diffusion, mean_pressure, hardness, pressure)
    if np.any(walk.diffusion == 0):
        raise InvalidScene("diffusion is 0, where the pressures have no density but one value")
    values = walk.evaluate(series.density_images, series.density_modes, _elastic_density)
    return np.where(walk.inside, values, 0.0) / walk.unit


def pressure_cumulative(
    pressure: ArrayLike,
    diffusion: ArrayLike,
    mean_pressure: ArrayLike,
    hardness: ArrayLike = np.inf,
) -> FloatArray:
    """Share of the nominal area in elastic contact at pressures in (0, sigma].

    From the hardness upwards it is the elastic area.
    """
    walk = _Walk(diffusion, mean_pressure, hardness, pressure)
    values = walk.evaluate(series.cumulative_images, series.cumulative_modes, _elastic_cumulative)
    elastic = areas(diffusion, mean_pressure, hardness).elastic
    beyond = walk.pressure >= walk.hardness
    return np.where(walk.pressure <= 0, 0.0, np.where(beyond, elastic, values))


def boundary_slopes(
    diffusion: ArrayLike, mean_pressure: ArrayLike, hardness: ArrayLike = np.inf
) -> tuple[FloatArray, FloatArray]:
    """dP/dsigma in 1/Pa^2 at sigma -> 0 from above and at sigma -> hardness from below.

    They are the rates at which area leaves elastic contact: d(separated)/dG is the first,
    d(plastic)/dG minus the second.
    """
    walk = _Walk(diffusion, mean_pressure, hardness)

    def elastic(s: FloatArray, _: FloatArray, c: FloatArray) -> FloatArray:
        return np.asarray(4 * s / (np.sqrt(np.pi) * c) * np.exp(-((s / c) ** 2)) / c / c)

    at_zero = walk.evaluate(series.slope_images, series.slope_modes, elastic)
    at_hardness = -walk.evaluate(
        lambda s, r, c: series.slope_images(r, s, c),
        lambda s, r, c: series.slope_modes(r, s, c),
        lambda s, _r, _c: np.zeros_like(s),
    )
    # "+ 0.0" turns the -0.0 of an infinite hardness into 0.
    return at_zero / walk.unit / walk.unit, at_hardness / walk.unit / walk.unit + 0.0


class _Walk:
    """The arguments, broadcast, checked and in units of the hardness.

    Where the hardness is infinite the unit is the mean pressure.  `evaluate` gives a formula
    the start s, the distance r to the upper wall and the spread c (see `series`); with a
    pressure, in front of them x = sigma, 1 - x and x - s, each subtracted before it is scaled.
    """

    def __init__(
        self,
        diffusion: ArrayLike,
        mean_pressure: ArrayLike,
        hardness: ArrayLike,
        pressure: ArrayLike | None = None,
    ) -> None:
        given = [diffusion, mean_pressure, hardness] + ([] if pressure is None else [pressure])
        arrays = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in given))
        self.diffusion, p0, self.hardness = arrays[:3]
        _check(self.diffusion, p0, self.hardness)
        self.elastic = np.isinf(self.hardness)
        self.unit = np.where(self.elastic, p0, self.hardness)
        widest = np.where(self.elastic, np.inf, _WIDEST)
        spread = np.clip(2 * np.sqrt(self.diffusion) / self.unit, _NARROWEST, widest)
        self._columns = [p0 / self.unit, (self.hardness - p0) / self.unit, spread]
        if pressure is not None:
            self.pressure = arrays[3]
            if np.isnan(self.pressure).any():
                raise InvalidScene("pressure is not a number (NaN)")
            self.inside = (self.pressure > 0) & (self.pressure < self.hardness)
            sigma = np.where(self.inside, self.pressure, p0)
            distances = (sigma, self.hardness - sigma, sigma - p0)
            self._columns = [d / self.unit for d in distances] + self._columns

    def evaluate(self, images: _Formula, modes: _Formula, elastic: _Formula) -> FloatArray:
        """The value of a formula, in the regime each element belongs to."""
        c = self._columns[-1]
        values = np.empty(c.shape)
        wide = ~self.elastic & (c >= series.SWITCH)
        regimes = ((~self.elastic & ~wide, images), (wide, modes), (self.elastic, elastic))
        for chosen, formula in regimes:
            if chosen.any():
                values[chosen] = formula(*(column[chosen] for column in self._columns))
        return values


def _check(diffusion: FloatArray, mean_pressure: FloatArray, hardness: FloatArray) -> None:
    good = np.isfinite(diffusion) & (diffusion >= 0)
    if not good.all():
        raise InvalidScene(
            f"diffusion is {diffusion[~good].flat[0]!s}, but must be a finite number >= 0 in Pa^2"
        )
    good = (mean_pressure > 0) & (mean_pressure < hardness)
    if not good.all():
        raise InvalidScene(
            f"mean_pressure is {mean_pressure[~good].flat[0]!s} at a hardness of "
            f"{hardness[~good].flat[0]!s}, but must lie between 0 and the hardness, both excluded"
        )


def _elastic_density(
    x: FloatArray, _: FloatArray, above: FloatArray, s: FloatArray, _r: FloatArray, c: FloatArray
) -> FloatArray:
    fade = -np.expm1(-4 * (x / c) * (s / c))
    return np.asarray(np.exp(-((above / c) ** 2)) * fade / (np.sqrt(np.pi) * c))


def _elastic_cumulative(
    x: FloatArray, _: FloatArray, above: FloatArray, s: FloatArray, _r: FloatArray, c: FloatArray
) -> FloatArray:
    return np.asarray(erf(s / c) - series.gaussian_mass(x / c, s / c, above / c))
