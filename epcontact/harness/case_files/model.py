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
from epcontact.scene import (
    HARDENING_LAWS,
    Body,
    Load,
    Material,
    Scene,
    scene_digest,
)
from epcontact.surfaces.power_spectrum import inner_moments

Size = Literal["fast", "full", "large"]


def _registered(name: str) -> str:
    """Return the name of a method; raise ValueError if it is not registered."""
    if name not in METHODS:
        raise ValueError(f"no method is called {name!r}{nearest(name, METHODS)}")
    return name


def _each_once(names: list[str]) -> list[str]:
    """Return the names of methods; raise ValueError if one of them is repeated."""
    if len(set(names)) < len(names):
        raise ValueError(f"it names {', '.join(names)}; name each method once")
    return names


Finite = Annotated[float, Field(allow_inf_nan=False)]
MethodName = Annotated[
    str, AfterValidator(_registered), Field(json_schema_extra={"enum": list(METHODS)})
]


#: Columns of the table of loads that the harness measures on the fields of a load.
MeasuredColumn = Literal[
    "stiffness_loading",
    "stiffness_unloading",
    "conductance",
    "contact_percolation",
    "gap_percolation",
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
    time_limit: float = key(
        "s; processor time of each thread after which a solve is stopped", 900.0, gt=0
    )
    columns: list[MeasuredColumn] = key(
        "columns of the table of loads that are measured on any grid; else stiffness, "
        "conductance and percolation up to 2^20 points",
        [],
    )
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
        "Pa; cap of the contact pressure; 'effective': that which stands for a J2 "
        "body of "
        "yield_stress",
        math.inf,
    )
    yield_stress: float = key("Pa; of the J2 solid", math.inf)
    hardening_modulus: float = key(
        "Pa; slope of the yield stress of the J2 solid over the plastic strain", 0.0
    )
    hardening_curve: list[Annotated[list[float], Field(min_length=2, max_length=2)]] = (
        key(
            "instead of a modulus, points [plastic strain, yield stress in Pa]; the "
            "first is [0, yield_stress], and the last stress stays",
            [],
        )
    )
    thermal_conductivities: Conductivities = key(
        "W/(m K); of the body and of what it touches: each load then has a "
        "thermal_conductance",
        None,
    )
    electrical_conductivities: Conductivities = key(
        "S/m; of both likewise, for an electrical_conductance", None
    )

    @field_validator(
        "young_modulus",
        "poisson_ratio",
        "hardness",
        "yield_stress",
        *HARDENING_LAWS,
    )
    @classmethod
    def _in_range(cls, value: Any, info: ValidationInfo) -> Any:
        """Return the value of one key of [material], checked by itself.

        Each key is checked separately, so that the mistakes of all are reported.
        Raises InvalidScene, a ValueError, if the value is not physical.
        """
        name = str(info.field_name)
        if name in HARDENING_LAWS:
            HARDENING_LAWS[name].check(value)
        elif value != "effective":
            valid: dict[str, Any] = {
                "young_modulus": 1.0,
                "poisson_ratio": 0.0,
                "yield_stress": 1.0,
            }
            Material(**{**valid, name: value})
        return value


class CounterfaceTable(Table):
    """[counterface]: an elastic half-space, in the place of the rigid flat; [material]
    flows.
    """

    model_config = ConfigDict(strict=False)  # as that of Case

    young_modulus: StrictFloat = key("Pa")
    poisson_ratio: StrictFloat = key("between -1 and 0.5")
    surface: Annotated[surfaces.CaseSurface, Field(discriminator="kind")] | None = key(
        "a second rough surface, with the keys of [surface] and heights out of its "
        "own body",
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
        "the scalar that is compared, such as area.total.corrected; `epcontact keys` "
        "lists them all"
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
        """This table as a `Gate`, with its tolerance or interval as the band."""
        half_width = self.tolerance or 0.0
        low, high = self.between or (-half_width, half_width)
        return Gate(
            self.quantity,
            self.of,
            self.against,
            self.norm,
            low,
            high,
            self.because,
            self.source,
            self.kind or "",
        )

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        """Return this table [[gate]]; raise ValueError with its first mistake."""
        for mistake in (*self._mistakes_of_band(), *self._mistakes_of_names()):
            raise ValueError(mistake)
        return self

    def _mistakes_of_band(self) -> Iterator[str]:
        """Yield a sentence for each mistake in the band, the norm, the source or the
        kind of this gate, such as a band without a finite end.
        """
        low, high = self.between or (0.0, 0.0)
        if (self.tolerance is None) == (self.between is None):
            yield "give either tolerance or between"
        if not low <= high:
            yield "between is out of order; give [low, high]"
        if math.isinf(low) and math.isinf(high):
            yield (
                "between holds whatever the difference is, or never; give it a finite "
                "end"
            )
        if self.against == self.of:
            yield f"{self.of} is compared with itself; name another method"
        if not isinstance(self.against, str) and not self.source:
            yield "against is a number without a source; say where it comes from"
        if isinstance(self.against, str) and self.kind:
            yield (
                f"kind says what a number is, but against is {self.against!r}; leave "
                "it out"
            )
        is_distribution = self.quantity == "distribution"
        if (self.norm in DISTRIBUTION_NORMS) != is_distribution:
            yield (
                "a distribution, and nothing else, has the norm wasserstein or supremum"
            )
        if (self.norm == "l2") != self.quantity.startswith("field."):
            yield "a field, and nothing else, has the norm l2"

    def _mistakes_of_names(self) -> Iterator[str]:
        """Yield a sentence for each name of this gate that is unknown: its quantity,
        its reference, or a quantity that its closed form does not have.
        """
        quantity, against = self.quantity, self.against
        # A user's solver may report quantities of its own.
        reported = METHODS[self.of].source and quantity.startswith(REPORTED_GROUPS)
        if quantity not in QUANTITIES and not reported:
            hint = nearest(quantity, QUANTITIES)
            yield f"no quantity is called {quantity!r}{hint}"
        if not isinstance(against, str) or against in METHODS:
            return
        if against not in CLOSED_FORMS:
            hint = nearest(against, CLOSED_FORMS)
            yield (
                f"against is {against!r}, which is neither a method nor a closed "
                f"form{hint}"
            )
        elif not CLOSED_FORMS[against].knows(quantity):
            known = ", ".join(CLOSED_FORMS[against].quantities)
            yield f"the closed form {against} has no {quantity!r}; it has {known}"


@functools.cache
def default_gates() -> tuple[GateTable, ...]:
    """Return the tables of `default_gates.toml`: gates that every case of a method must
    hold.
    """
    text = (files(__package__) / "default_gates.toml").read_text("utf-8")
    return tuple(GateTable.model_validate(gate) for gate in tomllib.loads(text)["gate"])


def _or_absent(table: Any, validate: Any) -> Any:
    """Return the recipe of a table [surface], or a `SurfaceAbsent` if its file is
    optional and does not exist.

    `validate` is pydantic's function that makes the recipe of the table.  Raises its
    ValidationError for any other mistake.
    """
    try:
        return validate(table)
    except ValidationError as error:
        for detail in error.errors():
            reason = detail.get("ctx", {}).get("error")
            if isinstance(reason, surfaces.SurfaceAbsent):
                return reason
        raise


def _from_table(kind: type[Any], table: type[Table]) -> PlainValidator:
    """Return pydantic's validator of a field that a table of the case file gives.

    Args:
        kind: the class of the field's value, such as `Load`.
        table: the class of the table, whose keys are the arguments of `kind`.
    """

    def validate(given: Any) -> Any:
        """Return the value of a table.  Raises ValidationError or InvalidScene."""
        return kind(**table.model_validate(given).model_dump())

    return PlainValidator(validate, json_schema_input_type=table)


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
    load: Annotated[Load, _from_table(Load, LoadTable)]
    body: Annotated[Body, _from_table(Body, BodyTable)] = Field(default_factory=Body)
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
        """Store the path and the size of this case, its id and its methods as plain
        attributes; pydantic calls this after it has checked the tables.
        """
        self.__dict__.update(
            path=context["path"],
            size=context["size"],
            id=self.head.id,
            methods=tuple(self.head.methods),
        )

    def changed(self, **values: Any) -> Case:
        """Return a copy of this case in which the named fields or properties have other
        values, such as `gates` or `methods`.
        """
        saved = ("recipes", "options", "gates", *values)
        unchanged = {name: getattr(self, name) for name in saved}
        return self.model_copy(update=unchanged | values)

    # --- what is solved

    @cached_property
    def options(self) -> Mapping[str, Mapping[str, Any]]:
        """The options of each method of this case: by the method's name, a dictionary
        by the keys of its table; empty if the method has no table.
        """
        options = {}
        for name in self.methods:
            table = getattr(self, METHODS[name].table or "", None)
            options[name] = table.model_dump(exclude_none=True) if table else {}
        return options

    @cached_property
    def missing(self) -> dict[str, str]:
        """The methods of the case file that cannot run here, with the reason of each.

        A module or a program is missing that such a method needs.
        """
        reasons = {name: METHODS[name].missing for name in self.head.methods}
        return {name: reason for name, reason in reasons.items() if reason}

    @cached_property
    def skip(self) -> str:
        """The sentence that says why this case cannot run here, or "".

        It cannot if the file of its surface is missing, or what its methods need.
        """
        if isinstance(self.surface, surfaces.SurfaceAbsent):
            return f"skipped: {self.surface}"
        if len(self.missing) == len(self.head.methods):
            return f"skipped: {'; '.join(dict.fromkeys(self.missing.values()))}"
        return ""

    def unavailable(self, gate: Gate) -> str:
        """Return why a gate cannot be judged here: "" or a method and what it lacks."""
        for side in (gate.of, gate.against):
            if isinstance(side, str) and side in self.missing:
                return f"{side}: {self.missing[side]}"
        return ""

    def with_available_methods(self) -> Case:
        """Return this case without the methods that cannot run here, and without the
        gates that read them, which `not_judged` lists.
        """
        if not self.missing:
            return self
        methods = [name for name in self.methods if name not in self.missing]
        gates = [gate for gate in self.gates if not self.unavailable(gate)]
        left_out = [
            f"{gate.name} needs {self.unavailable(gate)}"
            for gate in self.gates
            if self.unavailable(gate)
        ]
        return self.changed(
            methods=tuple(methods),
            gates=tuple(gates),
            not_judged=(*self.not_judged, *left_out),
        )

    def to_judge(self) -> Case:
        """Return this case as a verification solves it.

        If each of its own gates at its size needs a method that cannot run here, the
        case is skipped: to judge it by the default gates of the other methods would say
        nothing about its requirement.
        """
        own = [table.gate for table in self._gates_at_size]
        judged = [gate for gate in own if not self.unavailable(gate)]
        if self.skip or judged or not self.missing:
            return self.with_available_methods()
        reasons = dict.fromkeys(self.missing.values())
        return self.changed(skip=f"skipped: {'; '.join(reasons)}", recipes=())

    @cached_property
    def recipes(self) -> tuple[surfaces.Recipe, ...]:
        """The recipes of the surfaces of this case; none if their file is missing.

        Raises InvalidScene if the two bodies have different numbers of surfaces.
        """
        absent = isinstance(self.surface, surfaces.SurfaceAbsent)
        recipes = () if absent else surfaces.recipes_of(self.surface)
        above = self.counterface.surface if self.counterface else None
        if not recipes or above is None:
            return recipes
        others = surfaces.recipes_of(above)
        if len(others) == 1:
            others *= len(recipes)
        if len(others) != len(recipes):
            raise InvalidScene(
                f"[surface] has {len(recipes)} seeds and [counterface.surface] "
                f"{len(others)}; give as many, or one to the counterface"
            )
        return tuple(map(surfaces.Facing, recipes, others))

    @cached_property
    def both(self) -> Material:
        """The elastic body of the same E* as the body of [material] and the counterface
        together.
        """
        body = Material(self.solid.young_modulus, self.solid.poisson_ratio)
        other = self.counterface
        if other is None:
            return body
        return combined_material(
            body, Material(other.young_modulus, other.poisson_ratio)
        )

    @property
    def two_bodies(self) -> dict[str, Any]:
        """The properties of the two bodies, by name, for the description of a result.

        The solvers replace both bodies by one of the same E*; these entries describe
        the original bodies.  Each has `value`, `unit` and `meaning`.  Empty without a
        counterface.
        """
        other = self.counterface
        if other is None:
            return {}
        rough = "rough" if other.surface is not None else "flat"
        moduli = f"E = {other.young_modulus:g} Pa, nu = {other.poisson_ratio:g}"
        words = (
            f"{rough} elastic half-space, {moduli}; the hardness is that of the first "
            "body"
        )
        if self.solid.hardness == "effective":
            words += ", of J2 bodies that touch a rigid flat at the E* of both"
        return {
            "young_modulus": {
                "value": self.solid.young_modulus,
                "unit": "Pa",
                "meaning": "Young's modulus E of the first body; E* is that of both",
            },
            "counterface": {"value": words, "unit": "", "meaning": "counterface"},
        }

    @cached_property
    def material(self) -> Material:
        """The material that is solved, with Young's modulus and Poisson's ratio of the
        body that replaces both, and an effective hardness as a number in Pa.

        Raises InvalidScene if the map of the effective hardness does not cover it.
        """
        values = self.solid.model_dump(include={f.name for f in fields(Material)})
        if values["hardness"] == "effective":
            # A case without its surface is skipped, and nothing asks for its hardness.
            values["hardness"] = getattr(self.mapped_hardness, "value", math.inf)
        values["young_modulus"] = self.both.young_modulus
        return Material(**values)

    @property
    def conductances(self) -> dict[str, float]:
        """Factor that converts conductance × resistivity (1/m) to W/(m² K) or S/m², for
        each kind of conductivity given for both bodies.
        """
        names = {f"{kind}_conductivities" for kind in CONDUCTING}
        factors = {}
        for name, conductivities in self.solid.model_dump(include=names).items():
            if conductivities:
                kind = name.partition("_")[0]
                factors[kind] = 1 / sum(1 / value for value in conductivities)
        return factors

    @property
    def lists_loads(self) -> bool:
        """Whether a verification measures and prints each load.

        It does so for a path, for a measured map, for conductances, for the columns
        that the case asks for, and under an effective hardness, whose interval is a
        part of the error of each value.
        """
        return (
            len(self.load.path) > 1
            or bool(self.head.columns)
            or isinstance(self.surface, surfaces.HeightsFromFile)
            or bool(self.conductances)
            or self.solid.hardness == "effective"
        )

    # --- the effective hardness

    @cached_property
    def mapped(self) -> tuple[MappedHardness, ...]:
        """The effective hardness of each load, from the map; () if it is given in Pa.

        A load below an earlier one keeps the hardness of the largest load so far.
        Raises InvalidScene if the map does not know such a scene.
        """
        surface = self.surface
        effective = self.solid.hardness == "effective"
        if not effective or isinstance(surface, surfaces.SurfaceAbsent):
            return ()
        self._require_mapped(surface)
        if self.counterface is not None and self.counterface.surface is not None:
            slope = inner_moments(self.recipes[0].build()).rms_slope
        elif isinstance(surface, surfaces.SelfAffineEnsemble):
            slope = surface.rms_slope
        else:  # of a map, the slope is that after its treatment
            surfaces.require_room(surface.shape)
            slope = inner_moments(surface.build()).rms_slope
        peaks = itertools.accumulate(self.load.path, max)
        return tuple(self.cap_at(slope, peak) for peak in peaks)

    def _require_mapped(self, surface: Any) -> None:
        """Raise InvalidScene if the material has no yield stress, or if the map of the
        hardness does not cover the surface or the body.
        """
        if math.isinf(self.solid.yield_stress):
            raise InvalidScene(
                "hardness is 'effective', which follows from the yield stress, but "
                "[material] has no yield_stress; add it, or give the hardness in Pa"
            )
        known = (surfaces.SelfAffineEnsemble, surfaces.HeightsFromFile)
        is_known = isinstance(surface, known)
        if not is_known or len(surfaces.recipes_of(surface)[0].shape) == 1:
            raise InvalidScene(
                "hardness is 'effective', which is known for rough surfaces only, "
                "those of kind self_affine and the maps of kind file; give it in Pa"
            )
        period = min(surface.periods)
        if self.body.depth < period:
            raise InvalidScene(
                "hardness is 'effective', which is known for deep bodies, but [body] "
                f"depth is {self.body.depth:g} m and the period {period:g} m; give it "
                "in Pa"
            )

    @property
    def mapped_hardness(self) -> MappedHardness | None:
        """The effective hardness at the largest mean pressure of the path; None if the
        case gives a hardness in Pa or none.
        """
        return max(self.mapped, key=lambda of_load: of_load.load, default=None)

    @property
    def told_hardness(self) -> str:
        """The effective hardness as text: one line for each load, then remarks on that
        of the largest load; "" if the hardness is not effective.
        """
        first, _, rest = str(self.mapped_hardness or "").partition("\n")
        yield_stress = self.solid.yield_stress
        by_load = {of_load.load * yield_stress: of_load for of_load in self.mapped}
        lines = [
            f"at {pressure:.4g} Pa: {of_load}".partition("\n")[0]
            for pressure, of_load in by_load.items()
        ]
        if len(lines) <= 1:
            lines = [first]
        return "\n".join([*lines, rest]).strip()

    @property
    def breadth(self) -> float | None:
        """Wavelength of the roll-off over the shortest one, of a random surface.

        It is None for maps and for two rough bodies, whose breadth is not known.
        """
        surface = self.surface
        two_rough = (
            self.counterface is not None and self.counterface.surface is not None
        )
        if two_rough or not isinstance(surface, surfaces.SelfAffineEnsemble):
            return None
        return surface.wavenumber_high / surface.wavenumber_roll_off

    def cap_at(self, rms_slope: float, mean_pressure: float) -> MappedHardness:
        """Return the effective hardness of the material.

        Args:
            rms_slope: of the surface, dimensionless.
            mean_pressure: in Pa.

        Raises:
            InvalidScene: outside the map.
        """
        return effective_hardness(
            yield_stress=self.solid.yield_stress,
            young_modulus=self.both.young_modulus,
            poisson_ratio=self.solid.poisson_ratio,
            rms_slope=rms_slope,
            mean_pressure=mean_pressure,
            breadth=self.breadth,
        )

    @cached_property
    def hardness_source(self) -> str:
        """The effective hardness and the source of its map, in one line; "" if the
        hardness is not effective.
        """
        mapped = self.mapped_hardness
        if mapped is None:
            return ""
        return f"{mapped}; {mapped.source}".replace("\n", " ")

    # --- what is judged

    @property
    def _gates_at_size(self) -> list[GateTable]:
        """The gates of the case file that apply to this size."""
        return [
            gate for gate in self.gate if gate.sizes is None or self.size in gate.sizes
        ]

    @cached_property
    def gates(self) -> tuple[Gate, ...]:
        """The gates at this size: the case's own, and the default gates of its methods.

        A gate of the case replaces the default gate on the same quantity of the same
        method.  A case that is there to be run or swept has no gate at all.
        """
        own = self._gates_at_size
        replaced = {(gate.of, gate.quantity) for gate in own}
        shared = [
            gate
            for gate in default_gates()
            if self.gate
            and gate.of in self.methods
            and self.size in (gate.sizes or ())
            and (gate.of, gate.quantity) not in replaced
        ]
        return tuple(gate.gate for gate in (*own, *shared))

    @cached_property
    def not_judged(self) -> tuple[str, ...]:
        """A sentence for each gate of this case that does not apply to its size."""
        return tuple(
            f"{gate.gate.name} applies to size {' and '.join(gate.sizes)} only"
            for gate in self.gate
            if gate.sizes and self.size not in gate.sizes
        )

    # --- its scenes and its folder

    def digest(self, recipe: surfaces.Recipe) -> str:
        """Return the SHA-256 of this case's scene on the surface of a recipe.

        The surface itself is not made.
        """
        return scene_digest(
            recipe.fingerprint,
            recipe.shape,
            recipe.periods,
            self.material,
            self.body,
            self.load,
        )

    def folder(self, output: Path) -> Path:
        """Return the folder of this case's results, `<output>/<case>/<size>`.

        `output` is the output folder of the run.
        """
        return output / self.id / self.size

    def scene(self, recipe: surfaces.Recipe) -> Scene:
        """Make the surface of a recipe, and return this case's scene on it.

        Raises InvalidScene if the scene is not valid, and NotEnoughMemory if the grid
        is too large for this machine.
        """
        surfaces.require_room(recipe.shape)
        return Scene(recipe.build(), self.material, self.load, self.body)
