"""What a person reads is what was computed: page, tables, pictures and field files, cell by cell.

Every number differs from every other one, so that two exchanged columns show.
"""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image
from rich.console import Console

from epcontact.cli.tables import answers_table, verdict_table
from epcontact.errors import OutputError
from epcontact.harness.answers.pictures import theory_densities
from epcontact.harness.answers.run import Run, run_cases
from epcontact.harness.answers.store import Answer
from epcontact.harness.case_files.case import load_case
from epcontact.harness.gates.gate import GateVerdict
from epcontact.harness.gates.statistics import Estimate
from epcontact.harness.verdict.record import CaseVerdict, MethodEntry, Verdict
from epcontact.output.charts.curves import pressure_distribution
from epcontact.output.charts.maps import contact_map
from epcontact.output.charts.style import STATE_NAMES
from epcontact.output.report import write_report
from epcontact.output.vtk import read_fields
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

STATUSES = ("holds", "falls short", "error")
NORMS = ("absolute", "relative", "wasserstein")


def estimates(number: int) -> dict[str, Estimate]:
    """The value, reference and difference of a gate: nine numbers of no other gate."""
    names = ("value", "reference", "difference")
    return {
        name: Estimate(
            mean=(0.1 + 0.137 * i) * 1.9**number,
            half_width_95=(0.011 + 0.0023 * i) * 1.9**number,
            surfaces=8,
        )
        for i, name in enumerate(names)
    }


def gate(number: int, status: Any) -> GateVerdict:
    judged = estimates(number) if status != "error" else {"error": "no such thing"}
    return GateVerdict(
        name=f"gate {number}", status=status, quantity=f"quantity.q{number}", of=f"of{number}",
        against=f"against{number}", norm=NORMS[number % 3], low=-0.031 - 0.01 * number,
        high=0.047 + 0.013 * number, because="it must", source="", **judged,
    )  # fmt: skip


def verdict() -> Verdict:
    """One case for each status, with gates of every status in the worst of them."""
    gates = {
        s: [gate(3 * i + k, STATUSES[k]) for k in range(i + 1)] for i, s in enumerate(STATUSES)
    }
    cases = [
        CaseVerdict(
            id=f"case-{i}", size="fast", status=status, requirement="It holds.", source="here",
            skipped_because="", gates=gates[status],
            methods={"bem": MethodEntry(surfaces=2, reused=0, errors=[])},
        )
        for i, status in enumerate(STATUSES)
    ]  # fmt: skip
    return Verdict.on(cases, "fast")


def result(number: int) -> ContactResult:
    areas = {
        kind: Areas(*((0.3 - 0.047 * i) / (1 + 0.37 * k) / 1.13**number for k in range(3)))
        for i, kind in enumerate(("raw", "corrected", "error"))
    }
    sigma = np.linspace(0, 1.5e11, 50)
    return ContactResult(
        "bem", (LoadStep(1.25e10, areas, {"gap": 2e-9}),), Provenance("digest", number),
        PressureDistribution(sigma, 0.06 * (sigma / 1.5e11) ** 2, 0.05),
        cost={"seconds": 1.0, "unknowns": 4096.0},
    )  # fmt: skip


def answers() -> dict[str, Any]:
    data = result(1).to_json()
    parts = {"mean": 0.1, "standard_deviation": 0.001, "half_width_95": 0.0123}
    spread = {kind: dict.fromkeys(("total", "elastic", "plastic"), parts) for kind in data["areas"]}
    ensemble = {"surfaces": ["seed7", "seed8"], "areas": spread}
    return {"bem": {**data, "ensemble": ensemble, "members": [data, data]}}


# --- the page -------------------------------------------------------------------------------------


def page_of(folder: Path) -> str:
    content = verdict().model_dump(mode="json", by_alias=True, exclude_none=True)
    results = {f"case-{i}": answers() for i in range(3)}
    write_report(folder / "report.html", content, results)
    return (folder / "report.html").read_text()


def test_the_page_shows_the_verdict_and_the_answers(tmp_path: Path) -> None:
    page = page_of(tmp_path)
    heading = re.search(r"<h1>(.*?)</h1>", page)
    assert heading is not None
    assert "falls short" in heading[1]
    third = estimates(6)
    for name in ("value", "reference", "difference"):
        cell = re.search(rf'data-field="{name}"[^>]*quantity.q6"[^>]*>([^<]*)<', page)
        assert cell is not None
        mean, half_width = map(float, cell[1].split("±"))
        assert mean == pytest.approx(third[name].mean, rel=5e-3)
        assert half_width == pytest.approx(third[name].half_width, rel=5e-2)
    areas = result(1).final.areas
    for kind in ("raw", "corrected"):
        for part in ("total", "elastic", "plastic"):
            cells = re.findall(rf'data-quantity="area.{part}.{kind}"[^>]*>([^<]*)<', page)
            assert len(cells) == 3
            assert float(cells[0]) == pytest.approx(getattr(areas[kind], part), rel=5e-4)


def test_a_page_that_shows_something_else_is_not_written(tmp_path, monkeypatch) -> None:
    from epcontact.output import report

    monkeypatch.setattr(report, "number", lambda value, digits=4: "0.25")
    with pytest.raises(OutputError, match=r"case-0: the page shows value '0\.25 ± 0\.25'"):
        page_of(tmp_path)
    assert list(tmp_path.iterdir()) == []


# --- the tables of a terminal ---------------------------------------------------------------------


def cells(table: Any) -> list[list[str]]:
    """The texts of a table by rows, as they are printed on a wide terminal."""
    console = Console(width=400, file=io.StringIO())
    columns = [[console.render_str(str(c)).plain for c in column.cells] for column in table.columns]
    return [list(row) for row in zip(*columns, strict=True)]


def test_the_table_of_gates_shows_the_verdict() -> None:
    judged = [g for case in verdict().cases for g in case.gates]
    rows = cells(verdict_table(verdict().cases, width=400))
    assert len(rows) == len(judged)
    for row, g in zip(rows, judged, strict=True):
        _, quantity, of, against, value, reference, difference, band, status = row
        assert (quantity, of, against, status) == (g.quantity, g.of, g.against, g.status)
        if g.value is None or g.reference is None or g.difference is None:
            assert value == reference == difference == band == ""
            continue
        per_cent = 100.0 if "%" in difference else 1.0
        for text, shown, scale in (
            (value, g.value, 1.0), (reference, g.reference, 1.0),
            (difference, g.difference, per_cent),
        ):  # fmt: skip
            mean, half_width = (float(part.replace("%", "")) for part in text.split("±"))
            assert mean == pytest.approx(scale * shown.mean, rel=5e-3)
            assert half_width == pytest.approx(scale * shown.half_width, rel=0.5)
        low, high = (float(part.replace("%", "")) for part in band.split("…"))
        assert (low, high) == pytest.approx((per_cent * g.low, per_cent * g.high), rel=5e-2)


def test_the_table_of_areas_shows_the_answers() -> None:
    both = [result(1), result(2)]
    rows = cells(answers_table({"bem": Answer(tuple(both), ("seed1", "seed2"), reused=1)}))
    assert [row[:2] + row[5:] for row in rows] == [
        ["bem", k, "2", "1"] for k in ("raw", "corrected", "error")
    ]
    for _, kind, *parts, _, _ in rows:
        for text, part in zip(parts, ("total", "elastic", "plastic"), strict=True):
            mean = np.mean([getattr(r.final.areas[kind], part) for r in both])
            digits = 0.05 if kind == "error" else 1e-4
            assert float(text.split("±")[0]) == pytest.approx(mean, rel=digits)


# --- field files ----------------------------------------------------------------------------------


def test_a_field_file_is_that_of_the_last_load(write_case, tmp_path) -> None:
    case = load_case(
        write_case(
            ('["persson", "bem"]', '["bem"]'),
            ('against = "persson"', "against = 0.1\nsource = 's'"),
            ("mean_pressure = 5.0e8", "mean_pressure = [2.0e8, 5.0e8]"), ("[3, 5, 7]", "[3]"),
            ("[theory]\nenergy_reduction = 0.536", ""),
        )
    )  # fmt: skip
    answer = run_cases([case], Run(tmp_path, 1, fields="first"))[case.id]["bem"].results[0]
    (path,) = tmp_path.rglob("bem*.vti")
    file = read_fields(path)
    first, last = answer.steps
    assert first.areas["raw"] != last.areas["raw"]
    assert file.attributes["mean_pressure"] == last.mean_pressure == 5e8
    for kind, areas in last.areas.items():
        for part in ("total", "elastic", "plastic"):
            assert file.attributes[f"area.{part}.{kind}"] == getattr(areas, part)
    for name, value in last.quantities.items():
        if not name.startswith("measured"):
            assert file.attributes[f"quantity.{name}"] == value
    assert file.fields["pressure"].mean(dtype=float) == pytest.approx(5e8, rel=1e-6)
    state = file.fields["state"]
    assert np.mean(state != APART) == pytest.approx(last.areas["raw"].total, abs=1e-12)
    assert np.mean(state == PLASTIC) == pytest.approx(last.areas["raw"].plastic, abs=1e-12)
    assert file.attributes["seed"] == 3


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
    keys = {t.get_text().split()[0]: p for p, t in zip(legend.get_patches(), legend.get_texts(),
                                                       strict=True)}  # fmt: skip
    for kind, place in places.items():
        box = keys[STATE_NAMES[kind]].get_window_extent()
        key = colour(((box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2))
        assert key == colour(figure.axes[0].transData.transform(place))
        share = float(np.mean(state == kind))
        texts = [t.get_text() for t in legend.get_texts()]
        assert f"{STATE_NAMES[kind]} {100 * share:.2f} %" in texts


def test_the_drawn_curve_of_the_theory_is_its_formula() -> None:
    G, p0, hardness = 4.2e21, 1.25e10, 1.5e11
    step = LoadStep(p0, result(1).final.areas, {}, {}, {"diffusion": G})
    found = {
        "persson": [ContactResult("persson", (step,), Provenance("d"), result(1).distribution)]
    }
    chart = pressure_distribution(
        found, hardness=hardness, theory=theory_densities(found, hardness)
    )
    lines = {line.get_label(): line for line in chart.figure.axes[0].lines}
    x, y = (np.asarray(v) for v in lines["persson without hardness"].get_data())
    near, far = (np.exp(-((1e9 * x - shift) ** 2) / (4 * G)) for shift in (p0, -p0))
    assert y == pytest.approx(1e9 * (near - far) / np.sqrt(4 * np.pi * G), rel=1e-9, abs=1e-15)
    x, y = (np.asarray(v) for v in lines["persson (plastic area 0.05)"].get_data())
    n = np.arange(1, 40)[:, None]
    modes = np.sin(n * np.pi * p0 / hardness) * np.sin(n * np.pi * 1e9 * x / hardness)
    capped = 2e9 / hardness * np.sum(modes * np.exp(-((n * np.pi / hardness) ** 2) * G), axis=0)
    assert y == pytest.approx(capped, rel=1e-9, abs=1e-12 * capped.max())
