"""What a person reads is what was computed: page, tables, pictures and field files, cell by cell.

One scene is run once, on an oblong grid, along a path that unloads, by two methods.  Where
exchanged columns must show, the numbers are made up, no two alike.
"""

import base64
import io
import json
import re
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
import pandas as pd
import pytest
from command_line import invoke
from conftest import SMALL_CASE
from rich.console import Console

from epcontact.cli.tables import answers_table, verdict_table
from epcontact.errors import OutputError
from epcontact.harness.answers.store import Answer
from epcontact.harness.case_files.case import load_case
from epcontact.harness.gates import Estimate, GateVerdict
from epcontact.harness.verdict.judgement import CaseVerdict, MethodEntry, Verdict
from epcontact.output.charts.style import STATE_NAMES
from epcontact.output.report import report_folder, write_report
from epcontact.output.vtk import read_fields
from epcontact.results import APART, ELASTIC, PLASTIC, Areas, ContactResult, LoadStep, Provenance

PARTS, KINDS = ("total", "elastic", "plastic"), ("raw", "corrected", "error")
#: What makes the small case one of an oblong layer that is unloaded, for two methods.
CHANGES = {
    '"small"': '"shown"', '"persson", "bem"': '"bem", "fem"', "[3, 5, 7]": "[5]",
    "period = 1.0e-3": "period = [1.0e-3, 1.25e-3]\nshape = [16, 20]",
    "wavenumber_high = 5.026548245743669e4\nrms_slope = 0.1":
        "wavenumber_high = 2.0e4\nrms_slope = 0.02",
    "points_per_shortest_wavelength = { fast = 4, full = 8 }\n": "",
    "young_modulus = 100.0e9": "young_modulus = 210.0e9", "hardness = 6.0e9": "hardness = 1.5e9",
    "[theory]\nenergy_reduction = 0.536":
        '[body]\nkind = "bonded_layer"\ndepth = 1e-3\n[fem]\nlaw = "capped"\nlayers = 2',
    "mean_pressure = 5.0e8": "mean_pressure = [2.0e8, 5.0e8, 3.0e8]",
    "area.total.corrected": "area.total.raw", 'of = "bem"\nagainst = "persson"':
        'of = "fem"\nagainst = "bem"',
}  # fmt: skip


@pytest.fixture(scope="session")
def ran(tmp_path_factory):
    """The folder in which `epcontact verify` and `report` leave the scene."""
    home = tmp_path_factory.mktemp("shown")
    text = SMALL_CASE
    for old, new in CHANGES.items():
        assert old in text, old
        text = text.replace(old, new)
    (home / "shown.toml").write_text(text)
    options = ("--fields", "first", "--precision", "double", "--jobs", 1, "--output", home)
    assert invoke("verify", home / "shown.toml", *options).returncode == 0
    assert invoke("report", home).returncode == 0
    return home / "shown" / "fast"


def shown(ran, method):
    data = json.loads((ran / f"{method}.json").read_text())
    return read_fields(ran / f"{method}-seed5.vti"), ContactResult.from_json(data["members"][0])


@pytest.mark.parametrize("method", ["bem", "fem"])
def test_a_field_file_is_that_of_the_last_load(ran, method):
    file, answer = shown(ran, method)
    case = load_case(ran.parent.parent / "shown.toml")
    first, *_, last = answer.steps
    assert first.areas["raw"] != last.areas["raw"]
    assert (file.shape, file.periods) == ((16, 20), pytest.approx((1.0e-3, 1.25e-3), rel=1e-14))
    assert np.array_equal(file.fields["heights"], case.scene(case.recipes[0]).surface.heights)
    pressure, state = file.fields["pressure"], file.fields["state"]
    assert pressure.mean() == pytest.approx(3e8, rel=1e-7)
    assert pressure.max() <= 1.5e9 * (1 + 1e-12)
    assert np.array_equal(state != APART, pressure > 0)
    shares, raw = [np.mean(state == kind) for kind in (ELASTIC, PLASTIC)], last.areas["raw"]
    assert shares == pytest.approx([raw.elastic, raw.plastic], abs=1e-12)
    told = {"case": "shown", "size": "fast", "seed": 5, "mean_pressure": 3e8, "hardness": 1.5e9}
    told |= {f"quantity.{n}": v for n, v in last.quantities.items() if not n.startswith("measured")}
    assert told.items() <= file.attributes.items()


def page_of(path):
    """The text and the pictures of a page, and its cells with data.

    A page is balanced, self-contained and without scripts.
    """
    text = path.read_text("utf-8").partition("\n")[2]
    page = ET.fromstring(re.sub(r"<((?:meta|link|img)\b[^>]*)>", r"<\1/>", text))
    ids = [each.get("id") for each in page.iter()]
    for each in page.iter():
        references = [each.get(name, "data:") for name in ("src", "href", "srcset", "action")]
        assert all(r.startswith("data:") or r[1:] in ids for r in references), references
    for picture in page.iter("img"):
        kind, _, content = picture.attrib["src"].partition(";base64,")
        assert base64.b64decode(content, validate=True)
        assert kind in ("data:image/svg+xml", "data:image/png", "data:image/gif")
    assert not [*page.iter("script")]
    data = [({k[5:]: v for k, v in c.items() if k[:5] == "data-"}, c) for c in page.iter("td")]
    cells = [(about, "".join(cell.itertext())) for about, cell in data if about]
    return "".join(page.itertext()), {image.get("alt") for image in page.iter("img")}, cells


def test_the_charts_and_the_page_are_those_of_the_answers_and_their_fields(ran):
    (bem, answer), (fem, other) = shown(ran, "bem"), shown(ran, "fem")
    tables = {path.stem: pd.read_csv(path) for path in ran.glob("*.csv")}
    for name, file in (("bem", bem), ("fem", fem)):
        rows = dict(tables[f"contact-{name}"].itertuples(index=False))
        for kind, word in STATE_NAMES.items():
            assert rows[word] == pytest.approx(np.mean(file.fields["state"] == kind), rel=1e-14)
    rows = dict(tables["pressure-difference-bem-fem"].itertuples(index=False))
    difference = bem.fields["pressure"] - fem.fields["pressure"]
    assert rows["rms_difference_Pa"] == pytest.approx(np.sqrt(np.mean(difference**2)), rel=1e-14)
    rows = tables["pressure-distribution"].query("series == 'bem'")
    pressure, density = rows["pressure_Pa"].to_numpy(), rows["density_per_Pa"].to_numpy()
    width, elastic = np.diff(pressure)[0], answer.final.areas["raw"].elastic
    assert density.sum() * width == pytest.approx(elastic, rel=0.02)
    assert (pressure * density).sum() * width == pytest.approx(3e8, rel=0.05)
    residuals = tables["residuals"].query("series == 'fem'")["residual"]
    assert residuals.tolist() == pytest.approx(other.history, rel=1e-14)
    _, pictures, cells = page_of(ran.parent.parent / "report.html")
    values = {c["quantity"]: (json.loads(c["value"]), text) for c, text in cells if "value" in c}
    about = answer.provenance.about
    assert {n: v for n, (v, _) in values.items()} == {n: e["value"] for n, e in about.items()}
    told = {"points": "16 × 20", "hardness": "1.5 GPa", "load_path": "200, 500, 300 MPa"}
    assert {name: values[name][1] for name in told} == told
    assert pictures == {path.read_text().strip() for path in ran.glob("*.txt")}
    assert len(pictures) == 5  # distribution, residuals, two maps, their difference


# --- made-up numbers, no two alike ----------------------------------------------------------------

STATUSES = ("holds", "falls short", "error")
HOSTILE = '</td><script src="http://evil.example/x.js">alert(1)</script> & "quoted"'


def gate(number, status):
    judged: dict[str, Any] = {"error": "no such thing"} if status == "error" else {
        name: Estimate(mean=(0.1 + 0.137 * i) * 1.9**number,
                       half_width_95=(0.011 + 0.0023 * i) * 1.9**number, surfaces=8)
        for i, name in enumerate(("value", "reference", "difference"))
    }  # fmt: skip
    return GateVerdict(
        name=f"gate {number}", status=status, quantity=f"quantity.q{number}", of=f"of{number}",
        against=f"against{number}", norm=("absolute", "relative", "wasserstein")[number % 3],
        low=-0.031 - 0.01 * number, high=0.047 + 0.013 * number, because="it must", source="",
        **judged,
    )  # fmt: skip


def verdict():
    """One case for each status, with gates of every status in the worst of them."""
    methods = {"bem": MethodEntry(surfaces=2, reused=0, errors=[])}
    cases = [
        CaseVerdict(
            id=f"case-{i}", size="fast", status=status, requirement="It holds.", source="here",
            skipped_because="", gates=[gate(3 * i + k, STATUSES[k]) for k in range(i + 1)],
            methods=methods,
        )
        for i, status in enumerate(STATUSES)
    ]  # fmt: skip
    return Verdict.on(cases, "fast")


def content():
    return verdict().model_dump(mode="json", by_alias=True, exclude_none=True)


def result(number):
    areas = {
        kind: Areas(*((0.3 - 0.047 * i) / (1 + 0.37 * k) / 1.13**number for k in range(3)))
        for i, kind in enumerate(KINDS)
    }
    cost = {"seconds": 1.0, "unknowns": 4096.0, "peak_memory_bytes": 2.0**28, "fft_pairs": 90.0}
    made = Provenance("0123abcd", number)
    return ContactResult("bem", (LoadStep(1.25e10, areas, {"gap": 2e-9}),), made, cost=cost)


def answers():
    data = result(1).to_json()
    parts = {"mean": 0.1, "standard_deviation": 0.001, "half_width_95": 0.0123}
    spread = {kind: dict.fromkeys(PARTS, parts) for kind in KINDS}
    ensemble = {"surfaces": ["seed7", "seed8"], "areas": spread}
    return {"bem": {**data, "ensemble": ensemble, "members": [data, data]}}


def numbers(text):
    return [
        float(part) for part in re.split(r"[±,…]", re.sub(r"[\[\]%]", "", text)) if part.strip()
    ]


def test_the_page_shows_the_verdict_and_the_answers(tmp_path):
    write_report(tmp_path / "x.html", content(), {f"case-{i}": answers() for i in range(3)})
    text, _, data = page_of(tmp_path / "x.html")
    judged = [(case.id, g) for case in verdict().cases for g in case.gates]
    cells = [(about, text) for about, text in data if "field" in about]
    fields = ["status", "value", "reference", "difference", "band"]
    assert [about["field"] for about, _ in cells] == fields * len(judged)
    for k, (case, g) in enumerate(judged):
        row = cells[5 * k : 5 * k + 5]
        place = {"case": case, "quantity": g.quantity, "of": g.of, "against": g.against}
        assert all(place.items() <= about.items() for about, _ in row)
        status, *texts, band = (text for _, text in row)
        assert status == g.status
        assert numbers(band) == pytest.approx([g.low, g.high], rel=5e-3)
        for shown, estimate in zip(texts, (g.value, g.reference, g.difference), strict=True):
            expected = [] if estimate is None else [estimate.mean, estimate.half_width]
            assert numbers(shown) == pytest.approx(expected, rel=5e-2)
            assert numbers(shown)[:1] == pytest.approx(expected[:1], rel=5e-3)
    found = [(about["quantity"].split("."), text) for about, text in data if "method" in about]
    assert len(found) == 18
    for (_, part, kind), area in found:
        assert float(area) == pytest.approx(getattr(result(1).final.areas[kind], part), rel=5e-4)
    said = ("0123abcd", "seed7, seed8", "256 MiB", "fft pairs 90", "0.012", "no such thing")
    for words in ("Verification report falls short", *said):
        assert words in text, words


def test_nothing_a_case_says_becomes_html(tmp_path):
    told, found = content(), {"case-0": answers()}
    first = told["cases"][0]
    first["requirement"] = first["gates"][0]["because"] = HOSTILE
    first["gates"][0]["value"] = {"mean": "inf", "half_width_95": "nan"}
    first["methods"]["bem"]["errors"] = [HOSTILE]
    found["case-0"]["bem"]["members"][0]["notes"] = [HOSTILE]
    picture = {"uri": "data:image/png;base64,iVBORw0KGgo=", "caption": HOSTILE}
    write_report(tmp_path / "x.html", told, found, {"case-0": [picture]}, [HOSTILE])
    text, pictures, data = page_of(tmp_path / "x.html")
    assert (text.count(HOSTILE), pictures) == (7, {HOSTILE})  # the requirement twice
    assert next(text for about, text in data if about.get("field") == "value") == "inf"


def test_what_cannot_be_reported(tmp_path):
    with pytest.raises(OutputError, match=r"verdict\.json: no such file"):
        report_folder(tmp_path)
    for text in ("{", "{}", "[1]", "3", '{"cases": [1]}', '{"cases": [{"id": "a"}]}'):
        (tmp_path / "verdict.json").write_text(text)
        with pytest.raises(OutputError, match="it is no JSON" if text == "{" else "no verdict"):
            report_folder(tmp_path)


def cells_of(table):
    """The texts of a terminal's table by rows, as they are printed on a wide one."""
    console = Console(width=400, file=io.StringIO())
    columns = [[console.render_str(str(c)).plain for c in column.cells] for column in table.columns]
    return [list(row) for row in zip(*columns, strict=True)]


def test_the_table_of_gates_shows_the_verdict():
    judged = [g for case in verdict().cases for g in case.gates]
    for row, g in zip(cells_of(verdict_table(verdict().cases, width=400)), judged, strict=True):
        _, quantity, of, against, *texts, status = row
        named = g.quantity + {"relative": "", "absolute": ""}.get(g.norm, f" ({g.norm})")
        assert (quantity, of, against, status) == (named, g.of, g.against, g.status)
        if g.value is None or g.reference is None or g.difference is None:
            assert texts == [""] * 4
            continue
        per_cent = 100.0 if "%" in texts[2] else 1.0
        estimates = ((g.value, 1.0), (g.reference, 1.0), (g.difference, per_cent))
        for text, (estimate, scale) in zip(texts, estimates, strict=False):
            mean, half_width = numbers(text)
            assert mean == pytest.approx(scale * estimate.mean, rel=5e-3)
            assert half_width == pytest.approx(scale * estimate.half_width, rel=0.5)
        assert numbers(texts[3]) == pytest.approx([per_cent * g.low, per_cent * g.high], rel=5e-2)


def test_the_table_of_areas_shows_the_answers():
    both = (result(1), result(2))
    rows = cells_of(answers_table({"bem": Answer(both, ("seed1", "seed2"), reused=1)}))
    assert [row[:2] + row[5:] for row in rows] == [["bem", kind, "2", "1"] for kind in KINDS]
    for _, kind, *parts, _, _ in rows:
        for text, part in zip(parts, PARTS, strict=True):
            mean = np.mean([getattr(r.final.areas[kind], part) for r in both])
            assert numbers(text)[0] == pytest.approx(mean, rel=0.05 if kind == "error" else 1e-4)
