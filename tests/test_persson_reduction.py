"""The energy reduction: each rule's equation, the order of the stepping, limits, the paper."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import quad

from epcontact.errors import InvalidScene
from epcontact.persson import EnergyReduction, areas, gamma_columns
from epcontact.persson.reduction import reduced_diffusion

TAU = 250.0**2 / 8  # of the paper's scene, GPa^2: slope 1, full contact
#: Each rule with a gamma that was published for it.
PUBLISHED = (
    EnergyReduction(0.536, "constant"),
    EnergyReduction(0.45, "persson"),
    EnergyReduction(5 / 9, "wang_muser"),
    EnergyReduction(0.42, "xu"),
)
LOCAL = [r for r in PUBLISHED if r.rule in ("persson", "wang_muser")]
_name = lambda r: r.rule  # noqa: E731


def test_rules_at_their_ends():
    for reduction in PUBLISHED:
        assert_allclose(reduction.factor(0.0), reduction.gamma)
        if reduction.rule != "constant":
            assert_allclose(reduction.factor(1.0), 1.0)
    half = [float(r.factor(0.5)) for r in PUBLISHED]
    expected = [0.536, 0.45 + 0.55 / 4, 5 / 9 - 1 / 18 + (2 / 3) / 16, 0.42 + 0.58 / 2]
    assert_allclose(half, expected, rtol=1e-14)


@pytest.mark.parametrize("reduction", LOCAL, ids=_name)
@pytest.mark.parametrize("hardness", [math.inf, 150.0])
def test_the_differential_rules_solve_their_equation(reduction, hardness):
    """int_0^G dG' / S(A(G')) = tau, by an adaptive quadrature."""
    tau = np.array([0.3, 5.0, 60.0, TAU])
    found = reduced_diffusion(reduction, tau, 12.5, hardness)

    def rate(log_g):
        G = math.exp(log_g)
        return G / float(reduction.factor(areas(G, 12.5, hardness).total))

    for G, target in zip(found, tau, strict=True):
        start = 1e-12
        integral, _ = quad(rate, math.log(start), math.log(G), epsabs=0, epsrel=1e-12, limit=500)
        assert_allclose(integral + start, target, rtol=1e-10)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.floats(-6, 8), st.floats(0.05, 1.0), st.floats(-4, -0.01), st.booleans())
def test_the_whole_band_rule_solves_its_equation(log_tau, gamma, log_share, elastic):
    reduction = EnergyReduction(gamma, "xu")
    hardness = math.inf if elastic else 10.0**-log_share
    tau = 10.0**log_tau
    G = reduced_diffusion(reduction, tau, 1.0, hardness)
    A = areas(G, 1.0, hardness).total
    assert_allclose(G, (gamma + (1 - gamma) * A) * tau, rtol=1e-11)


@pytest.mark.parametrize("reduction", LOCAL, ids=_name)
def test_order_of_the_stepping_is_six(reduction):
    exact = reduced_diffusion(reduction, TAU, 12.5, 150.0, steps_per_decade=96)
    errors = np.array(
        [
            abs(reduced_diffusion(reduction, TAU, 12.5, 150.0, steps_per_decade=n) / exact - 1)
            for n in (2, 4, 8)
        ]
    )
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all(orders > 5)
    default = reduced_diffusion(reduction, TAU, 12.5, 150.0)
    assert_allclose(default, exact, rtol=1e-11)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.sampled_from(PUBLISHED),
    st.floats(0.05, 1.0),
    st.floats(-10, -0.001),
    st.floats(-6, 6),
    st.booleans(),
)
def test_reduced_diffusion_is_monotone_between_gamma_and_one(
    published, gamma, log_share, log_scale, elastic
):
    """However small the load: G / tau falls from 1 towards gamma, or wang_muser's minimum."""
    reduction = EnergyReduction(gamma, published.rule)
    hardness = math.inf if elastic else 10.0**-log_share
    tau = 10.0**log_scale * np.geomspace(1e-3, 1e3, 25)
    G = reduced_diffusion(reduction, tau, 1.0, hardness)
    assert np.all(np.diff(G) > 0)
    least = float(reduction.factor(np.linspace(0, 1, 1001)).min())
    assert np.all(tau * (1 + 1e-12) >= G)
    assert np.all(least * tau * (1 - 1e-6) <= G)


def test_limits():
    for reduction in PUBLISHED:
        assert reduced_diffusion(reduction, 0.0, 1.0) == 0
        unity = EnergyReduction(1.0, reduction.rule)
        if reduction.rule != "wang_muser":
            assert_allclose(reduced_diffusion(unity, TAU, 12.5), TAU, rtol=1e-13)
        if reduction.rule != "constant":
            # Nearly full contact: A = 1, nothing is reduced.
            assert_allclose(reduced_diffusion(reduction, 1.0, 1e3), 1.0, rtol=1e-14)
        # Hardly any contact: gamma.  A = sqrt(8/pi) p0 / (E* xi) / sqrt(gamma) = 1e-7 or so.
        small = reduced_diffusion(reduction, TAU, 1e-5)
        assert_allclose(small, reduction.gamma * TAU, rtol=1e-5)


def test_shapes_follow_the_argument():
    tau = np.array([[0.0, 1.0], [50.0, TAU]])
    for reduction in PUBLISHED:
        G = reduced_diffusion(reduction, tau, 12.5, 150.0)
        assert G.shape == tau.shape
        single = reduced_diffusion(reduction, 50.0, 12.5, 150.0)
        assert single.shape == ()
        assert_allclose(G[1, 0], single, rtol=1e-10)


def test_the_paper_under_each_rule():
    """Regression: E* = 250, hardness 150, p0 = 12.5 GPa, slope 1.

    elastic, plastic and total area, and the elastic body's.  No rule with its published gamma
    has both the elastoplastic row of boundary elements (.0533 / .0572 / .1105) and their
    elastic area (.1002) [Almqvist and Persson, Table 1].
    """
    expected = {
        "constant": (0.0525, 0.0572, 0.1097, 0.1086),
        "persson": (0.0638, 0.0517, 0.1155, 0.1149),
        "wang_muser": (0.0497, 0.0586, 0.1083, 0.1071),
        "xu": (0.0622, 0.0524, 0.1146, 0.1140),
    }
    assert [reduction.rule for reduction in PUBLISHED] == list(expected)
    for reduction in PUBLISHED:
        capped = areas(reduced_diffusion(reduction, TAU, 12.5, 150.0), 12.5, 150.0)
        elastic = areas(reduced_diffusion(reduction, TAU, 12.5), 12.5)
        found = (capped.elastic, capped.plastic, capped.total, elastic.total)
        assert_allclose(found, expected[reduction.rule], rtol=0, atol=5e-5)


def test_no_gamma_fits_both_columns_of_the_paper():
    """Where the elastic area is that of boundary elements (.1002), the elastoplastic is not."""
    columns = gamma_columns(TAU, 12.5, 150.0, np.linspace(0.4, 0.8, 401))
    elastic_fit = np.argmin(np.abs(columns["elastic_body_area"] - 0.1002))
    plastic_fit = np.argmin(np.abs(columns["elastic_area"] - 0.0533))
    assert_allclose(columns["gamma"][elastic_fit], 0.63, atol=0.01)
    assert_allclose(columns["gamma"][plastic_fit], 0.53, atol=0.01)
    assert columns["elastic_area"][elastic_fit] < 0.8 * 0.0533
    assert_allclose(columns["total_area"], columns["elastic_area"] + columns["plastic_area"])


def test_gammas_out_of_range_are_refused():
    with pytest.raises(InvalidScene, match="energy_reduction"):
        gamma_columns(TAU, 12.5, 150.0, [0.5, 1.2])


@pytest.mark.parametrize(
    ("gamma", "rule"),
    [(0.0, "constant"), (1.01, "persson"), (math.nan, "xu"), (0.01, "wang_muser")],
)
def test_gamma_out_of_range_is_refused(gamma, rule):
    with pytest.raises(InvalidScene, match="energy_reduction"):
        EnergyReduction(gamma, rule)


def test_other_nonsense_is_refused():
    with pytest.raises(InvalidScene, match="rule"):
        EnergyReduction(0.5, "nobody")
    with pytest.raises(InvalidScene, match="full_contact_diffusion"):
        reduced_diffusion(PUBLISHED[0], -1.0, 1.0)
    with pytest.raises(InvalidScene, match="mean_pressure"):
        reduced_diffusion(PUBLISHED[1], 1.0, 2.0, 2.0)
