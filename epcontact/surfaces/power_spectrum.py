"""The spectrum of the heights of any surface or line: moments, densities, statistics
and filters.

With the modes h_q = FFT(h) / N, h_rms^2 = sum_{q != 0} |h_q|^2 (Parseval), and likewise
xi^2 = sum q^2 |h_q|^2, the mean square of the spectral derivative.  On even grids the
Nyquist mode has |q| = pi / dx; band-limited surfaces do not have it.

The density of a surface is C(q) in m^4, that of a line the one-sided C1(q) in m^3; see
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
from epcontact.surfaces.spectrum import BAND_TOLERANCE, truncate

#: Number of modes handled at once, which limits temporary arrays to a few MiB.
_BLOCK = 2**16
#: Jumps at the edges are seen where they make the rms slope of a spectrum larger by
#: this factor.  Kinks of mirrored periodic maps make it 1 % smaller.
EDGES_SEEN = 1.02

# --- statistics -----------------------------------------------------------------------


class Moments(NamedTuple):
    """The root mean squares of a surface or line, as in `Topography`."""

    rms_height: float  #: In m.
    rms_slope: float  #: In m/m.
    rms_curvature: float  #: In 1/m.


def surface_moments(surface: Surface) -> Moments:
    """Return rms height (m), slope and curvature (1/m) of a surface or line.

    The values are exact sums over the Fourier modes of the heights.  The curvature of a
    surface is half the Laplacian, and that of a line the second derivative.

    Args:
        surface: a surface or line with its heights (m) and periods (m).
    """
    sums = np.zeros(3)
    for q, variance in _mode_variances(surface):
        q_squared = (q * q).ravel()
        variances = variance.ravel()
        sums[0] += variances.sum()
        sums[1] += variances @ q_squared
        sums[2] += (variances * q_squared) @ q_squared
    height, slope, curvature = np.sqrt(sums).tolist()
    return Moments(height, slope, curvature / len(surface.shape))


def even_moments(heights: FloatArray, spacing: tuple[float, ...]) -> Moments:
    """Return rms height (m), slope and curvature (1/m) of mirrored heights.

    The heights are mirrored at their edges, so that they have no jumps there.

    Args:
        heights: (nx, ny) or (nx,), in m.
        spacing: distance of grid points along each direction, in m.
    """
    from scipy.fft import dctn  # slow to load

    variance = dctn(heights, norm="ortho") ** 2 / heights.size
    variance.flat[0] = 0.0
    squares = [
        (np.pi * np.arange(n) / (n * d)) ** 2
        for n, d in zip(heights.shape, spacing, strict=True)
    ]
    q_squared = sum(np.ix_(*squares))
    height, slope, curvature = (
        math.sqrt(float((variance * q_squared**k).sum())) for k in range(3)
    )
    return Moments(height, slope, curvature / heights.ndim)


def inner_moments(surface: Surface) -> Moments:
    """Return rms height (m), slope and curvature (1/m) without jumps at the edges.

    If the heights of the surface jump at the edges of the period, the values are those
    of the mirrored heights, which have no jumps.  Jumps are recognised by an rms slope
    that exceeds that of the mirrored heights by 2 %.

    Args:
        surface: a surface or line with its heights (m) and periods (m).
    """
    periodic = surface_moments(surface)
    mirrored = even_moments(surface.heights, surface.spacing)
    edges_jump = periodic.rms_slope > EDGES_SEEN * mirrored.rms_slope
    return mirrored if edges_jump else periodic


class Topography(NamedTuple):
    """Statistics of the heights about their mean."""

    rms_height: float  #: In m.
    rms_slope: float  #: Root mean square of the gradient, in m/m.
    #: Root mean square of half the Laplacian (of a line: of the second derivative), in
    #: 1/m.
    rms_curvature: float
    skewness: float  #: Third moment over rms_height^3; 0 if the heights are symmetric.
    #: Fourth moment over rms_height^4, less the 3 of Gaussian heights.
    excess_kurtosis: float


def topography(surface: Surface) -> Topography:
    """Return the statistics of the heights of a surface or line.

    Example:
        >>> wave = Surface(np.cos(2 * np.pi * np.arange(64) / 64), (2 * np.pi,))
        >>> found = topography(wave)
        >>> round(found.rms_slope**2, 9), round(found.excess_kurtosis, 9)
        (0.5, -1.5)
    """
    from scipy.stats import kurtosis, skew  # slow to load

    heights = surface.heights.ravel()
    moments = surface_moments(surface)
    return Topography(*moments, float(skew(heights)), float(kurtosis(heights)))


# --- densities ------------------------------------------------------------------------


@dataclass(frozen=True)
class RadialSpectrum:
    """The spectrum of a surface by rings of |q|, or of a line by modes, in ascending
    order.

    Sums of the variances up to a ring are exact for all modes up to its upper edge.
    """

    wavenumber: FloatArray  #: Mean |q| of the modes of each ring, in rad/m.
    #: Mean of C over the modes of each ring, in m^4 (of a line: C1 in m^3).
    density: FloatArray
    #: Number of modes in each ring, in both half planes (of a line: 1).
    modes: FloatArray
    upper_edge: FloatArray  #: The largest |q| in each ring, in rad/m.
    height_variance: FloatArray  #: Contribution of each ring to h_rms^2, in m^2.
    slope_variance: FloatArray  #: Contribution of each ring to xi^2.


def radial_spectrum(surface: Surface) -> RadialSpectrum:
    """Return the radially averaged power spectrum of a surface, or that of a line.

    The Fourier modes are sorted into rings by their wave number |q|.  Ring k holds (k -
    1/2) w < |q| <= (k + 1/2) w, where w = 2 pi / max(Lx, Ly) is the finest spacing of
    modes.  The mean height (q = 0) and empty rings are left out.
    """
    width = 2 * math.pi / max(surface.periods)
    highest = math.hypot(*(math.pi / d for d in surface.spacing))
    rings = math.ceil(highest / width) + 2
    is_line = len(surface.shape) == 1
    multiplicity = np.ones(1) if is_line else _multiplicity(surface)
    sums = np.zeros((4, rings))  # of modes, |q|, height variance, slope variance
    for q, variance in _mode_variances(surface):
        index = np.ceil(q * (1 - BAND_TOLERANCE) / width - 0.5).astype(np.intp).ravel()
        modes = np.broadcast_to(multiplicity, q.shape)
        summands = (modes, modes * q, variance, variance * q * q)
        for row, values in enumerate(summands):
            sums[row] += np.bincount(index, weights=values.ravel(), minlength=rings)
    sums[:, 0] = 0  # the mean height
    occupied = np.flatnonzero(sums[0])
    modes, total_q, height_variance, slope_variance = sums[:, occupied]
    area_of_mode = math.prod(2 * math.pi / period for period in surface.periods)
    return RadialSpectrum(
        wavenumber=total_q / modes,
        density=height_variance / (modes * area_of_mode),
        modes=modes,
        upper_edge=np.asarray((occupied + 0.5) * width, dtype=np.float64),
        height_variance=height_variance,
        slope_variance=slope_variance,
    )


def power_by_octave(surface: Surface) -> tuple[FloatArray, FloatArray]:
    """Return the variance of the heights of a surface by octaves of wave numbers.

    Octave k holds the wave numbers from 2^k to 2^(k+1) times 2 pi over the longest
    period.

    Returns:
        The lowest wave number of each octave in rad/m, and the height variance of each
        octave in m^2, both of shape (octaves,).

    Example:
        >>> heights = 0.1 * np.cos(2 * np.pi * 5 * np.arange(64) / 64)
        >>> lowest, variance = power_by_octave(Surface(heights, (2 * np.pi,)))
        >>> float(lowest[np.argmax(variance)]), float(variance.max().round(9))
        (4.0, 0.005)
    """
    rings = radial_spectrum(surface)
    first = 2 * math.pi / max(surface.periods)
    ratio = rings.wavenumber / first * (1 + BAND_TOLERANCE)
    octave = np.maximum(np.floor(np.log2(ratio)), 0).astype(np.intp)
    variance = np.bincount(octave, weights=rings.height_variance)
    lowest = first * np.exp2(np.arange(variance.size))
    return lowest, np.asarray(variance, dtype=np.float64)


def cumulative_slope_variance(surface: Surface, wavenumber: ArrayLike) -> FloatArray:
    """Return xi^2(q), the variance of the slope of all modes up to a wave number.

    Args:
        surface: a surface or line.
        wavenumber: q in rad/m, of any shape.

    Returns:
        The dimensionless variances, exact sums over the Fourier modes, of the shape of
        `wavenumber`.
    """
    q_given = np.asarray(wavenumber, dtype=np.float64)
    limits, position = np.unique(q_given.ravel(), return_inverse=True)
    sums = np.zeros(limits.size + 1)
    for q, variance in _mode_variances(surface):
        index = np.searchsorted(limits, q.ravel() * (1 - BAND_TOLERANCE))
        slope_variance = (variance * q * q).ravel()
        sums += np.bincount(index, weights=slope_variance, minlength=sums.size)
    return np.cumsum(sums[:-1])[position].reshape(q_given.shape)


# --- filters --------------------------------------------------------------------------


def filtered(
    surface: Surface, wavenumber_high: float, wavenumber_low: float = 0.0
) -> Surface:
    """Return a surface with only the modes of a band, on the same grid.

    Without a lower limit the result is the surface that the theory sees at the
    magnification wavenumber_high / q_0.  An analytic spectrum is cut off with the short
    waves, and dropped if long waves are removed or nothing of it remains.  The mean
    height is kept.

    Args:
        surface: any surface or line.
        wavenumber_high: the largest |q| that is kept, in rad/m.
        wavenumber_low: the smallest |q| that is kept, in rad/m.

    Raises:
        InvalidScene: unless 0 <= wavenumber_low < wavenumber_high.

    Example:
        >>> heights = 0.1 * np.cos(2 * math.pi * np.arange(8) / 4)
        >>> surface = Surface(heights, (2 * math.pi,))
        >>> float(abs(filtered(surface, 1.0).heights).max()) < 1e-15
        True
    """
    require_kind("surface", surface, Surface)
    high = positive("wavenumber_high", wavenumber_high, "rad/m", finite=False)
    expected = f"a number between 0 and wavenumber_high = {high:g} rad/m"
    low = number("wavenumber_low", wavenumber_low, expected, lambda q: 0 <= q < high)
    spectrum = surface.spectrum
    if spectrum is not None:
        if high > spectrum.wavenumber_low >= low * (1 - BAND_TOLERANCE):
            spectrum = truncate(spectrum, high, len(surface.shape))
        else:
            spectrum = None
    shortest = max(2 * math.pi / high, surface.shortest_wavelength or 0.0)
    band = f"{low!r} to {high!r}" if low else f"{high!r}"
    return replace(
        surface,
        heights=band_pass(surface.heights, surface.periods, high, low),
        spectrum=spectrum,
        shortest_wavelength=shortest or None,
        recipe=f"filtered/1 {band} of {surface.fingerprint}",
    )


def band_pass(
    heights: FloatArray, periods: tuple[float, ...], highest: float, lowest: float = 0.0
) -> FloatArray:
    """Return heights without the waves outside a band, as a read-only array.

    Args:
        heights: (nx, ny) or (nx,), in m.
        periods: lengths in m after which the heights repeat.
        highest: the largest |q| that is kept, in rad/m.
        lowest: the smallest |q| that is kept, in rad/m; q = 0 is always kept.
    """
    low = lowest * (1 - BAND_TOLERANCE)
    high = highest * (1 + BAND_TOLERANCE)
    modes = ducc0.fft.r2c(heights)
    for rows, q in _wavenumbers(heights.shape, periods):
        block = modes.reshape(-1, modes.shape[-1])[rows]
        block[(q > high) | ((q < low) & (q > 0))] = 0.0
    modes *= 1 / heights.size
    if heights.ndim == 2:
        ducc0.fft.c2c(modes, axes=(0,), forward=False, out=modes)
    passed = np.empty(heights.shape)
    last = heights.ndim - 1
    ducc0.fft.c2r(modes, (last,), heights.shape[-1], forward=False, out=passed)
    passed.flags.writeable = False
    return passed


# --- modes ----------------------------------------------------------------------------


def _multiplicity(surface: Surface) -> FloatArray:
    """Return how many Fourier modes each column of a real transform stands for.

    A real transform has no negative wave numbers along its last axis, so that a column
    stands for itself and its mirror image: 2 modes.  The first column, and the last one
    of an even grid, stand for 1.

    Args:
        surface: a surface or line with n points along its last axis.

    Returns:
        An array of shape (n // 2 + 1,).
    """
    n = surface.shape[-1]
    k = np.arange(n // 2 + 1)
    return np.where((k == 0) | (2 * k == n), 1.0, 2.0)


def _mode_variances(surface: Surface) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield wave numbers and height variances of a surface's Fourier modes.

    The modes are those of a real transform, of shape (rows, n // 2 + 1) for n points
    along the last axis.  They are yielded by blocks of rows, to limit the memory; a
    line is one row.

    Yields:
        |q| in rad/m and the part of h_rms^2 in m^2 of each mode, with that of its
        mirror image at -q.  The variance of the mean height is set to 0.
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
    """Yield the wave numbers of a real Fourier transform, by blocks of rows.

    Args:
        shape: the number of grid points along each direction; a line is one row.
        periods: the lengths of the period along each direction, in m.

    Yields:
        The slice of the rows of a block, and |q| in rad/m of its modes, of shape (rows,
        n // 2 + 1) for n points along the last axis.
    """
    q_last = 2 * math.pi / periods[-1] * np.arange(shape[-1] // 2 + 1)
    size = shape[0] if len(shape) == 2 else 1
    q_first = 2 * math.pi * np.fft.fftfreq(size, periods[0] / size)
    step = max(1, _BLOCK // q_last.size)
    for start in range(0, q_first.size, step):
        rows = slice(start, start + step)
        yield rows, np.hypot(q_first[rows, None], q_last)
