"""Studies: each runs at a small size, its charts can be read, and its finding holds."""

import collections
import functools
import inspect
import io
import math
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from command_line import invoke, python
from drawn_texts import texts_with_boxes
from laboratory import time_to_answer
from matplotlib.backends.backend_agg import FigureCanvasAgg

from epcontact import bem, persson
from epcontact.bem.transforms import Convolution
from epcontact.errors import StudyUnavailable
from epcontact.harness.solving import load_path
from epcontact.harness.workers import Worker, WorkerDied
from epcontact.interface import percolation
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.style import typeset
from epcontact.persson.validity import GAMMA, expected_errors
from epcontact.reference import conductance as laws
from epcontact.scene import Body, Load, SelfAffineSpectrum
from epcontact.studies import (
    STUDIES,
    cost,
    fem,
    gap,
    metal,
    peers,
    save_charts,
    theory,
)
from epcontact.studies import paper_scene as scenes
from epcontact.studies.frame import mean_with_interval, root_mean_square, tabulate
from epcontact.studies.hardness import model_scene

#: The options of each study that runs in seconds.
SMALL: dict[str, dict[str, Any]] = {
    "bem": {
        "bandwidth": 16,
        "points": 4,
        "max_steps": 100,
        "tolerances": (1e-2, 1e-4, 1e-6),
    }
    | {"methods": ("newton", "projected_gradient", "relaxation")},
    "accuracy": {},
    "conductance": {"breadths": (2, 3), "loads": (0.03, 0.1), "seeds": (1, 2)},
    "fem": {
        "nodes": (3, 4, 6),
        "steps": (1, 2, 4),
        "sample": (4, (7,)),
    }
    | {"paths": ([(8, 4), (16, 8)], (5, 6))},
    "gamma": {"points": 4, "bandwidth": 64},
    "gap": {
        "points": 4,
        "bandwidth": 16,
        "seeds": range(3),
        "grids": (3, 6),
        "block_waves": 4,
    },
    "hardness": {"surfaces": 2, "nodes": 12, "severities": (5.0, 15.0), "nus": (0.3,)},
    "hardness-map": {},
    "metal": {
        "severities": (5.0,),
        "seeds": (101, 102),
        "nodes_per_wavelength": 6,
        "waves": 4,
    },
    "magnification": {"points": 4, "bandwidth": 16, "count": 5, "seeds": range(3)},
    "speed": {"sides": (64, 128), "threads": 1, "solves": (1, 1)},
    "validity": {"points": (6, 8)},
}


@functools.cache
def charts_of(name):
    """Return the charts of a study with the options SMALL, computed once."""
    return STUDIES[name].run(**SMALL[name])


def drawn(name, number):
    """Return the data that a chart of a study draws, as a table; `number` counts the
    charts from 1.
    """
    return pd.read_csv(io.StringIO(charts_of(name)[number - 1].csv()))


def of_kind(table, kind, column="relative_error"):
    """Return a column of one series of a chart's table, as an array (n,)."""
    return table[table["series"] == kind][column].to_numpy()


# --- every study ----------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(SMALL))
def test_a_chart_names_its_study_and_options_and_its_bounds_hold_its_values(name):
    """Each caption names the study and its options, and every value is between its
    bounds.

    Columns 1 to 4 of a chart's table are x, y, low and high.
    """
    study = STUDIES[name]
    assert 20 < len(study.description) < 100
    assert set(study.full) <= set(inspect.signature(study.function).parameters)
    questions = []
    for number, chart in enumerate(charts_of(name), 1):
        questions.append(chart.caption.partition("?")[0])
        assert len(questions[-1]) < 75  # the title
        assert study.description in chart.caption
        assert all(option in chart.caption for option in SMALL[name])
        table = drawn(name, number).dropna(subset="low")
        x, y, low, high = table.iloc[:, 1:5].to_numpy().T
        rounding = 1e-12  # zero is drawn at 1e-12, and the fractions are sums
        assert (low <= y + rounding).all()
        assert (y <= high + rounding).all()
        assert not x.size or (low < high).any()
    assert len(set(questions)) == len(questions)


@pytest.mark.parametrize("name", sorted(SMALL))
def test_a_chart_of_a_study_has_its_question_as_title_and_no_text_is_cut(
    name, monkeypatch
):
    """Each chart has the question that its caption begins with above its axes; no text
    is cut by the edge of the picture or is raw mathtext.
    """
    for chart in charts_of(name):
        figure = chart.figure
        boxes = texts_with_boxes(figure, monkeypatch)
        title = max(boxes, key=lambda item: item[1].y1)[0]
        question = f"{chart.caption.partition('?')[0]}?"
        assert typeset(title, mathtext=False).startswith(question[:5])
        assert title.endswith("?")
        page = figure.bbox.padded(0.5)
        for text, box in boxes:
            assert np.all(page.min <= box.min), text
            assert np.all(box.max <= page.max), text
            assert r"\$" not in text


@pytest.mark.parametrize("name", sorted(SMALL))
def test_the_gallery_of_the_guide_has_each_chart(name):
    """The page has a picture for each chart of a study, with the chart's question as
    its text, and a section with the command.
    """
    guide = Path(__file__).parent.parent / ".docs"
    page = (guide / "gallery.md").read_text(encoding="utf-8")
    section = page.partition(f"\nepcontact chart {name}\n")[2].partition("\n## ")[0]
    pictures = re.findall(r"^!\[(.*)\]\((.*)\)$", section, re.MULTILINE)
    questions = [f"{chart.caption.partition('?')[0]}?" for chart in charts_of(name)]
    assert [words.replace("\\", "") for words, _ in pictures] == questions
    assert all((guide / file).is_file() for _, file in pictures)


def test_finite_elements_near_the_gap_of_boundary_elements():
    """For each law of plasticity, 6 points a wave bring finite elements within 5 % of
    the gap of boundary elements, and closer than 3 points do by half.
    """
    table = drawn("gap", 5).set_index("series")["deviation_percent"]
    off = table.abs().groupby(level=0).max()
    for law in scenes.LAWS:
        assert off[f"{law}, 6 points"] < min(5, 0.5 * off[f"{law}, 3 points"])
    j2, cap = (
        drawn("gap", 4).groupby("series")[gap.OPEN].last()[["fem, j2", "bem, capped"]]
    )
    assert table["j2, 6 points"].iloc[-1] == pytest.approx(100 * (j2 / cap - 1))
    # J2 at 3 times the yield stress flows more than the cap: the model, not the grid.
    assert table["j2, 6 points"].iloc[-1] < -20


def test_errors_of_finite_elements_fall():
    """Errors of finite elements fall with the depth of the block (in longest waves),
    and with the number of load steps.
    """
    shallow, deep, deepest = (
        fem.depth_error(1, depth)["relative_error"] for depth in (0.25, 0.5, 1.0)
    )
    assert shallow > deep > deepest
    assert deepest < 2e-3  # 64 nodes a wave leave 1e-3 of discretisation
    few_steps, many_steps = of_kind(drawn("fem", 3), "mean gap")
    assert many_steps < few_steps < 0.05


def test_the_errors_of_a_capped_metal_are_those_of_single_solves():
    """Errors of the theory at 3 sigma_Y equal those from single solves of one body.

    The body of the study is unloaded after each load; here it is loaded once.
    """
    severity, seed, load = 5.0, 101, 0.25
    scene = model_scene(severity, 0.3, seed, 24, 4)
    stress = scene.material.yield_stress
    rows = pd.DataFrame(metal.compare(scene))
    rows = rows[(rows["load"] == load) & (rows["model"] == "theory, 3 sigma_Y")]
    errors = rows.set_index("quantity")["error"]
    body = replace(scene, load=Load(load * stress), body=Body())
    j2 = scenes.solve_j2(body, tolerance=1e-4)
    theory = scenes.solve_theory(body)
    area, plastic = (scenes.area_of(j2, part) for part in ("total", "plastic"))
    by_theory = {part: scenes.area_of(theory, part) for part in ("total", "plastic")}
    at_hardness = (j2.fields["pressure"] >= 3 * stress).mean()
    gaps = [result.final.quantities["mean_gap"] for result in (theory, j2)]
    expected = {
        "area": by_theory["total"] / area - 1,
        "flowed": (by_theory["plastic"] - plastic) / area,
        "pressed": (by_theory["plastic"] - at_hardness) / area,
        "gap": gaps[0] / gaps[1] - 1,
    }
    for quantity, error in expected.items():
        assert errors[quantity] == pytest.approx(error, abs=3e-3)
    table = drawn("metal", 1)
    heavy = table[(table["quantity"] == "area") & (table["load"] > 0.1)]
    mean = heavy.groupby("model")["error"].mean()
    assert abs(mean["boundary elements, hardness of the map"]) < 0.08
    assert mean["theory, 3 sigma_Y"] < mean["theory, hardness of the map"] < 0


def test_charts_are_saved_under_the_study_s_name(tmp_path):
    """A single chart is saved under the study's name, two charts with a number, each as
    four files.
    """
    charts = charts_of("conductance")
    save_charts("alone", charts[:1], tmp_path)
    save_charts("pair", charts, tmp_path)
    names = []
    for stem in ("alone", "pair-1", "pair-2"):
        names += [f"{stem}{end}" for end in (".csv", ".png", ".svg", ".txt")]
    assert sorted(path.name for path in tmp_path.iterdir()) == names


def test_rows_are_the_product_of_the_axes():
    """`tabulate` calls a function for each combination of the axes' values, and reports
    each.
    """
    said: list[str] = []

    def row(load, law):
        """Return a row with the load as its area."""
        return {"area": load}

    table = tabulate(said.append, row, load=(0.5, 2.0), law=("a", "b"))
    assert table.to_numpy().tolist() == [
        [p, law, p] for p in (0.5, 2.0) for law in "ab"
    ]
    assert said[1] == "load 0.5, law b"


#: Three surfaces under one law and two under another, with Student's t for each.
SURFACES = pd.DataFrame(
    {
        "law": ["b", "a", "b", "b", "a"],
        "x": [2.0, 5.0, 4.0, 9.0, 7.0],
        "share": [0.05, 0.5, 0.1, 0.9, 0.7],
        "claim": [0.3, 0.1, 0.6, 0.9, 0.2],
        "seed": [1, 1, 2, 3, 2],
    }
)
STUDENT = {"a": 12.706205 / math.sqrt(2), "b": 4.302653 / math.sqrt(3)}


@pytest.mark.parametrize(
    ("value", "error"), [("x", ""), ("x", "claim"), ("share", "claim")]
)
def test_the_interval_of_a_mean_is_student_s_and_shared_errors_stay(value, error):
    """The 95 % interval of a mean has Student's half-width; the mean of the column
    `error`, which all surfaces share, is added in quadrature.

    Ends of the column "share", a fraction of the area, are clipped to 0 and 1.
    """
    found = mean_with_interval(SURFACES, value, ["law"], error).set_index("law")
    assert len(found) == 2
    for law, surfaces in SURFACES.groupby("law"):
        mean = surfaces[value].mean()
        half_width = STUDENT[law] * surfaces[value].std()
        if error:
            half_width = math.hypot(half_width, surfaces[error].mean())
        ends = [mean - half_width, mean + half_width]
        if value == "share":
            ends = np.clip(ends, 0, 1).tolist()  # of the area
        row = found.loc[law, [value, f"{value}_low", f"{value}_high"]]
        assert row.tolist() == pytest.approx([mean, *ends], rel=1e-6)


def test_root_mean_squares_are_taken_for_each_law():
    """Column x is averaged in the root mean square, other columns arithmetically."""
    means = root_mean_square(SURFACES, "x", ["law"])
    expected = [[math.sqrt(101 / 3), 0.35], [math.sqrt(37), 0.6]]
    assert means[["x", "share"]].to_numpy() == pytest.approx(np.array(expected))


# --- materials and joints -------------------------------------------------------------


def test_laws_of_conductance_differ_as_their_formulas():
    """The ratio of two laws in the chart is that of their formulas, because the
    boundary elements cancel in it.

    The formula that was fitted to boundary elements is within 15 % of them, and the
    others are at least twice as far off.
    """
    table = drawn("conductance", 1)
    ratios = table.pivot(
        index=["load", "hardness"],
        columns="series",
        values="law_over_boundary_elements",
    )
    load, hardness = np.array([*ratios.index]).T
    mikic = laws.LAWS["Mikic, elastic"](load, hardness)
    for name, law in laws.LAWS.items():
        expected = law(load, hardness) / mikic
        found = ratios[name] / ratios["Mikic, elastic"]
        assert found.to_numpy() == pytest.approx(expected, rel=1e-9)
    # The formula that was fitted to boundary elements is near them at every place.
    assert np.abs(ratios["epcontact"] - 1).max() < 0.15
    farthest = np.abs(ratios - 1).max()
    assert farthest.drop("epcontact").min() > 2 * farthest["epcontact"]


def test_the_cap_of_equal_area_has_more_of_the_j2_contact_than_three_yield_stresses():
    """The effective hardness, in yield stresses, overlaps more of the J2 contact than
    the usual hardness of three yield stresses.
    """
    hardness = drawn("hardness", 1)["effective_hardness"]
    assert 1.5 < hardness[0] < hardness[1] < 3
    of_equal_area = drawn("hardness", 2)["effective_overlap"]
    of_three = drawn("hardness", 3)["model_overlap"]
    assert (of_equal_area > of_three).all()
    assert (drawn("hardness", 4)["model_area"] > 0).all()


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_the_formula_of_the_hardness_is_near_the_places_of_the_map(number):
    """The root mean square deviation of the fitted formula from the map is below the
    4.1 % of the caption, on each of the four charts.
    """
    table = drawn("hardness-map", number)
    is_formula = table["series"].str.endswith(", formula")
    curves = dict(iter(table[is_formula].groupby("series")))
    deviations = []
    for name, places in table[~is_formula].groupby("series"):
        curve = curves[f"{name.rpartition(' ')[2]}, formula"].sort_values("load")
        loads = np.log(curve["load"])
        values = curve["effective_hardness"]
        expected = np.interp(np.log(places["load"]), loads, values)
        deviations.extend(places["effective_hardness"] / expected - 1)
    assert len(deviations) > 30
    # The caption says that the formula misses 4.1 %, twice the root mean square.
    assert math.sqrt(np.mean(np.square(deviations))) < 0.041


def test_the_errors_of_the_theory_are_those_that_a_result_reports():
    """The charted errors of the theory equal `expected_errors` at five places of the
    map.
    """
    table = drawn("validity", 1).dropna()
    lowest = scenes.LOWEST
    spectrum = SelfAffineSpectrum(0.8, lowest, 4 * lowest, 256 * lowest, 1.0)
    roughness = persson.analytic_roughness(spectrum)
    for _, row in table[:: len(table) // 5].iterrows():
        hardness = row["hardness_over_slope_modulus"] * scenes.MODULUS
        pressure = row["pressure_over_slope_modulus"] * scenes.MODULUS
        reduction = persson.EnergyReduction(GAMMA)
        body = persson.Theory(roughness, scenes.MODULUS, reduction, hardness)
        error = expected_errors(body, pressure)[row["series"]]
        found = row[["low", "relative_error", "high"]]
        assert found.tolist() == pytest.approx([*error], rel=1e-9)


# --- theory ---------------------------------------------------------------------------


def fits_of_gamma(width, gamma, gamma_elastic):
    """Return fits of gamma, rows of (best, low, high), to areas that the theory
    computes.

    Args:
        width: half-width of the interval of an area over the area.
        gamma: energy reduction of the body with hardness.
        gamma_elastic: energy reduction of the elastic body.
    """
    fits = []
    for name in theory.AREAS:
        part = "total"
        hardness = math.inf
        reduction = gamma_elastic
        if name in scenes.PARTS:
            part = name
            hardness = scenes.HARDNESS
            reduction = gamma
        diffusion = reduction * scenes.MODULUS**2 / 8
        contact = persson.areas(diffusion, scenes.MEAN_PRESSURE, hardness)
        area = float(getattr(contact, part))
        row = {
            "area": name,
            "area_fraction": area,
            "area_fraction_low": area * (1 - width),
            "area_fraction_high": area * (1 + width),
        }
        fits.append(theory.fit_gamma(theory.theory_areas(), row))
    return fits


def test_areas_of_the_theory_give_back_their_gamma():
    """A fit to areas of the theory returns the gamma that was put in, and `one_gamma`
    tells whether one value fits all intervals.
    """
    # The table's steps of 0.005, between which it is linear, leave curvature times
    # 3e-6.
    fits = np.array(fits_of_gamma(1e-3, 0.536, 0.536))
    assert fits[:, 0] == pytest.approx(0.536, abs=2e-5)
    assert theory.one_gamma(fits_of_gamma(1e-3, 0.5, 0.5))
    assert not theory.one_gamma(fits_of_gamma(1e-3, 0.5, 0.6))
    # Intervals wide enough to hold both are no evidence.
    assert theory.one_gamma(fits_of_gamma(0.2, 0.5, 0.6))
    # No gamma fits the capped and the elastic body of boundary elements.
    assert "no single gamma fits" in charts_of("gamma")[0].caption


def test_an_area_that_no_gamma_gives_has_no_fit():
    """The fit of gamma to a total area of 0.9, which no gamma gives, is NaN."""
    ends = ("area_fraction", "area_fraction_low", "area_fraction_high")
    row = dict.fromkeys(ends, 0.9) | {"area": "total"}
    assert np.isnan(theory.fit_gamma(theory.theory_areas(), row)).all()


def test_boundary_elements_lose_contact_with_the_magnification_as_the_theory_does():
    """The contact area falls with the magnification, within 25 % of the theory, whose
    pressure densities integrate to the elastic area.
    """
    areas, deviations, densities = (drawn("magnification", n) for n in (1, 2, 3))
    found = of_kind(areas.sort_values("magnification"), "total, bem", "area_fraction")
    assert (np.diff(found) < 0).all()
    # So few waves are a coarse sample of the theory's continuum of them.
    assert np.abs(of_kind(deviations, "total", "deviation_percent")).max() < 25
    # The densities hold the elastic area.
    curve = areas[areas["series"] == "elastic, theory"]
    for zeta in np.unique(areas[areas["series"] == "total, bem"]["magnification"])[2:]:
        exact = np.interp(zeta, curve["magnification"], curve["area_fraction"])
        density = densities[densities["series"] == f"zeta = {zeta:.3g}, theory"]
        width = density["pressure_GPa"].diff().iloc[1]
        assert density["density_per_GPa"].sum() * width == pytest.approx(
            exact, rel=1e-3
        )


# --- cost -----------------------------------------------------------------------------


def test_newton_needs_fewer_transforms_and_a_method_that_fails_is_told():
    """Newton's method takes fewer FFT pairs than the projected gradient, and the
    caption names the method that stopped early.
    """
    residuals, errors = drawn("bem", 1), drawn("bem", 2)
    pairs = residuals.groupby("series")["fft_pairs"].last()
    assert pairs["newton"] < pairs["projected_gradient"]
    assert of_kind(errors, "newton")[-1] < 1e-3
    assert "relaxation stops at a residual of" in charts_of("bem")[0].caption


@pytest.mark.parametrize("law", scenes.LAWS)
def test_a_solve_to_areas_costs_less_and_has_them(law):
    """A solve to the accuracy of the areas takes no more FFT pairs than one to a tight
    tolerance, and its areas are accurate.
    """
    speed = drawn("speed", 1)
    tight, loose = (of_kind(speed, f"{law}, {aim}", "all_pairs") for aim in cost.AIMS)
    assert (loose <= tight).all()
    # Of these grids only the larger one has a coarser grid to start from.
    assert tight[-1] <= 27
    # So small a grid has areas in steps of one point, which is this share of the
    # smallest.
    errors = drawn("speed", 4)
    assert (errors["area_error"] <= cost.AREA + 20 / errors["points_a_side"] ** 2).all()


# --- peers ----------------------------------------------------------------------------


def test_a_comparison_that_is_not_possible_says_why(monkeypatch):
    """Without installed peers, or with several threads, the study `peers` raises
    StudyUnavailable with the remedy.
    """
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with monkeypatch.context() as without:
        without.setattr(peers, "installed", dict)
        with pytest.raises(StudyUnavailable, match="set OMP_NUM_THREADS=1"):
            STUDIES["peers"].run()
    for name in peers.PEERS:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(StudyUnavailable, match="pip install"):
        STUDIES["peers"].run()


def test_a_peer_is_timed_only_where_its_areas_agree():
    """Of three invented peers one agrees, one has a wrong pressure and one exceeds its
    time limit; only the first is drawn, and the title names the others.
    """

    def same(heights, load, hardness, _):
        """Return the pressures over E*, by the package itself, as if it were another
        code.

        `load` and `hardness` are over E*; the heights are those of the scene built
        here.
        """
        scene = scenes.rough_scene(8, 7, 8, scenes.MODULUS * hardness)
        return bem.solve(scene, threads=1).fields["pressure"] / scenes.MODULUS

    def late(*_):
        """Raise the error of a worker that exceeds its time limit."""
        raise WorkerDied("was not finished within 3 s and was ended")

    def wrong(heights, load, *_):
        """Return a uniform pressure, which is no solution."""
        return np.full(heights.shape, load)

    solvers = {"ContactMechanics": same, "tamaas": wrong, "slow": late}

    def call(function, solve, limit):
        """Call a solver in this process, without a time limit."""
        return function(solve)

    found = pd.DataFrame(peers.race("capped", 8, solvers, call)).assign(law="capped")
    assert found["agrees"].tolist() == [True, False, False, True, True]
    plot, table, caption = peers.race_chart(found)
    named = [("ContactMechanics", ""), *(("epcontact", aim) for aim in cost.AIMS)]
    assert [*table[[*plot.series]].itertuples(index=False, name=None)] == named
    parts = [part.partition(" at 64")[0] for part in caption.split("? ")[1].split(". ")]
    late = f"More than {peers.MOST} times to {cost.TIGHT}: slow"
    assert parts == ["Setting: ContactMechanics", "Without agreement: tamaas", late]
    # Areas agree within a thousandth only.
    assert peers.agree((0.1, 0.05), (0.1 * 1.0009, 0.05))
    assert not peers.agree((0.1, 0.05), (0.1, 0.05 * 1.002))


@pytest.mark.slow
@pytest.mark.parametrize("law", ["capped", "elastic"])
def test_installed_peers_find_the_same_areas(law):
    """Every installed peer's contact area agrees with the package's."""
    pytest.importorskip("tamaas")
    assert all(
        row["agrees"] for row in peers.race(law, 8, peers.installed(), Worker().call)
    )


# --- work of commands -----------------------------------------------------------------


def test_every_study_is_run():
    """The options of every study stand in SMALL; `peers` needs other packages."""
    assert STUDIES.keys() - {"peers"} == SMALL.keys()


@pytest.fixture
def counts(monkeypatch):
    """Return a `Counter` of the work of commands that run in this process.

    Its keys are "pairs" (of FFTs, in double precision on 128 x 128 points; a pair in
    single precision counts as half), "fields" (files), "percolation" (passes over a
    grid), "pictures" and "drawings" (of figures).
    """
    counted = collections.Counter()

    def count(owner, name, key, amount=lambda *_: 1):
        """Count the calls of a function, each by an amount from its arguments."""
        function = getattr(owner, name)

        def counting(*arguments, **options):
            """Count this call and return what the function returns."""
            counted[key] += amount(*arguments)
            return function(*arguments, **options)

        monkeypatch.setattr(owner, name, counting)

    def pairs(convolution, *_):
        """Return a pair of a convolution in those of 128 x 128 points."""
        return math.prod(convolution.shape) * convolution._dtype.itemsize / 8 / 128**2

    count(Convolution, "_multiply", "pairs", pairs)
    count(percolation, "label_points", "percolation")
    count(load_path, "write_fields", "fields")
    count(Chart, "png", "pictures")
    count(FigureCanvasAgg, "draw", "drawings")
    return counted


def test_commands_do_no_work_twice(counts, monkeypatch, tmp_path):
    """On the paper's scene a solve takes 25 FFT pairs and its interface 35 more, and
    percolation takes 31 passes, all of which `verify` has no need for.

    Each chart is drawn once, by `run --charts` as by `report`; a second report draws
    none.  Counts do not depend on the machine: a command that slows down because it
    does more fails here.
    """
    monkeypatch.chdir(tmp_path)
    highest = scenes.LOWEST * 128 / time_to_answer._POINTS
    text = time_to_answer._CASE.format(highest=highest)
    (tmp_path / "time.toml").write_text(text)

    def work_of(command):
        """Return the counts of a command."""
        counts.clear()
        assert invoke(*command.split()).returncode == 0
        return collections.Counter(counts)

    run = work_of("run time.toml --jobs 1 --charts")
    assert 22 < run["pairs"] < 65
    assert 0 < run["percolation"] <= 35
    assert run["fields"] == 1
    assert run["pictures"] == run["drawings"] == len([*tmp_path.rglob("*.png")]) == 4
    verify = work_of("verify time.toml --jobs 1 --fresh")
    assert 22 < verify["pairs"] < 28
    assert verify.keys() == {"pairs"}
    report = work_of("report results")
    assert report == {"pictures": 3, "drawings": 3}
    assert not work_of("report results")


@pytest.mark.parametrize("command", ["run_and_verify", "plan"])
def test_commands_that_draw_nothing_load_no_library_that_draws(command):
    """The modules of `run` and `plan` load neither charts nor tables of pandas."""
    heavy = {"matplotlib", "pandas", "pyvista", "vtkmodules", "jinja2", "PIL"}
    program = (
        f"import sys, epcontact.cli.{command}\n"
        f"print(sorted({heavy} & set(sys.modules)))"
    )
    assert python("-c", program).stdout == "[]\n"
