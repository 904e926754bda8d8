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
import xml.etree.ElementTree as ET
from collections import defaultdict
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import pyvista as pv
from as_read import lasting, lines_of_chart, lines_of_file, lines_of_page, same_as_read
from command_line import invoke
from conftest import SMALL_CASE

from epcontact.bem import driver
from epcontact.harness.case_files.case import load_case
from epcontact.harness.gates import Estimate, GateVerdict
from epcontact.harness.quantities.registry import QUANTITIES, scalar_quantities
from epcontact.harness.verdict.evidence import KINDS as REFERENCES
from epcontact.harness.verdict.evidence import SUBJECTS
from epcontact.harness.verdict.judgement import CaseVerdict, MethodEntry, Verdict
from epcontact.harness.verdict.overview import overview
from epcontact.output import drawing, report
from epcontact.output.charts import maps
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.style import STATE_NAMES
from epcontact.output.report import write_report
from epcontact.output.view import load_steps
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

PARTS, KINDS = ("total", "elastic", "plastic"), ("raw", "corrected", "error")
#: What makes the small case one of an oblong rubber block that is unloaded, for two
#: methods.
CHANGES = {
    '"small"': '"shown"',
    '"persson", "bem"': '"bem", "fem"',
    "[3, 5, 7]": "[5]",
    "period = 1.0e-3": "period = [1.0e-3, 1.25e-3]\nshape = [16, 24]",
    "wavenumber_high = 5.026548245743669e4\nrms_slope = 0.1": "wavenumber_high = 2.0e4\nrms_slope = 0.02",
    "points_per_shortest_wavelength = { fast = 4, full = 8 }\n": "",
    "young_modulus = 100.0e9": "young_modulus = 2.1e6",
    "hardness = 6.0e9": "hardness = 15.0e3",
    "poisson_ratio = 0.3": "poisson_ratio = 0.4",
    "[theory]\nenergy_reduction = 0.536": '[fem]\nlaw = "capped"\nlayers = 2',
    "mean_pressure = 5.0e8": "mean_pressure = [2.0e3, 5.0e3, 3.0e3]",
    "area.total.corrected": "area.total.raw",
    'of = "bem"\nagainst = "persson"': 'of = "fem"\nagainst = "bem"',
}
MODULUS, CAP = 2.1e6 / (1 - 0.4**2), 15.0e3
SWEEP = """
[sweep]
load.mean_pressure = [2.0e3, 4.0e3]
quantities = ["quantity.total_patches_largest"]
"""


@pytest.fixture(scope="session")
def ran(tmp_path_factory):
    """Where commands leave the scene, what they said, the charts, and the calls of each
    view.
    """
    home, charts, views = tmp_path_factory.mktemp("shown"), {}, []
    text = SMALL_CASE
    for old, new in CHANGES.items():
        assert old in text, old
        text = text.replace(old, new)
    (home / "shown.toml").write_text(text)
    (home / "swept.toml").write_text(text.replace('"shown"', '"swept"') + SWEEP)
    save, plotter = Chart.save, drawing._plotter

    def watched(size):
        made, calls = plotter(size), []
        views.append(calls)
        for name in ("add_mesh", "add_text", "add_legend", "show_bounds"):
            draw = getattr(made, name)
            setattr(made, name, recording(calls, name, draw))
        return made

    with pytest.MonkeyPatch.context() as patch:
        named = lambda at: "swept " * ("swept" in at.parts) + at.name  # noqa: E731
        patch.setattr(
            Chart, "save", lambda c, at: (charts.update({named(at): c}), save(c, at))[1]
        )
        patch.setattr(drawing, "_plotter", watched)
        out, folder = ("--jobs", 1, "--output", home), home / "shown" / "fast"
        steps = folder / "bem-seed5-steps"
        precise = ("--fields", "steps", "--precision", "double")
        commands = (
            ("verify", home / "shown.toml", *precise, "--report", "--gates", *out),
            ("run", home / "shown.toml", "--fields", "film", *precise[2:], *out),
            ("sweep", home / "swept.toml", *out, "--fields", "first", "--charts"),
            ("report", home),
            ("view", steps / "step-0001.vti", "--screenshot", home / "x.png"),
            ("view", steps / "path.pvd", "--map", home / "against"),
            (
                "view",
                folder / "bem.json",
                "--against",
                folder / "fem-seed5.vti",
                "--screenshot",
                home / "x.png",
            ),
        )
        said = [(name, invoke(name, *rest)) for name, *rest in commands]
    assert [done.returncode for _, done in said][:4] == [0, 0, 0, 0], said
    return SimpleNamespace(
        folder=folder, home=home, charts=charts, views=views, said=said
    )


def recording(calls, name, draw):
    """Return `draw` as a function that notes its name and arguments in `calls`."""

    def record(*arguments, **options):
        calls.append((name, arguments, options))
        return draw(*arguments, **options)

    return record


def shown(ran, method):
    (member,) = json.loads((ran.folder / f"{method}.json").read_text())["members"]
    return read_fields(ran.folder / f"{method}-seed5.vti"), ContactResult.from_json(
        member
    )


#: What `pressed` computes again.
FIGURES = {
    "area.total.raw",
    "area.plastic.raw",
    "area.elastic.raw",
    "mean_pressure",
    "cost.unknowns",
    "quantity.mean_gap",
    "quantity.mean_separation",
    "quantity.mean_plastic_displacement",
    "quantity.plastic_work",
    "quantity.elastic_energy",
    "quantity.largest_pressure",
    "quantity.hardness",
    "quantity.flowed_share",
}


def pressed(ran, heights, steps):
    """The figures of each load by numpy alone, from its pressures and the surface."""
    waves = (
        2 * np.pi * np.fft.fftfreq(n, d) for n, d in zip(*steps[0][:2], strict=True)
    )
    q = np.hypot(*np.ix_(*waves))
    q[0, 0], found, sunk, flowed = np.inf, [], np.zeros_like(heights), False
    for _, _, pressure in steps:
        moved = np.fft.ifft2(2 / (MODULUS * q) * np.fft.fft2(pressure)).real
        touching, flowing = pressure > 0, pressure >= CAP * (1 - 1e-12)
        flowed = flowed | flowing
        gap = moved - heights + sunk
        gap -= gap[touching & ~flowing].mean()
        sunk = sunk + np.where(flowing, np.maximum(-gap, 0), 0)
        gap = moved - heights + sunk
        gap -= gap[touching].mean()
        found.append(
            {
                "area.total.raw": touching.mean(),
                "area.plastic.raw": flowing.mean(),
                "area.elastic.raw": (touching & ~flowing).mean(),
                "mean_pressure": pressure.mean(),
                "quantity.mean_gap": np.maximum(gap, 0).mean(),
                "quantity.mean_separation": (gap - sunk).mean(),
                "quantity.mean_plastic_displacement": sunk.mean(),
                "quantity.plastic_work": CAP * sunk.mean(),
                "quantity.elastic_energy": (pressure * moved).mean() / 2,
                "quantity.largest_pressure": pressure.max(),
                "cost.unknowns": pressure.size,
                "quantity.hardness": CAP,
                "quantity.flowed_share": flowed.mean(),
            }
        )
    return found, gap - sunk, moved


def test_the_scene_is_shown_as_it_was_read(ran, tmp_path):
    """What the commands print, the page, the charts, the views and the files of
    results.
    """
    said = [
        f"{name}: {line}"
        for name, done in ran.said
        for line in done.stdout.replace(str(ran.home), "HOME").splitlines()
    ]
    drawn = [line for line in said if line.startswith("view") or " film in " in line]
    lines = [line for line in said if line not in drawn]
    _, pictures, cells = page_of(page := ran.home / "report.html")
    assert pictures == {path.read_text().strip() for path in ran.folder.glob("*.txt")}
    about = shown(ran, "bem")[1].provenance.about
    values = {
        cell["quantity"]: json.loads(cell["value"])
        for cell, _ in cells
        if "value" in cell
    }
    assert values == {name: entry["value"] for name, entry in about.items()}
    places = [[*cell.values()] for cell, _ in cells if "field" in cell]
    (case,) = json.loads((ran.home / "verdict.json").read_text())["cases"]
    fields = ("status", "value", "reference", "difference", "band")
    assert places == [
        [field, "shown", g["quantity"], g["of"], report.number_text(g["against"])]
        for g in case["gates"]
        for field in fields
    ]
    lines += lines_of_page(tree_of(page))
    lines += (
        line
        for name, chart in ran.charts.items()
        for line in lines_of_chart(name, chart)
    )
    files = (
        "shown/fast/*m.json",
        "verdict.json",
        "swept/fast/sweep.*",
        "shown/fast/*.vti",
        "shown/fast/*-steps/step-0001.vti",
    )
    lines += (
        line
        for names in files
        for path in sorted(ran.home.glob(names))
        for line in lines_of_file(path)
    )
    same_as_read(lasting(lines), "shown.txt", tmp_path)
    if len(ran.views) > 8:
        plain = (str, bool, int, float, list, tuple, dict)
        calls = [(n, *call) for n, calls in enumerate(ran.views) for call in calls]
        lines = (
            f"{n} {name} {key}: {[*each] if isinstance(each, tuple) else each}"
            for n, name, a, k in calls
            for key, each in (*enumerate(a), *k.items())
            if isinstance(each, plain)
        )
        same_as_read([*drawn, *lines], "viewed.txt", tmp_path)


def loads_of(ran, method):
    path = ran.folder / f"{method}-seed5-steps" / "path.pvd"
    files = [read_fields(step) for step in load_steps(path)]
    return [
        (file.shape, file.spacing, file.fields["pressure"]) for file in files
    ], files


def test_every_figure_of_an_answer_follows_from_the_pressures(ran):
    """At each load of a path that unloads, of the fields, and of the file of the last
    load.
    """
    (file, answer), (steps, files) = shown(ran, "bem"), loads_of(ran, "bem")
    case = load_case(ran.home / "shown.toml")
    heights = case.scene(case.recipes[0]).surface.heights
    found, gap, moved = pressed(ran, heights, steps)
    assert [round(each["mean_pressure"], 6) for each in found] == [2e3, 5e3, 3e3]
    for step, expected, one in zip(answer.steps, found, files, strict=True):
        told = scalar_quantities(replace(answer, steps=(step,)))
        assert expected.keys() == FIGURES
        for name, value in expected.items():
            assert told[name] == pytest.approx(value, rel=1e-6, abs=1e-15), name
        raw, limit, claim = (step.areas[kind].total for kind in KINDS)
        steep = [
            np.square(np.diff(heights, axis=k) / file.spacing[k]).mean() for k in (0, 1)
        ]
        off = driver._GAP_ERROR * np.sqrt(sum(steep))
        off *= (abs(raw - limit) + claim) / raw * max(file.spacing)
        assert told["quantity.mean_gap_error_by_grid"] == pytest.approx(off, rel=1e-6)
        for name in ("area.total.raw", "mean_pressure", "quantity.mean_gap"):
            assert one.attributes[name] == told[name]
    assert file.fields["heights"] == pytest.approx(heights, abs=1e-18)
    assert file.fields["gap"] == pytest.approx(gap, abs=1e-7 * np.ptp(heights))
    assert file.fields["displacement"] == pytest.approx(
        moved, abs=1e-7 * np.ptp(heights)
    )
    pvd = ET.parse(ran.folder / "bem-seed5-steps" / "path.pvd").iter("DataSet")
    rows = [(e.get("timestep"), e.get("name"), e.get("file")) for e in pvd]
    assert rows == [
        (f"{k}", f"mean pressure {p!r} Pa", f"step-000{k}.vti")
        for k, p in enumerate((2000.0, 5000.0, 3000.0))
    ]


@pytest.mark.parametrize("method", ["bem", "fem"])
def test_a_field_file_is_that_of_the_last_load(ran, method):
    file, answer = shown(ran, method)
    case = load_case(ran.home / "shown.toml")
    first, *_, last = answer.steps
    assert first.areas["raw"] != last.areas["raw"]
    assert (file.shape, file.periods) == (
        (16, 24),
        pytest.approx((1.0e-3, 1.25e-3), rel=1e-14),
    )
    assert np.array_equal(
        file.fields["heights"], case.scene(case.recipes[0]).surface.heights
    )
    pressure, state = file.fields["pressure"], file.fields["state"]
    assert pressure.mean() == pytest.approx(3e3, rel=1e-7)
    assert pressure.max() <= CAP * (1 + 1e-12)
    assert np.array_equal(state != APART, pressure > 0)
    figures = {f"quantity.{name}": value for name, value in last.quantities.items()}
    assert (figures | {"mean_pressure": 3e3}).items() <= file.attributes.items()
    shares, raw = (
        [np.mean(state == kind) for kind in (ELASTIC, PLASTIC)],
        last.areas["raw"],
    )
    assert shares == pytest.approx([raw.elastic, raw.plastic], abs=1e-12)


def tree_of(path):
    text = path.read_text("utf-8").partition("\n")[2]
    return ET.fromstring(re.sub(r"<((?:meta|link|img)\b[^>]*)>", r"<\1/>", text))


def page_of(path):
    """The text, pictures and cells with data of a balanced, self-contained page without
    scripts.
    """
    page = tree_of(path)
    ids = [each.get("id") for each in page.iter()]
    for each in page.iter():
        references = [
            each.get(name, "data:") for name in ("src", "href", "srcset", "action")
        ]
        assert all(r.startswith("data:") or r[1:] in ids for r in references), (
            references
        )
    for picture in page.iter("img"):
        kind, _, content = picture.attrib["src"].partition(";base64,")
        assert base64.b64decode(content, validate=True)
        assert kind in ("data:image/svg+xml", "data:image/png", "data:image/gif")
    assert not [*page.iter("script")]
    data = [
        ({k[5:]: v for k, v in c.items() if k[:5] == "data-"}, c)
        for c in page.iter("td")
    ]
    cells = [(about, "".join(cell.itertext())) for about, cell in data if about]
    return (
        "".join(page.itertext()),
        {image.get("alt") for image in page.iter("img")},
        cells,
    )


def test_a_chart_shows_the_fields_and_the_figures(ran):
    """Arrays, limits, extents and rows, in kPa and mm."""
    (bem, answer), (fem, other) = shown(ran, "bem"), shown(ran, "fem")
    extent = [
        -0.5 / 16,
        16.5 / 16,
        -0.625 / 24,
        24.5 / 24 * 1.25,
    ]  # of which a period is shown
    p, q = (1e-3 * file.fields["pressure"] for file in (bem, fem))
    low = max(p.max(), q.max())
    for name, images in {
        "contact-bem": [(bem.fields["state"], 0, 2), (p, 0, 15)],
        "contact-fem": [(fem.fields["state"], 0, 2), (q, 0, 15)],
        "pressure-difference-bem-fem": [
            (p, 0, low),
            (q, 0, low),
            (p - q, -abs(p - q).max(), abs(p - q).max()),
        ],
    }.items():
        axes = [each for each in ran.charts[name].figure.axes if each.images]
        for (field, *limits), each in zip(images, axes, strict=True):
            (image,) = each.images
            assert np.ma.filled(image.get_array(), 0.0) == pytest.approx(
                np.pad(field, (0, 1), mode="wrap").T, rel=1e-6, abs=1e-9
            )
            assert each.axis() == pytest.approx((0, 1, 0, 1.25))
            assert (image.origin, [*image.get_clim()]) == (
                "lower",
                pytest.approx(limits, rel=1e-6),
            )
            assert image.get_extent() == pytest.approx(extent, rel=1e-9)
    rows = dict(ran.charts["pressure-difference-bem-fem"].rows)
    assert rows == pytest.approx(
        {
            "largest_pressure_Pa": 1e3 * low,
            "largest_difference_Pa": 1e3 * abs(p - q).max(),
            "rms_difference_Pa": 1e3 * np.sqrt(((p - q) ** 2).mean()),
            "mean_pressure_first_Pa": 1e3 * p.mean(),
            "mean_pressure_second_Pa": 1e3 * q.mean(),
        }
    )
    for name, file in (("bem", bem), ("fem", fem)):
        shares = {
            w: np.mean(file.fields["state"] == kind) for kind, w in STATE_NAMES.items()
        }
        rows = dict(ran.charts[f"contact-{name}"].rows)
        assert rows == pytest.approx(shares | {"mean_pressure_Pa": 3e3})
    (axes,) = ran.charts["pressure-distribution"].figure.axes
    lines = {line.get_label(): line.get_xydata() for line in axes.lines}
    for name, file in {"bem": p, "fem": q}.items():
        width = np.diff(lines[name][:, 0])[0]
        ends = lines[name][:, 0, None] + width * np.array([-0.5, 0.5])
        counted = [np.mean((file > low) & (file <= high)) for low, high in ends]
        # A table between two of its pressures is linear, so that a point may be in the
        # next one.
        assert np.cumsum(lines[name][:, 1] * width) == pytest.approx(
            np.cumsum(counted), abs=0.015
        )
    places = sorted(
        line.get_xdata()[0] for line in axes.lines if len(line.get_xdata()) == 2
    )
    assert places == [3.0, 15.0]
    (axes,) = ran.charts["residuals"].figure.axes
    lines = {line.get_label(): line.get_ydata() for line in axes.lines}
    for name, one in (("bem", answer), ("fem", other)):
        positive = [value for value in one.history if value > 0]
        assert lines[name].tolist() == pytest.approx(positive, rel=1e-12)
    (axes,) = ran.charts["power-spectrum"].figure.axes
    power = {line.get_label(): line.get_xydata() for line in axes.lines}["analytic"]
    flat, falling = power[power[:, 0] < 12566][:, 1], power[power[:, 0] > 12567]
    assert flat == pytest.approx(flat[0], rel=1e-12)
    slope = np.polyfit(*np.log(falling).T, 1)[0]
    assert slope == pytest.approx(-2 * (1 + 0.8), rel=1e-9)
    assert falling[-1, 0] == pytest.approx(2.0e4)
    about = answer.provenance.about
    assert bem.fields["heights"].std() == pytest.approx(
        about["rms_height"]["value"], rel=1e-6
    )


def test_a_view_shows_the_fields(ran):
    """What VTK is asked to draw: pressures and shares of the surface, stresses of the
    body.
    """
    if len(ran.views) < 9:
        pytest.skip("nothing can be drawn in three dimensions here")
    file = read_fields(
        ran.folder / "bem-seed5-steps" / "step-0001.vti"
    )  # where most flows
    calls = ran.views[8]
    meshes = [
        (a[0], k) for name, a, k in calls if name == "add_mesh" and "scalars" in k
    ]
    (state, look), (pressure, other) = meshes
    assert (look["scalars"], look["clim"], other["clim"]) == (
        "state",
        (-0.5, 2.5),
        (0.0, 15.0),
    )
    x, y, z = (np.reshape(c, (17, 25), order="F") for c in state.points.T)
    assert (x[-1, 0], y[0, -1]) == pytest.approx(
        (1.0, 1.25), rel=1e-6
    )  # mm, a whole period
    gap = np.pad(np.maximum(file.field("gap"), 0), (0, 1), mode="wrap")
    assert z == pytest.approx(-20e3 * gap, abs=1e-6)
    p = np.pad(file.field("pressure"), (0, 1), mode="wrap")
    drawn = np.nan_to_num(np.reshape(pressure["pressure"], (17, 25), order="F"))
    assert drawn == pytest.approx(1e-3 * p, rel=1e-6)
    body = next(ran.folder.glob("fem-seed5-steps/*0002.vtu"))
    mesh, block = pv.read(body), ran.views[0]
    stress, _ = (k for name, _, k in block if name == "add_mesh")
    mises = mesh.get_array("von_mises", preference="point")
    assert stress["clim"] == pytest.approx((0, 1e-3 * mises.max()), rel=1e-6)
    assert stress["scalars"].max() <= 1e-3 * mises.max() * (1 + 1e-6)
    assert mesh.bounds[1] == pytest.approx(1e-3)
    assert mesh.bounds[3] == pytest.approx(1.25e-3)
    top = drawing.read_block(body.with_stem(f"{body.stem}-surface"))
    largest = [np.max(top.point_data[name]) for name in ("contact_pressure", "gap")]
    assert drawing.block_scale(top)[1] == pytest.approx(largest)


def test_a_profile_is_that_of_the_fields():
    pressure = np.array([0.0, 3e3, 5e3, 0.0, 0.0, 1e3])
    two = dict(maps.pressure_difference(np.eye(2), np.ones((2, 2)), (1.0, 1.0)).rows)
    assert (two["mean_pressure_first_Pa"], two["mean_pressure_second_Pa"]) == (0.5, 1.0)
    state, gap = (
        np.array([0, 1, 2, 0, 0, 1]),
        np.array([4e-6, 0.0, -1e-6, 2e-6, 1e-6, 0.0]),
    )
    chart = maps.contact_profile(state, pressure, gap, (2e-3,))
    columns = [list(column) for column in zip(*chart.rows, strict=True)]
    assert chart.header == ("x_m", "state", "pressure_Pa", "gap_m")
    assert columns == [
        pytest.approx(2e-3 * np.arange(6)),
        [*state],
        [*pressure],
        [*gap],
    ]
    left, right = chart.figure.axes
    labels = [
        (axes.get_xlabel(), axes.get_ylabel(), axes.get_title())
        for axes in (left, right)
    ]
    assert labels == [
        ("x (mm)", "height below the flat (µm)", "profile in contact"),
        ("x (mm)", "pressure (kPa)", "contact pressure, mean 1.5 kPa"),
    ]
    body, *contact = (each.get_paths()[0].vertices for each in left.collections)
    assert body[:, 1].max() == 0
    assert {*np.round(body[:, 1], 9)} >= {0.0, -1.0, -2.0, -4.0}
    assert [part[:, 1].max() > 0 for part in contact] == [True, True]
    (drawn,) = right.collections
    assert drawn.get_paths()[0].vertices[:, 1].max() == 5.0


# --- made-up numbers, no two alike
# ----------------------------------------------------------------

STATUSES = ("holds", "falls short", "error")
HOSTILE = '</td><script src="http://evil.example/x.js">alert(1)</script> & "quoted"'


def gate(number, status):
    judged: dict[str, Any] = (
        {"error": "no such thing"}
        if status == "error"
        else {
            name: Estimate(
                mean=(0.1 + 0.137 * i) * 1.9**number,
                half_width_95=(0.011 + 0.0023 * i) * 1.9**number,
                surfaces=8,
            )
            for i, name in enumerate(("value", "reference", "difference"))
        }
    )
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
        grid_error=(None, 0.043 * 1.9**number)[number % 2],
        half_width=0.029 * 1.9**number,
        kind=("identity", "closed form")[number % 2],
        subject=("theory", "inputs")[number // 6],
        **judged,
    )


def verdict():
    """One case for each status, with gates of every status in the worst of them."""
    methods = {"bem": MethodEntry(surfaces=2, reused=0, errors=[])}
    said: dict[str, Any] = {
        "requirement": "It holds.",
        "source": "here",
        "skipped_because": "",
    }
    said |= {"size": "fast", "methods": methods}
    gates = [[gate(3 * i + k, STATUSES[k]) for k in range(i + 1)] for i in range(3)]
    cases = [
        CaseVerdict(id=f"case-{i}", status=STATUSES[i], gates=gates[i], **said)
        for i in range(3)
    ]
    return Verdict.on(cases, "fast")


def result(number):
    size = lambda i, k: (0.3 - 0.047 * i) / (1 + 0.37 * k) / 1.13**number  # noqa: E731
    areas = {
        kind: Areas(*(size(i, k) for k in range(3))) for i, kind in enumerate(KINDS)
    }
    cost = {
        "seconds": 1.0,
        "unknowns": 4096.0,
        "peak_memory_bytes": 2.0**28,
        "fft_pairs": 90.0,
    }
    made = Provenance("0123abcd", number)
    step = LoadStep(1.25e10, areas, {"gap": 2e-9}, {}, {"mean_gap": 3e-9})
    return ContactResult("bem", (step,), made, cost=cost)


def answers():
    data = result(1).to_json()
    return {
        "bem": {
            **data,
            "ensemble": {"surfaces": ["seed7", "seed8"]},
            "members": [data, data],
        }
    }


def test_a_result_describes_itself_with_its_area_and_its_table_of_loads():
    described = "1 load, contact area 0.253 ± 0.21 at 1.25e+10 Pa"
    assert repr(result(0)) == f"<ContactResult of bem: {described}>"
    table = ET.fromstring(result(0)._repr_html_())
    cells = [cell.text for cell in table.iter("td")]
    assert {"loading", "1.25e+10", "0.253", "3e-09"} <= {*cells}


def test_a_long_path_and_missing_numbers_in_words():
    path = [1e3 * n for n in range(1, 12)]
    assert report.value_text(path[:8], "Pa") == "1, 2, 3, 4, 5, 6, 7, 8 kPa"
    assert report.value_text(path, "Pa") == "1, 2, 3, … 7 more …, 11 kPa"
    numbers = [
        report.number_text(v) for v in (1.23456, "inf", math.nan, None, "words", 0)
    ]
    assert numbers == ["1.235", "inf", "–", "", "words", "0"]


def test_the_page_opens_with_a_matrix_and_ends_it_with_what_is_not_covered(tmp_path):
    told, found = verdict().content, defaultdict(list)
    told["cases"][0]["gates"][0]["quantity"] = "area.total.raw"
    write_report(
        tmp_path / "x.html", told, {}, overview=overview(Verdict.model_validate(told))
    )
    page = tree_of(tmp_path / "x.html")
    by_id = {each.get("id"): each for each in page.iter()}
    for case in verdict().cases:
        for g in case.gates:
            found[g.subject, g.kind].append(
                (-1 if np.isnan(g.margin) else g.margin, case.id)
            )
    cells = {
        (td.get("data-subject"), td.get("data-kind")): td for td in page.iter("td")
    }
    assert (
        {*cells} - {(None, None)}
        == {*itertools.product(SUBJECTS, REFERENCES)}
        > {*found}
    )
    for place, judged in found.items():
        link, number = cells[place]
        worst, _ = min(judged)
        assert link.text == ("–" if worst < 0 else f"{worst:.3g}")
        assert number.text == f"{len(judged)}"
        cases = {a.get("href")[1:] for a in by_id[link.get("href")[1:]].iter("a")}
        assert cases == {name for _, name in judged}
    uncovered = [name for tr in page.iter("tr") if (name := tr.get("data-uncovered"))]
    assert uncovered == [name for name in QUANTITIES if name != "area.total.raw"]


def test_the_page_shows_the_numbers_of_each_gate_with_their_intervals(tmp_path):
    """The interval of a difference holds what the results claim of their grids."""
    shown = verdict()
    write_report(tmp_path / "x.html", shown.content, {})
    cells = page_of(tmp_path / "x.html")[2]
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
    told, found = verdict().content, {"case-0": answers()}
    first = told["cases"][0]
    first["requirement"] = first["gates"][0]["because"] = HOSTILE
    first["gates"][0]["value"] = {"mean": "inf", "half_width_95": "nan", "surfaces": 1}
    first["methods"]["bem"]["errors"] = [HOSTILE]
    found["case-0"]["bem"]["members"][0]["notes"] = [HOSTILE]
    picture = {"uri": "data:image/png;base64,iVBORw0KGgo=", "caption": HOSTILE}
    first["gates"][0]["subject"] = first["gates"][0]["kind"] = first["gates"][0][
        "name"
    ] = HOSTILE
    seen = overview(Verdict.model_validate(told))
    write_report(
        tmp_path / "x.html", told, found, {"case-0": [picture]}, [HOSTILE], seen
    )
    text, pictures, data = page_of(tmp_path / "x.html")
    assert (text.count(HOSTILE), pictures) == (14, {HOSTILE})
    cores = f"cores {verdict().made.cores}"
    assert all(
        w in text for w in ("0123abcd", "256 MiB", "fft pairs 90", "such thing", cores)
    )
    assert next(text for about, text in data if about.get("field") == "value") == "inf"
