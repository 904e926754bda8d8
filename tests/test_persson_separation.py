"""Elastic energy and mean separation: limits, orders, inverse, and boundary elements."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.special import erf

from epcontact import bem
from epcontact.errors import InvalidScene
from epcontact.persson import EnergyReduction, Theory, analytic_roughness, areas
from epcontact.persson.roughness import surface_roughness
from epcontact.persson.separation import elastic_energy, flattened_roughness, mean_separation
from epcontact.scene import Load, Material, Scene, SelfAffineSpectrum
from epcontact.surfaces import SelfAffine
from epcontact.surfaces.spectrum import density, rms_height

SPECTRUM = SelfAffineSpectrum(0.8, 2.5e4, 1e5, 16e5, 1.0)
MODULUS = 250e9
GAMMA = EnergyReduction(0.536)


def model(bands=512, hardness=math.inf):
    return Theory(analytic_roughness(SPECTRUM, bands), MODULUS, GAMMA, hardness)


def test_full_contact_stores_the_exact_energy():
    """(pi/2) E* int q^2 C dq, and no gap is left."""
    exact, _ = quad(lambda q: q**2 * density(SPECTRUM, q), 2.5e4, 16e5, points=[1e5], limit=200)
    assert_allclose(elastic_energy(model(), 1e13), 0.5 * math.pi * MODULUS * exact, rtol=1e-6)
    assert mean_separation(model(), 1e13) == 0


def test_separation_of_one_wave_number_is_the_published_integral():
    """A narrow band at q has ubar = sqrt(pi) q^2 C dq w int_p^inf (dp'/p') [...] e^{-(w p'/E*)^2}.

    Written for a step of the spectrum: half of its energy density is at G(x), 0 < x < 1 of its
    slope variance, which the bands resolve.
    """
    narrow = SelfAffineSpectrum(0.8, 1e5, 1e5, 1.0001e5, 0.1)
    made = Theory(analytic_roughness(narrow, 1024), MODULUS, GAMMA)
    p = 2e9

    def rate(pressure, x):
        spread = 2 * math.sqrt(x * MODULUS**2 * 0.01 / 8)
        A = erf(pressure / spread)
        slope = 2 / math.sqrt(math.pi) / spread * math.exp(-((pressure / spread) ** 2))
        return (0.536 + 3 * 0.464 * A**2) * slope / pressure

    inner = lambda x: quad(rate, p, 2e11, args=(x,), epsabs=0, epsrel=1e-9, limit=200)[0]  # noqa: E731
    share = quad(inner, 1e-4, 1, epsabs=0, epsrel=1e-7, limit=200)[0]
    energy = 0.25 * MODULUS * 0.01 / 1e5
    assert_allclose(mean_separation(made, p), energy * share, rtol=2e-4)  # width of the band


def test_work_of_the_load_is_the_elastic_energy():
    """dU_el = -p d(ubar) between two pressures."""
    made = model()
    low, high = 2e9, 2.02e9
    work = 2.01e9 * (mean_separation(made, low) - mean_separation(made, high))
    assert_allclose(work, elastic_energy(made, high) - elastic_energy(made, low), rtol=1e-4)


def test_order_in_the_load_is_four():
    made = model(64)
    exact = mean_separation(made, 5e9, 128)
    errors = [abs(mean_separation(made, 5e9, n) - exact) for n in (4, 8, 16)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all(orders > 3.5)
    assert errors[1] < 1e-6 * exact  # the default


def test_order_in_the_bands_is_two():
    values = [mean_separation(model(n), 12.5e9) for n in (64, 128, 256, 512, 4096)]
    errors = np.abs(np.subtract(values[:-1], values[-1]))
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all((orders > 1.7) & (orders < 2.4))
    assert errors[-1] < 5e-5 * values[-1]  # the default


def test_small_loads_part_the_surfaces_logarithmically():
    """Yang and Persson's law: between two decades of pressure the separation falls alike."""
    p = np.array([1e3, 1e4, 1e5])
    u = np.array([mean_separation(model(), x) for x in p])
    drop = -np.diff(u)
    assert_allclose(drop[0], drop[1], rtol=1e-4)
    assert 0.2 < drop[0] / math.log(10) / rms_height(SPECTRUM) < 1.0  # u_0 of about h_rms / 2


def test_great_hardness_is_the_elastic_body():
    assert mean_separation(model(64, 1e15), 5e9) == mean_separation(model(64), 5e9)
    assert_allclose(elastic_energy(model(64, 1e15), 5e9), elastic_energy(model(64), 5e9), 1e-14)


def test_flow_lets_the_surfaces_approach_and_flattens_the_short_waves_first():
    p = 12.5e9
    gaps = [mean_separation(model(128, h), p) for h in (math.inf, 150e9, 75e9, 40e9)]
    assert np.all(np.diff(gaps) < 0)
    made = model(128, 75e9)
    left = flattened_roughness(made, p).slope_variance / made.roughness.slope_variance
    assert np.all(np.diff(left) <= 0)
    assert left[0] == 1
    assert left[-1] < 0.5
    variance = made.roughness.slope_variance
    middle_of_band = np.cumsum(variance) - variance / 2
    plastic = areas(0.536 * MODULUS**2 / 8 * middle_of_band, p, 75e9).plastic * 75e9 / p
    assert_allclose(left, 1 - plastic**6, rtol=1e-12)


def test_the_flattened_band_knows_its_own_slope():
    made = flattened_roughness(model(128, 75e9), 12.5e9)
    assert_allclose(made.slope_variance_up_to(made.highest), made.rms_slope**2, rtol=1e-12)
    assert made.slope_variance_up_to(made.lowest) == 0


def test_a_load_at_the_hardness_is_refused():
    with pytest.raises(InvalidScene, match="mean_pressure"):
        mean_separation(model(64, 10e9), 10e9)
    with pytest.raises(InvalidScene, match="mean_pressure"):
        elastic_energy(model(64, 10e9), 11e9)


def test_the_energy_takes_a_local_rule_where_the_areas_follow_none():
    """The rules "constant" and "xu" describe no single wave number; the energy's is "persson"."""
    energies = [
        elastic_energy(replace(model(64), reduction=EnergyReduction(0.42, rule)), 5e9)
        for rule in ("constant", "xu", "persson")
    ]
    assert energies[0] == energies[1] == energies[2]


@pytest.mark.parametrize(
    ("hardness", "low", "high"),
    # Measured over the loads below: 0.99 to 1.07, and 1.05 to 1.09; +-0.08 around them is
    # about what one surface of 32 waves a side differs from the next.
    [(math.inf, 0.91, 1.15), (150e9, 0.97, 1.17)],
)
def test_separation_is_near_that_of_boundary_elements(hardness, low, high):
    surface = SelfAffine(SPECTRUM, (2 * math.pi / 2.5e4,) * 2, (256, 256), 5).build()
    made = Theory(surface_roughness(surface), MODULUS, GAMMA, hardness)
    for p in (5e9, 12.5e9, 30e9):
        found = bem.solve(Scene(surface, Material(MODULUS, 0.0, hardness), Load(p)))
        open_gap = np.maximum(found.fields["gap"], 0).mean()
        assert low < mean_separation(made, p) / open_gap < high
