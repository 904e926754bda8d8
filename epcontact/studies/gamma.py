"""Which energy reduction gamma fits: areas of the theory against it, beside boundary elements.

The theory has one parameter, a constant gamma in G = gamma E*^2 xi^2 / 8.  Boundary elements, in
the continuum limit and averaged over surfaces, give four areas of one roughness: total, elastic
and plastic of the capped body, and the contact of the elastic one.  Each is met by the theory at
a gamma of its own; where those intervals have nothing in common, no single gamma fits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from epcontact.output.charts.figures import Series
from epcontact.output.charts.study import curves
from epcontact.output.charts.style import CYCLE, STATE_COLOURS
from epcontact.results import ELASTIC, PLASTIC, ContactResult, FloatArray
from epcontact.studies import Progress, Size
from epcontact.studies import paper_scene as scenes

if TYPE_CHECKING:
    from epcontact.output.charts.figures import Chart


NAMES = {
    "total_area": "total",
    "elastic_area": "elastic",
    "plastic_area": "plastic",
    "elastic_body_area": "elastic body",
}
_COLOURS = {
    "total": CYCLE[0],
    "elastic": STATE_COLOURS[ELASTIC],
    "plastic": STATE_COLOURS[PLASTIC],
    "elastic body": CYCLE[1],
}


@dataclass(frozen=True)
class GammaFit:
    """Theory against gamma and what boundary elements found.

    theory: columns (n,), gamma and the areas by the keys of NAMES.
    bem: mean and half-width of the 95 % interval, by the same keys.
    fits: by the same keys, (gamma, low, high): where the theory meets the mean and the ends of
        the interval; NaN where it does not for any gamma in the table.
    surfaces: how many the means are taken over.
    """

    theory: dict[str, FloatArray]
    bem: dict[str, tuple[float, float]]
    fits: dict[str, tuple[float, float, float]]
    surfaces: int

    def theory_at(self, key: str, gamma: float) -> float:
        """An area of the theory, between the gammas of the table linearly."""
        return float(np.interp(gamma, self.theory["gamma"], self.theory[key]))

    @property
    def common(self) -> bool:
        """Whether one gamma lies in every interval."""
        low, high = (
            [fit[end] for fit in self.fits.values() if not math.isnan(fit[end])] for end in (1, 2)
        )
        return len(low) == len(self.fits) and max(low) <= min(high)


def fit_gamma(
    bem: dict[str, tuple[float, float]],
    full_contact_diffusion: float,
    mean_pressure: float,
    hardness: float,
    surfaces: int = 1,
) -> GammaFit:
    """The theory's columns and the gamma that meets each area.

    bem: mean and half-width by the keys of NAMES.  Raises InvalidScene.
    """
    from epcontact.persson import gamma_columns

    theory = gamma_columns(full_contact_diffusion, mean_pressure, hardness)
    fits = {}
    for key, (mean, half_width) in bem.items():
        middle, one, other = (
            _crossing(theory["gamma"], theory[key], level)
            for level in (mean, mean - half_width, mean + half_width)
        )
        fits[key] = (middle, min(one, other), max(one, other))
    return GammaFit(theory, bem, fits, surfaces)


def _crossing(x: FloatArray, y: FloatArray, level: float) -> float:
    """The only x at which y, interpolated linearly, has the level; NaN if it is not one alone."""
    above = y > level
    at = np.flatnonzero(above[1:] != above[:-1])
    if at.size != 1:
        return math.nan
    i = int(at[0])
    return float(x[i] + (level - y[i]) * (x[i + 1] - x[i]) / (y[i + 1] - y[i]))


def measure(
    points_per_wavelength: float, bandwidth: int, seeds: range, progress: Progress
) -> GammaFit:
    """Solve the capped and the elastic body on every surface and fit gamma to each area."""
    from epcontact import bem, persson

    results: dict[float, list[ContactResult]] = {scenes.HARDNESS: [], math.inf: []}
    for seed in seeds:
        for hardness, found in results.items():
            progress(f"gamma: seed {seed}, hardness {hardness:g} Pa")
            scene = scenes.rough_scene(points_per_wavelength, seed, bandwidth, hardness)
            found.append(bem.solve(scene, area_tolerance=1e-5))
    capped, elastic = results.values()
    areas = {f"{part}_area": scenes.area_band(capped, part) for part in scenes.PARTS}
    areas["elastic_body_area"] = scenes.area_band(elastic, "total")
    tau = float(persson.full_contact_diffusion(scenes.MODULUS, 1.0))  # the rms slope is 1
    return fit_gamma(areas, tau, scenes.MEAN_PRESSURE, scenes.HARDNESS, len(seeds))


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Areas against gamma, and their deviation from the boundary elements."""
    points, bandwidth = (4, 128) if size == "fast" else (8, 256)
    return draw_fit(measure(points, bandwidth, range(7, 15), progress), points, bandwidth)


def draw_fit(fit: GammaFit, points: float, bandwidth: int) -> tuple[Chart, ...]:
    """The two charts of a fit."""
    gamma = fit.theory["gamma"]
    ends = gamma[[0, -1]]
    areas, deviations = [], []
    for key, name in NAMES.items():
        mean, half_width = fit.bem[key]
        areas.append(Series(f"{name}, theory", gamma, fit.theory[key], line=True))
        level = np.full(2, mean)
        areas.append(
            Series(f"{name}, bem", ends, level, level - half_width, level + half_width, line=True)
        )
        ratio = 100 * (fit.theory[key] / mean - 1)
        width = 100 * half_width / mean * fit.theory[key] / mean
        deviations.append(Series(name, gamma, ratio, ratio - width, ratio + width, line=True))
    told = _told(fit, points, bandwidth)
    colours = {
        f"{name}, {who}": _COLOURS[name] for name in NAMES.values() for who in ("theory", "bem")
    }
    gamma_label, mark = r"energy reduction $\gamma$ (–)", {r"$\gamma$ of the paper": scenes.GAMMA}
    return (
        curves(
            areas,
            x=gamma_label,
            y=r"contact area $A / A_0$ (–)",
            columns=("gamma", "area_fraction"),
            caption=f"Contact areas of the theory against gamma; level lines: {told}",
            colours=colours,
            upright=mark,
        ),
        curves(
            deviations,
            x=gamma_label,
            y="theory over boundary elements, less 1 (%)",
            columns=("gamma", "deviation_percent"),
            caption=f"Deviation of the theory's areas from {told}",
            colours=_COLOURS,
            upright=mark,
            level=0.0,
            limits={"ylim": (-40, 60)},
        ),
    )


def _told(fit: GammaFit, points: float, bandwidth: int) -> str:
    fits = ", ".join(
        f"{NAMES[key]} {g:.3f} ({low:.3f} to {high:.3f})"
        for key, (g, low, high) in fit.fits.items()
    )
    off = ", ".join(
        f"{NAMES[key]} {100 * (fit.theory_at(key, scenes.GAMMA) / mean - 1):+.1f} %"
        for key, (mean, _) in fit.bem.items()
    )
    verdict = "One gamma fits all four." if fit.common else "No single gamma fits all four."
    return (
        f"boundary elements in the continuum limit, mean of {fit.surfaces} surfaces with its "
        f"95 % interval, {points:g} points per shortest wavelength, which is 1/{bandwidth} of the "
        "longest; p0/(E* xi) = 0.05, "
        "hardness/(E* xi) = 0.6 (capped body) or infinite (elastic body). "
        f"Gamma that meets each area, with the interval: {fits}. "
        f"At gamma = {scenes.GAMMA}: {off}. {verdict}"
    )
