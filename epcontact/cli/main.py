"""The command line: list, keys, run and verify here, the rest in `cli_studies`.

Exit code 0: all gates hold (or the command did what it was asked); 1: a gate fell short; 2: an
error, told in one sentence.  130: interrupted.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from epcontact.cli.commands import COMMANDS
from epcontact.errors import EpcontactError
from epcontact.harness import case as casefile
from epcontact.harness.case import Case
from epcontact.harness.methods import METHODS

#: Raised by click where a command is missing, with the help as its message; since click 8.2.
_NO_ARGUMENTS: type[click.UsageError] | tuple[()]
_NO_ARGUMENTS = getattr(click.exceptions, "NoArgsIsHelpError", ())


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
    type=click.Choice((*casefile.SIZES, "auto")),
    default="fast",
    show_default=True,
    help="Which of a case's sizes to run; auto: the cheapest that its gates allow.",
)
_jobs = click.option(
    "--jobs",
    type=click.IntRange(min=1),
    default=None,
    help="Worker processes; the cores are shared out among them. "
    "Default: one a core, and one alone for size large.",
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
    from epcontact.harness.schema import key_table

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
    type=click.Choice(list(METHODS)),
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
    from epcontact.cli.tables import answers_table
    from epcontact.harness.pictures import write_pictures
    from epcontact.harness.run import Plan, run_cases

    loaded = _load(casefile.find_case(case), size)
    absent = [m for m in methods if m not in loaded.methods]
    if absent:
        raise click.UsageError(
            f"{loaded.id} has no method {absent[0]}; it has {', '.join(loaded.methods)}"
        )
    if loaded.skip:
        raise _Refusal(f"{loaded.path}: {loaded.skip}")
    plan = Plan(_jobs_or_cores(jobs, size), output, fields=fields, fresh=fresh)
    chosen = {loaded.id: methods or loaded.methods}
    with _progress([loaded], chosen, plan) as progress:
        answers = run_cases([loaded], chosen, plan, progress)[loaded.id]
    _console().print(answers_table(answers))
    if "persson" in answers:
        _tell_gamma([loaded])
    errors = [sentence for answer in answers.values() for sentence in answer.errors]
    if errors:
        raise _Refusal(f"{loaded.id}: {'; '.join(errors)}")
    if fields != "none":
        write_pictures(loaded, answers, output / loaded.id)
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
@click.option("--report", "with_report", is_flag=True, help="Write charts and report.html too.")
def verify(
    cases: tuple[str, ...],
    size: str,
    jobs: int | None,
    output: Path,
    fresh: bool,
    solver: str,
    with_report: bool,
) -> None:
    """Run the gates of the cases (all, where none is named) and write the verdict.

    Writes verdict.json and junit.xml into the output folder.
    """
    from epcontact.cli.tables import STYLES, print_shortfalls, verdict_table
    from epcontact.harness.run import Plan, run_cases
    from epcontact.harness.verdict import exit_code, judge_case, write_verdict

    loaded = _cases_to_verify(cases, size)
    kept = "first" if with_report else "none"
    plan = Plan(_jobs_or_cores(jobs, size), output, solver=solver, fields=kept, fresh=fresh)
    methods = {case.id: case.methods for case in loaded}
    with _progress(loaded, methods, plan) as progress:
        answers = run_cases(loaded, methods, plan, progress)
    outcomes = [judge_case(case, answers[case.id]) for case in loaded]
    write_verdict(outcomes, size, output)
    if with_report:
        _write_report(loaded, answers, output)
    console = _console()
    console.print(verdict_table(outcomes, console.width))
    _tell_gamma(loaded)
    for outcome in outcomes:
        print_shortfalls(console, outcome)
    counts = [sum(o.status == s for o in outcomes) for s in STYLES]
    summary = ", ".join(f"{n} {s}" for n, s in zip(counts, STYLES, strict=True) if n)
    console.print(f"{len(outcomes)} cases: {summary}; verdict in {output / 'verdict.json'}")
    sys.exit(exit_code(outcomes))


for _command in COMMANDS:
    cli.add_command(_command)


def _tell_gamma(cases: Sequence[Case]) -> None:
    from epcontact.cli.tables import gamma_sentence

    if sentence := gamma_sentence(cases):
        click.echo(sentence)


def _load(path: Path, size: str) -> Case:
    """A case at a size; auto starts from its full size, or its only one."""
    if size != "auto":
        return casefile.load_case(path, size)
    from epcontact.planning.auto_size import auto_case

    sizes = [each for each in casefile.case_sizes(path) if each != "large"]
    given = casefile.load_case(path, (sizes or ["large"])[-1])
    if given.skip:
        return given
    case, sentence = auto_case(given)
    click.echo(sentence, err=True)
    return case


def _cases_to_verify(names: Sequence[str], size: str) -> list[Case]:
    if names:
        return [_load(casefile.find_case(name), size) for name in names]
    paths = casefile.find_cases()
    if not paths:
        raise _Refusal("no cases found, neither in ./cases nor in the installed package")
    needed = "fast" if size == "auto" else size
    offered = [p for p in paths if needed in casefile.case_sizes(p)]
    return [_load(p, size) for p in offered if casefile.load_case(p, needed).verify]


def _write_report(cases: Sequence[Case], answers: Any, output: Path) -> None:
    from epcontact.harness.pictures import theory_densities, write_pictures
    from epcontact.output.report import report_folder

    for case in cases:
        if not case.skip:
            write_pictures(case, answers[case.id], output / case.id)
    report_folder(output, theory=theory_densities)


def _jobs_or_cores(jobs: int | None, size: str) -> int:
    from epcontact.harness.run import available_cores

    # Large grids are solved one by one, each with all cores: two would not fit into memory.
    return jobs or (1 if size == "large" else available_cores())


@contextlib.contextmanager
def _progress(cases: Sequence[Case], methods: Any, plan: Any) -> Iterator[Any]:
    """A bar on a terminal, a line a solve elsewhere; both on stderr."""
    from epcontact.harness.run import Task, tasks_of

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

        def advance(task: Task, note: str) -> None:
            nonlocal done
            done += 1
            what = f"{task.case.id} {task.method} {task.label}"
            bar.update(row, advance=1, description=what)
            if not console.is_terminal:
                told = f" ({note})" if note else ""
                click.echo(f"[{done}/{total}] {what}{told}", err=True)

        yield advance


def main() -> None:
    """Entry point: whatever goes wrong on purpose is one sentence on stderr and exit code 2."""
    signal.signal(signal.SIGTERM, _terminated)
    try:
        sys.exit(cli.main(prog_name="epcontact", standalone_mode=False))
    except (click.Abort, KeyboardInterrupt):
        code, sentence = 130, "interrupted; results finished so far are kept"
    except EpcontactError as error:
        code, sentence = 2, str(error)
    except _NO_ARGUMENTS as error:
        click.echo(error.format_message(), err=True)
        code, sentence = 2, ""
    except click.ClickException as error:
        code, sentence = 2, f"{error.format_message()} (see epcontact --help)"
    except SystemExit as end:
        # click and rich turn a closed pipe into exit code 1, which says that a gate fell short.
        if not isinstance(end.__context__, BrokenPipeError):
            raise
        _forget_output()
        code, sentence = 2, ""
    except BrokenPipeError:
        _forget_output()
        code, sentence = 2, ""
    except Exception:
        # A bug: its traceback is wanted, Python's exit code 1 for it is not.
        traceback.print_exc()
        code, sentence = 2, "this is a mistake of epcontact's own; please report it"
    if sentence:
        # A name may hold any character; one that moves the cursor is shown, not obeyed.
        shown = "".join(c if c.isprintable() else repr(c)[1:-1] for c in sentence)
        click.echo(f"epcontact: {shown}", err=True)
    sys.exit(code)


def _forget_output() -> None:
    """The reader of a pipe has left: nobody is there to be told, at exit neither."""
    with contextlib.suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _terminated(*_: object) -> None:
    raise KeyboardInterrupt
