"""Studies: the data behind the charts, and that every chart tells and shows it."""

from __future__ import annotations

import csv
import io
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from epcontact.bem import solve
from epcontact.errors import StudyUnavailable
from epcontact.output.charts.figures import Series
from epcontact.output.charts.study import curves, with_orders
from epcontact.persson import areas
from epcontact.studies import (
    STUDIES,
    bem,
    fem,
    gamma,
    growth,
    magnification,
    master,
    peers,
    resolution,
    save_charts,
    theory,
)
from epcontact.studies import paper_scene as scenes


def quiet(_: str) -> None:
    pass


def rows_of(chart):
    return list(csv.DictReader(io.StringIO(chart.csv())))


# --- what studies share -------------------------------------------------------------------------


def test_the_paper_s_scene_has_the_paper_s_groups():
    scene = scenes.rough_scene(4, seed=1, bandwidth=16)
    slope = np.sqrt(
        sum(np.mean(d**2) for d in _gradients(scene.surface.heights, scene.surface.spacing))
    )
    assert slope == pytest.approx(1, rel=1e-10)
    assert scene.load.final / scenes.MODULUS == 0.05
    assert scene.material.hardness / scenes.MODULUS == 0.6


def _gradients(heights, spacing):
    modes = np.fft.fft2(heights)
    for axis in (0, 1):
        q = 2 * math.pi * np.fft.fftfreq(heights.shape[axis], spacing[axis])
        yield np.fft.ifft2(1j * np.expand_dims(q, 1 - axis) * modes).real


def test_the_interval_of_a_mean_is_student_s():
    mean, half_width = scenes.mean_and_half_width([1.0, 2.0, 3.0])
    # t(2 degrees, 97.5 %) = 4.30265
    assert (mean, half_width) == pytest.approx((2.0, 4.302653 / math.sqrt(3)), rel=1e-6)
    assert scenes.mean_and_half_width([5.0]) == (5.0, 0.0)


def test_a_chart_s_table_holds_what_is_drawn():
    chart = curves(
        [Series("one", [1, 10, 100], [0.1, 0.01, 0.001]), Series("flat", [1, 100], [1, 1])],
        x="cost (s)",
        y="error (–)",
        columns=("cost_s", "error"),
        caption="What is seen.",
        log="xy",
        pareto=["one"],
    )
    assert [row["error"] for row in rows_of(chart)] == ["0.1", "0.01", "0.001", "1.0", "1.0"]
    front = [line for line in chart.figure.axes[0].lines if line.get_label() == "Pareto front"]
    assert np.array_equal(front[0].get_ydata(), [0.1, 0.01, 0.001])


def test_a_point_without_error_ends_the_front():
    series = [Series("a", [1, 5], [0.1, 0.0]), Series("b", [3, 9], [0.01, 0.001])]
    chart = curves(
        series,
        x="x",
        y="y",
        columns=("x", "y"),
        caption="",
        log="xy",
        pareto=["a", "b"],
        zeros=True,
    )
    front = [line for line in chart.figure.axes[0].lines if line.get_label() == "Pareto front"]
    assert np.array_equal(front[0].get_xdata(), [1, 3])


def test_labels_tell_the_observed_order_and_no_other():
    x = np.array([1.0, 2.0, 4.0])
    series = [Series("second", x, x**-2.0), Series("level", x, np.ones(3))]
    assert with_orders(series, ["second"], sign=-1) == {"second": "second: order 2.00"}


def test_charts_are_saved_under_the_study_s_name(tmp_path: Path):
    chart = curves([Series("s", [1], [1])], x="x", y="y", columns=("x", "y"), caption="c")
    save_charts("alone", (chart,), tmp_path)
    save_charts("pair", (chart, chart), tmp_path)
    assert {p.stem for p in tmp_path.iterdir()} == {"alone", "pair-1", "pair-2"}


# --- gamma --------------------------------------------------------------------------------------


def exact_bem(gamma_of_each: dict[str, float], width: float):
    tau = scenes.MODULUS**2 / 8
    bem = {}
    for key, g in gamma_of_each.items():
        hardness = math.inf if key == "elastic_body_area" else scenes.HARDNESS
        part = "total" if "body" in key else key.removesuffix("_area")
        area = float(getattr(areas(g * tau, scenes.MEAN_PRESSURE, hardness), part))
        bem[key] = (area, width * area)
    return gamma.fit_gamma(bem, tau, scenes.MEAN_PRESSURE, scenes.HARDNESS)


def test_areas_of_the_theory_give_back_their_gamma():
    fit = exact_bem(dict.fromkeys(gamma.NAMES, 0.536), 1e-3)
    for middle, low, high in fit.fits.values():
        # The table's steps of 0.005, between which it is linear, leave curvature times 3e-6.
        assert middle == pytest.approx(0.536, abs=2e-5)
        assert low < middle < high
    assert fit.common


def test_areas_of_two_gammas_have_none_in_common():
    fit = exact_bem(dict.fromkeys(gamma.NAMES, 0.5) | {"elastic_body_area": 0.6}, 1e-3)
    assert not fit.common
    # Intervals wide enough to hold both are no evidence.
    assert exact_bem(dict.fromkeys(gamma.NAMES, 0.5) | {"elastic_body_area": 0.6}, 0.2).common


def test_an_area_that_no_gamma_meets_is_told_as_such():
    tau = scenes.MODULUS**2 / 8
    bem = {"total_area": (0.9, 0.0)}
    fit = gamma.fit_gamma(bem, tau, scenes.MEAN_PRESSURE, scenes.HARDNESS)
    assert math.isnan(fit.fits["total_area"][0])
    assert not fit.common


def test_no_gamma_fits_the_capped_and_the_elastic_body():
    fit = gamma.measure(4, 64, range(7, 15), quiet)
    assert fit.fits["elastic_body_area"][1] > fit.fits["total_area"][2]
    assert not fit.common
    first, second = gamma.draw_fit(fit, 4, 64)
    assert "No single gamma fits" in first.caption
    assert "No single gamma fits" in second.caption
    assert {row["series"] for row in rows_of(second)} == set(gamma.NAMES.values())


# --- resolution ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def errors():
    return resolution.measure((4, 6, 8), 16, 16, range(3), quiet)


def test_raw_areas_have_first_order_and_corrected_ones_are_better(errors):
    for one in errors:
        if one.part == "elastic":
            continue
        raw, corrected = one.errors["raw"], one.errors["corrected"]
        order = -np.polyfit(np.log(one.points), np.log(raw), 1)[0]
        assert 0.7 < order < 1.4  # first order, on three grids of three surfaces
        # The correction leaves less than a quarter of the raw error on every grid.
        assert np.all(corrected < 0.25 * raw)


def test_extrapolation_uses_the_grid_half_as_fine(errors):
    found = errors[0].errors["raw, extrapolated"]
    assert np.isnan(found[:2]).all()
    assert found[2] < errors[0].errors["raw"][2]


def test_work_counts_transforms_times_points(errors):
    # From 4 to 8 points per wavelength there are four times the points.
    assert 3 < errors[0].work[2] / errors[0].work[0] < 8


def test_the_charts_of_resolution_say_what_the_reference_is_worth(errors):
    against_points, against_work = resolution.draw_errors(errors[0], 16)
    assert "uncertain by" in against_points.caption
    assert "uncertain by" in against_work.caption
    names = {row["series"] for row in rows_of(against_points)}
    assert {*resolution.KINDS, resolution.CLAIMED, "uncertainty of the reference"} == names


# --- magnification ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def comparison():
    return magnification.measure(4, 16, (1.5, 3.0, 6.0, 11.0, 16.0), range(3), quiet)


def test_the_last_cut_off_is_the_whole_surface(comparison):
    solved = [solve(scenes.rough_scene(4, seed, 16), area_tolerance=1e-5) for seed in range(3)]
    for part in scenes.PARTS:
        mean, _ = scenes.area_band(solved, part)
        # Filtering rounds heights, and area_tolerance bounds what that may do.
        assert comparison.bem[part][-1] == pytest.approx(mean, rel=2e-5)


def test_boundary_elements_lose_contact_as_the_theory_does(comparison):
    for areas_ in (comparison.bem["total"], comparison.theory["total"]):
        assert np.all(np.diff(areas_) < 0)
    # Within 25 %: so few waves are a coarse sample of the theory's continuum of them.
    assert np.all(np.abs(comparison.bem["total"] / comparison.theory["total"] - 1) < 0.25)


def test_five_cut_offs_have_distributions_that_hold_the_elastic_area(comparison):
    assert list(comparison.densities) == [1.5, 3.0, 6.0, 11.0, 16.0]
    for i, (pressure, _, density) in enumerate(comparison.densities.values()):
        width = pressure[1] - pressure[0]
        elastic = comparison.theory["elastic"][i]
        assert density.sum() * width == pytest.approx(elastic, rel=1e-6)


def test_five_cut_offs_are_chosen_evenly_with_the_last():
    assert magnification.five_of(13) == [2, 5, 7, 10, 12]
    assert magnification.five_of(5) == [0, 1, 2, 3, 4]


def test_the_charts_of_magnification_hold_both_methods(comparison):
    against, deviation, density = magnification.draw_comparison(comparison)
    series = {row["series"] for row in rows_of(against)}
    assert {"total, bem", "total, theory", "plastic, bem"} <= series
    assert "At the last magnification" in deviation.caption
    assert len({row["series"] for row in rows_of(density)}) == 10


# --- theory -------------------------------------------------------------------------------------


@pytest.mark.parametrize("G", [0.01, 0.186, 1.0])
@pytest.mark.parametrize("summed", [theory.eigenfunction_sums, theory.image_sums])
def test_each_partial_sum_is_that_of_arbitrary_precision(summed, G):
    import mpmath as mp

    s, c = mp.mpf(1) / 12, 2 * mp.sqrt(G)

    def eigenfunction(i: int):
        n = 2 * i + 1
        return 4 / (mp.pi * n) * mp.sin(n * mp.pi * s) * mp.exp(-((n * mp.pi) ** 2) * G)

    def image(k: int):
        pair = mp.erf((k + s) / c) - mp.erf((k - s) / c)
        return (-1) ** k * pair if k else pair / 2

    term = image if summed is theory.image_sums else eigenfunction
    with mp.workdps(40):
        exact = [float(mp.fsum(term(i) for i in range(n + 1))) for n in range(8)]
    # Rounding of terms that are at most 1.
    assert summed(G, 1 / 12, 8) == pytest.approx(exact, abs=1e-15)


def test_few_images_at_small_diffusion_and_few_eigenfunctions_at_large():
    small, large = theory.terms_needed(1e-3), theory.terms_needed(1.0)
    assert small["images"] == 1
    assert small["eigenfunctions"] > 15
    assert large["eigenfunctions"] == 1
    assert large["images"] > 10


def test_where_the_package_changes_its_series_both_are_short():
    from epcontact.persson.series import SWITCH

    assert max(theory.terms_needed(SWITCH**2 / 4).values()) <= 6


def test_finite_volumes_are_of_second_order():
    coarse, fine = theory.finite_volume_errors([64, 128])
    assert coarse < 1e-4
    assert np.log2(coarse / fine) == pytest.approx(2, abs=0.1)


# --- solvers and growth -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def work():
    scene = scenes.rough_scene(4, 7, 16)
    return bem.measure(scene, ("newton", "projected_gradient"), (1e-2, 1e-4, 1e-6), max_steps=300)


def test_every_point_meets_its_tolerance_and_effort_rises(work):
    for one in work.values():
        assert np.all(one.residual <= [1e-2, 1e-4, 1e-6])
        assert np.all(np.diff(one.pairs) > 0)


def test_newton_needs_fewer_transforms_than_the_projected_gradient(work):
    assert work["newton"].pairs[-1] < work["projected_gradient"].pairs[-1]
    assert "projected_gradient" in bem.draw_work(work, (64, 64), 1e-5)[0].caption


def test_areas_settle_with_the_residual(work):
    for one in work.values():
        assert one.area_error[-1] < 1e-3


def test_a_method_that_does_not_converge_is_told_and_stops():
    found = bem.measure(scenes.rough_scene(4, 7, 16), ("relaxation",), (1e-1, 1e-9), max_steps=30)
    one = found["relaxation"]
    assert one.residual.size <= 1
    assert "relaxation stops at a residual of" in one.failure
    assert "after 30 steps" in one.failure


def test_transforms_do_not_grow_with_the_grid_where_the_roughness_is_fixed():
    found = growth.measure([(4, 16), (8, 16), (16, 16)], quiet)
    assert list(found.points) == [64, 128, 256]
    assert found.finest_pairs[-1] <= found.finest_pairs[0] + 2
    pairs, times = growth.draw_growth(found, found)
    assert "Exponents" in pairs.caption
    assert len(rows_of(times)) == 6


# --- finite elements ----------------------------------------------------------------------------


def test_elements_with_mean_dilatation_find_the_limit_that_others_miss():
    good, locking = fem.punch_errors([2], True), fem.punch_errors([2], False)
    assert good[0] < 0.2
    assert locking[0] > 3 * good[0]


def test_a_deep_block_is_the_half_space_to_its_longest_wave():
    errors = fem.depth_errors([0.25, 0.5, 1.0], [1], 64)[0]
    assert errors[0] > errors[1] > errors[2]
    # 64 nodes a wave leave 1e-3 of discretisation.
    assert errors[2] < 2e-3


def test_every_linear_solver_solves_the_same_system():
    found = fem.linear_solve(8)
    # Nodes on 8 x 8 points, 3 components, on every level but the base.
    assert found.unknowns % (3 * 64) == 0
    assert found.residuals["Fourier elimination"] < 1e-12
    assert found.residuals["sparse factorisation"] < 1e-12
    assert found.residuals["conjugate gradients"] <= 2e-8
    assert all(seconds > 0 for seconds in found.seconds.values())


def test_load_steps_near_their_reference():
    errors, iterations = fem.step_errors([1, 2], 4, 4, [7], quiet)
    assert errors["mean gap"][1] < errors["mean gap"][0] < 0.05
    assert iterations[1] > iterations[0]


# --- all methods on one scene -------------------------------------------------------------------


@pytest.fixture(scope="module")
def all_methods():
    return master.measure((3, 4, 8), (3, 4, 8), 32, 8, range(2), quiet)


def test_every_method_nears_one_reference(all_methods):
    for series in ("bem, raw", "bem, corrected", "fem, raw", "fem, corrected"):
        error = all_methods.errors[series]
        assert error[-1] < error[0]
    # Eight points a wavelength: the grids' claims are 1 % (bem) and 5 % (fem) of the area.
    assert all_methods.errors["bem, corrected"][-1] < 0.01
    assert all_methods.errors["fem, corrected"][-1] < 0.05
    # The theory knows the spectrum alone; four shortest waves a roll-off are few of them.
    assert 0 < all_methods.errors["persson"][0] < 0.3


def test_the_master_chart_has_every_method_and_the_reference_s_worth(all_methods):
    chart = master.draw_comparison(all_methods)
    names = {row["series"] for row in rows_of(chart)}
    assert {"persson", "bem, raw", "fem, corrected", master.UNCERTAINTY} <= names
    assert "uncertain by" in chart.caption
    labels = [line.get_label() for line in chart.figure.axes[0].lines]
    assert "Pareto front" in labels


# --- peers --------------------------------------------------------------------------------------


def test_without_any_peer_one_sentence_says_what_to_install(monkeypatch):
    for name in peers.PEERS:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(StudyUnavailable, match="pip install"):
        peers.installed()


def test_a_peer_is_timed_only_where_its_areas_agree():
    def same(heights, load, hardness, _):
        scene = scenes.rough_scene(8, 7, 8, scenes.MODULUS * hardness)
        return solve(scene, threads=1).fields["pressure"] / scenes.MODULUS

    def wrong(heights, load, hardness, _):
        return np.full(heights.shape, load)

    found = peers.race(8, 8, peers.HARDNESS, {"ContactMechanics": same, "tamaas": wrong})
    assert [one.agrees for one in found] == [True, True, False]
    chart = peers.draw_races(found)
    assert {row["series"] for row in rows_of(chart)} == {"epcontact", "ContactMechanics"}
    assert "Without agreement: tamaas at 64" in chart.caption


def test_areas_agree_within_a_thousandth_only():
    assert peers.agree((0.1, 0.05), (0.1 * 1.0009, 0.05))
    assert not peers.agree((0.1, 0.05), (0.1, 0.05 * 1.002))
    assert not peers.agree((0.1, 0.01), (0.1, 0.0))


@pytest.mark.slow
@pytest.mark.parametrize("hardness", [peers.HARDNESS, math.inf])
def test_installed_peers_find_the_same_areas(hardness):
    pytest.importorskip("tamaas")
    found = peers.race(8, 8, hardness, peers.installed())
    assert all(one.agrees for one in found)


# --- every study --------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["gamma", "resolution", "magnification", "theory", "bem", "growth", "pressures", "gap"],
)
def test_a_fast_study_makes_charts_that_can_be_saved(name, tmp_path):
    charts = STUDIES[name].run("fast")
    files = save_charts(name, charts, tmp_path)
    assert {f.suffix for f in files} == {".png", ".svg", ".csv", ".txt"}
    assert all(len(chart.caption) > 100 for chart in charts)
