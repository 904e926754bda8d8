"""How far a grid is off in the patches of a contact, and in the shares at which they
percolate.

Rough, skewed and worn surfaces of 16 shortest waves a period, elastic or capped, are
solved on 4 and 8 points a shortest wave, and on 32 for the truth.

`python -m laboratory.patches` prints the tables of the guide, in some five minutes of
one core.  With `--kinds` it prints the coverage of the error estimates of percolation
on other kinds, where one saddle or a lattice of equal saddles decides; with
`--kinds --calibration` on the seeds and kinds that the factors come from.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace

import numpy as np
import pandas as pd

from epcontact import Load, Material, Scene, Surface, bem
from epcontact.harness.quantities.registry import measure_all
from epcontact.interface import percolation_fraction
from laboratory import area_bank
from laboratory.areas import KINDS, member

SEEDS = range(200, 216)
COARSE = (1, 2)
FINE = 8
SHARES = [f"quantity.{of}_percolation" for of in ("contact", "gap")]
PARTS = ("total", "plastic", "elastic")
PATCHES = [f"quantity.{part}_patches{of}" for part in PARTS for of in ("", "_largest")]


def measured(kind, seed, finer):
    """Return the percolating fractions with their estimated errors, and the counts and
    sizes of patches, of one random surface.

    `finer` refines the grid of 4 points a shortest wave; numbers of elastic and plastic
    patches are NaN for elastic bodies.
    """
    random = np.random.default_rng([seed, 3])
    hardness = float(random.choice([math.inf, 0.6, 0.3, 0.1]))
    load = random.choice([0.03, 0.1, 0.3]) * min(hardness, 0.6)
    if hardness == math.inf:
        load = random.choice([0.01, 0.05, 0.15])
    one = member(KINDS, kind, seed, 64)
    one = replace(one, shape=(64 * finer,) * 2, periods=(1.0, 1.0), high=16)
    heights = one.maker(one, np.random.default_rng(one.drawn))
    surface = Surface(heights, one.periods)
    scene = Scene(surface, Material(1.0, 0.0, hardness), Load(float(load)))
    result = bem.solve(scene, tolerance=1e-7, threads=1)
    names = [
        share + what for share in SHARES for what in ("", ".raw", ".error")
    ] + PATCHES
    found = measure_all(names, scene, result)
    capped = {} if hardness < math.inf else dict.fromkeys(PATCHES[2:], math.nan)
    return found | capped  # elastic contact alone is the total one


CALIBRATION = (
    "self-affine",
    "ground",
    "worn",
    "spheres",
    "unloaded",
    "unloaded spheres",
    "turned",
    "domed",
    "copies",
)
JUDGED = (*CALIBRATION, "blasted", "cylinders")


def closeness(kind, seed, finer):
    """Return the field by which points percolate, of a scene of `area_bank` on a grid
    `finer` times as fine as 64 points a side.
    """
    scene = area_bank.scene(kind, seed)
    pressure, gap, hardness, _, _, flowed = scene.solved(finer)
    at_cap = pressure >= hardness
    if flowed is not None:
        gap = gap + np.where(at_cap, 0.0, flowed)
    heights = scene.surface(finer)[0]
    by_gap = np.where((pressure <= 0) | at_cap, gap / np.ptp(heights), 0.0)
    return pressure / pressure.max() - by_gap


def of_kinds(kinds, seeds):
    """Return a table with the errors of percolating fractions and their estimates.

    Grids of 64 and 128 points a side are compared with 512 points; `error` is less by
    the error estimate of these.
    """
    rows = []
    for kind in kinds:
        for seed in seeds:
            exact = closeness(kind, seed, 8)
            for finer in (1, 2):
                field = closeness(kind, seed, finer)
                for sign in (1, -1):
                    truth = percolation_fraction(sign * exact)
                    limit = percolation_fraction(sign * field)
                    off = abs(limit.corrected - truth.corrected)
                    error = max(off - truth.error, 0.0)
                    rows.append((kind, error, limit.error))
    return pd.DataFrame(rows, columns=["kind", "error", "estimate"])


def print_kinds(calibration):
    """Print the coverage by kind, on the kinds and seeds of the calibration or on the
    others.
    """
    kinds = CALIBRATION if calibration else JUDGED
    rows = of_kinds(kinds, range(1000, 1008) if calibration else range(4100, 4108))
    rows["within"] = rows["error"] <= rows["estimate"]
    table = rows.groupby("kind")[["within", "error", "estimate"]]
    print(table.agg({"within": "mean", "error": "median", "estimate": "median"}))


def main():
    """Print the errors of the percolating fractions and the relative errors of the
    patches on each coarse grid; or the coverage by kind.
    """
    parser = argparse.ArgumentParser(prog="python -m laboratory.patches")
    parser.add_argument("--kinds", action="store_true")
    parser.add_argument("--calibration", action="store_true")
    given = parser.parse_args()
    if given.kinds:
        print_kinds(given.calibration)
        return
    scenes = [
        (kind, seed) for seed in SEEDS for kind in ("self-affine", "skewed", "worn")
    ]
    truth = pd.DataFrame([measured(*scene, FINE) for scene in scenes])
    for finer in COARSE:
        found = pd.DataFrame([measured(*scene, finer) for scene in scenes])
        rows = []
        for name in SHARES:
            raw, off = (abs(found[name + what] - truth[name]) for what in (".raw", ""))
            claim = found[name + ".error"]
            figures = [each.quantile(q) for each in (raw, off) for q in (0.5, 0.9)]
            rows.append((name, *figures, claim.median(), (off <= claim + 1e-12).mean()))
        columns = ["share", "raw", "90 %", "limit", "90 %", "claim", "within"]
        print(f"{4 * finer} points a shortest wave")
        print(pd.DataFrame(rows, columns=columns).round(4).to_string(index=False))
        ratio = (found[PATCHES] / truth[PATCHES] - 1).replace(math.inf, math.nan)
        table = {"median": ratio.median(), "off": abs(ratio).median()}
        table |= {"90 %": abs(ratio).quantile(0.9), "surfaces": ratio.count()}
        print(pd.DataFrame(table).round(3).to_string())


if __name__ == "__main__":
    main()
