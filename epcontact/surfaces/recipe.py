"""What every recipe of a surface has in common: an interface, and the check of its grid."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass
from typing import Any, Protocol

from epcontact.errors import InvalidScene, NotEnoughMemory
from epcontact.machine import available_memory
from epcontact.scene import Surface

#: Points beyond which no array can be addressed.
LARGEST_GRID = 2**56
#: Bytes that any machine has.
SMALL = 2**28


class Recipe(Protocol):
    """What every recipe can do; `build` sets `Surface.recipe` to `fingerprint`."""

    @property
    def fingerprint(self) -> str:
        """Identifies the heights without making them."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Grid points along each direction."""

    @property
    def periods(self) -> tuple[float, ...]:
        """Lengths of the period along each direction, in m."""

    def build(self) -> Surface:
        """Make the surface."""


def normalise_grid(recipe: Any) -> None:
    """Check a frozen recipe's `shape` and `periods` and set them to what `checked_grid` returns."""
    shape, periods = checked_grid(recipe.shape, recipe.periods)
    object.__setattr__(recipe, "shape", shape)
    object.__setattr__(recipe, "periods", periods)


def checked_grid(given_shape: Any, given_periods: Any) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Shape and periods as tuples of int and float that fit together.  Raises InvalidScene."""
    try:
        shape = tuple(int(n) for n in given_shape)
        periods = tuple(float(p) for p in given_periods)
        whole = shape == tuple(given_shape)
    except (TypeError, ValueError, OverflowError):
        raise InvalidScene(
            f"shape = {given_shape!r} and periods = {given_periods!r} are given, but "
            "(nx, ny) and (Lx, Ly), or (nx,) and (L,) for a line, are needed"
        ) from None
    if not whole or len(shape) not in (1, 2) or min(shape) < 2:
        raise InvalidScene(
            f"shape is {given_shape!r}, but must be one or two whole numbers of at least 2"
        )
    if len(periods) != len(shape) or not all(p > 0 and math.isfinite(p) for p in periods):
        raise InvalidScene(
            f"periods is {given_periods!r}, but must be {len(shape)} positive lengths in m"
        )
    if math.prod(shape) > LARGEST_GRID:
        raise out_of_memory(shape, arrays=1)
    return shape, periods


def require_room(shape: tuple[int, ...]) -> None:
    """Raise NotEnoughMemory if heights and their modes are not going to fit, before they are
    tried: a system that promises more than it has kills the process that takes it."""
    needed = 16 * math.prod(shape)
    if needed < SMALL:
        return
    if needed > available_memory():
        raise out_of_memory(shape, arrays=2)


def described(name: str, recipe: Any) -> str:
    """A fingerprint: `name` (with a version) and every field, equal numbers in equal words."""
    return f"{name} {_words(recipe)}"


def _words(value: Any) -> str:
    if is_dataclass(value):
        return " ".join(f"{f.name}={_words(getattr(value, f.name))}" for f in fields(value))
    if isinstance(value, tuple):
        return "(" + ",".join(map(_words, value)) + ")"
    if isinstance(value, str):
        return value
    return repr(int(value)) if value == int(value) else repr(float(value))


def out_of_memory(shape: tuple[int, ...], arrays: int) -> NotEnoughMemory:
    """The error of a grid that does not fit into memory."""
    size = math.prod(shape) * 8 * arrays / 2**30
    grid = " x ".join(map(str, shape))
    return NotEnoughMemory(
        f"a surface of {grid} points needs {size:.3g} GiB, more than there is; use a coarser grid"
    )
