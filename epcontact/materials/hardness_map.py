"""The effective hardness of rough metals: the pressure cap that represents J2 flow.

`hardness_map.csv` holds the cap, in yield stresses, under which capped boundary
elements carry the load on the contact area of the J2 body.
`tests/laboratory/hardness_map.py` measured it, and the first lines of the file say how.
This formula is fitted to it:

    c = hardness/sigma_Y = a - b/m - u (e - f nu - g m) - u^2 ln m (h - k nu),
    u = 1/(1 + s/8),   s = E* xi/sigma_Y,   m = p0/sigma_Y.

The formula is refused outside the map.  Where the contact is nearly full, the cap
follows the load and not the material; the map therefore ends at a contact area of 0.9.
Below the lightest load of the map the cap falls slowly, because the spots shrink as
they become fewer.  It falls less the more waves a surface has; the result is in the
middle between no fall and the steepest.

The bodies of the map have four shortest waves in the longest, which is their period.
For another breadth b of the spectrum (wavelength of the roll-off over the shortest),
and for a large surface, the cap is

    c (1 + t (1 - u) ln(b/4) + w/m),

by ensembles of other spectra (`tests/laboratory/breadth.py`).
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

#: The largest contact area of a place of the map to which the formula is fitted.
LARGEST_AREA = 0.9
#: The lightest load p0/sigma_Y that is answered.
LIGHTEST_LOAD = 0.003
#: The largest relative fall of the hardness below the lightest load of the map, for
#: each factor e of the load.  J2 bodies at 24 nodes a wave fall by 0.044 to 0.070
#: (`tests.laboratory.light_loads`).
STEEPEST_FALL = 0.07
#: The coefficient t of the breadth.
BREADTH_TREND = 0.04
#: The coefficient w of surfaces larger than those of the map.  Half of the w at 6 nodes
#: to the shortest wave is left at 12.
SIZE_EFFECT = 0.003
#: Relative error of the corrections by breadth and by size, at 95 %.
CORRECTION_ERROR = 0.5
#: Relative difference between single spectra, at 95 %.
SPECTRA_ERROR = 0.03
#: The breadths that ensembles tested; beyond them all of the trend counts as error.
TESTED_BREADTHS = (2.0, 32.0)
#: The breadth of the bodies of the map.
MAP_BREADTH = 4.0
#: The largest breadth of a surface whose breadth is not given.
LARGEST_BREADTH = 300.0
#: Columns of the map that are relative errors, at 95 %.
ERROR_COLUMNS = ("statistical_error", "grid_error", "steps_error", "depth_error")
#: Columns of the map that are its coordinates, with their symbols.
COORDINATES = {"severity": "E*ξ/σ_Y", "poisson_ratio": "nu", "load": "p0/σ_Y"}


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
            bodies), formula_error (residual of the formula), breadth_error (of the
            breadth of the spectrum) and, below the loads of the map, light_error.
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
    def source(self) -> str:
        """The data behind the hardness, in words that follow a value in a report."""
        columns = hardness_map()
        places = np.count_nonzero(columns["area"] <= LARGEST_AREA)
        surfaces = columns["surfaces"]
        return (
            f"by the formula fitted to {places} places of the map {map_digest()}, "
            f"{_range_words('{low:g} to {high:g} in {symbol}')}, each of "
            f"{surfaces.min():g} to {surfaces.max():g} self-affine surfaces, solved by "
            "finite elements with perfectly plastic J2 flow"
        )

    def __str__(self) -> str:
        """Return the hardness with its interval and errors in two lines for a user."""
        low, high = self.interval
        parts = ", ".join(
            f"{name.removesuffix('_error')} {100 * part:.1f} %"
            for name, part in self.errors.items()
        )
        return (
            f"hardness = {self.value:.3g} Pa, 95 % interval {low:.3g} to {high:.3g} Pa "
            f"({self.ratio:.2f} yield stresses, error {100 * self.error:.1f} %: "
            f"{parts})\n"
            f"at E*ξ/σ_Y = {self.severity:.3g}, p0/σ_Y = {self.load:.3g}, nu = "
            f"{self.poisson_ratio:.3g}, where the J2 bodies behind this hardness touch "
            f"on {100 * self.area:.3g} % of their nodes (raw area)"
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
    """Return the pressure cap that represents a rough body of perfectly plastic J2
    metal.

    Under this cap boundary elements carry the load on the contact area of the J2 body.
    By similarity it depends on E* xi/sigma_Y, p0/sigma_Y, nu and, a little, on the
    breadth of the spectrum.  It is the mean of large surfaces; Hurst exponents of 0.4
    to 0.8 make no difference.

    Args:
        yield_stress: sigma_Y in Pa, without hardening.
        young_modulus: E in Pa.
        poisson_ratio: nu.
        rms_slope: xi of the complete roughness.
        mean_pressure: p0 in Pa, the force over the nominal area.
        breadth: wavelength of the roll-off over the shortest in the slope; None: any
            from 2 to 300, for which the interval is wider.  It was tested from 2 to 32.

    Raises:
        InvalidScene: if a value is no number, the scene is outside the map, or its
            contact is too full for a hardness.

    Example:
        >>> found = effective_hardness(
        ...     yield_stress=1e9, young_modulus=210e9, poisson_ratio=0.3, rms_slope=0.1,
        ...     mean_pressure=0.25e9, breadth=16)
        >>> 2.6 < found.ratio < 2.9, found.interval[0] < found.value < found.interval[1]
        (True, True)
    """
    material = Material(young_modulus, poisson_ratio)
    yield_stress = positive("yield_stress", yield_stress, "Pa")
    rms_slope = positive("rms_slope", rms_slope, "m/m")
    mean_pressure = positive("mean_pressure", mean_pressure, "Pa")
    severity = effective_modulus(material) * rms_slope / yield_stress
    load = mean_pressure / yield_stress
    correction, breadth_error = breadth_correction(breadth, severity, load)
    place = {
        "severity": severity,
        "poisson_ratio": material.poisson_ratio,
        "load": load,
    }
    _require_on_map(place)
    columns = hardness_map()
    # Below the map its lightest load stands for the load, so many times as heavy.
    lighter = min(load / columns["load"].min(), 1.0)
    place["load"] = load / lighter
    area = lighter * _interpolate(place, columns["area"])
    if area > LARGEST_AREA:
        raise InvalidScene(
            f"the J2 body touches on {area:.2f} of the area at p0/σ_Y = "
            f"{place['load']:.3g}; above {LARGEST_AREA:g} the cap follows the load and "
            "not the material, so that no hardness stands for it"
        )
    half_fall = -STEEPEST_FALL * math.log(lighter) / 2
    coordinates = (np.array([value]) for value in place.values())
    on_map = float(fitted_ratio(*coordinates)[0])
    ratio = (1 - half_fall) * (1 + correction) * on_map
    errors = {name: _interpolate(place, columns[name]) for name in ERROR_COLUMNS}
    errors["formula_error"] = fitted_formula()[1]
    errors["breadth_error"] = breadth_error
    if half_fall:
        errors["light_error"] = half_fall / (1 - half_fall)
    error = math.hypot(*errors.values())
    value = ratio * yield_stress
    highest = value / (1 - error) if error < 1 else math.inf
    return MappedHardness(
        value=value,
        interval=(value / (1 + error), highest),
        ratio=ratio,
        severity=severity,
        poisson_ratio=material.poisson_ratio,
        load=load,
        area=area,
        errors=errors,
    )


def _require_on_map(place: Mapping[str, float]) -> None:
    """Raise InvalidScene if the map of the effective hardness does not reach a place.

    place: severity E* xi/sigma_Y, poisson_ratio and load p0/sigma_Y, by these names.
    The load may be as low as LIGHTEST_LOAD, below the lowest of the map.
    """
    for name, value in place.items():
        column = hardness_map()[name]
        low = LIGHTEST_LOAD if name == "load" else column.min()
        high = column.max()
        if not low * (1 - 1e-9) <= value <= high * (1 + 1e-9):
            raise InvalidScene(
                f"{COORDINATES[name]} is {value:.4g}, but the map of the effective "
                f"hardness reaches from {low:g} to {high:g}, and it is not extrapolated"
            )


def breadth_correction(
    breadth: float | None, severity: float, load: float
) -> tuple[float, float]:
    """Return the relative change of the map's hardness by the breadth of a spectrum.

    The map was computed with surfaces of the breadth MAP_BREADTH and of a finite size.

    Args:
        breadth: wavelength of the roll-off over the shortest; None: it is not known.
        severity: s = E* xi/sigma_Y.
        load: m = p0/sigma_Y.

    Returns:
        The change and its 95 % error, both as fractions of the hardness.

    Raises:
        InvalidScene: The breadth is below the smallest that was tested.
    """
    narrowest, broadest = TESTED_BREADTHS
    low_breadth = narrowest
    high_breadth = LARGEST_BREADTH
    if breadth is not None:
        low_breadth = high_breadth = positive("breadth", breadth, "–")
    if low_breadth < narrowest * (1 - 1e-9):
        raise InvalidScene(
            f"breadth is {breadth:.4g}, but the effective hardness is known for at "
            f"least {narrowest:g}, and for any if it is not given"
        )
    slope = BREADTH_TREND * severity / (8 + severity)
    low = slope * math.log(low_breadth / MAP_BREADTH)
    high = slope * math.log(high_breadth / MAP_BREADTH)
    trend = (low + high) / 2
    untested = slope * math.log(max(high_breadth / broadest, 1.0))
    size = SIZE_EFFECT / max(load, 0.1)
    uncertain = CORRECTION_ERROR * (abs(trend) + size)
    error = math.hypot(uncertain, untested, SPECTRA_ERROR, high - trend)
    return trend + size, error


_TEXT = (files("epcontact.materials") / "hardness_map.csv").read_text(encoding="utf-8")


@functools.cache
def hardness_map() -> Mapping[str, FloatArray]:
    """Return the columns (n,) of `hardness_map.csv` by name, one value for each place.

    A place is one severity, Poisson's ratio and load of the J2 bodies that were solved.
    The columns are COORDINATES, surfaces (their number), area, inverse_hardness
    (sigma_Y/hardness), scatter (the relative error of inverse_hardness by the surfaces
    of the place alone) and the relative errors ERROR_COLUMNS, of which the statistical
    one is that of the formula.
    """
    lines = [line for line in _TEXT.splitlines() if not line.startswith("#")]
    header, *rows = csv.reader(lines)
    return dict(zip(header, np.array(rows, dtype=np.float64).T, strict=True))


def map_digest() -> str:
    """Return the first 12 digits of the SHA-256 of `hardness_map.csv`.

    They change with the values of the map.
    """
    return hashlib.sha256(_TEXT.encode()).hexdigest()[:12]


def fitted_ratio(
    severity: FloatArray, poisson_ratio: FloatArray, load: FloatArray
) -> FloatArray:
    """Return hardness/sigma_Y (n,) by the formula that is fitted to the map.

    Places must be on the map; this is not checked.

    severity: (n,) s = E* xi/sigma_Y; poisson_ratio: (n,); load: (n,) m = p0/sigma_Y.
    """
    return formula_terms(severity, poisson_ratio, load) @ fitted_formula()[0]


@functools.cache
def fitted_formula() -> tuple[FloatArray, float]:
    """Return the coefficients (7,) of the formula for the hardness, and its error.

    The error is twice the rms of the relative residuals, see `fit_formula`.
    """
    return fit_formula(hardness_map())


def fit_formula(columns: Mapping[str, FloatArray]) -> tuple[FloatArray, float]:
    """Fit the formula for hardness/sigma_Y to a map by least squares.

    A place weighs less the larger its scatter is.  Places with a contact area above
    LARGEST_AREA, and those without a hardness, are left out.

    Args:
        columns: (n,) values for each place by name, those of `hardness_map`.

    Returns:
        The coefficients (7,) of `formula_terms`, and twice the rms of the relative
        residuals, less what the scatter explains.
    """
    used = (columns["area"] <= LARGEST_AREA) & (columns["inverse_hardness"] > 0)
    scatter = columns["scatter"][used]
    inverse = columns["inverse_hardness"][used]
    # Relative residuals: each row is divided by its hardness, 1/inverse.
    coordinates = (columns[name][used] for name in COORDINATES)
    relative_terms = formula_terms(*coordinates) * inverse[:, None]
    # Below 2 % of scatter the residual of the formula decides how places differ.
    weight = 1 / np.hypot(scatter, 0.02)
    coefficients, *_ = np.linalg.lstsq(
        relative_terms * weight[:, None], weight, rcond=None
    )
    residual = relative_terms @ coefficients - 1
    unexplained = np.average(residual**2 - (scatter / 2) ** 2, weights=weight**2)
    return np.asarray(coefficients), 2 * math.sqrt(max(unexplained, 0.0))


def formula_terms(
    severity: FloatArray, poisson_ratio: FloatArray, load: FloatArray
) -> FloatArray:
    """Return the terms (n, 7) of the formula for hardness/sigma_Y.

    Their sum, weighted with the coefficients, is hardness/sigma_Y.

    Args:
        severity: (n,) s = E* xi/sigma_Y.
        poisson_ratio: (n,).
        load: (n,) m = p0/sigma_Y.

    Returns:
        One row for each place, one column for each coefficient: a, b, e, f, g, h, k.
    """
    nu = poisson_ratio
    u = 1 / (1 + severity / 8)
    bent = u**2 * np.log(load)
    return np.column_stack(
        [np.ones_like(u), -1 / load, -u, u * nu, u * load, -bent, bent * nu]
    )


def _interpolate(place: Mapping[str, float], values: FloatArray) -> float:
    """Return a column of the map at a place, interpolated linearly in ln s, nu and m.

    place: severity s, poisson_ratio nu and load m by their names, on the map; values:
    (n,) the column, one value for each place of the map.

    The axes are interpolated one after the other.  scipy.interpolate would take longer
    to load than all else here.
    """
    columns = hardness_map()
    axes = [np.unique(columns[name]) for name in place]
    order = np.lexsort([columns[name] for name in reversed(list(place))])
    grid = values[order].reshape([axis.size for axis in axes])
    for (name, x), axis in zip(place.items(), axes, strict=True):
        if name == "severity":
            along_axis = functools.partial(np.interp, np.log(x), np.log(axis))
        else:
            along_axis = functools.partial(np.interp, x, axis)
        grid = np.apply_along_axis(along_axis, 0, grid)
    return float(grid)


def formula_text() -> str:
    """Return the formula with its coefficients, residual and range, in words."""
    (a, b, e, f, g, h, k), residual = fitted_formula()
    return (
        f"c = {a:.3f} {-b:+.4f}/m - ({e:.3f} {-f:+.3f} nu {-g:+.3f} m) u - u² ln m "
        f"({h:.3f} {-k:+.3f} nu), u = 1/(1 + s/8), s = E* xi/sigma_Y, m = p0/sigma_Y, "
        f"for {_range_words('{symbol} = {low:g} to {high:g}')}; it misses "
        f"{100 * residual:.1f} % (twice the rms beyond the scatter of the map's places)"
    )


def _range_words(form: str) -> str:
    """Return the range of the map in each coordinate, in words.

    form: format of one coordinate, with the fields {symbol}, {low} and {high}.
    """
    words = []
    for name, symbol in COORDINATES.items():
        column = hardness_map()[name]
        words.append(form.format(symbol=symbol, low=column.min(), high=column.max()))
    return ", ".join(words)
