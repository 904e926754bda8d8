"""Studies of the pressure cap that represents a rough J2 body: its value and its map.

The scenes are those of the cases fem-model-*: 4 of the shortest waves in a period, a
bonded layer as deep as the period, pressed with a twelfth of 3 sigma_Y.  By similarity
they depend only on the severity E* xi/sigma_Y and on Poisson's ratio.  J2 and cap are
solved on the elements' own compliance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from epcontact.harness.quantities.registry import measure_all
from epcontact.materials import hardness_map
from epcontact.output.charts.plot import Axis, Plot
from epcontact.scene import Body, Load, Material, Scene
from epcontact.studies.frame import Charts, Say, study, tabulate
from epcontact.studies.paper_scene import TABOR, self_affine, solve_j2

#: Period in m, rms slope, Young's modulus in Pa, number of shortest waves in a period.
PERIOD = 1e-3
SLOPE = 0.05
YOUNG = 210e9
WAVES = 4
_EFFECTIVE = Axis("effective_hardness", "effective hardness c = hardness / sigma_Y (–)")
_OVERLAP = "shared contact over the union of both (–)"
#: The quantities that are shown, each with the label of its axis and the
#: question of its chart.
MEASURES = {
    "effective_hardness": (
        _EFFECTIVE.label,
        "Which pressure cap gives the contact area of a J2 body?",
    ),
    "effective_overlap": (
        _OVERLAP,
        "Is the contact under this cap where that of the J2 body is?",
    ),
    "model_overlap": (
        _OVERLAP,
        "Is the contact under a cap of 3 sigma_Y where that of the J2 body is?",
    ),
    "model_area": (
        "area of J2 over that of the cap, less 1 (–)",
        "How much more area does a J2 body have than one capped at 3 sigma_Y?",
    ),
}


def model_scene(
    severity: float, nu: float, seed: int, nodes: int, waves: int = WAVES
) -> Scene:
    """Return a scene like those of the cases fem-model-*.

    Args:
        severity: E* xi/sigma_Y.
        nu: Poisson's ratio.
        seed: Seed of the surface.
        nodes: Grid points along each direction.
        waves: Number of the shortest waves in a period.
    """
    lowest = 2 * math.pi / PERIOD
    surface = self_affine(
        lowest,
        (nodes, nodes),
        seed,
        waves,
        slope=SLOPE,
    )
    yield_stress = YOUNG / (1 - nu**2) * SLOPE / severity
    material = Material(YOUNG, nu, TABOR * yield_stress, yield_stress)
    load = Load(TABOR * yield_stress / 12)
    return Scene(surface, material, load, Body("bonded_layer", PERIOD))


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
    names = [f"quantity.{name}" for name in MEASURES]

    def row(
        nu: float,
        severity: float,
        seed: int,
    ) -> dict[str, float]:
        """Return the quantities MEASURES of one J2 body.

        `nu` is Poisson's ratio, `severity` E* xi/sigma_Y, and `seed` that of the
        surface.
        """
        scene = model_scene(severity, nu, seed, nodes)
        values = measure_all(names, scene, solve_j2(scene))
        return dict(zip(MEASURES, values.values(), strict=True))

    seeds = range(101, 101 + surfaces)
    table = tabulate(
        say,
        row,
        nu=nus,
        severity=severities,
        seed=seeds,
    )
    table["series"] = table["nu"].map("nu = {:g}".format)
    for name, (label, question) in MEASURES.items():
        level = TABOR if name == "effective_hardness" else None
        x = Axis("severity", "E* xi / sigma_Y (–)")
        plot = Plot(
            x,
            Axis(name, label),
            log="x",
            ticks=sorted(severities),
            level=level,
        )
        yield plot, table, question


@study("hardness-map")
def map_of_package(say: Say) -> Charts:
    """The package's map of that cap over severity, load and nu, with its formula.

    Under the cap boundary elements carry the load on the area of the rough J2 metal,
    which is no larger than 0.9.  Intervals (95 %) and curves are for the map's own
    small surfaces of breadth 4. The dotted 3 is Tabor's rule.
    """
    del say
    table = pd.DataFrame(dict(hardness_map.hardness_map()))
    not_full = table["area"] <= hardness_map.LARGEST_AREA
    table = table[not_full & (table["inverse_hardness"] > 0)]
    inverse = table["inverse_hardness"]
    error = np.hypot(table["scatter"], table["grid_error"])
    error = np.hypot(error, np.hypot(table["steps_error"], table["depth_error"]))
    name = _EFFECTIVE.column
    measured = {
        name: 1 / inverse,
        f"{name}_low": 1 / (inverse * (1 + error)),
        f"{name}_high": 1 / (inverse * np.maximum(1 - error, 0.5)),
    }
    places = table.assign(**measured, style="marks")
    places["series"] = places["severity"].map("E* xi / sigma_Y = {:g}".format)
    coordinates = (table[axis].to_numpy() for axis in hardness_map.COORDINATES)
    curves = table.assign(style="curve")
    curves[name] = hardness_map.fitted_ratio(*coordinates)
    curves["series"] = curves["severity"].map("{:g}, formula".format)
    x = Axis("load", "p0 / sigma_Y (–)")
    formula = hardness_map.formula_text()
    for nu, rows in pd.concat([places, curves]).groupby("poisson_ratio"):
        ticks = sorted(rows["load"].unique())
        plot = Plot(
            x,
            _EFFECTIVE,
            colour="severity",
            log="x",
            labels=dict.fromkeys(curves["series"], "_"),
            ticks=ticks,
            level=TABOR,
        )
        caption = (
            f"Which pressure cap represents a rough J2 metal at nu = {nu:g}? "
            f"Curves are {formula}."
        )
        yield plot, rows, caption
