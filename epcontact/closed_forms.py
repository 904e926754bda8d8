"""Closed forms that gates can name, read off a scene's own heights, material and load.

Each form refuses a scene it does not describe; what it needs of the geometry (an amplitude, a
radius) it measures on the heights, so that it shares nothing with the recipe that made them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from typing import Any

import numpy as np
from numpy.typing import NDArray

from epcontact.errors import InvalidCase
from epcontact.moduli import effective_modulus
from epcontact.reference import bearing, hertz, sinusoid
from epcontact.scene import Scene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ClosedForm:
    """Scalars and fields of an exact solution, by the names that gates use."""

    name: str
    source: str
    scalars: Mapping[str, Callable[[Scene], float]] = field(default_factory=dict)
    fields: Mapping[str, Callable[[Scene], FloatArray]] = field(default_factory=dict)

    def scalar(self, quantity: str, scene: Scene) -> float:
        """The value of a quantity.  Raises InvalidCase if the form does not know it."""
        return float(self._find(self.scalars, quantity)(scene))

    def field(self, name: str, scene: Scene) -> FloatArray:
        """A field on the scene's grid.  Raises InvalidCase if the form does not know it."""
        return np.asarray(self._find(self.fields, name)(scene))

    def _find(
        self, known: Mapping[str, Callable[[Scene], object]], name: str
    ) -> Callable[..., object]:
        if name not in known:
            raise InvalidCase(
                f"the closed form {self.name} has no {name!r}; it has {', '.join(known) or 'none'}"
            )
        return known[name]


CLOSED_FORMS: dict[str, ClosedForm] = {}
