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
from epcontact.files import (
    path_inside,
    read_bytes,
    require_links_inside,
    write_text,
)
from epcontact.output.charts.figures import Pictures
from epcontact.output.charts.style import unit_for
from epcontact.output.loads import load_cells

Data = Mapping[str, Any]  # the content of a JSON file
#: Draws the results of a case into its folder.  The arguments are the id of the case,
#: the content of the JSON file of each method, and the folder.
Draw = Callable[[str, Mapping[str, Data], Path], Pictures]

_MEDIA_TYPES = {".svg": "image/svg+xml", ".png": "image/png", ".gif": "image/gif"}


def report_folder(
    folder: Path | str,
    verdict: Data,
    path: Path | str | None = None,
    *,
    overview: Data,
    draw: Draw,
) -> Path:
    """Draw the pictures of a verification and write its page.

    Nothing outside of the folder is read or written but the page, if `path` says so.

    Args:
        folder: the output folder of the verification.
        verdict: the content of its verdict.json.
        path: the page to write; None: report.html in the folder.
        overview: the first screen of the page, see `harness.verdict.overview`.
        draw: draws the pictures of each case; the page shows these.

    Returns:
        The path of the page.

    Raises:
        OutputError: if a file cannot be read or written, or if a name in the verdict or
            a link leads out of the folder.
    """
    home = Path(folder)
    require_links_inside(home)
    results: dict[str, dict[str, Data]] = {}
    pictures: dict[str, list[dict[str, str]]] = {}
    missing: list[str] = []
    for case in verdict["cases"]:
        name = case["id"]
        case_folder = path_inside(home, f"{name}/{case['size']}")
        results[name] = {}
        for method in case["methods"]:
            file = path_inside(case_folder, f"{method}.json")
            if file.is_file():
                results[name][method] = _read_json(file)
        drawn = draw(name, results[name], case_folder)
        pictures[name] = _pictures(case_folder, drawn.names)
        missing += drawn.missing
    target = home / "report.html" if path is None else Path(path)
    notes = list(dict.fromkeys(missing))
    write_report(target, verdict, results, pictures, notes, overview)
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


def _pictures(folder: Path, names: Sequence[str]) -> list[dict[str, str]]:
    """Return the data and the captions of pictures, as .svg where there are several
    kinds of one.
    """
    pictures = []
    for caption_file in sorted(folder / f"{name}.txt" for name in names):
        for ending, media_type in _MEDIA_TYPES.items():
            file = caption_file.with_suffix(ending)
            if file.is_file():
                content = base64.b64encode(read_bytes(file)).decode()
                caption = read_bytes(caption_file).decode("utf-8", "replace")
                uri = f"data:{media_type};base64,{content}"
                pictures.append({"uri": uri, "caption": caption.strip()})
                break
    return pictures


def _read_json(path: Path) -> Any:
    try:
        return json.loads(read_bytes(path))
    except (ValueError, RecursionError):
        raise OutputError(f"cannot read {path}: it is no JSON") from None
