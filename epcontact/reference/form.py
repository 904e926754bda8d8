"""A closed form for gates: exact values, fields and pressures of certain scenes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from epcontact.errors import InvalidCase
from epcontact.materials.moduli import effective_modulus
from epcontact.results import FloatArray, PressureDistribution
from epcontact.scene import Scene

SceneFunction = TypeVar("SceneFunction", bound=Callable[[Scene], Any])


class ClosedForm:
    """An exact solution, under the name that gates use.

    Functions of a scene are added to it by the decorator `gives`.  The methods that
    evaluate it raise InvalidCase if the form does not give the quantity, or does not
    describe the scene.

    Attributes:
        name: The name that gates use.
        source: Where the solution is published or derived.
        exact: False for an approximate law that others published.
    """

    def __init__(self, name: str, source: str, *, exact: bool = True) -> None:
        """Create a closed form without functions; the decorator `gives` adds them.

        Args:
            name: The name that gates use.
            source: Where the solution is published or derived.
            exact: False for an approximate law that others published.
        """
        self.name = name
        self.source = source
        self.exact = exact
        self._functions: dict[str, Callable[[Scene], Any]] = {}

    def gives(self, *quantities: str) -> Callable[[SceneFunction], SceneFunction]:
        """Return a decorator that adds a function of the scene to this closed form.

        The function's value of an area is the reference of both estimates of a method,
        raw and corrected.

        Args:
            quantities: Names that the function gives, such as "area.total",
                "field.gap", "quantity.mean_gap" or "distribution".
        """

        def register(function: SceneFunction) -> SceneFunction:
            """Add a function of the scene to the form, and return the function."""
            for quantity in quantities:
                if quantity.startswith("area."):
                    self._functions[f"{quantity}.raw"] = function
                    self._functions[f"{quantity}.corrected"] = function
                else:
                    self._functions[quantity] = function
            return function

        return register

    @property
    def quantities(self) -> tuple[str, ...]:
        """The names of the quantities that this closed form gives."""
        return tuple(self._functions)

    def knows(self, quantity: str) -> bool:
        """Return whether this form gives a quantity, such as "area.total.raw"."""
        return quantity in self._functions

    def scalar(self, quantity: str, scene: Scene) -> float:
        """Return the exact value of a quantity of a scene, in the quantity's SI unit.

        Args:
            quantity: Its name, such as "area.total.raw" or "quantity.mean_gap".
            scene: The scene.

        Raises:
            InvalidCase: The form does not give the quantity, or does not describe the
                scene.
        """
        return float(self._function(quantity)(scene))

    def field(self, name: str, scene: Scene) -> FloatArray:
        """Return an exact field of a scene, in SI units and of the shape of its grid.

        Args:
            name: Such as "pressure" or "gap".
            scene: The scene.

        Raises:
            InvalidCase: The form does not give the field, or does not describe the
                scene.
        """
        return np.asarray(self._function(f"field.{name}")(scene))

    def pressures(self, scene: Scene) -> PressureDistribution:
        """Return the exact distribution of the contact pressure of a scene.

        Raises:
            InvalidCase: The form does not give it, or does not describe the scene.
        """
        distribution: PressureDistribution = self._function("distribution")(scene)
        return distribution

    def require(self, condition: bool, words: str) -> None:
        """Raise InvalidCase unless the scene meets a condition.

        Args:
            condition: True if the form describes the scene.
            words: What the form describes, such as "an elastic half-space".
        """
        if not condition:
            raise InvalidCase(
                f"the closed form {self.name} describes {words}, which this "
                "scene is not"
            )

    def elastic_half_space(self, scene: Scene) -> float:
        """Return the effective modulus E* in Pa of a scene's elastic half-space.

        Raises:
            InvalidCase: The scene's body is a layer, or its material has a finite
                hardness.
        """
        elastic = scene.material.hardness == math.inf
        self.require(
            elastic and scene.body.kind == "half_space", "an elastic half-space"
        )
        return effective_modulus(scene.material)

    def _function(self, quantity: str) -> Callable[[Scene], Any]:
        """Return the function of the scene that gives a quantity.

        Args:
            quantity: Its name, such as "area.total.raw", "field.gap" or "distribution".

        Raises:
            InvalidCase: The form does not give the quantity.
        """
        if quantity not in self._functions:
            raise InvalidCase(
                f"the closed form {self.name} has no {quantity!r}; it has "
                f"{', '.join(self._functions)}"
            )
        return self._functions[quantity]
