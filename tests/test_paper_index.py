"""A reader of the paper finds each of its equations, its table and its figures by their number."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SOURCES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for package in ("epcontact", "fem_check")
    for path in sorted((ROOT / package).rglob("*.py"))
}


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
