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
        """A text that identifies the heights of this recipe without computing them."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of grid points of this recipe's surface along each direction."""

    @property
    def periods(self) -> tuple[float, ...]:
        """Lengths of the period of this recipe's surface along each direction, in m."""

    def build(self) -> Surface:
        """Return the surface with its heights.

        Raises InvalidScene or NotEnoughMemory if the surface cannot be made.
        """


class SurfaceAbsent(InvalidScene):
    """The file of a surface is absent, and the user called it optional."""


# --- fields ---------------------------------------------------------------------------


def entry(unit: str, meaning: str, **bounds: Any) -> Any:
    """Return the part of an annotation that describes a field.

    Args:
        unit: the unit of the field, such as "m"; "" if it has none.
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
    """Return the lengths of a TOML file as a tuple.

    A single number becomes a tuple of one, and a list a tuple.  A dictionary, which has
    other values for other sizes of a case, is returned unchanged.
    """
    if isinstance(value, list | tuple | dict):
        return _list_to_tuple(value)
    return (value,)


def sequence(kind: Any) -> BeforeValidator:
    """Return the part of an annotation that accepts a list of a TOML file.

    The list becomes a tuple before it is checked.

    Args:
        kind: the type of the items, for the JSON schema of case files.
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
        """Collect the entries of a subclass, and list them in its docstring."""
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
        """Check each field of this recipe by its annotation.

        A number is stored as the type of its field.  Raises InvalidScene if a value is
        out of its range.
        """
        for name, (kind, info) in self.entries.items():
            value = _checked(name, getattr(self, name), kind, info, unit_of(self, name))
            set_frozen(self, **{name: value})


def unit_of(recipe: Any, name: str) -> str:
    """Return the unit of a field of a recipe, such as "m"; "" if it has none.

    Args:
        recipe: a recipe of a surface.
        name: the name of one of its fields.
    """
    _, info = getattr(recipe, "entries", {}).get(name, (None, None))
    extra = info.json_schema_extra if info else None
    return str(extra["unit"]) if isinstance(extra, dict) else ""


def _checked(name: str, given: Any, kind: Any, info: FieldInfo, unit: str) -> Any:
    """Return the value of a field as the type that its annotation asks for.

    Args:
        name: the name of the field, for messages.
        given: the value that the user gives.
        kind: the type of the field.
        info: its bounds, as of `pydantic.Field`.
        unit: the unit of the field, "" if it has none, for messages.

    Raises:
        InvalidScene: The value has another type, is out of its bounds, or is none of
            the words that are allowed.
    """
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
        """Check the fields of this recipe; a single period counts for both directions.

        Raises InvalidScene if a value is out of its range, or if grid and periods do
        not fit each other.
        """
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
        """The text that identifies the heights: the formula and every field.

        Equal numbers have equal texts, whether they are integers or floats.
        """
        return f"{self.formula} {_words(self)}"

    def build(self: Any) -> Surface:
        """Return the surface of this recipe with its heights.

        Raises NotEnoughMemory if the heights do not fit into memory.
        """
        require_room(self.shape)
        heights = self._heights()
        heights.flags.writeable = False
        about = self._about()
        return Surface(heights, self.periods, recipe=self.fingerprint, **about)

    def _heights(self) -> FloatArray:
        """Return the heights of this recipe in m, of the shape of its grid."""
        raise NotImplementedError

    def _about(self) -> dict[str, Any]:
        """Return what this recipe knows of its surface beside the heights.

        The keys may be `spectrum`, `seed` and `shortest_wavelength` (m), arguments of
        `Surface`.
        """
        return {}


def _words(value: Any) -> str:
    """Return a value of a recipe as text, a part of the recipe's fingerprint.

    Args:
        value: a number, a text, a tuple of values, or a dataclass, of which every field
            but `kind` is named with its value.
    """
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
    """Return the shape of a grid as a tuple of int and its periods as one of float.

    Args:
        given_shape: numbers of grid points, (nx, ny) or (nx,), at least 2 each.
        given_periods: as many lengths in m, (Lx, Ly) or (L,), all positive.

    Raises:
        InvalidScene: A value is none of these, or the two have different lengths.
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
    """Raise NotEnoughMemory if a surface would not fit into memory.

    A surface needs 16 bytes for each grid point: 8 for its height and 8 for its Fourier
    modes.  Below 256 MiB nothing is raised.

    Args:
        shape: the number of grid points along each direction.
    """
    needed = 16 * math.prod(shape)
    if needed >= SMALL and needed > available_memory():
        grid = " x ".join(map(str, shape))
        raise NotEnoughMemory(
            f"a surface of {grid} points needs {needed / 2**30:.3g} GiB, more than "
            "there is; use a coarser grid"
        )
