"""Persson's theory in closed form: contact areas and pressure distribution at a
magnification.

The distribution P(sigma, zeta) of the stress of a solid that flows at the hardness
solves dP/dG = d2P/dsigma2 with P = 0 at sigma = 0 and at sigma = hardness.  It starts
with all points at the mean pressure.  The wall at zero absorbs the area that has lost
contact, the wall at the hardness absorbs the area that flows.  An infinite hardness
gives the elastic theory.

Symbols: G = diffusion (half the variance that the pressure would have in full contact,
times the reduction of elastic energy, in Pa^2), p_0 = mean_pressure, sigma_P =
hardness, sigma = pressure; in units of sigma_P: s = p_0, x = sigma, t = G.  Every
function broadcasts its arguments like a numpy function, returns float64 and raises
InvalidScene unless 0 < p_0 < sigma_P and 0 <= G < inf.

Accuracy, for p_0 / sigma_P above 1e-140: the relative error of each area is below 1e-10
(and the area underflows to zero where the true value does); the error of P(sigma) is
below 1e-12 of the larger of 1/sigma_P and 1/sqrt(4 pi G), that of the cumulative
distribution below 1e-12 of the elastic area.

Sources: Persson, J. Chem. Phys. 115, 3840 (2001); Almqvist and Persson, "Multiscale
contact mechanics for elastoplastic contacts", called "the paper" in this package.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from epcontact.errors import InvalidScene
from epcontact.persson import series
from epcontact.persson.series import Walk, evaluate
from epcontact.results import FloatArray
from epcontact.scene import array

# The spread c is clipped to a range in which its powers neither overflow nor vanish.
# Outside of it only the limits G -> 0 and G -> inf are left.
_NARROWEST, _WIDEST = 1e-150, 1e3


@dataclass(frozen=True)
class ContactAreas:
    """Shares of the nominal area, arrays of one shape; elastic + plastic + separated =
    1.
    """

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
    """Elastic, plastic and separated area.

    Args:
        diffusion: G in Pa^2.
        mean_pressure: p_0 in Pa.
        hardness: sigma_P in Pa; infinite for an elastic body.

    Raises:
        InvalidScene: An argument is out of range.

    Example:
        >>> found = areas(diffusion=4187.5, mean_pressure=12.5, hardness=150.0)  # GPa^2, GPa
        >>> print(f"{found.elastic:.4f} {found.plastic:.4f} {found.total:.4f}")
        0.0525 0.0572 0.1097
    """
    walk, _, _ = _scaled(diffusion, mean_pressure, hardness)
    return ContactAreas(
        _elastic_area(walk), _plastic_area(walk), _plastic_area(walk.mirrored())
    )


def _elastic_area(walk: Walk) -> FloatArray:
    """A_el = (2/pi) sum_n [1 - (-1)^n]/n sin(n pi s) e^(-n^2 pi^2 t), equation (4) of
    the paper.
    """
    return evaluate(
        walk,
        modes=lambda w: w.sum_modes(lambda n: 2 / np.pi * (1 - (-1) ** n) / n),
        images=series.elastic_images,
    )


def _plastic_area(walk: Walk) -> FloatArray:
    """A_pl = s + (2/pi) sum_n (-1)^n/n sin(n pi s) e^(-n^2 pi^2 t), equation (5) of the
    paper; that of the mirror image is the separated area.
    """
    return evaluate(
        walk, modes=lambda w: w.s + _plastic_modes(w), images=series.plastic_images
    )


def _plastic_modes(w: Walk) -> FloatArray:
    """The sum in the plastic area; the elastic force is its negative in units of the
    hardness.
    """
    return w.sum_modes(lambda n: 2 / np.pi * (-1) ** n / n)


def elastic_force(
    diffusion: ArrayLike, mean_pressure: ArrayLike, hardness: ArrayLike = np.inf
) -> FloatArray:
    """The part of the mean pressure that elastic contact carries, int sigma P dsigma,
    in Pa.
    """
    walk, unit, _ = _scaled(diffusion, mean_pressure, hardness)
    return unit * evaluate(
        walk, modes=lambda w: -_plastic_modes(w), images=series.force_images
    )


def pressure_density(
    pressure: ArrayLike,
    diffusion: ArrayLike,
    mean_pressure: ArrayLike,
    hardness: ArrayLike = np.inf,
) -> FloatArray:
    """Density P(sigma) of the elastic contact by equation (3) of the paper:

        P = 2 sum_n sin(n pi s) sin(n pi x) e^(-n^2 pi^2 t) / sigma_P

    It is in 1/Pa, and 0 outside of (0, sigma_P).  Arguments and errors are those of
    `areas`; the diffusion must be above 0.

    Example:
        >>> pressure_density([0.0, 50.0, 150.0], 4187.5, 12.5, 150.0).round(5)
        array([0.     , 0.00048, 0.     ])
    """
    walk, unit, inside = _scaled(diffusion, mean_pressure, hardness, pressure)
    if np.any(np.equal(diffusion, 0)):
        raise InvalidScene(
            "diffusion is 0, where the pressures have no density but one value"
        )
    values = evaluate(
        walk,
        modes=lambda w: np.maximum(
            w.sum_modes(lambda n: 2 * series.sine(n, w.x, w.y)), 0
        ),
        images=series.density_images,
    )
    return np.where(inside, values, 0.0) / unit


def pressure_cumulative(
    pressure: ArrayLike,
    diffusion: ArrayLike,
    mean_pressure: ArrayLike,
    hardness: ArrayLike = np.inf,
) -> FloatArray:
    """Share of the nominal area in elastic contact at pressures in (0, sigma].

    Arguments and errors are those of `areas`.

    Example:
        >>> pressure_cumulative([0.0, 75.0, 150.0], 4187.5, 12.5, 150.0).round(4)
        array([0.    , 0.0265, 0.0525])
    """
    walk, _, inside = _scaled(diffusion, mean_pressure, hardness, pressure)
    if np.isnan(pressure).any():
        raise InvalidScene("pressure is not a number (NaN)")
    values = evaluate(
        walk,
        modes=lambda w: w.sum_modes(
            lambda n: 4 / np.pi * np.sin(0.5 * n * np.pi * w.x) ** 2 / n
        ),
        images=series.cumulative_images,
    )
    flowing = ~inside & (np.asarray(pressure) > 0)
    return np.where(inside, values, np.where(flowing, _elastic_area(walk), 0.0))


def boundary_slopes(
    diffusion: ArrayLike, mean_pressure: ArrayLike, hardness: ArrayLike = np.inf
) -> tuple[FloatArray, FloatArray]:
    """dP/dsigma in 1/Pa^2 at 0 and at the hardness: d(separated)/dG and minus
    d(plastic)/dG.
    """
    walk, unit, _ = _scaled(diffusion, mean_pressure, hardness)

    def at_zero(w: Walk) -> FloatArray:
        return w.sum_modes(lambda n: 2 * np.pi * n)

    lower, upper = (
        evaluate(side, modes=at_zero, images=series.slope_images) / unit / unit
        for side in (walk, walk.mirrored())
    )
    return lower, 0.0 - upper


def _scaled(
    diffusion: ArrayLike,
    mean_pressure: ArrayLike,
    hardness: ArrayLike,
    pressure: ArrayLike | None = None,
) -> tuple[Walk, FloatArray, NDArray[np.bool_]]:
    """The checked arguments in units of the hardness (or mean pressure), that unit in
    Pa, and where the pressure is between 0 and the hardness; elsewhere the walk has the
    mean pressure.
    """
    given = {
        "diffusion": diffusion,
        "mean_pressure": mean_pressure,
        "hardness": hardness,
    }
    given |= {} if pressure is None else {"pressure": pressure}
    arrays = {name: array(name, values) for name, values in given.items()}
    try:
        G, p0, H, *rest = np.broadcast_arrays(*arrays.values())
    except ValueError:
        shapes = " and ".join(f"{name} {a.shape}" for name, a in arrays.items())
        raise InvalidScene(
            f"{shapes} do not fit: give numbers, or arrays of one shape"
        ) from None
    good = np.isfinite(G) & (G >= 0)
    if not good.all():
        raise InvalidScene(
            f"diffusion is {G[~good].flat[0]!s}, but must be a finite number >= 0 in Pa^2"
        )
    good = (p0 > 0) & (p0 < H)
    if not good.all():
        raise InvalidScene(
            f"mean_pressure is {p0[~good].flat[0]!s} at a hardness of "
            f"{H[~good].flat[0]!s}, but must lie between 0 and the hardness, both excluded"
        )
    sigma = rest[0] if rest else p0
    inside = (sigma > 0) & (sigma < H)
    sigma = np.where(inside, sigma, p0)
    elastic = np.isinf(H)
    unit = np.where(elastic, p0, H)
    spread = np.clip(
        2 * np.sqrt(G) / unit, _NARROWEST, np.where(elastic, np.inf, _WIDEST)
    )
    distances = (
        (H - p0) / unit,
        spread,
        sigma / unit,
        (H - sigma) / unit,
        (sigma - p0) / unit,
    )
    return Walk(p0 / unit, *distances, bounded=~elastic), unit, inside
