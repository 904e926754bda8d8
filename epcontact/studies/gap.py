"""Studies of the gap under a load, and of the topography that a load leaves.

The gap g is that to the elastically deformed surface, negative where the surface has
flowed.  The means over the nominal area are the open gap <max(g, 0)>, the plastic
displacement <max(-g, 0)> and the separation <g>.  The theory's mean separation is the
open gap.  With J2 flow the displacement of the surface includes the plastic part, so
that the gap is nowhere negative.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

import fem_check
from epcontact import bem
from epcontact.output.charts.plot import Axis, Plot
from epcontact.output.charts.style import CYCLE
from epcontact.persson import separation
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Load, Scene, Surface
from epcontact.studies import paper_scene as paper
from epcontact.studies.frame import (
    Charts,
    Ints,
    Rows,
    Say,
    list_rows,
    mean_with_interval,
    study,
    tabulate,
)
from epcontact.surfaces import power_by_octave, residual_surface, topography

#: Mean pressures over E*; the hardness is 0.6 E*, the paper's mean pressure 0.05 E*.
LOADS = tuple(0.00625 * 2.0**k for k in range(7))
OPEN = "open gap"
PLASTIC = "plastic displacement"
#: The names of the lengths in tables, and the quantities of a load step.
QUANTITIES = {
    OPEN: "mean_gap",
    "separation": "mean_separation",
    PLASTIC: "mean_plastic_displacement",
}
_LOAD = "pressure_over_modulus"
_LENGTH = "length_over_rms_height"
_DEVIATION = "deviation_percent"
_COLOURS = {
    "capped": CYCLE[0],
    "elastic": CYCLE[1],
    "j2": CYCLE[2],
}


def gaps(
    scene: Scene, loads: Sequence[float], solve: Callable[[Scene], ContactResult]
) -> Rows:
    """Return a row for each load with the lengths of QUANTITIES over the rms height.

    Args:
        scene: The scene, whose load is replaced.
        loads: Mean pressures over E*.
        solve: Solves the scene.
    """
    path = Load(tuple(paper.MODULUS * load for load in loads))
    steps = solve(replace(scene, load=path)).steps
    rows = []
    for load, step in zip(loads, steps, strict=True):
        row = {_LOAD: load}
        for name, quantity in QUANTITIES.items():
            length = step.quantities.get(quantity, math.nan)
            row[name] = length / scene.surface.rms_height
        rows.append(row)
    return rows


@study(
    "gap",
    points=8,
    bandwidth=128,
    seeds=range(7, 15),
    grids=(4, 8),
)
def gap(
    say: Say,
    points: int = 4,
    bandwidth: int = 64,
    seeds: Ints = range(7, 11),
    grids: Ints = (3, 6),
    block_waves: int = 8,
) -> Charts:
    """Mean gap against pressure, its elastic and plastic part, by all methods.

    The roughness is the paper's, E* xi = E*, the hardness 0.6 E* or none.  Separation =
    open gap - plastic displacement.  Theory: gamma = 0.536, the spectrum of the same
    surfaces.  Finite elements are on one surface of a deep block, with the same law or
    with J2 flow at a third of the hardness, which differs from the cap as a model.
    """

    def solve(law: str, seed: int) -> Rows:
        """Return rows of `gaps` of one surface by boundary elements.

        `law` is "capped" or "elastic", and `seed` that of the surface.
        """
        scene = paper.rough_scene(points, seed, bandwidth, paper.LAWS[law])
        return gaps(scene, LOADS, paper.solve_bem)

    def predict(law: str) -> Rows:
        """Return rows of `gaps` by the theory, at four times as many loads.

        `law` is "capped" or "elastic".
        """
        scene = paper.rough_scene(points, seeds[-1], bandwidth, paper.LAWS[law])
        dense = [LOADS[0] * 2.0 ** (k / 4) for k in range(4 * len(LOADS) - 3)]
        return gaps(scene, dense, paper.solve_theory)

    solved = tabulate(say, solve, law=paper.LAWS, seed=seeds)
    theory = tabulate(say, predict, law=paper.LAWS)
    x = Axis(_LOAD, r"mean pressure over $E^*$ (–)")
    y = Axis(OPEN, "open mean gap over rms height (–)")
    open_gap = Plot(
        x,
        y,
        ("method", "law"),
        {"persson": "curve", "bem": "marks"},
        log="xy",
        ticks=LOADS,
        colour="law",
        colours=_COLOURS,
    )
    means = mean_with_interval(solved, OPEN, ["law", _LOAD])
    methods = [theory.assign(method="persson"), means.assign(method="bem")]
    table = pd.concat(methods).sort_values("law", kind="stable")
    caption = "How far apart are the faces, by theory and by boundary elements?"
    yield open_gap, table, caption

    capped = solved[solved["law"] == "capped"]
    parts = capped.melt([_LOAD, "seed"], list(QUANTITIES), "part", _LENGTH)
    y = Axis(_LENGTH, "mean gap over rms height (–)")
    plot = Plot(
        x,
        y,
        ("part",),
        log="x",
        ticks=LOADS,
    )
    caption = (
        "How much does plastic flow add to the gap? The body is capped, and its open "
        "gap is the separation plus the plastic displacement."
    )
    yield plot, parts, caption

    merged = solved.merge(theory, on=["law", _LOAD], suffixes=("", "_theory"))
    merged[_DEVIATION] = 100 * (merged[f"{OPEN}_theory"] / merged[OPEN] - 1)
    y = Axis(_DEVIATION, "theory over boundary elements, less 1 (%)")
    deviation = Plot(
        x,
        y,
        ("law",),
        ticks=LOADS,
        log="x",
        level=0.0,
        colour="law",
        colours=_COLOURS,
    )
    caption = "How far is the theory's gap from that of boundary elements?"
    yield deviation, merged, caption

    laws = (*paper.LAWS, "j2")
    blocks = tabulate(
        say,
        block_gaps,
        law=laws,
        grid=grids,
        waves=[block_waves],
    )
    finest = max(grids)
    plot = replace(
        open_gap,
        ticks=LOADS[:-1],
        styles={"bem": "curve"},
    )
    on_finest = blocks[blocks["grid"] == finest]
    caption = "How far apart are the faces, by boundary and finite elements?"
    yield plot, on_finest, caption

    shown = (blocks["law"] != "j2") | (blocks["grid"] == finest)
    table = blocks[shown].dropna(subset=_DEVIATION)
    table["points"] = table["grid"].map("{} points".format)
    y = Axis(_DEVIATION, "finite over boundary elements, less 1 (%)")
    plot = replace(
        deviation, y=y, series=("law", "points"), mark="points", ticks=LOADS[:-1]
    )
    caption = (
        "How far is the gap of finite elements from that of boundary elements? J2 flow "
        "is compared with the capped law."
    )
    yield plot, table, caption


def block_gaps(law: str, grid: int, waves: int) -> Rows:
    """Return the open gap of one surface by finite elements and by boundary elements.

    Args:
        law: "capped", "elastic" or "j2", which is compared with the capped law.
        grid: Points per shortest wavelength.
        waves: Number of the shortest waves in a period.

    Returns:
        Rows of `gaps` with method, those of finite elements with the deviation; for J2
        flow those of finite elements alone.
    """
    scene = paper.rough_scene(grid, 7, waves, paper.LAWS.get(law, paper.HARDNESS))
    loads = LOADS[:-1]  # at the last load the J2 body is in full contact
    by_boundary = gaps(scene, loads, bem.solve)
    body = paper.yielding(scene) if law == "j2" else scene
    solve = partial(fem_check.solve, law=law, certified=False)
    by_finite = gaps(body, loads, solve)
    for row, reference in zip(by_finite, by_boundary, strict=True):
        row["method"] = "fem"
        row[_DEVIATION] = 100 * (row[OPEN] / reference[OPEN] - 1)
    if law == "j2":
        return by_finite
    return [row | {"method": "bem"} for row in by_boundary] + by_finite


# --- what a load leaves


def solve_model(model: str, scene: Scene) -> ContactResult:
    """Solve a scene by a model: a pressure cap or J2 flow.

    Args:
        model: "cap" (boundary elements with the scene's hardness) or "J2" (finite
            elements, with a yield stress of the hardness over TABOR).
        scene: A scene with a finite hardness.

    Raises:
        NotConverged: The solve does not converge.
    """
    if model == "cap":
        return paper.solve_bem(scene)
    return paper.solve_j2(paper.yielding(scene))


def surface_after(model: str, scene: Scene) -> Surface:
    """Return the unloaded surface after the load of a scene.

    `model` is "cap", whose surface is lowered by the plastic displacement under the
    load, or "J2", whose finite elements are unloaded.
    """
    path = (scene.load.final, 0.0) if model == "J2" else scene.load.final
    result = solve_model(model, replace(scene, load=Load(path)))
    return residual_surface(scene.surface, result)


def power_kept_by_theory(scene: Scene) -> FloatArray:
    """Return the slope variance after a load over that before, for each octave.

    It follows from the theory's effective spectrum under the load of the scene.  The
    shape is (octaves,), from the longest waves on.
    """
    theory = paper.theory_of(scene)
    before = theory.roughness
    after = separation.flattened(theory, scene.load.final).roughness
    lowest = 2 * math.pi / max(scene.surface.periods)
    octave = np.floor(np.log2(before.upper_edge / lowest)).astype(int)
    variance_after = np.bincount(octave, after.slope_variance)
    variance_before = np.bincount(octave, before.slope_variance)
    return np.asarray(variance_after / variance_before)


def changes_by_load(model: str, scene: Scene) -> tuple[FloatArray, dict[str, float]]:
    """Return how a load changes the topography of a surface.

    Args:
        model: "cap" (boundary elements) or "J2" (finite elements).
        scene: The scene with the surface and the load.

    Returns:
        The fraction of each octave's slope variance that is left, (octaves,), and
        changes of the heights: of skewness and kurtosis the difference, of rms height,
        slope and curvature the ratio.
    """
    left = surface_after(model, scene)
    _, power_before = power_by_octave(scene.surface)
    _, power_after = power_by_octave(left)
    kept = power_after / np.where(power_before > 0, power_before, np.nan)
    before = topography(scene.surface)
    after = topography(left)
    changes = {
        "skewness_change": after.skewness - before.skewness,
        "kurtosis_change": after.excess_kurtosis - before.excess_kurtosis,
    }
    for name in ("rms_height", "rms_slope", "rms_curvature"):
        changes[name] = getattr(after, name) / getattr(before, name)
    return kept, changes


@study(
    "residual",
    points=8,
    wide=256,
    seeds=range(201, 217),
)
def residual(
    say: Say,
    points: int = 4,
    wide: int = 64,
    seeds: Ints = range(201, 205),
    narrow: int = 8,
    hardnesses: Sequence[float] = (0.6, 0.3, 0.16),
) -> Charts:
    """Power spectrum and skewness of the surface that a load leaves, by every method.

    The load is the paper's.  A cap lowers the surface by the plastic displacement of
    boundary elements, J2 (finite elements, yield stress = hardness/3) by that which
    remains after unloading, the theory (gamma = 0.536) has the effective spectrum C [1
    - (A_pl sigma_P/p)^6] and says nothing about the distribution of heights.  The
    experiment of Tiwari, Wang, Mueser and Persson (Lubricants 7, 90 (2019)) left short
    waves and the symmetry of heights nearly as they were.
    """
    x = Axis("wavenumber_over_lowest", "wave number over the lowest (–)")
    y = Axis("power_kept", "power after over before (–)")
    series = ["model", "hardness"]

    def row(
        model: str, hardness: float, seed: int, points: int, bandwidth: int
    ) -> Rows:
        """Return a row for each octave of wave numbers of one surface.

        Args:
            model: "cap", "J2" or "theory".
            hardness: Hardness over E* xi.
            seed: Seed of the surface.
            points: Grid points per shortest wavelength.
            bandwidth: Number of the shortest waves in a period.
        """
        scene = paper.rough_scene(points, seed, bandwidth, hardness * paper.MODULUS)
        changes: dict[str, float] = {}
        if model == "theory":
            kept = power_kept_by_theory(scene)
        else:
            kept, changes = changes_by_load(model, scene)
        rows = []
        for octave in range(round(np.log2(bandwidth))):
            place = {x.column: 2.0 ** (octave + 0.5), y.column: float(kept[octave])}
            rows.append(place | changes)
        return rows

    look: dict[str, Any] = {
        "colour": "hardness",
        "mark": "model",
        "log": "x",
    }
    power = Plot(
        x,
        y,
        series,
        {"theory": "curve"},
        level=1.0,
        **look,
    )
    x_skewness = Axis(y.column, "power kept by the shortest octave (–)")
    skewness = Axis("skewness_change", "skewness after less before (–)")
    form = (
        "{model} at {hardness:g}: {kurtosis_change:+.3f}, {rms_height:.3f}, "
        "{rms_slope:.3f}, {rms_curvature:.3f}"
    )
    for models, grid, bandwidth in (
        (("cap", "J2"), points, narrow),
        (("cap", "theory"), 4, wide),
    ):
        table = tabulate(
            say,
            row,
            hardness=hardnesses,
            seed=seeds,
            model=models,
            points=[grid],
            bandwidth=[bandwidth],
        )
        in_words = table["hardness"].map("{:g} E* xi".format)
        caption = (
            f"Which waves does a load flatten ({' and '.join(models)})? Each point is "
            f"an octave of wave numbers; the bandwidth is {bandwidth}."
        )
        yield power, table.assign(hardness=in_words), caption

        shortest = table[table[x.column] == table[x.column].max()]
        means = mean_with_interval(shortest, skewness.column, series).dropna()
        shown = " and ".join(means["model"].unique())
        caption = (
            f"Does a load skew the heights ({shown})? The bandwidth is "
            f"{bandwidth}; change of the kurtosis, and rms height, slope and curvature "
            f"after over before: {list_rows(means, form)}."
        )
        yield Plot(x_skewness, skewness, ("model",), level=0.0), means, caption
