"""The report of a verification: one self-contained HTML page.

The template `report.html.jinja` beside this file is filled with the content of
`verdict.json`, of the methods' JSON files and of the pictures beside them; jinja2
escapes all of it.  The page loads nothing from other hosts, and its content-security
policy makes the browser enforce that.  It needs no script, follows the reader's choice
of light or dark, and fits a phone.
"""

from __future__ import annotations

import base64
import collections
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
    require_replaceable,
    write_text,
)
from epcontact.output.charts.figures import PAGE_ENDINGS, Pictures
from epcontact.output.charts.style import CYCLE, difference_text, unit_for
from epcontact.output.loads import connection_sentences, load_cells
from epcontact.results import ContactResult

Data = Mapping[str, Any]  # the content of a JSON file
#: Draws the results of cases.  The argument has the paths of the methods' JSON files by
#: the ids of the cases; the result has the pictures in the folder of these files.
Draw = Callable[[Mapping[str, Sequence[Path]]], Mapping[str, Pictures]]

#: Side of the picture of areas against their references, in units of its drawing.
PARITY_SIZE = 300
#: Relative width of the grey band around the diagonal of that picture, to each side.
PARITY_BAND = 0.1
#: The statuses of cases in the order in which the page counts them.
_STATUSES = ("holds", "falls short", "error", "skipped")
#: A longer list of numbers is shown by its first three and its last.
_LONGEST_LIST = 8


def report_folder(
    folder: Path | str,
    verdict: Data,
    path: Path | str | None = None,
    *,
    overview: Data,
    draw: Draw,
) -> Path:
    """Draw the pictures of a verification and write its page.

    No file outside of the folder is read.  The page is the only file that may be
    written outside of it, if `path` leads there.

    Args:
        folder: the output folder of the verification.
        verdict: the content of its verdict.json.
        path: the page to write; None: report.html in the folder.
        overview: the first screen of the page, see `harness.verdict.overview`.
        draw: draws the pictures of the cases; the page shows these.

    Returns:
        The path of the page.

    Raises:
        OutputError: if a file cannot be read or written, or if a name in the verdict or
            a link leads out of the folder; or if `path` is another file than a report.
    """
    home = Path(folder)
    target = home / "report.html" if path is None else Path(path)
    require_replaceable(target, "<title>epcontact: verification report</title>")
    require_links_inside(home)
    results: dict[str, dict[str, Data]] = {}
    files: dict[str, list[Path]] = {}
    for case in verdict["cases"]:
        name = case["id"]
        case_folder = path_inside(home, f"{name}/{case['size']}")
        results[name] = {}
        files[name] = []
        for method in case["methods"]:
            file = path_inside(case_folder, f"{method}.json")
            if file.is_file():
                results[name][method] = _read_json(file)
                files[name].append(file)
    pictures: dict[str, list[dict[str, str]]] = {}
    missing: list[str] = []
    first_places: dict[str, str] = {}
    for name, drawn in draw(files).items():
        folder_of_case = files[name][0].parent
        pictures[name] = _pictures(folder_of_case, drawn.names, name, first_places)
        missing += drawn.missing
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
    """Write the page of a verification.

    Args:
        path: the page to write.
        verdict: the content of verdict.json.
        results: the content of the methods' JSON files, by case and method.
        pictures: the pictures of each case.  One has its `name`, the data of its file
            as a `uri`, a `caption`, and the id of the `case` that shows the same
            picture first.
        notes: sentences for the top of the page.
        overview: the first screen, see `harness.verdict.overview`; None: there is none.

    Raises:
        OutputError: if the page cannot be written.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("epcontact.output", ""),
        autoescape=True,
        undefined=jinja2.ChainableUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": number_text,
        "counts": _counts,
        "listed": _listed,
        "load_cells": load_cells,
        "connections": _connections,
        "computed": _scene_rows,
        "sentence": _sentence,
        "notes": _notes,
        "parity": _parity,
        "per_cent": _per_cent,
        "difference": difference_text,
    }
    cases = collections.Counter(case["status"] for case in verdict["cases"])
    counts = [f"{cases[status]} {status}" for status in _STATUSES if cases[status]]
    page = environment.get_template("report.html.jinja").render(
        verdict=verdict,
        results=results,
        pictures=pictures or {},
        notes=notes,
        overview=overview or {},
        cases=_in_order(verdict["cases"], overview or {}),
        counts=", ".join(counts),
    )
    write_text(path, f"{page}\n")


def _in_order(cases: Sequence[Data], overview: Data) -> list[tuple[str, Data]]:
    """Return cases in the order of the page's list of cases, each with its subject.

    Args:
        cases: the cases of verdict.json.
        overview: the first screen, see `harness.verdict.overview`.  If it has no list
            of cases, their order is kept and their subjects are "".
    """
    if "subjects" not in overview:
        return [("", case) for case in cases]
    by_id = {case["id"]: case for case in cases}
    ordered = []
    for subject, rows in overview["subjects"].items():
        ordered += [(subject, by_id[row["id"]]) for row in rows]
    return ordered


def number_text(value: Any, digits: int = 4) -> str:
    """Return a number of a JSON file as text.

    Args:
        value: a number, or a text such as "inf" that stands for one.
        digits: the number of significant digits.

    Returns:
        The number with these digits; "–" for NaN, "" for None, and a text that is no
        number unchanged.
    """
    try:
        number = float(value)
    except (TypeError, ValueError, jinja2.UndefinedError):
        if value is None:
            return ""
        return str(value)
    if math.isnan(number):
        return "–"
    return f"{number:.{digits}g}"


def value_text(value: Any, unit: str) -> str:
    """Return a value that describes a scene as text.

    Args:
        value: a number, a list of numbers, or words.
        unit: the SI unit of the numbers; "–" for numbers without one, "" for words.

    Returns:
        The value with a prefixed unit that suits it.  Lists of pressures are joined by
        commas, others as dimensions, and "none" stands for a value that is not finite.
    """
    if unit == "" or isinstance(value, bool):
        return str(value)
    numbers = value if isinstance(value, list) else [value]
    values = [float(number) for number in numbers]
    if not all(map(math.isfinite, values)):
        return "none"  # such as an infinite hardness
    scale, prefixed_unit = 1.0, ""
    if unit != "–":
        scale, prefixed_unit = unit_for(max(map(abs, values)), unit)
    digits = 4
    if unit == "–" and isinstance(value, list):
        digits = 9  # numbers of grid points
    texts = [f"{number / scale:.{digits}g}" for number in values]
    if len(texts) > _LONGEST_LIST:
        texts = [*texts[:3], f"… {len(texts) - 4} more …", texts[-1]]
    separator = " × "
    if unit == "Pa":
        separator = ", "
    return f"{separator.join(texts)} {prefixed_unit}".rstrip()


def _sentence(text: str) -> str:
    """Return a text as a sentence: with a capital letter and one full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('. ')}."


def _listed(values: Data) -> str:
    """Return names and values in one line, such as "numpy 2.3, scipy 1.16".

    Args:
        values: words or numbers by their names.
    """
    return ", ".join(f"{name} {value}" for name, value in values.items())


def _counts(values: Data, digits: int, without: Sequence[str] = ()) -> str:
    """Return names and numbers in one line, such as "fft pairs 120, seconds 0.5".

    Args:
        values: numbers by their names, in any unit.  Underscores in names become
            spaces.
        digits: the number of significant digits.
        without: the names that are left out.
    """
    texts = [
        f"{name.replace('_', ' ')} {number_text(value, digits)}"
        for name, value in values.items()
        if name not in without
    ]
    return ", ".join(texts)


def _scene_rows(results: Mapping[str, Data]) -> list[dict[str, Any]]:
    """Return the description of the scene that the methods solved, for a table.

    Args:
        results: the content of the JSON file of each method, by the methods' names.
            The first one that describes its scene is used.

    Returns:
        A row for each value: a dictionary with its `name`, the `value`, its `meaning`
        and, as `shown`, its text with a unit.  A last row lists the surfaces if there
        are several.
    """
    rows: list[dict[str, Any]] = []
    for result in results.values():
        description = result["provenance"].get("about")
        if description:
            for name, entry in description.items():
                text = value_text(entry["value"], entry["unit"])
                rows.append({"name": name, **entry, "shown": text})
            break
    labels = (result["ensemble"]["surfaces"] for result in results.values())
    surfaces = max(labels, key=len, default=())
    if rows and len(surfaces) > 1:
        row = {"name": "surfaces", "value": surfaces, "meaning": "surfaces"}
        text = f"{len(surfaces)} ({', '.join(surfaces)})"
        row["shown"] = f"{text}; the figures above are of the first"
        rows.append(row)
    return rows


def _notes(results: Mapping[str, Data]) -> list[str]:
    """Return a sentence for each note of the methods, with the methods that gave it.

    Args:
        results: the content of the JSON file of each method, by the methods' names.
            The notes of all its surfaces are read; equal notes become one sentence.
    """
    methods_by_note: dict[str, dict[str, None]] = {}
    for method, result in results.items():
        for member in result["members"]:
            for note in member["notes"]:
                methods_by_note.setdefault(note, {})[method] = None
    return [
        f"Note by {', '.join(methods)}: {note}."
        for note, methods in methods_by_note.items()
    ]


def _per_cent(value: Any, norm: str) -> str:
    """Return a difference or an end of a band as text with its sign.

    A relative one is in per cent.

    Args:
        value: the number.
        norm: the norm of its gate.
    """
    number = float(value)
    if norm == "relative":
        return f"{100 * number:+.3g}\N{NO-BREAK SPACE}%"
    return f"{number:+.3g}"


def _parity(points: Sequence[Any]) -> dict[str, Any]:
    """Return the geometry of the picture of areas against their references.

    The axes are logarithmic, from a power of ten to 1, in a square of `PARITY_SIZE`
    units with y downwards.

    Args:
        points: areas with `case`, `part`, `pair`, `reference`, `value`, `error`, `low`
            and `high`, see `harness.verdict.overview.AreaPoint`.

    Returns:
        A dictionary with the `size` of the square, the `ticks` (text and position), the
        `shift` from the diagonal to the end of the band of `PARITY_BAND`, the `marks`
        (for each point its data, its colour, x and y, and the ends of its error and of
        its band along y), the colours of the `pairs`, and the `parts` that occur.
    """
    smallest = min(min(point.reference, point.value) for point in points)
    decades = max(1, math.ceil(-math.log10(smallest)))
    size = PARITY_SIZE

    def position(area: float) -> float:
        """Return the distance of an area from the left or the lower edge."""
        bounded = min(max(area, 10.0**-decades), 1.0)
        return size * (1 + math.log10(bounded) / decades)

    pairs = list(dict.fromkeys(point.pair for point in points))
    colours = {pair: CYCLE[i % len(CYCLE)] for i, pair in enumerate(pairs)}
    marks = []
    for point in points:
        marks.append(
            {
                "point": point,
                "colour": colours[point.pair],
                "x": position(point.reference),
                "y": size - position(point.value),
                "error": [
                    size - position(point.value - point.error),
                    size - position(point.value + point.error),
                ],
                "band": [size - position(point.low), size - position(point.high)],
            }
        )
    ticks = [(f"{10.0**-k:g}", position(10.0**-k)) for k in range(decades + 1)]
    shift = size * math.log10(1 + PARITY_BAND) / decades
    return {
        "size": size,
        "ticks": ticks,
        "shift": shift,
        "marks": marks,
        "pairs": colours,
        "parts": list(dict.fromkeys(point.part for point in points)),
    }


def _connections(members: Sequence[Data]) -> list[str]:
    """Return the sentences on what connects across the surfaces of a method.

    `members` are the results for each surface, from the method's JSON file; see
    `connection_sentences`.
    """
    return connection_sentences([*map(ContactResult.from_json, members)])


def _pictures(
    folder: Path, names: Sequence[str], case_id: str, first_places: dict[str, str]
) -> list[dict[str, str]]:
    """Return the pictures of a case with their captions, for the page.

    Args:
        folder: the folder of the pictures.
        names: the names of the pictures without endings.
        case_id: the id of the case.
        first_places: the case that shows a picture first, by the picture's `uri`.
            Cases are added to it.

    Returns:
        For each picture that has a file: its `name`, its content as a data `uri`, its
        `caption`, and the `case` that shows the same picture first, in the alphabetical
        order of the names.

    Raises:
        OutputError: if a file cannot be read.
    """
    pictures = []
    for caption_file in sorted(folder / f"{name}.txt" for name in names):
        for ending in PAGE_ENDINGS:
            file = caption_file.with_suffix(ending)
            if file.is_file():
                content = base64.b64encode(read_bytes(file)).decode()
                caption = read_bytes(caption_file).decode("utf-8", "replace")
                uri = f"data:image/{ending[1:]};base64,{content}"
                case = first_places.setdefault(uri, case_id)
                picture = {"name": caption_file.stem, "caption": caption.strip()}
                pictures.append(picture | {"uri": uri, "case": case})
                break
    return pictures


def _read_json(path: Path) -> Any:
    """Return the content of a JSON file.

    Raises OutputError if the file cannot be read or is not JSON.
    """
    try:
        return json.loads(read_bytes(path))
    except (ValueError, RecursionError):
        raise OutputError(f"cannot read {path}: it is no JSON") from None
