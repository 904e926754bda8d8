"""The approximation is as good as it says, and no better."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad

from epcontact.errors import InvalidScene
from epcontact.persson import areas
from epcontact.persson.three_gaussians import (
    RANGE,
    three_gaussian_density,
    three_gaussian_elastic_area,
    three_gaussian_error,
)


@pytest.mark.parametrize("share", [0.05, 1 / 12, 0.3, 0.5, 0.8, 0.95])
def test_within_its_range(share):
    error = three_gaussian_error(share, np.geomspace(1e-4, RANGE, 12))["relative_density_error"]
    assert error.max() < 1e-3
    found = three_gaussian_elastic_area(RANGE, share, 1.0)
    assert_allclose(found, areas(RANGE, share, 1.0).elastic, rtol=1e-3)


def test_beyond_its_range_at_the_load_of_the_paper():
    """p0 / hardness = 1/12: 24 % of the maximum at 0.1, more than all of it at 0.19."""
    columns = three_gaussian_error(1 / 12, [0.03, 0.1, 0.19])
    assert_allclose(columns["relative_density_error"], [1.4e-4, 0.24, 1.74], rtol=0.02)
    assert_allclose(three_gaussian_elastic_area(0.19, 1 / 12, 1.0), 0.0109, atol=5e-5)
    assert_allclose(areas(0.19, 1 / 12, 1.0).elastic, 0.0505, atol=5e-5)


def test_the_error_grows_with_the_roughness():
    error = three_gaussian_error(0.2)["relative_density_error"]
    assert error.shape == (60,)
    late = error[error > 1e-12]
    assert np.all(np.diff(late) > 0)


def test_the_area_is_the_integral_of_the_density():
    for G in (100.0, 4000.0):
        whole, _ = quad(
            three_gaussian_density, 0, 150, args=(G, 12.5, 150), epsabs=0, points=[12.5]
        )
        assert_allclose(three_gaussian_elastic_area(G, 12.5, 150.0), whole, rtol=1e-9)


def test_units_do_not_matter():
    one = three_gaussian_density([1.0, 20.0], 500.0, 12.5, 150.0)
    other = three_gaussian_density([1e9, 20e9], 500e18, 12.5e9, 150e9)
    assert_allclose(one, other * 1e9, rtol=1e-12)


@pytest.mark.parametrize("arguments", [(0.0, 1.0, 2.0), (1.0, 1.0, math.inf), (1.0, 2.0, 2.0)])
def test_what_it_is_not_for_is_refused(arguments):
    with pytest.raises(InvalidScene):
        three_gaussian_elastic_area(*arguments)
