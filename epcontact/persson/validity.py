"""The error of the theory, from a map that boundary elements produced.

`theory_map.csv` holds what boundary elements give at places of p0/hardness and
hardness/(E* xi) (without a hardness: of p0/(E* xi)) for several spectra;
`tests/laboratory/theory_map.py` computes it.  At each place a transformed error y of
each figure is linear in ln alpha, with Nayak's parameter alpha = m0 m4/m2^2, and in
ln n, with the number n of waves of the slope along a side, m2/m1 over the lowest wave
number.  A single surface scatters about this line as 1/n; its mean gap scatters as 1/k,
with the number k of waves of the height, m1/m0 over the lowest wave number.  y of an
area is the logit of the area less that of the theory's area with a floor under it (of
the elastic area the logarithm); y of any other figure is e/(2 + e), with the theory's
relative error e.  Coefficients, covariances and scatter are interpolated in
ln(hardness/(E* xi)) and the logit of p0/hardness, or in ln(p0/(E* xi)).

The surfaces of the map are random isotropic fields.  Of a surface that is no such field
(`persson.random_field`) the errors are not known.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from epcontact.errors import InvalidScene
from epcontact.persson.elastoplastic import ContactAreas, areas
from epcontact.persson.near_bounds import CONSTANTS
from epcontact.persson.random_field import require_random_field
from epcontact.persson.roughness import Roughness, analytic_roughness
from epcontact.persson.theory import Theory
from epcontact.results import FloatArray
from epcontact.scene import SelfAffineSpectrum, Surface

#: The figures whose errors the map holds, by the names of its columns; areas first.
FIGURES = ("total", "elastic", "plastic", "mean_gap", "wasserstein", "slope_at_zero")
_AREAS = FIGURES[:3]
_GAP = FIGURES.index("mean_gap")
#: 1 where y of an area is a logit, 0 where it is a logarithm.
_IS_LOGIT = np.array([1.0, 0.0, 1.0])
#: Names of the map's coordinates, as messages show them.
_HARDNESS = "hardness/(E*ξ)"
_LOAD = "p0/(E*ξ)"
_LOAD_OF_HARDNESS = "p0/hardness"
_NAYAK = "Nayak's parameter"
_WAVES = "the number of the slope's waves along a side"
_SOFT_GAP = "Nayak's parameter of soft bodies with roll-off"
#: The figures that a note lists, with the words of the note.
LISTED = {
    "total": "area",
    "elastic": "elastic area",
    "plastic": "plastic area",
    "mean_gap": "gap",
}
#: The gamma of the map, and how far another gamma may be from it.
GAMMA = 0.536
GAMMA_TOLERANCE = 0.005
#: Up to this p0/hardness a body harder than any of the map hardly flows, and is judged
#: as an elastic one.
HARD_LOAD = 0.15
#: The smallest fraction out of contact for which the map holds values.
_SMALLEST_SEPARATED = 3e-5
#: Floors under the theory's separated, elastic and plastic area, as fractions of their
#: largest possible values, by the rule of the energy reduction.  With a constant gamma
#: these areas may vanish.
_FLOORS = {"constant": (0.01, 0.1, 0.003), "near_bounds": (0.0, 0.0, 0.0)}
#: Names of the map's columns of errors, by the rule of the energy reduction.
_COLUMNS = {"constant": "theory", "near_bounds": "near_bounds"}
#: Standard deviation of y about the line that no surface explains.
_MISFIT = 0.008
#: The error of an interpolation, as a fraction of the change by its last order.
_ORDER_ERROR = 0.5
#: Additional standard deviation of y of the total and elastic area between the last two
#: hardnesses, 1.8 and 3 E* xi, where the plastic area vanishes.  50 trial scenes there
#: gave the value, and 43 others confirmed it.
_VANISHING_PLASTIC = 0.012
#: Standard deviations of a normal distribution within which nine of ten errors are, as
#: within the error estimate of an area.
_DEVIATIONS_OF_ESTIMATE = 1.645
#: Relative error of an area by boundary elements, which matters next to full contact.
_AREA_ERROR = 1e-4
#: Below this hardness/(E* xi) the map has spectra with roll-off only up to a limit of
#: Nayak's parameter.  Beyond it the gap is that of a few long waves and is not
#: resolved.
_SOFT = 0.3
#: A gap whose relative error may leave this interval is not resolved, because a closed
#: gap is rounding noise.
_GAP_ENDS = (-0.95, 1.0)
#: Additional standard deviation of y of the gap by the rule "constant" for spectra with
#: a larger Nayak parameter, which scatter more, mostly at light loads.  Chosen on
#: scenes of 64 to 256 waves with seeds 2000 to 2399 (light), 4000 to 6249 and 5000 to
#: 5299.
_BROAD = 16.0
_GAP_OF_BROAD = 0.02
#: Largest relative difference of the rms heights of surface and theory at which the
#: error of the gap is known.  The gap grows in proportion at the most, and its interval
#: is rarely narrower.
_HEIGHT_DIFFERENCE = 0.06
#: Surfaces with up to this factor fewer waves of the slope than the map's were compared
#: with it.
_FEWER_WAVES = 2.5


class ExpectedError(NamedTuple):
    """A relative error of the theory, (theory - boundary elements)/boundary elements.

    Attributes:
        low: Lower end of its 95 % interval.
        middle: Middle of the interval.
        high: Upper end of the interval.

    The error of "wasserstein" is the distance of the two pressure distributions.
    """

    low: float
    middle: float
    high: float


def expected_errors(
    theory: Theory,
    mean_pressure: float,
    surfaces: int = 1,
    contact: ContactAreas | None = None,
) -> dict[str, ExpectedError]:
    """Return the errors to be expected of the theory, by the names in `FIGURES`.

    Figures that boundary elements did not resolve are left out.  So is the gap where it
    nearly closes, and where a spectrum has a larger Nayak parameter than any spectrum
    with roll-off that the map has for so soft a body.

    Args:
        theory: The body.
        mean_pressure: In Pa.
        surfaces: Number of surfaces whose mean is compared.
        contact: The theory's areas at this pressure, as fractions; None: they are
            computed.

    Raises:
        InvalidScene: The scene is outside the map; the sentence says in what.

    Example:
        >>> from epcontact import SelfAffineSpectrum
        >>> from epcontact.persson import EnergyReduction, analytic_roughness
        >>> spectrum = SelfAffineSpectrum(0.8, 1e5, 4e5, 256e5, rms_slope=1.0)
        >>> rough = analytic_roughness(spectrum)
        >>> paper = Theory(rough, 250e9, EnergyReduction(0.536), 150e9)
        >>> expected_errors(paper, 12.5e9)["total"].high < 0.05
        True
    """
    rule = theory.reduction.rule
    gamma_of_map = CONSTANTS[0] if rule == "near_bounds" else GAMMA
    same_gamma = abs(theory.reduction.gamma - gamma_of_map) <= GAMMA_TOLERANCE
    if rule not in ("constant", "near_bounds") or not same_gamma:
        raise InvalidScene(
            f"the map of the theory's error is for a constant gamma of {GAMMA:g}, or "
            f"{CONSTANTS[0]:g} with the rule 'near_bounds'"
        )
    if not theory.roughness.rms_slope:
        raise InvalidScene("the surface is flat")
    _place_in_map(theory, mean_pressure)  # refuses a scene that is outside
    if contact is None:
        contact = theory.contact_areas(mean_pressure)
    ends, true_areas = _interpolate(theory, mean_pressure, contact, surfaces)
    errors = 2 / (1 / np.clip(ends, -1, 0.999) - 1)
    if 2 * mean_pressure > theory.hardness:
        # In the mirror image the plastic area is out of contact, and the map has more
        # places there.
        mirrored_load = theory.hardness - mean_pressure
        swapped = ContactAreas(contact.elastic, contact.separated, contact.plastic)
        _, (total, elastic, plastic) = _interpolate(
            theory, mirrored_load, swapped, surfaces
        )
        mirrored = np.array([1 - plastic[::-1], elastic, 1 - total[::-1]])
        true_areas = np.where(np.isnan(mirrored), true_areas, mirrored)
    # The larger an area is, the lower is the error of a theory with too little of it.
    of_theory = [float(getattr(contact, name)) for name in _AREAS]
    errors[:, :3] = of_theory / true_areas.T[::-1] - 1
    errors[:, :3] += np.array([[-_AREA_ERROR], [0.0], [_AREA_ERROR]])
    lowest, highest = _GAP_ENDS
    if not (lowest <= errors[0, _GAP] and errors[2, _GAP] <= highest):
        errors[:, _GAP] = math.nan
    expected = {}
    for name, (low, middle, high) in zip(FIGURES, errors.T.tolist(), strict=True):
        if not math.isnan(middle):
            expected[name] = ExpectedError(low, middle, high)
    return expected


def _place_in_map(
    theory: Theory, mean_pressure: float
) -> tuple[dict[str, float], float, float]:
    """Return the coordinates of a scene in the map of the theory's error.

    Args:
        theory: The body.
        mean_pressure: In Pa.

    Returns:
        Dimensionless: hardness/(E* xi) and p0/hardness by name, or p0/(E* xi) alone for
            an elastic body; Nayak's parameter; and the number of the slope's waves
            along a side.

    Raises:
        InvalidScene: A value is outside the range of the map.
    """
    unit = theory.effective_modulus * theory.roughness.rms_slope
    reach = map_reach()
    place = {
        _HARDNESS: theory.hardness / unit,
        _LOAD_OF_HARDNESS: mean_pressure / theory.hardness,
    }
    _, hardest = reach[_HARDNESS]
    if place[_HARDNESS] > 1.01 * hardest and place[_LOAD_OF_HARDNESS] <= HARD_LOAD:
        place = {_LOAD: mean_pressure / unit}
    alpha, waves = nayak(theory.roughness)
    for name, value in (place | {_NAYAK: alpha, _WAVES: waves}).items():
        low, high = reach[name]
        if not low * 0.99 <= value <= high * 1.01:
            raise InvalidScene(
                f"{name} is {value:.3g}, but the map of the theory's error reaches "
                f"from {low:.3g} to {high:.3g}"
            )
    return place, alpha, waves


def _interpolate(
    theory: Theory, mean_pressure: float, contact: ContactAreas, surfaces: int
) -> tuple[FloatArray, FloatArray]:
    """Return the map's transformed errors of the theory, and the areas they imply.

    Args:
        theory: The body.
        mean_pressure: In Pa.
        contact: The areas by the theory at this pressure, as fractions.
        surfaces: Number of surfaces whose mean is compared.

    Returns:
        Low, middle and high end of each figure's transformed error, (3, 6), NaN where
        it is not resolved; and total, elastic and plastic area of the nominal area at
        these ends, (3, 3).

    Raises:
        InvalidScene: The scene is outside the map.
    """
    place, alpha, waves = _place_in_map(theory, mean_pressure)
    rule = theory.reduction.rule
    axes, grid, covariance = _fits(tuple(place), rule)
    at = [_scaled(name, value) for name, value in place.items()]
    X = np.array([1.0, math.log(alpha), math.log(waves)])
    linear = _lagrange(axes, at, grid, nodes=2)
    y_linear = linear[:, :3] @ X
    y = _lagrange(axes, at, grid, nodes=4)[:, :3] @ X
    y = np.where(np.isnan(y), y_linear, y)
    misfit, scatter, of_grid = linear[:, 3:].T
    of_line = X @ _lagrange(axes, at, covariance, nodes=2) @ X
    waves_of_scatter = np.full(len(FIGURES), waves)
    waves_of_scatter[_GAP] = height_waves(theory.roughness)
    variance = misfit + of_line + of_grid + scatter / (waves_of_scatter**2 * surfaces)
    hardness = place.get(_HARDNESS, math.inf)
    if _HARDNESS in place and np.exp(axes[0][-2]) < hardness:
        variance[:2] += _VANISHING_PLASTIC**2
    if alpha > _BROAD and rule == "constant":
        variance[_GAP] += _GAP_OF_BROAD**2
    if hardness < 0.99 * _SOFT and alpha > 1.01 * map_reach()[_SOFT_GAP][1]:
        variance[_GAP] = math.nan
    deviation = np.sqrt(variance + (_ORDER_ERROR * (y - y_linear)) ** 2)
    ends = y + np.multiply.outer([-2, 0, 2], deviation)
    load = mean_pressure / theory.hardness
    logs = ends[:, :3] + _logs(_by_name(contact), load, _FLOORS[rule])
    return ends, 1 / (_IS_LOGIT + np.exp(-logs)).T


def expectation(
    theory: Theory,
    mean_pressure: float,
    contact: ContactAreas | None = None,
    surface: Surface | None = None,
) -> str:
    """Return a sentence on the expected errors of the theory, for a result's notes.

    Outside the map of errors, and for a surface that is no random isotropic field, the
    sentence says that the errors are not known, and why.  The gap is not known if the
    theory takes the roughness to be higher or lower than the surface is: the waves of a
    period are a lattice, and without a roll-off their rms height is 13 to 31 % above
    that of the analytic spectrum.

    Args:
        theory: The body.
        mean_pressure: In Pa.
        contact: The theory's areas at this pressure, as fractions; None: they are
            computed.
        surface: The surface; None: the sentence is for random fields that have the
            theory's roughness.
    """
    try:
        errors = expected_errors(theory, mean_pressure, contact=contact)
        if surface is not None:
            require_random_field(surface)
            of_theory = math.sqrt(theory.roughness.height_variance.sum())
            if abs(surface.heights.std() / of_theory - 1) > _HEIGHT_DIFFERENCE:
                errors.pop("mean_gap", None)
    except InvalidScene as reason:
        return f"the error of the theory itself is not known here: {reason}"
    intervals = []
    unresolved = []
    not_defined = set()
    if math.isinf(theory.hardness):
        not_defined.add("plastic")
    for name, words in LISTED.items():
        if name in errors:
            low, _, high = errors[name]
            intervals.append(f"{words} {100 * low:+.2g} to {100 * high:+.2g} %")
        elif name not in not_defined:
            unresolved.append(words)
    sentence = (
        f"the theory itself is off by {', '.join(intervals)} (95 % of Gaussian "
        "surfaces, against boundary elements)"
    )
    if unresolved:
        sentence += f"; not resolved: {', '.join(unresolved)}"
    return sentence


def nayak(roughness: Roughness) -> tuple[float, float]:
    """Return Nayak's parameter m0 m4/m2^2, and m2/m1 over the lowest wave number.

    The second is the number of waves of the slope along a side.  m_k is the k-th moment
    of the spectrum; both values are dimensionless.

    Args:
        roughness: Bands of the surface, at least one with slopes.
    """
    filled = roughness.slope_variance > 0
    m2 = roughness.slope_variance[filled]  # of each band
    m1 = roughness.first_moment[filled]
    m0 = m1**2 / m2
    m4 = m2**3 / m1**2
    alpha = m0.sum() * m4.sum() / m2.sum() ** 2
    return float(alpha), float(m2.sum() / m1.sum() / roughness.lowest)


def height_waves(roughness: Roughness) -> float:
    """Return m1/m0 over the lowest wave number: the number of waves of the height.

    Args:
        roughness: Bands of the surface, at least one with heights.
    """
    moment = roughness.first_moment.sum() / roughness.height_variance.sum()
    return float(moment / roughness.lowest)


@functools.cache
def theory_map() -> Mapping[str, FloatArray]:
    """Return the columns of `theory_map.csv` (rows,), by name.

    The columns `nayak`, `waves` and `height_waves` are added: Nayak's parameter and the
    numbers of the slope's and of the height's waves along a side, for the spectrum of
    each row.
    """
    path = files("epcontact.persson") / "theory_map.csv"
    with path.open(encoding="utf-8") as lines:
        table = np.genfromtxt(lines, delimiter=",", names=True, skip_header=2)
    columns = {str(name): table[name] for name in table.dtype.names or ()}
    parameters = (columns[n] for n in ("hurst", "roll_off", "wavelength_ratio"))
    rows = list(zip(*parameters, strict=True))
    shapes = {}
    for hurst, roll_off, ratio in set(rows):
        spectrum = SelfAffineSpectrum(hurst, 1.0, roll_off, ratio, 1.0)
        rough = analytic_roughness(spectrum)
        shapes[hurst, roll_off, ratio] = (*nayak(rough), height_waves(rough))
    names = ("nayak", "waves", "height_waves")
    added = np.transpose([shapes[row] for row in rows])
    return columns | dict(zip(names, added, strict=True))


@functools.cache
def map_reach() -> dict[str, tuple[float, float]]:
    """Return the smallest and the largest value of each coordinate of the error map.

    All are dimensionless and by the names that messages show.
    """
    table = theory_map()
    capped = np.isfinite(table["hardness"])
    soft_with_roll_off = (table["roll_off"] > 1) & (table["hardness"] < 0.99 * _SOFT)
    coordinates = {
        _HARDNESS: table["hardness"][capped],
        _LOAD_OF_HARDNESS: table["load"][capped],
        _LOAD: table["load"][~capped],
        _NAYAK: table["nayak"],
        _SOFT_GAP: table["nayak"][soft_with_roll_off],
    }
    reach = {}
    for name, values in coordinates.items():
        reach[name] = (float(values.min()), float(values.max()))
    waves = table["waves"]
    reach[_WAVES] = (float(waves.min()) / _FEWER_WAVES, float(waves.max()))
    return reach


@functools.cache
def _fits(
    names: tuple[str, ...], rule: str
) -> tuple[list[FloatArray], FloatArray, FloatArray]:
    """Fit the line of each figure's error at each place of the map.

    A place is a pair of hardness and load.  The line is linear in ln(Nayak's parameter)
    and ln(number of waves).

    Args:
        names: Coordinates: hardness and load, or the load of elastic bodies alone.
        rule: Whose error it is, "constant" or "near_bounds".

    Returns:
        The scaled axes; of each place and figure the three coefficients, the variance
        of the misfit, the scatter and the variance by the grid of boundary elements,
        (..., figures, 6); the covariances of the coefficients, (..., figures, 3, 3).
        Places without data hold NaN.
    """
    table = theory_map()
    capped = len(names) == 2
    chosen = np.isfinite(table["hardness"]) == capped
    rows = {name: column[chosen] for name, column in table.items()}
    columns = [rows[name] for name in ("hardness", "load")[-len(names) :]]
    values_and_indices = [np.unique(column, return_inverse=True) for column in columns]
    values = [value for value, _ in values_and_indices]
    indices = np.transpose([index for _, index in values_and_indices])
    size = [*(axis.size for axis in values), len(FIGURES)]
    grid = np.full([*size, 6], np.nan)
    covariance = np.full([*size, 3, 3], np.nan)
    ones = np.ones(chosen.sum())
    X = np.column_stack([ones, np.log(rows["nayak"]), np.log(rows["waves"])])
    for k, (y, error, of_grid) in enumerate(_transformed_errors(rows, rule)):
        # The scatter over a few surfaces is itself uncertain by factors, to both sides.
        # The gap of the rule "constant" scatters more where it nearly closes, and the
        # mean over the spectra counts that.
        is_area = k < len(_AREAS)
        typical = np.median if is_area or rule == "near_bounds" else np.mean
        for place in np.ndindex(*size[:-1]):
            here = np.all(indices == place, axis=1)
            if np.isnan(y[here]).any():
                continue
            weight = 1 / (error[here] ** 2 + of_grid[here] ** 2 + _MISFIT**2)
            V = np.linalg.inv(X[here].T * weight @ X[here])
            coefficients = V @ (X[here].T * weight @ y[here])
            residual = y[here] - X[here] @ coefficients
            chi_squared = weight @ residual**2 / (here.sum() - 3)
            waves = rows["height_waves" if k == _GAP else "waves"]
            of_one_wave = (error * waves)[here] ** 2 * rows["surfaces"][here]
            grid[(*place, k)] = [
                *coefficients,
                chi_squared * _MISFIT**2,
                typical(of_one_wave),
                np.mean(of_grid[here] ** 2),
            ]
            covariance[(*place, k)] = chi_squared * V
    axes = [_scaled(name, axis) for name, axis in zip(names, values, strict=True)]
    return axes, grid, covariance


def _transformed_errors(
    rows: Mapping[str, FloatArray], rule: str
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Yield each figure's transformed error, its standard error over the surfaces and
    its error by the grid of boundary elements, (rows,) each.

    The order is that of `FIGURES`.  Of the rule "near_bounds" the map has the errors of
    areas and of the mean gap, and the other figures are NaN.  For an area the
    transformed error is the difference of logits (or logarithms) between boundary
    elements and the theory; for other figures it is e/(2 + e), with the relative error
    e of the theory.

    Args:
        rows: Columns of the map by name, (rows,) each.
        rule: Whose error it is, "constant" or "near_bounds".
    """
    capped = np.isfinite(rows["hardness"])
    load = np.where(capped, rows["load"] * rows["hardness"], rows["load"])
    of_theory = _by_name(areas(GAMMA / 8, load, rows["hardness"]))
    if rule == "near_bounds":
        for name in _AREAS:
            of_theory[name] = rows[name] * (1 + rows[f"{name}_near_bounds"])
    logs = _logs(of_theory, load / rows["hardness"], _FLOORS[rule])
    for name, is_logit, reference in zip(_AREAS, _IS_LOGIT, logs, strict=True):
        remainder = np.maximum(1 - rows[name], _SMALLEST_SEPARATED) ** is_logit
        y = np.log(rows[name] / remainder) - reference
        of_grid = rows[f"{name}_grid"] / _DEVIATIONS_OF_ESTIMATE
        yield y, rows[f"{name}_scatter"] / remainder, of_grid / remainder
    nothing = np.full_like(load, np.nan)
    for name in FIGURES[3:]:
        if rule == "near_bounds" and name != "mean_gap":
            yield nothing, nothing, nothing
            continue
        if name == "wasserstein":
            e = rows[name]
            error = rows[f"{name}_scatter"] * e
        else:
            e = rows[f"{name}_{_COLUMNS[rule]}"]
            error = rows[f"{name}_scatter"] * (1 + e)
        yield e / (2 + e), 2 * error / (2 + e) ** 2, 0 * error


def _by_name(contact: ContactAreas) -> dict[str, FloatArray]:
    """Return total, elastic and plastic area by name, as fractions of any shape."""
    return {name: getattr(contact, name) for name in _AREAS}


def _logs(
    contact: Mapping[str, FloatArray], load: Any, floors: tuple[float, float, float]
) -> FloatArray:
    """Return logit, logarithm and logit of the total, elastic and plastic area.

    Small floors under the theory's areas keep the values finite.

    Args:
        contact: The total, elastic and plastic area by the theory, fractions of any
            shape.
        load: p0/hardness, which sets the floors under the areas; 0 without a hardness.
        floors: Floors under the separated, elastic and plastic area, as fractions of
            their largest possible values.

    Returns:
        Array of shape (3, ...).
    """
    separated, elastic, plastic = floors
    floors_of_areas = (0.0 * load, elastic * load * (1 - load), plastic * load)
    floors_of_remainders = (separated * (1 - load), 0.0, plastic)
    logs = []
    rows = zip(_AREAS, _IS_LOGIT, floors_of_areas, floors_of_remainders, strict=True)
    for name, is_logit, floor, floor_of_remainder in rows:
        area = contact[name]
        of_area = np.log(np.maximum(area + floor, 1e-300))
        of_remainder = np.log(np.maximum(1 - area + floor_of_remainder, 1e-300))
        logs.append(of_area - is_logit * of_remainder)
    return np.array(logs)


def _scaled(name: str, value: Any) -> Any:
    """Return the logarithm of a map coordinate, or the logit of p0/hardness.

    Args:
        name: Of the coordinate, as messages show it.
        value: Number or array, positive, and below 1 for p0/hardness.
    """
    if name == _LOAD_OF_HARDNESS:
        return np.log(value / (1 - value))
    return np.log(value)


def _lagrange(
    axes: Sequence[FloatArray], at: Sequence[float], grid: FloatArray, nodes: int
) -> FloatArray:
    """Interpolate a grid by Lagrange's polynomials.

    Args:
        axes: Ascending coordinates of the grid's first dimensions, (n,) each.
        at: The coordinate of the wanted place along each axis.
        grid: Values, (n, ..., others).
        nodes: Number of the nearest nodes of each axis that the polynomials pass.

    Returns:
        The values at the place, (others).
    """
    for axis, x in zip(axes, at, strict=True):
        first = int(np.searchsorted(axis, x)) - nodes // 2
        first = min(max(first, 0), axis.size - nodes)
        near = axis[first : first + nodes]
        weights = []
        for k in range(nodes):
            others = np.delete(near, k)
            weights.append(np.prod((x - others) / (near[k] - others)))
        grid = np.tensordot(weights, grid[first : first + nodes], 1)
    return grid
