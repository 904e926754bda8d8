"""The package as a whole: licence, types, libraries, and the paper's equations in it."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from itertools import chain
from pathlib import Path

import pytest

import epcontact
from epcontact import bem

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
SOURCES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for package in ("epcontact", "fem_check")
    for path in sorted((ROOT / package).rglob("*.py"))
}


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
    imported = set()
    for node in (node for source in SOURCES.values() for node in ast.walk(ast.parse(source))):
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


def homes(phrase: str) -> list[tuple[str, str]]:
    """File and name of each function or class with the phrase atop its docstring (three lines)."""
    return [
        (path, node.name)
        for path, source in SOURCES.items()
        if phrase in source
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
        and phrase in "\n".join((ast.get_docstring(node) or "").splitlines()[:3])
    ]


EQUATIONS = [
    ("persson/series.py", "one_wall_density"),
    ("persson/reduction.py", "full_contact_diffusion"),
    ("persson/elastoplastic.py", "pressure_density"),
    ("persson/elastoplastic.py", "_elastic_area"),
    ("persson/elastoplastic.py", "_plastic_area"),
    ("reference/roughness.py", "light_load_area"),
    ("surfaces/self_affine.py", "_fill_modes"),
    ("surfaces/self_affine.py", "_fill_modes"),
]


@pytest.mark.parametrize(("number", "home"), list(enumerate(EQUATIONS, start=1)))
def test_an_equation_has_one_home(number: int, home: tuple[str, str]) -> None:
    """The function with the formula cites its number; no other text in the product does."""
    assert homes(f"equation ({number}) of the paper") == [(f"epcontact/{home[0]}", home[1])]
    assert sum(source.count(f"equation ({number})") for source in SOURCES.values()) == 1


def test_the_prefactor_of_equation_2_is_written_once() -> None:
    """E*^2/8 times a slope variance; `reference` has its own, against which gates hold it."""
    prefactor = re.compile(r"(?i)modul.*\*\* ?2\b.*/ 8\b|/ 8 \*.*modul.*\*\* ?2\b")
    found = [path for path, source in SOURCES.items() if prefactor.search(source)]
    assert found == ["epcontact/persson/reduction.py", "epcontact/reference/roughness.py"]


def test_figures_have_one_home_and_cases_of_the_paper_cite_its_table() -> None:
    for number in range(1, 6):
        assert len(homes(f"Figure {number} of the paper")) == 1
        assert (
            sum(source.count(f"Figure {number} of the paper") for source in SOURCES.values()) == 1
        )
    cases = [path.read_text(encoding="utf-8") for path in (ROOT / "cases").glob("paper-*.toml")]
    assert cases
    assert all("Almqvist and Persson, Table 1" in case for case in cases)
