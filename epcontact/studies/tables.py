"""Tables of studies: one row for each point, columns named with their units.

Studies share these functions for means over surfaces, their intervals and their captions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
import pandas as pd

from epcontact.harness.gates.statistics import estimate

Size = Literal["fast", "full"]
#: Called with a sentence before each longer piece of work.
Progress = Callable[[str], None]


def mean_with_interval(
    table: pd.DataFrame, value: str, by: list[str], shared_error: str = ""
) -> pd.DataFrame:
    """Average a column over the rows of each group, with the 95 % interval of the mean.

    Args:
        table: one row for each surface and group.
        value: the column that is averaged.
        by: the columns that name a group.
        shared_error: a column of errors that the rows of a group have in common, so that they do
            not average out; their mean is added to the half-width in quadrature.

    Returns:
        One row for each group, in the order of their first rows: `by`, `<value>`, `<value>_low` and
        `<value>_high`.  The interval is Student's; of a single row it has no width.

    Example:
        >>> table = pd.DataFrame({"load": [1, 1, 2], "area": [0.1, 0.3, 0.5]})
        >>> mean_with_interval(table, "area", ["load"]).round(2).to_dict("records")[0]
        {'load': 1, 'area': 0.2, 'area_low': -1.07, 'area_high': 1.47}
    """
    groups = table.groupby(by, sort=False)
    mean = groups[value].mean()
    half_width = groups[value].agg(lambda values: estimate(values.to_numpy()).half_width)
    if shared_error:
        half_width = np.hypot(half_width, groups[shared_error].mean())
    bounds = {f"{value}_low": mean - half_width, f"{value}_high": mean + half_width}
    return pd.DataFrame({value: mean} | bounds).reset_index()


def root_mean_square(table: pd.DataFrame, value: str, by: list[str]) -> pd.DataFrame:
    """Root mean square of a column over the rows of each group, in the order of their first rows.

    Example:
        >>> table = pd.DataFrame({"points": [4, 4], "error": [0.3, 0.4]})
        >>> float(root_mean_square(table, "error", ["points"])["error"].iloc[0].round(4))
        0.3536
    """
    squares = table.assign(**{value: table[value] ** 2})
    means = squares.groupby(by, sort=False)[value].mean()
    return np.sqrt(means).reset_index()


def listed(table: pd.DataFrame, form: str) -> str:
    """List the rows of a table for a caption: `form` with the columns filled in.

    Example:
        >>> table = pd.DataFrame({"points": [4, 8], "error": [0.1, 0.05]})
        >>> listed(table, "{error:.2g} at {points}")
        '0.1 at 4, 0.05 at 8'
    """
    return ", ".join(form.format(**row) for row in table.to_dict("records"))
