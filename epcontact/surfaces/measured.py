"""Measured or computed heights, and the treatment of a map that is not periodic.

Every method here is periodic, but a measured map rarely is: its heights jump across its edges.  The
jump at the edge of an axis is the rms difference of its last and first rows.  On a periodic map
these two are neighbours like any others.  So a map counts as not periodic if the jump is more than
`LARGEST_JUMP` times the largest rms difference of two neighbouring rows.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, Field, Strict, ValidationInfo

from epcontact.errors import InvalidScene
from epcontact.results import FloatArray
from epcontact.scene import Surface
from epcontact.surfaces.readers import HeightMap, file_digest, read_heights
from epcontact.surfaces.recipe import Periods, Real, SurfaceAbsent, checked_grid, out_of_memory

Treatment = Literal["refuse", "periodic", "detrend_and_window"]


def _beside_the_case(value: Any, info: ValidationInfo) -> Any:
    """Resolve a path of a case file, which is relative to the folder of that file."""
    if not isinstance(value, str) or not value:
        raise ValueError("must be the path of a file")
    return (info.context or {}).get("folder", Path()) / value


#: Edge jump over the largest jump between neighbours, above which a map counts as not periodic.
LARGEST_JUMP = 2.0


@dataclass(frozen=True, eq=False)
class HeightsFromArray:
    """Heights that are already in memory.

    Args:
        heights: (nx, ny), or (nx,) for a line, in m.
        periods: (Lx, Ly) or (L,) in m.
        treatment: "refuse" refuses a map that is not periodic; "periodic" uses it as it is;
            "detrend_and_window" makes it periodic.
        taper: share of each period over which the window rises, and over which it falls; 0.5 is
            Hann's window.

    Raises:
        InvalidScene: if the heights are not a grid of finite real numbers.

    Example:
        >>> recipe = HeightsFromArray([0.0, 1e-6, 0.0, -1e-6], periods=(1e-3,))
        >>> recipe.shape, recipe.build().notes[0][:36]
        ((4,), 'rms jump at the edges: 1e-06 m acros')
    """

    heights: ArrayLike
    periods: tuple[float, ...]
    treatment: Treatment = "refuse"
    taper: float = 0.1

    def __post_init__(self) -> None:
        _check_treatment(self.treatment, self.taper)
        heights = checked_heights(self.heights, "heights").astype(np.float64)
        heights.flags.writeable = False
        object.__setattr__(self, "heights", heights)
        _require_finite(heights, "heights")
        object.__setattr__(self, "periods", checked_grid(self.shape, self.periods)[1])

    @property
    def shape(self) -> tuple[int, ...]:
        """Grid points along each direction."""
        return np.shape(self.heights)

    @cached_property
    def fingerprint(self) -> str:
        """The SHA-256 of the heights, and their treatment."""
        digest = hashlib.sha256(np.ascontiguousarray(self.heights).data).hexdigest()
        return f"array/1 {digest} {_treatment_words(self.treatment, self.taper)}"

    def build(self) -> Surface:
        """Treat the heights.  Raises InvalidScene if they are refused."""
        return _treated(np.array(self.heights), self, "heights")


@dataclass(frozen=True)
class HeightsFromFile:
    """Heights from a file; also the table [surface] of kind file.

    .npy files are numpy's; .txt, .dat, .csv and .tsv are plain tables of numbers with one row of
    the grid in each line; SurfaceTopography (`epcontact[instruments]`) reads all other files.  The
    recipe opens the file and `build` reads it.  Its content identifies it, not its path.

    Args:
        path: the file; in a case file, relative to the case file.
        periods: in m; one length is enough for a square map, none is needed if the file gives it.
        unit: unit of the stored heights in m (1e-6 for micrometres), unless the file gives it.
        treatment, taper: as in HeightsFromArray.
        pixel_size: the spacing of the grid in m, instead of periods.
        optional: raise SurfaceAbsent if there is no such file, so that a case is skipped.

    Raises:
        InvalidScene: if the file does not hold a grid of finite real numbers.
    """

    path: Annotated[
        Path,
        BeforeValidator(_beside_the_case, json_schema_input_type=str),
        Field(description="file, relative to the case file"),
    ]
    periods: Annotated[
        Periods, Field(description="m; needed where the file does not know its own size")
    ] = ()
    unit: Annotated[Real, Field(gt=0, description="m; the unit the heights are written in")] = 1.0
    treatment: Annotated[
        Treatment,
        Field(description="a map that is not periodic: refused, taken as it is, or made periodic"),
    ] = "refuse"
    taper: Annotated[
        Real, Field(description="share of a period over which the window rises, and falls")
    ] = 0.1
    pixel_size: Annotated[
        Real | None, Field(gt=0, description="m; spacing of the grid, in the place of period")
    ] = None
    optional: Annotated[
        bool, Strict(), Field(description="skip the case with a sentence where the file is absent")
    ] = False
    kind: Literal["file"] = field(default="file", kw_only=True)

    def __post_init__(self) -> None:
        _check_treatment(self.treatment, self.taper)
        object.__setattr__(self, "path", Path(self.path))
        if self.optional and not self.path.exists():
            raise SurfaceAbsent(
                f"its surface {self.path} is not here; put the file there to run it"
            )
        for name in ("unit", "pixel_size"):
            value = getattr(self, name)
            good = isinstance(value, int | float) and value > 0 and math.isfinite(value)
            if not good and (name, value) != ("pixel_size", None):
                raise InvalidScene(f"{name} is {value!r}, but must be a positive length in m")
        object.__setattr__(self, "periods", checked_grid(self.shape, self._periods())[1])
        # Read now, so that the fingerprint belongs to the content whose shape was just read.
        _ = self.fingerprint

    @cached_property
    def _map(self) -> HeightMap:
        stored = read_heights(self.path)
        return replace(stored, heights=checked_heights(stored.heights, str(self.path)))

    def __getstate__(self) -> dict[str, Any]:
        """Pickle without the heights; another process reads them from the file again."""
        return {name: value for name, value in self.__dict__.items() if name != "_map"}

    def _periods(self) -> tuple[float, ...]:
        known, given, shape = self._map.periods, self.periods or (), self.shape
        if self._map.in_metres and self.unit != 1.0:
            raise InvalidScene(f"{self.path} knows the unit of its heights; leave out unit")
        if given and self.pixel_size is not None:
            raise InvalidScene(f"{self.path}: give periods or pixel_size, not both")
        if self.pixel_size is not None:
            return tuple(self.pixel_size * n for n in shape)
        if not given and known is None:
            raise InvalidScene(
                f"{self.path} does not say how large the map is; give its periods in m"
            )
        if len(given) == 1 and len(shape) == 2:
            if shape[0] != shape[1]:
                raise InvalidScene(
                    f"{self.path} holds {shape[0]} x {shape[1]} heights, and one period does not "
                    "say how large they are each way; give both"
                )
            return (given[0], given[0])
        return given or known or ()

    @property
    def shape(self) -> tuple[int, ...]:
        """Grid points along each direction."""
        return self._map.heights.shape

    @cached_property
    def fingerprint(self) -> str:
        """The SHA-256 of the file's content, the unit, and the treatment of the heights."""
        words = _treatment_words(self.treatment, self.taper)
        return f"file/1 {file_digest(self.path)} unit={float(self.unit)!r} {words}"

    def build(self) -> Surface:
        """Read the heights and treat them.  Raises InvalidScene if they are refused."""
        try:
            heights = np.array(self._map.heights, dtype=np.float64)
        except MemoryError:
            raise out_of_memory(self.shape, arrays=2) from None
        _require_finite(heights, str(self.path))
        heights *= self.unit
        return _treated(heights, self, str(self.path))


def checked_heights(given: ArrayLike, where: str) -> NDArray[Any]:
    """Return heights as an array of real numbers on a line or grid.  Raises InvalidScene."""
    try:
        heights = np.asanyarray(given)
    except ValueError:
        raise InvalidScene(f"{where}: rows of unequal length are no grid of heights") from None
    if heights.dtype.kind not in "buif":
        kind = "complex" if heights.dtype.kind == "c" else str(heights.dtype)
        raise InvalidScene(f"{where}: holds {kind} values, but heights are real numbers")
    if heights.ndim not in (1, 2) or min(heights.shape) < 2:
        raise InvalidScene(
            f"{where}: has shape {heights.shape}, but heights are a line (nx,) or a grid (nx, ny) "
            "of at least two points a direction"
        )
    return heights


def edge_jumps(heights: FloatArray) -> list[tuple[float, float]]:
    """Return for each axis the rms jump at the edge and the largest between neighbouring rows.

    `heights` has the shape (nx, ny) or (nx,); the jumps are in its unit.
    """
    return [_axis_jumps(heights, axis) for axis in range(heights.ndim)]


def _axis_jumps(heights: FloatArray, axis: int) -> tuple[float, float]:
    edge = np.take(heights, 0, axis) - np.take(heights, -1, axis)
    steps = np.diff(heights, axis=axis)
    steps *= steps
    inner = steps if heights.ndim == 1 else steps.mean(axis=1 - axis)
    return math.sqrt(np.mean(edge * edge)), math.sqrt(inner.max())


def detrended_and_windowed(heights: FloatArray, taper: float) -> tuple[FloatArray, float]:
    """Subtract the least-squares plane in place and taper the heights to zero at the edges.

    The window rises as (1 - cos) / 2 over `taper` of each period and falls likewise (Tukey's
    window; Hann's for taper = 0.5).  It reduces the roughness, so all heights are then multiplied
    by a factor that restores the rms height of the detrended map.  Returns the heights, with zero
    mean, and the factor.
    """
    heights -= heights.mean()
    axes = [np.linspace(-0.5, 0.5, n) for n in heights.shape]
    other = tuple(range(heights.ndim))
    # On a full grid the coordinates are orthogonal, so the slopes can be fitted one by one.
    for axis, x in enumerate(axes):
        profile = heights.mean(axis=tuple(a for a in other if a != axis))
        slope = float(profile @ x) / float(x @ x)
        heights -= (slope * x).reshape([-1 if a == axis else 1 for a in other])
    before = _rms(heights)
    for axis, n in enumerate(heights.shape):
        window = _window(n, taper)
        heights *= window.reshape([-1 if a == axis else 1 for a in other])
    heights -= heights.mean()
    after = _rms(heights)
    factor = before / after if after > 0 else 1.0
    heights *= factor
    return heights, factor


def _rms(heights: FloatArray) -> float:
    return math.sqrt(float(np.vdot(heights, heights)) / heights.size)


def _window(n: int, taper: float) -> FloatArray:
    """Return Tukey's window at n points; its zero is midway between the last and the first."""
    distance = (np.arange(n) + 0.5) / n
    rise = np.minimum(np.minimum(distance, 1 - distance) / taper, 1.0)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * rise))


def _check_treatment(treatment: str, taper: float) -> None:
    known = ("refuse", "periodic", "detrend_and_window")
    if treatment not in known:
        raise InvalidScene(f"treatment is {treatment!r}, but must be one of {', '.join(known)}")
    if not isinstance(taper, int | float) or not 0 < taper <= 0.5:
        raise InvalidScene(f"taper is {taper!r}, but must lie in (0, 0.5], a share of the period")


def _treatment_words(treatment: str, taper: float) -> str:
    return f"{treatment} taper={float(taper)!r}" if treatment == "detrend_and_window" else treatment


def _require_finite(heights: FloatArray, where: str) -> None:
    if not np.isfinite(heights.min()) or not np.isfinite(heights.max()):
        bad = int(np.count_nonzero(~np.isfinite(heights)))
        raise InvalidScene(
            f"{where}: {bad} of {heights.size} heights are NaN or infinite; fill or crop them first"
        )


def _require_measurable(heights: FloatArray, where: str) -> None:
    span = float(heights.max()) - float(heights.min())
    if not span * span < math.inf:
        raise InvalidScene(f"{where}: heights span {span:g} m; check their unit")


def _jump_words(jumps: list[tuple[float, float]]) -> str:
    return " and ".join(
        f"{edge:.3g} m across {axis} (between neighbours at most {inner:.3g} m)"
        for axis, (edge, inner) in zip("xy", jumps, strict=False)
    )


def _treated(heights: FloatArray, recipe: Any, where: str) -> Surface:
    """Treat a recipe's own writable heights and return the surface."""
    _require_measurable(heights, where)
    jumps = edge_jumps(heights)
    words = f"rms jump at the edges: {_jump_words(jumps)}"
    periodic = all(edge <= LARGEST_JUMP * inner for edge, inner in jumps)
    if recipe.treatment == "detrend_and_window":
        heights, factor = detrended_and_windowed(heights, recipe.taper)
        words = (
            f"least-squares plane removed, tapered over {recipe.taper:g} of the period at each "
            f"edge, multiplied by {factor:.4g} to keep the rms height; {words} before, "
            f"{_jump_words(edge_jumps(heights))} after"
        )
    elif recipe.treatment == "refuse" and not periodic:
        raise InvalidScene(
            f"{where}: not periodic, {words}; set treatment to detrend_and_window, or to periodic "
            "to take it as it is"
        )
    heights.flags.writeable = False
    return Surface(heights, recipe.periods, recipe=recipe.fingerprint, notes=(words,))
