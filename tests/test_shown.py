"""What a person reads is what was computed: page, tables, pictures and field files, cell by cell.

One scene is run once, on an oblong grid, along a path that unloads, by two methods.  Where
exchanged columns must show, the numbers are made up, no two alike.
"""

from __future__ import annotations

import base64
import csv
import io
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Done, invoke
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image
from rich.console import Console

from epcontact.cli.tables import answers_table, verdict_table
from epcontact.errors import OutputError
from epcontact.harness.answers.pictures import theory_densities
from epcontact.harness.answers.store import Answer
from epcontact.harness.case_files.case import load_case
from epcontact.harness.gates.gate import GateVerdict
from epcontact.harness.gates.statistics import Estimate
from epcontact.harness.verdict.record import CaseVerdict, MethodEntry, Verdict
from epcontact.output.charts.curves import pressure_distribution
from epcontact.output.charts.maps import contact_map
from epcontact.output.charts.style import STATE_NAMES
from epcontact.output.report import Picture, report_folder, write_report
from epcontact.output.vtk import FieldFile, read_fields
from epcontact.results import (
    APART,
    ELASTIC,
    PLASTIC,
    Areas,
    ContactResult,
    LoadStep,
    PressureDistribution,
    Provenance,
)

PARTS = ("total", "elastic", "plastic")

# --- one scene, run once --------------------------------------------------------------------------

SCENE = """
[case]
id = "shown"
requirement = "Both methods answer a capped layer on its way down."
source = "made for the tests"
methods = ["bem", "fem"]
[surface]
kind = "self_affine"
period = [1.0e-3, 1.25e-3]
shape = [16, 20]
hurst = 0.8
wavenumber_low = 6.283185307179587e3
wavenumber_roll_off = 6.283185307179587e3
wavenumber_high = 2.0e4
rms_slope = 0.02
seeds = [5]
[material]
young_modulus = 210.0e9
poisson_ratio = 0.3
hardness = 1.5e9
[body]
kind = "bonded_layer"
depth = 1.0e-3
[fem]
law = "capped"
layers = 2
[load]
mean_pressure = [2.0e8, 5.0e8, 3.0e8]
[[gate]]
quantity = "area.total.raw"
of = "fem"
against = "bem"
tolerance = 0.5
because = "only a smoke test"
"""


class Ran:
    """The scene as `epcontact verify` leaves it."""

    def __init__(self, folder: Path) -> None:
        self.home, self.case = folder / "out", folder / "shown.toml"
        self.case.write_text(SCENE)
        options = ("--fields", "first", "--precision", "double", "--jobs", 1)
        self.done: Done = invoke("verify", self.case, *options, "--output", self.home)
        self.here = self.home / "shown" / "fast"

    def fields(self, method: str) -> FieldFile:
        return read_fields(self.here / f"{method}-seed5.vti")

    def result(self, method: str) -> ContactResult:
        data = json.loads((self.here / f"{method}.json").read_text())
        return ContactResult.from_json(data["members"][0])

    def rows(self, chart: str) -> dict[str, float]:
        with (self.here / f"{chart}.csv").open() as file:
            return {row[0]: float(row[1]) for row in list(csv.reader(file))[1:]}


@pytest.fixture(scope="session")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    ran = Ran(tmp_path_factory.mktemp("shown"))
    assert ran.done.returncode == 0, ran.done
    return ran


@pytest.fixture(scope="session")
def reported(ran: Ran) -> Ran:
    assert invoke("report", ran.home).returncode == 0
    return ran


@pytest.mark.parametrize("method", ["bem", "fem"])
def test_a_field_file_is_that_of_the_last_load(ran: Ran, method: str) -> None:
    file, answer = ran.fields(method), ran.result(method)
    case = load_case(ran.case)
    surface = case.scene(case.recipes[0]).surface
    first, *_, last = answer.steps
    assert first.areas["raw"] != last.areas["raw"]
    assert (file.shape, file.periods) == ((16, 20), pytest.approx((1.0e-3, 1.25e-3), rel=1e-14))
    assert np.array_equal(file.fields["heights"], surface.heights)
    pressure, state = file.fields["pressure"], file.fields["state"]
    assert pressure.mean() == pytest.approx(3e8, rel=1e-7)
    assert pressure.max() <= 1.5e9 * (1 + 1e-12)
    assert np.array_equal(state != APART, pressure > 0)
    raw = last.areas["raw"]
    for kind, share in ((ELASTIC, raw.elastic), (PLASTIC, raw.plastic)):
        assert np.mean(state == kind) == pytest.approx(share, abs=1e-12)
    told = {"method": method, "case": "shown", "size": "fast", "seed": 5, "mean_pressure": 3e8,
            "hardness": 1.5e9}  # fmt: skip
    told |= {f"area.{p}.{k}": getattr(a, p) for k, a in last.areas.items() for p in PARTS}
    told |= {f"residual.{name}": value for name, value in last.residuals.items()}
    told |= {f"quantity.{n}": v for n, v in last.quantities.items() if not n.startswith("measured")}
    assert told.items() <= file.attributes.items()
    assert {file.units[name] for name in ("pressure", "hardness", "mean_pressure")} == {"Pa"}


def test_the_maps_are_those_of_the_fields(reported: Ran) -> None:
    bem, fem = reported.fields("bem"), reported.fields("fem")
    for name, file in (("bem", bem), ("fem", fem)):
        rows = reported.rows(f"contact-{name}")
        for kind, word in STATE_NAMES.items():
            assert rows[word] == np.mean(file.fields["state"] == kind)
    rows = reported.rows("pressure-difference-bem-fem")
    difference = bem.fields["pressure"] - fem.fields["pressure"]
    assert rows["largest_difference_Pa"] == np.abs(difference).max()
    assert rows["rms_difference_Pa"] == np.sqrt(np.mean(difference**2))


def test_the_distribution_and_the_residuals_are_those_of_the_answers(reported: Ran) -> None:
    with (reported.here / "pressure-distribution.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["series"] == "bem"]
    pressure, density = (
        np.array([float(r[name]) for r in rows]) for name in ("pressure_Pa", "density_per_Pa")
    )
    elastic = reported.result("bem").final.areas["raw"].elastic
    assert density.sum() * np.diff(pressure)[0] == pytest.approx(elastic, rel=0.02)
    assert (pressure * density).sum() * np.diff(pressure)[0] == pytest.approx(3e8, rel=0.05)
    with (reported.here / "residuals.csv").open() as file:
        residuals = [float(r["residual"]) for r in csv.DictReader(file) if r["series"] == "fem"]
    assert residuals == list(reported.result("fem").history)


def test_the_page_of_a_run_shows_it(reported: Ran) -> None:
    page = Page.of(reported.home / "report.html")
    assert page.heading.endswith("holds")
    cells = {(c["quantity"], c.get("field", c.get("method", ""))): text for c, text in page.cells}
    about = reported.result("bem").provenance.about
    values = {c["quantity"]: json.loads(c["value"]) for c, _ in page.cells if "value" in c}
    assert values == {name: entry["value"] for name, entry in about.items()}
    assert cells["points", ""] == "16 × 20"
    assert cells["hardness", ""] == "1.5 GPa"
    assert cells["load_path", ""] == "200, 500, 300 MPa"
    for method in ("bem", "fem"):
        share = np.mean(reported.fields(method).fields["state"] != APART)
        assert float(cells["area.total.raw", method]) == pytest.approx(share, rel=1e-3)
    captions = {path.read_text().strip() for path in reported.here.glob("*.txt")}
    assert set(page.pictures) == captions
    assert len(captions) == 5  # distribution, residuals, two maps, their difference


BROWSERS = [b for b in ("chromium", "chromium-browser", "google-chrome") if shutil.which(b)]


@pytest.mark.slow
@pytest.mark.skipif(not BROWSERS, reason="no Chromium is installed here")
def test_a_browser_has_nothing_to_complain_about(reported: Ran, tmp_path: Path) -> None:
    def log(page: Path) -> str:
        command = [BROWSERS[0], "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom",
                   "--disable-dev-shm-usage", f"--user-data-dir={tmp_path}",
                   "--window-size=390,900", "--enable-logging=stderr",
                   "--virtual-time-budget=2000"]  # fmt: skip
        done = subprocess.run(
            [*command, page.as_uri()], capture_output=True, text=True, check=False, timeout=120
        )
        assert "Verification report" in done.stdout
        return done.stderr

    page, spoilt = reported.home / "report.html", tmp_path / "spoilt.html"
    assert "CONSOLE" not in log(page)
    # The check can fail: a request to another host is refused by the page itself, and told.
    spoilt.write_text(page.read_text().replace("<h1>", '<img src="https://example.org/x.png"><h1>'))
    assert "Content Security Policy" in log(spoilt)


# --- made-up numbers, no two alike ----------------------------------------------------------------

STATUSES = ("holds", "falls short", "error")
NORMS = ("absolute", "relative", "wasserstein")


def gate(number: int, status: Any) -> GateVerdict:
    judged: dict[str, Any] = {"error": "no such thing"} if status == "error" else {
        name: Estimate(mean=(0.1 + 0.137 * i) * 1.9**number,
                       half_width_95=(0.011 + 0.0023 * i) * 1.9**number, surfaces=8)
        for i, name in enumerate(("value", "reference", "difference"))
    }  # fmt: skip
    return GateVerdict(
        name=f"gate {number}", status=status, quantity=f"quantity.q{number}", of=f"of{number}",
        against=f"against{number}", norm=NORMS[number % 3], low=-0.031 - 0.01 * number,
        high=0.047 + 0.013 * number, because="it must", source="", **judged,
    )  # fmt: skip


def verdict(requirement: str = "It holds.") -> Verdict:
    """One case for each status, with gates of every status in the worst of them."""
    cases = [
        CaseVerdict(
            id=f"case-{i}", size="fast", status=status, requirement=requirement, source="here",
            skipped_because="", gates=[gate(3 * i + k, STATUSES[k]) for k in range(i + 1)],
            methods={"bem": MethodEntry(surfaces=2, reused=0, errors=[])},
        )
        for i, status in enumerate(STATUSES)
    ]  # fmt: skip
    return Verdict.on(cases, "fast")


def result(number: int, notes: tuple[str, ...] = ()) -> ContactResult:
    areas = {
        kind: Areas(*((0.3 - 0.047 * i) / (1 + 0.37 * k) / 1.13**number for k in range(3)))
        for i, kind in enumerate(("raw", "corrected", "error"))
    }
    sigma = np.linspace(0, 1.5e11, 50)
    return ContactResult(
        "bem", (LoadStep(1.25e10, areas, {"gap": 2e-9}),), Provenance("0123abcd", number),
        PressureDistribution(sigma, 0.06 * (sigma / 1.5e11) ** 2, 0.05),
        cost={"seconds": 1.0, "unknowns": 4096.0, "peak_memory_bytes": 2.0**28, "fft_pairs": 90.0},
        notes=notes,
    )  # fmt: skip


def answers(notes: tuple[str, ...] = ()) -> dict[str, Any]:
    data = result(1, notes).to_json()
    parts = {"mean": 0.1, "standard_deviation": 0.001, "half_width_95": 0.0123}
    spread = {kind: dict.fromkeys(PARTS, parts) for kind in data["areas"]}
    ensemble = {"surfaces": ["seed7", "seed8"], "areas": spread}
    return {"bem": {**data, "ensemble": ensemble, "members": [data, data]}}


def content(told: Verdict) -> dict[str, Any]:
    return told.model_dump(mode="json", by_alias=True, exclude_none=True)


class Page(HTMLParser):
    """A page: balanced, and self-contained; its heading, text, cells with data, and pictures."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.heading = self.text = ""
        self.cells: list[tuple[dict[str, str], str]] = []
        self.pictures: dict[str, bytes] = {}

    @classmethod
    def of(cls, path: Path) -> Page:
        page, text = cls(), path.read_text("utf-8")
        page.feed(text)
        page.close()
        assert page.open == []
        ids = re.findall(r'id="([^"]*)"', text)
        for reference in re.findall(r'(?:src|href|srcset|action|poster)="([^"]*)"', text):
            assert reference.startswith("data:") or reference[1:] in ids, reference
        assert "<script" not in text
        return page

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        told = {name: value or "" for name, value in attrs}
        if tag == "img":
            kind, _, picture = told["src"].partition(";base64,")
            self.pictures[told["alt"]] = base64.b64decode(picture, validate=True)
            assert kind in ("data:image/svg+xml", "data:image/png", "data:image/gif")
        if tag not in ("meta", "link", "img"):
            self.open.append(tag)
        data = {name[5:]: value for name, value in told.items() if name.startswith("data-")}
        if tag == "td":
            self.cells.append((data, ""))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        if tag == "td" and not self.cells[-1][0]:
            self.cells.pop()

    def handle_data(self, data: str) -> None:
        self.text += data
        self.heading += data if "h1" in self.open else ""
        if "td" in self.open:
            about, text = self.cells[-1]
            self.cells[-1] = about, text + data


def numbers(text: str) -> list[float]:
    return [
        float(part) for part in re.split(r"[±,…]", re.sub(r"[\[\]%]", "", text)) if part.strip()
    ]


def test_the_page_shows_the_verdict_and_the_answers(tmp_path: Path) -> None:
    told = verdict()
    write_report(tmp_path / "x.html", content(told), {f"case-{i}": answers() for i in range(3)})
    page = Page.of(tmp_path / "x.html")
    assert page.heading.endswith("falls short")
    judged = [(case.id, g) for case in told.cases for g in case.gates]
    cells = [(about, text) for about, text in page.cells if "field" in about]
    assert len(cells) == 5 * len(judged)
    for k, (case, g) in enumerate(judged):
        row = cells[5 * k : 5 * k + 5]
        place = {"case": case, "quantity": g.quantity, "of": g.of, "against": g.against}
        assert all(place.items() <= about.items() for about, _ in row)
        assert [a["field"] for a, _ in row] == [
            "status",
            "value",
            "reference",
            "difference",
            "band",
        ]
        status, *texts, band = (text for _, text in row)
        assert status == g.status
        assert numbers(band) == pytest.approx([g.low, g.high], rel=5e-3)
        for text, shown in zip(texts, (g.value, g.reference, g.difference), strict=True):
            expected = [] if shown is None else [shown.mean, shown.half_width]
            assert numbers(text) == pytest.approx(expected, rel=5e-2)
            assert numbers(text)[:1] == pytest.approx(expected[:1], rel=5e-3)
    areas = result(1).final.areas
    for case in ("case-0", "case-1", "case-2"):
        here = {a["quantity"]: t for a, t in page.cells if a["case"] == case and "method" in a}
        for name, text in here.items():
            _, part, kind = name.split(".")
            assert float(text) == pytest.approx(getattr(areas[kind], part), rel=5e-4)
        assert len(here) == 6
    for words in ("0123abcd", "seed7, seed8", "256 MiB", "fft pairs 90", "0.012", "no such thing"):
        assert words in page.text, words


HOSTILE = '</td><script src="http://evil.example/x.js">alert(1)</script> & "quoted"'


def test_nothing_a_case_says_becomes_html(tmp_path: Path) -> None:
    told = content(verdict(HOSTILE))
    told["cases"][0]["gates"][0]["because"] = HOSTILE
    told["cases"][0]["methods"]["bem"]["errors"] = [HOSTILE]
    before = json.dumps(told)
    picture = Picture(b"\x89PNG", ".png", HOSTILE)
    found = {"case-0": answers((HOSTILE,))}
    write_report(tmp_path / "x.html", told, found, {"case-0": [picture]}, [HOSTILE])
    page = Page.of(tmp_path / "x.html")
    assert page.text.count(HOSTILE) == 11  # the three requirements twice
    assert list(page.pictures) == [HOSTILE]
    assert json.dumps(told) == before


@pytest.mark.parametrize(
    ("mean", "half_width", "shown"),
    [(0.5, 0.0, "0.5"), (0.5, 0.1, "0.5 ± 0.1"), ("inf", "nan", "inf")],
)
def test_an_interval_is_shown_where_there_is_one(
    tmp_path: Path, mean: Any, half_width: Any, shown: str
) -> None:
    told = content(verdict())
    told["cases"][0]["gates"][0]["value"] = {"mean": mean, "half_width_95": half_width}
    write_report(tmp_path / "x.html", told, {})
    cells = Page.of(tmp_path / "x.html").cells
    assert next(text for about, text in cells if about.get("field") == "value") == shown


def test_what_cannot_be_reported(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"verdict\.json: no such file"):
        report_folder(tmp_path)
    for text in ("{", "{}", "[1]", "3", '{"cases": [1]}', '{"cases": [{"id": "a"}]}'):
        (tmp_path / "verdict.json").write_text(text)
        with pytest.raises(OutputError, match="it is no JSON" if text == "{" else "no verdict"):
            report_folder(tmp_path)


# --- the tables of a terminal ---------------------------------------------------------------------


def cells_of(table: Any) -> list[list[str]]:
    """The texts of a table by rows, as they are printed on a wide terminal."""
    console = Console(width=400, file=io.StringIO())
    columns = [[console.render_str(str(c)).plain for c in column.cells] for column in table.columns]
    return [list(row) for row in zip(*columns, strict=True)]


def test_the_table_of_gates_shows_the_verdict() -> None:
    judged = [g for case in verdict().cases for g in case.gates]
    rows = cells_of(verdict_table(verdict().cases, width=400))
    for row, g in zip(rows, judged, strict=True):
        _, quantity, of, against, *texts, band, status = row
        assert (quantity, of, against, status) == (g.quantity, g.of, g.against, g.status)
        estimates = (g.value, g.reference, g.difference)
        if None in estimates:
            assert [*texts, band] == [""] * 4
            continue
        per_cent = 100.0 if "%" in texts[2] else 1.0
        for text, shown, scale in zip(texts, estimates, (1.0, 1.0, per_cent), strict=True):
            mean, half_width = numbers(text)
            assert mean == pytest.approx(scale * shown.mean, rel=5e-3)
            assert half_width == pytest.approx(scale * shown.half_width, rel=0.5)
        assert numbers(band) == pytest.approx([per_cent * g.low, per_cent * g.high], rel=5e-2)


def test_the_table_of_areas_shows_the_answers() -> None:
    both = [result(1), result(2)]
    rows = cells_of(answers_table({"bem": Answer(tuple(both), ("seed1", "seed2"), reused=1)}))
    assert [row[:2] + row[5:] for row in rows] == [
        ["bem", k, "2", "1"] for k in ("raw", "corrected", "error")
    ]
    for _, kind, *parts, _, _ in rows:
        for text, part in zip(parts, PARTS, strict=True):
            mean = np.mean([getattr(r.final.areas[kind], part) for r in both])
            assert numbers(text)[0] == pytest.approx(mean, rel=0.05 if kind == "error" else 1e-4)


# --- pictures -------------------------------------------------------------------------------------


def test_the_legend_has_the_colours_of_the_map() -> None:
    state = np.full((60, 40), APART)
    state[5:25, 5:15] = ELASTIC
    state[35:55, 25:35] = PLASTIC
    places = {APART: (30, 2), ELASTIC: (15, 10), PLASTIC: (45, 30)}
    chart = contact_map(state, 1e9 * (state > 0), (1e-6, 1e-6))
    figure, dots = chart.figure, 150
    with Image.open(io.BytesIO(chart.png(dots))) as picture:
        pixels = np.asarray(picture.convert("RGB"))
    figure.set_dpi(dots)
    FigureCanvasAgg(figure).draw()

    def colour(point: Any) -> tuple[int, ...]:
        return tuple(pixels[int(pixels.shape[0] - point[1]), int(point[0])].tolist())

    (legend,) = figure.legends
    texts = [text.get_text() for text in legend.get_texts()]
    keys = dict(zip((text.split()[0] for text in texts), legend.get_patches(), strict=True))
    for kind, place in places.items():
        box = keys[STATE_NAMES[kind]].get_window_extent()
        key = colour(((box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2))
        assert key == colour(figure.axes[0].transData.transform(place))
        assert f"{STATE_NAMES[kind]} {100 * np.mean(state == kind):.2f} %" in texts


def test_the_drawn_curve_of_the_theory_is_its_formula() -> None:
    G, p0, hardness = 4.2e21, 1.25e10, 1.5e11
    step = LoadStep(p0, result(1).final.areas, {}, {}, {"diffusion": G})
    found = {
        "persson": [ContactResult("persson", (step,), Provenance("d"), result(1).distribution)]
    }
    theory = theory_densities(found, hardness)
    chart = pressure_distribution(found, hardness=hardness, theory=theory)
    lines = {line.get_label(): line for line in chart.figure.axes[0].lines}
    x, y = (np.asarray(v) for v in lines["persson without hardness"].get_data())
    near, far = (np.exp(-((1e9 * x - shift) ** 2) / (4 * G)) for shift in (p0, -p0))
    assert y == pytest.approx(1e9 * (near - far) / np.sqrt(4 * np.pi * G), rel=1e-9, abs=1e-15)
    x, y = (np.asarray(v) for v in lines["persson (plastic area 0.05)"].get_data())
    n = np.arange(1, 40)[:, None]
    modes = np.sin(n * np.pi * p0 / hardness) * np.sin(n * np.pi * 1e9 * x / hardness)
    capped = 2e9 / hardness * np.sum(modes * np.exp(-((n * np.pi / hardness) ** 2) * G), axis=0)
    assert y == pytest.approx(capped, rel=1e-9, abs=1e-12 * capped.max())
