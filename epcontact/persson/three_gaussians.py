"""An approximation kept for comparison: the stress distribution as three Gaussians.

Xu, Li and Mulvihill (arXiv 2208.02665) report a superposition of three Gaussians.  No finite sum
of Gaussians solves the problem at all G: the exact density decays as exp(-pi^2 G / sigma_P^2),
a Gaussian's as G^(-1/2).  The natural three are the first images,

    P(sigma) = phi(sigma - p_0) - phi(sigma + p_0) - phi(sigma - 2 sigma_P + p_0),
    phi(z) = exp(-z^2 / 4G) / sqrt(4 pi G),

the source and its mirror images in the two walls.  (Whether these are the authors' three, we
could not check.)  What is left out first is phi(sigma - 2 sigma_P - p_0) and its like: at
p_0 / sigma_P = 1/12 the density is off by 1e-4 of its maximum at G / sigma_P^2 = 0.03, by 24 %
at 0.1, and useless at the 0.186 of the paper's scene.  Nothing in the package is computed from
it; `elastoplastic` is exact, as short, and right everywhere.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erf

from epcontact.errors import InvalidScene
from epcontact.persson.elastoplastic import areas, pressure_density
from epcontact.results import FloatArray

#: G / sigma_P^2 up to which the density is right to 1e-3 of its maximum for p_0 / sigma_P from
#: 0.05 to 0.95; nearer to the walls it fails earlier.
RANGE = 0.03


def three_gaussian_density(
    pressure: ArrayLike, diffusion: float, mean_pressure: float, hardness: float
) -> FloatArray:
    """P(sigma) in 1/Pa at pressures in [0, hardness] (Pa, any shape).

    Raises InvalidScene for an infinite hardness, no diffusion, or pressures out of range.
    """
    spread = _spread(diffusion, mean_pressure, hardness)
    sigma = np.asarray(pressure, dtype=np.float64)
    gaussians = [np.exp(-((z / spread) ** 2)) for z in _distances(sigma, mean_pressure, hardness)]
    return np.asarray((gaussians[0] - gaussians[1] - gaussians[2]) / (math.sqrt(math.pi) * spread))


def three_gaussian_elastic_area(diffusion: float, mean_pressure: float, hardness: float) -> float:
    """The integral of `three_gaussian_density` over all pressures; negative where it fails."""
    spread = _spread(diffusion, mean_pressure, hardness)
    ends = np.array([0.0, hardness])
    mass = [
        0.5 * float(np.diff(erf(z / spread))[0]) for z in _distances(ends, mean_pressure, hardness)
    ]
    return mass[0] - mass[1] - mass[2]


def three_gaussian_error(
    load_share: float, relative_diffusions: ArrayLike | None = None
) -> dict[str, FloatArray]:
    """Columns (n,): G / sigma_P^2, and the largest error of the density over its maximum.

    load_share: p_0 / sigma_P; relative_diffusions: by default 60 from 0.01 to 1.
    Raises InvalidScene for values out of range.
    """
    given = np.geomspace(0.01, 1, 60) if relative_diffusions is None else relative_diffusions
    t = np.atleast_1d(np.asarray(given, dtype=np.float64))
    x = np.linspace(0, 1, 1025)
    error = np.empty_like(t)
    for k, G in enumerate(t):
        exact = pressure_density(x, G, load_share, 1.0)
        error[k] = np.abs(three_gaussian_density(x, G, load_share, 1.0) - exact).max() / exact.max()
    return {"relative_diffusion": t, "relative_density_error": error}


def _distances(
    sigma: FloatArray, mean_pressure: float, hardness: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    return sigma - mean_pressure, sigma + mean_pressure, sigma - (2 * hardness - mean_pressure)


def _spread(diffusion: float, mean_pressure: float, hardness: float) -> float:
    areas(diffusion, mean_pressure, hardness)  # checks the range
    if math.isinf(hardness) or diffusion == 0:
        raise InvalidScene("the three Gaussians need a finite hardness and a diffusion above 0")
    return 2 * math.sqrt(diffusion)
