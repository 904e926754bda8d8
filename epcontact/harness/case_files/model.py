"""The tables of a case file, and the Case at one size that has them all.

Those of [surface] are the recipes of `epcontact.surfaces`, those of methods are in
`methods.registry`.  Values by size are resolved before these classes see them.
"""

from __future__ import annotations

import functools
import itertools
import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import fields
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    PlainValidator,
    StrictFloat,
    ValidationError,
    ValidationInfo,
    WrapValidator,
    field_validator,
    model_validator,
)

from epcontact import surfaces
from epcontact.errors import InvalidScene, nearest
from epcontact.files import NAME_PATTERN
from epcontact.harness.case_files.axes import SweepTable, key
from epcontact.harness.gates import DISTRIBUTION_NORMS, Gate, Kind, Norm
from epcontact.harness.methods.registry import (
    METHODS,
    BemTable,
    FemTable,
    Table,
    TheoryTable,
)
from epcontact.harness.quantities.registry import QUANTITIES, REPORTED_GROUPS
from epcontact.materials.hardness_map import MappedHardness, effective_hardness
from epcontact.materials.moduli import combined_material
from epcontact.reference import CLOSED_FORMS
from epcontact.results import CONDUCTING
from epcontact.scene import Body, Load, Material, Scene, scene_digest
from epcontact.surfaces.power_spectrum import inner_moments

Size = Literal["fast", "full", "large"]


def _registered(name: str) -> str:
    if name not in METHODS:
        raise ValueError(f"no method is called {name!r}{nearest(name, METHODS)}")
    return name


def _each_once(names: list[str]) -> list[str]:
    if len(set(names)) < len(names):
        raise ValueError(f"it names {', '.join(names)}; name each method once")
    return names


Finite = Annotated[float, Field(allow_inf_nan=False)]
MethodName = Annotated[
    str, AfterValidator(_registered), Field(json_schema_extra={"enum": list(METHODS)})
]


class CaseTable(Table):
    """[case]: the requirement, its source, and the methods."""

    id: str = key(
        "name of the case, of its folder of results and on the command line",
        pattern=NAME_PATTERN,
        max_length=80,
    )
    requirement: str = key("the requirement, one English sentence", min_length=1)
    source: str = key("the source of the requirement and its figures", min_length=1)
    methods: Annotated[list[MethodName], AfterValidator(_each_once)] = key(
        "the methods that answer the scene", min_length=1
    )
    time_limit: float = key("seconds after which one solve is given up", 900.0, gt=0)
    verify: bool = key("whether a bare `epcontact verify` includes the case", True)


Conductivities = Annotated[
    list[Annotated[float, Field(gt=0, allow_inf_nan=False)]] | None,
    Field(min_length=2, max_length=2),
]


class MaterialTable(Table):
    """[material]: an elastoplastic solid against a rigid flat."""

    young_modulus: float = key("Pa")
    poisson_ratio: float = key("between -1 and 0.5")
    hardness: float | Literal["effective"] = key(
        "Pa; cap of the contact pressure; 'effective': that which stands for a J2 body of "
        "yield_stress",
        math.inf,
    )
    yield_stress: float = key("Pa; of the J2 solid", math.inf)
    thermal_conductivities: Conductivities = key(
        "W/(m K); of the body and of what it touches: each load then has a thermal_conductance",
        None,
    )
    electrical_conductivities: Conductivities = key(
        "S/m; of both likewise, for an electrical_conductance", None
    )

    @field_validator("young_modulus", "poisson_ratio", "hardness", "yield_stress")
    @classmethod
    def _in_range(cls, value: Any, info: ValidationInfo) -> Any:
        if (
            value != "effective"
        ):  # each key by itself, so that the mistakes of all are told
            Material(
                **{
                    "young_modulus": 1.0,
                    "poisson_ratio": 0.0,
                    str(info.field_name): value,
                }
            )
        return value


class CounterfaceTable(Table):
    """[counterface]: an elastic half-space, in the place of the rigid flat; [material]
    flows.
    """

    model_config = ConfigDict(strict=False)  # as that of Case

    young_modulus: StrictFloat = key("Pa")
    poisson_ratio: StrictFloat = key("between -1 and 0.5")
    surface: Annotated[surfaces.CaseSurface, Field(discriminator="kind")] | None = key(
        "a second rough surface, with the keys of [surface] and heights out of its own body",
        None,
    )


class BodyTable(Table):
    """[body]: the body under the surface."""

    kind: Literal["half_space", "bonded_layer", "sliding_layer"] = key(
        "half-space, or layer on a rigid base", "half_space"
    )
    depth: float = key("m; of a layer", math.inf)


class LoadTable(Table):
    """[load]: the force over the nominal area."""

    mean_pressure: float | list[float] = key("Pa; one, or a path of them")


class GateTable(Table):
    """[[gate]]: one comparison that must hold."""

    quantity: str = key(
        "the scalar that is compared, such as area.total.corrected; `epcontact keys` lists them all"
    )
    of: MethodName = key("the method that is judged")
    against: str | Finite = key("a method, a closed form's name, or a number")
    norm: Norm = key("how the difference is measured", "relative")
    tolerance: Finite | None = key(
        "the difference must be within +- tolerance", None, gt=0
    )
    between: list[float] | None = key(
        "or the difference must be within [low, high]", None, min_length=2, max_length=2
    )
    because: str = key("why the band is as wide as it is", min_length=1)
    source: str = key("where a number comes from; needed for one", "")
    kind: Kind | None = key(
        "what a number is; else 0 is an identity, others are our own", None
    )
    sizes: list[Size] | None = key(
        "the sizes it applies to; else all", None, min_length=1
    )

    @property
    def gate(self) -> Gate:
        """The gate with its band."""
        low, high = self.between or (
            -float(self.tolerance or 0),
            float(self.tolerance or 0),
        )
        named = (self.quantity, self.of, self.against, self.norm)
        return Gate(*named, low, high, self.because, self.source, self.kind or "")

    @model_validator(mode="after")
    def _tells_something(self) -> Self:
        if mistake := next(self._mistakes(), ""):
            raise ValueError(mistake)
        return self

    def _mistakes(self) -> Iterator[str]:
        """Yield why the gate contradicts itself, cannot fail or hold, or has an unknown
        name.
        """
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
        if isinstance(against, str) and self.kind:
            yield f"kind says what a number is, but against is {against!r}; leave it out"
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


@functools.cache
def default_gates() -> tuple[GateTable, ...]:
    """Return the gates of `default_gates.toml`, which every case of a method must
    hold.
    """
    text = (files(__package__) / "default_gates.toml").read_text("utf-8")
    return tuple(GateTable.model_validate(gate) for gate in tomllib.loads(text)["gate"])


def _or_absent(table: Any, validate: Any) -> Any:
    """Return the recipe of a table [surface], or the error of an absent optional
    file.
    """
    try:
        return validate(table)
    except ValidationError as error:
        reasons = (detail.get("ctx", {}).get("error") for detail in error.errors())
        absent = next(
            (r for r in reasons if isinstance(r, surfaces.SurfaceAbsent)), None
        )
        if absent is None:
            raise
        return absent


def _part(kind: type[Any], table: type[Table]) -> PlainValidator:
    """Return the validator that makes a part of the scene from its table."""
    return PlainValidator(
        lambda given: kind(**table.model_validate(given).model_dump()),
        json_schema_input_type=table,
    )


class Case(Table):
    """One case at one size: its tables, and the scenes, options and gates that follow
    from them.

    `case_files.case.load_case` makes it.  No surface is made before it is asked for.
    """

    # Each table is strict by itself; a strict recipe could not be made from a table.
    model_config = ConfigDict(strict=False)

    head: CaseTable = Field(alias="case")
    surface: Annotated[
        surfaces.CaseSurface, Field(discriminator="kind"), WrapValidator(_or_absent)
    ]
    solid: MaterialTable = Field(alias="material")
    counterface: CounterfaceTable | None = None
    load: Annotated[Load, _part(Load, LoadTable)]
    body: Annotated[Body, _part(Body, BodyTable)] = Field(default_factory=Body)
    gate: list[GateTable] = key("comparisons, which `epcontact verify` needs", [])
    sweep: SweepTable | None = key("values that a sweep gives to keys", None)
    theory: TheoryTable | None = None
    bem: BemTable = BemTable()
    fem: FemTable = FemTable()

    if TYPE_CHECKING:
        path: Path
        size: str
        id: str
        methods: tuple[str, ...]

    def model_post_init(self, context: Any) -> None:
        """Keep the file and the size of the tables, and what is asked for most
        often.
        """
        about = {"id": self.head.id, "methods": tuple(self.head.methods)}
        self.__dict__.update(path=context["path"], size=context["size"], **about)

    def changed(self, **values: Any) -> Case:
        """Return a copy in which fields or properties have other values, and the rest
        its own.
        """
        own = {
            name: getattr(self, name)
            for name in ("recipes", "options", "gates", *values)
        }
        return self.model_copy(update=own | values)

    @cached_property
    def options(self) -> Mapping[str, Mapping[str, Any]]:
        """The options of each method."""
        tables = {
            name: getattr(self, METHODS[name].table or "", None)
            for name in self.methods
        }
        return {
            n: t.model_dump(exclude_none=True) if t else {} for n, t in tables.items()
        }

    @cached_property
    def skip(self) -> str:
        """The sentence that says why the case cannot run here, or ""."""
        if isinstance(self.surface, surfaces.SurfaceAbsent):
            return f"skipped: {self.surface}"
        missing = next((m for name in self.methods if (m := METHODS[name].missing)), "")
        return f"skipped: {missing}" if missing else ""

    @cached_property
    def recipes(self) -> tuple[surfaces.Recipe, ...]:
        """The recipes of the surfaces; none if the case is skipped."""
        found = () if self.skip else surfaces.recipes_of(self.surface)
        above = self.counterface.surface if self.counterface else None
        if not found or above is None:
            return found
        others = surfaces.recipes_of(above)
        others = others * len(found) if len(others) == 1 else others
        if len(others) != len(found):
            raise InvalidScene(
                f"[surface] has {len(found)} seeds and [counterface.surface] {len(others)}; give "
                "as many, or one to the counterface"
            )
        return tuple(map(surfaces.Facing, found, others))

    @cached_property
    def both(self) -> Material:
        """The elastic body that stands for that of [material] and the counterface, if
        any.
        """
        body = Material(self.solid.young_modulus, self.solid.poisson_ratio)
        if (other := self.counterface) is None:
            return body
        return combined_material(
            body, Material(other.young_modulus, other.poisson_ratio)
        )

    @property
    def two_bodies(self) -> dict[str, Any]:
        """What a result says of its two bodies in the place of the one that stands for
        them.
        """
        if (other := self.counterface) is None:
            return {}
        rough = "rough" if other.surface is not None else "flat"
        moduli = f"E = {other.young_modulus:g} Pa, nu = {other.poisson_ratio:g}"
        told = f"{rough} elastic half-space, {moduli}; the hardness is that of the first body"
        if self.solid.hardness == "effective":
            told += ", of J2 bodies that touch a rigid flat at the E* of both"
        name = "Young's modulus E of the first body; E* is that of both"
        return {
            "young_modulus": {
                "value": self.solid.young_modulus,
                "unit": "Pa",
                "meaning": name,
            },
            "counterface": {"value": told, "unit": "", "meaning": "counterface"},
        }

    @cached_property
    def mapped(self) -> tuple[MappedHardness, ...]:
        """The map's hardness of each load, or of the largest before it, where it is
        effective.
        """
        given, surface = self.solid, self.surface
        if given.hardness != "effective" or isinstance(surface, surfaces.SurfaceAbsent):
            return ()
        if not isinstance(
            surface, surfaces.SelfAffineEnsemble | surfaces.HeightsFromFile
        ) or (len(surfaces.recipes_of(surface)[0].shape) == 1):
            raise InvalidScene(
                "hardness is 'effective', which is known for rough surfaces only, those of kind "
                "self_affine and the maps of kind file; give it in Pa"
            )
        if self.body.depth < min(surface.periods):
            raise InvalidScene(
                f"hardness is 'effective', which is known for deep bodies, but [body] depth is "
                f"{self.body.depth:g} m and the period {min(surface.periods):g} m; give it in Pa"
            )
        if self.counterface is not None and self.counterface.surface is not None:
            slope = inner_moments(self.recipes[0].build()).rms_slope
        elif isinstance(
            surface, surfaces.HeightsFromFile
        ):  # as it is after its treatment
            surfaces.require_room(surface.shape)
            slope = inner_moments(surface.build()).rms_slope
        else:
            slope = surface.rms_slope
        return tuple(
            self.cap_at(slope, p) for p in itertools.accumulate(self.load.path, max)
        )

    @property
    def mapped_hardness(self) -> MappedHardness | None:
        """The map's hardness at the largest mean pressure."""
        return max(self.mapped, key=lambda found: found.load, default=None)

    @property
    def told_hardness(self) -> str:
        """The effective hardness of each load, with what is known of the largest; or
        "".
        """
        begin, _, end = str(self.mapped_hardness or "").partition("\n")
        loads = {found.load * self.solid.yield_stress: found for found in self.mapped}
        each = [
            f"at {p:.4g} Pa: {found}".partition("\n")[0] for p, found in loads.items()
        ]
        return "\n".join([*(each if len(each) > 1 else [begin]), end]).strip()

    @property
    def conductances(self) -> dict[str, float]:
        """What a conductance times resistivity is multiplied by, by kinds, where both
        bodies' are given.
        """
        given = self.solid.model_dump(
            include={f"{kind}_conductivities" for kind in CONDUCTING}
        )
        return {
            n.partition("_")[0]: 1 / sum(1 / k for k in both)
            for n, both in given.items()
            if both
        }

    @property
    def breadth(self) -> float | None:
        """Wavelength of the roll-off over the shortest of a recipe; None: that of a
        map.
        """
        surface, two = (
            self.surface,
            self.counterface is not None and self.counterface.surface,
        )
        if two or not isinstance(surface, surfaces.SelfAffineEnsemble):
            return None
        return surface.wavenumber_high / surface.wavenumber_roll_off

    def cap_at(self, rms_slope: float, mean_pressure: float) -> MappedHardness:
        """Return the map's hardness at an rms slope.  Raises InvalidScene outside the
        map.
        """
        return effective_hardness(
            yield_stress=self.solid.yield_stress,
            young_modulus=self.both.young_modulus,
            poisson_ratio=self.solid.poisson_ratio,
            rms_slope=rms_slope,
            mean_pressure=mean_pressure,
            breadth=self.breadth,
        )

    @property
    def lists_loads(self) -> bool:
        """Whether a verification measures and prints each load: of a path, of a
        measured map, and under an effective hardness, whose interval is a part of each
        figure's error.
        """
        told = isinstance(self.surface, surfaces.HeightsFromFile)
        own = bool(self.conductances) or self.solid.hardness == "effective"
        return len(self.load.path) > 1 or told or own

    @cached_property
    def material(self) -> Material:
        """The material.  Raises InvalidScene."""
        given = self.solid.model_dump(include={f.name for f in fields(Material)})
        if given["hardness"] == "effective":
            # A case without its surface is skipped, and nothing asks for its cap.
            given["hardness"] = getattr(self.mapped_hardness, "value", math.inf)
        return Material(**given | {"young_modulus": self.both.young_modulus})

    @cached_property
    def hardness_source(self) -> str:
        """The effective hardness and what it rests on, or ""."""
        found = self.mapped_hardness
        return "" if found is None else f"{found}; {found.source}".replace("\n", " ")

    @cached_property
    def gates(self) -> tuple[Gate, ...]:
        """The gates at this size: the case's own, and the default gates of its methods.

        A gate of the case replaces the default gate on the same quantity of the same
        method.  A case that is there to be run or swept has no gate at all.
        """
        own = [
            gate for gate in self.gate if gate.sizes is None or self.size in gate.sizes
        ]
        replaced = {(gate.of, gate.quantity) for gate in own}
        shared = [
            gate
            for gate in (default_gates() if self.gate else ())
            if gate.of in self.methods
            and self.size in (gate.sizes or ())
            and (gate.of, gate.quantity) not in replaced
        ]
        return tuple(gate.gate for gate in (*own, *shared))

    @cached_property
    def not_judged(self) -> tuple[str, ...]:
        """A sentence for each gate of the case that this size leaves out."""
        return tuple(
            f"{gate.gate.name} applies to size {' and '.join(gate.sizes)} only"
            for gate in self.gate
            if gate.sizes and self.size not in gate.sizes
        )

    def digest(self, recipe: surfaces.Recipe) -> str:
        """Return the digest of the scene on a surface, without making the surface."""
        return scene_digest(
            recipe.fingerprint,
            recipe.shape,
            recipe.periods,
            self.material,
            self.body,
            self.load,
        )

    def folder(self, output: Path) -> Path:
        """Return the folder of its results: one for each size,
        `<output>/<case>/<size>`.
        """
        return output / self.id / self.size

    def scene(self, recipe: surfaces.Recipe) -> Scene:
        """Make the surface and the scene on it.  Raises InvalidScene,
        NotEnoughMemory.
        """
        surfaces.require_room(recipe.shape)
        return Scene(recipe.build(), self.material, self.load, self.body)
