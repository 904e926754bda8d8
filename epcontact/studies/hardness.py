"""Studies of the cap that stands for a rough J2 body: its value, its map, and where it
fails.

The scenes are those of the cases fem-model-*: 4 of the shortest waves in a period, a
bonded layer as deep as the period, pressed with a twelfth of 3 sigma_Y.  By similarity
they depend only on E* xi/sigma_Y and Poisson's ratio.  J2 and cap are on the elements'
own compliance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

import fem_check
from epcontact import persson
from epcontact.errors import InvalidScene
from epcontact.harness.quantities.model_difference import (
    capped_body,
    elements_compliance,
    hardness_of_equal_area,
)
from epcontact.harness.quantities.registry import measure_all
from epcontact.materials import hardness_map as kept
from epcontact.output.charts.plot import Plot
from epcontact.scene import Body, Load, Material, Scene
from epcontact.studies.frame import Charts, Ints, Rows, Say, rows, study
from epcontact.studies.paper_scene import GAMMA, TABOR, area_of, flowed, self_affine
from fem_check.result import contact_result

PERIOD, SLOPE, YOUNG = 1e-3, 0.05, 210e9  # m, -, Pa
WAVES = 4  # the shortest ones in a period
_EFFECTIVE = ("effective_hardness", "effective hardness c = hardness / sigma_Y (–)")
_OVERLAP = "shared contact over the union of both (–)"
_SEVERITY = "E* xi / sigma_Y = {:g}"
#: The measures, each with the label of its axis and the title of its chart.
MEASURES = {
    "effective_hardness": (
        _EFFECTIVE[1],
        "Cap under which a body has the J2 body's contact area",
    ),
    "effective_overlap": (
        _OVERLAP,
        "Overlap of the J2 body's contact with that under this cap",
    ),
    "model_overlap": (
        _OVERLAP,
        "Overlap of the J2 body's contact with that under 3 sigma_Y",
    ),
    "model_area": (
        "area of J2 over that of the cap, less 1 (–)",
        "J2 against a cap of 3 sigma_Y",
    ),
}


def model_scene(
    severity: float, nu: float, seed: int, nodes: int, waves: int = WAVES
) -> Scene:
    """A scene at E* xi/sigma_Y = `severity` with nodes x nodes points and so many
    shortest waves in a period.
    """
    surface = self_affine(
        2 * math.pi / PERIOD, (nodes, nodes), seed, waves, slope=SLOPE
    )
    yield_stress = YOUNG / (1 - nu**2) * SLOPE / severity
    material = Material(YOUNG, nu, TABOR * yield_stress, yield_stress)
    return Scene(
        surface, material, Load(TABOR * yield_stress / 12), Body("bonded_layer", PERIOD)
    )


@study("hardness", surfaces=16, nodes=48)
def hardness(
    say: Say,
    surfaces: int = 3,
    nodes: int = 24,
    severities: Sequence[float] = (5.0, 15.0, 50.0),
    nus: Sequence[float] = (0.0, 0.3, 0.45),
) -> Charts:
    """The cap, in yield stresses, that gives a J2 body's contact area, with error bars.

    The mean pressure is a quarter of the yield stress.  The dotted 3 is Tabor's rule.
    """

    def row(nu: float, severity: float, seed: int) -> dict[str, float]:
        scene = model_scene(severity, nu, seed, nodes)
        result = flowed(scene)
        measures = measure_all([f"quantity.{name}" for name in MEASURES], scene, result)
        return dict(zip(MEASURES, measures.values(), strict=True))

    table = rows(say, row, nu=nus, severity=severities, seed=range(101, 101 + surfaces))
    table["series"] = table["nu"].map("nu = {:g}".format)
    for name, (label, title) in MEASURES.items():
        level = TABOR if name == "effective_hardness" else None
        x = ("severity", "E* xi / sigma_Y (–)")
        plot = Plot(x, (name, label), log="x", ticks=sorted(severities), level=level)
        yield plot, table, title


@study("hardness-map")
def kept_map(say: Say) -> Charts:
    """The kept map of that cap over severity, load and nu, with its formula.

    Under the cap boundary elements carry the load on the area of the rough J2 metal,
    which is no larger than 0.9.  Intervals (95 %) and curves are for the map's own
    small surfaces of breadth 4. The dotted 3 is Tabor's rule.
    """
    del say
    whole = pd.DataFrame(dict(kept.hardness_map()))
    whole = whole[(whole["area"] <= kept.FULL) & (whole["inverse_hardness"] > 0)]
    inverse, (name, _) = whole["inverse_hardness"], _EFFECTIVE
    error = np.hypot(whole["scatter"], whole["grid_error"])
    error = np.hypot(error, np.hypot(whole["steps_error"], whole["depth_error"]))
    bounds = {f"{name}_low": 1 / (inverse * (1 + error))}
    bounds[f"{name}_high"] = 1 / (inverse * np.maximum(1 - error, 0.5))
    formula = kept.fitted_ratio(*(whole[axis].to_numpy() for axis in kept.SYMBOLS))
    places = whole.assign(**{name: 1 / inverse} | bounds, style="marks")
    places["series"] = places["severity"].map(_SEVERITY.format)
    curves = whole.assign(**{name: formula}, style="curve")
    curves["series"] = curves["severity"].map("{:g}, formula".format)
    for nu, known in pd.concat([places, curves]).groupby("poisson_ratio"):
        x, ticks = ("load", "p0 / sigma_Y (–)"), sorted(known["load"].unique())
        plot = Plot(x, _EFFECTIVE, colour="severity", log="x", ticks=ticks, level=TABOR)
        yield (
            plot,
            known,
            f"Effective hardness at nu = {nu:g}; curves {kept.formula_text()}",
        )


#: What is compared of a rough body and a rough punch, by its name in rows.
_MIRRORED = {
    "area": "contact area",
    "effective_hardness": "effective hardness",
    "residual": "rms of the topography that flow leaves",
}


@study("rough-body", slopes=(0.05, 0.1), seeds=range(101, 109), nodes=32)
def rough_body(
    say: Say,
    slopes: Sequence[float] = (0.1,),
    seeds: Ints = range(101, 103),
    nodes: int = 16,
) -> Charts:
    """Which body is rough: a J2 block on a rigid flat, or a rigid punch on a flat J2
    block.

    Both have the same gap, and tend to the same answer as the slope vanishes at
    constant E* xi/sigma_Y.  Strains are small, nu = 0.3, and a punch presses along its
    normals.
    """

    def row(severity: float, slope: float, seed: int) -> Rows:
        scene, found = model_scene(severity, 0.3, seed, nodes), {}
        surface = replace(scene.surface, heights=scene.surface.heights * slope / SLOPE)
        material = replace(scene.material, young_modulus=YOUNG * SLOPE / slope)
        scene = replace(scene, surface=surface, material=material)
        unloaded = replace(scene, load=Load((scene.load.final, 0.0)))
        for body in ("gap", "moved", "punch"):
            path = fem_check.solve_path(
                unloaded, law="j2", geometry=body, certified=False
            )
            pressed = contact_result(replace(path, points=path.points[:1]))
            cap = hardness_of_equal_area(scene, pressed)
            left = path.points[-1].state.displacement[0, ..., 2]
            found[body] = np.array([cap.area, cap.ratio, np.std(left)])
        rough, punch = (found[body] / found["gap"] - 1 for body in ("moved", "punch"))
        changes = {
            "rough body": rough,
            "rough punch": punch,
            "difference": rough - punch,
        }
        return [
            {"series": f"{name}, {severity:g}"}
            | dict(zip(_MIRRORED, change, strict=True))
            for name, change in changes.items()
        ]

    table = rows(say, row, severity=(5.0, 50.0), slope=slopes, seed=seeds)
    for name, label in _MIRRORED.items():
        x, y = (
            ("slope", "rms slope (–)"),
            (name, "change from that of small slopes (–)"),
        )
        plot = Plot(x, y, log="x", ticks=sorted(slopes), level=0.0)
        yield plot, table, f"Change of the {label}, by E* xi/sigma_Y"


#: Mean pressures over the yield stress.
LOADS = (0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
THEORY = "theory, cap at 3 sigma_Y"


@study("persistence", severities=(5.0, 15.0, 50.0), seeds=range(101, 109))
def persistence(
    say: Say,
    severities: Sequence[float] = (5.0,),
    seeds: Ints = range(101, 103),
    nodes: int = 24,
) -> Charts:
    """Contact area up to three yield stresses by J2 flow, caps and theory.

    A pressure cap closes the contact when the mean pressure reaches it.  A J2 body keeps some of
    its surface apart well beyond the cap that stands for it at light loads, because neighbouring
    contacts confine each other and carry more: the discussion of Almqvist and Persson.  nu = 0.3.
    """
    x, y = ("load", "p0 / sigma_Y (–)"), ("area", "contact area over nominal area (–)")
    for severity in severities:
        table = rows(say, raw_areas, severity=[severity], seed=seeds, nodes=[nodes])
        plot = Plot(x, y, styles={THEORY: "curve"}, level=1.0)
        yield plot, table, f"Contact area at E* xi/sigma_Y = {severity:g}"


def raw_areas(severity: float, seed: int, nodes: int) -> Rows:
    """The raw contact area along LOADS by each model, at Poisson's ratio 0.3; 1 where
    the load reaches the cap, and no row where the load is outside the map.
    """
    scene, found = model_scene(severity, 0.3, seed, nodes), []
    material, sigma_Y = scene.material, scene.material.yield_stress
    path = Load(tuple(load * sigma_Y for load in LOADS))
    body = replace(scene, material=replace(material, hardness=math.inf), load=path)
    j2 = flowed(body, tolerance=1e-4)
    compliance = elements_compliance(scene, j2)
    for load, step in zip(LOADS, j2.steps, strict=True):
        single = replace(body, load=Load(step.mean_pressure))
        areas = {"J2 flow": step.areas["raw"].total}
        caps = {"cap at 3 sigma_Y": TABOR * sigma_Y, "cap of the map": _mapped(single)}
        for name, cap in caps.items():
            if cap <= step.mean_pressure:
                areas[name] = 1.0
            elif math.isfinite(cap):
                areas[name] = area_of(
                    capped_body(single, cap, compliance), "total", "raw"
                )
        if load < TABOR:
            half_space = replace(single, material=material, body=Body())
            answer = persson.solve(half_space, energy_reduction=GAMMA)
            areas[THEORY] = area_of(answer, "total", "raw")
        found += [
            {"series": name, "load": load, "area": area} for name, area in areas.items()
        ]
    return found


def _mapped(scene: Scene) -> float:
    """The cap of the map in Pa; infinite outside the map."""
    of = {
        k: getattr(scene.material, k)
        for k in ("yield_stress", "young_modulus", "poisson_ratio")
    }
    try:
        load = scene.load.final
        return kept.effective_hardness(
            **of, rms_slope=SLOPE, mean_pressure=load, breadth=4
        ).value
    except InvalidScene:
        return math.inf
