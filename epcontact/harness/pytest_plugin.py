"""The plugin of pytest: case files become tests, one for each gate.

pytest loads it by its entry point in every environment that has epcontact, so it does
nothing, and imports nothing heavy, until a project names its case files in pytest's
configuration:

    [tool.pytest.ini_options]
    epcontact_cases = ["*.case.toml"]

A pattern without a slash matches the file's name, one with slashes the end of its path.
"""

from __future__ import annotations

from pathlib import Path

import pytest

#: The sizes of `epcontact.harness.case_files.text`, which this module does not import.
_SIZES = ("fast", "full", "large")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add to pytest the setting `epcontact_cases` (patterns of case files) and the
    options `--case-size` and `--case-output`.
    """
    parser.addini(
        "epcontact_cases",
        "patterns of the case files that epcontact collects, such as *.case.toml",
        type="args",
        default=[],
    )
    group = parser.getgroup("epcontact")
    group.addoption(
        "--case-size", choices=_SIZES, default="fast", help="size of the cases to run"
    )
    group.addoption(
        "--case-output", default=None, help="folder for results; else a temporary one"
    )


def pytest_collect_file(
    file_path: Path, parent: pytest.Collector
) -> pytest.Collector | None:
    """Return the collector of a case file, for pytest.

    Returns None for a file that no pattern of the setting `epcontact_cases` matches.
    """
    patterns = parent.config.getini("epcontact_cases")
    if not any(file_path.match(pattern) for pattern in patterns):
        return None
    # This import loads the solvers.
    from epcontact.harness.verdict.pytest_cases import CaseModule

    return CaseModule.from_parent(parent, path=file_path)
