"""The report of a verification run: one self-contained HTML page of verdict, answers,
pictures.

The template `report.html.jinja` beside this file is filled with the content of
`verdict.json`, of the methods' JSON files and of the pictures beside them; jinja2
escapes all of it.  The page loads nothing from other hosts, and its content-security
policy makes the browser enforce that.  It needs no script, follows the reader's choice
of light or dark, and fits a phone.
"""

from __future__ import annotations

import base64
import collections
import itertools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2

from epcontact.errors import OutputError
from epcontact.files import read_bytes, write_text
from epcontact.output.charts.style import unit_for
from epcontact.output.loads import load_cells
from epcontact.results import ContactResult

Data = Mapping[str, Any]  # the content of a JSON file
#: Draws the results by method, one a surface, into a folder; returns what it could not
#: draw.
Draw = Callable[[Mapping[str, Sequence[ContactResult]], Path], Sequence[str]]

_MEDIA_TYPES = {".svg": "image/svg+xml", ".png": "image/png", ".gif": "image/gif"}


def report_folder(
    folder: Path | str,
    verdict: Data,
    path: Path | str | None = None,
    *,
    overview: Data,
    draw: Draw | None = None,
    notes: Sequence[str] = (),
) -> Path:
    """Make the page of a verdict (the content of verdict.json) in its folder, and
    return its path. The page shows every picture in a case's folder that has a caption
    (.txt) beside it.  `draw` draws some there first, from the results.  `overview` sums
    the verdict up, see `harness.verdict.overview`, and `notes` are sentences for the
    top.  Raises OutputError.
    """
    home = Path(folder)
    results, pictures = dict[str, dict[str, Data]](), dict[str, list[dict[str, str]]]()
    sentences = list(notes)
    for case in verdict["cases"]:
        here = home / case["id"] / case["size"]
        files = {method: here / f"{method}.json" for method in case["methods"]}
        answers = {
            method: _read_json(file) for method, file in files.items() if file.is_file()
        }
        if draw is not None:
            members = {
                m: map(ContactResult.from_json, a["members"])
                for m, a in answers.items()
            }
            sentences += draw(
                {method: list(found) for method, found in members.items()}, here
            )
        results[case["id"]], pictures[case["id"]] = answers, _pictures(here)
    target = Path(path) if path is not None else home / "report.html"
    write_report(
        target, verdict, results, pictures, list(dict.fromkeys(sentences)), overview
    )
    return target


def write_report(
    path: Path | str,
    verdict: Data,
    results: Mapping[str, Mapping[str, Data]],
    pictures: Mapping[str, Sequence[Mapping[str, str]]] | None = None,
    notes: Sequence[str] = (),
    overview: Data | None = None,
) -> None:
    """Write the page of a verdict, of the answers by case and method, and of pictures
    by case.  A picture has the data of its file as a `uri`, and a `caption`; the
    overview comes first.
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
        "listed": lambda values: ", ".join(
            f"{name} {value}" for name, value in values.items()
        ),
        "load_cells": load_cells,
        "computed": _computed,
        "sentence": lambda text: f"{text[:1].upper()}{text[1:].rstrip('. ')}.",
        "notes": _notes,
    }
    statuses = collections.Counter(case["status"] for case in verdict["cases"])
    order = ("holds", "falls short", "error", "skipped")
    counts = ", ".join(f"{statuses[s]} {s}" for s in order if statuses[s])
    told = {
        "verdict": verdict,
        "results": results,
        "pictures": pictures or {},
        "notes": notes,
    }
    told["overview"] = overview or {}
    page = environment.get_template("report.html.jinja").render(counts=counts, **told)
    write_text(path, page + "\n")


def number(value: Any, digits: int = 4) -> str:
    """Return a number of a JSON file as text, other text unchanged, '' for a missing
    value.
    """
    try:
        parsed = float(value)
    except (TypeError, ValueError, jinja2.UndefinedError):
        return "" if value is None else str(value)
    return "–" if math.isnan(parsed) else f"{parsed:.{digits}g}"


def shown(value: Any, unit: str) -> str:
    """Return a figure of a scene in words: with a unit that suits it, lists as
    dimensions.
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


def _counts(values: Data, digits: int, without: Sequence[str] = ()) -> str:
    """Return names and numbers in one line."""
    shown = {k.replace("_", " "): v for k, v in values.items() if k not in without}
    return ", ".join(f"{name} {number(value, digits)}" for name, value in shown.items())


def _computed(answers: Mapping[str, Data]) -> list[dict[str, Any]]:
    """Return the scene that the methods answered, one row for each of its figures."""
    told = (answer["provenance"].get("about") for answer in answers.values())
    rows = [
        {"name": name, **entry, "shown": shown(entry["value"], entry["unit"])}
        for name, entry in next(filter(None, told), {}).items()
    ]
    labels = (answer["ensemble"]["surfaces"] for answer in answers.values())
    surfaces = max(labels, key=len, default=())
    if rows and len(surfaces) > 1:
        words = f"{len(surfaces)} ({', '.join(surfaces)}); the figures above are of the first"
        rows.append(
            {
                "name": "surfaces",
                "value": surfaces,
                "meaning": "surfaces",
                "shown": words,
            }
        )
    return rows


def _notes(answers: Mapping[str, Data]) -> list[str]:
    """Return each note of the methods once, with the methods that gave it."""
    methods: dict[str, dict[str, None]] = {}
    for method, answer in answers.items():
        for note in itertools.chain.from_iterable(
            one["notes"] for one in answer["members"]
        ):
            methods.setdefault(note, {})[method] = None
    return [f"Note by {', '.join(names)}: {note}." for note, names in methods.items()]


def _pictures(folder: Path) -> list[dict[str, str]]:
    """Return each picture with a caption beside it, as .svg if there are several kinds
    of it.
    """
    pictures = []
    for caption in sorted(folder.glob("*.txt")):
        kinds = [kind for kind in _MEDIA_TYPES if caption.with_suffix(kind).is_file()]
        for kind in kinds[:1]:
            content = base64.b64encode(caption.with_suffix(kind).read_bytes()).decode()
            uri = f"data:{_MEDIA_TYPES[kind]};base64,{content}"
            pictures.append({"uri": uri, "caption": caption.read_text("utf-8").strip()})
    return pictures


def _read_json(path: Path) -> Any:
    try:
        return json.loads(read_bytes(path))
    except ValueError:
        raise OutputError(f"cannot read {path}: it is no JSON") from None
