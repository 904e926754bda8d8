"""The keys of a case file: their names, types, units and meaning.

One class a table.  Any value may be given by size instead, as in
`shape = { fast = [256, 256], full = [1024, 1024] }`; sizes are resolved before these classes
see the values.  `epcontact keys` prints what stands here.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, create_model, model_validator

from epcontact.errors import nearest
from epcontact.harness.methods import METHODS, Table


def _registered(name: str) -> str:
    if name not in METHODS:
        raise ValueError(f"no method is called {name!r}{nearest(name, METHODS)}")
    return name


MethodName = Annotated[
    str, AfterValidator(_registered), Field(json_schema_extra={"enum": list(METHODS)})
]
Lengths = float | list[float]


class CaseTable(Table):
    """[case]: what is required, and why anyone should believe it."""

    id: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9._-]*$", max_length=80)] = Field(
        description="name of the case, of its folder of results and on the command line"
    )
    requirement: str = Field(min_length=1, description="the requirement, one English sentence")
    source: str = Field(min_length=1, description="where the requirement or its figures stand")
    methods: list[MethodName] = Field(min_length=1, description="the methods that answer the scene")
    time_limit: float = Field(
        default=900.0, gt=0, description="seconds after which one solve is given up"
    )
    verify: bool = Field(
        default=True, description="whether a bare `epcontact verify` includes the case"
    )


class SelfAffineTable(Table):
    """[surface] of kind self_affine: random phases on an isotropic power-law spectrum."""

    kind: Literal["self_affine"]
    period: Lengths = Field(description="m; one length, or [x, y]")
    hurst: float = Field(description="Hurst exponent, 0 to 1")
    wavenumber_low: float = Field(description="rad/m; no roughness below")
    wavenumber_roll_off: float = Field(description="rad/m; flat spectrum below, power law above")
    wavenumber_high: float = Field(description="rad/m; no roughness above")
    rms_slope: float = Field(description="m/m; exact on the grid")
    points_per_shortest_wavelength: int | None = Field(
        default=None, ge=3, description="grid points per 2 pi / wavenumber_high; or give shape"
    )
    shape: list[int] | None = Field(default=None, description="grid points [nx, ny], or [nx]")
    seeds: list[Annotated[int, Field(ge=0)]] = Field(
        min_length=1, description="one random surface each; gates read their mean"
    )

    @model_validator(mode="after")
    def _one_resolution(self) -> SelfAffineTable:
        if (self.shape is None) == (self.points_per_shortest_wavelength is None):
            raise ValueError("give either points_per_shortest_wavelength or shape")
        if len(set(self.seeds)) != len(self.seeds):
            raise ValueError("seeds repeat a surface; give each seed once")
        return self


class SinusoidTable(Table):
    """[surface] of kind sinusoid: one Fourier mode a direction, crest at the origin."""

    kind: Literal["sinusoid"]
    period: Lengths = Field(description="m; one length, or [x, y]")
    shape: list[int] = Field(description="grid points [nx, ny], or [nx] for a line")
    amplitude: float = Field(gt=0, description="m; from the mean plane to a crest")
    waves: int = Field(default=1, ge=1, description="whole waves in a period")
    direction: Literal["x", "y", "both"] = Field(
        default="x", description="waves along one direction, or the product of both"
    )


class ParaboloidTable(Table):
    """[surface] of kind paraboloid: one bump of given radius of curvature in mid-period."""

    kind: Literal["paraboloid"]
    period: Lengths = Field(description="m; one length, or [x, y]")
    shape: list[int] = Field(description="grid points [nx, ny], or [nx] for a cylinder")
    radius: float = Field(gt=0, description="m; radius of curvature at the summit")
    centre: list[float] = Field(
        default=[], description="of the bump, as fractions of the periods; else in the middle"
    )


class FlatPunchTable(Table):
    """[surface] of kind flat_punch: one flat-topped post."""

    kind: Literal["flat_punch"]
    period: Lengths = Field(description="m; one length, or [x, y]")
    shape: list[int] = Field(description="grid points [nx, ny], or [nx] for a strip")
    radius: float = Field(gt=0, description="m; radius, or half-width of a strip")
    depth: float = Field(gt=0, description="m; height of the post over what surrounds it")
    centre: list[float] = Field(
        default=[], description="of the post, as fractions of the periods; else in the middle"
    )


class FileTable(Table):
    """[surface] of kind file: measured or computed heights."""

    kind: Literal["file"]
    path: str = Field(min_length=1, description="file, relative to the case file")
    period: Lengths | None = Field(
        default=None, description="m; needed where the file does not know its own size"
    )
    unit: float = Field(default=1.0, gt=0, description="m; the unit the heights are written in")
    pixel_size: float | None = Field(
        default=None, gt=0, description="m; spacing of the grid, in the place of period"
    )
    treatment: Literal["refuse", "periodic", "detrend_and_window"] = Field(
        default="refuse",
        description="a map that is not periodic: refused, taken as it is, or made periodic",
    )
    taper: float = Field(
        default=0.1, description="share of a period over which the window rises, and falls"
    )
    optional: bool = Field(
        default=False, description="skip the case with a sentence where the file is absent"
    )


SurfaceTable = Annotated[
    SelfAffineTable | SinusoidTable | ParaboloidTable | FlatPunchTable | FileTable,
    Field(discriminator="kind"),
]


class MaterialTable(Table):
    """[material]: an elastoplastic solid against a rigid flat."""

    young_modulus: float = Field(description="Pa")
    poisson_ratio: float = Field(description="between -1 and 0.5")
    hardness: float = Field(default=float("inf"), description="Pa; cap of the contact pressure")
    yield_stress: float = Field(default=float("inf"), description="Pa; of the J2 solid")


class BodyTable(Table):
    """[body]: what lies under the surface."""

    kind: Literal["half_space", "bonded_layer", "sliding_layer"] = Field(
        default="half_space", description="half-space, or layer on a rigid base"
    )
    depth: float = Field(default=float("inf"), description="m; of a layer")


class LoadTable(Table):
    """[load]: force over the nominal area."""

    mean_pressure: float | list[float] = Field(description="Pa; one, or a path of them")


class GateTable(Table):
    """[[gate]]: one comparison that must hold."""

    quantity: Annotated[
        str,
        Field(
            pattern=r"^(area\.(total|elastic|plastic)\.(raw|corrected|error)|mean_pressure|"
            r"distribution|(quantity|residual|iterations|cost|field)\.[a-z0-9_]+)$"
        ),
    ] = Field(
        description="area.<total|elastic|plastic>.<raw|corrected|error>, quantity.<name>, "
        "residual.<name>, iterations.<name>, cost.<name>, distribution, or field.<name>; "
        "quantity.measured_<force|bounds|gap|raw_total|raw_plastic|carried> is measured on the "
        "method's fields, quantity.surface_<rms_height|rms_slope|curvature> on the surface, by "
        "the harness itself; of fem under j2 quantity.model_<area|overlap|distance> tells it from "
        "the capped bem on the elements' own compliance, quantity.effective_<hardness|overlap> "
        "is hardness/yield_stress at equal contact area and the overlap there, and "
        "quantity.elements_area what the elements' compliance does to the capped area"
    )
    of: MethodName = Field(description="the method that is judged")
    against: str | float = Field(description="a method, a closed form's name, or a number")
    norm: Literal["relative", "absolute", "wasserstein", "supremum", "l2"] = Field(
        default="relative", description="how the difference is measured"
    )
    tolerance: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="the difference lies within +- tolerance",
    )
    between: list[float] | None = Field(
        default=None,
        min_length=2,
        max_length=2,
        description="or the difference lies in [low, high]",
    )
    because: str = Field(min_length=1, description="why the band is as wide as it is")
    source: str = Field(default="", description="where a number comes from; needed for one")
    sizes: list[Literal["fast", "full", "large"]] | None = Field(
        default=None, min_length=1, description="the sizes it applies to; else all"
    )

    @model_validator(mode="after")
    def _one_band(self) -> GateTable:
        if (self.tolerance is None) == (self.between is None):
            raise ValueError("give either tolerance or between")
        if self.between is not None and not self.between[0] <= self.between[1]:
            raise ValueError("between is out of order; give [low, high]")
        if self.between is not None and all(map(math.isinf, self.between)):
            raise ValueError("between holds whatever the difference is, or never; give it an end")
        if isinstance(self.against, float | int) and not math.isfinite(self.against):
            raise ValueError(f"against is {self.against}, but must be a finite number")
        if self.against == self.of:
            raise ValueError(f"{self.of} is held against itself, which tells nothing")
        if isinstance(self.against, float | int) and not self.source:
            raise ValueError("against is a number without a source; say where it comes from")
        if (self.quantity == "distribution") != (self.norm in ("wasserstein", "supremum")):
            raise ValueError("a distribution is measured by wasserstein or supremum, and only it")
        if self.quantity.startswith("field.") != (self.norm == "l2"):
            raise ValueError("a field is measured by the norm l2, and only it")
        return self


class _Sections(Table):
    """The sections of a case file that do not depend on its methods."""

    case: CaseTable
    surface: SurfaceTable
    material: MaterialTable
    load: LoadTable
    body: BodyTable = BodyTable()
    gate: list[GateTable] = Field(min_length=1)


def _method_sections() -> dict[str, Any]:
    """The table of each method's options; None unless every key has a default."""
    sections: dict[str, Any] = {}
    for method in METHODS.values():
        needed = any(field.is_required() for field in method.options.model_fields.values())
        if needed:
            sections[method.table] = (method.options | None, None)
        elif method.table:
            sections[method.table] = (method.options, method.options())
    return sections


class CaseFile(create_model("CaseFile", __base__=_Sections, **_method_sections())):  # type: ignore
    """A whole case file."""


#: The table of each section that has but one form.
TABLES: dict[str, type[Table]] = {
    "case": CaseTable,
    "material": MaterialTable,
    "body": BodyTable,
    "load": LoadTable,
    **{method.table: method.options for method in METHODS.values() if method.table},
    "gate": GateTable,
}


def key_table() -> list[tuple[str, str, str, str]]:
    """Every key as (table, key, default, meaning with unit)."""
    surfaces = (SelfAffineTable, SinusoidTable, ParaboloidTable, FlatPunchTable, FileTable)
    tables = [(name, table) for name, table in TABLES.items() if name != "gate"]
    tables += [(f"surface, {t.__name__.removesuffix('Table')}", t) for t in surfaces]
    tables.append(("gate", GateTable))
    rows = []
    for name, table in tables:
        for key, field in table.model_fields.items():
            default = "required" if field.is_required() else str(field.default)
            rows.append((name, key, default, field.description or "kind of surface"))
    return rows
