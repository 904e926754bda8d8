"""The main job: `verify` solves cases, judges their gates and writes the verdict."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from epcontact.errors import InvalidCase, nearest
from epcontact.harness.case_files.case import (
    SIZES,
    Case,
    CaseText,
    find_cases,
    find_named,
    load_cases,
)
from epcontact.harness.methods.registry import METHODS, REPLACED, Method, solver_named
from epcontact.harness.solving.run import lock_cases, solve_cases
from epcontact.harness.solving.tasks import Progress, Run
from epcontact.harness.verdict.files import delete_verdict, write_verdict
from epcontact.harness.verdict.judgement import CaseVerdict, Verdict, judge_case
from epcontact.harness.verdict.run_info import RunInfo
from epcontact.notebook import OnProgress, notebook_bar
from epcontact.scene import as_tuple


def _ignore(verdict: Verdict | CaseVerdict) -> None:
    """Do nothing with a verdict; this is `verify`'s default for its two callbacks."""


def verify(
    cases: str | Path | Case | Iterable[str | Path | Case] | None = None,
    run: Run | None = None,
    *,
    size: str = "fast",
    solver: str = "",
    finish: Callable[[Verdict], None] = _ignore,
    on_case: Callable[[CaseVerdict], None] = _ignore,
    **options: Any,
) -> Verdict:
    """Solve cases, judge their gates, and write verdict.json and junit.xml.

    Those of an earlier run are deleted first, so that a run that is interrupted leaves
    no verdict.  A notebook shows the progress.

    Args:
        cases: a name, a path or a loaded case, or several of them; None or empty: the
            cases of a bare `epcontact verify`.  A file with variants means all of them.
        run: how the cases are solved, see `Run`; or its attributes as keywords:
            `output`, `jobs`, `executor`, `fresh`, `fields`, `precision` and `progress`.
        size: the size at which names and paths are loaded.
        solver: a registered method, `[NAME=]MODULE:FUNCTION` or `[NAME=]COMMAND` (see
            `harness.methods.foreign`), which replaces the boundary elements in every
            gate, under its own name.
        finish: called with the verdict after its files are written.  They stay if it
            raises, because all is judged.
        on_case: called with the verdict on each case as soon as it is judged.

    Returns:
        The verdict.  `verdict.cases[i].results` holds the results in memory.

    Raises:
        InvalidCase, InvalidScene: if a case or the solver cannot be read, or if there
            is no such option.
        OutputError: if a file cannot be written.

    Example:
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     verdict = verify("bearing-area", output=folder, jobs=1)
        >>> verdict.passed, verdict.cases[0].gates[0].status
        (True, 'holds')
    """
    has_progress = run is not None or "progress" in options
    known = {field.name for field in fields(Run)}
    for name in options.keys() - known:
        raise InvalidCase(f"verify has no option {name!r}{nearest(name, known)}")
    run = replace(run or Run(), **options)
    made = RunInfo.here()
    # A case with a mistake leaves the verdict of the run before.
    loaded, methods = _load(cases, size, solver)
    delete_verdict(run.folder)
    verdicts: dict[str, CaseVerdict] = {}
    # The lock lasts until the verdict is signed with the digest of the results.
    with notebook_bar() as bar, lock_cases(loaded, run.folder):
        if bar is not None and not has_progress:
            run = replace(run, progress=_counted(bar))
        with contextlib.closing(solve_cases(loaded, run, methods)) as solving:
            for case, results in solving:
                judged = judge_case(case, results)
                if _has_foreign_solver(judged):
                    # The hints load the solvers.
                    from epcontact.harness.verdict.hints import with_hints

                    judged = with_hints(judged)
                verdicts[case.id] = judged
                on_case(judged)
        verdict = Verdict.on([verdicts[case.id] for case in loaded], size, made)
        write_verdict(verdict, run.folder)
    finish(verdict)
    return verdict


def _has_foreign_solver(case: CaseVerdict) -> bool:
    """Return whether a result of a case is by a solver from outside the package."""
    return any(
        result.is_foreign
        for method in case.results.values()
        for result in method.results[:1]
    )


def _counted(bar: OnProgress) -> Progress:
    """Return a `Progress` that moves the bar of a notebook and counts the solves."""
    last = ""

    def report(done: float, total: int, words: str) -> None:
        """Show that so many of all solves are done, and the last that was finished."""
        nonlocal last
        last = words or last
        bar(done / max(total, 1), f"{int(done)} of {total} solves: {last}")

    return report


# --- the cases and the methods


def _load(cases: Any, size: str, solver: str) -> tuple[list[Case], dict[str, Method]]:
    """Load the cases of a verification, and the solver that replaces a method in them.

    Args:
        cases, size, solver: see `verify`.

    Returns:
        The cases, in which the solver replaces the boundary elements; and all methods
        by their names, the solver included.

    Raises:
        InvalidCase: if a case or the solver cannot be read, or if no case names the
            method that the solver replaces.
    """
    methods = dict(METHODS)
    if isinstance(cases, Case):
        cases = [cases]
    named = () if cases is None else as_tuple(cases)
    loaded = _load_with_gates(named or cases_to_verify(size), size)
    loaded = [case.to_judge() for case in loaded]
    if solver:
        replacement = solver_named(solver)
        methods[replacement.name] = replacement
        loaded = [_with_solver(case, replacement.name) for case in loaded]
        if not any(replacement.name in case.methods for case in loaded):
            why = f"it takes the place of {REPLACED}, which none of the cases names"
            raise InvalidCase(f"--solver {solver} would judge nothing: {why}")
    return loaded, methods


def _load_with_gates(
    cases: Iterable[str | Path | CaseText | Case], size: str
) -> list[Case]:
    """Return the cases at a size, in their order.

    Args:
        cases: names, paths, texts of cases, or cases that are loaded already.  A file
            with variants gives all of them.
        size: the size at which the cases are loaded.

    Raises:
        InvalidCase: if a case cannot be read, is of another type, or has no gate.  A
            case that is loaded already needs no gate.
    """
    texts: list[CaseText | Case] = []
    for case in cases:
        if not isinstance(case, str | Path | CaseText | Case):
            raise InvalidCase(
                f"cases has {case!r:.60}, but must be names, paths or loaded cases"
            )
        if isinstance(case, str | Path):
            texts += find_named(case)
        else:
            texts.append(case)
    loaded = load_cases(texts, size)
    for text, case in zip(texts, loaded, strict=True):
        if text is not case:
            require_gate(case)
    return loaded


def require_gate(case: Case) -> None:
    """Raise InvalidCase if a case has no gate at its size and is not skipped.

    Without this check, such a case would count as one that holds.
    """
    if not case.gates and not case.skip:
        command = "run" if case.sweep is None else "sweep"
        raise InvalidCase(
            f"{case.path}: {case.id} has no gate to judge; add a table [[gate]], or "
            f"verify = false to [case], and solve it by `epcontact {command}`"
        )


def cases_to_verify(size: str) -> list[CaseText]:
    """Return the cases that `epcontact verify` runs if none is named.

    These are the cases in the folder `cases` of the current folder, or else those of
    the package, that offer the size, have a gate at it, and do not set
    `verify = false`.

    Raises InvalidCase if there is no such size, if there are no cases, or if one of
    them cannot be read or has no gate at all.
    """
    if size not in SIZES:
        raise InvalidCase(f"no size is called {size!r}{nearest(size, SIZES)}")
    cases = find_cases()
    if not cases:
        raise InvalidCase(
            "no cases found, neither in ./cases nor in the installed package"
        )
    offered = [case for case in cases if size in case.sizes]
    chosen = []
    for text, case in zip(offered, load_cases(offered, size), strict=True):
        if not case.head.verify:
            continue
        if case.sweep is None:
            require_gate(case)
        if case.gates or case.skip:
            chosen.append(text)
    return chosen


def _with_solver(case: Case, name: str) -> Case:
    """Return a copy of the case in which a method replaces the boundary elements.

    The replacement has no options.  A case that names this method already is returned
    unchanged.

    Args:
        case: the case.
        name: the name of the method that replaces them, in methods and gates.
    """
    if name in case.methods:
        return case

    def renamed(method: Any) -> Any:
        """Return the side of a gate, with the replacement's name if it is "bem"."""
        return name if method == REPLACED else method

    gates = tuple(
        replace(gate, of=renamed(gate.of), against=renamed(gate.against))
        for gate in case.gates
    )
    options = dict(case.options)
    if options.pop(REPLACED, None) is not None:
        options[name] = {}
    methods = tuple(map(renamed, case.methods))
    return case.changed(methods=methods, options=options, gates=gates)
