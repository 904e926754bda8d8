"""The topography that a load leaves behind: by a pressure cap, by J2 flow, and by the theory.

The experiment of Tiwari, Wang, Mueser and Persson (Lubricants 7, 90 (2019)) found short waves
nearly unchanged after squeezing, and heights as symmetric as before.  Which model has both?

    cap      boundary elements with the pressure capped at the hardness; the surface is lowered by
             the plastic displacement (`bem.flow`)
    J2       finite elements, yield stress = hardness / 3, loaded and unloaded; the surface is
             lowered by the displacement that remains
    theory   the effective spectrum C [1 - (A_pl sigma_P/p)^6] (`persson.separation`); it says
             nothing of the distribution of heights
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

import fem_check
from epcontact import bem
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.persson.separation import flattened_roughness
from epcontact.persson.theory import Theory
from epcontact.scene import Load, Scene, Surface
from epcontact.studies.gap import CONSTRAINT
from epcontact.studies.paper_scene import GAMMA, MODULUS, rough_scene
from epcontact.studies.tables import Progress, Size, listed, mean_with_interval
from epcontact.surfaces.residual import power_by_octave, residual_surface, topography

#: Hardness over E* xi.
HARDNESSES = (0.6, 0.3, 0.16)
STATISTICS = ("rms_height", "rms_slope", "rms_curvature", "skewness", "excess_kurtosis")
_WITH_INTERVAL = (
    "{model} {value:.3f} [{value_low:.3f}, {value_high:.3f}] at {hardness_over_slope_modulus:g}"
)


def residual(model: str, scene: Scene) -> Surface:
    """The surface that "cap" or "J2" leaves behind after the load of a scene."""
    if model == "cap":
        return residual_surface(scene.surface, bem.solve(scene, area_tolerance=1e-5))
    flowing = replace(scene.material, yield_stress=scene.material.hardness / CONSTRAINT)
    load = Load((scene.load.final, 0.0))
    path = replace(scene, material=replace(flowing, hardness=math.inf), load=load)
    return residual_surface(scene.surface, fem_check.solve(path, law="j2", certified=False))


def theory_power(scene: Scene) -> np.ndarray:
    """The share of each octave's slope variance that the theory's effective spectrum keeps."""
    before = Theory.of_scene(scene, energy_reduction=GAMMA, spectrum="surface")
    after = flattened_roughness(before, scene.load.final)
    first = 2 * math.pi / max(scene.surface.periods)
    octave = np.floor(np.log2(before.roughness.upper_edge / first)).astype(int)
    kept = np.bincount(octave, after.slope_variance)
    return np.asarray(kept / np.bincount(octave, before.roughness.slope_variance))


def residual_table(
    points: int, bandwidth: int, seeds: Sequence[int], models: Sequence[str], progress: Progress
) -> pd.DataFrame:
    """Solve surfaces at every hardness, and compare the surface left with the first one.

    Returns:
        One row for each model, hardness, seed and figure: model, hardness_over_slope_modulus, seed,
        figure and value.  Figures are the STATISTICS, as after/before (skewness and kurtosis:
        after - before), and "power <k>", the share of its power that octave k has kept.
    """
    rows = []
    octaves = round(math.log2(bandwidth))
    for ratio in HARDNESSES:
        for seed in seeds:
            scene = rough_scene(points, seed, bandwidth, ratio * MODULUS)
            before, power = topography(scene.surface), power_by_octave(scene.surface)[1]
            for model in models:
                progress(f"residual: {model}, hardness {ratio:g} E*ξ, seed {seed}")
                if model == "theory":
                    kept, figures = theory_power(scene), {}
                else:
                    left = residual(model, scene)
                    kept = power_by_octave(left)[1] / np.where(power > 0, power, np.nan)
                    after = topography(left)
                    figures = {
                        name: getattr(after, name) / getattr(before, name)
                        if name.startswith("rms")
                        else getattr(after, name) - getattr(before, name)
                        for name in STATISTICS
                    }
                figures |= {f"power {k}": float(kept[k]) for k in range(octaves)}
                key = {"model": model, "hardness_over_slope_modulus": ratio, "seed": seed}
                rows += [key | {"figure": f, "value": value} for f, value in figures.items()]
    return pd.DataFrame(rows)


def _means(table: pd.DataFrame) -> pd.DataFrame:
    return mean_with_interval(table, "value", ["model", "hardness_over_slope_modulus", "figure"])


def draw_power(table: pd.DataFrame, of_scene: str) -> Chart:
    """Draw the share of the power that each octave has kept."""
    means = _means(table[table["figure"].str.startswith("power")])
    octave = means["figure"].str.removeprefix("power ").astype(int)
    means["wavenumber_over_lowest"] = 2.0 ** (octave + 0.5)
    means["hardness"] = means["hardness_over_slope_modulus"].map(r"{:g} $E^*\xi$".format)
    means["style"] = np.where(means["model"] == "theory", "curve", "points")
    shortest = means[octave == octave.max()]
    return draw_table(
        means.rename(columns=lambda name: name.replace("value", "power_kept")),
        Plot(
            ("wavenumber_over_lowest", "wave number over the lowest (–)"),
            ("power_kept", "power after over before (–)"),
            series=("model", "hardness"),
            colour="hardness",
            log="x",
            level=1.0,
        ),
        "Power that an octave of wave numbers keeps after one load, means with their 95 % "
        f"intervals, {of_scene}. In the shortest octave, by hardness over E* xi: "
        f"{listed(shortest, _WITH_INTERVAL)}.",
    )


def draw_skewness(table: pd.DataFrame, of_scene: str) -> Chart:
    """Draw the change of the skewness against the power that the shortest octave has kept.

    The experiment is at (1, 0).
    """
    means = _means(table[table["figure"] == "skewness"])
    powers = table[table["figure"].str.startswith("power")]
    octave = powers["figure"].str.removeprefix("power ").astype(int)
    keys = ["model", "hardness_over_slope_modulus"]
    kept = powers[octave == octave.max()].groupby(keys)["value"].mean()
    means = means.join(kept.rename("power_kept"), on=keys)
    kurtosis = _means(table[table["figure"] == "excess_kurtosis"])
    others = _means(table[table["figure"].str.startswith("rms")])
    form = "{model} {figure} {value:.3f} at {hardness_over_slope_modulus:g}"
    return draw_table(
        means.rename(columns=lambda name: name.replace("value", "skewness_change")),
        Plot(
            ("power_kept", "power kept by the shortest octave (–)"),
            ("skewness_change", "skewness after less before (–)"),
            series=("model",),
            level=0.0,
        ),
        "Change of the skewness of the heights by one load, means with their 95 % intervals, "
        f"{of_scene}, against the power that the shortest octave keeps. The experiment is near 1 "
        "and 0: its short waves and the symmetry of its heights hardly change. By hardness over "
        f"E* xi: {listed(means, _WITH_INTERVAL)}. Excess kurtosis after less before: "
        f"{listed(kurtosis, _WITH_INTERVAL)}. After over before: {listed(others, form)}.",
    )


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Draw the power kept and the skewness, on small surfaces for all models and on wide bands."""
    full = size == "full"
    seeds = range(201, 217) if full else range(201, 205)
    small, points = 8, 8 if full else 4
    of_small = (
        f"{len(seeds)} surfaces of the paper's roughness, highest over lowest wave number {small}, "
        f"p0/(E* xi) = 0.05, {points} points a shortest wave; J2 with yield stress hardness/"
        f"{CONSTRAINT:g} on the same grid"
    )
    table = residual_table(points, small, seeds, ("cap", "J2"), progress)
    wide = 256 if full else 64
    of_wide = (
        f"{len(seeds)} surfaces of the paper's roughness, highest over lowest wave number {wide}, "
        "p0/(E* xi) = 0.05, 4 points a shortest wave; theory with gamma = "
        f"{GAMMA:g} on each surface's own spectrum"
    )
    broad = residual_table(4, wide, seeds, ("cap", "theory"), progress)
    return (
        draw_power(table, of_small),
        draw_skewness(table, of_small),
        draw_power(broad, of_wide),
        draw_skewness(broad[broad["model"] == "cap"], of_wide),
    )
