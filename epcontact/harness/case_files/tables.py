"""The tables of a case file, one class for each; a `Case` has them all.

Those of [surface] are the recipes of `epcontact.surfaces`, those of methods are in
`methods.registry`.  Any value may be given by size, as in `shape = { fast = [256, 256], full =
[1024, 1024] }`; sizes are resolved before these classes see the values.
"""

from __future__ import annotations

import functools
import math
import tomllib
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
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{name} is named {names.count(name)} times; name each method once")
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
    tolerance: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="the difference must be within +- tolerance",
    )
    between: list[float] | None = Field(
        default=None,
        min_length=2,
        max_length=2,
        description="or the difference must be within [low, high]",
    )
    because: str = Field(min_length=1, description="why the band is as wide as it is")
    source: str = Field(default="", description="where a number comes from; needed for one")
    sizes: list[Size] | None = Field(
        default=None, min_length=1, description="the sizes it applies to; else all"
    )

    @property
    def number(self) -> float | None:
        """The number that it is held against; None for a method or a closed form."""
        return None if isinstance(self.against, str) else self.against

    @property
    def gate(self) -> Gate:
        """The gate with its band."""
        low, high = self.between or (-float(self.tolerance or 0), float(self.tolerance or 0))
        return Gate(
            self.quantity, self.of, self.against, self.norm, low, high, self.because, self.source
        )

    @model_validator(mode="after")
    def _tells_something(self) -> Self:
        low, high = self.between or (0.0, 0.0)
        everything = math.isinf(low) and math.isinf(high)
        unsourced = self.number is not None and not self.source
        distances, field = self.norm in DISTRIBUTION_NORMS, self.quantity.startswith("field.")
        mistakes = {
            "give either tolerance or between": (self.tolerance is None) == (self.between is None),
            "between is out of order; give [low, high]": not low <= high,
            "between holds whatever the difference is, or never; give it a finite end": everything,
            f"{self.of} is compared with itself; name another method": self.against == self.of,
            "against is a number without a source; say where it comes from": unsourced,
            "a distribution, and nothing else, has the norm wasserstein or supremum": distances
            != (self.quantity == "distribution"),
            "a field, and nothing else, has the norm l2": field != (self.norm == "l2"),
        }
        for sentence, made in mistakes.items():
            if made:
                raise ValueError(sentence)
        return self

    @model_validator(mode="after")
    def _known_names(self) -> Self:
        # A user's solver may report quantities of its own.
        own = METHODS[self.of].source and self.quantity.startswith(REPORTED_GROUPS)
        if self.quantity not in QUANTITIES and not own:
            raise ValueError(
                f"no quantity is called {self.quantity!r}{nearest(self.quantity, QUANTITIES)}"
            )
        form = self.against
        if not isinstance(form, str) or form in METHODS:
            return self
        if form not in CLOSED_FORMS:
            raise ValueError(
                f"against is {form!r}, which is neither a method nor a closed form"
                f"{nearest(form, CLOSED_FORMS)}"
            )
        if not CLOSED_FORMS[form].knows(self.quantity):
            known = ", ".join(CLOSED_FORMS[form].quantities)
            raise ValueError(f"the closed form {form} has no {self.quantity!r}; it has {known}")
        return self


class OmitTable(Table):
    """[[omit]]: a default gate of a method that does not apply to the case."""

    quantity: str = Field(description="quantity of the default gate")
    of: MethodName = Field(description="the method whose default gate it is")
    because: str = Field(min_length=1, description="why the case cannot hold it")


@functools.cache
def default_gates() -> tuple[GateTable, ...]:
    """Return the gates of `default_gates.toml`, which every case of a method must hold."""
    text = files("epcontact.harness.case_files").joinpath("default_gates.toml").read_text("utf-8")
    return tuple(GateTable.model_validate(gate) for gate in tomllib.loads(text)["gate"])
