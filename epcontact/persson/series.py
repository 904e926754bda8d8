"""Two exact series for a stress that diffuses between two absorbing bounds.

In Persson's theory the stress of a point diffuses, dP/dG = d2P/dsigma2.  It starts at
the mean pressure at G = 0 and is absorbed at zero (the point leaves the contact) and at
the hardness sigma_P (the point flows).  In units of sigma_P the stress starts at s, a
distance r = 1 - s below the upper bound, and has spread by c = 2 sqrt(t) after the
"time" t = G / sigma_P^2.  The distribution is a sum over eigenfunctions, or a sum over
the mirror images of the start in the two bounds.  Both sums are the same function
(Poisson summation):

    eigenfunctions   P(x) = 2 sum_n sin(n pi s) sin(n pi x) exp(-n^2 pi^2 t)
    images           P(x) = sum_m [phi(x - s - 2m) - phi(x + s - 2m)],   m in Z,
                     phi(z) = exp(-z^2/c^2) / (sqrt(pi) c)

For c >= 0.8 seven eigenfunctions reach rounding, and for c <= 0.8 a handful of images
does.  The elastic theory has no upper bound, and the first image alone is its solution.
Small values are summed without cancellation: a difference of error functions becomes
the mass of one Gaussian over an interval, and the symmetry (s, x) -> (1 - s, 1 - x)
moves the start into the lower half.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf, erfc

from epcontact.results import FloatArray

#: From this spread c on, the eigenfunctions are summed; both series converge around it.
SWITCH = 0.8
#: Numbers n of the eigenfunctions, (7, 1).  The eighth term is below
#: exp(-(8 pi c/2)^2) < 1e-43 at c = 0.8.
MODES = np.arange(1.0, 8.0)[:, None]

#: Gauss points and weights on (0, 1).
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_POINTS = 0.5 * (_POINTS + 1)
_WEIGHTS = 0.5 * _WEIGHTS


class Diffusion(NamedTuple):
    """The start of the stress, its spread and one pressure, as arrays of one shape.

    The unit of stress is the hardness, or the mean pressure where the hardness is
    infinite.  Distances are differences of unscaled pressures, so that they keep their
    digits.
    """

    s: FloatArray  # start: mean pressure / unit
    r: FloatArray  # distance of the start from the upper bound
    c: FloatArray  # spread: 2 sqrt(G) / unit
    x: FloatArray  # pressure / unit
    y: FloatArray  # distance of the pressure from the upper bound
    d: FloatArray  # (pressure - mean pressure) / unit
    bounded: NDArray[np.bool_]  # True where there is an upper bound, which lies at 1

    def select(self, mask: NDArray[np.bool_]) -> Diffusion:
        """Return the elements where `mask` is True, as arrays of one dimension.

        The arrays are views if the mask selects all of them.
        """
        arrays: tuple[Any, ...] = self
        if mask.all():
            return Diffusion(*(array.ravel() for array in arrays))
        return Diffusion(*(array[mask] for array in arrays))

    def mirrored(self) -> Diffusion:
        """Return the mirror image of the problem, measured from the upper bound.

        The plastic area of the mirror image is the separated area of this problem.
        """
        return Diffusion(self.r, self.s, self.c, self.y, self.x, -self.d, self.bounded)

    def in_lower_half(self) -> Diffusion:
        """Return the problem with every start in the lower half of the interval.

        Elements that start nearer to the upper bound are replaced by their mirror
        images.
        """
        low = self.s <= self.r
        arrays: tuple[Any, ...] = self
        mirrored: tuple[Any, ...] = self.mirrored()
        pairs = zip(arrays, mirrored, strict=True)
        return Diffusion(*(np.where(low, array, image) for array, image in pairs))

    def image_numbers(self, count: int) -> range:
        """Return the image numbers 1 to `count`.

        The range is empty if any element has no upper bound, because there the first
        image alone is the solution.
        """
        if self.bounded.all():
            return range(1, count + 1)
        return range(0)

    def sum_modes(self, weight: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Return sum_n weight(n) sin(n pi s) exp(-n^2 pi^2 t) for each element (m,).

        Args:
            weight: Function from the mode numbers (7, 1) to weights (7, 1) or (7, m).
        """
        weights = weight(MODES)
        used = weights.any(axis=1)
        n = MODES[used]
        decay = np.exp(-((0.5 * n * np.pi * self.c) ** 2))
        terms = weights[used] * sine(n, self.s, self.r) * decay
        return np.asarray(np.sum(terms, axis=0))


#: Computes one quantity for each element of a diffusion.
Formula = Callable[[Diffusion], FloatArray]


def evaluate(diffusion: Diffusion, *, images: Formula, modes: Formula) -> FloatArray:
    """Compute a quantity by the shorter of its two series for each element.

    Args:
        diffusion: The problem, with arrays of any one shape.
        images: Function that returns the quantity as a sum over images; it is used for
            small spreads and for elements without an upper bound.
        modes: Function that returns the quantity as a sum over eigenfunctions; it is
            used for large spreads.

    Returns:
        The quantity, of the shape of the problem.
    """
    values = np.empty(diffusion.c.shape)
    wide = diffusion.bounded & (diffusion.c >= SWITCH)
    narrow = diffusion.bounded & ~wide
    parts = ((narrow, images), (wide, modes), (~diffusion.bounded, images))
    for mask, formula in parts:
        if mask.any():
            values[mask] = formula(diffusion.select(mask))
    return values


def sine(n: FloatArray, s: FloatArray, r: FloatArray) -> FloatArray:
    """Return sin(n pi s) for s + r = 1, without loss of digits near s = 1.

    Args:
        n: Mode numbers, (k, 1).
        s: Position between the bounds 0 and 1, (m,).
        r: Distance from the upper bound, 1 - s, (m,).

    Returns:
        (k, m) sines.
    """
    sign = np.where(s <= r, 1, -((-1) ** n))
    return np.asarray(sign * np.sin(n * np.pi * np.minimum(s, r)))


def gaussian_mass(
    centre: FloatArray, half_width: FloatArray, lower: FloatArray
) -> FloatArray:
    """Return (erf(centre + half_width) - erf(lower)) / 2.

    For centre, half_width >= 0 the relative error is that of rounding, however narrow
    or far out the interval is.

    Args:
        centre: Middle of the interval.
        half_width: Half of its width.
        lower: centre - half_width, which the callers know without cancellation.
    """
    upper = centre + half_width
    across = lower < 0
    difference_of_erf = erf(upper) - erf(np.minimum(lower, 0))
    difference_of_erfc = erfc(lower) - erfc(upper)
    mass = np.where(across, difference_of_erf, difference_of_erfc) / 2
    narrow = ~across & (4 * centre * half_width <= 1)
    if narrow.any():
        # Here h <= 1/2 and 2 m h <= 1/2, so that eight Gauss points reach rounding.
        m = centre[narrow, None]
        h = half_width[narrow, None]
        even = np.exp(-((h * _POINTS) ** 2)) * np.cosh(2 * m * h * _POINTS)
        height = (h * np.exp(-m * m))[:, 0]
        mass[narrow] = (2 / np.sqrt(np.pi)) * height * (even @ _WEIGHTS)
    return np.asarray(mass)


def plastic_images(w: Diffusion) -> FloatArray:
    """Return the fraction of the area that flows, as a sum of positive terms.

    It is the mass that the upper bound has absorbed; without a second bound this is
    erfc of the distance over the spread.

    Args:
        w: Start and spread of the stress, arrays of one shape.
    """
    if not w.bounded.all():
        return np.asarray(erfc(w.r / w.c))
    total = np.zeros_like(w.c)
    for m in range(4):
        centre = (2 * m + 1) / w.c
        lower = (2 * m + w.r) / w.c
        total += 2 * gaussian_mass(centre, w.s / w.c, lower)
    return total


def elastic_images(w: Diffusion) -> FloatArray:
    """Return the fraction of the area in elastic contact, as a sum over images.

    It is the mass between the bounds, a sum over k in Z of (-1)^k Gaussians.

    Args:
        w: Start and spread of the stress, arrays of one shape.
    """
    x = np.minimum(w.s, w.r)
    total = np.asarray(erf(x / w.c))
    for k in w.image_numbers(6):  # the seventh is below exp(-(6.5 / c)^2) < 1e-28
        total += 2 * (-1) ** k * gaussian_mass(k / w.c, x / w.c, (k - x) / w.c)
    return total


def force_images(w: Diffusion) -> FloatArray:
    """Return the force of elastic contact over the nominal area and the unit of stress.

    It is int x P dx = s - A_pl.  For a start in the upper half it is A_el - (r -
    A_separated), which keeps digits.

    Args:
        w: Start and spread of the stress, arrays of one shape.
    """
    low = w.in_lower_half()
    of_lower_half = low.s - plastic_images(low)
    return np.where(w.s <= w.r, of_lower_half, elastic_images(w) - of_lower_half)


def slope_images(w: Diffusion) -> FloatArray:
    """Return dP/dx at x = 0+: (4/c^2) sum over m of (s + 2m) phi(s + 2m).

    phi is the Gaussian of the spread c.  Images are paired so that each pair vanishes
    with the distance of the start from its bound.

    Args:
        w: Start and spread of the stress in its unit, arrays of one shape.
    """
    low = w.s <= w.r
    x = np.minimum(w.s, w.r)
    c = w.c
    total = np.where(low, x * np.exp(-((x / c) ** 2)), 0.0)
    for m in w.image_numbers(4):
        k = np.where(low, 2.0 * m, 2.0 * m - 1)
        fade = 4 * (k / c) * (x / c)
        pair = x * (1 + np.exp(-fade)) + k * np.expm1(-fade)
        sign = np.where(low, 1.0, -1.0)
        total += sign * np.exp(-(((k - x) / c) ** 2)) * pair
    return np.asarray(4 / (np.sqrt(np.pi) * c) * total / c / c)


def elastic_density(
    x: FloatArray, start: FloatArray, distance: FloatArray, c: FloatArray
) -> FloatArray:
    """Return P(x) of the elastic theory by equation (1) of the paper:

        P = (e^(-(x - start)^2/c^2) - e^(-(x + start)^2/c^2)) / (sqrt(pi) c)

    with c^2 = 4 G, all in the unit of stress.

    The second exponential is factored out, so that P(0) = 0 exactly.

    Args:
        x: Pressure / unit.
        start: Mean pressure / unit, of the shape of x.
        distance: |x - start|, which the callers know without cancellation.
        c: Spread 2 sqrt(G) / unit.
    """
    fade = -np.expm1(-4 * (start / c) * (x / c))
    return np.asarray(np.exp(-((distance / c) ** 2)) * fade / (np.sqrt(np.pi) * c))


def density_images(w: Diffusion) -> FloatArray:
    """Return the density P(x) times the unit of stress, as a sum over images.

    Args:
        w: Start, spread and pressure x, arrays of one shape.
    """
    low = w.in_lower_half()
    x, s, d, c = low.x, low.s, low.d, low.c
    total = elastic_density(x, s, d, c)
    for m in w.image_numbers(4):  # the next image is 7.5 away: below 1e-38
        total += elastic_density(x, 2 * m + s, 2 * m - d, c)
        total -= elastic_density(x, 2 * m - s, 2 * m - s - x, c)
    return np.maximum(total, 0)


def cumulative_images(w: Diffusion) -> FloatArray:
    """Return the fraction of the area in elastic contact at pressures from 0 to x.

    Errors are relative to the elastic area, however small this area is.

    Args:
        w: Start, spread and pressure x in the unit of stress, arrays of one shape.
    """
    low = w.in_lower_half()
    x, s, d, c = low.x, low.s, low.d, low.c

    def mass(centre: FloatArray, lower: FloatArray) -> FloatArray:
        """Return the mass of a Gaussian of spread c between lower and 2 centre - lower.

        Both arguments are in the unit of stress.
        """
        return gaussian_mass(centre / c, s / c, lower / c)

    below = mass(np.zeros_like(c), -s) - mass(x, d)
    for m in w.image_numbers(4):
        at_zero = 2 * mass(np.full_like(c, 2.0 * m), 2 * m - s)
        below += at_zero - mass(2 * m - x, 2 * m - x - s) - mass(2 * m + x, 2 * m + d)
    below = np.maximum(below, 0)
    return np.where(w.s <= w.r, below, elastic_images(w) - below)
