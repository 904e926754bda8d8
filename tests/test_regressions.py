"""Mistakes that users met, each kept from coming back."""

import os
import signal
import subprocess
import sys
import time

import pytest
from command_line import python
from numba.core import event

from epcontact import machine
from epcontact.errors import InvalidCase, NotConverged
from epcontact.harness.case_files.case import load_case
from epcontact.harness.solving import run
from epcontact.harness.solving.measure import MEASURING
from epcontact.harness.solving.method_results import MethodResults
from epcontact.harness.solving.run import run_cases
from epcontact.harness.solving.tasks import Run
from epcontact.harness.verdict.judgement import judge_case
from epcontact.harness.verdict.verification import verify

ONE = ("seeds = [3, 5, 7]", "seeds = [3]")


def is_reused(path, output, **options):
    """Verify the case at `path` and return whether the saved result of the boundary
    elements was reused.

    `options` are those of `verify`.
    """
    notes: list[str] = []
    verify(
        path,
        output=output,
        jobs=1,
        progress=lambda *told: notes.append(told[-1]),
        **options,
    )
    return any("(reused)" in words for words in notes if words and "bem" in words)


def test_every_change_of_a_case_or_a_solver_is_solved_again(write_case, tmp_path):
    """A saved result is reused for the same case only: any change of a number, of the
    tolerance or of the solver solves the case again.
    """
    assert [is_reused(write_case(ONE), tmp_path) for _ in range(2)] == [False, True]
    for change in (
        ("mean_pressure = 5.0e8", "mean_pressure = 5.0000001e8"),
        ("mean_pressure = 5.0e8", "mean_pressure = [4.0e8, 5.0e8]"),
        ("poisson_ratio = 0.3", "poisson_ratio = 0.31"),
        ("rms_slope = 0.1", "rms_slope = 0.1000001"),
        ("period = 1.0e-3", "period = [1.0e-3, 2.0e-3]"),
        ("[load]", "[bem]\ntolerance = 1e-7\n\n[load]"),
    ):
        assert not is_reused(write_case(ONE, change), tmp_path), change
    solver = "bem_of_mine=epcontact.bem:solve"
    for _ in range(2):  # a user's solver may change, and is not reused in a second run
        assert not is_reused(write_case(ONE), tmp_path, solver=solver)
    assert not is_reused(write_case(ONE), tmp_path)


def test_two_cases_of_one_id_are_refused(write_case, tmp_path):
    """Two case files with one id raise InvalidCase before anything is written."""
    (tmp_path / "other").mkdir()
    second = load_case(write_case().rename(tmp_path / "other" / "small.toml"))
    with pytest.raises(InvalidCase, match="folders of their own"):
        run_cases([load_case(write_case()), second], Run(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_one_reason_is_said_once_however_many_surfaces_have_it(write_case):
    """An error that 60 surfaces share is reported once, with the first surface and the
    number of the others.
    """
    case = load_case(write_case())
    errors = tuple(f"bem, seed{i}: a worker process died" for i in range(60))
    outcome = judge_case(
        case, {"persson": MethodResults(), "bem": MethodResults(errors=errors)}
    )
    assert outcome.gates[0].error == "bem, seed0 and 59 more: a worker process died"


@pytest.mark.parametrize(
    "module", ["epcontact.bem.level", "epcontact.harness.methods.registry"]
)
def test_kernels_compile_where_nothing_can_be_written(module, tmp_path):
    """If the cache of kernels cannot be written, kernels are compiled in a temporary
    folder that is deleted at the end of the process.

    `module` is imported in a new process.
    """
    program = """
import importlib, os, sys
from pathlib import Path
from numba.core import caching
kinds = caching.CompileResultCacheImpl
kinds._locator_classes = kinds._locator_classes[:1]  # the named folder only
importlib.import_module(sys.argv[1])
print(os.environ["NUMBA_CACHE_DIR"])
assert Path(os.environ["NUMBA_CACHE_DIR"]).is_dir()
"""
    (tmp_path / "file").touch()
    environment = {
        "TMPDIR": str(tmp_path),
        "NUMBA_CACHE_DIR": str(tmp_path / "file" / "kernels"),
    }
    command = [sys.executable, "-c", program, module]
    environment = os.environ | environment
    done = subprocess.run(
        command, check=True, capture_output=True, text=True, env=environment
    )
    assert done.stdout.startswith(str(tmp_path / "epcontact-kernels-"))
    assert [path.name for path in tmp_path.iterdir()] == [
        "file"
    ]  # gone with the process


def test_a_damaged_kernel_is_made_anew_and_no_number_of_threads_is_ignored(tmp_path):
    """Damaged files of the kernel cache are compiled again, and an empty
    OMP_NUM_THREADS is no error.

    Numba alone would raise UnpicklingError at every start, and ducc0 an assertion of
    C++.
    """
    program = (
        "from epcontact.machine import provide_kernel_cache as p; p()\n"
        "from fem_check import kernel; import ducc0, numpy\n"
        "ducc0.fft.c2c(numpy.ones(4), nthreads=0)\nprint(kernel.one(2))"
    )
    (tmp_path / "fem_check").mkdir()
    (tmp_path / "fem_check" / "__init__.py").touch()
    text = "from numba import njit\n@njit(cache=True)\ndef one(x):\n    return x + 1\n"
    (tmp_path / "fem_check" / "kernel.py").write_text(text)
    kernels = tmp_path / "kernels"
    settings = {
        "NUMBA_CACHE_DIR": str(kernels),
        "PYTHONPATH": str(tmp_path),
        "OMP_NUM_THREADS": "",
    }
    for end in ("", "nbi", "nbc"):
        for path in kernels.rglob(f"*.{end}") if end else ():
            path.write_bytes(b"spoilt")
        done = python("-c", program, cwd=tmp_path, env=os.environ | settings)
        assert done.returncode == 0
        assert done.stdout == "3\n"
        assert "compiles kernels" in done.stderr


def compute_for(seconds):
    """Use the processor for some seconds of its time."""
    end = time.process_time() + seconds
    while time.process_time() < end:
        sum(range(1000))


def test_the_time_limit_counts_processor_time_of_solving(monkeypatch):
    """Waiting does not count against a time limit of 0.3 s, nor does measuring; many
    times the limit by the clock does. Two threads have twice the processor time, and
    that of a child process counts.
    """
    program = "import time\nwhile time.process_time() < 20: pass"
    monkeypatch.setattr(run, "_PATIENCE", 1000)  # a busy machine is slow by the clock
    with run._time_limit(0.3):
        time.sleep(0.7)
        with MEASURING:
            compute_for(0.7)
        compute_for(0.15)
    with run._time_limit(0.3, threads=2):
        compute_for(0.4)
    with pytest.raises(run.TimeUp), run._time_limit(0.3):
        subprocess.run([sys.executable, "-c", program], timeout=120, check=False)
    monkeypatch.setattr(run, "_PATIENCE", 1)
    with pytest.raises(run.TimeUp), run._time_limit(0.3):
        time.sleep(20)


def test_time_limit_leaves_the_compilation_of_kernels_out():
    """The seconds that numba compiles do not count against the time limit of a solve,
    here 0.3 s.
    """
    machine.provide_kernel_cache()
    before = machine.compile_seconds()
    with run._time_limit(0.3), event.trigger_event("numba:compiler_lock"):
        time.sleep(0.7)  # as long as two alarms and more
    assert (taken := machine.compile_seconds() - before) >= 0.7
    with pytest.raises(run.TimeUp, match="time_limit"), run._time_limit(0.3):
        compute_for(20)
    assert not issubclass(
        run.TimeUp, NotConverged
    )  # after which elements try smaller steps
    assert machine.compile_seconds() - before == taken


KERNELS = """
import signal
from epcontact.machine import compiling, provide_kernel_cache
provide_kernel_cache()
from numba import njit
from fem_check import inner

@njit(cache=True)
def outer(x):
    return inner.twice(x) + 1

seen = []
signal.signal(signal.SIGALRM, lambda *_: seen.append(compiling()))
signal.setitimer(signal.ITIMER_REAL, 0.005, 0.005)
print(outer(3), outer(3.0), sum(outer.stats.cache_misses.values()), any(seen))
"""


@pytest.mark.skipif(
    not hasattr(signal, "SIGALRM"), reason="needs alarms and locks of files"
)
def test_processes_compile_in_turns_and_whatever_signals_come(tmp_path):
    """Two processes that need one kernel compile it once, in spite of alarms every 5
    ms, and again after its source has changed.

    Each process prints two results, its number of compilations, and whether an alarm
    came while it compiled.
    """
    # Numba alone loses a kernel to a signal that comes while LLVM runs, compiles the
    # first one in every process, and does not see that the source of a kernel inside
    # has changed.
    package = tmp_path / "fem_check"  # the kernels of other packages are left to numba
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "outer.py").write_text(KERNELS)
    folders = {
        "NUMBA_CACHE_DIR": str(tmp_path / "kernels"),
        "PYTHONPATH": str(tmp_path),
    }
    command = [sys.executable, "-B", "-c", "import fem_check.outer"]
    for factor in (2, 5):
        inner = f"def twice(x):\n    return {factor} * x\n"
        (package / "inner.py").write_text(
            f"from numba import njit\n@njit(cache=True)\n{inner}"
        )
        running = [
            subprocess.Popen(
                command, cwd=tmp_path, stdout=subprocess.PIPE, env=os.environ | folders
            )
            for _ in range(2)
        ]
        outputs = [process.communicate(timeout=900)[0].split() for process in running]
        for of_integer, of_real, _, saw_alarm in outputs:
            assert int(of_integer) == 3 * factor + 1
            assert float(of_real) == 3 * factor + 1
            assert saw_alarm == b"True"
        assert sum(int(misses) for _, _, misses, _ in outputs) in (2, 3)
