"""Studies of the gap: its mean against the load, and its distribution, by all methods.

The gap g is that between the flat and the elastically deformed surface; it is negative where the
flat is below that surface because the surface has flowed:

    open gap              <max(g, 0)>   the gap that is left open between the surfaces
    plastic displacement  <max(-g, 0)>  the distance by which flow has lowered the surface
    separation            <g> = open gap - plastic displacement, the distance of the flat from
                          the mean plane of the elastically deformed surface

all means over the nominal area.  The theory's mean separation is the open gap, that of the surface
as the flow has left it.  With J2 flow the displacement of the surface includes the plastic part, so
the gap is nowhere negative.
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
from epcontact.persson.separation import gap_distribution
from epcontact.persson.theory import Theory
from epcontact.results import ContactResult, FloatArray
from epcontact.scene import Load, Scene
from epcontact.studies.frame import Charts, Say, listed, mean_with_interval, rows, study
from epcontact.studies.paper_scene import (
    CONSTRAINT,
    GAMMA,
    HARDNESS,
    LAWS,
    MODULUS,
    rough_scene,
)

#: Mean pressures over E*; the hardness is 0.6 E*, and the paper's mean pressure 0.05 E*.
LOADS = tuple(0.00625 * 2.0**k for k in range(7))
OPEN, PLASTIC = "open gap", "plastic displacement"
#: The quantities of a load step that are lengths.
QUANTITIES = {
    OPEN: "mean_gap",
    "separation": "mean_separation",
    PLASTIC: "mean_plastic_displacement",
}
_LOAD = "pressure_over_modulus"
_PLOT = Plot(
    (_LOAD, r"mean pressure over $E^*$ (–)"),
    (OPEN, "open mean gap over rms height (–)"),
    series=("method", "law"),
    colour="law",
    colours={"capped": CYCLE[0], "elastic": CYCLE[1], "j2": CYCLE[2]},
    log="xy",
    ticks=LOADS,
)
_MATERIAL = (
    f"with the paper's roughness, E* xi = E*, hardness {HARDNESS / MODULUS:g} E* or none; the "
    "paper's load is 0.05 E*"
)


def gaps(scene: Scene, loads: Sequence[float], solve: Callable[[Scene], ContactResult]) -> Any:
    """A row for each load over E*: the lengths of QUANTITIES over the rms height, and the plastic
    share of the load's work, sigma_P w/(U_el + sigma_P w) with the plastic displacement w."""
    path, found = Load(tuple(MODULUS * load for load in loads)), []
    for load, step in zip(loads, solve(replace(scene, load=path)).steps, strict=True):
        told = {name: step.quantities.get(key, math.nan) for name, key in QUANTITIES.items()}
        spent = HARDNESS * told[PLASTIC]
        share = spent / (step.quantities.get("elastic_energy", math.nan) + spent)
        over = {name: length / scene.surface.rms_height for name, length in told.items()}
        found.append({_LOAD: load} | over | {"plastic_share": share})
    return found


@study(
    "gap",
    fast={"points": 4, "bandwidth": 64, "seeds": range(7, 11), "grids": (3, 6)},
    full={"points": 8, "bandwidth": 128, "seeds": range(7, 15), "grids": (4, 8)},
)
def gap(
    say: Say,
    points: int,
    bandwidth: int,
    seeds: Sequence[int],
    grids: Sequence[int],
    block_waves: int = 8,
) -> Charts:
    """Mean gap against pressure, its elastic and plastic part, by all methods."""

    def by_bem(law: str, seed: int) -> Any:
        scene = rough_scene(points, seed, bandwidth, LAWS[law])
        return gaps(scene, LOADS, partial(bem.solve, area_tolerance=1e-5))

    def by_theory(law: str) -> Any:
        scene = rough_scene(points, seeds[-1], bandwidth, LAWS[law])
        solve = partial(persson.solve, energy_reduction=GAMMA, spectrum="surface")
        return gaps(scene, dense, solve)

    dense = [LOADS[0] * 2.0 ** (k / 4) for k in range(4 * (len(LOADS) - 1) + 1)]
    measured, theory = rows(say, by_bem, law=LAWS, seed=seeds), rows(say, by_theory, law=LAWS)
    surfaces = f"{len(seeds)} surfaces, 1/{bandwidth} of the longest wave being the shortest"
    of_scene = f"of {surfaces}, {_MATERIAL}"
    means = mean_with_interval(measured, OPEN, ["law", _LOAD])
    both = pd.concat([theory.assign(method="persson"), means.assign(method="bem")]).sort_values(
        "law", kind="stable"
    )
    yield (
        replace(_PLOT, styles={"persson": "curve", "bem": "marks"}),
        both,
        f"Mean open gap against mean pressure {of_scene}. Boundary elements: mean of max(g, 0) "
        f"with its 95 % interval; theory: its mean separation with gamma = {GAMMA} and the "
        "spectrum of the same surfaces.",
    )
    capped = measured[measured["law"] == "capped"]
    length = "length_over_rms_height"
    shares = 100 * capped.groupby(_LOAD)["plastic_share"].mean().reset_index()
    shares[_LOAD] /= 100
    yield (
        replace(
            _PLOT,
            y=(length, "mean gap over rms height (–)"),
            series=("part",),
            colour="",
            log="x",
        ),
        capped.melt([_LOAD, "seed"], list(QUANTITIES), "part", length),
        f"Parts of the mean gap of the capped body by boundary elements, {of_scene}. The gap g "
        "is that to the elastically deformed surface, negative where it has flowed: open gap = "
        "mean of max(g, 0), plastic displacement = mean of max(-g, 0), separation = mean of g "
        "= open gap - plastic displacement, exactly. The work of the load is the elastic "
        "energy plus hardness times plastic displacement; of it the plastic part is, by load "
        f"over E*: {listed(shares, '{plastic_share:.2g} % at {pressure_over_modulus:g}')}.",
    )
    deviation = replace(
        _PLOT,
        y=("deviation_percent", "theory over boundary elements, less 1 (%)"),
        series=("law",),
        log="x",
        level=0.0,
    )
    both = measured.merge(theory, on=["law", _LOAD], suffixes=("", "_theory"))
    ratio = both[f"{OPEN}_theory"] / both[OPEN]
    yield (
        deviation,
        both.assign(deviation_percent=100 * (ratio - 1)),
        f"Deviation of the theory's open gap from that of boundary elements, {of_scene}.",
    )
    blocks = rows(say, _block_gaps, grid=grids, law=(*LAWS, "j2"), waves=[block_waves])
    of_block = (
        f"of one surface, 1/{block_waves} of the longest wave being the shortest, {_MATERIAL}; "
        f"yield stress hardness/{CONSTRAINT:g}"
    )
    yield (
        replace(_PLOT, ticks=LOADS[:-1], styles={"bem": "curve"}),
        blocks[blocks["grid"] == max(grids)],
        f"Mean open gap against mean pressure by boundary and finite elements {of_block}, "
        f"{max(grids)} grid points a shortest wave for both. Finite elements, of small strain on a "
        "flat block so deep that it matches the half-space within 1e-3, have the same law; "
        "with J2 the body itself flows, no pressure is capped, and the gap is that to the "
        "surface as the flow has left it.",
    )
    deviations = block_deviations(blocks)
    drawn = (deviations["law"] != "j2") | (deviations["grid"] == max(grids))
    yield (
        replace(
            deviation,
            y=("deviation_percent", "finite over boundary elements, less 1 (%)"),
            series=("law", "points"),
            ticks=LOADS[:-1],
        ),
        deviations[drawn].assign(points=deviations["grid"].map("{} points".format)),
        "Deviation of the open gap of finite elements from that of boundary elements on the "
        f"same grid {of_block}, by grid points a shortest wave; of J2, from the capped law: a "
        "difference of models, not an error.",
    )


def _block_gaps(grid: int, law: str, waves: int) -> Any:
    """The open gap of one surface by finite elements and, but for J2 flow, by boundary elements."""
    scene = rough_scene(grid, 7, waves, LAWS.get(law, HARDNESS))
    solvers: dict[str, Any] = {"fem": partial(fem_check.solve, law=law, certified=False)}
    if law == "j2":
        flows = replace(scene.material, yield_stress=HARDNESS / CONSTRAINT)
        scene = replace(scene, material=flows)
    else:
        solvers = {"bem": bem.solve} | solvers
    # The J2 body is in full contact at the last load.
    return [
        {"method": method} | row
        for method, solve in solvers.items()
        for row in gaps(scene, LOADS[:-1], solve)
    ]


def block_deviations(blocks: pd.DataFrame) -> pd.DataFrame:
    """Finite over boundary elements on the same grid, less 1, in %; J2 over the capped law."""
    wide = blocks.pivot(index=["grid", _LOAD], columns=["method", "law"], values=OPEN)
    tables = []
    for law in (*LAWS, "j2"):
        ratio = wide["fem", law] / wide["bem", "capped" if law == "j2" else law]
        tables.append((100 * (ratio - 1)).rename("deviation_percent").reset_index().assign(law=law))
    return pd.concat(tables, ignore_index=True)


#: Hardness over E* xi, and the gaps over the rms height at which distributions are compared.
HARDNESSES = (math.inf, 0.6, 0.3, 0.16)
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


def distances(table: pd.DataFrame, method: str, reference: str) -> pd.DataFrame:
    """The Wasserstein distance of two methods over the reference's mean gap, with its interval."""
    keys, step = ["ratio", "seed"], GAPS[1] - GAPS[0]
    index = [*keys, "gap_over_rms_height"]
    wide = table.pivot_table(index=index, columns="method", values="cumulative_area")
    apart = (wide[method] - wide[reference]).abs().groupby(keys, sort=False).sum() * step
    mean = (1 - wide[reference]).groupby(keys, sort=False).sum() * step
    return mean_with_interval((apart / mean).rename("distance").reset_index(), "distance", keys[:1])


@study(
    "gap_distribution",
    fast={"points": 4, "wide": 64, "seeds": range(401, 405)},
    full={"points": 8, "wide": 256, "seeds": range(401, 417)},
)
def distribution(say: Say, points: int, wide: int, seeds: Sequence[int], narrow: int = 8) -> Charts:
    """Distribution of the open gap by all methods, and its distance from BEM's.

    Boundary and finite elements (capped, on the same grid) count the gaps of their grid points; the
    theory's distribution has each surface's own spectrum.
    """

    def row(ratio: float, seed: int, method: str, points: int, bandwidth: int) -> Any:
        scene = rough_scene(points, seed, bandwidth, ratio * MODULUS)
        columns = {"gap_over_rms_height": GAPS, "cumulative_area": cumulative(method, scene)}
        return pd.DataFrame(columns).to_dict("records")

    for grid, band, methods in (
        (points, narrow, ("bem", "fem", "persson")),
        (4, wide, ("bem", "persson")),
    ):
        table = rows(
            say, row, ratio=HARDNESSES, seed=seeds, method=methods, points=[grid], bandwidth=[band]
        )
        by = ["method", "ratio", "gap_over_rms_height"]
        means = table.groupby(by, sort=False)["cumulative_area"].mean().reset_index()
        means["hardness"] = means["ratio"].map(r"{:g} $E^*\xi$".format)
        form = "{distance:.3f} [{distance_low:.3f}, {distance_high:.3f}] at {ratio:g}"
        said = "; ".join(
            f"{method}: {listed(distances(table, method, 'bem'), form)}" for method in methods[1:]
        )
        yield (
            Plot(
                ("gap_over_rms_height", "gap over rms height (–)"),
                ("cumulative_area", "share of the area with a smaller gap (–)"),
                series=("method", "hardness"),
                style="curve",
                limits={"ylim": (0, 1)},
            ),
            means[means["ratio"].isin((0.6, 0.16))],
            "Distribution of the open gap, means over surfaces, the contact included at gap 0, "
            f"{len(seeds)} surfaces of the paper's roughness and load, highest over lowest wave "
            f"number {band}, {grid} points a shortest wave. Wasserstein distance from boundary "
            f"elements over their mean gap, with 95 % intervals, by hardness over E*ξ: {said}.",
        )
