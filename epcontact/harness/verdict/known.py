"""Known comparisons, which the harness judges like any others: the judge is judged.

`solve` is the method `judge`: it runs intervals, distances, residuals and verdicts whose answers
are known by hand, and reports how far the harness is from them.  A wrong status raises, so that it
shows even where comparisons no longer do.  The numbers below are worked out with Student's factors
t(0.975) = 12.7062047361747 at 1, 4.30265272974946 at 2 and 3.18244630528371 at 3 degrees of
freedom, and with elementary integrals of uniform distributions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import fem_check
from epcontact.errors import InvalidCase
from epcontact.harness.answers.store import Answer
from epcontact.harness.case_files.case import Case, CaseText, load_case
from epcontact.harness.crosscheck import error_budget
from epcontact.harness.gates.distances import difference, distance
from epcontact.harness.gates.gate import ERROR, FALLS_SHORT, HOLDS, GateVerdict
from epcontact.harness.quantities.registry import measure
from epcontact.harness.verdict.judgement import judge_case
from epcontact.harness.verdict.record import SKIPPED, Verdict
from epcontact.results import (
    APART,
    ELASTIC,
    PLASTIC,
    Areas,
    ContactResult,
    FloatArray,
    LoadStep,
    PressureDistribution,
    Provenance,
)
from epcontact.scene import Body, Load, Material, Scene, Surface
from fem_check.certify import certify
from fem_check.driver import solve_path

#: Two values by method and surface, with the same surfaces in either order.
VALUES = {"bem": (1.0, 2.0, 4.0), "fem": (1.1, 1.9, 4.4)}


def solve(scene: Scene) -> ContactResult:
    """Judge the known comparisons; the scene has no part in them.

    Returns:
        A result whose quantities are the largest errors of the known intervals, distances and
        falsehoods, in units of their values.

    Raises:
        InvalidCase: if a verdict has another status than the known one.
    """
    wrong = [text for text, known, found in _verdicts() if known != found]
    if wrong:
        raise InvalidCase(f"the harness misjudges known comparisons: {'; '.join(wrong)}")
    errors = {
        "known_intervals": _worst(_intervals()),
        "known_distances": _worst(_distances()),
        "known_falsehoods": _worst(_falsehoods()),
        "known_budget": _worst(_budget()),
    }
    nothing = Areas(0.0, 0.0, 0.0)
    step = LoadStep(scene.load.final, {"raw": nothing}, quantities=errors)
    return ContactResult("judge", (step,), Provenance(scene.digest))


def _worst(pairs: Sequence[tuple[float, float]]) -> float:
    """The largest relative error of (found, known); NaN if one of them is NaN."""
    return float(np.max([abs(found - known) / abs(known) for found, known in pairs]))


# --- cases and answers with known numbers ---------------------------------------------------------


def _tables(gates: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {
        "case": {"id": "known", "requirement": "-", "source": "-", "methods": ["bem", "fem"]},
        "surface": {"kind": "sinusoid", "period": 1.0, "shape": [8], "amplitude": 0.1},
        "material": {"young_modulus": 1.0, "poisson_ratio": 0.0, "hardness": 4.0},
        "fem": {"law": "capped"},
        "load": {"mean_pressure": [0.5, 1.0]},
        "gate": list(gates),
    }


def _gate(**changes: Any) -> dict[str, Any]:
    """A table [[gate]] with a band by size, or with `between`."""
    gate = {"quantity": "quantity.mean_gap", "of": "bem", "against": "fem", "because": "-"}
    band = {} if "between" in changes else {"tolerance": {"fast": 0.5, "full": 0.2}}
    return gate | band | changes


def _loaded(size: str, *gates: Mapping[str, Any]) -> Case:
    return load_case(CaseText(Path("known.toml"), "known", _tables(gates)), size)


def _case(size: str = "fast", **changes: Any) -> Case:
    """A case at a size with one gate, without the default gates."""
    case = _loaded(size, _gate(**changes))
    return case.changed(gates=case.gates[:1])


def _result(method: str, value: float) -> ContactResult:
    """Two load steps; every scalar of the last one has a value of its own."""
    steps = [
        LoadStep(
            step * 0.5,
            {
                kind: Areas(*(step * value * (i + 1 + 3 * j) / 100 for i in range(3)))
                for j, kind in enumerate(("raw", "corrected", "error"))
            },
            {"force": 11 * step * value},
            {"newton": step * 2},
            {"mean_gap": step * value / 2, "largest_pressure": -step * value / 2},
        )
        for step in (1, 2)
    ]
    return ContactResult(method, tuple(steps), Provenance("known"), cost={"seconds": 17 * value})


def _answers(labels: str = "abc", order: str = "abc", failed: str = "") -> dict[str, Answer]:
    values = {
        "bem": VALUES["bem"],
        "fem": tuple(VALUES["fem"]["abc".index(letter)] for letter in order),
    }
    out = {
        name: Answer(tuple(_result(name, v) for v in numbers), tuple("abc"[: len(numbers)]))
        for name, numbers in values.items()
    }
    out["fem"] = replace(out["fem"], labels=tuple(labels))
    if failed:
        out[failed] = replace(out[failed], errors=(f"{failed}, a: no",))
    return out


def _judged(answers: Mapping[str, Answer], size: str = "fast", **gate: Any) -> GateVerdict:
    return judge_case(_case(size, **gate), answers).gates[0]


# --- statuses -------------------------------------------------------------------------------------


def _verdicts() -> list[tuple[str, object, object]]:
    """(what, known, found) of statuses and exit codes."""
    paired, apart = _answers(), _answers(labels="def")
    single = {name: replace(a, results=a.results[:1], labels=("a",)) for name, a in paired.items()}
    twins = replace(paired["bem"], results=paired["bem"].results[:1] * 3)
    number: dict[str, Any] = {"against": 0.5, "source": "-", "norm": "absolute"}
    rows = [
        ("pairs in their band", HOLDS, _judged(paired)),
        ("pairs beyond the band of another size", FALLS_SHORT, _judged(paired, "full")),
        ("unpaired surfaces", FALLS_SHORT, _judged(apart)),
        (
            "areas less sure than the band",
            FALLS_SHORT,
            _judged(paired, quantity="area.total.corrected"),
        ),
        ("a method that failed", ERROR, _judged(_answers(failed="bem"))),
        ("a reference that failed", ERROR, _judged(_answers(failed="fem"))),
        ("a scalar that is not there", ERROR, _judged(paired, quantity="quantity.diffusion")),
        ("the band's lower end", HOLDS, _judged(single, **number, between=[0.5, 1.0])),
        ("the band's upper end", HOLDS, _judged(single, **number, between=[0.0, 0.5])),
        ("one below the band", FALLS_SHORT, _judged(single, **number, between=[0.6, 1.0])),
        ("one above the band", FALLS_SHORT, _judged(single, **number, between=[-1.0, 0.4])),
        ("a repeated member", ERROR, _judged(paired | {"bem": twins})),
    ]
    out: list[tuple[str, object, object]] = [
        (f"{text} ({found.status})", known, found.status) for text, known, found in rows
    ]
    return out + _cases_together(paired)


def _cases_together(paired: Mapping[str, Answer]) -> list[tuple[str, object, object]]:
    good, bad = _case(tolerance=0.5), _case(tolerance=1e-3)
    both = good.changed(gates=(*good.gates, *bad.gates, *good.gates))
    cases = {
        HOLDS: judge_case(good, paired),
        FALLS_SHORT: judge_case(both, paired),
        ERROR: judge_case(both, _answers(failed="fem")),
        SKIPPED: judge_case(good.changed(skip="absent"), {}),
    }
    out: list[tuple[str, object, object]] = [
        (f"a case that {status}", status, case.status) for status, case in cases.items()
    ]
    codes = {
        (HOLDS,): 0,
        (HOLDS, SKIPPED): 0,
        (HOLDS, FALLS_SHORT, HOLDS): 1,
        (ERROR, HOLDS): 2,
        (FALLS_SHORT, ERROR, FALLS_SHORT): 2,
    }
    for statuses, code in codes.items():
        verdict = Verdict.on([cases[status] for status in statuses], "fast")
        found = (verdict.exit_code, verdict.passed)
        out.append((f"exit code of {', '.join(statuses)}", (code, code == 0), found))
    full = _gate(sizes=["full"], of="fem", against="bem")
    bands: tuple[tuple[str, list[float]], ...]
    bands = (("fast", [0.5]), ("full", [0.2, 0.2]))
    for size, known in bands:
        case = _loaded(size, full, _gate())
        own = [gate.high for gate in case.gates if gate.quantity == "quantity.mean_gap"]
        out += [(f"the gates of size {size}", known, own), ("defaults", True, len(case.gates) > 9)]
    return out


# --- intervals ------------------------------------------------------------------------------------


def _intervals() -> list[tuple[float, float]]:
    """Means and half-widths of paired, unpaired and single comparisons; each scalar's place."""
    number: dict[str, Any] = {"against": 2.0, "source": "-"}
    known: tuple[tuple[dict[str, Answer], dict[str, Any], tuple[float, float]], ...] = (
        (_answers(), {"norm": "absolute"}, (-2 / 15, 0.6251609479375779)),
        (_answers(), {}, (-9 / 209, 0.2058685516626538)),
        (_answers(order="bca", labels="bca"), {"norm": "absolute"}, (-2 / 15, 5.717115803043791)),
        (_answers(labels="def"), {"norm": "absolute"}, (-2 / 15, 5.717115803043791)),
        (_answers(labels="def"), {}, (-2 / 37, 2.2485173670091716)),
        (_answers(), number, (1 / 6, 1.897291516798379)),
        (
            _answers(),
            number | {"quantity": "quantity.largest_pressure"},
            (-13 / 6, 1.897291516798379),
        ),
    )
    out = []
    for answers, gate, (mean, half_width) in known:
        found = _judged(answers, **gate).difference
        assert found is not None
        out += [(found.mean, mean), (found.half_width, half_width)]
    return out


# --- distances ------------------------------------------------------------------------------------


def _uniform(low: float, area: float = 1.0, plastic: float = 0.0) -> PressureDistribution:
    """Pressures spread evenly over (low, low + 1) on a share `area`, with 2 as the hardness."""
    sigma = np.linspace(0, 2, 20001)
    return PressureDistribution(sigma, area * np.clip(sigma - low, 0, 1), plastic)


def _distances() -> list[tuple[float, float]]:
    """Distances with areas below one, plastic shares and jumps."""
    jump = PressureDistribution(np.array([0, 0.5 - 1e-12, 0.5]), np.array([0.0, 0.0, 0.3]))
    known = (
        ("wasserstein", _uniform(0.2), _uniform(0.5), 4.0, 0.3 / 4),
        ("wasserstein", _uniform(0.2, 0.25), _uniform(0.5, 0.1), math.inf, 0.3 / 1.0),
        ("wasserstein", _uniform(0, 0.2, 0.2), _uniform(0), 2.0, 0.75 / 2),
        ("wasserstein", _uniform(0, 0.2, 0.2), _uniform(0, 0.3, 0.1), 2.0, 0.375 / 2),
        ("wasserstein", jump, _uniform(0, 0.4), 4.0, 0.25 / 4),
        ("supremum", _uniform(0, 0.5), _uniform(0, 0.25), 4.0, 1.0),
        ("supremum", _uniform(0, 0.2, 0.1), _uniform(0, 0.1, 0.3), 2.0, 0.25),
        ("supremum", jump, _uniform(0, 0.4), 4.0, 0.5),
    )
    return [(distance(norm, a, b, hardness), exact) for norm, a, b, hardness, exact in known]


# --- falsehoods -----------------------------------------------------------------------------------


def _falsehoods() -> list[tuple[float, float]]:
    """Scores of wrong answers: fields, areas, figures, overlaps and the certificate."""
    n = np.arange(16)
    wave = np.cos(2 * np.pi * n / 16)
    scene = Scene(Surface(0.1 * wave, (1.0,)), Material(1.0, 0.0, 4.0), Load(1.0))
    C = 1 / math.pi  # 2/(E* q) of the wave
    flat = {"heights": 0.1 * wave, "gap": -0.1 * wave, "displacement": 0 * wave}
    pulled = _measured(scene, 1.02 * (1 + 1.5 * wave), {"displacement": C * wave})
    pressed = _measured(scene, np.ones(16), flat | {"state": np.full(16, PLASTIC)})
    root = math.sqrt(2)
    return [
        *_scores(pulled, scene, force=0.02, bounds=0.51, fields=0.53 * C / (0.1 / root)),
        *_scores(pressed, scene, gap=root, areas=0.5, fields=1.0, figures=1.0, distribution=0.5),
        *_overlap(),
        *_certificate(),
    ]


def _measured(
    scene: Scene, pressure: FloatArray, fields: Mapping[str, FloatArray]
) -> ContactResult:
    """An answer that reports a total area of 1/2 and a largest pressure of 2."""
    areas = {"raw": Areas(0.5, 0.5, 0.0)}
    step = LoadStep(1.0, areas, quantities={"largest_pressure": 2.0, "mean_gap": 0.1 / math.pi})
    table = PressureDistribution(np.array([0.0, 1.0]), np.array([0.0, 0.5]))
    return ContactResult(
        "bem", (step,), Provenance("known"), table, {"pressure": pressure, **fields}
    )


def _scores(result: ContactResult, scene: Scene, **known: float) -> list[tuple[float, float]]:
    return [(measure(f"quantity.measured_{k}", scene, result), v) for k, v in known.items()]


def _overlap() -> list[tuple[float, float]]:
    """Two contacts of which neither is inside the other."""
    p, q = np.array([1.0, 1, 1, 1, 0, 0]), np.array([0.0, 0, 2, 2, 2, 0])
    one, other = (
        ContactResult(
            "bem",
            (LoadStep(1.0, {"raw": Areas(0.5, 0.5, 0.0)}),),
            Provenance("known"),
            table,
            {"pressure": field, "state": np.where(field > 0, ELASTIC, APART)},
        )
        for field, table in ((p, _uniform(0.2)), (q, _uniform(0.5)))
    )
    found = difference(one, other, 4.0)
    known = (1 / 3, math.sqrt(8 / 12), 2 / 5, 0.3 / 4, 3)
    values = (found.area, found.pressure, found.overlap, found.wasserstein, found.nodes)
    return list(zip(values, known, strict=True))


def _certificate() -> list[tuple[float, float]]:
    """The certificate of a state whose contact forces are a hundredth too large."""
    heights = 0.01 * np.cos(2 * np.pi * np.arange(8) / 8)
    body = Body("bonded_layer", 0.25)
    scene = Scene(Surface(heights, (1.0,)), Material(1.0, 0.3), Load(0.01), body)
    path = solve_path(scene, law="elastic", certified=False)
    state, forces = path.points[-1].state, path.points[-1].state.forces
    total = float(forces.sum())
    found = certify(path.problem, replace(state, forces=1.01 * forces), path.history, total)
    return [
        (found["certified_balance"], 0.01 * float(np.linalg.norm(forces)) / total),
        (found["certified_load"], 0.01),
    ]


# --- the budget -----------------------------------------------------------------------------------


def _budget() -> list[tuple[float, float]]:
    """The parts of a difference between finite and boundary elements form one chain.

    Its last body is the scene's own half-space, its first the elements.  A layer on a rigid base is
    stiffer than the half-space, and under the same load it touches on less.
    """
    x, y = np.meshgrid(np.arange(12) / 12, np.arange(10) / 10, indexing="ij")
    wave = (
        np.cos(2 * np.pi * x) + 0.7 * np.cos(2 * np.pi * (y - x) + 1) + 0.1 * np.cos(4 * np.pi * y)
    )
    scene = Scene(Surface(0.01 * wave, (1.0, 0.7)), Material(1.0, 0.3, 0.1, 0.03), Load(0.015))
    parts = error_budget(scene, law="j2", depth=0.15, report=None)
    assert parts.model is not None
    j2 = fem_check.solve(scene, law="j2", depth=0.15, certified=False)
    whole = parts.depth.areas[1]
    return [
        (parts.model.areas[0], j2.final.areas["raw"].total),
        (parts.model.areas[1], parts.solver.areas[1]),
        (parts.solver.areas[0], parts.solver.areas[1]),
        (parts.solver.areas[1], parts.discretisation.areas[0]),
        (parts.discretisation.areas[1], parts.depth.areas[0]),
        ((1 + parts.depth.area) * whole, parts.depth.areas[0]),
        (math.copysign(1.0, parts.depth.area), -1.0),
        (1 + parts.solver.pressure, 1.0),
    ]
