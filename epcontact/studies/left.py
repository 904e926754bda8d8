"""Studies of what a load leaves: the topography after it, and the way down from it.

cap      boundary elements with the pressure capped at the hardness; the surface is lowered by
         the plastic displacement
J2       finite elements on the same grid with yield stress = hardness / 3, which follow the
         path; the surface is lowered by the displacement that remains
theory   the effective spectrum C [1 - (A_pl sigma_P/p)^6] (`persson.separation`), which comes
         down as an elastic contact; it says nothing of the distribution of heights
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import fem_check
from epcontact import bem
from epcontact.output.charts.plot import Plot
from epcontact.persson.elastoplastic import areas
from epcontact.persson.separation import flattened_roughness, mean_separation
from epcontact.persson.theory import Theory
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Load, Scene, Surface
from epcontact.studies.frame import Charts, Say, listed, mean_with_interval, rows, study
from epcontact.studies.paper_scene import CONSTRAINT, GAMMA, MODULUS, rough_scene
from epcontact.surfaces import power_by_octave, residual_surface, topography


def solved(model: str, scene: Scene) -> ContactResult:
    """The answer of "cap" or "J2" to a scene with a hardness."""
    if model == "cap":
        return bem.solve(scene, area_tolerance=1e-5)
    yields = scene.material.hardness / CONSTRAINT
    material = replace(scene.material, hardness=math.inf, yield_stress=yields)
    return fem_check.solve(replace(scene, material=material), law="j2", certified=False)


def _theory(scene: Scene) -> Theory:
    return Theory.of_scene(scene, energy_reduction=GAMMA, spectrum="surface")


# --- the topography ------------------------------------------------------------------------------


def residual_of(model: str, scene: Scene) -> Surface:
    """The surface that "cap" or "J2" leaves behind after the load of a scene."""
    path = (scene.load.final, 0.0) if model == "J2" else scene.load.final
    return residual_surface(scene.surface, solved(model, replace(scene, load=Load(path))))


def theory_power(scene: Scene) -> FloatArray:
    """The share of each octave's slope variance that the theory's effective spectrum keeps."""
    before = _theory(scene)
    after = flattened_roughness(before, scene.load.final)
    first = 2 * math.pi / max(scene.surface.periods)
    octave = np.floor(np.log2(before.roughness.upper_edge / first)).astype(int)
    kept = np.bincount(octave, after.slope_variance)
    return np.asarray(kept / np.bincount(octave, before.roughness.slope_variance))


def _left_by(model: str, hardness: float, seed: int, points: int, bandwidth: int) -> Any:
    """A row for each octave: the share of its power that is left, beside what the surface lost."""
    scene, octaves = rough_scene(points, seed, bandwidth, hardness * MODULUS), np.log2(bandwidth)
    change: dict[str, float] = {}
    if model == "theory":
        kept = theory_power(scene)
    else:
        left = residual_of(model, scene)
        power = power_by_octave(scene.surface)[1]
        kept = power_by_octave(left)[1] / np.where(power > 0, power, np.nan)
        after, before = topography(left), topography(scene.surface)
        change = {
            "skewness_change": after.skewness - before.skewness,
            "kurtosis_change": after.excess_kurtosis - before.excess_kurtosis,
            "height_kept": after.rms_height / before.rms_height,
            "slope_kept": after.rms_slope / before.rms_slope,
            "curvature_kept": after.rms_curvature / before.rms_curvature,
        }
    return [
        {"wavenumber_over_lowest": 2.0 ** (k + 0.5), "power_kept": float(kept[k])} | change
        for k in range(round(octaves))
    ]


@study(
    "residual",
    fast={"points": 4, "wide": 64, "seeds": range(201, 205)},
    full={"points": 8, "wide": 256, "seeds": range(201, 217)},
)
def residual(
    say: Say,
    points: int,
    wide: int,
    seeds: Sequence[int],
    narrow: int = 8,
    hardnesses: Sequence[float] = (0.6, 0.3, 0.16),
) -> Charts:
    """Power spectrum and skewness of the surface that a load leaves, by every method.

    The experiment of Tiwari, Wang, Mueser and Persson (Lubricants 7, 90 (2019)) found short waves
    nearly unchanged after squeezing, and heights as symmetric as before.
    """
    for models, grid, bandwidth in ((("cap", "J2"), points, narrow), (("cap", "theory"), 4, wide)):
        axes = {"hardness": hardnesses, "seed": seeds, "model": models}
        table = rows(say, _left_by, **axes, points=[grid], bandwidth=[bandwidth])
        of_scene = (
            "after one load of the paper's roughness, hardnesses over E* xi, p0/(E* xi) = 0.05, "
            f"highest over lowest wave number {bandwidth}, {grid} points a shortest wave; J2 with "
            f"yield stress hardness/{CONSTRAINT:g}, theory with gamma = {GAMMA:g} on each "
            "surface's own spectrum."
        )
        named = table.assign(hardness=table["hardness"].map(r"{:g} $E^*\xi$".format))
        yield (
            Plot(
                ("wavenumber_over_lowest", "wave number over the lowest (–)"),
                ("power_kept", "power after over before (–)"),
                series=("model", "hardness"),
                styles={"theory": "curve"},
                colour="hardness",
                log="x",
                level=1.0,
            ),
            named,
            f"Power that an octave of wave numbers keeps {of_scene}",
        )
        by = ["model", "hardness"]
        last = table[table["wavenumber_over_lowest"] == table["wavenumber_over_lowest"].max()]
        means = last.groupby(by, sort=False).mean(numeric_only=True)
        means = means.drop(columns=["skewness_change", "seed"])
        skewness = mean_with_interval(last, "skewness_change", by).join(means, on=by).dropna()
        form = (
            "{model} at {hardness:g}: {kurtosis_change:+.3f}, {height_kept:.3f}, "
            "{slope_kept:.3f}, {curvature_kept:.3f}"
        )
        yield (
            Plot(
                ("power_kept", "power kept by the shortest octave (–)"),
                ("skewness_change", "skewness after less before (–)"),
                series=("model",),
                level=0.0,
            ),
            skewness,
            f"Change of the skewness of the heights {of_scene} Means with their 95 % intervals, "
            "against the power that the shortest octave keeps; the experiment is near 1 and 0. "
            "Change of the excess kurtosis, and rms height, slope and curvature after over before: "
            f"{listed(skewness, form)}.",
        )


# --- the way down --------------------------------------------------------------------------------

#: Hardness over E* xi; loads over the peak, on the way up and in reverse on the way down.
HARDNESS = 0.3
SHARES = (0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
AREA, GAP, SPENT = "area", "mean_gap_over_rms_height", "plastic_share"
_PATH = (*SHARES, *SHARES[-2::-1])


def cycle(model: str, seed: int, points: int, bandwidth: int) -> list[dict[str, Any]]:
    """A row for each load up to the peak and down again: branch, load_over_peak, AREA, GAP and
    SPENT, the share of the energy put in that flow has spent (NaN for the theory)."""
    scene = rough_scene(points, seed, bandwidth, HARDNESS * MODULUS)
    peak, height = scene.load.final, scene.surface.rms_height
    if model == "theory":
        up = _theory(scene)
        down = replace(up, roughness=flattened_roughness(up, peak), hardness=math.inf)
        found = [
            (*_areas_and_gap(up if i < len(SHARES) else down, share * peak), math.nan)
            for i, share in enumerate(_PATH)
        ]
    else:
        path = replace(scene, load=Load(tuple(share * peak for share in _PATH)))
        found = []
        for step in solved(model, path).steps:
            work, stored = step.quantities["plastic_work"], step.quantities["elastic_energy"]
            area, gap = step.areas["corrected"].total, step.quantities["mean_gap"]
            found.append((area, gap, work / (work + stored)))
    branch = ["up"] * len(SHARES) + ["down"] * (len(SHARES) - 1)
    return [
        {"branch": b, "load_over_peak": share, AREA: area, GAP: gap / height, SPENT: spent}
        for b, share, (area, gap, spent) in zip(branch, _PATH, found, strict=True)
    ]


def _areas_and_gap(theory: Theory, p: float) -> tuple[float, float]:
    area = float(areas(theory.diffusion(p), p, theory.hardness).total)
    return area, mean_separation(theory, p)


@study(
    "hysteresis",
    fast={"points": 4, "seeds": range(301, 304)},
    full={"points": 8, "seeds": range(301, 317)},
)
def hysteresis(
    say: Say,
    points: int,
    seeds: Sequence[int],
    bandwidth: int = 8,
    models: Sequence[str] = ("cap", "J2", "theory"),
) -> Charts:
    """Contact area, mean gap and plastic work on the way up and down, by every method.

    Of the load's work hardness times the mean plastic displacement stays in the capped body, and
    the yield stress times the plastic strain in the J2 body.
    """
    grid = {"points": [points], "bandwidth": [bandwidth]}
    table = rows(say, cycle, seed=seeds, model=models, **grid)
    of_scene = (
        f"of the paper's roughness, highest over lowest wave number {bandwidth}, peak p0/(E* xi) = "
        f"0.05, hardness {HARDNESS:g} E* xi, {points} points a shortest wave; J2 with yield stress "
        f"hardness/{CONSTRAINT:g}; the theory comes down on the surface that it has flattened."
    )
    for figure, label, meaning, log in (
        (AREA, "contact area (–)", "Contact area up and down", "xy"),
        (GAP, "mean gap over rms height (–)", "Mean open gap", "x"),
        (SPENT, "plastic work over all energy (–)", "Share of the energy that flow has spent", "x"),
    ):
        yield (
            Plot(
                ("load_over_peak", "mean pressure over its peak (–)"),
                (figure, label),
                series=("model", "branch"),
                styles={"theory": "curve"},
                log=log,
                ticks=SHARES,
            ),
            table[table["model"] != "theory"] if figure == SPENT else table,
            f"{meaning}, {of_scene}",
        )
