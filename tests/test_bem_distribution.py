"""Pressure distributions: counts, ends, and their limit for a vanishing spacing."""

import math

import numpy as np
import pytest

from epcontact.bem.areas.distribution import (
    end_fits,
    extrapolate,
    pressure_distribution,
)
from epcontact.errors import InvalidScene
from epcontact.results import Areas

#: 30 % apart, 20 % plastic at 3.0, the rest with P proportional to the pressure.
EXACT = Areas(0.7, 0.5, 0.2)
HARDNESS = 3.0


@pytest.fixture(scope="module")
def random_pressures():
    """Return a 100 x 100 field of pressures with the fractions of EXACT, in units of
    HARDNESS/3.
    """
    p = np.zeros(10_000)
    p[:2000] = HARDNESS
    p[2000:7000] = HARDNESS * np.sqrt((np.arange(5000) + 0.5) / 5000)
    return np.random.default_rng(17).permuted(p).reshape(100, 100)


def test_fractions_add_up(random_pressures):
    """The cumulative distribution of elastic points runs from 0 to their
    fraction, 0.5.
    """
    found = pressure_distribution(random_pressures, HARDNESS, 50)
    assert found.plastic == 0.2
    assert found.cumulative[0] == 0
    assert found.cumulative[-1] == pytest.approx(0.5, abs=1e-15)
    assert np.all(np.diff(found.cumulative) >= 0)
    # Exactly quadratic, to one point of ten thousand.
    expected = 0.5 * (found.pressure / HARDNESS) ** 2
    np.testing.assert_allclose(found.cumulative, expected, atol=1e-4)


def test_edges_belong_to_the_bin_below():
    """A pressure on the edge of two bins counts in the lower bin; that at the cap is
    plastic.
    """
    p = np.array([0.0, 0.5, 1.0, 1.0, 2.0])
    found = pressure_distribution(p, 2.0, [0.0, 0.5, 1.0, 2.0])
    np.testing.assert_allclose(found.cumulative, [0, 0.2, 0.6, 0.6])
    assert found.plastic == 0.2


def test_bins_of_an_elastic_body_reach_the_largest_pressure():
    """Without a hardness the bins end at the largest pressure, and no point
    is plastic.
    """
    p = np.array([0.0, 0.5, 1.0, 1.0, 2.0])
    found = pressure_distribution(p, math.inf, 7)
    assert found.pressure[-1] == 2.0
    assert found.plastic == 0
    assert found.cumulative[-1] == pytest.approx(0.8)


def test_end_fits_of_a_linear_density(random_pressures):
    """The fits of the density at zero and at the hardness find a density p/9 and its
    slopes.
    """
    low, high = end_fits(random_pressures, HARDNESS, 0.6, (EXACT, EXACT))
    assert low.density == pytest.approx(0, abs=2e-4)
    assert low.slope == pytest.approx(1 / 9, rel=5e-3)
    assert low.continuum_slope == pytest.approx(1 / 9, rel=5e-3)
    assert high.density == pytest.approx(1 / 3, rel=5e-3)
    assert high.slope == pytest.approx(-1 / 9, rel=2e-2)


def test_the_surplus_area_of_counted_points_leaves_the_ends(random_pressures):
    """The slopes in the continuum limit lack the area that counting points adds.

    The corrected areas have 0.01 less contact and 0.02 more plastic area than the
    count.
    """
    corrected = Areas(0.69, 0.47, 0.22)
    low, high = end_fits(random_pressures, HARDNESS, 0.6, (EXACT, corrected))
    assert low.continuum_slope == pytest.approx(1 / 9 - 2 * 0.01 / 0.36, rel=1e-2)
    area = 0.5 * (1 - 0.8**2)
    assert high.continuum_slope == pytest.approx(2 * (area - 0.02) / 0.36, rel=1e-2)


@pytest.mark.parametrize("order", [0.5, 1.0, 2.0])
def test_extrapolation_is_exact_on_its_own_law(order):
    """Values 3 - 2 n^-order extrapolate to 3 with the error 0."""
    n = np.array([4.0, 8.0, 16.0])
    assert extrapolate(n, 3 - 2 * n**-order, order) == pytest.approx((3, 0), abs=1e-7)


def test_the_error_of_an_extrapolation():
    """The error estimate covers a term of higher order, and is the last change for two
    values.
    """
    n = np.array([4.0, 8.0, 16.0])
    limit, error = extrapolate(n, 3 - 2 / n + 5 / n**2, 1.0)
    assert abs(limit - 3) <= error
    assert extrapolate(n[:2], np.array([1.5, 1.25]), 1.0) == pytest.approx((1.0, 0.25))


@pytest.mark.parametrize("bins", [0, [0.5, 1.0], [0.0, 1.0, 1.0], [0.0], [[0.0, 1.0]]])
def test_bad_bins(random_pressures, bins):
    """Bins that do not rise from 0, or are no list, raise `InvalidScene`."""
    with pytest.raises(InvalidScene, match="bins"):
        pressure_distribution(random_pressures, HARDNESS, bins)
