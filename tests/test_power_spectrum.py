"""Power spectra of surfaces: Parseval, moments against differentiation, rings, partial slopes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from epcontact.scene import SelfAffineSpectrum, Surface
from epcontact.surfaces import SelfAffine, Sinusoid, filtered
from epcontact.surfaces.power_spectrum import (
    cumulative_slope_variance,
    power_spectral_density,
    radial_spectrum,
    surface_moments,
)
from epcontact.surfaces.spectrum import Moments, density

# Square, oblong, even, odd, mixed, lines; periods that fit none of them by accident.
# The heights are about as large as the period, which changes nothing of what is tested here.
pytestmark = pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")

GRIDS = [
    ((16, 16), (1.0, 1.0)),
    ((15, 15), (1.0, 1.0)),
    ((16, 15), (2.0, 0.7)),
    ((9, 32), (0.3, 5.0)),
    ((2, 3), (1.0, 1.0)),
    ((64,), (3.0,)),
    ((63,), (3.0,)),
    ((2,), (1.0,)),
]
# Roundings of a transform of up to 500 points, relative to sums of positive terms.
ROUNDING = 1e-13


def noise(shape: tuple[int, ...], periods: tuple[float, ...], seed: int = 1) -> Surface:
    """White noise about a mean of 5: power in every mode, Nyquist's too."""
    return Surface(5 + np.random.default_rng(seed).standard_normal(shape), periods)


@pytest.mark.parametrize(("shape", "periods"), GRIDS)
def test_parseval_is_exact(shape: tuple[int, ...], periods: tuple[float, ...]) -> None:
    surface = noise(shape, periods)
    variance = surface.heights.var()
    moments = surface_moments(surface)
    rings = radial_spectrum(surface)
    cell = math.prod(2 * math.pi / p for p in periods)
    assert moments.rms_height**2 == pytest.approx(variance, rel=ROUNDING)
    assert rings.height_variance.sum() == pytest.approx(variance, rel=ROUNDING)
    assert np.sum(rings.density * rings.modes) * cell == pytest.approx(variance, rel=ROUNDING)
    assert rings.slope_variance.sum() == pytest.approx(moments.rms_slope**2, rel=ROUNDING)


@pytest.mark.parametrize(("shape", "periods"), GRIDS)
def test_moments_are_those_of_the_spectral_derivatives(
    shape: tuple[int, ...], periods: tuple[float, ...]
) -> None:
    surface = noise(shape, periods)
    modes = np.fft.fftn(surface.heights)
    axes = [2 * np.pi * np.fft.fftfreq(n, d) for n, d in zip(shape, surface.spacing, strict=True)]
    q = np.meshgrid(*axes, indexing="ij")
    gradient = [np.fft.ifftn(1j * component * modes) for component in q]
    laplacian = np.fft.ifftn(-sum(component**2 for component in q) * modes)
    moments = surface_moments(surface)
    slope = math.sqrt(sum(np.mean(np.abs(g) ** 2) for g in gradient))
    curvature = math.sqrt(np.mean(np.abs(laplacian) ** 2)) / len(shape)
    assert moments.rms_slope == pytest.approx(slope, rel=ROUNDING)
    assert moments.rms_curvature == pytest.approx(curvature, rel=ROUNDING)


@pytest.mark.parametrize(("shape", "periods"), [g for g in GRIDS if len(g[0]) == 2])
def test_the_density_of_each_mode(shape: tuple[int, ...], periods: tuple[float, ...]) -> None:
    surface = noise(shape, periods)
    got = power_spectral_density(surface)
    area = math.prod(periods)
    modes = np.abs(np.fft.fft2(surface.heights)) ** 2 / surface.heights.size**2
    expected = modes[:, : shape[1] // 2 + 1] * area / (2 * np.pi) ** 2
    expected[0, 0] = 0
    assert got == pytest.approx(expected, rel=1e-11, abs=1e-14 * expected.max())


@pytest.mark.parametrize("points", [32, 33])
def test_a_line_of_one_wave(points: int) -> None:
    surface = Sinusoid((2.0,), (points,), 0.3, waves=4).build()
    c1 = power_spectral_density(surface)
    dq = 2 * math.pi / 2.0
    assert c1[4] * dq == pytest.approx(0.3**2 / 2, rel=1e-14)
    assert np.delete(c1, 4) == pytest.approx(np.zeros(c1.size - 1), abs=1e-17)
    moments = surface_moments(surface)
    q = 4 * dq
    assert moments == Moments(
        pytest.approx(0.3 / math.sqrt(2), rel=1e-13),
        pytest.approx(0.3 * q / math.sqrt(2), rel=1e-13),
        pytest.approx(0.3 * q**2 / math.sqrt(2), rel=1e-13),
        dimension=1,
    )
    assert moments.nayak == pytest.approx(1.0, rel=1e-13)


def test_every_mode_lies_in_one_ring() -> None:
    for shape, periods in GRIDS:
        surface = noise(shape, periods)
        rings = radial_spectrum(surface)
        count = math.prod(shape) - 1 if len(shape) == 2 else shape[0] // 2
        assert rings.modes.sum() == count
        assert np.all(rings.wavenumber <= rings.upper_edge)
        assert np.all(np.diff(rings.upper_edge) > 0)


def test_radial_average_of_an_isotropic_surface_is_its_spectrum() -> None:
    spectrum = SelfAffineSpectrum(0.7, 2 * math.pi, 8 * math.pi, 200 * math.pi, 0.1)
    surface = SelfAffine(spectrum, (1.0, 1.0), (300, 300), seed=3).build()
    rings = radial_spectrum(surface)
    inside = (rings.wavenumber > 200) & (rings.upper_edge < 600)
    expected = density(spectrum, rings.wavenumber[inside])
    # The amplitudes are not random, so a ring of width w at q = k w differs from its middle by
    # s (s + 1) / (24 k^2) = 6e-4 for k = 32, s = 3.4, by where its modes happen to lie (of the
    # same order), and by the one factor that makes an integral of the sum over modes.
    ratio = rings.density[inside] / expected
    assert ratio == pytest.approx(np.full(ratio.size, ratio[-1]), rel=1.5e-3)
    assert ratio[-1] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(("shape", "periods"), GRIDS)
def test_partial_slopes_are_those_of_the_filtered_surface(
    shape: tuple[int, ...], periods: tuple[float, ...]
) -> None:
    surface = noise(shape, periods)
    rings = radial_spectrum(surface)
    partial = cumulative_slope_variance(surface, rings.upper_edge)
    total = surface_moments(surface).rms_slope ** 2
    assert partial == pytest.approx(np.cumsum(rings.slope_variance), rel=ROUNDING)
    assert partial[-1] == pytest.approx(total, rel=ROUNDING)
    for cut in (rings.wavenumber[0], rings.upper_edge[len(rings.upper_edge) // 2]):
        left = surface_moments(filtered(surface, float(cut))).rms_slope ** 2
        got = cumulative_slope_variance(surface, cut)
        assert got.shape == ()
        assert got == pytest.approx(left, rel=1e-12, abs=1e-14 * total)


def test_partial_slopes_keep_the_order_they_are_asked_in() -> None:
    surface = noise((16, 16), (1.0, 1.0))
    q = np.array([[50.0, 20.0], [20.0, 1.0]])
    got = cumulative_slope_variance(surface, q)
    assert got[0, 0] > got[0, 1] == got[1, 0] > got[1, 1] == 0


def test_a_flat_surface_has_no_bandwidth() -> None:
    moments = surface_moments(Surface(np.ones((8, 8)), (1.0, 1.0)))
    assert moments.rms_height == moments.rms_slope == moments.rms_curvature == 0
    assert math.isnan(moments.nayak)
