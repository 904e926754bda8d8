"""The effective hardness below the loads of its map, by the map's own J2 bodies on
finer grids.

`python -m laboratory.light_loads`, run in tests, prints c = hardness/sigma_Y at each
load and its ratio to that at the lightest load of the map, and how the area of the
capped body depends on c; the whole takes a quarter of an hour of one core.  A contact
of few spots is resolved the worse the lighter it is: from 12 to 24 nodes a wave, and
from 4 waves in a period to 8, the ratio rises.
"""

import numpy as np
import pandas as pd

from epcontact.harness.case_files.case import case_at, find_named
from epcontact.harness.methods.registry import METHODS
from epcontact.harness.solving.tasks import Run, tasks_of
from laboratory.hardness_map import inverse_hardness, measured_areas

LOADS = (0.003, 0.01, 0.03, 0.1)
WAVE = 6283.185307179586  # of sigma_Y; rad/m
#: Nodes a wave, waves in a period, E* xi/sigma_Y and seeds.
RUNS = [
    *((nodes, 4, s, range(101, 109)) for nodes in (12, 24) for s in (5, 15, 50)),
    (24, 4, 30, range(111, 117)),  # other surfaces, to check by
    (12, 8, 15, range(101, 107)),
]


def areas(nodes, waves, severity, seeds, *, loads=LOADS, roll_off=1, hurst=0.8, nu=0.3):
    """Return `measured_areas` of J2 bodies at light loads, and of capped bodies on the
    same compliance.

    Args:
        nodes: nodes to the shortest wave.
        waves: number of the shortest waves a period.
        severity: E* times rms slope over the yield stress.
        seeds: seeds of the surfaces.
        loads: mean pressures over the yield stress.
        roll_off: number of the waves of the roll-off a period.
        hurst: Hurst exponent.
        nu: Poisson's ratio.
    """
    (text,) = find_named("hardness-map-30")
    point = {
        "surface.points_per_shortest_wavelength": nodes,
        "surface.wavenumber_high": WAVE * waves,
        "surface.rms_slope": severity / 1000,
        "surface.seeds": list(seeds),
        "surface.hurst": hurst,
        "surface.wavenumber_roll_off": WAVE * roll_off,
        "material.poisson_ratio": nu,
        "material.young_modulus": 2e11 * (1 - nu**2),
        "load.mean_pressure": [load * 2e8 for load in loads],
    }
    case = case_at(text, point, "large")
    solve = METHODS["fem"].solve
    options = case.options["fem"]
    tasks = tasks_of(case, Run())
    return pd.concat(
        measured_areas(t, solve(case.scene(t.recipe), options, 1)) for t in tasks
    )


def main():
    """Print the effective hardness at light loads for each ensemble of RUNS."""
    for nodes, waves, severity, seeds in RUNS:
        found = areas(nodes, waves, severity, seeds)
        inverse = inverse_hardness(found)[0]["inverse"].to_numpy()
        for load, c in zip(LOADS, 1 / inverse, strict=True):
            capped = found[np.isclose(found["load"], load) & np.isfinite(found["cap"])]
            means = capped.groupby("cap")["cap_area"].mean()
            near = means[(means.index > c / 1.2) & (means.index < c * 1.2)]
            slope = (
                np.polyfit(np.log(near.index), np.log(near), 1)[0]
                if len(near) > 1
                else np.nan
            )
            place = (
                f"{nodes} nodes, {waves} waves, E*xi/sigma_Y {severity}, load {load}"
            )
            figures = (
                f"c {c:.3f}, ratio {c * inverse[-1]:.3f}, d ln A/d ln c {slope:.2f}"
            )
            print(f"{place}: {figures}", flush=True)


if __name__ == "__main__":
    main()
