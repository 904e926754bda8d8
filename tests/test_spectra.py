"""Analytic spectra and those of heights: integrals, Parseval, moments, rings, partial
slopes.
"""

import math

import mpmath
import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from scipy.stats import kurtosis, skew

from epcontact.errors import InvalidScene
from epcontact.scene import SelfAffineSpectrum, Surface
from epcontact.surfaces import SelfAffine, filtered
from epcontact.surfaces.power_spectrum import (
    cumulative_slope_variance,
    power_by_octave,
    radial_spectrum,
    surface_moments,
    topography,
)
from epcontact.surfaces.spectrum import density, spectral_moment, truncate

# The heights are about as large as the period, which changes nothing in these tests.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

# --- analytic spectra -----------------------------------------------------------------

#: Exponents at which an integral becomes a logarithm, their neighbours, and usual ones.
HURST = [0.0, 1e-13, 1e-5, 0.3, 0.5, 0.8, 1 - 1e-9, 1.0]
PAPER = SelfAffineSpectrum(0.8, 2.5e4, 1e5, 64e5, 1.0)


def exact_shape_moment(spectrum, order, dimension, highest):
    """Return the integral of q^order times a spectrum's shape, by quadrature in 40
    digits.

    Args:
        spectrum: its shape is 1 up to the roll-off, and a power of q beyond.
        order: exponent of the wavenumber q in rad/m.
        dimension: 1 for a line, 2 for a surface.
        highest: end of the integral in rad/m.
    """
    with mpmath.workdps(40):
        exponent = -(2 * mpmath.mpf(spectrum.hurst) + dimension)
        q0 = mpmath.mpf(spectrum.wavenumber_low)
        qr = mpmath.mpf(spectrum.wavenumber_roll_off)
        q1 = mpmath.mpf(min(spectrum.wavenumber_high, highest))

        def integrand(log_q):
            """Return the integrand over ln q, with the Jacobian of q."""
            q = mpmath.exp(log_q)
            return max(q / qr, 1) ** exponent * q ** (order + dimension)

        knots = sorted({mpmath.log(q) for q in (q0, min(qr, q1), q1)})
        angle = 2 * mpmath.pi if dimension == 2 else 1
        return float(angle * mpmath.quad(integrand, knots))


@pytest.mark.parametrize("dimension", [1, 2])
@pytest.mark.parametrize("hurst", HURST)
def test_moments_equal_their_integrals(hurst, dimension):
    """Moments up to a wavenumber in rad/m are integrals by quadrature, scaled to the
    rms slope of 0.4.
    """
    spectrum = SelfAffineSpectrum(hurst, 3.0, 7.0, 900.0, 0.4)
    slope_variance = exact_shape_moment(spectrum, 2, dimension, 900.0)
    factor = 0.4**2 / slope_variance
    assert density(spectrum, 5.0, dimension) == pytest.approx(factor, rel=1e-13)
    for order in (0, 2, 4):
        for highest in (5.0, 7.0, 60.0, 900.0):
            found = spectral_moment(spectrum, order, dimension, highest)
            exact = factor * exact_shape_moment(spectrum, order, dimension, highest)
            # A few roundings, which the power multiplies by ln(q_1/q_0) = 6 at most.
            assert found == pytest.approx(exact, rel=1e-14)


@pytest.mark.parametrize("dimension", [1, 2])
def test_density_is_flat_then_a_power_and_zero_outside(dimension):
    """The density is constant up to the roll-off, falls with exponent -(2 H +
    dimension), and is 0 outside of the band.

    Wavenumbers that were typed with seven digits are inside.
    """
    low = [2.4e4, 2.5e4 * 0.99999, 2.5e4 * (1 - 1e-7), 1e5]
    high = [2e5, 64e5 * (1 + 1e-7), 64e5 * 1.00001, 65e5]
    values = density(PAPER, [*low, *high], dimension)
    assert values[[0, 1, 6, 7]].tolist() == [0, 0, 0, 0]
    assert values[2] == values[3] > values[4] > values[5] > 0
    assert values[4] / values[3] == pytest.approx(2 ** -(1.6 + dimension), rel=1e-14)


def test_what_has_no_density_is_refused():
    """A band without width and a dimension of 3 raise InvalidScene."""
    with pytest.raises(InvalidScene, match="band of some width"):
        density(SelfAffineSpectrum(0.8, 1e5, 1e5, 1e5, 1.0), 1e5)
    with pytest.raises(InvalidScene, match="dimension is 3"):
        density(PAPER, 1e5, 3)


@pytest.mark.parametrize("dimension", [1, 2])
@pytest.mark.parametrize("cut", [6e4, 1e5, 3e6, 1e8])
def test_truncation_keeps_the_density(cut, dimension):
    """A spectrum that is cut at a wavenumber in rad/m has the same density below the
    cut.
    """
    q = np.geomspace(2.5e4, min(cut, 64e5), 20)
    found = density(truncate(PAPER, cut, dimension), q, dimension)
    assert_allclose(found, density(PAPER, q, dimension), rtol=1e-13)


def test_truncation_to_nothing_is_refused():
    """A cut at the lowest wavenumber raises InvalidScene."""
    with pytest.raises(InvalidScene, match="leaves nothing"):
        truncate(PAPER, 2.5e4)


# --- spectra of heights ---------------------------------------------------------------

#: Square, oblong, even, odd, mixed, lines; periods that fit none of them by accident.
GRIDS = [
    ((16, 16), (1.0, 1.0)),
    ((15, 16), (2.0, 0.7)),
    ((9, 31), (0.3, 5.0)),
    ((2, 3), (1.0, 1.0)),
    ((64,), (3.0,)),
    ((63,), (3.0,)),
    ((2,), (1.0,)),
]
#: Roundings of a transform of up to 500 points, relative to sums of positive terms.
ROUNDING = 1e-13


@pytest.fixture(params=GRIDS, ids=str)
def surface(request):
    """Return white noise about a mean of 5 m, which has power in every mode, the
    Nyquist modes included.
    """
    shape, periods = request.param
    return Surface(5 + np.random.default_rng(1).standard_normal(shape), periods)


def wave_vector(surface):
    """Return the components of the wave vector q, in rad/m, of each mode of
    `numpy.fft.fftn`, as one array a direction.
    """
    axes = []
    for points, spacing in zip(surface.shape, surface.spacing, strict=True):
        axes.append(2 * np.pi * np.fft.fftfreq(points, spacing))
    return np.meshgrid(*axes, indexing="ij")


def table_of_modes(surface):
    """Return a table of wavenumber q, variance, slope variance and ring of all modes
    but the mean.

    A line has its positive modes alone, with the variance of both signs. Rings have the
    width of the first wavenumber.
    """
    modes = np.fft.fftn(surface.heights) / surface.heights.size
    q = np.hypot.reduce(wave_vector(surface))
    table = pd.DataFrame({"q": q.ravel(), "variance": np.abs(modes.ravel()) ** 2})[1:]
    if modes.ndim == 1:
        table = table[: modes.size // 2]
        table["variance"] *= np.where(2 * table.index == modes.size, 1, 2)
    table["slope_variance"] = table["variance"] * table["q"] ** 2
    table["ring"] = np.ceil(table["q"] / first_wavenumber(surface) - 0.5)
    return table


def first_wavenumber(surface):
    """Return the lowest wavenumber of a surface in rad/m."""
    return 2 * math.pi / max(surface.periods)


def test_moments_are_mean_squares_of_derivatives(surface):
    """The rms height, slope and curvature are those of derivatives by Fourier
    transforms.
    """
    modes = np.fft.fftn(surface.heights)
    slope_variance = 0.0
    laplacian = np.zeros_like(modes)
    for component in wave_vector(surface):
        slope = np.fft.ifftn(1j * component * modes)
        slope_variance += np.mean(np.abs(slope) ** 2)
        laplacian -= np.fft.ifftn(component**2 * modes)
    curvature = math.sqrt(np.mean(np.abs(laplacian) ** 2)) / modes.ndim
    exact = (surface.heights.std(), math.sqrt(slope_variance), curvature)
    assert surface_moments(surface) == pytest.approx(exact, rel=ROUNDING)
    assert topography(surface)[:3] == pytest.approx(exact, rel=ROUNDING)


def test_skewness_and_kurtosis_are_those_of_the_heights(surface):
    """Skewness and excess kurtosis are those of scipy, by moments of the heights."""
    found = topography(surface)
    for value, moment in (
        (found.skewness, skew(surface.heights, axis=None)),
        (found.excess_kurtosis, kurtosis(surface.heights, axis=None)),
    ):
        assert value == pytest.approx(moment, rel=1e-12, abs=1e-12)


def test_rings_are_sums_over_their_modes(surface):
    """Each ring of the radial spectrum holds the mean wavenumber, number, density and
    variances of its modes.
    """
    groups = table_of_modes(surface).groupby("ring")
    sums = groups.sum()
    count = groups.size()
    cell = math.prod(2 * math.pi / period for period in surface.periods)
    rings = radial_spectrum(surface)
    upper_edge = (sums.index + 0.5) * first_wavenumber(surface)
    for found, exact in (
        (rings.wavenumber, sums["q"] / count),
        (rings.modes, count),
        (rings.density, sums["variance"] / count / cell),
        (rings.upper_edge, upper_edge),
        (rings.height_variance, sums["variance"]),
        (rings.slope_variance, sums["slope_variance"]),
    ):
        assert_allclose(found, exact, rtol=1e-12)


def test_octaves_are_sums_over_their_rings(surface):
    """Each octave holds the height variance of its rings and begins at a power of two
    of the first wavenumber.
    """
    rings = radial_spectrum(surface)
    first = first_wavenumber(surface)
    octave = np.floor(np.log2(rings.wavenumber / first) + 1e-9)
    exact = pd.Series(rings.height_variance).groupby(octave).sum()
    lowest, variance = power_by_octave(surface)
    assert_allclose(variance[variance > 0], exact, rtol=1e-12)
    assert_allclose(lowest, first * 2.0 ** np.arange(octave.max() + 1), rtol=1e-14)


def test_partial_slopes_are_those_of_rings_and_of_filtered_surfaces(surface):
    """The slope variance up to a wavenumber is the sum over rings, and the slope
    variance of the filtered surface.
    """
    rings = radial_spectrum(surface)
    edges = rings.upper_edge[::-1, None]
    found = cumulative_slope_variance(surface, edges)
    exact = np.cumsum(rings.slope_variance)
    assert_allclose(found[::-1, 0], exact, rtol=ROUNDING)
    for cut in (rings.wavenumber[0], rings.upper_edge[len(rings.upper_edge) // 2]):
        slope = surface_moments(filtered(surface, float(cut))).rms_slope
        found = cumulative_slope_variance(surface, cut)
        assert found == pytest.approx(slope**2, rel=1e-12, abs=1e-14 * exact[-1])


def test_radial_average_of_an_isotropic_surface_is_its_spectrum():
    """A ring of width w at q = k w differs from its middle by s (s + 1)/(24 k^2), which
    is 6e-4 for k = 32 and s = 3.4, and by where its modes lie.
    """
    spectrum = SelfAffineSpectrum(0.7, 2 * math.pi, 8 * math.pi, 200 * math.pi, 0.1)
    surface = SelfAffine(spectrum, (1.0, 1.0), (300, 300), seed=3).build()
    rings = radial_spectrum(surface)
    inside = (rings.wavenumber > 200) & (rings.upper_edge < 600)
    ratio = rings.density[inside] / density(spectrum, rings.wavenumber[inside])
    assert ratio == pytest.approx(np.full(ratio.size, ratio[-1]), rel=1.5e-3)
    # One factor makes an integral of the sum over modes.
    assert ratio[-1] == pytest.approx(1.0, abs=0.02)
