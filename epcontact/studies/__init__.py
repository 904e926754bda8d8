"""Studies: what accuracy costs, and what the theory and its checks say of each other, as charts.

A study is a module of this package.  Its functions make tidy tables (pandas, one row a point);
its function `charts(size, progress)` draws them, each by a `Plot` that says which columns are
shown.  `STUDIES` names the studies; the module of a study is imported when it runs.  The size
"fast" takes seconds, "full" minutes.  Times that a chart shows were taken in that one run: their
ratios mean something, they themselves belong to the machine.
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
    """A study by its name, which is that of its module."""

    name: str
    description: str

    def run(
        self, size: Literal["fast", "full"] = "fast", progress: Callable[[str], None] | None = None
    ) -> tuple[Chart, ...]:
        """Make the charts of the study.

        Args:
            size: "fast" takes seconds, "full" minutes.
            progress: called with a sentence now and then.

        Raises:
            EpcontactError: a solver does not converge, or another code is not installed.
        """
        module = importlib.import_module(f"epcontact.studies.{self.name}")
        charts: tuple[Chart, ...] = module.charts(size, progress or (lambda _: None))
        return charts


def save_charts(name: str, charts: tuple[Chart, ...], folder: Path) -> list[Path]:
    """Write the charts of a study as <name>-1, <name>-2, ... (a single one as <name>).

    Args:
        name: of the study.
        charts: as `Study.run` makes them.
        folder: is made if it is not there.

    Returns:
        The files written, four a chart.

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
    "magnification": "theory against boundary elements on one surface filtered at many cut-offs",
    "theory": "error of the theory's series against their terms, of its cells against their number",
    "bem": "residual and area error of Newton and the baselines against FFT pairs and time",
    "growth": "FFT pairs and time of boundary elements against the size of the grid",
    "speed": "FFT pairs, time in bare FFT pairs, area errors and memory on the paper's scene",
    "pressures": "P(sigma) at 0 and at the hardness, raw and extrapolated, beside the theory",
    "gap": "mean gap against pressure, its elastic and plastic part, by all methods",
    "fem": "what elements, meshes, depth, linear solvers and load paths of finite elements cost",
    "hardness": "the cap, in yield stresses, that gives a J2 body's contact area, with error bars",
    "master": "error of the contact area against time for all three methods on one scene",
    "peers": "time to the same areas beside public codes, where they are installed",
}

#: Every study by its name.
STUDIES = {name: Study(name, text) for name, text in _DESCRIPTIONS.items()}
