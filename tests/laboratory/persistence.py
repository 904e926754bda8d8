"""Contact area up to three yield stresses by J2 flow, caps and theory.

    python -m laboratory.persistence [--full]

A pressure cap closes the contact when the mean pressure reaches it.  A J2 body keeps
some of its surface apart well beyond the cap that represents it at light loads, because
neighbouring contacts confine each other and carry more: the discussion of Almqvist and
Persson.  nu = 0.3.
"""

import math
from dataclasses import replace

from epcontact import persson
from epcontact.crosscheck.model_difference import (
    capped_body,
    elements_compliance,
)
from epcontact.errors import InvalidScene
from epcontact.output.charts.plot import Axis, Plot
from epcontact.scene import Body, Load
from epcontact.studies.frame import Study, tabulate
from epcontact.studies.hardness import model_scene
from epcontact.studies.metal import mapped_hardness
from epcontact.studies.paper_scene import GAMMA, TABOR, area_of, solve_j2
from laboratory import charts

#: Mean pressures over the yield stress.
LOADS = (0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
THEORY = "theory, cap at 3 sigma_Y"


def cap_of_map(scene):
    """Return the cap of the map in Pa; infinite outside the map."""
    try:
        return mapped_hardness(scene)
    except InvalidScene:
        return math.inf


def raw_areas(severity, seed, nodes):
    """Return rows of the raw contact area along LOADS by each model.

    The area is 1 where the load reaches the cap, and there is no row where the load is
    outside the map.
    """
    scene = model_scene(severity, 0.3, seed, nodes)
    sigma_Y = scene.material.yield_stress
    path = Load(tuple(load * sigma_Y for load in LOADS))
    elastic = replace(scene.material, hardness=math.inf)
    body = replace(scene, material=elastic, load=path)
    j2 = solve_j2(body, tolerance=1e-4)
    compliance = elements_compliance(scene, j2)
    rows = []
    for load, step in zip(LOADS, j2.steps, strict=True):
        single = replace(body, load=Load(step.mean_pressure))
        areas = {"J2 flow": step.areas["raw"].total}
        caps = {
            "cap at 3 sigma_Y": TABOR * sigma_Y,
            "cap of the map": cap_of_map(single),
        }
        for name, cap in caps.items():
            if cap <= step.mean_pressure:
                areas[name] = 1.0
            elif math.isfinite(cap):
                capped = capped_body(single, cap, compliance)
                areas[name] = area_of(capped, "total", "raw")
        if load < TABOR:
            half_space = replace(single, material=scene.material, body=Body())
            theory = persson.solve(half_space, energy_reduction=GAMMA)
            areas[THEORY] = area_of(theory, "total", "raw")
        for name, area in areas.items():
            rows.append({"series": name, "load": load, "area": area})
    return rows


def persistence(say, severities=(5.0,), seeds=range(101, 103), nodes=24):
    """Contact area up to three yield stresses by J2 flow, caps and theory."""
    x = Axis("load", "p0 / sigma_Y (–)")
    y = Axis("area", "contact area over nominal area (–)")
    for severity in severities:
        table = tabulate(say, raw_areas, severity=[severity], seed=seeds, nodes=[nodes])
        plot = Plot(x, y, styles={THEORY: "curve"}, level=1.0)
        question = f"Does a gap persist above the cap at E* xi/sigma_Y = {severity:g}?"
        yield plot, table, question


FULL = {"severities": (5.0, 15.0, 50.0), "seeds": range(101, 109)}
STUDY = Study("persistence", persistence, FULL)

if __name__ == "__main__":
    charts.save(STUDY)
