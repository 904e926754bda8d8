"""Every command and code block of the README runs, and every example in a docstring."""

import doctest
import importlib
import json
import os
import re
import shlex
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from command_line import invoke
from laboratory.trial_map import trial_map

from epcontact.cli.main import COMMANDS
from epcontact.harness.workers import executor_from
from epcontact.surfaces.treatment import remove_form

ROOT = Path(__file__).parent.parent
EXAMPLES = [
    path.relative_to(ROOT)
    for package in ("epcontact", "fem_check")
    for path in sorted((ROOT / package).rglob("*.py"))
    if ">>> " in path.read_text(encoding="utf-8")
]


def blocks(language, page="README.md"):
    """Return the code blocks in a language, such as "bash", in the order of a page.

    `page` is a path from the root of the repository.
    """
    text = (ROOT / page).read_text(encoding="utf-8")
    pattern = rf"^```{language}\n(.*?)^```"
    return re.findall(pattern, text, re.MULTILINE | re.DOTALL)


README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """Return a folder with the files that the README's block with `epcontact new`
    writes: my-surface.toml, my-solver.toml and my_solver.py.
    """
    folder = tmp_path_factory.mktemp("readme")
    (block,) = [text for text in blocks("bash") if "epcontact new" in text]
    run(["bash", "-ec", block], folder)
    return folder


def run(command, folder, timeout=280):
    """Run a command (a list of words) in a folder with this Python's scripts on the
    path, and return its standard output.

    The test fails if the exit code is not 0; TimeoutExpired is raised after `timeout`
    seconds.
    """
    scripts = str(Path(sys.executable).parent)
    environment = os.environ | {"PATH": scripts + os.pathsep + os.environ["PATH"]}
    done = subprocess.run(
        command,
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
    assert done.returncode == 0, (command, done.stdout[-2000:], done.stderr[-2000:])
    return done.stdout


def output_of(line):
    """Run a line of a page that begins with `epcontact` in this process, and return
    what it prints.

    The test fails if the exit code is not 0.
    """
    program, *words = shlex.split(line, comments=True)
    assert program == "epcontact"
    done = invoke(*words)
    assert done.returncode == 0, done
    return done.stdout


def test_the_readme_is_short_names_every_command_and_holds_blocks_that_are_tested():
    """The README has less than 200 lines, names every command, and has no code block in
    a language that these tests do not run.
    """
    assert len(README.splitlines()) < 200
    assert [c for c in COMMANDS if f"`epcontact {c}" not in README] == []
    languages = {*re.findall(r"^```(\w+)$", README, re.MULTILINE)}
    assert languages == {"bash", "python", "toml", "yaml"}


@pytest.mark.slow
def test_main_job_from_a_clean_checkout(tmp_path):
    """The first command, to the letter, in a copy of what git tracks."""
    copy = ["git", "checkout-index", "--all", f"--prefix={tmp_path}/"]
    subprocess.run(copy, cwd=ROOT, check=True)
    main_job, tests = blocks("bash")[:2]
    assert "pytest" in tests  # not run here: it would run itself
    out = run(["bash", "-ec", main_job], tmp_path, timeout=580)
    assert "falls short" not in out
    assert (tmp_path / "results" / "verdict.json").exists()


@pytest.mark.slow
def test_commands_then_the_code_that_reads_their_results(home):
    """The README's commands run one after another, and its Python code reads the field
    files that they write.
    """
    for text in blocks("bash")[2:]:
        if "epcontact new" not in text:  # `home` ran it
            run(["bash", "-ec", text], home)
    assert (home / "pressures.png").stat().st_size > 10_000
    (reader,) = [text for text in blocks("python") if "pyvista" in text]
    assert "pressure" in run([sys.executable, "-c", reader], home)


def test_ten_lines_of_python(capsys):
    """The README's first Python example has at most ten lines and prints two areas."""
    first = blocks("python")[0]
    assert len([line for line in first.splitlines() if line]) <= 10
    exec(first, {})
    assert capsys.readouterr().out.count("Areas(") == 2


def test_an_executor_for_slurm(monkeypatch):
    """The guide's function that starts a Slurm executor is accepted as an executor of
    sweeps.
    """

    def job_executor(max_workers, block_allocation):
        """Return threads in the place of executorlib's Slurm jobs."""
        assert block_allocation
        return ThreadPoolExecutor(max_workers)

    # No Slurm here, and executorlib would ask for it.
    library = SimpleNamespace(SlurmJobExecutor=job_executor)
    monkeypatch.setitem(sys.modules, "executorlib", library)
    python = blocks("python", ".docs/sweep.md")
    (code,) = [text for text in python if text.startswith("from functools")]
    module = ModuleType("on_slurm")
    exec(code, module.__dict__)
    monkeypatch.setitem(sys.modules, "on_slurm", module)
    with executor_from("on_slurm:pool") as executor:
        assert executor.submit(max, 1, 2).result() == 2


def test_a_hardness_that_grows_with_the_magnification(capsys):
    """The guide's example of the theory prints what the guide shows."""
    guide = (ROOT / ".docs/theory.md").read_text(encoding="utf-8")
    code, output = re.search(
        r"^```python\n(from epcontact import SelfAffine.*?)^```.*?^```text\n(.*?)^```",
        guide,
        re.MULTILINE | re.DOTALL,
    ).groups()
    exec(code, {})
    assert capsys.readouterr().out == output


def test_the_page_on_the_paper_computes_its_table(capsys):
    """The program of the page on the paper prints the areas of its table; here on a
    coarse grid, of which the limit is within 5 % of the table, and the theory equal.
    """
    (code,) = blocks("python", ".docs/paper.md")
    exec(code.replace("(8, 16, 32)", "(4,)"), {})
    capped, elastic = capsys.readouterr().out.splitlines()
    totals = [
        [float(total) for total in re.findall(r"total=([^,]+),", line)]
        for line in (capped, elastic)
    ]
    assert totals[0][1] == pytest.approx(0.1097, rel=0.05)
    assert totals[1][1] == pytest.approx(0.0991, rel=0.05)
    assert totals[0][2] == pytest.approx(0.1097, abs=2e-4)
    assert totals[1][2] == pytest.approx(0.1086, abs=2e-4)


def test_solver_and_case_of_the_readers_own(home, monkeypatch):
    """The README's workflow for continuous integration verifies a reader's own case
    and compares it with saved values.
    """
    (yaml,) = blocks("yaml")
    monkeypatch.chdir(home)
    verify, compare = re.findall(r"epcontact (?:verify|compare) .*", yaml)
    output_of(verify)
    output_of("epcontact compare verdict --keep kept.csv")
    output_of(compare)
    assert (home / "verdict" / "junit.xml").exists()


def test_a_measured_map_as_the_readme_says(home, monkeypatch):
    """The case that `new` writes for a map with holes, tilt and open edges is ready to
    run, also for a J2 metal and with the theory.
    """
    x, y = np.meshgrid(np.arange(48.0), np.arange(40.0), indexing="ij")
    heights = 0.1 * np.sin(0.9 * x) * np.cos(1.1 * y) + 0.02 * x - 0.01 * y
    heights[3:5, 7] = np.nan
    np.savetxt(home / "map.txt", heights, delimiter=";")
    (words,) = re.findall(r"`epcontact (new map\.txt [^`]+)`", README)
    monkeypatch.chdir(home)
    assert invoke(*words.split()).returncode == 0
    case = (home / "map.toml").read_text()
    # The lines that the file offers as comments are taken as they are.
    for line in re.findall(r"^# ([a-z_]+ = .*|\[theory\])$", case, re.MULTILINE):
        case = case.replace(f"# {line}", line)
    case = case.replace("hardness = 6.0e9", "# hardness = 6.0e9")
    case = case.replace('methods = ["bem"]', 'methods = ["persson", "bem"]')
    (home / "measured.toml").write_text(case.replace('id = "map"', 'id = "measured"'))
    for name in ("map", "measured"):
        done = invoke("run", f"{name}.toml", "--jobs", 1)
        assert done.returncode == 0, done
        assert re.search(
            "2 of 1920 heights missing.*mirrored at its edges", done.stdout, re.DOTALL
        )
    assert "persson" in done.stdout


def test_the_tutorial_leads_from_an_instrument_s_file_to_the_right_table(
    tmp_path, monkeypatch, capsys
):
    """On a map with tilt, holes, also on summits, and spikes it finds the areas of the
    map without any of them, and that the gap leaks.
    """
    case, python, commands = (
        blocks(language, ".docs/tutorial.md") for language in ("toml", "python", "bash")
    )
    lines = [line for text in commands for line in text.splitlines()]
    assert len(lines) <= 10
    clean, faulty = (trial_map(n, holes=n > 0)[:120, :90] for n in (0, 25))
    level = remove_form(clean, 1)
    faulty[level > np.quantile(level, 0.9985)] = np.nan
    outputs = {}
    for name, heights in (("clean", clean), ("faulty", faulty)):
        folder = tmp_path / name
        folder.mkdir()
        np.savetxt(folder / "joint.csv", heights.T, delimiter=";", fmt="%.5f")
        (folder / "joint.toml").write_text(case[0])
        monkeypatch.chdir(folder)
        # The charts of one of both maps are enough.
        first = lines[0]
        if name == "clean":
            first = first.removesuffix(" --charts")
        outputs[name] = output_of(first)
    for line in lines[1:]:
        assert output_of(line)
    assert (folder / "contact.png").stat().st_size > 10_000
    exec(python[0], {})
    assert capsys.readouterr().out.count(" Pa: 0.") == 4
    assert re.search(
        r"heights are outliers.*: removed, at \(", " ".join(outputs["faulty"].split())
    )
    assert "outliers" not in outputs["clean"]
    for output in outputs.values():
        answer = " ".join(output.split())
        assert "The gap connects across the surface: yes at" in answer
    loads = {}
    for name in outputs:
        result = tmp_path / name / "results/joint/fast/bem.json"
        loads[name] = json.loads(result.read_text())["loads"]
    rows = loads["faulty"]
    for row, true in zip(rows, loads["clean"], strict=True):
        area = row["total_area"]
        assert {"grid", "treatment", "form", "missing", "hardness"} == area[
            "parts"
        ].keys()
        assert 0 < row["filled_load"]["mean"] < 0.1
        deviation = abs(area["mean"] - true["total_area"]["mean"])
        assert deviation < min(area["error"], 0.01 * area["mean"])
        assert row["mean_gap"]["mean"] == pytest.approx(
            true["mean_gap"]["mean"], rel=0.01
        )
    assert [row["branch"] for row in rows] == ["loading"] * 3 + ["unloading"]
    assert rows[3]["total_area"]["mean"] > 2 * rows[0]["total_area"]["mean"]


def test_the_main_job_is_a_function(home, monkeypatch, capsys):
    """The README's Python example verifies the case and prints that it holds."""
    (code,) = [text for text in blocks("python") if "epcontact.verify" in text]
    monkeypatch.chdir(home)
    exec(code, {})
    assert capsys.readouterr().out.startswith("True ['holds'")


@pytest.mark.slow
@pytest.mark.skipif(
    not entry_points(group="pytest11", name="epcontact.harness.pytest_plugin"),
    reason="epcontact is on the path but not installed",
)
def test_pytest_collects_the_gates_of_the_cases_it_is_told_of(home):
    """With the README's setting, pytest runs each gate of the named case as a test, all
    on the worker that solves the case.
    """
    (setting,) = [text for text in blocks("toml") if "epcontact_cases" in text]
    (home / "pyproject.toml").write_text(setting)
    (home / "my-surface.toml").rename(home / "my-surface.case.toml")
    (home / "other.toml").write_text("not a case")
    command = [sys.executable, "-m", "pytest", "-n", "2", "--dist", "loadscope", "-v"]
    out = run([*command, "-p", "no:cacheprovider"], home)
    defaults = (ROOT / "epcontact/harness/case_files/default_gates.toml").read_text()
    expected = 1 + defaults.count('of = "bem"')  # its own gate, and the default ones
    assert f"{expected} passed" in out
    assert len(set(re.findall(r"\[(gw\d)\].* PASSED", out))) == 1, (
        "one worker solves the case"
    )


@pytest.mark.parametrize("path", EXAMPLES)
def test_examples_in_docstrings_run(path):
    """All examples in the docstrings of a module of the product give the shown
    output.
    """
    name = ".".join(path.with_suffix("").parts).removesuffix(".__init__")
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    found = doctest.testmod(importlib.import_module(name), optionflags=flags)
    assert found.failed == 0 < found.attempted
