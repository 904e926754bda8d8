"""A closed form for gates: exact scalars, fields and pressures of the scenes that it
describes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from epcontact.errors import InvalidCase
from epcontact.materials.moduli import effective_modulus
from epcontact.results import FloatArray, PressureDistribution
from epcontact.scene import Scene

Answer = TypeVar("Answer", bound=Callable[[Scene], Any])


class ClosedForm:
    """An exact solution by the name that gates use, and its source.

    Functions of the scene belong to it by the decorator `gives`.  One that is not
    `exact` is a law that others published.
    """

    def __init__(self, name: str, source: str, *, exact: bool = True) -> None:
        self.name, self.source, self.exact = name, source, exact
        self._answers: dict[str, Callable[[Scene], Any]] = {}

    def gives(self, *quantities: str) -> Callable[[Answer], Answer]:
        """Decorate a function of the scene by the quantities that it gives, and gates
        can read.

        An area is the exact value of both of a method's estimates, raw and corrected.
        """

        def register(answer: Answer) -> Answer:
            for quantity in quantities:
                kinds = (
                    (".raw", ".corrected") if quantity.startswith("area.") else ("",)
                )
                self._answers.update({quantity + kind: answer for kind in kinds})
            return answer

        return register

    @property
    def quantities(self) -> tuple[str, ...]:
        """The names that a gate can read."""
        return tuple(self._answers)

    def knows(self, quantity: str) -> bool:
        """True if a gate can read `quantity` of this form."""
        return quantity in self._answers

    # Each of these raises InvalidCase if the form does not know what is asked, or the
    # scene.

    def scalar(self, quantity: str, scene: Scene) -> float:
        """The value of a quantity."""
        return float(self._answer(quantity)(scene))

    def field(self, name: str, scene: Scene) -> FloatArray:
        """A field on the scene's grid."""
        return np.asarray(self._answer(f"field.{name}")(scene))

    def pressures(self, scene: Scene) -> PressureDistribution:
        """The distribution of the pressures."""
        found: PressureDistribution = self._answer("distribution")(scene)
        return found

    def needs(self, condition: bool, words: str) -> None:
        """Raise InvalidCase unless the scene is what the form describes, in words."""
        if not condition:
            raise InvalidCase(
                f"the closed form {self.name} describes {words}, which this scene is not"
            )

    def elastic_half_space(self, scene: Scene) -> float:
        """Return E* of an elastic half-space; raise InvalidCase for another scene."""
        elastic = (
            scene.material.hardness == math.inf and scene.body.kind == "half_space"
        )
        self.needs(elastic, "an elastic half-space")
        return effective_modulus(scene.material)

    def _answer(self, quantity: str) -> Callable[[Scene], Any]:
        if quantity not in self._answers:
            raise InvalidCase(
                f"the closed form {self.name} has no {quantity!r}; it has "
                f"{', '.join(self._answers)}"
            )
        return self._answers[quantity]
