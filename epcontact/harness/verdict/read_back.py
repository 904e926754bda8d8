"""Read back what a verification has written: figures that contradict each other are an
error.

`require_faithful` reads verdict.json and the answers as a user's script would: every
gate is judged again from the figures beside its status, every case and the whole from
their gates, every value, difference and interval from the members of the answers, by
code that nothing else uses.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

from pydantic_core import to_json

from epcontact.errors import OutputError
from epcontact.files import read_bytes

Data = Mapping[str, Any]  # the content of a JSON file

_ROUNDING = 1e-12
#: The files that say what a run found.
FILES = ("verdict.json", "junit.xml", "report.html")


def require_faithful(folder: Path) -> None:
    """Raise OutputError, and remove the verdict, if the files of a folder contradict
    each other.
    """
    if wrong := contradictions(json.loads(read_bytes(folder / "verdict.json")), folder):
        withdraw(folder)
        said = f"what was written in {folder} contradicts itself, so the verdict is withdrawn"
        raise OutputError(f"{said}: {'; '.join(wrong[:3])}")


def withdraw(folder: Path) -> None:
    """Remove the verdict of a run that ends in an error."""
    for name in FILES:
        (folder / name).unlink(missing_ok=True)


def digest_of(verdict: Data, folder: Path) -> str:
    """Return the SHA-256 of a verdict, and that of the answers on which it rests if any
    is here.
    """
    own = hashlib.sha256(
        to_json({k: part for k, part in verdict.items() if k != "digest"})
    )
    answers = b""
    for case in verdict["cases"]:
        here = folder / case["id"] / case["size"]
        for path in (
            here / f"{name}.json"
            for name, m in case["methods"].items()
            if m["surfaces"]
        ):
            answers += (
                hashlib.sha256(path.read_bytes()).digest() if path.is_file() else b""
            )
    return own.hexdigest() + (hashlib.sha256(answers).hexdigest() if answers else "")


def contradictions(verdict: Data, folder: Path) -> list[str]:
    """Return what of a verdict contradicts itself or the answers in its folder."""
    try:
        return list(_contradictions(verdict, folder))
    except (KeyError, TypeError, ValueError) as error:
        return [f"a part is missing or no number ({error!r})"]


def _contradictions(verdict: Data, folder: Path) -> Iterator[str]:
    for case in verdict["cases"]:
        wrong, here, answers = (
            [*_case_errors(case)],
            folder / case["id"] / case["size"],
            {},
        )
        for name, method in case["methods"].items():
            if method["surfaces"]:
                answers[name] = json.loads(read_bytes(here / f"{name}.json"))
                if len(answers[name]["members"]) != method["surfaces"]:
                    wrong.append(f"{name}.json has not {method['surfaces']} members")
        for gate in case["gates"]:
            if "value" in gate and gate["norm"] in ("relative", "absolute"):
                wrong += _gate_errors(gate, answers)
        yield from (f"{case['id']}: {sentence}" for sentence in wrong)
    worst = _worst(case["status"] for case in verdict["cases"])
    exit_code = {"holds": 0, "falls short": 1, "error": 2}[worst]
    if (verdict["exit_code"], verdict["passed"]) != (exit_code, exit_code == 0):
        yield f"the verdict says exit code {verdict['exit_code']} over cases of which one {worst}"


def _worst(statuses: Iterable[str]) -> str:
    found = set(statuses)
    return next(
        (status for status in ("error", "falls short") if status in found), "holds"
    )


def _case_errors(case: Data) -> Iterator[str]:
    """Judge again: each gate by its figures, the case by its gates."""
    for gate in case["gates"]:
        if gate["status"] != _status(gate):
            yield f"{gate['name']} says {gate['status']!r} beside its figures"
    failed = any(method["errors"] for method in case["methods"].values())
    worst = _worst([gate["status"] for gate in case["gates"]] + ["error"] * failed)
    if case["status"] != ("skipped" if case["skipped_because"] else worst):
        yield f"the case says {case['status']!r} over its gates"


def _status(gate: Data) -> str:
    if "difference" not in gate:
        return "error"
    mean, scatter = (
        float(gate["difference"][name]) for name in ("mean", "half_width_95")
    )
    half_width = math.hypot(scatter, float(gate.get("grid_error", 0.0)))
    above = float(gate["low"]) <= mean - half_width
    return (
        "holds" if above and mean + half_width <= float(gate["high"]) else "falls short"
    )


def _gate_errors(gate: Data, answers: Mapping[str, Data]) -> Iterator[str]:
    """Compute the difference of a gate on a scalar again, with its interval, from the
    members.
    """
    of, against = answers[gate["of"]], answers.get(str(gate["against"]))
    values, references = (
        _values(of, gate["quantity"]),
        [float(gate["reference"]["mean"])],
    )
    if against is not None:
        references = _values(against, gate["quantity"])
    a, b, relative = fmean(values), fmean(references), gate["norm"] == "relative"
    if (
        against
        and len(values) > 1
        and of["ensemble"]["surfaces"] == against["ensemble"]["surfaces"]
    ):
        pairs = zip(values, references, strict=True)
        differences = [_deviation(*pair, relative) for pair in pairs]
        found = (a, fmean(differences), _half_width(differences))
    else:
        scale = (abs(b) or math.inf) if relative else 1.0
        slope = a / scale if relative else 1.0
        width = math.hypot(_half_width(values), slope * _half_width(references)) / scale
        found = (a, _deviation(a, b, relative), width)
    names = ("value", "difference", "95 % interval")
    shown = (
        gate["value"]["mean"],
        *(gate["difference"][k] for k in ("mean", "half_width_95")),
    )
    # A difference of two sums has lost digits: what is left of them is that of its
    # terms.
    lost = _ROUNDING * (1.0 if relative else max(map(abs, (*values, *references))))
    for name, theirs, mine in zip(names, shown, found, strict=True):
        if not _equal(theirs, mine, lost):
            yield f"{gate['name']} has a {name} of {theirs}, and its members have {mine:.6g}"


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
    """Return a quantity of the last load step of each member."""
    group, _, name = quantity.partition(".")
    part, _, kind = name.partition(".")
    places = {
        "area": ("areas", kind, part),
        "quantity": ("quantities", name),
        "residual": ("residuals", name),
        "iterations": ("iterations", name),
    }
    values = []
    for member in answer["members"]:
        found: Any = (
            {"cost": member["cost"]} if group == "cost" else member["steps"][-1]
        )
        for key in places.get(group, quantity.split(".")):
            found = found[key]
        values.append(float(found))
    return values


def _equal(first: Any, second: float, lost: float = 0.0) -> bool:
    a = float(first)
    close = math.isclose(a, second, rel_tol=_ROUNDING, abs_tol=lost)
    return close or (math.isnan(a) and math.isnan(second))
