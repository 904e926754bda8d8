"""Studies: charts of accuracy against cost, and of the theory against the numerical methods.

A study is a module of this package.  Its functions make tidy tables (pandas, one row for each
point), and its function `charts(size, progress)` draws them by a `Plot` that selects columns.
`STUDIES` names the studies; the module of a study is imported when it runs.  The size "fast" takes
seconds, "full" minutes.  The times in a chart come from one run on one machine, so only their
ratios are comparable.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from epcontact.output.charts.figures import Chart


@dataclass(frozen=True)
class Study:
    """A study with the name of its module."""

    name: str
    description: str

    def run(
        self, size: Literal["fast", "full"] = "fast", progress: Callable[[str], None] | None = None
    ) -> tuple[Chart, ...]:
        """Make the charts of the study.

        Args:
            size: "fast" takes seconds, "full" minutes.
            progress: called with a sentence before each longer piece of work.

        Raises:
            EpcontactError: a solver does not converge, or another code is not installed.
        """
        module = importlib.import_module(f"epcontact.studies.{self.name.replace('-', '_')}")
        charts: tuple[Chart, ...] = module.charts(size, progress or (lambda _: None))
        return charts


def save_charts(name: str, charts: tuple[Chart, ...], folder: Path) -> list[Path]:
    """Write the charts of a study as <name>-1, <name>-2, ... (a single one as <name>).

    Args:
        name: name of the study.
        charts: the charts of `Study.run`.
        folder: the folder, which is made if it is missing.

    Returns:
        The files written, four for each chart.

    Raises:
        OutputError: a file cannot be written.
    """
    several = len(charts) > 1
    written: list[Path] = []
    for number, chart in enumerate(charts, start=1):
        written += chart.save(folder / (f"{name}-{number}" if several else name))
    return written


_DESCRIPTIONS = {
    "gamma": "areas of the theory against its energy reduction, beside boundary elements",
    "resolution": "error of raw and corrected areas against points per wavelength and cost",
    "areas": "coverage of the claimed errors of corrected areas, by kind of surface",
    "magnification": "theory against boundary elements on one surface filtered at many cut-offs",
    "theory": "error of the theory's series against their terms, of its cells against their number",
    "bem": "residual and area error of Newton and the baselines against FFT pairs and time",
    "growth": "FFT pairs and time of boundary elements against the size of the grid",
    "speed": "FFT pairs, time in bare FFT pairs, area errors and memory on the paper's scene",
    "pressures": "P(sigma) at 0 and at the hardness, raw and extrapolated, beside the theory",
    "gap": "mean gap against pressure, its elastic and plastic part, by all methods",
    "gap_distribution": "distribution of the open gap by all methods, and its distance from BEM's",
    "hysteresis": "contact area, mean gap and plastic work on the way up and down, by every method",
    "residual": "power spectrum and skewness of the surface that a load leaves, by every method",
    "fem": "errors and costs of finite elements: element, mesh, depth, linear solver, load path",
    "hardness": "the cap, in yield stresses, that gives a J2 body's contact area, with error bars",
    "hardness-map": "the kept map of that cap over severity, load and nu, with its formula",
    "persistence": "contact area up to three yield stresses by J2 flow, caps and theory",
    "master": "error of the contact area against time for all three methods on one scene",
    "peers": "time to the same areas beside public codes, where they are installed",
}

#: Every study by its name.
STUDIES = {name: Study(name, text) for name, text in _DESCRIPTIONS.items()}
