"""A case at one size: the tables of its file, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field, PlainValidator, PrivateAttr, ValidationError, WrapValidator

from epcontact.errors import InvalidScene
from epcontact.harness.case_files.axes import SweepTable
from epcontact.harness.case_files.tables import (
    BodyTable,
    CaseTable,
    GateTable,
    LoadTable,
    MaterialTable,
    OmitTable,
    default_gates,
)
from epcontact.harness.gates.gate import Gate
from epcontact.harness.methods.registry import METHODS, BemTable, FemTable, Table, TheoryTable
from epcontact.materials.hardness_map import MappedHardness, effective_hardness
from epcontact.scene import Body, Load, Material, Scene, scene_digest
from epcontact.surfaces import (
    CaseSurface,
    HeightsFromFile,
    Recipe,
    SelfAffineEnsemble,
    SurfaceAbsent,
    recipes_of,
    require_room,
)
from epcontact.surfaces.power_spectrum import surface_moments


def _or_absent(table: Any, validate: Any) -> Any:
    """Return the recipe of a table [surface], or the error of an absent optional file."""
    try:
        return validate(table)
    except ValidationError as error:
        reasons = (detail.get("ctx", {}).get("error") for detail in error.errors())
        absent = next((r for r in reasons if isinstance(r, SurfaceAbsent)), None)
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
    """One case at one size: its tables, and the scenes, options and gates that follow from them.

    `case_files.case.load_case` makes it.  No surface is made before it is asked for.
    """

    # Each table is strict by itself; a strict recipe could not be made from a table.
    model_config = ConfigDict(strict=False)

    head: CaseTable = Field(alias="case")
    surface: Annotated[CaseSurface, Field(discriminator="kind"), WrapValidator(_or_absent)]
    solid: MaterialTable = Field(alias="material")
    load: Annotated[Load, _part(Load, LoadTable)]
    body: Annotated[Body, _part(Body, BodyTable)] = Field(default_factory=Body)
    gate: list[GateTable] = Field(
        default=[], description="comparisons; only a case with a sweep may have none"
    )
    omit: list[OmitTable] = Field(default=[], description="default gates that do not apply")
    sweep: SweepTable | None = Field(default=None, description="values that a sweep gives to keys")
    theory: TheoryTable | None = None
    bem: BemTable = BemTable()
    fem: FemTable = FemTable()

    _path: Path = PrivateAttr()
    _size: str = PrivateAttr()

    def model_post_init(self, context: Any) -> None:
        """Keep where the tables come from."""
        self._path, self._size = context["path"], context["size"]

    def changed(self, **values: Any) -> Case:
        """Return a copy in which fields or properties have other values, and the rest its own."""
        derived = ("methods", "recipes", "options", "gates")
        own = {name: getattr(self, name) for name in (*derived, *values)}
        return self.model_copy(update=own | values)

    @cached_property
    def path(self) -> Path:
        """The file."""
        return self._path

    @cached_property
    def size(self) -> str:
        """The size at which the tables were read."""
        return self._size

    @cached_property
    def id(self) -> str:
        """The name of the case."""
        return self.head.id

    @cached_property
    def methods(self) -> tuple[str, ...]:
        """The methods that answer the scenes."""
        return tuple(self.head.methods)

    @cached_property
    def options(self) -> Mapping[str, Mapping[str, Any]]:
        """The options of each method."""
        tables = {name: getattr(self, METHODS[name].table or "", None) for name in self.methods}
        return {n: t.model_dump(exclude_none=True) if t else {} for n, t in tables.items()}

    @cached_property
    def skip(self) -> str:
        """The sentence that says why the case cannot run here, or ""."""
        if isinstance(self.surface, SurfaceAbsent):
            return f"skipped: {self.surface}"
        missing = next((m for name in self.methods if (m := METHODS[name].missing)), "")
        return f"skipped: {missing}" if missing else ""

    @cached_property
    def recipes(self) -> tuple[Recipe, ...]:
        """The recipes of the surfaces; none if the case is skipped."""
        return () if self.skip else recipes_of(self.surface)

    @cached_property
    def mapped_hardness(self) -> MappedHardness | None:
        """The map's hardness at the largest mean pressure, where the file calls it effective."""
        given, surface = self.solid, self.surface
        if given.hardness != "effective" or isinstance(surface, SurfaceAbsent):
            return None
        if not isinstance(surface, SelfAffineEnsemble | HeightsFromFile) or (
            len(recipes_of(surface)[0].shape) == 1
        ):
            raise InvalidScene(
                "hardness is 'effective', which is known for rough surfaces only, those of kind "
                "self_affine and the maps of kind file; give it in Pa"
            )
        if self.body.depth < min(surface.periods):
            raise InvalidScene(
                f"hardness is 'effective', which is known for deep bodies, but [body] depth is "
                f"{self.body.depth:g} m and the period {min(surface.periods):g} m; give it in Pa"
            )
        if isinstance(surface, HeightsFromFile):  # as it is after its treatment
            require_room(surface.shape)
            slope = surface_moments(surface.build()).rms_slope
        else:
            slope = surface.rms_slope
        return effective_hardness(
            yield_stress=given.yield_stress,
            young_modulus=given.young_modulus,
            poisson_ratio=given.poisson_ratio,
            rms_slope=slope,
            mean_pressure=max(self.load.path),
        )

    @cached_property
    def material(self) -> Material:
        """The material.  Raises InvalidScene."""
        given = self.solid.model_dump()
        if given["hardness"] == "effective":
            # A case without its surface is skipped, and nothing asks for its cap.
            given["hardness"] = getattr(self.mapped_hardness, "value", math.inf)
        return Material(**given)

    @cached_property
    def hardness_source(self) -> str:
        """The effective hardness and what it rests on, or ""."""
        found = self.mapped_hardness
        return "" if found is None else f"{found}; {found.rests_on}".replace("\n", " ")

    @cached_property
    def gates(self) -> tuple[Gate, ...]:
        """The gates at this size: the case's own, and the default gates of its methods.

        A gate of the case replaces the default gate on the same quantity of the same method, and a
        table [[omit]] removes one.  A case that is there for its sweep has no gate at all.
        """
        own = [gate for gate in self.gate if gate.sizes is None or self.size in gate.sizes]
        replaced = {(g.of, g.quantity) for g in own} | {(o.of, o.quantity) for o in self.omit}
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
        """A sentence for each gate that the case has or omits and that this size leaves out."""
        elsewhere = [g for g in self.gate if g.sizes and self.size not in g.sizes]
        return (
            *(
                f"{g.gate.name} applies to size {' and '.join(g.sizes or ())} only"
                for g in elsewhere
            ),
            *(f"default gate {o.quantity} of {o.of} is omitted: {o.because}" for o in self.omit),
        )

    def digest(self, recipe: Recipe) -> str:
        """Return the digest of the scene on a surface, without making the surface."""
        return scene_digest(
            recipe.fingerprint, recipe.shape, recipe.periods, self.material, self.body, self.load
        )

    def folder(self, output: Path) -> Path:
        """Return the folder of its results: one for each size, `<output>/<case>/<size>`."""
        return output / self.id / self.size

    def scene(self, recipe: Recipe) -> Scene:
        """Make the surface and the scene on it.  Raises InvalidScene, NotEnoughMemory."""
        require_room(recipe.shape)
        return Scene(recipe.build(), self.material, self.load, self.body)
