"""The report of a verification run: one self-contained HTML page of verdict, answers, pictures.

The template `report.html.jinja` beside this file is filled with the content of `verdict.json` and
of the methods' JSON files; jinja2 escapes all of it.  The page loads nothing from other hosts, and
its content-security policy makes the browser enforce that.  It needs no script, follows the
reader's choice of light or dark, and fits a phone.
"""

from __future__ import annotations

import base64
import itertools
import json
import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import pandas as pd

from epcontact.errors import OutputError
from epcontact.output.charts.curves import pressure_distribution, residual_history
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.maps import map_of_file, pressure_difference
from epcontact.output.charts.style import unit_for
from epcontact.output.files import read_bytes, write_text
from epcontact.output.page import contradictions
from epcontact.output.view import load_steps, screenshot
from epcontact.output.vtk import read_fields
from epcontact.results import ContactResult

Data = Mapping[str, Any]  # the content of a JSON file
Results = Mapping[str, Sequence[ContactResult]]  # by method, one result a surface
Theory = Callable[[Results, float], pd.DataFrame | None]

_MEDIA_TYPES = {"svg": "image/svg+xml", "png": "image/png", "gif": "image/gif"}


@dataclass(frozen=True)
class Picture:
    """A picture that becomes a part of the page.

    Args:
        content: Its bytes.
        kind: "svg", "png" or "gif".
        caption: The text below the picture, which screen readers read out.
    """

    content: bytes
    kind: str
    caption: str

    @property
    def uri(self) -> str:
        """The picture as a data URI."""
        return f"data:{_MEDIA_TYPES[self.kind]};base64,{base64.b64encode(self.content).decode()}"


def report_folder(
    folder: Path | str, path: Path | str | None = None, *, theory: Theory | None = None
) -> Path:
    """Make the report of an output folder.

    The page shows the charts in a case's folder (.svg with a caption in .txt beside it), the
    pressure distributions and residuals of all methods, maps of the first .vti of each method,
    and finite-element blocks (.pvd) where three-dimensional pictures can be drawn.

    Args:
        folder: The folder with verdict.json, and for each case a folder with one for each size.
        path: The path of the page, by default report.html in the folder.
        theory: A function that returns the theory's densities by formula from results and
            hardness (Pa).  Without it the theory's pressures are binned like those of the other
            methods.

    Returns:
        The path of the page.

    Raises:
        OutputError: If there is no verdict in the folder or the page cannot be written.
    """
    home = Path(folder)
    verdict = _read_json(home / "verdict.json")
    cases: Any = verdict.get("cases") if isinstance(verdict, dict) else None
    needed = {"id", "size", "methods", "gates"}
    if not isinstance(cases, list) or not all(
        isinstance(case, dict) and needed <= case.keys() for case in cases
    ):
        raise OutputError(f"cannot read {home / 'verdict.json'}: it is no verdict of this program")
    results: dict[str, dict[str, Data]] = {}
    pictures: dict[str, list[Picture]] = {}
    notes: list[str] = []
    for case in cases:
        here = home / case["id"] / case["size"]
        answers = {
            method: _read_json(here / f"{method}.json")
            for method in case["methods"]
            if (here / f"{method}.json").is_file()
        }
        results[case["id"]] = answers
        pictures[case["id"]] = [
            *_charts_of(answers, theory),
            *_saved_charts(here),
            *_maps(here, list(answers)),
        ]
        blocks, complaints = _blocks(here, list(answers))
        pictures[case["id"]] += [*blocks, *_films(here)]
        notes += complaints
    target = Path(path) if path is not None else home / "report.html"
    write_report(target, verdict, results, pictures, list(dict.fromkeys(notes)))
    return target


def write_report(
    path: Path | str,
    verdict: Data,
    results: Mapping[str, Mapping[str, Data]],
    pictures: Mapping[str, Sequence[Picture]] | None = None,
    notes: Sequence[str] = (),
) -> None:
    """Write the page, whole or not at all.

    Args:
        path: The path of the page.
        verdict: The content of verdict.json.
        results: The content of the methods' JSON files, by case and method.
        pictures: The pictures by case.
        notes: Sentences for the top of the page.

    Raises:
        OutputError: If the page cannot be written, or shows something else than it is given.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("epcontact.output", ""),
        autoescape=True,
        undefined=jinja2.ChainableUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": number,
        "counts": _counts,
        "listed": lambda values: ", ".join(f"{name} {value}" for name, value in values.items()),
        "area_rows": _area_rows,
        "computed": _computed,
        "sentence": lambda text: f"{text[:1].upper()}{text[1:].rstrip('. ')}.",
        "notes": _notes,
    }
    statuses = [case["status"] for case in verdict["cases"]]
    counts = {s: statuses.count(s) for s in ("holds", "falls short", "error", "skipped")}
    page = environment.get_template("report.html.jinja").render(
        verdict=verdict,
        results=results,
        pictures=pictures or {},
        notes=notes,
        counts=", ".join(f"{n} {status}" for status, n in counts.items() if n),
    )
    if wrong := list(contradictions(page, verdict, results)):
        raise OutputError(f"cannot write {path}: {'; '.join(wrong[:3])}")
    write_text(path, page + "\n")


def number(value: Any, digits: int = 4) -> str:
    """Return a number of a JSON file as text, other text unchanged, '' for a missing value.

    Example:
        >>> number(0.123456), number("inf"), number("nan"), number(None), number("bem")
        ('0.1235', 'inf', '–', '', 'bem')
    """
    if value is None or isinstance(value, jinja2.Undefined):
        return ""
    try:
        parsed = float(value)
    except (TypeError, ValueError):
        return str(value)
    return "–" if math.isnan(parsed) else f"{parsed:.{digits}g}"


def _counts(values: Data, digits: int, without: Sequence[str] = ()) -> str:
    """Return names and numbers in one line."""
    shown = {k.replace("_", " "): v for k, v in values.items() if k not in without}
    return ", ".join(f"{name} {number(value, digits)}" for name, value in shown.items())


def shown(value: Any, unit: str) -> str:
    """Return a figure of a scene in words: with a unit that suits it, lists as dimensions.

    Example:
        >>> shown(2.5e11, "Pa"), shown([256, 128], "–"), shown([2e-4, 1e-4], "m")
        ('250 GPa', '256 × 128', '200 × 100 µm')
    """
    if unit == "" or isinstance(value, bool):
        return str(value)
    values = [float(one) for one in (value if isinstance(value, list) else [value])]
    if not all(map(math.isfinite, values)):
        return "none"  # an infinite hardness or yield stress is none
    scale, named = (1.0, "") if unit == "–" else unit_for(max(map(abs, values)), unit)
    digits = 9 if unit == "–" and isinstance(value, list) else 4
    texts = [f"{one / scale:.{digits}g}" for one in values]
    if len(texts) > 8:
        texts = [*texts[:3], f"… {len(texts) - 4} more …", texts[-1]]
    return f"{(', ' if unit == 'Pa' else ' × ').join(texts)} {named}".rstrip()


def _computed(answers: Mapping[str, Data]) -> list[dict[str, Any]]:
    """Return the scene that the methods answered, one row for each of its figures."""
    told = [answer["provenance"].get("about") for answer in answers.values()]
    about: Data = next((each for each in told if each), {})
    rows = [
        {"name": name, **entry, "shown": shown(entry["value"], entry["unit"])}
        for name, entry in about.items()
    ]
    labels = (answer["ensemble"]["surfaces"] for answer in answers.values())
    surfaces = max(labels, key=len, default=())
    if rows and len(surfaces) > 1:
        words = f"{len(surfaces)} ({', '.join(surfaces)}); the figures above are of the first"
        rows.append({"name": "surfaces", "value": surfaces, "meaning": "surfaces", "shown": words})
    return rows


def _notes(answers: Mapping[str, Data]) -> list[str]:
    """Return each note of the methods once, with the methods that gave it."""
    methods: dict[str, dict[str, None]] = {}
    for method, answer in answers.items():
        for note in itertools.chain.from_iterable(one["notes"] for one in answer["members"]):
            methods.setdefault(note, {})[method] = None
    return [f"Note by {', '.join(names)}: {note}." for note, names in methods.items()]


def _area_rows(answers: Mapping[str, Data]) -> list[dict[str, Any]]:
    """Return the error budget: the parts of the grid, its correction and the few surfaces."""
    rows = []
    for method, answer in answers.items():
        areas, spread = answer["areas"], answer["ensemble"]["areas"]
        surfaces = len(answer["members"])
        for part in ("total", "elastic", "plastic"):
            if not any(float(kind[part]) for kind in areas.values()):
                continue
            raw, corrected = (areas.get(kind, {}).get(part) for kind in ("raw", "corrected"))
            both = raw is not None and corrected is not None
            half_width = spread.get("corrected", {}).get(part, {}).get("half_width_95")
            row = {"method": method, "part": part, "raw": raw, "corrected": corrected}
            row["correction"] = float(corrected) - float(raw) if both else None
            row["error"] = areas.get("error", {}).get(part)
            row["half_width"] = half_width if surfaces > 1 else None
            rows.append(row | {"surfaces": surfaces})
    return rows


def _charts_of(answers: Mapping[str, Data], theory: Theory | None) -> list[Picture]:
    """Draw the pressure distributions of all methods on one axis, and the residuals."""
    results = {
        method: [ContactResult.from_json(member) for member in answer["members"]]
        for method, answer in answers.items()
    }
    everything = [result for found in results.values() for result in found]
    charts: list[Chart] = []
    tables = [result.distribution for result in everything if result.distribution is not None]
    if tables:
        hardness = max((float(t.pressure[-1]) for t in tables if t.plastic > 0), default=math.inf)
        curves = theory(results, hardness) if theory else None
        charts.append(pressure_distribution(results, hardness=hardness, theory=curves))
    # Only the longest history of each method is drawn; all of them would hide each other.
    longest = {m: max((r.history for r in found), key=len) for m, found in results.items()}
    histories = {m: np.array(h) for m, h in longest.items() if h}
    if any(np.any(np.isfinite(h) & (h > 0)) for h in histories.values()):
        charts.append(residual_history(histories))
    return [Picture(chart.svg(), "svg", chart.caption) for chart in charts]


def _saved_charts(folder: Path) -> list[Picture]:
    """Return the charts in a case's folder except the distributions, which `_charts_of` draws."""
    captions = {chart: chart.with_suffix(".txt") for chart in sorted(folder.glob("*.svg"))}
    return [
        Picture(chart.read_bytes(), "svg", caption.read_text("utf-8").strip())
        for chart, caption in captions.items()
        if chart.stem != "pressure-distribution" and caption.is_file()
    ]


def _maps(folder: Path, methods: Sequence[str]) -> list[Picture]:
    """Draw the contact of each method's first surface, and the differences on a common grid."""
    pictures, fields = [], {}
    for method in methods:
        candidates = [folder / f"{method}.vti", *sorted(folder.glob(f"{method}-*.vti"))]
        path = next((path for path in candidates if path.is_file()), None)
        if path is not None:
            fields[method] = path
            caption = f"Contact state and pressure by {method}, {path.name}."
            pictures.append(Picture(map_of_file(path, caption).png(110), "png", caption))
    for first, second in itertools.combinations(sorted(fields), 2):
        one, two = read_fields(fields[first]), read_fields(fields[second])
        if len(one.shape) == 2 and one.shape == two.shape and one.spacing == two.spacing:
            pressures = one.fields["pressure"], two.fields["pressure"]
            chart = pressure_difference(*pressures, one.spacing, names=(first, second))
            pictures.append(Picture(chart.png(110), "png", chart.caption))
    return pictures


def _films(folder: Path) -> list[Picture]:
    """Return the films of load paths, which `--fields film` draws."""
    return [
        Picture(film.read_bytes(), "gif", f"The loads of the path in order, {film.stem}.")
        for film in sorted(folder.glob("*-steps.gif"))
    ]


def _blocks(folder: Path, methods: Sequence[str]) -> tuple[list[Picture], list[str]]:
    """Draw each method's body, cut open; also return the reasons why some could not be drawn."""
    pictures, complaints = [], []
    for method in methods:
        collections = [*folder.glob(f"{method}*.pvd"), *folder.glob(f"{method}*/*.pvd")]
        bodies = [one for one in sorted(collections) if load_steps(one)[0].suffix == ".vtu"]
        for collection in bodies[:1]:
            with tempfile.TemporaryDirectory() as temporary:
                picture = Path(temporary) / "block.png"
                try:
                    screenshot(collection, picture, size=(1200, 600))
                except OutputError as error:
                    complaints.append(f"Left out of this page: {error}.")
                    continue
                caption = (
                    f"The body of {method}, cut open at the last load: von Mises stress and "
                    "plastic strain."
                )
                pictures.append(Picture(picture.read_bytes(), "png", caption))
    return pictures, complaints


def _read_json(path: Path) -> Any:
    try:
        return json.loads(read_bytes(path))
    except ValueError:
        raise OutputError(f"cannot read {path}: it is no JSON") from None
