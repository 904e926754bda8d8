"""Cases solved on the workers of any executor."""

import importlib
import os
import pickle
import shutil
import signal
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from multiprocessing import get_all_start_methods
from pathlib import Path
from typing import Any

import pytest

from epcontact import verify
from epcontact.errors import EpcontactError, InvalidCase
from epcontact.harness.case_files.case import load_case
from epcontact.harness.cluster import dask
from epcontact.harness.solving import run, saved, tasks
from epcontact.harness.solving.run import run_cases
from epcontact.harness.solving.tasks import Run, tasks_of
from epcontact.harness.workers import executor_from
from epcontact.results import package_versions

ONE = ("seeds = [3, 5, 7]", "seeds = [3]")
THEORY = (
    ('methods = ["persson", "bem"]', 'methods = ["persson"]'),
    (
        'of = "bem"\nagainst = "persson"',
        'of = "persson"\nagainst = 0.1\nsource = "made"',
    ),
)


class Elsewhere(Executor):
    """An executor that calls at once, on pickled copies, in a folder, as a far worker
    would.

    `worker_memory` is in bytes, `open` is False after a shutdown, and `instead`
    replaces each call if it is given.
    """

    worker_memory = 2.0**40
    open = True
    instead = None

    def __init__(self, folder, **changes):
        """Create the executor; `changes` replace attributes or methods of it."""
        vars(self).update(changes, folder=folder)

    def submit(self, fn, /, *args, **kwargs):
        """Return a finished `Future` of the call, with its result or its exception."""
        future: Future[Any] = Future()
        here = Path.cwd()
        self.folder.mkdir(exist_ok=True)
        os.chdir(self.folder)
        try:
            call, given = pickle.loads(pickle.dumps((fn, args)))
            found = (self.instead or call)(*given, **kwargs)
            future.set_result(pickle.loads(pickle.dumps(found)))
        except Exception as error:
            future.set_exception(error)
        finally:
            os.chdir(here)
        return future

    def shutdown(self, wait=True, *, cancel_futures=False):
        """Record that the executor is closed."""
        self.open = False


def refusing(sentence):
    """Return a function that raises RuntimeError with a sentence, whatever its
    arguments.
    """

    def call(*_, **__):
        """Raise the RuntimeError."""
        raise RuntimeError(sentence)

    return call


def test_a_worker_writes_fields_and_steps_and_sends_back_results(
    write_case, tmp_path, monkeypatch
):
    """A far worker writes the files that a local solve writes, to the byte but for
    costs.
    """
    monkeypatch.chdir(tmp_path)
    case = load_case(write_case(ONE))
    far = Elsewhere(tmp_path / "far")
    run_cases([case], Run("here", 1, fields="steps"))
    run_cases([case], Run("there", fields="steps", executor=lambda: far))
    assert not far.open
    assert not list(far.folder.iterdir())  # what it writes is in the sender's folder
    found = {p.relative_to("here"): p for p in Path("here").rglob("*") if p.is_file()}
    assert {
        p.relative_to("there") for p in Path("there").rglob("*") if p.is_file()
    } == set(found)
    assert {path.suffix for path in found} == {".json", ".vti", ".pvd"}
    for name, path in found.items():
        if path.suffix != ".json":  # costs differ
            assert path.read_bytes() == (Path("there") / name).read_bytes(), name
    again = run_cases([case], Run("there", 1, fields="steps"))
    assert [answer.reused for answer in again["small"].values()] == [1, 1]


def test_a_result_rests_on_sources_and_versions(write_case, tmp_path, monkeypatch):
    """A change of a solver's source or of a library's version makes saved results
    invalid.

    A change of the report does not.
    """
    package = Path(saved.__file__).parents[2]
    for folder in (package, package.parent / "fem_check"):
        shutil.copytree(
            folder, tmp_path / folder.name, ignore=lambda *_: ["__pycache__"]
        )
    copy = tmp_path / package.name
    before = saved.sources_digest(copy)
    assert before == saved.sources_digest()
    for name, same in (
        ("bem/inner/cg.py", False),
        ("../fem_check/plasticity.py", False),
        ("scene.py", False),
        ("interface/percolation.py", False),
        ("winkler.py", False),
        ("harness/quantities/registry.py", False),
        ("output/report.py", True),
    ):
        with (copy / name).open("a") as file:  # a method of one's own is a new file
            file.write("\n# changed\n")
        saved.sources_digest.cache_clear()
        after = before
        before = saved.sources_digest(copy)
        assert (before == after) == same, name
    task = next(tasks_of(load_case(write_case()), Run()))
    key = saved.key_of(task)
    monkeypatch.setattr(
        saved, "package_versions", lambda: package_versions() | {"numba": "0.0"}
    )
    assert saved.key_of(task) != key


@pytest.mark.parametrize(
    ("worker", "sentence"),
    [
        (
            {"worker_memory": 2.0**20},
            "needs about 0.3 GiB, but the largest worker has 0.0 GiB",
        ),
        (
            {"instead": refusing("no number")},
            "its worker failed: RuntimeError: no number",
        ),
        (
            {"instead": lambda *_: 42},
            "the executor returned 42, not what the task returns",
        ),
        (ThreadPoolExecutor, "time_limit in [case], 1e-06 s of"),  # a process keeps it
        ({}, "in the place of 1.0; install the same there"),
    ],
)
def test_failure_of_a_worker_is_its_tasks_error(
    write_case, tmp_path, monkeypatch, worker, sentence
):
    """Too little memory, an error, a wrong result, a time limit or other versions of a
    worker are errors of the gate.

    `worker` holds changes of `Elsewhere` or another class of executor, and `sentence`
    is a part of the error.
    """
    far = (
        Elsewhere(tmp_path / "far", **worker) if isinstance(worker, dict) else worker(1)
    )
    limit = ("[case]\n", "[case]\ntime_limit = 1e-6\n")
    path = write_case(*THEORY, *([limit] if worker is ThreadPoolExecutor else []))
    if not worker:
        mine = saved.software_versions()
        here_and_there = iter([mine | {"numpy": "1.0"}, mine])
        monkeypatch.setattr(run, "software_versions", lambda: next(here_and_there))
    verdict = verify(path, output=tmp_path, executor=lambda: far)
    assert verdict.exit_code == 2
    assert sentence in str(verdict.cases[0].gates[0].error)


def test_a_worker_that_cannot_write_fields_says_so(write_case, tmp_path):
    """A worker that does not see the output folder returns an error that names the
    folder.
    """
    *_, task = tasks_of(load_case(write_case()), Run(tmp_path / "absent", fields="all"))
    found = run.solve_on_worker(task, saved.software_versions(), jobs=1)
    assert f"does not see the folder {task.fields_file.parent}" in str(found)


@pytest.mark.parametrize(
    ("changes", "error", "sentence"),
    [
        (
            {"worker_memory": "lots"},
            InvalidCase,
            "worker_memory is 'lots', but must be in bytes",
        ),
        (
            {"shutdown": refusing("gone")},
            EpcontactError,
            "does not end: RuntimeError: gone",
        ),
        (
            {"submit": refusing("full")},
            EpcontactError,
            "takes no task: RuntimeError: full",
        ),
    ],
)
def test_failure_of_an_executor_is_one_sentence(
    write_case, tmp_path, changes, error, sentence
):
    """A failure of the executor itself raises an error of the package.

    `changes` are those of `Elsewhere`, and `sentence` is a part of the message.
    """
    far = Elsewhere(tmp_path / "far", **changes)
    with pytest.raises(error, match=sentence):
        verify(write_case(*THEORY), output=tmp_path, executor=lambda: far)
    assert far.open == ("shutdown" in changes)


@pytest.mark.parametrize(("free", "jobs"), [(1e12, 4), (2.2e9, 3), (1e8, 1)])
def test_no_more_processes_than_fit_into_memory(write_case, monkeypatch, free, jobs):
    """The number of `jobs` (processes) is what `free` bytes of memory allow, at least
    1.
    """
    grid = (
        "points_per_shortest_wavelength = { fast = 4, full = 8 }",
        "shape = [4096, 2048]",
    )
    solves = [*tasks_of(load_case(write_case(grid)), Run())]
    monkeypatch.setattr(tasks, "available_memory", lambda: free)
    # 2^28 bytes, and a point of a light contact that flows takes 50 and some more.
    assert 0.68e9 < max(task.memory for task in solves) < 0.72e9
    assert Run(jobs=4).jobs_for(solves) == jobs


@pytest.mark.parametrize(
    ("given", "threads"), [("3", 1), ("7", 3), ("", 3), ("4,2", 3)]
)
def test_a_workers_cores_are_its_own(write_case, tmp_path, monkeypatch, given, threads):
    """A solve on one of two workers uses half of 6 cores, or fewer if OMP_NUM_THREADS
    says so.

    `given` is the value of OMP_NUM_THREADS, and `threads` the expected number.
    """
    monkeypatch.setattr(run, "available_cores", lambda: 6)
    monkeypatch.setenv("OMP_NUM_THREADS", given)
    found: list[int] = []

    def solve_task(task, threads):
        """Record the number of threads, and return a word in place of a result."""
        found.append(threads)
        return "none"

    monkeypatch.setattr(run, "solve_task", solve_task)
    task = next(tasks_of(load_case(write_case(*THEORY)), Run()))
    assert run.solve_on_worker(task, saved.software_versions(), jobs=2) == "none"
    assert found == [threads]


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("no_such_module:pool", "cannot be made .* give module:function"),
        ("concurrent.futures:Nothing", "cannot be made"),
        ("sys:exit", "cannot be made .SystemExit"),
        ("os:getpid", "is .*, not a concurrent.futures.Executor"),
        (
            "epcontact.harness.cluster:dask",
            "DASK_SCHEDULER_ADDRESS is not set|is not installed",
        ),
    ],
)
def test_executor_that_cannot_be_made_is_one_sentence(monkeypatch, name, sentence):
    """A name that gives no executor raises `InvalidCase`.

    `name` is module:function, and `sentence` is a pattern of the message.
    """
    monkeypatch.delenv("DASK_SCHEDULER_ADDRESS", raising=False)
    with pytest.raises(InvalidCase, match=sentence):
        executor_from(name)


@pytest.mark.slow
def test_tasks_of_a_killed_dask_worker_are_done_again(
    write_case, tmp_path, monkeypatch
):
    """A Dask worker that is killed changes no verdict: its tasks are solved again."""
    distributed = pytest.importorskip("distributed")
    dask_config = importlib.import_module("dask.config")
    # A server imports Dask once for all workers that it forks, also for one that starts
    # again.
    method = {"distributed.worker.multiprocessing-method": get_all_start_methods()[-1]}
    path = write_case(("seeds = [3, 5, 7]", "seeds = [1, 2, 3, 4, 5, 6, 7, 8]"))
    plain = verify(path, output=tmp_path / "plain", jobs=1)
    killed: list[int] = []

    def kill(done, *_):
        """Kill the first worker after the first result; `done` counts results."""
        if done and not killed:
            killed.append(next(iter(local.workers.values())).pid)
            os.kill(killed[0], signal.SIGKILL)

    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": ":0"}
    with dask_config.set(method), distributed.LocalCluster(**options) as local:
        monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", local.scheduler_address)
        verdict = verify(path, output=tmp_path / "dask", executor=dask, progress=kill)
    assert killed
    (ours,), (theirs,) = plain.cases, verdict.cases
    assert theirs.status == ours.status == "holds"
    assert [g.model_dump() for g in theirs.gates] == [
        g.model_dump() for g in ours.gates
    ]
    assert [m.errors for m in theirs.methods.values()] == [[], []]
    assert theirs.methods["bem"].surfaces == 8
