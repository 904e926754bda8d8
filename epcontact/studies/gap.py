"""Studies of the gap under a load, and of the topography that it leaves, by all
methods.

The gap g is that to the elastically deformed surface, negative where that has flowed.
The means over the nominal area are the open gap <max(g, 0)>, the plastic displacement
<max(-g, 0)> and the separation <g>.  The theory's mean separation is the open gap.
With J2 flow the displacement of the surface includes the plastic part, so the gap is
nowhere negative.
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
from epcontact import bem, persson
from epcontact.output.charts.plot import Plot
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
    listed,
    mean_with_interval,
    rows,
    study,
)
from epcontact.studies.paper_scene import MODULUS, rough_scene, theory_of
from epcontact.surfaces import power_by_octave, residual_surface, topography

#: Mean pressures over E*; the hardness is 0.6 E*, and the paper's mean pressure 0.05
#: E*.
LOADS = tuple(0.00625 * 2.0**k for k in range(7))
OPEN, PLASTIC = "open gap", "plastic displacement"
#: The quantities of a load step that are lengths.
QUANTITIES = {OPEN: "mean_gap", "separation": "mean_separation"}
QUANTITIES |= {PLASTIC: "mean_plastic_displacement"}
_LOAD, _LENGTH, _OFF = (
    "pressure_over_modulus",
    "length_over_rms_height",
    "deviation_percent",
)
_COLOURS = {"capped": CYCLE[0], "elastic": CYCLE[1], "j2": CYCLE[2]}


def gaps(
    scene: Scene, loads: Sequence[float], solve: Callable[[Scene], ContactResult]
) -> Rows:
    """A row for each load over E*: the lengths of QUANTITIES over the rms height."""
    path, found = Load(tuple(MODULUS * load for load in loads)), []
    for load, step in zip(loads, solve(replace(scene, load=path)).steps, strict=True):
        told = {
            name: step.quantities.get(key, math.nan) for name, key in QUANTITIES.items()
        }
        over = {
            name: length / scene.surface.rms_height for name, length in told.items()
        }
        found.append({_LOAD: load} | over)
    return found


@study("gap", points=8, bandwidth=128, seeds=range(7, 15), grids=(4, 8))
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

    def measure(law: str, seed: int) -> Any:
        scene = rough_scene(points, seed, bandwidth, paper.LAWS[law])
        return gaps(scene, LOADS, paper.settled)

    def predict(law: str) -> Any:
        scene = rough_scene(points, seeds[-1], bandwidth, paper.LAWS[law])
        dense = [LOADS[0] * 2.0 ** (k / 4) for k in range(4 * len(LOADS) - 3)]
        return gaps(scene, dense, paper.by_theory)

    measured = rows(say, measure, law=paper.LAWS, seed=seeds)
    theory = rows(say, predict, law=paper.LAWS)
    means = mean_with_interval(measured, OPEN, ["law", _LOAD])
    both = pd.concat([theory.assign(method="persson"), means.assign(method="bem")])
    x, y = (
        (_LOAD, r"mean pressure over $E^*$ (–)"),
        (OPEN, "open mean gap over rms height (–)"),
    )
    look: dict[str, Any] = {"colour": "law", "colours": _COLOURS}
    off: dict[str, Any] = {"log": "x", "level": 0.0}
    plot = Plot(
        x, y, ("method", "law"), {"persson": "curve", "bem": "marks"}, log="xy", **look
    )
    plot = replace(plot, ticks=LOADS)
    yield plot, both.sort_values("law", kind="stable"), "Mean open gap"
    capped = measured[measured["law"] == "capped"]
    parts = capped.melt([_LOAD, "seed"], list(QUANTITIES), "part", _LENGTH)
    y = (_LENGTH, "mean gap over rms height (–)")
    yield (
        Plot(x, y, ("part",), log="x", ticks=LOADS),
        parts,
        "Parts of the mean gap, capped body",
    )
    both = measured.merge(theory, on=["law", _LOAD], suffixes=("", "_theory"))
    both[_OFF] = 100 * (both[f"{OPEN}_theory"] / both[OPEN] - 1)
    y = (_OFF, "theory over boundary elements, less 1 (%)")
    yield (
        Plot(x, y, ("law",), ticks=LOADS, **off, **look),
        both,
        "Deviation of the theory's gap",
    )
    axes = {"law": (*paper.LAWS, "j2"), "grid": grids, "waves": [block_waves]}
    blocks, finest, ticks = rows(say, block_gaps, **axes), max(grids), LOADS[:-1]
    plot = replace(plot, ticks=ticks, styles={"bem": "curve"})
    yield (
        plot,
        blocks[blocks["grid"] == finest],
        "Mean open gap by boundary and finite elements",
    )
    found = blocks[(blocks["law"] != "j2") | (blocks["grid"] == finest)].dropna(
        subset=_OFF
    )
    found["points"] = found["grid"].map("{} points".format)
    y = (_OFF, "finite over boundary elements, less 1 (%)")
    plot = Plot(x, y, ("law", "points"), mark="points", ticks=ticks, **off, **look)
    yield (
        plot,
        found,
        "Deviation of finite elements from capped or elastic boundary elements",
    )


def block_gaps(law: str, grid: int, waves: int) -> Rows:
    """The open gap of one surface by boundary elements and by finite ones, with the
    deviation of these; J2 flow is held against the capped law.
    """
    scene = rough_scene(grid, 7, waves, paper.LAWS.get(law, paper.HARDNESS))
    solve, loads = (
        partial(fem_check.solve, law=law, certified=False),
        LOADS[:-1],
    )  # then J2 is full
    exact = gaps(scene, loads, bem.solve)
    found = gaps(paper.yielding(scene) if law == "j2" else scene, loads, solve)
    for one, known in zip(found, exact, strict=True):
        one |= {"method": "fem", _OFF: 100 * (one[OPEN] / known[OPEN] - 1)}
    return (
        found if law == "j2" else [known | {"method": "bem"} for known in exact] + found
    )


# --- its distribution
# ----------------------------------------------------------------------------

#: Hardness over E* xi, and the gaps over the rms height at which distributions are
#: compared.
HARDNESSES = (math.inf, 0.6, 0.3, 0.16)
GAPS = np.linspace(0, 6, 601)[1:]


def cumulative(method: str, scene: Scene) -> FloatArray:
    """Share of the nominal area with a gap of at most GAPS times the rms height."""
    u = GAPS * scene.surface.rms_height
    if method == "persson":
        return separation.gap_distribution(theory_of(scene), scene.load.final, u)[1]
    law = "capped" if math.isfinite(scene.material.hardness) else "elastic"
    blocks = partial(fem_check.solve, law=law, certified=False)
    result = (paper.settled if method == "bem" else blocks)(scene)
    gap = np.sort(np.maximum(result.fields["gap"], 0.0), axis=None)
    return np.asarray(np.searchsorted(gap, u, side="right") / gap.size)


def distances(table: pd.DataFrame, method: str, reference: str) -> pd.DataFrame:
    """The Wasserstein distance of two methods over the reference's mean gap, with its
    interval.
    """
    index = ["ratio", "seed", "gap_over_rms_height"]
    wide = table.pivot_table(index=index, columns="method", values="cumulative_area")
    both = {
        "apart": (wide[method] - wide[reference]).abs(),
        "mean": 1 - wide[reference],
    }
    sums = pd.DataFrame(both).groupby(index[:2], sort=False).sum()  # their unit cancels
    found = sums.assign(distance=sums["apart"] / sums["mean"]).reset_index()
    return mean_with_interval(found, "distance", ["ratio"])


@study("gap_distribution", points=8, wide=256, seeds=range(401, 417))
def distribution(
    say: Say,
    points: int = 4,
    wide: int = 64,
    seeds: Ints = range(401, 405),
    narrow: int = 8,
) -> Charts:
    """Distribution of the open gap by all methods, and its distance from BEM's.

    Boundary and finite elements (capped, on the same grid) count the gaps of their grid
    points, the contact at 0; the theory's distribution has each surface's own spectrum.
    Wasserstein distances from boundary elements are over their mean gap, by hardness
    over E* xi, with 95 % intervals.
    """

    def row(ratio: float, seed: int, method: str, points: int, bandwidth: int) -> Any:
        scene = rough_scene(points, seed, bandwidth, ratio * MODULUS)
        columns = {
            "gap_over_rms_height": GAPS,
            "cumulative_area": cumulative(method, scene),
        }
        return pd.DataFrame(columns).to_dict("records")

    x = ("gap_over_rms_height", "gap over rms height (–)")
    y = ("cumulative_area", "share of the area with a smaller gap (–)")
    looks: dict[str, Any] = {"style": "curve", "colour": "hardness", "mark": "method"}
    plot = Plot(x, y, ("hardness", "method"), limits={"ylim": (0, 1)}, **looks)
    form = "{distance:.3f} [{distance_low:.3f}, {distance_high:.3f}] at {ratio:g}"
    for grid, band, others in (
        (points, narrow, ("fem", "persson")),
        (4, wide, ("persson",)),
    ):
        axes = {"ratio": HARDNESSES, "seed": seeds, "method": ("bem", *others)}
        table = rows(say, row, **axes, points=[grid], bandwidth=[band])
        means = (
            table.groupby(["method", "ratio", x[0]], sort=False)[y[0]]
            .mean()
            .reset_index()
        )
        means["hardness"] = means["ratio"].map(r"{:g} $E^*\xi$".format)
        told = (
            f"{other}: {listed(distances(table, other, 'bem'), form)}"
            for other in others
        )
        title = f"Distribution of the open gap at bandwidth {band}, its distances by {'; '.join(told)}"
        yield plot, means[means["ratio"].isin((0.6, 0.16))], title


# --- what a load leaves
# --------------------------------------------------------------------------


def solved(model: str, scene: Scene) -> ContactResult:
    """The answer of "cap" or "J2" to a scene with a hardness."""
    return (
        paper.settled(scene) if model == "cap" else paper.flowed(paper.yielding(scene))
    )


def residual_of(model: str, scene: Scene) -> Surface:
    """The surface that "cap" or "J2" leaves behind after the load of a scene."""
    path = (scene.load.final, 0.0) if model == "J2" else scene.load.final
    return residual_surface(
        scene.surface, solved(model, replace(scene, load=Load(path)))
    )


def theory_power(scene: Scene) -> FloatArray:
    """The share of each octave's slope variance that the theory's effective spectrum
    keeps.
    """
    theory, first = theory_of(scene), 2 * math.pi / max(scene.surface.periods)
    before, after = (
        theory.roughness,
        separation.flattened(theory, scene.load.final).roughness,
    )
    octave = np.floor(np.log2(before.upper_edge / first)).astype(int)
    kept = np.bincount(octave, after.slope_variance)
    return np.asarray(kept / np.bincount(octave, before.slope_variance))


@study("residual", points=8, wide=256, seeds=range(201, 217))
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
    - (A_pl sigma_P/p)^6] and tells nothing of the distribution of heights.  The
    experiment of Tiwari, Wang, Mueser and Persson (Lubricants 7, 90 (2019)) left short
    waves and the symmetry of heights nearly as they were.
    """

    def row(model: str, hardness: float, seed: int, points: int, bandwidth: int) -> Any:
        scene, change = rough_scene(points, seed, bandwidth, hardness * MODULUS), {}
        if model == "theory":
            kept = theory_power(scene)
        else:
            left = residual_of(model, scene)
            power = power_by_octave(scene.surface)[1]
            kept = power_by_octave(left)[1] / np.where(power > 0, power, np.nan)
            after, before = topography(left), topography(scene.surface)
            change["skewness_change"] = after.skewness - before.skewness
            change["kurtosis_change"] = after.excess_kurtosis - before.excess_kurtosis
            for name in ("rms_height", "rms_slope", "rms_curvature"):
                change[name] = getattr(after, name) / getattr(before, name)
        octaves = range(round(np.log2(bandwidth)))
        return [
            {x[0]: 2.0 ** (k + 0.5), y[0]: float(kept[k])} | change for k in octaves
        ]

    x = ("wavenumber_over_lowest", "wave number over the lowest (–)")
    y, by = ("power_kept", "power after over before (–)"), ["model", "hardness"]
    look: Any = {"colour": "hardness", "mark": "model", "log": "x", "level": 1.0}
    power = Plot(x, y, by, {"theory": "curve"}, **look)
    last = (y[0], "power kept by the shortest octave (–)")
    skew = ("skewness_change", "skewness after less before (–)")
    form = "{model} at {hardness:g}: {kurtosis_change:+.3f}, {rms_height:.3f}, {rms_slope:.3f}, "
    for models, grid, bandwidth in (
        (("cap", "J2"), points, narrow),
        (("cap", "theory"), 4, wide),
    ):
        axes = {"hardness": hardnesses, "seed": seeds, "model": models}
        table = rows(say, row, **axes, points=[grid], bandwidth=[bandwidth])
        named = table.assign(hardness=table["hardness"].map(r"{:g} $E^*\xi$".format))
        yield (
            power,
            named,
            f"Power that an octave of wave numbers keeps, bandwidth {bandwidth}",
        )
        table = table[table[x[0]] == table[x[0]].max()]
        found = mean_with_interval(table, skew[0], by).dropna()
        told = listed(found, form + "{rms_curvature:.3f}")
        title = f"Change of the skewness of the heights, bandwidth {bandwidth}; of the kurtosis,"
        title += f" and rms height, slope and curvature after over before: {told}"
        yield Plot(last, skew, ("model",), level=0.0), found, title


#: Hardness over E* xi; loads over the peak, on the way up and in reverse on the way
#: down.
HARDNESS = 0.3
SHARES = (0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
AREA, GAP, SPENT = "area", "mean_gap_over_rms_height", "plastic_share"
_PATH = [("up", share) for share in SHARES] + [
    ("down", share) for share in SHARES[-2::-1]
]


def cycle(model: str, seed: int, points: int, bandwidth: int) -> Rows:
    """A row for each load up to the peak and down again: branch, load_over_peak, AREA,
    GAP and SPENT, the share of the energy put in that flow has spent (NaN for the
    theory).
    """
    scene = rough_scene(points, seed, bandwidth, HARDNESS * MODULUS)
    peak, rms, found = scene.load.final, scene.surface.rms_height, []
    if model == "theory":
        up = theory_of(scene)
        bodies = {"up": up, "down": separation.flattened(up, peak)}
        for branch, share in _PATH:
            body, p = bodies[branch], share * peak
            area = float(persson.areas(body.diffusion(p), p, body.hardness).total)
            mean_gap = separation.mean_separation(body, p)
            found.append({AREA: area, GAP: mean_gap / rms, SPENT: math.nan})
    else:
        path = Load(tuple(share * peak for _, share in _PATH))
        for step in solved(model, replace(scene, load=path)).steps:
            told = {
                AREA: step.areas["corrected"].total,
                GAP: step.quantities["mean_gap"] / rms,
            }
            work, stored = (
                step.quantities["plastic_work"],
                step.quantities["elastic_energy"],
            )
            found.append(told | {SPENT: work / (work + stored)})
    places = ({"branch": branch, "load_over_peak": share} for branch, share in _PATH)
    return [place | told for place, told in zip(places, found, strict=True)]


@study("hysteresis", points=8, seeds=range(301, 317))
def hysteresis(
    say: Say, points: int = 4, seeds: Ints = range(301, 304), bandwidth: int = 8
) -> Charts:
    """Contact area, mean gap and plastic work on the way up and down, by every method.

    The peak load is the paper's, the hardness 0.3 E* xi, and methods are those of the
    study residual; the theory comes down as an elastic contact on the surface that it
    has flattened.  Of the load's work hardness times the mean plastic displacement
    stays in the capped body, and the yield stress times the plastic strain in the J2
    body.
    """
    axes = {"seed": seeds, "model": ("cap", "J2", "theory")}
    table = rows(say, cycle, **axes, points=[points], bandwidth=[bandwidth])
    x, series = (
        ("load_over_peak", "mean pressure over its peak (–)"),
        ("model", "branch"),
    )
    styles = {"theory, up": "curve", "theory, down": "open"}  # which lie on each other
    look: Any = {"styles": styles, "colour": "model", "mark": "branch", "ticks": SHARES}
    for figure, label, log in (
        (AREA, "contact area (–)", "xy"),
        (GAP, "mean gap over rms height (–)", "x"),
        (SPENT, "plastic work over all energy (–)", "x"),
    ):
        drawn = table[table["model"] != "theory"] if figure == SPENT else table
        plot = Plot(x, (figure, label), series, log=log, **look)
        yield plot, drawn, label.removesuffix(" (–)").capitalize()
