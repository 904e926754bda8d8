"""The interface of all surface recipes, and the fields and checks that they share.

A recipe is a frozen dataclass.  It is also the checked form of the table [surface] of a case file:
pydantic reads types, units and meaning from the annotations of its fields, and `__post_init__`
checks that they fit together, both for a case file and for a Python user.
"""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass
from typing import Annotated, Any, Protocol

from pydantic import BeforeValidator, Field, Strict

from epcontact.errors import InvalidScene, NotEnoughMemory
from epcontact.machine import available_memory
from epcontact.scene import Surface, positive, settle, whole

#: Largest number of points that an array can address.
LARGEST_GRID = 2**56
#: Bytes of memory that every machine has.
SMALL = 2**28


def as_tuple(value: Any) -> Any:
    """Turn a list of a TOML file into a tuple; return anything else unchanged."""
    return tuple(value) if isinstance(value, list) else value


def _lengths(value: Any) -> Any:
    """Turn one length or a list of lengths into a tuple; return a table unchanged."""
    return as_tuple(value) if isinstance(value, list | tuple | dict) else (value,)


_PERIOD = BeforeValidator(_lengths, json_schema_input_type=float | list[float])
_SHAPE = BeforeValidator(as_tuple, json_schema_input_type=list[int])
_CENTRE = BeforeValidator(as_tuple, json_schema_input_type=list[float])

# Numbers of a case file are strict: text and booleans are not converted.
Real = Annotated[float, Strict()]
Whole = Annotated[int, Strict()]

# The fields of several recipes.  A case file calls the periods `period`.
Periods = Annotated[
    tuple[Real, ...],
    _PERIOD,
    Field(validation_alias="period", description="m; one length, or [x, y]"),
]
Shape = Annotated[
    tuple[Whole, ...], _SHAPE, Field(description="grid points [nx, ny], or [nx] for a line")
]
Centre = Annotated[
    tuple[Real, ...],
    _CENTRE,
    Field(description="as fractions of the periods; the middle where it is not given"),
]


class Recipe(Protocol):
    """The interface of every recipe; `build` sets `Surface.recipe` to `fingerprint`."""

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


def normalise_grid(recipe: Any) -> None:
    """Check a frozen recipe's `shape` and `periods` and set them to what `checked_grid` returns.

    A single period is used for both directions of a surface.
    """
    periods = recipe.periods
    if isinstance(periods, tuple) and len(periods) == 1 and isinstance(recipe.shape, tuple):
        periods = periods * max(1, len(recipe.shape))
    shape, periods = checked_grid(recipe.shape, periods)
    settle(recipe, shape=shape, periods=periods)


def checked_grid(given_shape: Any, given_periods: Any) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Return matching shape and periods as tuples of int and float.  Raises InvalidScene."""
    try:
        shape = tuple(whole("shape", n, 2) for n in given_shape)
        periods = tuple(positive("periods", p, "m") for p in given_periods)
    except TypeError:
        raise InvalidScene(
            f"shape = {given_shape!r} and periods = {given_periods!r} are given, but "
            "(nx, ny) and (Lx, Ly), or (nx,) and (L,) for a line, are needed"
        ) from None
    if len(shape) not in (1, 2):
        raise InvalidScene(f"shape is {given_shape!r}, but must be one or two whole numbers")
    if len(periods) != len(shape):
        raise InvalidScene(
            f"periods is {given_periods!r}, but must be {len(shape)} positive lengths in m"
        )
    if math.prod(shape) > LARGEST_GRID:
        raise out_of_memory(shape, arrays=1)
    return shape, periods


def require_room(shape: tuple[int, ...]) -> None:
    """Raise NotEnoughMemory if heights and their modes would not fit into memory.

    The check comes before any array is made, because a system that overcommits memory kills the
    process that uses it.
    """
    needed = 16 * math.prod(shape)
    if needed >= SMALL and needed > available_memory():
        raise out_of_memory(shape, arrays=2)


def described(name: str, recipe: Any) -> str:
    """Return a fingerprint: `name` (with a version) and every field; equal numbers read equal."""
    return f"{name} {_words(recipe)}"


def _words(value: Any) -> str:
    if is_dataclass(value):
        names = [f.name for f in fields(value) if f.name != "kind"]  # `name` gives the kind
        return " ".join(f"{name}={_words(getattr(value, name))}" for name in names)
    if isinstance(value, tuple):
        return "(" + ",".join(map(_words, value)) + ")"
    if isinstance(value, str):
        return value
    return repr(int(value)) if value == int(value) else repr(float(value))


def out_of_memory(shape: tuple[int, ...], arrays: int) -> NotEnoughMemory:
    """Return the error for a grid that does not fit into memory."""
    size = math.prod(shape) * 8 * arrays / 2**30
    grid = " x ".join(map(str, shape))
    return NotEnoughMemory(
        f"a surface of {grid} points needs {size:.3g} GiB, more than there is; use a coarser grid"
    )
