"""The main job: `verify` runs cases, judges their gates and writes the verdict."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from epcontact.errors import InvalidCase, nearest
from epcontact.harness.answers.run import Run, run_cases
from epcontact.harness.case_files.case import (
    SIZES,
    Case,
    CaseText,
    find_cases,
    find_named,
    load_cases,
)
from epcontact.harness.methods.registry import METHODS, REPLACED, solver_named
from epcontact.harness.verdict.files import (
    content,
    remove_earlier_verdict,
    set_verdict_aside,
    write_verdict,
)
from epcontact.harness.verdict.judgement import judge_case
from epcontact.harness.verdict.read_back import require_faithful
from epcontact.harness.verdict.record import Verdict
from epcontact.scene import listed


def verify(
    cases: str | Path | Case | Iterable[str | Path | Case] | None = None,
    run: Run | None = None,
    *,
    size: str = "fast",
    solver: str = "",
    **options: Any,
) -> Verdict:
    """Solve cases, judge their gates, and write verdict.json and junit.xml.

    Args:
        cases: a name, a path or a loaded case, or several of them; None or empty: the cases of a
            bare `epcontact verify`.  A file with variants means all of them.
        run: how the cases are solved, see `Run`; or its attributes as keywords: `output`, `jobs`,
            `executor`, `fresh`, `fields`, `precision` and `progress`.
        size: the size at which names and paths are loaded.
        solver: a registered method, `[NAME=]MODULE:FUNCTION` or `[NAME=]COMMAND` (see
            `harness.methods.exchange`), which replaces the boundary elements in every gate, under
            its own name.

    Returns:
        The verdict.  `verdict.cases[i].answers` holds the results in memory.

    Raises:
        InvalidCase, InvalidScene: if a case or the solver cannot be read, or an option is none.
        OutputError: if a file cannot be written, or does not say what was judged.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     verdict = verify("bearing-area", output=folder, jobs=1)
        >>> verdict.passed, verdict.cases[0].gates[0].status
        (True, 'holds')
    """
    run = replace(run or Run(), **options)
    set_verdict_aside(run.folder)
    methods = dict(METHODS)
    named = [cases] if isinstance(cases, Case) else [] if cases is None else listed(cases)
    loaded = _loaded(named or cases_to_verify(size), size)
    if solver:
        stand_in = solver_named(solver)
        methods[stand_in.name] = stand_in
        loaded = [_in_place(case, stand_in.name) for case in loaded]
        if not any(stand_in.name in case.methods for case in loaded):
            raise InvalidCase(
                f"--solver {solver} would judge nothing: it takes the place of {REPLACED}, which "
                "none of the cases names"
            )
    answers = run_cases(loaded, run, methods)
    verdict = Verdict.on([judge_case(case, answers[case.id]) for case in loaded], size)
    write_verdict(verdict, run.folder)
    require_faithful(run.folder, content(verdict))
    remove_earlier_verdict(run.folder)
    return verdict


def _loaded(cases: Iterable[str | Path | CaseText | Case], size: str) -> list[Case]:
    named: list[CaseText | Case] = []
    for case in cases:
        if not isinstance(case, str | Path | CaseText | Case):
            raise InvalidCase(f"cases has {case!r:.60}, but must be names, paths or loaded cases")
        named += find_named(case) if isinstance(case, str | Path) else [case]
    loaded = load_cases(named, size)
    for given, one in zip(named, loaded, strict=True):
        if given is not one and not one.gates and not one.skip:
            raise InvalidCase(
                f"{one.path}: {one.id} has no gate to judge; `epcontact sweep` solves its sweep"
            )
    return loaded


def cases_to_verify(size: str) -> list[CaseText]:
    """Return the cases that `epcontact verify` runs at a size if none is named."""
    if size not in SIZES:
        raise InvalidCase(f"no size is called {size!r}{nearest(size, SIZES)}")
    cases = find_cases()
    if not cases:
        raise InvalidCase("no cases found, neither in ./cases nor in the installed package")
    offered = [case for case in cases if size in case.sizes]
    loaded = zip(offered, load_cases(offered, size), strict=True)
    return [text for text, case in loaded if case.head.verify and (case.gates or case.skip)]


def _in_place(case: Case, name: str) -> Case:
    """Return the case with another method instead of the boundary elements, unless it names it."""
    if name in case.methods:
        return case

    def named(method: Any) -> Any:
        return name if method == REPLACED else method

    gates = (replace(gate, of=named(gate.of), against=named(gate.against)) for gate in case.gates)
    options = {named(m): {} if m == REPLACED else o for m, o in case.options.items()}
    methods = tuple(map(named, case.methods))
    return case.changed(methods=methods, options=options, gates=tuple(gates))
