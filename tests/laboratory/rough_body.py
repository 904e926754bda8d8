"""Which body is rough: a J2 block on a rigid flat, or a rigid punch on a flat J2 block.

    python -m laboratory.rough_body [--full]

Both have the same gap, and tend to the same answer as the slope vanishes at constant
E* xi/sigma_Y.  Strains are small, nu = 0.3, and a punch presses along its normals.
"""

from dataclasses import replace

import numpy as np

import fem_check
from epcontact.crosscheck.model_difference import hardness_of_equal_area
from epcontact.output.charts.plot import Axis, Plot
from epcontact.scene import Load
from epcontact.studies.frame import Study, tabulate
from epcontact.studies.hardness import SLOPE, YOUNG, model_scene
from fem_check.result import contact_result
from laboratory import charts

#: What is compared, by the names of columns.
COMPARED = {
    "area": "contact area",
    "effective_hardness": "effective hardness",
    "residual": "rms of the topography that flow leaves",
}


def scene_of_slope(severity, slope, seed, nodes):
    """Return a scene of `model_scene` with another rms slope at the same severity, E*
    times slope over yield stress.

    `nodes` is the number of nodes a side.
    """
    scene = model_scene(severity, 0.3, seed, nodes)
    heights = scene.surface.heights * slope / SLOPE
    material = replace(scene.material, young_modulus=YOUNG * SLOPE / slope)
    surface = replace(scene.surface, heights=heights)
    return replace(scene, surface=surface, material=material)


def measures(scene, geometry):
    """Return the contact area, the effective hardness over the yield stress, and the
    rms height in m of the surface displacement that is left after unloading, (3,).

    `geometry` is the option of `fem_check.solve_path` that says which body is rough.
    """
    unloaded = replace(scene, load=Load((scene.load.final, 0.0)))
    path = fem_check.solve_path(unloaded, law="j2", geometry=geometry, certified=False)
    loaded = contact_result(replace(path, points=path.points[:1]))
    cap = hardness_of_equal_area(scene, loaded)
    residual = path.points[-1].state.displacement[0, ..., 2]
    return np.array([cap.area, cap.ratio, np.std(residual)])


def rough_body(say, slopes=(0.1,), seeds=range(101, 103), nodes=16):
    """Which body is rough: a J2 block on a rigid flat, or a punch on a flat block."""

    def row(severity, slope, seed):
        """Return rows of the changes of a rough body, of a punch, and their
        difference.
        """
        scene = scene_of_slope(severity, slope, seed, nodes)
        small_slope = measures(scene, "gap")
        body = measures(scene, "moved") / small_slope - 1
        punch = measures(scene, "punch") / small_slope - 1
        rows = []
        for name, changes in (
            ("rough body", body),
            ("rough punch", punch),
            ("difference", body - punch),
        ):
            row = dict(zip(COMPARED, changes, strict=True))
            rows.append({"series": f"{name}, {severity:g}"} | row)
        return rows

    table = tabulate(say, row, severity=(5.0, 50.0), slope=slopes, seed=seeds)
    for name, label in COMPARED.items():
        x = Axis("slope", "rms slope (–)")
        y = Axis(name, "change from that of small slopes (–)")
        plot = Plot(x, y, log="x", ticks=sorted(slopes), level=0.0)
        caption = f"How do slopes change the {label}? Numbers are E* xi/sigma_Y."
        yield plot, table, caption


FULL = {"slopes": (0.05, 0.1), "seeds": range(101, 109), "nodes": 32}
STUDY = Study("rough-body", rough_body, FULL)

if __name__ == "__main__":
    charts.save(STUDY)
