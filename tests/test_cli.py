"""The command line as its user meets it: verdicts, exit codes, one sentence for every
mistake.
"""

import io
import itertools
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
import tomllib
import types
import xml.etree.ElementTree as ET
from pathlib import Path

import click
import numpy as np
import psutil
import pytest
from command_line import invoke, python
from conftest import ROUGH
from rich.console import Console

from epcontact.cli import list_cases, main, progress
from epcontact.cli.ascii_forms import ASCII_FORMS, encodable
from epcontact.cli.main import COMMANDS, cli
from epcontact.cli.options import OutputFile
from epcontact.cli.progress import ProgressLine, show_progress, show_sentences
from epcontact.cli.tables import (
    cases_table,
    loads_table,
    results_table,
    verdict_table,
)
from epcontact.cli.terminal import new_table, print_rows, print_sentence, text_of
from epcontact.errors import OutputError, sentence_of
from epcontact.harness.case_files.case import find_case, load_case
from epcontact.harness.case_files.text import case_files, case_name, find_cases
from epcontact.harness.solving.load_path import solve_path
from epcontact.harness.solving.run import run_cases
from epcontact.harness.solving.saved import load_saved
from epcontact.harness.solving.tasks import Run, tasks_of
from epcontact.harness.verdict.compare import RELEASE_VALUES
from epcontact.harness.verdict.judgement import Verdict
from epcontact.harness.verdict.verification import cases_to_verify, verify
from epcontact.output.loads import load_cells
from epcontact.output.view import load_steps
from epcontact.output.vtk import read_fields
from epcontact.planning.plan import load_auto
from epcontact.results import COLUMNS
from epcontact.scene import Load

ONE = ("seeds = [3, 5, 7]", "seeds = [3]")
PATH = ("mean_pressure = 5.0e8", "mean_pressure = [2.0e8, 5.0e8]")
COMMAND = [sys.executable, "-m", "epcontact"]
THREADS = ("--executor", "concurrent.futures:ThreadPoolExecutor")


def refused(done, *words):
    """Require exit code 2 and one line on stderr that begins with epcontact: and has
    all `words`.
    """
    assert done.returncode == 2, done
    assert done.stderr.startswith("epcontact: ")
    assert done.stderr.count("\n") == 1, done.stderr
    assert all(word in done.stderr for word in words), done.stderr


#: A rough steel for the command `hardness`.
STEEL = (
    *("--yield-stress", "2e9", "--young-modulus", "2e11", "--poisson-ratio", "0.3"),
    *("--rms-slope", "0.1", "--mean-pressure", "5e8"),
)

# --- what there is
# -------------------------------------------------------------------------------


def test_schemas_and_commands_are_listed():
    """`schema` prints JSON schemas, and `--help` each command with its first line of
    help.
    """
    assert all(
        "$defs" in json.loads(invoke("schema", k).stdout) for k in ("case", "verdict")
    )
    listed = " ".join(invoke("--help").stdout.split())
    for name in COMMANDS:
        command = cli.get_command(click.Context(cli), name)
        assert command.name == name
        assert f"{name} {(command.help or '').partition(chr(10))[0]}" in listed


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (("list", "--all"), "at E*xi/sigma_Y = 5"),
        (("chart",), "validity "),
        (("hardness", *STEEL), "at E*xi/sigma_Y = 11, p0/sigma_Y = 0.25"),
    ],
)
@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
def test_an_output_without_greek_letters_has_their_names(command, words, encoding):
    """An output without Greek letters in its encoding has their names, in tables and in
    sentences.
    """
    done = python(
        "-m", "epcontact", *command, env=os.environ | {"PYTHONIOENCODING": encoding}
    )
    assert done.returncode == 0, done.stderr
    assert words in done.stdout
    assert (done.stdout + done.stderr).isascii()


def test_no_word_is_lost_in_ascii(monkeypatch):
    """In ASCII a table has "+-" and "um" and stays aligned, and a letter with an accent
    loses it; a character without a form is a question mark.
    """
    words = "5 ± 1 µm, E*ξ/σ_Y ≤ 3 × 10², Wang–Müser … √2 漢"
    forms = "5 +- 1 um, E*xi/sigma_Y <= 3 x 10^2, Wang-Muser ... sqrt2 ?"
    assert encodable(words, "ascii") == forms
    assert encodable(words, None) == words
    out = io.TextIOWrapper(io.BytesIO(), encoding="ascii", errors=ASCII_FORMS)
    monkeypatch.setattr(sys, "stdout", out)
    table = new_table(("area ± 95 %",), ("band",))
    table.add_row("0.1 ± 0.01", "1")
    table.add_row("0.1", "2")
    Console(width=80, file=out).print(table)
    out.flush()
    heading, first, second = out.buffer.getvalue().decode("ascii").splitlines()
    assert heading.split() == ["area", "+-", "95", "%", "band"]
    assert first.split() == ["0.1", "+-", "0.01", "1"]
    assert first.rindex("1") == second.index("2")


def test_a_verdict_without_colour_has_its_words(monkeypatch, capsys):
    """NO_COLOR and a dumb terminal take the colours of statuses, not their words."""
    for name, value in (("NO_COLOR", "1"), ("TERM", "dumb"), ("FORCE_COLOR", "1")):
        monkeypatch.setenv(name, value)
        console = Console(width=100)
        console.print(text_of("falls short", "bold red"))
        said = capsys.readouterr().out
        assert "falls short" in said
        assert "\x1b[31m" not in said
        assert ";31" not in said


@pytest.mark.parametrize(
    "words", ["--help", "list", *(f"{name} --help" for name in COMMANDS)]
)
def test_help_and_lists_load_no_solver(words):
    """`list` and the help of every command load neither numpy nor other heavy
    libraries.

    `words` is the command line.
    """
    program = (
        f"import atexit, sys; sys.argv = ['epcontact', *{words.split()}]\n"
        "loaded = lambda: {'numpy', 'numba', 'pydantic', 'pyvista'} & "
        "set(sys.modules)\n"
        "atexit.register(lambda: print(sorted(loaded())))\n"
        "from epcontact.cli.main import main; main()"
    )
    assert python("-c", program).stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_a_command_ends_with_examples_that_can_be_typed(name):
    """click accepts the arguments of each example."""
    command = cli.get_command(click.Context(cli), name)
    said = invoke(name, "--help").stdout
    for example in main.EXAMPLES[name]:
        assert f"  epcontact {example}" in said
        words = shlex.split(example.partition(" > ")[0])
        assert words[0] == name
        command.make_context(name, words[1:])


def test_help_is_as_wide_as_the_terminal(monkeypatch):
    """Lines of a help text are longer on a wider terminal."""
    widest = {}
    for columns in (80, 110):
        monkeypatch.setenv("COLUMNS", str(columns))
        widest[columns] = max(map(len, invoke("run", "--help").stdout.splitlines()))
    assert 60 < widest[80] <= 80 < widest[110] <= 110


def test_the_list_has_each_case_and_says_what_a_bare_verify_leaves_out(monkeypatch):
    """`list` names each case file once on less than a screen, with the number of its
    cases, and marks those of which a bare verify runs none.

    `list --all` has a row for each case, and `list hertz` those of these names.
    """
    monkeypatch.setattr(list_cases, "open_console", lambda: Console(width=80))
    listed = invoke("list").stdout
    assert len(listed.splitlines()) < 40
    names = re.findall(r"([\w-]+)(?: \((\d+)\))?(\*?)(?:,|$)", listed, re.MULTILINE)
    found = {name: (int(count or 1), mark) for name, count, mark in names}
    run = {case.id for case in cases_to_verify("fast")}
    cases = find_cases()
    for path in case_files():
        ids = [case.id for case in cases if case.path == path]
        mark = "" if run.intersection(ids) else "*"
        assert found[case_name(path)] == (len(ids), mark)

    def rows_of(*words):
        """Return the first lines of the paragraphs that `list` prints."""
        said = invoke("list", *words).stdout
        return [line for line in said.splitlines() if line[:1].strip()]

    rows = rows_of("--all")
    assert [row.split()[0] for row in rows] == [case.id for case in cases]
    left_out = "not in a bare verify"
    assert {row.split()[0] for row in rows if left_out not in row} == run
    assert {row.split()[0] for row in rows_of("hertz")} == {
        case.id for case in cases if "hertz" in case.id
    }
    refused(invoke("list", "no-such-word"), "no-such-word", "epcontact list")


# --- new
# -------------------------------------------------------------------------------


def test_new_writes_cases_that_hold_and_overwrites_nothing(tmp_path, monkeypatch):
    """`new solver` and `new rough` write cases that are ready to verify; a second call
    is refused.
    """
    monkeypatch.chdir(tmp_path)
    assert invoke("new", "solver").returncode == 0
    done = invoke("verify", "my-solver.toml", "--jobs", 1)
    assert done.returncode == 0, done
    refused(invoke("new", "solver"), "my-solver.toml exists already")
    assert invoke("new", "rough", "--output", "mine.toml").returncode == 0
    case = load_case(find_case("mine.toml"))
    assert case.id == "mine"
    assert case.methods == ("persson", "bem")
    refused(invoke("new", "rouhg"), "rouhg", "rough, solver")
    refused(invoke("new", "rough", "--output", "a.txt"), "a.txt", ".toml")


def test_a_map_for_a_case_leads_to_new_which_writes_its_case(tmp_path, monkeypatch):
    """`run` of a map names the command that writes a case for it, which asks to check
    the unit and the pixel size that the file does not state.
    """
    monkeypatch.chdir(tmp_path)
    x, y = np.meshgrid(np.arange(24.0), np.arange(20.0), indexing="ij")
    np.savetxt("my steel.csv", np.sin(0.9 * x) * np.cos(1.1 * y), delimiter=";")
    command = "epcontact new 'my steel.csv'"
    refused(invoke("run", "my steel.csv"), "map of heights", command)
    done = invoke("new", "my steel.csv")
    assert done.stdout.count("check: ") == 2
    assert load_case(find_case("my-steel.toml")).methods == ("bem",)
    table = tomllib.loads(Path("my-steel.toml").read_text())["surface"]
    found = [table[key] for key in ("path", "unit", "pixel_size")]
    assert found == ["my steel.csv", 1e-6, 1e-6]
    sizes = ("--unit", "1e-9", "--pixel-size", "2e-6", "--output", "other.toml")
    assert "check: " not in invoke("new", "my steel.csv", *sizes).stdout
    table = tomllib.loads(Path("other.toml").read_text())["surface"]
    assert [table["unit"], table["pixel_size"]] == [1e-9, 2e-6]


# --- run and verify
# ------------------------------------------------------------------------------


def test_verify_holds_or_falls_short_and_writes_the_verdict(
    write_case, tmp_path, monkeypatch
):
    """`verify` writes verdict.json and junit.xml, and exits with 0 if all gates hold,
    else 1.
    """
    out = tmp_path / "with space"
    done = invoke("verify", write_case(), "--output", out, "--jobs", 2)
    assert done.returncode == 0, done
    verdict = json.loads((out / "verdict.json").read_text())
    gate, *defaults = verdict["cases"][0]["gates"]
    assert verdict["passed"]
    assert gate["status"] == "holds"
    assert gate["value"]["surfaces"] == 3
    suite = ET.parse(out / "junit.xml").getroot()
    assert suite.attrib["tests"] == str(1 + len(defaults))
    assert suite.attrib["failures"] == "0"
    narrow = write_case(("tolerance = 0.5", "tolerance = 1e-9"))
    done = invoke("verify", narrow, "yardstick", "--output", out, "--jobs", 1)
    assert done.returncode == 1
    assert "only a smoke test" in " ".join(done.stdout.split())
    monkeypatch.setenv("FORCE_COLOR", "1")  # a terminal: a bar
    live = invoke(
        "verify", narrow, "yardstick", "--output", out, "--jobs", 1, "--fresh"
    ).stderr
    assert "cases that do not hold: 1" in live
    assert ET.parse(out / "junit.xml").getroot().attrib["failures"] == "1"


def test_run_writes_results_and_fields_once(write_case, tmp_path):
    """`run` writes JSON and one field file, prints a warning once, and
    reuses results.
    """
    case = write_case(("rms_slope = 0.1", "rms_slope = 1.1"))
    run = ("run", case, "--method", "bem", "--output", tmp_path, "--jobs", 1)
    done = invoke(*run)
    folder = tmp_path / "small" / "fast"
    assert done.returncode == 0, done
    assert done.stdout.count("the rms slope is 1.1, beyond the small slopes") == 1
    summary = json.loads((folder / "bem.json").read_text())
    assert {"seconds", "fft_pairs", "unknowns", "peak_memory_bytes"} <= set(
        summary["cost"]
    )
    assert [*folder.glob("*.vti")] == [folder / "bem-seed3.vti"]
    assert not (folder / "persson.json").exists()
    assert "reused" not in done.stderr
    assert invoke(*run).stderr == "run: 3 of 3, 3 reused\n"
    assert "reused" not in invoke(*run, "--fresh").stderr


def test_a_case_without_a_gate_is_run_and_passes_for_no_verified_one(
    write_case, tmp_path, monkeypatch
):
    """A case without a gate can be run, but `verify` and the pytest plugin
    refuse it.
    """
    path = write_case(ONE)
    path.write_text(path.read_text().partition("[[gate]]")[0])
    done = invoke("run", path, "--method", "persson", "--output", tmp_path)
    assert done.returncode == 0, done
    assert "persson" in done.stdout, done
    (tmp_path / "cases").mkdir()
    path = path.rename(tmp_path / "cases" / path.name)
    monkeypatch.chdir(tmp_path)
    missing = "small has no gate to judge; add a table [[gate]]"
    refused(invoke("verify"), missing)
    refused(invoke("verify", path), missing)
    (tmp_path / "pytest.ini").write_text("[pytest]\nepcontact_cases = *.toml\n")
    plugin = ("-p", "epcontact.harness.pytest_plugin")
    done = python("-m", "pytest", "-q", *plugin, "cases", cwd=tmp_path)
    assert done.returncode == 2
    assert missing in done.stdout
    assert "Traceback" not in done.stdout
    path.write_text(path.read_text().replace("[case]", "[case]\nverify = false"))
    assert "no gate" not in invoke("verify").stderr


def test_every_load_is_written_and_reused_where_asked(write_case, tmp_path):
    """`fields="first"` writes the last load's fields of the first surface, "steps" of
    each load, and a saved result is reused if its fields fit.

    Double precision serves a run that asks for single, but not the other way round.
    Missing or spoilt files are solved again, and those of another load are deleted.
    """
    methods = ('methods = ["persson", "bem"]', 'methods = ["bem", "fem"]')
    fem = ("[load]", '[fem]\nlaw = "elastic"\nlayers = 2\n\n[load]')
    case = load_case(
        write_case(ONE, PATH, methods, fem, ('against = "persson"', 'against = "fem"'))
    )
    folder = case.folder(tmp_path)
    notes = []

    def reused(fields, precision="single"):
        """Return how many of the two results a run with these fields reuses."""
        notes.clear()

        def told(done, total, words):
            """Append whether the progress message says that a result was reused."""
            notes.append("(reused)" in words)

        run_cases(
            [case], Run(tmp_path, 1, fields=fields, precision=precision, progress=told)
        )
        return sum(notes)

    assert [reused("first", "double"), reused("first", "single")] == [0, 2]
    assert read_fields(folder / "bem-seed3.vti").fields["pressure"].dtype == np.float64
    (folder / "bem-seed3.vti").write_bytes(b"spoilt")
    assert reused("first") == 1
    assert not list(folder.glob("*-steps"))
    assert [reused("steps"), reused("steps"), reused("first")] == [0, 2, 2]
    doubled = tasks_of(case, Run(tmp_path, fields="first", precision="double"))
    assert [load_saved(task, tmp_path) for task in doubled] == [None, None]
    loads = [
        read_fields(step)
        for step in load_steps(folder / "bem-seed3-steps" / "path.pvd")
    ]
    assert [load.attributes["mean_pressure"] for load in loads] == [2e8, 5e8]
    last = read_fields(folder / "bem-seed3.vti").fields
    assert all(
        np.array_equal(loads[1].fields[name], field) for name, field in last.items()
    )
    bodies = load_steps(folder / "fem-seed3-steps" / "path.pvd")
    assert [body.name for body in bodies] == ["step-0000.vtu", "step-0001.vtu"]
    bodies[0].parent.joinpath("path.pvd").unlink()
    assert reused("steps") == 1  # what is missing is solved again
    # Another load's files do not pass for those of this one.
    run_cases([case.changed(load=Load(4e8))], Run(tmp_path, jobs=1))
    assert not [*folder.glob("*-steps"), *folder.glob("*.vti")]


def test_a_measured_map_that_is_absent_or_has_holes(write_case, tmp_path):
    """An absent map skips its case if it is optional; holes and a missing unit are
    errors.
    """
    recipe = 'kind = "file"\npath = "map.csv"\nperiod = [64e-6, 80e-6]\n'
    edits = (
        ("= 0.536", '= 0.536\nspectrum = "surface"'),
        ("tolerance = 0.5", "tolerance = 50.0"),
    )

    def verified(lines):
        """Return the completed `verify` of a case of the map with these lines of its
        recipe.
        """
        path = write_case(*edits, (ROUGH, recipe + lines))
        return invoke("verify", path, "--output", tmp_path / "out", "--jobs", 1)

    done = verified("unit = 1e-6\noptional = true")
    assert done.returncode == 0
    assert "map.csv" in done.stdout
    refused(verified("unit = 1e-6"), "map.csv")
    sized = recipe + "unit = { fast = 1e-6, full = 2e-6 }\noptional = true"
    optional = write_case(*edits, (ROUGH, sized))
    for command in ("plan", "run", "export"):
        done = invoke(command, optional, *["x.inp"] * (command == "export"))
        refused(done, "small.toml: skipped: its surface ", "map.csv is not here")
    case, said = load_auto(find_case(str(optional)))
    assert case.size == "full"
    assert case.skip[:8] == "skipped:"
    assert said == ""
    np.savetxt(
        tmp_path / "map.csv", np.where(np.eye(8) > 0, np.nan, 1.0), delimiter=";"
    )
    done = verified('unit = 1e-6\ntreatment = "mirrored"')
    assert done.returncode == 2
    assert (
        done.stdout.count("8 of 64 heights are NaN") == 2
    )  # of one method, and of both
    refused(verified(""), "map.csv", "give unit = 1e-6")


def test_a_plane_is_flat_and_every_gate_holds(write_case, tmp_path):
    """A tilted plane is flat once its form is removed, and contacts everywhere."""
    x, y = np.meshgrid(np.arange(16), np.arange(12), indexing="ij")
    np.save(tmp_path / "plane.npy", 0.1 + 0.3 * x - 0.7 * y)
    recipe = 'kind = "file"\npath = "plane.npy"\nunit = 1e-6\npixel_size = 1e-6\n'
    edits = (
        ('"persson", "bem"', '"bem"'),
        ('"persson"', '1.0\nsource = "a flat touches"'),
    )
    for treatment in ("mirrored", "periodic"):
        path = write_case(
            (ROUGH, f'{recipe}form = 1\ntreatment = "{treatment}"'), *edits
        )
        done = invoke("verify", path, "--output", tmp_path / "out", "--jobs", 1)
        assert done.returncode == 0, done
        assert "the surface is flat" in done.stdout


def test_figures_are_whole_on_every_terminal(write_case, tmp_path, capsys):
    """Tables fit terminals of 40 to 200 characters, and cut no number.

    The band's ends are shown with the digits that tell them apart.
    """
    band = ("tolerance = 0.5", "between = [0.111111, 0.1111112]")
    (outcome,) = verify(write_case(ONE, band), output=tmp_path, jobs=1).cases
    answers = outcome.results
    gate = outcome.gates[0]
    for width in (40, 60, 80, 200):
        console = Console(width=width)
        console.print(verdict_table([outcome], console.width))
        console.print(results_table(answers, width))
        print_rows(
            console, ("key", "default", "meaning"), [("longest_key", "–", "[m] " * 20)]
        )
        shown = capsys.readouterr().out
        assert max(map(len, shown.splitlines())) <= width
        assert f"{100 * gate.difference.mean:+.2f} %" in shown
        assert "+11.11110 %" in shown  # with the digits that tell the ends apart
        assert "+11.11112 %" in shown
        assert "area.total.corrected" in shown
        assert (
            f"{answers['bem'].results[0].final.areas['corrected'].plastic:.4g}" in shown
        )
        assert shown.count("…") == 1  # of the band; no figure is cut off
        assert shown.count("[m]") == 20


def rows_of_loads(loads, methods):
    """Return loads of methods for `loads_table`, with all columns and long numbers."""
    pressures = np.geomspace(1.2345e5, 9.8765e8, loads)
    rows = []
    for number, pressure in enumerate(pressures):
        row = {"branch": "unloading" if number else "loading"}
        for column, name in enumerate(COLUMNS):
            mean = 0.0097127 * (column + 1) * 1.7**number
            row[name] = {"mean": mean, "error": mean * 0.12345, "parts": {}}
        row["mean_pressure"] = {"mean": pressure, "error": 0.0}
        row["total_area"]["parts"] = {"grid": 1.23e-3, "hardness": 4.5e-4}
        rows.append(row)
    return dict.fromkeys(methods, (rows, "12"))


@pytest.mark.parametrize(
    ("loads", "methods"),
    [
        (1, ("bem",)),
        (3, ("persson", "bem")),
        (6, ("bem",)),
        (2, ("a_solver_of_somebody_else", "bem", "fem")),
    ],
)
def test_no_table_of_loads_breaks_a_word_or_number_at_any_width(capsys, loads, methods):
    """At 60 to 220 columns each word of the cells and headings stands in one piece,
    cells without blanks included, and no line is longer than the terminal.
    """
    rows = rows_of_loads(loads, methods)
    names = [name for name in COLUMNS if name != "elastic_area"]
    texts = load_cells(next(iter(rows.values()))[0], {n: COLUMNS[n] for n in names})
    words = {word for line in texts for text in line for word in text.split()}
    words = {word.rstrip(",") for word in words} | set(methods)
    for width in range(60, 221):
        Console(width=width).print(loads_table(rows, "method", width))
        shown = capsys.readouterr().out
        assert max(map(len, shown.splitlines())) <= width
        found = {word.rstrip(",") for word in shown.split()}
        assert words <= found, (width, words - found)


def test_no_table_of_a_verdict_breaks_a_word_or_number_at_any_width(tmp_path, capsys):
    """At 60 to 220 columns the tables of a verdict hold the words of their widest form
    that they have room for in one piece: numbers, statuses and ids of cases.
    """
    names = ["hertz-sphere", "punch-capped"]
    verdict = verify(names, output=tmp_path, jobs=1)
    tables = (cases_table, verdict_table)
    for make, width in itertools.product(tables, range(60, 221)):
        table = make(verdict.cases, width)
        cells = [cell for column in table.columns for cell in column.cells]
        texts = [getattr(cell, "renderable", cell) for cell in cells]
        words = {word for text in texts for word in str(text).split()}
        for case in verdict.cases:
            words -= set(case.requirement.split())  # is cut off where it has no room
        Console(width=width).print(table)
        shown = capsys.readouterr().out
        assert max(map(len, shown.splitlines())) <= width
        assert words <= set(shown.split()), (make, width, words - set(shown.split()))


# --- mistakes, interrupts and closed doors
# -------------------------------------------------------

LONG = 300 * "x"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("verfy", "did you mean 'verify'"),
        ("run no-such-case", "no case is called"),
        ("run", "CASE"),
        ("verify --jobs 0", "--jobs"),
        (
            "verify small",
            "no case is called 'small'; did you mean the file small.toml?",
        ),
        ("run small.toml --size large", "no size 'large'"),
        ("run small.toml --method fem", "no method fem"),
        ("verify small.toml --output small.toml/out", "small.toml"),
        ("crosscheck small.toml", "cross-check needs both"),
        ("crosscheck small.toml --seeds=9-3", "no range of at most 10000 seeds"),
        (
            f"crosscheck small.toml --seeds=1-{'9' * 5000}",
            "no range of at most 10000 seeds",
        ),
        (
            "plan small.toml --tolerance little",
            "--tolerance is 'little', .* such as 1%",
        ),
        ("chart gama", "gamma"),
        ("hardness", "Missing option '--yield-stress' (see epcontact hardness --help)"),
        (f"view {LONG}", f"cannot open {LONG}: file name too long"),
    ],
)
def test_mistake_on_the_command_line(write_case, monkeypatch, arguments, words):
    """A mistake in `arguments` gives one line with all `words`, and no results."""
    monkeypatch.chdir(write_case().parent)
    refused(invoke(*arguments.split()), *words.split(".*"))
    assert not Path("results").exists()


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="needs process groups")
@pytest.mark.parametrize(
    ("how", "waits"),
    [
        # Workers take a second to import what they need; that is when impatient users
        # interrupt.
        (signal.SIGINT, "a worker"),
        pytest.param(signal.SIGTERM, "a result", marks=pytest.mark.slow),
    ],
)
def test_interrupt_is_clean(write_case, tmp_path, how, waits):
    """An interrupted `verify` exits with 130, keeps whole results and writes no
    verdict.

    `how` is the signal, and `waits` what must exist before it is sent.
    """
    grid = (
        "points_per_shortest_wavelength = { fast = 4, full = 8 }",
        "shape = [128, 128]",
    )
    case = write_case(grid, ("[3, 5, 7]", str(list(range(200)))))
    out = tmp_path / "out"
    process = subprocess.Popen(
        [*COMMAND, "verify", case, "--jobs", "2", "--output", out],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Tests that run in the background may ignore Ctrl-C, and a child inherits that.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    )
    for _ in range(2000):
        children = psutil.Process(process.pid).children()
        if [*out.rglob("bem-*.json")] if waits == "a result" else children:
            break
        time.sleep(0.05)
    os.killpg(process.pid, how)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130
    assert (
        stderr.splitlines()[-1]
        == "epcontact: interrupted; results finished so far are kept"
    )
    assert "Traceback" not in stderr
    assert not (out / "verdict.json").exists()
    for member in out.rglob("*.json"):
        json.loads(member.read_text())


def test_interrupt_while_a_module_is_half_loaded(monkeypatch):
    """An interrupt while a module has no attributes yet raises KeyboardInterrupt."""
    module = "epcontact.machine"
    monkeypatch.setitem(sys.modules, module, types.ModuleType(module))
    with pytest.raises(KeyboardInterrupt):
        main._interrupt(signal.SIGINT, None)


FULL = "epcontact: cannot write the output: no space left on device"


@pytest.mark.skipif(
    not os.path.exists("/dev/full"), reason="needs a device that is full"
)
# By rich, by click, when the verdict is there, and a full disk.
@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        ("keys", 2, ""),
        ("cite hertz-sphere", 2, ""),
        ("verify bearing-area hertz-sphere --fresh", 0, ""),
        ("list", 2, FULL),
    ],
)
def test_closed_pipe_is_no_verdict_and_changes_none(tmp_path, words, code, says):
    """A closed pipe or a full disk does not change the exit code of a verdict.

    `words` is the command line, `code` its exit code, and `says` the message for a full
    disk. The output is printed by rich, by click and after a verdict.
    """
    reader, out = os.pipe()
    os.close(reader)
    with open("/dev/full" if says else out, "wb") as full:
        done = subprocess.run(
            [*COMMAND, *words.split()],
            check=False,
            cwd=tmp_path,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    told = [line for line in done.stderr.splitlines() if "epcontact:" in line]
    shut_streams = ["2>&- >&- <&-"]
    if words == "list":  # the fastest
        shut_streams += [">&- <&-", "2>&- <&-", "2>/dev/full"]
    for shut in shut_streams:
        line = ["sh", "-c", f'exec "$@" {shut}', "sh", *COMMAND, *words.split()]
        closed = subprocess.run(
            line, check=False, cwd=tmp_path, capture_output=True, text=True
        )
        assert closed.returncode == 0
        assert "Traceback" not in closed.stderr
    assert done.returncode == code
    assert told == ([says] if says else [])


def test_mistake_of_our_own_does_not_say_that_a_gate_fell_short(monkeypatch):
    """An error inside of the package exits with 2 and a traceback, not with 1."""
    monkeypatch.setattr(list_cases, "case_files", lambda: 1 / 0)
    done = invoke("list")
    assert done.returncode == 2
    assert "ZeroDivisionError" in done.stderr
    assert done.stderr.splitlines()[-1].startswith("epcontact: ")


@pytest.mark.parametrize("first", [1.0, 60.0])
def test_the_time_left_is_that_of_the_solves_to_come(monkeypatch, first):
    """The time left counts solves, not reused results, nor the first one that compiles.

    Of 120 results 20 are reused; the other 100 take a second, and the first `first` s.
    """
    clock = [0.0]
    monkeypatch.setattr("rich.console.monotonic", lambda: clock[0])
    line = ProgressLine(Console(), "run")
    lines = []
    for done in range(1, 121):
        seconds = {True: 0.001, False: 1.0}[done <= 20]
        if done == 21:
            seconds = first
        clock[0] += seconds
        line.update(done, 120, "x" + " (reused)" * (done <= 20))
        lines.append(line.text())
    told = re.findall(
        r"run: (\d+) of 120, x \(about (\d+):(\d+):(\d+) left\)", "\n".join(lines)
    )
    assert line.last_text() == "run: 120 of 120, 20 reused"
    left = {int(n): 3600 * int(h) + 60 * int(m) + int(s) for n, h, m, s in told}
    assert min(left) == 26
    assert len(left) > 70
    assert all(
        seconds == pytest.approx(120 - done, abs=2) for done, seconds in left.items()
    )


# --- work that is not lost
# ---------------------------------------------------------------------------------


def test_a_report_that_fails_keeps_the_verdict_and_says_so(
    write_case, tmp_path, monkeypatch
):
    """A full disk while the report is written ends with exit code 2 after the verdict
    is printed, and the verdict can be read.  A later `run` says that it is outdated.
    """

    def full(*_, **__):
        """Raise the error of a full disk."""
        raise OutputError("cannot write report.html: no space left on device")

    path = write_case(ONE)
    options = ("--output", tmp_path, "--jobs", 1)
    monkeypatch.setattr("epcontact.cli.run_and_verify._write_report", full)
    done = invoke("verify", path, "--report", *options)
    assert done.returncode == 2
    assert "1 case: 1 holds" in done.stdout
    sentence = done.stderr.splitlines()[-1]
    assert sentence.endswith("no space left on device; the verdict is complete")
    assert Verdict.read(tmp_path / "verdict.json").passed
    note = "verdict.json is about earlier results"
    assert note in invoke("run", path, "--fresh", *options).stderr
    assert invoke("verify", path, *options).returncode == 0
    assert note not in invoke("run", path, *options).stderr


@pytest.mark.parametrize(
    "command",
    ["accuracy --csv", "accuracy --keep", "compare {0} {0} --csv"],
)
def test_a_table_does_not_replace_another_file(tmp_path, command):
    """A table is written over an earlier one of its kind, and over no other file."""
    path = tmp_path / "mine.csv"
    words = command.format(RELEASE_VALUES).split()
    for _ in range(2):
        assert invoke(*words, path).returncode == 0
    path.write_text("name,mark\n")
    refused(invoke(*words, path), "mine.csv: it exists and holds something else")
    assert path.read_text() == "name,mark\n"


def writing_options():
    """Yield each command with each option or argument of it that names a file to
    write; that a command has such an option and does not say so is seen by its name.
    """
    for name, command in cli.commands.items():
        for parameter in command.params:
            is_file = isinstance(parameter.type, OutputFile)
            words = ("--csv", "--keep", "--screenshot", "--film", "--map", "file")
            assert is_file or not {parameter.name, *parameter.opts} & {*words}
            if is_file:
                yield pytest.param(name, parameter, id=f"{name}-{parameter.name}")


#: Words before the output that make a command valid as far as its files go.
READ = {
    "accuracy": [],
    "benchmark": ["{map}", "{values}"],
    "compare": ["{verdict}"],
    "export": ["fem-elastic"],
    "new": ["{map}"],
    "report": ["{results}"],
    "view": ["{fields}"],
}


@pytest.fixture(scope="module")
def files_to_read(tmp_path_factory):
    """Return files of all kinds that commands read, by name."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("read"))
        assert invoke("run", "hertz-sphere", "--fields", "first").returncode == 0
        assert invoke("verify", "bearing-area").returncode == 0
        verdict = Path("results/verdict.json")
        assert invoke("compare", verdict, "--keep", "values.csv").returncode == 0
        Path("steel.csv").write_text("1,2,3\n4,5,6\n7,8,9\n")
        Path("steel.txt").write_text("1 2 3\n4 5 6\n7 8 9\n")
        Path("mine.toml").write_text("[case]\n")
        Path("link.csv").symlink_to("values.csv")
        result = Path("results/hertz-sphere/fast/bem.json")
        return {
            "results": verdict.absolute().parent,
            "verdict": verdict.absolute(),
            "values": Path("values.csv").absolute(),
            "link": Path("link.csv").absolute(),
            "map": Path("steel.csv").absolute(),
            "text": Path("steel.txt").absolute(),
            "case": Path("mine.toml").absolute(),
            "result": result.absolute(),
            "fields": next(result.parent.glob("*.vti")).absolute(),
        }


@pytest.mark.parametrize(("name", "parameter"), [*writing_options()])
def test_no_output_replaces_an_input(files_to_read, name, parameter):
    """No option or argument writes over a verdict, a table of values, a map, a case, a
    result or fields, whatever the command reads, and also under another name.
    """
    paths = [path for path in files_to_read.values() if path.is_file()]
    before = {path: path.read_bytes() for path in paths}
    option = [parameter.opts[0]] if parameter.opts[0].startswith("-") else []
    is_stem = parameter.name == "contact_map"  # it gets endings of its own
    for target in before:
        read = [word.format_map(files_to_read) for word in READ[name]]
        if name == "compare" and target.suffix == ".csv":
            read = [files_to_read["values"], files_to_read["verdict"]]
        if is_stem and target.stem == "steel":
            done = invoke(name, *read, *option, target.with_suffix(""))
        else:
            done = invoke(name, *read, *option, target)
        assert {path: path.read_bytes() for path in before} == before, target
        assert done.returncode == 2 or is_stem, (target, done)


@pytest.mark.skipif(os.name == "nt", reason="Windows removes no current folder")
def test_a_current_folder_that_was_removed_is_one_sentence(tmp_path, monkeypatch):
    """`verify` in a folder that no longer exists names the reason and the remedy."""
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    refused(invoke("verify", "bearing-area"), "the current folder was removed; change")


def test_the_theory_reports_its_progress(write_case):
    """The theory reports the solved fraction of the path before the last load."""
    (task,) = tasks_of(load_case(write_case(PATH)).changed(methods=("persson",)), Run())
    fractions = []

    def report(fraction, _):
        """Note the fraction."""
        fractions.append(fraction)

    solve_path(task, task.case.scene(task.recipe), 1, report)
    assert fractions == [0.5]


def test_an_effective_hardness_needs_a_yield_stress(write_case):
    """The sentence names the key that is missing, and both remedies."""
    path = write_case(("hardness = 6.0e9", 'hardness = "effective"'))
    words = "[material] has no yield_stress; add it, or give the hardness in Pa"
    refused(invoke("run", path), words)


# --- words from outside
# ---------------------------------------------------------------------------------

#: Names of files that rich, a terminal and matplotlib would obey: markup, a command
#: that turns the text red, a formula, and a change of the direction of writing.
HOSTILE_NAMES = ("a[/x].npy", "b\x1b[31m.npy", "c$x\\frac$.npy", "d\u202e.npy")
SHOWN_NAMES = ("a[/x].npy", "b\\x1b[31m.npy", "c$x\\frac$.npy", "d\\u202e.npy")


def test_names_of_files_are_shown_and_not_obeyed(write_case, tmp_path):
    """A sweep over HOSTILE_NAMES solves and draws all, and shows SHOWN_NAMES."""
    heights = np.random.default_rng(2).normal(size=(8, 8)) * 1e-7
    (tmp_path / "a[").mkdir()
    for name in HOSTILE_NAMES:
        np.save(tmp_path / name, heights)
    surface = 'kind = "file"\npath = "a[/x].npy"\nunit = 1.0\nperiod = [1e-3, 1e-3]'
    path = write_case(
        (ROUGH, surface),
        ('methods = ["persson", "bem"]', 'methods = ["bem"]'),
        ('against = "persson"', 'against = 0.5\nsource = "-"'),
        ("[theory]\nenergy_reduction = 0.536\n", ""),
        more=f"\n[sweep]\nsurface.path = {json.dumps(HOSTILE_NAMES)}\n",
    )
    done = invoke("sweep", path, "--output", tmp_path, "--charts", "--jobs", 1)
    assert done.returncode == 0, done.stderr
    for name in SHOWN_NAMES:
        assert name in done.stdout
    assert "\x1b" not in done.stdout + done.stderr
    assert (tmp_path / "small" / "fast" / "loads-areas.png").is_file()


def test_a_progress_bar_and_tables_have_no_markup(monkeypatch):
    """The bar and the tables of a terminal show hostile words; a status is coloured."""
    shown = io.StringIO()

    def console(**_):
        """Return the console of a terminal that writes to `shown`."""
        return Console(file=shown, force_terminal=True, width=100)

    monkeypatch.setattr("epcontact.cli.progress.Console", console)
    with show_progress("run") as update:
        update(1, 2, "case [/x] \x1b[5m")
    table = new_table(("name", "status"))
    table.add_row("[/y] \x1b[5m", text_of("error", "bold red"))
    console().print(table)
    print_sentence(console(), "a sentence [/z] \x1b[5m")
    text = shown.getvalue()
    for word in ("[/x]", "[/y]", "[/z]"):
        assert f"{word} \\x1b[5m" in text
    assert "\x1b[5m" not in text
    assert "\x1b[1;31merror" in text


def test_a_list_and_a_solver_send_nothing_to_the_terminal(write_case, monkeypatch):
    """A requirement and what a solver writes to stderr are shown without controls."""
    words = "A red \\u001b[31m word."
    path = write_case(
        ("The boundary elements and the theory answer a small scene.", words)
    )
    (path.parent / "cases").mkdir()
    path.rename(path.parent / "cases" / path.name)
    monkeypatch.chdir(path.parent)
    assert "A red \\x1b[31m word." in invoke("list", "--all").stdout
    solver = "sh -c 'printf \"\\033[31mred\" >&2; exit 3' {scene} {result}"
    done = invoke("verify", "cases/small.toml", "--solver", solver, "--jobs", 1)
    assert "\\x1b[31mred" in done.stdout
    assert "\x1b" not in done.stdout + done.stderr


def test_a_sentence_leaves_out_the_middle_of_a_very_long_text():
    """An exception of a million characters becomes a sentence of about 2000, with the
    count of those left out.
    """
    sentence = sentence_of(ValueError("start" + "x" * 10**6 + "end\x1b"))
    assert sentence.startswith("ValueError: start")
    assert sentence.endswith("end\\x1b")
    assert "… 998024 characters left out …" in sentence
    assert len(sentence) < 2050


# --- progress
# ---------------------------------------------------------------------------------


def test_a_pipe_has_the_sentence_on_the_current_work(monkeypatch, capsys):
    """What a command works on is in each line, with the passed time; and two pieces of
    work, one after the other, have no two lines within the interval.
    """
    monkeypatch.setattr(progress, "_FIRST_LINE", 0.01)
    monkeypatch.setattr(progress, "_SHORTEST_WAIT", 0.01)
    monkeypatch.setattr(ProgressLine, "last_printed", float("-inf"))
    for sentence in ("pilot on 8 points", "pilot on 16 points"):
        with show_sentences("plan") as say:
            say(sentence)
            time.sleep(0.2)
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["plan: running for 0:00:00, pilot on 8 points"]


def test_a_pipe_has_a_line_within_a_second_and_then_one_in_ten(monkeypatch, capsys):
    """A pipe gets a line soon and others at intervals, also while nothing is finished,
    and a last line; a command that fails has no last line.

    The interval of ten seconds is shortened to 0.05 s.
    """
    monkeypatch.setattr(progress, "_FIRST_LINE", 0.01)
    monkeypatch.setattr(progress, "_LINES_APART", 0.05)
    monkeypatch.setattr(progress, "_SHORTEST_WAIT", 0.01)
    with show_progress("run") as update:
        update(0.5, 2, "")
        time.sleep(0.3)
        update(2, 2, "a case")
    *lines, last = capsys.readouterr().err.splitlines()
    assert 2 <= len(lines) <= 7
    assert set(lines) == {"run: 0 of 2"}
    assert last == "run: 2 of 2"
    with pytest.raises(ZeroDivisionError), show_progress("run") as update:
        update(1 / 0, 2, "")
    assert not capsys.readouterr().err
