"""Studies of the theory: its series and cells, its parameter gamma, and its magnifications."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy.special import erf, erfc

from epcontact import bem, persson
from epcontact.output.charts.curves import pressure_density
from epcontact.output.charts.plot import Plot
from epcontact.output.charts.style import CYCLE, PART_COLOURS
from epcontact.persson.series import SWITCH
from epcontact.results import FloatArray, PressureDistribution
from epcontact.scene import SelfAffineSpectrum
from epcontact.studies.frame import Charts, Say, mean_with_interval, rows, study
from epcontact.studies.paper_scene import (
    GAMMA,
    HARDNESS,
    LAWS,
    LOWEST,
    MEAN_PRESSURE,
    MODULUS,
    PARTS,
    area_rows,
    rough_scene,
)
from epcontact.surfaces import filtered

# --- its numerics --------------------------------------------------------------------------------

#: p0/sigma_P of the paper, and its G/sigma_P^2 with S = gamma.
LOAD_SHARE = MEAN_PRESSURE / HARDNESS
PAPER_DIFFUSION = GAMMA * float(persson.full_contact_diffusion(MODULUS / HARDNESS, 1.0))
MOST_TERMS, TARGET = 40, 1e-12


def eigenfunction_sums(diffusion: float, load_share: float, terms: int) -> FloatArray:
    """The elastic area at G/sigma_P^2 and p0/sigma_P by the first 1, 2, ... eigenfunctions.

    (4/pi) sum_{n = 1, 3, ...} sin(n pi s) exp(-(n pi c / 2)^2) / n with c = 2 sqrt(G)/sigma_P and
    the smaller of p0/sigma_P and 1 - p0/sigma_P as s; of shape (terms,).
    """
    n, s = 2 * np.arange(terms) + 1, min(load_share, 1 - load_share)
    decay = np.exp(-(n**2) * math.pi**2 * diffusion)
    return np.cumsum(4 / (math.pi * n) * np.sin(n * math.pi * s) * decay)


def image_sums(diffusion: float, load_share: float, terms: int) -> FloatArray:
    """The same by the first pairs of images,
    erf(s/c) + sum_{k = 1, 2, ...} (-1)^k [erfc((k - s)/c) - erfc((k + s)/c)]."""
    s, c = min(load_share, 1 - load_share), 2 * math.sqrt(diffusion)
    k = np.arange(1, terms)
    pairs = (-1.0) ** k * (erfc((k - s) / c) - erfc((k + s) / c))
    return np.cumsum(np.concatenate([[erf(s / c)], pairs]))


def series_errors(diffusions: Sequence[float], terms: int = MOST_TERMS) -> pd.DataFrame:
    """Relative error of the elastic area by the first 1, 2, ... terms of each series."""
    tables = []
    for G in diffusions:
        exact = float(persson.areas(G, LOAD_SHARE, 1.0).elastic)
        for name, sums in (("eigenfunctions", eigenfunction_sums), ("images", image_sums)):
            error = np.abs(sums(G, LOAD_SHARE, terms) / exact - 1)
            columns = {"terms": np.arange(1, terms + 1), "relative_error": error}
            tables.append(pd.DataFrame({"relative_diffusion": G, "series": name} | columns))
    return pd.concat(tables, ignore_index=True)


def terms_needed(errors: pd.DataFrame) -> pd.DataFrame:
    """The terms after which each series stays within TARGET; NaN if it never does."""
    late = errors["terms"].where(~(errors["relative_error"] <= TARGET), 0)
    groups = late.groupby([errors["relative_diffusion"], errors["series"]], sort=False)
    needed = groups.max() + 1.0
    return needed.where(needed <= errors["terms"].max()).reset_index()


def finite_volume_error(cells: int) -> float:
    """Relative error of the plastic area of the paper's scene on so many cells and steps."""
    spectrum = SelfAffineSpectrum(0.8, LOWEST, 4 * LOWEST, 256 * LOWEST, 1.0)
    roughness = persson.analytic_roughness(spectrum)
    body = persson.Theory(roughness, MODULUS, persson.EnergyReduction(GAMMA))
    exact = float(persson.areas(PAPER_DIFFUSION, LOAD_SHARE, 1.0).plastic)
    curve = persson.hardness_curve(
        body,
        MEAN_PRESSURE,
        lambda zeta: np.full_like(zeta, HARDNESS),
        [256.0],
        resolution=(cells, cells),
    )
    return abs(float(curve.areas.plastic[-1]) / exact - 1)


@study(
    "theory", fast={"cells": (64, 128, 256, 512)}, full={"cells": (64, 128, 256, 512, 1024, 2048)}
)
def theory(say: Say, cells: Sequence[int]) -> Charts:
    """Error of the theory's series against their terms, of its cells against their number."""
    errors = series_errors([0.01, PAPER_DIFFUSION, 1.0], terms=12)
    errors["relative_error"] = errors["relative_error"].clip(lower=np.finfo(float).eps / 4)
    label = r"$G/\sigma_\mathrm{{P}}^2$ = {:.3g}"
    errors["diffusion"] = errors["relative_diffusion"].map(label.format)
    yield (
        Plot(
            ("terms", "terms (–)"),
            ("relative_error", "relative error of the elastic area (–)"),
            series=("series", "diffusion"),
            colour="relative_diffusion",
            log="y",
            ticks=[1, 2, 4, 6, 8, 10, 12],
        ),
        errors,
        "Error of the theory's elastic area against the number of terms, at p0/sigma_P = 1/12 and "
        f"three G/sigma_P^2, of which {PAPER_DIFFUSION:.3g} is that of the paper's scene: images "
        "are short at small G, eigenfunctions at large G. Errors below a quarter of float64's "
        "spacing, 5.6e-17, are drawn there. Reference: the shorter of both, right to 1e-10.",
    )
    yield (
        Plot(
            ("relative_diffusion", r"$G / \sigma_\mathrm{P}^2$ (–)"),
            ("terms", f"terms to a relative error of {TARGET:g} (–)"),
            style="curve",
            log="x",
            upright={"change": SWITCH**2 / 4},
            limits={"ylim": (0, 20), "yticks": range(0, 21, 5)},
        ),
        terms_needed(series_errors(np.geomspace(1e-3, 10, 81).tolist())),
        f"Terms that each series of the elastic area needs to be right to {TARGET:g} of itself and "
        f"stay so, at p0/sigma_P = 1/12. Where one needs more than {MOST_TERMS} or its terms "
        "cancel, it is not drawn. The package changes from images to eigenfunctions at the dotted "
        "line.",
    )
    found = rows(say, lambda cells: {"relative_error": finite_volume_error(cells)}, cells=cells)
    yield (
        Plot(
            ("cells", "cells of the pressure, and steps of the magnification (–)"),
            ("relative_error", "relative error of the plastic area (–)"),
            log="xy",
            ticks=cells,
            orders=["finite volumes"],
        ),
        found.assign(series="finite volumes"),
        "Error of the plastic area by finite volumes, which solve the theory where the hardness "
        "depends on the magnification, here with the constant hardness of the paper's scene, "
        "against the closed form, which is right to 1e-10.",
    )


# --- gamma ---------------------------------------------------------------------------------------

AREAS = ("total", "elastic", "plastic", "elastic body")


def theory_areas() -> pd.DataFrame:
    """Areas of the paper's scene by the theory: columns gamma and AREAS, one row for each gamma."""
    diffusion = float(persson.full_contact_diffusion(MODULUS, 1.0))  # the rms slope is 1
    table = pd.DataFrame(persson.gamma_columns(diffusion, MEAN_PRESSURE, HARDNESS))
    return table.rename(columns={f"{area.replace(' ', '_')}_area": area for area in AREAS})


def fit_gamma(table: pd.DataFrame, measured: Mapping[str, float]) -> tuple[float, float, float]:
    """The gamma at which the theory has a measured area, and its interval; NaN where none is.

    `table` is that of `theory_areas`; `measured` has area, area_fraction, area_fraction_low and
    area_fraction_high.
    """
    gamma, areas = table["gamma"].to_numpy(), table[measured["area"]].to_numpy()
    middle, *ends = (
        _crossing(gamma, areas, measured[f"area_fraction{end}"]) for end in ("", "_low", "_high")
    )
    return middle, min(ends), max(ends)


def _crossing(x: FloatArray, y: FloatArray, level: float) -> float:
    """The only x at which y, interpolated linearly, has the level; NaN if there is not one."""
    above = y > level
    crossings = np.flatnonzero(above[1:] != above[:-1])
    if crossings.size != 1:
        return math.nan
    i = crossings[0]
    return float(x[i] + (level - y[i]) * (x[i + 1] - x[i]) / (y[i + 1] - y[i]))


@study("gamma", fast={"points": 4, "bandwidth": 128}, full={"points": 8, "bandwidth": 256})
def gamma(say: Say, points: int, bandwidth: int, seeds: Sequence[int] = range(7, 15)) -> Charts:
    """Areas of the theory against its energy reduction, beside boundary elements.

    The theory has one parameter, a constant gamma in G = gamma E*^2 xi^2 / 8, and it has each of
    four measured areas at a gamma of its own.  If the intervals of these gammas do not overlap, no
    single gamma fits.
    """

    def row(seed: int, law: str) -> list[dict[str, object]]:
        scene = rough_scene(points, seed, bandwidth, LAWS[law])
        return area_rows(bem.solve(scene, area_tolerance=1e-5))

    table = rows(say, row, seed=seeds, law=LAWS)
    table["area"] = table["part"].where(table["law"] == "capped", table["part"] + " body")
    measured = mean_with_interval(table, "area_fraction", ["area"], "estimated_error")
    measured = measured[measured["area"].isin(AREAS)]
    exact = theory_areas()
    fits = {one["area"]: fit_gamma(exact, one) for one in measured.to_dict("records")}
    curves = exact.melt("gamma", list(AREAS), "area", "area_fraction")
    levels = measured.merge(exact["gamma"].iloc[[0, -1]], how="cross")
    both = pd.concat([curves.assign(method="theory"), levels.assign(method="bem")])
    deviations = curves.merge(measured, on="area", suffixes=("", "_bem"))
    for end, bound in (("", "_bem"), ("_low", "_low"), ("_high", "_high")):
        # The interval of the mean gives that of the ratio, because the theory has no interval.
        ratio = deviations["area_fraction"] / deviations["area_fraction_bem"] ** 2
        deviations[f"deviation_percent{end}"] = 100 * (
            ratio * deviations[f"area_fraction{bound}"] - 1
        )
    plot = Plot(
        ("gamma", r"energy reduction $\gamma$ (–)"),
        ("area_fraction", r"contact area $A / A_0$ (–)"),
        series=("area", "method"),
        style="curve",
        colour="area",
        colours=PART_COLOURS | {"elastic body": CYCLE[1]},
        upright={r"$\gamma$ of the paper": GAMMA},
    )
    caption = (
        f"boundary elements in the continuum limit, mean with its 95 % interval of {len(seeds)} "
        f"surfaces, {points} points per shortest wavelength, which is 1/{bandwidth} of the "
        "longest; p0/(E* xi) = 0.05, hardness/(E* xi) = 0.6 (capped body) or infinite (elastic "
        "body). Gamma that meets each area, with the interval: "
        + ", ".join(f"{a} {g:.3f} ({low:.3f} to {high:.3f})" for a, (g, low, high) in fits.items())
        + ("." if one_gamma(fits.values()) else ": no single gamma fits all four.")
    )
    by_area = both.sort_values("area", key=lambda area: area.map(AREAS.index), kind="stable")
    yield plot, by_area, f"Contact areas of the theory against gamma; level lines: {caption}"
    deviation = replace(
        plot,
        y=("deviation_percent", "theory over boundary elements, less 1 (%)"),
        series=("area",),
        level=0.0,
        limits={"ylim": (-40, 60)},
    )
    yield deviation, deviations, f"Deviation of the theory's areas from {caption}"


def one_gamma(fits: Iterable[tuple[float, float, float]]) -> bool:
    """True if one gamma is within the intervals of all areas."""
    _, lows, highs = np.transpose([*fits])
    return bool(lows.max() <= highs.min())  # False with NaN


# --- magnification -------------------------------------------------------------------------------

BINS = 40
#: Smallest area, over the nominal one, for a ratio: smaller areas are a few grid points.
_SMALLEST_AREA = 0.01


def five_of(values: Sequence[float]) -> list[float]:
    """Five of the values, evenly spaced up to the last; all if there are fewer."""
    if len(values) <= 5:
        return list(values)
    return [values[round(i)] for i in np.linspace(0, len(values) - 1, 6)[1:]]


def _binned(distribution: PressureDistribution | None) -> pd.DataFrame:
    assert distribution is not None
    pressure, density = pressure_density(distribution, BINS, HARDNESS)
    return pd.DataFrame({"pressure_GPa": pressure / 1e9, "density_per_GPa": density * 1e9})


def _curves(body: persson.Theory, magnifications: Sequence[float]) -> pd.DataFrame:
    """The theory's areas at the magnifications: part, magnification, area_fraction."""
    curve = body.magnification_curve(MEAN_PRESSURE, magnifications)
    areas = pd.DataFrame({part: getattr(curve, part) for part in PARTS})
    areas["magnification"] = curve.magnification
    return areas.melt("magnification", list(PARTS), "part", "area_fraction")


@study(
    "magnification",
    fast={"points": 4, "bandwidth": 64, "count": 13},
    full={"points": 8, "bandwidth": 256, "count": 10},
)
def magnification(
    say: Say, points: int, bandwidth: int, count: int, seeds: Sequence[int] = range(7, 11)
) -> Charts:
    """Theory against boundary elements on one surface filtered at many cut-offs.

    A surface filtered at the wave number zeta q_0 is what the theory sees at the magnification
    zeta.  Surfaces of random phases share their amplitudes, and so the theory's spectrum.
    """
    cut_offs = np.geomspace(1.5, bandwidth, count).round(1).tolist()
    distributed, densities = five_of(cut_offs), []

    def row(seed: int, magnification: float) -> list[dict[str, object]]:
        whole = rough_scene(points, seed, bandwidth)
        scene = replace(whole, surface=filtered(whole.surface, magnification * LOWEST))
        result = bem.solve(scene, area_tolerance=1e-5)
        if magnification in distributed:
            densities.append(_binned(result.distribution).assign(magnification=magnification))
        return area_rows(result)

    table = rows(say, row, seed=seeds, magnification=cut_offs)
    areas = mean_with_interval(table, "area_fraction", ["part", "magnification"], "estimated_error")
    scene = rough_scene(points, seeds[0], bandwidth)
    body = persson.Theory.of_scene(scene, energy_reduction=GAMMA, spectrum="surface")
    of_scene = (
        f"of the paper's roughness, material and load (p0/(E* xi) = 0.05 and hardness/(E* xi) = "
        f"0.6 at the last magnification, gamma = {GAMMA}). Boundary elements: each surface "
        f"filtered at the wave number zeta q_0, in the continuum limit, mean of {len(seeds)} "
        "surfaces with its 95 % interval. Theory: with the spectrum of the very same modes."
    )
    plot = Plot(
        ("magnification", r"magnification $\zeta = q / q_0$ (–)"),
        ("area_fraction", r"contact area $A / A_0$ (–)"),
        series=("part", "method"),
        styles={"theory": "curve", "bem": "marks"},
        colour="part",
        colours=PART_COLOURS,
        log="xy",
        limits={"ylim": (1e-3, 1.3)},
    )
    curves = _curves(body, np.geomspace(1, cut_offs[-1], 1000).tolist())
    measured = areas.assign(area_fraction_low=areas["area_fraction_low"].clip(lower=1e-12))
    both = pd.concat([curves.assign(method="theory"), measured.assign(method="bem")])
    yield plot, both, f"Contact areas against magnification {of_scene}"
    exact = _curves(body, cut_offs)
    deviations = areas.merge(exact, on=["part", "magnification"], suffixes=("", "_theory"))
    deviations = deviations[deviations["area_fraction_theory"] > _SMALLEST_AREA]
    for end in ("", "_low", "_high"):
        ratio = deviations[f"area_fraction{end}"] / deviations["area_fraction_theory"]
        deviations[f"deviation_percent{end}"] = 100 * (ratio - 1)
    deviation = replace(
        plot,
        y=("deviation_percent", "boundary elements over theory, less 1 (%)"),
        series=("part",),
        log="x",
        limits={},
        level=0.0,
    )
    yield (
        deviation,
        deviations,
        "Deviation of the boundary elements from the theory, where the theory's area exceeds "
        f"{_SMALLEST_AREA}, {of_scene}",
    )
    bins = pd.concat(densities).groupby(["magnification", "pressure_GPa"], sort=False)
    theories = [
        _binned(PressureDistribution(at.pressure, at.cumulative, at.plastic)).assign(
            magnification=zeta
        )
        for zeta in distributed
        for at in [body.pressure_curve(MEAN_PRESSURE, zeta)]
    ]
    both = pd.concat(
        [
            pd.concat(theories).assign(method="theory"),
            bins["density_per_GPa"].mean().reset_index().assign(method="bem"),
        ]
    ).sort_values("magnification", kind="stable")
    yield (
        replace(
            plot,
            x=("pressure_GPa", r"contact pressure $\sigma$ (GPa)"),
            y=("density_per_GPa", r"density $P(\sigma, \zeta)$ (1/GPa)"),
            series=("zeta", "method"),
            colour="zeta",
            log="y",
            limits={"ylim": (1e-5, None), "xlim": (0, HARDNESS / 1e9)},
        ),
        both.assign(zeta=both["magnification"].map("zeta = {:.3g}".format)),
        "Density of the pressure in elastic contact at several magnifications, mean over "
        f"{BINS} bins of the raw grid values, which have no continuum limit, {of_scene}",
    )
