"""The spectrum of the heights of any surface or line: moments, densities, statistics
and filters.

With the modes h_q = FFT(h) / N, h_rms^2 = sum_{q != 0} |h_q|^2 (Parseval), and likewise
xi^2 = sum q^2 |h_q|^2, the mean square of the spectral derivative.  On even grids the
Nyquist mode has |q| = pi / dx; band-limited surfaces do not have it.

Densities: C(q) of a surface in m^4, and the one-sided C1(q) of a line in m^3; see
`epcontact`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import ducc0
import numpy as np
from numpy.typing import ArrayLike

from epcontact.results import FloatArray
from epcontact.scene import Surface, number, positive, require_kind
from epcontact.surfaces.spectrum import BAND_TOLERANCE, truncated

#: Number of modes handled at once, which limits temporary arrays to a few MiB.
_BLOCK = 1 << 16
#: Jumps at the edges show where they make the rms slope of a spectrum larger by this
#: factor: kinks of mirrored periodic maps make it 1 % smaller.
EDGES_SEEN = 1.02

# --- statistics
# ----------------------------------------------------------------------------------


class Moments(NamedTuple):
    """The root mean squares of a surface or line, as in `Topography`."""

    rms_height: float
    rms_slope: float
    rms_curvature: float


def surface_moments(surface: Surface) -> Moments:
    """Return the moments of a surface's or line's spectrum: exact sums over its Fourier
    modes.
    """
    sums = np.zeros(3)
    for q, variance in _mode_variances(surface):
        q2, v = (q * q).ravel(), variance.ravel()
        sums += v.sum(), v @ q2, (v * q2) @ q2
    m0, m2, m4 = np.sqrt(sums).tolist()
    return Moments(m0, m2, m4 / len(surface.shape))


def even_moments(heights: FloatArray, spacing: tuple[float, ...]) -> Moments:
    """Return the moments of heights mirrored at their edges, so that no jump there
    counts.
    """
    from scipy.fft import dctn  # slow to load

    variance = dctn(heights, norm="ortho") ** 2 / heights.size
    variance.flat[0] = 0.0
    squares = (
        (np.pi * np.arange(n) / (n * d)) ** 2
        for n, d in zip(heights.shape, spacing, strict=True)
    )
    q2 = sum(np.ix_(*squares))
    m0, m2, m4 = (math.sqrt(float((variance * q2**k).sum())) for k in range(3))
    return Moments(m0, m2, m4 / heights.ndim)


def inner_moments(surface: Surface) -> Moments:
    """Return the moments of a surface without what jumps at the edges of its period
    add.
    """
    whole, inside = (
        surface_moments(surface),
        even_moments(surface.heights, surface.spacing),
    )
    return inside if whole.rms_slope > EDGES_SEEN * inside.rms_slope else whole


class Topography(NamedTuple):
    """Statistics of the heights about their mean."""

    rms_height: float  #: In m.
    rms_slope: float  #: That of the gradient.
    rms_curvature: (
        float  #: In 1/m, of half the Laplacian (of a line: the second derivative).
    )
    skewness: float  #: Third moment over rms_height^3; 0 if the heights are symmetric.
    excess_kurtosis: (
        float  #: Fourth moment over rms_height^4, less the 3 of Gaussian heights.
    )


def topography(surface: Surface) -> Topography:
    """Return the statistics of a surface's heights.

    Example:
        >>> wave = Surface(np.cos(2 * np.pi * np.arange(64) / 64), (2 * np.pi,))
        >>> found = topography(wave)
        >>> round(found.rms_slope**2, 9), round(found.excess_kurtosis, 9)
        (0.5, -1.5)
    """
    from scipy.stats import kurtosis, skew  # slow to load

    heights = surface.heights.ravel()
    return Topography(
        *surface_moments(surface), float(skew(heights)), float(kurtosis(heights))
    )


# --- densities
# -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class RadialSpectrum:
    """A surface's spectrum by rings of |q|, or a line's by modes, in ascending order.

    Sums of the variances up to a ring are exact for all modes up to its upper edge.
    """

    wavenumber: FloatArray  # mean |q| of the ring's modes, in rad/m
    density: FloatArray  # mean of C in m^4 over the ring's modes (a line: C1 in m^3)
    modes: FloatArray  # number of modes in the ring, in both half planes (a line: 1)
    upper_edge: FloatArray  # the largest |q| in the ring
    height_variance: FloatArray  # contribution of the ring to h_rms^2
    slope_variance: FloatArray  # and to xi^2


def radial_spectrum(surface: Surface) -> RadialSpectrum:
    """Return the radially averaged spectrum, in rings as wide as the finest spacing of
    modes.  Ring k holds (k - 1/2) w < |q| <= (k + 1/2) w, w = 2 pi / max(Lx, Ly),
    without q = 0.  Empty rings are left out.
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
    cell = math.prod(
        2 * math.pi / p for p in surface.periods
    )  # the measure of one mode
    edge = np.asarray((filled + 0.5) * width, dtype=np.float64)
    return RadialSpectrum(
        total_q / modes, height / (modes * cell), modes, edge, height, slope
    )


def power_by_octave(surface: Surface) -> tuple[FloatArray, FloatArray]:
    """Return the lowest wave number (rad/m) of each octave, and its height variance in
    m^2.

    Octave k holds the wave numbers from 2^k to 2^(k+1) times 2 pi over the longest
    period.

    Example:
        >>> wave = Surface(0.1 * np.cos(2 * np.pi * 5 * np.arange(64) / 64), (2 * np.pi,))
        >>> lowest, variance = power_by_octave(wave)
        >>> float(lowest[np.argmax(variance)]), float(variance.max().round(9))
        (4.0, 0.005)
    """
    rings = radial_spectrum(surface)
    first = 2 * math.pi / max(surface.periods)
    ratio = rings.wavenumber / first * (1 + BAND_TOLERANCE)
    octave = np.maximum(np.floor(np.log2(ratio)), 0).astype(np.intp)
    variance = np.bincount(octave, weights=rings.height_variance)
    return first * np.exp2(np.arange(variance.size)), np.asarray(
        variance, dtype=np.float64
    )


def cumulative_slope_variance(surface: Surface, wavenumber: ArrayLike) -> FloatArray:
    """Return xi^2(q), the exact sum over a surface's modes up to wave numbers of any
    shape.
    """
    q_given = np.asarray(wavenumber, dtype=np.float64)
    limits, place = np.unique(q_given.ravel(), return_inverse=True)
    sums = np.zeros(limits.size + 1)
    for q, variance in _mode_variances(surface):
        index = np.searchsorted(limits, q.ravel() * (1 - BAND_TOLERANCE))
        sums += np.bincount(
            index, weights=(variance * q * q).ravel(), minlength=sums.size
        )
    return np.cumsum(sums[:-1])[place].reshape(q_given.shape)


# --- filters
# -------------------------------------------------------------------------------------


def filtered(
    surface: Surface, wavenumber_high: float, wavenumber_low: float = 0.0
) -> Surface:
    """Keep the modes of wavenumber_low <= |q| <= wavenumber_high (rad/m), on the same
    grid.

    Without a lower limit the result is the surface that the theory sees at the
    magnification wavenumber_high / q_0.  An analytic spectrum is cut off with the short
    waves, and dropped if long waves are removed or nothing of it remains.  The mean
    height is kept.

    Raises:
        InvalidScene: unless 0 <= wavenumber_low < wavenumber_high.

    Example:
        >>> surface = Surface(0.1 * np.cos(2 * math.pi * np.arange(8) / 4), (2 * math.pi,))
        >>> float(abs(filtered(surface, 1.0).heights).max()) < 1e-15
        True
    """
    require_kind("surface", surface, Surface)
    high = positive("wavenumber_high", wavenumber_high, "rad/m", finite=False)
    right = f"a number between 0 and wavenumber_high = {high:g} rad/m"
    low = number("wavenumber_low", wavenumber_low, right, lambda q: 0 <= q < high)
    spectrum = surface.spectrum
    if spectrum is not None:
        left = high > spectrum.wavenumber_low >= low * (1 - BAND_TOLERANCE)
        spectrum = truncated(spectrum, high, len(surface.shape)) if left else None
    band = f"{low!r} to " if low else ""
    return replace(
        surface,
        heights=band_pass(surface.heights, surface.periods, high, low),
        spectrum=spectrum,
        shortest_wavelength=max(2 * math.pi / high, surface.shortest_wavelength or 0.0)
        or None,
        recipe=f"filtered/1 {band}{high!r} of {surface.fingerprint}",
    )


def band_pass(
    heights: FloatArray, periods: tuple[float, ...], highest: float, lowest: float = 0.0
) -> FloatArray:
    """Return heights of these periods without the waves outside a band; see
    `filtered`.
    """
    low, high = lowest * (1 - BAND_TOLERANCE), highest * (1 + BAND_TOLERANCE)
    modes = ducc0.fft.r2c(heights)
    for rows, q in _wavenumbers(heights.shape, periods):
        block = modes.reshape(-1, modes.shape[-1])[rows]
        block[(q > high) | ((q < low) & (q > 0))] = 0.0
    modes *= 1 / heights.size
    if heights.ndim == 2:
        ducc0.fft.c2c(modes, axes=(0,), forward=False, out=modes)
    kept = np.empty(heights.shape)
    ducc0.fft.c2r(
        modes, (heights.ndim - 1,), heights.shape[-1], forward=False, out=kept
    )
    kept.flags.writeable = False
    return kept


# --- modes
# ---------------------------------------------------------------------------------------


def _multiplicity(surface: Surface) -> FloatArray:
    """Return the number of modes of the whole plane for each column of the half
    grid.
    """
    n = surface.shape[-1]
    k = np.arange(n // 2 + 1)
    return np.where((k == 0) | (2 * k == n), 1.0, 2.0)


def _mode_variances(surface: Surface) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield |q| and the share of h_rms^2 of each mode of the half grid, by blocks of
    rows.
    """
    modes = ducc0.fft.r2c(surface.heights)
    modes = modes.reshape(-1, modes.shape[-1])
    scale = _multiplicity(surface) / float(surface.heights.size) ** 2
    for rows, q in _wavenumbers(surface.shape, surface.periods):
        variance = (modes[rows].real ** 2 + modes[rows].imag ** 2) * scale
        if rows.start == 0:
            variance[0, 0] = 0.0
        yield q, variance


def _wavenumbers(
    shape: tuple[int, ...], periods: tuple[float, ...]
) -> Iterator[tuple[slice, FloatArray]]:
    """Yield |q| on the half grid of a real transform, by blocks of rows; a line is one
    row.
    """
    *rest, n = shape
    q_last = 2 * math.pi / periods[-1] * np.arange(n // 2 + 1)
    q_first = (
        2 * math.pi * np.fft.fftfreq(rest[0], periods[0] / rest[0])
        if rest
        else np.zeros(1)
    )
    step = max(1, _BLOCK // q_last.size)
    for start in range(0, q_first.size, step):
        rows = slice(start, start + step)
        yield rows, np.hypot(q_first[rows, None], q_last)
