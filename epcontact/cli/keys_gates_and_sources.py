"""The commands that show what there is: keys, schema, gates and cite."""

from __future__ import annotations

import json
from pathlib import Path

from epcontact.cli.main import print_text
from epcontact.cli.terminal import open_console, print_rows
from epcontact.harness.case_files.case import (
    find_case,
    find_cases,
    find_named,
    load_case,
)
from epcontact.harness.case_files.citations import citation
from epcontact.harness.case_files.mistakes import case_schema, key_table
from epcontact.harness.quantities.registry import QUANTITIES
from epcontact.harness.verdict.judgement import Verdict
from epcontact.harness.verdict.overview import margin_text
from epcontact.results import plain

#: Columns of a pipe or file: room for the reason of each gate in a line.
_PIPE = 300


def keys() -> None:
    """Print every key of a case file and every quantity of a gate, with its unit.

    The arguments are those of `commands.keys`.
    """
    quantities = [(q.name, q.unit, q.meaning) for q in QUANTITIES.values()]
    console = open_console()
    print_rows(console, ("table", "key", "default", "meaning"), key_table())
    console.print()
    print_rows(console, ("quantity of a gate", "unit", "meaning"), quantities)


def schema(kind: str) -> None:
    """Print the JSON Schema of a case file, or of verdict.json.

    The arguments are those of `commands.schema`.
    """
    if kind == "case":
        content = case_schema()
    else:
        content = Verdict.model_json_schema()
    print_text(json.dumps(plain(content), indent=2, allow_nan=False))


def cite(case: str, size: str) -> None:
    """Print the sources, papers and software versions that a case rests on.

    The arguments are those of `commands.cite`.
    """
    for line in citation(load_case(find_case(case), size)):
        print_text(line)


def gates(cases: tuple[str, ...], output: Path) -> None:
    """List the band, margin and reason of every gate.

    The arguments are those of `commands.gates`.
    """
    margins = _margins(output / "verdict.json")
    named = [text for name in cases for text in find_named(name)]
    rows = []
    for text in named or find_cases():
        for size in text.sizes:
            for gate in load_case(text, size).gates:
                margin = margins.get((text.id, size, gate.name), "–")
                band = f"{gate.low:g} … {gate.high:g}"
                rows.append((text.id, size, gate.name, band, margin, gate.because))
    console = open_console(pipe=_PIPE)
    print_rows(console, ("case", "size", "gate", "band", "margin", "because"), rows)


def _margins(file: Path) -> dict[tuple[str, str, str], str]:
    """Return the margin of each judged gate of a verdict, as a text.

    The keys are id of the case, size and name of the gate.  `file` is a verdict.json;
    if it does not exist, the result is empty.  Raises an EpcontactError if the file is
    not a verdict.
    """
    if not file.exists():
        return {}
    margins = {}
    for case in Verdict.read(file).cases:
        for gate in case.gates:
            if gate.difference is not None:
                margins[case.id, case.size, gate.name] = margin_text(gate)
    return margins
