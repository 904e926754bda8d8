"""The theory of a scene: what it answers, what it refuses, and its curves."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from epcontact import persson
from epcontact.errors import InvalidScene
from epcontact.results import ContactResult
from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum, Surface
from epcontact.surfaces import SelfAffine

SPECTRUM = SelfAffineSpectrum(0.8, 1.0e5, 2.0e5, 16.0e5, 1.0)
PERIOD = 2 * math.pi / 1.0e5
METAL = Material(250e9, 0.0, 150e9)
GAMMA = 0.536


@pytest.fixture(scope="module")
def surface():
    return SelfAffine(SPECTRUM, (PERIOD, PERIOD), (64, 64), 11).build()


@pytest.fixture
def scene(surface):
    return Scene(surface, METAL, Load((2e9, 12.5e9)))


def test_a_scene_has_the_areas_of_the_closed_form(scene):
    result = persson.solve(scene, energy_reduction=GAMMA)
    assert result.method == "persson"
    assert [s.mean_pressure for s in result.steps] == [2e9, 12.5e9]
    for step in result.steps:
        exact = persson.areas(GAMMA * 250e9**2 / 8, step.mean_pressure, 150e9)
        for kind in ("raw", "corrected"):
            assert_allclose(step.areas[kind].elastic, exact.elastic, rtol=1e-12)
            assert_allclose(step.areas[kind].plastic, exact.plastic, rtol=1e-12)
            assert_allclose(step.areas[kind].total, exact.total, rtol=1e-12)
        assert step.areas["error"].total == 0
        assert max(step.residuals.values()) < 1e-13
    assert result.final.quantities["energy_reduction"] == GAMMA
    assert result.provenance.options["energy_reduction"] == GAMMA
    assert result.provenance.scene == scene.digest
    assert any("gamma = 0.536" in note for note in result.notes)


def test_the_distribution_ends_in_the_elastic_area(scene):
    result = persson.solve(scene, energy_reduction=GAMMA)
    table = result.distribution
    assert table.pressure.shape == (1025,)
    assert table.pressure[0] == 0
    assert table.pressure[-1] == 150e9
    assert np.all(np.diff(table.cumulative) >= 0)
    assert table.cumulative[-1] == result.final.areas["raw"].elastic
    assert table.plastic == result.final.areas["raw"].plastic
    # The force is int sigma dF + hardness * A_pl; the trapezoidal rule has an error h^2 / 12.
    middle = 0.5 * (table.pressure[1:] + table.pressure[:-1])
    force = middle @ np.diff(table.cumulative) + 150e9 * table.plastic
    assert_allclose(force, 12.5e9, rtol=1e-6)


def test_an_elastic_scene_has_no_plastic_area(scene):
    soft = replace(scene, material=Material(250e9, 0.0), load=Load(12.5e9))
    result = persson.solve(soft, energy_reduction=GAMMA)
    assert result.final.areas["raw"].plastic == 0
    assert result.distribution.plastic == 0
    assert_allclose(
        result.distribution.cumulative[-1], result.final.areas["raw"].elastic, rtol=1e-13
    )


def test_a_surface_of_exact_slope_gives_the_same_areas_by_its_own_spectrum(scene):
    one = persson.solve(scene, energy_reduction=GAMMA).final
    other = persson.solve(scene, energy_reduction=GAMMA, spectrum="surface").final
    assert_allclose(one.areas["raw"].elastic, other.areas["raw"].elastic, rtol=1e-9)
    # The separation feels how 16 waves a side sample the long ones: a few per cent.
    assert_allclose(one.quantities["mean_gap"], other.quantities["mean_gap"], rtol=0.1)


def test_options_change_the_answer(scene):
    base = persson.solve(scene, energy_reduction=GAMMA).final.areas["raw"].elastic
    gamma = persson.solve(scene, energy_reduction=0.6).final.areas["raw"].elastic
    rule = persson.solve(scene, energy_reduction=GAMMA, reduction="persson")
    assert abs(gamma / base - 1) > 0.1
    assert abs(rule.final.areas["raw"].elastic / base - 1) > 0.01
    few = persson.solve(scene, energy_reduction=GAMMA, points=17)
    assert few.distribution.pressure.shape == (17,)


def test_units_do_not_matter(scene):
    """Lengths in units of 1 mm, pressures in GPa: the same areas, the gap rescaled."""
    spectrum = replace(SPECTRUM, wavenumber_low=1e2, wavenumber_roll_off=2e2, wavenumber_high=16e2)
    other = Scene(
        Surface(scene.surface.heights * 1e3, (PERIOD * 1e3,) * 2, spectrum),
        Material(250, 0.0, 150),
        Load((2, 12.5)),
    )
    a, b = (persson.solve(s, energy_reduction=GAMMA).final for s in (scene, other))
    assert_allclose(a.areas["raw"].elastic, b.areas["raw"].elastic, rtol=1e-11)
    assert_allclose(a.quantities["mean_gap"] * 1e3, b.quantities["mean_gap"], rtol=1e-9)


def test_a_result_survives_json(scene):
    result = persson.solve(scene, energy_reduction=GAMMA)
    back = ContactResult.from_json(json.loads(json.dumps(result.to_json())))
    assert back.final.areas["raw"] == result.final.areas["raw"]
    assert np.array_equal(back.distribution.cumulative, result.distribution.cumulative)


# ---- curves --------------------------------------------------------------------------------


def theory_of(scene, **options):
    return persson.Theory.of_scene(scene, energy_reduction=GAMMA, **options)


def test_the_magnification_curve_begins_and_ends_right(scene):
    curve = theory_of(scene).magnification_curve(12.5e9)
    final = persson.solve(scene, energy_reduction=GAMMA).final.areas["raw"]
    assert curve.magnification.shape == (1000,)
    assert curve.total[0] == 1
    assert curve.diffusion[0] == 0
    assert_allclose(curve.elastic[-1], final.elastic, rtol=1e-10)
    assert_allclose(curve.plastic[-1], final.plastic, rtol=1e-10)
    assert np.all(np.diff(curve.plastic) >= 0)  # a point that flows stays so
    assert np.all(np.diff(curve.total) <= 0)
    assert set(curve.columns()) >= {"magnification", "elastic_area", "plastic_area", "total_area"}
    assert len({column.shape for column in curve.columns().values()}) == 1


def test_beyond_the_roughness_nothing_changes(scene):
    curve = theory_of(scene).magnification_curve(12.5e9, [16, 17, 1e6])
    assert_allclose(curve.elastic, curve.elastic[0], rtol=1e-12)


def test_the_curve_of_a_surface_is_that_of_its_modes(scene):
    curve = theory_of(scene, spectrum="surface").magnification_curve(12.5e9, [1, 4, 16])
    modes = np.abs(np.fft.fft2(scene.surface.heights) / 64**2) ** 2
    k = np.fft.fftfreq(64, 1 / 64)
    zeta = np.hypot(k[:, None], k)
    for magnification, found in zip((1, 4, 16), curve.diffusion, strict=True):
        inside = zeta <= magnification * (1 + 1e-9)
        slope = (modes * (zeta * 1e5) ** 2)[inside].sum()
        assert_allclose(found, GAMMA * 250e9**2 / 8 * slope, rtol=1e-10)


def test_a_pressure_curve_at_a_magnification(scene):
    curve = theory_of(scene).pressure_curve(12.5e9, 4.0)
    at_four = theory_of(scene).magnification_curve(12.5e9, [4.0])
    assert_allclose(curve.cumulative[-1], at_four.elastic[0], rtol=1e-12)
    assert_allclose(curve.plastic, at_four.plastic[0], rtol=1e-12)
    whole = np.trapezoid(curve.density, curve.pressure)
    assert_allclose(whole, curve.cumulative[-1], rtol=1e-5)  # the trapezoidal rule's h^2
    assert set(curve.columns()) == {"pressure_Pa", "density_per_Pa", "cumulative_area"}


def test_a_flat_surface_is_in_full_contact_at_the_mean_pressure():
    flat = Scene(Surface(np.zeros((8, 8)), (1.0, 1.0)), METAL, Load(1e9))
    result = persson.solve(flat, energy_reduction=GAMMA, spectrum="surface")
    assert result.final.areas["raw"].elastic == 1
    assert result.final.quantities["mean_gap"] == 0
    assert result.distribution.pressure[-1] == 1e9
    assert result.distribution.cumulative[-1] == 1


# ---- refusals ------------------------------------------------------------------------------


def test_a_line_is_refused():
    line = Surface(np.sin(np.arange(16.0)), (1.0,), SPECTRUM)
    with pytest.raises(InvalidScene, match="isotropic"):
        persson.solve(Scene(line, METAL, Load(1e9)), energy_reduction=GAMMA)


def test_a_layer_is_refused(scene):
    with pytest.raises(InvalidScene, match="half-space"):
        persson.solve(replace(scene, body=Body("bonded_layer", 1e-5)), energy_reduction=GAMMA)


def test_unloading_is_refused(scene):
    with pytest.raises(InvalidScene, match="decreases"):
        persson.solve(replace(scene, load=Load((2e9, 1e9))), energy_reduction=GAMMA)


def test_a_surface_without_spectrum_needs_its_own(scene):
    bare = replace(scene, surface=replace(scene.surface, spectrum=None))
    with pytest.raises(InvalidScene, match="'surface'"):
        persson.solve(bare, energy_reduction=GAMMA)


@pytest.mark.parametrize("gamma", [0.0, -1.0, 1.1, math.nan])
def test_gamma_out_of_range_is_refused(scene, gamma):
    with pytest.raises(InvalidScene, match="energy_reduction"):
        persson.solve(scene, energy_reduction=gamma)


def test_unknown_words_are_refused(scene):
    with pytest.raises(InvalidScene, match="wang_muser"):
        persson.solve(scene, energy_reduction=GAMMA, reduction="wrong")
    with pytest.raises(InvalidScene, match="'analytic'"):
        persson.solve(scene, energy_reduction=GAMMA, spectrum="wrong")


def test_magnifications_below_one_are_refused(scene):
    with pytest.raises(InvalidScene, match="magnifications"):
        theory_of(scene).magnification_curve(12.5e9, [0.5])
    with pytest.raises(InvalidScene, match="magnification"):
        theory_of(scene).pressure_curve(12.5e9, math.nan)
