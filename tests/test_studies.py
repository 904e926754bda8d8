"""Studies: the data behind the charts, and that every chart tells and shows it."""

from __future__ import annotations

import csv
import io
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from epcontact.bem import solve
from epcontact.errors import StudyUnavailable
from epcontact.harness.processes.child import Child, ChildDied
from epcontact.output.charts.plot import Plot, draw_table
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
    speed,
    theory,
)
from epcontact.studies import paper_scene as scenes
from epcontact.studies.tables import mean_with_interval


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
    table = pd.DataFrame({"law": ["a", "b", "a", "a"], "area": [1.0, 5.0, 2.0, 3.0]})
    first, second = mean_with_interval(table, "area", ["law"]).to_dict("records")
    # t(2 degrees, 97.5 %) = 4.30265
    assert first["law"] == "a"
    assert first["area_high"] - 2 == pytest.approx(4.302653 / math.sqrt(3), rel=1e-6)
    assert 2 - first["area_low"] == pytest.approx(4.302653 / math.sqrt(3), rel=1e-6)
    assert (second["area_low"], second["area_high"]) == (5.0, 5.0)


def test_an_error_that_surfaces_share_does_not_average_out():
    table = pd.DataFrame({"law": "a", "area": [1.0, 2.0, 3.0], "claim": [0.1, 0.2, 0.3]})
    (band,) = mean_with_interval(table, "area", ["law"], "claim").to_dict("records")
    assert band["area_high"] - 2 == pytest.approx(math.hypot(4.302653 / math.sqrt(3), 0.2))


PLOT = Plot(x=("cost_s", "cost (s)"), y=("error", "error (–)"), log="xy")


def table_of(**series) -> pd.DataFrame:
    """One row a point of the series, each given as its costs and errors."""
    return pd.concat(
        pd.DataFrame({"series": name, "cost_s": x, "error": y}) for name, (x, y) in series.items()
    )


def lines_of(chart):
    return {line.get_label(): line for line in chart.figure.axes[0].lines}


def test_a_chart_s_table_holds_what_is_drawn():
    table = table_of(falling=([1, 10, 100], [0.1, 0.01, 0.001]), flat=([1, 100], [1, 1]))
    table["style"] = np.where(table["series"] == "flat", "curve", "points")
    chart = draw_table(table, replace(PLOT, front=True), "A caption.")
    assert [row["error"] for row in rows_of(chart)] == ["0.1", "0.01", "0.001", "1.0", "1.0"]
    assert np.array_equal(lines_of(chart)["Pareto front"].get_ydata(), [0.1, 0.01, 0.001])


def test_bounds_of_a_column_are_drawn_and_tabled():
    table = table_of(one=([1, 2], [3, 4])).assign(error_low=[2.5, 3.5], error_high=[3.5, 4.5])
    chart = draw_table(table, PLOT, "A caption.")
    assert [(row["low"], row["high"]) for row in rows_of(chart)] == [("2.5", "3.5"), ("3.5", "4.5")]
    assert len(chart.figure.axes[0].collections) == 1


def test_a_point_without_error_ends_the_front():
    table = table_of(a=([1, 5], [0.1, 0.0]), b=([3, 9], [0.01, 0.001]))
    chart = draw_table(table, replace(PLOT, front=True), "A caption.")
    assert np.array_equal(lines_of(chart)["Pareto front"].get_xdata(), [1, 3])


def test_the_legend_tells_the_observed_order_where_it_is_asked_for():
    x = np.array([1.0, 2.0, 4.0])
    table = table_of(second=(x, x**-2.0), level=(x, np.ones(3)))
    labels = lines_of(draw_table(table, replace(PLOT, orders=["second"]), "A caption."))
    assert {"second: order 2.00", "level"} <= set(labels)


def test_series_of_one_group_share_their_colour_and_have_their_style():
    table = table_of(theory=([1, 2], [1, 2]), bem=([1, 2], [1, 3]), limit=([0.5], [1]))
    table["part"] = "total"
    table["style"] = table["series"].map({"theory": "curve", "bem": "marks", "limit": "open"})
    plot = replace(PLOT, series=("part", "series"), colour="part")
    lines = lines_of(draw_table(table, plot, "A caption."))
    assert set(lines) == {"total, theory", "total, bem", "total, limit"}
    assert len({line.get_color() for line in lines.values()}) == 1
    assert lines["total, theory"].get_marker() in (None, "None")
    assert lines["total, bem"].get_linestyle() == "None"
    assert lines["total, limit"].get_fillstyle() == "none"


def test_charts_are_saved_under_the_study_s_name(tmp_path: Path):
    chart = draw_table(table_of(s=([1], [1])), PLOT, "A caption.")
    save_charts("alone", (chart,), tmp_path)
    save_charts("pair", (chart, chart), tmp_path)
    assert {p.stem for p in tmp_path.iterdir()} == {"alone", "pair-1", "pair-2"}


# --- gamma --------------------------------------------------------------------------------------


def exact_fits(gammas: dict[str, float], width: float) -> pd.DataFrame:
    """The fits of areas that the theory has at these gammas, with intervals of this width."""
    tau, rows = scenes.MODULUS**2 / 8, []
    for name, g in gammas.items():
        hardness = math.inf if name == "elastic body" else scenes.HARDNESS
        part = "total" if name == "elastic body" else name
        area = float(getattr(areas(g * tau, scenes.MEAN_PRESSURE, hardness), part))
        rows.append((name, area, (1 - width) * area, (1 + width) * area))
    names = ["area", "area_fraction", "area_fraction_low", "area_fraction_high"]
    return gamma.fit_gamma(gamma.theory_areas(), pd.DataFrame(rows, columns=names))


def test_areas_of_the_theory_give_back_their_gamma():
    fits = exact_fits(dict.fromkeys(gamma.AREAS, 0.536), 1e-3)
    # The table's steps of 0.005, between which it is linear, leave curvature times 3e-6.
    assert fits["gamma"].to_numpy() == pytest.approx(0.536, abs=2e-5)
    assert (fits["gamma_low"] < fits["gamma"]).all()
    assert (fits["gamma"] < fits["gamma_high"]).all()
    assert fits["deviation_percent"].to_numpy() == pytest.approx(0, abs=5e-3)
    assert gamma.one_gamma_fits(fits)


def test_areas_of_two_gammas_have_none_in_common():
    two = dict.fromkeys(gamma.AREAS, 0.5) | {"elastic body": 0.6}
    assert not gamma.one_gamma_fits(exact_fits(two, 1e-3))
    # Intervals wide enough to hold both are no evidence.
    assert gamma.one_gamma_fits(exact_fits(two, 0.2))


def test_an_area_that_no_gamma_meets_has_no_fit():
    found = {"area": "total", "area_fraction": [0.9]}
    found |= {"area_fraction_low": [0.9], "area_fraction_high": [0.9]}
    fits = gamma.fit_gamma(gamma.theory_areas(), pd.DataFrame(found))
    assert fits["gamma"].isna().all()
    assert not gamma.one_gamma_fits(fits)


def test_no_gamma_fits_the_capped_and_the_elastic_body():
    found = gamma.boundary_element_areas(4, 64, range(7, 15), quiet)
    fits = gamma.fit_gamma(gamma.theory_areas(), found).set_index("area")
    assert fits["gamma_low"]["elastic body"] > fits["gamma_high"]["total"]
    first, second = gamma.draw_gamma(gamma.theory_areas(), found, "8 surfaces")
    assert "No single gamma fits" in first.caption
    assert "No single gamma fits" in second.caption
    assert {row["series"] for row in rows_of(second)} == set(gamma.AREAS)


# --- resolution ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def errors():
    return resolution.area_errors(resolution.solved_areas((4, 6, 8, 16), 16, range(3), quiet))


def errors_of(table: pd.DataFrame, part: str, kind: str) -> pd.DataFrame:
    return table[(table["part"] == part) & (table["kind"] == kind)]


@pytest.mark.parametrize("part", ["total", "plastic"])
def test_raw_areas_have_first_order_and_corrected_ones_are_better(errors, part):
    raw, corrected = (errors_of(errors, part, kind) for kind in ("raw", "corrected"))
    order = -np.polyfit(np.log(raw["points_per_wavelength"]), np.log(raw["relative_error"]), 1)[0]
    assert 0.7 < order < 1.4  # first order, on three grids of three surfaces
    # The correction leaves less than a quarter of the raw error on every grid.
    assert np.all(corrected["relative_error"].to_numpy() < 0.25 * raw["relative_error"].to_numpy())


def test_extrapolation_uses_the_grid_half_as_fine(errors):
    found = errors_of(errors, "total", "raw, extrapolated")["relative_error"].to_numpy()
    assert np.isnan(found[:2]).all()
    assert found[2] < errors_of(errors, "total", "raw")["relative_error"].iloc[2]


def test_work_counts_transforms_times_points(errors):
    work = errors_of(errors, "total", "raw")["work_points_transformed"].to_numpy()
    # From 4 to 8 points per wavelength there are four times the points.
    assert 3 < work[2] / work[0] < 8
    both = errors_of(errors, "total", "raw, extrapolated")["work_points_transformed"]
    assert both.iloc[2] == work[2] + work[0]


def test_the_charts_of_resolution_say_what_the_reference_is_worth(errors):
    against_points, against_work = resolution.draw_errors(errors, "total", "3 surfaces")
    assert "uncertain by" in against_points.caption
    assert "uncertain by" in against_work.caption
    names = {row["series"] for row in rows_of(against_points)}
    assert {*resolution.KINDS, resolution.CLAIMED, resolution.REFERENCE} == names


# --- magnification ------------------------------------------------------------------------------


ZETA = [1.5, 3.0, 6.0, 11.0, 16.0]


@pytest.fixture(scope="module")
def filtered_tables():
    return magnification.boundary_element_tables(4, 16, ZETA, range(3), quiet)


@pytest.fixture(scope="module")
def theory_tables():
    return magnification.theory_tables(scenes.rough_scene(4, 0, 16), ZETA, ZETA)


def part_of(areas_: pd.DataFrame, part: str) -> np.ndarray:
    return areas_[areas_["part"] == part]["area_fraction"].to_numpy()


def test_the_last_cut_off_is_the_whole_surface(filtered_tables):
    solved = [solve(scenes.rough_scene(4, seed, 16), area_tolerance=1e-5) for seed in range(3)]
    for part in scenes.PARTS:
        mean = np.mean([scenes.area_of(result, part) for result in solved])
        # Filtering rounds heights, and area_tolerance bounds what that may do.
        assert part_of(filtered_tables[0], part)[-1] == pytest.approx(mean, rel=2e-5)


def test_boundary_elements_lose_contact_as_the_theory_does(filtered_tables, theory_tables):
    found, theory_ = (part_of(tables[0], "total") for tables in (filtered_tables, theory_tables))
    assert np.all(np.diff(found) < 0)
    assert np.all(np.diff(theory_) < 0)
    # Within 25 %: so few waves are a coarse sample of the theory's continuum of them.
    assert np.all(np.abs(found / theory_ - 1) < 0.25)


def test_five_cut_offs_have_distributions_that_hold_the_elastic_area(
    filtered_tables, theory_tables
):
    assert filtered_tables[1]["magnification"].unique().tolist() == ZETA
    elastic = part_of(theory_tables[0], "elastic")
    for zeta, area in zip(ZETA, elastic, strict=True):
        density = theory_tables[1][theory_tables[1]["magnification"] == zeta]
        width = density["pressure_GPa"].diff().iloc[1]
        assert density["density_per_GPa"].sum() * width == pytest.approx(area, rel=1e-6)


def test_five_cut_offs_are_chosen_evenly_with_the_last():
    assert magnification.five_of(13) == [2, 5, 7, 10, 12]
    assert magnification.five_of(5) == [0, 1, 2, 3, 4]


def test_the_charts_of_magnification_hold_both_methods(filtered_tables):
    scene = scenes.rough_scene(4, 0, 16)
    against, deviation, density = magnification.draw_magnification(scene, *filtered_tables, 3)
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


def terms_needed(diffusion: float) -> dict[str, float]:
    needed = theory.terms_needed(theory.series_errors([diffusion]))
    return dict(zip(needed["series"], needed["terms"], strict=True))


def test_few_images_at_small_diffusion_and_few_eigenfunctions_at_large():
    small, large = terms_needed(1e-3), terms_needed(1.0)
    assert small["images"] == 1
    assert small["eigenfunctions"] > 15
    assert large["eigenfunctions"] == 1
    # Its terms cancel: no number of them keeps within the target.
    assert math.isnan(large["images"])


def test_where_the_package_changes_its_series_both_are_short():
    from epcontact.persson.series import SWITCH

    assert max(terms_needed(SWITCH**2 / 4).values()) <= 6


def test_finite_volumes_are_of_second_order():
    coarse, fine = theory.finite_volume_errors([64, 128])["relative_error"]
    assert coarse < 1e-4
    assert np.log2(coarse / fine) == pytest.approx(2, abs=0.1)


# --- solvers and growth -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def work():
    scene = scenes.rough_scene(4, 7, 16)
    methods = ("newton", "projected_gradient")
    return bem.solver_costs(scene, methods, (1e-2, 1e-4, 1e-6), max_steps=300)


def test_every_point_meets_its_tolerance_and_effort_rises(work):
    assert (work["residual"] <= work["tolerance"]).all()
    for _, costs in work.groupby("method"):
        assert (costs["fft_pairs"].diff().iloc[1:] > 0).all()


def test_newton_needs_fewer_transforms_than_the_projected_gradient(work):
    pairs = work.groupby("method")["fft_pairs"].last()
    assert pairs["newton"] < pairs["projected_gradient"]
    assert "projected_gradient" in bem.draw_costs(work, (64, 64), 1e-5)[0].caption


def test_areas_settle_with_the_residual(work):
    assert (work.groupby("method")["relative_error"].last() < 1e-3).all()


def test_a_method_that_does_not_converge_is_told_and_stops():
    scene = scenes.rough_scene(4, 7, 16)
    costs = bem.solver_costs(scene, ("newton", "relaxation"), (1e-1, 1e-9), max_steps=30)
    own = costs[costs["method"] == "relaxation"]
    assert own["fft_pairs"].notna().sum() <= 1
    assert np.isnan(own["fft_pairs"].iloc[-1])
    assert own["residual"].iloc[-1] > 1e-9
    caption = bem.draw_costs(costs, (64, 64), 1e-5)[0].caption
    assert "relaxation stops at a residual of" in caption
    assert "after 30 steps" in caption


def test_transforms_do_not_grow_with_the_grid_where_the_roughness_is_fixed():
    costs = growth.grid_costs([(growth.FIXED_ROUGHNESS, n, 16) for n in (4, 8, 16)], quiet)
    assert costs["points_a_side"].tolist() == [64, 128, 256]
    assert costs["finest grid"].iloc[-1] <= costs["finest grid"].iloc[0] + 2
    pairs, times = growth.draw_growth(costs)
    assert "Exponents" in pairs.caption
    assert len(rows_of(times)) == 3


# --- finite elements ----------------------------------------------------------------------------


def test_elements_with_mean_dilatation_find_the_limit_that_others_miss():
    errors = fem.punch_errors([2]).set_index("formulation")["relative_error"]
    assert errors["mean dilatation"] < 0.2
    assert errors["full integration"] > 3 * errors["mean dilatation"]


def test_a_deep_block_is_the_half_space_to_its_longest_wave():
    errors = fem.depth_errors([0.25, 0.5, 1.0], [1], 64)["relative_error"].to_numpy()
    assert errors[0] > errors[1] > errors[2]
    # 64 nodes a wave leave 1e-3 of discretisation.
    assert errors[2] < 2e-3


def test_every_linear_solver_solves_the_same_system():
    found = fem.linear_solves(8).set_index("solver")
    # Nodes on 8 x 8 points, 3 components, on every level but the base.
    assert (found["unknowns"] % (3 * 64) == 0).all()
    assert found["residual"]["Fourier elimination"] < 1e-12
    assert found["residual"]["sparse factorisation"] < 1e-12
    assert found["residual"]["conjugate gradients"] <= 2e-8
    assert (found["time_in_products"] > 0).all()


def test_load_steps_near_their_reference():
    errors = fem.step_errors([1, 2, 4], 4, [7], quiet)
    gaps = errors[errors["quantity"] == "mean gap"]
    one, two = gaps["relative_error"]
    assert two < one < 0.05
    assert gaps["cg_iterations"].is_monotonic_increasing


# --- all methods on one scene -------------------------------------------------------------------


@pytest.fixture(scope="module")
def all_methods():
    return master.solved_areas({"bem": (3, 4, 8), "fem": (3, 4, 8)}, 32, 8, range(2), quiet)


def test_every_method_nears_one_reference(all_methods):
    errors = master.area_errors(all_methods).groupby(["method", "kind"])["relative_error"]
    first, last = errors.first(), errors.last()
    for method in ("bem", "fem"):
        assert (last[method] < first[method]).all()
    # Eight points a wavelength: the grids' claims are 1 % (bem) and 5 % (fem) of the area.
    assert last["bem", "corrected"] < 0.01
    assert last["fem", "corrected"] < 0.05
    # The theory knows the spectrum alone; four shortest waves a roll-off are few of them.
    assert 0 < last["persson", ""] < 0.3


def test_the_master_chart_has_every_method_and_the_reference_s_worth(all_methods):
    chart = master.draw_methods(all_methods, "bem on the finest grid")
    names = {row["series"] for row in rows_of(chart)}
    assert {"persson", "bem, raw", "fem, corrected", master.UNCERTAINTY} <= names
    assert "uncertain by" in chart.caption
    assert "Pareto front" in lines_of(chart)


# --- peers --------------------------------------------------------------------------------------


def test_without_any_peer_one_sentence_says_what_to_install(monkeypatch):
    for name in peers.PEERS:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(StudyUnavailable, match="pip install"):
        peers.installed()


def test_peers_on_several_threads_are_not_compared(monkeypatch):
    monkeypatch.setattr(peers, "installed", dict)
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with pytest.raises(StudyUnavailable, match="set OMP_NUM_THREADS=1"):
        peers.charts("fast", quiet)


def test_a_peer_is_timed_only_where_its_areas_agree():
    def same(heights, load, hardness, _):
        scene = scenes.rough_scene(8, 7, 8, scenes.MODULUS * hardness)
        return solve(scene, threads=1).fields["pressure"] / scenes.MODULUS

    def wrong(heights, load, hardness, _):
        return np.full(heights.shape, load)

    def late(*_):
        raise ChildDied("was killed by SIGXCPU and gave no answer")

    solvers = {"ContactMechanics": same, "tamaas": wrong, "slow": late}
    found = peers.race(8, 8, "capped", solvers, lambda function, *arguments: function(*arguments))
    assert found["agrees"].tolist() == [True, False, False, True, True]
    assert (found["seconds"][found["agrees"]] > 0).all()
    chart = peers.draw_races(found)
    aims = {f"epcontact, {aim}" for aim in speed.AIMS}
    assert {row["series"] for row in rows_of(chart)} == {*aims, "ContactMechanics"}
    assert "Without agreement: tamaas at 64" in chart.caption
    assert f"More than {peers.MOST} times to {speed.TIGHT}: slow at 64" in chart.caption


@pytest.mark.slow
def test_the_system_ends_a_peer_that_takes_too_long():
    child = Child()
    with pytest.raises(ChildDied, match="SIGXCPU"):
        child.call(peers._timed, 0.1, sum, range(10**12))
    child.end()


def test_a_process_that_has_timed_a_peer_has_no_limit_left():
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_CPU)
    assert peers._timed(1.0, sum, [1, 2])[1] == 3
    assert resource.getrlimit(resource.RLIMIT_CPU) == before


def test_areas_agree_within_a_thousandth_only():
    assert peers.agree((0.1, 0.05), (0.1 * 1.0009, 0.05))
    assert not peers.agree((0.1, 0.05), (0.1, 0.05 * 1.002))
    assert not peers.agree((0.1, 0.01), (0.1, 0.0))


@pytest.mark.slow
@pytest.mark.parametrize("law", ["capped", "elastic"])
def test_installed_peers_find_the_same_areas(law):
    pytest.importorskip("tamaas")
    assert peers.race(8, 8, law, peers.installed(), Child().call)["agrees"].all()


# --- every study --------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    [
        "gamma",
        "resolution",
        "areas",
        "magnification",
        "theory",
        "bem",
        "growth",
        "pressures",
        "gap",
        "gap_distribution",
    ],
)
def test_a_fast_study_makes_charts_that_can_be_saved(name, tmp_path):
    charts = STUDIES[name].run("fast")
    files = save_charts(name, charts, tmp_path)
    assert {f.suffix for f in files} == {".png", ".svg", ".csv", ".txt"}
    assert all(len(chart.caption) > 100 for chart in charts)
