"""The report of a verification run: one self-contained HTML page of verdict, answers, pictures.

`write_report` makes the page from plain dictionaries, in the form of `verdict.json` and of a
method's JSON; `report_folder` gathers them, and the pictures, from an output folder.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from epcontact.errors import OutputError
from epcontact.output.files import write_text
from epcontact.output.report.page import (
    Cell,
    Picture,
    badge,
    document,
    figure,
    number,
    plain_list,
    size_of,
    table,
    text,
    with_interval,
)
from epcontact.output.report.pictures import charts_of, pictures_in
from epcontact.results import number_from_json

#: A method's JSON, a case's answers by method, and so on: plain data.
Data = Mapping[str, Any]

_PARTS = ("total", "elastic", "plastic")


def write_report(
    path: Path | str,
    verdict: Data,
    results: Mapping[str, Mapping[str, Data]],
    pictures: Mapping[str, Sequence[Picture]] | None = None,
    notes: Sequence[str] = (),
) -> None:
    """Write the page, whole or not at all.

    verdict: the content of verdict.json.  results: by case and method, the content of the
    methods' JSON.  pictures: by case.  notes: sentences for the top of the page.

    Raises OutputError.
    """
    cases = verdict["cases"]
    body = [_heading(verdict), *(f"<p>{text(note)}</p>" for note in notes), _summary(cases)]
    for case in cases:
        answers = results.get(case["id"], {})
        body.append(_case(case, answers, (pictures or {}).get(case["id"], ())))
    body.append(f"<h2>Versions</h2><p>{text(plain_list(verdict['versions']))}</p>")
    write_text(path, document("epcontact: verification report", body))


def report_folder(folder: Path | str, path: Path | str | None = None) -> Path:
    """Make the report of an output folder, by default as report.html in it; returns its path.

    Charts that lie in a case's folder (.svg with a caption beside it, .txt) are put into the
    page; contact maps are drawn of the first .vti of each method, and finite-element blocks (.pvd)
    where rendering works.

    Raises OutputError if there is no verdict in the folder or the page cannot be written.
    """
    home = Path(folder)
    verdict = _read_json(home / "verdict.json")
    results: dict[str, dict[str, Data]] = {}
    pictures: dict[str, list[Picture]] = {}
    notes: list[str] = []
    for case in verdict["cases"]:
        here = home / case["id"]
        answers = {
            method: _read_json(here / f"{method}.json")
            for method in case["methods"]
            if (here / f"{method}.json").is_file()
        }
        results[case["id"]] = answers
        pictures[case["id"]] = [*charts_of(answers), *pictures_in(here, answers, notes)]
    target = Path(path) if path is not None else home / "report.html"
    write_report(target, verdict, results, pictures, list(dict.fromkeys(notes)))
    return target


def _heading(verdict: Data) -> str:
    statuses = [case["status"] for case in verdict["cases"]]
    counts = {s: statuses.count(s) for s in ("holds", "falls short", "error", "skipped")}
    told = ", ".join(f"{n} {status}" for status, n in counts.items() if n)
    passed = "holds" if verdict["passed"] else "falls short"
    return (
        f"<h1>Verification report {badge(passed)}</h1>"
        f'<p class="soft">{len(statuses)} cases at size {text(verdict["size"])}: {text(told)}.</p>'
    )


def _summary(cases: Sequence[Data]) -> str:
    rows = []
    for case in cases:
        held = sum(gate["status"] == "holds" for gate in case["gates"])
        rows.append(
            f'<tr><td><a href="#{text(case["id"])}">{text(case["id"])}</a></td>'
            f"<td>{badge(case['status'])}</td><td class=n>{held} of {len(case['gates'])}</td>"
            f"<td class=long>{text(case['requirement'])}</td></tr>"
        )
    return (
        '<div class="scroll"><table><thead><tr><th>case</th><th>verdict</th>'
        "<th class=n>gates that hold</th><th>requirement</th></tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )


def _case(case: Data, answers: Mapping[str, Data], pictures: Sequence[Picture]) -> str:
    parts = [
        f'<section id="{text(case["id"])}"><h2>{text(case["id"])} {badge(case["status"])}</h2>',
        f"<p>{text(case['requirement'])}</p>",
        f'<p class="soft">Source: {text(case["source"])}</p>',
    ]
    if case.get("skipped_because"):
        parts.append(f"<p>Skipped: {text(case['skipped_because'])}</p>")
    errors = [e for method in case["methods"].values() for e in method["errors"]]
    parts += [f'<p class="bad">{text(error)}</p>' for error in errors]
    if case["gates"]:
        parts += ["<h3>Gates</h3>", _gates(case["gates"])]
    if answers:
        parts += ["<h3>Areas and their errors</h3>", _areas(answers)]
    if pictures:
        shown = "".join(figure(picture) for picture in pictures)
        parts += ["<h3>Pictures</h3>", f'<div class="figures">{shown}</div>']
    if answers:
        parts += ["<h3>Convergence and cost</h3>", _costs(answers), _provenance(answers)]
    return "\n".join([*parts, "</section>"])


def _gates(gates: Sequence[Data]) -> str:
    rows: list[list[str | Cell]] = []
    reasons = []
    for gate in gates:
        against = gate["against"]
        judged = [
            with_interval(gate[k]["mean"], gate[k]["half_width_95"]) if k in gate else Cell("")
            for k in ("value", "reference", "difference")
        ]
        band = f"[{number(gate['low']).text}, {number(gate['high']).text}]"
        shown = against if isinstance(against, str) else number(against).text
        reason = gate.get("error") or f"Because {gate['because']}."
        source = f" Source: {gate['source']}." if gate.get("source") else ""
        reasons.append(reason + source)
        rows.append(
            [
                f"{gate['quantity']} ({gate['norm']})",
                gate["of"],
                shown,
                *judged,
                Cell(band, number=True),
                Cell(gate["status"], badge="yes"),
            ]
        )
    numbers = _right("value", "reference", "difference", "band")
    return table(["quantity", "of", "against", *numbers, "verdict"], rows, reasons)


def _areas(answers: Mapping[str, Data]) -> str:
    """The error budget: what the grid, its correction and the few surfaces each add."""
    rows: list[list[str | Cell]] = []
    for method, data in answers.items():
        areas = data["areas"]
        spread = data.get("ensemble", {}).get("areas", {})
        count = len(data.get("members", [])) or 1
        for part in _PARTS:
            if not any(number_from_json(kind[part]) for kind in areas.values()):
                continue
            raw, corrected = (areas.get(k, {}).get(part) for k in ("raw", "corrected"))
            half = spread.get("corrected", {}).get(part, {}).get("half_width_95")
            shift = None
            if raw is not None and corrected is not None:
                shift = number_from_json(corrected) - number_from_json(raw)
            rows.append(
                [
                    method,
                    part,
                    number(raw),
                    number(corrected, 5),
                    number(shift, 2),
                    number(areas.get("error", {}).get(part), 2),
                    number(half if count > 1 else None, 2),
                    number(count),
                ]
            )
    headings = ["raw", "corrected", "correction", "its error", "95 % half-width", "surfaces"]
    return table(["method", "area / nominal", *_right(*headings)], rows)


def _costs(answers: Mapping[str, Data]) -> str:
    rows: list[list[str | Cell]] = []
    for method, data in answers.items():
        cost = dict(data["cost"])
        seconds, unknowns = cost.pop("seconds", None), cost.pop("unknowns", None)
        memory = cost.pop("peak_memory_bytes", None)
        counts = {k.replace("_", " "): number(v).text for k, v in cost.items()}
        rows.append(
            [
                method,
                "yes" if data["converged"] else Cell("falls short", badge="yes"),
                plain_list(
                    {k.replace("_", " "): number(v, 2).text for k, v in data["residuals"].items()}
                ),
                number(seconds, 3),
                number(unknowns, 8),
                size_of(memory) if memory is not None else "",
                plain_list(counts),
            ]
        )
    numbers = _right("seconds", "unknowns")
    headings: list[str | Cell] = ["method", "converged", "residuals", *numbers]
    headings += ["peak memory", "counts"]
    return table(headings, rows)


def _provenance(answers: Mapping[str, Data]) -> str:
    lines = []
    for method, data in answers.items():
        source = data["provenance"]
        surfaces = ", ".join(map(str, data.get("ensemble", {}).get("surfaces", [])))
        lines.append(
            f"<p><b>{text(method)}</b>: scene <code>{text(source['scene'])}</code>, surfaces "
            f"{text(surfaces or source['seed'])}; options {text(plain_list(source['options']))}; "
            f"{text(plain_list(source['versions']))}</p>"
        )
        notes = dict.fromkeys(n for m in data.get("members", []) for n in m.get("notes", ()))
        lines += [f'<p class="soft">{text(method)}: {text(note)}.</p>' for note in notes]
    return f"<details><summary>Provenance</summary>{''.join(lines)}</details>"


def _right(*headings: str) -> list[Cell]:
    return [Cell(heading, number=True) for heading in headings]


def _read_json(path: Path) -> Any:
    try:
        return json.loads(path.read_bytes())
    except OSError as error:
        raise OutputError(f"cannot read {path}: {(error.strerror or str(error)).lower()}") from None
    except ValueError:
        raise OutputError(f"cannot read {path}: it is no JSON") from None
