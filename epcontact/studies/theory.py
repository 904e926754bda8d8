"""Studies of the theory: its gamma, its magnifications, and the ends of P(sigma)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from epcontact import bem, persson
from epcontact.bem.areas.distribution import end_fits, extrapolated
from epcontact.harness.gates import estimate
from epcontact.output.charts.plot import Plot
from epcontact.output.charts.style import CYCLE, PART_COLOURS
from epcontact.results import ContactResult, PressureDistribution
from epcontact.scene import Scene
from epcontact.studies import paper_scene as paper
from epcontact.studies.frame import (
    Charts,
    Ints,
    Rows,
    Say,
    listed,
    mean_with_interval,
    rows,
    study,
)
from epcontact.studies.paper_scene import HARDNESS, MEAN_PRESSURE, PARTS, rough_scene
from epcontact.surfaces import filtered

# --- gamma
# ---------------------------------------------------------------------------------------

AREAS = ("total", "elastic", "plastic", "elastic body")
_AREA = ("area_fraction", r"contact area $A / A_0$ (–)")


def theory_areas() -> pd.DataFrame:
    """Areas of the paper's scene by the theory: columns gamma and AREAS, one row for
    each gamma.
    """
    diffusion = float(
        persson.full_contact_diffusion(paper.MODULUS, 1.0)
    )  # the rms slope is 1
    gammas, laws = np.linspace(0.3, 1.0, 141), paper.LAWS.values()
    capped, body = (
        persson.areas(gammas * diffusion, MEAN_PRESSURE, law) for law in laws
    )
    parts = {part: getattr(capped, part) for part in PARTS}
    return pd.DataFrame({"gamma": gammas} | parts | {AREAS[3]: body.total})


def fit_gamma(
    table: pd.DataFrame, measured: Mapping[Any, Any]
) -> tuple[float, float, float]:
    """The gamma at which `theory_areas` have a measured area, and its interval; NaN for
    none.
    """
    rising = table.sort_values(measured["area"])
    levels = [measured[f"area_fraction{end}"] for end in ("", "_low", "_high")]
    beyond = {"left": math.nan, "right": math.nan}
    found = np.interp(
        levels, rising[measured["area"]], rising["gamma"], **beyond
    ).tolist()
    return found[0], min(found[1:]), max(found[1:])


def one_gamma(fits: Sequence[tuple[float, float, float]]) -> bool:
    """True if one gamma is within the intervals of all areas."""
    _, lows, highs = np.transpose(fits)
    return bool(lows.max() <= highs.min())  # False with NaN


@study("gamma", points=8, bandwidth=256)
def gamma(
    say: Say, points: int = 4, bandwidth: int = 128, seeds: Ints = range(7, 15)
) -> Charts:
    """Areas of the theory against its energy reduction, beside boundary elements.

    The theory has one parameter, a constant gamma in G = gamma E*^2 xi^2 / 8, and it
    has each of four measured areas at a gamma of its own.  If the intervals of these
    gammas do not overlap, no single gamma fits.  The elastic body is the paper's scene
    without hardness.
    """

    def row(seed: int, law: str) -> Rows:
        return paper.area_rows(
            paper.settled(rough_scene(points, seed, bandwidth, paper.LAWS[law]))
        )

    table = rows(say, row, seed=seeds, law=paper.LAWS)
    table["area"] = table["part"].where(
        table["law"] == "capped", table["part"] + " body"
    )
    measured = mean_with_interval(table, _AREA[0], ["area"], "estimated_error")
    measured = measured[measured["area"].isin(AREAS)]
    exact = theory_areas()
    fits = {one["area"]: fit_gamma(exact, one) for one in measured.to_dict("records")}
    told = ", ".join(
        f"{a} {g:.3f} ({low:.3f} to {high:.3f})" for a, (g, low, high) in fits.items()
    )
    told += "" if one_gamma([*fits.values()]) else ": no single gamma fits all four"
    curves = exact.melt("gamma", list(AREAS), "area", _AREA[0])
    levels = measured.merge(exact["gamma"].iloc[[0, -1]], how="cross")
    both = pd.concat([curves.assign(method="theory"), levels.assign(method="bem")])
    both = both.sort_values(
        "area", key=lambda area: area.map(AREAS.index), kind="stable"
    )
    x, colours = (
        ("gamma", r"energy reduction $\gamma$ (–)"),
        PART_COLOURS | {AREAS[3]: CYCLE[1]},
    )
    plot = Plot(
        x, _AREA, ("area", "method"), style="curve", colour="area", colours=colours
    )
    plot = replace(plot, mark="method", upright={r"$\gamma$ of the paper": paper.GAMMA})
    yield plot, both, f"Contact areas, which the theory meets at the gammas {told}"
    off = curves.merge(measured, on="area", suffixes=("", "_bem"))
    for end, bound in (("", "_bem"), ("_low", "_low"), ("_high", "_high")):
        # The interval of the mean gives that of the ratio, because the theory has no
        # interval.
        ratio = (
            off["area_fraction"]
            / off["area_fraction_bem"] ** 2
            * off[f"area_fraction{bound}"]
        )
        off[f"deviation_percent{end}"] = 100 * (ratio - 1)
    y = ("deviation_percent", "theory over boundary elements, less 1 (%)")
    plot = replace(
        plot, y=y, series=("area",), mark="", level=0.0, limits={"ylim": (-40, 60)}
    )
    yield plot, off, f"Deviation of the theory's areas, zero at the gammas {told}"


# --- magnification
# -------------------------------------------------------------------------------

#: Smallest area, over the nominal one, for a ratio: smaller areas are a few grid
#: points.
_SMALLEST_AREA = 0.01
_DENSITY = ("pressure_GPa", "density_per_GPa")


def _curves(body: persson.Theory, magnifications: Sequence[float]) -> pd.DataFrame:
    """The theory's areas at the magnifications: part, magnification, area_fraction."""
    curve = body.magnification_curve(MEAN_PRESSURE, magnifications)
    areas = pd.DataFrame(
        {name: getattr(curve, name) for name in ("magnification", *PARTS)}
    )
    return areas.melt("magnification", list(PARTS), "part", _AREA[0])


@study("magnification", points=8, bandwidth=256, count=10)
def magnification(
    say: Say,
    points: int = 4,
    bandwidth: int = 64,
    count: int = 13,
    seeds: Ints = range(7, 11),
) -> Charts:
    """Theory against boundary elements on one surface filtered at many cut-offs.

    A surface filtered at the wave number zeta q_0 is what the theory sees at the
    magnification zeta.  Surfaces of random phases share their amplitudes, and so the
    theory's spectrum.  Areas are in the continuum limit, densities of the pressure raw;
    the scene is the paper's.
    """
    cut_offs = np.geomspace(1.5, bandwidth, count).round(1).tolist()
    # Five of them, evenly spaced up to the last.
    distributed = [
        cut_offs[round(i)] for i in np.linspace(0, count - 1, min(count, 6))
    ][-5:]
    densities = []

    def row(seed: int, magnification: float) -> Rows:
        scene = rough_scene(points, seed, bandwidth)
        surface = filtered(scene.surface, magnification * paper.LOWEST)
        result = paper.settled(replace(scene, surface=surface))
        if magnification in distributed:
            density = paper.binned(result.distribution, 1e9, _DENSITY)
            densities.append(density.assign(magnification=magnification))
        return paper.area_rows(result)

    table, keys = (
        rows(say, row, seed=seeds, magnification=cut_offs),
        ["part", "magnification"],
    )
    areas = mean_with_interval(table, _AREA[0], keys, "estimated_error")
    body = paper.theory_of(rough_scene(points, seeds[0], bandwidth))
    curves = _curves(body, np.geomspace(1, cut_offs[-1], 1000).tolist())
    measured = areas.assign(
        area_fraction_low=areas["area_fraction_low"].clip(lower=1e-12)
    )
    both = pd.concat([curves.assign(method="theory"), measured.assign(method="bem")])
    x = ("magnification", r"magnification $\zeta = q / q_0$ (–)")
    plot = Plot(
        x, _AREA, ("part", "method"), {"theory": "curve", "bem": "marks"}, colour="part"
    )
    plot = replace(plot, colours=PART_COLOURS, log="xy", limits={"ylim": (1e-3, 1.3)})
    yield plot, both, "Contact areas"
    off = areas.merge(_curves(body, cut_offs), on=keys, suffixes=("", "_theory"))
    off = off[off["area_fraction_theory"] > _SMALLEST_AREA]
    for end in ("", "_low", "_high"):
        ratio = off[f"area_fraction{end}"] / off["area_fraction_theory"]
        off[f"deviation_percent{end}"] = 100 * (ratio - 1)
    y = ("deviation_percent", "boundary elements over theory, less 1 (%)")
    deviation = replace(plot, y=y, series=("part",), log="x", limits={}, level=0.0)
    yield deviation, off, f"Deviation of the areas, where they exceed {_SMALLEST_AREA}"
    found = pd.concat(densities).groupby(["magnification", _DENSITY[0]], sort=False)
    tables = []
    for zeta in distributed:
        at = body.pressure_curve(MEAN_PRESSURE, zeta)
        whole = PressureDistribution(at.pressure, at.cumulative, at.plastic)
        density = paper.binned(whole, 1e9, _DENSITY)
        tables.append(density.assign(method="theory", magnification=zeta))
    both = pd.concat([*tables, found.mean().reset_index().assign(method="bem")])
    both = both.sort_values("magnification", kind="stable")
    both["zeta"] = both["magnification"].map("zeta = {:.3g}".format)
    x = (_DENSITY[0], r"contact pressure $\sigma$ (GPa)")
    y = (_DENSITY[1], r"density $P(\sigma, \zeta)$ (1/GPa)")
    plot = replace(plot, x=x, y=y, series=("zeta", "method"), colour="zeta", log="y")
    limits = {"ylim": (1e-5, None), "xlim": (0, HARDNESS / 1e9)}
    yield (
        replace(plot, limits=limits),
        both,
        "Density of the pressure in elastic contact",
    )


# --- the ends of P(sigma)
# ------------------------------------------------------------------------

ENDS = ("0+", "hardness-")
#: The window as a share of the hardness, of the density that at COARSEST points.
WINDOW, COARSEST = 0.2, 4
DENSITY, SLOPE = "relative_density", "relative_slope"
#: Names and labels of the figures, and the power of the spacing with which each has its
#: limit.
FIGURES = {
    DENSITY: ("density", r"density at the end, $P\,\sigma_\mathrm{P}$ (–)", 0.5),
    SLOPE: (
        "mean slope",
        rf"slope within {WINDOW:g} of the end, $P'\,\sigma_\mathrm{{P}}^2$ (–)",
        1.0,
    ),
}
_RELATIVE = ("relative_pressure", DENSITY)


@study("pressures", bandwidth=128)
def pressures(
    say: Say,
    bandwidth: int = 32,
    points: Ints = (4, 8, 16, 32),
    seeds: Ints = range(7, 15),
) -> Charts:
    """P(sigma) at 0 and at the hardness, raw and extrapolated, beside the theory.

    The density is the value at the end of a straight line that has the area and the
    mean pressure of the points within a window, which shrinks as the root of the
    spacing, like the pressure next to a rim; the mean slope is 2 F/w^2 of the corrected
    area F within a window w.  Each is extrapolated for every surface to ever finer
    grids, with the root of the spacing or, the mean slope, with the spacing.  Units:
    the hardness.
    """
    densities = []

    def row(seed: int, points_per_wavelength: int) -> Rows:
        scene = rough_scene(points_per_wavelength, seed, bandwidth)
        result = bem.solve(scene, area_tolerance=1e-6)
        density = paper.binned(result.distribution, HARDNESS, _RELATIVE)
        densities.append(density.assign(points_per_wavelength=points_per_wavelength))
        return end_figures(result, points_per_wavelength)

    figures = rows(say, row, seed=seeds, points_per_wavelength=points)
    scene = rough_scene(points[0], seeds[0], bandwidth)
    by = ["points_per_wavelength", _RELATIVE[0]]
    measured = (
        pd.concat(densities).groupby(by, sort=False)[_RELATIVE[1]].mean().reset_index()
    )
    measured["series"] = measured[by[0]].map("{:g} points a wavelength".format)
    theory = paper.binned(paper.by_theory(scene).distribution, HARDNESS, _RELATIVE)
    x = (_RELATIVE[0], r"contact pressure over hardness, $\sigma / \sigma_\mathrm{P}$")
    y = (_RELATIVE[1], r"density $P(\sigma)\,\sigma_\mathrm{P}$ (–)")
    plot = Plot(x, y, style="curve", limits={"ylim": (0, None), "xlim": (0, 1)})
    yield (
        plot,
        pd.concat([theory.assign(series="persson"), measured]),
        "Density of the pressure",
    )
    exact = pd.DataFrame(theory_figures(scene))
    x = ("root_of_spacing", "root of 1 / points per shortest wavelength (–)")
    figures[x[0]] = 1 / np.sqrt(figures["points_per_wavelength"])
    ends = pd.Series([0.0, figures[x[0]].max()], name=x[0])
    for figure, (name, label, _) in FIGURES.items():
        means = mean_with_interval(figures, figure, ["end", x[0]])
        limits = grid_limits(figures, figure).assign(
            **{x[0]: 0.0}, kind="limit", style="open"
        )
        levels = exact.merge(ends, how="cross").assign(method="persson", style="curve")
        levels = levels[levels[figure] != 0]  # which is where the dotted line is
        both = pd.concat([means, limits, levels]).sort_values("end", kind="stable")
        both[["method", "kind"]] = both[["method", "kind"]].fillna("")
        told = limits.assign(limit=limits[figure], theory=exact[figure])
        told = listed(told, "{end} {limit:+.3g} (theory {theory:.3g})")
        title = f"The {name} of P at the ends, with limits for ever finer grids: {told}"
        series = ("method", "end", "kind")
        yield Plot(x, (figure, label), series, colour="end", level=0.0), both, title


def end_figures(result: ContactResult, points_per_wavelength: float) -> Rows:
    """DENSITY and SLOPE of a solution on a grid, a row for each end."""
    relative = result.fields["pressure"] / HARDNESS
    areas = result.final.areas["raw"], result.final.areas["corrected"]
    shrinking = WINDOW * math.sqrt(COARSEST / points_per_wavelength)
    near, wide = (
        end_fits(relative, 1.0, window, areas) for window in (shrinking, WINDOW)
    )
    return [
        {"end": end, DENSITY: one.density, SLOPE: other.continuum_slope}
        for end, one, other in zip(ENDS, near, wide, strict=True)
    ]


def theory_figures(scene: Scene) -> Rows:
    """The theory's figures for the spectrum of the scene's surface, as `end_figures`
    has them.
    """
    final = paper.by_theory(scene).final
    G, p0 = final.quantities["diffusion"] / HARDNESS**2, scene.load.final / HARDNESS
    below, above = persson.pressure_cumulative(
        np.array([WINDOW, 1 - WINDOW]), G, p0, 1.0
    )
    shares = zip(ENDS, (below, final.areas["raw"].elastic - above), strict=True)
    return [
        {"end": e, DENSITY: 0.0, SLOPE: float(2 * share / WINDOW**2)}
        for e, share in shares
    ]


def grid_limits(figures: pd.DataFrame, figure: str) -> pd.DataFrame:
    """Extrapolate a figure to ever finer grids, surface by surface: the limit at each
    end, with the error of scatter and of fit together.  Slopes are taken without the
    coarsest grid, whose rims fill the window.
    """
    found, order = [], FIGURES[figure][2]
    for end, group in figures.groupby("end", sort=False):
        table = group.pivot(
            index="seed", columns="points_per_wavelength", values=figure
        )
        table = table if figure == DENSITY else table.iloc[:, 1:]
        n = table.columns.to_numpy()
        limit = estimate([extrapolated(n, row, order)[0] for row in table.to_numpy()])
        # The error of the fit is common to all surfaces: it does not fall with their
        # number.
        error = math.hypot(
            limit.half_width, extrapolated(n, table.mean().to_numpy(), order)[1]
        )
        found.append((end, limit.mean, limit.mean - error, limit.mean + error))
    return pd.DataFrame(
        found, columns=["end", figure, f"{figure}_low", f"{figure}_high"]
    )
