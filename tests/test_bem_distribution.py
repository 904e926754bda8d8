"""Pressure distributions: counts, ends, and their limit for a vanishing grid spacing."""

import math

import numpy as np
import pytest

from epcontact import bem
from epcontact.bem.areas.distribution import (
    end_fits,
    extrapolated,
    graded_pressures,
    pressure_distribution,
)
from epcontact.bem.areas.rim_correction import estimate_areas
from epcontact.bem.kernel import rfft_wavenumbers
from epcontact.errors import InvalidScene
from epcontact.reference import waves
from epcontact.results import Areas
from epcontact.scene import SelfAffineSpectrum
from epcontact.surfaces import SelfAffine


@pytest.fixture(scope="module")
def random_pressures():
    """A field with exact shares: 30 % apart, 20 % plastic at 3.0, the rest with P ~ sigma."""
    rng = np.random.default_rng(17)
    p = np.zeros((100, 100))
    p.flat[:2000] = 3.0
    p.flat[2000:7000] = 3.0 * np.sqrt((np.arange(5000) + 0.5) / 5000)
    return rng.permuted(p.reshape(-1)).reshape(p.shape)


def test_shares_add_up(random_pressures):
    d = pressure_distribution(random_pressures, 3.0, 50)
    assert d.plastic == 0.2
    assert d.cumulative[-1] == pytest.approx(0.5, abs=1e-15)
    assert d.cumulative[0] == 0
    assert np.all(np.diff(d.cumulative) >= 0)
    # Exactly quadratic, to one point of ten thousand.
    np.testing.assert_allclose(d.cumulative, 0.5 * (d.pressure / 3) ** 2, atol=1e-4)


def test_edges_belong_to_the_bin_below():
    p = np.array([0.0, 0.5, 1.0, 1.0, 2.0])
    d = pressure_distribution(p, 2.0, [0.0, 0.5, 1.0, 2.0])
    np.testing.assert_allclose(d.cumulative, [0, 0.2, 0.6, 0.6])
    assert d.plastic == 0.2
    elastic = pressure_distribution(p, math.inf, 7)
    assert elastic.pressure[-1] == 2.0
    assert elastic.cumulative[-1] == pytest.approx(0.8)
    assert elastic.plastic == 0


def test_plastic_to_rounding(random_pressures):
    hardness = 3.0 * (1 + 4e-16)
    assert pressure_distribution(random_pressures, hardness, 5).plastic == 0.2


def test_graded_bins_hold_equal_shares_where_the_density_rises_linearly():
    edges = graded_pressures(1.0, 400, both_ends=True)
    first = np.diff(edges**2)[:5]
    assert np.all(np.diff(edges) > 0)
    np.testing.assert_allclose(edges + edges[::-1], 1.0, atol=1e-15)
    assert edges[1] < 2e-5
    one = graded_pressures(1.0, 400, both_ends=False)
    assert one[-1] - one[-2] > 100 * one[1]
    assert np.all(first > 0)


def test_end_fits_of_a_linear_density(random_pressures):
    exact = Areas(0.7, 0.5, 0.2)
    low, high = end_fits(random_pressures, 3.0, 0.6, (exact, exact))
    assert low.density == pytest.approx(0, abs=2e-4)
    assert low.slope == pytest.approx(1 / 9, rel=5e-3)
    assert low.continuum_slope == pytest.approx(1 / 9, rel=5e-3)
    assert high.density == pytest.approx(1 / 3, rel=2e-3)
    assert high.slope == pytest.approx(-1 / 9, rel=2e-2)
    elastic, none = end_fits(np.minimum(random_pressures, 2.9), math.inf, 0.6, (exact, exact))
    assert none is None
    assert elastic.slope == pytest.approx(low.slope)


def test_surplus_area_leaves_the_end(random_pressures):
    raw, corrected = Areas(0.7, 0.5, 0.2), Areas(0.69, 0.47, 0.22)
    low, high = end_fits(random_pressures, 3.0, 0.6, (raw, corrected))
    assert low.continuum_slope == pytest.approx(1 / 9 - 2 * 0.01 / 0.36, rel=1e-2)
    share = 0.5 * (1 - 0.8**2)
    assert high.continuum_slope == pytest.approx(2 * (share - 0.02) / 0.36, rel=1e-2)


def test_extrapolation_is_exact_on_its_own_law():
    n = np.array([4.0, 8.0, 16.0])
    for order in (0.5, 1.0, 2.0):
        limit, error = extrapolated(n, 3 - 2 * n**-order, order)
        assert limit == pytest.approx(3, abs=1e-12)
        assert error < 1e-12
    limit, error = extrapolated([4, 8], [1.5, 1.25])
    assert limit == pytest.approx(1.0)
    assert error == pytest.approx(0.25)
    limit, error = extrapolated(n, 3 - 2 / n + 5 / n**2)
    assert abs(limit - 3) <= error


def test_bad_input(random_pressures):
    for bins in (0, [0.5, 1.0], [0.0, 1.0, 1.0], [0.0]):
        with pytest.raises(InvalidScene, match="bins"):
            pressure_distribution(random_pressures, 3.0, bins)
    areas = Areas(0.7, 0.5, 0.2)
    for window in (0.0, 3.5, math.nan):
        with pytest.raises(InvalidScene, match="window"):
            end_fits(random_pressures, 3.0, window, (areas, areas))
    for points, values in (([4], [1.0]), ([4, 4], [1.0, 2.0]), ([4, 8], [1.0])):
        with pytest.raises(InvalidScene, match="two values"):
            extrapolated(points, values)


def solve(heights, load, hardness=math.inf):
    q = rfft_wavenumbers(heights.shape, (1.0,) * heights.ndim)
    q.flat[0] = np.inf
    options = bem.Options(tolerance=1e-7)
    solution = bem.solve_pressure(heights, 2 / q, load, hardness, options=options)
    return solution.pressure, solution.displacement + solution.offset - heights


def test_slope_of_a_sinusoidal_line():
    """p = 2 p* cos(psi) sqrt(s - sin^2 psi): P(sigma) -> sigma (2/pi)/(p*^2 4 sqrt s (1-s)^1.5)."""
    n, load = 2048, 0.4
    p, g = solve(np.cos(2 * np.pi * (np.arange(n) + 0.3) / n), load * math.pi)
    raw, corrected, _ = estimate_areas(p, g, math.inf, (1 / n,), 1.0)
    assert raw.total == pytest.approx(waves.line_contact_fraction(load), abs=1 / n)
    window = 0.15 * math.pi
    low, _ = end_fits(p, math.inf, window, (raw, corrected))
    # x(p) of the pressure itself, over the same window.
    x = np.linspace(0, 0.5, 400_001)
    share = 2 * np.mean((waves.line_pressure(x, load) * math.pi <= window) & (x <= raw.total / 2))
    inside = share * 0.5 - (raw.total - waves.line_contact_fraction(load))
    assert low.continuum_slope == pytest.approx(2 * inside / window**2, rel=0.05)
    first = 2 / math.pi / (4 * math.pi**2 * math.sqrt(load) * (1 - load) ** 1.5)
    assert low.continuum_slope == pytest.approx(first, rel=0.05)


@pytest.mark.long
def test_the_density_vanishes_at_both_ends():
    """Raw P(0+) and P(hardness-) fall as the root of the spacing; their limit is zero."""
    points, hardness, load, high = (4, 8, 16, 32), 0.6, 0.15, 32
    low, high_end, slopes = [], [], []
    spectrum = SelfAffineSpectrum(0.8, 2 * np.pi, 8 * np.pi, 2 * np.pi * high, 1.0)
    for k in points:
        n = k * high
        p, g = solve(SelfAffine(spectrum, (1.0, 1.0), (n, n), 12).build().heights, load, hardness)
        areas = estimate_areas(p, g, hardness, (1 / n, 1 / n), 1.0)[:2]
        fits = end_fits(p, hardness, 0.2 * hardness, areas)
        low.append(fits[0].density)
        high_end.append(fits[1].density)
        slopes.append(fits[0].continuum_slope)
    for densities in (low, high_end):
        limit, error = extrapolated(points, densities, 0.5)
        assert densities[0] > 1.7 * densities[-1]
        # A tenth of the coarsest: one surface, a window of a fifth of the hardness.
        assert abs(limit) < max(3 * error, 0.1 * densities[0])
    # The slope is the same from 8 points a wavelength on.
    assert slopes[1] == pytest.approx(slopes[-1], rel=0.1)
