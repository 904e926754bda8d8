"""The commands that solve cases: run and verify."""

from __future__ import annotations

import shlex
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import click
from rich.console import Console

import epcontact
from epcontact.cli import tables
from epcontact.cli.main import discard_output, print_error, print_text
from epcontact.cli.progress import show_progress
from epcontact.cli.terminal import open_console, print_sentence
from epcontact.errors import EpcontactError, OutputError
from epcontact.files import require_links_inside
from epcontact.harness.case_files.case import (
    Case,
    CaseText,
    find_case,
    find_named,
    load_case,
)
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.solving.measure import left_out_sentence
from epcontact.harness.solving.method_results import MethodResults
from epcontact.harness.solving.run import run_cases
from epcontact.harness.solving.tasks import Progress, Run
from epcontact.harness.verdict.files import delete_verdict
from epcontact.harness.verdict.judgement import CaseVerdict, Verdict
from epcontact.harness.verdict.overview import least_margin, overview
from epcontact.harness.verdict.verification import cases_to_verify
from epcontact.surfaces import HeightsFromFile, Mirrored


def run(
    case: str,
    methods: tuple[str, ...],
    size: str,
    settings: Run,
    fields: str | None,
    charts: bool,
) -> None:
    """Solve one case and write its results and fields; no gate is judged.

    The arguments are those of `commands.run`.
    """
    (loaded,) = _load([find_case(case)], size)
    if loaded.skip:
        raise EpcontactError(f"{loaded.path}: {loaded.skip}")
    chosen = _with_methods(loaded, methods)
    settings = replace(settings, fields=_fields_of_run(fields or "first"), rows=True)
    with show_progress("run") as progress:
        solving = replace(settings, progress=progress)
        results = run_cases([chosen], solving)[loaded.id]
    console = open_console()
    # `_mean_row` in `harness/solving/method_results.py` computes the number behind each
    # ± of this table, from the errors that `LoadStep.row` in `results.py` lists.
    if any(method.results for method in results.values()):
        console.print(tables.results_table(results, console.width))
        print_sentence(console, tables.MEANING_OF_ERRORS)
    for sentence in tables.leak_sentences(results):
        print_sentence(console, sentence)
    tables.print_surface_notes(console, chosen, results)
    for sentence in _sentences_on_models(chosen, results):
        print_sentence(console, sentence)
    errors = [error for method in results.values() for error in method.errors]
    if errors:
        raise EpcontactError(f"{loaded.id}: {'; '.join(errors)}")
    if charts:
        _draw(chosen, results, settings.folder)
    if fields == "film":
        with show_progress("run"):
            films = _draw_films(chosen, settings.folder)
        _print_films(films)
    _note_old_verdict(settings.folder)
    folder = chosen.folder(settings.folder)
    print_text(f"results in {folder}")
    for peak in sorted(folder.glob("*-peak.vti")):
        last = peak.name.replace("-peak", "")
        print_text(f"fields at the largest load in {peak.name}, at the last in {last}")


def _with_methods(case: Case, methods: tuple[str, ...]) -> Case:
    """Return a case with the methods that a user chose, or with all that can run here.

    A sentence on stderr names each method that is left out because it cannot run.

    Args:
        case: the case.
        methods: names of methods; empty: all.

    Raises:
        EpcontactError: if a chosen method cannot run here.
        click.UsageError: if the case does not name a chosen method.
    """
    for method in methods:
        if method in case.missing:
            raise EpcontactError(f"{case.path}: {method}: {case.missing[method]}")
        if method not in case.methods:
            raise click.UsageError(
                f"{case.id} has no method {method}; it has {', '.join(case.methods)}"
            )
    if not methods:
        for method, reason in case.missing.items():
            print_error(f"{method} is left out: {reason}")
    available = case.with_available_methods()
    return available.changed(methods=tuple(dict.fromkeys(methods)) or available.methods)


def _note_old_verdict(output: Path) -> None:
    """Print a sentence on stderr if the verdict in a folder is about earlier results.

    `output` is the folder of the results of all cases; it may have no verdict.
    """
    file = output / "verdict.json"
    if not file.is_file():
        return
    try:
        Verdict.read(file)
    except OutputError:
        print_error(
            f"epcontact: {file} is about earlier results than those in the folder now; "
            "run `epcontact verify` again, which solves nothing twice"
        )


def _fields_of_run(fields: str) -> str:
    """Return the value of `Run.fields` for a value of the option --fields.

    They are the same words, but a "film" is drawn from the fields of every load,
    "steps".
    """
    if fields == "film":
        return "steps"
    return fields


def _sentences_on_models(case: Case, results: Mapping[str, MethodResults]) -> list[str]:
    """Return the sentences that `epcontact run` prints below its table.

    They are about the theory's energy reduction gamma, the theory's error by the map of
    its errors (if another method is solved, too), a hardness that was looked up for a
    J2 body, and the columns that are left out on a large grid.  A sentence that does
    not apply is left out.

    Args:
        case: The case.
        results: Its results by method.
    """
    sentences = [tables.gamma_sentence(case)]
    if "persson" in results and len(results) > 1:
        for result in results["persson"].results[:1]:
            sentences.append(result.notes[-1])
    sentences.append(str(case.told_hardness or ""))
    if any(METHODS[name].has_fields for name in results):
        sentences.append(left_out_sentence(case))
    return [sentence for sentence in sentences if sentence]


def verify(
    cases: tuple[str, ...],
    size: str,
    settings: Run,
    solver: str,
    with_report: bool,
    all_gates: bool,
    fields: str | None,
) -> None:
    """Run the gates of the cases (all, where none is named) and write the verdict.

    The arguments are those of `commands.verify`.
    """
    output = settings.folder
    given: Sequence[str | Case] = cases
    if size == "auto":
        # `epcontact.verify` deletes it too, but only after the sizes are chosen below,
        # which takes long and may fail.
        delete_verdict(output)
        given = _load_auto(cases)
    if fields is None:
        fields = "none"
        if with_report:
            fields = "first"
    settings = replace(settings, fields=_fields_of_run(fields))
    if with_report:
        require_links_inside(output)  # the report would refuse them after all solves

    not_holding: list[str] = []
    drawing_errors: list[str] = []

    def count_case(case: CaseVerdict) -> None:
        """Note the id of a judged case that does not hold, for the line of progress."""
        if case.status not in ("holds", "skipped"):
            not_holding.append(case.id)

    with show_progress("verify") as show:

        def progress(done: float, total: int, words: str) -> None:
            """Show the progress, and how many cases do not hold; see `Run.progress`."""
            if words and not_holding:
                words += f"; cases that do not hold: {len(not_holding)}"
            show(done, total, words)

        def draw(verdict: Verdict) -> None:
            """Draw the films and the report of a verdict that the options ask for."""
            try:
                _draw_verdict(verdict, output, fields == "film", with_report, show)
            except EpcontactError as error:  # the verdict is printed first
                drawing_errors.append(f"{error}; the verdict is complete")

        verdict = epcontact.verify(
            given,
            replace(settings, progress=progress),
            size=size,
            solver=solver,
            finish=draw,
            on_case=count_case,
        )
    try:
        _print_verdict(verdict, output, all_gates, with_report)
    except (BrokenPipeError, SystemExit):
        discard_output()  # nobody reads on; the verdict is the exit code
    if drawing_errors:
        raise EpcontactError(*drawing_errors)
    sys.exit(verdict.exit_code)


def _load_auto(names: Sequence[str]) -> list[Case]:
    """Return cases at size "auto", whose grids are chosen by plans.

    `names` are names or files of cases; if there are none, the cases are those that
    `epcontact verify` runs without arguments.  Raises InvalidCase for a bad case.
    """
    texts = [text for name in names for text in find_named(name)]
    return _load(texts or cases_to_verify("fast"), "auto")


#: The most cases that have a line each; more are counted by what they verify.
_MOST_CASES = 20
#: The words for several cases of a status, where they differ from those for one.
_PLURAL = {"holds": "hold", "falls short": "fall short", "error": "errors"}


def _print_verdict(
    verdict: Verdict, output: Path, all_gates: bool, with_report: bool
) -> None:
    """Print a verdict on standard output, and commands that the user may run next.

    Args:
        verdict: The verdict.
        output: The folder with its verdict.json.
        all_gates: Whether the gates of all cases are printed; else those of the cases
            that do not hold, below a table of the cases or of what they verify.
        with_report: Whether the report was written, so that no command for it is named.
    """
    console = open_console()
    tables.print_summary(console, verdict)
    ordered = sorted(verdict.cases, key=least_margin)
    if all_gates:
        in_detail = list(verdict.cases)
    else:
        in_detail = [case for case in ordered if case.gates and case.status != "holds"]
        table = tables.cases_table(ordered, console.width)
        if len(ordered) > _MOST_CASES:
            table = tables.subjects_table(verdict, console.width)
        console.print()
        console.print(table)
    if in_detail:
        console.print()
        console.print(tables.verdict_table(in_detail, console.width))
    with_loads = all_gates or len(verdict.cases) == 1
    for case in verdict.cases:
        _print_case(console, case, with_loads)
    print_sentence(console, f"{_counts(verdict)}; verdict in {output / 'verdict.json'}")
    steps = []
    if not all_gates:
        steps.append("--gates prints each gate")
    if not with_report:
        folder = shlex.quote(str(output))
        steps.append(f"`epcontact report {folder}` draws charts and a page")
    if not verdict.passed:
        steps.append("the same command solves again only what has changed")
    if steps:
        print_sentence(console, f"next: {'; '.join(steps)}")
    sys.stdout.flush()


def _print_case(console: Console, case: CaseVerdict, with_loads: bool) -> None:
    """Print what the tables of a verdict leave out of a judged case.

    This is: notes on a measured map, the table of its loads (if `with_loads`, and only
    for a case that lists its loads), the hardness that was looked up for a J2 body (if
    `with_loads`), and the gates that do not hold.
    """
    recipe = next(iter(case.case.recipes), None)
    if isinstance(recipe, HeightsFromFile | Mirrored):
        tables.print_surface_notes(console, case.case, case.results)
    is_solved = any(method.results for method in case.results.values())
    if with_loads and case.case.lists_loads and is_solved:
        print_text(f"\nloads of {case.id}")
        console.print(tables.results_table(case.results, console.width))
        print_sentence(console, tables.MEANING_OF_ERRORS)
    if with_loads and case.case.told_hardness:
        print_sentence(console, f"{case.id}: {case.case.told_hardness}")
    for sentence in case.hints:
        print_sentence(console, f"{case.id}: {sentence}")
    tables.print_shortfalls(console, case)


def _counts(verdict: Verdict) -> str:
    """Return the numbers of cases by status in words, such as "3 cases: 3 hold".

    The statuses are those of `tables.STYLES`; a status without a case is left out.
    """
    counts = Counter[str](case.status for case in verdict.cases)
    parts = []
    for status in tables.STYLES:
        count = counts[status]
        if count:
            words = _PLURAL.get(status, status) if count > 1 else status
            parts.append(f"{count} {words}")
    total = len(verdict.cases)
    cases = "1 case" if total == 1 else f"{total} cases"
    return f"{cases}: {', '.join(parts)}"


def _draw_verdict(
    verdict: Verdict,
    output: Path,
    with_films: bool,
    with_report: bool,
    progress: Progress,
) -> None:
    """Draw the films and the report of a verdict that the options ask for.

    Args:
        verdict: The verdict.
        output: The folder of the results, in which the files are written.
        with_films: Whether a film of each load path is drawn (--fields film).
        with_report: Whether charts and report.html are written (--report).
        progress: Called as the pictures of each case are drawn.

    Raises:
        OutputError: A file cannot be written.
    """
    if with_films:
        for judged_case in verdict.cases:
            _print_films(_draw_films(judged_case.case, output))
    if with_report:
        _write_report(verdict, output, progress)


def _write_report(verdict: Verdict, output: Path, progress: Progress) -> None:
    """Draw the pictures of all solved cases and write report.html.

    Args:
        verdict: The verdict.
        output: Folder of the results, in which the report is written.
        progress: Called as the pictures of each case are drawn.

    Raises:
        OutputError: A file cannot be written.
    """
    # Templates and charts take long to load.
    from epcontact.output.report import report_folder
    from epcontact.pictures.drawn import draw_solved_cases

    solved = {judged.id: (judged.case, judged.results) for judged in verdict.cases}
    draw = partial(draw_solved_cases, progress=progress, solved=solved)
    report_folder(output, verdict.content, overview=overview(verdict), draw=draw)


def _draw(case: Case, results: Mapping[str, MethodResults], output: Path) -> None:
    """Draw the pictures of a case into its folder.

    A picture that cannot be drawn has a sentence on stderr with the reason.

    Args:
        case: The case.
        results: Its results by method.
        output: Folder of the results of all cases.
    """
    # Charts take long to load.
    from epcontact.pictures.folder import draw_case

    with show_progress("run"):
        pictures = draw_case(case, results, case.folder(output), vector=True)
    for sentence in pictures.missing:
        print_error(f"epcontact: {sentence}")


def _draw_films(case: Case, output: Path) -> tuple[list[Path], Sequence[str]]:
    """Draw a film (.gif) of each load path of a case whose fields were written.

    Args:
        case: The case.
        output: Folder of the results of all cases.

    Returns:
        The paths of the films, and why some could not be drawn.
    """
    from epcontact.pictures.folder import draw_films

    folder = case.folder(output)
    films = draw_films(folder)
    return [folder / f"{name}.gif" for name in films.names], films.missing


def _print_films(films: tuple[list[Path], Sequence[str]]) -> None:
    """Print the paths of films on standard output, and on stderr why some are missing.

    `films` is what `_draw_films` returns.
    """
    paths, missing = films
    for path in paths:
        print_text(f"film in {path}")
    for sentence in missing:
        print_error(f"epcontact: {sentence}")


def _load(texts: Sequence[CaseText], size: str) -> list[Case]:
    """Return cases at a size.

    At the size "auto" the grids are chosen by plans, as coarse as the gates allow, and
    sentences on stderr describe the plans.  Raises InvalidCase for a bad case.
    """
    if size != "auto":
        return [load_case(text, size) for text in texts]
    from epcontact.planning import load_auto  # no other size needs a plan

    cases = []
    sentences = []
    with show_progress("plan") as progress:
        for text in texts:
            case, sentence = load_auto(text)
            cases.append(case)
            sentences.append(sentence)
            progress(len(cases), len(texts), f"grid of {case.id}")
    for sentence in sentences:
        if sentence:
            print_error(sentence)
    return cases
