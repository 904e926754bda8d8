"""The result of a method: areas, residuals, pressures, fields, cost and provenance.

All methods return the same frozen class, so that a gate reads any of them alike.
"""

from __future__ import annotations

import contextlib
import functools
import math
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

#: The contact states of a grid point, in every field and picture.
APART = 0
ELASTIC = 1
PLASTIC = 2

#: The columns of a table of loads, with their units: corrected areas over the nominal
#: area, quantities that follow from the fields of a load, the fractions of the contact
#: points and of the load on heights that were not measured but filled, and the hardness
#: of the load.  "flowed_area" is the contact that has flowed at some load; it replaces
#: the plastic area of a J2 body whose load has fallen.  "flowed_share" is the fraction
#: of the grid points that flow or have flowed before, in contact or not: of a load at
#: which points stay flattened that do not flow any more.
COLUMNS: Mapping[str, str] = {
    "mean_pressure": "Pa",
    "total_area": "",
    "elastic_area": "",
    "plastic_area": "",
    "flowed_area": "",
    "flowed_share": "",
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
#: Kinds of conductivity that a case can give for its two bodies.
CONDUCTING = ("thermal", "electrical")


@functools.cache  # reading package metadata takes longer than a solve of the theory
def package_versions() -> dict[str, str]:
    """Return versions by name: of python, epcontact and the numerical libraries.

    A package that is missing has "not installed" instead of a version.
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


#: Factor from an error estimate that covers nine of ten errors to the half-width of a
#: 95 % interval: the ratio of these quantiles of a normal distribution, 1.960 / 1.645.
#: On 316 areas of `laboratory.area_bank` (seeds 15000 to 15003 of all kinds but heights
#: in steps, 64 and 128 points) the estimates cover 94.3 %, and 1.19 times them 95.6 %:
#: 98.5 % of smooth and unloaded kinds, 90.0 % of sharp ones.
FACTOR_TO_95 = 1.19
#: Each source of the error of a value, and the factor from its estimate to the
#: half-width of a 95 % interval.  The estimate of an effective hardness is such a
#: half-width already, and those of a removed form and of missing heights cover 93 to
#: 100 % (`alternatives`).
ERROR_SOURCES = MappingProxyType(
    {
        "grid": FACTOR_TO_95,
        "hardness": 1.0,
        "treatment": FACTOR_TO_95,
        "form": 1.0,
        "missing": 1.0,
    }
)


def factor_to_95(source: str) -> float:
    """Return the factor from an error estimate to the half-width of a 95 % interval.

    Args:
        source: Name of the source of error, of `ERROR_SOURCES` or another.
    """
    return ERROR_SOURCES.get(source, 1.0)


@dataclass(frozen=True, eq=False)
class PressureDistribution:
    """The distribution of the nominal area over the contact pressures.

    Attributes:
        pressure: Pressures in Pa, ascending from 0 to the hardness or the largest
            pressure, (m,).
        cumulative: Fraction of the nominal area in *elastic* contact at a pressure in
            (0, pressure[i]], (m,).
        plastic: Fraction of the nominal area at the hardness.
    """

    pressure: FloatArray
    cumulative: FloatArray
    plastic: float = 0.0

    def __post_init__(self) -> None:
        """Copy the arrays and make the copies read-only."""
        for name in ("pressure", "cumulative"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        object.__setattr__(self, "plastic", float(self.plastic))

    def __eq__(self, other: object) -> bool:
        """Return whether both hold the same numbers."""
        return isinstance(other, PressureDistribution) and plain(self) == plain(other)

    def __hash__(self) -> int:
        """Return a hash that equal distributions share."""
        return hash((self.plastic, self.pressure.size))


@dataclass(frozen=True)
class LoadStep:
    """The result at one load of the path.

    Attributes:
        mean_pressure: In Pa.
        areas: Areas by kind: "raw" (fraction of the grid points; exact for a method
            without a grid), "corrected" (limit of a vanishing grid spacing), "error"
            (error estimate of the corrected areas) and errors from other sources, such
            as "hardness_error".
        residuals: Dimensionless residuals that decide convergence, by name.
        iterations: Counts such as newton, cg and fft_pairs.
        quantities: Other quantities in SI units, such as mean_gap.
    """

    mean_pressure: float
    areas: Mapping[str, Areas]
    residuals: Mapping[str, float] = field(default_factory=dict)
    iterations: Mapping[str, int] = field(default_factory=dict)
    quantities: Mapping[str, float] = field(default_factory=dict)

    @property
    def best_areas(self) -> Areas:
        """The corrected areas, or the raw ones of a method without a correction.

        They are fractions of the nominal area.
        """
        if "corrected" in self.areas:
            return self.areas["corrected"]
        return self.areas["raw"]

    @property
    def row(self) -> dict[str, float]:
        """The columns of COLUMNS that this load has, by name, with their errors.

        Values are in the units of COLUMNS.  A value with errors is followed by
        "<name>_error_by_<source>" for each source of error, and before these by
        "<name>_error", the root of the sum of their squares.  Each is the half-width of
        a 95 % interval; estimates that cover nine of ten errors are multiplied by
        `FACTOR_TO_95`.
        """
        values = {"mean_pressure": self.mean_pressure, **self.quantities}
        raw = self.areas.get("raw")
        if raw is not None and values.get("flowed_share") == raw.plastic:
            del values["flowed_share"]  # the plastic area says the same
        for part, area in vars(self.best_areas).items():
            values[f"{part}_area"] = area
        row = {}
        for column in COLUMNS:
            if column in values:
                row[column] = values[column]
            errors = {
                f"{column}_error_by_{source}": error
                for source, error in self.error_parts(column).items()
                if error
            }
            if errors:
                row[f"{column}_error"] = math.hypot(*errors.values())
                row |= errors
        return row

    def error_parts(self, name: str) -> dict[str, float]:
        """Return the errors of a value at this load, by their source.

        Each is the half-width of a 95 % interval in the unit of the value: an estimate
        that covers nine of ten errors is multiplied by `FACTOR_TO_95`.  An error of 0
        is one that the method states; no entry means that no error is known.

        Args:
            name: "total_area", "elastic_area" or "plastic_area", for the areas of
                `best_areas`; or a key of `quantities`, such as "mean_gap".
        """
        estimates = {}
        prefix = f"{name}_error_by_"
        for quantity, value in self.quantities.items():
            error_name = quantity.replace(".error", "_error_by_grid")
            if error_name.startswith(prefix):
                estimates[error_name.removeprefix(prefix)] = value
        if name in ("total_area", "elastic_area", "plastic_area"):
            part = name.removesuffix("_area")
            for kind, areas in self.areas.items():
                if kind.endswith("error"):
                    source = kind.removesuffix("error").rstrip("_") or "grid"
                    estimates[source] = getattr(areas, part)
        return {
            source: estimate * factor_to_95(source)
            for source, estimate in estimates.items()
        }

    def with_errors(
        self, relative_errors: Mapping[str, float], source: str
    ) -> LoadStep:
        """Return a copy of this step with the errors that one source causes.

        Args:
            relative_errors: Error by name, as a fraction of the quantity of this name.
                The errors of total_area, elastic_area and plastic_area, which must be
                given, are fractions of the total area.  Without any errors the step
                itself is returned.
            source: Name of the source of error, such as "treatment".

        Raises:
            KeyError: The error of an area is missing.
        """
        if not relative_errors:
            return self
        total = self.best_areas.total
        area_error = Areas(
            total=total * relative_errors["total_area"],
            elastic=total * relative_errors["elastic_area"],
            plastic=total * relative_errors["plastic_area"],
        )
        quantities = dict(self.quantities)
        for name, relative_error in relative_errors.items():
            if name in self.quantities:
                error = abs(relative_error * self.quantities[name])
                quantities[f"{name}_error_by_{source}"] = error
        areas = {**self.areas, f"{source}_error": area_error}
        return replace(self, areas=areas, quantities=quantities)


@dataclass(frozen=True)
class Provenance:
    """What is needed to compute a result again.

    Attributes:
        scene: Digest of the scene.
        seed: Seed of the surface; None if it has none.
        options: Options of the method.
        versions: Versions of Python, this package and the libraries.
        about: The scene in words and numbers: by name a `value`, its `unit` and its
            `meaning`.
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
    """The result of one method for one scene.

    Two results are equal if their numbers and fields are equal, whatever their cost.  A
    notebook shows the table of loads.

    Attributes:
        method: Name of the method.
        steps: A step for each mean pressure of the load path; gates read the last one.
        provenance: What is needed to compute the result again.
        distribution: Distribution of the pressure at the last load; None if not known.
        fields: Arrays on the surface's grid at the last load: heights, pressure, gap
            and displacement in SI units, and state (APART, ELASTIC, PLASTIC); or none.
        cost: seconds, unknowns, peak_memory_bytes and the method's own counts, over the
            path.
        history: Residual that decides convergence after each iteration of the last
            step.
        notes: Sentences for the reader, such as a warning.
        converged: Whether the residuals met the tolerance.

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
    notes: tuple[str, ...] = ()
    converged: bool = True

    def __post_init__(self) -> None:
        """Copy the mapping of fields; raise ValueError if there is no load step."""
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
    def is_foreign(self) -> bool:
        """Whether a solver from outside the package gave the result."""
        return "solver" in self.provenance.options

    @property
    def branches(self) -> tuple[str, ...]:
        """The branch of each load step: "loading", "unloading" or "reloading".

        A load is on the branch "loading" if no earlier load was larger.  Otherwise it
        is on "unloading" if it is at most the load before it, and on "reloading" if it
        is larger than that.
        """
        branches = []
        previous = 0.0
        peak = 0.0
        for step in self.steps:
            load = step.mean_pressure
            if load >= peak:
                branches.append("loading")
            elif load <= previous:
                branches.append("unloading")
            else:
                branches.append("reloading")
            previous = load
            peak = max(peak, load)
        return tuple(branches)

    def table(self) -> pd.DataFrame:
        """Return a pandas table with a row for each load.

        Names of columns end with their SI units, such as mean_pressure_Pa, total_area,
        total_area_error and total_area_error_by_grid.
        """
        import pandas as pd

        rows = []
        for branch, step in zip(self.branches, self.steps, strict=True):
            row = {_with_unit(name): value for name, value in step.row.items()}
            rows.append({"branch": branch, **row})
        return pd.DataFrame(rows)

    def __repr__(self) -> str:
        """Return the method, the number of loads and the contact area at the last."""
        row = self.final.row
        area = f"{row['total_area']:.4g}"
        if "total_area_error" in row:
            area += f" ± {row['total_area_error']:.2g}"
        loads = f"{len(self.steps)} loads"
        if len(self.steps) == 1:
            loads = "1 load"
        return (
            f"<ContactResult of {self.method}: {loads}, contact area {area} at "
            f"{row['mean_pressure']:.4g} Pa>"
        )

    def _repr_html_(self) -> str:
        """Return the table of loads as HTML, which a notebook shows."""
        table = self.table()
        return str(table.to_html(float_format="{:.4g}".format, index=False))

    def _without_cost(self) -> Any:
        """Return the data of `to_json` with cost and history replaced by 0.

        Both differ between runs that have the same results.
        """
        return self.to_json() | {"cost": 0, "history": 0}

    def __eq__(self, other: object) -> bool:
        """Return whether both hold the same numbers and fields for the same scene."""
        return (
            isinstance(other, ContactResult)
            and self._without_cost() == other._without_cost()
            and self.fields.keys() == other.fields.keys()
            and all(np.array_equal(f, other.fields[n]) for n, f in self.fields.items())
        )

    def __hash__(self) -> int:
        """Return a hash that equal results share."""
        return hash((self.method, self.provenance.scene, len(self.steps)))

    def to_json(self) -> dict[str, Any]:
        """Return the result, without its fields, in JSON types.

        The values of the last load step are at the top, too, beside "steps".  See
        `plain` for numbers that JSON cannot hold.
        """
        data = {"method": self.method, "converged": self.converged, **vars(self.final)}
        names = ("steps", "distribution", "cost", "history", "notes", "provenance")
        for name in names:
            data[name] = getattr(self, name)
        json_data: dict[str, Any] = plain(data)
        return json_data

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> ContactResult:
        """Return a result, without fields, from the data that `to_json` returned.

        Raises:
            KeyError, TypeError, ValueError: `data` has not the form of these data.
        """
        distribution = None
        if data["distribution"] is not None:
            distribution = PressureDistribution(**data["distribution"])
        return cls(
            method=data["method"],
            steps=tuple(_load_step(step) for step in data["steps"]),
            provenance=Provenance(**data["provenance"]),
            distribution=distribution,
            cost=_numbers(data["cost"]),
            history=tuple(map(float, data["history"])),
            notes=tuple(map(str, data["notes"])),
            converged=data["converged"],
        )


def _load_step(data: Mapping[str, Any]) -> LoadStep:
    """Return the load step of one item of "steps" in `ContactResult.to_json`.

    Raises KeyError, TypeError or ValueError if the data have another form.
    """
    areas = {kind: Areas(**_numbers(values)) for kind, values in data["areas"].items()}
    return LoadStep(
        mean_pressure=float(data["mean_pressure"]),
        areas=areas,
        residuals=_numbers(data["residuals"]),
        iterations=_numbers(data["iterations"]),
        quantities=_numbers(data["quantities"]),
    )


def _numbers(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of numbers by name, with strings such as "inf" read as numbers.

    Raises TypeError for other values, such as lists, and ValueError for other strings.
    """
    numbers = {}
    for name, value in data.items():
        if isinstance(value, str):
            numbers[name] = float(value)
        else:
            numbers[name] = +value  # raises TypeError for a value that is no number
    return numbers


def _with_unit(column: str) -> str:
    """Return a column's name with its SI unit: "mean_pressure" gives "..._Pa".

    column: a name of COLUMNS, or such a name with "_error" or "_error_by_<source>".
    """
    unit = COLUMNS[column.partition("_error")[0]]
    unit = unit.replace("1/", "per_").replace("/", "_per_")
    unit = unit.replace("(", "").replace(")", "").replace(" ", "_")
    return f"{column}_{unit}".rstrip("_")


def plain(value: Any) -> Any:
    """Return a value in types that JSON has: dict, list, str, int, float, bool, None.

    Numbers that JSON cannot hold become "inf", "-inf" or "nan".  Paths become strings,
    arrays become lists, and dataclasses become dicts of their fields.

    Raises:
        TypeError: The value, or one inside of it, has no such form.
    """
    if isinstance(value, float):  # first, because most values are such numbers
        number = float(value)  # a numpy.float64 becomes a float of Python
        return number if math.isfinite(number) else str(number)
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
        raise TypeError(f"{value!r:.60} cannot be written as JSON")
    # Most of a result is lists of finite numbers, which are copied as they are.
    is_finite = set(map(type, value)) == {float} and all(map(math.isfinite, value))
    return list(value) if is_finite else [plain(item) for item in value]
