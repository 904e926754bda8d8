"""The table [sweep] of a case file: which keys take which values, and the points that
they make.

Values and grids are combined, each with each, and with every sample and every
[[sweep.point]].
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from epcontact.harness.methods.registry import Table

Scalar = bool | int | float | str
#: A point of a sweep: its values by their keys, such as "material.hardness".
Point = dict[str, Scalar]

#: Largest number of tasks of a sweep: weeks of small solves, and still a table that
#: fits.
MOST_TASKS = 100_000


def key(meaning: str, default: Any = ..., **limits: Any) -> Any:
    """Return a key of a table: its meaning with its unit, its default, and what it may
    be.
    """
    return Field(default, description=meaning, **limits)


class Range(Table):
    """The values of a key from low to high, both included."""

    low: float = Field(allow_inf_nan=False)
    high: float = Field(allow_inf_nan=False)
    points: int | None = Field(default=None, ge=2)
    spacing: Literal["linear", "log"] = "linear"

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.low < self.high:
            raise ValueError(
                f"low is {self.low:g}, but must be less than high, {self.high:g}"
            )
        if self.spacing == "log" and self.low <= 0:
            raise ValueError(
                f"low is {self.low:g}, but a spacing of 'log' needs a positive one"
            )
        return self

    def at(self, shares: np.ndarray) -> list[float]:
        """Return the values at shares of the way, in digits that are the same on every
        machine.
        """
        if self.spacing == "log":
            values = self.low * (self.high / self.low) ** shares
        else:
            values = self.low + (self.high - self.low) * shares
        return [float(f"{value:.12g}") for value in values]


#: What a key takes: values, or a range.
_Axis = Annotated[
    Annotated[list[Scalar], Field(min_length=1), Tag("values")]
    | Annotated[Range, Tag("range")],
    Discriminator(
        lambda given: "range" if isinstance(given, Mapping | Range) else "values"
    ),
]
_SECTIONS = ("surface", "material", "body", "load", "theory", "bem", "fem")


def _joined(sections: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the keys of sections by their names, such as "material.hardness"."""
    return {
        f"{name}.{key}": v for name, keys in sections.items() for key, v in keys.items()
    }


class SweepTable(Table):
    """[sweep]: each section has the keys of the case's section, with lists or
    ranges.
    """

    surface: dict[str, _Axis] = key("values of keys of [surface]", {})
    material: dict[str, _Axis] = key("values of keys of [material]", {})
    body: dict[str, _Axis] = key("values of keys of [body]", {})
    load: dict[str, _Axis] = key("values of keys of [load]", {})
    theory: dict[str, _Axis] = key("values of keys of [theory]", {})
    bem: dict[str, _Axis] = key("values of keys of [bem]", {})
    fem: dict[str, _Axis] = key("values of keys of [fem]", {})
    seeds: list[Annotated[int, Field(ge=0)]] | None = key(
        "of the surfaces at every point; else the case's", None, min_length=1
    )
    samples: int | None = key(
        "points of a Latin hypercube of the ranges without points", None, ge=1
    )
    seed: int = key("of the Latin hypercube", 0, ge=0)
    quantities: list[str] | None = key(
        "quantities that are measured at every point, as for a gate; else those of `epcontact run`",
        None,
    )
    point: list[dict[str, dict[str, Scalar]]] = key(
        "values of keys that change together, one table for each point", []
    )

    @property
    def _axes(self) -> dict[str, list[Scalar] | Range]:
        return _joined({name: getattr(self, name) for name in _SECTIONS})

    @property
    def _sampled(self) -> dict[str, Range]:
        return {
            k: a
            for k, a in self._axes.items()
            if isinstance(a, Range) and a.points is None
        }

    @property
    def size(self) -> int:
        """The number of points."""
        counts = [
            len(a) if isinstance(a, list) else a.points or 1
            for a in self._axes.values()
        ]
        return math.prod(counts) * (self.samples or 1) * max(1, len(self.point))

    @model_validator(mode="after")
    def _answerable(self) -> Self:
        axes, sampled = self._axes, self._sampled
        if sampled and self.samples is None:
            raise ValueError(
                f"{min(sampled)} is a range; give points, or samples for the sweep"
            )
        if not sampled and self.model_fields_set & {"samples", "seed"}:
            raise ValueError(
                "samples and seed are of ranges without points, but no key has such a range; "
                "surfaces have seeds = [1, 2]"
            )
        for key, axis in axes.items():
            if isinstance(axis, list) and len(set(axis)) < len(axis):
                raise ValueError(f"{key} has a value twice; give each once")
        if not axes and not self.point:
            raise ValueError(
                "no key has values; give such as load.mean_pressure = [1e8, 2e8]"
            )
        tables = [_joined(point) for point in self.point]
        for number, table in enumerate(tables, start=1):
            if table.keys() != tables[0].keys():
                raise ValueError(f"point {number} and point 1 have different keys")
            if both := table.keys() & axes.keys():
                raise ValueError(
                    f"point {number} gives {min(both)}, which has values of its own"
                )
        if "surface.seeds" in axes or any("surface.seeds" in table for table in tables):
            raise ValueError(
                "surface.seeds is not one value; give seeds = [1, 2, 3] instead"
            )
        if self.size > MOST_TASKS:
            raise ValueError(
                f"it has {self.size} points, but at most {MOST_TASKS} can be kept"
            )
        return self

    def points(self) -> Iterator[Point]:
        """Yield the points: tables, values and grids in the order of the file, then
        samples.
        """
        values = {
            key: axis
            if isinstance(axis, list)
            else axis.at(np.linspace(0, 1, axis.points or 2))
            for key, axis in self._axes.items()
            if key not in self._sampled
        }
        samples = self._samples()
        for table, combined in product(self.point or [{}], product(*values.values())):
            for sample in samples:
                yield _joined(table) | dict(zip(values, combined, strict=True)) | sample

    def _samples(self) -> list[Point]:
        if not (sampled := self._sampled):
            return [{}]
        from scipy.stats import qmc  # takes long to load

        shares = qmc.LatinHypercube(len(sampled), rng=np.random.default_rng(self.seed))
        columns = shares.random(self.samples or 1).T
        values = [
            axis.at(column)
            for axis, column in zip(sampled.values(), columns, strict=True)
        ]
        return [
            dict(zip(sampled, row, strict=True)) for row in zip(*values, strict=True)
        ]
