"""The options of a solve, each declared once: its name, default, bounds and meaning."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal, get_args

from epcontact.errors import InvalidScene
from epcontact.scene import (
    Scene,
    as_tuple,
    fraction,
    integer,
    positive,
    set_frozen,
)

LawName = Literal["elastic", "capped", "j2"]
Geometry = Literal["gap", "moved", "punch"]


def _option(default: Any, description: str, **bounds: float) -> Any:
    """Return a dataclass field with a default, a description and bounds.

    pydantic reads description and bounds from the field's metadata.

    Args:
        default: value of the option if none is given.
        description: meaning and unit of the option.
        bounds: as pydantic names them: gt (greater than), ge (at least), lt (less
            than).
    """
    return field(default=default, metadata={"description": description, **bounds})


@dataclass(frozen=True, kw_only=True)
class FemOptions:
    """The options of a finite-element solve.

    Attributes:
        law: material law.  "elastic" is linear elasticity.  "capped" is an elastic body
            whose nodal pressures do not exceed the hardness; its capped nodes keep
            their plastic displacement when the load falls.  "j2" is small-strain
            plasticity of the solid itself, without a cap on the pressure.
        geometry: with "gap" the roughness is the initial gap over a flat block, which
            is accurate for small slopes.  With "moved" the top nodes are moved to the
            real heights.  With "punch" a rigid punch with the mirrored heights presses
            along its normals on the flat block, without friction.
        depth: of the block, in m; None: the layer's depth, or a depth at which the
            block replaces a half-space.
        layers: number of elements over the depth; None: chosen from the depth.
        first_layer: thickness of the top layer, in m; None: the grid spacing.
        steps: number of increments of a J2 body to a load beyond all earlier ones.
        tolerance: on the dimensionless residuals.
        approach: path of the flat since the first touch, in m, which replaces the mean
            pressures of the scene; None: the mean pressures.
        certified: whether plain scikit-fem checks the states at the largest and at the
            last load.

    Raises:
        InvalidScene: an option is not within its bounds.

    Example:
        >>> FemOptions(law="elastic", depth=0.5).tolerance
        1e-08
    """

    law: LawName = field(default="j2", metadata={"description": "material law"})
    geometry: Geometry = field(
        default="gap",
        metadata={
            "description": "roughness as gap, as moved top nodes, or as that of a "
            "rigid punch"
        },
    )
    depth: float | None = _option(None, "m; else chosen from the scene", gt=0)
    layers: int | None = _option(None, "elements over the depth", ge=2)
    first_layer: float | None = _option(
        None, "thickness of the top layer, m; else the spacing", gt=0
    )
    # With ten increments, areas are within 1 % of those of 160 equal ones at
    # E* xi/sigma_Y of 5 to 100.
    steps: int = _option(
        10, "increments of a J2 body to a load larger than any yet", ge=1
    )
    tolerance: float = _option(1e-8, "on the residuals, dimensionless", gt=0, lt=1)
    approach: float | Sequence[float] | None = _option(
        None, "path of the flat since the first touch, m, instead of mean pressures"
    )
    certified: bool = _option(
        True,
        "whether plain scikit-fem checks the states of the largest and the last load",
    )

    def __post_init__(self) -> None:
        """Check the bounds of all options, and convert their values to numbers.

        Raises InvalidScene if an option is not within its bounds.
        """
        _require_one_of("law", self.law, get_args(LawName))
        _require_one_of("geometry", self.geometry, get_args(Geometry))
        length = partial(positive, unit="m")
        count = partial(integer, least=1)
        checks: dict[str, Any] = {
            "depth": length,
            "first_layer": length,
            "layers": count,
            "steps": count,
            "tolerance": fraction,
            "approach": _approaches,
        }
        for name, check in checks.items():
            value = getattr(self, name)
            if value is not None or getattr(FemOptions, name) is not None:
                set_frozen(self, **{name: check(name, value)})

    def require_strengths(self, scene: Scene) -> None:
        """Raise InvalidScene if the material lacks the strength that the law needs.

        The law "j2" needs a finite yield stress, the law "capped" a finite hardness.
        """
        for law, strength in (("j2", "yield_stress"), ("capped", "hardness")):
            if self.law == law and not math.isfinite(getattr(scene.material, strength)):
                raise InvalidScene(
                    f"law {law!r} needs a finite {strength}; give {strength!r} in Pa "
                    "or take law='elastic'"
                )


def _require_one_of(name: str, value: Any, choices: Sequence[str]) -> None:
    """Raise InvalidScene if an option's value is none of its choices.

    Args:
        name: of the option, for the message.
        value: that was given.
        choices: allowed values, two or more.
    """
    if value not in choices:
        expected = ", ".join(choices[:-1]) + f" or {choices[-1]}"
        raise InvalidScene(f"{name} is {value!r}, but must be {expected}")


def _approaches(name: str, value: Any) -> tuple[float, ...]:
    """Return approaches in m as a tuple of floats.

    Args:
        name: Of the option, for messages.
        value: One number or a sequence of numbers.

    Raises:
        InvalidScene: There is no approach, or one is not positive and finite.
    """
    approaches = as_tuple(value)
    if not approaches:
        raise InvalidScene(f"{name} is (), but must be at least one length in m")
    return tuple(positive(name, approach, "m") for approach in approaches)
