"""A value of the grid, and its limit for a vanishing grid spacing."""

from __future__ import annotations

from typing import NamedTuple


class Limit(NamedTuple):
    """A value in the limit of a vanishing grid spacing, as from the areas of a result.

    Attributes:
        corrected: the estimate of the limit.
        raw: the value of the grid's own points.
        error: the estimated absolute error of `corrected`, which covers some 94 of 100.
    """

    corrected: float
    raw: float
    error: float
