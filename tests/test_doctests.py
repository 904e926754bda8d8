"""The examples in the docstrings run and say what they promise."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import pytest

import epcontact
import fem_check

ROOTS = [Path(package.__file__ or "").parent for package in (epcontact, fem_check)]
MODULES = sorted(
    ".".join(file.relative_to(root.parent).with_suffix("").parts).removesuffix(".__init__")
    for root in ROOTS
    for file in root.rglob("*.py")
    if ">>> " in file.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("name", MODULES)
def test_examples_run(name: str) -> None:
    tests = doctest.DocTestFinder(exclude_empty=True).find(importlib.import_module(name), name)
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    runner = doctest.DocTestRunner(optionflags=flags)
    for test in tests:
        runner.run(test)
    assert runner.failures == 0
    assert runner.tries > 0
