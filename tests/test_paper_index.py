"""A reader of the paper finds each of its equations, its table and its figures by their number."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SOURCES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for package in ("epcontact", "fem_check")
    for path in sorted((ROOT / package).rglob("*.py"))
}


def homes(phrase: str) -> Iterator[tuple[str, str]]:
    """File and name of each function or class with the phrase atop its docstring (three lines)."""
    for path, source in SOURCES.items():
        if phrase in source:
            for node in ast.walk(ast.parse(source)):
                if isinstance(node, ast.FunctionDef | ast.ClassDef):
                    head = (ast.get_docstring(node) or "").splitlines()[:3]
                    if any(phrase in line for line in head):
                        yield path, node.name


@pytest.mark.parametrize(
    ("number", "path", "function"),
    [
        (1, "epcontact/persson/series.py", "one_wall_density"),
        (2, "epcontact/persson/reduction.py", "full_contact_diffusion"),
        (3, "epcontact/persson/elastoplastic.py", "pressure_density"),
        (4, "epcontact/persson/elastoplastic.py", "_elastic_area"),
        (5, "epcontact/persson/elastoplastic.py", "_plastic_area"),
        (6, "epcontact/reference/roughness.py", "light_load_area"),
        (7, "epcontact/surfaces/self_affine.py", "_fill_modes"),
        (8, "epcontact/surfaces/self_affine.py", "_fill_modes"),
    ],
)
def test_an_equation_has_one_home(number: int, path: str, function: str) -> None:
    """The function with the formula cites its number; no other text in the product does."""
    assert list(homes(f"equation ({number}) of the paper")) == [(path, function)]
    assert sum(source.count(f"equation ({number})") for source in SOURCES.values()) == 1


def test_the_prefactor_of_equation_2_is_written_once() -> None:
    """E*^2/8 times a slope variance; `reference` has its own, against which gates hold it."""
    prefactor = re.compile(r"(?i)modul.*\*\* ?2\b.*/ 8\b|/ 8 \*.*modul.*\*\* ?2\b")
    found = [path for path, source in SOURCES.items() if prefactor.search(source)]
    assert found == ["epcontact/persson/reduction.py", "epcontact/reference/roughness.py"]


@pytest.mark.parametrize("number", range(1, 6))
def test_a_figure_has_one_home(number: int) -> None:
    assert len(list(homes(f"Figure {number} of the paper"))) == 1
    assert sum(source.count(f"Figure {number} of the paper") for source in SOURCES.values()) == 1


def test_every_case_of_the_paper_cites_its_table() -> None:
    cases = sorted((ROOT / "cases").glob("paper-*.toml"))
    assert cases
    for case in cases:
        assert "Almqvist and Persson, Table 1" in case.read_text(encoding="utf-8"), case.name
