"""Faults of what a person reads, of solvers from outside, of files, and of quantities'
values.

Each row of `read.tsv` replaces a text of a function or of the report's template, or
multiplies what a function returns (×); a test sees it, or a case's gate.
"""

import csv
from pathlib import Path

from breaking.fault import Fault, changed, edited, scaled


def _template(_, old, new):
    """The template of the report with one text in the place of another."""

    def change(original):
        def wrong(environment, name):
            text = environment.loader.get_source(environment, name)[0]
            assert old in text, f"the template does not hold {old}"
            return environment.from_string(text.replace(old, new))

        return wrong

    return changed("jinja2.Environment.get_template", change)


with Path(__file__).with_suffix(".tsv").open(encoding="utf-8", newline="") as _file:
    _rows = list(csv.reader(_file, "excel-tab", quoting=csv.QUOTE_NONE))[1:]
FAULTS = tuple(
    Fault(
        what,
        path.split(".")[path[:3] == "epc"],
        scaled(path, float(new))
        if old == "×"
        else (_template if path.endswith(".jinja") else edited)(path, old, new),
        *gate.split(),
        test="" if gate else test,
    )
    for what, path, old, new, test in _rows
    for gate in [test * (" " in test)]
)
