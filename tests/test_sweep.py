"""Sweeps: the points of a table, tasks that are kept and done again, and the table read
back.
"""

import random
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from command_line import invoke
from test_executor import ONE, THEORY, Elsewhere

from epcontact import persson
from epcontact.cli import sweep as sweep_command
from epcontact.cli.list_cases import _is_verified
from epcontact.errors import InvalidCase, NotConverged, OutputError
from epcontact.harness import sweep
from epcontact.harness.case_files.case import find_case, load_case
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.sweep import Swept
from epcontact.harness.verdict.verification import verify
from epcontact.output.vtk import read_fields

THEORY_IS_NUMBER = ('against = "persson"', 'against = 0.1\nsource = "made"')
GRID = """
[sweep]
load.mean_pressure = [2e8, 4e8]
material.hardness = [3e9, 6e9, 12e9]
"""


@pytest.fixture
def swept(write_case):
    """Return a function that writes the small case with a sweep and returns its path.

    Its arguments are the text of the sweep and replacements (old, new) in the case; by
    default the case has the theory alone, which takes milliseconds.
    """
    return lambda text=GRID, *edits: write_case(*(edits or THEORY), more=text)


def test_chosen_points_keep_fields_and_pictures(swept, tmp_path):
    """`--fields first --among` saves the fields of the named point only."""
    grid = "[sweep]\nload.mean_pressure = [2e8, 4e8]\n"
    path = swept(grid, ('["persson", "bem"]', '["bem"]'), THEORY_IS_NUMBER, ONE)
    options = (
        "--fields",
        "first",
        "--among",
        "mean_pressure 4e+08",
        "--charts",
        "--jobs",
        1,
    )
    done = invoke("sweep", path, "--output", tmp_path, *options)
    assert done.returncode == 0, done
    folder = tmp_path / "small" / "fast"
    (fields,) = folder.glob("*.vti")
    assert (
        f"fields of mean_pressure 4e+08, seed3, bem in {fields}"
        in done.stdout.replace("\n", "")
    )
    assert read_fields(fields).attributes["mean_pressure"] == 4e8


P = "load.mean_pressure ="
NU = "material.poisson_ratio"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (f"{P} []", "load.mean_pressure is .*at least 1 item"),
        (f"{P} [1e8, 1e8]", "load.mean_pressure has a value twice"),
        (f"{P} {{low = 1, high = 2}}", "must be a list of values, such as"),
        (
            f"{P} {[*range(1, 401)]}\nmaterial.hardness = {[*range(1, 401)]}",
            "160000 points, but",
        ),
        (f"samples = 3\n{P} [1e8]", "sweep.samples is no key of a case file"),
        ("bem.tolerance = [1e-6, 1e-8]", "no method of the case reads bem.tolerance"),
        ("seeds = [1, 2]", "no key has values; give such as"),
        ("surface.seeds = [1, 2]", "give seeds = "),
        ("loda.mean_pressure = [1e8]", "sweep.loda is no key .* did you mean 'load'"),
        ("load.mean_presure = [1e8]", "load.mean_presure is no key .* 'mean_pressure'"),
        (f"{P} [1e8, 'heavy']", "valid.*at the point load.mean_pressure = 'heavy'"),
        (f"quantities = ['quantity.stifness']\n{P} [1e8]", "no method .* did you mean"),
        (f"quantities = ['quantity.measured_gap']\n{P} [1e8]", "no method of the"),
        (f"{P}[1]\n[[sweep.point]]\n{P}2", "has values of its own"),
        ("[[sweep.point]]\na.b=2\n[[sweep.point]]\na.c=2", "different keys"),
    ],
)
def test_bad_sweep_is_one_sentence(swept, tmp_path, text, sentence):
    """An invalid table of a sweep raises InvalidCase in one line that begins with the
    file and matches `sentence`, and leaves no output folder.

    `text` is the TOML text below [sweep].
    """
    path = swept(f"\n[sweep]\n{text}\n")
    with pytest.raises(InvalidCase, match=sentence) as refused:
        sweep.run_sweep(path, output=tmp_path / "out", jobs=1)
    assert str(refused.value).startswith(str(path))
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "out").exists()


def test_each_row_is_the_solve_at_its_point(swept, tmp_path):
    """Each row of the table, one for each combination of two loads, three hardnesses
    and two Poisson's ratios, has the plastic area of the theory at these values.
    """
    path = swept(f"{GRID}point = [{{ {NU} = 0.0 }}, {{ {NU} = 0.2 }}]\n")
    case = load_case(path)
    found = sweep.run_sweep(path, output=tmp_path, jobs=1).table
    scene = case.scene(case.recipes[0])
    for _, row in found.iterrows():
        material = replace(
            scene.material, hardness=row["material.hardness"], poisson_ratio=row[NU]
        )
        load = replace(scene.load, mean_pressure=row["load.mean_pressure"])
        scene_of_row = replace(scene, material=material, load=load)
        areas = persson.solve(scene_of_row, energy_reduction=0.536).final.areas
        assert row["area.plastic.corrected"] == areas["corrected"].plastic
    assert found["solved"].tolist() == [True] * 12
    assert (
        len(found.drop_duplicates(["load.mean_pressure", "material.hardness", NU]))
        == 12
    )


def test_a_stopped_sweep_goes_on_and_ends_like_that_of_another_executor(
    swept, tmp_path
):
    """A sweep that was interrupted after three of six tasks reuses them, and ends with
    the table of an unbroken run on another executor.
    """

    def stopped(done, *_):
        """Interrupt the sweep after its third task."""
        if done == 3:
            raise KeyboardInterrupt

    path = swept()
    folder = tmp_path / "small" / "fast"
    executor = Elsewhere(tmp_path / "far")
    unbroken = sweep.run_sweep(
        path, output=tmp_path / "whole", executor=lambda: executor
    )
    assert not list(executor.folder.iterdir())
    with pytest.raises(KeyboardInterrupt):
        sweep.run_sweep(path, output=tmp_path, jobs=1, progress=stopped)
    partial_table = sweep.table(folder)
    assert list(partial_table["solved"]) == [True] * 3 + [False] * 3
    assert list(partial_table["area.total.raw"].isna()) == [False] * 3 + [True] * 3
    resumed = sweep.run_sweep(path, output=tmp_path, jobs=1)
    assert resumed.reused == 3
    assert (
        sweep.digest(resumed.table)
        == sweep.digest(unbroken.table)
        != sweep.digest(partial_table)
    )
    read = pd.read_csv(folder / "sweep.csv", dtype=str)["area.total.raw"].astype(float)
    np.testing.assert_array_equal(read, resumed.table["area.total.raw"])


def test_results_belong_to_their_points(swept, tmp_path):
    """Saved results are reused for equal points only: three for a new list of loads,
    none after a change of the surface; a bad executor changes no file.
    """
    path = swept()
    sweep.run_sweep(path, output=tmp_path, jobs=1)
    path.write_text(path.read_text().replace("[2e8, 4e8]", "[1e8, 4e8]"))
    other_loads = sweep.run_sweep(path, output=tmp_path, jobs=1)
    assert (other_loads.reused, len(other_loads.table)) == (3, 6)
    path.write_text(path.read_text().replace("rms_slope = 0.1", "rms_slope = 0.2"))
    before = (other_loads.folder / "sweep.json").read_bytes()
    with pytest.raises(InvalidCase, match="not a concurrent"):
        sweep.run_sweep(path, output=tmp_path, executor="os:getpid")
    assert (other_loads.folder / "sweep.json").read_bytes() == before
    steep = sweep.run_sweep(path, output=tmp_path, jobs=1)
    assert steep.reused == 0
    assert (steep.table["area.total.raw"] < other_loads.table["area.total.raw"]).all()


def test_methods_surfaces_and_measured_quantities(swept, tmp_path):
    """A method that fails and a quantity that is not defined leave the other values of
    the table.
    """
    text = f"""[sweep]\n{P} [4e8]\nseeds = [1, 2]
        quantities = ["quantity.total_patches", "quantity.conductance"]\n"""
    layer = ("[load]", '[body]\nkind = "bonded_layer"\ndepth = 1e-3\n\n[load]')
    found = sweep.run_sweep(swept(text, ONE, layer), output=tmp_path, jobs=1)
    (failure,) = found.failures.values()  # of the theory, which knows no layer
    assert "Persson's theory is that of a half-space" in failure
    assert list(found.table["seed"].fillna(0)) == [0, 1, 2]
    patches = found.table["quantity.total_patches"]
    assert list(patches.isna()) == [True, False, False]
    assert patches[1] != patches[2]
    assert "quantity.conductance" not in found.table  # a column without any value
    results = [
        f.read_text("utf-8") for f in (found.folder / "members").glob("bem-*.json")
    ]
    assert all("no value: quantity.conductance: Barber's analogy" in s for s in results)


def test_failed_tasks_are_said_and_tried_again(swept, tmp_path, monkeypatch):
    """Failed tasks are counted by reason with exit code 2, and solved by the next run;
    a load path counts as one task.
    """
    path = swept()
    real = METHODS["persson"]
    command = ("sweep", path, "--output", tmp_path, "--jobs", "1")

    def heavy(scene, *rest):
        """Solve the scene by the theory, but raise NotConverged above 300 MPa."""
        if scene.load.final > 3e8:
            raise NotConverged("too heavy for a test")
        return real.solve(scene, *rest)

    monkeypatch.setitem(METHODS, "persson", replace(real, solve=heavy))
    failed = invoke(*command)
    assert failed.returncode == 2
    assert "3 tasks failed" in failed.stderr
    assert "3 with: too heavy for a test" in failed.stderr
    assert sweep.table(tmp_path / "small" / "fast")["solved"].sum() == 3
    monkeypatch.setitem(METHODS, "persson", real)
    done = invoke(*command)
    assert "6 of 6 tasks are solved, 3 of them earlier" in done.stdout
    assert "6 of 6, 3 reused" in done.stderr
    # A load path is one task, and no axis of a sweep.
    path = swept(
        "[sweep]\nmaterial.hardness = [6e9, 8e9]\n",
        *THEORY,
        ("= 5.0e8", "= [2e8, 5e8]"),
    )
    assert (
        "2 of 2 tasks"
        in invoke("sweep", path, "--output", tmp_path / "x", "--jobs", 1).stdout
    )


def test_a_long_sweep_shows_its_first_points_and_counts_failures(monkeypatch, tmp_path):
    """The screen of a sweep shows 40 of 43 points, notes, fields, and the failures by
    their number.
    """
    load = {
        "branch": "loading",
        "mean_pressure": {"mean": 2e3, "error": 0.0, "parts": {}},
        "total_area": {"mean": 0.125, "error": 0.01, "parts": {"grid": 0.01}},
    }
    solved = pd.DataFrame({"load": [0, 0, 0], "solved": [True, True, False]})
    swept = Swept(
        folder=tmp_path,
        table=solved,
        failures={"a": "stalled", "b": "no memory", "c": "stalled"},
        reused=1,
        loads={f"hardness {n}, bem": ([load], "1") for n in range(43)},
        quantities=(),
        notes={"a note": 2},
        fields={tmp_path / "x.vti": "point 7"},
    )
    monkeypatch.setattr(sweep_command, "run_sweep", lambda *_, **__: swept)
    done = invoke("sweep", "mine")
    assert done.returncode == 2
    assert done.stdout.count("loading") == 40
    for words in (
        "and 3 more\n",
        "note of 2 tasks: a note\n",
        "fields of point 7 in ",
        "2 of 3 tasks are solved, 1 of them earlier; table in ",
    ):
        assert words in done.stdout
    assert "3 tasks failed" in done.stderr
    assert "2 with: stalled; 1 with: no memory" in done.stderr


def test_a_case_may_have_a_sweep_and_no_gate(swept, tmp_path):
    """A case with a sweep and no gate is readable, is not listed as verified, and
    cannot be verified.
    """
    path = swept()
    text, _, rest = path.read_text().partition("[[gate]]")
    path.write_text(text + rest[rest.index("[sweep]") :])
    assert len(sweep.read_sweep(path).tasks) == 6
    assert not _is_verified(find_case(path), {})
    with pytest.raises(InvalidCase, match=r"has no gate to judge; .*`epcontact sweep`"):
        verify(path, output=tmp_path)


def test_what_holds_no_sweep_is_refused(swept, tmp_path):
    """A case without the table [sweep], and a damaged sweep.json, are refused."""
    with pytest.raises(
        InvalidCase, match=r"has no table \[sweep\], such as load.mean_pressure = "
    ):
        sweep.read_sweep(swept(""))
    (tmp_path / "sweep.json").write_text("[]")
    with pytest.raises(OutputError, match="is no list of a sweep"):
        sweep.table(tmp_path)


MANY = f"[sweep]\n{P} {[k * 1e8 for k in range(1, 13)]}\nseeds = [1, 2, 3, 4]\n"


def count_results(output):
    """Return the number of saved results below an output folder."""
    return len(list(output.rglob("members/*.json")))


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_a_sweep_killed_ten_times_ends_like_an_unbroken_one(swept, tmp_path):
    """A sweep of 48 tasks that is killed ten times at random moments loses no finished
    task and ends with the table of an unbroken one.
    """
    path = swept(MANY, ONE)
    output = tmp_path / "killed"
    moments = random.Random(7)
    unbroken = sweep.run_sweep(path, output=tmp_path / "whole", jobs=1)
    solved = []
    options = ["--output", output, "--jobs", "2"]
    command = [sys.executable, "-m", "epcontact", "sweep", path, *options]
    for _ in range(10):
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        wanted = count_results(output) + moments.randint(1, 4)
        while count_results(output) < wanted and process.poll() is None:
            time.sleep(0.01)
        time.sleep(moments.uniform(0, 0.1))
        process.kill()
        assert "Traceback" not in process.communicate()[1]  # what the workers leave
        solved.append(int(sweep.table(output / "small" / "fast")["solved"].sum()))
    assert solved == sorted(solved)
    # A quiet machine may finish before the tenth kill, but not before the first.
    assert solved[0] < len(unbroken.table)
    assert solved[-1] >= 10
    resumed = sweep.run_sweep(path, output=output, jobs=2)
    assert resumed.reused == solved[-1]
    assert sweep.digest(resumed.table) == sweep.digest(unbroken.table)
