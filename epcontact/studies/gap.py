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

import pandas as pd

import fem_check
from epcontact import bem
from epcontact.output.charts.plot import Axis, Plot
from epcontact.output.charts.style import CYCLE
from epcontact.results import ContactResult
from epcontact.scene import Load, Scene
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
