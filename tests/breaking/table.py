"""Faults that are rows of `table.tsv`: what is wrong, where, and what sees it.

The columns are separated by tabs:

- what is wrong, in words;
- the dotted path of a function, or a template of `epcontact.output`;
- the place in the function: a pattern of code (see `breaking.rewrite`), or `result` for
  what the function returns; a text of a template;
- what it becomes: a pattern, an expression of `result`, or a text;
- what sees it: a test, or a case and the quantity whose gate turns red.
"""

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from breaking.fault import Fault, changed, on_result
from breaking.rewrite import StaleFault, change_function

#: Names that an expression of `result` may use.
NAMES = {"math": math, "np": np, "replace": replace}


def patch_of(path, place, becomes):
    """Return the patch of a row: a function of pytest's `monkeypatch`."""
    if path.endswith(".jinja"):
        return changed_template(place, becomes)
    if place == "result":
        expression = compile(becomes, path, "eval")
        return on_result(path, lambda result: eval(expression, NAMES, {place: result}))
    return changed_code(path, place, becomes)


def changed_code(path, place, becomes):
    """Patch a function in which the code at a place is another one.

    The code is exchanged in the function, so that it is known wherever the function is.
    """

    def patch(monkeypatch):
        function, code = change_function(path, place, becomes)
        monkeypatch.setattr(function, "__code__", code)

    return patch


def changed_template(place, becomes):
    """Patch the report's template with one text instead of another."""

    def change(get_template):
        def get_changed_template(environment, name):
            text = environment.loader.get_source(environment, name)[0]
            return environment.from_string(text.replace(place, becomes))

        return get_changed_template

    def patch(monkeypatch):
        if place not in TEMPLATE.read_text("utf-8"):
            raise StaleFault(f"the template does not hold {place}")
        changed("jinja2.Environment.get_template", change)(monkeypatch)

    return patch


def read_faults(file):
    """Return the faults of a table."""
    with file.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.reader(lines, "excel-tab", quoting=csv.QUOTE_NONE))
    return tuple(fault_of(*row) for row in rows[1:])


def fault_of(what, path, place, becomes, seen_by):
    """Return the fault of a row."""
    parts = path.split(".")
    room = parts[1] if parts[0] == "epcontact" else parts[0]
    patch = patch_of(path, place, becomes)
    row = {"path": path, "place": "" if path.endswith(".jinja") else place}
    if seen_by.startswith("tests/"):
        return Fault(what, room, patch, test=seen_by, **row)
    return Fault(what, room, patch, *seen_by.split(), **row)


FOLDER = Path(__file__).parent
TEMPLATE = FOLDER.parents[1] / "epcontact/output/report.html.jinja"
FAULTS = read_faults(FOLDER / "table.tsv")
