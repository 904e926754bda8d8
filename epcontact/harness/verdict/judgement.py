"""The verdict, and how a case is judged: every gate, on the results of its methods.

A case *holds* if all its gates hold, *falls short* if one does not, is *skipped* if its
surface or a solver is missing, and is in *error* if a method gave no result that a gate
needs.

`Verdict` and the classes of its parts are the schema of verdict.json (`epcontact schema
verdict`). Version 1 of the schema may gain keys; no key is renamed, removed or given
another meaning.
"""

from __future__ import annotations

import contextlib
import hashlib
import html
import itertools
import json
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
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
    judge_distance,
    judge_values,
    l2_distance,
    unjudged_verdict,
)
from epcontact.harness.quantities.registry import QUANTITIES, read_quantity
from epcontact.harness.solving.method_results import MethodResults
from epcontact.harness.verdict.digest import digest_of
from epcontact.harness.verdict.evidence import kind_of, subject_of
from epcontact.harness.verdict.run_info import RunInfo
from epcontact.reference import CLOSED_FORMS
from epcontact.results import (
    PressureDistribution,
    factor_to_95,
    package_versions,
)

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
    scene: str = Field(default="", description="SHA-256 of the scenes of its results")
    status: Literal["holds", "falls short", "error", "skipped"]
    requirement: str
    source: str
    skipped_because: str
    methods: dict[FileName, MethodEntry]
    gates: list[GateVerdict]
    not_judged: list[str] = Field(
        default=[],
        description="the gates that do not apply to this size, or whose method is "
        "missing here",
    )
    hints: list[str] = Field(
        default=[],
        description="what is probably wrong with a solver that does not hold",
    )
    _case: Case | None = PrivateAttr(default=None)
    _results: Mapping[str, MethodResults] = PrivateAttr(default_factory=dict)

    @property
    def case(self) -> Case:
        """The case that was judged.

        Raises InvalidCase if this verdict was read from a file, which holds no case.
        """
        if self._case is None:
            raise InvalidCase(
                f"{self.id}: a verdict that was read from a file has no case"
            )
        return self._case

    @property
    def results(self) -> Mapping[str, MethodResults]:
        """The results of each method of the case by its name; empty if this verdict was
        read from a file or the case was skipped.
        """
        return self._results

    @property
    def unread_errors(self) -> list[str]:
        """The error sentences of those methods of the case that no gate reads.

        They make the status of the case "error", as the errors of the others do.
        """
        read: set[str | float] = set()
        for gate in self.gates:
            read.update((gate.of, gate.against))
        errors = []
        for name, entry in self.methods.items():
            if name not in read:
                errors += entry.errors
        return errors


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
        default="", description="SHA-256 of the verdict and of its results"
    )

    def __repr__(self) -> str:
        """Return the number of gates that hold, and that of all gates and cases."""
        gates = [gate for case in self.cases for gate in case.gates]
        held = sum(gate.holds for gate in gates)
        return f"<Verdict: {held} of {len(gates)} gates hold, {len(self.cases)} cases>"

    def _repr_html_(self) -> str:
        """Return a table of all gates as HTML, which a notebook shows.

        Differences are with half the width of their 95 % interval.  A skipped case has
        a row without a gate.
        """
        rows = []
        for case in self.cases:
            if not case.gates:
                rows.append({"case": case.id, "verdict": case.status})
            for gate in case.gates:
                row = {"case": case.id, "gate": gate.name}
                if gate.difference is not None:
                    difference = gate.difference.mean
                    row["difference"] = f"{difference:+.3g} ± {gate.half_width:.2g}"
                    row["band"] = f"{gate.low:g} … {gate.high:g}"
                rows.append(row | {"verdict": gate.status})
        import pandas as pd  # takes a tenth of the start of a command

        table = pd.DataFrame(rows).to_html(index=False, na_rep="")
        return f"<p>{html.escape(repr(self)[1:-1])}</p>{table}"

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
            "it or a result beside it was changed, moved or written by another version"
        )
        raise OutputError(f"cannot read {file}: {why}; run verify again")

    @classmethod
    def _with_safe_names(cls, content: dict[str, Any], file: Path) -> Verdict:
        """Return the verdict that a verdict.json holds.

        Args:
            content: the content of the file.
            file: its path, for messages.

        Raises:
            OutputError: if the id of a case, a size, a method or a surface cannot be
                the name of a file, such as "../x": paths are made of these names.
            ValidationError: if the content is no verdict in another way.
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
        """The content of verdict.json as plain data, ready for JSON."""
        return self.model_dump(mode="json", by_alias=True, exclude_none=True)

    @classmethod
    def on(
        cls, cases: Sequence[CaseVerdict], size: str, made: RunInfo | None = None
    ) -> Verdict:
        """Return the verdict on all cases together.

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
        nothing_judged = statuses == {SKIPPED}
        return cls(
            schema="epcontact-verdict-1",
            passed=exit_code == 0 and not nothing_judged,
            exit_code=exit_code,
            size=size,
            versions=_versions(cases) or package_versions(),
            made=made or RunInfo.here(),
            cases=list(cases),
        )


def _versions(cases: Sequence[CaseVerdict]) -> dict[str, str]:
    """Return the versions of the software packages that computed the results of cases.

    Returns:
        By the name of each package its versions, joined by commas.  There are several
        if results were reused that an older version computed.  Empty without results.
    """
    used: dict[str, set[str]] = defaultdict(set)
    for case in cases:
        for method in case.results.values():
            for result in method.results:
                for name, version in result.provenance.versions.items():
                    used[name].add(str(version))
    return {name: ", ".join(sorted(versions)) for name, versions in used.items()}


def tightest(gates: Iterable[GateVerdict]) -> GateVerdict | None:
    """Return the gate that is nearest to the end of its band; None without gates.

    A gate that could not be judged comes before all others.
    """

    def tightness(gate: GateVerdict) -> tuple[bool, float]:
        """Return a key that sorts gates without a margin first, then by margin."""
        return not math.isnan(gate.margin), gate.margin

    return min(gates, key=tightness, default=None)


def judge_case(case: Case, results: Mapping[str, MethodResults]) -> CaseVerdict:
    """Return the verdict on a case, with a verdict on each of its gates.

    Args:
        case: the case.  If it must be skipped, its verdict has no gates.
        results: the results of each of its methods, by the methods' names.
    """
    gates: list[GateVerdict] = []
    status: Literal["holds", "falls short", "error", "skipped"] = SKIPPED
    if case.skip:
        results = {}
    else:
        gates = [_gate_verdict(case, gate, results) for gate in case.gates]
        status = _worst_status(gates, results)
    verdict = CaseVerdict(
        id=case.id,
        family=case_name(case.path),
        size=case.size,
        scene=_digest_of_scenes(results),
        status=status,
        requirement=case.head.requirement,
        source=case.head.source,
        skipped_because=case.skip,
        methods={name: _method_entry(found) for name, found in results.items()},
        gates=gates,
        not_judged=list(case.not_judged),
    )
    verdict._case = case
    verdict._results = results
    return verdict


def _worst_status(
    gates: Sequence[GateVerdict], results: Mapping[str, MethodResults]
) -> Literal["holds", "falls short", "error"]:
    """Return the status of a case: the worst of its gates.

    It is "error" also if a method failed on a surface, whether or not a gate reads this
    method.

    Args:
        gates: the verdicts on all gates of the case.
        results: the results of its methods, by the methods' names.
    """
    statuses = {gate.status for gate in gates}
    if ERROR in statuses or any(of_method.errors for of_method in results.values()):
        return ERROR
    return FALLS_SHORT if FALLS_SHORT in statuses else HOLDS


def _method_entry(results: MethodResults) -> MethodEntry:
    """Return what verdict.json says of a method of a case.

    This is the number of its results, its errors, the seconds of each solve by surface,
    and the counts of its work (FFT pairs, iterations, unknowns) summed over surfaces.
    """
    seconds = {}
    counts: dict[str, list[float]] = defaultdict(list)
    for label, result in zip(results.labels, results.results, strict=True):
        for name, value in result.cost.items():
            if name == "seconds":
                seconds[label] = value
            elif name not in ("measuring_seconds", "peak_memory_bytes"):
                counts[name].append(value)
    return MethodEntry(
        surfaces=len(results.results),
        reused=results.reused,
        errors=list(results.errors),
        seconds=seconds,
        counts={name: math.fsum(counts[name]) for name in sorted(counts)},
    )


def _digest_of_scenes(results: Mapping[str, MethodResults]) -> str:
    """Return the SHA-256 of the sorted digests of all scenes that a case's methods
    solved; "" if no scene was solved.
    """
    scenes = {
        result.provenance.scene
        for of_method in results.values()
        for result in of_method.results
    }
    if not scenes:
        return ""
    return hashlib.sha256(" ".join(sorted(scenes)).encode()).hexdigest()


def _gate_verdict(
    case: Case, gate: Gate, results: Mapping[str, MethodResults]
) -> GateVerdict:
    """Return the verdict on a gate, with the kind of its reference and its subject.

    Args:
        case: the case of the gate.
        gate: the gate.
        results: the results of each method of the case, by the methods' names.
    """
    return _verdict_or_error(case, gate, results).model_copy(
        update={"kind": kind_of(case, gate), "subject": subject_of(case, gate)}
    )


def _verdict_or_error(
    case: Case, gate: Gate, results: Mapping[str, MethodResults]
) -> GateVerdict:
    """Return the verdict on a gate.

    Its status is "error" if a method of the gate failed on a surface, if a method gave
    two surfaces of an ensemble the same result, or if the quantity or the closed form
    raised an error.

    Args:
        case: the case of the gate.
        gate: the gate.
        results: the results of each method of the case, by the methods' names.
    """
    of = results[gate.of]
    against = results.get(str(gate.against))
    sides = [side for side in (of, against) if side is not None]
    errors = [sentence for side in sides for sentence in side.errors]
    if errors:
        return unjudged_verdict(gate, _join_by_reason(errors))
    for side in sides:
        equal = side.equal_surfaces
        if equal is not None:
            method = side.results[0].method
            return unjudged_verdict(
                gate,
                f"{method} gives the surfaces {' and '.join(equal)} the same result, "
                "so that the scatter of the ensemble says nothing; give it different "
                "surfaces",
            )
    try:
        return _verdict_by_norm(case, gate, of, against)
    except Exception as error:  # a closed form may overflow or divide by zero, too
        return unjudged_verdict(gate, sentence_of(error))


def _verdict_by_norm(
    case: Case, gate: Gate, of: MethodResults, against: MethodResults | None
) -> GateVerdict:
    """Compare the two sides of a gate by its norm, and return the verdict.

    Args:
        case: the case of the gate.
        gate: the gate.
        of: the results of the method that is judged.
        against: the results of the reference method; None: the reference is a closed
            form or a number.

    Raises:
        InvalidCase: if a result lacks the quantity.
        EpcontactError: if pressure distributions cannot be compared.
        Exception: whatever the closed form raises.
    """
    if gate.norm in DISTRIBUTION_NORMS:
        return judge_distance(gate, _distances(case, gate, of, against))
    if gate.norm == "l2":
        return judge_distance(gate, _field_distances(gate, of, against))
    values = _read(of, gate.quantity)
    references = _references(case, gate, against)
    paired = against is not None and len(values) > 1 and of.labels == against.labels
    sides = [of] if against is None else [of, against]
    error = _counted_error(gate, sides)
    verdict = judge_values(gate, values, references, paired, error)
    return verdict.model_copy(
        update={
            "value": _with_error_estimate(gate, verdict.value, of),
            "reference": _with_error_estimate(gate, verdict.reference, against),
        }
    )


def _read(results: MethodResults, name: str) -> list[float]:
    """Return the value of a quantity at the last load, for each surface in order.

    Args:
        results: the results of one method.
        name: the name of the quantity in gates, such as "area.total.corrected".

    Raises:
        InvalidCase: if a result does not have the quantity.
    """
    return [read_quantity(result, name) for result in results.results]


def _references(case: Case, gate: Gate, against: MethodResults | None) -> list[float]:
    """Return the values of a gate's reference, in the unit of its quantity.

    There is one value for each surface of the method `against`.  If that is None, there
    is a single value: that of the closed form or the number that the gate names.

    Raises InvalidCase if a result does not have the quantity, or whatever the closed
    form raises.
    """
    if against is not None:
        return _read(against, gate.quantity)
    if isinstance(gate.against, str):
        form = CLOSED_FORMS[gate.against]
        return [form.scalar(gate.quantity, case.scene(case.recipes[0]))]
    return [gate.against]


def _with_error_estimate(
    gate: Gate, mean: Estimate | None, results: MethodResults | None
) -> Estimate | None:
    """Return a mean together with its errors.

    Args:
        gate: names the quantity.
        mean: the mean of the quantity over the surfaces of a method.
        results: the results of this method; None: the mean is no method's.

    Returns:
        A copy of `mean` with `error_95`, in which the errors by all sources and by the
        scatter are joined, and `claimed_error`, the mean of the estimates of the grid's
        error as the method reports them; `mean` itself, if the method reports no error
        of the quantity.
    """
    if mean is None or results is None:
        return mean
    parts = results.error_parts(gate.quantity)
    if not parts:
        return mean
    claimed = None
    if "grid" in parts:
        claimed = _infinite_if_nan(parts["grid"]) / factor_to_95("grid")
    errors = map(_infinite_if_nan, parts.values())
    return mean.model_copy(
        update={
            "claimed_error": claimed,
            "error_95": math.hypot(mean.half_width, *errors),
        }
    )


def _infinite_if_nan(error: float) -> float:
    """Return an error estimate; one that is NaN counts as infinite."""
    return math.inf if math.isnan(error) else error


def _counted_error(gate: Gate, sides: Sequence[MethodResults]) -> float | None:
    """Return the error estimate by which a gate widens the interval of its difference.

    Methods report errors of corrected areas, gaps, stiffnesses and conductances.  The
    module `gates` says which of the two sides' estimates of the grid's error counts.
    An error by another source, such as an uncertain hardness or the treatment of a
    measured map, counts if only one side has it.

    Args:
        gate: the gate.
        sides: the results of its one or two methods.

    Returns:
        The half-width of a 95 % interval, in the unit of the quantity.  None if no
        error estimate counts.
    """
    if isinstance(gate.against, str) and len(sides) == 1:
        return None  # against a closed form the true error is seen
    parts_of_sides = [side.error_parts(gate.quantity) for side in sides]
    counted = []
    for source in dict.fromkeys(itertools.chain(*parts_of_sides)):
        reported = [
            _infinite_if_nan(parts[source])
            for parts in parts_of_sides
            if source in parts
        ]
        if source == "grid":
            counted += _counted_grid_error(gate, reported, sides)
        # Two results on one map, or under one effective hardness, share this error.
        elif len(reported) == 1:
            counted += reported
    return math.hypot(*counted) if counted else None


def _counted_grid_error(
    gate: Gate, reported: Sequence[float], sides: Sequence[MethodResults]
) -> list[float]:
    """Return the error by the grid that counts for a gate, see the module `gates`.

    Args:
        gate: the gate.
        reported: the error of each side that reports one, as the half-width of a 95 %
            interval.
        sides: the results of the gate's one or two methods.

    Returns:
        A list of this error, or of none.
    """
    is_limit = gate.quantity.startswith("area.") or (
        f"{gate.quantity}.raw" in QUANTITIES
    )
    both_on_grid = len(sides) == 2 and not any(map(_is_theory, sides))
    if both_on_grid and len(reported) == 1 and not is_limit:
        return []
    # A theory has no grid and reports 0, which is no error estimate.
    errors = [error for error in reported if error]
    on_same_points = all(_is_of_points(side) for side in sides)
    if len(errors) == 2 and math.inf not in errors and on_same_points:
        return [abs(errors[0] - errors[1])]
    return [min(errors)] if errors else []


def _is_theory(results: MethodResults) -> bool:
    """Return whether results are those of the theory, which has no grid."""
    return all(result.method == "persson" for result in results.results)


def _is_of_points(results: MethodResults) -> bool:
    """Return whether a method's areas are counts of pressures at the surface's points.

    This is so for the boundary elements and for all solvers from outside the package.
    Their errors come from the same grid, so that they are not independent.
    """
    return all(
        result.method == "bem" or result.is_foreign for result in results.results
    )


def _join_by_reason(sentences: Sequence[str]) -> str:
    """Join error sentences in one line that states each reason once.

    The sentences have the form "method, surface: reason".  Several with one reason
    become "bem, seed1 and 2 more: not converged".
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
    """Return how far the pressure distribution of each surface is from its reference.

    The distance is dimensionless, by the norm of the gate (see `gates.distance`).

    Args:
        case: gives the scene of a closed form and the hardness.
        gate: names the norm and the reference.
        of: the results of the method that is judged.
        against: the results of the reference method, of one surface or of as many as
            `of` has; None: the reference is the closed form that the gate names.

    Raises:
        EpcontactError: if the numbers of surfaces differ, or if a method reports no
            pressure distribution.
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
            "distributions can be compared with one result, or with one for each "
            "surface"
        )
    distances = []
    hardness = case.material.hardness
    for result, reference in zip(of.results, references, strict=True):
        if result.distribution is None or reference is None:
            raise EpcontactError(f"{gate.name}: a method gave no pressure distribution")
        distances.append(distance(gate.norm, result.distribution, reference, hardness))
    return distances


def _field_distances(
    gate: Gate, of: MethodResults, against: MethodResults | None
) -> list[float]:
    """Return the relative L2 distance of each surface's field from its reference.

    Args:
        gate: names the field and the reference.
        of: the results of the method that is judged.
        against: the results of the reference method on the same surfaces; None: the
            reference is a closed form, and the distance was measured by the solve.
    """
    field = gate.field
    if against is None:
        return _read(of, f"quantity.l2.{gate.against}.{field}")
    return [
        l2_distance(result.fields[field], reference.fields[field])
        for result, reference in zip(of.results, against.results, strict=True)
    ]
