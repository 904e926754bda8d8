"""The tables of a case file, one class for each; a `Case` has them all.

Those of [surface] are the recipes of `epcontact.surfaces`, those of methods are in
`methods.registry`.  Values by size are resolved before these classes see them.
"""

from __future__ import annotations

import functools
import math
import tomllib
from collections.abc import Iterator
from importlib.resources import files
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, ValidationInfo, field_validator, model_validator

from epcontact.errors import nearest
from epcontact.harness.gates.gate import DISTRIBUTION_NORMS, Gate, Norm
from epcontact.harness.methods.registry import METHODS, Table
from epcontact.harness.quantities.registry import QUANTITIES, REPORTED_GROUPS
from epcontact.reference import CLOSED_FORMS
from epcontact.scene import Material

Size = Literal["fast", "full", "large"]


def _registered(name: str) -> str:
    if name not in METHODS:
        raise ValueError(f"no method is called {name!r}{nearest(name, METHODS)}")
    return name


def _each_once(names: list[str]) -> list[str]:
    if len(set(names)) < len(names):
        raise ValueError(f"it names {', '.join(names)}; name each method once")
    return names


MethodName = Annotated[
    str, AfterValidator(_registered), Field(json_schema_extra={"enum": list(METHODS)})
]


class CaseTable(Table):
    """[case]: the requirement, its source, and the methods."""

    id: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9._-]*$", max_length=80)] = Field(
        description="name of the case, of its folder of results and on the command line"
    )
    requirement: str = Field(min_length=1, description="the requirement, one English sentence")
    source: str = Field(min_length=1, description="the source of the requirement and its figures")
    methods: Annotated[list[MethodName], AfterValidator(_each_once)] = Field(
        min_length=1, description="the methods that answer the scene"
    )
    time_limit: float = Field(
        default=900.0, gt=0, description="seconds after which one solve is given up"
    )
    verify: bool = Field(
        default=True, description="whether a bare `epcontact verify` includes the case"
    )


class MaterialTable(Table):
    """[material]: an elastoplastic solid against a rigid flat."""

    young_modulus: float = Field(description="Pa")
    poisson_ratio: float = Field(description="between -1 and 0.5")
    hardness: float | Literal["effective"] = Field(
        default=float("inf"),
        description="Pa; cap of the contact pressure; 'effective': that which stands for a J2 body "
        "of yield_stress",
    )
    yield_stress: float = Field(default=float("inf"), description="Pa; of the J2 solid")

    @field_validator("*")
    @classmethod
    def _in_range(cls, value: Any, info: ValidationInfo) -> Any:
        if value != "effective":  # each key by itself, so that the mistakes of all are told
            Material(**{"young_modulus": 1.0, "poisson_ratio": 0.0, str(info.field_name): value})
        return value


class BodyTable(Table):
    """[body]: the body under the surface."""

    kind: Literal["half_space", "bonded_layer", "sliding_layer"] = Field(
        default="half_space", description="half-space, or layer on a rigid base"
    )
    depth: float = Field(default=float("inf"), description="m; of a layer")


class LoadTable(Table):
    """[load]: the force over the nominal area."""

    mean_pressure: float | list[float] = Field(description="Pa; one, or a path of them")


class GateTable(Table):
    """[[gate]]: one comparison that must hold."""

    quantity: str = Field(
        description="the scalar that is compared, such as area.total.corrected; "
        "`epcontact keys` lists them all"
    )
    of: MethodName = Field(description="the method that is judged")
    against: str | Annotated[float, Field(allow_inf_nan=False)] = Field(
        description="a method, a closed form's name, or a number"
    )
    norm: Norm = Field(default="relative", description="how the difference is measured")
    tolerance: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = Field(
        default=None, description="the difference must be within +- tolerance"
    )
    between: Annotated[list[float], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="or the difference must be within [low, high]"
    )
    because: str = Field(min_length=1, description="why the band is as wide as it is")
    source: str = Field(default="", description="where a number comes from; needed for one")
    sizes: Annotated[list[Size], Field(min_length=1)] | None = Field(
        default=None, description="the sizes it applies to; else all"
    )

    @property
    def gate(self) -> Gate:
        """The gate with its band."""
        low, high = self.between or (-float(self.tolerance or 0), float(self.tolerance or 0))
        return Gate(
            self.quantity, self.of, self.against, self.norm, low, high, self.because, self.source
        )

    @model_validator(mode="after")
    def _tells_something(self) -> Self:
        if mistake := next(self._mistakes(), ""):
            raise ValueError(mistake)
        return self

    def _mistakes(self) -> Iterator[str]:
        """Yield why the gate contradicts itself, cannot fail or hold, or has an unknown name."""
        low, high = self.between or (0.0, 0.0)
        against, quantity = self.against, self.quantity
        if (self.tolerance is None) == (self.between is None):
            yield "give either tolerance or between"
        if not low <= high:
            yield "between is out of order; give [low, high]"
        if math.isinf(low) and math.isinf(high):
            yield "between holds whatever the difference is, or never; give it a finite end"
        if against == self.of:
            yield f"{self.of} is compared with itself; name another method"
        if not isinstance(against, str) and not self.source:
            yield "against is a number without a source; say where it comes from"
        if (self.norm in DISTRIBUTION_NORMS) != (quantity == "distribution"):
            yield "a distribution, and nothing else, has the norm wasserstein or supremum"
        if (self.norm == "l2") != quantity.startswith("field."):
            yield "a field, and nothing else, has the norm l2"
        # A user's solver may report quantities of its own.
        own = METHODS[self.of].source and quantity.startswith(REPORTED_GROUPS)
        if quantity not in QUANTITIES and not own:
            yield f"no quantity is called {quantity!r}{nearest(quantity, QUANTITIES)}"
        if isinstance(against, str) and against not in METHODS:
            known = nearest(against, CLOSED_FORMS)
            if against not in CLOSED_FORMS:
                yield f"against is {against!r}, which is neither a method nor a closed form{known}"
            elif not CLOSED_FORMS[against].knows(quantity):
                known = ", ".join(CLOSED_FORMS[against].quantities)
                yield f"the closed form {against} has no {quantity!r}; it has {known}"


class OmitTable(Table):
    """[[omit]]: a default gate of a method that does not apply to the case."""

    quantity: str = Field(description="quantity of the default gate")
    of: MethodName = Field(description="the method whose default gate it is")
    because: str = Field(min_length=1, description="why the case cannot hold it")


@functools.cache
def default_gates() -> tuple[GateTable, ...]:
    """Return the gates of `default_gates.toml`, which every case of a method must hold."""
    text = (files(__package__) / "default_gates.toml").read_text("utf-8")
    return tuple(GateTable.model_validate(gate) for gate in tomllib.loads(text)["gate"])
