"""The structure of the code: imports lead down the floors, run in no circle, and stand on top."""

import ast
from collections import Counter
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
    "epcontact": 101,
    "epcontact.bem": 3768,
    "epcontact.cli": 1419,
    "epcontact.errors": 81,
    "epcontact.files": 132,
    "epcontact.harness": 7362,
    "epcontact.machine": 226,
    "epcontact.materials": 312,
    "epcontact.output": 1782,
    "epcontact.persson": 2013,
    "epcontact.planning": 734,
    "epcontact.reference": 1110,
    "epcontact.results": 292,
    "epcontact.scene": 498,
    "epcontact.studies": 2817,
    "epcontact.surfaces": 1994,
    "fem_check": 3642,
    "tests": 16411,
}
#: Imports of the project inside functions, each with its reason beside it; fewer is better.
DEFERRED = 15

FILES = sorted([*ROOT.glob("epcontact/**/*.py"), *ROOT.glob("fem_check/**/*.py")])


def module_of(file):
    return ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


MODULES = {module_of(file): ast.parse(file.read_text(encoding="utf-8")) for file in FILES}


def room_of(module):
    return ".".join(module.split(".")[: 1 if module.startswith("fem_check") else 2])


def imported(tree):
    """The project's modules that a piece of code imports, wherever in it."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            full = (f"{node.module}.{alias.name}" for alias in node.names)
            found |= {name if name in MODULES else node.module for name in full}
    return found & MODULES.keys()


#: Faces of packages, which import their modules to hand names on: they are no rooms.
FACES = {module_of(file) for file in FILES if file.name == "__init__.py"}
#: What each module imports.
NEEDS = {name: imported(tree) for name, tree in MODULES.items()}


def test_imports_lead_down():
    floor = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
    for module in MODULES.keys() - {"epcontact"}:
        here = room_of(module)
        assert here in floor, f"{here} is a new room: does it belong inside another one?"
        for there, name in ((room_of(name), name) for name in NEEDS[module] - {"epcontact"}):
            assert there == here or floor[there] < floor[here], f"{module} imports {name}"


@pytest.mark.parametrize(
    "package", ["", "epcontact.bem", "epcontact.harness", "epcontact.output", "fem_check"]
)
def test_imports_run_in_no_circle(package):
    """Neither those of the modules do, nor those of the folders of a room, each taken as one."""
    depth = package.count(".") + 2 if package else None
    needs: dict[str, set[str]] = {}
    for name in NEEDS.keys() - FACES:
        if name.startswith(package):
            here, *there = (".".join(n.split(".")[:depth]) for n in (name, *NEEDS[name] - FACES))
            needs.setdefault(here, set()).update({*there} - {here})
    assert len(needs) > 1
    while ready := {name for name, needed in needs.items() if not needed & needs.keys()}:
        needs = {name: needs[name] for name in needs.keys() - ready}
    assert not needs, "these need each other in a circle, or those that do"


def test_imports_stand_at_the_top():
    deferred = {
        f"{module}.{function.name}: {name}"
        for module, tree in MODULES.items()
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef)
        for name in imported(function)
    }
    assert len(deferred) <= DEFERRED, "\n".join(sorted(deferred))


def test_no_room_grows_beyond_its_budget():
    lines: Counter[str] = Counter()
    for file in [*FILES, *ROOT.glob("tests/**/*.py")]:
        room = "tests" if file.is_relative_to(ROOT / "tests") else room_of(module_of(file))
        lines[room.removesuffix(".__main__")] += file.read_text(encoding="utf-8").count("\n")
    beyond = {room: n for room, n in lines.items() if n > LINES.get(room, 0)}
    assert not beyond, "rooms with more lines than LINES allows"
