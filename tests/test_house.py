"""The structure of the code: imports lead down the floors, run in no circle, and stand on top."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
#: The rooms, from the ground up.  A room imports only from floors below its own.
FLOORS = (
    {"epcontact.errors", "epcontact.results", "epcontact.machine"},
    {"epcontact.scene"},
    {"epcontact.materials", "epcontact.surfaces", "epcontact.output", "fem_check"},
    {"epcontact.reference", "epcontact.persson", "epcontact.bem"},
    {"epcontact.harness"},
    {"epcontact.planning", "epcontact.studies"},
    {"epcontact.cli"},
    {"epcontact.__main__"},
)
#: Imports of the project inside functions, each with its reason beside it; fewer is better.
DEFERRED = 15

FILES = sorted([*ROOT.glob("epcontact/**/*.py"), *ROOT.glob("fem_check/**/*.py")])


def module_of(file: Path) -> str:
    return ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


MODULES = {module_of(file): ast.parse(file.read_text(encoding="utf-8")) for file in FILES}


def room_of(module: str) -> str:
    return ".".join(module.split(".")[: 1 if module.startswith("fem_check") else 2])


def imported(tree: ast.AST) -> Iterator[str]:
    """The project's modules that a piece of code imports, wherever in it."""
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                names.append(full if full in MODULES else node.module)
        yield from (name for name in names if name in MODULES)


@pytest.mark.parametrize("module", MODULES)
def test_imports_lead_down(module: str) -> None:
    if module == "epcontact":
        return  # hands names on, and imports them when they are asked for
    floor = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
    here = room_of(module)
    assert here in floor, f"{here} is a new room: does it belong inside another one?"
    for name in set(imported(MODULES[module])) - {"epcontact"}:
        there = room_of(name)
        assert there == here or floor[there] < floor[here], f"{module} imports {name}"


def test_there_are_no_circles() -> None:
    waiting = {name: set(imported(tree)) - {name} for name, tree in MODULES.items()}
    # A package's face imports its modules, and they import each other: only modules count.
    faces = {module_of(file) for file in FILES if file.name == "__init__.py"}
    waiting = {name: needed - faces for name, needed in waiting.items() if name not in faces}
    while ready := {name for name, needed in waiting.items() if not needed & waiting.keys()}:
        waiting = {name: needed for name, needed in waiting.items() if name not in ready}
    assert not waiting, f"modules that import each other in a circle: {sorted(waiting)}"


def test_imports_stand_at_the_top() -> None:
    deferred = [
        f"{module}.{function.name}: {name}"
        for module, tree in MODULES.items()
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
        for name in imported(function)
    ]
    assert len(set(deferred)) <= DEFERRED, "\n".join(sorted(set(deferred)))
