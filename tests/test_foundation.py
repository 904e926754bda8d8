"""What kept results rest on: their own sources and libraries, no more and no less."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from test_house import MODULES
from test_house import imported as by_syntax

from epcontact.harness.answers import store
from epcontact.harness.answers.foundation import HOME, foundation, imported
from epcontact.harness.answers.store import Task, rests_on
from epcontact.harness.case_files.case import load_case
from epcontact.harness.methods.registry import METHODS
from epcontact.results import package_versions


def test_import_statements_are_read_as_the_compiler_reads_them() -> None:
    for name, tree in MODULES.items():
        path = HOME.joinpath(*name.split("."))
        file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        assert set(by_syntax(tree)) <= set(imported(file.read_text(encoding="utf-8"))), name


def task(case: str, method: str) -> Task:
    return Task(load_case(case), METHODS[method], 0, "single")


@pytest.mark.parametrize(
    ("case", "method", "changed", "kept"),
    [
        ("rough-capped", "bem", "epcontact/bem/inner/cells.py", False),
        ("rough-capped", "bem", "epcontact/bem/areas/front.py", False),
        ("rough-capped", "bem", "epcontact/surfaces/self_affine.py", False),
        ("rough-capped", "bem", "epcontact/harness/quantities/measurements.py", False),
        ("rough-capped", "bem", "epcontact/harness/answers/solve.py", False),
        ("rough-capped", "bem", "epcontact/harness/answers/run.py", True),
        ("rough-capped", "bem", "epcontact/output/report.py", True),
        ("rough-capped", "bem", "epcontact/cli/cases.py", True),
        ("rough-capped", "bem", "epcontact/persson/series.py", True),
        ("rough-capped", "bem", "epcontact/harness/gates/gate.py", True),
        ("rough-capped", "bem", "fem_check/plasticity.py", True),
        ("fem-model-5", "fem", "fem_check/plasticity.py", False),
        ("fem-model-5", "fem", "epcontact/bem/newton.py", False),  # measured against a cap
        ("fem-capped", "fem", "epcontact/bem/newton.py", True),
        ("theory-hard", "persson", "epcontact/persson/series.py", False),
        ("theory-hard", "persson", "epcontact/bem/newton.py", True),
    ],
)
def test_a_change_invalidates_the_results_that_rest_on_it(case, method, changed, kept) -> None:
    assert (HOME / changed).is_file()
    name = changed.removesuffix(".py").replace("/", ".")
    assert (name not in rests_on(task(case, method)).modules) == kept


def test_the_digest_is_that_of_the_files(tmp_path: Path) -> None:
    for package in ("epcontact", "fem_check"):
        shutil.copytree(HOME / package, tmp_path / package, ignore=lambda *_: ["__pycache__"])
    before = foundation(("epcontact.bem",), home=tmp_path)
    assert before == foundation(("epcontact.bem",))
    for name, same in (("epcontact/output/report.py", True), ("epcontact/bem/inner/cg.py", False)):
        with (tmp_path / name).open("a") as file:
            file.write("\n# changed\n")
        foundation.cache_clear()
        assert (foundation(("epcontact.bem",), home=tmp_path) == before) == same


@pytest.mark.parametrize(
    ("method", "library", "kept"),
    [
        ("bem", "numba", False),
        ("bem", "ducc0", False),
        ("bem", "scikit-fem", True),
        ("persson", "scipy", False),
        ("persson", "numba", True),
    ],
)
def test_another_version_of_a_library_invalidates_what_uses_it(
    write_case, monkeypatch, method, library, kept
) -> None:
    small = Task(load_case(write_case()), METHODS[method], 0, "single")
    before = store.key_of(small)
    monkeypatch.setattr(store, "package_versions", lambda: package_versions() | {library: "0.0"})
    assert (store.key_of(small) == before) == kept
