"""The scene: one periodic rough surface, a material, a body and a load, frozen and
checked once.

This module holds everything that a method may know of the problem, and no part of any
method, so that `fem_check` can import it and stay independent of the boundary-element
solver.  All units are SI.  The parts of a scene come first, then the checks of heights,
then those of any input.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import itertools
import json
import math
import sys
import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from numbers import Real
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from epcontact.errors import InvalidScene, SurfaceWarning
from epcontact.results import FloatArray

BodyKind = Literal["half_space", "bonded_layer", "sliding_layer"]


@dataclass(frozen=True)
class SelfAffineSpectrum:
    """The power spectrum of isotropic self-affine roughness.

    It is flat from `wavenumber_low` to `wavenumber_roll_off`, falls as a power law from
    there to `wavenumber_high`, and is zero outside.  The power law is q^(-2(1+H)) on a
    surface and q^(-(1+2H)) on a line.

    Raises:
        InvalidScene: The wave numbers are not in order, or a value is out of its range.

    Example:
        >>> SelfAffineSpectrum(0.8, 2.5e4, 1e5, 64e5, rms_slope=1.0).hurst
        0.8
    """

    hurst: float  #: The Hurst exponent H, from 0 to 1.
    wavenumber_low: float  #: q_0 in rad/m.
    wavenumber_roll_off: float  #: q_r in rad/m.
    wavenumber_high: float  #: q_1 in rad/m.
    rms_slope: float  #: xi in m/m.

    def __post_init__(self) -> None:
        names = ("wavenumber_low", "wavenumber_roll_off", "wavenumber_high")
        low, roll_off, high = waves = [
            positive(n, getattr(self, n), "rad/m") for n in names
        ]
        slope = positive("rms_slope", self.rms_slope, "m/m")
        hurst = number(
            "hurst", self.hurst, "a number between 0 and 1", lambda v: 0 <= v <= 1
        )
        settle(
            self, hurst=hurst, rms_slope=slope, **dict(zip(names, waves, strict=True))
        )
        _require(
            low <= roll_off <= high,
            "wavenumbers are out of order: wavenumber_low <= wavenumber_roll_off <= "
            f"wavenumber_high is needed, got {low:g}, {roll_off:g}, {high:g}",
        )


@dataclass(frozen=True, eq=False, repr=False)
class Surface:
    """One period of a rough surface on a regular grid.

    The heights become a read-only array of float64; a writable one is copied.  The
    class adds a note for an rms slope above 1, for heights in steps, for those of a
    picture and for oblong cells, and warns of it by a `SurfaceWarning`.

    Raises:
        InvalidScene: The heights are not finite real numbers, or do not fit the
            periods.

    Example:
        >>> Surface(np.zeros((4, 8)), periods=(1e-3, 2e-3)).spacing
        (0.00025, 0.00025)
    """

    heights: FloatArray  #: (nx, ny), or (nx,) for a line, in m, measured upward.
    periods: tuple[
        float, ...
    ]  #: (Lx, Ly) or (Lx,) in m, after which the heights repeat.
    spectrum: SelfAffineSpectrum | None = (
        None  #: That from which the heights were drawn.
    )
    seed: int | None = None  #: That of the random phases.
    shortest_wavelength: float | None = (
        None  #: That of the roughness in m, if it is known.
    )
    recipe: str = (
        ""  #: Identifies generated heights in the scene's digest, not their bytes.
    )
    notes: tuple[str, ...] = ()  #: Sentences for the reader of a result.
    #: By names of `results.COLUMNS`, shares that a map's treatment may change; areas:
    #: of the total.
    treatment_errors: Mapping[str, float] = field(default_factory=dict)
    #: Where a height was filled or replaced, and not measured; None: nowhere.
    filled: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        given = checked_heights(self.heights, "heights")
        heights = np.ascontiguousarray(given, dtype=np.float64)
        if heights.flags.writeable or heights.base is not None:
            heights = heights.copy()
            heights.flags.writeable = False
        periods = tuple(positive("periods", p, "m") for p in listed(self.periods))
        settle(self, heights=heights, periods=periods)
        sizes = f"{len(periods)} lengths for heights of {heights.ndim} dimensions"
        _require(len(periods) == heights.ndim, f"periods has {sizes}")
        if self.spectrum is not None:
            require_kind("spectrum", self.spectrum, SelfAffineSpectrum)
        if self.shortest_wavelength is not None:
            shortest = positive("shortest_wavelength", self.shortest_wavelength, "m")
            settle(self, shortest_wavelength=shortest)
        if self.seed is not None:
            settle(self, seed=whole("seed", self.seed, 0))
        require_known(heights, "heights")
        settle(self, filled=_checked_mask(self.filled, heights.shape))
        doubts = (*levels_note(given.dtype), *_doubts(self))
        new = cautioned(tuple(note for note in doubts if note not in self.notes))
        settle(self, notes=(*listed(self.notes), *new))

    def __eq__(self, other: object) -> bool:
        """Whether both are the same heights over the same periods, drawn from the same
        spectrum.
        """
        return self is other or (
            isinstance(other, Surface)
            and (self.periods, self.spectrum) == (other.periods, other.spectrum)
            and np.array_equal(self.heights, other.heights)
        )

    def __hash__(self) -> int:
        return hash((self.shape, self.periods))

    def __repr__(self) -> str:
        points, sides = (
            " x ".join(f"{n:.4g}" for n in of) for of in (self.shape, self.periods)
        )
        return (
            f"<Surface of {points} points on {sides} m, rms slope {self.rms_slope:.3g}>"
        )

    @property
    def shape(self) -> tuple[int, ...]:
        """Grid points along each direction."""
        return self.heights.shape

    @property
    def spacing(self) -> tuple[float, ...]:
        """Grid spacing along each direction, in m."""
        return tuple(p / n for p, n in zip(self.periods, self.shape, strict=True))

    @functools.cached_property
    def rms_height(self) -> float:
        """Root mean square of the heights about their mean, in m."""
        return float(self.heights.std())

    @functools.cached_property
    def rms_slope(self) -> float:
        """Root mean square of the gradient in m/m; see the function `rms_slope`."""
        return rms_slope(self.heights, self.spacing)

    @property
    def fingerprint(self) -> str:
        """The text that identifies the heights: their recipe, or the hash of their
        bytes and, if some were filled, of the mask of these.
        """
        if self.recipe:
            return self.recipe
        digest = hashlib.sha256(self.heights.data)
        if self.filled is not None:
            digest.update(self.filled.data)
        return digest.hexdigest()


@dataclass(frozen=True)
class Material:
    """The elastoplastic solid; the counterface is rigid.

    The ratio of its two strengths is a result of the methods, not an input.

    Raises:
        InvalidScene: A value is out of its range.
    """

    young_modulus: float  #: E in Pa.
    poisson_ratio: float  #: nu, between -1 and 0.5.
    hardness: float = math.inf  #: sigma_P in Pa, at which the contact flows.
    yield_stress: float = math.inf  #: sigma_Y in Pa of the J2 solid.

    def __post_init__(self) -> None:
        right = "a number between -1 and 0.5, both excluded"
        ratio = number(
            "poisson_ratio", self.poisson_ratio, right, lambda v: -1 < v < 0.5
        )
        settle(self, poisson_ratio=ratio)
        for name in ("young_modulus", "hardness", "yield_stress"):
            value = positive(
                name, getattr(self, name), "Pa", finite=name == "young_modulus"
            )
            settle(self, **{name: value})


@dataclass(frozen=True)
class Body:
    """The body under the surface: a half-space, or a layer that a rigid base holds or
    lets slide.

    Raises:
        InvalidScene: The kind is unknown, or the depth does not fit it.
    """

    kind: BodyKind = "half_space"  #: A layer slides without friction.
    depth: float = math.inf  #: Of a layer, in m.

    def __post_init__(self) -> None:
        require_one_of("body kind", self.kind, BodyKind)
        if self.kind == "half_space":
            number(
                "depth",
                self.depth,
                "left out, as a half_space takes no depth",
                math.isinf,
            )
        else:
            settle(self, depth=positive("depth", self.depth, "m"))


@dataclass(frozen=True)
class Load:
    """The mean pressure in Pa (force over nominal area), or a path of mean pressures in
    order.

    After the first pressure, a path may unload to zero.

    Raises:
        InvalidScene: A pressure is not a positive number, or the path is empty.
    """

    mean_pressure: float | tuple[float, ...]

    def __post_init__(self) -> None:
        given = listed(self.mean_pressure)
        _require(
            len(given) > 0, "mean_pressure is an empty path; give at least one pressure"
        )
        first = positive("mean_pressure", given[0], "Pa")
        right = "a positive number in Pa, or 0 after the first"
        later = [number("mean_pressure", p, right, lambda v: v >= 0) for p in given[1:]]
        path = (first, *(p and positive("mean_pressure", p, "Pa") for p in later))
        settle(self, mean_pressure=path)

    @property
    def path(self) -> tuple[float, ...]:
        """The mean pressures in order, in Pa; a single one is a path of length one."""
        return listed(self.mean_pressure)

    @property
    def final(self) -> float:
        """The last mean pressure of the path, in Pa."""
        return self.path[-1]

    @property
    def non_decreasing(self) -> bool:
        """True if the path never unloads."""
        return all(a <= b for a, b in itertools.pairwise(self.path))


@dataclass(frozen=True)
class Scene:
    """One contact problem.  A method maps it to a `ContactResult`.

    Raises:
        InvalidScene: A mean pressure reaches the hardness, so that nothing carries the
            load.

    Example:
        >>> wave = np.cos(np.linspace(0, 2 * np.pi, 64, endpoint=False))
        >>> surface = Surface(1e-3 * wave, periods=(1.0,))
        >>> material = Material(young_modulus=100.0, poisson_ratio=0.3)
        >>> Scene(surface, material, Load(mean_pressure=1.0)).load.final
        1.0
    """

    surface: Surface
    material: Material
    load: Load
    body: Body = field(default_factory=Body)

    def __post_init__(self) -> None:
        kinds = {"surface": Surface, "material": Material, "load": Load, "body": Body}
        for name, kind in kinds.items():
            require_kind(name, getattr(self, name), kind)
        check_load(self.material, self.load)

    @property
    def digest(self) -> str:
        """SHA-256 of everything the scene holds, as hexadecimal digits: its name in
        results.
        """
        surface = (self.surface.fingerprint, self.surface.shape, self.surface.periods)
        return scene_digest(*surface, self.material, self.body, self.load)


def scene_digest(
    fingerprint: str,
    shape: tuple[int, ...],
    periods: tuple[float, ...],
    material: Material,
    body: Body,
    load: Load,
) -> str:
    """Return the digest of a scene; its recipe gives the fingerprint before any heights
    exist.
    """
    lengths = [repr(float(p)) for p in periods]
    content: dict[str, Any] = {
        "surface": fingerprint,
        "shape": list(shape),
        "periods": lengths,
    }
    for part in (material, body, load):
        content[type(part).__name__] = {
            name: repr(v) for name, v in asdict(part).items()
        }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def check_load(material: Material, load: Load) -> None:
    """Raise InvalidScene if a mean pressure reaches the hardness."""
    worst, hardness = max(load.path), material.hardness
    words = f"mean_pressure is {worst:g} Pa, but must stay below the hardness of {hardness:g} Pa"
    _require(worst < hardness, words)


def check_loading(material: Material, load: Load) -> None:
    """Raise InvalidScene if the path unloads a method that keeps no memory of plastic
    flow.
    """
    _require(
        load.non_decreasing or material.hardness == math.inf,
        "mean_pressure decreases along the path, but this method keeps no memory of the plastic "
        "flow; give a non-decreasing path, an infinite hardness or the method bem or fem",
    )
    _require(
        min(load.path) > 0,
        "mean_pressure falls to 0 along the path, but this method needs a load; end the path above "
        "0 or give the method bem or fem",
    )


# --- heights
# -------------------------------------------------------------------------------------


def rms_slope(heights: FloatArray, spacing: tuple[float, ...]) -> float:
    """Return the rms gradient of heights (nx, ny) or (nx,), from differences of
    neighbours.
    """
    total = 0.0
    for axis, step in enumerate(spacing):
        differences = np.diff(heights, axis=axis)
        differences *= differences
        total += float(differences.mean()) / step**2
    return math.sqrt(total)


def checked_heights(given: ArrayLike, where: str) -> NDArray[Any]:
    """Return heights as an array of real numbers on a line or grid, NaN where they are
    masked.
    """
    try:
        heights = np.asanyarray(given)
    except ValueError:
        raise InvalidScene(
            f"{where}: rows of unequal length are no grid of heights"
        ) from None
    if np.ma.is_masked(heights):
        heights = np.ma.filled(heights.astype(np.float64), np.nan)
    kind = "complex" if heights.dtype.kind == "c" else heights.dtype
    real = heights.dtype.kind in "buif"
    _require(real, f"{where}: holds {kind} values, but heights are real numbers")
    _require(
        heights.ndim in (1, 2) and min(heights.shape) >= 2,
        f"{where}: has shape {heights.shape}, but heights are a line (nx,) or a grid (nx, ny) of "
        "at least two points a direction",
    )
    return heights


def _checked_mask(given: Any, shape: tuple[int, ...]) -> NDArray[np.bool_] | None:
    """Return the mask of filled heights, read-only; None if it marks no point.

    Raises InvalidScene if it is no mask of the heights' shape.
    """
    if given is None:
        return None
    mask = np.ascontiguousarray(given)
    _require(
        mask.dtype == np.bool_ and mask.shape == shape,
        f"filled is an array of {mask.dtype} of shape {mask.shape}, but must be a mask "
        f"of true and false of the shape of the heights, {shape}",
    )
    if not mask.any():
        return None
    if mask.flags.writeable or mask.base is not None:
        mask = mask.copy()
        mask.flags.writeable = False
    return mask


def require_known(heights: NDArray[Any], where: str, missing: str = "refuse") -> None:
    """Raise InvalidScene if heights are no numbers, or are missing (NaN) and not
    filled.
    """
    low, high = float(heights.min()), float(heights.max())  # without a temporary array
    if not (math.isfinite(low) and math.isfinite(high)):
        infinite, absent = (
            int(np.count_nonzero(f(heights))) for f in (np.isinf, np.isnan)
        )
        found = f"{infinite} of {heights.size} heights are infinite"
        _require(not infinite, f"{where}: {found}; mark missing ones by NaN")
        told = f"{where}: {absent} of {heights.size} heights are NaN or masked"
        _require(absent < heights.size, told)
        fill = (
            'crop them, or let them be filled: set missing to "harmonic" or "nearest"'
        )
        _require(missing != "refuse", f"{told}; {fill}")
        low, high = float(np.nanmin(heights)), float(np.nanmax(heights))
    span, largest = high - low, max(abs(low), abs(high))
    _require(
        largest <= LARGEST, f"{where}: heights reach {largest:.3g} m; check their unit"
    )
    few = f"{where}: heights span {span:.3g} m, less than {SMALLEST:g} m; check their unit"
    _require(span == 0 or span >= SMALLEST, few)


# --- doubts about heights
# ------------------------------------------------------------------------


def levels_note(kind: np.dtype[Any]) -> tuple[str, ...]:
    """Return a warning for heights of so few levels that they are more likely a
    picture.
    """
    if kind.kind not in "bui" or kind.itemsize > 1:
        return ()
    words = "true and false" if kind.kind == "b" else "whole numbers of 8 bits"
    return (
        f"the heights are {words}, as in a picture: the contact sees their steps, and their unit "
        "must be that of one level",
    )


def _doubts(surface: Surface) -> list[str]:
    """Return a sentence for each sign that a surface is not what its maker means."""
    slope = (
        surface.spectrum.rms_slope
        if surface.spectrum is not None
        else surface.rms_slope
    )
    step = _coarse_step(surface.heights, change := slope * min(surface.spacing))
    whose = "for these steps, but not for a smooth surface that was rounded"
    if step < 1.1 * change:
        whose = "neither for them nor for a smooth surface: smooth the heights or refine the grid"
    if (
        step <= change / 40
    ):  # where the smooth surface is within its claims (`area_bank`)
        whose = "for the smooth surface that was rounded, but not for its steps"
    ratio = max(surface.spacing) / min(surface.spacing)
    signs = {
        f"the rms slope is {slope:.3g}, beyond the small slopes that the methods assume; check "
        "that heights and periods are in m": slope > 1,
        f"the heights are in steps of {step:.3g} m, as a map of few bits is: "
        f"claimed errors of areas hold {whose}": step > 0,
        f"the grid's cells are {ratio:.3g} times as long as wide: corrected areas and their "
        "claimed errors hold up to 2; take points at like distances in both directions": (
            ratio > 2 * (1 + 1e-9)
        ),
    }
    return [sentence for sentence, doubtful in signs.items() if doubtful]


def _coarse_step(heights: FloatArray, change: float) -> float:
    """Return the step of heights that are its multiples and bend at most points or
    wherever they change, or 0; change: the rms change from point to point, below a
    hundredth of which steps are within the claims of areas.  A corner of the grid shows
    it.
    """
    corner = heights[tuple(slice(100) for _ in heights.shape)]
    levels = np.unique(corner)
    if (
        levels.size < 3
        or corner.size < 16
        or (step := np.diff(levels).min()) < change / 100
    ):
        return 0.0
    multiples = (levels - levels[0]) / step
    uneven = np.max(np.abs(multiples - np.round(multiples))) > 1e-3
    axes = [axis for axis, n in enumerate(corner.shape) if n > 2]
    rises, bends = ([np.diff(corner, order, axis) for axis in axes] for order in (1, 2))
    bends = [found - np.median(found) for found in bends]  # a parabola's are alike
    steep, bent = (
        np.mean([np.mean(abs(a) > step / 2) for a in b]) for b in (rises, bends)
    )
    return 0.0 if uneven or bent < min(steep, 1 / 4) else float(step)


def cautioned(notes: tuple[str, ...]) -> tuple[str, ...]:
    """Warn the user's line that makes a surface (not the package's) of each note;
    return them.
    """
    level, makers = 1, ("epcontact.scene", "epcontact.surfaces", "dataclasses")
    while (name := sys._getframe(level).f_globals.get("__name__", "")).startswith(
        makers
    ):
        level += 1
    for note in notes if not name.startswith(("epcontact.", "fem_check.")) else ():
        warnings.warn(note, SurfaceWarning, stacklevel=level + 1)
    return notes


# --- inputs
# --------------------------------------------------------------------------------------

#: Lengths, pressures and wave numbers in SI units.  Their products and squares, which
#: the methods form, neither overflow nor underflow: all answers keep their digits at
#: both ends of the range.
SMALLEST, LARGEST = 1e-40, 1e40


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise InvalidScene(message)


def number(name: str, given: Any, right: str, good: Callable[[float], bool]) -> float:
    """Return a number of Python or numpy as a float, for every input of the package
    that is one. Raises InvalidScene, that `name` must be `right`, if it is no real
    number or is not `good`.
    """
    plain = (
        given.item()
        if isinstance(given, np.generic | np.ndarray) and not given.ndim
        else given
    )
    value = math.nan
    if not isinstance(plain, bool) and isinstance(plain, Real):
        with contextlib.suppress(
            OverflowError
        ):  # a whole number of Python has no limit
            value = float(plain)
    _require(good(value), f"{name} is {plain!r:.60}, but must be {right}")
    return value


def positive(name: str, given: Any, unit: str, *, finite: bool = True) -> float:
    """Return a positive number whose products are numbers; see `number`."""
    right = f"a positive number in {unit}"
    value = number(name, given, right, lambda v: v > 0 and (v < math.inf or not finite))
    _require(
        SMALLEST <= value <= LARGEST or value == math.inf,
        f"{name} is {value:g} {unit}, but must lie between {SMALLEST:g} and {LARGEST:g}, where "
        "products neither overflow nor vanish",
    )
    return value


def share(name: str, given: Any) -> float:
    """Return a number between 0 and 1, both excluded, as a tolerance is; see
    `number`.
    """
    return number(
        name, given, "a number between 0 and 1, both excluded", lambda v: 0 < v < 1
    )


def whole(name: str, given: Any, least: int) -> int:
    """Return a whole number of at least `least` as an int; see `number`."""
    right = f"a whole number of at least {least}"
    number(name, given, right, lambda v: v >= least and v.is_integer())
    return int(given)


def array(name: str, given: Any) -> FloatArray:
    """Return an array of 64-bit floats, in this machine's byte order.  Raises
    InvalidScene.
    """
    with contextlib.suppress(TypeError, ValueError):
        if (values := np.asarray(given)).dtype.kind != "c":
            return values.astype(np.float64, copy=False)
    raise InvalidScene(f"{name} is {given!r:.60}, but must be an array of real numbers")


def listed(given: Any) -> tuple[Any, ...]:
    """Return one value, or several in any sequence, as a tuple."""
    try:
        return (given,) if isinstance(given, str | bytes) else tuple(given)
    except TypeError:
        return (given,)


def require_kind(name: str, given: Any, kind: type) -> None:
    """Raise InvalidScene unless an input is an instance of a class of the package."""
    _require(
        isinstance(given, kind),
        f"{name} is {given!r:.60}, but must be a {kind.__name__}",
    )


def require_one_of(name: str, given: Any, words: Any) -> None:
    """Raise InvalidScene unless an input is one of the words of a Literal type."""
    known = get_args(words)
    _require(
        given in known, f"{name} is {given!r}, but must be one of {', '.join(known)}"
    )


def settle(frozen: Any, **checked: Any) -> None:
    """Set fields of a frozen dataclass to their checked values."""
    for name, value in checked.items():
        object.__setattr__(frozen, name, value)
