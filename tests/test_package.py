"""The installed package has metadata, types, a licence, oldest versions and no broken link."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from itertools import chain
from pathlib import Path

import epcontact
from epcontact import bem

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_licence_and_types_are_inside_the_packages() -> None:
    assert all((ROOT / name / "py.typed").is_file() for name in ("epcontact", "fem_check"))
    (licence,) = PROJECT["license-files"]
    assert (ROOT / licence).read_text().startswith("MIT License")


def test_public_names_are_imported_when_they_are_asked_for() -> None:
    code = (
        "import sys, epcontact; epcontact.Load; print('pydantic' in sys.modules)\n"
        "import epcontact.bem.memory; print('numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]
    assert all(hasattr(bem, name) for name in bem.__all__)
    assert not hasattr(bem, "solved")
    assert all(hasattr(epcontact, name) for name in epcontact.__all__)
    assert not hasattr(epcontact, "Loads")


def test_oldest_versions_are_the_floors_of_the_requirements() -> None:
    done = subprocess.run(
        [sys.executable, ROOT / ".ci" / "oldest"], capture_output=True, text=True, check=True
    )
    needed = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["test"]]
    assert done.stdout.split() == [name.replace(">=", "==") for name in needed]


def test_the_libraries_that_are_imported_are_declared() -> None:
    files = [*ROOT.glob("epcontact/**/*.py"), *ROOT.glob("fem_check/**/*.py")]
    imported = set()
    for node in (node for file in files for node in ast.walk(ast.parse(file.read_text()))):
        if isinstance(node, ast.Import):
            imported |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            imported.add(node.module.partition(".")[0])
    homes = packages_distributions()
    own = {"epcontact", "fem_check"}
    foreign = {m for m in imported - own if m not in sys.stdlib_module_names and m in homes}
    needed = [*PROJECT["dependencies"], *chain(*PROJECT["optional-dependencies"].values())]
    declared = {name.partition(">=")[0].lower().replace("_", "-") for name in needed}
    # pyvista decides which vtk it works with, and pydantic which core of its own.
    declared |= {"vtk", "pydantic_core"}
    undeclared = {m for m in foreign if not {h.lower() for h in homes[m]} & declared}
    assert not undeclared
