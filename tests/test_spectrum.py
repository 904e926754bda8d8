"""Analytic self-affine spectra: densities and closed-form moments."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from epcontact.errors import InvalidScene
from epcontact.scene import SelfAffineSpectrum
from epcontact.surfaces.spectrum import (
    density,
    rms_height,
    slope_variance_up_to,
    spectral_moment,
    spectrum_moments,
    truncated,
)

# The exponents at which an integral turns into a logarithm, their neighbours, and ordinary ones.
HURST = [0.0, 1e-13, 1e-5, 0.3, 0.5, 0.8, 1 - 1e-9, 1.0]
PAPER = SelfAffineSpectrum(0.8, 2.5e4, 1e5, 64e5, 1.0)


def exact_shape_moment(
    spectrum: SelfAffineSpectrum, order: int, dimension: int, upper: float
) -> mpmath.mpf:
    """The defining integral with C_0 = 1, by quadrature in 40 digits."""
    with mpmath.workdps(40):
        exponent = -(2 * mpmath.mpf(spectrum.hurst) + dimension)
        q0, qr, q1 = (
            mpmath.mpf(q)
            for q in (
                spectrum.wavenumber_low,
                spectrum.wavenumber_roll_off,
                min(spectrum.wavenumber_high, upper),
            )
        )

        def integrand(t: mpmath.mpf) -> mpmath.mpf:  # over t = ln q
            q = mpmath.exp(t)
            power = (q / qr) ** exponent if q > qr else mpmath.mpf(1)
            return q**order * power * q**dimension

        knots = sorted({mpmath.log(q) for q in (q0, min(qr, q1), q1)})
        weight = 2 * mpmath.pi if dimension == 2 else 1
        return weight * mpmath.quad(integrand, knots)


@pytest.mark.parametrize("dimension", [1, 2])
@pytest.mark.parametrize("hurst", HURST)
def test_moments_equal_their_integrals(hurst: float, dimension: int) -> None:
    spectrum = SelfAffineSpectrum(hurst, 3.0, 7.0, 900.0, 0.4)
    full_slope = exact_shape_moment(spectrum, 2, dimension, 900.0)
    for order in (0, 2, 4):
        for upper in (5.0, 7.0, 60.0, 900.0):
            exact = 0.4**2 * exact_shape_moment(spectrum, order, dimension, upper) / full_slope
            got = float(spectral_moment(spectrum, order, dimension, upper))
            # A few roundings, each amplified by at most ln(q_1/q_0) = 6 through the power.
            assert got == pytest.approx(float(exact), rel=1e-14)


@pytest.mark.parametrize("dimension", [1, 2])
@pytest.mark.parametrize("hurst", HURST)
def test_density_integrates_to_its_moments(hurst: float, dimension: int) -> None:
    spectrum = SelfAffineSpectrum(hurst, 2.0, 5.0, 300.0, 0.7)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    slope_variance = height_variance = 0.0
    for a, b in [(2.0, 5.0), (5.0, 300.0)]:
        t = math.log(b / a) / 2 * (nodes + 1)
        q = a * np.exp(t)
        dq = math.log(b / a) / 2 * weights * q
        measure = 2 * np.pi * q if dimension == 2 else 1.0
        slope_variance += np.sum(measure * q**2 * density(spectrum, q, dimension) * dq)
        height_variance += np.sum(measure * density(spectrum, q, dimension) * dq)
    assert slope_variance == pytest.approx(0.7**2, rel=1e-12)
    assert math.sqrt(height_variance) == pytest.approx(rms_height(spectrum, dimension), rel=1e-12)
    slope_variance = spectral_moment(spectrum, 2, dimension)
    assert math.sqrt(slope_variance) == pytest.approx(0.7, rel=1e-15)


def test_density_has_the_right_shape() -> None:
    q = np.array([2.4e4, 2.5e4, 1e5, 2e5, 64e5, 65e5])
    c = density(PAPER, q)
    assert c[0] == c[-1] == 0
    assert c[1] == c[2] > 0
    assert c[3] / c[2] == pytest.approx(2 ** (-2 * 1.8), rel=1e-14)
    line = density(PAPER, q, dimension=1)
    assert line[3] / line[2] == pytest.approx(2 ** (-2.6), rel=1e-14)


def test_a_limit_typed_with_seven_digits_is_inside() -> None:
    period = 2.513274e-4  # of 2 pi / 2.5e4
    q = 2 * math.pi / period * np.array([1, 256])
    assert np.all(density(PAPER, q) > 0)
    assert np.all(density(PAPER, [2.5e4 * 0.99999, 64e5 * 1.00001]) == 0)


@given(
    hurst=st.floats(0, 1),
    roll_off=st.floats(1, 100),
    width=st.floats(1.01, 1e6),
    dimension=st.sampled_from([1, 2]),
)
def test_partial_slope_grows_from_nothing_to_all(
    hurst: float, roll_off: float, width: float, dimension: int
) -> None:
    spectrum = SelfAffineSpectrum(hurst, 1.0, roll_off, roll_off * width, 0.3)
    q = np.geomspace(0.5, 2 * roll_off * width, 50)
    partial = slope_variance_up_to(spectrum, q, dimension)
    assert partial.shape == q.shape
    assert partial[0] == 0
    assert partial[-1] == pytest.approx(0.09, rel=1e-15)
    # Where the spectrum adds less than a rounding, two neighbours may differ by one.
    assert np.all(np.diff(partial) >= -1e-16)


@pytest.mark.parametrize("dimension", [1, 2])
def test_truncation_keeps_the_density(dimension: int) -> None:
    for cut in (6e4, 1e5, 3e6, 1e8):
        narrow = truncated(PAPER, cut, dimension)
        q = np.geomspace(2.5e4, min(cut, 64e5), 20)
        assert density(narrow, q, dimension) == pytest.approx(
            density(PAPER, q, dimension), rel=1e-13
        )
    with pytest.raises(InvalidScene, match="leaves nothing"):
        truncated(PAPER, 2.5e4)


def test_moments_of_a_narrow_ring_are_those_of_one_wave() -> None:
    spectrum = SelfAffineSpectrum(0.5, 10.0, 10.0, 10.0 * (1 + 1e-9), 0.2)
    moments = spectrum_moments(spectrum)
    assert moments.rms_height == pytest.approx(0.02, rel=1e-8)
    assert moments.rms_curvature == pytest.approx(0.2 * 10 / 2, rel=1e-8)
    # One |q|: profile moments are in the ratio 1 : 1/2 : 3/8.
    assert moments.nayak == pytest.approx(1.5, rel=1e-7)


def test_scales_as_it_must() -> None:
    doubled = SelfAffineSpectrum(0.8, 5e4, 2e5, 128e5, 1.0)
    assert rms_height(doubled) == pytest.approx(rms_height(PAPER) / 2, rel=1e-14)
    steeper = SelfAffineSpectrum(0.8, 2.5e4, 1e5, 64e5, 3.0)
    assert density(steeper, 1e6) == pytest.approx(9 * density(PAPER, 1e6), rel=1e-14)


def test_refuses_what_has_no_density() -> None:
    ring = SelfAffineSpectrum(0.8, 1e5, 1e5, 1e5, 1.0)
    with pytest.raises(InvalidScene, match="band of some width"):
        density(ring, 1e5)
    with pytest.raises(InvalidScene, match="dimension is 3"):
        rms_height(PAPER, 3)
