"""Studies of the theory: its gamma and its magnifications."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from epcontact import persson
from epcontact.output.charts.plot import Axis, Plot
from epcontact.output.charts.style import CYCLE, PART_COLOURS
from epcontact.results import PressureDistribution
from epcontact.studies import paper_scene as paper
from epcontact.studies.frame import (
    Charts,
    Ints,
    Rows,
    Say,
    mean_with_interval,
    study,
    tabulate,
)
from epcontact.surfaces import filtered

# --- gamma

#: The areas that the theory must have: of the paper's scene, and of the body without
#: hardness.
ELASTIC_BODY = "elastic body"
AREAS = (*paper.PARTS, ELASTIC_BODY)
_AREA = Axis("area_fraction", r"contact area $A / A_0$ (–)")
#: The endings of a column and of the columns of its interval.
_ENDS = ("", "_low", "_high")


def theory_areas() -> pd.DataFrame:
    """Return the areas of the paper's scene by the theory.

    Columns: gamma and AREAS, with a row for each gamma.
    """
    tau = float(
        persson.full_contact_diffusion(paper.MODULUS, 1.0)
    )  # the rms slope is 1
    gammas = np.linspace(0.3, 1.0, 141)
    capped = persson.areas(gammas * tau, paper.MEAN_PRESSURE, paper.HARDNESS)
    elastic = persson.areas(gammas * tau, paper.MEAN_PRESSURE)
    columns = {"gamma": gammas}
    for part in paper.PARTS:
        columns[part] = getattr(capped, part)
    columns[ELASTIC_BODY] = elastic.total
    return pd.DataFrame(columns)


def fit_gamma(
    table: pd.DataFrame, measured: Mapping[Any, Any]
) -> tuple[float, float, float]:
    """Return the gamma at which the theory has a measured area, and its interval.

    gamma is the theory's energy reduction.

    Args:
        table: The areas of `theory_areas`.
        measured: A row with `area` (name of a column of `table`), `area_fraction`, and
            the ends `area_fraction_low` and `area_fraction_high` of its interval.

    Returns:
        The gamma, and the lower and upper end of its interval; NaN for none.
    """
    rising = table.sort_values(measured["area"])
    fits = np.interp(
        [measured[f"area_fraction{end}"] for end in _ENDS],
        rising[measured["area"]],
        rising["gamma"],
        left=math.nan,
        right=math.nan,
    )
    gamma, first_end, second_end = fits.tolist()
    return gamma, min(first_end, second_end), max(first_end, second_end)


def one_gamma(fits: Sequence[tuple[float, float, float]]) -> bool:
    """Return whether one gamma lies within the intervals of all fits.

    `fits` are those of `fit_gamma`: gamma, lower and upper end of its interval.  The
    result is False if one of them is NaN.
    """
    _, lows, highs = np.transpose(fits)
    return bool(lows.max() <= highs.min())


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
        """Return rows of the areas of one surface by boundary elements.

        `law` is "capped" or "elastic", and `seed` that of the surface.  The rows are
        those of `paper_scene.area_rows`.
        """
        scene = paper.rough_scene(points, seed, bandwidth, paper.LAWS[law])
        return paper.area_rows(paper.solve_bem(scene))

    table = tabulate(say, row, seed=seeds, law=paper.LAWS)
    is_capped = table["law"] == "capped"
    table["area"] = table["part"].where(is_capped, table["part"] + " body")
    measured = mean_with_interval(table, _AREA.column, ["area"], "estimated_error")
    measured = measured[measured["area"].isin(AREAS)]
    by_theory = theory_areas()
    fits = {row["area"]: fit_gamma(by_theory, row) for _, row in measured.iterrows()}
    listed = []
    for area, (best, low, high) in fits.items():
        listed.append(f"{area} {best:.3f} ({low:.3f} to {high:.3f})")
    gammas = ", ".join(listed)
    if not one_gamma([*fits.values()]):
        gammas += ": no single gamma fits all four"

    curves = by_theory.melt("gamma", list(AREAS), "area", _AREA.column)
    off = curves.merge(measured, on="area", suffixes=("", "_bem"))
    for end, bound in zip(_ENDS, ("_bem", "_low", "_high"), strict=True):
        # The interval of the mean gives that of the ratio, because the theory has no
        # interval.
        by_bem = off["area_fraction_bem"]
        ratio = off["area_fraction"] / by_bem**2 * off[f"area_fraction{bound}"]
        off[f"deviation_percent{end}"] = 100 * (ratio - 1)
    plot = Plot(
        Axis("gamma", r"energy reduction $\gamma$ (–)"),
        Axis("deviation_percent", "theory over boundary elements, less 1 (%)"),
        ("area",),
        style="curve",
        colour="area",
        colours=PART_COLOURS | {ELASTIC_BODY: CYCLE[1]},
        level=0.0,
        limits={"ylim": (-40, 60)},
        upright={r"$\gamma$ of the paper": paper.GAMMA},
    )
    caption = (
        "Which energy reduction gives the areas of boundary elements? The theory has "
        f"them at the gammas {gammas}."
    )
    yield plot, off, caption


# --- magnification

#: Smallest area over the nominal one whose ratio is shown; a smaller area is a few grid
#: points.
_SMALLEST_AREA = 0.01
_DENSITY = ("pressure_GPa", "density_per_GPa")
#: Number of cut-offs whose distribution of the pressure is shown.
_DISTRIBUTIONS = 5


def _curves(body: persson.Theory, magnifications: Sequence[float]) -> pd.DataFrame:
    """Return the theory's contact areas at several magnifications.

    The columns are part (total, elastic, plastic), magnification and area_fraction.

    Args:
        body: The theory of the paper's scene.
        magnifications: Wave numbers up to which roughness is included, over the lowest.
    """
    curve = body.magnification_curve(paper.MEAN_PRESSURE, magnifications)
    columns = {name: getattr(curve, name) for name in ("magnification", *paper.PARTS)}
    return pd.DataFrame(columns).melt(
        "magnification", list(paper.PARTS), "part", _AREA.column
    )


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
    evenly = np.linspace(0, count - 1, min(count, _DISTRIBUTIONS + 1))
    distributed = [cut_offs[round(i)] for i in evenly][-_DISTRIBUTIONS:]
    densities = []

    def row(seed: int, magnification: float) -> Rows:
        """Return rows of the areas of one surface without its short waves.

        `magnification` is the largest wave number that is kept, over the lowest.  The
        rows are those of `paper_scene.area_rows`.
        """
        scene = paper.rough_scene(points, seed, bandwidth)
        surface = filtered(scene.surface, magnification * paper.LOWEST)
        result = paper.solve_bem(replace(scene, surface=surface))
        if magnification in distributed:
            density = paper.binned(result.distribution, 1e9, _DENSITY)
            densities.append(density.assign(magnification=magnification))
        return paper.area_rows(result)

    table = tabulate(say, row, seed=seeds, magnification=cut_offs)
    by = ["part", "magnification"]
    areas = mean_with_interval(table, _AREA.column, by, "estimated_error")
    body = paper.theory_of(paper.rough_scene(points, seeds[0], bandwidth))
    curves = _curves(body, np.geomspace(1, cut_offs[-1], 1000).tolist())
    lows = areas["area_fraction_low"].clip(lower=1e-12)  # for a logarithmic axis
    measured = areas.assign(area_fraction_low=lows)
    both = pd.concat([curves.assign(method="theory"), measured.assign(method="bem")])
    plot = Plot(
        Axis("magnification", r"magnification $\zeta = q / q_0$ (–)"),
        _AREA,
        ("part", "method"),
        {"theory": "curve", "bem": "marks"},
        colour="part",
        colours=PART_COLOURS,
        log="xy",
        limits={"ylim": (1e-3, 1.3)},
    )
    yield plot, both, "How does the contact shrink as finer roughness is included?"

    off = areas.merge(_curves(body, cut_offs), on=by, suffixes=("", "_theory"))
    off = off[off["area_fraction_theory"] > _SMALLEST_AREA]
    for end in _ENDS:
        ratio = off[f"area_fraction{end}"] / off["area_fraction_theory"]
        off[f"deviation_percent{end}"] = 100 * (ratio - 1)
    y = Axis("deviation_percent", "boundary elements over theory, less 1 (%)")
    deviation = replace(
        plot,
        y=y,
        series=("part",),
        log="x",
        limits={},
        level=0.0,
    )
    caption = (
        "How far are boundary elements from the theory at each magnification? Areas "
        f"above {_SMALLEST_AREA} are shown."
    )
    yield deviation, off, caption

    groups = pd.concat(densities).groupby(["magnification", _DENSITY[0]], sort=False)
    tables = []
    for zeta in distributed:
        curve = body.pressure_curve(paper.MEAN_PRESSURE, zeta)
        distribution = PressureDistribution(
            curve.pressure, curve.cumulative, curve.plastic
        )
        density = paper.binned(distribution, 1e9, _DENSITY)
        tables.append(density.assign(method="theory", magnification=zeta))
    tables.append(groups.mean().reset_index().assign(method="bem"))
    both = pd.concat(tables).sort_values("magnification", kind="stable")
    both["zeta"] = both["magnification"].map("zeta = {:.3g}".format)
    plot = replace(
        plot,
        x=Axis(_DENSITY[0], r"contact pressure $\sigma$ (GPa)"),
        y=Axis(_DENSITY[1], r"density $P(\sigma, \zeta)$ (1/GPa)"),
        series=("zeta", "method"),
        colour="zeta",
        log="y",
        limits={"ylim": (1e-5, None), "xlim": (0, paper.HARDNESS / 1e9)},
    )
    yield plot, both, "How do the pressures spread as finer roughness is included?"
