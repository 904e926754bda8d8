"""Persson's theory in closed form: contact areas and pressures at one magnification.

The distribution P(sigma, zeta) of the stress of a solid that flows at the hardness
solves dP/dG = d2P/dsigma2 with P = 0 at sigma = 0 and at sigma = hardness.  It starts
with all points at the mean pressure.  The bound at zero absorbs the area that has lost
contact, and the bound at the hardness absorbs the area that flows.  An infinite
hardness gives the elastic theory.

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
from epcontact.persson.series import Diffusion, evaluate
from epcontact.results import FloatArray
from epcontact.scene import array

#: The spread is clipped to this range, in which its powers neither overflow nor vanish.
#: Outside of it only the limits G -> 0 and G -> inf are left.
_NARROWEST = 1e-150
_WIDEST = 1e3


@dataclass(frozen=True)
class ContactAreas:
    """Fractions of the nominal area, arrays of one shape that add up to 1.

    Attributes:
        elastic: In contact at pressures below the hardness.
        plastic: In contact at the hardness.
        separated: Out of contact.
    """

    elastic: FloatArray
    plastic: FloatArray
    separated: FloatArray

    @property
    def total(self) -> FloatArray:
        """The contact area as a fraction of the nominal area: elastic and plastic."""
        return np.asarray(self.elastic + self.plastic)


def areas(
    diffusion: ArrayLike, mean_pressure: ArrayLike, hardness: ArrayLike = np.inf
) -> ContactAreas:
    """Return the elastic, plastic and separated area, as fractions of the nominal area.

    The arguments are numbers or arrays of shapes that broadcast; the areas have the
    common shape.

    Args:
        diffusion: G in Pa^2, half the variance of the pressure in full contact times
            the reduction of elastic energy.
        mean_pressure: p_0 in Pa.
        hardness: sigma_P in Pa; infinite for an elastic body.

    Raises:
        InvalidScene: An argument is out of range: 0 <= G < inf, 0 < p_0 < sigma_P.

    Example:
        >>> found = areas(4187.5, mean_pressure=12.5, hardness=150.0)  # GPa^2, GPa
        >>> print(f"{found.elastic:.4f} {found.plastic:.4f} {found.total:.4f}")
        0.0525 0.0572 0.1097
    """
    w, _, _ = _scaled(diffusion, mean_pressure, hardness)
    return ContactAreas(
        elastic=_elastic_area(w),
        plastic=_plastic_area(w),
        separated=_plastic_area(w.mirrored()),
    )


def _elastic_area(w: Diffusion) -> FloatArray:
    """Return the elastic area as a fraction, by equation (4) of the paper:

        A_el = (2/pi) sum_n [1 - (-1)^n]/n sin(n pi s) e^(-n^2 pi^2 t)

    Args:
        w: Start s and spread of the stress in units of the hardness, arrays of one
            shape.
    """

    def weight(n: FloatArray) -> FloatArray:
        """Return (2/pi) [1 - (-1)^n]/n for mode numbers n of any shape."""
        return 2 / np.pi * (1 - (-1) ** n) / n

    return evaluate(
        w, modes=lambda w: w.sum_modes(weight), images=series.elastic_images
    )


def _plastic_area(w: Diffusion) -> FloatArray:
    """Return the plastic area as a fraction, by equation (5) of the paper:

        A_pl = s + (2/pi) sum_n (-1)^n/n sin(n pi s) e^(-n^2 pi^2 t)

    The plastic area of the mirror image is the separated area.

    Args:
        w: Start s and spread of the stress in units of the hardness, arrays of one
            shape.
    """
    return evaluate(
        w, modes=lambda w: w.s + _plastic_modes(w), images=series.plastic_images
    )


def _plastic_modes(w: Diffusion) -> FloatArray:
    """Return the sum over eigenfunctions in the plastic area, for each element.

    It is minus the mean pressure that elastic contact carries, over the hardness.

    Args:
        w: Start and spread of the stress in units of the hardness, of m elements.
    """
    return w.sum_modes(lambda n: 2 / np.pi * (-1) ** n / n)


def elastic_force(
    diffusion: ArrayLike, mean_pressure: ArrayLike, hardness: ArrayLike = np.inf
) -> FloatArray:
    """Return the part of the mean pressure that elastic contact carries, in Pa.

    It is int sigma P dsigma.  The arguments are numbers or arrays of shapes that
    broadcast.

    Args:
        diffusion: G in Pa^2.
        mean_pressure: p_0 in Pa.
        hardness: sigma_P in Pa; infinite for an elastic body.

    Raises:
        InvalidScene: An argument is out of range: 0 <= G < inf, 0 < p_0 < sigma_P.
    """
    w, unit, _ = _scaled(diffusion, mean_pressure, hardness)
    force = evaluate(w, modes=lambda w: -_plastic_modes(w), images=series.force_images)
    return unit * force


def pressure_density(
    pressure: ArrayLike,
    diffusion: ArrayLike,
    mean_pressure: ArrayLike,
    hardness: ArrayLike = np.inf,
) -> FloatArray:
    """Return the density P(sigma) of elastic contact by equation (3) of the paper:

        P = 2 sum_n sin(n pi s) sin(n pi x) e^(-n^2 pi^2 t) / sigma_P

    with s = p_0/sigma_P, x = sigma/sigma_P and t = G/sigma_P^2.  The arguments are
    numbers or arrays of shapes that broadcast.

    Args:
        pressure: sigma in Pa.
        diffusion: G in Pa^2, above 0.
        mean_pressure: p_0 in Pa.
        hardness: sigma_P in Pa; infinite for an elastic body.

    Returns:
        The density in 1/Pa; it is 0 outside of (0, sigma_P).

    Raises:
        InvalidScene: An argument is out of range: 0 < G < inf, 0 < p_0 < sigma_P.

    Example:
        >>> pressure_density([0.0, 50.0, 150.0], 4187.5, 12.5, 150.0).round(5)
        array([0.     , 0.00048, 0.     ])
    """
    w, unit, inside = _scaled(diffusion, mean_pressure, hardness, pressure)
    if np.any(np.equal(diffusion, 0)):
        raise InvalidScene(
            "diffusion is 0, where the pressures have no density but one value"
        )

    def modes(w: Diffusion) -> FloatArray:
        """Return the dimensionless density, by the sum over eigenfunctions.

        `w` holds start, spread and pressure in units of the hardness, (m,) each.
        """
        density = w.sum_modes(lambda n: 2 * series.sine(n, w.x, w.y))
        return np.maximum(density, 0)

    density = evaluate(w, modes=modes, images=series.density_images)
    return np.where(inside, density, 0.0) / unit


def pressure_cumulative(
    pressure: ArrayLike,
    diffusion: ArrayLike,
    mean_pressure: ArrayLike,
    hardness: ArrayLike = np.inf,
) -> FloatArray:
    """Return the fraction of the nominal area in elastic contact at (0, sigma].

    Args:
        pressure: sigma in Pa.
        diffusion: G in Pa^2.
        mean_pressure: p_0 in Pa.
        hardness: sigma_P in Pa; infinite for an elastic body.

    Raises:
        InvalidScene: An argument is out of range or not a number.

    Example:
        >>> pressure_cumulative([0.0, 75.0, 150.0], 4187.5, 12.5, 150.0).round(4)
        array([0.    , 0.0265, 0.0525])
    """
    w, _, inside = _scaled(diffusion, mean_pressure, hardness, pressure)
    if np.isnan(pressure).any():
        raise InvalidScene("pressure is not a number (NaN)")

    def modes(w: Diffusion) -> FloatArray:
        """Return the area in contact at pressures from 0 to x, by eigenfunctions.

        The area is a fraction; `w` holds start, spread and the pressure x in units of
        the hardness, (m,) each.
        """
        return w.sum_modes(lambda n: 4 / np.pi * np.sin(0.5 * n * np.pi * w.x) ** 2 / n)

    below = evaluate(w, modes=modes, images=series.cumulative_images)
    beyond_hardness = ~inside & (np.asarray(pressure) > 0)
    outside = np.where(beyond_hardness, _elastic_area(w), 0.0)
    return np.where(inside, below, outside)


def boundary_slopes(
    diffusion: ArrayLike, mean_pressure: ArrayLike, hardness: ArrayLike = np.inf
) -> tuple[FloatArray, FloatArray]:
    """Return dP/dsigma at zero and at the hardness, in 1/Pa^2.

    P is the density of elastic contact.  The first slope is d(separated)/dG, the second
    minus d(plastic)/dG.  The arguments are numbers or arrays of shapes that broadcast.

    Args:
        diffusion: G in Pa^2.
        mean_pressure: p_0 in Pa.
        hardness: sigma_P in Pa; infinite for an elastic body.

    Raises:
        InvalidScene: An argument is out of range: 0 <= G < inf, 0 < p_0 < sigma_P.
    """
    w, unit, _ = _scaled(diffusion, mean_pressure, hardness)

    def modes(w: Diffusion) -> FloatArray:
        """Return the slope dP/dx at x = 0, by the sum over eigenfunctions.

        `w` holds start and spread of the stress in units of the hardness, (m,) each.
        """
        return w.sum_modes(lambda n: 2 * np.pi * n)

    at_zero = evaluate(w, modes=modes, images=series.slope_images)
    of_mirror = evaluate(w.mirrored(), modes=modes, images=series.slope_images)
    at_hardness = 0.0 - of_mirror / unit / unit
    return at_zero / unit / unit, at_hardness


def _scaled(
    diffusion: ArrayLike,
    mean_pressure: ArrayLike,
    hardness: ArrayLike,
    pressure: ArrayLike | None = None,
) -> tuple[Diffusion, FloatArray, NDArray[np.bool_]]:
    """Check the arguments of this module's functions and scale them.

    Args:
        diffusion: G in Pa^2, at least 0 and finite.
        mean_pressure: p_0 in Pa, between 0 and the hardness.
        hardness: sigma_P in Pa; infinite for an elastic body.
        pressure: sigma in Pa; None: there is no such argument.

    Returns:
        The arguments in units of the hardness (of the mean pressure where the hardness
        is infinite), that unit in Pa, and True where the pressure lies between 0 and
        the hardness.  Elsewhere, and without a pressure, the mean pressure stands for
        it.

    Raises:
        InvalidScene: The shapes do not broadcast, or an argument is out of range.
    """
    arguments = {
        "diffusion": diffusion,
        "mean_pressure": mean_pressure,
        "hardness": hardness,
    }
    if pressure is not None:
        arguments["pressure"] = pressure
    arrays = {name: array(name, values) for name, values in arguments.items()}
    try:
        G, p0, H, *rest = np.broadcast_arrays(*arrays.values())
    except ValueError:
        shapes = " and ".join(f"{name} {a.shape}" for name, a in arrays.items())
        raise InvalidScene(
            f"{shapes} do not fit: give numbers, or arrays of one shape"
        ) from None
    valid = np.isfinite(G) & (G >= 0)
    if not valid.all():
        raise InvalidScene(
            f"diffusion is {G[~valid].flat[0]!s}, but must be a finite number >= 0 in "
            "Pa^2"
        )
    valid = (p0 > 0) & (p0 < H)
    if not valid.all():
        raise InvalidScene(
            f"mean_pressure is {p0[~valid].flat[0]!s} at a hardness of "
            f"{H[~valid].flat[0]!s}, but must lie between 0 and the hardness, both "
            "excluded"
        )
    sigma = rest[0] if rest else p0
    inside = (sigma > 0) & (sigma < H)
    sigma = np.where(inside, sigma, p0)
    elastic = np.isinf(H)
    unit = np.where(elastic, p0, H)
    widest = np.where(elastic, np.inf, _WIDEST)
    scaled = Diffusion(
        s=p0 / unit,
        r=(H - p0) / unit,
        c=np.clip(2 * np.sqrt(G) / unit, _NARROWEST, widest),
        x=sigma / unit,
        y=(H - sigma) / unit,
        d=(sigma - p0) / unit,
        bounded=~elastic,
    )
    return scaled, unit, inside
