"""fem_check can disagree with epcontact only while it shares nothing with it but the question."""

import ast
import sys
from pathlib import Path

import fem_check

#: The question, the form of the answer, facts of the machine and files: no mathematics.
ALLOWED = {f"epcontact.{name}" for name in ("scene", "results", "errors", "machine", "files")}
SOURCES = sorted(Path(fem_check.__file__).parent.glob("**/*.py"))


def imported(source):
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports would hide where a name comes from"
            found.add(node.module or "")
    return found


def test_its_sources_import_no_mathematics_of_epcontact():
    assert len(SOURCES) > 5
    for path in SOURCES:
        ours = {n for n in imported(path.read_text()) if n.split(".")[0] == "epcontact"}
        assert ours <= ALLOWED, f"{path.name} imports {ours - ALLOWED}"
        for name in ("importlib", "__import__"):
            assert name not in path.read_text(), f"{path.name} uses {name}"


def test_the_contract_itself_imports_numpy_and_the_standard_library_alone():
    for name in ("scene", "results", "errors"):
        file = Path(fem_check.__file__).parents[1] / "epcontact" / f"{name}.py"
        top = {n.split(".")[0] for n in imported(file.read_text())}
        later = {"pandas"} if name == "results" else set()  # for whoever asks for a table
        assert top <= {"numpy", "epcontact", *later, *sys.stdlib_module_names}
