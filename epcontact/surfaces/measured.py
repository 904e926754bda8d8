"""Measured or computed heights: from an array or a file to a surface; see `treatment`."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, Strict, ValidationInfo

from epcontact.errors import InvalidScene
from epcontact.scene import (
    Surface,
    cautioned,
    checked_heights,
    levels_note,
    listed,
    require_known,
    settle,
)
from epcontact.surfaces.readers import HeightMap, file_digest, read_heights
from epcontact.surfaces.recipe import (
    Lengths,
    Real,
    SurfaceAbsent,
    checked_grid,
    entry,
    out_of_memory,
)
from epcontact.surfaces.treatment import (
    EdgeField,
    Preparation,
    TaperField,
    preparation_words,
    prepared,
)


def _beside_the_case(value: Any, info: ValidationInfo) -> Any:
    """Resolve a path of a case file, which is relative to the folder of that file."""
    if not isinstance(value, str) or not value:
        raise ValueError("must be the path of a file")
    return (info.context or {}).get("folder", Path()) / value


@dataclass(frozen=True, eq=False)
class HeightsFromArray(Preparation):
    """Heights that are already in memory.

    A map that is not periodic is refused ("refuse"), taken as it is ("periodic") or made periodic
    ("detrend_and_window").

    Raises:
        InvalidScene: if the heights are not a grid of real numbers, or missing and not filled.

    Example:
        >>> recipe = HeightsFromArray([0.0, 1e-6, 0.0, -1e-6], periods=(1e-3,))
        >>> recipe.shape, recipe.build().notes[0][:36]
        ((4,), 'rms jump at the edges: 1e-06 m acros')
    """

    heights: Annotated[
        ArrayLike, entry("m", "(nx, ny), or (nx,) for a line; NaN or masked where missing")
    ]
    periods: Annotated[tuple[float, ...], entry("m", "(Lx, Ly) or (L,)")]
    treatment: EdgeField = "refuse"
    taper: TaperField = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        given = checked_heights(self.heights, "heights")
        heights = np.array(given)
        heights.flags.writeable = False
        require_known(heights, "heights", self.missing)
        settle(self, heights=heights, periods=checked_grid(heights.shape, self.periods)[1])

    @property
    def shape(self) -> tuple[int, ...]:
        """Grid points along each direction."""
        return np.shape(self.heights)

    @cached_property
    def fingerprint(self) -> str:
        """The SHA-256 of the heights, and their treatment."""
        digest = hashlib.sha256(np.ascontiguousarray(self.heights, np.float64).data).hexdigest()
        return f"array/1 {digest} {preparation_words(self)}"

    def build(self) -> Surface:
        """Treat the heights.  Raises InvalidScene if they are refused."""
        heights = np.asarray(self.heights)
        levels = cautioned(levels_note(heights.dtype))
        return prepared(heights.astype(np.float64), self, "heights", levels)


@dataclass(frozen=True)
class HeightsFromFile(Preparation):
    """Heights from a file; also the table [surface] of kind file.

    .npy files are numpy's; .txt, .dat, .csv and .tsv are plain tables of numbers with one row of
    the grid in each line; .vti files are results; meshio reads .stl, .ply and .vtu meshes whose
    points lie on a grid, and SurfaceTopography (`epcontact[instruments]`) all other files.  The
    recipe opens the file and `build` reads it.  Its content identifies it, not its path.

    One period is enough for a square map, none is needed if the file gives it.  The first belongs
    to the lines of a text file, the second to the heights in a line.  An absent file raises
    SurfaceAbsent if it is `optional`, so that a case is skipped.

    Raises:
        InvalidScene: if the file does not hold a grid of real numbers, or not their size and unit.
    """

    path: Annotated[
        Path | str,
        BeforeValidator(_beside_the_case, json_schema_input_type=str),
        entry("", "file, relative to the case file"),
    ]
    periods: Annotated[
        Lengths,
        entry("m", "needed where the file does not know its own size", validation_alias="period"),
    ] = ()
    unit: Annotated[
        Real | None, entry("m", "of the heights, 1e-6 for µm; unless the file gives it", gt=0)
    ] = None
    treatment: EdgeField = "refuse"
    taper: TaperField = 0.1
    pixel_size: Annotated[
        Real | None, entry("m", "spacing of the grid, in the place of period", gt=0)
    ] = None
    optional: Annotated[
        bool, Strict(), entry("", "skip the case with a sentence where the file is absent")
    ] = False
    kind: Literal["file"] = field(default="file", kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.path, str | Path):
            raise InvalidScene(f"path is {self.path!r:.60}, but must be the path of a file")
        settle(self, path=Path(self.path))
        if self.optional and not Path(self.path).exists():
            raise SurfaceAbsent(
                f"its surface {self.path} is not here; put the file there to run it"
            )
        settle(self, periods=checked_grid(self.shape, self._periods())[1])
        # Read now, so that the fingerprint belongs to the content whose shape was just read.
        _ = self.fingerprint

    @cached_property
    def _map(self) -> HeightMap:
        stored = read_heights(Path(self.path))
        return replace(stored, heights=checked_heights(stored.heights, str(self.path)))

    def __getstate__(self) -> dict[str, Any]:
        """Pickle without the heights; another process reads them from the file again."""
        return {name: value for name, value in self.__dict__.items() if name != "_map"}

    def _periods(self) -> tuple[float, ...]:
        stored, given, shape = self._map, listed(self.periods), self.shape
        alone = len(given) == 1 and len(shape) == 2
        refusals = {
            "knows the unit of its heights; leave out unit": stored.in_metres and self.unit,
            "does not say in which unit its heights are; give unit = 1e-6 for micrometres, 1e-9 "
            "for nanometres or 1.0 for metres": not stored.in_metres and not self.unit,
            "needs periods or pixel_size, not both": given and self.pixel_size,
            "does not say how large the map is; give its periods in m": (
                not given and not self.pixel_size and stored.periods is None
            ),
            f"holds {shape[0]} x {shape[-1]} heights, and one period does not say how large they "
            "are each way; give both": alone and shape[0] != shape[-1],
        }
        for words, refused in refusals.items():
            if refused:
                raise InvalidScene(f"{self.path} {words}")
        if self.pixel_size is not None:
            return tuple(self.pixel_size * n for n in shape)
        of_file = tuple((self.unit or 1.0) * p for p in stored.periods or ())
        return given * 2 if alone else given or of_file

    @property
    def shape(self) -> tuple[int, ...]:
        """Grid points along each direction."""
        return self._map.heights.shape

    @cached_property
    def fingerprint(self) -> str:
        """The SHA-256 of the file's content, the unit, and the treatment of the heights."""
        unit = 1.0 if self.unit is None else self.unit
        return f"file/1 {file_digest(Path(self.path))} unit={unit!r} {preparation_words(self)}"

    def build(self) -> Surface:
        """Read the heights and treat them.  Raises InvalidScene if they are refused."""
        try:
            heights = np.array(self._map.heights, dtype=np.float64)
        except MemoryError:
            raise out_of_memory(self.shape, arrays=2) from None
        if self.unit is not None:
            heights *= self.unit
        levels = cautioned(levels_note(self._map.heights.dtype))
        told = (*levels, *self._map.notes, *self._spacing_note())
        return prepared(heights, self, str(self.path), told)

    def _spacing_note(self) -> tuple[str, ...]:
        """Periods given in the wrong order show in spacings that differ."""
        if self._map.periods is not None or len(self.shape) < 2:
            return ()
        x, y = (length / n for length, n in zip(self.periods, self.shape, strict=True))
        if math.isclose(x, y, rel_tol=0.01):
            return ()
        return (
            f"the periods make the grid {x:.3g} m wide along x, over {self.shape[0]} lines of the "
            f"file, and {y:.3g} m along y, over {self.shape[1]} heights in each",
        )
