"""fem_check can disagree with epcontact only while it shares nothing with it but the
question.
"""

import ast
import subprocess
import sys
from pathlib import Path

import fem_check

#: The question, the form of the answer, facts of the machine and files: no mathematics.
ALLOWED = {
    f"epcontact.{name}" for name in ("scene", "results", "errors", "machine", "files")
}
SOURCES = sorted(Path(fem_check.__file__).parent.glob("**/*.py"))


def imported(source):
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, (
                "relative imports would hide where a name comes from"
            )
            found.add(node.module or "")
    return found


def test_its_sources_import_no_mathematics_of_epcontact():
    assert len(SOURCES) > 5
    for path in SOURCES:
        ours = {n for n in imported(path.read_text()) if n.split(".")[0] == "epcontact"}
        assert ours <= ALLOWED, f"{path.name} imports {ours - ALLOWED}"
        for name in ("importlib", "__import__"):
            assert name not in path.read_text(), f"{path.name} uses {name}"


def test_a_fresh_process_that_solves_loads_no_more():
    program = """
import sys
import fem_check, numpy as np
from epcontact.scene import Load, Material, Scene, Surface
x = np.cos(2 * np.pi * np.arange(8) / 8) * 0.01
scene = Scene(Surface(x, (1.0,)), Material(1.0, 0.3, yield_stress=0.01), Load(0.002))
fem_check.solve(scene)
print(sorted(m for m in sys.modules if m.split(".")[0] == "epcontact" or m == "pandas"))
"""
    answer = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        capture_output=True,
        text=True,
        check=True,
    )
    assert set(ast.literal_eval(answer.stdout)) == {"epcontact"} | ALLOWED


def test_the_contract_itself_imports_numpy_and_the_standard_library_alone():
    for name in ("scene", "results", "errors"):
        file = Path(fem_check.__file__).parents[1] / "epcontact" / f"{name}.py"
        top = {n.split(".")[0] for n in imported(file.read_text())}
        later = (
            {"pandas"} if name == "results" else set()
        )  # for whoever asks for a table
        assert top <= {"numpy", "epcontact", *later, *sys.stdlib_module_names}
