"""Charts: the numbers drawn are the numbers given, and the pictures are fit to be
read.
"""

import csv
import functools
import io
import itertools
import math
import os
import re
from dataclasses import replace
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from command_line import python
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from epcontact.errors import OutputError
from epcontact.output.charts import curves, maps
from epcontact.output.charts.plot import Plot, draw_table, observed_order, pareto_front
from epcontact.output.charts.style import PART_COLOURS, SETTINGS, STATE_NAMES, unit_for
from epcontact.pictures.charts import theory_densities
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
HARDNESS = 1.5e11
SIGMA = np.linspace(0, 1.5e11, 80)
PLOT = Plot(x=("cost_s", "cost (s)"), y=("error", "error (–)"), log="xy")


def table_of(**series):
    """One row a point of the series, each given as its costs and errors."""
    return pd.concat(
        pd.DataFrame({"series": name, "cost_s": x, "error": y})
        for name, (x, y) in series.items()
    )


def lines_of(table, **changes):
    figure = draw_table(table, replace(PLOT, **changes), "A caption.").figure
    return {line.get_label(): line for line in figure.axes[0].lines}


def answer(method, scale):
    table = PressureDistribution(
        SIGMA, scale * np.sin(SIGMA / 3e11 * np.pi) ** 2, scale
    )
    step = LoadStep(1.25e10, {}, quantities={"diffusion": 4.2e21})
    return ContactResult(method, (step,), Provenance("x"), table)


def make_map(kind):
    """One round contact away from the middle: from above, against another, in
    profile.
    """
    shape = (80,) if kind == "profile" else (60, 90)
    around = np.meshgrid(*(np.arange(n) / n for n in shape), indexing="ij")
    top = 0.06 - sum((a - c) ** 2 for a, c in zip(around, (0.3, 0.6), strict=False))
    pressure = np.clip(top * 5e12, 0, 1.5e11)
    state = np.where(
        pressure >= 1.5e11, PLASTIC, np.where(pressure > 0, ELASTIC, APART)
    )
    if kind == "profile":
        return maps.contact_profile(
            state, pressure, np.maximum(-1e-6 * top, 0), (1e-6,)
        )
    if kind == "difference":
        return maps.pressure_difference(pressure, 0.98 * pressure, SPACING)
    return maps.contact_map(state, pressure, SPACING, hardness=1.5e11)


EFFORT = np.random.default_rng(20260721).integers(5, 900, (7, 5)).astype(float)
EFFORT[4:, 3:] = EFFORT[2, 0] = np.nan
AXES = (np.linspace(0.04, 0.67, 7), np.geomspace(0.2, 1.2, 5))


def make_stability():
    labels = ("mean pressure / hardness (–)", "hardness / (E* slope) (–)")
    methods = {"newton": EFFORT, "polonsky-keer": 3 * EFFORT}
    return maps.stability_map(
        methods, *AXES, labels=labels, count="FFT pairs", caption="Map."
    )


def make_distribution():
    found = {
        "persson": [answer("persson", 0.06)],
        "bem": [answer("bem", a) for a in (0.02, 0.1)],
    }
    theory = theory_densities(found, HARDNESS)
    return curves.pressure_distribution(found, hardness=HARDNESS, theory=theory)


def make_curves():
    """Axes of little more than a decade, where matplotlib labels minor ticks; bounds;
    uprights.
    """
    q = np.geomspace(3, 60, 6)
    table = table_of(bem=(q, 1 / q), analytic=(q, 1 / q), limit=([60], [0.1]))
    bounds = {"error_low": 0.9 * table["error"], "error_high": 1.1 * table["error"]}
    styles, upright = (
        {"analytic": "curve", "limit": "open"},
        {"first": 4.0, "last": 50.0},
    )
    return draw_table(
        table.assign(**bounds), replace(PLOT, styles=styles, upright=upright), "Two."
    )


def make_front():
    """A front that has neither curves nor points behind an exact one."""
    table = table_of(
        a=([1, 5], [0.1, 0.0]), b=([3, 9], [0.01, 0.001]), flat=([1, 4], [0.01, 0.01])
    )
    plot = replace(PLOT, front=True, orders=["b"], styles={"flat": "curve"})
    return draw_table(table, plot, "The front.")


def make_bounds():
    """With points, ticks, guides and labels, in other units than those of the table."""
    table = pd.DataFrame(
        {
            "series": "a",
            "x": [1.0, 2.0],
            "y": [3.0, 5.0],
            "y_low": [2.0, np.nan],
            "y_high": [3.5, 7.0],
        }
    )
    plot = Plot(
        ("x", "x (mm)"),
        ("y", "y (kPa)"),
        scale=(0.5, 4.0),
        ticks=(2, 3.5),
        level=1.5,
        upright={"peak": 3.0},
        labels={"a": "b"},
        limits={"ylim": (0, 2)},
    )
    return draw_table(table, plot, "Bounds.")


MAKERS = {
    "from above": functools.partial(make_map, "above"),
    "difference": functools.partial(make_map, "difference"),
    "profile": functools.partial(make_map, "profile"),
    "stability": make_stability,
    "distribution": make_distribution,
    "curves": make_curves,
    "front": make_front,
    "bounds": make_bounds,
    "history": lambda: curves.residual_history({"newton": 10.0 ** -np.arange(30)}),
}


def misplaced(figure, monkeypatch):
    """Texts that are cut off and pairs that overlap; one pixel is the rounding of the
    layout.
    """
    boxes: list[tuple[str, Any]] = []
    draw = mpl.text.Text.draw

    def recording(self, renderer):  # of the texts that are really drawn
        if self.get_visible() and self.get_text().strip():
            boxes.append(
                (self.get_text(), self.get_window_extent(renderer).padded(-0.5))
            )
        draw(self, renderer)

    with monkeypatch.context() as patch:
        patch.setattr(mpl.text.Text, "draw", recording)
        figure.canvas.draw()
    assert len(boxes) > 5
    page = figure.bbox.padded(0.5)
    outside = [
        (t,) for t, b in boxes if not np.all((page.min <= b.min) & (b.max <= page.max))
    ]
    pairs = itertools.combinations(boxes, 2)
    return outside + [
        (one, two) for (one, first), (two, second) in pairs if first.overlaps(second)
    ]


@pytest.mark.parametrize("name", MAKERS)
def test_a_chart_can_be_read_and_is_the_same_four_files_again(
    name, tmp_path, monkeypatch
):
    chart = MAKERS[name]()
    for axes in chart.figure.axes:
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert re.search(r"\(.+\)", label) or not label, "an axis has no unit"
    assert misplaced(chart.figure, monkeypatch) == []
    paths = chart.save(tmp_path / "a" / name)
    paths_of_second = MAKERS[name]().save(tmp_path / "b" / name)
    assert [path.suffix for path in paths] == [".png", ".svg", ".csv", ".txt"]
    contents = [path.read_bytes() for path in paths]
    assert contents == [path.read_bytes() for path in paths_of_second]
    assert contents[0].startswith(b"\x89PNG")
    assert b"<svg" in contents[1]
    assert contents[3].decode() == chart.caption + "\n"
    rows = list(csv.reader(io.StringIO(paths[2].read_text())))
    assert [len(row) for row in rows] == [len(chart.header)] * (len(chart.rows) + 1)


def labels_of(legend):
    return [text.get_text() for text in legend.texts]


def test_values_and_bounds_are_drawn_in_the_units_of_the_axes():
    """The drawn x is twice that of the table and y a quarter of it."""
    (axes,) = make_bounds().figure.axes
    points, level, upright = axes.lines
    assert points.get_xydata().tolist() == [[2, 0.75], [4, 1.25]]
    assert [*level.get_ydata()] == [1.5, 1.5]
    assert [*upright.get_xdata()] == [3.0, 3.0]
    # The second point has no lower bound, so that only the first one has a bar.
    (bars,) = axes.collections
    bar, *others = [path.vertices.tolist() for path in bars.get_paths()]
    assert bar == [[2, 0.5], [2, 0.875]]
    assert np.isnan(others).any()
    assert [text.get_text().strip() for text in axes.texts] == ["peak"]
    assert labels_of(axes.get_legend()) == ["b"]
    assert axes.get_xticks().tolist() == [2, 3.5]
    assert axes.get_ylim() == (0, 2)


def test_a_curve_has_a_band_and_ticks_within_its_decade():
    (axes,) = make_curves().figure.axes
    axes.figure.canvas.draw()
    ticks = [tick.get_text() for tick in axes.get_xticklabels(which="both")]
    assert [tick for tick in ticks if tick] == ["1", "2", "5", "10", "20", "50"]
    assert [text.get_text().strip() for text in axes.texts] == ["first", "last"]
    (band,) = axes.findobj(mpl.collections.FillBetweenPolyCollection)
    x, y = band.get_paths()[0].vertices.T
    assert sorted({*np.round(x * y, 9)}) == [0.9, 1.1]


def test_a_front_tells_orders_and_draws_an_error_of_zero_on_the_axis():
    (axes,) = make_front().figure.axes
    order = math.log(0.01 / 0.001) / math.log(9 / 3)
    assert labels_of(axes.get_legend()) == [
        "a",
        f"b: order {order:.2f}",
        "flat",
        "open, on the axis: 0",
        "Pareto front",
    ]
    on_the_axis, front = axes.lines[-2:]
    assert [*on_the_axis.get_xdata()] == [5]
    assert on_the_axis.get_ydata()[0] == pytest.approx(axes.get_ylim()[0])
    assert front.get_xydata().tolist() == [[1, 0.1], [3, 0.01]]


def test_failures_are_crossed_in_their_cells_of_a_stability_map():
    panels = [axes for axes in make_stability().figure.axes if axes.images]
    failures = np.argwhere(np.isnan(EFFORT)).tolist()
    limits = (np.nanmin(EFFORT), 3 * np.nanmax(EFFORT))
    assert [axes.get_title() for axes in panels] == ["newton", "polonsky-keer"]
    for axes, effort in zip(panels, (EFFORT, 3 * EFFORT), strict=True):
        (crosses,) = axes.lines
        (image,) = axes.images
        assert sorted(crosses.get_xydata().tolist()) == failures
        np.testing.assert_array_equal(np.ma.filled(image.get_array(), np.nan), effort.T)
        assert image.get_clim() == limits
        places = [tick.get_text() for tick in axes.get_yticklabels()]
        assert places == ["0.2", "0.313", "0.49", "0.767", "1.2"]


def test_all_files_or_none_and_every_digit(tmp_path):
    chart = curves.residual_history({"bem": [1 / 3, math.pi, math.e]})
    rows = list(csv.reader(io.StringIO(chart.csv())))[1:]
    assert [float(row[2]) for row in rows] == [1 / 3, math.pi, math.e]
    (tmp_path / "x.csv").mkdir()
    with pytest.raises(OutputError, match=r"x\.csv.*is a folder"):
        chart.save(tmp_path / "x")
    assert os.listdir(tmp_path) == ["x.csv"]


def test_matplotlib_is_left_as_it_was():
    code = (
        "import sys, matplotlib as mpl; mpl.rcParams['font.size'] = 33.0;"
        "from epcontact.output.charts.curves import *;"
        "chart = residual_history({'a': [1, 2]}); chart.png();"
        "assert mpl.rcParams['font.size'] == 33.0; assert 'matplotlib.pyplot' not in sys.modules;"
        f"assert chart.figure.axes[0].xaxis.label.get_size() == {SETTINGS['axes.labelsize']};"
    )
    assert python("-c", code).returncode == 0


def test_intervals_wider_than_all_differences_are_said():
    name = "E* xi / sigma_Y = 5"
    both = table_of(
        **{name: ([1.0, 2.0, 3.0], [1.0, 2.1, 3.0]), "b": ([1.0, 2.0], [1.1, 2.0])}
    )
    plot = Plot(("cost_s", "E* xi / sigma_Y (–)"), ("error", "y (–)"))
    for width, table, said in (
        (0.5, both, True),
        (0.03125, both, False),
        (5.0, both[:3], False),
    ):
        wide = table.assign(
            error_low=table["error"] - width, error_high=table["error"] + width
        )
        chart = draw_table(wide, plot, "At E* xi/sigma_Y = 5.")
        (axes,) = chart.figure.axes
        assert (
            ("not tell them apart" in chart.caption) is bool(axes.get_title()) is said
        )
        assert chart.rows[0] == (name, 1.0, 1.0, 1 - width, 1 + width)  # plain


def test_series_have_their_mark_in_each_colour_and_error_bars_are_set_apart():
    table = table_of(theory=([1, 2], [1, 2]), bem=([1, 2], [1, 3]), limit=([0.5], [1]))
    table["part"] = "plastic"
    table["style"] = table["series"].map(
        {"theory": "curve", "bem": "marks", "limit": "open"}
    )
    look = {"series": ("part", "series"), "colour": "part", "colours": PART_COLOURS}
    table = pd.concat([table, table.assign(part="elastic")])
    table = table.assign(
        error_low=table["error"] - 0.1, error_high=table["error"] + 0.1
    )
    lines = lines_of(table.sort_values("part", kind="stable"), mark="series", **look)
    for name in ("theory", "bem", "limit"):
        one, two = (lines[f"{part}, {name}"] for part in ("elastic", "plastic"))
        assert (one.get_marker(), one.get_linestyle()) == (
            two.get_marker(),
            two.get_linestyle(),
        )
        assert (
            one.get_transform() == two.get_transform() == one.axes.transData
        )  # marks are in place
    bars = (
        e for e in one.axes.collections if isinstance(e, mpl.collections.LineCollection)
    )
    apart = np.diff([bar.get_transform().transform((1, 1))[0] for bar in bars])
    assert (apart > 1).all()
    assert apart.sum() < 10  # pixels: at the marks


def test_methods_keep_their_colours_and_others_do_not_borrow_them():
    names = ("fem", "raw", "bem corrected", "other", "persson, equation (3)")
    lines = lines_of(table_of(**dict.fromkeys(names, ([1, 2], [1, 2]))))
    assert len({line.get_color() for line in lines.values()}) == 5
    assert (
        lines["fem"].get_color()
        == lines_of(table_of(fem=([1], [1])))["fem"].get_color()
    )
    many = table_of(**{f"kind {n}": ([1, 2], [1, 2]) for n in range(20)})
    for style in ("points", "curve"):
        lines = lines_of(many, style=style).values()
        assert (
            len({(e.get_color(), e.get_marker(), e.get_linestyle()) for e in lines})
            == 20
        )


@given(
    st.lists(st.tuples(st.floats(1e-3, 1e3), st.floats(0, 1)), min_size=1, max_size=30)
)
def test_nothing_beats_the_pareto_front(points):
    front = [*map(tuple, pareto_front(*zip(*points, strict=True)).tolist())]
    beaten = {
        p for p in points for a, b in points if a <= p[0] and b <= p[1] and (a, b) != p
    }
    assert front == sorted({*points} - beaten)


@given(order=st.floats(-4, 4), factor=st.floats(1e-6, 1e6))
def test_the_order_of_a_power_law_is_its_exponent(order, factor):
    h = np.array([0.5, 0.25, 0.1, 0.01, 0.0])
    error = np.array([*(factor * h[:4] ** order), 1.0])
    assert observed_order(h, error) == pytest.approx(order, abs=1e-9)
    assert math.isnan(observed_order([1.0, 1.0], [2.0, 3.0]))
    assert math.isnan(observed_order([1.0, 2.0], [0.0, math.nan]))


@given(
    pressures=st.lists(st.floats(0, 1e9), min_size=2, max_size=50),
    bins=st.integers(1, 80),
)
def test_the_density_sums_up_to_the_elastic_area(pressures, bins):
    """The sum holds where many points share one pressure, a step of the cumulative
    area, too.
    """
    sigma = np.append(np.sort(pressures), 1e9)
    cumulative = np.linspace(0.01, 0.4, sigma.size)
    centres, density = curves.pressure_density(
        PressureDistribution(sigma, cumulative, 0.1), bins
    )
    assert density.sum() * 1e9 / bins == pytest.approx(0.4, rel=1e-12)
    assert np.all(density >= 0)
    assert np.all((centres > 0) & (centres < 1e9))


def test_a_distribution_has_means_of_surfaces_and_the_theory_is_its_formula():
    chart = make_distribution()
    rows = pd.DataFrame(chart.rows).groupby(0, sort=False)[2].apply(list)
    _, density = curves.pressure_density(answer("bem", 0.06).distribution)
    assert rows["bem"] == pytest.approx(density, rel=1e-12)
    (axes,) = chart.figure.axes
    lines = {line.get_label(): line for line in axes.lines}
    mean_plastic_area = (0.02 + 0.1) / 2
    label = f"bem (counted plastic area {mean_plastic_area:g})"
    assert labels_of(axes.get_legend())[1] == label
    G = 4.2e21
    p0 = 1.25e10
    x, y = (np.asarray(v) for v in lines["persson without hardness"].get_data())
    near, far = (np.exp(-((1e9 * x - shift) ** 2) / (4 * G)) for shift in (p0, -p0))
    assert y == pytest.approx(
        1e9 * (near - far) / np.sqrt(4 * np.pi * G), rel=1e-9, abs=1e-15
    )
    x, y = (np.asarray(v) for v in lines["persson (plastic area 0.06)"].get_data())
    n = np.arange(1, 40)[:, None] * np.pi / HARDNESS
    modes = np.sin(n * p0) * np.sin(n * 1e9 * x)
    capped = 2e9 / HARDNESS * np.sum(modes * np.exp(-(n**2) * G), axis=0)
    assert y == pytest.approx(capped, rel=1e-9, abs=1e-12 * capped.max())


def test_the_legend_has_the_colours_of_the_map():
    state = np.full((60, 40), APART)
    state[5:25, 5:15], state[35:55, 25:35] = ELASTIC, PLASTIC
    places = {
        APART: (30, 4),
        ELASTIC: (15, 20),
        PLASTIC: (45, 60),
    }  # in µm, x to the right, y up
    chart = maps.contact_map(state, 1e9 * (state > 0), (1e-6, 2e-6))
    figure = chart.figure
    with Image.open(io.BytesIO(chart.png())) as picture:
        pixels = np.asarray(picture.convert("RGB"))[::-1]
    figure.set_dpi(SETTINGS["savefig.dpi"])
    figure.canvas.draw()
    (legend,) = figure.legends
    keys = {
        t.get_text(): p for t, p in zip(legend.texts, legend.get_patches(), strict=True)
    }
    for kind, place in places.items():
        box = keys[
            f"{STATE_NAMES[kind]} {100 * np.mean(state == kind):.2f} %"
        ].get_window_extent()
        middle, shown = (
            box.get_points().mean(axis=0),
            figure.axes[0].transData.transform(place),
        )
        assert np.array_equal(*(pixels[int(y), int(x)] for x, y in (middle, shown)))


def test_units_read_well_and_an_empty_chart_is_refused():
    lengths, pressures = (2.5e-4, 3e-9, 1e-10, 1500.0), (1.5e11, 0.0, math.inf)
    assert [unit_for(v, "m")[1] for v in lengths] == ["µm", "nm", "nm", "m"]
    assert [unit_for(v, "Pa") for v in pressures] == [
        (1e9, "GPa"),
        (1.0, "Pa"),
        (1.0, "Pa"),
    ]
    with pytest.raises(ValueError, match="nothing to draw"):
        curves.residual_history({"a": [math.nan]})
