"""The verdict: `verify` runs cases and judges their gates; verdict.json holds a Verdict.

A case *holds* if all its gates hold, *falls short* if one does not, is *skipped* if its surface or
a solver is missing, and is in *error* if a method gave no answer that a gate needs.

`Verdict` and the classes of its parts are the schema of verdict.json (`epcontact schema verdict`).
Version 1 of the schema may gain keys; no key is renamed, removed or given another meaning.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import Any, Literal

from junitparser import Error, Failure, JUnitXml, Skipped, TestCase, TestSuite
from pydantic import BaseModel, ConfigDict, Field, PrivateAttr

from epcontact.errors import (
    EpcontactError,
    InvalidCase,
    nearest,
    printable,
    sentence_of,
)
from epcontact.harness.answers.run import Progress, default_jobs, run_cases
from epcontact.harness.answers.store import Answer
from epcontact.harness.case_files.case import (
    SIZES,
    Case,
    CaseText,
    find_cases,
    find_named,
    load_case,
)
from epcontact.harness.gates.distances import distance
from epcontact.harness.gates.gate import (
    DISTRIBUTION_NORMS,
    ERROR,
    FALLS_SHORT,
    HOLDS,
    Gate,
    GateVerdict,
    judge,
    judge_distance,
    unjudged,
)
from epcontact.harness.methods.registry import METHODS, REPLACED, solver_named
from epcontact.harness.processes.pool import Factory
from epcontact.harness.quantities.registry import read_quantity
from epcontact.harness.verdict.read_back import require_faithful
from epcontact.output.files import refusal, whole_file, write_json
from epcontact.output.vtk import Precision
from epcontact.reference import CLOSED_FORMS
from epcontact.results import PressureDistribution, package_versions

SKIPPED: Literal["skipped"] = "skipped"


class MethodEntry(BaseModel):
    """The work of a method for a case."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    surfaces: int
    reused: int
    errors: list[str]


class CaseVerdict(BaseModel):
    """One case and its gates."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: str
    size: str
    status: Literal["holds", "falls short", "error", "skipped"]
    requirement: str
    source: str
    skipped_because: str
    methods: dict[str, MethodEntry]
    gates: list[GateVerdict]
    not_judged: list[str] = Field(
        default=[], description="the gates that this size leaves out or that the case omits"
    )
    _case: Case | None = PrivateAttr(default=None)
    _answers: Mapping[str, Answer] = PrivateAttr(default_factory=dict)

    @property
    def case(self) -> Case:
        """The case that was judged.  Raises InvalidCase if this was read from a file."""
        if self._case is None:
            raise InvalidCase(f"{self.id}: a verdict that was read from a file has no case")
        return self._case

    @property
    def unread_errors(self) -> list[str]:
        """The errors of methods that no gate reads; they make the case an error as well."""
        read = {name for gate in self.gates for name in (gate.of, gate.against)}
        return [e for name, entry in self.methods.items() if name not in read for e in entry.errors]

    @property
    def answers(self) -> Mapping[str, Answer]:
        """The answer of each method; empty if this was read from a file or skipped."""
        return self._answers


class Verdict(BaseModel):
    """The verdict on all cases; verdict.json holds it."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal["epcontact-verdict-1"] = Field(alias="schema")
    passed: bool
    exit_code: Literal[0, 1, 2]
    size: str
    versions: dict[str, str] = Field(
        description="of the packages that made the results; several, if results were reused"
    )
    cases: list[CaseVerdict]

    @classmethod
    def on(cls, cases: Sequence[CaseVerdict], size: str) -> Verdict:
        """Make the verdict: exit code 0 if all gates hold, 1 if one falls short, 2 on an error."""
        statuses = {case.status for case in cases}
        exit_code: Literal[0, 1, 2] = (
            2 if ERROR in statuses else 1 if FALLS_SHORT in statuses else 0
        )
        return cls(
            schema="epcontact-verdict-1",
            passed=exit_code == 0,
            exit_code=exit_code,
            size=size,
            versions=_versions(cases),
            cases=list(cases),
        )


def _versions(cases: Sequence[CaseVerdict]) -> dict[str, str]:
    """Return the versions that made the results, which may be older than this run's."""
    found: dict[str, set[str]] = {}
    answers = (answer for case in cases for answer in case.answers.values())
    for result in (result for answer in answers for result in answer.results):
        for name, version in result.provenance.versions.items():
            found.setdefault(name, set()).add(str(version))
    joined = {name: ", ".join(sorted(versions)) for name, versions in found.items()}
    return joined or package_versions()


def verify(  # noqa: PLR0913 - the options of the command
    cases: str | Path | Case | Iterable[str | Path | Case] | None = None,
    *,
    size: str = "fast",
    jobs: int | None = None,
    output: str | Path = "results",
    solver: str = "",
    fresh: bool = False,
    fields: str = "none",
    precision: Precision = "single",
    executor: Factory = "",
    progress: Callable[[Progress], None] | None = None,
    moving: Callable[[float, int], None] | None = None,
) -> Verdict:
    """Solve cases, judge their gates, and write verdict.json and junit.xml.

    Args:
        cases: a name, a path or a loaded case, or several of them; None or empty: the cases of a
            bare `epcontact verify`.  A file with variants means all of them.
        size: the size at which names and paths are loaded.
        jobs: number of worker processes; None: one for each core, or one for size large.  With an
            executor, the number of solves that share the cores of a worker.
        output: folder for results; an old result is reused if its scene, options and sources
            have not changed.
        solver: a registered method, `[NAME=]MODULE:FUNCTION` or `[NAME=]COMMAND` (see
            `harness.methods.exchange`), which replaces the boundary elements in every gate, under
            its own name.
        fresh: solve again what is already in the output folder.
        fields: write the fields (.vti) of the "first" surface, of "all" or of "none"; "steps":
            those of the first surface at every load, and the bodies of the finite elements.
        precision: of the numbers in the .vti files: "single", seven digits, or "double".
        executor: a factory of a `concurrent.futures.Executor` whose workers solve the cases, or its
            name `module:function`; empty: processes of this machine.
        progress: called after every solve.
        moving: called within solves, if this process makes them one by one, with the number of
            solves done, the share of the present one included, and of all.

    Returns:
        The verdict.  `verdict.cases[i].answers` holds the results in memory.

    Raises:
        InvalidCase: if a case or the solver cannot be read.
        OutputError: if a file cannot be written, or does not say what was judged.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     verdict = verify("bearing-area", output=folder, jobs=1)
        >>> verdict.passed, verdict.cases[0].gates[0].status
        (True, 'holds')
    """
    set_verdict_aside(Path(output))
    methods = dict(METHODS)
    named = [cases] if isinstance(cases, str | Path | Case) else list(cases or ())
    loaded = [case for each in named or cases_to_verify(size) for case in _loaded(each, size)]
    if solver:
        stand_in = solver_named(solver)
        methods[stand_in.name] = stand_in
        loaded = [_in_place(case, stand_in.name) for case in loaded]
        if not any(stand_in.name in case.methods for case in loaded):
            raise InvalidCase(
                f"--solver {solver} would judge nothing: it takes the place of {REPLACED}, which "
                "none of the cases names"
            )
    answers = run_cases(
        loaded,
        Path(output),
        jobs=jobs or (1 if executor else default_jobs(size)),
        executor=executor,
        fresh=fresh,
        fields=fields,
        precision=precision,
        methods=methods,
        progress=progress,
        moving=moving,
    )
    verdict = Verdict.on([judge_case(case, answers[case.id]) for case in loaded], size)
    write_verdict(verdict, Path(output))
    require_faithful(Path(output), _content(verdict))
    for name in FILES:
        with contextlib.suppress(OSError):
            (Path(output) / f"{EARLIER}{name}").unlink()
    return verdict


def _loaded(case: str | Path | CaseText | Case, size: str) -> list[Case]:
    if isinstance(case, Case):
        return [case]
    texts = (case,) if isinstance(case, CaseText) else find_named(case)
    loaded = [load_case(text, size) for text in texts]
    for one in loaded:
        if not one.gates and not one.skip:
            raise InvalidCase(
                f"{one.path}: {one.id} has no gate to judge; `epcontact sweep` solves its sweep"
            )
    return loaded


def cases_to_verify(size: str) -> list[CaseText]:
    """Return the cases that `epcontact verify` runs at a size if none is named.

    Raises:
        InvalidCase: if there are no cases, or no such size.
    """
    if size not in SIZES:
        raise InvalidCase(f"no size is called {size!r}{nearest(size, SIZES)}")
    cases = find_cases()
    if not cases:
        raise InvalidCase("no cases found, neither in ./cases nor in the installed package")
    offered = [case for case in cases if size in case.sizes]
    return [case for case in offered if (c := load_case(case, size)).verify and (c.gates or c.skip)]


def _in_place(case: Case, name: str) -> Case:
    """Return the case with another method instead of the boundary elements.

    A case that already names the method is left as it is.
    """
    if name in case.methods:
        return case
    names = {REPLACED: name}
    gates = (
        replace(
            gate,
            of=names.get(gate.of, gate.of),
            against=names.get(str(gate.against), gate.against),
        )
        for gate in case.gates
    )
    options = {names.get(m, m): {} if m == REPLACED else o for m, o in case.options.items()}
    methods = tuple(names.get(m, m) for m in case.methods)
    return replace(case, methods=methods, options=options, gates=tuple(gates))


# --- judging -----------------------------------------------------------------------------------


def judge_case(case: Case, answers: Mapping[str, Answer]) -> CaseVerdict:
    """Judge every gate of a case on the answers of its methods."""
    if case.skip:
        answers = {}
    gates = [] if case.skip else [_judged(case, gate, answers) for gate in case.gates]
    statuses = {gate.status for gate in gates}
    if any(answer.errors for answer in answers.values()):
        statuses.add(ERROR)  # also of a method that no gate reads
    worst = next((status for status in (ERROR, FALLS_SHORT) if status in statuses), HOLDS)
    judged = CaseVerdict(
        id=case.id,
        size=case.size,
        status=SKIPPED if case.skip else worst,
        requirement=case.requirement,
        source=case.source,
        skipped_because=case.skip,
        methods={
            name: MethodEntry(surfaces=len(a.results), reused=a.reused, errors=list(a.errors))
            for name, a in answers.items()
        },
        gates=gates,
        not_judged=list(case.not_judged),
    )
    judged._case, judged._answers = case, answers
    return judged


def _judged(case: Case, gate: Gate, answers: Mapping[str, Answer]) -> GateVerdict:
    needed = [m for m in (gate.of, gate.against) if isinstance(m, str) and m in case.methods]
    failed = [sentence for m in needed for sentence in answers[m].errors]
    if failed:
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
            return judge_distance(gate, [read_quantity(r, name) for r in of.results])
        value = [read_quantity(result, gate.quantity) for result in of.results]
        paired = against is not None and len(value) > 1 and of.labels == against.labels
        return judge(gate, value, _references(case, gate, against), paired, _claim(gate, answers))
    except Exception as error:  # of a closed form, too, in numbers that it cannot hold
        return unjudged(gate, sentence_of(error))


def _references(case: Case, gate: Gate, against: Answer | None) -> list[float]:
    if against is not None:
        return [read_quantity(result, gate.quantity) for result in against.results]
    if isinstance(gate.against, str):
        form = CLOSED_FORMS[gate.against]
        return [form.scalar(gate.quantity, case.scene(case.recipes[0]))]
    return [gate.against]


def _claim(gate: Gate, answers: Mapping[str, Answer]) -> float | None:
    """Return the claimed error that counts in a difference of corrected areas; see `gate`."""
    group, _, kind = gate.quantity.rpartition(".")
    sides = [answers[str(name)] for name in (gate.of, gate.against) if name in answers]
    if kind != "corrected" or (isinstance(gate.against, str) and len(sides) == 1):
        return None
    claims = [
        fmean(read_quantity(result, f"{group}.error") for result in side.results)
        for side in sides
        if all("error" in result.final.areas for result in side.results)
    ]
    # A theory says 0 and claims nothing by it; what is no number is no assurance.
    return min((math.inf if math.isnan(c) else c for c in claims if c != 0), default=None)


def _joined(sentences: Sequence[str]) -> str:
    """Join the errors of many surfaces in one line that states each reason once.

    Each sentence is "method, surface: reason", as `run_cases` makes it.
    """
    by_reason: dict[str, list[str]] = {}
    for sentence in dict.fromkeys(sentences):
        where, _, reason = sentence.partition(": ")
        by_reason.setdefault(reason, []).append(where)
    parts = []
    for reason, places in by_reason.items():
        more = f" and {len(places) - 1} more" if len(places) > 1 else ""
        parts.append(f"{places[0]}{more}: {reason}")
    return "; ".join(parts)


def _distances(case: Case, gate: Gate, of: Answer, against: Answer | None) -> list[float]:
    others: list[PressureDistribution | None]
    if against is None:
        form = CLOSED_FORMS[str(gate.against)]
        others = [form.pressures(case.scene(recipe)) for recipe in case.recipes]
    else:
        others = [result.distribution for result in against.results]
    if len(others) == 1:
        others *= len(of.results)
    if len(others) != len(of.results):
        raise EpcontactError(
            "distributions can be compared with one answer, or with one for each surface"
        )
    distances: list[float] = []
    for mine, other in zip(of.results, others, strict=True):
        if mine.distribution is None or other is None:
            raise EpcontactError(f"{gate.name}: a method gave no pressure distribution")
        distances.append(distance(gate.norm, mine.distribution, other, case.material.hardness))
    return distances


# --- the verdict as files ----------------------------------------------------------------------

#: The files that say what a run found.
FILES = ("verdict.json", "junit.xml", "report.html")
#: Before the name of a file of the verdict that was there before.
EARLIER = "earlier-"


def set_verdict_aside(folder: Path) -> None:
    """Rename the verdict of an earlier run, which would pass for that of a run that breaks off.

    It stays, with `EARLIER` before its name, until there is a new one.

    Raises:
        OutputError: if a file cannot be renamed.
    """
    for path in (folder / name for name in FILES):
        if path.is_file():  # what else has that name is refused when the file is written
            try:
                path.replace(path.with_name(f"{EARLIER}{path.name}"))
            except OSError as error:
                raise refusal("rename", path, error) from None


def _content(verdict: Verdict) -> dict[str, Any]:
    """Return the content of verdict.json."""
    return verdict.model_dump(mode="json", by_alias=True, exclude_none=True)


def write_verdict(verdict: Verdict, folder: Path) -> None:
    """Write verdict.json and junit.xml into `folder`, whole or not at all.

    Raises:
        OutputError: if they cannot be written.
    """
    write_json(folder / "verdict.json", _content(verdict))
    xml = JUnitXml("epcontact")
    for case in verdict.cases:
        xml.add_testsuite(_suite(case))
    xml.update_statistics()  # type: ignore[no-untyped-call]
    with whole_file(folder / "junit.xml") as path:
        xml.write(str(path), pretty=True)


def _suite(case: CaseVerdict) -> TestSuite:
    suite = TestSuite(case.id)

    def add(name: str, *result: Error | Failure | Skipped) -> None:
        test = TestCase(printable(name), classname=case.id)
        test.result = list(result)
        suite.add_testcase(test)

    # XML has no word for most control characters: names and messages show them as escapes.
    if case.status == SKIPPED:
        add(case.requirement, Skipped(printable(case.skipped_because)))
    for gate in case.gates:
        if gate.status == ERROR:
            add(gate.name, Error(printable(str(gate.error))))
        elif gate.status == FALLS_SHORT:
            add(gate.name, Failure(printable(str(gate))))
        else:
            add(gate.name)
    for sentence in case.unread_errors:
        add("a method that no gate reads", Error(printable(sentence)))
    return suite
