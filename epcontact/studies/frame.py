"""The frame of the studies: from a function that yields tables to charts and files.

A study is one function that yields, for each of its charts, a `Plot`, the table that
the plot draws and a caption.  The caption begins with the question that the chart
answers, which becomes the title of the chart.  A table with a column `seed` is replaced
by the means over the surfaces with their intervals.  The docstring of the study and its
options are added to each caption.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from epcontact.harness.gates import estimate
from epcontact.output.charts.figures import Chart, write_question
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.output.charts.style import typeset

Ints = Sequence[int]
#: Rows of a table, by the names of its columns.
Rows = list[dict[str, Any]]
#: Called with a sentence before each longer piece of work.
Say = Callable[[str], None]
#: The look of a chart, or a function that draws the figure of a table.
Look = Plot | Callable[[pd.DataFrame], Any]
#: What a study yields for each chart: its look, its table and its caption, which begins
#: with a question.
Charts = Iterator[tuple[Look, pd.DataFrame, str]]

#: Every study by its name, in the order in which their modules are imported.
STUDIES: dict[str, Study] = {}

#: Columns whose values are fractions, so that their intervals end at 0 and 1.
_FRACTIONS = re.compile("share|fraction|overlap|^area$")


@dataclass(frozen=True)
class Study:
    """A study.

    Attributes:
        name: The name by which the command `chart` draws it.
        function: The function that yields its charts; its first argument is a `Say`,
            the others are options with defaults for a small size, which takes seconds.
        full: Options of its full size, which takes minutes.
    """

    name: str
    function: Callable[..., Charts]
    full: Mapping[str, Any]

    @property
    def description(self) -> str:
        """The first line of the function's docstring, without its full stop."""
        first_line, *_ = (self.function.__doc__ or "").split("\n")
        return first_line.rstrip(".")

    def run(
        self, say: Say = lambda _: None, *, full: bool = False, **options: Any
    ) -> list[Chart]:
        """Return the charts of the study.

        Args:
            say: Called with a sentence before each longer piece of work.
            full: Whether the study runs at its full size.
            options: Options of the study that differ from those of the size.

        Raises:
            EpcontactError: A solver does not converge, or another code is missing.
        """
        _, *parameters = inspect.signature(self.function).parameters.values()
        values = {parameter.name: parameter.default for parameter in parameters}
        if full:
            values |= self.full
        values |= options

        def say_with_name(sentence: str) -> None:
            """Call `say` with a sentence that begins with the name of the study."""
            say(f"{self.name}: {sentence}")

        about = " ".join((self.function.__doc__ or "").split())
        described = _describe_options(values)
        if described:
            about += f" Options: {described}."
        charts = self.function(say_with_name, **values)
        return [
            _draw(look, table, f"{caption} {about}") for look, table, caption in charts
        ]


def study(
    name: str, **full: Any
) -> Callable[[Callable[..., Charts]], Callable[..., Charts]]:
    """Return a decorator that adds a function to `STUDIES`.

    Args:
        name: Name of the study.
        full: Options of its full size.
    """

    def register(function: Callable[..., Charts]) -> Callable[..., Charts]:
        """Add a function to `STUDIES` by the study's name, and return it unchanged."""
        STUDIES[name] = Study(name, function, full)
        return function

    return register


def tabulate(
    say: Say, row: Callable[..., Any], **axes: Sequence[Any] | Mapping[Any, Any]
) -> Any:
    """Return a table of a function's values at every combination of its arguments.

    Args:
        say: Called with the arguments before each call.
        row: Function of one value of each axis, which returns the further columns of a
            row as a dictionary, or a list of several rows.
        axes: Values of each argument.

    Returns:
        A pandas table with a column for each axis and each key of the rows.
    """
    table = []
    for values in product(*axes.values()):
        point = dict(zip(axes, values, strict=True))
        say(", ".join(f"{name} {_in_words(value)}" for name, value in point.items()))
        rows = row(**point)
        if not isinstance(rows, list):
            rows = [rows]
        table += [point | each for each in rows]
    return pd.DataFrame(table)


def mean_with_interval(
    table: pd.DataFrame, value: str, by: Sequence[str], shared_error: str = ""
) -> pd.DataFrame:
    """Return means over groups of rows, with the 95 % interval of one column.

    Args:
        table: Rows, one for each surface; a column `seed` is dropped.
        value: The column that gets an interval by Student's distribution, in the
            columns <value>_low and <value>_high.
        by: Columns that define the groups, which keep the order of their first rows.
        shared_error: A column of errors that the rows of a group have in common and
            that do not average out; their mean is added in quadrature.  Empty: none.

    Returns:
        A row for each group, with the columns `by`, the means of all numeric columns,
        and both ends of the interval.
    """
    groups = table.groupby(list(by), sort=False)
    means = groups.mean(numeric_only=True).drop(columns="seed", errors="ignore")
    half_width = groups[value].agg(lambda v: estimate(v.to_numpy()).half_width)
    if shared_error:
        half_width = np.hypot(half_width, means[shared_error])
    low = means[value] - half_width
    high = means[value] + half_width
    if _FRACTIONS.search(value) and table[value].between(0, 1).all():
        low = low.clip(lower=0)
        high = high.clip(upper=1)
    bounds = {f"{value}_low": low, f"{value}_high": high}
    return means.assign(**bounds).reset_index()


def root_mean_square(
    table: pd.DataFrame, value: str, by: Sequence[str]
) -> pd.DataFrame:
    """Return means over groups of rows; for one column, its root mean square instead.

    Args:
        table: Rows, one for each surface, with a column `seed`, which is dropped.
        value: The column of the root mean square.
        by: Columns that define the groups, which keep the order of their first rows.
    """
    squares = table.assign(**{value: table[value] ** 2}).drop(columns="seed")
    means = squares.groupby(list(by), sort=False).mean(numeric_only=True).reset_index()
    return means.assign(**{value: np.sqrt(means[value])})


def list_rows(table: pd.DataFrame, form: str) -> str:
    """Return the rows of a table as text for a caption, separated by commas.

    `form` is the format string of a row, such as "{nodes}: {time:.3g}" with the names
    of columns.
    """
    return ", ".join(form.format(**row) for row in table.to_dict("records"))


def save_charts(
    name: str,
    charts: Sequence[Chart],
    folder: Path,
) -> list[Path]:
    """Write the charts of a study, four files each, and return their paths.

    Args:
        name: Name of the study.  The files are called <name>-1, <name>-2, ... with four
            endings; if there is one chart, <name>.
        charts: The charts.
        folder: Folder of the files.

    Raises:
        OutputError: A file cannot be written.
    """
    paths: list[Path] = []
    for number, chart in enumerate(charts, 1):
        stem = name if len(charts) == 1 else f"{name}-{number}"
        paths += chart.save(folder / stem)
    return paths


def _describe_options(values: Mapping[str, Any]) -> str:
    """Return the options of a study in words for its caption, separated by "; ".

    `values` are the options by name.  Numbers, words and sequences are described;
    options of other types, such as tables of data, are left out.
    """
    described = []
    for name, value in values.items():
        if isinstance(value, str | float | int | Sequence) and value != ():
            described.append(f"{name} {_in_words(value)}")
    return "; ".join(described)


def _in_words(value: Any) -> str:
    """Return a number, word, range or list as a caption shows it.

    Seven or more items are shortened to the first two and the last.
    """
    if isinstance(value, range):
        return f"{value[0]} to {value[-1]}"
    if isinstance(value, float):
        return f"{value:g}"
    if not isinstance(value, tuple | list):
        return str(value)
    parts = []
    for item in value:
        words = _in_words(item)
        parts.append(f"({words})" if isinstance(item, tuple | list) else words)
    if len(parts) >= 7:
        parts = [*parts[:2], "…", parts[-1]]
    return ", ".join(parts)


def _draw(
    look: Look,
    table: pd.DataFrame,
    caption: str,
) -> Chart:
    """Return the chart of a table.

    Args:
        look: The look of the chart, or a function that draws the figure of a table.
        table: The data; rows that differ in the column `seed` are replaced by their
            means with 95 % intervals.
        caption: The caption.  Its first sentence is a question, the title of the chart.

    Raises:
        ValueError: The caption has no question mark.
    """
    question = caption[: caption.index("?") + 1]
    if not isinstance(look, Plot):
        rows = table.to_numpy().tolist()
        figure = look(table)
        write_question(figure, question)
        return Chart(figure, list(table), rows, typeset(caption, mathtext=False))
    if "seed" in table:
        count = table["seed"].nunique()
        caption += f" Means of {count} surfaces with their 95 % intervals."
        by = [*look.series, look.x.column]
        if look.colour:
            by.append(look.colour)
        table = mean_with_interval(table, look.y.column, list(dict.fromkeys(by)))
    return draw_table(table, replace(look, title=question), caption)
