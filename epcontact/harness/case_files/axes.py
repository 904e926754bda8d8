"""The table [sweep] of a case file: which keys take which values, and its points.

The values of each key are combined with those of every other key, and with every
[[sweep.point]].
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from epcontact.harness.methods.registry import Table

Scalar = bool | int | float | str
#: A point of a sweep: its values by their keys, such as "material.hardness".
Point = dict[str, Scalar]

#: Largest number of tasks of a sweep: weeks of small solves, in a table that fits into
#: memory.
MOST_TASKS = 100_000


def key(meaning: str, default: Any = ..., **limits: Any) -> Any:
    """Return a key of a table.

    Args:
        meaning: what the key is, with its unit.
        default: its value if it is not given; `...`: it must be given.
        limits: what the value may be, see `pydantic.Field`.
    """
    return Field(default, description=meaning, **limits)


#: The values that a key takes.
_Values = Annotated[list[Scalar], Field(min_length=1)]
_SECTIONS = ("surface", "material", "body", "load", "theory", "bem", "fem")


def _joined(sections: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the values of the keys of several tables, by names such as
    "material.hardness".

    `sections` are the tables by their names.
    """
    joined = {}
    for section, keys in sections.items():
        for name, value in keys.items():
            joined[f"{section}.{name}"] = value
    return joined


class SweepTable(Table):
    """[sweep]: each section has the keys of the case's section, with lists of
    values.
    """

    surface: dict[str, _Values] = key("values of keys of [surface]", {})
    material: dict[str, _Values] = key("values of keys of [material]", {})
    body: dict[str, _Values] = key("values of keys of [body]", {})
    load: dict[str, _Values] = key("values of keys of [load]", {})
    theory: dict[str, _Values] = key("values of keys of [theory]", {})
    bem: dict[str, _Values] = key("values of keys of [bem]", {})
    fem: dict[str, _Values] = key("values of keys of [fem]", {})
    seeds: list[Annotated[int, Field(ge=0)]] | None = key(
        "of the surfaces at every point; else the case's", None, min_length=1
    )
    quantities: list[str] | None = key(
        "quantities that are measured at every point, as for a gate; else those of "
        "`epcontact run`",
        None,
    )
    point: list[dict[str, dict[str, Scalar]]] = key(
        "values of keys that change together, one table for each point", []
    )

    @property
    def _values(self) -> dict[str, list[Scalar]]:
        """The values of each key by its name, such as "material.hardness"."""
        return _joined({name: getattr(self, name) for name in _SECTIONS})

    @property
    def size(self) -> int:
        """The number of points of this sweep."""
        counts = [len(values) for values in self._values.values()]
        return math.prod(counts) * max(1, len(self.point))

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        """Return this table [sweep]; raise ValueError with its first mistake."""
        for mistake in self._mistakes():
            raise ValueError(mistake)
        return self

    def _mistakes(self) -> Iterator[str]:
        """Yield a sentence for each mistake of this table [sweep], such as a key that
        has a value twice, or too many points.
        """
        listed = self._values
        points = [_joined(point) for point in self.point]
        for name, values in listed.items():
            if len(set(values)) < len(values):
                yield f"{name} has a value twice; give each once"
        if not listed and not points:
            yield "no key has values; give such as load.mean_pressure = [1e8, 2e8]"
        for number, point in enumerate(points, start=1):
            if point.keys() != points[0].keys():
                yield f"point {number} and point 1 have different keys"
            both = point.keys() & listed.keys()
            if both:
                yield f"point {number} gives {min(both)}, which has values of its own"
        if any("surface.seeds" in keys for keys in (listed, *points)):
            yield "surface.seeds is not one value; give seeds = [1, 2, 3] instead"
        if self.size > MOST_TASKS:
            yield f"it has {self.size} points, but at most {MOST_TASKS} can be kept"

    def points(self) -> Iterator[Point]:
        """Yield the points of this sweep in the order of the file.

        Each is a new dictionary of values by their keys, such as "material.hardness".
        """
        names = self._values.keys()
        for point in self.point or [{}]:
            for values in product(*self._values.values()):
                yield _joined(point) | dict(zip(names, values, strict=True))
