"""Two exact series for a stress that diffuses between two absorbing walls.

In Persson's theory the stress of a point diffuses, dP/dG = d2P/dsigma2.  It starts from
the mean pressure at G = 0 and is absorbed at zero (the point leaves contact) and at the
hardness sigma_P (the point flows).  In units of sigma_P it starts at s, a distance r =
1 - s below the upper wall, and has spread by c = 2 sqrt(t) after the "time" t = G /
sigma_P^2.  The distribution is a sum over eigenfunctions or a sum over mirror images of
the start in the walls; both are the same function (Poisson summation):

    eigenfunctions   P(x) = 2 sum_n sin(n pi s) sin(n pi x) exp(-n^2 pi^2 t)
    images           P(x) = sum_m [phi(x - s - 2m) - phi(x + s - 2m)],   m in Z,
                     phi(z) = exp(-z^2/c^2) / (sqrt(pi) c)

Seven eigenfunctions reach rounding for c >= 0.8, a handful of images reach it for c <=
0.8.  The elastic theory, which has no upper wall, is the first image alone.  Small
values are summed in a form without cancellation: a difference of erf becomes the mass
of one Gaussian over an interval, and the symmetry (s, x) -> (1 - s, 1 - x) moves the
start into the lower half.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf, erfc

from epcontact.results import FloatArray

#: The spread c from which the eigenfunctions are summed; both series have converged
#: around it.
SWITCH = 0.8
#: Numbers n of the eigenfunctions: the eighth is below exp(-(8 pi c/2)^2) < 1e-43 at c
#: = 0.8.
MODES = np.arange(1.0, 8.0)[:, None]
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1), 0.5 * _WEIGHTS


class Walk(NamedTuple):
    """The start of the diffusion, its spread, and a pressure; scaled arrays of one
    shape. Distances that are differences come from unscaled pressures, so that they
    keep their digits. The unit is the hardness, or the mean pressure where the hardness
    is infinite.
    """

    s: FloatArray  # start: mean pressure / unit
    r: FloatArray  # distance of the start from the upper wall
    c: FloatArray  # spread: 2 sqrt(G) / unit
    x: FloatArray  # pressure / unit
    y: FloatArray  # distance of the pressure from the upper wall
    d: FloatArray  # pressure less mean pressure, / unit
    bounded: NDArray[np.bool_]  # whether there is an upper wall, at 1

    def rows(self, chosen: NDArray[np.bool_]) -> Walk:
        """The elements that a mask chooses, in one dimension; not copied if it chooses
        all.
        """
        arrays: tuple[Any, ...] = self
        return Walk(*(a.ravel() if chosen.all() else a[chosen] for a in arrays))

    def mirrored(self) -> Walk:
        """The mirror image of the problem, measured from the upper wall."""
        return Walk(self.r, self.s, self.c, self.y, self.x, -self.d, self.bounded)

    def in_lower_half(self) -> Walk:
        """The problem or its mirror image, whichever starts in the lower half."""
        low = self.s <= self.r
        pairs: Iterator[Any] = zip(self, self.mirrored(), strict=True)
        return Walk(*(np.where(low, own, other) for own, other in pairs))

    def image_numbers(self, count: int) -> range:
        """1 to count, or none if there is no upper wall (for any of the rows)."""
        return range(1, count + 1) if self.bounded.all() else range(0)

    def sum_modes(self, weight: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """sum_n weight(n) sin(n pi s) exp(-n^2 pi^2 t); the weight is (modes, 1) or
        (modes, n).
        """
        weights = weight(MODES)
        used = weights.any(axis=1)
        n = MODES[used]
        decay = np.exp(-((0.5 * n * np.pi * self.c) ** 2))
        return np.asarray(
            np.sum(weights[used] * sine(n, self.s, self.r) * decay, axis=0)
        )


Formula = Callable[[Walk], FloatArray]


def evaluate(walk: Walk, *, images: Formula, modes: Formula) -> FloatArray:
    """Evaluate a quantity of the walk by the shorter of the two sums for each
    element.
    """
    values = np.empty(walk.c.shape)
    wide = walk.bounded & (walk.c >= SWITCH)
    near = walk.bounded & ~wide
    for chosen, formula in ((near, images), (wide, modes), (~walk.bounded, images)):
        if chosen.any():
            values[chosen] = formula(walk.rows(chosen))
    return values


def sine(n: FloatArray, s: FloatArray, r: FloatArray) -> FloatArray:
    """sin(n pi s) for s + r = 1, without loss of digits near s = 1."""
    return np.asarray(
        np.where(s <= r, 1, -((-1) ** n)) * np.sin(n * np.pi * np.minimum(s, r))
    )


def gaussian_mass(
    centre: FloatArray, half_width: FloatArray, lower: FloatArray
) -> FloatArray:
    """(erf(centre + half_width) - erf(lower)) / 2 with lower = centre - half_width.
    For centre, half_width >= 0 the relative error is that of rounding, however narrow
    or far out the interval is.  `lower` is an argument because callers know it without
    cancellation.
    """
    upper = centre + half_width
    across = lower < 0
    narrow = ~across & (4 * centre * half_width <= 1)
    mass = (
        np.where(
            across, erf(upper) - erf(np.minimum(lower, 0)), erfc(lower) - erfc(upper)
        )
        / 2
    )
    if narrow.any():
        m, h = centre[narrow, None], half_width[narrow, None]
        # Here h <= 1/2 and 2 m h <= 1/2, so eight Gauss points reach rounding.
        even = np.exp(-((h * _NODES) ** 2)) * np.cosh(2 * m * h * _NODES)
        mass[narrow] = (
            (2 / np.sqrt(np.pi)) * (h * np.exp(-m * m))[:, 0] * (even @ _WEIGHTS)
        )
    return np.asarray(mass)


def plastic_images(w: Walk) -> FloatArray:
    """Mass absorbed at the upper wall, a sum of positive terms; erfc where it is the
    only wall.
    """
    if not w.bounded.all():
        return np.asarray(erfc(w.r / w.c))
    total = np.zeros_like(w.c)
    for m in range(4):
        total += 2 * gaussian_mass((2 * m + 1) / w.c, w.s / w.c, (2 * m + w.r) / w.c)
    return total


def elastic_images(w: Walk) -> FloatArray:
    """Mass still between the walls: a sum over k in Z of (-1)^k times a Gaussian about
    k.
    """
    x = np.minimum(w.s, w.r)
    total = np.asarray(erf(x / w.c))
    for k in w.image_numbers(6):  # the seventh is below exp(-(6.5 / c)^2) < 1e-28
        total += 2 * (-1) ** k * gaussian_mass(k / w.c, x / w.c, (k - x) / w.c)
    return total


def force_images(w: Walk) -> FloatArray:
    """int x P dx = s - A_pl; for a start in the upper half it is A_el - (r -
    A_separated).
    """
    low = w.in_lower_half()
    inner = low.s - plastic_images(low)
    return np.where(w.s <= w.r, inner, elastic_images(w) - inner)


def slope_images(w: Walk) -> FloatArray:
    """dP/dx at x = 0+: (4/c^2) sum over m of (s + 2m) phi(s + 2m).  Images are paired
    so that each pair vanishes with the distance of the start to its wall.
    """
    low, x, c = w.s <= w.r, np.minimum(w.s, w.r), w.c
    total = np.where(low, x * np.exp(-((x / c) ** 2)), 0.0)
    for m in w.image_numbers(4):
        k = np.where(low, 2.0 * m, 2.0 * m - 1)
        fade = 4 * (k / c) * (x / c)
        pair = x * (1 + np.exp(-fade)) + k * np.expm1(-fade)
        total += np.where(low, 1.0, -1.0) * np.exp(-(((k - x) / c) ** 2)) * pair
    return np.asarray(4 / (np.sqrt(np.pi) * c) * total / c / c)


def one_wall_density(
    x: FloatArray, start: FloatArray, distance: FloatArray, c: FloatArray
) -> FloatArray:
    """P(x) of the elastic theory by equation (1) of the paper, in units of the
    hardness:

        P = (e^(-(x - start)^2/c^2) - e^(-(x + start)^2/c^2)) / (sqrt(pi) c),   c^2 = 4 G

    distance is |x - start|; the second exponential is factored out, so that P(0) = 0
    exactly.
    """
    fade = -np.expm1(-4 * (start / c) * (x / c))
    return np.asarray(np.exp(-((distance / c) ** 2)) * fade / (np.sqrt(np.pi) * c))


def density_images(w: Walk) -> FloatArray:
    """P(x): the elastic density of the start and of its images in the upper wall."""
    low = w.in_lower_half()
    x, s, d, c = low.x, low.s, low.d, low.c
    total = one_wall_density(x, s, d, c)
    for m in w.image_numbers(4):  # the next image is 7.5 away: below 1e-38
        total += one_wall_density(x, 2 * m + s, 2 * m - d, c)
        total -= one_wall_density(x, 2 * m - s, 2 * m - s - x, c)
    return np.maximum(total, 0)


def cumulative_images(w: Walk) -> FloatArray:
    """Mass between 0 and x; errors are relative to the elastic mass, however small that
    is.
    """
    low = w.in_lower_half()
    x, s, d, c = low.x, low.s, low.d, low.c

    def mass(centre: FloatArray, lower: FloatArray) -> FloatArray:
        return gaussian_mass(centre / c, s / c, lower / c)

    below = mass(np.zeros_like(c), -s) - mass(x, d)
    for m in w.image_numbers(4):
        at_zero = 2 * mass(np.full_like(c, 2.0 * m), 2 * m - s)
        below += at_zero - mass(2 * m - x, 2 * m - x - s) - mass(2 * m + x, 2 * m + d)
    below = np.maximum(below, 0)
    return np.where(w.s <= w.r, below, elastic_images(w) - below)
