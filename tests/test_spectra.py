"""Analytic spectra and those of heights: integrals, Parseval, moments, rings, partial
slopes.
"""

import math

import mpmath
import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

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

# The heights are about as large as the period, which changes nothing of what is tested
# here.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

# The exponents at which an integral turns into a logarithm, their neighbours, and
# ordinary ones.
HURST = [0.0, 1e-13, 1e-5, 0.3, 0.5, 0.8, 1 - 1e-9, 1.0]
PAPER = SelfAffineSpectrum(0.8, 2.5e4, 1e5, 64e5, 1.0)


def exact_shape_moment(s, order, dimension, upper):
    """The defining integral with C_0 = 1, by quadrature in 40 digits."""
    with mpmath.workdps(40):
        exponent = -(2 * mpmath.mpf(s.hurst) + dimension)
        limits = (
            s.wavenumber_low,
            s.wavenumber_roll_off,
            min(s.wavenumber_high, upper),
        )
        q0, qr, q1 = map(mpmath.mpf, limits)

        def integrand(t):  # over t = ln q
            q = mpmath.exp(t)
            return q**order * ((q / qr) ** exponent if q > qr else 1) * q**dimension

        knots = sorted({mpmath.log(q) for q in (q0, min(qr, q1), q1)})
        return (2 * mpmath.pi if dimension == 2 else 1) * mpmath.quad(integrand, knots)


@pytest.mark.parametrize("dimension", [1, 2])
@pytest.mark.parametrize("hurst", HURST)
def test_moments_equal_their_integrals(hurst, dimension):
    spectrum = SelfAffineSpectrum(hurst, 3.0, 7.0, 900.0, 0.4)
    full_slope = exact_shape_moment(spectrum, 2, dimension, 900.0)
    plateau = float(density(spectrum, 5.0, dimension))
    assert plateau * full_slope == pytest.approx(0.4**2, rel=1e-13)
    for order in (0, 2, 4):
        for upper in (5.0, 7.0, 60.0, 900.0):
            exact = (
                0.4**2
                * exact_shape_moment(spectrum, order, dimension, upper)
                / full_slope
            )
            got = float(spectral_moment(spectrum, order, dimension, upper))
            # A few roundings, each amplified by at most ln(q_1/q_0) = 6 through the
            # power.
            assert got == pytest.approx(float(exact), rel=1e-14)


def test_density_is_flat_then_a_power_and_nothing_outside():
    q = np.array([2.4e4, 2.5e4 * (1 - 1e-7), 1e5, 2e5, 64e5 * (1 + 1e-7), 65e5])
    for dimension in (1, 2):
        c = density(PAPER, q, dimension)
        assert c[0] == c[-1] == 0
        assert c[1] == c[2] > 0 < c[4]  # a limit typed with seven digits is inside
        assert c[3] / c[2] == pytest.approx(2 ** -(1.6 + dimension), rel=1e-14)
    assert np.all(density(PAPER, [2.5e4 * 0.99999, 64e5 * 1.00001]) == 0)
    steeper = SelfAffineSpectrum(0.8, 2.5e4, 1e5, 64e5, 3.0)
    assert density(steeper, 1e6) == pytest.approx(9 * density(PAPER, 1e6), rel=1e-14)
    with pytest.raises(InvalidScene, match="band of some width"):
        density(SelfAffineSpectrum(0.8, 1e5, 1e5, 1e5, 1.0), 1e5)
    with pytest.raises(InvalidScene, match="dimension is 3"):
        density(PAPER, 1e5, 3)


@pytest.mark.parametrize("dimension", [1, 2])
def test_truncation_keeps_the_density(dimension):
    for cut in (6e4, 1e5, 3e6, 1e8):
        q = np.geomspace(2.5e4, min(cut, 64e5), 20)
        narrow = density(truncate(PAPER, cut, dimension), q, dimension)
        assert_allclose(narrow, density(PAPER, q, dimension), rtol=1e-13)
    with pytest.raises(InvalidScene, match="leaves nothing"):
        truncate(PAPER, 2.5e4)


# Square, oblong, even, odd, mixed, lines; periods that fit none of them by accident.
GRIDS = [
    ((16, 16), (1.0, 1.0)),
    ((15, 16), (2.0, 0.7)),
    ((9, 31), (0.3, 5.0)),
    ((2, 3), (1.0, 1.0)),
    ((64,), (3.0,)),
    ((63,), (3.0,)),
    ((2,), (1.0,)),
]
# Roundings of a transform of up to 500 points, relative to sums of positive terms.
ROUNDING = 1e-13


def noise(shape, periods):
    """White noise about a mean of 5: power in every mode, Nyquist's too."""
    return Surface(5 + np.random.default_rng(1).standard_normal(shape), periods)


@pytest.mark.parametrize(("shape", "periods"), GRIDS)
def test_moments_and_rings_are_parseval_s(shape, periods):
    surface = noise(shape, periods)
    modes = np.fft.fftn(surface.heights)
    axes = [
        2 * np.pi * np.fft.fftfreq(n, d)
        for n, d in zip(shape, surface.spacing, strict=True)
    ]
    q = np.meshgrid(*axes, indexing="ij")
    slope2 = sum(
        np.mean(np.abs(np.fft.ifftn(1j * component * modes)) ** 2) for component in q
    )
    laplacian = np.fft.ifftn(-sum(component**2 for component in q) * modes)
    curvature = math.sqrt(np.mean(np.abs(laplacian) ** 2)) / len(shape)
    exact = (surface.heights.std(), math.sqrt(slope2), curvature)
    assert surface_moments(surface) == pytest.approx(exact, rel=ROUNDING)
    h = surface.heights.ravel() - surface.heights.mean()
    shape_of_heights = (h**3).mean() / exact[0] ** 3, (h**4).mean() / exact[0] ** 4 - 3
    assert topography(surface) == pytest.approx(
        (*exact, *shape_of_heights), rel=1e-12, abs=1e-12
    )
    # Each ring, and each octave, mode by mode; a line's density is one-sided.
    of = {
        "q": np.sqrt(sum(one**2 for one in q)),
        "v": np.abs(modes / surface.heights.size) ** 2,
    }
    table = pd.DataFrame({name: values.ravel() for name, values in of.items()})[1:]
    if len(shape) == 1:
        table = table[: shape[0] // 2]
        table = table.assign(v=table["v"] * np.where(2 * table.index == shape[0], 1, 2))
    width, cell = (
        2 * math.pi / max(periods),
        math.prod(2 * math.pi / p for p in periods),
    )
    table = table.assign(
        s=table["v"] * table["q"] ** 2, ring=np.ceil(table["q"] / width - 0.5)
    )
    sums, rings = table.groupby("ring").sum(), radial_spectrum(surface)
    count = table.groupby("ring").size()
    for got, exact in (
        (rings.wavenumber, sums["q"] / count),
        (rings.modes, count),
        (rings.density, sums["v"] / count / cell),
        (rings.upper_edge, (sums.index + 0.5) * width),
        (rings.height_variance, sums["v"]),
        (rings.slope_variance, sums["s"]),
    ):
        assert_allclose(got, exact, rtol=1e-12)
    lowest, power = power_by_octave(surface)
    octave = np.floor(np.log2(sums["q"] / count / width) + 1e-9)
    assert_allclose(power[power > 0], sums["v"].groupby(octave).sum(), rtol=1e-12)
    assert_allclose(lowest, width * 2.0 ** np.arange(octave.max() + 1), rtol=1e-14)
    # Partial slopes are those of the rings, and of the filtered surface.
    partial = cumulative_slope_variance(surface, rings.upper_edge[::-1, None])
    assert_allclose(partial[::-1, 0], np.cumsum(rings.slope_variance), rtol=ROUNDING)
    for cut in (rings.wavenumber[0], rings.upper_edge[len(rings.upper_edge) // 2]):
        left = surface_moments(filtered(surface, float(cut))).rms_slope ** 2
        got = cumulative_slope_variance(surface, cut)
        assert got == pytest.approx(left, rel=1e-12, abs=1e-14 * slope2)


def test_radial_average_of_an_isotropic_surface_is_its_spectrum():
    spectrum = SelfAffineSpectrum(0.7, 2 * math.pi, 8 * math.pi, 200 * math.pi, 0.1)
    rings = radial_spectrum(
        SelfAffine(spectrum, (1.0, 1.0), (300, 300), seed=3).build()
    )
    inside = (rings.wavenumber > 200) & (rings.upper_edge < 600)
    # A ring of width w at q = k w differs from its middle by s (s + 1)/(24 k^2) = 6e-4
    # for k = 32, s = 3.4, and by where its modes lie; one factor makes an integral of
    # the sum over modes.
    ratio = rings.density[inside] / density(spectrum, rings.wavenumber[inside])
    assert ratio == pytest.approx(np.full(ratio.size, ratio[-1]), rel=1.5e-3)
    assert ratio[-1] == pytest.approx(1.0, abs=0.02)
