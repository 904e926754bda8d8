"""The theory of a scene: results, refusals, curves, energy and separation."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import dblquad, quad
from scipy.special import erf

from epcontact import persson
from epcontact.errors import InvalidScene
from epcontact.persson import (
    EnergyReduction,
    Theory,
    analytic_roughness,
    areas,
    driver,
)
from epcontact.persson.reduction import reduced_diffusion
from epcontact.persson.separation import (
    elastic_energy,
    flattened_roughness,
    mean_separation,
)
from epcontact.persson.validity import expectation
from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.surfaces import SelfAffine
from epcontact.surfaces.spectrum import density

#: Hurst exponent, lowest, roll-off and highest wavenumber (rad/m), rms slope.
SPECTRUM = SelfAffineSpectrum(0.8, 1.0e5, 2.0e5, 16.0e5, 1.0)
PERIOD = 2 * math.pi / 1.0e5
MODULUS = 250e9  # Pa
METAL = Material(MODULUS, 0.0, 150e9)
GAMMA = 0.536  # energy reduction of the paper
SURFACE = SelfAffine(SPECTRUM, (PERIOD, PERIOD), (64, 64), 11).build()
SCENE = Scene(SURFACE, METAL, Load((2e9, 12.5e9)))


WIDE = SelfAffineSpectrum(0.8, 2.5e4, 1e5, 16e5, 1.0)
# The diffusion of the paper's scene in GPa^2: slope 1, full contact.
TAU = 250.0**2 / 8
#: Each rule with a gamma that was published for it, and its factor at A = 1/2.
PUBLISHED = {
    EnergyReduction(0.536, "constant"): 0.536,
    EnergyReduction(0.45, "persson"): 0.45 + 0.55 / 4,
    EnergyReduction(5 / 9, "wang_muser"): 5 / 9 - 1 / 18 + (2 / 3) / 16,
    EnergyReduction(0.42, "xu"): 0.42 + 0.58 / 2,
}
#: The rules with a differential equation for the diffusion.
LOCAL = [r for r in PUBLISHED if r.rule in ("persson", "wang_muser")]


def body(roughness, hardness=math.inf, rule="constant"):
    """Return the theory of a roughness with E* = 250 GPa and gamma = 0.536.

    `hardness` is in Pa, infinite for an elastic body, and `rule` is that of the energy
    reduction.
    """
    return Theory(roughness, MODULUS, EnergyReduction(GAMMA, rule), hardness)


def model(bands=512, hardness=math.inf):
    """Return the theory of the spectrum WIDE in `bands` bands; `hardness` is in Pa."""
    return body(analytic_roughness(WIDE, bands), hardness)


def solve(scene=SCENE, **options):
    """Solve a scene by the theory with gamma = 0.536.

    `options` are those of persson.solve, and may replace gamma.
    """
    return persson.solve(scene, **{"energy_reduction": GAMMA} | options)


def test_the_areas_are_the_closed_form_and_the_distribution_carries_the_load():
    """Areas and quantities of both loads are those of the closed form, and the
    distribution of the last load carries it.

    The slopes of the density are finite differences of the areas by the diffusion.
    """
    result = solve()
    theory = Theory.of_scene(SCENE, energy_reduction=GAMMA)
    G = GAMMA * MODULUS**2 / 8
    for step, pressure in zip(result.steps, (2e9, 12.5e9), strict=True):
        exact = areas(G, pressure, 150e9)
        after = areas(1.0001 * G, pressure, 150e9)
        before = areas(0.9999 * G, pressure, 150e9)
        separation_rate = (after.separated - before.separated) / (2e-4 * G)
        flow_rate = (after.plastic - before.plastic) / (2e-4 * G)
        curve = theory.pressure_curve(pressure)
        elastic = np.trapezoid(curve.pressure * curve.density, curve.pressure)
        assert step.quantities == pytest.approx(
            {
                "energy_reduction": GAMMA,
                "rms_slope": 1.0,
                "diffusion": G,
                "density_slope_at_zero": separation_rate,
                "density_slope_at_hardness": -flow_rate,
                "plastic_force_share": 1 - elastic / pressure,
                "mean_gap": mean_separation(theory, pressure),
                "elastic_energy": elastic_energy(theory, pressure),
            },
            rel=2e-5,
        )
        for kind in ("raw", "corrected"):
            found = step.areas[kind]
            assert found.elastic == pytest.approx(float(exact.elastic), rel=1e-12)
            assert found.plastic == pytest.approx(float(exact.plastic), rel=1e-12)
        assert max(step.areas["error"].total, *step.residuals.values()) < 1e-13
    assert result.notes[-1] == expectation(theory, 12.5e9)
    assert result.cost["seconds"] < 600
    # The surface has exactly the slope of the spectrum.
    own = solve(spectrum="surface").final.areas["raw"]
    assert own.elastic == pytest.approx(result.final.areas["raw"].elastic, rel=1e-9)
    table: Any = result.distribution
    assert np.all(np.diff(table.cumulative) >= 0)
    assert table.cumulative[-1] == pytest.approx(
        result.final.areas["raw"].elastic, rel=1e-13
    )
    # The force is int sigma dF + hardness * A_pl; the trapezoidal rule has an error h^2
    # / 12.
    middle = 0.5 * (table.pressure[1:] + table.pressure[:-1])
    assert_allclose(
        middle @ np.diff(table.cumulative) + 150e9 * table.plastic, 12.5e9, rtol=2e-6
    )


def test_areas_that_do_not_add_up_show_in_the_residual(monkeypatch):
    """The residual "area" is what the areas lack of 1, here because of a wrong elastic
    area.
    """

    def wrong_areas(*arguments):
        """Return the areas of `areas` with 1.5 times the elastic area."""
        exact = areas(*arguments)
        return replace(exact, elastic=1.5 * exact.elastic)

    monkeypatch.setattr(driver, "areas", wrong_areas)
    step = solve().final
    assert step.residuals["area"] == pytest.approx(step.areas["raw"].elastic / 3)


def test_a_flat_surface_is_in_full_contact_at_the_mean_pressure():
    """A flat surface has the elastic area 1, no gap, and one pressure, the mean
    pressure.
    """
    flat = Scene(Surface(np.zeros((8, 8)), (1.0, 1.0)), METAL, Load(1e9))
    result = solve(flat, spectrum="surface")
    assert result.final.areas["raw"].elastic == 1
    assert result.final.quantities["mean_gap"] == 0
    table: Any = result.distribution
    assert table.pressure[-1] == 1e9
    assert table.cumulative[-1] == 1


@pytest.mark.parametrize(
    ("change", "options", "words"),
    [
        (
            {"surface": Surface(np.sin(np.arange(16.0)), (1.0,), SPECTRUM)},
            {},
            "isotropic",
        ),
        ({"body": Body("bonded_layer", 1e-5)}, {}, "half-space"),
        ({"load": Load((2e9, 1e9))}, {}, "decreases"),
        ({"surface": replace(SURFACE, spectrum=None)}, {}, "'surface'"),
        ({}, {"energy_reduction": 1.1}, "energy_reduction"),
        ({}, {"energy_reduction": 0.01, "reduction": "wang_muser"}, "energy_reduction"),
        ({}, {"reduction": "wrong"}, "rule is 'wrong', .* wang_muser"),
        ({}, {"spectrum": "wrong"}, "one of analytic"),
    ],
)
def test_scenes_and_options_that_are_refused(change, options, words):
    """The theory raises InvalidScene with `words` for a scene or option that it cannot
    solve.

    `change` are fields of the scene, and `options` those of persson.solve.
    """
    with pytest.raises(InvalidScene, match=words):
        solve(replace(SCENE, **change), **options)


@pytest.fixture
def theory():
    """Return the theory of the scene SCENE with gamma = 0.536."""
    return Theory.of_scene(SCENE, energy_reduction=GAMMA)


def test_the_magnification_curve_begins_and_ends_right(theory):
    """The areas begin with full contact at magnification 1 and end with those of the
    result.

    The plastic area only grows, the contact area only falls; beyond the last
    magnification nothing changes, and below 1 InvalidScene is raised.
    """
    curve = theory.magnification_curve(12.5e9)
    final = solve().final.areas["raw"]
    assert curve.magnification.size == 1000
    assert curve.total[0] == 1
    assert curve.diffusion[0] == 0
    assert_allclose(
        [curve.elastic[-1], curve.plastic[-1]], [final.elastic, final.plastic], 1e-10
    )
    assert curve.columns()["plastic_area"] is curve.plastic
    assert np.all(np.diff(curve.plastic) >= 0)  # a point that flows stays so
    assert np.all(np.diff(curve.total) <= 0)
    beyond = theory.magnification_curve(12.5e9, [16, 17, 1e6])
    assert_allclose(beyond.elastic, final.elastic, rtol=1e-10)
    with pytest.raises(InvalidScene, match="magnifications"):
        theory.magnification_curve(12.5e9, [0.5])


def test_a_pressure_curve_at_a_magnification(theory):
    """A pressure curve ends at the areas of the magnification curve, and its density
    holds the elastic area.
    """
    curve = theory.pressure_curve(12.5e9, 4.0)
    at_four = theory.magnification_curve(12.5e9, [4.0])
    ends = [curve.cumulative[-1], curve.plastic]
    assert_allclose(ends, [at_four.elastic[0], at_four.plastic[0]], rtol=1e-12)
    # The trapezoidal rule has an error of h^2.
    assert_allclose(np.trapezoid(curve.density, curve.pressure), ends[0], rtol=1e-5)
    assert list(curve.columns()) == ["pressure_Pa", "density_per_Pa", "cumulative_area"]


@pytest.mark.parametrize("reduction", PUBLISHED, ids=str)
def test_a_rule_at_its_ends(reduction):
    """Each rule of the energy reduction has its published factor at the area 1/2 and
    gamma at 0.

    The reduced diffusion is gamma tau without contact and tau in full contact, and
    arrays have the values of their elements. `reduction` is the rule with its gamma.
    """
    assert_allclose(reduction.factor(0.5), PUBLISHED[reduction], rtol=1e-14)
    assert_allclose(reduction.factor(0.0), reduction.gamma)
    assert reduced_diffusion(reduction, 0.0, 1.0) == 0
    # Hardly any contact, about A = sqrt(8/pi) p0 / (E* xi) / sqrt(gamma) = 1e-7: gamma.
    assert_allclose(
        reduced_diffusion(reduction, TAU, 1e-5), reduction.gamma * TAU, rtol=1e-5
    )
    if reduction.rule != "constant":  # nearly full contact: A = 1, nothing is reduced
        assert_allclose(reduction.factor(1.0), 1.0)
        assert_allclose(reduced_diffusion(reduction, 1.0, 1e3), 1.0, rtol=1e-14)
    G = reduced_diffusion(reduction, [[0.0, 1.0], [50.0, TAU]], 12.5, 150.0)
    assert_allclose(
        G[1, 0], reduced_diffusion(reduction, 50.0, 12.5, 150.0), rtol=1e-10
    )


@pytest.mark.parametrize("reduction", LOCAL, ids=str)
@pytest.mark.parametrize("hardness", [math.inf, 150.0])
def test_the_differential_rules_solve_their_equation(reduction, hardness):
    """An adaptive quadrature gives int_0^G dG' / S(A(G')) = tau, with the factor S and
    the area A.

    The stepping of the product is of sixth order. `hardness` is in GPa, as all
    pressures here, at a mean pressure of 12.5.
    """

    def rate(log_g):
        """Return G / S(A(G)) at ln G, the integrand of tau over ln G."""
        G = math.exp(log_g)
        return G / float(reduction.factor(areas(G, 12.5, hardness).total))

    for tau in (0.3, 60.0, TAU):
        G = float(reduced_diffusion(reduction, tau, 12.5, hardness))
        found = quad(
            rate, math.log(1e-12), math.log(G), epsabs=0, epsrel=1e-12, limit=500
        )[0]
        assert_allclose(found + 1e-12, tau, rtol=1e-10)
    by_steps = {
        n: reduced_diffusion(reduction, TAU, 12.5, 150.0, steps_per_decade=n)
        for n in (2, 4, 8, 96)
    }
    exact = by_steps.pop(96)
    errors = np.abs(np.array(list(by_steps.values())) / exact - 1)
    assert np.all(np.log2(errors[:-1] / errors[1:]) > 5)
    assert_allclose(reduced_diffusion(reduction, TAU, 12.5, 150.0), exact, rtol=1e-11)


@settings(max_examples=100, derandomize=True)
@given(st.floats(-6, 8), st.floats(0.05, 1.0), st.floats(0.01, 4) | st.just(math.inf))
def test_the_whole_band_rule_solves_its_equation(log_tau, gamma, wall):
    """The rule "xu" solves G = (gamma + (1 - gamma) A(G)) tau at a mean pressure of 1.

    `log_tau` and `wall` are the decimal logarithms of tau and of the hardness.
    """
    G = reduced_diffusion(EnergyReduction(gamma, "xu"), 10.0**log_tau, 1.0, 10.0**wall)
    A = areas(G, 1.0, 10.0**wall).total
    assert_allclose(G, (gamma + (1 - gamma) * A) * 10.0**log_tau, rtol=1e-11)


def test_no_gamma_has_both_areas_of_the_paper_s_boundary_elements():
    """The gamma with the area of the paper's elastic body leaves less than 0.8 of its
    elastic area with hardness.

    Table 1 has .0533 in elastic contact with the hardness, .1002 without it. A negative
    diffusion, or a load at the hardness, raises InvalidScene.
    """
    gammas = np.linspace(0.4, 0.8, 401)
    with_hardness = persson.areas(gammas * TAU, 12.5, 150.0).elastic
    without = persson.areas(gammas * TAU, 12.5, math.inf).elastic
    best_without = np.argmin(np.abs(without - 0.1002))
    best_with = np.argmin(np.abs(with_hardness - 0.0533))
    assert_allclose(gammas[[best_without, best_with]], [0.63, 0.53], atol=0.01)
    assert with_hardness[best_without] < 0.8 * 0.0533
    for tau, words in ((-1.0, "full_contact_diffusion"), (1.0, "mean_pressure")):
        with pytest.raises(InvalidScene, match=words):
            reduced_diffusion(LOCAL[0], tau, 2.0, 2.0)


def test_full_contact_stores_the_exact_energy_and_the_load_s_work_is_stored():
    """In full contact U_el = (pi/2) E* int q^2 C dq and no gap is left; before, dU_el =
    -p d(ubar), the work of the load.
    """

    def integrand(q):
        """Return q^2 C(q) of the spectrum WIDE at q in rad/m."""
        return q**2 * density(WIDE, q)

    moment, _ = quad(integrand, 2.5e4, 16e5, points=[1e5], limit=200)
    exact = 0.5 * math.pi * MODULUS * moment
    assert_allclose(elastic_energy(model(), 1e13), exact, rtol=1e-6)
    assert mean_separation(model(), 1e13) == 0
    approach = mean_separation(model(), 2.02e9) - mean_separation(model(), 2e9)
    stored = elastic_energy(model(), 2.02e9) - elastic_energy(model(), 2e9)
    assert_allclose(-2.01e9 * approach, stored, rtol=1e-4)


def test_separation_of_one_wave_number_is_the_published_integral():
    """A narrow band at q has ubar = sqrt(pi) q^2 C dq w int_p^inf (dp'/p') [...] e^{-(w
    p'/E*)^2}.

    This is written for a step of the spectrum: half of its energy density is at G(x), 0
    < x < 1 of its slope variance, and the bands of the product resolve the step.
    """
    narrow = SelfAffineSpectrum(0.8, 1e5, 1e5, 1.0001e5, 0.1)
    p = 2e9
    made = body(analytic_roughness(narrow, 1024))

    def rate(pressure, x):
        """Return d(S A)/dp / p at a pressure in Pa; x is the fraction of slope
        variance.
        """
        spread = 2 * math.sqrt(x * MODULUS**2 * 0.01 / 8)
        A = erf(pressure / spread)
        slope = 2 / math.sqrt(math.pi) / spread * math.exp(-((pressure / spread) ** 2))
        return float((0.536 + 3 * 0.464 * A**2) * slope / pressure)

    share = dblquad(rate, 1e-4, 1, p, 2e11, epsabs=0, epsrel=1e-7)[0]
    energy = 0.25 * MODULUS * 0.01 / 1e5
    assert_allclose(
        mean_separation(made, p), energy * share, rtol=2e-4
    )  # width of the band


def test_orders_of_the_separation():
    """The mean separation converges with order four in the steps of the load and two in
    the bands.
    """
    made = model(64)
    exact = mean_separation(made, 5e9, 128)
    errors = [abs(mean_separation(made, 5e9, n) - exact) for n in (4, 8, 16)]
    assert np.all(np.log2(np.divide(errors[:-1], errors[1:])) > 3.5)
    assert errors[1] < 1e-6 * exact  # the default
    values = [mean_separation(model(n), 12.5e9) for n in (64, 128, 256, 512, 4096)]
    by_bands = np.abs(np.subtract(values[:-1], values[-1]))
    orders = np.log2(by_bands[:-1] / by_bands[1:])
    assert np.all((orders > 1.7) & (orders < 2.4))
    assert by_bands[-1] < 5e-5 * values[-1]  # the default


def test_flow_lets_the_surfaces_approach_and_flattens_the_short_waves_first():
    """A lower hardness leaves a smaller gap, and flattens short waves more than long
    ones, by 1 - (plastic load fraction)^6.

    A great hardness is the elastic body, and a load at the hardness raises
    InvalidScene.
    """
    p = 12.5e9
    made = model(128, 75e9)
    gaps = [mean_separation(model(128, h), p) for h in (math.inf, 150e9, 75e9, 40e9)]
    assert np.all(np.diff(gaps) < 0)
    variance = made.roughness.slope_variance
    left = flattened_roughness(made, p).slope_variance / variance
    assert np.all(np.diff(left) <= 0)
    assert left[0] == 1 > 2 * left[-1]
    middle_of_band = np.cumsum(variance) - variance / 2
    plastic = areas(0.536 * MODULUS**2 / 8 * middle_of_band, p, 75e9).plastic * 75e9 / p
    assert_allclose(left, 1 - plastic**6, rtol=1e-12)
    # The energy follows "persson" for "constant" and "xu", which describe no single
    # wave number.
    other = replace(made, reduction=EnergyReduction(GAMMA, "xu"))
    assert elastic_energy(other, p) == elastic_energy(made, p)
    # Great hardness is the elastic body; a load at the hardness is refused.
    for find in (mean_separation, elastic_energy):
        assert_allclose(find(model(64, 1e15), 5e9), find(model(64), 5e9), rtol=1e-14)
        with pytest.raises(InvalidScene, match="mean_pressure"):
            find(model(64, 10e9), 10e9)
