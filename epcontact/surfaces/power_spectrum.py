"""The power spectrum of any surface or line: moments, densities, and slope up to a cut-off.

With the modes h_q = FFT(h) / N, h_rms^2 = sum_{q != 0} |h_q|^2 (Parseval), and likewise
xi^2 = sum q^2 |h_q|^2, the mean square of the spectral derivative.  On even grids the Nyquist mode
has |q| = pi / dx.  Derivatives that set this mode to zero differ by it alone; band-limited surfaces
do not have it.

Densities: C(q) of a surface in m^4, and the one-sided C1(q) of a line in m^3; see `epcontact`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import ducc0
import numpy as np
from numpy.typing import ArrayLike

from epcontact.results import FloatArray
from epcontact.scene import Surface
from epcontact.surfaces.spectrum import BAND_TOLERANCE, Moments

#: Number of modes handled at once, which limits temporary arrays to a few MiB.
_BLOCK = 1 << 16


def surface_moments(surface: Surface) -> Moments:
    """Return the moments of a surface's or line's spectrum: exact sums over its Fourier modes.

    rms_height is that of the grid points about their mean (Parseval).  On an even grid the Nyquist
    mode counts with |q| = pi / dx, as in numpy.fft.fftfreq.

    Example:
        >>> line = Surface(np.cos(2 * math.pi * np.arange(8) / 8), (2 * math.pi,))
        >>> round(surface_moments(line).rms_slope, 12)
        0.707106781187
    """
    sums = np.zeros(3)
    for q, variance in _mode_variances(surface):
        q2 = (q * q).ravel()
        v = variance.ravel()
        v2 = v * q2
        sums += v.sum(), v2.sum(), v2 @ q2
    m0, m2, m4 = sums.tolist()
    return Moments.of(m0, m2, m4, len(surface.shape))


def power_spectral_density(surface: Surface) -> FloatArray:
    """Return the power spectral density on the half grid of a real transform; 0 at q = 0.

    surface: C at (qx, qy) in m^4, shape (nx, ny // 2 + 1); over both half planes,
        h_rms^2 = sum C (2 pi)^2 / (Lx Ly).
    line: the one-sided C1 in m^3, shape (nx // 2 + 1,): h_rms^2 = sum C1 2 pi / L.
    """
    variance = np.concatenate([v for _, v in _mode_variances(surface)])
    if len(surface.shape) == 1:
        return np.asarray(variance[0] / _cell(surface))
    return np.asarray(variance / (_multiplicity(surface) * _cell(surface)))


@dataclass(frozen=True)
class RadialSpectrum:
    """A surface's spectrum by rings of |q|, or a line's by modes, in ascending order.

    wavenumber: (m,) mean |q| of the ring's modes, in rad/m.
    density: (m,) mean of C in m^4 over the ring's modes (a line: C1 in m^3).
    modes: (m,) number of modes in the ring, in both half planes (a line: 1).
    upper_edge: (m,) the largest |q| in the ring.
    height_variance, slope_variance: (m,) contribution of the ring to h_rms^2 and to xi^2; their
        sums up to a ring are exact for all modes up to its upper edge.
    """

    wavenumber: FloatArray
    density: FloatArray
    modes: FloatArray
    upper_edge: FloatArray
    height_variance: FloatArray
    slope_variance: FloatArray


def radial_spectrum(surface: Surface) -> RadialSpectrum:
    """Return the radially averaged spectrum, in rings as wide as the finest spacing of modes.

    Ring k holds (k - 1/2) w < |q| <= (k + 1/2) w, w = 2 pi / max(Lx, Ly), without q = 0.  Empty
    rings are left out.
    """
    width = 2 * math.pi / max(surface.periods)
    highest = math.hypot(*(math.pi / d for d in surface.spacing))
    rings = math.ceil(highest / width) + 2
    line = len(surface.shape) == 1
    weight = np.ones(1) if line else _multiplicity(surface)  # C1 is one-sided already
    sums = np.zeros((4, rings))
    for q, variance in _mode_variances(surface):
        index = np.ceil(q * (1 - BAND_TOLERANCE) / width - 0.5).astype(np.intp).ravel()
        modes = np.broadcast_to(weight, q.shape)
        for row, values in enumerate((modes, modes * q, variance, variance * q * q)):
            sums[row] += np.bincount(index, weights=values.ravel(), minlength=rings)
    sums[:, 0] = 0  # the mean height
    filled = np.flatnonzero(sums[0])
    modes, total_q, height, slope = sums[:, filled]
    return RadialSpectrum(
        wavenumber=total_q / modes,
        density=height / (modes * _cell(surface)),
        modes=modes,
        upper_edge=np.asarray((filled + 0.5) * width, dtype=np.float64),
        height_variance=height,
        slope_variance=slope,
    )


def cumulative_slope_variance(surface: Surface, wavenumber: ArrayLike) -> FloatArray:
    """Return xi^2(q), the exact sum over a surface's modes with |q| <= wavenumber.

    `wavenumber`, (m,) in rad/m, may have any order.  Modes that equal a wave number within rounding
    (`BAND_TOLERANCE`) are included.  `slope_variance_up_to` is the same for an analytic spectrum.
    """
    q_given = np.asarray(wavenumber, dtype=np.float64)
    limits, place = np.unique(q_given.ravel(), return_inverse=True)
    sums = np.zeros(limits.size + 1)
    for q, variance in _mode_variances(surface):
        index = np.searchsorted(limits, q.ravel() * (1 - BAND_TOLERANCE))
        sums += np.bincount(index, weights=(variance * q * q).ravel(), minlength=sums.size)
    return np.cumsum(sums[:-1])[place].reshape(q_given.shape)


def _cell(surface: Surface) -> float:
    """Return the measure of one mode: (2 pi)^2 / (Lx Ly), or 2 pi / L for a line."""
    return math.prod(2 * math.pi / p for p in surface.periods)


def _multiplicity(surface: Surface) -> FloatArray:
    """Return the number of modes of the whole plane for each column of the half grid."""
    n = surface.shape[-1]
    weight = np.full(n // 2 + 1, 2.0)
    weight[0] = 1.0
    if n % 2 == 0:
        weight[-1] = 1.0
    return weight


def _mode_variances(surface: Surface) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield |q| and the share of h_rms^2 of each mode of the half grid, by blocks of rows.

    A line is one row.  Blocks limit the memory to the heights, their transform and a few MiB.
    """
    modes = ducc0.fft.r2c(surface.heights)
    modes = modes.reshape(-1, modes.shape[-1])
    n = surface.shape[-1]
    q_last = 2 * math.pi / surface.periods[-1] * np.arange(n // 2 + 1)[None, :]
    q_first: FloatArray = np.zeros(1)
    if len(surface.shape) == 2:
        q_first = np.asarray(2 * math.pi * np.fft.fftfreq(surface.shape[0], surface.spacing[0]))
    scale = _multiplicity(surface) / float(surface.heights.size) ** 2
    rows = max(1, _BLOCK // modes.shape[-1])
    for first in range(0, modes.shape[0], rows):
        block = modes[first : first + rows]
        variance = (block.real**2 + block.imag**2) * scale
        if first == 0:
            variance[0, 0] = 0.0
        yield np.hypot(q_first[first : first + rows, None], q_last), variance
