"""The command line as its user meets it: verdicts, exit codes, one sentence for every mistake."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
import types
import xml.etree.ElementTree as ET
from pathlib import Path

import click
import numpy as np
import pytest
from command_line import Done, invoke, start
from rich.console import Console

from epcontact.cli import listing, main
from epcontact.cli.main import COMMANDS, cli
from epcontact.harness.answers.run import Run, run_cases
from epcontact.harness.case_files.case import load_case
from epcontact.scene import Load


def refused(done, *words: str) -> None:
    assert done.returncode == 2, done
    assert done.stderr.startswith("epcontact: ")
    assert done.stderr.count("\n") == 1, done.stderr
    assert "Traceback" not in done.stderr
    for word in words:
        assert word in done.stderr


def test_list_shows_each_case_on_a_line() -> None:
    done = invoke("list")
    assert done.returncode == 0
    assert "paper-elastoplastic" in done.stdout


def test_keys_tells_units() -> None:
    done = invoke("keys")
    assert done.returncode == 0
    assert "rad/m" in done.stdout
    assert "m; one length, or [x, y]" in done.stdout  # rich would take [x, y] for markup
    assert "within [low, high]" in done.stdout
    for words in ("refuse, periodic, detrend_and_window", "elastic, capped, j2", "gap, moved",
                  "relative, absolute, wasserstein, supremum, l2", "persson, bem, fem",
                  "constant, persson, wang_muser, xu", "analytic, surface"):  # fmt: skip
        assert words in " ".join(done.stdout.split()), words


def test_an_output_without_greek_letters_shows_a_question_mark() -> None:
    done = start("list", env=os.environ | {"PYTHONIOENCODING": "cp1252"})
    assert done.returncode == 0, done.stderr
    assert "at E*?/?_Y = 5" in done.stdout


def test_a_narrow_terminal_shows_every_name_whole(capsys) -> None:
    listing.print_rows(
        Console(width=30), ("key", "default", "meaning"), [("longest_wavelength", "–", "[m] " * 9)]
    )
    name, *meaning = capsys.readouterr().out.splitlines()
    assert name.split() == ["longest_wavelength", "–"]
    assert " ".join(meaning).split() == ["[m]"] * 9
    assert all(line.startswith("  [m]") and len(line) <= 30 for line in meaning)


@pytest.mark.parametrize("columns", [80, 200])
def test_list_shows_a_requirement_as_it_is_written(
    write_case, tmp_path, monkeypatch, columns, capsys
) -> None:
    requirement = "Everything in [0, 1] holds [/tag] as [bold]written."
    (tmp_path / "cases").mkdir()
    write_case(("The boundary elements and the theory answer a small scene.", requirement))
    (tmp_path / "small.toml").rename(tmp_path / "cases" / "small.toml")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(listing, "open_console", lambda: Console(width=columns))
    listing.list.main([], standalone_mode=False)
    lines = capsys.readouterr().out.splitlines()
    assert requirement in " ".join(lines)
    assert max(map(len, lines)) <= columns
    assert [line.split()[0] for line in lines if line[0] != " "][-1] == "small"


def test_verify_holds_and_writes_the_verdict(write_case, tmp_path) -> None:
    out = tmp_path / "with space"
    done = invoke("verify", write_case(), "--output", out, "--jobs", 2)
    assert done.returncode == 0, done
    verdict = json.loads((out / "verdict.json").read_text())
    assert verdict["passed"] is True
    gate, *defaults = verdict["cases"][0]["gates"]
    assert {g["of"] for g in defaults} <= {"bem", "persson"}
    assert len(defaults) >= 3
    assert gate["status"] == "holds"
    assert gate["value"]["surfaces"] == 3
    assert gate["value"]["half_width_95"] > 0
    suite = ET.parse(out / "junit.xml").getroot()
    assert suite.attrib["tests"] == str(1 + len(defaults))
    assert suite.attrib["failures"] == "0"
    assert list(out.rglob("*.tmp*")) == []


def test_gate_that_falls_short_is_exit_1(write_case, tmp_path) -> None:
    case = write_case(("tolerance = 0.5", "tolerance = 1e-9"))
    done = invoke("verify", case, "--output", tmp_path / "out", "--jobs", 1)
    assert done.returncode == 1
    assert "falls short" in done.stdout
    assert "only a smoke test" in done.stdout
    suite = ET.parse(tmp_path / "out" / "junit.xml").getroot()
    assert suite.attrib["failures"] == "1"


def test_second_run_reuses_the_first(write_case, tmp_path) -> None:
    case, out = write_case(("seeds = [3, 5, 7]", "seeds = [3, 5]")), tmp_path / "out"

    def run(case: Path, *options: str) -> Done:
        return invoke("run", case, "--output", out, "--jobs", 1, *options)

    first, again = run(case), run(case)
    assert first.returncode == again.returncode == 0
    assert "(reused)" not in first.stderr
    assert again.stderr.count("(reused)") == 3
    assert run(case, "--fresh").stderr.count("(reused)") == 0
    # Another load is another scene.
    case.write_text(case.read_text().replace("mean_pressure = 5.0e8", "mean_pressure = 5.1e8"))
    assert "(reused)" not in run(case).stderr


def test_run_writes_results_and_fields(write_case, tmp_path) -> None:
    from epcontact.output.vtk import read_fields

    case = write_case(("rms_slope = 0.1", "rms_slope = 1.1"))
    done = invoke("run", case, "--method", "bem", "--output", tmp_path / "out", "--jobs", 1)
    assert done.returncode == 0, done
    assert done.stdout.count("the rms slope is 1.1, beyond the small slopes") == 1
    folder = tmp_path / "out" / "small" / "fast"
    summary = json.loads((folder / "bem.json").read_text())
    assert summary["case"] == "small"
    assert summary["method"] == "bem"
    assert summary["size"] == "fast"
    assert summary["converged"] is True
    assert set(summary["areas"]) >= {"raw", "corrected"}
    assert len(summary["members"]) == 3
    assert {"seconds", "fft_pairs", "unknowns", "peak_memory_bytes"} <= set(summary["cost"])
    assert summary["members"][1]["provenance"]["seed"] == 5
    fields = read_fields(folder / "bem-seed3.vti")
    assert set(fields.fields) == {"heights", "pressure", "gap", "plastic_displacement", "state"}
    assert fields.attributes["young_modulus"] == 100e9
    assert fields.attributes["body"] == "half-space"
    assert fields.units["hardness"] == fields.units["quantity.largest_pressure"] == "Pa"
    assert not (folder / "bem-seed5.vti").exists()
    assert not (folder / "persson.json").exists()


def test_the_bar_moves_within_a_solve(write_case, tmp_path) -> None:
    path = write_case(
        ("seeds = [3, 5, 7]", "seeds = [3]"),
        ("mean_pressure = 5.0e8", "mean_pressure = [2.0e8, 5.0e8]"),
        ("fast = 4", "fast = 16"),
    )
    told: list[tuple[float, int]] = []
    run = Run(tmp_path, jobs=1, progress=lambda done, total, _: told.append((done, total)))
    run_cases([load_case(path)], run)
    assert told[0] == (0, 2)
    assert {total for _, total in told} == {2}
    done = [share for share, _ in told]
    assert done == sorted(done)
    # It moves on coarse grids and on the finest one, through both loads.
    for low, high in ((1.0, 1.125), (1.125, 1.5), (1.5, 1.625), (1.625, 2.0)):
        assert any(low < share <= high for share in done), (low, done)
    assert done[-1] <= 2


def test_every_load_is_written_and_reused_where_asked(write_case, tmp_path) -> None:
    from epcontact.harness.answers.run import tasks_of
    from epcontact.harness.answers.store import kept
    from epcontact.output.view import load_steps
    from epcontact.output.vtk import Precision, read_fields

    path = write_case(
        ("seeds = [3, 5, 7]", "seeds = [3]"),
        ('methods = ["persson", "bem"]', 'methods = ["bem", "fem"]'),
        ('against = "persson"', 'against = "fem"'),
        ("mean_pressure = 5.0e8", "mean_pressure = [2.0e8, 5.0e8]"),
        ("[load]", '[fem]\nlaw = "elastic"\nlayers = 2\n\n[load]'),
    )
    case, out, notes = load_case(path), tmp_path / "out", []

    def solve(fields: str, precision: Precision = "single") -> list[bool]:
        notes.clear()
        told = lambda done, total, words: notes.append("reused" in words) if words else None  # noqa: E731
        run_cases([case], Run(out, 1, fields=fields, precision=precision, progress=told))
        return list(notes)

    folder = case.folder(out)
    assert solve("first", "double") == [False, False]
    assert solve("first", "single") == [True, True]
    assert read_fields(folder / "bem-seed3.vti").fields["pressure"].dtype == np.float64
    assert not list(folder.glob("*-steps"))
    assert solve("steps") == [False, False]
    assert solve("steps") == solve("first") == [True, True]
    doubled = tasks_of(case, Run(out, fields="first", precision="double"))
    assert [kept(task, out) for task in doubled] == [None, None]
    steps = load_steps(folder / "bem-seed3-steps" / "path.pvd")
    loads = [read_fields(step) for step in steps]
    assert [load.attributes["mean_pressure"] for load in loads] == [2e8, 5e8]
    last = read_fields(folder / "bem-seed3.vti")
    for name, field in last.fields.items():
        assert np.array_equal(loads[1].fields[name], field)
    assert 0 < np.mean(loads[0].field("state") > 0) < np.mean(last.field("state") > 0)
    bodies = load_steps(folder / "fem-seed3-steps" / "path.pvd")
    assert [body.name for body in bodies] == ["step-0000.vtu", "step-0001.vtu"]
    bodies[0].parent.joinpath("path.pvd").unlink()
    assert solve("steps").count(False) == 1  # what is missing is solved again
    # Another load's files do not pass for those of this one.
    other = case.changed(load=Load(4e8))
    run_cases([other], Run(out, jobs=1))
    assert not list(folder.glob("*-steps"))


def test_a_measured_map_from_file_to_table(write_case, tmp_path) -> None:
    """In micrometres, with holes, tilted: what was done to it is said in the terminal."""
    x, y = np.meshgrid(np.arange(40.0), np.arange(32.0), indexing="ij")
    heights = 0.3 * np.cos(x) + 0.2 * np.sin(1.3 * y) + 0.1 * x
    heights[3:6, 7:9] = np.nan
    np.savetxt(tmp_path / "map.csv", heights, delimiter=";")
    spectrum = "energy_reduction = 0.536"
    text = write_case((spectrum, f'{spectrum}\nspectrum = "surface"')).read_text()
    start, end = text.index("[surface]"), text.index("[material]")
    surface = (
        '[surface]\nkind = "file"\npath = "map.csv"\nperiod = [64e-6, 80e-6]\nunit = 1e-6\n'
        'missing = "harmonic"\ntreatment = "detrend_and_window"\n\n'
    )
    gate = text[end:].replace("tolerance = 0.5", "tolerance = 50.0")
    (tmp_path / "small.toml").write_text(text[:start] + surface + gate)
    done = invoke("verify", tmp_path / "small.toml", "--output", tmp_path / "out", "--jobs", 1)
    assert done.returncode == 0, done
    told = " ".join(done.stdout.split())
    assert "small: 6 of 1280 heights missing (0.47 %), filled by the method harmonic" in told
    assert "small: least-squares plane removed" in told
    assert "to keep the rms slope" in told
    assert "small: the periods make the grid 1.6e-06 m wide along x, over 40 lines" in told
    assert "1 case: 1 holds" in told
    (tmp_path / "small.toml").write_text((text[:start] + surface + gate).replace("missing", "#"))
    done = invoke("verify", tmp_path / "small.toml", "--output", tmp_path / "out", "--jobs", 1)
    assert done.returncode == 2
    assert done.stdout.count("6 of 1280 heights are NaN") == 2  # of one method, and of both
    (tmp_path / "small.toml").write_text((text[:start] + surface + gate).replace("unit = 1e-6", ""))
    refused(invoke("verify", tmp_path / "small.toml"), "map.csv", "give unit = 1e-6")


def test_solver_of_the_users_own(write_case, tmp_path) -> None:
    case = write_case(("seeds = [3, 5, 7]", "seeds = [3]"))

    def verify(solver: str, jobs: int) -> Done:
        options = ("--output", tmp_path / "out", "--solver", solver, "--jobs", jobs)
        return invoke("verify", case, *options)

    assert verify("faults:honest", 1).returncode == 0
    died = verify("hostile:exits_with_success", 2)
    assert died.returncode == 2
    assert "ended with exit code 0 and gave no answer" in died.stdout
    assert "Traceback" not in died.stdout + died.stderr


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["verfy"], "verify"),
        (["run", "no-such-case"], "no case is called"),
        (["run", "no-such-case.toml"], "no such case file"),
        (["run"], "CASE"),
        (["verify", "--jobs", "0"], "--jobs"),
        (["verify", "--size", "huge"], "huge"),
        (["verify", "--sise", "fast"], "--size"),
        (["run", "."], "no such case file"),
    ],
)
def test_mistake_on_the_command_line(arguments, word) -> None:
    refused(invoke(*arguments), word)


def test_broken_case_leaves_nothing_behind(write_case, tmp_path) -> None:
    out = tmp_path / "out"
    refused(invoke("verify", write_case(("hurst", "hurts")), "--output", out), "hurts")
    assert not out.exists()


def test_size_that_a_case_lacks(write_case) -> None:
    refused(invoke("run", write_case(), "--size", "large"), "no size 'large'")


def test_method_that_a_case_lacks(write_case) -> None:
    refused(invoke("run", write_case(), "--method", "fem"), "no method fem")


def test_output_that_cannot_be_written(write_case, tmp_path) -> None:
    # Even root cannot make a folder under a file.
    (tmp_path / "file").write_text("in the way")
    done = invoke("verify", write_case(), "--output", tmp_path / "file" / "out")
    refused(done, "file")
    assert "[1/" not in done.stderr  # nothing is solved in vain


def test_absent_optional_surface_is_skipped_with_a_sentence(write_case, tmp_path):
    text = write_case().read_text()
    start, end = text.index("[surface]"), text.index("[material]")
    surface = '[surface]\nkind = "file"\npath = "absent.npy"\nperiod = 1.0\noptional = true\n\n'
    case = tmp_path / "small.toml"
    case.write_text(text[:start] + surface + text[end:])
    done = invoke("verify", case, "--output", tmp_path / "out")
    assert done.returncode == 0
    assert "absent.npy" in done.stdout
    case.write_text(case.read_text().replace("optional = true", ""))
    refused(invoke("verify", case, "--output", tmp_path / "out"), "absent.npy")


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="needs process groups")
@pytest.mark.parametrize(
    "how", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_interrupt_is_clean(write_case, tmp_path, how) -> None:
    case = write_case(
        ("points_per_shortest_wavelength = { fast = 4, full = 8 }", "shape = [128, 128]"),
        ("[3, 5, 7]", str(list(range(200)))),
    )
    out = tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, "-m", "epcontact", "verify", str(case), "--output", str(out)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        # Tests that run in the background may ignore Ctrl-C, and a child inherits that.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    )  # fmt: skip
    deadline = time.monotonic() + 120
    while not list(out.rglob("bem-*.json")) and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(process.pid, how)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130
    assert stderr.splitlines()[-1].startswith("epcontact: interrupted")
    assert "Traceback" not in stderr
    assert not (out / "verdict.json").exists()
    members = list(out.rglob("*.json"))
    assert members
    for member in members:
        json.loads(member.read_text())


def test_interrupt_while_a_module_is_half_loaded(monkeypatch) -> None:
    module = "epcontact.machine"
    monkeypatch.setitem(sys.modules, module, types.ModuleType(module))
    with pytest.raises(KeyboardInterrupt):
        main._ended(signal.SIGINT, None)


def test_crosscheck_needs_both_kinds_of_elements(write_case) -> None:
    refused(invoke("crosscheck", write_case()), "fem", "cross-check needs both")


@pytest.mark.parametrize(
    ("seeds", "sentence"),
    [
        ("", "no range of at most"),
        ("9-3", "no range of at most"),
        ("1-2-3", "no range of at most"),
        ("1-" + "9" * 5000, "no range of at most"),
        ("1-999999999999", "at most 10000"),
    ],
)
def test_crosscheck_refuses_what_is_no_range_of_seeds(
    write_case, seeds: str, sentence: str
) -> None:
    """Before it makes or counts any: a long range would fill the memory."""
    refused(invoke("crosscheck", write_case(), "--seeds", seeds), sentence)


def test_plan_tells_the_model_and_why(write_case) -> None:
    threads = ("--executor", "concurrent.futures:ThreadPoolExecutor")
    one = write_case(("seeds = [3, 5, 7]", "seeds = [3]"))
    done = invoke("plan", one, "--tolerance", "2%", "--check", *threads)
    assert done.returncode == 0, done
    assert done.stdout.startswith("small: bem, ")
    grid = re.search(r"bem, (\d+) x", done.stdout)
    assert grid is not None
    assert "promise held" in done.stdout
    assert f"by {2 * int(grid[1])} x " in done.stdout
    refused(invoke("plan", write_case(), "--tolerance", "little"), "--tolerance", "1%")


def test_the_plan_of_a_map_rests_on_its_claim_and_says_so(tmp_path: Path) -> None:
    """With the notes of its heights, here that they are in steps."""
    x = 2 * np.pi * np.arange(32) / 32
    heights = np.round(2 * (np.cos(x)[:, None] + np.cos(x))) / 2 * 1e-6
    np.save(tmp_path / "steps.npy", heights)
    (tmp_path / "map.toml").write_text("""
[case]
id = "map"
requirement = "x."
source = "y"
methods = ["bem"]
[surface]
kind = "file"
path = "steps.npy"
unit = 1.0
pixel_size = 1e-6
treatment = "periodic"
[material]
young_modulus = 1e11
poisson_ratio = 0.3
[load]
mean_pressure = 1e9
[[gate]]
quantity = "area.total.corrected"
of = "bem"
against = 0.1
source = "y"
tolerance = 0.3
because = "x"
""")
    threads = ("--executor", "concurrent.futures:ThreadPoolExecutor")
    for check in ((), ("--check", *threads)):
        done = invoke("plan", tmp_path / "map.toml", "--tolerance", "90%", *check)
        assert done.returncode == 0, done
        said = " ".join(done.stdout.split())
        assert ("nothing checks the claim" in said) == bool(check)
        assert "promise" not in said
        assert said.count("claimed errors of areas do not hold") == 1


def test_chart_of_no_name_is_refused_with_the_names() -> None:
    refused(invoke("chart", "gama"), "gamma")


def test_schema_is_json() -> None:
    for kind in ("case", "verdict"):
        done = invoke("schema", kind)
        assert done.returncode == 0
        assert "$defs" in json.loads(done.stdout)


def test_each_command_is_listed_with_the_line_that_it_begins_with() -> None:
    context = click.Context(cli)
    listed = " ".join(invoke("--help").stdout.split())
    for name in COMMANDS:
        command = cli.get_command(context, name)
        assert command is not None
        assert command.name == name
        assert f"{name} {(command.help or '').partition(chr(10))[0]}" in listed


def test_a_usage_error_names_the_help_of_its_command() -> None:
    refused(invoke("hardness"), "Missing option '--yield-stress' (see epcontact hardness --help)")
    refused(invoke("lits"), "did you mean 'list'? (see epcontact --help)")


@pytest.mark.parametrize(
    "words", [("verify",), ("view",), ("gates", "--output"), ("verify", "yardstick", "--output")]
)
def test_a_name_too_long_for_a_file_is_no_bug(words) -> None:
    name = 300 * "x"
    refused(invoke(*words, name), "cannot open ", name, ": file name too long")


def test_a_case_file_in_this_folder_is_meant_by_its_id(write_case, monkeypatch) -> None:
    monkeypatch.chdir(write_case().parent)
    sentence = "no case is called 'small'; did you mean the file small.toml?"
    refused(invoke("verify", "small"), sentence)


def test_several_cases_are_counted_in_the_plural(tmp_path) -> None:
    done = invoke("verify", "bearing-area", "yardstick", "--output", tmp_path, "--jobs", 1)
    assert "2 cases: 2 hold; verdict in" in " ".join(done.stdout.split())


@pytest.mark.parametrize("argument", ["--help", "list"])
def test_lists_load_no_solver(argument: str) -> None:
    program = (
        f"import sys; sys.argv = ['epcontact', '{argument}']\n"
        "from epcontact.cli.main import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "print(sorted({'numpy', 'numba', 'pydantic', 'pyvista'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.splitlines()[-1] == "[]"
