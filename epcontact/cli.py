"""The command line: list, keys, run, verify.

Exit code 0: all gates hold (or the command did what it was asked); 1: a gate fell short; 2: an
error, told in one sentence.  130: interrupted.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from epcontact import casefile
from epcontact.casefile import Case
from epcontact.errors import EpcontactError

STYLES = {"holds": "green", "falls short": "bold red", "error": "bold red", "skipped": "yellow"}


class _Refusal(EpcontactError):
    """What the command line itself refuses."""


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="epcontact")
def cli() -> None:
    """Cross-validate rough elastoplastic contact: theory, boundary and finite elements."""


def _console() -> Console:
    """Standard output; piped, it is as wide as a table needs rather than 80 columns."""
    plain = Console()
    return plain if plain.is_terminal else Console(width=200)


_size = click.option(
    "--size",
    type=click.Choice(casefile.SIZES),
    default="fast",
    show_default=True,
    help="Which of a case's sizes to run.",
)
_jobs = click.option(
    "--jobs",
    type=click.IntRange(min=1),
    default=None,
    help="Worker processes; the cores are shared out among them. Default: one a core.",
)
_output = click.option(
    "--output",
    type=click.Path(path_type=Path),
    default=Path("results"),
    show_default=True,
    help="Folder for results; those already there of the same scene and sources are reused.",
)
_fresh = click.option("--fresh", is_flag=True, help="Solve again what is already there.")
_fields = click.option(
    "--fields",
    type=click.Choice(["first", "all", "none"]),
    default="first",
    show_default=True,
    help="Write the fields (.vti) of the first surface, of all of them, or of none.",
)


@cli.command("list")
def list_cases() -> None:
    """List the cases, one line each."""
    table = Table(box=None, pad_edge=False)
    for heading in ("case", "sizes", "methods", "requirement"):
        table.add_column(heading, overflow="fold")
    for path in casefile.find_cases():
        sizes = casefile.case_sizes(path)
        case = casefile.load_case(path, sizes[0])
        table.add_row(case.id, " ".join(sizes), " ".join(case.methods), case.requirement)
    _console().print(table)


@cli.command()
def keys() -> None:
    """Print every key of a case file with its unit and meaning."""
    from epcontact.schema import key_table

    table = Table("table", "key", "default", "meaning", box=None, pad_edge=False)
    for row in key_table():
        table.add_row(*row)
    _console().print(table)


@cli.command()
@click.argument("case")
@click.option(
    "--method",
    "methods",
    multiple=True,
    type=click.Choice(["persson", "bem", "fem"]),
    help="Only this method; may be repeated. Default: all that the case names.",
)
@_size
@_jobs
@_output
@_fresh
@_fields
def run(
    case: str,
    methods: tuple[str, ...],
    size: str,
    jobs: int | None,
    output: Path,
    fresh: bool,
    fields: str,
) -> None:
    """Solve one case and write its results and fields; no gate is judged."""
    from epcontact.run import Plan, run_cases

    loaded = casefile.load_case(casefile.find_case(case), size)
    absent = [m for m in methods if m not in loaded.methods]
    if absent:
        raise click.UsageError(
            f"{loaded.id} has no method {absent[0]}; it has {', '.join(loaded.methods)}"
        )
    if loaded.skip:
        raise _Refusal(f"{loaded.path}: {loaded.skip}")
    plan = Plan(_jobs_or_cores(jobs), output, fields=fields, fresh=fresh)
    chosen = {loaded.id: methods or loaded.methods}
    with _progress([loaded], chosen, plan) as progress:
        answers = run_cases([loaded], chosen, plan, progress)[loaded.id]
    _console().print(_answers_table(answers))
    errors = [sentence for answer in answers.values() for sentence in answer.errors]
    if errors:
        raise _Refusal(f"{loaded.id}: {'; '.join(errors)}")
    click.echo(f"results in {output / loaded.id}")


@cli.command()
@click.argument("cases", nargs=-1)
@_size
@_jobs
@_output
@_fresh
@click.option(
    "--solver",
    default="",
    metavar="MODULE:FUNCTION",
    help="Hold this function Scene -> ContactResult to the gates in the place of bem.",
)
def verify(
    cases: tuple[str, ...], size: str, jobs: int | None, output: Path, fresh: bool, solver: str
) -> None:
    """Run the gates of the cases (all, where none is named) and write the verdict.

    Writes verdict.json and junit.xml into the output folder.
    """
    from epcontact.run import Plan, run_cases
    from epcontact.verify import exit_code, judge_case, write_verdict

    loaded = _cases_to_verify(cases, size)
    plan = Plan(_jobs_or_cores(jobs), output, solver=solver, fresh=fresh)
    methods = {case.id: case.methods for case in loaded}
    with _progress(loaded, methods, plan) as progress:
        answers = run_cases(loaded, methods, plan, progress)
    outcomes = [judge_case(case, answers[case.id]) for case in loaded]
    write_verdict(outcomes, size, output)
    console = _console()
    console.print(_verdict_table(outcomes))
    for outcome in outcomes:
        _print_shortfalls(console, outcome)
    counts = [sum(o.status == s for o in outcomes) for s in STYLES]
    summary = ", ".join(f"{n} {s}" for n, s in zip(counts, STYLES, strict=True) if n)
    console.print(f"{len(outcomes)} cases: {summary}; verdict in {output / 'verdict.json'}")
    sys.exit(exit_code(outcomes))


def _cases_to_verify(names: Sequence[str], size: str) -> list[Case]:
    if names:
        return [casefile.load_case(casefile.find_case(name), size) for name in names]
    paths = casefile.find_cases()
    if not paths:
        raise _Refusal("no cases found, neither in ./cases nor in the installed package")
    loaded = [casefile.load_case(p, size) for p in paths if size in casefile.case_sizes(p)]
    return [case for case in loaded if case.verify]


def _jobs_or_cores(jobs: int | None) -> int:
    from epcontact.run import available_cores

    return jobs or available_cores()


@contextlib.contextmanager
def _progress(cases: Sequence[Case], methods: Any, plan: Any) -> Iterator[Any]:
    """A bar on a terminal, a line a solve elsewhere; both on stderr."""
    from epcontact.run import Task, tasks_of

    console = Console(stderr=True)
    total = sum(len(tasks_of(case, methods[case.id], plan)) for case in cases)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    with bar:
        row = bar.add_task("solving", total=total)
        done = 0

        def advance(task: Task, reused: bool) -> None:
            nonlocal done
            done += 1
            what = f"{task.path.stem} {task.method} {task.label}"
            bar.update(row, advance=1, description=what)
            if not console.is_terminal:
                note = " (reused)" if reused else ""
                click.echo(f"[{done}/{total}] {what}{note}", err=True)

        yield advance


def _answers_table(answers: Any) -> Table:
    from epcontact.compare import estimate

    table = Table(box=None, pad_edge=False)
    headings = ("method", "areas", "total", "elastic", "plastic", "surfaces", "reused")
    for heading in headings:
        table.add_column(heading, justify="left" if heading in ("method", "areas") else "right")
    for method, answer in answers.items():
        for kind in ("raw", "corrected"):
            if not answer.results or kind not in answer.results[0].final.areas:
                continue
            parts = [
                _figure(estimate([getattr(r.final.areas[kind], p) for r in answer.results]))
                for p in ("total", "elastic", "plastic")
            ]
            table.add_row(method, kind, *parts, str(len(answer.results)), str(answer.reused))
    return table


def _verdict_table(outcomes: Any) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in ("case", "quantity", "of", "against", "value", "reference"):
        table.add_column(heading, overflow="fold")
    table.add_column("difference", justify="right")
    table.add_column("band", justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    for outcome in outcomes:
        if outcome.case.skip:
            table.add_row(outcome.case.id, *[""] * 7, f"[{STYLES['skipped']}]skipped[/]")
        name = outcome.case.id
        for gate in outcome.gates:
            table.add_row(name, *_gate_row(gate))
            name = ""
    return table


def _gate_row(outcome: Any) -> tuple[str, ...]:
    gate, verdict = outcome.gate, outcome.verdict
    against = gate.against if isinstance(gate.against, str) else "number"
    status = f"[{STYLES[outcome.status]}]{outcome.status}[/]"
    if verdict is None:
        return (gate.quantity, gate.of, against, "", "", "", "", status)
    percent = gate.norm == "relative" and max(abs(gate.low), abs(gate.high)) >= 1e-4

    def show(x: float) -> str:
        return f"{100 * x:+.2f} %" if percent else f"{x:+.2e}"

    difference = show(verdict.difference.mean)
    if verdict.difference.half_width:
        difference += f" ± {show(verdict.difference.half_width).lstrip('+')}"
    symmetric = gate.low == -gate.high
    band = f"± {show(gate.high)[1:]}" if symmetric else f"{show(gate.low)} … {show(gate.high)}"
    values = (_figure(verdict.value), _figure(verdict.reference))
    return (gate.quantity, gate.of, against, *values, difference, band, status)


def _figure(estimate: Any) -> str:
    if not estimate.half_width:
        return f"{estimate.mean:.5g}"
    return f"{estimate.mean:.5g} ± {estimate.half_width:.1g}"


def _print_shortfalls(console: Console, outcome: Any) -> None:
    from epcontact.verify import describe

    if outcome.case.skip:
        console.print(f"{outcome.case.id}: {outcome.case.skip}", markup=False)
    for gate in outcome.gates:
        if gate.status != "holds":
            console.print(f"{outcome.case.id}: {describe(gate)}", markup=False)


def main() -> None:
    """Entry point: whatever goes wrong on purpose is one sentence on stderr and exit code 2."""
    signal.signal(signal.SIGTERM, _terminated)
    try:
        sys.exit(cli.main(prog_name="epcontact", standalone_mode=False))
    except (click.Abort, KeyboardInterrupt):
        code, sentence = 130, "interrupted; results finished so far are kept"
    except EpcontactError as error:
        code, sentence = 2, str(error)
    except click.ClickException as error:
        code, sentence = 2, f"{error.format_message()} (see epcontact --help)"
    except BrokenPipeError:
        # The reader of a pipe has left; nobody is there to be told.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code, sentence = 2, ""
    if sentence:
        click.echo(f"epcontact: {sentence}", err=True)
    sys.exit(code)


def _terminated(*_: object) -> None:
    raise KeyboardInterrupt
