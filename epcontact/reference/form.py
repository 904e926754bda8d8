"""A closed form for gates: named scalars, fields and a pressure distribution."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from epcontact.errors import InvalidCase
from epcontact.materials.moduli import effective_modulus
from epcontact.results import FloatArray, PressureDistribution
from epcontact.scene import Scene

Scalar = Callable[[Scene], float]


@dataclass(frozen=True)
class ClosedForm:
    """An exact solution in the form that gates use.

    Attributes:
        name: The name that gates use.
        source: Where the solution comes from.
        scalars: Functions of the scene by the names of quantities.
        fields: Functions of the scene, which give arrays on its grid, by the names of fields.
        distribution: Function of the scene that gives the distribution of the pressures.
    """

    name: str
    source: str
    scalars: Mapping[str, Scalar] = field(default_factory=dict)
    fields: Mapping[str, Callable[[Scene], FloatArray]] = field(default_factory=dict)
    distribution: Callable[[Scene], PressureDistribution] | None = None

    def scalar(self, quantity: str, scene: Scene) -> float:
        """The value of a quantity.

        Raises:
            InvalidCase: The form does not know the quantity or does not describe the scene.
        """
        return float(self._find(self.scalars, quantity)(scene))

    def field(self, name: str, scene: Scene) -> FloatArray:
        """A field on the scene's grid.

        Raises:
            InvalidCase: The form does not know the field or does not describe the scene.
        """
        return np.asarray(self._find(self.fields, name)(scene))

    def pressures(self, scene: Scene) -> PressureDistribution:
        """The distribution of the pressures.

        Raises:
            InvalidCase: The form has none or does not describe the scene.
        """
        if self.distribution is None:
            raise InvalidCase(f"the closed form {self.name} has no pressure distribution")
        return self.distribution(scene)

    @property
    def quantities(self) -> tuple[str, ...]:
        """The names that a gate can read."""
        fields = [f"field.{name}" for name in self.fields]
        return (*self.scalars, *fields, *(["distribution"] if self.distribution else []))

    def knows(self, quantity: str) -> bool:
        """True if a gate can read `quantity` of this form."""
        return quantity in self.quantities

    def _find(self, known: Mapping[str, Any], name: str) -> Any:
        if name not in known:
            raise InvalidCase(
                f"the closed form {self.name} has no {name!r}; it has {', '.join(known) or 'none'}"
            )
        return known[name]


def areas(total: Scalar, plastic: Scalar | None = None) -> dict[str, Scalar]:
    """The exact areas under the names of both of a method's estimates, raw and corrected."""
    kinds = ("raw", "corrected")
    out = {f"area.total.{kind}": total for kind in kinds}
    if plastic is not None:
        out |= {f"area.plastic.{kind}": plastic for kind in kinds}
        out |= {f"area.elastic.{kind}": lambda s: total(s) - plastic(s) for kind in kinds}
    return out


def refuse_unless(condition: bool, name: str, needs: str) -> None:
    """Raise InvalidCase unless the scene is one that the form describes."""
    if not condition:
        raise InvalidCase(f"the closed form {name} describes {needs}, which this scene is not")


def elastic_half_space(scene: Scene, name: str) -> float:
    """Return E* of an elastic half-space; raise InvalidCase for another scene."""
    elastic = scene.material.hardness == math.inf and scene.body.kind == "half_space"
    refuse_unless(elastic, name, "an elastic half-space")
    return effective_modulus(scene.material)
