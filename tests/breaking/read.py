"""Faults of what a person reads, of solvers from outside, of files, and of quantities' values.

Each row of `read.tsv` replaces a text of a function; a test sees it, or a case's gate.
"""

import csv
from pathlib import Path

from breaking.fault import Fault, edited

with Path(__file__).with_suffix(".tsv").open(encoding="utf-8", newline="") as _file:
    _rows = list(csv.reader(_file, "excel-tab", quoting=csv.QUOTE_NONE))[1:]
FAULTS = tuple(
    Fault(what, "read", edited(path, old, new), *gate.split(), test="" if gate else test)
    for what, path, old, new, test in _rows
    for gate in [test * (" " in test)]
)
