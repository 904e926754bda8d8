"""Measure the constants of stiffness and conductance in the limit of a vanishing
spacing.

They are `epcontact.interface.rim.CONSTANTS` and `SMOOTH`.  They are fitted to the kinds of surfaces
in TAUGHT, and judged on those of `epcontact.studies.areas`, on roughness with its
ridges along the grid and on unloaded contacts, each on grids of 3 to 16 points a
shortest wavelength.  The truth is the limit from a finer grid.

`sharp` and `short` minimise the mean logarithm of the error.  The claims minimise the
mean of ln(claim) + max(0, ln(error/claim))/(1 - COVERED).  `STEP` is measured on
punches that are discs, which have a closed form.

`python -m laboratory.interface` prints the constants in use, those that the ensemble
and its halves give, and the table of the kinds on which they are judged, in some
fifteen minutes of one core.

Errors by chance average out on long rims, and what all links share does not.  On
roughness of 16 to 128 shortest waves on a period, four points each, the limit stays .5
to 1 % below that of 16 points, which is `common`: `python -m laboratory.interface
waves` judges it, in ten minutes of one core.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
from scipy.optimize import minimize
from scipy.signal import resample

from epcontact import EpcontactError, Load, Material, Scene, Surface, bem
from epcontact.interface.rim import CONSTANTS, SMOOTH, STEP, limit_of
from epcontact.interface.stiffness import carrying, sinking_and_rim
from epcontact.reference.posts import FLAT_PUNCH
from epcontact.studies.areas import KINDS, by_name, member, roughness
from epcontact.studies.conductance import joint_scene

#: The share of errors that are to lie within their claim.
COVERED = 0.94
#: Relative errors and claims below this count as this.
_LEAST = 3e-4
#: Seeds, points a side, and how much finer the truth is.  Larger grids tell errors by
#: chance from others, as they fall with the root of the length of the rim.
TAUGHT_ON = ((range(1000, 1030), 48, 8), (range(2000, 2004), 160, 4))
JUDGED_ON = ((range(100, 125), 48, 8),)
_QUANTITIES = {"unloading": "conductance", "loading": "stiffness_loading"}


def _waves(patch, rng, count=60):
    """Random waves of half to all of the highest wave number, of rms slope 1."""
    (nx, ny), (x, y) = patch.shape, patch.offsets()
    heights, slope = np.zeros((nx, ny)), 0.0
    for _ in range(count):
        size, turn, phase = (
            rng.uniform(0.5, 1),
            rng.uniform(0, 2 * np.pi),
            rng.uniform(),
        )
        a, b = (round(patch.high * size * f(turn)) for f in (math.cos, math.sin))
        heights += np.cos(2 * np.pi * (a * x + b * y + phase))
        slope += 2 * np.pi**2 * (a * a + b * b)
    return heights / math.sqrt(slope)


def _terraces(patch, rng):
    """Return roughness on two levels whose edge follows long waves."""
    coarse = replace(patch, high=3)
    above = _waves(coarse, rng) > rng.uniform(-0.05, 0.05)
    return rng.uniform(0.1, 0.5) * _waves(patch, rng) + rng.uniform(0.01, 0.1) * above


def _ripples(patch, rng):
    """Return two sinusoids in different directions."""
    x, y = patch.offsets()
    heights = np.zeros(patch.shape)
    for slope in (1.0, rng.choice([0.0, 0.3, 1.0])):
        a, b = rng.choice([[1, 0], [0, 3], [1, 2], [2, 2], [4, 1]])
        wave = np.cos(2 * np.pi * (a * x + b * y + rng.uniform()))
        heights = heights + slope * wave / (2 * np.pi * math.hypot(a, b))
    return heights


def _ellipsoids(patch, rng):
    """Return a few turned elliptic summits."""
    heights = np.full(patch.shape, -np.inf)
    for _ in range(int(rng.integers(2, 7))):
        along, across = _turned(patch, rng)
        bent = along**2 * rng.uniform(1, 5) + across**2 * rng.uniform(1, 5)
        heights = np.maximum(heights, rng.uniform(0, 0.04) - bent)
    return heights


def _rings(patch, rng):
    """Return one or two flat elliptic rings or discs."""
    heights = np.zeros(patch.shape)
    for _ in range(int(rng.integers(1, 3))):
        along, across = _turned(patch, rng)
        outer, depth = rng.uniform(0.15, 0.3), rng.uniform(0.02, 0.3)
        away = np.hypot(along, across * rng.uniform(1, 1.5))
        ring = (away < outer) & (
            away > outer * rng.choice([0.0, rng.uniform(0.3, 0.7)])
        )
        heights = np.where(ring, depth, heights)
    return heights


def _pyramids(patch, rng):
    """Return a pyramid with a flat top."""
    along, across = _turned(patch, rng)
    away = np.maximum(np.abs(along), np.abs(across) * rng.uniform(0.7, 1.5))
    return -rng.uniform(0.1, 0.8) * np.maximum(away - rng.uniform(0.05, 0.3), 0)


def _grooves(patch, rng):
    """Return roughness with parallel grooves of triangular section."""
    (a, b), (x, y) = rng.choice([[2, 0], [1, 2], [3, 3], [0, 4]]), patch.offsets()
    across = np.abs((a * x + b * y + rng.uniform()) % 1 - 0.5)
    width = rng.uniform(0.1, 0.4)
    depth = rng.uniform(0.2, 1) * np.maximum(width - across, 0) / math.hypot(a, b)
    return 0.1 * _waves(patch, rng) - depth


def _spikes(patch, rng):
    """Return roughness with narrow cones."""
    heights = _waves(patch, rng)
    for _ in range(int(rng.integers(3, 30))):
        along, across = _turned(patch, rng)
        height, slope = rng.uniform(0.02, 0.1), rng.uniform(2, 8)
        heights = heights + np.maximum(height - slope * np.hypot(along, across), 0)
    return heights


def _lapped(patch, rng):
    """Waves whose heights above a level are pressed together, so that the level is an
    edge.
    """
    heights = _waves(patch, rng)
    level = rng.uniform(0, 1.5) * heights.std()
    return np.minimum(heights, level + rng.uniform() * (heights - level))


def _turned(patch, rng):
    """Distances (nx, ny) from a random centre along two random directions at right
    angles.
    """
    (x, y), turn = patch.offsets(rng.uniform(size=2)), rng.uniform(0, np.pi)
    cosine, sine = math.cos(turn), math.sin(turn)
    return x * cosine + y * sine, y * cosine - x * sine


#: Kinds of surfaces other than those of `epcontact.studies.areas`, to which constants
#: are fitted.
TAUGHT = {"waves": _waves, "oblong": _waves} | by_name(
    _terraces, _ripples, _ellipsoids, _rings
)
TAUGHT |= by_name(_pyramids, _grooves, _spikes, _lapped)


def _along_the_grid(patch, rng):
    """Self-affine roughness of ridges five times as long as wide, along x or y."""
    n, high = patch.shape[0], patch.high
    k = np.fft.fftfreq(n, 1 / n)
    across, along = np.meshgrid(k, k, indexing="ij")
    stretched = np.hypot(across, 5 * along)
    power = np.where(np.hypot(across, along) <= high, (1 + stretched) ** -1.8, 0.0)
    waves = np.zeros((n, n), complex)
    few = np.r_[0 : high + 1, -high:0]  # the same waves on every grid
    waves[np.ix_(few, few)] = rng.normal(size=(2 * high + 1,) * 2 + (2,)) @ (1, 1j)
    heights = np.fft.ifft2(waves * power).real
    slope = 2 * np.pi * np.abs(waves * power) * np.hypot(across, along) / n**2
    heights /= math.sqrt((slope**2).sum() / 2)
    return heights if rng.uniform() < 0.5 else heights.T


_hurst = partial(roughness, low=0.2, high=0.95)
#: What the constants are judged on.
JUDGED = KINDS | {"along the grid": _along_the_grid, "unloaded": _hurst}


def scene_of(makers, kind, seed, points, finer):
    """A member of the ensemble of areas, at loads below .3 E*, as a scene of a period
    of 1.
    """
    one = member(makers, kind, seed, points)
    path = (one.load if one.load < 0.3 else one.load / 10,)
    if kind == "unloaded":
        random = np.random.default_rng([seed, 1])
        path = (path[0], path[0] * 10 ** random.uniform(-1.5, -0.05))
    fine = replace(one, shape=(finer * one.shape[0], finer * one.shape[1]))
    heights = one.maker(fine, np.random.default_rng(one.drawn))
    hardness = min(one.hardness, 1.2) if kind == "unloaded" else one.hardness
    return Scene(
        Surface(heights, one.periods), Material(1.0, 0.0, hardness), Load(path)
    )


def lessons(makers, seeds, points, finer):
    """(kind, branch, coarse, fine) of all that touches and parts, with sinking and rim
    of each.
    """
    out = []
    for kind in makers:
        for seed in seeds:
            scenes = [
                scene_of(makers, kind, seed, points, factor) for factor in (1, finer)
            ]
            try:
                results = [
                    bem.solve(scene, tolerance=1e-7, threads=1) for scene in scenes
                ]
                for branch in _QUANTITIES:
                    masks = [carrying(result, branch) for result in results]
                    if all(0 < mask.mean() < 0.9 for mask in masks):
                        both = zip(scenes, results, strict=True)
                        pair = [sinking_and_rim(*one, branch) for one in both]
                        if branch == "unloading" or all(rim.flows for _, rim in pair):
                            out.append((kind, branch, *pair))
            except EpcontactError as error:
                print(f"{kind} {seed}: {error}", file=sys.stderr)
    return out


def judged(known, constants=None):
    """A row for each lesson: kind, quantity, and raw error, error and claim over the
    truth.
    """
    rows = []
    for kind, branch, coarse, fine in known:
        found, truth = (
            limit_of(*coarse, constants),
            limit_of(*fine, constants).corrected,
        )
        errors = [abs(math.log(k / truth)) for k in (found.raw, found.corrected)]
        rows.append((kind, _QUANTITIES[branch], *errors, found.error / found.corrected))
    return pd.DataFrame(rows, columns=["kind", "quantity", "raw", "error", "claim"])


def fitted(known, start):
    """The constants with the least loss; where `sharp` is 0 it is kept."""

    def off(centre):
        """Return the logarithms of the errors with two constants of the edges changed."""
        changed = start._replace(sharp=centre[0], short=centre[1])
        return np.log(judged(known, changed)["error"] + 0.002)

    def loss(logarithms):
        """Return the mean width of the intervals with a penalty for errors outside."""
        claims = dict(zip(("chance", "area"), np.exp(logarithms), strict=True))
        found = np.log(
            judged(known, start._replace(**claims))[["claim", "error"]] + _LEAST
        )
        claim, error = found["claim"], found["error"]
        return np.mean(claim + np.maximum(error - claim, 0) / (1 - COVERED))

    if start.sharp:
        centre = minimize(lambda x: off(x).mean(), start[:2], method="Nelder-Mead").x
        start = start._replace(sharp=centre[0], short=centre[1])
    at = np.log([start.chance, start.area])
    for _ in range(2):  # a second simplex leaves where the first one has collapsed
        options = {
            "initial_simplex": np.vstack([at, at + 0.7 * np.eye(at.size)]),
            "xatol": 0.02,
        }
        at = minimize(loss, at, method="Nelder-Mead", options=options).x
    return start._replace(
        **dict(zip(("chance", "area"), np.exp(at).tolist(), strict=True))
    )


def _disc(points, radius, centre):
    """Return the scene of a flat disc on a floor; lengths are over the period."""
    x, y = ((np.arange(points) / points - c + 0.5) % 1 - 0.5 for c in centre)
    heights = np.where(np.hypot(x[:, None], y[None]) < radius, 0.0, -10.0)
    return Scene(Surface(heights, (1.0, 1.0)), Material(1.0, 0.0), Load(0.05))


def steps(count=24):
    """What each of some punches needs beyond CONSTANTS.short, in spacings."""
    needed, random = [], np.random.default_rng(5)
    for points in np.repeat([64, 128, 256], count):
        place = random.uniform(0.08, 0.2), random.uniform(size=2)
        scene = _disc(points, *place)
        exact = 2 / FLAT_PUNCH.scalar(
            "quantity.conductance", _disc(2048, *place)
        )  # E* u
        sinking, rim = sinking_and_rim(scene, bem.solve(scene, threads=1), "unloading")
        moved = sinking * math.log(sinking / exact) / rim.release / CONSTANTS.sharp
        needed.append(moved - rim.offset - CONSTANTS.short)
    return np.array(needed)


def table(known):
    """Medians in % and the share within the claim, by quantity and kind, and of all
    kinds.
    """
    found = judged(known)
    found["within"] = found["error"] <= found["claim"]
    rows = pd.concat([found, found.assign(kind="~ all")]).groupby(["quantity", "kind"])
    medians = 100 * rows[["raw", "error", "claim"]].median()
    return medians.join(rows["within"].agg(["mean", "size"])).round(2)


#: Ranges of H/(E* xi) and P/H: heavy and flowing, elastic, light and flowing, and
#: between.
RANGES = (
    (0.03, 0.1, 0.1, 0.3),
    (0.5, 1.0, 0.01, 0.15),
    (0.03, 0.1, 0.005, 0.05),
    (0.15, 0.4, 0.01, 0.3),
)


def waves(finer=4):
    """The coverage without `common` and with it, by the shortest waves on a period, of
    the scenes that chose it (even seeds) and of the others.
    """
    found = []
    for high, count in ((16, 24), (32, 24), (64, 20), (128, 20)):
        random = np.random.default_rng([31, high])
        for k in range(count):
            ends = np.log(RANGES[k // 2 % 4])
            hardness, load = (
                math.exp(random.uniform(*pair)) for pair in (ends[:2], ends[2:])
            )
            load, breadth = (
                min(load, 0.4 / math.hypot(1, 2 * hardness)),
                int(random.choice([4, 8])),
            )
            place = (
                breadth,
                random.uniform(0.3, 0.9),
                hardness,
                load,
                9000 + k,
                high // breadth,
            )
            one = joint_scene(*place)
            heights = one.surface.heights
            for axis in (0, 1):
                heights = resample(heights, finer * heights.shape[axis], axis=axis)
            both = (one, replace(one, surface=Surface(heights, one.surface.periods)))
            solved = [
                (scene, bem.solve(scene, tolerance=1e-7, threads=1)) for scene in both
            ]
            lesson = [sinking_and_rim(*pair, "unloading") for pair in solved]
            for common in (0.0, CONSTANTS.common):
                row = judged(
                    [("", "unloading", *lesson)], CONSTANTS._replace(common=common)
                )
                found.append(row.assign(waves=high, half=k % 2, common=common))
    table = pd.concat(found)
    table["within"] = table["error"] <= table["claim"]
    return (
        table.groupby(["common", "half", "waves"])["within"]
        .agg(["mean", "size"])
        .round(2)
    )


def main():
    """Print the constants in use, those fitted, and the table of the kinds that taught
    nothing.
    """
    known = [one for grids in TAUGHT_ON for one in lessons(TAUGHT, *grids)]
    for start, branch in ((CONSTANTS, "unloading"), (SMOOTH, "loading")):
        mine = [one for one in known if one[1] == branch]
        print(branch, len(mine), "in use", start)
        for part in (mine, mine[::2], mine[1::2]):
            print("  fitted", np.round(fitted(part, start), 3))
    needed = steps()
    off = np.quantile(np.abs(needed - np.median(needed)), COVERED) * CONSTANTS.sharp
    print(
        f"steps add {np.median(needed):.3f}, and {off:.3f} to the claim; in use", STEP
    )
    print(
        table(
            [one for grids in JUDGED_ON for one in lessons(JUDGED, *grids)]
        ).to_string()
    )


if __name__ == "__main__":
    print(waves().to_string()) if sys.argv[1:] == ["waves"] else main()
