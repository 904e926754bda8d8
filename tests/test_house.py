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
    {"epcontact.scene", "epcontact.files"},
    {"epcontact.output"},
    {"epcontact.materials", "epcontact.surfaces", "fem_check"},
    {"epcontact.reference", "epcontact.persson", "epcontact.bem"},
    {"epcontact.harness"},
    {"epcontact.planning", "epcontact.studies"},
    {"epcontact.cli"},
    {"epcontact.__main__"},
)
#: The most lines of each room.  A change that needs more takes something out of the room, or says
#: in its commit why the room grows.
LINES = {
    "epcontact": 100,
    "epcontact.bem": 4100,
    "epcontact.cli": 1090,
    "epcontact.errors": 90,
    "epcontact.files": 140,
    "epcontact.harness": 5810,
    "epcontact.machine": 220,
    "epcontact.materials": 260,
    "epcontact.output": 1660,
    "epcontact.persson": 1550,
    "epcontact.planning": 690,
    "epcontact.reference": 940,
    "epcontact.results": 190,
    "epcontact.scene": 490,
    "epcontact.studies": 2430,
    "epcontact.surfaces": 1780,
    "fem_check": 3700,
    "tests": 13820,
}
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


#: Faces of packages, which import their modules to hand names on: they are no rooms.
FACES = {module_of(file) for file in FILES if file.name == "__init__.py"}
#: What each module imports.
NEEDS = {name: set(imported(MODULES[name])) - FACES for name in MODULES.keys() - FACES}


def circle(needs: dict[str, set[str]]) -> list[str]:
    """The names that need each other in a circle, and those that need them."""
    left = {name: needed - {name} for name, needed in needs.items()}
    while ready := {name for name, needed in left.items() if not needed & left.keys()}:
        left = {name: needed for name, needed in left.items() if name not in ready}
    return sorted(left)


def test_there_are_no_circles() -> None:
    assert not circle(NEEDS), "modules that import each other in a circle"


@pytest.mark.parametrize(
    "package", ["epcontact.bem", "epcontact.harness", "epcontact.output", "fem_check"]
)
def test_rooms_inside_a_room_lead_one_way(package: str) -> None:
    """A folder counts as one room, so that no two folders import from each other."""
    depth = package.count(".") + 2
    rooms: dict[str, set[str]] = {}
    for name, needed in NEEDS.items():
        if name.startswith(f"{package}."):
            room = ".".join(name.split(".")[:depth])
            rooms.setdefault(room, set()).update(
                ".".join(other.split(".")[:depth]) for other in needed
            )
    assert len(rooms) > 1
    assert not circle(rooms), "rooms that import from each other"


def test_imports_stand_at_the_top() -> None:
    deferred = [
        f"{module}.{function.name}: {name}"
        for module, tree in MODULES.items()
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
        for name in imported(function)
    ]
    assert len(set(deferred)) <= DEFERRED, "\n".join(sorted(set(deferred)))


def test_no_room_grows_beyond_its_budget() -> None:
    lines = dict.fromkeys(LINES, 0)
    for file in FILES:
        room = room_of(module_of(file))
        room = "epcontact" if room == "epcontact.__main__" else room
        lines[room] = lines.get(room, 0) + len(file.read_text(encoding="utf-8").splitlines())
    tests = (ROOT / "tests").rglob("*.py")
    lines["tests"] = sum(len(file.read_text(encoding="utf-8").splitlines()) for file in tests)
    beyond = {room: n for room, n in lines.items() if n > LINES.get(room, 0)}
    assert not beyond, "rooms with more lines than LINES allows"
