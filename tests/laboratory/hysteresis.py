"""Contact area, mean gap and plastic work on the way up and down, by every method.

    python -m laboratory.hysteresis [--full]

The peak load is the paper's, the hardness 0.3 E* xi, and the methods are those of the
study `residual`; the theory comes down as an elastic contact on the surface that it has
flattened.  Hardness times the mean plastic displacement of the load's work stays in the
capped body, and the yield stress times the plastic strain in the J2 body.
"""

import math
from dataclasses import replace

from epcontact import persson
from epcontact.output.charts.plot import Axis, Plot
from epcontact.persson import separation
from epcontact.scene import Load
from epcontact.studies.frame import Study, tabulate
from epcontact.studies.paper_scene import MODULUS, rough_scene, theory_of
from laboratory import charts
from laboratory.residual import solve_model

#: Hardness over E* xi, and loads over the peak.
HARDNESS = 0.3
FRACTIONS = (0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
#: Branch and load over the peak of each load of the path.
PATH = [("up", fraction) for fraction in FRACTIONS]
PATH += [("down", fraction) for fraction in FRACTIONS[-2::-1]]
AREA = "area"
GAP = "mean_gap_over_rms_height"
WORK = "plastic_fraction"


def theory_rows(scene):
    """Return one dictionary for each load of PATH, by the theory: contact area
    fraction, mean gap over rms height, and NaN for the work that plastic flow spends.
    """
    peak = scene.load.final
    up = theory_of(scene)
    bodies = {"up": up, "down": separation.flattened(up, peak)}
    rows = []
    for branch, fraction in PATH:
        body = bodies[branch]
        p = fraction * peak
        area = float(persson.areas(body.diffusion(p), p, body.hardness).total)
        mean_gap = separation.mean_separation(body, p) / scene.surface.rms_height
        rows.append({AREA: area, GAP: mean_gap, WORK: math.nan})
    return rows


def numerical_rows(model, scene):
    """Return one dictionary for each load of PATH, by the model "cap" or "J2": contact
    area fraction, mean gap over rms height, and plastic work over the sum of plastic
    work and elastic energy.
    """
    peak = scene.load.final
    path = Load(tuple(fraction * peak for _, fraction in PATH))
    rows = []
    for step in solve_model(model, replace(scene, load=path)).steps:
        work = step.quantities["plastic_work"]
        stored = step.quantities["elastic_energy"]
        mean_gap = step.quantities["mean_gap"] / scene.surface.rms_height
        area = step.areas["corrected"].total
        rows.append({AREA: area, GAP: mean_gap, WORK: work / (work + stored)})
    return rows


def cycle(model, seed, points, bandwidth):
    """Return a row for each load of PATH: branch, load_over_peak, AREA, GAP and WORK.

    WORK is the fraction of the energy put in that flow has spent, NaN for the theory.
    """
    scene = rough_scene(points, seed, bandwidth, HARDNESS * MODULUS)
    if model == "theory":
        rows = theory_rows(scene)
    else:
        rows = numerical_rows(model, scene)
    for row, (branch, fraction) in zip(rows, PATH, strict=True):
        row["branch"] = branch
        row["load_over_peak"] = fraction
    return rows


def hysteresis(say, points=4, seeds=range(301, 304), bandwidth=8):
    """Contact area, mean gap and plastic work on the way up and down, by all
    methods.
    """
    models = ("cap", "J2", "theory")
    table = tabulate(
        say, cycle, seed=seeds, model=models, points=[points], bandwidth=[bandwidth]
    )
    x = Axis("load_over_peak", "mean pressure over its peak (–)")
    plot = Plot(
        x,
        Axis(AREA, "contact area (–)"),
        ("model", "branch"),
        # The two curves of the theory lie on each other.
        {"theory, up": "curve", "theory, down": "open"},
        colour="model",
        mark="branch",
        ticks=FRACTIONS,
        log="xy",
    )
    yield plot, table, "How much contact stays when the load falls?"
    plot = replace(plot, y=Axis(GAP, "mean gap over rms height (–)"), log="x")
    yield plot, table, "How far apart are the faces when the load falls?"
    plot = replace(plot, y=Axis(WORK, "plastic work over all energy (–)"))
    spent = table[table["model"] != "theory"]
    yield plot, spent, "How much of the energy does flow spend?"


STUDY = Study("hysteresis", hysteresis, {"points": 8, "seeds": range(301, 317)})

if __name__ == "__main__":
    charts.save(STUDY)
