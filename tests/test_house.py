"""The structure of the code: imports lead down the floors, run in no circle, and stand
on top.
"""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
#: The rooms, from the ground up.  A room imports only from floors below its own.
FLOORS = (
    {
        "epcontact.errors",
        "epcontact.results",
        "epcontact.machine",
        "epcontact.notebook",
    },
    {"epcontact.scene", "epcontact.files"},
    {"epcontact.output", "epcontact.alternatives"},
    {"epcontact.materials", "epcontact.surfaces", "fem_check"},
    {"epcontact.reference", "epcontact.persson", "epcontact.bem"},
    {"epcontact.interface", "epcontact.peers"},
    {"epcontact.harness"},
    {"epcontact.crosscheck"},
    {"epcontact.pictures", "epcontact.planning", "epcontact.studies"},
    {"epcontact.cli"},
    {"epcontact.__main__"},
)
#: Imports of the project inside functions, each with its reason beside it; fewer is
#: better.
DEFERRED = 15

FILES = sorted([*ROOT.glob("epcontact/**/*.py"), *ROOT.glob("fem_check/**/*.py")])


def module_of(file):
    """Return the dotted name of the module in a file."""
    return ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(
        ".__init__"
    )


MODULES = {
    module_of(file): ast.parse(file.read_text(encoding="utf-8")) for file in FILES
}


def room_of(module):
    """Return the room of a module: its first two names, of fem_check the first."""
    return ".".join(module.split(".")[: 1 if module.startswith("fem_check") else 2])


def imported(tree):
    """Return the names of the project's modules that a syntax tree imports anywhere, a
    set.
    """
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
    """A module imports only from its own room or from rooms on lower floors
    (FLOORS).
    """
    floor = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
    for module in MODULES.keys() - {"epcontact"}:
        here = room_of(module)
        assert here in floor, (
            f"{here} is a new room: does it belong inside another one?"
        )
        for there, name in (
            (room_of(name), name) for name in NEEDS[module] - {"epcontact"}
        ):
            assert there == here or floor[there] < floor[here], (
                f"{module} imports {name}"
            )


@pytest.mark.parametrize(
    "package",
    [
        "",
        "epcontact.bem",
        "epcontact.harness",
        "epcontact.interface",
        "epcontact.output",
        "fem_check",
    ],
)
def test_imports_run_in_no_circle(package):
    """Modules do not import each other in a circle, nor do the folders of a room
    (`package`), each taken as one.
    """
    depth = package.count(".") + 2 if package else None
    needs: dict[str, set[str]] = {}
    for name in NEEDS.keys() - FACES:
        if name.startswith(package):
            here, *there = (
                ".".join(n.split(".")[:depth]) for n in (name, *NEEDS[name] - FACES)
            )
            needs.setdefault(here, set()).update({*there} - {here})
    assert len(needs) > 1
    while ready := {
        name for name, needed in needs.items() if not needed & needs.keys()
    }:
        needs = {name: needs[name] for name in needs.keys() - ready}
    assert not needs, "these need each other in a circle, or those that do"


def test_imports_stand_at_the_top():
    """At most DEFERRED imports of the project stand inside functions."""
    deferred = {
        f"{module}.{function.name}: {name}"
        for module, tree in MODULES.items()
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef)
        for name in imported(function)
    }
    assert len(deferred) <= DEFERRED, "\n".join(sorted(deferred))


def test_only_two_modules_print():
    """Commands print by `cli.main` and `cli.terminal`, which make words from outside
    harmless.  No other module calls `echo` or `print`, or makes a table or text of
    rich; `progress` has the console of the progress bar.
    """
    printers = {"echo", "print", "Console", "Table", "Text"}
    outlets = {"epcontact.cli.main", "epcontact.cli.terminal"}
    calls = set()
    for module, tree in MODULES.items():
        for node in ast.walk(tree):
            if module not in outlets and isinstance(node, ast.Call):
                name = getattr(node.func, "id", ast.unparse(node.func))
                if name in printers or name == "click.echo":
                    calls.add((module, name))
    assert calls == {("epcontact.cli.progress", "Console")}
