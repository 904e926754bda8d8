"""The result of a method: areas, residuals, pressure distribution, fields, cost and
provenance.

All methods return the same frozen class, so that a gate need not know which of them it
reads.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import math
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

#: The contact states of a grid point, in every field and picture.
APART, ELASTIC, PLASTIC = 0, 1, 2

#: What a table of loads shows, with its unit: corrected areas over the nominal area,
#: what follows from the fields of a load, the fractions of the contact points and of
#: the load on heights that were not measured but filled, and the hardness that the
#: load was solved with.  A flowed area is contact that has flowed at some load, which is all that J2
#: knows where a load has fallen.
COLUMNS: Mapping[str, str] = {
    "mean_pressure": "Pa",
    "total_area": "",
    "elastic_area": "",
    "plastic_area": "",
    "flowed_area": "",
    "mean_gap": "m",
    "stiffness_loading": "Pa/m",
    "stiffness_unloading": "Pa/m",
    "conductance": "1/m",
    "thermal_conductance": "W/(m2 K)",
    "electrical_conductance": "S/m2",
    "contact_percolation": "",
    "gap_percolation": "",
    "filled_contact": "",
    "filled_load": "",
    "hardness": "Pa",
}
#: What a contact conducts where the conductivities of its bodies are known.
CONDUCTING = ("thermal", "electrical")


@functools.cache  # reading package metadata takes longer than a solve of the theory
def package_versions() -> dict[str, str]:
    """Return the versions of this package, Python and the libraries that affect the
    numbers.
    """
    versions = {"python": platform.python_version()}
    for name in ("epcontact", "numpy", "scipy", "ducc0", "numba", "scikit-fem"):
        versions[name] = "not installed"
        with contextlib.suppress(PackageNotFoundError):
            versions[name] = version(name)
    return versions


@dataclass(frozen=True)
class Areas:
    """Contact areas as fractions of the nominal area; total = elastic + plastic."""

    total: float
    elastic: float
    plastic: float


@dataclass(frozen=True, eq=False)
class PressureDistribution:
    """The distribution of the nominal area over the contact pressures."""

    pressure: (
        FloatArray  #: (m,) ascending from 0 to the hardness or largest pressure, in Pa.
    )
    cumulative: FloatArray  #: (m,) share in *elastic* contact at a pressure in (0, pressure[i]].
    plastic: float = 0.0  #: Share of the nominal area at the hardness.

    def __post_init__(self) -> None:
        for name in ("pressure", "cumulative"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        object.__setattr__(self, "plastic", float(self.plastic))

    def __eq__(self, other: object) -> bool:
        """Whether both hold the same numbers."""
        return isinstance(other, PressureDistribution) and plain(self) == plain(other)

    def __hash__(self) -> int:
        return hash((self.plastic, self.pressure.size))


@dataclass(frozen=True)
class LoadStep:
    """The answer at one mean pressure (Pa) of the load path.

    Areas are "raw" (share of the grid points; the exact areas of a method without a
    grid), "corrected" (continuum limit) and "error" (their estimated error by the
    grid).  Other sources of error are such as "hardness_error", which the interval of
    an effective hardness makes.
    """

    mean_pressure: float
    areas: Mapping[str, Areas]
    residuals: Mapping[str, float] = field(
        default_factory=dict
    )  #: Those that decide, over a scale.
    iterations: Mapping[str, int] = field(
        default_factory=dict
    )  #: newton, cg, fft_pairs, ...
    quantities: Mapping[str, float] = field(
        default_factory=dict
    )  #: Others, such as mean_gap; SI.

    @property
    def row(self) -> dict[str, float]:
        """What is known of COLUMNS, each with "<name>_error" and
        "<name>_error_by_<source>".
        """
        found = {"mean_pressure": self.mean_pressure}
        known = {
            n.replace(".error", "_error_by_grid"): v for n, v in self.quantities.items()
        }
        for kind, areas in self.areas.items():
            source = kind.removesuffix("error").rstrip("_") or "grid"
            end = f"_error_by_{source}" if kind.endswith("error") else ""
            if end or kind == ("corrected" if "corrected" in self.areas else "raw"):
                known |= {
                    f"{part}_area{end}": area for part, area in vars(areas).items()
                }
        for name in COLUMNS:
            parts = {
                n: v
                for n, v in known.items()
                if n.startswith(f"{name}_error_by_") and v
            }
            whole = {f"{name}_error": math.hypot(*parts.values())} if parts else {}
            found |= {n: v for n, v in known.items() if n == name} | whole | parts
        return found

    def with_errors(self, shares: Mapping[str, float], source: str) -> LoadStep:
        """Add the errors of a source, as shares of what they belong to; of areas, of
        the total.
        """
        if not shares:
            return self
        total = self.areas["corrected" if "corrected" in self.areas else "raw"].total
        areas = Areas(
            *(
                total * shares[f"{part}_area"]
                for part in vars(next(iter(self.areas.values())))
            )
        )
        known = {
            name: share for name, share in shares.items() if name in self.quantities
        }
        errors = {
            f"{n}_error_by_{source}": abs(s * self.quantities[n])
            for n, s in known.items()
        }
        both = {**self.areas, f"{source}_error": areas}, {**self.quantities, **errors}
        return replace(self, areas=both[0], quantities=both[1])


@dataclass(frozen=True)
class Provenance:
    """The scene's digest, the surface's seed, the method's options and the libraries'
    versions.

    They are enough to make a result again.  `about` is the scene in words and figures:
    by name a `value`, its `unit` and its `meaning`.
    """

    scene: str
    seed: int | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(
        default_factory=lambda: dict(package_versions())
    )
    about: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, repr=False)
class ContactResult:
    """One scene answered by one method.

    Results are equal if their answers are, with fields, whatever they cost.  A notebook
    shows the table of loads.  There is a step for each mean pressure, and gates read
    the last one.  Its `distribution` is that of the pressures; `fields` are arrays on
    the surface's grid: heights, pressure, gap, displacement (SI units) and state
    (APART, ELASTIC, PLASTIC), or none.  `cost` has seconds, unknowns, peak_memory_bytes
    and the method's own counts over the path; `history` the residual that decides
    convergence, for each iteration of the last step.

    Raises:
        ValueError: There is no load step.
    """

    method: str
    steps: tuple[LoadStep, ...]
    provenance: Provenance
    distribution: PressureDistribution | None = None
    fields: Mapping[str, NDArray[Any]] = field(default_factory=dict, repr=False)
    cost: Mapping[str, float] = field(default_factory=dict)
    history: tuple[float, ...] = field(default=(), repr=False)
    notes: tuple[
        str, ...
    ] = ()  #: Sentences that the reader should see, as of a fallback.
    converged: bool = True  #: Whether the residuals met the tolerance.

    def __post_init__(self) -> None:
        if not self.steps:
            raise ValueError(
                "a ContactResult needs at least one load step, but steps is empty"
            )
        object.__setattr__(self, "fields", dict(self.fields))

    @property
    def final(self) -> LoadStep:
        """The last load step."""
        return self.steps[-1]

    @property
    def branches(self) -> tuple[str, ...]:
        """The branch of each load: "loading" if no load before it was larger, else
        "unloading", or "reloading" if the load grows again.
        """
        loads = [0.0, *(step.mean_pressure for step in self.steps)]
        most = itertools.accumulate(loads, max)
        return tuple(
            "loading"
            if after >= peak
            else "unloading"
            if after <= before
            else "reloading"
            for peak, (before, after) in zip(
                most, itertools.pairwise(loads), strict=False
            )
        )

    def table(self) -> pd.DataFrame:
        """Return a pandas table with a row a load; its columns end with their SI units,
        such as mean_pressure_Pa, total_area, total_area_error and
        total_area_error_by_grid.
        """
        import pandas as pd

        def titled(name: str) -> str:
            unit = (
                COLUMNS[name.partition("_error")[0]]
                .replace("1/", "per_")
                .replace("/", "_per_")
            )
            unit = unit.replace("(", "").replace(")", "").replace(" ", "_")
            return f"{name}_{unit}".rstrip("_")

        rows = [
            {titled(name): value for name, value in step.row.items()}
            for step in self.steps
        ]
        return pd.DataFrame(
            [{"branch": b} | r for b, r in zip(self.branches, rows, strict=True)]
        )

    def __repr__(self) -> str:
        row = self.final.row
        area, error = row["total_area"], row.get("total_area_error")
        loads = f"{len(self.steps)} load" + "s" * (len(self.steps) > 1)
        sure = "" if error is None else f" ± {error:.2g}"
        last = f"{area:.4g}{sure} at {row['mean_pressure']:.4g} Pa"
        return f"<ContactResult of {self.method}: {loads}, contact area {last}>"

    def _repr_html_(self) -> str:
        return str(
            self.table().to_html(float_format=lambda value: f"{value:.4g}", index=False)
        )

    def _answer(self) -> Any:
        return self.to_json() | {"cost": 0, "history": 0}

    def __eq__(self, other: object) -> bool:
        """Whether both give the same answer to the same scene."""
        return (
            isinstance(other, ContactResult)
            and self._answer() == other._answer()
            and self.fields.keys() == other.fields.keys()
            and all(
                np.array_equal(f, other.fields[name]) for name, f in self.fields.items()
            )
        )

    def __hash__(self) -> int:
        return hash((self.method, self.provenance.scene, len(self.steps)))

    def to_json(self) -> dict[str, Any]:
        """Return everything except the fields in JSON types; infinities become
        strings.
        """
        shown = {"method": self.method, "converged": self.converged} | vars(self.final)
        names = ("steps", "distribution", "cost", "history", "notes", "provenance")
        data: dict[str, Any] = plain(
            shown | {name: getattr(self, name) for name in names}
        )
        return data

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> ContactResult:
        """Read back the data of `to_json`, without the fields.

        Raises:
            KeyError, TypeError, ValueError: `data` is not such a result.
        """
        saved = data["distribution"]
        return cls(
            method=data["method"],
            steps=tuple(map(_step, data["steps"])),
            provenance=Provenance(**data["provenance"]),
            distribution=None if saved is None else PressureDistribution(**saved),
            cost=_numbers(data["cost"]),
            history=tuple(map(float, data["history"])),
            notes=tuple(map(str, data["notes"])),
            converged=data["converged"],
        )


def _step(data: Mapping[str, Any]) -> LoadStep:
    return LoadStep(
        float(data["mean_pressure"]),
        {name: Areas(**_numbers(areas)) for name, areas in data["areas"].items()},
        _numbers(data["residuals"]),
        _numbers(data["iterations"]),
        _numbers(data["quantities"]),
    )


def _numbers(data: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: float(v) if isinstance(v, str) else +v for name, v in data.items()
    }  # no lists


def plain(value: Any) -> Any:
    """Return `value` in JSON types; a number that JSON cannot hold as "inf", "-inf" or
    "nan".
    """
    if isinstance(value, float):  # first, because most values are such numbers
        return float(value) if math.isfinite(value) else str(float(value))
    if value is None or isinstance(value, str | int):
        return value
    if is_dataclass(value):
        value = vars(value)
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if not isinstance(value, Sequence) or isinstance(value, bytes):
        raise TypeError(f"{value!r:.60} is nothing that JSON can hold")
    # Most of a result is lists of finite numbers.
    finite = set(map(type, value)) == {float} and all(map(math.isfinite, value))
    return list(value) if finite else [plain(item) for item in value]
