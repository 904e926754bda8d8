"""Heights that are given: in an array, in a file, or as what a result leaves.

The module `treatment` describes how measured heights become a surface.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import (
    BeforeValidator,
    StrictBool,
    StrictFloat,
    StrictStr,
    ValidationInfo,
)

from epcontact.errors import InvalidScene
from epcontact.results import ContactResult
from epcontact.scene import (
    Surface,
    as_tuple,
    checked_heights,
    require_one_of,
    require_usable,
    set_frozen,
    warn_user,
)
from epcontact.surfaces.height_map import HeightMap, lengths_agree
from epcontact.surfaces.readers import file_digest, read_heights
from epcontact.surfaces.recipe import (
    Lengths,
    Recipe,
    SurfaceAbsent,
    checked_grid,
    entry,
    require_room,
    sequence,
)
from epcontact.surfaces.treatment import EdgeField, Preparation, prepare_surface

#: A load path counts as unloaded if it ends below this fraction of its largest mean
#: pressure.
UNLOADED = 1e-2
#: Rms slopes above and below which the unit of a file counts as wrong: no surface is
#: as steep, and only optical flats are as flat.
STEEPEST, FLATTEST = 10.0, 1e-4
#: Relative difference of periods, of grid spacings, or of units, that counts as none.
_SAME_PERIODS, _SAME_SPACING, _SAME_UNIT = 1e-9, 0.01, 1e-6
#: The smallest ratio of m to the unit of a file that is tried: a picometre.
_LEAST_RATIO = 1e-12
#: Words of the note on a height that may mark missing points.
_MARK = "far from all others"
#: The note on a line.
LINE = (
    "a line is solved as a surface of ridges, whose heights do not change along y; of "
    "a surface that is rough in both directions it is a cut with 1/√2 of the rms "
    "slope, so that its areas and its gap are not those of that surface"
)


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
        """Check the fields of this recipe, and keep a read-only copy of the heights.

        Raises InvalidScene if the heights are no usable map, or if grid and periods do
        not fit each other.
        """
        super().__post_init__()
        heights = np.array(checked_heights(self.heights, "heights"))
        heights.flags.writeable = False
        require_usable(heights, "heights", self.missing)
        _, periods = checked_grid(heights.shape, self.periods)
        set_frozen(self, heights=heights, periods=periods)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of grid points of this map along each direction."""
        return np.shape(self.heights)

    @cached_property
    def fingerprint(self) -> str:
        """The text that identifies the surface: the SHA-256 of the heights, and their
        treatment.
        """
        content = np.ascontiguousarray(self.heights, np.float64).data
        return f"array/1 {hashlib.sha256(content).hexdigest()} {self.steps}"

    def build(self) -> Surface:
        """Return the surface of these heights, treated as the fields say.

        Raises InvalidScene if the edges jump and `treatment` is "refuse".
        """
        return prepare_surface(np.asarray(self.heights), self, "heights")


def _beside_the_case(value: Any, info: ValidationInfo) -> Any:
    """Return the path of a file that a case file names relative to its own folder.

    Args:
        value: what the case file has as the path.
        info: its context has the folder of the case file as "folder", if there is one.

    Raises:
        ValueError: The value is no text, or empty.
    """
    if not isinstance(value, str) or not value:
        raise ValueError("must be the path of a file")
    return (info.context or {}).get("folder", Path()) / value


@dataclass(frozen=True)
class HeightsFromFile(Preparation):
    """Heights from a file; also the table [surface] of kind file.

    The first index of a .npy file runs along x, as in `HeightsFromArray`.  .txt, .dat,
    .csv and .tsv are plain tables of numbers and pictures: x runs along a line, y from
    line to line.  `transpose` exchanges x and y.  Tables, .xyz files
    too, may also list x, y and height of points on a grid, as .stl, .ply and .vtu
    meshes do, which meshio reads; .vti files are results, .x3p files are read by
    their standard, and SurfaceTopography (`epcontact[instruments]`) reads all other
    files.  The recipe opens the file and `build` reads it.  Its content identifies it,
    not its path.

    One period is enough for a square map, none is needed if the file gives it.  The
    first is the length along x.  Units and lengths that the file states and that are
    given must agree.  A table of x and height is a line.  A map is mirrored, unless it
    is a .vti or another `treatment` is given; its `shape` and `periods` are then a
    quarter of its surface, and `Mirrored` has those of all.  An absent file raises
    SurfaceAbsent if it is `optional`, so that a case is skipped.
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
            "needed unless the file gives the size of the map",
            validation_alias="period",
        ),
    ] = ()
    unit: Annotated[
        StrictFloat | None,
        entry(
            "m", "of the heights, 1e-6 for µm; needed unless the file gives it", gt=0
        ),
    ] = None
    treatment: EdgeField | None = None
    pixel_size: Annotated[
        StrictFloat | None,
        entry("m", "spacing of the grid, instead of period", gt=0),
    ] = None
    optional: Annotated[
        StrictBool,
        entry("", "skip the case with a message if the file is absent"),
    ] = False
    transpose: Annotated[
        StrictBool, entry("", "exchange x and y of the file; period is [x, y] after it")
    ] = False
    channel: Annotated[
        StrictStr | None,
        entry("", "name of the channel of an instrument's file with several"),
    ] = None
    accept: Annotated[
        tuple[Literal["slope", "unit", "size"], ...],
        sequence(Literal["slope", "unit", "size"]),
        entry(
            "",
            "what is accepted although it looks wrong: an rms slope below 1e-4 or "
            "above 10; a unit, or a size, other than the file states",
        ),
    ] = ()
    kind: Literal["file"] = field(default="file", kw_only=True)

    def __post_init__(self) -> None:
        """Check the fields of this recipe, read the file and compute its digest.

        Raises SurfaceAbsent if the file is absent and optional, and InvalidScene if the
        file cannot be read, is no usable map, or a field does not fit the file.
        """
        super().__post_init__()
        for word in self.accept:
            require_one_of("accept", word, Literal["slope", "unit", "size"])
        if not isinstance(self.path, str | Path):
            raise InvalidScene(
                f"path is {self.path!r:.60}, but must be the path of a file"
            )
        path = Path(self.path)
        set_frozen(self, path=path)
        if self.treatment is None:
            is_periodic = path.suffix == ".vti"  # as the heights of any result
            set_frozen(self, treatment="refuse" if is_periodic else "mirrored")
        if self.optional and not path.exists():
            raise SurfaceAbsent(
                f"its surface {path} is not here; put the file there to run it"
            )
        _, periods = checked_grid(self.shape, self._periods())
        set_frozen(self, periods=periods)
        # Read now, so that the fingerprint belongs to the content whose shape was just
        # read.
        _ = self.fingerprint

    @cached_property
    def _map(self) -> HeightMap:
        """The heights of this recipe's file, as the file stores them.

        Raises InvalidScene if the file cannot be read or holds no map.
        """
        stored = read_heights(Path(self.path), self.channel)
        heights = checked_heights(stored.heights, str(self.path))
        stored = replace(stored, heights=heights)
        if not self.transpose:
            return stored
        if heights.ndim != 2:
            raise InvalidScene(f"{self.path} holds a line; leave out transpose")
        return stored.transposed()

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes of this recipe that pickle stores: all but the heights.

        Another process reads the heights from the file.
        """
        return {name: value for name, value in self.__dict__.items() if name != "_map"}

    def _unit_in_metres(self) -> float:
        """Return the unit of the heights in m, as the user or the file gives it.

        Raises InvalidScene if neither gives it, or if the two differ and "unit" is not
        accepted.
        """
        stored = self._map
        if self.unit is None:
            if stored.unit is None:
                raise InvalidScene(
                    f"{self.path} does not say in which unit its heights are; give "
                    "unit = 1e-6 for micrometres, 1e-9 for nanometres or 1.0 for metres"
                )
            return stored.unit
        if stored.unit is None or "unit" in self.accept:
            return self.unit
        if not math.isclose(self.unit, stored.unit, rel_tol=_SAME_UNIT):
            raise InvalidScene(
                f"{self.path} states {stored.unit:g} m as the unit of its heights "
                f"({stored.unit_source}), but unit = {self.unit:g} is given; leave out "
                'unit, or set accept = ["unit"] if the file is wrong'
            )
        return stored.unit

    def _periods(self) -> tuple[float, ...]:
        """Return the periods of this map in m, as the user or the file gives them.

        Raises InvalidScene if the periods are given twice or not at all, or if they
        differ from those of the file and "size" is not accepted.
        """
        stored = self._map
        shape = self.shape
        unit = self._unit_in_metres()
        given = as_tuple(self.periods)
        one_for_both = len(given) == 1 and len(shape) == 2
        problem = ""
        if given and self.pixel_size:
            problem = "needs periods or pixel_size, not both"
        elif not given and not self.pixel_size and stored.periods is None:
            problem = "does not say how large the map is; give its periods in m"
        elif not given and not self.pixel_size and self._has_unknown_lengths():
            problem = (
                "does not state the unit of its x; give the length of the map as "
                "period, or the step of x as pixel_size, in m"
            )
        elif one_for_both and shape[0] != shape[-1]:
            problem = (
                f"holds {shape[0]} x {shape[-1]} heights, and one period does not say "
                "how large they are each way; give both"
            )
        if problem:
            raise InvalidScene(f"{self.path} {problem}")
        if self.pixel_size is not None:
            key = f"pixel_size = {self.pixel_size:g} m is"
            periods = tuple(self.pixel_size * n for n in shape)
        elif given:
            key = f"period = {list(given)} m is"
            periods = given * 2 if one_for_both else given
        else:
            length_unit = stored.length_unit or unit
            return tuple(length_unit * length for length in stored.periods or ())
        if stored.periods is not None and "size" not in self.accept:
            self._require_stated_size(periods, key)
        return periods

    def _has_unknown_lengths(self) -> bool:
        """Return True if the file states lengths in a unit that nobody gives.

        A list of x, y and height that states no unit is in one unit.  The x of a
        profile, and of a file that states the unit of its heights alone, often has
        another unit than the heights.
        """
        stored = self._map
        may_differ = stored.unit is not None or len(self.shape) == 1
        return may_differ and stored.length_unit is None

    def _require_stated_size(self, periods: tuple[float, ...], key: str) -> None:
        """Raise InvalidScene if given periods differ from those that the file states.

        If the file does not state the unit of its lengths, the two may differ by the
        ratio of two units.

        Args:
            periods: the periods in m that the user gives, or that follow from the pixel
                size that the user gives.
            key: the key of the case file and its value, for the message.
        """
        stored = self._map
        stated = np.array(stored.periods)
        if len(periods) != len(stated):
            return  # reported with the shape of the grid
        ratios = np.array(periods) / stated
        if stored.length_unit is not None:
            ratio = stored.length_unit
        else:
            ratio = 10.0 ** round(math.log10(max(float(ratios[0]), _LEAST_RATIO)))
        for period, length, points in zip(periods, stated, self.shape, strict=True):
            if not lengths_agree(period, ratio * float(length), points):
                unit = "a unit that it does not state"
                remedy = f"give {ratio * length:g} m or another power of ten of it"
                if stored.length_unit is not None:
                    unit = f"units of {ratio:g} m"
                    remedy = "leave it out"
                lengths = ", ".join(f"{value:g}" for value in stated)
                raise InvalidScene(
                    f"{self.path} states lengths of {lengths} in {unit} "
                    f"({stored.size_source}), but {key} given; {remedy}, or set "
                    'accept = ["size"] if the file is wrong'
                )

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of grid points of this map along each direction."""
        return self._map.heights.shape

    @cached_property
    def fingerprint(self) -> str:
        """The text that identifies the surface: the SHA-256 of the file's content, the
        unit and the treatment of the heights.
        """
        digest = file_digest(Path(self.path))
        words = f"file/3 {digest} unit={self.unit or 1.0!r}"
        if self.channel is not None:
            words += f" channel={self.channel!r}"
        if self.transpose:
            words += " transpose"
        return f"{words} {self.steps}"

    def build(self) -> Surface:
        """Return the surface of this file's heights, treated as the fields say.

        Raises:
            InvalidScene: The heights are no usable map, jump at their edges though
                `treatment` is "refuse", or are steeper than any surface.
            NotEnoughMemory: The surface does not fit into memory.
        """
        mirrored = self.treatment == "mirrored"
        require_room(Mirrored(self).shape if mirrored else self.shape)
        stored = self._map
        surface = prepare_surface(
            stored.heights,
            self,
            str(self.path),
            [*stored.notes, *self._scale_notes()],
            self._unit_in_metres(),
            stored.filled,
            stored.otherwise,
        )
        return self._with_checked_slope(surface)

    def _scale_notes(self) -> Iterator[str]:
        """Yield the unit that the file states, and what the grid spacings suggest.

        Different spacings along x and y show a user who has given the periods in the
        wrong order; they are not noted if the file itself gives the periods.  A note on
        a line says for which surfaces it stands.
        """
        stored = self._map
        if stored.unit is not None and stored.unit_source:
            yield (
                f"the unit of the heights is {self._unit_in_metres():g} m; the file "
                f"states: {stored.unit_source}"
            )
        if stored.periods is not None and stored.length_unit is None:
            first = stored.periods[0]
            yield (
                f"the file does not state the unit of its lengths; it was taken to be "
                f"{self.periods[0] / first:.3g} m"
            )
        yield LINE if len(self.shape) == 1 else stored.orientation
        x = self.periods[0] / self.shape[0]
        y = self.periods[-1] / self.shape[-1]
        equal = math.isclose(x, y, rel_tol=_SAME_SPACING)
        if not equal and stored.periods is None:
            yield (
                f"the periods make the grid {x:.3g} m wide along x, over "
                f"{self.shape[0]} heights, and {y:.3g} m along y, over {self.shape[1]}"
            )

    def _with_checked_slope(self, surface: Surface) -> Surface:
        """Return the surface, unless its rms slope suggests a wrong unit.

        A slope that is accepted by `accept`, or that a result (.vti) has, whose unit is
        certain, adds a note.

        Raises InvalidScene if the slope is above STEEPEST or below FLATTEST, but not 0;
        the message names outliers and marks of missing heights, which may be the reason
        of a steep slope.
        """
        slope = surface.rms_slope
        if slope == 0 or FLATTEST <= slope <= STEEPEST:
            return surface
        bound = "beyond that of any surface"
        if slope < FLATTEST:
            bound = "below that of any but optical flats"
        is_result = Path(self.path).suffix == ".vti"
        if "slope" in self.accept or is_result:
            note = f"the rms slope is {slope:.3g}, {bound}, and was accepted"
            return replace(surface, notes=(*surface.notes, *warn_user((note,))))
        message = (
            f"{self.path}: the rms slope is {slope:.3g}, {bound}; the heights and the "
            "lengths along the map must be in one unit: check unit, period and "
            'pixel_size, or set accept = ["slope"] if they are correct'
        )
        for note in surface.notes:
            if slope > STEEPEST and ("outliers" in note or _MARK in note):
                message += f"; or {note}"
        raise InvalidScene(message)


@dataclass(frozen=True)
class Mirrored:
    """The recipe of a map that is mirrored, with the shape and periods of its surface.

    Example:
        >>> Mirrored(HeightsFromArray([0.0, 1e-6, 3e-6], (1e-3,), "mirrored")).shape
        (6,)
    """

    map: HeightsFromFile | HeightsFromArray  #: A recipe whose treatment is "mirrored".
    shape: tuple[int, ...] = field(init=False)  #: Twice that of the map, each way.
    periods: tuple[float, ...] = field(init=False)  #: Twice those of the map, in m.
    fingerprint: str = field(init=False)  #: That of the map, which names the treatment.

    def __post_init__(self) -> None:
        """Set shape and periods of the surface to twice those of the map."""
        shape = tuple(2 * n for n in self.map.shape)
        periods = tuple(2 * length for length in self.map.periods)
        set_frozen(self, shape=shape, periods=periods, fingerprint=self.map.fingerprint)

    def build(self) -> Surface:
        """Return the mirrored surface of this map.

        Raises InvalidScene or NotEnoughMemory as the map's own `build` does.
        """
        return self.map.build()


@dataclass(frozen=True)
class Facing:
    """The recipe of two rough surfaces face to face, on one grid.

    Contact depends only on the difference of both heights in one frame.  Each surface
    has its heights out of its own body, and those of the second count downward in the
    frame of the first: the difference is the sum of both.  Point (x, y) of the second
    lies over point (x, y) of the first.

    Raises:
        InvalidScene: the grids or the periods differ.
    """

    first: Recipe  #: The surface of the lower body.
    second: Recipe  #: The surface of the counterface.
    shape: tuple[int, ...] = field(init=False)  #: That of both surfaces.
    periods: tuple[float, ...] = field(init=False)  #: Those of both surfaces, in m.
    fingerprint: str = field(init=False)  #: Those of both surfaces.

    def __post_init__(self) -> None:
        """Set shape, periods and fingerprint from those of both surfaces.

        Raises InvalidScene if the grids or the periods of the two surfaces differ.
        """
        a = self.first
        b = self.second
        same_shape = a.shape == b.shape
        if not same_shape or not np.allclose(
            a.periods, b.periods, rtol=_SAME_PERIODS, atol=0
        ):
            raise InvalidScene(
                f"surface has {a.shape} points over {a.periods} m and the "
                f"counterface's {b.shape} over {b.periods} m, but two surfaces face "
                "each other on one grid and period"
            )
        words = f"facing/1 {a.fingerprint} on {b.fingerprint}"
        set_frozen(self, shape=a.shape, periods=a.periods, fingerprint=words)

    def build(self) -> Surface:
        """Return the surface whose heights (m) are the sum of both surfaces' heights.

        Raises InvalidScene or NotEnoughMemory if one of the surfaces cannot be made.
        """
        a = self.first.build()
        b = self.second.build()
        shortest = None
        if a.shortest_wavelength is not None and b.shortest_wavelength is not None:
            shortest = min(a.shortest_wavelength, b.shortest_wavelength)
        errors = {}
        for name in {**a.treatment_errors, **b.treatment_errors}:
            of_a = a.treatment_errors.get(name, 0.0)
            of_b = b.treatment_errors.get(name, 0.0)
            errors[name] = math.hypot(of_a, of_b)
        notes_of_b = (f"counterface: {note}" for note in b.notes)
        return Surface(
            a.heights + b.heights,
            a.periods,
            shortest_wavelength=shortest,
            recipe=self.fingerprint,
            notes=(*a.notes, *notes_of_b, "heights are of both bodies"),
            treatment_errors=errors,
            filled=_union(a.filled, b.filled),
            alternatives=(*a.alternatives, *b.alternatives),
            sampled=a.sampled or b.sampled,
        )


def _union(
    first: NDArray[np.bool_] | None, second: NDArray[np.bool_] | None
) -> NDArray[np.bool_] | None:
    """Return the mask of the points that are True in either of two masks.

    Args:
        first, second: masks of one shape; None is a mask without a point.

    Returns:
        The mask; None if both are None.
    """
    if first is None:
        return second
    if second is None:
        return first
    return first | second


def residual_surface(surface: Surface, result: ContactResult) -> Surface:
    """Return the surface after a contact: the heights less the plastic displacement.

    The result of a body with a hardness has the plastic displacement at every load.
    That of a J2 body does not, so that its load path must end at 0: the displacement
    that then remains is the plastic one.

    Args:
        surface: the surface of the scene that was solved.
        result: the result of that scene, with fields.

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
        unloaded = pressures[-1] <= UNLOADED * max(pressures)
        if not unloaded or "displacement" not in result.fields:
            raise InvalidScene(
                f"{result.method} gives no plastic displacement; let its load path end "
                "at 0, where the displacement that remains is the plastic one"
            )
        lowered = result.fields["displacement"]
    note = f"the surface that {result.method} has left after plastic flow"
    return replace(
        surface,
        heights=surface.heights - lowered,
        spectrum=None,
        recipe="",
        notes=(*surface.notes, note),
    )
