"""Charts: the numbers drawn are the numbers given, and the pictures are fit to be
read.
"""

import csv
import io
import itertools
import math
import os
import re
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from command_line import python
from drawn_texts import texts_with_boxes
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from epcontact.errors import InvalidCase, OutputError
from epcontact.output.charts import curves, maps
from epcontact.output.charts.plot import (
    Axis,
    Plot,
    draw_table,
    observed_order,
    pareto_front,
)
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

SPACING = (2e-6, 1e-6)  # m, of the points along x and y
HARDNESS = 1.5e11  # Pa
PRESSURES = np.linspace(0, HARDNESS, 80)  # Pa, of a made-up distribution
#: How most tables of this file are drawn.
PLOT = Plot(x=Axis("cost_s", "cost (s)"), y=Axis("error", "error (–)"), log="xy")
#: The version of matplotlib that drew the saved pictures.
DRAWN_BY = "3.11"
MEAN_PRESSURE = 1.25e10  # Pa
DIFFUSION = 4.2e21  # Pa^2, half the variance of the pressures in full contact


def table_of(**series):
    """Return a table with the columns "series", "cost_s" and "error", one row for each
    point.

    Each argument is a series by its name, given as a list of costs (s) and one of
    errors.
    """
    return pd.concat(
        pd.DataFrame({"series": name, "cost_s": x, "error": y})
        for name, (x, y) in series.items()
    )


def with_bounds(table, width):
    """Return a table whose errors have the bounds error - width and error + width."""
    errors = table["error"]
    return table.assign(error_low=errors - width, error_high=errors + width)


def lines_of(table, **changes):
    """Return the drawn lines (matplotlib) of the chart of a table, by their labels.

    `changes` are fields of Plot that differ from PLOT.
    """
    (axes,) = draw_table(table, replace(PLOT, **changes), "A caption.").figure.axes
    return {line.get_label(): line for line in axes.lines}


def result_of(method, plastic_area):
    """Return a made-up result of a method at MEAN_PRESSURE, with the diffusion of a
    theory.

    Its elastic area rises as sin^2 from pressure 0 to the hardness, where it equals
    `plastic_area`, a fraction of the nominal area.
    """
    cumulative = plastic_area * np.sin(PRESSURES / HARDNESS * np.pi / 2) ** 2
    distribution = PressureDistribution(PRESSURES, cumulative, plastic_area)
    step = LoadStep(MEAN_PRESSURE, {}, quantities={"diffusion": DIFFUSION})
    return ContactResult(method, (step,), Provenance("x"), distribution)


# --- the charts
# -----------------------------------------------------------------------


def round_contact(*shape):
    """Return pressure (Pa), state and gap (m) of a round contact whose centre is at 0.3
    and 0.6 of the periods.

    `shape` is the number of points in each direction, of one or two dimensions, and the
    shape of the three arrays.
    """
    coordinates = np.meshgrid(*(np.arange(n) / n for n in shape), indexing="ij")
    height = np.full(shape, 0.06)  # the square of the radius of the contact
    for coordinate, centre in zip(coordinates, (0.3, 0.6), strict=False):
        height -= (coordinate - centre) ** 2
    pressure = np.clip(height * 5e12, 0, HARDNESS)
    state = np.full(shape, APART)
    state[pressure > 0] = ELASTIC
    state[pressure >= HARDNESS] = PLASTIC
    return pressure, state, np.maximum(-1e-6 * height, 0)


def make_map():
    """Draw a contact map of 60 x 90 points, with separated, elastic and plastic
    ones.
    """
    pressure, state, _ = round_contact(60, 90)
    return maps.contact_map(state, pressure, SPACING, hardness=HARDNESS)


def make_difference():
    """Draw the difference of two pressures, of which the second is 2 % lower."""
    pressure, _, _ = round_contact(60, 90)
    return maps.pressure_difference(pressure, 0.98 * pressure, SPACING)


def make_profile():
    """Draw the profile of a line of 80 points, 1 µm apart."""
    pressure, state, gap = round_contact(80)
    return maps.contact_profile(state, pressure, gap, (1e-6,))


#: FFT pairs at 7 loads and 5 hardnesses; NaN where the solver fails.
EFFORT = np.random.default_rng(20260721).integers(5, 900, (7, 5)).astype(float)
EFFORT[4:, 3:] = np.nan
EFFORT[2, 0] = np.nan


def make_stability():
    """Draw the FFT pairs of two solvers over load and hardness, with failures."""
    return maps.stability_map(
        {"newton": EFFORT, "polonsky-keer": 3 * EFFORT},
        np.linspace(0.04, 0.67, 7),
        np.geomspace(0.2, 1.2, 5),
        labels=("mean pressure / hardness (–)", "hardness / (E* slope) (–)"),
        count="FFT pairs",
        caption="Map.",
    )


def make_distribution():
    """Draw the pressure distribution of the theory and the mean of two surfaces, with
    the closed forms of the theory.
    """
    results = {
        "persson": [result_of("persson", 0.06)],
        "bem": [result_of("bem", 0.02), result_of("bem", 0.1)],
    }
    theory = theory_densities(results, HARDNESS)
    return curves.pressure_distribution(results, hardness=HARDNESS, theory=theory)


def make_curves():
    """Draw axes of little more than a decade, with bands, a point and two upright
    lines.

    matplotlib labels minor ticks of such axes.
    """
    q = np.geomspace(3, 60, 6)
    table = table_of(bem=(q, 1 / q), analytic=(q, 1 / q), limit=([60], [0.1]))
    table = table.assign(
        error_low=0.9 * table["error"], error_high=1.1 * table["error"]
    )
    plot = replace(
        PLOT,
        styles={"analytic": "curve", "limit": "open"},
        upright={"first": 4.0, "last": 50.0},
    )
    return draw_table(table, plot, "Two.")


def make_front():
    """Draw the Pareto front of two series, one of which has an error of 0.

    The series "flat" is a curve, which is no part of the front.
    """
    table = table_of(
        a=([1, 5], [0.1, 0.0]), b=([3, 9], [0.01, 0.001]), flat=([1, 4], [0.01, 0.01])
    )
    plot = replace(PLOT, front=True, orders=["b"], styles={"flat": "curve"})
    return draw_table(table, plot, "The front.")


def make_bounds():
    """Draw two points with bounds, ticks, guides and labels in units other than the
    table's.
    """
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
        Axis("x", "x (mm)"),
        Axis("y", "y (kPa)"),
        scale=(0.5, 4.0),
        ticks=(2, 3.5),
        level=1.5,
        upright={"peak": 3.0},
        labels={"a": "b"},
        limits={"ylim": (0, 2)},
    )
    return draw_table(table, plot, "Bounds.")


def make_history():
    """Draw a residual that falls by 10 in each of 30 iterations."""
    return curves.residual_history({"newton": 10.0 ** -np.arange(30)})


MAKERS = (
    make_map,
    make_difference,
    make_profile,
    make_stability,
    make_distribution,
    make_curves,
    make_front,
    make_bounds,
    make_history,
)


@pytest.fixture(params=MAKERS)
def make_chart(request):
    """Return one function that draws a chart, for each in MAKERS."""
    return request.param


def test_texts_of_a_chart_are_whole_and_apart(make_chart, monkeypatch):
    """No text of a chart is cut off by the page or overlaps another text."""
    figure = make_chart().figure
    boxes = texts_with_boxes(figure, monkeypatch)
    assert len(boxes) > 5
    page = figure.bbox.padded(0.5)
    for text, box in boxes:
        assert np.all(page.min <= box.min), text
        assert np.all(box.max <= page.max), text
    for (text, box), (other_text, other_box) in itertools.combinations(boxes, 2):
        assert not box.overlaps(other_box), (text, other_text)


@pytest.mark.skipif(
    not mpl.__version__.startswith(f"{DRAWN_BY}."),
    reason=f"saved pictures are by matplotlib {DRAWN_BY}; others draw text otherwise",
)
@pytest.mark.parametrize("make", [make_map, make_distribution, make_curves, make_front])
def test_a_chart_looks_like_its_saved_picture(make, image_regression):
    """Each chart has the pixels of its saved picture, but for 0.02 % of all brightness,
    which is less than a line of text or a curve.

    After an intended change: `pytest --force-regen`, and look at the new pictures.
    """
    name = make.__name__.removeprefix("make_")
    image_regression.check(make().png(), diff_threshold=0.02, basename=name)


def test_axes_of_a_chart_have_units(make_chart):
    """Each label of an axis has a unit in parentheses."""
    for axes in make_chart().figure.axes:
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert re.search(r"\(.+\)", label) or not label


def test_a_chart_is_the_same_four_files_again(make_chart, tmp_path):
    """A chart is saved as .png, .svg, .csv and .txt, and a second time as the same
    bytes.

    The text is the caption, and the table has the columns and rows of the chart.
    """
    chart = make_chart()
    paths = chart.save(tmp_path / "first")
    paths_of_second = make_chart().save(tmp_path / "second")
    assert [path.suffix for path in paths] == [".png", ".svg", ".csv", ".txt"]
    contents = [path.read_bytes() for path in paths]
    assert contents == [path.read_bytes() for path in paths_of_second]
    png, svg, table, caption = contents
    assert png.startswith(b"\x89PNG")
    assert b"<svg" in svg
    assert caption.decode() == f"{chart.caption}\n"
    header, *rows = csv.reader(io.StringIO(table.decode()))
    assert header == [*chart.header]
    assert len(rows) == len(chart.rows)
    assert {len(row) for row in rows} == {len(header)}
    without_svg = chart.save(tmp_path / "third", vector=False)
    assert [path.read_bytes() for path in without_svg] == [png, table, caption]


# --- what they show
# -------------------------------------------------------------------


def labels_of(legend):
    """Return the texts of a matplotlib legend, as a list."""
    return [text.get_text() for text in legend.texts]


def test_values_and_bounds_are_drawn_in_the_units_of_the_axes():
    """The scale of a plot multiplies coordinates and bounds, here x by 2 and y by 1/4.

    Level, upright line, ticks and limits are given in the units of the axes.
    """
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
    """A curve has a band between its bounds, here 10 % about 1/x.

    A logarithmic axis of little more than a decade labels 1, 2 and 5 of each decade.
    matplotlib has ticks beyond the ends of the axis, 3 and 60, too.
    """
    (axes,) = make_curves().figure.axes
    axes.figure.canvas.draw()
    lowest, highest = axes.get_xlim()
    labels = []
    for label in axes.get_xticklabels(which="both"):
        if lowest <= label.get_position()[0] <= highest and label.get_text():
            labels.append(label.get_text())
    assert labels == ["5", "10", "20", "50"]
    assert [text.get_text().strip() for text in axes.texts] == ["first", "last"]
    (band,) = axes.findobj(mpl.collections.FillBetweenPolyCollection)
    x, y = band.get_paths()[0].vertices.T
    assert sorted({*np.round(x * y, 9)}) == [0.9, 1.1]


def test_a_front_tells_orders_and_draws_an_error_of_zero_on_the_axis():
    """The legend states the order of a series, and errors of 0 are drawn on the axis.

    The front joins the points that no other point beats in cost and error.
    """
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
    """A stability map has a panel for each solver, a cross where its effort is NaN, and
    one colour scale for all panels.
    """
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
        hardnesses = [tick.get_text() for tick in axes.get_yticklabels()]
        assert hardnesses == ["0.2", "0.313", "0.49", "0.767", "1.2"]


def test_all_files_or_none_and_every_digit(tmp_path):
    """The table of a chart keeps every digit.

    If one of its four files cannot be written, `save` raises OutputError and writes
    none.
    """
    chart = curves.residual_history({"bem": [1 / 3, math.pi, math.e]})
    rows = list(csv.reader(io.StringIO(chart.csv())))[1:]
    assert [float(row[2]) for row in rows] == [1 / 3, math.pi, math.e]
    (tmp_path / "x.csv").mkdir()
    with pytest.raises(OutputError, match=r"x\.csv.*is a folder"):
        chart.save(tmp_path / "x")
    assert os.listdir(tmp_path) == ["x.csv"]


def test_matplotlib_is_left_as_it_was():
    """Charts neither use nor change the settings of matplotlib, nor import pyplot."""
    code = f"""
import sys, matplotlib as mpl
from epcontact.output.charts.curves import residual_history

mpl.rcParams["font.size"] = 33.0
chart = residual_history({{"a": [1, 2]}})
chart.png()
assert mpl.rcParams["font.size"] == 33.0
assert "matplotlib.pyplot" not in sys.modules
label = chart.figure.axes[0].xaxis.label
assert label.get_size() == {SETTINGS["axes.labelsize"]}
"""
    done = python("-c", code)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("width", "series", "is_warned"),
    [(0.5, 2, True), (0.03125, 2, False), (5.0, 1, False)],
)
def test_intervals_wider_than_all_differences_are_said(width, series, is_warned):
    """The title and the caption say so if the intervals of two series hide their
    differences.

    `width` is the half-width of the intervals, `series` the number of series (1 or 2),
    and `is_warned` whether the chart says so.
    """
    name = "E* xi / sigma_Y = 5"
    points = {name: ([1.0, 2.0, 3.0], [1.0, 2.1, 3.0])}
    if series == 2:
        points["b"] = ([1.0, 2.0], [1.1, 2.0])
    table = table_of(**points)
    plot = Plot(Axis("cost_s", "E* xi / sigma_Y (–)"), Axis("error", "y (–)"))
    chart = draw_table(with_bounds(table, width), plot, "At E* xi/sigma_Y = 5.")
    (axes,) = chart.figure.axes
    assert ("not tell them apart" in chart.caption) is is_warned
    assert bool(axes.get_title("left")) is is_warned
    # The names of the data are not typeset.
    assert chart.rows[0] == (name, 1.0, 1.0, 1 - width, 1 + width)


def table_of_parts():
    """Return a table of three series (theory, bem, limit) for each of the parts
    "elastic" and "plastic", with bounds.
    """
    table = table_of(theory=([1, 2], [1, 2]), bem=([1, 2], [1, 3]), limit=([0.5], [1]))
    styles = {"theory": "curve", "bem": "marks", "limit": "open"}
    table["style"] = table["series"].map(styles)
    parts = [table.assign(part=part) for part in ("elastic", "plastic")]
    return with_bounds(pd.concat(parts), 0.1)


LOOK_OF_PARTS = {
    "series": ("part", "series"),
    "colour": "part",
    "colours": PART_COLOURS,
    "mark": "series",
}


@pytest.mark.parametrize("name", ["theory", "bem", "limit"])
def test_a_series_has_the_same_mark_in_each_colour(name):
    """Elastic and plastic part of a series (`name`) have one mark and one line style,
    and each part has its colour.
    """
    lines = lines_of(table_of_parts(), **LOOK_OF_PARTS)
    elastic = lines[f"elastic, {name}"]
    plastic = lines[f"plastic, {name}"]
    assert elastic.get_marker() == plastic.get_marker()
    assert elastic.get_linestyle() == plastic.get_linestyle()
    assert elastic.get_color() == PART_COLOURS["elastic"]
    assert plastic.get_color() == PART_COLOURS["plastic"]


def test_error_bars_stand_side_by_side_at_their_marks():
    """Overlapping error bars of four series at one x are more than half a point of
    length apart, together less than 7 points, and each goes through its mark.

    Bars that do not overlap stay at their x.
    """
    lines = lines_of(table_of_parts(), **LOOK_OF_PARTS)
    axes = next(iter(lines.values())).axes
    all_bars = axes.findobj(mpl.collections.LineCollection)
    positions = [bars.get_transform().transform((1, 1))[0] for bars in all_bars]
    marks = [line.get_transform().transform((1, 1))[0] for line in lines.values()]
    assert set(positions) <= set(marks)
    distances = np.diff(positions) * 72 / axes.figure.dpi  # pixels in points
    assert len(distances) == 3
    assert np.all(distances > 0.5)
    assert distances.sum() < 7
    apart = with_bounds(table_of(a=([1], [1]), b=([1], [2])), 0.1)
    for line in lines_of(apart).values():
        place = line.axes.transData.transform((1, 1))[0]
        assert line.get_transform().transform((1, 1))[0] == place


def test_methods_keep_their_colours_and_others_do_not_borrow_them():
    """A method has the same colour in each chart, and no other series has it."""
    names = ("fem", "raw", "bem corrected", "other", "persson, equation (3)")
    lines = lines_of(table_of(**dict.fromkeys(names, ([1, 2], [1, 2]))))
    assert len({line.get_color() for line in lines.values()}) == 5
    alone = lines_of(table_of(fem=([1], [1])))
    assert lines["fem"].get_color() == alone["fem"].get_color()


@pytest.mark.parametrize("style", ["points", "curve"])
def test_twenty_series_have_different_looks(style):
    """No two of 20 series share colour, mark and line style.

    `style` is their style in Plot.
    """
    many = table_of(**{f"kind {n}": ([1, 2], [1, 2]) for n in range(20)})
    looks = {
        (line.get_color(), line.get_marker(), line.get_linestyle())
        for line in lines_of(many, style=style).values()
    }
    assert len(looks) == 20


def test_the_legend_names_values_of_zero_once():
    """The legend explains once the open marks of values of 0 on a logarithmic axis, for
    two series with such a value.
    """
    zeros = ([1, 2], [0.0, 0.1])
    labels = [*lines_of(table_of(a=zeros, b=zeros))]
    assert labels == ["a", "b", "open, on the axis: 0", "_"]


@given(
    st.lists(st.tuples(st.floats(1e-3, 1e3), st.floats(0, 1)), min_size=1, max_size=30)
)
def test_nothing_beats_the_pareto_front(points):
    """The front has exactly the points (cost, error) for which no other point is as
    cheap and as accurate, in the order of their costs.
    """
    costs, errors = zip(*points, strict=True)
    unbeaten = {*points}
    for cost, error in points:
        for point in points:
            is_beaten = cost <= point[0] and error <= point[1]
            if is_beaten and point != (cost, error):
                unbeaten.discard(point)
    front = pareto_front(costs, errors).tolist()
    assert [*map(tuple, front)] == sorted(unbeaten)


@given(order=st.floats(-4, 4), factor=st.floats(1e-6, 1e6))
def test_the_order_of_a_power_law_is_its_exponent(order, factor):
    """The observed order of errors factor h^order is `order`; a spacing h of 0 is left
    out.

    The order is NaN if all spacings are equal or no error is positive.
    """
    spacing = np.array([0.5, 0.25, 0.1, 0.01, 0.0])
    error = np.array([*(factor * spacing[:4] ** order), 1.0])
    assert observed_order(spacing, error) == pytest.approx(order, abs=1e-9)
    assert math.isnan(observed_order([1.0, 1.0], [2.0, 3.0]))
    assert math.isnan(observed_order([1.0, 2.0], [0.0, math.nan]))


@given(
    pressures=st.lists(st.floats(0, 1e9), min_size=2, max_size=50),
    bins=st.integers(1, 80),
)
def test_the_density_sums_up_to_the_elastic_area(pressures, bins):
    """The histogram of a pressure distribution holds its elastic area, here 0.4.

    `pressures` (Pa) are those of the points, and `bins` is the number of the
    histogram's bins; points of equal pressure are a step of the cumulative area.
    """
    ascending = np.append(np.sort(pressures), 1e9)
    cumulative = np.linspace(0.01, 0.4, ascending.size)
    distribution = PressureDistribution(ascending, cumulative, 0.1)
    centres, density = curves.pressure_density(distribution, bins)
    assert density.sum() * 1e9 / bins == pytest.approx(0.4, rel=1e-12)
    assert np.all(density >= 0)
    assert np.all((centres > 0) & (centres < 1e9))


def test_a_distribution_has_means_of_surfaces_and_the_theory_is_its_formula():
    """A chart of distributions shows the mean of the surfaces, and the theory as its
    closed form.

    Without hardness this is equation (1) of the paper, here with its mirror image at 0,
    and with it the sum of the modes between 0 and the hardness.
    """
    chart = make_distribution()
    rows = pd.DataFrame(chart.rows).groupby(0, sort=False)[2].apply(list)
    _, density = curves.pressure_density(result_of("bem", 0.06).distribution)
    assert rows["bem"] == pytest.approx(density, rel=1e-12)
    (axes,) = chart.figure.axes
    lines = {line.get_label(): line for line in axes.lines}
    mean_plastic_area = (0.02 + 0.1) / 2
    label = f"bem (counted plastic area {mean_plastic_area:g})"
    assert labels_of(axes.get_legend())[1] == label
    G = DIFFUSION
    p0 = MEAN_PRESSURE
    x, y = lines["persson without hardness"].get_xydata().T  # GPa and 1/GPa
    near = np.exp(-((1e9 * x - p0) ** 2) / (4 * G))
    far = np.exp(-((1e9 * x + p0) ** 2) / (4 * G))
    elastic = 1e9 * (near - far) / np.sqrt(4 * np.pi * G)
    assert y == pytest.approx(elastic, rel=1e-9, abs=1e-15)
    x, y = lines["persson (plastic area 0.06)"].get_xydata().T
    n = np.arange(1, 40)[:, None] * np.pi / HARDNESS
    modes = np.sin(n * p0) * np.sin(n * 1e9 * x)
    capped = 2e9 / HARDNESS * np.sum(modes * np.exp(-(n**2) * G), axis=0)
    assert y == pytest.approx(capped, rel=1e-9, abs=1e-12 * capped.max())


def test_the_legend_has_the_colours_of_the_map():
    """The legend of a contact map has the colour of the map for each state, and the
    fraction of its points.
    """
    state = np.full((60, 40), APART)
    state[5:25, 5:15] = ELASTIC
    state[35:55, 25:35] = PLASTIC
    # A point of the map in each state, in µm: x to the right and y upward.
    points = {APART: (30, 4), ELASTIC: (15, 20), PLASTIC: (45, 60)}
    chart = maps.contact_map(state, 1e9 * (state > 0), (1e-6, 2e-6))
    figure = chart.figure
    with Image.open(io.BytesIO(chart.png())) as picture:
        pixels = np.asarray(picture.convert("RGB"))[::-1]
    figure.set_dpi(SETTINGS["savefig.dpi"])
    figure.canvas.draw()
    (legend,) = figure.legends
    patches = dict(zip(labels_of(legend), legend.get_patches(), strict=True))
    for kind, point in points.items():
        label = f"{STATE_NAMES[kind]} {100 * np.mean(state == kind):.2f} %"
        (x0, y0), (x1, y1) = patches[label].get_window_extent().get_points()
        legend_colour = pixels[int(y0 + y1) // 2, int(x0 + x1) // 2]
        x, y = figure.axes[0].transData.transform(point)
        map_colour = pixels[int(y), int(x)]
        assert np.array_equal(legend_colour, map_colour)


@pytest.mark.parametrize(
    ("value", "unit", "scale", "prefixed_unit"),
    [
        (2.5e-4, "m", 1e-6, "µm"),
        (1e-10, "m", 1e-9, "nm"),
        (1500.0, "m", 1.0, "m"),
        (1.5e11, "Pa", 1e9, "GPa"),
        (0.0, "Pa", 1.0, "Pa"),
        (math.inf, "Pa", 1.0, "Pa"),
    ],
)
def test_units_suit_their_values(value, unit, scale, prefixed_unit):
    """`unit_for` returns the scale and the prefixed unit of a value in the base `unit`.

    Values of 0 and infinity have no prefix.
    """
    assert unit_for(value, unit) == (scale, prefixed_unit)


def test_an_empty_chart_is_refused():
    """`residual_history` raises ValueError if no residual is a number."""
    with pytest.raises(ValueError, match="nothing to draw"):
        curves.residual_history({"a": [math.nan]})


@pytest.mark.parametrize("results", [{}, {"bem": []}])
def test_no_pressures_to_draw_are_refused_in_a_sentence(results):
    """A chart of pressures of no results ends in a sentence with the remedy."""
    with pytest.raises(
        InvalidCase, match="hold no pressure distribution; give results"
    ):
        curves.pressure_distribution(results)
