"""Mistakes that users met, each kept from coming back."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from numba.core import event

from epcontact import machine
from epcontact.errors import InvalidCase, NotConverged
from epcontact.harness.answers import run
from epcontact.harness.answers.run import Progress, Run, run_cases
from epcontact.harness.answers.store import Answer
from epcontact.harness.case_files.case import load_case
from epcontact.harness.verdict.judgement import judge_case
from epcontact.harness.verdict.verification import verify

ONE = ("seeds = [3, 5, 7]", "seeds = [3]")
LOAD = "mean_pressure = 5.0e8"


def noting(notes: list[bool]) -> Progress:
    """A callback that notes of each task whether a kept result was used again."""
    return lambda done, total, words: notes.append("(reused)" in words) if words else None


def answer(path: Path, output: Path, **options: Any):
    """The boundary elements' answer, and which of its tasks were reused."""
    case, notes = load_case(path).changed(methods=("bem",)), []
    answers = run_cases([case], Run(output, 1, progress=noting(notes), **options))
    return answers[case.id]["bem"].results[0], notes


def test_results_of_the_users_solver_do_not_pass_for_the_packages(write_case, tmp_path) -> None:
    for _ in range(2):  # the second run has to solve again, too
        notes: list[bool] = []
        verify(
            write_case(ONE), output=tmp_path, solver="bem_of_mine=faults:honest", jobs=1,
            progress=noting(notes),
        )  # fmt: skip
        assert not notes[-1]
    assert answer(write_case(ONE), tmp_path)[1] == [False]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (LOAD, "mean_pressure = 5.0000001e8"),
        (LOAD, "mean_pressure = [4.0e8, 5.0e8]"),
        ("poisson_ratio = 0.3", "poisson_ratio = 0.31"),
        ("hardness = 6.0e9", "hardness = 6.0e9\nyield_stress = 1.0e12"),
        ("rms_slope = 0.1", "rms_slope = 0.1000001"),
        ("period = 1.0e-3", "period = [1.0e-3, 2.0e-3]"),
        ("[load]", '[body]\nkind = "bonded_layer"\ndepth = 1.0e-4\n\n[load]'),
        ("[load]", "[bem]\ntolerance = 1e-7\n\n[load]"),
    ],
)
def test_every_change_of_a_case_is_solved_again(write_case, tmp_path, old, new) -> None:
    answer(write_case(ONE), tmp_path)
    assert answer(write_case(ONE), tmp_path)[1] == [True]
    assert answer(write_case(ONE, (old, new)), tmp_path)[1] == [False]


def test_two_cases_of_one_id_are_refused(write_case, tmp_path) -> None:
    first = load_case(write_case(ONE))
    (tmp_path / "other").mkdir()
    second = load_case(write_case(ONE).rename(tmp_path / "other" / "small.toml"))
    with pytest.raises(InvalidCase, match="folders of their own"):
        run_cases([first, second], Run(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_one_reason_is_said_once_however_many_surfaces_have_it(write_case) -> None:
    case = load_case(write_case())
    errors = tuple(f"bem, seed{i}: a worker process died" for i in range(60))
    outcome = judge_case(case, {"persson": Answer(), "bem": Answer(errors=errors)})
    assert outcome.gates[0].error == "bem, seed0 and 59 more: a worker process died"


def test_kernels_compile_where_nothing_can_be_written(tmp_path) -> None:
    program = """
import os
from pathlib import Path
from numba.core import caching
kinds = caching.CompileResultCacheImpl
kinds._locator_classes = kinds._locator_classes[:1]  # the named folder only
from epcontact.bem import level
print(os.environ["NUMBA_CACHE_DIR"])
assert Path(os.environ["NUMBA_CACHE_DIR"]).is_dir()
"""
    inherited = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    (tmp_path / "file").touch()
    for named in ({}, {"NUMBA_CACHE_DIR": str(tmp_path / "file" / "kernels")}):
        done = subprocess.run(
            [sys.executable, "-c", program], check=False, capture_output=True, text=True,
            timeout=120, env=inherited | {"TMPDIR": str(tmp_path)} | named,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith(str(tmp_path / "epcontact-kernels-"))
        assert [path.name for path in tmp_path.iterdir()] == ["file"]  # gone with the process


def test_time_limit_leaves_the_compilation_of_kernels_out() -> None:
    machine.provide_kernel_cache()
    before = machine.compile_seconds()
    with run._limited(0.3), event.trigger_event("numba:compiler_lock"):
        time.sleep(0.7)  # as long as two alarms and more
    taken = machine.compile_seconds() - before
    assert taken >= 0.7
    with pytest.raises(NotConverged, match="time limit"), run._limited(0.3):
        time.sleep(20)
    assert machine.compile_seconds() - before == taken


KERNELS = """
import signal, sys
from epcontact.machine import provide_kernel_cache, compiling, compile_seconds
provide_kernel_cache()
from numba import njit
from fem_check import inner

@njit(cache=True)
def outer(x):
    return inner.twice(x) + 1

class Alarm(Exception):
    pass

def alarm(*_):
    global seen, armed
    seen += compiling()
    if armed and not compiling():
        armed = False
        raise Alarm

seen, found, armed = 0, [], False
signal.signal(signal.SIGALRM, alarm)
signal.setitimer(signal.ITIMER_REAL, 0.001, 0.001)
while len(found) < 2:
    try:
        armed = True
        found.append(outer((3, 3.0)[len(found)]))
        armed = False
    except Alarm:
        pass
signal.setitimer(signal.ITIMER_REAL, 0)
print(found, sum(outer.stats.cache_misses.values()), sum(outer.stats.cache_hits.values()), seen > 0)
"""
INNER = "from numba import njit\n@njit(cache=True)\ndef twice(x):\n    return 2 * x\n"


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="needs alarms and locks of files")
def test_processes_compile_in_turns_and_whatever_signals_come(tmp_path) -> None:
    # Numba alone loses a kernel to a signal that comes while LLVM runs, compiles the first one in
    # every process, and does not see that the source of a kernel inside has changed.
    package = tmp_path / "fem_check"  # the kernels of other packages are left to numba
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "outer.py").write_text(KERNELS)
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    for factor in (2, 5):
        (package / "inner.py").write_text(INNER.replace("2 *", f"{factor} *"))
        running = [
            subprocess.Popen(
                [sys.executable, "-B", "-c", "import fem_check.outer"],
                cwd=tmp_path, stdout=subprocess.PIPE, text=True,
                env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kernels"), "PYTHONPATH": path},
            )
            for _ in range(2)
        ]  # fmt: skip
        said = [process.communicate(timeout=120)[0].splitlines()[-1] for process in running]
        figures = [line.rsplit(maxsplit=3) for line in said]
        assert [found for found, *_ in figures] == [f"[{3 * factor + 1}, {3 * factor + 1}.0]"] * 2
        assert all(int(misses) + int(hits) == 2 for _, misses, hits, _ in figures)
        assert sum(int(misses) for _, misses, _, _ in figures) in (2, 3)
        assert all(seen == "True" for *_, seen in figures)


def test_broken_case_is_collected_as_its_sentence(write_case) -> None:
    folder = write_case(("hurst", "hurts")).parent
    (folder / "pytest.ini").write_text("[pytest]\nepcontact_cases = *.toml\n")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "epcontact.harness.pytest_plugin"]
    done = subprocess.run([*command, folder], capture_output=True, text=True, check=False)
    assert "did you mean 'hurst'" in done.stdout
    assert "Traceback" not in done.stdout
