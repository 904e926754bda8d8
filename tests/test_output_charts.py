"""Charts: the numbers drawn are the numbers given, and the pictures are fit to be read."""

from __future__ import annotations

import csv
import io
import itertools
import math
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from epcontact.errors import OutputError
from epcontact.output.charts import curves as charts
from epcontact.output.charts import maps
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import (
    Plot,
    draw_table,
    observed_order,
    pareto_front,
    series_looks,
)
from epcontact.output.charts.style import PART_COLOURS, SETTINGS, STATE_COLOURS, unit_for
from epcontact.results import (
    APART,
    ELASTIC,
    PLASTIC,
    ContactResult,
    LoadStep,
    PressureDistribution,
    Provenance,
)

RNG_SEED = 20260721
SPACING = (2e-6, 1e-6)


def blob(shape: tuple[int, ...] = (60, 90)) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """State, pressure and gap of one round contact away from the middle."""
    places = [np.arange(n) / n for n in shape]
    around = np.meshgrid(*places, indexing="ij")
    top = 0.06 - sum((a - c) ** 2 for a, c in zip(around, (0.3, 0.6), strict=False))
    pressure = np.clip(top * 5e12, 0, 1.5e11)
    state = np.where(pressure >= 1.5e11, PLASTIC, np.where(pressure > 0, ELASTIC, APART))
    return state.astype(np.uint8), pressure, np.where(pressure > 0, 0, -1e-6 * top)


def make_map() -> Chart:
    state, pressure, _ = blob()
    return maps.contact_map(state, pressure, SPACING, hardness=1.5e11)


def make_difference() -> Chart:
    _, pressure, _ = blob()
    return maps.pressure_difference(pressure, 0.98 * pressure, SPACING)


def make_profile() -> Chart:
    state, pressure, gap = blob((80,))
    return maps.contact_profile(state, pressure, gap, (1e-6,))


def make_stability() -> Chart:
    effort = np.random.default_rng(RNG_SEED).integers(5, 900, (7, 5)).astype(float)
    effort[4:, 3:] = np.nan
    return maps.stability_map(
        {"newton": effort, "polonsky-keer": 3 * effort},
        np.linspace(0.04, 0.67, 7),
        np.geomspace(0.2, 1.2, 5),
        labels=("mean pressure / hardness (–)", "hardness / (E* slope) (–)"),
        count="FFT pairs",
    )


def answer(method: str, scale: float, plastic: float) -> ContactResult:
    sigma = np.linspace(0, 1.5e11, 80)
    table = PressureDistribution(sigma, scale * np.sin(sigma / 3e11 * np.pi) ** 2, plastic)
    return ContactResult(method, (LoadStep(1.25e10, {}),), Provenance("x"), table)


def make_distribution() -> Chart:
    sigma = np.linspace(0, 1.5e11, 80)
    density = 4e-13 * np.sin(np.pi * sigma / 1.5e11)
    return charts.pressure_distribution(
        {
            "persson": [answer("persson", 0.06, 0.06)],
            "bem": [answer("bem", 0.05, 0.05), answer("bem", 0.07, 0.07)],
        },
        hardness=1.5e11,
        theory=pd.concat(
            [
                density_of("persson", sigma, density),
                density_of("without hardness", 1.3 * sigma, 2 * density),
            ]
        ),
    )


def density_of(name: str, pressure: np.ndarray, density: np.ndarray) -> pd.DataFrame:
    return pd.DataFrame({"series": name, charts.PRESSURE: pressure, charts.DENSITY: density})


def make_areas() -> Chart:
    """Curves and marks of parts that share colours, on logarithmic axes with uprights."""
    zeta = np.geomspace(1, 256, 40)
    plastic = 0.0572 * np.exp(-30 / zeta)
    total = 0.11 + 0.89 / zeta
    parts = {"total": total, "elastic": total - plastic, "plastic": plastic}
    tables = [
        pd.DataFrame({"part": name, "magnification": zeta, "area": area, "method": "theory"})
        for name, area in parts.items()
    ]
    ends = pd.DataFrame(
        {"part": ["total", "plastic"], "magnification": 256, "area": [0.11, 0.0572]}
    )
    plot = Plot(
        ("magnification", "magnification (–)"),
        ("area", "contact area (–)"),
        series=("part", "method"),
        styles={"theory": "curve", "limit": "open"},
        colour="part",
        colours=PART_COLOURS,
        log="xy",
        upright={"first": 2.0, "last": 250.0},
    )
    return draw_table(pd.concat([*tables, ends.assign(method="limit")]), plot, "Areas.")


def test_intervals_wider_than_all_differences_are_said() -> None:
    table = pd.DataFrame(
        {"series": "E* xi / sigma_Y = 5", "x": [1.0, 2.0, 3.0], "y": [1.0, 1.1, 1.05]}
    )
    plot = Plot(("x", "E* xi / sigma_Y (–)"), ("y", "y (–)"))
    for width, said in ((0.5, True), (0.04, False)):
        wide = table.assign(y_low=table["y"] - width, y_high=table["y"] + width)
        chart = draw_table(wide, plot, "At E* xi/sigma_Y = 5.")
        (axes,) = chart.figure.axes
        assert ("decides nothing" in chart.caption) is said
        assert bool(axes.get_title()) is said
        assert chart.caption.startswith("At E*ξ/σ_Y = 5.")
        assert axes.get_xlabel() == r"$E^*\xi\,/\,\sigma_\mathrm{Y}$ (–)"
        assert r"$E^*\xi" in axes.get_legend().get_texts()[0].get_text()
        assert chart.rows[0][0] == "E* xi / sigma_Y = 5"  # data keep plain names


def make_short() -> Chart:
    """Axes of little more than a decade, where matplotlib labels minor ticks, and bounds."""
    q = np.geomspace(3, 60, 6)
    columns = {"q": q, "power": 1 / q, "power_low": 0.9 / q, "power_high": 1.1 / q}
    table = pd.concat(pd.DataFrame({"series": name} | columns) for name in ("bem", "analytic"))
    plot = Plot(("q", "q (rad/m)"), ("power", "power (m)"), styles={"analytic": "curve"}, log="xy")
    return draw_table(table, plot, "Two spectra.")


def make_history() -> Chart:
    return charts.residual_history({"newton": 10.0 ** -np.arange(30)})


MAKERS: list[Callable[[], Chart]] = [
    make_map,
    make_difference,
    make_profile,
    make_stability,
    make_distribution,
    make_areas,
    make_short,
    make_history,
]


@pytest.fixture(scope="module")
def made() -> dict[str, Chart]:
    return {make.__name__: make() for make in MAKERS}


NAMES = [make.__name__ for make in MAKERS]


@pytest.mark.parametrize("name", NAMES)
def test_every_axis_names_its_unit(made: dict[str, Chart], name: str) -> None:
    figure = made[name].figure
    for axes in figure.axes:
        labels = [axes.get_xlabel(), axes.get_ylabel()]
        colour_bar = hasattr(axes, "_colorbar")
        shares_y = axes is not figure.axes[0] and name == "make_stability"
        for label in labels[1:] if colour_bar else labels[:1] if shares_y else labels:
            assert re.search(r"\(.+\)", label), f"{label!r} of {name} has no unit"


def drawn_texts(figure: Any, monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, Any]]:
    """Every text that is really drawn, with its box in pixels."""
    boxes: list[tuple[str, Any]] = []
    draw = mpl.text.Text.draw

    def recording(self: Any, renderer: Any) -> None:
        if self.get_visible() and self.get_text().strip():
            boxes.append((self.get_text(), self.get_window_extent(renderer)))
        draw(self, renderer)

    with monkeypatch.context() as patch:
        patch.setattr(mpl.text.Text, "draw", recording)
        figure.canvas.draw()
    return boxes


def misplaced(boxes: list[tuple[str, Any]], page: Any) -> list[str]:
    """Texts that are cut off and pairs that overlap; one pixel is the rounding of the layout."""
    wrong = [
        label
        for label, box in boxes
        if box.x0 < -1 or box.y0 < -1 or box.x1 > page.x1 + 1 or box.y1 > page.y1 + 1
    ]
    for (one, first), (two, second) in itertools.combinations(boxes, 2):
        beside = first.x1 <= second.x0 + 1 or second.x1 <= first.x0 + 1
        above = first.y1 <= second.y0 + 1 or second.y1 <= first.y0 + 1
        if not beside and not above:
            wrong.append(f"{one} / {two}")
    return wrong


@pytest.mark.parametrize("name", NAMES)
def test_no_two_texts_overlap_and_none_is_cut_off(
    made: dict[str, Chart], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    figure = made[name].figure
    boxes = drawn_texts(figure, monkeypatch)
    assert len(boxes) > 5
    assert misplaced(boxes, figure.bbox) == []


def test_misplaced_texts_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    figure = make_history().figure
    label = figure.axes[0].xaxis.label.get_window_extent()
    figure.text(label.x0 / figure.bbox.x1, label.y0 / figure.bbox.y1, "upon the label")
    figure.text(0.99, 0.5, "out of the page")
    wrong = misplaced(drawn_texts(figure, monkeypatch), figure.bbox)
    assert wrong == ["out of the page", "iterations (–) / upon the label"]


@pytest.mark.parametrize("name", NAMES)
def test_a_chart_is_four_files(made: dict[str, Chart], name: str, tmp_path: Path) -> None:
    chart = made[name]
    paths = chart.save(tmp_path / name)
    assert [p.suffix for p in paths] == [".png", ".svg", ".csv", ".txt"]
    assert paths[0].read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in paths[1].read_bytes()
    assert chart.caption + "\n" == paths[3].read_text()
    rows = list(csv.reader(io.StringIO(paths[2].read_text())))
    assert len(rows) == len(chart.rows) + 1 > 1
    assert {len(row) for row in rows} == {len(chart.header)}


@pytest.mark.parametrize("make", [make_difference, make_areas])  # an image, and curves
def test_a_chart_is_the_same_files_again(make: Callable[[], Chart], tmp_path: Path) -> None:
    paths, again = (make().save(tmp_path / folder / "chart") for folder in "ab")
    for first, second in zip(paths, again, strict=True):
        assert first.read_bytes() == second.read_bytes()


def test_the_data_keep_every_digit() -> None:
    chart = charts.residual_history({"bem": [1 / 3, math.pi, math.e]})
    rows = list(csv.reader(io.StringIO(chart.csv())))[1:]
    assert [float(row[2]) for row in rows] == [1 / 3, math.pi, math.e]


def test_all_files_or_none(tmp_path: Path) -> None:
    (tmp_path / "x.csv").mkdir()
    with pytest.raises(OutputError, match=r"x\.csv.*is a folder"):
        make_history().save(tmp_path / "x")
    assert os.listdir(tmp_path) == ["x.csv"]


def test_matplotlib_is_left_as_it_was() -> None:
    code = (
        "import sys, matplotlib as mpl; mpl.rcParams['font.size'] = 33.0;"
        "from epcontact.output.charts.curves import *;"
        "chart = residual_history({'a': [1, 2]}); chart.png();"
        "assert mpl.rcParams['font.size'] == 33.0; assert 'matplotlib.pyplot' not in sys.modules;"
        f"assert chart.figure.axes[0].xaxis.label.get_size() == {SETTINGS['axes.labelsize']};"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_states_look_the_same_everywhere() -> None:
    state, pressure, _ = blob()
    figure = maps.contact_map(state, pressure, SPACING).figure
    legend = {t.get_text().split()[0]: p for p, t in legend_entries(figure.legends[0])}
    for kind, name in ((APART, "apart"), (ELASTIC, "elastic"), (PLASTIC, "plastic")):
        assert mpl.colors.to_hex(legend[name].get_facecolor()) == STATE_COLOURS[kind]
    lines = {line.get_label(): line for line in make_areas().figure.axes[0].lines}
    assert lines["elastic, theory"].get_color() == STATE_COLOURS[ELASTIC]
    assert lines["plastic, theory"].get_color() == lines["plastic, limit"].get_color() == "#000000"


PLOT = Plot(x=("cost_s", "cost (s)"), y=("error", "error (–)"), log="xy")


def table_of(**series) -> pd.DataFrame:
    """One row a point of the series, each given as its costs and errors."""
    return pd.concat(
        pd.DataFrame({"series": name, "cost_s": x, "error": y}) for name, (x, y) in series.items()
    )


def lines_of(chart: Chart) -> dict[str, Any]:
    return {line.get_label(): line for line in chart.figure.axes[0].lines}


def test_a_chart_s_table_holds_what_is_drawn() -> None:
    table = table_of(falling=([1, 10, 100], [0.1, 0.01, 0.001]), flat=([1, 100], [1, 1]))
    table["style"] = np.where(table["series"] == "flat", "curve", "points")
    chart = draw_table(table, replace(PLOT, front=True), "A caption.")
    assert [row[2] for row in chart.rows] == [0.1, 0.01, 0.001, 1.0, 1.0]
    assert np.array_equal(lines_of(chart)["Pareto front"].get_ydata(), [0.1, 0.01, 0.001])


def test_bounds_of_a_column_are_drawn_and_tabled() -> None:
    table = table_of(one=([1, 2], [3, 4])).assign(error_low=[2.5, 3.5], error_high=[3.5, 4.5])
    chart = draw_table(table, PLOT, "A caption.")
    assert [row[3:] for row in chart.rows] == [(2.5, 3.5), (3.5, 4.5)]
    assert len(chart.figure.axes[0].collections) == 1


def test_a_point_without_error_ends_the_front() -> None:
    table = table_of(a=([1, 5], [0.1, 0.0]), b=([3, 9], [0.01, 0.001]))
    chart = draw_table(table, replace(PLOT, front=True), "A caption.")
    assert np.array_equal(lines_of(chart)["Pareto front"].get_xdata(), [1, 3])


def test_the_legend_tells_the_observed_order_where_it_is_asked_for() -> None:
    x = np.array([1.0, 2.0, 4.0])
    table = table_of(second=(x, x**-2.0), level=(x, np.ones(3)))
    labels = lines_of(draw_table(table, replace(PLOT, orders=["second"]), "A caption."))
    assert {"second: order 2.00", "level"} <= set(labels)


def test_series_of_one_group_share_their_colour_and_have_their_style() -> None:
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


def legend_entries(legend: Any) -> zip[tuple[Any, Any]]:
    return zip(legend.get_patches(), legend.get_texts(), strict=True)


def test_a_picture_shows_x_to_the_right_and_y_upward() -> None:
    state, pressure, _ = blob()
    axes = maps.contact_map(state, pressure, SPACING).figure.axes[0]
    image = axes.images[0]
    states, (left, right, bottom, top) = np.asarray(image.get_array()), image.get_extent()
    assert states.shape == (90, 60)  # rows are y
    assert image.origin == "lower"
    assert (left, right, bottom, top) == pytest.approx((-1, 119, -0.5, 89.5))  # µm
    black = np.argwhere(states == PLASTIC).mean(axis=0)
    assert black == pytest.approx((0.6 * 90, 0.3 * 60), abs=1)


@given(
    st.lists(st.tuples(st.floats(1e-3, 1e3), st.floats(0, 1)), min_size=1, max_size=30),
)
@settings(deadline=None)
def test_nothing_beats_the_pareto_front(points: list[tuple[float, float]]) -> None:
    front = pareto_front(*zip(*points, strict=True))
    kept = {tuple(p) for p in front.tolist()}
    expected = {
        (c, e)
        for c, e in points
        if not any((a <= c and b <= e) and (a, b) != (c, e) for a, b in points)
    }
    assert kept == expected
    assert np.all(np.diff(front[:, 0]) > 0)
    assert np.all(np.diff(front[:, 1]) < 0)


@given(order=st.floats(-4, 4), factor=st.floats(1e-6, 1e6))
@settings(deadline=None)
def test_the_order_of_a_power_law_is_its_exponent(order: float, factor: float) -> None:
    h = np.array([0.5, 0.25, 0.1, 0.01, 0.0])
    error = np.array([*(factor * h[:4] ** order), 1.0])
    assert observed_order(h, error) == pytest.approx(order, abs=1e-9)


def test_no_order_without_two_points() -> None:
    assert math.isnan(observed_order([1.0, 1.0], [2.0, 3.0]))
    assert math.isnan(observed_order([1.0, 2.0], [0.0, math.nan]))


@given(
    pressures=st.lists(st.floats(0, 1e9), min_size=2, max_size=50),
    bins=st.integers(1, 80),
)
@settings(deadline=None)
def test_the_density_sums_up_to_the_elastic_area(pressures: list[float], bins: int) -> None:
    """Also where many points share one pressure, a step of the cumulative area."""
    sigma = np.append(np.sort(pressures), 1e9)
    cumulative = np.linspace(0.01, 0.4, sigma.size)
    centres, density = charts.pressure_density(PressureDistribution(sigma, cumulative, 0.1), bins)
    assert density.sum() * 1e9 / bins == pytest.approx(0.4, rel=1e-12)
    assert np.all(density >= 0)
    assert np.all((centres > 0) & (centres < 1e9))


def test_the_density_of_a_smooth_distribution_converges() -> None:
    """Second order in the width: cumulative sin^2 has the density sin(2x)."""
    errors = []
    sigma = np.linspace(0, 1, 20001)
    smooth = PressureDistribution(sigma, np.sin(sigma) ** 2)
    for bins in (10, 20, 40):
        x, density = charts.pressure_density(smooth, bins)
        errors.append(np.max(np.abs(density - np.sin(2 * x))))
    # Asymptotically h^2/24 max|f''| = h^2/6; twice that at the finest.
    assert errors[2] < 2 / 40**2 / 6
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.1)


def test_the_distribution_of_several_surfaces_is_their_mean() -> None:
    rows = [row for row in make_distribution().rows if row[0] == "bem"]
    _, density = charts.pressure_density(answer("bem", 0.06, 0.06).distribution)  # type: ignore[arg-type]
    assert [row[2] for row in rows] == pytest.approx(density, rel=1e-12)


def test_a_theory_takes_the_place_of_the_method_of_its_name() -> None:
    rows = make_distribution().rows
    names = dict.fromkeys(row[0] for row in rows)
    assert list(names) == ["persson", "bem", "without hardness"]
    assert sum(row[0] == "persson" for row in rows) == 80


@pytest.mark.parametrize(
    ("value", "unit", "scale", "name"),
    [
        (2.5e-4, "m", 1e-6, "µm"),
        (3e-9, "m", 1e-9, "nm"),
        (1e-10, "m", 1e-9, "nm"),
        (1500.0, "m", 1.0, "m"),
        (1.5e11, "Pa", 1e9, "GPa"),
        (0.0, "Pa", 1.0, "Pa"),
        (math.inf, "Pa", 1.0, "Pa"),
    ],
)
def test_units_read_well(value: float, unit: str, scale: float, name: str) -> None:
    assert unit_for(value, unit) == (scale, name)


def test_methods_keep_their_colours_and_others_do_not_borrow_them() -> None:
    names = ["fem", "raw", "bem corrected", "other", "persson, equation (3)"]
    looks = series_looks(names, [False] * 4 + [True])
    colours = [look["color"] for look in looks]
    assert len(set(colours)) == 5
    assert colours[0] == series_looks(["fem"], [True])[0]["color"]
    assert len({look["marker"] for look in looks}) == 5
    for lines in ([True] * 20, [False] * 20):
        looks = series_looks([f"kind {n}" for n in range(20)], lines)
        assert len({tuple(map(str, look.values())) for look in looks}) == 20


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: charts.residual_history({}),
        lambda: charts.residual_history({"a": [math.nan]}),
        lambda: charts.pressure_distribution({}),
    ],
)
def test_an_empty_chart_is_refused(wrong: Callable[[], Chart]) -> None:
    with pytest.raises(ValueError, match="nothing to draw"):
        wrong()


def test_ill_shaped_data_are_refused() -> None:
    with pytest.raises(ValueError, match="different grids"):
        maps.pressure_difference(np.ones((2, 3)), np.ones((3, 2)), SPACING)
    with pytest.raises(ValueError, match="newton has shape"):
        maps.stability_map({"newton": np.ones((2, 2))}, [1], [1, 2], labels=("a (–)", "b (–)"))
