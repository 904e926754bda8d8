"""Pressure distributions: counts, ends, and their limit for a vanishing grid
spacing.
"""

import math

import numpy as np
import pytest

from epcontact.bem.areas.distribution import (
    end_fits,
    extrapolated,
    pressure_distribution,
)
from epcontact.errors import InvalidScene
from epcontact.results import Areas

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


def test_edges_belong_to_the_bin_below():
    p = np.array([0.0, 0.5, 1.0, 1.0, 2.0])
    d = pressure_distribution(p, 2.0, [0.0, 0.5, 1.0, 2.0])
    np.testing.assert_allclose(d.cumulative, [0, 0.2, 0.6, 0.6])
    assert d.plastic == 0.2
    elastic = pressure_distribution(p, math.inf, 7)
    assert (elastic.pressure[-1], elastic.plastic) == (2.0, 0)
    assert elastic.cumulative[-1] == pytest.approx(0.8)


def test_end_fits_of_a_linear_density(random_pressures):
    low, high = end_fits(random_pressures, 3.0, 0.6, (EXACT, EXACT))
    found = low.slope, low.continuum_slope, high.density
    assert found == pytest.approx((1 / 9, 1 / 9, 1 / 3), rel=5e-3)
    assert low.density == pytest.approx(0, abs=2e-4)
    assert high.slope == pytest.approx(-1 / 9, rel=2e-2)
    # The surplus area of counted points leaves the ends.
    low, high = end_fits(random_pressures, 3.0, 0.6, (EXACT, Areas(0.69, 0.47, 0.22)))
    share = 0.5 * (1 - 0.8**2)
    wanted = 1 / 9 - 2 * 0.01 / 0.36, 2 * (share - 0.02) / 0.36
    assert (low.continuum_slope, high.continuum_slope) == pytest.approx(
        wanted, rel=1e-2
    )


def test_extrapolation_is_exact_on_its_own_law():
    n = np.array([4.0, 8.0, 16.0])
    for order in (0.5, 1.0, 2.0):
        assert extrapolated(n, 3 - 2 * n**-order, order) == pytest.approx(
            (3, 0), abs=1e-7
        )
    assert extrapolated(n[:2], np.array([1.5, 1.25]), 1.0) == pytest.approx((1.0, 0.25))
    limit, error = extrapolated(n, 3 - 2 / n + 5 / n**2, 1.0)
    assert abs(limit - 3) <= error


def test_bad_bins(random_pressures):
    for bins in (0, [0.5, 1.0], [0.0, 1.0, 1.0], [0.0]):
        with pytest.raises(InvalidScene, match="bins"):
            pressure_distribution(random_pressures, 3.0, bins)
