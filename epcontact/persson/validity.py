"""How far the theory is off, from a map that boundary elements made.

`theory_map.csv` holds what boundary elements find at places of p0/hardness and
hardness/(E* xi) (without a hardness: of p0/(E* xi)) for several spectra;
`tests/laboratory/theory_map.py` made it. At each place a figure y is linear in ln
alpha, Nayak's parameter m0 m4/m2^2, and in ln n, the waves of the slope along a side,
m2/m1 over the lowest wave number; a surface scatters about it as 1/n. Of an area y is
the logit (of the elastic one the logarithm) less that of the theory's area with a floor
under it, and else e/(2 + e) of the theory's relative error e.  Coefficients,
covariances and scatter are interpolated in ln(hardness/(E* xi)) and the logit of
p0/hardness, or ln(p0/(E* xi)).
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
from epcontact.persson.local import CONSTANTS
from epcontact.persson.roughness import Roughness, analytic_roughness
from epcontact.persson.theory import Theory
from epcontact.results import FloatArray
from epcontact.scene import SelfAffineSpectrum

#: The figures whose errors are known, by the columns of the map; the areas come first.
FIGURES = ("total", "elastic", "plastic", "mean_gap", "wasserstein", "slope_at_zero")
_AREAS, _GAP = FIGURES[:3], FIGURES.index("mean_gap")
#: Whether y is a logit, or a logarithm.
_BOUNDED = np.array([1.0, 0.0, 1.0])
_HARDNESS, _LOAD = "hardness/(E*ξ)", "p0/(E*ξ)"
_WAVES = "the number of the slope's waves along a side"
_SOFT_GAP = "Nayak's parameter of soft bodies with roll-off"
#: Those that a note tells, with their words.
TOLD = {
    "total": "area",
    "elastic": "elastic area",
    "plastic": "plastic area",
    "mean_gap": "gap",
}
#: The gamma of the map, and how far another may be from it.
GAMMA, NEAR = 0.536, 0.005
#: Up to this share of the hardness bodies harder than any of the map hardly flow.
HARD_LOAD = 0.15
#: The least share out of contact that the map's figures tell.
_FULL = 3e-5
#: Floors under the theory's area out of contact, elastic and plastic area, as shares of
#: the most.
_FLOORS = (0.01, 0.1, 0.003)
#: What a line misses of y, and the share of an interpolation's last order that is its
#: error.
_MISFIT, _ORDER_ERROR = 0.008, 0.5
#: Between the last two hardnesses, 1.8 and 3, plastic area turns to nothing, and the y
#: of total and elastic area have this deviation more: a trial's 50 scenes there chose
#: it, 43 others judged it.
_TO_NONE = 0.012
#: Boundary elements know an area to this share of it, which counts next to full
#: contact.
_AREA_ERROR = 1e-4
#: Softer bodies have rows with roll-off up to the given alpha only, and without it, as
#: beyond, the gap is that of a few long waves.
_SOFT = 0.3
#: Ends of the gap's error beyond which it is not resolved: a closed gap is of
#: round-off.
_GAP_ENDS = (-0.95, 1.0)
#: Spectra with a larger Nayak parameter scatter more in the gap, mostly at light loads:
#: so much of y, chosen on scenes of 64 to 256 waves, 2000 to 2399 (light), 4000 to 6249
#: and 5000 to 5299.
_WIDE, _GAP_OF_WIDE = 16.0, 0.02
#: 95 % of the rule "local"'s errors over the map (`laboratory.local_reduction`), and
#: what single surfaces add (`laboratory.theory_map --local --judge 7000 7300`); of
#: areas this large.
LOCAL_ERRORS = {"total": (0.04, 0.05), "elastic": (0.20, 0.38), "plastic": (0.11, 0.05)}
_LEAST, _LOCAL_PLASTIC = 1e-3, 1.3
#: So many times fewer waves of the slope than the map's were judged; more were not.
_FEWER = 2.5


class ExpectedError(NamedTuple):
    """A relative error of the theory, (theory - boundary elements)/boundary elements:
    the ends of its 95 % interval, and the middle; of `wasserstein` the distance.
    """

    low: float
    middle: float
    high: float


def expected_errors(
    theory: Theory, mean_pressure: float, surfaces: int = 1
) -> dict[str, ExpectedError]:
    """The errors to be expected of the theory for the mean of so many surfaces, by
    `FIGURES`; those that boundary elements did not resolve are left out (so is the gap
    where it nearly closes, and of spectra with a larger Nayak parameter than any with
    roll-off that the map has so soft).

    Raises:
        InvalidScene: The scene is outside the map, which the sentence says.

    Example:
        >>> from epcontact import SelfAffineSpectrum
        >>> from epcontact.persson import EnergyReduction, analytic_roughness
        >>> rough = analytic_roughness(SelfAffineSpectrum(0.8, 1e5, 4e5, 256e5, rms_slope=1.0))
        >>> paper = Theory(rough, 250e9, EnergyReduction(0.536), 150e9)
        >>> expected_errors(paper, 12.5e9)["total"].high < 0.05
        True
    """
    rule, gamma = theory.reduction.rule, theory.reduction.gamma
    own = CONSTANTS[0] if rule == "local" else GAMMA
    if rule not in ("constant", "local") or abs(gamma - own) > NEAR:
        known = (
            f"a constant gamma of {GAMMA:g}, or {CONSTANTS[0]:g} with the rule 'local'"
        )
        raise InvalidScene(f"the map of the theory's error is for {known}")
    if not theory.roughness.rms_slope:
        raise InvalidScene("the surface is flat")
    if rule == "local":
        return _local_errors(theory, mean_pressure, surfaces)
    ends, true = _interpolated(theory, mean_pressure, surfaces)
    errors = 2 / (1 / np.clip(ends, -1, 0.999) - 1)
    if 2 * mean_pressure > theory.hardness:
        # Upside down, what flows is out of contact, and the map has more places.
        other = theory.hardness - mean_pressure
        _, (total, elastic, plastic) = _interpolated(theory, other, surfaces)
        mirrored = np.array([1 - plastic[::-1], elastic, 1 - total[::-1]])
        true = np.where(np.isnan(mirrored), true, mirrored)
    shares = areas(theory.diffusion(mean_pressure), mean_pressure, theory.hardness)
    # The larger an area, the lower the error of a theory that has too little of it.
    errors[:, :3] = [float(getattr(shares, part)) for part in _AREAS] / true.T[::-1] - 1
    errors[:, :3] += np.multiply.outer([-_AREA_ERROR, 0, _AREA_ERROR], np.ones(3))
    if not (_GAP_ENDS[0] <= errors[0, _GAP] and errors[2, _GAP] <= _GAP_ENDS[1]):
        errors[:, _GAP] = math.nan
    found = zip(FIGURES, errors.T.tolist(), strict=True)
    return {
        name: ExpectedError(*error) for name, error in found if not math.isnan(error[1])
    }


def _local_errors(
    theory: Theory, load: float, surfaces: int
) -> dict[str, ExpectedError]:
    """`LOCAL_ERRORS` where they are known: inside the map, and of areas that are large
    enough.
    """
    place, *_ = _placed(theory, load)
    found, own = {}, theory.local_state(load).areas
    for name, (common, single) in LOCAL_ERRORS.items():
        hard = name == "plastic" and place.get(_HARDNESS, math.inf) > _LOCAL_PLASTIC
        if getattr(own, name) >= _LEAST and not hard:
            error = math.hypot(common, single / math.sqrt(surfaces))
            found[name] = ExpectedError(-error, 0.0, error)
    return found


def _placed(
    theory: Theory, mean_pressure: float
) -> tuple[dict[str, float], float, float]:
    """The coordinates of a scene in the map, which must reach so far, alpha and the
    waves.
    """
    unit, reach = theory.effective_modulus * theory.roughness.rms_slope, map_reach()
    load = mean_pressure / theory.hardness
    place = {_HARDNESS: theory.hardness / unit, "p0/hardness": load}
    if place[_HARDNESS] > 1.01 * reach[_HARDNESS][1] and load <= HARD_LOAD:
        place = {_LOAD: mean_pressure / unit}
    alpha, waves = nayak(theory.roughness)
    for name, value in (place | {"Nayak's parameter": alpha, _WAVES: waves}).items():
        low, high = reach[name]
        if not low * 0.99 <= value <= high * 1.01:
            reached = (
                f"the map of the theory's error reaches from {low:.3g} to {high:.3g}"
            )
            raise InvalidScene(f"{name} is {value:.3g}, but {reached}")
    return place, alpha, waves


def _interpolated(
    theory: Theory, mean_pressure: float, surfaces: int
) -> tuple[FloatArray, FloatArray]:
    """The ends and middles of y, (3, figures), and of the areas, (areas, 3)."""
    place, alpha, waves = _placed(theory, mean_pressure)
    axes, grid, covariance = _fits(tuple(place))
    at = [_scaled(name, value) for name, value in place.items()]
    X = np.array([1.0, math.log(alpha), math.log(waves)])
    rough, y = (_between(axes, at, grid, nodes)[:, :3] @ X for nodes in (2, 4))
    y = np.where(np.isnan(y), rough, y)
    misfit, scatter = _between(axes, at, grid, 2)[:, 3:].T
    variance = (
        misfit
        + X @ _between(axes, at, covariance, 2) @ X
        + scatter / (waves**2 * surfaces)
    )
    if _HARDNESS in place and np.exp(axes[0][-2]) < place[_HARDNESS]:
        variance[:2] += _TO_NONE**2
    variance[_GAP] += _GAP_OF_WIDE**2 * (alpha > _WIDE)
    if (
        place.get(_HARDNESS, math.inf) < 0.99 * _SOFT
        and alpha > 1.01 * map_reach()[_SOFT_GAP][1]
    ):
        variance[_GAP] = math.nan
    deviation = np.sqrt(variance + (_ORDER_ERROR * (y - rough)) ** 2)
    ends = y + np.multiply.outer([-2, 0, 2], deviation)
    shares = areas(theory.diffusion(mean_pressure), mean_pressure, theory.hardness)
    logs = ends[:, :3] + _logs(shares, mean_pressure / theory.hardness)
    return ends, 1 / (_BOUNDED + np.exp(-logs)).T


def expectation(theory: Theory, mean_pressure: float) -> str:
    """The sentence on the theory's expected errors for a note."""
    try:
        found = expected_errors(theory, mean_pressure)
    except InvalidScene as outside:
        return f"the error of the theory itself is not known here: {outside}"
    known = ((words, found[name]) for name, words in TOLD.items() if name in found)
    told = ", ".join(
        f"{w} {100 * e.low:+.2g} to {100 * e.high:+.2g} %" for w, e in known
    )
    surfaces = "95 % of Gaussian surfaces, against boundary elements"
    flows = math.isfinite(theory.hardness)
    none = {"plastic": not flows, "mean_gap": theory.reduction.rule == "local"}
    missing = [
        w for name, w in TOLD.items() if name not in found and not none.get(name)
    ]
    unknown = f"; not resolved: {', '.join(missing)}" if missing else ""
    return f"the theory itself is off by {told} ({surfaces}){unknown}"


def nayak(roughness: Roughness) -> tuple[float, float]:
    """Nayak's parameter m0 m4/m2^2 of a spectrum, and m2/m1 over its lowest wave
    number.
    """
    power, moment = roughness.slope_variance, roughness.first_moment
    power, moment = power[power > 0], moment[power > 0]
    alpha = (moment**2 / power).sum() * (power**3 / moment**2).sum() / power.sum() ** 2
    return float(alpha), float(power.sum() / moment.sum() / roughness.lowest)


@functools.cache
def theory_map() -> Mapping[str, FloatArray]:
    """The columns of `theory_map.csv`, with `nayak` and `waves` of each spectrum."""
    with (files("epcontact.persson") / "theory_map.csv").open(
        encoding="utf-8"
    ) as lines:
        table = np.genfromtxt(lines, delimiter=",", names=True, skip_header=2)
    known = {str(name): table[name] for name in table.dtype.names or ()}
    spectra = [
        *zip(
            *(known[n] for n in ("hurst", "roll_off", "wavelength_ratio")), strict=True
        )
    ]
    of = {s: SelfAffineSpectrum(s[0], 1.0, s[1], s[2], 1.0) for s in set(spectra)}
    shape = {s: nayak(analytic_roughness(spectrum)) for s, spectrum in of.items()}
    alpha, waves = np.transpose([shape[spectrum] for spectrum in spectra])
    return known | {"nayak": alpha, "waves": waves}


@functools.cache
def map_reach() -> dict[str, tuple[float, float]]:
    """The ends of the map in each of its coordinates, by their names."""
    known = theory_map()
    capped = np.isfinite(known["hardness"])
    ends = {_HARDNESS: known["hardness"][capped], "p0/hardness": known["load"][capped]}
    ends |= {_LOAD: known["load"][~capped], "Nayak's parameter": known["nayak"]}
    soft = (known["roll_off"] > 1) & (known["hardness"] < 0.99 * _SOFT)
    ends |= {_SOFT_GAP: known["nayak"][soft]}
    reach = {
        name: (float(values.min()), float(values.max()))
        for name, values in ends.items()
    }
    return reach | {
        _WAVES: (float(known["waves"].min()) / _FEWER, float(known["waves"].max()))
    }


@functools.cache
def _fits(names: tuple[str, ...]) -> tuple[list[FloatArray], FloatArray, FloatArray]:
    """The scaled axes of a map, and of each figure the coefficients, variances and
    covariance.
    """
    known = theory_map()
    inside = np.isfinite(known["hardness"]) == (len(names) == 2)
    rows = {name: column[inside] for name, column in known.items()}
    columns = [rows[name] for name in ("hardness", "load")[-len(names) :]]
    axes, index = zip(
        *(np.unique(column, return_inverse=True) for column in columns), strict=True
    )
    size = [*(axis.size for axis in axes), len(FIGURES)]
    grid, covariance = np.full([*size, 5], np.nan), np.full([*size, 3, 3], np.nan)
    X = np.column_stack(
        [np.ones(inside.sum()), np.log(rows["nayak"]), np.log(rows["waves"])]
    )
    for k, (y, error) in enumerate(_figures(rows)):
        for place in np.ndindex(*size[:-1]):
            here = np.all(np.transpose(index) == place, axis=1)
            if np.isnan(y[here]).any():
                continue
            weight = 1 / (error[here] ** 2 + _MISFIT**2)
            V = np.linalg.inv(X[here].T * weight @ X[here])
            line = V @ (X[here].T * weight @ y[here])
            worse = weight @ (y[here] - X[here] @ line) ** 2 / (here.sum() - 3)
            scatter = np.mean(
                (error * rows["waves"])[here] ** 2 * rows["surfaces"][here]
            )
            grid[(*place, k)] = [*line, worse * _MISFIT**2, scatter]
            covariance[(*place, k)] = worse * V
    return (
        [_scaled(name, axis) for name, axis in zip(names, axes, strict=True)],
        grid,
        covariance,
    )


def _figures(rows: Mapping[str, FloatArray]) -> Iterator[tuple[FloatArray, FloatArray]]:
    """y of each figure at each row of the map, and its standard error by the
    surfaces.
    """
    load = np.where(
        np.isfinite(rows["hardness"]), rows["load"] * rows["hardness"], rows["load"]
    )
    logs = _logs(areas(GAMMA / 8, load, rows["hardness"]), load / rows["hardness"])
    for part, bounded, reference in zip(_AREAS, _BOUNDED, logs, strict=True):
        apart = np.maximum(1 - rows[part], _FULL) ** bounded
        yield np.log(rows[part] / apart) - reference, rows[f"{part}_scatter"] / apart
    for name in FIGURES[3:]:
        distance = name == "wasserstein"
        e = rows[name] if distance else rows[f"{name}_theory"]
        error = rows[f"{name}_scatter"] * (e if distance else 1 + e)
        yield e / (2 + e), 2 * error / (2 + e) ** 2


def _logs(shares: ContactAreas, load: Any) -> FloatArray:
    """The logits of the theory's areas (of the elastic one the logarithm), with
    floors.
    """
    least = (0.0 * load, _FLOORS[1] * load * (1 - load), _FLOORS[2] * load)
    beside = (_FLOORS[0] * (1 - load), 0.0, _FLOORS[2])
    logs = []
    for part, bounded, low, high in zip(_AREAS, _BOUNDED, least, beside, strict=True):
        area = getattr(shares, part)
        here, rest = (
            np.log(np.maximum(a, 1e-300)) for a in (area + low, 1 - area + high)
        )
        logs.append(here - bounded * rest)
    return np.array(logs)


def _scaled(name: str, value: Any) -> Any:
    return np.log(value / (1 - value)) if name == "p0/hardness" else np.log(value)


def _between(
    axes: Sequence[FloatArray], at: Sequence[float], grid: FloatArray, nodes: int
) -> FloatArray:
    """Interpolate a grid by Lagrange's polynomials through the next so many nodes of
    each axis.
    """
    for axis, x in zip(axes, at, strict=True):
        first = min(
            max(int(np.searchsorted(axis, x)) - nodes // 2, 0), axis.size - nodes
        )
        near = axis[first : first + nodes]
        weights = [
            np.prod((x - np.delete(near, k)) / np.delete(near[k] - near, k))
            for k in range(nodes)
        ]
        grid = np.tensordot(weights, grid[first : first + nodes], 1)
    return grid
