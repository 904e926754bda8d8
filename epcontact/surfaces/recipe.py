"""The parts that all recipes share: their interface, their fields and the checks of
them.

A recipe is a frozen dataclass and also the checked form of the table [surface] of a
case file.  Each field is stated once, in its annotation: type, unit, meaning and
bounds. Pydantic checks case files by the annotations, and `Fields` checks a Python
user's arguments by them and lists them at the end of a docstring.
"""

from __future__ import annotations

import math
from dataclasses import asdict, fields, is_dataclass
from types import NoneType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    Protocol,
    get_args,
    get_origin,
    get_type_hints,
)

from pydantic import BeforeValidator, Field, StrictFloat, StrictInt
from pydantic.fields import FieldInfo

from epcontact.errors import InvalidScene, NotEnoughMemory
from epcontact.machine import available_memory
from epcontact.results import FloatArray
from epcontact.scene import Surface, integer, positive, require_one_of, set_frozen

#: Bytes of memory that every machine has.
SMALL = 2**28


class Recipe(Protocol):
    """How to make one surface; `build` sets `Surface.recipe` to `fingerprint`."""

    @property
    def fingerprint(self) -> str:
        """A text that identifies the heights without making them."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of grid points along each direction."""

    @property
    def periods(self) -> tuple[float, ...]:
        """Lengths of the period along each direction, in m."""

    def build(self) -> Surface:
        """Make the surface."""


class SurfaceAbsent(InvalidScene):
    """The file of a surface is absent, and the user called it optional."""


# --- fields ---------------------------------------------------------------------------


def entry(unit: str, meaning: str, **bounds: Any) -> Any:
    """Return the part of an annotation that describes a field.

    Args:
        unit: the unit of the field; empty if it has none.
        meaning: what the field is, in a few words.
        bounds: arguments of `pydantic.Field`, such as gt=0.
    """
    if not unit:
        return Field(description=meaning, **bounds)
    extra: dict[str, Any] = {"unit": unit}
    return Field(description=f"{unit}; {meaning}", json_schema_extra=extra, **bounds)


def _list_to_tuple(value: Any) -> Any:
    """Return a list of a TOML file as a tuple, and anything else unchanged."""
    return tuple(value) if isinstance(value, list) else value


def _as_lengths(value: Any) -> Any:
    """Return a single length of a TOML file as a tuple of one, and a list as a tuple.

    A table, which has other values for other sizes, is not for this field to check.
    """
    if isinstance(value, list | tuple | dict):
        return _list_to_tuple(value)
    return (value,)


def sequence(kind: Any) -> BeforeValidator:
    """Return the part of an annotation that accepts a list of a TOML file.

    `kind` is the type of the items, for the schema.
    """
    return BeforeValidator(_list_to_tuple, json_schema_input_type=list[kind])


# The fields of several recipes.  A case file calls the periods `period`.
Lengths = Annotated[
    tuple[StrictFloat, ...],
    BeforeValidator(_as_lengths, json_schema_input_type=float | list[float]),
]
Periods = Annotated[
    Lengths, entry("m", "one length, or [x, y]", validation_alias="period")
]
Shape = Annotated[
    tuple[StrictInt, ...],
    sequence(int),
    entry("", "grid points [nx, ny], or [nx] for a line"),
]


class Fields:
    """The base of recipes: checks fields by their annotations, and lists them in
    help.
    """

    #: The type and the `entry` of each field that has one.
    entries: ClassVar[dict[str, tuple[Any, FieldInfo]]]

    def __init_subclass__(cls) -> None:
        types = get_type_hints(cls)
        cls.entries = {}
        for name, hint in get_type_hints(cls, include_extras=True).items():
            for part in (hint, *get_args(hint)):
                for info in getattr(part, "__metadata__", ()):
                    if isinstance(info, FieldInfo) and info.description:
                        cls.entries[name] = (types[name], info)
        lines = [(cls.__doc__ or "").rstrip(), "", "    Args:"]
        for name, (_, info) in cls.entries.items():
            lines.append(f"        {name}: {info.description}.")
        lines += [
            "",
            "    Raises:",
            "        InvalidScene: if a value is out of its range or does not fit the "
            "others.",
            "    ",
        ]
        cls.__doc__ = "\n".join(lines)

    def __post_init__(self) -> None:
        for name, (kind, info) in self.entries.items():
            value = _checked(name, getattr(self, name), kind, info, unit_of(self, name))
            set_frozen(self, **{name: value})


def unit_of(recipe: Any, name: str) -> str:
    """Return the unit of the field `name` of a recipe; empty if it has none."""
    _, info = getattr(recipe, "entries", {}).get(name, (None, None))
    extra = info.json_schema_extra if info else None
    return str(extra["unit"]) if isinstance(extra, dict) else ""


def _checked(name: str, given: Any, kind: Any, info: FieldInfo, unit: str) -> Any:
    """Return a field's value as its annotation asks for it.  Raises InvalidScene."""
    kinds = get_args(kind) if NoneType in get_args(kind) else (kind,)
    if given is None and NoneType in kinds:
        return None
    bounds: dict[str, Any] = {}
    for bound in info.metadata:
        bounds |= asdict(bound)
    if float in kinds and bounds.get("gt") == 0:
        return positive(name, given, unit)
    if int in kinds and "ge" in bounds:
        return integer(name, given, bounds["ge"])
    if get_origin(kind) is Literal:
        require_one_of(name, given, kind)
    return given


# --- surfaces that follow from their fields -------------------------------------------


class Generated(Fields):
    """The base of recipes whose heights follow from their fields alone.

    The fields include the `shape` and the `periods` of the grid.
    """

    #: The name and version of the formula, with which a fingerprint begins.
    formula: ClassVar[str]

    def __post_init__(self: Any) -> None:
        super().__post_init__()
        shape = self.shape
        periods = self.periods
        both_are_tuples = isinstance(periods, tuple) and isinstance(shape, tuple)
        if both_are_tuples and len(periods) == 1:
            periods = periods * max(1, len(shape))
        shape, periods = checked_grid(shape, periods)
        set_frozen(self, shape=shape, periods=periods)

    @property
    def fingerprint(self) -> str:
        """The formula and every field; equal numbers read equal."""
        return f"{self.formula} {_words(self)}"

    def build(self: Any) -> Surface:
        """Make the surface.

        Raises NotEnoughMemory if its heights do not fit into memory.
        """
        require_room(self.shape)
        heights = self._heights()
        heights.flags.writeable = False
        about = self._about()
        return Surface(heights, self.periods, recipe=self.fingerprint, **about)

    def _heights(self) -> FloatArray:
        """Return the heights in m, of the recipe's shape."""
        raise NotImplementedError

    def _about(self) -> dict[str, Any]:
        """Return those of the surface's `spectrum`, `seed` and `shortest_wavelength`
        that it has.
        """
        return {}


def _words(value: Any) -> str:
    """Return a field, or all fields of a dataclass, as a part of a fingerprint."""
    if is_dataclass(value):
        # The formula stands for the kind.
        names = [f.name for f in fields(value) if f.name != "kind"]
        return " ".join(f"{name}={_words(getattr(value, name))}" for name in names)
    if isinstance(value, tuple):
        return "(" + ",".join(map(_words, value)) + ")"
    if isinstance(value, str):
        return value
    if value == int(value):
        return repr(int(value))
    return repr(float(value))


# --- grids ----------------------------------------------------------------------------


def checked_grid(
    given_shape: Any, given_periods: Any
) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Return the shape as a tuple of int and the periods (m) as a tuple of float.

    Raises InvalidScene if they are not one or two positive numbers each, as many of
    both.
    """
    try:
        shape = tuple(integer("shape", n, 2) for n in given_shape)
        periods = tuple(positive("periods", p, "m") for p in given_periods)
    except TypeError:
        raise InvalidScene(
            f"shape = {given_shape!r} and periods = {given_periods!r} are given, but "
            "(nx, ny) and (Lx, Ly), or (nx,) and (L,) for a line, are needed"
        ) from None
    if len(shape) not in (1, 2):
        raise InvalidScene(
            f"shape is {given_shape!r}, but must be one or two whole numbers"
        )
    if len(periods) != len(shape):
        expected = f"{len(shape)} positive lengths in m"
        raise InvalidScene(f"periods is {given_periods!r}, but must be {expected}")
    return shape, periods


def require_room(shape: tuple[int, ...]) -> None:
    """Raise NotEnoughMemory if the heights of a grid and their modes would not fit into
    memory.
    """
    needed = 16 * math.prod(shape)
    if needed >= SMALL and needed > available_memory():
        grid = " x ".join(map(str, shape))
        raise NotEnoughMemory(
            f"a surface of {grid} points needs {needed / 2**30:.3g} GiB, more than "
            "there is; use a coarser grid"
        )
