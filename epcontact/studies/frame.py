"""The frame of the studies: from a function that yields tables of rows to charts and their files.

A study is one function with the decorator `study`.  It yields, for each of its charts, a `Plot`,
the rows that the plot draws and a caption.  Rows with a column `seed` become means over the
surfaces with their intervals; the columns of the CSV are those that the plot names.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from epcontact.harness.gates.statistics import estimate
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table

#: Called with a sentence before each longer piece of work.
Say = Callable[[str], None]
#: What a study yields, a chart each: its look, its rows and its caption.
Charts = Iterator[tuple[Plot, pd.DataFrame | Sequence[Mapping[str, Any]], str]]

#: Every study by its name, in the order in which their modules are imported.
STUDIES: dict[str, Study] = {}


@dataclass(frozen=True)
class Study:
    """A study: its name, its function, and the options of the function by size."""

    name: str
    make: Callable[..., Charts]
    sizes: Mapping[str, Mapping[str, Any]]

    @property
    def description(self) -> str:
        """The first line of the function's docstring."""
        return (self.make.__doc__ or "").partition("\n")[0].rstrip(".")

    def run(self, size: str = "fast", say: Say = lambda _: None, **options: Any) -> list[Chart]:
        """Make the charts at a size ("fast" takes seconds, "full" minutes) with options changed.

        Raises EpcontactError if a solver does not converge or another code is not installed.
        """
        given = {**self.sizes[size], **options}
        charts = self.make(lambda what: say(f"{self.name}: {what}"), **given)
        return [_drawn(*chart) for chart in charts]


def study(
    name: str, *, fast: Mapping[str, Any] | None = None, full: Mapping[str, Any] | None = None
) -> Callable[[Callable[..., Charts]], Callable[..., Charts]]:
    """Make a study of a function of `say` and the options that its sizes name."""

    def register(make: Callable[..., Charts]) -> Callable[..., Charts]:
        STUDIES[name] = Study(name, make, {"fast": fast or {}, "full": full or {}})
        return make

    return register


def rows(say: Say, row: Callable[..., Any], **axes: Sequence[Any] | Mapping[Any, Any]) -> Any:
    """The table of `row(**point)`, one or several rows, at every combination of the axes.

    The columns are the axes, by their names, and those of the rows.
    """
    found = []
    for values in product(*axes.values()):
        point = dict(zip(axes, values, strict=True))
        say(", ".join(f"{key} {_shown(value)}" for key, value in point.items()))
        several = row(**point)
        several = several if isinstance(several, list) else [several]
        found += [point | each for each in several]
    return pd.DataFrame(found)


def mean_with_interval(
    table: pd.DataFrame, value: str, by: Sequence[str], shared_error: str = ""
) -> pd.DataFrame:
    """Average a column over the rows of each group, with the 95 % interval of the mean.

    Returns a row for each group, in the order of their first rows: `by`, `<value>`, `<value>_low`
    and `<value>_high`.  The interval is Student's; of a single row it has no width.  `shared_error`
    is a column of errors that the rows of a group have in common, so that they do not average out:
    their mean is added to the half-width in quadrature.
    """
    groups = table.groupby(list(by), sort=False)
    mean = groups[value].mean()
    half_width = groups[value].agg(lambda values: estimate(values.to_numpy()).half_width)
    if shared_error:
        half_width = np.hypot(half_width, groups[shared_error].mean())
    bounds = {f"{value}_low": mean - half_width, f"{value}_high": mean + half_width}
    return pd.DataFrame({value: mean} | bounds).reset_index()


def root_mean_square(table: pd.DataFrame, value: str, by: Sequence[str]) -> pd.DataFrame:
    """Root mean square of a column over each group, in the order of their first rows."""
    squares = table.assign(**{value: table[value] ** 2})
    return np.sqrt(squares.groupby(list(by), sort=False)[value].mean()).reset_index()


def listed(table: pd.DataFrame, form: str) -> str:
    """List the rows of a table for a caption: `form` with the columns filled in."""
    return ", ".join(form.format(**row) for row in table.to_dict("records"))


def save_charts(name: str, charts: Sequence[Chart], folder: Path) -> list[Path]:
    """Write the charts of a study as <name>-1, <name>-2, ... (a single one as <name>).

    Returns the files written, four for each chart; raises OutputError if one cannot be written.
    """
    stems = [name] if len(charts) == 1 else [f"{name}-{i + 1}" for i in range(len(charts))]
    return [
        path
        for stem, chart in zip(stems, charts, strict=True)
        for path in chart.save(folder / stem)
    ]


def _shown(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _drawn(plot: Plot, rows: Any, caption: str) -> Chart:
    table = pd.DataFrame(rows)
    if "seed" in table:
        named = [*plot.series, plot.x[0], *([plot.colour] if plot.colour else [])]
        surfaces = table["seed"].nunique()
        table = mean_with_interval(table, plot.y[0], list(dict.fromkeys(named)))
        caption += f" Means of {surfaces} surfaces with their 95 % intervals."
    return draw_table(table, plot, caption)
