"""fem_check can disagree with epcontact only while they share nothing but the scene."""

import ast
import subprocess
import sys
from pathlib import Path

import fem_check

#: The scene, the form of results, facts of the machine, files and the progress bar of
#: notebooks: no mathematics.
ALLOWED = {
    "epcontact.scene",
    "epcontact.results",
    "epcontact.errors",
    "epcontact.machine",
    "epcontact.files",
    "epcontact.notebook",
}
PACKAGE = Path(fem_check.__file__).parent
SOURCES = sorted(PACKAGE.glob("**/*.py"))
SOLVE = """
import sys
import fem_check, numpy as np
from epcontact.scene import Load, Material, Scene, Surface
x = np.cos(2 * np.pi * np.arange(8) / 8) * 0.01
scene = Scene(Surface(x, (1.0,)), Material(1.0, 0.3, yield_stress=0.01), Load(0.002))
fem_check.solve(scene)
print(sorted(m for m in sys.modules if m.split(".")[0] == "epcontact" or m == "pandas"))
"""


def imported_modules(source):
    """Return the names of all modules that a source text imports."""
    modules = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "a relative import hides the module's full name"
            modules.add(node.module)
    return modules


def package_of(module):
    """Return the first name of a dotted module name."""
    return module.split(".")[0]


def test_its_sources_import_no_mathematics_of_epcontact():
    """No file of fem_check imports a module of epcontact except those in ALLOWED."""
    assert len(SOURCES) > 5
    for path in SOURCES:
        text = path.read_text()
        modules = imported_modules(text)
        shared = {name for name in modules if package_of(name) == "epcontact"}
        assert shared <= ALLOWED, path.name
        assert "importlib" not in text, path.name
        assert "__import__" not in text, path.name


def test_a_fresh_process_that_solves_loads_no_more():
    """A process that solves with fem_check has loaded only the modules in ALLOWED."""
    process = subprocess.run(
        [sys.executable, "-W", "error", "-c", SOLVE],
        capture_output=True,
        text=True,
        check=True,
    )
    assert set(ast.literal_eval(process.stdout)) == {"epcontact"} | ALLOWED


def test_the_contract_itself_imports_numpy_and_the_standard_library_alone():
    """The modules scene, results and errors import no package but numpy and Python's
    own.
    """
    allowed = {"numpy", "epcontact", *sys.stdlib_module_names}
    for name in ("scene", "results", "errors"):
        text = (PACKAGE.parent / "epcontact" / f"{name}.py").read_text()
        packages = {package_of(module) for module in imported_modules(text)}
        if name == "results":
            packages.discard("pandas")  # imported when a user asks for a table
        assert packages <= allowed, name


def test_the_plain_elements_import_nothing_of_the_fast_ones():
    """The module that defines the problem knows no other module of fem_check."""
    modules = imported_modules((PACKAGE / "plain.py").read_text())
    assert {package_of(module) for module in modules} == {
        *("__future__", "collections", "dataclasses", "functools", "math", "typing"),
        *("numpy", "scipy", "skfem", "epcontact"),
    }
