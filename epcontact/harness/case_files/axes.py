"""The table [sweep] of a case file: which keys take which values, and the points that they make.

    [sweep]
    load.mean_pressure = [1e8, 2e8, 4e8]                                    # these values
    material.hardness = { low = 2e9, high = 8e9, points = 3, spacing = "log" }  # a grid
    material.poisson_ratio = { low = 0.0, high = 0.45 }                     # sampled
    surface.hurst = { low = 0.5, high = 1.0 }                               # sampled
    samples = 20
    seeds = [1, 2, 3, 4]

Values and grids are combined, each with each, and with every sample.  Keys that change together
are tables [[sweep.point]], each of which gives all of them; they are combined with the rest, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, create_model, model_validator

from epcontact.harness.methods.registry import METHODS, Table

Scalar = bool | int | float | str
#: A point of a sweep: its values by their keys, such as "material.hardness".
Point = dict[str, Scalar]

#: Largest number of tasks of a sweep: weeks of small solves, and still a table that fits.
MOST_TASKS = 100_000

SECTIONS = ("surface", "material", "body", "load", *(m.table for m in METHODS.values() if m.table))


class Range(Table):
    """The values of a key from low to high, both included."""

    low: float = Field(allow_inf_nan=False)
    high: float = Field(allow_inf_nan=False)
    points: int | None = Field(default=None, ge=2)
    spacing: Literal["linear", "log"] = "linear"

    @model_validator(mode="after")
    def _ordered(self) -> Range:
        if not self.low < self.high:
            raise ValueError(f"low is {self.low:g}, but must be less than high, {self.high:g}")
        if self.spacing == "log" and self.low <= 0:
            raise ValueError(f"low is {self.low:g}, but a spacing of 'log' needs a positive one")
        return self

    def at(self, shares: np.ndarray) -> list[float]:
        """Return the values at shares of the way from low to high.

        They have 12 digits, so that they are the same on every machine.

        Example:
            >>> Range(low=1, high=100, spacing="log").at(np.array([0, 0.5, 1]))
            [1.0, 10.0, 100.0]
        """
        if self.spacing == "log":
            values = self.low * (self.high / self.low) ** shares
        else:
            values = self.low + (self.high - self.low) * shares
        return [float(f"{value:.12g}") for value in values]


def _axis(key: str, given: Any) -> list[Scalar] | Range:
    """Check what a key is to take.  Raises ValueError with a sentence."""
    if isinstance(given, Mapping):
        try:
            return Range.model_validate(given)
        except ValidationError as error:
            # A misspelt key is both unknown and missing.
            first = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
            where = ".".join(map(str, (key, *first["loc"])))
            reason = first["ctx"]["error"] if first["type"] == "value_error" else first["msg"]
            raise ValueError(
                f"{where}: {str(reason)[0].lower()}{str(reason)[1:]} (a range has low and "
                "high, and may have points and spacing)"
            ) from None
    if not isinstance(given, list):
        raise ValueError(f"{key} is {given!r:.60}; give a list of values, or low and high")
    if not given:
        raise ValueError(f"{key} is empty; give at least one value")
    for value in given:
        _require_scalar(key, value)
    if len(set(given)) < len(given):
        raise ValueError(f"{key} has a value twice; give each once")
    return given


def _require_scalar(key: str, value: Any) -> None:
    if not isinstance(value, Scalar):
        raise ValueError(f"{key} has {value!r:.60}, but a point of a sweep has one number or word")


def _flat(table: Mapping[str, Any], number: int) -> Point:
    """Return a table [[sweep.point]] with its keys joined by dots.  Raises ValueError."""
    found: Point = {}
    for section, values in table.items():
        if not isinstance(values, Mapping):
            raise ValueError(
                f"point {number} has {section}, which is no key such as load.mean_pressure"
            )
        for key, value in values.items():
            _require_scalar(f"point {number}: {section}.{key}", value)
            found[f"{section}.{key}"] = value
    return found


def _section(name: str) -> tuple[Any, Any]:
    return dict[str, Any], Field(default={}, description=f"values of keys of [{name}]")


class SweepTable(create_model("_Sections", __base__=Table, **{s: _section(s) for s in SECTIONS})):  # type: ignore[misc]
    """[sweep]: each section has the keys of the case's section, with lists or ranges."""

    seeds: list[Annotated[int, Field(ge=0)]] | None = Field(
        default=None, min_length=1, description="of the surfaces at every point; else the case's"
    )
    samples: int | None = Field(
        default=None, ge=1, description="points of a Latin hypercube of the ranges without points"
    )
    seed: int = Field(default=0, ge=0, description="of the Latin hypercube")
    quantities: list[str] = Field(
        default=[], description="quantities that are measured at every point, as for a gate"
    )
    point: list[dict[str, Any]] = Field(
        default=[], description="values of keys that change together, one table for each point"
    )

    @property
    def axes(self) -> dict[str, list[Scalar] | Range]:
        """What each key takes, by its name such as "material.hardness".  Raises ValueError."""
        given = {name: getattr(self, name) for name in SECTIONS}
        return {
            f"{section}.{key}": _axis(f"{section}.{key}", values)
            for section, keys in given.items()
            for key, values in keys.items()
        }

    @property
    def size(self) -> int:
        """The number of points."""
        counts = [len(a) if isinstance(a, list) else a.points or 1 for a in self.axes.values()]
        return math.prod(counts) * (self.samples or 1) * max(1, len(self.point))

    @model_validator(mode="after")
    def _answerable(self) -> SweepTable:
        axes, tables = self.axes, [_flat(t, n) for n, t in enumerate(self.point, start=1)]
        sampled = [key for key, a in axes.items() if isinstance(a, Range) and a.points is None]
        if sampled and self.samples is None:
            raise ValueError(f"{sampled[0]} is a range; give its points, or samples for the sweep")
        if self.samples is not None and not sampled:
            raise ValueError("samples is given, but no key is a range without points")
        if "seed" in self.model_fields_set and not sampled:
            raise ValueError(
                "seed is of samples, but there are none; surfaces have seeds = [1, 2, 3]"
            )
        for number, table in enumerate(tables, start=1):
            if table.keys() != tables[0].keys():
                raise ValueError(f"point {number} and point 1 have different keys")
            if both := table.keys() & axes.keys():
                raise ValueError(f"point {number} gives {min(both)}, which has values of its own")
        if not axes and not tables:
            raise ValueError("no key has values; give such as load.mean_pressure = [1e8, 2e8]")
        if "surface.seeds" in axes or any("surface.seeds" in table for table in tables):
            raise ValueError("surface.seeds is not one value; give seeds = [1, 2, 3] instead")
        if self.size > MOST_TASKS:
            raise ValueError(f"it has {self.size} points, but at most {MOST_TASKS} can be kept")
        return self

    def points(self) -> Iterator[Point]:
        """Yield the points: tables, values and grids in the order of the file, then samples."""
        axes = self.axes
        listed = {key: a for key, a in axes.items() if isinstance(a, list)}
        grids = {key: a for key, a in axes.items() if isinstance(a, Range) and a.points}
        values = listed | {k: a.at(np.linspace(0, 1, a.points or 2)) for k, a in grids.items()}
        values = {key: values[key] for key in axes if key in values}
        tables = [_flat(t, n) for n, t in enumerate(self.point, start=1)] or [{}]
        for table, combined in product(tables, product(*values.values())):
            for sample in self._samples():
                yield table | dict(zip(values, combined, strict=True)) | sample

    def _samples(self) -> list[Point]:
        sampled = {k: a for k, a in self.axes.items() if isinstance(a, Range) and not a.points}
        if not sampled:
            return [{}]
        from scipy.stats import qmc  # takes long to load

        shares = qmc.LatinHypercube(len(sampled), rng=np.random.default_rng(self.seed))
        columns = shares.random(self.samples or 1).T
        values = [a.at(column) for a, column in zip(sampled.values(), columns, strict=True)]
        return [dict(zip(sampled, row, strict=True)) for row in zip(*values, strict=True)]
