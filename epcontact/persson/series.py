"""Two exact series for diffusion between two absorbing walls, each summed where it is short.

Persson's theory lets the stress of a point diffuse, dP/dG = d2P/dsigma2, from sigma = p_0 at
G = 0, absorbed at 0 (the point leaves contact) and at the hardness sigma_P (it flows).  In
units of sigma_P the walk starts at s, a distance r = 1 - s below the upper wall, and has after
the "time" t = G / sigma_P^2 the spread c = 2 sqrt(t).  With phi(z) = exp(-z^2/c^2)/(sqrt(pi) c)

    eigenfunctions   P(x) = 2 sum_n sin(n pi s) sin(n pi x) exp(-n^2 pi^2 t)
    images           P(x) = sum_m [phi(x - s - 2m) - phi(x + s - 2m)],   m in Z

are the same function (Poisson summation).  From c = 0.8 upwards seven eigenfunctions, below it
a handful of images reach rounding.  What is small is summed in a form where nothing cancels:
differences of erf become the mass of one Gaussian over an interval, and the symmetry
(s, x) -> (1 - s, 1 - x) keeps the start in the lower half.

Arrays are float64, one-dimensional and of one shape; distances are in units of sigma_P.
"""

from __future__ import annotations

import numpy as np
from scipy.special import erf, erfc

from epcontact.results import FloatArray

#: c at which the eigenfunctions take over from the images; both have converged around it.
SWITCH = 0.8
_MODES = range(1, 8)  # exp(-(8 pi c / 2)^2) < 1e-43 of the first at c = 0.8
_IMAGES = range(1, 7)  # exp(-(6.5 / c)^2) < 1e-28 at c = 0.8
_PAIRS = range(1, 5)  # m of the images at 2m +- s; the next lies 7.5 away: < 1e-38
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1), 0.5 * _WEIGHTS


def gaussian_mass(centre: FloatArray, half_width: FloatArray, lower: FloatArray) -> FloatArray:
    """(erf(centre + half_width) - erf(lower)) / 2 with lower = centre - half_width.

    Right to rounding of itself for centre, half_width >= 0, however narrow or far out the
    interval; `lower` is passed because the caller often knows it without cancellation.
    """
    upper = centre + half_width
    across = lower < 0
    narrow = ~across & (4 * centre * half_width <= 1)
    mass = np.where(across, erf(upper) - erf(np.minimum(lower, 0)), erfc(lower) - erfc(upper)) / 2
    if narrow.any():
        m, h = centre[narrow, None], half_width[narrow, None]
        # Here h <= 1/2 and 2 m h <= 1/2, so eight Gauss points reach rounding.
        even = np.exp(-((h * _NODES) ** 2)) * np.cosh(2 * m * h * _NODES)
        mass[narrow] = (2 / np.sqrt(np.pi)) * (h * np.exp(-m * m))[:, 0] * (even @ _WEIGHTS)
    return np.asarray(mass)


def _decay(n: int, c: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-((0.5 * n * np.pi * c) ** 2)))


def _signed_sine(n: int, s: FloatArray, r: FloatArray) -> FloatArray:
    """sin(n pi s) without loss near s = 1."""
    sign = 1.0 if n % 2 else -1.0
    return np.asarray(np.where(s <= r, np.sin(n * np.pi * s), sign * np.sin(n * np.pi * r)))


def plastic_images(s: FloatArray, r: FloatArray, c: FloatArray) -> FloatArray:
    """Mass absorbed at the upper wall: a sum of positive terms."""
    total = np.zeros_like(c)
    for m in range(4):
        total += 2 * gaussian_mass((2 * m + 1) / c, s / c, (2 * m + r) / c)
    return total


def plastic_modes(s: FloatArray, r: FloatArray, c: FloatArray) -> FloatArray:
    """Mass absorbed at the upper wall, which takes what the walk's mean does not keep."""
    return s - force_modes(s, r, c)


def force_modes(s: FloatArray, r: FloatArray, c: FloatArray) -> FloatArray:
    """int x P dx = (2/pi) sum (-1)^(n+1) sin(n pi s) e^{-n^2 pi^2 t} / n."""
    total = np.zeros_like(c)
    for n in _MODES:
        total -= (2 / (np.pi * n)) * (-1) ** n * _signed_sine(n, s, r) * _decay(n, c)
    return total


def force_images(s: FloatArray, r: FloatArray, c: FloatArray) -> FloatArray:
    """int x P dx = s - A_pl, or, started in the upper half, A_el - (r - A_separated)."""
    start = np.minimum(s, r)
    inner = start - plastic_images(start, np.maximum(s, r), c)
    return np.asarray(np.where(s <= r, inner, elastic_images(s, r, c) - inner))


def elastic_images(s: FloatArray, r: FloatArray, c: FloatArray) -> FloatArray:
    """Mass still between the walls: sum over k in Z of (-1)^k times a Gaussian about k."""
    x = np.minimum(s, r)
    total = np.asarray(erf(x / c))
    for k in _IMAGES:
        total += 2 * (-1) ** k * gaussian_mass(k / c, x / c, (k - x) / c)
    return total


def elastic_modes(s: FloatArray, r: FloatArray, c: FloatArray) -> FloatArray:
    """Mass still between the walls: (4/pi) sum over odd n of sin(n pi s) e^{-n^2 pi^2 t} / n."""
    x = np.minimum(s, r)
    total = np.zeros_like(c)
    for n in _MODES[::2]:
        total += (4 / (np.pi * n)) * np.sin(n * np.pi * x) * _decay(n, c)
    return total


def slope_images(s: FloatArray, r: FloatArray, c: FloatArray) -> FloatArray:
    """dP/dx at x = 0+: (4/c^2) sum over m of (s + 2m) phi(s + 2m).

    Images are paired about even integers for a start in the lower half and about odd ones for
    one in the upper half, so that either pair vanishes with the distance to its wall.
    """
    low = s <= r
    x = np.where(low, s, r)
    total = np.where(low, s * np.exp(-((s / c) ** 2)), 0.0)
    for m in range(1, 5):
        k = np.where(low, 2.0 * m, 2.0 * m - 1)
        fade = 4 * (k / c) * (x / c)
        pair = x * (1 + np.exp(-fade)) + k * np.expm1(-fade)
        total += np.where(low, 1.0, -1.0) * np.exp(-(((k - x) / c) ** 2)) * pair
    return np.asarray(4 / (np.sqrt(np.pi) * c) * total / c / c)


def slope_modes(s: FloatArray, r: FloatArray, c: FloatArray) -> FloatArray:
    """dP/dx at x = 0+: 2 pi sum n sin(n pi s) e^{-n^2 pi^2 t}."""
    total = np.zeros_like(c)
    for n in _MODES:
        total += 2 * np.pi * n * _signed_sine(n, s, r) * _decay(n, c)
    return total


def density_images(
    x: FloatArray, y: FloatArray, above: FloatArray, s: FloatArray, r: FloatArray, c: FloatArray
) -> FloatArray:
    """P(x); y is 1 - x, `above` is x - s.  Pairs of images odd in x make P(0) = 0 exact."""
    low = s <= r
    x = np.where(low, x, y)
    start, above = np.where(low, s, r), np.where(low, above, -above)

    def pair(centre: FloatArray, distance: FloatArray) -> FloatArray:
        fade = -np.expm1(-4 * (centre / c) * (x / c))
        return np.asarray(np.exp(-((distance / c) ** 2)) * fade)

    total = pair(start, above)
    for m in _PAIRS:
        total += pair(2 * m + start, 2 * m - above) - pair(2 * m - start, 2 * m - start - x)
    return np.asarray(np.maximum(total, 0) / (np.sqrt(np.pi) * c))


def density_modes(
    x: FloatArray, y: FloatArray, above: FloatArray, s: FloatArray, r: FloatArray, c: FloatArray
) -> FloatArray:
    """P(x) = 2 sum sin(n pi s) sin(n pi x) e^{-n^2 pi^2 t}; `above` is not needed."""
    del above
    total = np.zeros_like(c)
    for n in _MODES:
        total += 2 * _signed_sine(n, s, r) * _signed_sine(n, x, y) * _decay(n, c)
    return np.maximum(total, 0)


def cumulative_images(
    x: FloatArray, y: FloatArray, above: FloatArray, s: FloatArray, r: FloatArray, c: FloatArray
) -> FloatArray:
    """Mass between 0 and x; y is 1 - x, `above` is x - s.

    Errors are relative to the elastic mass, however small it is.
    """
    low = s <= r
    y = np.where(low, x, y)
    start, above = np.where(low, s, r), np.where(low, above, -above)

    def mass(centre: FloatArray, lower: FloatArray) -> FloatArray:
        return gaussian_mass(centre / c, start / c, lower / c)

    below = mass(np.zeros_like(c), -start) - mass(y, above)
    for m in _PAIRS:
        at_zero = 2 * mass(np.full_like(c, 2.0 * m), 2 * m - start)
        below += at_zero - mass(2 * m - y, 2 * m - y - start) - mass(2 * m + y, 2 * m + above)
    below = np.maximum(below, 0)
    return np.asarray(np.where(low, below, elastic_images(s, r, c) - below))


def cumulative_modes(
    x: FloatArray, y: FloatArray, above: FloatArray, s: FloatArray, r: FloatArray, c: FloatArray
) -> FloatArray:
    """Mass between 0 and x: (4/pi) sum sin(n pi s) sin(n pi x / 2)^2 e^{-n^2 pi^2 t} / n."""
    del y, above
    total = np.zeros_like(c)
    for n in _MODES:
        weight = 4 / (np.pi * n) * _decay(n, c)
        total += weight * _signed_sine(n, s, r) * np.sin(0.5 * n * np.pi * x) ** 2
    return total
