"""The verdict, and how a case is judged: every gate, on the answers of its methods.

A case *holds* if all its gates hold, *falls short* if one does not, is *skipped* if its
surface or a solver is missing, and is in *error* if a method gave no answer that a gate
needs.

`Verdict` and the classes of its parts are the schema of verdict.json (`epcontact schema
verdict`). Version 1 of the schema may gain keys; no key is renamed, removed or given
another meaning.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, Literal

from pydantic import Field, PrivateAttr, ValidationError

from epcontact.errors import EpcontactError, InvalidCase, OutputError, sentence_of
from epcontact.files import read_bytes
from epcontact.harness.case_files.case import Case
from epcontact.harness.case_files.text import case_name
from epcontact.harness.gates import (
    DISTRIBUTION_NORMS,
    ERROR,
    FALLS_SHORT,
    HOLDS,
    Estimate,
    FileName,
    Gate,
    GateVerdict,
    Number,
    Record,
    distance,
    judge,
    judge_distance,
    unjudged,
)
from epcontact.harness.quantities.registry import (
    claim_of,
    read_quantity,
    scalar_quantities,
)
from epcontact.harness.solving.method_results import MethodResults
from epcontact.harness.verdict.digest import digest_of
from epcontact.harness.verdict.evidence import kind_of, subject_of
from epcontact.harness.verdict.run_info import RunInfo
from epcontact.reference import CLOSED_FORMS
from epcontact.results import PressureDistribution, package_versions

SKIPPED: Literal["skipped"] = "skipped"


class MethodEntry(Record):
    """The work of a method for a case."""

    surfaces: int
    reused: int
    errors: list[str]
    seconds: dict[FileName, Number] = Field(
        default={},
        description="of each solve, by surface; of one that is reused, when it was "
        "made",
    )
    counts: dict[str, Number] = Field(
        default={},
        description="the work of all surfaces: FFT pairs, iterations, unknowns",
    )


class CaseVerdict(Record):
    """One case and its gates."""

    id: FileName
    family: str = Field(
        default="", description="the case file, which may hold several cases"
    )
    size: FileName
    scene: str = Field(default="", description="SHA-256 of the scenes of its answers")
    status: Literal["holds", "falls short", "error", "skipped"]
    requirement: str
    source: str
    skipped_because: str
    methods: dict[FileName, MethodEntry]
    gates: list[GateVerdict]
    not_judged: list[str] = Field(
        default=[],
        description="the gates that this size leaves out",
    )
    _case: Case | None = PrivateAttr(default=None)
    _results: Mapping[str, MethodResults] = PrivateAttr(default_factory=dict)

    @property
    def case(self) -> Case:
        """The case that was judged.  Raises InvalidCase if this was read from a
        file.
        """
        if self._case is None:
            raise InvalidCase(
                f"{self.id}: a verdict that was read from a file has no case"
            )
        return self._case

    @property
    def results(self) -> Mapping[str, MethodResults]:
        """The results of each method; empty if this was read from a file or skipped."""
        return self._results

    @property
    def unread_errors(self) -> list[str]:
        """The errors of methods that no gate reads; they make the case an error as
        well.
        """
        read = {name for gate in self.gates for name in (gate.of, gate.against)}
        return [
            e
            for name, entry in self.methods.items()
            if name not in read
            for e in entry.errors
        ]


class Verdict(Record):
    """The verdict on all cases; verdict.json holds it."""

    format: Literal["epcontact-verdict-1"] = Field(alias="schema")
    passed: bool
    exit_code: Literal[0, 1, 2]
    size: str
    versions: dict[str, str] = Field(
        description="of the packages that made the results; several, if results were "
        "reused"
    )
    made: RunInfo | None = Field(
        default=None, description="when, where and by which sources"
    )
    cases: list[CaseVerdict]
    digest: str = Field(
        default="", description="SHA-256 of the verdict and of its answers"
    )

    @classmethod
    def read(cls, file: Path, alone: bool = False) -> Verdict:
        """Read a verdict.json, and check its digest and the names of its files.

        Args:
            file: the verdict.json; the results that it is about lie beside it.
            alone: accept a verdict.json without the results, such as a copy of it.

        Raises:
            OutputError: if it or a result was changed, or if it names a case, a size or
                a method by what is no name of a file.
        """
        content = read_bytes(file)
        with contextlib.suppress(
            KeyError, TypeError, ValueError, AttributeError, RecursionError
        ):
            found = json.loads(content)
            # The names are checked here, before the digest takes them as paths.
            verdict = cls._with_safe_names(found, file)
            if digest_of(found, file.parent) in {
                found["digest"],
                alone and found["digest"][:64],
            }:
                return verdict
        why = (
            "it or an answer beside it was changed, moved or written by another version"
        )
        raise OutputError(f"cannot read {file}: {why}; run verify again")

    @classmethod
    def _with_safe_names(cls, content: dict[str, Any], file: Path) -> Verdict:
        """Return the verdict that a file holds.  Raises OutputError if a name is none
        of a file, and ValidationError if the content is no verdict.
        """
        try:
            return cls.model_validate(content)
        except ValidationError as error:
            for mistake in error.errors():
                if mistake["type"] == "string_pattern_mismatch":
                    place = ".".join(map(str, mistake["loc"])).removesuffix(".[key]")
                    raise OutputError(
                        f"cannot read {file}: {place} is {mistake['input']!r:.80}, but "
                        "must be the name of a file or folder: letters, digits, '.', "
                        "'_' and '-', with a letter, a digit or '_' first"
                    ) from None
            raise

    @property
    def content(self) -> dict[str, Any]:
        """What verdict.json holds."""
        return self.model_dump(mode="json", by_alias=True, exclude_none=True)

    @classmethod
    def on(
        cls, cases: Sequence[CaseVerdict], size: str, made: RunInfo | None = None
    ) -> Verdict:
        """Return the verdict on cases.

        Its exit code is 0 if all gates hold, 1 if one falls short, 2 on an error.

        Args:
            cases: the verdicts on the cases.
            size: the size of the cases.
            made: when and where the run began; None: now and here.
        """
        statuses = {case.status for case in cases}
        exit_code: Literal[0, 1, 2] = 0
        if FALLS_SHORT in statuses:
            exit_code = 1
        if ERROR in statuses:
            exit_code = 2
        return cls(
            schema="epcontact-verdict-1",
            passed=exit_code == 0,
            exit_code=exit_code,
            size=size,
            versions=_versions(cases) or package_versions(),
            made=made or RunInfo.here(),
            cases=list(cases),
        )


def _versions(cases: Sequence[CaseVerdict]) -> dict[str, str]:
    """Return the versions of the packages that made the results, by their names.

    A package may have several: results may be reused that an older version made.
    """
    used: dict[str, set[str]] = defaultdict(set)
    for case in cases:
        for method in case.results.values():
            for result in method.results:
                for name, version in result.provenance.versions.items():
                    used[name].add(str(version))
    return {name: ", ".join(sorted(versions)) for name, versions in used.items()}


def tightest(gates: Iterable[GateVerdict]) -> GateVerdict | None:
    """Return the gate that could not be judged or is nearest to its band's end; None if
    no gate.
    """
    return min(
        gates, key=lambda gate: (not math.isnan(gate.margin), gate.margin), default=None
    )


def judge_case(case: Case, results: Mapping[str, MethodResults]) -> CaseVerdict:
    """Judge every gate of a case.

    Args:
        case: the case; a skipped one is not judged.
        results: the results of its methods, by their names.
    """
    if case.skip:
        results = {}
    gates = (
        [] if case.skip else [_judge_gate(case, gate, results) for gate in case.gates]
    )
    judged = CaseVerdict(
        id=case.id,
        family=case_name(case.path),
        size=case.size,
        scene=_digest_of_scenes(results),
        status=SKIPPED if case.skip else _worst_status(gates, results),
        requirement=case.head.requirement,
        source=case.head.source,
        skipped_because=case.skip,
        methods={name: _entry(of_method) for name, of_method in results.items()},
        gates=gates,
        not_judged=list(case.not_judged),
    )
    judged._case = case
    judged._results = results
    return judged


def _worst_status(
    gates: Sequence[GateVerdict], results: Mapping[str, MethodResults]
) -> Literal["holds", "falls short", "error"]:
    """Return the status of a case; the error of a method that no gate reads counts."""
    statuses = {gate.status for gate in gates}
    if ERROR in statuses or any(of_method.errors for of_method in results.values()):
        return ERROR
    return FALLS_SHORT if FALLS_SHORT in statuses else HOLDS


def _entry(results: MethodResults) -> MethodEntry:
    """Return the work of a method: seconds by surface, counts summed over surfaces."""
    seconds = {}
    counts: dict[str, list[float]] = defaultdict(list)
    for label, result in zip(results.labels, results.results, strict=True):
        for name, value in result.cost.items():
            if name == "seconds":
                seconds[label] = value
            elif name != "peak_memory_bytes":
                counts[name].append(value)
    return MethodEntry(
        surfaces=len(results.results),
        reused=results.reused,
        errors=list(results.errors),
        seconds=seconds,
        counts={name: math.fsum(counts[name]) for name in sorted(counts)},
    )


def _digest_of_scenes(results: Mapping[str, MethodResults]) -> str:
    """Return the SHA-256 of the scenes that were solved; "" if none was."""
    scenes = {
        result.provenance.scene
        for of_method in results.values()
        for result in of_method.results
    }
    if not scenes:
        return ""
    return hashlib.sha256(" ".join(sorted(scenes)).encode()).hexdigest()


def _judge_gate(
    case: Case, gate: Gate, results: Mapping[str, MethodResults]
) -> GateVerdict:
    """Return the verdict on a gate, with the kind of its reference and its subject."""
    return _judged(case, gate, results).model_copy(
        update={"kind": kind_of(case, gate), "subject": subject_of(case, gate)}
    )


def _judged(
    case: Case, gate: Gate, results: Mapping[str, MethodResults]
) -> GateVerdict:
    of = results[gate.of]
    against = results.get(str(gate.against))
    sides = [side for side in (of, against) if side is not None]
    errors = [sentence for side in sides for sentence in side.errors]
    if errors:
        return unjudged(gate, _joined(errors))
    for side in sides:
        equal = side.equal_surfaces
        if equal is not None:
            method = side.results[0].method
            return unjudged(
                gate,
                f"{method} gives the surfaces {' and '.join(equal)} the same answer, "
                "so that the scatter of the ensemble says nothing; give it different "
                "surfaces",
            )
    try:
        return _compared(case, gate, of, against)
    except Exception as error:  # of a closed form, too, in numbers that it cannot hold
        return unjudged(gate, sentence_of(error))


def _compared(
    case: Case, gate: Gate, of: MethodResults, against: MethodResults | None
) -> GateVerdict:
    """Return the verdict on a gate by its norm.

    Raises whatever the quantity or the closed form raises.
    """
    if gate.norm in DISTRIBUTION_NORMS:
        return judge_distance(gate, _distances(case, gate, of, against))
    if gate.norm == "l2":
        field = gate.quantity.removeprefix("field.")
        return judge_distance(gate, _read(of, f"quantity.l2.{gate.against}.{field}"))
    values = _read(of, gate.quantity)
    references = _references(case, gate, against)
    paired = against is not None and len(values) > 1 and of.labels == against.labels
    sides = [of] if against is None else [of, against]
    judged = judge(gate, values, references, paired, _claim(gate, sides))
    return judged.model_copy(
        update={
            "value": _with_claim(gate, judged.value, of),
            "reference": _with_claim(gate, judged.reference, against),
        }
    )


def _read(results: MethodResults, name: str) -> list[float]:
    """Return a quantity of the last load of each surface.  Raises InvalidCase."""
    return [read_quantity(result, name) for result in results.results]


def _mean_if_reported(results: MethodResults, name: str) -> float | None:
    """Return the mean of a quantity over the surfaces; None if one does not have it."""
    if all(name in scalar_quantities(result) for result in results.results):
        return fmean(_read(results, name))
    return None


def _references(case: Case, gate: Gate, against: MethodResults | None) -> list[float]:
    """Return the values of the reference: of a method, a closed form, or the number."""
    if against is not None:
        return _read(against, gate.quantity)
    if isinstance(gate.against, str):
        form = CLOSED_FORMS[gate.against]
        return [form.scalar(gate.quantity, case.scene(case.recipes[0]))]
    return [gate.against]


def _with_claim(
    gate: Gate, mean: Estimate | None, results: MethodResults | None
) -> Estimate | None:
    """Return a mean with the mean of the error estimates of its values, if any."""
    error = claim_of(gate.quantity)
    if mean is None or results is None or not error:
        return mean
    claim = _mean_if_reported(results, error)
    if claim is None:
        return mean
    return mean.model_copy(update={"claimed_error": _infinite_if_nan(claim)})


def _infinite_if_nan(error: float) -> float:
    """Return an error estimate; one that is NaN counts as infinite."""
    return math.inf if math.isnan(error) else error


def _claim(gate: Gate, sides: Sequence[MethodResults]) -> float | None:
    """Return the error estimate that counts in a difference of limits; see `gates`.

    Args:
        gate: the gate.
        sides: the results of its one or two methods.

    Returns:
        The error, in the unit of the quantity; None if no error estimate counts.
    """
    error = claim_of(gate.quantity)
    against_closed_form = isinstance(gate.against, str) and len(sides) == 1
    if not error or against_closed_form:
        return None
    claims = []
    for side in sides:
        claim = _mean_if_reported(side, error)
        if claim:  # a theory has no grid and reports 0, which is no error estimate
            claims.append(_infinite_if_nan(claim))
    total = min(claims, default=None)
    on_same_points = all(_is_of_points(side) for side in sides)
    if len(claims) == 2 and math.inf not in claims and on_same_points:
        total = abs(claims[0] - claims[1])
    for source in ("hardness", "treatment"):
        part = error.replace(".error", f".{source}_error")
        if gate.quantity.startswith("quantity."):
            part = f"{gate.quantity}_error_by_{source}"
        parts = [_mean_if_reported(side, part) for side in sides]
        reported = [value for value in parts if value is not None]
        # Two results on one map, or under one effective hardness, share this error.
        if len(reported) == 1:
            total = math.hypot(total or 0.0, reported[0])
    return total


def _is_of_points(results: MethodResults) -> bool:
    """Return whether the areas follow from pressures at the points of the surface.

    The errors of boundary elements and of all solvers from outside are those of one
    grid, and not independent.
    """
    return all(
        result.method == "bem" or "solver" in result.provenance.options
        for result in results.results
    )


def _joined(sentences: Sequence[str]) -> str:
    """Join sentences "method, surface: reason" in one line that states each reason
    once.
    """
    by_reason: dict[str, list[str]] = defaultdict(list)
    for sentence in dict.fromkeys(sentences):
        where, _, reason = sentence.partition(": ")
        by_reason[reason].append(where)
    lines = []
    for reason, (first, *others) in by_reason.items():
        more = f" and {len(others)} more" if others else ""
        lines.append(f"{first}{more}: {reason}")
    return "; ".join(lines)


def _distances(
    case: Case, gate: Gate, of: MethodResults, against: MethodResults | None
) -> list[float]:
    """Return the distance of the pressure distribution of each surface from its
    reference.
    """
    references: list[PressureDistribution | None]
    if against is None:
        form = CLOSED_FORMS[str(gate.against)]
        references = [form.pressures(case.scene(recipe)) for recipe in case.recipes]
    else:
        references = [result.distribution for result in against.results]
    if len(references) == 1:
        references *= len(of.results)
    if len(references) != len(of.results):
        raise EpcontactError(
            "distributions can be compared with one answer, or with one for each "
            "surface"
        )
    distances = []
    hardness = case.material.hardness
    for result, reference in zip(of.results, references, strict=True):
        if result.distribution is None or reference is None:
            raise EpcontactError(f"{gate.name}: a method gave no pressure distribution")
        distances.append(distance(gate.norm, result.distribution, reference, hardness))
    return distances
