"""Studies of the cap that stands for a rough J2 body: its value, its map, and where it fails.

The scenes are those of the cases fem-model-*: 4 of the shortest waves in a period, a bonded layer
as deep as the period, pressed with a twelfth of 3 sigma_Y.  By similarity they depend only on
E* xi/sigma_Y and Poisson's ratio.  J2 and cap are on the elements' own compliance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

import fem_check
from epcontact import persson
from epcontact.errors import InvalidScene
from epcontact.harness.quantities.model_difference import capped_body, elements_compliance
from epcontact.harness.quantities.registry import measure_all
from epcontact.materials.hardness_map import (
    FULL,
    SYMBOLS,
    effective_hardness,
    fitted_ratio,
    formula_text,
    hardness_map,
)
from epcontact.output.charts.plot import Plot
from epcontact.scene import Body, Load, Material, Scene, SelfAffineSpectrum
from epcontact.studies.frame import Charts, Say, rows, study
from epcontact.studies.paper_scene import GAMMA, area_of
from epcontact.surfaces import SelfAffine

PERIOD, SLOPE, YOUNG = 1e-3, 0.05, 210e9  # m, -, Pa
#: Shortest waves in a period, and hardness/sigma_Y.
WAVES, TABOR = 4, 3.0
_EFFECTIVE = ("effective_hardness", "effective hardness c = hardness / sigma_Y (–)")
_OVERLAP = "shared contact over the union of both (–)"
#: The measures, each with the label of its axis and its meaning.
MEASURES = {
    "effective_hardness": (
        _EFFECTIVE[1],
        "Effective hardness: the cap, in yield stresses, under which a capped body has the "
        "contact area of the J2 body. Dotted: 3, Tabor's rule",
    ),
    "effective_overlap": (
        _OVERLAP,
        "Overlap of the contact of the J2 body with that of the capped one, with the cap at the "
        "effective hardness: equal areas, not quite in the same places",
    ),
    "model_overlap": (
        _OVERLAP,
        "Overlap of the contact of the J2 body with that of the capped one, with the cap at 3 "
        "sigma_Y",
    ),
    "model_area": (
        "area of J2 over that of the cap, less 1 (–)",
        "Contact area of the J2 body over that under a cap of 3 sigma_Y, less 1",
    ),
}


def model_scene(
    severity: float, nu: float, seed: int, nodes: int, waves: int = WAVES, hurst: float = 0.8
) -> Scene:
    """A scene at E* xi/sigma_Y = `severity` with nodes x nodes points and so many shortest waves in
    a period."""
    q = 2 * math.pi / PERIOD
    spectrum = SelfAffineSpectrum(hurst, q, q, waves * q, SLOPE)
    yield_stress = YOUNG / (1 - nu**2) * SLOPE / severity
    return Scene(
        SelfAffine(spectrum, (PERIOD,) * 2, (nodes,) * 2, seed).build(),
        Material(YOUNG, nu, TABOR * yield_stress, yield_stress),
        Load(TABOR * yield_stress / 12),
        Body("bonded_layer", PERIOD),
    )


@study(
    "hardness",
    fast={
        "usual": (3, 24),
        "by_grid": (2, (16, 24, 32)),
        "by_breadth": (2, 6, (2, 4)),
        "steps": 4,  # too few where the yield stress is small, but quick
    },
    full={
        "usual": (16, 48),
        "by_grid": (4, (16, 24, 32, 48, 64, 96)),
        "by_breadth": (8, 8, (2, 4, 8)),
    },
)
def hardness(
    say: Say,
    usual: tuple[int, int],
    by_grid: tuple[int, Sequence[int]],
    by_breadth: tuple[int, int, Sequence[int]],
    steps: int | None = None,
    severities: Sequence[float] = (5.0, 15.0, 50.0),
    nus: Sequence[float] = (0.0, 0.3, 0.45),
) -> Charts:
    """The cap, in yield stresses, that gives a J2 body's contact area, with error bars.

    Each ensemble has so many surfaces, and as many nodes a side, nodes a side of each grid, or
    nodes to the shortest wave and shortest waves in a period.  `steps` are the equal increments of
    the J2 path; None: chosen by their error.
    """

    def row(nu: float, severity: float, seed: int, nodes: int, waves: int) -> dict[str, float]:
        scene = model_scene(severity, nu, seed, nodes, waves)
        result = fem_check.solve(scene, law="j2", steps=steps, certified=False)
        measures = measure_all([f"quantity.{name}" for name in MEASURES], scene, result)
        return dict(zip(MEASURES, measures.values(), strict=True))

    def measured(count: int, nodes: int, waves: int = WAVES, nus: Sequence[float] = (0.3,)) -> Any:
        seeds = range(101, 101 + count)
        axes = {"nu": nus, "severity": severities, "seed": seeds}
        return rows(say, row, **axes, nodes=[nodes], waves=[waves])

    surfaces, nodes = usual
    table = measured(surfaces, nodes, nus=nus)
    caption = (
        f"surfaces of {nodes} x {nodes} nodes, {steps or 'as many as their error asks for'} load "
        "steps; elastic-plastic rough scenes pressed with a quarter of the yield stress."
    )
    for name, (label, meaning) in MEASURES.items():
        plot = Plot(
            ("severity", "E* xi / sigma_Y (–)"),
            (name, label),
            log="x",
            ticks=sorted(severities),
            level=TABOR if name == "effective_hardness" else None,
        )
        series = table["nu"].map("nu = {:g}".format)
        yield plot, table.assign(series=series), f"{meaning}. On {caption}"
    surfaces, grids = by_grid
    table = pd.concat([measured(surfaces, nodes) for nodes in grids])
    finest = table[table["nodes"] == max(grids)].set_index(["severity", "seed"])
    exact = finest["effective_hardness"].rename("exact")
    table = table[table["nodes"] < max(grids)].join(exact, on=exact.index.names)
    change = table["effective_hardness"] - table["exact"]
    yield _by_severity(
        table.assign(
            nodes_per_wavelength=table["nodes"] / WAVES, change_of_effective_hardness=change
        ),
        ("nodes_per_wavelength", "nodes per shortest wavelength (–)"),
        ("change_of_effective_hardness", "effective hardness less that on the finest grid (–)"),
        0.0,
        "Effect of the grid on the effective hardness: its difference from that on "
        f"{max(grids) / WAVES:g} nodes per shortest wavelength",
    )
    surfaces, points, spectra = by_breadth
    table = pd.concat([measured(surfaces, points * waves, waves) for waves in spectra])
    yield _by_severity(
        table.assign(wavelength_ratio=table["waves"]),
        ("wavelength_ratio", "longest over shortest wavelength (–)"),
        _EFFECTIVE,
        TABOR,
        "Effect of the breadth of the spectrum on the effective hardness; the severity is of the "
        "whole spectrum's slope",
    )


def _by_severity(
    table: pd.DataFrame, x: tuple[str, str], y: tuple[str, str], level: float, meaning: str
) -> tuple[Plot, pd.DataFrame, str]:
    series = table["severity"].map("E* xi / sigma_Y = {:g}".format)
    plot = Plot(x, y, log="x", ticks=sorted(table[x[0]].unique()), level=level)
    return plot, table.assign(series=series), f"{meaning}. nu = {table['nu'].iloc[0]:g}."


@study("hardness-map")
def kept_map(say: Say) -> Charts:
    """The kept map of that cap over severity, load and nu, with its formula."""
    del say
    whole = pd.DataFrame(dict(hardness_map()))
    whole = whole[(whole["area"] <= FULL) & (whole["inverse_hardness"] > 0)]
    for nu, known in whole.groupby("poisson_ratio"):
        inverse = known["inverse_hardness"]
        parts = ("scatter", "grid_error", "steps_error", "depth_error")
        error = np.sqrt(sum(known[part] ** 2 for part in parts))
        name = known["severity"].map("E* xi / sigma_Y = {:g}".format)
        places = known[["severity", "load"]].assign(
            series=name,
            style="marks",
            effective_hardness=1 / inverse,
            effective_hardness_low=1 / (inverse * (1 + error)),
            effective_hardness_high=1 / (inverse * np.maximum(1 - error, 0.5)),
        )
        formula = known[["severity", "load"]].assign(
            series=name.str.replace("E* xi / sigma_Y = ", "") + ", formula",
            style="curve",
            effective_hardness=fitted_ratio(*(known[axis].to_numpy() for axis in SYMBOLS)),
        )
        yield (
            Plot(
                ("load", "p0 / sigma_Y (–)"),
                _EFFECTIVE,
                colour="severity",
                log="x",
                ticks=sorted(known["load"].unique()),
                level=TABOR,
            ),
            pd.concat([places, formula]),
            f"The effective hardness of rough J2 metals of Poisson's ratio {nu:g}: the cap, in "
            "yield stresses, under which capped boundary elements carry the load on the J2 body's "
            "area. Bars: 95 % intervals for the spectrum of the map; other spectra change it by "
            f"{100 * known['spectrum_error'].iloc[0]:.0f} % (95 %). "
            f"Curves: {formula_text()}. Dotted: 3, Tabor's rule. Places of a contact area above "
            f"{FULL:g} are left out.",
        )


#: Mean pressures over the yield stress.
LOADS = (0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
J2, TABORS, MAPPED, THEORY = (
    "J2 flow",
    "cap at 3 sigma_Y",
    "cap of the map",
    "theory, cap at 3 sigma_Y",
)


@study(
    "persistence",
    fast={"severities": (5.0,), "seeds": range(101, 103)},
    full={"severities": (5.0, 15.0, 50.0), "seeds": range(101, 109)},
)
def persistence(
    say: Say, severities: Sequence[float], seeds: Sequence[int], nodes: int = 24
) -> Charts:
    """Contact area up to three yield stresses by J2 flow, caps and theory.

    A pressure cap closes the contact when the mean pressure reaches it.  A J2 body keeps some of
    its surface apart well beyond the cap that stands for it at light loads, because neighbouring
    contacts confine each other and carry more: the discussion of Almqvist and Persson.
    """
    for severity in severities:
        yield (
            Plot(
                ("load", "p0 / sigma_Y (–)"),
                ("area", "contact area over nominal area (–)"),
                styles={THEORY: "curve"},
                level=1.0,
            ),
            rows(say, raw_areas, severity=[severity], seed=seeds, nodes=[nodes]),
            f"Contact area of rough bodies of E* xi/sigma_Y = {severity:g} and Poisson's ratio 0.3 "
            "up to three yield stresses: J2 flow, caps at Tabor's 3 sigma_Y and at the hardness of "
            f"the map for each load, and Persson's theory (gamma = {GAMMA:g}) on the half-space. "
            "Asperities persist: the J2 body stays apart where a cap that stands for it at light "
            "loads would have closed.",
        )


def raw_areas(severity: float, seed: int, nodes: int) -> list[dict[str, Any]]:
    """The raw contact area along LOADS by each model, at Poisson's ratio 0.3.

    A cap has the area 1 where the load reaches it; the cap of the map has no row outside the map.
    """
    scene, found = model_scene(severity, 0.3, seed, nodes), []
    sigma_Y = scene.material.yield_stress
    uncapped = replace(scene.material, hardness=math.inf)
    path = replace(scene, material=uncapped, load=Load(tuple(load * sigma_Y for load in LOADS)))
    j2 = fem_check.solve(path, law="j2", certified=False, tolerance=1e-4)
    compliance = elements_compliance(scene, j2)
    for load, step in zip(LOADS, j2.steps, strict=True):
        single = replace(path, load=Load(step.mean_pressure))
        found.append((J2, load, step.areas["raw"].total))
        for name, cap in ((TABORS, TABOR * sigma_Y), (MAPPED, _mapped(single))):
            if cap <= step.mean_pressure:
                found.append((name, load, 1.0))
            elif math.isfinite(cap):
                capped = capped_body(single, cap, compliance)
                found.append((name, load, area_of(capped, "total", "raw")))
        if load < TABOR:
            half = replace(single, material=scene.material, body=Body())
            answer = persson.solve(half, energy_reduction=GAMMA)
            found.append((THEORY, load, area_of(answer, "total", "raw")))
    return [{"series": name, "load": load, "area": area} for name, load, area in found]


def _mapped(scene: Scene) -> float:
    """The cap of the map in Pa; infinite outside the map."""
    material = scene.material
    try:
        return effective_hardness(
            yield_stress=material.yield_stress,
            young_modulus=material.young_modulus,
            poisson_ratio=material.poisson_ratio,
            rms_slope=SLOPE,
            mean_pressure=scene.load.final,
        ).value
    except InvalidScene:
        return math.inf
