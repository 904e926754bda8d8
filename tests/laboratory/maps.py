"""What the laboratories of kept maps share: their sweeps, the file that they write, the
command.
"""

import argparse
from pathlib import Path

from epcontact.errors import EpcontactError
from epcontact.files import atomic_write
from epcontact.harness.case_files.text import case_name, package_files, read_cases
from epcontact.harness.sweep import read_sweep, run_sweep
from epcontact.results import package_versions


def solved(name, size, output, jobs=None):
    """Yield each sweep of a case file when what `output` does not keep of it is
    solved.
    """
    (file,) = (file for file in package_files() if case_name(file) == name)
    for case in read_cases(file):
        if size not in case.sizes:
            continue
        swept = run_sweep(case, size=size, output=output, jobs=jobs)
        if swept.failures:
            raise EpcontactError(f"{case.id}: tasks have no result, {swept.failures}")
        sweep = read_sweep(case, size)
        print(f"{case.id}: {swept.reused} of {len(sweep.tasks)} results reused")
        yield sweep


def write(path, size, header, table):
    """Write a table below the header, which has places for the size and the
    versions.
    """
    versions = ", ".join(
        f"{name} {version}" for name, version in package_versions().items()
    )
    with atomic_write(path) as temporary:
        temporary.write_text(
            header.format(size=size, versions=versions) + table, encoding="utf-8"
        )


def parser(name):
    """The options of the command that makes a map."""
    found = argparse.ArgumentParser(prog=f"python -m laboratory.{name}")
    found.add_argument("--size", choices=["fast", "large"], default="fast")
    found.add_argument("--output", type=Path, default=Path("results"))
    found.add_argument("--jobs", type=int)
    return found
