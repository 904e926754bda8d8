"""What a method returns: areas, residuals, pressure distribution, fields, cost and provenance.

The same shape serves the theory, the boundary elements and the finite elements, so that a gate
need not know which of them it reads.  Results are frozen; their JSON form is `to_json`, read
back by `from_json` without the fields, which live in VTK files.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Contact state of a grid point, in every field and picture.
APART, ELASTIC, PLASTIC = 0, 1, 2


def package_versions() -> dict[str, str]:
    """Versions of this package, of Python and of the libraries that decide the numbers."""
    versions = {"python": platform.python_version()}
    for name in ("epcontact", "numpy", "scipy", "ducc0", "numba", "scikit-fem"):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = "not installed"
    return versions


@dataclass(frozen=True)
class Areas:
    """Contact areas as fractions of the nominal area; total = elastic + plastic."""

    total: float
    elastic: float
    plastic: float


@dataclass(frozen=True)
class PressureDistribution:
    """How the nominal area is shared out over the contact pressures.

    pressure: (m,) ascending from 0 to the hardness, or to the largest pressure, in Pa.
    cumulative: (m,) fraction of the nominal area in *elastic* contact at a pressure in
        (0, pressure[i]]; the last one is the elastic area.
    plastic: fraction of the nominal area at the hardness.
    """

    pressure: FloatArray
    cumulative: FloatArray
    plastic: float = 0.0

    def __post_init__(self) -> None:
        for name in ("pressure", "cumulative"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, name, array)


@dataclass(frozen=True)
class LoadStep:
    """The answer at one mean pressure of the load path.

    areas: "raw" (share of grid points; the exact areas where there is no grid), "corrected"
        (continuum limit), and "error" (estimated absolute error of the corrected ones).
    residuals: dimensionless, by name; what "converged" was judged by.
    iterations: counts by name (newton, cg, fft_pairs, ...).
    quantities: further figures by name in SI units, such as mean_gap.
    """

    mean_pressure: float
    areas: Mapping[str, Areas]
    residuals: Mapping[str, float] = field(default_factory=dict)
    iterations: Mapping[str, int] = field(default_factory=dict)
    quantities: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Provenance:
    """Where a result comes from: enough to make it again."""

    scene: str
    seed: int | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=package_versions)


@dataclass(frozen=True)
class ContactResult:
    """One scene answered by one method.

    method: "persson", "bem" or "fem", with what distinguishes it, if anything, in
        provenance.options.
    steps: one LoadStep a mean pressure; the last is the answer that gates read by default.
    distribution: of the pressures, at the last step.
    fields: arrays on the surface's grid at the last step: heights, pressure, gap, displacement
        (SI units) and state (APART, ELASTIC, PLASTIC); empty where the method has none.
    cost: seconds, unknowns, peak_memory_bytes and the method's own counts over the whole path.
    history: of the deciding residual, one value an iteration of the last step.
    notes: sentences the reader should see, such as a fallback that was taken.
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
        object.__setattr__(self, "fields", dict(self.fields))

    @property
    def final(self) -> LoadStep:
        """The last load step."""
        return self.steps[-1]

    def to_json(self) -> dict[str, Any]:
        """Everything but the fields, as what JSON can hold; infinities become words."""
        final = self.final
        return {
            "method": self.method,
            "converged": self.converged,
            "mean_pressure": final.mean_pressure,
            "areas": {name: asdict(areas) for name, areas in final.areas.items()},
            "residuals": _plain(final.residuals),
            "iterations": _plain(final.iterations),
            "quantities": _plain(final.quantities),
            "steps": [_plain(asdict(step)) for step in self.steps],
            "distribution": _plain(None if self.distribution is None else vars(self.distribution)),
            "cost": _plain(self.cost),
            "history": _plain(self.history),
            "notes": list(self.notes),
            "provenance": _plain(asdict(self.provenance)),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> ContactResult:
        """The inverse of `to_json`, without fields.

        Raises KeyError, TypeError or ValueError if `data` is no such result.
        """
        distribution = data["distribution"]
        return cls(
            method=data["method"],
            steps=tuple(_step_from_json(step) for step in data["steps"]),
            provenance=Provenance(**data["provenance"]),
            distribution=None
            if distribution is None
            else PressureDistribution(
                np.array([number_from_json(p) for p in distribution["pressure"]]),
                np.array([number_from_json(c) for c in distribution["cumulative"]]),
                number_from_json(distribution["plastic"]),
            ),
            cost=_numbers(data["cost"]),
            history=tuple(number_from_json(value) for value in data["history"]),
            notes=tuple(data["notes"]),
            converged=data["converged"],
        )


def _plain(value: Any) -> Any:
    """`value` with arrays, tuples and infinities turned into what JSON can hold."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | tuple | list):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    return number_to_json(value) if isinstance(value, float) else value


def _numbers(data: Mapping[str, Any]) -> dict[str, Any]:
    return {key: float(v) if isinstance(v, str) else v for key, v in data.items()}


def _step_from_json(data: Mapping[str, Any]) -> LoadStep:
    return LoadStep(
        mean_pressure=data["mean_pressure"],
        areas={name: Areas(**_numbers(areas)) for name, areas in data["areas"].items()},
        residuals=_numbers(data["residuals"]),
        iterations=data["iterations"],
        quantities=_numbers(data["quantities"]),
    )


def number_to_json(value: float) -> float | str:
    """A number as JSON can hold it: infinities and NaN become the words inf, -inf and nan."""
    return value if math.isfinite(value) else str(float(value))


def number_from_json(value: float | str) -> float:
    """The inverse of `number_to_json`."""
    return float(value)
