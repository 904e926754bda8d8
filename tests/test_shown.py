"""What a person reads is what was computed: page, tables, pictures and field files,
cell by cell.

One scene is run once, on an oblong grid, along a path that unloads, by two methods.
Where exchanged columns must show, the numbers are made up, no two alike.
"""

import base64
import itertools
import json
import math
import re
import sys
import xml.etree.ElementTree as ET
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
import pyvista as pv
from command_line import invoke
from conftest import SMALL_CASE

import epcontact
from epcontact import bem
from epcontact.cli.tables import _gate_row
from epcontact.harness.case_files.case import load_case
from epcontact.harness.gates import Estimate, GateVerdict
from epcontact.harness.quantities.registry import QUANTITIES
from epcontact.harness.solving.scene_description import describe_scene
from epcontact.harness.verdict.evidence import KINDS as REFERENCES
from epcontact.harness.verdict.evidence import SUBJECTS
from epcontact.harness.verdict.judgement import CaseVerdict, MethodEntry, Verdict
from epcontact.harness.verdict.overview import overview, quantity_words
from epcontact.harness.verdict.verification import _counted
from epcontact.notebook import notebook_bar
from epcontact.output import drawing, report
from epcontact.output.charts import maps
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.style import STATE_NAMES
from epcontact.output.report import write_report
from epcontact.output.view import find_result, load_steps
from epcontact.output.vtk import read_fields
from epcontact.results import (
    APART,
    ELASTIC,
    PLASTIC,
    Areas,
    ContactResult,
    LoadStep,
    Provenance,
)
from epcontact.scene import (
    Body,
    Load,
    Material,
    Scene,
    SelfAffineSpectrum,
    Surface,
)
from epcontact.surfaces import SelfAffine

KINDS = ("raw", "corrected", "error")
#: What makes the small case one of an oblong rubber block that is unloaded, for two
#: methods.
CHANGES = {
    '"small"': '"shown"',
    '"persson", "bem"': '"bem", "fem"',
    "[3, 5, 7]": "[5]",
    "period = 1.0e-3": "period = [1.0e-3, 1.25e-3]\nshape = [16, 24]",
    "wavenumber_high = 5.026548245743669e4": "wavenumber_high = 2.0e4",
    "rms_slope = 0.1": "rms_slope = 0.02",
    "points_per_shortest_wavelength = { fast = 4, full = 8 }\n": "",
    "young_modulus = 100.0e9": "young_modulus = 2.1e6",
    "hardness = 6.0e9": "hardness = 15.0e3",
    "poisson_ratio = 0.3": "poisson_ratio = 0.4",
    "[theory]\nenergy_reduction = 0.536": '[fem]\nlaw = "capped"\nlayers = 2',
    "mean_pressure = 5.0e8": "mean_pressure = [2.0e3, 5.0e3, 3.0e3]",
    "area.total.corrected": "area.total.raw",
    'of = "bem"\nagainst = "persson"': 'of = "fem"\nagainst = "bem"',
}
#: The hardness of the block in Pa.
HARDNESS = 15.0e3


@dataclass
class Run:
    """The output of several commands on one scene, and what they printed and drew.

    The attributes are `home`, the folder that holds the case file; `charts`, the chart
    saved under each file name; `texts`, the standard output of each command; and
    `windows`, see below.
    """

    home: Path
    charts: dict[str, Chart]
    texts: dict[str, str]
    #: For each command the calls of each of its windows: name, arguments and options.
    windows: dict[str, list[list[tuple[str, tuple, dict]]]]

    @property
    def folder(self):
        """Return the folder with the results of both methods at the size `fast`."""
        return self.home / "shown" / "fast"

    @property
    def surface(self):
        """Return the rough surface of the case, which has 16 x 24 points."""
        case = load_case(self.home / "shown.toml")
        return case.scene(case.recipes[0]).surface

    def last_load(self, method):
        """Return the field file of a method ("bem" or "fem"), which holds the last
        load, and its `ContactResult`.
        """
        (member,) = json.loads((self.folder / f"{method}.json").read_text())["members"]
        fields = read_fields(self.folder / f"{method}-seed5.vti")
        return fields, ContactResult.from_json(member)

    def texts_drawn(self, command):
        """Return the texts in the only 3D window that a command drew.

        `command` is a key of `windows`, such as "view".
        """
        (calls,) = self.windows[command]
        return [arguments[0] for name, arguments, _ in calls if name == "add_text"]


@pytest.fixture(scope="session")
def ran(tmp_path_factory):
    """Run the six commands once on the oblong rubber block, and return a `Run` with
    their files, texts, charts and windows.

    `Chart.save` and the plotter are wrapped, so that every chart and every call of a 3D
    window is recorded while the commands run.
    """
    home = tmp_path_factory.mktemp("shown")
    case = home / "shown.toml"
    text = SMALL_CASE
    for old, new in CHANGES.items():
        assert old in text, old
        text = text.replace(old, new)
    case.write_text(text)
    run = Run(home, {}, {}, {})
    save = Chart.save
    new_plotter = drawing._plotter

    def save_and_note(chart, path, vector=True):
        """Record a chart under the name of its file, and save it, as `vector`, too."""
        run.charts[path.name] = chart
        return save(chart, path, vector)

    def noting_plotter(size):
        """Return a new 3D plotter of this window size in pixels, whose calls are
        recorded in the windows of the current command.
        """
        plotter = new_plotter(size)
        calls = []
        windows.append(calls)
        for name in ("add_mesh", "add_text", "add_legend", "show_bounds"):
            method = getattr(plotter, name)
            setattr(plotter, name, note_calls(calls, name, method))
        return plotter

    steps = run.folder / "bem-seed5-steps"
    solve = ("--precision", "double", "--jobs", 1, "--output", home)
    picture = ("--screenshot", home / "x.png")
    difference = ("--against", run.folder / "fem-seed5.vti")
    # `run` stands first, so that `report` finds the pictures of `verify` up to date.
    commands = {
        "run": ("run", case, "--fields", "film", *solve),
        "verify": ("verify", case, "--fields", "steps", "--report", "--gates", *solve),
        "report": ("report", home),
        "view": ("view", steps / "step-0001.vti", *picture),
        "map": ("view", steps / "path.pvd", "--map", home / "map"),
        "difference": ("view", run.folder / "bem.json", *difference, *picture),
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Chart, "save", save_and_note)
        patch.setattr(drawing, "_plotter", noting_plotter)
        for name, command in commands.items():
            windows = run.windows[name] = []
            done = invoke(*command)
            assert done.returncode == 0 or name in ("view", "difference"), done
            run.texts[name] = done.stdout
    return run


def note_calls(calls, name, method):
    """Return a function that records each call as (name, arguments, options) in the
    list `calls`, and then calls `method`.
    """

    def noting(*arguments, **options):
        """Record the call and return what the method returns."""
        calls.append((name, arguments, options))
        return method(*arguments, **options)

    return noting


@pytest.mark.parametrize("method", ["bem", "fem"])
def test_a_field_file_is_that_of_the_last_load(ran, method):
    """The saved fields are those of the last load, 3 kPa, and not of the first.

    Heights, periods, areas and all quantities equal those of the result; pressures obey
    the cap.
    """
    file, result = ran.last_load(method)
    first, *_, last = result.steps
    assert first.areas["raw"] != last.areas["raw"]
    assert file.shape == (16, 24)
    assert file.periods == pytest.approx((1.0e-3, 1.25e-3), rel=1e-14)
    assert np.array_equal(file.fields["heights"], ran.surface.heights)
    pressure = file.fields["pressure"]
    state = file.fields["state"]
    assert pressure.mean() == pytest.approx(3e3, rel=1e-7)
    assert pressure.max() <= HARDNESS * (1 + 1e-12)
    assert np.array_equal(state != APART, pressure > 0)
    attributes = {f"quantity.{name}": value for name, value in last.quantities.items()}
    attributes["mean_pressure"] = 3e3
    assert attributes.items() <= file.attributes.items()
    raw = last.areas["raw"]
    fractions = [np.mean(state == kind) for kind in (ELASTIC, PLASTIC)]
    assert fractions == pytest.approx([raw.elastic, raw.plastic], abs=1e-12)


def test_a_collection_stands_for_its_last_load(ran):
    """A .pvd collection lists the three loads in order, and a view of the collection
    reads the last of them.
    """
    collection = ran.folder / "bem-seed5-steps" / "path.pvd"
    rows = []
    for row in ET.parse(collection).iter("DataSet"):
        rows.append((row.get("timestep"), row.get("name"), row.get("file")))
    assert rows == [
        ("0", "mean pressure 2000.0 Pa", "step-0000.vti"),
        ("1", "mean pressure 5000.0 Pa", "step-0001.vti"),
        ("2", "mean pressure 3000.0 Pa", "step-0002.vti"),
    ]
    assert find_result(collection) == load_steps(collection)[2]
    assert ran.texts["map"] == f"map in {ran.home / 'map'}\n"
    assert ran.texts["run"].count("film in ") == 2


def test_the_page_holds_the_pictures_the_scene_and_every_cell_of_the_gates(ran):
    """The report shows every picture's caption, every value that describes the scene,
    and five cells for each gate of the verdict.

    The pressures of the two methods are the only picture above the gates.
    """
    _, pictures, cells = page_of(ran.home / "report.html")
    content = (ran.home / "report.html").read_text("utf-8")
    above, below = content.split("<h3>Gates</h3>")
    assert above.count("<img") == above.count('alt="Contact pressure by capped') == 1
    assert below.count("<img") == len(pictures) - 1
    captions = {path.read_text().strip() for path in ran.folder.glob("*.txt")}
    assert pictures == captions
    tables = tree_of(ran.home / "report.html").iter("table")
    (facts,) = [table for table in tables if table.get("class") == "facts"]
    texts = {row[0].text: row[1].text for row in facts.iter("tr")}
    described = ran.last_load("bem")[1].provenance.about
    for entry in described.values():
        shown = report.value_text(entry["value"], entry["unit"])
        assert texts[entry["meaning"]] == shown
    gate_cells = [[*attributes.values()] for attributes, _ in cells]
    (case,) = json.loads((ran.home / "verdict.json").read_text())["cases"]
    expected = []
    for gate in case["gates"]:
        for field in ("status", "value", "reference", "difference", "band"):
            expected.append(["shown", gate["quantity"], field])
    assert gate_cells == expected


def tree_of(path):
    """Return the root element of an HTML page.

    `path` is the file of the page. Its empty elements, such as <img>, are closed before
    an XML parser reads them.
    """
    text = path.read_text("utf-8").partition("\n")[2]
    return ET.fromstring(re.sub(r"<((?:meta|link|img)\b[^>]*)>", r"<\1/>", text))


def page_of(path):
    """Return the text of an HTML page, the set of its pictures' captions, and the cells
    of its gates as pairs (dictionary with the case, the quantity and the field, text).

    The assertions require that the page embeds all pictures, links only within itself,
    and has no script.
    """
    page = tree_of(path)
    ids = {element.get("id") for element in page.iter()}
    for element in page.iter():
        for name in ("src", "href", "srcset", "action"):
            reference = element.get(name, "data:")
            assert reference.startswith("data:") or reference[1:] in ids, reference
    captions = set()
    for picture in page.iter("img"):
        kind, _, content = picture.attrib["src"].partition(";base64,")
        assert base64.b64decode(content, validate=True)
        assert kind in ("data:image/webp", "data:image/gif")
        captions.add(picture.get("alt"))
    assert not [*page.iter("script")]
    cells = []
    for section in page.iter("section"):
        for row in section.iter("tr"):
            quantity = row.get("data-quantity")
            for cell in row.iter("td"):
                field = cell.get("data-field")
                if field:
                    data = {
                        "case": section.get("id"),
                        "quantity": quantity,
                        "field": field,
                    }
                    cells.append((data, "".join(cell.itertext())))
    return "".join(page.itertext()), captions, cells


def check_images(chart, *expected):
    """Compare the images of a chart with fields in mm, each with its limits of colour.

    Args:
        chart: the chart.
        expected: for each image its title, field (nx, ny) and the limits.
    """
    panels = [axes for axes in chart.figure.axes if axes.images]
    for axes, (title, field, *limits) in zip(panels, expected, strict=True):
        (image,) = axes.images
        drawn = np.ma.filled(image.get_array(), 0.0)
        # The period is drawn whole: the first points stand at both of its ends.
        wrapped = np.pad(field, (0, 1), mode="wrap")
        assert drawn == pytest.approx(wrapped.T, rel=1e-6, abs=1e-9)
        assert axes.axis() == pytest.approx((0, 1, 0, 1.25))
        assert axes.get_title() == title
        assert axes.get_xlabel() == "x (mm)"
        assert axes.get_ylabel() in ("y (mm)", "")
        assert panels[0].get_ylabel() == "y (mm)"
        assert image.origin == "lower"
        assert image.get_clim() == pytest.approx(limits, rel=1e-6)
        half_cells = (1 / 16 / 2, 1.25 / 24 / 2)
        ends = (-half_cells[0], 1 + half_cells[0], -half_cells[1], 1.25 + half_cells[1])
        assert image.get_extent() == pytest.approx(ends, rel=1e-9)


@pytest.mark.parametrize("method", ["bem", "fem"])
def test_a_map_shows_state_and_pressure_and_their_fractions(ran, method):
    """The contact map draws the state and the pressure in kPa, up to the hardness of 15
    kPa, and labels each state with its percentage of grid points.
    """
    fields = ran.last_load(method)[0].fields
    chart = ran.charts[f"contact-{method}"]
    state_title = "contact state (fractions of grid points)"
    check_images(
        chart,
        (state_title, fields["state"], 0, 3),
        ("contact pressure", 1e-3 * fields["pressure"], 0, 15),
    )
    fractions = {}
    labels = []
    for kind in (APART, ELASTIC, PLASTIC):  # no point is flat without contact
        name = STATE_NAMES[kind]
        fractions[name] = np.mean(fields["state"] == kind)
        labels.append(f"{name} {100 * fractions[name]:.2f} %")
    assert dict(chart.rows) == pytest.approx(fractions | {"mean_pressure_Pa": 3e3})
    (legend,) = chart.figure.legends
    assert sorted(text.get_text() for text in legend.texts) == sorted(labels)


def test_a_chart_shows_the_fields_and_the_figures(ran):
    """The chart of two methods draws both pressures and their difference, in kPa over
    mm, and tabulates the largest, rms and mean values in Pa, and the rms difference
    over the rms of the boundary elements.
    """
    first = 1e-3 * ran.last_load("fem")[0].fields["pressure"]
    second = 1e-3 * ran.last_load("bem")[0].fields["pressure"]
    difference = first - second
    largest = max(first.max(), second.max())
    bound = abs(difference).max()
    relative = np.linalg.norm(difference) / np.linalg.norm(second)
    chart = ran.charts["pressure-difference-fem-bem"]
    check_images(
        chart,
        ("capped elements (fem)", first, 0, largest),
        ("boundary elements (bem)", second, 0, largest),
        (f"difference, rms: {100 * relative:.2g} %", difference, -bound, bound),
    )
    assert dict(chart.rows) == pytest.approx(
        {
            "largest_pressure_Pa": 1e3 * largest,
            "largest_difference_Pa": 1e3 * bound,
            "rms_difference_Pa": 1e3 * math.sqrt(np.square(difference).mean()),
            "mean_pressure_first_Pa": 1e3 * first.mean(),
            "mean_pressure_second_Pa": 1e3 * second.mean(),
            "rms_difference_over_second": relative,
        }
    )


def lines_of(chart):
    """Return the points (n, 2) of each line of a chart with one panel, by the line's
    label.
    """
    (axes,) = chart.figure.axes
    return {line.get_label(): line.get_xydata() for line in axes.lines}


def test_curves_show_the_pressures_the_residuals_and_the_spectrum(ran):
    """The curves show the distribution of the pressure fields, every positive residual
    of the solver, and the analytic spectrum of the surface.

    The spectrum is flat up to the roll-off at 12566 rad/m and then falls with exponent
    -2 (1 + Hurst exponent 0.8) up to 2e4 rad/m.
    """
    chart = ran.charts["pressure-distribution"]
    lines = lines_of(chart)
    for method in ("bem", "fem"):
        fields, result = ran.last_load(method)
        pressure = 1e-3 * fields.fields["pressure"]
        centres, density = lines[method].T
        width = centres[1] - centres[0]
        above = pressure.ravel() > centres[0] - width / 2
        below = pressure.ravel() <= centres[:, None] + width / 2
        counted = np.mean(above & below, axis=1)
        # A table between two of its pressures is linear, so that a point may be in the
        # next bin.
        assert np.cumsum(density * width) == pytest.approx(counted, abs=0.015)
        positive = [residual for residual in result.history if residual > 0]
        residuals = lines_of(ran.charts["residuals"])[method][:, 1]
        assert residuals.tolist() == pytest.approx(positive, rel=1e-12)
    uprights = [points[0, 0] for points in lines.values() if len(points) == 2]
    assert sorted(uprights) == [3.0, 15.0]
    (axes,) = chart.figure.axes
    assert axes.get_xlabel() == r"contact pressure $\sigma$ (kPa)"
    assert axes.get_ylabel() == r"density $P(\sigma)$ (1/kPa)"
    q, power = lines_of(ran.charts["power-spectrum"])["analytic"].T
    flat = power[q < 12566]
    assert flat == pytest.approx(flat[0], rel=1e-12)
    falls = q > 12567
    exponent = np.polyfit(np.log(q[falls]), np.log(power[falls]), 1)[0]
    assert exponent == pytest.approx(-2 * (1 + 0.8), rel=1e-9)
    assert q[-1] == pytest.approx(2.0e4)


def test_a_view_shows_the_fields(ran):
    """The 3D window draws pressures in kPa and the gap in mm, 20 times enlarged, at the
    second load of the path, 5 kPa.
    """
    if not ran.windows["view"]:
        pytest.skip("nothing can be drawn in three dimensions here")
    file = read_fields(ran.folder / "bem-seed5-steps" / "step-0001.vti")
    (calls,) = ran.windows["view"]
    meshes = []
    for name, arguments, options in calls:
        if name == "add_mesh" and "scalars" in options:
            meshes.append((arguments[0], options))
    (state, look), (pressure, pressure_look) = meshes
    assert look["scalars"] == "state"
    assert look["clim"] == (-0.5, 2.5)
    assert pressure_look["clim"] == (0.0, 15.0)
    x, y, z = (np.reshape(c, (17, 25), order="F") for c in state.points.T)
    assert x[-1, 0] == pytest.approx(1.0, rel=1e-6)
    assert y[0, -1] == pytest.approx(1.25, rel=1e-6)
    gap = np.pad(np.maximum(file.field("gap"), 0), (0, 1), mode="wrap")
    assert z == pytest.approx(-20e3 * gap, abs=1e-6)
    drawn = np.nan_to_num(np.reshape(pressure["pressure"], (17, 25), order="F"))
    expected = 1e-3 * np.pad(file.field("pressure"), (0, 1), mode="wrap")
    assert drawn == pytest.approx(expected, rel=1e-6)
    titles = [
        "Contact state; 1 × 1.25 mm, heights × 20",
        "Contact pressure; mean pressure 5 kPa",
    ]
    states = []
    for kind in (APART, ELASTIC, PLASTIC):
        percentage = 100 * np.mean(file.field("state") == kind)
        states.append(f"{STATE_NAMES[kind]}\n{percentage:.2f} %")
    assert ran.texts_drawn("view") == [*titles, *states]
    for name, _, options in calls:
        if name == "show_bounds":
            ends = pytest.approx(options["bounds"], abs=1e-3)
            assert options["axes_ranges"] == ends


def test_a_film_of_a_block_shows_its_stresses_in_one_scale(ran):
    """All pictures of a film use the colour range of the von Mises stress at the last
    load, in kPa, and the surface's ranges are those of its contact pressure and gap.
    """
    if not ran.windows["verify"]:
        pytest.skip("nothing can be drawn in three dimensions here")
    body = next(ran.folder.glob("fem-seed5-steps/*0002.vtu"))
    mesh = pv.read(body)
    mises = 1e-3 * mesh.get_array("von_mises", preference="point").max()
    first_window = ran.windows["verify"][0]
    looks = [options for name, _, options in first_window if name == "add_mesh"]
    assert looks[0]["clim"] == pytest.approx((0, mises), rel=1e-6)
    assert looks[0]["scalars"].max() <= mises * (1 + 1e-6)
    assert mesh.bounds[1] == pytest.approx(1e-3)
    assert mesh.bounds[3] == pytest.approx(1.25e-3)
    top = drawing.read_block(body.with_stem(f"{body.stem}-surface"))
    largest = [np.max(top.point_data[name]) for name in ("contact_pressure", "gap")]
    assert drawing.block_scale(top)[1] == pytest.approx(largest)


def test_a_scene_is_described_by_its_numbers_and_units():
    """The description of a scene gives each value in SI units, computed here from the
    spectrum, the grid, the material and the loads.
    """
    spectrum = SelfAffineSpectrum(0.7, 7e3, 12e3, 24e3, 0.05)
    recipe = SelfAffine(spectrum, (1e-3, 1.5e-3), (16, 32), 5)
    material = Material(100e9, 0.3, hardness=6e9)
    scene = Scene(recipe.build(), material, Load((2e8, 5e8)))
    described = describe_scene(scene, recipe, "")
    pressure_group = 100e9 / (1 - 0.3**2) * 0.05
    expected = {
        "points": ([16, 32], "–"),
        "periods": ([1e-3, 1.5e-3], "m"),
        "spacing": ([1e-3 / 16, 1.5e-3 / 32], "m"),
        "resolution": (2 * math.pi / 24e3 / (1e-3 / 16), "–"),
        "rms_height": (math.sqrt(np.square(scene.surface.heights).mean()), "m"),
        "rms_slope": (0.05, "–"),
        "young_modulus": (100e9, "Pa"),
        "effective_modulus": (100e9 / (1 - 0.3**2), "Pa"),
        "hardness": (6e9, "Pa"),
        "load_path": ([2e8, 5e8], "Pa"),
        "load_group": (5e8 / pressure_group, "–"),
        "hardness_group": (6e9 / pressure_group, "–"),
    }
    for name, (value, unit) in expected.items():
        assert described[name]["value"] == pytest.approx(value, rel=1e-9), name
        assert described[name]["unit"] == unit
    assert described["surface"]["value"] == (
        "self-affine roughness: Hurst exponent 0.7, flat spectrum from 7000 to 12000 "
        "rad/m, power law up to 24000 rad/m, rms slope 0.05, seed 5"
    )
    assert described["body"]["value"] == "half-space"
    assert "hardness_source" not in described


def test_a_profile_is_that_of_the_fields():
    """The chart of a line with 6 points 2 mm apart tabulates the fields in SI units and
    draws heights in µm below the flat and pressures in kPa.
    """
    state = np.array([0, 1, 2, 0, 0, 1])
    pressure = np.array([0.0, 3e3, 5e3, 0.0, 0.0, 1e3])
    gap = np.array([4e-6, 0.0, -1e-6, 2e-6, 1e-6, 0.0])
    chart = maps.contact_profile(state, pressure, gap, (2e-3,))
    assert chart.header == ("x_m", "state", "pressure_Pa", "gap_m")
    columns = np.array(chart.rows).T
    assert columns == pytest.approx(
        np.array([2e-3 * np.arange(6), state, pressure, gap])
    )
    left, right = chart.figure.axes
    assert left.get_title() == "profile in contact"
    assert left.get_ylabel() == "height below the flat (µm)"
    assert right.get_title() == "contact pressure, mean 1.5 kPa"
    assert right.get_ylabel() == "pressure (kPa)"
    assert left.get_xlabel() == right.get_xlabel() == "x (mm)"
    body, *contact = (drawn.get_paths()[0].vertices for drawn in left.collections)
    assert body[:, 1].max() == 0
    assert {*np.round(body[:, 1], 9)} >= {0.0, -1.0, -2.0, -4.0}
    assert [part[:, 1].max() > 0 for part in contact] == [True, True]
    (drawn,) = right.collections
    assert drawn.get_paths()[0].vertices[:, 1].max() == 5.0


def test_a_difference_states_the_mean_of_each_pressure():
    """The mean pressure of each of the two methods stands in its own row."""
    chart = maps.pressure_difference(np.eye(2), np.ones((2, 2)), (1.0, 1.0))
    values = dict(chart.rows)
    assert values["mean_pressure_first_Pa"] == 0.5
    assert values["mean_pressure_second_Pa"] == 1.0


# --- invented numbers, no two alike ---------------------------------------------------

STATUSES = ("holds", "falls short", "error")
HOSTILE = '</td><script src="http://evil.example/x.js">alert(1)</script> & "quoted"'


def gate(number, status):
    """Return a `GateVerdict` with this status whose invented values depend on its
    number, from 0 to 8.

    A status of "error" leaves the gate without values.
    """
    size = 1.9**number
    judged: dict[str, Any] = {}
    if status == "error":
        judged["error"] = "no such thing"
    else:
        for index, name in enumerate(("value", "reference", "difference")):
            judged[name] = Estimate(
                mean=(0.1 + 0.137 * index) * size,
                half_width_95=(0.011 + 0.0023 * index) * size,
                surfaces=8,
            )
    if number % 2:
        judged["grid_error"] = 0.043 * size
    return GateVerdict(
        name=f"gate {number}",
        status=status,
        quantity=f"quantity.q{number}",
        of=f"of{number}",
        against=f"against{number}",
        norm=("absolute", "relative", "wasserstein")[number % 3],
        low=-0.031 - 0.01 * number,
        high=0.047 + 0.013 * number,
        because="it must",
        source="",
        half_width=0.029 * size,
        kind=("identity", "closed form")[number % 2],
        subject=("theory", "inputs")[number // 6],
        **judged,
    )


def case_of(number):
    """Return a `CaseVerdict` with the status STATUSES[number] and number + 1 gates, one
    for each status up to that of the case.
    """
    statuses = STATUSES[: number + 1]
    gates = [gate(3 * number + k, status) for k, status in enumerate(statuses)]
    return CaseVerdict(
        id=f"case-{number}",
        status=STATUSES[number],
        requirement="It holds.",
        source="here",
        skipped_because="",
        size="fast",
        methods={"bem": MethodEntry(surfaces=2, reused=0, errors=[])},
        gates=gates,
    )


def verdict():
    """Return a `Verdict` on three cases, one of each status in STATUSES."""
    return Verdict.on([case_of(number) for number in range(3)], "fast")


def test_a_row_of_a_gate_has_its_numbers_in_per_cent_and_all_claims():
    """A row on the terminal has value, reference, and the difference in per cent.

    The number behind its ± is the half-width of the gate, 0.029 * 1.9, and not that of
    the scatter of the surfaces, 0.0156 * 1.9.
    """
    row = [str(cell) for cell in _gate_row(gate(1, "holds"))]
    assert row[:3] == ["quantity.q1", "of1", "against1"]
    assert row[3:5] == ["0.19 ± 0.021", "0.4503 ± 0.025"]
    assert row[5:] == ["+71.06 % ± 5.51 %", "-4.10 % … +6.00 %", "holds"]


def result_of_seed(seed):
    """Return a `ContactResult` of bem at one load whose invented areas decrease with
    the seed of the surface.
    """
    areas = {}
    for index, kind in enumerate(KINDS):
        total = (0.3 - 0.047 * index) / 1.13**seed
        areas[kind] = Areas(total, total / 1.37, total / 1.74)
    cost = {
        "seconds": 1.0,
        "unknowns": 4096.0,
        "peak_memory_bytes": 2.0**28,
        "fft_pairs": 90.0,
    }
    step = LoadStep(1.25e10, areas, {"gap": 2e-9}, {}, {"mean_gap": 3e-9})
    return ContactResult("bem", (step,), Provenance("0123abcd", seed), cost=cost)


def test_a_result_describes_itself_with_its_area_and_its_table_of_loads():
    """The `repr` of a result states its last area with its error at 95 % (1.19 times
    the estimate of 0.206), and its HTML is the
    table of loads.
    """
    result = result_of_seed(0)
    described = "1 load, contact area 0.253 ± 0.25 at 1.25e+10 Pa"
    assert repr(result) == f"<ContactResult of bem: {described}>"
    table = ET.fromstring(result._repr_html_())
    cells = [cell.text for cell in table.iter("td")]
    assert {"loading", "1.25e+10", "0.253", "3e-09"} <= {*cells}


def test_a_scene_and_its_charts_show_themselves_in_a_notebook():
    """The HTML of a scene is a table of its values with units, and that of charts has
    each picture with its caption.
    """
    heights = 1e-6 * np.cos(2 * np.pi * np.arange(64) / 64)
    surface = Surface(heights, (1e-3,), seed=3)
    scene = Scene(surface, Material(1e11, 0.3), Load((1e6, 0)), Body("bonded_layer", 1))
    cells = [cell.text for cell in ET.fromstring(scene._repr_html_()).iter("td")]
    surface_cells = [
        cell.text for cell in ET.fromstring(surface._repr_html_()).iter("td")
    ]
    slope = f"{surface.rms_slope:.4g}"
    sides = ["64", "0.001 m", "1.563e-05 m"]
    assert surface_cells == [*sides, "7.071e-07 m", slope, "3"]
    material = ["0.3", "1e+11 Pa", "bonded layer, 1 m deep", "1e+06, 0 Pa"]
    assert cells == surface_cells + material
    charts = epcontact.plot(scene, bem.solve(replace(scene, body=Body())))
    page = ET.fromstring(f"<html>{charts._repr_html_()}</html>")
    captions = [caption.text for caption in page.iter("figcaption")]
    assert captions == [f"{name}: {c.caption}" for name, c in charts.items()]
    assert len([*page.iter("img")]) == len(charts) > 1


def test_a_verdict_shows_its_gates_in_a_notebook():
    """The HTML of a verdict has a row with status for each gate, and its `repr` counts
    those that hold.
    """
    judged = verdict()
    gates = [gate for case in judged.cases for gate in case.gates]
    held = sum(gate.status == "holds" for gate in gates)
    assert repr(judged) == f"<Verdict: {held} of {len(gates)} gates hold, 3 cases>"
    page = ET.fromstring(f"<html>{judged._repr_html_()}</html>")
    cells = [[cell.text for cell in row.iter("td")] for row in page.iter("tr")][1:]
    assert [(row[1], row[-1]) for row in cells] == [
        (gate.name, gate.status) for gate in gates
    ]


@pytest.fixture
def shown_in_notebook(monkeypatch):
    """Pretend that IPython's kernel runs, without the delay of the bar, and return the
    list of what the notebook shows one after another.
    """
    ipython = mock.MagicMock()
    ipython.display.HTML = str
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setattr("epcontact.notebook._DELAY", 0.0)
    monkeypatch.setattr("epcontact.notebook._PAUSE", 0.0)
    shown = []
    ipython.display.display.side_effect = lambda html, **_: (
        shown.append(html) or mock.MagicMock(update=shown.append)
    )
    return shown


def test_a_notebook_gets_a_bar_of_progress_that_vanishes(shown_in_notebook):
    """The bar of a verification counts the solves and vanishes at the end.  A bar
    inside of another one is not shown.
    """
    with notebook_bar() as bar, notebook_bar() as inner:
        assert inner is None
        move = _counted(bar)
        move(1.5, 4, "case <bem>")
        move(2.5, 4, "")
    assert shown_in_notebook == [
        '<progress value="0.375" max="1"></progress> 1 of 4 solves: case &lt;bem&gt;',
        '<progress value="0.625" max="1"></progress> 2 of 4 solves: case &lt;bem&gt;',
        "",
    ]


def test_a_solve_in_a_notebook_has_a_bar_unless_its_caller_reports(shown_in_notebook):
    """`bem.solve` moves one bar up to its last load; with `progress` it
    shows none.
    """
    heights = 1e-6 * np.cos(2 * np.pi * np.arange(64) / 64)
    scene = Scene(Surface(heights, (1e-3,)), Material(1e11, 0.3), Load((1e6, 2e6)))
    bem.solve(scene, progress=lambda *_: None)
    assert shown_in_notebook == []
    bem.solve(scene)
    *bars, end = shown_in_notebook
    assert end == ""
    assert re.search(r'value="0\.[5-9].*bem: mean pressure 2e\+06 Pa', bars[-1])


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        ([1e3 * n for n in range(1, 9)], "Pa", "1, 2, 3, 4, 5, 6, 7, 8 kPa"),
        ([1e3 * n for n in range(1, 12)], "Pa", "1, 2, 3, … 7 more …, 11 kPa"),
        ([1.25e-4, 2e-3], "m", "0.125 × 2 mm"),
        ([32, 4096], "–", "32 × 4096"),
        (math.inf, "Pa", "none"),
    ],
)
def test_values_have_suitable_units(value, unit, text):
    """A value or a list in SI units becomes a text with a prefixed unit; long lists are
    shortened, and infinity is "none".
    """
    assert report.value_text(value, unit) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.23456, "1.235"),
        ("inf", "inf"),
        (math.nan, "–"),
        (None, ""),
        ("words", "words"),
        (0, "0"),
    ],
)
def test_numbers_have_four_digits(value, text):
    """`number_text` rounds numbers to four digits and leaves words as they are; NaN
    becomes a dash, and None an empty text.
    """
    assert report.number_text(value) == text


def test_the_page_opens_with_a_matrix_and_ends_it_with_what_is_not_covered(tmp_path):
    """Each cell of the overview shows the worst margin and the number of its gates, and
    links to the list of its cases.

    The quantities that no gate reads follow, without error estimates and the work of
    solvers; one gate reads `area.total.raw`.
    """
    content = verdict().content
    content["cases"][0]["gates"][0]["quantity"] = "area.total.raw"
    seen = overview(Verdict.model_validate(content))
    write_report(tmp_path / "x.html", content, {}, overview=seen)
    page = tree_of(tmp_path / "x.html")
    margins = defaultdict(list)
    cases = defaultdict(set)
    for case in verdict().cases:
        for gate in case.gates:
            margins[gate.subject, gate.kind].append(gate.margin)
            cases[gate.subject, gate.kind].add(case.id)
    cells = {}
    for cell in page.iter("td"):
        if cell.get("data-subject"):
            cells[cell.get("data-subject"), cell.get("data-kind")] = cell
    assert cells.keys() == {*itertools.product(SUBJECTS, REFERENCES)}
    elements = {element.get("id"): element for element in page.iter()}
    for cell, margins_of_cell in margins.items():
        link, number = cells[cell]
        worst = report.number_text(np.min(margins_of_cell), 3)  # a dash for an error
        assert link.text == worst
        count = len(margins_of_cell)
        assert number.text == f"{count} gate{'s' if count > 1 else ''}"
        target = elements[link.get("href").removeprefix("#")]
        listed = {anchor.get("href").removeprefix("#") for anchor in target.iter("a")}
        assert listed == cases[cell]
    uncovered = [row.get("data-uncovered") for row in page.iter("tr")]
    listed = [name for name in uncovered if name]
    assert "area.total.raw" not in listed
    assert {"area.total.corrected", "quantity.mean_gap"} <= {*listed}
    assert not {"cost.seconds", "area.total.error", "residual.load"} & {*listed}
    assert {*listed} < QUANTITIES.keys()


def area_gate(value, reference, against, kind):
    """Return a judged gate on the total area of bem: a relative band of ± 0.2.

    Args:
        value, reference: the two areas; the half-width of their difference is 0.01.
        against: the name of the reference, whose `kind` is given.
    """
    difference = value / reference - 1
    sides = {"value": value, "reference": reference, "difference": difference}
    estimates = {
        name: Estimate(mean=mean, half_width_95=0.0, surfaces=1)
        for name, mean in sides.items()
    }
    return GateVerdict(
        name="an area",
        status="holds" if abs(difference) < 0.19 else "falls short",
        quantity="area.total.corrected",
        of="bem",
        against=against,
        norm="relative",
        low=-0.2,
        high=0.2,
        because="it must",
        source="",
        kind=kind,
        subject="boundary elements",
        half_width=0.01,
        **estimates,
    )


def case_with(name, family, *gates):
    """Return a `CaseVerdict` of a family with these gates; without gates it is
    skipped.
    """
    statuses = {gate.status for gate in gates}
    status = max(statuses, key=len, default="skipped")
    case = case_of(0)
    changes = {"id": name, "family": family, "gates": [*gates], "status": status}
    return case.model_copy(update=changes)


def verdict_on_areas():
    """Return a verdict on areas that differ from references by known amounts.

    From the theory: 4 %, -6 % and 30 % (which falls short); from a closed form: 1 %.
    """
    theory = ("persson", "method here")
    return Verdict.on(
        [
            case_with("a", "one", area_gate(0.104, 0.1, *theory)),
            case_with("b", "one", area_gate(0.188, 0.2, *theory)),
            case_with("c", "two", area_gate(0.13, 0.1, *theory)),
            case_with("d", "three", area_gate(0.505, 0.5, "hertz", "closed form")),
            case_with("e", "three"),
        ],
        "fast",
    )


def test_a_verdict_says_first_whether_it_holds_how_right_it_is_and_where_to_look():
    """The overview of areas that differ by known amounts has these amounts.

    The margins are 0.2 over |difference| + 0.01.
    """
    seen = overview(verdict_on_areas())
    assert seen["headline"] == (
        "3 of 4 comparisons hold in 4 cases; 1 case falls short; 1 case is skipped"
    )
    assert seen["evidence"] == (
        "compared: results with closed forms (1), numerical methods with the theory (3)"
    )
    tight = [(row["case"], row["margin"]) for row in seen["tightest"]]
    assert tight == [("c", "0.645"), ("b", "2.86"), ("a", "4"), ("d", "10")]
    rows = {row.pair: row for row in seen["agreement"]}
    theory = rows["theory – boundary elements"]
    assert [theory.gates, theory.case] == [3, "c"]
    assert [theory.median, theory.largest] == pytest.approx([0.06, 0.3])
    assert rows["boundary elements – closed forms"].median == pytest.approx(0.01)
    assert [point.case for point in seen["points"]] == ["a", "b", "c", "d"]
    point = seen["points"][1]
    ends = [point.error, point.low, point.high]
    assert ends == pytest.approx([0.002, 0.16, 0.24])
    order = [row["id"] for rows in seen["subjects"].values() for row in rows]
    assert order == ["c", "b", "a", "d", "e"]
    assert "1 case was skipped" in seen["uncovered_sentence"]


def test_known_differences_are_set_apart_from_those_that_should_be_zero():
    """Of three gates, two expect a difference of 20 to 40 %: one on the theory, and one
    on J2 elements beside boundary elements at 3 σ_Y.

    Both are marked.  That on the theory has a colour of its own and is not counted as a
    disagreement.  That on J2 elements stays with the others of its pair, which is the
    first one.
    """
    theory = ("persson", "method here")
    gate = area_gate(0.13, 0.1, *theory).model_copy(update={"low": 0.2, "high": 0.4})
    beside_cap = "J2 elements – boundary elements, 3 σ_Y"
    of_elements = {"of": "fem", "against": "bem", "subject": beside_cap}
    cases = [
        case_with("a", "one", area_gate(0.104, 0.1, *theory)),
        case_with("c", "two", gate),
        case_with("j", "three", gate.model_copy(update=of_elements)),
    ]
    seen = overview(Verdict.on(cases, "fast"))
    rows = [(row.pair, row.quantity, row.case) for row in seen["agreement"]]
    pair = "theory – boundary elements"
    assert rows == [
        (beside_cap, "total area", "j"),
        (pair, "total area", "a"),
        ("known differences", pair, "c"),
    ]
    assert seen["evidence"] == (
        "compared: J2 elements with boundary elements (1), "
        "numerical methods with the theory (2)"
    )
    words = {row["case"]: row["words"] for row in seen["tightest"]}
    assert [case for case in words if "known difference" in words[case]] == ["c", "j"]
    pairs = [point.pair for point in seen["points"]]
    assert pairs == [beside_cap, pair, "known difference"]


def test_the_page_shows_the_cases_in_the_order_of_its_list(tmp_path):
    """Cases come by what they verify, the tightest first, and not by their names."""
    shown = verdict_on_areas()
    seen = overview(shown)
    write_report(tmp_path / "x.html", shown.content, {}, overview=seen)
    page = tree_of(tmp_path / "x.html")
    sections = [section.get("id") for section in page.iter("section")]
    assert [name for name in sections if name] == ["c", "b", "a", "d", "e"]


def test_the_bar_of_a_gate_shows_where_its_difference_is_in_the_band():
    """A difference of 1 ± 1 % in a band of ± 20 % is at 52.5 % of the band's width."""
    first = overview(verdict_on_areas())["tightest"]
    (bar,) = [row["bar"] for row in first if row["case"] == "d"]
    width = bar["high"] - bar["low"]
    places = [(bar[k] - bar["low"]) / width for k in ("left", "middle", "right")]
    assert places == pytest.approx([0.5, 0.525, 0.55])


def test_the_picture_of_areas_has_each_at_its_place():
    """On one decade of 300 units, 0.1 is at 0, and a value that is too small is below
    the diagonal.
    """
    points = overview(verdict_on_areas())["points"]
    picture = report._parity(points)
    marks = {mark["point"].case: mark for mark in picture["marks"]}
    decades = len(picture["ticks"]) - 1
    assert decades == 1
    assert marks["a"]["x"] == pytest.approx(0.0)
    assert marks["b"]["x"] == pytest.approx(300 * (1 + math.log10(0.2)))
    assert marks["b"]["y"] > 300 - marks["b"]["x"]
    assert marks["c"]["colour"] != marks["d"]["colour"]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("area.total.corrected", "total area"),
        ("area.plastic.raw", "plastic area (raw)"),
        ("quantity.conductance.raw", "conductance, raw"),
        ("field.pressure", "pressure field"),
        ("distribution", "pressure distribution"),
        ("residual.gap", "residual: gap"),
        ("mean_pressure", "mean pressure"),
    ],
)
def test_quantities_have_names_in_words(name, words):
    """`quantity_words` turns the name of a quantity in gates into words."""
    assert quantity_words(name) == words


def test_the_page_shows_the_numbers_of_each_gate_with_their_intervals(tmp_path):
    """Each gate's row shows value, reference and difference with their half-widths, the
    band and the status.

    The half-width of the difference includes the error that the grid is estimated to
    cause.
    """
    shown = verdict()
    write_report(tmp_path / "x.html", shown.content, {})
    _, _, cells = page_of(tmp_path / "x.html")
    texts = {(about["quantity"], about["field"]): text for about, text in cells}
    judged = [gate for case in shown.cases for gate in case.gates if not gate.error]
    assert len(judged) == 5
    for gate in judged:
        expected = {
            "value": f"{gate.value.mean:.4g} ± {gate.value.half_width:.2g}",
            "reference": f"{gate.reference.mean:.4g} ± {gate.reference.half_width:.2g}",
            "difference": f"{gate.difference.mean:.3g} ± {gate.half_width:.2g}",
            "band": f"[{gate.low:.4g}, {gate.high:.4g}]",
            "status": gate.status,
        }
        for field, text in expected.items():
            assert texts[gate.quantity, field] == text


def test_nothing_a_case_says_becomes_html(tmp_path):
    """Every text that a case or a result supplies is escaped: the hostile markup
    appears as text in all 16 places.
    """
    content = verdict().content
    case = content["cases"][0]
    case["requirement"] = HOSTILE
    case["methods"]["bem"]["errors"] = [HOSTILE]
    for key in ("because", "subject", "kind", "name"):
        case["gates"][0][key] = HOSTILE
    case["gates"][0]["value"] = {"mean": "inf", "half_width_95": "nan", "surfaces": 1}
    result = result_of_seed(1).to_json()
    first = result | {"notes": [HOSTILE]}
    ensemble = {"surfaces": ["seed7", "seed8"]}
    saved = result | {"ensemble": ensemble, "members": [first, result]}
    picture = {"uri": "data:image/webp;base64,UklGRg==", "caption": HOSTILE}
    picture["case"] = "case-0"
    write_report(
        tmp_path / "x.html",
        content,
        results={"case-0": {"bem": saved}},
        pictures={"case-0": [picture]},
        notes=[HOSTILE],
        overview=overview(Verdict.model_validate(content)),
    )
    text, captions, cells = page_of(tmp_path / "x.html")
    assert text.count(HOSTILE) == 16
    assert captions == {HOSTILE}
    for words in ("0123abcd", "256 MiB", "fft pairs 90", "such thing"):
        assert words in text
    assert f"cores {verdict().made.cores}" in text
    gates = [(about, text) for about, text in cells if about["field"] == "value"]
    values = [text for about, text in gates if about["case"] == "case-0"]
    assert values[0] == "inf"
