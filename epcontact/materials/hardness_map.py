"""The effective hardness of rough metals: which pressure cap stands for a body that
flows by J2.

`hardness_map.csv` holds the cap, in yield stresses, under which capped boundary
elements carry the load on the contact area of the J2 body;
`tests/laboratory/hardness_map.py` measured it, and its first lines say how.  A short
formula is fitted to it,

    c = hardness/sigma_Y = a - b/m - u (e - f nu - g m) - u^2 ln m (h - k nu),
    u = 1/(1 + s/8),   s = E* xi/sigma_Y,   m = p0/sigma_Y,

which is refused outside the map.  Where the contact is nearly full the cap follows the
load and not the material, so that the map ends at a contact area of 0.9.  Below its
lightest load the cap falls slowly, because the spots shrink as they become fewer, and
less so the more waves a surface has: the answer is between no fall and all of it.

The bodies of the map have four shortest waves in the longest, which is their period.
Of another breadth b, the roll-off's wavelength over the shortest, and of a large
surface the cap is

    c (1 + t (1 - u) ln(b/4) + w/m),

by spectra of their own (`tests/laboratory/breadth.py`).
"""

from __future__ import annotations

import csv
import functools
import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files

import numpy as np

from epcontact.errors import InvalidScene
from epcontact.materials.moduli import effective_modulus
from epcontact.results import FloatArray
from epcontact.scene import Material, positive

#: Largest contact area of the map.
FULL = 0.9
#: The lightest load p0/sigma_Y that is answered, and the most that the hardness falls
#: below the map's lightest for each factor e of the load: J2 bodies at 24 nodes a wave
#: fall by .044 to .070 (`tests.laboratory.light_loads`).
LIGHTEST, FALL = 0.003, 0.07
#: t and w of another breadth and of surfaces larger than the map's (half of the w at 6
#: nodes to the shortest wave is left at 12); the doubt of both; and what single spectra
#: differ by (95 %).
TREND, LARGE, DOUBT, SPECTRA = 0.04, 0.003, 0.5, 0.03
#: The breadths that were judged, that of the map, and the largest that an unknown one
#: may be; beyond the judged ones all of the trend is doubted.
BREADTHS, OF_THE_MAP, BROADEST = (2.0, 32.0), 4.0, 300.0
#: Parts of the error: names of columns of the map, each relative and at 95 %.
PARTS = ("statistical_error", "grid_error", "steps_error", "depth_error")
#: The coordinates of the map, with their symbols.
SYMBOLS = {"severity": "E*ξ/σ_Y", "poisson_ratio": "nu", "load": "p0/σ_Y"}


@dataclass(frozen=True)
class MappedHardness:
    """A hardness from the map.

    Attributes:
        value: the hardness in Pa.
        interval: its 95 % interval in Pa; the upper end is infinite where asperities
            are so nearly elastic that any larger cap would do.
        ratio: c = hardness/sigma_Y.
        severity: s = E* xi/sigma_Y.
        poisson_ratio: nu.
        load: m = p0/sigma_Y.
        area: raw contact area of the map's J2 bodies, of six nodes to the shortest
            wave; it is larger than in the limit of fine grids, which `value` is for.
        errors: relative parts of the error: statistical_error (the surfaces of the map
            are few), grid_error, steps_error (of the load paths), depth_error (of the
            bodies), formula_error (what the formula misses), breadth_error (what the
            breadth of the spectrum changes) and, below the loads of the map,
            light_error.
    """

    value: float
    interval: tuple[float, float]
    ratio: float
    severity: float
    poisson_ratio: float
    load: float
    area: float
    errors: Mapping[str, float]

    @property
    def error(self) -> float:
        """The relative error, from all parts."""
        return math.hypot(*self.errors.values())

    @property
    def rests_on(self) -> str:
        """Say in sentences what the hardness rests on."""
        known, reach = hardness_map(), _reach("{low:g} to {high:g} in {symbol}")
        places, surfaces = (known["area"] <= FULL).sum(), known["surfaces"]
        return (
            f"by the formula fitted to {places} places of the map {map_digest()}, {reach}, each of "
            f"{surfaces.min():g} to {surfaces.max():g} self-affine surfaces, solved by finite "
            "elements with perfectly plastic J2 flow"
        )

    def __str__(self) -> str:
        low, high = self.interval
        parts = ", ".join(
            f"{name.removesuffix('_error')} {100 * part:.1f} %"
            for name, part in self.errors.items()
        )
        return (
            f"hardness = {self.value:.3g} Pa, 95 % interval {low:.3g} to {high:.3g} Pa "
            f"({self.ratio:.2f} yield stresses, error {100 * self.error:.1f} %: {parts})\n"
            f"at E*ξ/σ_Y = {self.severity:.3g}, p0/σ_Y = {self.load:.3g}, nu = "
            f"{self.poisson_ratio:.3g}, where the J2 bodies behind this hardness touch on "
            f"{100 * self.area:.3g} % of their nodes (raw area)"
        )


def effective_hardness(
    *,
    yield_stress: float,
    young_modulus: float,
    poisson_ratio: float,
    rms_slope: float,
    mean_pressure: float,
    breadth: float | None = None,
) -> MappedHardness:
    """Return the pressure cap that stands for a rough body of perfectly plastic J2
    metal.

    Under this cap boundary elements carry the load on the contact area of the J2 body.
    By similarity it depends on E* xi/sigma_Y, p0/sigma_Y, nu and, a little, on the
    breadth of the spectrum.  It is the mean of large surfaces; Hurst exponents of .4 to
    .8 make no difference.

    Args:
        yield_stress: sigma_Y in Pa, without hardening.
        young_modulus: E in Pa.
        poisson_ratio: nu.
        rms_slope: xi of the whole roughness.
        mean_pressure: p0 in Pa, the force over the nominal area.
        breadth: wavelength of the roll-off over the shortest in the slope; None: any
            from 2 to 300, for which the interval is wider.  It was judged from 2 to 32.

    Raises:
        InvalidScene: if a value is no number, the scene is outside the map, or its
            contact is too full for a hardness.

    Example:
        >>> found = effective_hardness(yield_stress=1e9, young_modulus=210e9, poisson_ratio=0.3,
        ...                            rms_slope=0.1, mean_pressure=0.25e9, breadth=16)
        >>> 2.6 < found.ratio < 2.9, found.interval[0] < found.value < found.interval[1]
        (True, True)
    """
    material = Material(young_modulus, poisson_ratio)
    yield_stress = positive("yield_stress", yield_stress, "Pa")
    rms_slope = positive("rms_slope", rms_slope, "m/m")
    mean_pressure = positive("mean_pressure", mean_pressure, "Pa")
    severity = effective_modulus(material) * rms_slope / yield_stress
    shift, doubt = by_breadth(breadth, severity, mean_pressure / yield_stress)
    at = (severity, material.poisson_ratio, mean_pressure / yield_stress)
    place, known = dict(zip(SYMBOLS, at, strict=True)), hardness_map()
    for name, value in place.items():
        low, high = known[name].min(), known[name].max()
        low = LIGHTEST if name == "load" else low
        if not low * (1 - 1e-9) <= value <= high * (1 + 1e-9):
            raise InvalidScene(
                f"{SYMBOLS[name]} is {value:.4g}, but the map of the effective hardness reaches "
                f"from {low:g} to {high:g}, and it is not extrapolated"
            )
    lighter = min(at[-1] / known["load"].min(), 1.0)
    place["load"] /= lighter
    area = lighter * _between(place, known["area"])
    if area > FULL:
        raise InvalidScene(
            f"the J2 body touches on {area:.2f} of the area at p0/σ_Y = {place['load']:.3g}; above "
            f"{FULL:g} the cap follows the load and not the material, so that no hardness stands "
            "for it"
        )
    half = -FALL * math.log(lighter) / 2
    ratio = (
        (1 - half)
        * (1 + shift)
        * float(fitted_ratio(*(np.array([value]) for value in place.values()))[0])
    )
    errors = {part: _between(place, known[part]) for part in PARTS} | {
        "formula_error": formula()[1],
        "breadth_error": doubt,
    }
    errors |= {"light_error": half / (1 - half)} if half else {}
    error, value = math.hypot(*errors.values()), ratio * yield_stress
    interval = (value / (1 + error), value / (1 - error) if error < 1 else math.inf)
    return MappedHardness(value, interval, ratio, *at, area, errors)


def by_breadth(
    breadth: float | None, severity: float, load: float
) -> tuple[float, float]:
    """The relative change of the map's hardness by a breadth, and its error at 95 %."""
    if breadth is not None and positive("breadth", breadth, "–") < BREADTHS[0] * (
        1 - 1e-9
    ):
        raise InvalidScene(
            f"breadth is {breadth:.4g}, but the effective hardness is known for at least "
            f"{BREADTHS[0]:g}, and for any if it is not given"
        )
    ends = (BREADTHS[0], BROADEST) if breadth is None else (breadth, breadth)
    rise, large = TREND * severity / (8 + severity), LARGE / max(load, 0.1)
    low, high = (rise * math.log(end / OF_THE_MAP) for end in ends)
    beyond, trend = rise * math.log(max(ends[1] / BREADTHS[1], 1.0)), (low + high) / 2
    return trend + large, math.hypot(
        DOUBT * (abs(trend) + large), beyond, SPECTRA, high - trend
    )


_TEXT = (files("epcontact.materials") / "hardness_map.csv").read_text(encoding="utf-8")


@functools.cache
def hardness_map() -> Mapping[str, FloatArray]:
    """The columns of `hardness_map.csv`, one value for each place of the map: SYMBOLS,
    surfaces, area, inverse_hardness (sigma_Y/hardness), scatter (its relative error by
    the surfaces of the place alone), and the relative errors PARTS, of which the
    statistical one is the formula's.
    """
    header, *rows = csv.reader(
        line for line in _TEXT.splitlines() if not line.startswith("#")
    )
    return dict(zip(header, np.array(rows, dtype=np.float64).T, strict=True))


def map_digest() -> str:
    """The first 12 digits of the SHA-256 of `hardness_map.csv`, with which values
    change.
    """
    return hashlib.sha256(_TEXT.encode()).hexdigest()[:12]


def fitted_ratio(
    severity: FloatArray, poisson_ratio: FloatArray, load: FloatArray
) -> FloatArray:
    """hardness/sigma_Y by the formula, which the caller must not leave the map with."""
    return terms(severity, poisson_ratio, load) @ formula()[0]


@functools.cache
def formula() -> tuple[FloatArray, float]:
    """The coefficients of the formula for the kept map, and its error; see `fit`."""
    return fit(hardness_map())


def fit(known: Mapping[str, FloatArray]) -> tuple[FloatArray, float]:
    """Fit the formula to a map's columns but its nearly full places, each with the
    weight of its scatter.  Returns the coefficients of `terms`, and twice the rms of
    the relative residuals, less what the scatter explains.
    """
    inside = (known["area"] <= FULL) & (known["inverse_hardness"] > 0)
    scatter, inverse = known["scatter"][inside], known["inverse_hardness"][inside]
    # Relative residuals: each row is divided by its hardness, 1/inverse.
    scaled = terms(*(known[name][inside] for name in SYMBOLS)) * inverse[:, None]
    # Beyond 2 % the places differ by what the formula misses, not by their scatter.
    weight = 1 / np.hypot(scatter, 0.02)
    found, *_ = np.linalg.lstsq(scaled * weight[:, None], weight, rcond=None)
    missed = np.average(
        (scaled @ found - 1) ** 2 - (scatter / 2) ** 2, weights=weight**2
    )
    return np.asarray(found), 2 * math.sqrt(max(missed, 0.0))


def terms(
    severity: FloatArray, poisson_ratio: FloatArray, load: FloatArray
) -> FloatArray:
    """The terms of the formula at places, one row each."""
    u, nu = 1 / (1 + severity / 8), poisson_ratio
    bent = u**2 * np.log(load)
    return np.column_stack(
        [np.ones_like(u), -1 / load, -u, u * nu, u * load, -bent, bent * nu]
    )


def _between(place: Mapping[str, float], values: FloatArray) -> float:
    """Interpolate a column of the map linearly in ln s, nu and m, one axis after the
    other, as scipy.interpolate would take longer to load than all else here.
    """
    known = hardness_map()
    axes = [np.unique(known[name]) for name in place]
    order = np.lexsort([known[name] for name in reversed(list(place))])
    grid = values[order].reshape([axis.size for axis in axes])
    for name, value, axis in zip(place, place.values(), axes, strict=True):
        at, known_at = (
            (np.log(value), np.log(axis)) if name == "severity" else (value, axis)
        )
        grid = np.apply_along_axis(functools.partial(np.interp, at, known_at), 0, grid)
    return float(grid)


def formula_text() -> str:
    """The formula with its figures, its residual and its range, in words."""
    a, b, e, f, g, h, k = formula()[0]
    return (
        f"c = {a:.3f} {-b:+.4f}/m - ({e:.3f} {-f:+.3f} nu {-g:+.3f} m) u - u² ln m ({h:.3f} "
        f"{-k:+.3f} nu), u = 1/(1 + s/8), s = E* xi/sigma_Y, m = p0/sigma_Y, for "
        f"{_reach('{symbol} = {low:g} to {high:g}')}; it misses {100 * formula()[1]:.1f} % "
        "(twice the rms beyond the scatter of the map's places)"
    )


def _reach(form: str) -> str:
    """The reach of the map in each of its coordinates."""
    ends = [(symbol, hardness_map()[name]) for name, symbol in SYMBOLS.items()]
    return ", ".join(
        form.format(symbol=s, low=known.min(), high=known.max()) for s, known in ends
    )
