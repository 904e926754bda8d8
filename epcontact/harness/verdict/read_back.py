"""Read back what a verification has written: a file that says something else is an error.

`require_faithful` reads verdict.json, junit.xml and the answers of the methods as a user's script
would, and checks them against each other: every gate is judged again from the figures that stand
beside its status, every case and the whole from their gates, every value, difference and interval
from the members of the answers.  It shares no code with `gate`, `judgement`, `files` and `store`,
which wrote the files.
"""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

from epcontact.errors import OutputError
from epcontact.output.files import read_bytes

Data = Mapping[str, Any]  # the content of a JSON file

_SCALARS = {"quantity": "quantities", "residual": "residuals", "iterations": "iterations"}
_ROUNDING = 1e-12
_JUNIT = {"falls short": "failure", "error": "error"}


def require_faithful(folder: Path, verdict: Data) -> None:
    """Check the files of a verification against each other; remove those that contradict.

    Args:
        folder: the output folder.
        verdict: the content that verdict.json must have.

    Raises:
        OutputError: if a file cannot be read, or says something else than the others.
    """
    try:
        wrong = list(_contradictions(folder, verdict))
    except (KeyError, TypeError, ValueError, ET.ParseError) as error:
        wrong = [f"a part is missing or no number ({error!r})"]
    if wrong:
        for name in ("verdict.json", "junit.xml"):
            (folder / name).unlink(missing_ok=True)
        raise OutputError(
            f"what was written in {folder} contradicts itself, so the verdict is withdrawn: "
            f"{'; '.join(wrong[:3])}"
        )


def _contradictions(folder: Path, verdict: Data) -> Iterator[str]:
    if json.loads(read_bytes(folder / "verdict.json")) != verdict:
        yield "verdict.json does not hold the verdict that was written into it"
    yield from _verdict_errors(verdict)
    yield from _junit_errors(folder / "junit.xml", verdict)
    for case in verdict["cases"]:
        here = folder / case["id"] / case["size"]
        answers = {
            name: json.loads(read_bytes(here / f"{name}.json"))
            for name, entry in case["methods"].items()
            if entry["surfaces"]
        }
        for name, answer in answers.items():
            for sentence in _answer_errors(answer, case["methods"][name]["surfaces"]):
                yield f"{case['id']}: {name}.json {sentence}"
        for gate in case["gates"]:
            if "value" in gate and gate["norm"] in ("relative", "absolute"):
                yield from (f"{case['id']}: {sentence}" for sentence in _gate_errors(gate, answers))


def _verdict_errors(verdict: Data) -> Iterator[str]:
    """Judge again: each gate by its figures, each case by its gates, the whole by its cases."""
    for case in verdict["cases"]:
        found = set()
        for gate in case["gates"]:
            found.add(gate["status"])
            if gate["status"] != _status(gate):
                yield f"{case['id']}: {gate['name']} says {gate['status']!r} beside its figures"
        if any(method["errors"] for method in case["methods"].values()):
            found.add("error")
        if case["status"] != ("skipped" if case["skipped_because"] else _worst(found)):
            yield f"{case['id']} says {case['status']!r} over its gates"
    worst = _worst({case["status"] for case in verdict["cases"]})
    exit_code = {"holds": 0, "falls short": 1, "error": 2}[worst]
    if (verdict["exit_code"], verdict["passed"]) != (exit_code, exit_code == 0):
        yield f"the verdict says exit code {verdict['exit_code']} over cases of which one {worst}"


def _status(gate: Data) -> str:
    if "difference" not in gate:
        return "error"
    mean, scatter, grid_error, low, high = (
        float(x)
        for x in (
            gate["difference"]["mean"], gate["difference"]["half_width_95"],
            gate.get("grid_error", 0.0), gate["low"], gate["high"],
        )
    )  # fmt: skip
    half_width = math.hypot(scatter, grid_error)
    inside = low <= mean - half_width and mean + half_width <= high
    return "holds" if inside else "falls short"


def _worst(statuses: set[str]) -> str:
    return next((status for status in ("error", "falls short") if status in statuses), "holds")


def _junit_errors(path: Path, verdict: Data) -> Iterator[str]:
    suites = {suite.get("name"): suite for suite in ET.fromstring(read_bytes(path))}
    for case in verdict["cases"]:
        if case["id"] not in suites:
            yield f"{path.name} has no suite {case['id']}"
            continue
        tests = suites[case["id"]].findall("testcase")
        shown = Counter(child.tag for test in tests for child in test)
        wanted = Counter(
            _JUNIT[gate["status"]] for gate in case["gates"] if gate["status"] in _JUNIT
        )
        fewer = any(shown[tag] < count for tag, count in wanted.items())
        # A method that no gate reads adds an error of its own.
        if fewer or shown["failure"] != wanted["failure"] or len(tests) < len(case["gates"]):
            yield f"{path.name} shows {dict(shown)} for gates that call for {dict(wanted)}"


def _answer_errors(answer: Data, surfaces: int) -> Iterator[str]:
    """Compare the figures of a method's answer with those of its members."""
    members, labels = answer["members"], answer["ensemble"]["surfaces"]
    if not len(members) == len(labels) == surfaces:
        yield f"has {len(members)} members, and the verdict {surfaces}"
    for member, label in zip(members, labels, strict=False):
        made = member["provenance"]  # a solver from outside need not know its seed
        known = label.startswith("seed") and "solver" not in made["options"]
        if known and label != f"seed{made['seed']}":
            yield f"calls the surface of seed {made['seed']} {label}"
    for kind, parts in answer["areas"].items():
        for part, mean in parts.items():
            if not _equal(mean, fmean(_values(answer, f"area.{part}.{kind}"))):
                yield f"has a mean {kind} {part} area that is not that of its members"
    for residual, worst in answer["residuals"].items():
        if not _equal(worst, max(_values(answer, f"residual.{residual}"))):
            yield f"has a residual {residual} that is not the largest of its members"


def _gate_errors(gate: Data, answers: Mapping[str, Data]) -> Iterator[str]:
    """Compute the difference of a gate on a scalar again, with its interval, from the members."""
    of, against = answers[gate["of"]], answers.get(str(gate["against"]))
    values = _values(of, gate["quantity"])
    references = [float(gate["reference"]["mean"])]
    if against is not None:
        references = _values(against, gate["quantity"])
    relative = gate["norm"] == "relative"
    labels = [answer["ensemble"]["surfaces"] for answer in (of, against) if answer is not None]
    if len(values) > 1 and len(labels) == 2 and labels[0] == labels[1]:
        differences = [_deviation(a, b, relative) for a, b in zip(values, references, strict=True)]
        found = (fmean(values), fmean(differences), _half_width(differences))
    else:
        a, b = fmean(values), fmean(references)
        scale = (abs(b) or math.inf) if relative else 1.0
        slope = a / scale if relative else 1.0
        width = math.hypot(_half_width(values), slope * _half_width(references)) / scale
        found = (a, _deviation(a, b, relative), width)
    names = ("value", "difference", "95 % interval")
    shown = (gate["value"]["mean"], *(gate["difference"][k] for k in ("mean", "half_width_95")))
    # A difference of two sums has lost digits: what is left of them is that of its terms.
    lost = _ROUNDING * (1.0 if relative else max(map(abs, (*values, *references))))
    for name, theirs, mine in zip(names, shown, found, strict=True):
        if not _equal(theirs, mine, lost):
            yield f"{gate['name']} has a {name} of {theirs}, and its members have {mine:.6g}"
    unit = fmean(references) if relative else 1.0
    found_error = _grid_error(gate, of, against) / (abs(unit) or math.inf)
    if not _equal(gate.get("grid_error", 0.0), found_error):
        yield f"{gate['name']} has a grid error that is not claimed by its members"


def _grid_error(gate: Data, of: Data, against: Data | None) -> float:
    """Return the smaller claim of two sides, of one beside a theory or a number; 0 for none."""
    area, _, kind = gate["quantity"].rpartition(".")
    if kind != "corrected" or (against is None and isinstance(gate["against"], str)):
        return 0.0
    sides = [side for side in (of, against) if side is not None and "error" in side["areas"]]
    claimed = [fmean(_values(side, f"{area}.error")) for side in sides]
    return min((math.inf if math.isnan(c) else c for c in claimed if c), default=0.0)


def _deviation(value: float, reference: float, relative: bool) -> float:
    if not relative:
        return value - reference
    if reference == 0:
        return 0.0 if value == 0 else math.copysign(math.inf, value)
    return (value - reference) / abs(reference)


def _half_width(values: Sequence[float]) -> float:
    """Return half of Student's 95 % interval of a mean; 0 for one value."""
    # Imported here: scipy.special takes a third of the time of `epcontact --help`.
    from scipy.special import stdtrit

    n = len(values)
    if n == 1 or not all(map(math.isfinite, values)):
        return 0.0 if n == 1 else math.nan
    return float(stdtrit(n - 1, 0.975)) * stdev(values) / math.sqrt(n)


def _values(answer: Data, quantity: str) -> list[float]:
    return [_figure(member, quantity) for member in answer["members"]]


def _figure(member: Data, quantity: str) -> float:
    """Return a quantity of the last load step of a member."""
    last, (group, _, name) = member["steps"][-1], quantity.partition(".")
    if group == "area":
        part, _, kind = name.partition(".")
        return float(last["areas"][kind][part])
    if group == "cost":
        return float(member["cost"][name])
    return float(last[_SCALARS[group]][name] if group in _SCALARS else last[group])


def _equal(first: Any, second: float, lost: float = 0.0) -> bool:
    a = float(first)
    both = math.isnan(a) and math.isnan(second)
    return both or a == second or abs(a - second) <= lost + _ROUNDING * max(abs(a), abs(second))
