"""The bearing-area limit: a body so soft, hardness << E* xi, that it flows under every contact.

Elastic displacements vanish beside the roughness; each point of the surface that stands above
the flat is flattened at the hardness.  The contact is then the bearing area of Abbott and
Firestone (1933), A = mean_pressure/hardness, all of it plastic, on the highest points.

Symbols: t = height of the flat above the mean plane in units of h_rms.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr, ndtri

from epcontact.results import FloatArray


def contact_fraction(mean_pressure: float, hardness: float) -> float:
    """A = p_0 / hardness."""
    return mean_pressure / hardness


def flat_height(heights: FloatArray, fraction: float) -> float:
    """Height in m of the flat that the share `fraction` of the heights (any shape) exceeds."""
    return float(np.quantile(heights, 1 - fraction))


def mean_gap(heights: FloatArray, flat: float) -> float:
    """Mean of max(0, flat - h) in m: the gap where the flat does not touch."""
    return float(np.mean(np.maximum(flat - np.asarray(heights), 0)))


def gaussian_fraction(height: float) -> float:
    """Share of a Gaussian surface above t = height / h_rms: erfc(t/sqrt 2)/2."""
    return float(ndtr(-height))


def gaussian_height(fraction: float) -> float:
    """t with that share above it; the inverse of the above."""
    return -float(ndtri(fraction))


def gaussian_mean_gap(height: float) -> float:
    """Mean gap / h_rms at t = height / h_rms: t Phi(t) + phi(t)."""
    density = math.exp(-(height**2) / 2) / math.sqrt(2 * math.pi)
    return height * float(ndtr(height)) + density
