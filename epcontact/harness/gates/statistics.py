"""Means of ensembles and Student's interval, which is computed only here."""

from __future__ import annotations

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


class Record(BaseModel):
    """A part of verdict.json."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Estimate(Record):
    """A mean over surfaces with its 95 % interval."""

    mean: Number
    half_width: Number = Field(
        alias="half_width_95", description="half the width of Student's interval; 0 for one"
    )
    count: int = Field(alias="surfaces", ge=0, description="number of averaged values")


def estimate(values: Sequence[float]) -> Estimate:
    """Return the mean of independent values with its 95 % interval, of width 0 for one value."""
    array = np.asarray(values, dtype=float)
    half_width = student_half_width(standard_deviation(values), array.size)
    return Estimate(mean=float(array.mean()), half_width_95=half_width, surfaces=array.size)


def standard_deviation(values: Sequence[float]) -> float:
    """Return the standard deviation of a single value, estimated from a sample; 0 for one."""
    array = np.asarray(values, dtype=float)
    return float(array.std(ddof=1)) if array.size > 1 else 0.0


def student_half_width(deviation: float, count: int) -> float:
    """Return half of Student's 95 % interval of a mean of `count` values; 0 for one value.

    `deviation` is the standard deviation of a single value.
    """
    if count == 1:
        return 0.0
    from scipy.special import stdtrit  # takes longer to load than a solve of one small surface

    factor = float(stdtrit(count - 1, 0.5 + CONFIDENCE / 2))
    return factor * deviation / math.sqrt(count)
