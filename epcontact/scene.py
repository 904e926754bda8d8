"""The scene: one periodic rough surface, a material, a body and a load.

A scene is frozen, and its values are checked once, when it is created.  This module
holds everything that a method may know of the problem, and no part of any method.
`fem_check` can therefore import it and stay independent of the boundary-element solver.
All units are SI.  The parts of a scene come first, then the checks of heights, then the
checks of any input.
"""

from __future__ import annotations

import contextlib
import copy
import functools
import hashlib
import html
import itertools
import json
import math
import sys
import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from numbers import Real
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from epcontact.errors import InvalidScene, SurfaceWarning
from epcontact.results import FloatArray

BodyKind = Literal["half_space", "bonded_layer", "sliding_layer"]


@dataclass(frozen=True)
class SelfAffineSpectrum:
    """The power spectrum of isotropic self-affine roughness.

    The spectrum is constant from `wavenumber_low` to `wavenumber_roll_off`, falls as a
    power law from there to `wavenumber_high`, and is zero outside.  The power law is
    q^(-2(1+H)) on a surface and q^(-(1+2H)) on a line.

    Raises:
        InvalidScene: The wave numbers are not in order, or a value is out of its range.

    Example:
        >>> SelfAffineSpectrum(0.8, 2.5e4, 1e5, 64e5, rms_slope=1.0).hurst
        0.8
    """

    hurst: float  #: The Hurst exponent H, from 0 to 1.
    wavenumber_low: float  #: The smallest wave number q_0, in rad/m.
    wavenumber_roll_off: float  #: The wave number q_r where the fall begins, in rad/m.
    wavenumber_high: float  #: The largest wave number q_1, in rad/m.
    rms_slope: float  #: The root mean square of the gradient xi, in m/m.

    def __post_init__(self) -> None:
        """Turn the values into floats; raise InvalidScene if one is not valid."""
        for name in ("wavenumber_low", "wavenumber_roll_off", "wavenumber_high"):
            set_frozen(self, **{name: positive(name, getattr(self, name), "rad/m")})
        slope = positive("rms_slope", self.rms_slope, "m/m")
        expected = "a number between 0 and 1"
        hurst = number("hurst", self.hurst, expected, lambda value: 0 <= value <= 1)
        set_frozen(self, hurst=hurst, rms_slope=slope)
        low = self.wavenumber_low
        roll_off = self.wavenumber_roll_off
        high = self.wavenumber_high
        _require(
            low <= roll_off <= high,
            "wavenumbers are out of order: wavenumber_low <= wavenumber_roll_off <= "
            f"wavenumber_high is needed, got {low:g}, {roll_off:g}, {high:g}",
        )


@dataclass(frozen=True, eq=False)
class Alternative:
    """A change of heights that the measurement of a surface leaves open.

    Attributes:
        source: The name of the error that it causes in results: "form" for a removed
            plane, "missing" for heights that were filled, clipped or replaced.
        points: The index of the points that change, such as the arrays that
            `numpy.nonzero` returns; ... for all points.
        changes: Arrays in m whose sum is added to the heights of these points; each is
            broadcast to them.
    """

    source: Literal["form", "missing"]
    points: Any
    changes: tuple[FloatArray, ...]

    def applied_to(self, surface: Surface) -> Surface:
        """Return the surface with the changed heights, and without alternatives."""
        heights = surface.heights.copy()
        for change in self.changes:
            heights[self.points] += change
        heights.flags.writeable = False
        recipe = f"{surface.fingerprint} but for {self.source}"
        return replace(
            surface, heights=heights, recipe=recipe, alternatives=(), sampled=False
        )


@dataclass(frozen=True, eq=False, repr=False)
class Surface:
    """One period of a rough surface on a regular grid.

    The heights become a read-only array of float64; a writable array is copied.  An rms
    slope above 1, heights in steps, heights of a picture and oblong cells each add a
    note and cause a `SurfaceWarning`.

    Raises:
        InvalidScene: The heights are not finite real numbers, do not fit the periods,
            or a mask of filled heights does not fit the heights.

    Example:
        >>> Surface(np.zeros((4, 8)), periods=(1e-3, 2e-3)).spacing
        (0.00025, 0.00025)
    """

    #: Heights of the grid points in m, measured upward: (nx, ny), or (nx,) for a line.
    heights: FloatArray
    #: Lengths in m after which the heights repeat: (Lx, Ly), or (Lx,) for a line.
    periods: tuple[float, ...]
    #: The analytic spectrum from which the heights were drawn, if there is one.
    spectrum: SelfAffineSpectrum | None = None
    #: The seed of the random phases, if there are any.
    seed: int | None = None
    #: The shortest wavelength of the roughness in m, if it is known.
    shortest_wavelength: float | None = None
    #: A text that identifies generated heights in the scene's digest, which need not
    #: read their bytes then.
    recipe: str = ""
    #: Sentences for the reader of a result.
    notes: tuple[str, ...] = ()
    #: Relative errors that the treatment of a measured map may cause, by names of
    #: `results.COLUMNS`.  The errors of areas are fractions of the total area.
    treatment_errors: Mapping[str, float] = field(default_factory=dict)
    #: Mask of the points whose heights were filled or replaced instead of measured;
    #: None if there are no such points.
    filled: NDArray[np.bool_] | None = None
    #: Other heights that the measurement leaves open; a solve of each shows the errors
    #: that this causes.
    alternatives: tuple[Alternative, ...] = ()
    #: True if the heights between the grid points are unknown, as those of a measured
    #: map are; the error by the grid then counts what every second point would change
    #: (`bem.resolution`).  None: True if there is no recipe.
    sampled: bool | None = None

    def __post_init__(self) -> None:
        """Check the fields and make them read-only; add notes about doubtful heights.

        Each note is issued as a SurfaceWarning.  Raises InvalidScene if a field is not
        valid.
        """
        given = checked_heights(self.heights, "heights")
        heights = _read_only(np.ascontiguousarray(given, dtype=np.float64))
        periods = tuple(positive("periods", p, "m") for p in as_tuple(self.periods))
        set_frozen(self, heights=heights, periods=periods)
        sizes = f"{len(periods)} lengths for heights of {heights.ndim} dimensions"
        _require(len(periods) == heights.ndim, f"periods has {sizes}")
        if self.spectrum is not None:
            require_kind("spectrum", self.spectrum, SelfAffineSpectrum)
        if self.shortest_wavelength is not None:
            shortest = positive("shortest_wavelength", self.shortest_wavelength, "m")
            set_frozen(self, shortest_wavelength=shortest)
        if self.seed is not None:
            set_frozen(self, seed=integer("seed", self.seed, 0))
        require_usable(heights, "heights")
        set_frozen(self, filled=_checked_mask(self.filled, heights.shape))
        if self.sampled is None:
            set_frozen(self, sampled=not self.recipe)
        warnings_now = [*levels_note(given.dtype), *_suspicions(self)]
        new = tuple(note for note in warnings_now if note not in self.notes)
        set_frozen(self, notes=(*as_tuple(self.notes), *warn_user(new)))

    def __eq__(self, other: object) -> bool:
        """Return whether two surfaces have equal heights, periods and spectra."""
        if self is other:
            return True
        return (
            isinstance(other, Surface)
            and self.periods == other.periods
            and self.spectrum == other.spectrum
            and np.array_equal(self.heights, other.heights)
        )

    def __hash__(self) -> int:
        """Return a hash that equal surfaces share."""
        return hash((self.shape, self.periods))

    def __repr__(self) -> str:
        """Return the points, the lengths of the sides in m, and the rms slope."""
        points = " x ".join(str(n) for n in self.shape)
        sides = " x ".join(f"{length:.4g}" for length in self.periods)
        slope = f"rms slope {self.rms_slope:.3g}"
        return f"<Surface of {points} points on {sides} m, {slope}>"

    def _repr_html_(self) -> str:
        """Return a table of the surface as HTML, which a notebook shows."""
        return _html_table(self._description)

    def annotated(self, **fields: Any) -> Surface:
        """Return the surface with other notes, treatment errors or alternatives.

        Unlike `dataclasses.replace`, this does not check the heights again, which takes
        as long as three Fourier transforms of them.

        Args:
            fields: New values of `notes`, `treatment_errors` or `alternatives`.
        """
        changed = copy.copy(self)
        set_frozen(changed, **fields)
        return changed

    @property
    def _description(self) -> dict[str, str]:
        """What the surface is, as texts with units by their names."""
        texts = {
            "grid points": " × ".join(str(count) for count in self.shape),
            "periods": " × ".join(f"{length:.4g} m" for length in self.periods),
            "spacing": " × ".join(f"{length:.4g} m" for length in self.spacing),
            "rms height": f"{self.rms_height:.4g} m",
            "rms slope": f"{self.rms_slope:.4g}",
        }
        if self.seed is not None:
            texts["seed"] = str(self.seed)
        if self.notes:
            texts["notes"] = "; ".join(self.notes)
        return texts

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of grid points along each direction."""
        return self.heights.shape

    @property
    def spacing(self) -> tuple[float, ...]:
        """Distance of neighbouring grid points along each direction, in m."""
        return tuple(p / n for p, n in zip(self.periods, self.shape, strict=True))

    @functools.cached_property
    def rms_height(self) -> float:
        """Root mean square of the heights about their mean, in m."""
        mean = self.heights.mean()
        squares = 0.0
        for line in np.atleast_2d(self.heights):  # one line stays in the cache
            deviation = line - mean
            squares += float(np.einsum("i,i->", deviation, deviation))
        return math.sqrt(squares / self.heights.size)

    @functools.cached_property
    def rms_slope(self) -> float:
        """Root mean square of the gradient in m/m; see the function `rms_slope`."""
        return rms_slope(self.heights, self.spacing)

    @property
    def fingerprint(self) -> str:
        """The text that identifies the heights in a digest.

        It is the recipe.  Without a recipe it is the SHA-256 of the bytes of the
        heights and of what else changes results, if it is given: the mask of filled
        heights, the spectrum that the theory takes, the errors of a treatment, and
        whether the heights are samples.
        """
        if self.recipe:
            return self.recipe
        digest = hashlib.sha256(self.heights.data)
        if self.filled is not None:
            digest.update(self.filled.data)
        if self.spectrum is not None:
            digest.update(repr(self.spectrum).encode())
        if self.treatment_errors:
            digest.update(repr(sorted(self.treatment_errors.items())).encode())
        if not self.sampled:
            digest.update(b"not sampled")
        return digest.hexdigest()


class YieldCurve(NamedTuple):
    """The yield stress of a J2 metal over its accumulated plastic strain.

    It is linear between points, and beyond the last one.

    Attributes:
        strains: (n,) plastic strains of the points, dimensionless, ascending from 0.
        stresses: (n,) yield stresses at the points, in Pa.
        last_slope: slope of the yield stress beyond the last point, in Pa; 0 if it
            stays as it is there.
    """

    strains: tuple[float, ...]
    stresses: tuple[float, ...]
    last_slope: float


@dataclass(frozen=True)
class HardeningLaw:
    """A law by which the yield stress of a J2 metal grows with its plastic strain.

    All methods know a law by its yield curve alone.  Its parameters are the value of a
    field of `Material`, whose name is that of the law in `HARDENING_LAWS`.

    Attributes:
        meaning: what the parameters are.
        unit: unit of the parameters; "" if they are no single number.
        check: takes what the user gave and returns the parameters, which are false (0
            or empty) if the metal does not have this law; raises InvalidScene if they
            are not valid.
        curve: takes the yield stress without plastic strain, in Pa, and parameters that
            are not false, and returns the yield curve; raises InvalidScene if the
            parameters do not fit the yield stress.
        describe: takes the parameters and returns them as one number, or in words with
            their units.
    """

    meaning: str
    unit: str
    check: Callable[[Any], Any]
    curve: Callable[[float, Any], YieldCurve]
    describe: Callable[[Any], float | str]

    def text(self, parameters: Any) -> str:
        """Return the parameters of the law as text, with their units."""
        described = self.describe(parameters)
        if isinstance(described, str):
            return described
        return f"{described:.4g} {self.unit}"


def _checked_modulus(given: Any) -> float:
    """Return a modulus of linear hardening in Pa; 0 is no hardening.

    Raises InvalidScene if it is not a number, negative or infinite.
    """
    return number(
        "hardening_modulus",
        given,
        "0 or positive, in Pa",
        lambda modulus: 0 <= modulus < math.inf,
    )


def _linear_curve(yield_stress: float, modulus: float) -> YieldCurve:
    """Return the yield curve of linear hardening; both arguments are in Pa."""
    return YieldCurve((0.0,), (yield_stress,), modulus)


def _checked_curve(given: Any) -> tuple[tuple[float, float], ...]:
    """Return a hardening curve as a tuple of points (plastic strain, stress in Pa).

    Args:
        given: a sequence of such pairs; empty: there is no curve.

    Raises:
        InvalidScene: There is a single point, or an entry is not a pair of numbers, or
            the strains do not increase, or a stress is not positive or decreases.
    """
    try:
        curve = tuple((float(strain), float(stress)) for strain, stress in given)
    except (TypeError, ValueError):
        raise InvalidScene(
            f"hardening_curve is {given!r:.60}, but must be a list of pairs: plastic "
            "strain, yield stress in Pa"
        ) from None
    _require(len(curve) != 1, "hardening_curve has one point; give two or more")
    for point in curve:
        _require(
            all(math.isfinite(value) for value in point) and point[1] > 0,
            f"hardening_curve has the point {list(point)}; give finite strains and "
            "positive stresses in Pa",
        )
    for before, after in itertools.pairwise(curve):
        _require(
            before[0] < after[0] and before[1] <= after[1],
            f"hardening_curve goes from {list(before)} to {list(after)}, but plastic "
            "strains must increase, and stresses must not decrease",
        )
    return curve


def _tabulated_curve(
    yield_stress: float, points: tuple[tuple[float, float], ...]
) -> YieldCurve:
    """Return the yield curve of a table, whose last stress stays.

    Args:
        yield_stress: in Pa.
        points: pairs of plastic strain and yield stress in Pa.

    Raises:
        InvalidScene: The first point is not the plastic strain 0 and the yield stress.
    """
    _require(
        points[0] == (0.0, yield_stress),
        f"hardening_curve must begin at [0, {yield_stress:g}], a plastic strain of 0 "
        "and the yield_stress",
    )
    strains = tuple(strain for strain, _ in points)
    stresses = tuple(stress for _, stress in points)
    return YieldCurve(strains, stresses, 0.0)


def _describe_points(points: tuple[tuple[float, float], ...]) -> str:
    """Return the points (plastic strain, stress in Pa) of a curve in words."""
    return ", ".join(f"{stress:g} Pa at {strain:g}" for strain, stress in points)


#: The hardening laws by the names of their parameters, which are fields of `Material`
#: and keys of the table [material] of a case.
HARDENING_LAWS: Mapping[str, HardeningLaw] = {
    "hardening_modulus": HardeningLaw(
        "slope of the yield stress over the plastic strain",
        "Pa",
        _checked_modulus,
        _linear_curve,
        float,
    ),
    "hardening_curve": HardeningLaw(
        "yield stress by plastic strain",
        "",
        _checked_curve,
        _tabulated_curve,
        _describe_points,
    ),
}


@dataclass(frozen=True)
class Material:
    """The elastoplastic solid.  The counterface is rigid.

    The ratio of hardness to yield stress is a result of the methods, not an input.

    Raises:
        InvalidScene: A value is out of its range.
    """

    young_modulus: float  #: Young's modulus E, in Pa.
    poisson_ratio: float  #: Poisson's ratio nu, between -1 and 0.5.
    #: The contact pressure sigma_P at which it flows, in Pa; infinite if it does not.
    hardness: float = math.inf
    #: The yield stress sigma_Y of J2 flow, in Pa; infinite if it does not flow.
    yield_stress: float = math.inf
    #: The slope H of the yield stress over the plastic strain in J2 flow, in Pa.
    hardening_modulus: float = 0.0
    #: Instead of H, points (plastic strain, yield stress in Pa) of J2 flow.  The first
    #: one is (0, yield_stress); the stress is linear between them, and constant beyond
    #: the last one.
    hardening_curve: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        """Turn the values into floats; raise InvalidScene if one is out of range."""
        expected = "a number between -1 and 0.5, both excluded"
        ratio = number(
            "poisson_ratio", self.poisson_ratio, expected, lambda nu: -1 < nu < 0.5
        )
        modulus = positive("young_modulus", self.young_modulus, "Pa")
        hardness = positive("hardness", self.hardness, "Pa", finite=False)
        stress = positive("yield_stress", self.yield_stress, "Pa", finite=False)
        set_frozen(self, poisson_ratio=ratio, young_modulus=modulus)
        set_frozen(self, hardness=hardness, yield_stress=stress)
        for name, law in HARDENING_LAWS.items():
            set_frozen(self, **{name: law.check(getattr(self, name))})
        names = list(self.hardening)
        _require(
            len(names) <= 1,
            f"{' and '.join(names)} are two hardening laws; give one",
        )
        _require(
            not names or stress < math.inf,
            "hardening needs the yield_stress at which it begins; give it in Pa",
        )
        _ = self.yield_curve  # it raises InvalidScene if the law does not fit

    @property
    def hardening(self) -> dict[str, HardeningLaw]:
        """The hardening law of the metal by its name; empty if it does not harden."""
        laws = HARDENING_LAWS.items()
        return {name: law for name, law in laws if getattr(self, name)}

    @property
    def yield_curve(self) -> YieldCurve:
        """The yield stress of J2 flow over the accumulated plastic strain."""
        if not self.hardening:
            return YieldCurve((0.0,), (self.yield_stress,), 0.0)
        [(name, law)] = self.hardening.items()
        return law.curve(self.yield_stress, getattr(self, name))


@dataclass(frozen=True)
class Body:
    """The body under the surface: a half-space, or a layer on a rigid base.

    A bonded layer is fixed to the base, and a sliding one moves on it without friction.

    Raises:
        InvalidScene: The kind is unknown, or the depth does not fit the kind.
    """

    kind: BodyKind = "half_space"  #: One of the words of `BodyKind`.
    depth: float = math.inf  #: Depth of a layer in m; infinite for a half-space.

    def __post_init__(self) -> None:
        """Check the fields; raise InvalidScene if the depth does not fit the kind."""
        require_one_of("body kind", self.kind, BodyKind)
        if self.kind == "half_space":
            expected = "left out, as a half_space takes no depth"
            number("depth", self.depth, expected, math.isinf)
        else:
            set_frozen(self, depth=positive("depth", self.depth, "m"))


@dataclass(frozen=True)
class Load:
    """The mean pressure, or a path of mean pressures in order.

    A mean pressure is force over nominal area.  After the first pressure, a path may
    unload to zero.

    Raises:
        InvalidScene: A pressure is not a positive number, or the path is empty.
    """

    mean_pressure: float | tuple[float, ...]  #: In Pa; a tuple once it is checked.

    def __post_init__(self) -> None:
        """Turn the pressures into a tuple; raise InvalidScene if one is not valid."""
        given = as_tuple(self.mean_pressure)
        message = "mean_pressure is an empty path; give at least one pressure"
        _require(len(given) > 0, message)
        first = positive("mean_pressure", given[0], "Pa")
        path = (first, *(_later_pressure(pressure) for pressure in given[1:]))
        set_frozen(self, mean_pressure=path)

    @property
    def path(self) -> tuple[float, ...]:
        """The mean pressures in order, in Pa; a single one is a path of length one."""
        return as_tuple(self.mean_pressure)

    @property
    def final(self) -> float:
        """The last mean pressure of the path, in Pa."""
        return self.path[-1]

    @property
    def non_decreasing(self) -> bool:
        """True if no mean pressure of the path is below the one before it."""
        return all(a <= b for a, b in itertools.pairwise(self.path))


def _later_pressure(given: Any) -> float:
    """Return a mean pressure (Pa) that is not the first of a path, as a float.

    given: what the user gave.  Raises InvalidScene if it is no positive number and not
    0, or not between SMALLEST and LARGEST.
    """
    expected = "a positive number in Pa, or 0 after the first"
    pressure = number("mean_pressure", given, expected, lambda p: p >= 0)
    if pressure == 0:
        return pressure
    return positive("mean_pressure", pressure, "Pa")


@dataclass(frozen=True)
class Scene:
    """One contact problem.  A method is a function from a scene to a `ContactResult`.

    Raises:
        InvalidScene: A mean pressure reaches the hardness, so that no contact can carry
            the load, or an argument is not an instance of its class.

    Example:
        >>> wave = np.cos(np.linspace(0, 2 * np.pi, 64, endpoint=False))
        >>> surface = Surface(1e-3 * wave, periods=(1.0,))
        >>> material = Material(young_modulus=100.0, poisson_ratio=0.3)
        >>> Scene(surface, material, Load(mean_pressure=1.0)).load.final
        1.0
    """

    surface: Surface  #: The heights of the rough body.
    material: Material  #: The solid of the rough body.
    load: Load  #: The mean pressures, in order.
    body: Body = field(default_factory=Body)  #: What is under the surface.

    def __post_init__(self) -> None:
        """Check the types, and that the load is below the hardness.

        Raises InvalidScene otherwise.
        """
        require_kind("surface", self.surface, Surface)
        require_kind("material", self.material, Material)
        require_kind("load", self.load, Load)
        require_kind("body", self.body, Body)
        check_load(self.material, self.load)

    def _repr_html_(self) -> str:
        """Return a table of the scene as HTML, which a notebook shows.

        What the body has not, such as a hardness or hardening, is left out.
        """
        texts = self.surface._description
        material = self.material
        texts["poisson ratio"] = f"{material.poisson_ratio:.4g}"
        for name in ("young_modulus", "hardness", "yield_stress"):
            value = getattr(material, name)
            if value < math.inf:
                texts[name.replace("_", " ")] = f"{value:.4g} Pa"
        for name, law in material.hardening.items():
            texts[name.replace("_", " ")] = law.text(getattr(material, name))
        texts["body"] = self.body.kind.replace("_", " ")
        if self.body.kind != "half_space":
            texts["body"] += f", {self.body.depth:.4g} m deep"
        pressures = ", ".join(f"{pressure:.4g}" for pressure in self.load.path)
        texts["mean pressure"] = f"{pressures} Pa"
        return _html_table(texts)

    @property
    def digest(self) -> str:
        """The name of the scene in results: `scene_digest` of everything it holds."""
        surface = self.surface
        return scene_digest(
            surface.fingerprint,
            surface.shape,
            surface.periods,
            self.material,
            self.body,
            self.load,
        )


def _html_table(texts: Mapping[str, str]) -> str:
    """Return names and texts as the rows of an HTML table."""
    rows = [
        f"<tr><th>{html.escape(name)}</th><td>{html.escape(text)}</td></tr>"
        for name, text in texts.items()
    ]
    return f"<table>{''.join(rows)}</table>"


def scene_digest(
    fingerprint: str,
    shape: tuple[int, ...],
    periods: tuple[float, ...],
    material: Material,
    body: Body,
    load: Load,
) -> str:
    """Return the SHA-256 of everything that a scene holds, as hexadecimal digits.

    A recipe (the instructions for a generated surface) gives the first three arguments
    before any heights exist.

    fingerprint: text that identifies the heights, see `Surface.fingerprint`; shape: of
    the heights; periods: lengths in m after which the heights repeat; material, body,
    load: of the scene.
    """
    content: dict[str, Any] = {
        "surface": fingerprint,
        "shape": list(shape),
        "periods": [repr(float(period)) for period in periods],
    }
    for part in (material, body, load):
        values = asdict(part)
        if part is material:
            # A law that is added later changes no digest of a metal without it.
            for name in HARDENING_LAWS.keys() - material.hardening.keys():
                del values[name]
        content[type(part).__name__] = {
            name: repr(value) for name, value in values.items()
        }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


#: Largest mean pressure over Young's modulus.  The roughness changes the pressure by
#: about the modulus times the rms slope, which the rounding of much larger pressures
#: hides: on a slope of 0.02 gaps are 5e-13 of the rms height in error for each modulus
#: of mean pressure, and gates on them allow 1e-7.
LARGEST_LOAD = 1e3


def check_load(material: Material, load: Load) -> None:
    """Raise InvalidScene if a mean pressure of the load is too large for the material.

    It must be below the hardness, because no contact can carry more, and at most
    LARGEST_LOAD times Young's modulus.

    Args:
        material: its hardness, in Pa, may be infinite.
        load: the mean pressures, in Pa.
    """
    largest = max(load.path)
    modulus = material.young_modulus
    _require(
        largest <= LARGEST_LOAD * modulus,
        f"mean_pressure is {largest:g} Pa, but must be at most {LARGEST_LOAD:g} times "
        f"the young_modulus of {modulus:g} Pa; check the units of both",
    )
    _require(
        largest < material.hardness,
        f"mean_pressure is {largest:g} Pa, but must stay below the hardness of "
        f"{material.hardness:g} Pa",
    )


def check_loading(material: Material, load: Load) -> None:
    """Check a load path for a method that cannot follow plastic flow on unloading.

    Raises:
        InvalidScene: The path unloads a material of finite hardness, or falls to 0.
    """
    _require(
        load.non_decreasing or material.hardness == math.inf,
        "mean_pressure decreases along the path, but this method keeps no memory of "
        "the plastic flow; give a non-decreasing path, an infinite hardness or the "
        "method bem or fem",
    )
    _require(
        min(load.path) > 0,
        "mean_pressure falls to 0 along the path, but this method needs a load; end "
        "the path above 0 or give the method bem or fem",
    )


# --- heights --------------------------------------------------------------------------


#: Points of a block of rows: half a megabyte of float64 numbers.
_BLOCK_POINTS = 1 << 16


def rms_slope(heights: FloatArray, spacing: tuple[float, ...]) -> float:
    """Return the root mean square of the gradient in m/m, by differences of neighbours.

    Args:
        heights: (nx, ny) or (nx,), in m.
        spacing: distance of neighbouring points along each direction, in m.
    """
    total = 0.0
    # Blocks of rows stay in the cache of a core; new memory for all of the differences
    # would take several times as long as they do.
    rows = max(1, _BLOCK_POINTS * len(heights) // heights.size)
    for axis, step in enumerate(spacing):
        squares = 0.0
        count = 0
        for start in range(0, len(heights), rows):
            stop = start + rows
            if axis == 0:
                stop += 1  # the last row's neighbour
            differences = np.diff(heights[start:stop], axis=axis).ravel()
            squares += float(np.einsum("i,i->", differences, differences))
            count += differences.size
        total += squares / count / step**2
    return math.sqrt(total)


def checked_heights(given: ArrayLike, where: str) -> NDArray[Any]:
    """Return heights as an array of real numbers on a line or a grid.

    Masked heights become NaN.  Other heights keep their type of number.

    Args:
        given: the heights, (nx, ny) or (nx,).
        where: the name of the argument or file, with which a message begins.

    Raises:
        InvalidScene: They are not such an array of two points or more a direction.
    """
    try:
        heights = np.asanyarray(given)
    except ValueError:
        message = f"{where}: rows of unequal length are no grid of heights"
        raise InvalidScene(message) from None
    if np.ma.is_masked(heights):
        heights = np.ma.filled(heights.astype(np.float64), np.nan)
    kind = "complex" if heights.dtype.kind == "c" else heights.dtype
    _require(
        heights.dtype.kind in "buif",
        f"{where}: holds {kind} values, but heights are real numbers",
    )
    _require(
        heights.ndim in (1, 2) and min(heights.shape) >= 2,
        f"{where}: has shape {heights.shape}, but heights are a line (nx,) or a grid "
        "(nx, ny) of at least two points a direction",
    )
    return heights


def require_usable(heights: NDArray[Any], where: str, missing: str = "refuse") -> None:
    """Check that heights are numbers of a possible size.

    Args:
        heights: (nx, ny) or (nx,), NaN where a height is missing.
        where: the name of the argument or file, with which a message begins.
        missing: "refuse" if no height may be missing, else how they will be filled.

    Raises:
        InvalidScene: Heights are infinite, all are missing, some are missing and not to
            be filled, or their size suggests a wrong unit.
    """
    low = float(heights.min())  # NaN if any height is: needs no temporary array
    high = float(heights.max())
    if not (math.isfinite(low) and math.isfinite(high)):
        infinite = int(np.count_nonzero(np.isinf(heights)))
        count = f"{infinite} of {heights.size} heights are infinite"
        _require(infinite == 0, f"{where}: {count}; mark missing ones by NaN")
        absent = int(np.count_nonzero(np.isnan(heights)))
        count = f"{where}: {absent} of {heights.size} heights are NaN or masked"
        _require(absent < heights.size, count)
        _require(
            missing != "refuse",
            f"{count}; crop them, or let them be filled: set missing to "
            '"harmonic" or "nearest"',
        )
        low = float(np.nanmin(heights))
        high = float(np.nanmax(heights))
    span = high - low
    largest = max(abs(low), abs(high))
    _require(
        largest <= LARGEST, f"{where}: heights reach {largest:.3g} m; check their unit"
    )
    _require(
        span == 0 or span >= SMALLEST,
        f"{where}: heights span {span:.3g} m, less than {SMALLEST:g} m; check their "
        "unit",
    )


def _checked_mask(given: Any, shape: tuple[int, ...]) -> NDArray[np.bool_] | None:
    """Return the mask of filled heights, read-only; None if it marks no point.

    given: the mask of the user, or None; shape: that of the heights.  Raises
    InvalidScene if the mask is not an array of booleans of this shape.
    """
    if given is None:
        return None
    mask = np.ascontiguousarray(given)
    _require(
        mask.dtype == np.bool_ and mask.shape == shape,
        f"filled is an array of {mask.dtype} of shape {mask.shape}, but must be a mask "
        f"of true and false of the shape of the heights, {shape}",
    )
    return _read_only(mask) if mask.any() else None


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return the array itself if nobody can write to it, otherwise a read-only copy."""
    if array.flags.writeable or array.base is not None:
        array = array.copy()
        array.flags.writeable = False
    return array


# --- warnings about heights -----------------------------------------------------------


def levels_note(kind: np.dtype[Any]) -> tuple[str, ...]:
    """Return a warning for heights that are booleans or integers of 8 bits.

    Such heights have as few levels as a picture.  The tuple holds one sentence for
    them, and none for other types of numbers.

    kind: type of the heights.
    """
    if kind.kind not in "bui" or kind.itemsize > 1:
        return ()
    levels = "true and false" if kind.kind == "b" else "whole numbers of 8 bits"
    return (
        f"the heights are {levels}, as in a picture: the contact sees their steps, and "
        "their unit must be that of one level",
    )


def _suspicions(surface: Surface) -> list[str]:
    """Return warnings about a surface that is probably not what its user means.

    There is one sentence each for a large rms slope, for heights in steps and for
    oblong cells.
    """
    slope = (surface.spectrum or surface).rms_slope
    sentences = []
    if slope > 1:
        sentences.append(
            f"the rms slope is {slope:.3g}, beyond the small slopes that the methods "
            "assume; check that heights and periods are in m"
        )
    change = slope * min(surface.spacing)
    step = _quantisation_step(surface.heights, change)
    if step > 0:
        if step <= change / 40:  # by `tests/laboratory/area_bank.py`
            scope = "for the smooth surface that was rounded, but not for its steps"
        elif step < 1.1 * change:
            scope = "neither for these steps nor for a smooth surface: smooth the "
            scope += "heights or refine the grid"
        else:
            scope = "for these steps, but not for a smooth surface that was rounded"
        sentences.append(
            f"the heights are in steps of {step:.3g} m, as a map of few bits is: "
            f"error estimates of areas are valid {scope}"
        )
    ratio = max(surface.spacing) / min(surface.spacing)
    if ratio > 2 * (1 + 1e-9):
        sentences.append(
            f"the grid's cells are {ratio:.3g} times as long as wide: corrected areas "
            "and their error estimates are valid up to 2; take points at similar "
            "distances in both directions"
        )
    return sentences


def _quantisation_step(heights: FloatArray, change: float) -> float:
    """Return the step of which all heights are multiples, in m; 0 if there is none.

    The heights must also bend at most points, or at every point where they change, as
    rounded heights do; smooth heights that happen to be multiples do not.  A corner of
    100 x 100 points of the grid is enough to see it.

    Args:
        heights: (nx, ny) or (nx,), in m.
        change: rms change of the height from one point to the next, in m.  Steps below
            a hundredth of it count as 0, because error estimates of areas allow for
            them.
    """
    corner = heights[tuple(slice(100) for _ in heights.shape)]
    levels = np.unique(corner)
    if levels.size < 3 or corner.size < 16:
        return 0.0
    step = float(np.diff(levels).min())
    if step < change / 100:
        return 0.0
    multiples = (levels - levels[0]) / step
    if np.max(np.abs(multiples - np.round(multiples))) > 1e-3:
        return 0.0
    rising = []
    bending = []
    for axis, points in enumerate(corner.shape):
        if points > 2:
            rise = np.diff(corner, 1, axis)
            bend = np.diff(corner, 2, axis)
            bend -= np.median(bend)  # a parabola bends alike everywhere
            rising.append(np.mean(abs(rise) > step / 2))
            bending.append(np.mean(abs(bend) > step / 2))
    smooth = np.mean(bending) < min(np.mean(rising), 1 / 4)
    return 0.0 if smooth else step


#: Modules that create surfaces for others: not where a user's surface comes from.
_CREATORS = ("epcontact.scene", "epcontact.surfaces", "dataclasses")


def warn_user(notes: tuple[str, ...]) -> tuple[str, ...]:
    """Issue a SurfaceWarning for each note (a sentence), and return the notes.

    Python shows the line of the user's program that creates the surface.  There is no
    warning if the package itself creates the surface, whose notes are in the result.
    """
    level = 1
    while _module_at(level).startswith(_CREATORS):
        level += 1
    if not _module_at(level).startswith(("epcontact.", "fem_check.")):
        for note in notes:
            warnings.warn(note, SurfaceWarning, stacklevel=level + 1)
    return notes


def _module_at(level: int) -> str:
    """Return the name of the module `level` calls above the caller's function.

    Level 0 is the module of the caller; "" stands for code without a module.  Raises
    ValueError if there are fewer calls.
    """
    name: str = sys._getframe(level + 1).f_globals.get("__name__", "")
    return name


# --- inputs ---------------------------------------------------------------------------

#: Bounds of lengths, pressures and wave numbers in SI units.  Their products and
#: squares, which the methods form, neither overflow nor underflow between these bounds.
SMALLEST = 1e-40
LARGEST = 1e40


def _require(condition: bool, message: str) -> None:
    """Raise InvalidScene with the message if the condition is false."""
    if not condition:
        raise InvalidScene(message)


def number(
    name: str, given: Any, expected: str, accepts: Callable[[float], bool]
) -> float:
    """Return a real number of Python or numpy as a float.

    Every number that a user gives to the package goes through this function.

    Args:
        name: what the number is called in messages.
        given: what the user gave.
        expected: what the number must be, in words that end the message.
        accepts: whether a float is such a number; it is called with NaN for anything
            that is no real number.

    Raises:
        InvalidScene: `accepts` returns false.
    """
    plain = given
    if isinstance(given, np.generic | np.ndarray) and given.ndim == 0:
        plain = given.item()
    value = math.nan
    if not isinstance(plain, bool) and isinstance(plain, Real):
        with contextlib.suppress(OverflowError):  # an int of Python has no limit
            value = float(plain)
    _require(accepts(value), f"{name} is {plain!r:.60}, but must be {expected}")
    return value


def positive(name: str, given: Any, unit: str, *, finite: bool = True) -> float:
    """Return a positive number as a float.

    Args:
        name: what the number is called in messages.
        given: what the user gave.
        unit: its unit, for messages.
        finite: whether infinity raises an error; otherwise it is returned.

    Raises:
        InvalidScene: It is no such number, or not between SMALLEST and LARGEST.
    """
    expected = f"a positive number in {unit}"
    value = number(
        name, given, expected, lambda v: v > 0 and (v < math.inf or not finite)
    )
    _require(
        SMALLEST <= value <= LARGEST or value == math.inf,
        f"{name} is {value:g} {unit}, but must lie between {SMALLEST:g} and "
        f"{LARGEST:g}, where products neither overflow nor vanish",
    )
    return value


def fraction(name: str, given: Any) -> float:
    """Return a number between 0 and 1 as a float, such as a tolerance.

    name: what the number is called in messages; given: what the user gave.  Raises
    InvalidScene if it is not a number above 0 and below 1.
    """
    expected = "a number between 0 and 1, both excluded"
    return number(name, given, expected, lambda v: 0 < v < 1)


def integer(name: str, given: Any, least: int) -> int:
    """Return a whole number, such as 3 or 3.0, as an int.

    name: what the number is called in messages; given: what the user gave.  Raises
    InvalidScene if it is not a whole number, or below `least`.
    """
    expected = f"a whole number of at least {least}"
    number(name, given, expected, lambda v: v >= least and v.is_integer())
    return int(given)


def array(name: str, given: Any) -> FloatArray:
    """Return an array of 64-bit floats in the byte order of this machine.

    The array itself is returned if it is one already.  name: what the array is called
    in messages; given: what the user gave.  Raises InvalidScene if it does not hold
    real numbers.
    """
    with contextlib.suppress(TypeError, ValueError):
        values = np.asarray(given)
        if values.dtype.kind != "c":
            return values.astype(np.float64, copy=False)
    raise InvalidScene(f"{name} is {given!r:.60}, but must be an array of real numbers")


def as_tuple(given: Any) -> tuple[Any, ...]:
    """Return the items of a sequence as a tuple; a single value or text is one item."""
    if isinstance(given, str | bytes):
        return (given,)
    try:
        return tuple(given)
    except TypeError:
        return (given,)


def require_kind(name: str, given: Any, kind: type) -> None:
    """Raise InvalidScene if an input is not an instance of the class `kind`.

    name: what the input is called in the message; given: the input.
    """
    message = f"{name} is {given!r:.60}, but must be a {kind.__name__}"
    _require(isinstance(given, kind), message)


def require_one_of(name: str, given: Any, words: Any) -> None:
    """Raise InvalidScene if an input is not one of the words of a Literal type.

    name: what the input is called in the message; given: the input; words: the type,
    such as `BodyKind`.
    """
    choices = get_args(words)
    message = f"{name} is {given!r}, but must be one of {', '.join(choices)}"
    _require(given in choices, message)


def set_frozen(instance: Any, **values: Any) -> None:
    """Set fields of a frozen dataclass in place, for its `__post_init__`.

    instance: the dataclass; values: the new values by the names of the fields.
    """
    for name, value in values.items():
        object.__setattr__(instance, name, value)
