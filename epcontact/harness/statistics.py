"""Means of ensembles and Student's interval, which is computed only here."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PlainSerializer, WithJsonSchema

from epcontact.results import plain

CONFIDENCE = 0.95

#: A float that is written to JSON as inf, -inf or nan where JSON has no number for it.
Number = Annotated[
    float,
    PlainSerializer(plain, when_used="json"),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"enum": ["inf", "-inf", "nan"]}]}),
]


class Estimate(BaseModel):
    """A mean over surfaces with its 95 % interval."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    mean: Number
    half_width: Number = Field(
        alias="half_width_95", description="half the width of Student's interval; 0 for one"
    )
    count: int = Field(alias="surfaces", ge=0, description="number of averaged values")

    @property
    def low(self) -> float:
        """Lower end of the interval."""
        return self.mean - self.half_width

    @property
    def high(self) -> float:
        """Upper end of the interval."""
        return self.mean + self.half_width


def estimate(values: Sequence[float]) -> Estimate:
    """Return the mean of independent values with its 95 % interval.

    Args:
        values: one or more; a single value has an interval of width 0.

    Example:
        >>> mean = estimate([0.101, 0.103, 0.105])
        >>> f"{mean.mean:.3f} +- {mean.half_width:.3f}"
        '0.103 +- 0.005'
    """
    array = np.asarray(values, dtype=float)
    half_width = student_half_width(standard_deviation(values), array.size)
    return Estimate(mean=float(array.mean()), half_width_95=half_width, surfaces=array.size)


def standard_deviation(values: Sequence[float]) -> float:
    """Return the standard deviation of a single value, estimated from a sample; 0 for one."""
    array = np.asarray(values, dtype=float)
    return float(array.std(ddof=1)) if array.size > 1 else 0.0


def student_half_width(deviation: float, count: int) -> float:
    """Return half the width of Student's 95 % interval of a mean; 0 for one value.

    Args:
        deviation: standard deviation of a single value.
        count: number of averaged values.
    """
    return 0.0 if count == 1 else _student(count - 1) * deviation / math.sqrt(count)


@functools.cache
def _student(freedoms: int) -> float:
    """Return the t of P(|T| < t) = CONFIDENCE, Student's distribution of `freedoms` degrees.

    The closed form of P in the angle atan(t/sqrt(freedoms)) is that of Abramowitz and Stegun,
    26.7.3 and 26.7.4; it is concave, so that Newton's steps from 0 never pass the solution.  The
    same from scipy.special takes longer to load than three small surfaces to solve.
    """
    odd = freedoms % 2
    unit = 2 / math.pi if odd else 1.0
    log_slope = math.lgamma((freedoms + 1) / 2) - math.lgamma(freedoms / 2)
    angle, step = 0.0, 1.0
    while step > 1e-14:
        cosine = math.cos(angle)
        term = cosine if odd else 1.0
        total = 0.0
        for power in range(odd, freedoms - 1, 2):
            total += term
            term *= (power + 1) / (power + 2) * cosine**2
        inside = unit * (odd * angle + math.sin(angle) * total)
        slope = 2 / math.sqrt(math.pi) * math.exp(log_slope) * cosine ** (freedoms - 1)
        step = (CONFIDENCE - inside) / slope
        angle += step
    return math.sqrt(freedoms) * math.tan(angle)
