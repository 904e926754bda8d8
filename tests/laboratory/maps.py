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
    """Solve a case file and yield its sweeps, each with all results saved in `output`.

    `name` is that of a packaged case file; cases without the size are skipped, and
    saved results are reused. Raises EpcontactError if a task has no result.
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
    """Write a table (text) to a file below a header, in which `{size}` and `{versions}`
    are replaced.
    """
    versions = ", ".join(
        f"{name} {version}" for name, version in package_versions().items()
    )
    with atomic_write(path) as temporary:
        temporary.write_text(
            header.format(size=size, versions=versions) + table, encoding="utf-8"
        )


def parser(name):
    """Return the parser of a map's command, with the options size, output and jobs."""
    found = argparse.ArgumentParser(prog=f"python -m laboratory.{name}")
    found.add_argument("--size", choices=["fast", "large"], default="fast")
    found.add_argument("--output", type=Path, default=Path("results"))
    found.add_argument("--jobs", type=int)
    return found
