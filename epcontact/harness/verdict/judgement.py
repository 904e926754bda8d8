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
from epcontact.harness.answers.store import Answer
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
from epcontact.harness.verdict.evidence import kind_of, subject_of
from epcontact.harness.verdict.made import Made
from epcontact.harness.verdict.read_back import digest_of
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
        description="of each solve, by surface; of one that is reused, when it was made",
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
        description="the gates that this size leaves out or that the case omits",
    )
    _case: Case | None = PrivateAttr(default=None)
    _answers: Mapping[str, Answer] = PrivateAttr(default_factory=dict)

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
    def answers(self) -> Mapping[str, Answer]:
        """The answer of each method; empty if this was read from a file or skipped."""
        return self._answers

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
        description="of the packages that made the results; several, if results were reused"
    )
    made: Made | None = Field(
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
        cls, cases: Sequence[CaseVerdict], size: str, made: Made | None = None
    ) -> Verdict:
        """Make the verdict: exit code 0 if all gates hold, 1 if one falls short, 2 on
        an error.
        """
        statuses = {case.status for case in cases}
        exit_code: Any = 2 if ERROR in statuses else 1 if FALLS_SHORT in statuses else 0
        used: dict[str, set[str]] = defaultdict(
            set
        )  # maybe by older versions than this run's
        answers = (answer for case in cases for answer in case.answers.values())
        for result in (result for answer in answers for result in answer.results):
            for name, version in result.provenance.versions.items():
                used[name].add(str(version))
        versions = {name: ", ".join(sorted(found)) for name, found in used.items()}
        return cls(
            schema="epcontact-verdict-1",
            passed=exit_code == 0,
            exit_code=exit_code,
            size=size,
            versions=versions or package_versions(),
            made=made or Made.here(),
            cases=list(cases),
        )


def tightest(gates: Iterable[GateVerdict]) -> GateVerdict | None:
    """Return the gate that could not be judged or is nearest to its band's end; None if
    no gate.
    """
    return min(
        gates, key=lambda gate: (not math.isnan(gate.margin), gate.margin), default=None
    )


def judge_case(case: Case, answers: Mapping[str, Answer]) -> CaseVerdict:
    """Judge every gate of a case on the answers of its methods."""
    answers = {} if case.skip else answers
    gates = [] if case.skip else [_judged(case, gate, answers) for gate in case.gates]
    told = [
        {"kind": kind_of(case, gate), "subject": subject_of(case, gate)}
        for gate in case.gates
    ]
    gates = [
        gate.model_copy(update=said) for gate, said in zip(gates, told, strict=False)
    ]
    statuses = {gate.status for gate in gates}
    if any(answer.errors for answer in answers.values()):
        statuses.add(ERROR)  # also of a method that no gate reads
    worst = next(
        (status for status in (ERROR, FALLS_SHORT) if status in statuses), HOLDS
    )
    judged = CaseVerdict(
        id=case.id,
        family=case_name(case.path),
        size=case.size,
        scene=_scenes(answers),
        status=SKIPPED if case.skip else worst,
        requirement=case.head.requirement,
        source=case.head.source,
        skipped_because=case.skip,
        methods={
            name: MethodEntry(
                surfaces=len(a.results),
                reused=a.reused,
                errors=list(a.errors),
                seconds={
                    label: result.cost["seconds"]
                    for label, result in zip(a.labels, a.results, strict=True)
                    if "seconds" in result.cost
                },
                counts={
                    name: math.fsum(result.cost.get(name, 0.0) for result in a.results)
                    for name in sorted(
                        {name for result in a.results for name in result.cost}
                    )
                    if name not in ("seconds", "peak_memory_bytes")
                },
            )
            for name, a in answers.items()
        },
        gates=gates,
        not_judged=list(case.not_judged),
    )
    judged._case, judged._answers = case, answers
    return judged


def _scenes(answers: Mapping[str, Answer]) -> str:
    """Return the digest of the scenes that were solved; "" if none was."""
    found = {result.provenance.scene for a in answers.values() for result in a.results}
    return hashlib.sha256(" ".join(sorted(found)).encode()).hexdigest() if found else ""


def _judged(case: Case, gate: Gate, answers: Mapping[str, Answer]) -> GateVerdict:
    needed = [
        m for m in (gate.of, gate.against) if isinstance(m, str) and m in case.methods
    ]
    if failed := [sentence for m in needed for sentence in answers[m].errors]:
        return unjudged(gate, _joined(failed))
    for method in needed:
        if twins := answers[method].twins:
            return unjudged(
                gate,
                f"{method} gives the surfaces {' and '.join(twins)} the same answer, so that the "
                "scatter of the ensemble says nothing; give it different surfaces",
            )
    of, against = answers[gate.of], answers.get(str(gate.against))
    try:
        if gate.norm in DISTRIBUTION_NORMS:
            return judge_distance(gate, _distances(case, gate, of, against))
        if gate.norm == "l2":
            name = f"quantity.l2.{gate.against}." + gate.quantity.removeprefix("field.")
            return judge_distance(gate, _read(of, name))
        value = _read(of, gate.quantity)
        paired = against is not None and len(value) > 1 and of.labels == against.labels
        judged = judge(
            gate, value, _references(case, gate, against), paired, _claim(gate, answers)
        )
        return judged.model_copy(
            update={
                "value": _claiming(gate, judged.value, of),
                "reference": _claiming(gate, judged.reference, against),
            }
        )
    except Exception as error:  # of a closed form, too, in numbers that it cannot hold
        return unjudged(gate, sentence_of(error))


def _read(answer: Answer, name: str) -> list[float]:
    return [read_quantity(result, name) for result in answer.results]


def _references(case: Case, gate: Gate, against: Answer | None) -> list[float]:
    if against is not None:
        return _read(against, gate.quantity)
    if isinstance(gate.against, str):
        form = CLOSED_FORMS[gate.against]
        return [form.scalar(gate.quantity, case.scene(case.recipes[0]))]
    return [gate.against]


def _claiming(
    gate: Gate, found: Estimate | None, answer: Answer | None
) -> Estimate | None:
    """Return the mean of an answer's values with that of the errors which they
    claim.
    """
    error = claim_of(gate.quantity)
    if found is None or answer is None or not error:
        return found
    if any(error not in scalar_quantities(result) for result in answer.results):
        return found
    claim = fmean(_read(answer, error))
    return found.model_copy(
        update={"claimed_error": math.inf if math.isnan(claim) else claim}
    )


def _claim(gate: Gate, answers: Mapping[str, Answer]) -> float | None:
    """Return the claimed error that counts in a difference of limits; see `gates`."""
    error = claim_of(gate.quantity)
    sides = [answers[str(name)] for name in (gate.of, gate.against) if name in answers]
    if not error or (isinstance(gate.against, str) and len(sides) == 1):
        return None
    claims = [
        fmean(_read(side, error))
        for side in sides
        if all(error in scalar_quantities(result) for result in side.results)
    ]
    # A theory has no grid and reports 0, which is no claim; NaN counts as an infinite
    # one.
    found = [math.inf if math.isnan(c) else c for c in claims if c != 0]
    claim = min(found, default=None)
    if len(found) == 2 and math.inf not in found and all(map(_counts_points, sides)):
        claim = abs(found[0] - found[1])
    for source in ("hardness", "treatment"):
        name = error.replace(".error", f".{source}_error")
        if gate.quantity.startswith("quantity."):
            name = f"{gate.quantity}_error_by_{source}"
        having = [
            side
            for side in sides
            if all(name in scalar_quantities(r) for r in side.results)
        ]
        if (
            len(having) == 1
        ):  # two answers on one map or under one effective hardness share it
            claim = math.hypot(claim or 0.0, fmean(_read(having[0], name)))
    return claim


def _counts_points(side: Answer) -> bool:
    """True if the areas follow from pressures at the surface's points: with boundary
    elements and all solvers from outside their errors are those of one grid, and not
    independent.
    """
    return all(
        r.method == "bem" or "solver" in r.provenance.options for r in side.results
    )


def _joined(sentences: Sequence[str]) -> str:
    """Join sentences "method, surface: reason" in one line that states each reason
    once.
    """
    by_reason: dict[str, list[str]] = defaultdict(list)
    for sentence in dict.fromkeys(sentences):
        where, _, reason = sentence.partition(": ")
        by_reason[reason].append(where)
    return "; ".join(
        f"{first}{f' and {len(others)} more' if others else ''}: {reason}"
        for reason, (first, *others) in by_reason.items()
    )


def _distances(
    case: Case, gate: Gate, of: Answer, against: Answer | None
) -> list[float]:
    others: list[PressureDistribution | None]
    if against is None:
        form = CLOSED_FORMS[str(gate.against)]
        others = [form.pressures(case.scene(recipe)) for recipe in case.recipes]
    else:
        others = [result.distribution for result in against.results]
    others *= len(of.results) if len(others) == 1 else 1
    if len(others) != len(of.results):
        raise EpcontactError(
            "distributions can be compared with one answer, or with one for each surface"
        )
    distances: list[float] = []
    for mine, other in zip(of.results, others, strict=True):
        if mine.distribution is None or other is None:
            raise EpcontactError(f"{gate.name}: a method gave no pressure distribution")
        distances.append(
            distance(gate.norm, mine.distribution, other, case.material.hardness)
        )
    return distances
