"""The parts that all recipes share: their interface, their fields and the checks of
them.

A recipe is a frozen dataclass and also the checked form of the table [surface] of a
case file. Each field is stated once, in its annotation: type, unit, meaning and bounds.
Pydantic checks case files by it and `Fields` a Python user's arguments, and it is
listed at the end of a docstring.
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

from pydantic import BeforeValidator, Field, Strict
from pydantic.fields import FieldInfo

from epcontact.errors import InvalidScene, NotEnoughMemory
from epcontact.machine import available_memory
from epcontact.results import FloatArray
from epcontact.scene import Surface, integer, positive, require_one_of, set_frozen

#: Bytes of memory that every machine has.
SMALL = 2**28


class Recipe(Protocol):
    """One surface; `build` sets `Surface.recipe` to `fingerprint`."""

    @property
    def fingerprint(self) -> str:
        """A text that identifies the heights without making them."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Grid points along each direction."""

    @property
    def periods(self) -> tuple[float, ...]:
        """Lengths of the period along each direction, in m."""

    def build(self) -> Surface:
        """Make the surface."""


class SurfaceAbsent(InvalidScene):
    """The file of a surface is absent, and the user called it optional."""


# --- fields
# --------------------------------------------------------------------------------------


def entry(unit: str, meaning: str, **bounds: Any) -> Any:
    """Return the part of an annotation that gives a field's unit ("": none), meaning
    and bounds.
    """
    words = f"{unit}; {meaning}" if unit else meaning
    return Field(
        description=words, json_schema_extra={"unit": unit} if unit else None, **bounds
    )


def _as_tuple(value: Any) -> Any:
    """Turn a list of a TOML file into a tuple; return anything else unchanged."""
    return tuple(value) if isinstance(value, list) else value


def sequence(kind: Any) -> BeforeValidator:
    """Return the part of an annotation that takes a list of a TOML file."""
    return BeforeValidator(_as_tuple, json_schema_input_type=list[kind])


# Numbers of a case file are strict: text and booleans are not converted.
Real = Annotated[float, Strict()]
Whole = Annotated[int, Strict()]

# The fields of several recipes.  A case file calls the periods `period`.
Lengths = Annotated[
    tuple[Real, ...],
    BeforeValidator(
        lambda value: (
            _as_tuple(value) if isinstance(value, list | tuple | dict) else (value,)
        ),
        json_schema_input_type=float | list[float],
    ),
]
Periods = Annotated[
    Lengths, entry("m", "one length, or [x, y]", validation_alias="period")
]
Shape = Annotated[
    tuple[Whole, ...],
    sequence(int),
    entry("", "grid points [nx, ny], or [nx] for a line"),
]


class Fields:
    """The base of recipes: checks the fields by their annotations, and lists them in
    the help.
    """

    #: The type and the `entry` of each field that has one.
    entries: ClassVar[dict[str, tuple[Any, FieldInfo]]]

    def __init_subclass__(cls) -> None:
        plain = get_type_hints(cls)
        cls.entries = {
            name: (plain[name], info)
            for name, hint in get_type_hints(cls, include_extras=True).items()
            for part in (hint, *get_args(hint))
            for info in getattr(part, "__metadata__", ())
            if isinstance(info, FieldInfo) and info.description
        }
        stated = "\n".join(
            f"        {n}: {f.description}." for n, (_, f) in cls.entries.items()
        )
        raised = "        InvalidScene: if a value is out of its range or does not fit the others."
        text = (cls.__doc__ or "").rstrip()
        cls.__doc__ = f"{text}\n\n    Args:\n{stated}\n\n    Raises:\n{raised}\n    "

    def __post_init__(self) -> None:
        for name, (kind, info) in self.entries.items():
            value = _checked(name, getattr(self, name), kind, info, unit_of(self, name))
            set_frozen(self, **{name: value})


def unit_of(recipe: Any, name: str) -> str:
    """Return the unit of a recipe's field; "" if it has none."""
    _, info = getattr(recipe, "entries", {}).get(name, (None, None))
    extra = info.json_schema_extra if info else None
    return str(extra["unit"]) if isinstance(extra, dict) else ""


def _checked(name: str, given: Any, kind: Any, info: FieldInfo, unit: str) -> Any:
    """Return a field's value as its annotation asks for it.  Raises InvalidScene."""
    kinds = get_args(kind) if NoneType in get_args(kind) else (kind,)
    bounds = {
        key: value for bound in info.metadata for key, value in asdict(bound).items()
    }
    if given is None and NoneType in kinds:
        return None
    if float in kinds and bounds.get("gt") == 0:
        return positive(name, given, unit)
    if int in kinds and "ge" in bounds:
        return integer(name, given, bounds["ge"])
    if get_origin(kind) is Literal:
        require_one_of(name, given, kind)
    return given


# --- surfaces that follow from their fields
# ------------------------------------------------------


class Generated(Fields):
    """A recipe whose heights follow from its fields alone, on a grid that is one of
    them.
    """

    #: The name and version of the formula, with which a fingerprint begins.
    formula: ClassVar[str]

    def __post_init__(self: Any) -> None:
        super().__post_init__()
        shape, periods = self.shape, self.periods
        if (
            isinstance(periods, tuple)
            and len(periods) == 1
            and isinstance(shape, tuple)
        ):
            periods = periods * max(1, len(shape))
        shape, periods = checked_grid(shape, periods)
        set_frozen(self, shape=shape, periods=periods)

    @property
    def fingerprint(self) -> str:
        """The formula and every field; equal numbers read equal."""
        return f"{self.formula} {_words(self)}"

    def build(self: Any) -> Surface:
        """Make the surface.  Raises NotEnoughMemory if its heights do not fit into
        memory.
        """
        require_room(self.shape)
        heights = self._heights()
        heights.flags.writeable = False
        return Surface(heights, self.periods, recipe=self.fingerprint, **self._known())

    def _heights(self) -> FloatArray:
        raise NotImplementedError

    def _known(self) -> dict[str, Any]:
        """Return `spectrum`, `seed` and `shortest_wavelength` of the surface, if they
        are known.
        """
        return {}


def _words(value: Any) -> str:
    if is_dataclass(value):
        names = [
            f.name for f in fields(value) if f.name != "kind"
        ]  # the formula gives the kind
        return " ".join(f"{name}={_words(getattr(value, name))}" for name in names)
    if isinstance(value, tuple):
        return "(" + ",".join(map(_words, value)) + ")"
    if isinstance(value, str):
        return value
    return repr(int(value)) if value == int(value) else repr(float(value))


# --- grids
# ---------------------------------------------------------------------------------------


def checked_grid(
    given_shape: Any, given_periods: Any
) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Return matching shape and periods as tuples of int and float.  Raises
    InvalidScene.
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
        right = f"{len(shape)} positive lengths in m"
        raise InvalidScene(f"periods is {given_periods!r}, but must be {right}")
    return shape, periods


def require_room(shape: tuple[int, ...]) -> None:
    """Raise NotEnoughMemory if heights and their modes would not fit into memory."""
    needed = 16 * math.prod(shape)
    if needed >= SMALL and needed > available_memory():
        grid = " x ".join(map(str, shape))
        raise NotEnoughMemory(
            f"a surface of {grid} points needs {needed / 2**30:.3g} GiB, more than there is; use a "
            "coarser grid"
        )
