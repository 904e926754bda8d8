"""Charts: the numbers drawn are the numbers given, and the pictures are fit to be read."""

from __future__ import annotations

import csv
import io
import itertools
import math
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from command_line import python
from hypothesis import given, settings
from hypothesis import strategies as st

from epcontact.errors import OutputError
from epcontact.output.charts import curves, maps
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table, observed_order, pareto_front
from epcontact.output.charts.style import PART_COLOURS, SETTINGS, unit_for
from epcontact.results import (
    APART,
    ELASTIC,
    PLASTIC,
    ContactResult,
    LoadStep,
    PressureDistribution,
    Provenance,
)

SPACING = (2e-6, 1e-6)
SIGMA = np.linspace(0, 1.5e11, 80)
PLOT = Plot(x=("cost_s", "cost (s)"), y=("error", "error (–)"), log="xy")


def table_of(**series: Any) -> pd.DataFrame:
    """One row a point of the series, each given as its costs and errors."""
    return pd.concat(
        pd.DataFrame({"series": name, "cost_s": x, "error": y}) for name, (x, y) in series.items()
    )


def lines_of(table: pd.DataFrame, **changes: Any) -> dict[str, Any]:
    figure = draw_table(table, replace(PLOT, **changes), "A caption.").figure
    return {line.get_label(): line for line in figure.axes[0].lines}


def answer(method: str, scale: float) -> ContactResult:
    table = PressureDistribution(SIGMA, scale * np.sin(SIGMA / 3e11 * np.pi) ** 2, scale)
    return ContactResult(method, (LoadStep(1.25e10, {}),), Provenance("x"), table)


def make_map(kind: str) -> Chart:
    """One round contact away from the middle: from above, against another, in profile."""
    shape = (80,) if kind == "profile" else (60, 90)
    around = np.meshgrid(*(np.arange(n) / n for n in shape), indexing="ij")
    top = 0.06 - sum((a - c) ** 2 for a, c in zip(around, (0.3, 0.6), strict=False))
    pressure = np.clip(top * 5e12, 0, 1.5e11)
    state = np.where(pressure >= 1.5e11, PLASTIC, np.where(pressure > 0, ELASTIC, APART))
    if kind == "profile":
        return maps.contact_profile(state, pressure, np.maximum(-1e-6 * top, 0), (1e-6,))
    if kind == "difference":
        return maps.pressure_difference(pressure, 0.98 * pressure, SPACING)
    return maps.contact_map(state, pressure, SPACING, hardness=1.5e11)


def make_stability() -> Chart:
    effort = np.random.default_rng(20260721).integers(5, 900, (7, 5)).astype(float)
    effort[4:, 3:] = np.nan
    axes = (np.linspace(0.04, 0.67, 7), np.geomspace(0.2, 1.2, 5))
    labels = ("mean pressure / hardness (–)", "hardness / (E* slope) (–)")
    methods = {"newton": effort, "polonsky-keer": 3 * effort}
    return maps.stability_map(methods, *axes, labels=labels, count="FFT pairs", caption="Map.")


def make_distribution() -> Chart:
    density = 4e-13 * np.sin(np.pi * SIGMA / 1.5e11)
    columns = ("series", curves.PRESSURE, curves.DENSITY)
    exact = (("persson", SIGMA, density), ("without hardness", 1.3 * SIGMA, 2 * density))
    return curves.pressure_distribution(
        {"persson": [answer("persson", 0.06)], "bem": [answer("bem", a) for a in (0.05, 0.07)]},
        hardness=1.5e11,
        theory=pd.concat(pd.DataFrame(dict(zip(columns, e, strict=True))) for e in exact),
    )


def make_curves() -> Chart:
    """Axes of little more than a decade, where matplotlib labels minor ticks; bounds; uprights."""
    q = np.geomspace(3, 60, 6)
    table = table_of(bem=(q, 1 / q), analytic=(q, 1 / q), limit=([60], [0.1]))
    bounds = {"error_low": 0.9 * table["error"], "error_high": 1.1 * table["error"]}
    styles, upright = {"analytic": "curve", "limit": "open"}, {"first": 4.0, "last": 50.0}
    return draw_table(table.assign(**bounds), replace(PLOT, styles=styles, upright=upright), "Two.")


MAKERS = {
    "from above": lambda: make_map("above"),
    "difference": lambda: make_map("difference"),
    "profile": lambda: make_map("profile"),
    "stability": make_stability,
    "distribution": make_distribution,
    "curves": make_curves,
    "history": lambda: curves.residual_history({"newton": 10.0 ** -np.arange(30)}),
}


def misplaced(figure: Any, monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, ...]]:
    """Texts that are cut off and pairs that overlap; one pixel is the rounding of the layout."""
    boxes: list[tuple[str, Any]] = []
    draw = mpl.text.Text.draw

    def recording(self: Any, renderer: Any) -> None:  # of the texts that are really drawn
        if self.get_visible() and self.get_text().strip():
            boxes.append((self.get_text(), self.get_window_extent(renderer).padded(-0.5)))
        draw(self, renderer)

    with monkeypatch.context() as patch:
        patch.setattr(mpl.text.Text, "draw", recording)
        figure.canvas.draw()
    assert len(boxes) > 5
    page = figure.bbox.padded(0.5)
    outside = [(t,) for t, b in boxes if not np.all((page.min <= b.min) & (b.max <= page.max))]
    pairs = itertools.combinations(boxes, 2)
    return outside + [(one, two) for (one, first), (two, second) in pairs if first.overlaps(second)]


@pytest.mark.parametrize("name", MAKERS)
def test_a_chart_can_be_read_and_is_the_same_four_files_again(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chart = MAKERS[name]()
    figure = chart.figure
    for axes in figure.axes:
        labels = [axes.get_xlabel(), axes.get_ylabel()]
        shares_y = axes is not figure.axes[0] and name == "stability"
        named = labels[1:] if hasattr(axes, "_colorbar") else labels[:1] if shares_y else labels
        assert all(re.search(r"\(.+\)", label) for label in named), f"an axis has no unit: {named}"
    assert misplaced(figure, monkeypatch) == []
    paths, again = chart.save(tmp_path / "a" / name), MAKERS[name]().save(tmp_path / "b" / name)
    assert [p.suffix for p in paths] == [".png", ".svg", ".csv", ".txt"]
    assert [p.read_bytes() for p in paths] == [p.read_bytes() for p in again]
    assert paths[0].read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in paths[1].read_bytes()
    assert chart.caption + "\n" == paths[3].read_text()
    rows = list(csv.reader(io.StringIO(paths[2].read_text())))
    assert [len(row) for row in rows] == [len(chart.header)] * (len(chart.rows) + 1)


def test_all_files_or_none_and_every_digit(tmp_path: Path) -> None:
    chart = curves.residual_history({"bem": [1 / 3, math.pi, math.e]})
    rows = list(csv.reader(io.StringIO(chart.csv())))[1:]
    assert [float(row[2]) for row in rows] == [1 / 3, math.pi, math.e]
    (tmp_path / "x.csv").mkdir()
    with pytest.raises(OutputError, match=r"x\.csv.*is a folder"):
        chart.save(tmp_path / "x")
    assert os.listdir(tmp_path) == ["x.csv"]


def test_matplotlib_is_left_as_it_was() -> None:
    code = (
        "import sys, matplotlib as mpl; mpl.rcParams['font.size'] = 33.0;"
        "from epcontact.output.charts.curves import *;"
        "chart = residual_history({'a': [1, 2]}); chart.png();"
        "assert mpl.rcParams['font.size'] == 33.0; assert 'matplotlib.pyplot' not in sys.modules;"
        f"assert chart.figure.axes[0].xaxis.label.get_size() == {SETTINGS['axes.labelsize']};"
    )
    assert python("-c", code).returncode == 0


def test_intervals_wider_than_all_differences_are_said() -> None:
    table = table_of(**{"E* xi / sigma_Y = 5": ([1.0, 2.0, 3.0], [1.0, 1.1, 1.05])})
    plot = Plot(("cost_s", "E* xi / sigma_Y (–)"), ("error", "y (–)"))
    for width, said in ((0.5, True), (0.04, False)):
        wide = table.assign(error_low=table["error"] - width, error_high=table["error"] + width)
        chart = draw_table(wide, plot, "At E* xi/sigma_Y = 5.")
        (axes,) = chart.figure.axes
        assert ("decides nothing" in chart.caption) is bool(axes.get_title()) is said
        assert chart.caption.startswith("At E*ξ/σ_Y = 5.")
        assert axes.get_xlabel() == r"$E^*\xi\,/\,\sigma_\mathrm{Y}$ (–)"
        assert r"$E^*\xi" in axes.get_legend().get_texts()[0].get_text()
        assert len(axes.collections) == 1
        ends = tuple(wide[["error_low", "error_high"]].iloc[0])
        assert chart.rows[0] == ("E* xi / sigma_Y = 5", 1.0, 1.0, *ends)  # data keep plain names


def test_the_front_has_neither_curves_nor_points_behind_an_exact_one() -> None:
    table = table_of(a=([1, 5], [0.1, 0.0]), b=([3, 9], [0.01, 0.001]), flat=([1, 4], [0.01, 0.01]))
    front = lines_of(table, front=True, styles={"flat": "curve"})["Pareto front"]
    assert np.array_equal(front.get_xydata(), [[1, 0.1], [3, 0.01]])


def test_the_legend_tells_the_observed_order_where_it_is_asked_for() -> None:
    x = np.array([1.0, 2.0, 4.0])
    labels = lines_of(table_of(second=(x, x**-2.0), level=(x, np.ones(3))), orders=["second"])
    assert {"second: order 2.00", "level"} <= set(labels)


def test_series_of_one_group_share_their_colour_and_have_their_style() -> None:
    table = table_of(theory=([1, 2], [1, 2]), bem=([1, 2], [1, 3]), limit=([0.5], [1]))
    table["part"] = "plastic"
    table["style"] = table["series"].map({"theory": "curve", "bem": "marks", "limit": "open"})
    look = {"series": ("part", "series"), "colour": "part", "colours": PART_COLOURS}
    lines = lines_of(table, **look)
    assert set(lines) == {"plastic, theory", "plastic, bem", "plastic, limit"}
    assert {line.get_color() for line in lines.values()} == {"#000000"}
    assert lines["plastic, theory"].get_marker() in (None, "None")
    assert lines["plastic, bem"].get_linestyle() == "None"
    assert lines["plastic, limit"].get_fillstyle() == "none"


def test_methods_keep_their_colours_and_others_do_not_borrow_them() -> None:
    names = ("fem", "raw", "bem corrected", "other", "persson, equation (3)")
    lines = lines_of(table_of(**dict.fromkeys(names, ([1, 2], [1, 2]))))
    assert len({line.get_color() for line in lines.values()}) == 5
    assert lines["fem"].get_color() == lines_of(table_of(fem=([1], [1])))["fem"].get_color()
    many = table_of(**{f"kind {n}": ([1, 2], [1, 2]) for n in range(20)})
    for style in ("points", "curve"):
        lines = lines_of(many, style=style)
        looks = {(e.get_color(), e.get_marker(), e.get_linestyle()) for e in lines.values()}
        assert len(looks) == 20


@given(st.lists(st.tuples(st.floats(1e-3, 1e3), st.floats(0, 1)), min_size=1, max_size=30))
@settings(deadline=None)
def test_nothing_beats_the_pareto_front(points: list[tuple[float, float]]) -> None:
    front = pareto_front(*zip(*points, strict=True))
    expected = {
        (c, e)
        for c, e in points
        if not any((a <= c and b <= e) and (a, b) != (c, e) for a, b in points)
    }
    assert [*map(tuple, front.tolist())] == sorted(expected)


@given(order=st.floats(-4, 4), factor=st.floats(1e-6, 1e6))
@settings(deadline=None)
def test_the_order_of_a_power_law_is_its_exponent(order: float, factor: float) -> None:
    h = np.array([0.5, 0.25, 0.1, 0.01, 0.0])
    error = np.array([*(factor * h[:4] ** order), 1.0])
    assert observed_order(h, error) == pytest.approx(order, abs=1e-9)
    assert math.isnan(observed_order([1.0, 1.0], [2.0, 3.0]))
    assert math.isnan(observed_order([1.0, 2.0], [0.0, math.nan]))


@given(pressures=st.lists(st.floats(0, 1e9), min_size=2, max_size=50), bins=st.integers(1, 80))
@settings(deadline=None)
def test_the_density_sums_up_to_the_elastic_area(pressures: list[float], bins: int) -> None:
    """The sum holds where many points share one pressure, a step of the cumulative area, too."""
    sigma = np.append(np.sort(pressures), 1e9)
    cumulative = np.linspace(0.01, 0.4, sigma.size)
    centres, density = curves.pressure_density(PressureDistribution(sigma, cumulative, 0.1), bins)
    assert density.sum() * 1e9 / bins == pytest.approx(0.4, rel=1e-12)
    assert np.all(density >= 0)
    assert np.all((centres > 0) & (centres < 1e9))


def test_the_density_of_a_smooth_distribution_converges() -> None:
    """Second order in the width: cumulative sin^2 has the density sin(2x)."""
    sigma, errors = np.linspace(0, 1, 20001), []
    for bins in (10, 20, 40):
        x, density = curves.pressure_density(PressureDistribution(sigma, np.sin(sigma) ** 2), bins)
        errors.append(np.max(np.abs(density - np.sin(2 * x))))
    # Asymptotically h^2/24 max|f''| = h^2/6; twice that at the finest.
    assert errors[2] < 2 / 40**2 / 6
    assert np.divide(errors[:2], errors[1:]) == pytest.approx(4, rel=0.1)


def test_a_distribution_has_means_of_surfaces_and_a_theory_for_the_method_of_its_name() -> None:
    rows = pd.DataFrame(make_distribution().rows).groupby(0, sort=False)[2].apply(list)
    assert list(rows.index) == ["persson", "bem", "without hardness"]
    assert len(rows["persson"]) == SIGMA.size
    _, density = curves.pressure_density(answer("bem", 0.06).distribution)  # type: ignore[arg-type]
    assert rows["bem"] == pytest.approx(density, rel=1e-12)


UNITS = [
    (2.5e-4, "m", 1e-6, "µm"), (3e-9, "m", 1e-9, "nm"), (1e-10, "m", 1e-9, "nm"),
    (1500.0, "m", 1.0, "m"), (1.5e11, "Pa", 1e9, "GPa"), (0.0, "Pa", 1.0, "Pa"),
    (math.inf, "Pa", 1.0, "Pa"),
]  # fmt: skip


@pytest.mark.parametrize(("value", "unit", "scale", "name"), UNITS)
def test_units_read_well(value: float, unit: str, scale: float, name: str) -> None:
    assert unit_for(value, unit) == (scale, name)


def test_an_empty_chart_is_refused() -> None:
    with pytest.raises(ValueError, match="nothing to draw"):
        curves.residual_history({"a": [math.nan]})
