"""Find the faults that no longer fit the code, without running what sees them."""

import ast
import re

import pytest

from breaking.fault import TESTS, gates_of
from breaking.rewrite import StaleFault, has_place
from epcontact.errors import EpcontactError

ROOT = TESTS.parent


def reason_stale(fault):
    """Return why a fault does not fit the code, or "" if it does.

    The patches are put in place and removed again.  The test that sees the fault, or
    the gate, must exist.
    """
    try:
        with pytest.MonkeyPatch.context() as monkeypatch:
            fault.apply(monkeypatch)
        if fault.test:
            require_test(fault.test)
        else:
            gates_of(fault)
    except (StaleFault, EpcontactError) as error:
        return str(error)
    return ""


def require_test(name):
    """Raise `StaleFault` if a test, file::function, does not exist."""
    file, _, test = name.partition("::")
    function = re.escape(test.partition("[")[0])
    path = ROOT / file
    text = path.read_text("utf-8") if path.is_file() else ""
    if not re.search(rf"^def {function}\(", text, re.MULTILINE):
        raise StaleFault(f"{name} does not exist")


def functions_with(place, path):
    """Return the names of functions that hold a place, in the file of a path."""
    parts = path.split(".")
    files = [ROOT.joinpath(*parts[:end]).with_suffix(".py") for end in (-1, -2)]
    names = []
    for file in filter(lambda file: file.is_file(), files):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.FunctionDef) and has_place(node, place):
                names.append(node.name)
    return names
