"""The report: one page that needs nothing else, says what the verdict says, and is fit to read."""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from epcontact.errors import OutputError
from epcontact.output.files import write_json
from epcontact.output.report import Picture, number, report_folder, write_report
from epcontact.output.vtk import write_image
from epcontact.results import (
    Areas,
    ContactResult,
    LoadStep,
    PressureDistribution,
    Provenance,
    package_versions,
)

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
HOSTILE = '</td><script src="http://evil.example/x.js">alert(1)</script> & "quoted"'
VOID = {"meta", "link", "img"}


def answer(method: str, *, plastic: float = 0.05) -> dict[str, Any]:
    """A method's JSON of two surfaces, in the form of the run command."""
    sigma = np.linspace(0, 1.5e11, 200)
    result = ContactResult(
        method=method,
        steps=(
            LoadStep(
                1.25e10,
                {
                    "raw": Areas(0.12, 0.12 - plastic, plastic),
                    "corrected": Areas(0.11, 0.11 - plastic, plastic),
                    "error": Areas(0.002, 0.003, 0.001),
                },
                {"gap": 2e-9},
                {"newton": 7},
                {"diffusion": 4.2e21} if method == "persson" else {},
            ),
        ),
        provenance=Provenance("0123abcd", 7, {"tolerance": 1e-8}),
        distribution=PressureDistribution(sigma, 0.06 * np.sin(sigma / 3e11 * np.pi) ** 2, plastic),
        cost={"seconds": 1.5, "unknowns": 4096.0, "peak_memory_bytes": 2.0**28, "fft_pairs": 90.0},
        history=() if method == "persson" else (1.0, 1e-3, 1e-9),
        notes=("a note",),
    )
    data = result.to_json()
    parts = {"mean": 0.1, "standard_deviation": 0.001, "half_width_95": 0.0123}
    spread = {kind: dict.fromkeys(("total", "elastic", "plastic"), parts) for kind in data["areas"]}
    ensemble = {"surfaces": ["seed7", "seed8"], "areas": spread}
    return {**data, "ensemble": ensemble, "members": [data, data]}


def verdict(status: str = "holds", requirement: str = "It agrees.") -> dict[str, Any]:
    gate = {
        "quantity": "area.total.corrected",
        "of": "bem",
        "against": "persson",
        "norm": "relative",
        "low": -0.02,
        "high": "inf",
        "because": "scatter of the surfaces",
        "source": "",
        "name": "area",
        "status": status,
        "value": {"mean": 0.1104, "half_width_95": 0.0007, "surfaces": 8},
        "reference": {"mean": 0.1099, "half_width_95": 0.0, "surfaces": 1},
        "difference": {"mean": 0.0045, "half_width_95": 0.006, "surfaces": 8},
    }
    unjudged = {k: v for k, v in gate.items() if k not in ("value", "reference", "difference")}
    return {
        "schema": "epcontact-verdict-1",
        "passed": status == "holds",
        "exit_code": 0,
        "size": "fast",
        "versions": package_versions(),
        "cases": [
            {
                "id": "paper",
                "size": "fast",
                "status": status,
                "requirement": requirement,
                "source": "a paper",
                "skipped_because": "",
                "methods": {
                    m: {"surfaces": 2, "reused": 0, "errors": []} for m in ("persson", "bem")
                },
                "gates": [gate, {**unjudged, "status": "error", "error": "no such quantity"}],
            },
            {
                "id": "map",
                "size": "fast",
                "status": "skipped",
                "requirement": "A measured surface.",
                "source": "-",
                "skipped_because": "the file is not there",
                "methods": {},
                "gates": [],
            },
        ],
    }


class Checker(HTMLParser):
    """Balanced tags, and everything the page refers to."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []
        self.ids: list[str] = []
        self.text = ""
        self.alone: list[tuple[str, str | None]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "srcset", "action", "data", "poster"):
                self.references.append(value or "")
            if name == "id":
                self.ids.append(value or "")
            if tag == "img" and name == "alt":
                assert value

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


class Cells(HTMLParser):
    """The cells of a case by their data attributes, with their text."""

    def __init__(self) -> None:
        super().__init__()
        self.cells: list[tuple[dict[str, str], str]] = []
        self.inside: dict[str, str] | None = None

    @classmethod
    def of(cls, page: Path, case: str) -> list[tuple[dict[str, str], str]]:
        parser = cls()
        parser.feed(page.read_text("utf-8"))
        return [(data, text) for data, text in parser.cells if data["data-case"] == case]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        data = {name: value or "" for name, value in attrs if name.startswith("data-")}
        if tag == "td":
            self.inside = data
            if data:
                self.cells.append((data, ""))

    def handle_endtag(self, tag: str) -> None:
        if tag == "td":
            self.inside = None

    def handle_data(self, data: str) -> None:
        if self.inside:
            self.cells[-1] = (self.inside, self.cells[-1][1] + data)


def checked(path: Path) -> Checker:
    checker = Checker()
    checker.feed(path.read_text("utf-8"))
    checker.close()
    assert checker.open == []
    for reference in checker.references:
        inside = reference.startswith("#") and reference[1:] in checker.ids
        assert inside or reference.startswith("data:"), reference
    return checker


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An output folder as the commands leave it: verdict, answers, a chart, two methods' fields."""
    home = tmp_path / "results"
    write_json(home / "verdict.json", verdict())
    for method in ("persson", "bem", "fem"):
        write_json(home / "paper" / "fast" / f"{method}.json", answer(method))
    told = verdict()
    told["cases"][0]["methods"]["fem"] = {"surfaces": 2, "reused": 0, "errors": []}
    write_json(home / "verdict.json", told)
    (home / "paper" / "fast" / "areas.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    (home / "paper" / "fast" / "areas.txt").write_text("Areas against <magnification>.\n")
    pressure = np.random.default_rng(5).random((20, 12)) * 1e9
    for method, factor in (("bem-seed7", 1.0), ("fem-seed7", 1.1)):
        fields = {"pressure": pressure * factor, "state": pressure > 5e8, "gap": 0 * pressure}
        write_image(home / "paper" / "fast" / f"{method}.vti", fields, (1e-6, 1e-6), {})
    return home


def test_the_page_of_a_folder_holds_everything(folder: Path) -> None:
    page = report_folder(folder)
    assert page == folder / "report.html"
    checker = checked(page)
    for words in (
        "paper", "It agrees.", "0.1104 ± 0.0007", "[-0.02, inf]", "Scatter of the surfaces.",
        "no such quantity", "the file is not there", "0123abcd", "seed7, seed8", "256 MiB",
        "fft pairs 90", "Note by persson, bem, fem: a note.", "0.012",
        "Areas against <magnification>.",
    ):  # fmt: skip
        assert words in checker.text, words
    images = [r for r in checker.references if r.startswith("data:image")]
    # P(sigma), history, the chart, two maps and their difference.
    assert len(images) == 6
    for image in images:
        kind, content = re.fullmatch(r"data:image/(png|svg\+xml);base64,(.*)", image).groups()  # type: ignore[union-attr]
        begin = base64.b64decode(content, validate=True)[:300]
        assert begin.startswith(b"\x89PNG") if kind == "png" else b"<svg" in begin + b"<svg"
    assert os.listdir(folder).count("report.html") == 1


def test_the_page_says_what_was_computed_and_where_each_figure_is(folder: Path) -> None:
    about = {
        "surface": {"value": "sphere <of> 1 m", "unit": "", "meaning": "surface"},
        "points": {"value": [256, 128], "unit": "–", "meaning": "grid points"},
        "hardness": {"value": "inf", "unit": "Pa", "meaning": "hardness"},
        "young_modulus": {"value": 2.5e11, "unit": "Pa", "meaning": "Young's modulus"},
        "load_path": {"value": [1e6, 2e6], "unit": "Pa", "meaning": "mean pressure"},
    }
    for method in ("persson", "bem", "fem"):
        data = answer(method)
        data["provenance"]["about"] = about
        write_json(folder / "paper" / "fast" / f"{method}.json", data)
    page = report_folder(folder)
    cells = {
        (data["data-quantity"], data.get("data-field", data.get("data-method", ""))): text
        for data, text in reversed(Cells.of(page, "paper"))  # the second gate is not judged
    }
    assert cells["surface", ""] == "sphere <of> 1 m"
    assert cells["points", ""] == "256 × 128"
    assert cells["hardness", ""] == "none"
    assert cells["young_modulus", ""] == "250 GPa"
    assert cells["load_path", ""] == "1, 2 MPa"
    assert cells["surfaces", ""].startswith("2 (seed7, seed8)")
    assert cells["area.total.corrected", "value"] == "0.1104 ± 0.0007"
    assert cells["area.total.corrected", "bem"] == "0.11"
    values = {d["data-quantity"]: d["data-value"] for d, _ in Cells.of(page, "paper")
              if "data-value" in d}  # fmt: skip
    assert {name: json.loads(text) for name, text in values.items()} == {
        **{name: entry["value"] for name, entry in about.items()}, "surfaces": ["seed7", "seed8"],
    }  # fmt: skip
    # The verdict is the first column, which a phone shows.
    gates = page.read_text("utf-8").split("<h3>Gates</h3>")[1]
    assert re.findall("<th[^>]*>([^<]*)</th>", gates)[0] == "verdict"


def test_it_says_what_the_verdict_says(tmp_path: Path) -> None:
    for status in ("holds", "falls short"):
        write_report(tmp_path / "x.html", verdict(status), {})
        heading = re.search(r"<h1>.*</h1>", (tmp_path / "x.html").read_text())
        assert heading is not None
        assert status in heading[0]


def test_nothing_a_case_says_becomes_html(tmp_path: Path) -> None:
    told = verdict(requirement=HOSTILE)
    told["cases"][0]["gates"][0]["because"] = HOSTILE
    told["cases"][0]["methods"]["bem"]["errors"] = [HOSTILE]
    hostile = answer("bem")
    hostile["members"][0]["notes"] = [HOSTILE]
    picture = Picture(b"\x89PNG", "png", HOSTILE)
    write_report(
        tmp_path / "x.html", told, {"paper": {"bem": hostile}}, {"paper": [picture]}, [HOSTILE]
    )
    checker = checked(tmp_path / "x.html")
    assert checker.text.count(HOSTILE) == 7  # the requirement twice
    assert "<script" not in (tmp_path / "x.html").read_text()


def test_numbers_are_told_as_they_are() -> None:
    assert number("inf") == "inf"
    assert number("nan") == "–"
    assert number(None) == ""
    assert number(0.123456) == "0.1235"


@pytest.mark.parametrize(
    ("mean", "half_width", "shown"),
    [(0.5, 0.0, "0.5"), (0.5, 0.1, "0.5 ± 0.1"), ("inf", "nan", "inf")],
)
def test_an_interval_is_shown_where_there_is_one(
    tmp_path: Path, mean: Any, half_width: Any, shown: str
) -> None:
    told = verdict()
    told["cases"][0]["gates"][0]["value"] = {"mean": mean, "half_width_95": half_width}
    write_report(tmp_path / "x.html", told, {})
    cells = Cells.of(tmp_path / "x.html", "paper")
    assert next(text for data, text in cells if data.get("data-field") == "value") == shown


def test_what_cannot_be_reported(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"verdict\.json: no such file"):
        report_folder(tmp_path)
    (tmp_path / "verdict.json").write_text("{")
    with pytest.raises(OutputError, match="it is no JSON"):
        report_folder(tmp_path)
    for other in ("{}", "[1]", "3", '{"cases": [1]}', '{"cases": [{"id": "a"}]}'):
        (tmp_path / "verdict.json").write_text(other)
        with pytest.raises(OutputError, match="it is no verdict"):
            report_folder(tmp_path)


def browse(page: Path, profile: Path, width: int) -> tuple[str, str]:
    """The page's DOM and the browser's log, console included."""
    browser = next(b for b in BROWSERS if shutil.which(b))
    done = subprocess.run(
        [browser, "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
         f"--user-data-dir={profile}", f"--window-size={width},900", "--enable-logging=stderr",
         "--virtual-time-budget=2000", "--dump-dom", page.as_uri()],
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    return done.stdout, done.stderr


@pytest.mark.slow
@pytest.mark.skipif(
    not any(shutil.which(b) for b in BROWSERS), reason="no Chromium is installed here"
)
def test_a_browser_has_nothing_to_complain_about(folder: Path, tmp_path: Path) -> None:
    page = report_folder(folder)
    dom, log = browse(page, tmp_path / "profile", 390)
    assert "Verification report" in dom
    assert "CONSOLE" not in log
    # The check can fail: a request to another host is refused by the page itself, and told.
    spoilt = tmp_path / "spoilt.html"
    spoilt.write_text(
        page.read_text("utf-8").replace("<h1>", '<img src="https://example.org/x.png"><h1>')
    )
    _, log = browse(spoilt, tmp_path / "profile", 390)
    assert "CONSOLE" in log
    assert "Content Security Policy" in log


def test_the_answers_json_is_not_changed(tmp_path: Path) -> None:
    results = {"paper": {"bem": answer("bem"), "persson": answer("persson")}}
    before = json.dumps(results)
    write_report(tmp_path / "x.html", verdict(), results)
    assert json.dumps(results) == before
