"""The package as a whole: licence, types, libraries, and the paper's equations in
it.
"""

import ast
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from itertools import chain
from pathlib import Path

import pytest
from command_line import python

import epcontact
from epcontact import bem

ROOT = Path(__file__).parent.parent
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = PYPROJECT["project"]
SOURCES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for package in ("epcontact", "fem_check")
    for path in sorted((ROOT / package).rglob("*.py"))
}
NODES = [
    (path, node) for path, text in SOURCES.items() for node in ast.walk(ast.parse(text))
]


def test_licence_and_types_are_inside_and_public_names_are_imported_when_asked_for():
    """Both packages are typed and under the MIT licence.

    All public names exist, and a part of the package does not import libraries that
    only other parts need.
    """
    for name in ("epcontact", "fem_check"):
        assert (ROOT / name / "py.typed").is_file()
    assert (ROOT / PROJECT["license-files"][0]).read_text().startswith("MIT License")
    code = (
        "import sys, epcontact; epcontact.Load; print('pydantic' in sys.modules)\n"
        "import epcontact.bem.memory; print('numba' in sys.modules)"
    )
    assert python("-c", code).stdout.split() == ["False", "False"]
    for module in (epcontact, bem):
        assert all(hasattr(module, name) for name in module.__all__)
        assert not hasattr(module, "Loads")


def test_libraries_that_are_imported_are_declared_and_tested_at_their_floors():
    """All imported libraries are declared in pyproject.toml, and .ci/oldest prints the
    lowest version of each.
    """
    imported = set()
    for _, node in NODES:
        if isinstance(node, ast.Import):
            imported |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            imported.add(node.module.partition(".")[0])
    foreign = imported - {"epcontact", "fem_check"} - sys.stdlib_module_names
    extras = PROJECT["optional-dependencies"]
    distributions = packages_distributions()
    needed = [*PROJECT["dependencies"], *chain(*extras.values())]
    # pyvista decides which vtk it works with, and pydantic which core of its own.
    declared = {"vtk", "pydantic_core"} | {
        name.partition(">=")[0].lower().replace("_", "-") for name in needed
    }
    for module in foreign & distributions.keys():
        names = {name.lower() for name in distributions[module]}
        assert names & declared, module
    tested = (*PROJECT["dependencies"], *extras["test"])
    floors = [name.replace(">=", "==") for name in tested]
    assert python(ROOT / ".ci" / "oldest").stdout.split() == floors


#: The end of the file and the function that cite each equation of the paper.
HOMES = {
    "equation (1)": "persson/series.py elastic_density",
    "equation (2)": "persson/reduction.py full_contact_diffusion",
    "equation (3)": "persson/elastoplastic.py pressure_density",
    "equation (4)": "persson/elastoplastic.py _elastic_area",
    "equation (5)": "persson/elastoplastic.py _plastic_area",
    "equation (6)": "reference/roughness.py light_load_area",
    "equation (7)": "surfaces/self_affine.py _fill_modes",
    "equation (8)": "surfaces/self_affine.py _fill_modes",
} | {f"Figure {number}": "" for number in range(1, 6)}


@pytest.mark.parametrize(("number", "home"), HOMES.items())
def test_an_equation_has_one_home(number, home):
    """One docstring begins with an equation of the paper (`number`), and no other text
    cites it.

    `home` is the end of its file and the function, or "" for a figure.
    """
    citation = f"{number} of the paper"
    homes = []
    for path, node in NODES:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            opening = " ".join((ast.get_docstring(node) or "")[:300].split())
            if citation in opening:
                homes.append(f"{path} {node.name}")
    assert len(homes) == 1
    assert homes[0].endswith(home)
    # Figures are counted with their source, because other works have figures, too.
    counted = number if home else citation
    texts = [" ".join(source.split()) for source in SOURCES.values()]
    assert sum(text.count(counted) for text in texts) == 1


def test_the_page_of_the_package_index_has_no_link_into_the_checkout():
    """All links of the readme lead to https:// after the substitutions for the package
    index.
    """
    hook = PYPROJECT["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]
    page = (ROOT / "README.md").read_text(encoding="utf-8")
    for rule in hook["substitutions"]:
        page = re.sub(rule["pattern"], rule["replacement"], page)
    targets = re.findall(r"\]\(([^)]+)\)", page)
    assert len(targets) > 5
    assert all(target.startswith("https://") for target in targets)
