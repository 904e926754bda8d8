"""Find the faults that no longer fit the code, without running what sees them."""

import ast
import functools
import re

import pytest

from breaking.fault import TESTS, gates_of
from breaking.rewrite import StaleFault, has_place
from breaking.table import is_pattern
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
    """Raise `StaleFault` if a test, "file::function" from the root of the checkout,
    does not exist.
    """
    file, _, test = name.partition("::")
    function = re.escape(test.partition("[")[0])
    path = ROOT / file
    text = path.read_text("utf-8") if path.is_file() else ""
    if not re.search(rf"^def {function}\(", text, re.MULTILINE):
        raise StaleFault(f"{name} does not exist")


def candidates(fault):
    """Return dotted paths of functions that may have taken over the place of a stale
    fault.

    They hold the pattern of the place, or have the name of the function. If functions
    of the same file are among them, only these are returned.
    """
    paths = []
    for module, function in functions():
        if is_pattern(fault.path, fault.place):
            fits = has_place(function, fault.place)
        else:
            fits = function.name == fault.path.rpartition(".")[2]
        if fits:
            paths.append(f"{module}.{function.name}")
    return [path for path in paths if is_beside(path, fault.path)] or paths


def is_beside(path, other):
    """Return whether two functions or methods, given by dotted paths, may be in one
    file.
    """
    module = path.rpartition(".")[0]
    return other.startswith(f"{module}.")


@functools.cache
def functions():
    """Return a list of pairs: module and syntax tree of each function of the
    product.
    """
    found = []
    for package in ("epcontact", "fem_check"):
        for file in sorted((ROOT / package).rglob("*.py")):
            module = ".".join(file.relative_to(ROOT).with_suffix("").parts)
            for node in ast.walk(ast.parse(file.read_text("utf-8"))):
                if isinstance(node, ast.FunctionDef):
                    found.append((module, node))
    return found
