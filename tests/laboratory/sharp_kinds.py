"""Coverage of the errors of areas on surfaces with creases, at four points a wave.

Each scene is a surface of one of KINDS whose finest roughness has four points a wave,
with bowls, arcs or scratches of 6 to 24 points, on a grid of 96 points a side.  Its
truth is the corrected area on a grid four times as fine.  E* and the rms slope are 1.
`epcontact.bem.resolution` was made with CALIBRATION and the seeds 1 to 10; JUDGED and
other seeds have had no part in it.  Areas below .1 % are left out.

`python -m laboratory.sharp_kinds [--calibration]` prints by kind the fraction of areas
within their errors, without and with the part for unresolved waves, and the medians of
estimate over error; three minutes of one core.
"""

from __future__ import annotations

import argparse
import itertools
import math
import warnings

import numpy as np
import pandas as pd

from epcontact import bem
from epcontact.scene import Load, Material, Scene, Surface, rms_slope
from laboratory import area_bank
from laboratory.areas import Member, roughness

POINTS, FINER = 96, 4
LOADS = (0.02, 0.1, 0.3)
HARDNESSES = (math.inf, 0.4)
SMALLEST = 1e-3


def _level(heights):
    """Return heights (n, n) on the period 1 with the rms slope 1."""
    return heights / rms_slope(heights, (1 / len(heights),) * 2)


def _rough(patch, rng, hurst=0.8):
    """Return roughness of a Hurst exponent on a patch, with the rms slope 1."""
    return roughness(patch, rng, hurst, hurst)


def _squares(patch, rng):
    """Return the squared distances from a random point on the grid of a patch."""
    x, y = patch.offsets(rng.uniform(size=2))
    return x**2 + y**2


def bowls(patch, rng):
    """Return the lower envelope of paraboloids, with some roughness."""
    side = rng.uniform(6, 20) / POINTS
    radius = rng.uniform(0.5, 2) * side
    heights = np.full(patch.shape, np.inf)
    for _ in range(2 * int(1 / side**2)):
        bowl = _squares(patch, rng) / (2 * radius * rng.uniform(0.7, 1.4))
        heights = np.minimum(heights, bowl - rng.uniform(0, 0.08) * side)
    return _level(heights) + rng.choice([0, 0.2, 0.5]) * _rough(patch, rng)


def peened(patch, rng):
    """Return roughness with round dents in it."""
    radius = rng.uniform(5, 14) / POINTS
    heights = rng.uniform(0.2, 0.5) * radius * _rough(patch, rng)
    for _ in range(int(0.3 / radius**2)):
        dent = _squares(patch, rng) / (2 * radius)
        heights = np.minimum(heights, dent - rng.uniform(0.05, 0.25) * radius)
    return heights


def milled(patch, rng):
    """Return arcs of a cutter on bent paths, with cusps between them."""
    count = max(round(POINTS / rng.uniform(8, 24)), 1)
    x, y = patch.offsets((0.5, 0.5))
    bend = rng.uniform(0.1, 0.5) * np.cos(2 * np.pi * y) / (2 * np.pi)
    across = (count * (x + bend) + rng.uniform()) % 1 - 0.5
    return _level(across**2) + rng.choice([0.1, 0.3]) * _rough(patch, rng)


def fly_cut(patch, rng):
    """Return straight oblique arcs of random depths, with cusps between them."""
    count = max(round(POINTS / rng.uniform(8, 24)), 2)
    x, y = patch.offsets((0.5, 0.5))
    phase = count * (x + 0.5) + int(rng.integers(0, 4)) * y + rng.uniform()
    number = np.floor(phase).astype(int)
    depths = rng.uniform(-0.1, 0.1, count)
    arcs = [
        (phase - number - 0.5 + k) ** 2 + depths[(number - k) % count]
        for k in (-1, 0, 1)
    ]
    heights = _level(np.minimum.reduce(arcs))
    return heights + rng.choice([0, 0.1, 0.3]) * _rough(patch, rng)


def scratched(patch, rng):
    """Return straight scratches along x, round or sharp, with roughness."""
    _, y = patch.offsets((0.5, 0.5))
    heights = np.zeros(patch.shape)
    for _ in range(POINTS // 2):
        width = rng.uniform(3, 14) / POINTS
        depth = rng.uniform(0.1, 0.5) * width
        distance = np.abs((y - rng.uniform() + 0.5) % 1 - 0.5) / width
        scratch = depth * (distance ** rng.choice([1, 2]) - 1)
        heights = np.minimum(heights, scratch)
    return _level(heights) + rng.choice([0.1, 0.3]) * _rough(patch, rng)


def worn(patch, rng):
    """Return roughness whose summits are cut off at 0.3 of its rms height."""
    heights = _rough(patch, rng)
    return np.minimum(heights, 0.3 * heights.std())


def hurst8(patch, rng):
    """Return roughness of Hurst exponent 0.8: smooth at four points a wave."""
    return _rough(patch, rng)


def hurst3(patch, rng):
    """Return roughness of Hurst exponent 0.3: smooth at four points a wave."""
    return _rough(patch, rng, 0.3)


# --- kinds that are only judged


def overlapping_dents(patch, rng):
    """Return a sum of round dents, whose rims are creases, with roughness."""
    dents = np.zeros(patch.shape)
    for _ in range(POINTS * POINTS // 154):
        radius = rng.uniform(5, 14) / POINTS
        dent = np.maximum(radius**2 - _squares(patch, rng), 0)
        dents -= rng.uniform(0.3, 1) * dent
    return _level(dents) + 0.4 * _rough(patch, rng)


def end_milled(patch, rng):
    """Return circular arcs around a centre beside the map, mirrored to a period."""
    x, y = (np.abs(u) for u in patch.offsets(rng.uniform(size=2)))
    radius = np.hypot(x + 0.3, 0.7 * y)
    across = POINTS / rng.uniform(8, 20) * radius % 1 - 0.5
    return _level(across**2) + rng.choice([0.1, 0.3]) * _rough(patch, rng)


def facets(patch, rng):
    """Return the upper envelope of random planes around points: flat-sided grains."""
    heights = np.full(patch.shape, -np.inf)
    for _ in range(60):
        x, y = patch.offsets(rng.uniform(size=2))
        turn = rng.uniform(0, 2 * np.pi)
        sides = np.abs(x * np.cos(turn) + y * np.sin(turn)) + np.abs(
            y * np.cos(turn) - x * np.sin(turn)
        )
        heights = np.maximum(heights, rng.uniform(0, 0.05) - 0.3 * sides)
    return _level(heights) + 0.2 * _rough(patch, rng)


CALIBRATION = (bowls, peened, milled, fly_cut, scratched, worn, hurst8, hurst3)
JUDGED = (
    area_bank.KINDS["turned"],
    area_bank.KINDS["blasted"],
    overlapping_dents,
    end_milled,
    facets,
    area_bank.KINDS["ground"],
)


def judged(maker, seed, loads=LOADS):
    """Return rows of the areas of a scene at loads over E*, with the kind, the error
    over the area, and the estimates without and with unresolved waves.
    """
    shape = (FINER * POINTS,) * 2
    patch = Member(shape, (1.0, 1.0), 0.0, math.inf, POINTS // 4, maker, seed)
    fine = _level(maker(patch, np.random.default_rng([seed, 59])))
    rows = []
    for load, hardness in itertools.product(loads, HARDNESSES):
        steps = []
        for step, sampled in ((FINER, False), (1, False), (1, True)):
            surface = Surface(
                fine[:: FINER // step, :: FINER // step], (1.0, 1.0), sampled=sampled
            )
            scene = Scene(surface, Material(1.0, 0.0, hardness), Load(load))
            steps.append(bem.solve(scene, area_tolerance=1e-5, threads=1).final.areas)
        truth, before, now = steps
        for part, exact in vars(truth["corrected"]).items():
            if exact < SMALLEST or (part != "total" and math.isinf(hardness)):
                continue
            error = abs(getattr(now["corrected"], part) - exact)
            if error > 1e-9:  # else nothing but the load determines it
                rows.append(
                    {
                        "kind": maker.__name__,
                        "error": error / exact,
                        "before": getattr(before["error"], part) / exact,
                        "now": getattr(now["error"], part) / exact,
                    }
                )
    return rows


def coverage(makers, seeds):
    """Return a table by kind: % of areas within their estimates, medians of estimate
    over error, median error in %, and the number of areas.
    """
    rows = [judged(maker, seed) for maker, seed in itertools.product(makers, seeds)]
    table = pd.DataFrame(itertools.chain(*rows))
    for name in ("before", "now"):
        table[f"within {name}"] = 100 * (table["error"] <= table[name])
        table[f"ratio {name}"] = table[name] / table["error"]
    kinds = table.groupby("kind", sort=False)
    found = kinds[["within before", "within now"]].mean().round(0)
    found = found.join(kinds[["ratio before", "ratio now"]].median().round(1))
    found["error (%)"] = (100 * kinds["error"].median()).round(2)
    return found.assign(areas=kinds.size())


def main():
    """Print the coverage of the kinds that the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m laboratory.sharp_kinds")
    parser.add_argument("--calibration", action="store_true")
    warnings.simplefilter("ignore")
    if parser.parse_args().calibration:
        print(coverage(CALIBRATION, range(1, 11)).to_string())
    else:
        print(coverage((*JUDGED, hurst8, hurst3), range(601, 611)).to_string())


if __name__ == "__main__":
    main()
