"""The persistence of asperities: contact area up to a mean pressure of three yield stresses.

A pressure cap closes the contact when the mean pressure reaches it.  A J2 body keeps some of its
surface apart well beyond the cap that stands for it at light loads, because neighbouring contacts
confine each other and carry more: the discussion of Almqvist and Persson.  The bodies are those of
the cases fem-model, J2 and caps on the same elements' compliance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import pandas as pd

import fem_check
from epcontact import persson
from epcontact.errors import InvalidScene
from epcontact.harness.quantities.model_difference import capped_body, elements_compliance
from epcontact.materials.hardness_map import effective_hardness
from epcontact.output.charts.figures import Chart
from epcontact.output.charts.plot import Plot, draw_table
from epcontact.scene import Body, Load, Scene
from epcontact.studies.hardness import SLOPE, TABOR, model_scene
from epcontact.studies.paper_scene import GAMMA, area_of
from epcontact.studies.tables import Progress, Size, mean_with_interval

#: Mean pressures over the yield stress.
LOADS = (0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
J2, TABORS, EFFECTIVE, THEORY = (
    "J2 flow",
    "cap at 3 sigma_Y",
    "cap of the map",
    "theory, cap at 3 sigma_Y",
)


def area_table(
    severity: float, seeds: Sequence[int], nodes: int, progress: Progress
) -> pd.DataFrame:
    """Measure the raw contact area along LOADS on every surface, at Poisson's ratio 0.3.

    Args:
        severity: E* xi/sigma_Y.
        seeds: one surface each.
        nodes: a side; six for each of the shortest waves are 24.
        progress: called with a sentence before each surface.

    Returns:
        One row for each surface, load and model: series, seed, load (p0/sigma_Y), area.  A cap has
        the area 1 where the load reaches it; the cap of the map has no row outside the map.
    """
    rows = []
    for seed in seeds:
        progress(f"persistence: E*ξ/σ_Y = {severity:g}, seed {seed}")
        scene = model_scene(severity, 0.3, seed, nodes)
        sigma_Y = scene.material.yield_stress
        uncapped = replace(scene.material, hardness=math.inf)
        loads = Load(tuple(load * sigma_Y for load in LOADS))
        path = replace(scene, material=uncapped, load=loads)
        j2 = fem_check.solve(path, law="j2", certified=False, tolerance=1e-4)
        compliance = elements_compliance(scene, j2)
        for load, step in zip(LOADS, j2.steps, strict=True):
            single = replace(path, load=Load(step.mean_pressure))
            rows.append((J2, seed, load, step.areas["raw"].total))
            for name, cap in ((TABORS, TABOR * sigma_Y), (EFFECTIVE, _mapped(single))):
                if cap <= step.mean_pressure:
                    rows.append((name, seed, load, 1.0))
                elif math.isfinite(cap):
                    capped = capped_body(single, cap, compliance)
                    rows.append((name, seed, load, area_of(capped, "total", "raw")))
            if load < TABOR:
                half = replace(single, material=scene.material, body=Body())
                answer = persson.solve(half, energy_reduction=GAMMA)
                rows.append((THEORY, seed, load, area_of(answer, "total", "raw")))
    return pd.DataFrame(rows, columns=["series", "seed", "load", "area"])


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


def charts(size: Size, progress: Progress) -> tuple[Chart, ...]:
    """Chart area against load at the paper's E* xi/sigma_Y = 5; "full" at 15 and 50, too."""
    fast = size == "fast"
    severities, seeds = ((5.0,), range(101, 103)) if fast else ((5.0, 15.0, 50.0), range(101, 109))
    return tuple(draw_areas(area_table(s, seeds, 24, progress), s) for s in severities)


def draw_areas(table: pd.DataFrame, severity: float) -> Chart:
    """Draw the area by each model against the mean pressure."""
    means = mean_with_interval(table, "area", ["series", "load"])
    means["style"] = means["series"].map(lambda name: "curve" if name == THEORY else "points")
    return draw_table(
        means,
        Plot(
            ("load", "p0 / sigma_Y (–)"),
            ("area", "contact area over nominal area (–)"),
            level=1.0,
        ),
        f"Contact area of rough bodies of E* xi/sigma_Y = {severity:g} and Poisson's ratio 0.3 up "
        f"to three yield stresses, means over {table['seed'].nunique()} surfaces with their 95 % "
        "intervals: J2 flow, caps at Tabor's 3 sigma_Y and at the hardness of the map for each "
        f"load, all on the elements' compliance, and Persson's theory (gamma = {GAMMA:g}) on the "
        "half-space. Asperities persist: the J2 body stays apart where a cap that stands for it at "
        "light loads would have closed.",
    )
