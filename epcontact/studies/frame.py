"""The frame of the studies: from a function that yields tables of rows to charts and
their files.

A study is one function that yields, for each of its charts, a `Plot`, the rows that the
plot draws and a title.  Rows with a column `seed` become means over the surfaces with
their intervals.  A caption is the title, the docstring of the study and its options.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from epcontact.harness.gates import estimate
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.output.charts.style import typeset

Ints = Sequence[int]
#: Rows of a table, by the names of its columns.
Rows = list[dict[str, Any]]
#: Called with a sentence before each longer piece of work.
Say = Callable[[str], None]
#: The look of a chart, or what draws it of its rows.
Look = Plot | Callable[[pd.DataFrame], Any]
#: What a study yields, a chart each: its look, its rows and its title.
Charts = Iterator[tuple[Look, pd.DataFrame, str]]

#: Every study by its name, in the order in which their modules are imported.
STUDIES: dict[str, Study] = {}


@dataclass(frozen=True)
class Study:
    """A study: its name, its function, and the options of its full size."""

    name: str
    make: Callable[..., Charts]
    full: Mapping[str, Any]

    @property
    def description(self) -> str:
        """The first line of the function's docstring."""
        return (self.make.__doc__ or "").partition("\n")[0].rstrip(".")

    def run(
        self, say: Say = lambda _: None, *, full: bool = False, **options: Any
    ) -> list[Chart]:
        """Make the charts in seconds, or in full in minutes, with options changed.
        Raises EpcontactError if a solver does not converge or another code is not
        installed.
        """
        parameters = list(inspect.signature(self.make).parameters.values())[1:]
        usual = {one.name: one.default for one in parameters}
        given = usual | (dict(self.full) if full else {}) | options
        kinds: Any = str | float | int | Sequence  # options of others are data
        told = [
            f"{k} {_shown(v)}"
            for k, v in given.items()
            if isinstance(v, kinds) and v != ()
        ]
        about = " ".join((self.make.__doc__ or "").split())
        about += f" Options: {'; '.join(told)}." if told else ""
        charts = self.make(lambda what: say(f"{self.name}: {what}"), **given)
        return [
            _drawn(plot, table, f"{title}. {about}") for plot, table, title in charts
        ]


def study(
    name: str, **full: Any
) -> Callable[[Callable[..., Charts]], Callable[..., Charts]]:
    """Make a study of a function of `say` and options; the decorator has those of the
    full size.
    """

    def register(make: Callable[..., Charts]) -> Callable[..., Charts]:
        STUDIES[name] = Study(name, make, full)
        return make

    return register


def rows(
    say: Say, row: Callable[..., Any], **axes: Sequence[Any] | Mapping[Any, Any]
) -> Any:
    """The table of the axes and `row(**point)`, one or several rows, at every
    combination.
    """
    found = []
    for values in product(*axes.values()):
        point = dict(zip(axes, values, strict=True))
        say(", ".join(f"{name} {_shown(value)}" for name, value in point.items()))
        several = row(**point)
        found += [
            point | each
            for each in (several if isinstance(several, list) else [several])
        ]
    return pd.DataFrame(found)


def mean_with_interval(
    table: pd.DataFrame, value: str, by: Sequence[str], shared_error: str = ""
) -> pd.DataFrame:
    """Means of all columns over groups, in the order of their first rows, and of one of
    them <value>_low and <value>_high, Student's 95 % interval.  `shared_error` is a
    column of errors that the rows of a group have in common, so that they do not
    average out: their mean is added in quadrature.
    """
    groups = table.groupby(list(by), sort=False)
    found = groups.mean(numeric_only=True).drop(columns="seed", errors="ignore")
    half_width = groups[value].agg(
        lambda values: estimate(values.to_numpy()).half_width
    )
    if shared_error:
        half_width = np.hypot(half_width, found[shared_error])
    low, high = found[value] - half_width, found[value] + half_width
    if (
        re.search("share|fraction|overlap|^area$", value)
        and table[value].between(0, 1).all()
    ):
        low, high = low.clip(lower=0), high.clip(upper=1)
    return found.assign(**{f"{value}_low": low, f"{value}_high": high}).reset_index()


def root_mean_square(
    table: pd.DataFrame, value: str, by: Sequence[str]
) -> pd.DataFrame:
    """Means over the surfaces of each group, in the order of first rows; of `value` the
    rms.
    """
    squares = table.assign(**{value: table[value] ** 2}).drop(columns="seed")
    means = squares.groupby(list(by), sort=False).mean(numeric_only=True).reset_index()
    return means.assign(**{value: np.sqrt(means[value])})


def listed(table: pd.DataFrame, form: str) -> str:
    """List the rows of a table for a title: `form` with the columns filled in."""
    return ", ".join(form.format(**row) for row in table.to_dict("records"))


def save_charts(name: str, charts: Sequence[Chart], folder: Path) -> list[Path]:
    """Write the charts of a study as <name>-1, <name>-2, ... (a single one as <name>),
    four files each; raises OutputError if one cannot be written.
    """
    stems = (
        [name] if len(charts) == 1 else [f"{name}-{i + 1}" for i in range(len(charts))]
    )
    saved = (
        chart.save(folder / stem) for stem, chart in zip(stems, charts, strict=True)
    )
    return [path for paths in saved for path in paths]


def _shown(value: Any) -> str:
    if isinstance(value, range):
        return f"{value[0]} to {value[-1]}"
    if isinstance(value, tuple | list):
        parts = [
            f"({_shown(v)})" if isinstance(v, tuple | list) else _shown(v)
            for v in value
        ]
        return ", ".join(parts if len(parts) < 7 else (*parts[:2], "…", parts[-1]))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _drawn(plot: Look, table: pd.DataFrame, caption: str) -> Chart:
    if not isinstance(plot, Plot):
        rows = table.to_numpy().tolist()
        return Chart(plot(table), list(table), rows, typeset(caption, mathtext=False))
    if "seed" in table:
        named = [*plot.series, plot.x[0], *([plot.colour] if plot.colour else [])]
        caption += (
            f" Means of {table['seed'].nunique()} surfaces with their 95 % intervals."
        )
        table = mean_with_interval(table, plot.y[0], list(dict.fromkeys(named)))
    return draw_table(table, plot, caption)
