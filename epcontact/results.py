"""The result of a method: areas, residuals, pressure distribution, fields, cost and provenance.

All methods return the same frozen class, so that a gate need not know which of them it reads.
"""

from __future__ import annotations

import contextlib
import functools
import math
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: The contact states of a grid point, in every field and picture.
APART, ELASTIC, PLASTIC = 0, 1, 2


@functools.cache  # reading package metadata takes longer than a solve of the theory
def package_versions() -> dict[str, str]:
    """Return the versions of this package, Python and the libraries that affect the numbers."""
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


@dataclass(frozen=True)
class PressureDistribution:
    """The distribution of the nominal area over the contact pressures."""

    pressure: FloatArray  #: (m,) ascending from 0 to the hardness or largest pressure, in Pa.
    cumulative: FloatArray  #: (m,) share in *elastic* contact at a pressure in (0, pressure[i]].
    plastic: float = 0.0  #: Share of the nominal area at the hardness.

    def __post_init__(self) -> None:
        for name in ("pressure", "cumulative"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        object.__setattr__(self, "plastic", float(self.plastic))


@dataclass(frozen=True)
class LoadStep:
    """The answer at one mean pressure (Pa) of the load path.

    Areas are "raw" (share of the grid points; the exact areas of a method without a grid),
    "corrected" (continuum limit) and "error" (estimated error of the corrected areas).
    """

    mean_pressure: float
    areas: Mapping[str, Areas]
    residuals: Mapping[str, float] = field(
        default_factory=dict
    )  #: Those that decide, over a scale.
    iterations: Mapping[str, int] = field(default_factory=dict)  #: newton, cg, fft_pairs, ...
    quantities: Mapping[str, float] = field(default_factory=dict)  #: Others, such as mean_gap; SI.


@dataclass(frozen=True)
class Provenance:
    """The scene's digest, the surface's seed, the method's options and the libraries' versions.

    They are enough to make a result again.  `about` is the scene in words and figures: by name a
    `value`, its `unit` and its `meaning`.
    """

    scene: str
    seed: int | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=lambda: dict(package_versions()))
    about: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class ContactResult:
    """One scene answered by one method.

    There is a step for each mean pressure, and gates read the last one.  Its `distribution` is that
    of the pressures; `fields` are arrays on the surface's grid: heights, pressure, gap,
    displacement (SI units) and state (APART, ELASTIC, PLASTIC), or none.  `cost` has seconds,
    unknowns, peak_memory_bytes and the method's own counts over the path; `history` the residual
    that decides convergence, for each iteration of the last step.

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
    notes: tuple[str, ...] = ()  #: Sentences that the reader should see, as of a fallback.
    converged: bool = True  #: Whether the residuals met the tolerance.

    def __post_init__(self) -> None:
        if not self.steps:
            raise ValueError("a ContactResult needs at least one load step, but steps is empty")
        object.__setattr__(self, "fields", dict(self.fields))

    @property
    def final(self) -> LoadStep:
        """The last load step."""
        return self.steps[-1]

    def to_json(self) -> dict[str, Any]:
        """Return everything except the fields in JSON types; infinities become strings."""
        shown = {"method": self.method, "converged": self.converged} | vars(self.final)
        names = ("steps", "distribution", "cost", "history", "notes", "provenance")
        data: dict[str, Any] = plain(shown | {name: getattr(self, name) for name in names})
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
            notes=tuple(data["notes"]),
            converged=data["converged"],
        )


def _step(data: Mapping[str, Any]) -> LoadStep:
    return LoadStep(
        float(data["mean_pressure"]),
        {name: Areas(**_numbers(areas)) for name, areas in data["areas"].items()},
        _numbers(data["residuals"]),
        data["iterations"],
        _numbers(data["quantities"]),
    )


def _numbers(data: Mapping[str, Any]) -> dict[str, Any]:
    return {name: float(v) if isinstance(v, str) else v for name, v in data.items()}


def plain(value: Any) -> Any:
    """Return `value` in JSON types; a number that JSON cannot hold as "inf", "-inf" or "nan"."""
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
