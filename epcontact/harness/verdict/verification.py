"""The main job: `verify` runs cases, judges their gates and writes the verdict.

It writes verdict.json, and junit.xml for front ends of continuous integration.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import chain, repeat
from math import fsum
from pathlib import Path
from typing import Any

from junitparser import (
    Error,
    Failure,
    JUnitXml,
    Properties,
    Property,
    Skipped,
    TestCase,
    TestSuite,
)

from epcontact.errors import InvalidCase, OutputError, nearest, printable
from epcontact.files import atomic_write, output_error, write_json
from epcontact.harness.answers.run import Run, run_cases
from epcontact.harness.answers.store import Answer
from epcontact.harness.case_files.case import (
    SIZES,
    Case,
    CaseText,
    find_cases,
    find_named,
    load_cases,
)
from epcontact.harness.gates import ERROR, FALLS_SHORT
from epcontact.harness.methods.registry import METHODS, REPLACED, Method, solver_named
from epcontact.harness.verdict import read_back
from epcontact.harness.verdict.judgement import (
    SKIPPED,
    CaseVerdict,
    Verdict,
    judge_case,
)
from epcontact.harness.verdict.made import Made
from epcontact.scene import as_tuple

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

EARLIER = "earlier-"  # before the names of the files of an earlier run


def verify(
    cases: str | Path | Case | Iterable[str | Path | Case] | None = None,
    run: Run | None = None,
    *,
    size: str = "fast",
    solver: str = "",
    finish: Callable[[Verdict], None] = lambda verdict: None,
    judged: Callable[[CaseVerdict], None] = lambda case: None,
    **options: Any,
) -> Verdict:
    """Solve cases, judge their gates, and write verdict.json and junit.xml.

    Args:
        cases: a name, a path or a loaded case, or several of them; None or empty: the
            cases of a bare `epcontact verify`.  A file with variants means all of them.
        run: how the cases are solved, see `Run`; or its attributes as keywords:
            `output`, `jobs`, `executor`, `fresh`, `fields`, `precision` and `progress`.
        size: the size at which names and paths are loaded.
        solver: a registered method, `[NAME=]MODULE:FUNCTION` or `[NAME=]COMMAND` (see
            `harness.methods.foreign`), which replaces the boundary elements in every
            gate, under its own name.
        finish: called with the verdict while no other run may write into the folder; an
            error of it withdraws the verdict.
        judged: called with each case as soon as all its solves are done.

    Returns:
        The verdict.  `verdict.cases[i].answers` holds the results in memory.

    Raises:
        InvalidCase, InvalidScene: if a case or the solver cannot be read, or an option
        is none. OutputError: if a file cannot be written, or does not say what was
        judged.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     verdict = verify("bearing-area", output=folder, jobs=1)
        >>> verdict.passed, verdict.cases[0].gates[0].status
        (True, 'holds')
    """
    run, made = replace(run or Run(), **options), Made.here()
    with only_writer(run.folder):
        set_verdict_aside(run.folder)
        loaded, methods = _with_solver(cases, size, solver)
        found: dict[str, CaseVerdict] = {}

        def done(case: Case, answers: Mapping[str, Answer]) -> None:
            judged(found.setdefault(case.id, judge_case(case, answers)))

        answers = run_cases(loaded, run, methods, done)
        for case in loaded:  # such as are skipped have no solve to end
            if case.id not in found:
                done(case, answers[case.id])
        verdict = Verdict.on([found[case.id] for case in loaded], size, made)
        write_verdict(verdict, run.folder)
        read_back.require_faithful(run.folder)
        for name in read_back.FILES:  # there is a new verdict
            with contextlib.suppress(OSError):
                (run.folder / f"{EARLIER}{name}").unlink()
        try:
            finish(verdict)
        except (
            BaseException
        ):  # the caller ends in an error, and the verdict would not say so
            read_back.withdraw(run.folder)
            raise
    return verdict


def _with_solver(
    cases: Any, size: str, solver: str
) -> tuple[list[Case], dict[str, Method]]:
    """Return loaded cases, with a solver in the place of the boundary elements, and all
    methods.
    """
    methods = dict(METHODS)
    named = (
        [cases] if isinstance(cases, Case) else [] if cases is None else as_tuple(cases)
    )
    loaded = _loaded(named or cases_to_verify(size), size)
    if solver:
        stand_in = solver_named(solver)
        methods[stand_in.name] = stand_in
        loaded = [_in_place(case, stand_in.name) for case in loaded]
        if not any(stand_in.name in case.methods for case in loaded):
            why = f"it takes the place of {REPLACED}, which none of the cases names"
            raise InvalidCase(f"--solver {solver} would judge nothing: {why}")
    return loaded, methods


def _loaded(cases: Iterable[str | Path | CaseText | Case], size: str) -> list[Case]:
    named: list[CaseText | Case] = []
    for case in cases:
        if not isinstance(case, str | Path | CaseText | Case):
            raise InvalidCase(
                f"cases has {case!r:.60}, but must be names, paths or loaded cases"
            )
        named += find_named(case) if isinstance(case, str | Path) else [case]
    loaded = load_cases(named, size)
    for given, one in zip(named, loaded, strict=True):
        if given is not one:
            require_gate(one)
    return loaded


def require_gate(case: Case) -> None:
    """Raise InvalidCase if a case has no gate to judge, which would pass for one that
    holds.
    """
    if not case.gates and not case.skip:
        raise InvalidCase(
            f"{case.path}: {case.id} has no gate to judge; add a table [[gate]], or verify = false "
            f"to [case], and solve it by `epcontact {'run' if case.sweep is None else 'sweep'}`"
        )


def cases_to_verify(size: str) -> list[CaseText]:
    """Return the cases that `epcontact verify` runs at a size if none is named."""
    if size not in SIZES:
        raise InvalidCase(f"no size is called {size!r}{nearest(size, SIZES)}")
    cases = find_cases()
    if not cases:
        raise InvalidCase(
            "no cases found, neither in ./cases nor in the installed package"
        )
    offered = [case for case in cases if size in case.sizes]
    loaded = [*zip(offered, load_cases(offered, size), strict=True)]
    for case in (case for _, case in loaded if case.head.verify and case.sweep is None):
        require_gate(case)
    return [
        text for text, case in loaded if case.head.verify and (case.gates or case.skip)
    ]


def _in_place(case: Case, name: str) -> Case:
    """Return the case with another method instead of the boundary elements, unless it
    names it.
    """
    if name in case.methods:
        return case

    def named(method: Any) -> Any:
        return name if method == REPLACED else method

    gates = (
        replace(gate, of=named(gate.of), against=named(gate.against))
        for gate in case.gates
    )
    options = {named(m): {} if m == REPLACED else o for m, o in case.options.items()}
    methods = tuple(map(named, case.methods))
    return case.changed(methods=methods, options=options, gates=tuple(gates))


# --- the files
# -----------------------------------------------------------------------------------


@contextlib.contextmanager
def only_writer(folder: Path) -> Iterator[None]:
    """Keep others of this machine out of a folder, which is made, and removed if it
    stays empty.
    """
    made = [place for place in (folder, *folder.parents) if not place.exists()]
    with contextlib.ExitStack() as stack:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if fcntl is not None:
                held = os.open(folder, os.O_RDONLY)
                stack.callback(os.close, held)
                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(
                f"cannot write {folder}: another run is writing its verdict"
            ) from None
        except OSError as error:
            raise output_error("write", folder, error) from None
        try:
            yield
        finally:
            for place in made:
                with contextlib.suppress(OSError):  # not empty
                    place.rmdir()


def set_verdict_aside(folder: Path) -> None:
    """Rename the verdict of an earlier run, which would pass for that of a run that
    breaks off.  It stays, with `EARLIER` before its name, until there is a new one.
    """
    for path in (folder / name for name in read_back.FILES):
        if (
            path.is_file()
        ):  # what else has that name is refused when the file is written
            try:
                path.replace(path.with_name(f"{EARLIER}{path.name}"))
            except OSError as error:
                raise output_error("rename", path, error) from None


def write_verdict(verdict: Verdict, folder: Path) -> None:
    """Write verdict.json and junit.xml into `folder`, whole or not at all."""
    digest = {"digest": read_back.digest_of(verdict.content, folder)}
    write_json(folder / "verdict.json", verdict.content | digest)
    xml = JUnitXml("epcontact")
    for case in verdict.cases:
        suite = _suite(case)
        if verdict.made:
            suite.timestamp = verdict.made.date
        xml.add_testsuite(suite)
    xml.update_statistics()  # type: ignore[no-untyped-call]
    with atomic_write(folder / "junit.xml") as path:
        xml.write(str(path), pretty=True)


@contextlib.contextmanager
def signed_again(folder: Path) -> Iterator[None]:
    """Sign the verdict of a folder for the answers that are written meanwhile, if it
    was signed for those before and its figures are those of the new ones.
    """
    verdict = None
    with contextlib.suppress(OutputError):
        verdict = Verdict.read(folder / "verdict.json")
    yield
    if verdict and not read_back.contradictions(verdict.content, folder):
        write_verdict(verdict, folder)


def _suite(case: CaseVerdict) -> TestSuite:
    suite = TestSuite(case.id)
    kinds = {ERROR: Error, FALLS_SHORT: Failure}
    tests: list[tuple[str, Any, str]] = [
        (gate.name, kinds.get(gate.status), gate.error or str(gate))
        for gate in case.gates
    ]
    tests += [
        ("a method that no gate reads", Error, words) for words in case.unread_errors
    ]
    if case.status == SKIPPED:
        tests = [(case.requirement, Skipped, case.skipped_because)]
    # As in pytest, the first gate that reads a method waits for its solves.
    left = {name: fsum(entry.seconds.values()) for name, entry in case.methods.items()}
    waits = [
        fsum(left.pop(str(m), 0.0) for m in (g.of, g.against)) for g in case.gates
    ] or [0.0]
    waits[0] += fsum(left.values())
    for (name, kind, words), wait in zip(
        tests, chain(waits, repeat(0.0)), strict=False
    ):
        # XML has no word for most control characters: names and messages show them as
        # escapes.
        test = TestCase(printable(name), classname=case.id, time=wait)
        test.result = [kind(printable(words))] if kind else []
        suite.add_testcase(test)
    for gate, test in zip(case.gates, suite, strict=False):
        told = Properties()  # type: ignore[no-untyped-call]
        for name, value in (("reference", gate.kind), ("verifies", gate.subject)):
            told.append(Property(name, value))  # type: ignore[no-untyped-call]
        test.append(told)  # type: ignore[no-untyped-call]
    return suite
