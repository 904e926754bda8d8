"""The distribution of the open gap, P(u), by all three methods, and its distance from the theory's.

Boundary and finite elements (capped, on the same grid) count the gaps of their grid points; the
theory's distribution is that of `persson.gaps` with each surface's own spectrum.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

import fem_check
from epcontact import bem
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.persson.gaps import gap_distribution
from epcontact.persson.theory import Theory
from epcontact.results import FloatArray
from epcontact.scene import Scene
from epcontact.studies.paper_scene import GAMMA, MODULUS, rough_scene
from epcontact.studies.tables import Progress, Size, listed, mean_with_interval

#: Hardness over E* xi.
HARDNESSES = (math.inf, 0.6, 0.3, 0.16)
#: Gaps over the rms height at which the distributions are compared.
GAPS = np.linspace(0, 6, 601)[1:]


def cumulative(method: str, scene: Scene) -> FloatArray:
    """Share of the nominal area with a gap of at most GAPS times the rms height."""
    u = GAPS * scene.surface.rms_height
    if method == "persson":
        theory = Theory.of_scene(scene, energy_reduction=GAMMA, spectrum="surface")
        return gap_distribution(theory, scene.load.final, u).cumulative
    if method == "bem":
        result = bem.solve(scene, area_tolerance=1e-5)
    else:
        law = "capped" if math.isfinite(scene.material.hardness) else "elastic"
        result = fem_check.solve(scene, law=law, certified=False)
    gap = np.sort(np.maximum(result.fields["gap"], 0.0), axis=None)
    return np.asarray(np.searchsorted(gap, u, side="right") / gap.size)


def distribution_table(
    points: int, bandwidth: int, seeds: Sequence[int], methods: Sequence[str], progress: Progress
) -> pd.DataFrame:
    """Find the distributions on every surface and at every hardness.

    Returns:
        One row for each method, hardness, seed and gap: method, hardness_over_slope_modulus, seed,
        gap_over_rms_height and cumulative_area.
    """
    tables = []
    for ratio in HARDNESSES:
        for seed in seeds:
            scene = rough_scene(points, seed, bandwidth, ratio * MODULUS)
            for method in methods:
                progress(f"gap distribution: {method}, hardness {ratio:g} E* xi, seed {seed}")
                key = {"method": method, "hardness_over_slope_modulus": ratio, "seed": seed}
                found = {"gap_over_rms_height": GAPS, "cumulative_area": cumulative(method, scene)}
                tables.append(pd.DataFrame(key | found))
    return pd.concat(tables, ignore_index=True)


def distances(table: pd.DataFrame, method: str, reference: str) -> pd.DataFrame:
    """The Wasserstein distance of two methods over the reference's mean gap, with its interval."""
    keys = ["hardness_over_slope_modulus", "seed"]
    wide = table.pivot_table(
        index=[*keys, "gap_over_rms_height"], columns="method", values="cumulative_area"
    )
    step = GAPS[1] - GAPS[0]
    apart = (wide[method] - wide[reference]).abs().groupby(keys, sort=False).sum() * step
    mean = (1 - wide[reference]).groupby(keys, sort=False).sum() * step
    return mean_with_interval((apart / mean).rename("distance").reset_index(), "distance", keys[:1])


def draw(table: pd.DataFrame, of_scene: str) -> Chart:
    """Draw the mean distributions of two hardnesses, and list the distances of all."""
    means = table.groupby(
        ["method", "hardness_over_slope_modulus", "gap_over_rms_height"], sort=False
    )["cumulative_area"].mean()
    shown = means.reset_index()
    shown = shown[shown["hardness_over_slope_modulus"].isin((0.6, 0.16))]
    shown["hardness"] = shown["hardness_over_slope_modulus"].map(r"{:g} $E^*\xi$".format)
    shown["style"] = "curve"
    form = "{distance:.3f} [{distance_low:.3f}, {distance_high:.3f}] at "
    form += "{hardness_over_slope_modulus:g}"
    others = sorted(set(table["method"]) - {"bem"})
    said = "; ".join(
        f"{method}: {listed(distances(table, method, 'bem'), form)}" for method in others
    )
    return draw_table(
        shown,
        Plot(
            ("gap_over_rms_height", "gap over rms height (–)"),
            ("cumulative_area", "share of the area with a smaller gap (–)"),
            series=("method", "hardness"),
            limits={"ylim": (0, 1)},
        ),
        "Distribution of the open gap, means over surfaces, the contact included at gap 0, "
        f"{of_scene}. Wasserstein distance from boundary elements over their mean gap, with 95 % "
        f"intervals, by hardness over E*ξ: {said}.",
    )


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Draw the distributions of all methods on small surfaces, and of two on a wide band."""
    full = size == "full"
    small, wide = 8, 256 if full else 64
    seeds = range(401, 417) if full else range(401, 405)
    of = "surfaces of the paper's roughness and load, highest over lowest wave number"
    points = 8 if full else 4
    table = distribution_table(points, small, seeds, ("bem", "fem", "persson"), progress)
    broad = distribution_table(4, wide, seeds, ("bem", "persson"), progress)
    return (
        draw(table, f"{len(seeds)} {of} {small}, {points} points a shortest wave"),
        draw(broad, f"{len(seeds)} {of} {wide}, 4 points a shortest wave"),
    )
