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

#: 30 % apart, 20 % plastic at 3.0, the rest with P ~ sigma.
EXACT = Areas(0.7, 0.5, 0.2)


@pytest.fixture(scope="module")
def random_pressures():
    """A field with the shares of EXACT."""
    p = np.zeros(10_000)
    p[:2000] = 3.0
    p[2000:7000] = 3.0 * np.sqrt((np.arange(5000) + 0.5) / 5000)
    return np.random.default_rng(17).permuted(p).reshape(100, 100)


def test_shares_add_up(random_pressures):
    d = pressure_distribution(random_pressures, 3.0, 50)
    assert d.plastic == 0.2
    assert d.cumulative[-1] == pytest.approx(0.5, abs=1e-15)
    assert d.cumulative[0] == 0
    assert np.all(np.diff(d.cumulative) >= 0)
    # Exactly quadratic, to one point of ten thousand.
    np.testing.assert_allclose(d.cumulative, 0.5 * (d.pressure / 3) ** 2, atol=1e-4)
    assert pressure_distribution(random_pressures, 3.0 * (1 + 4e-16), 5).plastic == 0.2


def test_edges_belong_to_the_bin_below():
    p = np.array([0.0, 0.5, 1.0, 1.0, 2.0])
    d = pressure_distribution(p, 2.0, [0.0, 0.5, 1.0, 2.0])
    np.testing.assert_allclose(d.cumulative, [0, 0.2, 0.6, 0.6])
    assert d.plastic == 0.2
    elastic = pressure_distribution(p, math.inf, 7)
    assert (elastic.pressure[-1], elastic.plastic) == (2.0, 0)
    assert elastic.cumulative[-1] == pytest.approx(0.8)


def test_graded_bins_are_dense_where_the_density_vanishes():
    edges, one = (graded_pressures(1.0, 400, both_ends=both) for both in (True, False))
    assert np.all(np.diff(edges) > 0)
    np.testing.assert_allclose(edges + edges[::-1], 1.0, atol=1e-15)
    assert edges[1] < 2e-5
    assert one[-1] - one[-2] > 100 * one[1]


def test_end_fits_of_a_linear_density(random_pressures):
    low, high = end_fits(random_pressures, 3.0, 0.6, (EXACT, EXACT))
    found = low.slope, low.continuum_slope, high.density
    assert found == pytest.approx((1 / 9, 1 / 9, 1 / 3), rel=5e-3)
    assert low.density == pytest.approx(0, abs=2e-4)
    assert high.slope == pytest.approx(-1 / 9, rel=2e-2)
    elastic, none = end_fits(np.minimum(random_pressures, 2.9), math.inf, 0.6, (EXACT, EXACT))
    assert none is None
    assert elastic.slope == pytest.approx(low.slope)
    # The surplus area of counted points leaves the ends.
    low, high = end_fits(random_pressures, 3.0, 0.6, (EXACT, Areas(0.69, 0.47, 0.22)))
    share = 0.5 * (1 - 0.8**2)
    wanted = 1 / 9 - 2 * 0.01 / 0.36, 2 * (share - 0.02) / 0.36
    assert (low.continuum_slope, high.continuum_slope) == pytest.approx(wanted, rel=1e-2)


def test_extrapolation_is_exact_on_its_own_law():
    n = np.array([4.0, 8.0, 16.0])
    for order in (0.5, 1.0, 2.0):
        assert extrapolated(n, 3 - 2 * n**-order, order) == pytest.approx((3, 0), abs=1e-12)
    assert extrapolated([4, 8], [1.5, 1.25]) == pytest.approx((1.0, 0.25))
    limit, error = extrapolated(n, 3 - 2 / n + 5 / n**2)
    assert abs(limit - 3) <= error


def test_bad_input(random_pressures):
    for bins in (0, [0.5, 1.0], [0.0, 1.0, 1.0], [0.0]):
        with pytest.raises(InvalidScene, match="bins"):
            pressure_distribution(random_pressures, 3.0, bins)
    for window in (0.0, 3.5, math.nan):
        with pytest.raises(InvalidScene, match="window"):
            end_fits(random_pressures, 3.0, window, (EXACT, EXACT))
    for points, values in (([4], [1.0]), ([4, 4], [1.0, 2.0]), ([4, 8], [1.0])):
        with pytest.raises(InvalidScene, match="two values"):
            extrapolated(points, values)


def solved(heights, load, hardness=math.inf):
    """Pressure, and (raw, corrected) areas."""
    q = rfft_wavenumbers(heights.shape, (1.0,) * heights.ndim)
    q.flat[0] = np.inf
    options = bem.Options(tolerance=1e-7)
    found = bem.solve_pressure(heights, 2 / q, load, hardness, options=options)
    spacing = [1 / n for n in heights.shape]
    areas = estimate_areas(found.pressure, found.gap(heights), hardness, spacing, 1.0)
    return found.pressure, areas[:2]


def test_slope_of_a_sinusoidal_line():
    """p = 2 p* cos(psi) sqrt(s - sin^2 psi): P(sigma) -> sigma (2/pi)/(p*^2 4 sqrt s (1-s)^1.5)."""
    n, load, window = 2048, 0.4, 0.15 * math.pi
    p, areas = solved(np.cos(2 * np.pi * (np.arange(n) + 0.3) / n), load * math.pi)
    total, exact = areas[0].total, waves.line_contact_fraction(load)
    assert total == pytest.approx(exact, abs=1 / n)
    low, _ = end_fits(p, math.inf, window, areas)
    # x(p) of the pressure itself, over the same window.
    x = np.linspace(0, 0.5, 400_001)
    share = 2 * np.mean((waves.line_pressure(x, load) * math.pi <= window) & (x <= total / 2))
    inside = 2 * (share * 0.5 - (total - exact)) / window**2
    first = 2 / math.pi / (4 * math.pi**2 * math.sqrt(load) * (1 - load) ** 1.5)
    assert (inside, first) == pytest.approx((low.continuum_slope,) * 2, rel=0.05)


@pytest.mark.long
def test_the_density_vanishes_at_both_ends():
    """Raw P(0+) and P(hardness-) fall as the root of the spacing; their limit is zero."""
    points, hardness, high = (4, 8, 16, 32), 0.6, 32
    spectrum, found = SelfAffineSpectrum(0.8, 2 * np.pi, 8 * np.pi, 2 * np.pi * high, 1.0), []
    for k in points:
        surface = SelfAffine(spectrum, (1.0, 1.0), (k * high,) * 2, 12).build()
        p, areas = solved(surface.heights, 0.15, hardness)
        found.append(end_fits(p, hardness, 0.2 * hardness, areas))
    for densities in np.array([[fit.density for fit in pair] for pair in found]).T:
        limit, error = extrapolated(points, densities, 0.5)
        assert densities[0] > 1.7 * densities[-1]
        # A tenth of the coarsest: one surface, a window of a fifth of the hardness.
        assert abs(limit) < max(3 * error, 0.1 * densities[0])
    # The slope is the same from 8 points a wavelength on.
    slopes = [low.continuum_slope for low, _ in found]
    assert slopes[1] == pytest.approx(slopes[-1], rel=0.1)
