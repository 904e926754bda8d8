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
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from epcontact.harness.methods.registry import Table

Scalar = bool | int | float | str
#: A point of a sweep: its values by their keys, such as "material.hardness".
Point = dict[str, Scalar]

#: Largest number of tasks of a sweep: weeks of small solves, and still a table that fits.
MOST_TASKS = 100_000


class Range(Table):
    """The values of a key from low to high, both included."""

    low: float = Field(allow_inf_nan=False)
    high: float = Field(allow_inf_nan=False)
    points: int | None = Field(default=None, ge=2)
    spacing: Literal["linear", "log"] = "linear"

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.low < self.high:
            raise ValueError(f"low is {self.low:g}, but must be less than high, {self.high:g}")
        if self.spacing == "log" and self.low <= 0:
            raise ValueError(f"low is {self.low:g}, but a spacing of 'log' needs a positive one")
        return self

    def at(self, shares: np.ndarray) -> list[float]:
        """Return the values at shares of the way from low to high.

        They have 12 digits, so that they are the same on every machine.
        """
        if self.spacing == "log":
            values = self.low * (self.high / self.low) ** shares
        else:
            values = self.low + (self.high - self.low) * shares
        return [float(f"{value:.12g}") for value in values]


def _different(values: list[Scalar]) -> list[Scalar]:
    if len(set(values)) < len(values):
        raise ValueError("a value is there twice; give each once")
    return values


_Values = Annotated[list[Scalar], Field(min_length=1), AfterValidator(_different)]
#: What a key takes: values, or a range.
Axis = Annotated[
    Annotated[_Values, Tag("values")] | Annotated[Range, Tag("range")],
    Discriminator(lambda given: "range" if isinstance(given, Mapping | Range) else "values"),
]
_Axes = dict[str, Axis]


def _joined(sections: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the keys of sections by their names, such as "material.hardness"."""
    return {
        f"{name}.{key}": value for name, keys in sections.items() for key, value in keys.items()
    }


class SweepTable(Table):
    """[sweep]: each section has the keys of the case's section, with lists or ranges."""

    surface: _Axes = Field(default={}, description="values of keys of [surface]")
    material: _Axes = Field(default={}, description="values of keys of [material]")
    body: _Axes = Field(default={}, description="values of keys of [body]")
    load: _Axes = Field(default={}, description="values of keys of [load]")
    theory: _Axes = Field(default={}, description="values of keys of [theory]")
    bem: _Axes = Field(default={}, description="values of keys of [bem]")
    fem: _Axes = Field(default={}, description="values of keys of [fem]")
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
    point: list[dict[str, dict[str, Scalar]]] = Field(
        default=[], description="values of keys that change together, one table for each point"
    )

    @property
    def axes(self) -> dict[str, list[Scalar] | Range]:
        """What each key takes, by its name such as "material.hardness"."""
        sections = ("surface", "material", "body", "load", "theory", "bem", "fem")
        return _joined({name: getattr(self, name) for name in sections})

    @property
    def tables(self) -> list[Point]:
        """The tables [[sweep.point]]."""
        return [_joined(point) for point in self.point]

    @property
    def sampled(self) -> dict[str, Range]:
        """The ranges that the Latin hypercube samples."""
        return {k: a for k, a in self.axes.items() if isinstance(a, Range) and a.points is None}

    @property
    def size(self) -> int:
        """The number of points."""
        counts = [len(a) if isinstance(a, list) else a.points or 1 for a in self.axes.values()]
        return math.prod(counts) * (self.samples or 1) * max(1, len(self.point))

    @model_validator(mode="after")
    def _answerable(self) -> Self:
        axes, tables, sampled = self.axes, self.tables, self.sampled
        if sampled and self.samples is None:
            raise ValueError(f"{min(sampled)} is a range; give points, or samples for the sweep")
        if self.samples is not None and not sampled:
            raise ValueError("samples is given, but no key is a range without points")
        if "seed" in self.model_fields_set and not sampled:
            raise ValueError("seed is of samples, but there are none; surfaces have seeds = [1, 2]")
        if not axes and not tables:
            raise ValueError("no key has values; give such as load.mean_pressure = [1e8, 2e8]")
        for number, table in enumerate(tables, start=1):
            if table.keys() != tables[0].keys():
                raise ValueError(f"point {number} and point 1 have different keys")
            if both := table.keys() & axes.keys():
                raise ValueError(f"point {number} gives {min(both)}, which has values of its own")
        if "surface.seeds" in {*axes, *(key for table in tables for key in table)}:
            raise ValueError("surface.seeds is not one value; give seeds = [1, 2, 3] instead")
        if self.size > MOST_TASKS:
            raise ValueError(f"it has {self.size} points, but at most {MOST_TASKS} can be kept")
        return self

    def points(self) -> Iterator[Point]:
        """Yield the points: tables, values and grids in the order of the file, then samples."""
        values = {
            key: axis if isinstance(axis, list) else axis.at(np.linspace(0, 1, axis.points or 2))
            for key, axis in self.axes.items()
            if key not in self.sampled
        }
        samples = list(self._samples())
        for table, combined in product(self.tables or [{}], product(*values.values())):
            for sample in samples:
                yield table | dict(zip(values, combined, strict=True)) | sample

    def _samples(self) -> Iterator[Point]:
        if not self.sampled:
            return iter([{}])
        from scipy.stats import qmc  # takes long to load

        shares = qmc.LatinHypercube(len(self.sampled), rng=np.random.default_rng(self.seed))
        columns = shares.random(self.samples or 1).T
        values = [a.at(column) for a, column in zip(self.sampled.values(), columns, strict=True)]
        return (dict(zip(self.sampled, row, strict=True)) for row in zip(*values, strict=True))
