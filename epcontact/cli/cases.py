"""The commands that solve: run and verify."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import click
from rich.table import Table

from epcontact.cli import options, tables
from epcontact.cli.listing import open_console
from epcontact.cli.main import forget_output, tell
from epcontact.errors import EpcontactError
from epcontact.files import require_links_inside
from epcontact.harness.case_files.case import (
    Case,
    CaseText,
    find_case,
    find_named,
    load_case,
)
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.solving.method_results import MethodResults
from epcontact.harness.solving.run import run_cases
from epcontact.harness.solving.tasks import Run
from epcontact.harness.verdict import verification as verifying
from epcontact.harness.verdict.files import delete_verdict
from epcontact.harness.verdict.judgement import CaseVerdict, Verdict
from epcontact.harness.verdict.overview import overview, references
from epcontact.output.charts.figures import Pictures
from epcontact.surfaces import HeightsFromFile, Mirrored


@click.command()
@click.argument("case")
@click.option(
    "--method",
    "methods",
    multiple=True,
    type=click.Choice(list(METHODS)),
    help="Only this method; may be repeated. Default: all that the case names.",
)
@options.size
@options.of_run("jobs", "output", "fresh", "precision")
@options.fields
@click.option(
    "--charts", is_flag=True, help="Draw charts, which take as long as a large solve."
)
def run(
    case: str,
    methods: tuple[str, ...],
    size: str,
    run: Run,
    fields: str | None,
    charts: bool,
) -> None:
    """Solve one case and write its results and fields; no gate is judged."""
    loaded = _load(find_case(case), size)
    if absent := [m for m in methods if m not in loaded.methods]:
        raise click.UsageError(
            f"{loaded.id} has no method {absent[0]}; it has {', '.join(loaded.methods)}"
        )
    if loaded.skip:
        raise EpcontactError(f"{loaded.path}: {loaded.skip}")
    chosen = loaded.changed(methods=tuple(dict.fromkeys(methods)) or loaded.methods)
    run = replace(
        run, fields="steps" if fields == "film" else fields or "first", rows=True
    )
    with options.shown_progress(run) as shown:
        results = run_cases([chosen], shown)[loaded.id]
    console = open_console()
    console.print(tables.results_table(results, console.width))
    tables.print_surface_notes(console, chosen, results)
    theory = results["persson"].results[:1] if {"persson"} < results.keys() else ()
    told = (
        tables.gamma_sentence(chosen),
        *(r.notes[-1] for r in theory),
        chosen.told_hardness,
    )
    for sentence in filter(None, told):
        tables.print_hanging(console, str(sentence))
    if errors := [
        sentence for method in results.values() for sentence in method.errors
    ]:
        raise EpcontactError(f"{loaded.id}: {'; '.join(errors)}")
    if charts:
        _draw(chosen, results, run.folder)
    if fields == "film":
        _draw_films(chosen, run.folder)
    click.echo(f"results in {chosen.folder(run.folder)}")


@click.command()
@click.argument("cases", nargs=-1)
@options.size
@options.of_run("jobs", "output", "fresh", "executor", "precision")
@click.option(
    "--solver",
    default="",
    metavar="[NAME=]SOLVER",
    help="Judge another solver by the gates instead of bem, in a process of its own: "
    "MODULE:FUNCTION, which maps a Scene to a ContactResult; a method's name; or a command in any "
    "language with the placeholders {scene} and {result}.",
)
@click.option(
    "--report", "with_report", is_flag=True, help="Write charts and report.html too."
)
@click.option(
    "--gates", "all_gates", is_flag=True, help="Print each gate of each case."
)
@options.fields
def verify(
    cases: tuple[str, ...],
    size: str,
    run: Run,
    solver: str,
    with_report: bool,
    all_gates: bool,
    fields: str | None,
) -> None:
    """Run the gates of the cases (all, where none is named) and write the verdict.

    Prints a line for each case with its tightest gate: the margin is the band over the
    difference with its interval, and 1 or more holds.  Of a case that does not hold,
    every gate follows.

    Writes verdict.json and junit.xml into the output folder, after those of an earlier
    run are deleted.

    \b
    A command reads the scene from one text file and writes its result to the other:
      --solver 'mine=./my_solver {scene} {result}'
    `python -m pydoc epcontact.harness.methods.foreign` describes them line by line.
    """
    output = run.folder
    given: Sequence[str | Case] = cases
    fields = fields or ("first" if with_report else "none")
    if size == "auto":
        delete_verdict(output)
        named = [case for name in cases for case in find_named(name)]
        given = [
            _load(case, size) for case in named or verifying.cases_to_verify("fast")
        ]
    run = replace(run, fields="steps" if fields == "film" else fields)
    if with_report:
        require_links_inside(output)  # the report would refuse them after all solves

    def draw(verdict: Verdict) -> None:
        if fields == "film":
            for judged in verdict.cases:
                _draw_films(judged.case, output)
        if with_report:
            _write_report(verdict, output)

    judged: list[CaseVerdict] = []

    def live(lines: int, width: int) -> Table:  # those that do not hold stay in sight
        return tables.cases_table(
            sorted(judged, key=lambda c: c.status != "holds")[-lines:], width
        )

    with options.shown_progress(run, live) as shown:
        verdict = verifying.verify(
            given, shown, size=size, solver=solver, finish=draw, judged=judged.append
        )
    try:
        _show(verdict, output, all_gates, with_report)
    except (
        BrokenPipeError,
        SystemExit,
    ):  # nobody reads on; the verdict is the exit code
        forget_output()
    sys.exit(verdict.exit_code)


_PLURAL = {"holds": "hold", "falls short": "fall short", "error": "errors"}


def _show(verdict: Verdict, output: Path, all_gates: bool, with_report: bool) -> None:
    """Print the verdict: cases, gates, what does not hold, what was not judged, what to
    do next.
    """
    console = open_console()
    shown = [c for c in verdict.cases if all_gates or (c.gates and c.status != "holds")]
    if not all_gates:
        console.print(tables.cases_table(verdict.cases, console.width))
    if shown:
        console.print(tables.verdict_table(shown, console.width))
    alone = all_gates or len(verdict.cases) == 1
    for case in verdict.cases:
        if isinstance(next(iter(case.case.recipes), None), HeightsFromFile | Mirrored):
            tables.print_surface_notes(console, case.case, case.results)
        if (
            alone
            and case.case.lists_loads
            and any(a.results for a in case.results.values())
        ):
            console.print(f"\nloads of {case.id}")
            console.print(tables.results_table(case.results, console.width))
        if told := case.case.told_hardness:
            tables.print_hanging(console, f"{case.id}: {told}")
        tables.print_shortfalls(console, case)
    counts = {s: sum(case.status == s for case in verdict.cases) for s in tables.STYLES}
    summary = ", ".join(
        f"{n} {_PLURAL.get(s, s) if n > 1 else s}" for s, n in counts.items() if n
    )
    cases = "1 case" if len(verdict.cases) == 1 else f"{len(verdict.cases)} cases"
    tables.print_hanging(console, references(verdict))
    tables.print_hanging(
        console, f"{cases}: {summary}; verdict in {output / 'verdict.json'}"
    )
    if left_out := sum(len(case.not_judged) for case in verdict.cases):
        told = f"{left_out} {'gates are' if left_out > 1 else 'gate is'} left out at this size"
        tables.print_hanging(console, f"{told}; verdict.json says which and why")
    steps = [] if all_gates else ["--gates prints each gate"]
    if not with_report:
        steps.append(
            f"`epcontact report {shlex.quote(str(output))}` draws charts and a page"
        )
    if not verdict.passed:
        steps.append("the same command solves again only what has changed")
    if steps:
        tables.print_hanging(console, f"next: {'; '.join(steps)}")
    sys.stdout.flush()


def _write_report(verdict: Verdict, output: Path) -> None:
    """Draw the pictures of all cases that were solved and write the page of them."""
    from epcontact.output.report import report_folder  # with jinja2

    judged_cases = {judged.id: judged for judged in verdict.cases}

    def draw_case(case_id: str, *_: object) -> Pictures:
        judged = judged_cases[case_id]
        if judged.skipped_because:
            return Pictures(())
        return _draw(judged.case, judged.results, output)

    report_folder(output, verdict.content, overview=overview(verdict), draw=draw_case)


def _draw(case: Case, results: Mapping[str, MethodResults], output: Path) -> Pictures:
    """Draw the pictures of a case; print why some could not be drawn."""
    # Charts take long to load.
    from epcontact.pictures.folder import draw_case

    pictures = draw_case(case, results, case.folder(output))
    for sentence in pictures.missing:
        tell(f"epcontact: {sentence}")
    return pictures


def _draw_films(case: Case, output: Path) -> None:
    """Draw a film of every load path of a case; print where, or why it is left out."""
    from epcontact.pictures.folder import draw_films

    folder = case.folder(output)
    films = draw_films(folder)
    for name in films.names:
        click.echo(f"film in {folder / name}.gif")
    for sentence in films.missing:
        tell(f"epcontact: {sentence}")


def _load(text: CaseText, size: str) -> Case:
    """Load a case at a size; "auto" makes it cheaper by a plan and says so on
    stderr.
    """
    if size != "auto":
        return load_case(text, size)
    from epcontact.planning import load_auto  # no other size needs a plan

    case, sentence = load_auto(text)
    if sentence:
        tell(sentence)
    return case
