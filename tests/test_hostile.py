"""A verdict never says that all is well when a solver, a case or the machine
misbehaves.

The solvers are those of hostile.py, each in a process of its own as with `--solver`.
"""

import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import hostile
import numpy as np
import pytest
from click.testing import CliRunner
from command_line import invoke
from conftest import SMALL_CASE
from fem_scenes import rough_scene

import fem_check
from epcontact import bem, planning
from epcontact.cli.commands import plan
from epcontact.errors import InvalidCase, NotConverged
from epcontact.harness.case_files.case import load_case
from epcontact.harness.gates import carried_pressure
from epcontact.harness.methods import foreign
from epcontact.harness.methods.load_by_load import solve_load_by_load
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.quantities.registry import measure
from epcontact.harness.solving.method_results import MethodResults
from epcontact.harness.verdict import hints
from epcontact.harness.verdict.judgement import judge_case
from epcontact.harness.verdict.pytest_cases import GateFellShort, GateItem
from epcontact.harness.verdict.verification import verify
from epcontact.harness.workers import Worker, WorkerDied, WorkerPool, spread
from epcontact.machine import alive
from epcontact.peers.pressure_result import result_of_pressures
from epcontact.results import Areas, ContactResult, LoadStep, Provenance
from epcontact.scene import Body, Load, Material, Scene, Surface

#: Replacements after which SMALL_CASE has the theory alone and a gate that holds.
THEORY = (
    ('methods = ["persson", "bem"]', 'methods = ["persson"]'),
    (
        'of = "bem"\nagainst = "persson"',
        'of = "persson"\nagainst = 0.1\nsource = "a guess"',
    ),
    ("tolerance = 0.5", "tolerance = 10.0"),
)
SURFACE = SMALL_CASE[SMALL_CASE.index("[surface]") : SMALL_CASE.index("[material]")]
WAVE = '[surface]\nkind = "sinusoid"\nperiod = 1e-3\nshape = [64]\namplitude = 1e-7\n\n'
GATE = SMALL_CASE[SMALL_CASE.index("\n[[gate]]") :]
#: A result of the theory with a contact area of 0.1, without fields.
ANSWER = ContactResult(
    "persson",
    (LoadStep(5e8, {"corrected": Areas(0.1, 0.1, 0.0)}),),
    Provenance("digest"),
)


@pytest.fixture
def verified(write_case, tmp_path, monkeypatch):
    """Return a function that verifies two cases of the theory (THEORY).

    Its argument is a list of the results that the theory returns, or of the errors that
    it raises, or a function in place of the theory; it returns the verdict and writes
    to the folder `out`.
    """
    cases = [load_case(write_case(*THEORY, name=name)) for name in ("first", "second")]

    def run(answers):
        """Verify the cases with a theory that gives prescribed answers or raises
        them.
        """
        persson = replace(METHODS["persson"], solve=Mock(side_effect=answers))
        monkeypatch.setitem(METHODS, "persson", persson)
        return verify(cases, output=tmp_path / "out", jobs=1, fresh=True)

    return run


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (np.linalg.LinAlgError("Singular matrix"), "LinAlgError: Singular matrix"),
        (MemoryError(), "not enough memory"),
        (
            ValueError("bell \a, NUL \0, half \udc80"),
            r"bell \x07, NUL \x00, half \udc80",
        ),
        (replace(ANSWER, converged=False), "not converged"),
    ],
)
def test_the_error_of_a_solve_is_its_cases_error(verified, tmp_path, answer, sentence):
    """An exception of a solver, or a result that has not converged (`answer`), makes
    its own case an error.

    Verdict, exit code 2 and junit.xml report it; `sentence` is a part of the message.
    """
    verdict = verified([answer, ANSWER])
    assert [case.status for case in verdict.cases] == ["error", "holds"]
    assert sentence in str(verdict.cases[0].gates[0].error)
    written = json.loads((tmp_path / "out" / "verdict.json").read_text())
    assert written["exit_code"] == verdict.exit_code == 2
    suites = ET.parse(tmp_path / "out" / "junit.xml").getroot()
    assert (suites.attrib["errors"], suites.attrib["tests"]) == ("1", "2")


@pytest.mark.parametrize(("name", "status"), [("persson", "error"), ("bem", "holds")])
def test_no_error_of_a_method_passes_if_a_gate_reads_it_or_not(
    write_case, name, status
):
    """An error of a method makes its case an error, whether or not a gate reads the
    method.

    `name` is the method with the error, and `status` that of the only gate, which reads
    the theory; pytest reports the error in both cases.
    """
    good = MethodResults((ANSWER,), ("single",))
    given = {"persson": good, "bem": good} | {
        name: MethodResults(errors=(f"{name}, single: stalled",))
    }
    case = load_case(write_case(*THEORY))
    judged = judge_case(case, given)
    assert (judged.status, judged.gates[0].status) == ("error", status)
    item = object.__new__(GateItem)
    item.number = 0
    item.parent = SimpleNamespace(verdict=judged, case=case)
    item.user_properties = []
    with pytest.raises(GateFellShort, match="stalled"):  # under pytest
        item.runtest()


def test_earlier_verdict_is_gone_before_the_first_solve(verified, tmp_path):
    """The files of an earlier verdict are gone when a solve begins, and stay away if it
    is interrupted.
    """
    files = [tmp_path / "out" / name for name in ("verdict.json", "junit.xml")]

    def solve(*_):
        """Check that no old file is left, and interrupt the run."""
        assert not any(path.exists() for path in files)
        raise KeyboardInterrupt

    verified([ANSWER, ANSWER])
    assert all(path.exists() for path in files)
    with pytest.raises(KeyboardInterrupt):
        verified(solve)
    with pytest.raises(InvalidCase, match="no case is called"):
        verify("no-such-case", output=tmp_path / "out")
    assert not any(path.exists() for path in files)


@pytest.mark.parametrize(("error", "code"), [(0.5, 0), (1.0, 1), (float("nan"), 1)])
def test_broken_promise_of_a_plan_is_exit_1(write_case, monkeypatch, error, code):
    """`epcontact plan --check` ends with exit `code` 1 if the `error` exceeds the
    tolerance of 90 %, or is NaN.
    """
    monkeypatch.setattr(planning, "achieved_error", lambda *_: error)
    path = write_case(
        ("seeds = [3, 5, 7]", "seeds = [3]"),
        ("fast = 4, full = 8", "fast = 4"),
    )
    done = CliRunner().invoke(plan, [str(path), "--tolerance", "90%", "--check"])
    assert done.exit_code == code, done.output
    assert ("was broken" in done.output) == (code == 1)


# --- foreign solvers ------------------------------------------------------------------


@pytest.fixture(scope="module")
def one_worker():
    """Return a worker whose process serves many solvers, and ends after these tests."""
    worker = Worker()
    yield worker
    worker.end()


@pytest.fixture
def in_one_worker(one_worker, monkeypatch):
    """Call all solvers in one process, which starts again only after it died."""
    monkeypatch.setattr(foreign, "_worker", lambda source: one_worker)


@pytest.fixture
def scene():
    """Return a line of 32 points with a wave that is pressed flat.

    Its exact pressure is that of hostile.full_contact.
    """
    heights = 1e-7 * np.cos(2 * np.pi * np.arange(32) / 32)
    return Scene(Surface(heights, (1e-3,)), Material(2e11, 0.3), Load(1e9))


@pytest.mark.usefixtures("in_one_worker")
@pytest.mark.parametrize(
    ("solver", "sentence"),
    [
        ("hostile:exits_with_success", "ended with exit code 0 and gave no answer"),
        ("hostile:raises_system_exit", "raised SystemExit: 0"),
        (
            "hostile:breaks_memory",
            "was killed by SIGSEGV (invalid memory access) and gave no",
        ),
        (
            "hostile:is_killed",
            "was killed by SIGKILL (most likely for want of memory) and gave no",
        ),
        ("hostile:has_no_memory", "raised not enough memory"),
        (
            "hostile:divides_by_zero",
            "raised ZeroDivisionError: integer division or modulo by zero (hostile.py, "
            "line 70, in divides_by_zero: return 1 // 0)",
        ),
        ("hostile:returns_a_table", "returned no epcontact.ContactResult but 'dict'"),
        ("hostile:returns_another_grid", "returned the field pressure of shape (3,)"),
        (
            "hostile:has_no_steps",
            "raised ValueError: a ContactResult needs at least one load step",
        ),
        ("hostile:returns_a_list", "a ContactResult that cannot be read (TypeError"),
        ("hostile:has_saved_work", "fft_pairs -1, but costs are numbers from 0"),
        (
            "hostile:answers_twice",
            "at [1000000000.0, 1000000000.0] Pa, but the scene has loads at",
        ),
        ("hostile:names_a_number", "returned a field named 1, but names are letters"),
        ("hostile:is_unsure", "returned converged yes, but it is 0 or 1"),
        ("hostile:is_far_off", "gap nan, but residuals are numbers from 0 up to 1"),
        ("hostile:presses_infinitely", "pressure is infinite or NaN at a point"),
        ("false {scene} {result}", "returned a command that ended with exit code 1"),
        ("true {scene} {result}", "ended with exit code 0 and wrote no result"),
        ("cp {scene} {result}", "does not begin with 'epcontact-result 1'"),
        ("converged 1", "without 'pressure'"),
        (f"pressure {32 * '1 '}", "without 'converged'"),
        ("pressure 1 converged 1", "fewer than 32 numbers after 'pressure'"),
        (f"pressure {32 * '1 '} 3 converged 1", "'3' in the place of one of"),
    ],
)
def test_the_failure_of_a_foreign_solver_is_told_as_what_it_was(
    scene, solver, sentence
):
    """`foreign.solve` raises InvalidCase with the solver and a `sentence` about what
    went wrong.

    `solver` is a function of hostile.py, a command, or the words of a result after its
    first line.
    """
    if solver.startswith(("converged", "pressure")):
        # A command that writes these words as its result.
        solver = f"sh -c 'echo epcontact-result 1 {solver} > {{result}} # {{scene}}'"
    with pytest.raises(InvalidCase) as refused:
        foreign.solve("mine", solver, scene, limit=60)
    assert sentence in str(refused.value)
    assert f"solver {solver} " in str(refused.value)


@pytest.mark.usefixtures("in_one_worker")
def test_headlines_and_numbers_of_a_solver_are_those_of_its_pressures(scene):
    """Areas, distribution and quantities follow from the pressures of a solver,
    whatever else it reports.

    The text of a result is read with the exponents of Fortran; twice the same field,
    and numbers out of range, raise InvalidCase.
    """
    found = foreign.solve("mine", "hostile:invents_its_path", scene)
    full_contact = Areas(1.0, 1.0, 0.0)
    assert found.final.areas["corrected"] == full_contact
    assert found.final.areas["raw"] == full_contact
    assert carried_pressure(found.distribution) == pytest.approx(1e9, rel=1e-3)
    assert "stiffness_loading" not in found.final.quantities
    # J2 plasticity, whose pressures no cap bounds: the areas stay as they are.
    flowing = fem_check.solve(rough_scene(8, 2), certified=False)
    areas = vars(flowing.final.areas["raw"])
    by_pressures = foreign._by_its_pressures(flowing, rough_scene(8, 2))
    assert vars(by_pressures.final.areas["raw"]) == pytest.approx(areas, abs=1e-12)
    assert 0 < areas["plastic"] != pytest.approx(areas["elastic"])
    text = "epcontact-result 1 converged T residual 1d-9 "
    text += "pressure 0.1D+10 1.0-120 -1.0e+9 5.+100"
    read = foreign.result_of_text(text, (4,))["pressure"]
    np.testing.assert_array_equal(read, [1e9, 1e-120, -1e9, 5e100])
    for text, message in (
        ("pressure 1 pressure 1 converged 1", "'pressure' twice"),
        ("pressure 1 converged 2", "converged 2.0, but it is 0 or 1"),
        ("pressure 1 converged nan", "converged nan, but"),
        ("residual 1e300 pressure 1 converged 1", "residual 1e\\+300, but"),
    ):
        with pytest.raises(InvalidCase, match=message):
            foreign.result_of_text(f"epcontact-result 1 {text}", (1,))
    with pytest.raises(InvalidCase, match="a field named ''"):
        foreign._checked(hostile.leaves_no_name(scene), scene)


def test_open_points_below_plastic_ones_are_no_solution():
    """`result_of_pressures` raises NotConverged for the pressures of independent
    springs, where all points in contact are plastic and others that are open lie below
    the flat.
    """
    heights = 1e-6 * np.random.default_rng(0).normal(size=(6, 4))
    third_highest = np.sort(heights, axis=None)[-3]
    # Three points touch, all at the hardness.
    pressure = np.where(heights >= third_highest, 1e9, 0.0)
    surface = Surface(heights, (1e-3, 1e-3))
    rough = Scene(surface, Material(2e11, 0.3, 1e9), Load(pressure.mean()))
    with pytest.raises(NotConverged, match="open points lie below plastic ones"):
        result_of_pressures(rough, {"pressure": pressure}, "springs")


@pytest.mark.usefixtures("in_one_worker")
@pytest.mark.parametrize("loads", ["5e8, 1e9, 5e8", "5e8, 0.0, 1e9, 1.1e9, 0.0"])
def test_every_load_of_a_path_is_that_of_the_pressures_alone(
    write_case, tmp_path, loads
):
    """All loads of a path have the values of the boundary elements that solve the same
    path, whatever a solver invents.

    `loads` are the mean pressures in Pa; an error at the first load shows in a gate of
    the last one.
    """
    edits = (
        ("mean_pressure = 5.0e8", f"mean_pressure = [{loads}]"),
        ("[3, 5, 7]", "[3]"),
        ('"persson", "bem"', '"bem"'),
        ('against = "persson"', 'against = 0\nsource = "-"'),
    )
    case = load_case(write_case(*edits))

    def judge(solver):
        """Return the verdict on the case with a solver of hostile.py."""
        verdict = verify([case], solver=f"hostile:{solver}", output=tmp_path, jobs=1)
        return verdict.cases[0]

    judged = judge("invents_its_path")
    wrong = judge("errs_at_the_first_load")
    # What it invents is compared with its pressures, and does not replace them.
    assert {gate.quantity for gate in judged.gates[1:] if not gate.holds} == {
        "quantity.measured_areas",
        "quantity.measured_figures",
    }
    fallen_short = {gate.quantity for gate in wrong.gates if not gate.holds}
    assert "quantity.measured_gap" in fallen_short
    (found,) = judged.results["invents_its_path"].results
    assert "wear: the solver's word, which nothing here checks" in found.notes
    own = bem.solve(case.scene(case.recipes[0]))
    # The cost includes the loads before.
    assert found.cost["fft_pairs"] > 1.5 * own.cost["fft_pairs"]
    for mine, step in zip(found.steps, own.steps, strict=True):
        for kind, areas in step.areas.items():
            assert vars(mine.areas[kind]) == pytest.approx(vars(areas), abs=1e-6)
        for name, value in step.quantities.items():
            assert mine.quantities[name] == pytest.approx(value, rel=1e-5, abs=1e-12)
        assert 0 <= mine.quantities["stiffness_loading"] < 1e15
        assert "plastic_force_share" not in mine.quantities


def with_mistake(mistake, scene):
    """Return the result of a solver that makes a mistake, by its name, on a scene."""
    material, surface = scene.material, scene.surface
    wrong = scene
    if mistake == "modulus":
        modulus = material.young_modulus * (1 - material.poisson_ratio**2)
        wrong = replace(scene, material=replace(material, young_modulus=modulus))
    if mistake == "heights":
        flipped = replace(surface, heights=-surface.heights)
        wrong = replace(scene, surface=flipped)
    if mistake == "hardness":
        wrong = replace(scene, material=replace(material, hardness=math.inf))
    if mistake == "period":
        points = surface.shape[0]
        longer = tuple(length * points / (points - 1) for length in surface.periods)
        wrong = replace(scene, surface=replace(surface, periods=longer))
    if mistake == "load":
        wrong = replace(scene, load=Load(scene.load.final / 2))
    result = bem.solve(wrong)
    step = replace(result.final, mean_pressure=scene.load.final)
    if mistake == "axes":
        transposed = {"pressure": result.fields["pressure"].T}
        return replace(result, fields=transposed, steps=(step,))
    if mistake == "count":
        raw = Areas(*(1.1 * area for area in vars(step.areas["raw"]).values()))
        step = replace(step, areas={**step.areas, "raw": raw})
    return replace(result, steps=(step,))


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        ("modulus", "E in the place of E* = E / (1 - nu^2)"),
        ("heights", "heights of the other sign"),
        ("hardness", "no hardness"),
        ("period", "the period divided by one point too few"),
        ("load", "half of the load"),
        ("axes", "x and y exchanged in its results"),
        ("count", ""),
        ("none", ""),
    ],
)
def test_a_known_mistake_of_a_solver_is_named(mistake, words):
    """The hint names the mistake that a solver makes, and no other; a solver that
    counts its area wrongly has correct pressures, and its report is quoted.
    """
    scene = rough_scene(24, 3, yield_stress=math.inf, hardness=0.1)
    result = foreign._checked(with_mistake(mistake, scene), scene)
    hint = hints._nearest_mistake(scene, result)
    assert hint.partition(" % from results with ")[2].startswith(words)
    assert bool(hint) == bool(words)
    reports = [*hints._differing_reports(result)]
    total = result.final.areas["raw"].total
    wrong_report = f"reports total area {1.1 * total:.6g}, but its fields have "
    is_quoted = any(report.startswith(wrong_report) for report in reports)
    assert is_quoted == (mistake == "count")
    error = measure("quantity.measured_areas", scene, result)
    assert (error > 0.05 * total) == (mistake in ("count", "hardness"))


def test_a_known_mistake_is_named_on_a_path_that_unloads():
    """Of a path the largest load before the first unloading is compared."""
    scene = rough_scene(24, 3, yield_stress=math.inf, hardness=math.inf)
    p0 = scene.load.final
    scene = replace(scene, load=Load((p0 / 2, p0, p0 / 4)))

    def solve_last(ends_here, _):
        """Return the result of a solver with E for E* at the last load of a scene."""
        alone = replace(ends_here, load=Load(ends_here.load.final))
        return foreign._checked(with_mistake("modulus", alone), alone)

    result = solve_load_by_load(solve_last, scene)
    assert "with E in the place of E*" in hints._nearest_mistake(scene, result)


def test_a_verdict_holds_the_hints_on_a_solver(tmp_path, monkeypatch):
    """The case of a solver with a mistake has a hint in verdict.json, and one of a
    correct solver has none.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert invoke("new", "solver").returncode == 0
    text = (tmp_path / "my_solver.py").read_text()
    imports = "from dataclasses import replace\nfrom epcontact import bem"
    text = text.replace("from epcontact import bem", imports)
    modulus = "0.91 * scene.material.young_modulus"  # nu is 0.3
    material = f"replace(scene.material, young_modulus={modulus})"
    wrong = text.replace("(scene, ", f"(replace(scene, material={material}), ")
    (tmp_path / "wrong_solver.py").write_text(wrong)
    hints_of = {}
    for module in ("my_solver", "wrong_solver"):
        verdict = verify(
            "my-solver.toml",
            output=tmp_path / module,
            solver=f"mine={module}:solve",
            jobs=1,
        )
        written = json.loads((tmp_path / module / "verdict.json").read_text())
        assert written["cases"][0]["hints"] == verdict.cases[0].hints
        hints_of[module] = verdict.cases[0].hints
    assert hints_of["my_solver"] == []
    assert "with E in the place of E*" in hints_of["wrong_solver"][-1]


@pytest.mark.usefixtures("in_one_worker")
def test_what_a_solver_does_to_its_scene_and_output_does_not_reach_ours(scene):
    """A solver that changes its scene or fills its standard output changes neither the
    caller's scene nor the result.
    """
    heights = scene.surface.heights.copy()
    digest = scene.digest
    wrong = foreign.solve("mine", "hostile:changes_its_scene", scene)
    np.testing.assert_array_equal(wrong.fields["pressure"], scene.load.final)
    np.testing.assert_array_equal(scene.surface.heights, heights)
    assert scene.digest == digest == wrong.provenance.scene
    right = foreign.solve("mine", "hostile:prints", scene, 1e300)
    exact = hostile.full_contact(scene).fields["pressure"]
    np.testing.assert_array_equal(right.fields["pressure"], exact)
    assert right.method == "mine"
    assert right.provenance.options["solver"] == "hostile:prints"


def test_many_calls_share_one_process_until_it_dies_or_is_ended(tmp_path, monkeypatch):
    """A Worker runs its calls in one process, and starts another one after that died.

    WorkerDied reports exit code, exception or time limit; processes and temporary
    folders that a call has started or made end with it.
    """
    monkeypatch.chdir(tmp_path)
    worker = Worker()
    first = worker.call(os.getpid)
    temporary = Path(worker.call(tempfile.mkdtemp))
    assert temporary.is_dir()
    assert worker.call(os.getpid) == first != os.getpid()
    with pytest.raises(WorkerDied, match="exit code 3"):
        worker.call(os._exit, 3)
    with pytest.raises(WorkerDied, match="raised FileNotFoundError"):
        worker.call(os.remove, "absent")
    with pytest.raises(WorkerDied, match="was not finished within 3 s and was ended"):
        worker.call(hostile.hangs, None, limit=3)
    pids = Path("pids").read_text().split()
    assert not any(alive(int(pid)) for pid in (first, *pids))
    assert not temporary.parent.exists()
    second = worker.call(os.getpid)
    assert second != first
    worker.end()
    assert not alive(second)


def test_process_that_dies_costs_its_own_task_only():
    """A task whose process dies has an error, and all other tasks of the pool have
    their results.
    """
    items = ["one", "dies", "two", "three"]
    found = dict(spread(hostile.answers_or_dies, items, WorkerPool(2)))
    assert found.pop("dies") == "its process ended with exit code 0 and gave no answer"
    assert found == {"one": "ONE", "two": "TWO", "three": "THREE"}


def test_processes_do_not_run_the_script_again_and_end_with_it(tmp_path):
    """Workers do not run the script that starts them.

    They end with it, and delete their temporary folders, also when it is killed while
    they work.
    """
    (tmp_path / "script.py").write_text(
        "import os, time; from epcontact.harness.workers import Worker, WorkerPool\n"
        "pool, worker = WorkerPool(1), Worker()\n"
        "print(worker.call(__import__('tempfile').mkdtemp))\n"
        "print(worker.call(os.getpid), pool.submit(os.getpid).result(), flush=True)\n"
        "pool.submit(time.sleep, 3600); time.sleep(0.2); os.kill(os.getpid(), 9)\n"
    )
    command = [sys.executable, "-X", "dev", tmp_path / "script.py"]
    done = subprocess.run(
        command, check=False, capture_output=True, text=True, timeout=60
    )
    folder, line = done.stdout.splitlines()
    gone = time.monotonic() + 20
    while any(alive(int(pid)) for pid in line.split()) and time.monotonic() < gone:
        time.sleep(0.05)
    assert not any(alive(int(pid)) for pid in line.split())
    assert not Path(folder).parent.exists()
    assert (done.returncode, done.stderr) == (-9, "")


#: The head of the text that a program gets: lengths in m, stresses in Pa.
SCENE_TEXT = """epcontact-scene 1
dimensions 2
shape 2 3
periods 2.0 4.5
young_modulus 2.5
poisson_ratio 0.3
hardness 11.0
yield_stress 5.0
body bonded_layer
depth 0.75
loads 4
0.5
4.0
1.5
2.5
"""


@pytest.mark.filterwarnings("ignore::epcontact.SurfaceWarning")
def test_a_command_gets_the_whole_scene_and_gives_each_field_its_place(
    tmp_path, monkeypatch
):
    """A program gets SCENE_TEXT and the heights, and its result has each field at its
    points.

    A terminal that cannot be written to does no harm.
    """
    heights = np.array([[0.0, 0.5, -1.25], [3.0, 1e-9, 1 / 3]])
    metal = Material(2.5, 0.3, 11.0, 5.0)
    surface = Surface(heights, (2.0, 4.5))
    body = Body("bonded_layer", 0.75)
    scene = Scene(surface, metal, Load((0.5, 4.0, 1.5, 2.5)), body)
    head, *rest = foreign.scene_text(scene).partition("heights\n")
    assert head == SCENE_TEXT
    assert [*map(float, rest[1].split())] == [*heights.flat]
    fields = "gap {} residual 1D-3 displacement {} converged 1 pressure {}"
    texts = (" ".join(map(repr, (heights + k).ravel().tolist())) for k in range(3))
    (tmp_path / "made").write_text(f"epcontact-result 1 {fields.format(*texts)}")
    full_disk = Mock(write=Mock(side_effect=OSError))
    monkeypatch.setattr(sys, "stderr", full_disk)
    words = ["sh", "-c", f"echo said >&2; cp '{tmp_path}/made' {{result}}"]
    read = foreign.answer_of_command(words, scene)
    assert read.method == "sh"
    assert tuple(step.mean_pressure for step in read.steps) == scene.load.path
    for k, name in enumerate(("gap", "displacement", "pressure")):
        np.testing.assert_array_equal(read.fields[name], heights + k)


@pytest.mark.usefixtures("in_one_worker")
def test_solver_in_c(scene, tmp_path):
    """The example in C, full_contact.c, solves a wave pressed flat to 1e-12, and
    reports a load at which it has not converged.
    """
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    program = tmp_path / "full_contact"
    source = Path(__file__).with_name("full_contact.c")
    subprocess.run([compiler, "-O2", "-o", program, source, "-lm"], check=True)
    command = f"{program} {{scene}} {{result}}"
    found = foreign.solve("c", command, scene)
    exact = hostile.full_contact(scene).fields["pressure"]
    np.testing.assert_allclose(found.fields["pressure"], exact, rtol=1e-12)
    assert found.final.areas["corrected"].total == 1
    with pytest.raises(InvalidCase, match="a result that has not converged"):
        foreign.solve("c", command, replace(scene, load=Load(1e6)))


# --- what is refused before anything is solved ----------------------------------------


@pytest.mark.usefixtures("in_one_worker")
@pytest.mark.parametrize(
    ("solver", "changes", "sentence"),
    [
        (
            "no-such-program {scene} {result}",
            (),
            "there is no program 'no-such-program'",
        ),
        ("cat {scene}", (), "{scene} and {result} once each"),
        ("mine=hostile:absent", (), "cannot be imported (AttributeError"),
        ("mine=hostile", (), "MODULE:FUNCTION"),
        ("tamas", (), "did you mean 'tamaas'"),
        ("bem=my_solver:solve", (), "there is a method 'bem' already"),
        ("my/solver=my_solver:solve", (), "no name for a method"),
        (
            "hostile:full_contact",
            THEORY,
            "_contact would judge nothing: it takes the place of bem",
        ),
        (
            "",
            (("[[gate]]", f"{GATE}\n[[gate]]"),),
            "there are 2 gates area.total.corrected of bem",
        ),
        (
            "",
            (("[[gate]]", f'{GATE}[[gate]]\nsizes = ["large"]'),),
            "size 'large', which the case",
        ),
        ("", ((SURFACE, WAVE),), "which takes that of the heights"),
    ],
)
def test_what_cannot_be_judged_is_refused_before_anything_is_solved(
    write_case, tmp_path, solver, changes, sentence
):
    """`verify` raises InvalidCase with `sentence`, and writes nothing.

    `solver` is that of the command line, "" for none, and `changes` are replacements in
    SMALL_CASE.
    """
    with pytest.raises(InvalidCase) as refused:
        verify(write_case(*changes), solver=solver, output=tmp_path / "out")
    assert sentence in str(refused.value)
    assert not (tmp_path / "out").exists()
