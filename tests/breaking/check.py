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

    The patch is put in place and removed again.  The test that sees the fault, or the
    gate, must exist.
    """
    try:
        with pytest.MonkeyPatch.context() as monkeypatch:
            fault.patch(monkeypatch)
        if not fault.test:
            gates_of(fault)
    except (StaleFault, EpcontactError) as error:
        return str(error)
    return "" if not fault.test else _reason_test_is_gone(fault.test)


def _reason_test_is_gone(name):
    file, _, test = name.partition("::")
    definition = rf"^def {re.escape(test.partition('[')[0])}\("
    path = ROOT / file
    if path.is_file() and re.search(definition, path.read_text("utf-8"), re.MULTILINE):
        return ""
    return f"{name} does not exist"


def places_of(path, place):
    """Return other functions of the same file that hold the place of a stale fault."""
    parts = path.split(".")
    files = [ROOT.joinpath(*parts[:end]).with_suffix(".py") for end in (-1, -2)]
    file = next((file for file in files if file.is_file()), None)
    if file is None:
        return []
    functions = [
        node
        for node in ast.walk(ast.parse(file.read_text("utf-8")))
        if isinstance(node, ast.FunctionDef)
    ]
    return [function.name for function in functions if has_place(function, place)]
