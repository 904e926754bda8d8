"""Read back what a verification has written: a file that says something else is an error.

`require_faithful` reads verdict.json, junit.xml and the answers of the methods as a user's script
would: every gate is judged again from the figures beside its status, every case and the whole from
their gates, every value, difference and interval from the members of the answers.  It shares no
code with `gate`, `judgement`, `files` and `store`, which wrote the files.
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
from epcontact.files import read_bytes

Data = Mapping[str, Any]  # the content of a JSON file

_SCALARS = {"quantity": "quantities", "residual": "residuals", "iterations": "iterations"}
_ROUNDING = 1e-12


def require_faithful(folder: Path, verdict: Data) -> None:
    """Raise OutputError, and remove the files, if they do not hold `verdict` or contradict it."""
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
    suites = {s.get("name"): s for s in ET.fromstring(read_bytes(folder / "junit.xml"))}
    for case in verdict["cases"]:
        here = folder / case["id"] / case["size"]
        answers = {
            name: json.loads(read_bytes(here / f"{name}.json"))
            for name, entry in case["methods"].items()
            if entry["surfaces"]
        }
        wrong = [*_case_errors(case), *_junit_errors(suites.get(case["id"]), case["gates"])]
        for name, answer in answers.items():
            found = _answer_errors(answer, case["methods"][name]["surfaces"])
            wrong += [f"{name}.json {sentence}" for sentence in found]
        for gate in case["gates"]:
            if "value" in gate and gate["norm"] in ("relative", "absolute"):
                wrong += _gate_errors(gate, answers)
        yield from (f"{case['id']}: {sentence}" for sentence in wrong)
    worst = _worst({case["status"] for case in verdict["cases"]})
    exit_code = {"holds": 0, "falls short": 1, "error": 2}[worst]
    if (verdict["exit_code"], verdict["passed"]) != (exit_code, exit_code == 0):
        yield f"the verdict says exit code {verdict['exit_code']} over cases of which one {worst}"


def _worst(statuses: set[str]) -> str:
    return next((status for status in ("error", "falls short") if status in statuses), "holds")


def _case_errors(case: Data) -> Iterator[str]:
    """Judge again: each gate by its figures, the case by its gates."""
    for gate in case["gates"]:
        if gate["status"] != _status(gate):
            yield f"{gate['name']} says {gate['status']!r} beside its figures"
    found = {gate["status"] for gate in case["gates"]}
    if any(method["errors"] for method in case["methods"].values()):
        found.add("error")
    if case["status"] != ("skipped" if case["skipped_because"] else _worst(found)):
        yield f"the case says {case['status']!r} over its gates"


def _status(gate: Data) -> str:
    if "difference" not in gate:
        return "error"
    mean, scatter = (float(gate["difference"][name]) for name in ("mean", "half_width_95"))
    half_width = math.hypot(scatter, float(gate.get("grid_error", 0.0)))
    above = float(gate["low"]) <= mean - half_width
    return "holds" if above and mean + half_width <= float(gate["high"]) else "falls short"


def _junit_errors(suite: ET.Element | None, gates: Sequence[Data]) -> Iterator[str]:
    if suite is None:
        yield "junit.xml has no suite of its name"
        return
    shown = Counter(element.tag for element in suite.iter())
    wanted = Counter(gate["status"] for gate in gates)
    # A method that no gate reads adds an error of its own.
    fewer = shown["error"] < wanted["error"] or shown["testcase"] < len(gates)
    if fewer or shown["failure"] != wanted["falls short"]:
        yield f"junit.xml shows {dict(shown)} for gates of which {dict(wanted)}"


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
    values, references = _values(of, gate["quantity"]), [float(gate["reference"]["mean"])]
    if against is not None:
        references = _values(against, gate["quantity"])
    a, b, relative = fmean(values), fmean(references), gate["norm"] == "relative"
    scale = (abs(b) or math.inf) if relative else 1.0
    surfaces = [answer["ensemble"]["surfaces"] for answer in (of, against) if answer is not None]
    if len(values) > 1 and surfaces[1:] == surfaces[:1]:
        pairs = zip(values, references, strict=True)
        differences = [_deviation(*pair, relative) for pair in pairs]
        found = (a, fmean(differences), _half_width(differences))
    else:
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
    if not _equal(gate.get("grid_error", 0.0), _claimed(gate, of, against) / scale):
        yield f"{gate['name']} has a grid error that is not claimed by its members"


def _claimed(gate: Data, of: Data, against: Data | None) -> float:
    """Return the smaller claim of two sides, of one beside a theory or a number; 0 for none."""
    area, _, kind = gate["quantity"].rpartition(".")
    if kind != "corrected" or (against is None and isinstance(gate["against"], str)):
        return 0.0
    sides = [side for side in (of, against) if side is not None and "error" in side["areas"]]
    claimed = [fmean(_values(side, f"{area}.error")) for side in sides]
    return min((math.inf if math.isnan(c) else c for c in claimed if c), default=0.0)


def _deviation(value: float, reference: float, relative: bool) -> float:
    scale = abs(reference) if relative else 1.0
    if scale == 0:
        return 0.0 if value == 0 else math.copysign(math.inf, value)
    return (value - reference) / scale


def _half_width(values: Sequence[float]) -> float:
    """Return half of Student's 95 % interval of a mean; 0 for one value."""
    from scipy.special import stdtrit  # a third of the time of `epcontact --help`

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
