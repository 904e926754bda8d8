"""Heights that are given: in an array, in a file, or as what a result leaves; see
`treatment`.
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
from pydantic import BeforeValidator, Strict, StrictFloat, ValidationInfo

from epcontact.errors import InvalidScene
from epcontact.results import ContactResult
from epcontact.scene import (
    Surface,
    as_tuple,
    checked_heights,
    require_usable,
    set_frozen,
    warn_user,
)
from epcontact.surfaces.readers import HeightMap, file_digest, read_heights
from epcontact.surfaces.recipe import (
    Lengths,
    Recipe,
    SurfaceAbsent,
    checked_grid,
    entry,
    require_room,
)
from epcontact.surfaces.treatment import EdgeField, Preparation, prepare_surface

#: A path counts as unloaded if it ends below this share of its largest mean pressure.
UNLOADED = 1e-2
#: Rms slopes beyond which the unit of a file is taken for wrong, as if by a factor of
#: 1000.
STEEPEST, FLATTEST = 10.0, 1e-4


@dataclass(frozen=True, eq=False)
class HeightsFromArray(Preparation):
    """Heights that are already in memory.

    Example:
        >>> recipe = HeightsFromArray([0.0, 1e-6, 0.0, -1e-6], periods=(1e-3,))
        >>> recipe.shape, recipe.build().notes[0][:36]
        ((4,), 'rms jump at the edges: 1e-06 m acros')
    """

    heights: Annotated[
        ArrayLike,
        entry("m", "(nx, ny), or (nx,) for a line; NaN or masked where missing"),
    ]
    periods: Annotated[tuple[float, ...], entry("m", "(Lx, Ly) or (L,)")]
    treatment: EdgeField = "refuse"

    def __post_init__(self) -> None:
        super().__post_init__()
        heights = np.array(checked_heights(self.heights, "heights"))
        heights.flags.writeable = False
        require_usable(heights, "heights", self.missing)
        set_frozen(
            self, heights=heights, periods=checked_grid(heights.shape, self.periods)[1]
        )

    @property
    def shape(self) -> tuple[int, ...]:
        """Grid points along each direction."""
        return np.shape(self.heights)

    @cached_property
    def fingerprint(self) -> str:
        """The SHA-256 of the heights, and their treatment."""
        digest = hashlib.sha256(
            np.ascontiguousarray(self.heights, np.float64).data
        ).hexdigest()
        return f"array/1 {digest} {self.steps}"

    def build(self) -> Surface:
        """Treat the heights.  Raises InvalidScene if they are refused."""
        return prepare_surface(np.asarray(self.heights), self, "heights")


def _beside_the_case(value: Any, info: ValidationInfo) -> Any:
    """Resolve a path of a case file, which is relative to the folder of that file."""
    if not isinstance(value, str) or not value:
        raise ValueError("must be the path of a file")
    return (info.context or {}).get("folder", Path()) / value


@dataclass(frozen=True)
class HeightsFromFile(Preparation):
    """Heights from a file; also the table [surface] of kind file.

    .npy files are numpy's; .txt, .dat, .csv and .tsv are plain tables of numbers, and
    like them pictures: x runs along a line, y from line to line.  Tables, .xyz files
    too, may also list x, y and height of points on a grid, as .stl, .ply and .vtu
    meshes do, which meshio reads; .vti files are results, and SurfaceTopography
    (`epcontact[instruments]`) reads all other files.  The recipe opens the file and
    `build` reads it.  Its content identifies it, not its path.

    One period is enough for a square map, none is needed if the file gives it.  The
    first is the length along x.  A map is mirrored, unless it is a .vti or another
    `treatment` is given; its `shape` and `periods` are then a quarter of its surface,
    and `Mirrored` has those of all.  An absent file raises SurfaceAbsent if it is
    `optional`, so that a case is skipped.
    """

    path: Annotated[
        Path | str,
        BeforeValidator(_beside_the_case, json_schema_input_type=str),
        entry("", "file, relative to the case file"),
    ]
    periods: Annotated[
        Lengths,
        entry(
            "m",
            "needed where the file does not know its own size",
            validation_alias="period",
        ),
    ] = ()
    unit: Annotated[
        StrictFloat | None,
        entry("m", "of the heights, 1e-6 for µm; unless the file gives it", gt=0),
    ] = None
    treatment: EdgeField | None = None
    pixel_size: Annotated[
        StrictFloat | None,
        entry("m", "spacing of the grid, in the place of period", gt=0),
    ] = None
    optional: Annotated[
        bool,
        Strict(),
        entry("", "skip the case with a sentence where the file is absent"),
    ] = False
    kind: Literal["file"] = field(default="file", kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.path, str | Path):
            raise InvalidScene(
                f"path is {self.path!r:.60}, but must be the path of a file"
            )
        set_frozen(self, path=Path(self.path))
        if self.treatment is None:  # a result is periodic
            set_frozen(
                self,
                treatment="refuse" if Path(self.path).suffix == ".vti" else "mirrored",
            )
        if self.optional and not Path(self.path).exists():
            raise SurfaceAbsent(
                f"its surface {self.path} is not here; put the file there to run it"
            )
        set_frozen(self, periods=checked_grid(self.shape, self._periods())[1])
        # Read now, so that the fingerprint belongs to the content whose shape was just
        # read.
        _ = self.fingerprint

    @cached_property
    def _map(self) -> HeightMap:
        stored = read_heights(Path(self.path))
        return replace(stored, heights=checked_heights(stored.heights, str(self.path)))

    def __getstate__(self) -> dict[str, Any]:
        """Pickle without the heights; another process reads them from the file
        again.
        """
        return {name: value for name, value in self.__dict__.items() if name != "_map"}

    def _periods(self) -> tuple[float, ...]:
        stored, given, shape = self._map, as_tuple(self.periods), self.shape
        alone = len(given) == 1 and len(shape) == 2
        refusals = {
            "knows the unit of its heights; leave out unit": stored.in_metres
            and self.unit,
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
        """The SHA-256 of the file's content, the unit, and the treatment of the
        heights.
        """
        return f"file/2 {file_digest(Path(self.path))} unit={self.unit or 1.0!r} {self.steps}"

    def build(self) -> Surface:
        """Read the heights and treat them.  Raises InvalidScene if they are refused."""
        require_room(
            Mirrored(self).shape if self.treatment == "mirrored" else self.shape
        )
        stored = self._map
        notes = [*stored.notes]
        x, y = self.periods[0] / self.shape[0], self.periods[-1] / self.shape[-1]
        if stored.periods is None and not math.isclose(x, y, rel_tol=0.01):
            # Periods given in the wrong order show in spacings that differ.
            along_x = (
                f"{x:.3g} m wide along x, over the {self.shape[0]} heights of a line"
            )
            along_y = f"{y:.3g} m along y, over {self.shape[1]} lines"
            notes.append(
                f"the periods make the grid {along_x} of the file, and {along_y}"
            )
        surface = prepare_surface(
            stored.heights,
            self,
            str(self.path),
            notes,
            self.unit or 1.0,
            stored.filled,
        )
        steep = f"the rms slope is {surface.rms_slope:.3g}, beyond that of any"
        remedy = (
            "the heights and the lengths along the map must be in one unit: check unit"
        )
        if surface.rms_slope > STEEPEST:
            signs = (
                n
                for n in surface.notes
                if "outliers" in n or "far from all others" in n
            )
            others = "".join(f"; or {sign}" for sign in signs)
            raise InvalidScene(
                f"{self.path}: {steep} surface; {remedy}, period and pixel_size{others}"
            )
        if 0 < surface.rms_slope < FLATTEST:
            told = warn_user(
                (f"{steep.replace('beyond', 'below')} but optical flats; {remedy}",)
            )
            surface = replace(surface, notes=(*surface.notes, *told))
        return surface


@dataclass(frozen=True)
class Mirrored:
    """The recipe of a map that is mirrored, with the shape and periods of its surface.

    Example:
        >>> Mirrored(HeightsFromArray([0.0, 1e-6, 3e-6], (1e-3,), "mirrored")).shape
        (6,)
    """

    map: HeightsFromFile | HeightsFromArray  #: A recipe whose treatment is "mirrored".
    shape: tuple[int, ...] = field(init=False)
    periods: tuple[float, ...] = field(init=False)
    fingerprint: str = field(init=False)  #: That of the map, which names the treatment.

    def __post_init__(self) -> None:
        shape, periods = (
            tuple(2 * n for n in of) for of in (self.map.shape, self.map.periods)
        )
        set_frozen(self, shape=shape, periods=periods, fingerprint=self.map.fingerprint)

    def build(self) -> Surface:
        """Make the surface."""
        return self.map.build()


@dataclass(frozen=True)
class Facing:
    """The recipe of two rough surfaces face to face, on one grid: their composite
    roughness.

    Each has its heights out of its own body, and point (x, y) of the second lies over
    point (x, y) of the first.  In one frame the heights of the second count downward,
    so that the difference of both, on which alone contact depends, is their sum.

    Raises:
        InvalidScene: the grids or the periods differ.
    """

    first: Recipe  #: That of the lower body.
    second: Recipe  #: That of the counterface.
    shape: tuple[int, ...] = field(init=False)
    periods: tuple[float, ...] = field(init=False)
    fingerprint: str = field(init=False)

    def __post_init__(self) -> None:
        a, b = self.first, self.second
        if a.shape != b.shape or not np.allclose(
            a.periods, b.periods, rtol=1e-9, atol=0
        ):
            raise InvalidScene(
                f"surface has {a.shape} points over {a.periods} m and the counterface's {b.shape} "
                f"over {b.periods} m, but two surfaces face each other on one grid and period"
            )
        words = f"facing/1 {a.fingerprint} on {b.fingerprint}"
        set_frozen(self, shape=a.shape, periods=a.periods, fingerprint=words)

    def build(self) -> Surface:
        """Make both, and their composite roughness."""
        a, b = self.first.build(), self.second.build()
        known = [
            s.shortest_wavelength for s in (a, b) if s.shortest_wavelength is not None
        ]
        return Surface(
            a.heights + b.heights,
            a.periods,
            shortest_wavelength=min(known) if len(known) == 2 else None,
            recipe=self.fingerprint,
            notes=(
                *a.notes,
                *(f"counterface: {n}" for n in b.notes),
                "heights are of both bodies",
            ),
            treatment_errors={
                name: math.hypot(*(s.treatment_errors.get(name, 0.0) for s in (a, b)))
                for name in {**a.treatment_errors, **b.treatment_errors}
            },
            filled=_either(a.filled, b.filled),
        )


def _either(
    first: NDArray[np.bool_] | None, second: NDArray[np.bool_] | None
) -> NDArray[np.bool_] | None:
    """Return the mask of the points that either of two masks marks; None: no point."""
    if first is None or second is None:
        return second if first is None else first
    return first | second


def residual_surface(surface: Surface, result: ContactResult) -> Surface:
    """Return the surface that a result leaves behind, which another scene can take up.

    A capped contact keeps its plastic displacement, so any load will do.  J2 flow shows
    only after unloading: the displacement that remains is the plastic one.

    Args:
        surface: the surface of the scene that was solved.
        result: the answer to it, with fields.

    Raises:
        InvalidScene: the result has no fields, or its path does not unload a body
            without cap.

    Example:
        >>> from epcontact import Load, Material, Scene, bem
        >>> surface = Surface(np.cos(2 * np.pi * np.arange(64) / 64), (50.0,))
        >>> scene = Scene(surface, Material(1.0, 0.0, hardness=0.05), Load(0.02))
        >>> left = residual_surface(surface, bem.solve(scene))
        >>> bool(left.heights.max() < surface.heights.max())
        True
    """
    lowered = result.fields.get("plastic_displacement")
    if lowered is None:
        pressures = [step.mean_pressure for step in result.steps]
        if "displacement" not in result.fields or pressures[-1] > UNLOADED * max(
            pressures
        ):
            raise InvalidScene(
                f"{result.method} gives no plastic displacement; let its load path end at 0, where "
                "the displacement that remains is the plastic one"
            )
        lowered = result.fields["displacement"]
    note = f"the surface that {result.method} has left after plastic flow"
    left, notes = surface.heights - lowered, (*surface.notes, note)
    return replace(surface, heights=left, spectrum=None, recipe="", notes=notes)
