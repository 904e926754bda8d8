"""Read a report back: its heading, statuses and figures must be those that it was made from.

A cell of the page says by its `data-` attributes what it shows.  The template and the numbers come
from different files, so a column that shows another one's numbers would otherwise be seen by
nobody.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from html.parser import HTMLParser
from typing import Any

Data = Mapping[str, Any]  # the content of a JSON file


class _Page(HTMLParser):
    """The heading of a page, and its cells with `data-` attributes: attributes and text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.heading = ""
        self.cells: list[tuple[dict[str, str], str]] = []
        self._inside = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        data = {name[5:]: value or "" for name, value in attrs if name.startswith("data-")}
        if tag == "td" and data:
            self.cells.append((data, ""))
        if tag in ("td", "h1"):
            self._inside = "cell" if tag == "td" and data else tag

    def handle_endtag(self, tag: str) -> None:
        if tag in ("td", "h1"):
            self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside == "h1":
            self.heading += data
        elif self._inside == "cell":
            about, text = self.cells[-1]
            self.cells[-1] = about, text + data


def contradictions(
    page: str, verdict: Data, results: Mapping[str, Mapping[str, Data]]
) -> Iterator[str]:
    """Yield a sentence for each place of a report that shows something else than it should.

    Args:
        page: The page.
        verdict: The content of verdict.json.
        results: The content of the methods' JSON files, by case and method.
    """
    read = _Page(page)
    status = "holds" if verdict["passed"] else "falls short"
    if not read.heading.strip().endswith(status):
        yield f"the heading is {read.heading.strip()!r} over a verdict that {status}"
    gates = [(case["id"], gate) for case in verdict["cases"] for gate in case["gates"]]
    rows = [cell for cell in read.cells if "field" in cell[0]]
    if [about["field"] for about, _ in rows] != list(_FIELDS) * len(gates):
        yield f"the page has {len(rows)} cells for {len(gates)} gates"
        return
    for (case, gate), row in zip(gates, _in_rows(rows), strict=True):
        for about, text in row:
            where = (about["case"], about["quantity"], about["of"])
            if where != (case, gate["quantity"], gate["of"]) or not _right(gate, about, text):
                yield f"{case}: the page shows {about['field']} {text!r} of {gate['quantity']}"
    for about, text in read.cells:
        if about.get("quantity", "").startswith("area.") and "method" in about:
            _, part, kind = about["quantity"].split(".")
            areas = results[about["case"]][about["method"]]["areas"]
            if not _shows(text, areas.get(kind, {}).get(part), 3):
                yield f"{about['case']}: the page shows {about['quantity']} as {text!r}"


_FIELDS = ("status", "value", "reference", "difference", "band")


def _in_rows(cells: list[Any]) -> Iterator[list[Any]]:
    for start in range(0, len(cells), len(_FIELDS)):
        yield cells[start : start + len(_FIELDS)]


def _right(gate: Data, about: Data, text: str) -> bool:
    """True if a cell shows what its gate says."""
    field = about["field"]
    if field == "status":
        return text.strip() == str(gate["status"])
    if field == "band":
        low, _, high = text.strip().strip("[]").partition(",")
        return _shows(low, gate["low"], 3) and _shows(high, gate["high"], 3)
    if field not in gate:
        return not text.strip()
    mean, _, half_width = text.partition("±")
    width = float(gate[field]["half_width_95"])
    narrow = not half_width and not width > 0
    return _shows(mean, gate[field]["mean"], 3) and (narrow or _shows(half_width, width, 2))


def _shows(text: str, value: Any, digits: int) -> bool:
    """True if a text is a number, rounded to some digits or more."""
    if value is None:
        return not text.strip()
    number = float(value)
    if math.isnan(number):
        return text.strip() == "–"
    try:
        read = float(text)
    except ValueError:
        return False
    return read == number or abs(read - number) <= 0.51 * 10.0 ** (1 - digits) * abs(number)
