"""A value of the grid, and its limit for a vanishing grid spacing."""

from __future__ import annotations

from typing import NamedTuple


class Limit(NamedTuple):
    """A value in the limit of a vanishing grid spacing.

    All three have the unit of the value.

    Attributes:
        corrected: the estimate of the limit.
        raw: the value on the grid.
        error: the estimated absolute error of `corrected`; some 94 of 100 errors are
            smaller.
    """

    corrected: float
    raw: float
    error: float

    def times(self, factor: float) -> Limit:
        """Return a new `Limit` with all numbers of this one times a positive factor."""
        return Limit(factor * self.corrected, factor * self.raw, factor * self.error)
