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
    number,
    positive,
    set_frozen,
)

LawName = Literal["elastic", "capped", "j2"]
Geometry = Literal["gap", "moved", "punch"]


def _option(default: Any, description: str, **bounds: float) -> Any:
    """A field with its meaning and its bounds, by names that pydantic reads, too."""
    return field(default=default, metadata={"description": description, **bounds})


_hardening = partial(
    number, expected="0 or positive, in Pa", accepts=lambda value: 0 <= value < math.inf
)


@dataclass(frozen=True, kw_only=True)
class FemOptions:
    """The options of a finite-element solve; the metadata of a field say what it means.

    Laws.  "elastic" is linear elasticity.  "capped" is an elastic body whose nodal
    pressures do not exceed the hardness, and whose capped nodes keep what they have
    sunk when the load falls.  "j2" is small-strain plasticity of the solid itself,
    without any cap on the pressure.

    Geometries.  With "gap" the roughness is the initial gap over a flat block, as small
    slopes allow.  With "moved" the top nodes are moved to the real heights.  With
    "punch" the flat block is met by rigid mirrored heights, which press along their
    normals, without friction.

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
            "description": "roughness as gap, as moved top nodes, or as that of a rigid punch"
        },
    )
    depth: float | None = _option(None, "m; else chosen from the scene", gt=0)
    layers: int | None = _option(None, "elements over the depth", ge=2)
    first_layer: float | None = _option(
        None, "thickness of the top layer, m; else the spacing", gt=0
    )
    # With ten, areas are 1 % from those of 160 equal ones at E* xi/sigma_Y of 5 to 100.
    steps: int = _option(
        10, "increments of a J2 body to a load larger than any yet", ge=1
    )
    tolerance: float = _option(1e-8, "on the residuals, dimensionless", gt=0, lt=1)
    approach: float | Sequence[float] | None = _option(
        None, "path of the flat since the first touch, m, instead of mean pressures"
    )
    hardening: float = _option(0.0, "H of linear isotropic hardening, Pa", ge=0)
    certified: bool = _option(
        True, "whether scikit-fem's own assembly checks the last state"
    )

    def __post_init__(self) -> None:
        for name, kinds in (
            ("law", get_args(LawName)),
            ("geometry", get_args(Geometry)),
        ):
            if (value := getattr(self, name)) not in kinds:
                wanted = ", ".join(kinds[:-1]) + f" or {kinds[-1]}"
                raise InvalidScene(f"{name} is {value!r}, but must be {wanted}")
        length, count = partial(positive, unit="m"), partial(integer, least=1)
        checks: dict[str, Any] = {
            "depth": length,
            "first_layer": length,
            "layers": count,
            "steps": count,
            "tolerance": fraction,
            "approach": _approaches,
            "hardening": _hardening,
        }
        for name, check in checks.items():
            value = getattr(self, name)
            if value is not None or getattr(FemOptions, name) is not None:
                set_frozen(self, **{name: check(name, value)})

    def require_strengths(self, scene: Scene) -> None:
        """Raise InvalidScene if the scene's material lacks the strength that the law
        needs.
        """
        for law, strength in (("j2", "yield_stress"), ("capped", "hardness")):
            if self.law == law and not math.isfinite(getattr(scene.material, strength)):
                raise InvalidScene(
                    f"law {law} needs a finite {strength}; give one or take law='elastic'"
                )


def _approaches(name: str, given: Any) -> tuple[float, ...]:
    if not (lengths := as_tuple(given)):
        raise InvalidScene(f"{name} is (), but must be at least one length in m")
    return tuple(positive(name, length, "m") for length in lengths)
